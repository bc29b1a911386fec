"""A guess of where in a file frequency, force and response are, by names, units, order and sizes."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

from rsgen.files.column_titles import split_title, unit_in
from rsgen.files.inspection.clues import (
    ANGULAR,
    BASE,
    BOTH_SIGNS,
    DRIVE,
    EVEN,
    FEW,
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
    POSITIVE,
    QUOTIENT,
    RATE,
    REAL,
    RESPONSE,
    TIME,
    VARIES,
    Clue,
    Guess,
    last_name,
    of_size,
    remarked,
    run_of,
    siblings_of,
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
from rsgen.formula.units.quantities import UNKNOWN

__all__ = [
    "Proposal",
    "level_in",
    "levels_in_columns",
    "propose",
    "propose_amplitudes",
    "propose_history",
    "without_level",
]


# ----------------------------------------------------------------------------
# Levels that stand side by side: columns "x@1N", "x@2N", or variables "phase_1N", "phase_2N".

_LEVEL = re.compile(
    r"(?:(?<![A-Za-z])(?:F|force|level|Kraft|Stufe)\s?[=: ]\s?)?"
    r"(?<![\d.,])(\d{1,9}(?:[.,]\d{1,9})?)[\s_]?([munk]?N|lbf)(?![A-Za-z])"
)
"""The amount of a force in a name. A number without one may as well be that of a sensor."""


def level_in(text: str) -> str:
    """Give the amount of a force in a text as a case writes it, "" where there is none.

    Examples
    --------
    >>> level_in("receptance, 2,5 N, up"), level_in("BEAM 2 +Z")
    ('2.5 N', '')
    """
    found = _LEVEL.search(text)
    return f"{found[1].replace(',', '.')} {found[2]}" if found else ""


def without_level(text: str) -> str:
    """Take the amount of a force out of a text.

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
# A guess of the case that reads a table of amplitudes over frequency: force or base, responses, level.

_NO_MOTION = ~IS_MOTION & ~QUOTIENT
_NAMED = 6
"""Columns that are left out and named; others are counted."""


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

    def take_all(self, *clues: Clue) -> list[Sensor]:
        """Take all channels for which the first clue that holds for any holds."""
        for clue in clues:
            found = [sensor for sensor in self.free if clue(sensor.main)]
            if found:
                self.leave(found)
                return found
        return []

    def leave(self, found: Sequence[Sensor]) -> None:
        """Take channels that were found elsewhere."""
        gone = {id(sensor) for sensor in found}
        self.free = [sensor for sensor in self.free if id(sensor) not in gone]


def _are_channels(guess: Guess, run: tuple[str, str]) -> bool:
    """Whether entries called alike are force and response of one run, as those of a universal file are."""
    first, star = run
    kinds: dict[str, set[bool]] = {}
    for entry in guess.free:
        if fnmatchcase(entry.path, f"{star}*"):
            kinds.setdefault(entry.path.split("/", first.count("/"))[-1], set()).add(IS_FORCE(entry))
    return any(len(found) > 1 for found in kinds.values())


def _other_points(guess: Guess, star: str) -> str:
    """Say which points the runs of a file are of where they are no levels of one; "" where they are."""
    motions = [e for e in guess.free if IS_MOTION(e) and e.title and fnmatchcase(e.path, f"{star}*")]
    points = list(dict.fromkeys(entry.remark for entry in motions))
    if len(points) < 2:
        return ""
    same = sum(entry.remark == points[0] for entry in motions) - 1
    again = f" and {same} more of this point" if same else ""
    names = list(dict.fromkeys(e.title for e in motions if e.remark != points[0]))
    return f"left out: {', '.join(names[:_NAMED])}{again}; a case reads one point, whose entries are levels"


def _titles_of_runs(guess: Guess) -> list[str]:
    """Give the titles of all runs in the order in which these are read."""
    star = guess.run[1] if guess.run else ""
    alike = [e for e in guess.contents.entries if e.title and not e.fault and fnmatchcase(e.path, f"{star}*")]
    return [e.title for e in sorted(alike, key=lambda entry: natural_order(entry.path))]


