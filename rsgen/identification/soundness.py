"""Quality checks of a fit: excluded points, signs of mass, stiffness and damping, sensors at a joint.

A negative k(X) or c(X), the fundamental of the force in phase with x and the work of a cycle over that of a
damper, is compared with its error by linear propagation; the other checks are counts and ratios that are
compared with fixed limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray, true_runs
from rsgen.common.finding import Finding, Quantity, Severity, quantities, severity_of
from rsgen.common.solvers import solve_scaled
from rsgen.common.tolerances import (
    BALANCE_HARMONICS,
    DEVIATING_MISFIT_RATIO,
    MAX_SHARE_OF_OUTLIERS,
    MAX_SHARE_OF_OUTLIERS_BY_CHANCE,
    MISFIT_EXPLAINED,
    MISFIT_NEGLIGIBLE,
    MISFIT_REJECTED,
    NOISE_LIMIT_SIGMAS,
    NOISE_RATIO_BY_CHANCE,
    RELATIVE_CHANGE_NEGLIGIBLE,
    RELATIVE_ERROR_DOUBTFUL,
    ROUND_OFF,
    SAMPLES_PER_PERIOD_SWITCHED,
    STANDARD_ERRORS_OF_DIFFERENCE,
    SUBSAMPLE_POINTS,
    TRIAL_POINTS,
    interval_sigmas,
    samples_for,
)
from rsgen.data.record_set import DERIVATIVE, QUANTITIES
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.harmonic_balance import following_harmonics, hold_amplitude
from rsgen.dynamics.linear_part import BackgroundTerms
from rsgen.formula.names import symbol
from rsgen.formula.units import ForceUnits, unit_text
from rsgen.identification.fitting.across import motions_of, sensor_noise
from rsgen.identification.fitting.fit import Fit, fit_balance
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.observed import Problem
from rsgen.identification.fitting.points import Points
from rsgen.identification.fitting.repeats import Repeats
from rsgen.identification.results import Estimate
from rsgen.identification.results.estimates import damping_findings, takes_energy
from rsgen.identification.starting.start import records_even
from rsgen.law.character import mirror_exchanges
from rsgen.law.motion import Motion, project, sine_motion, waveform
from rsgen.law.normal_form import ForceSample
from rsgen.law.numeric import ForceLaw, Part

_MAX_EXCLUDED_SHARE = 0.75 * MAX_SHARE_OF_OUTLIERS
"""Share of excluded points beyond which the others are a selection that suits the law: three quarters of
``MAX_SHARE_OF_OUTLIERS``, the most that a fit excludes."""

_MAX_SINGLE_EXCLUDED = 3
"""Excluded points that may be single drop-outs of a small test; levels at which more than twice as many are
named."""

_JUMP, _JUMP_TO_STEPS = 1.5, 2.0
"""Least ratio of the motions on both sides of a jump, and of its logarithm to that of other neighbours."""

_MIN_EXCLUDED_NEIGHBOURS = 5
"""Excluded neighbours from which on a piece of a run disagrees; fewer are an early jump."""

_MIN_PIECE_OF_RUN = 0.1
"""Length of such a piece as a share of its run."""

_MAX_EXCLUDED_SHARE_OF_RUN = 0.25
"""Share of excluded points of a run from which on the run disagrees with the law."""

MAX_FORCE_TO_FRICTION = 1.5
"""Amplitude of the force over that of dry friction up to which the mass may stop for parts of a cycle: 4/pi
at resonance (Den Hartog, Trans. ASME 53, 1931), and noise."""

_TRANSIENT_OVERSHOOT = 1.5
"""Largest amplitude of transients relative to that of the steady motions."""

_MAX_NEGATIVE_SHARE = 0.5
"""Share of the points with a wrong sign beyond which the finding is an error."""

_RESPONSE_ROUNDING = 2e-4
"""Relative difference of equal responses in a table of four digits."""

_MIN_CLIPPED_AMPLITUDE = 0.98
"""Fundamental of a clipped sine relative to its limit."""


def repeats_finding(repeats: Repeats, misfit: float) -> Finding:
    """Compare the misfit of the means [1] with their scatter."""
    typical = float(np.median(repeats.count))
    expected = repeats.noise / np.sqrt(typical)
    numbers = quantities(readings=len(repeats.row), points=len(repeats.count), excluded=repeats.excluded)
    numbers |= quantities(repeats=typical, of_reading=repeats.noise, of_mean=expected)
    numbers |= quantities(misfit=misfit, times=misfit / expected)
    # no law follows means of independent readings so much better than they scatter
    if misfit < MISFIT_EXPLAINED * expected:
        return Finding("repeats-scatter", "doubt", numbers=numbers, names={"by": "branch"})
    severity: Severity = "info" if misfit < NOISE_RATIO_BY_CHANCE * expected else "warning"
    return Finding("repeats-scatter", severity, numbers=numbers)


def exclusion_findings(
    points: Points,
    excluded: NDArray[np.bool_],
    tested: int,
    level_unit: str,
    *,
    stopped: NDArray[np.bool_],
    decays: bool = False,
    converged: bool = True,
) -> list[Finding]:
    """Find too many excluded points, and excluded points that are neighbours.

    Parameters
    ----------
    points, excluded
        The fitted points, and those of them (n,) that the fit does not use.
    tested
        Number of points of the test.
    level_unit
        Unit of the levels: "N", or "m" with response control.
    stopped
        (n,) points that are no evidence against the law, where friction nearly holds the mass.
    decays
        True for a free decay, whose small motions may be excluded for noise: only the large half counts.
    converged
        Of the fit: where its steps merely ended, what disagrees with them is no evidence against the law.
    """
    if not excluded.any():
        return []
    numbers = quantities(excluded=int(np.count_nonzero(excluded)), points=len(points), all=tested)
    if decays:
        excluded = excluded & (points.amplitude > np.median(points.amplitude))
    excluded = excluded & ~stopped
    count = int(np.count_nonzero(excluded))
    limits = MAX_SHARE_OF_OUTLIERS_BY_CHANCE, _MAX_EXCLUDED_SHARE
    judged = converged and count > _MAX_SINGLE_EXCLUDED
    severity = severity_of(count / len(points), *limits) if judged else "warning"
    of_run: Severity = "doubt" if converged else "warning"
    unsettled = {} if converged else {"unsettled": "yes"}
    names = {"by": "fall"} if decays else unsettled
    if 0 < count == numbers["excluded"].value and not decays:
        where = points_at(points.level[excluded], points.omega[excluded] / 2 / np.pi, level_unit)
        jump = count <= _MAX_SINGLE_EXCLUDED
        jump &= all(at_jump(points.amplitude[rows], excluded[rows]) for rows in points.runs)
        severity, names = ("info", {"jump": where}) if jump else (severity, {**names, "where": where})
    found = [Finding("points-excluded", severity, numbers=numbers, names=names)]
    for rows in points.runs:
        starts, lengths = true_runs(excluded[rows])
        longest, lost = int(lengths.max(initial=0)), int(np.count_nonzero(excluded[rows]))
        together = longest >= max(_MIN_EXCLUDED_NEIGHBOURS, _MIN_PIECE_OF_RUN * len(rows))
        if together or (lost > _MAX_SINGLE_EXCLUDED and lost > _MAX_EXCLUDED_SHARE_OF_RUN * len(rows)):
            piece = np.flatnonzero(excluded[rows])
            piece = starts[np.argmax(lengths)] + np.arange(longest) if together else piece
            ends = points.omega[rows[piece[[0, -1]]]] / (2 * np.pi)
            data = {"low": Quantity(float(ends[0]), "Hz"), "high": Quantity(float(ends[1]), "Hz")}
            data |= quantities(excluded=lost, points=len(rows), together=longest)
            data["level"] = Quantity(float(points.level[rows[0]]), level_unit)
            found.append(Finding("points-excluded", of_run, numbers=data, names=unsettled))
    return found


def at_jump(amplitude: Array, missed: NDArray[np.bool_]) -> bool:
    """Return True if missed points (n,) of a run, by frequency, are next to its jump; an outlier has two."""
    if not missed.any() or missed[0] or missed[-1]:
        return not missed.any()
    steps = np.abs(np.diff(np.log(amplitude)))
    at = int(np.argmax(steps))
    jumps = steps[at] > max(np.log(_JUMP), _JUMP_TO_STEPS * np.delete(steps, at).max())
    return bool(jumps and missed.sum() == missed[at : at + 2].sum())


def points_at(level: Array, frequency: Array, unit: str) -> str:
    """Return where points (n,) are, as findings name them: each of a few, else their ends at a few levels."""
    texts, few = list[str](), len(level) <= 2 * _MAX_SINGLE_EXCLUDED
    for one in np.unique(level):
        at = [f"{place:.5g}" for place in np.sort(frequency[level == one])]
        many = f"{len(at)} frequencies from {at[0]} to {at[-1]}"
        texts.append(f"{one:.4g} {unit_text(unit)} at {', '.join(at) if few or len(at) < 3 else many} Hz")
    if not few and len(texts) > _MAX_SINGLE_EXCLUDED:
        texts[_MAX_SINGLE_EXCLUDED:] = ["other levels"]
    return "; ".join(texts)


def nearly_held(
    points: Points, law: ForceLaw, values: Array, most: float | Array = MAX_FORCE_TO_FRICTION
) -> NDArray[np.bool_]:
    """(n,) points whose force hardly overcomes dry friction, up to which the law holds the mass at rest.

    ``most`` is the ratio of both below which it hardly does.
    """
    friction = law.dry_friction(ROUND_OFF * float(np.max(points.amplitude * points.omega)), values)
    return np.asarray(np.abs(points.force) < most * friction)


def held_points(problem: Problem, parameters: Array, noise: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,) points where friction takes nearly all of the force, and hardly any is left to move the mass.

    They say that the friction is as large as the force, and a balance of few harmonics, which has 4/pi of
    it, takes that for the friction of all others. A response in ``noise`` (n,) says nothing of
    motion: there the friction itself is to be larger than the force, but for its error. None where too few
    are left for the problem.
    """
    values, mass, background = problem.split(parameters)
    points = problem.observed.mode(background)
    left = abs(mass) * points.omega**2 * points.amplitude
    few = left < RELATIVE_ERROR_DOUBTFUL * np.abs(points.force)
    most = np.where(noise, 1 + RELATIVE_ERROR_DOUBTFUL, MAX_FORCE_TO_FRICTION)
    held = nearly_held(points, problem.law, values, most) & (few | noise)
    return np.asarray(held & (np.count_nonzero(~held) > problem.count))


