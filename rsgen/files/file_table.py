"""One file as a table: every column that the plan asks for, of one length, whatever the format."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import MeasurementError, quote, shown_path
from rsgen.common.finding import Finding, Severity, quantities
from rsgen.data.record_set import DERIVATIVE
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.files.column_titles import (
    VOLTAGES,
    column_read_in,
    contradiction,
    is_of_signal,
    unit_doubts,
    unit_in,
)
from rsgen.files.data_files import recognise_format
from rsgen.files.plan import MeasuredTest
from rsgen.files.sandbox import read_binary
from rsgen.files.signals import RADIANS, Channel, star_pattern
from rsgen.files.text_columns import Columns, read_columns
from rsgen.files.tree import StoredArray
from rsgen.formula.units import sensor_size

# ----------------------------------------------------------------------------
# Channels whose unit the case leaves to the file, brought to SI.

_SCALES = {
    "rms": ("root mean squares", "scale = 'rms'"),
    "peak": ("peak amplitudes", "scale = 'peak'"),
    "half-peak": ("halves of the peak amplitudes", "factor = 2"),
}
"""Kind of the amplitudes of a file by its word for them, and the entry that the case needs."""


def _check_scale(test: MeasuredTest, label: str, column: int | str, array: StoredArray) -> None:
    """Refuse amplitudes that the file says to be others than the case reads."""
    for channel in test.sources:
        if not array.scale or column not in channel.columns or column == channel.phase:
            continue
        said, needed = _SCALES[array.scale]
        fits = channel.factor != 1 if array.scale == "half-peak" else channel.scale == array.scale
        if not fits:
            raise MeasurementError(
                f"{label}: {quote(array.path)} holds {said}, as the file says; write {needed} in the case"
            )


def scaled(values: NDArray[Any], factor: float) -> NDArray[Any]:
    """Multiply; floating numbers times one are not copied, as histories may be long."""
    if values.dtype.kind not in "fc" or values.dtype == np.float16:
        # 16 bits fit into single precision
        values = values.astype(np.float32 if values.dtype.itemsize <= 2 else np.float64)
    return values if factor == 1 else values * values.dtype.type(factor)


Groups = dict[int | str, list[StoredArray]]
"""The channels that each address means."""


def to_si(test: MeasuredTest, label: str, groups: Groups) -> tuple[Finding, ...]:
    """Bring channels to SI, in place, where the case leaves the unit to the file.

    Parameters
    ----------
    test, label
        The plan, and the file for messages.

    Returns
    -------
    A finding for each unit that was taken from the file and is not SI, or that could not be taken.

    Raises
    ------
    MeasurementError
        The file contradicts itself about a unit, or the case about the kind of amplitudes.
    """
    findings = {}
    left = {
        column: channel
        for channel in test.sources
        if channel.unit is None and test.calibrated
        for column in channel.columns
        if column != channel.phase
    }
    for address, channels in groups.items():
        source = left.get(address)
        target = test.unit_of(source) if source else ""
        for channel in channels:
            _check_scale(test, label, address, channel)
        for number, channel in enumerate(channels if target else ()):
            if channel.unit_source and not channel.unit:
                raise MeasurementError(
                    f"{label}: the unit of {quote(channel.path)} is not known: {channel.unit_source}; "
                    "name it by unit in the case"
                )
            factor = sensor_size(channel.unit or target, target)
            if factor is None:
                # a unit of another dimension than the quantity
                about = {"file": label, "column": str(address), "unit": target, "title": channel.unit}
                # a factor may be that of a sensor's volts
                known = source is not None and source.factor != 1 and channel.unit in VOLTAGES
                severity: Severity = "doubt" if is_of_signal(channel.unit) and not known else "warning"
                findings[channel.unit, address] = Finding("unit-contradicts-title", severity, names=about)
                continue
            if factor != 1:
                about = {"file": label, "column": str(address), "unit": channel.unit}
                about["source"] = channel.unit_source or "the file"
                findings[channel.unit, address] = Finding("unit-of-file", "info", names=about)
            elif not channel.unit:
                about = {"default": column_read_in(address, target)}
                findings["", address] = Finding("unit-of-file", "info", names=about)
            channels[number] = replace(
                channel, values=scaled(channel.values, factor), unit=target, unit_source=""
            )
    return tuple(findings.values())


MAX_ROWS = 5_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of one file.

    Parameters
    ----------
    label
        The file, for messages.
    columns
        (n,) numbers by address, real or complex.
    unit_of_place
        "line" or "row": what ``number`` counts.
    number
        (n,) place of each row in the file, from 1.
    block
        (n,) number of the block of each row: of the text's blocks, or of the entries that a * means.
    findings
        About units, and rows of words that were passed over.
    names
        What the header or the path calls each column, or its number.
    units
        The unit that the file names for a column that was not converted; "" where it names none.
    entries
        What each of several blocks is called that a * means, such as a sheet; () where there is no *.
    """

    label: str
    columns: dict[int | str, NDArray[Any]]
    unit_of_place: str
    number: NDArray[np.int64]
    block: NDArray[np.int64]
    findings: tuple[Finding, ...] = ()
    names: dict[int | str, str] = field(default_factory=dict)
    units: dict[int | str, str] = field(default_factory=dict)
    entries: tuple[str, ...] = ()

    def refuse(self, bad: NDArray[np.bool_], what: str) -> None:
        """Raise a fault that names the first bad row, if there is one."""
        if bad.any():
            raise MeasurementError(
                f"{self.label}: {self.unit_of_place} {int(self.number[int(np.argmax(bad))])}: {what}"
            )

    def real(self, column: int | str) -> Array:
        """Return a column of real numbers; a column of a complex matrix has imaginary parts of zero."""
        values = self.columns[column]
        if np.iscomplexobj(values) and values.imag.any():
            raise MeasurementError(
                f"{self.label}: {quote(column)} is complex; name it by 'complex', or name a real one"
            )
        return np.asarray(np.real(values), dtype=np.float64)

    def keep(self, mask: NDArray[np.bool_]) -> Table:
        """Keep some rows."""
        columns = {name: values[mask] for name, values in self.columns.items()}
        return replace(self, columns=columns, number=self.number[mask], block=self.block[mask])


