"""SymPy expressions as numpy functions: the one way from formulas to numbers."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Sequence
from functools import lru_cache
from math import isfinite
from typing import Any

import numpy as np
import sympy
from sympy.core.relational import Relational
from sympy.printing.numpy import SciPyPrinter

from rsgen.common.arrays import Array
from rsgen.formula.bounds import as_float
from rsgen.formula.names import rebuilt, renamed

Numeric = Callable[..., tuple[Array, ...]]

_MAX_WHOLE = 2**sys.float_info.mant_dig
"""Whole numbers beyond this are printed as floats: numpy has no functions of Python's large integers."""

_MAX_PRODUCT_POWER = 8
"""Powers of a name up to this are printed as products, which arrays take ten times quicker."""

_AS_WRITTEN = (sympy.Expr, Relational)
"""An expression to be printed needs no evaluation, which may take seconds."""


def _printer() -> Any:
    """Make a printer that writes Max, Min, conditions and cases so that numbers and arrays may meet."""
    printer = SciPyPrinter(
        {"fully_qualified_modules": False, "inline": True, "allow_unknown_functions": False}
    )
    general = printer._print_Pow

    def nested(name: str, arguments: tuple[sympy.Expr, ...]) -> str:
        text: str = printer._print(arguments[0])
        for argument in arguments[1:]:
            text = f"{printer._module_format('numpy.' + name)}({text}, {printer._print(argument)})"
        return text

    def cases(expr: sympy.Piecewise) -> str:
        text = printer._module_format("numpy.nan")
        for value, condition in reversed(expr.args):
            where = printer._module_format("numpy.where")
            text = f"{where}({printer._print(condition)}, {printer._print(value)}, {text})"
        return str(text)

    def product(power: sympy.Pow, **settings: Any) -> str:
        if power.base.is_Symbol and power.exp.is_Integer and 2 <= power.exp <= _MAX_PRODUCT_POWER:
            return "(" + "*".join([printer._print(power.base)] * int(power.exp)) + ")"
        return str(general(power, **settings))

    def whole(number: sympy.Integer) -> str:
        return str(int(number)) if abs(int(number)) <= _MAX_WHOLE else decimal(number)

    def quotient(number: sympy.Rational) -> str:
        small = max(abs(int(number.p)), int(number.q)) <= _MAX_WHOLE
        return f"({int(number.p)}/{int(number.q)})" if small else decimal(number)

    def decimal(number: sympy.Rational) -> str:
        size = as_float(abs(number))
        text = repr(size) if isfinite(size) else printer._module_format("numpy.inf")
        return f"(-{text})" if number < 0 else text

    # SymPy finds the way to print a class by these names
    printer._print_Integer = whole
    printer._print_Rational = quotient
    printer._print_Max = lambda expr: nested("maximum", expr.args)
    printer._print_Min = lambda expr: nested("minimum", expr.args)
    printer._print_And = lambda expr: nested("logical_and", expr.args)
    printer._print_Or = lambda expr: nested("logical_or", expr.args)
    printer._print_Piecewise = cases
    printer._print_Pow = product
    # a pole that was found by hand, as of log(0)/0: no number has its sign
    printer._print_ComplexInfinity = lambda expr: printer._module_format("numpy.nan")
    # laws are real; of a Bessel function of what may be negative SymPy does not know it
    printer._print_conjugate = lambda expr: printer._print(expr.args[0])
    printer._print_Heaviside = lambda expr: nested("heaviside", (expr.args[0], sympy.Rational(1, 2)))
    return printer


def _shared(
    expressions: Sequence[sympy.Basic],
) -> tuple[list[tuple[sympy.Symbol, sympy.Basic]], list[sympy.Basic]]:
    """Name what occurs several times, each before it is used."""
    counts: Counter[sympy.Basic] = Counter()

    def count(expression: sympy.Basic) -> None:
        counts[expression] += 1
        if counts[expression] == 1:
            for argument in expression.args:
                count(argument)

    for expression in expressions:
        count(expression)
    named: list[tuple[sympy.Symbol, sympy.Basic]] = []
    done: dict[sympy.Basic, sympy.Basic] = {}

    def written(expression: sympy.Basic) -> sympy.Basic:
        if not expression.args:
            return expression
        if expression not in done:
            arguments = tuple(map(written, expression.args))
            same = arguments == expression.args
            whole = expression if same else rebuilt(expression, arguments, _AS_WRITTEN)
            if counts[expression] > 1 and isinstance(expression, sympy.Expr):
                name = sympy.Symbol(f"s{len(named)}", real=True)
                named.append((name, whole))
                whole = name
            done[expression] = whole
        return done[expression]

    return named, [written(expression) for expression in expressions]


def _real(value: Any) -> Array:
    """Return values as real numbers; a complex one, as of acos(2) + x, becomes nan."""
    array = np.asarray(value)
    if not np.iscomplexobj(array):
        return np.asarray(array, dtype=np.float64)
    return np.where(array.imag == 0, array.real, np.nan)


@lru_cache(maxsize=512)
def compiled(expressions: tuple[sympy.Expr, ...], arguments: tuple[sympy.Symbol, ...]) -> Numeric:
    """Compile expressions of some symbols into one vectorised function of as many arrays.

    Infinite and undefined values come back as inf and nan, without warnings.
    """
    names = {argument: sympy.Symbol(f"p{place}", real=True) for place, argument in enumerate(arguments)}
    own = [renamed(expression, names, _AS_WRITTEN) for expression in expressions]
    # the printer names the functions it uses; a module here would be imported whole
    constants = {"inf": np.inf, "nan": np.nan}
    # no docstring: the formula would be written there, with numbers of thousands of digits
    function: Any = sympy.lambdify(
        list(names.values()), own, modules=[constants], printer=_printer(), cse=_shared, docstring_limit=0
    )

    def evaluate(*values: Any) -> tuple[Array, ...]:
        # a power of Python's own numbers beyond the range of a double is an error, not infinite
        places = (value if isinstance(value, np.ndarray) else np.float64(value) for value in values)
        with np.errstate(all="ignore"):
            return tuple(map(_real, function(*places)))

    return evaluate
