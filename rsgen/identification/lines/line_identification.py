"""Identification of a law from a periodic multisine, and prediction of records.

    minimise over p, m:  sum over lines h and records of |F_h - m (i h omega0)^2 X_h - N_h(p)|^2 / variance_h

is solved by ``line_fit``; here records and lines are selected and the fit becomes a result (``_assemble``).
Its errors are those of the scatter of the periods, or of a jackknife over parts of the band where the misfit
is more than noise; missing terms and larger backgrounds widen them (``results.alternatives``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf, isfinite, nan

import numpy as np

from rsgen.common.arrays import Array, frozen_array
from rsgen.common.errors import RsgenError, require
from rsgen.common.finding import Finding, Quantity, Severity, quantities, severity_of
from rsgen.common.tolerances import (
    MIN_MISFIT_REDUCTION,
    MIN_SIGNIFICANT_GAIN,
    MISFIT_DOUBTFUL,
    MISFIT_DOUBTFUL_WITHOUT_PATTERN,
    MISFIT_NEGLIGIBLE,
    MISFIT_REJECTED,
    NOISE_LIMIT_SIGMAS,
    OUTLIER_SIGMAS,
    RELATIVE_CHANGE_NEGLIGIBLE,
    RELATIVE_ERROR_DOUBTFUL,
)
from rsgen.data.multisine import BestLinear, MultisineSpectra, best_linear, implausible
from rsgen.data.multisine.spectra import check_records
from rsgen.data.oscillator import Model
from rsgen.dynamics.linear_part import background_of_lines
from rsgen.dynamics.periodic_response import periodic_response
from rsgen.formula.units import UNCALIBRATED
from rsgen.identification.fitting.across import law_of
from rsgen.identification.fitting.fit import Solution
from rsgen.identification.fitting.least_squares import Alternative
from rsgen.identification.lines.line_balance import Balance, SpectralLines, select_lines
from rsgen.identification.lines.line_fit import (
    LineFit,
    band_parts,
    channel_delay,
    fit_fixed_parameters,
    fit_larger_backgrounds,
    fit_lines,
    fit_missing_terms,
    fit_second_sensor,
    largest_gain_step,
    misfit_to_noise,
    parameter_covariance,
    relative_to_force,
    start_values,
)
from rsgen.identification.misfit import background_findings
from rsgen.identification.prediction.prediction_result import (
    BEYOND,
    PredictedRecord,
    Prediction,
    severity_of_error,
)
from rsgen.identification.profile import with_line_profiles
from rsgen.identification.results import (
    Background,
    EquivalentCurve,
    Estimate,
    MultisineIdentification,
    Resonance,
    units_of,
)
from rsgen.identification.results.alternatives import Alternatives
from rsgen.identification.results.estimates import (
    damping_findings,
    fixed_contradicted,
    make_estimates,
    parameter_findings,
    phase_findings,
    state_background,
)
from rsgen.identification.soundness import gain_findings, signs_along
from rsgen.law.motion import Motion
from rsgen.law.numeric import put_in_order


def identify_multisine(spectra: MultisineSpectra, model: Model) -> MultisineIdentification:
    """Identify every parameter of a law, and the mass where it is not given, from periodic records.

    Parameters
    ----------
    spectra
        Force and displacement by record, period and line.
    model
        Laws without values; its observation holds levels out and limits the band.

    Raises
    ------
    RsgenError
        A held-out level is not in the records, or nothing is left.
    """
    fit = fit_multisine(spectra, model)
    with np.errstate(all="ignore"):
        return _assemble(spectra, model, fit)


def fit_multisine(spectra: MultisineSpectra, model: Model) -> LineFit:
    """Fit a law to the lines of the records that are not held out; raise as ``identify_multisine``."""
    observation = model.observation
    held_out = check_records(spectra, observation)
    part = spectra.select(np.flatnonzero(~held_out))
    law = law_of(model.elements, part.means)
    lines = select_lines(part, observation, switched=law.switched, share=law.parts[-1].share)
    count = int(lines.used.sum())
    if 2 * count <= len(law.parameters) + 1 + len(lines.subtracted):
        raise RsgenError(f"identify.band: {count} lines in it; more lines than parameters are needed")
    with np.errstate(all="ignore"):
        values, mass = start_values(lines, law, model.fixed)
        return fit_lines(lines, law, model.fixed, put_in_order(law, values, model.fixed), mass)


def _assemble(spectra: MultisineSpectra, model: Model, fit: LineFit) -> MultisineIdentification:
    """Return a fit as a result: errors by noise, wider ones by alternatives, estimates, findings."""
    lines, law, part = fit.mode, fit.law, fit.mode.spectra
    names, units = (*law.parameters, "m"), units_of(model, part.units)
    misfit = relative_to_force(lines, np.abs(fit.balance.residual) ** 2)
    noise = relative_to_force(lines, fit.noise.variance)
    # errors by the scatter of the periods, or the parts of the band where the misfit is more than noise
    with_background, freedom, widening = parameter_covariance(fit)
    by_noise = with_background[: len(names), : len(names)]
    # and by what else may be the law, or in the response
    kinds = {
        "term": fit_missing_terms(fit),
        "background": fit_larger_backgrounds(fit),
        "background of the second sensor": fit_second_sensor(fit),
    }
    others = Alternatives(names, np.sqrt(np.diag(by_noise)), kinds)
    ratio, ambiguous = others.judge(fit.parameters[: len(names)], misfit)
    covariance = by_noise * np.outer(ratio, ratio)
    stated = np.where(fit.converged, covariance, nan)

    amplitudes = np.sqrt(2) * part.rms_response()
    tested = {
        "amplitude": Quantity(float(amplitudes.max()), "m"),
        "level": Quantity(float(part.levels.max()), part.level_unit),
    }
    regression = replace(fit.regression.first(len(names)), covariance=covariance)
    reasons = parameter_findings(names, units, tested, regression, law.expression)
    ambiguous += others.within_noise(regression.parameters, stated, reasons, units)
    solution = Solution(fit.values, fit.mass, covariance, freedom, misfit, fit.converged)
    estimates = with_line_profiles(fit, make_estimates(solution, law, model, reasons, units))
    # the sign of the damping is that of this law: errors by alternative laws do not enter
    of_law = make_estimates(replace(solution, covariance=by_noise), law, model, reasons, units)
    background = fitted_background(fit, with_background, freedom)
    approximations = best_linear(part, model.observation.band)
    resonances = tuple(map(_resonance, approximations))
    curve = _curve(resonances, part)
    if not model.observation.calibrated:
        curve = replace(curve, units=UNCALIBRATED)
    of_background = np.diag(with_background)[len(names) :]
    findings = [
        *(e.finding for e in estimates if e.finding is not None),
        *_sign_findings(fit, covariance),
        *_misfit_findings(fit, misfit, noise, widening, others),
        *(_fixed_findings(fit, kinds["term"], misfit) or ambiguous),
        *_part_findings(fit, covariance, of_law),
        *_damping_findings(fit, misfit, noise, others),
        *_delay_findings(fit, misfit),
        *phase_findings(fit.background),
        *gain_findings(lines.background, fit.background, of_background, fit.mass),
        *_drift_findings(fit, skipped=int(np.asarray(part.left_out).max(initial=0))),
        *_hidden_line_findings(lines),
        *spectra.findings,
        *spectra.limits,
        *([] if fit.converged else [Finding("not-converged", "doubt")]),
    ]
    if model.observation.calibrated:
        ratios = [linear.damping_ratio for linear in approximations if linear.damping_ratio > 0]
        mass = fit.mass if np.isfinite(covariance).all() else nan
        findings += implausible(spectra, mass=mass, damping=min(ratios, default=nan))
    else:
        findings.append(Finding("not-calibrated", "info"))
    findings += () if background is None else background.findings
    free = np.flatnonzero(fit.free[: len(names)])
    unknown = tuple(Estimate(e.name, nan, inf, (-inf, inf), e.unit) for e in estimates)
    return MultisineIdentification(
        model=model,
        paper=unknown,
        first_order=unknown,
        refined=estimates,
        first_order_bias=(nan,) * len(estimates),
        covariance=stated[np.ix_(free, free)],
        resonances=resonances,
        curve=curve,
        residual=misfit,
        noise=noise,
        levels=part.levels,
        amplitude_range=(float(amplitudes.min()), float(amplitudes.max())),
        frequency_range=lines.band,
        outcome=_outcome(lines, estimates, misfit),
        findings=tuple(findings),
        solution=fit.values,
        background=background,
        alternatives=others,
        spectra=spectra,
        approximations=approximations,
        used=frozen_array(lines.used, np.bool_),
        misfit=frozen_array(fit.balance.residual, np.complex128),
        deviation=frozen_array(np.sqrt(fit.noise.variance)),
    )


def _part_findings(fit: LineFit, covariance: Array, estimates: tuple[Estimate, ...]) -> list[Finding]:
    """Find dampers that feed energy and wrong signs, of the law along the response and of a joint."""
    lines, part, found = fit.mode, fit.mode.spectra, list[Finding]()
    motions = [Motion(np.full(len(part), part.omega0), part.mean_response)]
    if lines.far is not None:
        across = lines.far.mean(axis=1) + fit.law.parts[1].share * part.mean_response
        motions.append(replace(motions[0], harmonics=across))
    for one, motion in zip(fit.law.parts, motions, strict=True):
        found += damping_findings(one.law, motion, fit.values[one.parameters], estimates)
        if fit.law.acts_across:
            # neither part can compensate a wrong sign of the other
            found += signs_along(one, motion, fit.values, _basis(fit, covariance), slice(1, None))
    return found


def _hidden_line_findings(lines: SpectralLines) -> list[Finding]:
    """Say below which frequency noise hides the response, so that the law gives it; none or one."""
    if not (lines.lowest > 1).any():
        return []
    below = Quantity(float(np.max(lines.spectra.omega[:, 1] * lines.lowest)) / (2 * np.pi), "Hz")
    return [Finding("motion-by-law", "info", numbers={"below": below})]


def _fixed_findings(fit: LineFit, terms: Mapping[str, Alternative], misfit: float) -> list[Finding]:
    """Find fixed values that the lines contradict more than they contradict the lack of any term."""
    least = max(MIN_SIGNIFICANT_GAIN, *(term.gain for term in terms.values()))
    found = []
    for name, free in fit_fixed_parameters(fit).items():
        fixed = fit.fixed[name]
        if free.gain >= least and abs(free.value) >= RELATIVE_CHANGE_NEGLIGIBLE * abs(fixed):
            left, times = misfit * _share_left(fit, free), float(np.sqrt(free.gain))
            found.append(fixed_contradicted(name, fixed, free.value, misfit=misfit, left=left, times=times))
    return found


def _outcome(lines: SpectralLines, estimates: tuple[Estimate, ...], misfit: float) -> Finding:
    """Summarise the numbers of identified parameters, lines, records and levels."""
    numbers = quantities(
        identified=sum(e.identifiable and isfinite(e.standard_error) for e in estimates),
        parameters=len(estimates),
        lines=int(lines.used.sum()),
        excited=int((lines.used & lines.spectra.excited()).sum()),
        records=len(lines.spectra),
        levels=len(lines.spectra.levels),
        misfit=misfit,
    )
    return Finding("identified", "info", numbers=numbers)


def _resonance(found: BestLinear) -> Resonance:
    """Return the mode of the best linear approximation of a level."""
    natural = 2 * np.pi * found.natural_frequency
    return Resonance(
        level=found.level,
        sweep="rest",
        frequency=found.natural_frequency,
        damping_ratio=found.damping_ratio,
        amplitude=float(np.sqrt(2) * found.rms),
        stiffness=found.stiffness,
        damping=2 * found.damping_ratio * found.mass * natural,
    )


def _basis(fit: LineFit, covariance: Array) -> Array:
    """Return a basis (q, r) of the errors of all values, as wide as their covariance (q, q) says."""
    basis = fit.regression.basis[: len(covariance)]
    known = np.linalg.norm(basis, axis=1)
    wider = np.sqrt(np.diag(covariance)) / np.where(known > 0, known, np.inf)
    return basis * np.where(np.isfinite(wider), wider, 1)[:, None]


def _curve(resonances: tuple[Resonance, ...], part: MultisineSpectra) -> EquivalentCurve:
    """Return equivalent stiffness and damping of each level at its resonance."""
    amplitude, frequency, level, stiffness, damping = (
        np.array([getattr(point, name) for point in resonances])
        for name in ("amplitude", "frequency", "level", "stiffness", "damping")
    )
    used = np.ones(len(resonances), dtype=bool)
    return EquivalentCurve(amplitude, frequency, level, stiffness, damping, used, part.level_unit, part.units)


def lines_feed_exciter(fit: LineFit) -> bool:
    """Return True if a record's response would feed energy into the exciter, beyond noise."""
    lines, part = fit.mode, fit.mode.spectra
    # (r,) mean power of the force, and its standard deviation by the noise of force and response
    velocity = lines.rate * part.mean_response
    power = 0.5 * np.sum((part.mean_force * np.conj(velocity)).real * lines.used, axis=1)
    force, response = map(np.nan_to_num, part.noise())
    variance = np.abs(velocity) ** 2 * force**2 + np.abs(part.mean_force * lines.rate) ** 2 * response**2
    limit = NOISE_LIMIT_SIGMAS * np.sqrt(0.5 * np.sum(variance * lines.used, axis=1))
    return bool(np.any(power < -limit))


