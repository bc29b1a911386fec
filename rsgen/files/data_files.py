"""Data files on the disk: regular, not too large, and of which format; the formats that are read."""

from __future__ import annotations

import hashlib
import stat
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO

from rsgen.common.errors import MeasurementError, near_file, shown_path

MAX_TEXT_BYTES = 256 * 2**20

_LABVIEW = b"LabVIEW Measurement"
"""How LabVIEW's measurement files begin; those without a header are columns of text."""
_BOOK = (b"[Content_Types].xml", b"xl/", b"docProps/", b"_rels/")
"""Members of a workbook, one of which comes first in the archive."""


def _is_hdf5(head: bytes) -> bool:
    return b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:520]) or head.startswith(b"MATLAB 7.3 MAT-file")


def _is_matlab(head: bytes) -> bool:
    # MATLAB 7.3 writes HDF5 behind a head with the same mark
    marked = head.startswith(b"MATLAB 5.0 MAT-file") or head[126:128] in (b"IM", b"MI")
    return marked and not _is_hdf5(head)


def _is_archive(head: bytes, *, book: bool) -> bool:
    return head.startswith(b"PK\x03\x04") and head[30:].startswith(_BOOK) == book


def _is_universal(head: bytes) -> bool:
    first = head.lstrip().split(b"\n", 1)
    return len(first) == 2 and first[0].strip() == b"-1" and first[1].lstrip()[:1].isdigit()


def _is_labview(head: bytes) -> bool:
    # two bytes a sign, or none, before and between
    return head[:64].replace(b"\x00", b"").lstrip(b"\xff\xfe\xef\xbb\xbf").startswith(_LABVIEW)


def _is_sound(head: bytes) -> bool:
    return head[8:12] == b"WAVE" and head.startswith(b"RIFF")


@dataclass(frozen=True, slots=True)
class Format:
    """A format that is read in the confined process; columns of text, "csv", are what is none of these.

    Parameters
    ----------
    name
        What a case calls it; of a format that needs a package also the extra that brings the package.
    module, walk
        The module of ``rsgen.files`` and its function that reads such a file; only the confined process
        imports it. The function is called with the open file, the names at its root that are wanted (None
        for all), and the bytes of numbers that may be read.
    begins
        Whether a file is one, by its first 1024 bytes.
    endings
        Of names of files that are taken for it where nothing else is recognised.
    sample
        The function of the module that makes a small file: it is read before no file can be opened any more,
        so that everything is imported. "" where the reader imports nothing while it reads.
    package, plural
        The package that is needed, and what the files are called; "" where rsgen brings all.
    seconds, rate
        Time of work to read a file: ``seconds``, and one more for each ``rate`` bytes.
    """

    name: str
    module: str
    walk: str
    begins: Callable[[bytes], bool]
    endings: tuple[str, ...]
    sample: str = ""
    package: str = ""
    plural: str = ""
    seconds: float = 1.0
    rate: int = 20 * 2**20


# The rates of texts are a quarter of the 8 and 1.3 MB/s that good files reach; numbers that repeat pack
# better than others, so that a small workbook may have as many as 32 MB of them.
_ROWS = (
    Format("mat", "array_files", "walk_matlab", _is_matlab, (".mat",), sample="sample_matlab"),
    Format("hdf5", "hdf5", "walk_hdf5", _is_hdf5, (".h5", ".hdf5", ".hdf"), sample="sample_hdf5"),
    Format(
        "npy", "array_files", "walk_npy", lambda head: head.startswith(b"\x93NUMPY"), (".npy",), "sample_npy"
    ),
    Format("npz", "array_files", "walk_npz", partial(_is_archive, book=False), (".npz",), "sample_npz"),
    Format("uff", "uff", "walk_universal", _is_universal, (".uff", ".unv", ".uf", ".58")),
    Format("lvm", "labview", "walk_lvm", _is_labview, (), rate=2 * 2**20),
    Format(
        "tdms", "labview", "walk_tdms", lambda head: head.startswith(b"TDSm"), (".tdms",),
        sample="sample_tdms", package="nptdms", plural="TDMS files",
    ),
    Format(
        "xlsx", "xlsx", "walk_xlsx", partial(_is_archive, book=True), (".xlsx", ".xlsm"),
        sample="sample_xlsx", package="openpyxl", plural="Excel workbooks", seconds=8.0, rate=2**19,
    ),
    Format("wav", "array_files", "walk_wav", _is_sound, (".wav",)),
)  # fmt: skip
FORMATS = {row.name: row for row in _ROWS}
"""The formats by their names: what else has to know of one takes it from here."""

SURFACE_FILE = Format(
    "response surface", "surface_file", "walk_surface", _is_hdf5, (), sample="sample_surface"
)
"""Of ``rsgen.save_surface``: no format of a case, but read in the same process."""

_OTHERS = (
    (
        0,
        b"\xd0\xcf\x11\xe0",
        "an Excel workbook of .xls, or a protected one; save it as .xlsx without password",
    ),
    (0, b"TDSh", "the index of a TDMS file; the .tdms file of the same name is needed"),
    (0, b"\x1f\x8b", "a packed file; unpack it"),
    (0, b"7z\xbc\xaf", "a packed file; unpack it"),
    (0, b"RIFX", "a sound file with its bytes in the other order; save it as an ordinary .wav file"),
    (0, b"RF64", "a sound file of more than 4 GB; save a part of it as an ordinary .wav file"),
    (0, b"%PDF", "a PDF; text, MATLAB, HDF5, universal files and others of numbers are read"),
    (38, b"application/vnd.oasis", "an OpenDocument file; save its sheet as .xlsx or CSV"),
)
"""Other files that laboratories send: place of the signature, signature, what it is."""


def check_digest(file: IO[bytes], name: str, expected: str | None) -> None:
    """Refuse an open file whose SHA-256 is not the expected one, if one is expected; rewind it.

    Raises
    ------
    MeasurementError
        It is another one.
    """
    if expected is None:
        return
    # any IO[bytes] will do at run time; the stubs ask for a narrower protocol
    found = hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]
    if found != expected:
        raise MeasurementError(
            f"{name}: SHA-256 is {found}; the case expects {expected}: another file, or a changed one"
        )
    file.seek(0)


def open_regular(path: Path, most: int) -> IO[bytes]:
    """Open a regular file of at most ``most`` bytes.

    Raises
    ------
    MeasurementError
        Missing, no regular file, too large.
    """
    name = shown_path(path)
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
        if "*" in name:
            reason = "one file, without a wildcard, is read at a time; a case lists several: file = [...]"
        raise MeasurementError(
            f"{name}: cannot be read: {reason}; files of a case lie in its folder, --data or RSGEN_DATA"
            f"{near_file(path)}"
        ) from fault


def recognise_format(path: Path) -> str:
    """Recognise the format of a data file by how it begins, then by its ending.

    Returns
    -------
    A name in ``FORMATS``, or "csv" for everything else: columns of text.

    Raises
    ------
    MeasurementError
        Missing, no regular file, or of another format that is known and not read.
    """
    with open_regular(path, sys.maxsize) as file:
        head = file.read(1024)
    for place, sign, kind in _OTHERS:
        if head[place:].startswith(sign):
            raise MeasurementError(f"{shown_path(path)}: is {kind}")
    ending = path.suffix.lower()
    by_head = (row.name for row in FORMATS.values() if row.begins(head))
    by_ending = (row.name for row in FORMATS.values() if ending in row.endings)
    return next(by_head, None) or next(by_ending, "csv")
