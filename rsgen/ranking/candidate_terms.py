"""What a law can be made of: the laws of the library without their linear spring and damper.

Every candidate has the base ``k*x + c*v``; a law of the library adds what is left of it without that, so that
each of them stands for one idea and sums of them do not count the base twice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.expression import parse, symbol
from rsgen.law.element import Element, make_element
from rsgen.law.library import find_law
from rsgen.law.numeric import ForceLaw, compile_law

__all__ = ["Range", "Sum", "Term", "library_terms"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Range:
    """Where a parameter that the law is not linear in is looked for.

    Parameters
    ----------
    scale
        "x": values are shares of the largest displacement; "v": of the largest velocity; "1/x": of the
        inverse of the largest displacement; "1": as they are.
    values
        Values to start from.
    limits
        Beyond these it changes the law into another one, or leaves the tested range.
    """

    scale: str
    values: tuple[float, ...]
    limits: tuple[float, float]

    def factor(self, size: float, speed: float) -> float:
        """SI value of 1 at largest displacement [m] and velocity [m/s]."""
        return {"x": size, "v": speed, "1/x": 1 / size, "1": 1.0}[self.scale]


@dataclass(frozen=True)
class Term:
    """What one law of the library adds to the linear spring and damper.

    Parameters
    ----------
    name
        Of the law.
    force
        What it adds [N]; parameter names are those of the law.
    search
        Parameters in which the term is not linear.
    own_spring
        True where the law has a stiffness at rest of its own: the linear spring is then left out.
    dissipates
        Parameters whose sum must not be negative: friction that feeds energy is no candidate.
    also
        Other laws of the library that are the same beside a linear spring.
    """

    name: str
    force: sympy.Expr
    search: Mapping[str, Range]
    own_spring: bool = False
    dissipates: tuple[tuple[str, ...], ...] = ()
    also: tuple[str, ...] = ()

    @cached_property
    def law(self) -> ForceLaw:
        """The term, compiled for arrays."""
        return compile_law(self.force)

    @property
    def linear(self) -> tuple[str, ...]:
        """Parameters in which the term is linear; the others move the part of the last one only."""
        return tuple(name for name in self.law.parameters if name not in self.search)


_SIDE = Range("x", tuple(np.linspace(0.1, 0.9, 6)), (0.02, 0.99))
_SPEED = Range("v", tuple(np.geomspace(0.01, 1.0, 9)), (0.003, 3.0))
_POWER = Range("1", (0.3, 0.6, 1.4, 1.8, 2.2, 2.6, 3.5, 4.0, 6.0, 7.0), (0.1, 9.0))
_WAVE = Range("1/x", tuple(np.geomspace(0.4, 2.8, 8)), (0.1, 5.0))

# name of the law, what it adds where that is written otherwise than in the library, its search
_ROWS: tuple[tuple[str, str | None, dict[str, Range]], ...] = (
    ("cubic-spring", None, {}),
    ("quintic-spring", None, {}),
    ("quadratic-spring", None, {}),
    (
        "odd-power-spring",
        None,
        {"p": _POWER},
    ),
    ("joint-polynomial", None, {}),
    ("hertz-contact", None, {}),
    ("pendulum", None, {"a": _WAVE}),
    ("sinh-spring", None, {"a": _WAVE}),
    ("tanh-joint", "Fs*tanh(x/xs)", {"xs": Range("x", tuple(np.geomspace(0.08, 1.2, 8)), (0.02, 4.0))}),
    ("preload", None, {}),
    ("dead-zone", None, {"b": Range("x", tuple(np.linspace(0.08, 0.96, 12)), (0.02, 0.99))}),
    ("bilinear-spring", "kb*Max(0, x)", {}),
    ("one-sided-stop", None, {"b": Range("x", tuple(np.linspace(-0.96, 0.96, 13)), (-0.99, 0.99))}),
    ("two-sided-stop", None, {"b1": _SIDE, "b2": _SIDE}),
    ("quadratic-damper", None, {}),
    ("power-damper", None, {"p": Range("1", (0.2, 0.4, 0.6, 1.4, 1.7, 2.4, 3.0, 4.0), (0.05, 6.0))}),
    ("coulomb", None, {}),
    ("tanh-friction", None, {"vs": _SPEED}),
    ("stribeck", "(Fc + Fd*exp(-abs(v)/vs))*sign(v)", {"vs": _SPEED}),
    ("stribeck-gauss", "(Fc + Fd*exp(-(v/vs)**2))*sign(v)", {"vs": _SPEED}),
    ("van-der-pol", "cx*x**2*v", {}),
    ("displacement-friction", None, {}),
)

_OWN_SPRING = ("pendulum", "sinh-spring")
_DISSIPATES = {
    "coulomb": (("Ff",),),
    "tanh-friction": (("Ff",),),
    "stribeck": (("Fc",), ("Fc", "Fd")),
    "stribeck-gauss": (("Fc",), ("Fc", "Fd")),
}
_ALSO = {"dead-zone": ("piecewise-spring", "saturation")}


def _without_base(force: sympy.Expr) -> sympy.Expr:
    """Take off what is a linear spring or damper of its own."""
    states = (symbol("x"), symbol("v"))
    for parameter in sorted(force.free_symbols - set(states), key=str):
        if force.diff(parameter) in states:
            force = force.subs(parameter, 0)
    return force


@lru_cache(maxsize=1)
def library_terms() -> tuple[Term, ...]:
    """Give the terms of all laws of the library, each once."""
    return tuple(
        Term(
            name,
            _without_base(find_law(name).element().force) if formula is None else parse(formula),
            search,
            name in _OWN_SPRING,
            _DISSIPATES.get(name, ()),
            _ALSO.get(name, ()),
        )
        for name, formula, search in _ROWS
    )


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
        return not any(term.own_spring for term in self.terms)

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
            base.append(make_element(term.name, term.force.xreplace(places)))
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
            for group in term.dissipates
        )
