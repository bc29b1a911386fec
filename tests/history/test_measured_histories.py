"""Time histories of real tests and of a benchmark; skipped where the data are absent."""

from pathlib import Path

import numpy as np
import pytest

import rsgen
from rsgen.files.files_to_surface import read_measurement

CASES = Path(__file__).parents[1] / "cases"

SAME_LAW = 0.03
"""The figure of the requirement for k(X) and c(X) of the hysteretic benchmark."""


def peak(frequency: np.ndarray, response: np.ndarray) -> tuple[float, float]:
    """Largest response, and where, by a parabola through the highest points."""
    h = np.abs(response)
    i = int(np.nanargmax(h))
    a, b, c = np.polyfit(frequency[i - 1 : i + 2] - frequency[i], np.log(h[i - 1 : i + 2]), 2)
    return frequency[i] - b / (2 * a), float(np.exp(c - b**2 / (4 * a)))


@pytest.mark.thorough
def test_a_level_of_the_f16_is_predicted_from_the_others(measured_data) -> None:
    # the mount follows payload minus wing, and is predicted with the motion across that was measured there
    case = rsgen.load_case(CASES / "f16.toml", data=measured_data("f16").parent)
    surface = read_measurement(case.test)
    (item,) = rsgen.predict(rsgen.identify(surface, case.model), surface=surface).held_out
    predicted, measured = (peak(item.frequency, values) for values in (item.predicted, item.measured))
    # the figures of the requirement for a level that identification has not seen
    assert predicted[0] == pytest.approx(measured[0], rel=5e-3)
    assert predicted[1] == pytest.approx(measured[1], rel=0.10)


def hysteresis(X: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Stiffness and i omega times damping of the benchmark's hysteretic force."""
    law = rsgen.Law("z", memory={"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"})
    found = rsgen.derive(law).evaluate(X, omega, {"alpha": 5e4, "bg": 800.0, "bd": -1100.0})
    return np.asarray(found.stiffness + 1j * omega * found.damping)


@pytest.mark.slow
def test_the_hysteretic_benchmark_has_the_curves_of_its_true_law(measured_data):
    case = rsgen.load_case(CASES / "bouc_wen.toml", data=measured_data("bouc_wen").parent)
    surface = read_measurement(case.test)
    surface = surface.select(surface.settled).select(np.arange(0, int(surface.settled.sum()), 8))
    dynamic = surface.force / surface.harmonics[:, 1]
    k, c = dynamic.real + 2.0 * surface.omega**2, dynamic.imag / surface.omega
    near = np.abs(dynamic.real) < 5 * np.abs(dynamic.imag)
    law = hysteresis(surface.amplitude, surface.omega)
    assert np.max(np.abs(k / (5e4 + law.real) - 1)) < SAME_LAW / 5
    # dissipation follows the width of the loop, that is the peak of the motion, which the third harmonic
    # raises by 1 % above the fundamental; at equal fundamental it is 3 to 4 % higher than for a pure sine
    assert np.max(np.abs(c / (10 + law.imag / surface.omega) - 1)[near]) < 0.04
    angle = np.linspace(0, 2 * np.pi, 256)
    waves = np.nan_to_num(surface.harmonics) @ np.exp(1j * np.outer(np.arange(6), angle))
    top = np.ptp(waves.real, axis=1) / 2
    same_peak = 10 + hysteresis(top, surface.omega).imag / surface.omega
    assert np.max(np.abs(c * (surface.amplitude / top) ** 2 / same_peak - 1)[near]) < SAME_LAW
