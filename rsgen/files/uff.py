"""Universal files: functions at nodal degrees of freedom (data set 58, ASCII and binary) and their units.

Source of the format: the published descriptions of universal file data sets 58, "Function at Nodal DOF", 151,
"Header", 164, "Units", and 1858, "Dataset 58 qualifiers"; of the words: ISO 7626-1, "Mechanical mobility:
basic terms and definitions". The parser is written for rsgen: published ones accept wrong counts, steps and
a missing end.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from math import isfinite
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError
from rsgen.files.tree import Node, array_bytes

# ----------------------------------------------------------------------------
# Kinds of functions in words of ISO 7626, and their qualifiers.

_FUNCTIONS = {
    0: "general", 1: "time response", 2: "auto spectrum", 3: "cross spectrum", 4: "frequency response",
    5: "transmissibility", 6: "coherence", 7: "auto correlation", 8: "cross correlation",
    9: "power spectral density", 10: "energy spectral density", 11: "probability density", 12: "spectrum",
    13: "cumulative distribution", 14: "peaks and valleys", 18: "mode indicator", 24: "shock spectrum",
    26: "multiple coherence", 27: "order function",
}  # fmt: skip
_RESPONSES = (0, 1, 4, 12, 27)
_AMPLITUDES = (12, 27)
"""Functions whose amplitudes may be peaks, halves of them or root mean squares; in a quotient they cancel."""
_QUANTITIES = {8: "displacement", 9: "force", 11: "velocity", 12: "acceleration", 13: "force", 15: "pressure"}
_FORCE_KINDS = (9, 13)
"""Kinds of data: reaction force and excitation force."""
_OVER_FORCE = {8: "receptance", 11: "mobility", 12: "accelerance"}
_OF_FORCE = {8: "dynamic stiffness", 11: "mechanical impedance", 12: "apparent mass"}
_WINDOWS = {1: "Hanning window", 2: "Hanning window", 3: "flattop window", 4: "exponential window",
            5: "impact window", 6: "impact and exponential window"}  # fmt: skip
_EXPONENTIAL = (4, 6)
_SCALES = {1: "half-peak", 2: "peak", 3: "rms"}
_DIRECTIONS = {"1": "+X", "2": "+Y", "3": "+Z", "-1": "-X", "-2": "-Y", "-3": "-Z"}
_ROTATIONS = (1, 3)


@dataclass(frozen=True, slots=True)
class _Qualifiers:
    """Data set 1858: how a function was made; 0 where it is unknown or was not."""

    octave: int = 0
    """n of bands of 1/n octave."""
    weighting: int = 0
    window: int = 0
    scale: int = 0
    """Of the amplitudes."""
    numerator: int = 0
    """1 and 3 for rotations."""
    denominator: int = 0


def _fault_of(head: _Head, said: _Qualifiers) -> str:
    """Say why a function is none that can be read, or ""."""
    if head.function not in _RESPONSES:
        what = _FUNCTIONS.get(head.function, f"function of type {head.function}")
        return (
            f"is a {what}, which is no response to one sine; "
            "a time response, frequency response or spectrum is needed"
        )
    if head.function == 4 and head.ordinate.kind in _FORCE_KINDS and head.over.kind in _OF_FORCE:
        what = _OF_FORCE[head.over.kind]
        return f"is a force over a motion ({what}); receptance, mobility or accelerance is needed"
    if said.numerator in _ROTATIONS or said.denominator in _ROTATIONS:
        return "is of a rotation or a moment (data set 1858); motions along a line and forces are read"
    if said.octave or said.weighting:
        return "is in bands of octaves or weighted (data set 1858); narrow lines without weighting are needed"
    return ""


def _scale_of(head: _Head, said: _Qualifiers) -> str:
    """Return the scale of a spectrum's amplitudes, "rms", "peak" or "half-peak"; "" where it is not given."""
    return _SCALES.get(said.scale, "") if head.function in _AMPLITUDES else ""


