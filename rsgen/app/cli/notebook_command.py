"""The command `rsgen notebook`: the executed notebook of a case, without a report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast

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
from rsgen.cases import load_case
from rsgen.data.surface import ResponseSurface, save_surface
from rsgen.report.files import shown_of
from rsgen.report.notebook import KnownResults, write_notebook
from rsgen.report.provenance import is_unchanged_notebook


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
      rsgen notebook cases/cubic.toml --out gearbox.ipynb
    """
    loaded = load_case(case, data)
    target = check_target(out or Path(f"{loaded.name}.ipynb"), ".ipynb")
    refuse_foreign(target, not is_unchanged_notebook(target), inputs_of(loaded))
    # a notebook simulates anew, and reads the files of a multisine; a measured surface is saved with it
    surface_file = target.with_suffix(".h5")
    kept = loaded.oscillator is None and not loaded.test.many_lines
    if kept:
        refuse_foreign(surface_file, is_foreign(surface_file, SURFACE), inputs_of(loaded))
    surface = obtain_table(loaded)
    results = KnownResults(loaded)
    results.add("simulate", loaded.oscillator, loaded.test, result=surface)
    results.add("read", loaded, result=surface)
    if kept:
        save_surface(surface_file, cast("ResponseSurface", surface))
        results.add("load_surface", surface_file.name, result=surface)
    write_notebook(
        target,
        loaded,
        results,
        held_out=bool(loaded.model.observation.hold_out),
        surface_file=surface_file.name,
        **shown_of(surface, loaded.model),
    )
    if json:
        print_json({"case": loaded.name, "file": str(target), "surface": str(surface_file) if kept else None})
    else:
        print_line(f"{target}" + (f", which reads {surface_file}" if kept else ""))
    return ACCEPTED
