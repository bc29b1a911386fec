"""The result of a ranking: candidates, best first, whether even the best fits, and where it does not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, Quantity, Severity, Verdict, reach_verdict
from rsgen.common.text_table import Printed, TextTable, data_frame, lookup, short
from rsgen.common.tolerances import EXCESS, FEW, LARGE, NOTICEABLE
from rsgen.data.oscillator import Model
from rsgen.data.surface import ResponseSurface
from rsgen.identification.fitting.observed import beyond_chance
from rsgen.identification.fitting.points import Points
from rsgen.identification.identify import identify
from rsgen.identification.ranking.balance import Rows, library_terms, terms_of
from rsgen.identification.ranking.fitting import Fitted, Guess
from rsgen.identification.ranking.reference import neighbour_noise, outlying
from rsgen.identification.results import Identification
from rsgen.identification.results.estimates import phase_findings
from rsgen.law.numeric import compile_law

OWN = "the case's own law"
"""Name of the law of the case or model that is ranked, among the candidates."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One law of a ranking.

    Parameters
    ----------
    name
        Laws of the library that it adds to a linear spring and damper; or as it was given.
    force
        The whole law in x and v, in rsgen's language, and the equations of its states.
    parameters
        How many, the mass included where it is free.
    held_out_error
        Error of levels predicted from the others, relative to force and response [1]; NaN with one level.
    bic
        Bayesian information criterion, relative to the lowest; 6 and more is strong evidence against.
    tied
        True where the test does not separate it from the best.
    values
        Of the parameters, SI, "m" where the mass is free: good to start from, without intervals.
    own
        True for the law of the model, or of the case, that was ranked.
    """

    name: str
    force: str
    parameters: int
    held_out_error: float
    bic: float
    tied: bool
    values: Mapping[str, float]
    own: bool = False

    @property
    def label(self) -> str:
        """Its name in sentences and tables; a law of the library that is the ranked model's says so."""
        return f"{OWN} ({self.name})" if self.own and self.name != OWN else self.name


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Ranking(Printed):
    """Candidate laws against one test.

    ``print(ranking)`` gives a table, ``ranking.best`` the identification of the best law,
    ``ranking["coulomb"]`` a candidate by name.

    Parameters
    ----------
    candidates
        Best first: those that tie by their number of parameters, the others by BIC; behind them those that
        predict levels from the others worse than a law of fewer parameters does.
    model
        The best law as a model for ``identify``.
    fits
        False where even the best leaves more than noise, except at a few points that a finding counts, or
        where its mass is negative or the structure would feed energy into the exciter.
    findings
        What no passive structure does; the best law, and those the test does not separate from it, or that
        none fits and where; what makes the ranking less certain.
    noise
        Relative noise of force and response on which the comparison rests [1]: what neighbours in frequency
        do not share.
    unexplained
        What even the best leaves beyond noise, relative to force and response [1]; 0 where it fits.
    surface
        The test; ``best`` identifies the best law on it.
    """

    candidates: tuple[Candidate, ...]
    model: Model
    fits: bool
    findings: tuple[Finding, ...]
    noise: float
    unexplained: float
    surface: ResponseSurface | None = None
    _best: list[Identification] = field(default_factory=list, init=False)

    @property
    def best(self) -> Identification:
        """The best law identified on the test, with intervals; computed when it is first asked for.

        Raises
        ------
        RsgenError
            As for ``identify``.
        """
        if self.surface is None:
            raise RsgenError("ranking.best: the ranking was made without its surface")
        if not self._best:
            found = identify(self.surface, self.model)
            # what speaks against the law chosen speaks against its identification
            against = self.verdict.decided_by if self.fits else self.findings
            findings = (*against, *found.findings)
            self._best.append(replace(found, ranking=self, findings=findings))
        return self._best[0]

    @property
    def verdict(self) -> Verdict:
        """What the ranking is worth: "rejected" where none fits, "doubtful" where one has to look first."""
        best = (f for f in self.findings if f.code in ("law-fits-best", "law-nearest"))
        return reach_verdict(self.findings, summary=next(best, None))

    def __getitem__(self, name: str) -> Candidate:
        """Candidate of this name.

        Raises
        ------
        RsgenError
            There is none; it is a ``KeyError``, too.
        """
        return lookup(name, {each.name: each for each in self.candidates}, "candidate")

    def __iter__(self) -> Iterator[Candidate]:
        return iter(self.candidates)

    def __len__(self) -> int:
        return len(self.candidates)

    def to_frame(self) -> Any:
        """Give the candidates as a ``pandas.DataFrame``, best first.

        Raises
        ------
        RsgenError
            pandas is not installed.
        """
        names = ("name", "force", "parameters", "bic", "held_out_error", "tied")
        return data_frame({name: [getattr(each, name) for each in self] for name in names}, "name")

    def _table(self) -> TextTable:
        rows = tuple(
            (
                each.label,
                each.parameters,
                short(each.bic, 4),
                short(each.held_out_error, 2),
                "best" if each is self.candidates[0] else "tied" if each.tied else "",
                each.force,
            )
            for each in self
        )
        fits = "fits" if self.fits else f"none fits, unexplained {self.unexplained:.2g}"
        verdict = self.verdict
        if verdict.decided_by:
            fits += f"; {verdict.state}: {', '.join(finding.code for finding in verdict.decided_by)}"
        heads = ("law", "parameters", "BIC", "held-out error", "verdict", "force")
        return TextTable(
            heads, rows, caption=f"best: {self.candidates[0].name} ({fits}), noise {self.noise:.2g}"
        )