def _stars(pattern: object, path: str) -> tuple[str, ...]:
    """Return the texts that the * of an address match in a path."""
    found = star_pattern(re.sub(r"\[[\d,:]+\]\Z", "", str(pattern))).fullmatch(path)
    return found.groups() if found else (path,)


def _entries(label: str, groups: Groups) -> list[dict[int | str, NDArray[Any]]]:
    """Sort what wildcards found into entries: the same * stands for the same name in every column."""
    keys = {a: [_stars(a, one.path) for one in group] for a, group in groups.items() if "*" in str(a)}
    first, known = next(iter(keys.items()), ("", [()]))
    for address, found in keys.items():
        if found != known:
            raise MeasurementError(
                f"{label}: {quote(first)} means {len(known)} entries and {quote(address)} others "
                f"({len(found)}); every entry must have both"
            )
    return [
        {a: group[number if a in keys else 0].values for a, group in groups.items()}
        for number in range(len(known))
    ]


def _axis(label: str, name: int | str, values: NDArray[Any], shape: tuple[int, ...]) -> int:
    """Find the side of a matrix that a row of numbers belongs to."""
    places = [axis for axis, length in enumerate(shape) if length == values.size]
    if len(places) > 1 and values.ndim == len(shape):
        places = [axis for axis in places if values.shape[axis] == values.size]
    if len(places) != 1:
        sides = " x ".join(map(str, shape))
        why = "no side" if not places else "more than one side"
        raise MeasurementError(
            f"{label}: {quote(name)} has {values.size} numbers, which fit {why} of {sides}; "
            "columns must have one length, or be the sides of one matrix"
        )
    return places[0]


