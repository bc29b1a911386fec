"""Periodic motions: harmonics over a base frequency, their waveforms, and forces along them as harmonics.

x(t) = Re sum_h X_h exp(i h omega t). A stepped sine has one strong harmonic; any periodic motion has the same
form. ``FourierSeries`` has the same motions in real coordinates, with the tangent of a force along them as
matrix products: what Newton's method on a harmonic balance needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray

PEAK_SAMPLES = 128
"""Samples of a period; the largest one of a sine is at most 0.03 % below its peak."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """One period of n periodic motions.

    Parameters
    ----------
    omega
        (n,) base frequency [rad/s].
    harmonics
        (n, H+1) complex displacement [m], mean first.
    """

    omega: Array
    harmonics: ComplexArray

    def __len__(self) -> int:
        return len(self.omega)

    @property
    def orders(self) -> NDArray[np.intp]:
        """(H+1,) 0, 1, ..., H."""
        return np.arange(self.harmonics.shape[1])

    def select(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Motion:
        """Take some of the motions."""
        return Motion(self.omega[chosen], self.harmonics[chosen])

    def turned(self, phase: Array) -> Motion:
        """Advance every motion by a phase (n,) [rad] of its fundamental."""
        return Motion(self.omega, self.harmonics * np.exp(1j * phase[:, None] * self.orders))

    def waveforms(self, samples: int) -> tuple[Array, Array, Array]:
        """Displacement [m], velocity [m/s] and acceleration [m/s^2], each (n, samples), from t = 0 on.

        ``samples`` must be more than 2 H.
        """
        rate = 1j * self.omega[:, None] * self.orders
        x, v, a = (waveform(self.harmonics * rate**power, samples) for power in range(3))
        return x, v, a

    def interval(self, samples: int) -> Array:
        """(n, 1) time from sample to sample [s]."""
        return (2 * np.pi / samples / self.omega)[:, None]

    def peaks(self) -> Array:
        """(n, 2) largest and smallest displacement [m] among the samples of a period."""
        x = waveform(np.array(self.harmonics), PEAK_SAMPLES)
        return np.stack([x.max(axis=1), x.min(axis=1)], axis=1)

    def states(self) -> Array:
        """(n, 2) displacement [m] and velocity [m/s] at t = 0."""
        velocity = 1j * self.orders * self.omega[:, None] * self.harmonics
        return np.stack([self.harmonics.sum(axis=1).real, velocity.sum(axis=1).real], axis=1)


def sine_motion(omega: Array, fundamental: Array | ComplexArray) -> Motion:
    """Make n motions of a frequency [rad/s] and a complex amplitude [m] alone."""
    harmonics = np.zeros((len(omega), 2), dtype=np.complex128)
    harmonics[:, 1] = fundamental
    return Motion(omega, harmonics)


def waveform(harmonics: ComplexArray, samples: int) -> Array:
    """Sample one period of signals with complex harmonics (..., H+1), mean first: (..., samples)."""
    spectrum = harmonics * (samples / 2)
    spectrum[..., 0] *= 2
    return np.fft.irfft(spectrum, samples)


def harmonics_of(signals: Array, count: int) -> ComplexArray:
    """Find the first harmonics (..., count), mean first, of signals (..., samples) over one period."""
    found = np.fft.rfft(signals)[..., :count] * (2 / signals.shape[-1])
    found[..., 0] /= 2
    return np.asarray(found)


def cycle_work(force: ComplexArray, fundamental: ComplexArray) -> Array:
    """Work of a force over one cycle of a motion, pi Im(F conj X1) [J]; a passive structure takes it in."""
    return np.asarray(np.pi * np.imag(force * np.conj(fundamental)))


def feeds_exciter(force: ComplexArray, fundamental: ComplexArray) -> bool:
    """Decide whether a structure works on its exciter, in sum and over most cycles (n,)."""
    work = cycle_work(force, fundamental)
    return bool(np.mean(work <= 0) > 0.5 and np.sum(work) < 0)


def project(signals: Array, order: int) -> ComplexArray:
    """Harmonic of that order of real signals (..., samples) over one period."""
    samples = signals.shape[-1]
    turn = np.exp(-2j * np.pi * order * np.arange(samples) / samples) * ((2 if order else 1) / samples)
    # two real products: one with a complex vector would copy all signals as complex numbers first
    parts = signals @ np.stack([turn.real, turn.imag], axis=1)
    return np.asarray(parts[..., 0] + 1j * parts[..., 1])


@dataclass(frozen=True, slots=True, eq=False)
class FourierSeries:
    """Signals Re sum_h X_h exp(i h theta) at s samples, d real coordinates: re X_h, im X_h; of the mean X_0.

    ``order_of`` (d,) is the harmonic of each coordinate and ``step`` the phase from sample to sample [rad].
    ``shape``, ``rate`` and ``bend`` (d, s) are the signal of a unit of each coordinate and its first and
    second derivative by the phase; ``project`` (s, d) turns a sampled signal into coordinates.
    """

    orders: tuple[int, ...]
    order_of: NDArray[np.intp]
    step: float
    shape: Array
    rate: Array
    bend: Array
    project: Array
    _real_parts: NDArray[np.intp]
    _imaginary_parts: NDArray[np.intp]
    _oscillates: NDArray[np.bool_]
    _spread: Array
    _by_x: Array
    _by_v: Array

    def real(self, values: ComplexArray) -> Array:
        """(n, orders) complex to (n, d) real."""
        coordinates = np.empty((len(values), len(self.order_of)))
        coordinates[:, self._real_parts] = values.real
        coordinates[:, self._imaginary_parts] = values.imag[:, self._oscillates]
        return coordinates

    def complex(self, coordinates: Array) -> NDArray[Any]:
        """(n, d, ...) real to (n, orders, ...) complex."""
        values = np.zeros((len(coordinates), len(self.orders), *coordinates.shape[2:]), dtype=complex)
        values.real = coordinates[:, self._real_parts]
        values.imag[:, self._oscillates] = coordinates[:, self._imaginary_parts]
        return values

    def tangent(self, by_x: Array, by_rate: Array) -> Array:
        """(n, d, d) derivative of the coordinates of a force by those of the motion, from slopes (n, s).

        ``by_x`` is dn/dx, ``by_rate`` the derivative by dx/dtheta. A product of two harmonics is a harmonic
        of at most twice their order, so that of the slopes only these matter.
        """
        flat = (by_x @ self._spread) @ self._by_x
        flat += (by_rate @ self._spread) @ self._by_v
        count = len(self.order_of)
        return np.asarray(flat.reshape(len(flat), count, count))


@lru_cache(maxsize=16)
def fourier_series(orders: tuple[int, ...], samples: int, half: bool) -> FourierSeries:
    """Prepare a series of different harmonics, none negative, from more than 4 times the highest in samples.

    ``samples`` are those of a period; with ``half`` the first half of them is enough: odd harmonics, whose
    other half is the same with the other sign.
    """
    highest = max(orders)
    phase = 2 * np.pi * np.arange(samples // 2 if half else samples) / samples
    order_of = np.array([h for h in orders for _ in range(2 if h else 1)], dtype=np.intp)
    multiple = order_of[:, None].astype(float)
    is_imaginary = np.array([part for h in orders for part in ((False, True) if h else (False,))])
    angle = multiple * phase
    cosine, sine = np.cos(angle), np.sin(angle)
    shape = np.where(is_imaginary[:, None], -sine, cosine)
    rate = np.where(is_imaginary[:, None], -cosine, -sine) * multiple
    weight = np.where(multiple > 0, 2.0, 1.0) / len(phase)
    project = (weight * shape).T
    # the products of two odd harmonics are even ones
    products = np.arange(0, 2 * highest + 1, 2 if half else 1)
    waves = np.exp(1j * products[:, None] * phase)
    basis = np.concatenate([waves.real, waves.imag[1:]])
    dual = basis / np.sum(basis**2, axis=1, keepdims=True)
    maps = [
        dual @ (project[:, :, None] * part.T[:, None, :]).reshape(len(phase), -1) for part in (shape, rate)
    ]
    return FourierSeries(
        orders,
        order_of,
        2 * np.pi / samples,
        shape,
        rate,
        -(multiple**2) * shape,
        project,
        np.flatnonzero(~is_imaginary),
        np.flatnonzero(is_imaginary),
        np.array([h > 0 for h in orders]),
        np.ascontiguousarray(basis.T),
        *maps,
    )
