"""Linear least squares whose columns are scaled, as parameters differ in size; B-splines as columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from rsgen.common.arrays import Array, blocks
from rsgen.common.tolerances import ROUND_OFF

NULL_TOLERANCE = 1e-9
"""Singular values below this, relative to the largest after column scaling, count as zero."""

_ROWS_PER_BLOCK = 4096
"""Of a matrix that are made triangular at once: they stay in the processor's cache, and no copy of all the
others is needed."""


def solve_scaled(
    matrix: Array, right: Array, *sizes: Array | float, known: Array | float = np.nan
) -> tuple[Array, Array, Array]:
    """Least squares with scaled columns.

    Parameters
    ----------
    matrix, right
        (r, q) and (r,).
    *sizes
        (q,) each, such as the present sizes of the unknowns: one whose whole effect at any of them is
        round-off is not identifiable.
    known
        (q,) values of the unknowns that are known, NaN of the others: nothing is solved for them, and their
        rows of the second result are zero.

    Returns
    -------
    solution
        (q,), of smallest scaled norm where the matrix does not tell.
    inverse
        (q, r) with inverse @ inverse.T the inverse of matrix.T @ matrix outside its null space.
    null
        (q, d) directions, in scaled parameters: its null vectors.
    """
    free = np.isnan(np.broadcast_to(known, matrix.shape[1:]))
    if free.all():
        return _solve_free(matrix, right, sizes)
    values = np.where(free, 0.0, known)
    parts = _solve_free(
        matrix[:, free],
        right - matrix[:, ~free] @ values[~free],
        [np.broadcast_to(size, free.shape)[free] for size in sizes],
    )
    solution, inverse, null = (np.zeros((len(free), *part.shape[1:])) for part in parts)
    for whole, part in zip((solution, inverse, null), parts, strict=True):
        whole[free] = part
    return values + solution, inverse, null


def _solve_free(matrix: Array, right: Array, sizes: Sequence[Array | float]) -> tuple[Array, Array, Array]:
    """Solve for all unknowns."""
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
    square = triangle[:count, :count]
    if len(triangle) > count and np.all(np.diagonal(square)):
        with np.errstate(all="ignore"):
            inverse = np.linalg.inv(square)
            # norms of Frobenius: no singular value is as small, relative to the largest
            regular = np.linalg.norm(inverse) * np.linalg.norm(square) < 1 / NULL_TOLERANCE
        if regular:
            return (inverse @ triangle[:count, count]) / scale, inverse / scale[:, None], np.zeros((count, 0))
    parts = np.linalg.svd(triangle[:, :count], full_matrices=False)
    left, singular, across = (np.asarray(part) for part in parts)
    told = singular > NULL_TOLERANCE * np.max(singular, initial=1e-300)
    solution = across[told].T @ ((left[:, told].T @ triangle[:, count]) / singular[told]) / scale
    return solution, (across[told].T / singular[told]) / scale[:, None], across[~told].T


def _triangle(matrix: Array, scale: Array, right: Array) -> Array:
    """Upper triangle R of Q R = (matrix / scale, right): of blocks of rows, then of their triangles."""
    parts = [
        np.linalg.qr(np.column_stack([matrix[block] / scale, right[block]]), mode="r")
        for block in blocks(len(right), _ROWS_PER_BLOCK)
    ]
    return np.asarray(parts[0] if len(parts) == 1 else np.linalg.qr(np.concatenate(parts), mode="r"))


# ----------------------------------------------------------------------------
# B-splines over knots: a smooth curve is a sum of them.


def b_splines(at: Array, knots: Array, degree: int) -> tuple[Array, Array]:
    """Evaluate every B-spline and its slope.

    Parameters
    ----------
    at
        (n,) places between the ends of the knots; at an inner knot the interval to the right counts.
    knots
        (f + degree + 1,) ascending, the ends repeated so that the splines sum to one everywhere between them.
    degree
        Of the polynomials, at least 0.

    Returns
    -------
    tuple of arrays
        (n, f) values [1], and slopes [1 / unit of ``at``].
    """
    splines = scipy.interpolate.BSpline(knots, np.eye(len(knots) - degree - 1), degree)
    return splines(at), splines(at, nu=1)
