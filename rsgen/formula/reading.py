"""Text to SymPy: an allow-list walker over Python's syntax tree; no text is ever evaluated."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import mpmath
import sympy

from rsgen.common.errors import ExpressionError, shown
from rsgen.formula.bounds import (
    MAX_CHOICES,
    MAX_DEPTH,
    MAX_EXPONENT,
    Value,
    as_float,
    check_finished,
    check_power,
    check_value,
    decimal_value,
    power_terms,
    refusal,
    scan,
)
from rsgen.formula.names import CONSTANTS, FUNCTIONS, Masing, Structural, closest, symbol

# ----------------------------------------------------------------------------
# What was probably meant by a name or function that the language does not have.

_MAX_LISTED_NAMES = 20
_SPELLING = {
    "sgn": "sign", "signum": "sign", "fabs": "abs", "step": "Heaviside", "heaviside": "Heaviside",
    "arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2", "tg": "tan", "sh": "sinh",
    "ch": "cosh", "th": "tanh", "piecewise": "Piecewise", "where": "Piecewise", "max": "Max", "min": "Min",
    "jv": "besselj", "iv": "besseli", "Gamma": "gamma",
}  # fmt: skip
_REPLACED = {
    "pow": "write a**b", "power": "write a**b", "log10": "write log(a)/log(10)",
    "log2": "write log(a)/log(2)", "cbrt": "write sign(a)*abs(a)**(1/3)", "square": "write a**2",
    "factorial": "write gamma(n + 1)", "cot": "write 1/tan(a)", "sec": "write 1/cos(a)",
    "clip": "write Min(Max(a, lower), upper)", "float": "write the number itself",
    "int": "write the number itself",
}  # fmt: skip


def unknown_name(name: str, known: Collection[str]) -> str:
    """The message for a name that is not among the known ones."""
    if name in FUNCTIONS:
        return f"{name} is a function; write {name}(...)"
    names = sorted(known)
    meant = closest(name, names)
    listed = ", ".join(names[:_MAX_LISTED_NAMES]) + (", ..." if len(names) > _MAX_LISTED_NAMES else "")
    return (
        f"the name {shown(name)} is not known here"
        + (f", did you mean '{meant}'?" if meant else "")
        + (f"; known: {listed}" if names else "; no names are known")
    )


def unknown_function(name: str, known: Collection[str]) -> str:
    """The message for a call of what is not a function of the language."""
    if name in known:
        return f"{shown(name)} is a name, not a function; write {name[:40]}*(...) for a product"
    if name in CONSTANTS:
        return f"{name} is a number, not a function; write {name}*(...) for a product"
    meant = _SPELLING.get(name) or closest(name, FUNCTIONS)
    hint = f", did you mean '{meant}'?" if meant else ""
    hint = f"; {_REPLACED[name]}" if name in _REPLACED else hint or f"; write {name[:40]}*(...) for a product"
    return f"{shown(name)} is not a function of formulas{hint}; allowed are {', '.join(FUNCTIONS)}"


# ----------------------------------------------------------------------------
# The functions of the language: how SymPy makes them, how a float sees them, how they are written.

_MAX_BESSEL_ARGUMENT = 1000.0
_MAX_NESTED_FUNCTIONS = (
    6  # SymPy asks of roots in functions in roots whether they are real: each takes ten times the last
)
_SWITCHING = (sympy.Abs, sympy.sign, sympy.Min, sympy.Max, sympy.Heaviside, sympy.Piecewise, Masing)


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
    terms: Callable[[Sequence[int]], int] = math.prod
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
    "Min": Function(sympy.Min, min, 2, MAX_CHOICES, f"Min(a, b), at most {MAX_CHOICES}", _chosen),
    "Max": Function(sympy.Max, max, 2, MAX_CHOICES, f"Max(a, b), at most {MAX_CHOICES}", _chosen),
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
"""Another function needs its name in ``names.FUNCTIONS``, too, its class in ``bounds._ALLOWED``, in the table
of ``printing``, in ``functions`` of the LaTeX of ``law/notation`` and in ``_EVEN`` or ``_ODD`` of
``law/rewriting``; for compiled tests its names in
``dynamics/kernel_source`` and ``dynamics/kernel``."""


@lru_cache(maxsize=4096)
def _nested(expr: sympy.Basic) -> int:
    """How many smooth functions and roots of what is not constant stand in each other."""
    inside = max(map(_nested, expr.args), default=0)
    smooth = isinstance(expr, sympy.Function) and not isinstance(expr, _SWITCHING)
    root = expr.is_Pow and not expr.exp.is_Integer
    return inside + int(bool(expr.free_symbols) and (smooth or root))


def check_arguments(name: str, values: Sequence[Value]) -> str | None:
    """Return the fault of the arguments before the function is worked out, or None."""
    numbers = [value.number for value in values]
    if any(number is not None and math.isinf(number) for number in numbers):
        return "is a function of a number beyond 1e308"
    if max(_nested(value.expr) for value in values) >= _MAX_NESTED_FUNCTIONS:
        return f"has more than {_MAX_NESTED_FUNCTIONS} functions in each other"
    if name == "gamma" and numbers[0] is not None and abs(numbers[0]) > MAX_EXPONENT:
        return f"is out of range; numbers up to {MAX_EXPONENT} are allowed in gamma"
    if (
        name in ("sqrt", "log", "ln")
        and values[0].expr.is_Rational
        and int(values[0].expr.q).bit_length() > 110
    ):
        return "is a function of a number with too many digits"
    if name in ("besselj", "besseli"):
        order, argument = numbers
        if order is None or not values[0].expr.is_Integer or abs(order) > MAX_EXPONENT:
            return f"has no whole number up to {MAX_EXPONENT} as its order; write {name}(1, a)"
        if argument is not None and abs(argument) > _MAX_BESSEL_ARGUMENT:
            return f"is out of range; numbers up to {_MAX_BESSEL_ARGUMENT:g} are allowed in {name}"
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


_MAX_PARTS = 400
_MAX_COMPARISONS = 16

_COMPARE: dict[type[ast.cmpop], Callable[..., Any]] = {
    ast.Lt: sympy.Lt,
    ast.LtE: sympy.Le,
    ast.Gt: sympy.Gt,
    ast.GtE: sympy.Ge,
}
_SYMPY_FAULTS = (ArithmeticError, AttributeError, LookupError, NotImplementedError, TypeError, ValueError)
"""Errors of SymPy while it builds an expression at values for which a function is not defined."""


def parse(text: str, names: Collection[str] | None = None) -> sympy.Expr:
    """Read a formula without ever evaluating its text.

    Parameters
    ----------
    text
        The formula: numbers, names, + - * / **, parentheses, pi, and the functions abs, sign, Min, Max,
        Heaviside, sqrt, exp, log (ln), sin, cos, tan, asin, acos, atan, atan2, sinh, cosh, tanh, besselj,
        besseli, gamma and Piecewise((value, condition), ..., (value, True)). Conditions are comparisons with
        < <= > >=, joined by ``and``, ``or``.
    names
        The names that may occur; None allows every legal name.

    Returns
    -------
    sympy.Expr
        The formula with exact numbers ("0.75" is 3/4) and the symbols that ``symbol`` makes.

    Raises
    ------
    ExpressionError
        The text is not in the language, not finite and real, or larger than later stages could handle; the
        message names what was found, the column, and what is allowed.

    Examples
    --------
    >>> parse("0.75*k*x*abs(x)")
    3*k*x*Abs(x)/4
    >>> parse("k*x + Ff*sgn(v)")
    Traceback (most recent call last):
    ...
    rsgen.common.errors.ExpressionError: column 10: 'sgn' is not a function of formulas, did you mean...
    """
    source = scan(text)
    start = len(source) - len(source.lstrip(" "))
    stripped = source.strip(" ")
    try:
        tree = ast.parse(stripped, mode="eval")
    except SyntaxError as error:
        column = min(max(error.offset or 1, 1), len(stripped))
        raise refusal(
            start + column,
            f"cannot be read at {shown(stripped[column - 1 :])}; write a formula such as k*x**3",
        ) from None
    except (ValueError, MemoryError, RecursionError):
        raise ExpressionError(f"the formula {shown(stripped)} is nested too deeply to be read") from None
    try:
        return _Reader(stripped, start, names).read(tree.body)
    except RecursionError:
        raise ExpressionError(f"the formula {shown(stripped)} is nested too deeply to be read") from None


@dataclass(slots=True)
class _Reader:
    source: str
    start: int
    names: Collection[str] | None

    def read(self, node: ast.expr) -> sympy.Expr:
        count = sum(isinstance(part, ast.expr) for part in ast.walk(node))
        if count > _MAX_PARTS:
            raise ExpressionError(f"a formula of {count} parts; at most {_MAX_PARTS} are allowed")
        value = self.value(node, 1)
        fault = check_finished(value.expr)
        if fault:
            raise ExpressionError(f"the formula {shown(self.source)} {fault}")
        return value.expr

    def fault(self, node: ast.expr, text: str) -> ExpressionError:
        return refusal(self.start + node.col_offset + 1, text)

    def snippet(self, node: ast.expr) -> str:
        return shown(self.source[node.col_offset : node.end_col_offset])

    def built(self, node: ast.expr, make: Callable[..., Any], *args: Any) -> Any:
        try:
            return make(*args)
        except _SYMPY_FAULTS:
            raise self.fault(node, f"{self.snippet(node)} has no finite real value") from None

    def checked(self, node: ast.expr, expr: sympy.Expr, terms: int) -> Value:
        fault = check_value(expr, terms)
        if fault:
            raise self.fault(node, f"{self.snippet(node)} {fault}")
        try:
            return Value(expr, constant_number(expr) if expr.is_number else None, terms)
        except ArithmeticError:
            raise self.fault(node, f"{self.snippet(node)} has no finite real value") from None

    def check_depth(self, node: ast.expr, depth: int) -> None:
        if depth > MAX_DEPTH:
            allowed = f"at most {MAX_DEPTH} levels are allowed"
            raise self.fault(node, f"nested more than {MAX_DEPTH} deep; {allowed}")

    def value(self, node: ast.expr, depth: int) -> Value:
        self.check_depth(node, depth)
        match node:
            case ast.Constant():
                return self.number(node)
            case ast.Name():
                return self.name(node)
            case ast.UnaryOp(op=ast.USub() | ast.UAdd()):
                inner = self.value(node.operand, depth + 1)
                if isinstance(node.op, ast.UAdd):
                    return inner
                return self.checked(node, -inner.expr, inner.terms)
            case ast.BinOp(op=ast.Add() | ast.Sub()):
                return self.sum(node, depth)
            case ast.BinOp(op=ast.Mult() | ast.Div()):
                return self.product(node, depth)
            case ast.BinOp(op=ast.Pow()):
                return self.power(node, depth)
            case ast.Call():
                return self.call(node, depth)
            case ast.BinOp(op=ast.BitAnd() | ast.BitOr()):
                raise self.fault(
                    node,
                    f"{self.snippet(node)} joins no conditions; & and | stand in conditions only, between "
                    "comparisons in parentheses: (x < b) & (v > 0)",
                )
            case ast.Compare() | ast.BoolOp():
                raise self.fault(
                    node,
                    f"the condition {self.snippet(node)} stands outside Piecewise; "
                    "write Piecewise((value, condition), ..., (value, True))",
                )
            case _:
                raise self.fault(
                    node,
                    f"{self.snippet(node)} has no meaning in formulas; allowed are numbers, names, "
                    f"+ - * / **, ( ) and calls of {', '.join(FUNCTIONS)}",
                )

    def number(self, node: ast.Constant) -> Value:
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            where = "; it stands only as the last condition in Piecewise" if node.value is True else ""
            raise self.fault(node, f"{self.snippet(node)} is not a number{where}")
        return self.checked(node, decimal_value(self.source[node.col_offset : node.end_col_offset]), 1)

    def name(self, node: ast.Name) -> Value:
        name = node.id
        if name in CONSTANTS:
            return Value(sympy.pi, math.pi, 1)
        if self.names is not None and name not in self.names:
            raise self.fault(node, unknown_name(name, self.names or ()))
        try:
            return Value(symbol(name), None, 1)
        except ExpressionError as error:
            wanted = f"; write {name}(...)" if name in FUNCTION_TABLE else ""
            raise self.fault(node, f"{error}{wanted}") from None

    def chain(
        self, node: ast.BinOp, kinds: tuple[type[ast.operator], ...], depth: int
    ) -> list[tuple[ast.operator | None, ast.expr, Value]]:
        """The operands of a + b - c ... (or a * b / c ...) from left to right, a long chain as one level."""
        links: list[tuple[ast.operator, ast.expr]] = []
        left: ast.expr = node
        while isinstance(left, ast.BinOp) and isinstance(left.op, kinds):
            links.append((left.op, left.right))
            left = left.left
        first = (None, left, self.value(left, depth + 1))
        return [first, *((op, right, self.value(right, depth + 1)) for op, right in reversed(links))]

    def sum(self, node: ast.BinOp, depth: int) -> Value:
        terms: list[sympy.Expr] = []
        count = 0
        for op, _, value in self.chain(node, (ast.Add, ast.Sub), depth):
            terms.append(-value.expr if isinstance(op, ast.Sub) else value.expr)
            count += value.terms
        return self.checked(node, self.built(node, sympy.Add, *terms), count)

    def product(self, node: ast.BinOp, depth: int) -> Value:
        factors: list[sympy.Expr] = []
        count = 1
        for op, where, value in self.chain(node, (ast.Mult, ast.Div), depth):
            divide = isinstance(op, ast.Div)
            if divide and value.expr == 0:
                raise self.fault(where, f"division by {self.snippet(where)}, which is zero")
            factors.append(1 / value.expr if divide else value.expr)
            count *= value.terms
        return self.checked(node, self.built(node, sympy.Mul, *factors), count)

    def power(self, node: ast.BinOp, depth: int) -> Value:
        base, exponent = self.value(node.left, depth + 1), self.value(node.right, depth + 1)
        if exponent.number is not None and not abs(exponent.number) <= MAX_EXPONENT:
            raise self.fault(node.right, f"the exponent {self.snippet(node.right)} is above {MAX_EXPONENT}")
        fault = check_power(base, exponent)
        if fault:
            raise self.fault(node, f"{self.snippet(node)} {fault}")
        expr = self.built(node, sympy.Pow, base.expr, exponent.expr)
        if expr.is_Mul:  # SymPy leaves products inside this product
            expr = sympy.Mul(*(inner for factor in expr.args for inner in sympy.Mul.make_args(factor)))
        return self.checked(node, expr, power_terms(base, exponent))

    def call(self, node: ast.Call, depth: int) -> Value:
        if not isinstance(node.func, ast.Name):
            raise self.fault(node, f"{self.snippet(node.func)} cannot be called; write * for a product")
        name = node.func.id
        if name != "Piecewise" and name not in FUNCTION_TABLE:
            raise self.fault(node, unknown_function(name, self.names or ()))
        if node.keywords or any(isinstance(arg, ast.Starred) for arg in node.args):
            raise self.fault(node, f"{name} takes plain arguments only; write {name}(a)")
        if name == "Piecewise":
            return self.piecewise(node, depth)
        function = FUNCTION_TABLE[name]
        if not function.fewest <= len(node.args) <= function.most:
            raise self.fault(node, f"{name} with {len(node.args)} arguments; write {function.usage}")
        values = [self.value(arg, depth + 1) for arg in node.args]
        fault = check_arguments(name, values)
        if fault:
            raise self.fault(node, f"{self.snippet(node)} {fault}")
        expr = self.built(node, function.make, *(value.expr for value in values))
        return self.checked(node, expr, function.terms([value.terms for value in values]))

    def piecewise(self, node: ast.Call, depth: int) -> Value:
        usage = "write Piecewise((value, condition), ..., (value, True))"
        if not node.args:
            raise self.fault(node, f"Piecewise without branches; {usage}")
        pairs: list[tuple[sympy.Expr, Any]] = []
        comparisons = terms = 0
        last = len(node.args) - 1
        for index, branch in enumerate(node.args):
            if not isinstance(branch, ast.Tuple) or len(branch.elts) != 2:
                raise self.fault(branch, f"{self.snippet(branch)} is no branch of Piecewise; {usage}")
            outcome, when = branch.elts
            always = isinstance(when, ast.Constant) and when.value is True
            if always != (index == last):
                wrong = "a branch after True never acts" if always else "the last condition must be True"
                raise self.fault(when, f"{wrong}; {usage}")
            value = self.value(outcome, depth + 1)
            condition, compared, weight = (sympy.true, 0, 1) if always else self.condition(when, depth + 1)
            comparisons += compared
            if comparisons > _MAX_COMPARISONS:
                raise self.fault(when, f"more than {_MAX_COMPARISONS} comparisons in one Piecewise")
            pairs.append((value.expr, condition))
            terms += value.terms * weight
        expr = self.built(node, sympy.Piecewise, *pairs)
        return self.checked(node, expr, terms)

    def condition(self, node: ast.expr, depth: int) -> tuple[Any, int, int]:
        """A condition, how many comparisons it has, and how many terms stand on their sides."""
        self.check_depth(node, depth)
        match node:
            case ast.BoolOp():
                parts, both = node.values, isinstance(node.op, ast.And)
            case ast.BinOp(op=ast.BitAnd() | ast.BitOr()):
                parts, both = [node.left, node.right], isinstance(node.op, ast.BitAnd)
            case ast.Compare():
                return self.comparison(node, depth)
            case _:
                raise self.fault(
                    node,
                    f"{self.snippet(node)} is no condition; write comparisons such as x < b, joined by and, "
                    "or (with & and | each comparison needs its parentheses)",
                )
        found = [self.condition(part, depth + 1) for part in parts]
        compared = sum(part[1] for part in found)
        if compared > _MAX_COMPARISONS:
            raise self.fault(node, f"more than {_MAX_COMPARISONS} comparisons in one Piecewise")
        joined = self.built(node, sympy.And if both else sympy.Or, *(part[0] for part in found))
        return joined, compared, sum(part[2] for part in found)

    def comparison(self, node: ast.Compare, depth: int) -> tuple[Any, int, int]:
        if len(node.ops) > 2 or any(type(op) not in _COMPARE for op in node.ops):
            raise self.fault(
                node, f"the comparison {self.snippet(node)}; allowed are a < b, <=, >, >=, a < b < c"
            )
        sides = [self.value(side, depth + 1) for side in (node.left, *node.comparators)]
        for side, where in zip(sides, (node.left, *node.comparators), strict=True):
            if side.expr.has(sympy.Piecewise):
                raise self.fault(
                    where, f"Piecewise inside the condition {self.snippet(node)}; write it outside"
                )
            if side.number is not None and math.isinf(side.number):
                raise self.fault(where, f"the number {self.snippet(where)} is too large to be compared")
        links = [
            self.built(node, _COMPARE[type(op)], left.expr, right.expr)
            for op, left, right in zip(node.ops, sides, sides[1:], strict=False)
        ]
        joined = links[0] if len(links) == 1 else self.built(node, sympy.And, *links)
        return joined, len(links), sum(side.terms for side in sides)
