"""What is in a file is shown, and the case that is proposed for it reads it."""

import json
import tomllib
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from rsgen import read
from rsgen.app.cli.inspect_command import proposal_text
from rsgen.common.errors import MeasurementError
from rsgen.files import sandbox
from rsgen.files.inspection.listing import list_contents
from rsgen.files.inspection.proposal import Proposal
from rsgen.files.plan import Layout
from rsgen.files.text_columns import TextLines, read_columns
from tests.inspection.drafts import FREQUENCY, RECEPTANCE, drafted
from tests.measurement.tables import write_columns

pytestmark = pytest.mark.usefixtures("read_here")

ROOT = Path(__file__).parents[2]
FORMATS = ROOT / "cases" / "formats"
MEASURED = sorted(one for one in FORMATS.iterdir() if one.suffix not in (".toml", ".py") and one.is_file())


def proposed(path: Path):
    return tomllib.loads(proposal_text(drafted(path)))["test"]


def doubts(path: Path) -> dict[str, str]:
    return drafted(path).doubts


@pytest.fixture
def begun(run_cli):
    """Begin a case from files, as ``rsgen init`` does."""

    def begin(*paths: Path) -> Path:
        case = paths[0].with_name("new.toml")
        assert run_cli("init", "--from", *paths, case).code == 0
        return case

    return begin


SPECTRUM = np.linspace(8, 12, 20)
OF_EACH = [(n, f) for n in (1, 2) for f in range(40)]


def table(path: Path, head: str, rows) -> Path:
    path.write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("file", MEASURED, ids=lambda file: file.name)
def test_a_case_begun_from_a_file_reads_it(tmp_path, file, run_cli, begun):
    (tmp_path / file.name).write_bytes(file.read_bytes())
    case = begun(tmp_path / file.name)
    text = case.read_text()
    if file.name == "decay.uff":
        # a result is doubtful until it is known
        assert "TODO: write the moving mass" in text
        assert "otherwise it is identified" not in text
        assert "doubt: not confirmed" in run_cli("check", case).out
    if '"?"' in text:
        # records of a file whose name does not say how the structure was excited
        assert file.name.startswith("sweep_")
        assert "test.excitation" in run_cli("check", case).err
        text = text.replace('excitation = "?"', 'excitation = "swept-sine"')
        case.write_text(text)
    if "? N" in text:
        # nothing runs until the user has said what only the user knows
        assert "write a number in place of the question mark" in run_cli("check", case).err
        case.write_text(text.replace("? N", "3 N"))
    assert ("? N" in text) is (file.name == "frf.uff" or file.name.startswith("magnitude"))
    assert len(read(case)) > 10
    assert run_cli("init", "--from", tmp_path / file.name, case).code == 2


@pytest.mark.parametrize(("text", "layout", "column"), [
    ("f;F;x;phase\n1,5;1;2;3\n2,5;1;3;4\n3,5;1;2;5\n", {"decimal": ","}, "f"),
    ("made by a recorder\nserial 12, bench 4\n\nfreq\tforce\tdisp\n1\t1\t2\n2\t1\t3\n", {"skip": 2}, "freq"),
    ("# a remark\nf F x\n1 1 2\n2 1 3\n3 1 3\n", None, "f"),
    # a row of units below the names is read with them; of other words columns go by their numbers
    ("recorder 7\nTime,Frequency,Force,Acceleration,Phase\ns,Hz,N,m/s^2,deg\n0.5,1,1,2,3\n1,2,1,3,4\n",
     {"skip": 1}, "Frequency"),
    ("f;Kraft;a\nHz;Newtons;m/sec^2\n1;1;2\n2;1;3\n", {"skip": 2}, 1),
    ("date;freq [Hz];force [N];disp, tip [mm]\nmonday;1;1;2\nmonday;2;1;3\n", None, "freq [Hz]"),
])  # fmt: skip
def test_layouts_of_texts(tmp_path, text, layout, column, begun):
    path = table(tmp_path / "a.csv", text.rstrip(), [])
    tables = proposed(path)
    assert (tables.get("layout"), tables["frequency"]["column"]) == (layout, column)
    assert len(read(begun(path))) > 1


