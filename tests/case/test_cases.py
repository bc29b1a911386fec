"""Every case of the paper stays within its `[accept]`, and reports/table1.md says what comes out."""

from functools import cache
from math import log10
from pathlib import Path

import pytest

import rsgen
from benchmarks.table1 import table_of_results
from rsgen.report.provenance import Subject
from rsgen.report.result_json import Parts, build_result, read_results, result_text

ROOT = Path(__file__).parents[2]
CASES = sorted((ROOT / "cases").glob("*.toml"))
PAPER = {"cubic", "cubic-hardening", "quintic", "coulomb", "piecewise", "bilinear", "combined", "joint"}
BEYOND = {"jenkins", "iwan4", "bouc-wen"}

pytestmark = pytest.mark.slow


@cache
def outcome(path: Path) -> tuple[rsgen.Comparison, dict]:
    case = rsgen.load_case(path)
    surface = rsgen.simulate(case.oscillator, case.test)
    identification = rsgen.identify(surface, case.model)
    comparison = rsgen.compare(identification, case.truth, case.accept)
    subject = Subject.of_case(case, identification)
    parts = Parts(subject, surface, identification, comparison, rsgen.Prediction((), (), ()))
    return comparison, build_result(parts, {})


def test_every_system_of_the_paper_has_a_case_and_others_say_that_they_are_beyond_it():
    beyond = {path.stem for path in CASES if rsgen.load_case(path).source.startswith("Beyond the paper: ")}
    assert {path.stem for path in CASES} - beyond == PAPER
    assert beyond == BEYOND


@pytest.mark.parametrize("path", [
    pytest.param(path, marks=[pytest.mark.thorough] if path.stem != "cubic" else []) for path in CASES
], ids=lambda path: path.stem)  # fmt: skip
def test_a_case_is_within_its_tolerances(path):
    comparison, _ = outcome(path)
    judged = [row for row in comparison.rows if row.tolerance is not None]
    assert comparison.passed
    assert judged
    # the tolerances themselves: nobody widens a case unseen
    assert max(row.tolerance for row in judged) <= (5e-4 if path.stem == "joint" else 1e-6)


def cells(table: str) -> list[list[str]]:
    return [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.splitlines() if row[:1] == "|"]


def agrees(one: str, other: str) -> bool:
    """Equal, or errors that rounding to one digit may push to the next on another processor."""
    try:
        a, b = float(one.removeprefix("< ")), float(other.removeprefix("< "))
    except ValueError:
        return one == other
    return abs(a - b) <= 1.001 * 10.0 ** (log10(min(a, b)) // 1)


@pytest.mark.thorough
def test_table_1_is_current(tmp_path):
    for path in CASES:
        folder = tmp_path / path.stem
        folder.mkdir()
        (folder / "result.json").write_text(result_text(outcome(path)[1]), encoding="utf-8")
    made = cells(table_of_results(read_results(tmp_path)))
    saved = cells((ROOT / "reports" / "table1.md").read_text(encoding="utf-8"))
    assert [row[:3] + row[6:] for row in made] == [row[:3] + row[6:] for row in saved]
    for new, old in zip(made, saved, strict=True):
        assert all(agrees(a, b) for a, b in zip(new[3:6], old[3:6], strict=True)), (new, old)
