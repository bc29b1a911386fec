"""Whether misfits have a pattern: those of neighbours go together where the law, not noise, makes them."""

from __future__ import annotations

import numpy as np

from rsgen.fitting.least_squares import Regression
from rsgen.fitting.points import Points
from rsgen.tolerances import CHANCE, NOTICEABLE

__all__ = ["is_systematic"]

_SYSTEMATIC = 0.3
"""Correlation of neighbouring misfits, or share of them, that is the law's, not the noise's."""

_PAIRS = 6
"""Pairs of neighbours below which their correlation says nothing."""


def is_systematic(points: Points, regression: Regression, level: float | None = None) -> bool:
    """Tell whether misfits of any quantity go together between neighbours in frequency of one run.

    Of all levels, or of one.
    """
    pairs = points.neighbours
    counted = regression.used if level is None else regression.used & (points.level == level)
    pairs = pairs[counted[pairs].all(axis=1)]
    if len(pairs) < _PAIRS:
        return False
    first, second = (regression.residual[side] for side in pairs.T)
    # (M,) of force, fundamental and harmonics, real and imaginary parts
    power = np.mean(regression.residual[pairs] ** 2, axis=(0, 1))
    counts = power > NOTICEABLE**2 / 2
    product = np.mean(first * second, axis=0)[counts]
    if not counts.any():
        return False
    # real and imaginary part are two independent numbers of a pair, whatever was recorded
    each, together = np.max(product / power[counts]), product.sum() / power[counts].sum()
    return bool(each > _by_chance(len(pairs)) or together > _by_chance(2 * len(pairs)))


def _by_chance(pairs: int) -> float:
    """Correlation of so many pairs that noise hardly reaches (Fisher, Metron 1, 1921: atanh r is normal)."""
    return max(_SYSTEMATIC, float(np.tanh(CHANCE / np.sqrt(pairs - 3))))
