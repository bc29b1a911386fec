"""B-splines over knots: a smooth curve is a sum of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.arrays import Array

__all__ = ["b_splines"]


def b_splines(at: Array, knots: Array, degree: int) -> tuple[Array, Array]:
    """Evaluate every B-spline and its slope by the recursion of Cox and de Boor.

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
    functions = len(knots) - degree - 1
    interval = np.clip(np.searchsorted(knots, at, side="right") - 1, degree, functions - 1)
    # of all splines of an order, as many as its number are not zero in an interval
    local = [np.ones(len(at))]
    slopes = [np.zeros(len(at))]
    for order in range(1, degree + 1):
        shares = []
        for number, below in enumerate(local):
            start, end = knots[interval + number + 1 - order], knots[interval + number + 1]
            share = below / (end - start)
            shares.append((share, (end - at) * share, (at - start) * share))
        local = _joined([falling for _, falling, _ in shares], [rising for *_, rising in shares])
        slopes = _joined([-order * share for share, *_ in shares], [order * share for share, *_ in shares])
    first = np.arange(len(at)) * functions + interval - degree
    return _spread(local, first, functions), _spread(slopes, first, functions)


def _joined(left: list[Array], right: list[Array]) -> list[Array]:
    """Add up what two neighbours of lower order give to each spline."""
    inner = [one + other for one, other in zip(left[1:], right[:-1], strict=True)]
    return [left[0], *inner, right[-1]]


def _spread(local: list[Array], first: NDArray[np.intp], functions: int) -> Array:
    """Put the splines of each interval into their columns; the others are zero."""
    values = np.zeros(len(first) * functions)
    for number, row in enumerate(local):
        values[first + number] = row
    return values.reshape(-1, functions)
