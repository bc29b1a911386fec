"""The bias that noise brings through the curvature in the nuisances of every point, and its removal.

Noise moves the nuisances of a point; where the prediction is curved in them, it changes the prediction on
average by half the second derivative times their variance, and the parameters follow (Box, Bias in nonlinear
estimation, J. R. Stat. Soc. B 33 (1971) 171: -1/2 (J'J)^-1 J' tr(C H)). The curvature in the parameters adds
terms that are smaller by the number of points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.least_squares import Linearisation, Regression, eliminate, solve_scaled

__all__ = ["remove_bias"]

Array = NDArray[np.float64]


def remove_bias(found: Regression, line: Linearisation, curvature: Callable[[], Array]) -> Regression:
    """Correct the parameters for the square of the noise.

    Parameters
    ----------
    found, line
        A fit, and the linearisation at its end.
    curvature
        Gives (n, M, k) second derivatives of the prediction by each nuisance; mixed ones vanish.
    """
    normal = np.einsum("nma,nmb->nab", line.by_nuisance, line.by_nuisance)
    regular = found.used & (np.linalg.det(np.nan_to_num(normal)) > 0)
    variance = np.zeros(normal.shape[:2])
    inverse = np.linalg.inv(normal[regular])
    variance[regular] = np.diagonal(inverse, axis1=1, axis2=2) * found.noise**2
    shift = 0.5 * np.einsum("nmk,nk->nm", curvature(), variance)
    regular &= np.isfinite(shift).all(axis=1)
    residual, matrix = eliminate(replace(line, residual=shift))
    count = matrix.shape[2]
    change, _, _ = solve_scaled(
        matrix[regular].reshape(residual[regular].size, count),
        residual[regular].reshape(-1),
        found.parameters,
    )
    return replace(found, parameters=found.parameters + change)
