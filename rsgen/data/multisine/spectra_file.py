"""The spectra of a multisine as a file of numpy, ``spectra.npz``, that holds no Python objects."""

from __future__ import annotations

import io
import math
import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from rsgen.common.errors import MeasurementError, printable, require
from rsgen.common.output import write_atomic
from rsgen.data.multisine.spectra import MultisineSpectra

_NEEDED = ("omega0", "level", "force", "response")
_ORIGINS = ("measured", "simulated")
_OPTIONAL = ("mean_known", "left_out", "per_mass", "base", "across", "origin", "label")
_MAX_UNPACKED_BYTES = 2**31
"""Of all arrays together: twice the largest virtual test."""
_MAX_TEXT_BYTES = 256
"""Of a text: the quantity of a base, the origin."""
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def save_spectra(path: str | os.PathLike[str], spectra: MultisineSpectra) -> None:
    """Write the spectra of all records, atomically; ``numpy.load`` and ``load_spectra`` read them.

    Raises
    ------
    RsgenError
        The file cannot be written; an earlier one is unchanged.
    """
    require(spectra, MultisineSpectra, "spectra")
    buffer = io.BytesIO()
    values = {name: getattr(spectra, name) for name in (*_NEEDED, "frequency", *_OPTIONAL)}
    arrays: dict[str, Any] = {name: value for name, value in values.items() if value is not None}
    np.savez_compressed(buffer, **arrays)
    write_atomic(Path(path), buffer.getvalue())


def load_spectra(path: str | os.PathLike[str]) -> MultisineSpectra:
    """Read spectra that ``save_spectra`` or a run wrote; findings of the records are not in the file.

    Raises
    ------
    MeasurementError
        There is no such file, an array is missing, damaged, too large or holds no plain numbers, or the
        arrays do not fit together.
    """
    if not Path(path).is_file():
        raise MeasurementError(f"{path}: there is no such file")
    try:
        with zipfile.ZipFile(path) as archive:
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            chosen = {name: members[name] for name in (*_NEEDED, *_OPTIONAL) if name in members}
            missing = [name for name in _NEEDED if name not in chosen]
            if missing:
                raise MeasurementError(f"{missing[0]}: missing; spectra have {', '.join(_NEEDED)}")
            size = sum(info.file_size for info in chosen.values())
            if size > _MAX_UNPACKED_BYTES:
                raise MeasurementError(f"declares {size} bytes; at most {_MAX_UNPACKED_BYTES} are read")
            values = {name: _array(archive, info, name) for name, info in chosen.items()}
        if values.get("origin", "measured") not in _ORIGINS:
            raise MeasurementError(f"origin: one of {', '.join(_ORIGINS)} is needed")
        for name in ("mean_known", "per_mass"):
            if not isinstance(values.get(name, True), bool):
                raise MeasurementError(f"{name}: true or false is needed")
        return MultisineSpectra(**values)
    except MeasurementError as fault:
        raise MeasurementError(f"{path}: {fault}") from None
    except Exception as fault:  # an archive, and a header that is Python text: any fault of a parser may come
        reason = printable(" ".join(str(fault).split()))[:160]
        raise MeasurementError(f"{path}: cannot be read as spectra of a multisine: {reason}") from None


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str) -> Any:
    """Return an array after its kind and declared size were checked; a single number as itself."""
    with archive.open(info) as file:
        version = npy.read_magic(file)
        if version not in _HEADERS:
            raise MeasurementError(f"{name}: is no array of version 1 or 2")
        shape, by_columns, dtype = _HEADERS[version](file)
        size = math.prod(shape) * dtype.itemsize
        text = dtype.kind == "U" and size <= _MAX_TEXT_BYTES
        if (
            not (text or dtype.kind in "bifc")
            or min(shape, default=0) < 0
            or file.tell() + size != info.file_size
        ):
            raise MeasurementError(f"{name}: {dtype} {shape}; plain numbers, as many as declared, are read")
        content = file.read(size + 1)
    values = np.frombuffer(content, dtype).reshape(shape, order="F" if by_columns else "C")
    return values if shape else values[()].item()
