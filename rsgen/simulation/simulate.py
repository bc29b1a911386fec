"""From a virtual test to its response surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rsgen.oscillator import Oscillator
from rsgen.simulation.harmonic_balance import balance_grid
from rsgen.simulation.noise import add_noise
from rsgen.simulation.response_control import ControlledStates, control_grid
from rsgen.simulation.time_integration import integrate
from rsgen.simulation.virtual_test import SimulatedTest
from rsgen.steady_state import SteadyStates
from rsgen.surface import ResponseSurface

__all__ = ["simulate"]


def simulate(
    oscillator: Oscillator, test: SimulatedTest, *, progress: Callable[[float], None] | None = None
) -> ResponseSurface:
    """Run a virtual test: the grid of levels and frequencies, level by level.

    Parameters
    ----------
    oscillator
        The structure.
    test
        Levels, frequencies, sweep, accuracy, noise and method.
    progress
        Called with the share that is done, from 0 to 1, on long work.

    Returns
    -------
    ResponseSurface
        len(level) * len(frequency) points. Points without a steady state of the period of the force are in
        it with their outcome and NaN harmonics. With ``control="response"`` the levels are the amplitudes
        X [m] that were held, the error is that of the force, and ``stable`` tells the branches between folds.

    Raises
    ------
    RsgenError
        The test asks for a combination that does not exist.
    """
    level = np.repeat(test.level, len(test.frequency))
    frequency = np.tile(test.frequency, len(test.level))
    states: SteadyStates | ControlledStates
    stable = None
    if test.control == "force":
        solve = balance_grid if test.method == "harmonic-balance" else integrate
        states, force = solve(oscillator, test, progress), level.astype(np.complex128)
    else:
        states = control_grid(oscillator, test, progress)
        force, stable = states.force, states.stable
    surface = ResponseSurface(
        level=level,
        frequency=frequency,
        force=force,
        harmonics=states.harmonics,
        peak=states.peak,
        sweep=test.sweep,
        outcome=states.outcome,
        residual=states.residual,
        error=states.error,
        origin="simulated",
        control=test.control,
        stable=stable,
    )
    return add_noise(surface, test.noise_relative, test.seed)
