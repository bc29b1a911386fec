"""Texts of force laws: grown at random by the grammar of the language, and made to be hard to work out."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from numpy.random import Generator

T = TypeVar("T")
STATES = ("x", "v", "x", "v", "x")
NAMES = ("k", "c", "b", "a", "Ff", "k3", "n", "w0")
NUMBERS = ("2", "3", "0.5", "1", "0.25", "10", "7.5e-3", "1e4", "1/3", "pi", "0", "5920", "64", "1e300",
           "1e-300", "123456789012345678901234567890", "0.1234567890123456789")  # fmt: skip
FUNCTIONS = ("abs", "sign", "Heaviside", "sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan",
             "sinh", "cosh", "tanh", "gamma")  # fmt: skip
RELATIONS = ("<", "<=", ">", ">=")
LONGEST = 2000  # characters that the language allows


def pick(rng: Generator, of: Sequence[T]) -> T:
    return of[int(rng.integers(len(of)))]


def _many(rng: Generator, most: int) -> int:
    return int(rng.integers(1, most + 1))


def _leaf(rng: Generator) -> str:
    return pick(rng, (STATES, STATES, NAMES, NUMBERS)[int(rng.integers(4))])


def _grow(rng: Generator, depth: int) -> str:
    if depth <= 0 or rng.random() < 0.12:
        return _leaf(rng)
    kind = rng.random()
    if kind < 0.5:
        a, b = _grow(rng, depth - 1), _grow(rng, depth - 1)
        return f"({a} {pick(rng, ('+', '-', '*', '*', '/'))} {b})"
    if kind < 0.62:
        power = pick(rng, ("2", "3", "-1", "0.5", "64", "n", "-2", "7", "1.5", "(1/3)", "x", "65", "10**9"))
        return f"({_grow(rng, depth - 1)})**{power}"
    if kind < 0.84:
        return f"{pick(rng, FUNCTIONS)}({_grow(rng, depth - 1)})"
    if kind < 0.88:
        return f"{pick(rng, ('besselj', 'besseli'))}({int(rng.integers(-3, 9))}, {_grow(rng, depth - 1)})"
    if kind < 0.93:
        args = ", ".join(_grow(rng, depth - 1) for _ in range(_many(rng, 4) + 1))
        return f"{pick(rng, ('Min', 'Max'))}({args})"
    if kind < 0.95:
        return f"atan2({_grow(rng, depth - 1)}, {_grow(rng, depth - 1)})"
    pairs = [f"({_grow(rng, depth - 1)}, {_condition(rng, depth - 1)})" for _ in range(_many(rng, 3))]
    return f"Piecewise({', '.join(pairs)}, ({_grow(rng, depth - 1)}, True))"


def _condition(rng: Generator, depth: int) -> str:
    one = f"{_grow(rng, min(depth, 2))} {pick(rng, RELATIONS)} {_grow(rng, min(depth, 1))}"
    if rng.random() < 0.25:
        other = f"{pick(rng, STATES)} {pick(rng, RELATIONS)} {pick(rng, NAMES)}"
        return f"{one} {pick(rng, ('and', 'or'))} {other}"
    return one


def grown(rng: Generator) -> str:
    text = _grow(rng, int(rng.integers(1, 6)))
    return f"k*x + c*v + {text}" if rng.random() < 0.4 else text


def _nested(inner: str, outer: Callable[[str], str], times: int) -> str:
    for _ in range(times):
        longer = outer(inner)
        if len(longer) > LONGEST:
            break
        inner = longer
    return inner


def continued_fraction(rng: Generator) -> str:
    s, p = pick(rng, STATES), pick(rng, NAMES)
    inner = pick(rng, ("x", "abs(x)", "sign(v)", "b", "Max(x, b)"))
    return _nested(inner, lambda t: f"{p}/({s} + {pick(rng, NAMES)} + {t})", _many(rng, 38))


def nested_functions(rng: Generator) -> str:
    names = tuple(pick(rng, FUNCTIONS) for _ in range(_many(rng, 2)))
    added = ("", " + b", " - x", "*v", "**2")
    return _nested(_leaf(rng), lambda t: f"{pick(rng, names)}({t}{pick(rng, added)})", _many(rng, 30))


def nested_switches(rng: Generator) -> str:
    make = ("abs({} - {})", "Max({}, {})", "Min({}, {}*x)", "sign({} + {})*x", "Heaviside({} - {})*v",
            "abs({})*{}")  # fmt: skip
    return _nested("x", lambda t: pick(rng, make).format(t, _leaf(rng)), _many(rng, 20))


def nested_cases(rng: Generator) -> str:
    inner = lambda t: f"Piecewise(({t}, {_condition(rng, 1)}), ({_leaf(rng)}*x, True))"  # noqa: E731
    return _nested("k*x", inner, _many(rng, 14))


def many_switches(rng: Generator) -> str:
    make = ("abs(x - {})", "sign(v - {})", "Max(x - {}, 0)", "Heaviside(x + {})", "abs(v)*x**2*{}",
            "abs(x*{} - v)")  # fmt: skip
    joint, parts = pick(rng, (" + ", "*", " - ")), []
    for i in range(_many(rng, 90)):
        parts.append(pick(rng, make).format(pick(rng, NAMES) + str(i) if rng.random() < 0.7 else i))
    return joint.join(parts)[:LONGEST].rsplit(joint, 1)[0]


def extremes(rng: Generator) -> str:
    inner = lambda t: f"{pick(rng, ('Min', 'Max'))}({t}, {_leaf(rng)}*x, {_leaf(rng)}*v, {_leaf(rng)})"  # noqa: E731
    text = _nested("x", inner, _many(rng, 8))
    return f"({text})**{_many(rng, 9)}" if rng.random() < 0.4 else text


def long_sum(rng: Generator) -> str:
    terms = [f"{_leaf(rng)}*{pick(rng, STATES)}**{_many(rng, 60)}" for _ in range(_many(rng, 200))]
    return " + ".join(terms)[:LONGEST].rsplit(" + ", 1)[0]


def power_of_sum(rng: Generator) -> str:
    part = lambda: f"({' + '.join(_leaf(rng) for _ in range(_many(rng, 5)))})**{_many(rng, 64)}"  # noqa: E731
    return pick(rng, ("*", "/", " + ")).join(part() for _ in range(_many(rng, 3)))


def sign_of_polynomial(rng: Generator) -> str:
    terms = [f"{int(rng.integers(-99, 99))}*x**{i}" for i in range(_many(rng, 30))]
    inner = " + ".join(terms).replace("+ -", "- ")
    other = pick(rng, ("", " + v", " + b", " + v**3*x", " - b*v*x"))
    return f"{pick(rng, ('sign', 'abs', 'Heaviside'))}({inner}{other})*k"


def huge_numbers(rng: Generator) -> str:
    """Constants beyond the range of a double, or on which to work without end."""
    numbers = (
        "1e300", "10**400", "10**10**10", "9**9**9**9", "2**0.5", "1e-300", "1e999", "x**(10**9)",
        "gamma(64)", "exp(700)", "exp(exp(9))", "(1e300)**2", "0.1**300", "1e300*1e300", "1/1e-300/1e-300",
        "9" * 31,
    )  # fmt: skip
    ends = ("", "*v", " + x", "**2")
    outer = lambda t: f"{pick(rng, FUNCTIONS)}({t}){pick(rng, ends)}"  # noqa: E731
    return _nested(pick(rng, numbers), outer, _many(rng, 4))


def powers_of_powers(rng: Generator) -> str:
    inner = lambda t: f"({t})**({pick(rng, ('n', '0.5', 'x', '1/3', '2', 'abs(n)', '-1', '1e-3'))})"  # noqa: E731
    return _nested(pick(rng, ("abs(x)", "x", "x**2 + b**2", "abs(x - v)", "2")), inner, _many(rng, 9))


def bessel_of_pieces(rng: Generator) -> str:
    inner = nested_cases(rng) if rng.random() < 0.5 else nested_switches(rng)
    function, order = pick(rng, ("besselj", "besseli")), int(rng.integers(0, 65))
    return f"x*{function}({order}, {inner})**{_many(rng, 64)}"[:LONGEST]


def waves(rng: Generator) -> str:

    def part() -> str:
        wave, left, state, right = pick(rng, FUNCTIONS[4:]), _leaf(rng), pick(rng, STATES), _leaf(rng)
        return f"{wave}({left}*{state} + {right})**{_many(rng, 6)}"

    return "*".join(part() for _ in range(_many(rng, 6)))


def quotients(rng: Generator) -> str:
    below = ("x", "v", "abs(x)", "x**2", "abs(v)")
    part = lambda: f"{_leaf(rng)}*x**{_many(rng, 5)}/({_leaf(rng)} + {pick(rng, below)}**{_many(rng, 6)})"  # noqa: E731
    return " + ".join(part() for _ in range(_many(rng, 25)))[:LONGEST].rsplit(" + ", 1)[0]


def no_language(rng: Generator) -> str:
    kinds = (
        "(" * _many(rng, 5000) + "x" + ")" * _many(rng, 5000), "-" * _many(rng, 4000) + "x",
        "k*\u0445 + c*v", "k\u2217x", "\uff4b*x", "k*x\u200b", "\u202ek*x", "x" * 10**6, "9" * 10**6,
        "x**" * 600 + "2", "x." * 900 + "x", "lambda: x", "x if x else v", "__import__('os')", "x\x00",
        "[x for x in v]", "+".join(["x"] * 900), "x" + "**x" * 600, "Max(" + ", ".join(["x"] * 600) + ")",
        "1e" + "9" * 500, "x and v", "x < v < b", "\ud800", "abs(" * 39 + "x" + ")" * 39,
        "*".join(["(x + v)"] * 200), "1_000*x", "0x10*x", "1j*x", "x @ v", "x := v",
    )  # fmt: skip
    return pick(rng, kinds)


TEXTS: tuple[Callable[[Generator], str], ...] = (
    continued_fraction, nested_functions, nested_switches, nested_cases, many_switches, extremes, long_sum,
    power_of_sum, sign_of_polynomial, huge_numbers, powers_of_powers, bessel_of_pieces, waves, quotients,
    no_language,
)  # fmt: skip
"""Texts that are hard to work out, each of its own kind."""