def _level(guess: Guess, level: Entry | None, driven: bool, runs: int) -> dict[str, Any]:
    """Give the table of the level; empty where the forces make the levels."""
    if guess.levels:
        return {"values": guess.levels}
    if level is not None:
        unit = {"unit": unit_for(level.unit, "N")} if IS_FORCE(level) else {}
        return {"column": guess.address(level)} | unit
    if driven:
        return {}
    titles = _titles_of_runs(guess) if runs else []
    said = [level_in(title) for title in titles]
    if len(said) == runs and runs and all(said):
        others = dict.fromkeys(without_level(title) for title in titles)
        differ = f", which are of {' and of '.join(others)}" if len(others) > 1 else ""
        guess.doubts["test.level.values"] = f"by the titles of the entries{differ}"
        return {"values": said}
    if runs:
        guess.doubts["test.level.values"] = "write the force amplitude of each"
        return {"values": [f"{UNKNOWN} N"] * runs}
    guess.doubts["test.level.value"] = "write the force amplitude of this file"
    return {"value": f"{UNKNOWN} N"}


def _named_level(guess: Guess, size: int, alike: Clue) -> Entry | None:
    """Take the nominal level: a level with a name goes first, for its name may be one of a force, too."""
    named = guess.take(
        REAL & POSITIVE & LEVEL & Clue(lambda entry: entry.size < size),
        alike & REAL & POSITIVE & NOMINAL & FEW,
    )
    if named is None and any(alike(e) and (IS_FORCE(e) or FORCE(e)) and not NOMINAL(e) for e in guess.free):
        # one row a level: beside the measured force it says nothing
        guess.take(alike & REAL & POSITIVE & NOMINAL & ~IS_MOTION)
    return named


def _force(guess: Guess, table: _Table) -> Sensor | None:
    named = (FORCE | LOAD) & _NO_MOTION
    in_parts = {id(sensor.main) for sensor in table.free if sensor.places[0][0] == "real"}
    parts = Clue(lambda entry: id(entry) in in_parts)
    return table.take(
        parts & IS_FORCE,
        REAL & IS_FORCE,
        parts & named,
        REAL & POSITIVE & FORCE & _NO_MOTION,
        REAL & POSITIVE & DRIVE & _NO_MOTION,
        REAL & POSITIVE & FEW & VARIES & guess.unnamed,
        VARIES & ~REAL & (IS_FORCE | (LOAD & _NO_MOTION)),
    )


def _responses(guess: Guess, table: _Table) -> list[Sensor]:
    """Take the channels that are responses, those with a phase first; without names the likeliest one."""
    if guess.nameless:
        signed = [s.main for s in table.free if BOTH_SIGNS(s.main) and VARIES(s.main)]
        if len(signed) > 1:
            parts = Sensor(signed[0], (("real", signed[0]), ("imaginary", signed[1])))
            table.free = [sensor for sensor in table.free if sensor.main not in signed[:2]]
            return [parts]
    usable = VARIES & ~FORCE & ~IS_FORCE
    known = IS_MOTION | (RESPONSE & usable) | (QUOTIENT & usable)
    found = table.take_all(VARIES & known)
    if not found:
        first = table.take(VARIES & ~REAL, VARIES & ~LOAD & ~IS_FORCE, VARIES)
        # names that nobody knows: what has a phase, too, is a channel as well
        others = [sensor for sensor in table.free if first and sensor.has_phase and VARIES(sensor.main)]
        table.leave(others)
        found = [first, *others] if first else []
    return sorted(found, key=lambda sensor: (not sensor.has_phase, sensor.places[0][0] == "amplitude"))


