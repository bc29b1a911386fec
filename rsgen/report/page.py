"""report.html: one file that reads like a chapter, verdict first."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

import rsgen
from rsgen.comparison import FORCE_KEYS, Comparison
from rsgen.describing import derive
from rsgen.expression import parse
from rsgen.figures import Drawing, count_text, number_text, quantity_text
from rsgen.identification import Identification
from rsgen.law.element import Element
from rsgen.law.notation import mathml
from rsgen.prediction import Prediction
from rsgen.report.environment import page_environment
from rsgen.report.inline import inline_svg
from rsgen.report.interpretation import describe_elements, describe_mean
from rsgen.report.source_formulas import PrintedFormula
from rsgen.report.subject import Subject
from rsgen.report.tables import (
    background_table,
    error_text,
    estimate_table,
    held_out_table,
    ranking_table,
    resonance_table,
    verdict_table,
)
from rsgen.report.wording import full_sentence
from rsgen.surface import ResponseSurface

__all__ = ["render_page", "verdict_sentence"]

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


def verdict_sentence(comparison: Comparison, misfit: float | None = None) -> str:
    """Say in one line whether the case is accepted.

    Parameters
    ----------
    misfit
        By how much of their size the law misses force and response, where that is more than noise; None where
        the law fits.
    """
    judged = [row for row in comparison.rows if row.tolerance is not None]
    if not judged:
        parameters = [row for row in comparison.rows if row.name not in FORCE_KEYS]
        told = sum(row.refined.identifiable for row in parameters)
        known = any(math.isfinite(row.true) for row in parameters)
        why = "nothing to accept ([accept] is empty)" if known else "nothing to compare with"
        counted = f"{told} of {count_text(len(parameters), 'parameter')}"
        if misfit is not None:
            size = error_text(misfit)
            return f"The law misses the test by {size}: {counted} identified, their intervals do not hold"
        return f"Identified: {counted}, {why}"
    missed = [row.name for row in judged if not row.passed]
    if missed:
        return f"Not accepted: {', '.join(missed)} outside tolerance"
    worst = max((row.relative_error for row in judged if math.isfinite(row.relative_error)), default=math.nan)
    counted = {1: "the one judged value", 2: "both judged values"}.get(
        len(judged), f"all {len(judged)} values"
    )
    return f"Accepted: {counted} within tolerance, largest error {error_text(worst)}"


def _surface_sentence(surface: ResponseSurface) -> str:
    settled = int(np.count_nonzero(surface.settled))
    made = "simulated to the steady state" if surface.origin == "simulated" else "measured"
    lowest, highest = (quantity_text(float(f(surface.level)), surface.level_unit) for f in (np.min, np.max))
    forces = f"from {lowest} to {highest}" if len(surface.levels) > 1 else f"of {highest}"
    was = "was" if len(surface) == 1 else "were"
    text = (
        f"{count_text(len(surface), 'test point')} {was} {made}: {count_text(len(surface.levels), 'level')} "
        f"{forces}, {number_text(surface.frequency.min(), 5)} to "
        f"{number_text(surface.frequency.max(), 5)} Hz, "
        f"{count_text(surface.harmonics.shape[1] - 1, 'harmonic')}. "
    )
    if settled == len(surface):
        return text + "All of them settled."
    return text + f"{len(surface) - settled} did not settle and are not used."


def _proof(closed_form: bool, checked_to: float | None) -> str:
    form = "closed form" if closed_form else "by quadrature, no closed form is known"
    if checked_to is None or not math.isfinite(checked_to):
        return form
    deviation = number_text(checked_to, 2)
    return f"{form}; checked against independent quadrature, largest relative deviation {deviation}"


def _element(element: Element) -> dict[str, Any]:
    function = derive(element)
    return {
        "name": element.name,
        "force": _formula(element.force, display=True),
        "stiffness": _formula(function.stiffness, display=True),
        "damping": _formula(function.damping, display=True),
        "mean": None
        if function.mean is None or function.mean == 0
        else _formula(function.mean, display=True),
        "proof": _proof(function.closed_form, function.checked_to),
        "regimes": [_shown(regime) for regime in function.regimes],
        "remarks": [str(remark) for remark in function.remarks],
    }


def _shown(value: Any) -> Any:
    return value if isinstance(value, str) else _formula(value)


def _drawing(drawing: Drawing) -> dict[str, Any]:
    return {
        "svg": inline_svg(drawing),
        "caption": drawing.caption,
        "alternative": drawing.alternative,
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

    Raises
    ------
    RsgenError
        The templates are not found.
    """
    meaning = describe_elements(subject.elements, identification)
    fits = not any(finding.code == "law-does-not-fit" for finding in identification.findings)
    # what comes from the case stays as it is written there
    warnings = [*subject.warnings, *map(full_sentence, identification.findings)]
    context = {
        "title": subject.title,
        "name": subject.name,
        "source": subject.source,
        "contents": _CONTENTS,
        "passed": comparison.passed if any(row.tolerance is not None for row in comparison.rows) else None,
        "verdict": verdict_sentence(comparison, None if fits else identification.noise),
        "outcome": full_sentence(identification.outcome),
        "verdict_table": verdict_table(comparison),
        "meaning": list(meaning.items()),
        "mean_sentence": describe_mean(surface, identification),
        "law_fits": fits,
        "warnings": warnings,
        "surface_sentence": _surface_sentence(surface),
        "drawings": {drawing.name: _drawing(drawing) for drawing in drawings},
        "prediction_remarks": [full_sentence(found) for found in prediction.findings],
        "held_out_table": held_out_table(prediction),
        "elements": [_element(element) for element in subject.elements],
        "printed": [
            {
                "what": formula.what,
                "agrees": formula.agrees,
                "formula": _formula(formula.formula, display=True),
                "sentences": formula.sentences,
            }
            for formula in printed
        ],
        "motion_formula": _formula(parse("X0 + X*sin(phi)")),
        "balance_formula": _formula(parse("k - m*omega**2")),
        "estimates_table": estimate_table(identification),
        "resonance_table": resonance_table(identification),
        "background_table": background_table(identification),
        "ranking_table": ranking_table(identification),
        "ranking_verdict": identification.ranking.verdict if identification.ranking is not None else (),
        "provenance": list(provenance.items()),
        "case_text": subject.case.text if subject.case is not None else "",
        "version": rsgen.__version__,
    }
    return page_environment().get_template("report/report.html").render(context)
