"""Expressions with other symbols; what is the same whatever its symbols are called is not evaluated anew."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import sympy

__all__ = ["free_symbols", "rebuilt", "renamed"]

_EXTREMES = (sympy.Max, sympy.Min)
"""To find the largest of several arguments anew takes seconds."""


@lru_cache(maxsize=4096)
def free_symbols(expression: sympy.Basic) -> frozenset[sympy.Basic]:
    """Symbols of an expression but for those over which it integrates.

    The library builds an integral anew to find its symbols, which takes a second where it holds extremes.
    """
    if isinstance(expression, sympy.Integral):
        found = free_symbols(expression.function)
        for variable, *ends in expression.limits:
            found = (found - {variable}).union(*map(free_symbols, ends))
        return found
    if isinstance(expression, sympy.Add | sympy.Mul | sympy.Pow):
        return frozenset().union(*map(free_symbols, expression.args))
    return frozenset(expression.free_symbols)


def rebuilt(
    expression: sympy.Basic, arguments: tuple[sympy.Basic, ...], as_written: tuple[type, ...] = _EXTREMES
) -> sympy.Basic:
    """Build an expression anew from its arguments; those of the classes ``as_written`` are not evaluated."""
    plain = {"evaluate": False} if isinstance(expression, as_written) else {}
    return expression.func(*arguments, **plain)


def renamed(
    expression: sympy.Expr,
    names: Mapping[sympy.Symbol, sympy.Symbol],
    as_written: tuple[type, ...] = _EXTREMES,
) -> sympy.Expr:
    """Give symbols new names, which may be the old ones; what holds one of them is built anew.

    Parameters
    ----------
    expression
        Whose symbols are renamed.
    names
        The new symbols by the old ones; others stay.
    as_written
        Classes that are not evaluated anew.
    """
    done: dict[sympy.Basic, sympy.Basic] = {}
    replaced = set(names)

    def new(part: sympy.Basic) -> sympy.Basic:
        if not part.args:
            return names.get(part, part)
        if part not in done:
            touched = not replaced.isdisjoint(free_symbols(part))
            done[part] = rebuilt(part, tuple(map(new, part.args)), as_written) if touched else part
        return done[part]

    return new(expression)
