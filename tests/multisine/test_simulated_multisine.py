"""Virtual multisine tests of smooth laws, friction and corners: independent motions, and the way back."""

import dataclasses
import io
import zipfile
from typing import Any

import numpy as np
import pytest
from numpy.lib import format as npy

import rsgen
from rsgen.identification.lines import line_identification
from tests.case_files import law as case_law
from tests.case_files import write_small
from tests.surfaces import codes, errors
from tests.virtual import multisine

pytestmark = pytest.mark.slow

LAWS: dict[str, tuple[str, dict[str, float]]] = {
    "cubic": ("k*x + k3*x**3 + c*v", {"k": 5000.0, "k3": 4e6, "c": 4.0}),
    "friction": ("k*x + c*v + F*sign(v)", {"k": 5000.0, "c": 4.0, "F": 0.2}),
    "corner": ("k*x + c*v + kb*Max(x - b, 0)", {"k": 5000.0, "c": 4.0, "kb": 3000.0, "b": 2e-3}),
}
LAWS["even"] = ("k*x + k2*x**2 + k3*x**3 + c*v", {"k": 5000.0, "k2": 2e5, "k3": 4e7, "c": 4.0})
MASS = 1.5


def simulated(name: str, level: tuple[float, ...] = (3.0, 5.0, 8.0), **more: Any) -> rsgen.MultisineSpectra:
    return multisine(*LAWS[name], level, MASS, **{"periods": 1, **more})


@pytest.mark.parametrize(("name", "within"), [("cubic", 1e-9), ("friction", 1e-4), ("corner", 1e-4)])
def test_parameters_come_back(name, within):
    law, values = LAWS[name]
    found = rsgen.identify(simulated(name), law)
    assert max(errors(found, {**values, "m": MASS}).values()) < within


@pytest.mark.parametrize("mean", [0.0, 3e-4, "subtracted"])
def test_an_even_force_does_not_take_up_the_offset_of_a_sensor(mean):
    right, (law, values) = simulated("even", (0.5, 1.0, 2.0), periods=4, noise_relative=1e-3), LAWS["even"]
    motion = np.array(right.response)
    motion[..., 0] = 0.0 if mean == "subtracted" else motion[..., 0] + mean
    found = rsgen.identify(dataclasses.replace(right, response=motion), law)
    assert max(errors(found, {**values, "m": MASS}).values()) < 0.01
    assert found["k2"].interval[0] < 2e5 < found["k2"].interval[1]
    said = [finding for finding in found.findings if finding.code == "sensor-offset"]
    assert [finding.severity for finding in said] == ["warning"] * (mean != 0.0)
    for finding in said:
        assert (finding["differ"] < 1e-6) is (mean != "subtracted")
        assert mean == "subtracted" or finding["offset"] == pytest.approx(mean, rel=1e-3)
    # of a law that lacks the even term nothing is blamed on a sensor
    wrong = rsgen.identify(right, "k*x + k3*x**3 + c*v")
    assert "sensor-offset" not in codes(wrong)


@pytest.mark.parametrize(("displacement", "state"), [(3e-4, "doubtful"), (4e-5, "identified")])
def test_where_the_force_has_a_mean_an_offset_that_moves_values_is_a_doubt(displacement, state):
    """With a laser 0.3 mm off, k2 was identified a fifth too small; a mean of the force alone moves none."""
    right, law = simulated("even", (0.5, 1.0, 2.0), periods=4, noise_relative=1e-3), LAWS["even"][0]
    motion, driven = np.array(right.response), np.array(right.force)
    motion[..., 0] += displacement
    driven[..., 0] += 0.2
    found = rsgen.identify(dataclasses.replace(right, response=motion, force=driven), law)
    assert found.verdict.state == state
    said = [finding for finding in found.findings if finding.code == "sensor-offset"]
    assert len(said) == (state == "doubtful")
    assert {finding.names["values"] for finding in said} <= {"k, k2"}


def test_a_held_out_record_that_is_not_reached_from_rest_is_predicted_near_the_measured_motion(monkeypatch):
    solve = line_identification.periodic_response

    def far_from_rest(law, values, mass, base, force, start, far):
        found = solve(law, values, mass, base, force, start, far)
        return found if start is not None else dataclasses.replace(found, converged=False)

    monkeypatch.setattr(line_identification, "periodic_response", far_from_rest)
    spectra = simulated("cubic", periods=4, noise_relative=1e-3)
    found = rsgen.identify(spectra, LAWS["cubic"][0], rsgen.Observation(hold_out=(8.0,)))
    assert found.held_out[0].error < 0.01
    assert "no-steady-state" not in codes(found)


def test_friction_is_no_smoother_than_it_was():
    spectra = simulated("friction", periods=4, lines="odd", noise_relative=0.01, seed=1)
    found = rsgen.identify(spectra, "k*x + c*v + F*tanh(v/vs)")
    assert found.verdict.state == "identified"
    assert found["vs"].finding is not None
    assert found["vs"].interval[0] <= 0
    assert found["vs"].interval[1] < 0.05


