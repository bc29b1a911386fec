"""Forward models: from parameters to force and motion at every test point; residuals of a fit under them.

The harmonic balance solves -m (h omega)^2 X_h + N_h(x) = F_h for the harmonics of a motion of given amplitude
|X_1|, and for the force. At a given amplitude it has one solution, also where the response folds over the
force, so that it predicts measured points on any branch. The other forward model is the simulator: steady
states in time under a given force, from the measured branch. ``ErrorsInVariables`` compares either with the
measured points.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import (
    BRANCH_DISTANCE,
    FINITE_DIFFERENCE_STEP,
    MAX_LINEAR_CHANGE,
    MAX_NEWTON_STEPS,
    OUTLIER_SIGMAS,
    ROUND_OFF,
    SAMPLES_PER_PERIOD,
)
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.harmonic_balance import ACCEPTED_STEP, Response, following_harmonics, hold_amplitude
from rsgen.dynamics.settling import SteadyStates
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.identification.fitting.least_squares import (
    Linearisation,
    Regression,
    orthonormal,
    subtract_along,
)
from rsgen.identification.fitting.observed import Comparison, Observed
from rsgen.law.element import Element
from rsgen.law.motion import Motion
from rsgen.law.numeric import ForceLaw


class Forward(Protocol):
    """A forward model: values of the parameters to the response at every test point."""

    harmonics: tuple[int, ...] = ()
    """Predicted harmonics other than the fundamental."""

    step: float = 1e-4
    """Change h of the logarithm of the size for second derivatives: error h^2, round-off eps/h."""

    exact_slopes: bool = True
    """True if slopes are computed at every call, False if they are kept for several."""

    def __call__(self, values: Array, mass: float, size: Array, others: Array | None = None) -> Response:
        """Predict at (p,) values, a mass [kg], (n,) sizes and (n, k - 1) other nuisances.

        Only a law across two sensors depends on the other nuisances.
        """
        ...

    def of_sensors(self, influence: Array) -> Array:
        """Convert the influence (n, M, q) of nuisances' rows to that of deviations of the sensors."""
        return influence


def _place_of_rest(law: ForceLaw, values: Array, size: float) -> float:
    """Return the place of rest [m] near zero by Newton steps of at most size [m]; zero if there is none."""
    x = np.zeros(1)
    for _ in range(MAX_NEWTON_STEPS):
        sample = law.still(x, values)
        force, slope = float(sample.force[0]), float(sample.by_x[0])
        step = -force / slope if slope > 0 and np.isfinite(force) else np.inf
        if abs(step) < ACCEPTED_STEP * size:
            return float(x[0])
        if not np.isfinite(step):
            return 0.0
        x = x + np.clip(step, -size, size)
    return 0.0


class HarmonicBalance(Forward):
    """Harmonic balance at given amplitudes; each call starts from the linear prediction of the last one.

    Parameters
    ----------
    law
        The force law.
    start
        Measured motion, from which the first solution starts, and points that did not converge.
    order
        Highest harmonic.
    compared
        Highest compared harmonic, not below the order: harmonics beyond the order are predicted as zero.
    about_rest
        True if motions start about the place of rest of the law, because the mean was not measured.
    load
        (n, K+1) harmonics of the force [N] in the phase of the measured response, without regard to the
        fundamental; None: the force is a sine.
    """

    step = 1e-5
    """Step h of second derivatives, with an error of h by the difference, and of h by slopes of the last
    step.
    """

    def __init__(
        self,
        law: ForceLaw,
        start: Motion,
        order: int,
        *,
        compared: int = 0,
        about_rest: bool = False,
        load: ComplexArray | None = None,
    ) -> None:
        even = load is not None and bool(np.any(load[:, ::2]))
        highest = max(order, compared, 1)
        self._follow = following_harmonics(law, order, even=even)
        self.harmonics = following_harmonics(law, highest, even=even)
        self.samples = max(SAMPLES_PER_PERIOD, 1 << (6 * order - 1).bit_length())
        self._start = np.zeros((len(start), highest + 1), dtype=complex)
        known = [h for h in self._follow if h < len(start.orders)]
        self._start[:, known] = start.turned(-np.angle(start.harmonics[:, 1])).harmonics[:, known]
        self._load = None
        if load is not None:
            self._load = np.zeros_like(self._start)
            count = min(load.shape[1], self._start.shape[1])
            turned = Motion(start.omega, load).turned(-np.angle(start.harmonics[:, 1])).harmonics
            self._load[:, :count] = turned[:, :count]
        self._law, self._omega = law, start.omega
        self._about_rest = about_rest and 0 in self.harmonics
        self._last: tuple[Array, Array, int, Response] | None = None

    def __call__(self, values: Array, mass: float, size: Array, others: Array | None = None) -> Response:
        """Solve at (p,) values, a mass [kg] and (n,) amplitudes [m]."""
        parameters = np.append(values, mass)
        if self._about_rest:
            self._start[:, 0] = _place_of_rest(self._law, values, float(np.max(size)))
        guess = self._start
        if self._last is not None:
            before, last, sampled, response = self._last
            same = np.array_equal(before, parameters) and np.array_equal(last, size)
            if same and sampled == self.samples:
                return response
            guess = self._next(response, parameters - before, np.log(size / last))
        response = hold_amplitude(
            self._law, values, mass, self._omega, size, guess, self._follow, self.samples, self._load
        )
        self._last = (parameters, np.array(size), self.samples, response)
        return response

    def _next(self, response: Response, change: Array, growth: Array) -> ComplexArray:
        along = response.harmonics_slope * growth[:, None] + response.harmonics_by @ change
        size = np.abs(response.harmonics[:, 1:2])
        # points that did not converge may be infinite
        with np.errstate(invalid="ignore"):
            near = np.abs(along).max(axis=1, keepdims=True) < MAX_LINEAR_CHANGE * size
            guess = response.harmonics + np.where(near, along, 0)
        good = response.valid & np.isfinite(guess).all(axis=1)
        return np.where(good[:, None], guess, self._start)


