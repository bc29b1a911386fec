"""List the arrays in a data file of any format, and recognise the layout of a text."""

from __future__ import annotations

import re
from collections import ChainMap, Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError, shown_path
from rsgen.files import text_columns
from rsgen.files.column_titles import ENCLOSED, is_unit, unit_in
from rsgen.files.data_files import MAX_TEXT_BYTES, open_regular, recognise_format
from rsgen.files.inspection.clues import plain_unit
from rsgen.files.plan import Layout, MeasuredTest
from rsgen.files.sandbox import list_binary
from rsgen.files.signals import star_pattern
from rsgen.files.tree import MAX_CHANNELS, Contents, Entry, facts

LAYOUT_LINES = 300
"""Lines of a text from which its layout is recognised."""
LAYOUT_BYTES = 2**18
"""Bytes of them: enough for 300 lines of 40 columns; every way to split them is tried."""
_MAX_BYTES_COLUMN_BY_COLUMN = 32 * 2**20
"""Where reading each column alone reads more bytes than this in all, none is."""
_HEADER_LINES = 3
"""Lines of a header, at most: names, units, numbers of the channels. So many rows of numbers above a row of
words belong to the table."""


def _kinds(text: str, layout: Layout) -> tuple[bool, ...]:
    cells = text_columns.split_cells(text, layout.delimiter)
    return tuple(text_columns.number_in(cell, layout.decimal) is not None for cell in cells)


def _full(lines: Sequence[tuple[int, str]], layout: Layout) -> tuple[bool, ...]:
    """Return True for each number of the row with most, of those as wide as the last row with a number."""
    kinds = [_kinds(text, layout) for _, text in reversed(lines)]
    width = next((len(row) for row in kinds if any(row)), 0)
    return max((row for row in kinds if len(row) == width), key=sum, default=())


def _row_kind(text: str, layout: Layout, full: tuple[bool, ...]) -> str:
    """Tell a row of "numbers", one with "gaps", one of "words", or "other"."""
    cells = text_columns.split_cells(text, layout.delimiter)
    if text_columns.is_of_words(cells, layout.decimal):
        return "words"
    if len(cells) != len(full):
        return "other"
    asked = [cell for cell, kind in zip(cells, full, strict=True) if kind]
    missing = [cell for cell in asked if text_columns.number_in(cell, layout.decimal) is None]
    if not missing:
        return "numbers"
    gaps = all(text_columns.MISSING.match(cell) or cell[:1].isalpha() for cell in missing)
    return "gaps" if gaps else "other"


def _judge(lines: Sequence[tuple[int, str]], layout: Layout) -> tuple[int, int, int]:
    """Judge a layout: (numbers less other cells in its rows of numbers, first of these, numbers in one).

    Rows of words and rows with gaps among the numbers do not end the table, so that nothing above is lost.
    """
    sign = None if layout.delimiter == "whitespace" else layout.delimiter
    if any(len(text.split(sign, MAX_CHANNELS)) > MAX_CHANNELS for _, text in lines):
        return 0, len(lines), 0
    full = _full(lines, layout)
    if not any(full):
        return 0, len(lines), 0
    kinds: list[str] = []
    for _, text in reversed(lines):
        kinds.insert(0, _row_kind(text, layout, full))
        if kinds[0] == "other":
            break
    begin = len(lines) - len(kinds)
    headers = [lines[begin + place][1].split() for place, kind in enumerate(kinds) if kind == "words"]
    first, stop = len(lines), len(kinds)
    for place in range(len(kinds) - 1, -2, -1):
        if place >= 0 and kinds[place] not in ("words", "other"):
            continue
        # rows of numbers between two rows of words
        block = kinds[place + 1 : stop]
        repeated = place >= 0 and headers.count(lines[begin + place][1].split()) > 1
        if block.count("numbers") >= (1 if first == len(lines) or repeated else _HEADER_LINES):
            first = begin + place + 1
        stop = place
    rows = sum(kind in ("numbers", "gaps") for kind in kinds[first - begin :])
    return (2 * sum(full) - len(full)) * rows, first, sum(full)


