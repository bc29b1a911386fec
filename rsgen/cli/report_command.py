"""What `rsgen report` does: reports anew from the surfaces that earlier runs left."""

from __future__ import annotations

from pathlib import Path

from rsgen.case import find_cases
from rsgen.cli.progress_bar import case_progress
from rsgen.cli.run_command import check_figures, exit_code
from rsgen.cli.terminal import print_json, print_line
from rsgen.errors import RsgenError
from rsgen.report import write_index
from rsgen.study import rewrite_report

__all__ = ["report_command"]


def report_command(cases: list[Path], out: Path, data: Path | None, figures: str | None, json: bool) -> int:
    """Write reports from saved surfaces, then the index; without cases the index alone."""
    check_figures(figures)
    if figures and not cases:
        raise RsgenError("--figures: is for the reports of cases; name them")
    if not out.is_dir():
        raise RsgenError(f"{out}: is no folder of results; run `rsgen run` first or give --out")
    runs = []
    if cases:
        files = find_cases(cases)
        with case_progress(len(files), quiet=json) as listener:
            for path in files:
                words = ("rsgen", "report", path.name)
                runs.append(rewrite_report(path, out, data, words, figures, listener.progress))
                listener.finished(runs[-1])
    if not cases or any(run.folder for run in runs):
        write_index(out)
    if json:
        print_json({"index": str(out / "index.html"), "cases": [run.name for run in runs]})
    elif not cases:
        print_line(f"Table of all results: {out / 'index.html'}")
    return exit_code(runs)
