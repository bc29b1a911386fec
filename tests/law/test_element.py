"""The normal form is the law, in as few pieces as can be."""

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from rsgen.common.errors import ExpressionError
from rsgen.dynamics.kernel_source import generate
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import symbol
from rsgen.formula.reading import parse
from rsgen.law.element import make_element, response_share
from rsgen.law.normal_form import normal_form, normal_form_at

ROUND_OFF = 1e-10  # sums of pieces cancel terms that are up to about 1e4 times larger than the law

MINIMAL = {
    # law: pieces as (term, switch functions)
    "sign(v)": {("-1", ()), ("2", ("v",))}, "x**3*abs(x)": {("-x**4", ()), ("2*x**4", ("x",))},
    "abs(k*x)": {("-abs(k)*x", ()), ("2*abs(k)*x", ("x",))},
    "sign(b - a*x)": {("sign(a)", ()), ("-2*sign(a)", ("x - b/a",))},
    "Piecewise((k6*x, x > 0), (k7*x, True))": {("k7*x", ()), ("k6*x - k7*x", ("x",))},
    "Max(0, x - b)**1.5": {("abs(b - x)**1.5", ("x - b",))},
    "Heaviside(x - a)*Heaviside(x - b)": {("1", ("x - Max(a, b)",))},
    "Max(0, x)*Max(0, v)": {("x*v", ("x", "v"))}, "cos(abs(x)) + abs(x)**2": {("cos(x) + x**2", ())},
    "Max(x, v)": {("x", ()), ("v - x", ("v - x",))},
    "k*abs(x)**2.5*sign(x)": {("-k*abs(x)**2.5", ()), ("2*k*abs(x)**2.5", ("x",))},
    "v/abs(v)": {("-1", ()), ("2", ("v",))},
}  # fmt: skip

LAWS = (
    *MINIMAL, "Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True))",
    "exp(-abs(v)/(1 + w**2))*sign(v) + log(1 + abs(x))",
    "Piecewise((k*(x - b), x > b), (k*(x + b), x < -b), (0, True))",
    "Piecewise((k*x, (x < b) & (v > w)), (a*v, (x > 2) | (v < -1)), (b, True))", "Min(Max(x, v), abs(x), k)",
    "sign(x*v)*abs(x - b)*abs(v)", "tanh(k*abs(x)) + tanh(Max(0, x - b))",
    "sign(x**3 - x) + sign(x**5 - 3)", "Piecewise((x, b > 0), (v, True))", "Heaviside(v - abs(x))*x",
)  # fmt: skip


@pytest.mark.parametrize("law", MINIMAL)
def test_form_is_minimal(law):
    pieces = normal_form(parse(law)).pieces
    found = {(piece.term, frozenset(s.function for s in piece.switches)) for piece in pieces}
    wanted = {(parse(term), frozenset(map(parse, switches))) for term, switches in MINIMAL[law]}
    assert found == wanted


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), known=st.sampled_from(["nothing", "signs", "values"]))
def test_sum_of_pieces_is_the_law(law, seed, known):
    force, rng = parse(law), np.random.default_rng(seed)
    parameters = sorted(force.free_symbols - {symbol("x"), symbol("v")}, key=str)
    names = (symbol("x"), symbol("v"), *parameters)
    x, v, *values = rng.normal(0, 1.5, (len(names), 64))
    if known == "values":
        values = [float(value[0]) for value in values]
        form = normal_form_at(force, {p.name: value for p, value in zip(parameters, values, strict=True)})
    else:
        values = [np.abs(value) if known == "signs" else value for value in values]
        signed = {p: sympy.Symbol(p.name, positive=True) if known == "signs" else p for p in parameters}
        force, names = force.xreplace(signed), tuple(signed.get(name, name) for name in names)
        form = normal_form(force)
    (wanted,) = compiled((force,), names)(x, v, *values)
    found = 0.0
    for piece in form.pieces:
        parts = (*(switch.function for switch in piece.switches), piece.term)
        *levels, term = compiled(parts, names)(x, v, *values)
        found = found + np.where(np.all([np.ones(64), *(level > 0 for level in levels)], axis=0), term, 0.0)
    np.testing.assert_allclose(found, wanted, rtol=ROUND_OFF, atol=ROUND_OFF)


