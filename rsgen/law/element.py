"""Elements and laws: the force in x and v, its parameters, what is known about it, and laws by name."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cache

import sympy

from rsgen.common.errors import ExpressionError, RsgenError, quote, require
from rsgen.common.finding import Finding
from rsgen.formula.bounds import algebra_faults
from rsgen.formula.names import check_name, symbol
from rsgen.formula.printing import write
from rsgen.formula.reading import parse
from rsgen.law.library import ROWS, Search
from rsgen.law.memory import (
    constant_terms,
    equations_of,
    memory_form,
    rates_of,
    read_formula,
    refuse_joined_names,
    with_memory,
)
from rsgen.law.normal_form import normal_form
from rsgen.law.notation import latex
from rsgen.law.numeric import equal_terms

# ----------------------------------------------------------------------------
# Remarks about a law from its formula alone, before any test.

_LIKE_VARIABLES = frozenset({"a", "acc", "w", "f", "F", "vx", "vy"})
"""Parameters that a reader may take for acceleration, frequency, excitation or velocity."""


def law_remarks(force: sympy.Expr) -> tuple[Finding, ...]:
    """Find probable mistakes: constant forces, names of variables, equal terms.

    Examples
    --------
    >>> from rsgen.formula.reading import parse
    >>> [finding.code for finding in law_remarks(parse("k*x + z"))]
    ['constant-force']
    """
    return (
        *(Finding("constant-force", "warning", name) for name in _constant_forces(force)),
        *(Finding("constant-force", "warning", names={"term": term}) for term in constant_terms(force)),
        *(_order(group) for group in equal_terms(force)),
        *(Finding("parameter-not-variable", "info", name) for name in _like_variables(force)),
    )


def _order(group: tuple[tuple[str, ...], ...]) -> Finding:
    names = sorted(group)
    terms = " and ".join(f"({', '.join(names_of_one)})" for names_of_one in names)
    order = " <= ".join(names_of_one[0] for names_of_one in names)
    return Finding("equal-terms", "info", names={"terms": terms, "order": order})


def refuse_library_names(force: sympy.Expr) -> None:
    """Refuse a constant force that is the name of a law of the library: the law itself was meant.

    Raises
    ------
    ExpressionError
        A term of the law is such a name, or two are, as "cubic-spring", which reads as a difference.
    """
    names = set(_constant_forces(force))
    for called, law in ROWS.items():
        spelled = called.replace("-", "_")
        # a preload is a constant force indeed
        if called == "preload" or not ({spelled} <= names or {*called.split("-")} <= names):
            continue
        equations = "".join(f"; {z}' = {rate}" for z, rate in (law.memory or {}).items())
        raise ExpressionError(
            f"{spelled if spelled in names else called} is a law of the library and no force in a formula; "
            f'write {law.formula[:80]}{equations[:80]}, or say law = "{called}" in an element of a case, '
            f'rsgen.laws["{called}"] in Python'
        )


def _constant_forces(force: sympy.Expr) -> tuple[str, ...]:
    """Return the names that stand alone as terms of a law, or times a number: no x or v moves them."""
    terms = {term.as_coeff_Mul()[1] for term in sympy.Add.make_args(force)} - {symbol("x"), symbol("v")}
    return tuple(sorted(term.name for term in terms if term.is_Symbol))


def _like_variables(force: sympy.Expr) -> list[str]:
    """Return parameters called V, or like a variable and with another parameter in a product."""
    found = {free.name for free in force.free_symbols} & {"V"}
    for term in sympy.Add.make_args(sympy.expand(force)):
        factors = {factor.name for factor in sympy.Mul.make_args(term) if factor.is_Symbol} - {"x", "v"}
        if len(factors) > 1:
            found |= factors & _LIKE_VARIABLES
    return sorted(found)


NOT_PARAMETERS = ("X", "X0", "omega")
"""Names of the describing function's own variables; a law must not use them for its parameters."""

UNNAMED = "law"
"""Name of the element that a formula without a name becomes."""


class _Summand:
    """A force n(x, v) that can be added to others and shows itself in a notebook."""

    __slots__ = ()

    def __add__(self, other: LawLike) -> Law:
        return _sum(self, other)

    def __radd__(self, other: LawLike) -> Law:
        return _sum(other, self)

    def _repr_latex_(self) -> str:
        force = _as_law(self).force
        rates = (rf",\quad \dot {latex(z)} = {latex(rate)}" for z, rate in rates_of(force).items())
        return f"$n(x, v) = {latex(force)}{''.join(rates)}$"


