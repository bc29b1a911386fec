"""The case file as pydantic models: which keys there are, of which kind, and their JSON Schema.

Only shapes and ranges of single values are checked here; whatever concerns several keys at once (names that
must be known, dimensions, grids) is checked in ``building``, so that all faults come in one list.
"""

from __future__ import annotations

import re
from math import isfinite
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

__all__ = [
    "CaseDocument",
    "DemodulationTable",
    "ElementTable",
    "ForceTable",
    "FrequencyTable",
    "GridTable",
    "LayoutTable",
    "LevelTable",
    "MeasuredTable",
    "ResponseTable",
    "SimulatedTable",
    "SweepTable",
    "TimeTable",
    "case_schema",
]

MAX_TEXT = 2_000
MAX_NAME = 200
MAX_COLUMN = 10_000
MAX_FILES = 200
_SHA256 = re.compile(r"[0-9a-f]{64}\Z")


def _quantity(value: object) -> object:
    if isinstance(value, str) and 0 < len(value) <= MAX_TEXT:
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PydanticCustomError("quantity", 'a number in SI units or a text with its unit, as "5.92 kN/m"')
    if not isfinite(value):
        raise PydanticCustomError("quantity", "a finite number")
    return float(value)


def _column(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise PydanticCustomError("column", "a column number or a column name")
    if value == "" or (isinstance(value, str) and len(value) > MAX_NAME):
        raise PydanticCustomError("column", f"a name of 1 to {MAX_NAME} characters")
    if isinstance(value, int) and not 1 <= value <= MAX_COLUMN:
        raise PydanticCustomError("column", f"a column number from 1 (the first) to {MAX_COLUMN}")
    return value


def _texts(value: object) -> object:
    texts = [value] if isinstance(value, str) else value
    if not isinstance(texts, list) or not 1 <= len(texts) <= MAX_FILES:
        raise PydanticCustomError("column", f"a text, or a list of 1 to {MAX_FILES} texts")
    if not all(isinstance(text, str) and len(text) <= MAX_TEXT for text in texts):
        raise PydanticCustomError("column", f"texts of at most {MAX_TEXT} characters")
    return texts


def _hashes(value: object) -> object:
    texts = [value] if isinstance(value, str) else value
    if not isinstance(texts, list) or not 1 <= len(texts) <= MAX_FILES:
        raise PydanticCustomError("column", "a SHA-256, or a list of them")
    for text in texts:
        if not isinstance(text, str) or not _SHA256.match(text):
            raise PydanticCustomError("column", "a SHA-256 of 64 signs 0-9 a-f, or one for each file")
    return texts


Quantity = Annotated[
    float | str,
    PlainValidator(_quantity),
    WithJsonSchema({"type": ["number", "string"]}),
    Field(description='A number in SI units, or a text with its unit such as "5.92 kN/m".'),
]
Column = Annotated[
    int | str,
    PlainValidator(_column),
    WithJsonSchema({"type": ["integer", "string"]}),
    Field(
        description="A column by its number (1 is the first), by its name in the header, or by its path in "
        'the file\'s tree, such as "runs/*/freq" or "Acceleration[3]" (rsgen inspect lists them).'
    ),
]
Files = Annotated[
    list[str],
    PlainValidator(_texts),
    WithJsonSchema({"type": ["string", "array"], "items": {"type": "string"}}),
    Field(description="A relative path with / and without .. to the data, or a list of such."),
]
Hashes = Annotated[
    list[str],
    PlainValidator(_hashes),
    WithJsonSchema({"type": ["string", "array"], "items": {"type": "string"}}),
    Field(description="The SHA-256 of the file, or of each of them."),
]
Text = Annotated[str, Field(max_length=MAX_TEXT)]
Formula = Annotated[str, Field(min_length=1, max_length=MAX_TEXT)]
Scale = Annotated[
    Literal["peak", "rms"], Field(description="Whether the numbers are peak amplitudes or root mean squares.")
]
PhaseUnit = Literal["deg", "rad"]
PhaseSense = Annotated[
    Literal["lag", "lead"],
    Field(
        description="Whether a positive phase (or imaginary part) means later or earlier than the reference."
    ),
]


class _Table(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


class SystemTable(_Table):
    """The mass of the mode."""

    mass: Quantity | None = Field(
        default=None,
        description="Mass. Simulated: the truth, identified and compared. Measured: known beforehand; "
        "leave it out to identify it.",
    )


class ElementTable(_Table):
    """One spring or damper."""

    name: Text = Field(description="A plain name, unique in the case.")
    force: Formula | None = Field(
        default=None, description="The force law in x [m] and v [m/s]; every other name is a parameter."
    )
    law: Text | None = Field(
        default=None, description="Instead of force: a law of the library by its name; rsgen laws lists them."
    )
    parameters: dict[str, Text] = Field(
        default_factory=dict,
        description='With law: new names of its parameters, such as { k3 = "kn1" }.',
    )


class PrintedTable(_Table):
    """Formulas as the source prints them, misprints included; checked against what rsgen derives."""

    stiffness: Formula | None = Field(default=None, description="k(X), in X, omega and the parameters.")
    damping: Formula | None = Field(default=None, description="c(X, omega).")


class GridTable(_Table):
    """An ascending row of values: start, stop and count, or the values themselves."""

    start: Quantity | None = None
    stop: Quantity | None = None
    count: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    spacing: Literal["linear", "log"] | None = None
    values: list[Quantity] | None = None


class NoiseTable(_Table):
    """Complex Gaussian noise on force and response."""

    relative: Annotated[float, Field(ge=0, le=1)] = Field(description="Standard deviation over amplitude.")
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 1


class SimulatedTable(_Table):
    """A virtual test: rsgen computes the steady states from [truth]."""

    kind: Literal["simulated"]
    method: Literal["time", "harmonic-balance"] = "time"
    control: Literal["force", "response"] = "force"
    sweep: Literal["rest", "up", "down"] = "rest"
    level: GridTable = Field(description="Force amplitudes [N]; amplitudes X [m] under response control.")
    frequency: GridTable = Field(description="Frequencies [Hz].")
    harmonics: Annotated[int, Field(ge=1, le=64)] = 7
    accuracy: Annotated[float, Field(ge=1e-9, le=1e-2)] = Field(
        default=1e-4, description="Largest relative error of the amplitude."
    )
    noise: NoiseTable | None = None


class LayoutTable(_Table):
    """How the text of the file is laid out."""

    delimiter: Literal["auto", "whitespace", ",", ";", "\t", "|"] = "auto"
    decimal: Literal[".", ","] = "."
    comments: list[Annotated[str, Field(min_length=1, max_length=4)]] = Field(
        default=["#", "%", "//"], max_length=8
    )
    skip: Annotated[int, Field(ge=0, le=10_000)] = Field(default=0, description="Lines to pass over first.")
    encoding: Literal["auto", "utf-8", "cp1252", "latin-1", "cp1250", "cp1251", "gb18030", "shift_jis"] = (
        Field(default="auto", description="Of names and remarks; auto is UTF-8, and cp1252 where it is not.")
    )


class FrequencyTable(_Table):
    """Where the excitation frequency is."""

    column: Column
    unit: Literal["Hz", "kHz", "mHz", "rad/s", "rpm"] = "Hz"


class _ComplexTable(_Table):
    amplitude: Column | None = None
    phase: Column | None = None
    real: Column | None = None
    imaginary: Column | None = None
    complex: Column | None = Field(default=None, description="A column of complex numbers.")
    samples: Column | None = Field(default=None, description="The samples of a time history.")
    phase_unit: PhaseUnit = "deg"
    phase_sense: PhaseSense | None = None
    scale: Scale = "peak"
    factor: Quantity = Field(default=1.0, description="Every number is multiplied by it, its unit included.")


class ForceTable(_ComplexTable):
    """Where the force is; an amplitude without a phase is the reference of all phases."""

    unit: Annotated[str, Field(max_length=40)] | None = Field(
        default=None, description="Of the column; without it the unit that the file names, else N."
    )
    nominal: bool = Field(
        default=False, description="True: the force was not recorded, and the level stands for it."
    )


class ResponseTable(_ComplexTable):
    """Where the response is, and what was measured."""

    quantity: Literal["displacement", "velocity", "acceleration"]
    unit: Annotated[str, Field(max_length=40)] | None = Field(
        default=None, description="Of the column; without it the unit that the file names, else SI."
    )
    file: Files | None = Field(
        default=None, description="Where the response lies in files of its own: one for each of test.file."
    )
    per_force: bool = Field(
        default=False, description="True: response over force, as frequency response functions are."
    )
    phase_known: bool = Field(default=True, description="False: amplitudes alone were recorded.")


class TimeTable(_Table):
    """Where the time of a time history is: a column of instants, or the sampling rate."""

    column: Column | None = None
    unit: Literal["s", "ms", "us"] = "s"
    rate: Quantity | None = Field(default=None, description='The sampling rate, such as "400 Hz".')
    rate_column: Column | None = Field(default=None, description="Where the file tells the rate [Hz].")
    start: Quantity | None = Field(default=None, description="Leave out what comes before [s].")
    stop: Quantity | None = Field(default=None, description="Leave out what comes after [s].")


class DemodulationTable(_Table):
    """How time histories become amplitudes; rsgen chooses what is not said."""

    band: list[Quantity] | None = Field(
        default=None, min_length=2, max_length=2, description="Lowest and highest frequency [Hz]."
    )
    law: Literal["linear", "logarithmic"] | None = Field(default=None, description="Of a swept sine.")
    bandwidth: Quantity | None = Field(default=None, description="Of a swept sine's demodulation [Hz].")
    harmonics: Annotated[int, Field(ge=1, le=64)] | None = None


class SweepTable(_Table):
    """How points were reached: one direction for all, a column, or recognised from the order."""

    direction: Literal["recognise", "rest", "up", "down"] | None = None
    column: Column | None = None
    up: Column | None = Field(default=None, description="What the column says for an upward sweep.")
    down: Column | None = Field(default=None, description="What the column says for a downward sweep.")


class LevelTable(_Table):
    """The nominal level of each point: values, a column, from the file's name, or groups of like forces."""

    value: Quantity | None = None
    values: list[Quantity] | None = Field(
        default=None,
        min_length=1,
        max_length=MAX_FILES,
        description="One for each file, or for each entry that a * means.",
    )
    name: Text | None = Field(
        default=None, description='The form of the files\' names, such as "sweep_{level}N.mat".'
    )
    column: Column | None = None
    unit: Annotated[str, Field(max_length=40)] = "N"
    scale: Scale = "peak"
    factor: Quantity = 1.0
    spread: Annotated[float, Field(gt=0, lt=1)] | None = Field(
        default=None, description="Points whose force differs by less than this fraction share a level."
    )


class MeasuredTable(_Table):
    """A real test: files beside the case, or in the folder that RSGEN_DATA names."""

    kind: Literal["measured"]
    file: Files
    sha256: Hashes | None = None
    format: Literal["auto", "csv", "mat", "hdf5", "npy", "npz", "uff"] = Field(
        default="auto", description="auto: recognised by how the file begins. csv: columns of text."
    )
    excitation: Literal["steady", "swept-sine", "stepped-sine", "ring-down"] = Field(
        default="steady", description="steady: a table of amplitudes. The others: time histories."
    )
    layout: LayoutTable = LayoutTable()
    time: TimeTable | None = None
    demodulation: DemodulationTable = DemodulationTable()
    frequency: FrequencyTable | None = None
    force: ForceTable | None = None
    response: ResponseTable
    sweep: SweepTable = SweepTable()
    level: LevelTable = LevelTable()


class IdentifyTable(_Table):
    """What identification is given besides the laws."""

    hold_out: list[Quantity] = Field(
        default=[], max_length=1000, description="Levels kept from identification and predicted instead."
    )
    background: Literal["none", "phase", "constant", "residuals", "neighbour"] = Field(
        default="none",
        description="What the sensor sees besides the mode, fitted with it: a phase error; and a response "
        "proportional to the force; and its change over the band, as modes below and above leave it; and one "
        "linear mode near the band.",
    )
    band: list[Quantity] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description='Lowest and highest frequency used, such as ["40 Hz", "45 Hz"]; all without it.',
    )
    calibrated: bool = Field(
        default=True,
        description="False: force or response have no known scale, so parameters are per unit of the drive.",
    )


class CaseDocument(_Table):
    """A case of rsgen: a structure, a test, what to identify and how well."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this format.")
    name: Text = Field(description="The folder of the report: letters, digits, - and _.")
    title: Text
    source: Text = ""
    system: SystemTable = SystemTable()
    model: Literal["given", "rank"] = Field(
        default="given",
        description="given: identify the elements. rank: compare the laws of the library and identify the "
        "best; the elements are one candidate more, and a measured case may leave them out.",
    )
    element: list[ElementTable] | None = Field(default=None, min_length=1, max_length=50)
    printed: PrintedTable | None = None
    truth: dict[str, Quantity] | None = Field(
        default=None, description="One value for each parameter; simulated cases only."
    )
    test: SimulatedTable | MeasuredTable = Field(discriminator="kind")
    identify: IdentifyTable = IdentifyTable()
    accept: dict[str, Annotated[float, Field(gt=0, le=10)]] = Field(
        default={}, description="Largest relative error of the refined estimate, by parameter."
    )


def case_schema() -> dict[str, Any]:
    """Give the JSON Schema of a case file, for editors that complete and check TOML.

    Examples
    --------
    >>> case_schema()["title"]
    'A case of rsgen'
    """
    schema = CaseDocument.model_json_schema(by_alias=True)
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "A case of rsgen"
    return schema
