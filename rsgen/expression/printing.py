"""What every written form of a formula has in common: when parentheses are needed, where fractions stand."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from decimal import Decimal
from enum import IntEnum
from typing import ClassVar

import sympy

from rsgen.errors import ExpressionError
from rsgen.expression.names import shown
from rsgen.expression.ordering import is_negative, oriented, split_product, split_sum

__all__ = ["Level", "Printer", "decimal_text"]

_PLAIN_DIGITS = 6  # integers up to here, and decimals as long, are written without an exponent
_EXACT_DIGITS = 30
_NAMES: dict[type[sympy.Basic], str] = {
    sympy.Abs: "abs", sympy.sign: "sign", sympy.Heaviside: "Heaviside", sympy.Min: "Min", sympy.Max: "Max",
    sympy.exp: "exp", sympy.log: "log", sympy.sin: "sin", sympy.cos: "cos", sympy.tan: "tan",
    sympy.asin: "asin", sympy.acos: "acos", sympy.atan: "atan", sympy.atan2: "atan2", sympy.sinh: "sinh",
    sympy.cosh: "cosh", sympy.tanh: "tanh", sympy.besselj: "besselj", sympy.besseli: "besseli",
    sympy.gamma: "gamma",
}  # fmt: skip


class Level(IntEnum):
    """How tightly a written form holds together; what is looser than its surroundings needs parentheses."""

    ANY = 0
    SUM = 1
    PRODUCT = 2
    POWER = 3
    ATOM = 4


def _decimal(number: sympy.Rational) -> Decimal | None:
    """The number as an exact decimal, None where it has none of a reasonable length."""
    q, twos, fives = int(number.q), 0, 0
    while q % 2 == 0:
        q, twos = q // 2, twos + 1
    while q % 5 == 0:
        q, fives = q // 5, fives + 1
    if q != 1:
        return None
    places = max(twos, fives)
    digits = int(number.p) * 10**places // int(number.q)
    text = str(abs(digits)).rstrip("0")
    if len(text) > _EXACT_DIGITS:
        return None
    return Decimal((int(digits < 0), tuple(map(int, str(abs(digits)))), -places)).normalize()


def decimal_text(number: sympy.Rational) -> tuple[str, str] | None:
    """Mantissa and exponent of a number that reads better as a decimal than as a fraction, else None.

    Examples
    --------
    >>> decimal_text(sympy.Rational(1, 10)), decimal_text(sympy.Rational(3, 4))
    (('0.1', ''), None)
    >>> decimal_text(sympy.Integer(4697) * 10**18)
    ('4.697', '21')
    """
    p, q = int(number.p), int(number.q)
    short = abs(p) < 10**_PLAIN_DIGITS and q < 10**_PLAIN_DIGITS
    if short and (q == 1 or (q % 5 and q <= 1024)):
        return None
    value = None if short and q % 5 else _decimal(number)
    if value is None:
        return None
    digits = "".join(map(str, value.as_tuple().digits))
    exponent = value.adjusted()
    if q == 1 and len(digits) > _PLAIN_DIGITS + 2:
        return None
    if -4 <= exponent < _PLAIN_DIGITS:
        return f"{value:f}", ""
    sign = "-" if value < 0 else ""
    return sign + digits[0] + ("." + digits[1:] if len(digits) > 1 else ""), str(exponent)


class Printer(ABC):
    """Writes an expression; the forms of products, powers, calls and cases are the subclass's own."""

    separable_number = False
    """Whether a number below the line must not stand beside a single sum (reading would multiply it out)."""

    def write(self, expr: sympy.Basic, level: Level = Level.ANY) -> str:
        """The written form of any part of a formula, in parentheses where its surroundings need them."""
        text, own = self._form(expr)
        return self.parenthesised(text) if own < level else text

    def _form(self, expr: sympy.Basic) -> tuple[str, Level]:
        if isinstance(expr, sympy.Symbol):
            return self.name(expr.name), Level.ATOM
        if expr.is_Float:
            expr = sympy.Rational(repr(float(expr)))
        if expr is sympy.pi:
            return self.constant_pi(), Level.ATOM
        if expr is sympy.E:
            return self.call("exp", [sympy.Integer(1)]), Level.ATOM
        if expr.is_Add:
            return self._sum(expr), Level.SUM
        if expr.is_Mul or expr.is_Rational or (expr.is_Pow and expr.exp.is_Rational and expr.exp.is_negative):
            return self._term(expr)
        if expr.is_Pow:
            return self.power(expr.base, expr.exp)
        if isinstance(expr, sympy.Piecewise):
            if expr.args[-1].cond != True:  # noqa: E712  SymPy's true is equal to True, not the same
                raise ExpressionError(f"{shown(str(expr))} has no value where none of its conditions holds")
            return self.cases([(pair.expr, pair.cond) for pair in expr.args])
        if isinstance(expr, sympy.Heaviside) and expr.args[1] != sympy.Rational(1, 2):
            raise ExpressionError(f"{shown(str(expr))} is not in the language; only Heaviside(0) = 1/2 is")
        if expr.func in _NAMES:
            args = list(expr.args)
            if isinstance(expr, sympy.Heaviside):
                args = args[:1]
            elif isinstance(expr, sympy.Min | sympy.Max):
                args.sort(key=lambda arg: (not arg.free_symbols, self.write(arg)))
            return self.call(_NAMES[expr.func], args), Level.ATOM
        raise ExpressionError(f"{shown(str(expr))} is not in the language of formulas")

    def _sum(self, expr: sympy.Expr) -> str:
        text = ""
        for term in split_sum(expr):
            if not text:
                text = self.write(term)
            elif is_negative(term):
                text += " - " + self.write(-term, Level.PRODUCT)
            else:
                text += " + " + self.write(term, Level.PRODUCT)
        return text

    def _term(self, expr: sympy.Expr) -> tuple[str, Level]:
        product = split_product(expr)
        above, below = list(product.constants), list(product.constants_below)
        number = product.number
        scientific = decimal_text(number)
        p, q = (
            (number, sympy.Integer(1)) if scientific else (sympy.Integer(number.p), sympy.Integer(number.q))
        )
        fraction_below = [*below, *product.factors_below]
        apart = self.separable_number and q != 1 and len(fraction_below) == 1 and fraction_below[0].is_Add
        lead = [p] if p != 1 else []
        under = [q] if q != 1 else []
        pieces: list[str] = []
        one_line = product.factors_below or (product.factors and not lead and not above)
        if one_line and not apart:
            pieces.append(self.quotient([*lead, *above, *product.factors], [*under, *fraction_below]))
        else:
            if lead or under or above or below:
                pieces.append(self.quotient([*lead, *above], [*under, *below]))
            if product.factors or product.factors_below:
                pieces.append(self.quotient(list(product.factors), list(product.factors_below)))
        if not pieces:
            pieces = [self.number(sympy.Integer(1))]
        text = self.juxtaposed(pieces)
        if product.negative:
            return self.negated(
                text, product.factors if not (lead or under or above or below) else ()
            ), Level.SUM
        return text, self._term_level(lead, under, above, below, product.factors, product.factors_below)

    def _term_level(self, *groups: Sequence[sympy.Expr]) -> Level:
        lead, under, above, below, factors, factors_below = groups
        alone = [*lead, *above, *factors]
        if under or below or factors_below or len(alone) > 1:
            return Level.PRODUCT
        if alone and not alone[0].is_Rational:
            return self._form(alone[0])[1]
        return self.number_level(alone[0]) if alone else Level.ATOM

    def condition(self, condition: sympy.Basic, inner: bool = False) -> str:
        """A condition of cases, the state on the left of each comparison."""
        if isinstance(condition, sympy.And | sympy.Or):
            word = self.both if isinstance(condition, sympy.And) else self.either
            parts = sorted(self.condition(part, inner=True) for part in condition.args)
            text = word.join(parts)
            return self.parenthesised(text) if inner else text
        if not isinstance(condition, sympy.Lt | sympy.Le | sympy.Gt | sympy.Ge):
            raise ExpressionError(f"the condition {shown(str(condition))} is not in the language of formulas")
        turned = oriented(condition)
        return f"{self.write(turned.lhs)} {self.relations[turned.func]} {self.write(turned.rhs)}"

    both = " and "
    either = " or "
    relations: ClassVar[dict[type[sympy.Basic], str]] = {
        sympy.Lt: "<",
        sympy.Le: "<=",
        sympy.Gt: ">",
        sympy.Ge: ">=",
    }

    def negated(self, text: str, factors: Sequence[sympy.Expr]) -> str:
        """A minus sign in front of a product that begins with ``factors[0]``, if there is one."""
        return "-" + text

    def number_level(self, number: sympy.Rational) -> Level:
        """How tightly a written positive number holds together."""
        return Level.ATOM

    def parenthesised(self, text: str) -> str:
        """The text in parentheses."""
        return f"({text})"

    def constant_pi(self) -> str:
        """The ratio of circumference to diameter."""
        return "pi"

    @abstractmethod
    def name(self, name: str) -> str:
        """A state or parameter."""

    @abstractmethod
    def number(self, number: sympy.Rational) -> str:
        """A positive integer or decimal."""

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
    def call(self, name: str, arguments: Sequence[sympy.Expr]) -> str:
        """A function of the language."""

    @abstractmethod
    def cases(self, branches: Sequence[tuple[sympy.Expr, sympy.Basic]]) -> tuple[str, Level]:
        """A formula in pieces; the last condition is true."""
