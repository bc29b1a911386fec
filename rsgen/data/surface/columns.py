"""Columns of the response surface: units, types, checks."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, unmasked
from rsgen.common.errors import RsgenError

SWEEPS = ("rest", "up", "down")

CONTROLS = ("force", "response", "phase", "continuation")
"""Quantity that a test holds constant within a level: force, amplitude of the response, force and phase, none
(control-based continuation, whose levels are steps of the amplitude), or the root mean square of a multisine
(whose best linear approximation is no response to a sine)."""

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
"""SI unit of every column of a test with a force; ``level_unit`` and ``force_unit`` hold for any surface."""

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
    """Return a column as a read-only copy; a single value is repeated at every point."""
    dtype = _DTYPES.get(name, np.float64)
    if dtype is np.float64 and np.iscomplexobj(values):
        of_force = "; a complex force is force=, its level the nominal amplitude" if name == "level" else ""
        raise RsgenError(f"surface.{name}: complex numbers; allowed are real ones{of_force}")
    try:
        array = np.array(unmasked(values), dtype=dtype)
    except (TypeError, ValueError) as fault:
        raise RsgenError(f"surface.{name}: {fault}") from None
    if array.ndim == 0 and len(shape) == 1:
        array = np.full(shape, array)
    if array.ndim != len(shape) or any(
        want not in (-1, got) for want, got in zip(shape, array.shape, strict=True)
    ):
        expected = ", ".join("any" if size == -1 else str(size) for size in shape)
        expected += "," if len(shape) == 1 else ""
        known = ", as the frequency has them"
        if name == "frequency":
            expected, known = "n,", "; ravel all arguments where all have this shape"
        if name in ("level", "frequency"):
            known += "; of a table np.repeat the levels, np.tile the frequencies and ravel the rest"
        raise RsgenError(
            f"surface.{name}: shape {array.shape}; must be ({expected}), one row a test point{known}"
        )
    array.flags.writeable = False
    return array


def response_columns(
    response: Any, harmonics: Any, phase_known: bool, rows: int, force: Any = 0.0
) -> NDArray[Any]:
    """Return harmonics (n, H+1) [m], mean first, of a response or of harmonics; errors name the argument.

    Real amplitudes with a complex ``force`` are its phase reference, and their phase is known.
    """
    if (response is None) == (harmonics is None):
        raise RsgenError("surface: give the response once, as response= or as harmonics=")
    if harmonics is not None:
        return column(harmonics, "harmonics", (rows, -1))
    array = np.asarray(unmasked(response))
    if array.ndim > 1 and not (phase_known and array.dtype.kind in "biuf"):
        return column(array, "response", (rows, -1))
    real, turned = array.size and array.dtype.kind in "biuf", bool(np.any(np.imag(unmasked(force))))
    if real and turned:
        raise RsgenError(
            "surface.response: real numbers with a complex force; where the response is the phase "
            "reference of the force, give response = amplitude + 0j (and leave out phase_known=False); "
            "otherwise the complex fundamental X = amplitude * exp(-1j * lag)"
        )
    if phase_known and real:
        raise RsgenError(
            "surface.response: real numbers have no phase; give the complex fundamental "
            "X = amplitude * exp(-1j * lag) of shape (n,), complex harmonics (n, H+1), mean first, "
            "or phase_known=False where only amplitudes were measured"
        )
    fundamental = column(np.atleast_1d(array), "response", (rows,))
    return column(np.stack([np.zeros_like(fundamental), fundamental], axis=1), "harmonics", (rows, -1))


def force_columns(force: Any, harmonics: Any, rows: int) -> dict[str, NDArray[Any]]:
    """Return the fundamental (n,) and all recorded harmonics (n, K+1) of the force [N], mean first.

    The harmonics of ``force`` replace ``harmonics``; a fundamental alone replaces that of ``harmonics``.
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


def across_columns(across: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return harmonics (n, H+1) [m] of the motion across two sensors, of the shape that the response has.

    None, and a motion without columns, are a test with one response.
    """
    if across is None or np.shape(across)[1:] == (0,):
        return column(np.zeros((shape[0], 0)), "across", (shape[0], 0))
    return column(across, "across", shape)


def check_numbers(columns: dict[str, Any]) -> None:
    """Raise RsgenError if a frequency, a level or the number of harmonics is out of range."""
    if columns["harmonics"].shape[1] < 2:
        raise RsgenError("surface.harmonics: needs at least the mean and the fundamental")
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
# Sweep direction of every test point by the order of the frequencies; groups of like forces.

MIN_TURN = 0.02
"""Change of frequency, relative to the range of the block, by which a sweep turns back; jitter is less."""


def group_forces(force: Array, spread: float) -> NDArray[np.intp]:
    """Return the number (n,) of the group of each force (n,) [N]; a relative gap above ``spread`` begins one.

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
    """Return runs (start, stop, direction) between turns of the frequency (n,), relative to its range.

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
            # the turning point belongs to the run before it
            runs.append((start, extreme + 1, direction))
            start, extreme, direction = extreme + 1, i, ("up" if move > 0 else "down")
    return [*runs, (start, len(frequency), direction or "rest")]


def recognise_directions(
    frequency: Array, level: Array, block: NDArray[np.int64] | None = None
) -> NDArray[np.str_]:
    """Return the sweep direction of each point by the order of the frequencies.

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
        for start, stop, direction in monotone_runs(frequency[left:right], MIN_TURN):
            directions[left + start : left + stop] = direction
            count += 1
    # a direction needs two points: shorter runs on average are rows in no order
    if 2 * count > len(frequency):
        directions[:] = "rest"
    return directions
