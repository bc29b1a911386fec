"""The parts of case files in docs/howto/questions.md, completed: each reads the test that it is about."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import rsgen as rs
from docs._extension.snippets import ROOT, find_snippets
from rsgen.data.history import SweepLaw
from tests.case_files import MEASURED, write_small
from tests.measurement.tables import write_columns
from tests.oracles.swept import sweep

PAGE = (ROOT / "docs" / "howto" / "questions.md").read_text(encoding="utf-8")
LAW, MASS = "k*x + k3*x**3 + c*v", 1.5
VALUES = {"k": 6000.0, "k3": 2e6, "c": 6.0}
LEVELS = (1, 3, 6)
RATE, SECONDS = 256.0, 100.0


def blocks(heading: str) -> list[tuple[str, str]]:
    """Kinds and texts of the blocks under a heading."""
    _, _, rest = PAGE.partition(f"## {heading}\n")
    assert rest, heading
    return [(block.kind, block.text) for block in find_snippets(rest.partition("\n## ")[0])]


def case(folder: Path, *parts: str, **more: Any) -> rs.Case:
    """A measured case with tables of the page, one after the other, and more keys."""
    tables: dict[str, Any] = {}
    for part in parts:
        for name, table in tomllib.loads(part).items():
            tables.setdefault(name, {}).update(table)
    named = {f"test.{key}": value for key, value in tables.pop("test", {}).items()}
    law = {"element": [{"name": "all", "force": LAW}]}
    return rs.load_case(write_small(folder, "small", {**MEASURED, **law, **tables, **named, **more}))


def test_a_hanging_mass_has_the_even_term_of_its_stretch():
    """About the place of rest k*x + k3*x**3 of a spring stretched by s has k2 = 3 k3 s."""
    ((kind, text),) = blocks("The mass hangs on its spring: where is gravity?")
    said: dict[str, Any] = {}
    exec(text, said)
    found, rest = said["found"], said["rest"]
    assert (kind, found.verdict.state) == ("{python}", "identified")
    assert 6000.0 * rest + 4e6 * rest**3 == pytest.approx(1.5 * 9.81, rel=1e-9)
    assert found["k2"].value == pytest.approx(3 * 4e6 * rest, rel=1e-4)
    assert found["k"].value == pytest.approx(6000.0 + 3 * 4e6 * rest**2, rel=1e-4)


def near(found: rs.Identification, per: float = 1.0) -> None:
    """Within two per cent: windows and rounded numbers are not exact."""
    assert found.verdict.state == "identified"
    assert {name: found[name].value * per for name in VALUES} == pytest.approx(VALUES, rel=0.02)


@pytest.fixture(scope="module")
def sweeps():
    """Instants, and (n, levels) force and acceleration of a swept sine."""
    law, oscillator = SweepLaw("linear", 8.0, 4.0 / SECONDS), rs.Oscillator(MASS, LAW, VALUES)
    records = [sweep(oscillator, level, law, 12.0, RATE) for level in LEVELS]
    force, motion = (
        np.transpose([getattr(one, name) for one in records]) for name in ("reference", "response")
    )
    time = np.arange(len(force)) / RATE
    return time, force, make_interp_spline(time, motion, k=7).derivative(2)(time)


def test_force_and_response_in_two_files_one_level_held_out(tmp_path, sweeps):
    time, force, acceleration = sweeps
    for number, level in enumerate(LEVELS):
        write_columns(tmp_path / f"u_{level}N.csv", "time_s,force_N", time, force[:, number])
        title = "time_s,acceleration_m/s^2"
        write_columns(tmp_path / f"y_{level}N.csv", title, time, acceleration[:, number])
    ((_, files),) = blocks("Force and response lie in two files, the level in the name")
    ((_, held),) = blocks("One of several files is to be predicted, not fitted")
    read = case(tmp_path, files, held)
    found = rs.identify(rs.read(read), read.model)
    near(found)
    assert [level.force for level in found.held_out] == pytest.approx([3.0], rel=0.05)


def test_irregular_time_stamps_are_sampled_anew_with_the_program_of_the_page(tmp_path, sweeps, monkeypatch):
    time, force, acceleration = sweeps
    late = np.random.default_rng(1).uniform(-0.3, 0.3, len(time)) / RATE
    stamps = time + late
    for number, level in enumerate(LEVELS):
        seen = [np.interp(stamps, time, values[:, number]) for values in (force, acceleration)]
        write_columns(tmp_path / f"raw_{level}N.csv", "time_s,force_N,acceleration_m/s^2", stamps, *seen)
    (_, rough), (kind, program) = blocks("The time stamps are irregular")
    assert kind == "py"
    files = {
        "test.excitation": "swept-sine",
        "test.time": {"column": "time_s"},
        "test.force": {"samples": "force_N"},
        "test.response": {"quantity": "acceleration", "samples": "acceleration_m/s^2"},
    }

    def read(name):
        level = {"test.level": {"name": f"{name}_{{level}}N.csv"}}
        return case(tmp_path, **files, **level, **{"test.file": [f"{name}_{level}N.csv" for level in LEVELS]})

    with pytest.raises(rs.RsgenError, match="off the even spacing"):
        rs.read(read("raw"))
    monkeypatch.chdir(tmp_path)
    exec(compile(program, "page", "exec"), {})
    near(rs.identify(rs.read(read("even")), LAW))
    # a rate alone takes the place of the column
    files["test.time"] = tomllib.loads(rough)["test"]["time"]
    near(rs.identify(rs.read(read("raw")), LAW))
