"""How a finding becomes a sentence: a text or a function a code, numbers printed as in a book."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Self

from rsgen.common.finding import Finding, Quantity
from rsgen.formula.units.quantities import number_text, quantity_text

__all__ = ["CODES", "NEXT_STEPS", "full_sentence", "next_step", "say_plainly", "says", "sentence"]

Say = Callable[[Finding], str]

CODES: dict[str, Say] = {}
"""The function that says a finding, by the code of the finding."""

NEXT_STEPS: dict[str, str] = {}
"""What to do about a finding that casts doubt on a result, by its code: a full sentence, with the fields of
``say_plainly`` in braces. Every code that may have the severity "doubt" or "error" has one."""


class _Number(float):
    """A number that formats as a book prints it: a power of ten in place of 1e-8, a space before per cent.

    Two kinds of its own: ``.3q`` is the number with its unit, ``.2p`` a ratio in per cent.
    """

    unit: str

    def __new__(cls, value: float, unit: str = "") -> Self:
        number = super().__new__(cls, value)
        number.unit = unit
        return number

    def __format__(self, form: str) -> str:
        value, digits = float(self), int(form[1:-1] or 6) if form[:1] == "." else 6
        match form[-1:]:
            case "g":
                return number_text(value, digits)
            case "p":
                return f"{number_text(100 * value, digits)} %"
            case "q":
                return quantity_text(value, self.unit, digits)
        text = format(value, form)
        return f"{text[:-1]} %" if form.endswith("%") else text


@dataclass(frozen=True, slots=True)
class _Fields:
    """What a text names in braces: "parameter", and the names and numbers of its finding."""

    finding: Finding

    def __getitem__(self, name: str) -> str | _Number:
        if name == "parameter":
            return self.finding.parameter
        names = self.finding.names
        return names[name] if name in names else _Number(*self.finding.numbers[name])


def says(code: str) -> Callable[[Say], Say]:
    """Register the sentence of a code: a function of the finding, whose numbers format as in a book.

    A sentence begins in lower case and has no full stop, so that it can be part of a line.
    """

    def register(function: Say) -> Say:
        CODES[code] = function
        return function

    return register


def say_plainly(texts: Mapping[str, str]) -> None:
    """Register sentences without logic: format strings by code, with the fields of ``_Fields``."""
    for code, text in texts.items():
        CODES[code] = partial(_fill, text)


def _fill(text: str, finding: Finding) -> str:
    return text.format_map(_Fields(finding))


def next_step(finding: Finding) -> str:
    """Say in one sentence what to do about a finding; "" where nobody wrote it down."""
    return NEXT_STEPS.get(finding.code, "").format_map(_Fields(finding))


def sentence(finding: Finding) -> str:
    """Say a finding in one sentence; a code without a sentence is shown as data."""
    say = CODES.get(finding.code)
    if say is None:
        return repr(finding)
    numbers = {name: Quantity(_Number(*number), number.unit) for name, number in finding.numbers.items()}
    return say(Finding(finding.code, finding.severity, finding.parameter, numbers, finding.names))


def full_sentence(finding: Finding) -> str:
    """Say a finding with capital and full stop; names, files and symbols such as c(X) keep their spelling."""
    text = sentence(finding)
    if text[1:2] != "(" and not any(
        name and text.startswith(name) for name in (finding.parameter, *finding.names.values())
    ):
        text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."
