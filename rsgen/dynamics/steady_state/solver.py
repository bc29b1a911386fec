"""Steady states of an oscillator, from rest or near given states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.declaration import Rule
from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.kernel import Kernel, compile_kernel
from rsgen.dynamics.steady_state.batches import map_batches
from rsgen.dynamics.steady_state.loop_memory import LoopMemory
from rsgen.dynamics.steady_state.memory_units import Stiffness, units_of_states
from rsgen.dynamics.steady_state.period_map import PeriodMap
from rsgen.dynamics.steady_state.refinement import refine
from rsgen.dynamics.steady_state.settling import COARSE, SETTLED, settle
from rsgen.dynamics.steady_state.solution import SteadyStates
from rsgen.dynamics.steady_state.sticking import Sticking

__all__ = [
    "ACCURACY",
    "HARMONICS",
    "LOCATED",
    "USUAL_ACCURACY",
    "USUAL_HARMONICS",
    "solve_steady_states",
]

ACCURACY = Rule("Largest relative error of the fundamental.", at_least=1e-9, at_most=1e-2)
HARMONICS = Rule("Harmonics of the displacement, the mean apart.", at_least=1, at_most=64)

USUAL_ACCURACY = 1e-4
"""Relative error of the fundamental unless another is asked for: a tenth of ``NOTICEABLE``."""

USUAL_HARMONICS = 7
"""Harmonics of the displacement unless others are asked for: three odd ones above the fundamental."""

LOCATED = 2e-6  # below this accuracy, jumps of the curvature of a law are located too
_SECOND_LOOK = 8  # times the steps of the first transient


def solve_steady_states(
    oscillator: Oscillator,
    force: ArrayLike,
    frequency: ArrayLike,
    *,
    harmonics: int = USUAL_HARMONICS,
    accuracy: float = USUAL_ACCURACY,
    start: ArrayLike | None = None,
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

    Raises
    ------
    RsgenError
        Shapes do not fit, a frequency is not positive, harmonics or accuracy are out of range.
    """
    F = np.atleast_1d(np.asarray(force, dtype=np.complex128))
    f = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    _check(F, f, harmonics, accuracy)
    y = None if start is None else np.asarray(start, dtype=np.float64)
    kernel = compile_kernel(oscillator.force, values=oscillator.values, locate_all=accuracy < LOCATED)
    rows = kernel.rows
    coarse = kernel
    if rows.curves:
        coarse = compile_kernel(oscillator.force, values=oscillator.values, coarse=True)
    if y is not None and y.shape not in {(len(f), 2), (len(f), rows.smooth + rows.curves)}:
        raise RsgenError(f"start: shape {y.shape}; must be ({len(f)}, 2), displacement and velocity")
    if y is not None and not np.isfinite(y).all():
        raise RsgenError("start: must be finite everywhere")
    values = np.array([oscillator.values[name] for name in kernel.parameters])
    parts = np.column_stack([F.real, F.imag])
    omega = 2 * np.pi * f
    units, stiffness = units_of_states(oscillator, F, omega), Stiffness.of(oscillator)
    sticking = Sticking.of(oscillator)

    def solve(batch: slice) -> SteadyStates:
        period_map = PeriodMap(
            kernel, oscillator.mass, values, parts[batch], omega[batch], units,
            stiffness=stiffness, sticking=sticking,
        )  # fmt: skip
        return _solve_batch(period_map, coarse, None if y is None else y[batch], harmonics, accuracy)

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
    period_map: PeriodMap, coarse: Kernel, start: Array | None, harmonics: int, accuracy: float
) -> SteadyStates:
    omega, units = period_map.omega, period_map.units
    rows = period_map.kernel.rows
    y = np.zeros((rows.smooth, len(omega)))
    if start is not None:
        given = min(start.shape[1], rows.smooth)
        y[:given] = start.T[:given]
        y[1] /= omega
        if units is not None:
            y /= units[:, None]
    offsets = np.zeros((0, len(omega))) if start is None else start.T[rows.smooth :]
    memory = LoopMemory.at_start(rows, offsets, len(omega)) if rows.curves else None
    period_map = replace(period_map, memory=memory)
    # far unstable motions overflow on their way; their outcome is not settled
    with np.errstate(over="ignore", invalid="ignore"):
        settling = settle(replace(period_map, kernel=coarse), y, from_rest=start is None)
        refined = refine(period_map, settling, harmonics, accuracy)
        # a fixed point of the coarse map that the finer ones do not have: look again with finer steps
        lost = np.flatnonzero((settling.outcome == SETTLED) & (refined.outcome != SETTLED))
        if len(lost):
            few = period_map.of(lost)
            if memory is not None:
                few = replace(few, memory=LoopMemory.at_start(rows, offsets[:, lost], len(lost)))
            again = settle(few, y[:, lost], from_rest=start is None, steps=_SECOND_LOOK * COARSE)
            refined.replace(lost, refine(few, again, harmonics, accuracy))
            if memory is not None and few.memory is not None:
                memory.put(lost, few.memory)
    state = refined.y.T.copy()
    if units is not None:
        state *= units
    state[:, 1] *= omega
    if memory is not None:
        state = np.hstack([state, memory.offsets.T])
    unsettled = np.flatnonzero(refined.outcome)
    refined.harmonics[unsettled] = complex(np.nan, np.nan)
    refined.peak[unsettled] = np.nan
    return SteadyStates(
        refined.harmonics, refined.peak, state, refined.residual, refined.outcome, refined.error
    )
