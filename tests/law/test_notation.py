"""Formulas for people: the customary form in text, LaTeX and MathML, and nothing else in the markup."""

from xml.etree import ElementTree

import pytest
import sympy
from hypothesis import given

from rsgen.common.errors import ExpressionError
from rsgen.formula.reading import parse
from rsgen.law.notation import latex, mathml, readable
from tests.expression.test_expression import FORMULAS

EQUATION_20 = "Piecewise((k4, X <= b), (k5 - (k5 - k4)/pi*(2*asin(b/X) + 2*b/X**2*sqrt(X**2 - b**2)), True))"


@pytest.mark.parametrize(("formula", "text"), [
    ("k1 + X**2*kn1*3/4", "k1 + 3/4 kn1 X^2"), ("abs(b - abs(x))", "abs(b - |x|)"),
    ("c*v*abs(v) - 1.1770e10*x*abs(x)", "c v |v| - 1.177e10 x |x|"), ("k*abs(x)**1.5", "k |x|^(3/2)"),
    ("k6/2 + k7/2", "(k6 + k7)/2"), ("besselj(1, q*X)*a", "a J1(q X)"),
    ("k*Piecewise((1, x > b), (0, True))", "k {1 if x > b; 0 otherwise}"),
    ("c*v + Piecewise((0, -b < x < b), (k, True))", "c v + { 0  if -b < x < b\n      { k  otherwise"),
    (
        EQUATION_20,
        "{ k4                                                         if X <= b\n"
        "{ k5 - (k5 - k4) (2 b sqrt(X^2 - b^2)/X^2 + 2 asin(b/X))/pi  otherwise",
    ),
])  # fmt: skip
def test_plain_text_reads_as_a_person_writes(formula, text):
    assert readable(parse(formula)) == text


@pytest.mark.parametrize(("formula", "text"), [
    ("k1 + X**2*kn1*3/4", r"k_{1} + \frac{3}{4}\,k_{n1} X^{2}"),
    ("(k6 + k7)/2", r"\frac{k_{6} + k_{7}}{2}"), ("a*sin(q*x)**2", r"a\,\sin^{2}\left(q x\right)"),
    ("k*(b + sin(x))/(2*b)", r"\frac{k}{2 b} \left(\sin\left(x\right) + b\right)"),
    ("exp(-x/b)", r"\mathrm{e}^{-x/b}"), ("k*abs(x)**1.5", r"k \left|x\right|^{3/2}"),
    ("c3 + 4*Ff/(pi*omega*X)", r"c_{3} + \frac{4 F_{f}}{\pi \omega X}"), ("1e9*x", r"10^{9}\,x"),
    ("(x + b)**2", r"\left(x + b\right)^{2}"), ("1.177e10*x", r"1.177\times 10^{10}\,x"),
    ("k*sign(x)*x**(1/3)", r"k \sqrt[3]{x}\,\operatorname{sgn}\left(x\right)"),
    ("-a*(b + c)*x/2", r"-\frac{a \left(b + c\right) x}{2}"), ("1e9**p", r"\left(10^{9}\right)^{p}"),
    (
        "Piecewise((k6*x, x >= 0), (k7*x, True))",
        r"\begin{cases} k_{6} x & \text{if } x \geq 0 \\ k_{7} x & \text{otherwise} \end{cases}",
    ),
])  # fmt: skip
def test_latex(formula, text):
    assert latex(parse(formula)) == text


@pytest.mark.parametrize(("name", "text"), [
    ("k", "k"), ("kn1", "k_{n1}"), ("Ff", "F_{f}"), ("X0", "X_{0}"),
    ("omega0", r"\omega_{0}"), ("lambda_", r"\lambda"), ("mu_s", r"\mu_{s}"), ("k_1_2", r"k_{1,2}"),
    ("gap1", r"\mathrm{gap}_{1}"), ("k_lin", r"k_{\mathrm{lin}}"), ("Fmax", r"F_{\mathrm{max}}"),
])  # fmt: skip
def test_names_are_set_with_subscripts(name, text):
    assert latex(parse(name)) == text


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", r"\input{x}", "a}b", "$x$", "k&l", "\u202ek"])
def test_hostile_names_stay_text(name):
    expr = sympy.Symbol(name) + sympy.Symbol("k")
    assert latex(expr).isascii()
    assert not set("<>&$#%") & set(latex(expr))
    root = ElementTree.fromstring(mathml(expr))
    assert {element.tag for element in root.iter()} <= {"math", "mrow", "mi", "mn", "mo", "mtext", "msub"}
    assert "U+" in "".join(root.itertext())


def test_cases_are_a_brace_and_left_aligned_rows():
    root = ElementTree.fromstring(mathml(parse(EQUATION_20), display=True))
    assert root.get("display") == "block"
    assert len(root.findall(".//mtr")) == 2
    assert all(cell.get("style") == "text-align:left" for cell in root.findall(".//mtd"))
    brace = next(operator for operator in root.iter("mo") if operator.text == "{")
    assert brace.get("stretchy") == "true"
    text = "".join(root.itertext()).replace("\xa0", " ")
    assert text.startswith("{k4if X≤b")
    assert text.endswith("otherwise")


def test_long_cases_take_a_line_a_term_and_none_is_lost():
    rest = "4*phimax*(3*R*phimax**(chi + 1) + 6*S + 3*S*chi)/(pi*(chi + 2)*omega*X)"
    slope = "phimax**2*(-12*R*phimax**(chi + 1) - 36*S - 12*S*chi)/(pi*(chi + 3)*omega*X**2)"
    first = "4*R*X**(chi + 1)/(pi*(chi + 2)*(chi + 3)*omega)"
    long = f"Piecewise(({first}, X <= phimax), ({rest} + {slope}, True))"
    root = ElementTree.fromstring(mathml(parse(long)))
    rows = ["".join(row.itertext()).strip() for row in root.findall(".//mtr")]
    assert len(rows) == 5
    assert [row.endswith(":") for row in rows] == [True, False, True, False, False]
    assert rows[-1].startswith("+")


def test_what_is_not_in_the_language_is_still_shown():
    x = sympy.Symbol("x", real=True)
    assert readable(sympy.zeta(x) + 1) == "zeta(x) + 1"
    assert latex(sympy.oo) == r"\infty"
    assert "\u2260" in mathml(sympy.Piecewise((1, sympy.Ne(x, 0)), (2, True)))
    assert readable(sympy.Piecewise((1, x > 0))) == "{ 1  if x > 0"


@pytest.mark.slow
@given(FORMULAS)
def test_every_formula_gives_sound_markup(formula):
    try:
        expr = parse(formula)
    except ExpressionError:
        return
    assert readable(expr).isascii()
    text = latex(expr)
    assert text.count("{") == text.count("}")
    assert text.count(r"\left") == text.count(r"\right")
    root = ElementTree.fromstring(mathml(expr))
    assert root.tag == "math"
    assert not [e for e in root.iter() if (e.text or "").startswith("\\")]  # every command was understood
    names = {symbol.name for symbol in expr.free_symbols} - {"omega", "gamma"}
    plain = "".join(root.itertext())
    assert all(name in plain for name in names)
