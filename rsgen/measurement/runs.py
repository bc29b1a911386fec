"""From which side each point was reached, and to which level it belongs."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import MeasurementError
from rsgen.measurement.address import show
from rsgen.measurement.data_files import file_label
from rsgen.measurement.plan import MeasuredTest

__all__ = ["group_levels", "level_of_file", "recognise_directions"]

TURN = 0.02
"""A sweep has turned when the frequency moves back by this fraction of the block's range; less is jitter."""
SHORTEST = 1 / 4
"""More runs than this times the points are no sweeps: the rows are in no order of frequency."""
MOST_RUNS = 8
"""So many runs may be short all the same: few points at some levels."""
_NUMBER = r"([+-]?\d{1,30}(?:[.,]\d{1,30})?(?:[eE][+-]?\d{1,3})?)"


def _runs(frequency: NDArray[np.float64]) -> list[tuple[int, int, str]]:
    """Split one block into monotone runs: (start, stop, direction)."""
    n = len(frequency)
    span = float(np.ptp(frequency))
    if n < 2 or span == 0:
        return [(0, n, "rest")]
    threshold = TURN * span
    runs: list[tuple[int, int, str]] = []
    start, extreme, direction = 0, 0, ""
    for i in range(1, n):
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
    runs.append((start, n, direction or "rest"))
    return runs


def recognise_directions(
    frequency: NDArray[np.float64], level: NDArray[np.float64], block: NDArray[np.int64]
) -> NDArray[np.str_]:
    """Tell the sweep direction of each point from the order of the frequencies.

    A new run begins where the block or the level changes and where the frequency turns back.

    Parameters
    ----------
    frequency, level
        (n,) [Hz], [N] in the order of the test.
    block
        (n,) number of the block in the file.

    Returns
    -------
    (n,) "up", "down", or "rest" where a run is a single frequency; "rest" everywhere if the rows are in no
    order of frequency.

    Examples
    --------
    >>> import numpy as np
    >>> f = np.array([1.0, 2.0, 3.0, 2.5, 1.5])
    >>> [str(d) for d in recognise_directions(f, np.ones(5), np.zeros(5, dtype=int))]
    ['up', 'up', 'up', 'down', 'down']
    """
    directions = np.full(len(frequency), "rest", dtype="U4")
    changed = (np.diff(block) != 0) | (np.diff(level) != 0)
    edges = [0, *(np.flatnonzero(changed) + 1).tolist(), len(frequency)]
    count = 0
    for left, right in pairwise(edges):
        for start, stop, direction in _runs(frequency[left:right]):
            directions[left + start : left + stop] = direction
            count += 1
    if count > max(MOST_RUNS, SHORTEST * len(frequency)):
        directions[:] = "rest"
    return directions


def group_levels(force: NDArray[np.float64], spread: float) -> NDArray[np.float64]:
    """Group like forces to levels: in ascending order, a gap of more than ``spread`` begins a new level.

    Parameters
    ----------
    force
        (n,) amplitude of the measured force [N], positive.
    spread
        Relative gap.

    Returns
    -------
    (n,) the median force of each point's group [N].

    Examples
    --------
    >>> import numpy as np
    >>> group_levels(np.array([1.0, 1.02, 2.0, 0.99]), 0.1).tolist()
    [1.0, 1.0, 2.0, 1.0]
    """
    order = np.argsort(force, kind="stable")
    ordered = force[order]
    group = np.concatenate(([0], np.cumsum(np.diff(ordered) > spread * ordered[:-1])))
    medians = np.array([np.median(ordered[group == number]) for number in range(int(group[-1]) + 1)])
    level = np.empty(len(force))
    level[order] = medians[group]
    return level


def level_of_file(test: MeasuredTest, number: int) -> float | None:
    """Tell the level of a file from the plan and its name [N]; None where a file has no level of its own.

    Raises
    ------
    MeasurementError
        The name does not have the form that the plan says, or the number is not above 0.
    """
    rule = test.level
    if rule.value is not None:
        return rule.value
    if rule.values and len(rule.values) == len(test.files):
        return rule.values[number]
    if rule.name is None:
        # several values for one file belong to its entries
        return None
    name = test.files[number].name
    before, _, after = rule.name.partition("{level}")
    match = re.fullmatch(re.escape(before) + _NUMBER + re.escape(after), name)
    if match is None:
        raise MeasurementError(
            f"{file_label(test.files[number])}: its name is not of the form {show(rule.name)}"
        )
    level = float(match[1].replace(",", ".")) * rule.factor
    if not level > 0:
        raise MeasurementError(
            f"{file_label(test.files[number])}: its name tells a level of {level:g} N; above 0 needed"
        )
    return level