def left_out(
    reason: str, points: Points | ResponseSurface, excluded: NDArray[np.bool_], unit: str, **numbers: Quantity
) -> Finding:
    """State which points (n,) a fit leaves out for a reason, with further numbers; levels have a unit."""
    counts = quantities(excluded=int(np.count_nonzero(excluded)), points=len(excluded), **numbers)
    where = points_at(points.level[excluded], points.omega[excluded] / (2 * np.pi), unit)
    return Finding("points-excluded", "info", numbers=counts, names={"by": reason, "where": where})


def held_finding(points: Points, held: NDArray[np.bool_], surface: ResponseSurface) -> Finding:
    """State which points friction holds, and up to which force."""
    force = Quantity(float(np.abs(points.force[held]).max()), surface.units.of("N"))
    return left_out("friction", points, held, surface.level_unit, force=force)


def shown_by_few(fit: Fit) -> dict[str, Finding]:
    """Find parameters that act at fewer harmonics of points than there are such parameters, by name.

    One point behind a stop shows one combination of where the stop is and how stiff.
    """
    law, observed = fit.problem.law, fit.problem.observed
    found = dict[str, Finding]()
    if law.acts_across or not law.nonlinear:
        return found
    motion = fit.motion.select(np.flatnonzero(fit.regression.used & np.isfinite(fit.harmonics).all(axis=1)))
    slopes = law.along(motion, fit.values, SAMPLES_PER_PERIOD_SWITCHED).by_parameter
    acts = {
        name: (slope != 0).any(axis=1)
        for name, slope in zip(law.parameters, slopes, strict=True)
        if name not in fit.problem.fixed
    }
    harmonics = max(len({*observed.recorded} - {0}), 1)
    for where in acts.values():
        only = [name for name, own in acts.items() if own.any() and not (own & ~where).any()]
        if harmonics * np.count_nonzero(where) < len(only):
            for name in only:
                others = {"with": ", ".join(other for other in only if other != name)}
                found[name] = Finding("confounded", "warning", name, names=others)
    return found


