"""report.html: one file that reads like a chapter, verdict first."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from markupsafe import Markup, escape

import rsgen
from rsgen.analysis.comparison import Comparison, verdict_of
from rsgen.data.surface import ResponseSurface
from rsgen.describing import derive
from rsgen.formula import parse
from rsgen.identification.prediction import Prediction
from rsgen.identification.results import Identification
from rsgen.law.element import Element
from rsgen.law.memory import memory_form
from rsgen.law.notation import mathml
from rsgen.report.figures import Drawing
from rsgen.report.interpretation import PrintedFormula, describe_elements, dissipation_findings, mean_finding
from rsgen.report.page_tables import (
    NO_MODAL,
    Modal,
    background_table,
    estimate_table,
    held_out_table,
    modal_page_table,
    ranking_table,
    resonance_table,
    verdict_table,
)
from rsgen.report.provenance import page_environment
from rsgen.report.stated_verdict import state_verdict
from rsgen.report.subject import Subject
from rsgen.report.wording import full_sentence, sentence
from rsgen.report.wording.page_sentences import MARKED, proof_sentence, surface_sentence

if TYPE_CHECKING:
    from rsgen.report.figures import Drawing

__all__ = ["THUMBNAIL", "common_context", "inline_svg", "picture_svg", "render_page"]


# ----------------------------------------------------------------------------
# Figures inside a page: SVG that takes its colours from the page and clashes with no other figure.
#
# A picture that stands in a file of its own brings the colours of light and dark pages with it.

THUMBNAIL = "thumbnail.svg"
"""The file of a result by whose picture the index shows it."""

# the neutral colours of the style file become variables of the page, so that dark pages have dark figures
_COLOURS = {
    "#1b1c1e": "var(--ink)",
    "#fdfcfa": "var(--sheet)",
    "#6c6e70": "var(--dim)",
    "#dddcda": "var(--line)",
    "#0072b2": "var(--point)",
}


_LIGHT_AND_DARK = (
    "<style>*{stroke-linejoin:round;stroke-linecap:butt}:root{--ink:#1b1c1e;--sheet:#fdfcfa}"
    "@media (prefers-color-scheme:dark){:root{--ink:#e8e6e2;--sheet:#1f2225}}</style>"
)
"""For a picture without a page around it: its rules and those two of the page's colours that it has."""


def _coloured(drawing: Drawing) -> str:
    """Draw as one ``<svg>`` element whose neutral colours are the variables of a page, without rules."""
    text = drawing.render("svg").decode("utf-8")
    text = text[text.index("<svg") :]
    # a style sheet inside an inline SVG would act on the whole page; the page has these rules for figures
    text = re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    for colour, variable in _COLOURS.items():
        text = text.replace(colour, variable)
    return text


def picture_svg(drawing: Drawing) -> str:
    """Give the figure as an SVG file, which follows the reader's choice of light or dark."""
    head, rest = _coloured(drawing).split(">", 1)
    return f"{head}>{_LIGHT_AND_DARK}{rest}"


def inline_svg(drawing: Drawing) -> Markup:
    """Give the figure as one ``<svg>`` element: own ids, no fixed size, named by its alternative text."""
    text = _coloured(drawing)
    text = re.sub(r' (?:xmlns(?::xlink)?|version)="[^"]*"', "", text)
    text = text.replace("xlink:href=", "href=")
    prefix = f"{drawing.name}-"
    text = re.sub(r'\bid="', f'id="{prefix}', text)
    text = re.sub(r'href="#', f'href="#{prefix}', text)
    text = text.replace("url(#", f"url(#{prefix}")
    size = re.search(r'<svg width="([0-9.]+)pt" height="([0-9.]+)pt"', text)
    if size is None:  # pragma: no cover - matplotlib has written this for twenty years
        raise ValueError("matplotlib wrote an SVG without size")
    named = f'<svg class="drawing" role="img" aria-label="{escape(drawing.alternative)}"'
    text = text.replace(size[0], named, 1)
    text = re.sub(r">\s+<", ">\n<", text)
    return Markup(text)  # noqa: S704 - written by matplotlib, which escapes text; the label is escaped here


_CONTENTS = (
    ("verdict", "Result"),
    ("response-surface", "Response surface"),
    ("equivalent", "Stiffness and damping"),
    ("prediction", "Prediction"),
    ("laws", "Describing functions"),
    ("method", "Method"),
    ("warnings", "Warnings"),
    ("provenance", "Provenance"),
)


def _formula(expression: Any, display: bool = False) -> Markup:
    return Markup(mathml(expression, display=display))  # noqa: S704 - sieved by notation


