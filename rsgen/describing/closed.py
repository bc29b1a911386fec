"""The closed part of a describing function: stiffness, damping and mean force of every piece, by its arc."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.describing.arcs import Arc, End, make_arc
from rsgen.describing.terms import read_addend
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import OMEGA, X0, X
from rsgen.law.pieces import NormalForm

__all__ = ["ClosedPart", "Triple", "close"]


LONGEST = 150
"""Terms beyond which a formula is read by nobody and would take many seconds: quadrature is better there."""

ENDS_OF_BOTH = 4
"""Ends of the arcs on which a switch in x and one in v are on together; a single switch has half as many."""

Triple = tuple[sympy.Expr, sympy.Expr, sympy.Expr]
"""Stiffness [N/m], damping [N s/m] and mean force [N]."""


@dataclass(frozen=True, slots=True)
class ClosedPart:
    """Sums over the pieces of a law, by the arc on which they act; formulas in the atoms of their arcs."""

    parts: tuple[tuple[Arc, Triple], ...]
    mean: sympy.Expr

    @property
    def total(self) -> Triple:
        """The sum over all arcs, in atoms."""
        stiffness, damping, force = (
            sympy.Add(*(triple[place] for _, triple in self.parts)) for place in range(3)
        )
        return stiffness, damping, force

    def evaluate(
        self, X_: Array, mean: Array, omega: Array, values: Mapping[sympy.Symbol, Array]
    ) -> list[Array]:
        """Give stiffness, damping and mean force as arrays; all inputs broadcast against each other."""
        names = tuple(values)
        atoms: dict[sympy.Symbol, Array] = {}
        for arc, _ in self.parts:
            _place_atoms(arc, X_, mean, omega, names, tuple(values.values()), atoms)
        arguments = (X, X0, OMEGA, *names, *atoms)
        results = compiled(self.total, arguments)(X_, mean, omega, *values.values(), *atoms.values())
        shape = np.broadcast_shapes(X_.shape, mean.shape, omega.shape, *(v.shape for v in values.values()))
        return [np.broadcast_to(result, shape) for result in results]


def _place_atoms(
    arc: Arc,
    X_: Array,
    mean: Array,
    omega: Array,
    names: tuple[sympy.Symbol, ...],
    values: tuple[Array, ...],
    atoms: dict[sympy.Symbol, Array],
) -> None:
    """Compute the ends of an arc and enter them under their symbols."""

    def enter(end: End, angle: Array, sine: Array, cosine: Array) -> None:
        for place, value in zip(end, (angle, sine, cosine), strict=True):
            if isinstance(place, sympy.Symbol):
                atoms[place] = value

    with np.errstate(all="ignore"):
        if arc.x_end is not None and arc.x is not None:
            (level,) = compiled((arc.x,), names)(*values)
            sine = np.clip((level - mean) / X_, -1, 1)
            alpha = np.arcsin(sine)
            enter(arc.x_end, alpha, sine, np.sqrt((1 - sine) * (1 + sine)))
        if arc.v_end is not None and arc.v is not None:
            (level,) = compiled((arc.v,), names)(*values)
            cosine = np.clip(level / (omega * X_), -1, 1)
            beta = np.arccos(cosine)
            enter(arc.v_end, beta, np.sqrt((1 - cosine) * (1 + cosine)), cosine)
    if arc.both:
        low = np.maximum(alpha, -beta)
        far = np.pi - alpha
        near = np.minimum(2 * np.pi - beta, far)
        for end, angle in zip(
            arc.both, (low, np.maximum(low, np.minimum(far, beta)), near, far), strict=True
        ):
            enter(end, angle, np.sin(angle), np.cos(angle))


def close(form: NormalForm, mean: sympy.Expr) -> ClosedPart | None:
    """Find the closed form of all pieces of a law; None where one addend has none.

    Parameters
    ----------
    form
        Normal form of the law.
    mean
        X0, or zero for a law known to move about zero.
    """
    parts: dict[Arc, list[Triple]] = {}
    levels = [s.threshold for s in form.switches if s.threshold is not None]
    if any(e.has(sympy.Piecewise) for e in (*levels, *(piece.term for piece in form.pieces))):
        # parameters that are cases of other parameters make formulas that nobody reads, and slowly
        return None
    length = 0
    for piece in form.pieces:
        places: dict[str, sympy.Expr] = {}
        for switch in piece.switches:
            if switch.variable is None or switch.threshold is None:
                return None
            places[switch.variable] = switch.threshold
        arc = make_arc(places.get("x"), places.get("v"), mean == 0)
        length += _length(piece.term, arc)
        if length > LONGEST:
            return None
        for addend in sympy.Add.make_args(piece.term):
            triple = _triple(addend, arc, mean)
            if triple is None:
                return None
            parts.setdefault(arc, []).append(triple)
    summed = []
    for arc, triples in parts.items():
        total = tuple(sympy.Add(*column) for column in zip(*triples, strict=True))
        summed.append((arc, (total[0], total[1], total[2])))
    return ClosedPart(tuple(summed), mean)


def _length(term: sympy.Expr, arc: Arc) -> int:
    """Count the terms of the formula of a piece, before they are sorted by angles and roots."""
    moving = {
        end for end in (arc.x_end, arc.v_end) if end is not None and isinstance(end.angle, sympy.Symbol)
    }
    length = 0
    for addend in sympy.Add.make_args(term):
        degrees = [addend.as_coeff_exponent(state)[1] for state in (symbol("x"), symbol("v"))]
        m, n = (int(degree) if degree.is_Integer and degree > 0 else 0 for degree in degrees)
        length += (1 + m) * (1 + n) * (ENDS_OF_BOTH if arc.both else 1) if moving else 1
    return length


def _triple(addend: sympy.Expr, arc: Arc, mean: sympy.Expr) -> Triple | None:
    read = read_addend(addend)
    if read is None:
        return None
    sine, cosine, level = (read.integral(arc, mean, i, j) for i, j in ((1, 0), (0, 1), (0, 0)))
    if sine is None or cosine is None or level is None:
        return None
    weights = (1 / (sympy.pi * X), 1 / (sympy.pi * OMEGA * X), 1 / (2 * sympy.pi))
    stiffness, damping, force = (
        sympy.expand_mul(weight * part) for weight, part in zip(weights, (sine, cosine, level), strict=True)
    )
    return stiffness, damping, force
