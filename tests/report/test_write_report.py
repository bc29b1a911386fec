"""Laws of a report as a whole: with a case file or without one."""

import json
from pathlib import Path
from typing import Any

import pytest

import rsgen
from rsgen.common.errors import RsgenError
from tests.samples import cubic_model, cubic_surface

SURFACE = cubic_surface()


@pytest.fixture(scope="module")
def found():
    return rsgen.identify(SURFACE, cubic_model())


def results(*places: Path) -> list[Any]:
    return [json.loads((place / "result.json").read_text()) for place in places]


@pytest.mark.slow
def test_a_report_needs_a_surface_and_a_result_only_and_shows_a_title_as_text(tmp_path, found):
    by_place, by_name = tmp_path / "new" / "joint", tmp_path / "named" / "joint"
    rsgen.write_report(by_place, SURFACE, found)
    rsgen.write_report(by_name, surface=SURFACE, identification=found, title="<b>Joint</b>", source="our lab")
    names = sorted(path.name for path in by_place.iterdir())
    assert names == ["kernel.py", "modal.csv", "report.html", "result.json", "surface.h5"]
    plain, named = results(by_place, by_name)
    assert named | {"title": plain["title"], "source": plain["source"]} == plain
    assert (plain["case"], plain["title"]) == ("joint", "n(x, v) = c1*v + k1*x + kn1*x**3")
    values = {row["name"]: row["refined"]["value"] for row in plain["parameters"]}
    assert values == {estimate.name: estimate.value for estimate in found}
    assert all(row["true"] is None for row in plain["parameters"])
    page = (by_place / "report.html").read_text()
    assert "Case file" not in page
    assert "notebook" not in page
    page = (by_name / "report.html").read_text()
    assert "<h1>&lt;b&gt;Joint&lt;/b&gt;</h1>" in page
    assert "our lab" in page


def test_names_and_folders_of_another_kind_are_refused(found):
    wrong: Any = 5
    with pytest.raises(RsgenError, match="folder: int; must be str or Path"):
        rsgen.write_report(wrong, SURFACE, found)
    with pytest.raises(RsgenError, match="identification: int; must be Identification"):
        rsgen.write_report("never", SURFACE, identification=wrong)
