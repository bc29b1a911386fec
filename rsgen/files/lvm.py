"""Measurement files of LabVIEW (.lvm): the channels of each segment, by their names, in their units.

Source of the format: "Specification for the LabVIEW Measurement File (.lvm)" of National Instruments.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import inf, isfinite, nan
from typing import BinaryIO

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError
from rsgen.files.text_columns import MAX_COLUMNS, MAX_NUMBER_LENGTH, MISSING, number_in
from rsgen.files.tree import Node

_END = "***End_of_Header***"
_SPECIAL = ("***Start_Special***", "***End_Special***")
_ABSCISSA = "X_Value"
_COMMENT = "Comment"
_SIGNS = {"tab": "\t", "comma": ",", "semicolon": ";"}
_LONG_UNITS = {
    "volts": "V", "newtons": "N", "meters": "m", "seconds": "s", "amps": "A", "hertz": "Hz", "pascals": "Pa",
}  # fmt: skip
_DIMENSIONS = {"time": "s", "frequency": "Hz"}
"""Units of the abscissa where only its dimension is named."""
_MAX_SEGMENTS = 10_000
# what float() and the careful reading take alike
_PLAIN = re.compile(r"[0-9eE+\-.,;\s]*\Z", re.ASCII)


@dataclass(slots=True)
class _Segment:
    """A head and the rows of numbers below it."""

    head: dict[str, list[str]]
    names: list[str] = field(default_factory=list)
    values: list[array[float]] = field(default_factory=list)
    faults: dict[int, str] = field(default_factory=dict)

    def cells(self, key: str) -> list[str]:
        """Return the cells of a row of the head, one a column; "" where a cell is missing."""
        said = self.head.get(key, [])
        paired = self.names.count(_ABSCISSA) > 1
        if paired and len(said) > 1 and said[0] and said[1]:
            # some writers leave no cell for the columns of the abscissas
            said = [cell for pair in zip(said, [""] * len(said), strict=True) for cell in pair]
        return ["", *said, *[""] * len(self.names)][: len(self.names)]


class _Reader:
    def __init__(self, text: str) -> None:
        self.lines = text.split("\n")
        if self.lines[-1].strip():
            raise MeasurementError(
                f"line {len(self.lines)}: the last line has no end, so the file is cut off; send it again"
            )
        self.number = 0
        self.sign = "\t"
        self.decimal = "."
        self.abscissas = "one"

    def fail(self, what: str) -> MeasurementError:
        return MeasurementError(f"line {self.number}: {what}")

    def next(self) -> list[str] | None:
        """Return the cells of the next line that is not blank; None at the end."""
        while self.number < len(self.lines):
            line = self.lines[self.number].rstrip("\r")
            self.number += 1
            if line.strip() and line.strip(f"{self.sign} "):
                return [cell.strip() for cell in line.split(self.sign)]
        return None

    def head(self, cells: list[str] | None) -> dict[str, list[str]]:
        """Read lines of a key and what it says, up to the line that ends them."""
        found: dict[str, list[str]] = {}
        while cells is not None and cells[0] != _END:
            if cells[0] == _SPECIAL[0]:
                while cells is not None and cells[0] != _SPECIAL[1]:
                    cells = self.next()
            else:
                found[cells[0]] = cells[1:]
            cells = self.next()
        if cells is None:
            raise self.fail(f"the file ends before {_END}, so it is cut off; send it again")
        return found

    def begin(self) -> None:
        """Read the head of the file: how its lines are laid out."""
        for line in self.lines[:40]:
            if line.startswith("Separator") and len(line) > len("Separator"):
                said = line[len("Separator") + 1 :].strip("\r\n\t,; ").casefold()
                if said not in _SIGNS:
                    raise MeasurementError(
                        f"its separator is {said[:20]!r}; Tab, Comma and Semicolon are read"
                    )
                self.sign = _SIGNS[said]
                break
        found = self.head(self.next())
        decimal = (found.get("Decimal_Separator") or ["."])[0]
        # between commas a comma stands for nothing
        self.decimal = "," if decimal == "," and self.sign != "," else "."
        self.abscissas = (found.get("X_Columns") or ["One"])[0].casefold()

    def segments(self) -> Iterator[_Segment]:
        cells = self.next()
        count = 0
        while cells is not None:
            segment = _Segment(self.head(cells))
            names = self.next()
            if names is None or names[0] != _ABSCISSA:
                raise self.fail(f"the names of the channels are needed after {_END}, {_ABSCISSA} first")
            while names and names[-1] in ("", _COMMENT):
                names.pop()
            if len(names) > MAX_COLUMNS:
                raise self.fail(f"{len(names)} columns; at most {MAX_COLUMNS} are read")
            segment.names = names
            segment.values = [array("d") for _ in names]
            cells = self.rows(segment)
            yield segment
            count += 1
            if count > _MAX_SEGMENTS:
                raise self.fail(f"more than {_MAX_SEGMENTS} segments; at most that many are read")

    def rows(self, segment: _Segment) -> list[str] | None:
        """Read the rows of a segment; return the first line of the next segment."""
        width = len(segment.names)
        while (cells := self.next()) is not None:
            if cells[0] == _SPECIAL[0]:
                while cells is not None and cells[0] != _SPECIAL[1]:
                    cells = self.next()
                continue
            first = cells[0]
            if first and not first[0].isdigit() and first[0] not in "+-.," and not MISSING.match(first):
                return cells
            if len(cells) < width or any(cells[width + 1 :]):
                raise self.fail(
                    f"{len(cells)} values; the segment has {width} columns, so the line is damaged"
                )
            self.row(segment, cells[:width])
        return None

    def row(self, segment: _Segment, cells: list[str]) -> None:
        text = " ".join(cells)
        if _PLAIN.match(text) and len(text) < MAX_NUMBER_LENGTH and not (self.decimal == "," and "." in text):
            spelled = cells if self.decimal == "." else [cell.replace(",", ".") for cell in cells]
            try:
                numbers = [float(cell) if cell else nan for cell in spelled]
            except ValueError:
                numbers = []
            if numbers and inf not in map(abs, numbers):
                for column, value in zip(segment.values, numbers, strict=True):
                    column.append(value)
                return
        for place, cell in enumerate(cells):
            number = None if MISSING.match(cell) else number_in(cell, self.decimal)
            if not MISSING.match(cell) and (number is None or not isfinite(number)):
                reason = f"{cell[:20]!r} is no number; digits, sign and exponent are allowed"
                segment.faults.setdefault(place, f"line {self.number}: {reason}")
            segment.values[place].append(nan if number is None else number)


def _decoded(raw: bytes) -> str:
    for encoding in ("utf-16",) if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig", "cp1252"):
        try:
            return raw.decode(encoding)
        except UnicodeDecodeError:
            continue
    raise MeasurementError("is neither UTF-8, UTF-16 nor cp1252; save the file as UTF-8")


def _number(cells: Sequence[str], place: int, decimal: str) -> float | None:
    return number_in(cells[place], decimal) if place < len(cells) else None


def _unit(cell: str) -> str:
    return _LONG_UNITS.get(cell.casefold(), cell)


def _without_tail(pair: Sequence[Array]) -> list[Array]:
    """Cut the end off where channels with an abscissa of their own have fewer rows than others."""
    filled = np.flatnonzero(np.isfinite(np.stack(pair)).any(axis=0))
    return [values[: filled[-1] + 1 if len(filled) else 0] for values in pair]


def _nodes(segment: _Segment, before: str, only: bool, reader: _Reader) -> Iterator[Node]:
    """Return the channels of a segment, each with its abscissa if the file has one for each."""
    units, kinds, spelled = (segment.cells(key) for key in ("Y_Unit_Label", "X_Dimension", "X_Unit_Label"))
    starts, steps = (segment.cells(key) for key in ("X0", "Delta_X"))
    values = [np.array(column) for column in segment.values]
    paired = segment.names.count(_ABSCISSA) > 1
    used: set[str] = set()
    for place, name in enumerate(segment.names):
        numbers, is_x = values[place], name == _ABSCISSA
        about = place + 1 if is_x and place + 1 < len(segment.names) else place
        unit = (
            _unit(spelled[about] or _DIMENSIONS.get(kinds[about].casefold(), ""))
            if is_x
            else _unit(units[place])
        )
        path = (
            f"{before}{segment.names[place + 1]}/{name}"
            if is_x and paired and about > place
            else before + name
        )
        if paired:
            first = place if is_x else place - 1
            numbers = _without_tail(values[first : first + 2])[place - first]
        elif is_x and np.isnan(numbers).all() and len(numbers):
            start, step = _number(starts, about, reader.decimal), _number(steps, about, reader.decimal)
            if step is None or not step > 0:
                continue
            numbers = (start or 0.0) + step * np.arange(len(numbers))
        repeats = 1
        while (unique := path if repeats == 1 else f"{path} ({repeats})") in used:
            repeats += 1
        used.add(unique)
        yield Node(
            unique, numbers.shape, "float64", load=partial(np.asarray, numbers), unit=unit, title=name,
            fault=segment.faults.get(place, ""), column=place + 1 if only else 0,
        )  # fmt: skip


def walk_lvm(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a measurement file of LabVIEW: channels by name, below k/ where segments are several.

    A column without abscissas is given those that X0 and Delta_X say.

    Raises
    ------
    MeasurementError
        No measurement file of LabVIEW, cut off, or a row that is damaged; the message begins with the line.
    """
    reader = _Reader(_decoded(file.read()))
    reader.begin()
    segments = list(reader.segments())
    if not any(segment.values[0] for segment in segments):
        raise MeasurementError("no rows of numbers in it; at least one is needed")
    only = len(segments) == 1
    for number, segment in enumerate(segments, start=1):
        yield from _nodes(segment, "" if only else f"{number}/", only, reader)
