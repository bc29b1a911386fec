"""The flow of an identification: prepare, start, fit, judge, predict.

    -m (h omega)^2 X_h + N_h(p) = F_h,    h = 0, 1, 2, ...    at every point of the test

is solved for m and the parameters p of the law by least squares with errors in F and X:

1. ``prepare``: repeats become means; unsettled, held-out and out-of-band points are left out.
2. ``start_fit``: first order, h = 1, which is linear in most parameters; a search in the others.
3. Points at which friction holds the mass are left out, since they say nothing of motion; then again 2.
4. ``fit_all_harmonics``: as many harmonics as matter, or the steady states of the simulator.
5. ``judge``: errors, estimates, findings.
6. ``predict_held_out``: levels that were not fitted are predicted, and judge the result as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np

import rsgen.identification  # fits of multisines, where one is given
from rsgen.common.arrays import Array
from rsgen.common.errors import known_arguments, require
from rsgen.common.solvers import determined
from rsgen.common.tolerances import (
    BALANCE_HARMONICS,
    HARMONIC_TRUNCATION,
    MAX_NEWTON_STEPS,
    MAX_SHIFT_TO_ERROR,
    MIN_MISFIT_REDUCTION,
    MISFIT_OF_NOISE,
    MISFIT_REJECTED,
    NEAR_STEPS,
    SIGNIFICANCE_LEVEL,
    SUBSAMPLE_POINTS,
    f_quantile,
)
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import Model, Observation, join_model
from rsgen.data.record_set import with_label
from rsgen.data.surface.mode_findings import is_beyond_any_law, row_findings
from rsgen.data.surface.plausibility import base_findings
from rsgen.data.surface.response_surface import ResponseSurface, without_copies, without_offset
from rsgen.identification.fitting.fit import Fit, fit_balance, fit_simulator
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.observed import Problem
from rsgen.identification.fitting.points import held_amplitudes, per_unit_mass
from rsgen.identification.judge import judge, prepare
from rsgen.identification.misfit import is_misread, law_misses
from rsgen.identification.prediction import Prediction, predict_held_out, predict_records
from rsgen.identification.results import Identification, changed
from rsgen.identification.soundness import (
    held_finding,
    held_points,
    left_out,
    runs_away,
    shown_by_few,
)
from rsgen.identification.starting.start import start_fit
from rsgen.law.element import LawLike

# ----------------------------------------------------------------------------
# All harmonics: by the balance, then by the simulator where only that has all of them.

_ORDERS_TRIED = (BALANCE_HARMONICS, 15, 23)
"""Highest harmonics of the balance: of smooth laws raised until the last no longer matters (``_balance``),
of laws with memory one more step."""

_HARMONICS_OF_CORNERS = BALANCE_HARMONICS
"""The same where a law has switches or a motion is far from a sine: the simulator adds what is missing. It is
below the last of ``_ORDERS_TRIED``, of which the next one above it shows whether laws with memory need
more (``_balance``)."""

_FEW_HARMONICS = 5
"""Of motions near a sine under a smooth law: what they leave out follows from how they decay."""

_ACCURACIES = (1e-5, 1e-8)
"""Of the simulator inside the fit. The coarser is what a truncated waveform leaves of a law as soft as x|x|;
the finer serves where the misfit turns out to be as small."""

_STEPS_IF_MISREAD = 5
"""Steps of the fit where no law explains the test, or a misreading of the channels does so better."""

_RESOLVED = 100.0
"""A misfit this many times the simulator's accuracy is not the simulator's."""


def fit_all_harmonics(problem: Problem, start: Array, attained: float = 0.0) -> Fit:
    """Fit by the balance, then by the simulator where only that has all harmonics (``_balance``).

    The simulator is not asked for less than the misfit ``attained``, relative to force and response; nor by a
    law across two sensors, one whose mean nothing holds, one that feeds energy, one that misses by far, or
    one with values that noise hides: exact corners do not tell them.
    """
    found, needs_simulator = _balance(problem, start)
    observed, law = problem.observed, problem.law
    if observed.points.load is not None and len(found.background):
        # a phase error turns all harmonics of the force, and is known by now
        found, needs_simulator = _balance(problem, found.regression.parameters)
    if few := shown_by_few(found):
        # slopes that seem to distinguish these values are round-off, along which steps creep
        lost = [law.parameters.index(name) for name in few]
        problem, start = replace(problem, frozen=(*problem.frozen, *lost)), found.regression.parameters
        found = fit_balance(problem, start, order=found.order, compared=BALANCE_HARMONICS)
        covariance = determined(found.regression.covariance, np.eye(len(start))[:, lost])
        return replace(found, regression=replace(found.regression, covariance=covariance))
    if not needs_simulator:
        return found
    if law.acts_across or law.mean_free:
        # only the measured motion across is known; and where nothing holds their mean, steady states drift
        return _descended(found)
    # the corners of a memory are its force's, not jumps: what it misses is not theirs
    if law.remembers and (runs_away(found) or law_misses(found)):
        return found
    # a law that feeds energy settles nowhere, and one that misses by far is not mended by exact corners
    feeds = observed.mode(found.background).feed_exciter
    hidden = found.regression.sigma > MISFIT_OF_NOISE and found.hidden_by_noise.any()
    if not (feeds or hidden) and attained < found.regression.rms_misfit < MISFIT_REJECTED:
        simulated = _refit_with_simulator(found)
        if law.remembers and simulated is not found:
            # where it did not converge the balance would not either, and lose points on its way
            return simulated
        found = simulated
    return _descended(found)


def _descended(found: Fit) -> Fit:
    """Return the fit at its least misfit, where the balance was left to the simulator after a step."""
    if found.regression.converged:
        return found
    start = found.regression.parameters
    return fit_balance(found.problem, start, order=found.order, compared=BALANCE_HARMONICS)


def _balance(problem: Problem, parameters: Array) -> tuple[Fit, bool]:
    """Return the fit with all harmonics that matter, and whether only the simulator has all of them.

    The simulator is needed where a law jumps or has corners of its own (``rough``), and where the motion is
    far from a sine (``strong``); for a law with memory only if more harmonics move a value, and settle it in
    a few steps: else the fit counts as not converged. A law with switches needs it also for a misfit below
    what a balance leaves, none for one below the simulator's own accuracy. For other laws harmonics are added
    until the last no longer matters. A long test decides this on ``SUBSAMPLE_POINTS``, and all its points are
    fitted at the end.
    """
    law = problem.law
    points = problem.observed.mode(problem.split(parameters)[2])
    few = problem.select(points.spread(SUBSAMPLE_POINTS)) if len(points) > 2 * SUBSAMPLE_POINTS else problem
    balance = partial(fit_balance, compared=BALANCE_HARMONICS, correct=few is problem)
    needs_simulator = law.rough or points.strong
    corners, settles = needs_simulator or law.switched, True
    smooth = _ORDERS_TRIED if law.remembers else (_FEW_HARMONICS, *_ORDERS_TRIED)
    for order in (_HARMONICS_OF_CORNERS,) if corners else smooth:
        refined = balance(few, parameters, order=order)
        parameters = refined.regression.parameters
        if _has_all_harmonics(refined, order, len(points)):
            break
    if law.remembers and needs_simulator and refined.regression.sigma > _ACCURACIES[0]:
        # a memory takes the simulator hundreds of cycles to settle: more harmonics first
        higher = min(more for more in _ORDERS_TRIED if more > order)
        used = few.select(np.flatnonzero(refined.regression.used))
        more = balance(used, parameters, order=higher, exclude=False, steps=NEAR_STEPS).regression
        share = len(few.observed.points) / len(points)
        alike = _alike(refined.regression, more, share)
        # the test does not tell a value that they do not settle, and the simulator would seek it for minutes
        settles, needs_simulator = alike or more.converged, not alike and more.converged
        if alike:
            refined, order = balance(few, parameters, order=higher), higher
            parameters = refined.regression.parameters
    noise = refined.regression.sigma
    needs_simulator |= law.switched and noise < _ACCURACIES[0]
    needs_simulator &= noise > _ACCURACIES[-1]
    if few is not problem:
        # what the simulator takes up needs no more than one step, and a law that misses by far creeps
        misses = refined.regression.rms_misfit > MISFIT_REJECTED
        needs_simulator &= not misses
        steps = 1 if needs_simulator else NEAR_STEPS if misses else MAX_NEWTON_STEPS
        refined = balance(problem, parameters, order=order, correct=True, steps=steps, near=noise)
    found = refined.regression
    found = replace(found, converged=found.converged and settles)
    return replace(refined, regression=found), needs_simulator


def _has_all_harmonics(found: Fit, order: int, count: int) -> bool:
    """Return True if the last harmonics are below the noise of ``count`` points, or the law misses by far.

    Those of a smooth law decay like a geometric series, so that few tell how large the next ones are.
    """
    harmonics = np.abs(found.harmonics[found.regression.used, : order + 1])
    higher = harmonics[:, 2:] / harmonics[:, 1:2]
    last = float(np.max(higher[:, -2:], initial=0.0))
    if order == _FEW_HARMONICS:
        last *= last / max(float(np.max(higher[:, :2], initial=0.0)), HARMONIC_TRUNCATION)
    enough = last < max(HARMONIC_TRUNCATION, 1e-3 * found.regression.sigma / np.sqrt(count))
    # harmonics do not mend a law that misses by far, and its fits creep
    return enough or found.regression.rms_misfit > MISFIT_REJECTED


def _alike(one: Regression, other: Regression, share: float) -> bool:
    """Return True if more harmonics predict all points, and move no value (``MAX_SHIFT_TO_ERROR``).

    ``share`` of the points were fitted; the errors are those of all.
    """
    if np.count_nonzero(other.used) < np.count_nonzero(one.used):
        return False
    error = np.sqrt(np.diag(one.covariance) * share)
    moved = np.abs(one.parameters - other.parameters)
    known = np.isfinite(error) & (error > 0)
    return bool(known.any() and np.all(moved[known] < MAX_SHIFT_TO_ERROR * error[known]))


def _refit_with_simulator(balanced: Fit) -> Fit:
    """Replace the balance by the simulator where the law has jumps or corners.

    It drives with a sine: where harmonics of the force matter more than corners, the balance leaves less. A
    balance at amplitudes that were held knows no folds, where a driven motion is lost.
    """
    problem = balanced.problem
    accuracy = _ACCURACIES[0]
    few = problem.observed.mode(balanced.background).spread(SUBSAMPLE_POINTS)
    part = balanced.select(few)
    quick = fit_simulator(part.problem, part, accuracy=accuracy)
    lost = quick is None or _loses_held(quick, part)
    if quick is not None and problem.law.remembers and not quick.regression.converged:
        # a value that neither orders nor the simulator settle, as one that grows without end, has no interval
        worse = lost or quick.regression.rms_misfit > balanced.regression.rms_misfit
        best = balanced if worse or len(few) < len(balanced.force) else quick
        return replace(best, regression=replace(best.regression, converged=False))
    if quick is None or lost:
        # nor would it follow enough of all points
        return balanced
    by_chance = f_quantile(quick.regression.freedom, quick.regression.freedom, (1 + SIGNIFICANCE_LEVEL) / 2)
    gain = (balanced.regression.rms_misfit / quick.regression.rms_misfit) ** 2
    start, values = balanced, quick.regression.parameters
    if gain > by_chance:
        # the balance missed, and forces that it has at its values may lie beyond a fold at these
        start = fit_balance(problem, values, order=balanced.order, compared=BALANCE_HARMONICS, steps=0)
    near = replace(start.regression, parameters=values, sigma=quick.regression.sigma)
    start = replace(start, regression=near)
    if quick.regression.sigma < _RESOLVED * accuracy:
        accuracy = _ACCURACIES[1]
    all_points = len(few) == len(balanced.force)
    quick_suffices = all_points and accuracy == _ACCURACIES[0]
    if not quick_suffices and law_misses(quick) and gain <= by_chance:
        # exact corners are not what it misses, and all points would take minutes
        return balanced
    refitted = quick if quick_suffices else fit_simulator(problem, start, accuracy=accuracy)
    if all_points and problem.law.remembers and not (refitted and refitted.regression.converged):
        # the coarser accuracy has settled the values
        refitted = quick
    if refitted is None or _loses_held(refitted, balanced):
        return balanced
    both = refitted.regression.used & balanced.regression.used
    misfit = [float(np.sqrt(np.mean(found.regression.misfit[both] ** 2))) for found in (refitted, balanced)]
    # beyond chance a worse fit follows other branches
    freedom = refitted.regression.freedom
    by_chance = f_quantile(freedom, freedom, (1 + SIGNIFICANCE_LEVEL) / 2)
    return refitted if misfit[0] ** 2 <= by_chance * misfit[1] ** 2 else balanced


def _loses_held(found: Fit, balanced: Fit) -> bool:
    """Return True if the simulator does not predict points of the balance, and each level held a response."""
    lost = np.isnan(found.regression.misfit) & balanced.regression.used
    return bool(lost.any() and np.isfinite(held_amplitudes(found.problem.observed.points)).all())


# what a trial makes infinite or undefined has no prediction there, and is dealt with as such
@known_arguments
@np.errstate(all="ignore")
def identify(
    surface: ResponseSurface | MultisineSpectra,
    law: Model | LawLike | Sequence[LawLike],
    observation: Observation | None = None,
    *,
    mass: float | None = None,
    fixed: Mapping[str, float] = MappingProxyType({}),
    mass_error: float | None = None,
) -> Identification:
    """Identify every parameter of a law, and the mass, but for those that are fixed.

    Parameters
    ----------
    surface
        Settled points of any test; unsettled and held-out ones are not used. Spectra of a multisine give a
        ``MultisineIdentification``.
    law
        Without values: a formula, an element, a law, a sequence of these, or a model.
    observation
        How the structure was observed; None: as the model says.
    mass
        m [kg] where it is known, as ``fixed={"m": mass}``; None: as the model says, and to be identified
        where that says nothing. Of a driven base, whose force is one per mass, parameters without it are per
        unit mass.
    fixed
        Values [SI] of parameters that are known beforehand, by name. No kernel is compiled anew for them.
    mass_error
        Standard error [kg] of a given mass that was weighed: the mass is identified from that, too.

    Returns
    -------
    Identification
        A parameter that is not identifiable is NaN with a finding, never an exception.

    Raises
    ------
    RsgenError
        A held-out level is not in the surface, fewer than four points can be used, or what is fixed is no
        parameter or must be positive.
    """
    model = join_model(law, observation, mass, fixed, mass_error)
    if isinstance(surface, MultisineSpectra):
        records = rsgen.identification.identify_multisine(*per_unit_mass(surface, model))
        return _with_held_out(records, records.spectra, predict_records(records))
    require(surface, ResponseSurface, "surface")
    return identify_points(surface, model)


def _with_held_out(
    found: Identification, test: ResponseSurface | MultisineSpectra, scored: Prediction
) -> Identification:
    """An identification with what the levels that it has not seen say of it: they are part of its verdict."""
    held_out = (*scored.held_out, *scored.records)
    findings = (*found.findings, *scored.findings)
    return changed(found, findings=tuple(with_label(test, one) for one in findings), held_out=held_out)


def identify_points(
    surface: ResponseSurface, model: Model, attained: float = 0.0, most: int = 0
) -> Identification:
    """Identify from a surface, as a ranking settles its best law, or describes one that does not fit.

    The simulator is not asked for less than the misfit ``attained``, relative to force and response. On
    ``most`` points, if it is not 0, levels are not predicted.
    """
    surface, model = per_unit_mass(without_copies(checked(surface)), model)
    found, centred = _identify(surface, model, attained, most), without_offset(surface)
    if centred is not surface and found.fit is not None and found.fit.systematic:
        # a law with a place of rest of its own explains the mean; where it does not, the sensor's zero may
        other = _identify(centred, model, attained, most)
        if other.residual < (1 - MIN_MISFIT_REDUCTION) * found.residual:
            found, surface = other, centred
    return found if most else _with_held_out(found, surface, predict_held_out(found, surface))


def checked(surface: ResponseSurface) -> ResponseSurface:
    """Return a test whose base and rows are checked: those of files were when they were read."""
    if surface.per_mass and surface.base and not is_misread(surface):
        misread = base_findings(surface, absolute=False, senses=False)
        surface = replace(surface, findings=(*surface.findings, *misread))
    rows = row_findings(surface)
    return replace(surface, findings=(*surface.findings, *rows)) if rows else surface


def _is_beyond_any_law(problem: Problem) -> bool:
    """Return True if no law of one motion explains the points: a background or a second motion may."""
    observed, law = problem.observed, problem.law
    points = observed.points
    if law.acts_across or not points.phase_known or observed.background.kind != "none":
        return False
    return is_beyond_any_law(points.force, points.harmonics[:, 1], points.omega)


def _identify(surface: ResponseSurface, model: Model, attained: float, most: int) -> Identification:
    test = prepare(surface, model)
    if 0 < most < len(test.points):
        test = replace(test, problem=test.problem.select(test.points.spread(most)))
    points = test.points
    noise = points.in_noise
    problem, start = start_fit(test.problem.select(np.flatnonzero(~noise)))
    held = held_points(test.problem, start, noise)
    findings = [held_finding(points, held, surface)] if held.any() else []
    if np.any(held != noise):
        problem, start = start_fit(test.problem.select(np.flatnonzero(~held)))
    # where no law fits refining one has no end
    coarse = partial(fit_balance, order=BALANCE_HARMONICS, steps=_STEPS_IF_MISREAD)
    no_law_fits = is_misread(surface) or _is_beyond_any_law(problem)
    fit = coarse(problem, start) if no_law_fits else fit_all_harmonics(problem, start, attained)
    late = fit.passed_late
    if late.any() and not no_law_fits:
        fit = fit_all_harmonics(problem.select(np.flatnonzero(~late)), fit.regression.parameters, attained)
        findings.append(left_out("symmetry", problem.observed.points, late, surface.level_unit))
    found = judge(replace(test, problem=fit.problem), model, fit)
    return changed(found, findings=(*found.findings, *findings))
