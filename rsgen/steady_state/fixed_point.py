"""Newton's method on the period map, with the Jacobian from two neighbouring orbits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.arrays import Array
from rsgen.steady_state.period_map import Indices, PeriodMap

__all__ = ["FixedPoints", "attraction", "correction", "find_fixed_points", "jacobians", "norm", "times"]

_OFFSET = 1e-5  # of the amplitude: neighbouring orbits; truncation and rounding are both small there
_ITERATIONS = 6  # Newton steps; a start that needs more is not near a fixed point
_SINGULAR = 1e-12  # determinant of I - J that is rounding


@dataclass(frozen=True, slots=True, eq=False)
class FixedPoints:
    """What Newton's method made of k points: ``y`` (2, k), ``jacobian`` (2, 2, k), ``found`` (k,)."""

    y: Array
    jacobian: Array
    found: NDArray[np.bool_]


def norm(y: Array) -> Array:
    """Length of k states (2, k)."""
    return np.asarray(np.sqrt(y[0] * y[0] + y[1] * y[1]))


def correction(jacobian: Array, residual: Array) -> Array:
    """Solve (I - J) d = P(y) - y for k points; where it is singular, d = the residual itself."""
    a, b = 1 - jacobian[0, 0], jacobian[0, 1]
    c, d = jacobian[1, 0], 1 - jacobian[1, 1]
    det = a * d - b * c
    regular = np.abs(det) > _SINGULAR
    if not regular.all():
        det = np.where(regular, det, 1.0)
    move = np.empty_like(residual)
    move[0] = (d * residual[0] + b * residual[1]) / det
    move[1] = (a * residual[1] + c * residual[0]) / det
    if not regular.all():
        move[:, ~regular] = residual[:, ~regular]
    return move


def attraction(jacobian: Array) -> Array:
    """How far inside the unit circle the eigenvalues of J are (Jury's conditions); negative: outside."""
    trace = jacobian[0, 0] + jacobian[1, 1]
    det = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
    return np.asarray(np.minimum(1 - np.abs(det), 1 + det - np.abs(trace)))


def jacobians(
    period_map: PeriodMap, points: Indices, y: Array, steps: NDArray[np.int64], offset: Array
) -> tuple[Array, Array]:
    """Images P(y) and Jacobians of k points, from neighbouring orbits ``offset`` (k,) [m] away."""
    k = len(points)
    trial = np.concatenate([y, y, y], axis=1)
    trial[0, k : 2 * k] += offset
    trial[1, 2 * k :] += offset
    after = period_map.carry(points, trial, steps, 1).state.reshape(2, 3, k)
    image = after[:, 0]
    slope = after[:, 1:] - image[:, None]
    slope /= offset
    return image, slope


def times(jacobian: Array, y: Array) -> Array:
    """J y for k points."""
    product = np.empty_like(y)
    product[0] = jacobian[0, 0] * y[0] + jacobian[0, 1] * y[1]
    product[1] = jacobian[1, 0] * y[0] + jacobian[1, 1] * y[1]
    return product


def find_fixed_points(
    period_map: PeriodMap,
    points: Indices,
    y: Array,
    steps: NDArray[np.int64],
    tolerance: float,
    least: Array,
) -> FixedPoints:
    """Look for fixed points near ``y``; found: the last correction is below ``tolerance`` of the size.

    ``least`` (k,) [m] is the least size of a motion.
    """
    k = len(points)
    y = y.copy()
    jacobian = np.zeros((2, 2, k))
    found = np.zeros(k, dtype=bool)
    reach = 10 * (norm(y) + least)
    active, here, everybody = np.arange(k), y, True
    for _ in range(_ITERATIONS):
        size = np.maximum(norm(here), least)
        image, slope = jacobians(period_map, points, here, steps, _OFFSET * size)
        move = correction(slope, image - here)
        length = norm(move)
        there = here + move
        sane = np.isfinite(length) & (norm(there) < reach)
        done = sane & (length <= tolerance * size)
        if everybody and sane.all():
            y, jacobian = there, slope
        else:
            y[:, active[sane]] = there[:, sane]
            jacobian[:, :, active] = slope
        found[active[done]] = True
        left = sane & ~done
        if not left.any():
            break
        if left.all():
            here = there
            continue
        everybody = False
        active, points, steps = active[left], points[left], steps[left]
        least, reach = least[left], reach[left]
        here = there[:, left]
    return FixedPoints(y, jacobian, found)