def name_exchanged(fit: Fit, found: Regression, estimates: Sequence[Estimate]) -> tuple[Estimate, ...]:
    """Say of two parameters that the mirror image of the law exchanges that their mean alone is seen.

    Where they are nearly equal, fundamentals show the square of their difference: to first order either has
    no value, however well the mean is known.

    Parameters
    ----------
    fit, found
        What was fitted, and its regression with all errors.
    estimates
        Of its parameters; two of one unit without a value are asked.
    """
    law, reasons = fit.problem.law, dict[str, Finding]()
    if law.odd or law.remembers or law.acts_across or records_even(fit.problem):
        return tuple(estimates)
    names = np.array([*law.parameters, "m"])
    for one, other in combinations([e for e in estimates if e.finding is not None and e.name != "m"], 2):
        half = np.isin(names, (one.name, other.name)) / 2
        mean, basis = float(half @ found.parameters), half @ found.basis * found.sigma
        off = interval_sigmas(found.freedom) * float(np.linalg.norm(basis))
        pair = symbol(one.name), symbol(other.name)
        if one.unit == other.unit and off < abs(mean) and mirror_exchanges(law.expression, *pair):
            ends = {"low": mean - off, "high": mean + off} if found.converged else {}
            numbers = quantities(one.unit, combined=mean, **ends)
            said = {"mirror": "yes", "combination": f"({one.name} + {other.name})/2"}
            for this, partner in ((one.name, other.name), (other.name, one.name)):
                reasons[this] = Finding("confounded", "warning", this, numbers, {"with": partner, **said})
    return tuple(replace(e, finding=reasons.get(e.name, e.finding)) for e in estimates)


