"""SymPy to text: formulas as a person types them, in the language that ``parse`` reads."""

from __future__ import annotations

import sympy

__all__ = ["write"]


def write(expr: sympy.Expr) -> str:
    """Write an expression in the language that ``parse`` reads."""
    return str(expr)