def test_a_case_begun_from_names_and_units_keeps_them(tmp_path, begun):
    rows = (f"{n},{f},{f + n},2" for n, f in product((1, 2), range(1, 30)))
    case = begun(table(tmp_path / "a.csv", "level,frequency,acceleration,phase\nN,Hz,m/s^2,deg", rows))
    text = case.read_text("utf-8")
    assert "[test.layout]" not in text
    # another unit than that of the file is a doubt, of a level, too
    for place, column, file, unit in (
        ('column = "frequency"', "frequency", "Hz", 'column = "frequency"\nunit = "rad/s"'),
        ('unit   = "N"', "level", "N", 'unit = "mN"'),
        ("nominal = true", "", "", 'amplitude = "level"'),
    ):
        assert place in text
        case.write_text(text.replace(place, unit), "utf-8")
        said = [f.names.get("column") for f in read(case).findings if f.code.startswith("unit-")]
        assert said == ([f"{column} [{file}]"] if column else [])


@pytest.mark.slow
def test_what_is_inside_is_shown(run_cli):
    shown = run_cli("inspect", FORMATS / "steps.h5").out
    assert all(word in shown for word in ("10880", "float32", "N", 'samples  = "displacement"'))
    found = json.loads(run_cli("inspect", FORMATS / "steps.h5", "--json").out)
    assert (found["format"], found["entries"][0]["shape"]) == ("hdf5", [10880])
    assert found["test"]["test.time"] == {"rate_column": "rate"}


@pytest.mark.slow
def test_inspect_says_what_is_not_limited(run_cli, monkeypatch):
    assert "limits" not in run_cli("inspect", FORMATS / "table.mat").err
    monkeypatch.setattr(sandbox, "MEMORY_STATUS", "/no/such/file")
    assert "limits everything but the memory" in run_cli("inspect", FORMATS / "table.mat").err
    assert "limits" not in run_cli("inspect", FORMATS / "table.csv").err
    monkeypatch.setattr(sandbox, "find_spec", lambda name: None)
    assert "limits nothing but the time" in run_cli("inspect", FORMATS / "table.mat").err


def test_every_text_survives_toml():
    for text in ('"', "\\", "\n\t\x00\x7f", "é µ ²", "\U0001f600", "#", "\u2028", "\U000e0001"):
        tree = tomllib.loads(proposal_text(Proposal({"test": {"file": text}})))
        assert tree["test"]["file"] == text
    # what is no Unicode cannot stand in TOML
    assert tomllib.loads(proposal_text(Proposal({"test": {"file": "a\udcff"}})))["test"]["file"] == "a\ufffd"


@pytest.mark.slow
@pytest.mark.parametrize("name", [
    "Sample_UFF58_ascii", "Sample_UFF58b_bin", "binary8byte", "non_ascii_header", "sample_dataset58_psd",
    "time-history-not-all-columns-filled",
])  # fmt: skip
def test_universal_files_of_others(name, measured_data):
    contents = list_contents(measured_data(f"uff/{name}.uff"))
    assert contents.format == "uff"
    said = "is a power spectral density, which is no response" if "psd" in name else ""
    assert all(said in entry.fault and bool(said) == bool(entry.fault) for entry in contents.entries)


@pytest.mark.slow
def test_real_files_are_understood(measured_data):
    f16 = proposed(measured_data("f16/F16Data_SineSw_Level1.mat"))
    assert f16["time"] == {"rate_column": "Fs"}
    assert (f16["force"]["samples"], f16["response"]) == ("Force", {"channels": "acceleration1"})
    for n in (1, 2, 3):
        assert f16["channels"][f"acceleration{n}"]["samples"] == f"Acceleration[{n}]"
    beam = proposed(measured_data("nlbeam/forced_data.mat"))["response"]
    assert [beam[part][-11:] for part in ("real", "imaginary")] == ["X1__V_/data", "Y1__V_/data"]
    path = measured_data("wire/example6.txt")
    wire = proposed(path)
    assert wire["frequency"]["column"] == wire["force"]["amplitude"] == wire["response"]["amplitude"] == "?"
    assert "TODO: write the name or the number" in doubts(path)["test.frequency.column"]


