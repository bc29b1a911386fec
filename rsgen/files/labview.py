"""Measurement files of LabVIEW: .lvm, the channels of each segment; .tdms, groups and channels.

Source of the format .lvm: "Specification for the LabVIEW Measurement File (.lvm)" of National Instruments.
"""

from __future__ import annotations

import io
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import isfinite, isinf, nan
from typing import Any, BinaryIO

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError
from rsgen.files.text_columns import MISSING, decoded, number_in
from rsgen.files.tree import MAX_CHANNELS, Node, array_bytes, is_wanted

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

    def fail(self, what: str) -> MeasurementError:
        return MeasurementError(f"line {self.number}: {what}")

    def next(self) -> list[str] | None:
        """Return the cells of the next line that is neither blank nor in a special block; None at the end."""
        special = False
        while self.number < len(self.lines):
            line = self.lines[self.number].rstrip("\r")
            self.number += 1
            cells = [cell.strip() for cell in line.split(self.sign)]
            if special or cells[0] == _SPECIAL[0]:
                special = cells[0] != _SPECIAL[1]
            elif any(cells):
                return cells
        return None

    def head(self, cells: list[str] | None) -> dict[str, list[str]]:
        """Read lines of a key and what it says, up to the line that ends them."""
        found: dict[str, list[str]] = {}
        while cells is not None and cells[0] != _END:
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
            if len(names) > MAX_CHANNELS:
                raise self.fail(f"{len(names)} columns; at most {MAX_CHANNELS} are read")
            segment.names = names
            segment.values = [array("d") for _ in names]
            cells = self.rows(segment)
            yield segment
            count += 1
            if count > MAX_CHANNELS:
                raise self.fail(f"more than {MAX_CHANNELS} segments; at most that many are read")

    def rows(self, segment: _Segment) -> list[str] | None:
        """Read the rows of a segment; return the first line of the next segment."""
        width = len(segment.names)
        while (cells := self.next()) is not None:
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
        for place, cell in enumerate(cells):
            number = nan if MISSING.match(cell) else number_in(cell, self.decimal)
            if number is None or isinf(number):
                reason = f"{cell[:20]!r} is no number; digits, sign and exponent are allowed"
                segment.faults.setdefault(place, f"line {self.number}: {reason}")
                number = nan
            segment.values[place].append(number)


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
        unit, path = units[place], before + name
        if is_x:
            unit = spelled[about] or _DIMENSIONS.get(kinds[about].casefold(), "")
        if about > place and paired:
            path = f"{before}{segment.names[about]}/{name}"
        if paired:
            first = place if is_x else place - 1
            numbers = _without_tail(values[first : first + 2])[place - first]
        elif is_x and np.isnan(numbers).all() and len(numbers):
            start, step = (number_in(cells[about], reader.decimal) for cells in (starts, steps))
            if step is None or not step > 0:
                continue
            numbers = (start or 0.0) + step * np.arange(len(numbers))
        repeats = 1
        while (unique := path if repeats == 1 else f"{path} ({repeats})") in used:
            repeats += 1
        used.add(unique)
        yield Node(
            unique, numbers.shape, "float64", load=partial(np.asarray, numbers), title=name,
            unit=_LONG_UNITS.get(unit.casefold(), unit), fault=segment.faults.get(place, ""),
            column=place + 1 if only else 0,
        )  # fmt: skip


