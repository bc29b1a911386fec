"""The reference motion, along which candidates are compared: that of the best law so far.

A law is fitted to the measured points by harmonic balance at the measured amplitudes (``fitting.fit``); its
predicted motions have all harmonics and no noise. Near dry friction a truncated balance is far off, so that
laws with jumps or corners are simulated instead, with the force adjusted until the amplitude is the measured
one. Noise is estimated from the differences between neighbouring points, which no smooth misfit explains.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import (
    ASSUMED_RELATIVE_NOISE,
    BALANCE_HARMONICS,
    BRANCH_DISTANCE,
    FINITE_DIFFERENCE_STEP,
    MAX_SHARE_OF_OUTLIERS,
    MAX_SHARE_OF_OUTLIERS_BY_CHANCE,
    MAX_TRIAL_STEPS,
    MIN_RELATIVE_SLOPE,
    MISFIT_NEGLIGIBLE,
    OUTLIER_SIGMAS,
)
from rsgen.data.free_mode import fit_mode, steady
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.settling import SteadyStates
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.identification.fitting.fit import Fit, fit_balance
from rsgen.identification.fitting.observed import Observed, Problem, neighbour_power
from rsgen.identification.fitting.simulator import go_on
from rsgen.identification.ranking.balance import (
    MAX_MOTION_DISTANCE,
    ReferenceMotion,
    WhitenedBalance,
    measured_motion,
    predicted_motion,
    whiten_balance,
)
from rsgen.identification.ranking.candidate_fit import CandidateFit, CandidateLaw, fit_candidate
from rsgen.law.element import Element
from rsgen.law.motion import Motion, feeds_exciter
from rsgen.law.numeric import ForceLaw

_HARMONICS_OF_ROUGH = 31
"""Harmonics of the waveform along which laws with jumps and corners are compared."""

_SIMULATION_TOLERANCE = 3e-5
"""Relative error of the simulated amplitude, below the least noise of a ranking."""

_MAX_SECOND_TO_FIRST = 0.7
"""Second differences smaller than this share of the first ones measure the noise better."""

_SIMULATED_FITS = 2
"""Fits along the simulated motion, which is simulated anew after each."""


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The motions of a law at the points where it has a steady state near the measured one.

    Parameters
    ----------
    chosen
        Indices of these points.
    motion
        The predicted motions.
    law, values, mass
        The law.
    """

    chosen: NDArray[np.intp]
    motion: ReferenceMotion
    law: ForceLaw
    values: Array
    mass: float

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the law by name; the mass is "m"."""
        return {**dict(zip(self.law.parameters, self.values.tolist(), strict=True)), "m": self.mass}

    def rows(self, noise: Array) -> WhitenedBalance:
        """Return the balance for relative noise (H+1,) of mean, fundamental and harmonics."""
        return whiten_balance(self.motion, self.law, self.values, self.mass, noise, balanced=True)

    def select(self, chosen: NDArray[np.intp]) -> Reference:
        """Keep some of the points chosen."""
        return replace(self, chosen=self.chosen[chosen], motion=self.motion.select(chosen))

    @property
    def feeds_exciter(self) -> bool:
        """True if the structure feeds energy into the exciter."""
        return feeds_exciter(self.motion.force, self.motion.harmonics[:, 1])


def first_rows(observed: Observed, background: Array, law: ForceLaw, mass: float) -> WhitenedBalance:
    """Return a first-order balance about the measured motion.

    Parameters
    ----------
    observed, background
        The measured points, and a background to start from.
    law
        The base, ``c*v + k*x``.
    mass
        Mass [kg]; NaN if it is free.
    """
    motion = measured_motion(observed, background)
    points = observed.points
    balance = steady(motion.force, motion.harmonics[:, 1], points.omega)
    found = fit_mode(*balance, np.ones((len(points), 1)), 1 / np.abs(motion.force), mass=mass)
    return whiten_balance(motion, law, found.values[[1, 0]], found.mass, np.ones(2), balanced=False)


def fit_reference_motion(
    observed: Observed, best: CandidateLaw, fixed: Mapping[str, float]
) -> Reference | None:
    """Fit a candidate and its background to the measured waveforms.

    Parameters
    ----------
    observed
        The measured points.
    best
        The candidate, and the background to start from.
    fixed
        Names of parameters that keep their values.

    Returns
    -------
    Reference or None
        None if the candidate has no steady states near the measured ones.
    """
    law = best.law
    values = law.ordered(best.values)
    problem = Problem(best.elements, law, observed, fixed)
    place = problem.join(values, best.values["m"], best.background)
    found = fit_balance(problem, place, order=BALANCE_HARMONICS, exclude=False, steps=MAX_TRIAL_STEPS)
    if law.rough and found.mass > 0 and _shared_misfit(found) < MAX_MOTION_DISTANCE:
        exact = _simulated_reference(best, found, fixed)
        if exact is not None:
            return exact
    chosen = np.flatnonzero(_predicted(found))
    if len(chosen) < (1 - MAX_SHARE_OF_OUTLIERS) * len(found.force):
        return None
    part = found.select(chosen)
    motion = predicted_motion(part.problem.observed, found.background, part.harmonics, part.force, part.turn)
    return Reference(chosen, motion, law, found.values, found.mass)


def _shared_misfit(found: Fit) -> float:
    """Return the root mean square of the relative misfit of the force that neighbours share, trimmed."""
    points = found.problem.observed.mode(found.background)
    misfit = (points.force * np.exp(-1j * found.turn) - found.force) / np.abs(points.force)
    first, second = misfit[points.neighbours].T
    common = np.sort((first * np.conj(second)).real)
    common = common[np.isfinite(common)]
    # near sticking the truncated balance of some points is far off for any law
    trimmed = int(MAX_SHARE_OF_OUTLIERS * len(common))
    common = common[trimmed : len(common) - trimmed]
    return float(np.sqrt(max(float(np.mean(common)), 0.0))) if len(common) else 0.0


def _predicted(found: Fit) -> NDArray[np.bool_]:
    """Return the mask (n,) of the points that a fit predicts."""
    return np.asarray(
        found.regression.used & np.isfinite(found.harmonics).all(axis=1) & np.isfinite(found.force)
    )


def _simulated_reference(best: CandidateLaw, found: Fit, fixed: Mapping[str, float]) -> Reference | None:
    """Simulate a law with jumps or corners, and improve the law along its simulated motion."""
    level = found.problem.observed.points.level
    reference = _simulate_amplitudes(best.elements, found.values, found.mass, found.background, found)
    for _ in range(_SIMULATED_FITS):
        if reference is None:
            return None
        noise = np.full(BALANCE_HARMONICS + 1, ASSUMED_RELATIVE_NOISE)
        rows, inside = reference.rows(noise), reference.chosen
        candidate = replace(best, values=reference.parameters)
        leader = fit_candidate(candidate, rows, level[inside], fixed)
        out = None if leader is None else outliers_of(leader, noise)
        if out is not None and out.any():
            agreeing = np.flatnonzero(~out)
            leader = fit_candidate(candidate, rows.select(agreeing), level[inside[agreeing]], fixed)
        if leader is None:
            return reference
        values = reference.law.ordered(leader.candidate.values)
        inertia = leader.candidate.values["m"]
        reference = (
            _simulate_amplitudes(best.elements, values, inertia, leader.candidate.background, found)
            or reference
        )
    return reference


def _simulate_amplitudes(
    elements: tuple[Element, ...], values: Array, mass: float, background: Array, found: Fit
) -> Reference | None:
    """Simulate the points with the force that gives the measured amplitude; None if too few have one.

    The truncated balance only gives the initial state: near sticking its amplitude is far off.
    """
    law, observed = found.problem.law, found.problem.observed
    points = observed.mode(background)
    good = _predicted(found)
    wanted = points.amplitude
    drive: ComplexArray = points.force * np.exp(-1j * np.where(good, found.turn, 0.0))
    state = Motion(points.omega, found.harmonics).states()
    state[~good] = 0
    oscillator = Oscillator(mass, elements, dict(zip(law.parameters, values.tolist(), strict=True)))

    def solve(force: ComplexArray, start: Array) -> SteadyStates:
        return solve_steady_states(
            oscillator,
            force,
            points.omega / (2 * np.pi),
            harmonics=_HARMONICS_OF_ROUGH,
            accuracy=_SIMULATION_TOLERANCE,
            start=start,
        )

    try:
        states = solve(drive, state)
        state = go_on(states, states.settled, state)
        moved = solve((1 + FINITE_DIFFERENCE_STEP) * drive, state)
        # a point that does not settle, or sticks, has no amplitude and keeps its force
        with np.errstate(divide="ignore", invalid="ignore"):
            growth = np.log(np.abs(moved.harmonics[:, 1] / states.harmonics[:, 1])) / np.log1p(
                FINITE_DIFFERENCE_STEP
            )
            step = np.log(wanted / np.abs(states.harmonics[:, 1])) / np.where(
                growth > MIN_RELATIVE_SLOPE, growth, np.inf
            )
        # a longer step may end on another branch
        drive = drive * np.exp(np.clip(np.nan_to_num(step), -BRANCH_DISTANCE, BRANCH_DISTANCE)).astype(
            np.complex128
        )
        states = solve(drive, state)
    except RsgenError:
        return None
    near = np.abs(np.abs(states.harmonics[:, 1]) / wanted - 1) < MAX_MOTION_DISTANCE
    chosen = np.flatnonzero(good & states.settled & near)
    if len(chosen) < (1 - MAX_SHARE_OF_OUTLIERS) * len(points):
        return None
    # turned to a fundamental of phase zero
    lag = np.angle(states.harmonics[chosen, 1])
    harmonics = states.harmonics[chosen] * np.exp(-1j * lag)[:, None] ** np.arange(_HARMONICS_OF_ROUGH + 1)
    drive, turn = drive[chosen] * np.exp(-1j * lag), found.turn[chosen] + lag
    motion = predicted_motion(observed.select(chosen), background, harmonics, drive, turn)
    return Reference(chosen, motion, law, values, mass)


def outliers_of(fitted: CandidateFit, noise: Array) -> NDArray[np.bool_]:
    """Return the mask (n,) of a few points with far larger residuals than the others; False if they are many.

    A few outliers are spikes, or motions that the simulation misses, and no fault of the law.
    """
    size = np.abs(fitted.residual[:, fitted.compared])
    least = (MISFIT_NEGLIGIBLE / np.repeat(noise, 2)[1:])[fitted.compared]
    # the median of a normal deviate's size is 0.6745
    out = np.asarray(
        (size > OUTLIER_SIGMAS * np.maximum(np.median(size, axis=0) / 0.6745, least)).any(axis=1)
    )
    return out if np.mean(out) <= MAX_SHARE_OF_OUTLIERS_BY_CHANCE else np.zeros_like(out)


def neighbour_noise(
    residual: Array, pairs: NDArray[np.intp], compared: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return root mean squares (H+1,) of the residual of each harmonic: all, and the part that is noise.

    Neighbours in frequency of one run share the misfit of a law, but not noise, so that half their mean
    square difference is noise. Where second differences are clearly smaller than first ones, the grid is
    coarse for the misfit, and a sixth of their mean square is noise. NaN without neighbours.
    """
    if not len(pairs):
        unknown = np.full((residual.shape[1] + 1) // 2, np.nan)
        return unknown, unknown
    total, shared = neighbour_power(residual, pairs)
    noise = total - shared
    inner = np.flatnonzero(pairs[:-1, 1] == pairs[1:, 0])
    if len(inner):
        left, middle, right = (residual[rows] for rows in (*pairs[inner].T, pairs[inner + 1, 1]))
        second = np.mean((left - 2 * middle + right) ** 2, axis=0) / 6
        noise = np.where(second < _MAX_SECOND_TO_FIRST * noise, second, noise)
    orders = np.repeat(np.arange((residual.shape[1] + 1) // 2), 2)[1:]
    result = []
    for power in (total, noise):
        power = np.where(compared, power, np.nan)
        result.append(np.sqrt([np.mean(power[orders == h]) for h in range(orders[-1] + 1)]))
    return result[0], result[1]
