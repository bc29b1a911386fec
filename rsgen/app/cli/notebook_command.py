"""The command `rsgen notebook`: the lesson on a case, executed, without a report around it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rsgen.app.cli.options import (
    SURFACE,
    Data,
    Json,
    OneCase,
    check_target,
    inputs_of,
    is_foreign,
    refuse_foreign,
)
from rsgen.app.cli.terminal import ACCEPTED, print_json, print_line
from rsgen.app.study import obtain_table
from rsgen.cases import Case, load_case
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import ResponseSurface, save_surface
from rsgen.dynamics.simulation import SimulatedTest
from rsgen.files import MeasuredTest
from rsgen.report.figures.cycles import shows_loops
from rsgen.report.files import write_multisine_notebook
from rsgen.report.interpretation import mean_finding
from rsgen.report.notebook import KnownResults, write_notebook
from rsgen.report.provenance import is_lesson_as_written

__all__ = ["notebook_command"]


def notebook_command(
    case: OneCase,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The notebook.", show_default="<name>.ipynb")
    ] = None,
    data: Data = None,
    json: Json = False,
) -> int:
    """Write the executed notebook of a case: what, why, formula, code and figure, step by step.

    \b
    Examples:
      rsgen notebook cases/cubic.toml
      rsgen notebook cases/cubic.toml --out lesson.ipynb
    """
    loaded = load_case(case, data)
    target = check_target(out or Path(f"{loaded.name}.ipynb"), ".ipynb")
    refuse_foreign(target, not is_lesson_as_written(target), inputs_of(loaded))
    if isinstance(loaded.test, MeasuredTest):
        saved = target.with_suffix(".h5")
        refuse_foreign(saved, is_foreign(saved, SURFACE), inputs_of(loaded))
    surface = obtain_table(loaded)
    results = KnownResults(loaded)
    beside = None
    if isinstance(surface, MultisineSpectra):
        write_multisine_notebook(target, loaded, surface, results)
    else:
        beside = _sines(target, loaded, surface, results)
    if json:
        print_json({"case": loaded.name, "file": str(target), "surface": str(beside) if beside else None})
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
