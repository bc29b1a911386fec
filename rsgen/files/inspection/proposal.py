"""The draft of a case that reads a file: where frequency, force and response are, by names and units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from operator import le
from typing import Any

from rsgen.common.errors import listed
from rsgen.data.record_set import QUANTITIES
from rsgen.files.column_titles import PEAK, RMS, VOLTAGES
from rsgen.files.inspection import clues
from rsgen.files.inspection.runs import Runs, choose_runs, is_frequency
from rsgen.files.inspection.sensors import (
    Sensor,
    channel_names,
    find_sensors,
    higher_harmonics,
    is_of_another,
    levels_in_columns,
    split_level,
)
from rsgen.files.plan import HERTZ, LABEL, SECONDS, UNIT_IN_NAME, Layout
from rsgen.files.tree import Contents, Entry, natural_order
from rsgen.formula.units import UNKNOWN

_MIN_SAMPLES = 16
"""Numbers of an array from which it may be a record."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """The tables of a case file as far as names and units say them.

    Parameters
    ----------
    tables
        By name ("test", "test.force" ...): keys and values, in the order to write them.
    doubts
        By "table.key": what the user must look at.
    """

    tables: dict[str, dict[str, Any]]
    doubts: dict[str, str] = field(default_factory=dict)


class _Draft:
    """The tables of a case as far as they are written, and the arrays that have no place in them yet."""

    def __init__(self, contents: Contents) -> None:
        self.contents = contents
        self.free = clues.readable(contents)
        self.levels: list[str] = []
        self.run = ("", "")
        """How the path of one of several runs begins, and the same with a *."""
        self.tables: dict[str, dict[str, Any]] = {}
        self.doubts: dict[str, str] = {}

    def take(self, entry: Entry | None) -> Entry | None:
        """Take an array away from those without a place."""
        self.free = [other for other in self.free if other is not entry]
        return entry

    def ask(self, place: str, text: str) -> None:
        """Ask for an entry that no name or unit says."""
        self.doubts[place] = f"{clues.TODO}{text}"

    def columns(self, size: int) -> list[Entry]:
        """Return the arrays without a place that have ``size`` numbers, or a side of that length."""
        return [one for one in self.free if one.size > 1 and (one.size == size or size in one.shape)]

    def address(self, entry: Entry) -> int | str:
        """Return the address of an array in a case."""
        run, star = self.run
        if run and entry.path.startswith(run):
            return star + entry.path.removeprefix(run)
        return int(entry.path) if self.contents.format == "csv" and entry.path.isdigit() else entry.path


def _abscissa(entries: Sequence[Entry]) -> tuple[Entry | None, Entry | None]:
    """Find the time, or the frequency."""
    rows = [entry for entry in entries if clues.is_real(entry) and entry.size > 1]
    hertz = [entry for entry in rows if entry.unit in HERTZ]
    time = clues.first(rows, lambda entry: entry.unit in SECONDS and not clues.FREQUENCY(entry))
    # rows with phases are readings of amplitudes, whatever their instants
    if time is not None and not (hertz and any(map(clues.is_phase, rows))):
        return time, None
    frequency = clues.first(hertz or rows, lambda _: bool(hertz), is_frequency, clues.is_angular_frequency)
    return (None, frequency) if frequency else (clues.first(rows, clues.TIME), None)


def propose(contents: Contents) -> Proposal | None:
    """Propose the [test] table of a case from names and units; None where a file has no columns of numbers.

    Parameters
    ----------
    contents
        What ``list_contents`` found.
    """
    draft = _Draft(contents)
    time, frequency = _abscissa(draft.free)
    if frequency is not None:
        draft.free, draft.levels = levels_in_columns(draft.free, tree=contents.format != "csv")
        _propose_table(draft, _abscissa(draft.free)[1] or frequency)
    elif not any(entry.size >= _MIN_SAMPLES for entry in draft.free):
        return None
    elif time is None and (contents.format == "csv" or _is_table(draft.free)):
        _propose_nameless(draft)
    else:
        _propose_history(draft, time)
    tables = {"test": {"kind": "measured", "file": contents.file.name, **draft.tables.pop("test", {})}}
    if contents.layout is not None:
        found = {key: getattr(contents.layout, key) for key in ("delimiter", "decimal", "skip", "encoding")}
        needed = {key: value for key, value in found.items() if value != getattr(Layout(), key)}
        tables |= {"test.layout": needed} if needed else {}
    return Proposal(tables | draft.tables, draft.doubts)


_LARGEST_TABLE = {"columns": 9, "rows": 5000}
"""Of a matrix without names; larger ones are drafted as histories. Either asks for every column."""


def _is_table(free: Sequence[Entry]) -> bool:
    """Return True if the only array of a file is a matrix of the size of a table of amplitudes."""
    sides = sorted(side for entry in free[:1] for side in entry.shape if side > 1)
    return len(free) == 1 and len(sides) == 2 and all(map(le, sides, _LARGEST_TABLE.values()))


def _propose_nameless(draft: _Draft) -> None:
    """Write the tables of a case for columns that have names which say nothing, or none."""
    draft.free = [channel for entry in draft.free for channel in clues.channels_of(entry, draft.contents)]
    draft.tables |= {"test.frequency": {"column": UNKNOWN}, "test.force": {"amplitude": UNKNOWN, "unit": "N"}}
    _ask_response(draft, draft.free, "amplitude")
    draft.tables["test.response"] |= {"phase": UNKNOWN, "phase_sense": UNKNOWN}
    draft.doubts |= {
        "test.frequency.column": f"{clues.TODO}write the name or the number of the column; time histories "
        "have excitation, [test.time] and samples instead",
        "test.force.amplitude": f"{clues.TODO}write the column of the force, and its unit",
        "test.response.phase": f"{clues.TODO}write its column; or write real and imaginary in place of both",
        "test.response.phase_sense": f'{clues.TODO}"lead" where a positive phase is earlier, else "lag"',
    }


# ----------------------------------------------------------------------------
# Tables of amplitudes over frequency.


def _propose_table(draft: _Draft, frequency: Entry) -> None:
    """Write the tables of a case for a table of amplitudes over ``frequency``."""
    draft.take(frequency)
    runs = choose_runs(draft.contents, draft.free, frequency)
    draft.free, draft.run, left_out = runs.arrays, runs.run, list(runs.left_out)
    unit = {"unit": frequency.unit} if frequency.unit in HERTZ and frequency.unit != "Hz" else {}
    if clues.is_angular_frequency(frequency) and frequency.unit not in HERTZ:
        unit = {"unit": "rad/s"}
        draft.doubts["test.frequency.unit"] = "its name says an angular frequency; Hz if it is none"
    draft.tables["test.frequency"] = {"column": draft.address(frequency)} | unit
    size = frequency.size
    small = [entry for entry in draft.free if clues.is_real(entry) and entry.size < size]
    real = [entry for entry in draft.columns(size) if clues.is_real(entry)]
    level = draft.take(clues.first(small, clues.LEVEL) or clues.first(real, clues.NOMINAL))
    rows = draft.columns(size)
    higher = higher_harmonics(rows)
    if higher:
        more = "; a table is read at its fundamental, time histories bring harmonics in"
        left_out.append(f"left out: {listed(list(map(clues.called, higher)))}{more}")
    # by identity: to compare each of thousands with each takes long
    unread = set(map(id, higher))
    sensors, loose = find_sensors([entry for entry in rows if id(entry) not in unread])
    nominal = level is not None and clues.is_force(level)
    driven = _write_signals(draft, sensors, loose, left_out, of_force=nominal)
    _write_level(draft, level, driven, runs)


def _write_level(draft: _Draft, level: Entry | None, driven: bool, runs: Runs) -> None:
    """Write [test.level], where levels do not follow from the measured forces, or runs are called by them."""
    table: dict[str, Any] = {}
    unit = UNIT_IN_NAME.match(runs.form.partition("{level}")[2])
    in_newton = unit is not None and unit[1].endswith("N")
    if draft.levels:
        table = {"values": draft.levels}
    elif level is not None:
        table = {"column": draft.address(level)} | (
            {"unit": clues.unit_for(level.unit, "N")} if clues.is_force(level) else {}
        )
    elif runs.form and (in_newton or driven):
        table = {"name": runs.form} | ({} if in_newton else {"unit": LABEL})
        draft.doubts["test.level.name"] = f"by {listed(runs.names)}"
    elif not driven and runs.names:
        alike = [e for e in draft.contents.entries if e.title and not e.fault]
        alike = [entry for entry in alike if fnmatchcase(entry.path, f"{draft.run[1]}*")]
        said = [split_level(e.title) for e in sorted(alike, key=lambda entry: natural_order(entry.path))]
        if len(said) == len(runs.names) and all(amount for _, amount in said):
            others = dict.fromkeys(rest for rest, _ in said)
            differ = f", which are of {' and of '.join(others)}" if len(others) > 1 else ""
            draft.doubts["test.level.values"] = f"by the titles of the entries{differ}"
            table = {"values": [amount for _, amount in said]}
        else:
            draft.ask("test.level.values", "write the force amplitude of each")
            table = {"values": [f"{UNKNOWN} N"] * len(runs.names)}
    elif not driven:
        draft.ask("test.level.value", "write the force amplitude of this file")
        table = {"value": f"{UNKNOWN} N"}
    if not table:
        return
    title = "" if level is None else clues.called(level)
    if draft.tables["test.response"].get("per_force") and not PEAK.search(title):
        # amounts alone follow from it, so that no mass or fit would show a wrong one
        table["scale"] = "rms" if RMS.search(title) else "peak"
        if table["scale"] == "peak":
            draft.doubts["test.level.scale"] = _SCALE
    draft.tables["test.level"] = table


# ----------------------------------------------------------------------------
# Time histories.

_EXCITATIONS = {
    "step": "stepped-sine", "multisine": "multisine",
    **dict.fromkeys(("sweep", "swept", "sinesw", "chirp"), "swept-sine"),
    **dict.fromkeys(("decay", "ring", "release", "hammer", "impact", "impulse", "ausschwing"), "ring-down"),
}  # fmt: skip
"""Excitations by what stands in the name of a file."""
_CHOICES = '"swept-sine", "stepped-sine", "multisine" or "ring-down"'


def _propose_history(draft: _Draft, time: Entry | None) -> None:
    """Write the tables of a case for time histories."""
    stem = draft.contents.file.stem.casefold()
    excitation = next((kind for sign, kind in _EXCITATIONS.items() if sign in stem), UNKNOWN)
    draft.tables["test"] = {"excitation": excitation}
    if excitation == UNKNOWN:
        table = "" if time else "; a table has [test.frequency] in place of it, with a column such as a_*[1]"
        draft.ask("test.excitation", f"write {_CHOICES}{table}")
    draft.tables["test.time"] = _time(draft, draft.take(time))
    longest = max((max(entry.shape, default=1) for entry in draft.free), default=0)
    size = time.size if time else longest
    sensors = [
        Sensor(channel, (("samples", channel),))
        for entry in filter(clues.is_real, draft.columns(size))
        for channel in clues.channels_of(entry, draft.contents)
    ]
    _write_signals(draft, sensors, [], [])


def _time(draft: _Draft, time: Entry | None) -> dict[str, Any]:
    """Return the table of the time."""
    if time is not None:
        unit = {"unit": time.unit} if time.unit in SECONDS and time.unit != "s" else {}
        return {"column": draft.address(time)} | unit
    numbers = [entry for entry in draft.free if entry.size == 1]
    rate = clues.first(numbers, clues.RATE)
    if rate is not None:
        return {"rate_column": draft.address(rate)}
    step = clues.first(numbers, clues.INCREMENT)
    if step is None or not step.low:
        draft.ask("test.time.rate", "not in the file: write the sampling rate")
        return {"rate": f"{UNKNOWN} Hz"}
    draft.doubts["test.time.rate"] = f"one over {step.path}"
    return {"rate": f"{1 / step.low:.10g} Hz"}


# ----------------------------------------------------------------------------
# What drives the structure, and the responses.


def _is_response(entry: Entry) -> bool:
    remarked = "frequency response" in entry.remark or "time response" in entry.remark
    named = clues.RESPONSE(entry) or clues.QUOTIENT(entry) or remarked
    return bool(clues.motion_of(entry)) or (named and not (clues.FORCE(entry) or clues.is_force(entry)))


def _find_base(sensors: Sequence[Sensor]) -> list[Sensor]:
    """Find motions of a base by the names of channels; none where there is no other motion."""
    moved = [s for s in sensors if clues.motion_of(s.main) in QUANTITIES.values()]
    in_volts = [s for s in sensors if s.main.unit in VOLTAGES and _is_response(s.main)]
    bare = [sensor for sensor in sensors if not sensor.main.unit] + in_volts
    moved += [sensor for sensor in bare if _is_response(sensor.main) or clues.BASE(sensor.main)]
    named = [sensor for sensor in moved if clues.BASE(sensor.main)]
    # without a unit a shaker may stand for its force or voltage, a base for its motion alone
    sure = any(sensor.main.unit or not clues.DRIVE(sensor.main) for sensor in named)
    others = len(named) < len(moved) or (sure and not all(clues.BASE(sensor.main) for sensor in bare))
    return named if others else []


def _find_drive(draft: _Draft, sensors: list[Sensor], of_force: bool) -> tuple[Sensor | None, list[Sensor]]:
    """Find the force, else the motions of a base, else what drove a shaker; a level in N is of a force."""
    still = [
        sensor.main for sensor in sensors if not (clues.motion_of(sensor.main) or clues.QUOTIENT(sensor.main))
    ]
    remarked = [entry for entry in still if "force" in entry.remark and not _is_quotient(entry)]
    force = clues.first(still, clues.is_force) or clues.first(
        remarked or still, lambda _: bool(remarked), clues.FORCE
    )
    base = _find_base(sensors) if force is None and not of_force else []
    force = force if force or base else clues.first(still, clues.DRIVE)
    return next((sensor for sensor in sensors if sensor.main is force), None), base


def _write_base(draft: _Draft, base: Sequence[Sensor], relative: bool) -> None:
    """Write the motion of the base; of several sensors the first, and the others as a doubt."""
    said = {"response": "relative" if relative else "absolute"}
    draft.tables["test.base"] = _motion(draft, base[0], "test.base") | said
    if not relative:
        draft.ask("test.base.response", 'or "relative", if the response was measured against the base')
    if base[1:]:
        others = listed([clues.called(sensor.main) for sensor in base[1:]])
        draft.ask("test.base.quantity", f"or {others}: the driven direction")


def _write_signals(
    draft: _Draft, sensors: list[Sensor], loose: list[Entry], left_out: list[str], of_force: bool = False
) -> bool:
    """Write what drives the structure and the responses; return whether the former was recorded.

    Parameters
    ----------
    sensors, loose
        The channels of the test, and phases of none of them.
    left_out
        What else is not read, in sentences.
    of_force
        Whether the file has nominal levels of a force.
    """
    force, base = _find_drive(draft, sensors, of_force)
    driving = set(map(id, [force, *base]))
    moved = [sensor for sensor in sensors if id(sensor) not in driving]
    responses = [sensor for sensor in moved if _is_response(sensor.main)]
    free = [sensor for sensor in moved if not _is_response(sensor.main)]
    history = "test.time" in draft.tables
    if not (history or responses or base) and force is not None and len(free) == 1:
        responses, free = free, []
        draft.ask(
            "test.response.quantity",
            f"the only column left, {clues.called(responses[0].main)}; write what it is",
        )
    responses.sort(key=lambda sensor: (not sensor.has_phase, sensor.places[0][0] == "amplitude"))
    if responses and not responses[0].has_phase:
        phase = next((phase for phase in loose if not is_of_another(phase, responses[0].main)), None)
        if phase is not None:
            others = listed([clues.called(sensor.main) for sensor in responses[1:]])
            doubt = f"or that of {others}: its title names no channel" if others else ""
            responses[0] = responses[0].with_phase(phase, doubt)
            loose = [other for other in loose if other is not phase]
    if base:
        _write_base(draft, base, any(clues.RELATIVE(sensor.main) for sensor in responses[:1]))
    elif force is not None:
        draft.tables["test.force"] = _force(draft, force)
    else:
        _ask_force(draft, responses)
    if responses:
        columns = [*(column for sensor in free for _, column in sensor.places), *loose]
        if rest := [clues.called(column) for column in columns if column.unit not in (*HERTZ, *SECONDS)]:
            left_out = [*left_out, f"left out: {listed(rest)}"]
        _write_responses(draft, responses, left_out)
    else:
        columns = [column for sensor in free for _, column in sensor.places]
        _ask_response(draft, columns, "samples" if history else "amplitude")
    return bool(force or base)


def _ask_force(draft: _Draft, responses: Sequence[Sensor]) -> None:
    """Write what stands for a force that no column names, or ask where it is."""
    if "test.time" not in draft.tables:
        draft.tables["test.force"] = {"nominal": True}
        draft.doubts["test.force.nominal"] = "no force is named, so the level stands for it"
        if responses and clues.BASE(responses[0].main):
            draft.ask(
                "test.force.nominal",
                "no force, and the only motion is that of a base: write that of the mass into "
                "the file, such as transmissibility times base",
            )
    elif draft.tables["test"]["excitation"] != "ring-down":
        draft.tables["test.force"] = {"samples": UNKNOWN, "unit": "N"}
        draft.ask("test.force.samples", "write the path of the force; a ring-down needs none")


def _ask_response(draft: _Draft, columns: Sequence[Entry], key: str) -> None:
    """Ask which of several columns is the response, where no name or unit says it."""
    draft.tables["test.response"] = {"quantity": "displacement", "unit": "m", key: UNKNOWN}
    called = [(one.path, clues.called(one)) for one in columns]
    names = listed([name if path.endswith(name) else f"{path} ({name})" for path, name in called])
    draft.ask("test.response.unit", "write its unit")
    which = f"write which is the response, its quantity and unit: {names}"
    none = "no column is left for the response; where it is in another file, write `file` and its column"
    draft.ask(f"test.response.{key}", which if names else none)
    if key == "amplitude":
        draft.tables["test.response"]["scale"] = "peak"
        draft.doubts["test.response.scale"] = _SCALE


_MAX_CHANNELS_PROPOSED = 8
"""Channels that are proposed with a table of their own; a file of a modal test may have hundreds."""


def _write_responses(draft: _Draft, responses: Sequence[Sensor], left_out: list[str]) -> None:
    """Write [test.response], and [test.channels] where there are several."""
    # a sum of channels needs the phases of all
    bare = [sensor for sensor in responses if sensor.has_phase < responses[0].has_phase]
    if bare:
        left_out = [f"left out: {', '.join(clues.called(s.main) for s in bare)}, without a phase", *left_out]
    responses = responses[: len(responses) - len(bare)]
    others = [clues.called(sensor.main) for sensor in responses[1:]]
    if not others or _is_quotient(responses[0].main):
        table = _motion(draft, responses[0], "test.response")
        if "phase_sense" not in table and "samples" not in table:
            table["phase_known"] = False
        draft.tables["test.response"] = table
        key = responses[0].places[0][0]
        if others:
            left_out = [f"left out: {listed(others)}; a case reads one response", *left_out]
        said = draft.doubts.get(f"test.response.{key}", "")
        if doubt := "; ".join(filter(None, [said, *left_out])):
            draft.doubts[f"test.response.{key}"] = doubt
        return
    chosen = responses[:_MAX_CHANNELS_PROPOSED]
    names = channel_names(chosen)
    for name, sensor in zip(names, chosen, strict=True):
        place = f"test.channels.{name}"
        draft.tables[place] = _motion(draft, sensor, place)
    draft.tables["test.response"] = {"channels": names[0]}
    more = f", {len(responses) - len(chosen)} more are in the file" if len(responses) > len(chosen) else ""
    between = f'an element between two has across = "{names[0]} - {names[1]}"'
    draft.doubts["test.response.channels"] = "; ".join(
        [f"or {', '.join(names[1:])}{more}", between, *left_out]
    )


# ----------------------------------------------------------------------------
# The keys of a channel in a case: quantity, unit, scale, columns, the sense of its phase.

_SCALE = f'{clues.TODO}or "rms"; the file does not say'
_SENSE = (
    "no title says it: a positive phase is earlier (lead) or later (lag); identify and run tell a wrong one"
)


def _force(draft: _Draft, sensor: Sensor) -> dict[str, Any]:
    known = clues.is_force(sensor.main)
    unit = clues.unit_for(sensor.main.unit, "N") if known else UNKNOWN if sensor.main.unit else "N"
    units = {"unit": unit} | _ask_unit(draft, sensor.main, "test.force", known)
    columns = _columns(draft, sensor, "test.force")
    head = {key: columns.pop(key) for key in ("samples", "amplitude") if key in columns}
    return head | units | columns


def _ask_unit(draft: _Draft, entry: Entry, place: str, known: bool) -> dict[str, Any]:
    """Say where a unit comes from, or ask for it where the file names none that is read.

    Returns
    -------
    Unit and factor in place of those of the table; of volts the factor is asked for.
    """
    example = '"22.5 mV/N" or "10 N/V"' if place == "test.force" else '"100 mV/g"'
    if not known and entry.unit in VOLTAGES:
        draft.ask(f"{place}.factor", f"write the sensitivity of the sensor, such as {example}")
        return {"unit": entry.unit, "factor": UNKNOWN}
    if not known:
        said = f'the file says {entry.unit!r}; write unit and factor, as unit = "V", factor = {example}'
        none = f"{entry.unit_source or 'no unit stands with it'}; write the unit"
        draft.ask(f"{place}.unit", said if entry.unit else none)
    elif entry.unit_source:
        draft.doubts[f"{place}.unit"] = entry.unit_source
    return {}


def _is_quotient(entry: Entry) -> bool:
    """Return True for a response over force."""
    remarked = "over force" in entry.remark or "frequency response" in entry.remark
    return clues.motion_of(entry).endswith("/N") or bool(clues.QUOTIENT(entry)) or remarked


def _motion(draft: _Draft, sensor: Sensor, place: str) -> dict[str, Any]:
    """Return the table of a motion."""
    entry, si = sensor.main, clues.motion_of(sensor.main)
    about = f"{clues.last_name(entry)} {entry.remark}".casefold()
    by_name = (kind for word, kind in clues.NAMES.items() if word in about or word.strip() == about.strip())
    by_unit = (kind for kind, unit in QUANTITIES.items() if si.removesuffix("/N") == unit)
    kind = next(by_unit, None) or next(by_name, "displacement")
    unit = clues.unit_for(entry.unit, si) if si else UNKNOWN if entry.unit else QUANTITIES[kind]
    table: dict[str, Any] = {"quantity": kind, "unit": unit}
    table |= _ask_unit(draft, entry, place, bool(si))
    if not si and (clues.DECIBEL.search(entry.unit) or clues.DECIBEL.search(clues.last_name(entry))):
        # no factor makes a logarithm linear: a case that does not pass is better than a wrong one
        table["unit"] = entry.unit or "dB"
        draft.ask(f"{place}.unit", "decibels are not read: write linear numbers into the file")
    said = ""
    if _is_quotient(entry):
        table["unit"] += "" if si.endswith("/N") or unit == UNKNOWN else "/N"
        table["per_force"] = True
        said = clues.OVER_FORCE[kind]
        draft.doubts[f"{place}.quantity"] = f"{said}, {table['unit']}"
        if "adds damping" in entry.remark:
            draft.doubts[f"{place}.per_force"] = "measured with an exponential window, which adds damping"
    pattern = str(draft.address(entry))
    alike = [e for e in draft.contents.entries if fnmatchcase(e.path, pattern) and not e.fault]
    units = sorted({other.unit for other in alike})
    if draft.run[0] and len(units) > 1:
        # without the key each entry is read in the unit that the file names for it
        del table["unit"]
        said = ", ".join(filter(None, [said, f"in the units of the file: {', '.join(units)}"]))
        draft.doubts[f"{place}.quantity"] = said
    return table | _columns(draft, sensor, place)


def _columns(draft: _Draft, sensor: Sensor, place: str) -> dict[str, Any]:
    """Say where the columns of a channel are, what its amplitudes are, and the sense of its phase."""
    main, columns = sensor.main, dict(sensor.places)
    table: dict[str, Any] = {key: draft.address(column) for key, column in columns.items()}
    if "amplitude" in table or "complex" in table:
        if main.scale == "half-peak":
            table["factor"] = 2.0
        elif RMS.search(f"{clues.called(main)} {main.remark}") and main.scale in ("", "rms"):
            table["scale"] = "rms"
        elif "amplitude" in table and not (_is_quotient(main) or main.scale or PEAK.search(main.title)):
            table["scale"] = "peak"
            draft.doubts[f"{place}.scale"] = _SCALE
    if sensor.doubt:
        draft.doubts[f"{place}.{sensor.places[-1][0]}"] = sensor.doubt
    if sensor.has_phase:
        # two parts or complex numbers have no column that could say the sense
        phase = columns.get("phase")
        said = clues.phase_sense(phase) if phase else ""
        table |= {"phase_unit": "rad"} if phase and phase.unit == "rad" else {}
        table["phase_sense"] = said or "lead"
        if not said and _SENSE not in draft.doubts.values():
            draft.doubts[f"{place}.phase_sense"] = _SENSE
    return table
