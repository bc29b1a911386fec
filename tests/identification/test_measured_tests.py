"""The [test] table of a measured case: units become factors, the data file stays inside its folder."""

from pathlib import Path

import numpy as np
import pytest

from rsgen.cases import load_case
from rsgen.common.errors import CaseError
from rsgen.files import MeasuredTest

MEASURED = """\
schema = 1
name = "measured"
title = "Measured"

[[element]]
name = "spring"
force = "k*x + c*v"

[test]
kind = "measured"
file = "{file}"

[test.frequency]
column = 1
unit = "{unit}"

[test.force]
amplitude = 2
{force}

[test.response]
quantity = "{quantity}"
real = 3
imaginary = 4
phase_sense = "lead"
{response}
"""


def measured(tmp_path: Path, **keys: str) -> MeasuredTest:
    known = {"file": "d.csv", "unit": "Hz", "force": "", "quantity": "displacement", "response": "", **keys}
    path = tmp_path / "case.toml"
    path.write_text(MEASURED.format(**known), encoding="utf-8")
    test = load_case(path).test
    assert isinstance(test, MeasuredTest)
    return test


@pytest.mark.parametrize(
    ("quantity", "response", "factor"),
    [
        ("displacement", "", 1.0),
        ("displacement", 'unit = "mm"', 1e-3),
        ("displacement", 'unit = "um"\nscale = "rms"', 1e-6 * 2**0.5),
        ("velocity", 'unit = "in/s"', 0.0254),
        ("acceleration", 'unit = "g"', 9.80665),
        ("acceleration", 'unit = "in/s^2"\nfactor = -2.0', -2 * 0.0254),
        # a laser vibrometer: volts in the file, 5 mm/s for each
        ("velocity", 'unit = "V"\nfactor = "5 mm/s/V"', 5e-3),
        ("velocity", 'unit = "mV"\nfactor = "5 mm/s/V"', 5e-6),
    ],
)
def test_units_of_a_response(tmp_path, quantity, response, factor):
    test = measured(tmp_path, quantity=quantity, response=response)
    assert test.factor("response") == pytest.approx(factor, rel=1e-14)


def test_without_a_scale_any_unit_will_do(tmp_path):
    with pytest.raises(CaseError, match=r"test\.force"):
        measured(tmp_path, force='unit = "V"')
    path = tmp_path / "case.toml"
    path.write_text(path.read_text() + "\n[identify]\ncalibrated = false\n")
    case = load_case(path)
    assert isinstance(case.test, MeasuredTest)
    assert case.test.force is not None
    assert case.test.factor("force") == 1.0
    assert not case.model.observation.calibrated


def test_frequency_in_radians_is_not_hertz(tmp_path):
    assert measured(tmp_path, unit="rad/s").frequency_factor == pytest.approx(1 / (2 * np.pi))
    assert measured(tmp_path, unit="rpm").frequency_factor == pytest.approx(1 / 60)


def test_data_folders(tmp_path, monkeypatch):
    monkeypatch.delenv("RSGEN_DATA", raising=False)
    elsewhere = tmp_path / "laboratory"
    elsewhere.mkdir()
    assert measured(tmp_path).file == tmp_path / "d.csv"
    monkeypatch.setenv("RSGEN_DATA", str(elsewhere))
    (tmp_path / "d.csv").write_text("")
    assert measured(tmp_path).file == tmp_path / "d.csv"
    (elsewhere / "d.csv").write_text("")
    assert measured(tmp_path).file == elsewhere / "d.csv"
    assert load_case(tmp_path / "case.toml", data=tmp_path).test.file == tmp_path / "d.csv"


def test_a_link_out_of_the_data_folder_is_refused(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.csv").write_text("")
    (inside / "d.csv").symlink_to(tmp_path / "secret.csv")
    with pytest.raises(CaseError, match=r"test\.file: .* is a link out of its folder"):
        measured(inside)