def _with_loose_phase(responses: list[Sensor], table: _Table) -> list[Sensor]:
    """Give a phase whose title names no channel to the first response that has none."""
    if not responses or responses[0].has_phase:
        return responses
    for phase in table.loose:
        if not is_of_another(phase, responses[0].main):
            table.loose.remove(phase)
            others = [sensor.main.title or sensor.main.path for sensor in responses[1:]]
            doubt = f"or that of {', '.join(others[:_NAMED])}: its title names no channel" if others else ""
            places = (*responses[0].places, ("phase", phase))
            return [Sensor(responses[0].main, places, doubt), *responses[1:]]
    return responses


def _left_out(table: _Table, higher: dict[int, list[Entry]]) -> str:
    """Say which columns of channels are not read."""
    others = [column for sensor in table.free if RESPONSE(sensor.main) for column in sensor.columns]
    names = [entry.title or entry.path for entry in (*others, *table.loose)]
    said = ""
    if names:
        more = f" and {len(names) - _NAMED} more" if names[_NAMED:] else ""
        said = f"left out: {', '.join(names[:_NAMED])}{more}"
    if higher:
        orders = f"harmonic{'s' * (len(higher) > 1)} {', '.join(map(str, higher))}"
        said += "; " * bool(said) + (
            f"left out: {orders}; a table is read at its fundamental, time histories bring harmonics in"
        )
    return said


def propose_amplitudes(guess: Guess, frequency: Entry) -> None:
    """Write the tables of a case for a table of amplitudes over ``frequency``."""
    guess.tables["test"] = {}
    runs = run_of(frequency, guess.contents.entries)
    of_others = ""
    if runs is not None and _are_channels(guess, runs[:2]):
        runs = None
    elif runs is not None and (of_others := _other_points(guess, runs[1])):
        guess.free = [entry for entry in guess.free if entry.path.startswith(runs[0])]
        runs = None
    elif runs is not None:
        guess.run = runs[:2]
        guess.free = [entry for entry in guess.free if entry.path.startswith(runs[0])]
    unit = {"unit": frequency.unit} if frequency.unit in HERTZ and frequency.unit != "Hz" else {}
    if ANGULAR(frequency) and frequency.unit not in HERTZ:
        unit = {"unit": "rad/s"}
        guess.doubts["test.frequency.unit"] = "its name says an angular frequency; Hz if it is none"
    guess.tables["test.frequency"] = {"column": guess.address(frequency)} | unit
    alike = LONG & of_size(frequency.size)
    named = _named_level(guess, frequency.size, alike)
    guess.free, higher = fundamentals(guess.free)
    sensors = find_sensors(guess.free, alike)
    table = _Table(sensors.found, sensors.loose)
    base = find_base(table.free, table.loose)
    if named is not None and base is not None and (IS_FORCE(named) or not BASE(base.sensor.main)):
        # levels of a force are no base's; others need its name
        base = None
    if base is not None:
        # other directions of the base are no responses
        table.free = [s for s in table.free if s is not base.sensor and not BASE(s.main)]
    force = None if base else _force(guess, table)
    responses = _with_loose_phase(_responses(guess, table), table)
    # one device writes all phases in one sense
    reference = base.sensor if base else force
    shared = "lead" if reference and reference.has_phase else ""
    if base is not None:
        write_base(guess, base, shared)
    else:
        guess.tables["test.force"] = _force_table(guess, force, shared)
    if not base and not force and responses and BASE(responses[0].main):
        guess.doubts["test.force.nominal"] = (
            "no force, and the only motion is that of a base: write that of the mass into the file, such as "
            "transmissibility times base"
        )
    level = _level(guess, named, bool(base or force), runs[2] if runs else 0)
    if force is not None and not level and FEW(force.main) and force.places[0][0] == "amplitude":
        of_force = guess.tables["test.force"]
        level = {"column": of_force["amplitude"], "unit": of_force["unit"]}
    write_motions(guess, responses, shared, "; ".join(filter(None, [of_others, _left_out(table, higher)])))
    if level:
        guess.tables["test.level"] = level


