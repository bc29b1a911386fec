"""Identification of a law from a periodic multisine: the balance of every line, weighted by its noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf, nan

import numpy as np

from rsgen.common.arrays import Array, frozen_array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, Quantity, Severity, quantities, severity_of
from rsgen.common.tolerances import (
    CHANCE,
    LARGE,
    MEANINGLESS,
    NOTICEABLE,
    POOR,
    SAME_NUMBER,
    SIGMAS,
    SIGNIFICANT,
    TAKEN,
)
from rsgen.data.multisine import BestLinear, MultisineSpectra, best_linear, implausible
from rsgen.data.multisine.spectra import check_records
from rsgen.data.oscillator import Model, refuse_across
from rsgen.identification.fitting.fit import Solution
from rsgen.identification.fitting.least_squares import Alternative
from rsgen.identification.lines.line_balance import Balance, Lines, lines_of
from rsgen.identification.lines.line_fit import (
    LineFit,
    chance_of_noise,
    delay_between,
    errors_of,
    fit_lines,
    fixed_beside,
    parts_of_band,
    relative_to_force,
    start_values,
    step_between_periods,
    terms_beside,
    times_noise,
)
from rsgen.identification.results import (
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
    with_combinations,
)
from rsgen.law.identifiable import put_in_order
from rsgen.law.motion import Motion
from rsgen.law.numeric import compile_law


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
        A held-out level is not in the records, nothing is left, or the observation asks for a background.
    """
    refuse_across(model.sensors, multisine=True)
    observation = model.observation
    held = check_records(spectra, observation)
    part = spectra.select(np.flatnonzero(~held))
    law = compile_law(model.force)
    lines = lines_of(part, observation.band, switched=law.switched)
    count = int(lines.used.sum())
    if 2 * count <= len(law.parameters) + 1:
        raise RsgenError(f"identify.band: {count} lines in it; more lines than parameters are needed")
    with np.errstate(all="ignore"):
        values, mass = start_values(lines, law, model.fixed)
        fit = fit_lines(lines, law, model.fixed, put_in_order(law, values, model.fixed), mass)
        return _judge(spectra, model, fit)


def _judge(spectra: MultisineSpectra, model: Model, fit: LineFit) -> MultisineIdentification:
    lines, law, part = fit.lines, fit.law, fit.lines.spectra
    statistical, freedom, wider = errors_of(fit)
    names = (*law.parameters, "m")
    terms = terms_beside(fit)
    misfit = relative_to_force(lines, np.abs(fit.balance.residual) ** 2)
    others = Alternatives(names, np.sqrt(np.diag(statistical)), {"term": terms})
    ratio, ambiguous = others.judge(fit.parameters, misfit)
    covariance = statistical * np.outer(ratio, ratio)
    noise = relative_to_force(lines, fit.noise.variance)
    amplitudes = np.sqrt(2) * part.rms_response()
    tested = {
        "amplitude": Quantity(float(amplitudes.max()), "m"),
        "level": Quantity(float(part.levels.max()), "N"),
    }
    known = replace(fit.regression, covariance=covariance)
    reasons = parameter_findings(names, units_of(model), tested, known)
    reasons = with_combinations(reasons, model)
    solution = Solution(fit.values, fit.mass, covariance, freedom, misfit)
    estimates = make_estimates(solution, law, model, reasons)
    approximations = best_linear(part, model.observation.band)
    findings = [e.finding for e in estimates if e.finding is not None]
    findings += _sign_findings(fit, covariance)
    findings += [
        *_misfit_findings(fit, misfit, noise, wider),
        *(_contradicted(fit, terms, misfit) or ambiguous),
    ]
    motion = Motion(np.full(len(part), part.omega0), part.mean_response)
    # what a law takes from the motion is judged by the law as it stands
    of_law = make_estimates(replace(solution, covariance=statistical), law, model, reasons)
    findings += damping_findings(law, motion, fit.values, of_law)
    findings += _damping_findings(fit, misfit, noise)
    findings += _delay_findings(fit, misfit)
    findings += _drift_findings(fit, left=int(np.asarray(part.left_out).max(initial=0)))
    if (lines.first > 1).any():
        below = Quantity(float(part.frequency[lines.first.max()]), "Hz")
        findings.append(Finding("motion-by-law", "info", numbers={"below": below}))
    findings += [*spectra.findings, *([] if fit.converged else [Finding("not-converged", "doubt")])]
    if model.observation.calibrated:
        ratios = [one.damping_ratio for one in approximations if one.damping_ratio > 0]
        mass = fit.mass if np.isfinite(covariance).all() else nan
        findings += implausible(spectra, mass=mass, damping=min(ratios, default=nan))
    else:
        findings.append(Finding("not-calibrated", "info"))
    free = np.flatnonzero(fit.free)
    frequency = part.frequency[lines.used.any(axis=0)]
    resonances = tuple(map(_resonance, approximations))
    none = (nan, inf, (-inf, inf))
    unread = tuple(Estimate(estimate.name, *none, estimate.unit) for estimate in estimates)
    return MultisineIdentification(
        model=model,
        paper=unread,
        first_order=unread,
        refined=estimates,
        first_order_bias=(nan,) * len(estimates),
        covariance=covariance[np.ix_(free, free)],
        resonances=resonances,
        curve=_curve(resonances),
        residual=misfit,
        noise=noise,
        levels=part.levels,
        amplitude_range=(float(amplitudes.min()), float(amplitudes.max())),
        frequency_range=(float(frequency[0]), float(frequency[-1])),
        outcome=_outcome(lines, estimates, misfit),
        findings=tuple(findings),
        solution=fit.values,
        alternatives=others,
        spectra=spectra,
        approximations=approximations,
        used=frozen_array(lines.used, np.bool_),
        misfit=frozen_array(fit.balance.residual, np.complex128),
        deviation=frozen_array(np.sqrt(fit.noise.variance)),
    )