def _remark_of(head: _Head, said: _Qualifiers) -> str:
    """Describe a function, what it is in words of ISO 7626 first."""
    kind, over_force = head.ordinate.kind, head.over.kind in _FORCE_KINDS
    parts = [_OVER_FORCE.get(kind, "") if head.function == 4 and over_force else ""]
    parts.append(_scale_of(head, said))
    parts.append(_WINDOWS.get(said.window, "") + (" adds damping" if said.window in _EXPONENTIAL else ""))
    what = _FUNCTIONS.get(head.function, f"function {head.function}")
    parts += [what, head.place, head.ordinate.label, _QUANTITIES.get(kind, "")]
    if over_force:
        parts += ["over force", f"at {head.reference}" if head.reference else ""]
    return ", ".join(part for part in parts if part)


def _place_of(text: str) -> str:
    """Name a point by entity, node and direction, "" for none; directions that are no axis are left out."""
    entity, node, direction = text[:11].strip(), text[11:21].strip(), text[21:25].strip()
    named = "" if entity == "NONE" and node == "0" else f"{entity} {node}".strip()
    return f"{named} {_DIRECTIONS.get(direction, '')}".strip() if named else ""


# ----------------------------------------------------------------------------
# Units of a universal file: what an axis names, else the unit system of data set 164, else SI.
#
# Source of the format: the published description of universal file data set 164, "Units". Its factors turn
# numbers of the file into SI by division: 1000 where lengths are in mm.

_LENGTHS = {
    "m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "km": 1e3, "inch": 0.0254, "thou": 2.54e-5, "ft": 0.3048,
}  # fmt: skip
_FORCES = {
    "N": 1.0, "mN": 1e-3, "cN": 1e-2, "uN": 1e-6, "kN": 1e3, "dyn": 1e-5, "kgf": 9.80665,
    "lbf": 4.4482216152605, "poundal": 0.138254954376,
}  # fmt: skip
_SYSTEMS = {
    1: ("m", "N"), 2: ("ft", "lbf"), 3: ("m", "kgf"), 4: ("ft", "poundal"), 5: ("mm", "mN"),
    6: ("cm", "cN"), 7: ("inch", "lbf"), 8: ("mm", "kgf"), 10: ("mm", "N"),
}  # fmt: skip
"""Length and force by the code of the unit system; 9 is user-defined."""
_FACTOR_TOLERANCE = 1e-4
"""Relative error of a factor that names a unit all the same: writers print four digits and more."""
_PER_TIME = {8: "", 11: "/s", 12: "/s^2"}
_PER_FORCE = re.compile(r"/\s*(?:[kmcuµM]?N|lbf?|kgf|kp|dyne?)\Z")


@dataclass(frozen=True, slots=True)
class UnitSystem:
    """Units of length and force in a universal file, "" where not known; where they come from, or why not."""

    length: str
    force: str
    source: str


SI = UnitSystem("m", "N", "SI assumed")
"""Where a file has no data set 164."""


def _named(factor: float, units: dict[str, float]) -> str:
    """Find the unit of which there are ``factor`` in an SI unit, or ""."""
    return next((name for name, size in units.items() if abs(factor * size - 1) < _FACTOR_TOLERANCE), "")


def unit_system(code: int, length: float, force: float) -> UnitSystem:
    """Read data set 164.

    Parameters
    ----------
    code
        Code of the unit system.
    length, force
        File units in 1 m and in 1 N; positive.

    Examples
    --------
    >>> unit_system(5, 1000.0, 1000.0)
    UnitSystem(length='mm', force='mN', source='data set 164')
    """
    found = _named(length, _LENGTHS), _named(force, _FORCES)
    factors = f"its factors {length:g} and {force:g}"
    if "" in found:
        return UnitSystem("", "", f"data set 164, {factors} are of no known units")
    meant = _SYSTEMS.get(code, found)
    if meant != found:
        # some writers invert the factors, others leave those of a template: neither can be trusted
        return UnitSystem("", "", f"data set 164 says {' and '.join(meant)}, but {factors} differ")
    return UnitSystem(*found, "data set 164")


