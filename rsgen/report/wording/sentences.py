"""How a finding and a verdict become sentences: a text or a function a code, numbers printed as in a book.

The verdict in words is an entry of result.json, and from it, of pages, notebooks and terminals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from rsgen.common.finding import (
    STATES,
    Finding,
    Quantity,
    State,
    StatedVerdict,
    Verdict,
    reach_verdict,
    verdict_lines,
)
from rsgen.formula.units import count_text, number_text, quantity_text

if TYPE_CHECKING:
    from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import ResponseSurface

Say = Callable[[Finding], str]

CODES: dict[str, Say] = {}
"""The function that says a finding, by the code of the finding."""

NEXT_STEPS: dict[str, str] = {}
"""Next step after a finding that casts doubt on a result, by its code: a full sentence, with the fields of
``say_plainly`` in braces. Every code that may have the severity "doubt" or "error" has one."""


class _Number(float):
    """A number that formats as a book prints it: a power of ten in place of 1e-8, a space before per cent.

    Two kinds of its own: ``.3q`` is the number with its unit, ``.2p`` a ratio in per cent.
    """

    unit: str

    def __new__(cls, value: float, unit: str = "") -> Self:
        number = super().__new__(cls, value)
        number.unit = unit
        return number

    def __format__(self, form: str) -> str:
        value, digits = float(self), int(form[1:-1] or 6) if form[:1] == "." else 6
        match form[-1:]:
            case "g":
                return number_text(value, digits)
            case "p":
                return f"{number_text(100 * value, digits)} %"
            case "q":
                return quantity_text(value, self.unit, digits)
        text = format(value, form)
        return f"{text[:-1]} %" if form.endswith("%") else text


@dataclass(frozen=True, slots=True)
class _Fields:
    """Fields of a text in braces: "parameter", and the names and numbers of its finding."""

    finding: Finding

    def __getitem__(self, name: str) -> str | _Number:
        if name == "parameter":
            return self.finding.parameter
        names = self.finding.names
        return names[name] if name in names else _Number(*self.finding.numbers[name])


def says(code: str) -> Callable[[Say], Say]:
    """Register the sentence of a code: a function of the finding, whose numbers format as in a book.

    A sentence begins in lower case and has no full stop, so that it can be part of a line.
    """

    def register(function: Say) -> Say:
        CODES[code] = function
        return function

    return register


def say_plainly(texts: Mapping[str, str]) -> None:
    """Register sentences without logic: format strings by code, with the fields of ``_Fields``."""
    for code, text in texts.items():
        CODES[code] = partial(_fill, text)


def _fill(text: str, finding: Finding) -> str:
    return text.format_map(_Fields(finding))


def next_step(finding: Finding) -> str:
    """Return the next step after a finding as one sentence; "" where none is known."""
    return NEXT_STEPS.get(finding.code, "").format_map(_Fields(finding))


def sentence(finding: Finding) -> str:
    """Say a finding in one sentence; a code without a sentence is shown as data."""
    say = CODES.get(finding.code)
    if say is None:
        return repr(finding)
    numbers = {name: Quantity(_Number(*number), number.unit) for name, number in finding.numbers.items()}
    return say(Finding(finding.code, finding.severity, finding.parameter, numbers, finding.names))


def full_sentence(finding: Finding) -> str:
    """Say a finding with capital and full stop; names, files and symbols such as c(X) keep their spelling."""
    text = sentence(finding)
    if text[1:2] != "(" and not any(
        name and text.startswith(name) for name in (finding.parameter, *finding.names.values())
    ):
        text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."


# ----------------------------------------------------------------------------
# Sentences of a page about the whole: the test, the proof of a derivation.


def error_text(error: float | None, digits: int = 2) -> str:
    """Print a relative error in per cent.

    Examples
    --------
    >>> error_text(0.0026), error_text(None)
    ('0.26 %', '–')
    """
    return "–" if error is None or not math.isfinite(error) else f"{number_text(100 * error, digits)} %"


def share_text(share: float, bound: float) -> str:
    """Print a share in per cent, and where nothing of it is seen what it is below.

    Examples
    --------
    >>> share_text(0.012, 0.013), share_text(0.0, 0.0026)
    ('1.2 %', '< 0.26 %')
    """
    hidden = share == 0 and math.isfinite(bound) and bound > 0
    return f"< {error_text(bound)}" if hidden else error_text(share)


def surface_sentence(surface: ResponseSurface) -> str:
    """Say how many points of which levels and frequencies the test has, and whether they settled."""
    settled = int(np.count_nonzero(surface.settled))
    lowest, highest = (quantity_text(float(f(surface.level)), surface.level_unit) for f in (np.min, np.max))
    forces = f"from {lowest} to {highest}" if len(surface.levels) > 1 else f"of {highest}"
    was = "was" if len(surface) == 1 else "were"
    text = (
        f"{count_text(len(surface), 'test point')} {was} {surface.origin}: "
        f"{count_text(len(surface.levels), 'level')} {forces}, {number_text(surface.frequency.min(), 5)} to "
        f"{number_text(surface.frequency.max(), 5)} Hz, "
        f"{count_text(surface.harmonics.shape[1] - 1, 'harmonic')}. "
    )
    if settled == len(surface):
        return text + "All of them settled."
    return text + f"{len(surface) - settled} did not settle and are not used."


def spectra_sentence(spectra: MultisineSpectra, band: tuple[float, float]) -> str:
    """Say how many records of a multisine there are, and which lines [Hz] were fitted."""
    made = "simulated" if spectra.origin == "simulated" else "measured"
    step = quantity_text(float(spectra.frequency[1]), "Hz", 4)
    low, high = band
    return (
        f"{count_text(len(spectra), 'record')} of {count_text(spectra.periods, 'settled period')} at "
        f"{count_text(len(spectra.levels), 'level')}, {made}; line spacing {step}. Lines from "
        f"{quantity_text(low, 'Hz', 4)} to {quantity_text(high, 'Hz', 4)} were fitted."
    )


def proof_sentence(closed_form: bool, checked_to: float | None) -> str:
    """Say how a describing function was proved, and to which relative deviation [1]."""
    form = "closed form" if closed_form else "by quadrature, no closed form is known"
    if checked_to is None or not math.isfinite(checked_to):
        return form
    deviation = number_text(checked_to, 2)
    return f"{form}; checked against independent quadrature, largest relative deviation {deviation}"


# ----------------------------------------------------------------------------
# Sentences about the verdict on a result: the headline, and what to do about what decided.

_HEADLINES: dict[State, str] = {
    "accepted": "Accepted: every judged value is within tolerance",
    "identified": "Identified: nothing was judged against a truth",
    "missed": "Missed: a judged value is outside tolerance",
    "doubtful": "Doubtful: look before you use these numbers",
    "rejected": "Rejected: these numbers are not to be used",
}
"""The headline of a state, where nothing more is known or matters."""

MARKED: dict[str, str] = {"doubtful": "Doubtful: ", "rejected": "Not to be used: "}
"""Label before every table and figure with numbers of such a result."""


@says("values-judged")
def _values_judged(found: Finding) -> str:
    if "outside" in found.names:
        return f"{found.names['outside']} outside tolerance"
    count = f"{found['judged']:.0f}"
    counted = {"1": "the one judged value", "2": "both judged values"}.get(count, f"all {count} values")
    return f"{counted} within tolerance, largest error {number_text(100 * found['largest'], 2)} %"


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


# ----------------------------------------------------------------------------
# A verdict in words: for result.json, and from it, for pages, notebooks and terminals.


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
    """Return the verdict of a result.json; of an older one that has none, from its findings and its rows.

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
        "decided_by": [Finding.from_dict(decided).to_dict() for decided in entry["decided_by"]],
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
