"""Restoring force without a law: by Abel inversion of k(X) and c(X).

The describing-function integral X k(X) = 2/pi integral_0^pi n(X cos t) cos t dt is of Abel type and inverts
in closed form. With g(X) = X k(X), the amplitude of the fundamental of the stiffness force, an odd force is

    n(x) = integral_0^(pi/2) sin^2(t) g(x sin t) dt + x/2 integral_0^(pi/2) sin^3(t) g'(x sin t) dt,

which is n(x) = 1/(2x) d/dx integral_0^x X^3 k(X)/sqrt(x^2 - X^2) dX after X = x sin t; likewise the damping
force from V c(V) with V = omega X. For a force that is not odd the result is its odd part. A spline is fitted
to g, which stays finite where k does not (friction: c grows as 1/V).

An asymmetric spring shifts the mean displacement, so that k(X) alone does not determine it.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.solvers import b_splines, solve_scaled
from rsgen.common.tolerances import (
    MIN_SIGNIFICANT_GAIN,
    POINTS_PER_KNOT,
    SAMPLES_PER_PERIOD_SWITCHED,
    SPLINE_SMOOTHING,
    interval_sigmas,
)
from rsgen.data.oscillator import Observation
from rsgen.data.surface.response_surface import ResponseSurface, typical_amounts
from rsgen.formula.units import ForceUnits
from rsgen.identification.fitting.fit import Fit
from rsgen.identification.fitting.points import Points
from rsgen.identification.results import EquivalentCurve, Resonance, RestoringForce
from rsgen.law.motion import project, sine_motion

_CURVE_POINTS = 61
_DEGREE = 3
"""Degree of the splines."""

_MAX_INTERVALS = 24
"""Intervals of the spline of an odd force; a corner is smoothed over one of them."""


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
    ends = _intervals(reach / largest)
    knots, operator = _abel(tuple(ends.tolist()))
    functions = len(knots) - _DEGREE - 1
    matrix = b_splines(knots, _DEGREE)(reach / largest) / spread[:, None]
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


def _intervals(places: Array) -> Array:
    """Return the ends of even intervals of 0 to 1, joined where too few of the places are in one of them.

    Between levels that jump a test has few amplitudes; intervals of its own follow noise.
    """
    even = np.linspace(0, 1, int(np.clip(len(places) // POINTS_PER_KNOT, 2, _MAX_INTERVALS)) + 1)
    below = np.searchsorted(np.sort(places), even, side="right")
    kept, count = [0.0], 0
    for end, number in zip(even[1:-1], below[1:-1], strict=True):
        if min(number - count, len(places) - number) >= POINTS_PER_KNOT / 2:
            kept, count = [*kept, float(end)], number
    return np.array([*kept, 1.0])


@lru_cache(maxsize=4)
def _abel(ends: tuple[float, ...]) -> tuple[Array, Array]:
    """Return the knots of a spline g over 0 to 1, and the map (x, f) from its coefficients to n(x)."""
    knots = np.concatenate([np.zeros(_DEGREE), ends, np.ones(_DEGREE)])
    nodes, weights = np.polynomial.legendre.leggauss(64)
    sine = np.sin(np.pi / 4 * (nodes + 1))
    weights = weights * np.pi / 4
    x = np.linspace(0, 1, _CURVE_POINTS)
    inside = (x[:, None] * sine).ravel()
    splines = b_splines(knots, _DEGREE)
    value, slope = (splines(inside, nu=nu).reshape(_CURVE_POINTS, len(sine), -1) for nu in (0, 1))
    operator = np.einsum("t,xtf->xf", weights * sine**2, value)
    operator += 0.5 * x[:, None] * np.einsum("t,xtf->xf", weights * sine**3, slope)
    return knots, operator


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
    surface: ResponseSurface, points: Points, found: Fit, units: ForceUnits, observation: Observation
) -> EquivalentCurve:
    """Return k and c of every settled point, with the identified mass, in units of force.

    For a law across two sensors they belong to the elements there: the force that the other elements leave.
    """
    response = surface.harmonics[:, 1]
    rows = np.flatnonzero(surface.settled & np.isfinite(response) & (np.abs(response) > 0))
    omega = surface.omega[rows]
    amplitude, stiffness = _dynamic_stiffness(surface.select(rows), found)
    took_part = np.zeros(len(surface), dtype=bool)
    took_part[points.index[found.regression.used]] = True
    low, high = observation.band or (0.0, np.inf)
    outside = (surface.frequency < low) | (surface.frequency > high)
    why = np.where(outside, "outside the band", "excluded")
    why = np.where(surface.held_out(observation.hold_out), "held out", why)
    return EquivalentCurve(
        amplitude=amplitude,
        frequency=surface.frequency[rows],
        level=surface.level[rows],
        stiffness=stiffness.real,
        damping=stiffness.imag / omega,
        used=took_part[rows],
        level_unit=surface.level_unit,
        units=units,
        base=surface.base,
        reason=np.where(took_part, "", why)[rows],
    )


def force_levels(surface: ResponseSurface, points: Points, resonances: tuple[Resonance, ...]) -> Array:
    """Return the force levels [N] at the largest motions; with response control those computed from c(X)."""
    if not surface.response_held:
        return np.unique(typical_amounts(surface.select(points.index)))
    needed = [abs(r.damping) * 2 * np.pi * r.frequency * r.amplitude for r in resonances]
    return np.unique(needed) if needed else np.quantile(np.abs(points.force), [0.1, 0.5, 0.9])
