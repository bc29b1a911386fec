"""A guess of the case that reads a table of amplitudes over frequency: force or base, responses, level."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Any

from rsgen.files.address import natural_order
from rsgen.files.inspection.clues import (
    ANGULAR,
    BASE,
    BOTH_SIGNS,
    DRIVE,
    FEW,
    FORCE,
    IS_FORCE,
    IS_MOTION,
    LEVEL,
    LOAD,
    LONG,
    NOMINAL,
    POSITIVE,
    QUOTIENT,
    REAL,
    RESPONSE,
    VARIES,
    Clue,
    of_size,
    unit_for,
)
from rsgen.files.inspection.column_levels import level_in, without_level
from rsgen.files.inspection.driven_base import find_base
from rsgen.files.inspection.guess import Guess, run_of
from rsgen.files.inspection.motions import write_base, write_motions
from rsgen.files.inspection.quantities import place_of, unit_of_force
from rsgen.files.inspection.sensors import Sensor, find_sensors, fundamentals, is_of_another
from rsgen.files.plan import HERTZ
from rsgen.files.tree import Entry
from rsgen.formula.units.quantities import UNKNOWN

__all__ = ["propose_amplitudes"]

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
