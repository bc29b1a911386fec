"""Laws of a test without phase: amplitudes alone give the parameters, and the result says what is lost."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rsgen import RsgenError, identify, load_case
from rsgen.data.oscillator import Model, Observation
from rsgen.files.files_to_surface import read_measurement
from rsgen.identification.prediction.amplitude_balance import AmplitudeBalance
from tests.surfaces import codes, distances, model, noisy, surface, truth, without_phase


def test_a_test_that_is_not_calibrated_says_so():
    found = identify(surface("cubic"), model("cubic"), Observation(calibrated=False))
    assert "not-calibrated" in codes(found)
    assert {estimate.unit for estimate in found} == {""}
    assert {found.curve.units.of(unit) for unit in ("N/m", "N*s/m", "J", "kg", "m/N")} == {""}
    assert found.curve.units.of("m") == "m"
    with pytest.raises(RsgenError, match="not calibrated"):
        Model(model("cubic").elements, mass=1.0, observation=Observation(calibrated=False))


@pytest.mark.slow
def test_the_clamped_beam_has_the_published_backbone(measured_data: Callable[[str], Path]):
    folder = measured_data("frid_clamp")
    case = load_case(Path(__file__).parents[1] / "cases" / "clamp.toml", data=folder.parent)
    seen = read_measurement(case.test)
    assert not seen.phase_known
    found = identify(seen, case.model)
    assert found.residual / np.sqrt(2) < 0.02
    published, size = np.loadtxt(folder / "clamp_cons_backbone.csv", delimiter=",", skiprows=1).T
    # from the lowest to the highest resonance: below, the test saw no resonance
    peaks = [seen.amplitude[seen.level == level].max() for level in seen.levels]
    crossed = (size > min(peaks)) & (size < max(peaks))
    assert crossed.sum() > 50
    size, published = size[crossed], published[crossed]
    omega, balance = 2 * np.pi * published, AmplitudeBalance(found)
    for _ in range(20):
        stiffness = balance.solve(size, omega).force.real / size + found.mass * omega**2
        omega = np.sqrt(stiffness / found.mass)
    assert np.max(np.abs(omega / (2 * np.pi) / published - 1)) < 0.002


@pytest.mark.slow
def test_standard_errors_without_phase():
    tests = [without_phase(noisy(surface("cubic"), 0.02, seed)) for seed in range(8)]
    scores = [distances(identify(test, model("cubic")), truth("cubic")) for test in tests]
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5
