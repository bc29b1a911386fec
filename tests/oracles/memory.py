"""Structures that no force of displacement and velocity describes: with a state, and of two coupled masses.

Steady states by the explicit Runge-Kutta method of order four, with nothing of rsgen but the table that
holds them.
"""

from collections.abc import Callable

import numpy as np

from rsgen.data.surface.response_surface import ResponseSurface

Motion = Callable[[np.ndarray, np.ndarray], np.ndarray]

STEPS = 96
"""A period: the truncation of order four is then beneath 1e-4 of the amplitude."""

HARMONICS = 9


def bouc_wen(levels=(10.0, 20.0, 30.0, 40.0, 50.0, 60.0), frequencies=None) -> ResponseSurface:
    """The hysteretic benchmark of Noel and Schoukens (2016), stepped sine.

    m x'' + c x' + k x + z = f,  z' = alpha x' - beta (gamma |x'| |z|^(nu-1) z + delta x' |z|^nu).
    """
    m, c, k, alpha, beta, gamma, delta = 2.0, 10.0, 5e4, 5e4, 1e3, 0.8, -1.1

    def rate(state: np.ndarray, force: np.ndarray) -> np.ndarray:
        x, v, z = state
        change = alpha * v - beta * (gamma * np.abs(v) * z + delta * v * np.abs(z))
        return np.stack([v, (force - c * v - k * x - z) / m, change])

    frequencies = np.linspace(26, 50, 33) if frequencies is None else frequencies
    return _stepped(rate, 3, levels, frequencies, periods=80)


def two_masses(levels=(2.0, 4.0, 6.0, 8.0, 10.0, 12.0), frequencies=None) -> ResponseSurface:
    """A mass on a cubic spring to the ground that carries a second one: modes near 9 and 20 Hz."""
    m, c, k, k3 = 1.5, 3.8, 5920.0, 2e5
    m2, c2, k2 = 0.3, 1.0, 4000.0

    def rate(state: np.ndarray, force: np.ndarray) -> np.ndarray:
        x, v, y, w = state
        between = k2 * (x - y) + c2 * (v - w)
        return np.stack([v, (force - c * v - k * x - k3 * x**3 - between) / m, w, between / m2])

    frequencies = np.linspace(7, 12, 33) if frequencies is None else frequencies
    return _stepped(rate, 4, levels, frequencies, periods=240)


def _stepped(rate: Motion, size: int, levels: tuple[float, ...], frequencies: np.ndarray, periods: int):
    """All points at once, each from rest; time in periods of its own."""
    level, frequency = (grid.ravel() for grid in np.meshgrid(levels, frequencies, indexing="ij"))
    state = np.zeros((size, len(level)))
    step = 1 / frequency / STEPS
    cosine = np.cos(np.pi * np.arange(2 * STEPS) / STEPS)
    waveform = np.zeros((STEPS, len(level)))
    for _ in range(periods):
        for i in range(STEPS):
            waveform[i] = state[0]
            now, half, then = (level * cosine[(2 * i + j) % (2 * STEPS)] for j in range(3))
            first = rate(state, now)
            second = rate(state + step / 2 * first, half)
            third = rate(state + step / 2 * second, half)
            fourth = rate(state + step * third, then)
            state = state + step / 6 * (first + 2 * second + 2 * third + fourth)
    harmonics = np.fft.rfft(waveform, axis=0)[: HARMONICS + 1].T * (2 / STEPS)
    harmonics[:, 0] /= 2
    return ResponseSurface(
        level=level, frequency=frequency, force=level.astype(complex), harmonics=harmonics,
        peak=np.stack([waveform.max(axis=0), waveform.min(axis=0)], axis=1), sweep="rest",
        residual=np.abs(state[0] - waveform[0]) / np.abs(harmonics[:, 1]), origin="simulated",
    )  # fmt: skip
