"""A law along periodic motions: its force and how the force follows parameters and motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rsgen.common.arrays import Array

if TYPE_CHECKING:
    from rsgen.law.motion import FourierSeries

__all__ = ["Follow", "ForceSample"]

Follow = Callable[[Array, Array], Array]
"""From changes of displacement (d, s) [m] and velocity (n, d, s) [m/s] along n motions to those of q memories
(q, n, d, s)."""


@dataclass(frozen=True, slots=True)
class ForceSample:
    """The law along a motion: force n, slopes dn/dx and dn/dv, and dn/dp for each parameter (same shape).

    Slopes by x and v are those with all memories kept; ``by_memory`` has the others: dn/dz (q, n, s) of some
    memories and how these follow a change of the whole motion.
    """

    force: Array
    by_x: Array
    by_v: Array
    by_parameter: tuple[Array, ...]
    by_memory: tuple[tuple[Array, Follow], ...] = ()

    def tangent(self, series: FourierSeries, omega: Array) -> Array:
        """(n, d, d) derivative of the projected force by the coordinates of the motion (column).

        Parameters
        ----------
        series
            Of the motion, at the samples of the law.
        omega
            (n,) base frequency [rad/s].
        """
        tangent = series.tangent(self.by_x, omega[:, None] * self.by_v)
        for slope, follow in self.by_memory:
            change = follow(series.shape, omega[:, None, None] * series.rate)
            moved = np.sum(slope[:, :, None] * change, axis=0)
            tangent += np.swapaxes(moved @ series.project, 1, 2)
        return tangent
