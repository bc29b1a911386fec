"""Search of sums of terms: least squares of the whitened balance.

All single terms and pairs are solved, then the best ``_BEAM_WIDTH`` sums of each size with one term more: the
terms of the smaller sum keep the variants that were the best there.

The rows of every term are evaluated once, with a few values of each parameter in which it is not linear;
between these values the term is linearised. Products of all columns are formed once, so that every sum is the
solution of small normal equations. Sums are ordered by BIC = chi^2 + parameters * log(rows), Schwarz 1978.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import combinations, product
from math import prod

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Model
from rsgen.formula.names import symbol
from rsgen.identification.ranking.balance import WhitenedBalance
from rsgen.identification.ranking.candidate_fit import CandidateFit, CandidateLaw, fit_candidate
from rsgen.identification.ranking.library_sums import Sum, Term, base_elements, library_terms
from rsgen.identification.ranking.ranking_result import OWN
from rsgen.law.element import Element, Law, LawLike, Library, as_elements, forces_by_motion, make_element
from rsgen.law.memory import with_equations
from rsgen.law.numeric import compile_law

Places = NDArray[np.intp]

_RIDGE = 1e-10
"""Ridge of the normal equations of columns of unit size."""

_BEAM_WIDTH = 24
"""Best sums of each size that are tried with one term more."""


@dataclass(frozen=True, slots=True, eq=False)
class SumFit:
    """A sum of terms with its best values.

    Parameters
    ----------
    law
        The sum.
    values
        Value of every parameter, by its name in the sum; a free mass is "m".
    chi_squared
        Sum of squares in units of the noise.
    bic
        Bayesian information criterion; infinite for a single law whose friction feeds energy at any value.
    """

    law: Sum
    values: dict[str, float]
    chi_squared: float
    bic: float

    @property
    def remembers(self) -> bool:
        """True if one of its terms has a memory."""
        return any(term.remembers for term in self.law.terms)


@dataclass(frozen=True, slots=True, eq=False)
class _TermVariants:
    """A term at some values of the parameters in which it is not linear.

    Parameters
    ----------
    values
        (variants, searched) values of these parameters.
    reach
        (variants, searched) distance up to which the slope at each value is used; see ``_reach``.
    columns, slopes
        (variants, linear), (variants, searched) numbers of the columns of the linear parameters, and of the
        slopes by the others; these belong to a last coefficient of one.
    """

    values: Array
    reach: Array
    columns: Places
    slopes: Places

    def select(self, chosen: Places) -> _TermVariants:
        """Keep some variants."""
        return _TermVariants(*(getattr(self, column.name)[chosen] for column in fields(self)))


class _TermColumns:
    """Columns of base and terms, of unit size, and their products without the part of the background."""

    def __init__(self, rows: WhitenedBalance, terms: Sequence[Term], fixed: Mapping[str, float]) -> None:
        x, v, a, step = rows.motion_of(rows.sensors)
        size, speed = float(np.max(np.abs(x))), float(np.max(np.abs(v)))
        base = base_elements(rows.sensors)
        blocks = [
            rows.of_law(compile_law(element.force), np.zeros(1), element.across)[1]
            for element in base.values()
        ]
        blocks.append(rows.inertia[:, :, None])
        self.base = {name: i for i, name in enumerate((*base, "m")) if name not in fixed}
        self.variants: dict[Term, _TermVariants] = {}
        count = len(blocks)
        for term in terms:
            names = term.law.parameters
            order = [names.index(name) for name in (*term.linear, *term.search)]
            # a preloaded stop has the odd force of one that opens, which moves the mean less
            opens = term.how.mirror and rows.odd_alone
            ranges = [
                [interval.factor(size, speed) * value for value in interval.values if value > 0 or not opens]
                for interval in term.search.values()
            ]
            trials = list(product(*ranges))
            places = count + np.arange(len(trials) * len(order)).reshape(len(trials), len(order))
            self.variants[term] = _TermVariants(
                np.array(trials).reshape(len(trials), len(ranges)),
                np.array([[*map(_reach, ranges, trial)] for trial in trials]).reshape(
                    len(trials), len(ranges)
                ),
                places[:, : len(term.linear)],
                places[:, len(term.linear) :],
            )
            count += places.size
            for trial in trials:
                known = {term.linear[-1]: 1.0, **dict(zip(term.search, trial, strict=True))}
                point = term.law.ordered(dict.fromkeys(names, 0.0) | known)
                sample = term.law.sample(x, v, a, step, point)
                blocks.append(rows.of_forces(np.stack([sample.by_parameter[i] for i in order], axis=-1)))
        blocks.append((rows.right - fixed.get("m", 0.0) * rows.inertia)[:, :, None])
        matrix = np.concatenate(blocks, axis=2)[:, rows.compared].reshape(-1, count + 1)
        self.rows = len(matrix)
        background = rows.background[:, rows.compared].reshape(self.rows, -1)
        # a mass that was weighed, and what is known of the background, are one more row each
        prior = np.zeros((1 + background.shape[1], count + 1))
        if rows.weighed is not None:
            mass, error = rows.weighed
            prior[0, [len(base), -1]] = 1 / error, mass / error
        matrix = np.concatenate([matrix, prior])
        norm = np.sqrt(np.sum(matrix[:, :-1] ** 2, axis=0))
        self.norm = np.where(norm > 0, norm, 1.0)
        matrix[:, :-1] /= self.norm
        # every sum has its own best background: project it out of all columns
        weight = np.diag(rows.background_weight)
        weighted = np.concatenate([background, np.zeros((1, len(weight))), weight])
        basis = np.linalg.qr(weighted / np.sqrt(np.sum(weighted**2, axis=0)))[0]
        matrix -= basis @ (basis.T @ matrix)
        products = matrix.T @ matrix
        self.products, self.against, self.power = products[:-1, :-1], products[:-1, -1], products[-1, -1]


def search_sums(
    rows: WhitenedBalance, terms: Sequence[Term], fixed: Mapping[str, float], most: int
) -> list[SumFit]:
    """Fit the base, every term, every pair, and sums of three; best first by BIC.

    Sums of three are the best pairs with one more term, and all of terms without values to be tried: where a
    law of a pair degenerates, as a Stribeck velocity beyond all velocities, these say the same with fewer.

    Parameters
    ----------
    rows
        The balance.
    terms
        Terms to choose from.
    fixed
        The mass "m" [kg], if it is known.
    most
        Largest number of terms in a sum.
    """
    # each law is followed by its mirror image, where that is another law
    terms = [
        replace(term, mirrored=image) for term in terms for image in (False, True)[: 1 + term.how.mirror]
    ]
    search = _SumSearch(rows, terms, fixed)
    linear = [term for term in terms if not (term.search or term.remembers)]
    for size in range(most + 1):
        for chosen in filter(search.is_sensible, combinations(terms if size < 3 else linear, size)):
            search.consider(chosen, [search.columns.variants[term] for term in chosen])
    for size in range(3, most + 1):
        search.extend(size)
    return sorted((entry[0] for entry in search.found.values()), key=lambda trial: trial.bic)


class _SumSearch:
    """The best fit of each sum that was tried, by the names of its terms, with the variants of these."""

    def __init__(self, rows: WhitenedBalance, terms: Sequence[Term], fixed: Mapping[str, float]) -> None:
        self._rows, self._terms = rows, terms
        self._place = {term: i for i, term in enumerate(terms)}
        self.columns = _TermColumns(rows, terms, fixed)
        self.found: dict[frozenset[str], tuple[SumFit, tuple[_TermVariants, ...]]] = {}

    def is_sensible(self, chosen: Sequence[Term]) -> bool:
        """Return True if a steady-state test can separate the terms.

        It does not tell two hysteretic terms, two springs in place of k*x, or both sides of a stop.
        """
        counts = [sum(term.how.spring for term in chosen), sum(term.remembers for term in chosen)]
        counts += Counter(term.name for term in chosen).values()
        if self._rows.amplitudes_alone:
            # even forces change an amplitude in second order, and two of them take each other's place
            counts.append(sum(not term.law.odd for term in chosen))
        return max(counts) <= 1

    def consider(self, chosen: tuple[Term, ...], variants: Sequence[_TermVariants]) -> None:
        """Fit a sum, and keep it if no fit of the same terms leaves less."""
        law = Sum(chosen, self._rows.sensors)
        result = _best_variants(self.columns, law, variants)
        if result is None and len(chosen) == 1:
            # its fit says why it is no candidate
            result = _best_variants(self.columns, law, variants, dissipating=False)
        key = frozenset(term.name for term in chosen)
        # where nothing recorded tells the sides of a stop, that of the library's formula is taken
        ahead = float(any(term.mirrored for term in chosen))
        if result and (
            key not in self.found or result[0].chi_squared < self.found[key][0].chi_squared - ahead
        ):
            self.found[key] = result

    def extend(self, size: int) -> None:
        """Add each term to the best sums of one term less; sums with memory have a beam of their own."""
        last = [entry for key, entry in self.found.items() if len(key) == size - 1]
        last.sort(key=lambda entry: entry[0].chi_squared)
        for kind in (False, True):
            for trial, variants in [entry for entry in last if entry[0].remembers is kind][:_BEAM_WIDTH]:
                for term in self._terms:
                    if self.is_sensible((*trial.law.terms, term)):
                        among = [*zip(trial.law.terms, variants, strict=True)]
                        among.append((term, self.columns.variants[term]))
                        # terms in the order of the library, so that every sum is tried once
                        among.sort(key=lambda entry: self._place[entry[0]])
                        self.consider(tuple(term for term, _ in among), [variant for _, variant in among])


def _reach(values: Sequence[float], value: float) -> float:
    """Return the distance up to which a slope is used: 0.6 of that to the farther of two neighbours."""
    distances = sorted(abs(other - value) for other in values if other != value)[:2]
    return 0.6 * distances[-1] if distances else 0.1 * abs(value)


def _best_variants(
    columns: _TermColumns, law: Sum, variants: Sequence[_TermVariants], *, dissipating: bool = True
) -> tuple[SumFit, tuple[_TermVariants, ...]] | None:
    """Solve for every combination of variants; return the best one and its variants.

    Friction that feeds energy is admitted where ``dissipating`` is False.
    """
    base = {name: i for name, i in columns.base.items() if name in law.base or name == "m"}
    sizes = [len(variant.values) for variant in variants]
    # without a term there is one combination, of none
    count = prod(sizes)
    picks = np.indices(sizes).reshape(len(variants), count)
    choices = [variant.select(pick) for variant, pick in zip(variants, picks, strict=True)]
    best: tuple[float, dict[str, float], int] | None = None
    # linearised between the values of a term; if the slope leads too far, at the values only
    for between in (True, False) if any(term.search for term in law.terms) else (False,):
        parts = [np.broadcast_to(np.array(list(base.values())), (count, len(base)))]
        for choice in choices:
            parts += [choice.columns, choice.slopes] if between else [choice.columns]
        chi_squared, coefficients = _solve(columns, np.concatenate(parts, axis=1))
        named = _named(law, base, coefficients, choices, between)
        for group in law.dissipates if dissipating else ():
            chi_squared[np.sum([named[name] for name in group], axis=0) < 0] = np.inf
        if between:
            chi_squared[~_within_reach(law, named, choices)] = np.inf
        i = int(np.argmin(chi_squared))
        if np.isfinite(chi_squared[i]) and (best is None or chi_squared[i] < best[0]):
            best = float(chi_squared[i]), {name: float(value[i]) for name, value in named.items()}, i
    if best is None:
        return None
    least = max(best[0], 0.0)
    bic = least + len(best[1]) * float(np.log(columns.rows)) if dissipating else np.inf
    trial = SumFit(law, best[1], least, bic)
    return trial, tuple(choice.select(np.array([best[2]])) for choice in choices)


def _solve(columns: _TermColumns, index: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return chi^2 (trials,) and coefficients (trials, width) of the columns ``index`` (trials, width)."""
    matrix = columns.products[index[:, :, None], index[:, None, :]]
    width = np.arange(index.shape[1])
    matrix[:, width, width] += _RIDGE
    right = columns.against[index]
    solution = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    return columns.power - np.sum(solution * right, axis=1), solution / columns.norm[index]