def _unit(axis: _Axis, system: UnitSystem) -> tuple[str, str]:
    if axis.unit:
        return axis.unit, "axis label"
    if axis.kind in _PER_TIME:
        return system.length and system.length + _PER_TIME[axis.kind], system.source
    return (system.force, system.source) if axis.kind in _FORCE_KINDS else ("", "")


def _axis_unit(ordinate: _Axis, over: _Axis, system: UnitSystem) -> tuple[str, str]:
    """Find the unit of an ordinate, "" where it is not known; and its source, or why it is not known.

    ``system`` is that of the last data set 164 before.
    """
    unit, source = _unit(ordinate, system)
    if over.kind not in _FORCE_KINDS or _PER_FORCE.search(unit) or not source:
        return unit, source
    force, origin = _unit(over, system)
    if not (unit and force):
        return "", system.source
    return f"{unit}/{force}", source if source == origin else f"{source}, force: {origin}"


# ----------------------------------------------------------------------------
# The data sets, line by line.

MAX_LINE = 4096
HEADER_LINES = 11
PARSED_LINES = 20_000
_FIELD = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eEdD][+-]?\d+)?", re.ASCII)
_PLAIN = re.compile(rb"[0-9eEdD+\-.\s]*\Z")
_BINARY = re.compile(r" {0,5}58b *(\d+) +(\d+) +(\d+) +(\d+)(?: |\Z)", re.ASCII)
_HEADER = ("model", "description", "program", "created", "saved", "written by", "written")
"""Contents of the lines of data set 151, in their order."""
_ABSCISSAS = {17: ("time", "s"), 18: ("frequency", "Hz"), 19: ("speed", "rpm"), 20: ("order", "")}


@dataclass(frozen=True, slots=True)
class _Axis:
    kind: int
    label: str
    unit: str


@dataclass(frozen=True, slots=True)
class _Head:
    """The eleven lines before the numbers."""

    title: str
    function: int
    place: str
    reference: str
    double: bool
    paired: bool
    count: int
    even: bool
    start: float
    step: float
    abscissa: _Axis
    ordinate: _Axis
    over: _Axis


class _Lines:
    """The lines of the file, each counted and bounded."""

    def __init__(self, file: BinaryIO) -> None:
        self.file = file
        self.number = 0

    def next(self) -> bytes | None:
        raw = self.file.readline(MAX_LINE + 1)
        if not raw:
            return None
        self.number += 1
        if len(raw) > MAX_LINE:
            raise MeasurementError(
                f"line {self.number}: longer than {MAX_LINE} bytes; is it a universal file?"
            )
        return raw

    def fail(self, what: str) -> MeasurementError:
        return MeasurementError(f"line {self.number}: {what}")

    def integer(self, text: str, what: str) -> int:
        if not re.fullmatch(r"[+-]?\d{1,12}", text.strip(), re.ASCII):
            raise self.fail(f"{what} is {text.strip()[:20]!r}; a whole number is needed")
        return int(text.strip())

    def real(self, text: str, what: str) -> float:
        if not _FIELD.fullmatch(text):
            raise self.fail(f"{what} is {text[:20]!r}; a number is needed")
        value = float(text.upper().replace("D", "E"))
        if not isfinite(value):
            raise self.fail(f"{what} is too large for a number")
        return value


def _words(raw: bytes) -> str:
    return raw.decode("utf-8", "replace").rstrip("\r\n")


def _is_end(raw: bytes) -> bool:
    return raw.strip() == b"-1"


def _axis(lines: _Lines, text: str) -> _Axis:
    kind = lines.integer(text[:10] or "0", "the kind of an axis")
    label, unit = text[25:46].strip(), text[46:67].strip()
    return _Axis(kind, "" if label == "NONE" else label[:20], "" if unit == "NONE" else unit[:20])


