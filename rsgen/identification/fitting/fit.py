"""The one fit: values p of a law, mass and background, with errors in force and response of every point.

Force and response of a point j are both noisy, so that its true amplitude and time origin n_j are unknowns,
too (errors in variables: Britt and Luecke, Technometrics 15 (1973)):

    minimise over p, n_1, n_2, ...:  sum_j |r_j(p, n_j)|^2,

with r_j the differences of measured and predicted force and harmonics over their noise. ``forward`` predicts
them: the harmonic balance is asked for the force at an amplitude, the simulator for the response to a force.
Gauss-Newton steps eliminate each n_j before they solve for p: a test has many points and few values.

``fit_balance``:

1. Plain differences, which converge from far; outliers are excluded. Without phases logarithms are taken from
   the first step. One step is enough from a fit that is ``near``, but only where its misfit is noise and the
   law has neither jump nor corner, since step 4 follows; else all steps are taken.
2. Across two sensors, where the misfit has a pattern: again, with sensors whose errors are correlated.
3. A law with switches, at first order (one step) or in nearly exact data, unless a single step was asked
   for: again, with more samples a period.
4. A misfit above that of exact data (``MISFIT_OF_NOISE``) and a law without jump or corner: again, beginning
   with the same points, by logarithms of the ratios, whose errors have one size at all amplitudes, and the
   bias of second order in the noise is subtracted. Other laws keep the plain differences.

``fit_simulator`` does the last step with the steady states of the simulator, whose derivatives are renewed a
few times only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray, take_rows
from rsgen.common.tolerances import (
    BALANCE_HARMONICS,
    MAX_LINEAR_CHANGE,
    MAX_NEWTON_STEPS,
    MIN_GAIN_OF_STEP,
    MIN_NULL_COMPONENT,
    MISFIT_DOUBTFUL_PATTERN_UNSEEN,
    MISFIT_NEGLIGIBLE,
    MISFIT_OF_NOISE,
    NEAR_STEPS,
    OUTLIER_SIGMAS,
    RELATIVE_CHANGE_NEGLIGIBLE,
    RELATIVE_ERROR_DOUBTFUL,
    SAMPLES_PER_PERIOD,
    SAMPLES_PER_PERIOD_SWITCHED,
    STANDARD_ERRORS_OF_DIFFERENCE,
    is_significant,
)
from rsgen.identification.fitting.across import MeasuredAcross, across_of_mode, law_of
from rsgen.identification.fitting.forward import ErrorsInVariables, HarmonicBalance, Simulator
from rsgen.identification.fitting.least_squares import Regression, Rules, eliminate, fit, summarise
from rsgen.identification.fitting.observed import Problem, is_systematic
from rsgen.identification.fitting.points import Points
from rsgen.law.motion import Motion, sine_motion

_MIN_SHARE_FOLLOWED = 0.5
"""Share of the points that must be predicted on the measured branch; where fewer are, the start is wrong."""

_RESOLUTION = 5.0
"""A misfit up to this many times the simulator's accuracy is the simulator's."""

_STEPS_KEPT, _RENEWALS = 6, 4
"""Gauss-Newton steps with the same derivatives by the simulator, and times that these are taken anew."""

_MAX_SHARE_PASSED_LATE = 0.2
"""Share of points that a sweep may pass late where the law loses its symmetry; beyond it the law is wrong."""

_WORTH = 0.99
"""Of simulated rounds one that leaves more of the misfit was the last: the rest is the simulator's."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Values of a law and their errors.

    Parameters
    ----------
    values, mass
        (p,) of the law, and m [kg].
    covariance
        (p + 1, p + 1) of the values, then of the mass; zero where one is fixed.
    freedom
        Degrees of freedom of the noise that the covariance rests on; (p + 1,) where they differ.
    sigma
        Root mean square misfit of the equations, each a real or an imaginary part, relative to the force.
    converged
        False for a refined fit whose steps ended before the least sum of squares, where the covariance holds.
    """

    values: Array
    mass: float
    covariance: Array
    freedom: int | Array
    sigma: float
    converged: bool = True

    @classmethod
    def of(cls, found: Regression, *, converged: bool = True) -> Solution:
        """Return the parameters (q,) of a regression, of which the mass is the last."""
        values, mass = found.parameters[:-1], float(found.parameters[-1])
        return cls(values, mass, found.covariance, found.error_freedom, found.sigma, converged)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A fit to every point.

    Parameters
    ----------
    problem
        What was fitted.
    regression
        Its parameters are those of the problem; its influence is that of relative deviations.
    force, harmonics
        (n,) [N] and (n, H+1) [m]: predicted, of the mode, relative to a fundamental of phase zero.
    turn
        (n,) phase of the true fundamental [rad]; harmonic h is the predicted one times exp(i h turn).
    scale
        (n,) amplitude of the fundamental that the sensor sees [m].
    order
        Highest harmonic of the balance; those beyond are zero.
    across
        (n, H+1) the motion across two sensors that the law followed [m], relative as ``harmonics``; (n, 0)
        without one.
    shared
        True if the two sensors share the misfit, because with noise of their own its pattern was seen.
    """

    problem: Problem
    regression: Regression
    force: ComplexArray
    harmonics: ComplexArray
    turn: Array
    scale: Array
    order: int
    across: ComplexArray
    shared: bool = False

    @property
    def values(self) -> Array:
        """(p,) of the law."""
        return self.problem.split(self.regression.parameters)[0]

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return self.problem.split(self.regression.parameters)[1]

    @property
    def background(self) -> Array:
        """(b,) values of the background; the phase, which comes first, within half a turn of 0."""
        values = np.array(self.problem.split(self.regression.parameters)[2])
        values[:1] -= 2 * np.pi * np.round(values[:1] / (2 * np.pi))
        return values

    @property
    def solution(self) -> Solution:
        """Of the law, the errors that the background causes included."""
        return Solution.of(self.regression.first(self.problem.count))

    @property
    def systematic(self) -> bool:
        """True if the misfit is correlated between neighbours in frequency, as that of noise is not.

        Where the sensors share it, noise of their difference is in what is left, and hides its pattern.
        """
        found = self.regression
        pairs = self.problem.observed.points.pairs(found.used)
        return self.shared or is_systematic(found.residual, pairs)

    @property
    def hidden_by_noise(self) -> NDArray[np.bool_]:
        """True (p,) of the law where errors exceed values, if they do for a nonlinear one and a factor.

        A nonlinear value alone may be zero, as the gap of a stop; with the factor of its term it is unknown.
        """
        law, found = self.problem.law, self.regression
        # the error of what the points do not determine is no number
        known = is_significant(found.parameters, np.sqrt(np.diag(found.covariance)))
        hidden = (found.free & ~known)[: len(law.parameters)]
        both = hidden[list(law.nonlinear)].any() and hidden[list(law.linear)].any()
        return np.asarray(hidden & both)

    @property
    def motion(self) -> Motion:
        """Predicted, of the mode, in the phase that was measured."""
        return Motion(self.problem.observed.points.omega, self.harmonics).turned(self.turn)

    @property
    def symmetry_broken(self) -> NDArray[np.bool_]:
        """True (n,) where even harmonics are those of a symmetric law, whose motion is not symmetric.

        They begin and end where it loses its symmetry (a pitchfork; Parlitz and Lauterborn 1985, Physics
        Letters A 107, 351); a sweep passes both late. So neighbours with even harmonics belong together, and
        the law explains those of all where it has them at one. Those of a force that has even harmonics are
        driven.
        """
        points = self.problem.observed.points
        force = np.zeros((len(points), 2)) if points.load is None else points.load
        recorded, own, driven = (
            np.abs(h[:, 0:3:2]).max(axis=1) > RELATIVE_CHANGE_NEGLIGIBLE * np.abs(h[:, 1])
            for h in (points.harmonics, self.harmonics, force)
        )
        recorded &= ~driven
        broken = np.zeros(len(points), dtype=bool)
        for run in points.runs:
            for part in np.split(run, np.flatnonzero(~recorded[run])):
                broken[part] = recorded[part] & (recorded & own)[part].any()
        return broken

    @property
    def passed_late(self) -> NDArray[np.bool_]:
        """True (n,) where a sweep, near where the law loses its symmetry, has not its second harmonic.

        Near a pitchfork even harmonics grow and decay ever more slowly: in a sweep they are not steady.
        """
        points = self.problem.observed.points
        late = np.zeros(len(points), dtype=bool)
        compared = min(points.harmonics.shape[1] - 1, self.order) > 1
        if compared and points.overlapping and law_of(self.problem.elements).odd:
            distance = np.abs(np.abs(points.harmonics[:, 2]) - np.abs(self.harmonics[:, 2]))
            late = self.symmetry_broken & (distance > RELATIVE_CHANGE_NEGLIGIBLE * points.amplitude)
        return late & (np.mean(late) < _MAX_SHARE_PASSED_LATE)

    @property
    def beyond_fold(self) -> NDArray[np.bool_]:
        """True (n,) where the law has the measured force, but no steady state on this branch holds it.

        Where the force of an exciter falls as the motion grows, the motion stays beyond a fold of the curve
        at one force, or so near to it that noise of the force leads beyond.
        """
        lost = np.isnan(self.regression.misfit)
        if self.problem.law.acts_across or not lost.any():
            return np.zeros_like(lost)
        points = self.problem.observed.mode(self.background)
        forward = _forward(self.problem, self.regression.parameters, points, BALANCE_HARMONICS)
        at = forward(self.values, self.mass, points.amplitude)
        size, seen = np.abs(at.force), points.force / points.harmonics[:, 1] * points.amplitude
        # of a law that misses by far no point is near
        most = min(OUTLIER_SIGMAS * self.regression.sigma, RELATIVE_ERROR_DOUBTFUL)
        near = np.abs(at.force - seen) < most * size
        at_fold = (np.conj(at.force) * at.force_slope).real < MAX_LINEAR_CHANGE * size**2
        return lost & at.valid & near & at_fold

    def select(self, chosen: NDArray[np.intp]) -> Fit:
        """Take some of the points; what was found from all stays."""
        of_regression = ("nuisance", "misfit", "used", "influence", "rows", "residual")
        part = {name: getattr(self.regression, name)[chosen] for name in of_regression}
        regression = replace(self.regression, **part)
        return replace(take_rows(self, chosen), problem=self.problem.select(chosen), regression=regression)