def _sign_findings(fit: LineFit, covariance: Array) -> list[Finding]:
    """Find a structure that feeds energy into the exciter, and a negative mass, both beyond noise."""
    found = [Finding("structure-feeds-exciter", "error")] if lines_feed_exciter(fit) else []
    if fit.mass < -NOISE_LIMIT_SIGMAS * float(np.nan_to_num(np.sqrt(covariance[-1, -1]))):
        found.append(Finding("mass-negative", "error", "m", {"mass": Quantity(fit.mass, "kg")}))
    return found


def _delay_findings(fit: LineFit, misfit: float) -> list[Finding]:
    """Find a delay between force and response that explains most of the misfit; none or one."""
    delay, error, ratio = channel_delay(fit)
    if misfit < MISFIT_NEGLIGIBLE or ratio > 1 - MIN_MISFIT_REDUCTION or abs(delay) < OUTLIER_SIGMAS * error:
        return []
    numbers = quantities(delay=Quantity(delay, "s"), left=ratio * misfit, misfit=misfit)
    return [Finding("channels-delayed", "doubt", numbers=numbers)]


def _drift_findings(fit: LineFit, skipped: int) -> list[Finding]:
    """Find a gain that changes within a record whose first ``skipped`` periods were not used; none or one."""
    first, size, z = largest_gain_step(fit)
    if z < OUTLIER_SIGMAS:
        return []
    severity: Severity = "doubt" if size > RELATIVE_CHANGE_NEGLIGIBLE else "warning"
    names = {"parts": f"the periods from number {skipped + first + 1} on, and those before"}
    return [Finding("parts-disagree", severity, "", quantities(z=z, size=size), names)]


