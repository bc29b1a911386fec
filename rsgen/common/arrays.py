"""Types of arrays in annotations, and read-only arrays."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.common.errors import RsgenError

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Chosen = NDArray[np.bool_] | NDArray[np.intp] | slice
"""Rows of a table: a slice takes them as they lie, without a copy."""


def unmasked(values: ArrayLike) -> ArrayLike:
    """Return a masked array with NaN where it is masked, anything else as it is."""
    if not hasattr(values, "filled"):
        return values
    masked: Any = values
    return cast("ArrayLike", masked.astype(np.result_type(masked.dtype, np.float64)).filled(np.nan))


def frozen_array(values: ArrayLike, dtype: type = np.float64) -> NDArray[Any]:
    """Copy into a read-only array."""
    array: NDArray[Any] = np.array(unmasked(values), dtype=dtype)
    array.flags.writeable = False
    return array


def freeze(record: object, names: tuple[str, ...], dtype: type = np.float64) -> None:
    """Make the named fields of a frozen dataclass read-only arrays, which must have one shape."""
    lengths = set()
    for name in names:
        array = frozen_array(getattr(record, name), dtype)
        object.__setattr__(record, name, array)
        lengths.add(array.shape)
    if len(lengths) > 1:
        raise RsgenError(f"{type(record).__name__}: {', '.join(names)} must have one shape, have {lengths}")


Rows = TypeVar("Rows")


def take_rows(table: Rows, chosen: Chosen, *others: str) -> Rows:
    """Return a dataclass with some rows of its arrays, but for those of the ``others`` that have none."""
    of_table: Any = table
    columns = {one.name: getattr(table, one.name) for one in fields(of_table) if one.name not in others}
    rows = {name: column[chosen] for name, column in columns.items() if isinstance(column, np.ndarray)}
    return cast(Rows, replace(of_table, **rows))


def true_runs(marks: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first places and the lengths of the runs of True in marks (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], marks.astype(np.int8), [0]))))
    return edges[::2], edges[1::2] - edges[::2]


def blocks(count: int, size: int) -> list[slice]:
    """Divide so many rows into blocks of at most ``size``; no rows are one empty block."""
    return [slice(first, first + size) for first in range(0, max(count, 1), size)]


def blocks_joined(
    count: int, found: Iterable[tuple[slice | Chosen, Any]], names: Sequence[str]
) -> dict[str, NDArray[Any]]:
    """Join what was found of each block of rows, and forget it at once: all blocks together fill the memory.

    Parameters
    ----------
    count
        Of all rows.
    found
        The rows of a block, and an object with their columns; a column that is None is left out.
    names
        Of the columns.
    """
    joined: dict[str, NDArray[Any]] = {}
    for rows, of_block in found:
        for name in names:
            column = getattr(of_block, name)
            if column is None:
                continue
            if len(column) == count:
                joined[name] = column
                continue
            if name not in joined:
                joined[name] = np.empty((count, *column.shape[1:]), column.dtype)
            joined[name][rows] = column
    return joined


def within_band(rows: Array, band: tuple[float, float]) -> Array:
    """Return the rows (k, c) of a line of points (n, c) whose first column is in a band, with its ends.

    Rows of NaN separate parts of the line.
    """
    parts = [rows[(rows[:, 0] >= band[0]) & (rows[:, 0] <= band[1])]]
    for end in band:
        beyond = rows[:, 0] - end
        at = np.flatnonzero(beyond[:-1] * beyond[1:] < 0)
        share = (beyond[at] / (beyond[at] - beyond[at + 1]))[:, None]
        parts.append((1 - share) * rows[at] + share * rows[at + 1])
    return np.concatenate(parts)
