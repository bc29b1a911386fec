"""Model selection: candidate laws ranked by BIC on one test.

BIC = chi^2 + q log(n) with chi^2 the sum of squares of the whitened balance of forces (``balance``), in units
of independent points (``effective_power``), and q parameters (Schwarz, Ann. Statist. 6, 1978). A harmonic
balance for each of hundreds of candidates would take minutes; so all are compared along one reference motion,
that of the best law so far, where each candidate is a linear least squares but for breakpoints, widths and
exponents (``candidate_fit``). If another law becomes the best, its motion is the next reference, until the
best law is the one whose motion is the reference. A candidate's misfit is then that of maximum likelihood to
second order in its distance from the best law, which is enough to order near ones.
The docstring of the package lists why a law is not tried, dropped or refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import inf, nan
from typing import Any

import numpy as np

from rsgen.common.errors import RsgenError, known_arguments, listed, require
from rsgen.common.finding import Finding
from rsgen.common.tolerances import (
    MIN_SIGNIFICANT_GAIN,
    MISFIT_NEGLIGIBLE,
    MISFIT_REJECTED,
    NOISE_RATIO_BY_CHANCE,
    SUBSAMPLE_POINTS,
)
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import Model, Observation, join_model
from rsgen.data.surface.mode_findings import mode_findings
from rsgen.data.surface.response_surface import ResponseSurface, without_copies, without_offset
from rsgen.identification.fitting.across import sensors_of
from rsgen.identification.fitting.points import per_unit_mass
from rsgen.identification.identify import checked, identify, identify_points
from rsgen.identification.misfit import CODES_OF_RESPONSE, is_misread
from rsgen.identification.ranking.balance import WhitenedBalance
from rsgen.identification.ranking.candidate_fit import (
    STRONG_EVIDENCE,
    CandidateFit,
    CandidateLaw,
    RankedTest,
    Round,
    fit_candidate,
    lacks,
    whole_powers,
)
from rsgen.identification.ranking.library_sums import Term, whole_name
from rsgen.identification.ranking.ranking_result import (
    OWN,
    Candidate,
    Ranking,
    assess_best,
    have_same_terms,
    misfit_of_rows,
    name_powers,
    order_candidates,
    symmetry_doubts,
    undetermined_values,
    values_of_same,
)
from rsgen.identification.ranking.records import RecordTest
from rsgen.identification.ranking.reference import PointTest
from rsgen.identification.ranking.selection import Candidates, competitors, hides_even, law_text
from rsgen.identification.results import Identification
from rsgen.law.element import LawLike, Library
from rsgen.law.memory import refuse_free_powers

_LEADERS = 3
"""Best candidates of a round whose motion may be the reference, and that compete in the next round."""

_MAX_ROUNDS = 5

_SHARE_OF_STAGES, _SHARE_OF_MOTIONS = 0.5, 0.4
"""Of the time of a ranking: its stages, then laws along their own motions; the identification is the rest."""

_FEEDS_ENERGY = "a damper of it would feed energy into the decay, which another law explains without"


@dataclass(frozen=True, slots=True, eq=False)
class _Compared:
    """A round, and the candidates fitted along its motion, best first, and those with a fault."""

    test: RankedTest
    round: Round
    found: list[CandidateFit]
    faulty: list[CandidateFit]

    @property
    def systematic_misfit(self) -> float:
        """Misfit of the law of the motion beyond noise, relative to force and response."""
        return self.round.misfit(self.round.leader).systematic

    @property
    def fits(self) -> bool:
        """True if the best candidate leaves nothing beyond noise and sensors."""
        return not self.round.misfit(self.found[0]).unexplained


@known_arguments
@np.errstate(all="ignore")
def rank(
    surface: ResponseSurface | MultisineSpectra,
    candidates: Model | LawLike | Library | Sequence[LawLike | Library] | None = None,
    observation: Observation | None = None,
    *,
    mass: float | None = None,
    mass_error: float | None = None,
    terms_in_sum: int = 2,
    progress: Callable[[float], None] = lambda share: None,
) -> Ranking:
    """Rank candidate laws on a test.

    Parameters
    ----------
    surface
        Settled points of any test, or spectra of a multisine; held-out levels are not used.
    candidates
        Formulas, elements and laws compete as they are; laws of ``rsgen.laws`` are added to a linear spring
        and a linear damper, one by one and in sums. ``[law, rsgen.laws]``: a law with all of the library,
        with which a model competes, too. None: the library.
    observation
        How the structure was observed; None: that of a model.
    mass, mass_error
        m [kg] if it is known, and its standard error, as for ``identify``; None: as a model says.
    terms_in_sum
        Largest number of laws of the library in a sum; sums of three often overfit. 1 if a base is misread.
    progress
        Called with the share that is done, from 0 to 1.

    Returns
    -------
    Ranking
        Best first by BIC and parameters; last are candidates that predict levels worse than a simpler law
        does. With findings; *none fits* if even the best has a misfit beyond noise.

    Raises
    ------
    RsgenError
        No candidate, too few points, one frequency or phase resonance without a mass, or no candidate
        follows the test.
    """
    if isinstance(candidates, Observation):
        raise RsgenError(
            "candidates: Observation; write observation=...; without candidates the library is ranked"
        )
    if terms_in_sum not in (1, 2, 3):
        raise RsgenError(f"terms_in_sum: {terms_in_sum!r:.60}; must be 1, 2 or 3")
    laws, terms, base = competitors(candidates)
    base = join_model(base, observation, mass, mass_error=mass_error)
    if set(base.fixed) - {"m"}:
        raise RsgenError("ranking: other laws have other parameters; of what is fixed only the mass can stay")
    elements = tuple(chain(*laws.values()))
    for element in elements:
        refuse_free_powers(element.force, base.fixed)
    if isinstance(surface, MultisineSpectra):
        sensors = sensors_of(elements, int(surface.across is not None))
        # without a mass the balance is fitted per unit mass, with a mass of 1 kg
        test: RankedTest = RecordTest(*per_unit_mass(surface, base), laws.values(), sensors)
    else:
        require(surface, ResponseSurface, "surface")
        sensors = sensors_of(elements, int(surface.across.size > 0))
        surface = checked(surface)
        test = PointTest(*per_unit_mass(without_copies(surface), base), laws.values(), sensors)
        # no sum makes up for misread channels
        terms_in_sum = 1 if is_misread(surface) or test.observed.feeds_exciter else terms_in_sum
    given = tuple(test.start(name, elements) for name, elements in laws.items())
    # of a law that is not odd the balance between two sensors needs the mean of the motion there
    terms = tuple(term for term in terms if not sensors or test.means[-1] or term.law.odd)
    rounds = _all_rounds(test, given, terms, terms_in_sum, progress)
    ranking = replace(_ranking(_best_round(rounds), tuple(laws), base, surface, progress), library=len(terms))
    if isinstance(surface, MultisineSpectra) or (centred := without_offset(surface)) is surface:
        return ranking
    # the mean may be the sensor's where no law has such a place of rest, or only one with more parameters
    known: dict[str, Any] = {"mass": mass, "mass_error": mass_error, "terms_in_sum": terms_in_sum}
    other = rank(centred, candidates, observation, **known, progress=progress)
    fewer = other.candidates[0].parameters + 1 < ranking.candidates[0].parameters
    return other if other.fits and (fewer or not ranking.fits) else ranking


def _best_round(rounds: list[_Compared]) -> _Compared:
    """Return the last of the rounds that leave least at the points of all: rounds may go in a circle.

    What seems noise counts, too: along the motion of a wrong law a few points may hide its misfit.
    """
    misfits = [one.round.left_at_common([other.round for other in rounds]) for one in rounds]
    least = min(misfits) + MISFIT_NEGLIGIBLE
    return next(one for one, misfit in zip(rounds[::-1], misfits[::-1], strict=True) if misfit <= least)


def _all_rounds(
    test: RankedTest,
    given: tuple[CandidateLaw, ...],
    terms: tuple[Term, ...],
    terms_in_sum: int,
    progress: Callable[[float], None],
) -> list[_Compared]:
    """Rank stage after stage, until the best law leaves a negligible misfit; return the rounds of all.

    Laws of the user compete in every stage, hysteretic or not. Of the library laws without memory come first,
    because the reference motion of a hysteretic law would bias them; hysteretic ones join in the last stage.
    A mean that was not recorded would bias the others, too, of a law that is not odd: without mean and even
    harmonics stages of odd laws precede, and where one ends with a law that fits, all laws without memory are
    compared once, along its motion; not along that of a single law that a sum of odd ones outdoes, which the
    stage of these sums settles. A stage is passed over whose best law leaves more along the measured motion
    than a right one does, but for the last. Before that, where none fits or the best has a mean force not
    recorded, laws without memory are compared without the mean; their identification says whose it is.
    """
    plain = tuple(term for term in terms if not term.remembers)
    without_memory, last = (Candidates(given, some, terms_in_sum, test.fixed) for some in (plain, terms))
    stages = [without_memory, last]
    if test.first.odd_alone:
        odd = tuple(law for law in given if law.law.odd), tuple(term for term in plain if term.law.odd)
        simple = ((*odd, 1), (given, plain, 1), (*odd, terms_in_sum))
        stages = [*(Candidates(*stage, test.fixed) for stage in simple), *stages]
    rounds: list[_Compared] = []
    fault: RsgenError | None = None
    tried = set[Candidates]()
    for number, stage in enumerate(stages):
        progress(_SHARE_OF_STAGES * number / len(stages))
        settled = rounds and (best := _best_round(rounds)).fits and not best.round.mean_unbalanced
        if number == len(stages) - 1 and not settled and (other := test.without_mean()) is not None:
            laws = tuple(other.start(law.name, law.elements) for law in given)
            centred = _all_rounds(other, laws, plain, terms_in_sum, lambda share: None)
            if _best_round(centred).fits:
                return centred
        if stage in tried or not (stage.given or stage.terms):
            continue
        tried.add(stage)
        try:
            candidates = stage.search(test.first, rounds[-1].found[:_LEADERS] if rounds else [])
            found = stage.fit(candidates, test.first, first=True)[0]
            least = min(fit.chi_squared for fit in found) / found[0].residual.size
            if stage != last and least > MISFIT_REJECTED**2:
                continue
            rounds += _rounds(test, found, stage)
        except RsgenError as refused:
            fault = refused
            continue
        best = _best_round(rounds)
        precedes = stage not in (without_memory, last)
        if precedes and best.fits:
            whole = _compare(test, best.round, without_memory, best.found)
            if stage != stages[0] or not _outdone(whole):
                return [whole]
            # the laws that it would add are not odd, either
            tried.add(stages[1])
            continue
        if best.systematic_misfit <= MISFIT_NEGLIGIBLE:
            # nothing is left for more terms; the last stage may still leave out the mean
            tried.update(stages)
    if fault is not None and not rounds:
        raise fault
    return rounds


def _outdone(one: _Compared) -> bool:
    """Return True if there is strong evidence for another odd law than that of the motion."""
    least = min((fit.bic() for fit in one.found if fit.candidate.law.odd), default=inf)
    return one.round.leader.bic() - least > STRONG_EVIDENCE


def _rounds(test: RankedTest, found: list[CandidateFit], entries: Candidates) -> list[_Compared]:
    """Rank along the motion of the best candidate so far, until the best is the same again.

    Of candidates that tie it is that of the simplest: smoothed friction and Coulomb's tie, and a sum with the
    first loses points that the first alone follows, as if it missed them.
    """
    rounds: list[_Compared] = []
    tried: list[str] = []
    # at the limit of a parameter a law becomes another one, which leads itself; its motion may take minutes
    first = min(found[:_LEADERS], key=lambda fit: not fit.converged)
    for _ in range(_MAX_ROUNDS):
        before = rounds[-1].round if rounds else None
        leaders = sorted(found, key=lambda fit: fit is not first)[:_LEADERS]
        motions = (test.along(fit.candidate, before) for fit in leaders)
        current = next((motion for motion in motions if motion is not None), None)
        if current is None:
            break
        rounds.append(_compare(test, current, entries, found))
        found, name = rounds[-1].found, current.leader.candidate.name
        tied = (fit for fit in found if fit.bic() - found[0].bic() < STRONG_EVIDENCE)
        first = min(tied, key=lambda fit: len(fit.candidate.values))
        if first.candidate.name in (name, *tried) or rounds[-1].systematic_misfit > MISFIT_REJECTED:
            break
        tried.append(name)
    if not rounds:
        raise RsgenError("ranking: no candidate has steady states near the measured ones")
    return rounds


def _compare(
    test: RankedTest, current: Round, entries: Candidates, known: Sequence[CandidateFit]
) -> _Compared:
    """Fit the candidates; at most twice exclude outliers of the best and refit the same candidates."""
    # the law of the motion competes in any case, and so do the best of the round before
    candidates = entries.search(current.rows, [current.leader, *known[:_LEADERS]])
    found, faulty = entries.fit(candidates, current.rows)
    for _ in range(2):
        fewer = current.without_outliers(found[0])
        if fewer is None:
            break
        current = fewer
        found, faulty = entries.fit(candidates, current.rows)
    found, name = current.in_independent_points(found), current.leader.candidate.name
    # fitted without the excluded points, unless it was dropped
    leader = next((fit for fit in found if fit.candidate.name == name), current.leader)
    return _Compared(test, replace(current, leader=leader), found, faulty)


def _settle_best(
    last: _Compared,
    candidates: Sequence[CandidateFit],
    bic: list[float],
    error: list[float],
    given: Sequence[str],
    base: Model,
    surface: ResponseSurface | MultisineSpectra,
) -> tuple[tuple[list[int], float, list[bool]], Identification | None, RsgenError | None]:
    """Identify the best law until it stays the best; return the order, its identification, and its fault.

    BIC and error of levels change in place. Both are infinite where damping feeds energy into a decay that
    another law explains without. Where the identification does not tell terms from zero, or powers from whole
    numbers, BIC is at least that of the best law without them plus the cost of the further parameters, also
    that of laws that contain this one and are not better by ``STRONG_EVIDENCE``. Where it fits worse along
    its own motion, that BIC counts.

    After ``_LEADERS`` laws the next is the best in any case, with a fault if the test does not determine it.
    One with a misfit that nothing explains is not identified: the ranking rejects it.
    """
    current, identified = last.round, dict[int, Identification]()
    fault: RsgenError | None = None
    count = [len(fit.candidate.values) for fit in candidates]
    # which law is the best some of many points settle, and its values all of them
    many = surface if isinstance(surface, ResponseSurface) and len(surface) > 2 * SUBSAMPLE_POINTS else None
    for _ in candidates:
        order = order_candidates(bic, error, count)
        best = candidates[number := order[0][0]]
        model, misfit = replace(base, elements=best.candidate.elements), current.relative(best.residual)
        if number in identified or current.misfit(best).unexplained:
            found = identified.get(number)
            break
        try:
            few = NOISE_RATIO_BY_CHANCE * misfit, SUBSAMPLE_POINTS
            found = identify(surface, model) if many is None else identify_points(many, model, *few)
        except RsgenError as refused:
            return order, None, refused
        identified[number] = found
        known = {"damping-feeds-energy", *(("not-converged",) if best.feeds(current.rows) else ())}
        if getattr(surface, "decays", False) and known & {f.code for f in found.findings}:
            library = (i for i, fit in enumerate(candidates) if fit.candidate.name not in given)
            fed = {number, *(i for i in library if candidates[i].feeds(current.rows))}
            rest = [fit for i, fit in enumerate(candidates) if i not in fed and np.isfinite(bic[i])]
            if not all(current.misfit(fit).unexplained for fit in rest):
                for i in fed:
                    bic[i] = error[i] = inf
                continue
        before = bic[number]
        near = [fit for i, fit in enumerate(candidates) if bic[i] - before < MIN_SIGNIFICANT_GAIN]
        undetermined, unknown = undetermined_values(found, best, near, last.test.first)
        within = {one.name: one.interval for one in found}
        whole = [(name, n) for name, n in whole_powers(best) if within[name][0] <= n <= within[name][1]]
        less = [lacks(fit, best, undetermined, whole) for fit in candidates]
        without = [i for i, lacking in enumerate(less) if lacking and bic[i] < inf]
        raised, parameters = min(((bic[i], count[i]) for i in without), default=(before, count[number]))
        own_misfit = misfit_of_rows(found, current)
        if own_misfit > NOISE_RATIO_BY_CHANCE * max(misfit, MISFIT_NEGLIGIBLE):
            own_bic = before + float(np.square(own_misfit / misfit) - 1.0) * best.chi_squared
            raised, parameters = max((raised, parameters), (own_bic, count[number]))
        if raised <= before or len(identified) > _LEADERS:
            if unknown := undetermined if raised > before else unknown:
                fault = RsgenError(f"the test does not determine {listed(unknown)}")
            break
        for i, fit in enumerate(candidates):
            if fit is best or (before - bic[i] < STRONG_EVIDENCE and lacks(best, fit, fit.candidate.values)):
                bic[i] = max(bic[i], raised + (count[i] - parameters) * fit.cost_of_parameter)
    if many is not None and found is not None:
        try:
            found = identify(many, model)
        except RsgenError as refused:
            return order, None, refused
    return order, found, fault


def _ranking(
    last: _Compared,
    given: Sequence[str],
    base: Model,
    surface: ResponseSurface | MultisineSpectra,
    progress: Callable[[float], None],
) -> Ranking:
    """Order the candidates, merge laws of the user with equal ones of the library, and assess the best."""
    test, current, fixed = last.test, last.round, last.test.fixed
    candidates, own = _merge_equal_laws(last.found, current.rows, given, fixed)
    bic = [fit.bic() for fit in candidates]
    if test.first.odd_alone and last.systematic_misfit <= MISFIT_REJECTED and not is_misread(surface):
        bic = _compare_along_own(test, current, candidates, given, progress)
    error = [current.relative(fit.predict_levels()) for fit in candidates]
    progress(_SHARE_OF_STAGES + _SHARE_OF_MOTIONS)
    (order, lowest, tied), found, fault = _settle_best(last, candidates, bic, error, given, base, surface)
    best = candidates[order[0]]
    ordered = [candidates[number] for number in order]
    rows = [
        _row(fit, fixed, own=fit is own, error=error[i], behind=bic[i] - lowest, tied=tied[i])
        if np.isfinite(bic[i])
        else _row(replace(fit, fault=_FEEDS_ENERGY), fixed, own=fit is own)
        for i, fit in zip(order, ordered, strict=True)
    ]
    rows += [_row(fit, fixed, own=fit.candidate.name == OWN) for fit in last.faulty]
    # what the identification says of the misfit the ranking does not say otherwise; where no law fits, what
    # the data say against themselves may be why
    said = found.findings if found else surface.findings
    if found is None and isinstance(surface, ResponseSurface):
        said = tuple(mode_findings(surface, None, said))
    codes = {"law-does-not-fit", "even-terms-not-seen", "sensor-offset", "fold"}
    doubts = [f for f in said if f.severity in ("doubt", "error") or {f.code, f.names.get("by")} & codes]
    if found is None and isinstance(test, PointTest) and test.observed.feeds_exciter:
        doubts.insert(0, Finding("structure-feeds-exciter", "error"))
    if fault is not None:
        names = {"law": best.candidate.name, "fault": str(fault)}
        doubts.append(Finding("law-unconfirmed", "doubt", names=names))
    doubts += symmetry_doubts(current, ordered, rows, found)
    fits, unexplained, findings = assess_best(current, best, rows, doubts)
    findings = name_powers(findings, ordered, rows)
    findings += (test.left_out,) if test.left_out else ()
    # no background takes the place of a law
    if 0 < unexplained < MISFIT_REJECTED and isinstance(surface, ResponseSurface):
        findings = _with_what_is_missing(ordered, current, surface, findings)
    return Ranking(
        tuple(rows),
        replace(base, elements=best.candidate.elements),
        fits,
        findings,
        current.noise,
        unexplained,
        surface,
        found,
    )


def _row(
    fit: CandidateFit,
    fixed: Mapping[str, float],
    *,
    own: bool,
    error: float = nan,
    behind: float = nan,
    tied: bool = False,
) -> Candidate:
    """Return a candidate as the ranking lists it; without values if it has a fault."""
    candidate = fit.candidate
    values = {name: value for name, value in candidate.values.items() if name not in fixed}
    return Candidate(
        name=candidate.name,
        force=law_text(candidate.elements),
        parameters=len(values),
        held_out_error=error,
        bic=behind,
        tied=tied,
        values={} if fit.fault else values,
        own=own,
        fault=fit.fault,
        converged=fit.converged,
    )


def _with_what_is_missing(
    ordered: Sequence[CandidateFit],
    current: Round,
    surface: ResponseSurface,
    findings: tuple[Finding, ...],
) -> tuple[Finding, ...]:
    """Add to the findings of a ranking in which no law fits what would make one of the best fit.

    That is an even force, by the mean and the even harmonics, or else a background; the best itself may have
    a term in place of the background.
    """
    left = next((f for f in findings if f.code == "no-law-fits"), None)
    if left is not None and {"harmonic 0", "harmonic 2"} & set(left.numbers) and "offset" not in left.numbers:
        even = current.even_force(ordered[0])
        if even is not None:
            law = whole_name(ordered[0].candidate.name, current.rows.sensors)
            named = replace(even, names={**even.names, "law": law})
            return _naming(findings, "even", even.names["term"], named)
    # nothing drives a decay; a background would only conceal a response that is another one
    if surface.decays or surface.lag_assumed or any(f.code in CODES_OF_RESPONSE for f in surface.findings):
        return findings
    for fit in ordered[:_LEADERS]:
        found = current.larger_background(fit)
        if found is not None and found.code == "channels-delayed":
            return (*findings, found)
        if found is not None:
            kind, law = found.names["kind"], whole_name(fit.candidate.name, current.rows.sensors)
            named = replace(found, names={"kind": kind, "law": law})
            return _naming(findings, "background", kind, named)
    return findings


def _naming(findings: tuple[Finding, ...], kind: str, name: str, missing: Finding) -> tuple[Finding, ...]:
    """Name what is missing where findings say that no law fits, and add the finding of it."""
    return (
        *(replace(f, names={**f.names, kind: name}) if f.code == "no-law-fits" else f for f in findings),
        missing,
    )


def _compare_along_own(
    test: RankedTest,
    current: Round,
    candidates: list[CandidateFit],
    given: Sequence[str],
    progress: Callable[[float], None],
) -> list[float]:
    """Fit laws with another mean than the law of the motion along their own motions, in place; return BIC.

    Along a motion without a mean a law is compared by its odd part: a stop on one side is one on both sides
    of half the stiffness. So compared are the best odd and the best other law for each number of parameters,
    up to one more than that of the law of the motion, laws of the user, and the simplest that tie with this;
    what others gain along it counts for nothing. Of an even force, as of a quadratic spring, nothing is left
    there: whatever else explains the test, this may, too; and a bilinear spring is a linear one there. Both
    are compared alone and with a cubic spring, and where neither ties with or in place of laws of the motion.
    """
    leader = current.leader.candidate
    laws, bic = [fit.candidate for fit in candidates], [fit.bic() for fit in candidates]
    same = [law.law.odd if leader.law.odd else law.name == leader.name for law in laws]
    least = max((value for value, law in zip(bic, laws, strict=True) if law.name == leader.name), default=0.0)
    kind = {i: (len(law.values), law.law.odd) for i, law in enumerate(laws) if not same[i]}
    first = {kind[i]: i for i in sorted(kind, key=lambda i: -bic[i]) if kind[i][0] <= len(leader.values) + 1}
    for i in kind:
        bic[i] = max(bic[i], least)
    near = sorted((i for i in kind if bic[i] < least + STRONG_EVIDENCE), key=lambda i: (kind[i], bic[i]))
    # the law of the motion, too, may be far from its own: its motion is that of values before this round
    moved = [i for i, law in enumerate(laws) if same[i] and not law.law.odd]
    even = [i for i in kind if laws[i].law.even]
    alone = [i for i in even if laws[i].name in given or hides_even(laws[i].name)]
    alone.sort(key=lambda i: -len(laws[i].values))
    partners = [i for i in kind if i not in alone and hides_even(laws[i].name, leader.name)]
    lost, own = set[int](), {i for i in kind if laws[i].name in given}
    compared = [*({*first.values(), *near[:_LEADERS], *moved, *own} - {*even, *partners}), *alone, *partners]
    for number, i in enumerate(compared):
        progress(_SHARE_OF_STAGES + _SHARE_OF_MOTIONS * number / len(compared))
        if i in partners and min((bic[j] for j in alone), default=np.inf) < least + STRONG_EVIDENCE:
            break
        if i in lost:
            continue
        fits, law, settled = list[CandidateFit](), laws[i], False
        # a few steps lead from one mean to another; where they end is known if they stay there
        while len(fits) < 1 + (i not in even) and (along := test.along(law, current)) is not None:
            law = along.leader.candidate
            fit, settled = current.leader_of(along)
            fits.append(fit)
        ends = [fit.bic() for fit in fits]
        stays = len(ends) == 2 and abs(ends[1] - ends[0]) < STRONG_EVIDENCE
        if stays or min(ends, default=np.inf) < bic[i]:
            bic[i], candidates[i] = min(ends), fits[int(np.argmin(ends))]
        if i in alone and settled:
            # what lacks a term leaves no less
            small = (j for j in alone if lacks(candidates[j], fit, fit.candidate.values))
            lost |= {j for j in small if replace(fit, candidate=laws[j]).bic() > least + STRONG_EVIDENCE}
    return bic


def _merge_equal_laws(
    candidates: list[CandidateFit],
    rows: WhitenedBalance,
    given: Sequence[str],
    fixed: Mapping[str, float],
) -> tuple[list[CandidateFit], CandidateFit | None]:
    """Drop sums that equal a law of the user, which is fitted from their values where they fit better.

    A model's own law takes the name of the library, and is returned.
    """
    own = None
    for name in given:
        law = next((fit for fit in candidates if fit.candidate.name == name), None)
        if law is None:
            continue
        others = ((fit, values_of_same(law, fit, rows)) for fit in candidates if fit is not law)
        twins = [(twin, values) for twin, values in others if values is not None]
        # a term of next to nothing is another one, too: the same law by its form has the name
        twins.sort(key=lambda twin: not have_same_terms(law, twin[0]))
        better = law
        for twin, values in twins:
            if better.bic() - twin.bic() > STRONG_EVIDENCE:
                fit = fit_candidate(replace(law.candidate, values=values), rows, fixed)
                again = replace(fit, unit=law.unit)
                better = min(better, again, key=lambda fit: inf if fit.fault else fit.bic())
        label = twins[0][0].candidate.name if name == OWN and twins else name
        named = replace(better, candidate=replace(better.candidate, name=label))
        gone = [twin for twin, _ in twins]
        candidates = [named if fit is law else fit for fit in candidates if fit not in gone]
        if name == OWN:
            # a linear law is the base of all sums, and the default of a case without a law
            own = None if law.candidate.linear else named
    return candidates, own
