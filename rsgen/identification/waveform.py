"""The waveform balance: which force does it take to hold the fundamental at X, all harmonics included?

At a given amplitude X and frequency the balance of  m a + n(x, v) - f  in every harmonic has one solution,
also where the response folds over the force; so it serves as forward model for measured points on any branch
(METHOD.md 4, slices of constant amplitude). With one harmonic it is first-order harmonic balance,
Liu et al., Eqs. (4), (5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.fourier import FourierSeries, fourier_series
from rsgen.law.numeric import ForceLaw

__all__ = ["Balance", "HeldAmplitude", "hold_amplitude"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_BLOCK = 384
"""Points a block: its sample arrays stay in the processor's cache."""

_STEPS = 12
"""Newton steps for the slaved harmonics; from a near start one or two suffice."""

_SETTLED = 1e-10
"""Relative step at which the slaved harmonics have converged: the next one would be its square."""

_CONVERGED = 1e-6
"""Relative last step that is still called convergence."""

_FAR = 0.5
"""Relative change beyond which slopes no longer lead from one trial to the next."""


@dataclass(frozen=True, slots=True, eq=False)
class Balance:
    """The balance at n points with H harmonics and q parameters (laws first, then the mass).

    Parameters
    ----------
    force
        (n,) complex [N], relative to a fundamental X_1 = X of phase zero.
    harmonics
        (n, H+1) complex [m]; column 1 is X, those that are not slaved are zero.
    force_slope, harmonics_slope
        (n,), (n, H+1): derivatives by X.
    force_by, harmonics_by
        (n, q), (n, H+1, q): derivatives by the parameters.
    converged
        (n,) False where the slaved harmonics did not settle.
    """

    force: ComplexArray
    harmonics: ComplexArray
    force_slope: ComplexArray
    harmonics_slope: ComplexArray
    force_by: ComplexArray
    harmonics_by: ComplexArray
    converged: NDArray[np.bool_]


