"""Processes in which libraries open files of strangers: no further file, no long work, little memory."""

from __future__ import annotations

import json
import os
import sys
import time
from math import ceil

__all__ = ["MEMORY_STATUS", "READY", "command", "confine", "environment"]

READY = b"ready\n"
"""What such a process says once it is confined, before it opens anything."""
MEMORY_STATUS = "/proc/self/statm"
"""Where Linux says how much memory a process has; other systems do not, and no limit above that is set."""
_PROGRAM = (
    "import sys, json; sys.path[:] = json.loads(sys.argv.pop(2)); "
    "from importlib import import_module; import_module(sys.argv.pop(2)).main()"
)


def command(module: str, order: str = "") -> list[str]:
    """Give the command that calls ``main`` of a module of rsgen, with the order as its first argument.

    Trusted words, as a linter asks: the program is a constant, and nothing goes through a shell.
    """
    return [sys.executable, "-I", "-c", _PROGRAM, order, json.dumps(sys.path), module]


def environment() -> dict[str, str]:
    """Give the environment of such a process."""
    # threads of the algebra library reserve memory that the limit would count
    threads = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL", "NUMEXPR")}
    return {**os.environ, **threads, "PYTHONDONTWRITEBYTECODE": "1", "HDF5_USE_FILE_LOCKING": "FALSE"}


def confine(memory: int, seconds: float) -> None:
    """Limit this process, once everything that it needs is imported.

    Parameters
    ----------
    memory
        Bytes that it may take from now on.
    seconds
        Of work from now on, not of waiting: a busy machine must not refuse a good file.
    """
    try:
        import resource
    except ImportError:
        # Windows has no such limits; the time limit of the parent holds there, too
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    last = ceil(time.process_time() + seconds)
    # first the signal that names the reason, then the one that cannot be caught
    resource.setrlimit(resource.RLIMIT_CPU, (last, last + 1))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    # none beyond standard input, output and error: links to other files lead nowhere
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, 3))
    try:
        with open(MEMORY_STATUS, encoding="ascii") as status:  # noqa: PTH123 - the module needs pathlib for nothing else
            base = int(status.read().split()[0]) * resource.getpagesize()
    except OSError:
        return
    resource.setrlimit(resource.RLIMIT_AS, (base + memory, base + memory))
