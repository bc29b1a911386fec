"""What a process of rsgen settles before it works: one thread of linear algebra, few searches for garbage."""

from __future__ import annotations

import atexit
import gc
import os

__all__ = ["ALGEBRA", "collect_seldom", "leave_at_once", "single_thread"]

ALGEBRA = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What the libraries of linear algebra read when they are loaded. With two threads an identification takes
three times as much processor time and is no sooner (laws of the paper, 246 points, 2 cores)."""


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
    """Give the memory back as a whole at the exit of this process.

    Python searches all that was imported for cycles once more as it ends, a tenth of a second with sympy.
    What must be cleared up asks for it by ``atexit`` or a context; nothing waits for that search.
    """
    atexit.register(gc.freeze)
