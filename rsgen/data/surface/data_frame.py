"""Between surfaces and data frames; any table with named columns is read."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.text_table import data_frame

__all__ = ["columns_of_frame", "frame_of_surface"]

_AS_THEY_ARE = ("sweep", "outcome", "residual", "error", "stable")

_LARGEST_PHASE = 4 * np.pi
"""Phases beyond this are degrees: the lag of one mode stays within half a turn, unwrapped or not."""


class _Table:
    """Columns by name, of whatever kind of table."""

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
        return np.asarray(self._frame[name])

    def complex(self, name: str) -> ComplexArray | None:
        """Give ``name``, or ``name_real`` + i ``name_imag``; None where there is neither."""
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
    """Give the arguments of ``ResponseSurface`` that a table holds.

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
        "phase_known": phase_known,
    }
    if (across := table.complex("across")) is not None:
        columns["across"] = _with_harmonics(table, across, "across_")
    if table.has("label"):
        columns["label"] = table.read("label")
    if table.has("peak_max", "peak_min"):
        columns["peak"] = np.stack([table.read("peak_max"), table.read("peak_min")], axis=1)
    return columns | {name: table.read(name) for name in _AS_THEY_ARE if table.has(name)}


def _with_harmonics(table: _Table, fundamental: Any, prefix: str) -> ComplexArray:
    """(n, H+1) from the columns of one prefix, mean first."""
    higher: list[ComplexArray] = []
    while (column := table.complex(f"{prefix}harmonic_{len(higher) + 2}")) is not None:
        higher.append(column)
    mean = table.read(f"{prefix}mean") if table.has(f"{prefix}mean") else np.zeros(len(fundamental))
    return np.stack([mean.astype(np.complex128), fundamental, *higher], axis=1)


def _harmonic_columns(prefix: str, harmonics: ComplexArray) -> dict[str, Any]:
    """Mean and higher harmonics by name, as ``_with_harmonics`` reads them."""
    means = {f"{prefix}mean": harmonics[:, 0].real}
    return means | {f"{prefix}harmonic_{h}": harmonics[:, h] for h in range(2, harmonics.shape[1])}


def _fundamental(table: _Table, force: ComplexArray, degrees: bool) -> tuple[ComplexArray, bool]:
    name = "amplitude"
    if table.has("response") and not np.iscomplexobj(table.read("response")) and table.has("phase"):
        name = "response"
    elif (response := table.complex("response")) is not None:
        return response, True
    if not table.has(name):
        raise RsgenError(
            "from_frame: no response; give a column 'response', 'response_real' and 'response_imag', or "
            f"'amplitude' and 'phase'; there are {', '.join(table.names)}"
        )
    amplitude = np.asarray(table.read(name), dtype=np.float64)
    if not table.has("phase"):
        return amplitude.astype(np.complex128), False
    lag = np.asarray(table.read("phase"), dtype=np.float64)
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
    """Give a ``pandas.DataFrame`` with the columns that ``columns_of_frame`` reads, and amplitude and phase.

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
    if surface.phase_known:
        columns |= {"response": surface.harmonics[:, 1], "phase": surface.phase}
    columns |= _harmonic_columns("", surface.harmonics)
    if surface.force_harmonics.shape[1] > 2 or surface.force_harmonics[:, 0].any():
        columns |= _harmonic_columns("force_", surface.force_harmonics)
    if surface.across is not None:
        columns |= {"across": surface.across[:, 1]} | _harmonic_columns("across_", surface.across)
    if surface.label is not None:
        columns["label"] = surface.label
    columns |= {"peak_max": surface.peak[:, 0], "peak_min": surface.peak[:, 1]}
    columns |= {name: getattr(surface, name) for name in _AS_THEY_ARE}
    return data_frame(columns)