def _named(
    law: Sum, base: dict[str, int], coefficients: Array, choices: Sequence[_TermVariants], between: bool
) -> dict[str, Array]:
    """Return the values (trials,) of every parameter by its name in the sum."""
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


def _within_reach(law: Sum, named: dict[str, Array], choices: Sequence[_TermVariants]) -> NDArray[np.bool_]:
    """Return the mask (trials,) of trials whose linearised parameters are within reach of their values."""
    near = np.ones(len(choices[0].values), dtype=bool)
    for choice, term, names in zip(choices, law.terms, law.names, strict=True):
        for i, name in enumerate(term.search):
            near &= np.abs(named[names[name]] - choice.values[:, i]) <= choice.reach[:, i]
    return near


# ----------------------------------------------------------------------------
# Candidates: laws of the user as they are, and sums of laws of the library.

_SHORTLIST = {"most": 20, "alone": 6}
"""Sums without memory that are fitted, and single laws among them, which are shown even if sums are nearer.
"""

_SHORTLIST_WITH_MEMORY = {"most": 8, "alone": 3}
"""The same for sums with memory."""


@dataclass(frozen=True, slots=True)
class Candidates:
    """The candidates of a stage of a ranking, which compete with each other.

    Parameters
    ----------
    given
        Laws of the user with initial values.
    terms
        Laws of the library, added to a linear spring and damper, one by one and in sums.
    terms_in_sum
        Largest number of laws of the library in a sum.
    fixed
        The mass "m" [kg], if it is known.
    """

    given: tuple[CandidateLaw, ...]
    terms: tuple[Term, ...]
    terms_in_sum: int
    fixed: Mapping[str, float] = field(hash=False)

    def search(self, rows: WhitenedBalance, known: Sequence[CandidateFit] = ()) -> list[CandidateLaw]:
        """Return the laws of the user and the best sums; the candidates of ``known`` compete in any case."""
        candidates = list(self.given)
        if self.terms or not candidates:
            trials = search_sums(rows.few, self.terms, self.fixed, self.terms_in_sum)
            plain = _shortlist([trial for trial in trials if not trial.remembers], **_SHORTLIST)
            loops = _shortlist([trial for trial in trials if trial.remembers], **_SHORTLIST_WITH_MEMORY)
            refused = [trial for trial in trials if not np.isfinite(trial.bic)]
            leader = known[0].candidate.name if rows.odd_alone and known else ""
            hidden = [trial for trial in trials if leader and hides_even(trial.law.name, leader)]
            chosen = (*plain, *loops, *refused, *hidden)
            candidates += [_candidate_of(trial, rows, self.fixed) for trial in chosen]
        again = [fit.candidate for fit in known]
        return list({_term_names(candidate.name): candidate for candidate in (*again, *candidates)}.values())

    def fit(
        self, candidates: Sequence[CandidateLaw], rows: WhitenedBalance, *, first: bool = False
    ) -> tuple[list[CandidateFit], list[CandidateFit]]:
        """Fit candidates with every parameter free; return them best first, and those with a fault.

        Parameters
        ----------
        candidates, rows
            The candidates, and the balance.
        first
            True along the measured motion, where the noise is unknown: that of the best then stands for it.

        Raises
        ------
        RsgenError
            No candidate gives a finite balance.
        """
        tried = [fit_candidate(candidate, rows, self.fixed) for candidate in candidates]
        fits, faulty = [fit for fit in tried if not fit.fault], [fit for fit in tried if fit.fault]
        if not fits:
            faults = " or ".join(sorted({fit.fault for fit in faulty}))
            raise RsgenError(f"ranking: no candidate can be fitted to the measured points: {faults}")
        noise = min(fit.chi_squared for fit in fits) / fits[0].residual.size if first else 1.0
        return sorted(fits, key=lambda fit: fit.bic(max(noise, 1e-300))), faulty