def _finish(
    problem: Problem, descent: ErrorsInVariables, regression: Regression, order: int, *, shared: bool = False
) -> Fit:
    """Predict at the estimate, relative to a fundamental of phase zero."""
    response = descent.predict(regression.parameters, regression.nuisance)
    lag = np.angle(response.harmonics[:, 1])
    values = problem.split(regression.parameters)[2]
    turn = problem.observed.turn(regression.nuisance) + lag
    size = np.abs(response.harmonics[:, 1])
    regression = _at_held_amplitudes(regression, descent, problem, problem.observed.nuisances(size, turn))
    regression = descent.of_deviations(regression)
    motion = Motion(problem.observed.points.omega, response.harmonics).turned(-lag)
    across = motion.harmonics[:, :0] if response.across is None else response.across
    return Fit(
        problem,
        regression,
        response.force * np.exp(-1j * lag),
        motion.harmonics,
        turn,
        np.abs(problem.observed.predict_sensor(response, values)),
        order,
        across,
        shared,
    )


def _at_held_amplitudes(
    found: Regression, descent: ErrorsInVariables, problem: Problem, nuisance: Array
) -> Regression:
    """Return a fit with the errors and null vectors of the amplitudes that the levels of a test held.

    One amplitude has one k and one c, whatever the law has. Where that of a level varies by its noise alone,
    slopes at its noisy copies seem to tell how the law goes on beyond it; so do harmonics of the motion that
    were not measured. ``nuisance`` is that of a balance at the predicted motions.
    """
    held = problem.observed.points.held(STANDARD_ERRORS_OF_DIFFERENCE * found.sigma, found.used)
    balanced = not isinstance(descent.forward, Simulator)
    if np.isnan(held).all() or problem.law.acts_across or not (balanced or not descent.compared):
        return found
    nuisance[:, 0] = np.where(np.isnan(held), nuisance[:, 0], np.log(held))
    mode = problem.observed.mode(problem.split(found.parameters)[2])
    alone = descent
    if not descent.compared:
        alone = ErrorsInVariables(problem, _forward(problem, found.parameters, mode, 1))
        alone.scale = descent.scale
    line = replace(alone.linearise(found.parameters, nuisance), residual=found.residual)
    place = found.parameters, found.nuisance, _rules(problem, mode), found.used
    there = summarise(line, *place, converged=found.converged)
    return replace(there, misfit=found.misfit, noise_share=found.noise_share)


