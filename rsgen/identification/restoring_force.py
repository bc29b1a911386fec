"""Restoring force without a law: by Abel inversion of k(X) and c(X), or by splines along measured motions.

The describing-function integral X k(X) = 2/pi integral_0^pi n(X cos t) cos t dt is of Abel type and inverts
in closed form. With g(X) = X k(X), the amplitude of the fundamental of the stiffness force, an odd force is

    n(x) = integral_0^(pi/2) sin^2(t) g(x sin t) dt + x/2 integral_0^(pi/2) sin^3(t) g'(x sin t) dt,

which is n(x) = 1/(2x) d/dx integral_0^x X^3 k(X)/sqrt(x^2 - X^2) dX after X = x sin t; likewise the damping
force from V c(V) with V = omega X. For a force that is not odd the result is its odd part. A spline is fitted
to g, which stays finite where k does not (friction: c grows as 1/V).

An asymmetric spring shifts the mean displacement, so that k(X) alone does not determine it. Along the
measured motion with its mean, a spring n_s(x) and an odd damper n_d(v) obey

    mean of n_s + n_d = 0,    fundamental of n_s + n_d = F + m omega^2 X_1

at every point. Both equations are linear in the coefficients of splines for n_s over the range of x and for
n_d over that of |v|, and separate the two sides of the spring. No measured harmonic is neglected.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray, blocks
from rsgen.common.solvers import b_splines, solve_scaled
from rsgen.common.tolerances import (
    JACKKNIFE_GROUPS,
    MAX_ALTERNATIONS,
    MIN_SIGNIFICANT_GAIN,
    NOISE_LIMIT_SIGMAS,
    NOISE_RATIO_BY_CHANCE,
    POINTS_PER_KNOT,
    SAMPLES_PER_PERIOD,
    SAMPLES_PER_PERIOD_SWITCHED,
    SPLINE_SMOOTHING,
    interval_sigmas,
)
from rsgen.data.surface import ResponseSurface, typical_amounts
from rsgen.identification.fitting.fit import Fit
from rsgen.identification.fitting.points import Points
from rsgen.identification.results import EquivalentCurve, Resonance, RestoringForce
from rsgen.law.motion import Motion, project, sine_motion

_CURVE_POINTS = 61
_DEGREE = 3
"""Degree of the splines."""

_MAX_INTERVALS = 24
"""Intervals of the spline of an odd force; a corner is smoothed over one of them."""

_MAX_POINTS = 600
"""Fitted points for a force that is not odd, spread over the amplitude."""

_INTERVALS = (1, 2, 3, 4, 6, 8)
"""Tried numbers of intervals of the damper, and of each side of the spring, which may have a corner at zero.
"""

_MAX_DEGREES = (5, 2)
"""Degrees in amplitude and frequency of the polynomial surface of a mean or a harmonic."""

_BLOCK = 32
"""Motions along which splines are evaluated at once: their samples stay in the processor's cache."""

_MIN_RESIDUAL_RATIO = 0.01
"""Least residual of mean, real or imaginary part that sets its weight, relative to the largest of them."""


def invert_curve(curve: EquivalentCurve, mass: float) -> RestoringForce | None:
    """Invert the equivalent curve to the stiffness and the damping force.

    Parameters
    ----------
    curve
        Equivalent stiffness and damping of all points; those that took part in the fits are used.
    mass
        m [kg] of the curve; gives the force of every point, by which it is weighted.

    Returns
    -------
    RestoringForce or None
        None if fewer than 16 points remain.
    """
    used = curve.used & np.isfinite(curve.stiffness) & np.isfinite(curve.damping)
    if np.count_nonzero(used) < 2 * POINTS_PER_KNOT:
        return None
    size = curve.amplitude[used]
    omega = 2 * np.pi * curve.frequency[used]
    stiffness, damping = curve.stiffness[used], curve.damping[used]
    force = size * np.hypot(stiffness - mass * omega**2, omega * damping)
    # a spring does not jump at rest, a damper may
    x, spring, spring_band, _ = _invert_describing_function(size, size * stiffness, force, free=False)
    tied, free = (
        _invert_describing_function(omega * size, omega * size * damping, force, free=free)
        for free in (False, True)
    )
    jumps = free[3] < tied[3] * (1 - MIN_SIGNIFICANT_GAIN / len(size))
    v, damper, damper_band, _ = free if jumps else tied
    return RestoringForce(x, spring, spring_band, v, damper, damper_band)