def _contradicted(fit: LineFit, terms: Mapping[str, Alternative], misfit: float) -> list[Finding]:
    """Find fixed values that the lines contradict, more than they do any term."""
    least = max(SIGNIFICANT, *(one.gain for one in terms.values()))
    square = np.sum(np.abs(fit.balance.residual[fit.lines.used]) ** 2 * 2 / fit.variance[fit.lines.used])
    found = []
    for name, other in fixed_beside(fit).items():
        given = fit.fixed[name]
        if other.gain >= least and abs(other.value) >= SAME_NUMBER * abs(given):
            left = misfit * float(np.sqrt(max(1 - other.gain / square, 0.0)))
            times = float(np.sqrt(other.gain))
            found.append(fixed_contradicted(name, given, other.value, misfit=misfit, left=left, times=times))
    return found


def _outcome(lines: Lines, estimates: tuple[Estimate, ...], misfit: float) -> Finding:
    """What was found from how many lines."""
    numbers = quantities(
        identified=sum(estimate.identifiable for estimate in estimates),
        parameters=len(estimates),
        lines=int(lines.used.sum()),
        excited=int((lines.used & lines.spectra.excited()).sum()),
        records=len(lines.spectra),
        levels=len(lines.spectra.levels),
        misfit=misfit,
    )
    return Finding("identified", "info", numbers=numbers)


def _resonance(found: BestLinear) -> Resonance:
    """The mode of the best linear approximation of a level."""
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


def _curve(resonances: tuple[Resonance, ...]) -> EquivalentCurve:
    """Equivalent stiffness and damping of each level, at its resonance."""
    amplitude, frequency, level, stiffness, damping = (
        np.array([getattr(point, name) for point in resonances])
        for name in ("amplitude", "frequency", "level", "stiffness", "damping")
    )
    used = np.ones(len(resonances), dtype=bool)
    return EquivalentCurve(amplitude, frequency, level, stiffness, damping, used)