def _aligned(
    label: str, arrays: dict[int | str, NDArray[Any]], along: int | str | None
) -> dict[int | str, NDArray[Any]]:
    """Bring scalars, rows and matrices to one length; ``along`` varies fastest."""
    squeezed = {name: values.squeeze() for name, values in arrays.items()}
    shapes = {values.shape for values in squeezed.values() if values.ndim > 1}
    if len(shapes) > 1:
        sides = " and ".join(" x ".join(map(str, shape)) for shape in sorted(shapes))
        raise MeasurementError(f"{label}: matrices of {sides}; all must have the same sides")
    if not shapes:
        lengths = {values.size for values in squeezed.values() if values.ndim == 1}
        if len(lengths) > 1:
            sizes = ", ".join(f"{quote(name)} {values.size}" for name, values in squeezed.items())
            raise MeasurementError(f"{label}: columns differ in length: {sizes}; one length is needed")
        length = lengths.pop() if lengths else 1
        return {name: np.broadcast_to(values, (length,)) for name, values in squeezed.items()}
    (shape,) = shapes
    last = len(shape) - 1
    fastest = last
    full = {}
    for name, values in squeezed.items():
        if values.ndim == 1:
            axis = _axis(label, name, arrays[name] if arrays[name].ndim > 1 else values, shape)
            fastest = axis if name == along else fastest
            values = values.reshape([-1 if place == axis else 1 for place in range(len(shape))])
        full[name] = np.broadcast_to(values, shape)
    return {name: np.moveaxis(values, fastest, last).ravel() for name, values in full.items()}


def _about_rows(label: str, text: Columns, vouched: bool) -> Iterator[Finding]:
    """Say how many rows of words were passed over, and that the end may be missing; a hash vouches for it."""
    if text.words:
        numbers = quantities(rows=len(text.words), line=text.words[0])
        yield Finding("rows-left-out", "info", numbers=numbers, names={"file": label, "by": "words"})
    if not (text.ended or vouched):
        yield Finding("last-line-open", "info", names={"file": label})


def read_channels(
    test: MeasuredTest, path: Path, wanted: Sequence[int | str], sha256: str | None
) -> tuple[Groups, tuple[Finding, ...], Columns | None]:
    """Read channels of a file of a test, by different addresses.

    Returns
    -------
    For each address the arrays it means; findings about their units and rows; and of a text its lines and
    blocks.
    """
    form, label = recognise_format(path) if test.format == "auto" else test.format, shown_path(path)
    if form != "csv":
        groups = dict(zip(wanted, read_binary(path, form, wanted, sha256), strict=True))
        return groups, to_si(test, label, groups), None
    text = read_columns(path, test.layout, wanted, sha256)
    columns = zip(text.names, text.values.T, strict=True)
    groups = {name: [] for name in wanted}
    for name, span in zip(wanted, text.spans, strict=True):
        for title, values in islice(columns, span):
            unit = unit_in(title)
            source = "the title of the column" if unit else ""
            groups[name].append(StoredArray(title or str(name), values, unit, source))
    return groups, (*to_si(test, label, groups), *_about_rows(label, text, sha256 is not None)), text


