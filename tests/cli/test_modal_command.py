"""`rsgen modal`: the table on the terminal, as JSON and as a file, for cases with and without a mass."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rsgen

CASE = """
schema = 1
name   = "mode"
title  = "Hardening spring"
source = "tests"

[system]
mass = "1.5 kg"

[[element]]
name  = "all"
force = "k*x + k3*x**3 + c*v"

[truth]
k  = 5920
k3 = 3e5
c  = 3.8

[test]
kind      = "simulated"
level     = { values = [1, 2, 4, 8] }
frequency = { start = 9.3, stop = 10.9, count = 17 }

[identify]
hold_out = [4]
"""


@pytest.fixture
def case(tmp_path: Path) -> Path:
    path = tmp_path / "mode.toml"
    path.write_text(CASE)
    return path


def test_the_table_is_printed_and_written_and_a_held_out_level_scored(
    case: Path, tmp_path: Path, run_cli: Callable[..., Any]
):
    target = tmp_path / "modal.csv"
    answer = run_cli("modal", case, "--csv", target)
    assert answer.code == 0
    lines = answer.out.splitlines()
    assert lines[0].startswith("Modal table without a law: ")
    assert lines[1].split()[:3] == ["X", "[m]", "frequency"]
    assert "held out 4 N, rest: 17 of 17 points predicted, error" in answer.out
    rows = list(csv.DictReader(target.read_text().splitlines()))
    assert float(rows[0]["damping [N*s/m]"]) == pytest.approx(3.8, rel=1e-3)
    loaded = rsgen.load_case(case)
    table = rsgen.modal_table(rsgen.simulate(loaded.oscillator, loaded.test), loaded.model)
    assert [float(row["amplitude [m]"]) for row in rows] == pytest.approx(list(table.amplitude), rel=1e-9)


def test_programs_get_the_same_numbers(case: Path, run_cli: Callable[..., Any]):
    entry = json.loads(run_cli("modal", case, "--json").out)["modal"]
    assert entry["mass"] == pytest.approx(1.5, rel=1e-3)
    assert len(entry["amplitude"]) == len(entry["frequency_lower"])
    assert [item["level"] for item in entry["held_out"]] == [4.0]


def test_what_cannot_be_tabulated_is_said_with_exit_code_two(case: Path, run_cli: Callable[..., Any]):
    case.write_text(CASE.replace("start = 9.3, stop = 10.9", "start = 6, stop = 8"))
    answer = run_cli("modal", case)
    assert (answer.code, answer.out) == (2, "")
    assert "points lie within 45 degrees of resonance" in answer.err
