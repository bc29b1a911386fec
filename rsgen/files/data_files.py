"""Data files on the disk: regular, not too large, and of which format."""

from __future__ import annotations

import hashlib
import io
import stat
import sys
from pathlib import Path
from typing import IO

from rsgen.common.errors import MeasurementError

__all__ = [
    "MAX_TEXT_BYTES",
    "Rewritten",
    "check_digest",
    "file_label",
    "open_regular",
    "open_text",
    "recognise_format",
]

MAX_TEXT_BYTES = 256 * 2**20
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
"""How a text of two bytes a sign begins."""
_MAX_UTF_16_BYTES = 64 * 2**20
"""Larger texts of two bytes a sign are refused: they are held in memory as a whole."""

_LABVIEW = b"LabVIEW Measurement"
"""How LabVIEW's measurement files begin; those without a header are columns of text."""
_BOOK = (b"[Content_Types].xml", b"xl/", b"docProps/", b"_rels/")
"""Members of a workbook, one of which comes first in the archive."""
_SUFFIXES = {
    ".mat": "mat", ".h5": "hdf5", ".hdf5": "hdf5", ".hdf": "hdf5", ".npy": "npy", ".npz": "npz",
    ".uff": "uff", ".unv": "uff", ".uf": "uff", ".58": "uff", ".tdms": "tdms", ".wav": "wav",
    ".xlsx": "xlsx", ".xlsm": "xlsx",
}  # fmt: skip


_OTHERS = (
    (
        0,
        b"\xd0\xcf\x11\xe0",
        "an Excel workbook of .xls, or a protected one; save it as .xlsx without password",
    ),
    (0, b"TDSh", "the index of a TDMS file; the .tdms file beside it is needed"),
    (0, b"\x1f\x8b", "a packed file; unpack it"),
    (0, b"7z\xbc\xaf", "a packed file; unpack it"),
    (0, b"%PDF", "a PDF; text, MATLAB, HDF5, universal files and others of numbers are read"),
    (38, b"application/vnd.oasis", "an OpenDocument file; save its sheet as .xlsx or CSV"),
)
"""Other files that laboratories send: place of the signature, signature, what it is."""


def file_label(path: Path) -> str:
    """Name a file in messages."""
    return path.name if path.name.isprintable() else repr(path.name)


def check_digest(name: str, found: str, expected: str) -> None:
    """Refuse a file whose SHA-256 is not the expected one.

    Raises
    ------
    MeasurementError
        It is another one.
    """
    if found != expected:
        raise MeasurementError(
            f"{name}: SHA-256 is {found}; the case expects {expected}: another file, or a changed one"
        )


def open_regular(path: Path, most: int) -> IO[bytes]:
    """Open a regular file of at most ``most`` bytes.

    Raises
    ------
    MeasurementError
        Missing, no regular file, too large.
    """
    name = file_label(path)
    try:
        # looked at before opening: opening a pipe would wait for ever
        if not stat.S_ISREG(path.stat().st_mode):
            raise MeasurementError(f"{name}: is no regular file; a data file is needed")
        size = path.stat().st_size
        if size > most:
            raise MeasurementError(f"{name}: {size} bytes; at most {most} are read")
        return path.open("rb")
    except (OSError, ValueError) as fault:
        reason = fault.strerror if isinstance(fault, OSError) and fault.strerror else str(fault)
        raise MeasurementError(
            f"{name}: cannot be read: {reason}; it is looked for in the case's folder and in RSGEN_DATA"
        ) from fault


def recognise_format(path: Path) -> str:
    """Recognise the format of a data file by how it begins, then by its ending.

    Returns
    -------
    "mat", "hdf5", "npy", "npz", "uff", "lvm", "tdms", "xlsx", "wav", or "csv" for everything else: columns
    of text.

    Raises
    ------
    MeasurementError
        Missing or no regular file.
    """
    with open_regular(path, sys.maxsize) as file:
        head = file.read(1024)
    if b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:520]) or head.startswith(b"MATLAB 7.3 MAT-file"):
        return "hdf5"
    if head.startswith(b"MATLAB 5.0 MAT-file") or head[126:128] in (b"IM", b"MI"):
        return "mat"
    if head.startswith(b"\x93NUMPY"):
        return "npy"
    if head[8:12] == b"WAVE" and head[:4] in (b"RIFF", b"RIFX", b"RF64"):
        return "wav"
    if head.startswith(b"TDSm"):
        return "tdms"
    # two bytes a sign, or none, before and between
    if head[:64].replace(b"\x00", b"").lstrip(b"\xff\xfe\xef\xbb\xbf").startswith(_LABVIEW):
        return "lvm"
    for place, sign, kind in _OTHERS:
        if head[place:].startswith(sign):
            raise MeasurementError(f"{file_label(path)}: is {kind}")
    if head.startswith(b"PK\x03\x04"):
        return "xlsx" if head[30:].startswith(_BOOK) else "npz"
    first = head.lstrip().split(b"\n", 1)
    if len(first) == 2 and first[0].strip() == b"-1" and first[1].lstrip()[:1].isdigit():
        return "uff"
    return _SUFFIXES.get(path.suffix.lower(), "csv")


class Rewritten(io.BytesIO):
    """A text that came in two bytes a sign, as UTF-8; its bytes are hashed already."""


def open_text(path: Path, digest: hashlib._Hash) -> IO[bytes]:
    """Open a text; one of two bytes a sign (UTF-16 with its mark) is hashed and given as UTF-8.

    Raises
    ------
    MeasurementError
        Missing, no regular file, too large, or no legal UTF-16.
    """
    name = file_label(path)
    file = open_regular(path, MAX_TEXT_BYTES)
    try:
        if not file.read(2).startswith(_UTF_16):
            file.seek(0)
            return file
        file.seek(0)
        raw = file.read(_MAX_UTF_16_BYTES + 1)
    except OSError as fault:
        file.close()
        raise MeasurementError(f"{name}: cannot be read: {fault.strerror}; try again") from fault
    file.close()
    if len(raw) > _MAX_UTF_16_BYTES:
        raise MeasurementError(
            f"{name}: more than {_MAX_UTF_16_BYTES} bytes of UTF-16; save the file as UTF-8"
        )
    digest.update(raw)
    try:
        return Rewritten(raw.decode("utf-16").encode("utf-8"))
    except UnicodeError as fault:
        raise MeasurementError(f"{name}: line 1: is no legal UTF-16; save the file as UTF-8") from fault
