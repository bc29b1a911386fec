"""Channels with names: sums of them, delays, a driven base, an element across two of them."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import rsgen as rs
from rsgen.common.errors import CaseError, MeasurementError
from rsgen.files import HistoryRule, MeasuredTest
from rsgen.files.histories import shifted
from rsgen.files.signals import BaseRule, Channel, Signal, combination

F = np.linspace(6.0, 9.0, 25)
OMEGA = 2 * np.pi * F
WING = 1e-3 / (1 - (F / 7.4) ** 2 + 0.05j)
PAYLOAD = (1.3 - 0.1j) * WING
FORCE = 3.0 * np.exp(0.2j * F)


@pytest.mark.parametrize(
    ("text", "terms"),
    [
        ("payload - wing", {"payload": 1.0, "wing": -1.0}),
        ("-base", {"base": -1.0}),
        (" 0.5*left + .5 * right-2.*up", {"left": 0.5, "right": 0.5, "up": -2.0}),
    ],
)
def test_a_sum_of_channels_is_read(text, terms):
    assert combination(text) == terms


@pytest.mark.parametrize(
    "text", ["", "a b", "a*2", "a - a", "0*a", "__import__('os')", "2", "a +", "a.b", "a/b"]
)
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


def test_a_channel_sampled_later_has_a_negative_delay():
    """Its samples are those of a later instant: they have to move back."""
    t, late, omega = np.arange(2000.0), 0.4, 2 * np.pi * 0.02
    np.testing.assert_allclose(
        shifted(np.cos(omega * (t + late)), -late)[200:-200], np.cos(omega * t)[200:-200], atol=1e-4
    )
    said = next(one for one in fields(Channel) if one.name == "delay").metadata
    assert "Negative for a channel that is sampled later" in str(said)


CASE = """
schema = 1
name   = "two"
title  = "Two sensors"
{elements}
[test]
kind = "measured"
file = "a.csv"
[test.frequency]
column = 1
[test.level]
value = "{level}"
{test}
"""
SPRING = """
[[element]]
name  = "all"
force = "k*x + c*v"
"""


def write(folder: Path, test: str, elements: str = SPRING, level: str = "3 N", **columns) -> Path:
    """Files a.csv (frequency first) and b.csv of complex columns, and the case that reads them."""
    for name in ("a", "b"):
        parts = [F] if name == "a" else []
        for values in columns.get(name, ()):
            parts += [values.real, values.imag]
        if parts:
            np.savetxt(folder / f"{name}.csv", np.column_stack(parts), delimiter=",", fmt="%.17g")
    path = folder / "case.toml"
    path.write_text(CASE.format(elements=elements, level=level, test=test))
    return path


def channel(name: str, quantity: str, first: int, more: str = "") -> str:
    return (
        f'[test.channels.{name}]\nquantity = "{quantity}"\nreal = {first}\nimaginary = {first + 1}\n'
        f'phase_sense = "lead"\n{more}\n'
    )


def test_each_channel_has_its_file_quantity_unit_factor_and_delay(tmp_path):
    delay = 2e-3
    late = 1j * OMEGA * WING * np.exp(-1j * OMEGA * delay)
    path = write(
        tmp_path,
        channel("load", "force", 2, 'unit = "mN"')
        + channel("payload", "acceleration", 4, 'unit = "m/s^2"\nfactor = -2')
        + channel("wing", "velocity", 1, 'file = "b.csv"\nunit = "mm/s"\ndelay = "2 ms"')
        + '[test.force]\nchannels = "2*load"\n[test.response]\nchannels = "payload - 0.5*wing"\n',
        a=(1e3 * FORCE / 2, -(OMEGA**2) * PAYLOAD / -2),
        b=(1e3 * late,),
    )
    surface = rs.read(rs.load_case(path))
    np.testing.assert_allclose(surface.force, FORCE, rtol=1e-12)
    np.testing.assert_allclose(surface.harmonics[:, 1], PAYLOAD - 0.5 * WING, rtol=1e-12)


def test_columns_of_force_and_response_have_all_that_a_named_channel_has(tmp_path):
    late = 1j * OMEGA * WING * np.exp(-2e-3j * OMEGA)
    place = 'real = {}\nimaginary = {}\nphase_sense = "lead"\n'
    force = "[test.force]\n" + place.format(1, 2) + 'file = "b.csv"\nquantity = "force"\n'
    response = "[test.response]\n" + place.format(2, 3) + 'quantity = "velocity"\ndelay = "2 ms"\n'
    surface = rs.read(rs.load_case(write(tmp_path, force + response, a=(late,), b=(FORCE,))))
    np.testing.assert_allclose(surface.force, FORCE, rtol=1e-12)
    np.testing.assert_allclose(surface.harmonics[:, 1], WING, rtol=1e-12)
    for text, said in (
        (force.replace('"force"', '"velocity"') + response, "test.force.quantity: is 'velocity'; 'force' is"),
        (force + response.replace('"velocity"', '"force"'), "test.response.quantity: is 'force'; 'displ"),
        (force.replace('"b.csv"', '["a.csv", "b.csv"]') + response, "test.force.file: 2 for 1 files"),
        ("[test.force]\nnominal = true\nreal = 2\nimaginary = 3\n" + response, "test.force.nominal"),
    ):
        with pytest.raises(CaseError, match=said):
            rs.load_case(write(tmp_path, text))


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
@pytest.mark.parametrize("response", ["relative", "absolute"])
def test_a_base_drives_by_its_acceleration(tmp_path, quantity, response):
    power = {"displacement": 0, "velocity": 1, "acceleration": 2}[quantity]
    base = 1e-4 * np.exp(0.3j) * np.ones(len(F))
    seen = WING + (base if response == "absolute" else 0)
    unit = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}[quantity]
    amount = float(np.median(np.abs(base * OMEGA**power)))
    path = write(
        tmp_path,
        f'[test.base]\nquantity = "{quantity}"\nresponse = "{response}"\nreal = 2\nimaginary = 3\n'
        'phase_sense = "lead"\n[test.response]\nquantity = "displacement"\nreal = 4\nimaginary = 5\n'
        'phase_sense = "lead"\n',
        level=f"{amount:.9g} {unit}",
        a=((1j * OMEGA) ** power * base, seen),
    )
    surface = rs.read(rs.load_case(path))
    np.testing.assert_allclose(surface.force, OMEGA**2 * base, rtol=1e-12)
    np.testing.assert_allclose(surface.harmonics[:, 1], WING, rtol=1e-9)
    assert (surface.per_mass, surface.base, surface.level_unit) == (True, quantity, unit)
    np.testing.assert_allclose(surface.level, amount, rtol=1e-8)
    assert "levels-disagree" not in {finding.code for finding in surface.findings}
    np.testing.assert_allclose(surface.drive, np.abs(base) * OMEGA**power, rtol=1e-12)


def test_levels_have_the_unit_of_the_channels_of_the_base_whatever_others_are_called(tmp_path):
    test = channel("a", "displacement", 4) + channel("table", "acceleration", 2)
    test += '[test.base]\nresponse = "relative"\nchannels = "table"\n[test.response]\nchannels = "a"\n'
    path = write(tmp_path, test, level="2 m/s^2", a=(2.0 * np.exp(0.2j * F), WING))
    surface = rs.read(rs.load_case(path))
    assert (surface.level_unit, surface.levels.tolist()) == ("m/s^2", [2.0])


ACROSS = """
[[element]]
name  = "wing"
force = "k*x + c*v"
[[element]]
name   = "mount"
force  = "k3*x**3"
across = "payload - wing"
"""
CHANNELS = channel("wing", "displacement", 4) + channel("payload", "displacement", 6)
FORCE_AND_WING = (
    '[test.force]\nreal = 2\nimaginary = 3\nphase_sense = "lead"\n[test.response]\nchannels = "wing"\n'
)


def test_an_element_acts_across_two_channels(tmp_path):
    z = PAYLOAD - WING
    force = (5e3 + 3j * OMEGA - 2.0 * OMEGA**2) * WING + 0.75 * 4e9 * np.abs(z) ** 2 * z
    path = write(tmp_path, CHANNELS + FORCE_AND_WING, ACROSS, a=(force, WING, PAYLOAD))
    case = rs.load_case(path)
    surface = rs.read(case)
    np.testing.assert_allclose(surface.across[:, 1], z, rtol=1e-9)
    found = rs.identify(surface, case.model)
    for name, true in {"k": 5e3, "c": 3.0, "k3": 4e9, "m": 2.0}.items():
        assert found[name].value == pytest.approx(true, rel=1e-8)


@pytest.mark.slow
def test_time_histories_are_added_shifted_and_taken_across(tmp_path):
    rate, seconds = 400.0, 60
    t = np.arange(0, seconds, 1 / rate)
    drive = 3 * np.cos(2 * np.pi * (5 + 0.05 * t) * t)
    late = shifted(drive, -0.7)
    np.savetxt(tmp_path / "a.csv", np.column_stack([drive, 2e-6 * drive, 5e-7 * late]), delimiter=",")
    text = CASE.replace("[test.frequency]\ncolumn = 1\n", "").format(
        elements=SPRING + ACROSS.split("[[element]]")[2].join(["[[element]]", ""]),
        level="3 N",
        test="""
