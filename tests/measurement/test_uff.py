"""Universal files: axis labels and data sets 151, 164 and 1858 about functions, also by pyuff."""

import inspect
import re

import numpy as np
import pytest

from rsgen import ResponseSurface, read
from rsgen.common.errors import MeasurementError
from rsgen.files.inspection.listing import list_contents
from tests.case_files import MEASURED, write_small
from tests.inspection.drafts import drafted
from tests.measurement.universal_files import pyuff, response_set, write_sets

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("read_here")]

FREQUENCY = np.linspace(8.0, 12.0, 41)
OMEGA = 2 * np.pi * FREQUENCY
MOBILITY = 1j * OMEGA / (5920 - 1.5 * OMEGA**2 + 7.5j * OMEGA)
ACCELERANCE = 1j * OMEGA * MOBILITY
# 13 digits are written, by pyuff 11 of an ordinate
PRINTED, PYUFF_DIGITS = 1e-12, 1e-11
# one of each in SI, exactly: international foot and inch, avoirdupois pound, standard gravity
METRE = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "ft": 0.3048, "inch": 0.0254}
NEWTON = {
    "N": 1.0, "mN": 1e-3, "cN": 1e-2, "kN": 1e3, "lbf": 0.45359237 * 9.80665, "kgf": 9.80665,
    "poundal": 0.45359237 * 0.3048,
}  # fmt: skip


def units(length: float, force: float, code: int = 9, name: str = "USER_DEFINED") -> str:
    """Write data set 164: how many file units are in 1 m and in 1 N."""
    factors = "".join(f"{factor:25.17E}".replace("E", "D") for factor in (length, force, 1.0))
    return f"    -1\n   164\n{code:10d}{name:<20}{2:10d}\n{factors}\n{273.15:25.17E}\n    -1\n"


def axis(kind: int, label: str = "NONE", unit: str = "NONE") -> str:
    return f"{kind:10d}    0    0    0 {label:<20} {unit:<20}"


def function(values, ordinate: str = axis(12), over: str = axis(13)) -> str:
    head = [
        "    -1", "    58", "title", "NONE", "NONE", "NONE", "NONE",
        f"{4:5d}{0:10d}    0         0 NONE               1   3 NONE               1   3",
        f"{6:10d}{len(values):10d}{1:10d}{8.0:13.5E}{0.1:13.5E}{0:13.5E}",
        axis(18, "Frequency", "Hz"), ordinate, over, axis(0),
    ]  # fmt: skip
    return "\n".join([*head, *(f"{v.real:20.12E}{v.imag:20.12E}" for v in values), "    -1"]) + "\n"


def case_of(path, quantity: str = "acceleration", levels: int = 1, **response: str):
    """Write a case that reads frequency responses; units are the file's unless ``response`` names one."""
    changes = {
        **MEASURED, "test.file": path.name, "test.frequency": {"column": "*/abscissa"},
        "test.force": {"nominal": True},
        "test.response": {"quantity": quantity, "complex": "*/ordinate", "per_force": True, **response},
        "test.response.phase_sense": "lead",
        "test.level": {"values": [f"{n} N" for n in range(1, levels + 1)]},
    }  # fmt: skip
    return write_small(path.parent, path.stem, changes)


def accelerance(surface: ResponseSurface) -> np.ndarray:
    return np.asarray(-(surface.omega**2) * surface.harmonics[:, 1] / surface.force)


def codes(surface: ResponseSurface) -> list[str]:
    return [finding.code for finding in surface.findings if finding.code.startswith("unit")]


@pytest.mark.parametrize(("code", "length", "force"), [
    (1, "m", "N"), (2, "ft", "lbf"), (3, "m", "kgf"), (4, "ft", "poundal"), (5, "mm", "mN"),
    (6, "cm", "cN"), (7, "inch", "lbf"), (8, "mm", "kgf"), (10, "mm", "N"), (9, "mm", "kN"),
])  # fmt: skip
def test_units_of_data_set_164(tmp_path, code, length, force):
    """The case names no unit: whatever the units of the file, the surface is the one in SI."""
    path = tmp_path / "a.uff"
    size = METRE[length] / NEWTON[force]
    path.write_text(units(1 / METRE[length], 1 / NEWTON[force], code) + function(ACCELERANCE / size))
    surface = read(case_of(path))
    np.testing.assert_allclose(accelerance(surface), ACCELERANCE, rtol=PRINTED)
    assert codes(surface) == ([] if size == pytest.approx(1) else ["unit-of-file"])
    proposal = drafted(path)
    assert proposal.tables["test.response"]["unit"] == f"{length}/s^2/{force}"
    assert proposal.doubts["test.response.unit"] == "data set 164"