def _head(lines: _Lines) -> _Head:
    texts: list[str] = []
    for _ in range(HEADER_LINES):
        raw = lines.next()
        if raw is None or (_is_end(raw) and len(texts) > 4):
            raise lines.fail("the head of the data set ends early; 11 lines are needed")
        texts.append(_words(raw))
    after = lines.number
    lines.number = after - 5
    function = lines.integer(texts[5][:5], "the kind of function")
    place, reference = _place_of(texts[5][30:55]), _place_of(texts[5][55:80])
    lines.number = after - 4
    fields = texts[6].split()
    if len(fields) < 5:
        raise lines.fail("type, count, spacing, start and step of the numbers are needed")
    kind, count, spacing = (lines.integer(text, "type, count or spacing") for text in fields[:3])
    if kind not in (2, 4, 5, 6):
        raise lines.fail(f"ordinates of type {kind}; 2, 4 (real), 5 and 6 (complex) are known")
    if count < 1:
        raise lines.fail(f"declares {count} points; at least one is needed")
    if spacing not in (0, 1):
        raise lines.fail(f"spacing is {spacing}; 0 (uneven) or 1 (even) is needed")
    start = lines.real(fields[3], "the first abscissa")
    step = lines.real(fields[4], "the step of the abscissa")
    if spacing and step <= 0 and count > 1:
        raise lines.fail(f"the step of the abscissa is {step:g}; a step above 0 is needed")
    axes = []
    for number in range(3):
        lines.number = after - 3 + number
        axes.append(_axis(lines, texts[7 + number]))
    lines.number = after
    return _Head(
        texts[0].strip()[:80], function, place, reference, kind in (4, 6), kind in (5, 6), count,
        spacing == 1, start, step, *axes,
    )  # fmt: skip


def _ascii(lines: _Lines, most: int) -> tuple[Array, int]:
    """Read the lines of numbers up to the closing -1, some at a time."""
    arrays: list[Array] = []
    parts: list[bytes] = []
    total = 0
    first = start = lines.number + 1
    while True:
        raw = lines.next()
        if raw is None:
            raise lines.fail("the file ends without the closing -1, so it is cut off; send it again")
        end = _is_end(raw)
        if end or len(parts) >= PARSED_LINES:
            arrays.append(_parse(b"".join(parts), start))
            total += len(arrays[-1])
            parts, start = [], lines.number
        if end:
            return np.concatenate(arrays), first
        if total > most:
            raise lines.fail(f"more numbers than the {most} that the head declares")
        parts.append(raw)


def _parse(text: bytes, first: int) -> Array:
    if _PLAIN.match(text):
        try:
            return np.array(text.upper().replace(b"D", b"E").split(), dtype=np.float64)
        except ValueError:
            # fields of fixed width may touch: -1.0E-03-2.0E-03
            pass
    values: list[float] = []
    for number, line in enumerate(text.splitlines(), start=first):
        rest = _FIELD.sub("", line.decode("utf-8", "replace")).strip()
        if rest:
            what = f"{rest[:20]!r} is no number" if rest.strip(", ") else "decimal commas"
            raise MeasurementError(f"line {number}: {what}; finite numbers are needed")
        values += (float(field.upper().replace("D", "E")) for field in _FIELD.findall(line.decode()))
    return np.array(values)


def _finite(values: NDArray[Any]) -> NDArray[Any]:
    if not np.isfinite(values).all():
        raise MeasurementError("holds a number that is not finite; finite numbers are needed")
    return values


def _abscissa(head: _Head, flat: NDArray[Any]) -> NDArray[Any]:
    if head.even:
        return head.start + head.step * np.arange(head.count)
    return _finite(np.array(flat.reshape(head.count, -1)[:, 0], dtype=np.float64))


def _ordinate(head: _Head, flat: NDArray[Any]) -> NDArray[Any]:
    table = flat.reshape(head.count, -1)
    ordinate = table if head.even else table[:, 1:]
    return _finite(ordinate[:, 0] + 1j * ordinate[:, 1] if head.paired else ordinate[:, 0])


def _width(head: _Head) -> int:
    return (2 if head.paired else 1) + (0 if head.even else 1)


