"""Rows that were written twice: a copy is no second measurement, and would count as one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsgen.common.finding import Finding, quantities
from rsgen.data.surface.response_surface import ResponseSurface

__all__ = ["without_copies"]


def without_copies(surface: ResponseSurface) -> ResponseSurface:
    """Keep one row of each point whose rows are all equal to the last digit, and say how many were left out.

    Noise leaves no two readings alike, but a display of few digits may: a point with readings that differ
    keeps all of them, and a test keeps all rows if the readings of most of its repeated points differ.
    Simulated points without noise lose nothing that a copy would add.
    """
    sweep = 1.0 * (surface.sweep == "up") - 1.0 * (surface.sweep == "down")
    order = np.lexsort((surface.frequency, surface.level, sweep))
    point = np.stack([sweep, surface.level, surface.frequency], axis=1)
    if not np.any(np.all(point[order[1:]] == point[order[:-1]], axis=1)):
        return surface
    parts = [surface.force_harmonics, surface.harmonics]
    parts += [] if surface.across is None else [surface.across]
    reading = np.concatenate(
        [point, *(np.ascontiguousarray(part).view(np.float64) for part in parts)], axis=1
    )
    good = np.flatnonzero(np.isfinite(reading).all(axis=1))
    _, first, kind = np.unique(reading[good], axis=0, return_index=True, return_inverse=True)
    _, place = np.unique(point[good], axis=0, return_inverse=True)
    repeated, differing = np.bincount(place) > 1, np.bincount(place[first]) > 1
    if 2 * np.count_nonzero(differing) > np.count_nonzero(repeated):
        return surface
    kept = np.ones(len(surface), dtype=np.bool_)
    kept[good] = differing[place] | (first[kind] == np.arange(len(good)))
    if kept.all():
        return surface
    numbers = quantities(copies=int(np.count_nonzero(~kept)), all=len(surface))
    finding = Finding("rows-copied", "warning", numbers=numbers)
    return replace(surface.select(kept), findings=(*surface.findings, finding))
