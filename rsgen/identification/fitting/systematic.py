"""Whether misfits have a pattern: those of neighbours go together where the law, not noise, makes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.tolerances import CHANCE, NOTICEABLE

__all__ = ["is_systematic"]

_SYSTEMATIC = 0.3
"""Correlation of neighbouring misfits, or share of them, that is the law's, not the noise's."""

_PAIRS = 6
"""Pairs of neighbours below which their correlation says nothing."""


def is_systematic(residual: Array, pairs: NDArray[np.intp]) -> bool:
    """Tell whether misfits of any quantity go together between neighbours in frequency of one run.

    Parameters
    ----------
    residual
        (n, M) of force, fundamental and harmonics, real and imaginary parts, relative.
    pairs
        (k, 2) points next to each other in the test, of those that count; see ``Points.pairs``.
    """
    if len(pairs) < _PAIRS:
        return False
    first, second = (residual[side] for side in pairs.T)
    # (M,) of force, fundamental and harmonics, real and imaginary parts
    power = np.mean(residual[pairs] ** 2, axis=(0, 1))
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
