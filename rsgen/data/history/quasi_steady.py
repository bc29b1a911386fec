"""How far a sweep is from a sequence of steady states, and the force that is left when the rest is taken out.

The response lags behind the sweep: with the complex rate s of the motion (growth and frequency) the
fundamental of an oscillator m x'' + n(x, x') = f obeys, to first order in the slow change (Krylov and
Bogoliubov),

    F = k(X) X + c(X) V + m A,        V = s X,  A = (s^2 + s') X,

where a steady state has V = i omega X and A = -omega^2 X at the frequency of the force. Velocity and
acceleration follow from the envelopes, so what is unknown is only the mass; it follows from the same equation
over all points with k and c free functions of the amplitude. For a linear oscillator the equation is exact at
any rate. Along one branch of a nonlinear resonance the frequency is itself a function of the amplitude, and
the mass is not identifiable beside k(X); the flanks, where the amplitude is small and k(X) the same below and
above the resonance, then determine it roughly.

The pure number of a sweep is rate / (zeta f)^2: how far the frequency moves while the response rings down,
against the half width of the resonance (Lewis 1932, Trans. ASME 54, 253; Cronin 1965, thesis, California
Institute of Technology). Slowly swept, a resonance comes out shifted by 1/(2 pi) of it, in half widths: its
group delay 1/(2 pi zeta f) times the rate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.history.record import FAINT
from rsgen.data.history.sensor import Kinematics

__all__ = ["Inertia", "estimate_mass", "flank_mass", "steady_force"]


_KNOTS = 12
"""Most knots of the free functions k(X) and c(X): straight lines between them follow any curve to 1 %."""
_ROWS_A_KNOT = 8
"""Points that each knot needs, of whose 16 numbers it takes two; two knots are the fewest."""
_ROUNDS = 4
"""Fits in which outliers lose weight; more change the mass by less than its error."""
_OUTLIER = 3.0
"""A misfit of more than this many medians loses weight; 4 % of Rayleigh's distribution lie beyond."""
_INDEPENDENT = 1e-10
"""Columns whose singular values are below this fraction of the largest do not determine the mass."""
_FLANKS = 0.3
"""Up to this fraction of the largest amplitude k(X) is taken as constant: a cubic spring changes by 9 %."""


class Inertia(NamedTuple):
    """The mass that sweeps determine [kg], its standard error, the misfit relative to the force."""

    mass: float
    standard_error: float
    misfit: float


def _hats(amplitude: Array) -> Array:
    """(n, k) piecewise linear functions of the amplitude, knots where the points are."""
    count = int(np.clip(len(amplitude) // _ROWS_A_KNOT, 2, _KNOTS))
    knots = np.unique(np.quantile(amplitude, np.linspace(0, 1, count)))
    if len(knots) < 2:
        return np.ones((len(amplitude), 1))
    return np.stack([np.interp(amplitude, knots, row) for row in np.eye(len(knots))], axis=1)


def estimate_mass(force: ComplexArray, motion: Kinematics) -> Inertia | None:
    """Find the mass from F = k(X) X + c(X) V + m A with k and c free; None if it is not identifiable.

    ``force`` (n,) [N] and ``motion`` are of the fundamental, at points of one or several levels.
    """
    if len(force) < 2 * _ROWS_A_KNOT:
        return None
    hats = _hats(np.abs(motion.displacement))
    columns = np.column_stack(
        [hats * motion.displacement[:, None], hats * motion.velocity[:, None], motion.acceleration]
    )
    scale = 1 / np.maximum(np.abs(force), np.median(np.abs(force)) * FAINT)
    weight = scale.copy()
    for _ in range(_ROUNDS):
        matrix = columns * weight[:, None]
        stacked = np.concatenate([matrix.real, matrix.imag])
        right = np.concatenate([(force * weight).real, (force * weight).imag])
        size = np.linalg.norm(stacked, axis=0)
        if not (np.all(np.isfinite(size)) and np.all(size > 0)):
            return None
        solution, _, rank, _ = np.linalg.lstsq(stacked / size, right, rcond=_INDEPENDENT)
        if rank < stacked.shape[1]:
            return None
        residual = np.abs(columns @ (solution / size) - force) * scale
        # of exact data, rounding is left
        spread = max(float(np.median(residual)), 1e-12)
        weight = scale / np.maximum(1.0, residual / (_OUTLIER * spread))
    left = right - stacked / size @ solution
    freedom = max(len(right) - stacked.shape[1], 1)
    inverse = np.linalg.inv((stacked / size).T @ (stacked / size))
    error = float(np.sqrt(inverse[-1, -1] * (left @ left) / freedom) / size[-1])
    return Inertia(float(solution[-1] / size[-1]), error, float(np.median(residual)))


def flank_mass(force: ComplexArray, motion: Kinematics) -> Inertia | None:
    """Find the mass from the flanks of a resonance, with k constant there, to a fifth; None without flanks.

    ``force`` (n,) [N] and ``motion`` are of the fundamental, at points of one sweep or of several.
    """
    size = np.abs(motion.displacement)
    flank = (size > 0) & (size < _FLANKS * np.max(size, initial=0.0)) & (np.abs(force) > 0)
    if np.count_nonzero(flank) < 2 * _ROWS_A_KNOT:
        return None
    stiffness = (force[flank] / motion.displacement[flank]).real
    inertia = (motion.acceleration[flank] / motion.displacement[flank]).real
    columns = np.column_stack([np.ones(len(inertia)), inertia / np.max(np.abs(inertia))])
    scale = np.abs(motion.displacement[flank] / force[flank])
    weight = scale
    for _ in range(_ROUNDS):
        solution, _, rank, _ = np.linalg.lstsq(
            columns * weight[:, None], stiffness * weight, rcond=_INDEPENDENT
        )
        if rank < columns.shape[1]:
            return None
        residual = np.abs(columns @ solution - stiffness) * scale
        # of exact data, rounding is left
        spread = max(float(np.median(residual)), 1e-12)
        weight = scale / np.maximum(1.0, residual / (_OUTLIER * spread))
    matrix = columns * weight[:, None]
    left = (columns @ solution - stiffness) * weight
    inverse = np.linalg.inv(matrix.T @ matrix)
    error = float(np.sqrt(inverse[1, 1] * (left @ left) / (len(left) - 2)))
    unit = float(np.max(np.abs(inertia)))
    return Inertia(float(solution[1]) / unit, error / unit, float(np.median(residual)))


def steady_force(
    force: ComplexArray, motion: Kinematics, mass: float, omega: Array
) -> tuple[ComplexArray, Array]:
    """Find the force (n,) [N] that would hold the motion steady at ``omega`` [rad/s], and c(X) [N s/m]."""
    x = motion.displacement
    # unknown where nothing moved, as in a drop-out
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        stiffness = force / x
        inertia = motion.acceleration / x
        rate = motion.velocity / x
        damping = (stiffness.imag - mass * inertia.imag) / rate.imag
        held = stiffness.real - damping * rate.real - mass * (inertia.real + omega**2) + 1j * omega * damping
        return np.asarray(held * x), np.asarray(damping)
