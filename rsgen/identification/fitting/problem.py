"""What is fitted to what: a law with free values, and what the sensors saw."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.tolerances import CHANCE, NOTICEABLE
from rsgen.identification.fitting.observed import Observed
from rsgen.law.element import Element
from rsgen.law.numeric import ForceLaw

__all__ = ["MISSING_TERMS", "Problem", "beyond_chance", "is_systematic", "neighbour_power"]


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """What is fitted to what: parameters are those of the law by name, the mass where free, the background.

    Parameters
    ----------
    elements, law
        The laws, for the simulator and as array functions.
    observed
        The measured points.
    given
        m [kg], None where it is free.
    held
        Parameters that stay at their starting values, yet count among the unknowns when errors are stated.
    """

    elements: tuple[Element, ...]
    law: ForceLaw
    observed: Observed
    given: float | None
    held: tuple[int, ...] = ()

    @property
    def count(self) -> int:
        """Parameters apart from the background."""
        return len(self.law.parameters) + (self.given is None)

    @property
    def sensors(self) -> str:
        """Between which sensors elements act, "" where all follow the response."""
        return next((element.across for element in self.elements if element.across), "")

    def split(self, parameters: Array) -> tuple[Array, float, Array]:
        """Values of the law (p,), mass [kg] and background (b,)."""
        values = parameters[: len(self.law.parameters)]
        mass = float(parameters[len(values)]) if self.given is None else self.given
        return values, mass, parameters[self.count :]

    def join(self, values: Array, mass: float, background: Array | None = None) -> Array:
        """One vector of them; None is a background of zeros."""
        if background is None:
            background = np.zeros(len(self.observed.background.names))
        return np.concatenate([values, [mass] if self.given is None else [], background])

    def select(self, chosen: NDArray[np.intp]) -> Problem:
        """Take some of the points."""
        return replace(self, observed=self.observed.select(chosen))

    def compared(self, predicted: tuple[int, ...]) -> tuple[int, ...]:
        """Harmonics other than the fundamental that are measured, of those ``predicted``."""
        measured = self.observed.points.measured if self.observed.phase_known else ()
        return tuple(h for h in measured if h in predicted)


MISSING_TERMS = ("x*abs(x)", "x**3", "x**5", "v*abs(v)", "v**3", "sign(v)")
"""What a law may lack: the commonest nonlinear springs and dampers; others are nearly made up of them."""

# ----------------------------------------------------------------------------
# Whether misfits have a pattern: those of neighbours go together where the law, not noise, makes them.

_SYSTEMATIC = 0.3
"""Correlation of neighbouring misfits, or share of them, that is the law's, not the noise's."""

_PAIRS = 6
"""Pairs of neighbours below which their correlation says nothing."""


def is_systematic(residual: Array, pairs: NDArray[np.intp]) -> bool:
    """Tell whether misfits of any quantity go together between neighbours in frequency of one run.

    Parameters
    ----------
    residual
        (n, M) of force, fundamental and harmonics, real and imaginary parts, relative.
    pairs
        (k, 2) points next to each other in the test, of those that count; see ``Points.pairs``.
    """
    if len(pairs) < _PAIRS:
        return False
    power, shared = neighbour_power(residual, pairs)
    counts = power > NOTICEABLE**2 / 2
    if not counts.any():
        return False
    # real and imaginary part are two independent numbers of a pair, whatever was recorded
    each, together = shared[counts] / power[counts], shared[counts].sum() / power[counts].sum()
    return bool(beyond_chance(each, len(pairs)).any() or beyond_chance(together, 2 * len(pairs)))


def neighbour_power(residual: Array, pairs: NDArray[np.intp]) -> tuple[Array, Array]:
    """Mean square of misfits (n, M) at pairs of neighbours, and the part that they share: (M,) each."""
    first, second = (residual[side] for side in pairs.T)
    return np.mean(residual[pairs] ** 2, axis=(0, 1)), np.mean(first * second, axis=0)


def beyond_chance(correlation: Any, numbers: Any) -> NDArray[np.bool_]:
    """Whether so many numbers go together as noise hardly does: atanh r is normal (Fisher, Metron, 1921)."""
    chance = np.tanh(CHANCE / np.sqrt(np.maximum(numbers - 3, 1e-300)))
    return np.asarray(correlation > np.maximum(_SYSTEMATIC, chance))
