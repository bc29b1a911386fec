"""The command `rsgen report`: reports anew from the surfaces that earlier runs left."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rsgen.app.cli.options import Data, Figures, Json, Out
from rsgen.app.cli.progress_bar import case_progress
from rsgen.app.cli.run_command import check_figures, exit_code
from rsgen.app.cli.terminal import ACCEPTED, print_json, print_line
from rsgen.app.study import run_cases
from rsgen.app.study.folder import check_index
from rsgen.cases import find_cases
from rsgen.common.errors import RsgenError
from rsgen.report import write_index
from rsgen.report.result_json import read_results


def report_command(
    cases: Annotated[
        list[Path] | None, typer.Argument(help="Case files, or folders of them.", show_default=False)
    ] = None,
    out: Out = Path("reports"),
    data: Data = None,
    figures: Figures = None,
    json: Json = False,
) -> int:
    """Write reports anew from surfaces that earlier runs left; without a case, only index and table.

    \b
    Examples:
      rsgen report
      rsgen report cases/cubic.toml
      rsgen report cases/cubic.toml --figures pdf
    """
    check_figures(figures)
    if figures and not cases:
        raise RsgenError("--figures: is for the reports of cases; name them")
    if not out.is_dir():
        raise RsgenError(f"{out}: is no folder of results; run `rsgen run` first or give --out")
    index = out / "index.html"
    if not cases:
        check_index(out)
        write_index(out)
        verdicts = {entry.folder.name: entry.verdict for entry in read_results(out)}
        if json:
            print_json({"index": str(index), "cases": [], "verdicts": verdicts})
        else:
            for name, verdict in verdicts.items():
                print_line(f"{name}: {verdict['headline']}")
            print_line(f"Table of all results: {index}")
        return ACCEPTED
    with case_progress(len(find_cases(cases)), quiet=json) as seen:
        runs = run_cases(cases, out, data=data, figures=figures, reuse_surface=True, **seen._asdict())
    if json:
        names = [run.name for run in runs]
        print_json({"index": str(index), "cases": names, "verdicts": {run.name: run.verdict for run in runs}})
    return exit_code(runs)
