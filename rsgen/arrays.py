"""Names for arrays of numbers in annotations, and arrays that nobody can change."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Array", "ComplexArray", "frozen_array"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def frozen_array(values: ArrayLike, dtype: type = np.float64) -> NDArray[Any]:
    """Copy into an array that nobody can change."""
    array: NDArray[Any] = np.array(values, dtype=dtype)
    array.flags.writeable = False
    return array
