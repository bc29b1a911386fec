"""Limits after every step: what has been read stays finite, real, and small enough for all later algebra."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType

import sympy

from rsgen.common.errors import ExpressionError
from rsgen.formula.names import Masing, Structural

__all__ = [
    "EXPONENT",
    "EXTREMES",
    "TERMS",
    "Value",
    "algebra_faults",
    "as_float",
    "check_finished",
    "check_power",
    "check_value",
    "decimal_value",
    "power_terms",
]


# ----------------------------------------------------------------------------
# Faults of the algebra library on texts that nobody would write: a refusal of the law, with its kind.

_LIBRARIES = ("sympy", "mpmath")


@contextmanager
def algebra_faults() -> Iterator[None]:
    """Turn a fault that the algebra library raises into a refusal of the law.

    It raises some on numbers that it cannot compare, such as the root of a number of 600 digits less another
    one, and calls itself without end on some nested cases.

    Raises
    ------
    ExpressionError
        The library raised; what rsgen raises itself passes as it is.
    """
    try:
        yield
    except MemoryError:
        raise
    except Exception as fault:
        # those of its polynomials and limits are of no class of Python's own
        if not isinstance(fault, RecursionError) and not _of_library(fault.__traceback__):
            raise
        raise ExpressionError(
            f"law: the algebra library cannot work it out ({type(fault).__name__}); write it with fewer "
            "cases or functions in each other, or with less extreme numbers"
        ) from fault


def _of_library(trace: TracebackType | None) -> bool:
    """Whether a fault began in the algebra library."""
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and str(trace.tb_frame.f_globals.get("__name__")).startswith(_LIBRARIES)


EXPONENT = 64
EXTREMES = 8
TERMS = 2000
_POWER_TERMS = 500  # of one power; it is multiplied out again and again while a law is derived
_BITS = 997  # of numerator and denominator: as many as 1e300 has
_RADICAND_BITS = 110  # SymPy factorises what stands under a root; 30 digits are quick
_VARYING = 1000  # SymPy works out 3**(x - n) digit by digit where it takes x for a number
_LARGEST = 1e300

_ALLOWED = (
    sympy.Symbol, sympy.Rational, sympy.core.numbers.Pi, sympy.core.numbers.Exp1, sympy.Add, sympy.Mul,
    sympy.Pow, sympy.Abs, sympy.sign, sympy.Min, sympy.Max, sympy.Heaviside, sympy.exp, sympy.log, sympy.sin,
    sympy.cos, sympy.tan, sympy.asin, sympy.acos, sympy.atan, sympy.atan2, sympy.sinh, sympy.cosh, sympy.tanh,
    sympy.besselj, sympy.besseli, sympy.gamma, sympy.Piecewise, Masing, Structural,
    sympy.functions.elementary.piecewise.ExprCondPair,
    sympy.StrictLessThan, sympy.LessThan, sympy.StrictGreaterThan, sympy.GreaterThan, sympy.And, sympy.Or,
    sympy.logic.boolalg.BooleanTrue,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Value:
    """A part of a formula as it has been read.

    ``number`` is the value of a constant as a float (inf where it exceeds the range of floats), None where
    states or parameters occur. ``terms`` bounds the number of terms after expansion and after splitting
    at every switch: products multiply it, so that nothing accepted can explode later.
    """

    expr: sympy.Expr
    number: float | None
    terms: int


def decimal_value(text: str) -> sympy.Rational:
    """The exact value of a decimal number."""
    mantissa, _, exponent = text.lower().partition("e")
    whole, _, fraction = mantissa.partition(".")
    power = int(exponent or 0) - len(fraction)
    digits = int(whole + fraction)
    return sympy.Rational(digits * 10 ** max(power, 0), 10 ** max(-power, 0))


def as_float(number: sympy.Rational) -> float:
    """The nearest float, inf beyond their range."""
    try:
        return int(number.p) / int(number.q)
    except OverflowError:
        return math.inf


def power_terms(base: Value, exponent: Value) -> int:
    """How many terms the expanded power has at most."""
    if exponent.number is None:
        return base.terms * exponent.terms
    whole = math.ceil(abs(exponent.number))
    return math.comb(base.terms + whole - 1, whole) if whole and base.terms > 1 else 1


def check_power(base: Value, exponent: Value) -> str | None:
    """What is wrong with a power before it is worked out; None where nothing is."""
    if base.expr == 0 and not (exponent.number is not None and exponent.number > 0):
        return "is a power of zero that is not defined"
    if exponent.number is None:
        if base.number is not None and base.number < 0:
            return "is a negative number to a power that is not always whole; it is not real"
        return _varying_fault(exponent.expr)
    if base.expr.is_Rational and exponent.number is not None:
        bits = max(int(base.expr.p).bit_length(), int(base.expr.q).bit_length())
        whole = exponent.expr.is_Integer
        if bits * abs(exponent.number) > _BITS or (not whole and bits > _RADICAND_BITS):
            return f"is a number with too many digits; keep it below {_LARGEST:g}"
    terms = power_terms(base, exponent)
    if terms > max(_POWER_TERMS, base.terms):
        return f"would have up to {terms} terms when expanded; a power may have {_POWER_TERMS}"
    return None


def _varying_fault(exponent: sympy.Expr) -> str | None:
    if any(abs(as_float(number)) > _VARYING for number in exponent.atoms(sympy.Rational)):
        return f"has a number above {_VARYING} in an exponent with names; write exp(...) if it is meant"
    return None


def _top(expr: sympy.Basic, levels: int) -> Iterator[sympy.Basic]:
    yield expr
    if levels:
        for arg in expr.args:
            yield from _top(arg, levels - 1)


def _fault_of(part: sympy.Basic) -> str | None:
    if part.is_Rational:
        bits = max(int(part.p).bit_length(), int(part.q).bit_length())
        if bits > _BITS or (part.p and not 1 / _LARGEST <= abs(as_float(part)) <= _LARGEST):
            return f"has a number out of range; numbers lie between {1 / _LARGEST:g} and {_LARGEST:g}"
    elif isinstance(part, sympy.Min | sympy.Max) and len(part.args) > EXTREMES:
        return f"has {len(part.args)} arguments in Min or Max; at most {EXTREMES} are allowed"
    elif part.is_Number or part is sympy.zoo:
        return "is not finite"
    elif part is sympy.I:
        return "is not real"
    elif part.is_Pow and part.exp.is_Rational:
        if abs(part.exp) > EXPONENT:
            return f"has the power {part.exp}; powers up to {EXPONENT} are allowed"
        if part.base.is_Rational and part.base.is_negative:
            return "is not real"
    return None


def check_value(expr: sympy.Expr, terms: int) -> str | None:
    """What is wrong with a part just built; None where it is finite, real and small enough.

    Only the top levels are looked at: what lies deeper was checked when it was built.
    """
    if terms > TERMS:
        number = terms if terms < 10**9 else "over 10^9"
        return f"would have up to {number} terms when expanded; at most {TERMS} are allowed"
    for part in _top(expr, 3):
        fault = _fault_of(part)
        if fault:
            return fault
    return None


def check_finished(expr: sympy.Expr) -> str | None:
    """What is wrong with a whole formula; None where every part of it belongs to the language."""
    for part in sympy.preorder_traversal(expr):
        fault = _fault_of(part)
        if fault:
            return fault
        if part.is_Pow and part.base == 0:
            return f"has the power {part}, which is not defined for every value"
        fault = _varying_fault(part.exp) if part.is_Pow and part.exp.free_symbols else None
        if fault:
            return fault
        if not isinstance(part, _ALLOWED):
            return "is not real for every value of its names; take abs() of what stands under a root"
    return None