def _is_noise(fit: LineFit, others: Alternatives) -> bool:
    """Decide whether a misfit is noise: by the scatter of the periods, or of one period by alternatives, each
    of which takes up some of what any law or background leaves.
    """
    if fit.lines.spectra.periods == 1:
        return not others.any_stands_out
    return not fit.systematic


def _damping_findings(fit: LineFit, misfit: float, noise: float, others: Alternatives) -> list[Finding]:
    """Find a misfit beyond noise that is small relative to the force, but not relative to the damping force.

    At the resonance the damping balances the force of a sine. In a multisine springs and inertia balance most
    of the lines, so that a missing damping term leaves a small misfit and changes the other damping values.
    """
    if misfit > MISFIT_DOUBTFUL or _is_noise(fit, others):
        return []
    share = relative_to_force(fit.lines, Balance.damping(fit.mode, fit.law, fit.values, fit.mass))
    systematic = float(np.sqrt(max(misfit**2 - np.nan_to_num(noise) ** 2, 0.0)))
    # the damping share of a law with memory is NaN: no finding
    if not systematic > max(RELATIVE_ERROR_DOUBTFUL * share, 0.0 if share else MISFIT_NEGLIGIBLE):
        return []
    numbers = quantities(misfit=misfit, **({"share": systematic / share} if share else {}))
    return [Finding("damping-hidden-by-misfit", "doubt", numbers=numbers)]


