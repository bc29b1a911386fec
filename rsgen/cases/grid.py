"""Rows of levels and frequencies: from start, stop and count, or value by value, to an ascending array."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import isfinite
from typing import Any

import numpy as np

from rsgen.common.arrays import Array

__all__ = ["MAX_POINTS", "expand"]

MAX_POINTS = 1_000_000


def expand(
    table: Any, path: str, quantity: Callable[[str, float | str], float | None], faults: list[str]
) -> Array | None:
    """Expand a row of positive, ascending values; faults are appended as ``path: what; what is allowed``.

    Parameters
    ----------
    table
        The row as the file gives it.
    path
        Its key, for messages.
    quantity
        Turns a value at a path into SI, or reports a fault and gives None.
    faults
        Gets one sentence for each fault.

    Returns
    -------
    (n,) array or None
        None where a fault was found.
    """
    before = len(faults)
    bounds = ("start", "stop", "count")
    given = [name for name in bounds if getattr(table, name) is not None]
    if table.values is not None:
        if given or table.spacing is not None:
            faults.append(f"{path}: has values and {', '.join(given) or 'spacing'}; give one or the other")
            return None
        return _listed(table.values, path, quantity, faults)
    missing = [name for name in bounds if name not in given]
    if missing:
        faults.append(
            f"{path}: {', '.join(missing)} missing; {{ start, stop, count }} or {{ values = [...] }} needed"
        )
    start = None if table.start is None else quantity(f"{path}.start", table.start)
    stop = None if table.stop is None else quantity(f"{path}.stop", table.stop)
    count = table.count
    if start is not None and start <= 0:
        faults.append(f"{path}.start: is {start:g}; must be above 0")
    if start is not None and stop is not None and count is not None:
        if count == 1 and start != stop:
            faults.append(f"{path}.count: is 1, but start and stop differ; at least 2 needed")
        elif count > 1 and not start < stop:
            faults.append(f"{path}.stop: is {stop:g}; must be above start, which is {start:g}")
    if len(faults) > before or start is None or stop is None or count is None or count > MAX_POINTS:
        return None
    row = np.geomspace(start, stop, count) if table.spacing == "log" else np.linspace(start, stop, count)
    if not (np.diff(row) > 0).all():
        faults.append(f"{path}.count: is {count}; the values between {start:g} and {stop:g} would not differ")
        return None
    return row


def _listed(
    values: list[float | str],
    path: str,
    quantity: Callable[[str, float | str], float | None],
    faults: list[str],
) -> Array | None:
    if not values:
        faults.append(f"{path}.values: is empty; at least one value needed")
        return None
    numbers = [quantity(f"{path}.values.{n}", value) for n, value in enumerate(values, start=1)]
    known = [number for number in numbers if number is not None]
    if len(known) < len(numbers):
        return None
    if not all(isfinite(number) and number > 0 for number in known):
        faults.append(f"{path}.values: must all be above 0")
        return None
    for position, (left, right) in enumerate(pairwise(known), start=2):
        if not left < right:
            fault = "stands twice" if left == right else "is below the value before it"
            faults.append(
                f"{path}.values.{position}: {right:g} {fault}; ascending values without repeats needed"
            )
            return None
    return np.array(known)
