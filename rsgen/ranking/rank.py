"""Which law? Candidates from the library, alone and summed, held against the test and against each other.

All candidates are compared along one motion, that of the best law so far; with a better law found the motion
is taken anew, until the best law is the one whose motion it is. Along it every candidate is a fit of maximum
likelihood, to second order in its distance from the best; a ranking of near candidates needs no more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import RsgenError
from rsgen.expression import parse, write
from rsgen.identification import Identification, identify
from rsgen.identification.data import Points, select_points
from rsgen.identification.start import Equations, solve_equations
from rsgen.law.numeric import compile_law
from rsgen.oscillator import Model
from rsgen.ranking.balance import Rows
from rsgen.ranking.candidate_terms import library_terms
from rsgen.ranking.fitting import Fitted, Guess, fit_rows
from rsgen.ranking.ranking_result import Candidate, Ranking
from rsgen.ranking.reference import LEAST, ORDER, Reference, first_rows, follow, neighbour_noise, standing_out
from rsgen.ranking.selection import Trial, search_sums
from rsgen.ranking.verdict import judge
from rsgen.surface import ResponseSurface

__all__ = ["identify_best", "rank"]

Array = NDArray[np.float64]

_POINTS = 500
"""So many points, spread over the amplitude, tell laws apart; all of them only narrow intervals."""

_SEARCHED = 300
_FITTED = 20
"""Candidates that are fitted with every parameter free."""

_ALONE = 6
_TERMS = 3
"""Laws of the library in a sum."""

_ONE = 1e-9
"""Frequencies that differ by less, relatively, are one."""

_ROUNDS = 5
_CLOSE = 3
"""References tried where the best candidate cannot follow the measured motion."""

_TIE = 6.0
"""Difference of BIC that is strong evidence (Kass and Raftery, Bayes factors, JASA 90 (1995))."""

_SAME = 1e-3
"""Forces that differ by less, relative to the largest, over the tested range are one law."""


@dataclass(frozen=True, slots=True, eq=False)
class _Round:
    """Candidates along the motion of one of them."""

    reference: Reference
    noise: Array
    rows: Rows
    own: Fitted

    def without(self, out: NDArray[np.bool_]) -> _Round:
        """Leave some points aside."""
        inside = np.flatnonzero(~out)
        own = replace(self.own, residual=self.own.residual[inside], unseen=self.own.unseen[inside])
        return _Round(self.reference.select(inside), self.noise, self.rows.select(inside), own)

    def left(self, points: Points) -> float:
        """What its own law leaves beyond noise, relative to force and response."""
        pairs = _trusted(self.own, self.noise, points.select(self.reference.kept))
        total, apart = neighbour_noise(self.own.residual, pairs, self.own.told)
        return float(np.sqrt(np.nansum(self.noise**2 * np.maximum(total**2 - apart**2, 0.0))))


def rank(surface: ResponseSurface, model: Model) -> Ranking:
    """Compare laws of the library, alone and summed up to three, and the model's own law.

    Parameters
    ----------
    surface
        Settled points of any test; held-out levels are left aside.
    model
        Its law is one more candidate; its mass, where given, its band and its background hold for all.

    Returns
    -------
    Ranking
        Best first, with a verdict in words; *none fits* where even the best leaves more than noise.

    Raises
    ------
    RsgenError
        Too few points, one frequency without a mass, no phase recorded, or no law follows the test.
    """
    points = _points(surface, model)
    if model.mass is None and np.ptp(points.omega) <= _ONE * points.omega[0]:
        raise RsgenError(
            "ranking: one frequency does not tell the mass: give it, or test at more frequencies"
        )
    own = _own_guess(points, model)
    rows = first_rows(points, compile_law(parse("c*v + k*x")), model.mass)
    candidates = _candidates(rows, points, model.mass, own, first=True)
    rounds: list[tuple[_Round, list[Fitted]]] = []
    tried: list[str] = []
    for _ in range(_ROUNDS):
        found = _next_round(points, candidates, model.mass, rounds[-1][0].noise if rounds else None)
        if found is None:
            break
        found, candidates = _compared(points, found, model.mass, own, candidates)
        rounds.append((found, candidates))
        name = found.own.guess.name
        if candidates[0].guess.name in (name, *tried):
            break
        tried.append(name)
    if not rounds:
        raise RsgenError("ranking: no law of the library has steady states near the measured ones")
    # rounds may go in a circle: that counts whose own law leaves least, of equals the last
    left = [each.left(points) for each, _ in rounds]
    best = max(i for i, value in enumerate(left) if value <= min(left) + LEAST)
    return replace(_ranking(points, *rounds[best], model), surface=surface)


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


def _points(surface: ResponseSurface, model: Model) -> Points:
    """Some of the points, what the sensor sees besides the mode taken off as the model's own law tells it."""
    if not surface.phase_known:
        raise RsgenError(
            "ranking: the phase was not recorded; laws are told apart by force and phase together"
        )
    points = select_points(surface, model)
    background = None if model.observation.background == "none" else identify(surface, model).background
    if background is not None:
        points = background.shape(points.omega).subtract(points, background.values)
    return points.select(points.spread(_POINTS))


