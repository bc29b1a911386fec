"""The result of a ranking: candidates, best first, and whether the best fits.

The best law fits if its misfit beyond noise, m^2 = total^2 - noise^2 from the differences of neighbouring
points (``_neighbour_noise``), is not significant by Fisher's z or below what sensors resolve.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from textwrap import wrap
from typing import Any

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.common.errors import listed
from rsgen.common.finding import Finding, Quantity, Severity, Verdict, quantities, reach_verdict
from rsgen.common.text_table import Printed, TextTable, aligned, lookup, short
from rsgen.common.tolerances import (
    MISFIT_NEGLIGIBLE,
    NEAR_STEPS,
    NOISE_RATIO_BY_CHANCE,
    RELATIVE_ERROR_DOUBTFUL,
    ROUND_OFF,
)
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import Model
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.formula.printing import write
from rsgen.identification.fitting.least_squares import Linearisation, Rules, descend
from rsgen.identification.identify import identify, identify_points
from rsgen.identification.ranking.balance import WhitenedBalance
from rsgen.identification.ranking.candidate_fit import (
    POINT_STRIDE,
    STRONG_EVIDENCE,
    CandidateFit,
    Round,
    lacks,
    whole_powers,
)
from rsgen.identification.ranking.library_sums import library_terms, terms_of, whole_name
from rsgen.identification.results import Identification, changed
from rsgen.law.element import forces_by_motion
from rsgen.law.memory import equations_of
from rsgen.law.numeric import ForceLaw

OWN = "the case's own law"
"""Name of the law of the case or model that is ranked, among the candidates."""

_ORDER = (
    "BIC: above the lowest; unseen: error on levels not fitted; order: first the simplest of those that tie "
    "with the best, then by BIC, last what predicts unseen levels worse than a simpler law; "
)
"""The order of a ranking, as tables say it."""

_LIBRARY = (
    " laws of the library and their sums (of two unless --terms-in-sum, in Python terms_in_sum, says "
    "otherwise) were compared once, and those that left least are listed, with the best single laws: to see "
    "another one, give it as a law of your own (in Python [law, rs.laws]); names: k and c of a sum are its "
    "linear spring and damper, and where the library has the same name for another parameter, that ends with "
    "_ here"
)
_GIVEN_ALONE = "the laws that were given were compared, not the library: in Python [law, rs.laws] are both"
"""Which laws competed, after their number, and the names of a ranking."""

_COLUMNS_OF_NAME = 43
"""Of the 80 of a terminal."""

_NOT_CONVERGED = "its fit did not converge, or ended at the limit of a parameter: it may fit better"


@dataclass(frozen=True, slots=True)
class Candidate:
    """One law of a ranking.

    Parameters
    ----------
    name
        Laws of the library that it adds to a linear spring and damper; or the name of the user's law.
    force
        The whole law in x and v, in rsgen's language, and the equations of its states.
    parameters
        Number of free parameters, with the mass.
    held_out_error
        Error of levels predicted from the others, relative to force and response [1]; NaN with one level.
    bic
        Bayesian information criterion, relative to the lowest; 6 and more is strong evidence against.
    tied
        True if the test does not separate it from the best.
    values
        Values of the parameters, SI, "m" if the mass is free: initial values, without intervals.
    own
        True for the law of the model, or of the case, that was ranked.
    fault
        Why it could not be fitted, "" if it was; such candidates are the last, without numbers.
    converged
        False if its fit ended before its least misfit, or at the limit of a parameter: it may fit better.
    """

    name: str
    force: str
    parameters: int
    held_out_error: float
    bic: float
    tied: bool
    values: Mapping[str, float]
    own: bool = False
    fault: str = ""
    converged: bool = True

    @property
    def label(self) -> str:
        """Name in sentences and tables, marked if it is the law of the ranked model."""
        return f"{OWN} ({self.name})" if self.own and self.name != OWN else self.name


def whole_label(candidate: Candidate, sensors: str) -> str:
    """Return the label of a candidate with every linear spring and damper that it holds."""
    return replace(candidate, name=whole_name(candidate.name, sensors)).label


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Ranking(Printed):
    """Candidate laws against one test.

    ``print(ranking)`` gives a table, ``ranking.best`` the identification of the best law,
    ``ranking["coulomb"]`` a candidate by name.

    Parameters
    ----------
    candidates
        Best first: of tied ones that of fewest parameters, then the other tied ones and all others by BIC;
        last those that predict levels worse than a law of fewer parameters does, and those not fitted.
    model
        The best law as a model for ``identify``.
    fits
        False if the misfit of the best is beyond noise, except at a few points that a finding counts, or if
        its identification is rejected, as with a negative mass.
    findings
        Errors and doubts of the best law's identification; the best law and those tied with it, or that none
        fits and where the misfit lies; limits of the ranking.
    noise
        Relative noise of force and response [1], from the differences of neighbours in frequency, or of
        periods of a multisine: whatever the law misses. That of ``best`` is what its law leaves.
    unexplained
        Misfit of the best beyond noise, relative to force and response [1]; 0 if it fits.
    surface
        The test; ``best`` identifies the best law on it.
    identified
        That identification, whose doubts are among the findings; None: made when ``best`` is asked for.
    library
        Number of laws of the library that competed, alone and in sums.
    """

    candidates: tuple[Candidate, ...]
    model: Model
    fits: bool
    findings: tuple[Finding, ...]
    noise: float
    unexplained: float
    surface: ResponseSurface | MultisineSpectra
    identified: Identification | None = None
    library: int = 0
    _best: list[Identification] = field(default_factory=list, init=False)

    @property
    def best(self) -> Identification:
        """The best law identified on the test, with intervals.

        Raises
        ------
        RsgenError
            As for ``identify``.
        """
        if not self._best:
            found = self.identified or self._identify(self.surface)
            # doubts about the choice of the law are doubts about its identification
            tied = tuple(f for f in self.findings if "tied" in f.names)
            against = (*self.verdict.decided_by, *tied) if self.fits else self.findings
            # what the ranking says is missing its best law does not say again
            missing = {f.code for f in against} & {"background-missing", "even-force-missing"}
            # nor what it doubts, where the law by itself is only warned of it
            doubled = [replace(f, severity="warning") for f in against if f.code == "mirror-image-fits"]
            kept = (f for f in found.findings if f.code not in missing and f not in doubled)
            if "background-missing" in missing:
                # nor that noise may hide one
                kept = (f for f in kept if f.code != "law-ambiguous" or "background" not in f.names)
            found = changed(found, findings=tuple(kept))
            # the ranking has its doubts already; a background of phase is a channel that is off
            said = {_topic(f) for f in found.findings}
            if any(f.code == "channels-delayed" for f in found.findings):
                against = tuple(f for f in against if f.names.get("kind") != "phase")
            against = tuple(f for f in against if _topic(f) not in said)
            # of the best law another ranking is no advice
            names = {"ranked": "best" if self.fits else "none fits"}
            codes = ("law-does-not-fit", "parts-disagree")
            own = (replace(f, names={**f.names, **names}) if f.code in codes else f for f in found.findings)
            self._best.append(replace(found, ranking=self, findings=(*against, *own)))
        return self._best[0]

    def _identify(self, surface: ResponseSurface | MultisineSpectra) -> Identification:
        """Identify the best law; one that does not fit without exact motions, which would not mend it."""
        if self.unexplained and isinstance(surface, ResponseSurface):
            return identify_points(surface, self.model, attained=inf)
        return identify(surface, self.model)

    @property
    def verdict(self) -> Verdict:
        """Verdict on the ranking: "rejected" if none fits, "doubtful" if the user must decide."""
        best = (f for f in self.findings if f.code in ("law-fits-best", "law-nearest"))
        return reach_verdict(self.findings, summary=next(best, None))

    def __getitem__(self, name: str) -> Candidate:
        """Candidate of this name.

        Raises
        ------
        RsgenError
            There is none; it is a ``KeyError``, too.
        """
        whole = {whole_name(candidate.name, self.model.sensors): candidate for candidate in self}
        known = {candidate.name: candidate for candidate in self}
        return lookup(name, whole | known if name in whole else known, "candidate")

    def __iter__(self) -> Iterator[Candidate]:
        return iter(self.candidates)

    def __len__(self) -> int:
        return len(self.candidates)

    @property
    def in_case(self) -> str:
        """The best law as a case file has it, its keys separated by commas."""
        parts = []
        for sensors, force in forces_by_motion(self.model.elements).items():
            if not force:
                continue
            keys = {"name": "joint" if sensors else "law", "across": sensors, "force": write(force)}
            keys |= {f"memory.{state}": rate for state, rate in equations_of(force).items()}
            written = (f'{key} = "{text}"' for key, text in keys.items() if text)
            parts.append(f"[[element]] {', '.join(written)}")
        return " and ".join(parts)

    def __repr__(self) -> str:
        """Return the table as text of 80 columns: the force of a law stands below it."""
        table = self.table
        lines, below = [["law", "par.", "BIC", "unseen", "verdict"]], [list[str]()]
        for candidate in self:
            first, *rest = wrap(candidate.label, _COLUMNS_OF_NAME)
            numbers = [str(self._columns[head](candidate)) for head in ("parameters", "BIC", "unseen")]
            verdict = "not fitted" if candidate.fault else self._standing(candidate).partition(" ")[0]
            lines.append([first, *numbers, verdict + "*" * (not candidate.converged)])
            text = "; ".join(filter(None, [candidate.force, candidate.fault]))
            below.append([*rest, *wrap(text, 80, initial_indent="    ", subsequent_indent="    ")])
        body = [line for parts in zip(aligned(lines), below, strict=True) for line in (parts[0], *parts[1])]
        body += [f"* {_NOT_CONVERGED}"] * any(not one.converged for one in self)
        return "\n".join([table.caption, *body, *table.notes])

    def _standing(self, one: Candidate) -> str:
        """Return what a candidate is next to the best one."""
        if one.fault:
            return f"not fitted: {one.fault}"
        if one is self.candidates[0]:
            return "best"
        return "ties with the best" if one.tied else "worse"

    @property
    def _columns(self) -> dict[str, Callable[[Candidate], Any]]:
        """The heads of the table, each with its cell of a candidate."""
        return {
            "law": lambda one: whole_label(one, self.model.sensors),
            "parameters": lambda one: one.parameters,
            "BIC": lambda one: short(one.bic, 4),
            "unseen": lambda one: (
                f"{short(100 * one.held_out_error, 2)} %" if one.held_out_error >= 0 else ""
            ),
            "verdict": lambda one: self._standing(one) + f"; {_NOT_CONVERGED}" * (not one.converged),
            "force": lambda one: one.force,
        }

    @property
    def table(self) -> TextTable:
        """The table of pages and notebooks."""
        columns = self._columns
        rows = tuple(tuple(cell(candidate) for cell in columns.values()) for candidate in self)
        fits = "fits" if self.fits else f"none fits, unexplained {self.unexplained:.2g}"
        verdict = self.verdict
        if verdict.decided_by:
            fits += f"; {verdict.state}: {', '.join(finding.code for finding in verdict.decided_by)}"
        best = whole_name(self.candidates[0].name, self.model.sensors)
        judged = "periods" if isinstance(self.surface, MultisineSpectra) else "neighbouring points"
        caption = f"best: {best} ({fits}), noise {short(100 * self.noise, 2)} % by {judged}"
        competed = f"{self.library}{_LIBRARY}" if self.library else _GIVEN_ALONE
        return TextTable(tuple(columns), rows, caption=caption, notes=(_ORDER + competed,))


def _topic(finding: Finding) -> tuple[str, ...]:
    """Return what two findings have in common that say the same."""
    return finding.code, finding.severity, finding.parameter, finding.names.get("by", "")


# ----------------------------------------------------------------------------
# Assessment of the best law: its misfit beyond noise, and where it lies, as findings.

_MIN_POINTS_A_PARAMETER = 6
"""With fewer a ranking says so."""


def assess_best(
    current: Round, best: CandidateFit, candidates: Sequence[Candidate], doubts: Sequence[Finding]
) -> tuple[bool, float, tuple[Finding, ...]]:
    """Decide if the best law fits, and state the findings of a ranking.

    Parameters
    ----------
    current
        The last round.
    best
        Fit of the first candidate.
    candidates
        Best first.
    doubts
        Doubts and errors of its identification.

    Returns
    -------
    fits, unexplained, findings
        Whether it fits, its misfit beyond noise (relative), and the findings.
    """
    left, named = current.misfit(best), whole_label(candidates[0], current.rows.sensors)
    impossible = [finding for finding in doubts if finding.severity == "error"]
    doubts = [finding for finding in doubts if finding.severity != "error"]
    systematic = any(finding.code == "law-does-not-fit" for finding in doubts)
    doubts = [*doubts, *_overfitting_findings(current.relative(best.residual), candidates[0])]
    findings = list(impossible)
    if left.unexplained:
        numbers = {"unexplained": Quantity(left.unexplained), "noise": Quantity(current.noise), **left.where}
        findings.append(Finding("no-law-fits", "error", numbers=numbers, names={"law": named}))
    else:
        sure = left.known and not impossible and all(finding.severity != "doubt" for finding in doubts)
        findings.append(
            _best_law_finding(candidates, current, known=left.known, sure=sure, systematic=systematic)
        )
    findings += doubts
    # what the identification says of them is not said again
    said = [finding.numbers.get("level") for finding in doubts if finding.code == "points-excluded"]
    findings += [one for one in current.exclusions(best) if one.numbers.get("level") not in said]
    findings += _sample_findings(current, candidates[0].parameters)
    fits = left.known and not impossible and not left.unexplained
    return fits, left.unexplained, tuple(findings)


def misfit_of_rows(found: Identification, current: Round) -> float:
    """Return the misfit of a fit over the rows of a round, among which harmonics may have less noise."""
    if found.fit is None:
        return found.residual
    regression = found.fit.regression
    rows = np.count_nonzero(regression.used) * np.count_nonzero(current.rows.compared)
    return found.residual * float(np.sqrt(regression.freedom / rows))


def order_candidates(
    bic: Sequence[float], error: Sequence[float], count: Sequence[int]
) -> tuple[list[int], float, list[bool]]:
    """Order candidates by BIC; the first is that of fewest parameters among the tied ones.

    Candidates tie whose BIC is within ``STRONG_EVIDENCE`` of the lowest. Those that predict held-out levels
    worse than one of fewer parameters overfit, tie with none, and come last.

    Parameters
    ----------
    bic, error, count
        Of each candidate: its criterion, the error of predicted levels (NaN with one level), parameters.

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
    every = list(zip(bic, overfitted, strict=True))
    lowest = min(value for value, last in every if not last)
    tied = [value - lowest < STRONG_EVIDENCE and not last for value, last in every]
    best = min(np.flatnonzero(tied).tolist(), key=lambda i: (count[i], bic[i]))
    by_bic = sorted(range(len(bic)), key=lambda i: (i != best, not tied[i], overfitted[i], bic[i]))
    return by_bic, lowest, tied


