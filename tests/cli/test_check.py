"""What `run` refuses, `check` refuses before it, for the same reason."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from rsgen.app.study import run_case

ROOT = Path(__file__).parents[2]

SIMULATED = """\
schema = 1
name   = "bad"
title  = "Bad"
{top}
[system]
mass = 1.5
{identify}
[[element]]
name  = "spring"
force = "{spring}"

[[element]]
name  = "damper"
force = "{damper}"

[truth]
{truth}

[test]
kind      = "simulated"
level     = {{ values = {levels} }}
frequency = {{ start = 8, stop = 12, count = {count} }}
{test}
"""
GOOD = {
    "top": "",
    "identify": "",
    "spring": "k*x",
    "damper": "c*v",
    "truth": "k = 5920\nc = 3.8",
    "levels": "[1, 3]",
    "count": "15",
    "test": "",
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"identify": '[identify]\nband = ["20 Hz", "30 Hz"]'}, "0 of 30 points can be used"),
        ({"identify": '[identify]\nband = ["8 Hz", "8.05 Hz"]'}, "2 of 30 points can be used"),
        ({"identify": "[identify]\nhold_out = [2]"}, "hold_out"),
        ({"levels": "[1]", "count": "3"}, "3 of 3 points can be used"),
        ({"test": 'control = "phase"\nsweep = "up"'}, "finds its frequency"),
        ({"spring": "k*gamma(x)"}, "gamma"),
        ({"damper": "-c*v"}, "no damping"),
        ({"damper": "c*x"}, "no damping"),
        ({"damper": "c*v*x**2 - 2*c*v*x**2"}, "no damping"),
        ({"spring": "-k*x"}, "negative stiffness"),
        ({"damper": "c*v + 2*sign(v)"}, "dry friction of 2 N"),
    ],
)
def test_a_virtual_test_that_cannot_be_used_is_refused_before_it_is_run(
    tmp_path: Path, run_cli: Callable, changes: dict[str, str], reason: str
) -> None:
    changes = {"levels": "[0.5, 1]"} | changes if "dry" in reason else changes
    path = tmp_path / "bad.toml"
    path.write_text(SIMULATED.format(**GOOD | changes), encoding="utf-8")
    checked = run_cli("check", path)
    assert (checked.code, checked.out) == (2, "")
    assert reason in checked.err
    assert checked.err.startswith("bad.toml: ")
    ran = run_case(path, tmp_path / "out")
    assert ran.passed is None
    assert reason in " ".join(ran.faults)


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"test": 'method = "harmonic-balance"', "damper": "-c*v"},
        {"damper": "c*v*Max(abs(x) - 0.5, 0)"},  # damps large amplitudes only
        {"spring": "-k*x + 1e6*x**3", "truth": "k = 5920\nc = 3.8"},  # two wells
        {"damper": "c*v + 2*sign(v)"},  # holds the lower level only
        {"damper": "1e-6*c*v"},
    ],
)
def test_a_virtual_test_that_may_settle_is_not_refused(
    tmp_path: Path, run_cli: Callable, changes: dict[str, str]
) -> None:
    path = tmp_path / "odd.toml"
    path.write_text(SIMULATED.format(**GOOD | changes), encoding="utf-8")
    assert run_cli("check", path).code == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("[test]", "[identify]\nhold_out = [4]\n\n[test]", "no level 4 N"),
        ("[test]", "[identify]\nhold_out = [1, 3, 6]\n\n[test]", "0 of 123 points can be used"),
        ("[test]", '[identify]\nband = ["20 Hz", "30 Hz"]\n\n[test]', "0 of 123 points can be used"),
        ('"frequency_Hz"', '"frequency"', "no column named 'frequency'"),
        ('"table.csv"', '"other.csv"', "other.csv: cannot be read"),
        ('"table.csv"', '"few.csv"', "3 of 3 points can be used"),
        ('"table.csv"', '"empty.csv"', "empty.csv: no numbers in it"),
    ],
)
def test_a_measured_test_that_cannot_be_used_is_refused_before_it_is_run(
    tmp_path: Path, run_cli: Callable, old: str, new: str, reason: str
) -> None:
    shutil.copy(ROOT / "cases" / "formats" / "table.csv", tmp_path)
    lines = (tmp_path / "table.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "few.csv").write_text("".join(lines[:4]), encoding="utf-8")
    (tmp_path / "empty.csv").write_text("", encoding="utf-8")
    text = (ROOT / "cases" / "formats" / "csv-table.toml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "bad.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    checked = run_cli("check", path)
    assert (checked.code, checked.out) == (2, "")
    assert reason in checked.err
    assert reason in " ".join(run_case(path, tmp_path / "out").faults)


@pytest.mark.slow
def test_a_ranking_without_phase_is_refused_before_it_is_run(tmp_path: Path, run_cli: Callable) -> None:
    for file in ("magnitude_1.0N.csv", "magnitude_3.0N.csv", "magnitude_6.0N.csv"):
        shutil.copy(ROOT / "cases" / "formats" / file, tmp_path)
    text = (ROOT / "cases" / "formats" / "csv-magnitude.toml").read_text(encoding="utf-8")
    path = tmp_path / "bad.toml"
    path.write_text(text.replace("schema = 1", 'schema = 1\nmodel = "rank"'), encoding="utf-8")
    checked = run_cli("check", path)
    assert checked.code == 2
    assert "phase" in checked.err
    assert "phase" in " ".join(run_case(path, tmp_path / "out").faults)


def test_parameters_that_no_test_tells_apart_are_named_before_any_test(
    tmp_path: Path, run_cli: Callable
) -> None:
    path = tmp_path / "product.toml"
    changes = {"spring": "k*g*x", "truth": "k = 5920\nc = 3.8\ng = 1.0"}
    path.write_text(SIMULATED.format(**GOOD | changes), encoding="utf-8")
    checked = run_cli("check", path)
    assert checked.code == 0
    assert "note: only g*k can be identified, not g and k separately" in checked.out
