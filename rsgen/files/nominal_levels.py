"""Assign points to levels, and name each level by its nominal value or by the measured amount."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations, pairwise, takewhile
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError, quote, shown_path
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.tolerances import RELATIVE_CHANGE_NEGLIGIBLE
from rsgen.data.record_set import LEVEL_DIGITS, LEVEL_TOLERANCE, MIN_POINTS_OF_RUN, swapped_levels
from rsgen.data.surface.columns import MIN_TURN, group_forces, monotone_runs
from rsgen.data.surface.plausibility import COMMON_FACTORS, nearest_factor
from rsgen.data.surface.response_surface import (
    ResponseSurface,
    control_findings,
    typical_amounts,
)
from rsgen.files.plan import UNIT_IN_NAME, MeasuredTest
from rsgen.files.signals import star_pattern

# ----------------------------------------------------------------------------
# The levels of a table of amplitudes, and the stability of its points.


_AMPLITUDE_STEP = 0.1
"""Of the amplitude, relative, from level to level of a continuation: a dozen where it doubles twice."""

_FREQUENCY_TOLERANCE = 1e-3
"""Frequencies that differ by less, relatively, belong to one run of a continuation, which holds it."""

_MIN_POINTS_AT_FREQUENCY = 5
"""Points of such a run from which on the force says where it is unstable."""


def assign_levels(
    test: MeasuredTest,
    frequency: Array,
    force: Array,
    displacement: Array,
    run: Array | None,
    block: NDArray[np.int64],
    held: NDArray[np.int64],
) -> Array:
    """Return the level (n,) of each row of a table of amplitudes.

    Parameters
    ----------
    frequency, force, displacement
        (n,) [Hz], and amplitudes [N], [m].
    run
        (n,) levels, where the plan knows them.
    block, held
        (n,) numbers of blocks, and of the runs of which each held the response.
    """
    spread = test.level.spread
    if test.control == "continuation":
        return amplitude_steps(displacement, spread)
    if spread is not None or (run is None and test.control == "phase"):
        # levels of a phase-locked test have one point each: neighbours must not be joined
        return group_levels(force, RELATIVE_CHANGE_NEGLIGIBLE if spread is None else spread)
    if run is not None:
        return run.astype(np.float64)
    if test.control == "response":
        return held.astype(np.float64)
    return group_runs(force, frequency, block)


def amplitude_steps(amount: Array, step: float | None) -> Array:
    """(n,) middle of the step of equal ratio that each amplitude lies in: the levels of a continuation."""
    ratio = np.log1p(_AMPLITUDE_STEP if step is None else step)
    good = np.isfinite(amount) & (amount > 0)
    number = np.floor(np.log(np.where(good, amount, 1.0)) / ratio)
    return np.asarray(np.exp((number + 0.5) * ratio))


def stable_points(frequency: Array, force: Array, size: Array) -> NDArray[np.bool_]:
    """(n,) False where the force falls as the amplitude grows at one frequency: no force held it there."""
    order = np.argsort(frequency, kind="stable")
    edges = np.flatnonzero(np.diff(frequency[order]) > _FREQUENCY_TOLERANCE * frequency[order][1:]) + 1
    stable = np.ones(len(force), dtype=bool)
    for run in np.split(order, edges):
        if len(run) >= _MIN_POINTS_AT_FREQUENCY:
            rows = run[np.argsort(size[run], kind="stable")]
            stable[rows] = np.gradient(force[rows]) >= 0
    return stable


_NUMBER = r"[+-]?\d{1,30}(?:[.,p]\d{1,30})?(?:[eE][+-]?\d{1,3})?"
"""In a name: 0.5, 0,5 or 0p5, which stands for 0.5 where a name has no point."""
_MAX_LEVEL_SPREAD = 0.05
"""Runs whose forces differ by less than this fraction share a level: shakers repeat it to a few per cent."""
_MIN_SHARE_OF_SWEEP_STEPS = 0.8
"""A run is a sweep where this share of its steps goes one way; levels side by side at a frequency do not."""


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
        for start, stop, direction in monotone_runs(frequency[left:right], MIN_TURN):
            steps = np.diff(frequency[left + start : left + stop]) * (-1 if direction == "down" else 1)
            if stop - start < MIN_POINTS_OF_RUN or np.mean(steps > 0) < _MIN_SHARE_OF_SWEEP_STEPS:
                return group_levels(force, _MAX_LEVEL_SPREAD)
            run[left + start : left + stop] = count
            count += 1
    level = _medians(force, run)
    return group_levels(level, _MAX_LEVEL_SPREAD)[run]


_NUMBER_IN_NAME = r"(?<![\d.,])(\d{1,30}(?:[.,p]\d{1,30})?)"


def level_form(names: Sequence[str], unit: str = "[munk]?N") -> str | None:
    """Return the form of names with an amount that is not the same in all; None where there is none.

    Parameters
    ----------
    names
        Of the files of a test.
    unit
        A pattern of the unit behind the number, as "g" of a driven base.

    Examples
    --------
    >>> level_form(["rep1_2N_up.mat", "rep2_2N_down.mat", "rep1_0.5N_up.mat"])
    'rep*_{level}N_*.mat'
    >>> level_form(["flap_0p5N_up.mat", "flap_1N_up.mat"])
    'flap_{level}N_up.mat'
    >>> level_form(["run_0.10g.mat", "run_0.31g.mat"], "g")
    'run_{level}g.mat'
    >>> level_form(["load_cell_200N_1.mat", "load_cell_200N_2.mat"]) is None
    True
    """
    split = [re.split(rf"{_NUMBER_IN_NAME}(?=[ _-]?{unit}(?![A-Za-z]))", name) for name in names]
    if any(len(parts) != 3 for parts in split) or len({parts[1] for parts in split}) < 2:
        return None
    sides = []
    for texts in ([parts[0] for parts in split], [parts[2] for parts in split]):
        start = _beginning(texts)
        rests = [text.removeprefix(start) for text in texts]
        end = _beginning([rest[::-1] for rest in rests])[::-1]
        between = {rest.removesuffix(end) for rest in rests}
        if len(between) > 1 and "" in between:
            return None
        sides.append(f"{start}*{end}" if len(between) > 1 else start)
    return None if sides[0].endswith("*") else "{level}".join(sides)


def _beginning(texts: Sequence[str]) -> str:
    """Return the longest beginning that all texts have."""
    alike = takewhile(lambda signs: len(set(signs)) == 1, zip(*texts, strict=False))
    return "".join(signs[0] for signs in alike)


def level_of_file(test: MeasuredTest, number: int) -> float | None:
    """Find the level of a file in the plan or its name; None where its points differ in level.

    Raises
    ------
    MeasurementError
        The name does not have the form that the plan says, or several numbers fit, or it is not above 0.
    """
    if test.level_values and len(test.level_values) == len(test.files):
        return test.level_values[number]
    # several values for one file belong to its entries
    file = test.files[number]
    return None if test.level.name is None else level_in_name(test, file.name, shown_path(file))


def level_in_name(test: MeasuredTest, name: str, label: str) -> float:
    """Find the level in the name of a file, or of an entry of one, such as a sheet; messages have ``label``.

    Raises
    ------
    MeasurementError
        As in ``level_of_file``.
    """
    form = test.level.name or ""
    before, after = map(star_pattern, form.split("{level}"))
    numbers = [found for at in range(len(name)) if (found := re.compile(_NUMBER).match(name, at))]
    fitting = [m for m in numbers if before.fullmatch(name[: m.start()]) and after.fullmatch(name[m.end() :])]
    if len(fitting) > 1:
        # of several numbers the one with a unit
        fitting = [m for m in fitting if UNIT_IN_NAME.match(name, m.end())] or fitting
    if len(fitting) != 1:
        fault = f"its name is not of the form {quote(form)} with a number for {{level}}"
        if fitting:
            fault = f"{' or '.join(m[0] for m in fitting)} may be the level in the form {quote(form)}"
            fault += "; write more of the name around {level}, such as its unit, or give values = [...]"
        else:
            fault += "; or give values = [...]"
        raise MeasurementError(f"{label}: {fault}")
    level = float(re.sub("[,p]", ".", fitting[0][0])) * test.level_factor
    if not (level > 0 or test.level.labels):
        raise MeasurementError(
            f"{label}: its name gives a level of {level:g} {test.level_unit}; above 0 needed"
        )
    return level


def _rounded(amount: Array) -> Array:
    """Round amounts to names, with as many digits as distinguish different ones."""
    for digits in range(LEVEL_DIGITS, 17):
        names = np.array([float(f"{value:.{digits}g}") for value in amount])
        if len(np.unique(names)) == len(np.unique(amount)):
            return names
    return amount


_UNIT_OF_LABEL = re.compile(r"(?![_-]A)[ _-]?([munk]?[NVA]|lbf|[mu]m|g|dB|%)(?![A-Za-z])")
"""A unit right behind the number of a label, as the volts of a drive; in "sweep1_A" A is no ampere."""


_QUANTILE_OF_LARGEST = 0.9
"""Quantile that stands for the largest amount: single readings may be off."""


def _amounts_of_levels(surface: ResponseSurface) -> tuple[Array, Array]:
    """Return the median and the largest amount (l,) measured at each of ``surface.levels``, in their unit.

    Shakers lose force near a resonance; the largest is what they give elsewhere. NaN where nothing settled.
    """
    amount = surface.amplitude if surface.response_held else surface.drive
    found = np.where(surface.settled & (amount > 0), amount, np.nan)
    rows = [found[(surface.level == level) & np.isfinite(found)] for level in surface.levels]
    chosen = [0.5, _QUANTILE_OF_LARGEST]
    median, largest = np.array([np.quantile(row, chosen) if len(row) else [np.nan] * 2 for row in rows]).T
    return median, largest


def name_levels(surface: ResponseSurface, test: MeasuredTest, known: bool, said: bool) -> ResponseSurface:
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
    levels, unit = surface.levels, surface.level_unit
    nominal, typical = known and not test.level.labels, typical_amounts(surface, surface.drive)
    if test.control == "response":
        surface = replace(surface, findings=(*surface.findings, *control_findings(surface)))
    if nominal:
        if any(finding.code == "levels-disagree" for finding in surface.findings):
            # of two runs that were driven differently there is no typical amount
            return surface
        median, largest = _amounts_of_levels(surface)
        swapped = swapped_levels(levels, median, 1 + _MAX_LEVEL_SPREAD, unit)
        if swapped and np.all(np.abs(np.log(np.sort(median) / levels)) < np.log(LEVEL_TOLERANCE)):
            measured = levels[np.argsort(np.argsort(median))]
            about = {"labels": ", ".join(f"{one:g}" for one in levels), "unit": unit}
            about["amounts"] = ", ".join(f"{one:.{LEVEL_DIGITS}g} {unit}" for one in median)
            moved = replace(surface, level=measured[np.searchsorted(levels, surface.level)])
            return replace(moved, findings=(*surface.findings, replace(swapped[0], names=about)))
        # shakers lose force at a resonance and stay near the level elsewhere
        if not np.any((median > LEVEL_TOLERANCE * levels) | (levels > LEVEL_TOLERANCE * largest)):
            # where the force is as often the level at one as at another, the levels may be in another unit
            pushed, most = median / levels, largest / levels
            factors = {"rms": COMMON_FACTORS["rms"]}
            # the motion of a base is held: one factor at all levels is no loss of force
            scaled = surface.base and all(nearest_factor(float(one), factors) for one in pushed)
            if swapped or not (scaled or np.any(pushed[:, None] > LEVEL_TOLERANCE * most)):
                return replace(surface, findings=(*surface.findings, *swapped))
    if not np.isfinite(typical).all():
        return surface
    if nominal and len(levels) > 1 and np.ptp(typical) < _MAX_LEVEL_SPREAD * typical.min():
        numbers = {"count": Quantity(len(levels)), "amount": Quantity(float(typical[0]), unit)}
        finding = Finding("levels-of-one-force", "doubt", numbers=numbers)
        return replace(surface, findings=(*surface.findings, finding))
    names = _rounded(typical)
    renamed = replace(surface, level=names[np.searchsorted(levels, surface.level)])
    if not known:
        return renamed
    renamed = replace(renamed, label=surface.level)
    amounts = ", ".join(f"{name:g} {unit}" for name in names)
    labels = {"labels": ", ".join(f"{level:g}" for level in levels), "amounts": amounts, "unit": unit}
    said = said and nominal and test.calibrated
    ratio, numbers = typical / levels, dict[str, Quantity]()
    # labels that the case calls so are no amounts
    if nominal and ratio.max() < LEVEL_TOLERANCE * ratio.min():
        numbers["ratio"] = Quantity(float(np.median(ratio)))
        labels |= nearest_factor(numbers["ratio"].value, COMMON_FACTORS)
    corrected = [f for f in surface.findings if f.code == "sweep-rate" and f.names.get("mass") == "given"]
    numbers |= {"mass": corrected[0].numbers["mass"]} if corrected else {}
    falls = len(levels) > 2 and bool(np.all(np.diff(typical) < 0))
    labels |= {"order": "falls"} if falls else {}
    found = [Finding("levels-disagree", "doubt" if said else "info", numbers=numbers, names=labels)]
    of_drive = np.any(levels % 1) or _UNIT_OF_LABEL.match((test.level.name or "").partition("{level}")[2])
    if test.level.labels and falls and of_drive:
        # whole numbers may count the runs, others and those with a unit are amounts of a drive
        found += swapped_levels(levels, typical, 1 + _MAX_LEVEL_SPREAD, unit, labels=True)
    return replace(renamed, findings=(*surface.findings, *found))


def runs_of_one_level(runs: Iterable[tuple[str, float, float]], unit: str) -> list[Finding]:
    """Find two runs of one level that were driven differently: one has the level of another.

    Parameters
    ----------
    runs
        What each is called, its level, and the measured amount.
    unit
        Of levels and amounts.
    """
    for (first, level, low), (second, other, high) in combinations(sorted(runs, key=itemgetter(2)), 2):
        if level == other and high > LEVEL_TOLERANCE * low:
            numbers = quantities(unit, level=level, low=low, high=high)
            names = {"first": first, "second": second}
            return [Finding("levels-disagree", "doubt", numbers=numbers, names=names)]
    return []
