"""How a finding and a verdict become sentences: a text or a function a code, numbers printed as in a book.

Most sentences stand in ``findings.toml``; those with more logic are functions below. The numerical layers
make findings (``rsgen.common.finding``); pages, notebooks, ``result.json`` and the command line take their
sentences from here, and nothing reads a sentence back. The verdict in words is an entry of result.json.
Sentences about laws, predictions, rankings and comparisons follow.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from rsgen.common.errors import listed, require
from rsgen.common.finding import (
    STATES,
    Finding,
    Quantity,
    State,
    StatedVerdict,
    Verdict,
    next_lines,
    reach_verdict,
    verdict_lines,
)
from rsgen.common.tolerances import CONFIDENCE_TEXT
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.formula.units import count_text, number_text, quantity_text

if TYPE_CHECKING:
    from rsgen.data.multisine.spectra import MultisineSpectra
    from rsgen.identification.ranking import Ranking

Say = Callable[[Finding], str]

CODES: dict[str, Say] = {}
"""The function that says a finding, by the code of the finding: in lower case and without a full stop, so
that it can be part of a line."""

NEXT_STEPS: dict[str, Say] = {}
"""Next step after a finding that casts doubt on a result, by its code, in the order in which to take them: a
full sentence. Every code that may have the severity "doubt" or "error" has one."""

_MAX_SHARE_WITH_DECIMALS = 100.0
"""From a hundred times on two digits are enough: a misfit of 10^20 is one power of ten."""


class _Number(float):
    """A number that formats as a book prints it: a power of ten in place of 1e-8, a space before per cent.

    Three kinds of its own: ``.3q`` is the number with its unit, after the label that a level has, ``.2p`` a
    ratio in per cent, ``.4t`` a number as it is typed into a case.
    """

    unit: str
    label: str

    def __new__(cls, value: float, unit: str = "", label: str = "") -> Self:
        number = super().__new__(cls, value)
        number.unit, number.label = unit, label
        return number

    def __format__(self, form: str) -> str:
        value, digits = float(self), int(form[1:-1] or 6) if form[:1] == "." else 6
        match form[-1:]:
            case "g":
                return number_text(value, digits)
            case "p":
                return f"{number_text(100 * value, digits)} %"
            case "q":
                said = quantity_text(value, self.unit, digits)
                return f"{self.label} ({said})" if self.label else said
            case "t":
                return f"{value:.{digits}g}"
            case "%" if abs(value) >= _MAX_SHARE_WITH_DECIMALS:
                return f"{number_text(100 * value, 2)} %"
        text = format(value, form)
        return f"{text[:-1]} %" if form.endswith("%") else text


@dataclass(frozen=True, slots=True)
class _Fields:
    """Fields of a text in braces: "parameter", "confidence", and the numbers and names of its finding.

    ``words`` are what some names are called, by field and name. ``names[mass]`` is the name where a number
    has the same one.
    """

    finding: Finding
    words: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def __getitem__(self, name: str) -> str | _Number | Mapping[str, str]:
        names, numbers = self.finding.names, self.finding.numbers
        if name == "parameter":
            return self.finding.parameter
        if name == "confidence":
            return CONFIDENCE_TEXT
        if name == "names":
            return names
        if name in numbers or name not in names:
            return _Number(*numbers[name], names.get("label", "") if name == "level" else "")
        return self.words.get(name, {}).get(names[name], names[name])


_PART = re.compile(r"\[\[(?:([^|{}\]]*)\|)?(.*?)\]\]", re.DOTALL)
_FIELD = re.compile(r"\{(\w+)")


def _value(finding: Finding, name: str) -> str:
    """Return a name, a number, the severity or the parameter as conditions compare it; "" if missing."""
    if name in ("severity", "parameter"):
        return str(getattr(finding, name))
    if name in finding.names:
        return finding.names[name]
    return f"{float(finding.numbers[name].value):g}" if name in finding.numbers else ""


def _holds(finding: Finding, conditions: str) -> bool:
    """Return True if a finding meets all conditions: "name", "name!", "name=value", "name!=value"."""
    for condition in conditions.split(","):
        name, compared, value = condition.partition("=")
        found = _value(finding, name.removesuffix("!"))
        if (found == value if compared else found != "") is name.endswith("!"):
            return False
    return True


def _fill(said: str | Mapping[str, str], words: Mapping[str, Mapping[str, str]], finding: Finding) -> str:
    """Say a text, or that of several by what the finding has, without the parts that do not apply."""

    def part(found: re.Match[str]) -> str:
        conditions = ",".join(_FIELD.findall(found[2])) if found[1] is None else found[1]
        return found[2] if _holds(finding, conditions) else ""

    if not isinstance(said, str):
        applies = (text for when, text in said.items() if when == "otherwise" or _holds(finding, when))
        said = next(applies, "")
    return _PART.sub(part, said).format_map(_Fields(finding, words))


def _read_texts() -> None:
    """Register the sentences and next steps of ``findings.toml``."""
    texts = tomllib.loads(Path(__file__).with_name("findings.toml").read_text(encoding="utf-8"))
    for code, said in texts.items():
        if "sentence" in said:
            CODES[code] = partial(_fill, said["sentence"], said.get("words", {}))
        if "next" in said:
            NEXT_STEPS[code] = partial(_fill, said["next"], said.get("words", {}))


_read_texts()


def next_step(finding: Finding) -> str:
    """Return the next step after a finding as one sentence; "" where none is known."""
    say = NEXT_STEPS.get(finding.code)
    return "" if say is None else say(finding)


def sentence(finding: Finding) -> str:
    """Say a finding in one sentence; a code without a sentence is shown as data."""
    require(finding, Finding, "finding")
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
# Sentences of a page about the whole test.


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
    if settled < len(surface):
        return text + f"{len(surface) - settled} did not settle, or lack a number, and are not used."
    # a measured table does not say it
    return text + "All of them settled." * (surface.origin == "simulated")


def spectra_sentence(spectra: MultisineSpectra, band: tuple[float, float]) -> str:
    """Say how many records of a multisine there are, and which lines [Hz] were fitted."""
    made = "simulated" if spectra.origin == "simulated" else "measured"
    step = " to ".join(dict.fromkeys(quantity_text(one, "Hz", 4) for one in spectra.spacing))
    low, high = band
    return (
        f"{count_text(len(spectra), 'record')} of {count_text(spectra.periods, 'settled period')} at "
        f"{count_text(len(spectra.levels), 'level')}, {made}; line spacing {step}. Lines from "
        f"{quantity_text(low, 'Hz', 4)} to {quantity_text(high, 'Hz', 4)} were fitted."
    )


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


def headline(verdict: Verdict) -> str:
    """Say a verdict in one line, without a full stop; it begins with the state."""
    summary = verdict.summary
    if summary is None or verdict.state in ("doubtful", "rejected"):
        return _HEADLINES[verdict.state]
    if summary.code == "identified":
        return (
            f"Identified: {summary['identified']:.0f} of {summary['parameters']:.0f} parameters, misfit "
            f"{number_text(100 * summary['misfit'], 2)} %"
            + "; one level shows the law at its own amplitudes only" * (summary["levels"] == 1)
            + "; no mass was given, so nothing checks the units of force and response"
            * ("mass" in summary.names)
            + "; levels are no amounts that were set, so nothing checks the unit of base and response"
            * ("levels" in summary.names)
            + "; no force was measured: the declared unit and quantity of the response, which nothing but a "
            f"title of the column checks, decide {summary.names.get('force')}" * ("force" in summary.names)
        )
    return f"{verdict.state.capitalize()}: {sentence(summary)}"  # of judged values, or of a ranking


# ----------------------------------------------------------------------------
# A verdict in words: for result.json, and from it, for pages, notebooks and terminals.


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """Return findings in the order in which to look at them."""
    place = {code: number for number, code in enumerate(NEXT_STEPS)}
    return sorted(findings, key=lambda finding: place.get(finding.code, len(place)))


def state_verdict(verdict: Verdict) -> StatedVerdict:
    """Put a verdict into words."""
    return {
        "state": verdict.state,
        "headline": headline(verdict),
        "decided_by": [finding.to_dict() for finding in verdict.decided_by],
        "sentences": [full_sentence(finding) for finding in verdict.decided_by],
        "next_steps": [next_step(finding) for finding in verdict.decided_by],
    }


def ranking_steps(ranking: Ranking | None, state: State) -> list[str]:
    """Say how to go on after a ranking whose best law has a verdict; [] without one, or where none fits."""
    if ranking is None or not ranking.fits:
        return []
    if state in MARKED:
        return ["Settle that first, then rank again: as it stands the first law is none to go on with."]
    if ranking.candidates[0].own:
        return ['The best law is that of the case: identify it with `rsgen run`, without model = "rank".']
    return [
        f"To go on with this law, write {ranking.in_case} into the case (`rsgen init` writes one to begin "
        'with) in place of its elements and of model = "rank", and use `rsgen run`.'
    ]


def explain(verdict: object) -> str:
    """Say a verdict in lines: the headline, what decided, and what to do next.

    Parameters
    ----------
    verdict
        ``found.verdict``, or that of ``rsgen.verdict_of``; or an identification or ranking that has one.
    """
    given: Any = getattr(verdict, "verdict", verdict)
    require(given, Verdict, "verdict")
    stated = state_verdict(given)
    return "\n".join([*verdict_lines(stated), *next_lines(stated)])


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


def _no_law_fits(f: Finding) -> str:
    """Say what the best law leaves, and in which harmonics."""
    named = {"harmonic 0": "mean", "harmonic 1": "fundamental"}
    orders = [name for name in f.numbers if name.startswith("harmonic ")]
    shares = listed([f"{named.get(name, name)} ({error_text(f[name])})" for name in orders])
    text = f"it is unexplained in the {shares or 'response'}"
    if "unexplained" not in f.numbers:
        return text
    left, noise = error_text(f["unexplained"]), error_text(f["noise"])
    cause = "a hysteresis that is none of theirs, a second mode, a background or a drift would leave this"
    if "offset" in f.numbers:
        mean = quantity_text(f["offset"], "m", 3)
        cause = f"an offset of the sensor, a mean displacement of {mean} at every amplitude, would leave this"
    elif "even" in f.names:
        cause = f"a force {f.names['even']}, which is not the same on both sides, would leave this"
    return (
        f"none of these fits: even the best, {f.names['law']}, leaves {left} of force and response "
        f"unexplained (noise, judged by how much {'neighbouring points' if orders else 'periods'} differ: "
        f"{noise}); all candidates assume one mode: {cause}; {text}"
    )


CODES["no-law-fits"] = _no_law_fits
