"""A case: what one case file declares, checked; its keys as pydantic models, and their JSON Schema.

The tables [test] and [identify] follow from the declarations of the objects that they become. Only single
values are checked here; whatever concerns several keys at once is checked in ``loading``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

import sympy
from pydantic import Field, create_model
from pydantic.json_schema import GenerateJsonSchema

from rsgen.cases.measured_test import MEASURED
from rsgen.cases.tables import MAX_TEXT, Obeys, Quantity, Table, Text, table_of
from rsgen.common.declaration import Rule
from rsgen.data.oscillator import Model, Observation, Oscillator
from rsgen.dynamics.virtual_test import MultisineTest, SimulatedTest
from rsgen.files import MeasuredTest

Formula = Annotated[str, Obeys(str, Rule(fewest=1, most=MAX_TEXT))]


class SystemTable(Table):
    """The mass of the mode."""

    mass: Quantity | None = Field(
        default=None,
        description="Mass [kg]. Simulated: the truth, identified and compared. Measured: known beforehand; "
        "leave it out to identify it.",
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
    # both are derived below
    test: Any
    identify: Any = None
    accept: dict[str, Annotated[float, Obeys(float, Rule(above=0, at_most=10))]] = Field(
        default={}, description="Largest relative error of the refined estimate, by parameter."
    )


_SIMULATED = table_of(
    SimulatedTest,
    "SimulatedTest",
    "A virtual test: rsgen computes the steady states from [truth].",
    {"kind": (Literal["simulated"], Field())},
)
_MULTISINE = table_of(
    MultisineTest,
    "MultisineTest",
    "A virtual test with a periodic multisine: rsgen computes the periodic responses from [truth].",
    {"kind": (Literal["simulated-multisine"], Field())},
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
    "test": (_SIMULATED | _MULTISINE | MEASURED, Field(discriminator="kind")),
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


@dataclass(frozen=True, slots=True, eq=False)
class Case:
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
        ``force_keys.FORCE_KEYS``.
    printed
        "stiffness", "damping": formulas as the source prints them, in X, X0, omega and the parameters.
    units
        SI unit of each parameter and of "m"; "" where the law does not determine it.
    warnings
        Sentences about what is allowed but may be meant otherwise.
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
    test: SimulatedTest | MultisineTest | MeasuredTest
    truth: Mapping[str, float] | None
    accept: Mapping[str, float] = field(default_factory=dict)
    printed: Mapping[str, sympy.Expr] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    ranked: bool = False

    def __post_init__(self) -> None:
        for name in ("truth", "accept", "printed", "units"):
            table = getattr(self, name)
            if table is not None:
                object.__setattr__(self, name, MappingProxyType(dict(table)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the mappings as plain dicts, so that a case is loaded once and sent to a process."""
        values = [getattr(self, name) for name in self.__dataclass_fields__]
        return Case, tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)

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
        units = {name: unit for name, unit in self.units.items() if name == "m"}
        return replace(self, model=model, truth=None, printed={}, units=units)
