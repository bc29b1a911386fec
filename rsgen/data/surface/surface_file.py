"""The surface as an HDF5 file that h5py, MATLAB and Julia read."""

from __future__ import annotations

import codecs
import io
import json
import math
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from rsgen.common.errors import MeasurementError, RsgenError, printable, require
from rsgen.common.finding import Finding
from rsgen.common.output import write_atomic
from rsgen.common.process import (
    READER_BYTES,
    READY,
    START_SECONDS,
    command,
    confine,
    environment,
)
from rsgen.data.record_set import CHANNEL_NAME
from rsgen.data.surface.columns import COLUMN_UNITS, MAX_SENSORS
from rsgen.data.surface.response_surface import OUTCOMES, ResponseSurface

if TYPE_CHECKING:
    import h5py

_FORMAT, _SCHEMA = "rsgen response surface", 1


def save_surface(path: str | os.PathLike[str], surface: ResponseSurface) -> None:
    """Write a surface as HDF5, atomically; every array carries its unit.

    Complex arrays are HDF5 compounds (r, i), as h5py, MATLAB and Julia read them. ``settled`` is written
    next to ``outcome`` for readers that only need yes or no.

    Raises
    ------
    RsgenError
        The file cannot be written; an earlier one is unchanged.
    """
    import h5py  # 0.1 s, for writing only

    require(surface, ResponseSurface, "surface")
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["format"] = _FORMAT
        file.attrs["schema"] = _SCHEMA
        for name in ("origin", "phase_known", "control", "per_mass", "base"):
            file.attrs[name] = getattr(surface, name)
        file.attrs["outcomes"] = list(OUTCOMES)
        if surface.sensors:
            file.attrs["sensors"] = ",".join(surface.sensors)
        values = {name: getattr(surface, name) for name in COLUMN_UNITS}
        # columns that the test does not have are None, or have no harmonics
        columns = {k: v for k, v in values.items() if v is not None and v.shape[1:] != (0,)}
        columns["sweep"] = columns["sweep"].astype("S4")
        columns["settled"] = surface.settled.astype(np.uint8)
        columns["stable"] = columns["stable"].astype(np.uint8)
        forces = dict.fromkeys(("force", "force_harmonics"), surface.force_unit)
        units = COLUMN_UNITS | forces | {"level": surface.level_unit}
        for name, harmonics in surface.sensors.items():
            columns[_SENSOR + name], units[_SENSOR + name] = harmonics, "m"
        found = [finding.to_dict() for finding in surface.findings]
        columns["findings"] = np.bytes_(json.dumps(found, default=float))
        for name, values in columns.items():
            # no time stamps: the same surface gives the same bytes
            data = file.create_dataset(name, data=values, track_times=False)
            data.attrs["units"] = units.get(name, "")
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
        with place.open("rb") as file:
            return _surface(_Reader(file, str(path), _described(file, str(path))))
    except MeasurementError:
        raise
    except (*_FAULTS, RsgenError) as fault:
        reason = " ".join(str(fault).split())[:200]
        raise MeasurementError(f"{path}: cannot be read as a response surface: {reason}") from fault


_MAY_BE_MISSING = ("stable", "findings", "force_harmonics", "across", "label")
"""Columns that surfaces of earlier versions, or without a motion across or labels, do not have."""

_SENSOR = "sensor_"
"""Begins the name of the array of a further sensor."""


def _sensors(attributes: Mapping[str, Any]) -> list[str]:
    """Return the names of further sensors that a file declares; a MeasurementError for what is no name."""
    text = str(attributes.get("sensors", ""))
    names = text.split(",") if text else []
    if len(names) > MAX_SENSORS or not all(map(CHANNEL_NAME.fullmatch, names)):
        raise MeasurementError(f"sensors: {text!r:.60}; at most {MAX_SENSORS} names with commas are needed")
    return names


_FAULTS = (OSError, KeyError, ValueError, TypeError, AttributeError, RecursionError, MemoryError)
"""Exceptions raised by arrays that do not fit together."""


