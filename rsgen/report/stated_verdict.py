"""A verdict in words: for result.json, and from it, for pages, notebooks and terminals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rsgen.common.finding import STATES, Finding, StatedVerdict, Verdict, reach_verdict, verdict_lines
from rsgen.report.wording.page_sentences import headline
from rsgen.report.wording.sentences import full_sentence, next_step

__all__ = ["explain", "read_verdict", "state_verdict"]


def state_verdict(verdict: Verdict) -> StatedVerdict:
    """Put a verdict into words."""
    return {
        "state": verdict.state,
        "headline": headline(verdict),
        "decided_by": [finding.to_dict() for finding in verdict.decided_by],
        "sentences": [full_sentence(finding) for finding in verdict.decided_by],
        "next_steps": [next_step(finding) for finding in verdict.decided_by],
    }


def explain(verdict: Verdict) -> str:
    """Say a verdict in lines: the headline, what decided, and what to do about it.

    Parameters
    ----------
    verdict
        ``found.verdict``, or that of ``rsgen.verdict_of``.
    """
    return "\n".join(verdict_lines(state_verdict(verdict)))


def read_verdict(result: Mapping[str, Any]) -> StatedVerdict:
    """Give the verdict of a result.json; of an older one that has none, from its findings and its rows.

    Raises
    ------
    ValueError, KeyError, TypeError
        The entry is none of ours.
    """
    if "verdict" not in result:
        return _older(result)
    entry = result["verdict"]
    texts = {name: [str(text) for text in entry[name]] for name in ("sentences", "next_steps")}
    if entry["state"] not in STATES or not len(entry["decided_by"]) == len(texts["sentences"]):
        raise ValueError(f"verdict: {entry['state']!r:.40}")
    if len(texts["next_steps"]) != len(texts["sentences"]):
        raise ValueError("verdict: as many next steps as sentences are needed")
    return {
        "state": entry["state"],
        "headline": str(entry["headline"]),
        "decided_by": [{**decided, "code": str(decided["code"])} for decided in entry["decided_by"]],
        "sentences": texts["sentences"],
        "next_steps": texts["next_steps"],
    }


def _older(result: Mapping[str, Any]) -> StatedVerdict:
    """Reach the verdict on a result that was written without one; its sentences are those it was given."""
    rows = [*result["parameters"], *result.get("forces", [])]
    judged = any(row.get("tolerance") is not None for row in rows)
    entries, texts = list(result.get("findings", [])), list(result.get("warnings", []))
    findings = [Finding.from_dict(entry) for entry in entries]
    verdict = reach_verdict(findings, bool(result["passed"]) if judged else None)
    # warnings begin with those of the case
    said = dict(zip(map(id, findings), texts[max(len(texts) - len(findings), 0) :], strict=False))
    return {
        "state": verdict.state,
        "headline": headline(verdict),
        "decided_by": [finding.to_dict() for finding in verdict.decided_by],
        "sentences": [str(said.get(id(finding), finding.code)) for finding in verdict.decided_by],
        "next_steps": [""] * len(verdict.decided_by),
    }
