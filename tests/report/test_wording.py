"""Laws of the sentences: every finding that is made anywhere has one, and each can be said."""

from __future__ import annotations

import ast
import re
import tomllib
from collections import defaultdict
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import rsgen
from rsgen.common.finding import Finding, Quantity
from rsgen.report.wording import CODES, NEXT_STEPS, full_sentence, next_step, sentence

PACKAGE = Path(rsgen.__file__).parent

CHOICES = {
    "not-passive": {"against": "power and mass", "reversed": "channel and phase"},
    "size-impossible": {"quantity": "velocity", "side": "above"},
    "another-quantity": {"is": "+1"},
    "base-misread": {"is": "swapped"},
    "curve-negative": {"curve": "c(X)"},
    "decay-not-free": {"by": "rise"},
    "decay-taken": {"after": "drive"},
    "not-recorded": {"signal": "phase"},
    "points-excluded": {"by": "friction"},
    "power-not-at-lines": {"signal": "response"},
    "rows-left-out": {"by": "words"},
}
"""Findings whose names are chosen from a list."""

CHOICES_OF_ALL = {"base-misread": {"is": "rms"}}
"""The same, where a finding has all numbers that it may have."""


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
            found |= texts_of(node.args[0])
    return found


def texts_of(tree: ast.AST) -> set[str]:
    """Texts that stand in a piece of source."""
    parts = [part.value for part in ast.walk(tree) if isinstance(part, ast.Constant)]
    return {part for part in parts if isinstance(part, str)}


def made() -> dict[str, str]:
    """Every code with the file that makes it."""
    return {
        code: str(path.relative_to(PACKAGE))
        for path in sorted(PACKAGE.rglob("*.py"))
        for code in codes_of(ast.parse(path.read_text()))
    }


@pytest.mark.slow
def test_every_finding_that_is_made_has_a_sentence_and_no_other_sentence_is_there() -> None:
    codes = made()
    assert len(codes) > 20
    assert {code: place for code, place in codes.items() if code not in CODES} == {}
    assert sorted(set(CODES) - set(codes) - {"note"}) == []


class Everything(defaultdict[str, Any]):
    """A mapping that has every name, where one of the plain kind has those that it was asked for."""

    def __contains__(self, name: object) -> bool:
        return True


SPOKEN = [(code, defaultdict) for code in sorted(CODES)]
SPOKEN += [(code, Everything) for code, say in sorted(CODES.items()) if not isinstance(say, partial)]


@pytest.mark.parametrize(("code", "mapping"), SPOKEN)
@pytest.mark.parametrize("size", [1.0, 4.5e-9, 3e7])
def test_every_sentence_can_be_said(code: str, size: float, mapping: type[defaultdict[str, Any]]) -> None:
    choices = CHOICES.get(code, {}) | (CHOICES_OF_ALL.get(code, {}) if mapping is Everything else {})
    sample: Any = Sample(code, mapping(lambda: Quantity(size, "m")), mapping(lambda: "<name>", choices))
    text = CODES[code](sample)
    assert text == text.strip()
    assert not text.endswith(".")
    assert "  " not in text
    assert not re.search(r"\bnan\b|\{|\bNone\b", text)


GRAVE = {"doubt", "error"}
MILD = {"info", "warning"}


def values_of(name: str, function: ast.AST) -> list[ast.expr]:
    """What a name is assigned in a function."""
    return [
        node.value
        for node in ast.walk(function)
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name) and target.id == name
    ]


def may_be_grave(severity: ast.expr, function: ast.AST, seen: frozenset[str] = frozenset()) -> bool:
    """Whether a severity may be doubt or error; what cannot be read from the source may be."""
    match severity:
        case ast.Constant(value=str(text)):
            return text not in MILD
        case ast.IfExp(body=one, orelse=other):
            return may_be_grave(one, function, seen) or may_be_grave(other, function, seen)
        case ast.Name(id=name) if name not in seen:
            values = values_of(name, function)
            return not values or any(may_be_grave(value, function, seen | {name}) for value in values)
    return True


