"""Stable branches of a resonance curve: what a sweep reaches, and to where it jumps.

They are rows (n, 4) along the curve of frequency [Hz], amplitude [m] and its interval [m], and NaN between.
"""

from __future__ import annotations

from math import inf

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.finding import Quantity, quantities
from rsgen.common.tolerances import BRANCH_DISTANCE
from rsgen.formula.units import quantity_text


def stable_within(rows: Array, band: tuple[float, float]) -> Array:
    """Return the rows (k, 4) in a band [Hz], with its ends."""
    parts = [rows[(rows[:, 0] >= band[0]) & (rows[:, 0] <= band[1])]]
    for end in band:
        beyond = rows[:, 0] - end
        at = np.flatnonzero(beyond[:-1] * beyond[1:] < 0)
        share = (beyond[at] / (beyond[at] - beyond[at + 1]))[:, None]
        parts.append((1 - share) * rows[at] + share * rows[at + 1])
    return np.concatenate(parts)


def swept_through(rows: Array, band: tuple[float, float], way: str) -> Array:
    """Return the rows (k, 4) that a sweep "up" or "down" a band [Hz] reaches, after one of zeros.

    It begins at the smallest motion, and jumps to the nearest one where its branch ends.
    """
    sense = 1 if way == "up" else -1
    inside = rows[(rows[:, 0] >= band[0]) & (rows[:, 0] <= band[1]), 0]
    places = np.concatenate([band, inside, np.nextafter(inside, sense * inf)])
    path = [np.zeros(4)]
    for place in sense * np.unique(sense * places):
        there = stable_within(rows, (place, place))
        path += [*there[np.argsort(np.abs(there[:, 1] - path[-1][1]))][:1]]
    return np.array(path)


def largest_of(rows: Array, name: str) -> dict[str, Quantity]:
    """Return the largest amplitude of rows, its interval and frequency, as numbers that begin with a name."""
    place, most, low, high = map(float, rows[np.argmax(rows[:, 1])])
    ends = {f"{name}_low": low, f"{name}_high": high} if low < high else {}
    return quantities("m", **{name: most}, **ends) | quantities("Hz", **{f"{name}_at": place})


def landing(rows: Array, fold: float, height: float) -> str:
    """Say to which amplitude the response jumps at a fold [Hz] from its height [m]; "" if not known."""
    sizes = stable_within(rows, (fold, fold))[:, 1]
    sizes = sizes[np.abs(sizes / height - 1) > BRANCH_DISTANCE]
    nearest = sizes[np.argsort(np.abs(sizes - height))][:1]
    return "".join(f" (to {quantity_text(size, 'm', 4)})" for size in nearest.tolist())