def fitted_background(fit: LineFit, covariance: Array, freedom: int) -> Background | None:
    """Return the background of a fit with the covariance (q, q) of its parameters; None without one."""
    lines, count = fit.lines, len(fit.background)
    variance = np.diag(covariance)[len(fit.values) + 1 :]
    return state_background(
        lines.background,
        np.where(lines.used, lines.spectra.mean_force, 0).reshape(-1),
        np.where(lines.used, np.abs(lines.spectra.mean_response), 0).reshape(-1),
        fit.background,
        variance if fit.converged else np.full(count, inf),
        freedom,
        lines.spectra.units,
    )


def _misfit_findings(
    fit: LineFit, misfit: float, noise: float, widening: float, others: Alternatives
) -> list[Finding]:
    """Compare the misfit with the noise, and with what is acceptable for a law."""
    one_period, ratio = not np.isfinite(noise), misfit_to_noise(fit)
    found = [Finding("multisine-periods", "warning", numbers=quantities(periods=1))] if one_period else []
    # a misfit of exact data exceeds the noise, which is zero there
    if _is_noise(fit, others) or misfit < MISFIT_NEGLIGIBLE:
        # scatter of the periods is in every interval, so that noise alone is doubted late
        limits = (MISFIT_DOUBTFUL_WITHOUT_PATTERN, MISFIT_REJECTED) if one_period else (MISFIT_REJECTED, inf)
        large = Finding("misfit-large", severity_of(misfit, *limits), numbers=quantities(misfit=misfit))
        return [*found, large] if misfit > MISFIT_DOUBTFUL_WITHOUT_PATTERN else found
    severity = severity_of(misfit, MISFIT_DOUBTFUL, MISFIT_REJECTED)
    size = quantities(misfit=misfit, **({} if one_period else {"times": ratio}))
    parts = quantities(wider=widening, groups=int(band_parts(fit.lines).max()) + 1)
    found += [
        Finding("law-does-not-fit", severity, numbers=size),
        Finding("intervals-widened", "warning", numbers=parts, names={"by": "parts of the band"}),
    ]
    terms, more = (
        {name: misfit * _share_left(fit, one) for name, one in others.kinds[kind].items()}
        for kind in ("term", "background")
    )
    if more:
        kind, backgrounds = fit.lines.background.kind, others.kinds["background"]
        left, known = min(terms.values()), fit.regression.first(len(others.names))
        found += background_findings(kind, backgrounds, more, known, others.names, misfit=misfit, left=left)
    return found


