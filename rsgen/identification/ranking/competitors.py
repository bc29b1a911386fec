"""What competes: laws as they are given, and sums of laws of the library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Model
from rsgen.formula import symbol
from rsgen.identification.fitting.points import Points
from rsgen.identification.ranking.balance import Rows
from rsgen.identification.ranking.fitting import Fitted, Guess, fit_rows
from rsgen.identification.ranking.ranking_result import OWN
from rsgen.identification.ranking.selection import Trial, search_sums
from rsgen.identification.ranking.sums import Term, library_terms
from rsgen.identification.starting.equations import Equations
from rsgen.identification.starting.start import solve_equations
from rsgen.law.element import Element, Law, LawLike, as_elements, make_element
from rsgen.law.library import Library
from rsgen.law.memory import with_equations

__all__ = ["Entries", "competitors", "start_guess"]


_SEARCHED = 300
"""Points on which sums are searched: a coarse search needs fewer than a fit."""

_FITTED = (20, 6)
"""Candidates without memory that are fitted, and single laws among them: shown even where sums are nearer."""

_LOOPS = (8, 3)
"""The same of candidates with memory: they take no place from the others."""

_TOGETHER = 3
"""Most laws of the library in a sum."""


@dataclass(frozen=True, slots=True, eq=False)
class Entries:
    """What competes.

    Parameters
    ----------
    given
        Laws as they are, with values to start from.
    terms
        Laws of the library that are tried beside a linear spring and damper, alone and in sums.
    mass
        [kg], None where it is free.
    """

    given: tuple[Guess, ...]
    terms: tuple[Term, ...]
    mass: float | None

    def search(
        self,
        rows: Rows,
        points: Points,
        *,
        known: Sequence[Fitted] = (),
    ) -> list[Guess]:
        """Search sums and give the best of them, beside the laws that are given.

        Parameters
        ----------
        rows, points
            The balance, and the points that it is of.
        known
            Candidates that compete in any case.
        """
        guesses = list(self.given)
        if self.terms or not guesses:
            few = points.spread(_SEARCHED)
            trials = search_sums(rows.select(few), self.terms, self.mass, _TOGETHER)
            plain = _near([trial for trial in trials if not trial.remembers], *_FITTED)
            loops = _near([trial for trial in trials if trial.remembers], *_LOOPS)
            guesses += [_guess(trial, rows) for trial in (*plain, *loops)]
        again = [fit.guess for fit in known]
        return list({_parts(guess.name): guess for guess in (*again, *guesses)}.values())

    def fit(self, guesses: Sequence[Guess], rows: Rows, points: Points, *, first: bool) -> list[Fitted]:
        """Fit candidates with every parameter free; best first.

        Parameters
        ----------
        guesses
            The candidates.
        rows, points
            The balance, and the points that it is of.
        first
            True along the measured motion, where the noise is not yet known.

        Raises
        ------
        RsgenError
            No candidate gives a finite balance.
        """
        fits = [
            fit for guess in guesses if (fit := fit_rows(guess, rows, points.level, self.mass)) is not None
        ]
        if not fits:
            raise RsgenError("ranking: no candidate gives a finite balance at the measured points")
        noise = min(fit.misfit for fit in fits) / fits[0].residual.size if first else 1.0
        penalty = np.log(fits[0].residual[:, rows.compared].size)
        return sorted(fits, key=lambda fit: fit.misfit / max(noise, 1e-300) + penalty * len(fit.guess.values))


def competitors(
    candidates: Model | LawLike | Sequence[LawLike] | None,
) -> tuple[dict[str, tuple[Element, ...]], tuple[Term, ...], Model]:
    """Laws that compete as they are, terms of the library, and the model whose test and mass hold for all."""
    linear = Model((make_element("linear-spring", "k*x"), make_element("linear-damper", "c*v")))
    if candidates is None:
        return {}, library_terms(), linear
    if isinstance(candidates, Model):
        return {OWN: candidates.elements}, library_terms(), candidates
    if isinstance(candidates, Library):
        candidates = tuple(candidates)
    if isinstance(candidates, str) or not isinstance(candidates, Sequence):
        candidates = [candidates]
    laws: dict[str, tuple[Element, ...]] = {}
    terms = []
    library = {term.source: term for term in library_terms()}
    for law in candidates:
        if isinstance(law, Law) and law in library:
            terms.append(library[law])
            continue
        elements = as_elements(law)
        name = getattr(law, "name", "") or with_equations(sum(element.force for element in elements))
        laws.setdefault(name, _completed(elements) if isinstance(law, Law) and law.title else elements)
    if not laws and not terms:
        raise RsgenError("ranking: no candidate given; give formulas or laws, or none for all of rsgen.laws")
    return laws, tuple(terms), linear


def _completed(elements: tuple[Element, ...]) -> tuple[Element, ...]:
    """A spring or damper of the library with the linear one that it lacks."""
    names = {name for element in elements for name in element.parameters}
    has = {state: any(element.force.has(symbol(state)) for element in elements) for state in "xv"}
    missing = [
        make_element(kind, f"{name if name not in names else name + '_'}*{state}")
        for kind, name, state in (("linear-spring", "k", "x"), ("linear-damper", "c", "v"))
        if not has[state]
    ]
    return (*elements, *missing)


def start_guess(name: str, elements: tuple[Element, ...], points: Points, mass: float | None) -> Guess:
    """A law with values of first order to start from."""
    guess = Guess(name, elements, {})
    law = guess.law
    equations = Equations(
        points.omega,
        points.force,
        points.harmonics[:, :2],
        not law.odd and 0 in points.measured,
        1 / np.abs(points.force),
        np.zeros((0, 2)),
    )
    solution = solve_equations(equations, law, mass)
    values = dict(zip(law.parameters, solution.values.tolist(), strict=True))
    if mass is None:
        values["m"] = solution.mass
    return replace(guess, values=values)


def _near(trials: Sequence[Trial], most: int, alone: int) -> list[Trial]:
    """The first sums, and the first laws that stand alone, shown even where sums are nearer."""
    single = [trial for trial in trials if len(trial.law.terms) <= 1][:alone]
    return [trial for trial in trials if trial not in single][: most - len(single)] + single


def _parts(name: str) -> frozenset[str]:
    """Laws in a sum, in whatever order."""
    return frozenset(name.split(" + "))


def _guess(trial: Trial, rows: Rows) -> Guess:
    x, v, *_ = rows.trajectory
    size, speed = float(np.max(np.abs(x))), float(np.max(np.abs(v)))
    law = trial.law
    return Guess(law.name, law.elements, trial.values, law.limits(size, speed), law.dissipates)
