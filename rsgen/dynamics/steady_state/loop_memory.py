"""What Masing laws remember beside their loop, point by point: carried along by transients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.kernel.generation import ALONE, DEEPEST, EVERYTHING, WITHIN, MemoryRows
from rsgen.formula import symbol
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.law.memory import memory_form

__all__ = ["LoopMemory", "Stiffness", "units_of_states"]


# ----------------------------------------------------------------------------
# Sizes of the states of a law: what they are divided by, and how fast they follow the motion.

_SMALL = 1e-3
"""Of the displacement that the force gives the mass alone: there states follow without their limits."""


_STABLE = 2.0
"""Steps times rate up to which the method of Runge and Kutta is stable, with a margin: the limit is 2.78."""


@dataclass(frozen=True, slots=True, eq=False)
class Stiffness:
    """How fast the states of a law follow the motion: -dg/dz of each equation z' = g."""

    slopes: Numeric
    values: tuple[float, ...]

    @classmethod
    def of(cls, oscillator: Oscillator) -> Stiffness | None:
        """Differentiate the equations; None for a law without."""
        memory = memory_form(oscillator.force)
        if memory is None or not memory.rates:
            return None
        at_rest = {rate.symbol: sympy.S.Zero for rate in memory.rates}
        slopes = tuple(sympy.diff(rate.rate, rate.symbol).subs(at_rest) for rate in memory.rates)
        names = oscillator.parameters
        arguments = (symbol("x"), symbol("v"), *(symbol(name) for name in names))
        return cls(compiled(slopes, arguments), tuple(oscillator.values[name] for name in names))

    def steps(self, amplitude: Array, omega: Array) -> Array:
        """Steps a period (k,) that motions of an amplitude (k,) [m] need to stay stable."""
        rates = self.slopes(amplitude, omega * amplitude, *self.values)
        fastest = np.max([np.abs(np.nan_to_num(rate)) + 0 * omega for rate in rates], axis=0)
        return np.asarray(2 * np.pi / omega * fastest / _STABLE)


def units_of_states(oscillator: Oscillator, force: ComplexArray, omega: Array) -> Array | None:
    """What one metre of displacement makes of each of D numbers [its unit/m], (D,); None without states.

    From the equations z' = g(x, v, z) at rest: |dg/dv| + |dg/dx|/omega; what depends on neither follows the
    other states. Only norms and the distances of neighbouring orbits depend on it.
    """
    memory = memory_form(oscillator.force)
    if memory is None or not memory.rates:
        return None
    names, states = oscillator.parameters, [rate.symbol for rate in memory.rates]
    rates = compiled(
        tuple(rate.rate for rate in memory.rates),
        (symbol("x"), symbol("v"), *states, *(symbol(name) for name in names)),
    )
    w = float(np.median(omega))
    size = float(np.median(np.abs(force))) / (oscillator.mass * w * w)
    x = _SMALL * size if size > 0 else _SMALL
    count = len(states)
    offsets = np.zeros((2 + count, 2 + count))
    offsets[0, 0], offsets[1, 1] = x, w * x
    values = [oscillator.values[name] for name in names]
    units = np.zeros(count)
    for _ in range(1 + count):
        offsets[2:, 2:] = np.diag(units * x)
        up, down = (
            np.array([np.broadcast_to(rate, 2 + count) for rate in rates(*places, *values)])
            for places in (offsets, -offsets)
        )
        steps = np.abs(up - down) / (2 * x)
        direct = steps[:, :2].sum(axis=1) / w
        units = np.where(direct > 0, direct, steps[:, 2:].sum(axis=1) / w)
    units = np.where(np.isfinite(units) & (units > 0), units, 1.0)
    loop = (1.0, 1.0) if memory.curves else ()
    return np.array([1.0, 1.0, *units, *loop])


Indices = NDArray[np.intp]

_TURNS = 2.0
"""Turns of a motion in a period, at the top and at the bottom of its loop."""


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
            memory.rows[0] = WITHIN
            memory.rows[memory._offset] = offset
        return memory

    @classmethod
    def closed(cls, layout: MemoryRows, offset: Array) -> LoopMemory:
        """Loops around the forces ``offset`` (C, k) [N] that a motion has closed."""
        memory = cls.at_start(layout, offset, offset.shape[1])
        memory.rows[layout.row("TURNS") - layout.smooth] = _TURNS
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
        alone[self.layout.smooth] = ALONE
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
        return np.asarray(self._row("TURNS", points) != _TURNS)

    def _middles(self, points: Indices) -> Array:
        """Force in the middle of each loop (C, k) [N] that a transient leaves.

        A motion that still grows runs back to the virgin curve, and its loops are centred on it. One that has
        decayed keeps an offset: the mean of its last reversals, 1 : 2 : 1, so that steady growth or decay
        between them drops out.
        """
        curves = self.layout.curves
        base = self.rows[self._offset, points]
        kind, depth = self.rows[0, points], self._row("DEPTH", points).astype(np.intp)
        within = np.flatnonzero((kind == EVERYTHING) & (self._row("IW", points) < 0.75) & (depth > 0))
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
