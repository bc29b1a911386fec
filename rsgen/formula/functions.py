"""The functions of the language: how SymPy makes them, how a float sees them, how they are written."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import sympy

from rsgen.formula.bounds import EXPONENT, EXTREMES, Value, as_float
from rsgen.formula.memory import Masing, Structural

__all__ = ["FUNCTION_TABLE", "Function", "check_arguments", "constant_number"]

_LARGEST_BESSEL = 1000.0
_NESTED = 6  # SymPy asks of roots in functions in roots whether they are real: each takes ten times the last
_SWITCHING = (sympy.Abs, sympy.sign, sympy.Min, sympy.Max, sympy.Heaviside, sympy.Piecewise, Masing)


def _multiplied(terms: Sequence[int]) -> int:
    return math.prod(terms)


def _switched(terms: Sequence[int]) -> int:
    return 2 * math.prod(terms)


def _chosen(terms: Sequence[int]) -> int:
    return len(terms) * sum(terms)


@dataclass(frozen=True, slots=True)
class Function:
    """A function of the language.

    ``make`` builds it (as an instance of ``head``, where ``make`` itself is no SymPy class), ``number`` is
    its value for floats, ``terms`` bounds its terms after expansion from those of its arguments.
    """

    make: Callable[..., Any]
    number: Callable[..., float]
    fewest: int
    most: int
    usage: str
    terms: Callable[[Sequence[int]], int] = _multiplied
    head: type[sympy.Basic] | None = None


def _sign(value: float) -> float:
    return float((value > 0) - (value < 0))


def _step(value: float) -> float:
    return 0.5 * (1.0 + _sign(value))


def _no_number(value: float) -> float:
    raise ValueError(f"a law with memory of the number {value} has no value")


def _bessel(name: str, usage: str) -> Function:
    make = getattr(sympy, name)

    def number(order: float, argument: float) -> float:
        import mpmath

        return float(getattr(mpmath, name)(order, argument))

    def plain(order: sympy.Expr, argument: sympy.Expr) -> sympy.Expr:
        # SymPy turns the argument's sign by a factor (-a)**n/a**n, which stays; its value is (-1)**n
        even = order % 2 == 0
        sign = 1 if even or order > 0 or name == "besseli" else -1
        if argument.could_extract_minus_sign():
            argument, sign = -argument, sign if even else -sign
        return sign * make(abs(order), argument)

    return Function(plain, number, 2, 2, usage, head=make)


def _absolute(argument: sympy.Expr) -> sympy.Expr:
    """The absolute value with abs(x/b) as abs(x)/abs(b), which SymPy leaves as abs(x)*abs(1/b)."""
    return sympy.Mul(*map(_plain_absolute, sympy.Mul.make_args(sympy.Abs(argument))))


def _plain_absolute(factor: sympy.Expr) -> sympy.Expr:
    inner = factor.args[0] if isinstance(factor, sympy.Abs) else None
    if isinstance(inner, sympy.Abs):
        return inner
    if inner is not None and inner.is_Pow and inner.exp.is_Integer:
        return sympy.Abs(inner.base) ** inner.exp
    return factor


def _one(name: str, make: Callable[..., Any], number: Callable[..., float], **more: Any) -> Function:
    return Function(make, number, 1, 1, f"{name}(a)", **more)


FUNCTION_TABLE: dict[str, Function] = {
    "abs": _one("abs", _absolute, abs, terms=_switched, head=sympy.Abs),
    "Abs": _one("abs", _absolute, abs, terms=_switched, head=sympy.Abs),
    "sign": _one("sign", sympy.sign, _sign, terms=_switched),
    "Heaviside": _one("Heaviside", sympy.Heaviside, _step, terms=_switched),
    "Min": Function(sympy.Min, min, 2, EXTREMES, f"Min(a, b), at most {EXTREMES}", _chosen),
    "Max": Function(sympy.Max, max, 2, EXTREMES, f"Max(a, b), at most {EXTREMES}", _chosen),
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
    "besselj": _bessel("besselj", "besselj(order, a)"),
    "besseli": _bessel("besseli", "besseli(order, a)"),
    "gamma": _one("gamma", sympy.gamma, math.gamma),
    "masing": _one("masing", Masing, _no_number),
    "structural": _one("structural", Structural, _no_number),
}


@lru_cache(maxsize=4096)
def _nested(expr: sympy.Basic) -> int:
    """How many smooth functions and roots of what is not constant stand in each other."""
    inside = max(map(_nested, expr.args), default=0)
    smooth = isinstance(expr, sympy.Function) and not isinstance(expr, _SWITCHING)
    root = expr.is_Pow and not expr.exp.is_Integer
    return inside + int(bool(expr.free_symbols) and (smooth or root))


def check_arguments(name: str, values: Sequence[Value]) -> str | None:
    """What is wrong with the arguments before the function is worked out; None where nothing is."""
    numbers = [value.number for value in values]
    if any(number is not None and math.isinf(number) for number in numbers):
        return "is a function of a number beyond 1e308"
    if max(_nested(value.expr) for value in values) >= _NESTED:
        return f"has more than {_NESTED} functions in each other"
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
        if order is None or not values[0].expr.is_Integer or abs(order) > EXPONENT:
            return f"has no whole number up to {EXPONENT} as its order; write {name}(1, a)"
        if argument is not None and abs(argument) > _LARGEST_BESSEL:
            return f"is out of range; numbers up to {_LARGEST_BESSEL:g} are allowed in {name}"
    return None


_NUMBERS: dict[type[sympy.Basic], Callable[..., float]] = {sympy.Pow: math.pow} | {
    function.head or function.make: function.number for function in FUNCTION_TABLE.values()
}


def constant_number(expr: sympy.Expr) -> float:
    """The value of an expression without names, inf where any part of it exceeds the range of floats.

    SymPy evaluates such expressions itself, with as many digits as it takes; with this value known, it is
    never given one on which that does not end.

    Raises
    ------
    ArithmeticError
        The expression is not real or not defined.
    """
    if expr.is_Rational:
        return as_float(expr)
    if expr is sympy.pi:
        return math.pi
    if expr is sympy.E:
        return math.e
    numbers = [constant_number(arg) for arg in expr.args]
    if expr.is_Add:
        total = sum(numbers)
    elif expr.is_Mul:
        total = math.prod(numbers)
    elif expr.func not in _NUMBERS:
        raise ArithmeticError
    elif any(map(math.isinf, numbers)):
        return math.inf
    else:
        if isinstance(expr, sympy.Heaviside):
            numbers = numbers[:1]
        try:
            total = _NUMBERS[expr.func](*numbers)
        except OverflowError:
            return math.inf
        except ValueError as error:
            raise ArithmeticError from error
    return math.inf if math.isnan(total) else float(total)