def _force_table(guess: Guess, force: Sensor | None, sense: str) -> dict[str, Any]:
    if force is None:
        guess.doubts["test.force.nominal"] = "no force was found, so the level stands for it"
        return {"nominal": True}
    place = place_of(guess, force, "test.force", "force", sense)
    columns = {key: place.pop(key) for key in ("amplitude",) if key in place}
    return columns | {"unit": unit_of_force(guess, force.main)} | place


# ----------------------------------------------------------------------------
# A guess of the case that reads time histories: where time, force or base and responses are.

_NAMED_HISTORIES = 6
"""Arrays that are left out and named."""
_NOTHING = Clue(lambda _: False)
_EXCITATIONS = {
    "step": "stepped-sine",
    "multisine": "multisine",
    **dict.fromkeys(("decay", "ring", "release", "hammer", "impact", "impulse", "ausschwing"), "ring-down"),
}
"""Excitations by what stands in the name of a file."""


def _time(guess: Guess, time: Entry | None, rate: Entry | None) -> int:
    """Write where the time is; give the number of samples."""
    step = guess.take(~LONG & INCREMENT & POSITIVE) if time is rate is None else None
    if step is not None and step.low:
        guess.tables["test.time"] = {"rate": f"{1 / step.low:.10g} Hz"}
        guess.doubts["test.time.rate"] = f"one over {step.path}"
        return _longest(guess)
    if time is not None:
        table: dict[str, Any] = {"column": guess.address(time)}
        guess.tables["test.time"] = table | (
            {"unit": time.unit} if time.unit in SECONDS and time.unit != "s" else {}
        )
        return time.size
    guess.tables["test.time"] = (
        {"rate": f"{UNKNOWN} Hz"} if rate is None else {"rate_column": guess.address(rate)}
    )
    if rate is None:
        guess.doubts["test.time.rate"] = "not in the file: write the sampling rate"
    return _longest(guess)


def _longest(guess: Guess) -> int:
    return max((max(entry.shape, default=1) for entry in guess.free), default=0)


def propose_history(guess: Guess, time: Entry | None, rate: Entry | None) -> None:
    """Write the tables of a case for time histories."""
    stem = guess.contents.file.stem.casefold()
    kinds = (kind for sign, kind in _EXCITATIONS.items() if sign in stem)
    test: dict[str, Any] = {"excitation": next(kinds, "swept-sine")}
    guess.tables["test"] = test
    fits = REAL & LONG & VARIES & of_size(_time(guess, time, rate))
    no_motion = ~IS_MOTION
    force = guess.take(fits & IS_FORCE, fits & remarked("force"), fits & FORCE & no_motion)
    base = None
    if force is None:
        base = find_base([_recorded(entry) for entry in guess.free if fits(entry)])
        force = None if base else guess.take(fits & DRIVE & no_motion)
    if base is not None:
        guess.free = [entry for entry in guess.free if entry is not base.sensor.main]
        write_base(guess, base, "")
        guess.doubts["test.excitation"] = "swept-sine or stepped-sine"
    elif force is None:
        test["excitation"] = "ring-down"
        guess.doubts["test.excitation"] = "no force was found"
    else:
        guess.doubts["test.excitation"] = "swept-sine, stepped-sine, multisine or ring-down"
        guess.tables["test.force"] = {"samples": guess.address(force), "unit": unit_of_force(guess, force)}
    first = guess.take(fits & IS_MOTION, fits & RESPONSE, fits)
    if first is None:
        guess.tables["test.response"] = {}
        return
    alike = fits & (IS_MOTION if IS_MOTION(first) else RESPONSE if RESPONSE(first) else _NOTHING)
    others = [entry for entry in guess.free if alike(entry)]
    rest = [
        entry.title or entry.path for entry in guess.free if (fits & ~EVEN)(entry) and entry not in others
    ]
    left_out = f"left out: {', '.join(rest[:_NAMED])}{', ...' * (len(rest) > _NAMED)}" if rest else ""
    write_motions(guess, [s for entry in (first, *others) for s in _channels(entry)], "", left_out)