def choices(code: ast.expr, severity: ast.expr) -> list[tuple[ast.expr, ast.expr]]:
    """Codes with their severities, apart where one condition chooses both."""
    match code, severity:
        case ast.IfExp(), ast.IfExp() if ast.dump(code.test) == ast.dump(severity.test):
            return [*choices(code.body, severity.body), *choices(code.orelse, severity.orelse)]
    return [(code, severity)]


def makes_grave(function: ast.FunctionDef) -> bool:
    """Whether a helper makes a finding of a code it is given, with a severity that may be doubt or error."""
    given = {argument.arg for argument in function.args.args}
    made = [node for node in ast.walk(function) if isinstance(node, ast.Call) and len(node.args) > 1]
    return any(
        ast.unparse(node.func) == "Finding"
        and ast.unparse(node.args[0]) in given
        and ast.unparse(node.args[1]) not in given
        and may_be_grave(node.args[1], function)
        for node in made
    )


def grave_codes(tree: ast.Module) -> set[str]:
    """Codes of a file that may have the severity "doubt" or "error"."""
    found = set()
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    grave_helpers = {function.name for function in functions if makes_grave(function)}
    for function in functions or [tree]:
        for node in ast.walk(function):
            if not (isinstance(node, ast.Call) and codes_of(ast.Expression(node))):
                continue
            named = {word.arg: word.value for word in node.keywords}
            called = ast.unparse(node.func).split(".")[-1]
            if called == "Finding":
                severity = node.args[1] if len(node.args) > 1 else named["severity"]
                for code, its in choices(node.args[0], severity):
                    found |= texts_of(code) if may_be_grave(its, function) else set()
                continue
            # a helper: one of its arguments may be the severity
            given = [*node.args[1:], *named.values()]
            given += [value for argument in given for value in values_of(ast.unparse(argument), function)]
            if (
                called in grave_helpers
                or "severity" in named
                or GRAVE & {text for value in given for text in texts_of(value)}
            ):
                found |= texts_of(node.args[0])
    return found


def test_severities_are_read_from_the_source() -> None:
    source = """
def f(misfit, given, table):
    constant = Finding("a", "error")
    mild = Finding("b", "info" if misfit < 1 else "warning")
    computed = Finding("c", "doubt" if misfit < 1 else "warning")
    severity = "warning"
    if misfit > 2:
        severity = "doubt"
    assigned = Finding("d", severity)
    handed = Finding("e", given)
    looked_up = Finding("f", table[misfit])
    called = Finding(code="x", severity=grade(misfit)) if misfit else Finding("g", severity=grade(misfit))
    helper = make_finding("h", severity)
    other = make_finding("i", 3)
    choice = Finding("j" if misfit else "k", "error", "m")
    paired = Finding("l" if misfit else "m", "info" if misfit else "doubt")
    crossed = Finding("n" if misfit else "o", "info" if given else "doubt")
    counted = count_finding("p", 3)
    told = tell_finding("q", "info")

def count_finding(code, count):
    return Finding(code, "doubt" if count else "info")

def tell_finding(code, severity):
    return Finding(code, severity)
"""
    assert grave_codes(ast.parse(source)) == set("acdefghjkmnop")


@pytest.mark.slow
def test_every_finding_that_may_decide_a_verdict_has_a_next_step() -> None:
    trees = {path: ast.parse(path.read_text()) for path in sorted(PACKAGE.rglob("*.py"))}
    grave = {code: path.name for path, tree in trees.items() for code in grave_codes(tree)}
    assert {"law-does-not-fit", "structure-feeds-exciter"} <= set(grave)
    missing = {code: place for code, place in grave.items() if code not in NEXT_STEPS or code not in CODES}
    assert missing == {}, "add the next step in findings.toml"
    assert sorted(set(NEXT_STEPS) - set(CODES)) == []


