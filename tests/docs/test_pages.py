"""Pages that are made from the source are current: findings, capabilities, pictures."""

import re
from pathlib import Path

import pytest

from docs._extension.made_findings import places_of_findings
from docs.pages import MAKERS, pages, renewed
from rsgen.report.sentences import CODES, NEXT_STEPS
from tests.capabilities import COLUMNS, EXCITATIONS, MODIFIERS, answer, page, stated

SLOW = dict.fromkeys(("findings.md", "commands.md"), pytest.mark.slow)
SLOW |= dict.fromkeys(("laws.md", "gallery.md"), pytest.mark.thorough)
MOST_BYTES = 300_000  # of all pictures: the repository keeps every version


@pytest.mark.parametrize("path", [pytest.param(p, id=p.name, marks=SLOW.get(p.name, ())) for p in pages()])
def test_a_page_is_current(path):
    text = path.read_text(encoding="utf-8")
    assert text == renewed(text), "make pages"


def test_every_maker_has_its_page_and_every_picture_is_small():
    made, shown = set[str](), list[Path]()
    for path in pages():
        text = path.read_text(encoding="utf-8")
        made.update(re.findall(r"<!-- made: (\w+)", text))
        shown += [path.parent / name for name in re.findall(r"\]\((\w+\.png)\)", text)]
    assert (made, len(shown)) == (set(MAKERS), 2)
    assert sum(picture.stat().st_size for picture in shown) < MOST_BYTES


@pytest.mark.slow
def test_every_finding_has_a_place_and_a_severity_and_a_grave_one_a_next_step():
    places = places_of_findings()
    assert set(places) == set(CODES) - {"note"}
    assert [code for code, made in places.items() if not all(place.severities for place in made)] == []
    severities = {code: {name for one in made for name in one.severities} for code, made in places.items()}
    grave = {code for code, names in severities.items() if names & {"doubt", "error"}}
    assert {"law-does-not-fit", "structure-feeds-exciter"} <= grave
    assert grave - set(NEXT_STEPS) == set(), "add the next step in findings.toml"
    assert set(NEXT_STEPS) <= set(CODES)


def test_the_page_of_capabilities_is_current():
    assert Path("docs/capabilities.md").read_text(encoding="utf-8") == page()


@pytest.mark.thorough
@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize("name", [*EXCITATIONS, *MODIFIERS])
def test_every_cell_is_what_the_page_says(name, column):
    row = (EXCITATIONS | MODIFIERS)[name]
    found = answer(row, column)
    # what is not yet possible is refused in a sentence or in a word of the verdict, and never crashes
    assert (found == "yes") == (stated(row, column) == "yes"), found
