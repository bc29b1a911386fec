"""A case: what one case file declares, checked; its keys as pydantic models, and their JSON Schema.

The tables [test] and [identify] follow from the declarations of the objects that they become. Only single
values are checked here; whatever concerns several keys at once is checked in ``loading``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, Union, get_args

import sympy
from pydantic import Field, create_model
from pydantic.json_schema import GenerateJsonSchema

from rsgen.cases.tables import Maker, Obeys, Quantity, Table, Text, table_of
from rsgen.common.declaration import Rule
from rsgen.common.errors import MeasurementError, RsgenError, one_line, shown_path
from rsgen.common.text_table import Brief
from rsgen.data.oscillator import Model, Observation, Oscillator
from rsgen.data.record_set import BASE_UNITS
from rsgen.describing.derivation import derive
from rsgen.dynamics.kernel_source import generate
from rsgen.dynamics.transients import DecayTest, SweepTest
from rsgen.dynamics.virtual_test import MultisineTest, SimulatedTest, VirtualTest, free_mean_fault
from rsgen.files.plan import LABEL, Excitation, HistoryRule, MeasuredTest
from rsgen.files.signals import combination
from rsgen.formula.bounds import MAX_CHARACTERS
from rsgen.formula.names import Structural

Formula = Annotated[str, Obeys(str, Rule(fewest=1, most=MAX_CHARACTERS))]


class SystemTable(Table):
    """The mass of the mode."""

    mass: Quantity | None = Field(
        default=None,
        description="Mass [kg]. Simulated: the truth, identified and compared. Measured: known beforehand; "
        "leave it out to identify it.",
    )
    mass_error: Quantity | None = Field(
        default=None,
        description="Standard error of a mass that was weighed [kg], half of a ± that holds for 95 %: the "
        "mass is then identified, from that, too. Measured cases only.",
    )


class ElementTable(Table):
    """One spring or damper."""

    name: Text = Field(description="A plain name, unique in the case.")
    force: Formula | None = Field(
        default=None,
        description="The force law in x [m] and v [m/s], states by their names; every other name is a "
        "parameter.",
    )
    memory: dict[str, Formula] = Field(
        default_factory=dict,
        description="With force: for each state z of it the right side of z' = g(x, v, z), as in "
        '{ z = "alpha*v - beta*abs(v)*z" }; z is 0 at the start.',
    )
    law: Text | None = Field(
        default=None, description="Instead of force: a law of the library by its name; rsgen laws lists them."
    )
    across: Text | None = Field(
        default=None,
        description="x of this element is a sum of channels of the test, such as 'payload - wing', or "
        "one channel that measures it; without it the response.",
    )
    parameters: dict[str, Text] = Field(
        default_factory=dict,
        description='With law: new names of its parameters and states, such as { k3 = "kn1" }.',
    )


class PrintedTable(Table):
    """Formulas as the source prints them, misprints included; checked against what rsgen derives."""

    stiffness: Formula | None = Field(default=None, description="k(X), in X, omega and the parameters.")
    damping: Formula | None = Field(default=None, description="c(X, omega).")


class Document(Table):
    """A case of rsgen: a structure, a test, what to identify and how well."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this format.")
    name: Text = Field(
        description="The folder of the report: letters, digits, -, _ and single dots; required."
    )
    title: Text = Field(description="Heading of the report; required.")
    source: Text = Field(default="", description="Where law or data come from.")
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
    # both are derived below
    test: Any
    identify: Any = None
    accept: dict[str, Annotated[float, Obeys(float, Rule(above=0, at_most=10))]] = Field(
        default={}, description="Largest relative error of the refined estimate, by parameter."
    )


