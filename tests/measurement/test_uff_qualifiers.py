"""Data sets 151, 164 and 1858 about functions of universal files, written and read by pyuff."""

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsgen.cases.loading import load_case
from rsgen.common.errors import MeasurementError
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.inspection.listing import list_contents
from tests.inspection.drafts import drafted

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("read_here")]

pyuff = pytest.importorskip("pyuff", reason="no pyuff here: install rsgen[test]")

FREQUENCY = np.linspace(8.0, 12.0, 41)
OMEGA = 2 * np.pi * FREQUENCY
MOBILITY = 1j * OMEGA / (5920 - 1.5 * OMEGA**2 + 7.5j * OMEGA)
POUND = 0.45359237 * 9.80665
# pyuff writes 11 digits of an ordinate
PRINTED = 1e-11


def function(ordinate: int = 11, over: int = 13, values: Any = None) -> dict[str, Any]:
    """A function of pyuff: in inches a second and pounds, without labels of units."""
    found: dict[str, Any] = pyuff.prepare_58(
        func_type=4, rsp_node=2, rsp_dir=3, ref_node=1, ref_dir=3,
        data=MOBILITY if values is None else values, x=FREQUENCY, binary=0,
        id1="joint", rsp_ent_name="BEAM", ref_ent_name="BEAM", abscissa_spacing=1,
        abscissa_min=8.0, abscissa_inc=0.1, num_pts=41, ord_data_type=6, ordinate_spec_data_type=ordinate,
        orddenom_spec_data_type=over, abscissa_spec_data_type=18, z_axis_value=0.0,
    )  # fmt: skip
    return found


def about(**said: int) -> dict[str, Any]:
    """Data set 1858 of pyuff, with nothing known but what is said."""
    whole = (
        "record_num", "octave_format", "measurement_run", "weighting_type", "window_type", "amplitude_units",
        "normalization_method", "abscissa_data_type_qualifier", "ordinate_numerator_data_type_qualifier",
        "ordinate_denominator_data_type_qualifier", "z_axis_data_type_qualifier", "sampling_type",
    )  # fmt: skip
    real = (
        "z_rpm_value", "z_time_value", "z_order_value", "user_value_1", "user_value_2", "user_value_3",
        "user_value_4", "num_of_samples", "exponential_window_damping_factor",
    )  # fmt: skip
    direction = {"response_direction": "+Z", "reference_direction": "+Z"}
    numbers = dict.fromkeys(whole, 0) | dict.fromkeys(real, 0.0) | said
    found: dict[str, Any] = pyuff.prepare_1858(**numbers, **direction)
    return found


INCHES = {
    "type": 164, "units_code": 7, "units_description": "inch, pound", "temp_mode": 1, "length": 1 / 0.0254,
    "force": 1 / POUND, "temp": 1.0, "temp_offset": 459.67,
}  # fmt: skip


def write(path: Path, *sets: dict[str, Any]) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pyuff.UFF(str(path)).write_sets(list(sets), "overwrite")
    return path


def test_a_file_of_pyuff_in_inches_and_pounds(tmp_path, run_cli):
    """What pyuff wrote is read in SI; inspect says what it is in the words of ISO 7626."""
    header = pyuff.prepare_151(
        model_name="wing", description="left", db_app="program", program="writer", date_db_created="01-Jan-20"
    )
    in_inches = function(values=MOBILITY / 0.0254 * POUND)
    path = write(tmp_path / "a.uff", header, INCHES, about(window_type=6), in_inches)
    case = tmp_path / "a.toml"
    shown = run_cli("inspect", path).out
    assert run_cli("init", "--from", path, case).code == 0
    text = case.read_text(encoding="utf-8").replace("? N", "2 N")
    assert re.search(r'quantity +=.*"velocity" +# mobility, inch/s/lbf', text)
    assert "an exponential window, which adds damping" in text
    for said in ("'wing'", "'writer'", "01-Jan-20", "mobility, impact and exponential window adds damping"):
        assert said in shown
    case.write_text(text, encoding="utf-8")
    surface = read_measurement(load_case(case).test)
    read_back = pyuff.UFF(str(path)).read_sets(3)
    np.testing.assert_allclose(read_back["data"] * 0.0254 / POUND, MOBILITY, rtol=PRINTED)
    found = 1j * surface.omega * surface.harmonics[:, 1] / surface.force
    np.testing.assert_allclose(found, MOBILITY, rtol=PRINTED)
    np.testing.assert_allclose(surface.frequency, FREQUENCY, rtol=1e-12)


