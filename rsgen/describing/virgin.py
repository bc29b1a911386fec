"""Virgin curves of Masing laws: their pieces for x > 0, sorted by the displacement at which they begin."""

from __future__ import annotations

from dataclasses import dataclass

import sympy

from rsgen.formula.evaluation import compiled
from rsgen.formula.names import STATE_X
from rsgen.law.normal_form import expanded, moves
from rsgen.law.pieces import NormalForm, normal_form, normal_form_at

__all__ = ["Pieces", "decisive_in", "pieces_of"]


def decisive_in(virgin: sympy.Expr) -> set[str]:
    """Name the parameters of a virgin curve whose sign decides how the formulas look."""
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
