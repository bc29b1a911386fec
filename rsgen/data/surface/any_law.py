"""The law that any law resembles at one harmonic, fitted to a test before one is chosen.

    F/X = k(X) - m omega^2 + i omega c(X)

with k and c sums of a few powers of the amplitude and positive m, k, c. A reading that is mistaken breaks
this equation, and undoing the mistake mends it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.surface.response_surface import ResponseSurface

__all__ = ["AS_GOOD", "BETTER", "FITS", "driven_points", "fit_any_law", "powers_for"]

FITS = 0.05
"""Below this misfit, relative, what was read fits; of a mistake a fifth or a quarter is left."""

BETTER = 0.5
"""Undoing a mistake must leave at most this share of the misfit: noise and a law that is missed stay; of
measured tests other quantities leave 0.98 and more."""

AS_GOOD = 1.1
"""Where as it was read m, k or c is negative, so that it cannot be right, as good is good enough."""

_TERMS = 4
"""Powers of the amplitude in k(X) and c(X)."""

_POINTS_A_TERM = 3
"""Points for each of the values fitted, so that a fit can disagree."""

_FAINT = 1e-6
"""Forces, responses and frequencies below this share of the largest are none: instruments resolve no less."""

_SINGULAR = 1e-10
"""Combinations of terms that the points tell apart by less, relative, are round-off."""


def driven_points(surface: ResponseSurface) -> NDArray[np.intp]:
    """Find the points at which there is a force and a response to it."""
    good = surface.settled & np.isfinite(surface.harmonics[:, 1]) & np.isfinite(surface.force)
    for values in (surface.force, surface.harmonics[:, 1], surface.omega):
        size = np.where(good, np.abs(values), 0.0)
        good = good & (size > max(_FAINT * size.max(initial=0.0), np.finfo(float).tiny))
    return np.flatnonzero(good)


def powers_for(points: int, *, mass: bool) -> range:
    """Powers of the amplitude that so many points determine, beside a mass or without; none of too few."""
    return range(min(_TERMS, (points // _POINTS_A_TERM - mass) // 2))


def fit_any_law(
    force: ComplexArray,
    response: ComplexArray,
    omega: Array,
    powers: Sequence[int],
    weight: Array,
    *,
    mass: bool,
) -> tuple[Array, tuple[float, float, float]]:
    """Fit k(X), c(X) and, where it is free, m; without it the inertia is part of the force.

    Parameters
    ----------
    force, response, omega, weight
        (n,) at every point, in any unit; responses are not all zero.
    powers
        Of the amplitude.

    Returns
    -------
    residual
        (2 n,) real parts, then imaginary parts, times the weight.
    values
        m and the typical k and c, up to positive factors; m is 1 where it was not fitted.
    """
    rate, response = omega / omega.max(), response / (np.abs(response).max() or 1.0)
    # a motion that was taken off as a whole explains nothing
    size = np.maximum(np.abs(response), np.finfo(float).tiny ** 0.25)
    shapes = np.stack([size**power for power in powers])
    inertia = -(rate**2 * response)[None] if mass else np.zeros((0, len(force)))
    columns = np.concatenate([shapes * response, 1j * rate * shapes * response, inertia])
    columns = columns * (weight / weight.max())
    matrix = np.concatenate([columns.real, columns.imag], axis=1).T
    target = np.concatenate([(force * weight).real, (force * weight).imag])
    scale = np.linalg.norm(matrix, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    matrix = matrix / scale
    values = np.linalg.lstsq(matrix, target, rcond=_SINGULAR)[0]
    stiffness, damping = (values / scale)[: 2 * len(shapes)].reshape(2, -1) @ shapes
    inertial = float(values[-1]) if mass else 1.0
    return target - matrix @ values, (inertial, float(np.median(stiffness)), float(np.median(damping)))
