"""Channels with names: sums of them, delays, a driven base, an element across two of them."""

import numpy as np
import pytest

import rsgen as rs
from rsgen.common.errors import CaseError, MeasurementError
from rsgen.files.histories import shifted
from rsgen.files.plan import HistoryRule
from rsgen.files.signals import BaseRule, Channel, combination
from tests.case_files import GONE, MEASURED, Changes, write_small
from tests.measurement.tables import planned, write_columns

F = np.linspace(6.0, 9.0, 25)
OMEGA = 2 * np.pi * F
WING = 1e-3 / (1 - (F / 7.4) ** 2 + 0.05j)
PAYLOAD = (1.3 - 0.1j) * WING
FORCE = 3.0 * np.exp(0.2j * F)


def test_a_sum_of_channels_is_read():
    assert combination("-base") == {"base": -1.0}
    assert combination(" 0.5*left + .5 * right-2.*up") == {"left": 0.5, "right": 0.5, "up": -2.0}


@pytest.mark.parametrize("text", ["", "a b", "a*2", "a - a", "0*a", "__import__('os')", "2", "a +", "a/b"])
def test_what_is_no_sum_is_refused(text):
    with pytest.raises(MeasurementError):
        combination(text)


@pytest.mark.parametrize("delay", [3, 0.5, -2.3])
def test_samples_are_shifted_by_parts_of_a_sample(delay):
    t = np.arange(3000.0)
    for f in (0.01, 0.2, 0.4):
        moved = shifted(np.cos(2 * np.pi * f * t + 0.3), delay)[200:-200]
        expected = np.cos(2 * np.pi * f * (t + delay) + 0.3)[200:-200]
        np.testing.assert_allclose(moved, expected, atol=1e-4)


SPRING, ACROSS = "k*x + c*v", "payload - wing"


def parts(first: int, quantity: str | None = None, **more: object) -> dict[str, object]:
    said = {} if quantity is None else {"quantity": quantity}
    return {**said, "real": first, "imaginary": first + 1, "phase_sense": "lead", **more}


def write(folder, changes: Changes, level: str = "3 N", **columns):
    """Files a.csv (frequency first) and b.csv of complex columns, and the case that reads them."""
    for name, complex_columns in columns.items():
        split = [part for values in complex_columns for part in (values.real, values.imag)]
        write_columns(folder / f"{name}.csv", "", *([F] if name == "a" else []), *split)
    known = {**MEASURED, "test.frequency": {"column": 1}, "test.level": {"value": level}}
    return write_small(folder, "two", known | changes)


CHANNELS = {"test.channels": {"wing": parts(4, "displacement"), "payload": parts(6, "displacement")}}
SENSORS = {**CHANNELS, "test.force": parts(2), "test.response": {"channels": "wing"}}
MOUNT = {"name": "mount", "force": "k3*x**3", "across": ACROSS}
MOUNTED = {**SENSORS, "element": [{"name": "wing", "force": SPRING}, MOUNT]}


def test_each_channel_has_its_file_quantity_unit_factor_and_delay(tmp_path):
    late = 1j * OMEGA * WING * np.exp(-1j * OMEGA * 2e-3)
    channels = {
        "load": parts(2, "force", unit="mN"),
        "payload": parts(4, "acceleration", unit="m/s^2", factor=-2),
        "wing": parts(1, "velocity", file="b.csv", unit="mm/s", delay="2 ms"),
    }
    read = {"test.force": {"channels": "2*load"}, "test.response": {"channels": "payload - 0.5*wing"}}
    a = (1e3 * FORCE / 2, -(OMEGA**2) * PAYLOAD / -2)
    surface = rs.read(write(tmp_path, {"test.channels": channels, **read}, a=a, b=(1e3 * late,)))
    np.testing.assert_allclose(surface.force, FORCE, rtol=1e-12)
    np.testing.assert_allclose(surface.harmonics[:, 1], PAYLOAD - 0.5 * WING, rtol=1e-12)


