"""What Masing laws remember beside their loop, point by point: carried along by transients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.dynamics.kernel.memory_rows import ALONE, DEEPEST, EVERYTHING, WITHIN, MemoryRows

__all__ = ["LoopMemory"]

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
