"""Sums of laws of the library: their terms, and the linear elements that every sum has.

Between two sensors the terms act on the joint, which has a linear spring and damper as the ground has.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from itertools import permutations

import sympy

from rsgen.common.tolerances import ANY_LAW
from rsgen.formula.names import Masing, remembers, symbol
from rsgen.law.element import Element, Law, as_elements, laws, make_element
from rsgen.law.library import Range, Search
from rsgen.law.memory import rates_of, real_powers
from rsgen.law.normal_form import normal_form
from rsgen.law.numeric import ForceLaw, compile_law


@dataclass(frozen=True)
class Term:
    """A law of the library without its linear spring and damper; of -x where it is ``mirrored``."""

    source: Law
    how: Search
    mirrored: bool = False

    @property
    def name(self) -> str:
        """Name of the law."""
        return self.source.name

    @property
    def search(self) -> Mapping[str, Range]:
        """Parameters in which the term is not linear."""
        return self.how.ranges

    @property
    def remembers(self) -> bool:
        """True if the force has a memory; no term is compiled for that."""
        return remembers(self.source.force)

    @cached_property
    def force(self) -> sympy.Expr:
        """n(x, v) [N] of the term; that of its mirror image is -n(-x, -v)."""
        if not self.mirrored:
            return self.source.added
        image = -self.source.added.xreplace({symbol(state): -symbol(state) for state in "xv"})
        return image.replace(sympy.Max, lambda *parts: -sympy.Min(*(-part for part in parts)))

    @cached_property
    def law(self) -> ForceLaw:
        """The term, compiled for arrays."""
        return compile_law(self.force)

    @cached_property
    def linear(self) -> tuple[str, ...]:
        """Parameters in which the term is linear; the others scale the force of the last one only."""
        return tuple(name for name in self.law.parameters if name not in self.search)


_SURROGATES = (f"{ANY_LAW} + Ff*sign(v)", ANY_LAW)


def surrogates(sensors: str) -> list[tuple[Element, ...]]:
    """Return surrogates of any law, with friction and without, with which the first background is fitted.

    Between two sensors the ground is linear.
    """
    if not sensors:
        return [as_elements(law) for law in _SURROGATES]
    ground = tuple(base_elements("").values())
    joints = (law.replace("k*x", "kj*x").replace("c*v", "cj*v") for law in _SURROGATES)
    return [(*ground, make_element("joint", joint, across=sensors)) for joint in joints]


@cache
def base_elements(sensors: str) -> Mapping[str, Element]:
    """Return the linear dampers and springs of every sum by parameter, those of a joint with the others."""
    base = {"c": make_element("linear-damper", "c*v"), "k": make_element("linear-spring", "k*x")}
    if sensors:
        base["cj"] = make_element("joint-damper", "cj*v", across=sensors)
        base["kj"] = make_element("joint-spring", "kj*x", across=sensors)
    return base


@lru_cache(maxsize=1)
def library_terms() -> tuple[Term, ...]:
    """Return the terms of all laws of the library."""
    return tuple(Term(law, law.search) for law in laws if law.search is not None)


@lru_cache(maxsize=512)
def whole_name(name: str, sensors: str = "") -> str:
    """Return the name of a sum followed by the linear springs and dampers that its laws do not hold.

    A law holds one where it has a parameter more than what it adds.

    Examples
    --------
    >>> whole_name("cubic-spring + coulomb")
    'cubic-spring + coulomb + linear-damper'
    """
    terms = tuple(term for term in library_terms() if term.name in name.split(" + "))
    whole = [term.source for term in terms if len(term.source.parameters) > len(term.law.parameters)]
    held = {symbol("v" if law.force.has(symbol("v")) else "x") for law in whole}
    base = Sum(terms, sensors).base.values() if terms else ()
    more = [one.name for one in base if one.across != sensors or not held & one.force.free_symbols]
    return " + ".join([name, *more])


@lru_cache(maxsize=256)
def terms_of(force: sympy.Expr) -> frozenset[str]:
    """Return what the linear parameters multiply, in a normal form that does not depend on names.

    The equations of states are part of it, and virgin curves: laws with a memory differ in nothing else.
    """
    force = force.xreplace({Masing(sympy.S.Zero): sympy.S.Zero})
    law = compile_law(force)
    # a blank: no parameter has such a name
    states = {z: sympy.Symbol(f"z {number}", real=True) for number, z in enumerate(rates_of(force))}
    found = []
    for order in permutations(law.nonlinear):
        places = {symbol(law.parameters[i]): rank for rank, i in enumerate(order)}
        names = {name: sympy.Symbol(f"p{rank}", positive=True) for name, rank in places.items()}
        plain = force.xreplace(names | states)
        linear = [symbol(law.parameters[i]) for i in law.linear]
        parts = [_factor_of(plain, parameter) for parameter in linear]
        parts.append(plain.xreplace(dict.fromkeys(linear, sympy.S.Zero)))
        found.append(
            sorted(map(_plain_text, parts))
            + [f"{z}' = {_plain_text(rate)}" for z, rate in rates_of(plain).items()]
        )
    return frozenset(min(found))


def _factor_of(force: sympy.Expr, parameter: sympy.Symbol) -> sympy.Expr:
    """Return the derivative of a law by a linear parameter; Masing loops are linear in their virgin curve."""
    loops = {loop: sympy.Dummy() for loop in force.atoms(Masing)}
    outer = force.xreplace(loops)
    found = outer.diff(parameter).xreplace({place: loop for loop, place in loops.items()})
    for loop, place in loops.items():
        if curve := loop.args[0].diff(parameter):
            found += outer.diff(place) * Masing(curve)
    return found


def _plain_text(force: sympy.Expr) -> str:
    """Return the normal form of a force or a rate as text, with the virgin curves that it has."""
    curves = {}
    for loop in force.atoms(Masing):
        virgin = normal_form(real_powers(loop.args[0])).expression
        curves[loop] = sympy.Symbol(f"masing({virgin})", real=True) if virgin else sympy.S.Zero
    return str(normal_form(force.xreplace(curves)).expression)


@dataclass(frozen=True)
class Sum:
    """A candidate: the base and some terms, parameters renamed so that each name stands once.

    Parameters
    ----------
    terms
        None for the base alone.
    sensors
        Between which the terms act; "" where they follow the response.
    """

    terms: tuple[Term, ...]
    sensors: str = ""

    @property
    def name(self) -> str:
        """Names of the laws in it."""
        return " + ".join(term.name for term in self.terms) or "linear-spring + linear-damper"

    @cached_property
    def base(self) -> dict[str, Element]:
        """Linear elements by parameter: all but the spring that a term takes the place of."""
        base = dict(base_elements(self.sensors))
        if any(term.how.spring for term in self.terms):
            del base["kj" if self.sensors else "k"]
        return base

    @cached_property
    def names(self) -> tuple[dict[str, str], ...]:
        """New name of every parameter of every term."""
        taken = {*self.base, "m"}
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
        found = [self.base[name] for name in ("k", "c", "kj", "cj") if name in self.base]
        for term, names in zip(self.terms, self.names, strict=True):
            places = {symbol(old): symbol(new) for old, new in names.items()}
            force = term.force.xreplace(places)
            found.append(make_element(term.name, force, across=self.sensors))
        return tuple(found)

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