def competitors(
    candidates: Model | LawLike | Library | Sequence[LawLike | Library] | None,
) -> tuple[dict[str, tuple[Element, ...]], tuple[Term, ...], Model]:
    """Return the laws of the user by name, terms of the library, and a model with observation and mass."""
    linear = Model((make_element("linear-spring", "k*x"), make_element("linear-damper", "c*v")))
    if candidates is None:
        return {}, library_terms(), linear
    if isinstance(candidates, Model):
        return {OWN: candidates.elements}, library_terms(), candidates
    if isinstance(candidates, str) or not isinstance(candidates, Sequence):
        candidates = [candidates]
    laws: dict[str, tuple[Element, ...]] = {}
    terms, alone = list[Term](), set[str]()
    library = {term.source: term for term in library_terms()}
    for law in candidates:
        if isinstance(law, Library):
            terms += library.values()
            continue
        if isinstance(law, Law) and law in library:
            terms.append(library[law])
            continue
        elements = as_elements(law)
        name = getattr(law, "name", "") or law_text(elements)
        laws.setdefault(name, elements)
        if isinstance(law, Law) and law.title:
            alone.add(name)
    # laws of the library act where the elements of the user do
    sensors = max((element.across for elements in laws.values() for element in elements), default="")
    laws |= {name: _completed(laws[name], sensors) for name in laws if name in alone}
    if not laws and not terms:
        raise RsgenError("ranking: no candidate given; give formulas or laws, or none for all of rsgen.laws")
    return laws, tuple(dict.fromkeys(terms)), linear


