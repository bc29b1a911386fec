"""Output-error fit: the compiled steady state itself is the model, started on the measured branch.

For laws that jump or have corners a truncated Fourier series is not the motion; the time-domain steady state
is. Derivatives are differences whose step moves the response by a fixed small amount; they are kept from step
to step, because near the estimate they change less than the estimate itself has to.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import RsgenError
from rsgen.identification.balance_fit import FittedModel, split_rows
from rsgen.identification.data import Points
from rsgen.identification.least_squares import Linearisation, fit
from rsgen.law.numeric import ForceLaw
from rsgen.oscillator import Model, Oscillator
from rsgen.steady_state import SteadyStates, solve_steady_states

__all__ = ["fit_output"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_MOVE = 1e-3
"""Relative change of the response by which derivatives are taken."""

_SHARE = 1e-3
"""Error of a derivative, relative, that slows the fit down by no step."""

_ROUND_OFF = 1e-12
"""Effect of a parameter, relative to the strongest, that is only round-off."""

_BRANCH = 0.2
"""A prediction farther from the measured fundamental, relatively, is on another branch."""

_SIGMAS = 8.0
"""So many standard deviations of the noise never put a point on another branch."""

_NOISY = 1e-4
"""Misfit above which the square of the noise is worth to be allowed for."""

_BENT = (1e-3, 2e-2)
"""Least and largest relative change of the force by which second derivatives are taken."""

_FOLLOWED = 0.5
"""Share of the points that must be predicted on the measured branch; where fewer are, the start is wrong."""

_STEPS = 6
_ROUNDS = 4
_FLOOR = 5.0
"""A misfit of so many times the simulator's accuracy is its own."""

_SAME = 0.99
"""A round that lowers the misfit by less was the last."""

_STEEP = 20.0
"""Points whose amplitude grows by a larger power of the force lie at a fold: force noise decides there."""


def fit_output(
    points: Points,
    model: Model,
    law: ForceLaw,
    start: FittedModel,
    *,
    accuracy: float,
) -> FittedModel | None:
    """Fit the compiled steady states to force, fundamental, mean and harmonics.

    Parameters
    ----------
    points
        The measured points, those of ``start``.
    model, law
        The laws, as elements for the simulator and compiled for arrays.
    start
        The fit of the balance.
    accuracy
        Of the simulated amplitude, relative.

    Returns
    -------
    FittedModel or None
        None where the simulator cannot follow enough of the points.
    """
    simulator = _Simulator(points, model, law, start, accuracy)
    if simulator.followed(start.regression.parameters) < _FOLLOWED * len(points):
        return None
    bend = simulator.bend if start.regression.noise > _NOISY else None
    parameters, own, last = start.regression.parameters, simulator.begin, start.regression.noise
    for _ in range(_ROUNDS):
        regression = fit(
            simulator.linearise,
            parameters,
            own,
            steps=_STEPS,
            neighbours=points.neighbours,
            bend=bend,
            floor=_FLOOR * accuracy,
        )
        parameters, own = regression.parameters, regression.own
        exact = regression.noise < _FLOOR * accuracy
        if regression.converged and (exact or regression.noise > _SAME * last):
            break
        # near a fold derivatives change quickly
        last = regression.noise
        simulator.renew()
    if np.count_nonzero(regression.used) < _FOLLOWED * len(points):
        return None
    found, own = regression.parameters, regression.own
    predicted = simulator.solve(found, np.exp(own[:, 0]))
    # back to a fundamental of phase zero, as the balance has it
    lag = np.angle(predicted[:, 1])
    return FittedModel(
        regression,
        found[: len(law.parameters)],
        float(found[-1]) if model.mass is None else start.mass,
        np.exp(own[:, 0] - 1j * lag),
        predicted * np.exp(-1j * lag)[:, None] ** np.arange(predicted.shape[1]),
        np.angle(points.force) + own[:, 1] + lag,
    )