def read_table(
    test: MeasuredTest, path: Path, wanted: Sequence[int | str], sha256: str | None = None
) -> Table:
    """Read columns of a file of a test, each once.

    Parameters
    ----------
    test
        The plan: format and layout of the file, and the frequency, which varies fastest where columns are the
        sides of a matrix.
    path, wanted
        The file, and addresses in it.
    sha256
        What the file must hash to, if known.

    Returns
    -------
    Table
        With NaN where a number is missing.

    Raises
    ------
    MeasurementError
        The file cannot be read, a column is not there, lengths differ.
    """
    groups, findings, text = read_channels(test, path, wanted, sha256)
    label = shown_path(path)
    parts = [_aligned(label, entry, test.frequency) for entry in _entries(label, groups)]
    names, units = (
        {name: getattr(group[0], word) for name, group in groups.items()} for word in ("path", "unit")
    )
    lengths = [len(next(iter(part.values()))) for part in parts]
    if sum(lengths) > MAX_ROWS:
        raise MeasurementError(f"{label}: {sum(lengths)} rows; at most {MAX_ROWS} are read")
    if not sum(lengths):
        raise MeasurementError(f"{label}: no numbers in it; at least one row is needed")
    columns = {name: np.concatenate([part[name] for part in parts]) for name in wanted}
    block = np.repeat(np.arange(len(parts)), lengths)
    if text is not None:
        number = np.tile(text.line, len(parts))
        block = text.block if len(parts) == 1 else block
        return Table(label, columns, "line", number, block, findings, names, units)
    # rows of several entries are counted through
    first = groups[wanted[0]][0].row if len(parts) == 1 else 1
    number = first + np.arange(sum(lengths))
    starred = next((group for name, group in groups.items() if "*" in str(name)), [])
    entries = tuple(one.path.rpartition("/")[0] or one.path for one in starred)
    return Table(label, columns, "row", number, block, findings, names, units, entries)


# ----------------------------------------------------------------------------
# Channels of one file or several as SI amplitudes at the same points, and the sums that are made of them.


def file_of(test: MeasuredTest, channel: Channel, number: int) -> Path:
    """Find the file that has a channel of one of the test's files."""
    return channel.files[number] if channel.files else test.files[number]


@dataclass(frozen=True, slots=True, eq=False)
class Sources:
    """The tables of one file of a test and of the files of its other channels; equal rows are equal points.

    ``main`` has frequency, level and sweep; ``tables`` those of every file by its path.
    """

    test: MeasuredTest
    number: int
    tables: dict[Path, Table]

    @property
    def main(self) -> Table:
        """The table of the file itself."""
        return self.tables[self.test.files[self.number]]

    def keep(self, mask: NDArray[np.bool_]) -> Sources:
        """Keep some rows of all tables."""
        return replace(self, tables={path: table.keep(mask) for path, table in self.tables.items()})

    def sum(self, what: str, frequency: Array, level: Array | None = None) -> ComplexArray:
        """(n,) the sum that ``what`` is made of: a force [N], or a displacement [m].

        A nominal channel has the amplitude of the ``level`` (n,), in SI, with phase 0.
        """
        omega = 2 * np.pi * frequency
        total = np.zeros(len(frequency), dtype=np.complex128)
        for factor, channel in self.test.terms(what):
            if channel.nominal:
                size = np.asarray(level) + 0j
            else:
                table = self.tables[file_of(self.test, channel, self.number)]
                size = _signal(table, channel, self.test.scale_of(channel), what)
            part = factor * size
            if channel.quantity != "force":
                part = part / (1j * omega) ** DERIVATIVE[channel.quantity or "displacement"]
            # what arrives later lags by more than it did
            total += part * np.exp(1j * omega * channel.delay) if channel.delay else part
        self.main.refuse(~np.isfinite(total), f"{what} is too large after conversion to SI units")
        return total

    def doubts(self) -> list[Finding]:
        """Find columns whose titles contradict the case."""
        found: list[Finding] = []
        for channel in self.test.sources:
            table = self.tables[file_of(self.test, channel, self.number)]
            found += unit_doubts(self.test, table.label, table.names, channel) or _degrees(table, channel)
        return found

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Of all tables."""
        return tuple(finding for table in self.tables.values() for finding in table.findings)


def _degrees(table: Table, channel: Channel) -> list[Finding]:
    """Find a phase in radians of more than two turns: no mode lags by that, but its degrees do."""
    if channel.phase is None or channel.phase_unit != "rad":
        return []
    if np.max(np.abs(table.real(channel.phase)), initial=0.0) <= 4 * np.pi:
        return []
    found = contradiction(table.label, table.names.get(channel.phase, str(channel.phase)), "rad", "deg")
    return [replace(found, names={**found.names, "beyond": "yes"})]


def _signal(table: Table, channel: Channel, factor: float, what: str) -> ComplexArray:
    """Assemble complex SI peak amplitudes, exp(+i omega t): a lead is a positive phase."""
    first, *second = channel.columns
    value: NDArray[Any]
    if channel.complex is not None:
        value = np.asarray(table.columns[first], dtype=np.complex128)
    elif channel.real is not None:
        value = table.real(first) + 1j * table.real(second[0])
    else:
        magnitude = table.real(first)
        table.refuse(magnitude < 0, f"{what} amplitude is negative; 0 or more is needed")
        phase = table.real(second[0]) if second else 0.0
        value = magnitude * np.exp(1j * RADIANS[channel.phase_unit] * phase)
    value = np.conj(value) if channel.lags else value
    value = np.asarray(value * factor, dtype=np.complex128)
    table.refuse(~np.isfinite(value), f"{what} is too large after conversion to SI units")
    table.refuse((value == 0) & np.all(value == 0), f"{what} is zero in every row; a signal is needed")
    return value


def read_sources(test: MeasuredTest, number: int) -> Sources:
    """Read the tables of a file and of other channels' files, without rows in which a number is missing."""
    main = test.files[number]
    wanted: dict[Path, list[int | str]] = {main: []}
    for place in (test.frequency, test.level.column):
        if place is not None:
            wanted[main].append(place)
    for channel in test.sources:
        wanted.setdefault(file_of(test, channel, number), []).extend(channel.columns)
    sha256 = test.sha256[number] if test.sha256 else None
    tables = {
        path: read_table(test, path, list(dict.fromkeys(places)), sha256 if path == main else None)
        for path, places in wanted.items()
    }
    for table in tables.values():
        if len(table.number) != len(tables[main].number):
            raise MeasurementError(
                f"{table.label}: {len(table.number)} rows; {tables[main].label} has "
                f"{len(tables[main].number)}: one each needed"
            )
    return _whole_rows(Sources(test, number, tables))