# ----------------------------------------------------------------------------
# Does even the best law fit? What it leaves beyond noise, and where, as findings.

_FUNDAMENTAL = 5e-3
"""A law that leaves less of force and response fits: sensors are calibrated no better."""

_HARMONIC_SHARE = 0.1
"""A law fits a higher harmonic of which it leaves less, or less than the least noise of a ranking."""

_FED = 0.5
"""A damper that gives back this share of what the law dissipates stands against another one: such a pair
follows any curve, and a structure at rest has no such dampers."""

_CANCELLED = 0.2
"""Two terms whose sum is smaller than this share of the larger cancel each other."""

_POINTS_A_PARAMETER = 6
"""Fewer points a parameter are few."""

_MOST, _WHOLE = 0.6, 0.75
"""Share of what is not explained that lies in a range, and most of the tested range that it may take."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """Whether the best law fits, what is unexplained (relative), and the findings."""

    fits: bool
    unexplained: float
    findings: tuple[Finding, ...]


def judge(
    best: Fitted,
    points: Points,
    noise: Array,
    candidates: Sequence[Candidate],
    aside: int,
    *,
    feeds: bool,
    doubts: Sequence[Finding],
) -> Judgement:
    """Judge a ranking.

    Parameters
    ----------
    best
        The first of the candidates.
    points
        Those that took part.
    noise
        (H+1,) relative, of mean, fundamental and harmonics.
    candidates
        Best first.
    aside
        Points that no law follows and that took no part.
    feeds
        True where the structure would work on the exciter over most cycles.
    doubts
        What speaks against the best by itself.
    """
    out = outlying(best, noise)
    pairs = points.neighbours
    pairs = pairs[~out[pairs].any(axis=1)]
    total, apart = neighbour_noise(best.residual, pairs, best.compared)
    shared = np.nan_to_num(np.maximum(total**2 - apart**2, 0.0))
    left = noise * np.sqrt(shared)
    correlation = np.nan_to_num(shared / np.maximum(total**2, 1e-300))
    # real and imaginary part; a mean is one number
    counted = np.where(np.arange(len(left)) == 0, 1, 2) * len(pairs)
    missing = beyond_chance(correlation, counted) & (left > _limits(points, len(left)))
    unexplained = float(np.sqrt(np.sum(left[missing] ** 2)))
    absurd = _absurd(candidates[0], feeds)
    doubts = [*doubts, *_flexible(best, noise, candidates)]
    findings = list(absurd)
    if missing.any():
        # nothing is to be confirmed
        doubts = [finding for finding in doubts if finding.code != "law-unconfirmed"]
        numbers = {"unexplained": Quantity(unexplained), "noise": Quantity(float(noise[1]))}
        numbers |= _where(best, points, pairs, missing, left)
        findings.append(Finding("no-law-fits", "error", numbers=numbers, names={"law": candidates[0].label}))
    else:
        sure = len(pairs) > 0 and not absurd and all(finding.severity != "doubt" for finding in doubts)
        findings += _fitting(candidates, float(noise[1]), points, sure=sure)
    findings += doubts
    findings += _uncertain(points, candidates[0].parameters, aside + int(np.count_nonzero(out)), aside)
    return Judgement(len(pairs) > 0 and not absurd and not missing.any(), unexplained, tuple(findings))


def _limits(points: Points, count: int) -> Array:
    """(count,) what a law that fits may leave of mean, fundamental and harmonics, relative."""
    known = min(count, points.harmonics.shape[1])
    size = np.zeros(count)
    relative = np.abs(points.harmonics[:, :known]) ** 2 / points.amplitude[:, None] ** 2
    size[:known] = np.sqrt(np.mean(relative, axis=0))
    limits = np.maximum(NOTICEABLE, _HARMONIC_SHARE * size)
    limits[:2] = _FUNDAMENTAL
    return np.asarray(limits)


def _absurd(best: Candidate, feeds: bool) -> list[Finding]:
    """Find what no passive structure does."""
    found = []
    mass = best.values.get("m", 1.0)
    if mass <= 0:
        found.append(Finding("mass-negative", "error", "m", {"mass": Quantity(mass, "kg")}))
    if feeds:
        found.append(Finding("structure-feeds-exciter", "error"))
    return found


def is_same(one: Fitted, other: Fitted, rows: Rows) -> bool:
    """Whether two candidates are one law: by their normal forms, or by forces where parameters differ."""
    if len(one.guess.values) != len(other.guess.values):
        return False
    if terms_of(one.guess.force) == terms_of(other.guess.force):
        return True
    x, v, a, step = (part[::7] for part in rows.trajectory)
    forces = []
    for fit in (one, other):
        law = fit.guess.law
        values = law.ordered(fit.guess.values)
        forces.append(law.sample(x, v, a, step, values).force)
    apart = float(np.max(np.abs(forces[0] - forces[1])))
    return apart <= NOTICEABLE * float(np.max(np.abs(forces[1])))


def implausible(fitted: Fitted, rows: Rows) -> list[Finding]:
    """Find what speaks against a candidate by itself, however well it fits."""
    guess, found = fitted.guess, []
    for name, (low, high) in guess.limits.items():
        value = guess.values[name]
        if value in (low, high):
            numbers = {"value": Quantity(value)}
            found.append(Finding("law-at-limit", "doubt", name, numbers, {"law": guess.name}))
    found += _cancelling(guess, rows)
    return found + [finding for finding in phase_findings(guess.background) if finding.severity == "doubt"]


def _cancelling(guess: Guess, rows: Rows) -> list[Finding]:
    """Find a damper that feeds energy against another, and two terms that nearly take each other away."""
    names = [element.name for element in guess.elements]
    if len(names) < 2:
        return []
    x, v, a, step = rows.trajectory
    # every point counts the same, whatever its level
    level = np.sqrt(np.mean((x * v) ** 2, axis=1))[:, None]
    forces = []
    for element in guess.elements:
        law = compile_law(element.force)
        values = law.ordered(guess.values)
        forces.append(law.sample(x, v, a, step, values).force / level)
    work = np.array([float(np.mean(force * v)) for force in forces])
    size = [float(np.sqrt(np.mean(force**2))) for force in forces]
    sums = {
        (i, j): float(np.sqrt(np.mean((forces[i] + forces[j]) ** 2))) / max(size[i], size[j], 1e-300)
        for i, j in combinations(range(len(names)), 2)
    }
    least = min(sums, key=lambda pair: sums[pair])
    fed = float(np.sum(np.maximum(-work, 0.0)) / max(float(work.sum()), 1e-300))
    if work.sum() > 0 and fed > _FED:
        one, other = names[int(np.argmin(work))], names[int(np.argmax(work))]
        numbers = {"share": Quantity(fed)}
        return [Finding("damping-feeds-energy", "doubt", "", numbers, {"law": one, "other": other})]
    if sums[least] < _CANCELLED:
        one, other = (names[i] for i in least)
        numbers = {"share": Quantity(sums[least])}
        return [Finding("terms-cancel", "doubt", "", numbers, {"law": one, "other": other})]
    return []


def _flexible(best: Fitted, noise: Array, candidates: Sequence[Candidate]) -> list[Finding]:
    """Find where the first predicts levels clearly worse than it fits them, or than others predict them."""
    scale = np.repeat(noise, 2)[1:]
    fitted = float(np.sqrt(np.mean((best.residual * scale)[:, best.compared] ** 2)))
    first = candidates[0]
    if not first.held_out_error > EXCESS * max(fitted, NOTICEABLE):
        return []
    numbers = {"predicted": Quantity(first.held_out_error), "fitted": Quantity(fitted)}
    names = dict[str, str]()
    better = [
        candidate
        for candidate in candidates
        if (candidate.tied or candidate.parameters < first.parameters)
        and EXCESS * candidate.held_out_error < first.held_out_error
    ]
    if better:
        least = min(better, key=lambda candidate: candidate.held_out_error)
        numbers["other"], names["law"] = Quantity(least.held_out_error), least.label
    severity: Severity = "doubt" if first.held_out_error > LARGE else "warning"
    return [Finding("levels-predicted-worse", severity, numbers=numbers, names=names)]


def _uncertain(points: Points, parameters: int, out: int, aside: int) -> list[Finding]:
    """Find what makes a ranking less certain than it looks."""
    found = []
    if out:
        numbers = {"aside": Quantity(out), "points": Quantity(len(points) + aside)}
        many = out > FEW * (len(points) + aside)
        severity: Severity = "doubt" if many else "warning"
        found.append(Finding("points-set-aside", severity, numbers=numbers, names={"by": "ranking"}))
    if len(points) < _POINTS_A_PARAMETER * parameters:
        numbers = {"points": Quantity(len(points)), "parameters": Quantity(parameters)}
        found.append(Finding("ranking-few-points", "warning", numbers=numbers))
    if len(np.unique(points.level)) < 2:
        found.append(Finding("ranking-few-points", "warning", numbers={"levels": Quantity(1)}))
    return found


def _fitting(candidates: Sequence[Candidate], noise: float, points: Points, *, sure: bool) -> list[Finding]:
    """State the best law and those that the test does not separate from it."""
    tied = [candidate.name for candidate in candidates if candidate.tied]
    best, rest = tied[0], tied[1:]
    numbers = {"points": Quantity(len(points)), "noise": Quantity(noise), "least": Quantity(NOTICEABLE)}
    label = {candidate.name: candidate.label for candidate in candidates}
    law = {"law": label[best]} | ({} if len(points.neighbours) else {"noise": "not known"})
    found = [Finding("law-fits-best" if sure else "law-nearest", "info", numbers=numbers, names=law)]
    inside = set(best.split(" + "))
    found += [
        Finding("laws-equal", "info", names={"law": term.name, "same": " and ".join(term.how.same)})
        for term in library_terms()
        if term.how.same and term.name in inside
    ]
    more = [name for name in rest if inside < set(name.split(" + "))]
    other = [name for name in rest if name not in more]
    # what contains another tied law adds nothing
    other = [
        name for name in other if not any(set(less.split(" + ")) < set(name.split(" + ")) for less in other)
    ]
    tied_to = {
        kind: "; ".join(map(label.__getitem__, names))
        for kind, names in (("laws", other), ("larger", more))
        if names
    }
    return [*found, Finding("laws-not-separated", "info", names=tied_to)] if tied_to else found


def _where(
    best: Fitted, points: Points, pairs: NDArray[np.intp], missing: NDArray[np.bool_], left: Array
) -> dict[str, Quantity]:
    """Find in which harmonics, at which frequencies and amplitudes the unexplained part lies."""
    numbers = {f"harmonic {h}": Quantity(float(left[h])) for h in np.flatnonzero(missing).tolist()}
    orders = np.repeat(np.arange(len(missing)), 2)[1:]
    rows = best.compared & missing[orders]
    # neighbours do not share noise: their product is what the law leaves
    power = np.sum(best.residual[pairs[:, 0]][:, rows] * best.residual[pairs[:, 1]][:, rows], axis=1)
    for name, values, unit in (
        ("frequency", points.omega / (2 * np.pi), "Hz"),
        ("amplitude", points.amplitude, "m"),
    ):
        span = _range(values[pairs].mean(axis=1), power)
        if span is not None:
            numbers |= {f"{name} from": Quantity(span[0], unit), f"{name} to": Quantity(span[1], unit)}
    return numbers


def _range(values: Array, power: Array) -> tuple[float, float] | None:
    """Shortest range with most of the power; None where it is nearly the whole one."""
    order = np.argsort(values, kind="stable")
    ranked, sums = values[order], np.concatenate([[0.0], np.cumsum(np.maximum(power[order], 0.0))])
    best: tuple[float, float] | None = None
    for i in range(len(ranked)):
        j = int(np.searchsorted(sums, sums[i] + _MOST * sums[-1]))
        if j <= len(ranked) and (best is None or ranked[j - 1] - ranked[i] < best[1] - best[0]):
            best = (float(ranked[i]), float(ranked[j - 1]))
    if best is None or best[1] - best[0] > _WHOLE * (ranked[-1] - ranked[0]):
        return None
    return best
