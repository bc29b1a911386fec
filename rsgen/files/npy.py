"""NumPy files, .npy and .npz, read by numpy without pickles."""

from __future__ import annotations

import io
from collections.abc import Iterator
from functools import partial
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy

from rsgen.common.errors import MeasurementError
from rsgen.files.tree import Node, array_bytes, open_archive


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


def _nodes(path: str, content: bytes, largest: int) -> Iterator[Node]:
    """Read an array: one node, or one for each field of a structured array.

    ``read_array`` is the part of ``numpy.load`` that takes no file for a pickle or an archive. It parses no
    header above 10 000 bytes, and memory for the array is limited in this process.
    """
    file = io.BytesIO(content)
    try:
        values = npy.read_array(file, allow_pickle=False)
    except Exception as fault:  # the header is read as Python text, so any fault of a parser may come
        raise MeasurementError(
            f"is no whole .npy array of numbers: {' '.join(str(fault).split())[:160]}"
        ) from None
    if file.read(1):
        raise MeasurementError("holds more than its header declares; the file is damaged")
    names = values.dtype.names
    for place, array in [(path, values)] if names is None else [(f"{path}/{n}", values[n]) for n in names]:
        array_bytes(array.shape, array.dtype, largest)
        yield Node(place, array.shape, array.dtype.name, load=partial(np.asarray, array))


def walk_npy(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a .npy file: one array called "array", or the fields of a structured one below it."""
    yield from _nodes("array", file.read(), largest)


def walk_npz(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a .npz archive: its arrays by their names."""
    with open_archive(file, largest) as archive:
        for member in archive.infolist():
            path, ending = member.filename[:-4], member.filename[-4:]
            if ending != ".npy":
                continue
            try:
                # read as a whole: only at its end an archive compares the CRC-32 of a member
                yield from _nodes(path, archive.read(member), largest)
            except Exception as fault:
                yield Node.refused(path, " ".join(str(fault).split())[:160])
