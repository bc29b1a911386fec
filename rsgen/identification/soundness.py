"""Whether a fit is worth its numbers: the points it set aside, the signs and phase of what it found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.finding import Finding, Quantity, Severity, quantities, severity_of
from rsgen.common.tolerances import (
    CHANCE,
    DEVIATING_MISFIT_RATIO,
    ERRORS,
    EXCESS,
    FEW,
    LARGE,
    MEANINGLESS,
    NOTICEABLE,
    ORDER,
    QUICK,
    ROUND_OFF,
    SAME_NUMBER,
    SAMPLES_SWITCHED,
    samples_for,
)
from rsgen.data.surface.columns import DERIVATIVE, QUANTITIES
from rsgen.dynamics.harmonic_balance import following_harmonics, hold_amplitude
from rsgen.dynamics.linear_part import Inertia
from rsgen.identification.fitting.across import motions_of, sensor_noise
from rsgen.identification.fitting.fit import Fit, fit_balance
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.observed import Problem
from rsgen.identification.fitting.points import Points
from rsgen.identification.results import Estimate
from rsgen.identification.results.estimates import damping_findings, takes_energy
from rsgen.law.motion import Motion, project, sine_motion
from rsgen.law.numeric import ForceLaw, Part
from rsgen.law.switched_sum import ForceSample

_MANY_ASIDE = 0.15
"""Points set aside beyond this share: what is left is a choice of points that suit the law."""

_SINGLE = 3
"""Points set aside up to this number may be single drop-outs of a small test."""

_STRETCH = 5
"""Neighbours set aside together from which on it is a piece of a run, not a jump that came early."""

_PIECE = 0.1
"""Share of a run from which on it is a piece of it."""

_WHOLE = 0.25
"""Share of a run set aside, wherever its points lie, from which on the run disagrees with the law."""

_BREAK_AWAY = 1.5
"""Amplitude of the force over that of dry friction up to which the mass may stand still for parts of a cycle:
4/pi at resonance (Den Hartog, Trans. ASME 53, 1931), and what noise adds."""

_SIGNS = 60
"""Points, evenly over the amplitude, at which the signs of k(X) and c(X) are looked at."""

_BEYOND = 1.5
"""Times the largest amplitude that transients reach on their way to a steady motion."""

_MOST = 0.5
"""Share of the points with a wrong sign beyond which the law as a whole has it."""

_EQUAL = 2e-4
"""Responses that differ by less, relative, are equal to within the rounding of a table of four digits."""

_AT_LIMIT = 0.98
"""The fundamental of a clipped sine is at least its limit; a filter may take a little."""


def aside_findings(
    points: Points,
    regression: Regression,
    tested: int,
    level_unit: str,
    *,
    decays: bool = False,
    stopped: NDArray[np.bool_] | None = None,
) -> list[Finding]:
    """Judge points set aside by their share, and by whether they lie together.

    Parameters
    ----------
    points, regression
        That were fitted.
    tested
        Points of the whole test.
    level_unit
        Of their levels: "N", or "m" where the response was held.
    decays
        True for a free decay. Noise does not fall with the motion, so that the small half of its points may
        be set aside for that alone; the large half is judged.
    stopped
        (n,) points that are no evidence against the law; see ``stopped_points``.
    """
    aside = ~regression.used
    if not aside.any():
        return []
    all_aside = int(np.count_nonzero(aside))
    if decays:
        aside = aside & (points.amplitude > np.median(points.amplitude))
    if stopped is not None:
        aside = aside & ~stopped
    count = int(np.count_nonzero(aside))
    share = count / len(points)
    severity = severity_of(share, FEW, _MANY_ASIDE) if count > _SINGLE else "warning"
    numbers = quantities(aside=all_aside, points=len(points), all=tested)
    found = [Finding("points-set-aside", severity, numbers=numbers)]
    for rows in points.runs:
        first, longest = _longest(aside[rows])
        lost = int(np.count_nonzero(aside[rows]))
        together = longest >= max(_STRETCH, _PIECE * len(rows))
        if together or (lost > _SINGLE and lost > _WHOLE * len(rows)):
            piece = np.arange(first, first + longest) if together else np.flatnonzero(aside[rows])
            ends = points.omega[rows[piece[[0, -1]]]] / (2 * np.pi)
            data = {"low": Quantity(float(ends[0]), "Hz"), "high": Quantity(float(ends[1]), "Hz")}
            data |= quantities(aside=lost, points=len(rows), together=longest)
            data["level"] = Quantity(float(points.level[rows[0]]), level_unit)
            found.append(Finding("points-set-aside", "doubt", numbers=data))
    return found


def stopped_points(points: Points, fit: Fit) -> NDArray[np.bool_]:
    """(n,) points without a prediction where friction nearly holds the mass: noise of the force decides."""
    return np.isnan(fit.regression.misfit) & nearly_held(points, fit)


def nearly_held(points: Points, fit: Fit) -> NDArray[np.bool_]:
    """(n,) points whose force hardly overcomes dry friction."""
    return np.asarray(np.abs(points.force) < _BREAK_AWAY * _dry_friction(fit.problem, fit.values))


def held_points(problem: Problem, parameters: Array) -> NDArray[np.bool_]:
    """(n,) points where friction takes nearly all of the force, and hardly any is left to move the mass.

    They say that the friction is as large as the force, and a balance of few harmonics, which has 4/pi of
    it, takes that for the friction of all others.
    """
    values, mass, background = problem.split(parameters)
    points = problem.observed.mode(background)
    friction = _dry_friction(problem, values)
    left = abs(mass) * points.omega**2 * points.amplitude
    size = np.abs(points.force)
    return np.asarray((size < _BREAK_AWAY * friction) & (left < LARGE * size))


def _dry_friction(problem: Problem, values: Array) -> float:
    """Force [N] up to which the law holds the mass at rest."""
    points, none = problem.observed.points, np.zeros(1)
    tiny = np.array([ROUND_OFF * float(np.max(points.amplitude * points.omega))])
    return float((problem.law.force(none, tiny, values) - problem.law.force(none, -tiny, values))[0]) / 2


def limit_findings(remarked: Sequence[Finding], fit: Fit) -> list[Finding]:
    """Find responses that end at one largest value, as those of an overloaded sensor do.

    Of a record the limit is ``remarked``. In a table equal largest values at neighbouring frequencies show
    it where they disagree with the law that the others obey: a response that was held obeys it.
    """
    points, miss = fit.problem.observed.points, np.nan_to_num(fit.regression.misfit, nan=np.inf)
    series = {
        unit: points.amplitude * points.omega**order
        for unit, order in zip(QUANTITIES.values(), DERIVATIVE.values(), strict=True)
    }
    known = [
        finding.numbers["limit"]
        for finding in remarked
        if finding.code == "range-reached" and finding.names["signal"] == "response"
    ]
    if known:
        limit = min(known)
        at = series[limit.unit] > _AT_LIMIT * limit.value
    else:
        equal = {unit: values > (1 - _EQUAL) * values.max() for unit, values in series.items()}
        unit, at = max(equal.items(), key=lambda item: int(np.count_nonzero(item[1])))
        limit = Quantity(float(series[unit].max()), unit)
        together = points.neighbours[at[points.neighbours].all(axis=1)]
        if len(np.unique(together)) < max(_STRETCH, np.count_nonzero(at) / 2):
            return []
    if not at.any() or at.all():
        return []
    misses = np.median(miss[at]) > max(DEVIATING_MISFIT_RATIO * np.median(miss[~at]), NOTICEABLE)
    if not (misses or (known and np.mean(at) > FEW)):
        return []
    numbers = quantities(at=int(np.count_nonzero(at)), points=len(points), limit=limit)
    return [Finding("range-reached", "doubt", numbers=numbers)]


def _longest(marks: NDArray[np.bool_]) -> tuple[int, int]:
    """Where the longest stretch of True begins, and its length."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marks.astype(int), [0]])))
    starts, lengths = edges[::2], edges[1::2] - edges[::2]
    if not len(starts):
        return 0, 0
    best = int(np.argmax(lengths))
    return int(starts[best]), int(lengths[best])


