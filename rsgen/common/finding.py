"""A fact about a result, as data: what was found, about which parameter, with numbers and units."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, TypedDict

Severity = Literal["info", "warning", "doubt", "error"]


class Quantity(NamedTuple):
    """A number with its SI unit; "" is the unit of a count or a ratio."""

    value: float
    unit: str = ""


def quantities(unit: str = "", /, **numbers: float | Quantity) -> dict[str, Quantity]:
    """Name the numbers of a finding, all in a unit; without one bare numbers are counts or ratios."""
    return {k: n if isinstance(n, Quantity) else Quantity(float(n), unit) for k, n in numbers.items()}


def bounded(unit: str, name: str, value: float, ends: tuple[float, float]) -> dict[str, Quantity]:
    """Name a number of a finding and, where it has an error, the ends of its interval, all in a unit."""
    low, high = ends
    more = {f"{name}_low": low, f"{name}_high": high} if low < high else {}
    return quantities(unit, **{name: value}, **more)


def severity_of(size: float, doubt: float, error: float) -> Severity:
    """Return the severity of a size by two limits."""
    return "error" if size > error else "doubt" if size > doubt else "warning"


@dataclass(frozen=True, slots=True)
class Finding:
    """A fact that a reader of a result should know. Sentences are made from it in ``rsgen.report.sentences``.

    Parameters
    ----------
    code
        What was found, lower case, words joined by hyphens: "points-excluded".
    severity
        "info": good to know; "warning": some numbers are less certain than they look; "doubt": the result may
        be wrong, look at them first; "error": the result is wrong or means nothing. The verdict on a
        result follows from the severities alone (``rsgen.common.finding``).
    parameter
        The parameter concerned, "" where the finding concerns the whole result.
    numbers
        The numbers of the finding by name; a bare float or integer has no unit.
    names
        Texts that are data (other parameters, a channel, an option) by name.

    Examples
    --------
    >>> Finding("points-excluded", "info", numbers={"excluded": 3, "points": 120})
    points-excluded (info): excluded = 3, points = 120
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
        data = [f"{name} = {value:g} {unit}".rstrip() for name, (value, unit) in self.numbers.items()]
        data += [f"{name} = {text}" for name, text in self.names.items()]
        return f"{self.code}{about} ({self.severity}): {', '.join(data)}".removesuffix(": ")

    def __str__(self) -> str:
        """Severity and sentence; the layer above makes it, and is loaded when one is printed."""
        severity = "note" if self.severity == "info" else self.severity
        return f"{severity}: {import_module('rsgen.report.sentences').sentence(self)}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the mappings as plain dicts, so that processes can exchange findings."""
        return Finding, (self.code, self.severity, self.parameter, dict(self.numbers), dict(self.names))

    def to_dict(self) -> dict[str, Any]:
        """Return the finding as JSON takes it."""
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
        """Make the finding that ``to_dict`` gave, by its code of today."""
        numbers = {name: Quantity(float(q["value"]), str(q["unit"])) for name, q in data["numbers"].items()}
        names = {str(name): str(text) for name, text in data["names"].items()}
        now = earlier_codes().get(data["code"], {"code": data["code"]})
        renamed = now.get("renamed", {})
        numbers = {renamed.get(name, name): number for name, number in numbers.items()}
        names = now.get("added", {}) | {renamed.get(name, name): text for name, text in names.items()}
        return cls(now["code"], data["severity"], data["parameter"], numbers, names)


@cache
def earlier_codes() -> dict[str, dict[str, Any]]:
    """Return what says today what the codes of schema 1 of result.json said: code, added and renamed data."""
    return tomllib.loads(Path(__file__).with_name("earlier_codes.toml").read_text(encoding="utf-8"))


# ----------------------------------------------------------------------------
# The verdict on a result, from the severities of its findings and the comparison with the truth.

State = Literal["accepted", "missed", "identified", "doubtful", "rejected", "not judged"]

STATES: tuple[State, ...] = ("accepted", "identified", "missed", "doubtful", "rejected")
"""From the best to the worst; in a result the worst that holds is its state. An alternative is not judged."""

