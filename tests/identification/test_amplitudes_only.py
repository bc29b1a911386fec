"""Laws of a test without phase: amplitudes alone give the parameters, and the result says what is lost."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rsgen.cases import load_case
from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Model, Observation
from rsgen.data.surface import ResponseSurface
from rsgen.files import read_measurement
from rsgen.identification.identify import identify
from rsgen.identification.prediction.amplitude_balance import AmplitudeBalance
from tests.surfaces import changed, model, noisy, surface, truth

EXACT = {"cubic": 1e-5, "quintic": 1e-3, "combined": 1e-4}
"""Three harmonics are carried; the waveform of the quintic law has the largest harmonics."""


def without_phase(table: ResponseSurface) -> ResponseSurface:
    """What an instrument keeps that shows amplitudes only; rows in no order."""
    harmonics = np.zeros((len(table), 2), dtype=complex)
    harmonics[:, 1] = table.amplitude
    shuffled = np.random.default_rng(0).permutation(len(table))
    bare = changed(table, harmonics=harmonics, force=np.abs(table.force).astype(complex), phase_known=False)
    return bare.select(shuffled)


def errors(identification, values: dict[str, float]) -> dict[str, float]:
    return {e.name: abs(e.value / values[e.name] - 1) for e in identification.refined}


@pytest.mark.slow
@pytest.mark.parametrize("law", ["cubic", "quintic", "combined"])
def test_amplitudes_alone_give_every_parameter(law):
    found = identify(without_phase(surface(law)), model(law))
    assert max(errors(found, truth(law)).values()) < EXACT[law]
    assert "not-recorded" in {finding.code for finding in found.findings}
    assert found.background is None


def test_both_sides_of_a_fold_need_no_branch_to_be_named():
    # with a hardening spring the upper branch is reached from below, the lower from above
    law = "combined"
    values = {**truth(law), "kn": 3e6}
    del values["m"]
    frequencies = np.linspace(9, 13, 61)
    rest = surface(law, levels=np.array([4.0, 8.0]), frequencies=frequencies, values=values)
    slope = np.diff(rest.amplitude.reshape(2, -1), axis=1)
    assert (slope < -0.3 * rest.amplitude.max()).any(), "the response must jump"
    found = identify(without_phase(rest), model(law))
    assert max(errors(found, {**values, "m": 1.5}).values()) < 1e-2


@pytest.mark.slow
def test_standard_errors_without_phase():
    table, distances = surface("cubic"), []
    for seed in range(8):
        found = identify(without_phase(noisy(table, 0.02, seed)), model("cubic"))
        distances.append([(e.value - truth("cubic")[e.name]) / e.standard_error for e in found.refined])
    spread = np.sqrt(np.mean(np.square(distances)))
    assert 0.6 < spread < 1.5


@pytest.mark.slow
def test_noise_of_a_law_with_a_jump_is_not_called_systematic():
    found = identify(without_phase(noisy(surface("coulomb"), 0.01, 1)), model("coulomb"))
    assert max(errors(found, truth("coulomb")).values()) < 5e-3
    assert "law-does-not-fit" not in {finding.code for finding in found.findings}


def test_a_background_lifts_one_side_of_the_resonance():
    table = surface("cubic")
    harmonics = np.array(table.harmonics)
    harmonics[:, 1] += 2e-4 * table.force
    seen = without_phase(changed(table, harmonics=harmonics))
    found = identify(seen, model("cubic"), Observation(background="constant"))
    assert max(errors(found, truth("cubic")).values()) < 1e-4
    assert found.background.estimates[1].value == pytest.approx(2e-4, rel=1e-3)
    # the phase itself stays unknown
    assert found.background.estimates[0].standard_error == np.inf


def test_a_test_that_is_not_calibrated_says_so():
    table = surface("cubic")
    found = identify(table, model("cubic"), Observation(calibrated=False))
    assert "not-calibrated" in {finding.code for finding in found.findings}
    with pytest.raises(RsgenError, match="not calibrated"):
        Model(model("cubic").elements, mass=1.0, observation=Observation(calibrated=False))


@pytest.mark.slow
def test_the_clamped_beam_has_the_published_backbone(measured_data: Callable[[str], Path]):
    case = load_case(
        Path(__file__).parents[1] / "cases" / "clamp.toml", data=measured_data("frid_clamp").parent
    )
    seen = read_measurement(case.test)
    assert not seen.phase_known
    found = identify(seen, case.model)
    assert found.residual / np.sqrt(2) < 0.02
    published, size = np.loadtxt(
        measured_data("frid_clamp/clamp_cons_backbone.csv"), delimiter=",", skiprows=1
    ).T
    # from the lowest to the highest resonance: below, the test saw no resonance
    peaks = [seen.amplitude[seen.level == level].max() for level in seen.levels]
    crossed = (size > min(peaks)) & (size < max(peaks))
    assert crossed.sum() > 50
    size, published = size[crossed], published[crossed]
    omega = 2 * np.pi * published
    balance = AmplitudeBalance(found)
    for _ in range(20):
        stiffness = balance.solve(size, omega).force.real / size + found.mass * omega**2
        omega = np.sqrt(stiffness / found.mass)
    assert np.max(np.abs(omega / (2 * np.pi) / published - 1)) < 0.002
