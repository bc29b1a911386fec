"""The expression language: what it reads, what it refuses, and that writing and reading are inverse."""

import inspect
import json
import math
import sys
import time
from pathlib import Path

import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy import special

from rsgen.common.errors import ExpressionError
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import FUNCTIONS, check_name, symbol
from rsgen.formula.printing import write
from rsgen.formula.reading import FUNCTION_TABLE, parse

CORPUS = json.loads((Path(__file__).parents[1] / "corpus" / "expressions.json").read_text(encoding="utf-8"))
REFUSAL_SECONDS = 0.05  # what an expression may cost, best of three so that a busy machine does not decide
ROUNDING = 1e-9  # of doubles through some ten operations, cancellation included
SEEN = {"x", "y", "z", "v", "alpha"}  # the names that the corpus takes as declared

LAWS = {
    "X**4*kn2*0.625+k2": "k2 + 5/8*kn2*X**4",
    "c6 + 8*cn6*omega*X/(3*pi)": "c6 + 8/(3*pi)*cn6*omega*X", "k6/2 + 0.5*k7": "(k6 + k7)/2",
    "Ff*sign(v) + c3*v": "c3*v + Ff*sign(v)", "-b + x": "x - b",
    "b**2 + x**2": "x**2 + b**2", "gamma(1.5 + p/2)": "gamma((p + 3)/2)",
    "Piecewise((0, (x > -b) & (b > x)), (x, True))": "Piecewise((0, -b < x < b), (x, True))",
    "(Fs + (Fc - Fs)*exp(-abs(v)))*sign(v)": "(Fs + (Fc - Fs)*exp(-abs(v)))*sign(v)",
    "k3*x - k2*x + k10*x": "k3*x - k2*x + k10*x", "c*v*Abs(v)**0.5": "c*v*sqrt(abs(v))",
    "7.244e5*x - 1.1770e10*x*abs(x)": "724400*x - 1.177e10*x*abs(x)",
    "Piecewise((1, (x > 0) & (v > 0)), (2, True))": "Piecewise((1, v > 0 and x > 0), (2, True))",
    "a*(b + c)*(-1)*(d + e)": "-a*(b + c)*(d + e)", "besselj(1, a*X)*2/X": "2*besselj(1, a*X)/X",
    "abs(X/b)": "X/abs(b)", "0.1*x + 1/3": "0.1*x + 1/3", "Max(0, x - b)": "Max(x - b, 0)",
}  # fmt: skip


def outcome(text: str, names: set[str] | None) -> tuple[sympy.Expr | ExpressionError, float]:
    """An expression or its refusal, and the seconds that the best of three readings took."""
    taken = []
    for _ in range(3):
        start = time.perf_counter()
        try:
            found: sympy.Expr | ExpressionError = parse(text, names)
        except ExpressionError as error:
            found = error
        taken.append(time.perf_counter() - start)
    return found, min(taken)


@pytest.fixture(autouse=True, scope="module")
def warm():
    # SymPy loads parts of itself on first use
    parse("Piecewise((k*abs(x), x < b), (tanh(v)*Max(x, 0), True))")


def checked_message(error: ExpressionError) -> str:
    message = str(error)
    assert (message.isascii(), message.isprintable(), len(message) < 700) == (True, True, True)
    return message


def refusal(read, *what: object) -> str:
    """What is said where something is not read."""
    with pytest.raises(ExpressionError) as caught:
        read(*what)
    return checked_message(caught.value)


@pytest.mark.parametrize("entry", CORPUS, ids=[entry["id"] for entry in CORPUS])
def test_corpus_behaves_as_expected(entry, tmp_path):
    canary = tmp_path / "canary"
    parts = entry.get("input_parts") or [(entry["input"], 1)]
    text = "".join(part * times for part, times in parts).replace("@@CANARY@@", str(canary))
    if entry["field"] == "symbol name":
        refusal(check_name, text)
    elif entry["kind"] == "name-shadowing":
        name = text.partition("*")[0]
        refusal(parse, text, {"x", "v"})
        found, _ = outcome(text, {name, "x", "v", "I"})
        try:
            check_name(name)
        except ExpressionError as refused:
            checked_message(refused)
            assert isinstance(found, ExpressionError)
        else:
            assert symbol(name) in found.free_symbols
            assert all(part.is_Symbol or part.func is sympy.sign for part in found.args)
    else:
        found, seconds = outcome(text, SEEN)
        assert seconds < REFUSAL_SECONDS
        wanted = {"reject": ExpressionError, "accept": sympy.Expr}
        assert isinstance(found, wanted.get(entry["expected"][:6], object))
        if isinstance(found, ExpressionError):
            checked_message(found)
    assert not canary.exists()