def _share_left(fit: LineFit, other: Alternative) -> float:
    """Return the share of the misfit that an alternative leaves."""
    used = fit.lines.used
    square = np.sum(np.abs(fit.balance.residual[used]) ** 2 * 2 / fit.variance[used])
    return float(np.sqrt(max(1 - other.gain / square, 0.0)))


# ----------------------------------------------------------------------------
# Prediction: m x'' + n(x, x') = f(t) for a periodic x under the measured force of a record, compared with the
# measured response.


def predict_multisine(found: MultisineIdentification, spectra: MultisineSpectra | None = None) -> Prediction:
    """Predict the periodic responses to the measured forces of records, and score them.

    Parameters
    ----------
    found
        Its refined estimate is used.
    spectra
        Records; None: those of the held-out levels.

    Raises
    ------
    RsgenError
        The spectra are none.
    """
    own = found.spectra
    if spectra is None or spectra is own:
        mask = own.held_out(found.model.observation.hold_out)
        spectra = own.select(np.flatnonzero(mask)) if mask.any() else None
    if spectra is None:
        return Prediction((), (), ())
    require(spectra, MultisineSpectra, "surface")
    spectra = spectra.on_mass(found.mass)
    records = tuple(_predicted_record(found, spectra, i) for i in range(len(spectra)))
    findings = _prediction_findings(found, records, np.sqrt(2) * spectra.rms_response())
    if found.model.sensors:
        findings.append(Finding("predicted-along-measured", "info", names={"sensors": found.model.sensors}))
    return Prediction((), (), tuple(findings), records)


