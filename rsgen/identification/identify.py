"""The flow of an identification: prepare, start, fit, judge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rsgen.arrays import Array
from rsgen.errors import RsgenError, require
from rsgen.finding import Finding, quantities
from rsgen.fitting.across import law_of
from rsgen.fitting.fit import RESOLUTION, Fit, fit_balance, fit_simulator
from rsgen.fitting.least_squares import Regression
from rsgen.fitting.observed import Observed, shape_of
from rsgen.fitting.phase_resonance import with_loop_error
from rsgen.fitting.points import Points, per_unit_mass, select_points
from rsgen.fitting.problem import Problem
from rsgen.fitting.repeats import Repeats, gather_repeats, with_repeats
from rsgen.fitting.systematic import is_systematic
from rsgen.identification.across_findings import left_out_findings, noise_across_findings
from rsgen.identification.even_forces import explain_hidden, mirror_findings, widen_squares
from rsgen.identification.findings import Findings, repeat_findings
from rsgen.identification.mass_ratios import identify_ratios, resonance_findings
from rsgen.identification.resonance import fit_resonances
from rsgen.identification.restoring_force import equivalent_curve, force_levels, invert_curve, invert_motion
from rsgen.identification.soundness import feeds_exciter, runs_away
from rsgen.law import LawLike
from rsgen.law.remarks import law_remarks
from rsgen.lines.identify_multisine import identify_multisine
from rsgen.multisine import MultisineSpectra
from rsgen.observation import Observation
from rsgen.oscillator import Model, join_model
from rsgen.results.agreement import Agreement
from rsgen.results.estimates import (
    make_estimates,
    names_of,
    parameter_finding,
    state_background,
    units_of,
    with_combinations,
)
from rsgen.results.result import (
    Background,
    EquivalentCurve,
    Estimate,
    Identification,
    RestoringForce,
)
from rsgen.starting.start import start_fit, with_phase
from rsgen.surface import ResponseSurface
from rsgen.tolerances import MEANINGLESS, NOISY, ORDER, QUICK, SAME_NUMBER, STEPS, TAIL

__all__ = ["identify"]

Table = TypeVar("Table", Points, ResponseSurface)

_ORDERS = (ORDER, 15, 23)
"""Harmonics carried in the balance, raised until the last one no longer matters."""

_ACCURACIES = (1e-5, 1e-8)
"""Of the simulator inside the fit. The coarser is what a truncated waveform leaves of a law as soft as x|x|;
the finer serves where the misfit turns out to be as small."""

_RESOLVED = 100.0
"""A misfit this many times the simulator's accuracy is not the simulator's."""

_WORSE = 1.05
"""The simulator may not fit worse than the balance; if it does, it follows other branches."""

_FOLLOWED = 0.9
"""Share of the points that the simulator must be able to follow; where it is not, the law is wrong."""


def identify(
    surface: ResponseSurface | MultisineSpectra,
    law: Model | LawLike | Sequence[LawLike],
    observation: Observation | None = None,
    *,
    mass: float | None = None,
) -> Identification:
    """Identify every parameter of a law, and the mass where it is not given.

    Parameters
    ----------
    surface
        Settled points of any test; unsettled and held-out ones are left aside. Spectra of a multisine give a
        ``MultisineIdentification``.
    law
        Without values: a formula, an element, a law, a sequence of these, or a model.
    observation
        How the structure was observed; None: as the model says.
    mass
        m [kg] where it is known; None: as the model says, and to be identified where that says nothing. Of
        a driven base, whose force is one per mass, parameters without it are per unit mass.

    Returns
    -------
    Identification
        A parameter that is not identifiable is NaN with a finding, never an exception.

    Raises
    ------
    RsgenError
        A held-out level is not in the surface, or fewer than four points can be used.
    """
    model = join_model(law, observation, mass)
    if isinstance(surface, MultisineSpectra):
        return identify_multisine(surface, model)
    require(surface, ResponseSurface, "surface")
    surface, model = per_unit_mass(surface, model)
    return identify_ratios(surface, model, _identify) or _identify(surface, model)


def _identify(surface: ResponseSurface, model: Model) -> Identification:
    test = _prepare(surface, model)
    # what a trial makes infinite or undefined has no prediction there, and is dealt with as such
    with np.errstate(all="ignore"):
        problem, start = start_fit(test.problem)
        test = replace(test, problem=problem)
        found = _fit(problem, start)
        return _judge(test, model, found)


@dataclass(frozen=True, slots=True, eq=False)
class _Test:
    """A surface of means, the readings they are made of, its usable points, and what is fitted to them."""

    surface: ResponseSurface
    repeats: Repeats | None
    points: Points
    problem: Problem


def _prepare(surface: ResponseSurface, model: Model) -> _Test:
    surface, repeats = gather_repeats(surface)
    points = select_points(surface, model)
    across = points.across is not None and bool(np.any(points.across[:, 0]))
    law = law_of(model.elements, across=points.across is not None, means=(0 in points.measured, across))
    if law.acts_across and model.observation.background not in ("none", "phase"):
        raise RsgenError(
            f"background: {model.observation.background!r} beside a motion across two sensors, in which "
            "other modes take part already; 'none' or 'phase' is needed"
        )
    if law.odd and points.asymmetric and not law.acts_across:
        # an odd law has motions that are not: in one well of two, or after the symmetry breaks
        law = replace(law, odd=False)
    observed = Observed.of(points, model.observation.background, phase_known=surface.phase_known)
    return _Test(surface, repeats, points, Problem(model.elements, law, observed, model.mass))


def _fit(problem: Problem, start: Array) -> Fit:
    """Fit by the balance, then by the simulator where only that has all harmonics."""
    found, sharp = _refine(problem, start)
    observed = problem.observed
    if observed.points.load is not None and len(found.background):
        # a phase error turns all harmonics of the force, and is known by now
        found, sharp = _refine(problem, found.regression.parameters)
    if problem.law.acts_across:
        # only the measured motion across is known, and no steady state is asked for
        return found
    # a law that feeds energy settles nowhere, and one that misses by far is not mended by exact corners
    feeds = observed.phase_known and feeds_exciter(observed.mode(found.background))
    if problem.law.mean_free:
        # the simulator's motions drift where nothing holds their mean; loops are the same wherever they lie
        return _add_harmonics(found)
    if problem.law.remembers and runs_away(found):
        return found
    if sharp and not feeds and found.regression.noise * np.sqrt(2) < MEANINGLESS:
        # a misfit between the simulator's own and noise: some points were not followed
        found = _refit_with_simulator(found)
        if not problem.law.rough and 2 * RESOLUTION * _ACCURACIES[-1] < found.regression.noise < NOISY:
            found = _add_harmonics(found)
    return found


def _refine(problem: Problem, parameters: Array) -> tuple[Fit, bool]:
    """All harmonics that matter, and whether only the simulator has all of them."""
    law = problem.law
    points = problem.observed.mode(problem.split(parameters)[2])
    few = problem.select(points.spread(QUICK)) if len(points) > 2 * QUICK else problem
    sharp = law.rough or points.strong
    for order in _ORDERS:
        refined = fit_balance(few, parameters, order=order)
        parameters = refined.regression.parameters
        harmonics = np.abs(refined.harmonics[refined.regression.used])
        last = float(np.max(harmonics[:, -2:] / harmonics[:, 1:2], initial=0.0))
        enough = last < max(TAIL, 1e-3 * refined.regression.noise / np.sqrt(len(points)))
        if law.switched or sharp or enough:
            break
    noise = refined.regression.noise
    sharp = (sharp or (law.switched and noise < _ACCURACIES[0])) and noise > _ACCURACIES[-1]
    if few is problem:
        return refined, sharp
    # what the simulator takes up needs no more than one step
    return fit_balance(problem, parameters, order=order, steps=1 if sharp else STEPS), sharp


def _refit_with_simulator(balanced: Fit) -> Fit:
    """Replace the balance by the simulator where the law has jumps or corners.

    It drives with a sine: where harmonics of the force matter more than corners, the balance leaves less.
    """
    problem = balanced.problem
    start, accuracy = balanced, _ACCURACIES[0]
    few = problem.observed.mode(balanced.background).spread(QUICK)
    quick = fit_simulator(problem.select(few), balanced.select(few), accuracy=accuracy)
    if quick is not None:
        near = replace(balanced.regression, parameters=quick.regression.parameters)
        start = replace(balanced, regression=replace(near, noise=quick.regression.noise))
        if quick.regression.noise < _RESOLVED * accuracy:
            accuracy = _ACCURACIES[1]
    whole = len(few) == len(balanced.force) and accuracy == _ACCURACIES[0]
    refitted = quick if whole else fit_simulator(problem, start, accuracy=accuracy)
    followed = np.count_nonzero(refitted.regression.used) if refitted is not None else 0
    if refitted is None or followed < _FOLLOWED * np.count_nonzero(balanced.regression.used):
        return balanced
    both = refitted.regression.used & balanced.regression.used
    misfit = [float(np.sqrt(np.mean(found.regression.misfit[both] ** 2))) for found in (refitted, balanced)]
    return refitted if misfit[0] <= _WORSE * misfit[1] else balanced


def _add_harmonics(followed: Fit) -> Fit:
    """Try more harmonics where the simulator is not asked, or did not follow every branch of exact data."""
    balanced = followed
    for order in _ORDERS[1:]:
        balanced = fit_balance(followed.problem, balanced.regression.parameters, order=order)
    return min(followed, balanced, key=lambda found: found.regression.noise)


def _judge(test: _Test, model: Model, refined: Fit) -> Identification:
    """Estimates of all three kinds, what they rest on, and what to know about them."""
    law, (whole, each) = test.problem.law, with_repeats(refined.regression, test.points, test.repeats)
    surface, points = _mode(test.surface, refined), _mode(test.points, refined)
    used = refined.regression.used
    _require_followed(used, model)
    kept = points.select(used)
    first = _first_order(kept, test.problem, refined.values, refined.mass)
    paper, resonances = fit_resonances(kept, law, model.mass, first.solution)
    if law.acts_across:
        # no one amplitude is that of the law at a resonance
        paper = replace(paper, values=np.full(len(law.parameters), np.nan))
    misfits = is_systematic(points, refined.regression)
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
    if surface.per_mass:
        about = (*about, Finding("per-unit-mass", "info"))
    outcome = _outcome(surface, points, estimates, refined)
    about = (*about, *resonance_findings(kept, model.mass, law, outcome["misfit"]))
    about = (*about, *left_out_findings(refined, estimates))
    about = (*about, *noise_across_findings(refined, estimates, misfits=misfits))
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
        findings=(*about, *law_remarks(model.force), *mirror_findings(test.problem, estimates), *collected),
    )


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
    test: _Test, refined: Fit, whole: Regression, wider: Array
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
    covariance = with_loop_error(covariance, regression, test.surface)
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
        table = with_phase(table, found, shape)
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
