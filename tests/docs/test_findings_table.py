"""The list of findings in the pages: every finding has its section, with what decides it and where."""

import pytest

from docs._extension.made_findings import places_of_findings
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


@pytest.mark.parametrize(
    ("code", "where", "threshold"),
    [
        ("points-excluded", "soundness.exclusion_findings", ("MAX_SHARE_OF_OUTLIERS_BY_CHANCE", 0.05)),
        ("resonance-sparse", "judge.Findings._runs", ("FEW", 5)),
        ("law-does-not-fit", "misfit.misfit_findings", ("MISFIT_DOUBTFUL_WITH_PATTERN", 0.01)),
    ],
)
def test_a_threshold_stands_with_its_reason(code, where, threshold):
    places = (place for place in places_of_findings()[code] if place.where == f"rsgen.identification.{where}")
    reasons = {(one.name, one.value): one.reason for place in places for one in place.thresholds}
    assert reasons[threshold]
