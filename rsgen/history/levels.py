"""Which nominal level a sweep or step belongs to, where it is not given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rsgen.surface.directions import group_forces

__all__ = ["name_levels"]

_SPREAD = 0.1
"""Sweeps whose forces differ by less than this, relatively, are one level."""


def name_levels(levels: Sequence[tuple[float | None, float]]) -> NDArray[np.float64]:
    """Name the level of each sweep: as given, or the mean force of its group rounded to three digits.

    Parameters
    ----------
    levels
        (given [N] or None, typical force [N]) of each.

    Examples
    --------
    >>> name_levels([(None, 4.8213), (None, 4.79), (None, 28.84), (67.0, 66.1)]).tolist()
    [4.81, 4.81, 28.8, 67.0]
    """
    named = np.array([np.nan if level is None else level for level, _ in levels], dtype=np.float64)
    unnamed = np.flatnonzero(np.isnan(named))
    force = np.array([typical for _, typical in levels])[unnamed]
    group = group_forces(force, _SPREAD)
    for number in np.unique(group):
        named[unnamed[group == number]] = float(f"{np.mean(force[group == number]):.3g}")
    return named
