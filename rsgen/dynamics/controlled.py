"""Tests under control: the amplitude is held and the force follows, or the lag is and the frequency follows.

Response control. For each amplitude X and frequency omega the state y and the force F are the D + 2 unknowns
of

    P(y; F, omega) - y = 0,    X1(y; F, omega) - X = 0,

P the period map (``fixed_point``), X1 the complex fundamental of the orbit. Newton's method solves them
(shooting), from first-order harmonic balance. F(omega, X) has one value also where X(omega, F) folds, so that
nothing jumps and no branch is followed. Steps a period are doubled until F agrees. A motion is stable under
constant force if the eigenvalues of dP/dy lie inside the unit circle.

Phase resonance. A phase-locked loop turns the frequency until the displacement lags the force by an angle; at
a quarter period that is resonance, k(X) = m omega^2 (Liu et al., Sec. 1.2), and points of all levels lie on
the backbone. Its unknowns are ln X and ln omega:

    ln F(X, omega) - (ln F + i lag) = 0,

F(X, omega) that of response control. Newton's method begins with the slopes of the balance of one harmonic
and corrects them by what each step shows (C. G. Broyden, Math. Comp. 19 (1965) 577).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.solvers import Rows, newton
from rsgen.common.tolerances import MAX_NEWTON_STEPS, MAX_STEP_HALVINGS, ROUND_OFF
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.fixed_point import ORBIT_OFFSET, LoopMemory, PeriodMap, attraction, units_of_states
from rsgen.dynamics.harmonic_balance import LONGEST_STEP, balance_states, hold_oscillator
from rsgen.dynamics.kernel import compile_kernel
from rsgen.dynamics.settling import ControlledStates, SteadyStates
from rsgen.dynamics.steady_state import LOCATING_ACCURACY, ORDER, USUAL_ACCURACY, USUAL_HARMONICS, map_batches
from rsgen.dynamics.virtual_test import Progress, SimulatedTest, in_parts
from rsgen.law.numeric import compile_law

# ----------------------------------------------------------------------------
# Response control: state and force together, by shooting.

_MIN_STEPS, _MAX_STEPS = 64, 8192
"""Steps a period, doubled until two answers agree; the most reach 1e-9 with the law's jumps located."""


@dataclass(frozen=True, slots=True, eq=False)
class _Shooting:
    """The D + 2 conditions on (y, Re F / s, Im F / s) of each point, all scaled by X.

    y = (x, v/omega), and for a law with memory what the period map adds: its D numbers (``PeriodMap``).
    """

    period_map: PeriodMap
    amplitude: Array
    points: Rows
    steps: int
    jacobian: Array

    @property
    def omega(self) -> Array:
        """(n,) angular frequency [rad/s]."""
        return self.period_map.omega

    def unit(self, points: NDArray[np.intp]) -> Array:
        """Force of one unit of the unknowns: what the inertia of the fundamental amplitude needs."""
        return np.asarray(self.period_map.mass * self.omega[points] ** 2)

    def orbit(self, points: Rows, w: Array, harmonics: int) -> tuple[Array, ComplexArray, Array]:
        force = w[:, -2:] * self.unit(points)[:, None]
        k = len(points)
        orbit = replace(self.period_map.of(points), force=force).carry(
            np.arange(k), w[:, :-2].T, np.full(k, self.steps), 1, harmonics, peaks=True
        )
        return orbit.state.T, orbit.harmonics, orbit.peak

    def residual(self, rows: Rows, unknowns: Array) -> Array:
        """(k, D + 2) conditions."""
        points = self.points[rows]
        end, harmonics, _ = self.orbit(points, unknowns, 1)
        X = harmonics[:, 1]
        return np.column_stack([end - unknowns[:, :-2], X.real - self.amplitude[points], X.imag])

    def step(self, rows: Rows, unknowns: Array) -> tuple[Array, Array, Array]:
        """Newton's step with the Jacobian from D + 2 neighbouring orbits, which ``jacobian`` keeps."""
        points, size = self.points[rows], unknowns.shape[1]
        offset = ORBIT_OFFSET * self.amplitude[points]
        trials = [unknowns] + [unknowns + offset[:, None] * np.eye(size)[i] for i in range(size)]
        found = np.split(self.residual(np.tile(rows, 1 + size), np.concatenate(trials)), 1 + size)
        slope = np.stack([(there - found[0]) / offset[:, None] for there in found[1:]], axis=2)
        self.jacobian[rows] = slope
        move = np.full_like(unknowns, np.nan)
        sane = np.isfinite(slope).all(axis=(1, 2)) & (np.abs(np.linalg.det(np.nan_to_num(slope))) > ROUND_OFF)
        move[sane] = -np.linalg.solve(slope[sane], found[0][sane][:, :, None])[:, :, 0]
        least = np.minimum(self.amplitude[points], np.hypot(*unknowns[:, -2:].T))
        return found[0], move, np.linalg.norm(move, axis=1) / np.maximum(least, np.finfo(float).tiny)


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
    kernel = compile_kernel(
        oscillator.force, values=oscillator.values, locate_all=accuracy < LOCATING_ACCURACY
    )
    values = np.array([oscillator.values[name] for name in kernel.parameters])
    omega = 2 * np.pi * f
    inertia: ComplexArray = (oscillator.mass * omega**2 * X).astype(np.complex128)
    units = units_of_states(oscillator, inertia, omega)

    def solve(batch: slice) -> ControlledStates:
        n, rows = len(X[batch]), kernel.rows
        memory = LoopMemory.at_start(rows, np.zeros((0, n)), n) if rows.curves else None
        period_map = PeriodMap(kernel, oscillator.mass, values, np.zeros((n, 2)), omega[batch], units, memory)
        shooting = _Shooting(period_map, X[batch], np.arange(n), 0, np.zeros((0, 0, 0)))
        F, mean, states = _first_order(oscillator, X[batch], f[batch])
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