@pytest.mark.parametrize(("quantity", "power", "unit"), [
    ("displacement", 0, "m"), ("velocity", 1, "m/s"), ("acceleration", 2, "m/s^2"),
])  # fmt: skip
@pytest.mark.parametrize("response", ["relative", "absolute"])
def test_a_base_drives_by_its_acceleration(tmp_path, quantity, power, unit, response):
    base = 1e-4 * np.exp(0.3j) * np.ones(len(F))
    seen = WING + (base if response == "absolute" else 0)
    amount = float(np.median(np.abs(base * OMEGA**power)))
    read = {"test.base": parts(2, quantity, response=response), "test.response": parts(4, "displacement")}
    surface = rs.read(write(tmp_path, read, f"{amount:.9g} {unit}", a=((1j * OMEGA) ** power * base, seen)))
    np.testing.assert_allclose(surface.force, OMEGA**2 * base, rtol=1e-12)
    np.testing.assert_allclose(surface.harmonics[:, 1], WING, rtol=1e-9)
    assert (surface.per_mass, surface.base, surface.level_unit) == (True, quantity, unit)
    np.testing.assert_allclose(surface.level, amount, rtol=1e-8)
    assert "levels-disagree" not in {finding.code for finding in surface.findings}
    np.testing.assert_allclose(surface.drive, np.abs(base) * OMEGA**power, rtol=1e-12)


def test_an_element_acts_across_two_channels(tmp_path):
    z = PAYLOAD - WING
    force = (5e3 + 3j * OMEGA - 2.0 * OMEGA**2) * WING + 0.75 * 4e9 * np.abs(z) ** 2 * z
    case = rs.load_case(write(tmp_path, MOUNTED, a=(force, WING, PAYLOAD)))
    surface = rs.read(case)
    np.testing.assert_allclose(surface.across[:, 1], PAYLOAD - WING, rtol=1e-9)
    found = rs.identify(surface, case.model)
    for name, true in {"k": 5e3, "c": 3.0, "k3": 4e9, "m": 2.0}.items():
        assert found[name].value == pytest.approx(true, rel=1e-8)


@pytest.mark.slow
def test_time_histories_are_added_shifted_and_taken_across(tmp_path):
    t = np.arange(0, 60, 1 / 400)
    drive = 3 * np.cos(2 * np.pi * (5 + 0.05 * t) * t)
    late = shifted(drive, -0.7)
    payload = {"quantity": "displacement", "samples": 2}
    read = {
        "element": [{"name": "all", "force": SPRING}, MOUNT], "test.frequency": GONE,
        "test.excitation": "swept-sine", "test.time": {"rate": 400}, "test.force": {"samples": 1},
        "test.channels": {"payload": payload, "wing": payload | {"samples": 3, "delay": 0.00175}},
        "test.response": {"channels": "payload"},
    }  # fmt: skip
    write_columns(tmp_path / "a.csv", "", drive, 2e-6 * drive, 5e-7 * late)
    surface = rs.read(write(tmp_path, read))
    np.testing.assert_allclose(surface.harmonics[:, 1] / surface.force, 2e-6, rtol=1e-3)
    np.testing.assert_allclose(surface.across[:, 1] / surface.harmonics[:, 1], 0.75, rtol=1e-3)
    short = read | {"test.time": {"rate": 1e5}, "test.channels.wing.delay": 1}
    with pytest.raises(MeasurementError, match=r"1 s of delay; the record lasts 0\.24 s"):
        rs.read(write(tmp_path, short))


@pytest.mark.parametrize(("changes", "said"), [
    ({"test.response.channels": "tail"}, "tail: no such channel; known: wing, pay"),
    ({"test.response.channels": "wing wing"}, "a sum of channels is needed"),
    ({"test.response.real": 4, "test.response.imaginary": 5}, "leave one of them out"),
    ({"test.response.factor": -1}, "factor: is of a column"),
    ({"test.response.quantity": "velocity"}, "quantity: is 'velocity', but"),
    ({"test.channels.payload.delay": 1e300}, "delay"),
    ({"test.force": {"channels": "wing"}}, "made of forces"),
    ({"test.force.file": ["a.csv", "b.csv"]}, "test.force.file: 2 for 1 files"),
    ({"test.force": {"nominal": True, "real": 2, "imaginary": 3}}, "test.force.real: .* nominal"),
    ({"test.channels": GONE, "test.response": parts(4, "velocity", nominal=True)}, "nominal: is true; only"),
    ({"element": MOUNTED["element"], "element.2.across": "payload - tail"}, "tail: no such channel"),
    ({"test.channels": GONE, "test.response": parts(4)}, "quantity: is missing"),
])  # fmt: skip
def test_what_does_not_fit_is_said(tmp_path, changes, said):
    with pytest.raises(CaseError, match=said):
        rs.load_case(write(tmp_path, SENSORS | changes, a=(FORCE, WING, PAYLOAD)))


def test_a_base_does_not_lose_its_unit_in_a_free_decay():
    history = HistoryRule("ring-down", rate=400.0)
    base = BaseRule(Channel(samples="b", quantity="acceleration"), "relative")
    with pytest.raises(MeasurementError, match="base: does not go with 'ring-down'"):
        planned("a.csv", None, None, Channel(samples="x"), history=history, base=base)
