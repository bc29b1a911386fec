"""Structures that no force of displacement and velocity describes: with a state, and of two masses."""

import numpy as np

import rsgen
from rsgen.data.surface.response_surface import ResponseSurface

STEPS = 96
"""A period: the truncation of order four is then beneath 1e-4 of the amplitude."""

HARMONICS, PERIODS = 9, 240

FREQUENCIES = tuple(np.linspace(7, 12, 33))


def bouc_wen() -> ResponseSurface:
    """The hysteretic benchmark of Noel and Schoukens (2016) by rsgen, held against ``events`` elsewhere."""
    law = rsgen.Law("c*v + k*x + z", memory={"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"})
    values = {"c": 10.0, "k": 5e4, "alpha": 5e4, "bg": 800.0, "bd": -1100.0}
    test = rsgen.SimulatedTest(np.linspace(10, 60, 6), np.linspace(26, 50, 33), harmonics=9)
    return rsgen.simulate(rsgen.Oscillator(2.0, law, values), test)


def two_masses(levels=(2, 4, 6, 8, 10, 12), frequencies=FREQUENCIES) -> ResponseSurface:
    """A mass on a cubic spring to the ground that carries a second one: modes near 9 and 20 Hz.

    Steady states by the explicit Runge-Kutta method of order four, all points at once, each from rest; time
    in periods of its own. Nothing of rsgen but the table that holds them.
    """
    m, c, k, k3 = 1.5, 3.8, 5920.0, 2e5
    m2, c2, k2 = 0.3, 1.0, 4000.0

    def rate(state: np.ndarray, force: np.ndarray) -> np.ndarray:
        x, v, y, w = state
        between = k2 * (x - y) + c2 * (v - w)
        return np.stack([v, (force - c * v - k * x - k3 * x**3 - between) / m, w, between / m2])

    grids = np.meshgrid(np.array(levels, dtype=float), frequencies, indexing="ij")
    level, frequency = (grid.ravel() for grid in grids)
    state = np.zeros((4, len(level)))
    step = 1 / frequency / STEPS
    cosine = np.cos(np.pi * np.arange(2 * STEPS) / STEPS)
    waveform = np.zeros((STEPS, len(level)))
    for _ in range(PERIODS):
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