def _first_order(
    oscillator: Oscillator, amplitude: Array, frequency: Array
) -> tuple[ComplexArray, Array, Array]:
    """Force (n,) [N] and mean (n,) [m] of x = X0 + X cos(omega t), and states of the law at t = 0, (r, n)."""
    held = hold_oscillator(oscillator, amplitude, frequency, harmonics=1)
    law, motion = compile_law(oscillator.force), held.motion(2 * np.pi * frequency)
    return held.force, held.harmonics[:, 0].real, law.states_at_start(motion, law.ordered(oscillator.values))


def hold_by_balance(
    oscillator: Oscillator, amplitude: Array, frequency: Array, *, harmonics: int, accuracy: float
) -> ControlledStates:
    """Find the force that holds the fundamental at an amplitude (n,) [m], by a balance of so many harmonics.

    A motion is called stable where a larger one at the same frequency needs a larger force: what a
    continuation sees of folds. ``accuracy`` is not looked at: the error is that of the truncated series, and
    not known.
    """
    held = hold_oscillator(oscillator, amplitude, frequency, harmonics=harmonics)
    states = balance_states(oscillator, held.motion(2 * np.pi * frequency), held.force, held.valid)
    parts = {name: getattr(states, name) for name in SteadyStates.__dataclass_fields__}
    stable = (np.conj(held.force) * held.force_slope).real > 0
    return ControlledStates(
        **parts, force=np.where(held.valid, held.force, np.nan), stable=stable & held.valid
    )


Hold = Callable[..., ControlledStates]
"""Finds the force that holds amplitudes: ``solve_response_control`` or ``hold_by_balance``."""


def _holding(test: SimulatedTest) -> Hold:
    return solve_response_control if test.method == "time" else hold_by_balance


def control_grid(oscillator: Oscillator, test: SimulatedTest, progress: Progress) -> ControlledStates:
    """Solve the grid of a test, ordered level by level; levels are X [m], the sweep does not matter."""
    hold = partial(_holding(test), oscillator, harmonics=test.harmonics, accuracy=test.accuracy)
    return in_parts(hold, test, progress)


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
    steps = max(_MIN_STEPS, 2 * (H + 1))
    points = np.arange(n)
    w, found, _ = _shoot(shooting, points, w, steps, 0.1 * accuracy)
    points, w = points[found], w[found]
    while len(points) and steps < _MAX_STEPS:
        steps *= 2
        finer, found, here = _shoot(shooting, points, w, steps, 0.01 * accuracy)
        coarse, points, w = w[found], points[found], finer[found]
        change = np.hypot(*(w - coarse)[:, -2:].T)
        error = change / np.maximum(np.hypot(*w[:, -2:].T), np.finfo(float).tiny) / (2 ** (ORDER - 1) - 1)
        _record(here, result, points, w, H, error, here.jacobian[found])
        points, w = points[error > accuracy], w[error > accuracy]
    result.outcome[points] = 1
    return ControlledStates(**vars(result))


