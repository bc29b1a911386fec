"""Levels of measured tests: an entry or a run each, labels that are no amounts, held responses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

import rsgen
from rsgen.common.errors import MeasurementError, RsgenError
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.multisine.spectra import held_out_records
from rsgen.data.oscillator import Model, Observation
from rsgen.data.surface import ResponseSurface, load_surface, match_level, save_surface, typical_amounts
from rsgen.files import LevelRule, MeasuredTest, Signal, read_measurement
from rsgen.identification.fitting.points import held_out_mask

FREQUENCY = np.linspace(8, 12, 41)
MASS, STIFFNESS, CUBIC, DAMPING = 1.5, 5920.0, 2e6, 7.5
HELD = np.linspace(1e-3, 12e-3, 8)


def force_at(size: Any, frequency: Any) -> Any:
    """Force [N] that holds an amplitude [m]; to first order."""
    omega = 2 * np.pi * np.asarray(frequency)
    return size * (STIFFNESS + 0.75 * CUBIC * size**2 - MASS * omega**2 + 1j * omega * DAMPING)


def held_runs(path: Path, **more: Any) -> Path:
    """Write eight runs of which each held the amplitude, as structs; ``more`` are columns a run."""
    run = np.empty((1, len(HELD)), dtype=[(name, "O") for name in ("f", "F", "X", *more)])
    for place, size in enumerate(HELD):
        run[0, place]["f"], run[0, place]["F"] = FREQUENCY, force_at(size, FREQUENCY)
        run[0, place]["X"] = size * np.exp(1e-3j * np.arange(41))
        for name, values in more.items():
            run[0, place][name] = float(values[place])
    scipy.io.savemat(path, {"run": run})
    return path


def of_runs(path: Path, **more: Any) -> MeasuredTest:
    force = Signal(complex="run/*/F", phase_sense="lead")
    return MeasuredTest(path, "run/*/f", force, Signal(complex="run/*/X"), "displacement", **more)


def of_files(tmp_path: Path, forces: dict[str, Any], **more: Any) -> MeasuredTest:
    """Write a file a run, with the force over frequency that is given, and plan to read them."""
    paths = []
    for name, force in forces.items():
        size = np.abs(force) / 1e4
        rows = np.stack(
            [FREQUENCY, np.broadcast_to(force, FREQUENCY.shape), np.broadcast_to(size, FREQUENCY.shape)]
        )
        paths.append(tmp_path / name)
        lines = "".join(f"{f:.6g},{p:.9g},{x:.9g}\n" for f, p, x in rows.T)
        paths[-1].write_text("f,F,X\n" + lines, encoding="utf-8")
    signals = Signal(amplitude="F"), Signal(amplitude="X")
    return MeasuredTest(tuple(paths), "f", *signals, "displacement", phase_known=False, **more)


def codes(surface: ResponseSurface) -> dict[str, str]:
    return {finding.code: finding.severity for finding in surface.findings}


@pytest.mark.slow
def test_each_entry_is_a_level(tmp_path: Path) -> None:
    """Eight runs at held amplitudes were grouped by like force into 25 levels."""
    path = held_runs(tmp_path / "a.mat")
    surface = read_measurement(of_runs(path, control="response"))
    assert surface.control == "response"
    np.testing.assert_allclose(surface.levels, HELD, rtol=5e-3)
    assert [int(np.count_nonzero(surface.level == level)) for level in surface.levels] == [41] * 8
    assert codes(surface) == {}
    assert len(read_measurement(of_runs(path)).levels) == 8
    assert len(read_measurement(of_runs(path, level=LevelRule(spread=0.05))).levels) == 14


@pytest.mark.slow
def test_a_held_response_is_declared_with_its_unit(tmp_path: Path) -> None:
    path = held_runs(tmp_path / "a.mat", level=HELD * 1e3)
    rule = LevelRule(column="run/*/level", unit="mm")
    surface = read_measurement(of_runs(path, control="response", level=rule))
    assert (surface.control, surface.level_unit) == ("response", "m")
    np.testing.assert_allclose(surface.levels, HELD, rtol=1e-12)
    assert codes(surface) == {}


def test_a_force_that_was_held_is_no_held_response(tmp_path: Path) -> None:
    forces = {f"{level}.csv": level * (1 + 0.5 * np.sin(FREQUENCY)) for level in (1, 3)}
    surface = read_measurement(
        of_files(tmp_path, forces, level=LevelRule(name="{level}.csv"), control="response")
    )
    assert codes(surface)["response-not-held"] == "doubt"


def test_files_of_a_held_response_are_levels_of_the_amplitude_held(tmp_path: Path) -> None:
    """Without levels in the plan, files were levels of 0 m and 1 m by their number."""
    for name, size in (("a", 1e-3), ("b", 2e-3)):
        rows = np.column_stack([FREQUENCY, 3 + np.sin(FREQUENCY), np.full(len(FREQUENCY), size)])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="f,F,X", comments="")
    signals = Signal(amplitude="F"), Signal(amplitude="X")
    files = tmp_path / "a.csv", tmp_path / "b.csv"
    test = MeasuredTest(files, "f", *signals, "displacement", phase_known=False, control="response")
    np.testing.assert_allclose(read_measurement(test).levels, [1e-3, 2e-3], rtol=1e-12)


def test_labels_are_called_by_what_was_measured(tmp_path: Path) -> None:
    """ "Level4" in a file's name stood for 4 N beside a measured force of 58 N."""
    forces = {"Level1.csv": 4.8, "Level3.csv": 28.8, "Level4.csv": 58.0}
    surface = read_measurement(of_files(tmp_path, forces, level=LevelRule(name="Level{level}.csv")))
    assert surface.levels.tolist() == [4.8, 28.8, 58.0]
    assert codes(surface) == {"levels-disagree": "info"}
    said = read_measurement(of_files(tmp_path, forces, level=LevelRule(values=(1, 3, 4))))
    assert said.levels.tolist() == [4.8, 28.8, 58.0]
    assert codes(said) == {"levels-disagree": "doubt"}
    rule = LevelRule(values=(1, 3, 4), unit="label")
    assert codes(read_measurement(of_files(tmp_path, forces, level=rule))) == {"levels-disagree": "info"}