def test_a_draft_leaves_open_what_it_does_not_know_and_reads_levels_from_names(tmp_path, run_cli, begun):
    levels = {"rep1_1N_up.csv": 1, "rep1_1N_down.csv": 1, "rep2_3N_up.csv": 3}
    head = "freq_Hz,load_cell_V,x_m,phase_deg"
    size, lag = np.abs(RECEPTANCE), np.degrees(np.angle(RECEPTANCE))
    for name, level in levels.items():
        write_columns(tmp_path / name, head, FREQUENCY, 0.0225 * level, level * size, lag)
    # what a shell makes of --from *.csv; a name that is no file is said
    files = [tmp_path / name for name in levels]
    found = json.loads(run_cli("inspect", *files, "--json").out)["files"]
    assert [Path(one["file"]).name for one in found] == list(levels)
    listed = run_cli("inspect", *files).out
    assert [listed.count(text) for text in (": csv, 4 arrays", "[test]\n", "`rsgen check`")] == [3, 3, 1]
    absent = run_cli("init", "--from", *files, "none.csv", tmp_path / "new.toml")
    assert "and no files: 'none.csv', " in absent.err
    case = begun(*files)
    text = case.read_text("utf-8")
    assert 'unit      = "V"\nfactor    = "?" ' in text
    assert 'name = "rep*_{level}N_*.csv"' in text
    case.write_text(text.replace("frequency]\ncolumn", 'frequency]\nunit = "?"\ncolumn'), "utf-8")
    opened = sorted(line.split(": ")[1] for line in run_cli("check", case).err.splitlines())
    assert opened == ["test.force.factor", "test.frequency.unit"]
    case.write_text(text.replace('"?"', '"22.5 mV/N"'), "utf-8")
    answer = run_cli("check", case)
    assert (answer.code, answer.err, "51 measured points at 2 levels" in answer.out) == (0, "", True)


def test_a_draft_of_a_driven_base_takes_levels_from_names_and_a_relative_response_from_its_title(
    tmp_path, begun
):
    head = "frequency (Hz),table acceleration (m/s^2),relative displacement (mm),phase (deg)"
    size, lag = np.abs(RECEPTANCE), np.degrees(np.angle(RECEPTANCE))
    files = [tmp_path / f"base_{level}mg_{way}.csv" for level, way in (("030", "up"), ("060", "down"))]
    for file, level in zip(files, (0.2942, 0.5884), strict=True):
        write_columns(file, head, FREQUENCY, level, level * size, lag)
    case = begun(*files)
    test = tomllib.loads(case.read_text("utf-8"))["test"]
    assert (test["base"]["response"], test["level"]) == ("relative", {"name": "base_{level}mg_*.csv"})
    np.testing.assert_allclose(read(case).levels, [0.2942, 0.5884], rtol=1e-4)


def test_names_and_volts_of_a_matrix_are_drafted(tmp_path, begun):
    samples = np.column_stack([np.sin(np.arange(400.0)), np.cos(np.arange(400.0))])
    content = {"fs": 2048.0, "data": samples, "channels": "force cell, accelerometer", "unit": "V, V"}
    # the mass of a test with a force is identified; of what is not known to have one it must be given
    scipy.io.savemat(tmp_path / "bare_4N.mat", content | {"channels": "first, accelerometer"})
    assert "of a test with a force delete it" in begun(tmp_path / "bare_4N.mat").read_text("utf-8")
    scipy.io.savemat(tmp_path / "sweep_4N.mat", content)
    volts = {"unit": "V", "factor": "?"}
    tables = drafted(tmp_path / "sweep_4N.mat").tables
    assert tables["test.force"] == {"samples": "data[1]", **volts}
    assert tables["test.response"] == {"quantity": "acceleration", "samples": "data[2]", **volts}
    # arrays with numbers, a cell array of names, and one unit for both
    cell = np.array(["base acc", "mass acc"], dtype=object)
    numbered = {"CH1": samples[:, 0], "CH2": samples[:, 1], "fs": 2048.0, "chan": cell, "unit": "V"}
    scipy.io.savemat(tmp_path / "sweep_base.mat", numbered)
    tables = drafted(tmp_path / "sweep_base.mat").tables
    assert tables["test.base"].items() > {"samples": "CH1", **volts}.items()
    assert tables["test.response"].items() > {"quantity": "acceleration", "samples": "CH2"}.items()
    scipy.io.savemat(tmp_path / "sweep.mat", numbered | {"chan": np.array(["up", "down"], dtype=object)})
    assert "CH1 (up), CH2 (down)" in doubts(tmp_path / "sweep.mat")["test.response.samples"]


