"""From starting values to the refined model: the balance with all harmonics that matter, or the simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.fit import Fit, Problem, fit_balance, fit_simulator
from rsgen.identification.start import QUICK, is_strong

__all__ = ["add_harmonics", "refine", "refit_with_simulator"]

Array = NDArray[np.float64]

_ORDERS = (9, 15, 23)
"""Harmonics carried in the balance, raised until the last one no longer matters."""

_TAIL = 1e-9
"""Relative size at which the last harmonic no longer matters in exact data."""

_ACCURACIES = (1e-5, 1e-8)
"""Of the simulator inside the fit: the finer one where the misfit turns out to be as small as the coarser."""

_EXACT = 1e-5
"""Misfit below which a truncated waveform shows wherever a law has a switch, be it as soft as x|x|."""

_RESOLVED = 100.0
"""A misfit so many times the simulator's accuracy is not the simulator's."""

_WORSE = 1.05
"""The simulator may not fit worse than the balance; if it does, it follows other branches."""

_FOLLOWED = 0.9
"""Share of the points that the simulator must be able to follow; where it is not, the law is wrong."""


def refine(problem: Problem, parameters: Array) -> tuple[Fit, bool]:
    """All harmonics that matter, and whether only the simulator has all of them."""
    law = problem.law
    points = problem.observed.mode(problem.split(parameters)[2])
    few = problem.select(points.spread(QUICK)) if len(points) > 2 * QUICK else problem
    sharp = law.rough or is_strong(points)
    for order in _ORDERS:
        refined = fit_balance(few, parameters, order=order)
        parameters = refined.regression.parameters
        harmonics = np.abs(refined.harmonics[refined.regression.used])
        last = float(np.max(harmonics[:, -2:] / harmonics[:, 1:2], initial=0.0))
        enough = last < max(_TAIL, 1e-3 * refined.regression.noise / np.sqrt(len(points)))
        if law.switched or sharp or enough:
            break
    noise = refined.regression.noise
    sharp = (sharp or (law.switched and noise < _EXACT)) and noise > _ACCURACIES[-1]
    if few is problem:
        return refined, sharp
    # what the simulator takes up needs no more than one step
    return fit_balance(problem, parameters, order=order, steps=1 if sharp else 25), sharp


def refit_with_simulator(balanced: Fit) -> Fit:
    """Replace the balance by the simulator where the law has jumps or corners."""
    problem = balanced.problem
    start, accuracy = balanced, _ACCURACIES[0]
    few = problem.observed.mode(balanced.background).spread(QUICK)
    quick = fit_simulator(problem.select(few), balanced.select(few), accuracy=accuracy)
    if quick is not None:
        near = replace(balanced.regression, parameters=quick.regression.parameters)
        start = replace(balanced, regression=replace(near, noise=quick.regression.noise))
        if quick.regression.noise < _RESOLVED * accuracy:
            accuracy = _ACCURACIES[1]
    whole = len(few) == len(balanced.force) and accuracy == _ACCURACIES[0]
    refitted = quick if whole else fit_simulator(problem, start, accuracy=accuracy)
    followed = np.count_nonzero(refitted.regression.used) if refitted is not None else 0
    if refitted is None or followed < _FOLLOWED * np.count_nonzero(balanced.regression.used):
        return balanced
    both = refitted.regression.used & balanced.regression.used
    misfit = [float(np.sqrt(np.mean(found.regression.misfit[both] ** 2))) for found in (refitted, balanced)]
    return refitted if misfit[0] <= _WORSE * misfit[1] else balanced


def add_harmonics(followed: Fit) -> Fit:
    """Try more harmonics where the simulator did not settle on every branch of exact data."""
    balanced = followed
    for order in _ORDERS[1:]:
        balanced = fit_balance(followed.problem, balanced.regression.parameters, order=order)
    return min(followed, balanced, key=lambda found: found.regression.noise)
