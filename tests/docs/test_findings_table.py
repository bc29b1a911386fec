"""The list of findings in the pages: every finding has its section, with what decides it and where."""

import ast

import pytest

from docs._extension.findings import entries
from docs._extension.made_findings import Source, places_of_findings
from rsgen.report.wording import CODES, NEXT_STEPS


@pytest.mark.slow
def test_every_finding_has_a_place_and_a_severity_and_a_grave_one_a_next_step():
    places = places_of_findings()
    assert set(places) == set(CODES) - {"note"}
    assert [code for code, made in places.items() if not all(place.severities for place in made)] == []
    grave = {
        code for code, made in places.items() if any({"doubt", "error"} & {*one.severities} for one in made)
    }
    assert {"law-does-not-fit", "structure-feeds-exciter"} <= grave
    assert grave - set(NEXT_STEPS) == set(), "add the next step in findings.toml"
    assert set(NEXT_STEPS) <= set(CODES)


MADE = """
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
    helper = make_finding("g", severity)
    choice = Finding("h" if misfit else "i", "error", "m")
    paired = Finding("j" if misfit else "k", "info" if misfit else "doubt")
    counted = count_finding("l", 3)
    told = tell_finding("m", "info")

def count_finding(code, count):
    return Finding(code, "doubt" if count else "info")

def tell_finding(code, severity):
    return Finding(code, severity)
"""


def test_severities_are_read_from_the_source():
    found = {code: place.severities for code, place in Source("rsgen", ast.parse(MADE)).places()}
    assert {code for code, severities in found.items() if {"doubt", "error"} & {*severities}} == set(
        "acdghijkl"
    )
    # what cannot be read has none, and the test above would not pass it
    assert {code for code, severities in found.items() if not severities} == set("ef")


@pytest.mark.parametrize(
    ("code", "where", "threshold"),
    [
        ("points-excluded", "soundness.exclusion_findings", ("MAX_SHARE_OF_OUTLIERS_BY_CHANCE", 0.05)),
        ("resonance-sparse", "judge.Findings._runs", ("FEW", 5)),
        ("law-does-not-fit", "misfit.misfit_findings", ("SYSTEMATIC_MISFIT_DOUBTFUL", 0.01)),
    ],
)
def test_a_threshold_stands_with_its_reason(code, where, threshold):
    places = (place for place in places_of_findings()[code] if place.where == f"rsgen.identification.{where}")
    reasons = {(one.name, one.value): one.reason for place in places for one in place.thresholds}
    assert reasons[threshold]


def test_entries_say_what_a_result_would_say():
    made = {entry.code: entry for entry in entries()}
    assert made.keys() == set(CODES) - {"note"}
    assert made["not-converged"].severities == ("doubt",)
    assert made["level-deviates"].sentences[0].startswith("level <level> misses the law by <misfit>")
    assert "excluded" in made["points-excluded"].sentences[0]
    assert all(entry.sentences and all(entry.sentences) for entry in made.values())