def _recorded(entry: Entry) -> Sensor:
    return Sensor(entry, (("samples", entry),))


def _channels(entry: Entry) -> list[Sensor]:
    """Give the channels of an array: itself or, of a matrix, its rows along the longer side."""
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
    """The tables of a case file as far as they can be guessed.

    Parameters
    ----------
    tables
        By name ("test", "test.force" ...): keys and values, in the order to write them.
    doubts
        By "table.key": what the user must look at.
    """

    tables: dict[str, dict[str, Any]]
    doubts: dict[str, str] = field(default_factory=dict)


def _is_log(guess: Guess) -> bool:
    """Whether the rows are readings of amplitudes, with the instants at which they were taken."""
    frequency = REAL & LONG & VARIES & POSITIVE & Clue(lambda entry: entry.unit in HERTZ)
    if not any(frequency(entry) for entry in guess.free):
        return False
    forces = [entry for entry in guess.free if (REAL & LONG & IS_FORCE)(entry)]
    # samples of a force have both signs
    return any((LONG & PHASE)(e) for e in guess.free) or (bool(forces) and all(map(POSITIVE, forces)))


def _abscissa(guess: Guess) -> tuple[Entry | None, Entry | None, Entry | None]:
    """Take the time, the sampling rate or the frequency."""
    tabled = REAL & LONG & VARIES & POSITIVE
    of_time = EVEN & Clue(lambda entry: entry.unit in SECONDS) & ~FREQUENCY
    time = None if _is_log(guess) else guess.take(of_time)
    if time is not None:
        return time, None, None
    frequency = guess.take(
        tabled & Clue(lambda entry: entry.unit in HERTZ),
        # "f_re_N" is a force
        tabled & FREQUENCY & ~IS_FORCE & ~IS_MOTION & ~QUOTIENT,
        tabled & ANGULAR,
    )
    if frequency is not None:
        return None, None, frequency
    time = guess.take(EVEN & TIME)
    rate = None if time else guess.take(~LONG & RATE & POSITIVE)
    if time is rate is None and guess.nameless:
        # without names: what turns back is the frequency rather than what rises as time does
        many = tabled & ~FEW & Clue(lambda entry: (entry.low or 0) > 0)
        frequency = guess.take(many & Clue(lambda entry: entry.order == "mixed"), many)
        if frequency is not None:
            guess.doubts["test.frequency.column"] = (
                "the columns have no names: all are guesses by their values"
            )
    return time, rate, frequency


def propose(contents: Contents) -> Proposal | None:
    """Propose the [test] table of a case from what a file holds; None where nothing fits.

    Parameters
    ----------
    contents
        What ``list_contents`` found.
    """
    guess = Guess(contents)
    apart = guess.free
    guess.free, guess.levels = levels_in_columns(apart, tree=contents.format != "csv")
    time, rate, frequency = _abscissa(guess)
    if frequency is None and guess.levels:
        guess.free, guess.levels = apart, []
        time, rate, frequency = _abscissa(guess)
    if frequency is not None:
        propose_amplitudes(guess, frequency)
    elif any(entry.size > 15 for entry in guess.free):
        propose_history(guess, time, rate)
    else:
        return None
    if not guess.tables["test.response"].keys() & {"samples", "amplitude", "complex", "real", "channels"}:
        return None
    guess.tables["test"] = {"kind": "measured", "file": contents.file.name, **guess.tables["test"]}
    if contents.layout is not None:
        keys = ("delimiter", "decimal", "skip", "encoding")
        found = {key: getattr(contents.layout, key) for key in keys}
        needed = {key: value for key, value in found.items() if value != getattr(Layout(), key)}
        if needed:
            guess.tables = {"test": guess.tables["test"], "test.layout": needed, **guess.tables}
    others = siblings_of(contents.file)
    return Proposal(guess.tables, guess.doubts | ({"test.file": others} if others else {}))