def _whole_rows(sources: Sources) -> Sources:
    """Leave out rows in which a number is missing, and say how many they are."""
    tables, main = sources.tables, sources.main
    columns = [(name, np.isfinite(one)) for table in tables.values() for name, one in table.columns.items()]
    keep = np.logical_and.reduce([finite for _, finite in columns])
    if keep.all():
        return sources
    lost = np.flatnonzero(~keep)
    place = f"{main.unit_of_place} {int(main.number[lost[0]])}"
    if not keep.any():
        gaps = dict.fromkeys(quote(name) for name, finite in columns if not finite.any())
        where = f"{' and '.join(gaps)} has none" if gaps else f"the first gap is in {place}"
        raise MeasurementError(f"{main.label}: no row with a number in every column asked for; {where}")
    numbers = quantities(rows=len(lost), all=len(keep))
    names = {"file": main.label, "first": place, "by": "no number"}
    finding = Finding("rows-left-out", "warning", numbers=numbers, names=names)
    kept = sources.keep(keep)
    path = sources.test.files[sources.number]
    marked = replace(kept.main, findings=(*kept.main.findings, finding))
    return replace(kept, tables=kept.tables | {path: marked})


def join_motions(response: ResponseSurface, *others: ResponseSurface) -> ResponseSurface:
    """Join the surface of a response and those of further motions, of the same records.

    Raises
    ------
    MeasurementError
        They do not have the same points.
    """
    for other in others:
        if not np.array_equal(response.frequency, other.frequency):
            raise MeasurementError(
                f"response: {len(response)} points, and {len(other)} of the motion across; both must have "
                "the same frequencies: record them with the same force"
            )
    return replace(response, across=np.hstack([response.across, *(other.harmonics for other in others)]))
