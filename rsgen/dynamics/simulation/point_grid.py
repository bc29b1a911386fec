"""The grid of a virtual test: in parts, or frequency by frequency as a sweep passes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from rsgen.common.arrays import Array
from rsgen.dynamics.simulation.virtual_test import SimulatedTest
from rsgen.dynamics.steady_state import SteadyStates

__all__ = ["Progress", "grid_of", "in_parts", "swept"]

States = TypeVar("States", bound=SteadyStates)
Progress = Callable[[float], None] | None
"""Called with the share that is done, from 0 to 1."""

_PART = 65536
"""Points between two reports of the progress: a second or so."""


def grid_of(test: SimulatedTest) -> tuple[Array, Array]:
    """Level and frequency (n,) of every point, level by level."""
    return np.repeat(test.level, len(test.frequency)), np.tile(test.frequency, len(test.level))


def in_parts(solve: Callable[[Array, Array], States], test: SimulatedTest, progress: Progress) -> States:
    """Solve the grid part by part, by ``solve(levels, frequencies)``."""
    level, frequency = grid_of(test)
    parts = []
    for low in range(0, len(level), _PART):
        part = slice(low, low + _PART)
        parts.append(solve(level[part], frequency[part]))
        if progress is not None:
            progress(min(low + _PART, len(level)) / len(level))
    return type(parts[0]).joined(parts)


def swept(
    solve: Callable[[Array, SteadyStates | None], SteadyStates], test: SimulatedTest, progress: Progress
) -> SteadyStates:
    """Solve the grid frequency by frequency in the order of the sweep, all levels at once.

    ``solve(frequency, last)`` takes the frequency (levels,) and the states at the one before, None at first.
    """
    order = np.argsort(test.frequency)[:: 1 if test.sweep == "up" else -1]
    parts: list[SteadyStates] = []
    for column in order:
        frequency = np.full(len(test.level), test.frequency[column])
        parts.append(solve(frequency, parts[-1] if parts else None))
        if progress is not None:
            progress(len(parts) / len(order))
    # the parts are in the order of the sweep, the grid is level by level
    rank, levels = np.argsort(order), len(test.level)
    return SteadyStates.joined(parts, (rank[None, :] * levels + np.arange(levels)[:, None]).ravel())
