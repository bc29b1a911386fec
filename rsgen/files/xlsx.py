"""Excel workbooks (.xlsx): the columns of the table of each sheet, by their titles, with stored values.

Formulas are read as the values that the spreadsheet program stored; macros and links to other files are not
looked at.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError
from rsgen.files.column_titles import is_unit, join_units, unit_in
from rsgen.files.text_columns import MISSING, WORD
from rsgen.files.tree import Node, is_wanted, open_archive

MAX_ROWS = 2**20
"""Rows of a sheet, as Excel has them."""
MAX_CELLS = 20_000_000
"""Cells of a sheet, empty ones among others: reading as many takes longer than any file may."""
_MAX_TITLE_LENGTH = 120
_WITHOUT_NUMBERS = (
    "has texts, dates or formulas without stored values; for these open and save the workbook in Excel"
)
_Row = Sequence[Any]


def sample_xlsx() -> bytes:
    """Make a small workbook."""
    from openpyxl import Workbook  # comes with an extra

    file = io.BytesIO()
    book = Workbook()
    book.active.append(["f [Hz]", "date"])
    book.active.append([1.0, datetime(2000, 1, 1)])
    book.save(file)
    return file.getvalue()


def _letter(column: int) -> str:
    """Return the letters of a column by its number from 1: A to Z, AA ..."""
    above, last = divmod(column - 1, 26)
    return (_letter(above) if above else "") + chr(ord("A") + last)


def _is_number(cell: Any) -> bool:
    return isinstance(cell, int | float) and not isinstance(cell, bool)


def _rows(sheet: Any) -> list[tuple[Any, ...]]:
    """Read the rows of a sheet, whatever size it declares."""
    sheet.reset_dimensions()
    rows: list[tuple[Any, ...]] = []
    cells = 0
    for row in sheet.iter_rows(values_only=True):
        cells += len(row) + 1
        if len(rows) >= MAX_ROWS or cells > MAX_CELLS:
            raise MeasurementError(
                f"more than {MAX_ROWS} rows or {MAX_CELLS} cells in a sheet; fewer are read"
            )
        rows.append(row)
    return rows


def _begin(rows: Sequence[_Row]) -> tuple[int, tuple[int, ...]]:
    """Find the first row and the columns of the table; settings above have less than half of its numbers."""
    kinds = [tuple(place for place, cell in enumerate(row) if _is_number(cell)) for row in rows]
    most = max(map(len, kinds), default=0)
    first = next((number for number, kind in enumerate(kinds) if 2 * len(kind) > most), len(rows))
    return first, tuple(sorted(set().union(*kinds[first:])))


def _titles(rows: Sequence[_Row], first: int, columns: Sequence[int], width: int) -> list[str]:
    """Return the titles above a table, with the units of a row of their own."""
    heads: list[list[str]] = []
    for row in reversed(rows[max(0, first - 2) : first]):
        cells = [str(cell).strip()[:_MAX_TITLE_LENGTH] if isinstance(cell, str) else "" for cell in row]
        heads.append([*cells, *[""] * width][:width])
        named = [heads[-1][place] for place in columns if heads[-1][place]]
        if not named or not all(map(is_unit, named)):
            break
    if len(heads) == 2 and any(heads[1]):
        return join_units(heads[1], heads[0])
    return heads[0] if heads else [""] * width


def _column(rows: Sequence[_Row], place: int, begin: int) -> Array:
    """Read a column; words and errors of formulas are numbers that are missing."""
    values = np.full(len(rows), np.nan)
    for number, row in enumerate(rows):
        cell = row[place] if place < len(row) else None
        if _is_number(cell):
            try:
                values[number] = cell
            except OverflowError:
                raise MeasurementError(f"row {begin + number + 1}: a number that is too large") from None
        elif isinstance(cell, str):
            text = cell.strip()
            if not (MISSING.match(text) or WORD.match(text) or text.startswith("#")):
                raise MeasurementError(
                    f"row {begin + number + 1}: {text[:20]!r} is a text; make it a number in the sheet"
                )
    return values


def _table(sheet: str, rows: Sequence[_Row], only: bool) -> Iterator[Node]:
    first, columns = _begin(rows)
    width = max(map(len, rows), default=0)
    titles = _titles(rows, first, columns, width)
    if not columns:
        cells = [cell for row in rows for cell in row[:1]]
        title = next((cell.strip()[:_MAX_TITLE_LENGTH] for cell in cells if isinstance(cell, str)), "")
        yield Node.refused(f"{sheet}/{title or _letter(1)}", _WITHOUT_NUMBERS)
        return
    last = max((n for n, row in enumerate(rows) if any(cell is not None for cell in row)), default=-1)
    below = rows[first : last + 1]
    used: set[str] = set()
    for place in range(width):
        title = titles[place]
        path = f"{sheet}/{title}"
        if path in used or not title:
            path = f"{sheet}/{_letter(place + 1)}"
        used.add(path)
        if place not in columns:
            if title or any(place < len(row) and row[place] is not None for row in below):
                yield Node.refused(path, _WITHOUT_NUMBERS)
            continue
        fault = ""
        values = np.empty(0)
        try:
            values = _column(below, place, first)
        except MeasurementError as error:
            fault = str(error)
        yield Node(
            path, values.shape, "float64", load=partial(np.asarray, values), unit=unit_in(title), title=title,
            fault=fault,
            column=place + 1 if only else 0, row=first + 1,
        )  # fmt: skip


def walk_xlsx(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a workbook: sheet/title of each column of numbers, or sheet/letter where it has no title.

    Raises
    ------
    MeasurementError
        No workbook, damaged, or it unpacks to more than a file of its size may.
    """
    from openpyxl import load_workbook  # comes with an extra

    open_archive(file, largest)
    file.seek(0)
    book = load_workbook(file, read_only=True, data_only=True, keep_links=False)
    sheets = [sheet for sheet in book.worksheets if is_wanted(sheet.title, heads)]
    for sheet in sheets:
        yield from _table(sheet.title, _rows(sheet), len(book.worksheets) == 1)
