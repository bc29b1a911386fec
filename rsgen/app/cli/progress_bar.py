"""What is seen of long work: a line a finished case and, on a terminal, how far the others have come."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from rsgen.app.cli.terminal import print_faults, print_line
from rsgen.app.study import CaseRun, Step, expect
from rsgen.cases import Case
from rsgen.common.finding import verdict_lines

__all__ = ["Listener", "case_progress", "stage_progress"]


class Listener(NamedTuple):
    """What the work calls: ``finished`` after each case, ``progress`` now and then where somebody looks."""

    finished: Callable[[CaseRun], None]
    progress: Callable[[Step], None] | None = None


def _lines(run: CaseRun) -> list[str]:
    """Say what became of a case: its verdict with where the result is, then what decided; [] if it failed."""
    if run.verdict is None:
        return []
    headline, *reasons = verdict_lines(run.verdict)
    how = "unchanged" if run.skipped else f"{run.seconds:.1f} s"
    return [f"{run.name}: {headline} ({how}) {run.folder}", *reasons]


@contextmanager
def case_progress(total: int, quiet: bool) -> Iterator[Listener]:
    """Print each case when it is finished and, on a terminal, show how far the others have come.

    Parameters
    ----------
    total
        Number of cases.
    quiet
        True where standard output is for a program: nothing but faults is printed then.
    """
    if not sys.stderr.isatty():

        def note(run: CaseRun) -> None:
            for line in [] if quiet else _lines(run):
                print_line(line, flush=True)
            print_faults(run.faults)

        yield Listener(note)
        return
    # rich is slow to import
    from rsgen.app.cli.bars import Bars

    with Bars(total) as bars:

        def show(run: CaseRun) -> None:
            bars.finish(run.path)
            for line in (*run.faults, *([] if quiet else _lines(run))):
                bars.say(line)

        yield Listener(show, bars.show)


@contextmanager
def stage_progress(case: Case, *stages: str) -> Iterator[Callable[[str, float], None]]:
    """Show how far one case has come through some stages, on a terminal; give what the work calls.

    Parameters
    ----------
    stages
        What will be done, of ``STAGES``.
    """
    if not sys.stderr.isatty():
        yield lambda stage, share: None
        return
    from rsgen.app.cli.bars import Bars

    whole = expect(case)
    expected = {stage: whole.seconds[stage] * whole.crowding for stage in stages}
    with Bars() as bars:
        yield lambda stage, share: bars.show(Step(case.path, stage, share, expected))
