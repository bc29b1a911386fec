"""Which nominal level a sweep or step belongs to, where nobody says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["name_levels"]

_SPREAD = 0.1
"""Forces that differ by less than this, relatively, are one level."""


def name_levels(levels: Sequence[tuple[float | None, float]]) -> NDArray[np.float64]:
    """Name the level of each sweep: as given, or the typical force rounded to three digits.

    Parameters
    ----------
    levels
        (given [N] or None, typical force [N]) of each.

    Examples
    --------
    >>> name_levels([(None, 4.8213), (None, 4.79), (None, 28.84), (67.0, 66.1)]).tolist()
    [4.81, 4.81, 28.8, 67.0]
    """
    out = np.array([given if given is not None else np.nan for given, _ in levels], dtype=np.float64)
    open_ = np.flatnonzero(np.isnan(out))
    forces = np.array([typical for _, typical in levels])
    order = open_[np.argsort(forces[open_], kind="stable")]
    group: list[int] = []
    for i in order:
        if group and forces[i] > (1 + _SPREAD) * forces[group[0]]:
            out[group] = float(f"{np.mean(forces[group]):.3g}")
            group = []
        group.append(int(i))
    if group:
        out[group] = float(f"{np.mean(forces[group]):.3g}")
    return out
