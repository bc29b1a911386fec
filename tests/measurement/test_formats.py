"""Files of other programs, in other units than SI: TDMS, Excel, LabVIEW and sound; good and hostile."""

import io
import re
import struct
import wave
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import savemat, wavfile

from rsgen import ResponseSurface, read
from rsgen.common.errors import MeasurementError
from rsgen.files import sandbox
from rsgen.files.array_files import walk_wav
from rsgen.files.data_files import recognise_format
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.histories import read_motions
from rsgen.files.inspection.listing import list_contents
from rsgen.files.labview import walk_lvm
from rsgen.files.plan import HistoryRule, LevelRule, MeasuredTest
from rsgen.files.sandbox import read_binary
from rsgen.files.signals import Channel
from rsgen.files.tree import LARGEST_BYTES, find
from tests.attacks.test_readers import refusal
from tests.attacks.traps_recorders import CELL, with_sheet
from tests.measurement.tables import planned

# what float64 keeps of a product of two factors
ROUND_OFF = 1e-14
GRAVITY = 9.80665
POUND = 0.45359237 * GRAVITY
FREQUENCY = np.linspace(8.0, 12.0, 41)
RECEPTANCE = 1 / (5920 - 1.5 * (2 * np.pi * FREQUENCY) ** 2 + 15j * np.pi * FREQUENCY)
TIME = np.arange(4000) / 200
DRIVE = 3.0 * np.sin(2 * np.pi * (5 * TIME + 0.25 * TIME**2))
MOTION = 0.25 * np.roll(DRIVE, 4)

Array = np.ndarray


def package(name: str, extra: str):
    return pytest.importorskip(name, reason=f"no {name} here: install rsgen[{extra}]")


def proposed(path, run_cli) -> ResponseSurface:
    case = path.with_suffix(".toml")
    done = run_cli("init", "--from", path, case)
    assert done.code == 0, done.err
    case.write_text(case.read_text(encoding="utf-8").replace('excitation = "?"', 'excitation = "swept-sine"'))
    return read(case)


def history(path, *signals: Channel | int | str, **rule) -> MeasuredTest:
    force, response = (one if isinstance(one, Channel) else Channel(samples=one) for one in signals)
    rule = HistoryRule("swept-sine", **rule)
    return MeasuredTest((path,), None, force, response, "acceleration", history=rule)


def array(path, *wanted: int | str) -> list[Array]:
    found = read_binary(path, recognise_format(path), wanted)
    return [channels[0].values for channels in found]


def load(walk, content: bytes, wanted: int | str) -> Array:
    ((node,), _) = find(list(walk(io.BytesIO(content), None, LARGEST_BYTES)), wanted)
    return node.load()


def table_of_a_sheet(units: bool) -> list[list]:
    """Frequency in kHz, force in lbf, displacement in thou, lag in degrees, below a line of settings."""
    lag = -np.degrees(np.angle(RECEPTANCE))
    columns = (FREQUENCY / 1e3, np.full(41, 2.0 / POUND), 2.0 * np.abs(RECEPTANCE) / 2.54e-5, lag)
    names, spelled = ["f", "force", "x", "lag"], ["kHz", "lbf", "thou", "deg"]
    heads = [names, spelled] if units else [[f"{n} [{u}]" for n, u in zip(names, spelled, strict=True)]]
    rows = [[float(v) for v in row] for row in zip(*columns, strict=True)]
    return [["Test", 12], [], *heads, *rows]


@pytest.mark.slow
@pytest.mark.parametrize("units", [True, False], ids=["row of units", "units in titles"])
@pytest.mark.usefixtures("read_here")
def test_a_workbook_in_inches_and_pounds(tmp_path, run_cli, units):
    book = package("openpyxl", "xlsx").Workbook()
    for row in table_of_a_sheet(units):
        book.active.append(row)
    book.active["C9"] = "NA"
    book.save(tmp_path / "a.xlsx")
    surface = proposed(tmp_path / "a.xlsx", run_cli)
    kept = np.delete(np.arange(41), 4 if units else 5)
    np.testing.assert_allclose(surface.frequency, FREQUENCY[kept], rtol=ROUND_OFF)
    np.testing.assert_allclose(np.abs(surface.force), 2.0, rtol=ROUND_OFF)
    receptance = surface.harmonics[:, 1] / surface.force
    np.testing.assert_allclose(receptance, RECEPTANCE[kept], rtol=1e-12)
    (lost,) = (finding for finding in surface.findings if finding.code == "rows-left-out")
    assert (lost["rows"], lost.names["first"]) == (1, "row 9")