def law_text(elements: Sequence[Element]) -> str:
    """Return the force of elements in rsgen's language, that between two sensors after what follows them."""
    forces = forces_by_motion(elements)
    parts = [with_equations(force) for sensors, force in forces.items() if not sensors and force]
    parts += [f"across {sensors}: {with_equations(force)}" for sensors, force in forces.items() if sensors]
    return "; ".join(parts)


def _completed(elements: tuple[Element, ...], sensors: str) -> tuple[Element, ...]:
    """Add the linear spring or damper that a library law lacks, between two sensors also the ground."""
    ground: tuple[Element, ...] = ()
    if sensors:
        joint = {symbol(name): symbol(f"{name}j") for name in "kc"}
        forces = ((element.name, element.force.xreplace(joint)) for element in elements)
        elements = tuple(make_element(name, force, across=sensors) for name, force in forces)
        ground = tuple(base_elements("").values())
    names = {name for element in elements for name in element.parameters}
    has = {state: any(element.force.has(symbol(state)) for element in elements) for state in "xv"}
    missing = [
        make_element(kind, f"{name if name not in names else name + '_'}*{state}", across=sensors)
        for kind, name, state in (
            ("linear-spring", "kj" if sensors else "k", "x"),
            ("linear-damper", "cj" if sensors else "c", "v"),
        )
        if not has[state]
    ]
    return (*ground, *elements, *missing)