[test.time]
rate = 400
[test.force]
samples = 1
[test.channels.payload]
quantity = "displacement"
samples  = 2
[test.channels.wing]
quantity = "displacement"
samples  = 3
delay    = 0.00175
[test.response]
channels = "payload"
""",
    )
    path = tmp_path / "case.toml"
    path.write_text(text.replace('kind = "measured"', 'kind = "measured"\nexcitation = "swept-sine"'))
    surface = rs.read(rs.load_case(path))
    np.testing.assert_allclose(surface.harmonics[:, 1] / surface.force, 2e-6, rtol=1e-3)
    np.testing.assert_allclose(surface.across[:, 1] / surface.harmonics[:, 1], 0.75, rtol=1e-3)
    short = text.replace("rate = 400", "rate = 1e5").replace("0.00175", "1")
    path.write_text(short.replace('kind = "measured"', 'kind = "measured"\nexcitation = "swept-sine"'))
    with pytest.raises(MeasurementError, match=r"1 s of delay; the record lasts 0\.24 s"):
        rs.read(rs.load_case(path))


@pytest.mark.parametrize(
    ("test", "elements", "said"),
    [
        (
            CHANNELS + FORCE_AND_WING.replace('"wing"', '"tail"'),
            SPRING,
            "tail: no such channel; known: wing, pay",
        ),
        (CHANNELS + FORCE_AND_WING.replace('"wing"', '"wing wing"'), SPRING, "a sum of channels is needed"),
        (CHANNELS + FORCE_AND_WING + "real = 4\nimaginary = 5\n", SPRING, "leave one of them out"),
        (CHANNELS + FORCE_AND_WING + "factor = -1\n", SPRING, "factor: is of a column"),
        (CHANNELS + FORCE_AND_WING + 'unit = "mm"\n', SPRING, "unit: is of a column"),
        (CHANNELS + FORCE_AND_WING + 'quantity = "velocity"\n', SPRING, "quantity: is 'velocity', but"),
        (CHANNELS + FORCE_AND_WING + 'file = "b.csv"\n', SPRING, "file: is of a column"),
        (CHANNELS + "delay = 1e300\n" + FORCE_AND_WING, SPRING, "delay"),
        (
            CHANNELS + '[test.force]\nchannels = "wing"\n[test.response]\nchannels = "wing"',
            SPRING,
            "made of forces",
        ),
        (CHANNELS + FORCE_AND_WING, ACROSS.replace("- wing", "- tail"), "tail: no such channel"),
        (
            CHANNELS + FORCE_AND_WING + '[test.base]\nresponse = "relative"\nchannels = "wing"\n',
            SPRING,
            "leave one",
        ),
        (CHANNELS + '[test.response]\nchannels = "wing"\n', SPRING, "force: is missing"),
        (
            FORCE_AND_WING.replace('channels = "wing"', "real = 4\nimaginary = 5"),
            SPRING,
            "quantity: is missing",
        ),
    ],
)
def test_what_does_not_fit_is_said(tmp_path, test, elements, said):
    with pytest.raises(CaseError, match=said):
        rs.load_case(write(tmp_path, test, elements, a=(FORCE, WING, PAYLOAD)))


def test_a_base_does_not_lose_its_unit_in_a_free_decay():
    history = HistoryRule("ring-down", rate=400.0)
    base = BaseRule(Signal(samples="b", quantity="acceleration"), "relative")
    with pytest.raises(MeasurementError, match="base: does not go with 'ring-down'"):
        MeasuredTest("a.csv", None, None, Signal(samples="x"), "displacement", history=history, base=base)


@pytest.mark.slow
def test_a_run_says_what_a_law_across_two_sensors_leaves_out(tmp_path, run_cli):
    z = PAYLOAD - WING
    force = (5e3 + 3j * OMEGA - 2.0 * OMEGA**2) * WING + 0.75 * 4e9 * np.abs(z) ** 2 * z
    path = write(tmp_path, CHANNELS + FORCE_AND_WING, ACROSS, a=(force, WING, PAYLOAD))
    run_cli("run", path, "--out", tmp_path / "out")
    page = (tmp_path / "out" / "two" / "report.html").read_text(encoding="utf-8")
    assert "no one amplitude is that of the law" in page
    assert "The law acts across payload - wing" in page
    notebook = (tmp_path / "out" / "two" / "notebook.ipynb").read_text(encoding="utf-8")
    assert "draw_collapse" not in notebook
    assert '"output_type": "error"' not in notebook
