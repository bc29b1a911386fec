"""A guess of where in a file frequency, force and response are, by names, units, order and sizes."""

from __future__ import annotations

from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

from rsgen.inspection.clues import (
    ANGULAR,
    BOTH_SIGNS,
    DECIBEL,
    DRIVE,
    EVEN,
    FEW,
    FORCE,
    FREQUENCY,
    LEVEL,
    LOAD,
    LONG,
    NAMES,
    NOMINAL,
    OVER_FORCE,
    PHASE,
    POSITIVE,
    QUANTITIES,
    QUOTIENT,
    RADIAN,
    RATE,
    REAL,
    RESPONSE,
    RESPONSE_UNITS,
    RMS,
    TIME,
    VARIES,
    Clue,
    last_name,
    of_size,
    phase_sense,
    remarked,
    unit_for,
    with_unit,
)  # fmt: skip
from rsgen.inspection.column_levels import levels_in_columns
from rsgen.inspection.guess import Guess, run_of
from rsgen.measurement.plan import Layout
from rsgen.measurement.tree import Contents, Entry
from rsgen.units.quantities import UNKNOWN

__all__ = ["Proposal", "propose"]

_EXCITATIONS = {
    "step": "stepped-sine",
    "multisine": "multisine",
    **dict.fromkeys(("decay", "ring", "release", "hammer", "impact", "impulse", "ausschwing"), "ring-down"),
}
"""Excitations by what stands in the name of a file."""
_HERTZ = ("Hz", "kHz", "mHz", "rad/s", "rpm")
_SECONDS = ("s", "ms", "us")
_IS_RESPONSE = with_unit(*RESPONSE_UNITS)
_IS_FORCE = with_unit("N")
_ANY_RESPONSE = Clue(lambda entry: _IS_RESPONSE(entry) or RESPONSE(entry))
_NAMED = 6
"""Columns that are left out and named; others are counted."""


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


def _quantity_of(guess: Guess, entry: Entry, table: dict[str, Any]) -> None:
    """Say what the response is, by its unit, else by its name."""
    targets = ((name, si + per) for name, si in QUANTITIES.items() for per in ("", "/N"))
    for name, target in targets:
        known = unit_for(entry.unit, target) if entry.unit else None
        if known:
            table |= {"quantity": name, "unit": known}
            break
    else:
        about = f"{last_name(entry)} {entry.remark}".casefold()
        meanings = (
            meaning for start, meaning in NAMES.items() if start in about or start.strip() == about.strip()
        )
        table["quantity"] = next(meanings, "displacement")
        table["unit"] = QUANTITIES[table["quantity"]]
        guess.doubts["test.response.unit"] = (
            f"the file says {entry.unit!r}; put its meaning into factor" if entry.unit else _unknown(entry)
        )
        if DECIBEL.search(entry.unit):
            # no factor makes a logarithm linear: a case that does not pass is better than a wrong one
            table["unit"] = entry.unit
            guess.doubts["test.response.unit"] = "decibels are not read: write linear numbers into the file"
    per = bool(known) and target.endswith("/N")
    quotient = QUOTIENT(entry) or "over force" in entry.remark
    if per or quotient or "frequency response" in entry.remark:
        table["unit"] += "" if per else "/N"
        table["per_force"] = True
        guess.doubts["test.response.quantity"] = f"{OVER_FORCE[table['quantity']]}, {table['unit']}"
        if "adds damping" in entry.remark:
            guess.doubts["test.response.per_force"] = (
                "measured with an exponential window, which adds damping"
            )
    if known and entry.unit_source:
        guess.doubts["test.response.unit"] = entry.unit_source
    pattern = str(guess.address(entry))
    alike = (e for e in guess.contents.entries if fnmatchcase(e.path, pattern) and not e.fault)
    units = {other.unit for other in alike}
    if guess.run and len(units) > 1:
        # without the key each entry is read in the unit that the file names for it
        del table["unit"]
        said = guess.doubts.get("test.response.quantity", "").partition(",")[0]
        of_file = f"in the units of the file: {', '.join(sorted(units))}"
        guess.doubts["test.response.quantity"] = f"{said}, {of_file}" if said else of_file


def _unknown(entry: Entry) -> str:
    return entry.unit_source or "not in the file"


def _time(guess: Guess, time: Entry | None, rate: Entry | None) -> int:
    """Write where the time is; give the number of samples."""
    if time is not None:
        table: dict[str, Any] = {"column": guess.address(time)}
        guess.tables["test.time"] = table | ({"unit": time.unit} if time.unit in _SECONDS[1:] else {})
        return time.size
    guess.tables["test.time"] = (
        {"rate": f"{UNKNOWN} Hz"} if rate is None else {"rate_column": guess.address(rate)}
    )
    if rate is None:
        guess.doubts["test.time.rate"] = "not in the file: write the sampling rate"
    return max((max(entry.shape, default=1) for entry in guess.free), default=0)


