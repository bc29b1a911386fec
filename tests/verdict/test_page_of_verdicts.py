"""What the page of verdicts is made of: codes of tampered tests, and the campaign of random tests."""

import pytest

from benchmarks import campaign
from benchmarks.tampered_measurements import OF_CASE
from rsgen.report.wording.sentences import CODES
from tests.verdict.tampering import TAMPERINGS, UNSEEN


def test_a_tampered_test_asks_for_findings_that_there_are():
    entries = [*TAMPERINGS, *UNSEEN, *(entry for entries in OF_CASE.values() for entry in entries)]
    assert {code for entry in entries for code in entry.right} <= set(CODES)
    assert {entry.corrected for entry in entries} - {""} <= set(CODES)


@pytest.mark.parametrize("seed", [933, 1238, 1335])
def test_intervals_contain_the_shift_by_a_term_that_noise_hides(seed):
    """A cubic damper beside a quadratic one, at 1.5 standard errors of its own: c2 was 6.6 of its own off."""
    row = campaign.run("missing", seed)
    assert row.identified
    assert not row.wrong


def test_points_that_a_far_start_misses_are_no_outliers_at_the_solution():
    """The points that pass a gap by far were set aside: kg was 3800 N/m, at most 9100, for 14 700."""
    row = campaign.run("right", 1424)
    assert row.identified
    assert "points-excluded" not in row.codes
    assert row.covered["b"]
    # its interval is by profile, and longer to this side than its standard error says
    assert not row.wrong


@pytest.mark.parametrize("seed", [1534, 1539])
def test_exact_data_of_a_right_law_are_no_doubt(seed):
    """Fits of sliders and of the square of a one-sided stiffness "did not converge"; k was 3.5 % off."""
    row = campaign.run("right", seed)
    assert row.identified
    assert max(map(abs, row.share.values())) < 5e-3


def test_a_refusal_is_neither_doubtful_nor_rejected():
    """Friction holds all points but those of the resonance: the test does not determine the mass."""
    row = campaign.run("right", 6232)
    assert row.state == "refused"
    assert "doubtful or rejected 0 of 1 (0.0 %)" in "\n".join(campaign.section([row]))
