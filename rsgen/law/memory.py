"""Laws with memory: states with their equations, virgin curves, and the force as a function of their values.

A law with memory is  n = f(x, v, z; p),  where every z is one of three kinds: z' = g(x, v, z; p) with z = 0
at the start; a Masing law, given by its virgin curve; or the displacement a quarter of a period later
(structural damping). ``memory_form`` splits a law into f and these; all later stages work on the parts.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import ExpressionError
from rsgen.common.tolerances import ROUND_OFF
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.formula.names import Inner, Masing, State, Structural, check_name, remembers, symbol
from rsgen.formula.printing import write
from rsgen.formula.reading import parse

RESIDUAL_TOLERANCE = 1e-6
"""Largest residual of a step of a loop, and growth of a disturbance in a period, relative to the state."""

# ----------------------------------------------------------------------------
# Conditions on the virgin curve of a Masing law, and the signs of parameters that follow.

_TYPICAL = (1.0, 0.3, 2.5)
"""Values of all parameters, and displacements, at which the sign of a virgin curve is determined."""

SMALL_DISPLACEMENT = 1e-9
"""Displacement below every corner of a curve at these values."""

_TRIALS, _DECADES = 64, 3
"""Random values of all parameters at which a sign is tried, and their decades to both sides of one."""


def check_virgin(curve: sympy.Expr) -> None:
    """Refuse what is no virgin curve.

    Raises
    ------
    ExpressionError
        It depends on v or on a memory, or not on x; it is not zero at zero, or negative.
    """
    text, x = write(curve), symbol("x")
    if curve.has(symbol("v")) or remembers(curve):
        raise ExpressionError(f"masing({text}): a virgin curve is written in x and parameters only")
    if not curve.has(x):
        raise ExpressionError(f"masing({text}): a virgin curve depends on x")
    names = tuple(sorted(curve.free_symbols - {x}, key=str))
    law = compiled((curve,), (x, *names))
    places = np.array([0.0, SMALL_DISPLACEMENT, *(1e-3 * size for size in _TYPICAL)])
    (forces,) = law(places, *np.full((len(names), len(places)), _TYPICAL[0]))
    forces = np.broadcast_to(forces, places.shape)
    largest = float(np.max(np.abs(forces), where=np.isfinite(forces), initial=1.0))
    if not abs(forces[0]) <= ROUND_OFF * largest:
        raise ExpressionError(f"masing({text}): a virgin curve must be zero at x = 0")
    if np.all(forces[2:] < 0):
        raise ExpressionError(
            f"masing({text}): a virgin curve must be positive for x > 0; the sign stands before it"
        )


def positive_in(curve: sympy.Expr, parameter: sympy.Symbol) -> bool:
    """Decide whether a virgin curve is none where a parameter is negative, whatever the others are.

    The limit of a slider: ``Min(kt*x, Fs)`` is not zero at zero for a negative Fs, and negative for a
    negative kt.
    """
    x = symbol("x")
    names = tuple(sorted(curve.free_symbols - {x}, key=str))
    if parameter not in names:
        return False
    law = compiled((curve,), (x, *names))
    generator = np.random.default_rng(0)
    values = 10.0 ** generator.uniform(-_DECADES, _DECADES, (len(names), _TRIALS))
    if not _is_virgin(law, values).any():
        # no virgin curve for either sign: nothing follows
        return False
    values[names.index(parameter)] *= -1
    return not _is_virgin(law, values).any()


def _is_virgin(law: Numeric, values: Array) -> NDArray[np.bool_]:
    """(t,) whether the curve is zero at zero and positive near it, at values (p, t)."""
    (at_zero,), (nearby,) = (
        law(np.full(values.shape[1], place), *values) for place in (0.0, SMALL_DISPLACEMENT)
    )
    zero = np.abs(at_zero) <= ROUND_OFF * np.abs(nearby)
    return np.asarray(zero & (nearby > 0) & np.isfinite(nearby))


_FIXED = ("t", "X", "X0", "omega", "F")
"""Names with a fixed meaning on which a law cannot depend."""


@dataclass(frozen=True, slots=True)
class Rate:
    """A state with an equation: z' = g(x, v, z; p), all states in g as ``Inner``."""

    symbol: Inner
    rate: sympy.Expr