@pytest.mark.slow
@pytest.mark.usefixtures("read_here")
def test_formulas_and_texts_of_sheets_are_said(tmp_path):
    book, path = package("openpyxl", "xlsx").Workbook(), tmp_path / "a.xlsx"
    for row in table_of_a_sheet(True)[2:]:
        book.active.append([*row, "1,5" if isinstance(row[0], float) else "comma"])
    book.active["G1"], book.active["G2"] = "sum", "=A3+1"
    book.save(path)
    entries = {entry.path.split("/")[-1]: entry for entry in list_contents(path).entries}
    for name in ("sum", "comma"):
        assert "open and save the workbook in Excel" in entries[name].fault


@pytest.mark.slow
@pytest.mark.usefixtures("read_here")
def test_a_tdms_file_in_kilonewton_and_g(tmp_path, run_cli):
    nptdms = package("nptdms", "tdms")
    path = tmp_path / "a.tdms"
    step = {"wf_increment": 1 / 200, "wf_start_offset": 0.0, "wf_samples": len(TIME)}
    in_g = {"NI_UnitDescription": "g"}
    scaling = {
        "NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear", "NI_Scale[0]_Linear_Slope": 0.5,
        "NI_Scale[0]_Linear_Y_Intercept": 0.0, "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
        "NI_Scaling_Status": "unscaled",
    }  # fmt: skip
    with nptdms.TdmsWriter(path) as file:
        for part in np.array_split(np.arange(len(TIME)), 3):
            file.write_segment([
                nptdms.ChannelObject("run", "Force", DRIVE[part] / 1e3, step | {"unit_string": "kN"}),
                nptdms.ChannelObject(
                    "run", "Acc [y/z]", MOTION[part] * 2 / GRAVITY, scaling | step | in_g
                ),
                nptdms.ChannelObject("run", "words", ["a", "b"]),
            ])  # fmt: skip
    ((found,),) = read_motions(history(path, "run/Force", "run/Acc [y/z]", rate_column="run/rate"))
    assert found.rate == pytest.approx(200, rel=ROUND_OFF)
    np.testing.assert_allclose(found.reference, DRIVE, rtol=ROUND_OFF, atol=1e-15)
    np.testing.assert_allclose(found.response, MOTION, rtol=ROUND_OFF, atol=1e-15)
    assert sum(finding.code == "unit-of-file" for finding in found.findings) == 2
    assert proposed(path, run_cli).origin == "measured"
    assert "holds no numbers" in run_cli("inspect", path).out


@pytest.mark.slow
@pytest.mark.parametrize(("columns", "separator", "decimal", "encoding"), [
    ("One", "Tab", ",", "utf-16"), ("Multi", "Comma", ".", "cp1252"), ("No", "Tab", ".", "utf-8"),
])  # fmt: skip
def test_measurement_files_of_labview(tmp_path, columns, separator, decimal, encoding):
    """Two segments of other lengths, each with its unit; the step tells the time where no column does."""
    lvmio = package("lvmio", "test")
    path = tmp_path / "a.lvm"
    said = (("Drive", DRIVE / POUND, "lbf"), ("Beschl. µ", MOTION * 1e3, "mm/s^2"))
    file = lvmio.LvmFile([
        lvmio.Segment([lvmio.Channel(name, list(v[:n]), unit=unit, delta_x=0.005) for name, v, unit in said])
        for n in (4000, 1000)
    ])  # fmt: skip
    form = {"separator": separator, "decimal_separator": decimal, "x_columns": columns, "precision": 15}
    path.write_bytes(lvmio.format_lvm(file, **form).encode(encoding))
    abscissa = "Drive/X_Value" if columns == "Multi" else "X_Value"
    for number, count in ((1, 4000), (2, 1000)):
        signals = f"{number}/Drive", f"{number}/Beschl. µ"
        ((found,),) = read_motions(history(path, *signals, time=f"{number}/{abscissa}"))
        assert (len(found), found.rate) == (count, pytest.approx(200, rel=1e-12))
        # 15 digits behind the point are written
        np.testing.assert_allclose(found.reference, DRIVE[:count], rtol=ROUND_OFF, atol=1e-14)
        np.testing.assert_allclose(found.response, MOTION[:count], rtol=ROUND_OFF, atol=1e-14)


LVM = (
    "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
    "Channels\t2\t\t\nY_Unit_Label\tNewtons\tg\t\nX_Dimension\tTime\tTime\t\nDelta_X\t0.1\t0.1\t\n"
    "***End_of_Header***\t\t\t\nX_Value\tF\ta\tComment\n0.0\t1\t2\n0.1\t2\t\tknock\n0.2\t3\t4\n"
)