@pytest.mark.slow
@pytest.mark.parametrize(("law", "word"), [
    ("x**1.5", "not real for negative x"),
    ("k*v**p", "not real for negative v"),
    ("k*X", "variable of the describing function"), (sympy.Symbol("k") * symbol("x"), "not a symbol of"),
    ("abs(abs(abs(abs(x - a) - b) - c) - d)", "more than 7 switches of its own"),
    (sympy.Mul(*(parse(f"abs(x - b{i})*sign(v - w{i})") for i in range(10))), "pieces behind switches"),
])  # fmt: skip
def test_what_has_no_normal_form_is_refused(law, word):
    with pytest.raises(ExpressionError, match=word):
        make_element("spring", law)


@pytest.mark.parametrize(("sensors", "share"), [
    ("payload-wing", 1.0), ("payload - 1e-3*wing", 1.0), ("2 * tip - root", 1.0),
    ("strain gauge", 0.0), ("-gauge", 0.0), ("1e-3*gauge", 0.0),
])  # fmt: skip
def test_a_motion_across_is_a_difference_where_two_channels_are_summed(sensors, share):
    assert response_share(sensors) == share


VALUES = {
    "b": 5e-3, "b2": 9e-3, "k4": 5900.0, "k5": 14800.0, "k6": 3000.0, "ks": 5900.0, "Fm": 30.0, "Ff": 2.0,
    "cq": 20.0, "c": 3.77, "k": 5000.0,
}  # fmt: skip

FAMILIES = {
    "gap": [
        "Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True))",
        "k4*x + Piecewise(((k5 - k4)*(x - b), x > b), ((k5 - k4)*(x + b), x < -b), (0, True))",
        "k5*x + (k5 - k4)/2*(abs(x - b) - abs(x + b))", "k5*x + (k4 - k5)*Max(-b, Min(x, b))",
        "k4*x + (k5 - k4)*sign(x)*Max(0, abs(x) - b)",
    ],
    "three slopes": [
        "Piecewise((k4*x, x < b), (k5*x + (k4 - k5)*b, x < b2), (k6*x + (k4 - k5)*b + (k5 - k6)*b2, True))",
        "k4*x + (k5 - k4)*Max(0, x - b) + (k6 - k5)*Max(0, x - b2)",
        "(k4 + k6)/2*x + (k5 - k4)*(abs(x - b) - b)/2 + (k6 - k5)*(abs(x - b2) - b2)/2",
    ],
    "saturation": [
        "Max(-Fm, Min(ks*x, Fm))", "Min(Fm, Max(ks*x, -Fm))",
        "Piecewise((Fm, ks*x > Fm), (-Fm, ks*x < -Fm), (ks*x, True))", "(abs(ks*x + Fm) - abs(ks*x - Fm))/2",
    ],
    "friction": [
        "Ff*sign(v)", "Piecewise((Ff, v > 0), (-Ff, True))",
        "Ff*(2*Heaviside(v) - 1)", "Ff*v/abs(v)",
    ],
    "drag": [
        "cq*v*abs(v)", "cq*v**2*sign(v)", "Piecewise((cq*v**2, v > 0), (-cq*v**2, True))", "cq*v*Max(v, -v)",
    ],
}  # fmt: skip

SWITCHES = {"gap": 2, "three slopes": 2, "saturation": 2, "friction": 1, "drag": 1}


def values(force) -> dict[str, float]:
    return {s.name: VALUES[s.name] for s in force.free_symbols if s.name not in "xv"}


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
def test_wordings_have_one_normal_form_and_one_kernel(name):
    first, *others = (parse(f"c*v + k*x + {wording}") for wording in FAMILIES[name])
    form = normal_form_at(first, values(first))
    assert len(form.switches) == SWITCHES[name]
    for other in others:
        assert normal_form_at(other, values(other)) == form
        assert generate(other, values=values(other)) == generate(first, values=values(first))


def test_signs_and_order_of_values_choose_the_form():
    stops = parse("Piecewise((0, x < b), (k*(x - b), x < d), (k*(d - b), True))")
    ordered = normal_form_at(stops, {"b": 1.0, "d": 2.0, "k": 1.0})
    assert [str(switch.threshold) for switch in ordered.switches] == ["b", "d"]
    crossed = normal_form_at(stops, {"b": 2.0, "d": 1.0, "k": 1.0})
    assert [str(switch.threshold) for switch in crossed.switches] == ["b"]
