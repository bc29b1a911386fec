"""Channels of a measured test: where each is, and sums of those with names.

The classes are declarations, too: a case file has the same keys, derived by ``rsgen.cases``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Annotated, Literal

from rsgen.common.declaration import Rule, check, declare, documented, given
from rsgen.common.errors import MeasurementError
from rsgen.data.record_set import QUANTITIES

AMPLITUDES = "amplitude (with phase), or real and imaginary, or complex"
MAX_DELAY = 10.0
"""Delay of a channel [s]: no filter and no multiplexer is later."""
PLACES = ("amplitude", "phase", "real", "imaginary", "complex", "samples")
_TOGETHER = (["amplitude"], ["amplitude", "phase"], ["complex"], ["samples"], ["real", "imaginary"])

Column = Annotated[
    int | str,
    Rule(
        "A column by its number (1 is the first), by its name in the header, or by its path in the file's "
        'tree, such as "runs/*/freq" or "Acceleration[3]" (rsgen inspect lists them).',
        at_least=1,
        at_most=10_000,
        fewest=1,
        most=200,
        what="a column number from 1 (the first) to 10000, or a column name of 1 to 200 characters,",
    ),
]


def star_pattern(address: str) -> re.Pattern[str]:
    """Compile an address: each * takes the shortest text of a sign or more that fits, between two /.

    A * that has found its text keeps it, so that the time is linear in the number of stars.

    Examples
    --------
    >>> star_pattern("run_*/ch*_*").fullmatch("run_1/ch2_3_4").groups()
    ('1', '2', '3_4')
    """
    first, *others = map(re.escape, address.split("*"))
    texts = [f"(?>([^/]+?){text})" for text in others[:-1]] + [f"([^/]+){text}" for text in others[-1:]]
    return re.compile(first + "".join(texts))


RADIANS = {"deg": pi / 180, "rad": 1.0}
"""Units of a phase, in rad. Titles name them in ``column_titles``, ``clues`` and ``sensors``."""
Seconds = Annotated[float, Rule(unit="s")]
Unit = Annotated[str, Rule(most=40)]
Scale = Annotated[
    Literal["peak", "rms"], Rule("Whether the numbers are peak amplitudes or root mean squares.")
]
Factor = Annotated[
    float | str,
    Rule(
        "Every number is multiplied by it, its unit included: '10 g/V'. A sensitivity divides: '100 mV/g'.",
        unit="",
    ),
]


class Checked:
    """Refuses values out of range when it is made."""

    __slots__ = ()

    def __post_init__(self) -> None:
        check(self, MeasurementError)


@documented
@dataclass(frozen=True, slots=True)
class Channel(Checked):
    """A recorded channel: complex amplitudes in one or two columns, or samples; or a sum of channels."""

    quantity: Literal["force", "displacement", "velocity", "acceleration"] | None = declare(
        None, "What was measured."
    )
    amplitude: Column | None = None
    phase: Column | None = declare(None, "Goes with amplitude; 0 without.")
    real: Column | None = None
    imaginary: Column | None = None
    factor: Factor = 1.0
    unit: Unit | None = declare(None, "Of the column; without it the unit that the file names, else SI.")
    scale: Scale = "peak"
    phase_unit: Literal["deg", "rad"] = "deg"
    phase_sense: Literal["lag", "lead"] | None = declare(
        None,
        "Whether a positive phase (or imaginary part) means later or earlier than the reference; a case file "
        "must say it, otherwise lead.",
    )
    complex: Column | None = declare(None, "A column of complex numbers.")
    samples: Column | None = declare(None, "The samples of a time history.")
    channels: str | None = declare(
        None,
        "Instead of columns: a sum of named channels, such as 'payload - wing' or '0.5*left + 0.5*right'.",
        most=400,
    )
    delay: Seconds = declare(
        0.0,
        "How much later than the others its signal arrives, as behind a filter; taken off. Negative for a "
        "channel that is sampled later than the others, as by a multiplexer.",
        at_least=-MAX_DELAY,
        at_most=MAX_DELAY,
    )
    nominal: bool = declare(
        False, "True: force or base were not recorded, and the level stands for their amplitude."
    )
    files: tuple[Path, ...] = declare(
        (), "Its files, one for each of the test; those of the test without.", key="file", fewest=1, most=200
    )

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name ("" for all) and what is wrong with it."""
        places = list(given(self, *PLACES))
        of_column = given(self, "factor", "unit", "scale", "phase_unit", "phase_sense", "delay", "files")
        if self.channels is not None:
            if places:
                yield "channels", "are given, and columns too; leave one of them out"
            for name in of_column:
                yield name, "is of a column, but channels are given; say it of each channel"
            try:
                combination(self.channels)
            except MeasurementError as fault:
                yield "channels", str(fault)
            return
        if self.nominal:
            for name in (*places, *of_column):
                yield name, "is of a column, but nominal = true takes the level; leave one out"
        elif places not in _TOGETHER:
            yield "", f"give {AMPLITUDES}, or samples of a time history; one is needed"
        if self.samples is not None and self.scale == "rms":
            yield "scale", "is 'rms', but samples are instants; leave it out"
        if self.factor == 0:
            yield "factor", "is 0; a number other than 0 is needed"

    @property
    def columns(self) -> tuple[int | str, ...]:
        """The columns that are needed."""
        return tuple(getattr(self, name) for name in given(self, *PLACES))

    def measuring(self, quantity: str | None) -> Channel:
        """Return the channel with its quantity, where it says none; its faults are left to ``faults``."""
        known = copy(self)
        object.__setattr__(known, "quantity", self.quantity or quantity)
        return known

    @property
    def si_unit(self) -> str:
        """SI unit of the quantity."""
        return QUANTITIES.get(self.quantity or "displacement", "N")

    @property
    def lags(self) -> bool:
        """True if a positive phase or imaginary part means later than the reference."""
        return self.phase_sense == "lag"


_TERM = re.compile(r"\s*([+-]?)\s*(?:(\d+(?:\.\d*)?|\.\d+)\s*\*\s*)?([A-Za-z_][A-Za-z0-9_]{0,39})\s*")
"""A sign, a number and the name of a channel."""


def combination(text: str) -> dict[str, float]:
    """Read a sum of channels: factor by name.

    Raises
    ------
    MeasurementError
        It is no sum, or a channel stands twice.

    Examples
    --------
    >>> combination("payload - 0.5*wing")
    {'payload': 1.0, 'wing': -0.5}
    """
    terms: dict[str, float] = {}
    place = 0
    while place < len(text) or not terms:
        found = _TERM.match(text, place)
        if found is None or (terms and not found[1]):
            raise MeasurementError(f"{text!r:.80}; a sum of channels is needed, such as 'payload - 0.5*wing'")
        sign, number, name = found.groups()
        if name in terms:
            raise MeasurementError(f"{text!r:.80}: {name} stands twice; each channel once")
        factor = float(number or 1)
        if factor == 0:
            raise MeasurementError(f"{text!r:.80}: 0 times {name} is nothing; leave it out")
        terms[name] = -factor if sign == "-" else factor
        place = found.end()
    return terms


@documented
@dataclass(frozen=True, slots=True)
class BaseRule(Checked):
    """The motion of a driven base, instead of a force."""

    channel: Annotated[Channel, Rule("What of the base was measured, and where it is.", key="")]
    response: Annotated[
        Literal["relative", "absolute"],
        Rule("Whether the response is the motion relative to the base or the absolute one."),
    ]