@dataclass(frozen=True, slots=True)
class Element(_Summand):
    """A spring or damper: its name and its force law [N] in x [m] and v [m/s]; symbolic only.

    ``parameters`` are the free symbols of the law other than x and v, sorted by name. ``across`` says between
    which sensors x is, "payload - wing"; "" where it is the response. ``+`` adds two elements to a law.
    """

    name: str
    force: sympy.Expr
    parameters: tuple[str, ...]
    across: str = ""

    @property
    def memory(self) -> dict[str, str]:
        """g of z' = g(x, v, z) for every state z of the law, as text; empty where it has none."""
        return equations_of(self.force)


@algebra_faults()
def make_element(
    name: str, force: str | sympy.Expr, memory: Mapping[str, str | sympy.Expr] | None = None, across: str = ""
) -> Element:
    """Make a spring or damper from a law in x and v; every other name in it is a parameter.

    Parameters
    ----------
    name
        Any name that may stand in a case file.
    force
        The law [N], as text in the expression language or as an expression of ``expression.symbol`` symbols.
    memory
        g(x, v, z) of z' = g for every state z of the law; z is zero at the start.
    across
        Between which sensors x is, such as "payload - wing", whose noise is in x; or the name of the one
        sensor that measures it, such as "gauge". The test brings the motion there, as ``across`` of its
        surface. "": x is the response.

    Raises
    ------
    ExpressionError
        The text is no formula, a parameter is named X, X0, omega or t, or the law has no normal form: it is
        not real for negative x or v, not defined everywhere, or has hundreds of switches. A state
        has no equation, or a Masing term no virgin curve. A term is the name of a law of the library.

    Examples
    --------
    >>> make_element("damper", "c*v + Ff*sign(v)").parameters
    ('Ff', 'c')
    >>> make_element("joint", "k*x + z", {"z": "a*v - b*abs(v)*z"}).parameters
    ('a', 'b', 'k')
    """
    require(name, str, "name")
    require(across, str, f"{name}: across")
    law = with_memory(read_formula(force), memory or {})
    _refuse_names(name, law)
    refuse_library_names(law)
    refuse_joined_names(law)
    normal_form(law)
    remembered = memory_form(law)
    for rate in () if remembered is None else remembered.rates:
        try:
            normal_form(rate.rate)
        except ExpressionError as fault:
            raise ExpressionError(f"memory.{rate.symbol}: {fault}") from None
    names = sorted(free.name for free in law.free_symbols)
    return Element(name, law, tuple(free for free in names if free not in ("x", "v")), across)


def _refuse_names(name: str, law: sympy.Expr) -> None:
    """Refuse symbols that are not of rsgen, the time, and variables of describing functions."""
    names = sorted(free.name for free in law.free_symbols)
    foreign = sorted(free.name for free in law.free_symbols if free != symbol(free.name))
    if foreign:
        raise ExpressionError(
            f"{name}: {', '.join(foreign)}: not a symbol of rsgen; make symbols with "
            "rsgen.formula.names.symbol"
        )
    if "t" in names:
        raise ExpressionError(
            f"{name}: t: no parameter can have this name, it is the time; a law is written in x and v, and "
            "none that changes with time is identified"
        )
    reserved = [free for free in names if free in NOT_PARAMETERS]
    if reserved:
        raise ExpressionError(
            f"{name}: {', '.join(reserved)}: no parameter can have this name, it is a variable of the "
            "describing function; a law is written in x and v"
        )


_FACTOR = re.compile(r"(?<!\w)[\d.]+[eE][+-]?\d+")
"""A factor of a channel whose exponent has a sign of its own."""


def response_share(sensors: str) -> float:
    """Return how much of the response is in a motion across: 1.0 where that is a difference of sensors.

    0.0 where it has a sensor of its own: the name of one channel, such as "gauge" or "strain gauge".
    """
    summed = re.split("[+-]", _FACTOR.sub("", sensors))
    return float(sum(any(map(str.isalpha, channel)) for channel in summed) > 1)


