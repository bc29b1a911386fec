"""Which law? Candidates compared with the test and with each other.

All candidates are compared along one motion, that of the best law so far; with a better law found the motion
is taken anew, until the best law is the one whose motion it is. Along it every candidate is a fit of maximum
likelihood, to second order in its distance from the best; a ranking of near candidates needs no more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError, require
from rsgen.common.finding import Finding, quantities
from rsgen.common.tolerances import (
    ANY_LAW,
    EXCESS,
    EXPECTED_NOISE,
    LARGE,
    NOTICEABLE,
    ORDER,
    QUICK,
    START_ORDER,
)
from rsgen.data.oscillator import Model, Observation, join_model, refuse_across
from rsgen.data.surface import ResponseSurface, without_copies
from rsgen.formula import symbol
from rsgen.identification.fitting.fit import fit_balance
from rsgen.identification.fitting.observed import Observed, Problem
from rsgen.identification.fitting.points import Points, mass_needs, per_unit_mass, select_points
from rsgen.identification.ranking.balance import Rows, Term, base_law
from rsgen.identification.ranking.fitting import Fitted, Guess, fit_rows
from rsgen.identification.ranking.ranking_result import OWN, Candidate, Ranking, implausible, is_same, judge
from rsgen.identification.ranking.reference import (
    Reference,
    first_rows,
    follow,
    neighbour_noise,
    outlying,
)
from rsgen.identification.ranking.selection import Entries, competitors, start_guess
from rsgen.identification.results import Identification
from rsgen.identification.starting.start import start_fit
from rsgen.law.element import Element, LawLike, as_elements
from rsgen.law.memory import with_equations
from rsgen.law.numeric import compile_law

_TIE = 6.0
"""Difference of BIC that is strong evidence (Kass and Raftery, Bayes factors, JASA 90 (1995))."""

_AGAIN = 3
"""Best candidates of a round whose motion is tried, and that compete in the next: a search is coarser than
a fit."""

_ROUNDS = 5
"""In which the best law of one gives the motion of the next: most end with the law they began with."""

_POINTS = 500
"""That are enough to separate laws; more of them only narrow intervals."""

_CONFIRMED = 3.0
"""The right law leaves as much along its own motions as in the ranking, a few harmonics apart."""

_CERTAINLY = 0.03
"""Friction that sticks leaves less than this with a few harmonics."""

_FLEXIBLE = (f"{ANY_LAW} + Ff*sign(v)", ANY_LAW)
"""Follow other laws roughly, with friction and without: where no law is given, they fit the background."""


@dataclass(frozen=True, slots=True, eq=False)
class _Round:
    """Candidates along the motion of one of them: ``leader`` is that one, fitted along it."""

    reference: Reference
    noise: Array
    rows: Rows
    leader: Fitted

    def without(self, out: NDArray[np.bool_]) -> _Round:
        """Leave some points aside."""
        inside = np.flatnonzero(~out)
        leader = replace(
            self.leader, residual=self.leader.residual[inside], unseen=self.leader.unseen[inside]
        )
        return _Round(self.reference.select(inside), self.noise, self.rows.select(inside), leader)

    def left(self, points: Points) -> float:
        """What the leader leaves beyond noise, relative to force and response."""
        pairs = _trusted(self.leader, self.noise, points.select(self.reference.chosen))
        total, apart = neighbour_noise(self.leader.residual, pairs, self.leader.compared)
        return float(np.sqrt(np.nansum(self.noise**2 * np.maximum(total**2 - apart**2, 0.0))))


def rank(
    surface: ResponseSurface,
    candidates: Model | LawLike | Sequence[LawLike] | None = None,
    observation: Observation | None = None,
    *,
    mass: float | None = None,
    terms_in_sum: int = 2,
) -> Ranking:
    """Compare laws on a test.

    Parameters
    ----------
    surface
        Settled points of any test; held-out levels are left aside.
    candidates
        Formulas, elements and laws compete as they are; laws of ``rsgen.laws`` are tried beside a linear
        spring and a linear damper, alone and in sums. A model competes with all of the
        library. None: the library.
    observation
        How the structure was observed; None: as a model says.
    mass
        m [kg] where it is known; None: as a model says, and to be identified where that says nothing.
    terms_in_sum
        Most laws of the library in a sum; sums of three follow much that they do not explain.

    Returns
    -------
    Ranking
        Best first by BIC and parameters, behind what predicts levels worse than a simpler law, with
        findings; *none fits* where even the best leaves more than noise.

    Raises
    ------
    RsgenError
        No candidate, too few points, one frequency or phase resonance without a mass, no phase recorded, or
        no candidate follows the test.
    """
    require(surface, ResponseSurface, "surface")
    refuse_across(surface.across.shape[1], ranking=True)
    laws, terms, base = competitors(candidates)
    base = join_model(base, observation, mass)
    if set(base.fixed) - {"m"}:
        raise RsgenError("ranking: other laws have other parameters; of what is fixed only the mass can stay")
    fixed, given_surface = base.fixed, surface
    surface, base = per_unit_mass(without_copies(surface), base)
    observed = _observed(surface, base)
    points = observed.points
    if needed := mass_needs(points, base):
        raise RsgenError(f"ranking: the test does not determine the mass; give it, or {needed}")
    background = _start_background(observed, base, tuple(laws.values()))
    mode = observed.mode(background)
    given = tuple(start_guess(name, elements, mode, base.fixed) for name, elements in laws.items())
    rows = first_rows(observed, background, base_law(), base.fixed.get("m", nan))
    rounds = _all_rounds(observed, rows, given, terms, base.fixed, terms_in_sum)
    # rounds may go in a circle: the one whose leader leaves least counts, of equals the last
    left = [each.left(points) for each, _ in rounds]
    best = max(i for i, value in enumerate(left) if value <= min(left) + NOTICEABLE)
    found = _ranking(observed, *rounds[best], tuple(laws), base, surface)
    # the mass of one kilogram that stands for a unit of mass is not known
    return replace(found, model=replace(found.model, fixed=fixed), surface=given_surface)


def _all_rounds(
    observed: Observed,
    rows: Rows,
    given: tuple[Guess, ...],
    terms: tuple[Term, ...],
    fixed: Mapping[str, float],
    terms_in_sum: int,
) -> list[tuple[_Round, list[Fitted]]]:
    """Rounds without memory, and where their best leaves more than noise, rounds with all laws.

    Along the motion of a law with memory a true law without may look wrong, so those have a turn alone.
    """
    plain = tuple(term for term in terms if not term.law.remembers)
    rounds: list[tuple[_Round, list[Fitted]]] = []
    fault: RsgenError | None = None
    for some in dict.fromkeys((plain, terms)):
        entries = Entries(given, some, fixed, terms_in_sum)
        try:
            known = rounds[-1][1][:_AGAIN] if rounds else []
            guesses = entries.search(rows, observed.points, known=known)
            rounds += _rounds(observed, entries.fit(guesses, rows, observed.points, first=True), entries)
        except RsgenError as refused:
            fault = refused
        if rounds and min(each.left(observed.points) for each, _ in rounds) <= NOTICEABLE:
            break
    if fault is not None and not rounds:
        raise fault
    return rounds


def _rounds(observed: Observed, found: list[Fitted], entries: Entries) -> list[tuple[_Round, list[Fitted]]]:
    """Candidates along the motion of the best of the round before, until the best is the same again."""
    rounds: list[tuple[_Round, list[Fitted]]] = []
    tried: list[str] = []
    for _ in range(_ROUNDS):
        current = _next_round(observed, found, entries.fixed, rounds[-1][0].noise if rounds else None)
        if current is None:
            break
        current, found = _compared(observed.points, current, entries, found)
        rounds.append((current, found))
        name = current.leader.guess.name
        if found[0].guess.name in (name, *tried):
            break
        tried.append(name)
    if not rounds:
        raise RsgenError("ranking: no candidate has steady states near the measured ones")
    return rounds


def identify_best(surface: ResponseSurface, model: Model) -> Identification:
    """Rank, and identify the best law with intervals; the ranking is in the result.

    Parameters
    ----------
    surface, model
        As for ``rank``.

    Raises
    ------
    RsgenError
        As for ``rank`` and ``identify``.
    """
    return rank(surface, model).best


def _observed(surface: ResponseSurface, base: Model) -> Observed:
    """Some of the points: as many as separate laws."""
    surface.require_phase("ranking", "laws are compared by force and phase together")
    points = select_points(surface, base)
    observed = Observed.of(points, base.observation.background)
    return observed.select(points.spread(_POINTS))


def _start_background(observed: Observed, base: Model, given: Sequence[tuple[Element, ...]]) -> Array:
    """A background to start from: that beside the law that leaves least, of those given and flexible ones."""
    if not observed.background.names:
        return np.zeros(0)
    # a linear law would put its misfit into the background
    laws = [elements for elements in given if not _is_linear(replace(base, elements=elements).force)]
    laws += [as_elements(law) for law in _FLEXIBLE]
    few = observed.select(observed.points.spread(QUICK))
    fits = []
    for elements in laws:
        problem = Problem(elements, compile_law(replace(base, elements=elements).force), few, base.fixed)
        fits.append(fit_balance(*start_fit(problem), order=START_ORDER))
    return min(fits, key=lambda found: found.regression.noise if found.mass > 0 else np.inf).background


def _is_linear(force: sympy.Expr) -> bool:
    """Whether a force is linear in displacement and velocity."""
    states = symbol("x"), symbol("v")
    return bool(force.is_polynomial(*states)) and sympy.Poly(force, *states).total_degree() <= 1


def _next_round(
    observed: Observed, candidates: list[Fitted], fixed: Mapping[str, float], before: Array | None
) -> _Round | None:
    """Take the motion of the best candidate that can follow the measured one; ``before`` is a noise."""
    for fit in candidates[:_AGAIN]:
        reference = follow(observed, fit.guess, fixed)
        found = None if reference is None else _round(observed.points, fit.guess, reference, fixed, before)
        if found is not None:
            return found
    return None


def _round(
    points: Points, guess: Guess, reference: Reference, fixed: Mapping[str, float], before: Array | None
) -> _Round | None:
    """Fit the law whose motion it is, and estimate the noise."""
    noise = np.full(ORDER + 1, EXPECTED_NOISE) if before is None else before
    chosen = points.select(reference.chosen)
    guess = replace(guess, values=reference.named)
    for last in (False, False, True):
        rows = reference.rows(noise)
        leader = fit_rows(guess, rows, chosen.level, fixed)
        if leader is None or last:
            break
        _, apart = neighbour_noise(leader.residual, _trusted(leader, noise, chosen), rows.compared)
        noise = np.maximum(noise * np.where(np.isfinite(apart), apart, 1.0), NOTICEABLE)
    return None if leader is None else _Round(reference, noise, rows, leader)


def _trusted(fitted: Fitted, noise: Array, points: Points) -> NDArray[np.intp]:
    """Pairs of neighbours without those few points that stand out."""
    pairs = points.neighbours
    return pairs[~outlying(fitted, noise)[pairs].any(axis=1)]


def _compared(
    points: Points, current: _Round, entries: Entries, known: Sequence[Fitted]
) -> tuple[_Round, list[Fitted]]:
    """Fit the candidates; a few points that even the best cannot explain are left aside, at most twice.

    Without these points the same candidates are near: they are fitted again and no others are searched.
    """
    chosen = points.select(current.reference.chosen)
    # the law whose motion it is competes in any case, and so do the best of the round before
    guesses = entries.search(current.rows, chosen, known=[current.leader, *known[:_AGAIN]])
    found = entries.fit(guesses, current.rows, chosen, first=False)
    for _ in range(2):
        out = outlying(found[0], current.noise)
        if not out.any():
            break
        current = current.without(out)
        chosen = points.select(current.reference.chosen)
        found = entries.fit(guesses, current.rows, chosen, first=False)
    name = current.leader.guess.name
    # fitted without the points aside; it may have been dropped
    leader = next((fit for fit in found if fit.guess.name == name), current.leader)
    return replace(current, leader=leader), found


def _unconfirmed(best: Fitted, observed: Observed, fixed: Mapping[str, float], noise: float) -> list[Finding]:
    """Find that the best law, fitted along its own motions, leaves far more than along those of the ranking.

    ``noise`` is that of the ranking, relative. Candidates share one motion, which need not be one of theirs.
    """
    few = observed.select(observed.points.spread(QUICK))
    guess, law = best.guess, compile_law(best.guess.force)
    problem = Problem(guess.elements, law, few, fixed)
    values = np.array([guess.values[name] for name in law.parameters])
    near = problem.join(values, guess.values["m"], guess.background)
    expected = np.sqrt(2) * noise
    # only a law that fails from the values of the ranking is searched as widely as an identification would
    for searched in (False, True):
        start = start_fit(problem) if searched else (problem, near)
        fit = fit_balance(*start, order=START_ORDER)
        misfit = np.sqrt(2) * fit.regression.noise
        if not misfit > max(_CONFIRMED * expected, _CERTAINLY):
            return []
    numbers = quantities(misfit=float(misfit), expected=float(expected))
    return [Finding("law-unconfirmed", "doubt", numbers=numbers, names={"law": best.guess.name})]


def in_order(
    bic: Sequence[float], error: Sequence[float], count: Sequence[int], odd: Sequence[bool]
) -> tuple[list[int], float, list[bool]]:
    """Order candidates: behind come those that predict levels worse than one of fewer parameters does.

    A sum that follows every level and predicts none of them is no law; of those that tie the one with fewer
    parameters comes first.

    Parameters
    ----------
    bic, error, count
        Of each candidate: its criterion, the error of predicted levels (NaN with one level), parameters.
    odd
        Which candidates contradict themselves; of those that tie they come last.

    Returns
    -------
    order, lowest, tied
        Numbers of the candidates, best first; the BIC of the nearest that predicts; which tie with it.
    """
    behind = [
        worse > LARGE and any(few < many and worse > EXCESS * error[i] for i, few in enumerate(count))
        for many, worse in zip(count, error, strict=True)
    ]
    lowest = min(value for value, late in zip(bic, behind, strict=True) if not late)
    tied = [value - lowest < _TIE and not late for value, late in zip(bic, behind, strict=True)]

    def place(number: int) -> tuple[float, ...]:
        if tied[number]:
            return 0, odd[number], count[number], bic[number]
        return 1, behind[number], 0, bic[number]

    return sorted(range(len(bic)), key=place), lowest, tied


def _ranking(
    observed: Observed,
    current: _Round,
    candidates: list[Fitted],
    given: Sequence[str],
    base: Model,
    surface: ResponseSurface,
) -> Ranking:
    """Order the candidates, merge given laws with their like of the library, and judge the best."""
    points = observed.points
    candidates, own = _merged(candidates, current.rows, given)
    scale = np.repeat(current.noise, 2)[1:]
    error = [float(np.sqrt(np.mean((fit.unseen * scale)[:, fit.compared] ** 2))) for fit in candidates]
    odd = [bool(implausible(fit, current.rows)) for fit in candidates]
    order, lowest, tied = in_order(
        [fit.bic for fit in candidates], error, [len(fit.guess.values) for fit in candidates], odd
    )
    ordered = [candidates[number] for number in order]
    rows = [
        Candidate(
            fit.guess.name,
            with_equations(fit.guess.force),
            len(fit.guess.values) - len(base.fixed),
            error[number],
            fit.bic - lowest,
            tied[number],
            {name: value for name, value in fit.guess.values.items() if name not in base.fixed},
            fit is own,
        )
        for number, fit in zip(order, ordered, strict=True)
    ]
    chosen = points.select(current.reference.chosen)
    aside = len(points) - len(chosen)
    doubts = [
        *implausible(ordered[0], current.rows),
        *_unconfirmed(ordered[0], observed, base.fixed, float(current.noise[1])),
    ]
    judgement = judge(
        ordered[0], chosen, current.noise, rows, aside, feeds=current.reference.feeds, doubts=doubts
    )
    return Ranking(
        tuple(rows),
        replace(base, elements=ordered[0].guess.elements),
        judgement.fits,
        judgement.findings,
        float(current.noise[1]),
        judgement.unexplained,
        surface,
    )


def _merged(candidates: list[Fitted], rows: Rows, given: Sequence[str]) -> tuple[list[Fitted], Fitted | None]:
    """Drop what is a given law under another name; that of a model takes the library's, and is given, too."""
    own = None
    for name in given:
        law = next((fit for fit in candidates if fit.guess.name == name), None)
        if law is None:
            continue
        twins = [fit for fit in candidates if fit is not law and is_same(fit, law, rows)]
        candidates = [fit for fit in candidates if not any(fit is twin for twin in twins)]
        if name == OWN:
            named = replace(law, guess=replace(law.guess, name=twins[0].guess.name if twins else name))
            candidates = [named if fit is law else fit for fit in candidates]
            # a linear law is the base of all, and stands in where a case has none
            own = None if _is_linear(law.guess.force) else named
    return candidates, own
