"""Which sums of terms come near the test? Every term is evaluated once, every sum is a small least squares.

Parameters in which a term is not linear take a few values each, and between them the term is linearised.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import chain, combinations, product
from math import prod

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Model
from rsgen.formula import symbol
from rsgen.identification.fitting.points import Points
from rsgen.identification.ranking.balance import Rows, Sum, Term, base_law, library_terms
from rsgen.identification.ranking.fitting import Fitted, Guess, fit_rows
from rsgen.identification.ranking.ranking_result import OWN
from rsgen.identification.starting.equations import Equations
from rsgen.identification.starting.start import solve_equations
from rsgen.law.element import Element, Law, LawLike, Library, as_elements, make_element
from rsgen.law.memory import with_equations

Places = NDArray[np.intp]

_RIDGE = 1e-10
"""Columns have unit size; beneath this share of it a combination of them is not compared."""

_BEAM = 24
"""Best sums of each size that are tried with one term more."""


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A sum of terms with the values that come nearest to the test.

    Parameters
    ----------
    law
        The sum.
    values
        Of every parameter, by its name in the sum; a mass that is free is "m".
    misfit
        Sum of squares left, in units of the noise.
    bic
        Bayesian information criterion: misfit + parameters * log(rows).
    """

    law: Sum
    values: dict[str, float]
    misfit: float
    bic: float

    @property
    def remembers(self) -> bool:
        """Whether one of its terms has a memory."""
        return any(term.law.remembers for term in self.law.terms)


@dataclass(frozen=True, slots=True, eq=False)
class _Variants:
    """A term at some values of the parameters it is not linear in.

    Parameters
    ----------
    values
        (variants, searched) of these parameters.
    reach
        (variants, searched) how far from each of them its slope is trusted: to half way to the next value.
    columns, slopes
        (variants, linear), (variants, searched) where the columns of coefficients and of slopes stand; slopes
        are those of a last coefficient of one.
    """

    values: Array
    reach: Array
    columns: Places
    slopes: Places

    def select(self, chosen: Places) -> _Variants:
        """Keep some of them."""
        return _Variants(*(getattr(self, each.name)[chosen] for each in fields(self)))


class _Columns:
    """All columns, normalised, and their products."""

    def __init__(self, rows: Rows, terms: Sequence[Term], fixed: Mapping[str, float]) -> None:
        x, v, a, step = rows.trajectory
        size, speed = float(np.max(np.abs(x))), float(np.max(np.abs(v)))
        base = base_law().sample(x, v, a, step, np.zeros(2)).by_parameter
        blocks = [rows.of(np.stack(base, axis=-1)), rows.inertia[:, :, None]]
        self.base = {name: i for i, name in enumerate(("c", "k", "m")) if name not in fixed}
        self.variants: dict[str, _Variants] = {}
        count = 3
        for term in terms:
            names = term.law.parameters
            order = [names.index(name) for name in (*term.linear, *term.search)]
            ranges = [
                [where.factor(size, speed) * value for value in where.values]
                for where in term.search.values()
            ]
            trials = list(product(*ranges))
            places = count + np.arange(len(trials) * len(order)).reshape(len(trials), len(order))
            self.variants[term.name] = _Variants(
                np.array(trials).reshape(len(trials), len(ranges)),
                np.array([[*map(_reach, ranges, trial)] for trial in trials]).reshape(
                    len(trials), len(ranges)
                ),
                places[:, : len(term.linear)],
                places[:, len(term.linear) :],
            )
            count += places.size
            for trial in trials:
                point = np.zeros(len(names))
                point[names.index(term.linear[-1])] = 1.0
                for name, value in zip(term.search, trial, strict=True):
                    point[names.index(name)] = value
                sample = term.law.sample(x, v, a, step, point)
                blocks.append(rows.of(np.stack([sample.by_parameter[i] for i in order], axis=-1)))
        compared = rows.compared
        matrix = np.concatenate(blocks, axis=2)[:, compared].reshape(-1, count)
        right = rows.right - fixed.get("m", 0.0) * rows.inertia
        flat = right[:, compared].reshape(-1)
        norm = np.sqrt(np.sum(matrix**2, axis=0))
        self.norm = np.where(norm > 0, norm, 1.0)
        matrix = matrix / self.norm
        self.products = matrix.T @ matrix
        self.against = matrix.T @ flat
        self.power = float(flat @ flat)
        # every sum has the background that suits it: only what that leaves is compared
        background = rows.background[:, compared].reshape(len(flat), -1)
        if background.shape[1]:
            whole = np.vstack([background, np.diag(rows.background_weight)])
            orthonormal, _ = np.linalg.qr(whole / np.sqrt(np.sum(whole**2, axis=0)))
            basis = orthonormal[: len(flat)]
            taken = basis.T @ matrix
            self.products -= taken.T @ taken
            self.against -= taken.T @ (basis.T @ flat)
            self.power -= float(np.sum((basis.T @ flat) ** 2))
        self.rows = len(flat)


