"""A guess of where in a file frequency, force and response are, by names, units, order and sizes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from rsgen.errors import RsgenError
from rsgen.measurement.contents import Contents, Entry
from rsgen.units import quantity

__all__ = ["Proposal", "propose"]

FEW = 60
"""Different values of a column that may be that of the level."""
_FREQUENCY = re.compile(r"freq|hertz|omega|^f(_|$|\d)|(^|_)hz(_|$)|rpm", re.IGNORECASE)
_TIME = re.compile(r"^t(_|$)|time|zeit|instant", re.IGNORECASE)
_FORCE = re.compile(r"forc|kraft|load(?!_cycle)", re.IGNORECASE)
_DRIVE = re.compile(r"excit|drive|shaker|^u(_|$)|input|^f(_|$|\d)|volt", re.IGNORECASE)
_RESPONSE = re.compile(
    r"acc|vel|disp|resp|receptance|mobility|frf|strain|laser|output|^[xyva](_|$|\d)|^h(_|$|\d)", re.IGNORECASE
)
_RATE = re.compile(r"^f_?s$|rate|sampling|fsamp", re.IGNORECASE)
_REAL = re.compile(r"(^|_)re(al)?(_|$)|in_?phase|cos|(^|_)x\d*(_|$)", re.IGNORECASE)
_IMAGINARY = re.compile(r"(^|_)im(ag)?|quad|sin|(^|_)y\d*(_|$)", re.IGNORECASE)
_PHASE = re.compile(r"phase|phi|(^|_)lag|arg|angle|deg", re.IGNORECASE)
_SPREAD = re.compile(r"std|sigma|var|error|coherence|temperature|number", re.IGNORECASE)
_QUANTITIES = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
_NAMES = {"acc": "acceleration", "vel": "velocity", "mobility": "velocity", "disp": "displacement"}


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


def _name(entry: Entry) -> str:
    """Give the last telling part of a path: "x/X1__V_/data" is about X1__V_."""
    parts = [part for part in entry.path.split("/") if part.casefold() not in ("data", "value", "values")]
    return parts[-1] if parts else entry.path


def _words(entry: Entry) -> str:
    return _name(entry)


def _fits(unit: str, target: str) -> str | None:
    """Give the unit if it is one of the target's dimension."""
    name = unit.strip().replace("²", "^2").replace("µ", "u")
    known = "standard_gravity" if name in ("g", "g_n", "gn") and target == "m/s^2" else name
    try:
        quantity(f"1 {known}", target)
    except RsgenError:
        return None
    return name


def _is_unit(entry: Entry, *targets: str) -> bool:
    return bool(entry.unit) and any(_fits(entry.unit, target) for target in targets)


def _moves(entry: Entry) -> bool:
    """Tell whether the numbers are finite and differ; of complex ones that is not known."""
    return entry.dtype.startswith("complex") or (entry.low is not None and entry.low != entry.high)


class _Guess:
    """The entries that are left, and what was taken from them."""

    def __init__(self, contents: Contents) -> None:
        self.contents = contents
        usable = [e for e in contents.entries if e.dtype and not e.fault and e.size]
        self.free = [e for e in usable if not _SPREAD.search(_words(e)) and (e.size == 1 or _moves(e))]
        self.nameless = contents.format == "csv" and all(e.path.isdigit() for e in usable)
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
        sides = [length for length in entry.shape if length > 1]
        if len(sides) > 1 and self.tables["test"].get("excitation"):
            return f"{entry.path}[1]"
        return int(entry.path) if self.contents.format == "csv" and entry.path.isdigit() else entry.path


def _of_size(size: int) -> Callable[[Entry], bool]:
    return lambda entry: entry.size == size or size in entry.shape


def _both(*tests: Callable[[Entry], bool]) -> Callable[[Entry], bool]:
    return lambda entry: all(test(entry) for test in tests)


def _named(pattern: re.Pattern[str]) -> Callable[[Entry], bool]:
    return lambda entry: bool(pattern.search(_words(entry)))


def _remarked(*words: str) -> Callable[[Entry], bool]:
    return lambda entry: any(word in entry.remark for word in words)