def _own_guess(points: Points, model: Model) -> Guess:
    """The model's law with values of first order to start from."""
    law = compile_law(model.force)
    equations = Equations(
        points.omega,
        points.force,
        points.harmonics[:, :2],
        not law.odd and 0 in points.measured,
        1 / np.abs(points.force),
        np.zeros((0, 2)),
    )
    solution = solve_equations(equations, law, model.mass)
    values = dict(zip(law.parameters, solution.values.tolist(), strict=True))
    if model.mass is None:
        values["m"] = solution.mass
    return Guess(_OWN, model.elements, values)


_OWN = "the model's own law"


def _parts(name: str) -> frozenset[str]:
    """Laws in a sum, in whatever order."""
    return frozenset(name.split(" + "))


def _guess(trial: Trial, rows: Rows) -> Guess:
    x, v, *_ = rows.trajectory
    size, speed = float(np.max(np.abs(x))), float(np.max(np.abs(v)))
    law = trial.law
    return Guess(law.name, law.elements, trial.values, law.limits(size, speed), law.dissipates)


def _candidates(
    rows: Rows,
    points: Points,
    mass: float | None,
    own: Guess,
    *,
    first: bool,
    known: list[Fitted] | None = None,
) -> list[Fitted]:
    """Search sums and fit the best; best first."""
    few = points.spread(_SEARCHED)
    trials = search_sums(rows.select(few), library_terms(), mass, _TERMS)
    # laws alone are shown even where sums come nearer
    alone = [trial for trial in trials if len(trial.law.terms) <= 1][:_ALONE]
    near = [trial for trial in trials if trial not in alone][: _FITTED - len(alone)]
    guesses = [_guess(trial, rows) for trial in (*near, *alone)]
    names = {_parts(guess.name) for guess in guesses} | {_parts(_OWN)}
    guesses += [fit.guess for fit in (known or [])[:_CLOSE] if _parts(fit.guess.name) not in names]
    fitted = [
        fit for guess in [own, *guesses] if (fit := fit_rows(guess, rows, points.level, mass)) is not None
    ]
    if not fitted:
        raise RsgenError("ranking: no law gives a finite balance at the measured points")
    # along the measured motion the noise is not yet known
    noise = min(fit.misfit for fit in fitted) / fitted[0].residual.size if first else 1.0
    penalty = np.log(fitted[0].residual[:, rows.told].size)
    return sorted(fitted, key=lambda fit: fit.misfit / max(noise, 1e-300) + penalty * len(fit.guess.values))


def _next_round(
    points: Points, candidates: list[Fitted], mass: float | None, before: Array | None
) -> _Round | None:
    """Take the motion of the best candidate that can follow the measured one; ``before`` is a noise."""
    for fit in candidates[:_CLOSE]:
        reference = follow(points, fit.guess, mass)
        found = None if reference is None else _round(points, fit.guess, reference, mass, before)
        if found is not None:
            return found
    return None