def _element(element: Element) -> dict[str, Any]:
    function = derive(element)
    remembered = memory_form(element.force)
    rates = () if remembered is None else remembered.rates
    return {
        "name": element.name,
        "force": _formula(element.force, display=True),
        "memory": [(str(rate.symbol), _formula(rate.rate, display=True)) for rate in rates],
        "stiffness": _formula(function.stiffness, display=True),
        "damping": _formula(function.damping, display=True),
        "mean": None if function.mean in (None, 0) else _formula(function.mean, display=True),
        "proof": proof_sentence(function.closed_form, function.checked_to),
        "regimes": [r if isinstance(r, str) else _formula(r) for r in function.regimes],
        "remarks": [str(remark) for remark in function.remarks],
    }


def _printed(formula: PrintedFormula) -> dict[str, Any]:
    return {
        "what": formula.what,
        "agrees": formula.agrees,
        "formula": _formula(formula.formula, display=True),
        "sentences": formula.sentences,
    }


def _drawing(drawing: Drawing) -> dict[str, Any]:
    return {"svg": inline_svg(drawing), "caption": drawing.caption, "alternative": drawing.alternative}


def common_context(
    subject: Subject,
    identification: Identification,
    comparison: Comparison,
    prediction: Prediction,
    drawings: Iterable[Drawing],
    provenance: Mapping[str, str],
) -> dict[str, Any]:
    """Give what every page says, of whatever test: heading, verdict, meaning, figures, provenance."""
    verdict = verdict_of(identification, comparison, prediction)
    stated = state_verdict(verdict)
    # what comes from the case stays as it is written there
    warnings = [*subject.warnings, *map(full_sentence, identification.findings)]
    return {
        "title": subject.title,
        "name": subject.name,
        "source": subject.source,
        "state": verdict.state,
        "verdict": stated["headline"],
        "reasons": list(zip(stated["sentences"], stated["next_steps"], strict=True)),
        "mark": MARKED.get(verdict.state, ""),
        "outcome": full_sentence(identification.outcome),
        "verdict_table": verdict_table(comparison),
        "meaning": list(describe_elements(subject.elements, identification).items()),
        "warnings": warnings,
        "other_warnings": [text for text in warnings if text not in stated["sentences"]],
        "drawings": {drawing.name: _drawing(drawing) for drawing in drawings},
        "prediction_remarks": [
            full_sentence(found) for found in prediction.findings if found not in identification.findings
        ],
        "provenance": list(provenance.items()),
        "case_text": subject.case.text if subject.case is not None else "",
        "version": rsgen.__version__,
    }


def render_page(
    subject: Subject,
    surface: ResponseSurface,
    identification: Identification,
    comparison: Comparison,
    prediction: Prediction,
    printed: Sequence[PrintedFormula],
    drawings: Iterable[Drawing],
    provenance: Mapping[str, str],
    modal: Modal = NO_MODAL,
) -> str:
    """Render the page; everything but the provenance follows from the input alone.

    Parameters
    ----------
    printed
        Printed formulas held against the derivation.
    drawings
        The figures by name; those that are missing are left out of the page.
    provenance
        Name and value pairs: hashes, versions, seed, command, durations.
    modal
        The modal table, or why there is none.

    Raises
    ------
    RsgenError
        The templates are not found.
    """
    mean = mean_finding(surface, identification)
    common = common_context(subject, identification, comparison, prediction, drawings, provenance)
    energy = dissipation_findings(surface, identification) if "energy" in common["drawings"] else []
    context = common | {
        "contents": _CONTENTS,
        "mean_sentence": None if mean is None else full_sentence(mean),
        "surface_sentence": surface_sentence(surface),
        "energy_sentences": [full_sentence(finding) for finding in energy],
        "held_out_table": held_out_table(prediction.held_out),
        "elements": [_element(element) for element in subject.elements],
        "printed": list(map(_printed, printed)),
        "motion_formula": _formula(parse("X0 + X*sin(phi)")),
        "balance_formula": _formula(parse("k - m*omega**2")),
        "estimates_table": estimate_table(identification),
        "resonance_table": resonance_table(identification),
        "modal_table": modal_page_table(modal),
        "modal_remarks": [modal.reason] if modal.table is None else map(full_sentence, modal.table.findings),
        "modal_held_out": held_out_table(modal.held_out, "The same levels, from the modal table alone"),
        "background_table": background_table(identification),
        "ranking_table": ranking_table(identification),
        "ranking_verdict": [sentence(f) for f in getattr(identification.ranking, "findings", ())],
    }
    return page_environment().get_template("report/report.html").render(context)
