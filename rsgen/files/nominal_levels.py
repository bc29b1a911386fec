"""To which level each point belongs, and what the level is called: a nominal value, or what was measured."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError, quote
from rsgen.common.finding import Finding, Quantity
from rsgen.data.surface import ResponseSurface, typical_amounts
from rsgen.data.surface.directions import TURN, group_forces, monotone_runs
from rsgen.files.data_files import file_label
from rsgen.files.plan import MeasuredTest

__all__ = [
    "group_levels",
    "group_runs",
    "level_of_file",
    "recognise_control",
    "settle_levels",
]

_NUMBER = r"([+-]?\d{1,30}(?:[.,]\d{1,30})?(?:[eE][+-]?\d{1,3})?)"
_SPREAD = 0.05
"""Runs whose forces differ by less than this fraction share a level: shakers repeat it to a few per cent."""
_ONE_WAY = 0.8
"""A run is a sweep where this share of its steps goes one way; levels side by side at a frequency do not."""
_DIGITS = 3
"""Digits of a level that is called by what was measured; more where two would have one name."""
_AGREE = 2.0
"""A level is no amount of what was measured where it is above the largest, or below the typical one, by more
than this factor. Shakers lose force at a resonance and stay near the level elsewhere."""
_LARGEST = 0.9
"""Quantile that stands for the largest amount: single readings may be off."""
_HELD = 0.1
"""What was held within a level stays within this range, from its 10 to its 90 per cent quantile."""
_FREE = 0.5
"""What was not held moves by more than this over a resonance."""
_FEWEST = 8
"""Points of a level from which on quantiles say what was held."""


def group_levels(force: Array, spread: float) -> Array:
    """Group like forces to levels: in ascending order, a gap of more than ``spread`` begins a new level.

    Parameters
    ----------
    force
        (n,) amplitude of the measured force [N], positive.
    spread
        Relative gap.

    Returns
    -------
    (n,) the median force of each point's group [N].

    Examples
    --------
    >>> import numpy as np
    >>> group_levels(np.array([1.0, 1.02, 2.0, 0.99]), 0.1).tolist()
    [1.0, 1.0, 2.0, 1.0]
    """
    group = group_forces(force, spread)
    return _medians(force, group)[group]


def _medians(values: Array, group: NDArray[np.intp]) -> Array:
    return np.array([np.median(values[group == number]) for number in range(int(group.max()) + 1)])


def group_runs(force: Array, frequency: Array, block: NDArray[np.int64]) -> Array:
    """Group sweeps of like force to levels; the force within a sweep may fall at the resonance.

    Rows that are no sweeps, as in a table with all levels side by side, are grouped point by point.

    Parameters
    ----------
    force, frequency
        (n,) amplitude of the measured force [N] and frequency [Hz], in the order of the test.
    block
        (n,) number of the block in the file.

    Returns
    -------
    (n,) the median force of each point's group [N].
    """
    run = np.zeros(len(force), dtype=np.intp)
    count = 0
    edges = [0, *(np.flatnonzero(np.diff(block)) + 1).tolist(), len(force)]
    for left, right in pairwise(edges):
        for start, stop, direction in monotone_runs(frequency[left:right], TURN):
            steps = np.diff(frequency[left + start : left + stop]) * (-1 if direction == "down" else 1)
            if stop - start < _FEWEST or np.mean(steps > 0) < _ONE_WAY:
                return group_levels(force, _SPREAD)
            run[left + start : left + stop] = count
            count += 1
    level = _medians(force, run)
    return group_levels(level, _SPREAD)[run]


def level_of_file(test: MeasuredTest, number: int) -> float | None:
    """Find the level of a file in the plan or its name; None where its points differ in level.

    Raises
    ------
    MeasurementError
        The name does not have the form that the plan says, or the number is not above 0.
    """
    rule = test.level
    if rule.value is not None:
        return rule.value
    if rule.values and len(rule.values) == len(test.files):
        return rule.values[number]
    if rule.name is None:
        # several values for one file belong to its entries
        return None
    name = test.files[number].name
    before, _, after = rule.name.partition("{level}")
    match = re.fullmatch(re.escape(before) + _NUMBER + re.escape(after), name)
    if match is None:
        raise MeasurementError(
            f"{file_label(test.files[number])}: its name is not of the form {quote(rule.name)}"
        )
    level = float(match[1].replace(",", ".")) * test.factor("level")
    if not (level > 0 or rule.labels):
        raise MeasurementError(
            f"{file_label(test.files[number])}: its name gives a level of {level:g} {test.level_unit}; "
            "above 0 needed"
        )
    return level


def _moved(values: Array) -> float:
    """Range of amounts over their median, without the outermost."""
    low, middle, high = np.quantile(values, [0.1, 0.5, 0.9])
    return float((high - low) / middle) if middle > 0 else np.inf


def _held_findings(surface: ResponseSurface) -> list[Finding]:
    """Find the level at which a response that is said to be held moves most."""
    good = surface.settled & np.isfinite(surface.amplitude)
    rows = [(v, np.flatnonzero(good & (surface.level == v))) for v in surface.levels]
    moved, level = max((_moved(surface.amplitude[at]) if len(at) else 0.0, float(v)) for v, at in rows)
    if moved < _FREE:
        return []
    numbers = {"moved": Quantity(moved), "level": Quantity(level, "m")}
    return [Finding("response-not-held", "doubt", numbers=numbers)]


def recognise_control(force: Array, size: Array, run: NDArray[Any]) -> str:
    """Find what was held within every run: "response" where its amplitude stays while the force moves.

    Parameters
    ----------
    force, size
        (n,) amplitudes of the force [N] and the displacement [m].
    run
        (n,) number of the run.
    """

    rows = [np.flatnonzero(run == number) for number in np.unique(run)]
    held = all(len(at) >= _FEWEST and _moved(size[at]) < _HELD and _moved(force[at]) > _FREE for at in rows)
    return "response" if held else "force"


def _named(amount: Array) -> Array:
    """Round amounts to names, with as many digits as keep different ones apart."""
    for digits in range(_DIGITS, 17):
        names = np.array([float(f"{value:.{digits}g}") for value in amount])
        if len(np.unique(names)) == len(np.unique(amount)):
            return names
    return amount


def _coincide(amount: Array) -> bool:
    """Whether several levels were all measured with one amount."""
    return len(amount) > 1 and float(np.ptp(amount)) < _SPREAD * float(amount.min())


def settle_levels(surface: ResponseSurface, test: MeasuredTest, known: bool, said: bool) -> ResponseSurface:
    """Call levels by what was measured where they are labels; say where nominal levels and forces disagree.

    Parameters
    ----------
    surface
        With the levels that the plan gives, or with numbers of runs.
    test
        The plan.
    known
        Whether the levels are nominal ones; numbers of runs get names without a word.
    said
        Whether case or files say in which unit the levels are.
    """
    levels, none = surface.levels, (np.nan, np.nan)
    typical = typical_amounts(surface, surface.drive)
    if test.control == "response":
        surface = replace(surface, findings=(*surface.findings, *_held_findings(surface)))
    if known and not test.level.labels:
        amount = surface.amplitude if surface.response_held else surface.drive
        good = surface.settled & np.isfinite(amount) & (amount > 0)
        median, largest = np.array(
            [
                np.quantile(amount[at], [0.5, _LARGEST])
                if (at := good & (surface.level == v)).any()
                else none
                for v in levels
            ]
        ).T
        if not np.any((median > _AGREE * levels) | (levels > _AGREE * largest)):
            return replace(surface, findings=(*surface.findings, *_order_findings(surface, levels, median)))
    if not np.isfinite(typical).all():
        return surface
    if known and not test.level.labels and _coincide(typical):
        numbers = {"count": Quantity(len(levels)), "amount": Quantity(float(typical[0]), surface.level_unit)}
        finding = Finding("levels-of-one-force", "doubt", numbers=numbers)
        return replace(surface, findings=(*surface.findings, finding))
    names = _named(typical)
    renamed = replace(surface, level=names[np.searchsorted(levels, surface.level)])
    if not known:
        return renamed
    renamed = replace(renamed, label=surface.level)
    labels = {
        "labels": ", ".join(f"{level:g}" for level in levels),
        "amounts": ", ".join(f"{name:g} {surface.level_unit}" for name in names),
        "unit": surface.level_unit,
    }
    said = said and not test.level.labels and test.calibrated
    finding = Finding(
        "levels-disagree" if said else "levels-are-labels", "doubt" if said else "info", names=labels
    )
    return replace(renamed, findings=(*surface.findings, finding))


def _order_findings(surface: ResponseSurface, levels: Array, median: Array) -> list[Finding]:
    """Find two levels of which the lower one was driven harder: their labels or files are swapped."""
    unit = surface.level_unit
    for i in range(len(levels) - 1):
        if median[i] > median[i + 1] * (1 + _SPREAD):
            numbers = {
                "low": Quantity(float(levels[i]), unit),
                "high": Quantity(float(levels[i + 1]), unit),
                "low_measured": Quantity(float(median[i]), unit),
                "high_measured": Quantity(float(median[i + 1]), unit),
            }
            return [Finding("levels-swapped", "doubt", numbers=numbers)]
    return []
