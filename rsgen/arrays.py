"""Names for arrays of numbers in annotations, and arrays that nobody can change."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Array", "Chosen", "ComplexArray", "blocks", "frozen_array"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Chosen = NDArray[np.bool_] | NDArray[np.intp] | slice
"""Rows of a table: a slice takes them as they lie, without a copy."""


def frozen_array(values: ArrayLike, dtype: type = np.float64) -> NDArray[Any]:
    """Copy into an array that nobody can change."""
    array: NDArray[Any] = np.array(values, dtype=dtype)
    array.flags.writeable = False
    return array


def blocks(count: int, size: int) -> list[slice]:
    """Divide so many rows into blocks of at most ``size``; no rows are one empty block."""
    return [slice(first, first + size) for first in range(0, max(count, 1), size)]