@dataclass(frozen=True, slots=True)
class Curve:
    """A Masing law: its force is ``symbol``, its virgin curve n(x; p) holds for x >= 0."""

    symbol: Inner
    virgin: sympy.Expr


@dataclass(frozen=True, slots=True)
class MemoryForm:
    """A law with memory as f(x, v, z; p) and its memories z.

    Parameters
    ----------
    force
        f(x, v, z; p) [N]; every z is an ``Inner`` symbol.
    rates
        States with equations, in the order of their names.
    curves
        Masing laws, in a stable order.
    lag
        Stands for the displacement a quarter of a period later [m]; None without structural damping.
    """

    force: sympy.Expr
    rates: tuple[Rate, ...]
    curves: tuple[Curve, ...]
    lag: Inner | None

    @property
    def states(self) -> tuple[Inner, ...]:
        """All z: those of ``rates``, then those of ``curves``, then ``lag``."""
        last = () if self.lag is None else (self.lag,)
        return (*(r.symbol for r in self.rates), *(c.symbol for c in self.curves), *last)


def with_memory(force: sympy.Expr, memory: Mapping[str, str | sympy.Expr]) -> sympy.Expr:
    """Attach equations to the states of a law.

    Parameters
    ----------
    force
        n(x, v, z; p), states by their names.
    memory
        g of z' = g(x, v, z; p) for every state, as text or as expression.

    Raises
    ------
    ExpressionError
        A state cannot have its name, stands neither in the force nor in another equation, or its equation
        depends on time or on itself in no way at all; the force is no formula.
    """
    if not memory:
        return force
    if not isinstance(memory, Mapping):
        raise ExpressionError(
            f"memory: {memory!r:.80}; must be a mapping of states to equations, {{'z': 'a*v'}}"
        )
    rates = dict(_equation(name, text) for name, text in memory.items())
    used = force.free_symbols
    for _ in rates:
        used = used.union(*(rates[z].free_symbols for z in rates if z in used))
    for z, rate in rates.items():
        if z not in used:
            raise ExpressionError(
                f"memory.{z}: {z} stands neither in the force nor in the equation of a state that does"
            )
        if not rate.free_symbols & {symbol("x"), symbol("v"), *rates}:
            raise ExpressionError(
                f"memory.{z}: {write(rate)} depends on neither x, v nor a state; {z} would grow without end"
            )
    ordered = sorted(rates, key=str)
    equations = sympy.Tuple(*(sympy.Tuple(z, rates[z]) for z in ordered))
    return force.xreplace({z: State(z, equations) for z in ordered})


def read_formula(formula: str | sympy.Expr | float) -> sympy.Expr:
    """Take a formula as text, or as an expression; nothing else, since SymPy evaluates text in lists.

    Raises
    ------
    ExpressionError
        It is neither, or the text is no formula.
    """
    if isinstance(formula, str):
        return parse(formula)
    if not isinstance(formula, sympy.Expr | float | int):
        raise ExpressionError(f"a {type(formula).__name__} is no formula; text or an expression is needed")
    return sympy.sympify(formula)


def _equation(name: str, text: str | sympy.Expr) -> tuple[sympy.Symbol, sympy.Expr]:
    """Return a state and g of its equation."""
    try:
        state, rate = symbol(check_name(name)), read_formula(text)
    except ExpressionError as fault:
        raise ExpressionError(f"memory.{name}: {fault}") from None
    if remembers(rate):
        raise ExpressionError(f"memory.{name}: {write(rate)}: masing and structural stand in the force only")
    foreign = [fixed for fixed in _FIXED if rate.has(symbol(fixed))]
    if foreign:
        raise ExpressionError(
            f"memory.{name}: depends on {', '.join(foreign)}; an equation of a state is written in x, v, "
            "states and parameters"
        )
    return state, rate