def walk_lvm(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a measurement file of LabVIEW: channels by name, below k/ where segments are several.

    A column without abscissas is given those that X0 and Delta_X say.

    Raises
    ------
    MeasurementError
        No measurement file of LabVIEW, cut off, or a row that is damaged; the message begins with the line.
    """
    raw = file.read()
    marked = raw[:2] in (b"\xff\xfe", b"\xfe\xff")
    text = decoded(raw, ("utf-16",) if marked else ("utf-8-sig", "cp1252"))
    if text is None:
        raise MeasurementError("is neither UTF-8, UTF-16 nor cp1252; save the file as UTF-8")
    reader = _Reader(text)
    reader.begin()
    segments = list(reader.segments())
    if not any(segment.values[0] for segment in segments):
        raise MeasurementError("no rows of numbers in it; at least one is needed")
    only = len(segments) == 1
    for number, segment in enumerate(segments, start=1):
        yield from _nodes(segment, "" if only else f"{number}/", only, reader)


# ----------------------------------------------------------------------------
# TDMS files of LabVIEW, DIAdem and other programs: groups and channels as a tree of arrays.

_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit", "Units", "units")
"""Properties in which DIAdem, LabVIEW and users keep the unit of a channel."""
_READ = "fiubc"
"""Kinds of numbers; texts and instants of a clock are none."""
_PERIODS = ("", "s")


def sample_tdms() -> bytes:
    """Make a small file."""
    from nptdms import ChannelObject, TdmsWriter  # comes with an extra

    file = io.BytesIO()
    with TdmsWriter(file) as written:
        written.write_segment([ChannelObject("a", "b", np.arange(3.0), {"wf_increment": 0.1})])
    return file.getvalue()


def _text(properties: Mapping[str, Any], *names: str) -> str:
    """Return the first of the named properties that is a text, or ""."""
    found = (properties.get(name) for name in names)
    return next((text.strip() for text in found if isinstance(text, str) and text.strip()), "")


def _step(properties: Mapping[str, Any]) -> float:
    """Return the increment of the abscissa of a waveform, or 0."""
    step = properties.get("wf_increment")
    known = isinstance(step, int | float | np.number) and isfinite(step) and step > 0
    return float(step) if known else 0.0  # type: ignore[arg-type]


def _unit_of_steps(properties: Mapping[str, Any]) -> str:
    """Return the unit of a waveform's abscissa; "" is that of a time."""
    frequency = "freq" in _text(properties, "wf_xname").casefold()
    return _text(properties, "wf_xunit_string") or ("Hz" if frequency else "")


def _even(start: float, step: float, count: int) -> Array:
    return np.asarray(start + step * np.arange(count), dtype=np.float64)


def _abscissas(group: Any) -> Iterator[Node]:
    """Return the sampling rates of a group's waveforms, and the frequencies of its spectra."""
    waves = [channel for channel in group.channels() if _step(channel.properties) and len(channel)]
    sampled = [wave for wave in waves if _unit_of_steps(wave.properties) in _PERIODS]
    rates = {1 / _step(wave.properties) for wave in sampled}
    several = len(rates) > 1 or "rate" in {channel.name for channel in group.channels()}
    for wave in sampled if several else sampled[:1]:
        path = f"{group.name}/{wave.name}/rate" if several else f"{group.name}/rate"
        rate = np.array(1 / _step(wave.properties))
        yield Node(path, (), "float64", load=partial(np.asarray, rate), unit="Hz", remark="sampling rate")
    for wave in waves:
        unit = _unit_of_steps(wave.properties)
        if unit in _PERIODS:
            continue
        start, step, count = wave.properties.get("wf_start_offset", 0.0), _step(wave.properties), len(wave)
        name = _text(wave.properties, "wf_xname") or "abscissa"
        yield Node(
            f"{group.name}/{wave.name}/{name}", (count,), "float64",
            load=partial(_even, float(start), step, count), unit=unit,
        )  # fmt: skip


def _node(path: str, channel: Any, largest: int) -> Node:
    kind = channel.dtype
    if kind.kind not in _READ:
        what = "instants of a clock" if kind.kind == "M" else "no numbers"
        return Node.refused(path, f"holds {what}; real and complex numbers are read", (len(channel),))
    try:
        array_bytes((len(channel),), kind, largest)
    except MeasurementError as fault:
        return Node.refused(path, str(fault), (len(channel),))
    return Node(
        path, (len(channel),), kind.name, load=lambda: channel[:], title=channel.name,
        unit=_text(channel.properties, *_UNITS),
        remark=_text(channel.properties, "description", "NI_ChannelName"),
    )  # fmt: skip


def walk_tdms(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a TDMS file: group/channel, with scalings applied, and group/rate of waveforms.

    Raises
    ------
    MeasurementError
        Cut off, or it declares more numbers than it has bytes.
    """
    from nptdms import TdmsFile  # comes with an extra

    size = file.seek(0, 2)
    file.seek(0)
    book = TdmsFile.open(file)
    status = book.file_status
    chunks = (status.channel_statuses or {}).values()
    if status.incomplete_final_segment or any(c.read_length < c.expected_length for c in chunks):
        raise MeasurementError(
            "its last segment is not whole, so it is cut off; close the recording, send it again"
        )
    channels = [channel for group in book.groups() for channel in group.channels()]
    # numbers are not packed in this format
    declared = sum(len(c) * (c.data_type.size or 0) for c in channels if c.data_type is not None)
    if declared > size:
        raise MeasurementError(f"declares {declared} bytes of numbers; the file has {size}, so it is damaged")
    for group in book.groups():
        if not is_wanted(group.name, heads):
            continue
        for channel in group.channels():
            yield _node(f"{group.name}/{channel.name}", channel, largest)
        yield from _abscissas(group)