def fit_balance(
    problem: Problem,
    parameters: Array,
    *,
    order: int,
    compared: int = 0,
    exclude: bool = True,
    steps: int = MAX_NEWTON_STEPS,
    correct: bool = True,
    near: float = 0.0,
) -> Fit:
    """Fit by harmonic balance to all points at once.

    Parameters
    ----------
    problem, parameters
        What is fitted, and where to start.
    order
        Harmonics carried in the balance; 1 is first order.
    compared
        Order up to which measured harmonics are compared. Those above ``order`` are predicted to be zero.
        0: up to ``order``.
    exclude, steps
        True if outliers are excluded; most Gauss-Newton steps.
    correct
        Whether the bias of the square of the noise is removed: not from a misfit that is no noise. False for
        starts, and fits of some points, whose values are not stated.
    near
        Misfit of the fit to some of these points that gave the parameters; 0 where they come from elsewhere.
        Where it is noise, and the law not rough, one step by plain differences leads near enough to compare
        by logarithms.
    """
    observed, law = problem.observed, problem.law
    mode = observed.mode(problem.split(parameters)[2])
    nuisance = observed.nuisances(mode.amplitude, np.angle(mode.harmonics[:, 1]))
    forward = _forward(problem, parameters, mode, order, compared=compared)
    descent = ErrorsInVariables(problem, forward)
    natural = 0.0 if law.odd else _natural_sizes(problem, parameters, mode)
    rules = _rules(problem, mode, steps=steps, natural=natural)
    fitted = partial(fit, descent.linearise, exclude=exclude, neighbours=mode.neighbours)
    plain = replace(rules, steps=1) if near > MISFIT_OF_NOISE and not law.rough else rules
    found = fitted(parameters, nuisance, plain)
    shared = False
    if isinstance(forward, MeasuredAcross) and is_systematic(found.residual, mode.pairs(found.used)):
        shared = True
        # independent sensors would absorb a misfit of the law
        forward.correlation = 1 - MISFIT_NEGLIGIBLE**2
        found = fitted(found.parameters, nuisance, rules)
    # few samples falsify a law with switches: at first order, or in nearly exact data
    few = law.switched and forward.samples < SAMPLES_PER_PERIOD_SWITCHED
    if few and steps > 1 and (order == 1 or found.sigma < MISFIT_NEGLIGIBLE):
        forward.samples = SAMPLES_PER_PERIOD_SWITCHED
        more = replace(rules, steps=1 if order == 1 else steps)
        found = fitted(found.parameters, found.nuisance, more)
    # second derivatives of a balance of few harmonics mean nothing where the law jumps or has a corner
    if found.sigma > MISFIT_OF_NOISE and not law.rough:
        response = descent.predict(found.parameters, found.nuisance)
        descent.scale = np.abs(observed.predict_sensor(response, problem.split(found.parameters)[2]))
        found = fitted(found.parameters, found.nuisance, rules, used=found.used)
        if correct:
            found = descent.corrected(found)
    elif found.sigma > MISFIT_OF_NOISE and law.acts_across:
        # no value is corrected, but ``noise_share``, from which ``noise-across`` follows, is computed
        found = replace(found, noise_share=descent.corrected(found).noise_share)
    return _finish(problem, descent, found, order, shared=shared)


