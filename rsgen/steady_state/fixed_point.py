"""Newton's method on the period map, with the Jacobian from two neighbouring orbits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.steady_state.period_map import Floats, Indices, PeriodMap

__all__ = ["FixedPoints", "attraction", "correction", "find_fixed_points", "jacobians", "norm", "times"]

_OFFSET = 1e-5  # of the amplitude: neighbouring orbits; truncation and rounding are both small there
_ITERATIONS = 6
_SINGULAR = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class FixedPoints:
    """What Newton's method made of k points: ``y`` (k, 2), ``jacobian`` (k, 2, 2), ``found`` (k,)."""

    y: Floats
    jacobian: Floats
    found: NDArray[np.bool_]


def norm(y: Floats) -> Floats:
    """Length of the last axis."""
    first, second = y[..., 0], y[..., 1]
    length: Floats = np.sqrt(first * first + second * second)
    return length


def correction(jacobian: Floats, residual: Floats) -> Floats:
    """Solve (I - J) d = P(y) - y for (k,) points; where it is singular, d = the residual itself."""
    a, b = 1 - jacobian[:, 0, 0], -jacobian[:, 0, 1]
    c, d = -jacobian[:, 1, 0], 1 - jacobian[:, 1, 1]
    det = a * d - b * c
    regular = np.abs(det) > _SINGULAR
    safe = np.where(regular, det, 1.0)
    r0, r1 = residual[:, 0], residual[:, 1]
    move = np.empty_like(residual)
    move[:, 0], move[:, 1] = (d * r0 - b * r1) / safe, (a * r1 - c * r0) / safe
    if not regular.all():
        move[~regular] = residual[~regular]
    return move


def attraction(jacobian: Floats) -> Floats:
    """How far inside the unit circle the eigenvalues of J are (Jury's conditions); negative: outside."""
    trace = jacobian[:, 0, 0] + jacobian[:, 1, 1]
    det = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
    margin: Floats = np.minimum(1 - np.abs(det), 1 + det - np.abs(trace))
    return margin


def jacobians(
    period_map: PeriodMap, points: Indices, y: Floats, steps: NDArray[np.int64], offset: Floats
) -> tuple[Floats, Floats]:
    """Images P(y) and Jacobians of (k,) points, from neighbouring orbits ``offset`` (k,) [m] away."""
    k = len(points)
    trial = np.tile(y, (3, 1))
    trial[k : 2 * k, 0] += offset
    trial[2 * k :, 1] += offset
    after = period_map.carry(np.tile(points, 3), trial, np.tile(steps, 3), 1).state
    image = after[:k]
    slope = np.empty((k, 2, 2))
    slope[:, :, 0] = (after[k : 2 * k] - image) / offset[:, None]
    slope[:, :, 1] = (after[2 * k :] - image) / offset[:, None]
    return image, slope


def times(jacobian: Floats, y: Floats) -> Floats:
    """J y for (k,) points."""
    product = np.empty_like(y)
    product[:, 0] = jacobian[:, 0, 0] * y[:, 0] + jacobian[:, 0, 1] * y[:, 1]
    product[:, 1] = jacobian[:, 1, 0] * y[:, 0] + jacobian[:, 1, 1] * y[:, 1]
    return product


def find_fixed_points(
    period_map: PeriodMap, points: Indices, y: Floats, steps: NDArray[np.int64], tolerance: float
) -> FixedPoints:
    """Look for fixed points near ``y``; found: the last correction is below ``tolerance`` of the size."""
    k = len(points)
    y = y.copy()
    jacobian = np.zeros((k, 2, 2))
    found = np.zeros(k, dtype=bool)
    floor = period_map.scale[points]
    reach = norm(y) + floor
    active = np.arange(k)
    for _ in range(_ITERATIONS):
        here = y[active]
        size = np.maximum(norm(here), floor[active])
        image, slope = jacobians(period_map, points[active], here, steps[active], _OFFSET * size)
        move = correction(slope, image - here)
        length = norm(move)
        sane = np.isfinite(length) & (norm(here + move) < 10 * reach[active])
        y[active[sane]] += move[sane]
        jacobian[active] = slope
        done = sane & (length <= tolerance * size)
        found[active[done]] = True
        active = active[sane & ~done]
        if not len(active):
            break
    return FixedPoints(y, jacobian, found)
