"""What the page of verdicts is made of: codes of tampered tests, and the campaign of random tests."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks import campaign
from benchmarks.tampered_measurements import OF_CASE
from rsgen.report.wording.sentences import CODES
from tests.verdict.tampering import TAMPERINGS, UNSEEN

LAW = "hardening"
"""Linear in all its parameters: a test of it takes a tenth of a second."""


def test_a_tampered_test_asks_for_findings_that_there_are() -> None:
    entries = [*TAMPERINGS, *UNSEEN, *(entry for entries in OF_CASE.values() for entry in entries)]
    assert {code for entry in entries for code in entry.right} <= set(CODES)
    assert {entry.corrected for entry in entries} - {""} <= set(CODES)


@pytest.mark.parametrize(("kind", "extra"), [("too many", "fitted"), ("missing", "truth")])
def test_a_term_more_or_less_is_in_one_of_the_two_laws(kind: str, extra: str) -> None:
    row = campaign.run(kind, 3, [LAW])
    laws = {"fitted": row.drawn.fitted, "truth": row.drawn.truth.law}
    assert [name for name, law in laws.items() if "more*" in law] == [extra]
    assert {"k", "m"} <= set(row.deviation)
    assert not row.wrong


def test_a_calm_result_far_from_the_truth_is_wrong_unless_it_is_doubted() -> None:
    row = campaign.run("right", 3, [LAW])
    assert row.identified
    assert not row.wrong
    far = replace(row, deviation={**row.deviation, "k3": -4.1})
    assert far.wrong
    assert not replace(far, state="doubtful").wrong
    assert not far.stated
    assert replace(far, codes=far.codes | {"mirror-image-fits"}).stated
    assert replace(far, ambiguous=frozenset({"k3"})).stated
    assert not replace(far, ambiguous=frozenset({"k"})).stated


def test_a_term_that_noise_hides_is_named_with_what_it_would_move() -> None:
    """A cubic damper beside a quadratic one, 1.5 standard errors out of the noise."""
    row = campaign.run("missing", 1238)
    assert row.wrong
    assert row.ambiguous == {"c2"}
    assert row.stated


@pytest.mark.thorough
def test_trials_of_an_even_force_that_follow_no_point_end_nothing() -> None:
    """Dry friction that holds most of a test of two stiffnesses ended in an OverflowError."""
    assert campaign.run("missing", 1261).state == "rejected"