def _predicted_record(found: MultisineIdentification, spectra: MultisineSpectra, row: int) -> PredictedRecord:
    """Predict the response to the measured force of a record, and its error over the band.

    Of two sensors the motion across is as measured; lines that are not of the mode are added as measured.
    """
    spectra, background = spectra.select([row]), found.background
    law, start = law_of(found.model.elements, spectra.means), None
    far = spectra.far(law.parts[-1].share)
    mode, measured = spectra, spectra.mean_response[0]
    if background is not None:
        terms = background_of_lines(background.kind, spectra, background.band)
        mode = terms.mode_of(spectra, background.values)
    force = mode.mean_force[0]
    if not spectra.mean_known:
        # a sensor without mean: the force has none either, as identification takes it
        force[0] = 0.0
    if far is not None:
        start, far = (
            np.where(spectra.lines < spectra.reach()[0], 0, mode.mean_response[0]),
            far[0].mean(axis=0),
        )
    response = periodic_response(
        law, found.solution, found.mass, float(spectra.omega[0, 1]), force, start, far
    )
    # what is not of the mode is added as it was measured
    seen = response.spectrum + (measured - mode.mean_response[0])
    predicted = seen if response.converged else np.full(len(force), nan + 0j)
    low, high = found.model.observation.band or (0.0, inf)
    frequency = spectra.omega[0] / (2 * np.pi)
    judged = (frequency >= low) & (frequency <= high) & spectra.recorded[0]
    judged &= spectra.lines >= spectra.reach()[0][0]
    size = float(np.linalg.norm(measured[judged])) or nan
    error = float(np.linalg.norm((predicted - measured)[judged])) / size
    noise = float(np.linalg.norm(spectra.noise()[1][0][judged])) / size
    level = float(spectra.level[0])
    return PredictedRecord(level, frequency, measured, predicted, judged, error, noise, spectra.level_unit)


def _prediction_findings(
    found: MultisineIdentification, records: tuple[PredictedRecord, ...], amplitudes: Array
) -> list[Finding]:
    findings = []
    reach = BEYOND * found.amplitude_range[1]
    for one, amplitude in zip(records, map(float, amplitudes), strict=True):
        level = Quantity(one.level, one.level_unit)
        if not np.isfinite(one.error):
            findings.append(Finding("no-steady-state", "doubt", numbers=quantities(level=level)))
            continue
        if amplitude > reach:
            tested = Quantity(found.amplitude_range[1], "m")
            numbers = quantities(level=level, amplitude=Quantity(amplitude, "m"), high=tested)
            findings.append(Finding("prediction-extrapolated", "warning", numbers=numbers))
        if severity := severity_of_error(one.error):
            numbers = quantities(level=level, error=one.error, misfit=found.residual)
            findings.append(Finding("held-out-missed", severity, numbers=numbers))
    return findings