def values_of_same(
    one: CandidateFit, other: CandidateFit, rows: WhitenedBalance
) -> Mapping[str, float] | None:
    """Return the values with which a candidate is another one; None where they are two laws.

    They are one law by their normal forms, or where its values can be fitted to the force of the other along
    the motions: of two notations that leaves round-off, of two laws that the test cannot separate far more.
    """
    law, wanted = one.candidate.law, other.candidate.law
    if len(law.parameters) != len(wanted.parameters) or len(law.parts) != len(wanted.parts):
        return None
    some, known = slice(None, None, POINT_STRIDE), rows.trajectories[: len(law.parts)]
    motions, step = [(x[some], v[some], a[some]) for x, v, a, _ in known], known[0][3][some]
    alike = np.broadcast_arrays

    def along(which: ForceLaw, values: Array) -> Array:
        """Return the force, then its slopes (parts, motions, samples, 1 + p)."""
        parts = zip(motions, which.sample_parts(motions, step, values), strict=True)
        return np.stack([np.stack(alike(m[0], s.force, *s.by_parameter)[1:], axis=-1) for m, s in parts])

    force = along(wanted, wanted.ordered(other.candidate.values))[..., :1]
    # a joint may carry little of the force: along each motion by itself
    least = np.sqrt(ROUND_OFF) * np.max(np.abs(force), axis=(1, 2, 3), keepdims=True)

    def linearise(values: Array, nuisance: Array) -> Linearisation:
        rest = along(law, values)
        rest[..., :1] = force - rest[..., :1]
        rest = (rest / least).reshape(len(nuisance), -1, rest.shape[-1])
        return Linearisation(rest[:, :, 0], np.zeros((*rest.shape[:2], 0)), rest[:, :, 1:])

    none = np.zeros((force.shape[0] * force.shape[1], 0))
    rules = Rules(steps=NEAR_STEPS, linear=law.linear)
    found, _, line, _ = descend(linearise, law.ordered(one.candidate.values), none, rules)
    if np.max(np.abs(line.residual)) <= 1:
        return {**law.named(found), "m": other.candidate.values["m"]}
    return one.candidate.values if have_same_terms(one, other) else None


