"""Findings of the schema 1 of result.json are read under the codes of today, and can be said.

``schema_1.json`` has every code of that schema with the numbers and names that its sentence had.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from rsgen.common.finding import Finding, Quantity, earlier_codes
from rsgen.report.sentences import CODES, next_step, sentence

CODES_OF_SCHEMA_1: dict[str, Any] = json.loads(Path(__file__).with_name("schema_1.json").read_text("utf-8"))


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
    gone = set(CODES_OF_SCHEMA_1) - set(CODES)
    assert gone <= set(earlier)
