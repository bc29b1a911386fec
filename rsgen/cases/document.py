"""The case file as pydantic models: which keys there are, of which kind, and their JSON Schema.

The tables [test] and [identify] follow from the declarations of the objects that they become. Only single
values are checked here; whatever concerns several keys at once is checked in ``building``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, create_model
from pydantic.json_schema import GenerateJsonSchema

from rsgen.cases.measured_test import MEASURED
from rsgen.cases.tables import MAX_TEXT, Obeys, Quantity, Table, Text, table_of
from rsgen.common.declaration import Rule
from rsgen.data.observation import Observation
from rsgen.dynamics.simulation import MultisineTest, SimulatedTest

__all__ = ["CaseDocument", "Document", "ElementTable", "case_schema"]

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
        description="x of this element is a sum of channels of the test, such as 'payload - wing'; without "
        "it the response.",
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
_DERIVED: dict[str, Any] = {
    "test": (_SIMULATED | _MULTISINE | MEASURED, Field(discriminator="kind")),
    "identify": (table_of(Observation, "Observation") | None, None),
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
    """Give the JSON Schema of a case file, for editors that complete and check TOML.

    Examples
    --------
    >>> case_schema()["title"]
    'A case of rsgen'
    """
    schema = CaseDocument.model_json_schema(by_alias=True, schema_generator=_Schema)
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "A case of rsgen"
    return schema
