"""The period map: where a state is after one period of the force. Its fixed points are the steady states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.kernel import Kernel, March

__all__ = ["PeriodMap"]

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class PeriodMap:
    """The period maps of n test points of one oscillator.

    States are y = (x, v/omega) [m], so that both parts weigh the same.
    """

    kernel: Kernel
    mass: float
    values: Floats
    force: NDArray[np.complex128]
    omega: Floats

    @property
    def scale(self) -> Floats:
        """(n,) displacement [m] below which a motion is none at all: a millionth of |F| / (m omega^2)."""
        smallest: Floats = 1e-6 * np.abs(self.force) / (self.mass * self.omega**2)
        return smallest

    def carry(
        self,
        points: Indices,
        y: Floats,
        steps: NDArray[np.int64],
        periods: int,
        harmonics: int | None = None,
    ) -> March:
        """Carry some points over periods; ``y`` (k, 2) and ``steps`` (k,) belong to ``points`` (k,)."""
        omega = self.omega[points]
        scaled = np.column_stack([np.ones_like(omega), omega])
        kinds = np.unique(steps)
        if len(kinds) == 1:
            march = self._march(points, y * scaled, int(kinds[0]), periods, harmonics)
        else:
            march = self._blank(len(points), harmonics)
            for kind in kinds:
                mine = np.flatnonzero(steps == kind)
                part = self._march(points[mine], y[mine] * scaled[mine], int(kind), periods, harmonics)
                march.state[mine] = part.state
                march.trail[mine] = part.trail
                march.harmonics[mine] = part.harmonics
                march.peak[mine] = part.peak
        march.state[:] /= scaled
        march.trail[:] /= scaled[:, None, :]
        return march

    def _march(
        self, points: Indices, state: Floats, steps: int, periods: int, harmonics: int | None
    ) -> March:
        return self.kernel.march(
            state,
            self.force[points],
            self.omega[points],
            self.mass,
            self.values,
            steps=steps,
            periods=periods,
            harmonics=harmonics,
        )

    @staticmethod
    def _blank(n: int, harmonics: int | None) -> March:
        columns = 0 if harmonics is None else harmonics + 1
        return March(
            np.empty((n, 2)), np.empty((n, 2, 2)), np.empty((n, columns), np.complex128), np.empty((n, 2))
        )
