"""Laws ranked by the lines of multisines: virtual tests with noise, what no law explains, and one period."""

from dataclasses import replace

import numpy as np
import pytest

import rsgen as rs
from rsgen.data.oscillator import Model
from rsgen.identification.ranking.records import RecordTest
from rsgen.law.element import as_elements
from tests.ranking.test_ranking import MASS, NOISE, named
from tests.surfaces import codes
from tests.virtual import multisine

BASE, QUIET = "k*x + c*v", {"period": 1.0, "periods": 4, "noise_relative": NOISE / 4}
LAWS: dict[str, tuple[str, dict[str, float], tuple[float, ...]]] = {
    "cubic-spring": ("k3*x**3", {"k3": 4e6}, (3, 5, 8)),
    "coulomb": ("Ff*sign(v)", {"Ff": 0.6}, (8, 12, 20)),
    "dead-zone": ("k_*(Max(x - b, 0) + Min(x + b, 0))", {"k_": 8000.0, "b": 2e-3}, (4, 6, 9)),
    "jenkins": ("Fs*masing(Min(x/xs, 1))", {"Fs": 2.0, "xs": 1.3e-3}, (4, 8, 14)),
}
RIVALS = named(*LAWS, "quintic-spring", "bilinear-spring", "quadratic-damper", "preload")


def virtual(name: str, seed: int = 0) -> rs.MultisineSpectra:
    """A virtual multisine of 36 lines at three levels, with 1 % noise."""
    term, values, levels = LAWS[name]
    known, how = {"k": 5000.0, "c": 15.0, **values}, {"noise_relative": NOISE, "seed": seed}
    return multisine(f"{BASE} + {term}", known, levels, MASS, period=1.0, periods=4, **how)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("name", [name for name in LAWS if name != "jenkins"])
def test_the_law_behind_a_multisine_is_first_or_tied(name: str, seed: int) -> None:
    ranking = rs.rank(virtual(name, seed), [law for law in RIVALS if law.name != "jenkins"])
    assert ranking.fits
    assert ranking[name].tied
    assert ranking.verdict.state == "identified"
    for law in (BASE, "k*x + k5*x**5 + c*v"):
        assert not any(candidate.tied for candidate in ranking if candidate.force == law)
    assert ranking[name].held_out_error < 2 * NOISE


@pytest.mark.slow
def test_a_joint_with_memory_is_found() -> None:
    ranking = rs.rank(virtual("jenkins"), RIVALS[: len(LAWS)])
    assert ranking.fits
    assert ranking.candidates[0].name == "jenkins"


@pytest.mark.parametrize("mean", ["subtracted", "offset"])
def test_a_mean_that_is_the_sensors_decides_no_ranking(mean: str) -> None:
    gap = "Max(x - b, 0)" if mean == "subtracted" else "(Max(x - b, 0) + Min(x + b, 0))"
    values = {"k": 5000.0, "c": 15.0, "kg": 8000.0, "b": 2e-3}
    spectra = multisine(f"{BASE} + kg*{gap}", values, (4, 6, 9), MASS, **QUIET)
    response = np.array(spectra.response)
    response[:, :, 0] = 0 if mean == "subtracted" else response[:, :, 0] + 3e-4
    rivals = named("dead-zone", "one-sided-stop", "jenkins")
    ranking = rs.rank(replace(spectra, response=response), rivals)
    first = "one-sided-stop" if mean == "subtracted" else "dead-zone"
    assert ranking.candidates[0].name == first
    assert ranking.fits
    assert ranking.best["b"].value == pytest.approx(2e-3, rel=0.02)
    assert "sensor-offset" in codes(ranking)


def test_what_else_is_ranked_does_not_decide_whether_a_mean_is_the_sensors() -> None:
    # a knee at the sensor's offset does without the mean what the knee at rest does
    values = {"k": 8000.0, "c": 15.0, "kb": -2500.0}
    spectra = multisine(f"{BASE} + kb*Max(x, 0)", values, (4, 9), MASS, **QUIET)
    response = np.array(spectra.response)
    response[:, :, 0] += 3e-4
    laws = [f"{BASE} + kb*Max({x}, 0)" for x in ("x", "x - b")]
    rest, moved = rs.rank(replace(spectra, response=response), laws)
    assert "b" not in rest.values
    assert moved.tied


def test_the_rows_leave_what_the_fit_of_the_lines_leaves() -> None:
    spectra = virtual("cubic-spring")
    model = Model(as_elements(f"{BASE} + k3*x**3"))
    test = RecordTest(spectra, model)
    found = test.along(test.start("own", model.elements), None)
    assert found is not None
    # two ways to the least squares of the lines
    identified = rs.identify(spectra, model)
    assert found.relative(found.leader.residual) == pytest.approx(identified.residual, rel=1e-3)
    for estimate in identified.refined:
        off = found.leader.candidate.values[estimate.name] - estimate.value
        assert abs(off) < 0.1 * estimate.standard_error


def test_what_no_law_explains_is_said() -> None:
    # the force of one band is off at all levels: no law does that
    spectra = virtual("cubic-spring")
    force = np.array(spectra.force)
    inside = (spectra.frequency > 9) & (spectra.frequency < 12)
    force[:, :, inside] *= 1.15
    ranking = rs.rank(replace(spectra, force=force), RIVALS[:2])
    assert not ranking.fits
    assert ranking.verdict.state == "rejected"


def test_one_period_does_not_say_whether_the_nearest_law_fits() -> None:
    spectra = virtual("dead-zone")
    first = replace(spectra, force=spectra.force[:, :1], response=spectra.response[:, :1])
    ranking = rs.rank(first, RIVALS[:3])
    assert ranking.candidates[0].name == "dead-zone"
    assert not ranking.fits
    assert "law-nearest" in codes(ranking)


def test_a_driven_base_is_ranked_per_unit_mass() -> None:
    pushed = virtual("cubic-spring")
    shaken = replace(pushed, force=pushed.force / MASS, per_mass=True, base="acceleration")
    ranking = rs.rank(shaken, RIVALS[:2])
    assert ranking.candidates[0].name == "cubic-spring"
    whole = rs.rank(pushed, RIVALS[:2], mass=MASS).candidates[0]
    assert ranking.candidates[0].values["k"] == pytest.approx(whole.values["k"] / MASS, rel=1e-4)
