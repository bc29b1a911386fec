"""Files of recorders: channels, names and units beside the numbers, points of a modal test, sheets."""

from __future__ import annotations

import tomllib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.signal

from rsgen.analysis.export import save_frf
from rsgen.app.cli.inspect_command import Trial, proposal_text, try_proposal
from rsgen.data.surface import ResponseSurface
from rsgen.files import LevelRule, MeasuredTest, Signal, read_measurement
from rsgen.files.inspection import list_contents, propose

MASS, DAMPING, STIFFNESS = 1.5, 8.0, 6000.0
FREQUENCY = np.linspace(7.0, 13.0, 25)
OMEGA = 2 * np.pi * FREQUENCY
RECEPTANCE = 1 / (STIFFNESS - MASS * OMEGA**2 + 1j * OMEGA * DAMPING)
SHAPES = (1.0, 0.6, -0.3)
RATE = 256.0
TIME = np.arange(int(60 * RATE)) / RATE
FORCE = np.sin(2 * np.pi * (6 * TIME + 4 / 60 * TIME**2))
SYSTEM = ([[0, 1], [-STIFFNESS / MASS, -DAMPING / MASS]], [[0], [1 / MASS]])
ACCELERATION = scipy.signal.lsim((*SYSTEM, [SYSTEM[0][1]], [[1 / MASS]]), FORCE, TIME)[1].ravel()


def tried(path: Path) -> tuple[dict[str, Any], Trial]:
    """Give the [test] tables that are proposed for a file, and what they read."""
    contents = list_contents(path)
    proposal = propose(contents)
    assert proposal is not None
    trial = try_proposal(contents, proposal)
    assert not trial.fault
    tables: dict[str, Any] = tomllib.loads(proposal_text(trial.proposal))["test"]
    return tables, trial


def is_the_sweep(trial: Trial) -> bool:
    """Whether the first channel was read as that of the oscillator."""
    surface = trial.surface
    assert isinstance(surface, ResponseSurface)
    exact = STIFFNESS - MASS * surface.omega**2 + 1j * surface.omega * DAMPING
    return bool(np.median(np.abs(surface.force / surface.harmonics[:, 1] / exact - 1)) < 0.02)


@pytest.mark.slow
def test_names_and_units_in_structs_of_a_modal_analyser(tmp_path: Path) -> None:
    """Of each signal: steps of the abscissa, numbers, the label of their unit, and a record with its name."""
    signals = {}
    named = (("Wing:2:+Z", 0.6 * ACCELERATION, "g"), ("Shaker", FORCE, "N"), ("Wing:1:+Z", ACCELERATION, "g"))
    for number, (name, values, unit) in enumerate(named):
        signals[f"Signal_{number}"] = {
            "x_values": {"start_value": 0.0, "increment": 1 / RATE, "number_of_values": float(len(values))},
            "y_values": {"values": values / (9.80665 if unit == "g" else 1), "quantity": {"label": unit}},
            "function_record": {"name": name},
        }
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, signals)
    tables, trial = tried(path)
    assert tables["time"] == {"rate": "256 Hz"}
    assert tables["force"] == {"samples": "Signal_1/y_values/values", "unit": "N"}
    assert tables["channels"]["wing1_z"]["samples"] == "Signal_2/y_values/values"
    assert tables["channels"]["wing1_z"]["unit"] == "g"
    assert isinstance(trial.surface, ResponseSurface)


@pytest.mark.slow
def test_headers_beside_the_data_of_a_recorder(tmp_path: Path) -> None:
    arrays: dict[str, Any] = {"Sample_rate": RATE}
    named = (
        ("Force cell", FORCE, "Newtons"),
        ("Tip", ACCELERATION, "m/s²"),
        ("Root", 0.4 * ACCELERATION, "m/s²"),
    )
    for number, (name, values, unit) in enumerate(named, start=1):
        arrays[f"Channel_{number}_Data"] = values
        arrays[f"Channel_{number}_Header"] = {"SignalName": name, "Unit": unit}
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, arrays)
    tables, trial = tried(path)
    assert tables["force"] == {"samples": "Channel_1_Data", "unit": "N"}
    assert {name: channel["samples"] for name, channel in tables["channels"].items()} == {
        "tip": "Channel_2_Data",
        "root": "Channel_3_Data",
    }
    assert is_the_sweep(trial)


