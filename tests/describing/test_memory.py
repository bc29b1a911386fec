"""Describing functions of laws with memory: against quadratures, stepped states, and closed solutions."""

import numpy as np
import pytest
import sympy
from scipy.special import gamma, i1

from rsgen import derive, laws, make_element
from rsgen.common.errors import ExpressionError, RsgenError
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import remembers, symbol
from rsgen.formula.reading import parse
from tests.oracles.loop import equivalent, odd_loop

pytestmark = pytest.mark.slow

ASKED = 1e-9
STEPPED = 3e-5  # of loops of states, against integrations in time
OMEGA = 2.3


@pytest.mark.parametrize(("virgin", "values", "closed"), [
    ("K*x - R*x**p", {"K": 3.0, "R": 0.4, "p": 1.37}, True),
    ("Piecewise((K*x - K*x**2/(4*xs), x < 2*xs), (K*xs, True))", {"K": 4.0, "xs": 0.3}, True),
    ("Min(k1*x, F1) + Min(k2*x, F2)", {"k1": 3.0, "F1": 1.0, "k2": 0.7, "F2": 1.1}, True),
    ("Min(k1*x, k2*x + F*(1 - k2/k1))", {"k1": 3.0, "k2": 0.4, "F": 1.2}, True),
    ("Min(k1*x, k2*x + F)", {"k1": 3.0, "k2": 0.4, "F": 1.2}, False),
    ("F*sin(a*x)", {"F": 2.0, "a": 0.5}, False),
    ("Piecewise((K*x - R*x**1.5, x < b), (K*b - R*b**1.5, True))", {"K": 3.0, "R": 1.0, "b": 0.8}, True),
])  # fmt: skip
def test_masing_laws_against_a_quadrature_over_half_a_loop(virgin, values, closed):
    derived = derive(f"masing({virgin})")
    assert derived.closed_form is closed
    assert (derived.checked_to or 0.0) <= 1e-12
    curve = compiled((parse(virgin),), (symbol("x"), *map(symbol, values)))
    for X in (0.2, 1.3, 2.4):
        found = derived.evaluate(X, OMEGA, values)
        k, c = equivalent(lambda x: curve(x, *values.values())[0], X, OMEGA)
        size = abs(k) + OMEGA * abs(c)
        assert abs(found.stiffness - k) <= ASKED * size
        assert abs(found.damping - c) <= ASKED * size


def test_masing_formulas_of_the_literature():
    R, p = symbol("R"), symbol("p")
    power = derive("masing(K*x - R*x**p)")
    for value in (1.3, 2.0, 3.7):
        numbers = {R: 1.0, p: value, symbol("K"): 0, symbol("X"): 1.7}
        factor = 4 / np.sqrt(np.pi) * value / (value + 1) * gamma(value + 0.5) / gamma(value + 1)
        assert float(power.stiffness.subs(numbers)) == pytest.approx(-factor * 1.7 ** (value - 1), rel=1e-12)
        area = 4 * 1.7 ** (value + 1) * (value - 1) / (value + 1)
        assert float(power.energy.subs(numbers)) == pytest.approx(area, rel=1e-12)
    jenkins = derive("masing(Min(kt*x, Fs))")
    assert str(jenkins.regimes[0]) == "X <= Fs/kt"
    numbers = {symbol("kt"): 2.0, symbol("Fs"): 3.0, symbol("X"): 4.0}
    assert float(jenkins.energy.subs(numbers)) == pytest.approx(4 * 3 * (4 - 1.5))
    assert derive("masing(k1*x + k3*x**3)").stiffness == parse("k1 + 15/16*k3*X**2")
    structural = derive("masing(k*x) + structural(eta*k)")
    assert (structural.stiffness, structural.damping) == (symbol("k"), parse("eta*k/omega"))