def test_a_code_has_one_sentence_and_one_next_step() -> None:
    # TOML refuses a code that stands twice; a function of the same code would replace its text without a word
    texts = tomllib.loads((PACKAGE / "report/wording/findings.toml").read_text(encoding="utf-8"))
    assert {key for said in texts.values() for key in said} == {"sentence", "next"}
    assert [
        code for code, said in texts.items() if "sentence" in said and not isinstance(CODES[code], partial)
    ] == []
    assert {code for code, say in CODES.items() if isinstance(say, partial)} <= set(texts)


@pytest.mark.slow
def test_no_severity_is_changed_after_a_finding_is_made() -> None:
    # the scan above would not see it
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == "replace":
                assert "severity" not in {word.arg for word in node.keywords}, path


@pytest.mark.parametrize("code", sorted(NEXT_STEPS))
def test_every_next_step_is_one_full_sentence(code: str) -> None:
    names: dict[str, str] = defaultdict(lambda: "<name>", CHOICES.get(code, {}))
    sample: Any = Sample(code, defaultdict(lambda: Quantity(0.5, "m")), names)
    text = next_step(sample)
    assert text == text.strip()
    assert text[0].isupper()
    assert text.endswith(".")
    assert "  " not in text
    assert "{" not in text


def test_numbers_are_printed_as_in_a_book() -> None:
    numbers = {"of_mean": 2e-8, "of_reading": 4e-8, "readings": 40, "points": 10, "repeats": 4, "excluded": 0}
    found = Finding("repeats-scatter", "info", numbers={**numbers, "misfit": 1.6e-8})
    assert "the misfit of 1.6 × 10⁻⁸ is" in sentence(found)
    found = Finding("law-does-not-fit", "doubt", numbers={"misfit": 0.1649})
    assert "the misfit of 16.5 % is" in sentence(found)
    assert full_sentence(found).startswith("The law does not fit")
    assert full_sentence(found).endswith("not noise.")


def test_what_leaves_a_result_usable_is_not_said_as_if_it_did_not() -> None:
    numbers = {name: Quantity(0.02) for name in ("misfit", "z", "after", "size")}
    names = {"parts": "alternate levels"}
    warned, doubted = (
        [
            sentence(Finding(code, severity, "", numbers, names))
            for code in ("law-does-not-fit", "parts-disagree")
        ]
        for severity in ("warning", "doubt")
    )
    assert warned[0].startswith("the law fits to 2.0 %, ")
    assert warned[1].endswith(": too little to separate parts")
    assert doubted[0].startswith("the law does not fit: ")
    assert doubted[1].endswith(": one law does not hold for all")


def test_names_keep_their_spelling_at_the_beginning() -> None:
    assert full_sentence(Finding("not-determined", "warning", "kn")).startswith("kn: not")
    named = Finding("force-of-decay", "info", names={"record": "run 7.csv"})
    assert full_sentence(named).startswith("run 7.csv: points")
    assert full_sentence(Finding.note("as somebody wrote it!")) == "as somebody wrote it!"


def test_an_open_side_of_the_balance_is_no_open_side_of_the_test() -> None:
    numbers = {"bound": Quantity(0.003, "m")}
    finding = Finding("bounded-to-one-side", "warning", "b", numbers, {"side": "at least"})
    assert sentence(finding) == "b: the test says only that it is at least 3 mm"
    numbers = {**numbers, "reach": Quantity(0.0031, "m")}
    lost = Finding("bounded-to-one-side", "warning", "b", numbers, {"side": "at least"})
    assert sentence(lost).startswith("b is at least 3 mm; beyond 3.1 mm the balance, not the test, ends")


def test_an_unknown_code_is_shown_as_data() -> None:
    found = Finding("of-the-future", "info", "k", {"share": 0.5})
    assert sentence(found) == repr(found) == "of-the-future k (info): share = 0.5"