@pytest.mark.parametrize(
    ("said", "scale", "factor"), [(3, {"scale": "rms"}, 2**0.5), (1, {"factor": 2.0}, 2.0), (2, {}, 1.0)]
)
def test_amplitudes_of_spectra_are_what_the_file_says(tmp_path, run_cli, said, scale, factor):
    """Force and velocity as spectra: the proposal brings them to peaks; a case that does not is refused."""
    force = function(9, 0, np.full(41, 2.0 + 1j))
    amplitudes = about(amplitude_units=said)
    path = write(tmp_path / "a.uff", amplitudes, force, amplitudes, function(11, 0))
    # pyuff reads spectra and writes none: frequency responses become spectra
    text, count = re.subn(r"(?m)^    4(?=.* BEAM)", "   12", path.read_text(encoding="utf-8"))
    assert count == 2
    path.write_text(text, encoding="utf-8")
    proposal = drafted(path)
    for table in ("test.force", "test.response"):
        found = {key: v for key, v in proposal.tables[table].items() if key in ("scale", "factor")}
        assert found == scale
    case = tmp_path / "a.toml"
    assert run_cli("init", "--from", path, case).code == 0
    surface = read_measurement(load_case(case).test)
    np.testing.assert_allclose(np.abs(surface.force), abs(2 + 1j) * factor, rtol=PRINTED)
    np.testing.assert_allclose(surface.omega * surface.amplitude, np.abs(MOBILITY) * factor, rtol=PRINTED)
    text = case.read_text(encoding="utf-8")
    without = re.sub(r"(?m)^(scale|factor) .*\n", "", text)
    wrong = without if scale else text.replace("[test.force]", "[test.force]\nscale = 'rms'")
    case.write_text(wrong, encoding="utf-8")
    test = load_case(case).test
    with pytest.raises(MeasurementError, match=r"holds .*, as the file says; write (scale|factor) = "):
        read_measurement(test)


@pytest.mark.parametrize(("said", "axes", "reason"), [
    ({"octave_format": 3}, (11, 13), "is in bands of 1/3 octave"),
    ({"weighting_type": 1}, (11, 13), r"has a frequency weighting \(A, data set 1858\)"),
    ({"ordinate_numerator_data_type_qualifier": 1}, (11, 13), "is of a rotation or a moment"),
    ({"ordinate_denominator_data_type_qualifier": 3}, (11, 13), "is of a rotation or a moment"),
    ({}, (13, 12), r"is a force over a motion \(apparent mass\); receptance, mobility or accelerance"),
])  # fmt: skip
def test_functions_that_are_no_response(tmp_path, said, axes, reason):
    """The second of two functions is none, whichever side its qualifiers stand on."""
    good, bad = function(), function(*axes)
    for order in ([about(), good, about(**said), bad], [good, about(), bad, about(**said)]):
        entries = {entry.path: entry for entry in list_contents(write(tmp_path / "a.uff", *order)).entries}
        assert not entries["1/ordinate"].fault
        assert re.match(reason, entries["2/ordinate"].fault)


def test_a_data_set_1858_that_is_cut_short(tmp_path):
    path = write(tmp_path / "a.uff", about(), function())
    lines = path.read_text(encoding="utf-8").split("\n")
    path.write_text("\n".join([*lines[:3], *lines[8:]]), encoding="utf-8")
    with pytest.raises(MeasurementError, match=r"line \d: two lines of whole numbers"):
        list_contents(path)
