"""Closed describing functions of Masing laws.

With the virgin curve n the loop between -X and X gives, exactly,
k(X) = -4/(pi X) integral_0^pi n(X sin(phi/2)**2) cos(phi) dphi and the energy of a cycle
D(X) = 8 integral_0^X n dx - 4 X n(X), c = D/(pi omega X**2). With t = phi/2 a power x**P from a threshold b
on needs J = integral_T^(pi/2) sin(t)**(2 P) (1 - 2 sin(t)**2) dt, sin(T)**2 = b/X, which is
-(sin(T)**(2 P + 1) cos(T) + P integral_T^(pi/2) sin(t)**(2 P) dt)/(P + 1), by parts. The last integral is
elementary where 2 P is whole, a gamma function for b = 0, and an incomplete beta function otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.describing.closed import MAX_POWER, quarter
from rsgen.describing.quadrature import Cycle, project
from rsgen.describing.regimes import Reading, tidy
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import OMEGA, PHI, STATE_V, STATE_X, X0, X
from rsgen.law.forms import expanded, moves
from rsgen.law.memory import MemoryForm
from rsgen.law.normal_form import NormalForm, normal_form, normal_form_at

# ----------------------------------------------------------------------------
# Laws with memory along a cycle with known turning points: branches of Masing laws, structural damping.
#
# Between the turning points X0 - X and X0 + X the force of a Masing law rises from -n(X) by
# 2 n((x - X0 + X)/2) and falls from n(X) by 2 n((X0 + X - x)/2); the displacement a quarter of a period later
# is v/omega. On the cycle the law is again a function of x and v, and quadrature integrates it.


def _virgin_at(virgin: sympy.Expr, place: sympy.Expr) -> sympy.Expr:
    """Return the virgin curve at a displacement that is known as not negative."""
    if any(not power.exp.is_Integer for power in virgin.atoms(sympy.Pow) if power.base is not sympy.E):
        # round-off must not make a root of something negative
        place = sympy.Abs(place)
    return virgin.xreplace({STATE_X: place})


def loop_of(virgin: sympy.Expr) -> sympy.Expr:
    """Write the two branches of a Masing law between the turning points as one force of x and v."""
    rising, half, top = sympy.Heaviside(STATE_V), sympy.Rational(1, 2), _virgin_at(virgin, X)
    up = -top + 2 * _virgin_at(virgin, half * (STATE_X - X0 + X))
    down = top - 2 * _virgin_at(virgin, half * (X0 + X - STATE_X))
    return rising * up + (1 - rising) * down


def on_cycle(force: sympy.Expr, memory: MemoryForm) -> sympy.Expr:
    """Write Masing laws and structural damping in f(x, v, z) as they are on the cycle of X about X0.

    States with equations stay in it as ``Inner`` symbols.
    """
    places = {curve.symbol: loop_of(curve.virgin) for curve in memory.curves}
    if memory.lag is not None:
        places[memory.lag] = STATE_V / OMEGA
    return force.xreplace(places)


@dataclass(frozen=True, slots=True)
class Branches:
    """A law without states of its own along the cycle, by quadrature of its branches.

    Parameters
    ----------
    force
        The law on the cycle [N], in x, v, X, X0, omega and parameters.
    parameters
        Names of the parameters.
    """

    force: sympy.Expr
    parameters: tuple[str, ...]

    def harmonics(self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]) -> list[Array]:
        """Return stiffness [N/m], damping [N s/m] and mean force [N] of cycles; arrays (n,)."""
        return self.projected(X_, mean, omega, values)[:3]

    def projected(self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]) -> list[Array]:
        """Return stiffness, damping, mean force, and the mean absolute force as a stiffness [N/m]."""
        names = (X, X0, OMEGA, *map(symbol, self.parameters))
        fields = (X_, mean, omega, *(np.broadcast_to(values[name], X_.shape) for name in self.parameters))
        found = project(self.force, names, Cycle(X_, mean, omega, fields))
        per_length = 1 / (np.pi * X_)
        return [
            found.sine * per_length,
            found.cosine * per_length / omega,
            found.mean / (2 * np.pi),
            found.size * per_length,
        ]

    def along(self, phi: Array, X_: float, mean: float, omega: float, values: Mapping[str, float]) -> Array:
        """Return the force [N] at phases (s,) of one cycle."""
        names = (STATE_X, STATE_V, X, X0, OMEGA, *map(symbol, self.parameters))
        x, v = mean + X_ * np.sin(phi), omega * X_ * np.cos(phi)
        numbers = (values[name] for name in self.parameters)
        (force,) = compiled((self.force,), names)(x, v, X_, mean, omega, *numbers)
        return np.broadcast_to(force, phi.shape)


# ----------------------------------------------------------------------------
# Virgin curves of Masing laws: their pieces for x > 0, sorted by the displacement at which they begin.


def decisive_in(virgin: sympy.Expr) -> set[str]:
    """Return the parameters of a virgin curve whose sign decides the form of the formulas."""
    form = normal_form(_continued(virgin))
    found: set[sympy.Basic] = set()
    for switch in form.switches:
        found |= switch.function.free_symbols
    for atom in virgin.atoms(sympy.Abs, sympy.sign, sympy.Max, sympy.Min, sympy.Heaviside):
        found |= atom.free_symbols
    for power in virgin.atoms(sympy.Pow):
        if not power.exp.is_Integer and power.base is not sympy.E:
            found |= power.base.free_symbols
    return {free.name for free in found - {STATE_X}}


def _continued(virgin: sympy.Expr) -> sympy.Expr:
    return virgin.xreplace({STATE_X: sympy.Abs(STATE_X)})


@dataclass(frozen=True, slots=True)
class Pieces:
    """n(x) for x > 0 by threshold (None: from rest on), valid where all of ``assumed`` is positive."""

    terms: dict[sympy.Expr | None, sympy.Expr]
    assumed: tuple[sympy.Expr, ...]


def pieces_of(virgin: sympy.Expr) -> Pieces | None:
    """Sort the pieces of n(x) for x > 0 by their threshold; None where its sign cannot be known.

    Where the order of two parameters decides, as k1 > k2 in Min(k1 x, k2 x + F), the one with more thresholds
    is assumed: the other leaves nothing of the law.
    """
    form = normal_form(_continued(virgin))
    places = [piece.term for piece in form.pieces] + [switch.function for switch in form.switches]
    orders = {choice.args[0] for place in places for choice in place.atoms(sympy.sign) if not moves(choice)}
    if not orders:
        return _sorted_pieces(form, {}, ())
    if len(orders) > 1:
        return None
    (difference,) = orders
    names = sorted(difference.free_symbols, key=str)
    if len(names) != 2 or sympy.expand(difference - names[0] + names[1]) != 0:
        return None
    found = []
    for sign in (1, -1):
        values = {free.name: 1.0 for free in virgin.free_symbols} | {names[0].name: 1.0 + sign / 2}
        ordered = normal_form_at(_continued(virgin), values)
        pieces = _sorted_pieces(ordered, values, (sign * difference,))
        found += [] if pieces is None else [pieces]
    return max(found, key=lambda pieces: len(pieces.terms), default=None)


def _sorted_pieces(
    form: NormalForm, values: dict[str, float], assumed: tuple[sympy.Expr, ...]
) -> Pieces | None:
    """Sort pieces by thresholds whose sign is known, or assumed as it is at some values."""
    found: dict[sympy.Expr | None, sympy.Expr] = {}
    for piece in form.pieces:
        level: sympy.Expr | None = None
        for switch in piece.switches:
            if switch.variable != "x" or switch.threshold is None:
                return None
            level = switch.threshold
        if level is not None and not level.is_positive and not level.is_nonpositive:
            if not values:
                return None
            (size,) = compiled((level,), tuple(level.free_symbols))(
                *(values[free.name] for free in level.free_symbols)
            )
            assumed = (*assumed, level if size > 0 else -level)
            level = level if size > 0 else None
        elif level is not None and level.is_nonpositive:
            level = None
        # a positive symbol in its place takes abs and products of powers away
        place = sympy.Symbol("x", positive=True)
        term = piece.term.subs(sympy.Abs(STATE_X), place).xreplace({STATE_X: place})
        found[level] = found.get(level, sympy.S.Zero) + sympy.powsimp(sympy.expand(term))
    terms = {level: expanded(term) for level, term in found.items()}
    kept = {level: term for level, term in terms.items() if level is None or not term.is_zero}
    return Pieces(kept, tuple(dict.fromkeys(assumed)))


_ANGLE, _ROOT, _COSINE = (sympy.Dummy(name, positive=True) for name in ("angle", "root", "cosine"))
"""pi/2 - T, X sin(T) cos(T) and cos(T) at a threshold."""

Pair = tuple[sympy.Expr, sympy.Expr]
"""Stiffness [N/m] and energy of a cycle [J]."""


@dataclass(frozen=True, slots=True)
class Partial:
    """integral_0^T sin(t)**(2 P) dt with sin(T)**2 = b/X, behind a symbol."""

    name: sympy.Symbol
    power: sympy.Expr
    threshold: sympy.Expr

    @property
    def formula(self) -> sympy.Expr:
        """The integral as it is shown."""
        stop = sympy.asin(sympy.sqrt(self.threshold / X))
        return sympy.Integral(sympy.sin(PHI) ** (2 * self.power), (PHI, 0, stop))

    def evaluate(self, X_: Array, names: tuple[sympy.Symbol, ...], values: tuple[Array, ...]) -> Array:
        """Return the integral by the incomplete beta function (Abramowitz and Stegun, 6.6.1)."""
        power, threshold = compiled((self.power, self.threshold), names)(*values)
        share = np.clip(threshold / X_, 0.0, 1.0)
        return np.asarray(
            scipy.special.beta(power + 0.5, 0.5) * scipy.special.betainc(power + 0.5, 0.5, share) / 2
        )


@dataclass(frozen=True, slots=True)
class ClosedMasing:
    """Stiffness and damping of a Masing law as formulas; ``partials`` stand in them for integrals.

    They hold where all of ``assumed`` is positive.
    """

    stiffness: Reading
    damping: Reading
    partials: tuple[Partial, ...]
    assumed: tuple[sympy.Expr, ...] = ()

    @property
    def shown(self) -> Pair:
        """Stiffness and damping with integrals where there is no closed form."""
        places = {partial.name: partial.formula for partial in self.partials}
        return self.stiffness.formula.xreplace(places), self.damping.formula.xreplace(places)

    def evaluate(
        self, X_: Array, omega: Array, names: tuple[sympy.Symbol, ...], values: tuple[Array, ...]
    ) -> tuple[Array, Array]:
        """Return stiffness [N/m] and damping [N s/m]; arrays (n,), parameters (n,) or scalars."""
        inside = tuple(partial.evaluate(X_, names, values) for partial in self.partials)
        arguments = (X, OMEGA, *names, *(partial.name for partial in self.partials))
        formulas = (self.stiffness.formula, self.damping.formula)
        stiffness, damping = compiled(formulas, arguments)(X_, omega, *values, *inside)
        return np.broadcast_to(stiffness, X_.shape), np.broadcast_to(damping, X_.shape)

    def holds(self, names: tuple[sympy.Symbol, ...], values: tuple[Array, ...]) -> NDArray[np.bool_]:
        """Return where all of ``assumed`` is positive, broadcast over the values."""
        valid = np.asarray(True)
        for part in compiled(self.assumed, names)(*values) if self.assumed else ():
            valid = valid & (part > 0)
        return valid

    @property
    def thresholds(self) -> tuple[sympy.Expr, ...]:
        """Amplitudes at which the formulas change."""
        conditions = (*self.stiffness.conditions, *self.damping.conditions)
        return tuple(dict.fromkeys(c.gts for c in conditions if c.lts == X))

    def xreplace(self, places: dict[sympy.Symbol, sympy.Symbol]) -> ClosedMasing:
        """Replace symbols."""
        stiffness, damping = (
            Reading(r.formula.xreplace(places), tuple(c.xreplace(places) for c in r.conditions))
            for r in (self.stiffness, self.damping)
        )
        partials = (
            Partial(p.name, p.power.xreplace(places), p.threshold.xreplace(places)) for p in self.partials
        )
        assumed = tuple(expression.xreplace(places) for expression in self.assumed)
        return ClosedMasing(stiffness, damping, tuple(partials), assumed)


def close_masing(virgin: sympy.Expr, factor: sympy.Expr) -> ClosedMasing | None:
    """Find the closed form of factor*masing(virgin); None where an addend has none.

    Parameters
    ----------
    virgin
        n(x) for x >= 0; parameters that decide thresholds are symbols known as positive.
    factor
        Constant in front of the law.
    """
    pieces = pieces_of(virgin)
    if pieces is None:
        return None
    partials: dict[tuple[sympy.Expr, sympy.Expr], Partial] = {}
    written: dict[sympy.Expr | None, tuple[Pair, dict[sympy.Symbol, sympy.Expr]]] = {}
    for level, term in pieces.terms.items():
        ends = {} if level is None else _ends(level)
        total: Pair = (sympy.S.Zero, sympy.S.Zero)
        for addend in sympy.Add.make_args(term):
            pair = _addend(addend, level, partials)
            if pair is None:
                return None
            total = total[0] + pair[0], total[1] + pair[1]
        written[level] = (total, ends)
    per_energy = 1 / (sympy.pi * OMEGA * X**2)
    readings = (
        _read({level: (pair[0] * factor, ends) for level, (pair, ends) in written.items()}),
        _read({level: (pair[1] * factor * per_energy, ends) for level, (pair, ends) in written.items()}),
    )
    return ClosedMasing(*readings, tuple(partials.values()), pieces.assumed)


def _ends(level: sympy.Expr) -> dict[sympy.Symbol, sympy.Expr]:
    """Return angle, root and cosine at a threshold."""
    above, below = sympy.fraction(sympy.together(level))
    root = (
        sympy.sqrt(above * (below * X - above)) / below
        if below.is_positive
        else sympy.sqrt(level * (X - level))
    )
    return {
        # a tangent keeps its digits at the onset, X near b, where cosine and sine do not
        _ANGLE: sympy.atan(sympy.sqrt((below * X - above) / above)),
        _ROOT: root,
        _COSINE: sympy.sqrt((below * X - above) / (below * X)),
    }


def _addend(
    addend: sympy.Expr, level: sympy.Expr | None, partials: dict[tuple[sympy.Expr, sympy.Expr], Partial]
) -> Pair | None:
    place = sympy.Symbol("x", positive=True)
    coefficient, power = addend.as_coeff_exponent(place)
    if coefficient.has(place) or power.has(place):
        return None
    if power.is_negative or (power.is_Integer and power > MAX_POWER):
        return None
    scale = -8 * coefficient * X ** (power - 1) / sympy.pi
    if level is None:
        weight = -power * quarter(2 * power, sympy.S.Zero) / (power + 1)
        energy = 4 * coefficient * X ** (power + 1) * (1 - power) / (power + 1)
        return scale * weight, energy
    weight = _behind(power, level, partials)
    grown = (X ** (power + 1) - level ** (power + 1)) / (power + 1)
    return scale * weight, coefficient * (8 * grown - 4 * X ** (power + 1))


def _behind(
    power: sympy.Expr, level: sympy.Expr, partials: dict[tuple[sympy.Expr, sympy.Expr], Partial]
) -> sympy.Expr:
    """Return J in angle, root and cosine at the threshold."""
    first = _rise(power + sympy.S.Half, level)
    if power.is_zero:
        return -first
    if (2 * power).is_Integer:
        return -(first + power * _whole(power, level)) / (power + 1)
    if (power, level) not in partials:
        name = sympy.Symbol(f"integral_{len(partials) + 1}", real=True)
        partials[power, level] = Partial(name, power, level)
    # written from zero, what grows with X cancels where the law slips as a whole
    beyond = quarter(2 * power, sympy.S.Zero) - partials[power, level].name
    return -(first + power * beyond) / (power + 1)


def _rise(half: sympy.Expr, level: sympy.Expr) -> sympy.Expr:
    """Return sin(T)**(2 half) cos(T)."""
    if half.is_Integer:
        return level**half * X**-half * _COSINE
    return level ** (half - sympy.S.Half) * X ** (-half - sympy.S.Half) * _ROOT


def _whole(power: sympy.Expr, level: sympy.Expr) -> sympy.Expr:
    """Return integral_T^(pi/2) sin(t)**(2 P) dt for whole 2 P."""
    if power.is_zero:
        return _ANGLE
    if power == sympy.S.Half:
        return _COSINE
    double = 2 * power
    return _rise(power - sympy.S.Half, level) / double + (double - 1) / double * _whole(power - 1, level)


def _read(terms: dict[sympy.Expr | None, tuple[sympy.Expr, dict[sympy.Symbol, sympy.Expr]]]) -> Reading:
    """Write a sum over thresholds as cases in X; with a single threshold as one formula a case."""
    base = terms.get(None, (sympy.S.Zero, {}))[0]
    behind = {level: pair for level, pair in terms.items() if level is not None}
    shared = len(behind) == 1
    total, conditions = sympy.S.Zero if shared else _tidy(base), list[sympy.Basic]()
    for level, (formula, ends) in behind.items():
        before = _tidy(base) if shared else sympy.S.Zero
        beyond = _tidy((base if shared else sympy.S.Zero) + formula, ends)
        if beyond == before:
            total += before
            continue
        below, above = sympy.Le(X, level), sympy.Gt(X, level)
        total += sympy.Piecewise((before, below), (beyond, sympy.true))
        conditions += [below, above]
    return Reading(total, tuple(conditions))


def _tidy(formula: sympy.Expr, written: dict[sympy.Symbol, sympy.Expr] | None = None) -> sympy.Expr:
    """Collect terms with the same angle, root or integral and the same power of X."""
    written = written or {}
    powers_of = formula.atoms(sympy.Pow)
    if not any(p.base.is_Add or (p.base == X and p.exp.free_symbols) for p in powers_of):
        return tidy(formula, written)
    inside = sorted((f for f in formula.free_symbols if f.name.startswith("integral_")), key=str)
    total = sympy.S.Zero
    for atom, part in sympy.collect(sympy.expand_mul(formula), [*written, *inside], evaluate=False).items():
        powers: dict[sympy.Expr, list[sympy.Expr]] = {}
        for addend in sympy.Add.make_args(sympy.expand_mul(part)):
            coefficient, exponent = sympy.powsimp(addend).as_coeff_exponent(X)
            powers.setdefault(sympy.expand(exponent), []).append(coefficient)
        factors = ((exponent, _factored(found)) for exponent, found in powers.items())
        total += atom * sympy.Add(*(factor * X**exponent for exponent, factor in factors))
    return total.xreplace(written)


def _factored(addends: list[sympy.Expr]) -> sympy.Expr:
    return sympy.powsimp(sympy.factor(sympy.Add(*addends)))