def _sign_findings(fit: LineFit, covariance: Array) -> list[Finding]:
    """Find a structure that works on the exciter, and a negative mass."""
    lines, part, found = fit.lines, fit.lines.spectra, []
    # (r,) mean power of the force, and its standard deviation by the noise of force and response
    velocity = lines.rate * part.mean_response
    power = 0.5 * np.sum((part.mean_force * np.conj(velocity)).real * lines.used, axis=1)
    force, response = (np.nan_to_num(one) for one in part.noise())
    spread = np.abs(velocity) ** 2 * force**2 + np.abs(part.mean_force * lines.rate) ** 2 * response**2
    limit = CHANCE * np.sqrt(0.5 * np.sum(spread * lines.used, axis=1))
    if np.any(power < -limit):
        found.append(Finding("structure-feeds-exciter", "error"))
    if fit.mass < -CHANCE * float(np.nan_to_num(np.sqrt(covariance[-1, -1]))):
        found.append(Finding("mass-negative", "error", "m", {"mass": Quantity(fit.mass, "kg")}))
    return found


def _delay_findings(fit: LineFit, misfit: float) -> list[Finding]:
    """Find a delay between force and response that takes up most of the misfit; none or one."""
    delay, error, left = delay_between(fit)
    if misfit < NOTICEABLE or left > 1 - TAKEN or abs(delay) < SIGMAS * error:
        return []
    numbers = quantities(delay=Quantity(delay, "s"), left=left * misfit, misfit=misfit)
    return [Finding("channels-delayed", "doubt", numbers=numbers)]


def _drift_findings(fit: LineFit, left: int) -> list[Finding]:
    """Find a gain that changes within a record, of which ``left`` periods were left out; none or one."""
    first, size, times = step_between_periods(fit)
    if times < SIGMAS:
        return []
    severity: Severity = "doubt" if size > SAME_NUMBER else "warning"
    names = {"parts": f"the periods from number {left + first + 1} on, and those before"}
    return [Finding("parts-disagree", severity, "", quantities(z=times, size=size), names)]


def _damping_findings(fit: LineFit, misfit: float, noise: float) -> list[Finding]:
    """Find a misfit that is no noise, is small beside the force, and is not small beside the damping.

    At a resonance the damping alone balances a sine; of all lines of a multisine the springs and the mass
    balance most, so that damping which a law lacks leaves little and goes into the damping that it has.
    """
    # of one period nobody can tell a misfit from noise
    by_chance = np.isfinite(noise) and times_noise(fit) < chance_of_noise(fit)
    if misfit > POOR or by_chance:
        return []
    share = relative_to_force(fit.lines, Balance.damping(fit.lines, fit.law, fit.values, fit.mass))
    left = float(np.sqrt(max(misfit**2 - np.nan_to_num(noise) ** 2, 0.0)))
    # of a law with memory nobody can say which part of it is damping
    if not left > max(LARGE * share, 0.0 if share else NOTICEABLE):
        return []
    numbers = quantities(misfit=misfit, **({"share": left / share} if share else {}))
    return [Finding("misfit-beside-damping", "doubt", numbers=numbers)]


def _misfit_findings(fit: LineFit, misfit: float, noise: float, wider: float) -> list[Finding]:
    """Judge what the law leaves by its size and by the noise."""
    times = times_noise(fit)
    if not np.isfinite(noise):
        found = [Finding("periods-few", "warning", numbers=quantities(periods=1))]
        if misfit > POOR:
            severity = severity_of(misfit, POOR, MEANINGLESS)
            found.append(Finding("law-does-not-fit", severity, numbers=quantities(misfit=misfit)))
        return found
    # exact data have no noise to compare with
    if times < chance_of_noise(fit) or misfit < NOTICEABLE:
        severity = "doubt" if misfit > MEANINGLESS else "warning"
        large = Finding("misfit-large", severity, numbers=quantities(misfit=misfit))
        return [large] if misfit > 2 * POOR else []
    severity, size = severity_of(misfit, POOR, MEANINGLESS), quantities(misfit=misfit, times=times)
    parts = quantities(wider=wider, groups=int(parts_of_band(fit.lines).max()) + 1)
    return [
        Finding("law-does-not-fit", severity, numbers=size),
        Finding("intervals-widened", "warning", numbers=parts, names={"by": "parts of the band"}),
    ]
