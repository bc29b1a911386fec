"""Rows of data files that are no numbers, and titles: left out, counted and said; what a title says."""

import time
from dataclasses import replace

import numpy as np
import pytest

from rsgen import sentence
from rsgen.data.surface.mode_findings import row_findings
from rsgen.files.column_titles import is_angular, unit_in
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.plan import HERTZ, Layout, LevelRule
from rsgen.files.signals import Channel
from rsgen.report.sentences import next_step
from tests.measurement.tables import doubts, planned, read_planned
from tests.surfaces import severities

pytestmark = pytest.mark.usefixtures("read_here")

NEWTON, METRE = Channel(amplitude="F", unit="N"), Channel(amplitude="x", unit="m")


def table(folder, head: str, rows: str = "1,2,3\n2,2,4\n", name: str = "a.csv"):
    path = folder / name
    path.write_text(f"{head}\n{rows}", encoding="utf-8")
    return path


@pytest.mark.parametrize("gap", ["NA", "", "-", "overload", "#N/A", "-inf"])
def test_rows_with_gaps_are_left_out_and_counted(tmp_path, gap):
    path = table(tmp_path, "f,F,x", f"1,1,2\n2,1,{gap}\n3,{gap},{gap}\n4,1,2\n")
    surface = read_planned(path, "f", NEWTON, METRE, frequency_unit="Hz")
    assert surface.frequency.tolist() == [1, 4]
    (left_out,) = surface.findings
    assert (left_out["rows"], left_out["all"]) == (2, 4)
    assert left_out.names == {"file": "a.csv", "first": "line 3", "by": "no number"}


@pytest.mark.slow
def test_gaps_of_binary_files_and_of_another_file_are_left_out_together(tmp_path):
    force, response = tmp_path / "a.npz", tmp_path / "b.npz"
    np.savez(force, f=[1.0, 2.0, np.nan, 4.0], F=[1.0, 1.0, 1.0, 1.0])
    np.savez(response, x=[1.0, np.nan, 1.0, 5.0])
    surface = read_planned(force, "f", NEWTON, replace(METRE, files=(response,)), frequency_unit="Hz")
    assert surface.amplitude.tolist() == [1, 5]
    assert [(one["rows"], one["all"], one.names["by"]) for one in surface.findings] == [(2, 4, "no number")]


@pytest.mark.parametrize("title", ["Omega", "w", "omega [1/s]", "angular frequency", "rad per sec", "rads"])
def test_an_angular_frequency_read_in_hertz_is_doubted(tmp_path, title):
    path = table(tmp_path, f"{title},F,x")
    for column in (title, 1):
        surface = read_planned(path, column, NEWTON, METRE)
        assert severities(surface) == {"unit-contradicts-title": "doubt"}
    for unit, first in (("Hz", 1.0), ("rad/s", 1 / (2 * np.pi))):
        surface = read_planned(path, title, NEWTON, METRE, frequency_unit=unit)
        assert surface.findings == ()
        assert surface.frequency[0] == pytest.approx(first)


@pytest.mark.parametrize(("skip", "sign"), [(0, ""), (1, ""), (1, "# ")])
def test_names_and_units_that_skip_passes_over_count_all_the_same(tmp_path, skip, sign):
    path = table(tmp_path, f"{sign}f_Hz,F_N,x_mm")
    shape = {"layout": Layout(skip=skip)}
    in_metre = read_planned(path, 1, "F_N", Channel(amplitude=3, unit="m"), **shape)
    assert doubts(in_metre) == ["unit-contradicts-title"]
    assert read_planned(path, "f_Hz", "F_N", 3, **shape).amplitude[0] == pytest.approx(3e-3)


@pytest.mark.parametrize(("title", "scale", "doubted"), [
    ("Weg_eff/mm", "peak", True), ("x rms [mm]", "peak", True), ("x_peak [mm]", "rms", True),
    ("Weg_eff/mm", "rms", False), ("x [mm]", "rms", False), ("x effort", "peak", False),
    ("x peak-to-peak", "rms", False),
])  # fmt: skip
def test_amplitudes_that_a_title_says_to_be_others_are_doubted(tmp_path, title, scale, doubted):
    path = table(tmp_path, f"f_Hz,F_N,{title}")
    response = Channel(amplitude=title, unit="mm", scale=scale)
    assert doubts(read_planned(path, response=response)) == ["unit-contradicts-title"] * doubted


