"""The command `rsgen run`: cases from file to report, and what became of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from rsgen.app.cli.progress_bar import case_progress, print_cache_fault
from rsgen.app.cli.terminal import (
    FAULTY,
    USABLE_RESULT,
    Cases,
    Data,
    Figures,
    Json,
    Out,
    print_json,
    print_line,
    verdict_code,
)
from rsgen.app.study.many_cases import run_cases
from rsgen.app.study.run_case import CaseRun
from rsgen.cases.loading import find_cases
from rsgen.common.errors import RsgenError

FIGURE_KINDS = ("pdf", "svg", "png")


def exit_code(runs: Sequence[CaseRun]) -> int:
    """Return 2 if a case failed, else 1 if a result is missed, doubtful or rejected, else 0."""
    if any(run.verdict is None for run in runs):
        return FAULTY
    return max((verdict_code(run.verdict["state"]) for run in runs if run.verdict), default=USABLE_RESULT)


def run_command(
    cases: Cases,
    out: Out = Path("reports"),
    force: Annotated[bool, typer.Option("--force", "-f", help="Run even what is unchanged.")] = False,
    data: Data = None,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", min=1, max=256, help="Processes at a time.", show_default="processors"),
    ] = None,
    figures: Figures = None,
    json: Json = False,
) -> int:
    """Run cases from file to report; unchanged ones with a verified result are skipped.

    \b
    Examples:
      rsgen run cases
      rsgen run cases/cubic.toml --force
      rsgen run mine.toml --data /mnt/laboratory --out results
      rsgen run mine.toml --figures pdf
    """
    print_cache_fault()
    if figures not in (None, *FIGURE_KINDS):
        raise RsgenError(f"--figures {figures}: must be one of {', '.join(FIGURE_KINDS)}")
    words = ("rsgen", "run", *(path.name for path in cases), *(("--force",) if force else ()))
    if figures:
        words += ("--figures", figures)
    with case_progress(len(find_cases(cases)), quiet=json) as (finished, progress):
        runs = run_cases(
            cases, out, force=force, data=data, command=words, figures=figures, workers=jobs,
            finished=finished, progress=progress,
        )  # fmt: skip
    if json:
        print_json(
            [
                {
                    "case": run.name,
                    "file": str(run.path),
                    "passed": run.passed,
                    "verdict": run.verdict,
                    "skipped": run.skipped,
                    "folder": str(run.folder) if run.folder else None,
                    "seconds": round(run.seconds, 3),
                    "faults": list(run.faults),
                }
                for run in runs
            ]
        )
    elif any(run.folder for run in runs):
        print_line(f"Table of all results: {out / 'index.html'}")
    return exit_code(runs)
