"""The process that opens a surface file with the HDF5 library, and says where in the file its arrays lie.

The library was not written for files of strangers: damage makes it search without end. So it runs here, in
a process that can open no further file, whose memory and time are limited, and that answers with a line of
JSON. The numbers themselves are read by who asked, as plain bytes at places that are checked against the
file.
"""

from __future__ import annotations

import codecs
import io
import json
import math
import sys
from typing import Any, BinaryIO

import h5py
import numpy as np

from rsgen.common.errors import MeasurementError
from rsgen.common.process import READY, confine

__all__ = ["main"]

_SECONDS = 2.0
"""Of work: a good file takes a hundredth of it, whatever its size, for no numbers are read."""
_MEMORY_BYTES = 64 * 2**20
_ATTRIBUTE_BYTES = 65_536
"""The notes of earlier versions are the longest attribute; a file may declare any size."""
_FAULTS = (
    OSError,
    KeyError,
    ValueError,
    TypeError,
    AttributeError,
    RecursionError,
    RuntimeError,
    MemoryError,
)
"""What h5py makes of damage."""


def _attribute(file: h5py.File, name: str) -> Any:
    """Give an attribute as JSON has it."""
    declared = file.attrs.get_id(name)
    # HDF5 itself gives no size of an empty one, such as the notes of an earlier version
    if math.prod(declared.shape) * declared.dtype.itemsize > _ATTRIBUTE_BYTES:
        raise MeasurementError(f"{name}: longer than any surface has it")
    value = file.attrs[name]
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list):
        return [str(part) for part in value]
    return value if isinstance(value, bool | int | str) else str(value)


def _array(file: h5py.File, name: str) -> dict[str, Any]:
    """Say where an array lies that is stored as it is: no link, no pieces, nothing to unpack."""
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


def _described(file: BinaryIO, wanted: list[str]) -> dict[str, Any]:
    with h5py.File(file, "r") as opened:
        attributes = ("format", "schema", "origin", "phase_known", "control", "per_mass", "base", "notes")
        return {
            "attributes": {name: _attribute(opened, name) for name in attributes if name in opened.attrs},
            "arrays": {name: _array(opened, name) for name in wanted if name in opened},
        }


def _rehearse() -> None:
    """Read a sample, so that everything is imported before no file can be opened any more."""
    sample = io.BytesIO()
    with h5py.File(sample, "w") as made:
        made.attrs["format"] = "text"
        made.attrs["notes"] = ["text"]
        made["a"] = np.arange(3.0)
    _described(sample, ["a"])
    for name in ("ascii", "latin-1", "utf-16", "utf-32"):
        codecs.lookup(name)


def main() -> None:
    """Describe the surface on standard input; the first argument names the arrays as JSON."""
    wanted = json.loads(sys.argv[1])
    _rehearse()
    confine(_MEMORY_BYTES, _SECONDS)
    out = sys.stdout.buffer
    out.write(READY)
    out.flush()
    try:
        answer = _described(sys.stdin.buffer, wanted)
    except (MeasurementError, *_FAULTS) as fault:
        own = isinstance(fault, MeasurementError)
        reason = " ".join(str(fault).split())[:200] or type(fault).__name__
        answer = {"fault": reason if own else f"cannot be read as a response surface: {reason}"}
    out.write(json.dumps(answer).encode("ascii", "replace") + b"\n")
    out.flush()
