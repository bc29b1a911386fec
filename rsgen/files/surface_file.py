"""Surfaces that ``save_surface`` wrote: the confined process opens the file, and numbers come back."""

from __future__ import annotations

import io
import json
import math
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np
from numpy.typing import NDArray

from rsgen.common.errors import MeasurementError, RsgenError, one_line
from rsgen.common.finding import Finding
from rsgen.data.surface.columns import COLUMN_UNITS
from rsgen.data.surface.response_surface import SURFACE_FORMAT, SURFACE_SCHEMA, ResponseSurface
from rsgen.files.data_files import SURFACE_FILE
from rsgen.files.sandbox import read_binary
from rsgen.files.tree import Node

_MAY_BE_MISSING = ("stable", "findings", "force_harmonics", "across", "label")
"""Columns that surfaces of earlier versions, or without a motion across or labels, do not have."""

_TEXTS = ("sweep", "findings")
"""Arrays of texts, which come as their bytes."""

_ATTRIBUTES = (
    "format", "schema", "origin", "phase_known", "control", "per_mass", "base", "notes", "overlapping",
)  # fmt: skip
_MAX_ATTRIBUTE_BYTES = 65_536
"""Of an attribute, the longest of which are notes of earlier versions; a file may declare any size."""

_FAULTS = (OSError, KeyError, ValueError, TypeError, AttributeError, RecursionError, MemoryError)
"""Exceptions raised by arrays that do not fit together."""


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
        if place.suffix.lower() == ".npz":
            raise MeasurementError(f"{path}: a surface is HDF5 (.h5); load_spectra reads spectra (.npz)")
        (arrays,) = read_binary(place, SURFACE_FILE.name, ["*"])
        return _surface(str(path), {array.path: array.values for array in arrays})
    except MeasurementError:
        raise
    except (*_FAULTS, RsgenError) as fault:
        text = f"{path}: cannot be read as a response surface: {one_line(fault)[:200]}"
        raise MeasurementError(text) from fault


def _surface(path: str, arrays: dict[str, NDArray[Any]]) -> ResponseSurface:
    attributes = json.loads(bytes(arrays["attributes"]))
    if attributes.get("format") != SURFACE_FORMAT:
        raise MeasurementError(f"{path}: not an rsgen response surface of schema {SURFACE_SCHEMA}")
    schema = attributes.get("schema")
    if schema != SURFACE_SCHEMA:
        raise MeasurementError(f"{path}: is of schema {schema!s:.40}; {SURFACE_SCHEMA} is needed")
    names = [name for name in COLUMN_UNITS if name in arrays or name not in _MAY_BE_MISSING]
    for name in names:
        if name not in arrays:
            raise MeasurementError(f"{path}: {name}: missing; a surface has {', '.join(COLUMN_UNITS)}")
    values: dict[str, Any] = {name: arrays[name] for name in names}
    signs = values["sweep"]
    values["sweep"] = np.char.decode(signs.view(f"S{signs.shape[-1]}")[..., 0], "ascii")
    if "findings" in arrays:
        found = [Finding.from_dict(entry) for entry in json.loads(bytes(arrays["findings"]))]
    else:
        # sentences of earlier versions become notes
        found = [Finding.note(str(text)) for text in attributes.get("notes", ())]
    return ResponseSurface(
        **values | {"findings": tuple(found)},
        origin=str(attributes.get("origin")),
        # missing in surfaces of versions without tests without phase
        phase_known=bool(attributes.get("phase_known", True)),
        control=str(attributes.get("control", "force")),
        per_mass=bool(attributes.get("per_mass", False)),
        base=str(attributes.get("base", "")),
        overlapping=bool(attributes.get("overlapping", False)),
    )


# ----------------------------------------------------------------------------
# In the confined process: the arrays of the file, which together are no larger than it.


def sample_surface() -> bytes:
    """Make a small file."""
    sample = io.BytesIO()
    with h5py.File(sample, "w") as made:
        made.attrs["format"] = "text"
        made.attrs["notes"] = ["text"]
        made["level"], made["sweep"] = np.arange(3.0), np.bytes_("text")
    return sample.getvalue()


def walk_surface(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through the attributes of a surface file, as one JSON text, and its arrays."""
    left = file.seek(0, os.SEEK_END)
    opened = h5py.File(file, "r")
    attributes = {name: _attribute(opened, name) for name in _ATTRIBUTES if name in opened.attrs}
    text = np.frombuffer(json.dumps(attributes).encode(), np.uint8)
    yield Node("attributes", text.shape, text.dtype.name, load=lambda: text)
    for name in (*COLUMN_UNITS, "findings"):
        if name in opened:
            data = _stored(opened, name)
            left -= data.size * data.dtype.itemsize
            if left < 0:
                raise MeasurementError(f"{name}: declares more numbers than the file holds")
            yield Node(name, data.shape, data.dtype.name, load=partial(_numbers, data))


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


def _stored(file: h5py.File, name: str) -> h5py.Dataset:
    """Return an array that is stored contiguously: no link, no chunks, no compression."""
    link = file.get(name, getlink=True)
    data = file[name] if isinstance(link, h5py.HardLink) else None
    if not isinstance(data, h5py.Dataset):
        raise MeasurementError(f"{name}: is no array of this file")
    if data.external or data.is_virtual:
        raise MeasurementError(f"{name}: stored outside the file; not allowed")
    kinds = "S" if name in _TEXTS else "fcibu"
    if data.dtype.kind not in kinds or data.shape is None or (data.size and data.id.get_offset() is None):
        raise MeasurementError(
            f"{name}: is not stored as rsgen stores it: plain numbers, not in chunks, not packed"
        )
    return data


def _numbers(data: h5py.Dataset) -> NDArray[Any]:
    values = np.asarray(data[()])
    # the bytes of texts, along a last axis
    return values[..., None].view(np.uint8) if values.dtype.kind == "S" else values
