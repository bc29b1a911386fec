"""The result of a ranking: candidates, best first, with findings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, Verdict, reach_verdict
from rsgen.common.text_table import Printed, TextTable, data_frame, lookup, short
from rsgen.data.oscillator import Model
from rsgen.data.surface import ResponseSurface
from rsgen.identification.identify import identify
from rsgen.identification.results import Identification

__all__ = ["OWN", "Candidate", "Ranking"]

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
        Best first: those that tie by their number of parameters, the others by BIC.
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
        best = (
            f for f in self.findings if f.code in ("law-fits-best", "law-nearest", "law-nearest-unproved")
        )
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
