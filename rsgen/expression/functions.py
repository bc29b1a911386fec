"""The functions of the language: how SymPy makes them, how a float sees them, how they are written."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import sympy

from rsgen.expression.bounds import EXPONENT, Value

__all__ = ["FUNCTION_TABLE", "Function", "check_arguments"]

_MOST_EXTREMES = 8
_LARGEST_BESSEL = 1000.0


def _first(terms: Sequence[int]) -> int:
    return math.prod(terms)


def _switched(terms: Sequence[int]) -> int:
    return 2 * math.prod(terms)


def _chosen(terms: Sequence[int]) -> int:
    return len(terms) * sum(terms)


@dataclass(frozen=True, slots=True)
class Function:
    """A function of the language; ``terms`` tells how many terms it has from those of its arguments."""

    make: Callable[..., Any]
    number: Callable[..., float] | None
    fewest: int
    most: int
    usage: str
    terms: Callable[[Sequence[int]], int] = _first


def _sign(value: float) -> float:
    return float((value > 0) - (value < 0))


def _step(value: float) -> float:
    return 0.5 * (1.0 + _sign(value))


def _one(name: str, make: Callable[..., Any], number: Callable[..., float] | None, **more: Any) -> Function:
    return Function(make, number, 1, 1, f"{name}(a)", **more)


FUNCTION_TABLE: dict[str, Function] = {
    "abs": _one("abs", sympy.Abs, abs, terms=_switched),
    "Abs": _one("abs", sympy.Abs, abs, terms=_switched),
    "sign": _one("sign", sympy.sign, _sign, terms=_switched),
    "Heaviside": _one("Heaviside", sympy.Heaviside, _step, terms=_switched),
    "Min": Function(sympy.Min, min, 2, _MOST_EXTREMES, f"Min(a, b), at most {_MOST_EXTREMES}", _chosen),
    "Max": Function(sympy.Max, max, 2, _MOST_EXTREMES, f"Max(a, b), at most {_MOST_EXTREMES}", _chosen),
    "sqrt": _one("sqrt", sympy.sqrt, math.sqrt),
    "exp": _one("exp", sympy.exp, math.exp),
    "log": Function(sympy.log, math.log, 1, 1, "log(a), the natural logarithm; log(a)/log(10) for base 10"),
    "ln": Function(sympy.log, math.log, 1, 1, "ln(a), the natural logarithm; ln(a)/ln(10) for base 10"),
    "sin": _one("sin", sympy.sin, math.sin),
    "cos": _one("cos", sympy.cos, math.cos),
    "tan": _one("tan", sympy.tan, math.tan),
    "asin": _one("asin", sympy.asin, math.asin),
    "acos": _one("acos", sympy.acos, math.acos),
    "atan": _one("atan", sympy.atan, math.atan),
    "atan2": Function(sympy.atan2, math.atan2, 2, 2, "atan2(sine, cosine)"),
    "sinh": _one("sinh", sympy.sinh, math.sinh),
    "cosh": _one("cosh", sympy.cosh, math.cosh),
    "tanh": _one("tanh", sympy.tanh, math.tanh),
    "besselj": Function(sympy.besselj, None, 2, 2, "besselj(order, a)"),
    "besseli": Function(sympy.besseli, None, 2, 2, "besseli(order, a)"),
    "gamma": _one("gamma", sympy.gamma, math.gamma),
}


def check_arguments(name: str, values: Sequence[Value]) -> str | None:
    """What is wrong with the arguments before the function is worked out; None where nothing is."""
    numbers = [value.number for value in values]
    if any(number is not None and math.isinf(number) for number in numbers):
        return "is a function of a number beyond 1e308"
    if name == "gamma" and numbers[0] is not None and abs(numbers[0]) > EXPONENT:
        return f"is out of range; numbers up to {EXPONENT} are allowed in gamma"
    if (
        name in ("sqrt", "log", "ln")
        and values[0].expr.is_Rational
        and int(values[0].expr.q).bit_length() > 110
    ):
        return "is a function of a number with too many digits"
    if name in ("besselj", "besseli"):
        order, argument = numbers
        if order is None or not values[0].expr.is_Rational or abs(order) > EXPONENT:
            return f"has no number up to {EXPONENT} as its order; write {name}(1, a)"
        if argument is not None and abs(argument) > _LARGEST_BESSEL:
            return f"is out of range; numbers up to {_LARGEST_BESSEL:g} are allowed in {name}"
    return None