def _described(file: BinaryIO, path: str) -> dict[str, Any]:
    """Return attributes and places of arrays, found by a confined process: damage may stop the library."""
    order = json.dumps([*COLUMN_UNITS, "findings"])
    process = subprocess.Popen(  # noqa: S603 - trusted words: the order names columns
        command("rsgen.data.surface.surface_file", order),
        stdin=file,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=environment(),
    )
    clock = Timer(START_SECONDS, process.kill)
    clock.daemon = True
    clock.start()
    try:
        # limited, unlike communicate: a hostile file may control what the process writes
        said = process.stdout.read(_MAX_DESCRIPTION_BYTES) if process.stdout else b""
    finally:
        clock.cancel()
        process.kill()
        process.wait()
        if process.stdout:
            process.stdout.close()
    try:
        answer = json.loads(said.removeprefix(READY))
    except (ValueError, RecursionError):
        answer = {
            "fault": "cannot be read as a response surface: the HDF5 library found no end or broke down"
        }
    if "fault" in answer:
        raise MeasurementError(f"{path}: {printable(str(answer['fault']))}")
    return dict(answer)


class _Reader:
    """Reader of an open file with the places of its arrays, which together are no larger than the file."""

    def __init__(self, file: BinaryIO, path: str, described: dict[str, Any]) -> None:
        self.file = file
        self.path = path
        self.attributes: dict[str, Any] = described["attributes"]
        self.arrays: dict[str, Any] = described["arrays"]
        self.size = self.left = file.seek(0, os.SEEK_END)

    def attribute(self, name: str, default: Any = None) -> Any:
        return self.attributes.get(name, default)

    def array(self, name: str) -> Any:
        if name not in self.arrays:
            raise MeasurementError(f"{self.path}: {name}: missing; a surface has {', '.join(COLUMN_UNITS)}")
        declared = self.arrays[name]
        dtype, shape, offset = np.dtype(declared["dtype"]), tuple(declared["shape"]), int(declared["offset"])
        count = math.prod(shape)
        size = count * dtype.itemsize
        self.left -= size
        if dtype.kind not in "fcibuS" or self.left < 0 or offset < 0 or offset + size > self.size:
            raise MeasurementError(
                f"{self.path}: {name}: is not stored as rsgen stores it: plain numbers, not in chunks, "
                "not packed, no more than the file holds"
            )
        self.file.seek(offset)
        values = np.fromfile(self.file, dtype=dtype, count=count)
        return values.reshape(shape).astype(dtype.newbyteorder("="), copy=False)[()]


def _surface(reader: _Reader) -> ResponseSurface:
    if reader.attribute("format") != _FORMAT:
        raise MeasurementError(f"{reader.path}: not an rsgen response surface of schema {_SCHEMA}")
    schema = reader.attribute("schema")
    if schema != _SCHEMA:
        raise MeasurementError(f"{reader.path}: is of schema {schema!s:.40}; {_SCHEMA} is needed")
    values: dict[str, Any] = {
        name: reader.array(name)
        for name in (*COLUMN_UNITS, "findings")
        if name in reader.arrays or name not in _MAY_BE_MISSING
    }
    values["sweep"] = np.char.decode(values["sweep"], "ascii")
    values["sensors"] = {name: reader.array(_SENSOR + name) for name in _sensors(reader.attributes)}
    if "findings" in values:
        found = [Finding.from_dict(entry) for entry in json.loads(bytes(values["findings"]))]
    else:
        # sentences of earlier versions become notes
        found = [Finding.note(str(text)) for text in reader.attribute("notes", ())]
    return ResponseSurface(
        **values | {"findings": tuple(found)},
        origin=str(reader.attribute("origin")),
        # missing in surfaces of versions without tests without phase
        phase_known=bool(reader.attribute("phase_known", True)),
        control=str(reader.attribute("control", "force")),
        per_mass=bool(reader.attribute("per_mass", False)),
        base=str(reader.attribute("base", "")),
    )


# ----------------------------------------------------------------------------
# Process that opens a surface file with the HDF5 library and answers with the places of its arrays.
#
# Damaged files may stop the library or exhaust memory. It therefore runs in a process that can open no
# further file, with limited memory and time, and answers with a line of JSON. The parent process reads the
# numbers as plain bytes at these places, which it checks against the size of the file.

