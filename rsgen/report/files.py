"""The files that a run leaves: surface or spectra, kernel, result.json, page, notebook."""

from __future__ import annotations

import io
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from markupsafe import Markup

from rsgen.analysis.comparison import Comparison, compare
from rsgen.cases import Case
from rsgen.common.errors import RsgenError, require
from rsgen.common.output import write_atomic
from rsgen.data.multisine import BestLinear, MultisineSpectra
from rsgen.data.surface import ResponseSurface, save_surface, typical_amounts
from rsgen.dynamics import kernel
from rsgen.files import MeasuredTest
from rsgen.formula.names import Structural, remembers
from rsgen.formula.units.quantities import choose_scale, count_text, number_text, quantity_text
from rsgen.identification.fitting.points import held_out_mask
from rsgen.identification.lines import MultisineIdentification
from rsgen.identification.prediction import Prediction, predict
from rsgen.identification.prediction.prediction_result import MultisinePrediction, predict_multisine
from rsgen.identification.ranking import Ranking
from rsgen.identification.results import Identification
from rsgen.law.notation import mathml
from rsgen.report.figures import (
    Drawing,
    choose_levels,
    draw_best_linear,
    draw_collapse,
    draw_damping,
    draw_energy,
    draw_forces,
    draw_held_out,
    draw_line_misfit,
    draw_loops,
    draw_map,
    draw_modal,
    draw_predicted_record,
    draw_resonance,
    draw_responses,
    draw_stiffness,
    draw_surface,
    draw_thumbnail,
    draw_time_history,
)
from rsgen.report.figures.cycles import shows_loops
from rsgen.report.figures.drawing import project_style
from rsgen.report.interpretation import check_printed, mean_finding
from rsgen.report.notebook import KnownResults, known_results, render_lesson, save_lesson, write_notebook
from rsgen.report.page import THUMBNAIL, common_context, picture_svg, render_page
from rsgen.report.page_tables import NO_MODAL, Cell, Modal, Table, TableRow, tabulate_mode
from rsgen.report.provenance import Subject, collect_provenance, page_environment
from rsgen.report.result_json import (
    build_result,
    common_entries,
    finite_or_none,
    numbers_or_none,
    resonance_entry,
    result_text,
)
from rsgen.report.wording.sentences import error_text, share_text

__all__ = ["draw_all", "write_multisine_notebook", "write_report"]


def draw_all(
    subject: Subject,
    surface: ResponseSurface,
    identification: Identification,
    prediction: Prediction,
    modal: Modal = NO_MODAL,
) -> list[Drawing]:
    """Draw every figure of the report; those that it does not need are left out."""
    drawings = [draw_surface(surface), draw_map(surface), draw_resonance(identification)]
    if identification.model.sensors:
        # no one amplitude is that of the law: nothing can be drawn over it
        return [*drawings, draw_held_out(prediction)] if prediction.held_out else drawings
    # without a mass no level has a stiffness, and no force of a spring is known; the collapse says so
    clouds, values = identification.curve.stiffness, identification.solution
    empty = len(clouds) > 0 and not np.isfinite(clouds).any() and not np.isfinite(values).all()
    drawings += [
        draw_collapse(identification),
        *([] if empty else [draw_stiffness(identification, subject.truth)]),
        draw_damping(identification, subject.truth),
        draw_responses(surface, prediction),
    ]
    if modal.table is not None:
        drawings.append(draw_modal(modal.table, identification))
    if not (remembers(identification.model.force) or (empty and identification.restoring is None)):
        drawings.append(draw_forces(identification, subject.truth))
    if shows_loops(surface, identification.model) and np.isfinite(identification.mass):
        drawings.append(draw_loops(surface, identification, subject.truth))
        drawings.append(draw_energy(surface, identification, subject.truth))
    if mean_finding(surface, identification) is not None:
        drawings.append(draw_time_history(surface))
    if prediction.held_out:
        drawings.append(draw_held_out(prediction))
    return drawings


@dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    """What a report is made of; ``loaded`` is the case as it was read, None without one."""

    loaded: Case | None
    surface: ResponseSurface | MultisineSpectra
    identification: Identification
    comparison: Comparison

    @classmethod
    def of(cls, given: Sequence[Any], named: Mapping[str, Any]) -> _Parts:
        """Sort the arguments of ``write_report`` by their types."""
        kinds: dict[str, type | tuple[type, ...]] = {
            "case": Case,
            "surface": (ResponseSurface, MultisineSpectra),
            "identification": Identification,
            "comparison": Comparison,
        }
        parts = {name: part for name, part in named.items() if part is not None}
        given = [*given, *(parts.pop(name) for name in [*parts] if not isinstance(parts[name], kinds[name]))]
        for part in given:
            if isinstance(part, Ranking):
                raise RsgenError(
                    "write_report: a Ranking is no result yet; give ranking.best, its best law identified"
                )
            name = next((name for name, kind in kinds.items() if isinstance(part, kind)), None)
            if name is None or name in parts:
                fault = "is none of them" if name is None else f"is a second {name}"
                raise RsgenError(
                    f"write_report: a {type(part).__name__} {fault}; a report is made of a ResponseSurface "
                    "and an Identification, and of a Case and a Comparison where there are any"
                )
            parts[name] = part
        missing = [name for name in ("surface", "identification") if name not in parts]
        if missing:
            raise RsgenError(f"write_report: {' and '.join(missing)} missing")
        case, found = parts.get("case"), parts["identification"]
        known = None if case is None else case.with_model(found.model)
        judged = parts.get("comparison")
        if judged is None:
            judged = compare(found) if known is None else compare(found, known.truth, known.accept)
        return cls(case, parts["surface"], found, judged)


