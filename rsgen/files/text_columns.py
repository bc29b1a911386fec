"""Numbers in columns of a text file: line by line, sizes first, every number checked, formulas are text.

Only the columns asked for are read as numbers; others may hold dates and remarks. A cell where a number is
missing ("NA", "nan", nothing) is a NaN, a row of words (a header that repeats) is passed over and counted,
and whatever else is no plain finite number refuses the file with the line.
"""

from __future__ import annotations

import io
import os
import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError, quote, shown_path, suggest
from rsgen.files.column_titles import join_units
from rsgen.files.data_files import MAX_TEXT_BYTES, check_digest, open_regular
from rsgen.files.signals import star_pattern
from rsgen.files.tree import MAX_CHANNELS

if TYPE_CHECKING:
    from rsgen.files.plan import Layout

# ----------------------------------------------------------------------------
# The cells of a line of text: numbers, words, and what stands for a number that is missing.

MAX_NUMBER_LENGTH = 400
"""Signs of a number, at most: the longest double written out has 17 digits behind 308 zeros."""
# every sign fits in one way only, so that a number gone wrong at its end is not tried again from each digit
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?\Z", re.ASCII)
MISSING = re.compile(
    r"(?:[+-]?(?:nan|inf|infinity)|#?n/?a|n\.\s?a\.|null|none|missing|[-\u2013\u2014]{1,3}|\?|)\Z",
    re.IGNORECASE,
)
"""Texts that instruments and programs write in place of a number that is missing."""
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
    return float(cell) if len(cell) <= MAX_NUMBER_LENGTH and _NUMBER.match(cell) else None


def is_of_words(cells: Sequence[str], decimal: str) -> bool:
    """Return True if a row holds words and no number: a header, units, a remark.

    Examples
    --------
    >>> is_of_words(["f", "F1", ""], "."), is_of_words(["NA", "nan"], "."), is_of_words(["run", "3"], ".")
    (True, False, False)
    """
    found = False
    for cell in cells:
        if cell and not MISSING.match(cell):
            found = True
            word = WORD.match(cell.lstrip("[(")) or not any(map(str.isdigit, cell))
            if not word or number_in(cell, decimal) is not None:
                return False
    return found


# ----------------------------------------------------------------------------
# Lines of a text file, one by one or many at once: their lengths, their bytes and their encoding checked.

MAX_LINE = 1_000_000
BLOCK_BYTES = 1 << 18
"""Bytes read at once: thousands of lines, and little against the memory of a program."""


def decoded(raw: bytes, encodings: Sequence[str]) -> str | None:
    """Decode bytes by the first encoding that fits; None where none does."""
    for encoding in encodings:
        try:
            return raw.decode(encoding)
        except UnicodeDecodeError:
            continue
    return None


class TextLines:
    """The lines of an open file, from where it stands.

    Parameters
    ----------
    file, name
        The file, and what messages call it.
    encoding
        "auto" for UTF-8, else Windows' Latin; or a name of Python's.
    """

    def __init__(self, file: IO[bytes], name: str, encoding: str = "auto") -> None:
        self.number = 0
        """Lines given so far."""
        self._file, self._name = file, name
        self._encodings = ("utf-8", "cp1252") if encoding == "auto" else (encoding,)

    def lines(self) -> Iterator[tuple[int, str]]:
        """Return number and text of each line; a block that is taken between two of them is left out.

        Raises
        ------
        MeasurementError
            A line is too long, has a zero byte or a carriage return in it, or another encoding.
        """
        while raw := self._file.readline(MAX_LINE + 1):
            yield self._text(raw)

    def texts(self, block: bytes) -> Iterator[tuple[int, str]]:
        """Return number and text of each line of a block; raises as ``lines``."""
        # bytes.splitlines would end lines at a carriage return, too
        return map(self._text, io.BytesIO(block))

    def block(self) -> bytes:
        """Return complete lines of about ``BLOCK_BYTES`` bytes, not yet counted; nothing at the end."""
        begin = self._file.read(BLOCK_BYTES)
        if begin and not begin.endswith(b"\n"):
            begin += self._file.readline(MAX_LINE + 1)
        return begin

    def _text(self, raw: bytes) -> tuple[int, str]:
        self.number += 1
        place = f"{self._name}: line {self.number}"
        if len(raw) > MAX_LINE:
            raise MeasurementError(f"{place}: longer than {MAX_LINE} bytes; is it a text file?")
        if self.number == 1:
            raw = raw.removeprefix(b"\xef\xbb\xbf")
        if b"\x00" in raw:
            raise MeasurementError(f"{place}: contains a zero byte; save the file as text in UTF-8")
        text = decoded(raw, self._encodings)
        if text is None:
            raise MeasurementError(
                f"{place}: not {' or '.join(self._encodings)}; save the file as UTF-8, or name its encoding "
                "in test.layout.encoding"
            )
        text = text.rstrip("\r\n")
        if "\r" in text:
            raise MeasurementError(f"{place}: a carriage return inside the line; end lines with \\n")
        return self.number, text


