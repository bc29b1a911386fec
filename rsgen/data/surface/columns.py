"""Columns of the response surface: units, types, checks; conversion from and to data frames."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray, unmasked
from rsgen.common.errors import RsgenError
from rsgen.common.text_table import data_frame
from rsgen.data.record_set import CHANNEL_NAME

SWEEPS = ("rest", "up", "down")

CONTROLS = ("force", "response", "phase", "continuation", "multisine")
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
        known = "" if name == "frequency" else ", as the frequency has them"
        if name in ("level", "frequency"):
            known += "; of a table np.repeat the levels, np.tile the frequencies and ravel the rest"
        raise RsgenError(
            f"surface.{name}: shape {array.shape}; must be ({expected}), one row a test point{known}"
        )
    array.flags.writeable = False
    return array


def response_columns(response: Any, harmonics: Any, phase_known: bool, rows: int) -> NDArray[Any]:
    """Return harmonics (n, H+1) [m], mean first, of a response or of harmonics; errors name the argument."""
    if (response is None) == (harmonics is None):
        raise RsgenError("surface: give the response once, as response= or as harmonics=")
    if harmonics is not None:
        return column(harmonics, "harmonics", (rows, -1))
    array = np.asarray(unmasked(response))
    if array.ndim > 1 and not (phase_known and array.dtype.kind in "biuf"):
        return column(array, "response", (rows, -1))
    if phase_known and array.size and array.dtype.kind in "biuf":
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


MAX_SENSORS = 200
_SIGNALS = ("force", "response", "across")
"""Names of signals that every surface has."""
_PART = re.compile(r".*_(mean|real|imag|harmonic_\d+)")
"""Columns of a data frame that are a part of a signal."""


def sensor_columns(sensors: Any, rows: int) -> dict[str, NDArray[Any]]:
    """Return harmonics (n, H+1) [m] of further sensors by name, mean first; (n,) is the fundamental alone."""
    if not isinstance(sensors, Mapping) or len(sensors) > MAX_SENSORS:
        raise RsgenError(f"surface.sensors: must be a dict of at most {MAX_SENSORS} names and columns")
    found = {}
    for name, values in sensors.items():
        known = isinstance(name, str) and CHANNEL_NAME.fullmatch(name)
        if not known or name in _SIGNALS or _PART.fullmatch(name):
            raise RsgenError(
                f"surface.sensors: {name!r:.60}; must be a letter, then letters, digits and _, none of "
                f"{', '.join(_SIGNALS)}, and without the ending _mean, _real, _imag or _harmonic_2"
            )
        try:
            found[name] = response_columns(np.asarray(unmasked(values)), None, True, rows)
        except RsgenError as fault:
            raise RsgenError(str(fault).replace("surface.response", f"surface.sensors.{name}")) from None
        if found[name].shape[1] < 2:
            raise RsgenError(f"surface.sensors.{name}: needs at least the mean and the fundamental")
    return found


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


# ----------------------------------------------------------------------------
# Surfaces from and to data frames; any table with named columns is read.

_AS_THEY_ARE = ("sweep", "outcome", "residual", "error", "stable")

_LARGEST_PHASE = 4 * np.pi
"""Phases beyond this are degrees: the lag of one mode stays within half a turn, unwrapped or not."""


class _Table:
    """Columns by name, of any kind of table."""

    def __init__(self, frame: Any) -> None:
        dtype = getattr(frame, "dtype", None)
        names = getattr(frame, "columns", None) if dtype is None else dtype.names
        if names is None and hasattr(frame, "keys"):
            names = frame.keys()
        if names is None:
            raise RsgenError(f"from_frame: {type(frame).__name__}; must be a data frame or a dict of columns")
        self._frame, self.names = frame, [str(name) for name in names]

    def has(self, *names: str) -> bool:
        return all(name in self.names for name in names)

    def read(self, name: str) -> NDArray[Any]:
        if name not in self.names:
            raise RsgenError(f"from_frame: no column {name!r}; there are {', '.join(self.names)}")
        return np.asarray(unmasked(self._frame[name]))

    def complex(self, name: str) -> ComplexArray | None:
        """Return column ``name``, or ``name_real`` + i ``name_imag``; None without either."""
        if self.has(name):
            column = self.read(name)
        elif self.has(f"{name}_real", f"{name}_imag"):
            column = self.read(f"{name}_real") + 1j * self.read(f"{name}_imag")
        else:
            return None
        if name == "response" and np.isrealobj(column) and column.dtype.kind in "fiu":
            raise RsgenError(
                "from_frame: response: real numbers have no phase; add a column 'phase', or name it "
                "'amplitude'"
            )
        try:
            return np.asarray(column, dtype=np.complex128)
        except (TypeError, ValueError) as fault:
            raise RsgenError(f"from_frame: column {name!r}: {fault}") from None


def columns_of_frame(frame: Any, degrees: bool) -> dict[str, Any]:
    """Return the arguments of ``ResponseSurface`` that a table holds.

    Raises
    ------
    RsgenError
        A column is missing, or phases in radians are larger than a phase can be.
    """
    table = _Table(frame)
    force = table.complex("force")
    if force is None:
        force = table.read("force")
    fundamental, phase_known = _fundamental(table, force, degrees)
    columns: dict[str, Any] = {
        "level": table.read("level"),
        "frequency": table.read("frequency"),
        "force": _with_harmonics(table, force, "force_"),
        "harmonics": _with_harmonics(table, fundamental, ""),
        "across": _with_harmonics(table, table.complex("across"), "across_"),
        "sensors": {
            name: _with_harmonics(table, table.complex(f"sensor_{name}"), f"sensor_{name}_")
            for name in _sensors_of(table.names)
        },
        "phase_known": phase_known,
    }
    if table.has("label"):
        columns["label"] = table.read("label")
    if table.has("peak_max", "peak_min"):
        columns["peak"] = np.stack([table.read("peak_max"), table.read("peak_min")], axis=1)
    return columns | {name: table.read(name) for name in _AS_THEY_ARE if table.has(name)}


def _sensors_of(names: list[str]) -> list[str]:
    """Return the names of further sensors, from those of columns: "sensor_tip", or its real part."""
    heads = [name.removeprefix("sensor_") for name in names if name.startswith("sensor_")]
    return [head.removesuffix("_real") for head in heads if not _PART.fullmatch(head.removesuffix("_real"))]


def _with_harmonics(table: _Table, fundamental: Any, prefix: str) -> ComplexArray | None:
    """Return harmonics (n, H+1) from the columns of one prefix, mean first; None without a fundamental."""
    if fundamental is None:
        return None
    higher: list[ComplexArray] = []
    while (column := table.complex(f"{prefix}harmonic_{len(higher) + 2}")) is not None:
        higher.append(column)
    mean = table.read(f"{prefix}mean") if table.has(f"{prefix}mean") else np.zeros(len(fundamental))
    return np.stack([mean.astype(np.complex128), fundamental, *higher], axis=1)


def _harmonic_columns(prefix: str, harmonics: ComplexArray) -> dict[str, Any]:
    """Return mean and higher harmonics by name, as ``_with_harmonics`` reads them."""
    means = {f"{prefix}mean": mean.real for mean in harmonics.T[:1]}
    return means | {f"{prefix}harmonic_{h}": harmonics[:, h] for h in range(2, harmonics.shape[1])}


def _fundamental(table: _Table, force: ComplexArray, degrees: bool) -> tuple[ComplexArray, bool]:
    """Return the fundamental (n,) of the response, and whether its phase was recorded."""
    name = "amplitude"
    lag = np.asarray(table.read("phase"), dtype=np.float64) if table.has("phase") else np.zeros(0)
    # a phase that was not recorded is NaN at every point
    recorded = bool(np.isfinite(lag).any())
    if table.has("response") and not np.iscomplexobj(table.read("response")) and recorded:
        name = "response"
    elif (response := table.complex("response")) is not None:
        return response, recorded or not table.has("phase")
    if not table.has(name):
        raise RsgenError(
            "from_frame: no response; give a column 'response', 'response_real' and 'response_imag', or "
            f"'amplitude' and 'phase'; there are {', '.join(table.names)}"
        )
    amplitude = np.asarray(table.read(name), dtype=np.float64)
    if not recorded:
        return amplitude.astype(np.complex128), False
    if degrees:
        lag = np.radians(lag)
    elif np.nanmax(np.abs(lag), initial=0.0) > _LARGEST_PHASE:
        raise RsgenError(
            f"from_frame: phase: up to {np.nanmax(np.abs(lag)):.4g} rad; say degrees=True "
            "where it is in degrees"
        )
    turn = force / np.where(np.abs(force) > 0, np.abs(force), 1.0)
    return amplitude * np.exp(-1j * lag) * turn, True


def frame_of_surface(surface: Any) -> Any:
    """Return a ``pandas.DataFrame`` that ``columns_of_frame`` reads, with amplitude and phase.

    Raises
    ------
    RsgenError
        pandas is not installed.
    """
    columns: dict[str, Any] = {
        "level": surface.level,
        "frequency": surface.frequency,
        "force": surface.force,
        "amplitude": surface.amplitude,
    }
    columns |= {"response": surface.harmonics[:, 1], "phase": surface.phase}
    columns |= _harmonic_columns("", surface.harmonics)
    if surface.force_harmonics.shape[1] > 2 or surface.force_harmonics[:, 0].any():
        columns |= _harmonic_columns("force_", surface.force_harmonics)
    columns |= zip(("across",), surface.across.T[1:2], strict=False)
    columns |= _harmonic_columns("across_", surface.across)
    for name, harmonics in surface.sensors.items():
        columns |= {f"sensor_{name}": harmonics[:, 1]} | _harmonic_columns(f"sensor_{name}_", harmonics)
    if surface.label is not None:
        columns["label"] = surface.label
    columns |= {"peak_max": surface.peak[:, 0], "peak_min": surface.peak[:, 1]}
    columns |= {name: getattr(surface, name) for name in _AS_THEY_ARE}
    return data_frame(columns)
