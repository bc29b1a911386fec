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

MAX_LAG_ERROR = 0.52
"""30 degrees [rad]: within it of a quarter period a lag is meant to be one, but for an uncorrected delay;
others are slices off resonance."""

_MAX_LAG_SCATTER = 0.07
"""Standard deviation [rad], 4 degrees, of the lags of one loop; the next lag that is set is twice as far."""

_LAG_ERROR_NEGLIGIBLE = 0.02
"""One degree [rad]: the lag error shifts k/m by a thirtieth of the damping ratio."""

_LAG_ERROR_DOUBTFUL = 0.17
"""Ten degrees [rad]: the loop is not locked, and k/m is shifted by a third of the damping ratio."""

_MAX_FORCE_SPREAD = 0.02
"""Relative difference of the forces of one slice off resonance; levels of a backbone differ by more."""

MIN_MODE_SPACING = 0.05
"""Relative distance of the frequencies of two modes; from level to level those of one shift by less."""

_MIN_GAP_RATIO = 5.0
"""Of the gap between two modes to the largest step within either."""

_MIN_POINTS = 3
"""Points of a mode; fewer may be the end of a backbone."""


def lag_findings(surface: ResponseSurface) -> tuple[Finding, ...]:
    """Return findings about the lag of a phase-locked test: its error, and whether it is of one mode.

    None of other tests, and none about the lag where none was recorded.
    """
    if surface.control != "phase":
        return ()
    good = surface.select(surface.settled & np.isfinite(surface.phase) & (surface.amplitude > 0))
    near = np.abs(good.phase - pi / 2) < MAX_LAG_ERROR
    gap = backbone_gap(good.frequency[near], good.amplitude[near])
    several = () if gap is None else (gap.finding(severity="warning"),)
    several = (*several, *_lock_lost(good.phase, np.abs(good.force)))
    return several if surface.lag_assumed else (*several, *_lag(good.phase))


def _lag(lag: Array) -> tuple[Finding, ...]:
    """Return a finding about the lag (n,) [rad] of the points and its error from that of resonance."""
    off = _nearest(lag) - pi / 2
    if not len(off):
        seen = {"lag": Quantity(float(np.degrees(np.median(lag))))} if len(lag) else {}
        return (Finding("phase-not-resonant", "doubt", numbers=seen),) if len(lag) else ()
    if np.std(off) > _MAX_LAG_SCATTER:
        return ()
    missed = float(np.median(off))
    numbers = {
        "points": Quantity(len(off)),
        "others": Quantity(len(lag) - len(off)),
        "lag": Quantity(float(np.degrees(pi / 2 + missed))),
        "scatter": Quantity(float(np.degrees(np.std(off)))),
        "shift": Quantity(float(2 * abs(np.tan(missed)))),
    }
    size = abs(missed)
    severity: Severity = "warning" if size < _LAG_ERROR_DOUBTFUL else "doubt"
    severity = "info" if size < _LAG_ERROR_NEGLIGIBLE else severity
    return (Finding("phase-lag", severity, numbers=numbers),)


def _lock_lost(lag: Array, force: Array) -> tuple[Finding, ...]:
    """Return a finding about points (n,) whose lag [rad] differs from that of the backbone.

    Points at a force [N] that others have are slices off resonance, and not counted. None where most points
    differ: such a test is no backbone.
    """
    common = _nearest(lag)
    if len(common) <= len(lag) / 2:
        return ()
    low, high = common.min() - 2 * _MAX_LAG_SCATTER, common.max() + 2 * _MAX_LAG_SCATTER
    alone = np.array([np.sum(np.abs(force - one) < _MAX_FORCE_SPREAD * one) == 1 for one in force])
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
        True if their amplitudes overlap: one mode has one frequency at an amplitude.
    """

    low: float
    high: float
    overlap: bool

    def finding(self, *, severity: Severity) -> Finding:
        """Return a doubt about two modes; with this severity where levels may be missing instead."""
        numbers = {"low": Quantity(self.low, "Hz"), "high": Quantity(self.high, "Hz")}
        if self.overlap:
            return Finding("phase-gap", "doubt", numbers=numbers, names={"overlap": "yes"})
        return Finding("phase-gap", severity, numbers=numbers)


def backbone_gap(frequency: Array, amplitude: Array) -> BackboneGap | None:
    """Return the gap between points at phase resonance (n,), in Hz and m; None if on one backbone.

    A backbone is continuous, but levels may have been left out; two modes have a gap at all levels.
    """
    order = np.argsort(frequency)
    ordered, amplitude = frequency[order], amplitude[order]
    steps = np.diff(np.log(ordered))
    if len(steps) < 2 * _MIN_POINTS - 1:
        return None
    inner = steps[_MIN_POINTS - 1 : len(steps) - _MIN_POINTS + 1]
    at = _MIN_POINTS - 1 + int(np.argmax(inner))
    if not steps[at] > max(MIN_MODE_SPACING, _MIN_GAP_RATIO * float(np.delete(steps, at).max())):
        return None
    low, high = amplitude[: at + 1], amplitude[at + 1 :]
    return BackboneGap(
        low=float(np.median(ordered[: at + 1])),
        high=float(np.median(ordered[at + 1 :])),
        overlap=bool(max(low.min(), high.min()) <= min(low.max(), high.max())),
    )


def _nearest(lag: Array) -> Array:
    """Return the lags [rad] of the most frequent setting of a loop near a quarter period; none without one.

    Of equally frequent settings, the nearest is taken.
    """
    groups = np.split(np.sort(lag), np.flatnonzero(np.diff(np.sort(lag)) > 2 * _MAX_LAG_SCATTER) + 1)
    away = [abs(float(np.median(group)) - pi / 2) if len(group) else np.inf for group in groups]
    near = [i for i in range(len(groups)) if away[i] < MAX_LAG_ERROR]
    return groups[min(near, key=lambda i: (-len(groups[i]), away[i]))] if near else lag[:0]