def _rules(problem: Problem, mode: Points, **control: Any) -> Rules:
    """Return the rules of a descent for what a problem knows of its parameters and points."""
    rules = Rules(frozen=problem.frozen, free=problem.free, record=mode.record, **{"noise": 0.0} | control)
    return rules.knowing(problem.count - 1, problem.observed.points.weighed, problem.fixed.get("m", nan))


def linearise_extended(
    found: Fit, problem: Problem, parameters: Array, *, order: int = 0
) -> tuple[Array, Array]:
    """Residual (k, M) of a fit, and slopes (k, M, q) of a problem with more parameters, at the k points used.

    Slopes are those of a balance of an order, without one of that of the fit up to ``BALANCE_HARMONICS``; the
    residual is that of the fit, whose waveforms may have more harmonics. The unknowns of each point are
    eliminated.
    """
    observed = problem.observed
    mode = observed.mode(problem.split(parameters)[2])
    # a term of value zero moves nothing: the balance begins where that of the fit ended
    phase, solved = np.angle(mode.harmonics[:, 1]), np.isfinite(found.harmonics).all(axis=1, keepdims=True)
    near = Motion(mode.omega, np.where(solved, found.harmonics, 0.0)).turned(phase)
    order, compared = (order, order) if order else (min(found.order, BALANCE_HARMONICS), BALANCE_HARMONICS)
    forward = _forward(problem, parameters, mode, order, near, compared)
    if found.problem.law.switched:
        forward.samples = max(forward.samples, SAMPLES_PER_PERIOD_SWITCHED)
    descent = ErrorsInVariables(problem, forward)
    descent.scale = found.scale
    size = np.abs(found.harmonics[:, 1])
    nuisance = observed.nuisances(np.where(size > 0, size, mode.amplitude), found.turn)
    nuisance[:, 2:] = found.regression.nuisance[:, 2:]
    response = descent.predict(parameters, nuisance)
    harmonics, count = np.zeros_like(response.harmonics), found.harmonics.shape[1]
    harmonics[:, :count] = found.harmonics[:, : harmonics.shape[1]]
    line = descent.linearise(parameters, nuisance, replace(response, force=found.force, harmonics=harmonics))
    good = found.regression.used & np.isfinite(line.residual).all(axis=1)
    good &= np.isfinite(line.by_parameter).all(axis=(1, 2))
    residual, matrix = eliminate(line)
    return residual[good], matrix[good]


