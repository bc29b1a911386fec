"""The files of a run on a multisine: spectra, kernel, result.json, page."""

from __future__ import annotations

import io
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from markupsafe import Markup

from rsgen.analysis.comparison import Comparison
from rsgen.cases import Case
from rsgen.common.output import write_atomic
from rsgen.data.multisine import BestLinear, MultisineSpectra
from rsgen.dynamics import kernel
from rsgen.files import MeasuredTest
from rsgen.formula.names import Structural
from rsgen.formula.units.quantities import choose_scale, count_text, number_text, quantity_text
from rsgen.identification.lines import MultisineIdentification
from rsgen.identification.prediction.prediction_result import MultisinePrediction, predict_multisine
from rsgen.identification.results import Identification
from rsgen.law.notation import mathml
from rsgen.report.figures import Drawing, draw_best_linear, draw_line_misfit, draw_predicted_record
from rsgen.report.notebook import KnownResults, render_lesson, save_lesson
from rsgen.report.page import common_context
from rsgen.report.page_tables import Cell, Table, TableRow
from rsgen.report.provenance import collect_provenance, page_environment
from rsgen.report.result_json import (
    common_entries,
    finite_or_none,
    numbers_or_none,
    resonance_entry,
    result_text,
)
from rsgen.report.subject import Subject
from rsgen.report.wording.page_sentences import error_text, share_text

__all__ = ["write_multisine_files", "write_multisine_notebook"]


# ----------------------------------------------------------------------------
# The lesson on a case with a multisine, executed, that calls the public API only.


def write_multisine_notebook(
    path: Path, case: Case, spectra: MultisineSpectra, results: KnownResults
) -> None:
    """Write, execute and save the lesson; it is saved even where a cell fails.

    Parameters
    ----------
    case
        As it was loaded.
    spectra
        Of its test.
    results
        What else is known, so that it is not computed again.

    Raises
    ------
    RsgenError
        A cell failed; the notebook with its traceback is on disk.
    """
    notebook = render_lesson(
        "notebook/multisine.txt",
        title=case.title or case.name,
        source=case.source,
        case_text=case.text,
        simulated=not isinstance(case.test, MeasuredTest),
        known=case.truth is not None,
        held_out=bool(case.model.observation.hold_out),
    )
    results.add("simulate", case.oscillator, case.test, result=spectra)
    results.add("read", case, result=spectra)
    save_lesson(path, notebook, results)


def write_multisine_files(
    place: Path,
    subject: Subject,
    case: Case | None,
    spectra: MultisineSpectra,
    identification: Identification,
    comparison: Comparison,
    spent: dict[str, float],
    command: Sequence[str],
    figures: str | None,
    started: float,
) -> None:
    """Write spectra.npz, kernel.py, result.json and report.html; with a case also a notebook.

    Parameters
    ----------
    place
        The folder, which exists.
    subject, case
        Heading and law; the case as it was read, None without one.
    spectra, identification, comparison
        The test, what was identified from it, and its tolerances.
    spent, command, figures
        As for ``write_report``.
    started
        When the report began [s].
    """
    found = cast("MultisineIdentification", subject.with_units(identification))
    judged, comparison = comparison, subject.with_units(comparison)
    write_atomic(place / "spectra.npz", _saved(spectra))
    if not found.model.force.has(Structural):
        write_atomic(place / "kernel.py", kernel.generate(found.model.force))
    # of what identification has not seen; other spectra would count what it has seen as held out
    prediction = predict_multisine(found)
    result = _result(subject, spectra, found, comparison, prediction, spent)
    write_atomic(place / "result.json", result_text(result))
    drawings = [draw_best_linear(found), draw_line_misfit(found)]
    if prediction.records:
        drawings.append(draw_predicted_record(prediction))
    if figures is not None:
        for drawing in drawings:
            write_atomic(place / f"figure-{drawing.name}.{figures}", drawing.render(figures))
    spent["report"] = time.perf_counter() - started
    provenance = collect_provenance(case, spectra, spent, command)
    page = _page(subject, spectra, found, comparison, prediction, drawings, provenance)
    write_atomic(place / "report.html", page)
    if case is not None:
        results = KnownResults(case)
        results.add("identify", spectra, case.model, result=identification)
        results.add("compare", identification, case.truth, case.accept, result=judged)
        results.add("predict", identification, result=prediction)
        for drawing in drawings:
            seen = prediction if drawing.name == "predicted-record" else identification
            results.add(f"draw_{drawing.name.replace('-', '_')}", seen, result=drawing)
        write_multisine_notebook(place / "notebook.ipynb", case, spectra, results)


