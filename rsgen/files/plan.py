"""The plan of a measured test: files, columns, units and levels from which a response surface is read.

The classes are declarations, too: a case file's [test] table has the same keys, derived by ``rsgen.cases``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from math import pi, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from rsgen.common.declaration import Rule, check, choices, declare, documented, given
from rsgen.common.errors import MeasurementError, RsgenError, quote
from rsgen.data.record_set import CHANNEL_NAME, QUANTITIES, PlannedTest
from rsgen.files.data_files import FORMATS
from rsgen.files.signals import (
    AMPLITUDES,
    BaseRule,
    Channel,
    Checked,
    Column,
    Factor,
    Scale,
    Seconds,
    Unit,
    combination,
    star_pattern,
)
from rsgen.formula.units import quantity, sensor_factor, sensor_unit

MAX_FILES = 200

HERTZ = {"Hz": 1.0, "kHz": 1e3, "mHz": 1e-3, "rad/s": 1 / (2 * pi), "rpm": 1 / 60}
"""Units of frequencies in a file, which ``MeasuredTest.frequency_unit`` names again, in Hz. Those of a case
are read by ``formula/units``, for which rad/s and rpm are rates: between these and Hz is a factor of 2 pi."""

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}

LABEL = "label"
"""The unit of levels that are names of runs: of none."""
UNIT_IN_NAME = re.compile(r"[ _-]?([munk]?N|lbf|[mu]m|[mu]?g)(?![A-Za-z])")
"""A unit right behind the number in a file's name: "run_{level}mN.csv"."""

if TYPE_CHECKING:
    FormatName = str
else:
    FormatName = Literal["auto", "csv", *FORMATS]
Excitation = Literal["swept-sine", "stepped-sine", "ring-down", "multisine"]
Hertz = Annotated[float, Rule(unit="Hz", above=0)]
Newton = Annotated[float, Rule(unit="N", above=0, label=True)]
Edge = Annotated[float, Rule(unit="Hz", at_least=0)]
_SHA256 = Rule(pattern="[0-9a-f]{64}", what="a SHA-256 of 64 signs 0-9 a-f")


