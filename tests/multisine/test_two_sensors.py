"""Periodic multisines with elements across two sensors: chosen motions, and the force that they need."""

from dataclasses import replace

import numpy as np
import pytest

import rsgen as rs
from rsgen.common.errors import RsgenError
from rsgen.data.multisine.spectra import scatter
from tests.case_files import MEASURED, write_small
from tests.surfaces import codes, distances, errors

OMEGA0, LINES, MASS = np.pi, 256, 1.5
TRUTH = {"k": 5000.0, "c": 4.0, "kj": 4e6, "cj": 2.0, "m": MASS}
WING, JOINT = "k*x + c*v", "kj*x**3 + cj*v"


def spectra(noise: float = 0.0, seed: int = 0, *, gauge: bool = False, still: bool = False):
    """Two motions of three levels; the force is m a + n(x, v) + n_a(z, dz/dt) at every line."""
    generator, moved, samples = np.random.default_rng(seed), np.arange(2, 40), 8 * LINES
    omega, rate = moved * OMEGA0, 1j * np.arange(LINES + 1) * OMEGA0

    def motion(natural: float) -> np.ndarray:
        shape = 1 / (natural - MASS * omega**2 + 6j * omega)
        turn = np.exp(2j * np.pi * generator.random((3, len(moved))))
        found = np.zeros((3, LINES + 1), dtype=complex)
        found[:, moved] = np.array([[1e-3], [4e-3], [1e-2]]) * turn * shape / np.abs(shape).max()
        return found

    def wave(lines: np.ndarray, power: int) -> np.ndarray:
        return np.fft.irfft(lines * rate**power * samples / 2, samples)

    near = motion(5000)
    far = 0 * near if still else 0.6 * near + 0.5 * motion(9000)
    pushed = MASS * wave(near, 2) + TRUTH["c"] * wave(near, 1) + TRUTH["k"] * wave(near, 0)
    pushed += TRUTH["kj"] * wave(near - far, 0) ** 3 + TRUTH["cj"] * wave(near - far, 1)
    force = np.fft.rfft(pushed, axis=1)[:, : LINES + 1] * 2 / samples
    force[:, 0] /= 2
    size = np.sqrt(0.5 * np.sum(np.abs(force[:, 1:]) ** 2, axis=1))

    def seen(lines: np.ndarray) -> np.ndarray:
        drawn = generator.standard_normal((3, 6 if noise else 1, LINES + 1, 2)) @ [1, 1j]
        drawn[..., 0] = drawn[..., 0].real
        rms = np.sqrt(0.5 * np.sum(np.abs(lines[:, 1:]) ** 2, axis=1))
        return lines[:, None] + noise * rms[:, None, None] * drawn / np.sqrt(LINES)

    force, near, far, across = map(seen, (force, near, far, near - far))
    return rs.MultisineSpectra(size, OMEGA0, force, near, across=across if gauge else near - far)


def elements(sensors: str = "payload - wing"):
    return [rs.make_element("wing", WING), rs.make_element("joint", JOINT, across=sensors)]


@pytest.mark.parametrize("gauge", [False, True])
def test_a_joint_between_two_sensors_comes_back_to_round_off(gauge):
    found = rs.identify(spectra(gauge=gauge), elements("gauge" if gauge else "payload - wing"))
    assert max(errors(found, TRUTH).values()) < 1e-9
    moving, even = replace(spectra(), mean_known=False), rs.make_element("joint", "k2*x**2", across="a - b")
    with pytest.raises(RsgenError, match="are not odd, and the mean"):
        rs.identify(moving, [elements()[0], even])


@pytest.mark.parametrize(("seed", "gauge"), [(1, False), (2, True)])
def test_noise_of_both_sensors_is_in_the_errors(seed, gauge):
    records = spectra(0.01, seed, gauge=gauge)
    law = elements("gauge" if gauge else "payload - wing")
    found = rs.identify(records, law, rs.Observation(hold_out=(float(records.levels[1]),)))
    assert found.verdict.usable
    assert np.abs(distances(found, TRUTH)).max() < 4
    prediction = rs.predict(found)
    assert prediction.records[0].error < 0.01
    assert codes(prediction) == {"predicted-along-measured"}
    with pytest.raises(RsgenError, match="known only where it was measured"):
        rs.predict(found, [1.0])