def _binary(head: _Head, data: bytes, order: str) -> NDArray[Any]:
    """Read binary numbers; in uneven records of double precision the abscissa may be single."""
    size = 8 if head.double else 4
    if len(data) == head.count * _width(head) * size:
        return np.frombuffer(data, dtype=f"{order}f{size}")
    parts = 2 if head.paired else 1
    if head.double and not head.even and len(data) == head.count * (4 + 8 * parts):
        mixed = np.frombuffer(data, dtype=[("x", f"{order}f4"), ("y", f"{order}f8", (parts,))])
        return np.column_stack([mixed["x"].astype(np.float64), mixed["y"]]).ravel()
    raise MeasurementError(f"declares {head.count} points and {len(data)} bytes, which do not fit together")


class _Sets(_Lines):
    """The data sets of the file."""

    def __init__(self, file: BinaryIO, size: int, largest: int) -> None:
        super().__init__(file)
        self.size = size
        self.largest = largest
        self.others: list[str] = []
        self.system = SI
        self.texts: dict[str, str] = {}
        self.found: list[tuple[_Head, NDArray[Any], UnitSystem] | _Qualifiers] = []

    def walk(self) -> None:
        """Read all data sets; what is of use is in ``found`` and ``texts``, in the order of the file."""
        while (raw := self.next()) is not None:
            if not raw.strip():
                continue
            if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
                raise self.fail("two bytes a sign (UTF-16); save the file as UTF-8")
            if not _is_end(raw):
                raise self.fail("a data set begins with a line of -1; is it a universal file?")
            name = self.next()
            if name is None:
                raise self.fail("the file ends where a data set should begin; it is cut off")
            text = _words(name)
            if text.strip() == "58":
                self.found.append((*self.plain(), self.system))
            elif text.strip().startswith("58b"):
                self.found.append((*self.raw(text), self.system))
            elif text.strip() == "164":
                self.system = self.units()
            elif text.strip() == "151":
                self.header()
            elif text.strip() == "1858":
                self.found.append(self.qualifiers())
            else:
                self.others.append(self.skip(text.strip()))

    def next_lines(self, most: int) -> list[str]:
        """Return the first lines of a data set, and pass over the others."""
        found: list[str] = []
        while (raw := self.next()) is not None:
            if _is_end(raw):
                return found
            if len(found) < most:
                found.append(_words(raw).strip())
        raise self.fail("the file ends without the closing -1, so it is cut off; send it again")

    def header(self) -> None:
        """Read data set 151: which model, when, by which program; what the first one says is kept."""
        said = dict(zip(_HEADER, self.next_lines(len(_HEADER)), strict=False))
        for name, text in said.items():
            if name and text and text != "NONE":
                self.texts.setdefault(f"header/{name}", " ".join(text.split()))

    def qualifiers(self) -> _Qualifiers:
        """Read the first two lines of data set 1858."""
        lines = [line.split() for line in self.next_lines(2)]
        if len(lines) < 2 or len(lines[0]) < 2 or len(lines[1]) < 7:
            raise self.fail("two lines of whole numbers, 2 and 7 at least, are needed in data set 1858")
        octave, weighting, window, scale, above, below = (
            self.integer(text, "a number of data set 1858")
            for text in (lines[0][1], *lines[1][:3], *lines[1][5:7])
        )
        return _Qualifiers(octave, weighting, window, scale, above, below)

    def functions(self) -> Iterator[tuple[_Head, NDArray[Any], UnitSystem, _Qualifiers]]:
        """Return each function with its qualifiers, after it if the file ends with some, else before it."""
        behind = isinstance(self.found[-1], _Qualifiers)
        for number, part in enumerate(self.found):
            if isinstance(part, _Qualifiers):
                continue
            neighbours = (
                self.found[number + 1 : number + 2] if behind else self.found[max(0, number - 1) : number]
            )
            said = [other for other in neighbours if isinstance(other, _Qualifiers)]
            yield *part, said[0] if said else _Qualifiers()

    def skip(self, name: str) -> str:
        if not re.fullmatch(r"\d{1,6}[a-z]?", name):
            raise self.fail(f"{name[:20]!r} is no number of a data set; is it a universal file?")
        self.next_lines(0)
        return name

    def units(self) -> UnitSystem:
        """Read data set 164: a code, and how many file units of length and force are in 1 m and in 1 N."""
        code = self.integer(_words(self.next() or b"")[:10], "the code of the units")
        fields = _FIELD.findall(_words(self.next() or b""))
        if len(fields) < 2:
            raise self.fail("the factors of length and force are needed in data set 164")
        length, force = (self.real(field, "a factor of data set 164") for field in fields[:2])
        if not (length > 0 and force > 0):
            raise self.fail(f"the factors of data set 164 are {length:g} and {force:g}; above 0 is needed")
        self.skip("164")
        return unit_system(code, length, force)

    def check(self, head: _Head) -> None:
        try:
            array_bytes((head.count, _width(head)), np.dtype("f8"), self.largest)
        except MeasurementError as fault:
            raise self.fail(str(fault)) from None

    def plain(self) -> tuple[_Head, NDArray[Any]]:
        head = _head(self)
        self.check(head)
        flat, first = _ascii(self, head.count * _width(head))
        if len(flat) != head.count * _width(head):
            raise MeasurementError(
                f"line {first}: {head.count} points are declared, which is {head.count * _width(head)} "
                f"numbers; there are {len(flat)}"
            )
        return head, flat

    def raw(self, text: str) -> tuple[_Head, NDArray[Any]]:
        match = _BINARY.match(text)
        if match is None:
            raise self.fail("byte order, number format, lines and bytes are needed after 58b")
        order, kind, lines, count = (int(group) for group in match.groups())
        if order not in (1, 2) or kind != 2:
            raise self.fail("byte order 1 or 2 and number format 2 (IEEE 754) are read")
        if lines != HEADER_LINES:
            raise self.fail(f"a head of {lines} lines; {HEADER_LINES} are needed")
        head = _head(self)
        self.check(head)
        if count > self.size - self.file.tell():
            raise self.fail(f"declares {count} bytes; the file has {self.size - self.file.tell()} left")
        data = self.file.read(count)
        # the closing line may follow at once or on the next line
        raw = self.next()
        if raw is not None and not raw.strip():
            raw = self.next()
        # a blank fewer would mean that a byte of the numbers is missing
        if raw is None or raw.rstrip() != b"    -1":
            raise self.fail("after the numbers the closing -1 is missing; the file is damaged")
        try:
            return head, _binary(head, data, "<" if order == 1 else ">")
        except MeasurementError as fault:
            raise self.fail(str(fault)) from None


