"""The draft of a case that reads a file: where frequency, force and response are, by names and units."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

from rsgen.common.errors import listed
from rsgen.files.column_titles import split_title, unit_in
from rsgen.files.inspection.clues import (
    ANGULAR,
    BASE,
    DRIVE,
    FORCE,
    FREQUENCY,
    INCREMENT,
    IS_FORCE,
    IS_MOTION,
    LEVEL,
    LOAD,
    LONG,
    NOMINAL,
    PHASE,
    QUOTIENT,
    RATE,
    REAL,
    RESPONSE,
    RUN,
    TIME,
    TODO,
    Clue,
    Draft,
    last_name,
    of_size,
    remarked,
    run_of,
    unit_for,
)
from rsgen.files.inspection.sensors import (
    Sensor,
    find_base,
    find_sensors,
    fundamentals,
    is_of_another,
    place_of,
    unit_of_force,
    write_base,
    write_motions,
)
from rsgen.files.plan import HERTZ, SECONDS, Layout
from rsgen.files.tree import Contents, Entry, natural_order
from rsgen.formula.units import UNKNOWN

# ----------------------------------------------------------------------------
# Levels that stand side by side: columns "x@1N", "x@2N", or variables "phase_1N", "phase_2N".

_LEVEL = re.compile(
    r"(?:(?<![A-Za-z])(?:F|force|level|Kraft|Stufe)\s?[=: ]\s?)?"
    r"(?<![\d.,])(\d{1,9}(?:[.,]\d{1,9})?)[\s_]?([munk]?N|lbf)(?![A-Za-z])"
)
"""The amount of a force in a name. A number without one may as well be that of a sensor."""


def level_in(text: str) -> str:
    """Return the amount of a force in a text as a case writes it, "" where there is none.

    Examples
    --------
    >>> level_in("receptance, 2,5 N, up"), level_in("BEAM 2 +Z")
    ('2.5 N', '')
    """
    found = _LEVEL.search(text)
    return f"{found[1].replace(',', '.')} {found[2]}" if found else ""


def without_level(text: str) -> str:
    """Remove the amount of a force from a text.

    Examples
    --------
    >>> without_level("receptance, 2 N, up, measured")
    'receptance, up, measured'
    """
    return _LEVEL.sub("", text).replace(", ,", ",").strip(" ,_-")


def levels_in_columns(entries: Sequence[Entry], *, tree: bool = False) -> tuple[list[Entry], list[str]]:
    """Put columns that differ in the amount of a force alone under one address with a *.

    Parameters
    ----------
    entries
        Of a file.
    tree
        Whether its reader sorts what a * means, as of all formats but text, whose columns keep their order.

    Returns
    -------
    The entries, of each family the first under the address of all; and the levels in their order, as a case
    writes them; none where there are no such columns.

    Examples
    --------
    >>> columns = [Entry("f"), Entry("x@1N [mm]"), Entry("x@2,5N [mm]")]
    >>> found, levels = levels_in_columns(columns)
    >>> [entry.path for entry in found], found[1].unit, levels
    (['f', 'x@*N [mm]'], 'mm', ['1 N', '2.5 N'])
    """
    families: dict[str, list[tuple[str, Entry]]] = defaultdict(list)
    for entry in entries:
        found = _LEVEL.search(entry.path)
        # a column that goes by its number has no name for a * to stand in; a sheet has
        if not found or "*" in entry.path:
            continue
        if found.end() <= entry.path.rfind("/") or entry.title in ("", entry.path):
            address = f"{entry.path[: found.start(1)]}*{entry.path[found.end(1) :]}"
            families[address].append((level_in(found[0]), entry))
    by_levels: dict[tuple[str, ...], dict[str, Entry]] = defaultdict(dict)
    for address, members in families.items():
        if tree:
            members.sort(key=lambda member: natural_order(member[1].path))
        levels = tuple(level for level, _ in members)
        if len(set(levels)) == len(levels) > 1:
            by_levels[levels][address] = members[0][1]
    if not by_levels:
        return list(entries), []
    levels = max(by_levels, key=lambda found: (len(by_levels[found]), len(found)))
    together = by_levels[levels]
    first = {entry.path: _joined(address, entry) for address, entry in together.items()}
    members_of = {entry.path for address in together for _, entry in families[address]}
    kept = [first.get(e.path, e) for e in entries if e.path in first or e.path not in members_of]
    return kept, list(levels)


def _joined(address: str, first: Entry) -> Entry:
    """Put a family under one address; its name and its unit are those without the level."""
    if first.title not in ("", first.path):
        return replace(first, path=address)
    name, unit = split_title(_LEVEL.sub("", first.path))
    name = name.strip(" _@-,") or first.path
    if not unit and first.unit != unit_in(first.path):
        unit = first.unit
    return replace(first, path=address, title=f"{name} [{unit}]" if unit else name, unit=unit)


# ----------------------------------------------------------------------------
# The draft of the case that reads a table of amplitudes over frequency: force or base, responses, level.

_NO_MOTION = ~IS_MOTION & ~QUOTIENT
# "f_re_N" is a force
_NAMED_FREQUENCY = FREQUENCY & ~IS_FORCE & _NO_MOTION


class _Table:
    """The channels of a table that are left while force, base and responses are chosen."""

    def __init__(self, sensors: Sequence[Sensor], loose: Sequence[Entry]) -> None:
        self.free = list(sensors)
        self.loose = list(loose)

    def take(self, *clues: Clue) -> Sensor | None:
        """Take the first channel for which the first clue that holds for any holds."""
        found = next((sensor for clue in clues for sensor in self.free if clue(sensor.main)), None)
        if found is not None:
            self.free.remove(found)
        return found

    def take_all(self, clue: Clue) -> list[Sensor]:
        """Take all channels for which a clue holds."""
        found = [sensor for sensor in self.free if clue(sensor.main)]
        self.free = [sensor for sensor in self.free if sensor not in found]
        return found


def _are_channels(draft: Draft, run: tuple[str, str]) -> bool:
    """Return True if entries with one name are force and response of one run, as in a universal file."""
    first, star = run
    kinds: dict[str, set[bool]] = {}
    for entry in draft.free:
        if fnmatchcase(entry.path, f"{star}*"):
            kinds.setdefault(entry.path.split("/", first.count("/"))[-1], set()).add(IS_FORCE(entry))
    return any(len(found) > 1 for found in kinds.values())


def _other_points(draft: Draft, star: str) -> str:
    """Say which points the runs of a file are of where they are no levels of one; "" where they are."""
    motions = [e for e in draft.free if IS_MOTION(e) and e.title and fnmatchcase(e.path, f"{star}*")]
    points = list(dict.fromkeys(entry.remark for entry in motions))
    if len(points) < 2:
        return ""
    same = sum(entry.remark == points[0] for entry in motions) - 1
    again = f" and {same} more of this point" if same else ""
    names = list(dict.fromkeys(e.title for e in motions if e.remark != points[0]))
    return f"left out: {listed(names)}{again}; a case reads one point, whose entries are levels"


def _titles_of_runs(draft: Draft) -> list[str]:
    """Return the titles of all runs in the order in which these are read."""
    star = draft.run[1] if draft.run else ""
    alike = [e for e in draft.contents.entries if e.title and not e.fault and fnmatchcase(e.path, f"{star}*")]
    return [e.title for e in sorted(alike, key=lambda entry: natural_order(entry.path))]


def _level(draft: Draft, level: Entry | None, driven: bool, runs: int) -> dict[str, Any]:
    """Return the table of the level; empty where levels follow from the measured forces."""
    if draft.levels:
        return {"values": draft.levels}
    if level is not None:
        unit = {"unit": unit_for(level.unit, "N")} if IS_FORCE(level) else {}
        return {"column": draft.address(level)} | unit
    if driven:
        run = next((entry for entry in draft.free if (REAL & LONG & RUN)(entry)), None)
        if run is not None:
            place = "test.base" if "test.base" in draft.tables else "test.force"
            first, column = next(iter(draft.tables[place])), draft.address(run)
            hint = f"levels are amounts that differ little; or [test.level] with column = {column!r}"
            draft.doubts.setdefault(f"{place}.{first}", hint)
        return {}
    titles = _titles_of_runs(draft) if runs else []
    said = [level_in(title) for title in titles]
    if len(said) == runs and runs and all(said):
        others = dict.fromkeys(without_level(title) for title in titles)
        differ = f", which are of {' and of '.join(others)}" if len(others) > 1 else ""
        draft.doubts["test.level.values"] = f"by the titles of the entries{differ}"
        return {"values": said}
    if runs:
        draft.doubts["test.level.values"] = f"{TODO}write the force amplitude of each"
        return {"values": [f"{UNKNOWN} N"] * runs}
    draft.doubts["test.level.value"] = f"{TODO}write the force amplitude of this file"
    return {"value": f"{UNKNOWN} N"}


def _named_level(draft: Draft, size: int, alike: Clue) -> Entry | None:
    """Take the nominal level: a level with a name goes first, for its name may be one of a force, too."""
    return draft.take(
        REAL & LEVEL & Clue(lambda entry: entry.size < size),
        alike & REAL & NOMINAL,
    )


def _force(table: _Table) -> Sensor | None:
    named = (FORCE | LOAD) & _NO_MOTION
    in_parts = {id(sensor.main) for sensor in table.free if sensor.places[0][0] == "real"}
    parts = Clue(lambda entry: id(entry) in in_parts)
    return table.take(
        parts & IS_FORCE,
        REAL & IS_FORCE,
        parts & named,
        REAL & FORCE & _NO_MOTION,
        REAL & DRIVE & _NO_MOTION,
        ~REAL & (IS_FORCE | (LOAD & _NO_MOTION)),
    )


def _responses(table: _Table) -> list[Sensor]:
    """Take the channels that are responses by unit or name, those with a phase first."""
    others = ~FORCE & ~IS_FORCE
    named = (RESPONSE | QUOTIENT | remarked("frequency response")) & others
    found = table.take_all(IS_MOTION | named)
    return sorted(found, key=lambda sensor: (not sensor.has_phase, sensor.places[0][0] == "amplitude"))


def _with_loose_phase(responses: list[Sensor], table: _Table) -> list[Sensor]:
    """Assign a phase whose title names no channel to the first response if that has none."""
    if not responses or responses[0].has_phase:
        return responses
    for phase in table.loose:
        if not is_of_another(phase, responses[0].main):
            table.loose.remove(phase)
            others = [sensor.main.title or sensor.main.path for sensor in responses[1:]]
            doubt = f"or that of {listed(others)}: its title names no channel" if others else ""
            places = (*responses[0].places, ("phase", phase))
            return [Sensor(responses[0].main, places, doubt), *responses[1:]]
    return responses


def _called(column: Entry) -> str:
    return column.title or column.path


def _ask_response(draft: Draft, names: Sequence[str], key: str = "amplitude") -> None:
    """Ask which of several columns is the response, where no name or unit says it."""
    draft.tables["test.response"] = {"quantity": "displacement", "unit": "m", key: UNKNOWN}
    asked = f"{TODO}write which is the response, its quantity and unit: {listed(names)}"
    missing = (
        f"{TODO}no column is left for the response; where it is in another file, write `file` and its column"
    )
    draft.doubts[f"test.response.{key}"] = asked if names else missing


def _left_out(table: _Table, higher: dict[int, list[Entry]]) -> str:
    """Say which columns of channels are not read."""
    others = [column for sensor in table.free if RESPONSE(sensor.main) for column in sensor.columns]
    names = [_called(entry) for entry in (*others, *table.loose)]
    said = ""
    if names:
        said = f"left out: {listed(names)}"
    if higher:
        orders = f"harmonic{'s' * (len(higher) > 1)} {', '.join(map(str, higher))}"
        said += "; " * bool(said) + (
            f"left out: {orders}; a table is read at its fundamental, time histories bring harmonics in"
        )
    return said


def _own_frequencies(draft: Draft, frequency: Entry) -> str:
    """Leave out what lies with a frequency of its own, as another test in the same file does; say so."""
    named = REAL & LONG & _NAMED_FREQUENCY
    others = {e.path.rpartition("/")[0] for e in draft.free if named(e)} - {frequency.path.rpartition("/")[0]}
    # a / in the title of a text is no folder
    tree = draft.contents.format != "csv"
    left = [e.path for e in draft.free if tree and e.path.rpartition("/")[0] in others]
    draft.free = [e for e in draft.free if e.path not in left]
    return f"left out: {listed(left)}, which have a frequency of their own" if left else ""


def propose_amplitudes(draft: Draft, frequency: Entry) -> None:
    """Write the tables of a case for a table of amplitudes over ``frequency``."""
    draft.tables["test"] = {}
    runs = run_of(frequency, draft.contents.entries)
    of_others = ""
    if runs is not None and _are_channels(draft, runs[:2]):
        runs = None
    elif runs is not None and (of_others := _other_points(draft, runs[1])):
        draft.free = [entry for entry in draft.free if entry.path.startswith(runs[0])]
        runs = None
    elif runs is not None:
        draft.run = runs[:2]
        draft.free = [entry for entry in draft.free if entry.path.startswith(runs[0])]
    else:
        of_others = _own_frequencies(draft, frequency)
    unit = {"unit": frequency.unit} if frequency.unit in HERTZ and frequency.unit != "Hz" else {}
    if ANGULAR(frequency) and frequency.unit not in HERTZ:
        unit = {"unit": "rad/s"}
        draft.doubts["test.frequency.unit"] = "its name says an angular frequency; Hz if it is none"
    draft.tables["test.frequency"] = {"column": draft.address(frequency)} | unit
    alike = LONG & of_size(frequency.size)
    named = _named_level(draft, frequency.size, alike)
    draft.free, higher = fundamentals(draft.free)
    sensors = find_sensors(draft.free, alike)
    table = _Table(sensors.found, sensors.loose)
    base = find_base(table.free)
    if named is not None and base is not None and (IS_FORCE(named) or not BASE(base.sensor.main)):
        # levels of a force are no base's; others need its name
        base = None
    if base is not None:
        # other directions of the base are no responses
        table.free = [s for s in table.free if s is not base.sensor and not BASE(s.main)]
    force = None if base else _force(table)
    responses = _with_loose_phase(_responses(table), table)
    # one device writes all phases in one sense
    reference = base.sensor if base else force
    shared = "lead" if reference and reference.has_phase else ""
    if base is not None:
        write_base(draft, base, shared)
    else:
        draft.tables["test.force"] = _force_table(draft, force, shared)
    if not base and not force and responses and BASE(responses[0].main):
        draft.doubts["test.force.nominal"] = (
            f"{TODO}no force, and the only motion is that of a base: write that of the mass into the file, "
            "such as transmissibility times base"
        )
    level = _level(draft, named, bool(base or force), runs[2] if runs else 0)
    if responses:
        write_motions(
            draft, responses, shared, "; ".join(filter(None, [of_others, _left_out(table, higher)]))
        )
    else:
        _ask_response(draft, [name for sensor in table.free for name in map(_called, sensor.columns)])
    if level:
        draft.tables["test.level"] = level


def _force_table(draft: Draft, force: Sensor | None, sense: str) -> dict[str, Any]:
    if force is None:
        draft.doubts["test.force.nominal"] = "no force is named, so the level stands for it"
        return {"nominal": True}
    place = place_of(draft, force, "test.force", sense)
    columns = {key: place.pop(key) for key in ("amplitude",) if key in place}
    return columns | {"unit": unit_of_force(draft, force.main)} | place


# ----------------------------------------------------------------------------
# The draft of the case that reads time histories: where time, force or base and responses are.

_EXCITATIONS = {
    "step": "stepped-sine",
    "multisine": "multisine",
    **dict.fromkeys(("sweep", "swept", "sinesw", "chirp"), "swept-sine"),
    **dict.fromkeys(("decay", "ring", "release", "hammer", "impact", "impulse", "ausschwing"), "ring-down"),
}
"""Excitations by what stands in the name of a file."""
_CHOICES = '"swept-sine", "stepped-sine", "multisine" or "ring-down"'


def _time(draft: Draft, time: Entry | None, rate: Entry | None) -> int:
    """Write where the time is; give the number of samples."""
    step = draft.take(~LONG & INCREMENT) if time is rate is None else None
    if step is not None and step.low:
        draft.tables["test.time"] = {"rate": f"{1 / step.low:.10g} Hz"}
        draft.doubts["test.time.rate"] = f"one over {step.path}"
        return _longest(draft)
    if time is not None:
        table: dict[str, Any] = {"column": draft.address(time)}
        draft.tables["test.time"] = table | (
            {"unit": time.unit} if time.unit in SECONDS and time.unit != "s" else {}
        )
        return time.size
    draft.tables["test.time"] = (
        {"rate": f"{UNKNOWN} Hz"} if rate is None else {"rate_column": draft.address(rate)}
    )
    if rate is None:
        draft.doubts["test.time.rate"] = f"{TODO}not in the file: write the sampling rate"
    return _longest(draft)


def _longest(draft: Draft) -> int:
    return max((max(entry.shape, default=1) for entry in draft.free), default=0)


def propose_history(draft: Draft, time: Entry | None, rate: Entry | None) -> None:
    """Write the tables of a case for time histories."""
    stem = draft.contents.file.stem.casefold()
    kinds = (kind for sign, kind in _EXCITATIONS.items() if sign in stem)
    test: dict[str, Any] = {"excitation": next(kinds, UNKNOWN)}
    draft.tables["test"] = test
    if test["excitation"] == UNKNOWN:
        draft.doubts["test.excitation"] = f"{TODO}write {_CHOICES}"
    fits = REAL & LONG & of_size(_time(draft, time, rate))
    no_motion = ~IS_MOTION
    force = draft.take(fits & IS_FORCE, fits & remarked("force"), fits & FORCE & no_motion)
    base = None
    if force is None:
        base = find_base([_recorded(entry) for entry in draft.free if fits(entry)])
        force = None if base else draft.take(fits & DRIVE & no_motion)
    if base is not None:
        draft.free = [entry for entry in draft.free if entry is not base.sensor.main]
        write_base(draft, base, "")
    elif force is not None:
        draft.tables["test.force"] = {"samples": draft.address(force), "unit": unit_of_force(draft, force)}
    elif test["excitation"] != "ring-down":
        draft.tables["test.force"] = {"samples": UNKNOWN, "unit": "N"}
        draft.doubts["test.force.samples"] = f"{TODO}write the path of the force; a ring-down needs none"
    first = draft.take(fits & IS_MOTION, fits & RESPONSE, fits & remarked("time response"))
    if first is None:
        names = [_called(entry) for entry in draft.free if fits(entry)]
        _ask_response(draft, names, "samples")
        return
    alike = fits & (IS_MOTION if IS_MOTION(first) else RESPONSE)
    others = [entry for entry in draft.free if alike(entry)]
    rest = [_called(entry) for entry in draft.free if fits(entry) and entry not in others]
    left_out = f"left out: {listed(rest)}" if rest else ""
    write_motions(draft, [s for entry in (first, *others) for s in _channels(entry)], "", left_out)


def _recorded(entry: Entry) -> Sensor:
    return Sensor(entry, (("samples", entry),))


def _channels(entry: Entry) -> list[Sensor]:
    """Return the channels of an array: itself or, of a matrix, its rows along the longer side."""
    sides = [length for length in entry.shape if length > 1]
    if len(sides) < 2:
        return [_recorded(entry)]
    count, length = min(sides), max(sides)
    name = last_name(entry)
    return [
        _recorded(replace(entry, path=f"{entry.path}[{number}]", shape=(length,), title=f"{name} {number}"))
        for number in range(1, count + 1)
    ]


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


def _abscissa(draft: Draft) -> tuple[Entry | None, Entry | None, Entry | None]:
    """Take the time, the sampling rate or the frequency."""
    tabled = REAL & LONG
    of_frequency = Clue(lambda entry: entry.unit in HERTZ)
    of_time = tabled & Clue(lambda entry: entry.unit in SECONDS) & ~FREQUENCY
    # rows with phases are readings of amplitudes, whatever their instants
    log = any((tabled & of_frequency)(e) for e in draft.free) and any((LONG & PHASE)(e) for e in draft.free)
    time = None if log else draft.take(of_time)
    if time is not None:
        return time, None, None
    frequency = draft.take(tabled & of_frequency, tabled & _NAMED_FREQUENCY, tabled & ANGULAR)
    if frequency is not None:
        return None, None, frequency
    time = draft.take(tabled & TIME)
    return time, None if time else draft.take(~LONG & RATE), None


def _nameless(draft: Draft) -> None:
    """Write the tables of a case for a text whose columns have names that say nothing, or none."""
    names = [_called(entry) for entry in draft.free if (REAL & LONG)(entry)]
    draft.tables |= {
        "test": {},
        "test.frequency": {"column": UNKNOWN},
        "test.force": {"amplitude": UNKNOWN, "unit": "N"},
    }
    _ask_response(draft, names)
    draft.tables["test.response"] |= {"phase": UNKNOWN, "phase_sense": UNKNOWN}
    draft.doubts |= {
        "test.frequency.column": f"{TODO}write the name or the number of the column; time histories have "
        "excitation, [test.time] and samples instead",
        "test.force.amplitude": f"{TODO}write the column of the force, and its unit",
        "test.response.phase": f"{TODO}write its column; or write real and imaginary in place of both",
        "test.response.phase_sense": f'{TODO}write "lead" where a positive phase is earlier, else "lag"',
    }


def propose(contents: Contents) -> Proposal | None:
    """Propose the [test] table of a case from names and units; None where a file has no columns of numbers.

    Parameters
    ----------
    contents
        What ``list_contents`` found.
    """
    draft = Draft(contents)
    separate = draft.free
    draft.free, draft.levels = levels_in_columns(separate, tree=contents.format != "csv")
    time, rate, frequency = _abscissa(draft)
    if frequency is None and draft.levels:
        draft.free, draft.levels = separate, []
        time, rate, frequency = _abscissa(draft)
    if frequency is None and not any(entry.size > 15 for entry in draft.free):
        return None
    if frequency is None and draft.contents.format == "csv" and time is rate is None:
        _nameless(draft)
    elif frequency is None:
        propose_history(draft, time, rate)
    else:
        propose_amplitudes(draft, frequency)
    draft.tables["test"] = {"kind": "measured", "file": contents.file.name, **draft.tables["test"]}
    if contents.layout is not None:
        keys = ("delimiter", "decimal", "skip", "encoding")
        found = {key: getattr(contents.layout, key) for key in keys}
        needed = {key: value for key, value in found.items() if value != getattr(Layout(), key)}
        if needed:
            draft.tables = {"test": draft.tables["test"], "test.layout": needed, **draft.tables}
    return Proposal(draft.tables, draft.doubts)
