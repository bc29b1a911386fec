"""Progress display of `rsgen run`: a line for each finished case; on a terminal how many are finished."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

from rsgen.app.cli.terminal import plain, print_faults, print_line
from rsgen.app.study.run_case import CaseRun, Step, obtain_table
from rsgen.cases.case import Case
from rsgen.cases.loading import load_case
from rsgen.common.finding import next_lines, verdict_lines
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.kernel import cache_fault
from rsgen.formula.units import count_text


def print_cache_fault() -> None:
    """Say once why nothing compiled is stored, before a command that compiles."""
    fault = cache_fault()
    if fault is not None:
        print_faults([f"note: compiled kernels are not stored, so every run compiles them: {fault}"])


_Callbacks = tuple[Callable[[CaseRun], None], Callable[[Step], None] | None]
"""Of a run: after each case, and now and then on a terminal."""

_MAX_WARNINGS = 5
"""So many a case are printed; the others are counted."""


def _lines(run: CaseRun, *, values: bool) -> list[str]:
    """Return the lines of a finished case: verdict, folder, reasons, held-out levels, counts; [] of none.

    Those of its values come only if they are asked for: many cases would fill the terminal.
    """
    if run.verdict is None:
        return []
    headline, *reasons = verdict_lines(run.verdict)
    how = "unchanged" if run.skipped else f"{run.seconds:.1f} s"
    held_out = (f"  {line}" for line in run.held_out)
    warned = run.warned[:_MAX_WARNINGS] if values else ()
    unsaid = run.warnings - len(warned)
    counted = ((unsaid, "more warning" if warned else "warning"), (run.notes, "note"))
    more = " and ".join(count_text(number, name) for number, name in counted if number)
    return [
        f"{run.name}: {headline} ({how}) {run.folder}",
        *reasons,
        *(run.values if values else ()),
        *held_out,
        *warned,
        *([f"  {more} in report.html"] if more else []),
        *next_lines(run.verdict),
    ]


@contextmanager
def case_progress(total: int, quiet: bool) -> Iterator[_Callbacks]:
    """Print each case when it is finished and, on a terminal, show how many are, or how far one has come.

    Parameters
    ----------
    total
        Number of cases.
    quiet
        True where standard output is for a program: nothing but faults is printed then.
    """
    if not sys.stderr.isatty():

        def note(run: CaseRun) -> None:
            for line in [] if quiet else _lines(run, values=total == 1):
                print_line(line, flush=True)
            print_faults(run.faults)

        yield note, None
        return
    with Bars(total) as bars:

        def show(run: CaseRun) -> None:
            bars.finish()
            for line in (*run.faults, *([] if quiet else _lines(run, values=total == 1))):
                bars.say(line)

        yield show, bars.show


@contextmanager
def stage_progress(case: Path) -> Iterator[Callable[[str, float], None]]:
    """Show how far the case of a file has come, on a terminal; yield what the work calls."""
    if not sys.stderr.isatty():
        yield lambda stage, share: None
        return
    with Bars() as bars:
        yield lambda stage, share: bars.show(Step(case, stage, share))


@contextmanager
def tested_case(
    path: Path, data: Path | None
) -> Iterator[tuple[Case, ResponseSurface | MultisineSpectra, Callable[[str, float], None]]]:
    """Load a case, and simulate or read its test; yield both and what further work calls."""
    print_cache_fault()
    case = load_case(path, data)
    with stage_progress(case.path) as note:
        note("surface", 0.0)
        yield case, obtain_table(case), note


_AS_TEXT = TextColumn("{task.description}", markup=False)
"""Case and stage; names come from files, and are no markup."""
_DOING = {
    "surface": "simulating",
    "identification": "identifying",
    "prediction": "predicting curves",
    "report": "writing the report",
    "ranking": "comparing laws",
}


class Bars(Progress):
    """A line for all cases and one for the case that runs in this process: spinner, stage, elapsed time.

    NO_COLOR is obeyed by rich itself.

    Parameters
    ----------
    total
        Number of cases; None for a single one, which has its line alone.
    """

    def __init__(self, total: int | None = None) -> None:
        self._total, self._finished = total, 0
        self._case: TaskID | None = None
        # this very stream: sys.stderr is another one while the cells of a notebook run
        console = Console(file=sys.stderr)
        super().__init__(SpinnerColumn(), _AS_TEXT, TimeElapsedColumn(), console=console, transient=True)
        self._all = self.add_task(f"cases: 0 of {total}", visible=bool(total))

    def show(self, step: Step) -> None:
        """Show to which stage a case has come, and its share where the stage reports one."""
        share = f" {step.share:.0%}" if step.share > 0 else ""
        said = f"{plain(step.path.stem)}: {_DOING[step.stage]}{share}"
        if self._case is None:
            self._case = self.add_task(said, total=None)
        else:
            self.update(self._case, description=said)

    def finish(self) -> None:
        """Take away the line of the case that ran here, and count one."""
        if self._case is not None:
            self.remove_task(self._case)
            self._case = None
        self._finished += 1
        self.update(self._all, description=f"cases: {self._finished} of {self._total}")

    def say(self, line: str) -> None:
        """Print a line above the others."""
        self.console.print(plain(line), markup=False, highlight=False, soft_wrap=True)
