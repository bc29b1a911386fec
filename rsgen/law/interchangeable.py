"""Equal terms of a law, such as two sliders: no test says which is which, so their values have an order."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations, permutations

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.law.normal_form import STATES
from rsgen.law.numeric import ForceLaw

__all__ = ["equal_terms", "in_order", "put_in_order"]

_MOST_NAMES = 4
"""Parameters that a term has for itself; of more the ways to pair two terms are too many to try."""

_MOST_TERMS = 40
"""Terms of a law that are compared, each with each."""

Group = tuple[tuple[str, ...], ...]


def equal_terms(force: sympy.Expr) -> tuple[Group, ...]:
    """Find terms of a sum that may change places: for each of them the names that it has for itself.

    Names of equal places in the terms are at equal places in the tuples.

    Examples
    --------
    >>> from rsgen.formula import parse
    >>> equal_terms(parse("k*x + masing(Min(ka*x, Fa)) + masing(Min(kb*x, Fb))"))
    ((('Fa', 'ka'), ('Fb', 'kb')),)
    >>> equal_terms(parse("k*x + c*v"))
    ()
    """
    terms = [term for term in sympy.Add.make_args(force) if len(term.free_symbols) > 1]
    groups: list[list[tuple[str, ...]]] = []
    if len(terms) > _MOST_TERMS:
        return ()
    for one, other in combinations(terms, 2):
        paired = _paired(force, one, other)
        if paired is None:
            continue
        mine, theirs = paired
        # the first of equal terms meets all others first, and its order of names is that of all
        known = next((group for group in groups if any(set(mine) == set(names) for names in group)), None)
        if known is None:
            groups.append([mine, theirs])
        elif not any(set(theirs) == set(names) for names in known):
            known.append(theirs)
    return tuple(tuple(group) for group in groups)


def _paired(force: sympy.Expr, one: sympy.Expr, other: sympy.Expr) -> Group | None:
    """Names of two terms in an order in which they may change places; None where they may not."""
    mine, theirs = (
        sorted(first.free_symbols - second.free_symbols, key=str)
        for first, second in ((one, other), (other, one))
    )
    # displacement and velocity are not of the law: a spring and a damper have different places
    if len(mine) != len(theirs) or not 0 < len(mine) <= _MOST_NAMES or not STATES.isdisjoint(mine + theirs):
        return None
    if len(mine) == 1 and one.coeff(mine[0]) * mine[0] == one:
        # only the sum of both acts
        return None
    for order in permutations(theirs):
        there = dict(zip(mine, order, strict=True))
        if one.xreplace(there) != other:
            continue
        both = {**there, **{theirs: mine for mine, theirs in there.items()}}
        if force.xreplace(both) == force:
            return tuple(str(name) for name in mine), tuple(str(name) for name in order)
    return None


def in_order(force: sympy.Expr, values: Mapping[str, float]) -> dict[str, float]:
    """Give the values of equal terms the order of their names: the first parameter of each grows.

    Parameters
    ----------
    force
        The law.
    values
        By name; terms with a name that has none stay as they are.

    Examples
    --------
    >>> from rsgen.formula import parse
    >>> law = parse("masing(Min(ka*x, Fa)) + masing(Min(kb*x, Fb))")
    >>> in_order(law, {"Fa": 9.0, "ka": 1.0, "Fb": 4.0, "kb": 2.0})
    {'Fa': 4.0, 'ka': 2.0, 'Fb': 9.0, 'kb': 1.0}
    """
    ordered = dict(values)
    for group in equal_terms(force):
        names = sorted(group)
        if all(name in values for each in names for name in each):
            rows = sorted(tuple(values[name] for name in each) for each in names)
            for each, row in zip(names, rows, strict=True):
                ordered.update(zip(each, row, strict=True))
    return ordered


def put_in_order(law: ForceLaw, values: Array) -> Array:
    """(p,) values of the parameters of a law, as ``in_order`` gives them."""
    return np.array(list(in_order(law.expression, dict(zip(law.parameters, values, strict=True))).values()))
