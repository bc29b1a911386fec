"""The HTML pages: report.html and the index of a folder of results.

report.html is one file that reads like a chapter, verdict first.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, cast
from urllib.parse import quote

import numpy as np
from markupsafe import Markup, escape

import rsgen
from rsgen.analysis.comparison import all_findings, verdict_of
from rsgen.common.arrays import Array
from rsgen.common.finding import STATES, USABLE, Finding, Quantity, quantities, reasons_of, steps_once
from rsgen.common.output import write_atomic
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.describing.derivation import derive, derive_off_centre
from rsgen.describing.function import PrintedComparison
from rsgen.formula.reading import parse
from rsgen.formula.units import count_text, number_text, quantity_text
from rsgen.identification.results import Identification, MultisineIdentification
from rsgen.identification.results.result import mass_lines
from rsgen.law.character import CANCELLATION_TOLERANCE
from rsgen.law.element import Element
from rsgen.law.memory import FORCE_KEYS, memory_form, with_equations
from rsgen.law.notation import mathml
from rsgen.report import page_tables as tables
from rsgen.report import sentences
from rsgen.report.figures import Drawing
from rsgen.report.figures.equivalent import (
    Backbone,
    backbone_with_harmonics,
    evaluated,
    share_along,
    smooth_backbone,
)
from rsgen.report.page_tables import NO_MODAL, Modal, harmonics_matter
from rsgen.report.provenance import page_environment
from rsgen.report.result_json import Entry, Parts, read_results
from rsgen.report.sentences import full_sentence, sentence

# ----------------------------------------------------------------------------
# Figures inside a page: SVG that takes its colours from the page and clashes with no other figure.

# the neutral colours of the style file become variables of the page, so that dark pages have dark figures
_COLOURS = {
    "#1b1c1e": "var(--ink)",
    "#fdfcfa": "var(--sheet)",
    "#6c6e70": "var(--dim)",
    "#dddcda": "var(--line)",
    "#0072b2": "var(--point)",
}


def inline_svg(drawing: Drawing) -> Markup:
    """Return the figure as one ``<svg>`` element: own ids, no fixed size, named by its alternative text."""
    text = drawing.render("svg").decode("utf-8")
    text = text[text.index("<svg") :]
    # a style sheet inside an inline SVG would act on the whole page; the page has these rules for figures
    text = re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    for colour, variable in _COLOURS.items():
        text = text.replace(colour, variable)
    text = re.sub(r' (?:xmlns(?::xlink)?|version)="[^"]*"', "", text)
    text = text.replace("xlink:href=", "href=")
    prefix = f"{drawing.name}-"
    text = re.sub(r'\bid="', f'id="{prefix}', text)
    text = re.sub(r'href="#', f'href="#{prefix}', text)
    text = text.replace("url(#", f"url(#{prefix}")
    named = f'<svg class="drawing" role="img" aria-label="{escape(drawing.alternative)}"'
    text = re.sub(r'<svg width="[0-9.]+pt" height="[0-9.]+pt"', lambda _: named, text, count=1)
    text = re.sub(r">\s+<", ">\n<", text)
    return Markup(text)  # noqa: S704 - written by matplotlib, which escapes text; the label is escaped here


def _formula(expression: Any, display: bool = False) -> Markup:
    return Markup(mathml(expression, display=display))  # noqa: S704 - sieved by notation


def _element(element: Element, mean: Any) -> dict[str, Any]:
    """Return the formulas of an element of a law whose own mean is ``mean``; None: it has no formula."""
    function = derive(element)
    if function.mean != mean:
        function = derive_off_centre(element)
    remembered = memory_form(element.force)
    rates = () if remembered is None else remembered.rates
    return {
        "name": element.name,
        "force": _formula(element.force, display=True),
        "memory": [(str(rate.symbol), _formula(rate.rate, display=True)) for rate in rates],
        "stiffness": _formula(function.stiffness, display=True),
        "damping": _formula(function.damping, display=True),
        "mean": None if function.mean in (None, 0) else _formula(function.mean, display=True),
        "proof": function.proof,
        "regimes": [r if isinstance(r, str) else _formula(r) for r in function.regimes],
        "remarks": [str(remark) for remark in function.remarks],
    }


def _printed(formula: PrintedComparison) -> dict[str, Any]:
    share = number_text(100 * formula.largest_deviation, 3)
    place = f"at X = {quantity_text(formula.amplitude, 'm', 3)}"
    return {
        "what": formula.what,
        "formula": _formula(formula.formula, display=True),
        "said": "agrees with the derivation" if formula.agrees else f"differs by up to {share} %, {place}",
    }


def _drawing(drawing: Drawing) -> dict[str, Any]:
    return {"svg": inline_svg(drawing), "caption": drawing.caption, "alternative": drawing.alternative}


def render_page(context: Mapping[str, Any]) -> str:
    """Render the page from a ``page_context``.

    Raises
    ------
    RsgenError
        The templates are not found.
    """
    return page_environment().get_template("report/report.html").render(context)


def page_context(parts: Parts, drawings: Iterable[Drawing], provenance: Mapping[str, str]) -> dict[str, Any]:
    """Return what a report says, by the names of its template; formulas are MathML and figures SVG.

    Everything but the provenance follows from the identification and its test alone.

    Parameters
    ----------
    drawings
        The figures by name; those that are missing are left out of the page.
    provenance
        Name and value pairs: hashes, versions, seed, command, durations.
    """
    subject, identification = parts.subject, parts.identification
    prediction, modal = parts.prediction, parts.modal
    said = _verdict_context(parts)
    usable, mean = said["state"] in USABLE, derive(identification.model.force).mean
    return {
        "title": subject.title,
        "name": subject.name,
        "source": subject.source,
        **said,
        "drawings": {drawing.name: _drawing(drawing) for drawing in drawings},
        "provenance": list(provenance.items()),
        "case_text": subject.case.text if subject.case is not None else "",
        "version": rsgen.__version__,
        "held_out_table": tables.held_out_table(prediction.held_out, usable=usable)
        or tables.record_table(prediction.records),
        "elements": [_element(element, mean) for element in subject.elements],
        "printed": list(map(_printed, parts.printed)),
        "motion_formula": _formula(parse("X0 + X*sin(phi)")),
        "balance_formula": _formula(parse("k - m*omega**2")),
        "estimates_table": tables.estimate_table(identification),
        "harmonics_matter": harmonics_matter(identification),
        "resonance_table": tables.resonance_table(identification),
        "modal_table": tables.modal_page_table(modal),
        "modal_remarks": [modal.reason] if modal.table is None else map(full_sentence, modal.table.findings),
        "modal_held_out": tables.held_out_table(
            modal.held_out,
            "The same levels from the modal table alone, where it reaches",
            prediction.held_out,
            usable,
        ),
        "background_table": tables.background_table(identification),
        "ranking_table": tables.ranking_table(identification),
        "ranking_verdict": [full_sentence(f) for f in getattr(identification.ranking, "findings", ())],
        **_test_context(parts.table, identification),
    }


def _verdict_context(parts: Parts) -> dict[str, Any]:
    """Return what a result is worth, what it means, and what warns of it."""
    subject, identification, prediction = parts.subject, parts.identification, parts.prediction
    verdict = verdict_of(identification, parts.comparison, prediction)
    stated = sentences.state_verdict(verdict)
    findings, ends = all_findings(identification, prediction), resonance_at_ends(identification, parts.modal)
    # what casts doubt before notes
    warnings = list(map(full_sentence, sorted(findings, key=lambda one: one.severity == "info")))
    return {
        "state": verdict.state,
        "verdict": stated["headline"],
        "reasons": reasons_of(stated),
        "next_steps": [*steps_once(stated), *sentences.ranking_steps(identification.ranking, verdict.state)],
        "mark": sentences.MARKED.get(verdict.state, ""),
        "outcome": full_sentence(identification.outcome),
        "law": with_equations(identification.model.force),
        "verdict_table": tables.verdict_table(
            parts.comparison,
            mass_lines(identification, rms=subject.scale_is_sure),
            identification.small_motion,
        ),
        "alternative_table": tables.alternative_table(identification),
        "meaning": [
            *describe_elements(subject.elements, identification, ends).items(),
            *(("resonance", sentence(course)) for course in resonance_course(identification, ends)),
        ],
        "warnings": warnings,
        "other_warnings": [text for text in warnings if text not in reasons_of(stated)],
        # what was asked for is a finding of the identification
        "prediction_remarks": [
            full_sentence(found)
            for found in findings
            if found.code == "level-predicted"
            or (found in prediction.findings and found not in identification.findings)
        ],
    }


def element_finding(element: Element, identification: Identification, ends: Ends) -> Finding | None:
    """Find what an identified spring or damper does over the tested amplitudes; None where nothing is known.

    Parameters
    ----------
    element
        One of the model's elements.
    identification
        Gives the values and the tested range; parameters that are not identifiable are named.
    ends
        The resonance at both ends of the amplitudes.
    """
    identifiable = {estimate.name: estimate.identifiable for estimate in identification.refined}
    unknown = [name for name in element.parameters if not identifiable.get(name, True)]
    course = Finding("element-course", "info", names={"unknown": ", ".join(unknown)} if unknown else {})
    # the fit reproduces the test with these values, also where single ones are not identifiable
    names = sorted(identification.model.parameters)
    values = dict(zip(names, identification.solution.tolist(), strict=True))
    if len(unknown) == len(element.parameters) > 0 or not np.isfinite(list(values.values())).all():
        return course if unknown else None
    numbers, states = _course(element, identification, values, ends)
    return replace(course, numbers=numbers, names={**course.names} | states)


def resonance_course(identification: Identification, ends: Ends) -> list[Finding]:
    """Find resonance frequency and damping ratio of the law at the ends of the tested amplitudes; or none."""
    found = ends.backbone
    if found is None:
        return []
    numbers = quantities("m", amplitude_first=ends.amplitude[0], amplitude_last=ends.amplitude[1])
    numbers |= quantities("Hz", frequency_first=found.frequency[0], frequency_last=found.frequency[1])
    numbers |= quantities(ratio_first=found.damping_ratio[0], ratio_last=found.damping_ratio[1])
    order = {"order": "first"} if found.harmonics is None and harmonics_matter(identification) else {}
    low, high, *both = (float(f"{one:.4g}") for one in (*identification.frequency_range, *found.frequency))
    outside = [f"{one:g} Hz" for one in both if not low <= one <= high]
    beyond = {"beyond": " and ".join(outside)} if outside else {}
    return [Finding("resonance-course", "info", numbers=numbers, names=order | beyond)]


class Ends(NamedTuple):
    """The ends (2,) [m] of the tested amplitudes, and the backbone there; None where it is not known."""

    amplitude: Array
    backbone: Backbone | None


def resonance_at_ends(identification: Identification, modal: Modal = NO_MODAL) -> Ends:
    """Solve for the resonance at the ends of the tested amplitudes.

    They are those of the modal table where there is one: off resonance smaller motions say little of it,
    and a law that jumps may hold the mass there.
    """
    rows = identification.amplitude_range if modal.table is None else modal.table.amplitude
    ends, law = np.array([np.min(rows), np.max(rows)]), identification.model.elements
    if any(element.across for element in law):
        return Ends(ends, None)
    near = modal.table is not None and not any(element.memory for element in law)
    found = (backbone_with_harmonics if near else smooth_backbone)(identification, ends)
    return Ends(ends, found if np.isfinite([found.omega, found.damping_ratio]).all() else None)


def _course(
    element: Element, identification: Identification, values: dict[str, float], ends: Ends
) -> tuple[dict[str, Quantity], dict[str, str]]:
    """Stiffness and damping at the smallest and at the largest amplitude, or states whose loop is open."""
    curve = identification.curve.amplitude[identification.curve.used]
    at = ends.backbone
    # elements across two sensors follow what the curve is over, and not the response
    low, high = (float(curve.min()), float(curve.max())) if element.across else ends.amplitude.tolist()
    omega = np.pi * sum(identification.frequency_range)
    # damping may depend on the frequency: that of the resonance, which is stated with its damping, too
    amplitude, speed = np.array([low, high]), np.full(2, omega) if at is None else at.omega
    # the mean is a matter of all elements together
    mean = evaluated(derive(identification.model.force), amplitude, speed, values).mean
    own = {name: values[name] for name in element.parameters}
    result = evaluated(derive(element), amplitude, speed, own, np.where(np.isfinite(mean), mean, 0.0))
    if not np.isfinite([result.stiffness, result.damping]).all() and element.memory:
        return {}, {"states": ", ".join(element.memory)}
    share = None if at is None or element.across else share_along(element.force, own, at)
    names = {"order": "first"} if share is None and harmonics_matter(identification) else {}
    numbers = {"amplitude_first": Quantity(low, "m"), "amplitude_last": Quantity(high, "m")}
    numbers |= quantities("Hz", frequency=omega / (2 * np.pi)) if at is None else {}
    # an element has a share in stiffness or damping when it is not round-off of the whole
    size = float(np.nanmax(np.abs(identification.curve.stiffness), initial=0.0))
    for kind, unit, rate in (("stiffness", "N/m", 1.0), ("damping", "N*s/m", omega)):
        value = getattr(result, kind)
        # harmonics move energy between elements, which makes no damper of a spring
        if np.isfinite(value).all() and np.abs(value).max() * rate > CANCELLATION_TOLERANCE * size:
            for end, number in zip(("first", "last"), getattr(share or result, kind).tolist(), strict=True):
                numbers[f"{kind}_{end}"] = Quantity(number, identification.curve.units.of(unit))
    return numbers, names


def describe_elements(
    elements: Iterable[Element], identification: Identification, ends: Ends
) -> dict[str, str]:
    """Return the sentence of every element by its name."""
    said = {element.name: element_finding(element, identification, ends) for element in elements}
    return {name: sentence(finding) for name, finding in said.items() if finding is not None}


def _test_context(
    surface: ResponseSurface | MultisineSpectra, identification: Identification
) -> dict[str, Any]:
    """Return what a page says of a surface only, and what of spectra only."""
    if isinstance(surface, MultisineSpectra):
        approximations = cast("MultisineIdentification", identification).approximations
        return {
            "test_sentence": sentences.spectra_sentence(surface, identification.frequency_range),
            "linear_table": tables.linear_table(approximations, identification.curve.units),
        }
    return {"test_sentence": sentences.surface_sentence(surface), "linear_table": None}


# ----------------------------------------------------------------------------
# index.html: every case of a folder, true against identified.


def _quantity(value: Any, unit: Any) -> str:
    return "–" if value is None else quantity_text(float(value), str(unit), 6)


def _context(entry: Entry) -> dict[str, Any]:
    points, verdict = entry.result["surface"], entry.verdict
    return {
        "name": entry.folder.name,
        "title": entry.result["title"],
        "link": f"{quote(entry.folder.name)}/report.html",
        "state": verdict["state"],
        "headline": verdict["headline"],
        "reasons": list(dict.fromkeys(one["code"].replace("-", " ") for one in verdict["decided_by"])),
        "points": points["points"],
        "origin": points["origin"],
        "remarks": [
            count_text(number, noun)
            for severity, noun in (("warning", "warning"), ("info", "note"))
            if (number := sum(one["severity"] == severity for one in entry.result.get("findings", [])))
        ],
        "disagreeing": [f["what"] for f in entry.result.get("printed", []) if not f["agrees"]],
        "known": any(row["true"] is not None for row in entry.rows),
        "rows": [
            {
                "name": FORCE_KEYS.get(row["name"], row["name"]),
                "true": _quantity(row["true"], row["unit"]),
                "refined": _quantity((row["refined"] or {"value": None})["value"], row["unit"]),
                "paper": sentences.error_text(row.get("paper_error")),
                "first_order": sentences.error_text(row.get("first_order_error")),
                "error": sentences.error_text(row["relative_error"]),
                "passed": row["passed"] if row["tolerance"] is not None else None,
            }
            for row in entry.rows
        ],
    }


def write_index(folder: Path | str) -> None:
    """Write index.html over every result in a folder.

    Parameters
    ----------
    folder
        Where the results lie, one folder a case; folders without a readable result.json are left out.

    Raises
    ------
    RsgenError
        It cannot be written.
    """
    place = Path(folder)
    entries = read_results(place)
    contexts = list(map(_context, entries))
    titles = Counter(case["title"] for case in contexts)
    for case in contexts:
        if titles[case["title"]] > 1:
            case["title"] += f" ({case['name']})"
    page = page_environment().get_template("index/index.html")
    counts = {state: sum(case["state"] == state for case in contexts) for state in STATES}
    counts = {state: count for state, count in counts.items() if count}
    context = {"cases": contexts, "counts": counts, "marked": sentences.MARKED, "version": rsgen.__version__}
    write_atomic(place / "index.html", page.render(context))