@pytest.mark.parametrize(("title", "unit", "quantity", "doubted"), [
    ("a [g]", "m/s", "velocity", True), ("H (m/s2/N)", "m", "displacement", True),
    ("a [m/s^2]", "m/s^2", "acceleration", False), ("tip (t)", "m", "displacement", False),
    ("freq_Hz", "mm", "displacement", True),
])  # fmt: skip
def test_a_quantity_that_the_title_contradicts_is_doubted(tmp_path, title, unit, quantity, doubted):
    path = table(tmp_path, f"f_Hz,F_N,{title}")
    surface = read_planned(path, response=Channel(amplitude=title, unit=unit), quantity=quantity)
    assert doubts(surface) == ["unit-contradicts-title"] * doubted


def test_what_several_files_contradict_alike_is_said_once(tmp_path):
    paths = [table(tmp_path, "f_Hz,F_N,x_m", f"1,{n},2\n2,{n},3\n", f"{n}.csv") for n in (1, 2, 3, 4)]
    signals = Channel(amplitude="F_N", unit="kN"), Channel(amplitude="x_m", unit="mm")
    found = read_planned(tuple(paths), 1, *signals).findings
    assert [sentence(f) for f in found if f.code == "unit-contradicts-title"] == [
        f"1.csv, 2.csv, 3.csv, 4.csv: {column} is read in {unit}, but the file says {title}"
        for column, unit, title in (("F_N", "kN", "N"), ("x_m", "mm", "m"))
    ]


def test_units_of_a_header_hold_where_the_case_says_none(tmp_path):
    surface = read_planned(table(tmp_path, "f_kHz,F_mN,x_mm"), "f_kHz", "F_mN", "x_mm")
    assert surface.frequency[0] == 1000
    assert (abs(surface.force[0]), surface.amplitude[0]) == pytest.approx((2e-3, 3e-3))
    assert [found.code for found in surface.findings] == ["unit-of-file"] * 3


@pytest.mark.parametrize(("unit", "row", "read_in", "says"), [
    (None, "kN", "kN", ["N"]), ("N", "kN", "N", ["kN"]), ("kN", "kN", "kN", ["N"]), ("N", "(N)", "N", []),
    ("N", "V", "N", ["V"]),
])  # fmt: skip
def test_another_unit_in_the_row_below_a_title_is_doubted(tmp_path, unit, row, read_in, says):
    path = table(tmp_path, f"f,F [N],x\nHz,{row},mm")
    signals = Channel(amplitude="F [N]", unit=unit), Channel(amplitude="x", unit="mm")
    surface = read_planned(path, "f", *signals)
    found = [f.names for f in surface.findings if f.severity == "doubt"]
    assert [(names["unit"], names["title"]) for names in found] == [(read_in, said) for said in says]


@pytest.mark.parametrize(("title", "row"), [("f_Hz", "kHz"), ("w (rad/s)", "Hz")])
def test_another_unit_of_the_frequency_in_the_row_below_its_title_is_doubted(tmp_path, title, row):
    surface = read_planned(table(tmp_path, f"{title},F,x\n{row},N,mm"))
    (doubt,) = (f.names for f in surface.findings if f.severity == "doubt")
    assert (doubt["unit"], doubt["title"]) == (row, unit_in(title))
    assert surface.frequency[0] == pytest.approx(HERTZ[row])


@pytest.mark.parametrize(("title", "unit"), [
    ("phase_deg", "rad"), ("arg(X)/rad", "deg"), ("Phase (°)", "rad"), ("phase", "rad"),
])  # fmt: skip
def test_an_angle_read_in_another_unit_than_its_title_is_doubted(tmp_path, title, unit):
    path = table(tmp_path, f"f_Hz,F_N,x_m,{title}", "1,1,3,0.5\n2,1,4,0.6\n")
    surface = read_planned(path, response=Channel(amplitude=3, phase=4, phase_unit=unit), phase_known=True)
    assert doubts(surface) == ["unit-contradicts-title"] * (title != "phase")
    assert not [f for f in surface.findings if f.code == "not-recorded"]


@pytest.mark.parametrize(("phase", "doubted"), [(-170.0, True), (359.0, True), (-9.0, False)])
def test_degrees_read_as_radians_are_doubted(tmp_path, phase, doubted):
    paths = [table(tmp_path, "f_Hz,F_N,x_m,p", f"1,1,3,-1\n2,1,4,{phase + n}\n", f"{n}.csv") for n in (0, 1)]
    channel = Channel(amplitude="x_m", phase="p", phase_unit="rad")
    surface = read_planned(tuple(paths), response=channel, phase_known=True)
    said = [f for f in surface.findings if f.code == "unit-contradicts-title"]
    assert len(said) == doubted
    assert all('phase_unit = "deg"' in next_step(one) for one in said)


