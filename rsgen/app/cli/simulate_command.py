"""The command `rsgen simulate`: the records of a simulated case as a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rsgen.app.cli.options import SPECTRA, SURFACE, Json, OneCase, checked_target
from rsgen.app.cli.progress_bar import print_cache_fault, stage_progress
from rsgen.app.cli.terminal import DOUBTED_RESULT, USABLE_RESULT, print_json, print_line
from rsgen.app.study.run_case import obtain_table
from rsgen.cases.loading import load_case
from rsgen.common.errors import RsgenError, shown_path
from rsgen.data.multisine.spectra import MultisineSpectra, save_spectra
from rsgen.data.surface.response_surface import save_surface


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
    ending, mark = (".npz", SPECTRA) if loaded.test.many_lines else (".h5", SURFACE)
    target = checked_target(out or Path(f"{loaded.name}{ending}"), ending, mark, "--out", loaded)
    with stage_progress(loaded.path) as note:
        surface = obtain_table(loaded, lambda share: note("surface", share))
    if isinstance(surface, MultisineSpectra):
        save_spectra(target, surface)
        size = {"records": len(surface), "periods": surface.periods, "lines": int(surface.lines[-1])}
        said = ", ".join(f"{count} {name if count > 1 else name[:-1]}" for name, count in size.items())
    else:
        save_surface(target, surface)
        size = {"points": len(surface), "settled": int(surface.settled.sum())}
        said = "{points} points, {settled} settled".format_map(size)
    if json:
        print_json({"case": loaded.name, "file": str(target), **size})
    else:
        print_line(f"{loaded.name}: {said}: {target}")
        if not size.get("settled", 1):
            print_line(
                "no point settled: check the values of [truth], their signs first; levels and frequencies"
            )
    return USABLE_RESULT if size.get("settled", 1) else DOUBTED_RESULT