@documented
@dataclass(frozen=True, slots=True)
class Layout(Checked):
    """How the text of a data file is laid out."""

    delimiter: Literal["auto", "whitespace", ",", ";", "\t", "|"] = declare(
        "auto", "Between the numbers of a line."
    )
    decimal: Literal[".", ","] = "."
    comments: tuple[Annotated[str, Rule(fewest=1, most=4)], ...] = declare(
        ("#", "%", "//"), "Lines that begin with one of these are no data.", most=8
    )
    skip: int = declare(
        0, "Lines to pass over first; names and units in the last of them count.", at_least=0, at_most=10_000
    )
    encoding: Literal["auto", "utf-8", "cp1252", "latin-1", "cp1250", "cp1251", "gb18030", "shift_jis"] = (
        declare("auto", "Of names and remarks; auto is UTF-8, and cp1252 where it is not.")
    )

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name and what is wrong with it."""
        if self.decimal == "," == self.delimiter:
            yield "delimiter", "',' is the decimal sign here; ';', '\\t', '|' or 'whitespace' is allowed"


@documented
@dataclass(frozen=True, slots=True)
class SweepRule(Checked):
    """From which side a point was reached: the same for all, or recognised from the order."""

    direction: Literal["recognise", "rest", "up", "down"] = "recognise"


@documented
@dataclass(frozen=True, slots=True)
class LevelRule(Checked):
    """The nominal level of a point: values, a column, a part of the file's name, or what was measured."""

    value: Newton | None = declare(None, "One level for all files.")
    column: Column | None = None
    factor: Factor = 1.0
    spread: float | None = declare(
        None,
        "Points whose force differs by less than this fraction share a level, wherever they stand. Without "
        "it each entry that a * means is a level, and so are runs of like force.",
        above=0,
        below=1,
    )
    values: tuple[Newton, ...] = declare(
        (), "One for each file, or for each entry that a * means in one file.", fewest=1, most=MAX_FILES
    )
    name: str | None = declare(
        None,
        'The form of the files\' names, such as "sweep_{level}N.mat"; a * is one character or more: '
        '"rep*_{level}N_*.mat". Of one file with columns such as "* V/F" that of its sheets: "{level} V".',
        most=2_000,
    )
    unit: Unit | None = declare(
        None,
        "Of the column or the name; N without it, m where the response was held. 'label': the numbers only "
        "distinguish runs, and the levels are called by what was measured.",
    )
    scale: Scale = "peak"

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name ("" for all) and what is wrong with it."""
        if self.labels and not self.known:
            yield "unit", f"is {LABEL!r}, but there are none; value, values, column or name is needed"
        both = given(self, "value", "values", "column", "name", "spread")
        if len(both) > 1:
            yield "", f"has {' and '.join(both)}; give one of them"
        if self.name is not None and self.name.count("{level}") != 1:
            yield "name", "must have {level} once, where the number stands: run_{level}N.csv"
        elif self.name is not None and re.search(r"\*[\d.,]*\{level\}", self.name):
            yield (
                "name",
                "has * right before {level}, whose digits it could take; put a character between them",
            )

    @property
    def labels(self) -> bool:
        """True if the numbers of the levels are only names of runs."""
        return self.unit == LABEL

    @property
    def known(self) -> bool:
        """True if the level is known without the measured force."""
        return bool(given(self, "value", "values", "column", "name"))


@documented
@dataclass(frozen=True, slots=True)
class HistoryRule(Checked):
    """How time histories were taken, and where their time is."""

    excitation: Excitation
    rate: Hertz | None = declare(None, "The sampling rate, such as 400 Hz.", key="time.rate")
    rate_column: Column | None = declare(
        None, "Where the file has the rate [Hz], or in the unit of its title.", key="time.rate_column"
    )
    time: Column | None = declare(
        None, "A column of evenly spaced instants; rounded ones need the rate, too.", key="time.column"
    )
    unit: Literal["s", "ms", "us"] | None = declare(
        None, "Of the column of instants; without it the unit that the file names, else s.", key="time.unit"
    )
    start: Seconds | None = declare(None, "Leave out what comes before.", key="time.start")
    stop: Seconds | None = declare(None, "Leave out what comes after.", key="time.stop")
    band: tuple[Edge, Edge] | None = declare(
        None, "Lowest and highest frequency of the result; all without.", key="demodulation.band"
    )
    law: Literal["linear", "logarithmic"] | None = declare(
        None, "Of a swept sine; recognised without.", key="demodulation.law"
    )
    bandwidth: Hertz | None = declare(
        None, "Of a swept sine's demodulation; chosen without.", key="demodulation.bandwidth"
    )
    harmonics: int | None = declare(
        None, "Of the result; chosen without.", key="demodulation.harmonics", at_least=1, at_most=64
    )
    period: int | None = declare(
        None,
        "Samples a period of a multisine; found from the force without.",
        key="multisine.period",
        at_least=16,
        at_most=100_000_000,
    )
    transient: int | None = declare(
        None,
        "Periods left out at the beginning of each record; found from the response without.",
        key="multisine.transient",
        at_least=0,
        at_most=1_000_000,
    )
    mass: float | None = declare(None, "Moving mass, if known.", unit="kg", above=0, outside=True)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name, or a key, and what is wrong with it."""
        many = self.excitation == "multisine"
        if not many and given(self, "period", "transient"):
            yield "multisine", "belongs to excitation = 'multisine'; leave it out"
        if many and given(self, "band", "law", "bandwidth", "harmonics"):
            yield "demodulation", "belongs to sines; of a multisine identify.band chooses the lines"
        if (self.rate_column is not None) == (self.rate is not None or self.time is not None):
            yield "time", "column, rate, both of them, or rate_column is needed"
        if self.band is not None and self.band[0] >= self.band[1]:
            yield "band", "the lowest frequency stands first, the highest above it"


