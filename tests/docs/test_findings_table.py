"""The table of findings in the pages: every finding has its row, with what decides it and where."""

from __future__ import annotations

import pytest

from docs._extension.made_findings import places_of_findings
from rsgen.report.wording import CODES


def test_every_finding_has_a_place_and_a_severity() -> None:
    places = places_of_findings()
    assert set(places) == set(CODES) - {"note"}
    assert [code for code, made in places.items() if not all(place.severities for place in made)] == []


@pytest.mark.parametrize(
    ("code", "where", "threshold"),
    [
        (
            "points-excluded",
            "rsgen.identification.soundness.exclusion_findings",
            ("MAX_SHARE_OF_OUTLIERS_BY_CHANCE", 0.05),
        ),
        ("resonance-sparse", "rsgen.identification.judge.Findings._runs", ("FEW", 5)),
        (
            "law-does-not-fit",
            "rsgen.identification.misfit.misfit_findings",
            ("SYSTEMATIC_MISFIT_DOUBTFUL", 0.01),
        ),
    ],
)
def test_a_threshold_stands_with_its_reason(code: str, where: str, threshold: tuple[str, float]) -> None:
    places = (place for place in places_of_findings()[code] if place.where == where)
    reasons = {(one.name, one.value): one.reason for place in places for one in place.thresholds}
    assert reasons[threshold]


def test_rows_say_what_a_result_would_say() -> None:
    pytest.importorskip("sphinx", reason="no Sphinx here: install rsgen[docs]; the table was not made")
    from docs._extension.findings import HEADS, rows

    made = {row[0].split()[0]: dict(zip(HEADS, row, strict=True)) for row in rows()}
    assert made.keys() == set(CODES) - {"note"}
    assert made["not-converged"]["finding"] == "not-converged (doubt)"
    assert made["level-deviates"]["sentence"].startswith("level <level> misses the law by <misfit>")
    assert "excluded" in made["points-excluded"]["sentence"]
    assert all(row["sentence"] for row in made.values())