def test_noise_is_of_the_declared_size_and_distortions_stand_where_they_belong():
    spectra = simulated("cubic", periods=40, noise_relative=0.01, realisations=2)
    assert len(spectra) == 6
    apart = spectra.response - spectra.response.mean(axis=1, keepdims=True)
    share = np.sqrt(0.5 * np.sum(np.abs(apart[:, :, 1:]) ** 2, axis=2)).mean(axis=1) / spectra.rms_response()
    np.testing.assert_allclose(share, 0.01 * np.sqrt(39 / 40), rtol=0.05)
    high = rsgen.best_linear(simulated("cubic"))[-1]
    assert high.even.response.max() < 1e-9 * high.response.max()
    assert high.odd.response.max() > 1e-3 * high.response.max()
    assert high.even_share < 1e-9 < 1e-3 < high.odd_share
    assert np.isnan(rsgen.best_linear(simulated("cubic", lines="all"))[0].even_share)


def test_noise_is_no_distortion_at_lines_that_are_not_excited():
    """The virtual test knows the distortion without noise; of a linear structure there is none."""
    for seed in range(3):
        noisy = rsgen.best_linear(simulated("cubic", noise_relative=0.03, periods=6, seed=seed))
        exact = rsgen.best_linear(simulated("cubic", seed=seed))
        for one, true in zip(noisy, exact, strict=True):
            assert one.even_share == 0
            assert 0 < one.even_bound < one.noise_share * 2
            assert true.odd_share <= one.odd_bound
            if one.odd_share:
                assert abs(one.odd_share**2 - true.odd_share**2) < one.odd_bound**2 - one.odd_share**2


CASE = {
    **case_law("k*x + k3*x**3 + c*v", k=5e3, k3=4e6, c=4),
    "test": {
        "kind": "simulated-multisine", "level": {"values": ["3 N", "5 N", "8 N"]},
        "band": ["2.5 Hz", "20 Hz"], "period": "2 s", "periods": 4, "noise": {"relative": 0.01, "seed": 5},
    },
    "identify": {"hold_out": ["5 N"]},
    "accept": {"k": 0.01, "k3": 0.02, "stiffness_force": 0.02},
}  # fmt: skip


def test_a_case_of_a_virtual_multisine_is_checked_and_simulated(tmp_path, run_cli):
    case = write_small(tmp_path, "lines", CASE)
    checked = run_cli("check", case)
    assert checked.code == 0, checked
    assert "54 excited lines of 3 records of 4 periods at 3 levels, 2.5 to 19.5 Hz" in checked.out
    target, loaded = tmp_path / "spectra.npz", rsgen.load_case(case)
    spectra = rsgen.simulate(loaded.oscillator, loaded.test)
    rsgen.save_spectra(target, spectra)
    again = rsgen.load_spectra(target)
    assert (again.force == spectra.force).all()
    assert (again.response == spectra.response).all()
    assert (again.origin, again.base, again.levels.tolist()) == ("simulated", "", spectra.levels.tolist())
    write_small(tmp_path, "lines", CASE | {"identify.hold_out": ["6 N"]})
    assert "6 N is not tested; test.level has 3, 5, 8" in run_cli("check", case).err


def _damaged(folder, **changes):
    values = {"omega0": 1.0, "level": [1.0], "force": np.ones((1, 2, 4)), "response": np.ones((1, 2, 4))}
    kept = {name: value for name, value in (values | changes).items() if value is not None}
    np.savez(folder / "spectra.npz", **kept)
    return folder / "spectra.npz"


@pytest.mark.parametrize(("changes", "fault"), [
    ({"force": None}, "force: missing"), ({"level": np.array([{}], dtype=object)}, "Object arrays"),
    ({"force": np.ones((1, 2, 3))}, "force .1, 2, 3."), ({"base": "x" * 100}, "base: 'xxx"),
    ({"omega0": np.nan}, "omega0"), ({"left_out": [1, 2]}, "left_out: .2,.; one a record"),
    ({"mean_known": [True, False]}, "mean_known: true or false"),
])  # fmt: skip
def test_spectra_that_are_no_spectra_are_refused(tmp_path, changes, fault):
    assert len(rsgen.load_spectra(_damaged(tmp_path))) == 1
    with pytest.raises(rsgen.RsgenError, match=rf"spectra.npz: .*{fault}"):
        rsgen.load_spectra(_damaged(tmp_path, **changes))


def test_a_file_that_declares_more_than_it_holds_is_refused_before_it_is_read(tmp_path):
    header = io.BytesIO()
    npy.write_array_header_1_0(header, {"descr": "<c16", "fortran_order": False, "shape": (1, 10**9, 10**6)})
    path = _damaged(tmp_path, force=None)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("force.npy", header.getvalue())
    whole = path.read_bytes()
    for content in (whole, whole[:200]):
        path.write_bytes(content)
        with pytest.raises(rsgen.RsgenError, match="cannot be read as spectra"):
            rsgen.load_spectra(path)
    path.unlink()
    with pytest.raises(rsgen.RsgenError, match="there is no such file"):
        rsgen.load_spectra(path)


def test_a_softening_spring_that_lets_the_mass_go_on_the_way_is_simulated_from_the_linear_motion():
    values = {"k": 22628.78, "c": 9.5179, "k3": -4927898749.4, "c2": 10.28249}
    oscillator = rsgen.Oscillator(2.28684162, "k*x + c*v + k3*x**3 + c2*v*abs(v)", values)
    test = rsgen.MultisineTest((0.5307, 1.0614, 2.1229), (7.91594, 28.4974), 2.88, periods=1, seed=1307)
    found = rsgen.simulate(oscillator, test)
    assert np.isfinite(found.response).all()