@documented
@dataclass(frozen=True, slots=True)
class MeasuredTest(PlannedTest):
    """A real test: which files, and where in them frequency, force and response are.

    One path alone may be given for ``files``. Raises MeasurementError where values contradict.
    """

    files: Annotated[
        tuple[Path, ...], Rule("The data files, all laid out alike.", key="file", fewest=1, most=MAX_FILES)
    ]
    frequency: Annotated[
        Column | None,
        Rule("The column of the frequency; None for histories.", key="frequency.column", required=True),
    ]
    force: Annotated[
        Channel | None, Rule("None: not recorded, the level stands for it. Its phase is the reference.")
    ]
    response: Annotated[Channel, Rule("Where the response is, and what was measured.")]
    quantity: Literal["displacement", "velocity", "acceleration"] | None = declare(
        None, "What the response is, where its channel does not say it.", outside=True
    )
    frequency_unit: Literal["Hz", "kHz", "mHz", "rad/s", "rpm"] | None = declare(
        None, "Without it the unit that the file names, else Hz.", key="frequency.unit"
    )
    sweep: SweepRule = SweepRule()
    level: LevelRule = LevelRule()
    layout: Layout = Layout()
    sha256: tuple[Annotated[str, _SHA256], ...] = declare(
        (), "The SHA-256 of the file, or of each of them.", fewest=1, most=MAX_FILES
    )
    format: FormatName = declare("auto", "auto: recognised by how the file begins. csv: columns of text.")
    per_force: bool = declare(False, "The response is response over force.", key="response.per_force")
    phase_known: bool = declare(True, "False: amplitudes alone were recorded.", key="response.phase_known")
    control: Literal["force", "response", "phase", "continuation"] = declare(
        "force",
        "What was held constant within a level. Levels of a held response are "
        "amplitudes. phase: a phase-locked loop, one point a level. continuation: points on any branch.",
    )
    history: HistoryRule | None = declare(None, "How histories were taken; None for tables.", key="")
    calibrated: bool = declare(True, "False: any unit stands for N and the SI unit.", outside=True)
    base: BaseRule | None = declare(None, "Instead of a force: the motion of a driven base.")
    channels: dict[str, Channel] | None = declare(
        None, "Channels by name, of which force, response, base and elements are made."
    )
    across: str | None = declare(
        None, "Sum of channels that is the motion across the elements which say so.", outside=True
    )

    def __post_init__(self) -> None:
        files = self.files if isinstance(self.files, tuple) else (self.files,)
        object.__setattr__(self, "files", tuple(map(Path, files)))
        check(self, MeasurementError)
        if self.quantity is None:
            object.__setattr__(self, "quantity", self.quantity_of("response"))

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name and what is wrong with it."""
        files = len(self.files)
        found = list(channel_faults(self))
        if found:
            yield from found
            return
        if len(self.sha256) not in (0, files):
            yield "sha256", f"{len(self.sha256)} for {files} files; one for each is needed"
        pairs = list(zip(self.files, self.response.files or self.files, strict=False))
        for file, _ in [pair for number, pair in enumerate(pairs) if pair in pairs[:number]][:1]:
            yield "files", f"{file.name!r:.80} stands twice; each file once"
        one = files == 1 and self.history is None
        if len(self.level.values) not in (0, files) and not one:
            yield "level.values", f"{len(self.level.values)} for {files} files; one for each is needed"
        if self.level.spread is not None and self.control == "response":
            yield "level.spread", "groups forces, but the response was held; leave one of them out"
        if self.history is None:
            yield from _faults_of_sheets(self)
            if self.frequency is None:
                yield "frequency", "is missing; its column is needed"
            what = "force" if self.base is None else "base"
            if not self.driven and not self.level.known:
                yield "level", f"is missing; without a {what} value, values, column or name is needed"
            held = self.control == "response" and not self.per_force
            if not self.driven and (self.level.labels or held):
                yield "level", f"stands for the {what}, which was not recorded; it must be an amount of it"
            needed = f"give {AMPLITUDES}; 'samples' is for time histories"
        else:
            if self.frequency is not None:
                yield "frequency", "is found from the time histories; leave it out"
            if self.per_force:
                yield "per_force", "is for frequency responses, not for time histories"
            if given(self.sweep, "direction"):
                yield "sweep.direction", "is found from the time histories; leave it out"
            numbers = given(self.level, "value", "values", "column", "name", "spread")
            if self.history.excitation == "ring-down" and numbers and not self.level.labels:
                yield (
                    "level",
                    "has amounts, but no force drives a free decay, whose level is the largest force that it "
                    f"stands for; add unit = {LABEL!r}, so that the numbers are names, or leave it out",
                )
            needed = "a time history needs 'samples', its column, and nothing else"
        for name in self.made:
            for _, channel in self.terms(name):
                if channel.columns and (channel.samples is None) != (self.history is None):
                    yield name, needed
        yield from self._faults_of_units()

    def _faults_of_units(self) -> Iterator[tuple[str, str]]:
        """Find units and factors by which no number can be converted."""
        own = {name: channel for name, channel in self.made.items() if channel.channels is None}
        named = {f"channels.{name}": channel for name, channel in (self.channels or {}).items()}
        for name, said in (own | named | {"level": self.level}).items():
            try:
                _ = self.scale_of(said) if isinstance(said, Channel) else self.level_factor
            except RsgenError as fault:
                key = "factor" if isinstance(said.factor, str) else "unit" if said.unit else "name"
                # as it was typed, not as it was read: "g", not "1 standard_gravity"
                _, typed, wrong = str(fault).partition("' ")
                advice = "where the scale is unknown, [identify] calibrated = false"
                if name == "level":
                    advice = f'unit = "{LABEL}" where the levels are names, as the volts of a drive'
                unit = f"{quote(said.unit)} {wrong}; {advice}"
                yield f"{name}.{key}", unit if typed and key == "unit" else str(fault)

    @property
    def driven(self) -> bool:
        """True if what drives the structure was recorded; otherwise the levels stand for it."""
        if self.base is not None:
            return not any(channel.nominal for _, channel in self.terms("base"))
        return "force" in self.made

    @property
    def made(self) -> dict[str, Channel]:
        """Channels, or sums of channels, that are force, base and motions."""
        channels = {
            "force": None if self.force is None or self.force.nominal else self.force.measuring("force"),
            "base": None if self.base is None else self.base.channel,
            "response": self.response.measuring(self.quantity),
            "across": None if self.across is None else Channel(channels=self.across),
        }
        return {what: channel for what, channel in channels.items() if channel is not None}

    @property
    def motions(self) -> list[str]:
        """Motions that elements follow: the response, then that across two sensors if it is made."""
        return [what for what in self.made if what not in ("force", "base")]

    def terms(self, what: str) -> tuple[tuple[float, Channel], ...]:
        """Return factors and channels of "force", "response", "base" or "across"; none if not recorded."""
        channel = self.made.get(what)
        if channel is None or channel.channels is None:
            return () if channel is None else ((1.0, channel),)
        named = self.channels or {}
        return tuple((factor, named[name]) for name, factor in combination(channel.channels).items())

    def quantity_of(self, what: str) -> str:
        """Return what the channels of "force", "response", "base" or "across" measured."""
        return self.terms(what)[0][1].quantity or "displacement"

    @property
    def sources(self) -> tuple[Channel, ...]:
        """Every channel that is needed, once."""
        found: list[Channel] = []
        for what in self.made:
            found += [channel for _, channel in self.terms(what) if channel not in found]
        return tuple(found)

    @property
    def all_files(self) -> tuple[Path, ...]:
        """The files of the test and of its channels, each once."""
        named = [path for channel in (self.channels or {}).values() for path in channel.files]
        own = [path for channel in self.made.values() for path in channel.files]
        return tuple(dict.fromkeys((*self.files, *own, *named)))

    @property
    def file(self) -> Path:
        """The first file."""
        return self.files[0]

    @property
    def many_lines(self) -> bool:
        """True for time histories of a multisine, whose force has many spectral lines."""
        return self.history is not None and self.history.excitation == "multisine"

    def summary(self) -> dict[str, Any]:
        """Return the kind of test and its file, without the extent of its records."""
        # the directions of a table are taken from the order of its rows
        recognised = self.sweep.direction == "recognise" and self.history is None
        by_rows = recognised and self.control != "continuation"
        return {"kind": "measured", "file": self.file.name, "sweeps_recognised": by_rows}

    def origin(self) -> dict[str, str]:
        """Return names and values for the provenance of a result."""
        return {
            "Measured file": ", ".join(path.name for path in self.all_files),
            "SHA-256 of the measured file": ", ".join(self.sha256) or "not fixed by the case",
        }

    def unit_of(self, channel: Channel) -> str:
        """SI unit of a channel: of a response over force per newton."""
        return channel.si_unit + ("/N" if self.per_force and channel == self.made["response"] else "")

    def scale_of(self, channel: Channel) -> float:
        """The numbers of a channel times this are SI peak values."""
        return self._size(channel, self.unit_of(channel))

    @property
    def level_unit(self) -> str:
        """SI unit of the levels: "N", "m" where the response was held, that of the motion of a base."""
        if self.base is not None:
            return self.terms("base")[0][1].si_unit
        return "m" if self.control in ("response", "continuation") else "N"

    @property
    def level_factor(self) -> float:
        """The numbers of the level times this are SI peak values; those of labels stay as they are.

        Where the test is not calibrated, any unit stands for the SI unit: 1 V of a drive for 1 N.
        """
        return 1.0 if self.level.labels else self._size(self.level, self.level_unit, self._unit_in_name)

    @property
    def level_values(self) -> tuple[float, ...]:
        """Peak values of levels that the plan gives, one for each file or entry; () where it gives none."""
        rule = self.level
        said = rule.values if rule.value is None else (rule.value,) * len(self.files)
        return said if rule.labels else tuple(one * self._peak(rule) for one in said)

    def _peak(self, said: Channel | LevelRule) -> float:
        # levels of a multisine are root mean squares themselves
        return sqrt(2) if said.scale == "rms" and not self.many_lines else 1.0

    def _size(self, said: Channel | LevelRule, target: str, in_name: str = "") -> float:
        unit, peak = said.unit or in_name or target, self._peak(said)
        if isinstance(said.factor, str):
            return sensor_factor(said.factor, unit, target) * peak
        size = quantity(f"1 {sensor_unit(unit, target)}", target if self.calibrated else None)
        return size * said.factor * peak

    @property
    def _unit_in_name(self) -> str:
        """The unit that stands behind the number in the form of the files' names, or ""."""
        found = UNIT_IN_NAME.match((self.level.name or "").partition("{level}")[2])
        # a factor says what the numbers are already
        if not found or given(self.level, "factor"):
            return ""
        if found[1].endswith("g"):
            # of a base it is an acceleration, else a weight
            return found[1] if self.level_unit == "m/s^2" else ""
        # where a force was recorded, a length in the name is a gap or a position, and the number a label
        label = "force" in self.made and found[1].endswith("m") != (self.level_unit == "m")
        return "" if label else found[1]

    @property
    def unit_said(self) -> bool:
        """True if the case or the names of the files give the unit of the levels."""
        return bool(self.level.unit or self._unit_in_name or given(self.level, "value", "values"))


