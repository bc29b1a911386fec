"""What harmonics of a motion across two sensors that were not recorded can do to the values of a law.

A joint bends the motion across it more than the response. At a harmonic each of the two masses that it holds
apart answers its force N_h by inertia alone, m (h omega)^2 X_h = N_h here, -m_far (h omega)^2 X_far,h = N_h
there. The difference z = x - x_far obeys mu (h omega)^2 Z_h = N_h(z) with the reduced mass
1/mu = 1/m + 1/m_far: the balance of an oscillator of that mass at the amplitude that was measured. On two
masses, the far one hanging or on a spring of its own, with cubic joints and gaps, the third harmonic is
within 20 % of the exact one, 30 % where it meets a mode.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.finding import Finding, Severity, quantities
from rsgen.common.tolerances import (
    ERRORS,
    EXCESS,
    LARGE,
    MEANINGLESS,
    NOTICEABLE,
    ORDER,
    QUICK,
    SAME_NUMBER,
    SAMPLES_SWITCHED,
    TAKEN,
)
from rsgen.identification.fitting.fit import Fit, fit_balance
from rsgen.identification.fitting.forward import following_harmonics, hold_amplitude
from rsgen.identification.fitting.noise_across import pull_of_noise
from rsgen.identification.fitting.problem import Problem
from rsgen.law.motion import Motion, project
from rsgen.law.numeric import ForceLaw

__all__ = ["left_out_findings", "noise_across_findings"]


def left_out_findings(found: Fit, errors: Array) -> tuple[Finding, ...]:
    """Say how far values would move with the harmonics across that were not recorded; none or one finding.

    Parameters
    ----------
    found
        The refined fit.
    errors
        (q,) standard errors of the values of the law and of a free mass, as they are stated; NaN where one is
        not identifiable: it is not looked at.
    """
    law, points = found.problem.law, found.problem.observed.points
    some = np.flatnonzero(found.regression.used)
    some = some[points.select(some).spread(QUICK)]
    if not law.acts_across or points.across is None or not (found.mass > 0 and len(some)):
        return ()
    problem = found.problem.select(some)
    measured = problem.observed.mode(found.background)
    across = Motion(measured.omega, np.asarray(measured.across))
    recorded = np.flatnonzero((across.harmonics != 0).any(axis=0))
    missing = _missing(law, found, across, measured.harmonics[:, 1], recorded)
    moved = _moved(problem, found.regression.parameters, across.harmonics, missing)
    errors = errors[: len(law.parameters)]
    with np.errstate(all="ignore"):
        share, times = moved / np.abs(found.values), np.abs(moved) / errors
    large = np.isfinite(errors) & (np.abs(share) > NOTICEABLE)
    doubts = large & (((times > ERRORS) & (np.abs(share) > SAME_NUMBER)) | (np.abs(share) > LARGE))
    if not large.any():
        return ()
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
    names = {"sensors": problem.sensors}
    return (Finding("harmonics-across-left-out", severity, law.parameters[worst], numbers, names),)


def noise_across_findings(found: Fit, errors: Array, *, misfits: bool) -> tuple[Finding, ...]:
    """Doubt values that noise of the motion across, or what is not noise, leaves open; none or one finding.

    Parameters
    ----------
    found
        The refined fit, the pull of noise taken off.
    errors
        As for ``left_out_findings``.
    misfits
        Whether what the law leaves is systematic.
    """
    problem = found.problem
    pull = pull_of_noise(problem, found.regression, found.force_noise)
    if pull is None:
        return ()
    labels, numbers = {"sensors": problem.sensors}, {"noise": pull.noise, "part": pull.share}
    if pull.share >= TAKEN:
        return (Finding("noise-across", "doubt", "", quantities(**numbers), labels),)
    names = (*problem.law.parameters, "m")
    with np.errstate(all="ignore"):
        relative = pull.change / np.abs(found.regression.parameters[: problem.count])
        times = np.abs(pull.change) / errors
    doubts = (times > ERRORS) & (np.abs(relative) > SAME_NUMBER)
    if not doubts.any():
        return _unexplained(found, pull.noise) if misfits else ()
    worst = int(np.argmax(np.where(doubts, times, -1.0)))
    numbers |= {"moved": float(relative[worst]), "times": float(times[worst])}
    return (Finding("noise-across", "doubt", names[worst], quantities(**numbers), labels),)


def _unexplained(found: Fit, noise: float) -> tuple[Finding, ...]:
    """Doubt a systematic misfit that the sensors do not explain where harmonics across were not recorded.

    A joint that bends the motion across it is another one along a sine, and its law may fit all but a per
    cent with values that are nowhere near.
    """
    problem, misfit = found.problem, found.regression.noise
    across = problem.observed.points.across
    if across is None or (across[:, 2:] != 0).any() or misfit < max(EXCESS * noise, NOTICEABLE):
        return ()
    labels = {"sensors": problem.sensors}
    return (Finding("misfit-across", "doubt", "", quantities(noise=noise, misfit=misfit), labels),)


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
    law: ForceLaw, found: Fit, across: Motion, response: ComplexArray, recorded: NDArray[np.intp]
) -> ComplexArray:
    """(n, H+1) harmonics [m] across that the law makes and nobody recorded, in the phase measured."""
    part = next(part for part in law.parts if part.across)
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
    made = hold_amplitude(joint, values, mass, across.omega, size, start, follow, SAMPLES_SWITCHED)
    harmonics = np.where(made.valid[:, None] & np.isfinite(made.harmonics), made.harmonics, 0)
    return Motion(across.omega, harmonics).turned(np.angle(across.harmonics[:, 1])).harmonics
