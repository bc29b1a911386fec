"""What is seen of long work: a line a finished case and, on a terminal, a bar for each that is worked on."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID
from rich.text import Text

from rsgen.app.cli.terminal import plain, print_faults, print_line
from rsgen.app.study import CaseRun, Step, expect
from rsgen.cases import Case
from rsgen.common.finding import verdict_lines
from rsgen.dynamics.kernel import cache_fault

__all__ = ["Listener", "case_progress", "print_cache_fault", "stage_progress", "time_left"]


def print_cache_fault() -> None:
    """Say once why nothing compiled is stored, before a command that compiles."""
    fault = cache_fault()
    if fault is not None:
        print_faults([f"note: compiled kernels are not stored, so every run compiles them: {fault}"])


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
    whole = expect(case)
    expected = {stage: whole.seconds[stage] * whole.crowding for stage in stages}
    with Bars() as bars:
        yield lambda stage, share: bars.show(Step(case.path, stage, share, expected))


# ----------------------------------------------------------------------------
# Bars on a terminal, with the time that is left.

_DOING = {"surface": "simulating", "identification": "identifying", "report": "writing the report"}
_ALMOST = 0.97
"""Nothing is done before it is done, however long it takes."""


def time_left(step: Step, since_begin: float, since_step: float) -> tuple[float, float]:
    """Give the share of the whole case that is done, and the seconds that are left.

    Parameters
    ----------
    step
        The last step that was reported.
    since_begin, since_step
        Seconds since its stage began and since it was reported.

    Examples
    --------
    A stage that does not report its share is taken to last as long as expected:

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
    whole = step.expected[step.stage]
    if step.share > 0:
        share = step.share
        left = max((since_begin - since_step) / share * (1 - share) - since_step, 0.0)
    else:
        share = min(since_begin / whole, _ALMOST)
        left = max(whole - since_begin, 0.0)
    return (before + share * whole) / (before + whole + after), left + after


def _in_words(seconds: float) -> str:
    if seconds < 1:
        return "a moment left"
    if seconds < 90:
        return f"about {seconds:.0f} s left"
    return f"about {seconds / 60:.0f} min left" if seconds < 5400 else f"about {seconds / 3600:.1f} h left"


class _Words(ProgressColumn):
    """A field of a bar as text, never as markup: names come from files."""

    def __init__(self, key: str) -> None:
        self.key = key
        super().__init__()

    def render(self, task: Task) -> Text:
        return Text(str(task.fields[self.key]))


@dataclass(slots=True)
class _Seen:
    """The last step of a case, when it came [s], when its stage began [s], and the bar that shows it."""

    step: Step
    at: float
    begun: float
    bar: TaskID


class Bars(Progress):
    """A bar for all cases and one for each that is worked on, brought up to date a few times a second.

    NO_COLOR is obeyed by rich itself.

    Parameters
    ----------
    total
        Number of cases; None for a single one, which has its bar alone.
    """

    def __init__(self, total: int | None = None) -> None:
        self._seen: dict[Path, _Seen] = {}
        # this very stream: sys.stderr is another one while the cells of a notebook run
        console = Console(file=sys.stderr)
        columns = (_Words("doing"), BarColumn(), _Words("left"))
        super().__init__(*columns, console=console, transient=True)
        self._total, self._finished = total or 0, 0
        # without a count the bar of all cases is not seen
        self._whole = self.add_task("", total=total, visible=bool(total), doing="cases", left=f"0 of {total}")

    def show(self, step: Step) -> None:
        """Note how far a case has come."""
        now = time.monotonic()
        old = self._seen.get(step.path)
        bar = self.add_task("", total=1.0, doing="", left="") if old is None else old.bar
        begun = now if old is None or old.step.stage != step.stage else old.begun
        self._seen[step.path] = _Seen(step, now, begun, bar)

    def finish(self, path: Path) -> None:
        """Take away the bar of a case, and count it."""
        seen = self._seen.pop(path, None)
        if seen is not None:
            self.remove_task(seen.bar)
        self._finished += 1
        self.update(self._whole, completed=self._finished, left=f"{self._finished} of {self._total}")

    def say(self, line: str) -> None:
        """Print a line above the bars."""
        self.console.print(plain(line), markup=False, highlight=False, soft_wrap=True)

    def get_renderables(self) -> Iterable[RenderableType]:
        """Bring the bars up to date; rich asks for them whenever it draws, in a thread of its own."""
        now = time.monotonic()
        for path, seen in list(self._seen.items()):
            share, left = time_left(seen.step, now - seen.begun, now - seen.at)
            doing = f"{plain(path.stem)}: {_DOING[seen.step.stage]}"
            # the case may be finished meanwhile
            with suppress(KeyError):
                self.update(seen.bar, completed=share, doing=doing, left=_in_words(left))
        yield from super().get_renderables()
