"""What a test held, and the level of each of its points that follows: force, amplitude, phase, or nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.finding import Finding
from rsgen.data.surface.phase_lag import at_phase_resonance
from rsgen.files.nominal_levels import group_levels, group_runs, recognise_control
from rsgen.files.plan import MeasuredTest

__all__ = ["Held", "amplitude_steps", "hold"]

_PHASE_SPREAD = 0.01
"""Levels of a phase-locked test differ by more: one point each, so that neighbours must not be joined."""

_STEP = 0.1
"""Of the amplitude, relative, from level to level of a continuation: a dozen where it doubles twice."""

_SAME = 1e-3
"""Frequencies that differ by less, relatively, belong to one run of a continuation, which holds it."""

_FEWEST = 5
"""Points of such a run from which on the force says where it is unstable."""

_FALLS = 0.1
"""Share by which the force falls along a run while the amplitude grows: no test that holds the force does so,
but noise and a shaker that drops do a part of it."""

_TWO = 2
"""At least as many points of a run lie behind its fold: one is an error of reading."""

_RECOGNISED = {
    "response": [Finding("response-held", "info")],
    "phase": [Finding("phase-resonance", "info")],
    "continuation": [Finding("continuation-recognised", "info")],
}
"""What says that it was recognised."""


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """What was held: ``control`` of the surface, the displacement (n,), levels (n,), stability (n,)."""

    control: str
    displacement: ComplexArray
    level: Array
    stable: NDArray[np.bool_] | None
    findings: tuple[Finding, ...]


def hold(
    test: MeasuredTest,
    frequency: Array,
    force: ComplexArray,
    displacement: ComplexArray,
    run: Array | NDArray[np.int64] | None,
    block: NDArray[np.int64],
    files: NDArray[np.intp],
) -> Held:
    """Find or take over what a table of amplitudes held.

    Parameters
    ----------
    frequency, force, displacement
        (n,) [Hz], [N], [m].
    run
        (n,) levels, or numbers of runs, where the plan knows them.
    block, files
        (n,) numbers of blocks, and of files.
    """
    findings: list[Finding] = []
    stable = None
    spread = test.level.spread
    control: str = test.control or "force"
    if test.control is None and test.force is not None and run is not None and spread is None:
        control = recognise_control(np.abs(force), np.abs(displacement), run)
    if test.control is None and run is None and test.phase_known and at_phase_resonance(force / displacement):
        control = "phase"
    if test.control is None and run is None and spread is None and _folded(frequency, force, displacement):
        control = "continuation"
    if test.control is None:
        findings += _RECOGNISED.get(control, [])
    if control == "phase" and not test.phase_known:
        # what the loop is for
        displacement = np.asarray(np.abs(displacement) * np.exp(-0.5j * np.pi))
        findings.append(Finding("phase-lag-assumed", "warning"))
    if control == "continuation":
        level = amplitude_steps(np.abs(displacement), spread)
        stable = _stable(frequency, np.abs(force), np.abs(displacement))
    elif spread is not None or (run is None and control == "phase"):
        level = group_levels(np.abs(force), _PHASE_SPREAD if spread is None else spread)
    elif run is not None:
        level = run.astype(np.float64)
    elif control == "response":
        level = files.astype(np.float64)
    else:
        level = group_runs(np.abs(force), frequency, block)
    return Held(control, displacement, level, stable, tuple(findings))


def amplitude_steps(amount: Array, step: float | None) -> Array:
    """(n,) middle of the step of equal ratio that each amplitude lies in: the levels of a continuation."""
    ratio = np.log1p(_STEP if step is None else step)
    good = np.isfinite(amount) & (amount > 0)
    number = np.floor(np.log(np.where(good, amount, 1.0)) / ratio)
    return np.asarray(np.exp((number + 0.5) * ratio))


def _runs(frequency: Array, size: Array) -> list[NDArray[np.intp]]:
    """Rows of each frequency that has some, ascending in amplitude."""
    order = np.argsort(frequency, kind="stable")
    edges = np.flatnonzero(np.diff(frequency[order]) > _SAME * frequency[order][1:]) + 1
    runs = [rows for rows in np.split(order, edges) if len(rows) >= _FEWEST]
    return [rows[np.argsort(size[rows], kind="stable")] for rows in runs]


def _stable(frequency: Array, force: Array, size: Array) -> NDArray[np.bool_]:
    """(n,) False where the force falls as the amplitude grows at one frequency: no force held it there."""
    stable = np.ones(len(force), dtype=bool)
    for rows in _runs(frequency, size):
        stable[rows] = np.gradient(force[rows]) >= 0
    return stable


def _folded(frequency: Array, force: ComplexArray, displacement: ComplexArray) -> bool:
    """Tell whether rows one after another follow a fold at one frequency.

    There the force falls far, at two points at least, while the amplitude grows from row to row, or falls.
    Levels side by side at a frequency stand in the order of their forces.
    """
    size = np.abs(displacement)
    edges = np.flatnonzero(np.abs(np.diff(frequency)) > _SAME * frequency[1:]) + 1
    for rows in np.split(np.arange(len(frequency)), edges):
        steps = np.diff(size[rows])
        if len(rows) < _FEWEST or not (np.all(steps > 0) or np.all(steps < 0)):
            continue
        along = np.abs(force[rows])[:: 1 if steps[0] > 0 else -1]
        if np.count_nonzero(along < (1 - _FALLS) * np.maximum.accumulate(along)) >= _TWO:
            return True
    return False
