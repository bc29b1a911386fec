"""The command `rsgen simulate`: the records of a simulated case as a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rsgen.app.cli.options import (
    SPECTRA,
    SURFACE,
    Json,
    OneCase,
    check_target,
    inputs_of,
    is_foreign,
    refuse_foreign,
)
from rsgen.app.cli.progress_bar import print_cache_fault, stage_progress
from rsgen.app.cli.terminal import ACCEPTED, MISSED, print_json, print_line
from rsgen.app.study import obtain_table
from rsgen.cases import load_case
from rsgen.common.errors import RsgenError, shown_path
from rsgen.data.multisine import MultisineSpectra, save_spectra
from rsgen.data.surface import save_surface


def simulate_command(
    case: OneCase,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The file to write.", show_default="<name>.h5, <name>.npz"),
    ] = None,
    json: Json = False,
) -> int:
    """Simulate the test of a case and write the response surface as HDF5 (h5py, MATLAB, Julia read it).

    The spectra of a multisine are written as a file of numpy (.npz).

    \b
    Example:
      rsgen simulate cases/cubic.toml --out cubic.h5
    """
    print_cache_fault()
    loaded = load_case(case)
    if loaded.oscillator is None:
        raise RsgenError(
            f"{shown_path(case)}: test.kind: is 'measured'; only a simulated test can be simulated"
        )
    lines = loaded.test.many_lines
    ending = ".npz" if lines else ".h5"
    target = out or Path(f"{loaded.name}{ending}")
    refuse_foreign(target, is_foreign(target, SPECTRA if lines else SURFACE), inputs_of(loaded))
    check_target(target, ending, "--out")
    with stage_progress(loaded.path) as note:
        surface = obtain_table(loaded, lambda share: note("surface", share))
    if isinstance(surface, MultisineSpectra):
        save_spectra(target, surface)
        size = {"records": len(surface), "periods": surface.periods, "lines": int(surface.lines[-1])}
        if json:
            print_json({"case": loaded.name, "file": str(target), **size})
        else:
            said = ", ".join(f"{count} {name if count > 1 else name[:-1]}" for name, count in size.items())
            print_line(f"{loaded.name}: {said}: {target}")
        return ACCEPTED
    save_surface(target, surface)
    settled = int(surface.settled.sum())
    if json:
        print_json({"case": loaded.name, "file": str(target), "points": len(surface), "settled": settled})
    else:
        print_line(f"{loaded.name}: {len(surface)} points, {settled} settled: {target}")
        if not settled:
            print_line(
                "no point settled: check the values of [truth], their signs first; levels and frequencies"
            )
    return ACCEPTED if settled else MISSED
