"""`rsgen modal`: the table on the terminal, as JSON and as a file, for cases with and without a mass."""

import csv

import pytest

import rsgen
from tests.case_files import law, write_small

HARDENING = {
    **law("k*x + k3*x**3 + c*v", k=5920, k3=3e5, c=3.8), "test.level.values": [1, 2, 4, 8],
    "test.frequency": {"start": 9.3, "stop": 10.9, "count": 17}, "identify.hold_out": [4],
}  # fmt: skip


@pytest.fixture
def case(tmp_path):
    return write_small(tmp_path, changes=HARDENING)


def test_the_table_is_printed_and_written_and_a_held_out_level_scored(case, tmp_path, run_cli):
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


def test_what_cannot_be_tabulated_is_said_with_exit_code_two(tmp_path, run_cli):
    below = HARDENING | {"test.frequency": {"start": 6, "stop": 8, "count": 17}}
    answer = run_cli("modal", write_small(tmp_path, changes=below))
    assert (answer.code, answer.out) == (2, "")
    assert "points lie within 45 degrees of resonance" in answer.err
    assert "sweep the other way" in answer.err
