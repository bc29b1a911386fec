"""What a law or a background may lack, as columns beside the fit: what each takes up, and what it moves.

No law is fitted again. At the solution a term of value zero has a slope like every parameter; what the
parameters and the unknowns of the points leave of it is compared with the misfit: its score test.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.linear_algebra import solve_scaled
from rsgen.data.oscillator import BACKGROUNDS, OFFSET
from rsgen.dynamics.linear_part import background_terms
from rsgen.formula.names import symbol
from rsgen.identification.fitting.across import law_of
from rsgen.identification.fitting.fit import Fit, linearise_beside
from rsgen.identification.fitting.least_squares import Alternative, alternatives
from rsgen.identification.fitting.observed import MISSING_TERMS, Observed, Problem, with_coefficients
from rsgen.identification.results.estimates import Agreement
from rsgen.law.element import Element, make_element
from rsgen.law.numeric import ForceLaw

EVEN_SHARE = 0.1
"""k2 X/k for which it is said what an even term would move: nobody sees it in a fundamental."""


def law_with(problem: Problem, *terms: str) -> ForceLaw:
    """Add terms to the law, across two sensors where some elements act there."""
    place = problem.law.parts[-1].sensors
    forces = with_coefficients(terms, problem.law.parameters)
    return law_of((*problem.elements, *(_term(force, place) for force in forces.values())))


@lru_cache(maxsize=64)
def _term(force: str, place: str) -> Element:
    return make_element("term beside the law", force, across=place)


def with_terms(problem: Problem, fit: Fit, terms: Sequence[str]) -> tuple[Problem, Array, list[int]]:
    """The problem with terms, the values of a fit with zeros for them, and their places (t,).

    Even terms make motions that are not odd.
    """
    values, mass, background = problem.split(fit.regression.parameters)
    law, known = law_with(problem, *terms), dict(zip(problem.law.parameters, values, strict=True))
    start = np.array([known.get(name, 0.0) for name in law.parameters])
    frozen = tuple(law.parameters.index(problem.law.parameters[place]) for place in problem.frozen)
    trial = replace(problem, law=replace(law, odd=problem.law.odd and law.odd), frozen=frozen)
    added = with_coefficients(terms, known)
    return trial, trial.join(start, mass, background), [law.parameters.index(name) for name in added]


def terms_beside(fit: Fit, noise: float, terms: Sequence[str] = MISSING_TERMS) -> dict[str, Alternative]:
    """Fit each term that the law may lack beside it, to first order, in units of a noise.

    No law lacks a term whose coefficient is fixed.
    """
    given = {fit.problem.law.expression.diff(symbol(name)) for name in fit.problem.fixed}
    terms = [term for term in terms if make_element("term", term).force not in given]
    problem, parameters, added = with_terms(fit.problem, fit, terms)
    residual, matrix = linearise_beside(fit, problem, parameters)
    # none where no loop is followed with another term beside it
    right, rows = residual.reshape(-1) / noise, matrix.reshape(residual.size, len(parameters)) / noise
    kept = np.delete(np.arange(len(parameters)), added)
    none = np.zeros(len(parameters)), np.zeros((0, len(right)))
    found = alternatives(right, rows[:, kept], rows[:, added], *none, problem.free[kept])
    return dict(zip(terms, found, strict=True))


def alternatives_to(
    fit: Fit, agreement: Agreement, *, backgrounds: bool
) -> dict[str, Mapping[str, Alternative]]:
    """Ask what a test says otherwise: by a law with one more term, by more of a background, by its halves.

    Parameters
    ----------
    fit, agreement
        A fit, and what halves of its points say.
    backgrounds
        Whether they are asked for.
    """
    noise = max(fit.regression.noise * agreement.typical, 1e-300)
    more = backgrounds_beside(fit, noise) if backgrounds else {}
    return {"term": terms_beside(fit, noise), "background": more, "halves": agreement.halves}


def backgrounds_beside(fit: Fit, noise: float) -> dict[str, Alternative]:
    """Fit each kind of background that has more than the one there is beside it, to first order.

    Without a neighbour, whose place no slope knows. Other modes are part of a measured motion across.
    """
    observed, count = fit.problem.observed, fit.problem.count
    points, band = observed.points, observed.band
    if fit.problem.law.acts_across or observed.kind.startswith(BACKGROUNDS[-1]):
        return {}
    seen = replace(Observed.of(points, BACKGROUNDS[-2] + OFFSET), band=band, scale=observed.scale)
    names, known = seen.background.names, dict(zip(observed.background.names, fit.background, strict=True))
    start = fit.problem.join(fit.values, fit.mass, np.array([known.get(name, 0.0) for name in names]))
    residual, matrix = linearise_beside(fit, replace(fit.problem, observed=seen), start)
    right, rows = residual.reshape(-1) / noise, matrix.reshape(residual.size, len(start)) / noise
    of_law = np.flatnonzero(fit.problem.free[:count])

    def solve(those: Collection[str]) -> tuple[Array, float]:
        """What parameters of the law move with these of the background, and the sum of squares left."""
        beside = [
            place for place, name in enumerate(names, count) if name in those and seen.fitted[place - count]
        ]
        columns = rows[:, [*of_law, *beside]]
        moved, change = solve_scaled(columns, right)[0], np.zeros(count)
        change[of_law] = moved[: len(of_law)]
        return change, float(np.sum((right - columns @ moved) ** 2))

    (begin, whole), found = solve(known), {}
    for kind in (kind + ending for kind in BACKGROUNDS[1:-1] for ending in ("", OFFSET)):
        more = background_terms(kind, points.omega, points.force, band).names
        if set(more) > set(known):
            change, left = solve(more)
            found[kind] = Alternative(float(np.sqrt(max(whole - left, 0.0))), 1.0, change - begin)
    return found


def even_beside(fit: Fit) -> tuple[float, Array]:
    """What a force k2*x**2 would move that fundamentals show by its square alone.

    Returns
    -------
    k2, moved
        A force of ``EVEN_SHARE`` of the inertia's at the largest amplitude, and (q,) by how much values are
        off that are fitted without it; for others as k2^2.
    """
    problem, parameters, (place,) = with_terms(fit.problem, fit, ("x**2",))
    points = problem.observed.points
    largest = int(np.argmax(points.amplitude))
    spring = fit.mass * float(points.omega[largest]) ** 2
    parameters[place] = EVEN_SHARE * spring / float(points.amplitude[largest])
    _, matrix = linearise_beside(fit, problem, parameters)
    rows = matrix.reshape(-1, len(parameters))
    # half of the slope times the force is the change of what goes with its square
    column = rows[:, place] * parameters[place] / 2
    moved, free = np.zeros(len(parameters)), np.flatnonzero(problem.free)
    free = free[free != place]
    moved[free] = solve_scaled(rows[:, free], column)[0]
    return float(parameters[place]), np.delete(moved, place)
