"""Whether the two channels of a driven base are what they were read as.

Per unit mass a structure on a driven base weighs 1, whatever its law: with z = x - x_b

    -a_b = k(X) z - omega^2 z + i omega c(X) z,     k, c positive.

A channel read in the other sense of its phase, with the other sign, in place of the other one, or as motion
relative to the base where it is the absolute one breaks that equation, and undoing the mistake mends it.
"""

from __future__ import annotations

import numpy as np

from rsgen.arrays import Array, ComplexArray
from rsgen.finding import Finding, Quantity
from rsgen.surface.plausibility import driven_points
from rsgen.surface.response_surface import ResponseSurface

__all__ = ["base_findings"]

_TERMS = 4
"""Powers of the amplitude in k(X) and c(X) of the law that any law resembles at one harmonic."""

_POINTS_A_TERM = 3
"""Points for each of the values fitted, so that a fit can disagree."""

_MISFIT = 0.05
"""Below this misfit, relative, and with positive k and c, what was read fits; a mistake leaves a fifth."""

_BETTER = 0.5
"""Undoing a mistake must leave at most this share of the misfit: noise and a law that is missed stay."""

_AS_GOOD = 1.1
"""Where as it was read k or c is negative, so that it cannot be right, as good is good enough."""


def base_findings(surface: ResponseSurface, *, absolute: bool, senses: bool) -> tuple[Finding, ...]:
    """Find the mistake in reading a driven base that explains the test better than what was read; or none.

    Parameters
    ----------
    surface
        Of a driven base, with phases: force per mass minus the acceleration of the base, response relative.
    absolute
        Whether the response was read as absolute motion.
    senses
        Whether phases were read in a sense, as of tables; those of time histories have none.
    """
    rows = driven_points(surface)
    terms = min(_TERMS, (len(rows) // _POINTS_A_TERM) // 2)
    if not surface.phase_known or terms < 1:
        return ()
    omega = surface.omega[rows]
    base = surface.force[rows] / omega**2
    seen = surface.harmonics[rows, 1] + (base if absolute else 0)
    misfit, positive = _fit(base, seen, omega, absolute, terms)
    if positive and misfit < _MISFIT:
        return ()
    mistakes = {
        "sign": (base, -seen, absolute),
        "swapped": (seen, base, absolute),
        "reference": (base, seen, not absolute),
    }
    if senses:
        mistakes = {
            "sense-response": (base, np.conj(seen), absolute),
            "sense-base": (np.conj(base), seen, absolute),
            "sense-both": (np.conj(base), np.conj(seen), absolute),
        } | mistakes
    fits = {name: _fit(*motions[:2], omega, motions[2], terms) for name, motions in mistakes.items()}
    sound = {name: left for name, (left, fine) in fits.items() if fine and left < _MISFIT}
    best = min(sound, key=lambda name: sound[name], default="")
    if not best or sound[best] > (_BETTER if positive else _AS_GOOD) * misfit:
        return ()
    # without phase of its own the base says nothing of a sense: the first mistake that serves is taken
    best = next(name for name in sound if sound[name] < _AS_GOOD * sound[best])
    numbers = {"misfit": Quantity(misfit), "then": Quantity(sound[best])}
    names = {"is": best, "response": "relative" if absolute else "absolute"}
    return (Finding("base-misread", "error", "", numbers, names),)


def _fit(
    base: ComplexArray, seen: ComplexArray, omega: Array, absolute: bool, terms: int
) -> tuple[float, bool]:
    """Relative misfit of a law of any kind on a mass of 1, and whether its typical k and c are positive."""
    response = seen - base if absolute else seen
    force, rate = omega**2 * base, omega / omega.max()
    size = np.abs(response)
    if not size.max() > 0:
        return np.inf, False
    powers = np.stack([(size / size.max()) ** power for power in range(terms)])
    right = force + omega**2 * response
    weight = 1 / (np.abs(force) + omega**2 * size)
    columns = np.concatenate([powers * response, 1j * rate * powers * response]) * weight
    matrix = np.concatenate([columns.real, columns.imag], axis=1).T
    target = np.concatenate([(right * weight).real, (right * weight).imag])
    scale = np.linalg.norm(matrix, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    values = np.linalg.lstsq(matrix / scale, target, rcond=None)[0]
    left = target - matrix / scale @ values
    stiffness, damping = ((values / scale)[part] @ powers for part in (slice(terms), slice(terms, None)))
    positive = bool(np.median(stiffness) > 0) and bool(np.median(damping) > 0)
    return float(np.sqrt(np.sum(left**2) / len(force))), positive
