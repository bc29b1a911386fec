"""What a comparison of laws hands on: candidates, best first, and a verdict in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rsgen.oscillator import Model

__all__ = ["Candidate", "Ranking"]


@dataclass(frozen=True, slots=True)
class Candidate:
    """One law of a ranking.

    Parameters
    ----------
    name
        Laws of the library in it; all have a linear spring and a viscous damper.
    force
        The whole law in x and v, in rsgen's language.
    parameters
        How many, the mass included where it is free.
    held_out_error
        Error of levels predicted from the others, relative to force and response [1]; NaN with one level.
    bic
        Bayesian information criterion, relative to the lowest; 6 and more is strong evidence against.
    tied
        True where the test does not tell it from the best.
    values
        Of the parameters, SI, "m" where the mass is free: good to start from, without intervals.
    """

    name: str
    force: str
    parameters: int
    held_out_error: float
    bic: float
    tied: bool
    values: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Ranking:
    """Candidate laws against one test.

    Parameters
    ----------
    candidates
        Best first: those that tie by their number of parameters, the others by BIC.
    model
        The best law as a model for ``identify``.
    fits
        False where even the best leaves more than noise, beside a few points that the verdict counts, or
        where its mass is negative or the structure would feed energy into the exciter.
    verdict
        Sentences: what no passive structure does; the best, what cannot be told from it, or that none fits
        and where; what makes the ranking less certain.
    noise
        Relative noise of force and response on which the comparison rests [1]: what neighbours in frequency
        do not share.
    unexplained
        What even the best leaves beyond noise, relative to force and response [1]; 0 where it fits.
    """

    candidates: tuple[Candidate, ...]
    model: Model
    fits: bool
    verdict: tuple[str, ...]
    noise: float
    unexplained: float