def _saved(spectra: MultisineSpectra) -> bytes:
    """The spectra as an .npz file, without anything that is no plain array."""
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {
        "level": spectra.level,
        "omega0": spectra.omega0,
        "frequency": spectra.frequency,
        "force": spectra.force,
        "response": spectra.response,
        "mean_known": spectra.mean_known,
        "left_out": spectra.left_out,
    }
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _best_linear_entry(one: BestLinear) -> dict[str, Any]:
    return {
        "level": finite_or_none(one.level),
        "records": one.records,
        "natural_frequency": finite_or_none(one.natural_frequency),
        "damping_ratio": finite_or_none(one.damping_ratio),
        "stiffness": finite_or_none(one.stiffness),
        "mass": finite_or_none(one.mass),
        "distortion": finite_or_none(one.distortion_share),
        "noise": finite_or_none(one.noise_share),
        "even_lines": finite_or_none(one.even_share),
        "even_lines_bound": finite_or_none(one.even_bound),
        "odd_lines": finite_or_none(one.odd_share),
        "odd_lines_bound": finite_or_none(one.odd_bound),
        "frequency": numbers_or_none(one.frequency),
        "receptance_real": numbers_or_none(one.receptance.real),
        "receptance_imaginary": numbers_or_none(one.receptance.imag),
        "response_noise": numbers_or_none(one.noise),
        "response_distortion": numbers_or_none(one.distortion),
    }


def _result(
    subject: Subject,
    spectra: MultisineSpectra,
    found: MultisineIdentification,
    comparison: Comparison,
    prediction: MultisinePrediction,
    durations: Mapping[str, float],
) -> dict[str, Any]:
    """The content of result.json: the keys that every result has, and those of a multisine."""
    return {
        **common_entries(subject, found, comparison, prediction),
        # what every result says of its test: here a point is an excited line of a record
        "surface": {
            "points": int(spectra.excited().sum()),
            "settled": int(spectra.excited().sum()),
            "origin": spectra.origin,
            "seconds": finite_or_none(durations.get("surface")),
        },
        "multisine": {
            "records": len(spectra),
            "periods": spectra.periods,
            "left_out": np.asarray(spectra.left_out).tolist(),
            "line_spacing": finite_or_none(float(spectra.frequency[1])),
            "levels": numbers_or_none(spectra.level),
            "rms_force": numbers_or_none(spectra.rms_force()),
            "rms_response": numbers_or_none(spectra.rms_response()),
        },
        "best_linear": [_best_linear_entry(one) for one in found.approximations],
        "resonances": [resonance_entry(point) for point in found.resonances],
        "held_out": [
            {
                "level": finite_or_none(one.level),
                "error": finite_or_none(one.error),
                "noise": finite_or_none(one.noise),
                "lines": int(np.count_nonzero(one.judged)),
            }
            for one in prediction.records
        ],
    }


def _test_sentence(spectra: MultisineSpectra, found: MultisineIdentification) -> str:
    made = "simulated" if spectra.origin == "simulated" else "measured"
    step = quantity_text(float(spectra.frequency[1]), "Hz", 4)
    low, high = found.frequency_range
    return (
        f"{count_text(len(spectra), 'record')} of {count_text(spectra.periods, 'settled period')} at "
        f"{count_text(len(spectra.levels), 'level')}, {made}; lines {step} apart. Lines from "
        f"{quantity_text(low, 'Hz', 4)} to {quantity_text(high, 'Hz', 4)} were fitted."
    )


def _levels_table(found: MultisineIdentification) -> Table:
    stiffness = choose_scale([one.stiffness for one in found.approximations], "N/m")
    size = choose_scale([one.rms for one in found.approximations], "m")

    def cell(value: float, digits: int = 4) -> Cell:
        return Cell(number_text(value, digits) if np.isfinite(value) else "–")

    rows = tuple(
        TableRow(
            (
                quantity_text(one.level, "N", 3),
                Cell(str(one.records)),
                cell(one.rms / size.factor),
                cell(one.natural_frequency, 5),
                cell(100 * one.damping_ratio),
                cell(one.stiffness / stiffness.factor, 5),
                Cell(error_text(one.distortion_share)),
                Cell(share_text(one.even_share, one.even_bound)),
                Cell(share_text(one.odd_share, one.odd_bound)),
                Cell(error_text(one.noise_share)),
            )
        )
        for one in found.approximations
    )
    columns = (
        "Level, rms",
        "Records",
        size.label("Response, rms"),
        "Natural frequency [Hz]",
        "Damping ratio [%]",
        stiffness.label("k"),
        "Distortion at excited lines",
        "at even lines",
        "at other odd lines",
        "Noise",
    )
    return Table("Best linear approximation of each level", columns, rows)


def _record_table(prediction: MultisinePrediction) -> Table | None:
    if not prediction.records:
        return None
    rows = tuple(
        TableRow(
            (
                quantity_text(one.level, "N", 3),
                Cell(str(int(np.count_nonzero(one.judged)))),
                Cell(error_text(one.error, 3)),
                Cell(error_text(one.noise)),
            )
        )
        for one in prediction.records
    )
    columns = ("Level, rms", "Lines", "Error, root mean square", "Noise of the measured mean")
    return Table("Levels that identification has not seen", columns, rows)


def _page(
    subject: Subject,
    spectra: MultisineSpectra,
    found: MultisineIdentification,
    comparison: Comparison,
    prediction: MultisinePrediction,
    drawings: Sequence[Drawing],
    provenance: Mapping[str, str],
) -> str:
    context = common_context(subject, found, comparison, prediction, drawings, provenance) | {
        "test_sentence": _test_sentence(spectra, found),
        "levels_table": _levels_table(found),
        "record_table": _record_table(prediction),
        "elements": [
            {
                "name": element.name,
                "force": Markup(mathml(element.force, display=True)),  # noqa: S704 - sieved by notation
            }
            for element in subject.elements
        ],
    }
    return page_environment().get_template("report/multisine.html").render(context)
