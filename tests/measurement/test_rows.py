"""Rows of data files that are no numbers, and titles: left out, counted and said; what a title says."""

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsgen import ResponseSurface, sentence
from rsgen.common.errors import MeasurementError
from rsgen.data.surface.mode_findings import row_findings
from rsgen.files.column_titles import is_angular, unit_in
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.plan import HERTZ, Layout, LevelRule, MeasuredTest
from rsgen.files.signals import Channel
from rsgen.files.text_columns import read_columns
from rsgen.report.sentences import next_step

pytestmark = pytest.mark.usefixtures("read_here")


def read(path: Path, frequency: int | str = "f", response: tuple[Path, ...] = (), **more: Any):
    signals = Channel(amplitude="F", unit="N"), Channel(amplitude="x", files=response, unit="m")
    more |= {"frequency_unit": "Hz"} if frequency == "f" else {}
    return read_measurement(
        MeasuredTest(path, frequency, *signals, "displacement", phase_known=False, **more)
    )


def rows_found(surface: ResponseSurface) -> dict[str, dict[str, float]]:
    return {
        finding.names["by"]: {name: number.value for name, number in finding.numbers.items()}
        for finding in surface.findings
    }


def text(path: Path, lines: str) -> Path:
    path.write_text(lines, encoding="utf-8")
    return path


@pytest.mark.parametrize("gap", ["NA", "nan", "", "n/a", "-", "overload", "#N/A", "-inf"])
def test_rows_with_gaps_are_left_out_and_counted(tmp_path, gap):
    path = text(tmp_path / "a.csv", f"f,F,x\n1,1,2\n2,1,{gap}\n3,{gap},{gap}\n4,1,2\n")
    surface = read(path)
    assert surface.frequency.tolist() == [1, 4]
    assert rows_found(surface) == {"no number": {"rows": 2, "all": 4}}
    assert surface.findings[0].names == {"file": "a.csv", "first": "line 3", "by": "no number"}


@pytest.mark.slow
def test_gaps_of_binary_files_and_of_another_file_are_left_out_together(tmp_path):
    force, response = tmp_path / "a.npz", tmp_path / "b.npz"
    np.savez(force, f=[1.0, 2.0, np.nan, 4.0], F=[1.0, 1.0, 1.0, 1.0])
    np.savez(response, x=[1.0, np.nan, 1.0, 5.0])
    surface = read(force, response=(response,))
    assert surface.amplitude.tolist() == [1, 5]
    assert rows_found(surface) == {"no number": {"rows": 2, "all": 4}}


