"""What `rsgen run` does: cases from file to report, and what became of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rsgen.app.cli.progress_bar import case_progress
from rsgen.app.cli.targets import SURFACE, check_target, inputs_of, is_foreign, refuse_foreign
from rsgen.app.cli.terminal import ACCEPTED, FAULTY, print_cache_fault, print_json, print_line, verdict_code
from rsgen.app.study import CaseRun, obtain_table, run_cases
from rsgen.app.study.folder import check_index
from rsgen.app.study.foresight import refuse_ranking
from rsgen.cases import Case, find_cases, load_case
from rsgen.common.errors import RsgenError
from rsgen.data.multisine import MultisineSpectra
from rsgen.data.surface import ResponseSurface, save_surface
from rsgen.dynamics.simulation import SimulatedTest
from rsgen.files import MeasuredTest
from rsgen.report import write_index
from rsgen.report.figures.cycles import shows_loops
from rsgen.report.files import write_multisine_notebook
from rsgen.report.interpretation import mean_finding
from rsgen.report.notebook import KnownResults, write_notebook
from rsgen.report.provenance import is_lesson_as_written
from rsgen.report.result_json import read_results

__all__ = ["check_figures", "exit_code", "notebook_command", "report_command", "run_command"]


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


# ----------------------------------------------------------------------------
# What `rsgen report` does: reports anew from the surfaces that earlier runs left.


def report_command(cases: list[Path], out: Path, data: Path | None, figures: str | None, json: bool) -> int:
    """Write reports from saved surfaces, then the index; without cases the index alone."""
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


# ----------------------------------------------------------------------------
# What `rsgen notebook` does: the lesson on a case, executed, without a report around it.


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
