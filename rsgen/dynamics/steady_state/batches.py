"""Batches of points: they bound the memory, and the cores work side by side."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from functools import lru_cache
from itertools import pairwise
from typing import TypeVar

__all__ = ["map_batches"]

_MOST = 16384  # points worked on at once; the larger, the less threads wait for one another
_FEWEST = 256  # below, another thread costs more than it saves

Answer = TypeVar("Answer")


def map_batches(work: Callable[[slice], Answer], count: int) -> list[Answer]:
    """Call ``work`` for slices that cover ``count`` points, on all cores; answers in the order of the points.

    ``RSGEN_THREADS`` is the number of cores; where it is not set, all of this process.
    """
    cores = _threads()
    batches = max(-(-count // _MOST), min(cores, count // _FEWEST), 1)
    # as many batches as fill the cores evenly
    batches = batches if batches < cores else -(-batches // cores) * cores
    edges = [count * i // batches for i in range(batches + 1)]
    slices = [slice(low, high) for low, high in pairwise(edges)]
    if batches == 1 or cores == 1:
        return [work(part) for part in slices]
    # numpy keeps its error state in the context
    waiting = [_pool(os.getpid(), cores).submit(copy_context().run, work, part) for part in slices]
    return [done.result() for done in waiting]


def _threads() -> int:
    chosen = os.environ.get("RSGEN_THREADS", "")
    if chosen.isdigit() and int(chosen) > 0:
        return int(chosen)
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1


@lru_cache(maxsize=1)
def _pool(process: int, count: int) -> ThreadPoolExecutor:
    # the process is part of the key: threads do not survive a fork
    return ThreadPoolExecutor(count, thread_name_prefix="rsgen-batch")