def _layout(lines: Sequence[tuple[int, str]], label: str) -> tuple[Layout, int]:
    """Find delimiter, decimal sign and how many lines stand before; and the first row of numbers."""
    candidates = [Layout(delimiter=sign) for sign in (",", ";", "\t", "|", "whitespace")]
    candidates += [Layout(delimiter=sign, decimal=",") for sign in (";", "\t", "|", "whitespace")]
    judged = [(*_judge(lines, layout), layout) for layout in candidates]
    numbers, first, _, layout = max(judged, key=lambda found: (found[0], found[2]))
    if any(text.count(sign) >= MAX_CHANNELS for _, text in lines for sign in ",;\t|"):
        raise MeasurementError(f"{label}: more than {MAX_CHANNELS} columns; at most that many are read")
    if numbers <= 0 and label.endswith(".toml"):
        raise MeasurementError(f"{label}: is a case file, which `rsgen check` reads; a data file is needed")
    if numbers <= 0:
        raise MeasurementError(f"{label}: no rows of numbers in it; a table of numbers is needed")
    return layout, first


def _beginning(lines: Iterable[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Return the lines from which the layout is recognised, the first ones whatever their lengths."""
    left = LAYOUT_BYTES
    for number, text in islice(lines, LAYOUT_LINES):
        yield number, text
        left -= len(text)
        if left < 0 and number >= _HEADER_LINES:
            return


def _list_text(path: Path) -> Contents:
    label = shown_path(path)
    with open_regular(path, MAX_TEXT_BYTES) as file:
        begin = list(_beginning(text_columns.TextLines(file, label).lines()))
        file.seek(0)
        foreign = any(text_columns.decoded(line, ["utf-8"]) is None for line in islice(file, LAYOUT_LINES))
    comments = Layout().comments
    lines = [(n, text) for n, text in begin if text.strip() and not text.lstrip().startswith(comments)]
    if not lines:
        raise MeasurementError(f"{label}: no numbers in it; a table of numbers is needed")
    layout, first = _layout(lines, label)
    head = _head(lines, first, layout)
    units = [ENCLOSED.sub(r"\1", cell) for cell in head] if head and _are_units(head) else []
    below = bool(units) and first > 1
    titles = (_head(lines, first - 1, layout) or [""] * len(units)) if below else head
    # units that ``read_columns`` joins to the names above; others are passed over with these
    joined = below and any(titles) and text_columns.is_of_words(head, layout.decimal)
    joined = joined and all(map(is_unit, filter(None, units)))
    below = below and not joined
    used = first if below or not head else first - 1 - joined
    skip = lines[used - 1][0] if used > 0 else 0
    layout = Layout(layout.delimiter, layout.decimal, comments, skip, "cp1252" if foreign else "auto")
    kinds = _full(lines[first:], layout)
    if layout.delimiter == text_columns.automatic_delimiter(lines[used][1], layout.decimal):
        layout = replace(layout, delimiter="auto")
    if not head:
        titles = _remarked(begin, lines[first][0], len(kinds))
    numbers, faults, passed = _numbers(path, layout, [n for n, kind in enumerate(kinds, start=1) if kind])
    entries = []
    for number, kind in enumerate(kinds, start=1):
        title = titles[number - 1] if titles else ""
        named = title and not below and titles.count(title) == 1 and not title.isdigit()
        entry = Entry(
            path=title if named else str(number),
            dtype="float64" if kind else "",
            unit=units[number - 1] if units else unit_in(title),
            title=title,
            fault=faults.get(number, "") if kind else "is no column of numbers",
        )
        if (values := numbers.get(number)) is not None:
            entry = replace(entry, shape=(values.size,), **facts(values))
        entries.append(entry)
    return Contents(path, "csv", tuple(entries), layout, passed)


def _head(lines: Sequence[tuple[int, str]], first: int, layout: Layout) -> list[str]:
    """Return the cells of the line above if they are names: one a column, and no numbers."""
    if first < 1:
        return []
    cells, below = (text_columns.split_cells(lines[n][1], layout.delimiter) for n in (first - 1, first))
    if len(cells) == len(below) + 1 and cells[-1].casefold() == text_columns.REMARKS:
        cells.pop()
    named = len(cells) == len(below) and all(
        text_columns.number_in(cell, layout.decimal) is None for cell in cells
    )
    return cells if named else []


def _are_units(cells: Sequence[str]) -> bool:
    """Return True if all cells are known units, such as Hz, N, m/s^2, g, deg."""
    return all(not cell.strip("[]()") or is_unit(plain_unit(cell.strip("[]()"))) for cell in cells)


def _remarked(begin: Sequence[tuple[int, str]], first: int, width: int) -> list[str]:
    """Return the names in the last comment above the numbers, as ``read_columns`` does."""
    found = (text_columns.column_names(text.strip(), Layout().comments) for n, text in begin if n < first)
    names = [cells for cells in found if cells is not None]
    return names[-1] if names and len(names[-1]) == width else []


def _numbers(path: Path, layout: Layout, wanted: list[int]) -> tuple[dict[int, Array], dict[int, str], str]:
    """Read columns, together or, where one is at fault, each alone: numbers, faults by column, a remark."""
    try:
        found = text_columns.read_columns(path, layout, wanted)
    except MeasurementError as error:
        if len(wanted) < 2 or len(wanted) * path.stat().st_size > _MAX_BYTES_COLUMN_BY_COLUMN:
            return {}, dict.fromkeys(wanted, str(error)), ""
        numbers, faults, remarks = zip(*(_numbers(path, layout, [number]) for number in wanted), strict=True)
        return dict(ChainMap(*numbers)), dict(ChainMap(*faults)), next(filter(None, remarks), "")
    columns = zip(wanted, map(np.ascontiguousarray, found.values.T), strict=True)
    return dict(columns), {}, _passed(found)


def _passed(found: text_columns.Columns) -> str:
    """Say how many rows of words stand among the numbers."""
    count = len(found.words)
    if not count:
        return ""
    rows = "a row" if count == 1 else f"{count} rows"
    return f"{rows} of words among the numbers, passed over; the first is line {found.words[0]}"


def unread(test: MeasuredTest) -> list[str]:
    """Return the arrays of the first file of a test that its plan does not read.

    Of a whole sheet it is its name, and one of several sheets that are read is named once, ``*/name``.

    None of a text, and none of what has a number in place of a path.
    """
    history = test.history
    asked = [column for channel in test.sources for column in channel.columns]
    instants = (history.time, history.rate_column) if history else ()
    asked += [one for one in (test.frequency, test.level.column, *instants) if one is not None]
    contents = list_contents(test.file)
    if contents.format == "csv" or any(isinstance(one, int) for one in asked):
        return []
    meant = [
        star_pattern(text) for one in asked for text in (str(one), re.sub(r"\[[\d,:]+\]\Z", "", str(one)))
    ]
    arrays = [entry.path for entry in contents.entries if entry.size > 1 and entry.dtype and not entry.fault]
    used = {path for path in arrays if any(pattern.fullmatch(path) for pattern in meant)}
    folders = {path.rpartition("/")[0] for path in used}
    left = [(path, *path.rpartition("/")[::2]) for path in arrays if path not in used]
    shared = Counter(name for _, folder, name in left if folder in folders)
    said = (
        f"{folder}/*" if folder not in folders else f"*/{name}" if shared[name] > 1 else path
        for path, folder, name in left
    )
    return list(dict.fromkeys(said))


def list_contents(path: Path) -> Contents:
    """List what a data file holds.

    Raises
    ------
    MeasurementError
        Missing, no regular file, too large, damaged, or nothing in it.
    """
    known = recognise_format(path)
    return _list_text(path) if known == "csv" else list_binary(path, known)
