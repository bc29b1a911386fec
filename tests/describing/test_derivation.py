"""`rsgen derive`: what a person reads, what a program reads, and the picture."""

import json
from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import j0, j1

from rsgen.describing.derivation import derive
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import symbol
from rsgen.formula.reading import parse
from rsgen.report.figures.equivalent import draw_derivation
from tests.conftest import Answer

JOINT = "k*x + F*tanh(x/a) + Ff*sign(v)"
SAME = 1e-12  # a formula that was written and read back, in numbers


Run = Callable[..., Answer]


def answer(run_cli: Run, *words: str) -> dict[str, object]:
    done = run_cli("derive", *words, "--json")
    assert done.code == 0
    return json.loads(done.out)


def test_text_names_only_the_variables_that_occur(run_cli):
    text = run_cli("derive", "k*x + Ff*sign(v) + q*Max(0, x - b)").out
    assert "k(X, X0)    = { k + q " in text
    assert "c(X, omega) = 4 Ff/(pi omega X)" in text
    assert "X > |X0 - b|" in text
    assert "balance    0 " in text
    assert "agrees with an independent quadrature to" in text
    assert "*" not in text


def test_text_shows_what_is_not_closed_as_an_integral(run_cli):
    text = run_cli("derive", JOINT).out
    assert "k + F/(pi X) integral_0^2pi sin(phi) tanh(X sin(phi)/a) dphi" in text
    assert "Integral" not in text


def test_json_has_null_and_the_closed_part_where_an_integral_is(run_cli):
    found = answer(run_cli, JOINT)
    assert found["stiffness"] is None
    assert found["damping"] == "4*Ff/(pi*omega*X)"
    assert found["closed_part"] == {
        "stiffness": "k", "damping": "4*Ff/(pi*omega*X)", "mean_balance": "0", "mean": "0",
    }  # fmt: skip
    assert found["quadrature"] == "F*tanh(x/a)"


@pytest.mark.slow
@pytest.mark.parametrize("law", [
    "k0*x + k*Max(0, x - b1) + q*Min(0, x + b2)", "k*abs(x)**p*sign(x)", "k*sin(a*x) + c*sinh(v/w)",
    "k*x + a*x**2", "Piecewise((k1*x, abs(x) < a), (k2*x, abs(x) < b), (k3*x, True))",
    "Min(Max(k1*x, k2*x - F), k3*x + F)",
])  # fmt: skip
def test_every_text_of_json_is_the_formula(run_cli, law):
    found, function = answer(run_cli, law), derive(law)
    names = tuple(map(symbol, ("X", "X0", "omega", *function.parameters)))
    point = (1.7, 0.3, 0.8, *np.linspace(0.4, 1.9, len(function.parameters)))
    for quantity in ("stiffness", "damping", "mean_balance", "mean"):
        text, formula = found[quantity], getattr(function, quantity)
        if text is None:
            # longer than the language allows, or no formula at all
            assert formula is None or law.startswith("Min")
            continue
        both = compiled((parse(str(text)), formula), names)(*point)
        np.testing.assert_allclose(both[0], both[1], rtol=SAME, atol=SAME)


def test_drawing_shows_k_and_c_of_the_law():
    drawing = draw_derivation(derive("k*x + k3*x**3 + Ff*sign(v)"), {"k": 2.0, "k3": 4.0}, largest=1.0)
    force, stiffness, damping = drawing.figure.axes
    X, k = stiffness.lines[0].get_data()
    assert "N/m" in stiffness.get_ylabel()
    np.testing.assert_allclose(k, 2 + 3 * np.asarray(X) ** 2, rtol=1e-12)
    assert "damping" in damping.get_ylabel()
    assert len(force.lines) == 3  # cycles of three amplitudes: the force depends on x and v
    assert " to 5 at 1. Equivalent damping" in drawing.alternative


def test_a_wave_about_a_mean_follows_the_addition_theorem():
    # Jacobi-Anger: the sine part of cos(a X sin(phi) + b + a X0) is -2 J1(a X) sin(b + a X0), its mean
    # J0(a X) cos(b + a X0)
    derived = derive("F*cos(a*x + b) + k*x")
    assert derived.closed_form
    numbers = {"F": 2.0, "a": 1.5, "b": 0.4, "k": 3.0, "X": 0.8, "X0": 0.3}
    places = {symbol(name): number for name, number in numbers.items()}
    phase = 0.4 + 1.5 * 0.3
    stiffness = 3 - 2 * 2 * j1(1.5 * 0.8) * np.sin(phase) / 0.8
    assert float(derived.stiffness.subs(places)) == pytest.approx(stiffness, rel=1e-12)
    mean = 3 * 0.3 + 2 * j0(1.5 * 0.8) * np.cos(phase)
    assert float(derived.mean_balance.subs(places)) == pytest.approx(mean, rel=1e-12)
