"""Numbers of steps in a period on offer: few different ones fill the batches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array

__all__ = ["grid_above"]

_GRID = np.array([24 * 2**k for k in range(10)] + [32 * 2**k for k in range(10)])
_GRID.sort()


def grid_above(wanted: float | Array) -> NDArray[np.int64]:
    """The next number of steps on offer."""
    return np.asarray(_GRID[np.minimum(np.searchsorted(_GRID, wanted), len(_GRID) - 1)])