def search_sums(rows: Rows, terms: Sequence[Term], fixed: Mapping[str, float], most: int) -> list[Trial]:
    """Try the base, every term, every pair, and the best sums with every term more; best first by BIC.

    Parameters
    ----------
    rows
        The balance.
    terms
        What there is.
    fixed
        The mass "m" [kg], where it is known.
    most
        Terms in a sum.
    """
    columns = _Columns(rows, terms, fixed)
    place = {term.name: i for i, term in enumerate(terms)}

    def sensible(chosen: Sequence[Term]) -> bool:
        # two loops look like one of a third shape, and no steady test takes them apart
        alone = (sum(term.how.spring for term in chosen), sum(term.law.remembers for term in chosen))
        return max(alone) <= 1

    found: dict[frozenset[str], tuple[Trial, tuple[_Variants, ...]]] = {}

    def consider(chosen: tuple[Term, ...], variants: Sequence[_Variants]) -> None:
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
        # laws with memory stand beside the others and take no place from them
        kinds = ([entry for entry in last if entry[0].remembers is kind][:_BEAM] for kind in (False, True))
        for trial, variants in chain.from_iterable(kinds):
            inside = {term.name for term in trial.law.terms}
            for term in terms:
                if term.name not in inside and sensible((*trial.law.terms, term)):
                    among = [*zip(trial.law.terms, variants, strict=True)]
                    among.append((term, columns.variants[term.name]))
                    # one order, that of the library: a sum stands once
                    among.sort(key=lambda entry: place[entry[0].name])
                    consider(tuple(part for part, _ in among), [each for _, each in among])
    return sorted((entry[0] for entry in found.values()), key=lambda trial: trial.bic)


def _reach(values: Sequence[float], value: float) -> float:
    """Half the distance to the farther of the next values, and a little more."""
    apart = sorted(abs(other - value) for other in values if other != value)[:2]
    return 0.6 * apart[-1] if apart else 0.1 * abs(value)


def _best(
    columns: _Columns, law: Sum, variants: Sequence[_Variants]
) -> tuple[Trial, tuple[_Variants, ...]] | None:
    """Solve for every combination of variants at once and take the best that is allowed, and its variants."""
    base = {name: i for name, i in columns.base.items() if name != "k" or law.has_spring}
    # without a term there is one combination, of none
    count = prod(len(each.values) for each in variants)
    picks = np.indices([len(each.values) for each in variants]).reshape(len(variants), count)
    choices = [each.select(pick) for each, pick in zip(variants, picks, strict=True)]
    best: tuple[float, dict[str, float], int] | None = None
    # between its values a term is linearised; where that leads too far, it stays at the value
    for between in (True, False) if any(term.search for term in law.terms) else (False,):
        parts = [np.broadcast_to(np.array(list(base.values())), (count, len(base)))]
        for choice in choices:
            parts += [choice.columns, choice.slopes] if between else [choice.columns]
        misfit, coefficients = _solve(columns, np.concatenate(parts, axis=1))
        named = _named(law, base, coefficients, choices, between)
        for group in law.dissipates:
            misfit[np.sum([named[name] for name in group], axis=0) < 0] = np.inf
        if between:
            misfit[~_near(law, named, choices)] = np.inf
        i = int(np.argmin(misfit))
        if np.isfinite(misfit[i]) and (best is None or misfit[i] < best[0]):
            best = float(misfit[i]), {name: float(value[i]) for name, value in named.items()}, i
    if best is None:
        return None
    left = max(best[0], 0.0)
    trial = Trial(law, best[1], left, left + len(best[1]) * float(np.log(columns.rows)))
    return trial, tuple(choice.select(np.array([best[2]])) for choice in choices)


