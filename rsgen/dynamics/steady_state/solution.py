"""What the solver returns: one steady state a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray

__all__ = ["SteadyStates", "grid_above"]


# ----------------------------------------------------------------------------
# Numbers of steps in a period on offer: few different ones fill the batches.

_GRID = np.array([24 * 2**k for k in range(10)] + [32 * 2**k for k in range(10)])
_GRID.sort()


def grid_above(wanted: float | Array) -> NDArray[np.int64]:
    """The next number of steps on offer."""
    return np.asarray(_GRID[np.minimum(np.searchsorted(_GRID, wanted), len(_GRID) - 1)])


@dataclass(frozen=True, slots=True, eq=False)
class SteadyStates:
    """Steady states of an oscillator under harmonic force; n points, H harmonics.

    Parameters
    ----------
    harmonics
        (n, H+1) complex displacement [m], x(t) = Re sum_h X_h exp(i h omega t); column 0 is the mean (real).
        NaN where the outcome is not 0.
    peak
        (n, 2) largest and smallest displacement in a period [m].
    state
        (n, D) displacement [m] and velocity [m/s] at t = 0, the start of a period; then, for a law with
        memory, what it remembers there [SI].
    residual
        (n,) how far the state is from repeating after one period, relative to the amplitude [1].
    outcome
        (n,) index into ``rsgen.data.surface.OUTCOMES``; 0 is settled.
    error
        (n,) estimated relative error of the fundamental [1].
    """

    harmonics: ComplexArray
    peak: Array
    state: Array
    residual: Array
    outcome: NDArray[np.int8]
    error: Array

    def __post_init__(self) -> None:
        for entry in fields(self):
            array: NDArray[Any] = getattr(self, entry.name)
            array.flags.writeable = False

    def __len__(self) -> int:
        """Count the points."""
        return len(self.outcome)

    @property
    def settled(self) -> NDArray[np.bool_]:
        """(n,) True where the response repeats with the period of the force."""
        return np.equal(self.outcome, 0)

    @classmethod
    def joined(cls, parts: Sequence[Self], order: NDArray[np.intp] | None = None) -> Self:
        """Put parts one after the other, then take the points in an order."""
        names = [entry.name for entry in fields(cls)]
        whole = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return cls(**(whole if order is None else {name: array[order] for name, array in whole.items()}))