def limit_findings(remarked: Sequence[Finding], fit: Fit) -> list[Finding]:
    """Find responses that end at one largest value, as those of an overloaded sensor do.

    Of a record the limit is ``remarked``. In a table equal largest values at neighbouring frequencies show
    it where they disagree with the law that the others obey.
    """
    points, miss = fit.problem.observed.points, np.nan_to_num(fit.regression.misfit, nan=np.inf)
    series = {
        unit: points.amplitude * points.omega**order
        for unit, order in zip(QUANTITIES.values(), DERIVATIVE.values(), strict=True)
    }
    overloads = (finding for finding in remarked if finding.code == "range-reached")
    known = [one.numbers["limit"] for one in overloads if one.names["signal"] == "response"]
    if known:
        limit = min(known)
        at = series[limit.unit] > _MIN_CLIPPED_AMPLITUDE * limit.value
    else:
        equal = {unit: values > (1 - _RESPONSE_ROUNDING) * values.max() for unit, values in series.items()}
        unit, at = max(equal.items(), key=lambda item: int(np.count_nonzero(item[1])))
        limit = Quantity(float(series[unit].max()), unit)
        together = points.neighbours[at[points.neighbours].all(axis=1)]
        if len(np.unique(together)) < max(_MIN_EXCLUDED_NEIGHBOURS, np.count_nonzero(at) / 2):
            return []
    if not at.any() or at.all():
        return []
    misses = np.median(miss[at]) > max(DEVIATING_MISFIT_RATIO * np.median(miss[~at]), MISFIT_NEGLIGIBLE)
    if not (misses or (known and np.mean(at) > MAX_SHARE_OF_OUTLIERS_BY_CHANCE)):
        return []
    numbers = quantities(at=int(np.count_nonzero(at)), points=len(points), limit=limit)
    return [Finding("range-reached", "doubt", numbers=numbers)]


def gain_findings(background: BackgroundTerms, values: Array, variance: Array, mass: float) -> list[Finding]:
    """Bound the change of a gain over the band that a background conceals.

    A response F/D of a mode that is read with a relative error e is off by e F/D, which the term b0 of the
    background takes up with e = b0 D. As D = k - m omega^2 off the resonance, e changes by
    |Re b0| m (omega_2^2 - omega_1^2) over the band, and is half of it at one end if it is zero in the middle.
    """
    if "b0_re" not in background.names:
        return []
    term, error = abs(float(values[1])), float(np.sqrt(variance[1]))
    low, high = (2 * np.pi * frequency for frequency in background.band)
    change = term * abs(mass) * (high**2 - low**2)
    # no gain changes its sign in a band
    if not (term > STANDARD_ERRORS_OF_DIFFERENCE * error and RELATIVE_CHANGE_NEGLIGIBLE < change < 1):
        return []
    return [Finding("gain-may-change", "info", numbers=quantities(change=change, off=change / 2))]