@pytest.mark.parametrize(("factor", "labels", "unit", "source"), [
    # labels of axes win over data set 164
    (1e3 / 9.80665, (axis(12, "Acceleration", "g"), axis(13, "Force", "kN")), "g/kN", "axis label"),
    # the label of one axis alone, and one that holds the force already
    (1e-3, (axis(12, "Acceleration", "m/s^2"),), "m/s^2/mN", "axis label, force: data set 164"),
    (1.0, (axis(12, "FRF", "m/s^2/N"),), "m/s^2/N", "axis label"),
])  # fmt: skip
def test_labels_of_axes(tmp_path, factor, labels, unit, source):
    path = tmp_path / "a.uff"
    path.write_text(units(1e3, 1e3, 5) + function(factor * ACCELERANCE, *labels), encoding="utf-8")
    np.testing.assert_allclose(accelerance(read(case_of(path))), ACCELERANCE, rtol=PRINTED)
    (entry,) = (entry for entry in list_contents(path).entries if entry.path == "1/ordinate")
    assert (entry.unit, entry.unit_source) == (unit, source)


@pytest.mark.parametrize(("text", "response", "said"), [
    (units(1e3, 1e3, 5) + function(ACCELERANCE), {"unit": "m/s^2/N"}, []),
    # a unit that is none of the quantity is not taken
    (function(ACCELERANCE, axis(12, "Ch 3", "V"), axis(13, "Force", "N")), {}, ["unit-contradicts-title"]),
])  # fmt: skip
def test_a_unit_in_the_case_wins_over_the_file(tmp_path, text, response, said):
    path = tmp_path / "a.uff"
    path.write_text(text, encoding="utf-8")
    surface = read(case_of(path, **response))
    np.testing.assert_allclose(accelerance(surface), ACCELERANCE, rtol=PRINTED)
    assert codes(surface) == said


def test_of_a_response_that_was_held_the_force_is_what_the_level_takes(tmp_path):
    path = tmp_path / "a.uff"
    path.write_text(function(ACCELERANCE), encoding="utf-8")
    case = case_of(path, unit="m/s^2/N")
    held = {'"1 N"': '"2 mm"', '"measured"': '"measured", control = "response"'}
    for old, new in held.items():
        case.write_text(case.read_text().replace(old, new))
    surface = read(case)
    np.testing.assert_allclose(accelerance(surface), ACCELERANCE, rtol=PRINTED)
    np.testing.assert_allclose(surface.amplitude, 2e-3)
    assert surface.levels.tolist() == [2e-3]
    assert [finding.names for finding in surface.findings] == [{"signal": "force", "by": "held"}]


def test_each_data_set_164_is_for_what_follows_it(tmp_path):
    path, scaled = tmp_path / "a.uff", function(1e3 * ACCELERANCE)
    path.write_text(function(ACCELERANCE) + units(1e3, 1.0, 10) + scaled + units(1.0, 1e-3) + scaled)
    entries = [entry for entry in list_contents(path).entries if entry.path.endswith("ordinate")]
    assert [entry.unit_source for entry in entries] == ["SI assumed", "data set 164", "data set 164"]
    got = accelerance(read(case_of(path, levels=3)))
    np.testing.assert_allclose(got, np.tile(ACCELERANCE, 3), rtol=PRINTED)
    # one unit for all would be wrong
    assert "unit" not in drafted(path).tables["test.response"]


@pytest.mark.parametrize(("text", "reason"), [
    # factors the wrong way round, and factors of a template under another code
    (units(1e-3, 1e-3, 5), "says mm and mN, but its factors 0.001 and 0.001 differ"),
    (units(3.28083989501312334, 0.22480894309971048, 1), "says m and N, but its factors 3.28084"),
    (units(7.0, 1.0), "factors 7 and 1 are of no known units"),
])  # fmt: skip
def test_a_data_set_164_that_contradicts_itself_decides_nothing(tmp_path, text, reason):
    path = tmp_path / "a.uff"
    path.write_text(text + function(ACCELERANCE), encoding="utf-8")
    said = rf"^{re.escape(str(path))}: the unit of '1/ordinate' is not known: .*{reason}"
    with pytest.raises(MeasurementError, match=said):
        read(case_of(path))
    np.testing.assert_allclose(accelerance(read(case_of(path, unit="m/s^2/N"))), ACCELERANCE, rtol=PRINTED)
    assert reason in drafted(path).doubts["test.response.unit"]


def about(**said: int) -> dict:
    """Data set 1858 of pyuff, with nothing known but what is said."""
    whole = inspect.signature(pyuff.prepare_1858).parameters
    numbers = {name: 0.0 if re.search("value|num_of|damping", name) else 0 for name in whole}
    directions = {"response_direction": "+Z", "reference_direction": "+Z", "return_full_dict": False}
    return pyuff.prepare_1858(**numbers | directions | said)


