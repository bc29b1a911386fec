"""A guess of where in a file frequency, force and response are, by names, units, order and sizes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

from rsgen.inspection.clues import (
    DECIBEL,
    DRIVE,
    EXCITATIONS,
    FORCE,
    FREQUENCY,
    IMAGINARY,
    LEVEL,
    LOAD,
    NAMES,
    NOMINAL,
    PHASE,
    QUANTITIES,
    QUOTIENT,
    RATE,
    REAL,
    RESPONSE,
    RESPONSE_UNITS,
    RMS,
    SPREAD,
    TIME,
    all_of,
    evenly_spaced,
    has_both_signs,
    has_few,
    is_long,
    is_named,
    is_positive,
    is_radian,
    is_real,
    is_unit,
    last_name,
    moves,
    of_size,
    phase_sense,
    remarked,
    tells,
    unit_for,
    unit_in,
)
from rsgen.measurement.tree import Contents, Entry

__all__ = ["Proposal", "propose"]


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


class _Guess:
    """The entries that are left, and what was taken from them."""

    def __init__(self, contents: Contents) -> None:
        self.contents = contents
        readable = (e for e in contents.entries if e.dtype and not e.fault and e.size)
        usable = [e if e.unit else replace(e, unit=unit_in(last_name(e))) for e in readable]
        self.free = [e for e in usable if not SPREAD.search(last_name(e)) and (e.size == 1 or tells(e))]
        self.nameless = contents.format == "csv" and all(e.path.isdigit() and not e.remark for e in usable)
        self.run: tuple[str, str] | None = None
        self.tables: dict[str, dict[str, Any]] = {}
        self.doubts: dict[str, str] = {}

    def take(self, *tests: Callable[[Entry], bool]) -> Entry | None:
        """Take the first entry that passes the first test that any passes."""
        for test in tests:
            for entry in self.free:
                if test(entry):
                    self.free.remove(entry)
                    return entry
        return None

    def address(self, entry: Entry) -> int | str:
        if self.run:
            run, star = self.run
            if entry.path.startswith(run):
                return star + entry.path.removeprefix(run)
        sides = [length for length in entry.shape if length > 1]
        if len(sides) > 1 and self.tables["test"].get("excitation"):
            return f"{entry.path}[1]"
        return int(entry.path) if self.contents.format == "csv" and entry.path.isdigit() else entry.path


def _run_of(entry: Entry, entries: Iterable[Entry]) -> tuple[str, str, int] | None:
    """Find whether an entry stands in one of several runs: how its path begins, the same with *, how many.

    "runs/1/f" and "drive_1/f" do, if there is a "runs/2/f" or "drive_2/f".
    """
    paths = {other.path for other in entries}
    parts = entry.path.split("/")
    for place, part in enumerate(parts[:-1]):
        stem = part.rstrip("0123456789")
        if stem == part:
            continue
        rest = "/".join(parts[place + 1 :])
        before = "/".join([*parts[:place], stem])
        alike = re.compile(re.escape(before) + r"\d+/" + re.escape(rest))
        count = sum(bool(alike.fullmatch(path)) for path in paths)
        if count > 1:
            return "/".join(parts[: place + 1]) + "/", before + "*/", count
    return None


def _quantity_of(guess: _Guess, entry: Entry, table: dict[str, Any]) -> None:
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
    quotient = QUOTIENT.search(last_name(entry)) or "over force" in entry.remark
    if per or quotient or "frequency response" in entry.remark:
        table["unit"] += "" if per else "/N"
        table["per_force"] = True
    if known and entry.unit_source:
        guess.doubts["test.response.unit"] = entry.unit_source
    pattern = str(guess.address(entry))
    units = {other.unit for other in guess.contents.entries if fnmatchcase(other.path, pattern)}
    if guess.run and len(units) > 1:
        # without the key each entry is read in the unit that the file names for it
        del table["unit"]
        guess.doubts["test.response.quantity"] = f"in the units of the file: {', '.join(sorted(units))}"


def _unknown(entry: Entry) -> str:
    return entry.unit_source or "not in the file"


def _history(guess: _Guess, time: Entry | None, rate: Entry | None) -> None:
    stem = guess.contents.file.stem.casefold()
    told_by_name = (kind for sign, kind in EXCITATIONS.items() if sign in stem)
    test: dict[str, Any] = {"excitation": next(told_by_name, "swept-sine")}
    guess.tables["test"] = test
    if time is not None:
        size = time.size
        table: dict[str, Any] = {"column": guess.address(time)}
        if time.unit in ("ms", "us"):
            table["unit"] = time.unit
    else:
        size = max((e.size for e in guess.free), default=0)
        size = max((max(e.shape) for e in guess.free if e.shape), default=size)
        table = {"rate_column": guess.address(rate)} if rate is not None else {"rate": "1000 Hz"}
        if rate is None:
            guess.doubts["test.time.rate"] = "not in the file: write the sampling rate"
    guess.tables["test.time"] = table
    fits = all_of(is_real, is_long, moves, of_size(size))
    force = guess.take(
        all_of(fits, lambda e: is_unit(e, "N")),
        all_of(fits, remarked("force")),
        all_of(fits, is_named(FORCE)),
        all_of(fits, is_named(DRIVE)),
    )
    if force is None:
        test["excitation"] = "ring-down"
        guess.doubts["test.excitation"] = "no force was found"
    else:
        guess.doubts["test.excitation"] = "swept-sine, stepped-sine or ring-down"
        guess.tables["test.force"] = {"samples": guess.address(force), "unit": _unit_of_force(guess, force)}
    response = guess.take(
        all_of(fits, lambda e: is_unit(e, *RESPONSE_UNITS)), all_of(fits, is_named(RESPONSE)), fits
    )
    told: dict[str, Any] = {}
    if response is not None:
        _quantity_of(guess, response, told)
        told["samples"] = guess.address(response)
        if told["samples"] != response.path and str(told["samples"]).endswith("[1]"):
            sides = [length for length in response.shape if length > 1]
            guess.doubts["test.response.samples"] = f"channels 1 to {min(sides)}"
    guess.tables["test.response"] = told


def _scale(entry: Entry) -> dict[str, str]:
    """Say that amplitudes are effective values where their name does."""
    return {"scale": "rms"} if RMS.search(f"{last_name(entry)} {entry.remark}") else {}


def _unit_of_force(guess: _Guess, entry: Entry) -> str:
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


def _response(guess: _Guess, fits: Callable[[Entry], bool]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    whole = guess.take(all_of(fits, lambda entry: not is_real(entry)))
    if whole is not None:
        _quantity_of(guess, whole, table)
        return table | {"complex": guess.address(whole), "phase_sense": "lead"}
    real = guess.take(
        all_of(fits, is_named(REAL)), all_of(fits, has_both_signs, lambda entry: guess.nameless)
    )
    imaginary = None
    if real is not None:
        imaginary = guess.take(
            all_of(fits, is_named(IMAGINARY)), all_of(fits, has_both_signs, lambda entry: guess.nameless)
        )
    if real is not None and imaginary is not None:
        _quantity_of(guess, real, table)
        table |= {"real": guess.address(real), "imaginary": guess.address(imaginary)}
        return table | {"phase_sense": "lead"}
    if real is not None:
        guess.free.insert(0, real)
    phase = guess.take(all_of(fits, is_named(PHASE)))
    amplitude = guess.take(
        all_of(fits, lambda entry: is_unit(entry, *RESPONSE_UNITS)),
        all_of(fits, is_named(RESPONSE)),
        fits,
    )
    if amplitude is not None:
        _quantity_of(guess, amplitude, table)
        table |= {"amplitude": guess.address(amplitude)} | _scale(amplitude)
    if phase is None:
        return table | {"phase_known": False}
    table["phase"] = guess.address(phase)
    if is_radian(phase):
        table["phase_unit"] = "rad"
    return table | {"phase_sense": phase_sense(phase, table.get("quantity", "displacement"))}


def _amplitudes(guess: _Guess, frequency: Entry) -> None:
    guess.tables["test"] = {}
    size = frequency.size
    runs = _run_of(frequency, guess.contents.entries)
    if runs is not None:
        guess.run = runs[:2]
        guess.free = [entry for entry in guess.free if entry.path.startswith(runs[0])]
    column: dict[str, Any] = {"column": guess.address(frequency)}
    if frequency.unit in ("kHz", "mHz", "rad/s", "rpm"):
        column["unit"] = frequency.unit
    guess.tables["test.frequency"] = column
    alike = all_of(is_long, of_size(size))
    level = guess.take(
        all_of(is_real, is_positive, is_named(LEVEL), lambda entry: entry.size < size),
        all_of(alike, is_real, is_positive, is_named(NOMINAL), has_few),
    )
    leveled: dict[str, Any] = {} if level is None else {"column": guess.address(level)}
    if level is not None and is_unit(level, "N"):
        leveled["unit"] = unit_for(level.unit, "N")
    fits = all_of(alike, moves)
    force = guess.take(
        all_of(alike, is_real, lambda entry: is_unit(entry, "N")),
        all_of(alike, is_real, is_positive, is_named(FORCE)),
        all_of(alike, is_real, is_positive, is_named(DRIVE)),
        all_of(fits, is_real, is_positive, has_few, lambda entry: guess.nameless),
        all_of(fits, lambda entry: not is_real(entry), is_named(LOAD)),
    )
    response = _response(guess, fits)
    if response.get("phase_sense"):
        guess.doubts["test.response.phase_sense"] = "a positive phase means later (lag) or earlier (lead)"
    if force is not None:
        told = {"amplitude": guess.address(force), "unit": _unit_of_force(guess, force)} | _scale(force)
        if not is_real(force):
            told = {"complex": told["amplitude"], "unit": told["unit"], "phase_sense": "lead"}
        guess.tables["test.force"] = told
        guess.tables["test.response"] = response
        if leveled:
            guess.tables["test.level"] = leveled
        elif has_few(force):
            guess.tables["test.level"] = {"column": told["amplitude"], "unit": told["unit"]}
        return
    guess.tables["test.force"] = {"nominal": True}
    guess.doubts["test.force.nominal"] = "no force was found, so the level stands for it"
    guess.tables["test.response"] = response
    if leveled:
        guess.tables["test.level"] = leveled
    elif runs is not None:
        guess.tables["test.level"] = {"values": ["1 N"] * runs[2]}
        guess.doubts["test.level.values"] = "write the force amplitude of each"
    else:
        guess.tables["test.level"] = {"value": "1 N"}
        guess.doubts["test.level.value"] = "write the force amplitude of this file"


def propose(contents: Contents) -> Proposal | None:
    """Propose the [test] table of a case from what a file holds; None where nothing fits.

    Parameters
    ----------
    contents
        What ``list_contents`` found.
    """
    guess = _Guess(contents)
    timed = evenly_spaced
    hertz = ("Hz", "kHz", "mHz", "rad/s", "rpm")
    tabled = all_of(is_real, is_long, moves, is_positive)
    seconds = all_of(timed, lambda entry: entry.unit in ("s", "ms", "us"))
    time = guess.take(all_of(seconds, lambda entry: not FREQUENCY.search(last_name(entry))))
    frequency = rate = None
    if time is None:
        frequency = guess.take(
            all_of(tabled, lambda entry: entry.unit in hertz), all_of(tabled, is_named(FREQUENCY))
        )
    if time is None and frequency is None:
        time = guess.take(all_of(timed, is_named(TIME)))
        rate = (
            guess.take(all_of(lambda entry: entry.size == 1, is_named(RATE), is_positive))
            if not time
            else None
        )
    if time is rate is frequency is None and guess.nameless:
        # without names: what turns back is the frequency rather than what rises as time does
        many = all_of(tabled, lambda entry: not has_few(entry) and (entry.low or 0) > 0)
        frequency = guess.take(all_of(many, lambda entry: entry.order == "mixed"), many)
        if frequency is not None:
            guess.doubts["test.frequency.column"] = (
                "the columns have no names: all are guesses by their values"
            )
    if frequency is not None:
        _amplitudes(guess, frequency)
    elif any(entry.size > 15 for entry in guess.free):
        _history(guess, time, rate)
    else:
        return None
    if not guess.tables["test.response"]:
        return None
    if "samples" not in guess.tables["test.response"] and not any(
        key in guess.tables["test.response"] for key in ("amplitude", "complex", "real")
    ):
        return None
    fixed = {"sha256": contents.sha256} if contents.sha256 else {}
    guess.doubts["test.sha256"] = "the last line has no end: see that nothing is cut off"
    guess.tables["test"] = {"kind": "measured", "file": contents.file.name, **fixed, **guess.tables["test"]}
    layout = contents.layout
    if layout is not None:
        told: dict[str, str | int] = {
            "delimiter": layout.delimiter,
            "decimal": layout.decimal,
            "skip": layout.skip,
        }
        told["encoding"] = layout.encoding
        plain = {"delimiter": "auto", "decimal": ".", "skip": 0, "encoding": "auto"}
        needed = {key: value for key, value in told.items() if value != plain[key]}
        if needed:
            guess.tables = {"test": guess.tables["test"], "test.layout": needed, **guess.tables}
    return Proposal(guess.tables, guess.doubts)