class _Simulator:
    """Steady states of all points near the measured ones; own unknowns are log |F| and its phase."""

    def __init__(
        self, points: Points, model: Model, law: ForceLaw, start: FittedModel, accuracy: float
    ) -> None:
        self._points, self._model, self._law = points, model, law
        self._accuracy = accuracy
        self._compared = [
            h for h in points.measured if h != 1 and (h % 2 == 1 or not law.odd) and (h > 0 or law.springs)
        ]
        self._highest = max([1, *self._compared])
        # the mean has no imaginary part
        self._real = [h == 0 for h in (1, 1, *self._compared)]
        self._phase = np.angle(points.force)
        noise = start.regression.noise
        self._branch = max(_BRANCH, _SIGMAS * noise)
        self._step = float(np.clip(noise, *_BENT))
        self._moves = _moves(start)
        self._steep = np.zeros(len(points), dtype=bool)
        self._by_force = np.full((len(points), self._highest + 1), np.nan + 0j)
        self._by_parameter: ComplexArray | None = None
        self.begin = np.stack([np.log(np.abs(points.force)), np.zeros(len(points))], axis=1)
        self._state = _states(points.harmonics, self._phase, points.omega)
        # a step is tried, refused perhaps, and the place before it asked for again
        self._lately: deque[tuple[tuple[bytes, bytes, float], SteadyStates | None]] = deque(maxlen=2)
        if noise > _NOISY:
            self._quieten(start)

    def _quieten(self, start: FittedModel) -> None:
        """Begin with what the balance made of force and response together, less noisy than the force."""
        phase = start.turn + np.angle(start.force)
        begin = np.stack([np.log(np.abs(start.force)), np.angle(np.exp(1j * (phase - self._phase)))], axis=1)
        state = _states(start.harmonics, np.angle(start.force), self._points.omega)
        told = np.isfinite(begin).all(axis=1) & np.isfinite(state).all(axis=1) & start.regression.used
        self.begin = np.where(told[:, None], begin, self.begin)
        self._state = np.where(told[:, None], state, self._state)

    def followed(self, parameters: Array) -> int:
        """Count the points that are predicted on the measured branch."""
        predicted = self.solve(parameters, np.exp(self.begin[:, 0]))
        return int(np.count_nonzero(np.isfinite(predicted[:, 1])))

    def renew(self) -> None:
        """Take the derivatives anew at the next call."""
        self._by_parameter = None

    def solve(self, parameters: Array, drive: Array, accuracy: float | None = None) -> ComplexArray:
        """(n, H+1) harmonics [m] under the forces [N] of phase zero; NaN off the measured branch."""
        states = self._states_of(parameters, drive, accuracy or self._accuracy)
        return np.full_like(self._by_force, np.nan) if states is None else self._near(states)

    def _near(self, states: SteadyStates) -> ComplexArray:
        size = np.abs(states.harmonics[:, 1])
        good = states.settled & (np.abs(size / self._points.amplitude - 1) < self._branch)
        return np.where(good[:, None], states.harmonics, np.nan)

    def _states_of(self, parameters: Array, drive: Array, accuracy: float) -> SteadyStates | None:
        asked = (parameters.tobytes(), drive.tobytes(), accuracy)
        for known, states in self._lately:
            if asked == known:
                return states
        states = self._integrate(parameters, drive, accuracy)
        self._lately.append((asked, states))
        return states

    def _integrate(self, parameters: Array, drive: Array, accuracy: float) -> SteadyStates | None:
        mass = float(parameters[-1]) if self._model.mass is None else self._model.mass
        values = dict(zip(self._law.parameters, map(float, parameters), strict=False))
        try:
            return solve_steady_states(
                Oscillator(mass, self._model.elements, values),
                drive.astype(complex),
                self._points.omega / (2 * np.pi),
                harmonics=self._highest,
                accuracy=accuracy,
                start=self._state,
            )
        except RsgenError:
            return None

    def _differentiate(self, parameters: Array, drive: Array, base: ComplexArray) -> ComplexArray:
        accuracy = max(self._accuracy, _SHARE * _MOVE)
        self._by_force = (self.solve(parameters, drive * (1 + _MOVE), accuracy) - base) / _MOVE
        columns = []
        for j, move in enumerate(self._moves):
            trial = np.array(parameters)
            trial[j] += move
            # nothing moves where the response does not depend on the parameter
            moved = self.solve(trial, drive, accuracy) if move else base
            columns.append((moved - base) / (move or 1.0))
        self._steep = ~(np.abs(self._by_force[:, 1]) < _STEEP * np.abs(base[:, 1]))
        return np.stack(columns, axis=-1) if columns else np.zeros((*base.shape, 0), dtype=complex)

    def linearise(self, parameters: Array, own: Array) -> Linearisation:
        """Around the present parameters; derivatives are taken once, at the first call."""
        drive = np.exp(own[:, 0])
        if self._by_parameter is None:
            states = self._states_of(parameters, drive, self._accuracy)
            predicted = np.full_like(self._by_force, np.nan)
            if states is not None:
                predicted = self._near(states)
                found = np.isfinite(predicted[:, 1])
                self._state = np.where(found[:, None], states.state, self._state)
            self._by_parameter = self._differentiate(parameters, drive, predicted)
        else:
            predicted = self.solve(parameters, drive)
        first, size = predicted[:, 1], self._points.amplitude
        one = np.ones(len(drive))
        force = self._points.force * np.exp(-1j * (self._phase + own[:, 1]))
        measured = self._turned(own)
        # points that were lost are NaN and say so below
        with np.errstate(invalid="ignore"):
            rows = [np.log(force / drive), np.log(measured[:, 1] / first)]
            grow = [one, self._by_force[:, 1] / first]
            by = [np.zeros_like(self._by_parameter[:, 1]), self._by_parameter[:, 1] / first[:, None]]
        turn = [1j * one, 1j * one]
        for h in self._compared:
            rows.append((measured[:, h] - predicted[:, h]) / size)
            grow.append(self._by_force[:, h] / size)
            turn.append(1j * h * measured[:, h] / size)
            by.append(self._by_parameter[:, h] / size[:, None])
        residual = split_rows(rows, self._real)
        by_own = np.stack([split_rows(grow, self._real), split_rows(turn, self._real)], axis=2)
        by_parameter = split_rows(by, self._real)
        told = np.isfinite(by_parameter).all(axis=(1, 2)) & np.isfinite(by_own).all(axis=(1, 2))
        residual[self._steep | ~told] = np.nan
        return Linearisation(residual, by_own, by_parameter)

    def _turned(self, own: Array) -> ComplexArray:
        orders = np.arange(self._points.harmonics.shape[1])
        turn = np.exp(-1j * (self._phase + own[:, 1]))
        return np.asarray(self._points.harmonics * turn[:, None] ** orders)

    def bend(self, parameters: Array, own: Array, spread: Array) -> Array:
        """What the noise in force and phase adds to the prediction on average (see ``regression.fit``)."""
        low, here, high = (
            self.solve(parameters, np.exp(own[:, 0] + sign * self._step)) for sign in (-1, 0, 1)
        )
        size, measured = self._points.amplitude, self._turned(own)
        with np.errstate(invalid="ignore"):
            twice = [np.zeros(len(size)), np.log(high[:, 1] * low[:, 1] / here[:, 1] ** 2)]
        twice += [(high + low - 2 * here)[:, h] / size for h in self._compared]
        turned = [np.zeros(len(size))] * 2 + [h**2 * measured[:, h] / size for h in self._compared]
        by_force = split_rows(twice, self._real) / self._step**2
        return 0.5 * (
            by_force * spread[:, None, 0, 0] + split_rows(turned, self._real) * spread[:, None, 1, 1]
        )


def _states(harmonics: ComplexArray, phase: Array, omega: Array) -> Array:
    """(n, 2) displacement and velocity of a waveform at the top of a force of that phase."""
    orders = np.arange(harmonics.shape[1])
    turned = harmonics * np.exp(-1j * phase)[:, None] ** orders
    velocity = 1j * orders * omega[:, None] * turned
    return np.stack([turned.sum(axis=1).real, velocity.sum(axis=1).real], axis=1)


def _moves(start: FittedModel) -> Array:
    """Step of each parameter that moves the response by ``_MOVE``, root mean square over all points.

    Zero where the response does not depend on the parameter: there is nothing to differentiate.
    """
    size, strength = np.abs(start.regression.parameters), start.regression.strength
    acts = strength * size > _ROUND_OFF * np.max(strength * size, initial=0.0)
    return np.where(acts, np.minimum(_MOVE / np.where(acts, strength, 1.0), 0.1 * size), 0.0)