def _shoot(
    shooting: _Shooting, points: Rows, w: Array, steps: int, tolerance: float
) -> tuple[Array, NDArray[np.bool_], _Shooting]:
    """Unknowns of the points, which of them were found, and the conditions with their last Jacobian."""
    here = _Shooting(
        shooting.period_map,
        shooting.amplitude,
        points,
        steps,
        np.zeros((len(points), w.shape[1], w.shape[1])),
    )
    roots = newton(here, w, tolerance=tolerance, steps=MAX_NEWTON_STEPS, halvings=MAX_STEP_HALVINGS)
    return roots.unknowns, roots.size <= tolerance, here


def _record(
    shooting: _Shooting,
    result: SimpleNamespace,
    points: Rows,
    w: Array,
    H: int,
    error: Array,
    jacobian: Array,
) -> None:
    end, waves, peak = shooting.orbit(points, w, H)
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


# ----------------------------------------------------------------------------
# Phase resonance: frequency and amplitude at a given lag and force.

_SIZES = np.geomspace(1e-12, 1e3, 121)
"""Amplitudes [m] among which a level is sought: from atoms to any structure, eight a decade."""

_BAND_HALVINGS = 20
"""Of the band: a millionth of it, finer than the width of any resonance."""

_ACCURACY_OF_STEP = 0.1
"""The solver of each step is so much more accurate than what is asked."""


@dataclass(frozen=True, slots=True, eq=False)
class PhaseStates(ControlledStates):
    """Periodic motions with a given lag; ``frequency`` (n,) [Hz] is where the loop found it."""

    frequency: Array


def solve_phase_control(
    oscillator: Oscillator,
    force: Array,
    lag: Array,
    band: tuple[float, float],
    *,
    harmonics: int,
    accuracy: float,
    hold: Hold = solve_response_control,
) -> PhaseStates:
    """Find frequency and response at which the fundamental lags the force by an angle.

    Parameters
    ----------
    force, lag
        (n,) amplitude [N] and lag of the displacement [rad], from 0 to pi.
    band
        Lowest and highest frequency [Hz] of the loop.
    harmonics, accuracy
        As of response control; the lag is as accurate [rad] as the force is relatively.
    hold
        How amplitudes are held.

    Returns
    -------
    PhaseStates
        The fundamental of each has phase zero, and the force leads it by the lag. What is not found in the
        band is not settled, at the middle of the band.
    """
    wanted = np.log(force) + 1j * lag
    place = _first_places(oscillator, wanted, band)
    found: NDArray[np.bool_] = np.all(np.isfinite(place), axis=1)
    frequency = np.full(len(force), float(np.mean(band)))
    size = np.ones(len(force))
    held = partial(hold, oscillator, harmonics=harmonics)
    if found.any():
        place[found], done = _lock(
            held, _slopes(oscillator, place[found]), place[found], wanted[found], accuracy
        )
        found[found] = done
        hertz = np.exp(place[:, 1]) / (2 * np.pi)
        found &= (hertz >= band[0]) & (hertz <= band[1])
        frequency[found], size[found] = hertz[found], np.exp(place[found, 0])
    return _phase_states(partial(held, accuracy=accuracy), size, frequency, found, wanted)


def _phase_states(
    hold: Hold, size: Array, frequency: Array, found: NDArray[np.bool_], wanted: ComplexArray
) -> PhaseStates:
    """Solve for the motions of the points that were found; the others are not settled."""
    rows = np.flatnonzero(found)
    # one point that is not used stands for the shapes of all
    some = rows if len(rows) else np.zeros(1, dtype=np.intp)
    states = hold(size[some], frequency[some])
    parts = {}
    for name in ControlledStates.__dataclass_fields__:
        values = np.asarray(getattr(states, name))
        whole = np.zeros((len(size), *values.shape[1:]), dtype=values.dtype)
        if values.dtype.kind in "fc":
            whole[...] = np.nan
        whole[rows] = values[: len(rows)]
        parts[name] = whole
    parts["outcome"] = np.where(found, parts["outcome"], 1).astype(np.int8)
    parts["force"] = np.where(found, parts["force"], np.exp(wanted))
    return PhaseStates(**parts, frequency=frequency)