def _history(guess: Guess, time: Entry | None, rate: Entry | None) -> None:
    stem = guess.contents.file.stem.casefold()
    kinds = (kind for sign, kind in _EXCITATIONS.items() if sign in stem)
    test: dict[str, Any] = {"excitation": next(kinds, "swept-sine")}
    guess.tables["test"] = test
    fits = REAL & LONG & VARIES & of_size(_time(guess, time, rate))
    force = guess.take(fits & _IS_FORCE, fits & remarked("force"), fits & FORCE, fits & DRIVE)
    if force is None:
        test["excitation"] = "ring-down"
        guess.doubts["test.excitation"] = "no force was found"
    else:
        guess.doubts["test.excitation"] = "swept-sine, stepped-sine, multisine or ring-down"
        guess.tables["test.force"] = {"samples": guess.address(force), "unit": _unit_of_force(guess, force)}
    response = guess.take(fits & _IS_RESPONSE, fits & RESPONSE, fits)
    table: dict[str, Any] = {}
    if response is not None:
        _quantity_of(guess, response, table)
        table["samples"] = guess.address(response)
        if table["samples"] != response.path and str(table["samples"]).endswith("[1]"):
            sides = [length for length in response.shape if length > 1]
            guess.doubts["test.response.samples"] = f"channels 1 to {min(sides)}"
    guess.tables["test.response"] = table


def _scale(entry: Entry) -> dict[str, str | float]:
    """Say what amplitudes are where the file or their name does."""
    if entry.scale == "half-peak":
        return {"factor": 2.0}
    named = RMS.search(f"{entry.title or last_name(entry)} {entry.remark}")
    return {"scale": "rms"} if named and entry.scale in ("", "rms") else {}


def _unit_of_force(guess: Guess, entry: Entry) -> str:
    known = unit_for(entry.unit, "N") if entry.unit else None
    if known is None:
        guess.doubts["test.force.unit"] = (
            f"the file says {entry.unit!r}; write unit and factor, such as unit = 'V', factor = '10 N/V'"
            if entry.unit
            else _unknown(entry)
        )
    elif entry.unit_source:
        guess.doubts["test.force.unit"] = entry.unit_source
    return known or "N"


def _response(guess: Guess, fits: Clue) -> dict[str, Any]:
    table: dict[str, Any] = {}
    whole = guess.take(fits & ~REAL)
    if whole is not None:
        _quantity_of(guess, whole, table)
        return table | {"complex": guess.address(whole), "phase_sense": "lead"} | _scale(whole)
    parts = guess.take_parts(fits, _IS_RESPONSE, RESPONSE, QUOTIENT, ~LOAD & ~_IS_FORCE)
    if parts is None and guess.nameless:
        signed = [entry for entry in guess.free if fits(entry) and BOTH_SIGNS(entry)]
        parts = (signed[0], signed[1]) if len(signed) > 1 else None
    if parts is not None:
        _quantity_of(guess, parts[0], table)
        return table | _in_parts(guess, parts)
    phase = guess.take(fits & PHASE)
    amplitude = guess.take(fits & _IS_RESPONSE, fits & RESPONSE, fits)
    if amplitude is not None:
        _quantity_of(guess, amplitude, table)
        table |= {"amplitude": guess.address(amplitude)} | _scale(amplitude)
    if phase is None:
        return table | {"phase_known": False}
    table["phase"] = guess.address(phase)
    if RADIAN(phase):
        table["phase_unit"] = "rad"
    return table | {"phase_sense": phase_sense(phase, table.get("quantity", "displacement"))}


def _left_out(guess: Guess, response: dict[str, Any], alike: Clue) -> None:
    """Say which columns are as good a response as the one that was taken."""
    others = [entry.title or entry.path for entry in guess.free if alike(entry)]
    key = next((key for key in ("amplitude", "complex", "real") if key in response), "")
    if others and key:
        named = ", ".join(others[:_NAMED]) + (f" and {len(others) - _NAMED} more" if others[_NAMED:] else "")
        guess.doubts[f"test.response.{key}"] = f"left out: {named}; a case reads one response"


def _in_parts(guess: Guess, parts: tuple[Entry, Entry]) -> dict[str, Any]:
    real, imaginary = map(guess.address, parts)
    return {"real": real, "imaginary": imaginary, "phase_sense": "lead"}


def _level(guess: Guess, level: Entry | None, force: Entry | None, runs: int) -> dict[str, Any]:
    """Give the table of the level; empty where the forces make the levels."""
    if guess.levels:
        return {"values": guess.levels}
    if level is not None:
        unit = {"unit": unit_for(level.unit, "N")} if _IS_FORCE(level) else {}
        return {"column": guess.address(level)} | unit
    if force is not None:
        return {}
    if runs:
        guess.doubts["test.level.values"] = "write the force amplitude of each"
        return {"values": [f"{UNKNOWN} N"] * runs}
    guess.doubts["test.level.value"] = "write the force amplitude of this file"
    return {"value": f"{UNKNOWN} N"}


