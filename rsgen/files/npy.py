"""NumPy files: .npy and .npz, without pickles, sizes checked before anything is read."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from types import SimpleNamespace
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from rsgen.common.errors import MeasurementError
from rsgen.files.tree import Node, array_bytes

MAX_HEADER = 10_000
"""Bytes of a header: as many as numpy itself parses, for it reads this text with Python's parser."""
_PICKLE = "holds Python objects (a pickle), which could run code; arrays of numbers are read"

Open = Callable[[], AbstractContextManager[IO[bytes]]]


def sample_npy() -> bytes:
    """Make a small .npy file."""
    file = io.BytesIO()
    np.save(file, np.arange(3.0))
    return file.getvalue()


def sample_npz() -> bytes:
    """Make a small .npz archive."""
    file = io.BytesIO()
    np.savez_compressed(file, a=np.arange(3.0))
    return file.getvalue()


def _head_bytes(file: IO[bytes]) -> IO[bytes]:
    """Read the bytes of a header, its declared length checked first."""
    begin = file.read(12)
    # version 1 gives the length of the text in two bytes, the later ones in four
    width = 2 if begin[6:7] == b"\x01" else 4
    size = int.from_bytes(begin[8 : 8 + width], "little")
    if size > MAX_HEADER:
        raise MeasurementError(f"declares a header of {size} bytes; at most {MAX_HEADER} are read")
    return io.BytesIO(begin + file.read(max(0, size - (4 - width))))


def _header(file: IO[bytes], largest: int) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    head = _head_bytes(file)
    try:
        version = npy.read_magic(head)
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, fortran, dtype = read(head)
    except Exception as fault:  # the header is read as Python text, so any fault of a parser may come
        raise MeasurementError(f"is no .npy array: {' '.join(str(fault).split())[:120]}") from None
    if dtype.hasobject:
        raise MeasurementError(_PICKLE)
    fields = [dtype] if dtype.names is None else [dtype[name] for name in dtype.names]
    if any(field.subdtype is not None or field.kind not in "fiubc" for field in fields):
        raise MeasurementError("holds no numbers of a kind that is read; real and complex numbers are")
    array_bytes(shape, np.dtype("u1"), largest // max(1, dtype.itemsize))
    return tuple(map(int, shape)), fortran, dtype


def _read(file: IO[bytes]) -> NDArray[Any]:
    """Read an array whose header was checked, as a stream: no descriptor may be doubled here."""
    try:
        return npy.read_array(SimpleNamespace(read=file.read), allow_pickle=False, max_header_size=MAX_HEADER)
    except ValueError as fault:
        raise MeasurementError(f"is cut off: {fault}; send the whole file again") from None


def _nodes(
    path: str, opened: Callable[[], AbstractContextManager[IO[bytes]]], largest: int
) -> Iterator[Node]:
    with opened() as file:
        try:
            shape, _, dtype = _header(file, largest)
        except MeasurementError as fault:
            yield Node.refused(path, str(fault))
            return

    def load(field: str | None = None) -> NDArray[Any]:
        with opened() as file:
            values = _read(file)
            # only at its end an archive compares the CRC-32 of a member
            if isinstance(file, zipfile.ZipExtFile) and file.read(1):
                raise MeasurementError("holds more than its header declares; the file is damaged")
        return values if field is None else values[field]

    if dtype.names is None:
        yield Node(path, shape, dtype.name, load=load)
    for name in dtype.names or ():
        yield Node(f"{path}/{name}", shape, dtype[name].name, load=partial(load, name))


@contextmanager
def _rewound(file: BinaryIO) -> Iterator[BinaryIO]:
    """Give a file that stays open, from its beginning."""
    file.seek(0)
    yield file


def walk_npy(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a .npy file: one array called "array", or the fields of a structured one below it."""
    nodes = list(_nodes("array", lambda: _rewound(file), largest))
    if nodes[0].fault:
        raise MeasurementError(nodes[0].fault)
    yield from nodes


def walk_npz(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a .npz archive: its arrays by their names."""
    try:
        archive = zipfile.ZipFile(file)
    except (zipfile.BadZipFile, OSError, ValueError) as fault:
        raise MeasurementError(f"is no .npz archive: {str(fault)[:120]}") from None
    for member in archive.infolist():
        if member.filename.endswith(".npy"):
            yield from _nodes(member.filename[:-4], partial(archive.open, member), largest)