def hold_amplitude(
    law: ForceLaw,
    values: Array,
    mass: float,
    omega: Array,
    amplitude: Array,
    start: ComplexArray,
    slaved: tuple[int, ...],
    samples: int,
) -> Balance:
    """Solve the balance at given amplitudes of the fundamental.

    Parameters
    ----------
    law, values, mass
        The force law, its (p,) parameters and m [kg].
    omega, amplitude
        (n,) [rad/s] and X [m].
    start
        (n, H+1) first guess of the slaved harmonics [m].
    slaved
        Harmonics that follow from the balance: a subset of 0, 2, ..., H.
    samples
        Samples a period, more than four times H.
    """
    # odd harmonics under an odd law repeat with the other sign after half a period
    half = law.odd and all(h % 2 for h in slaved)
    series = fourier_series((1, *slaved), samples, half)
    parts = [
        _block(law, values, mass, omega[part], amplitude[part], start[part], series)
        for part in (slice(i, i + _BLOCK) for i in range(0, len(omega), _BLOCK))
    ]
    names = Balance.__dataclass_fields__
    return Balance(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _block(
    law: ForceLaw,
    values: Array,
    mass: float,
    omega: Array,
    amplitude: Array,
    start: ComplexArray,
    series: FourierSeries,
) -> Balance:
    orders = list(series.orders)
    at = series.real(start[:, orders])
    at[:, 0], at[:, 1] = amplitude, 0.0
    accelerated = -((series.order_of * omega[:, None]) ** 2)
    diagonal = np.arange(at.shape[1])
    update, step = np.zeros_like(at[:, 2:]), np.zeros(len(at))
    for _ in range(_STEPS):
        x, v = at @ series.shape, (omega[:, None] * at) @ series.rate
        # only switches ask for the acceleration
        a = (omega[:, None] ** 2 * at) @ series.bend if law.switched else v
        sample = law.sample(x, v, a, (series.step / omega)[:, None], values)
        residual = mass * accelerated * at + sample.force @ series.project
        tangent = series.tangent(sample.by_x, omega[:, None] * sample.by_v)
        tangent[:, diagonal, diagonal] += mass * accelerated
        if at.shape[1] == 2:
            break
        update = _solve(tangent[:, 2:, 2:], residual[:, 2:, None])[..., 0]
        size = np.abs(update).max(axis=1)
        update *= np.minimum(1.0, 0.5 * amplitude / np.maximum(size, 1e-300))[:, None]
        at[:, 2:] -= update
        step = size / amplitude
        if np.all(step < _SETTLED):
            break

    # slopes, and what the last step changed, are those of the place before it
    force = residual[:, :2] - (tangent[:, :2, 2:] @ update[..., None])[..., 0]
    columns = [part @ series.project for part in sample.by_parameter]
    by = np.stack([tangent[:, :, 0], *columns, accelerated * at], axis=-1)
    follow = -_solve(tangent[:, 2:, 2:], by[:, 2:]) if len(orders) > 1 else by[:, 2:]
    through = by[:, :2] + tangent[:, :2, 2:] @ follow
    fundamental = through[:, 0] + 1j * through[:, 1]
    harmonics = np.zeros(start.shape, dtype=complex)
    harmonics[:, orders] = series.complex(at)
    moved = np.zeros((*start.shape, by.shape[2]), dtype=complex)
    moved[:, orders[1:]] = series.complex(np.concatenate([by[:, :2], follow], axis=1))[:, 1:]
    moved[:, 1, 0] = 1.0
    return Balance(
        force[:, 0] + 1j * force[:, 1],
        harmonics,
        fundamental[:, 0],
        moved[:, :, 0],
        fundamental[:, 1:],
        moved[:, :, 1:],
        step <= _CONVERGED,
    )


def _solve(matrix: Array, right: Array) -> Array:
    """Solve a batch; a singular member gets the solution of smallest norm instead of spoiling the batch."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        solution = np.asarray(np.linalg.pinv(np.nan_to_num(matrix)) @ right)
        solution[~np.isfinite(matrix).all(axis=(1, 2))] = np.nan
        return solution


class HeldAmplitude:
    """``hold_amplitude`` from trial to trial: each begins where slopes lead from the one before.

    Parameters
    ----------
    law, omega, start, slaved
        As for ``hold_amplitude``; ``start`` serves the first trial, and points that did not converge.
    """

    def __init__(self, law: ForceLaw, omega: Array, start: ComplexArray, slaved: tuple[int, ...]) -> None:
        self._law, self._omega, self._start, self._slaved = law, omega, start, slaved
        self._last: tuple[Array, Array, int, Balance] | None = None

    def __call__(self, values: Array, mass: float, amplitude: Array, samples: int) -> Balance:
        """Solve at (p,) values, a mass [kg] and (n,) amplitudes [m]."""
        parameters = np.append(values, mass)
        guess = self._start
        if self._last is not None:
            before, size, sampled, balance = self._last
            same = np.array_equal(before, parameters) and np.array_equal(size, amplitude)
            if same and sampled == samples:
                return balance
            guess = self._next(balance, parameters - before, amplitude - size)
        balance = hold_amplitude(
            self._law, values, mass, self._omega, amplitude, guess, self._slaved, samples
        )
        self._last = (parameters, np.array(amplitude), samples, balance)
        return balance

    def _next(self, balance: Balance, change: Array, growth: Array) -> ComplexArray:
        along = balance.harmonics_slope * growth[:, None] + balance.harmonics_by @ change
        size = np.abs(balance.harmonics[:, 1:2])
        # what did not converge is not finite at times, and no guide
        with np.errstate(invalid="ignore"):
            near = np.abs(along).max(axis=1, keepdims=True) < _FAR * size
            guess = balance.harmonics + np.where(near, along, 0)
        good = balance.converged & np.isfinite(guess).all(axis=1)
        return np.where(good[:, None], guess, self._start)
