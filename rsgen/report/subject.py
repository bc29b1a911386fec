"""What a report is about: the heading, the law, the truth; from a case file, or from the result alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import sympy

from rsgen.analysis.comparison import Comparison, Row
from rsgen.cases import Case
from rsgen.identification.results import Estimate, Identification
from rsgen.law.element import Element
from rsgen.law.memory import with_equations

__all__ = ["Subject"]

R = TypeVar("R", Identification, Comparison)
E = TypeVar("E", Estimate, Row)


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """The heading of a report and what is known about the structure.

    Parameters
    ----------
    name, title, source
        As in ``Case``; printable text, never markup.
    elements
        The springs and dampers that were identified.
    truth, printed, units, warnings
        As in ``Case``, as far as they concern these elements.
    case
        Where all this comes from; None where a report is made without a case file.
    """

    name: str
    title: str
    source: str
    elements: tuple[Element, ...]
    truth: Mapping[str, float] | None = None
    printed: Mapping[str, sympy.Expr] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    case: Case | None = None

    @classmethod
    def of_case(cls, case: Case, identification: Identification) -> Subject:
        """Take over a case; what concerns another law than the identified one is left out."""
        case = case.with_model(identification.model)
        heading = (case.name, case.title or case.name, case.source, case.model.elements)
        return cls(*heading, case.truth, case.printed, case.units, case.warnings, case)

    @classmethod
    def of_result(cls, identification: Identification, name: str, title: str, source: str) -> Subject:
        """Take the heading as it is given; without a title the law is the title."""
        model = identification.model
        title = title or f"n(x, v) = {with_equations(model.force)}"
        return cls(name, title, source, model.elements)

    def with_units(self, result: R) -> R:
        """Give every estimate of a result the unit that the case knows and the law does not determine."""

        def known(entry: E) -> E:
            return entry and replace(entry, unit=entry.unit or self.units.get(entry.name, ""))

        kinds = ("paper", "first_order", "refined")
        if isinstance(result, Identification):
            changed: Any = {kind: tuple(map(known, getattr(result, kind))) for kind in kinds}
            return replace(result, **changed)
        rows = (
            replace(known(row), **{kind: known(getattr(row, kind)) for kind in kinds}) for row in result.rows
        )
        return replace(result, rows=tuple(rows))
