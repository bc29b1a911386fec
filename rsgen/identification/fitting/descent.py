"""Residuals, slopes and curvature of measured points under any forward model: what a fit descends on."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from rsgen.common.arrays import Array
from rsgen.dynamics.harmonic_balance import Response
from rsgen.identification.fitting.forward import Forward
from rsgen.identification.fitting.least_squares import Linearisation, Regression, remove_bias
from rsgen.identification.fitting.observed import Observed

__all__ = ["Descent", "Parametrised"]


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
        self.scale: Array | None = None

    def predict(self, parameters: Array, nuisance: Array) -> Response:
        """Ask the forward model at (q,) parameters and (n, k) nuisances."""
        values, mass, _ = self.problem.split(parameters)
        return self.forward(values, mass, np.exp(nuisance[:, 0]), nuisance[:, 1:])

    def linearise(self, parameters: Array, nuisance: Array) -> Linearisation:
        """Compare prediction and measurement, with slopes, in units of the expected noise."""
        line, weight = self._rows(parameters, nuisance)
        if weight is None:
            return line
        return Linearisation(
            (weight @ line.residual[:, :, None])[:, :, 0],
            weight @ line.by_nuisance,
            weight @ line.by_parameter,
        )

    def _rows(self, parameters: Array, nuisance: Array) -> tuple[Linearisation, Array | None]:
        """Compare; and (n, M, M) what makes the noise of the rows independent and of unit size.

        Noise of the other harmonics of the force is in the predicted motion. None where there are none.
        """
        response, observed = self.predict(parameters, nuisance), self.problem.observed
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
        return remove_bias(
            found,
            self.linearise(found.parameters, found.nuisance),
            lambda direction: self._bend(found.parameters, found.nuisance, direction),
        )

    def _bend(self, parameters: Array, nuisance: Array, direction: Array) -> tuple[Array, Array]:
        """Differences along directions (n, k), in steps that suit the model; see ``remove_bias``."""
        length = np.abs(direction).max(axis=1, keepdims=True)
        unit, step = direction / np.where(length > 0, length, 1.0), self.forward.step
        low, high = (self._rows(parameters, nuisance + sign * step * unit)[0] for sign in (-1, 1))
        here, weight = self._rows(parameters, nuisance)
        if self.forward.exact_slopes:
            second = ((high.by_nuisance - low.by_nuisance) @ unit[:, :, None])[:, :, 0] / (2 * step)
        else:
            second = (2 * here.residual - high.residual - low.residual) / step**2
        second = second * length**2
        slopes = (high.by_parameter - low.by_parameter) * (length / (2 * step))[:, :, None]
        if weight is not None:
            second, slopes = (weight @ second[:, :, None])[:, :, 0], weight @ slopes
        return np.asarray(second), np.asarray(slopes)