def _shortlist(trials: Sequence[SumFit], most: int, alone: int) -> list[SumFit]:
    """Return the first ``most`` sums, with at least the first ``alone`` single laws among them."""
    single = [trial for trial in trials if len(trial.law.terms) <= 1][:alone]
    return [trial for trial in trials if trial not in single][: most - len(single)] + single


def hides_even(name: str, leader: str = "") -> bool:
    """Return True for a sum with an even force, or one that is even but for a linear spring.

    It has no fundamental of its own along a motion without a mean. The force is alone, with a cubic spring,
    which it imitates, or with or in place of the laws of the ``leader``.
    """
    even = {term.name for term in library_terms() if not (term.law.odd or term.search)}
    names = _term_names(name)
    others = names - even
    return bool(names & even) and (others <= {"cubic-spring"} or others <= _term_names(leader))


def _term_names(name: str) -> frozenset[str]:
    """Return the names of the laws in a sum."""
    return frozenset(name.split(" + "))


def _candidate_of(trial: SumFit, rows: WhitenedBalance, fixed: Mapping[str, float]) -> CandidateLaw:
    x, v, *_ = rows.motion_of(rows.sensors)
    size, speed = float(np.max(np.abs(x))), float(np.max(np.abs(v)))
    law = trial.law
    return CandidateLaw(
        law.name, law.elements, {**trial.values, **fixed}, law.limits(size, speed), law.dissipates
    )
