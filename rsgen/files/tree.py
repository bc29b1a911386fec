"""Trees of named arrays of numbers, to which readers of all formats lead, and addresses in them."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rsgen.common.errors import MeasurementError, quote, suggest
from rsgen.files.signals import star_pattern

if TYPE_CHECKING:
    from rsgen.files.plan import Layout

LARGEST_BYTES = 2**30
"""Bytes of a binary file, and of numbers that are taken from any file, at most."""
MAX_NODES = 50_000
"""Arrays that are listed of one file, at most."""
MAX_CHANNELS = 10_000
"""Channels of one file or address, segments of them and references to them, at most: no test has as many."""
MAX_DEPTH = 12
"""Levels of groups, structs and cells in each other, at most."""
_SMALL_BYTES = 32 * 2**20
_EXPANSION = 20
"""A file may unpack to this multiple of its size: measurements hardly compress, bombs do a thousandfold."""
TEXT = "text"
"""Kind of a node that holds a text; its remark is the text."""
SHOWN_CHARACTERS = 60
"""Characters shown of a fault or a remark in a line, and of a text in ten."""
_KINDS = "fiubc"
VALUES_SHOWN = 4
"""Values shown of each array."""


@dataclass(frozen=True, slots=True)
class _Array:
    """Description of an array in a file, as in ``Node``."""

    path: str
    shape: tuple[int, ...] = ()
    dtype: str = ""
    unit: str = ""
    unit_source: str = ""
    remark: str = ""
    fault: str = ""
    title: str = ""
    scale: str = ""


def _unread() -> NDArray[Any]:
    raise MeasurementError("was not asked for")


@dataclass(frozen=True, slots=True, eq=False)
class Node(_Array):
    """An array in a file that is open, seen by the process that reads it; read when it is asked for.

    Parameters
    ----------
    path
        Names from the root, with / between.
    shape, dtype
        As the file declares them; ``dtype`` is "" or TEXT where it is no array of numbers.
    unit, remark
        What the file says about it.
    unit_source
        Where the unit comes from, or why it is not known; "" where the format has one place for it.
    fault
        Why it cannot be read; "" where it can.
    title
        What the file calls a column; "" where the path says it.
    scale
        "rms", "peak" or "half-peak" where the file says what its amplitudes are; "" elsewhere.
    load
        Reads the numbers, once sizes are checked.
    column
        The number by which a table's column goes as well, from 1; 0 where there is none.
    row
        The row of the file, from 1, in which its first number stands.
    """

    load: Callable[[], NDArray[Any]] = _unread
    column: int = 0
    row: int = 1

    @classmethod
    def text(cls, path: str, content: str, shape: tuple[int, ...] = ()) -> Node:
        """Make a node of a short text, such as a unit, which is shown and not read."""
        return cls(
            path=path,
            shape=shape,
            dtype=TEXT,
            remark=content[: 10 * SHOWN_CHARACTERS],
            fault="is a text; numbers are needed",
        )

    @classmethod
    def refused(cls, path: str, reason: str, shape: tuple[int, ...] = ()) -> Node:
        """Make a node that cannot be read."""
        return cls(path=path, shape=shape, fault=reason)


@dataclass(frozen=True, slots=True)
class Entry(_Array):
    """An array in a file, described: path, shape, kind of number, unit, first values.

    Parameters
    ----------
    path, shape, dtype, unit, remark, fault, unit_source, title, scale
        As in ``Node``.
    first
        The first values, as text.
    low, high
        Smallest and largest value, None where unknown or complex.
    """

    first: tuple[str, ...] = ()
    low: float | None = None
    high: float | None = None

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return prod(self.shape)


@dataclass(frozen=True, slots=True)
class Contents:
    """The contents of a data file.

    Parameters
    ----------
    file, format
        The file, and the format it was recognised as.
    entries
        Its arrays, in their order.
    layout
        How a text is laid out; None for other formats.
    remark
        What a reader of the file passes over; "" where nothing is.
    """

    file: Path
    format: str
    entries: tuple[Entry, ...]
    layout: Layout | None = None
    remark: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class StoredArray:
    """An array that was read.

    Parameters
    ----------
    path
        Where it was found; with wildcards there are several.
    values
        Real or complex numbers, of any shape.
    unit, unit_source, scale, row
        As in ``Node``.
    """

    path: str
    values: NDArray[Any]
    unit: str = ""
    unit_source: str = ""
    scale: str = ""
    row: int = 1


def is_wanted(name: str, heads: set[str] | None) -> bool:
    """Return True if a name at the root of a file is wanted: all are for None or if an address has a *."""
    return heads is None or name in heads or "*" in "".join(heads)


def largest_bytes(size: int) -> int:
    """Limit the bytes of numbers that a file of ``size`` bytes may unpack to."""
    return min(LARGEST_BYTES, max(_SMALL_BYTES, _EXPANSION * size))


def array_bytes(shape: tuple[int, ...], dtype: np.dtype[Any], largest: int) -> int:
    """Check the declared size of an array before anything is read.

    Returns
    -------
    Its bytes.

    Raises
    ------
    MeasurementError
        A length is negative, it is too large, or holds no numbers; the message has no place yet.
    """
    if dtype.kind not in _KINDS or dtype.itemsize > 16:
        raise MeasurementError("holds no numbers of a kind that is read; real and complex numbers are")
    if any(length < 0 for length in shape):
        raise MeasurementError(f"declares a length of {min(shape)}; 0 or more is allowed")
    size = prod(shape) * dtype.itemsize
    if size > largest:
        raise MeasurementError(f"declares {size} bytes; at most {largest} are read from a file of this size")
    return size


def open_archive(file: BinaryIO, largest: int) -> zipfile.ZipFile:
    """Open an archive that unpacks to at most ``largest`` bytes; no member unpacks to more than it declares.

    Raises
    ------
    MeasurementError
        No archive, or too large.
    """
    try:
        archive = zipfile.ZipFile(file)
    except (zipfile.BadZipFile, OSError, ValueError) as fault:
        raise MeasurementError(f"is no whole archive: {str(fault)[:120]}; send it again") from None
    size = sum(member.file_size for member in archive.infolist())
    if size > largest:
        raise MeasurementError(
            f"unpacks to {size} bytes; at most {largest} are read from a file of this size"
        )
    return archive


def facts(values: NDArray[Any]) -> dict[str, Any]:
    """Return the facts of ``Entry``: first values and range."""
    flat = values.ravel()
    known: dict[str, Any] = {"first": tuple(f"{value:.6g}" for value in flat[:VALUES_SHOWN])}
    if not flat.size or flat.dtype.kind not in "fiu":
        return known
    finite = np.isfinite(flat)
    if not finite.all():
        # rows with gaps are left out when the file is read
        known["remark"] = f"{int((~finite).sum())} of {len(flat)} are not finite"
        flat = flat[finite]
        if not flat.size:
            return known
    return known | {"low": float(flat.min()), "high": float(flat.max())}


def describe(node: Node) -> Entry:
    """Describe an array; what cannot be read is described by its fault."""
    known: dict[str, Any] = {field.name: getattr(node, field.name) for field in fields(_Array)}
    if node.dtype and not node.fault:
        try:
            known |= facts(node.load())
        except MeasurementError as fault:
            known["fault"] = str(fault)
    return Entry(**known)


# ----------------------------------------------------------------------------
# Where in the tree a channel is: "forced_data/drive_1/freq", "Acceleration[3]", "runs/*/x".

_INDEX = re.compile(r"(?P<path>.+?)\[(?:(?P<one>\d{1,9})|(?P<row>\d{1,9}),:|:,(?P<column>\d{1,9}))\]\Z")
_NUMBERS = re.compile(r"(\d{1,30}(?:[.p]\d{1,30})?)")
"""In a path: 10, and 0.5 or 0p5, which stands for it where a name has no point."""


def natural_order(path: str) -> list[tuple[int, float | str]]:
    """Order drive_2 before drive_10, and run_0p05g before run_0p1g."""
    return [
        (0, float(part.replace("p", "."))) if part[0].isdecimal() else (1, part)
        for part in _NUMBERS.split(path)
        if part
    ]


def _only_matrix(nodes: Sequence[Node], number: int) -> str:
    columns = [node.path for node in nodes if node.column == number]
    if len(columns) == 1:
        return columns[0]
    matrices = [node for node in nodes if len(node.shape) == 2 and not node.fault]
    if len(matrices) == 1:
        return f"{matrices[0].path}[:,{number}]"
    raise MeasurementError(
        f"column {number}: a number alone is for tables; name one of {_known(nodes)} (see rsgen inspect)"
    )


def _known(nodes: Sequence[Node]) -> str:
    paths = [quote(node.path) for node in nodes if node.dtype and not node.fault]
    return (", ".join(paths[:8]) + (", ..." if len(paths) > 8 else "")) or "nothing: no numbers in the file"


def find(nodes: Sequence[Node], wanted: int | str) -> tuple[list[Node], str | None]:
    """Find the arrays that an address means, and the index in brackets.

    Parameters
    ----------
    nodes
        All arrays of the file.
    wanted
        A path, with * for any name at its place and an index in brackets behind; a number is a column of the
        file's only table or matrix.

    Raises
    ------
    MeasurementError
        There is none, or more than 10 000, or one that cannot be read; the message has no place yet.
    """
    text = _only_matrix(nodes, wanted) if isinstance(wanted, int) else wanted
    by_path = {node.path: node for node in nodes}
    index = None
    if text not in by_path and (match := _INDEX.match(text)):
        text, index = match["path"], text[len(match["path"]) :]
    if text in by_path:
        found = [by_path[text]]
    elif "*" in text:
        pattern = star_pattern(text)
        matching = (node for node in nodes if pattern.fullmatch(node.path))
        found = sorted(matching, key=lambda node: natural_order(node.path))
        if len(found) > MAX_CHANNELS:
            raise MeasurementError(
                f"{quote(text)} means {len(found)} arrays; at most {MAX_CHANNELS} are read"
            )
    else:
        found = []
    if not found:
        hint = f"{suggest(text, list(by_path))}known: {_known(nodes)} (see rsgen inspect)"
        raise MeasurementError(f"nothing is called {quote(text)}; {hint}")
    for node in found:
        if node.fault:
            raise MeasurementError(f"{quote(node.path)}: {node.fault}")
    return found, index


def select(values: NDArray[Any], index: str | None, path: str) -> NDArray[Any]:
    """Take one channel out of a matrix.

    ``[3]`` is the third channel, counted along the shorter side; ``[3,:]`` a row and ``[:,3]`` a column.

    Raises
    ------
    MeasurementError
        No such channel, no matrix, or a square one where the side is not given.

    Examples
    --------
    >>> import numpy as np
    >>> select(np.arange(6).reshape(2, 3), "[2]", "a").tolist()
    [3, 4, 5]
    """
    if index is None:
        return values
    match = _INDEX.match(f"a{index}")
    matrix = values.squeeze() if values.ndim > 2 else values
    if match is None or matrix.ndim != 2:
        raise MeasurementError(f"{quote(path)}: shape {values.shape}; an index in brackets needs a matrix")
    if match["one"] and matrix.shape[0] == matrix.shape[1]:
        raise MeasurementError(
            f"{quote(path)}: shape {matrix.shape} is square; write [k,:] for a row, [:,k] for a column"
        )
    axis = 0 if match["row"] else 1 if match["column"] else int(np.argmin(matrix.shape))
    number = int(match["one"] or match["row"] or match["column"])
    if not 1 <= number <= matrix.shape[axis]:
        raise MeasurementError(f"{quote(path)}: no channel {number}; there are {matrix.shape[axis]}")
    channel: NDArray[Any] = np.take(matrix, number - 1, axis=axis)
    return channel
