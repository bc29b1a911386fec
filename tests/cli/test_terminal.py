"""What a terminal is given to print."""

import pytest

from rsgen.app.cli.terminal import plain
from rsgen.common.finding import Finding, Quantity
from rsgen.report.wording import sentence


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("180\u202f000 \u00d7\u00a01", "180 000 \u00d7 1"),
        ("a\x1b[31m\nb", "a\\x1b[31m\\nb"),
        ("line\u2028end\u202e", "line\\u2028end\\u202e"),
    ],
)
def test_spaces_are_blanks_and_control_characters_are_shown(text, shown):
    assert plain(text) == shown


def test_thousands_in_a_sentence_are_printed_as_numbers():
    numbers = {"value": Quantity(8900.0), "standard_error": Quantity(180_000.0)}
    numbers |= {"amplitude": Quantity(1e-3, "m"), "level": Quantity(2.0, "N")}
    text = plain(sentence(Finding("not-distinct-from-zero", "warning", "c3", numbers)))
    assert "180 000" in text
    assert "\\" not in text
