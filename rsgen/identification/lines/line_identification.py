"""Identification of a law from a periodic multisine, and prediction of records.

    minimise over p, m:  sum over lines h and records of |F_h - m (i h omega0)^2 X_h - N_h(p)|^2 / variance_h

is solved by ``line_fit``; here records and lines are selected and the fit becomes a result (``_assemble``).
Its errors are those of the scatter of the periods, or of a jackknife over parts of the band where the misfit
is more than noise; missing terms and larger backgrounds widen them (``results.alternatives``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import inf, nan

import numpy as np

from rsgen.common.arrays import Array, frozen_array
from rsgen.common.errors import RsgenError, listed, require
from rsgen.common.finding import Finding, Quantity, Severity, quantities, severity_of
from rsgen.common.tolerances import (
    HELD_OUT_ERROR_DOUBTFUL,
    HELD_OUT_ERROR_REJECTED,
    HELD_OUT_ERROR_SMALL,
    MAX_NEWTON_STEPS,
    MIN_MISFIT_REDUCTION,
    MIN_SIGNIFICANT_GAIN,
    MISFIT_DOUBTFUL_PATTERN_UNSEEN,
    MISFIT_DOUBTFUL_WITHOUT_PATTERN,
    MISFIT_NEGLIGIBLE,
    MISFIT_REJECTED,
    NEAR_STEPS,
    NOISE_LIMIT_SIGMAS,
    OUTLIER_SIGMAS,
    RELATIVE_CHANGE_NEGLIGIBLE,
    RELATIVE_ERROR_DOUBTFUL,
    is_significant,
)
from rsgen.data.multisine.linear import BestLinear, best_linear, implausible, misread_lines
from rsgen.data.multisine.spectra import MultisineSpectra, check_records, rms
from rsgen.data.oscillator import Model, force_units
from rsgen.data.surface.mode_findings import fixed_contradicted
from rsgen.dynamics.linear_part import background_of_lines
from rsgen.dynamics.periodic_response import periodic_response
from rsgen.formula.units import ForceUnits
from rsgen.identification.fitting.across import law_of
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.lines.line_balance import Balance, SpectralLines, select_lines
from rsgen.identification.lines.line_fit import (
    LineFit,
    band_parts,
    channel_errors,
    fit_fixed_parameters,
    fit_larger_backgrounds,
    fit_lines,
    fit_missing_terms,
    fit_second_sensor,
    largest_gain_step,
    misfit_to_noise,
    relative_to_force,
    start_values,
)
from rsgen.identification.misfit import background_findings
from rsgen.identification.prediction.prediction_result import BEYOND, PredictedRecord, Prediction, named
from rsgen.identification.profile import is_resolved, with_line_profiles
from rsgen.identification.results import (
    Background,
    EquivalentCurve,
    Estimate,
    MultisineIdentification,
    Resonance,
    units_of,
)
from rsgen.identification.results.alternatives import Alternatives, stands_out
from rsgen.identification.results.estimates import (
    Errors,
    Statement,
    damping_findings,
    largest_tested,
    missing_unit_check,
    moves_of,
    outcome_of,
    phase_findings,
    state_background,
    state_parameters,
    with_mass_error,
)
from rsgen.identification.soundness import gain_findings, signs_along
from rsgen.identification.terms import blame_channel
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
    misread = misread_lines(spectra)
    spectra = replace(spectra, findings=(*spectra.findings, *misread))
    # where no law fits refining one has no end
    fit = fit_multisine(spectra, model, NEAR_STEPS if misread else MAX_NEWTON_STEPS)
    with np.errstate(all="ignore"):
        for offset in [] if misread else offset_findings(fit):
            without = replace(spectra, mean_known=False)
            other = fit_multisine(without, model)
            names, errors = (*fit.law.parameters, "m"), np.sqrt(np.diag(fit.errors[0].covariance))
            moved = is_significant(other.parameters - fit.parameters, errors)[: len(names)]
            worse = other.misfit > (1 + RELATIVE_CHANGE_NEGLIGIBLE) * fit.misfit
            # of a law that does not fit, the mean is none of the sensor's
            if worse or other.misfit >= MISFIT_DOUBTFUL_PATTERN_UNSEEN:
                break
            if mean_may_be_offset(spectra):
                zeros, fit = Balance.zeros(other.mode, other.law, other.values, other.mass), other
                differ = {"differ": np.ptp(zeros)} if len(zeros) > 1 else {}
                seen = {**offset.numbers, **quantities("m", offset=np.median(zeros), **differ)}
                spectra = replace(without, findings=(*spectra.findings, replace(offset, numbers=seen)))
            elif moved.any():
                # without the mean of the motion that of the force would be lost, too
                said = {"by": "load", "values": listed([names[i] for i in np.flatnonzero(moved)])}
                doubt = Finding("sensor-offset", "doubt", numbers=offset.numbers, names=said)
                spectra = replace(spectra, findings=(*spectra.findings, doubt))
        return _assemble(spectra, model, fit)


def mean_may_be_offset(spectra: MultisineSpectra) -> bool:
    """Return True if the motion has a recorded mean, and the force none, which would be lost with it."""
    driven = np.abs(spectra.mean_force[:, 0]) > MISFIT_NEGLIGIBLE * rms(spectra.mean_force)
    return spectra.mean_known and spectra.periods > 1 and not spectra.base and not driven.any()


def offset_findings(fit: LineFit) -> list[Finding]:
    """Find that the law along the recorded motion has another mean force than was recorded; none or one.

    The lines above zero do not tell the zero of a displacement: a law of powers has another one of the same
    degree about any other zero.
    """
    law, part = fit.law, fit.mode.spectra
    known = part.mean_known and part.periods > 1 and not part.base
    if not (known and law.springs) or law.remembers or law.acts_across:
        return []
    rest, size = np.abs(fit.balance.residual[:, 0].real), rms(part.mean_force)
    row = int(np.argmax(rest / size))
    if not rest[row] > MISFIT_NEGLIGIBLE * size[row]:
        return []
    slopes = fit.balance.slopes[row, :, 0].real
    variance = float(slopes @ fit.errors[0].covariance @ slopes) + fit.noise.variance[row, 0]
    if not rest[row] > OUTLIER_SIGMAS * np.sqrt(variance):
        return []
    level = Quantity(float(part.level[row]), part.level_unit)
    numbers = {"rest": Quantity(float(rest[row]), part.units.force), "level": level}
    numbers |= quantities(share=rest[row] / size[row])
    return [Finding("sensor-offset", "warning", numbers=numbers, names={"by": "balance"})]


def fit_multisine(spectra: MultisineSpectra, model: Model, steps: int = MAX_NEWTON_STEPS) -> LineFit:
    """Fit a law to the lines of the records that are not held out; raise as ``identify_multisine``."""
    held_out = check_records(spectra, model.observation)
    part = spectra.select(np.flatnonzero(~held_out))
    law = law_of(model.elements, part.means)
    selected = partial(select_lines, part, model, share=law.parts[-1].share)
    lines = selected(switched=law.switched)
    count = int(lines.used.sum())
    if 2 * count <= len(law.parameters) + 1 + len(lines.subtracted):
        raise RsgenError(f"identify.band: {count} lines in it; more lines than parameters are needed")
    with np.errstate(all="ignore"):
        values, mass = start_values(lines, law, model.fixed)
        fit = fit_lines(lines, law, model.fixed, put_in_order(law, values, model.fixed), mass, steps)
        steep = replace(fit, lines=selected(switched=True))
        if law.switched or steps < MAX_NEWTON_STEPS or is_resolved(fit, steep):
            return fit
        longer = fit_lines(steep.lines, law, model.fixed, fit.values, fit.mass)
    return longer if longer.misfit < (1 + RELATIVE_CHANGE_NEGLIGIBLE) * fit.misfit else fit


def _assemble(spectra: MultisineSpectra, model: Model, fit: LineFit) -> MultisineIdentification:
    """Return a fit as a result: errors by noise, wider ones by alternatives, estimates, findings."""
    lines, part = fit.mode, fit.mode.spectra
    errors = with_mass_error(_errors_of(fit), fit.law, model, lines.background.names)
    amplitudes, units = np.sqrt(2) * part.rms_response(), units_of(model, part.units)
    tested = largest_tested(amplitudes, part.levels, part.level_unit)
    stated = state_parameters(errors, fit.law, model, units, tested)
    stated = replace(stated, refined=with_line_profiles(fit, stated.refined))
    background = fitted_background(fit, errors.with_background)
    approximations = best_linear(part, model.observation.band)
    resonances = tuple(map(_resonance, approximations))
    findings = [
        *_findings(fit, errors, stated),
        *spectra.findings,
        *spectra.limits,
        *([] if fit.converged else [Finding("not-converged", "doubt")]),
        *_plausibility(spectra, model, errors, approximations),
        *(() if background is None else background.findings),
    ]
    unknown = tuple(Estimate(e.name, nan, inf, (-inf, inf), e.unit) for e in stated.refined)
    return MultisineIdentification(
        model=model,
        paper=unknown,
        first_order=unknown,
        refined=stated.refined,
        first_order_bias=(nan,) * len(unknown),
        covariance=stated.covariance,
        small_motion=stated.small_motion,
        resonances=resonances,
        curve=_curve(resonances, part, force_units(model, part.units)),
        residual=fit.misfit,
        noise=errors.noise,
        levels=part.levels,
        amplitude_range=(float(amplitudes.min()), float(amplitudes.max())),
        frequency_range=lines.band,
        outcome=outcome_of(
            stated.refined,
            fit.misfit,
            lines=int(lines.used.sum()),
            excited=int((lines.used & part.excited()).sum()),
            records=len(part),
            levels=len(part.levels),
            moves=moves_of(fit.scaled, fit.regression, fit.law, stated, model, spectra),
            missing_check=missing_unit_check(spectra, model, units),
        ),
        findings=tuple(findings),
        solution=fit.values,
        background=background,
        alternatives=errors.others,
        spectra=spectra,
        approximations=approximations,
        used=frozen_array(lines.used, np.bool_),
        misfit=frozen_array(fit.balance.residual, np.complex128),
        deviation=frozen_array(np.sqrt(fit.noise.variance)),
    )


def _errors_of(fit: LineFit) -> Errors:
    """Return the errors by the scatter of the periods, or the parts of the band, and by alternatives."""
    names, (with_background, _) = (*fit.law.parameters, "m"), fit.errors
    kinds = {
        "term": fit_missing_terms(fit),
        "background": fit_larger_backgrounds(fit),
        "background of the second sensor": fit_second_sensor(fit),
    }
    of_law = with_background.first(len(names))
    regression, others, ambiguous = Alternatives.widen(of_law, names, kinds, fit.misfit)
    return Errors(
        regression=regression,
        of_law=of_law.covariance,
        with_background=with_background,
        noise=fit.relative_noise,
        others=others,
        ambiguous=ambiguous,
    )


def _findings(fit: LineFit, errors: Errors, stated: Statement) -> list[Finding]:
    """Find what is to know of the parameters, the misfit, signs, sensors and records of a fit."""
    of_background = np.diag(errors.with_background.covariance)[len(fit.values) + 1 :]
    return [
        *(e.finding for e in stated.refined if e.finding is not None),
        *_sign_findings(fit, errors),
        *_misfit_findings(fit, errors),
        *(_fixed_findings(fit, errors) or stated.ambiguous),
        *_part_findings(fit, errors, stated),
        *_damping_findings(fit, errors),
        *phase_findings(fit.background),
        *gain_findings(fit.lines.background, fit.background, of_background, fit.mass),
        *_drift_findings(fit),
        *_hidden_line_findings(fit.lines),
    ]


def _plausibility(
    spectra: MultisineSpectra, model: Model, errors: Errors, approximations: Sequence[BestLinear]
) -> list[Finding]:
    """Find sizes that no test has, of one that is calibrated."""
    if not model.observation.calibrated:
        return [Finding("not-calibrated", "info")]
    ratios = [linear.damping_ratio for linear in approximations if linear.damping_ratio > 0]
    found = errors.regression
    mass = float(found.parameters[-1]) if np.isfinite(found.covariance).all() else nan
    return list(implausible(spectra, mass=mass, damping=min(ratios, default=nan)))


def _part_findings(fit: LineFit, errors: Errors, stated: Statement) -> list[Finding]:
    """Find dampers that feed energy and wrong signs, of the law along the response and of a joint.

    The sign of the damping is that of this law: errors by alternative laws do not enter.
    """
    lines, part, found = fit.mode, fit.mode.spectra, list[Finding]()
    motions = [Motion(np.full(len(part), part.omega0), part.mean_response)]
    if lines.far is not None:
        across = lines.far.mean(axis=1) + fit.law.parts[1].share * part.mean_response
        motions.append(replace(motions[0], harmonics=across))
    for one, motion in zip(fit.law.parts, motions, strict=True):
        found += damping_findings(one.law, motion, fit.values[one.parameters], stated.of_law)
        if fit.law.acts_across:
            # neither part can compensate a wrong sign of the other
            basis = _basis(errors.regression)
            found += signs_along(one, motion, fit.values, basis, part.units, slice(1, None))
    return found


def _hidden_line_findings(lines: SpectralLines) -> list[Finding]:
    """Say below which frequency noise hides the response, so that the law gives it; none or one."""
    if not (lines.lowest > 1).any():
        return []
    below = Quantity(float(np.max(lines.spectra.omega[:, 1] * lines.lowest)) / (2 * np.pi), "Hz")
    return [Finding("motion-by-law", "info", numbers={"below": below})]


def _fixed_findings(fit: LineFit, errors: Errors) -> list[Finding]:
    """Find fixed values that the lines contradict more than they contradict the lack of any term."""
    least = max(MIN_SIGNIFICANT_GAIN, *(term.gain for term in errors.others.kinds["term"].values()))
    found, misfit = [], fit.misfit
    for name, free in fit_fixed_parameters(fit).items():
        # the kilogram of a force per mass is no value that was given
        if (name == "m" and fit.lines.spectra.per_mass) or free.gain < least:
            continue
        fixed, others = fit.fixed[name], {one: value for one, value in fit.fixed.items() if one != name}
        # one step leads nowhere near from a mass in another unit
        freed = fit_lines(fit.lines, fit.law, others, fit.values, fit.mass)
        moved, left = (freed.law.named(freed.values) | {"m": freed.mass})[name] - fixed, freed.misfit
        far = abs(moved) >= RELATIVE_CHANGE_NEGLIGIBLE * abs(fixed)
        # no other value leaves nothing but noise next to a wrong law
        far |= fit.systematic and misfit > MISFIT_NEGLIGIBLE and not freed.systematic
        if far and left < misfit:
            times = float(np.sqrt(free.gain))
            found.append(fixed_contradicted(name, fixed, moved, misfit=misfit, left=left, times=times))
    if fit.lines.weighed is not None:
        # of the variance of the weighing the test has left that of the mass: the rest is that of their gap
        given, error = fit.lines.weighed
        rest, moved = 1 - float(errors.of_law[-1, -1]) / error**2, fit.mass - given
        times = abs(moved) / (error * np.sqrt(rest)) if rest > 0 else 0.0
        if times > NOISE_LIMIT_SIGMAS:
            found.append(
                fixed_contradicted("m", given, moved / rest, misfit=misfit, times=times, error=error)
            )
    return found


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


def _basis(found: Regression) -> Array:
    """Return a basis (q, r) of the errors of all values, as wide as their covariance (q, q) says."""
    known = np.linalg.norm(found.basis, axis=1)
    wider = np.sqrt(np.diag(found.covariance)) / np.where(known > 0, known, np.inf)
    return found.basis * np.where(np.isfinite(wider), wider, 1)[:, None]


def _curve(resonances: tuple[Resonance, ...], part: MultisineSpectra, units: ForceUnits) -> EquivalentCurve:
    """Return equivalent stiffness and damping of each level at its resonance."""
    amplitude, frequency, level, stiffness, damping = (
        np.array([getattr(point, name) for point in resonances])
        for name in ("amplitude", "frequency", "level", "stiffness", "damping")
    )
    used = np.ones(len(resonances), dtype=bool)
    return EquivalentCurve(
        amplitude, frequency, level, stiffness, damping, used, part.level_unit, units, part.base
    )


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


def _sign_findings(fit: LineFit, errors: Errors) -> list[Finding]:
    """Find a structure that feeds energy into the exciter, and a negative mass, both beyond noise."""
    found = [Finding("structure-feeds-exciter", "error")] if lines_feed_exciter(fit) else []
    if fit.mass < -NOISE_LIMIT_SIGMAS * float(np.nan_to_num(np.sqrt(errors.regression.covariance[-1, -1]))):
        found.append(Finding("mass-negative", "error", "m", {"mass": Quantity(fit.mass, "kg")}))
    return found


def _drift_findings(fit: LineFit) -> list[Finding]:
    """Find a gain that changes within a record; none or one."""
    skipped = int(np.asarray(fit.lines.spectra.left_out).max(initial=0))
    first, size, z = largest_gain_step(fit)
    if z < OUTLIER_SIGMAS:
        return []
    severity: Severity = "doubt" if size > RELATIVE_CHANGE_NEGLIGIBLE else "warning"
    names = {"parts": f"the periods from number {skipped + first + 1} on, and those before", "by": "periods"}
    return [Finding("parts-disagree", severity, "", quantities(z=z, size=size), names)]


def _is_noise(fit: LineFit, others: Alternatives) -> bool:
    """Decide whether a misfit is noise: by the scatter of the periods, or of one period by alternatives, each
    of which takes up some of what any law or background leaves.
    """
    if fit.lines.spectra.periods == 1:
        return not any(stands_out(one) for _, _, one in others)
    return not fit.systematic


def _damping_findings(fit: LineFit, errors: Errors) -> list[Finding]:
    """Find a misfit beyond noise that is small relative to the force, but not relative to the damping force.

    At the resonance the damping balances the force of a sine. In a multisine springs and inertia balance most
    of the lines, so that a missing damping term leaves a small misfit and changes the other damping values.
    """
    misfit = fit.misfit
    if misfit > MISFIT_DOUBTFUL_PATTERN_UNSEEN or _is_noise(fit, errors.others):
        return []
    share = relative_to_force(fit.lines, Balance.damping(fit.mode, fit.law, fit.values, fit.mass))
    systematic = float(np.sqrt(max(misfit**2 - np.nan_to_num(errors.noise) ** 2, 0.0)))
    # the damping share of a law with memory is NaN: no finding
    if not systematic > max(RELATIVE_ERROR_DOUBTFUL * share, 0.0 if share else MISFIT_NEGLIGIBLE):
        return []
    numbers = quantities(misfit=misfit, **({"share": systematic / share} if share else {}))
    return [Finding("damping-hidden-by-misfit", "doubt", numbers=numbers)]


def fitted_background(fit: LineFit, found: Regression) -> Background | None:
    """Return the background of a fit with the errors of its parameters; None without one."""
    lines = fit.lines
    return state_background(
        lines.background,
        np.where(lines.used, lines.spectra.mean_force, 0).reshape(-1),
        np.where(lines.used, np.abs(lines.spectra.mean_response), 0).reshape(-1),
        fit.background,
        found,
        lines.spectra.units,
    )


def _misfit_findings(fit: LineFit, errors: Errors) -> list[Finding]:
    """Compare the misfit with the noise, and with what is acceptable for a law."""
    misfit, others = fit.misfit, errors.others
    one_period, ratio = not np.isfinite(errors.noise), misfit_to_noise(fit)
    found = [Finding("multisine-periods", "warning", numbers=quantities(periods=1))] if one_period else []
    # a misfit of exact data exceeds the noise, which is zero there
    if _is_noise(fit, others) or misfit < MISFIT_NEGLIGIBLE:
        # scatter of the periods is in every interval, so that noise alone is doubted late
        limits = (MISFIT_DOUBTFUL_WITHOUT_PATTERN, MISFIT_REJECTED) if one_period else (MISFIT_REJECTED, inf)
        large = Finding("misfit-large", severity_of(misfit, *limits), numbers=quantities(misfit=misfit))
        return [*found, large] if misfit > MISFIT_DOUBTFUL_WITHOUT_PATTERN else found
    severity = severity_of(misfit, MISFIT_DOUBTFUL_PATTERN_UNSEEN, MISFIT_REJECTED)
    size = quantities(misfit=misfit, **({} if one_period else {"times": ratio}))
    parts = quantities(wider=fit.errors[1], groups=int(band_parts(fit.lines).max()) + 1)
    found += [
        Finding("law-does-not-fit", severity, numbers=size),
        Finding("intervals-widened", "warning", numbers=parts, names={"by": "parts of the band"}),
    ]
    used = fit.lines.used
    square = np.sum(np.abs(fit.balance.residual[used]) ** 2 * 2 / fit.variance[used])
    terms, more = (
        {
            name: misfit * float(np.sqrt(max(1 - one.gain / square, 0.0)))
            for name, one in others.kinds[kind].items()
        }
        for kind in ("term", "background")
    )
    noise, freedom = min(float(np.nan_to_num(errors.noise)), misfit), 2 * int(fit.lines.used.sum())
    half = float(np.hypot(noise, (1 - MIN_MISFIT_REDUCTION) * np.sqrt(misfit**2 - noise**2)))
    errors_of_channel, base = channel_errors(fit), fit.lines.spectra.base
    off = blame_channel(errors_of_channel, (misfit, half, noise), freedom, [*terms.values()], more, base)
    if off:
        # lines are weighted, and no correction takes up the noise
        found.append(replace(off, numbers={**off.numbers, **quantities(left=max(off["left"], noise))}))
    if more:
        backgrounds, known = others.kinds["background"], fit.regression.first(len(others.names))
        left = min(terms.values())
        found += background_findings(backgrounds, more, known, others.names, misfit=misfit, left_by_term=left)
    return found


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
    return Prediction((), (), tuple(findings), records)


def _predicted_record(found: MultisineIdentification, spectra: MultisineSpectra, row: int) -> PredictedRecord:
    """Predict the response to the measured force of a record, and its error over the band.

    The iteration starts from the motion of the law's slopes at rest; where that does not converge, the
    force grows to its size in ten steps (``periodic_response``), and then it starts from the measured
    response: of several motions the nearest is meant. With two sensors it starts there at once, and the
    motion across is as measured; lines that are not of the mode are added as measured.
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
        start = np.where(spectra.lines < spectra.reach()[0], 0, mode.mean_response[0])
        far = far[0].mean(axis=0)
    base = float(spectra.omega[0, 1])
    solve = partial(periodic_response, law, found.solution, found.mass, base, force)
    response = solve(start, far)
    if not response.converged and start is None:
        response = solve(mode.mean_response[0], far)
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
    return PredictedRecord(
        level=level,
        level_unit=spectra.level_unit,
        label=spectra.label_of(level),
        frequency=frequency,
        measured=measured,
        predicted=predicted,
        judged=judged,
        error=error,
        noise=noise,
    )


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
            numbers = quantities(level=level, error=one.error)
            numbers |= quantities("m", amplitude=amplitude, high=found.amplitude_range[1])
            findings.append(Finding("prediction-extrapolated", "warning", numbers=numbers))
        if one.error > HELD_OUT_ERROR_SMALL:
            severity = severity_of(one.error, HELD_OUT_ERROR_DOUBTFUL, HELD_OUT_ERROR_REJECTED)
            numbers = quantities(level=level, error=one.error, misfit=found.residual)
            findings.append(Finding("held-out-missed", severity, "", numbers, named(one)))
    return findings
