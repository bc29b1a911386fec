"""The verdict on a result, from the severities of its findings and the comparison with the truth."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from rsgen.finding import Finding

__all__ = ["State", "Verdict", "reach_verdict"]

State = Literal["accepted", "missed", "identified", "doubtful", "rejected"]


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
    """

    state: State
    decided_by: tuple[Finding, ...] = ()


def reach_verdict(findings: Iterable[Finding], within_tolerance: bool | None = None) -> Verdict:
    """Reach the verdict on a result.

    Parameters
    ----------
    findings
        All of the result: about the test, the fit, its parameters, and the levels held out.
    within_tolerance
        Whether all judged estimates are; None where nothing was judged.

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
        return Verdict("rejected", errors + doubts)
    if doubts:
        return Verdict("doubtful", doubts)
    if within_tolerance is None:
        return Verdict("identified")
    return Verdict("accepted" if within_tolerance else "missed")
