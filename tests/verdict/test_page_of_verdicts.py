"""What the page of verdicts is made of: codes of tampered tests, and the campaign of random tests."""

from benchmarks import campaign
from benchmarks.tampered_measurements import OF_CASE
from rsgen.report.wording.sentences import CODES
from tests.verdict.tampering import TAMPERINGS, UNSEEN


def test_a_tampered_test_asks_for_findings_that_there_are():
    entries = [*TAMPERINGS, *UNSEEN, *(entry for entries in OF_CASE.values() for entry in entries)]
    assert {code for entry in entries for code in entry.right} <= set(CODES)
    assert {entry.corrected for entry in entries} - {""} <= set(CODES)


def test_a_term_that_noise_hides_is_named_with_what_it_would_move():
    """A cubic damper beside a quadratic one, 1.5 standard errors out of the noise."""
    row = campaign.run("missing", 1238)
    assert row.wrong
    assert row.ambiguous == {"c2"}
    assert row.stated
