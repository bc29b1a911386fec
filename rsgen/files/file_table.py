"""One file as a table: every column that the plan asks for, of one length, whatever the format."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError, quote
from rsgen.common.finding import Finding, quantities
from rsgen.files.column_titles import unit_in
from rsgen.files.data_files import file_label, recognise_format
from rsgen.files.file_units import to_si
from rsgen.files.plan import MeasuredTest
from rsgen.files.sandbox import read_binary
from rsgen.files.text_columns import Columns, read_columns
from rsgen.files.tree import Channel

__all__ = ["Table", "read_channels", "read_table"]

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
    """

    label: str
    columns: dict[int | str, NDArray[Any]]
    unit_of_place: str
    number: NDArray[np.int64]
    block: NDArray[np.int64]
    findings: tuple[Finding, ...] = ()
    names: dict[int | str, str] = field(default_factory=dict)
    units: dict[int | str, str] = field(default_factory=dict)

    @property
    def complete(self) -> NDArray[np.bool_]:
        """(n,) whether every column has a finite number in the row."""
        complete = np.ones(len(self.number), dtype=np.bool_)
        for values in self.columns.values():
            complete &= np.isfinite(values)
        return complete

    def refuse(self, bad: NDArray[np.bool_], what: str) -> None:
        """Raise a fault that names the first bad row, if there is one."""
        if bad.any():
            raise MeasurementError(
                f"{self.label}: {self.unit_of_place} {int(self.number[int(np.argmax(bad))])}: {what}"
            )

    def real(self, column: int | str) -> Array:
        """Give a column of real numbers."""
        values = self.columns[column]
        if np.iscomplexobj(values):
            raise MeasurementError(
                f"{self.label}: {quote(column)} is complex; name it by 'complex', or name a real one"
            )
        return np.asarray(values, dtype=np.float64)

    def keep(self, mask: NDArray[np.bool_]) -> Table:
        """Keep some rows."""
        columns = {name: values[mask] for name, values in self.columns.items()}
        return replace(self, columns=columns, number=self.number[mask], block=self.block[mask])


def _stars(pattern: int | str, path: str) -> tuple[str, ...]:
    """Give what the * of an address stood for."""
    if not isinstance(pattern, str) or "*" not in pattern:
        return ()
    text = re.sub(r"\[[\d,:]+\]\Z", "", pattern)
    names, wanted = path.split("/"), text.split("/")
    parts = [_star(*pair) for pair in zip(wanted, names, strict=False)]
    whole = len(names) == len(wanted) and None not in parts
    return tuple(part for found in parts for part in found or ()) if whole else (path,)


def _star(pattern: str, name: str) -> tuple[str, ...] | None:
    """Give what each * stood for, the first ones for as much as they can; None where the name does not fit.

    From the end, so that no place is tried twice, however many stars there are.
    """
    first, *others = pattern.split("*")
    if not others:
        return () if name == pattern else None
    last = others.pop()
    stop = len(name) - len(last)
    if stop < len(first) or not (name.startswith(first) and name.endswith(last)):
        return None
    found: list[str] = []
    for literal in reversed(others):
        place = name.rfind(literal, len(first), stop)
        if place < 0:
            return None
        found.append(name[place + len(literal) : stop])
        stop = place
    return (name[len(first) : stop], *reversed(found))


def _entries(
    label: str, wanted: Sequence[int | str], groups: Sequence[list[Channel]]
) -> list[dict[int | str, NDArray[Any]]]:
    """Sort what wildcards found into entries: the same * stands for the same name in every column."""
    several = {address: group for address, group in zip(wanted, groups, strict=True) if _has_star(address)}
    if not several:
        return [{address: group[0].values for address, group in zip(wanted, groups, strict=True)}]
    keys = {address: [_stars(address, c.path) for c in group] for address, group in several.items()}
    first = next(iter(keys))
    for address, found in keys.items():
        if found != keys[first]:
            raise MeasurementError(
                f"{label}: {quote(first)} means {len(keys[first])} entries and {quote(address)} others "
                f"({len(found)}); every entry must have both"
            )
    return [
        {
            a: (group[number] if a in several else group[0]).values
            for a, group in zip(wanted, groups, strict=True)
        }
        for number in range(len(keys[first]))
    ]


def _has_star(address: int | str) -> bool:
    return isinstance(address, str) and "*" in address


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
        yield Finding("rows-of-words", "info", numbers=numbers, names={"file": label})
    if not (text.ended or vouched):
        yield Finding("last-line-open", "info", names={"file": label})


def _column(text: Columns, place: int, name: int | str) -> Channel:
    title = text.names[place]
    unit = unit_in(title)
    source = "the title of the column" if unit else ""
    return Channel(title or str(name), text.values[:, place], unit, source)


def read_channels(
    test: MeasuredTest, path: Path, wanted: Sequence[int | str], sha256: str | None
) -> tuple[list[list[Channel]], tuple[Finding, ...], Columns | None]:
    """Read channels of a file of a test.

    Returns
    -------
    For each address the arrays it means; findings about their units and rows; and of a text its lines and
    blocks.
    """
    form = recognise_format(path) if test.format == "auto" else test.format
    if form == "csv":
        text = read_columns(path, test.layout, wanted, sha256)
        label = file_label(path)
        places = iter(range(len(text.names)))
        groups = [
            [_column(text, next(places), name) for _ in range(span)]
            for name, span in zip(wanted, text.spans, strict=True)
        ]
        return (
            groups,
            (*to_si(test, label, wanted, groups), *_about_rows(label, text, sha256 is not None)),
            text,
        )
    groups = read_binary(path, form, wanted, sha256)
    return groups, to_si(test, file_label(path), wanted, groups), None


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
    label = file_label(path)
    parts = [_aligned(label, entry, test.frequency) for entry in _entries(label, wanted, groups)]
    names, units = (
        {name: getattr(group[0], word) for name, group in zip(wanted, groups, strict=True)}
        for word in ("path", "unit")
    )
    if text is not None and len(parts) == 1:
        return Table(label, parts[0], "line", text.line, text.block, findings, names, units)
    lengths = [len(next(iter(part.values()))) for part in parts]
    if sum(lengths) > MAX_ROWS:
        raise MeasurementError(f"{label}: {sum(lengths)} rows; at most {MAX_ROWS} are read")
    if not sum(lengths):
        raise MeasurementError(f"{label}: no numbers in it; at least one row is needed")
    columns = {name: np.concatenate([part[name] for part in parts]) for name in wanted}
    block = np.repeat(np.arange(len(parts)), lengths)
    if text is not None:
        return Table(label, columns, "line", np.tile(text.line, len(parts)), block, findings, names, units)
    # rows of several entries are counted through
    first = groups[0][0].row if len(parts) == 1 else 1
    return Table(label, columns, "row", first + np.arange(sum(lengths)), block, findings, names, units)