def test_instants_that_a_labview_file_counts_begin_at_x0(tmp_path):
    text = LVM.replace("Delta_X", "X0\t2.5\t2.5\t\nDelta_X")
    (tmp_path / "a.lvm").write_text(re.sub(r"\n0\.\d\t", r"\n\t", text))
    (instants,) = array(tmp_path / "a.lvm", "X_Value")
    np.testing.assert_allclose(instants, [2.5, 2.6, 2.7], rtol=1e-12)


def test_members_of_a_struct_array_are_counted_by_columns(tmp_path):
    path, run = tmp_path / "a.mat", np.empty((2, 3), dtype=[("f", object)])
    for place in np.ndindex(2, 3):
        run[place] = (np.array([[10.0 * place[0] + place[1]]]),)
    savemat(path, {"run": run})
    # run(2) of MATLAB is run(2, 1), run(3) is run(1, 2)
    assert [float(one.item()) for one in array(path, "run/2/f", "run/3/f", "run/6/f")] == [10.0, 1.0, 12.0]


@pytest.mark.parametrize(("change", "message"), [
    (("0.2\t3\t4\n", "0.2\t3\n"), "line 15: 2 values; the segment has 3 columns"),
    (("0.2\t3\t4\n", "0.2\t3\t4,5\n"), "'a': line 15: '4,5' is no number"),
    (("***End_of_Header***\t\t\t\n", ""), "the file ends before ***End_of_Header***, so it is cut off"),
    (("X_Value\tF", "Value\tF"), "the names of the channels are needed"),
    (("Tab", "Bar"), "its separator is 'bar'; Tab, Comma and Semicolon are read"),
    (("0.0\t1\t2\n0.1\t2\t\tknock\n0.2\t3\t4\n", ""), "no rows of numbers in it"),
])  # fmt: skip
def test_faults_of_measurement_files_of_labview(tmp_path, change, message):
    assert change[0] in LVM
    with pytest.raises(MeasurementError, match=re.escape(message)):
        load(walk_lvm, LVM.replace(*change).encode(), "a")


@pytest.mark.parametrize(("kind", "bits"), [("u1", 8), ("i2", 16), ("i4", 32), ("f4", 0), ("f8", 0)])
def test_sound_files_of_scipy(tmp_path, kind, bits):
    path = tmp_path / "a.wav"
    both = np.stack([DRIVE, MOTION], axis=1) / 4
    written = both.astype(kind) if not bits else np.round(both * (2 ** (bits - 1) - 1)).astype("i8")
    written = (written + (128 if bits == 8 else 0)).astype(kind)
    wavfile.write(path, 200, written)
    rate, force, response = (load(walk_wav, path.read_bytes(), name) for name in ("rate", "channel_1", 2))
    full, zero = 2.0 ** (bits - 1) if bits else 1.0, 128 if bits == 8 else 0
    assert rate == 200
    np.testing.assert_array_equal(np.stack([force, response], axis=1), (written.astype("f8") - zero) / full)


@pytest.mark.slow
def test_a_sound_file_needs_a_calibration(tmp_path):
    path = tmp_path / "a.wav"
    written = np.round(np.stack([DRIVE, MOTION], axis=1) / 4 * 2**31).astype("i4")
    wavfile.write(path, 200, written)
    with pytest.raises(MeasurementError, match=r"'channel_1' is not known: .*write unit, and as factor"):
        read_motions(history(path, "channel_1", "channel_2", rate_column="rate"))
    force = Channel(samples="channel_1", unit="N", factor=12.0)
    response = Channel(samples=2, unit="mm/s^2", factor=4e3)
    ((found,),) = read_motions(history(path, force, response, rate_column="rate"))
    np.testing.assert_allclose(found.reference, 12 * (written[:, 0] / 2.0**31), rtol=ROUND_OFF)
    np.testing.assert_allclose(found.response, 4 * (written[:, 1] / 2.0**31), rtol=ROUND_OFF)


def test_24_bits_of_a_recorder(tmp_path):
    path = tmp_path / "a.wav"
    numbers = np.array([0, 1, -1, 2**23 - 1, -(2**23), 4711, -4711], dtype="<i4")
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 3, 51_200, 0, "NONE", ""))
        file.writeframes(b"".join(int(number).to_bytes(3, "little", signed=True) for number in numbers))
    (found,) = array(path, 1)
    np.testing.assert_array_equal(found, numbers / 2.0**23)


