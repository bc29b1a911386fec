"""Fixed points of the period map by Newton's method, and whether they attract.

    m x'' + n(x, x', z) = Re F exp(i omega t),  z' = g(x, x', z),  P: y(0) -> y(2 pi/omega),  y* = P(y*)

y holds x, x'/omega and the memory z of the law; the ``kernel`` integrates P. A steady state is a fixed point,
found by shooting: (I - J) d = P(y) - y, y <- y + d (M. Peeters et al., Mech. Syst. Signal Process. 23 (2009)
195, Sec. 3). Column j of J is (P(y + h e_j) - P(y))/h, from an orbit that begins nearby: equations of
variation would need rules at every switch of the law, which the kernel passes anyway. A fixed point attracts
if all eigenvalues of J lie inside the unit circle (Floquet multipliers): by Jury's conditions for two
states, by the eigenvalues themselves for more.

Under a law of Masing type the future depends on reversals of the past. ``LoopMemory`` carries them along in a
transient; a fixed point is sought with the outermost loop alone, ``HeldMemory`` with sliders that all stick.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.tolerances import FINITE_DIFFERENCE_STEP, ROUND_OFF
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.kernel import Integrated, Kernel
from rsgen.dynamics.kernel_source import ALONE, DEEPEST, EVERYTHING, WITHIN, MemoryRows
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.formula.names import symbol
from rsgen.law.memory import memory_form, real_powers
from rsgen.law.normal_form import normal_form_at

# ----------------------------------------------------------------------------
# Sizes of the states of a law: what they are divided by, and how fast they follow the motion.

_STABLE_STEP = 2.0
"""Step times rate up to which the method of Runge and Kutta is stable, with a margin: the limit is 2.78."""


def _at_values(oscillator: Oscillator, formulas: tuple[sympy.Expr, ...], *states: sympy.Symbol) -> Numeric:
    """Compile formulas as functions of some states, the parameters at the values of an oscillator."""
    function = compiled(formulas, (*states, *map(symbol, oscillator.parameters)))
    values = [oscillator.values[name] for name in oscillator.parameters]
    return lambda *places: function(*places, *values)


@dataclass(frozen=True, slots=True, eq=False)
class Stiffness:
    """How fast the states of a law follow the motion: -dg/dz of each equation z' = g."""

    slopes: Numeric

    @classmethod
    def of(cls, oscillator: Oscillator) -> Stiffness | None:
        """Differentiate the equations; None for a law without."""
        memory = memory_form(oscillator.force)
        if memory is None or not memory.rates:
            return None
        at_rest = {rate.symbol: sympy.S.Zero for rate in memory.rates}
        slopes = tuple(sympy.diff(rate.rate, rate.symbol).subs(at_rest) for rate in memory.rates)
        return cls(_at_values(oscillator, slopes, symbol("x"), symbol("v")))

    def steps(self, amplitude: Array, omega: Array) -> Array:
        """Steps a period (k,) that motions of an amplitude (k,) [m] need to stay stable."""
        rates = self.slopes(amplitude, omega * amplitude)
        fastest = np.max([np.abs(np.nan_to_num(rate)) + 0 * omega for rate in rates], axis=0)
        return np.asarray(2 * np.pi / omega * fastest / _STABLE_STEP)


def units_of_states(oscillator: Oscillator, force: ComplexArray, omega: Array) -> Array:
    """Return the change of each of D state numbers for one metre of displacement [its unit/m], (D,).

    From the equations z' = g(x, v, z) at rest: |dg/dv| + |dg/dx|/omega; what depends on neither follows the
    other states. Only norms and the distances of neighbouring orbits depend on it.
    """
    memory = memory_form(oscillator.force)
    # x, v/omega, the states, and the largest and smallest displacement of a loop: lengths have the size of x
    ends_of_loop = (1.0, 1.0) if memory is not None and memory.curves else ()
    if memory is None or not memory.rates:
        return np.array([1.0, 1.0, *ends_of_loop])
    states = [rate.symbol for rate in memory.rates]
    rates = _at_values(
        oscillator, tuple(rate.rate for rate in memory.rates), symbol("x"), symbol("v"), *states
    )
    w = float(np.median(omega))
    size = float(np.median(np.abs(force))) / (oscillator.mass * w * w)
    # so small that states follow without reaching their limits
    x = FINITE_DIFFERENCE_STEP * (size if size > 0 else 1.0)
    count = len(states)
    offsets = np.zeros((2 + count, 2 + count))
    offsets[0, 0], offsets[1, 1] = x, w * x
    units = np.zeros(count)
    for _ in range(1 + count):
        offsets[2:, 2:] = np.diag(units * x)
        up, down = (
            np.array([np.broadcast_to(rate, 2 + count) for rate in rates(*places)])
            for places in (offsets, -offsets)
        )
        steps = np.abs(up - down) / (2 * x)
        direct = steps[:, :2].sum(axis=1) / w
        units = np.where(direct > 0, direct, steps[:, 2:].sum(axis=1) / w)
    units = np.where(np.isfinite(units) & (units > 0), units, 1.0)
    return np.array([1.0, 1.0, *units, *ends_of_loop])


