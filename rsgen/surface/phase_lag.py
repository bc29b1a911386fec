"""Whether a phase-locked loop held the lag of resonance, a quarter period, and by how much it missed."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np

from rsgen.arrays import ComplexArray
from rsgen.finding import Finding, Quantity, Severity

if TYPE_CHECKING:
    from rsgen.surface.response_surface import ResponseSurface

__all__ = ["at_phase_resonance", "lag_findings"]

_RESONANT = 0.52
"""Points within 30 degrees of a quarter period were meant to lie there; others are slices off resonance."""

_HELD = 0.02
"""A lag within a degree of a quarter period shifts k/m by a thirtieth of the damping ratio: no matter."""

_LOST = 0.17
"""Loops that miss by ten degrees are not locked: k/m is shifted by a third of the damping ratio."""

_CLOSE = 0.35
"""Where all points lie within 20 degrees of a quarter period, a loop held them: sweeps pass the flanks."""

_FEWEST = 4
"""Points from which on that is no accident."""


def at_phase_resonance(ratio: ComplexArray) -> bool:
    """Tell whether force over displacement (n,) complex is that of phase resonance at every point."""
    ratio = ratio[np.isfinite(ratio)]
    return len(ratio) >= _FEWEST and bool(np.all(np.abs(np.angle(ratio) - pi / 2) < _CLOSE))


def lag_findings(surface: ResponseSurface) -> tuple[Finding, ...]:
    """Say which lag a phase-locked test has, and whether it is that of resonance.

    Nothing of other tests, and nothing where no lag was recorded.
    """
    if surface.control != "phase" or not surface.phase_known or surface.lag_assumed:
        return ()
    good = surface.settled & np.isfinite(surface.amplitude) & (surface.amplitude > 0)
    lag = surface.select(good).phase
    off = lag[np.abs(lag - pi / 2) < _RESONANT] - pi / 2
    if not len(off):
        seen = {"lag": Quantity(float(np.degrees(np.median(lag))))} if len(lag) else {}
        return (Finding("phase-not-resonant", "doubt", numbers=seen),) if len(lag) else ()
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