VIRTUAL_TESTS: dict[str, tuple[type[VirtualTest], str]] = {
    "simulated": (SimulatedTest, "A virtual test: rsgen computes the steady states from [truth]."),
    "simulated-multisine": (
        MultisineTest,
        "A virtual test with a periodic multisine: rsgen computes the periodic responses from [truth].",
    ),
    "simulated-sweep": (
        SweepTest,
        "A virtual swept sine: rsgen computes the records from [truth] and reads them.",
    ),
    "simulated-decay": (
        DecayTest,
        "Virtual free decays: rsgen computes the records from [truth] and reads them.",
    ),
}
"""Each kind of virtual test, and what its table is for."""
_SIMULATED = [
    table_of(test, test.__name__, doc, {"kind": (Literal[kind], Field())})
    for kind, (test, doc) in VIRTUAL_TESTS.items()
]
_MEASURED = table_of(
    MeasuredTest,
    "MeasuredTest",
    "A real test: files in the folder of the case, or in the folder that RSGEN_DATA names.",
    {
        "kind": (Literal["measured"], Field()),
        "excitation": (
            Literal[("steady", *get_args(Excitation))],
            Field("steady", description="steady: a table of amplitudes. The others: time histories."),
        ),
    },
)
_FIXED: tuple[Any, Any] = (
    dict[str, Quantity],
    Field(
        default_factory=dict,
        description='Values of parameters that are known and not identified, such as { b = "3 mm" }; m is '
        "the mass.",
    ),
)
_DERIVED: dict[str, Any] = {
    "test": (Union[(*_SIMULATED, _MEASURED)], Field(discriminator="kind")),
    "identify": (table_of(Observation, "Observation", extras={"fixed": _FIXED}) | None, None),
}
CaseDocument = create_model("CaseDocument", __base__=Document, __doc__=Document.__doc__, **_DERIVED)


