"""The surface as an HDF5 file that h5py, MATLAB and Julia read."""

from __future__ import annotations

import io
import json
import os
from typing import Any

import h5py
import numpy as np

from rsgen.errors import MeasurementError, require
from rsgen.finding import Finding
from rsgen.output import write_atomic
from rsgen.surface.response_surface import COLUMN_UNITS, OUTCOMES, ResponseSurface

__all__ = ["load_surface", "save_surface"]

_FORMAT, _SCHEMA = "rsgen response surface", 1


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
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != _FORMAT or file.attrs.get("schema") != _SCHEMA:
                raise MeasurementError(f"{path}: not an rsgen response surface of schema {_SCHEMA}")
            values: dict[str, Any] = {}
            for name in (*COLUMN_UNITS, "findings"):
                if name in ("stable", "findings") and name not in file:
                    # surfaces of earlier versions have no such column
                    continue
                link = file.get(name, getlink=True)
                if not isinstance(link, h5py.HardLink) or not isinstance(file[name], h5py.Dataset):
                    raise MeasurementError(
                        f"{path}: {name}: missing; a surface has {', '.join(COLUMN_UNITS)}"
                    )
                if file[name].external:
                    raise MeasurementError(f"{path}: {name}: stored outside the file; not allowed")
                values[name] = file[name][()]
            values["sweep"] = np.char.decode(values["sweep"], "ascii")
            if "findings" in values:
                found = [Finding.from_dict(entry) for entry in json.loads(bytes(values["findings"]))]
            else:
                # the plain sentences of earlier versions become notes
                found = [Finding.note(str(text)) for text in file.attrs.get("notes", ())]
            return ResponseSurface(
                **values | {"findings": tuple(found)},
                origin=str(file.attrs["origin"]),
                # surfaces written before there were tests without phase do not say
                phase_known=bool(file.attrs.get("phase_known", True)),
                control=str(file.attrs.get("control", "force")),
            )
    except FileNotFoundError:
        raise MeasurementError(f"{path}: there is no such file") from None
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RecursionError) as fault:
        raise MeasurementError(f"{path}: cannot be read as a response surface: {fault}") from fault