def _invert_describing_function(
    reach: Array, amplitude: Array, spread: Array, *, free: bool
) -> tuple[Array, Array, Array, float]:
    """Return points x, n(x), half width of its band, and the sum of squares.

    ``amplitude`` is g(X) at the amplitudes ``reach`` with errors ``spread``; g(0) = 0 unless it is ``free``.
    """
    largest = float(reach.max())
    knots, operator = _abel(int(np.clip(len(reach) // POINTS_PER_KNOT, 2, _MAX_INTERVALS)))
    functions = len(knots) - _DEGREE - 1
    matrix = b_splines(reach / largest, knots, _DEGREE)[0] / spread[:, None]
    curvature = np.diff(np.eye(functions), 2, axis=0)
    curvature *= SPLINE_SMOOTHING * np.abs(matrix).max() * np.sqrt(len(reach))
    if not free:
        # the first spline is the only one that is not zero at zero
        matrix[:, 0] = 0
        curvature[:, 0] = 0
    rows = np.concatenate([matrix, curvature])
    right = np.concatenate([amplitude / spread, np.zeros(len(curvature))])
    solution, inverse, _ = solve_scaled(rows, right)
    freedom = max(len(reach) - functions, 1)
    squares = float(np.sum((amplitude / spread - matrix @ solution) ** 2))
    variance = squares / freedom
    wide = interval_sigmas() * np.sqrt(variance)
    band = wide * np.sqrt(np.sum((operator @ inverse) ** 2, axis=1))
    return np.linspace(0, largest, _CURVE_POINTS), operator @ solution, band, squares


@lru_cache(maxsize=4)
def _abel(intervals: int) -> tuple[Array, Array]:
    """Return the knots of a spline g over 0 to 1, and the map (x, f) from its coefficients to n(x)."""
    knots = np.concatenate([np.zeros(_DEGREE), np.linspace(0, 1, intervals + 1), np.ones(_DEGREE)])
    nodes, weights = np.polynomial.legendre.leggauss(64)
    sine = np.sin(np.pi / 4 * (nodes + 1))
    weights = weights * np.pi / 4
    x = np.linspace(0, 1, _CURVE_POINTS)
    inside = (x[:, None] * sine).ravel()
    value, slope = (part.reshape(_CURVE_POINTS, len(sine), -1) for part in b_splines(inside, knots, _DEGREE))
    operator = np.einsum("t,xtf->xf", weights * sine**2, value)
    operator += 0.5 * x[:, None] * np.einsum("t,xtf->xf", weights * sine**3, slope)
    return knots, operator


@dataclass(frozen=True, slots=True)
class _SplineShape:
    """Ranges and intervals of the splines of spring and damper; the same for all jackknife groups.

    Parameters
    ----------
    ends
        Smallest and largest displacement [m] and largest velocity [m/s].
    intervals
        Number of intervals.
    """

    ends: tuple[float, float, float]
    intervals: int

    @property
    def places(self) -> tuple[Array, Array]:
        """Displacements and velocities of the curves."""
        low, high, fast = self.ends
        return np.linspace(low, high, _CURVE_POINTS), np.linspace(0, fast, _CURVE_POINTS)

    def spring(self, at: Array) -> Array:
        """Return the splines (..., f) of the stiffness force."""
        low, high, _ = self.ends
        if low < 0 < high:
            # a triple knot allows a corner at zero
            left, right = (np.linspace(0, end, self.intervals + 1) for end in (low, high))
            return _splines(at, np.concatenate([left[::-1], np.zeros(1), right]))
        return _splines(at, np.linspace(low, high, 2 * self.intervals + 1))

    def damper(self, at: Array) -> Array:
        """Return the odd splines (..., f) of the damping force."""
        values = _splines(np.abs(at), np.linspace(0, self.ends[2], self.intervals + 1))
        return np.asarray(np.where(at < 0, -1.0, 1.0)[..., None] * values)

    def along(self, x: Array, v: Array) -> tuple[Array, ComplexArray]:
        """Return mean and fundamental (n, f) of all splines along motions (n, samples)."""
        parts = []
        for part in blocks(len(x), _BLOCK):
            functions = np.concatenate([self.spring(x[part]), self.damper(v[part])], axis=2)
            # time zero of the motion is that of the complex amplitudes, so the fundamental is taken about it
            parts.append((functions.mean(axis=1), project(np.swapaxes(functions, 1, 2), 1)))
        mean, fundamental = (np.concatenate(column) for column in zip(*parts, strict=True))
        return mean, fundamental


def invert_motion(
    points: Points,
    mass: float,
    noise: float,
) -> RestoringForce | None:
    """Fit the stiffness force, and a damping force that is odd, along measured motions.

    Parameters
    ----------
    points
        Points whose mean was measured.
    mass
        m [kg].
    noise
        Relative noise of the response [1].

    Returns
    -------
    RestoringForce or None
        Its bands are those of the delete-a-group jackknife (Kott, Journal of Official Statistics 17 (2001)).
        None if fewer than 64 points remain, or the second harmonic was not measured.
    """
    if len(points) < JACKKNIFE_GROUPS * POINTS_PER_KNOT or 2 not in points.measured:
        return None
    points = points.select(points.spread(_MAX_POINTS))
    surfaces = _choose_surfaces(points, noise)
    x, v = signals = _signals(points, noise, surfaces)
    ends = float(x.min()), float(x.max()), float(np.abs(v).max())
    plans = [_SplineShape(ends, intervals) for intervals in _INTERVALS]
    drawn = [_fit_forces(points, signals, mass, noise, plan) for plan in plans]
    best = int(np.argmin([criterion for *_, criterion in drawn]))
    spring, damper, _ = drawn[best]
    group = np.arange(len(points)) % JACKKNIFE_GROUPS
    others = [points.select(np.flatnonzero(group != g)) for g in range(JACKKNIFE_GROUPS)]
    parts = [
        _fit_forces(part, _signals(part, noise, surfaces), mass, noise, plans[best])[:2] for part in others
    ]
    bands = [
        float(interval_sigmas(JACKKNIFE_GROUPS - 1))
        * np.sqrt(
            (JACKKNIFE_GROUPS - 1) / JACKKNIFE_GROUPS * np.sum((forces - forces.mean(axis=0)) ** 2, axis=0)
        )
        for forces in (np.stack(curves) for curves in zip(*parts, strict=True))
    ]
    at_x, at_v = plans[best].places
    return RestoringForce(at_x, spring, bands[0], at_v, damper, bands[1])


def _signals(
    points: Points, noise: float, surfaces: tuple[tuple[int, int] | None, ...]
) -> tuple[Array, Array]:
    """Return displacement and velocity (n, samples) of the smoothed measured motion."""
    return Motion(points.omega, _denoised(points, noise, surfaces)).waveforms(2 * SAMPLES_PER_PERIOD)[:2]


def _normalised_harmonics(points: Points) -> tuple[ComplexArray, ComplexArray]:
    """Return the harmonics relative to the fundamental in size and phase, and the factors (n, H+1) back."""
    ones = Motion(points.omega, np.ones_like(points.harmonics))
    back = ones.turned(np.angle(points.harmonics[:, 1])).harmonics * points.amplitude[:, None]
    return points.harmonics / back, back


def _choose_surfaces(points: Points, noise: float) -> tuple[tuple[int, int] | None, ...]:
    """Return the degrees in amplitude and frequency of the polynomial surface of each harmonic, by BIC.

    None for the fundamental, and for harmonics that no surface follows up to the noise.
    """
    tried = list(product(range(_MAX_DEGREES[0] + 1), range(_MAX_DEGREES[1] + 1)))
    relative, _ = _normalised_harmonics(points)
    chosen: list[tuple[int, int] | None] = []
    fits = [_surfaces_of(points, relative, *degrees) for degrees in tried]
    for h, values in enumerate(relative.T):
        best = min(range(len(tried)), key=lambda place: fits[place][1][h])
        scatter = np.sqrt(np.mean(np.abs(values - fits[best][0][:, h]) ** 2))
        chosen.append(tried[best] if h != 1 and scatter < NOISE_RATIO_BY_CHANCE * noise else None)
    return tuple(chosen)


def _denoised(points: Points, noise: float, surfaces: tuple[tuple[int, int] | None, ...]) -> ComplexArray:
    """Return the motion (n, H+1): harmonics on their surfaces, others where they are above the noise."""
    relative, back = _normalised_harmonics(points)
    for h, degrees in enumerate(surfaces):
        values = relative[:, h]
        if degrees is not None:
            relative[:, h] = _surfaces_of(points, values[:, None], *degrees)[0][:, 0]
        elif h > 1:
            relative[:, h] = np.where(np.abs(values) > NOISE_LIMIT_SIGMAS * noise, values, 0)
    return np.asarray(relative * back)


def _surfaces_of(points: Points, values: ComplexArray, degree: int, bend: int) -> tuple[ComplexArray, Array]:
    """Fit a polynomial of amplitude and frequency to harmonics (n, k); return it, and the BIC (k,)."""
    height = points.amplitude / points.amplitude.max()
    place = points.omega / np.median(points.omega) - 1
    matrix = np.stack([height**i * place**j for i in range(degree + 1) for j in range(bend + 1)], axis=1)
    # one decomposition of a real matrix serves all harmonics
    solution = np.linalg.lstsq(matrix, np.hstack([values.real, values.imag]), rcond=None)[0]
    real, imaginary = np.split(matrix @ solution, 2, axis=1)
    found = real + 1j * imaginary
    rest = np.maximum(np.sum(np.abs(values - found) ** 2, axis=0), 1e-300)
    count = 2 * len(values)
    return found, count * np.log(rest) + 2 * matrix.shape[1] * np.log(count)


def _fit_forces(
    points: Points, signals: tuple[Array, Array], mass: float, noise: float, plan: _SplineShape
) -> tuple[Array, Array, float]:
    """Return stiffness and damping force at the places of a plan, and the BIC.

    Mean, real and imaginary part are weighted by their residuals: iteratively reweighted least squares.
    """
    mean, fundamental = plan.along(*signals)
    force = np.abs(points.force)
    # noise of the mean enters the balance through the stiffness, that of the fundamental through F/X
    firm = mass * points.omega**2 * points.amplitude
    known = (points.force + mass * points.omega**2 * points.harmonics[:, 1]) / force
    equations = [
        mean / firm[:, None],
        fundamental.real / force[:, None],
        fundamental.imag / force[:, None],
    ]
    matrix = np.concatenate(equations)
    balance = np.concatenate([np.zeros(len(points)), known.real, known.imag])
    at_x, at_v = plan.places
    spring, damper = plan.spring(at_x), plan.damper(at_v)
    counts = (spring.shape[1], damper.shape[1])
    stiff = np.zeros((sum(counts) - 4, sum(counts)))
    stiff[: counts[0] - 2, : counts[0]] = np.diff(np.eye(counts[0]), 2, axis=0)
    stiff[counts[0] - 2 :, counts[0] :] = np.diff(np.eye(counts[1]), 2, axis=0)
    stiff *= SPLINE_SMOOTHING * np.abs(matrix).max() * np.sqrt(len(balance))
    weight = np.ones(len(balance))
    for _ in range(MAX_ALTERNATIONS):
        scale = np.append(weight, np.ones(len(stiff)))
        solution, *_ = solve_scaled(
            np.concatenate([matrix, stiff]) * scale[:, None],
            np.concatenate([balance, np.zeros(len(stiff))]) * scale,
        )
        rest = (balance - matrix @ solution).reshape(len(equations), -1)
        spread = np.sqrt(np.mean(rest**2, axis=1))
        # smoothing removed noise of the mean from the residual
        spread[0] = max(spread[0], noise)
        weight = np.repeat(1 / np.maximum(spread, _MIN_RESIDUAL_RATIO * spread.max()), len(points))
    likelihood = len(points) * float(np.sum(np.log(np.maximum(spread**2, 1e-300))))
    return (
        spring @ solution[: counts[0]],
        damper @ solution[counts[0] :],
        likelihood + sum(counts) * float(np.log(len(balance))),
    )


def _splines(at: Array, knots: Array) -> Array:
    """Return the cubic B-splines (..., f) over knots."""
    clamped = np.concatenate([[knots[0]] * _DEGREE, knots, [knots[-1]] * _DEGREE])
    inside = np.clip(at, knots[0], knots[-1]).ravel()
    return b_splines(inside, clamped, _DEGREE)[0].reshape(*at.shape, -1)


def _dynamic_stiffness(surface: ResponseSurface, found: Fit) -> tuple[Array, ComplexArray]:
    """Return the amplitude (n,) [m] of the motion along the last part of a law, and k + i omega c there."""
    motions, omega = (surface.harmonics, surface.across), surface.omega
    response = motions[0][:, 1]
    left = surface.force + found.mass * omega**2 * response
    others = found.problem.law.parts[:-1]
    for part, harmonics in zip(others, motions, strict=False):
        motion = sine_motion(omega, harmonics[:, 1])
        own = part.law.along(motion, found.values[part.parameters], SAMPLES_PER_PERIOD_SWITCHED)
        left = left - project(own.force, 1)
    followed = motions[len(others)][:, 1]
    return np.abs(followed), left / followed


def equivalent_curve(
    surface: ResponseSurface, points: Points, used: NDArray[np.bool_], found: Fit
) -> EquivalentCurve:
    """Return k and c of every settled point, with the identified mass; ``used`` marks the fitted points.

    For a law across two sensors they belong to the elements there: the force that the other elements leave.
    """
    response = surface.harmonics[:, 1]
    rows = np.flatnonzero(surface.settled & np.isfinite(response) & (np.abs(response) > 0))
    omega = surface.omega[rows]
    amplitude, stiffness = _dynamic_stiffness(surface.select(rows), found)
    took_part = np.zeros(len(surface), dtype=bool)
    took_part[points.index[used]] = True
    return EquivalentCurve(
        amplitude=amplitude,
        frequency=surface.frequency[rows],
        level=surface.level[rows],
        stiffness=stiffness.real,
        damping=stiffness.imag / omega,
        used=took_part[rows],
        level_unit=surface.level_unit,
        units=surface.units,
    )


def force_levels(surface: ResponseSurface, points: Points, resonances: tuple[Resonance, ...]) -> Array:
    """Return the force levels [N] near the resonances; with response control those computed from c(X)."""
    if not surface.response_held:
        return np.unique(typical_amounts(surface.select(points.index)))
    needed = [abs(r.damping) * 2 * np.pi * r.frequency * r.amplitude for r in resonances]
    return np.unique(needed) if needed else np.quantile(np.abs(points.force), [0.1, 0.5, 0.9])
