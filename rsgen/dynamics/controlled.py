"""Tests under control: the amplitude is held and the force follows, or the lag is and the frequency follows.

Response control. F(omega, X), from the harmonic balance at a held amplitude, has one value also where
X(omega, F) folds, so that nothing jumps and no branch is followed. A motion is stable under constant force
where more of it needs more force, Re(conj(F) dF/dX) > 0.

Phase resonance. A phase-locked loop turns the frequency until the displacement lags the force by an angle; at
a quarter period that is resonance, k(X) = m omega^2 (Liu et al., Sec. 1.2), and points of all levels lie on
the backbone. Its unknowns are ln X and ln omega:

    ln F(X, omega) - (ln F + i lag) = 0,

F(X, omega) that of response control, by Newton's method with slopes from differences.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.solvers import Rows, newton, solve_each
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.fixed_point import ORBIT_OFFSET
from rsgen.dynamics.harmonic_balance import LONGEST_STEP, balance_states, hold_oscillator
from rsgen.dynamics.settling import ControlledStates, SteadyStates
from rsgen.dynamics.virtual_test import Progress, SimulatedTest, in_parts
from rsgen.law.numeric import compile_law

# ----------------------------------------------------------------------------
# Response control: the force that holds an amplitude.

_HARMONICS, _HARMONICS_OF_MEMORY = 31, 15
"""Harmonics of a balance at least. A force of dry friction is exact to 5e-5 in the median of points, another
to 1e-5; loops of a joint are rounder, and cost more."""


def balance_order(oscillator: Oscillator, test: SimulatedTest) -> int:
    """Return the number of harmonics of the balance: those of the test alone if it asks for the balance."""
    fewest = _HARMONICS_OF_MEMORY if compile_law(oscillator.force).remembers else _HARMONICS
    return test.harmonics if test.method == "harmonic-balance" else max(test.harmonics, fewest)


def hold_states(
    oscillator: Oscillator,
    amplitude: Array,
    frequency: Array,
    *,
    harmonics: int,
    order: int,
    sought: bool | NDArray[np.bool_] = True,
) -> ControlledStates:
    """Find the force that holds the fundamental at an amplitude (n,) [m], frequency in Hz.

    Parameters
    ----------
    harmonics, order
        Of the states, and of the balance that finds them.
    sought
        (n,) False for points that do not count as settled in any case.
    """
    held = hold_oscillator(oscillator, amplitude, frequency, harmonics=order)
    found = held.valid & sought
    states = balance_states(oscillator, held.motion(2 * np.pi * frequency), held.force, found)
    parts = {name: getattr(states, name) for name in SteadyStates.__dataclass_fields__}
    parts["harmonics"] = states.harmonics[:, : harmonics + 1]
    stable = (np.conj(held.force) * held.force_slope).real > 0
    return ControlledStates(**parts, force=np.where(found, held.force, np.nan), stable=stable & found)


def control_grid(oscillator: Oscillator, test: SimulatedTest, progress: Progress) -> ControlledStates:
    """Solve the grid of a test, ordered level by level; levels are X [m], the sweep does not matter."""
    order = balance_order(oscillator, test)
    return in_parts(partial(hold_states, oscillator, harmonics=test.harmonics, order=order), test, progress)


# ----------------------------------------------------------------------------
# Phase resonance: the frequency at which the response lags the force by an angle.

_SIZES = np.geomspace(1e-12, 1e3, 121)
"""Amplitudes [m] among which a level is sought: from atoms to any structure, eight a decade."""

_BAND_HALVINGS = 20
"""Of the band: a millionth of it, finer than the width of any resonance."""


@dataclass(frozen=True, slots=True, eq=False)
class _Loop:
    """The loops of n points, in ln X and ln omega; ``wanted`` (n,) is ln F + i lag."""

    oscillator: Oscillator
    wanted: ComplexArray
    order: int

    def residual(self, rows: Rows, unknowns: Array) -> Array:
        """(k, 2) relative error of the force and error of the lag [rad]."""
        error = np.log(_held_force(self.oscillator, unknowns, self.order)) - self.wanted[rows]
        return np.stack([error.real, error.imag], axis=1)

    def step(self, rows: Rows, unknowns: Array) -> tuple[Array, Array, Array]:
        """Newton's step, with the slopes of neighbouring places."""
        here = self.residual(rows, unknowns)
        there = [self.residual(rows, unknowns + ORBIT_OFFSET * unit) for unit in np.eye(2)]
        slopes = np.stack([(one - here) / ORBIT_OFFSET for one in there], axis=2)
        move = -solve_each(slopes, here[:, :, None])[:, :, 0]
        size = np.abs(move).max(axis=1)
        return here, move * np.minimum(1.0, LONGEST_STEP / np.maximum(size, 1e-300))[:, None], size


def phase_grid(oscillator: Oscillator, test: SimulatedTest) -> tuple[Array, Array, ControlledStates]:
    """Levels [N], frequencies [Hz] and states of a phase-locked test, level by level, every lag at each.

    Points that no frequency in the band of the test makes are not settled.
    """
    level = np.repeat(test.level, len(test.lags))
    lag = np.tile(np.array(test.lags), len(test.level)) + test.phase_error
    band = float(test.frequency.min()), float(test.frequency.max())
    wanted, order = np.log(level) + 1j * lag, balance_order(oscillator, test)
    place = _first_places(oscillator, wanted, band)
    found: NDArray[np.bool_] = np.all(np.isfinite(place), axis=1)
    frequency, size = np.full(len(level), float(np.mean(band))), np.ones(len(level))
    if found.any():
        with np.errstate(all="ignore"):
            roots = newton(_Loop(oscillator, wanted[found], order), place[found])
        hertz = np.exp(roots.unknowns[:, 1]) / (2 * np.pi)
        good = (roots.last_step <= test.accuracy) & (hertz >= band[0]) & (hertz <= band[1])
        size[found], frequency[found] = np.exp(roots.unknowns[:, 0]), hertz
        found[found] = good
    states = hold_states(oscillator, size, frequency, harmonics=test.harmonics, order=order, sought=found)
    return level, frequency, replace(states, force=np.where(found, states.force, np.exp(wanted)))


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
            size[at] = np.abs(_held_force(oscillator, np.log([_SIZES[at], high]).T, 1))
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
    return np.asarray(np.angle(_held_force(oscillator, np.log([size, omega]).T, 1)))


def _held_force(oscillator: Oscillator, place: Array, order: int) -> ComplexArray:
    """(n,) force [N] that holds the motions at places (n, 2) ln X, ln omega; NaN where none is found."""
    size, omega = np.exp(place).T
    held = hold_oscillator(oscillator, size, omega / (2 * np.pi), harmonics=order)
    return np.where(held.valid, held.force, np.nan)
