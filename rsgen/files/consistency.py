"""Whether the runs of one test fit together: copies, units that differ from file to file, branches."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.finding import Finding, quantities
from rsgen.data.surface import ResponseSurface

__all__ = ["repeated_rows", "run_findings", "tell_branches_apart"]

_FEWEST = 8
"""Points of a run from which on two runs are compared."""
_MOST = 60
"""Runs that are compared with each other at most; each with each would take long for thousands."""
_TWICE = 0.2
"""From this share of rows on that are the one before, an export wrote rows twice."""
_STEPS = (1e3, 1e6)
"""Factors between units of one set: m and mm, N and mN, m and um."""
_NEAR_STEP = 2.0
"""Beside a wrong unit, runs of one structure differ by less than this factor in response over force, in the
middle of their points."""
_EVEN = 3.0
"""A wrong unit is the same factor at every point; what friction holds still at a level is not."""
_APART = 1.5
"""Amplitudes of a larger ratio lie on two branches."""


def repeated_rows(frequency: Array, force: ComplexArray, response: ComplexArray) -> NDArray[np.bool_]:
    """(n,) True for a row that is the one before, to the last digit: written twice, not measured twice.

    None where only a few are, as at the turn of a sweep or where a display has few digits.
    """
    same = np.zeros(len(frequency), dtype=np.bool_)
    same[1:] = np.all([values[1:] == values[:-1] for values in (frequency, force, response)], axis=0)
    written_twice = same.sum() >= max(_FEWEST, _TWICE * len(same))
    return same if written_twice else np.zeros_like(same)


def _runs(surface: ResponseSurface, block: NDArray[np.int64]) -> list[NDArray[np.intp]]:
    """Rows of each block, level and direction, in the order of the test."""
    names = np.stack([block, np.unique(surface.level, return_inverse=True)[1]], axis=1)
    keys = [(*pair.tolist(), str(sweep)) for pair, sweep in zip(names, surface.sweep, strict=True)]
    rows: dict[tuple[object, ...], list[int]] = {}
    for row, key in enumerate(keys):
        rows.setdefault(key, []).append(row)
    found = [np.array(at) for at in rows.values() if len(at) >= _FEWEST]
    return found[:_MOST]


def run_findings(
    surface: ResponseSurface, block: NDArray[np.int64], labels: list[str], by_ratio: bool
) -> list[Finding]:
    """Find runs that are copies of each other, and levels read in units of another size.

    Parameters
    ----------
    surface, block
        The test, and (n,) the number of the block of each row.
    labels
        What each block is called.
    by_ratio
        Whether the files hold response over force: of a linear structure it is the same at every level.
    """
    runs, found = _runs(surface, block), list[Finding]()
    for first, second in combinations(runs, 2):
        names = {"first": labels[block[first[0]]], "second": labels[block[second[0]]]}
        if not by_ratio and _is_copy(surface, first, second):
            found.append(Finding("run-repeated", "doubt", names=names))
            return found
    for first, second in combinations(runs, 2):
        factor = _factor_between(surface, first, second)
        if factor is not None:
            names = {"first": labels[block[first[0]]], "second": labels[block[second[0]]]}
            return [Finding("runs-of-other-size", "doubt", numbers=quantities(factor=factor), names=names)]
    return found


def _is_copy(surface: ResponseSurface, first: NDArray[np.intp], second: NDArray[np.intp]) -> bool:
    return len(first) == len(second) and all(
        np.array_equal(values[first], values[second])
        for values in (surface.frequency, surface.amplitude, surface.harmonics[:, 1])
    )


def _factor_between(
    surface: ResponseSurface, first: NDArray[np.intp], second: NDArray[np.intp]
) -> float | None:
    """Factor by which response over force differs, where it is a step between units; else None."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        size = np.log(surface.amplitude / np.abs(surface.force))
    f = surface.frequency
    order = second[np.argsort(f[second], kind="stable")]
    inside = first[(f[first] >= f[order[0]]) & (f[first] <= f[order[-1]])]
    if len(inside) < _FEWEST:
        return None
    ratio = np.interp(f[inside], f[order], size[order]) - size[inside]
    low, middle, high = np.quantile(ratio, [0.25, 0.5, 0.75])
    if not high - low < np.log(_EVEN):
        return None
    near = [step for step in _STEPS if abs(abs(middle) - np.log(step)) < np.log(_NEAR_STEP)]
    return near[0] if near else None


def tell_branches_apart(surface: ResponseSurface, block: NDArray[np.int64]) -> NDArray[np.str_]:
    """(n,) directions, where two runs of one level and direction lie on two branches.

    A table sorted by frequency says nothing of its sweep. Of two branches at one level the upper one is
    reached upwards where it rises with the frequency (a hardening mode), else downwards.
    """
    sweep = np.array(surface.sweep)
    for first, second in combinations(_runs(surface, block), 2):
        alike = surface.level[first[0]] == surface.level[second[0]] and sweep[first[0]] == sweep[second[0]]
        if not alike or sweep[first[0]] == "rest":
            continue
        f, size = surface.frequency, surface.amplitude
        order = second[np.argsort(f[second], kind="stable")]
        inside = first[(f[first] >= f[order[0]]) & (f[first] <= f[order[-1]])]
        if not len(inside):
            continue
        ratio = size[inside] / np.interp(f[inside], f[order], size[order])
        above, below = ratio > _APART, ratio < 1 / _APART
        if not max(above.sum(), below.sum()) >= 3 or (above.any() and below.any()):
            continue
        upper, lower = (first, second) if above.any() else (second, first)
        low, high = f[inside[above | below]].min(), f[inside[above | below]].max()
        both = upper[(f[upper] >= low) & (f[upper] <= high)]
        if len(np.unique(f[both])) < 2:
            # a single point of the upper run does not rise or fall
            continue
        hardens = np.polyfit(f[both], size[both], 1)[0] > 0
        sweep[upper], sweep[lower] = ("up", "down") if hardens else ("down", "up")
    return sweep