def sign_findings(points: Points, fit: Fit, wider: Array, units: ForceUnits) -> list[Finding]:
    """Find a negative mass, and k(X) or c(X) of elements at one place that are negative where it was tested.

    Elements across two sensors are checked separately from the others, because neither can compensate a wrong
    sign of the others. Standard errors are multiplied by ``wider`` (q,); ``units`` are those of the test.
    """
    regression, problem = fit.regression, fit.problem
    basis = regression.basis * regression.sigma * wider[:, None]
    found = []
    if fit.mass < -NOISE_LIMIT_SIGMAS * float(np.linalg.norm(basis[len(problem.law.parameters)])):
        found.append(Finding("mass-negative", "error", "m", {"mass": Quantity(fit.mass, "kg")}))
    for part, followed in _parts_with_motions(points, fit):
        found += signs_along(part, followed, fit.values, basis, units)
    return found


def signs_along(
    part: Part, motion: Motion, values: Array, basis: Array, units: ForceUnits, orders: slice = slice(1, 2)
) -> list[Finding]:
    """Find a negative k(X) or c(X) of the elements that follow one motion; see ``_signs_at``."""
    own, names = part.parameters, {"sensors": part.sensors} if part.sensors else {}
    signs, found = _signs_at(part, motion, values[own], basis[own], orders), list[Finding]()
    for curve, numbers in zip(("k(X)", "c(X)"), signs, strict=True):
        if numbers:
            severity: Severity = "error" if numbers["share"].value > _MAX_NEGATIVE_SHARE else "doubt"
            least = numbers["least"]
            numbers |= {"least": Quantity(least.value, units.of(least.unit))}
            found.append(Finding("curve-negative", severity, "", numbers, names | {"curve": curve}))
    return found


def feeding_findings(points: Points, fit: Fit, estimates: Sequence[Estimate]) -> list[Finding]:
    """Find dampers of all parts of a law that feed energy into the motion."""
    found = list[Finding]()
    for part, motion in _parts_with_motions(points, fit):
        found += damping_findings(part.law, motion, fit.values[part.parameters], estimates)
    return found


def _is_active(law: ForceLaw, sample: ForceSample, velocity: Array, values: Array) -> bool:
    """Return True if some term is written to feed energy into the motion: -c*v, the damper of van der Pol."""
    for place in law.linear:
        power = np.broadcast_to(sample.by_parameter[place], velocity.shape) * velocity
        work, size = np.mean(values[place] * power, axis=1), np.mean(np.abs(values[place] * power), axis=1)
        if not takes_energy(power) and np.any(work < -MISFIT_NEGLIGIBLE * size):
            return True
    return False


def _parts_with_motions(points: Points, fit: Fit) -> list[tuple[Part, Motion]]:
    """Return the parts of the law with their motions, at points spread over the amplitude."""
    used = np.flatnonzero(fit.regression.used & np.isfinite(fit.harmonics).all(axis=1))
    some = used[points.select(used).spread(TRIAL_POINTS)]
    if not len(some):
        return []
    motion, law = Motion(points.omega[some], fit.harmonics[some]), fit.problem.law
    return list(zip(law.parts, motions_of(law, motion, points.select(some)), strict=True))


_Negative = dict[str, Quantity]
"""Range of amplitudes with negative k(X) or c(X), and its size; empty without any."""


def _signs_at(
    place: Part, motion: Motion, values: Array, basis: Array, orders: slice
) -> tuple[_Negative, _Negative]:
    """Find a negative k(X) or c(X) of the elements at one place; (p, r) ``basis`` of errors of its values.

    k is that of the motion of some ``orders``: the fundamental of a sine, all lines of a multisine.
    c is the work of a cycle over that of a damper of 1 N s/m: of a motion that is no sine the fundamental
    alone may lose to the harmonics what the cycle as a whole does not.
    """
    motion = motion.select((motion.harmonics[:, orders] != 0).any(axis=1))
    if not len(motion):
        return {}, {}
    samples = max(samples_for(place.law.switched), 8 * len(motion.orders))
    sample, velocity = place.law.along(motion, values, samples), motion.waveforms(samples)[1]
    driven = np.zeros_like(motion.harmonics)
    driven[:, orders] = motion.harmonics[:, orders]
    x, rate = waveform(driven, samples), velocity / np.mean(velocity**2, axis=1, keepdims=True)
    amplitude, speed = np.sqrt(2 * np.mean(x**2, axis=1)), np.sqrt(np.mean(velocity**2, axis=1))
    place_of = 2 * x / amplitude[:, None] ** 2
    by_stiffness, by_damping = (
        np.reshape([np.mean(by * along, axis=1) for by in sample.by_parameter], (-1, len(motion))).T
        for along in (place_of, rate)
    )
    # what takes energy at every instant is no spring, though friction that sticks has a part in phase
    dampers = [j for j in place.law.linear if takes_energy(sample.by_parameter[j] * velocity)]
    # of a law without springs, or without dampers, k(X) or c(X) is the round-off of its force
    least = ROUND_OFF * np.max(np.abs(sample.force), axis=1)
    k, c = np.mean(sample.force * place_of, axis=1), np.mean(sample.force * rate, axis=1)
    k = k - by_stiffness[:, dampers] @ values[dampers]
    by_stiffness[:, dampers] = 0.0
    stiffness = _negative(amplitude, k, by_stiffness @ basis, "N/m", least / amplitude)
    damping = _negative(amplitude, c, by_damping @ basis, "N*s/m", least / speed)
    if damping and np.sum(c * speed**2) > 0 and _is_active(place.law, sample, velocity, values):
        # some of the tested motions may live on what such a damper feeds, but not all together
        damping = {}
    return stiffness, damping