def forces_by_motion(elements: Iterable[Element]) -> dict[str, sympy.Expr]:
    """Add the forces [N] of elements by the sensors between which they act; "" is the response, and first."""
    forces: dict[str, sympy.Expr] = {"": sympy.Integer(0)}
    for element in elements:
        forces[element.across] = forces.get(element.across, 0) + element.force
    return forces


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a law: its name, what it means, and its SI unit (empty: a number or of the power p).

    ``example`` is a value [SI] at which a figure of the law shows what is special in it.
    """

    name: str
    meaning: str
    unit: str
    example: float = 1.0


@dataclass(frozen=True, slots=True, repr=False)
class Law(_Summand):
    """A force law n(x, v) [N] in displacement x [m] and velocity v [m/s]; every other name is a parameter.

    ``law + other`` adds two laws, where ``other`` may also be a formula or an element. A term of both, such
    as k*x, is there once; other parameters of one name need ``element(renames=...)``, or one formula.

    Parameters
    ----------
    formula
        The force in the expression language, or as an expression of ``expression.symbol`` symbols.
    name
        Lower case, words joined by hyphens.
    title
        What it is, in a few words.
    table
        What is known about its parameters, in the order of a reader.
    source
        Where the law and its describing function stand in the literature.
    own
        Whether the describing function is rsgen's derivation, because the source gives none or a wrong one.
    search
        How a ranking tries it in sums; None: only alone.
    elements
        The springs and dampers that it consists of; by default one element with all of the formula.
    memory
        g(x, v, z) of z' = g for every state z in the formula, which is zero at the start.

    Raises
    ------
    ExpressionError
        As for ``make_element``; elements that are added have different states, or parameters, of one name.

    Examples
    --------
    >>> law = Law("k*x + c*v") + "Ff*sign(v)"
    >>> law
    Law('k*x + c*v + Ff*sign(v)')
    >>> law.parameters
    ('Ff', 'c', 'k')
    """

    formula: str
    name: str = ""
    title: str = ""
    table: tuple[Parameter, ...] = ()
    source: str = ""
    own: bool = False
    search: Search | None = None
    elements: tuple[Element, ...] = ()
    memory: Mapping[str, str] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not self.elements:
            element = make_element(self.name or UNNAMED, self.formula, self.memory)
            object.__setattr__(self, "elements", (element,))
        memory_form(self.force)  # states of one name with different equations are a fault here already
        object.__setattr__(self, "memory", equations_of(self.force))
        if not isinstance(self.formula, str):
            object.__setattr__(self, "formula", write(self.formula))

    @property
    def force(self) -> sympy.Expr:
        """n(x, v) [N] as an expression."""
        return sympy.Add(*(element.force for element in self.elements))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, sorted."""
        return tuple(sorted({name for element in self.elements for name in element.parameters}))

    @property
    def example(self) -> dict[str, float]:
        """A value for each parameter of ``table``, SI, for a figure."""
        return {parameter.name: parameter.example for parameter in self.table}

    @property
    def text(self) -> str:
        """The formula, and the equations of its states."""
        return ", ".join((self.formula, *(f"{z}' = {rate}" for z, rate in self.memory.items())))

    @property
    def added(self) -> sympy.Expr:
        """The terms [N] that the law adds to a linear spring and a linear damper, for a ranking."""
        if self.search is not None and self.search.formula:
            return with_memory(parse(self.search.formula), self.search.memory)
        states = (symbol("x"), symbol("v"))
        force = self.force
        for parameter in sorted(force.free_symbols - set(states), key=str):
            if force.diff(parameter) in states:
                force = force.subs(parameter, 0)
        return force

    def element(self, name: str | None = None, renames: Mapping[str, str] | None = None) -> Element:
        """Make one spring or damper of this law.

        Parameters
        ----------
        name
            Name of the element; that of the law by default.
        renames
            New names of parameters and states, by their name in the law; the others keep theirs.

        Raises
        ------
        RsgenError
            The law has no parameter of this name, the new name cannot be one, or a state gets the name of
            another state or of a parameter.

        Examples
        --------
        >>> Law("k*x + k3*x**3", "cubic-spring").element("spring", {"k3": "kn1"}).parameters
        ('k', 'kn1')
        """
        renames = dict(renames or {})
        unknown = sorted(set(renames) - {*self.parameters, *self.memory})
        if unknown:
            raise RsgenError(
                f"law {self.name or self.formula!r} has no parameter {', '.join(unknown)}; "
                f"it has {', '.join(self.parameters)}"
            )
        states = [renames.get(name, name) for name in self.memory]
        new_names = states + [renames.get(name, name) for name in self.parameters]
        clash = sorted({name for name in states if new_names.count(name) > 1})
        if clash:
            raise RsgenError(
                f"law {self.name or self.formula!r}: {', '.join(clash)}: a state cannot have the name of "
                "another state or of a parameter"
            )
        places = {symbol(old): symbol(check_name(new)) for old, new in renames.items()}
        return make_element(name or self.name or UNNAMED, self.force.xreplace(places))

    def __repr__(self) -> str:
        memory = f", memory={self.memory}" if self.memory else ""
        return f"Law({self.formula!r}{f', name={self.name!r}' if self.name else ''}{memory})"


LawLike = str | Element | Law
"""A formula, an element or a law."""


