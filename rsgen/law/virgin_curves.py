"""What a virgin curve of a Masing law must be, and the signs that this leaves its parameters."""

from __future__ import annotations

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import ExpressionError
from rsgen.formula import symbol, write
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.formula.memory import remembers

__all__ = ["check_virgin", "positive_in"]

_TYPICAL = (1.0, 0.3, 2.5)
"""Values of all parameters, and displacements, at which the sign of a virgin curve is looked at."""

_AT_ZERO = 1e-12
"""Force at x = 0, relative to the largest, that is round-off."""

_TRIALS, _DECADES = 64, 3
"""Random values of all parameters at which a sign is tried, and decades to both sides of one that they span:
the power of a curve must come near one, its corners near and far."""

_SMALL = 1e-9
"""Displacement before any corner of a curve at these values."""


def check_virgin(curve: sympy.Expr) -> None:
    """Refuse what is no virgin curve.

    Raises
    ------
    ExpressionError
        It depends on v or on a memory, or not on x; it is not zero at zero, or negative.
    """
    text, x = write(curve), symbol("x")
    if curve.has(symbol("v")) or remembers(curve):
        raise ExpressionError(f"masing({text}): a virgin curve is written in x and parameters only")
    if not curve.has(x):
        raise ExpressionError(f"masing({text}): a virgin curve depends on x")
    names = tuple(sorted(curve.free_symbols - {x}, key=str))
    law = compiled((curve,), (x, *names))
    places = np.array([0.0, 1e-9, *(1e-3 * size for size in _TYPICAL)])
    (forces,) = law(places, *np.full((len(names), len(places)), _TYPICAL[0]))
    forces = np.broadcast_to(forces, places.shape)
    largest = float(np.max(np.abs(forces), where=np.isfinite(forces), initial=1.0))
    if not abs(forces[0]) <= _AT_ZERO * largest:
        raise ExpressionError(f"masing({text}): a virgin curve must be zero at x = 0")
    if np.all(forces[2:] < 0):
        raise ExpressionError(
            f"masing({text}): a virgin curve must be positive for x > 0; the sign stands before it"
        )


def positive_in(curve: sympy.Expr, parameter: sympy.Symbol) -> bool:
    """Decide whether a virgin curve is none where a parameter is negative, whatever the others are.

    The limit of a slider: ``Min(kt*x, Fs)`` is not zero at zero for a negative Fs, and negative for a
    negative kt.
    """
    x = symbol("x")
    names = tuple(sorted(curve.free_symbols - {x}, key=str))
    if parameter not in names:
        return False
    law = compiled((curve,), (x, *names))
    generator = np.random.default_rng(0)
    values = 10.0 ** generator.uniform(-_DECADES, _DECADES, (len(names), _TRIALS))
    if not _is_virgin(law, values).any():
        # of no sign do all hold: nothing follows
        return False
    values[names.index(parameter)] *= -1
    return not _is_virgin(law, values).any()


def _is_virgin(law: Numeric, values: Array) -> NDArray[np.bool_]:
    """(t,) whether the curve is zero at zero and positive beside it, at values (p, t)."""
    (at_zero,), (beside,) = (law(np.full(values.shape[1], place), *values) for place in (0.0, _SMALL))
    zero = np.abs(at_zero) <= _AT_ZERO * np.abs(beside)
    return np.asarray(zero & (beside > 0) & np.isfinite(beside))
