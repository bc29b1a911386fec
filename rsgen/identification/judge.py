"""Estimates of all three kinds, what they rest on, and what to know about them."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, quantities
from rsgen.common.tolerances import QUICK, SAME_NUMBER
from rsgen.data.oscillator import Model
from rsgen.data.surface import ResponseSurface
from rsgen.identification.across_findings import left_out_findings, noise_across_findings
from rsgen.identification.even_forces import explain_hidden, mirror_findings, widen_squares
from rsgen.identification.findings import Findings, repeat_findings
from rsgen.identification.fitting.fit import Fit, fit_balance
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.observed import Observed, shape_of
from rsgen.identification.fitting.phase_resonance import loop_error
from rsgen.identification.fitting.points import Points
from rsgen.identification.fitting.problem import Problem
from rsgen.identification.fitting.repeats import Repeats
from rsgen.identification.fitting.systematic import is_systematic
from rsgen.identification.mass_ratios import resonance_findings
from rsgen.identification.prepare import Prepared
from rsgen.identification.resonance import fit_resonances
from rsgen.identification.restoring_force import equivalent_curve, force_levels, invert_curve, invert_motion
from rsgen.identification.results import Background, EquivalentCurve, Estimate, Identification, RestoringForce
from rsgen.identification.results.agreement import Agreement
from rsgen.identification.results.estimates import (
    make_estimates,
    names_of,
    parameter_finding,
    state_background,
    units_of,
    with_combinations,
)
from rsgen.identification.soundness import feeding_findings
from rsgen.identification.starting.start import with_phase
from rsgen.law.remarks import law_remarks

__all__ = ["judge"]

Table = TypeVar("Table", Points, ResponseSurface)


def judge(test: Prepared, model: Model, refined: Fit) -> Identification:
    """Estimates of all three kinds, what they rest on, and what to know about them."""
    law, (whole, each) = test.problem.law, _with_repeats(refined.regression, test.points, test.repeats)
    surface, points = _mode(test.surface, refined), _mode(test.points, refined)
    used = refined.regression.used
    _require_followed(used, model)
    kept = points.select(used)
    first = _first_order(kept, test.problem, refined.values, refined.mass)
    paper, resonances = fit_resonances(kept, law, model.mass, first.solution)
    if law.acts_across:
        # no one amplitude is that of the law at a resonance
        paper = replace(paper, values=np.full(len(law.parameters), np.nan))
    misfits = is_systematic(refined.regression.residual, points.pairs(used))
    agreement = Agreement.of(refined.regression, points, whole.covariance, misfits=misfits)
    regression, noise, about = _errors(test, refined, whole, agreement.wider)
    regression = widen_squares(test.problem, agreement.widen(regression))
    whole = agreement.widen(whole)
    names, units = names_of(law, model), units_of(model, per_mass=surface.per_mass)
    reasons = {
        name: parameter_finding(name, names, units[name], points, surface.level_unit, regression)
        for name in names
    }
    reasons = with_combinations(explain_hidden(test.problem, reasons), model)
    freedom = np.minimum(regression.freedom, each[: test.problem.count])
    solution = replace(refined.solution, covariance=regression.covariance, freedom=freedom)
    estimates = make_estimates(solution, law, model, reasons, units)
    curve = equivalent_curve(surface, points, used, refined)
    mass = refined.mass if model.mass is not None or estimates[-1].identifiable else None
    misfit = refined.regression.misfit[used]
    of_parameters = tuple(e.finding for e in estimates if e.finding is not None)
    if estimates and not any(estimate.identifiable for estimate in estimates):
        about = (*about, Finding("nothing-identifiable", "doubt"))
    outcome = _outcome(surface, points, estimates, refined)
    if surface.per_mass:
        about = (*about, Finding("per-unit-mass", "info"))
    about = (*about, *resonance_findings(kept, model.mass, law, outcome["misfit"]))
    about = (*about, *feeding_findings(points, refined, estimates))
    about = (*about, *_across(refined, estimates, misfits=misfits))
    known = {e.name for e in estimates if np.isfinite(e.value)}
    general = Findings(surface, points, refined, resonances, agreement)
    collected = general.collect(of_parameters, about, calibrated=model.observation.calibrated)
    return Identification(
        model=model,
        paper=make_estimates(paper, law, model, {}, units),
        first_order=make_estimates(first.solution, law, model, reasons, units),
        refined=estimates,
        first_order_bias=tuple(map(float, _first_order_bias(kept, refined, first))),
        covariance=regression.covariance,
        resonances=resonances,
        curve=curve,
        restoring=_without_law(kept, refined.harmonics[used, 0].real, curve, mass, noise),
        residual=float(np.sqrt(np.mean(misfit**2))) if len(misfit) else float("nan"),
        noise=noise,
        levels=force_levels(surface, points, resonances),
        amplitude_range=(float(kept.amplitude.min()), float(kept.amplitude.max())),
        frequency_range=(float(kept.omega.min() / 2 / np.pi), float(kept.omega.max() / 2 / np.pi)),
        outcome=outcome,
        solution=refined.values,
        background=_background(refined, whole, per_mass=surface.per_mass),
        findings=(*about, *law_remarks(model.force), *mirror_findings(test.problem, known), *collected),
    )


def _across(refined: Fit, estimates: tuple[Estimate, ...], *, misfits: bool) -> tuple[Finding, ...]:
    """What sensors on both sides of a joint leave open of the values."""
    errors = np.array([e.standard_error if e.identifiable else np.nan for e in estimates])
    noise = noise_across_findings(refined, errors, misfits=misfits)
    return (*left_out_findings(refined, errors), *noise)


def _with_repeats(
    regression: Regression, points: Points, repeats: Repeats | None
) -> tuple[Regression, Array]:
    """Give a regression the covariance that repeats show, and degrees of freedom (q,); infinite without."""
    if repeats is None:
        return regression, np.full(len(regression.parameters), np.inf)
    covariance, freedom = repeats.covariance(points.index, regression.influence)
    covariance[np.isnan(regression.covariance)] = np.nan
    return replace(regression, covariance=covariance), freedom


def _require_followed(used: NDArray[np.bool_], model: Model) -> None:
    """Refuse a law that no point follows."""
    if not used.any():
        raise RsgenError(
            f"law: {model.force} follows none of the {len(used)} points; is this the law, with x for the "
            "displacement, v for the velocity and every other name a parameter, and are quantity and unit of "
            "the response as in the case?"
        )


def _background(refined: Fit, whole: Regression, *, per_mass: bool) -> Background | None:
    """The background with its errors, which stand behind those of the law."""
    problem = refined.problem
    variance = np.diag(whole.covariance)[problem.count :]
    return state_background(problem.observed, refined.background, variance, whole.freedom, per_mass=per_mass)


def _errors(
    test: Prepared, refined: Fit, whole: Regression, wider: Array
) -> tuple[Regression, float, tuple[Finding, ...]]:
    """Regression of the law before its errors get wider, noise of a reading, and what repeats say of both."""
    # the expected noise has unit size in real and imaginary part each
    noise = misfit = float(refined.regression.noise * np.sqrt(2))
    regression = whole.first(test.problem.count)
    about: tuple[Finding, ...] = ()
    if test.repeats is not None:
        noise = test.repeats.noise
        about = repeat_findings(test.repeats, misfit, float(np.median(wider[: test.problem.count])))
    # neighbours share the error that a surface reports of itself: scatter does not show it
    error = test.surface.error[test.points.index[refined.regression.used]]
    error = error[np.isfinite(error)]
    reported = float(np.sqrt(np.mean(error**2))) if len(error) else 0.0
    covariance = regression.covariance * (1 + (reported / noise) ** 2)
    if test.surface.lag_assumed:
        covariance = covariance + loop_error(regression.influence)
    return replace(regression, covariance=covariance), noise, about


def _without_law(
    points: Points, predicted: Array, curve: EquivalentCurve, mass: float | None, noise: float
) -> RestoringForce | None:
    """Draw the forces from k(X) and c(X), or along the motion where its mean is not zero."""
    if mass is None:
        return None
    recorded = 0 in points.measured
    mean = points.harmonics[:, 0].real if recorded else predicted
    # about zero, where alone a force follows from k(X) without a law
    if float(np.sqrt(np.mean((mean / points.amplitude) ** 2))) < SAME_NUMBER:
        return invert_curve(curve, mass)
    return invert_motion(points, mass, noise) if recorded else None


def _mode(table: Table, found: Fit) -> Table:
    """Subtract the background; phases that were not recorded are those that the fit predicts."""
    observed = found.problem.observed
    shape = shape_of(observed.kind, table.omega, table.force, observed.band)
    if not observed.phase_known:
        table = with_phase(table, found, shape.receptance(found.background))
    return shape.subtract(table, found.background)


def _first_order(points: Points, problem: Problem, values: Array, mass: float) -> Fit:
    """Fit one harmonic to the points of the mode, from values near the solution."""
    mode = replace(problem, observed=Observed.of(points))
    return fit_balance(mode, mode.join(values, mass), order=1, reject=False)


def _first_order_bias(points: Points, refined: Fit, first: Fit) -> Array:
    """What the first-order fit makes of the noise-free response of the refined model."""
    used = refined.regression.used
    count = points.harmonics.shape[1]
    predicted = refined.motion.harmonics[used]
    harmonics = np.zeros((len(points), max(count, predicted.shape[1])), dtype=complex)
    harmonics[:, : predicted.shape[1]] = predicted
    if not np.isfinite(harmonics).all():
        return np.full(first.problem.count, np.nan)
    force = (refined.force * np.exp(1j * refined.turn))[used]
    exact = replace(points, force=force, harmonics=harmonics[:, :count])
    exact = exact.select(exact.spread(2 * QUICK))
    again = _first_order(exact, first.problem, first.values, first.mass)
    return again.regression.parameters - refined.regression.parameters[: first.problem.count]


def _outcome(
    surface: ResponseSurface, points: Points, estimates: tuple[Estimate, ...], refined: Fit
) -> Finding:
    numbers = quantities(
        identified=sum(estimate.identifiable for estimate in estimates),
        parameters=len(estimates),
        used=int(refined.regression.used.sum()),
        points=len(surface),
        levels=len(np.unique(points.level)),
        misfit=float(refined.regression.noise * np.sqrt(2)),
    )
    return Finding("identified", "info", numbers=numbers)