def mobility(values=MOBILITY, ordinate: int = 11, over: int = 13) -> dict:
    """A function without labels of units."""
    return response_set(
        FREQUENCY, values, ordinate_spec_data_type=ordinate, orddenom_spec_data_type=over, id1="joint"
    )


def test_a_file_of_pyuff_in_inches_and_pounds(tmp_path, run_cli):
    header = pyuff.prepare_151(
        model_name="wing", description="left", db_app="program", program="writer", date_db_created="01-Jan-20"
    )
    inches = {
        "type": 164, "units_code": 7, "units_description": "inch, pound", "temp_mode": 1, "temp": 1.0,
        "length": 1 / 0.0254, "force": 1 / NEWTON["lbf"], "temp_offset": 459.67,
    }  # fmt: skip
    in_inches = mobility(MOBILITY / 0.0254 * NEWTON["lbf"])
    path = write_sets(tmp_path / "a.uff", header, inches, about(window_type=6), in_inches)
    case, shown = tmp_path / "a.toml", run_cli("inspect", path).out
    assert run_cli("init", "--from", path, case).code == 0
    text = case.read_text(encoding="utf-8").replace("? N", "2 N")
    assert re.search(r'quantity +=.*"velocity" +# mobility, inch/s/lbf', text)
    assert "an exponential window, which adds damping" in text
    for said in ("'wing'", "'writer'", "01-Jan-20", "mobility, impact and exponential window adds damping"):
        assert said in shown
    case.write_text(text, encoding="utf-8")
    surface = read(case)
    read_back = pyuff.UFF(str(path)).read_sets(3)
    np.testing.assert_allclose(read_back["data"] * 0.0254 / NEWTON["lbf"], MOBILITY, rtol=PYUFF_DIGITS)
    found = 1j * surface.omega * surface.harmonics[:, 1] / surface.force
    np.testing.assert_allclose(found, MOBILITY, rtol=PYUFF_DIGITS)
    np.testing.assert_allclose(surface.frequency, FREQUENCY, rtol=1e-12)


@pytest.mark.parametrize(("said", "scale", "factor"), [
    (3, {"scale": "rms"}, 2**0.5), (1, {"factor": 2.0}, 2.0), (2, {}, 1.0),
])  # fmt: skip
def test_amplitudes_of_spectra_are_what_the_file_says(tmp_path, run_cli, said, scale, factor):
    """Force and velocity as spectra: the proposal brings them to peaks; a case that does not is refused."""
    force, amplitudes = mobility(np.full(41, 2.0 + 1j), 9, 0), about(amplitude_units=said)
    path = write_sets(tmp_path / "a.uff", amplitudes, force, amplitudes, mobility(over=0))
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
    surface = read(case)
    np.testing.assert_allclose(np.abs(surface.force), abs(2 + 1j) * factor, rtol=PYUFF_DIGITS)
    np.testing.assert_allclose(surface.omega * surface.amplitude, abs(MOBILITY) * factor, rtol=PYUFF_DIGITS)
    text = case.read_text(encoding="utf-8")
    without = re.sub(r"(?m)^(scale|factor) .*\n", "", text)
    case.write_text(without if scale else text.replace("[test.force]", "[test.force]\nscale = 'rms'"))
    with pytest.raises(MeasurementError, match=r"holds .*, as the file says; write (scale|factor) = "):
        read(case)


@pytest.mark.parametrize(("said", "axes", "reason"), [
    ({"octave_format": 3}, (11, 13), "is in bands of octaves or weighted"),
    ({"weighting_type": 1}, (11, 13), "is in bands of octaves or weighted"),
    ({"ordinate_denominator_data_type_qualifier": 3}, (11, 13), "is of a rotation or a moment"),
    ({}, (13, 12), r"is a force over a motion \(apparent mass\); receptance, mobility or accelerance"),
])  # fmt: skip
def test_functions_that_are_no_response(tmp_path, said, axes, reason):
    """The second of two functions is none, whichever side its qualifiers stand on."""
    good, bad = mobility(), mobility(MOBILITY, *axes)
    for order in ([about(), good, about(**said), bad], [good, about(), bad, about(**said)]):
        contents = list_contents(write_sets(tmp_path / "a.uff", *order))
        entries = {entry.path: entry for entry in contents.entries}
        assert not entries["1/ordinate"].fault
        assert re.match(reason, entries["2/ordinate"].fault)


def test_a_data_set_1858_that_is_cut_short(tmp_path):
    path = write_sets(tmp_path / "a.uff", about(), mobility())
    lines = path.read_text(encoding="utf-8").split("\n")
    path.write_text("\n".join([*lines[:3], *lines[8:]]), encoding="utf-8")
    with pytest.raises(MeasurementError, match=r"line \d: two lines of whole numbers"):
        list_contents(path)
