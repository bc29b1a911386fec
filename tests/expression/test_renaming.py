"""Symbols with other names: what SymPy makes by replacing them, without evaluating what takes long."""

import pytest
import sympy

from rsgen.formula import parse, symbol
from rsgen.formula.names import renamed

NAMES = {symbol("k"): sympy.Symbol("k", positive=True), symbol("b"): sympy.Symbol("b", positive=True)}


@pytest.mark.parametrize(
    "text",
    [
        "k*x + sqrt(k**2)*x**3",
        "Piecewise((k*x, x < b), (k*b + (x - b)/2, True))",
        "abs(k)*sign(x)*b**1.5",
        "c*v",
        "Max(-b, Min(k*x, b))",
    ],
)
def test_renaming_is_replacing(text):
    law = parse(text)
    assert renamed(law, NAMES) == law.xreplace(NAMES)


def test_the_largest_of_several_is_not_looked_for_anew(monkeypatch):
    law = parse("Max(k*x, b, v) + Min(k*v, b, x)")
    expected = law.xreplace(NAMES)

    def compared(*arguments: object) -> bool:
        raise AssertionError("arguments were compared")

    monkeypatch.setattr(sympy.Max, "_is_connected", compared)
    monkeypatch.setattr(sympy.Min, "_is_connected", compared)
    assert renamed(law, NAMES) == expected