def _first_places(oscillator: Oscillator, wanted: ComplexArray, band: tuple[float, float]) -> Array:
    """(n, 2) ln X and ln omega on the smallest amplitude that one harmonic finds; NaN where there is none."""
    place = np.full((len(wanted), 2), np.nan)
    edges = 2 * np.pi * np.array(band)
    for lag in np.unique(wanted.imag):
        with np.errstate(all="ignore"):
            ends = [_lead(oscillator, _SIZES, np.full(len(_SIZES), edge)) for edge in edges]
            at = np.flatnonzero((ends[0] < lag) & (ends[1] >= lag))
            low, high = (np.full(len(at), edge) for edge in edges)
            for _ in range(_BAND_HALVINGS if len(at) else 0):
                middle = 0.5 * (low + high)
                above = _lead(oscillator, _SIZES[at], middle) >= lag
                low, high = np.where(above, low, middle), np.where(above, middle, high)
            omega, size = np.full((2, len(_SIZES)), np.nan)
            omega[at] = high
            size[at] = np.abs(_held_force(oscillator, _SIZES[at], high))
        good = np.isfinite(size[:-1]) & np.isfinite(size[1:])
        for row in np.flatnonzero(wanted.imag == lag):
            level = float(np.exp(wanted[row].real))
            steps = np.flatnonzero(good & (size[:-1] <= level) & (size[1:] > level))
            if len(steps):
                i = int(steps[0])
                share = np.log(level / size[i]) / np.log(size[i + 1] / size[i])
                for column, values in enumerate((_SIZES, omega)):
                    place[row, column] = np.log(values[i]) + share * np.log(values[i + 1] / values[i])
    return place


def _lead(oscillator: Oscillator, size: Array, omega: Array) -> Array:
    """(n,) lead of the force before the displacement [rad], at one harmonic."""
    return np.asarray(np.angle(_held_force(oscillator, size, omega)))


def _held_force(oscillator: Oscillator, size: Array, omega: Array) -> ComplexArray:
    """(n,) force [N] that holds amplitudes [m] at frequencies [rad/s], at one harmonic."""
    return hold_oscillator(oscillator, size, omega / (2 * np.pi), harmonics=1).force


def _lock(
    hold: Hold, slopes: Array, place: Array, wanted: ComplexArray, accuracy: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Solve for (n, 2) ln X and ln omega; which of the points are found."""
    place = np.array(place)
    inverse: Array = np.asarray(np.linalg.inv(slopes), dtype=np.float64)
    rest = _rest(hold, place, wanted, accuracy)
    for _ in range(MAX_NEWTON_STEPS):
        active = np.flatnonzero(np.hypot(*rest.T) > _ACCURACY_OF_STEP * accuracy)
        if not len(active):
            break
        step = -np.einsum("nij,nj->ni", inverse[active], rest[active])
        step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        place[active] += step
        new = _rest(hold, place[active], wanted[active], accuracy)
        inverse[active] = _broyden(inverse[active], step, new - rest[active])
        rest[active] = new
    return place, np.asarray(np.hypot(*rest.T) <= accuracy)


def _rest(hold: Hold, place: Array, wanted: ComplexArray, accuracy: float) -> Array:
    """(n, 2) relative error of the force and error of the lag [rad]."""
    size, omega = np.exp(place).T
    states = hold(size, omega / (2 * np.pi), accuracy=_ACCURACY_OF_STEP * accuracy)
    rest = np.log(states.force) - wanted
    return np.stack([rest.real, rest.imag], axis=1)


def _slopes(oscillator: Oscillator, place: Array) -> Array:
    """(n, 2, 2) derivatives of ln F by ln X and ln omega, at one harmonic."""
    columns = []
    for unit in np.eye(2):
        ends = [
            np.log(_held_force(oscillator, *np.exp(place + sign * ORBIT_OFFSET * unit).T)) for sign in (-1, 1)
        ]
        slope = (ends[1] - ends[0]) / (2 * ORBIT_OFFSET)
        columns.append(np.stack([slope.real, slope.imag], axis=1))
    return np.stack(columns, axis=2)


def _broyden(inverse: Array, step: Array, change: Array) -> Array:
    """Correct the inverse (n, 2, 2) of the slopes by a step and what it changed."""
    reached = np.einsum("nij,nj->ni", inverse, change)
    along = np.einsum("ni,nij->nj", step, inverse)
    scale = np.sum(step * reached, axis=1)
    good = np.isfinite(scale) & (np.abs(scale) > np.finfo(float).tiny)
    scale = np.where(good, scale, 1.0)
    correction = (step - reached)[:, :, None] * along[:, None, :] / scale[:, None, None]
    return np.where(good[:, None, None], inverse + np.nan_to_num(correction), inverse)


def phase_grid(oscillator: Oscillator, test: SimulatedTest) -> tuple[Array, PhaseStates]:
    """Levels [N] and states of a phase-locked test: every lag at every level, level by level."""
    level = np.repeat(test.level, len(test.lags))
    lag = np.tile(np.array(test.lags), len(test.level)) + test.phase_error
    band = float(test.frequency.min()), float(test.frequency.max())
    states = solve_phase_control(
        oscillator,
        level,
        lag,
        band,
        harmonics=test.harmonics,
        accuracy=test.accuracy,
        hold=_holding(test),
    )
    return level, states
