"""The mean of the motion: X0 such that the mean force over a cycle is zero, in closed form or as a number."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.formula.names import X0

Balance = Callable[[Array, NDArray[np.intp]], Array]
"""Mean force at trial means (m,) for the cycles with these numbers (m,)."""

SCAN = np.concatenate((-np.geomspace(64, 1e-3, 24), [0.0], np.geomspace(1e-3, 64, 24)))
"""Trial means, in multiples of the amplitude; the change of sign nearest to rest counts."""

STEPS = 80

SLOPE_STEP = 1e-4
"""Change of the mean, in multiples of the amplitude, over which the slope of the mean force is taken."""

SLIDES = 6
"""Newton steps from a mean between known ones; three are enough where it changes smoothly."""

_MOST_TERMS = 200
"""Terms of a mean balance that is solved in closed form; a longer formula would say nothing to a reader."""

COARSE = 256
"""Amplitudes whose means are searched for when there are many more."""


def closed_mean(balance: sympy.Expr) -> sympy.Expr | None:
    """Solve a mean balance that is linear or quadratic in X0 and has no cases.

    Of the two roots of a quadratic the one is given that vanishes with the constant part, where the linear
    stiffness is positive: the one that a structure reaches from rest.
    """
    # the library would sort thousands of terms to find that X0 is in few of them
    if not balance.has(X0) or len(sympy.Add.make_args(balance)) > _MOST_TERMS:
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
    """Find the mean of every cycle: the nearest one to rest at which the mean force passes through zero.

    Parameters
    ----------
    balance
        Mean force for trial means; rising with the mean where the structure is stable.
    X
        (n,) amplitudes [m].
    stiffness
        (n,) any force per length of the right size [N/m]: mean forces below 1e-14 of it times X are zero.

    flat
        Whether the mean force may vanish on a whole range of means (a gap); then the edge of the range that
        is nearest to rest is the answer.

    Returns
    -------
    (n,) means [m]; nan where the mean force does not pass through zero.
    """
    n = len(X)
    everyone = np.arange(n)
    tiny = 1e-14 * np.abs(stiffness) * X
    at_rest = balance(np.zeros(n), everyone)
    result = np.where(np.abs(at_rest) <= tiny, 0.0, np.nan)
    wanted = np.flatnonzero(np.isnan(result) & np.isfinite(at_rest))
    if len(wanted) > 2 * COARSE:
        # the mean changes smoothly with X: some are searched for, the others start from their neighbours
        ordered = wanted[np.argsort(X[wanted], kind="stable")]
        some = ordered[np.unique(np.linspace(0, len(ordered) - 1, COARSE).astype(np.intp))]
        _search(balance, some, X, tiny, flat, result)
        others = np.setdiff1d(wanted, some)
        _slide(balance, others, some, X, tiny, result)
        others = others[np.isnan(result[others])]
        _follow(balance, others, np.interp(X[others], X[some], result[some]), X, tiny, result)
        wanted = others[np.isnan(result[others])]
    _search(balance, wanted, X, tiny, flat, result)
    return result


def _search(
    balance: Balance, rows: NDArray[np.intp], X: Array, tiny: Array, flat: bool, result: Array
) -> None:
    """Scan a wide range of means for the nearest rise through zero; enter what is found."""
    if not len(rows):
        return
    trials = SCAN * X[rows, None]
    forces = balance(trials.ravel(), np.repeat(rows, len(SCAN))).reshape(trials.shape)
    zeroed = np.where(np.abs(forces) <= tiny[rows, None], 0.0, forces)
    low, high, found = _nearest_rise(trials, zeroed, flat)
    found_rows = rows[found]
    result[found_rows] = _refine(balance, found_rows, low[found], high[found], tiny[found_rows])


def _slide(
    balance: Balance, rows: NDArray[np.intp], some: NDArray[np.intp], X: Array, tiny: Array, result: Array
) -> None:
    """Improve what lies between known means by Newton steps, with slopes that lie between known slopes.

    Steps that do not shrink (a corner of the mean force, another frequency) leave their mean open.
    """
    width = SLOPE_STEP * X[some]
    rise = balance(result[some] + width, some) - balance(result[some] - width, some)
    slope = np.interp(X[rows], X[some], rise / (2 * width))
    mean = np.interp(X[rows], X[some], result[some])
    usable = np.isfinite(mean) & (slope > 0)
    rows, mean, slope = rows[usable], mean[usable], slope[usable]
    before = 0.01 * X[rows]
    for _ in range(SLIDES):
        if not len(rows):
            return
        force = balance(mean, rows)
        step = force / slope
        mean = mean - step
        # steps shrink by a constant factor: the next one would be this small
        still = step**2 <= 1e-16 * X[rows] * before
        done = (still | (np.abs(force) <= tiny[rows])) & (np.abs(step) < X[rows] / 8)
        result[rows[done]] = mean[done]
        on = ~done & (np.abs(step) < before / 8)
        rows, mean, slope, before = rows[on], mean[on], slope[on], np.abs(step[on])


def _follow(
    balance: Balance, rows: NDArray[np.intp], guess: Array, X: Array, tiny: Array, result: Array
) -> None:
    """Refine good guesses of the mean; guesses that are not good stay open."""
    for reach in (1e-4, 1e-2):
        near = np.isfinite(guess) & np.isnan(result[rows])
        some = rows[near]
        if not len(some):
            return
        width = reach * np.maximum(np.abs(guess[near]), X[some])
        low, high = guess[near] - width, guess[near] + width
        rising = (balance(low, some) < -tiny[some]) & (balance(high, some) > tiny[some])
        caught = some[rising]
        result[caught] = _refine(balance, caught, low[rising], high[rising], tiny[caught])


def _nearest_rise(trials: Array, forces: Array, flat: bool) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Find the interval nearest to zero on which the force rises through zero (or reaches it)."""
    left, right = forces[:, :-1], forces[:, 1:]
    with np.errstate(invalid="ignore"):
        rising = (left < 0) & (right > 0)
        if flat:
            rising |= ((left < 0) & (right == 0)) | ((left == 0) & (right > 0))
    distance = np.where(rising, np.abs(trials[:, :-1] + trials[:, 1:]), np.inf)
    place = np.argmin(distance, axis=1)
    rows = np.arange(len(trials))
    return trials[rows, place], trials[rows, place + 1], rising[rows, place]


def _refine(balance: Balance, rows: NDArray[np.intp], low: Array, high: Array, tiny: Array) -> Array:
    """Narrow brackets by Ridders' method; where the force is zero on one side, halve to its edge."""
    below, above = balance(low, rows), balance(high, rows)
    best = np.where(above <= tiny, high, low)
    active = np.flatnonzero((np.abs(below) > tiny) & (above > tiny))
    for still, pushed, ends in (
        (low, high, (np.abs(below) <= tiny) & (above > tiny)),
        (high, low, (below < -tiny) & (np.abs(above) <= tiny)),
    ):
        edges = np.flatnonzero(ends)
        best[edges] = _edge(balance, rows[edges], still[edges], pushed[edges], tiny[edges])
    for _ in range(STEPS):
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


def _edge(balance: Balance, rows: NDArray[np.intp], still: Array, pushed: Array, tiny: Array) -> Array:
    """Find the end of a range of means without force between a mean in it and one outside."""
    if not len(rows):
        return still
    for _ in range(54):
        middle = (still + pushed) / 2
        out = np.abs(balance(middle, rows)) > tiny
        still, pushed = np.where(out, still, middle), np.where(out, middle, pushed)
    return still
