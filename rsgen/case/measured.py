"""The [test] table of a measured case: units to factors, the data file to a safe path."""

from __future__ import annotations

from math import pi, sqrt
from pathlib import Path

from rsgen.case.document import ForceTable, LevelTable, MeasuredTable, ResponseTable, SweepTable
from rsgen.case.wording import is_device, quote
from rsgen.errors import RsgenError
from rsgen.measurement import Layout, LevelRule, MeasuredTest, Signal, SweepRule
from rsgen.units import quantity

__all__ = ["build_measured", "path_fault"]

_SI = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
# by hand: for a units library rad/s and Hz are both 1/s, which hides a factor of 2 pi
_HERTZ = {"Hz": 1.0, "kHz": 1e3, "mHz": 1e-3, "rad/s": 1 / (2 * pi), "rpm": 1 / 60}
MAX_PATH = 400
MAX_PART = 120
SPREAD = 0.05


def path_fault(text: str) -> str | None:
    """Say why a text is no path to a data file inside the allowed folders, or None where it is one.

    Examples
    --------
    >>> path_fault("wire/example6.txt") is None
    True
    >>> path_fault("../secret.csv")
    "'../secret.csv' leaves its folder; a relative path with / and without .. is allowed"
    """
    allowed = "a relative path with / and without .. is allowed"
    if not text or len(text) > MAX_PATH:
        return f"has {len(text)} characters; 1 to {MAX_PATH} are allowed"
    if not text.isprintable() or any(sign in text for sign in '\\:*?"<>|$~'):
        return f"{quote(text)} contains a sign that no data file may have; {allowed}"
    parts = text.split("/")
    if text.startswith("/"):
        return f"{quote(text)} is an absolute path; {allowed}"
    if ".." in parts:
        return f"{quote(text)} leaves its folder; {allowed}"
    if any(not part or part == "." or part != part.strip() or part.startswith("-") for part in parts):
        return f"{quote(text)} has a part that is empty, '.', begins with - or ends in a blank; {allowed}"
    if any(len(part) > MAX_PART or part.endswith(".") or is_device(part) for part in parts):
        return f"{quote(text)} is no file name on every system; {allowed}"
    return None


def _resolve(text: str, folders: tuple[Path, ...], faults: list[str]) -> Path:
    for folder in folders:
        path = folder / text
        try:
            there = path.exists()
        except OSError as fault:
            faults.append(
                f"test.file: cannot be looked for: {fault.strerror}; a file that may be read is needed"
            )
            return path
        if there:
            if not path.resolve().is_relative_to(folder.resolve()):
                faults.append(f"test.file: {quote(text)} leads out of its folder; a file inside it is needed")
            return path
    # nowhere: the case's own folder is the last, and the place to name
    return folders[-1] / text


def _scaled(path: str, unit: str, factor: float | str, target: str, faults: list[str]) -> float | None:
    """Find what 1 ``unit`` times ``factor`` is in ``target``; the factor may have a unit of its own."""
    # in a list of accelerations g is the standard gravity, never the gram
    name = "standard_gravity" if unit.strip() in ("g", "g_n", "gn") and target == "m/s^2" else unit
    try:
        if isinstance(factor, str):
            # column x unit x factor must come out as the target, so this is the unit the factor must have
            return quantity(f"1 {name}", None) * quantity(factor, f"({target})/({name})")
        return quantity(f"1 {name}", target) * factor
    except RsgenError as fault:
        faults.append(f"{path}: {' '.join(str(fault).split())}")
        return None