@pytest.mark.slow
def test_channels_without_names_are_not_guessed_silently(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"ch1": FORCE, "ch2": ACCELERATION, "ch3": 0.4 * ACCELERATION, "fs": RATE})
    _, trial = tried(path)
    assert trial.surface is None
    assert "name the force" in trial.proposal.doubts["test.excitation"]
    assert "left out: ch2, ch3" in trial.proposal.doubts["test.response.samples"]


def test_channels_of_a_data_logger(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms", reason="no nptdms here: install rsgen[tdms]")
    path = tmp_path / "a.tdms"
    named = (
        ("ai0", FORCE, "Newtons"),
        ("ai1", ACCELERATION / 9.80665, "g's"),
        ("ai2", ACCELERATION, "m/s^2"),
    )
    with nptdms.TdmsWriter(str(path)) as writer:
        channels = [
            nptdms.ChannelObject(
                "Data", f"cDAQ1Mod1/{name}", values, {"wf_increment": 1 / RATE, "unit_string": unit}
            )
            for name, values, unit in named
        ]
        writer.write_segment([nptdms.RootObject({}), nptdms.GroupObject("Data"), *channels])
    tables, trial = tried(path)
    assert tables["force"]["samples"] == "Data/cDAQ1Mod1/ai0"
    assert [channel["unit"] for channel in tables["channels"].values()] == ["g", "m/s^2"]
    assert is_the_sweep(trial)


def test_sheets_with_levels_in_their_names(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl", reason="no openpyxl here: install rsgen[xlsx]")
    book = openpyxl.Workbook()
    book.remove(book.active)
    for level in (3.0, 1.0):
        sheet = book.create_sheet(f"Sweep {level:g} N")
        sheet.append(["f", "F", "x1", "phi1", "x2", "phi2"])
        sheet.append(["Hz", "N", "mm", "deg", "mm", "deg"])
        x = 1e3 * level * RECEPTANCE
        columns = (
            FREQUENCY,
            level + 0 * FREQUENCY,
            abs(x),
            np.degrees(np.angle(x)),
            0.6 * abs(x),
            np.degrees(np.angle(x)),
        )
        for row in np.column_stack(columns):
            sheet.append([float(value) for value in row])
    path = tmp_path / "a.xlsx"
    book.save(path)
    tables, trial = tried(path)
    assert tables["level"] == {"values": ["1 N", "3 N"]}
    assert tables["channels"]["x2"]["phase"] == "Sweep * N/phi2 [deg]"
    surface = trial.surface
    assert isinstance(surface, ResponseSurface)
    assert surface.levels.tolist() == [1.0, 3.0]
    np.testing.assert_allclose(surface.harmonics[:, 1] / surface.force, np.tile(RECEPTANCE, 2), rtol=1e-9)


def modal_file(path: Path, points: list[tuple[int, int, float]]) -> Path:
    """Write accelerances at nodes and directions, times a number."""
    pyuff = pytest.importorskip("pyuff", reason="no pyuff here: install rsgen[test]")
    sets = [
        pyuff.prepare_58(
            func_type=4, rsp_node=node, rsp_dir=direction, ref_node=7, ref_dir=3, rsp_ent_name="WING",
            ref_ent_name="WING", data=-(OMEGA**2) * share * RECEPTANCE, x=FREQUENCY, binary=0, id1="a",
            z_axis_value=0.0, abscissa_spacing=1,
            abscissa_min=7.0, abscissa_inc=0.25, num_pts=25, ord_data_type=6,
            ordinate_spec_data_type=12, orddenom_spec_data_type=13, abscissa_spec_data_type=18,
        )
        for node, direction, share in points
    ]  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    return path


@pytest.mark.parametrize(
    ("points", "left_out"),
    [
        ([(1, 3, 1.0), (2, 3, 0.6), (3, -3, -0.3)], "left out: WING 2 +Z, WING 3 -Z;"),
        ([(1, 3, 1.0), (1, 1, 0.6)], "left out: WING 1 +X;"),
        (
            [(1, 3, 1.0), (2, 3, 0.6), (1, 3, 1.1), (2, 3, 0.7)],
            "left out: WING 2 +Z and 1 more of this point;",
        ),
        ([(1, 3, 1.0), (1, 3, 1.0), (1, 3, 1.0)], ""),
    ],
)
def test_points_of_a_modal_test_are_no_levels(
    tmp_path: Path, points: list[tuple[int, int, float]], left_out: str
) -> None:
    """Accelerances of different points read as levels of one were a wrong result without a word."""
    tables, trial = tried(modal_file(tmp_path / "a.uff", points))
    surface = trial.surface
    assert isinstance(surface, ResponseSurface)
    if left_out:
        assert trial.proposal.doubts["test.response.complex"].startswith(left_out)
        assert tables["response"]["complex"] == "1/ordinate"
        assert "value" in tables["level"]
        np.testing.assert_allclose(surface.harmonics[:, 1] / surface.force, RECEPTANCE, rtol=1e-9)
    else:
        assert tables["response"]["complex"] == "*/ordinate"
        assert len(tables["level"]["values"]) == len(points)


@pytest.mark.slow
def test_receptances_that_were_written_come_back_with_their_levels(tmp_path: Path) -> None:
    level = np.repeat([2.0, 10.0], len(FREQUENCY))
    response = level * np.tile(RECEPTANCE, 2)
    surface = ResponseSurface(
        level=level, frequency=np.tile(FREQUENCY, 2), force=level + 0j, response=response
    )
    path = tmp_path / "a.uff"
    save_frf(path, surface)
    tables, trial = tried(path)
    assert tables["level"] == {"values": ["2 N", "10 N"]}
    assert "titles" in trial.proposal.doubts["test.level.values"]
    back = trial.surface
    assert isinstance(back, ResponseSurface)
    assert back.levels.tolist() == [2.0, 10.0]
    np.testing.assert_allclose(back.harmonics[:, 1], response, rtol=1e-5)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("run_2N.csv", "run_4N.csv", "run_10N.csv"), 'name = "run_{level}N.csv"'),
        (("v2_run1_4N.csv", "v2_run1_8N.csv"), 'name = "v2_run1_{level}N.csv"'),
        (("Level1.csv", "Level3.csv"), 'name = "Level{level}.csv", unit = "label"'),
        (("run_2N.csv", "other_4N.csv", "run_4N.txt"), ""),
    ],
)
def test_files_of_other_levels_are_named(tmp_path: Path, names: tuple[str, ...], said: str) -> None:
    """What the comment says reads all of them."""
    for name in names:
        rows = "".join(f"{f:g},{abs(x):.9g}\n" for f, x in zip(FREQUENCY, RECEPTANCE, strict=True))
        (tmp_path / name).write_text(f"f_Hz,x_m\n{rows}", encoding="utf-8")
    proposal = propose(list_contents(tmp_path / names[0]))
    assert proposal is not None
    comment = proposal.doubts.get("test.file", "")
    assert comment.endswith(said)
    assert bool(comment) is bool(said)
    if said:
        assert all(name in comment for name in names[1:])
        rule = {"name": said.split('"')[1]} | ({"unit": "label"} if "label" in said else {})
        test = MeasuredTest(
            files=tuple(tmp_path / name for name in names),
            frequency="f_Hz",
            force=None if "N" in said else Signal(amplitude="x_m", unit="N", factor=1000.0),
            response=Signal(amplitude="x_m"),
            quantity="displacement",
            phase_known=False,
            level=LevelRule(**rule),
        )
        surface = read_measurement(test)
        assert isinstance(surface, ResponseSurface)
        if "label" not in said:
            numbers = [float(name.rpartition("_")[2].removesuffix("N.csv")) for name in names]
            assert surface.levels.tolist() == sorted(numbers)
