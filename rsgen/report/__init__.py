"""What a run leaves for people and for other programs: result.json, report.html, notebook.ipynb, index."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from rsgen import kernel
from rsgen.case import Case
from rsgen.comparison import Comparison
from rsgen.errors import RsgenError
from rsgen.figures import (
    Drawing,
    choose_levels,
    draw_collapse,
    draw_damping,
    draw_forces,
    draw_held_out,
    draw_map,
    draw_resonance,
    draw_responses,
    draw_stiffness,
    draw_surface,
    draw_time_history,
)
from rsgen.identification import Estimate, Identification
from rsgen.output import write_atomic
from rsgen.prediction import Prediction, predict
from rsgen.report.index import write_index
from rsgen.report.interpretation import describe_mean
from rsgen.report.notebook import known_results, write_notebook
from rsgen.report.page import render_page
from rsgen.report.provenance import collect_provenance
from rsgen.report.result_json import build_result, result_text
from rsgen.report.source_formulas import check_printed
from rsgen.surface import ResponseSurface, save_surface

__all__ = ["draw_all", "write_index", "write_report"]


def draw_all(
    case: Case, surface: ResponseSurface, identification: Identification, prediction: Prediction
) -> list[Drawing]:
    """Draw every figure of the report; those that a case does not need are left out."""
    drawings = [
        draw_surface(surface),
        draw_map(surface),
        draw_resonance(identification),
        draw_collapse(identification),
        draw_stiffness(identification, case.truth),
        draw_damping(identification, case.truth),
        draw_forces(identification, case.truth),
        draw_responses(surface, prediction),
    ]
    if describe_mean(surface, identification) is not None:
        drawings.append(draw_time_history(surface))
    if prediction.held_out:
        drawings.append(draw_held_out(prediction))
    return drawings


def _with_units(
    case: Case, identification: Identification, comparison: Comparison
) -> tuple[Identification, Comparison]:
    """Give every estimate the unit that the case knows; identification sees laws and knows none."""

    def named(estimate: Estimate) -> Estimate:
        return estimate if estimate.unit else replace(estimate, unit=case.units.get(estimate.name, ""))

    rows = tuple(
        replace(
            row,
            unit=row.unit or case.units.get(row.name, ""),
            paper=None if row.paper is None else named(row.paper),
            first_order=None if row.first_order is None else named(row.first_order),
            refined=named(row.refined),
        )
        for row in comparison.rows
    )
    known = replace(
        identification,
        paper=tuple(map(named, identification.paper)),
        first_order=tuple(map(named, identification.first_order)),
        refined=tuple(map(named, identification.refined)),
    )
    return known, replace(comparison, rows=rows)


def write_report(
    folder: str | Path,
    case: Case,
    surface: ResponseSurface,
    identification: Identification,
    comparison: Comparison,
    *,
    durations: Mapping[str, float] | None = None,
    command: Sequence[str] = (),
    figures: str | None = None,
) -> None:
    """Write surface.h5, kernel.py, result.json, report.html and notebook.ipynb into a folder.

    Parameters
    ----------
    folder
        Made if missing; its parent must exist. Every file is written whole or not at all.
    durations
        Seconds of the stages before, for the provenance: "surface", "identification".
    command
        What was called, for the provenance.
    figures
        "pdf", "svg" or "png": every figure is saved as ``figure-<name>.<kind>``, too, for a paper.

    Raises
    ------
    RsgenError
        A file cannot be written, or a cell of the notebook failed. The notebook comes last and is saved even
        then, so that all files are there.
    """
    started = time.perf_counter()
    place = Path(folder)
    try:
        place.mkdir(exist_ok=True)
    except OSError as fault:
        raise RsgenError(f"{place}: cannot be made: {fault.strerror or fault}") from fault
    loaded, found, compared = case, identification, comparison
    case = case.with_model(identification.model)
    identification, comparison = _with_units(case, identification, comparison)
    save_surface(place / "surface.h5", surface)
    write_atomic(place / "kernel.py", kernel.generate(case.model.force))
    # where the test held the amplitude, its levels are no forces; those that the resonances needed are
    tested = choose_levels(surface, 5) if surface.control == "force" else identification.levels.tolist()
    levels = sorted({*tested, *(case.model.observation.hold_out if surface.control == "force" else ())})
    prediction = predict(identification, levels, surface)
    printed = check_printed(case, identification)
    spent = dict(durations or {})
    result = build_result(case, surface, identification, comparison, prediction, printed, spent)
    write_atomic(place / "result.json", result_text(result))
    drawings = draw_all(case, surface, identification, prediction)
    if figures is not None:
        for drawing in drawings:
            write_atomic(place / f"figure-{drawing.name}.{figures}", drawing.render(figures))
    spent["report"] = time.perf_counter() - started
    provenance = collect_provenance(case, surface, spent, command)
    page = render_page(case, surface, identification, comparison, prediction, printed, drawings, provenance)
    write_atomic(place / "report.html", page)
    write_notebook(
        place / "notebook.ipynb",
        case,
        known_results(loaded, surface, found, compared, prediction, levels, drawings),
        mean=describe_mean(surface, identification) is not None,
        held_out=bool(prediction.held_out),
    )