def _as_law(law: object) -> Law:
    if isinstance(law, Law):
        return law
    if isinstance(law, Element):
        return Law(write(law.force), law.name, elements=(law,))
    if isinstance(law, str | sympy.Expr):
        try:
            return Law(law)
        except ExpressionError as fault:
            raise ExpressionError(f"law {quote(law)}: {fault}") from None
    raise RsgenError(f"law: {law!r:.80}; must be a formula, an Element or a Law")


def _sum(first: object, second: object) -> Law:
    a, b = _as_law(first), _as_law(second)
    for name in sorted({*a.parameters} & {*b.parameters}):
        terms = [
            {sensors: n.diff(symbol(name)) for sensors, n in forces_by_motion(law.elements).items()}
            for law in (a, b)
        ]
        if terms[0] != terms[1] or any(term.has(symbol(name)) for term in terms[0].values()):
            raise ExpressionError(
                f"{name}: stands in both laws of the sum, {a.text!r:.60} and {b.text!r:.60}; if it is one "
                f"parameter, write one formula; if not, law.element(renames={{{name!r}: '{name}_2'}})"
            )
        # both laws have the term, as springs of the library have k*x: it is there once
        rest = [(one, one.force - symbol(name) * one.force.diff(symbol(name))) for one in b.elements]
        left = tuple(make_element(one.name, force, across=one.across) for one, force in rest if force)
        if not left:
            return a
        b = Law(write(sympy.Add(*(one.force for one in left))), b.name, elements=left)
    return Law(
        f"{a.formula} + {b.formula}",
        f"{a.name} + {b.name}" if a.name and b.name else "",
        elements=as_elements((a, b)),
    )


def as_elements(law: LawLike | Sequence[LawLike]) -> tuple[Element, ...]:
    """Turn a law into the elements of a model, whatever it is given as.

    Parameters
    ----------
    law
        A formula, an element, a law, or a sequence of these, whose forces add up.

    Returns
    -------
    tuple of Element
        Elements that are given keep their names; those made of formulas and laws get names that stand once.

    Raises
    ------
    RsgenError
        Something is no law.

    Examples
    --------
    >>> [element.name for element in as_elements(["k*x", "c*v"])]
    ['law', 'law-2']
    """
    parts = law if isinstance(law, Sequence) and not isinstance(law, str) else (law,)
    used = {part.name for part in parts if isinstance(part, Element)}
    elements: list[Element] = []
    for part in parts:
        if isinstance(part, Element):
            elements.append(part)
            continue
        for element in _as_law(part).elements:
            name, number = element.name, 1
            while name in used:
                number += 1
                name = f"{element.name}-{number}"
            used.add(name)
            elements.append(replace(element, name=name))
    return tuple(elements)


# ----------------------------------------------------------------------------
# The laws of the library, which users name instead of typing.


@cache
def _law(name: str) -> Law:
    row = ROWS[name]
    table = tuple(Parameter(*entry) for entry in row.parameters)
    return Law(row.formula, name, row.title, table, row.source, row.own, row.search, memory=row.memory or {})


class Library:
    """The laws by name; iterating gives the laws themselves, so that ``[law, *laws]`` is a list of laws.

    Examples
    --------
    >>> laws["coulomb"].formula
    'Ff*sign(v)'
    >>> "cubic-spring" in laws
    True
    >>> [law.name for law in laws][:3]
    ['linear-spring', 'linear-damper', 'cubic-spring']
    """

    def __getitem__(self, name: str | Law) -> Law:
        """Return a law by name; a law as it is.

        Raises
        ------
        RsgenError
            There is no law of this name.
        """
        if isinstance(name, Law):
            return name
        if name in self:
            return _law(name)
        words = re.findall(r"\w+", str(name)[:80].lower())
        near = [
            row for row, own in ROWS.items() if all(word in f"{row} {own.title}".lower() for word in words)
        ]
        if all(part in self for part in f"{name}".split(" + ")):
            one = f", or as {' or '.join(map(repr, near[:3]))}" if near else ""
            raise RsgenError(f"law {name!r}: is a sum; write it as a force, or an element for each law{one}")
        near = near[:3] or get_close_matches(str(name)[:80], ROWS, n=3)
        hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
        raise RsgenError(f"law {name!r}: unknown; {hint}known: {', '.join(ROWS)}")

    def __contains__(self, name: object) -> bool:
        return name in ROWS

    def __iter__(self) -> Iterator[Law]:
        return map(_law, ROWS)

    def __len__(self) -> int:
        return len(ROWS)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all laws."""
        return tuple(ROWS)

    def __repr__(self) -> str:
        return "\n".join(f"{law.name:<{max(map(len, ROWS))}}  {law.text}" for law in self)


laws = Library()
"""All laws of the library."""