Indices = NDArray[np.intp]

_OUTER_REVERSALS = 2.0
"""Reversals of a motion in a period, at the top and at the bottom of its loop."""

_IW_LIMIT = 0.75
"""The row ``IW`` is the factor of the distance from the last reversal in the argument of a virgin curve: 1 on
the virgin curve itself, 1/2 after a reversal (Masing). This is between both."""


@dataclass(frozen=True, slots=True, eq=False)
class LoopMemory:
    """The rows of n points after the smooth ones, (R - D, n), as transients left them.

    ``layout`` says which row is what; ``offsets`` (C, n) [N] are the forces in the middle of the loops.
    """

    layout: MemoryRows
    rows: Array
    offsets: Array

    @classmethod
    def at_start(cls, layout: MemoryRows, offset: Array, count: int) -> LoopMemory:
        """A closed loop around the forces ``offset`` (C, n) [N], or no memory at all: (0, n).

        A motion that grows beyond the loop follows the virgin curve around its middle: what was remembered
        outside of it is forgotten.
        """
        forces = offset.copy() if len(offset) else np.zeros((layout.curves, count))
        memory = cls(layout, np.zeros((layout.count - layout.smooth, count)), forces)
        if len(offset):
            memory.rows[layout.row("KIND") - layout.smooth] = WITHIN
            memory.rows[memory._offset] = offset
        return memory

    @classmethod
    def closed(cls, layout: MemoryRows, offset: Array) -> LoopMemory:
        """Loops around the forces ``offset`` (C, k) [N] that a motion has closed."""
        memory = cls.at_start(layout, offset, offset.shape[1])
        memory.rows[layout.row("TURNS") - layout.smooth] = _OUTER_REVERSALS
        return memory

    @property
    def _offset(self) -> slice:
        first = self.layout.row("OFFSET + 0") - self.layout.smooth
        return slice(first, first + self.layout.curves)

    def of(self, points: Indices) -> LoopMemory:
        """The memory of some of the points, by themselves."""
        return LoopMemory(self.layout, self.rows[:, points], self.offsets[:, points])

    def put(self, points: Indices, memory: LoopMemory) -> None:
        """Take over what other loops are at some of the points."""
        self.rows[:, points], self.offsets[:, points] = memory.rows, memory.offsets

    def joined(self, points: Indices, y: Array, *, transient: bool) -> Array:
        """All rows of states y (D, k): with the whole memory, or with the closed loop alone."""
        if transient:
            return np.concatenate([y, self.rows[:, points]])
        alone = np.zeros((self.layout.stack, len(points)))
        alone[: len(y)] = y
        alone[self.layout.row("KIND")] = ALONE
        alone[self.layout.smooth :][self._offset] = self.offsets[:, points]
        return alone

    def middle(self, points: Indices, slope: float) -> tuple[Array, Array]:
        """Where the slider of the only curve is [m], and its force there [N]; it sticks at a slope [N/m]."""
        offset = self._row("OFFSET + 0", points)
        return self._row("XR", points) - (self._row("NR + 0", points) - offset) / slope, offset

    def keep(self, points: Indices, state: Array) -> None:
        """Remember what a transient left in all rows (R, k)."""
        self.rows[:, points] = state[self.layout.smooth :]
        self.offsets[:, points] = self._middles(points)

    def _row(self, name: str, points: Indices) -> Array:
        return np.asarray(self.rows[self.layout.row(name) - self.layout.smooth, points])

    def has_inner_loops(self, points: Indices) -> NDArray[np.bool_]:
        """Where the last period of the transient had other turns (k,) than those at top and bottom."""
        return np.asarray(self._row("TURNS", points) != _OUTER_REVERSALS)

    def _middles(self, points: Indices) -> Array:
        """Force in the middle of each loop (C, k) [N] that a transient leaves.

        A motion that still grows runs back to the virgin curve, and its loops are centred on it. One that has
        decayed keeps an offset: the mean of its last reversals, 1 : 2 : 1, so that steady growth or decay
        between them drops out.
        """
        curves = self.layout.curves
        base = self.rows[self._offset, points]
        kind, depth = self._row("KIND", points), self._row("DEPTH", points).astype(np.intp)
        reversed_ = self._row("IW", points) < _IW_LIMIT
        within = np.flatnonzero((kind == EVERYTHING) & reversed_ & (depth > 0))
        if not len(within):
            return base
        depth, here = depth[within], points[within]
        first = self.layout.stack - self.layout.smooth
        for curve in range(curves):
            stack = self.rows[first + (1 + curve) * DEEPEST : first + (2 + curve) * DEEPEST]
            last = self._row(f"NR + {curve}", here)
            middle = base[curve, within]
            before = stack[depth - 1, here]
            # before the first reversal there is its mirror image on the virgin curve
            earlier = np.where(depth > 1, stack[np.maximum(depth - 2, 0), here], 2 * middle - before)
            base[curve, within] = (earlier + 2 * before + last) / 4
        return base


