from __future__ import annotations

import numpy as np
import pytest

from rsgen.dynamics.harmonic_balance import following_harmonics, hold_amplitude
from rsgen.dynamics.linear_part import Inertia
from rsgen.formula import parse
from rsgen.law.numeric import compile_law

OMEGA = 2 * np.pi * np.linspace(8, 12, 7)
SIZE = np.linspace(0.01, 0.03, 7)
M = 1.5


def hold(
    text: str,
    values: list[float],
    order: int,
    *,
    mass: float = M,
    size: np.ndarray = SIZE,
    samples: int = 128,
):
    law = compile_law(parse(text))
    start = np.zeros((len(OMEGA), order + 1), dtype=complex)
    return hold_amplitude(
        law, np.array(values), Inertia(mass), OMEGA, size, start, following_harmonics(law, order), samples
    )


def test_linear_structure_has_its_dynamic_stiffness() -> None:
    at = hold("c*v + k*x", [3.8, 5920.0], 5)
    assert at.force == pytest.approx(SIZE * (5920 - M * OMEGA**2 + 3.8j * OMEGA), rel=1e-12)
    assert np.abs(at.harmonics[:, 2:]).max() < 1e-15


def test_one_harmonic_gives_the_describing_functions() -> None:
    # Liu et al., Eqs. (14), (16), (23)
    at = hold("k*x + k3*x**3 + k5*x**5 + c*v + cn*v*abs(v)", [2.0, 3.0, 4000.0, 1e5, 1e8], 1, samples=4096)
    stiffness = 4000 + 3 / 4 * 1e5 * SIZE**2 + 5 / 8 * 1e8 * SIZE**4
    damping = 2 + 8 * 3 * OMEGA * SIZE / (3 * np.pi)
    assert at.force / SIZE == pytest.approx(stiffness - M * OMEGA**2 + 1j * OMEGA * damping, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("c*v + k*x + kn*x**3", [3.8, 5920.0, 1e6]),
        ("c*v + k*x + k2*x**2", [3.8, 5920.0, 4e4]),
        ("A*tanh(v/w) + c*v + k*x", [0.7, 3.8, 5920.0, 0.3]),
    ],
)
def test_derivatives_are_those_of_the_balance(text: str, values: list[float]) -> None:
    at = hold(text, values, 9)
    assert at.valid.all()
    # near the cube root of what the balance leaves of its equations, relative
    h = 1e-4

    def close(slope: np.ndarray, high: np.ndarray, low: np.ndarray, step: float | np.ndarray) -> None:
        difference = ((high - low).T / (2 * step)).T
        # error of central differences, relative to the largest entry
        assert np.abs(slope - difference).max() < 1e-7 * np.abs(difference).max()

    for j, value in enumerate(values):
        trial = [[*values[:j], value * (1 + s * h), *values[j + 1 :]] for s in (1, -1)]
        high, low = (hold(text, t, 9) for t in trial)
        close(at.force_by[:, j], high.force, low.force, value * h)
        close(at.harmonics_by[:, :, j], high.harmonics, low.harmonics, value * h)
    high, low = (hold(text, values, 9, mass=M * (1 + s * h)) for s in (1, -1))
    close(at.force_by[:, -1], high.force, low.force, M * h)
    high, low = (hold(text, values, 9, size=SIZE * (1 + s * h)) for s in (1, -1))
    close(at.force_slope, high.force, low.force, h)
    close(at.harmonics_slope, high.harmonics, low.harmonics, h)


def test_mean_of_an_unsymmetric_spring_balances_its_force() -> None:
    # k x + k2 x^2 with one harmonic: k X0 + k2 (X0^2 + X^2/2) = 0
    at = hold("k*x + k2*x**2", [5920.0, 4e4], 1)
    mean = (-5920 + np.sqrt(5920**2 - 2 * 4e4**2 * SIZE**2)) / (2 * 4e4)
    assert at.harmonics[:, 0].real == pytest.approx(mean, rel=1e-10)
