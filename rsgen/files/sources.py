"""Channels of one file or several as SI amplitudes at the same points, and the sums that are made of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import MeasurementError, quote
from rsgen.common.finding import Finding, quantities
from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.columns import DERIVATIVE
from rsgen.files.file_table import Table, read_table
from rsgen.files.plan import MeasuredTest
from rsgen.files.signals import NamedChannel, Signal
from rsgen.files.title_units import unit_doubts

__all__ = ["Sources", "file_of", "read_sources", "with_across"]


def file_of(test: MeasuredTest, channel: NamedChannel, number: int) -> Path:
    """Find the file that has a channel of one of the test's files."""
    return channel.files[number] if channel.files else test.files[number]


@dataclass(frozen=True, slots=True, eq=False)
class Sources:
    """The tables of one file of a test and of the files beside it, row by row the same points.

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

    def amplitude(self, channel: NamedChannel, what: str) -> ComplexArray:
        """(n,) complex peak amplitude of a channel, its quantity in SI."""
        table = self.tables[file_of(self.test, channel, self.number)]
        return _signal(table, channel.signal, self.test.scale_of(channel), what)

    def sum(self, what: str, frequency: Array) -> ComplexArray:
        """(n,) the sum that ``what`` is made of: a force [N], or a displacement [m]."""
        omega = 2 * np.pi * frequency
        total = np.zeros(len(frequency), dtype=np.complex128)
        for factor, channel in self.test.terms(what):
            part = factor * self.amplitude(channel, what)
            if channel.quantity != "force":
                part = part / (1j * omega) ** DERIVATIVE[channel.quantity or "displacement"]
            # what arrives later lags by more than it did
            total += part * np.exp(1j * omega * channel.delay) if channel.delay else part
        self.main.refuse(~np.isfinite(total), f"{what} is too large after conversion to SI units")
        return total

    def doubts(self) -> list[Finding]:
        """Find columns whose titles contradict the case."""
        found: list[Finding] = []
        for channel, (signal, target) in zip(self.test.sources, self.test.signals, strict=True):
            table = self.tables[file_of(self.test, channel, self.number)]
            found += unit_doubts(self.test, table.label, table.names, signal, target)
        return found

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Of all tables."""
        return tuple(finding for table in self.tables.values() for finding in table.findings)


def _signal(table: Table, signal: Signal, factor: float, what: str) -> ComplexArray:
    """Assemble complex SI peak amplitudes, exp(+i omega t): a lead is a positive phase."""
    first, *second = signal.columns
    value: NDArray[Any]
    if signal.complex is not None:
        value = np.asarray(table.columns[first], dtype=np.complex128)
    elif signal.real is not None:
        value = table.real(first) + 1j * table.real(second[0])
    else:
        magnitude = table.real(first)
        table.refuse(magnitude < 0, f"{what} amplitude is negative; 0 or more is needed")
        radian = np.pi / 180 if signal.phase_unit == "deg" else 1.0
        value = magnitude * np.exp(1j * radian * (table.real(second[0]) if second else 0.0))
    value = np.conj(value) if signal.lags else value
    value = np.asarray(value * factor, dtype=np.complex128)
    table.refuse(~np.isfinite(value), f"{what} is too large after conversion to SI units")
    table.refuse(value == 0, f"{what} is zero; every point needs one that is not")
    return value


def read_sources(test: MeasuredTest, number: int) -> Sources:
    """Read the table of a file and those beside it; rows in which a number is missing are left out."""
    main = test.files[number]
    wanted: dict[Path, list[int | str]] = {main: []}
    for place in (test.frequency, test.sweep.column, test.level.column):
        if place is not None:
            wanted[main].append(place)
    for channel in test.sources:
        wanted.setdefault(file_of(test, channel, number), []).extend(channel.signal.columns)
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
    keep = np.logical_and.reduce([table.complete for table in tables.values()])
    if keep.all():
        return sources
    lost = np.flatnonzero(~keep)
    place = f"{main.unit_of_place} {int(main.number[lost[0]])}"
    if not keep.any():
        gaps = [
            quote(name)
            for table in tables.values()
            for name, values in table.columns.items()
            if not np.isfinite(values).any()
        ]
        where = f"{' and '.join(dict.fromkeys(gaps))} has none" if gaps else f"the first gap is in {place}"
        raise MeasurementError(f"{main.label}: no row with a number in every column asked for; {where}")
    numbers = quantities(rows=len(lost), all=len(keep))
    finding = Finding(
        "rows-without-number", "warning", numbers=numbers, names={"file": main.label, "first": place}
    )
    kept = sources.keep(keep)
    path = sources.test.files[sources.number]
    marked = replace(kept.main, findings=(*kept.main.findings, finding))
    return replace(kept, tables=kept.tables | {path: marked})


def with_across(surface: ResponseSurface, across: ResponseSurface) -> ResponseSurface:
    """Join the surface of a response and that of the motion across, of the same records.

    Raises
    ------
    MeasurementError
        The two do not have the same points.
    """
    if len(surface) != len(across) or not np.array_equal(surface.frequency, across.frequency):
        raise MeasurementError(
            f"response: {len(surface)} points, and {len(across)} of the motion across; both must have the "
            "same frequencies: record them with the same force"
        )
    return replace(surface, across=across.harmonics)