# ----------------------------------------------------------------------------
# What must fit together in channels with names, sums of them, and a driven base.


def channel_faults(test: MeasuredTest) -> Iterator[tuple[str, str]]:
    """Find what does not fit together: a field's name and what is wrong with it."""
    known = test.channels or {}
    for name, channel in known.items():
        if not CHANNEL_NAME.fullmatch(name):
            yield "channels", f"{name!r:.80} is no name; a letter, then letters, digits and _ are needed"
        if channel.channels is not None:
            yield f"channels.{name}.channels", "is made of other channels; a column is needed"
        elif channel.quantity is None:
            yield f"channels.{name}.quantity", "is missing; what was measured is needed"
    force = {} if test.force is None else {"force": test.force}
    channels = {f"channels.{name}": channel for name, channel in known.items()} | force | test.made
    for what, channel in channels.items():
        if channel.nominal and (what not in ("force", "base") or test.history is not None):
            yield f"{what}.nominal", "is true; only force or base of a table of amplitudes can be nominal"
        if len(channel.files) not in (0, len(test.files)):
            yield f"{what}.file", f"{len(channel.files)} for {len(test.files)} files; one for each is needed"
    wrong = [fault for what, channel in test.made.items() for fault in _made_faults(test, what, channel)]
    yield from wrong
    if not wrong:
        yield from _quantity_faults(test)
        yield from _base_faults(test)
        for what in ("base", "across") if test.history and test.history.excitation == "ring-down" else ():
            if what in test.made:
                yield (
                    what,
                    "does not go with 'ring-down'; swept sine, stepped sine or a table of amplitudes is "
                    "needed",
                )


