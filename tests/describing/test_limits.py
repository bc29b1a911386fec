"""What describing functions become for small and large amplitudes."""

import pytest
import sympy

from rsgen.describing import derive
from rsgen.describing.regimes import grows_slowly, limit_at_rest
from rsgen.formula import parse, symbol


@pytest.mark.parametrize(
    ("law", "limits"),
    [
        ("k*x + F*tanh(x/a)", {("stiffness", 0): "k + F/a", ("stiffness", 1): "k"}),
        ("F*atan(v/w)", {("damping", 0): "F/w", ("damping", 1): "0"}),
        ("k*x/(1 + abs(x)/a)", {("stiffness", 0): "k", ("stiffness", 1): "0"}),
        ("k*x*log(1 + x**2)", {("stiffness", 0): "0"}),
        ("asin(x) + v", {("stiffness", 0): "1", ("damping", 0): "1", ("damping", 1): "1"}),
        ("F*exp(-abs(x)/a)*sign(v)", {}),
        ("k*x*abs(x)**(p - 1)", {}),
        ("F + k*x", {("stiffness", 0): "k", ("stiffness", 1): "k"}),
        ("k*x + a*x**2", {("stiffness", 0): "abs(k)"}),
        (
            "n*masing(Min(kt*x, Fs))",
            {("stiffness", 0): "n*kt", ("stiffness", 1): "0", ("damping", 0): "0", ("damping", 1): "0"},
        ),
    ],
)
def test_limits(law, limits):
    derived = derive(law)
    found = {(i.quantity, int(i.place == sympy.oo)): i.value for i in derived.limits}
    assert set(found) == set(limits)
    assert all(sympy.simplify(found[place] - parse(value)) == 0 for place, value in limits.items())


@pytest.mark.parametrize("law", ["F*exp(-abs(v)/w)*sign(v)", "(F0 + (F - F0)*exp(-abs(v)/w))*sign(v)"])
def test_jump_is_infinite_damping_at_rest(law):
    limit = derive(law).limits[0]
    assert (limit.quantity, limit.place) == ("damping", 0)
    assert limit.value == sympy.oo * sympy.sign(symbol("F"))


def test_leading_powers_decide():
    def ends(law):
        return [limit.value for limit in derive(law).limits]

    k, k3, a, c, Ff = map(symbol, ("k", "k3", "a", "c", "Ff"))
    assert ends("k*x + k3*x**3") == [k, sympy.oo * sympy.sign(k3)]
    assert ends("c*v + Ff*sign(v)") == [sympy.oo * sympy.sign(Ff), c]
    assert ends("k*sin(a*x) + c*x") == [a * k + c, c]


def test_a_law_that_is_not_real_on_one_side_has_no_limit_at_rest():
    # found by random laws: sympy compares no complex numbers
    law = parse("Piecewise((x, x < log(x)), (x/b, True))")
    assert limit_at_rest(law, symbol("x")) is None
    assert not grows_slowly(law, symbol("x"))
