"""What was measured at each level, as a number: the force near the resonance, or the amplitude held."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rsgen.common.arrays import Array

if TYPE_CHECKING:
    from rsgen.data.surface.response_surface import ResponseSurface

__all__ = ["HALF_POWER", "match_level", "typical_amounts"]

HALF_POWER = 1 / np.sqrt(2)
"""Points of at least this share of the largest amplitude, or whose lag has a sine as large (45 degrees off a
quarter period), are near the resonance: within half power."""
_EXACT = 1e-6
"""A measured amount that differs from the nominal level by less, relatively, is the level: round-off."""
_PRINTED = 3
"""Digits that identify a level at least: pages and messages print no fewer."""


def typical_amounts(surface: ResponseSurface, amount: Array | None = None) -> Array:
    """Typical measured amount of each of ``surface.levels``: a force [N], or an amplitude [m] that was held.

    The force is its median near the resonance, where it decides the response: shakers drop there. NaN where
    no point of the level settled. ``amount`` (n,) stands for the size of the force.
    """
    size, force = surface.amplitude, np.abs(surface.force) if amount is None else amount
    good = surface.settled & np.isfinite(size) & np.isfinite(force) & (force > 0)
    found = np.full(len(surface.levels), np.nan)
    for number, level in enumerate(surface.levels):
        at = np.flatnonzero(good & (surface.level == level))
        if not len(at):
            continue
        near = at[size[at] >= HALF_POWER * size[at].max()]
        value = float(np.median(size[at] if surface.response_held else force[near]))
        found[number] = level if abs(value - level) <= _EXACT * abs(level) else value
    return found


def match_level(levels: Array, asked: float) -> float | None:
    """Find the level that somebody means by a number as it is printed: equal within its digits; None if none.

    Parameters
    ----------
    levels
        (k,) levels there are, different from each other.
    asked
        As typed or copied from a page; its digits count, but three at least.

    Examples
    --------
    >>> match_level(np.array([2.386357e-09, 5.1e-09]), 2.38636e-09)
    2.386357e-09
    >>> match_level(np.array([2.6, 5.0]), 3.0) is None
    True
    """
    exact = [float(level) for level in levels if abs(level - asked) <= _EXACT * abs(asked)]
    if exact:
        return min(exact, key=lambda level: abs(level - asked))
    mantissa = f"{asked:.15e}".partition("e")[0].replace(".", "").lstrip("-").rstrip("0")
    digits = max(_PRINTED, len(mantissa))
    alike = [float(level) for level in levels if float(f"{level:.{digits}g}") == float(f"{asked:.{digits}g}")]
    return alike[0] if len(alike) == 1 else None