def _quantity_faults(test: MeasuredTest) -> Iterator[tuple[str, str]]:
    """Find a quantity that is not that of the channels, and files that they do not come from."""
    for what, channel in test.made.items():
        known, said = test.terms(what)[0][1].quantity, channel.quantity
        if channel.channels is not None and said not in (None, known):
            yield f"{what}.quantity", f"is {said!r}, but its channels are {known}; leave it out"
    own = test.quantity_of("response")
    if test.response.channels is None and test.quantity not in (None, own):
        yield "quantity", f"is {test.quantity!r}, but the channel of the response is {own!r}; say it once"


def _faults_of_sheets(test: MeasuredTest) -> Iterator[tuple[str, str]]:
    """Find a column of one sheet or group next to columns of all of them."""
    pairs = [(what, channel) for what in test.made for _, channel in test.terms(what)]
    places = [(what, str(column)) for what, channel in pairs for column in channel.columns]
    sheets = dict.fromkeys(sheet for _, place in places if "*" in (sheet := place.rpartition("/")[0]))
    for what, place in places:
        sheet = place.rpartition("/")[0]
        every = [one for one in sheets if star_pattern(one).fullmatch(sheet)]
        if every and "*" not in place:
            yield (
                what,
                f"{quote(place)} is of one sheet, others are of all of {quote(every[0])}; write * here, too",
            )


