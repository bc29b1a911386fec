"""Response-controlled tests: the amplitude X is held and the force follows.

F(omega, X) is single-valued where X(omega, F) folds, so nothing jumps. State and force of each point are
found together by shooting: the motion repeats after one period, and its fundamental is X. Whether the same
motion would survive under constant force is read from the Jacobian of the period map.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.kernel import compile_kernel
from rsgen.dynamics.simulation.harmonic_balance import first_order_force
from rsgen.dynamics.simulation.point_grid import Progress, in_parts
from rsgen.dynamics.simulation.virtual_test import SimulatedTest
from rsgen.dynamics.steady_state import SteadyStates
from rsgen.dynamics.steady_state.batches import map_batches
from rsgen.dynamics.steady_state.fixed_point import attraction
from rsgen.dynamics.steady_state.loop_memory import LoopMemory
from rsgen.dynamics.steady_state.memory_units import units_of_states
from rsgen.dynamics.steady_state.period_map import PeriodMap
from rsgen.dynamics.steady_state.solver import LOCATED, USUAL_ACCURACY, USUAL_HARMONICS

__all__ = ["ControlledStates", "control_grid", "solve_response_control"]


_OFFSET = 1e-6
"""Of X and of the typical force: neighbouring orbits; truncation and rounding are both small there."""
_ITERATIONS = 25
"""Newton steps at most; six are usual, a step over a corner of the law needs more."""
_HALVINGS = 5
"""Halvings of a Newton step that does not come nearer."""
_SINGULAR = 1e-14
"""Determinant of the scaled Jacobian below which a Newton step has no direction: rounding."""
_LEAST_STEPS, _MOST_STEPS = 64, 8192
"""Steps a period, doubled until two answers agree; the most reach 1e-9 with the law's jumps located."""
_RICHARDSON = 2**3 - 1
"""What halved steps change, over the error that is left, at order three."""


@dataclass(frozen=True, slots=True, eq=False)
class ControlledStates(SteadyStates):
    """Periodic motions of given fundamental amplitude: steady states whose ``error`` is that of the force.

    ``force`` (n,) [N] holds the fundamental at X [m], whose phase is zero; ``stable`` (n,) is True where the
    motion attracts its neighbours when this force is held constant.
    """

    force: ComplexArray
    stable: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class _Shooting:
    """The D + 2 conditions on (y, Re F / s, Im F / s) of each point, all scaled by X.

    y = (x, v/omega), and for a law with memory what the period map adds: its D numbers (``PeriodMap``).
    """

    period_map: PeriodMap
    amplitude: Array

    @property
    def omega(self) -> Array:
        """(n,) angular frequency [rad/s]."""
        return self.period_map.omega

    def unit(self, points: NDArray[np.intp]) -> Array:
        """Force of one unit of the unknowns: what the inertia of the fundamental amplitude needs."""
        return np.asarray(self.period_map.mass * self.omega[points] ** 2)

    def orbit(
        self, points: NDArray[np.intp], w: Array, steps: int, harmonics: int
    ) -> tuple[Array, ComplexArray, Array]:
        force = w[:, -2:] * self.unit(points)[:, None]
        k = len(points)
        orbit = replace(self.period_map.of(points), force=force).carry(
            np.arange(k), w[:, :-2].T, np.full(k, steps), 1, harmonics, peaks=True
        )
        return orbit.state.T, orbit.harmonics, orbit.peak

    def conditions(self, points: NDArray[np.intp], w: Array, steps: int) -> Array:
        end, harmonics, _ = self.orbit(points, w, steps, 1)
        X = harmonics[:, 1]
        return np.column_stack([end - w[:, :-2], X.real - self.amplitude[points], X.imag])

    def linearised(self, points: NDArray[np.intp], w: Array, steps: int) -> tuple[Array, Array]:
        """Conditions (k, D + 2) and their Jacobian (k, D + 2, D + 2) from as many neighbouring orbits."""
        offset, size = _OFFSET * self.amplitude[points], w.shape[1]
        trials = [w] + [w + offset[:, None] * np.eye(size)[i] for i in range(size)]
        found = np.split(self.conditions(np.tile(points, 1 + size), np.concatenate(trials), steps), 1 + size)
        columns = [(there - found[0]) / offset[:, None] for there in found[1:]]
        return found[0], np.stack(columns, axis=2)


def solve_response_control(
    oscillator: Oscillator,
    amplitude: ArrayLike,
    frequency: ArrayLike,
    *,
    harmonics: int = USUAL_HARMONICS,
    accuracy: float = USUAL_ACCURACY,
) -> ControlledStates:
    """Find the force that holds the fundamental of the displacement at an amplitude (n,) [m].

    ``harmonics`` of the displacement are returned, in addition to the mean; ``accuracy`` is the largest
    relative error of the force.

    Raises
    ------
    RsgenError
        Shapes do not fit, an amplitude or a frequency is not positive and finite.
    """
    X = np.atleast_1d(np.asarray(amplitude, dtype=np.float64))
    f = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    if X.shape != f.shape or X.ndim != 1 or not np.all(np.isfinite(X) & (X > 0) & np.isfinite(f) & (f > 0)):
        raise RsgenError("amplitude, frequency: must be (n,) both, positive and finite everywhere [m], [Hz]")
    kernel = compile_kernel(oscillator.force, values=oscillator.values, locate_all=accuracy < LOCATED)
    values = np.array([oscillator.values[name] for name in kernel.parameters])
    omega = 2 * np.pi * f
    inertia: ComplexArray = (oscillator.mass * omega**2 * X).astype(np.complex128)
    units = units_of_states(oscillator, inertia, omega)

    def solve(batch: slice) -> ControlledStates:
        n, rows = len(X[batch]), kernel.rows
        memory = LoopMemory.at_start(rows, np.zeros((0, n)), n) if rows.curves else None
        period_map = PeriodMap(kernel, oscillator.mass, values, np.zeros((n, 2)), omega[batch], units, memory)
        shooting = _Shooting(period_map, X[batch])
        F, mean, states = first_order_force(oscillator, X[batch], shooting.omega)
        F = F / shooting.unit(np.arange(len(F)))
        y = np.zeros((n, rows.smooth))
        y[:, 0], y[:, 2 : rows.first] = X[batch] + mean, states.T
        if rows.curves:
            y[:, rows.first], y[:, rows.first + 1] = mean + X[batch], mean - X[batch]
        w = np.column_stack([y if units is None else y / units, F.real, F.imag])
        # a motion that overflows on the way has no answer; its outcome is not settled
        with np.errstate(over="ignore", invalid="ignore"):
            return _refine(shooting, w, harmonics, accuracy)

    return ControlledStates.joined(map_batches(solve, len(X)))


