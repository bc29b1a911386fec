"""The compiled steady state as forward model, started on the measured branch.

For laws that jump or have corners a truncated Fourier series is not the motion; the time-domain steady state
is. Derivatives are differences whose step moves the response by a fixed small amount; they are kept from step
to step, because near the estimate they change less than the estimate itself has to.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import BRANCH_DISTANCE, FINITE_DIFFERENCE_STEP, OUTLIER_SIGMAS, ROUND_OFF
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.harmonic_balance import Response
from rsgen.dynamics.settling import SteadyStates
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.identification.fitting.forward import Forward
from rsgen.law.element import Element
from rsgen.law.motion import Motion
from rsgen.law.numeric import ForceLaw

_CURVED = (FINITE_DIFFERENCE_STEP, 2e-2)
"""Least and largest relative change of the force by which second derivatives are taken."""

_STEEP = 20.0
"""Points whose amplitude grows by a larger power of the force lie at a fold: force noise decides there."""


class Simulator(Forward):
    """Steady states of all points near the measured ones; their size is |F|, their reference the force.

    Parameters
    ----------
    elements, law
        The laws, for the kernel and as array functions.
    motion, force
        Near the measured ones: where to start; force (n,) complex [N].
    amplitude
        (n,) measured X [m] of the mode.
    compared
        Harmonics to predict.
    parameters, strength
        (q,) near the solution, and root mean square change of the prediction by a unit of each, relative.
    noise
        Relative noise found so far.
    null
        (q, d) directions that change no response, as the exact slopes of the balance say. Differences of
        simulations do not vanish along them: parameters would move there without end.
    accuracy
        Of the simulated amplitude, relative.
    """

    exact_slopes = False

    def __init__(
        self,
        elements: tuple[Element, ...],
        law: ForceLaw,
        motion: Motion,
        amplitude: Array,
        force: ComplexArray,
        compared: Sequence[int],
        parameters: Array,
        strength: Array,
        noise: float,
        *,
        null: Array,
        accuracy: float,
    ) -> None:
        self._elements, self._law, self._omega = elements, law, motion.omega
        self._amplitude, self._accuracy = amplitude, accuracy
        self.harmonics = tuple(h for h in compared if (h % 2 or not law.odd) and (h or law.springs))
        self._highest = max([1, *self.harmonics])
        self._branch = max(BRANCH_DISTANCE, OUTLIER_SIGMAS * noise)
        self.step = float(np.clip(noise, *_CURVED))
        self._moves = _moves(parameters, strength)
        unit = np.where(self._moves > 0, self._moves, 1.0)
        none = null / unit[:, None]
        self._determined: Array = (np.eye(len(unit)) - none @ np.linalg.pinv(none)) * unit[:, None] / unit
        self._slopes: tuple[ComplexArray, ComplexArray, NDArray[np.bool_]] | None = None
        self._state = motion.turned(-np.angle(force)).states()
        # a step is tried, refused perhaps, and the place before it asked for again
        self._lately: deque[tuple[tuple[bytes, bytes, float], SteadyStates | None]] = deque(maxlen=2)

    def renew(self) -> None:
        """Take the derivatives anew at the next call."""
        self._slopes = None

    def __call__(self, values: Array, mass: float, size: Array, others: Array | None = None) -> Response:
        """Predict at (p,) values, a mass [kg] and (n,) forces [N]; derivatives are of the first call."""
        parameters = np.append(values, mass)
        if self._slopes is None:
            states = self._states_of(parameters, size, self._accuracy)
            predicted = self._near(states)
            if states is not None:
                found = np.isfinite(predicted[:, 1])
                self._state = go_on(states, found, self._state)
            self._slopes = self._differentiate(parameters, size, predicted)
        else:
            predicted = self.solve(parameters, size, self._accuracy)
        by_force, by_parameter, steep = self._slopes
        known = np.isfinite(by_parameter).all(axis=(1, 2)) & np.isfinite(by_force).all(axis=1)
        drive = size.astype(complex)
        none = np.zeros((len(size), by_parameter.shape[2]), dtype=complex)
        valid = known & ~steep & np.isfinite(predicted[:, 1])
        return Response(drive, predicted, drive, by_force, none, by_parameter, valid)

    def solve(self, parameters: Array, drive: Array, accuracy: float) -> ComplexArray:
        """(n, H+1) harmonics [m] under the forces [N] of phase zero; NaN off the measured branch."""
        return self._near(self._states_of(parameters, drive, accuracy))

    def _near(self, states: SteadyStates | None) -> ComplexArray:
        if states is None:
            return np.full((len(self._omega), self._highest + 1), np.nan + 0j)
        size = np.abs(states.harmonics[:, 1])
        good = states.settled & (np.abs(size / self._amplitude - 1) < self._branch)
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
        values = dict(zip(self._law.parameters, map(float, parameters), strict=False))
        try:
            return solve_steady_states(
                Oscillator(float(parameters[-1]), self._elements, values),
                drive.astype(complex),
                self._omega / (2 * np.pi),
                harmonics=self._highest,
                accuracy=accuracy,
                start=self._state,
            )
        except RsgenError:
            return None

    def _differentiate(
        self, parameters: Array, drive: Array, base: ComplexArray
    ) -> tuple[ComplexArray, ComplexArray, NDArray[np.bool_]]:
        # the error of the simulation then matters no more than that of the difference
        accuracy = max(self._accuracy, FINITE_DIFFERENCE_STEP**2)
        by_force = (
            self.solve(parameters, drive * (1 + FINITE_DIFFERENCE_STEP), accuracy) - base
        ) / FINITE_DIFFERENCE_STEP
        columns = []
        for j, move in enumerate(self._moves):
            trial = np.array(parameters)
            trial[j] += move
            # nothing moves where the response does not depend on the parameter
            moved = self.solve(trial, drive, accuracy) if move else base
            columns.append((moved - base) / (move or 1.0))
        none = np.zeros((*base.shape, 0), dtype=complex)
        with np.errstate(invalid="ignore"):
            steep = ~(np.abs(by_force[:, 1]) < _STEEP * np.abs(base[:, 1]))
        by_parameter = np.stack(columns, axis=-1) if columns else none
        determined = (by_parameter @ self._determined).astype(complex)
        return by_force, determined, steep


def go_on(states: SteadyStates, good: NDArray[np.bool_], before: Array) -> Array:
    """(n, D) states to start from: those of good points, else the ones before, memories at rest."""
    begun = np.zeros_like(states.state)
    begun[:, : before.shape[1]] = before
    return np.where(good[:, None], states.state, begun)


def _moves(parameters: Array, strength: Array) -> Array:
    """Return the step of each parameter that moves the response by ``FINITE_DIFFERENCE_STEP`` (r.m.s.).

    Zero where the response does not depend on the parameter: there is nothing to differentiate.
    """
    size = np.abs(parameters)
    acts = strength * size > ROUND_OFF * np.max(strength * size, initial=0.0)
    return np.where(acts, np.minimum(FINITE_DIFFERENCE_STEP / np.where(acts, strength, 1.0), 0.1 * size), 0.0)
