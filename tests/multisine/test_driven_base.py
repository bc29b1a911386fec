"""Periodic multisines of a driven base: the motion of the base takes the place of a force."""

from dataclasses import replace

import numpy as np
import pytest

import rsgen as rs
from tests.case_files import MEASURED, write_small
from tests.surfaces import codes
from tests.virtual import multisine, only

LAW = "k*x + k3*x**3 + c*v"
TRUTH = {"k": 5000.0, "k3": 4e6, "c": 4.0}
MASS = 1.5


def shaken(noise: float = 0.0) -> rs.MultisineSpectra:
    how = {"periods": 8, "noise_relative": noise, "seed": 1, "base": "acceleration"}
    return multisine(LAW, TRUTH, (2.0, 3.3, 5.3), MASS, **how)


@pytest.fixture(scope="module")
def exact():
    return shaken()


def test_a_base_drives_as_the_inertia_force_does(exact):
    pushed = replace(exact, force=MASS * exact.force, per_mass=False, base="")
    free, given = rs.identify(pushed, LAW, mass=MASS), rs.identify(exact, LAW, mass=MASS)
    alone = rs.identify(exact, LAW)
    for name, true in TRUTH.items():
        assert free[name].value == pytest.approx(true, rel=1e-8)
        assert given[name].value == pytest.approx(free[name].value, rel=1e-12)
        assert alone[name].value == pytest.approx(free[name].value / MASS, rel=1e-9)
        assert alone[name].standard_error == pytest.approx(free[name].standard_error / MASS, rel=1e-6)
    weighed = {"mass": MASS, "mass_error": 0.02 * MASS}
    found, table = rs.identify(exact, LAW, **weighed), rs.modal_table(exact, **weighed)
    for one in (*given, *given.fixed):
        assert found[one.name].value == pytest.approx(one.value, rel=1e-9)
        assert found[one.name].standard_error == pytest.approx(0.02 * one.value, rel=1e-3)
    assert table.mass_error == pytest.approx(0.02 * MASS)
    assert (given["k"].unit, alone["k"].unit) == ("N/m", "N/m/kg")
    assert alone.curve.level_unit == "m/s^2"
    assert "per-unit-mass" in codes(alone)


@pytest.mark.slow
def test_noise_is_in_the_errors():
    found = rs.identify(shaken(0.01), LAW, rs.Observation(hold_out=(3.3,)))
    assert found.verdict.usable
    for name, true in TRUTH.items():
        assert abs(found[name].value - true / MASS) < 4 * found[name].standard_error, name
    (record,) = rs.predict(found).records
    assert record.error < 0.01
    assert rs.predict(found, surface=shaken(0.01)).records[1].error == pytest.approx(record.error)


@pytest.mark.parametrize("wrong", ["sign", "absolute"])
def test_a_misread_base_is_not_trusted(wrong):
    right = shaken(0.01)
    base = np.zeros_like(right.force)
    base[..., 1:] = right.force[..., 1:] / (2 * np.pi * right.frequency[1:]) ** 2
    read = {"sign": {"force": -right.force}, "absolute": {"response": right.response + base}}[wrong]
    found = rs.identify(replace(right, **read), LAW)
    assert not found.verdict.usable
    assert "law-does-not-fit" in codes(found)


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize(("gain", "background"), [(0.02, "none"), (-0.02, "residuals"), (0.0, "none")])
def test_a_ratio_of_the_channels_is_named_with_its_size(absolute, gain, background):
    right = shaken(0.01)
    base = np.zeros_like(right.force)
    if absolute:
        base[..., 1:] = right.force[..., 1:] / (2 * np.pi * right.frequency[1:]) ** 2
    read = replace(right, response=(1 + gain) * (right.response + base) - base)
    found = rs.identify(read, LAW, rs.Observation(background=background))
    assert found.verdict.usable == (gain == 0)
    for said in [only(found, "channels-delayed")] if gain else []:
        assert abs(said["gain"] - gain) < said["within"] < 0.2 * abs(gain)
        assert said["left"] == pytest.approx(found.noise, rel=0.3)


CASE = {
    **MEASURED, "element": [{"name": "all", "force": LAW}], "test.excitation": "multisine",
    "test.file": ["low.csv", "middle.csv", "high.csv"], "test.time": {"rate": 200},
    "test.base": {"quantity": "acceleration", "samples": 1, "response": "absolute"},
    "test.response": {"quantity": "acceleration", "samples": 2}, "identify": {"hold_out": ["3.3 m/s^2"]},
}  # fmt: skip


@pytest.mark.slow
def test_absolute_accelerations_of_a_table_are_read(exact, tmp_path):
    moved = exact.mean_response * (1j * exact.lines * exact.omega0) ** 2
    channels = (-exact.mean_force, moved - exact.mean_force)
    for name, *lines in zip(("low", "middle", "high"), *channels, strict=True):
        samples = [np.tile(np.fft.irfft(np.pad(one, (0, 40)) * 200, 400), 4) for one in lines]
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack(samples), delimiter=",")
    path = write_small(tmp_path, "table", CASE)
    spectra = rs.read(rs.load_case(path))
    assert (spectra.per_mass, spectra.base, spectra.levels.tolist()) == (True, "acceleration", [2, 3.3, 5.3])
    found = rs.identify(spectra, LAW)
    assert found["k3"].value == pytest.approx(TRUTH["k3"] / MASS, rel=1e-6)