_MAX_DESCRIPTION_BYTES = 2**20
"""Of the answer of the process that describes a file; attributes have at most 64 KB each."""
_WORK_SECONDS = 2.0
"""Processor time; a sound file of any size takes a hundredth of it, as no numbers are read."""
_MAX_ATTRIBUTE_BYTES = 65_536
"""Of an attribute, the longest of which are notes of earlier versions; a file may declare any size."""
_DAMAGE = (
    OSError,
    KeyError,
    ValueError,
    TypeError,
    AttributeError,
    RecursionError,
    RuntimeError,
    MemoryError,
)
"""Exceptions that h5py raises for damaged files."""


def _attribute(file: h5py.File, name: str) -> Any:
    """Return an attribute as a value that JSON can store."""
    declared = file.attrs.get_id(name)
    # from shape and type: the storage size of an empty attribute is not known
    if math.prod(declared.shape) * declared.dtype.itemsize > _MAX_ATTRIBUTE_BYTES:
        raise MeasurementError(f"{name}: longer than any surface has it")
    value = file.attrs[name]
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list):
        return [str(part) for part in value]
    return value if isinstance(value, bool | int | str) else str(value)


def _array(file: h5py.File, name: str) -> dict[str, Any]:
    """Return the place of an array that is stored contiguously: no link, no chunks, no compression."""
    import h5py  # loaded before, see _outline

    link = file.get(name, getlink=True)
    data = file[name] if isinstance(link, h5py.HardLink) else None
    if not isinstance(data, h5py.Dataset):
        raise MeasurementError(f"{name}: is no array of this file")
    if data.external or data.is_virtual:
        raise MeasurementError(f"{name}: stored outside the file; not allowed")
    offset = data.id.get_offset() if data.shape is not None else None
    if offset is None and (data.shape is None or math.prod(data.shape)):
        raise MeasurementError(
            f"{name}: is not stored as rsgen stores it: plain numbers, not in chunks, not packed"
        )
    return {"dtype": data.dtype.str, "shape": list(map(int, data.shape)), "offset": offset or 0}


def _outline(file: BinaryIO, wanted: list[str]) -> dict[str, Any]:
    import h5py  # as in save_surface; the rehearsal loads it before the process is confined

    with h5py.File(file, "r") as opened:
        known = (
            "format",
            "schema",
            "origin",
            "phase_known",
            "control",
            "per_mass",
            "base",
            "notes",
            "sensors",
        )
        attributes = {name: _attribute(opened, name) for name in known if name in opened.attrs}
        wanted = [*wanted, *(_SENSOR + name for name in _sensors(attributes))]
        arrays = {name: _array(opened, name) for name in wanted if name in opened}
        return {"attributes": attributes, "arrays": arrays}


def _rehearse() -> None:
    """Read a sample, so that everything is imported before the process is confined."""
    import h5py  # see _outline

    sample = io.BytesIO()
    with h5py.File(sample, "w") as made:
        made.attrs["format"] = "text"
        made.attrs["notes"] = ["text"]
        made["a"] = np.arange(3.0)
    _outline(sample, ["a"])
    for name in ("ascii", "latin-1", "utf-16", "utf-32"):
        codecs.lookup(name)


def main() -> None:
    """Write attributes and places of arrays (named by the first argument) of the file on standard input."""
    wanted = json.loads(sys.argv[1])
    _rehearse()
    confine(READER_BYTES, _WORK_SECONDS)
    out = sys.stdout.buffer
    out.write(READY)
    out.flush()
    try:
        answer = _outline(sys.stdin.buffer, wanted)
    except (MeasurementError, *_DAMAGE) as fault:
        own = isinstance(fault, MeasurementError)
        reason = " ".join(str(fault).split())[:200] or type(fault).__name__
        answer = {"fault": reason if own else f"cannot be read as a response surface: {reason}"}
    out.write(json.dumps(answer).encode("ascii", "replace") + b"\n")
    out.flush()
