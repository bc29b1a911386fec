"""Laws of the sentences: every finding that is made anywhere has one, and each can be said."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import rsgen
from rsgen.finding import Finding, Quantity
from rsgen.report.wording import CODES, full_sentence, sentence

PACKAGE = Path(rsgen.__file__).parent

CHOICES = {
    "not-passive": {"against": "power and mass", "reversed": "channel and phase"},
    "size-unusual": {"quantity": "mass", "side": "above"},
    "size-impossible": {"quantity": "velocity", "side": "above", "mistake": "milli, inch"},
    "another-quantity": {"is": "+1"},
}
"""Findings whose names are chosen from a list."""


@dataclass
class Sample:
    """A finding that has every number and every name it is asked for."""

    code: str
    numbers: dict[str, Quantity]
    names: dict[str, str]
    severity: str = "info"
    parameter: str = "kn"

    def __getitem__(self, name: str) -> float:
        return self.numbers[name].value


def codes_of(tree: ast.AST) -> set[str]:
    """Codes that a file makes: texts in the first argument of ``Finding`` and of what is named after it."""
    found = set()
    for node in ast.walk(tree):
        called = ast.unparse(node.func).split(".")[-1] if isinstance(node, ast.Call) else ""
        if isinstance(node, ast.Call) and "finding" in called.lower() and node.args:
            texts = [part for part in ast.walk(node.args[0]) if isinstance(part, ast.Constant)]
            found |= {text.value for text in texts if isinstance(text.value, str)}
    return found


def made() -> dict[str, str]:
    """Every code with the file that makes it."""
    return {
        code: str(path.relative_to(PACKAGE))
        for path in sorted(PACKAGE.rglob("*.py"))
        for code in codes_of(ast.parse(path.read_text()))
    }


def test_every_finding_that_is_made_has_a_sentence_and_no_other_sentence_is_there() -> None:
    codes = made()
    assert len(codes) > 20
    assert {code: place for code, place in codes.items() if code not in CODES} == {}
    assert sorted(set(CODES) - set(codes) - {"note"}) == []


@pytest.mark.parametrize("code", sorted(CODES))
@pytest.mark.parametrize("size", [1.0, 4.5e-9, 3e7])
def test_every_sentence_can_be_said(code: str, size: float) -> None:
    names: dict[str, str] = defaultdict(lambda: "<name>", CHOICES.get(code, {}))
    sample: Any = Sample(code, defaultdict(lambda: Quantity(size, "m")), names)
    text = CODES[code](sample)
    assert text == text.strip()
    assert not text.endswith(".")
    assert "  " not in text
    assert not re.search(r"\bnan\b|\{|\bNone\b", text)


def test_numbers_are_printed_as_in_a_book() -> None:
    found = Finding("misfit-is-scatter", "info", numbers={"misfit": 1.6e-8})
    assert "the misfit of 1.6 × 10⁻⁸ is" in sentence(found)
    found = Finding("law-does-not-fit", "warning", numbers={"misfit": 0.1649})
    assert "the misfit of 16.5 % is" in sentence(found)
    assert full_sentence(found).startswith("The law does not fit")
    assert full_sentence(found).endswith("not noise.")


def test_names_keep_their_spelling_at_the_beginning() -> None:
    assert full_sentence(Finding("not-determined", "warning", "kn")).startswith("kn: not")
    named = Finding("force-of-decay", "info", names={"record": "run 7.csv"})
    assert full_sentence(named).startswith("run 7.csv: points")
    assert full_sentence(Finding.note("as somebody wrote it!")) == "as somebody wrote it!"


def test_an_unknown_code_is_shown_as_data() -> None:
    found = Finding("of-the-future", "info", "k", {"share": 0.5})
    assert sentence(found) == repr(found) == "of-the-future k (info): share = 0.5"