def _positive(entry: Entry) -> bool:
    return entry.low is not None and entry.low >= 0 and entry.high is not None and entry.high > 0


def _few(entry: Entry) -> bool:
    return 1 < entry.distinct <= FEW and entry.distinct < entry.size / 3


def _both_signs(entry: Entry) -> bool:
    return entry.low is not None and entry.high is not None and entry.low < 0 < entry.high


def _real(entry: Entry) -> bool:
    return not entry.dtype.startswith("complex")


def _long(entry: Entry) -> bool:
    return entry.size > 1


def _quantity_of(guess: _Guess, entry: Entry, table: dict[str, Any]) -> None:
    """Say what the response is, by its unit, else by its name."""
    per = entry.unit.endswith("/N")
    unit = entry.unit.removesuffix("/N")
    for name, target in _QUANTITIES.items():
        known = _fits(unit, target) if unit else None
        if known:
            table |= {"quantity": name, "unit": known + ("/N" if per else "")}
            break
    else:
        words = f"{_words(entry)} {entry.remark}".casefold()
        named = (meaning for start, meaning in _NAMES.items() if start in words)
        table["quantity"] = next(named, "displacement")
        table["unit"] = _QUANTITIES[table["quantity"]]
        guess.doubts["test.response.unit"] = (
            f"the file says {entry.unit!r}; put its meaning into factor" if entry.unit else "not in the file"
        )
    if per or "over force" in entry.remark or "frequency response" in entry.remark:
        if not per:
            table["unit"] += "/N"
        table["per_force"] = True


def _history(guess: _Guess, time: Entry | None, rate: Entry | None) -> None:
    test: dict[str, Any] = {"excitation": "swept-sine"}
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
    fits = _both(_real, _long, _of_size(size))
    force = guess.take(
        _both(fits, lambda e: _is_unit(e, "N")),
        _both(fits, _remarked("force")),
        _both(fits, _named(_FORCE)),
        _both(fits, _named(_DRIVE)),
    )
    if force is None:
        test["excitation"] = "ring-down"
        guess.doubts["test.excitation"] = "no force was found"
    else:
        guess.doubts["test.excitation"] = "or stepped-sine, ring-down"
        guess.tables["test.force"] = {"samples": guess.address(force), "unit": _unit_of_force(guess, force)}
    response = guess.take(
        _both(fits, lambda e: _is_unit(e, *_QUANTITIES.values())), _both(fits, _named(_RESPONSE)), fits
    )
    told: dict[str, Any] = {}
    if response is not None:
        _quantity_of(guess, response, told)
        told["samples"] = guess.address(response)
        if "[" in str(told["samples"]):
            sides = [length for length in response.shape if length > 1]
            guess.doubts["test.response.samples"] = f"channels 1 to {min(sides)}"
    guess.tables["test.response"] = told


def _unit_of_force(guess: _Guess, entry: Entry) -> str:
    known = _fits(entry.unit, "N") if entry.unit else None
    if known is None:
        guess.doubts["test.force.unit"] = (
            f"the file says {entry.unit!r}; write unit and factor, such as unit = 'V', factor = '10 N/V'"
            if entry.unit
            else "not in the file"
        )
    return known or "N"


