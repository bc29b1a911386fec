"""Model selection: candidate laws ranked by BIC on one test.

BIC = chi^2 + q log(n) with chi^2 the sum of squares of the whitened balance of forces (``balance``) and q the
number of parameters (Schwarz, Annals of Statistics 6, 1978). A harmonic balance for each of hundreds of
candidates would take minutes; so all are compared along one reference motion, that of the best law so far,
where each candidate is a linear least squares. If another law becomes the best, its motion is the next
reference, until the best law is the one whose motion is the reference. A candidate's misfit is then that of
maximum likelihood to second order in its distance from the best law, which is enough to order near ones.
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
    ASSUMED_RELATIVE_NOISE,
    BALANCE_HARMONICS,
    DEVIATING_MISFIT_RATIO,
    MISFIT_NEGLIGIBLE,
    NOISE_RATIO_BY_CHANCE,
    RELATIVE_ERROR_DOUBTFUL,
    START_HARMONICS,
    SUBSAMPLE_POINTS,
)
from rsgen.data.oscillator import Model, Observation, join_model, refuse_across
from rsgen.data.surface import ResponseSurface, without_copies
from rsgen.formula import symbol
from rsgen.identification.fitting.fit import fit_balance
from rsgen.identification.fitting.observed import Observed, Problem
from rsgen.identification.fitting.points import Points, mass_needs, per_unit_mass, select_points
from rsgen.identification.ranking.balance import Term, WhitenedBalance, base_law
from rsgen.identification.ranking.candidate_fit import CandidateFit, CandidateLaw, fit_candidate
from rsgen.identification.ranking.ranking_result import (
    OWN,
    Candidate,
    Ranking,
    assess_best,
    implausible_findings,
    is_same,
)
from rsgen.identification.ranking.reference import (
    Reference,
    first_rows,
    fit_reference_motion,
    neighbour_noise,
    outliers_of,
)
from rsgen.identification.ranking.selection import Candidates, competitors, start_candidate
from rsgen.identification.results import Identification
from rsgen.identification.starting.start import start_fit
from rsgen.law.element import Element, LawLike, as_elements
from rsgen.law.memory import with_equations
from rsgen.law.numeric import compile_law

_STRONG_EVIDENCE = 6.0
"""Difference of BIC (Kass and Raftery, Bayes factors, JASA 90 (1995))."""

_LEADERS = 3
"""Best candidates of a round whose motion may be the reference, and that compete in the next round."""

_MAX_ROUNDS = 5

_MAX_POINTS = 500
"""Points that separate laws; more of them only narrow intervals."""

_MIN_MISFIT_OF_DOUBT = 0.03
"""Smaller misfits along the law's own motions are due to few harmonics, as for friction that sticks."""

_SURROGATES = (f"{ANY_LAW} + Ff*sign(v)", ANY_LAW)
"""Surrogates of any law, with friction and without, with which the first background is fitted."""


@dataclass(frozen=True, slots=True, eq=False)
class _Round:
    """One reference motion: noise and balance there, and the ``leader``, the law of the motion, fitted."""

    reference: Reference
    noise: Array
    rows: WhitenedBalance
    leader: CandidateFit

    def without(self, out: NDArray[np.bool_]) -> _Round:
        """Exclude some points."""
        inside = np.flatnonzero(~out)
        leader = replace(
            self.leader,
            residual=self.leader.residual[inside],
            held_out_residual=self.leader.held_out_residual[inside],
        )
        return _Round(self.reference.select(inside), self.noise, self.rows.select(inside), leader)

    def systematic_misfit(self, points: Points) -> float:
        """Return the misfit of the leader beyond noise, relative to force and response."""
        pairs = _inlier_pairs(self.leader, self.noise, points.select(self.reference.chosen))
        total, random = neighbour_noise(self.leader.residual, pairs, self.leader.compared)
        return float(np.sqrt(np.nansum(self.noise**2 * np.maximum(total**2 - random**2, 0.0))))