# ----------------------------------------------------------------------------
# The simulator. For laws that jump or have corners a truncated Fourier series is not the motion; the steady
# state in time is. Derivatives are differences whose step moves the response by a fixed small amount; they
# are kept from step to step, because near the estimate they change less than the estimate itself has to.

_CURVED = (FINITE_DIFFERENCE_STEP, 2e-2)
"""Least and largest relative change of the force by which second derivatives are taken."""

MAX_POWER_OF_FORCE = 20.0
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
        values = dict(zip(self._law.parameters, map(float, parameters), strict=False))
        found: SteadyStates | None = None
        with suppress(RsgenError):
            found = solve_steady_states(
                Oscillator(float(parameters[-1]), self._elements, values),
                drive.astype(complex),
                self._omega / (2 * np.pi),
                harmonics=self._highest,
                accuracy=accuracy,
                start=self._state,
            )
        self._lately.append((asked, found))
        return found

    def _differentiate(
        self, parameters: Array, drive: Array, base: ComplexArray
    ) -> tuple[ComplexArray, ComplexArray, NDArray[np.bool_]]:
        # the error of the simulation then matters no more than that of the difference
        accuracy = max(self._accuracy, FINITE_DIFFERENCE_STEP**2)
        more = self.solve(parameters, drive * (1 + FINITE_DIFFERENCE_STEP), accuracy)
        by_force = (more - base) / FINITE_DIFFERENCE_STEP
        columns = []
        for j, move in enumerate(self._moves):
            trial = np.array(parameters)
            trial[j] += move
            # nothing moves where the response does not depend on the parameter
            moved = self.solve(trial, drive, accuracy) if move else base
            columns.append((moved - base) / (move or 1.0))
        none = np.zeros((*base.shape, 0), dtype=complex)
        with np.errstate(invalid="ignore"):
            steep = ~(np.abs(by_force[:, 1]) < MAX_POWER_OF_FORCE * np.abs(base[:, 1]))
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


# ----------------------------------------------------------------------------
# Residuals, slopes and curvature of measured points under any forward model.


class Parametrised(Protocol):
    """The members of a problem that ``ErrorsInVariables`` uses."""

    @property
    def observed(self) -> Observed:
        """The measured points."""
        ...

    def split(self, parameters: Array) -> tuple[Array, float, Array]:
        """Return the values for the forward model, mass [kg] and background."""
        ...


Bend = Callable[[Array], tuple[Array, Array]]
"""Function of directions (n, k) of the nuisances: second derivatives (n, M) of the prediction along them, and
the change (n, M, q) of its slopes by the parameters."""


def remove_bias(found: Regression, line: Linearisation, bend: Bend) -> Regression:
    """Correct the parameters for the bias by the square of the noise.

    An error e of the nuisances changes the prediction by e.H.e/2 to second order, on average by trace(H C)/2
    with C = L L^T their covariance: second derivatives along the columns of L. The change of the slopes by
    the parameters adds noise to the information (attenuation; Fuller, Measurement Error Models, 1987, chapter
    2).
    """
    # the last nuisance first: only one column of L = R^-1 then needs a new prediction for it
    units, triangle = orthonormal(line.by_nuisance[:, :, ::-1])
    regular = found.used & np.all(np.diagonal(triangle, axis1=1, axis2=2) > 0, axis=1)
    factor = np.zeros_like(triangle)
    factor[regular] = np.linalg.inv(triangle[regular])[:, ::-1] * found.sigma
    shift, share = np.zeros(line.residual.shape), np.zeros((found.basis.shape[1],) * 2)
    for column in np.moveaxis(factor, 2, 0):
        second, slopes = bend(column)
        shift += 0.5 * second
        subtract_along(units, slopes := np.nan_to_num(slopes))
        moved = slopes[regular] @ found.basis
        share += np.tensordot(moved, moved, ([0, 1], [0, 1]))
    regular &= np.isfinite(shift).all(axis=1)
    residual, matrix = shift, np.array(line.by_parameter)
    subtract_along(units, residual[:, :, None])
    subtract_along(units, matrix)
    # what is known of the parameters beforehand has no such bias
    rules = replace(found.rules, known=found.parameters, natural=0.0)
    equations = rules.equations(residual, matrix, found.parameters, regular)
    change, _, _ = rules.solve(*equations, found.parameters)
    # residual at the corrected parameters
    moved = found.residual - np.nan_to_num(matrix) @ change
    moved[regular] += residual[regular]
    moved[~found.used] = 0.0
    largest = float(np.linalg.eigvalsh(share)[-1]) if len(share) else 0.0
    return replace(found, parameters=found.parameters + change, residual=moved, noise_share=largest)


