"""SymPy expressions as plain arithmetic in Python source; powers become multiplications."""

from __future__ import annotations

from collections.abc import Mapping

import sympy
from sympy.core.relational import Relational

from rsgen.common.errors import ExpressionError

__all__ = ["Body"]

# every function of the expression language that may stand in a law; the value is what the source calls
_FUNCTIONS = {
    sympy.sin: "math.sin",
    sympy.cos: "math.cos",
    sympy.tan: "math.tan",
    sympy.sinh: "math.sinh",
    sympy.cosh: "math.cosh",
    sympy.tanh: "math.tanh",
    sympy.exp: "math.exp",
    sympy.log: "math.log",
    sympy.asin: "math.asin",
    sympy.acos: "math.acos",
    sympy.atan: "math.atan",
    sympy.atan2: "math.atan2",
    sympy.Abs: "abs",
}
_LARGEST_CHAIN = 64  # beyond this integer powers are left to the power function


class Body:
    """Statements of a function and the expressions that use them; every name in it is made by rsgen.

    Parameters
    ----------
    names
        The source name of each symbol; a symbol without one is an error.
    inline
        Everything in one expression, no statements.
    """

    def __init__(self, names: Mapping[sympy.Symbol, str], *, inline: bool = False) -> None:
        self.lines: list[str] = []
        self._inline = inline
        self._names = dict(names)
        self._powers: dict[tuple[str, int], str] = {}

    def name(self, symbol: sympy.Symbol, source: str) -> None:
        """Let a symbol stand for a source name from here on."""
        self._names[symbol] = source

    def assign(self, name: str, code: str) -> None:
        """Add a statement."""
        self.lines.append(f"{name} = {code}")

    def write(self, expression: sympy.Expr) -> str:
        """Write an expression as source; statements for powers are added as needed.

        Raises
        ------
        ExpressionError
            A function occurs that no law may use.
        """
        if isinstance(expression, sympy.Symbol):
            name: str = self._names[expression]
            return name
        if expression.is_number and not expression.has(*_FUNCTIONS):
            value = float(expression)
            return repr(value) if value >= 0 else f"({value!r})"
        if isinstance(expression, sympy.Add):
            return self._sum(expression)
        if isinstance(expression, sympy.Mul):
            return self._product(expression)
        if isinstance(expression, sympy.Pow):
            return self._power(expression.base, expression.exp)
        return self._function(expression)

    def _sum(self, expression: sympy.Expr) -> str:
        text = ""
        for term in expression.as_ordered_terms():
            factor, rest = term.as_coeff_Mul()
            negative = bool(factor.is_negative)
            code = self.write(-factor * rest if negative else term)
            if not text:
                text = f"-{code}" if negative else code
            else:
                text += f" - {code}" if negative else f" + {code}"
        return f"({text})"

    def _product(self, expression: sympy.Expr) -> str:
        above, below = [], []
        for factor in expression.as_ordered_factors():
            if isinstance(factor, sympy.Pow) and factor.exp.is_number and factor.exp.is_negative:
                below.append(self._power(factor.base, -factor.exp))
            else:
                above.append(self.write(factor))
        if above and above[0] == "(-1.0)" and len(above) > 1:
            del above[0]
            above[0] = f"(-{above[0]})"
        text = "*".join(above) or "1.0"
        return text if not below else f"{text}/({'*'.join(below)})"

    def _power(self, base: sympy.Expr, exponent: sympy.Expr) -> str:
        if exponent.is_Integer and exponent.is_negative:
            return f"(1.0/{self._power(base, -exponent)})"
        code = self.write(base)
        if exponent.is_Integer and int(exponent) <= _LARGEST_CHAIN:
            return self._chain(code, int(exponent))
        if exponent == sympy.Rational(1, 2):
            # a frozen mode is carried a little past the place where it ends: the root stays real there
            return f"math.sqrt(max({code}, 0.0))"
        twice = 2 * exponent
        if twice.is_Integer and twice.is_positive and int(twice) <= _LARGEST_CHAIN:
            whole = int(twice) // 2
            return f"{self._chain(code, whole)}*math.sqrt(max({code}, 0.0))"
        if exponent.is_Integer:
            return f"({code})**{int(exponent)}"
        return f"max({code}, 0.0)**{self.write(exponent)}"

    def _chain(self, code: str, exponent: int) -> str:
        if exponent == 0:
            return "1.0"
        if exponent == 1:
            return code
        if self._inline:
            return f"({'*'.join([code] * exponent)})"
        if not code.isidentifier():
            name = f"b{len(self.lines)}"
            self.assign(name, code)
            code = name
        if (code, exponent) not in self._powers:
            half = self._chain(code, exponent // 2)
            product = f"{half}*{half}" if exponent % 2 == 0 else f"{self._chain(code, exponent - 1)}*{code}"
            name = f"{code}_{exponent}"
            self.assign(name, product)
            self._powers[code, exponent] = name
        return self._powers[code, exponent]

    def _function(self, expression: sympy.Expr) -> str:
        kind = expression.func
        arguments = expression.args
        if kind in _FUNCTIONS:
            return f"{_FUNCTIONS[kind]}({', '.join(self.write(a) for a in arguments)})"
        if kind in (sympy.Max, sympy.Min):
            call = "max" if kind is sympy.Max else "min"
            text = self.write(arguments[0])
            for argument in arguments[1:]:
                text = f"{call}({text}, {self.write(argument)})"
            return text
        if kind is sympy.sign:
            code = self.write(arguments[0])
            return f"(1.0 if {code} > 0.0 else (-1.0 if {code} < 0.0 else 0.0))"
        if kind is sympy.Heaviside:
            return f"(1.0 if {self.write(arguments[0])} > 0.0 else 0.0)"
        if kind is sympy.Piecewise:
            return self._piecewise(arguments)
        raise ExpressionError(
            f"{expression}: {kind.__name__} has no place in a force law; allowed: "
            f"{', '.join(sorted(f.__name__ for f in _FUNCTIONS))}, Max, Min, sign, Heaviside, Piecewise"
        )

    def _piecewise(self, arguments: tuple[sympy.Basic, ...]) -> str:
        text = "math.nan"
        for value, condition in reversed([tuple(pair.args) for pair in arguments]):
            code = self.write(value)
            text = (
                code if condition == sympy.true else f"({code} if {self._condition(condition)} else {text})"
            )
        return text

    def _condition(self, condition: sympy.Basic) -> str:
        if isinstance(condition, Relational) and condition.rel_op in ("<", "<=", ">", ">="):
            return f"({self.write(condition.lhs)} {condition.rel_op} {self.write(condition.rhs)})"
        if isinstance(condition, (sympy.And, sympy.Or)):
            word = " and " if isinstance(condition, sympy.And) else " or "
            return f"({word.join(self._condition(part) for part in condition.args)})"
        if isinstance(condition, sympy.Not):
            return f"(not {self._condition(condition.args[0])})"
        raise ExpressionError(f"{condition}: no condition of a force law; allowed: <, <=, >, >=, and, or")
