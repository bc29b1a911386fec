"""What is seen of long work: a line a finished case and, on a terminal, a bar with the time left for each."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rsgen.cli.terminal import plain, print_faults

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from rsgen.case import Case
    from rsgen.study import CaseRun, Step

__all__ = ["Listener", "case_progress", "stage_progress", "time_left"]

_DOING = {"surface": "simulating", "identification": "identifying", "report": "writing the report"}
_ALMOST = 0.97
"""Nothing is done before it is done, however long it takes."""


@dataclass(frozen=True, slots=True)
class Listener:
    """What the work calls: ``finished`` after each case, ``tell`` now and then; None where nobody looks."""

    finished: Callable[[CaseRun], None]
    tell: Callable[[Step], None] | None = None


@dataclass(slots=True)
class _Seen:
    """The last step of a case, when it came [s], when its stage began [s], and the bar that shows it."""

    step: Step
    at: float
    begun: float
    task: TaskID


def time_left(step: Step, since_begin: float, since_step: float) -> tuple[float, float]:
    """Give the share of the whole case that is done, and the seconds that are left.

    Parameters
    ----------
    step
        The last step that was told.
    since_begin, since_step
        Seconds since its stage began and since it was told.

    Examples
    --------
    A stage that does not tell its share is taken to last as long as expected:

    >>> from rsgen.study import Step
    >>> expected = {"surface": 10.0, "identification": 20.0, "report": 10.0}
    >>> time_left(Step(Path("a.toml"), "identification", 0.0, expected), 5.0, 5.0)
    (0.375, 25.0)

    One that does is taken to go on as it went:

    >>> time_left(Step(Path("a.toml"), "surface", 0.25, expected), 5.0, 1.0)
    (0.0625, 41.0)
    """
    stages = list(step.expected)
    here = stages.index(step.stage)
    before, after = (
        sum(step.expected[stage] for stage in part) for part in (stages[:here], stages[here + 1 :])
    )
    own = step.expected[step.stage]
    if step.share > 0:
        share = step.share
        left = max((since_begin - since_step) / share * (1 - share) - since_step, 0.0)
    else:
        share = min(since_begin / own, _ALMOST)
        left = max(own - since_begin, 0.0)
    return (before + share * own) / (before + own + after), left + after


def _in_words(seconds: float) -> str:
    if seconds < 1:
        return "a moment left"
    if seconds < 90:
        return f"about {seconds:.0f} s left"
    return f"about {seconds / 60:.0f} min left" if seconds < 5400 else f"about {seconds / 3600:.1f} h left"


@dataclass(slots=True)
class _Bars:
    """A bar for each case that is being worked on, brought up to date a few times a second."""

    progress: Progress
    seen: dict[Path, _Seen] = field(default_factory=dict)

    def tell(self, step: Step) -> None:
        now = time.monotonic()
        old = self.seen.get(step.path)
        task = self.progress.add_task("", total=1.0, left="") if old is None else old.task
        begun = now if old is None or old.step.stage != step.stage else old.begun
        self.seen[step.path] = _Seen(step, now, begun, task)

    def refresh(self) -> None:
        now = time.monotonic()
        for path, seen in list(self.seen.items()):
            share, left = time_left(seen.step, now - seen.begun, now - seen.at)
            words = f"{plain(path.stem)}: {_DOING[seen.step.stage]}"
            # another thread draws: the case may be finished meanwhile
            with suppress(KeyError):
                self.progress.update(seen.task, completed=share, description=words, left=_in_words(left))

    def finish(self, path: Path) -> None:
        seen = self.seen.pop(path, None)
        if seen is not None:
            self.progress.remove_task(seen.task)


@contextmanager
def _bars() -> Iterator[_Bars]:
    # rich is slow to import, so only where its bars are seen; it obeys NO_COLOR by itself
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task
    from rich.text import Text

    # rich renders once before there is anything to show
    shown: list[_Bars] = []

    class Words(ProgressColumn):
        def __init__(self, key: str) -> None:
            self.key = key
            super().__init__()

        def render(self, task: Task) -> Text:
            # text, never markup: names come from files
            return Text(task.description if self.key == "description" else str(task.fields[self.key]))

    class Live(Progress):
        def get_renderables(self):  # type: ignore[no-untyped-def]
            for bars in shown:
                bars.refresh()
            yield from super().get_renderables()

    console = Console(stderr=True)
    progress = Live(Words("description"), BarColumn(), Words("left"), console=console, transient=True)
    shown.append(_Bars(progress))
    with progress:
        yield shown[0]


def _line(run: CaseRun) -> str:
    if run.passed is None:
        return f"{run.name}: failed"
    state = "accepted" if run.passed else "NOT accepted"
    if not run.judged:
        state = "identified, nothing was judged (no [accept])"
    how = "unchanged" if run.skipped else f"{run.seconds:.1f} s"
    return f"{run.name}: {state} ({how}) {run.folder}"


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
            if not quiet and run.passed is not None:
                print(plain(_line(run)), flush=True)
            print_faults(run.faults)

        yield Listener(note)
        return

    with _bars() as bars:
        progress = bars.progress
        cases = progress.add_task("cases", total=total, left=f"0 of {total}")
        done: list[Path] = []

        def advance(run: CaseRun) -> None:
            bars.finish(run.path)
            for fault in run.faults:
                progress.console.print(plain(fault), markup=False, highlight=False, soft_wrap=True)
            if not quiet and run.passed is not None:
                progress.console.print(plain(_line(run)), markup=False, highlight=False, soft_wrap=True)
            done.append(run.path)
            progress.update(cases, completed=len(done), left=f"{len(done)} of {total}")

        yield Listener(advance, bars.tell)


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
    from rsgen.study import Step, expect

    whole = expect(case).seconds
    expected = {stage: whole[stage] for stage in stages}
    with _bars() as bars:
        yield lambda stage, share: bars.tell(Step(case.path, stage, share, expected))
