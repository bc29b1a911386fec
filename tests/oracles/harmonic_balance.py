"""Harmonic balance of smooth laws, one point after the other by scipy: shares nothing with that of rsgen."""

import numpy as np
import sympy
from scipy.optimize import root

SAMPLES = 256
"""Of a waveform: enough for powers of ten harmonics, and for the edges of a smooth friction."""


def solve_harmonic_balance(oscillator, force, frequency, *, harmonics) -> tuple[np.ndarray, np.ndarray]:
    """Return harmonics (n, H+1), and what they leave of the balance at every instant, rms over |F| (n,)."""
    law = sympy.lambdify(["x", "v", *oscillator.parameters], str(oscillator.force), "numpy")
    values = [oscillator.values[name] for name in oscillator.parameters]
    orders = np.arange(harmonics + 1)
    turn = np.exp(2j * np.pi * np.outer(orders, np.arange(SAMPLES)) / SAMPLES)

    def solve(F: complex, omega: float) -> tuple[np.ndarray, float]:
        size = abs(F) / (oscillator.mass * omega**2)

        def motion(u: np.ndarray) -> np.ndarray:
            return size * np.concatenate([u[:1], u[1::2] + 1j * u[2::2]])

        def rest(u: np.ndarray) -> np.ndarray:
            x, v, a = ((motion(u) * (1j * omega * orders) ** power @ turn).real for power in range(3))
            return (oscillator.mass * a + law(x, v, *values) - (F * turn[1]).real) / abs(F)

        def balance(u: np.ndarray) -> np.ndarray:
            left = np.fft.rfft(rest(u))[: harmonics + 1] / SAMPLES
            return np.concatenate([left[:1].real, np.column_stack([left.real, left.imag])[1:].ravel()])

        found = root(balance, np.zeros(2 * harmonics + 1), options={"xtol": 1e-13}).x
        assert np.abs(balance(found)).max() < 1e-11
        return motion(found), float(np.sqrt(np.mean(rest(found) ** 2)))

    pairs = zip(np.asarray(force, complex), 2 * np.pi * np.asarray(frequency), strict=True)
    solved = [solve(F, omega) for F, omega in pairs]
    return np.array([one for one, _ in solved]), np.array([left for _, left in solved])
