"""The only place that prints: results to standard output, faults and progress to standard error."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from rsgen.study import CaseRun

__all__ = [
    "case_progress",
    "number",
    "print_block",
    "print_faults",
    "print_json",
    "print_line",
    "print_table",
]

_MOST_FAULTS = 500


def _plain(text: str) -> str:
    """Show control characters of a file's texts as escapes: a terminal obeys them otherwise."""
    return "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in text)


def print_line(text: str = "") -> None:
    """Print a line of a result."""
    print(_plain(text))


def print_block(head: str, text: str) -> None:
    """Print a label and a text whose further lines stand under its first."""
    first, *more = text.split("\n")
    print_line(head + first)
    for line in more:
        print_line(" " * len(head) + line)


def print_faults(faults: Iterable[str]) -> None:
    """Print one line a fault to standard error."""
    lines = list(faults)
    for line in lines[:_MOST_FAULTS]:
        print(_plain(line), file=sys.stderr)
    if len(lines) > _MOST_FAULTS:
        print(f"... and {len(lines) - _MOST_FAULTS} more", file=sys.stderr)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return value


def print_json(value: Any) -> None:
    """Print a value as JSON; NaN and infinity, which JSON does not know, become null."""
    print(json.dumps(_finite(value), indent=2, allow_nan=False))


def number(value: float | None, digits: int = 6) -> str:
    """Write a number for a table; what is not known is a dash.

    Examples
    --------
    >>> number(5920.0), number(float("nan"))
    ('5920', '-')
    """
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def print_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print columns aligned by blanks, readable by eye and by awk; the first column left, the rest right."""
    lines = [[_plain(cell) for cell in row] for row in (header, *rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        first, *rest = (cell.rjust(width) for cell, width in zip(line, widths, strict=True))
        print("  ".join([first.strip().ljust(widths[0]), *rest]).rstrip())


@contextmanager
def case_progress(total: int, quiet: bool) -> Iterator[Callable[[CaseRun], None]]:
    """Give a function to call after each case: it prints the case and, on a terminal, moves a progress bar.

    Parameters
    ----------
    total
        Number of cases.
    quiet
        True where standard output is for a program: nothing but faults is printed then.
    """

    def line(run: CaseRun) -> str:
        if run.passed is None:
            return f"{run.name}: failed"
        state = "accepted" if run.passed else "NOT accepted"
        if not run.judged:
            state = "identified, nothing to accept ([accept] is empty)"
        how = "unchanged" if run.skipped else f"{run.seconds:.1f} s"
        return f"{run.name}: {state} ({how}) {run.folder}"

    if not sys.stderr.isatty():

        def note(run: CaseRun) -> None:
            if not quiet and run.passed is not None:
                print(_plain(line(run)), flush=True)
            print_faults(run.faults)

        yield note
        return

    # rich is slow to import, so only where its bar is seen; it obeys NO_COLOR by itself
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("cases", total=total)

        def advance(run: CaseRun) -> None:
            for fault in run.faults:
                progress.console.print(_plain(fault), markup=False, highlight=False, soft_wrap=True)
            if not quiet and run.passed is not None:
                progress.console.print(_plain(line(run)), markup=False, highlight=False, soft_wrap=True)
            progress.advance(task)

        yield advance
