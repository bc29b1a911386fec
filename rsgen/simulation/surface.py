"""From a virtual test to its response surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rsgen.errors import RsgenError
from rsgen.oscillator import Oscillator
from rsgen.simulation.harmonic_balance import balance_grid
from rsgen.simulation.noise import add_noise
from rsgen.simulation.test import SimulatedTest
from rsgen.simulation.time_integration import integrate
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
        it with their outcome and NaN harmonics.

    Raises
    ------
    RsgenError
        The test asks for a combination that does not exist.
    """
    if test.control == "response":
        raise RsgenError("test.control: 'response' is not there yet")
    solve = balance_grid if test.method == "harmonic-balance" else integrate
    states = solve(oscillator, test, progress)
    level = np.repeat(test.level, len(test.frequency))
    surface = ResponseSurface(
        level=level,
        frequency=np.tile(test.frequency, len(test.level)),
        force=level.astype(np.complex128),
        harmonics=states.harmonics,
        peak=states.peak,
        sweep=np.full(len(level), test.sweep),
        outcome=states.outcome,
        residual=states.residual,
        error=states.error,
        origin="simulated",
    )
    return add_noise(surface, test.noise_relative, test.seed)
