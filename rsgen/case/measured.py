"""The [test] table of a measured case: units to factors, the data file to a safe path."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi, sqrt
from pathlib import Path

from rsgen.case.document import (
    ForceTable,
    LevelTable,
    MeasuredTable,
    ResponseTable,
    SweepTable,
    TimeTable,
)
from rsgen.case.naming import is_device, quote
from rsgen.errors import RsgenError
from rsgen.measurement import HistoryRule, Layout, LevelRule, MeasuredTest, Signal, SweepRule
from rsgen.units import quantity, sensor_unit

__all__ = ["build_measured", "path_fault"]

_SI = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
# by hand: for a units library rad/s and Hz are both 1/s, which hides a factor of 2 pi
_HERTZ = {"Hz": 1.0, "kHz": 1e3, "mHz": 1e-3, "rad/s": 1 / (2 * pi), "rpm": 1 / 60}
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
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


def _resolve(text: str, folders: tuple[Path, ...], key: str, faults: list[str]) -> Path:
    for folder in folders:
        path = folder / text
        try:
            there = path.exists()
        except OSError as fault:
            faults.append(f"{key}: cannot be looked for: {fault.strerror}; a file that may be read is needed")
            return path
        if there:
            if not path.resolve().is_relative_to(folder.resolve()):
                faults.append(f"{key}: {quote(text)} leads out of its folder; a file inside it is needed")
            return path
    # nowhere: the case's own folder is the last, and the place to name
    return folders[-1] / text


def _files(texts: list[str], folders: tuple[Path, ...], key: str, faults: list[str]) -> tuple[Path, ...]:
    paths = []
    for number, text in enumerate(texts, start=1):
        place = key if len(texts) == 1 else f"{key}.{number}"
        fault = path_fault(text)
        if fault:
            faults.append(f"{place}: {fault}")
        else:
            paths.append(_resolve(text, folders, place, faults))
    return tuple(paths)


def _quantity(path: str, value: float | str | None, unit: str | None, faults: list[str]) -> float | None:
    """Turn a value into SI, or note a fault; None where there is none. Without a unit any is taken."""
    if value is None:
        return None
    try:
        return quantity(value, unit)
    except RsgenError as fault:
        faults.append(f"{path}: {' '.join(str(fault).split())}")
        return None


def _scaled(
    path: str, unit: str, factor: float | str, target: str, faults: list[str], calibrated: bool = True
) -> float | None:
    """Find what 1 ``unit`` times ``factor`` is in ``target``; the factor may have a unit of its own.

    Where the test is not calibrated, any unit stands for the target's: 1 V of a drive for 1 N.
    """
    name = sensor_unit(unit, target)
    try:
        if isinstance(factor, str):
            # column x unit x factor must come out as the target, so this is the unit the factor must have
            return quantity(f"1 {name}", None) * quantity(factor, f"({target})/({name})")
        return quantity(f"1 {name}", target if calibrated else None) * factor
    except RsgenError as fault:
        faults.append(f"{path}: {' '.join(str(fault).split())}")
        return None


def _column_faults(table: ForceTable | ResponseTable, path: str, history: bool) -> Iterator[str]:
    """Say what does not fit among the columns of a signal."""
    sets = {
        "samples": (table.samples,),
        "amplitude": (table.amplitude,),
        "complex": (table.complex,),
        "real": (table.real, table.imaginary),
    }
    given = [key for key, columns in sets.items() if any(column is not None for column in columns)]
    if history:
        if given != ["samples"] or table.phase is not None:
            yield f"{path}: a time history is told by 'samples', its column, and by nothing else"
        return
    halved = "real" in given and None in sets["real"]
    if len(given) != 1 or halved or "samples" in given:
        yield f"{path}: give amplitude (with phase), or real and imaginary, or complex; one is needed"
    if given != ["amplitude"] and table.phase is not None:
        yield f"{path}.phase: goes with amplitude only; leave one out"
    if isinstance(table, ResponseTable) and given == ["amplitude"]:
        if table.phase is None and table.phase_known:
            yield (
                f"{path}.phase: is missing; amplitude and phase, or real and imaginary, are needed "
                "(or phase_known = false)"
            )
        if table.phase is not None and not table.phase_known:
            yield f"{path}.phase_known: is false, but there is a phase; leave one out"
    turned = table.phase is not None or table.imaginary is not None or table.complex is not None
    if turned and table.phase_sense is None:
        yield f"{path}.phase_sense: is missing; 'lag' (positive means later) or 'lead' (earlier) is needed"


def _signal(
    table: ForceTable | ResponseTable,
    path: str,
    unit: str,
    target: str,
    history: bool,
    calibrated: bool,
    faults: list[str],
) -> Signal | None:
    before = len(faults)
    faults += _column_faults(table, path, history)
    factor = _scaled(path, unit, table.factor, target, faults, calibrated)
    if factor == 0:
        faults.append(f"{path}.factor: is 0; a number other than 0 is needed")
    if history and table.scale == "rms":
        faults.append(f"{path}.scale: is 'rms', but samples are instants; leave it out")
    if len(faults) > before or factor is None:
        return None
    sense = -1.0 if table.phase_sense == "lag" else 1.0
    return Signal(
        unit_from_file=table.unit is None and calibrated,
        amplitude=table.amplitude,
        phase=table.phase,
        real=table.real,
        imaginary=table.imaginary,
        complex=table.complex,
        samples=table.samples,
        factor=factor * (sqrt(2) if table.scale == "rms" else 1.0),
        phase_factor=sense * (pi / 180 if table.phase_unit == "deg" else 1.0),
        conjugate=table.phase_sense == "lag",
    )


def _force(table: MeasuredTable, history: bool, calibrated: bool, faults: list[str]) -> Signal | None:
    force = table.force
    if force is None:
        if table.excitation != "ring-down":
            faults.append("test.force: is missing; where it is, or nominal = true, is needed")
        return None
    if not force.nominal:
        return _signal(force, "test.force", force.unit or "N", "N", history, calibrated, faults)
    recorded = (force.amplitude, force.phase, force.real, force.imaginary, force.complex, force.samples)
    if any(column is not None for column in recorded):
        faults.append("test.force.nominal: is true, but there are columns of the force; leave one out")
    if history:
        faults.append("test.force.nominal: a time history needs the force as it was; 'samples' is needed")
    if all(getattr(table.level, key) is None for key in ("value", "values", "column", "name")):
        faults.append("test.level: is missing; without a force value, values, column or name is needed")
    return None


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


def _level(table: LevelTable, files: int, calibrated: bool, faults: list[str]) -> LevelRule:
    keys = ("value", "values", "column", "name", "spread")
    given = [key for key in keys if getattr(table, key) is not None]
    if len(given) > 1:
        faults.append(f"test.level: has {' and '.join(given)}; give one of them")
    if table.values is not None and files > 1 and len(table.values) != files:
        faults.append(f"test.level.values: {len(table.values)} for {files} files; one for each is needed")
    if table.name is not None and table.name.count("{level}") != 1:
        faults.append("test.level.name: must have {level} once, where the number stands: run_{level}N.csv")
    newton = "N" if calibrated else None
    value = _quantity("test.level.value", table.value, newton, faults)
    values = [
        _quantity(f"test.level.values.{number}", entry, newton, faults)
        for number, entry in enumerate(table.values or (), start=1)
    ]
    told = [("value", value), *((f"values.{number}", entry) for number, entry in enumerate(values, start=1))]
    for key, level in told:
        if level is not None and not level > 0:
            faults.append(f"test.level.{key}: is {level:g} N; must be above 0")
    factor = _scaled("test.level", table.unit, table.factor, "N", faults, calibrated)
    rms = sqrt(2) if table.scale == "rms" else 1.0
    return LevelRule(
        value=value,
        column=table.column,
        factor=(factor or 1.0) * rms,
        spread=table.spread or SPREAD,
        values=tuple(level for level in values if level is not None),
        name=table.name,
    )


def _history(table: MeasuredTable, mass: float | None, faults: list[str]) -> HistoryRule | None:
    if table.excitation == "steady":
        if table.time is not None:
            faults.append("test.time: belongs to time histories; leave it out, or set test.excitation")
        return None
    if table.excitation == "ring-down" and mass is None:
        faults.append("system.mass: is missing; a free decay tells stiffness and damping per mass only")
    if table.frequency is not None:
        faults.append("test.frequency: is found from the time histories; leave it out")
    time = table.time or TimeTable()
    given = [key for key in ("column", "rate", "rate_column") if getattr(time, key) is not None]
    if len(given) != 1:
        faults.append("test.time: one of column, rate and rate_column is needed")
    before = len(faults)
    rate = _quantity("test.time.rate", time.rate, "Hz", faults)
    start = _quantity("test.time.start", time.start, "s", faults)
    stop = _quantity("test.time.stop", time.stop, "s", faults)
    plan = table.demodulation
    bandwidth = _quantity("test.demodulation.bandwidth", plan.bandwidth, "Hz", faults)
    band = [
        _quantity(f"test.demodulation.band.{number}", edge, "Hz", faults)
        for number, edge in enumerate(plan.band or (), start=1)
    ]
    for key, value in (("time.rate", rate), ("demodulation.bandwidth", bandwidth)):
        if value is not None and not value > 0:
            faults.append(f"test.{key}: is {value:g} Hz; must be above 0")
    if len(faults) > before or len(given) != 1:
        return None
    edges = tuple(edge for edge in band if edge is not None)
    if edges and not 0 <= edges[0] < edges[1]:
        faults.append("test.demodulation.band: the lowest frequency stands first, the highest above it")
        return None
    return HistoryRule(
        excitation=table.excitation,
        rate=rate,
        rate_column=time.rate_column,
        time=time.column,
        factor=_SECONDS[time.unit] if time.column is not None else 1.0,
        start=start,
        stop=stop,
        band=(edges[0], edges[1]) if edges else None,
        law=plan.law,
        bandwidth=bandwidth,
        harmonics=plan.harmonics,
        mass=mass,
    )


def build_measured(
    table: MeasuredTable,
    folders: tuple[Path, ...],
    faults: list[str],
    mass: float | None = None,
    calibrated: bool = True,
) -> MeasuredTest | None:
    """Build the plan for reading; faults are appended, each with its key.

    Parameters
    ----------
    table
        The [test] table.
    folders
        Where the files are looked for, in this order; the last is meant when they are nowhere.
    faults
        Gets one sentence for each fault.
    mass
        The moving mass [kg], if the case tells it.
    calibrated
        False where force or response have no known scale: their units may then be any.
    """
    before = len(faults)
    history = _history(table, mass, faults)
    timed = table.excitation != "steady"
    if not timed and table.frequency is None:
        faults.append("test.frequency: is missing; its column is needed")
    force = _force(table, timed, calibrated, faults)
    target = _SI[table.response.quantity] + ("/N" if table.response.per_force else "")
    unit = table.response.unit or target
    response = _signal(table.response, "test.response", unit, target, timed, calibrated, faults)
    if timed and table.response.per_force:
        faults.append("test.response.per_force: is for frequency responses, not for time histories")
    sweep = _sweep(table.sweep, faults)
    level = _level(table.level, len(table.file), calibrated, faults)
    if table.layout.decimal == "," and table.layout.delimiter == ",":
        faults.append(
            "test.layout.delimiter: ',' is the decimal sign here; ';', '\\t', '|' or 'whitespace' is allowed"
        )
    files = _files(table.file, folders, "test.file", faults)
    others = _files(table.response.file or [], folders, "test.response.file", faults)
    for key, count in (("sha256", len(table.sha256 or ())), ("response.file", len(others))):
        if count not in (0, len(table.file)):
            faults.append(f"test.{key}: {count} for {len(table.file)} files; one for each is needed")
    if len(faults) > before or response is None:
        return None
    layout = table.layout
    return MeasuredTest(
        files=files,
        frequency=table.frequency.column if table.frequency else None,
        frequency_factor=_HERTZ[table.frequency.unit] if table.frequency else 1.0,
        force=force,
        response=response,
        quantity=table.response.quantity,
        sweep=sweep,
        level=level,
        layout=Layout(layout.delimiter, layout.decimal, tuple(layout.comments), layout.skip, layout.encoding),
        sha256=tuple(table.sha256 or ()),
        format=table.format,
        per_force=table.response.per_force,
        phase_known=table.response.phase_known,
        response_files=others,
        history=history,
    )