LABELLED = {"1.csv": 2.0, "2.csv": 4.0, "3.csv": 6.0}


@pytest.mark.parametrize(
    ("asked", "held"),
    [(1, 2.0), (2, 4.0), (3, 6.0), (6, 6.0)],  # 2 is a label, and the amount of another level
)
def test_a_level_is_held_out_by_its_label(tmp_path: Path, asked: float, held: float) -> None:
    """Of labels 1, 2, 3 at 2, 4, 6 N the level 2 held out label 1."""
    rule = LevelRule(name="{level}.csv", unit="label")
    saved = read_measurement(of_files(tmp_path, LABELLED, level=rule))
    save_surface(tmp_path / "surface.h5", saved)
    for surface in (saved, load_surface(tmp_path / "surface.h5"), saved.select(np.arange(len(saved))[::-1])):
        mask = held_out_mask(surface, Model("k*x", observation=Observation(hold_out=(asked,))))
        assert np.unique(surface.level[mask]).tolist() == [held]
    assert saved.find_level(asked) == held
    model = Model("k*x + c*v", observation=Observation(hold_out=(asked,)))
    said = [f for f in rsgen.identify(saved, model).findings if f.code == "held-out-by-label"]
    assert [f["level"] for f in said] == ([held] if asked == 2 else [])


def test_what_is_no_label_and_no_level_is_refused_with_both(tmp_path: Path) -> None:
    rule = LevelRule(name="{level}.csv", unit="label")
    surface = read_measurement(of_files(tmp_path, LABELLED, level=rule))
    with pytest.raises(
        RsgenError, match=r"no level 5 N .* it has 2 \(label 1\), 4 \(label 2\), 6 \(label 3\) N"
    ):
        rsgen.identify(surface, "k*x + c*v", Observation(hold_out=(5,)))


def test_levels_without_labels_are_held_out_by_their_amounts(tmp_path: Path) -> None:
    forces = {"2N.csv": 2.0, "4N.csv": 4.0}
    surface = read_measurement(of_files(tmp_path, forces, level=LevelRule(name="{level}N.csv")))
    assert surface.label is None
    assert surface.find_level(2) == 2.0
    assert surface.find_level(1) is None


def test_records_are_held_out_by_their_labels() -> None:
    lines = np.ones((3, 1, 4), complex)
    spectra = MultisineSpectra([2.0, 4.0, 6.0], 1.0, lines, lines, label=[1, 2, 3])
    assert held_out_records(spectra, (2,)).tolist() == [False, True, False]
    assert held_out_records(spectra, (6,)).tolist() == [False, False, True]
    assert held_out_records(spectra.select([2, 1, 0]), (1,)).tolist() == [False, False, True]
    # a label may have several amounts, and an amount several labels
    several = MultisineSpectra([1.0, 1.3, 1.0, 5.0], 1.0, lines[[0] * 4], lines[[0] * 4], label=[1, 1, 2, 3])
    assert held_out_records(several, (1.0,)).tolist() == [True, True, False, False]
    assert held_out_records(several, (5.0,)).tolist() == [False, False, False, True]
    # a label within its printed digits, as of a surface; the refusal lists labels
    thirds = replace(spectra, label=np.array([1 / 3, 2 / 3, 1.0]))
    assert held_out_records(thirds, (0.667,)).tolist() == [False, True, False]
    with pytest.raises(RsgenError, match=r"label 0\.333333"):
        held_out_records(thirds, (9.0,))


@pytest.mark.parametrize(("asked", "said"), [(1, []), (2, [4.0]), (6, [])])
def test_a_label_that_is_the_amount_of_another_record_is_said(asked: int, said: list[float]) -> None:
    omega = 1j * np.arange(12) * 5.0
    size = np.array([2.0, 4.0, 6.0])[:, None, None]
    response = size * np.where(np.arange(12) > 0, 1e-3 * np.exp(1j * np.arange(12) ** 2), 0)
    force = (1.5 * omega**2 + 4.0 * omega + 1500.0) * response
    spectra = MultisineSpectra([2.0, 4.0, 6.0], 5.0, force, response, label=[1, 2, 3])
    found = rsgen.identify(spectra, "k*x + c*v", rsgen.Observation(hold_out=(asked,)))
    assert [f["level"] for f in found.findings if f.code == "held-out-by-label"] == said


