"""Findings about the lag of a phase-locked test: the error from that of resonance, a quarter period."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.finding import Finding, Quantity, Severity

if TYPE_CHECKING:
    from rsgen.data.surface.response_surface import ResponseSurface

RESONANT = 0.52
"""Lags within 30 degrees of a quarter period [rad] may be meant to be one, with an uncorrected delay;
others are slices off resonance."""

_APART = 0.14
"""Lags that are set differ by more than eight degrees from the next; those of one loop scatter by less."""

_SCATTERED = 0.07
"""Lags that scatter by more than four degrees are not of one loop, but slices that were set."""

_HELD = 0.02
"""A lag within a degree of a quarter period shifts k/m by a thirtieth of the damping ratio: no matter."""

_LOST = 0.17
"""Loops that miss by ten degrees are not locked: k/m is shifted by a third of the damping ratio."""

_SAME_FORCE = 0.02
"""Forces of one slice off resonance differ by less; levels of a backbone differ by more."""

_MODES = 0.05
"""Least relative gap between the frequencies of two modes: from level to level those of one shift by less."""

_WIDER = 5.0
"""The gap between two modes is so many times as wide as the largest step within either."""

_EACH = 3
"""Points of each mode from which on it is one: a step of its own may end a backbone."""


def lag_findings(surface: ResponseSurface) -> tuple[Finding, ...]:
    """Say which lag a phase-locked test has, whether it is that of resonance, and whether of one mode.

    Nothing of other tests, and no lag where none was recorded.
    """
    if surface.control != "phase":
        return ()
    good = surface.select(surface.settled & np.isfinite(surface.phase) & (surface.amplitude > 0))
    near = np.abs(good.phase - pi / 2) < RESONANT
    gap = backbone_gap(good.frequency[near], good.amplitude[near])
    several = () if gap is None else (gap.finding(severity="warning"),)
    several = (*several, *_lock_lost(good.phase, np.abs(good.force)))
    return several if surface.lag_assumed else (*several, *_lag(good.phase))


def _lag(lag: Array) -> tuple[Finding, ...]:
    """Say which lag (n,) points have, and whether it is that of resonance."""
    off = _nearest(lag) - pi / 2
    if not len(off):
        seen = {"lag": Quantity(float(np.degrees(np.median(lag))))} if len(lag) else {}
        return (Finding("phase-not-resonant", "doubt", numbers=seen),) if len(lag) else ()
    if np.std(off) > _SCATTERED:
        return ()
    missed = float(np.median(off))
    numbers = {
        "points": Quantity(len(off)),
        "others": Quantity(len(lag) - len(off)),
        "lag": Quantity(float(np.degrees(pi / 2 + missed))),
        "scatter": Quantity(float(np.degrees(np.std(off)))),
        "shift": Quantity(float(2 * abs(np.tan(missed)))),
    }
    severity: Severity = "info" if abs(missed) < _HELD else "warning" if abs(missed) < _LOST else "doubt"
    return (Finding("phase-lag", severity, numbers=numbers),)


def _lock_lost(lag: Array, force: Array) -> tuple[Finding, ...]:
    """Name points (n,) whose lag [rad] is not that of the backbone, at a force [N] that no other point has.

    Slices off resonance are measured at the force of other points. Where most points are off, the backbone
    is not what was meant.
    """
    common = _nearest(lag)
    if len(common) <= len(lag) / 2:
        return ()
    low, high = common.min() - _APART, common.max() + _APART
    alone = np.array([np.sum(np.abs(force - one) < _SAME_FORCE * one) == 1 for one in force])
    lost = lag[((lag < low) | (lag > high)) & alone]
    if not len(lost):
        return ()
    numbers = {
        "lost": Quantity(len(lost)),
        "points": Quantity(len(lag)),
        "low": Quantity(float(np.degrees(lost.min()))),
        "high": Quantity(float(np.degrees(lost.max()))),
    }
    return (Finding("phase-lock-lost", "warning", numbers=numbers),)


@dataclass(frozen=True, slots=True)
class BackboneGap:
    """Two groups of points at phase resonance with nothing between.

    Parameters
    ----------
    low, high
        Median frequency [Hz] of either.
    overlap
        Whether there are amplitudes that both have: one mode has one frequency at an amplitude.
    """

    low: float
    high: float
    overlap: bool

    def finding(self, *, severity: Severity) -> Finding:
        """Doubt two modes; where levels may be missing between the groups, say so with a severity."""
        numbers = {"low": Quantity(self.low, "Hz"), "high": Quantity(self.high, "Hz")}
        if self.overlap:
            return Finding("phase-gap", "doubt", numbers=numbers, names={"overlap": "yes"})
        return Finding("phase-gap", severity, numbers=numbers)


def backbone_gap(frequency: Array, amplitude: Array) -> BackboneGap | None:
    """Gap between points at phase resonance (n,), in Hz and m; None where they lie on one backbone.

    A backbone is continuous, but levels may have been left out; two modes have a gap at all levels.
    """
    order = np.argsort(frequency)
    ordered, amplitude = frequency[order], amplitude[order]
    steps = np.diff(np.log(ordered))
    if len(steps) < 2 * _EACH - 1:
        return None
    inner = steps[_EACH - 1 : len(steps) - _EACH + 1]
    at = _EACH - 1 + int(np.argmax(inner))
    if not steps[at] > max(_MODES, _WIDER * float(np.delete(steps, at).max())):
        return None
    low, high = amplitude[: at + 1], amplitude[at + 1 :]
    return BackboneGap(
        low=float(np.median(ordered[: at + 1])),
        high=float(np.median(ordered[at + 1 :])),
        overlap=bool(max(low.min(), high.min()) <= min(low.max(), high.max())),
    )


def _nearest(lag: Array) -> Array:
    """The most frequent of the lags [rad] that a loop was set to, near a quarter period; none if all are far.

    Of equally frequent ones the nearest counts.
    """
    groups = np.split(np.sort(lag), np.flatnonzero(np.diff(np.sort(lag)) > _APART) + 1)
    away = [abs(float(np.median(group)) - pi / 2) if len(group) else np.inf for group in groups]
    near = [i for i in range(len(groups)) if away[i] < RESONANT]
    return groups[min(near, key=lambda i: (-len(groups[i]), away[i]))] if near else lag[:0]
