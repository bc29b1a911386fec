"""The mean X0 of the motion, in closed form or as a number.

It solves the mean balance integral n(X0 + X sin(phi), omega X cos(phi)) dphi = 0. Some laws have several
roots; the one nearest to rest at which the mean force rises is returned, since a structure reaches it from
rest. It is bracketed by a scan of means up to 64 amplitudes and solved by Ridders' method (IEEE Trans.
Circuits Syst. 26 (1979) 979), for all cycles at once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.describing.closed import MAX_TERMS
from rsgen.formula.names import X0

Balance = Callable[[Array, NDArray[np.intp]], Array]
"""Mean force at trial means (m,) for the cycles with these numbers (m,)."""

SCAN = np.concatenate((-np.geomspace(64, 1e-3, 24), [0.0], np.geomspace(1e-3, 64, 24)))
"""Trial means, in multiples of the amplitude; the change of sign nearest to rest counts."""

SEARCHED_AMPLITUDES = 256
"""Amplitudes whose means are bracketed; the means of others are refined from their neighbours."""


def closed_mean(balance: sympy.Expr) -> sympy.Expr | None:
    """Solve a mean balance that is linear or quadratic in X0 and has no cases.

    Of the two roots of a quadratic the one is returned that vanishes with the constant part, if the linear
    stiffness is positive.
    """
    # SymPy sorts all terms of a polynomial first
    if not balance.has(X0) or len(sympy.Add.make_args(balance)) > MAX_TERMS:
        return None
    if balance.has(sympy.Piecewise, sympy.Integral) or not balance.is_polynomial(X0):
        return None
    coefficients = sympy.Poly(balance, X0).all_coeffs()
    if len(coefficients) == 2:
        slope, constant = coefficients
        return sympy.factor_terms(sympy.expand(-constant / slope))
    if len(coefficients) == 3:
        curvature, slope, constant = coefficients
        if slope.is_zero:
            return None
        return (-slope + sympy.sqrt(slope**2 - 4 * curvature * constant)) / (2 * curvature)
    return None


def solve_mean(balance: Balance, X: Array, stiffness: Array, flat: bool) -> Array:
    """Find the mean of every cycle, nearest to rest, at which the mean force rises through zero.

    Parameters
    ----------
    balance
        Mean force for trial means; rising with the mean where the structure is stable.
    X
        (n,) amplitudes [m].
    stiffness
        (n,) stiffness of the order of the law [N/m]: mean forces below 1e-14 of it times X are zero.
    flat
        The mean force may vanish on a range of means, as in a gap; the end of the range that is nearest to
        rest is then the mean.

    Returns
    -------
    (n,) means [m]; nan where the mean force does not pass through zero.
    """
    n = len(X)
    tiny = 1e-14 * np.abs(stiffness) * X
    at_rest = balance(np.zeros(n), np.arange(n))
    result = np.where(np.abs(at_rest) <= tiny, 0.0, np.nan)
    rows = np.flatnonzero(np.isnan(result) & np.isfinite(at_rest))
    if len(rows) > 2 * SEARCHED_AMPLITUDES:
        ordered = rows[np.argsort(X[rows], kind="stable")]
        searched = ordered[np.unique(np.linspace(0, len(rows) - 1, SEARCHED_AMPLITUDES).astype(np.intp))]
        _search(balance, searched, X, tiny, flat, result)
        rows = np.setdiff1d(rows, searched)
        _interpolate(balance, rows, searched, X, tiny, result)
        rows = rows[np.isnan(result[rows])]
    _search(balance, rows, X, tiny, flat, result)
    return result


def _search(
    balance: Balance, rows: NDArray[np.intp], X: Array, tiny: Array, flat: bool, result: Array
) -> None:
    """Bracket the rise through zero that is nearest to rest, and solve for it; nan if there is none."""
    if not len(rows):
        return
    trials = SCAN * X[rows, None]
    forces = balance(trials.ravel(), np.repeat(rows, len(SCAN))).reshape(trials.shape)
    zeroed = np.where(np.abs(forces) <= tiny[rows, None], 0.0, forces)
    low, high, found = _nearest_rise(trials, zeroed, flat)
    found_rows = rows[found]
    result[found_rows] = _refine(balance, found_rows, low[found], high[found], tiny[found_rows])


SLOPE_STEP = 1e-4
"""Finite difference of the mean over which the mean force is differentiated, relative to the amplitude."""

MAX_NEWTON_STEPS = 6


def _interpolate(
    balance: Balance, rows: NDArray[np.intp], solved: NDArray[np.intp], X: Array, tiny: Array, result: Array
) -> None:
    """Interpolate means and slopes between solved amplitudes, and refine the means by Newton steps.

    A mean whose steps do not shrink, as at a corner of the mean force or another frequency, stays nan.
    """
    width = SLOPE_STEP * X[solved]
    rise = balance(result[solved] + width, solved) - balance(result[solved] - width, solved)
    slope = np.interp(X[rows], X[solved], rise / (2 * width))
    mean = np.interp(X[rows], X[solved], result[solved])
    usable = np.isfinite(mean) & (slope > 0)
    rows, mean, slope = rows[usable], mean[usable], slope[usable]
    last = 0.01 * X[rows]
    for _ in range(MAX_NEWTON_STEPS):
        if not len(rows):
            return
        force = balance(mean, rows)
        step = force / slope
        mean = mean - step
        # steps shrink by a constant factor, so that the next one would be step**2 / last
        converged = step**2 <= 1e-16 * X[rows] * last
        done = (converged | (np.abs(force) <= tiny[rows])) & (np.abs(step) < X[rows] / 8)
        result[rows[done]] = mean[done]
        active = ~done & (np.abs(step) < last / 8)
        rows, mean, slope, last = rows[active], mean[active], slope[active], np.abs(step[active])


def _nearest_rise(trials: Array, forces: Array, flat: bool) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Find the interval nearest to zero on which the force rises through zero (or reaches it)."""
    lower, upper = forces[:, :-1], forces[:, 1:]
    with np.errstate(invalid="ignore"):
        rising = (lower < 0) & (upper > 0)
        if flat:
            rising |= ((lower < 0) & (upper == 0)) | ((lower == 0) & (upper > 0))
    distance = np.where(rising, np.abs(trials[:, :-1] + trials[:, 1:]), np.inf)
    place = np.argmin(distance, axis=1)
    rows = np.arange(len(trials))
    return trials[rows, place], trials[rows, place + 1], rising[rows, place]


