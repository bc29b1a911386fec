"""Whether the two channels of a driven base are what they were read as.

Per unit mass a structure on a driven base weighs 1, whatever its law: with z = x - x_b

    -a_b = k(X) z - omega^2 z + i omega c(X) z,     k, c positive.

A channel read in the other sense of its phase, with the other sign, in place of the other one, or as motion
relative to the base where it is the absolute one breaks that equation, and undoing the mistake mends it.
So does a channel whose unit or factor is another one than was read.
"""

from __future__ import annotations

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.finding import Finding, Quantity
from rsgen.data.surface.plausibility import AS_GOOD, BETTER, FITS, driven_points, fit_any_law, powers_for
from rsgen.data.surface.response_surface import ResponseSurface

__all__ = ["base_findings"]

_SCALES = {
    "gravity": 9.80665,
    "milli": 1000.0,
    "both": 9806.65,
    "rms": 2**0.5,
    "peak-to-peak": 2.0,
}
"""What a channel is too large or too small by where g, thousandths, root mean squares or peaks to peaks were
read as something else: the mistakes that laboratories make; others have no name."""

_OF_UNITS = 3
"""The first of these factors are of units, which go with another quantity: a root mean square does not."""


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
    powers = powers_for(len(rows), mass=False)
    if not surface.phase_known or not powers:
        return ()
    omega = surface.omega[rows]
    base = surface.force[rows] / omega**2
    seen = surface.harmonics[rows, 1] + (base if absolute else 0)
    misfit, positive = _fit(base, seen, omega, absolute, powers)
    if positive and misfit < FITS:
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
    fits = {name: _fit(*motions[:2], omega, motions[2], powers) for name, motions in mistakes.items()}
    sound = {name: left for name, (left, fine) in fits.items() if fine and left < FITS}
    best = min(sound, key=lambda name: sound[name], default="")
    scaled = _scaled(base, seen, omega, absolute, powers)
    if scaled:
        still, moved, against = mistakes.get(best, (base, seen, absolute))
        of_law, _ = _fit(still, moved, omega, against, powers, of_law=True)
        if scaled[0]["then"] < BETTER * of_law:
            return scaled
    if not best or sound[best] > (BETTER if positive else AS_GOOD) * misfit:
        return ()
    # without phase of its own the base says nothing of a sense: the first mistake that serves is taken
    best = next(name for name in sound if sound[name] < AS_GOOD * sound[best])
    numbers = {"misfit": Quantity(misfit), "then": Quantity(sound[best])}
    names = {"is": best, "response": "relative" if absolute else "absolute"}
    return (Finding("base-misread", "error", "", numbers, names),)


def _scaled(
    base: ComplexArray, seen: ComplexArray, omega: Array, absolute: bool, powers: range
) -> tuple[Finding, ...]:
    """Find a factor of one channel against the other that leaves a law of any kind; or none.

    Misfits are relative to the force of the law: of a response that is far too small next to nothing is left
    of it, and beside the inertia of the base any law would fit.
    """
    misfit, _ = _fit(base, seen, omega, absolute, powers, of_law=True)
    factors = [(name, by**sign, 0) for name, by in _SCALES.items() for sign in (1, -1)]
    factors += [
        ("quantity", by, order)
        for order in (-2, -1, 1, 2)
        for by in (1.0, *(scale**sign for scale in list(_SCALES.values())[:_OF_UNITS] for sign in (1, -1)))
    ]
    fits = [
        _fit(base, by * (1j * omega) ** order * seen, omega, absolute, powers, of_law=True)
        for _, by, order in factors
    ]
    limit = min(FITS, BETTER * misfit)
    sound = [
        (left, *factor) for (left, fine), factor in zip(fits, factors, strict=True) if fine and left < limit
    ]
    if not sound:
        return ()
    then, name, by, order = min(sound)
    numbers = {"misfit": Quantity(misfit), "then": Quantity(then), "by": Quantity(by)}
    numbers |= {"order": Quantity(order)} if order else {}
    return (Finding("base-scaled", "error", "", numbers, {"is": name}),)


def _fit(
    base: ComplexArray,
    seen: ComplexArray,
    omega: Array,
    absolute: bool,
    powers: range,
    *,
    of_law: bool = False,
) -> tuple[float, bool]:
    """Relative misfit of a law of any kind on a mass of 1, and whether its typical k and c are positive."""
    response = seen - base if absolute else seen
    if not np.abs(response).max() > 0:
        return np.inf, False
    force, inertia = omega**2 * base, -(omega**2) * response
    size = np.abs(force - inertia) if of_law else np.abs(force) + np.abs(inertia)
    if not (size > 0).all():
        return np.inf, False
    weight = 1 / size
    left, (_, *signs) = fit_any_law(force - inertia, response, omega, powers, weight, mass=False)
    return float(np.linalg.norm(left) / np.sqrt(len(force))), all(value > 0 for value in signs)
