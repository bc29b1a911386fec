"""Linear least squares with scaled columns, because parameters differ by many orders of magnitude."""

from __future__ import annotations

import numpy as np

from rsgen.common.arrays import Array, blocks
from rsgen.common.tolerances import ROUND_OFF

__all__ = ["solve_scaled"]

_NULL = 1e-9
"""Singular values below this, relative to the largest after column scaling, count as zero."""

_ROWS = 4096
"""Of a matrix that are made triangular at once: they stay in the processor's cache, and no copy of all the
others is needed."""


def solve_scaled(matrix: Array, right: Array, *sizes: Array | float) -> tuple[Array, Array, Array]:
    """Least squares with scaled columns.

    Parameters
    ----------
    matrix, right
        (r, q) and (r,).
    *sizes
        (q,) each, such as the present sizes of the unknowns: one whose whole effect at any of them is
        round-off is not identifiable.

    Returns
    -------
    solution
        (q,), of smallest scaled norm where the matrix does not tell.
    inverse
        (q, r) with inverse @ inverse.T the inverse of matrix.T @ matrix outside its null space.
    null
        (q, d) directions, in scaled parameters: its null vectors.
    """
    count = matrix.shape[1]
    if not np.isfinite(matrix).all():
        # as where the mass is not known: nothing is known then, and the decomposition would not end
        return np.full(count, np.nan), np.full((count, count), np.nan), np.zeros((count, 0))
    norm = np.sqrt(np.einsum("rq,rq->q", matrix, matrix))
    for size in sizes if count else ():
        effect = norm * np.abs(size)
        lost = (effect > 0) & (effect < ROUND_OFF * effect.max())
        if lost.any():
            matrix, norm = np.where(lost, 0.0, matrix), np.where(lost, 0.0, norm)
    scale = np.where(norm > 0, norm, 1.0)
    triangle = _triangle(matrix, scale, right)
    parts = np.linalg.svd(triangle[:, :count], full_matrices=False)
    left, singular, across = (np.asarray(part) for part in parts)
    regular = singular > _NULL * np.max(singular, initial=1e-300)
    solution = across[regular].T @ ((left[:, regular].T @ triangle[:, count]) / singular[regular]) / scale
    inverse = (across[regular].T / singular[regular]) / scale[:, None]
    return solution, inverse, across[~regular].T


def _triangle(matrix: Array, scale: Array, right: Array) -> Array:
    """Upper triangle R of Q R = (matrix / scale, right): of blocks of rows, then of their triangles."""
    parts = [
        np.linalg.qr(np.column_stack([matrix[block] / scale, right[block]]), mode="r")
        for block in blocks(len(right), _ROWS)
    ]
    return np.asarray(parts[0] if len(parts) == 1 else np.linalg.qr(np.concatenate(parts), mode="r"))
