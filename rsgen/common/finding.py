"""A fact about a result, as data: what was found, about which parameter, with numbers and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

__all__ = ["Finding", "Quantity", "Severity", "quantities", "severity_of"]

Severity = Literal["info", "warning", "doubt", "error"]


class Quantity(NamedTuple):
    """A number with its SI unit; "" is the unit of a count or a ratio."""

    value: float
    unit: str = ""


def quantities(**numbers: float | Quantity) -> dict[str, Quantity]:
    """Name the numbers of a finding; bare ones are counts or ratios."""
    return {
        name: number if isinstance(number, Quantity) else Quantity(float(number))
        for name, number in numbers.items()
    }


def severity_of(size: float, doubt: float, error: float) -> Severity:
    """Give the severity of a size by two limits."""
    return "error" if size > error else "doubt" if size > doubt else "warning"


@dataclass(frozen=True, slots=True)
class Finding:
    """A fact that a reader of a result should know. Sentences are made from it in ``rsgen.report.wording``.

    Parameters
    ----------
    code
        What was found, lower case, words joined by hyphens: "points-set-aside".
    severity
        "info": good to know; "warning": some numbers are less certain than they look; "doubt": the result may
        be wrong, somebody has to look first; "error": the result is wrong or means nothing. The verdict on a
        result follows from the severities alone (``rsgen.common.verdict``).
    parameter
        The parameter concerned, "" where the finding concerns the whole result.
    numbers
        The numbers of the finding by name; a bare float or integer has no unit.
    names
        Texts that are data (other parameters, a channel, an option) by name.

    Examples
    --------
    >>> Finding("points-set-aside", "warning", numbers={"aside": 3, "points": 120})
    points-set-aside (warning): aside = 3, points = 120
    """

    code: str
    severity: Severity
    parameter: str = ""
    numbers: Mapping[str, Quantity] = field(default_factory=dict, hash=False)
    names: Mapping[str, str] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "numbers", MappingProxyType(quantities(**self.numbers)))
        object.__setattr__(self, "names", MappingProxyType(dict(self.names)))

    def __getitem__(self, name: str) -> float:
        """Value of the number ``name``."""
        return self.numbers[name].value

    def __repr__(self) -> str:
        """Code, severity and data, without a sentence."""
        about = f" {self.parameter}" if self.parameter else ""
        data = [f"{name} = {value:g} {unit}".rstrip() for name, (value, unit) in self.numbers.items()] + [
            f"{name} = {text}" for name, text in self.names.items()
        ]
        return f"{self.code}{about} ({self.severity}): {', '.join(data)}".removesuffix(": ")

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the mappings as plain dicts, so that processes can exchange findings."""
        return Finding, (self.code, self.severity, self.parameter, dict(self.numbers), dict(self.names))

    def to_dict(self) -> dict[str, Any]:
        """Give the finding as JSON takes it."""
        return {
            "code": self.code,
            "severity": self.severity,
            "parameter": self.parameter,
            "numbers": {name: {"value": q.value, "unit": q.unit} for name, q in self.numbers.items()},
            "names": dict(self.names),
        }

    @classmethod
    def note(cls, text: str) -> Finding:
        """Make a finding of a text that someone else wrote, such as a note of an older file."""
        return cls("note", "info", names={"text": text})

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Finding:
        """Make the finding that ``to_dict`` gave."""
        numbers = {name: Quantity(float(q["value"]), str(q["unit"])) for name, q in data["numbers"].items()}
        names = {str(name): str(text) for name, text in data["names"].items()}
        return cls(data["code"], data["severity"], data["parameter"], numbers, names)
