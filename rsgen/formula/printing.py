"""SymPy to text: formulas as a person types them, and what every written form of a formula has in common.

When parentheses are needed, where fractions stand; ``write`` gives the language that ``parse`` reads."""

from __future__ import annotations

import re
import sys
from abc import ABC, abstractmethod
from collections.abc import Sequence
from enum import IntEnum
from fractions import Fraction
from functools import lru_cache
from typing import ClassVar

import sympy

from rsgen.common.errors import ExpressionError, shown
from rsgen.formula.bounds import MAX_DERIVED_BITS, MAX_DIGITS
from rsgen.formula.names import STATES, Masing, State, Structural, free_symbols, symbol

# ----------------------------------------------------------------------------
# The order in which a person writes terms and factors: low degrees first, coefficients in front.

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
    """Decide whether x, v, X, X0, omega, t or F occurs."""
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
    """Decide whether a term is written with a minus sign in front."""
    coefficient = term.as_coeff_Mul()[0]
    return bool(coefficient.is_number and coefficient.is_negative)


def without_number(term: sympy.Expr) -> sympy.Expr:
    """The term without its sign and the number in front."""
    return term.as_coeff_Mul()[1]


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


def split_product(expr: sympy.Expr) -> tuple[sympy.Rational, list[sympy.Expr], list[sympy.Expr]]:
    """Separate number, factors and divisors of a term, in the order in which they are to be written."""
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
    return number, sorted(above, key=_place), sorted(below, key=_place)


def _by_names(factors: Sequence[sympy.Expr]) -> tuple[list[sympy.Expr], list[sympy.Expr]]:
    """Return the constants among factors, and those with names."""
    return [f for f in factors if not free_symbols(f)], [f for f in factors if free_symbols(f)]


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
    """The number below the line under which a sum is written, 1 where each term has its own."""
    below = {int(term.as_coeff_Mul()[0].q) if term.as_coeff_Mul()[0].is_Rational else 1 for term in expr.args}
    return below.pop() if len(below) == 1 else 1


def interval(relations: Sequence[sympy.Basic]) -> tuple[sympy.Basic | type[sympy.Basic], ...] | None:
    """Two comparisons of one thing from below and from above as lower, <, thing, <, upper; else None."""
    below = [part for part in relations if isinstance(part, sympy.Gt | sympy.Ge)]
    above = [part for part in relations if isinstance(part, sympy.Lt | sympy.Le)]
    if len(relations) != 2 or not below or not above or below[0].lhs != above[0].lhs:
        return None
    return below[0].rhs, _FLIPPED[below[0].func], below[0].lhs, above[0].func, above[0].rhs


_PLAIN_DIGITS = 6  # integers up to here, and decimals as long, are written without an exponent
_MAX_DENOMINATOR = 1024  # fractions of powers of two and the like are written as such up to here
_NAMES: dict[type[sympy.Basic], str] = {
    sympy.Abs: "abs", sympy.sign: "sign", sympy.Min: "Min", sympy.Max: "Max",
    sympy.exp: "exp", sympy.log: "log", sympy.sin: "sin", sympy.cos: "cos", sympy.tan: "tan",
    sympy.asin: "asin", sympy.acos: "acos", sympy.atan: "atan", sympy.atan2: "atan2", sympy.sinh: "sinh",
    sympy.cosh: "cosh", sympy.tanh: "tanh", sympy.besselj: "besselj", sympy.besseli: "besseli",
    sympy.gamma: "gamma", Masing: "masing", Structural: "structural",
}  # fmt: skip


class Level(IntEnum):
    """How tightly a written form holds together; what is looser than its surroundings needs parentheses."""

    ANY, SUM, PRODUCT, POWER, ATOM = range(5)


