"""Linear least squares, B-splines, and Newton's method on many problems at once.

Parameters differ in size, so columns of least squares are scaled to norm one. In Newton's method each of n
problems seeks u with r(u) = 0 by u <- u - s J(u)^-1 r(u), s = 1, 1/2, 1/4, ... until |r| does not grow: the
direction of Newton's step always lowers |r| at first (Nocedal and Wright, Numerical Optimization, 2006,
Sec. 11.2). What is solved for, and how the linear equations of a step are solved (dense and in a batch, or by
an iterative method for one large problem), is up to the ``Equations``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, blocks
from rsgen.common.tolerances import MAX_NEWTON_STEPS, MAX_STEP_HALVINGS, MIN_NULL_COMPONENT, ROUND_OFF

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
    # fewer rows than unknowns have null vectors beyond those of the singular values
    parts = np.linalg.svd(triangle[:, :count], full_matrices=len(triangle) < count)
    left, singular, across = (np.asarray(part) for part in parts)
    rank = int(np.count_nonzero(singular > NULL_TOLERANCE * np.max(singular, initial=1e-300)))
    told, singular = across[:rank], singular[:rank]
    solution = told.T @ ((left[:, :rank].T @ triangle[:, count]) / singular) / scale
    return solution, (told.T / singular) / scale[:, None], across[rank:].T


def _triangle(matrix: Array, scale: Array, right: Array) -> Array:
    """Upper triangle R of Q R = (matrix / scale, right): of blocks of rows, then of their triangles."""
    parts = [
        np.linalg.qr(np.column_stack([matrix[block] / scale, right[block]]), mode="r")
        for block in blocks(len(right), _ROWS_PER_BLOCK)
    ]
    return np.asarray(parts[0] if len(parts) == 1 else np.linalg.qr(np.concatenate(parts), mode="r"))


# ----------------------------------------------------------------------------
# B-splines over knots: a smooth curve is a sum of them.


def b_splines(knots: Array, degree: int) -> scipy.interpolate.BSpline:
    """Return every B-spline as a function of places (n,) between the ends of the knots.

    Called with them it returns (n, f) values [1], with ``nu=1`` slopes [1 / unit of the knots]; at an inner
    knot the interval to the right counts.

    Parameters
    ----------
    knots
        (f + degree + 1,) ascending, the ends repeated so that the splines sum to one everywhere between them.
    degree
        Of the polynomials, at least 0.
    """
    return scipy.interpolate.BSpline(knots, np.eye(len(knots) - degree - 1), degree)


# ----------------------------------------------------------------------------
# Newton's method, with steps that are halved where they lead astray.

CONVERGED_STEP = 1e-10
"""Relative size of a last step: the error that is left is its square."""

Rows = NDArray[np.intp]


class Equations(Protocol):
    """Problems that Newton's method solves; ``rows`` (k,) says which of them are asked for."""

    def residual(self, rows: Rows, unknowns: Array) -> Array:
        """(k, M) at the unknowns (k, d)."""
        ...

    def step(self, rows: Rows, unknowns: Array) -> tuple[Array, Array, Array]:
        """(k, M) residual, (k, d) Newton's step, as long as it may be, and its relative size (k,)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Roots:
    """Where Newton's method ended.

    Parameters
    ----------
    unknowns
        (n, d).
    before
        (n, d) place of the last evaluation, from which the last step led to the unknowns.
    last_step
        (n,) relative size of the last step, not shortened; infinite where there was none.
    """

    unknowns: Array
    before: Array
    last_step: Array


def newton(
    equations: Equations,
    start: Array,
    *,
    steps: int = MAX_NEWTON_STEPS,
    halvings: int = MAX_STEP_HALVINGS,
) -> Roots:
    """Solve all problems; one whose residual no part of a step lowers stays where it is.

    A step whose relative size is ``CONVERGED_STEP`` is the last: the next one would be its square.

    Parameters
    ----------
    equations
        What is solved.
    start
        (n, d) unknowns to begin with.
    steps, halvings
        Most steps, and lengths of each that are tried.
    """
    unknowns, before = np.array(start), np.array(start)
    last_step, unfinished = np.full(len(start), np.inf), np.ones(len(start), dtype=bool)
    rows = np.arange(len(start))
    for _ in range(steps):
        going = unfinished[rows]
        if not going.any():
            break
        if 2 * np.count_nonzero(going) < len(rows):
            # fewer problems are cheaper, but the equations evaluate anew what a trial left at hand
            rows, going = rows[going], going[going]
        here = before[rows] = unknowns[rows]
        residual, move, relative = equations.step(rows, here)
        going &= np.isfinite(move).all(axis=1)
        last_step[rows[going]] = relative[going]
        last = going & (relative <= CONVERGED_STEP)
        move[~going] = 0.0
        stays = _shorten(equations, rows, here, move, residual, going & ~last, halvings)
        move[stays] = 0.0
        unknowns[rows] = here + move
        unfinished[rows] = going & ~last & ~stays
    return Roots(unknowns=unknowns, before=before, last_step=last_step)


def _shorten(
    equations: Equations,
    rows: Rows,
    here: Array,
    move: Array,
    residual: Array,
    trying: NDArray[np.bool_],
    halvings: int,
) -> NDArray[np.bool_]:
    """Halve steps in place until residuals do not grow; True where no part of a step serves."""
    least = _norm(residual) * (1 + ROUND_OFF)
    worse = np.array(trying)
    # at first with all rows: what is evaluated there serves the next step
    chosen = np.arange(len(rows)) if trying.any() else np.arange(0)
    for attempt in range(halvings):
        if attempt:
            move[chosen] /= 2
        if not len(chosen):
            break
        trial = equations.residual(rows[chosen], here[chosen] + move[chosen])
        worse[chosen] &= ~(_norm(trial) <= least[chosen])
        chosen = np.flatnonzero(worse)
    return worse


def _norm(residual: Array) -> Array:
    # beyond the largest number it is infinite, as is every one that is larger
    with np.errstate(over="ignore"):
        return np.asarray(np.linalg.norm(residual, axis=1))


def solve_each(matrix: Array, right: Array) -> Array:
    """Solve a batch (n, d, d) x = (n, d, j); a singular member gets the shortest of its best solutions.

    A member that is not finite gives NaN.
    """
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        solution = np.asarray(np.linalg.pinv(np.nan_to_num(matrix)) @ np.nan_to_num(right))
        solution[~np.isfinite(matrix).all(axis=(1, 2))] = np.nan
        return solution


def determined(covariance: Array, null: Array) -> Array:
    """Return the covariance (q, q), NaN for parameters with a part in null vectors (q, d)."""
    lost = np.abs(null).max(axis=1, initial=0.0) > MIN_NULL_COMPONENT
    return np.where(lost | lost[:, None], np.nan, covariance)


OVERLAPPING = 3
"""Next points of a record whose windows overlap that of a point: all that are closer than a window."""


def summed_products(rows: Array, residual: Array, record: NDArray[np.intp]) -> Array:
    """Return the covariance (r, r) of the sum of products of orthonormal rows (n, M, r) and residuals (n, M).

    Noise of points with the same number in ``record`` (n,), in the order of time, is correlated where their
    windows overlap: products of points l places from each other count by the weights of Bartlett, 1 - l/(L +
    1) up to L = ``OVERLAPPING``, with which no variance is negative (Newey and West, Econometrica 55, 1987).
    A residual is the one that a fit without its point has there (MacKinnon and White, J. Econometrics 29,
    1985): few points may decide.
    """
    left_out = solve_each(np.eye(residual.shape[1]) - rows @ rows.transpose(0, 2, 1), residual[:, :, None])
    scores = np.einsum("nmr,nmi->nr", rows, left_out)
    total = scores.T @ scores
    for lag in range(1, OVERLAPPING + 1):
        together = record[lag:] == record[:-lag]
        products = scores[:-lag][together].T @ scores[lag:][together]
        total += (1 - lag / (OVERLAPPING + 1)) * (products + products.T)
    return np.asarray(total)