# ----------------------------------------------------------------------------
# Many rows of plain numbers at once, in compiled code; whatever else a row may hold is read line by line.

PLAIN = "0123456789eE+-.,;| \t\r\n"
"""Signs of rows of plain numbers. Without letters but e, and without underscores, a cell that Python or NumPy
converts is a plain number."""

_PLAIN_BYTES = PLAIN.encode()
_LONG = re.compile(rb"[0-9eE+\-.]{%d}" % (MAX_NUMBER_LENGTH + 1))


def plain_rows(block: bytes, delimiter: str, decimal: str) -> Array | None:
    """Read rows of equally many plain finite numbers.

    Parameters
    ----------
    block
        Whole lines.
    delimiter
        Between two cells, or "whitespace".
    decimal
        "." or ",".

    Returns
    -------
    Array or None
        (lines, cells), as Python's float reads each cell. None where any line is something else: empty, of
        another number of cells, a cell empty, of words, too long or beyond the range of a double.
    """
    if block.translate(None, _PLAIN_BYTES) or not block.strip():
        return None
    if decimal == ",":
        if b"." in block:
            return None
        block = block.replace(b",", b".")
    ends = np.flatnonzero(np.frombuffer(block, dtype=np.uint8) == ord("\n"))
    rows = len(ends) + (not block.endswith(b"\n"))
    lengths = np.diff(ends, prepend=-1, append=len(block))
    if lengths.max() > MAX_NUMBER_LENGTH and _LONG.search(block):
        return None
    try:
        values = np.loadtxt(
            io.BytesIO(block),
            delimiter=None if delimiter == "whitespace" else delimiter,
            comments=None,
            ndmin=2,
            encoding="ascii",
        )
    except ValueError:
        return None
    # NumPy passes over empty lines, which end a block of rows here, and ends a line at a carriage return
    return values if len(values) == rows and np.isfinite(values).all() else None


