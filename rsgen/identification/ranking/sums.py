"""What a ranking sums up: the laws of the library without their linear spring and damper.

Every candidate has the base ``k*x + c*v``; a law of the library adds what is left of it without that, so that
each of them stands for one idea and sums of them do not count the base twice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import permutations

import sympy

from rsgen.formula import parse, symbol
from rsgen.law.element import Element, Law, Range, Search, make_element
from rsgen.law.library import laws
from rsgen.law.memory import memory_form, rates_of
from rsgen.law.numeric import ForceLaw, compile_law
from rsgen.law.pieces import normal_form

__all__ = ["Sum", "Term", "base_law", "library_terms", "terms_of"]


@dataclass(frozen=True)
class Term:
    """What one law of the library adds to the linear spring and damper."""

    source: Law
    how: Search

    @property
    def name(self) -> str:
        """Name of the law."""
        return self.source.name

    @property
    def search(self) -> Mapping[str, Range]:
        """Parameters in which the term is not linear."""
        return self.how.ranges

    @cached_property
    def law(self) -> ForceLaw:
        """The term, compiled for arrays."""
        return compile_law(self.source.added)

    @cached_property
    def linear(self) -> tuple[str, ...]:
        """Parameters in which the term is linear; the others move the part of the last one only."""
        return tuple(name for name in self.law.parameters if name not in self.search)


def base_law() -> ForceLaw:
    """The linear damper and spring that every sum has; their coefficients in this order."""
    return compile_law(parse("c*v + k*x"))


@lru_cache(maxsize=1)
def library_terms() -> tuple[Term, ...]:
    """Give the terms of all laws of the library, each once."""
    return tuple(Term(law, law.search) for law in laws if law.search is not None)


@lru_cache(maxsize=256)
def terms_of(force: sympy.Expr) -> frozenset[str]:
    """Give the terms that the linear parameters multiply, in normal form: the same whatever their names.

    With the equations of states: without them all laws with a state would be one.
    """
    law = compile_law(force)
    # a blank: no parameter has such a name
    states = {z: sympy.Symbol(f"z {number}", real=True) for number, z in enumerate(rates_of(force))}
    found = []
    for order in permutations(law.nonlinear):
        names = {symbol(law.parameters[i]): symbol(f"p{rank}") for rank, i in enumerate(order)}
        plain = force.xreplace(names | states)
        parts = [plain.diff(symbol(law.parameters[i])) for i in law.linear]
        parts.append(plain.xreplace({symbol(law.parameters[i]): sympy.S.Zero for i in law.linear}))
        positive = frozenset(map(str, names.values()))
        memory = memory_form(plain)
        rates = () if memory is None else memory.rates
        found.append(
            sorted(str(normal_form(part, positive).expression) for part in parts)
            + [f"{each.symbol}' = {normal_form(each.rate, positive).expression}" for each in rates]
        )
    return frozenset(min(found))


@dataclass(frozen=True)
class Sum:
    """A candidate: the base and some terms, parameters renamed so that each name stands once.

    Parameters
    ----------
    terms
        None for the base alone.
    """

    terms: tuple[Term, ...]

    @property
    def name(self) -> str:
        """Names of the laws in it."""
        return " + ".join(term.name for term in self.terms) or "linear-spring + linear-damper"

    @property
    def has_spring(self) -> bool:
        """Whether the linear spring is in it."""
        return not any(term.how.spring for term in self.terms)

    @cached_property
    def names(self) -> tuple[dict[str, str], ...]:
        """New name of every parameter of every term."""
        taken = {"k", "c", "m"} if self.has_spring else {"c", "m"}
        renamed = []
        for term in self.terms:
            row = {}
            for name in term.law.parameters:
                new = name
                while new in taken:
                    new += "_"
                taken.add(new)
                row[name] = new
            renamed.append(row)
        return tuple(renamed)

    @cached_property
    def elements(self) -> tuple[Element, ...]:
        """Springs and dampers, ready for a model."""
        base = [make_element("linear-spring", "k*x")] if self.has_spring else []
        base.append(make_element("linear-damper", "c*v"))
        for term, names in zip(self.terms, self.names, strict=True):
            places = {symbol(old): symbol(new) for old, new in names.items()}
            base.append(make_element(term.name, term.source.added.xreplace(places)))
        return tuple(base)

    def limits(self, size: float, speed: float) -> dict[str, tuple[float, float]]:
        """Limits [SI] of the parameters it is not linear in, at largest displacement and velocity."""
        limits = {}
        for term, names in zip(self.terms, self.names, strict=True):
            for name, where in term.search.items():
                factor = where.factor(size, speed)
                limits[names[name]] = (where.limits[0] * factor, where.limits[1] * factor)
        return limits

    @property
    def dissipates(self) -> tuple[tuple[str, ...], ...]:
        """Parameters whose sum must not be negative."""
        return tuple(
            tuple(names[name] for name in group)
            for term, names in zip(self.terms, self.names, strict=True)
            for group in term.how.dissipates
        )