def sign_findings(points: Points, fit: Fit, wider: Array) -> list[Finding]:
    """Find a negative mass, and k(X) or c(X) of elements at one place that are negative where it was tested.

    Elements across two sensors and those that follow the response are judged apart: neither can make up for
    a spring or damper that the others have with the wrong sign. Errors are (q,) times ``wider``.
    """
    regression, problem = fit.regression, fit.problem
    basis = regression.basis * regression.noise * wider[:, None]
    found = []
    if fit.mass < -CHANCE * float(np.linalg.norm(basis[len(problem.law.parameters)])):
        found.append(Finding("mass-negative", "error", "m", {"mass": Quantity(fit.mass, "kg")}))
    for part, followed in _followed(points, fit):
        place = part.parameters
        stiffness, damping = _signs_at(part, followed, fit.values[place], basis[place])
        names = {"sensors": part.sensors} if part.sensors else {}
        found += _sign_finding("stiffness-negative", stiffness, names)
        found += _sign_finding("damping-negative", damping, names)
    return found


def feeding_findings(points: Points, fit: Fit, estimates: Sequence[Estimate]) -> list[Finding]:
    """Find dampers of all parts of a law that feed energy into the motion."""
    followed = _followed(points, fit)
    return [
        finding
        for part, motion in followed
        for finding in damping_findings(part.law, motion, fit.values[part.parameters], estimates)
    ]