def rates_of(force: sympy.Expr) -> dict[sympy.Symbol, sympy.Expr]:
    """Return g of z' = g(x, v, z) for all states of a law, by symbol; empty where it has none."""
    found = {z: rate for state in force.atoms(State) for z, rate in state.equations.items()}
    return {z: found[z] for z in sorted(found, key=str)}


def equations_of(force: sympy.Expr) -> dict[str, str]:
    """Return the equations of all states of a law as text, by name; empty where it has none."""
    return {str(z): write(rate) for z, rate in rates_of(force).items()}


def with_equations(force: sympy.Expr) -> str:
    """Write a law with the equations of its states: without them two laws may read alike."""
    return ", ".join((write(force), *(f"{z}' = {rate}" for z, rate in equations_of(force).items())))


@lru_cache(maxsize=256)
def memory_form(force: sympy.Expr) -> MemoryForm | None:
    """Split a law with memory into its force and its memories; None for a law without.

    Raises
    ------
    ExpressionError
        Two states of one name have different equations, a state has the name of a parameter, or a virgin
        curve is none: it depends on v or on a memory, is not zero at zero, or negative.
    """
    if not remembers(force):
        return None
    rates: dict[sympy.Symbol, sympy.Expr] = {}
    for state in sorted(force.atoms(State), key=sympy.default_sort_key):
        for z, rate in state.equations.items():
            if rates.setdefault(z, rate) != rate:
                raise ExpressionError(
                    f"the state {z} has two different equations; give one of them another name"
                )
    clash = sorted(str(z) for z in rates if z in force.free_symbols)
    if clash:
        raise ExpressionError(f"{', '.join(clash)}: a state and a parameter have this name; rename one")
    places: dict[sympy.Expr, sympy.Expr] = {}
    inner = {z: Inner(str(z), real=True) for z in rates}
    for state in force.atoms(State):
        places[state] = inner[state.args[0]]
    curves = []
    for number, curve in enumerate(sorted(force.atoms(Masing), key=sympy.default_sort_key), start=1):
        check_virgin(curve.args[0])
        curves.append(Curve(_free(f"masing_{number}", inner), curve.args[0]))
        places[curve] = curves[-1].symbol
    lag = _free("lag", inner) if force.has(Structural) else None
    for damping in force.atoms(Structural):
        if damping.args[0].free_symbols & {symbol("x"), symbol("v")} or remembers(damping.args[0]):
            raise ExpressionError(f"{write(damping)}: structural(h) takes a stiffness h, without x and v")
        places[damping] = damping.args[0] * lag
    ordered = tuple(Rate(inner[z], rates[z].xreplace(inner)) for z in sorted(rates, key=str))
    return MemoryForm(force.xreplace(places), ordered, tuple(curves), lag)


def refuse_free_powers(force: sympy.Expr, fixed: Collection[str]) -> None:
    """Refuse a state that is a force to a power that is to be identified: its factor has no unit of its own.

    Searched as a share of a force, the same law needs a quarter of the time, and its solution is found.

    Raises
    ------
    ExpressionError
        With the law to write, and the value to fix.
    """
    form = memory_form(force)
    for one in () if form is None else form.rates:
        powers = [power for power in one.rate.atoms(sympy.Pow) if power.base.has(one.symbol)]
        free = sorted({str(name) for power in powers for name in power.exp.free_symbols} - set(fixed))
        if free and form is not None and form.force.diff(one.symbol) == 1:
            raise ExpressionError(
                f"{one.symbol}: a force to a power that is to be identified; write it as a share of one: "
                "Fs*z, z' = (v - (b*abs(v)*z + (1 - b)*v*abs(z))*abs(z)**(n - 1))/xs, b 1 or a parameter; "
                f"or hold the power: fixed={{{free[0]!r}: 1}}"
            )


def real_powers(virgin: sympy.Expr) -> sympy.Expr:
    """Return a virgin curve whose powers are real on both sides of zero, as normal forms must be."""
    broken: sympy.Expr = virgin.replace(
        lambda e: e.is_Pow and e.base.has(symbol("x")) and not e.exp.is_integer,
        lambda e: sympy.Abs(e.base) ** e.exp,
    )
    return broken