def test_nominal_levels_stay_where_the_force_falls_at_the_resonance(tmp_path: Path) -> None:
    dip = 1 - 0.6 * np.exp(-((FREQUENCY - 10) ** 2))
    forces = {f"{level}N.csv": level * dip for level in (2, 5)}
    surface = read_measurement(of_files(tmp_path, forces, level=LevelRule(name="{level}N.csv")))
    assert surface.levels.tolist() == [2, 5]
    assert codes(surface) == {}


def test_a_unit_behind_the_number_in_a_name_is_the_unit_of_the_level(tmp_path: Path) -> None:
    forces = {"a_300mN.csv": 0.3, "a_500mN.csv": 0.5}
    surface = read_measurement(of_files(tmp_path, forces, level=LevelRule(name="a_{level}mN.csv")))
    np.testing.assert_allclose(surface.levels, [0.3, 0.5])
    assert codes(surface) == {}


def test_a_length_in_a_name_is_no_force(tmp_path: Path) -> None:
    """ "gap_3mm.csv" was refused: a length, where N was needed."""
    forces = {"gap_1mm.csv": 30.0, "gap_3mm.csv": 50.0}
    rule = LevelRule(name="gap_{level}mm.csv")
    surface = read_measurement(of_files(tmp_path, forces, level=rule))
    assert surface.levels.tolist() == [30.0, 50.0]
    assert codes(surface) == {"levels-disagree": "info"}


def test_swapped_levels_are_doubted(tmp_path: Path) -> None:
    forces = {"a.csv": 1.5, "b.csv": 1.0, "c.csv": 2.0}
    surface = read_measurement(of_files(tmp_path, forces, level=LevelRule(values=(1.0, 1.5, 2.0))))
    assert codes(surface) == {"levels-swapped": "doubt"}


def test_a_run_is_a_level_though_its_force_falls(tmp_path: Path) -> None:
    """Points of one run were dealt out to levels by like force where it fell in steps."""
    steps = np.where(np.abs(FREQUENCY - 10) < 0.5, 0.7, 1.0)
    surface = read_measurement(of_files(tmp_path, {"a.csv": 2 * steps, "b.csv": 5 * steps}))
    np.testing.assert_allclose(surface.levels, [2, 5])


def test_levels_side_by_side_are_grouped_by_force(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{f:.4g},{force},{force * 1e-3}" for f in FREQUENCY for force in (1.0, 3.0)]
    path.write_text("\n".join(["f,F,X", *rows, ""]), encoding="utf-8")
    test = MeasuredTest(
        path, "f", Signal(amplitude="F"), Signal(amplitude="X"), "displacement", phase_known=False
    )
    assert read_measurement(test).levels.tolist() == [1, 3]


def test_labels_cannot_stand_for_a_force() -> None:
    rule = LevelRule(values=(1, 3), unit="label")
    with pytest.raises(MeasurementError, match="stands for the force, which was not recorded"):
        MeasuredTest((Path("a"), Path("b")), 1, None, Signal(amplitude=2), "displacement", level=rule)


def test_typical_force_is_that_near_the_resonance() -> None:
    force = np.where(np.abs(FREQUENCY - 10) < 0.8, 2.5, 5.0)
    response = force / (
        STIFFNESS - MASS * (2 * np.pi * FREQUENCY) ** 2 + 1j * 2 * np.pi * FREQUENCY * DAMPING
    )
    surface = ResponseSurface(5.0, FREQUENCY, force, response)
    assert typical_amounts(surface).tolist() == [2.5]


@pytest.mark.parametrize(
    ("levels", "asked", "meant"),
    [
        ([2.38636e-09 * (1 + 1.9e-6), 5e-9], 2.38636e-09, 0),
        ([3.4217, 5.0], 3.42, 0),
        ([3.4217, 3.4229], 3.42, None),
        ([3.42, 3.4229], 3.42, 0),
        ([2.6, 5.0], 3.0, None),
        ([58.2134, 28.8], 58.2, 0),
    ],
)
def test_a_level_is_found_by_the_digits_that_are_printed(
    levels: list[float], asked: float, meant: int | None
) -> None:
    assert match_level(np.array(levels), asked) == (None if meant is None else levels[meant])


def test_levels_that_were_all_measured_with_one_force_are_doubted(tmp_path: Path) -> None:
    forces = {"1.csv": 5.0, "3.csv": 5.01, "9.csv": 4.99}
    surface = read_measurement(of_files(tmp_path, forces, level=LevelRule(name="{level}.csv")))
    assert surface.levels.tolist() == [1, 3, 9]
    assert codes(surface)["levels-of-one-force"] == "doubt"
    rule = LevelRule(name="{level}.csv", unit="label")
    assert "levels-of-one-force" not in codes(read_measurement(of_files(tmp_path, forces, level=rule)))