@pytest.mark.parametrize(("form", "package"), [("tdms", "nptdms"), ("xlsx", "openpyxl")])
def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch, form, package):
    path = tmp_path / f"a.{form}"
    path.write_bytes(b"TDSm" if form == "tdms" else b"PK\x03\x04" + bytes(26) + b"xl/")
    found = sandbox.find_spec
    monkeypatch.setattr(sandbox, "find_spec", lambda name: None if name == package else found(name))
    reason = rf"a\.{form}: .* read by {package}, which is not installed: python -m pip install {package};"
    with pytest.raises(MeasurementError, match=reason):
        list_contents(path)


def sound(*head: int, data: int | None = None, samples: bytes = bytes(8)) -> bytes:
    form = struct.pack("<HHIIHH", *(head or (1, 1, 100, 200, 2, 16)))
    parts = b"WAVEfmt " + struct.pack("<I", len(form)) + form
    size = len(samples) if data is None else data
    return b"RIFF" + struct.pack("<I", 2**31) + parts + b"data" + struct.pack("<I", size) + samples


@pytest.mark.parametrize(("content", "reason"), [
    (sound(data=2**32 - 1), "declares 4294967295 bytes of 'data'; 8 are left, so it is cut off"),
    (sound()[:-9], "has no samples, so it is cut off"),
    (sound(1, 65535, 1, 1, 1, 16), "65535 channels of 16 bits in 1 bytes"),
    (sound(1, 0, 1, 1, 0, 16), "0 channels of 16 bits"), (sound(1, 1, 0, 0, 2, 16), "a sampling rate of 0"),
    (sound(samples=b""), "0 bytes of samples"), (sound(samples=bytes(7)), "7 bytes of samples, 2 each"),
    (sound().replace(b"RIFF", b"RIFX"), "is no ordinary sound file"),
    (b"RIFF\x00\x00\x00\x00WAVE" + b"LIST\x00\x00\x00\x00" * 5000, "more than 1000 parts before its samples"),
])  # fmt: skip
def test_sound_files_that_lie(content, reason):
    with pytest.raises(MeasurementError, match=re.escape(reason)):
        load(walk_wav, content, 1)


LAUGHS = b'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">' + b"".join(
    b'<!ENTITY a%d "%s">' % (n, b"&a%s;" % (b"" if n == 1 else b"%d" % (n - 1)) * 50) for n in range(1, 9)
) + b"]>"  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("how", "reason"), [
    ({"body": b" " * 60_000_000}, "unpacks to 60.* bytes; at most 33554432 are read"),
    ({"body": CELL % (10**15, b"A1")}, "more than 1048576 rows"),
    ({"body": b"".join(CELL % (n, b"ZZZ%d" % n) for n in range(1, 2000))}, "20000000 cells in a"),
    ({"before": LAUGHS, "body": b'<row r="1"><c r="A1"><v>&a8;</v></c></row>'}, ""),
], ids=["bomb", "row", "cells", "entities"])  # fmt: skip
def test_workbooks_that_lie(tmp_path, how, reason):
    package("openpyxl", "xlsx")
    path = tmp_path / "a.xlsx"
    path.write_bytes(with_sheet(tmp_path, **how))
    assert re.search(reason, refusal(lambda: list_contents(path), 10.0))


def test_a_complex_matrix_a_run_has_its_frequencies_with_imaginary_parts_of_zero(tmp_path, run_cli):
    """MATLAB makes [f, X] complex."""
    frequency, response = np.linspace(8.0, 12.0, 20), np.exp(1j * np.linspace(0.1, 3.0, 20))
    runs = {f"run_{level}N": np.column_stack([frequency, level * response]) for level in (1, 2)}
    savemat(tmp_path / "runs.mat", runs)
    signals = Channel(nominal=True), Channel(complex="run_*[2]", phase_sense="lead", unit="mm")
    test = planned(
        tmp_path / "runs.mat", "run_*[1]", *signals, level=LevelRule(values=(1.0, 2.0)), phase_known=True
    )
    surface = read_measurement(test)
    np.testing.assert_allclose(surface.frequency, np.tile(frequency, 2))
    np.testing.assert_allclose(surface.harmonics[20:, 1], 2e-3 * response)
    assert "a table has [test.frequency]" in run_cli("inspect", tmp_path / "runs.mat").out
    with pytest.raises(MeasurementError, match="is complex"):
        read_measurement(replace(test, frequency="run_*[2]"))
