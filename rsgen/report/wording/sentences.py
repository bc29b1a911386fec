"""How a finding and a verdict become sentences: a text or a function a code, numbers printed as in a book.

The verdict in words is an entry of result.json, and from it, of pages, notebooks and terminals. Sentences
about laws, predictions, rankings and comparisons follow.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
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
from rsgen.common.tolerances import CONFIDENCE_TEXT, RELATIVE_ERROR_DOUBTFUL
from rsgen.data.surface import ResponseSurface
from rsgen.formula.units import count_text, number_text, quantity_text

if TYPE_CHECKING:
    from rsgen.data.multisine import MultisineSpectra

Say = Callable[[Finding], str]

CODES: dict[str, Say] = {}
"""The function that says a finding, by the code of the finding."""

NEXT_STEPS: dict[str, Say] = {}
"""Next step after a finding that casts doubt on a result, by its code, in the order in which to take them: a
full sentence. Every code that may have the severity "doubt" or "error" has one."""


class _Number(float):
    """A number that formats as a book prints it: a power of ten in place of 1e-8, a space before per cent.

    Three kinds of its own: ``.3q`` is the number with its unit, ``.2p`` a ratio in per cent, ``.4t`` a number
    as it is typed into a case.
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
            case "t":
                return f"{value:.{digits}g}"
        text = format(value, form)
        return f"{text[:-1]} %" if form.endswith("%") else text


@dataclass(frozen=True, slots=True)
class _Fields:
    """Fields of a text in braces: "parameter", "confidence", and the names and numbers of its finding.

    ``words`` are what some names are called, by field and name.
    """

    finding: Finding
    words: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def __getitem__(self, name: str) -> str | _Number:
        if name == "parameter":
            return self.finding.parameter
        if name == "confidence":
            return CONFIDENCE_TEXT
        names = self.finding.names
        if name not in names:
            return _Number(*self.finding.numbers[name])
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


def says(code: str) -> Callable[[Say], Say]:
    """Register the sentence of a code: a function of the finding, whose numbers format as in a book.

    A sentence begins in lower case and has no full stop, so that it can be part of a line.
    """

    def register(function: Say) -> Say:
        CODES[code] = function
        return function

    return register


def _fill(said: str | Mapping[str, str], words: Mapping[str, Mapping[str, str]], finding: Finding) -> str:
    """Say a text, or that of several by what the finding has, without the parts that do not apply."""

    def part(found: re.Match[str]) -> str:
        conditions = ",".join(_FIELD.findall(found[2])) if found[1] is None else found[1]
        return found[2] if _holds(finding, conditions) else ""

    if not isinstance(said, str):
        said = next(text for when, text in said.items() if when == "otherwise" or _holds(finding, when))
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
            f"{number_text(100 * summary['misfit'], 2)} %"
        )
    return f"{verdict.state.capitalize()}: {sentence(summary)}"  # of judged values, or of a ranking


# ----------------------------------------------------------------------------
# A verdict in words: for result.json, and from it, for pages, notebooks and terminals.


def state_verdict(verdict: Verdict) -> StatedVerdict:
    """Put a verdict into words, its reasons in the order in which to look at them."""
    place = {code: number for number, code in enumerate(NEXT_STEPS)}
    decided = sorted(verdict.decided_by, key=lambda finding: place.get(finding.code, len(place)))
    return {
        "state": verdict.state,
        "headline": headline(verdict),
        "decided_by": [finding.to_dict() for finding in decided],
        "sentences": [full_sentence(finding) for finding in decided],
        "next_steps": [next_step(finding) for finding in decided],
    }


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


def _quantity(found: Finding, name: str, digits: int = 3) -> str:
    return quantity_text(*found.numbers[name], digits)