def test_units_that_nobody_wrote_are_named_once(tmp_path):
    paths = tuple(table(tmp_path, "f,F,x_mm", name=name) for name in ("a.csv", "b.csv"))
    test = planned(paths, "f", "F", "x_mm", level=LevelRule(values=(1, 2)))
    found = [one for one in read_measurement(test).findings if "default" in one.names]
    said = [(one.severity, one.names["default"]) for one in found]
    assert said == [("doubt", "F, read in N"), ("info", "f, read in Hz")]
    written = replace(test, force=NEWTON, frequency_unit="Hz")
    assert not [one for one in read_measurement(written).findings if "default" in one.names]


def test_a_level_column_that_was_forgotten_is_asked_for_with_the_columns_there_are(tmp_path):
    rows = "".join(f"{f},{level},{level / abs(10 - f)}\n" for level in (1, 2, 3) for f in (8, 9, 11, 12))
    path = table(tmp_path, "f_Hz,level_N,x_m", rows)
    test = planned(path, "f_Hz", Channel(nominal=True), "x_m", level=LevelRule(value=1.0))
    (found,) = (f for f in read_measurement(test).findings if f.code == "levels-disagree")
    assert found.names == {"rows": "readings", "columns": "f_Hz, level_N, x_m"}
    assert not row_findings(read_measurement(test))
    told = read_measurement(replace(test, level=LevelRule(column="level_N")))
    assert "levels-disagree" not in [f.code for f in told.findings]


def test_a_column_of_levels_that_is_the_force_is_no_recorded_force(tmp_path):
    path = table(tmp_path, "f_Hz,F_N,x_m", "1,2,3\n2,2,4\n1,5,7\n2,5,9\n")
    surface = read_planned(path, force="F_N", level=LevelRule(column="F_N"))
    (found,) = (f for f in surface.findings if f.code == "not-recorded")
    assert found.names == {"signal": "force", "by": "equality"}


@pytest.mark.parametrize(("head", "factor", "severity"), [
    ("f_Hz,F_V,x_m", 1, "doubt"), ("f_Hz,F (mV),x_m", 1, "doubt"), ("f,F,x\nHz,V,mm", 1, "doubt"),
    ("f_Hz,F_V,x_m", 10, "warning"), ("f,F,x\nHz,N,mm", 1, "info"), ("f,F,x\n-,N,(mm)", 1, "info"),
])  # fmt: skip
def test_volts_without_a_sensitivity_are_doubted(tmp_path, head, factor, severity):
    surface = read_planned(table(tmp_path, head), force=Channel(amplitude=2, factor=factor))
    assert surface.amplitude[0] == pytest.approx(3e-3 if "mm" in head else 3)
    assert {f.severity for f in surface.findings} - {"info"} == {severity} - {"info"}


def test_a_case_that_says_what_the_title_says_is_not_doubted(tmp_path):
    force, response = Channel(amplitude=2, unit="V", factor="3 N/V"), Channel(amplitude=3, unit="g")
    path = table(tmp_path, "f_Hz,drive_V,a_g")
    test = planned(path, 1, force, response, quantity="acceleration", frequency_unit="Hz")
    assert read_measurement(test).findings == ()
    # the load cell's volts are no newtons without a factor
    for read_in, said in (("N", ["unit-contradicts-title"]), ("V", [])):
        test = replace(test, force=Channel(amplitude=2, unit=read_in), calibrated=read_in == "N")
        assert doubts(read_measurement(test)) == said


@pytest.mark.parametrize(("title", "unit"), [
    ("Kraft [ N ] ", "N"), ("Kraft in N (rms)", "N"), ("Kraft [ ]", ""), ("force_mN", "mN"),
    ("Accelerance [(m/s^2)/N]", "(m/s^2)/N"), ("Accelerance ((m/s²)/N)", "(m/s²)/N"),
    ("Accelerance (m/s^2)/N", "(m/s^2)/N"), ("FRF (m/(s^2*N))", "m/(s^2*N)"), ("F/N", "N"),
    ("v_mm/s", "mm/s"), ("acc_m_s2", "m/s2"), ("acc_ms2", "m/s2"), ("t_ms", "ms"), ("a / (m/s²)", "m/s²"),
    # a quotient, and parts of a number
    ("x/F", ""), ("Re(H)", ""), ("Im(x/F)", ""), ("Real (mm)", "mm"), ("Re(H) [m/N]", "m/N"), ("force", ""),
])  # fmt: skip
def test_a_unit_in_a_title(title, unit):
    assert unit_in(title) == unit


@pytest.mark.parametrize("title", ["( x" + " " * 30_000 + "y", "(" * 30_000, f"rad{' ' * 30_000}x", "radius"])
def test_a_long_title_takes_no_time(title):
    started = time.process_time()
    assert (unit_in(title), is_angular(title)) == ("", False)
    # a pattern that tries all ways takes minutes
    assert time.process_time() - started < 2.0
