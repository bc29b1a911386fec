"""Columns of the response surface: their units and types, and what each of them must satisfy."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError

__all__ = [
    "BASE_UNITS",
    "COLUMN_UNITS",
    "CONTROLS",
    "DERIVATIVE",
    "QUANTITIES",
    "SWEEPS",
    "below_acceleration",
    "check_numbers",
    "column",
    "force_columns",
    "group_forces",
    "monotone_runs",
    "recognise_directions",
    "response_columns",
]


SWEEPS = ("rest", "up", "down")

CONTROLS = ("force", "response", "phase", "continuation")
"""What a test holds within a level: force, amplitude of the response, force and phase, or nothing: points of
a control-based continuation, whose levels are steps of the amplitude."""

QUANTITIES = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
"""What a motion may be given as, each the derivative of the one before, and its unit."""

DERIVATIVE = {quantity: order for order, quantity in enumerate(QUANTITIES)}
"""Which derivative of the displacement a quantity is."""

BASE_UNITS = {"": "N"} | QUANTITIES
"""Unit of levels: of the force, or of the motion of the base that was driven."""

COLUMN_UNITS = {
    "level": "N",
    "frequency": "Hz",
    "force": "N",
    "force_harmonics": "N",
    "harmonics": "m",
    "across": "m",
    "peak": "m",
    "sweep": "",
    "outcome": "",
    "residual": "1",
    "error": "1",
    "stable": "",
    "label": "",
}
"""SI unit of every column where a force was held; ``level_unit`` and ``force_unit`` say it of any surface."""

_DTYPES: dict[str, type | str] = {
    "force": np.complex128,
    "force_harmonics": np.complex128,
    "harmonics": np.complex128,
    "response": np.complex128,
    "across": np.complex128,
    "sweep": "U4",
    "outcome": np.int8,
    "stable": np.bool_,
}


def column(values: Any, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Copy a column into an array that nobody can change; a single value holds at every point."""
    try:
        array = np.array(values, dtype=_DTYPES.get(name, np.float64))
    except (TypeError, ValueError) as fault:
        raise RsgenError(f"surface.{name}: {fault}") from None
    if array.ndim == 0 and len(shape) == 1:
        array = np.full(shape, array)
    if array.ndim != len(shape) or any(
        want not in (-1, got) for want, got in zip(shape, array.shape, strict=True)
    ):
        expected = ", ".join("any" if size == -1 else str(size) for size in shape)
        expected += "," if len(shape) == 1 else ""
        known = "" if name == "frequency" else ", as the frequency has them"
        raise RsgenError(
            f"surface.{name}: shape {array.shape}; must be ({expected}), one row a test point{known}"
        )
    array.flags.writeable = False
    return array


def response_columns(response: Any, harmonics: Any, phase_known: bool, rows: int) -> NDArray[Any]:
    """Give the harmonics, mean first, from whichever of the two was given; faults bear the name given."""
    if (response is None) == (harmonics is None):
        raise RsgenError("surface: give the response once, as response= or as harmonics=")
    if harmonics is not None:
        return column(harmonics, "harmonics", (rows, -1))
    array = np.asarray(response)
    if array.ndim > 1:
        return column(array, "response", (rows, -1))
    if phase_known and array.size and array.dtype.kind in "biuf":
        raise RsgenError(
            "surface.response: real numbers have no phase; give the complex fundamental "
            "X = amplitude * exp(-1j * lag), or phase_known=False where only amplitudes were measured"
        )
    fundamental = column(np.atleast_1d(array), "response", (rows,))
    return column(np.stack([np.zeros_like(fundamental), fundamental], axis=1), "harmonics", (rows, -1))


def force_columns(force: Any, harmonics: Any, rows: int) -> dict[str, NDArray[Any]]:
    """Give the fundamental and all recorded harmonics of the force, (n,) and (n, K+1), mean first.

    A force with harmonics of its own wins; a fundamental alone takes its place among those given.
    """
    if np.ndim(force) > 1:
        harmonics = column(force, "force", (rows, -1))
        if harmonics.shape[1] < 2:
            raise RsgenError(
                "surface.force: one column; harmonics need at least the mean and the fundamental"
            )
        force = harmonics[:, 1]
    fundamental = column(force, "force", (rows,))
    if harmonics is None:
        harmonics = np.zeros((rows, 2))
    whole = np.array(column(harmonics, "force_harmonics", (rows, -1)))
    if whole.shape[1] < 2:
        raise RsgenError("surface.force_harmonics: needs at least the mean and the fundamental")
    whole[:, 1] = fundamental
    return {"force": fundamental, "force_harmonics": column(whole, "force_harmonics", (rows, -1))}


def below_acceleration(quantity: str | None) -> int:
    """How often a quantity must be differentiated to be an acceleration; None is a displacement."""
    return DERIVATIVE["acceleration"] - DERIVATIVE[quantity or "displacement"]


def check_numbers(columns: dict[str, Any]) -> None:
    """Raise RsgenError where a frequency, a level or a shape can be none."""
    if columns["harmonics"].shape[1] < 2:
        raise RsgenError("surface.harmonics: needs at least the mean and the fundamental")
    across = columns["across"]
    if across is not None and across.shape != columns["harmonics"].shape:
        raise RsgenError(
            f"surface.across: shape {across.shape}; must be {columns['harmonics'].shape}, as the "
            "response has it: one row a test point, the mean and the same harmonics"
        )
    frequency, level = columns["frequency"], columns["level"]
    if not np.all(np.isfinite(frequency) & (frequency > 0)):
        raise RsgenError("surface.frequency: must be positive and finite everywhere")
    if not np.isfinite(level).all():
        row = int(np.argmin(np.isfinite(level)))
        raise RsgenError(f"surface.level: {level[row]} in row {row}; must be finite everywhere")
    if (level < 0).any():
        row = int(np.argmax(level < 0))
        raise RsgenError(f"surface.level: {level[row]:g} in row {row}; an amplitude must not be negative")


# ----------------------------------------------------------------------------
# Sweep direction and level of every test point, from the order of the frequencies and from like forces.

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
