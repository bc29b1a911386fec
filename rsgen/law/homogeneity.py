"""Groups of parameters of degree one: with all of a group doubled, what they do to the force doubles.

Force and stiffness of a saturation are such a group: neither is linear, but their common factor is.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.expression import symbol

__all__ = ["scaled_groups"]

Array = NDArray[np.float64]

_LARGEST = 3
_SIZES = (1e-3, 1.0, 1e3)
"""Of random states and values: numbers in a law hide at one size what another shows."""

_FACTORS = (1.0, 2.0, 3.0)
_SAME = 1e-9
_ROUND_OFF = 1e-12


def scaled_groups(
    pieces: Sequence[tuple[sympy.Expr, Sequence[sympy.Expr]]],
    parameters: Sequence[sympy.Symbol],
    linear: Sequence[int],
) -> tuple[tuple[int, ...], ...]:
    """Find groups of nonlinear parameters in whose common positive factor a law is linear.

    Parameters
    ----------
    pieces
        Smooth terms of the normal form, each with the functions that switch it.
    parameters
        All of the law.
    linear
        Indices of those in which it is linear anyway.

    Returns
    -------
    tuple of tuples
        Disjoint groups of indices, the smallest there are.
    """
    free = [i for i in range(len(parameters)) if i not in linear]
    groups: list[tuple[int, ...]] = []
    for size in range(1, _LARGEST + 1):
        for chosen in combinations(free, size):
            if set(chosen) & {i for group in groups for i in group}:
                continue
            told = [_is_scaled(term, switches, parameters, chosen, linear) for term, switches in pieces]
            if None not in told and any(told):
                groups.append(chosen)
    return tuple(groups)


def _is_scaled(
    term: sympy.Expr,
    switches: Sequence[sympy.Expr],
    parameters: Sequence[sympy.Symbol],
    chosen: tuple[int, ...],
    linear: Sequence[int],
) -> bool | None:
    """Tell whether a factor of the chosen acts on a term; None where the term is not affine in it.

    Switches may change by a positive factor only.
    """
    own = {parameters[i] for i in chosen}
    parts = [part for part in sympy.Add.make_args(sympy.expand(term)) if part.free_symbols & own]
    moving = [switch for switch in switches if switch.free_symbols & own]
    if not parts and not moving:
        return False
    if not parts or any(part.free_symbols & {parameters[i] for i in linear} for part in parts):
        # a part that another unknown multiplies would be linear in neither
        return None
    variables = [symbol("x"), symbol("v"), *parameters]
    functions = sympy.lambdify(variables, [*parts, *moving], modules=["scipy", "numpy"])
    generator = np.random.default_rng(1)
    acts = False
    for size in _SIZES:
        x, v = generator.normal(size=(2, 64)) * size
        values = np.exp(generator.normal(size=len(parameters))) * generator.choice(_SIZES)
        drawn = []
        for factor in _FACTORS:
            trial = np.array(values)
            trial[list(chosen)] *= factor
            with np.errstate(all="ignore"):
                drawn.append(
                    [np.broadcast_to(np.asarray(f, float), x.shape) for f in functions(x, v, *trial)]
                )
        shares, signs = (
            np.array([each[: len(parts)] for each in drawn]),
            [each[len(parts) :] for each in drawn],
        )
        forces = shares.sum(axis=1)
        told = np.all(np.isfinite(forces), axis=0)
        first, second = (forces[1] - forces[0])[told], (forces[2] - 2 * forces[1] + forces[0])[told]
        step = np.max(np.abs(first), initial=0.0)
        # parts may cancel: b*ks - b*|ks|
        round_off = _ROUND_OFF * np.max(np.abs(shares[:, :, told]), initial=0.0)
        if np.any(np.abs(second) > max(_SAME * step, round_off)) or not _same_sign(signs):
            return None
        acts |= bool(step > max(_SAME * np.max(np.abs(forces[:, told]), initial=0.0), round_off))
    return acts


def _same_sign(signs: Sequence[Sequence[Array]]) -> bool:
    """Tell whether switches change by one positive factor at all states."""
    for before, after in zip(signs[0], signs[1], strict=True):
        size = np.max(np.abs(before), initial=0.0)
        with np.errstate(all="ignore"):
            factor = float(np.sum(before * after) / np.sum(before * before))
        if not (factor > 0 and np.all(np.abs(after - factor * before) <= _SAME * factor * size)):
            return False
    return True
