"""The Cramer-Rao bound of a test, from the true law alone: nothing here is shared with identification.

Force and response both carry noise, e_F on the force and e_h on every harmonic. To first order the measured
response differs from what the law makes of the *measured* force by  e_h - (dX_h/dF) e_F,  so that the
covariance of this effective residual is S = S_X + G S_F G^T, with G = dX/dF in real parts; the bound is the
inverse of sum_points J^T S^-1 J with J = dX/dp. With a background the sensor sees the mode and the background
times the force, and the numbers of the background are among the parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.data.oscillator import Oscillator
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.settling import SteadyStates
from rsgen.dynamics.steady_state import solve_steady_states

__all__ = ["Background", "cramer_rao"]

Array = NDArray[np.float64]

ACCURACY = 1e-8
"""Of the steady states: a thousandth of what a step moves them."""

STEP = 1e-3
"""Relative step of the differences; their error is its square."""

JUMPED = 0.2
"""A response that a step changes by more, relatively, has left its branch: no derivative there."""


@dataclass(frozen=True)
class Background:
    """Residual terms of other modes and a phase error: x = q + (A + B/omega^2) F, F = F_measured exp(i psi).

    Parameters
    ----------
    psi
        Phase error [rad].
    flexibility
        A [m/N].
    inertia
        B [1/kg].
    """

    psi: float
    flexibility: complex
    inertia: complex

    def receptance(self, omega: Array) -> NDArray[np.complex128]:
        """b(omega) [m/N]."""
        return np.asarray(self.flexibility + self.inertia / omega**2)

    def seen(self, surface: ResponseSurface) -> ResponseSurface:
        """What the sensors see of a surface of the mode alone: fundamentals without noise."""
        response = surface.harmonics[:, 1] + self.receptance(surface.omega) * surface.force
        force = surface.force * np.exp(-1j * self.psi)
        return ResponseSurface(surface.level, surface.frequency, force, response, outcome=surface.outcome)


def cramer_rao(
    oscillator: Oscillator, surface: ResponseSurface, relative: float, background: Background | None = None
) -> dict[str, float]:
    """Bound on the standard deviation of every parameter, "m" for the mass.

    Parameters
    ----------
    oscillator
        The truth.
    surface
        The points of the test that are used, without noise.
    relative
        Standard deviation of the complex noise, of |F| on the force and of |X1| on every harmonic.
    background
        What the surface holds of other modes; its numbers are unknown to the test. Then only the fundamental
        counts, and ``surface`` is what the sensors see.
    """
    still = surface.settled & (surface.amplitude > 0)
    surface = surface.select(still)
    harmonics = surface.harmonics.shape[1] - 1
    turned = 1.0 if background is None else np.exp(1j * background.psi)
    acting = surface.force * turned
    begin = solve_steady_states(oscillator, acting, surface.frequency, harmonics=harmonics, accuracy=ACCURACY)

    def solve(values: dict[str, float], force: NDArray[np.complex128]) -> SteadyStates:
        truth = Oscillator(values["m"], oscillator.elements, {k: v for k, v in values.items() if k != "m"})
        return solve_steady_states(
            truth, force, surface.frequency, harmonics=harmonics, accuracy=ACCURACY, start=begin.state
        )

    true = {**oscillator.values, "m": oscillator.mass}
    good = begin.settled.copy()

    def slope(plus: SteadyStates, minus: SteadyStates, width: float | Array) -> NDArray[np.complex128]:
        change = plus.harmonics - minus.harmonics
        good[:] &= plus.settled & minus.settled & (np.abs(change[:, 1]) < JUMPED * surface.amplitude)
        return change / (np.asarray(width)[..., None] if np.ndim(width) else width)

    by = []
    for name, value in true.items():
        h = STEP * abs(value)
        up, down = (solve({**true, name: value + s * h}, acting) for s in (1, -1))
        by.append(slope(up, down, 2 * h))
    names = list(true)
    level = np.abs(surface.force)
    up, down = (solve(true, acting * (1 + s * STEP)) for s in (1, -1))
    grow = slope(up, down, 2 * STEP * level)
    # a turn of the force by a turns harmonic h by h a
    turn = 1j * np.arange(harmonics + 1) * begin.harmonics / level[:, None]
    if background is not None:
        b = background.receptance(surface.omega)
        for change, factor in ((grow, 1.0), (turn, 1j)):
            change[:, 1] += factor * b * acting / level
        by.append(turn * level[:, None])
        for unit in (1.0, 1j):
            for function in (np.ones(len(surface)), surface.omega**-2 / np.mean(surface.omega**-2)):
                added = np.zeros_like(turn)
                added[:, 1] = unit * function * acting
                by.append(added)

    def real(values: NDArray[np.complex128]) -> Array:
        if background is not None:
            values = values[:, 1:2]
            parts = np.concatenate([values.real, values.imag], axis=1)
        else:
            parts = np.concatenate([values.real, values.imag[:, 1:]], axis=1)
        return np.asarray(parts / (relative / np.sqrt(2) * surface.amplitude[:, None]))

    jacobian = np.stack([real(part) for part in by], axis=2)
    # in units of the noise: the force as much as the response
    of_force = np.stack([real(part) for part in (grow, turn)], axis=2)
    of_force *= (relative / np.sqrt(2) * level)[:, None, None]
    covariance = np.eye(jacobian.shape[1]) + of_force @ of_force.transpose(0, 2, 1)
    whitened = np.linalg.solve(covariance[good], jacobian[good])
    information = np.einsum("nmp,nmq->pq", jacobian[good], whitened)
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    # the background's own parameters come last and stay out
    return dict(zip(names, np.sqrt(np.diag(inverse))[: len(names)], strict=True))