def test_nothing_to_recognise(tmp_path):
    for text, said in (("a,b\nmonday,tuesday\n", "no rows of numbers"), ("", "no numbers")):
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(MeasurementError, match=said):
            list_contents(tmp_path / "a.csv")


GERMAN = "Prüfling: Träger\r\nFrequenz [Hz];Kraft [N];Weg [µm];Phase [°]\r\n" + "".join(
    f"{f},5;1,0;{x},25;{-y},0\r\n" for f, x, y in ((9, 3, 20), (10, 5, 90), (11, 2, 160))
)


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252", "cp1250"])
def test_a_text_of_a_german_laboratory_is_read(tmp_path, encoding, begun):
    path = tmp_path / "a.csv"
    text = GERMAN.replace("µ", "u") if encoding == "cp1250" else GERMAN
    path.write_bytes(text.encode(encoding))
    tables = proposed(path)
    assert tables["layout"] == {"decimal": ",", "skip": 1, "encoding": "cp1252"}
    assert (tables["response"]["unit"], tables["response"]["phase"]) == ("um", "Phase [°]")
    case = begun(path)
    # recognised without the key, too
    case.write_text(case.read_text(encoding="utf-8").replace('encoding = "cp1252"', ""), encoding="utf-8")
    assert read(case).amplitude[0] == pytest.approx(3.25e-6)


