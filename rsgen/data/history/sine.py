"""Least-squares fit of a sine and its harmonics, frequency refined (as IEEE 1057 does), block by block."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.history.record import BLOCK, blocks

__all__ = ["fit_sine", "refine_frequency"]


_ROUNDS = 12
"""Corrections of the frequency at most; three are usual, each squares the error."""
_EXACT = 1e-13
"""Relative correction of the frequency that rounding leaves."""


def _columns(first: int, count: int, omega: float, orders: int, drift: bool, middle: float) -> Array:
    i = np.arange(first, first + count, dtype=np.float64)
    turn = np.exp(1j * omega * i)
    columns, power = [np.ones(count)], np.ones(count, dtype=complex)
    for _ in range(orders):
        power = power * turn
        columns += [power.real, -power.imag]
    if drift:
        columns += [(i - middle) * columns[1], (i - middle) * columns[2]]
    return np.stack(columns, axis=1)


def _solve(signal: NDArray[Any], omega: float, orders: int, drift: bool) -> tuple[Array, float]:
    """Solve the normal equations (the columns are nearly orthogonal); parameters and sum of squares left."""
    n = len(signal)
    middle = (n - 1) / 2
    size = 1 + 2 * orders + (2 if drift else 0)
    gram, right, square, scale = np.zeros((size, size)), np.zeros(size), 0.0, np.ones(size)
    scale[size - 2 :] = 2 / n if drift else 1.0
    for number, block in enumerate(blocks(signal)):
        samples = np.asarray(block, dtype=np.float64)
        columns = _columns(number * BLOCK, len(samples), omega, orders, drift, middle) * scale
        gram += columns.T @ columns
        right += columns.T @ samples
        square += float(samples @ samples)
    # columns coincide where a harmonic is at the Nyquist frequency
    solution = np.linalg.lstsq(gram, right, rcond=None)[0]
    return solution * scale, max(square - float(solution @ right), 0.0)


def fit_sine(signal: NDArray[Any], omega: float, orders: int) -> tuple[ComplexArray, float]:
    """Fit mean, fundamental and harmonics at a known frequency.

    ``omega`` is the angle a sample [rad]; ``signal`` (n,) lasts at least two periods; the highest of
    ``orders`` is below the Nyquist frequency. Returns (orders + 1,) harmonics Y of
    Re sum_h Y_h exp(i h omega t), t = 0 at the first sample, and the root mean square of the rest, both in
    the unit of the signal.
    """
    p, left = _solve(signal, omega, orders, False)
    harmonics = np.concatenate([[p[0]], p[1::2] + 1j * p[2::2]])
    return harmonics, float(np.sqrt(left / len(signal)))


def refine_frequency(signal: NDArray[Any], omega: float, orders: int) -> float:
    """Refine the frequency of a sine: the phase may not drift along the samples (Gauss and Newton).

    ``omega``, the angle a sample [rad], is at first off by less than half a turn over all samples.
    """
    for _ in range(_ROUNDS):
        p, _ = _solve(signal, omega, orders, True)
        fundamental, drift = complex(p[1], p[2]), complex(p[-2], p[-1])
        if fundamental == 0:
            break
        # Y (1 + i d (t - middle)): the imaginary part of drift over fundamental is the error of omega
        step = float(np.clip((drift / fundamental).imag, -pi / len(signal), pi / len(signal)))
        omega += step
        if abs(step) < _EXACT * omega:
            break
    return omega
