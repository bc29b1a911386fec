"""Standard output and error, whatever they are: closed, full, left by their reader, or poor in letters.

A command goes on when nobody reads it any more: what it computes is worth more than what it prints.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TextIO

__all__ = ["open_streams", "output_fault", "write_error", "write_output"]

_faults: list[OSError] = []
"""The first one of standard output in this command."""


def open_streams() -> None:
    """Give closed streams to the null device, and let no letter stop a command.

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
    """Print a line to standard error; where that fails, there is nobody to tell."""
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