def test_utf_16_is_to_be_saved_as_utf_8(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes("f,F,x\r\n1,1,2\r\n2,1,3".encode("utf-16"))
    with pytest.raises(MeasurementError, match=r"a\.csv: line 1: contains a zero byte; .* UTF-8"):
        read_columns(path, Layout(), ["f"])


@pytest.mark.parametrize("title", ["Omega", "w", "omega [1/s]", "angular frequency"])
def test_an_angular_frequency_read_in_hertz_is_doubted(tmp_path, title):
    path = text(tmp_path / "a.csv", f"{title},F,x\n1,1,2\n2,1,3\n")
    for column in (title, 1):
        surface = read(path, column)
        assert [(found.code, found.severity) for found in surface.findings] == [
            ("unit-contradicts-title", "doubt")
        ]
    for unit, first in (("Hz", 1.0), ("rad/s", 1 / (2 * np.pi))):
        surface = read(path, title, frequency_unit=unit)
        assert surface.findings == ()
        assert surface.frequency[0] == pytest.approx(first)


@pytest.mark.parametrize(("title", "unit", "quantity", "doubted"), [
    ("a [g]", "m/s", "velocity", True), ("H (m/s2/N)", "m", "displacement", True),
    ("a [m/s^2]", "m/s^2", "acceleration", False), ("tip (t)", "m", "displacement", False),
])  # fmt: skip
def test_a_quantity_that_the_title_contradicts_is_doubted(tmp_path, title, unit, quantity, doubted):
    """An acceleration in g was read as a velocity without a word, and identified with another law."""
    path = text(tmp_path / "a.csv", f"f_Hz,F_N,{title}\n1,1,2\n2,1,3\n")
    plan = MeasuredTest(
        path, 1, Channel(amplitude="F_N"), Channel(amplitude=title, unit=unit), quantity, phase_known=False
    )
    codes = [finding.code for finding in read_measurement(plan).findings if finding.severity == "doubt"]
    assert codes == ["unit-contradicts-title"] * doubted


def test_what_several_files_contradict_alike_is_said_once(tmp_path):
    """Four files whose two columns were read in another unit were eight lines."""
    paths = [text(tmp_path / f"{n}.csv", f"f_Hz,F_N,x_m\n1,{n},2\n2,{n},3\n") for n in (1, 2, 3, 4)]
    signals = Channel(amplitude="F_N", unit="kN"), Channel(amplitude="x_m", unit="mm")
    surface = read_measurement(MeasuredTest(tuple(paths), 1, *signals, "displacement", phase_known=False))
    said = [sentence(f) for f in surface.findings if f.code == "unit-contradicts-title"]
    assert said == [
        f"1.csv, 2.csv, 3.csv, 4.csv: {column} is read in {unit}, but the file says {title}"
        for column, unit, title in (("F_N", "kN", "N"), ("x_m", "mm", "m"))
    ]


def test_units_of_a_header_hold_where_the_case_says_none(tmp_path):
    path = text(tmp_path / "a.csv", "f_kHz,F_mN,x_mm\n1,2,3\n2,2,4\n")
    signals = Channel(amplitude="F_mN"), Channel(amplitude="x_mm")
    surface = read_measurement(MeasuredTest(path, "f_kHz", *signals, "displacement", phase_known=False))
    assert surface.frequency[0] == 1000
    assert (abs(surface.force[0]), surface.amplitude[0]) == pytest.approx((2e-3, 3e-3))
    assert [found.code for found in surface.findings] == ["unit-of-file"] * 3


@pytest.mark.parametrize(("unit", "row", "read_in", "says"), [
    (None, "kN", "kN", ["N"]), ("N", "kN", "N", ["kN"]), ("kN", "kN", "kN", ["N"]), ("N", "(N)", "N", []),
    ("N", "V", "N", ["V"]),
])  # fmt: skip
def test_another_unit_in_the_row_below_a_title_is_doubted(tmp_path, unit, row, read_in, says):
    """The unit in the row of units was dropped without a word."""
    path = text(tmp_path / "a.csv", f"f,F [N],x\nHz,{row},mm\n1,2,3\n2,2,4\n")
    signals = Channel(amplitude="F [N]", unit=unit), Channel(amplitude="x", unit="mm")
    surface = read_measurement(MeasuredTest(path, "f", *signals, "displacement", phase_known=False))
    found = [f.names for f in surface.findings if f.severity == "doubt"]
    assert [(names["unit"], names["title"]) for names in found] == [(read_in, said) for said in says]


@pytest.mark.parametrize(("title", "row"), [("f [Hz]", "rad/s"), ("f_Hz", "kHz"), ("w (rad/s)", "Hz")])
def test_another_unit_of_the_frequency_in_the_row_below_its_title_is_doubted(tmp_path, title, row):
    """A column of Hz over rad/s kept the title without a word."""
    path = text(tmp_path / "a.csv", f"{title},F,x\n{row},N,mm\n1,2,3\n2,2,4\n")
    signals = Channel(amplitude="F", unit="N"), Channel(amplitude="x", unit="mm")
    surface = read_measurement(MeasuredTest(path, 1, *signals, "displacement", phase_known=False))
    (doubt,) = (f.names for f in surface.findings if f.severity == "doubt")
    assert (doubt["unit"], doubt["title"]) == (row, unit_in(title))
    assert surface.frequency[0] == pytest.approx(HERTZ[row])


def test_an_angle_read_in_another_unit_than_its_title_is_doubted(tmp_path):
    for title, unit in (("phase_deg", "rad"), ("arg(X)/rad", "deg"), ("Phase (°)", "rad"), ("phase", "rad")):
        path = text(tmp_path / "a.csv", f"f_Hz,F_N,x_m,{title}\n1,1,3,0.5\n2,1,4,0.6\n")
        channel = Channel(amplitude="x_m", phase=4, phase_unit=unit)
        surface = read_measurement(MeasuredTest(path, 1, Channel(amplitude="F_N"), channel, "displacement"))
        doubts = [found.code for found in surface.findings if found.severity == "doubt"]
        assert doubts == ["unit-contradicts-title"] * (title != "phase"), title
        assert not [f for f in surface.findings if f.code == "not-recorded"]


@pytest.mark.parametrize(("phase", "doubted"), [(-170.0, True), (359.0, True), (-9.0, False)])
def test_degrees_read_as_radians_are_doubted(tmp_path, phase, doubted):
    """No title said it, and the law was rejected without a cause; a phase may be unwrapped, too."""
    paths = [text(tmp_path / f"{n}.csv", f"f_Hz,F_N,x_m,p\n1,1,3,-1\n2,1,4,{phase + n}\n") for n in (0, 1)]
    channel = Channel(amplitude="x_m", phase="p", phase_unit="rad")
    surface = read_measurement(
        MeasuredTest(tuple(paths), 1, Channel(amplitude="F_N"), channel, "displacement")
    )
    said = [f for f in surface.findings if f.code == "unit-contradicts-title"]
    assert len(said) == doubted
    assert all('phase_unit = "deg"' in next_step(one) for one in said)


def test_units_that_nobody_wrote_are_named_once(tmp_path):
    """Amplitudes from peak to peak, or a frequency in rad/s, scale the values: no test shows it."""
    paths = tuple(text(tmp_path / name, "f,F,x_mm\n1,2,3\n2,2,4\n") for name in ("a.csv", "b.csv"))
    signals, level = (Channel(amplitude="F"), Channel(amplitude="x_mm")), LevelRule(values=(1, 2))
    test = MeasuredTest(paths, "f", *signals, "displacement", phase_known=False, level=level)
    force, frequency = (one for one in read_measurement(test).findings if "default" in one.names)
    assert "as F in N: all values scale with them" in sentence(force)
    # a unit that nobody wrote is as doubtful as one that a draft asks for; frequencies mostly are in Hz
    assert (force.severity, frequency.severity, frequency.names["default"]) == ("doubt", "info", "f in Hz")
    written = replace(test, force=Channel(amplitude="F", unit="N"), frequency_unit="Hz")
    assert not [one for one in read_measurement(written).findings if "default" in one.names]


def test_a_level_column_that_was_forgotten_is_asked_for_with_the_columns_there_are(tmp_path):
    """One level was read, and the law did not fit."""
    rows = "".join(f"{f},{level},{level / abs(10 - f)}\n" for level in (1, 2, 3) for f in (8, 9, 11, 12))
    path = text(tmp_path / "a.csv", f"f_Hz,level_N,x_m\n{rows}")
    signals, one = (Channel(nominal=True), Channel(amplitude="x_m")), LevelRule(value=1.0)
    test = MeasuredTest(path, "f_Hz", *signals, "displacement", phase_known=False, level=one)
    (found,) = (f for f in read_measurement(test).findings if f.code == "levels-disagree")
    assert found.names == {"rows": "readings", "columns": "f_Hz, level_N, x_m"}
    assert not row_findings(read_measurement(test))
    told = read_measurement(replace(test, level=LevelRule(column="level_N")))
    assert "levels-disagree" not in [f.code for f in told.findings]


def test_a_column_of_levels_that_is_the_force_is_no_recorded_force(tmp_path):
    path = text(tmp_path / "a.csv", "f_Hz,F_N,x_m\n1,2,3\n2,2,4\n1,5,7\n2,5,9\n")
    signals = Channel(amplitude="F_N"), Channel(amplitude="x_m")
    test = MeasuredTest(path, 1, *signals, "displacement", level=LevelRule(column="F_N"), phase_known=False)
    (found,) = (f for f in read_measurement(test).findings if f.code == "not-recorded")
    assert found.names == {"signal": "force", "by": "equality"}


@pytest.mark.parametrize(("head", "factor", "severity"), [
    ("f_Hz,F_V,x_m", 1, "doubt"), ("f_Hz,F (mV),x_m", 1, "doubt"), ("f,F,x\nHz,V,mm", 1, "doubt"),
    ("f_Hz,F_V,x_m", 10, "warning"), ("f,F,x\nHz,N,mm", 1, "info"), ("f,F,x\n-,N,(mm)", 1, "info"),
])  # fmt: skip
def test_volts_without_a_sensitivity_are_doubted(tmp_path, head, factor, severity):
    path = text(tmp_path / "a.csv", f"{head}\n1,1,2\n2,1,3\n")
    signals = Channel(amplitude=2, factor=factor), Channel(amplitude=3)
    surface = read_measurement(MeasuredTest(path, 1, *signals, "displacement", phase_known=False))
    assert surface.amplitude[0] == pytest.approx(2e-3 if "mm" in head else 2)
    assert {f.severity for f in surface.findings} - {"info"} == {severity} - {"info"}


@pytest.mark.parametrize(("table", "keys", "unit"), [
    ("frequency", {"frequency_unit": "rad/s"}, "rad/s"), ("frequency", {"frequency_unit": "kHz"}, "kHz"),
    ("force", {"unit": "mN"}, "mN"), ("response", {"unit": "m"}, "m"),
])  # fmt: skip
def test_a_case_that_contradicts_a_title_is_doubted(tmp_path, table, keys, unit):
    path = text(tmp_path / "a.csv", "f_Hz,F_N,x_mm\n1,2,3\n2,2,4\n")
    force, response = ({**keys} if table == name else {} for name in ("force", "response"))
    more = keys if table == "frequency" else {}
    signals = Channel(amplitude="F_N", **force), Channel(amplitude="x_mm", **response)
    surface = read_measurement(MeasuredTest(path, 1, *signals, "displacement", phase_known=False, **more))
    doubts = [found for found in surface.findings if found.severity == "doubt"]
    assert [found.code for found in doubts] == ["unit-contradicts-title"]
    assert doubts[0].names["unit"] == unit


def test_a_case_that_says_what_the_title_says_is_not_doubted(tmp_path):
    path = text(tmp_path / "a.csv", "f_Hz,drive_V,a_g\n1,2,3\n2,2,4\n")
    force, response = Channel(amplitude=2, unit="V", factor="3 N/V"), Channel(amplitude=3, unit="g")
    test = MeasuredTest(path, 1, force, response, "acceleration", phase_known=False, frequency_unit="Hz")
    assert read_measurement(test).findings == ()
    # the load cell's volts are no newtons without a factor
    for read_in, said in (("N", ["unit-contradicts-title"]), ("V", [])):
        test = replace(test, force=Channel(amplitude=2, unit=read_in), calibrated=read_in == "N")
        assert [one.code for one in read_measurement(test).findings if one.severity == "doubt"] == said


@pytest.mark.parametrize(("title", "unit"), [
    ("Kraft [N]", "N"), ("Kraft [ N ] ", "N"), ("Beschleunigung (m/s^2)", "m/s^2"),
    ("Kraft in N (rms)", "N"), ("Kraft [ ]", ""), ("force_mN", "mN"),
    ("Accelerance [(m/s^2)/N]", "(m/s^2)/N"), ("Accelerance ((m/s²)/N)", "(m/s²)/N"),
    ("Accelerance (m/s^2)/N", "(m/s^2)/N"), ("FRF (m/(s^2*N))", "m/(s^2*N)"), ("F/N", "N"),
    ("v_mm/s", "mm/s"), ("v_mm_s", "mm/s"), ("acc_m_s2", "m/s2"), ("acc_ms2", "m/s2"), ("t_ms", "ms"),
    ("a/m/s^2", "m/s^2"), ("x/mm", "mm"),
    ("a / (m/s²)", "m/s²"),
    # a quotient, and parts of a number
    ("x/F", ""), ("Re(H)", ""), ("Im(x/F)", ""), ("Real (mm)", "mm"), ("Re(H) [m/N]", "m/N"),
    ("force", ""),
])  # fmt: skip
def test_a_unit_in_a_title(title, unit):
    assert unit_in(title) == unit


@pytest.mark.parametrize(("title", "angular"), [
    ("freq [rad/s]", True), ("rad per sec", True), ("rads", True), ("rad / s", True), ("radius", False),
])  # fmt: skip
def test_an_angular_frequency(title, angular):
    assert is_angular(title) == angular


@pytest.mark.parametrize(
    "title", ["(" + " " * 30_000 + "x", "( x" + " " * 30_000 + "y", "(" * 30_000, "rad" + " " * 30_000 + "x"]
)
def test_a_long_title_takes_no_time(title):
    started = time.process_time()
    assert (unit_in(title), is_angular(title)) == ("", False)
    # a pattern that tries all ways takes minutes
    assert time.process_time() - started < 2.0
