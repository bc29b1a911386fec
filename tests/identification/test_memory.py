"""Laws with memory identified from time stepping that knows nothing of loops, kernels or balances."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rsgen.identification import Identification, identify
from rsgen.law.element import make_element
from rsgen.motion import Motion, project
from rsgen.oscillator import Model
from rsgen.surface import ResponseSurface

MASS, DAMPING, SPRING = 2.0, 30.0, 5e4
STEPS, PERIODS = 192, 32


def _stepped(rate: Callable, limit: float, levels: tuple[float, ...], band: tuple[float, float]):
    """Steady responses to sines by Runge and Kutta's rule, of a force SPRING x + DAMPING v + z."""
    level, frequency = (g.ravel() for g in np.meshgrid(levels, np.linspace(*band, 15), indexing="ij"))
    omega, h = 2 * np.pi * frequency, 1 / (STEPS * frequency)

    def slope(j: float, y: np.ndarray) -> np.ndarray:
        x, v, z = y
        a = (level * np.cos(2 * np.pi * j / STEPS) - SPRING * x - DAMPING * v - z) / MASS
        return np.stack([v, a, rate(v, z)])

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


def _errors(found: Identification, truth: dict[str, float]) -> list[float]:
    assert {e.name for e in found.refined} == set(truth)
    return [abs(e.value / truth[e.name] - 1) for e in found.refined]


@pytest.mark.slow
def test_bouc_wen_is_identified() -> None:
    """From first guess to interval; a hundredth of the stiffness moves with the level."""
    alpha, bg, bd = 2e4, 800.0, -500.0
    surface = _stepped(
        lambda v, z: alpha * v - bg * np.abs(v) * z - bd * v * np.abs(z),
        np.inf, (20.0, 60.0, 180.0), (25.0, 31.0),
    )  # fmt: skip
    memory = {"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"}
    found = identify(surface, Model((make_element("law", "k*x + c*v + z", memory),)))
    truth = {"alpha": alpha, "bg": bg, "bd": bd, "c": DAMPING, "k": SPRING, "m": MASS}
    assert max(_errors(found, truth)) < 1e-3
    assert found.residual < 1e-5
