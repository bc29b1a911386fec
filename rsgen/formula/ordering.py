"""The order in which a person writes terms and factors: low degrees first, coefficients in front."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import sympy

from rsgen.formula.names import STATES, symbol
from rsgen.formula.renaming import free_symbols

__all__ = [
    "Product",
    "common_denominator",
    "depends_on_state",
    "interval",
    "is_negative",
    "natural",
    "oriented",
    "split_product",
    "split_sum",
]

_AMPLITUDES = frozenset(symbol(name) for name in ("x", "v", "X", "X0"))
_STATE_SYMBOLS = frozenset(symbol(name) for name in STATES)
_STATE_ORDER = {symbol(name): place for place, name in enumerate(("t", "F", "omega", "X0", "X", "x", "v"))}
_LAST = Fraction(1000)
_JUMP = Fraction(11, 10)  # c*v + Ff*sign(v): a jump is written after the linear term
_FLIPPED = {sympy.Lt: sympy.Gt, sympy.Gt: sympy.Lt, sympy.Le: sympy.Ge, sympy.Ge: sympy.Le}


def natural(text: str) -> list[tuple[int, int, str]]:
    """A sorting key by which k2 comes before k10."""
    return [
        (0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"([0-9]+)", text) if part
    ]


def depends_on_state(expr: sympy.Basic) -> bool:
    """Whether x, v, X, X0, omega, t or F occurs."""
    return not _STATE_SYMBOLS.isdisjoint(free_symbols(expr))


def _degree(expr: sympy.Basic) -> Fraction:
    """How fast a term grows with the amplitude, roughly: only the order of terms depends on it."""
    if expr in _AMPLITUDES:
        return Fraction(1)
    if expr.is_Mul:
        return sum((_degree(factor) for factor in expr.args), Fraction(0))
    if expr.is_Add or isinstance(expr, sympy.Min | sympy.Max):
        return max(_degree(term) for term in expr.args)
    if expr.is_Pow:
        inner = _degree(expr.base)
        if expr.exp.is_Rational:
            return inner * Fraction(int(expr.exp.p), int(expr.exp.q))
        return Fraction(10) if inner or depends_on_state(expr.exp) else Fraction(0)
    if isinstance(expr, sympy.Abs):
        return _degree(expr.args[0])
    if isinstance(expr, sympy.Piecewise):
        return _LAST
    if isinstance(expr, sympy.sign | sympy.Heaviside):
        return _JUMP if depends_on_state(expr) else Fraction(0)
    return Fraction(1) if expr.args and depends_on_state(expr) else Fraction(0)


def split_sum(expr: sympy.Expr) -> list[sympy.Expr]:
    """The terms of a sum in a person's order; a positive one comes first where there is any.

    Low degrees come first, k1 + 3/4*kn1*X**2, but states come before bare parameters, x**2 + b**2.
    """
    terms = sympy.Add.make_args(expr)
    named = [term for term in terms if free_symbols(term)]
    with_state = [term for term in named if depends_on_state(term)]
    states_first = len(with_state) < len(named) and all(
        free_symbols(term) <= _STATE_SYMBOLS for term in with_state
    )
    terms = sorted(
        terms,
        key=lambda term: (
            term.is_number,
            -abs(_degree(term)) if states_first else abs(_degree(term)),
            term.has(sympy.Function),
            natural(str(without_number(term))),
        ),
    )
    first = next((term for term in terms if not is_negative(term)), terms[0])
    terms.remove(first)
    return [first, *terms]


def is_negative(term: sympy.Expr) -> bool:
    """Whether a term is written with a minus sign in front."""
    coefficient = term.as_coeff_Mul()[0]
    return bool(coefficient.is_number and coefficient.is_negative)


def without_number(term: sympy.Expr) -> sympy.Expr:
    """The term without its sign and the number in front."""
    return term.as_coeff_Mul()[1]


@dataclass(frozen=True, slots=True)
class Product:
    """A term as sign, number, constant and remaining factors, above and below the fraction line."""

    negative: bool
    number: sympy.Rational
    constants: tuple[sympy.Expr, ...]
    constants_below: tuple[sympy.Expr, ...]
    factors: tuple[sympy.Expr, ...]
    factors_below: tuple[sympy.Expr, ...]


def _place(factor: sympy.Expr) -> tuple[int, int, list[tuple[int, int, str]]]:
    base = factor.base if factor.is_Pow else factor
    if base in _STATE_ORDER:
        kind = 2
    elif base.is_Symbol:
        kind = 0
    elif isinstance(base, sympy.sign | sympy.Heaviside | sympy.Piecewise):
        kind = 6 if isinstance(base, sympy.Piecewise) else 5
    elif base.is_Add:
        kind = 4 if depends_on_state(base) else 1
    else:
        kind = 3
    return kind, _STATE_ORDER.get(base, 0), natural(str(factor))


def split_product(expr: sympy.Expr) -> Product:
    """Take a term apart as it is to be written."""
    number = sympy.Integer(1)
    above: list[sympy.Expr] = []
    below: list[sympy.Expr] = []
    for factor in sympy.Mul.make_args(expr):
        if factor.is_Rational:
            number *= factor
        elif factor.is_Pow and factor.exp.is_Rational and factor.exp.is_negative:
            below.append(sympy.Pow(factor.base, -factor.exp))
        else:
            above.append(factor)
    above.sort(key=_place)
    below.sort(key=_place)
    return Product(
        negative=bool(number < 0),
        number=abs(number),
        constants=tuple(factor for factor in above if not free_symbols(factor)),
        constants_below=tuple(factor for factor in below if not free_symbols(factor)),
        factors=tuple(factor for factor in above if free_symbols(factor)),
        factors_below=tuple(factor for factor in below if free_symbols(factor)),
    )


def oriented(relation: sympy.Basic) -> sympy.Basic:
    """A comparison with the state on its left and without a minus sign: x > -b rather than -x < b."""
    if relation.func not in _FLIPPED:
        return relation
    if depends_on_state(relation.rhs) and not depends_on_state(relation.lhs):
        relation = _FLIPPED[relation.func](relation.rhs, relation.lhs, evaluate=False)
    if not relation.lhs.is_Add and is_negative(relation.lhs):
        relation = _FLIPPED[relation.func](-relation.lhs, -relation.rhs, evaluate=False)
    return relation


def common_denominator(expr: sympy.Expr) -> int:
    """The number below the line under which a sum is written, 1 where its terms stay apart."""
    below = {int(term.as_coeff_Mul()[0].q) if term.as_coeff_Mul()[0].is_Rational else 1 for term in expr.args}
    return below.pop() if len(below) == 1 else 1


def interval(relations: Sequence[sympy.Basic]) -> tuple[sympy.Basic | type[sympy.Basic], ...] | None:
    """Two comparisons of one thing from below and from above as lower, <, thing, <, upper; else None."""
    below = [part for part in relations if isinstance(part, sympy.Gt | sympy.Ge)]
    above = [part for part in relations if isinstance(part, sympy.Lt | sympy.Le)]
    if len(relations) != 2 or not below or not above or below[0].lhs != above[0].lhs:
        return None
    return below[0].rhs, _FLIPPED[below[0].func], below[0].lhs, above[0].func, above[0].rhs
