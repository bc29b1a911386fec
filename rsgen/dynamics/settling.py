"""Which of several steady states a motion reaches from its start.

    y_(n+1) = P(y_n),    y* = P(y*),    y_(n+1) - y* = J (y_n - y*)  close to y*

Newton's method alone may find any fixed point, stable or not; a transient alone takes as many periods as the
damping is small. Both together (``settle``), in rounds that are about twice as long each time:

1. The transient is carried over the periods of the round. What overflows, with shorter steps too, diverges.
2. Newton's method looks for the fixed point y* near its end. The motion has settled if y* attracts
   (``fixed_point``), if the last two periods obeyed the linear map J to 5 % (under a Masing law without an
   inner loop in the last), and if states at three more places of the circle about y* obey it to 10 %: the
   motion spirals through them, and a stop or a gap in another direction could still lead elsewhere. Under
   friction whose sliders all stick, y* is first sought with the sliders held.
3. A motion that repeats to 1e-9 has settled, whatever J is.
4. What repeats after two periods, and not after one, has period two. All others are carried on.

``refine`` of ``steady_state`` judges again, with finer steps: it may find a settled motion not settled.

Period map and basins of attraction: J. M. T. Thompson and H. B. Stewart, Nonlinear Dynamics and Chaos (2002);
the rule of acceptance is rsgen's own, and tests hold it against transients of 20 000 periods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.surface.response_surface import Outcome
from rsgen.dynamics.fixed_point import (
    ORBIT_OFFSET,
    FixedPoints,
    HeldMemory,
    Indices,
    LoopMemory,
    PeriodMap,
    attraction,
    find_fixed_points,
    jacobians,
    norm,
    times,
)

# ----------------------------------------------------------------------------
# Numbers of steps in a period on offer: few different ones fill the batches.

_GRID = np.array([24 * 2**k for k in range(10)] + [32 * 2**k for k in range(10)])
_GRID.sort()


def grid_above(wanted: float | Array) -> NDArray[np.int64]:
    """The next number of steps on offer."""
    return np.asarray(_GRID[np.minimum(np.searchsorted(_GRID, wanted), len(_GRID) - 1)])


@dataclass(frozen=True, slots=True, eq=False)
class SteadyStates:
    """Steady states of an oscillator under harmonic force; n points, H harmonics.

    Parameters
    ----------
    harmonics
        (n, H+1) complex displacement [m], x(t) = Re sum_h X_h exp(i h omega t); column 0 is the mean (real).
        NaN where the outcome is not 0.
    peak
        (n, 2) largest and smallest displacement in a period [m].
    state
        (n, D) displacement [m] and velocity [m/s] at t = 0, the start of a period; then, for a law with
        memory, what it remembers there [SI].
    residual
        (n,) how far the state is from repeating after one period, relative to the amplitude [1].
    outcome
        (n,) an ``Outcome``; 0 is settled.
    error
        (n,) estimated relative error of the fundamental [1].
    """

    harmonics: ComplexArray
    peak: Array
    state: Array
    residual: Array
    outcome: NDArray[np.int8]
    error: Array

    def __post_init__(self) -> None:
        for entry in fields(self):
            array: NDArray[Any] = getattr(self, entry.name)
            array.flags.writeable = False

    def __len__(self) -> int:
        """Count the points."""
        return len(self.outcome)

    @property
    def settled(self) -> NDArray[np.bool_]:
        """(n,) True where the response repeats with the period of the force."""
        return np.equal(self.outcome, Outcome.SETTLED)

    @classmethod
    def joined(cls, parts: Sequence[Self], order: NDArray[np.intp] | None = None) -> Self:
        """Put parts one after the other, then take the points in an order."""
        names = [entry.name for entry in fields(cls)]
        whole = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return cls(**(whole if order is None else {name: array[order] for name, array in whole.items()}))


@dataclass(frozen=True, slots=True, eq=False)
class ControlledStates(SteadyStates):
    """Periodic motions of given fundamental amplitude: steady states whose ``error`` is that of the force.

    ``force`` (n,) [N] holds the fundamental at X [m], whose phase is zero; ``stable`` (n,) is True where the
    motion attracts its neighbours when this force is held constant.
    """

    force: ComplexArray
    stable: NDArray[np.bool_]


COARSE_STEPS = 24
"""Steps a period: enough to separate branches; accuracy comes afterwards."""

FINER_STEPS = 8
"""Times as many steps before a motion is called unbounded or a fixed point lost."""

_ROUNDS_FROM_REST = (8, 8, 16, 32, 64, 128, 256, 512, 1024, 2048)
_ROUNDS_FROM_STATE = (2, 4, 10, 16, 32, 64, 128, 256, 512, 1024, 2048)
"""Periods of each round, about twice as many each time; a start near the answer is recognised earlier."""

_REFINED_FROM, _REFINEMENT = 128, 4
"""Periods of the round from which on there are four times as many steps: a corner that is just touched is met
or missed with the place of the steps."""

_MAX_LAST_STEP = 1e-3
"""Last Newton correction, relative to the amplitude: what is left is its square."""

_MAX_DEPARTURE = 0.05
"""Departure of the last two periods from the linear map, relative to the distance from the fixed point."""

_MAX_DEPARTURE_AROUND, _MIN_DISTANCE_AROUND = 0.1, 1e-3
"""The same all around the fixed point, and the distance of the motion from it, relative to the amplitude,
from which on that is asked."""

_WEAK_ATTRACTION, _STEPS_OF_WEAK, _OFFSET_OF_WEAK, _MIN_ATTRACTION = 1e-3, 256, 1e-7, 1e-7
"""The steps of the integration damp a little. Below the first of attraction (``fixed_point``) the Jacobian is
made again with this many steps and this offset; the point attracts if there is more than the last."""

_MAX_CHANGE_OF_REPEATED = 1e-9
"""A motion that repeats this well has arrived, whatever the Jacobian is."""

_MAX_CHANGE_OF_PERIOD_TWO = 1e-6
"""A motion that repeats after two periods this well, and after one a thousand times worse, has period two."""

_MAX_GROWTH = 1.5
"""Times the amplitude at the start of a round, for which its steps are stable."""

_LEAST_TO_DRIVEN = 2.5e-7
"""Least size of a motion (``PeriodMap.scale``), relative to four times what the force makes of the mass
alone."""


@dataclass(frozen=True, slots=True, eq=False)
class Settling:
    """Where n points settled on the coarse map: ``y`` (D, n), ``jacobian`` (D, D, n), steps, outcome."""

    y: Array
    jacobian: Array
    steps: NDArray[np.int64]
    outcome: NDArray[np.int8]


def settle(
    period_map: PeriodMap, start: Array, *, from_rest: bool, steps: int = COARSE_STEPS, briefly: bool = False
) -> Settling:
    """Carry n points from ``start`` (D, n) until each has settled or not, 128 periods if briefly."""
    size, n = start.shape
    result = Settling(
        y=start.copy(),
        jacobian=np.zeros((size, size, n)),
        steps=np.full(n, steps),
        outcome=np.full(n, Outcome.UNSETTLED, dtype=np.int8),
    )
    least = period_map.scale()
    active = np.arange(n)
    for periods in _ROUNDS_FROM_REST if from_rest else _ROUNDS_FROM_STATE:
        if periods == _REFINED_FROM:
            if briefly:
                break
            result.steps[active] *= _REFINEMENT
        active = _one_round(period_map, result, active, periods, least)
        if not len(active):
            break
    return result


def _one_round(
    period_map: PeriodMap, result: Settling, active: Indices, periods: int, least: Array
) -> Indices:
    """Carry points over some periods and record what became of them; return those that go on.

    ``least`` (n,) [m] is the size of a motion below which it is taken for rest.
    """
    if period_map.stiffness is not None:
        # states that follow fast need short steps; the motion may still grow in this round
        largest = np.maximum(_MAX_GROWTH * norm(result.y[:2, active]), least[active] / _LEAST_TO_DRIVEN)
        wanted = period_map.stiffness.steps(largest, period_map.omega[active])
        result.steps[active] = np.maximum(result.steps[active], grid_above(wanted))
    before, steps = result.y[:, active], result.steps[active]
    memory = None if period_map.memory is None else period_map.memory.rows[:, active]
    moved = period_map.carry(active, before, steps, periods, transient=True)
    y, history = moved.state, moved.history
    bounded = np.isfinite(norm(y))
    for _ in range(2):
        lost = np.flatnonzero(~bounded & (steps < COARSE_STEPS * FINER_STEPS**2))
        if not len(lost):
            break
        # too few steps make a stiff law explode: that is no answer yet
        steps[lost] *= FINER_STEPS
        if period_map.memory is not None and memory is not None:
            period_map.memory.rows[:, active[lost]] = memory[:, lost]
        again = period_map.carry(active[lost], before[:, lost], steps[lost], periods, transient=True)
        y[:, lost], history[:, :, lost] = again.state, again.history
        bounded = np.isfinite(norm(y))
    result.steps[active], result.y[:, active] = steps, y
    result.outcome[active[~bounded]] = Outcome.DIVERGED
    active, y, history = active[bounded], y[:, bounded], history[:, :, bounded]
    settled = _accept_sticking(period_map, result, active, y, history, least[active])
    left = np.flatnonzero(~settled)
    settled[left] = _accept_moving(
        period_map, result, active[left], y[:, left], history[:, :, left], least[active[left]]
    )
    left = np.flatnonzero(~settled)
    size = np.maximum(norm(y[:, left]), least[active[left]])
    two_ago, one_ago = norm(y[:, left] - history[0][:, left]), norm(y[:, left] - history[1][:, left])
    repeats = two_ago < _MAX_CHANGE_OF_PERIOD_TWO * size
    twice = repeats & (one_ago > 1e3 * _MAX_CHANGE_OF_PERIOD_TWO * size)
    result.outcome[active[left[twice]]] = Outcome.PERIOD_TWO
    return active[left[~twice]]


def _accept_moving(
    period_map: PeriodMap, result: Settling, active: Indices, y: Array, history: Array, least: Array
) -> NDArray[np.bool_]:
    """Record the points that are on their way to an attracting fixed point, or repeat to round-off.

    ``y`` (D, k) are their states after a round, ``history`` (2, D, k) those two periods and one before.
    Return the mask (k,) of these points.
    """
    steps = result.steps[active]
    fixed = find_fixed_points(period_map, active, y, steps, _MAX_LAST_STEP, least)
    inner_loops = np.zeros(len(active), dtype=bool)
    if period_map.memory is not None:
        # loops within the loop are not those of the closed loop alone
        inner_loops = period_map.memory.has_inner_loops(active)
    reached = _is_reached(period_map, active, fixed, y, history, least, steps, ~inner_loops)
    close = _MAX_CHANGE_OF_REPEATED * np.maximum(norm(fixed.y), least)
    repeats = (norm(y - history[1]) <= close) & (norm(y - history[0]) <= close)
    settled = np.asarray(reached | repeats)
    result.y[:, active[reached]] = fixed.y[:, reached]
    result.jacobian[:, :, active[settled]] = fixed.jacobian[:, :, settled]
    result.outcome[active[settled]] = Outcome.SETTLED
    return settled


def _accept_sticking(
    period_map: PeriodMap, result: Settling, active: Indices, y: Array, history: Array, least: Array
) -> NDArray[np.bool_]:
    """Record the points at which nothing slips any more, on the way to the steady state and in it.

    With the sliders held the law is straight, and its fixed point exact. It counts if nothing slips there
    while the free vibration that is left decays, and if the closed loop between its peaks has the same one.
    """
    memory, sticking, settled = period_map.memory, period_map.sticking, np.zeros(len(active), dtype=bool)
    if memory is None or sticking is None:
        return settled
    layout, first = memory.layout, memory.layout.first
    middle, offset = memory.middle(active, sticking.slope)
    here = np.flatnonzero(sticking.reaches(middle, y[first], y[first + 1]))
    if not len(here):
        return settled
    points, middle, offset, steps = active[here], middle[here], offset[here], result.steps[active[here]]
    before, history = y[:first, here], history[:, :first, here]
    least, all_here = least[here], np.arange(len(here))
    held = replace(period_map.of(points), memory=HeldMemory.at(layout, middle, offset))
    fixed = find_fixed_points(held, all_here, before, steps, _MAX_LAST_STEP, least, spared=True)
    peak = held.carry(all_here, fixed.y, steps, 1, 1, peaks=True).peak
    # the free vibration that is left may bring its greatest to any peak
    swing = _swing(before - fixed.y, fixed.jacobian)
    stays = sticking.reaches(middle, peak[:, 0] + swing, peak[:, 1] - swing)
    sure = np.flatnonzero(_is_reached(held, all_here, fixed, before, history, least, steps, stays))
    # the same as a closed loop, as all that follows has it
    points, peak, least, steps = points[sure], peak[sure], least[sure], steps[sure]
    force = offset[sure] + sticking.slope * (peak.mean(axis=1) - middle[sure])
    closed = LoopMemory.closed(layout, force[None])
    start = np.concatenate([fixed.y[:, sure], peak.T])
    alone = replace(period_map.of(points), memory=closed)
    found = find_fixed_points(alone, np.arange(len(points)), start, steps, _MAX_LAST_STEP, least)
    same = norm(found.y[:first] - start[:first]) <= _MAX_LAST_STEP * np.maximum(norm(start[:first]), least)
    kept = np.flatnonzero(found.found & same)
    result.y[:, points[kept]], result.jacobian[:, :, points[kept]] = (
        found.y[:, kept], found.jacobian[:, :, kept],
    )  # fmt: skip
    memory.put(points[kept], closed.of(kept))
    result.outcome[points[kept]] = Outcome.SETTLED
    settled[here[sure[kept]]] = True
    return settled


def _swing(away: Array, jacobian: Array) -> Array:
    """(k,) amplitude of the displacement of free vibrations that begin with ``away`` (D, k).

    Their path is an ellipse in displacement and velocity, whose axes follow from the map of a period.
    """
    square = -np.divide(jacobian[0, 1], jacobian[1, 0], out=-np.ones(len(away[0])), where=jacobian[1, 0] != 0)
    return np.asarray(np.hypot(away[0], np.sqrt(np.where(square > 0, square, 1.0)) * away[1]))


def _is_reached(
    period_map: PeriodMap,
    points: Indices,
    fixed: FixedPoints,
    y: Array,
    history: Array,
    least: Array,
    steps: NDArray[np.int64],
    possible: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return where the motion goes on to its fixed point (k,), among those where it is ``possible``: the
    second of the conditions of this module.
    """
    size = np.maximum(norm(fixed.y), least)
    earlier, away = history[0] - fixed.y, y - fixed.y
    departure = norm(away - times(fixed.jacobian, times(fixed.jacobian, earlier)))
    distance, inside = norm(earlier), attraction(fixed.jacobian)
    # nearer than the neighbouring orbits J is no better than the departure
    linear = (departure <= _MAX_DEPARTURE * distance + ORBIT_OFFSET * size) & (distance < size)
    sure = fixed.found & linear & (inside > 0) & possible
    faint = np.flatnonzero(sure & (inside < _WEAK_ATTRACTION))
    if len(faint):
        # the integration itself damps a little: look with steps so fine that it does not
        fine = np.maximum(_STEPS_OF_WEAK, steps[faint])
        _, jacobian = jacobians(
            period_map, points[faint], fixed.y[:, faint], fine, _OFFSET_OF_WEAK * size[faint]
        )
        sure[faint] = attraction(jacobian) > _MIN_ATTRACTION
    wide = np.flatnonzero(sure & (norm(away) > _MIN_DISTANCE_AROUND * size))
    if len(wide):
        around, slope = fixed.y[:, wide], fixed.jacobian[:, :, wide]
        sure[wide] = _is_linear_around(period_map, points[wide], around, slope, away[:, wide], steps[wide])
    return sure


def _is_linear_around(
    period_map: PeriodMap,
    points: Indices,
    center: Array,
    jacobian: Array,
    away: Array,
    steps: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Find where the map is linear opposite the motion and a quarter turn to both sides of it, around y*.

    The last periods only show one direction; in another one a stop or a gap may still be met.
    """
    turned = np.zeros_like(away)
    turned[0], turned[1] = -away[1], away[0]
    along, across = times(jacobian, away), times(jacobian, turned)
    rays = np.concatenate([center - away, center + turned, center - turned], axis=1)
    predicted = np.concatenate([center - along, center + across, center - across], axis=1)
    departure = norm(period_map.carry(points, rays, steps, 1).state - predicted).reshape(3, -1).max(axis=0)
    return np.asarray(departure <= _MAX_DEPARTURE_AROUND * norm(away))