def _are_channels(guess: Guess, run: tuple[str, str]) -> bool:
    """Whether entries called alike are force and response of one run, as those of a universal file are."""
    first, star = run
    kinds: dict[str, set[bool]] = {}
    for entry in guess.free:
        if fnmatchcase(entry.path, f"{star}*"):
            kinds.setdefault(entry.path.split("/", first.count("/"))[-1], set()).add(_IS_FORCE(entry))
    return any(len(found) > 1 for found in kinds.values())


def _amplitudes(guess: Guess, frequency: Entry) -> None:
    guess.tables["test"] = {}
    size = frequency.size
    runs = run_of(frequency, guess.contents.entries)
    if runs is not None and not _are_channels(guess, runs[:2]):
        guess.run = runs[:2]
        guess.free = [entry for entry in guess.free if entry.path.startswith(runs[0])]
    else:
        runs = None
    unit = {"unit": frequency.unit} if frequency.unit in _HERTZ[1:] else {}
    if ANGULAR(frequency) and frequency.unit not in _HERTZ:
        unit = {"unit": "rad/s"}
        guess.doubts["test.frequency.unit"] = "its name says an angular frequency; Hz if it is none"
    guess.tables["test.frequency"] = {"column": guess.address(frequency)} | unit
    alike = LONG & of_size(size)
    # a level with a name goes first, for its name may be one of a force, too
    named = guess.take(
        REAL & POSITIVE & LEVEL & Clue(lambda entry: entry.size < size),
        alike & REAL & POSITIVE & NOMINAL & FEW,
    )
    fits = alike & VARIES
    complex_force = guess.take_parts(alike, _IS_FORCE, FORCE, LOAD)
    force = (
        complex_force[0]
        if complex_force
        else guess.take(
            alike & REAL & _IS_FORCE,
            alike & REAL & POSITIVE & FORCE,
            alike & REAL & POSITIVE & DRIVE,
            fits & REAL & POSITIVE & FEW & guess.unnamed,
            fits & ~REAL & (_IS_FORCE | LOAD),
        )
    )
    response = _response(guess, fits)
    if response.get("phase_sense"):
        guess.doubts["test.response.phase_sense"] = "a positive phase means later (lag) or earlier (lead)"
    _left_out(guess, response, fits & _ANY_RESPONSE & ~FORCE & ~_IS_FORCE)
    level = _level(guess, named, force, runs[2] if runs else 0)
    if force is None:
        table: dict[str, Any] = {"nominal": True}
        guess.doubts["test.force.nominal"] = "no force was found, so the level stands for it"
    else:
        table = {"amplitude": guess.address(force), "unit": _unit_of_force(guess, force)} | _scale(force)
        if complex_force:
            table = {"unit": table["unit"], **_in_parts(guess, complex_force)}
        elif FEW(force):
            level = level or {"column": table["amplitude"], "unit": table["unit"]}
        if not REAL(force):
            place = {"complex": table["amplitude"], "unit": table["unit"], "phase_sense": "lead"}
            table = place | _scale(force)
    guess.tables |= {"test.force": table, "test.response": response} | (
        {"test.level": level} if level else {}
    )


def _abscissa(guess: Guess) -> tuple[Entry | None, Entry | None, Entry | None]:
    """Take the time, the sampling rate or the frequency."""
    tabled = REAL & LONG & VARIES & POSITIVE
    time = guess.take(EVEN & Clue(lambda entry: entry.unit in _SECONDS) & ~FREQUENCY)
    if time is not None:
        return time, None, None
    frequency = guess.take(
        tabled & Clue(lambda entry: entry.unit in _HERTZ), tabled & FREQUENCY, tabled & ANGULAR
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
    guess.free, guess.levels = levels_in_columns(apart)
    time, rate, frequency = _abscissa(guess)
    if frequency is None and guess.levels:
        guess.free, guess.levels = apart, []
        time, rate, frequency = _abscissa(guess)
    if frequency is not None:
        _amplitudes(guess, frequency)
    elif any(entry.size > 15 for entry in guess.free):
        _history(guess, time, rate)
    else:
        return None
    if not guess.tables["test.response"].keys() & {"samples", "amplitude", "complex", "real"}:
        return None
    guess.tables["test"] = {"kind": "measured", "file": contents.file.name, **guess.tables["test"]}
    if contents.layout is not None:
        keys = ("delimiter", "decimal", "skip", "encoding")
        found = {key: getattr(contents.layout, key) for key in keys}
        needed = {key: value for key, value in found.items() if value != getattr(Layout(), key)}
        if needed:
            guess.tables = {"test": guess.tables["test"], "test.layout": needed, **guess.tables}
    return Proposal(guess.tables, guess.doubts)