class ErrorsInVariables:
    """Residuals and curvature of a problem under a forward model.

    ``scale`` is None where plain differences are compared, and an array (``Comparison.scale``) where
    logarithms are: fits set it once they are near the solution.
    """

    def __init__(self, problem: Parametrised, forward: Forward) -> None:
        self.problem, self.forward = problem, forward
        self.compared = problem.observed.compared(forward.harmonics)
        self.scale = problem.observed.scale

    def predict(self, parameters: Array, nuisance: Array) -> Response:
        """Predict the response at (q,) parameters and (n, k) nuisances."""
        values, mass, _ = self.problem.split(parameters)
        return self.forward(values, mass, np.exp(nuisance[:, 0]), nuisance[:, 1:])

    def linearise(
        self, parameters: Array, nuisance: Array, response: Response | None = None
    ) -> Linearisation:
        """Return residuals and slopes of the prediction, or of a response, in units of the expected noise."""
        return self._weighted(*self._rows(parameters, nuisance, response))

    @staticmethod
    def _weighted(line: Linearisation, weight: Array | None) -> Linearisation:
        if weight is None:
            return line
        return Linearisation(
            (weight @ line.residual[:, :, None])[:, :, 0],
            weight @ line.by_nuisance,
            weight @ line.by_parameter,
        )

    def _rows(
        self, parameters: Array, nuisance: Array, response: Response | None = None
    ) -> tuple[Linearisation, Array | None]:
        """Return residuals and slopes, and the whitening matrices (n, M, M) of their noise.

        Noise of higher harmonics of the force changes the predicted motion; None without these.
        """
        response = self.predict(parameters, nuisance) if response is None else response
        observed = self.problem.observed
        at = Comparison(self.problem.split(parameters)[2], nuisance, self.scale, self.compared)
        noise = observed.load_noise(response, at)
        weight = None
        if noise is not None:
            covariance = np.eye(noise.shape[1]) + noise @ noise.transpose(0, 2, 1)
            weight = np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
        return observed.linearise(response, at), weight

    def of_deviations(self, found: Regression) -> Regression:
        """Return a fit with the influence (n, M, q) of relative deviations of sensors in place of rows."""
        observed, influence = self.problem.observed, found.influence
        if observed.points.load is not None:
            weight = self._rows(found.parameters, found.nuisance)[1]
            influence = influence if weight is None else weight.transpose(0, 2, 1) @ influence
        if self.scale is None:
            values = self.problem.split(found.parameters)[2]
            influence = observed.relative_influence(influence, values, found.nuisance)
        return replace(found, influence=self.forward.of_sensors(observed.plain_influence(influence)))

    def corrected(self, found: Regression) -> Regression:
        """Remove the bias of the square of the noise."""
        place = found.parameters, found.nuisance
        here = self._rows(*place)
        return remove_bias(
            found, self._weighted(*here), lambda direction: self._bend(*place, direction, here)
        )

    def _bend(
        self, parameters: Array, nuisance: Array, direction: Array, rows: tuple[Linearisation, Array | None]
    ) -> tuple[Array, Array]:
        """Return differences of the rows along directions (n, k); see ``remove_bias``."""
        length = np.abs(direction).max(axis=1, keepdims=True)
        unit, step = direction / np.where(length > 0, length, 1.0), self.forward.step
        here, weight = rows
        high = self._rows(parameters, nuisance + step * unit)[0]
        if self.forward.exact_slopes:
            second = ((high.by_nuisance - here.by_nuisance) @ unit[:, :, None])[:, :, 0] / step
            slopes = (high.by_parameter - here.by_parameter) * (length / step)[:, :, None]
        else:
            low = self._rows(parameters, nuisance - step * unit)[0]
            second = (2 * here.residual - high.residual - low.residual) / step**2
            slopes = (high.by_parameter - low.by_parameter) * (length / (2 * step))[:, :, None]
        second = second * length**2
        if weight is not None:
            second, slopes = (weight @ second[:, :, None])[:, :, 0], weight @ slopes
        return np.asarray(second), np.asarray(slopes)