@says("element-course")
def _element_course(found: Finding) -> str:
    said, names = list[str](), found.names
    for kind in ("stiffness", "damping"):
        if f"{kind}_first" in found.numbers:
            ends = (f"{_quantity(found, f'{kind}_{end}')} at {_at(found, end)}" for end in ("first", "last"))
            said.append(f"{kind} {', '.join(ends)}")
    if "states" in names:
        said.append(f"the loop of {names['states']} does not close with the identified values")
    if "unknown" in names:
        said.append(f"not identifiable from this test: {names['unknown']}")
    return "; ".join(said) or "no force over the tested amplitudes"


def _at(found: Finding, end: str) -> str:
    return _quantity(found, f"amplitude_{end}", 2)


@says("sweep-rate")
def _sweep_rate(found: Finding) -> str:
    at = f"a resonance at {found['resonance']:.4g} Hz" if "pace" in found.numbers else ""
    if "resonance" in found.names:
        at = (
            f"the largest response, near {found['resonance']:.4g} Hz (it does not fall to half power on both "
            "sides: the resonance may lie outside),"
        )
    if "correction" not in found.numbers:
        fast = (
            f"; {found.names['record']} passes {at} with {found['rate']:.3g} Hz/s, "
            f"rate/(half width)^2 = {found['pace']:.2g} or more, which shifts it by {found['shift']:.2g} "
            "half widths"
            if "pace" in found.numbers
            else ""
        )
        return (
            "the force was not corrected for the sweep rate: over this band the sweeps do not determine a "
            f"moving mass, as they would with one mode in it{fast}; choose a band around one mode, or give "
            "the mass"
        )
    mass, beyond = "per unit mass", ""
    if "mass" in found.numbers:
        mass = f"with the mass {found['mass']:.4g} kg ({found.names['mass']})"
    if found.numbers.get("left", Quantity(0)).value > RELATIVE_ERROR_DOUBTFUL:
        beyond = (
            f"; by the flanks the mass is another one, which leaves {found['left']:.1%} of the force open"
        )
    elif found.severity == "doubt":
        beyond = "; in virtual sweeps as fast the damping was up to 40 % off: sweep slower"
    elif found["pace"] > found["proved_up_to"]:
        beyond = (
            f"; beyond {found['proved_up_to']:g} this leaves errors of some percent in c(X): sweep slower"
        )
    return (
        f"{found.names['record']}: the sweep {found.names['direction']} at {found['rate']:.3g} Hz/s is fast "
        f"for {at} with half width {found['half_width']:.2g} Hz: "
        f"rate/(half width)^2 = {found['pace']:.2g}, which shifts it by {found['shift']:.2g} half widths. "
        f"The force was corrected for that, by {found['correction']:.1%} there, {mass}{beyond}"
    )


# ----------------------------------------------------------------------------
# Sentences about laws that fit as well, and about rankings.

_ALTERNATIVES = {
    "term": "a term {} added to the law",
    "background": 'a background "{}"',
    "background of the second sensor": 'a background "{}" of the second sensor',
    "halves": "the difference of {}, identified separately,",
}


@says("law-ambiguous")
def _law_ambiguous(found: Finding) -> str:
    kinds = [text.format(found.names[kind]) for kind, text in _ALTERNATIVES.items() if kind in found.names]
    (said, *_) = (*kinds, "another law")
    if "shift" in found.numbers:
        shift = quantity_text(*found.numbers["shift"], 3)
        return (
            f"{said} that the noise hides would move {found.parameter} by up to {shift}, "
            f"{found['times']:.2g} times its standard error: {found.names['parameters']} and their "
            "intervals hold if the response contains no other modes"
        )
    left = ", and are wider than a tenth of the value" if found.severity == "doubt" else ""
    moved = number_text(100 * abs(found["moved"]), 2)
    return (
        f"{said} stands out of the noise by {found['errors']:.2g} standard errors, and "
        f"moves {found.parameter} by {moved} %; the intervals include such shifts{left}"
    )


def _percent(share: float) -> str:
    return f"{share:.1%}" if share < 1 else "more than 100 %"


