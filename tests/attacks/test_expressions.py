"""Texts that are hard to work out are answered soon; ``python -m tests.attacks expressions`` tries many."""

import time

import numpy as np
import pytest
import sympy

from rsgen.common.errors import ExpressionError
from rsgen.describing.derivation import derive
from rsgen.formula.bounds import algebra_faults
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import symbol
from tests.attacks.child import allowed
from tests.attacks.expressions import answer, text_of

SECONDS = 5.0  # work allowed for an answer

QUICK = {
    "tan": "tan(1e300)*x", "exp": "exp(1e300) + c*v", "power": "x**(10**9)",
    # deep fractions, that of 346 with a corner; oscillation at a switch, numbers that cannot be compared,
    # endless recursion in the algebra library
    **{f"text {number}": text_of(number, 1)[1] for number in (15, 346, 10177, 14525, 17344, 17442, 19450)},
}  # fmt: skip
# texts, and laws with the equation of a state, that once ended in a fault or took minutes
ONCE = {
    # overflows and a product of inf, a sign of a cube root, a fraction, 30 pieces
    **{f"text {number}": text_of(number, 1)[1] for number in (78, 156, 203, 414, 456, 994, 3386)},
    "exp(1e29) is no polynomial in e": text_of(9476, 1)[1], "integral of extremes": text_of(17914, 1)[1],
    "limit of a series to the ninth power": text_of(975, 2)[1],
    "roots in functions in roots": text_of(1976, 2)[1], "hundreds of thresholds": text_of(2015, 2)[1],
    "high power with a mean": "(k3 + 1e4 + Ff)**30*x**2 + k*x", "no force": ("sign(z)", "z = -z - Ff*z"),
    "no drive": ("k*x + z", "z = v*z**3"), "pole": "masing(k*x*(x/x - 1)/(x - x**1) + K*x/(1 + x/b))",
    "too stiff": ("k*x*z", "z = (besseli(2, k)/cos(x))**(1/3)*(64**n/c - Min(k3*x, 1e29, tan(x), v*7.5e-3))"),
    "stiff": ("k*z", "z = 300*(x - z)"), "sign of a quotient": "k*x + c*v + sign(atan2(atan(x), k3)**-2)",
    "degree 58": "(c + x)**16 + (x + x + v)**58", "below the line": "x**9/(v + 7.5e-3 + k)**55/k**21",
    "no sign": "k*x*sign(log(-k))*abs(x - b)",
    "beyond all numbers": "abs(x - exp(1000*k)) + abs(x - exp(2000*b))",
    "sum beyond all numbers": "k*x + c*v + 1e300/(v*atan(v))", "conjugate": "k*x + abs(besseli(5, Ff))",
    "number to a parameter": "k*x + Piecewise((c*v, 7.5e-3**n <= v), (0, True))",
    "state beyond all numbers": ("sign(z)", "z = c*v - k*z + k*x + exp(10**n*(x - 1/2))"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("law", [
    *QUICK.values(), *(pytest.param(law, marks=pytest.mark.thorough) for law in ONCE.values())
], ids=[*QUICK, *(f"once: {name}" for name in ONCE)])  # fmt: skip
def test_a_hard_text_has_an_answer(law):
    text, *memory = (law,) if isinstance(law, str) else law
    begun = time.process_time()
    assert answer(text, memory).startswith(("result", "refused"))
    assert time.process_time() - begun < allowed(SECONDS)


def test_a_complex_value_is_not_defined():
    x = symbol("x")
    (value,) = compiled((3 + sympy.sqrt(-2) * x,), (x,))(np.array([0.0, 0.5]))
    assert value[0] == 3
    assert np.isnan(value[1])
    assert answer(text_of(14175, 1)[1]).startswith(("result", "refused"))


def test_a_fault_of_rsgen_is_no_refusal():
    with pytest.raises(ValueError, match="ours"), algebra_faults():
        raise ValueError("ours")
    with pytest.raises(ExpressionError, match=r"cannot work it out \(ValueError\)"), algebra_faults():
        sympy.Max(sympy.I, 1)
    with pytest.raises(ExpressionError, match=r"\(PolynomialError\)"), algebra_faults():
        sympy.degree(symbol("x") ** symbol("n"), symbol("x"))


@pytest.mark.parametrize(("law", "said"), [
    ("(k3 + 1e4 + Ff)**50*x", "up to 1326 terms when expanded; a power may have 500"),
    # numbers that no user writes are not factored
    ("abs(Min(Min(abs(x - v), Ff*x), 1e300*x) - b)", "more than 96 pieces"),
    ("Max(Min(v, x, w0, 0)**-2, sin(v)**64, x/Piecewise((1e300, k > v), (b, True)))", "at most 2500 are"),
])  # fmt: skip
def test_what_would_grow_without_end_is_refused_soon(law, said):
    begun = time.process_time()
    with pytest.raises(ExpressionError, match=said):
        derive(law)
    assert time.process_time() - begun < allowed(SECONDS)