@pytest.mark.parametrize(("text", "said"), [
    ("k*x + Sin(x)", "column 7: 'Sin' is not a function of formulas, did you mean 'sin'?"),
    ("pow(x, 2)", "write a**b"), ("k*x^3", "column 4: the character '^' has no meaning in formulas; write"),
    ("k1*x + kn*x**3", "column 8: the name 'kn' is not known here, did you mean 'kn1'?; known: Ff, k, k1,"),
    ("k1 x", "an operator is missing before this; write k1*x"), ("k1*x**3,5", "a comma stands between"),
    ("k1(x)", "write k1*(...) for a product"), ("α*x", "write alpha"), ("k1*x'", "write v for the velocity"),
    ("k1*v*|v|", "column 6: a number or name is missing before '|'; write abs(v) for |v|"),
    ("k1*", "the formula ends in '*'"), ("f = k1*x", "only what stands on the right"),
    ("(k1*x", "1 parenthesis not closed"), ("k1*x)", "column 5: a ')' without its '('"),
    ("x/(k1 - k1)", "column 4: division by 'k1 - k1', which is zero"),
    ("sin", "sin is a function; write sin(...)"), ("log(x, 10)", "log(a)/log(10)"),
    ("x if v > 0 else 0", "Piecewise((value, condition)"),
    ("Piecewise((x, x < k1))", "the last condition must be True"),
    ("Piecewise((x, x < k1 & v > k1), (v, True))", "comparisons in parentheses"),
    ("(-2)**0.5", "not real"), ("asin(2)*x", "no finite real value"),
    ("asin(cosh(abs(x) - abs(x) + 1))", "no finite real value"), ("(-3)**(x - k)", "not real"),
    ("besseli(1, 3**(x - 1e290))", "a number above 1000 in an exponent with names"),
    ("x**65", "the exponent '65' is above 64"), ("(x**64)**64", "has the power 4096"),
    ("(x + v + k1)**64", "terms when expanded"), ("1e-400", "out of range"), ("1" * 31, "31 digits"),
    ("*".join(["10**50"] * 7), "out of range"), ("besselj(k1, x)", "no whole number"),
    ("exp(exp(exp(100)))", "beyond 1e308"), ("gamma(1e8)", "out of range"),
    ("Max(" + ",".join(f"{n}*x*v" for n in range(9)) + ")", "at most 8"),
    *((value, "a formula is text in quotes") for value in (None, 5, True, ["x"], b"x")),
])  # fmt: skip
def test_a_refusal_says_where_what_and_what_instead(text, said):
    assert said in refusal(parse, text, {"x", "v", "k1", "kn1", "k", "Ff"})


@pytest.mark.parametrize("name", [
    *("x", "X0", "omega", "t", "F", "sin", "Piecewise", "pi", "nan", "lambda", "True", "and", "__class__"),
    *("_a", "", "a b", "k-1", "1k", "µ", "k1\n", "\ud800", "a" * 41, None, 3, "<b>"),
])  # fmt: skip
def test_names_with_a_meaning_of_their_own_are_refused_and_customary_ones_are_legal(name):
    refusal(check_name, name)
    for legal in ("kn1", "Ff", "gamma", "zeta", "E", "I", "lambda_", "e", "max", "x1"):
        assert check_name(legal) == legal
        assert parse(legal, {legal}) == symbol(legal)


def test_symbols_are_canonical():
    assert symbol("X").is_positive
    assert symbol("omega").is_positive
    assert all(symbol(name).is_real and symbol(name).is_positive is None for name in ("x", "v", "X0", "k1"))
    assert parse("k1*x").free_symbols == {symbol("k1"), symbol("x")}
    assert parse("gamma*gamma(3)", {"gamma"}) == 2 * symbol("gamma")
    with pytest.raises(ExpressionError):
        symbol("sin")


@pytest.mark.parametrize(("read", "written"), LAWS.items())
def test_formulas_are_written_as_a_person_types_them(read, written):
    assert write(parse(read)) == written
    assert parse(written) == parse(read)


def test_long_numbers_are_written_so_that_they_can_be_read():
    number = sympy.Integer(7) ** 100
    assert parse(write(number * symbol("x"))) == number * symbol("x")
    assert parse(write(symbol("x") / number)) == symbol("x") / number
    assert parse(write(sympy.Float(0.1) * symbol("x"))) == symbol("x") / 10


