"""The period map: where a state is after one period of the force. Its fixed points are the steady states."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.dynamics.kernel import Integrated, Kernel
from rsgen.dynamics.steady_state.loop_memory import LoopMemory
from rsgen.dynamics.steady_state.memory_units import Stiffness
from rsgen.dynamics.steady_state.sticking import Sticking

__all__ = ["PeriodMap"]

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