def _is_active(law: ForceLaw, sample: ForceSample, velocity: Array, values: Array) -> bool:
    """Whether some term feeds energy into the motion as it is written: -c*v, the damper of van der Pol."""
    for place in law.linear:
        power = np.broadcast_to(sample.by_parameter[place], velocity.shape) * velocity
        work, size = np.mean(values[place] * power, axis=1), np.mean(np.abs(values[place] * power), axis=1)
        if not takes_energy(power) and np.any(work < -NOTICEABLE * size):
            return True
    return False


def _followed(points: Points, fit: Fit) -> list[tuple[Part, Motion]]:
    """Parts of the law with the motion that each follows, at points spread over the amplitude."""
    used = np.flatnonzero(fit.regression.used & np.isfinite(fit.harmonics).all(axis=1))
    some = used[points.select(used).spread(_SIGNS)]
    if not len(some):
        return []
    motion, law = Motion(points.omega[some], fit.harmonics[some]), fit.problem.law
    return list(zip(law.parts, motions_of(law, motion, points.select(some)), strict=True))


_Negative = dict[str, Quantity]
"""Where k(X) or c(X) is negative, and how much; empty where it is not."""


def _signs_at(place: Part, motion: Motion, values: Array, basis: Array) -> tuple[_Negative, _Negative]:
    """Find a negative k(X) or c(X) of the elements at one place; (p, r) ``basis`` of errors of its values.

    c is the work of a cycle over that of a damper of 1 N s/m: of a motion that is no sine the fundamental
    alone may lose to the harmonics what the cycle as a whole does not.
    """
    motion = motion.select(np.abs(motion.harmonics[:, 1]) > 0)
    if not len(motion):
        return {}, {}
    samples = max(samples_for(place.law.switched), 8 * len(motion.orders))
    sample, velocity = place.law.along(motion, values, samples), motion.waveforms(samples)[1]
    size, rate = motion.harmonics[:, 1], velocity / np.mean(velocity**2, axis=1, keepdims=True)
    by_stiffness = _stacked([(project(by, 1) / size).real for by in sample.by_parameter], size)
    # what takes energy at every instant is no spring, though friction that sticks has a part in phase
    dampers = [j for j in place.law.linear if takes_energy(sample.by_parameter[j] * velocity)]
    by_damping = _stacked([np.mean(by * rate, axis=1) for by in sample.by_parameter], size)
    amplitude, speed = np.abs(size), np.sqrt(np.mean(velocity**2, axis=1))
    # of a law without springs, or without dampers, k(X) or c(X) is the round-off of its force
    least = ROUND_OFF * np.max(np.abs(sample.force), axis=1)
    k, c = (project(sample.force, 1) / size).real, np.mean(sample.force * rate, axis=1)
    k = k - by_stiffness[:, dampers] @ values[dampers]
    by_stiffness[:, dampers] = 0.0
    stiffness = _negative(amplitude, k, by_stiffness @ basis, "N/m", least / amplitude)
    damping = _negative(amplitude, c, by_damping @ basis, "N*s/m", least / speed)
    if damping and np.sum(c * speed**2) > 0 and _is_active(place.law, sample, velocity, values):
        # some of the tested motions may live on what such a damper feeds, but not all together
        damping = {}
    return stiffness, damping


def _stacked(columns: list[Array], like: NDArray[np.complex128]) -> Array:
    """(n, columns), of none too."""
    return np.stack(columns, axis=1) if columns else np.zeros((len(like), 0))


