"""What is odd about a law whatever its values."""

import pytest

import rsgen
from rsgen.common.errors import ExpressionError, RsgenError
from rsgen.formula import parse
from rsgen.law.element import law_remarks


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        ("k*x + z", {"constant-force"}),
        ("k*x + 2*F0", {"constant-force"}),
        ("k*x + c*xdot", {"constant-force"}),
        ("k*x + c*v + Ff*sign(v)", set()),
        # a virgin curve that gets steeper turns its loop the other way
        ("masing(kt*x**3)", {"damping-feeds-energy"}),
        ("k*x + masing(K*x + R*x**1.5)", {"damping-feeds-energy"}),
        # gives or dissipates, as the power says
        ("masing(a*x**p)", set()),
        ("k*x + m3*x**2*a + c2*vx*abs(v)", {"parameter-not-variable"}),
        # coefficients, and what a function scales
        ("k*x + a*x**3 + F*tanh(x/w)", set()),
        # neither
        ("masing(kt*x)", set()),
        ("masing(K*x - R*x**p)", {"curve-negative"}),
        ("masing(Min(kt*x, Fs)) + masing(F*tanh(k*x/F))", set()),
    ],
)
def test_oddities_are_said(text, codes):
    assert {finding.code for finding in law_remarks(parse(text))} == codes


@pytest.mark.parametrize("text", ["k*x*cos(2*w*t)", "k*x + t*x**3"])
def test_a_law_does_not_change_with_time(text):
    with pytest.raises(ExpressionError, match="it is the time"):
        rsgen.Law(text)


def test_nothing_is_odd_about_the_library():
    assert [law.name for law in rsgen.laws if law_remarks(law.force)] == []


@pytest.mark.parametrize("name", ["jenkins", "dahl", "ramberg_osgood"])
def test_a_law_of_the_library_is_no_force(name):
    with pytest.raises(ExpressionError, match=rf"{name} is a law of the library.*rsgen.laws"):
        rsgen.Law(f"k*x + {name}")


@pytest.mark.parametrize("text", ["dead-zone", "k*x + cubic-spring"])
def test_a_hyphen_of_a_law_of_the_library_is_no_minus(text):
    with pytest.raises(ExpressionError, match=r"is a law of the library.*rsgen.laws"):
        rsgen.Law(text)


def test_a_ranking_of_constant_forces_alone_is_refused(linear_table):
    with pytest.raises(RsgenError, match="no candidate has forces"):
        rsgen.rank(linear_table, "F1 - F2")


@pytest.fixture
def linear_table():
    """Few points of a linear oscillator."""
    frequency = [8.0, 9.0, 10.0, 11.0, 12.0]
    stiffness = [5920.0 - 1.5 * (6.2831853 * f) ** 2 + 6.2831853j * f * 3.8 for f in frequency]
    return rsgen.ResponseSurface(1.0, frequency, 1.0, [1 / k for k in stiffness])