class _Schema(GenerateJsonSchema):
    """Without titles that repeat the key, and without defaults that mean "not given"."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def default_schema(self, schema: Any) -> Any:
        made = super().default_schema(schema)
        if made.get("default", 0) is None:
            del made["default"]
        return made


def case_schema() -> dict[str, Any]:
    """Return the JSON Schema of a case file, for editors that complete and check TOML.

    Examples
    --------
    >>> case_schema()["title"]
    'A case of rsgen'
    """
    schema = CaseDocument.model_json_schema(by_alias=True, schema_generator=_Schema)
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "A case of rsgen"
    return schema


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Case(Brief):
    """A structure, a test, what to identify and how well: one case file, checked.

    Parameters
    ----------
    path
        The case file.
    name, title, source
        Folder of the report, heading, origin; printable text, never markup.
    text, sha256
        The file's text and the SHA-256 of its bytes as UTF-8.
    oscillator
        The structure with its true values; None for a measured case.
    model
        The laws without values and the observation, all that identification gets.
    test
        How the response surface comes about.
    truth
        True values in SI by parameter, "m" [kg] included; None for a measured case.
    accept
        Largest relative error of the refined estimate, by parameter, "m", or a key of
        ``law.memory.FORCE_KEYS``.
    printed
        "stiffness", "damping": formulas as the source prints them, in X, X0, omega and the parameters.
    ranked
        Whether the laws of the library compete with the case's own.
    """

    path: Path
    name: str
    title: str
    source: str
    text: str
    sha256: str
    oscillator: Oscillator | None
    model: Model
    test: VirtualTest | MeasuredTest
    truth: Mapping[str, float] | None
    accept: Mapping[str, float] = field(default_factory=dict)
    printed: Mapping[str, sympy.Expr] = field(default_factory=dict)
    ranked: bool = False

    def __post_init__(self) -> None:
        for name in ("truth", "accept", "printed"):
            table = getattr(self, name)
            if table is not None:
                object.__setattr__(self, name, MappingProxyType(dict(table)))

    @property
    def observation(self) -> Observation:
        """How the structure was observed."""
        return self.model.observation

    @property
    def folder(self) -> Path:
        """The folder of the case file."""
        return self.path.parent

    def with_model(self, model: Model) -> Case:
        """Return the case the law that a ranking found; what concerned another law is left out.

        Parameters
        ----------
        model
            Of the best candidate; the case's own one leaves the case as it is.
        """
        if model.elements == self.model.elements:
            return self
        return replace(self, model=model, truth=None, printed={})


# ----------------------------------------------------------------------------
# From the table [test] of a measured case to the plan for reading its files.

_OF_PHASE = {
    True: "response.phase: is missing; amplitude and phase, or real and imaginary, are needed "
    "(or phase_known = false)",
    False: "response.phase_known: is false, but there is a phase; leave one out",
}
"""Contradiction between files and the key ``phase``."""

_AS_LABEL = (
    '; for levels by names, as the volts of a drive: unit = "label" under [test.level], and values, or '
    'for files and sheets name = "{level} V"'
)
_DECAYS_BY_NUMBER = '; name decays by numbers: values and unit = "label" under [test.level]'


def make_measured(
    table: Any, maker: Maker, mass: float | None, calibrated: bool, across: str | None = None
) -> MeasuredTest:
    """Make the plan for reading measured files.

    Parameters
    ----------
    table
        The [test] table.
    maker
        Gets the faults.
    mass
        The moving mass [kg], if the case has it.
    calibrated
        False where force or response have no known scale: their units may then be any.
    across
        The sum of channels that elements act across, if any do.
    """
    if not calibrated:
        maker.units = {"N": None}
    elif table.control in ("response", "continuation"):
        maker.units = {"N": "m"}
    elif table.base is not None:
        maker.units = {"N": BASE_UNITS[_base_quantity(table)]}
    if getattr(table.level, "unit", None) == LABEL:
        maker.units["label"] = ""
    else:
        maker.label_hint = _DECAYS_BY_NUMBER if table.excitation == "ring-down" else _AS_LABEL
    timed = table.excitation != "steady"
    known: dict[str, Any] = {"calibrated": calibrated, "history": None, "across": across}
    if timed:
        known["history"] = maker.make(HistoryRule, table, "test", mass=mass)
    if table.force is None:
        known["force"] = None
    test = maker.make(MeasuredTest, table, "test", **known)
    maker.faults += [f"test.{fault}" for fault in _signal_faults(table, test)]
    if timed:
        faulty = any(fault.startswith("system.mass:") for fault in maker.faults)
        if table.excitation == "ring-down" and mass is None and not faulty:
            maker.faults.append(
                "system.mass: is missing; a free decay determines stiffness and damping per mass only"
            )
    elif table.time is not None:
        maker.faults.append("test.time: belongs to time histories; leave it out, or set test.excitation")
    return test


def _base_quantity(table: Any) -> str:
    """Measured quantity of the base; "" where the case names none."""
    if table.base.quantity is not None:
        return str(table.base.quantity)
    try:
        names = combination(table.base.channels or "")
    except MeasurementError:
        # said where the test is made
        return ""
    known = table.channels or {}
    quantities = [str(known[name].quantity) for name in names if name in known]
    return next((quantity for quantity in quantities if quantity in BASE_UNITS), "")


def _signal_faults(table: Any, test: MeasuredTest) -> Iterator[str]:
    """Find what a case file must say of force and response, where an object has a default."""
    force, response = table.force, table.response
    if force is None and table.base is None and table.excitation != "ring-down":
        yield "force: is missing; where it is, or nominal = true, is needed"
    named = {f"channels.{name}": channel for name, channel in (test.channels or {}).items()}
    for place, channel in (test.made | named).items() if test.history is None else ():
        turned = (channel.phase, channel.imaginary, channel.complex) != (None, None, None)
        if turned and channel.phase_sense is None:
            yield (
                f"{place}.phase_sense: is missing; 'lag' (positive means later) or 'lead' (earlier) is needed"
            )
    if response is None or response.amplitude is None or test.history is not None:
        return
    if (response.phase is None) == response.phase_known:
        yield _OF_PHASE[response.phase_known]


# ----------------------------------------------------------------------------
# A law tried before a run: derived, and written as a kernel.


def law_faults(case: Case) -> list[str]:
    """Say what would keep the laws of a case from being used; nothing where they can be.

    Reading a case checks texts and units, which is quick; this derives and compiles on trial, which takes
    a moment for each law that is new.

    Returns
    -------
    list of str
        One sentence a fault, ``file: element.N.force: what; what is allowed``.
    """
    faults = []
    for number, element in enumerate(case.model.elements, start=1):
        place = f"element.{number}"
        try:
            derive(element)
            if case.test.in_time or not element.force.has(Structural):
                generate(element.force)
        except RsgenError as fault:
            faults.append(f"{place}.force: {one_line(fault)}")
    if not faults and case.oscillator is not None:
        drifts = free_mean_fault(case.oscillator, case.test)
        faults += [f"element: {drifts}"] if drifts else []
    return [f"{shown_path(case.path)}: {fault}" for fault in faults]
