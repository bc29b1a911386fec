"""Virtual tests by time stepping that knows nothing of loops, kernels or balances."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rsgen.data.surface import ResponseSurface
from rsgen.law.motion import Motion, project

MASS, DAMPING, SPRING = 2.0, 30.0, 5e4
STEPS, PERIODS = 192, 32


def stepped(
    rate: Callable, limit: float, levels: tuple[float, ...], band: tuple[float, float]
) -> ResponseSurface:
    """Steady responses to sines by Runge and Kutta's rule, of SPRING x + DAMPING v + z, |z| < limit."""
    level, frequency = (g.ravel() for g in np.meshgrid(levels, np.linspace(*band, 15), indexing="ij"))
    omega, h = 2 * np.pi * frequency, 1 / (STEPS * frequency)

    def slope(j: float, y: np.ndarray) -> np.ndarray:
        x, v, z = y
        a = (level * np.cos(2 * np.pi * j / STEPS) - SPRING * x - DAMPING * v - z) / MASS
        slips = (np.abs(z) >= limit) & (v * z > 0)
        return np.stack([v, a, np.where(slips, 0.0, rate(v, z))])

    y, last = np.zeros((3, len(level))), np.zeros((len(level), STEPS))
    for j in range(STEPS * PERIODS):
        last[:, j % STEPS] = y[0]
        one = slope(j, y)
        two = slope(j + 0.5, y + h / 2 * one)
        three = slope(j + 0.5, y + h / 2 * two)
        y = y + h / 6 * (one + 2 * two + 2 * three + slope(j + 1, y + h * three))
        y[2] = np.clip(y[2], -limit, limit)
    harmonics = np.stack([project(last, order) for order in range(6)], axis=1)
    return ResponseSurface(
        level=level,
        frequency=frequency,
        force=level.astype(complex),
        harmonics=harmonics,
        peak=Motion(omega, harmonics).peaks(),
        origin="simulated",
    )
