"""What `rsgen notebook` does: the lesson on a case, executed, without a report around it."""

from __future__ import annotations

from pathlib import Path

from rsgen.app.cli.targets import SURFACE, check_target, inputs_of, is_foreign, refuse_foreign
from rsgen.app.cli.terminal import ACCEPTED, print_json, print_line
from rsgen.app.study import obtain_table
from rsgen.app.study.foresight import refuse_ranking
from rsgen.cases import Case, load_case
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import ResponseSurface, save_surface
from rsgen.dynamics.simulation import SimulatedTest
from rsgen.files import MeasuredTest
from rsgen.report.figures.cycles import shows_loops
from rsgen.report.interpretation import mean_finding
from rsgen.report.lesson_mark import is_lesson_as_written
from rsgen.report.multisine_notebook import write_multisine_notebook
from rsgen.report.notebook import write_notebook
from rsgen.report.notebook_cells import KnownResults

__all__ = ["notebook_command"]


def notebook_command(path: Path, out: Path | None, data: Path | None, json: bool) -> int:
    """Write the executed notebook of a case; a measured surface is saved beside it."""
    case = load_case(path, data)
    target = check_target(out or Path(f"{case.name}.ipynb"), ".ipynb")
    refuse_foreign(target, not is_lesson_as_written(target), inputs_of(case))
    if isinstance(case.test, MeasuredTest):
        saved = target.with_suffix(".h5")
        refuse_foreign(saved, is_foreign(saved, SURFACE), inputs_of(case))
    surface = obtain_table(case)
    results = KnownResults(case)
    beside = None
    if isinstance(surface, MultisineSpectra):
        refuse_ranking(case)
        write_multisine_notebook(target, case, surface, results)
    else:
        beside = _sines(target, case, surface, results)
    if json:
        print_json({"case": case.name, "file": str(target), "surface": str(beside) if beside else None})
    else:
        print_line(f"{target}" + (f", which reads {beside}" if beside else ""))
    return ACCEPTED


def _sines(target: Path, case: Case, surface: ResponseSurface, results: KnownResults) -> Path | None:
    """Write the notebook of a case with a response surface; the file of the surface where it was measured."""
    beside = None
    if isinstance(case.test, SimulatedTest):
        results.add("simulate", case.oscillator, case.test, result=surface)
    else:
        beside = target.with_suffix(".h5")
        save_surface(beside, surface)
        results.add("load_surface", beside.name, result=surface)
    write_notebook(
        target,
        case,
        results,
        mean=mean_finding(surface) is not None,
        held_out=bool(case.model.observation.hold_out),
        loops=shows_loops(surface, case.model),
        surface_file=beside.name if beside else "surface.h5",
    )
    return beside
