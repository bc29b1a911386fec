"""Arguments and options that commands share; output of results, and of faults to standard error."""

from __future__ import annotations

import json
import math
import os
import sys
import unicodedata
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, TextIO

import typer

from rsgen.common.errors import printable
from rsgen.common.finding import USABLE, StatedVerdict, next_lines, verdict_lines

# ----------------------------------------------------------------------------
# Arguments and options that several commands share.

Cases = Annotated[list[Path], typer.Argument(help="Case files, or folders of them.", show_default=False)]
OneCase = Annotated[Path, typer.Argument(help="A case file.", show_default=False)]
Out = Annotated[Path, typer.Option("--out", "-o", help="The folder of all results.")]
Data = Annotated[
    Path | None,
    typer.Option(
        help="Folder of measured files; otherwise RSGEN_DATA, then the case's own.", show_default=False
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Answer as JSON, for programs.")]
Memory = Annotated[list[str] | None, typer.Option(help="A state: 'z = g(x, v, z)'.", show_default=False)]
Figures = Annotated[
    str | None,
    typer.Option(help="Save every figure with the report, too: pdf, svg or png.", show_default=False),
]


# ----------------------------------------------------------------------------
# Robust stdout and stderr: closed, full disk, broken pipe, limited encoding.
#
# A broken pipe does not stop a computation.

_faults: list[OSError] = []
"""The first one of standard output in this command."""


def open_streams() -> None:
    """Connect closed streams to the null device, and escape characters that cannot be encoded.

    The next file that a program opens takes the number of a closed stream, and what a library then prints
    would go into that file.
    """
    _faults.clear()
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            handle = os.open(os.devnull, os.O_RDWR)
            # workers inherit it: with them the number would be free again
            os.set_inheritable(handle, True)
            setattr(sys, name, os.fdopen(handle, mode, encoding="utf-8", closefd=False))
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="backslashreplace")


def write_output(text: str, *, flush: bool = False) -> None:
    """Print a line to standard output; where that fails, say nothing more and remember why."""
    try:
        print(text, flush=flush)
    except OSError as fault:
        _lose(sys.stdout, fault)


def write_error(text: str) -> None:
    """Print a line to standard error; where that fails, no message is possible."""
    try:
        print(text, file=sys.stderr)
    except OSError:
        _silence(sys.stderr)


def output_fault() -> str | None:
    """Say why standard output is not complete; None where it is, or its reader has seen enough."""
    try:
        sys.stdout.flush()
    except OSError as fault:
        _lose(sys.stdout, fault)
    for lost in _faults:
        if not isinstance(lost, BrokenPipeError):
            return f"standard output: cannot be written: {lost.strerror or lost}"
    return None


def _lose(stream: TextIO, fault: OSError) -> None:
    _faults.append(fault)
    _silence(stream)


def _silence(stream: TextIO) -> None:
    """Lead a stream to the null device, or Python would try again at its exit and complain."""
    with suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


USABLE_RESULT, DOUBTED_RESULT, FAULTY, INTERRUPTED = 0, 1, 2, 130
"""Exit codes: results that a script may use unseen (states accepted and identified, or nothing to judge),
results that someone must look at (states missed, doubtful and rejected; nothing settled), faulty input, an
interrupt."""

_MOST_FAULTS = 500


def plain(text: str) -> str:
    """Show control characters of a file's texts as escapes: a terminal obeys them otherwise.

    Spaces of all widths, such as the thin one between thousands, are blanks.
    """
    return printable("".join(" " if unicodedata.category(sign) == "Zs" else sign for sign in text), None)


def print_line(text: str = "", *, flush: bool = False) -> None:
    """Print a line of a result; ``flush`` where the next one takes a while."""
    write_output(plain(text), flush=flush)


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
        write_error(plain(line))
    if len(lines) > _MOST_FAULTS:
        write_error(f"... and {len(lines) - _MOST_FAULTS} more")


def print_verdict(verdict: StatedVerdict) -> None:
    """Print a verdict and its reasons; the numbers come next."""
    for line in verdict_lines(verdict):
        print_line(line)


def print_next_steps(verdict: StatedVerdict, more: Iterable[str] = ()) -> int:
    """Print what to do next, and more steps, below the numbers; return the exit code."""
    for line in (*next_lines(verdict), *(f"  next: {step}" for step in more)):
        print_line(line)
    return verdict_code(verdict["state"])


def verdict_code(state: object) -> int:
    """Return the exit code of a verdict's state: 0 if a script may go on with the numbers, else 1."""
    return USABLE_RESULT if state in USABLE else DOUBTED_RESULT


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
    write_output(json.dumps(_finite(value), indent=2, allow_nan=False))
