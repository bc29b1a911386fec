"""Sentences about the verdict on a result: the headline, and what to do about what decided."""

from __future__ import annotations

from rsgen.common.finding import Finding
from rsgen.common.verdict import State, Verdict
from rsgen.formula.units.scale import number_text
from rsgen.report.wording.sentences import says, sentence

__all__ = ["MARKED", "headline"]

_HEADLINES: dict[State, str] = {
    "accepted": "Accepted: every judged value is within tolerance",
    "identified": "Identified: nothing was judged against a truth",
    "missed": "Missed: a judged value is outside tolerance",
    "doubtful": "Doubtful: look before you use these numbers",
    "rejected": "Rejected: these numbers are not to be used",
}
"""The headline of a state, where nothing more is known or matters."""

MARKED: dict[str, str] = {"doubtful": "Doubtful: ", "rejected": "Not to be used: "}
"""What stands before every table and figure with numbers of such a result."""


@says("values-within-tolerance")
def _(found: Finding) -> str:
    count = f"{found['judged']:.0f}"
    counted = {"1": "the one judged value", "2": "both judged values"}.get(count, f"all {count} values")
    return f"{counted} within tolerance, largest error {number_text(100 * found['largest'], 2)} %"


@says("values-outside-tolerance")
def _(found: Finding) -> str:
    return f"{found.names['values']} outside tolerance"


def headline(verdict: Verdict) -> str:
    """Say a verdict in one line, without a full stop; it begins with the state."""
    summary = verdict.summary
    if summary is None or verdict.state in ("doubtful", "rejected"):
        return _HEADLINES[verdict.state]
    if summary.code == "identified":
        return (
            f"Identified: {summary['identified']:.0f} of {summary['parameters']:.0f} parameters, misfit "
            f"{number_text(100 * summary['misfit'], 2)} %, nothing judged against a truth"
        )
    return f"{verdict.state.capitalize()}: {sentence(summary)}"  # of judged values, or of a ranking