def have_same_terms(one: CandidateFit, other: CandidateFit) -> bool:
    """Return True if two candidates are one law by their normal forms, whatever the names of parameters."""
    first, second = (
        {sensors: terms_of(force) for sensors, force in fit.candidate.forces.items()} for fit in (one, other)
    )
    return first == second


def name_powers(
    findings: tuple[Finding, ...], fits: Sequence[CandidateFit], candidates: Sequence[Candidate]
) -> tuple[Finding, ...]:
    """Name by ``power``, with the best law, the worse ones that are it with a whole number for a power."""
    same = [
        f"{one.label} with {name} = {number}"
        for fit, one in zip(fits, candidates, strict=False)
        for name, number in whole_powers(fit)
        if abs(one.values[name] - number) < RELATIVE_ERROR_DOUBTFUL
        if lacks(fits[0], fit, (), [(name, number)])
    ]
    best = {"law-fits-best", "law-nearest"} if same else set()
    names = {"power": listed(same)}
    return tuple(replace(f, names={**f.names, **names}) if f.code in best else f for f in findings)


def undetermined_values(
    found: Identification, best: CandidateFit, near: Sequence[CandidateFit], rows: WhitenedBalance
) -> tuple[list[str], list[str]]:
    """Return the parameters that may be zero, and others of which fundamentals do not show the value.

    A gap hardly reached and the stiffness behind it are confounded, or bounded to one side: the stop may be
    zero only where one of the candidates ``near`` the best does without it. Of an even force and a cubic one
    fundamentals determine a combination alone.
    """
    doubted = {e.name: e.finding.code for e in found if e.finding and "mirror" not in e.finding.names}
    within = {e.name for e in found if e.interval[0] <= 0 <= e.interval[1]}
    zero = [name for name, code in doubted.items() if name in within and code != "confounded"]
    rest = [name for name in doubted if name not in zero]
    if rows.odd_alone and best.candidate.law.even and len(zero) > 1:
        zero = [name for name in zero if doubted[name] == "no-effect"]
    if any(lacks(fit, best, rest) for fit in near):
        return [*zero, *rest], []
    return zero, rest if rows.odd_alone else []


