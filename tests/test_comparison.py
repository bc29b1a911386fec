import numpy as np
import pytest

from rsgen.analysis.comparison import compare
from rsgen.common.errors import RsgenError
from rsgen.identification.identify import identify
from tests.surfaces import model, truth


@pytest.fixture(scope="module")
def combined(surface_of):
    return identify(surface_of("combined", levels=np.array([2.0, 6, 12])), model("combined"))


@pytest.mark.slow
def test_rows_hold_estimates_against_truth(combined):
    result = compare(combined, truth("combined"), {"kn": 1e-4, "m": 1e-4})
    rows = {row.name: row for row in result.rows}
    assert list(rows) == ["c", "cn", "k", "kn", "m", "stiffness_force", "damping_force"]
    assert result.passed
    assert rows["k"].relative_error == abs(rows["k"].refined.value - 5920) / 5920
    assert rows["k"].first_order_error > rows["k"].relative_error
    assert rows["k"].tolerance is None
    assert rows["kn"].tolerance == 1e-4


def test_a_missed_tolerance_fails_the_whole(combined):
    wrong = truth("combined") | {"kn": 3.3e5}
    result = compare(combined, wrong, {"kn": 1e-2})
    assert not result.passed
    assert [row.name for row in result.rows if not row.passed] == ["kn"]
    assert next(row for row in result.rows if row.name == "kn").relative_error == pytest.approx(
        0.0909, rel=1e-2
    )


def test_forces_are_judged_over_the_tested_range(combined):
    # 10 % on the cubic term, whose share of the force at the largest X is the deviation
    wrong = truth("combined") | {"kn": 3.3e5}
    row = next(
        r for r in compare(combined, wrong, {"stiffness_force": 1e-3}).rows if r.name == "stiffness_force"
    )
    largest = combined.curve.amplitude[combined.curve.used].max()
    force = 5920 * largest + 3.3e5 * largest**3
    assert row.true == pytest.approx(force, rel=1e-12)
    assert row.relative_error == pytest.approx(0.3e5 * largest**3 / force, rel=1e-3)
    assert not row.passed
    assert row.unit == "N"


def test_unknown_and_blind_names_are_refused(combined):
    with pytest.raises(RsgenError, match="k9: not identified; allowed are c, cn, k, kn, m"):
        compare(combined, truth("combined"), {"k9": 1e-3})
    with pytest.raises(RsgenError, match="no truth for kn"):
        compare(combined, {"k": 5920.0}, {"kn": 1e-3})
    with pytest.raises(RsgenError, match="no truth for"):
        compare(combined, {"k": 5920.0}, {"stiffness_force": 1e-3})
