"""A test of sines as a ranking sees it: the reference motion of the best law so far, noise and misfit there.

A law is fitted to the measured points by harmonic balance at the measured amplitudes (``fitting.fit``); its
predicted motions have all harmonics and no noise. Near dry friction a truncated balance is far off, so that
laws with jumps or corners are simulated instead, with the force adjusted until the amplitude is the measured
one. Noise is estimated from the differences between neighbouring points, which no smooth misfit explains.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from math import nan
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.tolerances import (
    ASSUMED_RELATIVE_NOISE,
    BALANCE_HARMONICS,
    BRANCH_DISTANCE,
    FINITE_DIFFERENCE_STEP,
    MAX_TRIAL_STEPS,
    MIN_MISFIT_REDUCTION,
    MIN_RELATIVE_SLOPE,
    MIN_SHARE_PREDICTED,
    MISFIT_NEGLIGIBLE,
    START_HARMONICS,
    SUBSAMPLE_POINTS,
)
from rsgen.data.oscillator import Model, Oscillator, refuse_across
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.identification.fitting.across import law_of
from rsgen.identification.fitting.fit import Fit, fit_balance
from rsgen.identification.fitting.forward import go_on
from rsgen.identification.fitting.observed import (
    Observed,
    Problem,
    beyond_chance,
    constant_mean,
    neighbour_power,
)
from rsgen.identification.fitting.points import Points, mass_needs, select_points
from rsgen.identification.misfit import even_findings
from rsgen.identification.ranking.balance import (
    MAX_MOTION_DISTANCE,
    PointBalance,
    ReferenceMotion,
    measured_rows,
    predicted_motion,
    whiten_balance,
)
from rsgen.identification.ranking.candidate_fit import (
    STRONG_EVIDENCE,
    CandidateFit,
    CandidateLaw,
    Misfit,
    RankedTest,
    Round,
    fit_candidate,
    max_misfits,
    outliers_of,
)
from rsgen.identification.ranking.library_sums import surrogates
from rsgen.identification.soundness import exclusion_findings, held_finding, held_points, nearly_held
from rsgen.identification.starting.equations import Equations
from rsgen.identification.starting.start import records_even, solve_equations, start_even_forces, start_fit
from rsgen.identification.terms import channel_finding, fit_larger_backgrounds, fit_near, simplest_background
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
        return {**self.law.named(self.values), "m": self.mass}

    def rows(self, noise: Array) -> PointBalance:
        """Return the balance for relative noise (H+1,) of mean, fundamental and harmonics."""
        sensors = self.law.parts[-1].sensors
        return whiten_balance(
            self.motion, self.law, self.values, self.mass, noise, balanced=True, sensors=sensors
        )

    def select(self, chosen: NDArray[np.intp]) -> Reference:
        """Keep some of the points chosen."""
        return replace(self, chosen=self.chosen[chosen], motion=self.motion.select(chosen))


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
    if not records_even(problem):
        problem, place = start_even_forces(problem, place)
    found = fit_balance(problem, place, order=BALANCE_HARMONICS, exclude=False, steps=MAX_TRIAL_STEPS)
    found = replace(found, problem=replace(problem, observed=_with_phases(found)))
    simulated = law.rough and not law.acts_across and found.mass > 0
    if simulated and _shared_misfit(found) < MAX_MOTION_DISTANCE:
        exact = _simulated_reference(best, found, fixed)
        if exact is not None:
            return exact
    chosen = np.flatnonzero(_predicted(found))
    if not _enough(chosen, observed.points, law, found.values):
        return None
    part = found.select(chosen)
    if not observed.points.phase_known and feeds_exciter(part.force, part.harmonics[:, 1]):
        return None  # amplitudes do not show the sign of the damping, which is positive
    motion = predicted_motion(part.problem.observed, found.background, part.harmonics, part.force, part.turn)
    if law.acts_across:
        motion = _with_across(motion, part)
    return Reference(chosen, motion, law, found.values, found.mass)


def _with_phases(found: Fit) -> Observed:
    """Return the points of a fit, with the phases that it predicts where none were recorded."""
    observed = found.problem.observed
    if observed.points.phase_known:
        return observed
    return observed.with_phases(found.background, found.harmonics[:, 1], found.force)


def _with_across(motion: ReferenceMotion, found: Fit) -> ReferenceMotion:
    """Add the motion across that a fit followed; harmonics are as measured, of both motions."""
    points, share = found.problem.observed.points, found.problem.law.parts[1].share
    measured = found.problem.observed.mode(found.background).motion.turned(-found.turn).harmonics
    measured[:, 1] = found.harmonics[:, 1]
    far = (points.across - share * points.harmonics)[:, 1] * np.exp(-1j * found.turn)
    return motion.with_across(measured, found.across, share, far)


_TRIMMED_SHARE = 0.2
"""Share of neighbours that is left out at both ends of a trimmed mean."""


def _shared_misfit(found: Fit) -> float:
    """Return the root mean square of the relative misfit of the force that neighbours share, trimmed."""
    points = found.problem.observed.mode(found.background)
    misfit = (points.force * np.exp(-1j * found.turn) - found.force) / np.abs(points.force)
    first, second = misfit[points.neighbours].T
    common = np.sort((first * np.conj(second)).real)
    common = common[np.isfinite(common)]
    # near sticking the truncated balance of some points is far off for any law
    trimmed = int(_TRIMMED_SHARE * len(common))
    common = common[trimmed : len(common) - trimmed]
    return float(np.sqrt(max(float(np.mean(common)), 0.0))) if len(common) else 0.0


def _predicted(found: Fit) -> NDArray[np.bool_]:
    """Return the mask (n,) of the points that a fit predicts."""
    finite = np.isfinite(found.harmonics).all(axis=1) & np.isfinite(found.force)
    return np.asarray(found.regression.used & finite)


def _enough(chosen: NDArray[np.intp], points: Points, law: ForceLaw, values: Array) -> bool:
    """Return True if few points are lost, except those that dry friction nearly holds."""
    moving = ~nearly_held(points, law, values)
    moving[chosen] = True
    needed = max(MIN_SHARE_PREDICTED * np.count_nonzero(moving), len(points) / 2)
    return len(chosen) >= needed


def _simulated_reference(best: CandidateLaw, found: Fit, fixed: Mapping[str, float]) -> Reference | None:
    """Simulate a law with jumps or corners, and improve the law along its simulated motion."""
    reference = _simulate_amplitudes(found.values, found.mass, found.background, found)
    for _ in range(_SIMULATED_FITS):
        if reference is None:
            return None
        noise = np.full(BALANCE_HARMONICS + 1, ASSUMED_RELATIVE_NOISE)
        rows, candidate = reference.rows(noise), replace(best, values=reference.parameters)
        leader = fit_candidate(candidate, rows, fixed)
        if leader.fault or not leader.candidate.values["m"] > 0:
            return reference
        found_values = leader.candidate.values
        values, background = reference.law.ordered(found_values), leader.candidate.background
        again = _simulate_amplitudes(values, found_values["m"], background, found)
        reference = again or reference
    return reference


def _simulate_amplitudes(values: Array, mass: float, background: Array, found: Fit) -> Reference | None:
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
    oscillator = Oscillator(mass, found.problem.elements, law.named(values))

    solve = partial(
        solve_steady_states,
        oscillator,
        frequency=points.omega / (2 * np.pi),
        harmonics=_HARMONICS_OF_ROUGH,
        accuracy=_SIMULATION_TOLERANCE,
        briefly=True,
    )

    try:
        states = solve(drive, start=state)
        state = go_on(states, states.settled, state)
        moved = solve((1 + FINITE_DIFFERENCE_STEP) * drive, start=state)
        # a point that does not settle, or sticks, has no amplitude and keeps its force
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.abs(states.harmonics[:, 1])
            growth = np.log(np.abs(moved.harmonics[:, 1]) / size) / np.log1p(FINITE_DIFFERENCE_STEP)
            step = np.log(wanted / size) / np.where(growth > MIN_RELATIVE_SLOPE, growth, np.inf)
        # a longer step may end on another branch
        step = np.clip(np.nan_to_num(step), -BRANCH_DISTANCE, BRANCH_DISTANCE)
        drive = (drive * np.exp(step)).astype(np.complex128)
        states = solve(drive, start=state)
    except RsgenError:
        return None
    near = np.abs(np.abs(states.harmonics[:, 1]) / wanted - 1) < MAX_MOTION_DISTANCE
    chosen = np.flatnonzero(good & states.settled & near)
    if not _enough(chosen, points, law, values):
        return None
    # turned to a fundamental of phase zero
    lag = np.angle(states.harmonics[chosen, 1])
    harmonics = states.harmonics[chosen] * np.exp(-1j * lag)[:, None] ** np.arange(_HARMONICS_OF_ROUGH + 1)
    drive, turn = drive[chosen] * np.exp(-1j * lag), found.turn[chosen] + lag
    motion = predicted_motion(observed.select(chosen), background, harmonics, drive, turn)
    return Reference(chosen, motion, law, values, mass)


def _neighbour_noise(
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
    rows = np.bincount(orders, compared)
    for power in (total, noise):
        sums = np.bincount(orders, np.where(compared, power, 0.0))
        result.append(np.sqrt(np.divide(sums, rows, out=np.full(len(rows), np.nan), where=rows > 0)))
    return result[0], result[1]


# ----------------------------------------------------------------------------
# Rounds of a ranking along these motions.

_MAX_POINTS = 500
"""Points that separate laws; more of them only narrow intervals."""


@dataclass(frozen=True, slots=True, eq=False)
class PointRound(Round):
    """A round at points of sines.

    Parameters
    ----------
    reference
        The motion, and its points.
    rows
        The balance at noise of that size.
    noises
        (H+1,) relative noise of mean, fundamental (and force) and harmonics.
    test
        The test, of whose points those of the motion are a part.
    """

    rows: PointBalance
    reference: Reference
    noises: Array
    test: PointTest
    counted: ClassVar[str] = "points"

    @property
    def noise(self) -> float:
        """Noise of the fundamental and the force; that of the last round where no points are neighbours."""
        return float(self.noises[1])

    def compared(self, best: CandidateFit) -> NDArray[np.bool_]:
        """Return the mask (n,) of the tested points that a law is compared with."""
        mask = np.zeros(len(self.test.observed.points), dtype=bool)
        mask[self.reference.chosen[~outliers_of(best, self.noises)]] = True
        return mask

    def exclusions(self, best: CandidateFit) -> list[Finding]:
        """Find the points that the best law is not compared with, as its identification does."""
        excluded, law, points = ~self.compared(best), best.candidate.law, self.test.observed.points
        stopped = nearly_held(points, law, law.ordered(best.candidate.values))
        measured, unit = self.test.measured, self.test.level_unit
        found = exclusion_findings(points, excluded, measured, unit, stopped=stopped)
        # whether they speak against the law its identification says, of all points
        chosen = measured > len(points)
        return [
            replace(
                one,
                severity="warning",
                numbers={name: number for name, number in one.numbers.items() if chosen or name != "all"},
                names={"by": "ranking"},
            )
            for one in found
        ]

    def pairs(self, best: CandidateFit) -> NDArray[np.intp]:
        """Return the neighbours that are no outliers of a law."""
        return self.reference.motion.points.pairs(~outliers_of(best, self.noises))

    def without_outliers(self, best: CandidateFit) -> PointRound | None:
        """Exclude the outliers of a law."""
        out = outliers_of(best, self.noises)
        if not out.any():
            return None
        inside = np.flatnonzero(~out)
        left, predict = self.leader.residual[inside], self.leader.predict_levels
        leader = replace(self.leader, residual=left, predict_levels=lambda: predict()[inside])
        reference = self.reference.select(inside)
        return replace(self, reference=reference, rows=self.rows.select(inside), leader=leader)

    def leader_of(self, other: Round) -> tuple[CandidateFit, bool]:
        """Return the leader of another round in units of the noise of this one; large where it loses points.

        With whether its motion is that of its values; those of an even force are else of the motion.
        """
        if not isinstance(other, PointRound):
            return other.leader, True
        fit, settled, values = other.leader, True, other.reference.parameters
        if other.reference.law.even:
            # a linear step gains in vain where the square of the force would have to be negative
            held = fit_candidate(replace(fit.candidate, values=values), other.rows, values)
            settled = held.chi_squared < fit.chi_squared + STRONG_EVIDENCE
            fit = fit if settled else held
        mine, theirs = self.reference.chosen, other.reference.chosen
        count = min(len(self.noises), len(other.noises))
        ratio = np.repeat(other.noises[:count] / self.noises[:count], 2)[1:]
        inside, place = np.isin(mine, theirs), np.isin(theirs, mine)

        # with no fewer points than here it is chance which are lost: there this leader counts for both
        as_many = len(theirs) >= len(mine)

        def move(residual: Array, of_leader: Array) -> Array:
            moved = np.zeros((len(mine), len(self.rows.compared)))
            moved[inside, : len(ratio)] = residual[place, : len(ratio)] * ratio
            moved[~inside] = of_leader[~inside] if as_many else 1 / self.noise
            return moved

        own, predict, of_leader = self.leader, fit.predict_levels, self.leader.predict_levels
        residual = move(fit.residual, own.residual)
        moved = replace(fit, residual=residual, compared=self.rows.compared, unit=own.unit)
        return replace(moved, predict_levels=lambda: move(predict(), of_leader())), settled

    def left_at_common(self, rounds: Sequence[Round]) -> float:
        """Return the relative misfit of the leader at the points that all the rounds have."""
        others = [one.reference.chosen for one in rounds if isinstance(one, PointRound)]
        common = np.isin(self.reference.chosen, reduce(np.intersect1d, others))
        return self.relative(self.leader.residual[common | ~common.any()])

    def relative(self, residual: Array) -> float:
        """Return the root mean square of the compared rows of a residual, relative to force and response."""
        scale = np.repeat(self.noises, 2)[1:]
        return float(np.sqrt(np.mean((residual * scale)[:, self.rows.compared] ** 2)))

    def misfit(self, fitted: CandidateFit) -> Misfit:
        """Return what a law leaves, m^2 = total^2 - noise^2, from the differences of neighbouring points."""
        points, out = self.reference.motion.points, outliers_of(fitted, self.noises)
        pairs = points.pairs(~out)
        total, random = _neighbour_noise(fitted.residual, pairs, fitted.compared)
        shared = np.maximum(total**2 - random**2, 0.0)
        systematic = float(np.sqrt(np.nansum(self.noises**2 * shared)))
        misfit = self.noises * np.sqrt(np.nan_to_num(shared))
        correlation = np.nan_to_num(shared / np.maximum(total**2, 1e-300))
        # real and imaginary part; a mean, and a fundamental without phases, is one number
        counted = np.bincount(np.repeat(np.arange(len(misfit)), 2)[1:], fitted.compared) * len(pairs)
        missing = beyond_chance(correlation, counted) & (misfit > max_misfits(points, len(misfit)))
        others = missing[0] or missing[1::2].any()
        if missing.any() and not others and fitted.candidate.law.odd and self.even_force(fitted) is None:
            # as in an identification: even harmonics that no even force makes are those of the exciter
            missing[:] = False
        unexplained = float(np.sqrt(np.sum(misfit[missing] ** 2)))
        where = {f"harmonic {h}": Quantity(float(misfit[h])) for h in np.flatnonzero(missing).tolist()}
        if missing[0]:
            mean = points.harmonics[:, 0].real
            offset, left = constant_mean(mean[~out], points.amplitude[~out])
            if left < 1 - MIN_MISFIT_REDUCTION:
                where["offset"] = Quantity(offset, "m")
        return Misfit(systematic, unexplained, where, len(pairs) > 0)

    def larger_background(self, best: CandidateFit) -> Finding | None:
        """Find a larger background that explains much of a misfit beyond noise; None if there is none.

        Next to a driven base the ratio of the two channels that explains it comes first.
        """
        fit = self._fit_near(best)
        others, misfit = fit_larger_backgrounds(fit, fit.regression.sigma), fit.regression.rms_misfit
        leaves = {kind: misfit * other.left for kind, other in others.items()}
        off = channel_finding(fit, misfit, (misfit,), leaves, self.test.base)
        if off is not None and "gain" in off.numbers:
            return off
        # with noise no background halves the whole of a small misfit
        systematic = misfit**2 - self.noise**2
        explained = misfit**2 - min(leaves.values(), default=np.inf) ** 2
        if not explained > (1 - (1 - MIN_MISFIT_REDUCTION) ** 2) * systematic > 0:
            return None
        kind = simplest_background(leaves, misfit)
        numbers = quantities(misfit=misfit, left=leaves[kind])
        return Finding("background-missing", "doubt", numbers=numbers, names={"kind": kind})

    def even_force(self, best: CandidateFit) -> Finding | None:
        """Find an even force that a symmetric law lacks, as its identification does."""
        return next(iter(even_findings(self._fit_near(best))), None)

    def _fit_near(self, best: CandidateFit) -> Fit:
        """Fit a law by the balance to the points that it is compared with."""
        own, law = best.candidate, best.candidate.law
        observed = self.test.observed.select(self.compared(best))
        problem = Problem(own.elements, law, observed, self.test.fixed)
        place = problem.join(law.ordered(own.values), own.values["m"], own.background)
        return fit_near(problem, place, order=BALANCE_HARMONICS)


class PointTest(RankedTest):
    """Points of sines: any law is compared with them by force and phase.

    Parameters
    ----------
    surface
        The test, of forces where a mass is known, and without copies of runs.
    base
        A model with observation and mass.
    given
        Laws of the user.
    sensors
        Between which elements act; "" where all follow the response.

    Raises
    ------
    RsgenError
        The test does not determine the mass, or too few points are left.
    """

    def __init__(
        self, surface: ResponseSurface, base: Model, given: Collection[tuple[Element, ...]], sensors: str = ""
    ) -> None:
        points = select_points(surface, base)
        self.means = points.means[: 1 + points.far.shape[1]]
        refuse_across(sensors, phases=not surface.phase_known)
        for elements in given:
            law_of(elements, self.means)
        observed, held = Observed.of(points, base.observation.background), _held(points, base, sensors)
        if held.any():
            self.left_out = held_finding(points, held, surface)
            points, observed = points.select(~held), observed.select(~held)
        self.measured, self.level_unit, self.base = len(points), surface.level_unit, surface.base
        self.observed, self.fixed = observed.select(points.spread(_MAX_POINTS)), base.fixed
        if needed := mass_needs(self.observed.points, base):
            raise RsgenError(f"ranking: the test does not determine the mass; give it, or {needed}")
        seen, background = _start_observed(self.observed, base, given, sensors)
        self._mode = seen.mode(background)
        self.first = measured_rows(seen, background, points.known_values(self.fixed).get("m", nan), sensors)

    def start(self, name: str, elements: tuple[Element, ...]) -> CandidateLaw:
        """Return a law with initial values from the first-order balance."""
        points, candidate = self._mode, CandidateLaw(name, elements, {})
        law = candidate.law
        solution = solve_equations(Equations.along(points, law, 1), law, points.known_values(self.fixed))
        return replace(candidate, values={**law.named(solution.values), "m": solution.mass})

    def along(self, candidate: CandidateLaw, before: Round | None) -> PointRound | None:
        """Fit a law and estimate the noise along its motion; None if it has none near the measured one."""
        reference = fit_reference_motion(self.observed, candidate, self.fixed)
        if reference is None:
            return None
        noise = np.full(len(reference.motion.measured), ASSUMED_RELATIVE_NOISE)
        if isinstance(before, PointRound):
            noise = before.noises
        candidate = replace(candidate, values=reference.parameters)
        for last in (False, False, True):
            rows = reference.rows(noise)
            leader = fit_candidate(candidate, rows, self.fixed)
            if leader.fault or last:
                break
            pairs = reference.motion.points.pairs(~outliers_of(leader, noise))
            _, random = _neighbour_noise(leader.residual, pairs, rows.compared)
            noise = np.maximum(noise * np.where(np.isfinite(random), random, 1.0), MISFIT_NEGLIGIBLE)
        return None if leader.fault else PointRound(rows, leader, reference, noise, self)


def _held(points: Points, base: Model, sensors: str) -> NDArray[np.bool_]:
    """(n,) points that friction holds, by a surrogate of any law with friction; none where few are left."""
    elements = surrogates(sensors)[0]
    problem = Problem(elements, law_of(elements), Observed.of(points, "none"), base.fixed)
    few, noise = points.spread(SUBSAMPLE_POINTS), points.in_noise
    return held_points(problem, start_fit(problem.select(few[~noise[few]]))[1], noise)


def _start_observed(
    observed: Observed, base: Model, given: Collection[tuple[Element, ...]], sensors: str = ""
) -> tuple[Observed, Array]:
    """Return the points, with phases if none were recorded, and an initial background.

    Both are of the best fit among the laws of the user and the surrogates.
    """
    if not observed.background.names and observed.points.phase_known:
        return observed, np.zeros(0)
    laws = [CandidateLaw("", law, {}) for law in surrogates(sensors)]
    if observed.points.phase_known:
        # a linear law would put its misfit into the background
        laws[:0] = [law for elements in given if not (law := CandidateLaw("", elements, {})).linear]
    subsample = observed.select(observed.points.spread(SUBSAMPLE_POINTS))
    fits = [
        fit_balance(*start_fit(Problem(law.elements, law.law, subsample, base.fixed)), order=START_HARMONICS)
        for law in laws
    ]
    best = min(fits, key=lambda found: found.regression.sigma if found.mass > 0 else np.inf)
    if observed.points.phase_known:
        return observed, best.background
    place = best.regression.parameters
    every = fit_balance(replace(best.problem, observed=observed), place, order=START_HARMONICS, steps=1)
    return _with_phases(every), every.background