def _digits(number: sympy.Rational) -> tuple[str, int] | None:
    """Significant digits and decimal exponent of a positive number, None where it has no short decimal."""
    q, twos, fives = int(number.q), 0, 0
    while q % 2 == 0:
        q, twos = q // 2, twos + 1
    while q % 5 == 0:
        q, fives = q // 5, fives + 1
    if q != 1:
        return None
    places = max(twos, fives)
    whole = str(int(number.p) * 10**places // int(number.q))
    digits = whole.rstrip("0")
    return (digits, len(whole) - 1 - places) if len(digits) <= MAX_DIGITS else None


def decimal_text(number: sympy.Rational) -> tuple[str, str] | None:
    """Mantissa and exponent of a positive number that reads better as a decimal, else None.

    Examples
    --------
    >>> decimal_text(sympy.Rational(1, 10)), decimal_text(sympy.Rational(3, 4))
    (('0.1', ''), None)
    >>> decimal_text(sympy.Integer(4697) * 10**18)
    ('4.697', '21')
    """
    p, q = int(number.p), int(number.q)
    if max(p.bit_length(), q.bit_length()) > MAX_DERIVED_BITS:
        mantissa, _, power = str(sympy.Float(number, sys.float_info.dig)).partition("e")
        return mantissa.rstrip("0").rstrip("."), power.lstrip("+")
    if p < 10**_PLAIN_DIGITS and (q == 1 or (q % 5 and q <= _MAX_DENOMINATOR)):
        return None
    found = _digits(number)
    if found is None:
        return None
    digits, exponent = found
    if q == 1 and len(digits) > _PLAIN_DIGITS + 2:
        return None
    if 0 <= exponent < _PLAIN_DIGITS:
        whole, fraction = digits[: exponent + 1].ljust(exponent + 1, "0"), digits[exponent + 1 :]
        return whole + ("." + fraction if fraction else ""), ""
    if -4 <= exponent < 0:
        return "0." + "0" * (-exponent - 1) + digits, ""
    return digits[0] + ("." + digits[1:] if len(digits) > 1 else ""), str(exponent)


class Printer(ABC):
    """Writes an expression; the forms of products, powers, calls and cases are the subclass's own."""

    reads_back = False
    """True if ``parse`` must find the same expression: it multiplies a number or minus sign into a sum."""

    def write(self, expr: sympy.Basic, level: Level = Level.ANY) -> str:
        """The written form of any part of a formula, in parentheses where its surroundings need them."""
        text, own = _form(self, expr)
        if expr.is_Add and level <= Level.SUM:
            below = common_denominator(expr)
            if below != 1 and decimal_text(sympy.Rational(1, below)) is None:
                # above one fraction line
                return self.quotient([expr * below], [sympy.Integer(below)])
        return self.parenthesised(text) if own < level else text

    def form(self, expr: sympy.Basic) -> tuple[str, Level]:
        """Write a part of a formula, and say how tightly it holds together."""
        if isinstance(expr, sympy.Symbol | State):
            return self.name(expr.name), Level.ATOM
        if expr.is_Float:
            expr = sympy.Rational(repr(float(expr)))
        if expr is sympy.pi:
            return self.constant_pi(), Level.ATOM
        if expr is sympy.E:
            return self.call("exp", [sympy.Integer(1)])
        if expr.is_Add:
            return self._sum(expr), Level.SUM
        if expr.is_Mul or expr.is_Rational or (expr.is_Pow and expr.exp.is_Rational and expr.exp.is_negative):
            return self._term(expr)
        if expr.is_Pow:
            return self.power(expr.base, expr.exp)
        if isinstance(expr, sympy.Piecewise):
            return self.cases([(pair.expr, pair.cond) for pair in expr.args])
        if isinstance(expr, sympy.Heaviside) and expr.args[1] == sympy.Rational(1, 2):
            return self.call("Heaviside", expr.args[:1])
        if isinstance(expr, sympy.Min | sympy.Max):
            ordered = sorted(expr.args, key=lambda arg: (not free_symbols(arg), self.write(arg)))
            return self.call(_NAMES[expr.func], ordered)
        if expr.func in _NAMES:
            return self.call(_NAMES[expr.func], expr.args)
        return self.foreign(expr)

    def terms(self, expr: sympy.Expr) -> list[str]:
        """Write the terms of a sum, all but the first with their sign."""
        first, *others = split_sum(expr)
        return [
            self.write(first),
            *(
                f"- {self.write(-term, Level.PRODUCT)}"
                if is_negative(term)
                else f"+ {self.write(term, Level.PRODUCT)}"
                for term in others
            ),
        ]

    def _sum(self, expr: sympy.Expr) -> str:
        return " ".join(self.terms(expr))

    def _term(self, expr: sympy.Expr) -> tuple[str, Level]:
        signed, *halves = split_product(expr)
        (above, factors), (below, divisors) = map(_by_names, halves)
        number, negative = abs(signed), bool(signed < 0)
        if negative and self.reads_back:
            factors.sort(key=lambda factor: bool(factor.is_Add))
        decimal = decimal_text(number) is not None
        lead = [number] if decimal else [sympy.Integer(number.p)] if number.p != 1 else []
        under = [sympy.Integer(number.q)] if number.q != 1 and not decimal else []
        lower = [*below, *divisors]
        unmerged = self.reads_back and under and len(lower) == 1 and lower[0].is_Add
        whole = divisors or (factors and not lead and not above)
        if whole and not unmerged:
            upper = [*lead, *above, *factors]
            text = self.quotient(upper, [*under, *lower])
        else:
            upper = [*lead, *above] or factors
            split = [([*lead, *above], [*under, *below]), (factors, divisors)]
            text = self.juxtaposed([self.quotient(*half) for half in split if half[0] or half[1]] or ["1"])
        if negative:
            return self.negated(text, bool(upper) and bool(upper[0].is_Add) and not unmerged), Level.SUM
        return text, self._term_level([*lead, *above, *factors], [*under, *lower])

    def _term_level(self, upper: Sequence[sympy.Expr], lower: Sequence[sympy.Expr]) -> Level:
        if lower or len(upper) > 1:
            return Level.PRODUCT
        if not upper or upper[0].is_Rational:
            return self.number_level(upper[0]) if upper else Level.ATOM
        return _form(self, upper[0])[1]

    def condition(self, condition: sympy.Basic, inner: bool = False) -> str:
        """A condition of cases, the state on the left of each comparison, an interval as a < x < b."""
        if isinstance(condition, sympy.And | sympy.Or):
            both = isinstance(condition, sympy.And)
            parts = [oriented(part) for part in condition.args]
            between = interval(parts) if both else None
            if between:
                return self._chained(*between)
            text = (self.both if both else self.either).join(
                sorted(self.condition(part, inner=True) for part in parts)
            )
            return self.parenthesised(text) if inner else text
        if condition.func not in self.relations:
            return self.foreign(condition)[0]
        turned = oriented(condition)
        return self._chained(turned.lhs, turned.func, turned.rhs)

    def _chained(self, *parts: sympy.Basic | type[sympy.Basic]) -> str:
        return " ".join(
            self.relations[part] if isinstance(part, type) else self.write(part) for part in parts
        )

    both = " and "
    either = " or "
    relations: ClassVar[dict[type[sympy.Basic], str]] = {
        sympy.Lt: "<",
        sympy.Le: "<=",
        sympy.Gt: ">",
        sympy.Ge: ">=",
    }

    def number_level(self, number: sympy.Rational) -> Level:
        """How tightly a written positive number holds together."""
        return Level.ATOM

    def negated(self, text: str, sum_in_front: bool) -> str:
        """A minus sign in front of a product."""
        return "-" + text

    def parenthesised(self, text: str) -> str:
        """The text in parentheses."""
        return f"({text})"

    def constant_pi(self) -> str:
        """The ratio of circumference to diameter."""
        return "pi"

    def foreign(self, expr: sympy.Basic) -> tuple[str, Level]:
        """Refuse an expression that is not in the language."""
        raise ExpressionError(f"{shown(str(expr))} is not in the language of formulas")

    @abstractmethod
    def name(self, name: str) -> str:
        """A state or parameter."""

    @abstractmethod
    def number(self, number: sympy.Rational) -> str:
        """A positive integer or decimal."""

    def _factor(self, factor: sympy.Expr) -> str:
        return self.number(factor) if factor.is_Rational else self.write(factor, Level.POWER)

    @abstractmethod
    def juxtaposed(self, pieces: Sequence[str]) -> str:
        """The product of written pieces, none of which is a sum."""

    @abstractmethod
    def quotient(self, above: Sequence[sympy.Expr], below: Sequence[sympy.Expr]) -> str:
        """Factors above and below a fraction line; both may be empty."""

    @abstractmethod
    def power(self, base: sympy.Expr, exponent: sympy.Expr) -> tuple[str, Level]:
        """A power whose exponent is no negative number."""

    @abstractmethod
    def call(self, name: str, arguments: Sequence[sympy.Expr]) -> tuple[str, Level]:
        """A function of the language."""

    @abstractmethod
    def cases(self, branches: Sequence[tuple[sympy.Expr, sympy.Basic]]) -> tuple[str, Level]:
        """A formula in pieces; the last condition is true."""


@lru_cache(maxsize=4096)
def _form(printer: Printer, expr: sympy.Basic) -> tuple[str, Level]:
    """Write each part once: every level of a deep formula asks for its parts several times."""
    return printer.form(expr)


class TextPrinter(Printer):
    """Formulas on one line of plain text; ``times`` and ``raised`` stand between factors and for powers."""

    times = "*"
    raised = "**"
    reads_back = True

    def name(self, name: str) -> str:
        """As it is."""
        return name

    def number(self, number: sympy.Rational) -> str:
        """12, 0.75, 5.92e3; what has more digits than may be read is written as a sum of such numbers."""
        decimal = decimal_text(number)
        if decimal is not None:
            mantissa, exponent = decimal
            return f"{mantissa}e{exponent}" if exponent else mantissa
        digits = str(number)
        if len(digits) <= MAX_DIGITS:
            return digits
        groups = [
            (int(digits[max(0, end - MAX_DIGITS) : end]), len(digits) - end)
            for end in range(len(digits), 0, -MAX_DIGITS)
        ]
        return f"({' + '.join(f'{group}e{place}' for group, place in reversed(groups) if group)})"

    def juxtaposed(self, pieces: Sequence[str]) -> str:
        """a*b."""
        return self.times.join(pieces)

    def quotient(self, above: Sequence[sympy.Expr], below: Sequence[sympy.Expr]) -> str:
        """a*b/(c*d)."""
        top = self.times.join(self._factor(factor) for factor in above) or "1"
        if not below:
            return top
        bottom = self.times.join(self._factor(factor) for factor in below)
        return f"{top}/{bottom}" if len(below) == 1 else f"{top}/({bottom})"

    def negated(self, text: str, sum_in_front: bool) -> str:
        """-a*b; a sum in front would take the sign to itself when it is read."""
        return ("-1*" if sum_in_front else "-") + text

    def power(self, base: sympy.Expr, exponent: sympy.Expr) -> tuple[str, Level]:
        """sqrt(a), a**3, a**(1/3)."""
        if exponent == sympy.Rational(1, 2):
            return f"sqrt({self.write(base)})", Level.ATOM
        return self.write(base, Level.ATOM) + self.raised + self.write(exponent, Level.ATOM), Level.POWER

    def call(self, name: str, arguments: Sequence[sympy.Expr]) -> tuple[str, Level]:
        """sin(a)."""
        return f"{name}({', '.join(self.write(argument) for argument in arguments)})", Level.ATOM

    def cases(self, branches: Sequence[tuple[sympy.Expr, sympy.Basic]]) -> tuple[str, Level]:
        """Piecewise((a, x < b), (c, True))."""
        *conditional, (otherwise, last) = branches
        if last != True:  # noqa: E712  SymPy's true is equal to True, not the same
            raise ExpressionError("a Piecewise without a last branch (value, True) has no value everywhere")
        pairs = [f"({self.write(value)}, {self.condition(when)})" for value, when in conditional]
        return f"Piecewise({', '.join([*pairs, f'({self.write(otherwise)}, True)'])})", Level.ATOM


_PRINTER = TextPrinter()


def write(expr: sympy.Expr) -> str:
    """Write an expression in the language that ``parse`` reads.

    Parameters
    ----------
    expr
        An expression of states, parameters, exact or floating-point numbers and functions of the language.

    Returns
    -------
    str
        Text from which ``parse`` makes an equal expression: coefficients in front, low degrees first.

    Raises
    ------
    ExpressionError
        A part of the expression is not in the language (a derivative, an integral, infinity), or a Piecewise
        has no last branch for all other cases.

    Examples
    --------
    >>> from rsgen.formula.reading import parse
    >>> write(parse("X**2*kn1*3/4 + k1"))
    'k1 + 3/4*kn1*X**2'
    """
    return _PRINTER.write(sympy.sympify(expr, strict=True))
