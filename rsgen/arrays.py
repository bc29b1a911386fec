"""Names for arrays of numbers in annotations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "ComplexArray"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
