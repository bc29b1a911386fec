"""Forces without a law where the motion leaves the middle: splines balanced along the measured motion.

An uneven spring pushes the mean off zero, so that k(X) alone does not tell it. With the measured motion
x(t) = Re sum_h X_h exp(i h omega t), mean included, a spring n_s(x) and an odd damper n_d(v) obey

    mean of n_s + n_d = 0,    fundamental of n_s + n_d = F + m omega^2 X_1

at every point. Both are linear in the coefficients of splines for n_s over the whole range of x and for n_d
over that of |v|, and together they tell the two sides of the spring apart. No harmonic is neglected.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.points import Points
from rsgen.identification.regression import solve_scaled
from rsgen.identification.result import RestoringForce

__all__ = ["invert_motion"]

Array = NDArray[np.float64]

_DRAWN = 61
_DEGREE = 3
_INTERVALS = (8, 8)
"""Of the splines of spring (on each side of zero, where it may have a corner) and damper."""

_POINTS = 600
"""At most so many points of the test are used."""

_CLEAR = 4.0
"""A harmonic so many times larger than the noise is not noise."""

_FEWEST = 64
_SAMPLES = 128
_NORMAL = 1.96
_STIFFENING = 1e-7
"""Weight of the curvature of a spline: settles it where there are no points, without effect elsewhere."""


def invert_motion(points: Points, mass: float, noise: float) -> RestoringForce | None:
    """Draw the whole stiffness force, and the damping force taken as odd, from measured motions.

    Parameters
    ----------
    points
        With the mean among the measured harmonics.
    mass
        m [kg].
    noise
        Relative noise of the response: a higher harmonic that does not rise above it is left out of x(t).

    Returns
    -------
    RestoringForce or None
        None where fewer than 64 points remain.
    """
    if len(points) < _FEWEST:
        return None
    points = points.select(points.spread(_POINTS))
    angle = 2 * np.pi * np.arange(_SAMPLES) / _SAMPLES
    orders = np.arange(points.harmonics.shape[1])
    wave = np.exp(1j * orders[:, None] * angle)
    clear = np.abs(points.harmonics) > _CLEAR * noise * points.amplitude[:, None]
    clear[:, :2] = True
    motion = np.where(clear, points.harmonics, 0)
    x = (motion @ wave).real
    v = ((1j * orders * points.omega[:, None] * motion) @ wave).real
    low, high, fast = float(x.min()), float(x.max()), float(np.abs(v).max())

    if low < 0 < high:
        # three knots at zero let the two sides meet in a corner
        left, right = (np.linspace(0, end, _INTERVALS[0] + 1) for end in (low, high))
        on_spring = np.concatenate([left[::-1], np.zeros(1), right])
    else:
        on_spring = np.linspace(low, high, 2 * _INTERVALS[0] + 1)
    on_damper = np.linspace(0, fast, _INTERVALS[1] + 1)

    def spring_values(at: Array) -> Array:
        return _splines(at, on_spring)

    def damper_values(at: Array) -> Array:
        return _splines(at, on_damper)

    spring = spring_values(x)
    damper = np.sign(v)[..., None] * damper_values(np.abs(v))
    functions = np.concatenate([spring, damper], axis=2)
    # time zero of the motion is that of the complex amplitudes, so the fundamental is taken about it
    fundamental = np.einsum("nsf,s->nf", functions, np.exp(-1j * angle)) * (2 / _SAMPLES)
    size, force = points.amplitude, np.abs(points.force)
    # noise of the mean reaches the balance through the stiffness, that of the fundamental through F/X
    firm = mass * points.omega**2 * size
    blocks = [functions.mean(axis=1) / firm[:, None]]
    rights = [np.zeros(len(points))]
    known = (points.force + mass * points.omega**2 * points.harmonics[:, 1]) / force
    blocks += [fundamental.real / force[:, None], fundamental.imag / force[:, None]]
    rights += [known.real, known.imag]
    matrix, balance = np.concatenate(blocks), np.concatenate(rights)
    counts = (spring.shape[2], damper.shape[2])
    stiff = np.zeros((sum(counts) - 4, sum(counts)))
    stiff[: counts[0] - 2, : counts[0]] = np.diff(np.eye(counts[0]), 2, axis=0)
    stiff[counts[0] - 2 :, counts[0] :] = np.diff(np.eye(counts[1]), 2, axis=0)
    stiff *= _STIFFENING * np.abs(matrix).max() * np.sqrt(len(balance))
    solution, inverse, _ = solve_scaled(
        np.concatenate([matrix, stiff]), np.concatenate([balance, np.zeros(len(stiff))])
    )
    freedom = max(len(balance) - sum(counts), 1)
    variance = float(np.sum((balance - matrix @ solution) ** 2)) / freedom

    chosen = (slice(0, counts[0]), slice(counts[0], None))
    places = (np.linspace(low, high, _DRAWN), np.linspace(0, fast, _DRAWN))
    drawn = []
    for part, place, values in zip(chosen, places, (spring_values, damper_values), strict=True):
        operator = values(place)
        band = _NORMAL * np.sqrt(variance) * np.sqrt(np.sum((operator @ inverse[part]) ** 2, axis=1))
        drawn += [place, operator @ solution[part], band]
    return RestoringForce(*drawn)


def _splines(at: Array, knots: Array) -> Array:
    """(..., f) cubic B-splines over knots."""
    from scipy.interpolate import BSpline

    whole = np.concatenate([[knots[0]] * _DEGREE, knots, [knots[-1]] * _DEGREE])
    inside = np.clip(at, knots[0], knots[-1]).ravel()
    return np.asarray(BSpline.design_matrix(inside, whole, _DEGREE).toarray().reshape(*at.shape, -1))
