"""Forces from k(X) and c(V) alone: describing functions of Liu et al. give back the laws they are of."""

import numpy as np
import pytest

from rsgen.identification.restoring_force import invert_curve
from rsgen.identification.results.result import EquivalentCurve

M = 1.5
SPLINE = 1e-2
"""Largest deviation, relative to the largest force, that a corner leaves in the spline."""


def curve(stiffness, damping=lambda V: 3.8, points: int = 1200, noise: float = 0.0) -> EquivalentCurve:
    """Points of given k(X) and c(V) over a test."""
    generator = np.random.default_rng(1)
    size = generator.uniform(5e-4, 0.03, points)
    omega = 2 * np.pi * generator.uniform(8, 12, points)
    k, c = stiffness(size) * np.ones(points), damping(omega * size) * np.ones(points)
    k = k + noise * np.abs(k - M * omega**2 + 1j * omega * c) * generator.normal(size=points)
    return EquivalentCurve(size, omega / 2 / np.pi, np.ones(points), k, c, np.ones(points, dtype=bool))


def gap(X):
    # twice the root of the printed Eq. (20), see docs/method.md, 2
    s = np.minimum(0.01 / X, 1)
    return 8000 - 2080 / np.pi * (2 * np.arcsin(s) + 2 * s * np.sqrt(1 - s**2))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stiffness", "spring", "off"),
    [
        (lambda X: 5920, lambda x: 5920 * x, 1e-4),
        (lambda X: 5920 + 0.75 * 1e6 * X**2, lambda x: 5920 * x + 1e6 * x**3, 1e-4),
        (lambda X: 5920 + 0.625 * 1e9 * X**4, lambda x: 5920 * x + 1e9 * x**5, 1e-4),
        (lambda X: 5920 + 8 * 4e4 * X / (3 * np.pi), lambda x: 5920 * x + 4e4 * x * np.abs(x), 1e-4),
        (gap, lambda x: np.where(x < 0.01, 5920 * x, 8000 * x - 20.8), SPLINE),
    ],
    ids=["linear", "cubic", "quintic", "quadratic", "gap"],
)
def test_springs_come_back(stiffness, spring, off):
    found = invert_curve(curve(stiffness), M)
    exact = spring(found.displacement)
    assert np.abs(found.stiffness_force - exact).max() < off * exact.max()


def test_bands_hold_the_force():
    found = invert_curve(curve(lambda X: 5920 + 0.75 * 1e6 * X**2, noise=0.01), M)
    exact = 5920 * found.displacement + 1e6 * found.displacement**3
    inside = np.abs(found.stiffness_force - exact)[1:] <= found.stiffness_band[1:]
    assert inside.mean() > 0.8  # neighbouring points share their errors
    assert found.stiffness_band[1:].max() < 0.05 * exact.max()


def test_points_count_by_the_force_that_held_them():
    # one stiffness at resonance and another off it, both at all amplitudes: their mean, weighted by 1/F^2
    size, k, c = np.tile(np.linspace(1e-3, 0.02, 200), 2), np.array([6000.0, 6300.0]), 4.0
    omega = np.sqrt(k[0] / M) * np.array([1.0, 1.02])
    weight = 1 / np.hypot(k - M * omega**2, omega * c) ** 2
    stiffness, frequency, used = (
        np.repeat(k, 200),
        np.repeat(omega, 200) / 2 / np.pi,
        np.ones(400, dtype=bool),
    )
    found = invert_curve(EquivalentCurve(size, frequency, size, stiffness, np.full(400, c), used), M)
    mean = float(np.sum(k * weight) / np.sum(weight))
    assert found.stiffness_force == pytest.approx(mean * found.displacement, rel=1e-6)
