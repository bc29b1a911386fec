"""Harmonics and their waveforms for harmonic balance, which shares no motion with identification."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray

__all__ = [
    "Array",
    "Basis",
    "basis_of",
    "product",
    "project",
    "to_coefficients",
    "to_harmonics",
    "waveforms",
]

_SAMPLES_A_HARMONIC = 16
"""Samples of the waveform a harmonic: polynomials to the power 15 are projected without aliasing."""
_FEWEST_SAMPLES = 256
"""Samples of the waveform at least: few harmonics see the corners of a law as well."""


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """Waveforms from coefficients q = (X0, Re X1, -Im X1, Re X2, ...): x = displacement @ q and so on.

    A product g(phase) x has the coefficients M q, where M takes the Fourier coefficients of g at the sums and
    the differences of the orders: ``same`` and ``sum`` are their places, with a sign each. ``turn`` @ q are
    the coefficients of the derivative by the phase.
    """

    displacement: Array
    velocity: Array
    order: Array
    turn: Array
    same: NDArray[np.intp]
    sum: NDArray[np.intp]
    same_sign: Array
    sum_sign: Array

    @property
    def samples(self) -> int:
        """Samples in a period."""
        return len(self.displacement)


@lru_cache(maxsize=8)
def basis_of(harmonics: int) -> Basis:
    """The waveforms of so many harmonics, sampled finely enough for the corners of a law."""
    samples = max(_SAMPLES_A_HARMONIC * (harmonics + 1), _FEWEST_SAMPLES)
    shape, rate = waveforms(samples, harmonics)
    order = np.zeros(2 * harmonics + 1)
    for h in range(1, harmonics + 1):
        order[2 * h - 1 : 2 * h + 1] = h
    turn = np.zeros((len(order), len(order)))
    for h in range(1, harmonics + 1):
        turn[2 * h - 1, 2 * h], turn[2 * h, 2 * h - 1] = h, -h
    is_sine = (np.arange(len(order)) > 0) & (np.arange(len(order)) % 2 == 0)
    whole = order.astype(np.intp)
    difference = whole[None, :] - whole[:, None]
    row, column = is_sine[:, None], is_sine[None, :]
    mixed = row != column
    # cos a cos b, sin a sin b: cosines of a - b and a + b; mixed: sines
    sines = np.where(mixed, 2 * harmonics + 1, 0)
    same_sign = np.where(mixed, np.sign(difference) * np.where(column, 1, -1), 1)
    sum_sign = np.where(row & column, -1, 1)
    half = np.where(whole == 0, 0.5, 1.0)[:, None]
    return Basis(
        shape,
        rate,
        order,
        turn,
        np.abs(difference) + sines,
        whole[None, :] + whole[:, None] + sines,
        0.5 * half * same_sign,
        0.5 * half * sum_sign,
    )


@lru_cache(maxsize=8)
def waveforms(samples: int, harmonics: int) -> tuple[Array, Array]:
    """Displacement and velocity over omega of each coefficient (samples, 2H+1)."""
    phase = 2 * np.pi * np.arange(samples) / samples
    shape = np.ones((samples, 2 * harmonics + 1))
    rate = np.zeros((samples, 2 * harmonics + 1))
    for h in range(1, harmonics + 1):
        shape[:, 2 * h - 1], shape[:, 2 * h] = np.cos(h * phase), np.sin(h * phase)
        rate[:, 2 * h - 1], rate[:, 2 * h] = -h * np.sin(h * phase), h * np.cos(h * phase)
    return shape, rate


def project(basis: Basis, waveform: Array) -> Array:
    """Coefficients (n, 2H+1) of waveforms (n, samples)."""
    spectrum = np.fft.rfft(waveform, axis=1)[:, : int(basis.order[-1]) + 1] * (2 / basis.samples)
    return to_coefficients(spectrum / np.where(np.arange(spectrum.shape[1]) == 0, 2, 1))


def product(basis: Basis, waveform: Array) -> Array:
    """Matrices (n, 2H+1, 2H+1) that multiply by waveforms (n, samples)."""
    spectrum = np.fft.rfft(waveform, axis=1)[:, : 2 * int(basis.order[-1]) + 1] * (2 / basis.samples)
    parts = np.hstack([spectrum.real, -spectrum.imag])
    matrix: Array = parts[:, basis.same] * basis.same_sign + parts[:, basis.sum] * basis.sum_sign
    return matrix


def to_harmonics(q: Array) -> ComplexArray:
    """Harmonics (n, H+1) of coefficients (n, 2H+1)."""
    return np.hstack([q[:, :1].astype(np.complex128), q[:, 1::2] - 1j * q[:, 2::2]])


def to_coefficients(harmonics: ComplexArray) -> Array:
    """Coefficients (n, 2H+1) of harmonics (n, H+1)."""
    q = np.empty((len(harmonics), 2 * harmonics.shape[1] - 1))
    q[:, 0], q[:, 1::2], q[:, 2::2] = harmonics[:, 0].real, harmonics[:, 1:].real, -harmonics[:, 1:].imag
    return q
