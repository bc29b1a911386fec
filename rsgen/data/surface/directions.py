"""Sweep direction and level of every test point, from the order of the frequencies and from like forces."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array

__all__ = ["group_forces", "monotone_runs", "recognise_directions"]

TURN = 0.02
"""A sweep has turned when the frequency moves back by this fraction of the block's range; less is jitter."""
SHORTEST = 1 / 4
"""More runs than this times the points are no sweeps: the rows are in no order of frequency."""
MOST_RUNS = 8
"""Up to this number of runs may be short all the same: a few points at some levels."""


def group_forces(force: Array, spread: float) -> NDArray[np.intp]:
    """Number the groups of like forces (n,) [N]; in ascending order, a gap of more than ``spread`` parts two.

    Examples
    --------
    >>> group_forces(np.array([1.0, 1.02, 2.0, 0.99]), 0.1).tolist()
    [0, 0, 1, 0]
    """
    order = np.argsort(force, kind="stable")
    ordered = force[order]
    group = np.zeros(len(force), dtype=np.intp)
    group[order[1:]] = np.cumsum(np.diff(ordered) > spread * ordered[:-1])
    return group


def monotone_runs(frequency: Array, turn: float) -> list[tuple[int, int, str]]:
    """Split where the frequency (n,) turns back by a fraction of its range: (start, stop, direction).

    Examples
    --------
    >>> monotone_runs(np.array([1.0, 2.0, 2.99, 3.0, 2.99, 1.5]), 0.02)
    [(0, 4, 'up'), (4, 6, 'down')]
    """
    threshold = turn * float(np.ptp(frequency)) if len(frequency) else 0.0
    if threshold == 0:
        return [(0, len(frequency), "rest")]
    runs: list[tuple[int, int, str]] = []
    start, extreme, direction = 0, 0, ""
    for i in range(1, len(frequency)):
        move = frequency[i] - frequency[extreme]
        if direction == "":
            if abs(move) >= threshold:
                direction, extreme = ("up" if move > 0 else "down"), i
        elif move != 0 and (move > 0) == (direction == "up"):
            extreme = i
        elif abs(move) >= threshold:
            # the turning point still belongs to the run that reached it
            runs.append((start, extreme + 1, direction))
            start, extreme, direction = extreme + 1, i, ("up" if move > 0 else "down")
    return [*runs, (start, len(frequency), direction or "rest")]


def recognise_directions(
    frequency: Array, level: Array, block: NDArray[np.int64] | None = None
) -> NDArray[np.str_]:
    """Recognise the sweep direction of each point by the order of the frequencies.

    A new run begins where the block or the level changes and where the frequency turns back.

    Parameters
    ----------
    frequency, level
        (n,) [Hz], [N] in the order of the test.
    block
        (n,) number of the block in the file; None: one block.

    Returns
    -------
    (n,) "up", "down", or "rest" where a run is a single frequency; "rest" everywhere if the rows are in no
    order of frequency.

    Examples
    --------
    >>> import numpy as np
    >>> f = np.array([1.0, 2.0, 3.0, 2.5, 1.5])
    >>> [str(d) for d in recognise_directions(f, np.ones(5))]
    ['up', 'up', 'up', 'down', 'down']
    """
    directions = np.full(len(frequency), "rest", dtype="U4")
    changed = np.diff(level) != 0
    if block is not None:
        changed |= np.diff(block) != 0
    edges = [0, *(np.flatnonzero(changed) + 1).tolist(), len(frequency)]
    count = 0
    for left, right in pairwise(edges):
        for start, stop, direction in monotone_runs(frequency[left:right], TURN):
            directions[left + start : left + stop] = direction
            count += 1
    if count > max(MOST_RUNS, SHORTEST * len(frequency)):
        directions[:] = "rest"
    return directions
