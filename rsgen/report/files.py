"""The files that a run leaves: surface or spectra, kernel, result.json, page, notebook."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import numpy as np

from rsgen.analysis.comparison import Comparison, compare
from rsgen.cases.case import Case
from rsgen.common.errors import RsgenError, require
from rsgen.common.output import write_atomic
from rsgen.data.multisine.spectra import MultisineSpectra, save_spectra
from rsgen.data.surface.response_surface import ResponseSurface, save_surface
from rsgen.describing.derivation import derive
from rsgen.describing.function import PrintedComparison, compare_printed
from rsgen.dynamics.kernel_source import generate
from rsgen.formula.names import Structural, remembers
from rsgen.identification.prediction import Prediction
from rsgen.identification.prediction.resonance_curves import predict_shown
from rsgen.identification.results import Identification, MultisineIdentification
from rsgen.report import figures
from rsgen.report.figures.drawing import POINTS, project_style
from rsgen.report.figures.equivalent import shows_loops
from rsgen.report.notebook import known_results, write_notebook
from rsgen.report.page import page_context, render_page
from rsgen.report.page_tables import NO_MODAL, Modal, tabulate_mode
from rsgen.report.provenance import Subject, collect_provenance
from rsgen.report.result_json import Parts, build_result, result_text


def draw_all(
    subject: Subject,
    surface: ResponseSurface | MultisineSpectra,
    identification: Identification,
    prediction: Prediction,
    modal: Modal = NO_MODAL,
) -> list[figures.Drawing]:
    """Draw every figure of the report; those that it does not need are left out."""
    if isinstance(surface, MultisineSpectra):
        return _draw_lines(surface, cast("MultisineIdentification", identification), prediction, modal)
    drawings = [figures.draw_surface(surface)]
    if identification.model.sensors:
        # no one amplitude is that of the law: it cannot be drawn over the response
        drawings += [] if modal.table is None else [figures.draw_modal(modal.table)]
        return [*drawings, figures.draw_held_out(prediction)] if prediction.held_out else drawings
    # without a mass no level has a stiffness, and no force of a spring is known; the collapse says so
    clouds, values = identification.curve.stiffness, identification.solution
    empty = len(clouds) > 0 and not np.isfinite(clouds).any() and not np.isfinite(values).all()
    drawings += [
        figures.draw_collapse(identification, subject.truth),
        figures.draw_responses(surface, prediction),
    ]
    if modal.table is not None:
        drawings.append(figures.draw_modal(modal.table, identification))
    if not (remembers(identification.model.force) or (empty and identification.restoring is None)):
        drawings.append(figures.draw_forces(identification, subject.truth))
    if shows_loops(surface, identification.model) and np.isfinite(identification.mass):
        drawings.append(figures.draw_loops(surface, identification, subject.truth))
        drawings.append(figures.draw_energy(surface, identification, subject.truth))
    if prediction.held_out:
        drawings.append(figures.draw_held_out(prediction))
    return drawings


def _draw_lines(
    spectra: MultisineSpectra, identification: MultisineIdentification, prediction: Prediction, modal: Modal
) -> list[figures.Drawing]:
    drawings = [figures.draw_best_linear(identification), figures.draw_line_misfit(identification)]
    if modal.table is not None:
        drawings.append(figures.draw_modal(modal.table, identification))
    return [*drawings, figures.draw_predicted_record(prediction)] if prediction.records else drawings


@project_style()
def write_report(
    folder: str | Path,
    surface: ResponseSurface | MultisineSpectra,
    identification: Identification,
    *,
    case: Case | None = None,
    comparison: Comparison | None = None,
    title: str = "",
    source: str = "",
    durations: Mapping[str, float] | None = None,
    command: Sequence[str] = (),
    figures: str | None = None,
) -> Path:
    """Write surface.h5, kernel.py, modal.csv, result.json and report.html; with a case also a notebook.

    The path of the page is returned. Of a multisine ``surface`` are its spectra, which go into spectra.npz.

    Parameters
    ----------
    folder
        Made if missing. Every file is written whole or not at all.
    surface, identification
        The test, and what was identified from it; of a ranking its best.
    case
        Its title, source, truth and text are shown, and notebook.ipynb is written from it.
    comparison
        None: made from the truth and the tolerances of the case.
    title, source
        Heading where there is no case; the title is otherwise the law.
    durations
        Seconds of the stages before, for the provenance: "surface", "identification".
    command
        What was called, for the provenance.
    figures
        "pdf", "svg" or "png": every figure is saved as ``figure-<name>.<kind>``, too, for a paper.

    Raises
    ------
    RsgenError
        An argument is of another type, a file cannot be written, or a cell of the notebook failed. The
        notebook comes last and is saved even then, so that all files are there.
    """
    require(folder, (str, Path), "folder")
    require(surface, (ResponseSurface, MultisineSpectra), "surface")
    require(identification, Identification, "identification")
    started = time.perf_counter()
    place = _make_folder(Path(folder))
    if case is not None:
        subject = Subject.of_case(case, identification)
    else:
        subject = Subject.of_result(identification, place.resolve().name, title, source)
    if comparison is None:
        comparison = compare(identification, subject.truth, None if case is None else case.accept)
    spent = dict(durations or {})
    save_records(surface, place)
    if not identification.model.force.has(Structural):
        # structural damping exists under periodic motion only, so that nothing simulates it
        write_atomic(place / "kernel.py", generate(identification.model.force))
    prediction, modal = predict_shown(surface, identification), tabulate_mode(surface, identification)
    printed = check_printed(subject, identification)
    if modal.table is not None:
        write_atomic(place / "modal.csv", modal.table.to_csv())
    parts = Parts(subject, surface, identification, comparison, prediction, printed, modal)
    write_atomic(place / "result.json", result_text(build_result(parts, spent)))
    drawings = draw_all(subject, surface, identification, prediction, modal)
    for drawing in drawings if figures is not None else ():
        write_atomic(place / f"figure-{drawing.name}.{figures}", drawing.render(str(figures)))
    spent["report"] = time.perf_counter() - started
    provenance = collect_provenance(case, surface, spent, command)
    write_atomic(place / "report.html", render_page(page_context(parts, drawings, provenance)))
    if case is not None:
        results = known_results(case, parts, drawings)
        shown = {drawing.name for drawing in drawings}
        write_notebook(
            place / "notebook.ipynb",
            case.with_model(identification.model_given),
            results,
            held_out=not shown.isdisjoint({"held-out", "predicted-record"}),
            loops="loops" in shown,
        )
    return place / "report.html"


def _make_folder(folder: Path) -> Path:
    """Return a folder, made if missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise RsgenError(f"{folder}: cannot be made: {fault.strerror or fault}") from fault
    return folder


def check_printed(subject: Subject, identification: Identification) -> tuple[PrintedComparison, ...]:
    """Hold every formula that the source prints against the derivation, with the refined values.

    Raises
    ------
    RsgenError
        A formula is of something else than stiffness or damping, or has names that the law does not have.
    """
    model = identification.model
    values = {name: float(identification.values[name]) for name in model.parameters}
    low, high = identification.amplitude_range
    if not (subject.printed and np.isfinite(list(values.values())).all() and 0 < low < high):
        return ()
    omega = np.pi * sum(identification.frequency_range)
    return compare_printed(
        derive(model.force), subject.printed, values, np.linspace(low, high, POINTS), omega
    )


# ----------------------------------------------------------------------------
# What is another thing for a surface and for spectra: files, figures, and what is predicted of them.


def save_records(table: ResponseSurface | MultisineSpectra, place: Path) -> None:
    """Write the records of a test."""
    if isinstance(table, MultisineSpectra):
        save_spectra(place / "spectra.npz", table)
    else:
        save_surface(place / "surface.h5", table)