def rank(
    surface: ResponseSurface,
    candidates: Model | LawLike | Sequence[LawLike] | None = None,
    observation: Observation | None = None,
    *,
    mass: float | None = None,
    terms_in_sum: int = 2,
) -> Ranking:
    """Rank candidate laws on a test.

    Parameters
    ----------
    surface
        Settled points of any test; held-out levels are not used.
    candidates
        Formulas, elements and laws compete as they are; laws of ``rsgen.laws`` are added to a linear spring
        and a linear damper, one by one and in sums. A model competes with all of the library. None: the
        library.
    observation
        How the structure was observed; None: that of a model.
    mass
        m [kg] if it is known; None: that of a model, or identified.
    terms_in_sum
        Largest number of laws of the library in a sum; sums of three often overfit.

    Returns
    -------
    Ranking
        Best first by BIC and parameters; last are candidates that predict levels worse than a simpler law
        does. With findings; *none fits* if even the best has a misfit beyond noise.

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
    given = tuple(start_candidate(name, elements, mode, base.fixed) for name, elements in laws.items())
    rows = first_rows(observed, background, base_law(), base.fixed.get("m", nan))
    rounds = _all_rounds(observed, rows, given, terms, base.fixed, terms_in_sum)
    # rounds may go in a circle: take the last of those with the least misfit
    misfits = [one.systematic_misfit(points) for one, _ in rounds]
    best = max(i for i, misfit in enumerate(misfits) if misfit <= min(misfits) + MISFIT_NEGLIGIBLE)
    found = _ranking(observed, *rounds[best], tuple(laws), base, surface)
    # without a mass the balance was fitted per unit mass, with a mass of 1 kg
    return replace(found, model=replace(found.model, fixed=fixed), surface=given_surface)


def _all_rounds(
    observed: Observed,
    rows: WhitenedBalance,
    given: tuple[CandidateLaw, ...],
    terms: tuple[Term, ...],
    fixed: Mapping[str, float],
    terms_in_sum: int,
) -> list[tuple[_Round, list[CandidateFit]]]:
    """Run rounds of laws without memory, and if their best has a misfit beyond noise, rounds of all laws.

    Laws without memory are ranked first, because the reference motion of a hysteretic law would bias them.
    """
    plain = tuple(term for term in terms if not term.law.remembers)
    rounds: list[tuple[_Round, list[CandidateFit]]] = []
    fault: RsgenError | None = None
    for allowed in dict.fromkeys((plain, terms)):
        entries = Candidates(given, allowed, fixed, terms_in_sum)
        try:
            known = rounds[-1][1][:_LEADERS] if rounds else []
            candidates = entries.search(rows, observed.points, known=known)
            rounds += _rounds(observed, entries.fit(candidates, rows, observed.points, first=True), entries)
        except RsgenError as refused:
            fault = refused
        if rounds and min(one.systematic_misfit(observed.points) for one, _ in rounds) <= MISFIT_NEGLIGIBLE:
            break
    if fault is not None and not rounds:
        raise fault
    return rounds


def _rounds(
    observed: Observed, found: list[CandidateFit], entries: Candidates
) -> list[tuple[_Round, list[CandidateFit]]]:
    """Rank along the motion of the best candidate so far, until the best is the same again."""
    rounds: list[tuple[_Round, list[CandidateFit]]] = []
    tried: list[str] = []
    for _ in range(_MAX_ROUNDS):
        current = _next_round(observed, found, entries.fixed, rounds[-1][0].noise if rounds else None)
        if current is None:
            break
        current, found = _compare(observed.points, current, entries, found)
        rounds.append((current, found))
        name = current.leader.candidate.name
        if found[0].candidate.name in (name, *tried):
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
    """Return the points, at most as many as separate laws."""
    surface.require_phase("ranking", "laws are compared by force and phase together")
    points = select_points(surface, base)
    observed = Observed.of(points, base.observation.background)
    return observed.select(points.spread(_MAX_POINTS))


def _start_background(observed: Observed, base: Model, given: Sequence[tuple[Element, ...]]) -> Array:
    """Return an initial background: that of the best fit among the laws of the user and the surrogates."""
    if not observed.background.names:
        return np.zeros(0)
    # a linear law would put its misfit into the background
    laws = [elements for elements in given if not _is_linear(replace(base, elements=elements).force)]
    laws += [as_elements(law) for law in _SURROGATES]
    subsample = observed.select(observed.points.spread(SUBSAMPLE_POINTS))
    fits = []
    for elements in laws:
        problem = Problem(
            elements, compile_law(replace(base, elements=elements).force), subsample, base.fixed
        )
        fits.append(fit_balance(*start_fit(problem), order=START_HARMONICS))
    return min(fits, key=lambda found: found.regression.noise if found.mass > 0 else np.inf).background


def _is_linear(force: sympy.Expr) -> bool:
    """Return True if a force is linear in displacement and velocity."""
    states = symbol("x"), symbol("v")
    return bool(force.is_polynomial(*states)) and sympy.Poly(force, *states).total_degree() <= 1


def _next_round(
    observed: Observed, candidates: list[CandidateFit], fixed: Mapping[str, float], before: Array | None
) -> _Round | None:
    """Return a round with the motion of the best candidate that has one; ``before`` is the last noise."""
    for fit in candidates[:_LEADERS]:
        reference = fit_reference_motion(observed, fit.candidate, fixed)
        found = (
            None if reference is None else _round(observed.points, fit.candidate, reference, fixed, before)
        )
        if found is not None:
            return found
    return None


def _round(
    points: Points,
    candidate: CandidateLaw,
    reference: Reference,
    fixed: Mapping[str, float],
    before: Array | None,
) -> _Round | None:
    """Fit the law of the reference motion, and estimate the noise."""
    noise = np.full(BALANCE_HARMONICS + 1, ASSUMED_RELATIVE_NOISE) if before is None else before
    chosen = points.select(reference.chosen)
    candidate = replace(candidate, values=reference.parameters)
    for last in (False, False, True):
        rows = reference.rows(noise)
        leader = fit_candidate(candidate, rows, chosen.level, fixed)
        if leader is None or last:
            break
        _, random = neighbour_noise(leader.residual, _inlier_pairs(leader, noise, chosen), rows.compared)
        noise = np.maximum(noise * np.where(np.isfinite(random), random, 1.0), MISFIT_NEGLIGIBLE)
    return None if leader is None else _Round(reference, noise, rows, leader)


def _inlier_pairs(fitted: CandidateFit, noise: Array, points: Points) -> NDArray[np.intp]:
    """Return the pairs of neighbours without outliers."""
    pairs = points.neighbours
    return pairs[~outliers_of(fitted, noise)[pairs].any(axis=1)]


def _compare(
    points: Points, current: _Round, entries: Candidates, known: Sequence[CandidateFit]
) -> tuple[_Round, list[CandidateFit]]:
    """Fit the candidates; at most twice exclude outliers of the best and refit the same candidates."""
    chosen = points.select(current.reference.chosen)
    # the law of the motion competes in any case, and so do the best of the round before
    candidates = entries.search(current.rows, chosen, known=[current.leader, *known[:_LEADERS]])
    found = entries.fit(candidates, current.rows, chosen, first=False)
    for _ in range(2):
        out = outliers_of(found[0], current.noise)
        if not out.any():
            break
        current = current.without(out)
        chosen = points.select(current.reference.chosen)
        found = entries.fit(candidates, current.rows, chosen, first=False)
    name = current.leader.candidate.name
    # fitted without the excluded points, unless it was dropped
    leader = next((fit for fit in found if fit.candidate.name == name), current.leader)
    return replace(current, leader=leader), found


def _unconfirmed_findings(
    best: CandidateFit, observed: Observed, fixed: Mapping[str, float], noise: float
) -> list[Finding]:
    """Fit the best law along its own motions; find that its misfit is far larger than in the ranking.

    ``noise`` is the relative noise of the ranking, where candidates share a motion that may be of another
    law.
    """
    subsample = observed.select(observed.points.spread(SUBSAMPLE_POINTS))
    candidate, law = best.candidate, compile_law(best.candidate.force)
    problem = Problem(candidate.elements, law, subsample, fixed)
    values = np.array([candidate.values[name] for name in law.parameters])
    near = problem.join(values, candidate.values["m"], candidate.background)
    expected = np.sqrt(2) * noise
    # if the fit fails from the values of the ranking, search as an identification does
    for searched in (False, True):
        start = start_fit(problem) if searched else (problem, near)
        fit = fit_balance(*start, order=START_HARMONICS)
        misfit = np.sqrt(2) * fit.regression.noise
        if not misfit > max(DEVIATING_MISFIT_RATIO * expected, _MIN_MISFIT_OF_DOUBT):
            return []
    numbers = quantities(misfit=float(misfit), expected=float(expected))
    return [Finding("law-unconfirmed", "doubt", numbers=numbers, names={"law": best.candidate.name})]


def order_candidates(
    bic: Sequence[float], error: Sequence[float], count: Sequence[int], odd: Sequence[bool]
) -> tuple[list[int], float, list[bool]]:
    """Order candidates by BIC; of tied ones the one with fewer parameters comes first.

    Candidates that predict held-out levels worse than one of fewer parameters overfit, and come last.

    Parameters
    ----------
    bic, error, count
        Of each candidate: its criterion, the error of predicted levels (NaN with one level), parameters.
    odd
        True for candidates that are implausible_findings by themselves; of tied ones they come last.

    Returns
    -------
    order, lowest, tied
        Numbers of the candidates, best first; the lowest BIC without overfitting; which tie with it.
    """
    overfitted = [
        worse > RELATIVE_ERROR_DOUBTFUL
        and any(few < many and worse > NOISE_RATIO_BY_CHANCE * error[i] for i, few in enumerate(count))
        for many, worse in zip(count, error, strict=True)
    ]
    lowest = min(value for value, last in zip(bic, overfitted, strict=True) if not last)
    tied = [
        value - lowest < _STRONG_EVIDENCE and not last for value, last in zip(bic, overfitted, strict=True)
    ]

    def place(number: int) -> tuple[float, ...]:
        if tied[number]:
            return 0, odd[number], count[number], bic[number]
        return 1, overfitted[number], 0, bic[number]

    return sorted(range(len(bic)), key=place), lowest, tied


def _ranking(
    observed: Observed,
    current: _Round,
    candidates: list[CandidateFit],
    given: Sequence[str],
    base: Model,
    surface: ResponseSurface,
) -> Ranking:
    """Order the candidates, merge laws of the user with equal ones of the library, and assess the best."""
    points = observed.points
    candidates, own = _merge_equal_laws(candidates, current.rows, given)
    scale = np.repeat(current.noise, 2)[1:]
    error = [
        float(np.sqrt(np.mean((fit.held_out_residual * scale)[:, fit.compared] ** 2))) for fit in candidates
    ]
    odd = [bool(implausible_findings(fit, current.rows)) for fit in candidates]
    order, lowest, tied = order_candidates(
        [fit.bic for fit in candidates], error, [len(fit.candidate.values) for fit in candidates], odd
    )
    ordered = [candidates[number] for number in order]
    rows = [
        Candidate(
            fit.candidate.name,
            with_equations(fit.candidate.force),
            len(fit.candidate.values) - len(base.fixed),
            error[number],
            fit.bic - lowest,
            tied[number],
            {name: value for name, value in fit.candidate.values.items() if name not in base.fixed},
            fit is own,
        )
        for number, fit in zip(order, ordered, strict=True)
    ]
    chosen = points.select(current.reference.chosen)
    excluded = len(points) - len(chosen)
    doubts = [
        *implausible_findings(ordered[0], current.rows),
        *_unconfirmed_findings(ordered[0], observed, base.fixed, float(current.noise[1])),
    ]
    assessment = assess_best(
        ordered[0],
        chosen,
        current.noise,
        rows,
        excluded,
        feeds=current.reference.feeds_exciter,
        doubts=doubts,
    )
    return Ranking(
        tuple(rows),
        replace(base, elements=ordered[0].candidate.elements),
        assessment.fits,
        assessment.findings,
        float(current.noise[1]),
        assessment.unexplained,
        surface,
    )


def _merge_equal_laws(
    candidates: list[CandidateFit], rows: WhitenedBalance, given: Sequence[str]
) -> tuple[list[CandidateFit], CandidateFit | None]:
    """Drop sums that equal a law of the user. A model's own law takes the name of the library, and is
    returned.
    """
    own = None
    for name in given:
        law = next((fit for fit in candidates if fit.candidate.name == name), None)
        if law is None:
            continue
        twins = [fit for fit in candidates if fit is not law and is_same(fit, law, rows)]
        candidates = [fit for fit in candidates if not any(fit is twin for twin in twins)]
        if name == OWN:
            named = replace(
                law, candidate=replace(law.candidate, name=twins[0].candidate.name if twins else name)
            )
            candidates = [named if fit is law else fit for fit in candidates]
            # a linear law is the base of all sums, and the default of a case without a law
            own = None if _is_linear(law.candidate.force) else named
    return candidates, own
