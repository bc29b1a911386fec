"""MATLAB files up to version 7: variables, structs and cells as a tree of arrays."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np
import scipy.io
from numpy.typing import NDArray
from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

from rsgen.common.errors import MeasurementError
from rsgen.files.tree import MAX_DEPTH, Node, array_bytes, is_wanted

_MAX_TEXTS_SHOWN = 12
"""Texts shown of a list."""
_WIDTHS = {
    "double": "f8", "single": "f4", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "logical": "u1",
}  # fmt: skip
_NOT_READ = "is no array of numbers; structs, cells and numbers are read, nothing else"


def sample_matlab() -> bytes:
    """Make a small file."""
    numbers = np.arange(3.0)
    file: Any = io.BytesIO()
    tree = {"a": {"b": numbers, "c": np.array([1, "x"], dtype=object)}, "d": 1j * numbers}
    scipy.io.savemat(file, tree, do_compression=True)
    made: bytes = file.getvalue()
    return made


def _children(value: NDArray[Any], path: str) -> Iterator[tuple[str, Any]]:
    """Return path and value of each member of a struct or cell; struct arrays are numbered from 1."""
    flat = value.ravel(order="F")
    for number, element in enumerate(flat, start=1):
        base = path if len(flat) == 1 and value.dtype.names else f"{path}/{number}"
        if value.dtype.names:
            for name in value.dtype.names:
                yield f"{base}/{name}", element[name]
        else:
            yield base, element


def _is_text(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "US"


def _walk(value: Any, path: str, depth: int) -> Iterator[Node]:
    known = isinstance(value, np.ndarray)
    if not known or isinstance(value, MatlabObject | MatlabOpaque | MatlabFunction):
        yield Node.refused(path, _NOT_READ)
    elif value.dtype.names or value.dtype == object:
        if depth >= MAX_DEPTH:
            yield Node.refused(path, f"is nested more than {MAX_DEPTH} deep", value.shape)
            return
        if not value.dtype.names and value.size and all(_is_text(member) for member in value.flat):
            texts = [str(member.ravel()[0]) if member.size else "" for member in value.ravel(order="F")]
            yield Node.text(path, ", ".join(texts[:_MAX_TEXTS_SHOWN]), value.shape)
            return
        for inner, child in _children(value, path):
            yield from _walk(child, inner, depth + 1)
    elif value.dtype.kind in "US":
        first = str(value.ravel()[0]) if value.size else ""
        yield Node.text(path, first, value.shape)
    elif value.dtype.kind in "fiubc":
        yield Node(path, value.shape, value.dtype.name, load=lambda: value)
    else:
        yield Node.refused(path, _NOT_READ, value.shape)


def _check_sizes(
    file: BinaryIO, heads: set[str] | None, largest: int
) -> tuple[list[str], list[tuple[str, tuple[int, ...]]]]:
    """Check the sizes of the wanted variables; return their names, and name and shape of the others."""
    wanted = []
    others = []
    opened: Any = file
    for name, shape, kind in scipy.io.whosmat(opened):
        if name.startswith("__"):
            # MATLAB's names
            continue
        if not is_wanted(name, heads):
            others.append((name, tuple(map(int, shape))))
            continue
        try:
            array_bytes(tuple(map(int, shape)), np.dtype(_WIDTHS.get(kind, "f8")), largest)
        except MeasurementError as fault:
            raise MeasurementError(f"variable {name[:60]!r} {fault}") from None
        wanted.append(name)
    file.seek(0)
    return wanted, others


def walk_matlab(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through the variables of a MAT file of version 4 to 7.

    Parameters
    ----------
    file
        The open file.
    heads
        Variables that are wanted; None for all.
    largest
        Bytes of numbers that may be read.

    Raises
    ------
    MeasurementError
        No MAT file, damaged, or a declared size is too large.
    """
    names, others = _check_sizes(file, heads, largest)
    opened: Any = file
    loaded = scipy.io.loadmat(opened, variable_names=names, chars_as_strings=True, struct_as_record=True)
    # in the order of the file
    for name in names:
        yield from _walk(loaded.pop(name, None), name, 0)
    for name, shape in others:
        yield Node(name, shape, "unread")