def runs_away(fit: Fit) -> bool:
    """Decide whether a law pushes the mass away just beyond the tested amplitudes, or has no force there.

    A simulation would carry such motions for thousands of periods and settle none of them.
    """
    size = np.abs(fit.harmonics[fit.regression.used, 1])
    if not size.size or not np.isfinite(size).all():
        return True
    omega = np.median(fit.problem.observed.points.omega)
    motion = sine_motion(np.array([omega]), _TRANSIENT_OVERSHOOT * size.max(keepdims=True))
    force = fit.problem.law.along(motion, fit.values, SAMPLES_PER_PERIOD_SWITCHED).force
    return not bool(project(force, 1)[0].real > 0)


def _negative(size: Array, value: Array, spread: Array, unit: str, least: Array | float = 0.0) -> _Negative:
    """Return the range where k(X) or c(X) is negative beyond error and ``least``; empty for few points."""
    wrong = value < -NOISE_LIMIT_SIGMAS * np.linalg.norm(spread, axis=1) - least
    share = float(np.mean(wrong))
    if not share > MAX_SHARE_OF_OUTLIERS_BY_CHANCE:
        return {}
    numbers = quantities(least=Quantity(float(value[wrong].min()), unit), share=share)
    return numbers | quantities("m", low=size[wrong].min(), high=size[wrong].max())


_MAX_NOISE_SHARE = 0.2
"""Share of noise in the information on a combination of values: at a quarter the mean error of a stiffness
across was 14 %, and 17 % of its intervals missed."""


# ----------------------------------------------------------------------------
# Effect of unrecorded harmonics of a motion across two sensors on the values of a law.
#
# A joint distorts the motion across it more than the response. At a harmonic each of the two masses that it
# connects answers its force N_h by inertia alone: m (h omega)^2 X_h = N_h on this side and
# -m_far (h omega)^2 X_far,h = N_h on the other. The difference z = x - x_far obeys mu (h omega)^2 Z_h =
# N_h(z) with the reduced mass 1/mu = 1/m + 1/m_far: the balance of an oscillator of that mass at the measured
# amplitude. On two masses, the far one hanging or on a spring of its own, with cubic joints and gaps, the
# third harmonic is within 20 % of the exact one, 30 % where it meets a mode.


def joint_findings(found: Fit, errors: Array) -> list[Finding]:
    """Find parameters of elements between two sensors that the measurement does not determine.

    Unrecorded harmonics would change them, or their information is mostly noise of the two sensors.

    Parameters
    ----------
    found
        The refined fit.
    errors
        (p,) stated standard errors of the values of the law; NaN for fixed or unidentifiable ones.
    """
    findings: list[Finding] = []
    for joint in found.problem.law.parts[1:]:
        findings += _missing_harmonics_findings(found, joint, errors)
        if found.regression.noise_share > _MAX_NOISE_SHARE:
            noise = sensor_noise(found.problem.observed.points, joint.sensors)
            numbers = quantities(noise=noise, part=found.regression.noise_share)
            findings.append(Finding("noise-across", "doubt", "", numbers, {"sensors": joint.sensors}))
    return findings


