"""Laws of a report as a whole: with a case file or without one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import rsgen
from rsgen.common.errors import RsgenError
from tests.samples import cubic_case, cubic_model, cubic_surface

SURFACE = cubic_surface()


@pytest.fixture(scope="module")
def found() -> rsgen.Identification:
    return rsgen.identify(SURFACE, cubic_model())


@pytest.mark.slow
def test_a_report_needs_a_surface_and_a_result_only(tmp_path: Path, found: rsgen.Identification) -> None:
    by_place, by_name = tmp_path / "new" / "joint", tmp_path / "named" / "joint"
    rsgen.write_report(by_place, SURFACE, found)
    rsgen.write_report(by_name, surface=SURFACE, identification=found)
    names = sorted(path.name for path in by_place.iterdir())
    assert names == ["kernel.py", "modal.csv", "report.html", "result.json", "surface.h5", "thumbnail.svg"]
    results = [json.loads((place / "result.json").read_text()) for place in (by_place, by_name)]
    assert results[0] == results[1]
    assert results[0]["case"] == "joint"
    assert results[0]["title"] == "n(x, v) = c1*v + k1*x + kn1*x**3"
    values = {row["name"]: row["refined"]["value"] for row in results[0]["parameters"]}
    assert values == {estimate.name: estimate.value for estimate in found}
    assert all(row["true"] is None for row in results[0]["parameters"])
    page = (by_place / "report.html").read_text()
    assert "Case file" not in page
    assert "notebook" not in page


@pytest.mark.slow
def test_a_title_is_shown_as_text(tmp_path: Path, found: rsgen.Identification) -> None:
    rsgen.write_report(tmp_path, SURFACE, found, title="<b>Joint</b>", source="our lab")
    page = (tmp_path / "report.html").read_text()
    assert "<h1>&lt;b&gt;Joint&lt;/b&gt;</h1>" in page
    assert "our lab" in page


@pytest.mark.slow
def test_a_case_brings_the_truth_when_no_comparison_is_given(
    tmp_path: Path, found: rsgen.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[Path] = []
    monkeypatch.setattr("rsgen.report.files.write_notebook", lambda path, *_, **__: written.append(path))
    case = cubic_case()
    compared = rsgen.compare(found, case.truth, case.accept)
    rsgen.write_report(tmp_path / "a", SURFACE, found, case=case, comparison=compared)
    rsgen.write_report(tmp_path / "b", SURFACE, found, case=case)
    one, other = (json.loads((tmp_path / name / "result.json").read_text()) for name in "ab")
    assert one == other
    assert all(row["true"] is not None for row in one["parameters"])
    assert [path.name for path in written] == ["notebook.ipynb"] * 2


def test_names_and_folders_of_another_kind_are_refused(found: rsgen.Identification) -> None:
    wrong: Any = 5
    with pytest.raises(RsgenError, match="folder: int; must be str or Path"):
        rsgen.write_report(wrong, SURFACE, found)
    with pytest.raises(RsgenError, match="identification: int; must be Identification"):
        rsgen.write_report("never", SURFACE, identification=wrong)
