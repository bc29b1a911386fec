"""The page of what each test can do says what is so."""

from pathlib import Path

import pytest

from tests.capabilities import COLUMNS, EXCITATIONS, MODIFIERS, answer, page, stated

ROWS = {**EXCITATIONS, **MODIFIERS}


def test_the_page_is_current():
    assert Path("docs/capabilities.md").read_text(encoding="utf-8") == page()


@pytest.mark.thorough
@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize("row", ROWS.values(), ids=list(ROWS))
def test_every_cell_is_what_the_page_says(row, column):
    found = answer(row, column)
    # what is not yet possible is refused in a sentence or in a word of the verdict, and never crashes
    assert (found == "yes") == (stated(row, column) == "yes"), found