def defined_at_zero(rate: sympy.Expr) -> sympy.Expr:
    """Write z*Abs(z)**(n - 1) as sign(z)*Abs(z)**n, which is not zero times infinity at z = 0."""

    def joined(product: sympy.Expr) -> sympy.Expr:
        powers = dict(product.as_powers_dict())
        for size in [base for base in powers if isinstance(base, sympy.Abs)]:
            inner, lower = size.args[0], powers[size]
            upper = powers.get(inner, sympy.S.Zero)
            if upper.is_Integer and upper > 0 and not lower.is_nonnegative:
                powers |= {size: upper + lower, inner: sympy.S.Zero, sympy.sign(inner): upper % 2}
        return sympy.Mul(*(base**exponent for base, exponent in powers.items()))

    return rate.replace(lambda part: part.is_Mul, joined)


def from_rest(form: MemoryForm) -> sympy.Expr:
    """Return n(x, v) as reached from rest at once: states and lag zero, Masing laws on their virgin curve."""
    x = symbol("x")
    size = sympy.Abs(x)
    places = dict.fromkeys(form.states, sympy.S.Zero)
    places |= {c.symbol: sympy.sign(x) * c.virgin.xreplace({x: size}) for c in form.curves}
    return form.force.xreplace(places)


def _free(name: str, states: Mapping[sympy.Symbol, Inner]) -> Inner:
    """Return a symbol with a name that is lengthened until no state has it."""
    while symbol(name) in states:
        name += "_"
    return Inner(name, real=True)


def constant_terms(force: sympy.Expr) -> tuple[str, ...]:
    """Return the terms, other than a name alone, that no x, v or memory moves."""
    form = memory_form(force)
    names = {symbol("x"), symbol("v"), *(() if form is None else form.states)}
    terms = [term for term in sympy.Add.make_args(force if form is None else form.force) if term.free_symbols]
    fixed = (term for term in terms if not (term.as_coeff_Mul()[1].is_Symbol or term.free_symbols & names))
    return tuple(sorted(map(write, fixed)))


_PRODUCT_AS_NAME, _VELOCITIES = re.compile(r"([A-Za-z]{1,2}_?\d*)([xv])"), ("dx", "dxdt", "xdot")
"""Names that read as a product with x or v, and names of the velocity elsewhere."""


def refuse_joined_names(force: sympy.Expr) -> None:
    """Refuse a term without x and v that has a name such as kx, where a product was meant, or dx for v.

    Raises
    ------
    ExpressionError
        With the product, or v, to write.
    """
    states = {symbol("x"), symbol("v")}
    fixed = [term.free_symbols for term in sympy.Add.make_args(force) if not term.free_symbols & states]
    for name in sorted({free.name for names in fixed for free in names}):
        product = _PRODUCT_AS_NAME.fullmatch(name)
        if name in _VELOCITIES or product:
            meant = (
                "v for the velocity" if product is None or name in _VELOCITIES else "*".join(product.groups())
            )
            raise ExpressionError(
                f"{name} is one name, and its term has neither x nor v: a constant force; write {meant}, or "
                "give the constant another name"
            )


# ----------------------------------------------------------------------------
# Keys of ``accept`` in a case for the whole force of a law.

FORCE_KEYS = {
    "stiffness_force": "stiffness force",
    "damping_force": "damping force",
    "loop_force": "loop force",
}
"""Keys of ``accept`` that judge a whole force, and its name: its largest deviation over the tested range,
relative to its largest value. The stiffness force is n(x, 0), the damping force n(0, v); the force of a law
with memory is that of its loops."""


def force_keys(force: sympy.Expr) -> tuple[str, ...]:
    """Return the keys of FORCE_KEYS that a law has: of one with memory only its loops are defined."""
    return ("loop_force",) if remembers(force) else ("stiffness_force", "damping_force")