def test_a_formula_with_integrals_says_what_is_evaluated():
    derived = derive("masing(K*x/(1 + x/b))")
    assert not derived.closed_form
    found = derived.evaluate(1.3, OMEGA, {"K": 3.0, "b": 0.7})
    numbers = {"K": 3.0, "b": 0.7, "X": 1.3, "omega": OMEGA}
    for shown, number in ((derived.stiffness, found.stiffness), (derived.damping, found.damping)):
        value = shown.subs({symbol(name): size for name, size in numbers.items()}).evalf()
        assert float(value) == pytest.approx(float(number), rel=1e-9)
    # integral of n = K b (X - b log(1 + X/b))
    area = 8 * 3 * 0.7 * (1.3 - 0.7 * np.log(1 + 1.3 / 0.7)) - 4 * 1.3 * 3 * 1.3 / (1 + 1.3 / 0.7)
    assert np.pi * OMEGA * 1.3**2 * float(found.damping) == pytest.approx(area, rel=1e-9)


def test_joints_side_by_side_are_closed():
    one, several = derive("masing(Min(kt*x, Fs))"), derive("n*masing(Min(kt*x, Fs))")
    assert several.closed_form
    assert sympy.simplify(several.stiffness - symbol("n") * one.stiffness) == 0


def test_negative_parameters_and_forces_that_are_not_linear_in_a_masing_law():
    jenkins = derive("masing(Min(kt*x, Fs)) + c*v")
    odd = jenkins.evaluate(2.0, OMEGA, {"kt": 2.0, "Fs": 0.9, "c": -1.0})
    # no longer positive for x > 0, and quadrature says so; the formulas would say something else
    assert jenkins.evaluate(2.0, OMEGA, {"kt": -2.0, "Fs": 0.9, "c": 0.0}).stiffness == pytest.approx(-2.0)
    assert odd.damping == pytest.approx(4 * 0.9 * (2 - 0.45) / (np.pi * OMEGA * 4) - 1)
    cubed = derive("masing(K*x)**3 + structural(h)").evaluate(2.0, OMEGA, {"K": 2.0, "h": 0.3})
    assert cubed.stiffness == pytest.approx(0.75 * 8 * 4, rel=1e-12)
    assert cubed.damping == pytest.approx(0.3 / OMEGA, rel=1e-12)


def test_dahl_and_maxwell_against_their_closed_solutions():
    dahl = derive(make_element("dahl", "z", {"z": "sigma*v*(1 - z*sign(v)/Fc)"}))
    X = np.geomspace(0.03, 20, 9)
    found = dahl.evaluate(X, OMEGA, {"sigma": 3.0, "Fc": 1.5})
    share = X / 0.5
    np.testing.assert_allclose(found.stiffness, 2 * 1.5 * i1(share) / (X * np.cosh(share)), rtol=1e-7)
    lost = 4 * 1.5 * (X - 0.5 * np.tanh(share)) / (np.pi * OMEGA * X**2)
    np.testing.assert_allclose(found.damping, lost, rtol=1e-7)
    maxwell = derive(make_element("maxwell", "k*x + z", {"z": "a*v - b*z"}))
    found = maxwell.evaluate(X, OMEGA, {"a": 3.0, "b": 1.4, "k": 1.0})
    np.testing.assert_allclose(found.stiffness, 1 + 3 * OMEGA**2 / (OMEGA**2 + 1.4**2), rtol=1e-10)
    np.testing.assert_allclose(found.damping, 3 * 1.4 / (OMEGA**2 + 1.4**2), rtol=1e-10)


@pytest.mark.parametrize(
    "name", [law.name for law in laws if remembers(law.force) and law.name != "structural"]
)
def test_laws_of_the_library_against_their_loops(name):
    law = laws[name]
    derived = derive(law)
    assert law.parameters == derived.parameters
    assert law.added.free_symbols if law.search else True
    found = derived.evaluate(1.3, OMEGA, law.example)
    names = tuple(map(symbol, law.example))
    if law.memory:
        (rate,) = law.memory.values()
        moving = tuple(map(symbol, ("x", "v", "z")))
        both = compiled((parse(rate), parse(law.formula)), (*moving, *names))
        numbers = law.example.values()
        parts = (lambda *motion, i=i: float(both(*motion, *numbers)[i]) for i in range(2))
        wanted = odd_loop(*parts, 1.3, OMEGA)
    else:
        curve = compiled(law.force.args, (symbol("x"), *names))
        wanted = equivalent(lambda x: curve(x, *law.example.values())[0], 1.3, OMEGA)
    assert found.stiffness == pytest.approx(wanted[0], rel=1e-5 if law.memory else 1e-9)
    assert found.damping == pytest.approx(wanted[1], rel=1e-5 if law.memory else 1e-9)


