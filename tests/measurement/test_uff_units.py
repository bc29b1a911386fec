"""Universal files in other units than SI: axis labels, data set 164, and what is reported about them."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from rsgen import ResponseSurface, load_case
from rsgen.common.errors import MeasurementError
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.inspection.listing import list_contents
from tests.case_files import MEASURED, write_small
from tests.inspection.drafts import drafted

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("read_here")]

FREQUENCY = np.linspace(8.0, 12.0, 41)
OMEGA = 2 * np.pi * FREQUENCY
ACCELERANCE = -(OMEGA**2) / (5920 - 1.5 * OMEGA**2 + 1j * OMEGA * 7.5)
# 13 digits are written
PRINTED = 1e-12
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


def function(
    values: Sequence[complex],
    ordinate: str = axis(12),
    over: str = axis(13),
    function: int = 4,
    abscissa: str = axis(18, "Frequency", "Hz"),
    start: float = 8.0,
    step: float = 0.1,
) -> str:
    numbers = np.asarray(values, dtype=complex)
    head = [
        "    -1", "    58", "title", "NONE", "NONE", "NONE", "NONE",
        f"{function:5d}{0:10d}    0         0 NONE               1   3 NONE               1   3",
        f"{6:10d}{len(numbers):10d}{1:10d}{start:13.5E}{step:13.5E}{0:13.5E}",
        abscissa, ordinate, over, axis(0),
    ]  # fmt: skip
    return "\n".join([*head, *(f"{v.real:20.12E}{v.imag:20.12E}" for v in numbers), "    -1"]) + "\n"


def case_of(path: Path, quantity: str = "acceleration", levels: int = 1, **response: str) -> Path:
    """Write a case that reads frequency responses; units are the file's unless ``response`` names one."""
    changes = {
        **MEASURED, "test.file": path.name, "test.frequency": {"column": "*/abscissa"},
        "test.force": {"nominal": True},
        "test.response": {"quantity": quantity, "complex": "*/ordinate", "per_force": True, **response},
        "test.response.phase_sense": "lead",
        "test.level": {"values": [f"{n} N" for n in range(1, levels + 1)]},
    }  # fmt: skip
    return write_small(path.parent, path.stem, changes)


def read(case: Path) -> ResponseSurface:
    return read_measurement(load_case(case).test)


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
    path.write_text(
        units(1 / METRE[length], 1 / NEWTON[force], code) + function(ACCELERANCE / size), encoding="utf-8"
    )
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
    (
        function(ACCELERANCE, axis(12, "Channel 3", "V"), axis(13, "Force", "N")),
        {},
        ["unit-contradicts-title"],
    ),
])  # fmt: skip
def test_a_unit_in_the_case_wins_over_the_file(tmp_path, text, response, said):
    path = tmp_path / "a.uff"
    path.write_text(text, encoding="utf-8")
    surface = read(case_of(path, **response))
    np.testing.assert_allclose(accelerance(surface), ACCELERANCE, rtol=PRINTED)
    assert codes(surface) == said


def test_each_data_set_164_is_for_what_follows_it(tmp_path):
    path = tmp_path / "a.uff"
    parts = [
        function(ACCELERANCE), units(1e3, 1.0, 10), function(ACCELERANCE * 1e3),
        function(2 * ACCELERANCE * 1e3), units(1.0, 1e-3), function(ACCELERANCE * 1e3),
    ]  # fmt: skip
    path.write_text("".join(parts), encoding="utf-8")
    entries = [entry for entry in list_contents(path).entries if entry.path.endswith("ordinate")]
    assert [(entry.unit, entry.unit_source) for entry in entries] == [
        ("m/s^2/N", "SI assumed"),
        ("mm/s^2/N", "data set 164"),
        ("mm/s^2/N", "data set 164"),
        ("m/s^2/kN", "data set 164"),
    ]
    surface = read(case_of(path, levels=4))
    got = accelerance(surface).reshape(4, -1)
    np.testing.assert_allclose(got, np.outer([1, 1, 2, 1], ACCELERANCE), rtol=PRINTED)
    proposal = drafted(path)
    # one unit for all would be wrong
    assert "unit" not in proposal.tables["test.response"]
    assert "mm/s^2/N" in proposal.doubts["test.response.quantity"]


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
    known = read(case_of(path, unit="m/s^2/N"))
    np.testing.assert_allclose(accelerance(known), ACCELERANCE, rtol=PRINTED)
    proposal = drafted(path)
    assert reason in proposal.doubts["test.response.unit"]
