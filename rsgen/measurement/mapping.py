"""Where in a measured file what is found: the plan by which a reader fills a response surface.

Units are already resolved to factors, so that readers only multiply.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from rsgen.errors import MeasurementError

__all__ = ["Layout", "LevelRule", "MeasuredTest", "Signal", "SweepRule"]

QUANTITIES = ("displacement", "velocity", "acceleration")
DIRECTIONS = ("recognise", "rest", "up", "down")


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
    """

    delimiter: str = "auto"
    decimal: str = "."
    comments: tuple[str, ...] = ("#", "%", "//")
    skip: int = 0


@dataclass(frozen=True, slots=True)
class Signal:
    """A complex amplitude in two columns (or one): amplitude and phase, or real and imaginary part.

    Parameters
    ----------
    amplitude, phase, real, imaginary
        Columns, by number from 1 or by name; either the first two (phase may be None: zero) or the last two.
    factor
        The column's numbers times this are SI peak values; it contains unit, rms and sign.
    phase_factor
        The phase column times this is the lead in rad; negative where the column holds a lag.
    conjugate
        True where a positive imaginary part means a lag.

    Raises
    ------
    MeasurementError
        Columns are not one of the two pairs, or a factor is zero or not finite.
    """

    amplitude: int | str | None = None
    phase: int | str | None = None
    real: int | str | None = None
    imaginary: int | str | None = None
    factor: float = 1.0
    phase_factor: float = 1.0
    conjugate: bool = False

    def __post_init__(self) -> None:
        polar = self.amplitude is not None and self.real is None and self.imaginary is None
        cartesian = (
            self.real is not None
            and self.imaginary is not None
            and self.amplitude is None
            and self.phase is None
        )
        if not (polar or cartesian):
            raise MeasurementError(
                "signal: give amplitude (with phase), or real and imaginary; not one without the other"
            )
        for name in ("factor", "phase_factor"):
            value = getattr(self, name)
            if not isfinite(value) or value == 0:
                raise MeasurementError(f"signal.{name}: {value!r}; must be finite and not zero")


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
    """The nominal level of a point: one value [N], a column times a factor, or groups of like forces.

    Parameters
    ----------
    value
        One level for the whole file [N].
    column, factor
        A column whose numbers times the factor are the level [N].
    spread
        Without value and column: forces closer than this fraction belong to one level.
    """

    value: float | None = None
    column: int | str | None = None
    factor: float = 1.0
    spread: float = 0.05


@dataclass(frozen=True, slots=True)
class MeasuredTest:
    """A real test: which file, and where in it frequency, force and response are.

    Parameters
    ----------
    file
        The data file; a case resolves it inside its own folder or the folder of measured data.
    frequency, frequency_factor
        The column of the frequency, and what turns its numbers into Hz.
    force, response
        The two complex amplitudes.
    quantity
        What the response is: "displacement", "velocity" or "acceleration".
    sweep, level, layout
        How direction and level are known and how the text is laid out.
    sha256
        The file's SHA-256 in hexadecimal, or None where it is not fixed.
    format
        "csv": numbers in columns of a text file.

    Raises
    ------
    MeasurementError
        An unknown quantity, direction or format.
    """

    file: Path
    frequency: int | str
    force: Signal
    response: Signal
    quantity: str
    frequency_factor: float = 1.0
    sweep: SweepRule = SweepRule()
    level: LevelRule = LevelRule()
    layout: Layout = Layout()
    sha256: str | None = None
    format: str = "csv"

    def __post_init__(self) -> None:
        object.__setattr__(self, "file", Path(self.file))
        if self.quantity not in QUANTITIES:
            raise MeasurementError(f"quantity: {self.quantity!r}; must be one of {', '.join(QUANTITIES)}")
        if self.sweep.direction not in DIRECTIONS:
            raise MeasurementError(
                f"sweep.direction: {self.sweep.direction!r}; must be one of {', '.join(DIRECTIONS)}"
            )
        if self.format != "csv":
            raise MeasurementError(f"format: {self.format!r}; must be 'csv'")
