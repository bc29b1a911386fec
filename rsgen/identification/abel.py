"""Forces without a law: the describing-function integral is of Abel type and inverts in closed form.

With g(X) = X k(X), the amplitude of the fundamental of the stiffness force, an odd force is

    n(x) = integral_0^(pi/2) sin^2(t) g(x sin t) dt + x/2 integral_0^(pi/2) sin^3(t) g'(x sin t) dt,

which is n(x) = 1/(2x) d/dx integral_0^x X^3 k(X)/sqrt(x^2 - X^2) dX (METHOD.md 4) after X = x sin t;
likewise the damping force from V c(V) with V = omega X. Of a force that is not odd this gives the odd part.
g is fitted by a spline, which stays finite where k does not (friction: c grows as 1/V).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.least_squares import solve_scaled
from rsgen.identification.result import EquivalentCurve, RestoringForce

__all__ = ["invert_curve"]

Array = NDArray[np.float64]

_DRAWN = 61
_DEGREE = 3
_MOST_KNOTS = 24
_POINTS_A_KNOT = 8
_NORMAL = 1.96
_SIGNIFICANT = 25.0
"""Gain in the sum of squares, in units of the noise, that a jump at rest must bring to be believed."""

_STIFFENING = 1e-7
"""Weight of the spline's curvature: settles it where there are no points, without effect elsewhere."""


def invert_curve(curve: EquivalentCurve, mass: float) -> RestoringForce | None:
    """Draw stiffness and damping force from the equivalent curve.

    Parameters
    ----------
    curve
        Equivalent stiffness and damping of all points; those that took part in the fits are used.
    mass
        m [kg] with which the curve was made; tells the force, and so the weight, of every point.

    Returns
    -------
    RestoringForce or None
        None where fewer than 16 points remain.
    """
    used = curve.used & np.isfinite(curve.stiffness) & np.isfinite(curve.damping)
    if np.count_nonzero(used) < 2 * _POINTS_A_KNOT:
        return None
    size = curve.amplitude[used]
    omega = 2 * np.pi * curve.frequency[used]
    stiffness, damping = curve.stiffness[used], curve.damping[used]
    force = size * np.hypot(stiffness - mass * omega**2, omega * damping)
    # a spring does not jump at rest; a damper may, so it starts from zero only if that fits as well
    x, spring, spring_band, _ = _invert(size, size * stiffness, force, free=False)
    tied, free = (_invert(omega * size, omega * size * damping, force, free=free) for free in (False, True))
    jumps = free[3] < tied[3] * (1 - _SIGNIFICANT / len(size))
    v, damper, damper_band, _ = free if jumps else tied
    return RestoringForce(x, spring, spring_band, v, damper, damper_band)


def _invert(
    reach: Array, amplitude: Array, spread: Array, *, free: bool
) -> tuple[Array, Array, Array, float]:
    """Points x, n(x), half width of the band, sum of squares; from g at ``reach`` with errors ``spread``.

    Where g is not ``free`` at zero, it is zero there.
    """
    from scipy.interpolate import BSpline

    largest = float(reach.max())
    count = int(np.clip(len(reach) // _POINTS_A_KNOT, 2, _MOST_KNOTS))
    inner = np.linspace(0, 1, count + 1)
    knots = np.concatenate([np.zeros(_DEGREE), inner, np.ones(_DEGREE)])
    functions = len(knots) - _DEGREE - 1
    matrix = BSpline.design_matrix(reach / largest, knots, _DEGREE).toarray() / spread[:, None]
    curvature = np.diff(np.eye(functions), 2, axis=0)
    curvature *= _STIFFENING * np.abs(matrix).max() * np.sqrt(len(reach))
    if not free:
        # the only spline that is not zero at zero
        matrix[:, 0] = 0
        curvature[:, 0] = 0
    rows = np.concatenate([matrix, curvature])
    right = np.concatenate([amplitude / spread, np.zeros(len(curvature))])
    solution, inverse, _ = solve_scaled(rows, right)
    freedom = max(len(reach) - functions, 1)
    squares = float(np.sum((amplitude / spread - matrix @ solution) ** 2))
    variance = squares / freedom

    nodes, weights = np.polynomial.legendre.leggauss(64)
    sine = np.sin(np.pi / 4 * (nodes + 1))
    weights = weights * np.pi / 4
    x = np.linspace(0, 1, _DRAWN)
    inside = (x[:, None] * sine).ravel()
    value = BSpline.design_matrix(inside, knots, _DEGREE).toarray().reshape(_DRAWN, len(sine), functions)
    slope = np.stack(
        [BSpline(knots, unit, _DEGREE).derivative()(inside) for unit in np.eye(functions)], axis=-1
    ).reshape(value.shape)
    operator = np.einsum("t,xtf->xf", weights * sine**2, value)
    operator += 0.5 * x[:, None] * np.einsum("t,xtf->xf", weights * sine**3, slope)
    band = _NORMAL * np.sqrt(variance) * np.sqrt(np.sum((operator @ inverse) ** 2, axis=1))
    return x * largest, operator @ solution, band, squares
