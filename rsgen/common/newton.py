"""Newton's method on many independent problems at once, with steps that are halved where they lead astray.

Each of n problems seeks u with r(u) = 0 by u <- u - s J(u)^-1 r(u), s = 1, 1/2, 1/4, ... until |r| does not
grow: the direction of Newton's step always lowers |r| at first (Nocedal and Wright, Numerical Optimization,
2006, Sec. 11.2). What is solved for, and how the linear equations of a step are solved (dense and in a batch,
or by an iterative method for one large problem), is up to the ``Equations``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.tolerances import ROUND_OFF

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
    size
        (n,) relative size of the last step, not shortened; infinite where there was none.
    """

    unknowns: Array
    before: Array
    size: Array


def newton(equations: Equations, start: Array, *, tolerance: float, steps: int, halvings: int) -> Roots:
    """Solve all problems; one whose residual no part of a step lowers stays where it is.

    Parameters
    ----------
    equations
        What is solved.
    start
        (n, d) unknowns to begin with.
    tolerance
        Relative size of a step after which the next one would be its square: it is the last one.
    steps, halvings
        Most steps, and lengths of each that are tried; none: every step is taken whole.
    """
    unknowns, before = np.array(start), np.array(start)
    size, unfinished = np.full(len(start), np.inf), np.ones(len(start), dtype=bool)
    rows = np.arange(len(start))
    for _ in range(steps):
        going = unfinished[rows]
        if not going.any():
            break
        if np.count_nonzero(going) * (2 if halvings else 1) < len(rows):
            # fewer problems are cheaper, but the equations evaluate anew what a trial left at hand
            rows, going = rows[going], going[going]
        here = before[rows] = unknowns[rows]
        residual, move, relative = equations.step(rows, here)
        going &= np.isfinite(move).all(axis=1)
        size[rows[going]] = relative[going]
        last = going & (relative <= tolerance)
        move[~going] = 0.0
        stays = _shorten(equations, rows, here, move, residual, going & ~last, halvings)
        move[stays] = 0.0
        unknowns[rows] = here + move
        unfinished[rows] = going & ~last & ~stays
    return Roots(unknowns=unknowns, before=before, size=size)


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
    if not halvings:
        return np.zeros(len(rows), dtype=bool)
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