def symmetry_doubts(
    current: Round,
    ordered: Sequence[CandidateFit],
    candidates: Sequence[Candidate],
    found: Identification | None,
) -> list[Finding]:
    """Doubt a law that fundamentals do not tell from one as simple that is odd where it is not, or not odd.

    A stop on one side has the odd part of stops on both sides of half the stiffness. Where they do not tie,
    as along the motion of another law, the identification of the best says whether the other fits as well.
    """
    first = candidates[0]
    other = [
        one.label
        for fit, one in zip(ordered, candidates, strict=False)
        if one.tied and one.parameters <= first.parameters
        if fit.candidate.law.odd != ordered[0].candidate.law.odd
    ]
    if current.misfit(ordered[0]).unexplained or not current.rows.odd_alone:
        return []
    if not other:
        said = found.findings if found else ()
        warned = (f for f in said if f.severity == "warning" and f.code == "mirror-image-fits")
        return [replace(f, severity="doubt") for f in warned if "side" in f.names]
    return [Finding("even-terms-not-seen", "doubt", names={"law": first.label, "other": listed(other)})]


def _overfitting_findings(fitted: float, first: Candidate) -> list[Finding]:
    """Find that the first candidate predicts levels clearly worse than it fits them: overfitting."""
    if not first.held_out_error > NOISE_RATIO_BY_CHANCE * max(fitted, MISFIT_NEGLIGIBLE):
        return []
    numbers = quantities(predicted=first.held_out_error, fitted=fitted)
    severity: Severity = "doubt" if first.held_out_error > RELATIVE_ERROR_DOUBTFUL else "warning"
    return [Finding("levels-predicted-worse", severity, numbers=numbers)]


