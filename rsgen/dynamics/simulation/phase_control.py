"""Phase resonance: a phase-locked loop turns the frequency until the response lags by a given angle.

At a quarter period the lag is that of resonance, k(X) = m omega^2 (Liu et al., Sec. 1.2), and the points of
all levels lie on the backbone. Amplitude and frequency of a level F follow from F(X, omega) of response
control, which has no folds: ln F(X, omega) = ln F + i lag is solved by Newton's method with the slopes of
the balance of one harmonic, corrected by what each step shows (C. G. Broyden, Math. Comp. 19 (1965) 577).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.simulation.harmonic_balance import first_order_force
from rsgen.dynamics.simulation.response_control import ControlledStates, solve_response_control
from rsgen.dynamics.simulation.virtual_test import SimulatedTest

__all__ = ["PhaseStates", "phase_grid", "solve_phase_control"]

_SIZES = np.geomspace(1e-12, 1e3, 121)
"""Amplitudes [m] among which a level is sought: from atoms to any structure, eight a decade."""

_BISECTIONS = 20
"""Of the band: a millionth of it, finer than the width of any resonance."""

_STEPS = 25
"""Newton steps at most; four are usual, a corner of the law needs more."""

_OFFSET = 1e-5
"""Relative change by which first slopes are taken: truncation and rounding are both small."""

_FINER = 0.1
"""The solver of each step is so much more accurate than what is asked."""

_FARTHEST = 0.3
"""Longest step of ln X and of ln omega: longer ones leave the branch."""


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

    Returns
    -------
    PhaseStates
        The fundamental of each has phase zero, and the force leads it by the lag. What is not found in the
        band is not settled, at the middle of the band.
    """
    wanted = np.log(force) + 1j * lag
    place = _first_order(oscillator, wanted, band)
    found: NDArray[np.bool_] = np.all(np.isfinite(place), axis=1)
    frequency = np.full(len(force), float(np.mean(band)))
    size = np.ones(len(force))
    if found.any():
        place[found], done = _newton(oscillator, place[found], wanted[found], accuracy)
        found[found] = done
        hertz = np.exp(place[:, 1]) / (2 * np.pi)
        found &= (hertz >= band[0]) & (hertz <= band[1])
        frequency[found], size[found] = hertz[found], np.exp(place[found, 0])
    return _states(oscillator, size, frequency, found, wanted, harmonics, accuracy)


def _states(
    oscillator: Oscillator,
    size: Array,
    frequency: Array,
    found: NDArray[np.bool_],
    wanted: ComplexArray,
    harmonics: int,
    accuracy: float,
) -> PhaseStates:
    """Solve for the motions of the points that were found; the others are not settled."""
    rows = np.flatnonzero(found)
    # one point that is not used stands for the shapes of all
    some = rows if len(rows) else np.zeros(1, dtype=np.intp)
    states = solve_response_control(
        oscillator, size[some], frequency[some], harmonics=harmonics, accuracy=accuracy
    )
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


def _first_order(oscillator: Oscillator, wanted: ComplexArray, band: tuple[float, float]) -> Array:
    """(n, 2) ln X and ln omega on the smallest amplitude that one harmonic finds; NaN where there is none."""
    place = np.full((len(wanted), 2), np.nan)
    edges = 2 * np.pi * np.array(band)
    for lag in np.unique(wanted.imag):
        with np.errstate(all="ignore"):
            ends = [_lead(oscillator, _SIZES, np.full(len(_SIZES), edge)) for edge in edges]
            at = np.flatnonzero((ends[0] < lag) & (ends[1] >= lag))
            low, high = (np.full(len(at), edge) for edge in edges)
            for _ in range(_BISECTIONS if len(at) else 0):
                middle = 0.5 * (low + high)
                above = _lead(oscillator, _SIZES[at], middle) >= lag
                low, high = np.where(above, low, middle), np.where(above, middle, high)
            omega, size = np.full((2, len(_SIZES)), np.nan)
            omega[at] = high
            size[at] = np.abs(first_order_force(oscillator, _SIZES[at], high)[0])
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
    return np.asarray(np.angle(first_order_force(oscillator, size, omega)[0]))


def _newton(
    oscillator: Oscillator, place: Array, wanted: ComplexArray, accuracy: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Solve for (n, 2) ln X and ln omega; which of the points are found."""
    place = np.array(place)
    inverse: Array = np.asarray(np.linalg.inv(_slopes(oscillator, place)), dtype=np.float64)
    rest = _rest(oscillator, place, wanted, accuracy)
    for _ in range(_STEPS):
        active = np.flatnonzero(np.hypot(*rest.T) > _FINER * accuracy)
        if not len(active):
            break
        step = -np.einsum("nij,nj->ni", inverse[active], rest[active])
        step *= np.minimum(1.0, _FARTHEST / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        place[active] += step
        new = _rest(oscillator, place[active], wanted[active], accuracy)
        inverse[active] = _broyden(inverse[active], step, new - rest[active])
        rest[active] = new
    return place, np.asarray(np.hypot(*rest.T) <= accuracy)


def _rest(oscillator: Oscillator, place: Array, wanted: ComplexArray, accuracy: float) -> Array:
    """(n, 2) relative error of the force and error of the lag [rad]."""
    size, omega = np.exp(place).T
    states = solve_response_control(
        oscillator, size, omega / (2 * np.pi), harmonics=1, accuracy=_FINER * accuracy
    )
    rest = np.log(states.force) - wanted
    return np.stack([rest.real, rest.imag], axis=1)


def _slopes(oscillator: Oscillator, place: Array) -> Array:
    """(n, 2, 2) derivatives of ln F by ln X and ln omega, at one harmonic."""
    columns = []
    for unit in np.eye(2):
        ends = [
            np.log(first_order_force(oscillator, *np.exp(place + sign * _OFFSET * unit).T)[0])
            for sign in (-1, 1)
        ]
        slope = (ends[1] - ends[0]) / (2 * _OFFSET)
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
        oscillator, level, lag, band, harmonics=test.harmonics, accuracy=test.accuracy
    )
    return level, states
