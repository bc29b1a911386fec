"""The cells of a line of text: numbers, words, and what stands for a number that is missing."""

from __future__ import annotations

import re
from collections.abc import Sequence

__all__ = [
    "LONGEST_NUMBER", "MISSING", "WORD", "automatic_delimiter", "is_of_words", "number_in", "split_cells",
]  # fmt: skip

LONGEST_NUMBER = 400
"""Signs of a number, at most: the longest double written out has 17 digits behind 308 zeros."""
# every sign fits in one way only, so that a number gone wrong at its end is not tried again from each digit
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?\Z", re.ASCII)
MISSING = re.compile(
    r"(?:[+-]?(?:nan|inf|infinity)|#?n/?a|n\.\s?a\.|null|none|missing|[-\u2013\u2014]{1,3}|\?|)\Z",
    re.IGNORECASE,
)
"""What instruments and programs write in place of a number that is missing."""
WORD = re.compile(r"[^\W\d_]")
"""A cell that begins with a letter is a word; "12a4", "1,5" and "=A1" are numbers gone wrong."""


def split_cells(text: str, delimiter: str | None) -> list[str]:
    """Split a line into cells, without blanks and quotes around them."""
    if delimiter == "whitespace":
        return text.split()
    return [cell.strip().strip('"').strip() for cell in text.split(delimiter)]


def automatic_delimiter(text: str, decimal: str) -> str:
    """Find the delimiter of a line: the first of ; tab , | in it but the decimal sign, else blanks."""
    return next((sign for sign in (";", "\t", ",", "|") if sign != decimal and sign in text), "whitespace")


def number_in(cell: str, decimal: str) -> float | None:
    """Read a plain number (digits, sign, decimal sign, exponent); None where the cell holds none."""
    if decimal == ",":
        cell = cell.replace(",", ".") if "." not in cell else "?"
    return float(cell) if len(cell) <= LONGEST_NUMBER and _NUMBER.match(cell) else None


def is_of_words(cells: Sequence[str], decimal: str) -> bool:
    """Whether a row holds words and no number: a header, units, a remark.

    Examples
    --------
    >>> is_of_words(["f", "F1", ""], "."), is_of_words(["NA", "nan"], "."), is_of_words(["run", "3"], ".")
    (True, False, False)
    """
    found = False
    for cell in cells:
        if cell and not MISSING.match(cell):
            found = True
            word = WORD.match(cell) or not any(map(str.isdigit, cell))
            if not word or number_in(cell, decimal) is not None:
                return False
    return found
