"""In which parameters a law is linear at once, and in which only by a common factor of several."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from functools import lru_cache
from itertools import combinations, combinations_with_replacement, product

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.law.normal_form import expanded
from rsgen.law.pieces import Piece

__all__ = ["PLACES", "SAME", "SIZES", "is_scaled", "jointly_linear", "scaled_groups", "vanishes"]


PLACES = 64
"""Random states or values at which an identity is tried."""

SIZES = (1e-3, 1.0, 1e3)
"""Of random states and values: numbers in a law hide at one size what another shows."""

SAME = 1e-9
"""Relative size at which terms cancel."""

_ROUND_OFF = 1e-12
"""What is left of parts that cancel, relative to the largest of them: b*ks - b*abs(ks)."""

_CLEAR = 1e-6
"""Relative second difference that is no round-off, so that no derivative needs to be looked at."""

_LONGEST_TERM = 150
"""Operations of a term whose slopes are looked at, five times those of the longest law of the library. Second
derivatives of a longer one may take seconds; its parameters are linear where it is written so."""

_MOST_LINEAR_SETS = 12
"""Above this number of parameters the linear ones are chosen greedily instead of by trying every set."""

_LARGEST_GROUP = 3
"""Parameters in a group of degree one; force and stiffness of a saturation are two."""

_FACTORS = (1.0, 2.0, 3.0)
"""Common factors of a group at which the force must be affine."""


def jointly_linear(
    pieces: Sequence[Piece],
    parameters: Sequence[sympy.Symbol],
    clashing: AbstractSet[tuple[int, int]] = frozenset(),
) -> tuple[int, ...]:
    """Find the largest set of parameters in which every term is linear at once (first such set by name).

    ``clashing`` are pairs in which the law is known not to be.
    """
    switches = {switch.function for piece in pieces for switch in piece.switches}
    thresholds = {free for function in switches for free in function.free_symbols}
    every = [piece.term for piece in pieces]
    terms = [term for term in every if term.count_ops() <= _LONGEST_TERM]
    place = {p: i for i, p in enumerate(parameters)}
    clash = set(clashing).union(*(_met(term, place)[1] for term in every if term not in terms))
    clash |= _bent(terms, parameters)
    # slopes of long fractions are longer: they are asked for only where trials found nothing
    slopes = [[] if (i, i) in clash else [term.diff(p) for term in terms] for i, p in enumerate(parameters)]
    clash |= {
        (i, j)
        for i, row in enumerate(slopes)
        for j, other in enumerate(parameters)
        if i <= j
        and not {(i, i), (i, j), (j, j)} & clash
        and not all(vanishes(slope.diff(other)) for slope in row if slope.has(other))
    }
    free = [i for i, p in enumerate(parameters) if p not in thresholds and (i, i) not in clash]
    if len(free) <= _MOST_LINEAR_SETS:
        for size in range(len(free), 0, -1):
            for chosen in combinations(free, size):
                if not any(pair in clash for pair in combinations(chosen, 2)):
                    return chosen
    picked: list[int] = []
    for i in sorted(free, key=lambda i: sum(i in pair for pair in clash)):
        if not any(tuple(sorted((i, j))) in clash for j in picked):
            picked.append(i)
    return tuple(sorted(picked))


def _met(
    expression: sympy.Expr, place: Mapping[sympy.Symbol, int]
) -> tuple[frozenset[int], set[tuple[int, int]]]:
    """Find the parameters of an expression, and the pairs that meet in a product or a function of it.

    In parameters of which no two meet the expression is linear at once; what cancels is not looked for.
    """
    if not expression.args:
        return frozenset({place[expression]} if expression in place else ()), set()
    inside, clashes = zip(*(_met(part, place) for part in expression.args), strict=True)
    held: frozenset[int] = frozenset().union(*inside)
    clash: set[tuple[int, int]] = set().union(*clashes)
    if expression.is_Mul:
        pairs = (pair for one, other in combinations(inside, 2) for pair in product(one, other))
        clash |= {(min(pair), max(pair)) for pair in pairs}
    elif not expression.is_Add:
        clash |= set(combinations_with_replacement(sorted(held), 2))
    return held, clash


def _bent(terms: Sequence[sympy.Expr], parameters: Sequence[sympy.Symbol]) -> set[tuple[int, int]]:
    """Find pairs of parameters in which a term is clearly not linear at once, by second differences.

    What is left of them is compared with all addends, whose round-off (x - b)**7 consists of near x = b.
    """
    parts = [sympy.Add.make_args(expanded(term)) for term in terms]
    starts = np.cumsum([0, *(len(part) for part in parts[:-1])])
    states = tuple(sorted({s for term in terms for s in term.free_symbols} - set(parameters), key=str))
    law = compiled(tuple(addend for part in parts for addend in part), (*states, *parameters))
    generator = np.random.default_rng(0)
    places = np.exp(generator.normal(size=(len(states) + len(parameters), PLACES)))

    def moved(*which: int) -> Array:
        trial = np.array(places)
        for i in which:
            trial[len(states) + i] += 0.5 * places[len(states) + i]
        return np.array([np.broadcast_to(value, PLACES) for value in law(*trial)])

    if not parts:
        return set()
    still, once = moved(), [moved(i) for i in range(len(parameters))]
    found = set()
    with np.errstate(all="ignore"):
        for i, j in combinations_with_replacement(range(len(parameters)), 2):
            corners = np.array([still, -once[i], -once[j], moved(i, j)])
            size = np.add.reduceat(np.abs(corners).max(axis=0), starts)
            bend = np.abs(np.add.reduceat(corners.sum(axis=0), starts))
            if np.any((bend > _CLEAR * size) & np.isfinite(size)):
                found.add((i, j))
    return found


def vanishes(expression: sympy.Expr) -> bool:
    """Decide whether an expression is zero, from its value at random places: to simplify one may not end."""
    if expression == 0:
        return True
    if expression.has(sympy.DiracDelta, sympy.Derivative):
        # the slope of |p| jumps where p changes its sign
        return False
    variables = tuple(sorted(expression.free_symbols, key=str))
    parts = sympy.Add.make_args(expression)
    generator = np.random.default_rng(0)
    # sizes differ, so that what a large number in a law hides at most places shows at some
    places = 10.0 ** generator.uniform(-4, 4, (len(variables), PLACES)) * generator.uniform(0.5, 2.0, PLACES)
    values = np.array([np.broadcast_to(part, PLACES) for part in compiled(parts, variables)(*places)])
    with np.errstate(over="ignore"):
        size = np.sum(np.abs(values), axis=0)
    shown = np.isfinite(size) & (size > 0)
    return bool(shown.any() and np.all(np.abs(values[:, shown].sum(axis=0)) <= SAME * size[shown]))


def scaled_groups(
    count: int,
    linear: Sequence[int],
    is_scaled: Callable[[tuple[int, ...], Sequence[int]], bool],
) -> tuple[tuple[int, ...], ...]:
    """Find the smallest disjoint groups of nonlinear parameters in whose common factor a law is linear."""
    free = [i for i in range(count) if i not in linear]
    groups: list[tuple[int, ...]] = []
    for size in range(1, _LARGEST_GROUP + 1):
        for chosen in combinations(free, size):
            if set(chosen) & {i for group in groups for i in group}:
                continue
            if is_scaled(chosen, linear):
                groups.append(chosen)
    return tuple(groups)


def is_scaled(
    pieces: Sequence[Piece],
    parameters: Sequence[sympy.Symbol],
    chosen: tuple[int, ...],
    linear: Sequence[int],
) -> bool:
    """Decide whether a factor of the chosen acts on a law that is affine in it."""
    scaled = [_scales(piece, parameters, chosen, linear) for piece in pieces]
    return None not in scaled and any(scaled)


@lru_cache(maxsize=512)
def _addends(piece: Piece) -> tuple[sympy.Expr, ...]:
    return tuple(sympy.Add.make_args(expanded(piece.term)))


@np.errstate(all="ignore")
def _scales(
    piece: Piece, parameters: Sequence[sympy.Symbol], chosen: tuple[int, ...], linear: Sequence[int]
) -> bool | None:
    """Decide whether a factor of the chosen acts on a piece; None where the piece is not affine in it.

    Switches may change by a positive factor only.
    """
    group = {parameters[i] for i in chosen}
    addends, functions = _addends(piece), (switch.function for switch in piece.switches)
    every = (*addends, *functions)
    touched = [i for i, part in enumerate(every) if part.free_symbols & group]
    parts = [every[i] for i in touched if i < len(addends)]
    if not touched:
        return False
    if not parts or any(part.free_symbols & {parameters[i] for i in linear} for part in parts):
        # a part that another unknown multiplies would be linear in neither
        return None
    # one function of all parts serves every group
    law = compiled(every, (symbol("x"), symbol("v"), *parameters))
    generator = np.random.default_rng(1)
    acts = False
    for size in SIZES:
        x, v = generator.normal(size=(2, PLACES)) * size
        values = np.exp(generator.normal(size=len(parameters))) * generator.choice(SIZES)
        drawn = []
        for factor in _FACTORS:
            trial = np.array(values)
            trial[list(chosen)] *= factor
            all_parts = law(x, v, *trial)
            drawn.append([np.broadcast_to(all_parts[i], x.shape) for i in touched])
        shares = np.array([each[: len(parts)] for each in drawn])
        signs = [each[len(parts) :] for each in drawn]
        shares = shares[:, :, np.all(np.isfinite(shares), axis=(0, 1))]
        forces = shares.sum(axis=1)
        step = np.max(np.abs(forces[1] - forces[0]), initial=0.0)
        second = forces[2] - 2 * forces[1] + forces[0]
        round_off = _ROUND_OFF * np.max(np.abs(shares), initial=0.0)
        if np.any(np.abs(second) > max(SAME * step, round_off)) or not _same_sign(signs):
            return None
        acts |= bool(step > max(SAME * np.max(np.abs(forces), initial=0.0), round_off))
    return acts


@np.errstate(all="ignore")
def _same_sign(signs: Sequence[Sequence[Array]]) -> bool:
    """Decide whether switches change by one positive factor at all states."""
    for before, after in zip(signs[0], signs[1], strict=True):
        size = np.max(np.abs(before), initial=0.0)
        factor = float(np.sum(before * after) / np.sum(before * before))
        if not (factor > 0 and np.all(np.abs(after - factor * before) <= SAME * factor * size)):
            return False
    return True
