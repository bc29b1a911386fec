"""Whether a phase-locked loop held the lag of resonance, a quarter period, and by how much it missed."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np

from rsgen.arrays import Array, ComplexArray
from rsgen.finding import Finding, Quantity, Severity

if TYPE_CHECKING:
    from rsgen.surface.response_surface import ResponseSurface

__all__ = ["at_phase_resonance", "lag_findings", "two_modes"]

_RESONANT = 0.52
"""Lags within 30 degrees of a quarter period may be meant to be one; others are slices off resonance."""

_APART = 0.14
"""Lags that are set differ by more than eight degrees from the next; those of one loop scatter by less."""

_SCATTERED = 0.07
"""Lags that scatter by more than four degrees are not of one loop, but slices that were set."""

_HELD = 0.02
"""A lag within a degree of a quarter period shifts k/m by a thirtieth of the damping ratio: no matter."""

_LOST = 0.17
"""Loops that miss by ten degrees are not locked: k/m is shifted by a third of the damping ratio."""

_CLOSE = 0.35
"""Where all points lie within 20 degrees of a quarter period, a loop held them: sweeps pass the flanks."""

_MODES = 0.05
"""Least relative gap between the frequencies of two modes: from level to level those of one shift by less."""

_WIDER = 5.0
"""The gap between two modes is so many times as wide as the largest step within either."""

_EACH = 3
"""Points of each mode from which on it is one: a step of its own may end a backbone."""

_FEWEST = 4
"""Points from which on that is no accident."""


def at_phase_resonance(ratio: ComplexArray) -> bool:
    """Tell whether force over displacement (n,) complex is that of phase resonance at every point."""
    ratio = ratio[np.isfinite(ratio)]
    return len(ratio) >= _FEWEST and bool(np.all(np.abs(np.angle(ratio) - pi / 2) < _CLOSE))


def lag_findings(surface: ResponseSurface) -> tuple[Finding, ...]:
    """Say which lag a phase-locked test has, whether it is that of resonance, and whether of one mode.

    Nothing of other tests, and no lag where none was recorded.
    """
    if surface.control != "phase" or not surface.phase_known:
        return ()
    good = surface.select(surface.settled & np.isfinite(surface.amplitude) & (surface.amplitude > 0))
    modes = two_modes(good.frequency[np.abs(good.phase - pi / 2) < _RESONANT])
    numbers = {} if modes is None else {"low": Quantity(modes[0], "Hz"), "high": Quantity(modes[1], "Hz")}
    several = (Finding("phase-two-modes", "doubt", numbers=numbers),) if modes else ()
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
    if abs(missed) < _HELD:
        return (Finding("phase-lag-held", "info", numbers=numbers),)
    severity: Severity = "warning" if abs(missed) < _LOST else "doubt"
    return (Finding("phase-lag-off", severity, numbers=numbers),)


def two_modes(frequency: Array) -> tuple[float, float] | None:
    """Median frequencies [Hz] of two modes that points at phase resonance (n,) belong to; None of one.

    A backbone is continuous; between two there is a gap.
    """
    ordered = np.sort(frequency)
    steps = np.diff(np.log(ordered))
    if len(steps) < 2 * _EACH - 1:
        return None
    inner = steps[_EACH - 1 : len(steps) - _EACH + 1]
    at = _EACH - 1 + int(np.argmax(inner))
    if not steps[at] > max(_MODES, _WIDER * float(np.delete(steps, at).max())):
        return None
    return float(np.median(ordered[: at + 1])), float(np.median(ordered[at + 1 :]))


def _nearest(lag: Array) -> Array:
    """The most frequent of the lags [rad] that a loop was set to, near a quarter period; none if all are far.

    Of equally frequent ones the nearest counts.
    """
    groups = np.split(np.sort(lag), np.flatnonzero(np.diff(np.sort(lag)) > _APART) + 1)
    away = [abs(float(np.median(group)) - pi / 2) if len(group) else np.inf for group in groups]
    near = [i for i in range(len(groups)) if away[i] < _RESONANT]
    return groups[min(near, key=lambda i: (-len(groups[i]), away[i]))] if near else lag[:0]