def test_an_encoding_that_does_not_fit_is_a_sentence(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes("f;F;\u5909\u4f4d\n1;1;2\n2;1;3\n".encode("shift_jis"))
    with path.open("rb") as file:
        _, text = next(TextLines(file, "a", "shift_jis").lines())
    assert text.split(";")[2] == "\u5909\u4f4d"
    with pytest.raises(MeasurementError, match=r"line 1: not utf-8; .* test\.layout\.encoding"):
        read_columns(path, Layout(encoding="utf-8"), [1])
    path.write_bytes("f,F,x\r\n1,1,2".encode("utf-16"))
    with pytest.raises(MeasurementError, match=r"a\.csv: line 1: contains a zero byte; .* UTF-8"):
        read_columns(path, Layout(), ["f"])


@pytest.mark.parametrize(("head", "force", "response", "level"), [
    # a nominal level beside the force that was measured
    ("Kraftstufe [N],Kraft [N],Weg [mm],f [Hz],phi [deg]", ("Kraft [N]", "N", "peak"),
     {"quantity": "displacement", "unit": "mm", "phase_sense": "lead"}, {}),
    ("level_N,force_lbf,disp_mil,rpm,phase_lag_deg", ("force_lbf", "lbf", "peak"),
     {"quantity": "displacement", "unit": "thou", "phase_sense": "lag"}, {}),
    ("level_N,run,accelerance_g_per_N,freq_Hz,phase_deg", (),
     {"quantity": "acceleration", "unit": "g/N", "per_force": True}, {"scale": "peak"}),
    ("level_N (rms),run,accelerance_g_per_N,freq_Hz,phase_deg", (), {"unit": "g/N"}, {"scale": "rms"}),
    ("level_N (peak),run,accelerance_g_per_N,freq_Hz,phase_deg", (), {"unit": "g/N"}, {}),
    ("level_N,Force in N (rms),Acceleration in m/s^2 (rms),freq_Hz,phase_deg",
     ("Force in N (rms)", "N", "rms"),
     {"quantity": "acceleration", "unit": "m/s^2", "scale": "rms", "phase_sense": "lead"}, {}),
])  # fmt: skip
def test_what_a_header_tells(tmp_path, run_cli, head, force, response, level, begun):
    force = dict(zip(("amplitude", "unit", "scale"), force, strict=True)) if force else {"nominal": True}
    level = {"column": head.split(",")[0], "unit": "N", **level}
    rows = [f"{n},{n * 0.99},{1 + f / 7},{10 + f / 10},{-10 - 4 * f}" for n, f in OF_EACH]
    path = table(tmp_path / "a.csv", head, rows)
    tables = proposed(path)
    assert (tables["force"], tables["level"]) == (force, level)
    assert ("TODO" in doubts(path).get("test.level.scale", "")) is (level.get("scale") == "peak")
    assert response.items() <= tables["response"].items()
    assert run_cli("check", begun(path)).code == 0


def test_a_table_with_neutral_titles_is_asked_for_quantity_unit_and_scale_of_its_response(tmp_path, begun):
    rows = [f"{5 + f / 10},{level},{level * (1 + f)},{170 - f}" for level in (1, 3) for f in range(9)]
    path = table(tmp_path / "a.csv", "f,F,u,phi", rows)
    said = doubts(path)
    places = ("force.unit", "force.scale", "response.quantity", "response.unit", "response.scale")
    assert {f"test.{place}" for place in places} == {key for key in said if said[key].startswith("TODO")}
    taken = {"quantity": "displacement", "unit": "m", "amplitude": "u", "phase": "phi", "scale": "peak"}
    assert taken.items() <= proposed(path)["response"].items()
    (open_,) = (one for one in read(begun(path)).findings if one.code == "entries-not-confirmed")
    assert open_.names["entries"].count("test.response") == 3
    # of two columns none is taken, and no unit either
    two = doubts(table(path, "f,F,u,q,phi", [row + ",7" for row in rows]))
    asked = {key for key in two if two[key].startswith("TODO") and "response" in key}
    assert asked == {"test.response.amplitude", "test.response.unit", "test.response.scale"}
    # a peak that a title names is not asked for, one from peak to peak is
    assert not doubts(table(path, "f (Hz),F peak (N),u pk (m),phi lead (deg)", rows))
    twice = doubts(table(path, "f (Hz),F pk-pk (N),u peak-to-peak (m),phi (deg)", rows))
    assert {"test.force.scale", "test.response.scale"} <= twice.keys()
    # the first case of the README has nothing to look up
    assert not doubts(Path("cases/formats/table.csv"))


@pytest.mark.parametrize(("name", "begin", "found"), [
    ("a.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "an Excel workbook of .xls, or a protected"),
    ("a.csv.gz", b"\x1f\x8b\x08" + bytes(100), "is a packed file; unpack it"),
])  # fmt: skip
def test_other_files_of_laboratories_are_named(tmp_path, name, begin, found):
    path = tmp_path / name
    path.write_bytes(begin)
    with pytest.raises(MeasurementError, match=found):
        list_contents(path)


ROWS = [f"{8 + i / 10:.1f},{2 + i // 20},{1 + i / 7:.4f},{10 + i}" for i in range(40)]
HEAD = "f_Hz,force_N,disp_um,lag_deg"


@pytest.mark.slow
@pytest.mark.parametrize(("lines", "kept", "said"), [
    ([HEAD, *ROWS[:20], HEAD, *ROWS[20:]], 40, "words among the numbers, passed over; the first is line 22"),
    ([HEAD, *ROWS[:9], "8.9,NA,NA,NA", *ROWS[10:]], 39, "(1 of 40 are not finite)"),
    (["channels: 1 2 3", "1,2,3,4", HEAD, *ROWS], 40, "csv, 4 arrays of numbers"),
])  # fmt: skip
def test_no_row_of_a_log_is_dropped_in_silence(tmp_path, run_cli, lines, kept, said, begun):
    path = table(tmp_path / "log.csv", lines[0], lines[1:])
    assert said in run_cli("inspect", path).out
    assert len(read(begun(path))) == kept


@pytest.mark.slow
@pytest.mark.parametrize("units", [
    {"units": {"f": "kHz", "F": "mN", "x": "um"}}, {"f_unit": "kHz", "F_unit": "mN", "x_unit": "um"},
])  # fmt: skip
def test_texts_of_a_matlab_file_are_shown_and_are_units(tmp_path, run_cli, units):
    path, notes = tmp_path / "a.mat", "force cell below the stinger, gain 10, " * 4 + "beam B"
    numbers = {"f": np.linspace(1, 2, 30), "F": np.full(30, 2.0), "x": np.linspace(3, 4, 30)}
    scipy.io.savemat(path, {"test": {**numbers, **units}, "operator": "Jo", "notes": notes})
    tables = proposed(path)
    assert [tables[name]["unit"] for name in ("frequency", "force", "response")] == ["kHz", "mN", "um"]
    shown = " ".join(run_cli("inspect", path).out.split())
    assert all(part in shown for part in ("'mN'", "'Jo'", notes))
    assert "numbers are needed" not in shown


def test_units_that_name_no_channel_are_asked_for_and_no_text_of_a_file_becomes_a_table(tmp_path):
    path, record = tmp_path / "flap.mat", np.sin(np.arange(400.0))
    texts = {"units": "g, N\n[test]\u202e" + "x" * 200, "comment": "sine sweep up"}
    scipy.io.savemat(path, {"acc_flap": record, "force_cell": record, "fs": 2048.0} | texts)
    said = doubts(path)
    for place in ("test.force.unit", "test.response.unit"):
        assert said[place] == "TODO: no unit stands with it; write the unit"
    text = proposal_text(drafted(path))
    assert text.replace("\n", "").isprintable()
    assert text.count("[test]\n") == 1


def test_another_table_in_the_file_is_left_out_with_a_word(tmp_path):
    part = {"freq": SPECTRUM, "force": np.ones(20), "X": 1e-3 / (1 + 1j * SPECTRUM)}
    shorter = {name: values[:12] for name, values in part.items()}
    for other in (part, shorter):
        scipy.io.savemat(tmp_path / "a.mat", {"ForceControl": part, "ResponseControl": other})
        response = proposed(tmp_path / "a.mat")["response"]
        assert response["complex"] == "ForceControl/X"
        said = doubts(tmp_path / "a.mat")["test.response.complex"]
        assert "left out: ResponseControl/freq, ResponseControl/force, ResponseControl/X" in said


def test_a_capital_f_alone_is_a_force_and_titles_that_are_units_say_what_stands_where(tmp_path):
    tables = proposed(table(tmp_path / "a.csv", "F,f,x", ["1,10,0.1", "1,11,0.2", "1,12,0.1"]))
    assert (tables["frequency"]["column"], tables["force"]["amplitude"]) == ("f", "F")
    rows = [f"{f:.3f},2,{f / 3:.4f},{-f / 9:.4f}" for f in SPECTRUM]
    test = proposed(table(tmp_path / "a.csv", "Hz,N,m/s^2,rad", rows))
    assert test["frequency"] == {"column": "Hz"}
    assert test["force"] == {"amplitude": "N", "unit": "N", "scale": "peak"}
    response = {"quantity": "acceleration", "amplitude": "m/s^2", "phase": "rad"}
    assert response.items() <= test["response"].items()


def test_instants_of_any_clock_are_no_frequency_and_no_response(tmp_path):
    rows = [f"{1.7e9 + 2 * n},{f:.3f},2,{f / 3:.4f}" for n, f in enumerate(SPECTRUM)]
    for time in ("time", "Unix", "timestamp"):
        test = proposed(table(tmp_path / "a.csv", f"{time},f,force,acceleration", rows))
        assert test["frequency"] == {"column": "f"}
        assert test["response"]["amplitude"] == "acceleration"
    rows = [f"{n / 512},{f:.3f}" for n, f in enumerate(SPECTRUM)]
    test = proposed(table(tmp_path / "ring-down.csv", "time,input", rows))
    assert (test["time"]["column"], test["response"]["samples"]) == ("time", "?")
    asked = doubts(tmp_path / "ring-down.csv")["test.response.samples"]
    assert asked.startswith("TODO: no column is left for the response")


def test_more_columns_than_are_read_are_counted(tmp_path, run_cli):
    path = table(tmp_path / "a.csv", ",".join(f"c{n}" for n in range(12_000)), [",".join("1" * 12_000)] * 5)
    assert run_cli("inspect", path).err == f"{path}: more than 10000 columns; at most that many are read\n"


@pytest.mark.parametrize("ending", [".npy", ".npz"])
def test_a_matrix_without_names_is_asked_for_its_columns_as_a_case_writes_them(tmp_path, ending):
    path, matrix = tmp_path / f"a{ending}", np.arange(160.0).reshape(40, 4)
    np.savez(path, data=matrix) if ending == ".npz" else np.save(path, matrix)
    name = "array" if ending == ".npy" else "data"
    test = proposed(path)
    assert (test["frequency"], "excitation" in test) == ({"column": "?"}, False)
    assert f"{name}[1], {name}[2], {name}[3], {name}[4]" in doubts(path)["test.response.amplitude"]
