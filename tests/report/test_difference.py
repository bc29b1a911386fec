"""Two results compared: what moved, by how much of its uncertainty, and whether a verdict was lost."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rsgen.app.cli.diff_command import compare_results, difference_data
from rsgen.common.errors import RsgenError
from rsgen.report.provenance import Subject
from rsgen.report.result_json import build_result, result_text
from rsgen.report.wording.sentences import read_verdict
from tests.samples import (
    cubic_case,
    cubic_comparison,
    cubic_identification,
    cubic_prediction,
    cubic_surface,
)


def write_result(folder: Path, name: str = "cubic", tolerance: float | None = 1e-6, **changes: float) -> Path:
    surface = cubic_surface()
    identification = cubic_identification(surface)
    comparison = cubic_comparison(identification, tolerance)
    prediction = cubic_prediction(surface)
    parts = (
        Subject.of_case(cubic_case(name=name), identification),
        surface,
        identification,
        comparison,
        prediction,
        (),
    )
    result = build_result(*parts, {"surface": 1.0})
    for row in result["parameters"]:
        row["refined"]["value"] *= 1 + changes.get(row["name"], 0.0)
        row["refined"]["standard_error"] = 0.01 * abs(row["refined"]["value"])
        if row["name"] in changes:
            row["passed"] = result["passed"] = False
    # the verdict that belongs to these rows
    del result["verdict"]
    result["verdict"] = read_verdict(result)
    place = folder / name
    place.mkdir(parents=True)
    (place / "result.json").write_text(result_text(result), encoding="utf-8")
    return place


def test_a_result_does_not_differ_from_itself(tmp_path: Path) -> None:
    place = write_result(tmp_path)
    (difference,) = compare_results(place, place)
    assert not difference.changed
    assert not difference.worse
    assert {row.change for row in difference.rows} == {0.0}


def test_a_moved_value_is_given_in_its_standard_errors(tmp_path: Path) -> None:
    before, after = write_result(tmp_path / "a"), write_result(tmp_path / "b", kn1=0.04)
    (difference,) = compare_results(before, after)
    (moved,) = [row for row in difference.rows if row.changed]
    assert moved.name == "kn1"
    # kn1 is negative: times 1.04 it falls by 4 %
    assert moved.change == pytest.approx(-0.04, rel=1e-9)
    # standard errors of 1 % each, the second of a value 4 % larger
    assert moved.in_errors == pytest.approx(-4 / (1 + 1.04**2) ** 0.5, rel=1e-9)
    assert difference.worse
    (back,) = compare_results(after, before)
    assert back.changed
    assert not back.worse


def test_folders_are_compared_case_by_case(tmp_path: Path) -> None:
    for side, names in (("a", ("one", "two")), ("b", ("two", "three"))):
        for name in names:
            write_result(tmp_path / side, name)
    found = {d.case: d.only for d in compare_results(tmp_path / "a", tmp_path / "b")}
    assert found == {"one": "before", "two": "", "three": "after"}


def test_values_without_verdict_are_compared_too(tmp_path: Path) -> None:
    before, after = (write_result(tmp_path / side, tolerance=None) for side in "ab")
    (difference,) = compare_results(before, after)
    assert all(row.passed_before is None and row.passed_after is None for row in difference.rows)
    data = json.loads(json.dumps(difference_data([difference]), allow_nan=False))[0]
    assert data["worse"] is False
    assert data["passed"] == {"before": None, "after": None}
    # what was judged once and is no longer has not become worse, but it has changed
    (loosened,) = compare_results(write_result(tmp_path / "judged"), after)
    assert loosened.changed
    assert not loosened.worse


@pytest.mark.parametrize("content", [None, "", "[]", '{"schema": 1}', "[" * 100_000])
def test_what_is_no_result_gets_a_sentence(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "result.json").write_text(content)
    with pytest.raises(RsgenError, match="holds no result"):
        compare_results(tmp_path, tmp_path)
