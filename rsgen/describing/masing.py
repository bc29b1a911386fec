"""Closed describing functions of Masing laws.

With the virgin curve n the loop between -X and X gives, exactly,
k(X) = -4/(pi X) integral_0^pi n(X sin(phi/2)**2) cos(phi) dphi and the energy of a cycle
D(X) = 8 integral_0^X n dx - 4 X n(X), c = D/(pi omega X**2). With t = phi/2 a power x**P from a threshold b
on needs J = integral_T^(pi/2) sin(t)**(2 P) (1 - 2 sin(t)**2) dt, sin(T)**2 = b/X, which is
-(sin(T)**(2 P + 1) cos(T) + P integral_T^(pi/2) sin(t)**(2 P) dt)/(P + 1), by parts. The last integral is
elementary where 2 P is whole, and a gamma function for b = 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.describing.closed import MAX_POWER, quarter
from rsgen.describing.quadrature import Cycle, Projections, has_real_powers, project
from rsgen.describing.regimes import Reading, tidy
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import OMEGA, STATE_V, STATE_X, X0, X, symbol
from rsgen.law.forms import expanded
from rsgen.law.memory import MemoryForm
from rsgen.law.normal_form import normal_form

# ----------------------------------------------------------------------------
# Laws with memory along a cycle with known turning points: branches of Masing laws, structural damping.
#
# Between the turning points X0 - X and X0 + X the force of a Masing law rises from -n(X) by
# 2 n((x - X0 + X)/2) and falls from n(X) by 2 n((X0 + X - x)/2); the displacement a quarter of a period later
# is v/omega. On the cycle the law is again a function of x and v, and quadrature integrates it.


def _virgin_at(virgin: sympy.Expr, place: sympy.Expr) -> sympy.Expr:
    """Return the virgin curve at a displacement that is known as not negative."""
    if has_real_powers(virgin):
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
        found, cycle = self.projected(X_, mean, omega, values)
        return found.harmonics(cycle)

    def projected(
        self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]
    ) -> tuple[Projections, Cycle]:
        """Return the integrals over cycles (n,), and these cycles."""
        names = (X, X0, OMEGA, *map(symbol, self.parameters))
        fields = (X_, mean, omega, *(np.broadcast_to(values[name], X_.shape) for name in self.parameters))
        cycle = Cycle(X_, mean, omega, fields)
        return project(self.force, names, cycle), cycle

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


def pieces_of(virgin: sympy.Expr) -> dict[sympy.Expr | None, sympy.Expr] | None:
    """Sort the pieces of n(x) for x > 0 by threshold (None: from rest); None where its sign is not known."""
    found: dict[sympy.Expr | None, sympy.Expr] = {}
    for piece in normal_form(_continued(virgin)).pieces:
        level: sympy.Expr | None = None
        for switch in piece.switches:
            if switch.variable != "x" or switch.threshold is None:
                return None
            level = switch.threshold
        if level is not None and level.is_nonpositive:
            level = None
        elif level is not None and not level.is_positive:
            return None
        # a positive symbol in its place takes abs and products of powers away
        place = sympy.Symbol("x", positive=True)
        term = piece.term.subs(sympy.Abs(STATE_X), place).xreplace({STATE_X: place})
        found[level] = found.get(level, sympy.S.Zero) + sympy.powsimp(sympy.expand(term))
    terms = {level: expanded(term) for level, term in found.items()}
    return {level: term for level, term in terms.items() if level is None or not term.is_zero}


_ANGLE, _ROOT, _COSINE = (sympy.Dummy(name, positive=True) for name in ("angle", "root", "cosine"))
"""pi/2 - T, X sin(T) cos(T) and cos(T) at a threshold."""

Pair = tuple[sympy.Expr, sympy.Expr]
"""Stiffness [N/m] and energy of a cycle [J]."""


@dataclass(frozen=True, slots=True)
class ClosedMasing:
    """Stiffness and damping of a Masing law as formulas."""

    stiffness: Reading
    damping: Reading

    @property
    def shown(self) -> Pair:
        """Stiffness and damping."""
        return self.stiffness.formula, self.damping.formula

    def evaluate(
        self, X_: Array, omega: Array, names: tuple[sympy.Symbol, ...], values: tuple[Array, ...]
    ) -> tuple[Array, Array]:
        """Return stiffness [N/m] and damping [N s/m]; arrays (n,), parameters (n,) or scalars."""
        stiffness, damping = compiled(self.shown, (X, OMEGA, *names))(X_, omega, *values)
        return np.broadcast_to(stiffness, X_.shape), np.broadcast_to(damping, X_.shape)

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
        return ClosedMasing(stiffness, damping)


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
    written: dict[sympy.Expr | None, tuple[Pair, dict[sympy.Symbol, sympy.Expr]]] = {}
    for level, term in pieces.items():
        ends = {} if level is None else _ends(level)
        total: Pair = (sympy.S.Zero, sympy.S.Zero)
        for addend in sympy.Add.make_args(term):
            pair = _addend(addend, level)
            if pair is None:
                return None
            total = total[0] + pair[0], total[1] + pair[1]
        written[level] = (total, ends)
    per_energy = 1 / (sympy.pi * OMEGA * X**2)
    readings = (
        _read({level: (pair[0] * factor, ends) for level, (pair, ends) in written.items()}),
        _read({level: (pair[1] * factor * per_energy, ends) for level, (pair, ends) in written.items()}),
    )
    return ClosedMasing(*readings)


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


def _addend(addend: sympy.Expr, level: sympy.Expr | None) -> Pair | None:
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
    if not (2 * power).is_Integer:
        return None
    # J in angle, root and cosine at the threshold
    rise = _rise(power + sympy.S.Half, level)
    weight = -rise if power.is_zero else -(rise + power * _whole(power, level)) / (power + 1)
    grown = (X ** (power + 1) - level ** (power + 1)) / (power + 1)
    return scale * weight, coefficient * (8 * grown - 4 * X ** (power + 1))


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
    total, conditions = sympy.S.Zero if shared else tidy(base), list[sympy.Basic]()
    for level, (formula, ends) in behind.items():
        before = tidy(base) if shared else sympy.S.Zero
        beyond = tidy((base if shared else sympy.S.Zero) + formula, ends)
        if beyond == before:
            total += before
            continue
        below, above = sympy.Le(X, level), sympy.Gt(X, level)
        total += sympy.Piecewise((before, below), (beyond, sympy.true))
        conditions += [below, above]
    return Reading(total, tuple(conditions))