def _solve(columns: _Columns, index: NDArray[np.intp]) -> tuple[Array, Array]:
    """Misfit (trials,) and coefficients (trials, width) of the columns (trials, width)."""
    matrix = columns.products[index[:, :, None], index[:, None, :]]
    width = np.arange(index.shape[1])
    matrix[:, width, width] += _RIDGE
    right = columns.against[index]
    solution = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    return columns.power - np.sum(solution * right, axis=1), solution / columns.norm[index]


def _named(
    law: Sum,
    base: dict[str, int],
    coefficients: Array,
    choices: Sequence[_Variants],
    between: bool,
) -> dict[str, Array]:
    """Values (trials,) of every parameter by its name in the sum."""
    values = dict(zip(base, coefficients.T, strict=False))
    place = len(base)
    for choice, term, names in zip(choices, law.terms, law.names, strict=True):
        for i, name in enumerate(term.linear):
            values[names[name]] = coefficients[:, place + i]
        place += len(term.linear)
        last = coefficients[:, place - 1]
        for i, name in enumerate(term.search):
            values[names[name]] = choice.values[:, i]
            if between:
                values[names[name]] = values[names[name]] + coefficients[:, place + i] / np.where(
                    last == 0, np.inf, last
                )
        place += len(term.search) if between else 0
    return values


def _near(law: Sum, named: dict[str, Array], choices: Sequence[_Variants]) -> NDArray[np.bool_]:
    """(trials,) True where every linearised parameter stays near the value it was linearised at."""
    near = np.ones(len(choices[0].values), dtype=bool)
    for choice, term, names in zip(choices, law.terms, law.names, strict=True):
        for i, name in enumerate(term.search):
            near &= np.abs(named[names[name]] - choice.values[:, i]) <= choice.reach[:, i]
    return near


# ----------------------------------------------------------------------------
# What competes: laws as they are given, and sums of laws of the library.

_SEARCHED = 300
"""Points on which sums are searched: a coarse search needs fewer than a fit."""

_FITTED = (20, 6)
"""Candidates without memory that are fitted, and single laws among them: shown even where sums are nearer."""

_LOOPS = (8, 3)
"""The same of candidates with memory: they take no place from the others."""


@dataclass(frozen=True, slots=True, eq=False)
class Entries:
    """What competes.

    Parameters
    ----------
    given
        Laws as they are, with values to start from.
    terms
        Laws of the library that are tried beside a linear spring and damper, alone and in sums.
    fixed
        The mass "m" [kg], where it is known.
    terms_in_sum
        Most laws of the library in a sum.
    """

    given: tuple[Guess, ...]
    terms: tuple[Term, ...]
    fixed: Mapping[str, float]
    terms_in_sum: int

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
            trials = search_sums(rows.select(few), self.terms, self.fixed, self.terms_in_sum)
            plain = _near_laws([trial for trial in trials if not trial.remembers], *_FITTED)
            loops = _near_laws([trial for trial in trials if trial.remembers], *_LOOPS)
            guesses += [_guess(trial, rows, self.fixed) for trial in (*plain, *loops)]
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
            fit for guess in guesses if (fit := fit_rows(guess, rows, points.level, self.fixed)) is not None
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


def start_guess(
    name: str, elements: tuple[Element, ...], points: Points, fixed: Mapping[str, float]
) -> Guess:
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
    solution = solve_equations(equations, law, fixed)
    values = dict(zip(law.parameters, solution.values.tolist(), strict=True))
    return replace(guess, values={**values, "m": solution.mass})


def _near_laws(trials: Sequence[Trial], most: int, alone: int) -> list[Trial]:
    """The first sums, and the first laws that stand alone, shown even where sums are nearer."""
    single = [trial for trial in trials if len(trial.law.terms) <= 1][:alone]
    return [trial for trial in trials if trial not in single][: most - len(single)] + single


def _parts(name: str) -> frozenset[str]:
    """Laws in a sum, in whatever order."""
    return frozenset(name.split(" + "))


def _guess(trial: Trial, rows: Rows, fixed: Mapping[str, float]) -> Guess:
    x, v, *_ = rows.trajectory
    size, speed = float(np.max(np.abs(x))), float(np.max(np.abs(v)))
    law = trial.law
    return Guess(law.name, law.elements, {**trial.values, **fixed}, law.limits(size, speed), law.dissipates)