def _sample_findings(current: Round, parameters: int) -> list[Finding]:
    """Find too few points or levels for a ranking."""
    found, count = [], len(current.rows)
    if count < _MIN_POINTS_A_PARAMETER * parameters:
        numbers = quantities(**{current.counted: count}, parameters=parameters)
        found.append(Finding("ranking-few-points", "warning", numbers=numbers))
    if len(np.unique(current.rows.level)) < 2:
        found.append(Finding("ranking-few-points", "warning", numbers=quantities(levels=1)))
    return found


def _best_law_finding(
    candidates: Sequence[Candidate], current: Round, *, known: bool, sure: bool, systematic: bool = False
) -> Finding:
    """State the best law and those that the test does not separate from it."""
    tied = [candidate.name for candidate in candidates if candidate.tied]
    counted = {current.counted: len(current.rows)}
    numbers = quantities(**counted, noise=current.noise, least=MISFIT_NEGLIGIBLE)
    label = {candidate.name: candidate.label for candidate in candidates}
    whole = next(whole_label(one, current.rows.sensors) for one in candidates if one.name == tied[0])
    law = {"law": whole} | ({} if known else {"noise": "not known"})
    # as the joint polynomial contains the cubic spring, a law of the library may contain another
    terms = {term.name: sympy.Add.make_args(term.source.added) for term in library_terms()}
    parts = {name: {part for law in name.split(" + ") for part in terms.get(law, (law,))} for name in tied}
    even = {part for term in library_terms() if term.law.even for part in terms[term.name]}
    # a sum that contains another tied law is not named, but for an even force, which a cubic spring imitates
    hides = current.rows.odd_alone
    other = [
        name
        for name in tied[1:]
        if not any(
            parts[less] < parts[name]
            and not (hides and less == "cubic-spring" and parts[name] - parts[less] <= even)
            for less in tied
        )
    ]
    law |= {"left": "systematic"} if sure and systematic else {}
    law |= {"tied": listed([label[name] for name in other])} if other else {}
    return Finding("law-fits-best" if sure else "law-nearest", "info", numbers=numbers, names=law)
