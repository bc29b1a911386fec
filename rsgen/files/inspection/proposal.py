"""A guess of where in a file frequency, force and response are, by names, units, order and sizes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rsgen.files.inspection.amplitude_tables import propose_amplitudes
from rsgen.files.inspection.clues import (
    ANGULAR,
    EVEN,
    FEW,
    FREQUENCY,
    IS_FORCE,
    IS_MOTION,
    LONG,
    PHASE,
    POSITIVE,
    QUOTIENT,
    RATE,
    REAL,
    TIME,
    VARIES,
    Clue,
)
from rsgen.files.inspection.column_levels import levels_in_columns
from rsgen.files.inspection.guess import Guess
from rsgen.files.inspection.siblings import siblings_of
from rsgen.files.inspection.time_histories import propose_history
from rsgen.files.plan import HERTZ, SECONDS, Layout
from rsgen.files.tree import Contents, Entry

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