def _signal(
    table: ForceTable | ResponseTable, path: str, unit: str, target: str, faults: list[str]
) -> Signal | None:
    before = len(faults)
    polar = table.amplitude is not None
    cartesian = table.real is not None or table.imaginary is not None
    if polar == cartesian or (cartesian and (table.real is None or table.imaginary is None)):
        faults.append(
            f"{path}: give amplitude (with phase), or real and imaginary; one of the two pairs is needed"
        )
    if cartesian and table.phase is not None:
        faults.append(f"{path}.phase: does not go with real and imaginary; leave one out")
    if isinstance(table, ResponseTable) and polar and table.phase is None:
        faults.append(f"{path}.phase: is missing; amplitude and phase, or real and imaginary, are needed")
    if (table.phase is not None or table.imaginary is not None) and table.phase_sense is None:
        faults.append(
            f"{path}.phase_sense: is missing; 'lag' (positive means later) or 'lead' (earlier) is needed"
        )
    factor = _scaled(path, unit, table.factor, target, faults)
    if factor == 0:
        faults.append(f"{path}.factor: is 0; a number other than 0 is needed")
    if len(faults) > before or factor is None:
        return None
    sense = -1.0 if table.phase_sense == "lag" else 1.0
    return Signal(
        amplitude=table.amplitude,
        phase=table.phase,
        real=table.real,
        imaginary=table.imaginary,
        factor=factor * (sqrt(2) if table.scale == "rms" else 1.0),
        phase_factor=sense * (pi / 180 if table.phase_unit == "deg" else 1.0),
        conjugate=table.phase_sense == "lag",
    )


def _sweep(table: SweepTable, faults: list[str]) -> SweepRule:
    if table.column is not None and table.direction is not None:
        faults.append("test.sweep: has column and direction; give one or the other")
    if table.column is not None and (table.up is None or table.down is None):
        faults.append("test.sweep: up and down must say what the column contains")
    if table.column is None and (table.up is not None or table.down is not None):
        faults.append("test.sweep.column: is missing; up and down need it")
    if table.up is not None and table.up == table.down:
        faults.append("test.sweep: up and down are the same; they must differ")
    return SweepRule(table.direction or "recognise", table.column, table.up, table.down)


def _level(table: LevelTable, faults: list[str]) -> LevelRule:
    given = [key for key in ("value", "column", "spread") if getattr(table, key) is not None]
    if len(given) > 1:
        faults.append(f"test.level: has {' and '.join(given)}; give one of them")
    value = None
    if table.value is not None:
        try:
            value = quantity(table.value, "N")
            if not value > 0:
                faults.append(f"test.level.value: is {value:g} N; must be above 0")
        except RsgenError as fault:
            faults.append(f"test.level.value: {' '.join(str(fault).split())}")
    factor = _scaled("test.level", table.unit, table.factor, "N", faults)
    rms = sqrt(2) if table.scale == "rms" else 1.0
    return LevelRule(value, table.column, (factor or 1.0) * rms, table.spread or SPREAD)


def build_measured(table: MeasuredTable, folders: tuple[Path, ...], faults: list[str]) -> MeasuredTest | None:
    """Build the plan for reading; faults are appended, each with its key.

    Parameters
    ----------
    table
        The [test] table.
    folders
        Where the file is looked for, in this order; the last is meant when it is nowhere.
    faults
        Gets one sentence for each fault.
    """
    before = len(faults)
    fault = path_fault(table.file)
    if fault:
        faults.append(f"test.file: {fault}")
    force = _signal(table.force, "test.force", table.force.unit, "N", faults)
    target = _SI[table.response.quantity]
    response = _signal(table.response, "test.response", table.response.unit or target, target, faults)
    sweep = _sweep(table.sweep, faults)
    level = _level(table.level, faults)
    if table.layout.decimal == "," and table.layout.delimiter == ",":
        faults.append(
            "test.layout.delimiter: ',' is the decimal sign here; ';', '\\t', '|' or 'whitespace' is allowed"
        )
    file = folders[-1] if fault else _resolve(table.file, folders, faults)
    if len(faults) > before or force is None or response is None:
        return None
    return MeasuredTest(
        file=file,
        frequency=table.frequency.column,
        frequency_factor=_HERTZ[table.frequency.unit],
        force=force,
        response=response,
        quantity=table.response.quantity,
        sweep=sweep,
        level=level,
        layout=Layout(
            table.layout.delimiter, table.layout.decimal, tuple(table.layout.comments), table.layout.skip
        ),
        sha256=table.sha256,
        format=table.format,
    )
