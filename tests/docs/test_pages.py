"""The parts of pages that are made from the source are those of this source."""

import re

import pytest

from docs.pages import MAKERS, pages, renewed

SLOW = {
    "findings.md": pytest.mark.slow,
    "commands.md": pytest.mark.slow,
    "laws.md": pytest.mark.thorough,
    "gallery.md": pytest.mark.thorough,
}
MOST_BYTES = 300_000  # of all pictures: the repository keeps every version


@pytest.mark.parametrize(
    "path", [pytest.param(path, id=path.name, marks=SLOW.get(path.name, ())) for path in pages()]
)
def test_a_page_is_current(path):
    text = path.read_text(encoding="utf-8")
    assert text == renewed(text), "make pages"


def test_every_maker_has_its_page_and_every_picture_is_small():
    texts = {path: path.read_text(encoding="utf-8") for path in pages()}
    assert {name for text in texts.values() for name in re.findall(r"<!-- made: (\w+)", text)} == set(MAKERS)
    shown = [
        path.parent / name for path, text in texts.items() for name in re.findall(r"\]\((\w+\.png)\)", text)
    ]
    assert len(shown) == 2
    assert sum(picture.stat().st_size for picture in shown) < MOST_BYTES
