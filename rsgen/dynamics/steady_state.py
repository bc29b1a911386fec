"""Steady states of an oscillator under harmonic force, from rest or from given states, to an asked accuracy.

    m x'' + n(x, x', z) = Re F exp(i omega t),    x(t + T) = x(t),    T = 2 pi/omega

1. ``settling`` finds with 24 steps a period to which fixed point of the period map each point goes.
2. ``refine`` seeks that fixed point again with more steps. The Jacobian of the coarse map serves Newton's
   method (chord method), so that no transient is repeated and a refinement costs two or three periods.
3. Answers of n and r n steps a period differ by r^p - 1 times the error of the finer one, p the order of
   the integration (Richardson; Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, 1993,
   Sec. II.4). From this error follows the next number of steps, until it is below the accuracy.
4. A fixed point that the finer map does not have was one of the coarse steps: from the start again, finer.

The transient decides the branch and may be coarse; accuracy costs a period only. Points are independent of
each other and are solved in batches on all cores.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.declaration import Rule
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import MISFIT_OF_NOISE
from rsgen.data.oscillator import Oscillator, refuse_across
from rsgen.data.surface.response_surface import Outcome
from rsgen.dynamics.fixed_point import (
    Indices,
    LoopMemory,
    PeriodMap,
    Sticking,
    Stiffness,
    correction,
    find_fixed_points,
    norm,
    units_of_states,
)
from rsgen.dynamics.kernel import Kernel, compile_kernel
from rsgen.dynamics.settling import (
    COARSE_STEPS,
    FINER_STEPS,
    Settling,
    SteadyStates,
    grid_above,
    settle,
)

# ----------------------------------------------------------------------------
# Batches of points: they bound the memory, and all cores work.

MAX_BATCH_POINTS = 16384  # points worked on at once; the larger, the less threads wait for one another
_MIN_BATCH_POINTS = 256  # below, another thread costs more than it saves

Answer = TypeVar("Answer")


def map_batches(work: Callable[[slice], Answer], count: int) -> list[Answer]:
    """Call ``work`` for slices that cover ``count`` points, on all cores; answers in the order of the points.

    ``RSGEN_THREADS`` is the number of cores; where it is not set, all of this process.
    """
    cores = _threads()
    batches = max(-(-count // MAX_BATCH_POINTS), min(cores, count // _MIN_BATCH_POINTS), 1)
    # as many batches as fill the cores evenly
    batches = batches if batches < cores else -(-batches // cores) * cores
    edges = [count * i // batches for i in range(batches + 1)]
    slices = [slice(low, high) for low, high in pairwise(edges)]
    if batches == 1 or cores == 1:
        return [work(part) for part in slices]
    # numpy keeps its error state in the context
    waiting = [_pool(os.getpid(), cores).submit(copy_context().run, work, part) for part in slices]
    return [done.result() for done in waiting]


def _threads() -> int:
    chosen = os.environ.get("RSGEN_THREADS", "")
    if chosen.isdigit() and int(chosen) > 0:
        return int(chosen)
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1


@lru_cache(maxsize=1)
def _pool(process: int, count: int) -> ThreadPoolExecutor:
    # the process is part of the key: threads do not survive a fork
    return ThreadPoolExecutor(count, thread_name_prefix="rsgen-batch")


# ----------------------------------------------------------------------------
# From the coarse fixed point to the asked accuracy: finer steps where the error estimate wants them.

ORDER = 4
"""Of the integration between events."""

_ORDER_OF_MEMORY = 2
"""Assumed for laws with memory: several reversals and corners may meet in one of the first coarse steps."""

_AIMED_SHARE = 0.5
"""Of the asked accuracy: the error for which steps are chosen."""

_COMPARED_HARMONICS = 5
"""Harmonics from whose change the error follows."""

_PERIODS_PER_LOOK = 8
"""Periods with the coarse Jacobian before a new one is made, or of a transient before it is looked at."""

_MAX_LOOKS = 256
"""Looks at motions that only their transient leads to."""

_MAX_DEPARTURE_TO_MOTION = 1e3
"""Size of a motion relative to that of the coarse fixed point, beyond which it is none of that point's."""


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
    points = np.flatnonzero(settling.outcome == Outcome.SETTLED)
    steps = np.maximum(settling.steps, grid_above(np.maximum(COARSE_STEPS, 2.0 * harmonics + 2)))
    few = min(harmonics, _COMPARED_HARMONICS)
    # the coarse fixed point belongs to other steps, or is good enough to be recorded at once
    late = 0 if len(points) and (steps[points] == settling.steps[points]).all() else 1
    _solve(period_map, result, jacobian, points, steps, 0.1 * accuracy, few, peaks=False, first_record=late)
    points = points[result.outcome[points] == Outcome.SETTLED]
    finer = steps * 2
    while len(points):
        last = result.harmonics[points, : few + 1]
        _solve(
            period_map, result, jacobian, points, finer, 0.1 * accuracy, harmonics, peaks=True, first_record=1
        )
        result.error[points] = _estimate(result, points, last, finer[points] / steps[points])
        points = points[result.outcome[points] == Outcome.SETTLED]
        points = points[~(result.error[points] <= accuracy)]
        steps[points] = finer[points]
        wanted = steps[points] * (result.error[points] / (_AIMED_SHARE * accuracy)) ** (1 / ORDER)
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
    order = ORDER - 1 if len(result.y) == 2 else _ORDER_OF_MEMORY
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
    largest = _MAX_DEPARTURE_TO_MOTION * np.maximum(norm(result.y), period_map.scale())
    for _ in range(_MAX_LOOKS if len(points) else 0):
        moved = period_map.carry(
            points, result.y[:, points], steps, _PERIODS_PER_LOOK, harmonics, peaks=peaks, transient=True
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
        bounded = norm(moved.state) <= largest[points]
        result.outcome[points[~bounded]] = Outcome.DIVERGED
        points, steps = points[left & bounded], steps[left & bounded]
        if not len(points):
            return
    result.outcome[points] = Outcome.UNSETTLED


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
    largest = _MAX_DEPARTURE_TO_MOTION * np.maximum(norm(here), least)
    for turn in range(2 * _PERIODS_PER_LOOK):
        if not len(active):
            return
        if turn == _PERIODS_PER_LOOK:
            fixed = find_fixed_points(period_map, active, here, mine, tolerance, least)
            here, slope = fixed.y, fixed.jacobian
            jacobian[:, :, active] = slope
        record = harmonics if turn >= first_record else None
        moved = period_map.carry(active, here, mine, 1, record, peaks=peaks and record is not None)
        residual = moved.state - here
        move = correction(slope, residual)
        length = norm(move)
        # nearly singular, a step may lead to any amplitude: the motion stays, and the next derivatives decide
        near = norm(here + move) <= largest
        there = here + np.where(near, move, 0.0)
        if record is not None:
            size = np.maximum(norm(here), least)
            done = near & (length <= tolerance * size)
            at, left = active[done], ~done
            result.y[:, at] = there[:, done]
            result.harmonics[at, : harmonics + 1] = moved.harmonics[done]
            result.residual[at] = (norm(residual) / size)[done]
            if peaks:
                result.peak[at] = moved.peak[done]
            active, mine, least, largest = active[left], mine[left], least[left], largest[left]
            slope, there = slope[:, :, left], there[:, left]
        here = there
    result.y[:, active] = here
    result.outcome[active] = Outcome.UNSETTLED


ACCURACY = Rule("Largest relative error of the fundamental.", at_least=1e-9, at_most=1e-2)
HARMONICS = Rule("Harmonics of the displacement, without the mean.", at_least=1, at_most=64)

USUAL_ACCURACY = MISFIT_OF_NOISE
"""Relative error of the fundamental unless another is asked for."""

USUAL_HARMONICS = 7
"""Harmonics of the displacement unless others are asked for: three odd ones above the fundamental."""

LOCATING_ACCURACY = 2e-6
"""Below this accuracy, jumps of the curvature of a law are located, too."""


def solve_steady_states(
    oscillator: Oscillator,
    force: ArrayLike,
    frequency: ArrayLike,
    *,
    harmonics: int = USUAL_HARMONICS,
    accuracy: float = USUAL_ACCURACY,
    start: ArrayLike | None = None,
    briefly: bool = False,
) -> SteadyStates:
    """Find where the response to f(t) = Re F exp(i omega t) repeats with the period of the force.

    Parameters
    ----------
    force, frequency
        (n,) complex amplitude F [N], and [Hz], positive.
    harmonics
        H, how many harmonics of the displacement are returned, in addition to the mean.
    accuracy
        Largest relative error of the fundamental, 1e-9 to 1e-2.
    start
        (n, 2) displacement [m] and velocity [m/s] at t = 0 from which each point starts, memories at rest; or
        (n, D) as ``SteadyStates.state``. None: from rest.
    briefly
        True: what has not settled after some 128 periods is not followed further.

    Raises
    ------
    RsgenError
        Shapes do not fit, a frequency is not positive, harmonics or accuracy are out of range. An element
        acts across two sensors.
    """
    refuse_across(oscillator.sensors, simulation=True)
    F = np.atleast_1d(np.asarray(force, dtype=np.complex128))
    f = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    _check(F, f, harmonics, accuracy)
    y = None if start is None else np.asarray(start, dtype=np.float64)
    compiled = partial(compile_kernel, oscillator.force, values=oscillator.values)
    kernel = compiled(locate_all=accuracy < LOCATING_ACCURACY)
    rows = kernel.rows
    coarse = compiled(coarse=True) if rows.curves else kernel
    if y is not None and y.shape not in {(len(f), 2), (len(f), rows.smooth + rows.curves)}:
        raise RsgenError(f"start: shape {y.shape}; must be ({len(f)}, 2), displacement and velocity")
    if y is not None and not np.isfinite(y).all():
        raise RsgenError("start: must be finite everywhere")
    values = np.array([oscillator.values[name] for name in kernel.parameters])
    parts, omega = np.column_stack([F.real, F.imag]), 2 * np.pi * f
    units = units_of_states(oscillator, F, omega)
    stiffness, sticking = Stiffness.of(oscillator), Sticking.of(oscillator)

    def solve(batch: slice) -> SteadyStates:
        period_map = PeriodMap(
            kernel, oscillator.mass, values, parts[batch], omega[batch], units,
            stiffness=stiffness, sticking=sticking,
        )  # fmt: skip
        begin = None if y is None else y[batch]
        return _solve_batch(period_map, coarse, begin, harmonics, accuracy, briefly)

    done = map_batches(solve, len(f))
    return done[0] if len(done) == 1 else SteadyStates.joined(done)


def _check(force: ComplexArray, frequency: Array, harmonics: int, accuracy: float) -> None:
    if force.shape != frequency.shape or force.ndim != 1:
        raise RsgenError(f"force, frequency: shapes {force.shape}, {frequency.shape}; must be (n,) both")
    if not np.isfinite(force).all():
        raise RsgenError("force: must be finite everywhere")
    if not np.all(np.isfinite(frequency) & (frequency > 0)):
        raise RsgenError("frequency: must be positive and finite everywhere [Hz]")
    for name, rule, value in (("harmonics", HARMONICS, harmonics), ("accuracy", ACCURACY, accuracy)):
        if fault := rule.fault(value):
            raise RsgenError(f"{name}: {fault}")


def _solve_batch(
    period_map: PeriodMap, coarse: Kernel, start: Array | None, harmonics: int, accuracy: float, briefly: bool
) -> SteadyStates:
    """Solve points of one kernel: coarse steps find where each settles, finer ones refine that.

    A point that settles on the coarse map alone is looked for again with finer steps.
    """
    omega, units = period_map.omega, period_map.units
    rows = period_map.kernel.rows
    y = np.zeros((rows.smooth, len(omega)))
    if start is not None:
        given = min(start.shape[1], rows.smooth)
        y[:given] = start.T[:given]
        y[1] /= omega
        y /= units[:, None]
    offsets = np.zeros((0, len(omega))) if start is None else start.T[rows.smooth :]
    memory = LoopMemory.at_start(rows, offsets, len(omega)) if rows.curves else None
    period_map = replace(period_map, memory=memory)
    # far unstable motions overflow on their way; their outcome is not settled
    with np.errstate(over="ignore", invalid="ignore"):
        rough = replace(period_map, kernel=coarse)
        settling = settle(rough, y, from_rest=start is None, briefly=briefly)
        refined = refine(period_map, settling, harmonics, accuracy)
        # a fixed point of the coarse map that the finer ones do not have: look again with finer steps
        lost = np.flatnonzero((settling.outcome == Outcome.SETTLED) & (refined.outcome != Outcome.SETTLED))
        if len(lost):
            few = period_map.of(lost)
            if memory is not None:
                few = replace(few, memory=LoopMemory.at_start(rows, offsets[:, lost], len(lost)))
            again = settle(few, y[:, lost], from_rest=start is None, steps=FINER_STEPS * COARSE_STEPS)
            refined.replace(lost, refine(few, again, harmonics, accuracy))
            if memory is not None and few.memory is not None:
                memory.put(lost, few.memory)
    state = refined.y.T * units
    state[:, 1] *= omega
    if memory is not None:
        state = np.hstack([state, memory.offsets.T])
    unsettled = np.flatnonzero(refined.outcome)
    refined.harmonics[unsettled] = complex(np.nan, np.nan)
    refined.peak[unsettled] = np.nan
    return SteadyStates(
        refined.harmonics, refined.peak, state, refined.residual, refined.outcome, refined.error
    )
