"""Even forces where the mean was not recorded: starting values, and what the test cannot say of them.

The force k2 x^2 has no fundamental along a sine. It moves the mean and makes a second harmonic, and only
these act back, in proportion to k2^2. So a fit that begins at k2 = 0 has no slope to follow, and k2 and -k2
fit alike where neither was recorded. Values of several sizes are tried; the motion follows from the law.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.tolerances import FOLLOWED, NOISY, NULL_PART, SAMPLES, START_ORDER, TRIAL_STEPS
from rsgen.identification.fitting.fit import Fit, fit_balance
from rsgen.identification.fitting.problem import Problem
from rsgen.identification.fitting.scaled_columns import solve_scaled
from rsgen.identification.starting.equations import Equations, equation_rows
from rsgen.law.motion import Motion, sine_motion

__all__ = ["is_hidden", "records_even", "start_asymmetric"]

_SHARES = (0.05, 0.2, 0.5)
"""Largest force of a direction that is tried, relative to the spring's: x^2 of the last moves the mean by a
quarter of the amplitude, of the first by as little as noise of one per cent leaves to be seen."""

_POINTS = 100
"""Points that each trial is fitted to."""

_MOST = 2
"""Directions that are tried together: one more would multiply the trials by seven."""


def is_hidden(problem: Problem) -> bool:
    """Tell whether the law moves the mean, and the test did not record it."""
    return not problem.law.odd and 0 not in problem.observed.points.measured


def start_asymmetric(problem: Problem, parameters: Array) -> tuple[Problem, Array]:
    """Give values to directions in the parameters that leave the fundamental along a sine as it is.

    The response is linear in the square of such a value, and chance makes that square negative as often as
    not where the truth is zero. No value fits then best, and there is no slope at zero; so the value stays
    at its resolution, where its standard error is as large as itself.

    Parameters
    ----------
    problem
        What is fitted.
    parameters
        Where the others start.
    """
    if not is_hidden(problem):
        return problem, parameters
    law, count = problem.law, len(problem.observed.points)
    few = problem.select(problem.observed.points.spread(_POINTS))
    directions = _directions(few, parameters)[:_MOST]
    if not directions:
        return problem, parameters
    # x for -x mirrors the motion: where nothing even was recorded one sign of the first direction is enough
    mirrored = not records_even(problem)
    signs = [(1.0,) if mirrored and not place else (1.0, -1.0) for place in range(len(directions))]
    sizes = [[0.0, *(sign * share for share in _SHARES for sign in each)] for each in signs]
    chosen = list(product(*sizes))
    held = replace(few, held=law.even)
    without, *fits = [
        _fit(held, parameters + np.array(each) @ np.array(directions), TRIAL_STEPS) for each in chosen
    ]
    best = _fit(few, min(fits, key=_cost).regression.parameters, 2 * TRIAL_STEPS)
    least = without.regression.parameters if np.isfinite(_cost(without)) else parameters
    moved = np.flatnonzero(np.any(np.array(directions) != 0, axis=0))
    if not np.isfinite(np.diag(best.regression.covariance)[moved]).any():
        return problem, least
    gain = (
        (_cost(without) / max(_cost(best), 1e-300) - 1)
        * best.regression.freedom
        * count
        / len(few.observed.points)
    )
    if gain > 1 or not mirrored:
        found = np.array(best.regression.parameters)
        even = list(law.even)
        if mirrored and law.mirrored and even and found[even[0]] < 0:
            found[even] *= -1
        return problem, found
    if set(moved) - set(law.even):
        return problem, least
    small = fits[chosen.index(tuple(each[1] for each in sizes)) - 1]
    resolved = _at_resolution(small, without, moved, count)
    # errors there are smaller than where the trial misses the points
    resolved = _at_resolution(_fit(held, resolved, TRIAL_STEPS), without, moved, count)
    # in exact data what is left is what a few harmonics leave out: the fits that follow go on from here
    return (replace(problem, held=tuple(moved)) if without.regression.noise > NOISY else problem), resolved


def _at_resolution(small: Fit, without: Fit, moved: NDArray[np.intp], count: int) -> Array:
    """Give even values the size at which their standard error from ``count`` points is as large."""
    noise = without.regression.noise / max(small.regression.noise, 1e-300)
    variance = np.diag(small.regression.covariance) * noise**2 * len(small.force) / count
    found = np.array(without.regression.parameters)
    # p^2 is as uncertain everywhere: 2 p sigma_p is the same at any p
    size = np.sqrt(np.abs(small.regression.parameters) * np.sqrt(variance))
    found[moved] = np.where(np.isfinite(size), size, 0.0)[moved]
    return found


def _fit(problem: Problem, parameters: Array, steps: int) -> Fit:
    return fit_balance(problem, parameters, order=START_ORDER, steps=steps, reject=False, correct=False)


def records_even(problem: Problem) -> bool:
    """Tell whether the test recorded the mean or an even harmonic, with phases."""
    observed = problem.observed
    return observed.phase_known and any(h % 2 == 0 for h in observed.points.measured)


def _cost(found: Fit) -> float:
    """Mean square misfit; infinite where too few of the points have a prediction."""
    misfit = found.regression.misfit[np.isfinite(found.regression.misfit)]
    return float(np.mean(misfit**2)) if len(misfit) > FOLLOWED * len(found.force) else np.inf


def _directions(problem: Problem, parameters: Array) -> list[Array]:
    """Null vectors of the first-order balance, (p,) each, as large as the spring's force."""
    law = problem.law
    points = problem.observed.mode(problem.split(parameters)[2])
    values, mass, _ = problem.split(parameters)
    sine = sine_motion(points.omega, points.amplitude).harmonics
    equations = Equations(points.omega, points.force, sine, False, 1 / np.abs(points.force), np.zeros((0, 2)))
    matrix, right = equation_rows(equations, law, problem.given, values[list(law.nonlinear)])
    norm = np.sqrt(np.sum(matrix**2, axis=0))
    null = solve_scaled(matrix, right)[2]
    null = np.where(np.abs(null) > NULL_PART, null, 0.0) / np.where(norm > 0, norm, 1.0)[:, None]
    largest = int(np.argmax(points.amplitude))
    motion = Motion(points.omega[[largest]], sine[[largest]])
    slopes = law.along(motion, values, SAMPLES).by_parameter
    spring = abs(mass) * points.omega[largest] ** 2 * points.amplitude[largest]
    found = []
    for column in null.T:
        parts = [c * slopes[j] for c, j in zip(column, law.linear, strict=False)]
        force = np.sum(parts, axis=0)
        largest_force = float(np.max(np.abs(force)))
        if largest_force > 0:
            direction = np.zeros(len(parameters))
            direction[list(law.linear)] = column[: len(law.linear)] * (spring / largest_force)
            found.append(direction)
    return found