def refit_weighted(
    near: Fit,
    problem: Problem,
    parameters: Array,
    nuisance: Array,
    *,
    order: int,
    gain: float = MIN_GAIN_OF_STEP,
) -> Regression:
    """Fit by harmonic balance with the weights of a fit that is near, so that sums of squares compare.

    Parameters
    ----------
    near
        A fit of the same points by a balance of the same order.
    problem, parameters, nuisance
        What is fitted, and where to start.
    order
        Harmonics carried in the balance.
    gain
        Decrease of the sum of squares, in units of the noise, below which a step is the last.
    """
    mode = problem.observed.mode(problem.split(parameters)[2])
    descent = ErrorsInVariables(problem, _forward(problem, parameters, mode, order))
    descent.scale = near.scale
    rules = _rules(problem, mode, steps=NEAR_STEPS, gain=gain, noise=near.regression.rules.noise)
    return fit(descent.linearise, parameters, nuisance, rules, exclude=False)


def _forward(
    problem: Problem,
    parameters: Array,
    mode: Points,
    order: int,
    near: Motion | None = None,
    compared: int = 0,
) -> HarmonicBalance | MeasuredAcross:
    """Balance of all harmonics at the response; across two sensors the one along the measured motion.

    The balance begins ``near`` a motion of the phase that was measured, or with what was measured.
    """
    if problem.law.acts_across:
        seen, sensors = problem.observed.points, problem.law.parts[1].sensors
        across = across_of_mode(seen.harmonics, seen.across, mode.harmonics, sensors)
        return MeasuredAcross(problem.law, mode.motion, Motion(mode.omega, across))
    about_rest, load = 0 not in mode.measured, mode.load
    if load is not None:
        # the phase error between force and response turns every harmonic
        turn = problem.observed.background.turn(problem.split(parameters)[2])
        load = load * (turn ** np.arange(load.shape[1]))
    start = mode.motion if near is None else near
    return HarmonicBalance(problem.law, start, order, compared=compared, about_rest=about_rest, load=load)


