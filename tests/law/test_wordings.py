"""One law in many wordings: one normal form, one kernel, one character, the same steady states."""

import pytest

from rsgen.dynamics.kernel_source import generate
from rsgen.formula.reading import parse
from rsgen.law.normal_form import normal_form_at

VALUES = {
    "b": 5e-3, "b2": 9e-3, "k4": 5900.0, "k5": 14800.0, "k6": 3000.0, "ks": 5900.0, "Fm": 30.0, "Ff": 2.0,
    "cq": 20.0, "c": 3.77, "k": 5000.0,
}  # fmt: skip

FAMILIES = {
    "gap": [
        "Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True))",
        "k4*x + Piecewise(((k5 - k4)*(x - b), x > b), ((k5 - k4)*(x + b), x < -b), (0, True))",
        "Piecewise((k5*x + (k4 - k5)*b, x > b), (k4*x, x > -b), (k5*x - (k4 - k5)*b, True))",
        "k4*x + (k5 - k4)*(Max(0, x - b) + Min(0, x + b))",
        "k4*x + (k5 - k4)*((x - b)*Heaviside(x - b) + (x + b)*Heaviside(-x - b))",
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
        "Piecewise((ks*x, abs(ks*x) < Fm), (Fm*sign(x), True))",
        "Piecewise((Fm, ks*x > Fm), (-Fm, ks*x < -Fm), (ks*x, True))", "(abs(ks*x + Fm) - abs(ks*x - Fm))/2",
    ],
    "friction": [
        "Ff*sign(v)", "Piecewise((Ff, v > 0), (-Ff, True))",
        "Piecewise((Ff, v > 0), (-Ff, v < 0), (0, True))", "Ff*(2*Heaviside(v) - 1)", "Ff*v/abs(v)",
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
