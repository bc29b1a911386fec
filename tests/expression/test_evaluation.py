"""Formulas evaluated as compiled functions, and symbols renamed."""

import numpy as np
import pytest
import sympy

from rsgen.formula import parse, symbol
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import renamed

TEXTS = (
    "k*x*sqrt(1 + x**2) + b*sqrt(1 + x**2)",
    "Piecewise((b*sin(x), x < sin(x)), (k*sin(x)**3 - sin(x), True))",
    "Max(x, b, x*k) - Min(x, b, x*k)/(1 + Max(x, b, x*k)**2)",
    "cosh(k*x)*besselj(2, cosh(k*x)) + atan2(cosh(k*x), b)",
    "sign(x)*abs(x)**k + abs(x)**k*Heaviside(x - b)",
)
ARGUMENTS = (symbol("x"), symbol("k"), symbol("b"))


@pytest.mark.parametrize("text", TEXTS)
def test_what_occurs_twice_has_the_numbers_of_the_whole(text):
    formula = parse(text)
    formulas = (formula, formula.diff(symbol("k")) if "Max" not in text else formula**2)
    generator = np.random.default_rng(5)
    places = generator.uniform(0.2, 1.5, (3, 20)) * np.array([[-1.0] + [1.0] * 19, [1.0] * 20, [1.0] * 20])
    found = compiled(formulas, ARGUMENTS)(*places)
    for n, place in enumerate(places.T):
        values = dict(zip(ARGUMENTS, map(sympy.Float, place), strict=True))
        for own, whole in zip(found, formulas, strict=True):
            number = float(np.broadcast_to(own, 20)[n])
            assert number == pytest.approx(float(whole.subs(values).evalf()), rel=1e-12)


def test_no_function_is_evaluated_anew(monkeypatch):
    formula = parse("atan(k*x)*b + sin(k*x)*atan(k*x)")

    def evaluated(*arguments: object) -> None:
        raise AssertionError("a formula was evaluated")

    monkeypatch.setattr(sympy.atan, "eval", evaluated)
    value = compiled((formula,), ARGUMENTS)(0.5, 2.0, 3.0)[0]
    assert value == pytest.approx((3 + np.sin(1.0)) * np.arctan(1.0))


NAMES = {symbol("k"): sympy.Symbol("k", positive=True), symbol("b"): sympy.Symbol("b", positive=True)}


@pytest.mark.parametrize("text", [
    "k*x + sqrt(k**2)*x**3", "Piecewise((k*x, x < b), (k*b + (x - b)/2, True))", "abs(k)*sign(x)*b**1.5",
    "c*v", "Max(-b, Min(k*x, b))",
])  # fmt: skip
def test_renaming_is_replacing(text):
    law = parse(text)
    assert renamed(law, NAMES) == law.xreplace(NAMES)