def _joined(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _between(low: float, high: float, unit: str) -> str:
    one, two = number_text(low, 4), number_text(high, 4)
    return f"near {one} {unit}" if one == two else f"between {one} and {two} {unit}"


def _counted(f: Finding) -> str:
    return f"{f['lines']:g} lines" if "lines" in f.numbers else f"{f['points']:g} points"


@says("ranking-few-points")
def _ranking_few_points(f: Finding) -> str:
    if "parameters" not in f.numbers:
        return "one level only: other levels would separate more laws"
    return f"{_counted(f)} are few for {f['parameters']:g} parameters: more would separate more laws"


@says("law-nearest")
def _law_nearest(f: Finding) -> str:
    if "noise" in f.names:
        lines = "one period is too little" if "lines" in f.numbers else ""
        reason = lines or "the frequencies are too widely spaced"
        return (
            f"{f.names['law']} comes nearest; {reason} to separate noise from misfit, so that it is not "
            "known whether it fits"
        )
    noise = number_text(100 * f["noise"], 2)
    return f"{f.names['law']} comes nearest, with a noise of {noise} % at {_counted(f)}"


@says("no-law-fits")
def _no_law_fits(f: Finding) -> str:
    if "unexplained" not in f.numbers:
        return _place(f)
    compared = "neighbouring points" if _orders(f) else "periods"
    return (
        f"none of these fits: even the best, {f.names['law']}, leaves {_percent(f['unexplained'])} of force "
        f"and response unexplained (noise, judged by how much {compared} differ: "
        f"{_percent(f['noise'])}); all candidates assume one mode: a hysteresis "
        f"that is none of theirs, a second mode, a background or a drift would leave this; {_place(f)}"
    )


def _orders(f: Finding) -> list[str]:
    return [name for name in f.numbers if name.startswith("harmonic ")]


def _place(f: Finding) -> str:
    """Say in which harmonics, where in frequency and amplitude, no law explains the test."""
    named = {"harmonic 0": "mean", "harmonic 1": "fundamental"}
    parts = [f"{named.get(name, name)} ({_percent(f[name])})" for name in _orders(f)]
    text = f"it is unexplained in the {_joined(parts or ['response'])}"
    if "frequency from" in f.numbers:
        text += f", mostly {_between(f['frequency from'], f['frequency to'], 'Hz')}"
    if "amplitude from" in f.numbers:
        text += f", at amplitudes {_between(f['amplitude from'], f['amplitude to'], 'm')}"
    return text


@says("law-fits-best")
def _law_fits_best(f: Finding) -> str:
    noise = number_text(100 * f["noise"], 2)
    if "left" in f.names:
        return f"{f.names['law']} fits best, with a noise of {noise} % at {_counted(f)}"
    size = f"is less than {f['least']:g}" if f["noise"] <= f["least"] else f"looks like noise of {noise} %"
    return f"{f.names['law']} fits best: what it leaves unexplained at {_counted(f)} {size}"


@says("laws-not-separated")
def _laws_not_separated(f: Finding) -> str:
    if "same" in f.names:
        return f"{f.names['law']} with a linear spring is the same law as {f.names['same']}"
    said = {
        "laws": "this test does not separate it from",
        "larger": "these contain it and fit no better",
    }
    return "; ".join(
        f"{text}: {listed(f.names[kind].split('; '))}" for kind, text in said.items() if kind in f.names
    )


@says("levels-predicted-worse")
def _levels_predicted_worse(f: Finding) -> str:
    said = list[str]()
    if "fitted" in f.numbers:
        said.append(
            f"a level predicted from the others is off by {_percent(f['predicted'])}, but only by "
            f"{_percent(f['fitted'])} when it is fitted with them: some values rest on a single level, or "
            "the law is too flexible"
        )
    if "law" in f.names:
        said.append(f"{f.names['law']} predicts levels better: off by {_percent(f['other'])}")
    return "; ".join(said)