@pytest.mark.parametrize("rate", ["v + z", "abs(v)", "v + z**3", "a*v - drift"])
def test_loops_that_do_not_close_are_refused(rate):
    with pytest.raises(ExpressionError, match="the loop of z does not close at X"):
        derive(make_element("law", "k*x + z", {"z": rate}))


def test_a_loop_that_closes_at_some_values_only():
    law = derive(make_element("law", "k*x + z", {"z": "a*v - b*z"}))
    with pytest.raises(RsgenError, match=r"the loop of z does not close at X = 0\.5 m"):
        law.evaluate([0.5, 1.0], OMEGA, {"k": 1.0, "a": 1.0, "b": -2.0})


def held_against_stepping(derived, values, rate, X, k=0.0, asked=STEPPED):
    found = derived.evaluate(X, OMEGA, values)
    wanted = odd_loop(rate, lambda x, v, z: k * x + z, X, OMEGA)
    size = abs(wanted[0]) + OMEGA * abs(wanted[1])
    assert abs(found.stiffness - wanted[0]) <= asked * size
    assert OMEGA * abs(found.damping - wanted[1]) <= asked * size


@pytest.mark.parametrize("n", [0.7, 1.7])
def test_powers_of_a_state_from_hardly_any_slip_to_almost_nothing_else(n):
    law = derive(make_element("bw", "k*x + z", {"z": "A*v - bg*abs(v)*abs(z)**(n-1)*z - bd*v*abs(z)**n"}))
    assert law.checked_to < STEPPED
    values = {"k": 1.0, "A": 2.0, "bg": 0.7, "bd": 0.3, "n": n}
    for X in (1e-3, 1.0, 100.0):
        held_against_stepping(
            law, values, lambda x, v, z: 2.0 * v - (0.7 * abs(v) * np.sign(z) + 0.3 * v) * abs(z) ** n, X, 1.0
        )


def test_states_that_are_much_faster_than_the_motion():
    maxwell = derive(make_element("maxwell", "z", {"z": "k*v - z/tau"}))
    for tau in (1e-2, 1e-3, 1e-5):
        found = maxwell.evaluate([1e-6, 1.0, 100.0], OMEGA, {"k": 2.0, "tau": tau})
        whole = 2.0 * 1j * OMEGA * tau / (1 + 1j * OMEGA * tau)
        np.testing.assert_allclose(found.stiffness, whole.real, atol=1e-5 * abs(whole))
        np.testing.assert_allclose(found.damping, whole.imag / OMEGA, rtol=1e-5)
    bend = derive(make_element("bend", "z", {"z": "k*v - tanh(z/e)"}))
    for X in (3.0, 10.0):
        held_against_stepping(
            bend, {"k": 2.0, "e": 0.01}, lambda x, v, z: 2.0 * v - np.tanh(z / 0.01), X, asked=3e-4
        )


def test_what_was_not_compared_or_is_not_known_is_said_so():
    stiff = derive(make_element("stiff", "k*x + z", {"z": "a*v - 1e9*abs(v)*z"}))
    assert stiff.checked_to is None
    assert any("much faster than the motion" in remark for remark in stiff.remarks)
    dahl = derive(make_element("dahl", "z", {"z": "kt*v - kt*abs(v)*z/Fs"}))
    with pytest.raises(RsgenError, match=r"is not known to three digits at X = 1e\+04 m"):
        dahl.evaluate(1e4, OMEGA, {"kt": 3000.0, "Fs": 0.01})
