"""report.html: one file that reads like a chapter, verdict first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from markupsafe import Markup

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
from rsgen.report.dissipation import dissipation_findings
from rsgen.report.environment import page_environment
from rsgen.report.figures import Drawing
from rsgen.report.inline import inline_svg
from rsgen.report.interpretation import describe_elements, mean_finding
from rsgen.report.modal_section import NO_MODAL, Modal, modal_page_table
from rsgen.report.page_tables import (
    background_table,
    estimate_table,
    held_out_table,
    ranking_table,
    resonance_table,
    verdict_table,
)
from rsgen.report.source_formulas import PrintedFormula
from rsgen.report.stated_verdict import state_verdict
from rsgen.report.subject import Subject
from rsgen.report.wording import full_sentence, sentence
from rsgen.report.wording.page_sentences import proof_sentence, surface_sentence
from rsgen.report.wording.verdict_sentences import MARKED

__all__ = ["common_context", "render_page"]

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