def write_report(
    folder: str | Path,
    *parts: Case | ResponseSurface | MultisineSpectra | Identification | Comparison,
    case: Case | None = None,
    surface: ResponseSurface | MultisineSpectra | None = None,
    identification: Identification | None = None,
    comparison: Comparison | None = None,
    title: str = "",
    source: str = "",
    durations: Mapping[str, float] | None = None,
    command: Sequence[str] = (),
    figures: str | None = None,
) -> None:
    """Write surface.h5, kernel.py, modal.csv, result.json and report.html; with a case also a notebook.

    Of a multisine ``surface`` are its spectra, which go into spectra.npz; it has no modal.csv.

    ``write_report(folder, surface, identification)`` is enough, by position or by name;
    ``write_report(folder, case, surface, identification, comparison)`` adds heading, source and truth.

    Parameters
    ----------
    folder
        Made if missing. Every file is written whole or not at all.
    case
        Its title, source, truth and text are shown, and notebook.ipynb is written from it.
    surface, identification
        The test, and what was identified from it.
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
        Surface or identification are missing, a file cannot be written, or a cell of the notebook failed. The
        notebook comes last and is saved even then, so that all files are there.
    """
    require(folder, (str, Path), "folder")
    named = {"case": case, "surface": surface, "identification": identification, "comparison": comparison}
    given = _Parts.of(parts, named)
    started = time.perf_counter()
    place = Path(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise RsgenError(f"{place}: cannot be made: {fault.strerror or fault}") from fault
    if given.loaded is not None:
        subject = Subject.of_case(given.loaded, given.identification)
    else:
        subject = Subject.of_result(given.identification, place.resolve().name, title, source)
    _write_files(place, subject, given, dict(durations or {}), command, figures, started)


@project_style()
def _write_files(
    place: Path,
    subject: Subject,
    given: _Parts,
    spent: dict[str, float],
    command: Sequence[str],
    figures: str | None,
    started: float,
) -> None:
    surface = given.surface
    if isinstance(surface, MultisineSpectra):
        write_multisine_files(
            place,
            subject,
            given.loaded,
            surface,
            given.identification,
            given.comparison,
            spent,
            command,
            figures,
            started,
        )
        return
    identification = subject.with_units(given.identification)
    comparison = subject.with_units(given.comparison)
    save_surface(place / "surface.h5", surface)
    if not identification.model.force.has(Structural):
        # structural damping exists under periodic motion only, so that nothing simulates it
        write_atomic(place / "kernel.py", kernel.generate(identification.model.force))
    levels = [] if identification.model.sensors else _levels(surface, identification)
    prediction = predict(identification, levels or None, surface)
    printed = check_printed(subject, identification)
    modal = tabulate_mode(surface, identification)
    if modal.table is not None:
        write_atomic(place / "modal.csv", modal.table.to_csv())
    result = build_result(subject, surface, identification, comparison, prediction, printed, spent, modal)
    write_atomic(place / "result.json", result_text(result))
    write_atomic(place / THUMBNAIL, picture_svg(draw_thumbnail(surface)))
    drawings = draw_all(subject, surface, identification, prediction, modal)
    for drawing in drawings if figures is not None else ():
        write_atomic(place / f"figure-{drawing.name}.{figures}", drawing.render(str(figures)))
    spent["report"] = time.perf_counter() - started
    provenance = collect_provenance(given.loaded, surface, spent, command)
    page = render_page(
        subject, surface, identification, comparison, prediction, printed, drawings, provenance, modal
    )
    write_atomic(place / "report.html", page)
    if given.loaded is None:
        return
    known = known_results(
        given.loaded, surface, given.identification, given.comparison, prediction, levels, drawings, modal
    )
    write_notebook(
        place / "notebook.ipynb",
        given.loaded.with_model(identification.model),
        known,
        mean=mean_finding(surface, identification) is not None,
        held_out=bool(prediction.held_out),
        loops=any(drawing.name == "loops" for drawing in drawings),
    )


def _levels(surface: ResponseSurface, identification: Identification) -> list[float]:
    """Choose the forces [N] to predict: those measured near the resonances of tested and held-out levels."""
    if surface.response_held:
        # its levels are no forces; those that the resonances needed are
        return [float(level) for level in identification.levels]
    held_out = surface.level[held_out_mask(surface, identification.model)]
    chosen = np.isin(surface.levels, [*choose_levels(surface, 5), *held_out])
    forces = typical_amounts(surface)[chosen]
    return sorted({float(force) for force in forces if np.isfinite(force)})


# ----------------------------------------------------------------------------
# Of a run on a multisine: the lesson, spectra, kernel, result.json, page.


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
