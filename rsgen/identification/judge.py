"""From a fit to a result: the errors of its parameters, estimates with intervals, findings.

The covariance of the parameters is built up in this order (``errors_of``), each step at least as wide as the
one before:

1. C = s^2 (J^T J)^-1, or the sandwich where it is wider, with the noise s found in the misfit; of sweeps and
   decays the sandwich (``summarise``).
2. Where points were measured repeatedly, the scatter of their readings, if that is more (``repeats``).
3. What neighbours have in common and scatter does not show: errors that a surface states of its points, and
   the lag that a phase-locked loop was assumed to hold.
4. The largest shift by an alternative, C_jj + weight shift_j^2: a missing term, a larger background, halves
   of the test (``results.alternatives``).
5. Values that the points show by their squares alone (``widen_squares``).

Whether a law feeds energy or misses a joint is asked with the errors of this very law: halves in place of all
alternatives in step 4. Findings come last (``Findings.collect``), because most need estimates and errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import nan

import numpy as np
from numpy.typing import NDArray

import rsgen.identification  # profiles, for laws with nonlinear parameters
from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, Severity, quantities
from rsgen.common.tolerances import (
    MAX_SHARE_OF_OUTLIERS_BY_CHANCE,
    MISFIT_DOUBTFUL_WITH_PATTERN,
    RELATIVE_CHANGE_NEGLIGIBLE,
    RELATIVE_ERROR_DOUBTFUL,
    SUBSAMPLE_POINTS,
)
from rsgen.data.oscillator import Model, force_units, refuse_across
from rsgen.data.surface.mode_findings import derivative_findings, mode_findings
from rsgen.data.surface.plausibility import backbone_gap, plausibility_findings
from rsgen.data.surface.response_surface import Outcome, ResponseSurface, within
from rsgen.dynamics.linear_part import background_terms
from rsgen.identification.fitting.across import law_of
from rsgen.identification.fitting.fit import Fit, fit_balance
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.observed import Observed, Problem
from rsgen.identification.fitting.points import (
    Points,
    at_phase_resonance,
    at_rest,
    loop_error,
    refuse_resonance_alone,
    select_points,
)
from rsgen.identification.fitting.repeats import Repeats, gather_repeats
from rsgen.identification.misfit import (
    consequences,
    even_findings,
    explain_hidden,
    is_misread,
    mirror_findings,
    misfit_findings,
    symmetric_shift,
    unseen_findings,
    widen_squares,
)
from rsgen.identification.resonance import branch_findings, fit_resonances, resonance_findings
from rsgen.identification.restoring_force import equivalent_curve, force_levels, invert_curve
from rsgen.identification.results import (
    Background,
    EquivalentCurve,
    Estimate,
    Identification,
    Resonance,
    RestoringForce,
    later,
    units_of,
)
from rsgen.identification.results.alternatives import Agreement, Alternatives
from rsgen.identification.results.estimates import (
    Errors,
    Statement,
    largest_tested,
    make_estimates,
    missing_unit_check,
    moves_of,
    outcome_of,
    phase_findings,
    state_background,
    state_parameters,
    with_mass_error,
)
from rsgen.identification.soundness import (
    exclusion_findings,
    feeding_findings,
    gain_findings,
    joint_findings,
    left_out,
    limit_findings,
    name_exchanged,
    nearly_held,
    points_at,
    repeats_finding,
    shown_by_few,
    sign_findings,
)
from rsgen.identification.starting.start import Table, with_phases
from rsgen.identification.terms import alternatives_to, equations_of, linearised_with, stop_findings
from rsgen.law.element import law_remarks, response_share
from rsgen.law.memory import refuse_free_powers

# ----------------------------------------------------------------------------
# From a surface and a model to points that can be used, and what is fitted to them.


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A surface of means, the readings they are made of, its usable points, and what is fitted to them."""

    surface: ResponseSurface
    repeats: Repeats | None
    problem: Problem

    @property
    def points(self) -> Points:
        """Those that are fitted."""
        return self.problem.observed.points


