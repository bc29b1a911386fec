"""The surface as an HDF5 file that h5py, MATLAB and Julia read."""

from __future__ import annotations

import io
import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rsgen.errors import MeasurementError, RsgenError, require
from rsgen.finding import Finding
from rsgen.output import write_atomic
from rsgen.surface.response_surface import COLUMN_UNITS, OUTCOMES, ResponseSurface

__all__ = ["load_surface", "save_surface"]

_FORMAT, _SCHEMA = "rsgen response surface", 1

_ATTRIBUTE_BYTES = 65_536
"""The notes of earlier versions are the longest attribute; a file may declare any size."""


def save_surface(path: str | os.PathLike[str], surface: ResponseSurface) -> None:
    """Write a surface as HDF5, atomically; every array carries its unit.

    Complex arrays are HDF5 compounds (r, i), as h5py, MATLAB and Julia read them. ``settled`` is written
    beside ``outcome`` for readers that only want yes or no.

    Raises
    ------
    RsgenError
        The file cannot be written; what was there before is still there.
    """
    require(surface, ResponseSurface, "surface")
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["format"] = _FORMAT
        file.attrs["schema"] = _SCHEMA
        for name in ("origin", "phase_known", "control"):
            file.attrs[name] = getattr(surface, name)
        file.attrs["outcomes"] = list(OUTCOMES)
        columns = {name: getattr(surface, name) for name in COLUMN_UNITS}
        columns["sweep"] = columns["sweep"].astype("S4")
        columns["settled"] = surface.settled.astype(np.uint8)
        columns["stable"] = columns["stable"].astype(np.uint8)
        found = [finding.to_dict() for finding in surface.findings]
        columns["findings"] = np.bytes_(json.dumps(found, default=float))
        for name, values in columns.items():
            # no time stamps: the same surface gives the same bytes
            data = file.create_dataset(name, data=values, track_times=False)
            data.attrs["units"] = surface.level_unit if name == "level" else COLUMN_UNITS.get(name, "")
    write_atomic(path, buffer.getvalue())


def load_surface(path: str | os.PathLike[str]) -> ResponseSurface:
    """Read a surface that ``save_surface`` wrote.

    Raises
    ------
    MeasurementError
        The file is not HDF5, not a surface of this schema, or an array is missing or of the wrong kind.
    """
    place = Path(path)
    try:
        if not place.is_file():
            raise MeasurementError(f"{path}: there is no such file")
        with h5py.File(place, "r") as file:
            return _surface(_Reader(file, str(path), place.stat().st_size))
    except MeasurementError:
        raise
    except (*_FAULTS, MemoryError, RsgenError) as fault:
        reason = " ".join(str(fault).split())[:200]
        raise MeasurementError(f"{path}: cannot be read as a response surface: {reason}") from fault


_FAULTS = (OSError, KeyError, ValueError, TypeError, AttributeError, RecursionError, RuntimeError)
"""What h5py makes of damage."""


@dataclass(frozen=True, slots=True)
class _Reader:
    """An open file of ``size`` bytes, in which an array may take no more than its bytes in the file."""

    file: h5py.File
    path: str
    size: int

    def attribute(self, name: str, default: Any = None) -> Any:
        attributes = self.file.attrs
        if name not in attributes:
            return default
        declared = attributes.get_id(name)
        # HDF5 itself gives no size of an empty one, such as the notes of an earlier version
        if math.prod(declared.shape) * declared.dtype.itemsize > _ATTRIBUTE_BYTES:
            raise MeasurementError(f"{self.path}: {name}: longer than any surface has it")
        return attributes[name]

    def array(self, name: str) -> Any:
        """Read an array that lies in the file as it is: no link, no pieces, nothing to unpack."""
        link = self.file.get(name, getlink=True)
        data = self.file[name] if isinstance(link, h5py.HardLink) else None
        if not isinstance(data, h5py.Dataset):
            raise MeasurementError(f"{self.path}: {name}: missing; a surface has {', '.join(COLUMN_UNITS)}")
        if data.external or data.is_virtual:
            raise MeasurementError(f"{self.path}: {name}: stored outside the file; not allowed")
        plain = data.shape is not None and data.chunks is None and data.dtype.kind in "fcibuS"
        if not plain or math.prod(data.shape) * data.dtype.itemsize > self.size:
            raise MeasurementError(
                f"{self.path}: {name}: is not stored as rsgen stores it: plain numbers, not in chunks, "
                "not packed, no more than the file holds"
            )
        return data[()]


def _surface(reader: _Reader) -> ResponseSurface:
    if reader.attribute("format") != _FORMAT:
        raise MeasurementError(f"{reader.path}: not an rsgen response surface of schema {_SCHEMA}")
    schema = reader.attribute("schema")
    if schema != _SCHEMA:
        raise MeasurementError(f"{reader.path}: is of schema {schema!s:.40}; {_SCHEMA} is needed")
    values: dict[str, Any] = {
        name: reader.array(name)
        for name in (*COLUMN_UNITS, "findings")
        # surfaces of earlier versions have no such column
        if name in reader.file or name not in ("stable", "findings")
    }
    values["sweep"] = np.char.decode(values["sweep"], "ascii")
    if "findings" in values:
        found = [Finding.from_dict(entry) for entry in json.loads(bytes(values["findings"]))]
    else:
        # the plain sentences of earlier versions become notes
        found = [Finding.note(str(text)) for text in reader.attribute("notes", ())]
    return ResponseSurface(
        **values | {"findings": tuple(found)},
        origin=str(reader.attribute("origin")),
        # surfaces written before there were tests without phase do not say
        phase_known=bool(reader.attribute("phase_known", True)),
        control=str(reader.attribute("control", "force")),
    )
