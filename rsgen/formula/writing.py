"""SymPy to text: formulas as a person types them, in the language that ``parse`` reads."""

from __future__ import annotations

from collections.abc import Sequence

import sympy

from rsgen.common.errors import ExpressionError
from rsgen.formula.printing import Level, Printer, decimal_text
from rsgen.formula.scanning import DIGITS

__all__ = ["TextPrinter", "write"]


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
        if len(digits) <= DIGITS:
            return digits
        groups = [
            (int(digits[max(0, end - DIGITS) : end]), len(digits) - end)
            for end in range(len(digits), 0, -DIGITS)
        ]
        return f"({' + '.join(f'{group}e{place}' for group, place in reversed(groups) if group)})"

    def _factor(self, factor: sympy.Expr) -> str:
        return self.number(factor) if factor.is_Rational else self.write(factor, Level.POWER)

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
    >>> from rsgen.formula import parse
    >>> write(parse("X**2*kn1*3/4 + k1"))
    'k1 + 3/4*kn1*X**2'
    """
    return _PRINTER.write(sympy.sympify(expr, strict=True))
