"""Where in measured files what is found: the plan by which a reader fills a response surface.

Units are already resolved to factors, so that readers only multiply.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from rsgen.errors import MeasurementError

__all__ = [
    "EXCITATIONS",
    "FORMATS",
    "HistoryRule",
    "Layout",
    "LevelRule",
    "MeasuredTest",
    "Signal",
    "SweepRule",
]

QUANTITIES = ("displacement", "velocity", "acceleration")
DIRECTIONS = ("recognise", "rest", "up", "down")
EXCITATIONS = ("swept-sine", "stepped-sine", "ring-down")
ENCODINGS = ("utf-8", "cp1252", "latin-1", "cp1250", "cp1251", "gb18030", "shift_jis")
FORMATS = ("auto", "csv", "mat", "hdf5", "npy", "npz", "uff")


@dataclass(frozen=True, slots=True)
class Layout:
    """How the text of a data file is laid out.

    Parameters
    ----------
    delimiter
        Between the numbers of a line: "auto", "whitespace" or one sign.
    decimal
        "." or ",".
    comments
        Lines that begin with one of these are no data.
    skip
        Lines to pass over before anything else.
    encoding
        "auto" (UTF-8, and lines that are not are taken for cp1252) or one of ENCODINGS. Numbers are ASCII in
        all of them, so that it can change names and remarks alone.
    """

    delimiter: str = "auto"
    decimal: str = "."
    comments: tuple[str, ...] = ("#", "%", "//")
    skip: int = 0
    encoding: str = "auto"


@dataclass(frozen=True, slots=True)
class Signal:
    """A complex amplitude in one or two columns, or the samples of a time history.

    Parameters
    ----------
    amplitude, phase, real, imaginary, complex, samples
        Columns, by number from 1, by name or by path in the file's tree: the first two (phase may be None:
        zero), the next two, a column of complex numbers, or the samples of a time history.
    factor
        The column's numbers times this are SI peak values; it contains unit, rms and sign.
    phase_factor
        The phase column times this is the lead in rad; negative where the column holds a lag.
    conjugate
        True where a positive imaginary part means a lag.
    unit_from_file
        True where numbers times ``factor`` are in the unit that the file itself names, in SI where it names
        none.

    Raises
    ------
    MeasurementError
        Columns are not one of these sets, or a factor is zero or not finite.
    """

    amplitude: int | str | None = None
    phase: int | str | None = None
    real: int | str | None = None
    imaginary: int | str | None = None
    factor: float = 1.0
    phase_factor: float = 1.0
    conjugate: bool = False
    complex: int | str | None = None
    samples: int | str | None = None
    unit_from_file: bool = False

    def __post_init__(self) -> None:
        given = {
            name
            for name in ("amplitude", "phase", "real", "imaginary", "complex", "samples")
            if getattr(self, name) is not None
        }
        if given not in (
            {"amplitude"},
            {"amplitude", "phase"},
            {"real", "imaginary"},
            {"complex"},
            {"samples"},
        ):
            raise MeasurementError(
                "signal: give amplitude (with phase), or real and imaginary, or complex, or samples; "
                "not one without the other"
            )
        for name in ("factor", "phase_factor"):
            value = getattr(self, name)
            if not isfinite(value) or value == 0:
                raise MeasurementError(f"signal.{name}: {value!r}; must be finite and not zero")

    @property
    def columns(self) -> tuple[int | str, ...]:
        """The columns that are needed."""
        places = (self.amplitude, self.phase, self.real, self.imaginary, self.complex, self.samples)
        return tuple(place for place in places if place is not None)


@dataclass(frozen=True, slots=True)
class SweepRule:
    """How it is known from which side a point was reached.

    Parameters
    ----------
    direction
        The same for all points, or "recognise" from the order of the frequencies in the file.
    column, up, down
        A column, and what it says for either direction; anything else in it means "rest".
    """

    direction: str = "recognise"
    column: int | str | None = None
    up: int | str | None = None
    down: int | str | None = None


@dataclass(frozen=True, slots=True)
class LevelRule:
    """The nominal level of a point: values, a column, a part of the file's name, or groups of like forces.

    Parameters
    ----------
    value
        One level for all files [N].
    values
        One level for each file, or for each entry that a * means in one file [N].
    column, factor
        A column whose numbers times the factor are the level [N].
    name
        A file name with {level} where the number stands; the number times the factor is the level [N].
    spread
        Without all these: forces closer than this fraction belong to one level.
    """

    value: float | None = None
    column: int | str | None = None
    factor: float = 1.0
    spread: float = 0.05
    values: tuple[float, ...] = ()
    name: str | None = None

    @property
    def told(self) -> bool:
        """Whether the level is told without looking at the force."""
        return self.value is not None or self.column is not None or bool(self.values) or self.name is not None


@dataclass(frozen=True, slots=True)
class HistoryRule:
    """How time histories were taken, and where their time is.

    Parameters
    ----------
    excitation
        "swept-sine", "stepped-sine" or "ring-down".
    rate
        Samples per second [Hz], if it is not in the file.
    rate_column
        Where in the file the one number of the rate is.
    time
        A column of evenly spaced instants.
    factor
        Its numbers times this are seconds; those of ``rate_column`` times this are Hz.
    start, stop
        The part of the history that is used [s]; None to its ends.
    band
        Lowest and highest frequency of the result [Hz]; None for all.
    law, bandwidth, harmonics
        Of the demodulation; None where it is to choose them.
    mass
        Moving mass [kg] if known.
    """

    excitation: str
    rate: float | None = None
    rate_column: int | str | None = None
    time: int | str | None = None
    factor: float = 1.0
    start: float | None = None
    stop: float | None = None
    band: tuple[float, float] | None = None
    law: str | None = None
    bandwidth: float | None = None
    harmonics: int | None = None
    mass: float | None = None

    def __post_init__(self) -> None:
        if self.excitation not in EXCITATIONS:
            raise MeasurementError(
                f"excitation: {self.excitation!r}; must be one of {', '.join(EXCITATIONS)}"
            )
        if sum(place is not None for place in (self.rate, self.rate_column, self.time)) != 1:
            raise MeasurementError("time: one of rate, rate_column and column must be given")


@dataclass(frozen=True, slots=True)
class MeasuredTest:
    """A real test: which files, and where in them frequency, force and response are.

    Parameters
    ----------
    files
        The data files, all laid out alike; a case resolves them inside its own folder or the folder of
        measured data. One path alone may be given.
    frequency, frequency_factor
        The column of the frequency, and what turns its numbers into Hz; None for time histories.
    force, response
        The two complex amplitudes, or samples. The force is None where it was not recorded: then the level
        stands for it.
    quantity
        What the response is: "displacement", "velocity" or "acceleration".
    sweep, level, layout
        How direction and level are known and how a text is laid out.
    sha256
        The SHA-256 of each file in hexadecimal, or nothing where they are not fixed.
    format
        One of FORMATS; "auto" recognises each file by its first bytes.
    per_force
        True where the response is a quotient, response over force: a frequency response function.
    phase_known
        False where amplitudes alone were recorded.
    response_files
        Where the response lies in files of its own: one for each of ``files``.
    history
        How time histories were taken; None for tables of amplitudes.

    Raises
    ------
    MeasurementError
        An unknown quantity, direction or format; files, levels and hashes differ in number; a force that is
        neither recorded nor told by a level.
    """

    files: tuple[Path, ...]
    frequency: int | str | None
    force: Signal | None
    response: Signal
    quantity: str
    frequency_factor: float = 1.0
    sweep: SweepRule = SweepRule()
    level: LevelRule = LevelRule()
    layout: Layout = Layout()
    sha256: tuple[str, ...] = ()
    format: str = "auto"
    per_force: bool = False
    phase_known: bool = True
    response_files: tuple[Path, ...] = ()
    history: HistoryRule | None = None

    def __post_init__(self) -> None:
        files = self.files if isinstance(self.files, tuple) else (self.files,)
        object.__setattr__(self, "files", tuple(map(Path, files)))
        if not self.files:
            raise MeasurementError("files: none; at least one is needed")
        if self.quantity not in QUANTITIES:
            raise MeasurementError(f"quantity: {self.quantity!r}; must be one of {', '.join(QUANTITIES)}")
        if self.sweep.direction not in DIRECTIONS:
            raise MeasurementError(
                f"sweep.direction: {self.sweep.direction!r}; must be one of {', '.join(DIRECTIONS)}"
            )
        if self.format not in FORMATS:
            raise MeasurementError(f"format: {self.format!r}; must be one of {', '.join(FORMATS)}")
        for name, count in (
            ("sha256", len(self.sha256)),
            ("response_files", len(self.response_files)),
        ):
            if count not in (0, len(self.files)):
                raise MeasurementError(f"{name}: {count} for {len(self.files)} files; one each is needed")
        one = len(self.files) == 1 and self.history is None
        if len(self.level.values) not in (0, len(self.files)) and not one:
            raise MeasurementError(
                f"level.values: {len(self.level.values)} for {len(self.files)} files; one each is needed"
            )
        if self.history is None and (self.frequency is None or self.response.samples is not None):
            raise MeasurementError("frequency: is missing; where it is must be told, or a history given")
        if self.force is None and self.history is None and not self.level.told:
            raise MeasurementError("force: was not recorded, so the level must be told")

    @property
    def file(self) -> Path:
        """The first file."""
        return self.files[0]