def test_highest_lines_below_their_noise_and_lowest_above_it_are_part_of_the_motion_across():
    records = spectra(0.01, 1)
    assert (records.reach()[1] < LINES).all()
    np.testing.assert_array_equal(records.far(1.0)[..., -1], (records.across - records.response)[..., -1])
    motions = [np.array(records.response), np.array(records.across)]
    for motion in motions:
        noise = np.sqrt(scatter(motion))[:, 1:2]
        motion[..., 1] += 5 * noise - motion[..., 1].mean(axis=1, keepdims=True)
    moved = replace(records, response=motions[0], across=motions[1])
    assert (moved.reach()[0] == 1).all()
    # a law gives the lowest lines of a test with one sensor
    assert (replace(moved, across=None).reach()[0] > 1).all()


@pytest.mark.parametrize("wrong", ["reversed", "other motion"])
def test_another_motion_across_is_rejected(wrong):
    right = spectra(0.01)
    across = -right.across if wrong == "reversed" else right.response - right.across
    found = rs.identify(replace(right, across=across), elements())
    assert not found.verdict.usable
    (signs,) = {f.names.get("sensors") for f in found.findings if f.code == "curve-negative"}
    assert signs == "payload - wing"


@pytest.mark.parametrize("both", [False, True])
def test_a_background_that_the_second_sensor_does_not_share_is_in_the_interval(both):
    """Declared it is one of the first sensor, so that of both leaves that of the second; none is as wrong."""
    records = spectra(1e-3, 1)
    seen = 4e-7 * (1 + 0.3j) * records.force * (records.lines > 0)
    sensors = {"response": records.response + seen} if both else {"across": records.across - seen}
    facts = rs.Observation(background="constant" if both else "none")
    found = rs.identify(replace(records, **sensors), elements(), facts)
    known = replace(records, response=records.response + seen, across=records.across + seen)
    right = rs.identify(known, elements(), rs.Observation(background="constant"))
    assert abs(right["kj"].value - TRUTH["kj"]) < 3 * right["kj"].standard_error
    assert abs(found["kj"].value - TRUTH["kj"]) > 4 * right["kj"].standard_error
    assert abs(found["kj"].value - TRUTH["kj"]) < 3 * found["kj"].standard_error
    (said,) = (finding for finding in found.findings if finding.code == "law-ambiguous")
    # the constant is a part of the residual terms, which move the value alike: noise says which moves it more
    assert set(said.names) == {"background of the second sensor"}


CASE = {
    **MEASURED,
    "element": [
        {"name": "wing", "force": WING},
        {"name": "joint", "force": JOINT, "across": "payload - wing"},
    ],
    "test.excitation": "multisine", "test.file": ["low.csv", "middle.csv", "high.csv"],
    "test.time": {"rate": 256}, "test.force": {"samples": 1},
    "test.channels": {
        name: {"quantity": "displacement", "samples": samples}
        for name, samples in (("payload", 2), ("wing", 3))
    },
    "test.response": {"channels": "payload"},
}  # fmt: skip


@pytest.mark.slow
def test_time_histories_of_two_sensors_are_read_and_reported(tmp_path, run_cli):
    exact = spectra()
    channels = (exact.force, exact.response, exact.response - exact.across)
    for name, *lines in zip(("low", "middle", "high"), *(one[:, 0] for one in channels), strict=True):
        moving = np.arange(LINES + 1) > 0
        waves = [one[0].real + np.fft.irfft(one * moving * LINES, 2 * LINES) for one in lines]
        table = np.column_stack([np.tile(wave, 4) for wave in waves])
        np.savetxt(tmp_path / f"{name}.csv", table, delimiter=",")
    held = {"identify.hold_out": [f"{exact.levels[1]:.3g} N"]}
    path = write_small(tmp_path, "joined", CASE | held)
    case = rs.load_case(path)
    found = rs.identify(rs.read(case), case.model)
    assert max(errors(found, TRUTH).values()) < 1e-4
    run_cli("run", path, "--out", tmp_path / "out")
    notebook = (tmp_path / "out" / "joined" / "notebook.ipynb").read_text(encoding="utf-8")
    assert '"output_type": "error"' not in notebook
    with np.load(tmp_path / "out" / "joined" / "spectra.npz") as saved:
        assert saved["across"].shape == saved["response"].shape