class HeldMemory(LoopMemory):
    """Sliders that stay where they are, for motions (x, v and states alone) in which none slips."""

    @classmethod
    def at(cls, layout: MemoryRows, middle: Array, offset: Array) -> HeldMemory:
        """Virgin curves about the places ``middle`` (k,) [m], where the force is ``offset`` (k,) [N]."""
        memory = cls(layout, np.zeros((layout.stack - layout.smooth, len(middle))), offset[None])
        for name, values in (
            ("KIND", EVERYTHING), ("OFFSET + 0", offset), ("NR + 0", offset),
            ("CENTER", middle), ("XR", middle), ("IW", 1.0),
        ):  # fmt: skip
            memory.rows[layout.row(name) - layout.smooth] = values
        return memory

    def joined(self, points: Indices, y: Array, *, transient: bool) -> Array:
        """All rows but the stack of states y (D - 2, k)."""
        whole = np.concatenate([y, np.zeros((self.layout.smooth - len(y), y.shape[1])), self.rows[:, points]])
        whole[self.layout.row("SW")] = np.where(y[0] < self._row("CENTER", points), -1.0, 1.0)
        return whole


# ----------------------------------------------------------------------------
# Motions under Masing laws in which nothing slips any more: there the law is straight, and its offset exact.
#
# After the last slip a slider is a spring about the place where it stopped. The loops of a transient that
# decays or beats about it have no area and no fixed middle, so that their steady state is looked for with
# the memory as the transient left it.

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
        force = _at_values(oscillator, (virgin,), symbol("x"))
        end, *between = force(reach * np.append(1.0, _PLACES))[0]
        straight = end > 0 and np.abs(between - _PLACES * end).max() < ROUND_OFF * end
        return cls(end / reach, reach) if straight else None

    def reaches(self, middle: Array, top: Array, bottom: Array) -> NDArray[np.bool_]:
        """(k,) whether nothing slips between bottom and top (k,) [m] about the places ``middle`` (k,)."""
        return np.asarray((top < middle + self.reach) & (bottom > middle - self.reach))


def _first_corner(virgin: sympy.Expr, oscillator: Oscillator) -> float:
    """Displacement [m] of the first corner of a virgin curve; infinite where it has none."""
    switches = normal_form_at(real_powers(virgin), oscillator.values).switches
    places = tuple(switch.threshold for switch in switches if switch.threshold is not None)
    return min((float(place) for place in _at_values(oscillator, places)() if place > 0), default=np.inf)


# ----------------------------------------------------------------------------
# The period map: where a state is after one period of the force. Its fixed points are the steady states.