def prepare(surface: ResponseSurface, model: Model) -> Prepared:
    """Join repeats, select the points that count, and compile the law along the motions that were measured.

    Raises
    ------
    RsgenError
        As for ``identify``; points at phase resonance alone, which determine neither a mass that is not given
        nor a background; a motion across two sensors without phases; a difference of sensors with a
        neighbouring mode.
    """
    refuse_free_powers(model.force, model.fixed)
    surface, repeats = gather_repeats(surface, model.sensors)
    points = select_points(surface, model)
    law = law_of(model.elements, points.means[: 1 + points.far.shape[1]], points.asymmetric)
    refuse_resonance_alone(points, model, remembers=law.remembers)
    # of a difference noise of the second sensor is taken for the joint; a sensor of its own has no such share
    neighbour = model.observation.background.startswith("neighbour") and response_share(model.sensors) > 0
    refuse_across(model.sensors, neighbour=neighbour, phases=not surface.phase_known)
    observed = Observed.of(points, model.observation.background)
    if law.remembers and law.odd:
        # the mean of a slider that sticks is where it came to rest
        observed = replace(observed, recorded=tuple(h for h in observed.recorded if h))
    return Prepared(surface, repeats, Problem(model.elements, law, observed, model.fixed))


# ----------------------------------------------------------------------------
# Errors of the parameters, from the noise of the fit to all that the test leaves open.


@dataclass(frozen=True, slots=True, eq=False)
class PointErrors(Errors):
    """Errors of the parameters of a test of sines, and what they were built up from.

    Parameters
    ----------
    symmetric
        (q,) shift to a symmetric law that fits as well; see ``symmetric_shift``.
    agreement
        Of halves of the test.
    of_repeats
        Findings about the scatter of repeats.
    """

    symmetric: Array
    agreement: Agreement
    of_repeats: list[Finding]


def errors_of(test: Prepared, refined: Fit, surface: ResponseSurface, points: Points) -> PointErrors:
    """Return the errors of a fit; ``surface`` and ``points`` are those of the test without background."""
    count, noise = test.problem.count, refined.regression.rms_misfit
    with_background, of_repeats = refined.regression, list[Finding]()
    if test.repeats is not None:
        with_background = test.repeats.widen(with_background, test.points.index)
        of_repeats.append(repeats_finding(test.repeats, noise))
        noise = test.repeats.noise
    regression = with_background.first(count)
    agreement = Agreement.of(
        refined.regression,
        points,
        with_background.covariance,
        misfits=refined.systematic,
        unit=surface.level_unit,
    )
    regression = _widen_by_common_errors(regression, test, noise)
    # nothing drives a decay: there is no background; one whose phases were not recorded could be any
    backgrounds = not (surface.decays or surface.lag_assumed)
    symmetric = symmetric_shift(refined) if backgrounds else np.zeros(count)
    of_law = widen_squares(refined, agreement.widen(regression), symmetric).covariance
    kinds = alternatives_to(refined, agreement, backgrounds=backgrounds)
    names, misfit = (*test.problem.law.parameters, "m"), refined.regression.rms_misfit
    regression, others, ambiguous = Alternatives.widen(regression, names, kinds, misfit)
    return PointErrors(
        regression=widen_squares(refined, regression, symmetric),
        of_law=of_law,
        with_background=agreement.widen(with_background),
        noise=noise,
        others=others,
        ambiguous=ambiguous,
        symmetric=symmetric,
        agreement=agreement,
        of_repeats=of_repeats,
    )


def _widen_by_common_errors(regression: Regression, test: Prepared, noise: float) -> Regression:
    """Add errors that neighbours have in common: those stated of the points, and an assumed lag of a loop."""
    stated = test.surface.error[test.points.index[regression.used]]
    stated = stated[np.isfinite(stated)]
    common = float(np.sqrt(np.mean(stated**2))) if len(stated) else 0.0
    covariance = regression.covariance * (1 + (common / noise) ** 2)
    if test.surface.lag_assumed:
        covariance = covariance + loop_error(regression.influence)
    return replace(regression, covariance=covariance)


# ----------------------------------------------------------------------------
# Findings: what a reader should know of a fit, as data.

_NO_SINE = 0.5
"""Harmonics beyond this share of the fundamental at half of the points: hardly the answer to a sine."""

_NOISE_AS_SINE = 2 * _NO_SINE
"""Harmonics beyond this share at half of the points: noise or a transient, taken for a steady sine."""

_MIN_POINTS_AT_RESONANCE = 5
"""Points within the width of a resonance below which one outlier decides the damping."""

_MIN_SHARE_OF_RELEASE = 2 / 3
"""Of the largest amplitude of a first period; where fitted ones stay below, a cubic term is half of it."""


