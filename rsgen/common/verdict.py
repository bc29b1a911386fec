"""The verdict on a result, from the severities of its findings and the comparison with the truth."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, TypedDict

from rsgen.common.finding import Finding

__all__ = ["STATES", "USABLE", "State", "StatedVerdict", "Verdict", "reach_verdict", "verdict_lines"]

State = Literal["accepted", "missed", "identified", "doubtful", "rejected"]

STATES: tuple[State, ...] = ("accepted", "identified", "missed", "doubtful", "rejected")
"""From the best to the worst; in a result the worst that holds is its state."""

USABLE: tuple[State, ...] = ("accepted", "identified")
"""States in which a program may go on with the numbers before anybody has looked."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a result is worth.

    Parameters
    ----------
    state
        "rejected": a finding says that the result is wrong or means nothing; "doubtful": a finding has to be
        looked into first; "missed": an estimate is outside tolerance; "accepted": all judged estimates are
        within tolerance; "identified": nothing speaks against the result, and nothing was judged.
    decided_by
        The findings that decided, the gravest first; empty unless the state is "rejected" or "doubtful".
    summary
        What was judged, or else what was identified: the numbers of a headline; None where nobody said.
    """

    state: State
    decided_by: tuple[Finding, ...] = ()
    summary: Finding | None = None

    @property
    def usable(self) -> bool:
        """True where a program may go on with the numbers before anybody has looked."""
        return self.state in USABLE

    def __str__(self) -> str:
        """Give the state with the codes that decided."""
        codes = ", ".join(dict.fromkeys(finding.code for finding in self.decided_by))
        return f"{self.state} ({codes})" if codes else self.state


def reach_verdict(
    findings: Iterable[Finding], within_tolerance: bool | None = None, summary: Finding | None = None
) -> Verdict:
    """Reach the verdict on a result.

    Parameters
    ----------
    findings
        All of the result: about the test, the fit, its parameters, and the levels held out.
    within_tolerance
        Whether all judged estimates are; None where nothing was judged.
    summary
        As in ``Verdict``.

    Examples
    --------
    >>> reach_verdict([Finding("law-does-not-fit", "error")], within_tolerance=True).state
    'rejected'
    >>> reach_verdict([Finding("points-set-aside", "warning")], within_tolerance=True).state
    'accepted'
    """
    findings = tuple(findings)
    errors = tuple(finding for finding in findings if finding.severity == "error")
    doubts = tuple(finding for finding in findings if finding.severity == "doubt")
    if errors:
        return Verdict("rejected", errors + doubts, summary)
    if doubts:
        return Verdict("doubtful", doubts, summary)
    if within_tolerance is None:
        return Verdict("identified", summary=summary)
    return Verdict("accepted" if within_tolerance else "missed", summary=summary)


class StatedVerdict(TypedDict):
    """A verdict in words: the entry "verdict" of a result.json.

    ``state`` is one of ``STATES``; ``headline`` says it in a line; ``decided_by`` are the
    findings that decided, as objects, gravest first; ``sentences`` and ``next_steps`` have one text for each
    of them: what it is, and what to do about it ("" where nothing is known).
    """

    state: State
    headline: str
    decided_by: list[dict[str, Any]]
    sentences: list[str]
    next_steps: list[str]


def verdict_lines(stated: StatedVerdict) -> list[str]:
    """Give the headline and, indented, what decided with what to do about it."""
    lines = [stated["headline"]]
    for sentence, step in zip(stated["sentences"], stated["next_steps"], strict=True):
        lines += [f"  because: {sentence}", *([f"  next: {step}"] if step else [])]
    return lines