def fit_simulator(problem: Problem, start: Fit, *, accuracy: float) -> Fit | None:
    """Fit by the compiled steady states, started on the measured branch.

    Parameters
    ----------
    problem, start
        What is fitted, and its fit of the balance.
    accuracy
        Of the simulated amplitude, relative.

    Returns
    -------
    Fit or None
        None where the simulator cannot follow enough of the points, or the first steps of a law without
        memory neither converge nor leave a misfit that could be noise.
    """
    observed, before = problem.observed, start.regression
    noisy = before.sigma > MISFIT_OF_NOISE
    drive, motion, amplitude = _near_motion(start, noisy)
    forward = Simulator(
        problem.elements,
        problem.law,
        motion,
        amplitude,
        drive,
        [h for h in observed.recorded if h != 1],
        before.parameters[: problem.count],
        before.strength[: problem.count],
        before.sigma,
        null=_null_of_law(before, problem.count),
        accuracy=accuracy,
    )
    descent = ErrorsInVariables(problem, forward)
    descent.scale = start.scale if noisy else observed.points.amplitude
    parameters, noise = before.parameters, before.sigma
    nuisance = observed.nuisances(np.abs(drive), np.angle(drive))
    predicted = forward.solve(parameters[: problem.count], np.exp(nuisance[:, 0]), accuracy)
    if np.count_nonzero(np.isfinite(predicted[:, 1])) < _MIN_SHARE_FOLLOWED * len(drive):
        return None
    rules = _rules(problem, observed.points, steps=_STEPS_KEPT, attainable=_RESOLUTION * accuracy)
    for _ in range(_RENEWALS):
        found = fit(descent.linearise, parameters, nuisance, rules, neighbours=observed.points.neighbours)
        if noisy and found.converged:
            found = descent.corrected(found)
        parameters, nuisance = found.parameters, found.nuisance
        exact = found.sigma < _RESOLUTION * accuracy
        # the minimum of a memory that two rounds do not settle is often at infinity
        settles = found.converged or problem.law.remembers
        if settles and (exact or found.sigma > _WORTH * noise):
            break
        pattern = is_systematic(found.residual, observed.points.pairs(found.used))
        if not settles and pattern and found.rms_misfit > MISFIT_DOUBTFUL_PATTERN_UNSEEN:
            # the values of a law that is wrong may run away
            return None
        # near a fold derivatives change quickly
        noise = found.sigma
        forward.renew()
    if np.count_nonzero(found.used) < _MIN_SHARE_FOLLOWED * len(drive):
        return None
    return _finish(problem, descent, found, start.order)


def _null_of_law(found: Regression, count: int) -> Array:
    """(q, d) directions of parameters and mass that change no prediction, without those of a background."""
    of_background = np.abs(found.null[count:]).max(axis=0, initial=0.0) > MIN_NULL_COMPONENT
    # null vectors with a part of the background are not those of the law
    null = np.where(np.abs(found.null[:count]) > MIN_NULL_COMPONENT, found.null[:count], 0.0)
    return (null / found.scale[:count, None])[:, ~of_background]


def _natural_sizes(problem: Problem, parameters: Array, mode: Points) -> Array:
    """(q,) sizes at which a term of the law equals the inertia force of the largest motion; zero for others.

    A constant force moves the mean alone, and is in the fundamental by round-off even if it is zero.
    """
    law = problem.law
    values, mass, _ = problem.split(parameters)
    largest = [int(np.argmax(mode.amplitude))]
    motion = sine_motion(mode.omega[largest], mode.amplitude[largest])
    force = abs(mass) * float(motion.omega[0] ** 2 * mode.amplitude[largest][0])
    slopes = law.along(motion, values, SAMPLES_PER_PERIOD).by_parameter
    sizes = np.zeros(len(parameters))
    for place in law.linear:
        slope = float(np.max(np.abs(slopes[place])))
        sizes[place] = force / slope if slope > 0 else 0.0
    return sizes


def _near_motion(start: Fit, noisy: bool) -> tuple[ComplexArray, Motion, Array]:
    """Force and motion of the mode near the measured ones, and its measured amplitude (n,) [m]."""
    observed = start.problem.observed
    mode = observed.mode(start.background)
    needed = {1} if start.problem.law.odd else {0, 1}
    if not noisy and needed.issubset(observed.recorded):
        return mode.force, mode.motion, mode.amplitude
    # what the balance made of force and response together is less noisy, and has a phase
    smooth, found = start.force * np.exp(1j * start.turn), start.motion.harmonics
    near = np.zeros((len(mode), max(found.shape[1], mode.harmonics.shape[1])), dtype=complex)
    near[:, : mode.harmonics.shape[1]] = mode.harmonics
    good = np.isfinite(smooth) & np.isfinite(found).all(axis=1) & start.regression.used
    near[good] = 0
    near[good, : found.shape[1]] = found[good]
    amplitude = np.where(np.isfinite(start.force), np.abs(found[:, 1]), mode.amplitude)
    return np.where(good, smooth, mode.force), Motion(mode.omega, near), amplitude
