"""Forward models: from parameters to force and motion at every test point, and what a fit descends on.

The model here is the harmonic balance. At the amplitude that was measured it has one solution, also where the
response folds over the force; so it serves for measured points on any branch. The other forward model is the
simulator, which is given the force (``simulator.py``).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.tolerances import SAMPLES, TO_REST
from rsgen.dynamics.harmonic_balance import Response, following_harmonics, hold_amplitude
from rsgen.dynamics.linear_part import Inertia
from rsgen.identification.fitting.least_squares import Linearisation, Regression, remove_bias
from rsgen.identification.fitting.observed import Observed
from rsgen.law.motion import Motion
from rsgen.law.numeric import ForceLaw

_AT_REST = 1e-6
"""Relative last step to a place of rest."""

_FAR = 0.5
"""Relative change beyond which slopes no longer lead from one trial to the next."""


class Forward(Protocol):
    """From values to the response at every test point."""

    harmonics: tuple[int, ...]
    """Predicted ones other than the fundamental."""

    step: float
    """Change of the logarithm of the size by which second derivatives are taken."""

    exact_slopes: bool
    """Whether slopes are those of every call; else they stay for many."""

    def __call__(self, values: Array, mass: float, size: Array, others: Array | None = None) -> Response:
        """Predict at (p,) values, a mass [kg], (n,) sizes and (n, k - 1) other nuisances.

        A force that follows the response alone does not depend on the others.
        """
        ...

    def share(self, systematic: Callable[[], bool]) -> bool:
        """Let all sensors share what the law leaves if that is systematic; True where it is another model."""
        return False

    def of_noise(self, found: Regression, corrected: Callable[[], Regression]) -> Regression:
        """Say how much of the slopes of a law with corners is noise, from the correction for noise."""
        return found

    def of_sensors(self, influence: Array) -> Array:
        """Turn the influence (n, M, q) of nuisances' rows into that of relative deviations of the sensors."""
        return influence


def _place_of_rest(law: ForceLaw, values: Array, size: float) -> float:
    """Displacement [m] near zero at which the law exerts no force, in steps of at most size [m]; or zero."""
    x = np.zeros(1)
    for _ in range(TO_REST):
        sample = law.still(x, values)
        force, slope = float(sample.force[0]), float(sample.by_x[0])
        step = -force / slope if slope > 0 and np.isfinite(force) else np.inf
        if abs(step) < _AT_REST * size:
            return float(x[0])
        if not np.isfinite(step):
            return 0.0
        x = x + np.clip(step, -size, size)
    return 0.0


class HarmonicBalance(Forward):
    """The balance from trial to trial: each begins where slopes lead from the one before.

    Parameters
    ----------
    law
        The force law.
    start
        Motion that leads to the branch that was measured; serves the first trial, and points that did not
        converge.
    order
        Highest harmonic.
    compared
        Highest harmonic that is compared, not below the order: those beyond it are predicted to be zero.
    about_rest
        Whether motions begin about the place of rest of the law, because the mean of ``start`` is not known.
    load
        (n, K+1) harmonics of the force [N] in the phase of the measured response, of which the fundamental is
        not looked at; None: the force is a sine.
    """

    exact_slopes = True
    step = 1e-5
    """Leaves the second derivatives five digits: error of a difference h, and of slopes from the step before
    h^2/h."""

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
        self.samples = max(SAMPLES, 1 << (6 * order - 1).bit_length())
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
        # what did not converge is not finite at times, and no guide
        with np.errstate(invalid="ignore"):
            near = np.abs(along).max(axis=1, keepdims=True) < _FAR * size
            guess = response.harmonics + np.where(near, along, 0)
        good = response.valid & np.isfinite(guess).all(axis=1)
        return np.where(good[:, None], guess, self._start)


# ----------------------------------------------------------------------------
# Residuals, slopes and curvature of measured points under any forward model: what a fit descends on.


class Parametrised(Protocol):
    """What is fitted to what, as a descent needs it."""

    @property
    def observed(self) -> Observed:
        """The measured points."""
        ...

    def split(self, parameters: Array) -> tuple[Array, float, Array]:
        """Values for the forward model, mass [kg] and background."""
        ...

    def compared(self, predicted: tuple[int, ...]) -> tuple[int, ...]:
        """Harmonics other than the fundamental that are measured, of those ``predicted``."""
        ...


class Descent:
    """Residuals and curvature of a problem under a forward model."""

    def __init__(self, problem: Parametrised, forward: Forward) -> None:
        self.problem, self.forward = problem, forward
        self.compared = problem.compared(forward.harmonics)
        self.scale = problem.observed.scale

    def predict(self, parameters: Array, nuisance: Array) -> Response:
        """Ask the forward model at (q,) parameters and (n, k) nuisances."""
        values, mass, _ = self.problem.split(parameters)
        return self.forward(values, mass, np.exp(nuisance[:, 0]), nuisance[:, 1:])

    def linearise(
        self, parameters: Array, nuisance: Array, response: Response | None = None
    ) -> Linearisation:
        """Compare prediction, or another response, with measurement, in units of the expected noise."""
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
        """Compare; and (n, M, M) what makes the noise of the rows independent and of unit size.

        Noise of the other harmonics of the force is in the predicted motion. None where there are none.
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
        """Turn the influence (n, M, q) of independent rows into that of the residuals as they are."""
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
        """Differences from the rows there along directions (n, k), in steps that suit the model.

        See ``remove_bias``.
        """
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