USABLE: tuple[State, ...] = ("accepted", "identified")
"""States in which a program may go on with the numbers before anybody has looked."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on a result.

    Parameters
    ----------
    state
        "rejected": a finding says that the result is wrong or means nothing; "doubtful": a finding has to be
        looked into first; "missed": an estimate is outside tolerance; "accepted": all judged estimates are
        within tolerance; "identified": nothing speaks against the result, and nothing was judged.
    decided_by
        The findings that decided, in the order in which to look at them: the cause before what may follow
        from it. Empty unless the state is "rejected" or "doubtful".
    summary
        What was judged, or else what was identified: the numbers of a headline; None where there are none.
    """

    state: State
    decided_by: tuple[Finding, ...] = ()
    summary: Finding | None = None

    @property
    def usable(self) -> bool:
        """True where a program may go on with the numbers before anybody has looked."""
        return self.state in USABLE

    def __str__(self) -> str:
        """Return the state with the codes that decided."""
        codes = ", ".join(dict.fromkeys(finding.code for finding in self.decided_by))
        return f"{self.state} ({codes})" if codes else self.state


def reach_verdict(
    findings: Iterable[Finding], within_tolerance: bool | None = None, summary: Finding | None = None
) -> Verdict:
    """Reach the verdict on a result.

    Parameters
    ----------
    findings
        All of the result: about the test, the fit, its parameters, and the levels held out.
    within_tolerance
        Whether all judged estimates are; None where nothing was judged.
    summary
        As in ``Verdict``.

    Examples
    --------
    >>> reach_verdict([Finding("law-does-not-fit", "error")], within_tolerance=True).state
    'rejected'
    >>> reach_verdict([Finding("points-excluded", "warning")], within_tolerance=True).state
    'accepted'
    """
    decided = [finding for finding in findings if finding.severity in ("error", "doubt")]
    if decided:
        state: State = "rejected" if any(finding.severity == "error" for finding in decided) else "doubtful"
        return Verdict(state, tuple(import_module("rsgen.report.sentences").in_order(decided)), summary)
    if within_tolerance is None:
        return Verdict("identified", summary=summary)
    return Verdict("accepted" if within_tolerance else "missed", summary=summary)


class StatedVerdict(TypedDict):
    """A verdict in words: the entry "verdict" of a result.json.

    ``state`` is one of ``STATES``; ``headline`` says it in a line; ``decided_by`` are the
    findings that decided, as objects, in the order in which to look at them; ``sentences`` and ``next_steps``
    have one text for each of them: what it is, and what to do about it ("" where nothing is known).
    """

    state: State
    headline: str
    decided_by: list[dict[str, Any]]
    sentences: list[str]
    next_steps: list[str]


MISREADINGS = frozenset(
    {
        "levels-swapped",
        "levels-disagree",
        "not-passive",
        "another-quantity",
        "base-misread",
        "channels-delayed",
        "unit-contradicts-title",
    }
)
"""Codes of a signal or level that was read as another one; further findings may follow from it."""


def _looked_at_first(stated: StatedVerdict) -> int:
    """Count the reasons up to the last one that was misread; all where none was."""
    codes = [decided["code"] for decided in stated["decided_by"]]
    return max((place for place, code in enumerate(codes, 1) if code in MISREADINGS), default=len(codes))


def reasons_of(stated: StatedVerdict) -> list[str]:
    """Return what decided; of what may follow from a misreading the number alone."""
    first = _looked_at_first(stated)
    rest = len(stated["sentences"]) - first
    more = f"What else is found may follow from that: {rest} finding{'s' * (rest != 1)}."
    return stated["sentences"][:first] + [more] * bool(rest)


def verdict_lines(stated: StatedVerdict) -> list[str]:
    """Return the headline and, indented, what decided."""
    return [stated["headline"], *(f"  because: {reason}" for reason in reasons_of(stated))]


def printed_findings(verdict: Verdict, findings: Iterable[Finding]) -> list[str]:
    """Return the lines of ``print(found)``: what decided, as in ``explain``, a step, then the rest."""
    said = import_module("rsgen.report.sentences")
    stated, decided = said.state_verdict(verdict), verdict.decided_by
    first = _looked_at_first(stated)
    others = sorted((one for one in findings if one not in decided), key=lambda one: one.severity == "info")
    steps = [f"next: {step}" for step in steps_once(stated)[:1]]
    return [*map(str, decided[:first]), *reasons_of(stated)[first:], *steps, *map(str, others)]


def steps_once(stated: StatedVerdict) -> list[str]:
    """Return what to do next, each step once: several findings may ask for the same; a misreading first."""
    return [step for step in dict.fromkeys(stated["next_steps"][: _looked_at_first(stated)]) if step]


def next_lines(stated: StatedVerdict) -> list[str]:
    """Return what to do next, indented."""
    return [f"  next: {step}" for step in steps_once(stated)]
