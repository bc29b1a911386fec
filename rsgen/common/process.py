"""Processes: what one of rsgen settles before it works, and the limits of one that opens files of strangers.

One thread of linear algebra, few searches for garbage; for files of strangers no further file, no long work,
little memory.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import sys
import time
from math import ceil

try:
    import resource
except ImportError:
    # Windows and WebAssembly have no such limits
    resource = None  # type: ignore[assignment]

ALGEBRA = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables that the libraries of linear algebra read when they are loaded. With two threads an
identification takes three times as much processor time and is no sooner (laws of the paper, 246 points,
two cores)."""


def single_thread() -> None:
    """Let linear algebra stay in one thread in this process and its children; what the user has set wins.

    The matrices of a fit are small, and threads would wait for one another. It must be called before numpy is
    imported.
    """
    for name in ALGEBRA:
        os.environ.setdefault(name, "1")


_YOUNG_SEARCHES = 100
"""Searches among young objects for each among all. What is imported stays for good, and looking through it
takes a quarter of a second of a run with Python's 10; with 100 the figures of a few cases wait in memory."""


def collect_seldom() -> None:
    """Look for cycles of old objects less often in this process; young ones are found as ever."""
    young, middle, _ = gc.get_threshold()
    gc.set_threshold(young, middle, _YOUNG_SEARCHES)


def leave_at_once() -> None:
    """Return the memory back as a whole at the exit of this process.

    Python searches all that was imported for cycles once more as it ends, a tenth of a second with sympy.
    What must be cleared up asks for it by ``atexit`` or a context; nothing waits for that search.
    """
    atexit.register(gc.freeze)


MAX_ANSWER_BYTES = 64 * 2**20
"""Of the line with which such a process answers."""

READER_BYTES = 96 * 2**20
"""Of memory for Python and the library that reads, without what is read."""

MEMORY_STATUS = "/proc/self/statm"
"""Where Linux says how much memory a process has; other systems do not, and no limit above that is set."""
_PROGRAM = (
    "import sys, json; sys.path[:] = json.loads(sys.argv.pop(2)); "
    "from importlib import import_module; import_module(sys.argv.pop(2)).main()"
)


def command(module: str, order: str = "") -> list[str]:
    """Return the command that calls ``main`` of a module of rsgen, with the order as its first argument.

    Trusted words, as a linter asks: the program is a constant, and nothing goes through a shell.
    """
    return [sys.executable, "-I", "-c", _PROGRAM, order, json.dumps(sys.path), module]


def environment() -> dict[str, str]:
    """Return the environment of such a process."""
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
    if resource is None:
        # the time limit of the parent holds there, too
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
