"""What `rsgen run` does: cases from file to report, and what became of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rsgen.app.cli.progress_bar import case_progress
from rsgen.app.cli.terminal import ACCEPTED, FAULTY, print_cache_fault, print_json, print_line, verdict_code
from rsgen.app.study import CaseRun, run_cases
from rsgen.cases import find_cases
from rsgen.common.errors import RsgenError

__all__ = ["check_figures", "exit_code", "run_command"]

FIGURE_KINDS = ("pdf", "svg", "png")


def exit_code(runs: Sequence[CaseRun]) -> int:
    """Give 2 if a case failed, else 1 if a result is missed, doubtful or rejected, else 0."""
    if any(run.verdict is None for run in runs):
        return FAULTY
    return max((verdict_code(run.verdict["state"]) for run in runs if run.verdict), default=ACCEPTED)


def check_figures(kind: str | None) -> None:
    """Refuse kinds of figures that are not written."""
    if kind not in (None, *FIGURE_KINDS):
        raise RsgenError(f"--figures {kind}: must be one of {', '.join(FIGURE_KINDS)}")


def run_command(
    cases: list[Path],
    out: Path,
    force: bool,
    data: Path | None,
    jobs: int | None,
    figures: str | None,
    json: bool,
    cluster: str | None = None,
) -> int:
    """Run cases; the code is that of ``exit_code``."""
    print_cache_fault()
    check_figures(figures)
    words = ("rsgen", "run", *(path.name for path in cases), *(("--force",) if force else ()))
    if figures:
        words += ("--figures", figures)
    with case_progress(len(find_cases(cases)), quiet=json) as seen:
        runs = run_cases(
            cases,
            out,
            force=force,
            data=data,
            command=words,
            figures=figures,
            workers=jobs,
            cluster=cluster,
            **seen._asdict(),
        )
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