@pytest.mark.parametrize("expr", [
    sympy.oo, sympy.I, sympy.Derivative(sympy.Function("f")(symbol("x")), symbol("x")),
    sympy.Piecewise((1, symbol("x") > 0)), sympy.Piecewise((1, sympy.Eq(symbol("x"), 0)), (2, True)),
    sympy.Heaviside(symbol("x"), 0), sympy.zeta(symbol("x")),
])  # fmt: skip
def test_what_is_not_in_the_language_is_not_written(expr):
    with pytest.raises(ExpressionError, match=r"language|no value"):
        write(expr)


NUMBERS = st.sampled_from(["2", "3", "0.5", "1/3", "7", "0.1", "1.25e1", "pi"])
LEAVES = st.one_of(st.sampled_from(["x", "v", "X", "omega", "k1", "k2", "b", "gamma"]), NUMBERS)
COMPARE = st.sampled_from(["<", "<=", ">", ">="])
ONE_ARGUMENT = [
    "abs", "sign", "Heaviside", "sqrt", "exp", "log", "ln", "sin", "cos", "tan", "asin", "acos", "atan",
    "sinh", "cosh", "tanh",
]  # fmt: skip


def grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    def made(shape: str, *parts: st.SearchStrategy[object]) -> st.SearchStrategy[str]:
        return st.tuples(*parts).map(lambda texts: shape.format(*texts))

    exponent = st.sampled_from(["2", "3", "0.5", "(1/3)", "-1", "-2", "1.5", "b"])
    comparison = made("{} {} {}", inner, COMPARE, inner)
    condition = st.one_of(
        comparison,
        made("{} {} {}", comparison, st.sampled_from(["and", "or"]), comparison),
        made("({}) & ({})", comparison, comparison),
    )
    return st.one_of(
        made("{} {} {}", inner, st.sampled_from("+-"), inner),
        made("({}){}({})", inner, st.sampled_from("*/"), inner),
        made("({})**{}", inner, exponent),
        made("-({})", inner),
        made("{}({})", st.sampled_from(ONE_ARGUMENT), inner),
        made("{}({}, {})", st.sampled_from(["Min", "Max", "atan2"]), inner, inner),
        made("{}({}, {})", st.sampled_from(["besselj", "besseli"]), st.integers(0, 4), inner),
        made("Piecewise(({}, {}), ({}, True))", inner, condition, inner),
    )


FORMULAS = st.recursive(LEAVES, grown, max_leaves=8)
VALUES = {"x": 0.37, "v": -1.21, "X": 0.83, "omega": 2.3, "k1": 1.7, "k2": -0.6, "b": 0.45, "gamma": 0.9}


def python_value(text: str) -> float:
    """The meaning of a formula by Python itself: trusted text made here, an independent way to its value."""

    def piecewise(*branches: tuple[float, bool]) -> float:
        return next(value for value, holds in branches if holds)

    table = {name: getattr(math, name) for name in ONE_ARGUMENT if hasattr(math, name)}
    table |= {"sign": lambda a: (a > 0) - (a < 0), "Heaviside": lambda a: (1 + (a > 0) - (a < 0)) / 2}
    table |= {"abs": abs, "ln": math.log, "Min": min, "Max": max, "atan2": math.atan2, "pi": math.pi}
    table |= {"Piecewise": piecewise, "besselj": special.jv, "besseli": special.iv, "__builtins__": {}}
    value = eval(text, table, dict(VALUES))
    if isinstance(value, complex) or not math.isfinite(value) or abs(value) > 1e12:
        raise ArithmeticError
    return float(value)


def sympy_value(expr: sympy.Expr) -> complex:
    """Value of an expression by mpmath with 30 digits, as SymPy prints it and without its simplifications.

    ``Expr.subs`` makes every node anew: this calls itself without end on some cases within each other, and
    orders conditions of branches that are not taken. A TypeError says that a complex value is compared.
    """
    names = [symbol(name) for name in VALUES]
    with mpmath.workdps(30):
        # a parameter may be called gamma, as the function is
        heaviside = lambda at, at_zero: (1 + mpmath.sign(at)) / 2 if at else at_zero  # noqa: E731
        value = sympy.lambdify(names, expr, modules=[{"Heaviside": heaviside}, "mpmath"], dummify=True)
        return complex(value(*map(mpmath.mpf, VALUES.values())))


