"""Laws of the sentences: every finding that is made anywhere has one, and each can be said."""

import json
import re
import tomllib
from collections import defaultdict
from functools import partial
from pathlib import Path
from string import Formatter
from types import SimpleNamespace

import pytest

import rsgen
from rsgen.common.finding import Finding, Quantity, earlier_codes
from rsgen.report.sentences import _PART, CODES, NEXT_STEPS, _Number, next_step, sentence

PACKAGE = Path(rsgen.__file__).parent

CHOICES = {
    "not-passive": {"against": "power and mass", "reversed": "channel and phase"},
    "size-impossible": {"quantity": "velocity", "side": "above"}, "another-quantity": {"is": "+1"},
    "base-misread": {"is": "swapped"}, "curve-negative": {"curve": "c(X)"}, "decay-not-free": {"by": "rise"},
    "decay-taken": {"after": "drive"}, "not-recorded": {"signal": "phase"},
    "points-excluded": {"by": "friction"}, "power-not-at-lines": {"signal": "response"},
    "rows-left-out": {"by": "words"},
}  # fmt: skip
"""Findings whose names are chosen from a list."""


class Everything(defaultdict):
    """A mapping that has every name, where one of the plain kind has those that it was asked for."""

    def __contains__(self, name: object) -> bool:
        return True


def sample(code: str, size: float, mapping: type[defaultdict] = defaultdict, **choices: str):
    """A finding that has every number and every name it is asked for."""

    class Sample(SimpleNamespace):
        def __getitem__(self, name: str) -> float:
            return float(self.numbers[name].value)

    numbers = mapping(lambda: Quantity(size, "m"))
    names = mapping(lambda: "<name>", CHOICES.get(code, {}) | choices)
    return Sample(code=code, numbers=numbers, names=names, severity="info", parameter="kn")


@pytest.mark.parametrize("size", [1.0, 4.5e-9, 3e7])
def test_every_sentence_can_be_said(size):
    findings = [sample(code, size) for code in CODES]
    for code in (code for code, say in CODES.items() if not isinstance(say, partial)):
        # where a base has all numbers, it is another misreading
        findings.append(sample(code, size, Everything, **({"is": "rms"} if code == "base-misread" else {})))
    for finding in findings:
        code, text = finding.code, CODES[finding.code](finding)
        assert text == text.strip(), code
        assert not re.search(r"\bnan\b|\{|\bNone\b|  |\.$", text), code


def test_every_part_of_a_text_can_be_said():
    said = (say.args[0] for say in CODES.values() if isinstance(say, partial))
    for text in (text for one in said for text in ([one] if isinstance(one, str) else one.values())):
        whole = _PART.sub(r"\2", text)
        fields = [(name, form) for _, name, form, _ in Formatter().parse(whole) if name]
        values = {name: _Number(4.5e-9, "m") if form else "<name>" for name, form in fields}
        spoken = whole.format_map(values | {"names": defaultdict(lambda: "<name>")})
        assert not re.search(r"\[\[|\]\]|[{}|]|  |\.$", spoken), text


def test_a_code_has_one_sentence_and_one_next_step():
    # TOML refuses a code that stands twice; a function of the same code would replace its text without a word
    texts = tomllib.loads((PACKAGE / "report/findings.toml").read_text(encoding="utf-8"))
    assert {key for said in texts.values() for key in said} == {"sentence", "next", "words"}
    said = {code for code, text in texts.items() if "sentence" in text}
    assert {code for code in said if not isinstance(CODES[code], partial)} == set()
    assert {code for code, say in CODES.items() if isinstance(say, partial)} <= set(texts)


def test_every_next_step_is_one_full_sentence():
    for code in NEXT_STEPS:
        text = next_step(sample(code, 0.5))
        assert (text[0].isupper(), text[-1]) == (True, "."), code
        assert not re.search(r"^\s|  |\{", text), code


def test_an_unknown_code_is_shown_as_data():
    found = Finding("of-the-future", "info", "k", {"share": 0.5})
    assert sentence(found) == repr(found) == "of-the-future k (info): share = 0.5"


@pytest.mark.parametrize(("numbers", "by", "said"), [
    ({}, "", "3 of 9 points were excluded: they disagree"),
    ({}, "ranking", "excluded: no candidate explains them"),
    ({"low": 1, "high": 2}, "ranking", "between 1 and 2 Hz"),
    ({"low": 1}, "ranking", "3 of 9 points were excluded"),
])  # fmt: skip
def test_a_sentence_has_the_parts_whose_conditions_hold(numbers, by, said):
    numbers, names = {"excluded": 3, "points": 9, **numbers}, {"by": by} if by else {}
    assert said in sentence(Finding("points-excluded", "info", "", numbers, names))


def test_shares_beyond_all_reason_are_one_power_of_ten():
    assert f"{_Number(5.5197994e19):.1%}" == "5.5 × 10²¹ %"
    assert f"{_Number(0.3192):.1%}" == "31.9 %"


# every code of the schema 1 of result.json, with the numbers and names that its sentence had
CODES_OF_SCHEMA_1 = json.loads(Path(__file__).with_name("schema_1.json").read_text("utf-8"))


@pytest.mark.parametrize("severity", ["info", "doubt"])
def test_every_earlier_finding_is_said(severity):
    for code, data in CODES_OF_SCHEMA_1.items():
        numbers = {name: Quantity(2.0, "m") for name in data["numbers"]}
        finding = Finding.from_dict(Finding(code, severity, "kn", numbers, data["names"]).to_dict())
        assert finding.code in CODES
        assert (finding.severity, finding.parameter) == (severity, "kn")
        assert sentence(finding) not in ("", repr(finding))
        next_step(finding)
        again = Finding.from_dict(finding.to_dict())
        assert (again, again.numbers, again.names) == (finding, finding.numbers, finding.names)


def test_a_code_that_went_is_read_under_one_that_is_there():
    # codes that schema 2 had before it was published
    earlier = earlier_codes()
    assert set(earlier) - set(CODES_OF_SCHEMA_1) == {"control-recognised", "periods-few", "points-held"}
    assert {now["code"] for now in earlier.values()} <= set(CODES)
    assert {key for now in earlier.values() for key in now} == {"code", "added", "renamed"}
    assert (set(CODES_OF_SCHEMA_1) - set(CODES)) <= set(earlier)
