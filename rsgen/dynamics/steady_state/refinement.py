"""From the coarse fixed point to the asked accuracy: finer steps where the error estimate wants them.

The Jacobian of the coarse map serves the fine ones, so that a refinement costs two or three periods. The
difference between two step sizes is the error estimate (Richardson), from which follows how many steps are
needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.dynamics.steady_state.fixed_point import correction, find_fixed_points, norm
from rsgen.dynamics.steady_state.period_map import Indices, PeriodMap
from rsgen.dynamics.steady_state.settling import SETTLED, UNSETTLED, Settling
from rsgen.dynamics.steady_state.step_grid import grid_above

__all__ = ["Refined", "refine"]

_ORDER = 4  # of the integration between events
_ORDER_OF_MEMORY = 2  # taken for the estimate: reversals and corners meet in one of the first coarse steps
_SAFETY = 0.5  # of the asked accuracy is what steps are chosen for
_FIRST = 24  # steps of the first of two answers that are compared
_COMPARED = 5  # harmonics from whose change the error follows
_PERIODS = 8  # with the coarse Jacobian, before a new one is made; of a transient before a look
_ROUNDS = 256  # of so many periods, for motions that only their transient leads to


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Steady states of n points: ``y`` (D, n), harmonics, peaks, residual and error relative to X."""

    y: Array
    harmonics: ComplexArray
    peak: Array
    residual: Array
    error: Array
    outcome: NDArray[np.int8]

    def replace(self, points: Indices, better: Refined) -> None:
        """Put other answers in the place of some points."""
        self.y[:, points] = better.y
        for name in ("harmonics", "peak", "residual", "error", "outcome"):
            getattr(self, name)[points] = getattr(better, name)


def refine(period_map: PeriodMap, settling: Settling, harmonics: int, accuracy: float) -> Refined:
    """Bring every settled point to ``accuracy``, or as near as the finest steps come; see the error."""
    n = settling.y.shape[1]
    result = Refined(
        y=settling.y.copy(),
        harmonics=np.full((n, harmonics + 1), complex(np.nan, np.nan)),
        peak=np.full((n, 2), np.nan),
        residual=np.full(n, np.nan),
        error=np.full(n, np.nan),
        outcome=settling.outcome.copy(),
    )
    jacobian = settling.jacobian.copy()
    points = np.flatnonzero(settling.outcome == SETTLED)
    steps = np.maximum(settling.steps, grid_above(np.maximum(_FIRST, 2.0 * harmonics + 2)))
    few = min(harmonics, _COMPARED)
    # the coarse fixed point belongs to other steps, or is good enough to be recorded at once
    late = 0 if len(points) and (steps[points] == settling.steps[points]).all() else 1
    _solve(period_map, result, jacobian, points, steps, 0.1 * accuracy, few, peaks=False, first_record=late)
    points = points[result.outcome[points] == SETTLED]
    finer = steps * 2
    while len(points):
        last = result.harmonics[points, : few + 1]
        _solve(
            period_map, result, jacobian, points, finer, 0.1 * accuracy, harmonics, peaks=True, first_record=1
        )
        result.error[points] = _estimate(result, points, last, finer[points] / steps[points])
        points = points[result.outcome[points] == SETTLED]
        points = points[~(result.error[points] <= accuracy)]
        steps[points] = finer[points]
        wanted = steps[points] * (result.error[points] / (_SAFETY * accuracy)) ** (1 / _ORDER)
        finer[points] = grid_above(wanted)
        points = points[finer[points] > steps[points]]
    return result


def _estimate(result: Refined, points: Indices, last: ComplexArray, ratio: Array) -> Array:
    """Relative error of the fundamental, from what the finer steps changed."""
    change = np.abs(result.harmonics[points, : last.shape[1]] - last)
    # a fundamental that hardly moved by chance does not hide the change of the other harmonics
    largest = np.maximum(change[:, 1], 0.25 * change.max(axis=1))
    amplitude = np.abs(result.harmonics[points, 1])
    relative = np.divide(largest, amplitude, out=np.zeros_like(largest), where=amplitude > 0)
    # one order less than between events: crossings located in different steps do not cancel
    order = _ORDER - 1 if len(result.y) == 2 else _ORDER_OF_MEMORY
    return np.asarray(relative / (ratio**order - 1) + result.residual[points])


def _repeat(
    period_map: PeriodMap,
    result: Refined,
    points: Indices,
    steps: NDArray[np.int64],
    tolerance: float,
    harmonics: int,
    *,
    peaks: bool,
) -> None:
    """Carry transients with their whole memory until they repeat: motions with loops within the loop."""
    for _ in range(_ROUNDS if len(points) else 0):
        moved = period_map.carry(
            points, result.y[:, points], steps, _PERIODS, harmonics, peaks=peaks, transient=True
        )
        size = np.maximum(norm(moved.state), period_map.scale()[points])
        last, before = norm(moved.state - moved.history[1]), norm(moved.history[1] - moved.history[0])
        share = np.divide(last, before, out=np.zeros_like(last), where=before > last)
        result.y[:, points], result.residual[points] = moved.state, last / size
        result.harmonics[points, : harmonics + 1] = moved.harmonics
        if peaks:
            result.peak[points] = moved.peak
        # what is still to come of a geometric approach
        left = ~(last * np.maximum(share / (1 - share), 1.0) <= tolerance * size)
        points, steps = points[left], steps[left]
        if not len(points):
            return
    result.outcome[points] = UNSETTLED


def _solve(
    period_map: PeriodMap,
    result: Refined,
    jacobian: Array,
    points: Indices,
    steps: NDArray[np.int64],
    tolerance: float,
    harmonics: int,
    *,
    peaks: bool,
    first_record: int,
) -> None:
    """Find the fixed points of the map with these steps, and record their period.

    Recording costs, so it begins with turn ``first_record``, when the corrections have become small.
    """
    if period_map.memory is not None:
        inner = period_map.memory.has_inner_loops(points)
        _repeat(period_map, result, points[inner], steps[points[inner]], tolerance, harmonics, peaks=peaks)
        points = points[~inner]
    active, here, mine = points, result.y[:, points], steps[points]
    slope, least = jacobian[:, :, points], period_map.scale()[points]
    for turn in range(2 * _PERIODS):
        if not len(active):
            return
        if turn == _PERIODS:
            fixed = find_fixed_points(period_map, active, here, mine, tolerance, least)
            here, slope = fixed.y, fixed.jacobian
            jacobian[:, :, active] = slope
        record = harmonics if turn >= first_record else None
        moved = period_map.carry(active, here, mine, 1, record, peaks=peaks and record is not None)
        residual = moved.state - here
        move = correction(slope, residual)
        length = norm(move)
        finite = np.isfinite(length)
        there = here + move if finite.all() else here + np.where(finite, move, 0.0)
        if record is not None:
            size = np.maximum(norm(here), least)
            done = length <= tolerance * size
            ready = slice(None) if done.all() else done
            at = active[ready]
            result.y[:, at] = there[:, ready]
            result.harmonics[at, : harmonics + 1] = moved.harmonics[ready]
            result.residual[at] = (norm(residual) / size)[ready]
            if peaks:
                result.peak[at] = moved.peak[ready]
            if done.all():
                return
            left = ~done
            active, mine, least = active[left], mine[left], least[left]
            slope, there = slope[:, :, left], there[:, left]
        here = there
    result.y[:, active] = here
    result.outcome[active] = UNSETTLED
