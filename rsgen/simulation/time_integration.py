"""Virtual tests by time integration: all points from rest, or sweeps that go on from the last state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.oscillator import Oscillator
from rsgen.simulation.point_grid import Progress, in_parts, swept
from rsgen.simulation.virtual_test import SimulatedTest
from rsgen.steady_state import SteadyStates, solve_steady_states

__all__ = ["integrate"]

Floats = NDArray[np.float64]


def integrate(oscillator: Oscillator, test: SimulatedTest, progress: Progress) -> SteadyStates:
    """Solve the grid of a test, ordered level by level."""

    def solve(force: Floats, frequency: Floats, start: Floats | None = None) -> SteadyStates:
        return solve_steady_states(
            oscillator, force, frequency, harmonics=test.harmonics, accuracy=test.accuracy, start=start
        )

    def go_on(frequency: Floats, last: SteadyStates | None) -> SteadyStates:
        # a motion without bound ends the run; the test engineer starts again from rest
        start = None if last is None else np.where(np.isfinite(last.state), last.state, 0.0)
        return solve(test.level, frequency, start)

    return in_parts(solve, test, progress) if test.sweep == "rest" else swept(go_on, test, progress)
