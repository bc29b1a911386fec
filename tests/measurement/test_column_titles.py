"""What titles of columns say, and how long a title of a stranger may take."""

import time

import pytest

from rsgen.files.column_titles import is_angular, unit_in


@pytest.mark.parametrize(
    ("title", "unit"),
    [
        ("Kraft [N]", "N"),
        ("Kraft [ N ] ", "N"),
        ("Beschleunigung (m/s^2)", "m/s^2"),
        ("Kraft in N (rms)", "N"),
        ("Kraft [ ]", ""),
        ("force_mN", "mN"),
        ("Accelerance [(m/s^2)/N]", "(m/s^2)/N"),
        ("Accelerance ((m/s²)/N)", "(m/s²)/N"),
        ("Accelerance (m/s^2)/N", "(m/s^2)/N"),
        ("FRF (m/(s^2*N))", "m/(s^2*N)"),
        ("F/N", "N"),
        ("v_mm/s", "mm/s"),
        ("v_mm_s", "mm/s"),
        ("acc_m_s2", "m/s2"),
        ("a/m/s^2", "m/s^2"),
        ("x/mm", "mm"),
        ("a / (m/s²)", "m/s²"),
        # a quotient, and parts of a number
        ("x/F", ""),
        ("Re(H)", ""),
        ("Im(x/F)", ""),
        ("Real (mm)", "mm"),
        ("Re(H) [m/N]", "m/N"),
        ("force", ""),
    ],
)
def test_a_unit_in_a_title(title, unit):
    assert unit_in(title) == unit


@pytest.mark.parametrize(
    ("title", "angular"),
    [("freq [rad/s]", True), ("rad per sec", True), ("rads", True), ("rad / s", True), ("radius", False)],
)
def test_an_angular_frequency(title, angular):
    assert is_angular(title) == angular


@pytest.mark.parametrize(
    "title", ["(" + " " * 30_000 + "x", "( x" + " " * 30_000 + "y", "(" * 30_000, "rad" + " " * 30_000 + "x"]
)
def test_a_long_title_takes_no_time(title):
    started = time.process_time()
    assert (unit_in(title), is_angular(title)) == ("", False)
    # a pattern that tries all ways takes minutes
    assert time.process_time() - started < 2.0
