"""From starting values to the refined model: the balance with all harmonics that matter, or the simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.balance_fit import FittedModel, fit_balance
from rsgen.identification.data import Points
from rsgen.identification.dynamic_stiffness import (
    Equations,
    LinearSolution,
    point_misfit,
    solve_equations,
)
from rsgen.identification.output_error import fit_output
from rsgen.law.numeric import ForceLaw
from rsgen.oscillator import Model

__all__ = [
    "QUICK",
    "enrich",
    "fit_order",
    "is_strong",
    "leaves_the_middle",
    "polish",
    "refine",
    "start_values",
]

Array = NDArray[np.float64]

_ORDERS = (9, 15, 23)
"""Harmonics carried in the balance, raised until the last one no longer matters."""

QUICK = 400
"""Points that suffice to come near the estimate; all points then need one or two steps more."""

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

_GROSS = 5.0
"""Starting values give less weight to points that disagree by more than so many typical misfits."""

_TYPICAL = 0.04
"""Relative misfit of starting values that is never called gross: first order may be as wrong."""

_UNEVEN = 0.2
"""Mean or second harmonic, relative to the fundamental, that a centred motion does not have."""

_SOME = 3
"""So many points are no accident."""


def leaves_the_middle(points: Points) -> bool:
    """Tell whether some motions have a mean or a second harmonic that no noise explains."""
    even = np.abs(points.harmonics[:, 0:3:2]).max(axis=1) / points.amplitude
    return int(np.count_nonzero(even > _UNEVEN)) >= _SOME


def start_values(points: Points, law: ForceLaw, mass: float | None) -> LinearSolution:
    """Values to start from: first order, or the measured waveform where that fits better."""
    some = points.select(points.spread(2 * QUICK))
    first = _linear_start(some, law, mass, 1)
    if not is_strong(points):
        return first
    # in the balance of the fundamental along the measured waveform a law is as linear as it is written
    whole = _linear_start(some, law, mass, points.harmonics.shape[1] - 1)
    return whole if whole.misfit < first.misfit else first


def is_strong(points: Points) -> bool:
    """Tell whether some motions are so far from a sine that a balance of few harmonics may miss them."""
    higher = np.abs(points.harmonics[:, 2:]).max(axis=1, initial=0.0) / points.amplitude
    return int(np.count_nonzero(higher > _UNEVEN)) >= _SOME


def _linear_start(points: Points, law: ForceLaw, mass: float | None, order: int) -> LinearSolution:
    """All points, gross outliers with less weight, up to a harmonic of the measured waveform."""
    equations = Equations(
        points.omega,
        points.force,
        points.harmonics[:, : order + 1],
        not law.odd and 0 in points.measured,
        1 / np.abs(points.force),
        np.zeros((0, 2)),
    )
    weight = equations.weight
    for _ in range(3):
        solution = solve_equations(equations, law, mass)
        misfit = point_misfit(replace(equations, weight=weight), law, solution)
        typical = max(1.4826 * float(np.median(misfit)), _TYPICAL)
        factor = 1 / np.maximum(1.0, misfit / (_GROSS * typical)) ** 2
        if np.count_nonzero(factor < 0.25) <= 0.002 * len(points):
            break
        equations = replace(equations, weight=weight * factor)
    return solution


def fit_order(
    points: Points,
    law: ForceLaw,
    values: Array,
    mass: float,
    given: float | None,
    order: int,
    *,
    reject: bool,
    steps: int = 25,
) -> FittedModel:
    """Fit the balance up to the harmonic ``order`` from these values; ``given`` is the mass, None: free."""
    free = given is None
    return fit_balance(points, law, values, mass, mass_free=free, order=order, reject=reject, steps=steps)


def refine(
    points: Points, law: ForceLaw, start: LinearSolution, given: float | None
) -> tuple[FittedModel, bool]:
    """All harmonics that matter, and whether only the simulator has all of them."""
    values, mass = start.values, start.mass
    few = points.select(points.spread(QUICK)) if len(points) > 2 * QUICK else points
    sharp = law.rough or is_strong(points)
    for order in _ORDERS:
        refined = fit_order(few, law, values, mass, given, order, reject=True)
        values, mass = refined.values, refined.mass
        harmonics = np.abs(refined.harmonics[refined.regression.used])
        last = float(np.max(harmonics[:, -2:] / harmonics[:, 1:2], initial=0.0))
        enough = last < max(_TAIL, 1e-3 * refined.regression.noise / np.sqrt(len(points)))
        if law.switched or sharp or enough:
            break
    noise = refined.regression.noise
    sharp = (sharp or (law.switched and noise < _EXACT)) and noise > _ACCURACIES[-1]
    if few is points:
        return refined, sharp
    # what the simulator takes up needs no more than one step
    return fit_order(points, law, values, mass, given, order, reject=True, steps=1 if sharp else 25), sharp


def polish(points: Points, model: Model, law: ForceLaw, balanced: FittedModel) -> FittedModel:
    """Replace the balance by the simulator where the law has jumps or corners."""
    start, accuracy = balanced, _ACCURACIES[0]
    few = points.spread(QUICK)
    quick = fit_output(points.select(few), model, law, balanced.select(few), accuracy=accuracy)
    if quick is not None:
        near = replace(balanced.regression, parameters=quick.regression.parameters)
        start = replace(balanced, regression=replace(near, noise=quick.regression.noise))
        if quick.regression.noise < _RESOLVED * accuracy:
            accuracy = _ACCURACIES[1]
    whole = len(few) == len(points) and accuracy == _ACCURACIES[0]
    polished = quick if whole else fit_output(points, model, law, start, accuracy=accuracy)
    followed = np.count_nonzero(polished.regression.used) if polished is not None else 0
    if polished is None or followed < _FOLLOWED * np.count_nonzero(balanced.regression.used):
        return balanced
    both = polished.regression.used & balanced.regression.used
    misfit = [float(np.sqrt(np.mean(found.regression.misfit[both] ** 2))) for found in (polished, balanced)]
    return polished if misfit[0] <= _WORSE * misfit[1] else balanced


def enrich(points: Points, law: ForceLaw, followed: FittedModel, given: float | None) -> FittedModel:
    """Try more harmonics where the simulator did not settle on every branch of exact data."""
    balanced = followed
    for order in _ORDERS[1:]:
        balanced = fit_order(points, law, balanced.values, balanced.mass, given, order, reject=True)
    return min(followed, balanced, key=lambda found: found.regression.noise)