def runs_away(fit: Fit) -> bool:
    """Decide whether a law pushes the mass away just beyond the tested amplitudes, or has no force there.

    A simulation would carry such motions for thousands of periods and settle none of them.
    """
    size = np.abs(fit.harmonics[fit.regression.used, 1])
    if not size.size or not np.isfinite(size).all():
        return True
    omega = np.median(fit.problem.observed.points.omega)
    motion = sine_motion(np.array([omega]), _BEYOND * size.max(keepdims=True))
    force = fit.problem.law.along(motion, fit.values, SAMPLES_SWITCHED).force
    return not bool(project(force, 1)[0].real > 0)


def _negative(size: Array, value: Array, spread: Array, unit: str, least: Array | float = 0.0) -> _Negative:
    """Where k(X) or c(X) is negative beyond error and ``least``; empty where it is at hardly any point."""
    wrong = value < -CHANCE * np.linalg.norm(spread, axis=1) - least
    share = float(np.mean(wrong))
    if not share > FEW:
        return {}
    return {
        "least": Quantity(float(value[wrong].min()), unit),
        "low": Quantity(float(size[wrong].min()), "m"),
        "high": Quantity(float(size[wrong].max()), "m"),
        "share": Quantity(share),
    }


def _sign_finding(code: str, found: _Negative, names: dict[str, str]) -> list[Finding]:
    """Make the finding of what ``_negative`` found of some elements; none of nothing."""
    severity: Severity = "error" if found and found["share"].value > _MOST else "doubt"
    return [Finding(code, severity, "", found, names)] if found else []


_OF_NOISE = 0.2
"""Share of noise in the information on a combination of values from which on its errors are not those stated:
at a quarter a stiffness across was 14 % too large on the average, and 17 % of its intervals missed."""


# ----------------------------------------------------------------------------
# What harmonics of a motion across two sensors that were not recorded can do to the values of a law.
#
# A joint bends the motion across it more than the response. At a harmonic each of the two masses that it
# holds
# apart answers its force N_h by inertia alone, m (h omega)^2 X_h = N_h here, -m_far (h omega)^2 X_far,h =
# N_h
# there. The difference z = x - x_far obeys mu (h omega)^2 Z_h = N_h(z) with the reduced mass
# 1/mu = 1/m + 1/m_far: the balance of an oscillator of that mass at the amplitude that was measured. On two
# masses, the far one hanging or on a spring of its own, with cubic joints and gaps, the third harmonic is
# within 20 % of the exact one, 30 % where it meets a mode.


def across_findings(found: Fit, errors: Array, *, misfits: bool) -> tuple[Finding, ...]:
    """Find what sensors on both sides of a joint leave open of the values.

    Parameters
    ----------
    found
        The refined fit.
    errors
        (p,) standard errors of the values of the law as they are stated; NaN where one is fixed or not
        identifiable: it is not looked at.
    misfits
        Whether the misfit is systematic.
    """
    findings: list[Finding] = []
    for joint in found.problem.law.parts[1:]:
        findings += _left_out(found, joint, errors)
        findings += _noise_across(found, joint)
        findings += _misfit_across(found, joint) if misfits else []
    return tuple(findings)


def _left_out(found: Fit, joint: Part, errors: Array) -> list[Finding]:
    """Say how far values would move with the harmonics across that were not recorded; none or one finding."""
    law, points = found.problem.law, found.problem.observed.points
    some = np.flatnonzero(found.regression.used)
    some = some[points.select(some).spread(QUICK)]
    if not (found.mass > 0 and len(some)):
        return []
    problem = found.problem.select(some)
    measured = problem.observed.mode(found.background)
    across = Motion(measured.omega, measured.across)
    recorded = np.flatnonzero((across.harmonics != 0).any(axis=0))
    missing = _missing(joint, found, across, measured.harmonics[:, 1], recorded)
    moved = _moved(problem, found.regression.parameters, across.harmonics, missing)
    with np.errstate(all="ignore"):
        share, times = moved / np.abs(found.values), np.abs(moved) / errors
    large = np.isfinite(errors) & (np.abs(share) > NOTICEABLE)
    doubts = large & (((times > ERRORS) & (np.abs(share) > SAME_NUMBER)) | (np.abs(share) > LARGE))
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


