"""How a finding becomes a sentence: one function a code, numbers printed as in a book."""

from __future__ import annotations

from collections.abc import Callable

from rsgen.figures.scale import number_text, quantity_text
from rsgen.finding import Finding, Quantity

__all__ = ["CODES", "full_sentence", "number", "quantity", "says", "sentence"]

Say = Callable[[Finding], str]

CODES: dict[str, Say] = {}
"""The function that says a finding, by the code of the finding."""


class _Number(float):
    """A number that formats as a book prints it: a power of ten in place of 1e-8, a space before per cent."""

    def __format__(self, form: str) -> str:
        if form.endswith("g"):
            return number_text(float(self), int(form[1:-1] or 6) if form[:1] == "." else 6)
        text = format(float(self), form)
        return f"{text[:-1]} %" if form.endswith("%") else text


def says(code: str) -> Callable[[Say], Say]:
    """Register the sentence of a code: a function of the finding, whose numbers format as in a book.

    A sentence begins in lower case and has no full stop, so that it can be part of a line.
    """

    def register(function: Say) -> Say:
        CODES[code] = function
        return function

    return register


def sentence(finding: Finding) -> str:
    """Say a finding in one sentence; a code without a sentence is shown as data."""
    say = CODES.get(finding.code)
    if say is None:
        return repr(finding)
    numbers = {name: Quantity(_Number(value), unit) for name, (value, unit) in finding.numbers.items()}
    return say(Finding(finding.code, finding.severity, finding.parameter, numbers, finding.names))


def full_sentence(finding: Finding) -> str:
    """Say a finding with a capital and a full stop; names of parameters and files keep their spelling."""
    text = sentence(finding)
    if not any(name and text.startswith(name) for name in (finding.parameter, *finding.names.values())):
        text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."


def number(value: float, digits: int = 3) -> str:
    """Print a number with few digits."""
    return number_text(value, digits)


def quantity(found: Finding, name: str, digits: int = 3) -> str:
    """Print a number of a finding with its unit."""
    value, unit = found.numbers[name]
    return quantity_text(value, unit, digits)