@dataclass(frozen=True, slots=True, eq=False)
class PeriodMap:
    """The period maps of n test points of one oscillator.

    States are y = (x, v/omega) [m], so that both parts weigh the same, followed for a law with memory by its
    states over ``units`` (D,), and by the loop of its Masing laws: k of them are an array (D, k).
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
    units: Array
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
        points, steps = np.tile(points, several), np.tile(steps, several)
        if len(steps) and (steps == steps[0]).all():
            return self._integrate(points, y, int(steps[0]), periods, harmonics, peaks, transient)
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
        units = self.units[:size, None]
        y = y * units
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
        moved.state[:] /= units
        moved.history[:] /= units
        return moved


ORBIT_OFFSET = 1e-5
"""Relative distance of neighbouring orbits: truncation and rounding of a slope are both small there."""

_MAX_SHOOTING_STEPS = 6
"""A start that needs more steps is not near a fixed point."""


@dataclass(frozen=True, slots=True, eq=False)
class FixedPoints:
    """The result of Newton's method for k points: ``y`` (D, k), ``jacobian`` (D, D, k), ``found`` (k,).

    The Jacobian is that of the last correction: it was taken at the place before it, or, where one serves two
    steps (``spared``, and always with states of a law), up to two places before ``y``.
    """

    y: Array
    jacobian: Array
    found: NDArray[np.bool_]


def norm(y: Array) -> Array:
    """Length of k states (D, k)."""
    return np.asarray(np.sqrt(np.einsum("ik,ik->k", y, y)))


def correction(jacobian: Array, residual: Array) -> Array:
    """Solve (I - J) d = P(y) - y for k points; where it is singular, d = the residual itself."""
    if len(residual) > 2:
        return _correction(jacobian, residual)
    a, b = 1 - jacobian[0, 0], jacobian[0, 1]
    c, d = jacobian[1, 0], 1 - jacobian[1, 1]
    det = a * d - b * c
    regular = np.abs(det) > ROUND_OFF
    turned = np.stack([d * residual[0] + b * residual[1], a * residual[1] + c * residual[0]])
    return np.where(regular, turned / np.where(regular, det, 1.0), residual)


def _correction(jacobian: Array, residual: Array) -> Array:
    """As ``correction``, for laws with states of their own."""
    matrix = np.eye(len(residual)) - jacobian.transpose(2, 0, 1)
    move = residual.copy()
    regular = np.abs(np.linalg.det(matrix)) > ROUND_OFF
    move[:, regular] = np.linalg.solve(matrix[regular], residual.T[regular, :, None])[:, :, 0].T
    return move


def attraction(jacobian: Array) -> Array:
    """How far inside the unit circle the eigenvalues of J are; negative: outside.

    Of two states it is the least of Jury's conditions, of more 1 - |largest eigenvalue|^2: other measures of
    distance, so that only the sign, and the order within one law, have a meaning.
    """
    if len(jacobian) == 2:
        trace = jacobian[0, 0] + jacobian[1, 1]
        det = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
        return np.asarray(np.minimum(1 - np.abs(det), 1 + det - np.abs(trace)))
    matrix = jacobian.transpose(2, 0, 1)
    known = np.isfinite(matrix).all(axis=(1, 2))
    inside = np.full(len(matrix), -np.inf)
    inside[known] = 1 - np.max(np.abs(np.linalg.eigvals(matrix[known])) ** 2, axis=1)
    return inside


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
    return np.asarray(np.einsum("ijk,jk->ik", jacobian, y))


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
    active, here = np.arange(k), y
    # more states make a Jacobian dear
    spared = spared or len(y) > 2
    slope = jacobian
    for turn in range(_MAX_SHOOTING_STEPS):
        size = np.maximum(norm(here), least)
        if spared and turn % 2:
            image = period_map.carry(points, here, steps, 1).state
        else:
            image, slope = jacobians(period_map, points, here, steps, ORBIT_OFFSET * size)
        move = correction(slope, image - here)
        length = norm(move)
        there = here + move
        sane = np.isfinite(length) & (norm(there) < reach)
        done = sane & (length <= tolerance * size)
        y[:, active[sane]] = there[:, sane]
        jacobian[:, :, active] = slope
        found[active[done]] = True
        left = sane & ~done
        if not left.any():
            break
        active, points, steps = active[left], points[left], steps[left]
        least, reach, slope = least[left], reach[left], slope[:, :, left]
        here = there[:, left]
    return FixedPoints(y, jacobian, found)