@pytest.mark.slow
@given(FORMULAS)
@example("(x + v)**2*k1 - Piecewise((x, abs(x) <= b), (b*sign(x), True))")
@example("Piecewise((X/3, Max(v, pi) >= besseli(4, gamma) or k2**(1/3) > -X), (besselj(1, 0.5), True))")
def test_a_formula_means_what_python_takes_it_to_mean(text):
    try:
        expr = parse(text)
    except ExpressionError:
        return
    try:
        expected = python_value(text)
    except (ArithmeticError, ValueError, TypeError, RuntimeWarning):
        # a root of a negative number is complex in Python, without an order, and a warning in numpy
        return
    try:
        found = sympy_value(expr)
    except TypeError:
        # Python looks at the second part of a condition only where the first leaves it open
        assume(" and " not in text and " or " not in text)
        raise
    assert found == pytest.approx(expected, rel=ROUNDING, abs=ROUNDING)


@pytest.mark.slow
@given(FORMULAS)
@example("abs(x/b)**3*Min(x, b)/(2*(x + b))")
@example("-(x + b)*(k1 + k2)/(2*v)")
@example("1.2345678901234567890123456789e-71*x")
@example("(x**64)**(k1 + 64)")
@example("Piecewise((k2, x > v), (-0.5, True))**b")
def test_what_is_written_reads_back_as_the_same(text):
    try:
        expr = parse(text)
    except ExpressionError:
        return
    again = parse(write(expr))
    if again != expr:  # SymPy does not reach one form for everything; then at least the value is the same
        assert sympy_value(again) == pytest.approx(sympy_value(expr), rel=ROUNDING, abs=ROUNDING)
    assert write(again) == write(parse(write(again)))


WORDS = (
    "x v k1 pi True and or not if else lambda ( ) ( ) , , + - * / ** // < <= == = & | . ... 1 2.5 1e9 1e999"
)
MORE = "1_0 9**9 abs( sin( Max( Piecewise( Piecewise((x,x<1), ,True)) __class__ .real [ ] { } ' : ; # @ % ! ~"
FUNNY = 'gamma( besselj( 1/0 0**0 oo inf nan zoo I E S( " \\'
TOKENS = st.sampled_from([*WORDS.split(), *MORE.split(), *FUNNY.split(), "\n", "\t", "\0", " "])


@pytest.mark.slow
@given(
    st.text(max_size=60)
    | st.lists(TOKENS, max_size=25).map("".join)
    | st.lists(TOKENS, max_size=15).map(" ".join)
)
@example("\ud800")
@example("x" + "\u0301")
@example("x" + "**x" * 600)
@example("1 and " * 300 + "1")
def test_whatever_the_text_only_an_expression_error_comes_out(text):
    try:
        expr = parse(text)
    except ExpressionError as error:
        checked_message(error)
    else:
        assert not expr.has(sympy.zoo, sympy.oo, sympy.nan, sympy.I)


@pytest.mark.slow
def test_reading_deep_in_a_call_stack_is_refused_not_a_crash():
    def deeper(levels: int) -> sympy.Expr | ExpressionError:
        return deeper(levels - 1) if levels else outcome("sin(" * 39 + "x" + ")" * 39, None)[0]

    free = sys.getrecursionlimit() - len(inspect.stack())
    assert isinstance(deeper(free - 80), ExpressionError)


ARGUMENTS = (symbol("x"), symbol("k"), symbol("b"))


@pytest.mark.parametrize("text", [
    "k*x*sqrt(1 + x**2) + b*sqrt(1 + x**2)", "sign(x)*abs(x)**k + abs(x)**k*Heaviside(x - b)",
    "Piecewise((b*sin(x), x < sin(x)), (k*sin(x)**3 - sin(x), True))",
    "cosh(k*x)*besselj(2, cosh(k*x)) + atan2(cosh(k*x), b)",
])  # fmt: skip
def test_what_occurs_twice_has_the_numbers_of_the_whole(text):
    formula = parse(text)
    formulas = (formula, formula.diff(symbol("k")))
    places = np.random.default_rng(5).uniform(0.2, 1.5, (3, 20))
    places[0, 0] *= -1
    found = compiled(formulas, ARGUMENTS)(*places)
    for n, place in enumerate(places.T):
        values = dict(zip(ARGUMENTS, map(sympy.Float, place), strict=True))
        for own, whole in zip(found, formulas, strict=True):
            assert np.broadcast_to(own, 20)[n] == pytest.approx(float(whole.subs(values).evalf()), rel=1e-12)


def test_every_function_that_may_be_called_can_be_read():
    assert sorted(FUNCTIONS) == sorted({"Piecewise", *FUNCTION_TABLE})