def _round(
    points: Points, guess: Guess, reference: Reference, mass: float | None, before: Array | None
) -> _Round | None:
    """Fit the law whose motion it is, and estimate the noise."""
    noise = np.full(ORDER + 1, 1e-2) if before is None else before
    kept = points.select(reference.kept)
    guess = replace(guess, values=reference.named(mass))
    for _ in range(2):
        rows = reference.rows(noise)
        own = fit_rows(guess, rows, kept.level, mass)
        if own is None:
            return None
        _, apart = neighbour_noise(own.residual, _trusted(own, noise, kept), rows.told)
        noise = np.maximum(noise * np.where(np.isfinite(apart), apart, 1.0), LEAST)
    rows = reference.rows(noise)
    own = fit_rows(guess, rows, kept.level, mass)
    return None if own is None else _Round(reference, noise, rows, own)


def _trusted(fitted: Fitted, noise: Array, points: Points) -> NDArray[np.intp]:
    """Pairs of neighbours without those few points that stand out."""
    pairs = points.neighbours
    return pairs[~standing_out(fitted, noise)[pairs].any(axis=1)]


def _compared(
    points: Points, found: _Round, mass: float | None, own: Guess, known: list[Fitted]
) -> tuple[_Round, list[Fitted]]:
    """Fit the candidates; a few points that even the best cannot explain are left aside."""
    for _ in range(2):
        kept = points.select(found.reference.kept)
        known = _candidates(found.rows, kept, mass, own, first=False, known=known)
        out = standing_out(known[0], found.noise)
        if not out.any():
            break
        found = found.without(out)
    else:
        known = _candidates(
            found.rows, points.select(found.reference.kept), mass, own, first=False, known=known
        )
    return found, known


def _ranking(points: Points, current: _Round, candidates: list[Fitted], model: Model) -> Ranking:
    """Order the candidates, merge the model's own law with its like, and put the verdict into words."""
    candidates = _merged(candidates, current.rows)
    lowest = min(fit.bic for fit in candidates)
    tied = [fit for fit in candidates if fit.bic - lowest < _TIE]
    tied.sort(key=lambda fit: (len(fit.guess.values), fit.bic))
    others = sorted((fit for fit in candidates if fit.bic - lowest >= _TIE), key=lambda fit: fit.bic)
    ordered = [*tied, *others]
    scale = np.repeat(current.noise, 2)[1:]
    rows = [
        Candidate(
            fit.guess.name,
            write(fit.guess.force),
            len(fit.guess.values),
            float(np.sqrt(np.mean((fit.unseen * scale)[:, fit.told] ** 2))),
            fit.bic - lowest,
            fit.bic - lowest < _TIE,
            dict(fit.guess.values),
        )
        for fit in ordered
    ]
    kept = points.select(current.reference.kept)
    judgement = judge(ordered[0], kept, current.noise, rows, len(points) - len(kept), current.reference.feeds)
    return Ranking(
        tuple(rows),
        replace(model, elements=ordered[0].guess.elements),
        judgement.fits,
        judgement.sentences,
        float(current.noise[1]),
        judgement.unexplained,
    )


def _merged(candidates: list[Fitted], rows: Rows) -> list[Fitted]:
    """Drop what is the model's own law under another name; the own one takes that name."""
    own = next((fit for fit in candidates if fit.guess.name == _OWN), None)
    if own is None:
        return candidates
    x, v, a, step = (part[::7] for part in rows.trajectory)

    def force(fit: Fitted) -> Array:
        law = fit.guess.law
        return law.sample(x, v, a, step, np.array([fit.guess.values[n] for n in law.parameters])).force

    mine = force(own)
    largest = float(np.max(np.abs(mine)))
    like = [fit for fit in candidates if fit is not own and len(fit.guess.values) == len(own.guess.values)]
    apart = [float(np.max(np.abs(force(fit) - mine))) for fit in like]
    if not apart or min(apart) > _SAME * largest:
        return candidates
    twin = like[int(np.argmin(apart))]
    named = replace(own, guess=replace(own.guess, name=twin.guess.name))
    return [named if each is own else each for each in candidates if each is not twin]