def _noise_across(found: Fit, joint: Part) -> list[Finding]:
    """Doubt values where noise of the two sensors is what the fit knows of some combination of them."""
    share = found.regression.noise_share
    if not share > _OF_NOISE:
        return []
    numbers = quantities(noise=sensor_noise(found.problem.observed.points, joint.sensors), part=share)
    return [Finding("noise-across", "doubt", "", numbers, {"sensors": joint.sensors})]


def _misfit_across(found: Fit, joint: Part) -> list[Finding]:
    """Doubt a systematic misfit that the sensors do not explain where harmonics across were not recorded.

    A joint that bends the motion across it is another one along a sine, and its law may fit all but a per
    cent with values that are nowhere near.
    """
    points, misfit = found.problem.observed.points, found.regression.noise
    higher = points.across[:, 2:]
    if higher.any():
        return []
    noise = sensor_noise(points, joint.sensors)
    # a misfit relative to the response is larger relative to the motion across
    smaller = float(np.median(np.abs(points.far[:, 0] / points.harmonics[:, 1])))
    if not misfit >= max(EXCESS * noise, NOTICEABLE * min(smaller, 1.0)):
        return []
    names = {"sensors": joint.sensors}
    return [Finding("harmonics-across-left-out", "doubt", "", quantities(noise=noise, misfit=misfit), names)]


def _moved(problem: Problem, parameters: Array, across: ComplexArray, missing: ComplexArray) -> Array:
    """(p,) change of the values of the law by harmonics (n, H+1) [m] beside those of the motion across."""
    whole = np.array(missing)
    whole[:, : across.shape[1]] += across
    values = []
    for motion in (across, whole):
        seen = replace(problem.observed, points=replace(problem.observed.points, across=motion))
        trial = replace(problem, observed=seen)
        values.append(fit_balance(trial, parameters, order=1, reject=False, correct=False).values)
    return np.asarray(values[1] - values[0])


def _missing(
    part: Part, found: Fit, across: Motion, response: ComplexArray, recorded: NDArray[np.intp]
) -> ComplexArray:
    """(n, H+1) harmonics [m] across that the law makes and nobody recorded, in the phase measured."""
    joint, values = part.law, found.values[part.parameters]
    force = project(joint.along(across, values, SAMPLES_SWITCHED).force, 1)
    far = _far_mass(force, response - across.harmonics[:, 1], across.omega)
    reduced = 1 / (1 / found.mass + 1 / (far or found.mass))
    harmonics = _of_joint(joint, values, reduced, across)
    harmonics[:, [0, *recorded.tolist()]] = 0
    return harmonics


def _far_mass(force: ComplexArray, motion: ComplexArray, omega: Array) -> float:
    """Mass [kg] that the force of the joint (n,) moves on the far side; 0 where that is no mass on a spring.

    Where the response is not one of the two sensors, or something else drives the far side, nothing is known.
    """
    size = np.abs(force)
    if not (size > 0).all():
        return 0.0
    columns = np.stack([motion, -(omega**2) * motion, 1j * omega * motion], axis=1) / size[:, None]
    matrix = np.concatenate([columns.real, columns.imag])
    right = np.concatenate([(force / size).real, (force / size).imag])
    scale = np.linalg.norm(matrix, axis=0)
    if not (np.isfinite(scale).all() and (scale > 0).all()):
        return 0.0
    values = np.linalg.lstsq(matrix / scale, right, rcond=None)[0]
    misfit = float(np.sqrt(np.sum((right - matrix / scale @ values) ** 2) / len(force)))
    mass = float(values[1] / scale[1])
    return mass if misfit < MEANINGLESS and mass > 0 else 0.0


def _of_joint(joint: ForceLaw, values: Array, mass: float, across: Motion) -> ComplexArray:
    """(n, H+1) harmonics [m] of an oscillator of a mass [kg] with the law of the joint; zero where none."""
    size, start = np.abs(across.harmonics[:, 1]), np.zeros((len(across), ORDER + 1), dtype=complex)
    follow = following_harmonics(joint, ORDER)
    made = hold_amplitude(joint, values, Inertia(mass), across.omega, size, start, follow, SAMPLES_SWITCHED)
    harmonics = np.where(made.valid[:, None] & np.isfinite(made.harmonics), made.harmonics, 0)
    return Motion(across.omega, harmonics).turned(np.angle(across.harmonics[:, 1])).harmonics