MAX_RIDDERS_STEPS = 80


def _refine(balance: Balance, rows: NDArray[np.intp], low: Array, high: Array, tiny: Array) -> Array:
    """Solve in each bracket by Ridders' method; where the force is zero at one end, bisect to the edge."""
    below, above = balance(low, rows), balance(high, rows)
    best = np.where(above <= tiny, high, low)
    active = np.flatnonzero((np.abs(below) > tiny) & (above > tiny))
    for zero, nonzero, one_sided in (
        (low, high, (np.abs(below) <= tiny) & (above > tiny)),
        (high, low, (below < -tiny) & (np.abs(above) <= tiny)),
    ):
        edges = np.flatnonzero(one_sided)
        best[edges] = _edge(balance, rows[edges], zero[edges], nonzero[edges], tiny[edges])
    for _ in range(MAX_RIDDERS_STEPS):
        if not len(active):
            break
        a, b, fa, fb = low[active], high[active], below[active], above[active]
        middle = (a + b) / 2
        fm = balance(middle, rows[active])
        with np.errstate(all="ignore"):
            point = middle + (middle - a) * -fm / np.sqrt(fm * fm - fa * fb)
        point = np.where((point > a) & (point < b), point, middle)
        fp = balance(point, rows[active])
        # of the four points the two neighbours between which the force rises
        first = np.minimum(middle, point), np.where(middle <= point, fm, fp)
        second = np.maximum(middle, point), np.where(middle <= point, fp, fm)
        low[active] = np.where(second[1] < 0, second[0], np.where(first[1] < 0, first[0], a))
        below[active] = np.where(second[1] < 0, second[1], np.where(first[1] < 0, first[1], fa))
        high[active] = np.where(second[1] < 0, b, np.where(first[1] < 0, second[0], first[0]))
        above[active] = np.where(second[1] < 0, fb, np.where(first[1] < 0, second[1], first[1]))
        best[active] = point
        width = high[active] - low[active]
        scale = np.maximum(np.abs(low[active]), np.abs(high[active]))
        done = (width <= 4e-16 * scale) | (np.abs(fp) <= 0.01 * tiny[active]) | ~np.isfinite(fp)
        active = active[~done]
    return best


def _edge(balance: Balance, rows: NDArray[np.intp], zero: Array, nonzero: Array, tiny: Array) -> Array:
    """Bisect for the end of a range of means without force, between a mean in it and one outside."""
    if not len(rows):
        return zero
    for _ in range(54):
        middle = (zero + nonzero) / 2
        outside = np.abs(balance(middle, rows)) > tiny
        zero, nonzero = np.where(outside, zero, middle), np.where(outside, middle, nonzero)
    return zero
