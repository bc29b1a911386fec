"""Derivatives of laws between their jumps."""

from __future__ import annotations

import sympy

__all__ = ["slope_between_jumps"]


def slope_between_jumps(expression: sympy.Expr, by: sympy.Symbol) -> sympy.Expr:
    """Differentiate an expression, without the impulses that a jump leaves; steps carry those.

    Examples
    --------
    >>> from rsgen.formula import parse, symbol
    >>> slope_between_jumps(parse("k*x + Ff*sign(v)"), symbol("v"))
    0
    """
    slope = expression.diff(by).replace(sympy.DiracDelta, lambda *_: sympy.Integer(0))
    # of sign(p**(1/3)) SymPy does not know that it is real, and leaves its derivative as it is
    return slope.replace(
        lambda part: isinstance(part, sympy.Derivative | sympy.Subs) and part.has(sympy.sign),
        lambda _: sympy.Integer(0),
    )