def of_one_mode(findings: tuple[Finding, ...], points: Points, misfit: float) -> tuple[Finding, ...]:
    """Return the findings of a test, "phase-gap" only where no law fits both groups of points.

    Groups of points with a gap of phase between them may be two modes: a doubt where their amplitudes
    overlap, or where the misfit [1] of one law for both is large.
    """
    rest = tuple(finding for finding in findings if finding.code != "phase-gap")
    gap = backbone_gap(*at_phase_resonance(points))
    if len(rest) == len(findings) or gap is None:
        return rest
    one_mode = "overlap" not in gap.names and misfit < RELATIVE_ERROR_DOUBTFUL
    return rest if one_mode else (*rest, replace(gap, severity="doubt"))


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """A fit with its test, errors and estimates, as the findings need them.

    Parameters
    ----------
    as_read, surface, points
        All points of the test as read; they, and those that were fitted, without the background.
    fit
        The refined one.
    resonances
        Of all runs.
    errors
        Of the parameters.
    model
        The law, and how the structure was observed.
    stated
        Estimates, and findings about values that alternatives change.
    background
        Estimates of the background; None without one.
    """

    as_read: ResponseSurface
    surface: ResponseSurface
    points: Points
    fit: Fit
    resonances: tuple[Resonance, ...]
    errors: PointErrors
    model: Model
    stated: Statement
    background: Background | None

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Refined estimates, with all errors."""
        return self.stated.refined

    def collect(self) -> tuple[Finding, ...]:
        """Return all findings, but for what others explain."""
        of_law, of_test, problem = self._of_law(), self._of_test(), self.fit.problem
        codes = ("fixed-contradicted", "mass-negative")
        if any((f.code, f.severity) == ("harmonics-across-left-out", "doubt") for f in of_law):
            # what harmonics leave of the misfit another fixed value may take up, and is as wrong for it
            of_test = [f for f in of_test if not (f.code == codes[0] and f.parameter in problem.known_values)]
        wrong = {f.parameter for f in of_test if f.code in codes and f.parameter in problem.known_values}
        for name in wrong:
            follow = consequences(self.fit, name)
            of_test = [finding for finding in of_test if finding.code not in follow]
        # a wrong fixed value leaves what terms take up as well, a ratio of channels what backgrounds do
        ratio_differs = any(f.code == "channels-delayed" and "gain" in f.numbers for f in of_test)
        ambiguous = (f for f in self.stated.ambiguous if not (ratio_differs and "background" in f.names))
        # values at which the steps ended are compared with no other fit
        of_law += () if wrong or not self.fit.regression.converged else ambiguous
        valued = {e.name for e in self.estimates if np.isfinite(e.value)}
        return (
            *of_law,
            *law_remarks(self.model.force),
            *mirror_findings(problem, valued, self.errors.symmetric),
            *stop_findings(self.fit, units_of(self.model, self.surface.units)),
            *of_test,
        )

    def _of_law(self) -> list[Finding]:
        """Find what repeats, resonances, energy, a joint, even forces and background say of the law."""
        fit, law = self.fit, self.fit.problem.law
        found = list(self.errors.of_repeats)
        known = sum(estimate.identifiable for estimate in self.estimates)
        if 2 * known < len(self.estimates):
            numbers = quantities(known=known, parameters=len(self.estimates)) if known else {}
            given = {"mass": "given"} if self.model.mass is not None else {}
            found.append(Finding("nothing-identifiable", "doubt", "", numbers, given))
        kept = self.points.select(fit.regression.used)
        found += resonance_findings(kept, self.model.fixed, law, self.estimates, fit.regression.rms_misfit)
        found += branch_findings(kept, fit, self.surface.level_unit)
        found += feeding_findings(self.points, fit, self.stated.of_law)
        sure = {e.name: e.standard_error for e in self.stated.of_law if e.identifiable}
        found += joint_findings(fit, np.array([sure.get(name, nan) for name in law.parameters]))
        found += unseen_findings(fit, self.estimates)
        return [*found, *(() if self.background is None else self.background.findings)]

    def _of_test(self) -> list[Finding]:
        """Find what is to know of the parameters, the points used, the misfit, and signs and sizes."""
        of_parameters = [e.finding for e in self.estimates if e.finding is not None]
        calibrated, wider = self.model.observation.calibrated, self.errors.agreement.wider
        found = list(of_parameters)
        found += of_one_mode(self.surface.findings, self.points, self.fit.regression.rms_misfit)
        found += self.surface.limits
        misread = is_misread(self.surface)
        if self.fit.problem.observed.mode(self.fit.background).feed_exciter and not misread:
            found.append(Finding("structure-feeds-exciter", "error"))
        if not calibrated:
            found.append(Finding("not-calibrated", "info"))
        found += self._exclusions()
        found += self._release()
        if not self.surface.response_held:
            found += limit_findings(self.surface.findings, self.fit)
        if not (self.fit.regression.converged or misread):
            # where the steps ended says nothing of the best values, nor do the errors there
            said = (("exchanged", "mirror"), ("flat", "flat"))
            why = {name: [f.parameter for f in of_parameters if of in f.names] for name, of in said}
            names = {name: " and ".join(of) for name, of in why.items() if of}
            found.append(Finding("not-converged", "doubt", names=names))
        found += misfit_findings(self.surface, self.points, self.fit, self.errors.others)
        found += even_findings(self.fit)
        if self.surface.decays:
            used, motion = self.fit.regression.used, self.fit.motion
            found += derivative_findings(self.points.harmonics[used], motion.harmonics[used])
        found += self.errors.agreement.findings if self.fit.regression.converged else ()
        found += sign_findings(self.points, self.fit, wider, force_units(self.model, self.surface.units))
        found += phase_findings(self.fit.background)
        problem = self.fit.problem
        variance = np.diag(self.fit.regression.covariance)[problem.count :]
        found += gain_findings(problem.observed.background, self.fit.background, variance, self.fit.mass)
        found += self._motion()
        found += self._implausible(calibrated, {finding.parameter for finding in of_parameters})
        # next to a background a mode without a law has another mass; a wrong mass turns the phase
        mass = self.model.mass if self.model.observation.background in ("none", "phase") else None
        regression = self.fit.regression
        few_left_out = float(np.mean(~regression.used)) <= MAX_SHARE_OF_OUTLIERS_BY_CHANCE
        near = not self.fit.systematic or regression.rms_misfit < MISFIT_DOUBTFUL_WITH_PATTERN
        test = self.surface if mass is None else self.as_read
        return mode_findings(test, mass, [*found, *self._runs()], near and few_left_out)

    def _exclusions(self) -> list[Finding]:
        """Find points that were not fitted: unsettled ones, and outliers."""
        # the reading counts those that it excluded, and those without a number
        said = sum(int(f["excluded"]) for f in self.surface.findings if f.code == "points-excluded")
        measured = self.surface.outcome != Outcome.NOT_MEASURED
        left = ~self.surface.settled & measured
        unsettled = int(np.count_nonzero(left)) - said
        numbers = quantities(excluded=unsettled, points=len(self.surface))
        if doubled := int(np.count_nonzero(self.surface.outcome == Outcome.PERIOD_TWO)):
            numbers |= quantities(doubled=doubled)
        names = {"by": "settling"} | ({"further": "yes"} if said else {})
        if unsettled > 0 and not said:
            level, frequency = self.surface.level[left], self.surface.frequency[left]
            names["where"] = points_at(level, frequency, self.surface.level_unit)
        found = [Finding("points-excluded", "info", numbers=numbers, names=names)] if unsettled > 0 else []
        tested = within(self.surface, self.model.observation.band)
        still = at_rest(tested)
        # exactly zero of a measured test was said where it was read
        if still.any() and all(f.names.get("by") != "zero" for f in self.surface.findings):
            found.append(left_out("standstill", tested, still, self.surface.level_unit))
        fold = self.fit.beyond_fold
        if fold.any():
            found.append(left_out("fold", self.points, fold, self.surface.level_unit))
        # without a prediction where friction nearly holds the mass: noise of the force decides
        stopped = nearly_held(self.points, self.fit.problem.law, self.fit.values)
        return found + exclusion_findings(
            self.points,
            ~(self.fit.regression.used | fold),
            len(self.surface),
            self.surface.level_unit,
            decays=self.surface.decays,
            converged=self.fit.regression.converged,
            stopped=stopped & np.isnan(self.fit.regression.misfit),
        )

    def _release(self) -> list[Finding]:
        """Find that amplitudes which are fitted are all far below those with which decays begin."""
        taken = [f for f in self.surface.findings if f.code == "decay-taken"]
        released = max((f["released"] for f in taken if "released" in f.numbers), default=0.0)
        largest = float(np.max(self.points.amplitude[self.fit.regression.used], initial=0.0))
        if not 0 < largest < _MIN_SHARE_OF_RELEASE * released:
            return []
        numbers = quantities("m", released=released, fitted=largest) | quantities(share=largest / released)
        names = {"windows": "long"} if any("windows" in f.names for f in taken) else {}
        return [Finding("decay-begins-larger", "warning", numbers=numbers, names=names)]

    def _implausible(self, calibrated: bool, not_identifiable: set[str]) -> Iterator[Finding]:
        mass = nan if "m" in not_identifiable else self.fit.mass
        # what friction nearly holds has any damping
        moving = self.points.select(~nearly_held(self.points, self.fit.problem.law, self.fit.values))
        ratios = [r.damping_ratio for r in self.resonances if _run_of(moving, r).any()]
        damping = min((ratio for ratio in ratios if ratio > 0), default=nan)
        return plausibility_findings(self.surface, calibrated=calibrated, mass=mass, damping=damping)

    def _motion(self) -> list[Finding]:
        """Find harmonics that the response to a steady sine has not at half of the points."""
        higher = np.abs(self.points.harmonics[:, 2:]) / self.points.amplitude[:, None]
        largest = float(np.median(higher.max(axis=1, initial=0.0)))
        if not largest > _NO_SINE:
            return []
        severity: Severity = "error" if largest > _NOISE_AS_SINE else "doubt"
        return [Finding("not-a-steady-sine", severity, numbers=quantities(share=largest))]

    def _runs(self) -> list[Finding]:
        """Find runs with few points near their resonance, but of loops, which have few a level."""
        few = 0
        for resonance in self.resonances:
            width = max(2 * abs(resonance.damping_ratio), 1e-12) * resonance.frequency
            near = np.abs(self.points.omega / 2 / np.pi - resonance.frequency) < width
            few += int(np.sum(near & _run_of(self.points, resonance)) < _MIN_POINTS_AT_RESONANCE)
        if not few or self.surface.control in ("phase", "continuation"):
            return []
        numbers = quantities(few=few, runs=len(self.resonances), points=_MIN_POINTS_AT_RESONANCE)
        return [Finding("resonance-sparse", "warning", numbers=numbers)]


def _run_of(points: Points, resonance: Resonance) -> NDArray[np.bool_]:
    """(n,) points of the run of a resonance."""
    return np.asarray((points.level == resonance.level) & (points.sweep == resonance.sweep))


def judge(test: Prepared, model: Model, refined: Fit) -> Identification:
    """Return a fit as a result: errors, estimates of all three kinds, curves, findings."""
    law, used = test.problem.law, refined.regression.used
    _require_followed(used, model, test.surface)
    surface, points = _mode(test.surface, refined), _mode(test.points, refined)
    kept = points.select(used)
    errors = errors_of(test, refined, surface, points)
    errors = with_mass_error(errors, law, model, refined.problem.observed.background.names)
    units = units_of(model, surface.units)
    tested = largest_tested(points.amplitude, points.level, surface.level_unit)

    def explained(reasons: dict[str, Finding | None]) -> dict[str, Finding | None]:
        return {**explain_hidden(test.problem, reasons), **shown_by_few(refined)}

    stated = state_parameters(errors, law, model, units, tested, explained)
    if law.nonlinear:
        # the sum of squares of other laws is nearly quadratic
        stated = replace(stated, refined=rsgen.identification.with_profiles(refined, stated.refined))
    stated = replace(stated, refined=name_exchanged(refined, errors.regression, stated.refined))
    first = _FirstOrder(kept, refined.select(np.flatnonzero(used)))
    paper, resonances = fit_resonances(kept, law, model.fixed, lambda: first.fit.solution)
    observed = refined.problem.observed
    seen = observed.background, observed.points.force, observed.points.amplitude
    whole = errors.with_background
    background = state_background(*seen, refined.background, whole, surface.units, resonances)
    curve = equivalent_curve(surface, points, refined, force_units(model, surface.units), model.observation)
    mass = refined.mass if all(e.identifiable for e in stated.refined if e.name == "m") else nan
    predicted = refined.harmonics[used, 0].real
    findings = Findings(test.surface, surface, points, refined, resonances, errors, model, stated, background)
    return Identification(
        model=model,
        paper=later(lambda: make_estimates(paper(), law, model, {}, units)),
        first_order=later(lambda: make_estimates(first.fit.solution, law, model, stated.reasons, units)),
        refined=stated.refined,
        first_order_bias=later(lambda: tuple(first.bias()[errors.regression.free].tolist())),
        covariance=stated.covariance,
        small_motion=stated.small_motion,
        resonances=resonances,
        curve=curve,
        restoring=later(lambda: _without_law(kept, predicted, curve, mass)),
        residual=refined.regression.rms_misfit,
        noise=errors.noise,
        levels=force_levels(surface, points, resonances),
        amplitude_range=(float(kept.amplitude.min()), float(kept.amplitude.max())),
        frequency_range=(float(kept.omega.min() / 2 / np.pi), float(kept.omega.max() / 2 / np.pi)),
        outcome=outcome_of(
            stated.refined,
            refined.regression.rms_misfit,
            used=int(used.sum()),
            points=len(surface),
            levels=len(np.unique(points.level)),
            moves=moves_of(partial(_scaled, refined), refined.regression, law, stated, model, surface),
            missing_check=missing_unit_check(surface, model, units),
        ),
        solution=refined.values,
        background=background,
        alternatives=errors.others,
        fit=refined,
        findings=findings.collect(),
    )


def _require_followed(used: NDArray[np.bool_], model: Model, surface: ResponseSurface) -> None:
    """Refuse a law that no point follows, and name the mass where the points show another one."""
    if used.any():
        return
    shown = (f["fitted"] for f in mode_findings(surface, model.mass) if f.code == "fixed-contradicted")
    mass = "" if model.mass is None else f" is m = {model.mass:.4g} kg its mass"
    mass += "".join(f" (the points show about {fitted:.3g} kg)" for fitted in shown) + "," * bool(mass)
    raise RsgenError(
        f"law: {model.force} follows none of the {len(used)} points; is this the law, with x for the "
        f"displacement, v for the velocity and every other name a parameter,{mass} and are quantity and unit "
        "of the response as in the case?"
    )


def _without_law(
    points: Points, predicted: Array, curve: EquivalentCurve, mass: float
) -> RestoringForce | None:
    """Return the forces that follow from k(X) and c(X); None where the mean of the motion is not zero."""
    mean = points.harmonics[:, 0].real if 0 in points.measured else predicted
    centred = float(np.sqrt(np.mean((mean / points.amplitude) ** 2))) < RELATIVE_CHANGE_NEGLIGIBLE
    return invert_curve(curve, mass) if centred and np.isfinite(mass) else None


def _scaled(fit: Fit, force: float, response: float) -> tuple[Array, Array]:
    """Return residual (r,) and slopes (r, q) of a fit to points whose force and response have factors."""
    points = fit.problem.observed.points
    load = None if points.load is None else force * points.load
    scaled = {"force": force * points.force, "load": load, "harmonics": response * points.harmonics}
    noise = fit.regression.sigma if points.weighed else 1.0
    return equations_of(fit, fit.problem, *linearised_with(fit, **scaled), noise)


def _mode(table: Table, found: Fit) -> Table:
    """Subtract the background; phases that were not recorded are those that the fit predicts."""
    own = found.problem.observed.background
    shape = background_terms(own.kind, table.omega, table.force, own.band)
    table = with_phases(table, found, shape.receptance(found.background))
    return shape.subtract(table, found.background)


@dataclass(frozen=True, eq=False)
class _FirstOrder:
    """One harmonic fitted to the ``points`` (n,) of the mode that a ``refined`` fit of them used."""

    points: Points
    refined: Fit

    def _fit(self, points: Points, start: Array) -> Fit:
        problem = replace(self.refined.problem, observed=Observed.of(points))
        return fit_balance(problem, start, order=1, exclude=False)

    @cached_property
    def fit(self) -> Fit:
        """First order, from values near the solution."""
        return self._fit(self.points, self.refined.regression.parameters[: self.refined.problem.count])

    def bias(self) -> Array:
        """Return the error of the first-order fit on the noise-free response of the refined model."""
        refined, near = self.refined, self.refined.regression.parameters[: self.refined.problem.count]
        predicted, count = refined.motion.harmonics, self.points.harmonics.shape[1]
        harmonics = np.zeros((len(self.points), max(count, predicted.shape[1])), dtype=complex)
        harmonics[:, : predicted.shape[1]] = predicted
        if not np.isfinite(harmonics).all():
            return np.full(len(near), np.nan)
        force = refined.force * np.exp(1j * refined.turn)
        exact = replace(self.points, force=force, harmonics=harmonics[:, :count])
        again = self._fit(exact.select(exact.spread(2 * SUBSAMPLE_POINTS)), self.fit.regression.parameters)
        return again.regression.parameters - near
