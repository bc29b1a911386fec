"""The closed part of a describing function for display: cases in the amplitude X.

    k(X) = k_0 + sum over switches with d_i < X of k_i(X)

A switch at distance d from the mean is off for X <= d, and on over a part of the cycle beyond. Switches that
begin to act at the same amplitude form a group, whose formula is written as a Piecewise in X: sums of arcs
as ``closed`` makes them hold in all regimes, but cannot be read (A. Gelb and W. E. Vander Velde,
Multiple-Input Describing Functions, 1968, App. B, have such cases for common laws).
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy

from rsgen.describing.closed import Arc, ClosedPart, End
from rsgen.formula.names import OMEGA, X

MAX_COLLECTED = 12
"""Largest number of angles, roots and Bessel functions by which terms are collected."""

Places = dict[sympy.Symbol, sympy.Expr]


@dataclass(frozen=True, slots=True)
class Reading:
    """A formula in X, X0, omega and parameters, and the conditions of its cases (empty: one case)."""

    formula: sympy.Expr
    conditions: tuple[sympy.Basic, ...]


@dataclass(frozen=True, slots=True)
class _Group:
    """Switches that go on and off at the same amplitude: the distance at which they do."""

    kind: str
    distance: sympy.Expr


def _fixed(end: End, angle: sympy.Expr, sine: sympy.Expr, cosine: sympy.Expr) -> Places:
    return dict(zip(end, (angle, sine, cosine), strict=True))


def _positive_part(level: sympy.Expr) -> tuple[sympy.Expr, int]:
    """Write a threshold as sign times distance."""
    if level.is_nonpositive or (not level.is_nonnegative and level.could_extract_minus_sign()):
        return _negative(level), -1
    return level, 1


def _negative(level: sympy.Expr) -> sympy.Expr:
    """Write -Max(-a, -b) as Min(a, b)."""
    turned = {sympy.Max: sympy.Min, sympy.Min: sympy.Max}.get(level.func)
    return -level if turned is None else turned(*(-argument for argument in level.args))


def _group_of(arc: Arc, mean: sympy.Expr) -> _Group:
    if arc.x_end is not None and arc.x is not None and isinstance(arc.x_end.angle, sympy.Symbol):
        return _Group("x", _positive_part(arc.x)[0] if mean == 0 else sympy.expand_mul(arc.x - mean))
    if arc.v_end is not None and arc.v is not None and isinstance(arc.v_end.angle, sympy.Symbol):
        return _Group("v", _positive_part(arc.v)[0])
    return _Group("always", sympy.S.Zero)


def _constant(arc: Arc, kind: str, *, on: bool) -> Places:
    """Return the ends of an arc while its switch is on, or off, over the whole cycle."""
    end = arc.x_end if kind == "x" else arc.v_end
    sign = sympy.Integer(-1 if on else 1)
    if end is None:
        return {}
    if kind == "x":
        return _fixed(end, sign * sympy.pi / 2, sign, sympy.S.Zero)
    return _fixed(end, sympy.pi * (1 - sign) / 2, sympy.S.Zero, sign)


def _between(arc: Arc, kind: str, mean: sympy.Expr, written: Places) -> Places:
    """Return the ends of an arc while its switch is on for a part of the cycle.

    Angle and root stay symbols, entered in ``written``, until the formula around them is tidy.
    """
    end, level = (arc.x_end, arc.x) if kind == "x" else (arc.v_end, arc.v)
    if end is None or level is None:
        return {}
    distance, sign = _positive_part(sympy.expand_mul(level - mean) if kind == "x" else level)
    reach = X if kind == "x" else OMEGA * X
    angle = sympy.Symbol(f"asin({distance}/{reach})", real=True)
    root = sympy.Symbol(f"sqrt({reach}**2 - ({distance})**2)", real=True)
    written[angle] = sympy.asin(distance / reach)
    written[root] = sympy.sqrt(reach**2 - distance**2)
    if kind == "x":
        return _fixed(end, sign * angle, sign * distance / reach, root / reach)
    return _fixed(end, sympy.pi / 2 - sign * angle, root / reach, sign * distance / reach)


def _cases(
    group: _Group, members: list[tuple[Arc, sympy.Expr]], mean: sympy.Expr, base: sympy.Expr
) -> list[tuple[sympy.Expr, sympy.Basic]]:
    """Return base plus value and condition for each regime of the switches of a group."""
    reach = X if group.kind == "x" else OMEGA * X
    distance = group.distance

    def value(choose: str) -> sympy.Expr:
        total, written = base, dict[sympy.Symbol, sympy.Expr]()
        for arc, formula in members:
            level = arc.x if group.kind == "x" else arc.v
            same = mean != 0 or level is None or _positive_part(level)[1] > 0
            if choose == "between":
                places = _between(arc, group.kind, mean, written)
            else:
                places = _constant(arc, group.kind, on=(choose == "near") != same)
            total += formula.xreplace(places)
        return tidy(total, written)

    cases = []
    if not distance.is_nonnegative:
        cases.append((value("behind"), reach <= -distance))
    if not distance.is_nonpositive:
        cases.append((value("near"), reach <= distance))
    if len(cases) == 2 and cases[0][0] == cases[1][0]:
        cases = [(cases[0][0], reach <= sympy.Abs(distance))]
    return [*cases, (value("between"), sympy.true)]


def tidy(formula: sympy.Expr, written: Places | None = None) -> sympy.Expr:
    """Collect terms by angle, root or Bessel function, so that differences stand together."""
    written = written or {}
    formula = sympy.expand(formula)
    special = sorted((*written, *formula.atoms(sympy.besselj, sympy.besseli)), key=sympy.default_sort_key)
    if 0 < len(special) <= MAX_COLLECTED:
        formula = sympy.collect(formula, special, sympy.factor_terms)
    if any(power.exp.free_symbols for power in formula.atoms(sympy.Pow)):
        formula = sympy.powsimp(formula, combine="exp")
    return formula.xreplace(written)


def read(closed: ClosedPart, place: int) -> Reading:
    """Write stiffness (place 0), damping (1) or mean force (2) as cases in X."""
    base = sympy.S.Zero
    groups: dict[_Group, list[tuple[Arc, sympy.Expr]]] = {}
    for arc, triple in closed.parts:
        formula = sympy.expand(triple[place])
        group = _group_of(arc, closed.mean)
        atoms = {atom for end in (arc.x_end, arc.v_end) if end for atom in end}
        if group.kind == "always" or not formula.free_symbols & atoms:
            base += formula
        else:
            groups.setdefault(group, []).append((arc, formula))
    if len(groups) == 1:
        ((group, members),) = groups.items()
        return _merged(_cases(group, members, closed.mean, base))
    total, conditions = tidy(base), []
    for group, members in groups.items():
        reading = _merged(_cases(group, members, closed.mean, sympy.S.Zero))
        total += reading.formula
        conditions += list(reading.conditions)
    return Reading(total, tuple(dict.fromkeys(conditions)))


def _merged(cases: list[tuple[sympy.Expr, sympy.Basic]]) -> Reading:
    if len({value for value, _ in cases}) == 1:
        return Reading(cases[0][0], ())
    conditions = [condition for _, condition in cases[:-1]]
    reach, distance = conditions[-1].args
    # with two cases before the last, X exceeds a distance that may have either sign
    beyond = reach > (distance if len(conditions) == 1 else sympy.Abs(distance))
    return Reading(sympy.Piecewise(*cases), (*conditions, beyond))
