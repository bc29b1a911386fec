"""Where in a file's tree a channel is: "forced_data/drive_1/freq", "Acceleration[3]", "runs/*/x"."""

from __future__ import annotations

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.errors import MeasurementError, quote
from rsgen.files.tree import Node

__all__ = ["find", "natural_order", "select"]

MOST = 10_000
_INDEX = re.compile(r"(?P<path>.+?)\[(?:(?P<one>\d{1,9})|(?P<row>\d{1,9}),:|:,(?P<column>\d{1,9}))\]\Z")
_DIGITS = re.compile(r"(\d+)")


def natural_order(path: str) -> list[tuple[int, int | str]]:
    """Order drive_2 before drive_10."""
    return [(0, int(part)) if part.isdigit() else (1, part) for part in _DIGITS.split(path) if part]


def _matches(path: str, pattern: str) -> bool:
    names, wanted = path.split("/"), pattern.split("/")
    return len(names) == len(wanted) and all(map(fnmatchcase, names, wanted))


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
        # names with ? or [ stand for themselves, so * is the only sign with a meaning
        pattern = re.sub(r"[?\[]", lambda sign: f"[{sign[0]}]", text)
        found = sorted(
            (node for node in nodes if _matches(node.path, pattern)),
            key=lambda node: natural_order(node.path),
        )
        if len(found) > MOST:
            raise MeasurementError(f"{quote(text)} means {len(found)} arrays; at most {MOST} are read")
    else:
        found = []
    if not found:
        raise MeasurementError(f"nothing is called {quote(text)}; known: {_known(nodes)} (see rsgen inspect)")
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
