"""From a virtual test of an oscillator to its response surface, or to the spectra of its records.

The test says what is solved at each level and frequency: force given, x(t + T) = x(t) from rest or from the
last point of a sweep (``steady_state``); force given, harmonic balance, stable or not (``harmonic_balance``);
amplitude or lag given (``controlled``); lines of a multisine (``periodic_response``); a sweep or a decay
(``transients``).
"""

from __future__ import annotations

from dataclasses import replace
from typing import overload

import numpy as np

import rsgen.dynamics  # solves for amplitudes, lags or the lines of multisines, in tests of these
from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError, known_arguments, require
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import Oscillator, refuse_across
from rsgen.data.surface.plausibility import lag_findings
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.harmonic_balance import solve_harmonic_balance
from rsgen.dynamics.settling import ControlledStates, SteadyStates
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.dynamics.transients import HistoryTest
from rsgen.dynamics.virtual_test import (
    MultisineTest,
    Progress,
    SimulatedTest,
    VirtualTest,
    add_noise,
    free_mean_fault,
    grid_of,
    in_parts,
    swept,
)


@overload
def simulate(
    oscillator: Oscillator, test: SimulatedTest | HistoryTest, *, progress: Progress = None
) -> ResponseSurface: ...


@overload
def simulate(
    oscillator: Oscillator, test: MultisineTest, *, progress: Progress = None
) -> MultisineSpectra: ...


@known_arguments
def simulate(
    oscillator: Oscillator, test: SimulatedTest | HistoryTest | MultisineTest, *, progress: Progress = None
) -> ResponseSurface | MultisineSpectra:
    """Run a virtual test: the grid of levels and frequencies, level by level, or the records of another.

    Parameters
    ----------
    progress
        Called with the share that is done, from 0 to 1, on long work.

    Returns
    -------
    ResponseSurface or MultisineSpectra
        Of a multisine its spectra, a record a level and realisation; of sweeps and decays what
        ``rsgen.history`` reads from their records. Else a surface of
        len(level) * len(frequency) points. Points without a steady state of the period of the force are in
        it with their outcome and NaN harmonics. With ``control="response"`` or ``"continuation"`` the levels
        are the amplitudes X [m] that were held, the error is that of the force, and ``stable`` is False
        between folds. With ``control="phase"`` there is a point for each level and lag, at the frequency that
        was found. Of a shaken base the response is relative to it and the force one per mass, -a_b.

    Raises
    ------
    RsgenError
        The test asks for a combination that does not exist, or is to be integrated and no spring holds the
        mean displacement. An element acts across two sensors.
    """
    require(oscillator, Oscillator, "oscillator")
    require(test, VirtualTest, "test")
    refuse_across(oscillator.sensors, simulation=True)
    fault = free_mean_fault(oscillator, test)
    if fault:
        raise RsgenError(f"law: {fault}")
    if isinstance(test, MultisineTest):
        return rsgen.dynamics.simulate_multisine(oscillator, test)
    if isinstance(test, HistoryTest):
        return test.simulated(oscillator, progress)
    return _simulated(test, oscillator, progress)


def _simulated(test: SimulatedTest, oscillator: Oscillator, progress: Progress) -> ResponseSurface:
    """Simulate a test of sines: solve the states at each level and frequency, then add noise."""
    level, frequency = grid_of(test)
    states: SteadyStates
    if test.response_held:
        states = rsgen.dynamics.control_grid(oscillator, test, progress)
    elif test.control == "phase":
        level, frequency, states = rsgen.dynamics.phase_grid(oscillator, test)
    elif test.method == "harmonic-balance":
        states = _balance(oscillator, test, progress)
    else:
        states = _integrate(oscillator, test, progress)
    force = test.drive(oscillator.mass, level, frequency)
    controlled = states if isinstance(states, ControlledStates) else None
    surface = ResponseSurface(
        level=level,
        frequency=frequency,
        force=controlled.force if controlled else force / oscillator.mass if test.base else force,
        harmonics=states.harmonics,
        peak=states.peak,
        sweep=test.sweep,
        outcome=states.outcome,
        residual=states.residual,
        error=states.error,
        origin="simulated",
        control=test.control,
        stable=controlled.stable if controlled else None,
        per_mass=test.base is not None,
        base=test.base or "",
    )
    surface = add_noise(surface, test.noise_relative, test.seed)
    return replace(surface, findings=(*surface.findings, *lag_findings(surface)))


def _integrate(oscillator: Oscillator, test: SimulatedTest, progress: Progress) -> SteadyStates:
    """Solve the grid by time integration: points from rest, or sweeps that go on from the last state."""

    def solve(level: Array, frequency: Array, start: Array | None = None) -> SteadyStates:
        force = test.drive(oscillator.mass, level, frequency)
        return solve_steady_states(
            oscillator, force, frequency, harmonics=test.harmonics, accuracy=test.accuracy, start=start
        )

    def go_on(frequency: Array, last: SteadyStates | None) -> SteadyStates:
        # a motion without bound ends the run; the test engineer starts again from rest
        start = None if last is None else np.where(np.isfinite(last.state), last.state, 0.0)
        return solve(test.level, frequency, start)

    return in_parts(solve, test, progress) if test.sweep == "rest" else swept(go_on, test, progress)


def _balance(oscillator: Oscillator, test: SimulatedTest, progress: Progress) -> SteadyStates:
    """Solve the grid by harmonic balance: points from their linear response, or each from its neighbour.

    Harmonic balance does not separate stable answers from unstable ones.
    """

    def solve(level: Array, frequency: Array, guess: ComplexArray | None = None) -> SteadyStates:
        force = test.drive(oscillator.mass, level, frequency)
        return solve_harmonic_balance(oscillator, force, frequency, harmonics=test.harmonics, guess=guess)

    def go_on(frequency: Array, last: SteadyStates | None) -> SteadyStates:
        if last is None:
            return solve(test.level, frequency)
        near = solve(test.level, frequency, np.where(np.isfinite(last.harmonics), last.harmonics, 0))
        if near.settled.all():
            return near
        # where the branch has ended, from the linear response
        fresh, n = solve(test.level, frequency), len(near)
        return SteadyStates.joined([near, fresh], np.arange(n) + n * ~near.settled)

    return in_parts(solve, test, progress) if test.sweep == "rest" else swept(go_on, test, progress)
