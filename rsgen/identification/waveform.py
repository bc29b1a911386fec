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

from rsgen.identification.force_law import ForceLaw, ForceSample

__all__ = ["Balance", "hold_amplitude"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_BLOCK = 384
"""Points a block: its sample arrays stay in the processor's cache."""

_STEPS = 12
"""Newton steps for the slaved harmonics; from a near start two or three suffice."""

_SETTLED = 1e-13
"""Relative step at which the slaved harmonics have converged."""


@dataclass(frozen=True, slots=True, eq=False)
class Balance:
    """The balance at n points with H harmonics and q parameters (laws first, then the mass).

    Parameters
    ----------
    force
        (n,) complex [N], relative to a fundamental X_1 = X of phase zero.
    harmonics
        (n, H+1) complex [m]; column 1 is X.
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
        (n, H+1) first guess of the harmonics [m]; those neither slaved nor 1 are kept as they are.
    slaved
        Harmonics that follow from the balance: a subset of 0, 2, ..., H.
    samples
        Samples a period, at least four times H.
    """
    parts = [
        _block(
            law,
            values,
            mass,
            omega[i : i + _BLOCK],
            amplitude[i : i + _BLOCK],
            start[i : i + _BLOCK],
            slaved,
            samples,
        )
        for i in range(0, len(omega), _BLOCK)
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
    slaved: tuple[int, ...],
    samples: int,
) -> Balance:
    harmonics = np.array(start)
    harmonics[:, 1] = amplitude
    orders = np.arange(harmonics.shape[1])
    inertia = -mass * (orders * omega[:, None]) ** 2
    rows = list(slaved)
    step = np.full(len(omega), np.inf)
    sample = _sample(law, values, omega, harmonics, samples)
    for _ in range(_STEPS if rows else 0):
        residual = inertia * harmonics + _projected(sample.force, orders)
        matrix = _tangent(sample, omega, inertia, orders)
        change = _solve(_real_block(matrix, rows, rows), _real(residual[:, rows], rows)[..., None])[..., 0]
        update = _complex(change, rows)
        limit = np.minimum(1.0, 0.5 * amplitude / np.maximum(np.abs(update).max(axis=1), 1e-300))
        harmonics[:, rows] -= limit[:, None] * update
        step = np.abs(update).max(axis=1) / amplitude
        sample = _sample(law, values, omega, harmonics, samples)
        if np.all(step < _SETTLED) or (law.switched and np.all(step < 1e-10)):
            break

    matrix = _tangent(sample, omega, inertia, orders)
    count = len(law.parameters)
    by = np.stack([_projected(part, orders) for part in sample.by_parameter], axis=-1) if count else None
    by_mass = (-((orders * omega[:, None]) ** 2) * harmonics)[..., None]
    residual_by = by_mass if by is None else np.concatenate([by, by_mass], axis=-1)
    fundamental = (inertia * harmonics + _projected(sample.force, orders))[:, 1]
    slope = np.zeros_like(harmonics)
    harmonics_by = np.zeros((*harmonics.shape, count + 1), dtype=complex)
    slope[:, 1] = 1.0
    force_slope = _complex(_real_block(matrix, [1], [1])[:, :, 0], [1])[:, 0]
    force_by = residual_by[:, 1]
    if rows:
        right = np.concatenate(
            [_real_block(matrix, rows, [1])[:, :, :1], _real(residual_by[:, rows], rows)], axis=-1
        )
        follow = -_solve(_real_block(matrix, rows, rows), right)
        slope[:, rows] = _complex(follow[..., 0], rows)
        harmonics_by[:, rows] = _complex(follow[..., 1:], rows)
        through = _complex(_real_block(matrix, [1], rows) @ follow, [1])[:, 0]
        force_slope = force_slope + through[:, 0]
        force_by = force_by + through[:, 1:]
    return Balance(
        fundamental, harmonics, force_slope, slope, force_by, harmonics_by, ~(step > 1e-6) | (not rows)
    )


def _sample(law: ForceLaw, values: Array, omega: Array, harmonics: ComplexArray, samples: int) -> ForceSample:
    spectrum = np.zeros((len(omega), samples // 2 + 1), dtype=complex)
    spectrum[:, : harmonics.shape[1]] = harmonics * (samples / 2)
    spectrum[:, 0] = harmonics[:, 0].real * samples
    rate = 1j * omega[:, None] * np.arange(samples // 2 + 1)
    x = np.fft.irfft(spectrum, samples)
    v = np.fft.irfft(spectrum * rate, samples)
    a = np.fft.irfft(spectrum * rate**2, samples)
    return law.sample(x, v, a, (2 * np.pi / samples / omega)[:, None], values)


def _projected(signal: Array, orders: NDArray[np.intp]) -> ComplexArray:
    """Complex amplitudes of a sampled signal: signal = Re sum_h S_h exp(i h theta)."""
    spectrum = np.fft.rfft(signal)[:, orders] * (2 / signal.shape[1])
    spectrum[:, 0] /= 2
    return np.asarray(spectrum, dtype=np.complex128)


def _tangent(
    sample: ForceSample, omega: Array, inertia: Array, orders: NDArray[np.intp]
) -> tuple[ComplexArray, ComplexArray]:
    """Complex matrices A, B of  d residual_h = sum_k A_hk dX_k + B_hk conj(dX_k)."""
    length = sample.by_x.shape[1]
    by_x = np.fft.fft(sample.by_x) / length
    by_v = np.fft.fft(sample.by_v) / length
    rate = 1j * orders * omega[:, None]
    minus, plus = orders[:, None] - orders, orders[:, None] + orders
    direct = by_x[:, minus] + rate[:, None, :] * by_v[:, minus]
    mirror = by_x[:, plus] - rate[:, None, :] * by_v[:, plus]
    # the mean counts once where the other harmonics appear with their mirror image
    direct[:, 0, :] /= 2
    mirror[:, 0, :] /= 2
    direct[:, orders, orders] += inertia
    return direct, mirror


def _real_block(matrix: tuple[ComplexArray, ComplexArray], rows: list[int], columns: list[int]) -> Array:
    """Real form of a part of the tangent: real and imaginary rows and columns, of the mean the real ones."""
    direct, mirror = (part[:, rows][:, :, columns] for part in matrix)
    real = np.empty((len(direct), 2 * len(rows), 2 * len(columns)))
    real[:, 0::2, 0::2] = direct.real + mirror.real
    real[:, 0::2, 1::2] = mirror.imag - direct.imag
    real[:, 1::2, 0::2] = direct.imag + mirror.imag
    real[:, 1::2, 1::2] = direct.real - mirror.real
    keep_row = [i for i, h in enumerate(np.repeat(rows, 2)) if h > 0 or i % 2 == 0]
    keep_column = [i for i, h in enumerate(np.repeat(columns, 2)) if h > 0 or i % 2 == 0]
    return real[:, keep_row][:, :, keep_column]


def _real(values: ComplexArray, rows: list[int]) -> Array:
    """(n, rows, ...) complex to (n, real rows, ...)."""
    real = np.empty((len(values), 2 * len(rows), *values.shape[2:]))
    real[:, 0::2], real[:, 1::2] = values.real, values.imag
    return real[:, [i for i, h in enumerate(np.repeat(rows, 2)) if h > 0 or i % 2 == 0]]


def _complex(values: Array, rows: list[int]) -> ComplexArray:
    """Undo ``_real``."""
    result = np.zeros((len(values), len(rows), *values.shape[2:]), dtype=complex)
    position = 0
    for i, h in enumerate(rows):
        result[:, i] = values[:, position]
        position += 1
        if h > 0:
            result[:, i] += 1j * values[:, position]
            position += 1
    return result


def _solve(matrix: Array, right: Array) -> Array:
    """Solve a batch; a singular member gets the solution of smallest norm instead of spoiling the batch."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix) @ right)