def _made_faults(test: MeasuredTest, what: str, channel: Channel) -> Iterator[tuple[str, str]]:
    """Find what is wrong with the channel, or the sum of channels, that something is made of."""
    if channel.channels is None:
        if (what == "force") != (channel.quantity == "force") or channel.quantity is None:
            said = "is missing" if channel.quantity is None else f"is {channel.quantity!r}"
            needed = "'force'" if what == "force" else choices(Literal[tuple(QUANTITIES)])
            yield f"{what}.quantity", f"{said}; {needed} is needed"
        return
    try:
        names = combination(channel.channels)
    except MeasurementError as fault:
        yield what, str(fault)
        return
    known = test.channels or {}
    unknown = [name for name in names if name not in known]
    if unknown:
        yield what, f"{', '.join(unknown)}: no such channel; known: {', '.join(known) or 'none'}"
        return
    quantities = {str(known[name].quantity) for name in names}
    if (what == "force") != (quantities == {"force"}):
        needed = "of forces" if what == "force" else "of displacements, velocities or accelerations"
        said = ", ".join(sorted(quantities))
        yield what, f"{channel.channels!r:.80} is made {needed}; its channels are {said}"
    elif test.history is not None and len(quantities) > 1:
        yield (
            what,
            f"{channel.channels!r:.80} adds {' and '.join(sorted(quantities))}; channels of one quantity are "
            "needed in time histories",
        )


def _base_faults(test: MeasuredTest) -> Iterator[tuple[str, str]]:
    """Find what a driven base cannot have."""
    if test.base is None:
        return
    if test.force is not None:
        yield "base", "is driven, but there is a force; leave one of them out"
    if test.per_force or test.control in ("response", "continuation"):
        yield "base", "is driven by its motion; per_force and a held response need a force"
    if test.base.response == "absolute" and not test.phase_known:
        yield (
            "base.response",
            "is 'absolute', and no phases were recorded; the motion relative to the base needs them",
        )
    if test.history is not None:
        of_base, of_response = (test.quantity_of(what) for what in ("base", "response"))
        if of_base != "acceleration":
            yield "base.quantity", f"is {of_base!r}; a time history needs the acceleration of the base"
        elif test.base.response == "absolute" and of_response != "acceleration":
            yield (
                "base.response",
                f"is 'absolute', and the response is a {of_response}; a time history needs accelerations of "
                "both",
            )