def _missing_harmonics_findings(found: Fit, joint: Part, errors: Array) -> list[Finding]:
    """Find values that unrecorded harmonics across would change; none or one finding."""
    law, points = found.problem.law, found.problem.observed.points
    some = np.flatnonzero(found.regression.used)
    some = some[points.select(some).spread(SUBSAMPLE_POINTS)]
    if not (found.mass > 0 and len(some)):
        return []
    problem = found.problem.select(some)
    measured = problem.observed.mode(found.background)
    across = Motion(measured.omega, measured.across)
    recorded = np.flatnonzero((across.harmonics != 0).any(axis=0))
    missing = _unrecorded_harmonics(joint, found, across, measured.harmonics[:, 1], recorded)
    moved = _change_of_values(problem, found.regression.parameters, across.harmonics, missing)
    with np.errstate(all="ignore"):
        share, times = moved / np.abs(found.values), np.abs(moved) / errors
    large = np.isfinite(errors) & (np.abs(share) > MISFIT_NEGLIGIBLE)
    doubts = large & (
        ((times > STANDARD_ERRORS_OF_DIFFERENCE) & (np.abs(share) > RELATIVE_CHANGE_NEGLIGIBLE))
        | (np.abs(share) > RELATIVE_ERROR_DOUBTFUL)
    )
    if not large.any():
        return []
    severity: Severity = "doubt" if doubts.any() else "info"
    worst = int(np.argmax(np.where(doubts if doubts.any() else large, np.abs(share), -1.0)))
    size = (np.abs(missing) / np.abs(across.harmonics[:, 1:2])).max(axis=0)
    numbers = quantities(
        recorded=float(recorded.max(initial=1)),
        order=float(np.argmax(size)),
        share=float(size.max()),
        moved=float(share[worst]),
        times=float(times[worst]),
    )
    names = {"sensors": joint.sensors}
    return [Finding("harmonics-across-left-out", severity, law.parameters[worst], numbers, names)]


def _change_of_values(
    problem: Problem, parameters: Array, across: ComplexArray, missing: ComplexArray
) -> Array:
    """Return the change (p,) of the values of the law by more harmonics (n, H+1) [m] of the motion across."""
    extended = np.array(missing)
    extended[:, : across.shape[1]] += across
    values = []
    for motion in (across, extended):
        seen = replace(problem.observed, points=replace(problem.observed.points, across=motion))
        trial = replace(problem, observed=seen)
        values.append(fit_balance(trial, parameters, order=1, exclude=False, correct=False).values)
    return np.asarray(values[1] - values[0])


def _unrecorded_harmonics(
    part: Part, found: Fit, across: Motion, response: ComplexArray, recorded: NDArray[np.intp]
) -> ComplexArray:
    """Return the unrecorded harmonics (n, H+1) [m] across by the law, in the measured phase."""
    joint, values = part.law, found.values[part.parameters]
    force = project(joint.along(across, values, SAMPLES_PER_PERIOD_SWITCHED).force, 1)
    far = _far_mass(force, response - across.harmonics[:, 1], across.omega)
    reduced = 1 / (1 / found.mass + 1 / (far or found.mass))
    size = np.abs(across.harmonics[:, 1])
    start = np.zeros((len(across), BALANCE_HARMONICS + 1), dtype=complex)
    follow, samples = following_harmonics(joint, BALANCE_HARMONICS), SAMPLES_PER_PERIOD_SWITCHED
    made = hold_amplitude(joint, values, reduced, across.omega, size, start, follow, samples)
    harmonics = np.where(made.valid[:, None] & np.isfinite(made.harmonics), made.harmonics, 0)
    harmonics = Motion(across.omega, harmonics).turned(np.angle(across.harmonics[:, 1])).harmonics
    harmonics[:, [0, *recorded.tolist()]] = 0
    return harmonics


def _far_mass(force: ComplexArray, motion: ComplexArray, omega: Array) -> float:
    """Return the mass [kg] on the far side that the force of the joint (n,) moves; 0 if unknown.

    It is unknown if the far side is no mass on a spring, has another drive, or the response is a third
    sensor.
    """
    size = np.abs(force)
    if not (size > 0).all():
        return 0.0
    columns = np.stack([motion, -(omega**2) * motion, 1j * omega * motion], axis=1) / size[:, None]
    matrix = np.concatenate([columns.real, columns.imag])
    right = np.concatenate([(force / size).real, (force / size).imag])
    values = solve_scaled(matrix, right)[0]
    misfit, mass = float(np.sqrt(np.sum((right - matrix @ values) ** 2) / len(force))), float(values[1])
    return mass if misfit < MISFIT_REJECTED and mass > 0 else 0.0