def _response(guess: _Guess, fits: Callable[[Entry], bool]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    whole = guess.take(_both(fits, lambda entry: not _real(entry)))
    if whole is not None:
        _quantity_of(guess, whole, table)
        return table | {"complex": guess.address(whole), "phase_sense": "lead"}
    real = guess.take(_both(fits, _named(_REAL)), _both(fits, _both_signs, lambda entry: guess.nameless))
    imaginary = None
    if real is not None:
        imaginary = guess.take(
            _both(fits, _named(_IMAGINARY)), _both(fits, _both_signs, lambda entry: guess.nameless)
        )
    if real is not None and imaginary is not None:
        _quantity_of(guess, real, table)
        table |= {"real": guess.address(real), "imaginary": guess.address(imaginary)}
        return table | {"phase_sense": "lead"}
    if real is not None:
        guess.free.insert(0, real)
    phase = guess.take(_both(fits, _named(_PHASE)))
    amplitude = guess.take(
        _both(fits, lambda entry: _is_unit(entry, *_QUANTITIES.values())),
        _both(fits, _named(_RESPONSE)),
        fits,
    )
    if amplitude is not None:
        _quantity_of(guess, amplitude, table)
        table["amplitude"] = guess.address(amplitude)
    if phase is None:
        return table | {"phase_known": False}
    table["phase"] = guess.address(phase)
    if phase.unit == "rad" or (phase.high is not None and phase.high <= 6.5 and (phase.low or 0) >= -6.5):
        table["phase_unit"] = "rad"
    return table | {"phase_sense": "lag"}


def _amplitudes(guess: _Guess, frequency: Entry) -> None:
    guess.tables["test"] = {}
    column: dict[str, Any] = {"column": guess.address(frequency)}
    if frequency.unit in ("kHz", "mHz", "rad/s", "rpm"):
        column["unit"] = frequency.unit
    guess.tables["test.frequency"] = column
    size = frequency.size
    fits = _both(_long, _of_size(size))
    force = guess.take(
        _both(fits, _real, lambda entry: _is_unit(entry, "N")),
        _both(fits, _real, _positive, _named(_FORCE)),
        _both(fits, _real, _positive, _named(_DRIVE)),
        _both(fits, _real, _positive, _few, lambda entry: guess.nameless),
    )
    response = _response(guess, fits)
    if response.get("phase_sense"):
        guess.doubts["test.response.phase_sense"] = "a positive phase means later (lag) or earlier (lead)"
    if force is not None:
        told = {"amplitude": guess.address(force), "unit": _unit_of_force(guess, force)}
        guess.tables["test.force"] = told
        guess.tables["test.response"] = response
        if _few(force):
            guess.tables["test.level"] = {"column": told["amplitude"], "unit": told["unit"]}
        return
    guess.tables["test.force"] = {"nominal": True}
    guess.doubts["test.force.nominal"] = "no force was found, so the level stands for it"
    guess.tables["test.response"] = response
    guess.tables["test.level"] = {"value": "1 N"}
    guess.doubts["test.level.value"] = "write the force amplitude of this file"


def _evenly_timed(entries: Iterable[Entry]) -> Callable[[Entry], bool]:
    def test(entry: Entry) -> bool:
        return entry.order == "rising" and bool(entry.step) and entry.size > 15 and _real(entry)

    return test


def propose(contents: Contents) -> Proposal | None:
    """Propose the [test] table of a case from what a file holds; None where nothing fits.

    Parameters
    ----------
    contents
        What ``list_contents`` found.
    """
    guess = _Guess(contents)
    timed = _evenly_timed(guess.free)
    hertz = ("Hz", "kHz", "mHz", "rad/s", "rpm")
    tabled = _both(_real, _long, _positive)
    seconds = _both(timed, lambda entry: entry.unit in ("s", "ms", "us"))
    time = guess.take(_both(seconds, lambda entry: not _FREQUENCY.search(_words(entry))))
    frequency = rate = None
    if time is None:
        frequency = guess.take(
            _both(tabled, lambda entry: entry.unit in hertz), _both(tabled, _named(_FREQUENCY))
        )
    if time is None and frequency is None:
        time = guess.take(_both(timed, _named(_TIME)))
        rate = (
            guess.take(_both(lambda entry: entry.size == 1, _named(_RATE), _positive)) if not time else None
        )
    if time is rate is frequency is None and guess.nameless:
        # without names: what turns back is the frequency rather than what rises as time does
        many = _both(tabled, lambda entry: not _few(entry) and (entry.low or 0) > 0)
        frequency = guess.take(_both(many, lambda entry: entry.order == "mixed"), many)
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
    guess.tables["test"] = {"kind": "measured", "file": contents.file.name, **guess.tables["test"]}
    layout = contents.layout
    if layout is not None:
        told = {"delimiter": layout.delimiter, "decimal": layout.decimal, "skip": layout.skip}
        plain = {"delimiter": "auto", "decimal": ".", "skip": 0}
        needed = {key: value for key, value in told.items() if value != plain[key]}
        if needed:
            guess.tables = {"test": guess.tables["test"], "test.layout": needed, **guess.tables}
    return Proposal(guess.tables, guess.doubts)
