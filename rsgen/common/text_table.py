"""Tables for a terminal and a notebook: aligned columns of texts, no sentences."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from math import floor, isfinite, log10, prod
from typing import Any, TypeVar

from rsgen.common.errors import UnknownNameError

T = TypeVar("T")

MAX_DIGITS = 10
"""Of a value in a table: further ones say nothing about a measured structure."""

_LISTED_VALUES, _BRIEF_CHARACTERS = 8, 80
"""Longest array, and longest text of another value, that stands in a line with all fields of an object."""


def short(value: float, digits: int = 5) -> str:
    """Print a number with few digits, "" where it is not known.

    Examples
    --------
    >>> short(0.1 + 0.2), short(float("nan"))
    ('0.3', '')
    """
    return "" if value != value else f"{value:.{digits}g}"


def interval_text(interval: tuple[float, float], number: Callable[[float], str], unit: str = "") -> str:
    """Return an interval in words, its ends as ``number`` writes them; one without limit is not written."""
    low, high = (number(end) if isfinite(end) else "" for end in interval)
    if not (low or high):
        return "not determined"
    ends = f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"
    return f"{ends} {unit}".rstrip()


def with_error(value: float, standard_error: float) -> int:
    """Return the digits a value deserves: two of them beyond the leading digit of its standard error.

    Examples
    --------
    >>> with_error(5000.0, 3.0), with_error(5000.0, 0.0), with_error(1.0, float("inf"))
    (5, 10, 4)
    """
    if not (isfinite(value) and isfinite(standard_error)):
        return 4
    if standard_error <= 0 or value == 0:
        return MAX_DIGITS if value else 4
    return min(max(floor(log10(abs(value))) - floor(log10(standard_error)) + 2, 3), MAX_DIGITS)


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Align columns by blanks, readable by eye and by awk."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]


@dataclass(frozen=True, slots=True)
class TextTable:
    """Rows of texts or numbers under heads, with a line above and lines below.

    Examples
    --------
    >>> print(TextTable(("name", "value"), (("k", "5000"), ("c", "4")), caption="two"))
    two
    name  value
    k     5000
    c     4
    """

    heads: tuple[str, ...]
    rows: tuple[Sequence[Any], ...]
    caption: str = ""
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Aligned columns."""
        cells = [self.heads, *([str(cell) for cell in row] for row in self.rows)]
        return "\n".join([*filter(None, [self.caption]), *aligned(cells), *self.notes])


class Printed:
    """A record that prints as a table, on a terminal and in a notebook."""

    __slots__ = ()

    @property
    def table(self) -> TextTable:
        """The table that is printed."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """Return the table as text."""
        return str(self.table)


class Brief:
    """A dataclass that prints in one line: long arrays by their shape, other long values cut."""

    __slots__ = ()

    def __repr__(self) -> str:
        """Return the fields by name."""
        record: Any = self
        said = (f"{entry.name}={_brief(getattr(self, entry.name))}" for entry in fields(record) if entry.repr)
        return f"{type(self).__name__}({', '.join(said)})"


def _brief(value: object) -> str:
    shape = getattr(value, "shape", ())
    if isinstance(shape, tuple) and prod(shape) > _LISTED_VALUES:
        return f"array of shape {shape}"
    text = " ".join(repr(value).split())
    return text if len(text) <= _BRIEF_CHARACTERS else f"{text[:_BRIEF_CHARACTERS]}..."


def lookup(name: object, known: Mapping[str, T], what: str) -> T:
    """Return what has this name.

    Raises
    ------
    UnknownNameError
        Nothing has it; the message names what there is. It is a ``KeyError``, too.
    """
    if isinstance(name, str) and name in known:
        return known[name]
    raise UnknownNameError(f"{what} {name!r:.80}: there is none; there are {', '.join(known)}")
