"""Linear algebra in one thread: the matrices of a fit are small, and threads would wait for one another."""

from __future__ import annotations

import os

__all__ = ["ALGEBRA", "single_thread"]

ALGEBRA = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What the libraries of linear algebra read when they are loaded. With two threads an identification takes
three times as much processor time and is no sooner (laws of the paper, 246 points, 2 cores)."""


def single_thread() -> None:
    """Let linear algebra stay in one thread in this process and its children; what the user has set wins.

    It must be called before numpy is imported.
    """
    for name in ALGEBRA:
        os.environ.setdefault(name, "1")
