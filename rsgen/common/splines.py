"""B-splines over knots: a smooth curve is a sum of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, blocks

__all__ = ["b_splines", "spline_values"]

_PLACES = 4096
"""Evaluated at once: what is between two degrees then stays in the processor's cache."""


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
    local, shares, interval = _local(at, knots, degree)
    slopes = [np.zeros(len(at))]
    if degree:
        slopes = _joined([-degree * share for share in shares], [degree * share for share in shares])
    return _spread(local, interval, knots), _spread(slopes, interval, knots)


def spline_values(at: Array, knots: Array, degree: int) -> Array:
    """Evaluate every B-spline as ``b_splines`` does, without slopes, at many places: (n, f)."""
    values = np.zeros((len(at), len(knots) - degree - 1))
    for part in blocks(len(at), _PLACES):
        local, _, interval = _local(at[part], knots, degree)
        values[part] = _spread(local, interval, knots)
    return values


def _local(at: Array, knots: Array, degree: int) -> tuple[list[Array], list[Array], NDArray[np.intp]]:
    """Splines that are not zero in the interval of each place, those one degree lower over their width."""
    functions = len(knots) - degree - 1
    interval = np.clip(np.searchsorted(knots, at, side="right") - 1, degree, functions - 1)
    knot = {offset: knots[interval + offset] for offset in range(1 - degree, degree + 1)}
    # of all splines of an order, as many as its number are not zero in an interval
    local, shares = [np.ones(len(at))], list[Array]()
    for order in range(1, degree + 1):
        falling, rising = list[Array](), list[Array]()
        shares = []
        for number, below in enumerate(local):
            start, end = knot[number + 1 - order], knot[number + 1]
            share = below / (end - start)
            shares.append(share)
            falling.append((end - at) * share)
            rising.append((at - start) * share)
        local = _joined(falling, rising)
    return local, shares, interval


def _joined(left: list[Array], right: list[Array]) -> list[Array]:
    """Add up what two neighbours of lower order give to each spline."""
    inner = [one + other for one, other in zip(left[1:], right[:-1], strict=True)]
    return [left[0], *inner, right[-1]]


def _spread(local: list[Array], interval: NDArray[np.intp], knots: Array) -> Array:
    """Put the splines of each interval into their columns; the others are zero."""
    degree = len(local) - 1
    functions = len(knots) - degree - 1
    first = np.arange(len(interval)) * functions + interval - degree
    values = np.zeros(len(first) * functions)
    for number, row in enumerate(local):
        values[first + number] = row
    return values.reshape(-1, functions)