def control_grid(oscillator: Oscillator, test: SimulatedTest, progress: Progress) -> ControlledStates:
    """Solve the grid of a test, ordered level by level; levels are X [m], the sweep does not matter."""

    def solve(amplitude: Array, frequency: Array) -> ControlledStates:
        return solve_response_control(
            oscillator, amplitude, frequency, harmonics=test.harmonics, accuracy=test.accuracy
        )

    return in_parts(solve, test, progress)


def _refine(shooting: _Shooting, w: Array, H: int, accuracy: float) -> ControlledStates:
    n, size = len(w), w.shape[1] - 2
    result = SimpleNamespace(
        force=np.full(n, complex(np.nan, np.nan)),
        harmonics=np.full((n, H + 1), complex(np.nan, np.nan)),
        peak=np.full((n, 2), np.nan),
        state=np.full((n, size + shooting.period_map.kernel.rows.curves), np.nan),
        residual=np.full(n, np.nan),
        outcome=np.ones(n, dtype=np.int8),
        error=np.full(n, np.nan),
        stable=np.zeros(n, dtype=bool),
    )
    steps = max(_LEAST_STEPS, 2 * (H + 1))
    points = np.arange(n)
    w, found, _ = _newton(shooting, points, w, steps, 0.1 * accuracy)
    points, w = points[found], w[found]
    while len(points) and steps < _MOST_STEPS:
        steps *= 2
        finer, found, jacobian = _newton(shooting, points, w, steps, 0.01 * accuracy)
        coarse, points, w = w[found], points[found], finer[found]
        change = np.hypot(*(w - coarse)[:, -2:].T)
        error = change / np.maximum(np.hypot(*w[:, -2:].T), np.finfo(float).tiny) / _RICHARDSON
        _record(shooting, result, points, w, steps, H, error, jacobian[found])
        points, w = points[error > accuracy], w[error > accuracy]
    result.outcome[points] = 1
    return ControlledStates(**vars(result))


def _record(
    shooting: _Shooting,
    result: SimpleNamespace,
    points: NDArray[np.intp],
    w: Array,
    steps: int,
    H: int,
    error: Array,
    jacobian: Array,
) -> None:
    end, waves, peak = shooting.orbit(points, w, steps, H)
    size, units = w.shape[1] - 2, shooting.period_map.units
    result.force[points] = (w[:, -2] + 1j * w[:, -1]) * shooting.unit(points)
    result.harmonics[points], result.peak[points], result.error[points] = waves, peak, error
    result.state[points] = 0.0
    result.state[points, :size] = w[:, :-2] if units is None else w[:, :-2] * units
    result.state[points, 1] *= shooting.omega[points]
    result.residual[points] = np.linalg.norm(end - w[:, :-2], axis=1) / shooting.amplitude[points]
    result.outcome[points] = 0
    # the first block of the Jacobian is that of P(y) - y at constant force
    result.stable[points] = attraction((jacobian[:, :size, :size] + np.eye(size)).transpose(1, 2, 0)) > 0


def _newton(
    shooting: _Shooting, points: NDArray[np.intp], w: Array, steps: int, tolerance: float
) -> tuple[Array, NDArray[np.bool_], Array]:
    w = w.copy()
    found = np.zeros(len(points), dtype=bool)
    jacobian = np.zeros((len(points), w.shape[1], w.shape[1]))
    active = np.arange(len(points))
    for _ in range(_ITERATIONS):
        mine = points[active]
        value, slope = shooting.linearised(mine, w[active], steps)
        jacobian[active] = slope
        sane = np.isfinite(slope).all(axis=(1, 2)) & (np.abs(np.linalg.det(np.nan_to_num(slope))) > _SINGULAR)
        active, value, slope, mine = active[sane], value[sane], slope[sane], mine[sane]
        if not len(active):
            break
        move = -np.linalg.solve(slope, value[:, :, None])[:, :, 0]
        done = np.linalg.norm(move, axis=1) <= tolerance * np.minimum(
            shooting.amplitude[mine], np.hypot(*w[active, -2:].T)
        )
        factor = np.ones(len(active))
        for _ in range(_HALVINGS):
            trial = shooting.conditions(mine, w[active] + factor[:, None] * move, steps)
            worse = ~(np.linalg.norm(trial, axis=1) <= np.linalg.norm(value, axis=1)) & ~done
            if not worse.any():
                break
            factor[worse] /= 2
        w[active] += factor[:, None] * move
        found[active[done]] = True
        active = active[~done]
        if not len(active):
            break
    return w, found, jacobian