MAX_ROWS = 3_000_000
"""Rows of a text: ten minutes at 5 kHz; longer histories are kept in binary formats."""
REMARKS = "comment"
"""Title of the last column of LabVIEW's measurement files, which the rows leave out."""
_FORMULA = ("=", "+", "-", "@")


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Some columns of a file.

    Parameters
    ----------
    values
        (n, c) numbers, the columns asked for in that order, those of a * in the file's; NaN where one is
        missing.
    line
        (n,) line of each row in the file, from 1.
    block
        (n,) number of the block of each row; blank lines, comments and rows of words separate blocks.
    names
        What the header, passed over or not, calls the columns asked for; "" where it does not say.
    words
        Lines among the numbers that hold words only, as a header that repeats; they are passed over.
    spans
        To how many of these columns each address led; more than one where it has a *.
    ended
        False where the last row has no line end, as that of a file that was cut off.
    """

    values: Array
    line: NDArray[np.int64]
    block: NDArray[np.int64]
    names: tuple[str, ...] = ()
    words: tuple[int, ...] = ()
    spans: tuple[int, ...] = ()
    ended: bool = True


def column_names(line: str, comments: Sequence[str]) -> list[str] | None:
    """Return the names in a comment above the numbers; None where the line is no comment."""
    sign = next((sign for sign in comments if line.startswith(sign)), None)
    return None if sign is None else re.split(r"[\s,;|]+", line.removeprefix(sign).strip())


class _Table:
    """The state of reading: delimiter and columns are settled by the first line that is no comment."""

    def __init__(self, name: str, layout: Layout, wanted: Sequence[int | str]) -> None:
        self.name = name
        self.layout = layout
        self.wanted = wanted
        self.delimiter: str | None = None if layout.delimiter == "auto" else layout.delimiter
        self.width = 0
        self.widths: tuple[int, ...] = ()
        self.places: list[int] = []
        self.spans: tuple[int, ...] = ()
        self.names: tuple[str, ...] = ()
        self.remark: list[str] = []
        self.skipped = ""
        self.values = array("d")
        self.lines = array("q")
        self.blocks = array("q")
        self.words = array("q")
        self.block = 0
        self.separated = False

    def fail(self, line: int, what: str) -> MeasurementError:
        return MeasurementError(f"{self.name}: line {line}: {what}")

    def settle(self, line: int, text: str) -> None:
        """Find delimiter, number of columns and places of the wanted ones from the first line."""
        if self.delimiter is None:
            self.delimiter = automatic_delimiter(text, self.layout.decimal)
        cells = split_cells(text, self.delimiter)
        self.width = len(cells)
        if self.width > MAX_CHANNELS:
            raise self.fail(line, f"{self.width} columns; at most {MAX_CHANNELS} are read")
        header = all(number_in(cell, self.layout.decimal) is None for cell in cells)
        above = column_names(self.skipped, self.layout.comments) or split_cells(self.skipped, self.delimiter)
        if not self.remark and is_of_words(above, self.layout.decimal):
            self.remark = above
        names = cells if header else self.remark if len(self.remark) == self.width else []
        for name in names if header else []:
            if name.startswith(_FORMULA):
                raise self.fail(
                    line, f"column name {quote(name)} looks like a formula; a plain name is needed"
                )
        places = [self.place(line, column, names) for column in self.wanted]
        self.spans = tuple(map(len, places))
        self.places = [place for found in places for place in found]
        self.names = tuple(names[place] if names else "" for place in self.places)
        self.widths = (self.width,)
        if names and names[-1].casefold() == REMARKS and self.width - 1 not in self.places:
            self.widths = (self.width, self.width - 1)
        if not header:
            self.row(line, text)

    def place(self, line: int, column: int | str, names: list[str]) -> list[int]:
        if isinstance(column, int):
            if not 1 <= column <= self.width:
                raise self.fail(line, f"no column {column}; the file has {self.width}")
            return [column - 1]
        found = [place for place, name in enumerate(names) if name == column]
        if "*" in column and not found:
            pattern = star_pattern(column)
            found = [place for place, name in enumerate(names) if pattern.fullmatch(name)]
        if len(found) == 1 or (found and "*" in column):
            return found
        if found:
            raise self.fail(line, f"{len(found)} columns are named {quote(column)}; give the column's number")
        known = ", ".join(quote(name) for name in names[:12]) or "none, the file has no header; give a number"
        raise self.fail(line, f"no column named {quote(column)}; {suggest(column, names)}known: {known}")

    def row(self, line: int, text: str) -> None:
        values = self.cells(line, text)
        if values is None:
            # words before the first number are the header's, such as units below the names
            if self.lines:
                self.words.append(line)
            elif len(units := split_cells(text, self.delimiter)) == self.width:
                self.names = tuple(join_units(self.names, [units[place] for place in self.places]))
            self.separated = True
            return
        self.values.extend(values)
        if self.separated and self.lines:
            self.block += 1
        self.separated = False
        self.lines.append(line)
        self.blocks.append(self.block)
        if len(self.lines) > MAX_ROWS:
            raise self.fail(line, f"more than {MAX_ROWS} rows; at most that many are read")

    def cells(self, line: int, text: str) -> list[float] | None:
        """Read a line cell by cell, say what is wrong with the first faulty one; None for a row of words."""
        cells = split_cells(text, self.delimiter)
        if is_of_words(cells, self.layout.decimal):
            return None
        if len(cells) not in self.widths:
            raise self.fail(line, f"{len(cells)} values; every line must have {self.width}, as the first")
        numbers = [number_in(cells[place], self.layout.decimal) for place in self.places]
        for place, value in zip(self.places, numbers, strict=True):
            cell = cells[place]
            if value is None and not (MISSING.match(cell) or WORD.match(cell)):
                raise self.fail(line, f"column {place + 1}: {self.reason(cell)}")
            if value is not None and not isfinite(value):
                raise self.fail(line, f"column {place + 1}: {quote(cell)} is too large for a number")
        return [nan if value is None else value for value in numbers]

    def reason(self, cell: str) -> str:
        if len(cell) > MAX_NUMBER_LENGTH:
            return f"{quote(cell)} has {len(cell)} signs; a number has at most {MAX_NUMBER_LENGTH}"
        if self.layout.decimal == "." and "," in cell:
            return f"{quote(cell)} is no number; for a decimal comma set test.layout.decimal = ','"
        return f"{quote(cell)} is no number; digits, sign, decimal point and exponent are allowed"

    def take_many(self, line: int, block: bytes) -> int:
        """Read whole lines that hold nothing but plain numbers; how many, 0 where some hold other things."""
        if self.delimiter is None or any(not sign.strip(PLAIN) for sign in self.layout.comments):
            return 0
        values = plain_rows(block, self.delimiter, self.layout.decimal)
        if values is None or values.shape[1] not in self.widths or len(self.lines) + len(values) > MAX_ROWS:
            return 0
        self.values.frombytes(np.ascontiguousarray(values[:, self.places]).tobytes())
        self.block += self.separated and bool(self.lines)
        self.separated = False
        self.lines.extend(range(line, line + len(values)))
        self.blocks.extend([self.block] * len(values))
        return len(values)

    def take(self, line: int, text: str) -> None:
        stripped = text.strip()
        if self.width and stripped and not stripped.startswith(self.layout.comments):
            self.row(line, text)
            return
        names = column_names(stripped, self.layout.comments)
        if not stripped or names is not None:
            self.separated = True
            if names is not None and not self.width:
                self.remark = names
        else:
            self.settle(line, text)


def _fill(table: _Table, source: TextLines, skip: int) -> None:
    """Take lines one by one up to the first row of numbers, then by blocks where all lines are such rows."""
    for line, text in source.lines():
        if line > skip:
            table.take(line, text)
        else:
            # names and units stand there all the same
            table.skipped = text.strip() or table.skipped
        if table.lines:
            break
    while block := source.block():
        many = table.take_many(source.number + 1, block)
        source.number += many
        for line, text in () if many else source.texts(block):
            table.take(line, text)


def read_columns(
    path: Path, layout: Layout, wanted: Sequence[int | str], sha256: str | None = None
) -> Columns:
    """Read columns of a text file as numbers, NaN where one is missing.

    Parameters
    ----------
    path
        The file, at most 256 MiB.
    layout
        Delimiter, decimal sign, comments, lines to skip.
    wanted
        Column numbers from 1, or names: of the header, or of a comment right above the numbers. A name with a
        * means all columns that are called so with something in its place.
    sha256
        What the file must hash to, if known.

    Returns
    -------
    Columns
        At least one row.

    Raises
    ------
    MeasurementError
        File missing, no regular file, too large, not text; a row with fewer or more cells than
        the first; a wanted cell that is neither a number nor a word; a column that is not there; the hash
        differs.
    """
    name = shown_path(path)
    table = _Table(name, layout, wanted)
    with open_regular(path, MAX_TEXT_BYTES) as file:
        source = TextLines(file, name, layout.encoding)
        try:
            check_digest(file, name, sha256)
            _fill(table, source, layout.skip)
            rows = len(table.lines)
            if not rows:
                raise MeasurementError(f"{name}: no numbers in it; at least one row is needed")
            file.seek(-1, os.SEEK_END)
            ended = file.read() == b"\n"
        except OSError as fault:
            raise MeasurementError(f"{name}: cannot be read: {fault.strerror}; try again") from fault
    return Columns(
        values=np.array(table.values).reshape(rows, len(table.places)),
        line=np.array(table.lines, dtype=np.int64),
        block=np.array(table.blocks, dtype=np.int64),
        names=table.names,
        words=tuple(table.words),
        spans=table.spans,
        ended=ended or table.lines[-1] < source.number,
    )
