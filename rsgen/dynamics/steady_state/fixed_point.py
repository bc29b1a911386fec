"""Newton's method on the period map, with the Jacobian from two neighbouring orbits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.dynamics.steady_state.period_map import Indices, PeriodMap

__all__ = ["FixedPoints", "attraction", "correction", "find_fixed_points", "jacobians", "norm", "times"]

_OFFSET = 1e-5  # of the amplitude: neighbouring orbits; truncation and rounding are both small there
_ITERATIONS = 6  # Newton steps; a start that needs more is not near a fixed point
_SINGULAR = 1e-12  # determinant of I - J that is rounding
_PIVOT = 1e-4  # of an elimination without exchange of rows: below, it loses more digits than J has right


@dataclass(frozen=True, slots=True, eq=False)
class FixedPoints:
    """What Newton's method made of k points: ``y`` (D, k), ``jacobian`` (D, D, k), ``found`` (k,)."""

    y: Array
    jacobian: Array
    found: NDArray[np.bool_]


def norm(y: Array) -> Array:
    """Length of k states (D, k)."""
    if len(y) > 2:
        return np.asarray(np.sqrt(np.einsum("ik,ik->k", y, y)))
    return np.asarray(np.sqrt(y[0] * y[0] + y[1] * y[1]))


def correction(jacobian: Array, residual: Array) -> Array:
    """Solve (I - J) d = P(y) - y for k points; where it is singular, d = the residual itself."""
    if len(residual) > 2:
        return _correction(jacobian, residual)
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
    if len(jacobian) > 2:
        return _schur_cohn(_characteristic(jacobian)[0])
    trace = jacobian[0, 0] + jacobian[1, 1]
    det = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
    return np.asarray(np.minimum(1 - np.abs(det), 1 + det - np.abs(trace)))


def jacobians(
    period_map: PeriodMap, points: Indices, y: Array, steps: NDArray[np.int64], offset: Array
) -> tuple[Array, Array]:
    """Images P(y) and Jacobians of k points, from neighbouring orbits ``offset`` (k,) [m] away."""
    size, k = y.shape
    trial = np.concatenate([y] * (1 + size), axis=1)
    for row in range(size):
        trial[row, (1 + row) * k : (2 + row) * k] += offset
    after = period_map.carry(points, trial, steps, 1).state.reshape(size, 1 + size, k)
    image = after[:, 0]
    slope = after[:, 1:] - image[:, None]
    slope /= offset
    return image, slope


def times(jacobian: Array, y: Array) -> Array:
    """J y for k points."""
    if len(y) > 2:
        return np.asarray(np.einsum("ijk,jk->ik", jacobian, y))
    product = np.empty_like(y)
    product[0] = jacobian[0, 0] * y[0] + jacobian[0, 1] * y[1]
    product[1] = jacobian[1, 0] * y[0] + jacobian[1, 1] * y[1]
    return product


def _characteristic(matrix: Array) -> tuple[list[Array], Array]:
    """Coefficients c of det(s - A) = s^D + c1 s^(D-1) + ... + cD, and the M with A M = -cD.

    Leverrier's method for k matrices (D, D, k); D is small.
    """
    size = len(matrix)
    unit = np.eye(size)[:, :, None]
    coefficients = [np.ones(matrix.shape[2])]
    auxiliary = np.broadcast_to(unit, matrix.shape)
    for order in range(1, size + 1):
        product = np.einsum("ijk,jlk->ilk", matrix, auxiliary)
        coefficients.append(-np.einsum("iik->k", product) / order)
        if order < size:
            auxiliary = product + coefficients[-1] * unit
    return coefficients, auxiliary


def _correction(jacobian: Array, residual: Array) -> Array:
    """As ``correction``, for laws with states of their own: Gauss's elimination, k points at once."""
    size = len(residual)
    matrix = np.eye(size)[:, :, None] - jacobian
    move, sound = residual.copy(), np.ones(residual.shape[1], dtype=bool)
    for row in range(size):
        sound &= np.abs(matrix[row, row]) > _PIVOT
        for lower in range(row + 1, size):
            factor = matrix[lower, row] / np.where(sound, matrix[row, row], 1.0)
            matrix[lower, row + 1 :] -= factor * matrix[row, row + 1 :]
            move[lower] -= factor * move[row]
    for row in reversed(range(size)):
        for right in range(row + 1, size):
            move[row] -= matrix[row, right] * move[right]
        move[row] /= np.where(sound, matrix[row, row], 1.0)
    if not sound.all():
        move[:, ~sound] = _correction_of_few(jacobian[:, :, ~sound], residual[:, ~sound])
    return move


def _correction_of_few(jacobian: Array, residual: Array) -> Array:
    """As ``_correction``, where a pivot is small: exact, and slower."""
    coefficients, adjugate = _characteristic(np.eye(len(residual))[:, :, None] - jacobian)
    last = coefficients[-1]
    regular = np.abs(last) > _SINGULAR
    move = times(adjugate, residual) / -np.where(regular, last, 1.0)
    return np.asarray(np.where(regular, move, residual))


def _schur_cohn(coefficients: list[Array]) -> Array:
    """Smallest 1 - |k| of the reflection coefficients of polynomials; positive: all roots inside the circle.

    Schur, J. reine angew. Math. 148 (1918) 122.
    """
    inside = np.full_like(coefficients[0], np.inf)
    while len(coefficients) > 1:
        reflection = coefficients[-1]
        inside = np.minimum(inside, 1 - np.abs(reflection))
        # a root outside ends it: the sign is known, and nothing is divided by zero
        rest = np.where(np.abs(reflection) < 1, 1 - reflection**2, 1.0)
        coefficients = [
            (mine - reflection * other) / rest
            for mine, other in zip(coefficients[:-1], coefficients[:0:-1], strict=True)
        ]
    return inside


def find_fixed_points(
    period_map: PeriodMap,
    points: Indices,
    y: Array,
    steps: NDArray[np.int64],
    tolerance: float,
    least: Array,
    *,
    spared: bool = False,
) -> FixedPoints:
    """Look for fixed points near ``y``; found: the last correction is below ``tolerance`` of the size.

    ``least`` (k,) [m] is the least size of a motion; ``spared`` says that a Jacobian serves two steps.
    """
    k = len(points)
    y = y.copy()
    jacobian = np.zeros((len(y), len(y), k))
    found = np.zeros(k, dtype=bool)
    reach = 10 * (norm(y) + least)
    active, here, everybody = np.arange(k), y, True
    # more states make a Jacobian dear
    spared = spared or len(y) > 2
    slope = jacobian
    for turn in range(_ITERATIONS):
        size = np.maximum(norm(here), least)
        if spared and turn % 2:
            image = period_map.carry(points, here, steps, 1).state
        else:
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
        least, reach, slope = least[left], reach[left], slope[:, :, left]
        here = there[:, left]
    return FixedPoints(y, jacobian, found)
