"""Forward models: from parameters to force and motion at every test point; residuals of a fit under them.

The harmonic balance solves -m (h omega)^2 X_h + N_h(x) = F_h for the harmonics of a motion of given amplitude
|X_1|, and for the force. At a given amplitude it has one solution, also where the response folds over the
force, so that it predicts measured points on any branch. The other forward model is the simulator, for a
given force (``simulator``). ``ErrorsInVariables`` compares either with the measured points.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.tolerances import MAX_LINEAR_CHANGE, MAX_NEWTON_STEPS, SAMPLES_PER_PERIOD
from rsgen.dynamics.harmonic_balance import Response, following_harmonics, hold_amplitude
from rsgen.dynamics.linear_part import Inertia
from rsgen.identification.fitting.least_squares import Linearisation, Regression, remove_bias
from rsgen.identification.fitting.observed import Observed
from rsgen.law.motion import Motion
from rsgen.law.numeric import ForceLaw

_REST_TOLERANCE = 1e-6
"""Relative last step of Newton's method to the place of rest."""


class Forward(Protocol):
    """A forward model: values of the parameters to the response at every test point."""

    harmonics: tuple[int, ...]
    """Predicted harmonics other than the fundamental."""

    step: float
    """Change of the logarithm of the size by which second derivatives are taken."""

    exact_slopes: bool
    """True if slopes are computed at every call, False if they are kept for several."""

    def __call__(self, values: Array, mass: float, size: Array, others: Array | None = None) -> Response:
        """Predict at (p,) values, a mass [kg], (n,) sizes and (n, k - 1) other nuisances.

        Only a law across two sensors depends on the other nuisances.
        """
        ...

    def share(self, systematic: Callable[[], bool]) -> bool:
        """Correlate the sensors if the misfit is systematic; return True if that changes the model."""
        return False

    def of_noise(self, found: Regression, corrected: Callable[[], Regression]) -> Regression:
        """Return the regression with the noise share of the slopes of a law with corners."""
        return found

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
        if abs(step) < _REST_TOLERANCE * size:
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

    exact_slopes = True
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
            self._law,
            values,
            Inertia(mass),
            self._omega,
            size,
            guess,
            self._follow,
            self.samples,
            self._load,
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

    def compared(self, predicted: tuple[int, ...]) -> tuple[int, ...]:
        """Return the measured ones of the ``predicted`` harmonics, without the fundamental."""
        ...


class ErrorsInVariables:
    """Residuals and curvature of a problem under a forward model."""

    def __init__(self, problem: Parametrised, forward: Forward) -> None:
        self.problem, self.forward = problem, forward
        self.compared = problem.compared(forward.harmonics)
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
        place = self.problem.split(parameters)[2], nuisance, self.scale, self.compared
        noise = observed.load_noise(response, *place)
        weight = None
        if noise is not None:
            covariance = np.eye(noise.shape[1]) + noise @ noise.transpose(0, 2, 1)
            weight = np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
        return observed.linearise(response, *place), weight

    def plain(self, influence: Array, parameters: Array, nuisance: Array) -> Array:
        """Convert the influence (n, M, q) of whitened rows to that of the residuals."""
        if self.problem.observed.points.load is None:
            return influence
        weight = self._rows(parameters, nuisance)[1]
        return influence if weight is None else np.asarray(weight.transpose(0, 2, 1) @ influence)

    def corrected(self, found: Regression) -> Regression:
        """Remove the bias of the square of the noise."""
        place = found.parameters, found.nuisance
        here = self._rows(*place)
        return remove_bias(
            found, self._weighted(*here), lambda direction: self._bend(*place, direction, here)
        )

    def _bend(
        self,
        parameters: Array,
        nuisance: Array,
        direction: Array,
        rows: tuple[Linearisation, Array | None],
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
