"""The Cramer-Rao bound of a test, from the true law alone: nothing here is shared with identification.

Force and response both carry noise, e_F on the force and e_h on every harmonic. To first order the measured
response differs from what the law makes of the *measured* force by  e_h - (dX_h/dF) e_F,  so that the
covariance of this effective residual is S = S_X + G S_F G^T, with G = dX/dF in real parts; the bound is the
inverse of sum_points J^T S^-1 J with J = dX/dp.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.oscillator import Oscillator
from rsgen.steady_state import SteadyStates, solve_steady_states
from rsgen.surface import ResponseSurface

__all__ = ["cramer_rao"]

Array = NDArray[np.float64]

ACCURACY = 1e-8
"""Of the steady states: a thousandth of what a step moves them."""

STEP = 1e-3
"""Relative step of the differences; their error is its square."""

JUMPED = 0.2
"""A response that a step changes by more, relatively, has left its branch: no derivative there."""


def cramer_rao(oscillator: Oscillator, surface: ResponseSurface, relative: float) -> dict[str, float]:
    """Bound on the standard deviation of every parameter, "m" for the mass.

    Parameters
    ----------
    oscillator
        The truth.
    surface
        The points of the test that are used, without noise.
    relative
        Standard deviation of the complex noise, of |F| on the force and of |X1| on every harmonic.
    """
    still = surface.settled & (surface.amplitude > 0)
    surface = surface.select(still)
    harmonics = surface.harmonics.shape[1] - 1
    begin = solve_steady_states(
        oscillator, surface.force, surface.frequency, harmonics=harmonics, accuracy=ACCURACY
    )

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
        up, down = (solve({**true, name: value + s * h}, surface.force) for s in (1, -1))
        by.append(slope(up, down, 2 * h))
    level = np.abs(surface.force)
    up, down = (solve(true, surface.force * (1 + s * STEP)) for s in (1, -1))
    grow = slope(up, down, 2 * STEP * level)
    # a turn of the force by a turns harmonic h by h a
    turn = 1j * np.arange(harmonics + 1) * begin.harmonics / level[:, None]

    def real(values: NDArray[np.complex128]) -> Array:
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
    return dict(zip(true, np.sqrt(np.diag(inverse)), strict=True))
