"""Which sums of terms come near the test? Every term is evaluated once, every sum is a small least squares.

Parameters in which a term is not linear take a few values each, and between them the term is linearised.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from rsgen.expression import parse
from rsgen.identification.force_law import compile_law
from rsgen.ranking.balance import Rows
from rsgen.ranking.terms import Sum, Term

__all__ = ["Trial", "search_sums"]

Array = NDArray[np.float64]

_RIDGE = 1e-10
"""Columns have unit size; beneath this share of it a combination of them is not told."""

_BEAM = 24
"""So many sums of the best are tried with one term more."""

_ROOM = 0.1
"""Relative change of a value that its slope is trusted for."""

_BASE = compile_law(parse("c*v + k*x"))


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A sum of terms with the values that come nearest to the test.

    Parameters
    ----------
    law
        The sum.
    values
        Of every parameter, by its name in the sum; the mass is "m" where it is free.
    misfit
        Sum of squares left, in units of the noise.
    bic
        Bayesian information criterion: misfit + parameters * log(rows).
    """

    law: Sum
    values: dict[str, float]
    misfit: float
    bic: float


@dataclass(frozen=True, slots=True)
class _Variant:
    """A term at one value of each parameter it is not linear in: columns of coefficients, then of slopes."""

    values: tuple[float, ...]
    columns: tuple[int, ...]


class _Columns:
    """All columns, normalised, and their products."""

    def __init__(self, rows: Rows, terms: Sequence[Term], mass: float | None) -> None:
        x, v, a, step = rows.trajectory
        size, speed = float(np.max(np.abs(x))), float(np.max(np.abs(v)))
        base = _BASE.sample(x, v, a, step, np.zeros(2)).by_parameter
        blocks = [rows.of(np.stack(base, axis=-1)), rows.inertia[:, :, None]]
        self.mass = mass
        self.variants: dict[str, list[_Variant]] = {}
        count = 3
        for term in terms:
            names = term.law.parameters
            order = [names.index(name) for name in (*term.linear, *term.search)]
            ranges = [
                [where.factor(size, speed) * value for value in where.values]
                for where in term.search.values()
            ]
            self.variants[term.name] = []
            for trial in product(*ranges):
                point = np.zeros(len(names))
                point[names.index(term.linear[0])] = 1.0
                for name, value in zip(term.search, trial, strict=True):
                    point[names.index(name)] = value
                sample = term.law.sample(x, v, a, step, point)
                blocks.append(rows.of(np.stack([sample.by_parameter[i] for i in order], axis=-1)))
                self.variants[term.name].append(_Variant(trial, tuple(range(count, count + len(order)))))
                count += len(order)
        told = rows.told
        matrix = np.concatenate(blocks, axis=2)[:, told].reshape(-1, count)
        right = rows.right - (0.0 if mass is None else mass) * rows.inertia
        flat = right[:, told].reshape(-1)
        norm = np.sqrt(np.sum(matrix**2, axis=0))
        self.norm = np.where(norm > 0, norm, 1.0)
        matrix = matrix / self.norm
        self.products = matrix.T @ matrix
        self.against = matrix.T @ flat
        self.power = float(flat @ flat)
        self.rows = len(flat)


def search_sums(rows: Rows, terms: Sequence[Term], mass: float | None, most: int) -> list[Trial]:
    """Try the base, every term, every pair, and the best sums with every term more; best first by BIC.

    Parameters
    ----------
    rows
        The balance.
    terms
        What there is.
    mass
        [kg], None where it is free.
    most
        Terms in a sum.
    """
    columns = _Columns(rows, terms, mass)

    def sensible(chosen: Sequence[Term]) -> bool:
        return sum(term.own_spring for term in chosen) <= 1

    found: dict[frozenset[str], tuple[Trial, tuple[_Variant, ...]]] = {}

    def consider(chosen: tuple[Term, ...], variants: Sequence[Sequence[_Variant]]) -> None:
        result = _best(columns, Sum(chosen), variants)
        key = frozenset(term.name for term in chosen)
        if result is not None and (key not in found or result[0].misfit < found[key][0].misfit):
            found[key] = result

    for size in range(min(most, 2) + 1):
        for chosen in filter(sensible, combinations(terms, size)):
            consider(chosen, [columns.variants[term.name] for term in chosen])
    for size in range(3, most + 1):
        last = sorted(
            (entry for key, entry in found.items() if len(key) == size - 1),
            key=lambda entry: entry[0].misfit,
        )
        for trial, variants in last[:_BEAM]:
            inside = {term.name for term in trial.law.terms}
            for term in terms:
                if term.name not in inside and sensible((*trial.law.terms, term)):
                    fixed = [[variant] for variant in variants]
                    consider((*trial.law.terms, term), [*fixed, columns.variants[term.name]])
    return sorted((entry[0] for entry in found.values()), key=lambda trial: trial.bic)


def _best(
    columns: _Columns, law: Sum, variants: Iterable[Sequence[_Variant]]
) -> tuple[Trial, tuple[_Variant, ...]] | None:
    """Solve for every combination of variants at once and take the best that is allowed."""
    # c, k, mass: as _Columns has them
    base = {"c": 0}
    if law.has_spring:
        base["k"] = 1
    if columns.mass is None:
        base["m"] = 2
    choices = list(product(*variants))
    index = np.array([[*base.values(), *(i for v in choice for i in v.columns)] for choice in choices])
    matrix = columns.products[index[:, :, None], index[:, None, :]]
    width = index.shape[1]
    matrix[:, np.arange(width), np.arange(width)] += _RIDGE
    right = columns.against[index]
    solution = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    misfit = columns.power - np.sum(solution * right, axis=1)
    misfit[~_allowed(law, solution[:, len(base) :])] = np.inf
    i = int(np.argmin(misfit))
    if not np.isfinite(misfit[i]):
        return None
    coefficients = (solution[i] / columns.norm[index[i]]).tolist()
    values = dict(zip(base, coefficients, strict=False))
    rest = coefficients[len(base) :]
    for term, names, variant in zip(law.terms, law.names, choices[i], strict=True):
        first = rest[0]
        for name in term.linear:
            values[names[name]] = rest.pop(0)
        for name, value in zip(term.search, variant.values, strict=True):
            # a slope of the unit term, so relative to its coefficient
            move = rest.pop(0) / first if first else 0.0
            values[names[name]] = value + float(np.clip(move, -_ROOM * abs(value), _ROOM * abs(value)))
    left = max(float(misfit[i]), 0.0)
    return Trial(law, values, left, left + len(values) * float(np.log(columns.rows))), choices[i]


def _allowed(law: Sum, coefficients: Array) -> NDArray[np.bool_]:
    """(trials,) False where friction would feed energy."""
    allowed = np.ones(len(coefficients), dtype=bool)
    place = 0
    for term in law.terms:
        for i, name in enumerate(term.linear):
            if name in term.dissipates:
                allowed &= coefficients[:, place + i] >= 0
        place += len(term.linear) + len(term.search)
    return allowed
