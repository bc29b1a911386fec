"""Virtual tests by time integration: all points from rest, or sweeps that carry the state along."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rsgen.oscillator import Oscillator
from rsgen.simulation.virtual_test import SimulatedTest
from rsgen.steady_state import SteadyStates, solve_steady_states

__all__ = ["integrate"]

_POINTS_A_REPORT = 65536  # between two calls of ``progress``


def integrate(
    oscillator: Oscillator, test: SimulatedTest, progress: Callable[[float], None] | None
) -> SteadyStates:
    """Solve the grid of a test, ordered level by level."""
    if test.sweep == "rest":
        return _from_rest(oscillator, test, progress)
    return _sweep(oscillator, test, progress)


def _from_rest(
    oscillator: Oscillator, test: SimulatedTest, progress: Callable[[float], None] | None
) -> SteadyStates:
    force = np.repeat(test.level, len(test.frequency))
    frequency = np.tile(test.frequency, len(test.level))
    parts = []
    for low in range(0, len(force), _POINTS_A_REPORT):
        part = slice(low, low + _POINTS_A_REPORT)
        parts.append(
            solve_steady_states(
                oscillator, force[part], frequency[part], harmonics=test.harmonics, accuracy=test.accuracy
            )
        )
        if progress is not None:
            progress(min(low + _POINTS_A_REPORT, len(force)) / len(force))
    return SteadyStates.joined(parts)


def _sweep(
    oscillator: Oscillator, test: SimulatedTest, progress: Callable[[float], None] | None
) -> SteadyStates:
    """Go through the frequencies in order, all levels at once; each starts where the last one ended."""
    order = np.argsort(test.frequency)
    if test.sweep == "down":
        order = order[::-1]
    start: NDArray[np.float64] | None = None
    parts = []
    for done, column in enumerate(order, 1):
        states = solve_steady_states(
            oscillator,
            test.level,
            np.full(len(test.level), test.frequency[column]),
            harmonics=test.harmonics,
            accuracy=test.accuracy,
            start=start,
        )
        # a motion without bound ends the run; the test engineer starts again from rest
        start = np.where(np.isfinite(states.state), states.state, 0.0)
        parts.append(states)
        if progress is not None:
            progress(done / len(order))
    # the parts are frequency by frequency as swept; the surface is level by level as in the test
    rank = np.empty(len(order), dtype=np.intp)
    rank[order] = np.arange(len(order))
    levels = np.arange(len(test.level))
    return SteadyStates.joined(parts, (rank[None, :] * len(levels) + levels[:, None]).ravel())
