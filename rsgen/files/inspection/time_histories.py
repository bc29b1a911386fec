"""A guess of the case that reads time histories: where time, force or base and responses are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rsgen.files.inspection.clues import (
    DRIVE,
    EVEN,
    FORCE,
    INCREMENT,
    IS_FORCE,
    IS_MOTION,
    LONG,
    POSITIVE,
    REAL,
    RESPONSE,
    VARIES,
    Clue,
    last_name,
    of_size,
    remarked,
)
from rsgen.files.inspection.driven_base import find_base
from rsgen.files.inspection.guess import Guess
from rsgen.files.inspection.motions import write_base, write_motions
from rsgen.files.inspection.quantities import unit_of_force
from rsgen.files.inspection.sensors import Sensor
from rsgen.files.plan import SECONDS
from rsgen.files.tree import Entry
from rsgen.formula.units.quantities import UNKNOWN

__all__ = ["propose_history"]

_NAMED = 6
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
