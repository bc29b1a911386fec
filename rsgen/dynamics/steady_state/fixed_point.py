"""Newton's method on the period map, with the Jacobian from two neighbouring orbits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.kernel import Integrated, Kernel
from rsgen.dynamics.steady_state.loop_memory import LoopMemory, Stiffness
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.law.memory import memory_form, real_powers
from rsgen.law.pieces import normal_form_at

__all__ = [
    "FixedPoints",
    "PeriodMap",
    "Sticking",
    "attraction",
    "correction",
    "find_fixed_points",
    "jacobians",
    "norm",
    "times",
]


# ----------------------------------------------------------------------------
# Motions under Masing laws in which nothing slips any more: there the law is straight, and its offset
# exact.
#
# After the last slip a slider is a spring about the place where it stopped. The loops of a transient that
# decays or beats about it have no area and no fixed middle, so that their steady state is looked for with
# the
# memory as the transient left it.

_STRAIGHT = 1e-12
"""Departure from a straight line, relative, that is rounding."""

_PLACES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
"""Where a beginning is compared with a straight line, in parts of its length: a curve differs somewhere."""


@dataclass(frozen=True, slots=True)
class Sticking:
    """Straight beginning of a virgin curve: its slope [N/m], and the displacement [m] at which it ends."""

    slope: float
    reach: float

    @classmethod
    def of(cls, oscillator: Oscillator) -> Sticking | None:
        """Find the beginning of the only virgin curve; None where there is none or more, or it is bent."""
        memory = memory_form(oscillator.force)
        if memory is None or len(memory.curves) != 1:
            return None
        virgin = memory.curves[0].virgin
        reach = _first_corner(virgin, oscillator)
        if not np.isfinite(reach):
            return None
        names = oscillator.parameters
        force = compiled((virgin,), (symbol("x"), *map(symbol, names)))
        values = [oscillator.values[name] for name in names]
        end, *between = force(reach * np.append(1.0, _PLACES), *values)[0]
        straight = end > 0 and np.abs(between - _PLACES * end).max() < _STRAIGHT * end
        return cls(end / reach, reach) if straight else None

    def reaches(self, middle: Array, top: Array, bottom: Array) -> NDArray[np.bool_]:
        """(k,) whether nothing slips between bottom and top (k,) [m] about the places ``middle`` (k,)."""
        return np.asarray((top < middle + self.reach) & (bottom > middle - self.reach))


def _first_corner(virgin: sympy.Expr, oscillator: Oscillator) -> float:
    """Displacement [m] of the first corner of a virgin curve; infinite where it has none."""
    switches = normal_form_at(real_powers(virgin), oscillator.values).switches
    places = tuple(switch.threshold for switch in switches if switch.threshold is not None)
    names = oscillator.parameters
    found = compiled(places, tuple(map(symbol, names)))(*(oscillator.values[name] for name in names))
    return min((float(place) for place in found if place > 0), default=np.inf)


# ----------------------------------------------------------------------------
# The period map: where a state is after one period of the force. Its fixed points are the steady states.

Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class PeriodMap:
    """The period maps of n test points of one oscillator.

    States are y = (x, v/omega) [m], so that both parts weigh the same, followed for a law with memory by its
    states over ``units``, (D,) or None, and by the loop of its Masing laws: k of them are an array (D, k).
    ``force`` (n, 2) holds the real and imaginary part of F [N].

    ``memory`` is what else the points remember. A transient goes on with it and changes it. Fixed points
    are those of the closed loop alone, whose force after a reversal follows from the reversal before and not
    from the whole history: with the history the offset of a loop is arbitrary (eigenvalue one), alone it is
    the one that the transient has left.
    """

    kernel: Kernel
    mass: float
    values: Array
    force: Array
    omega: Array
    units: Array | None = None
    memory: LoopMemory | None = None
    stiffness: Stiffness | None = None
    sticking: Sticking | None = None

    def of(self, points: Indices) -> PeriodMap:
        """The maps of some of the points."""
        return replace(
            self,
            force=self.force[points],
            omega=self.omega[points],
            memory=None if self.memory is None else self.memory.of(points),
        )

    def scale(self) -> Array:
        """(n,) displacement [m] below which a motion is none at all: a millionth of |F| / (m omega^2)."""
        return np.asarray(1e-6 * np.hypot(*self.force.T) / (self.mass * self.omega**2))

    def carry(
        self,
        points: Indices,
        y: Array,
        steps: NDArray[np.int64],
        periods: int,
        harmonics: int | None = None,
        *,
        peaks: bool = False,
        transient: bool = False,
    ) -> Integrated:
        """Carry states over periods; a transient takes its memory along.

        ``points`` and ``steps`` (k,) say what belongs to the columns of ``y``: (D, k), or (D, r k) with the
        points r times in a row.
        """
        several = y.shape[1] // max(len(points), 1)
        if several > 1:
            points = np.concatenate([points] * several)
        if len(steps) and (steps == steps[0]).all():
            return self._integrate(points, y, int(steps[0]), periods, harmonics, peaks, transient)
        if several > 1:
            steps = np.concatenate([steps] * several)
        k, columns = len(points), 0 if harmonics is None else harmonics + 1
        whole = Integrated(
            np.empty((len(y), k)),
            np.empty((2, len(y), k)),
            np.empty((k, columns), np.complex128),
            np.empty((k if peaks else 0, 2)),
        )
        for kind in sorted(set(steps.tolist())):
            mine = np.flatnonzero(steps == kind)
            part = self._integrate(points[mine], y[:, mine], kind, periods, harmonics, peaks, transient)
            whole.state[:, mine], whole.history[:, :, mine] = part.state, part.history
            whole.harmonics[mine] = part.harmonics
            if peaks:
                whole.peak[mine] = part.peak
        return whole

    def _integrate(
        self,
        points: Indices,
        y: Array,
        steps: int,
        periods: int,
        harmonics: int | None,
        peaks: bool,
        transient: bool,
    ) -> Integrated:
        size = len(y)
        if self.units is not None:
            y = y * self.units[:size, None]
        if self.memory is not None:
            y = self.memory.joined(points, y, transient=transient)
        moved = self.kernel.integrate(
            points, y, self.force, self.omega, self.mass, self.values,
            steps=steps, periods=periods, harmonics=harmonics, peaks=peaks,
        )  # fmt: skip
        if self.memory is not None:
            if transient:
                self.memory.keep(points, moved.state)
            moved = replace(moved, state=moved.state[:size], history=moved.history[:, :size])
        if self.units is not None:
            moved.state[:] /= self.units[:size, None]
            moved.history[:] /= self.units[:size, None]
        return moved


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