def walk_universal(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through the data sets 58 of a universal file: k/abscissa and k/ordinate for each, k from 1.

    What data set 151 says of model, program and dates is given as texts below header/.

    The unit of an ordinate is the label of its axis, else that of the last data set 164, else SI.

    Raises
    ------
    MeasurementError
        No universal file, no data set 58, cut off, counts that do not fit, a step that is not positive,
        numbers that are not finite; the message begins with the line.
    """
    size = file.seek(0, 2)
    file.seek(0)
    sets = _Sets(file, size, largest)
    sets.walk()
    if not any(not isinstance(part, _Qualifiers) for part in sets.found):
        others = f"; there are data sets {', '.join(sets.others[:5])}" if sets.others else ""
        raise MeasurementError(f"no data set 58 in it{others}; functions (data set 58) are read")
    for path, text in sets.texts.items():
        yield Node.text(path, text)
    for number, (head, flat, system, said) in enumerate(sets.functions(), start=1):
        known, unit = _ABSCISSAS.get(head.abscissa.kind, ("", ""))
        fault = _fault_of(head, said)
        kind = f"{'complex' if head.paired else 'float'}{flat.itemsize * (16 if head.paired else 8)}"
        yield Node(
            f"{number}/abscissa", (head.count,), "float64", load=partial(_abscissa, head, flat),
            unit=head.abscissa.unit or unit, remark=known or head.abscissa.label, fault=fault,
        )  # fmt: skip
        unit, source = _axis_unit(head.ordinate, head.over, system)
        yield Node(
            f"{number}/ordinate", (head.count,), kind, load=partial(_ordinate, head, flat),
            unit=unit, unit_source=source, fault=fault, scale=_scale_of(head, said),
            remark=_remark_of(head, said), title=head.place or head.title,
        )  # fmt: skip
