"""An oscillator with known values as an identification without any error, so that it can be predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding
from rsgen.data.oscillator import Model, Oscillator
from rsgen.describing import derive
from rsgen.identification.results import EquivalentCurve, Estimate, Identification

__all__ = ["as_identification"]

_SIZES = np.geomspace(1e-12, 1e3, 601)
"""Amplitudes [m] among which the resonances of an oscillator are sought: from atoms to any structure."""

_ROUNDS = 4
"""Damping may depend on the frequency, and the frequency on stiffness alone: few rounds settle both."""

_FLANK = 1e-2
"""The flanks of a resonance are drawn down to this share of its amplitude."""

_HALF_WIDTHS = 8.0
"""Half widths around the resonances of an oscillator; there the amplitude is an eighth of the largest."""

_LEAST_AROUND = 0.1
"""At least this share of the frequency is drawn on both sides."""


def as_identification(oscillator: Oscillator, levels: Sequence[float]) -> Identification:
    """Give an oscillator as an identification without any error, over the amplitudes of its resonances."""
    values = oscillator.values
    estimates = tuple(Estimate(name, value, 0.0, (value, value)) for name, value in values.items())
    amplitudes, frequencies = _resonant_ranges(oscillator, levels)
    none = np.zeros(0)
    return Identification(
        model=Model(oscillator.elements, oscillator.mass),
        paper=(),
        first_order=(),
        refined=estimates,
        first_order_bias=(),
        covariance=np.zeros((len(values), len(values))),
        resonances=(),
        curve=EquivalentCurve(none, none, none, none, none, none.astype(bool)),
        residual=0.0,
        noise=0.0,
        levels=np.array(levels),
        amplitude_range=amplitudes,
        frequency_range=frequencies,
        outcome=Finding("values-given", "info"),
    )


def _resonant_ranges(
    oscillator: Oscillator, levels: Sequence[float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Amplitudes [m] and frequencies [Hz] of the resonances of the levels, to first order."""
    function = derive(oscillator.force)
    omega = np.ones_like(_SIZES)
    for _ in range(_ROUNDS):
        with np.errstate(all="ignore"):
            first = function.evaluate(_SIZES, omega, oscillator.values)
            stiffness, damping = np.asarray(first.stiffness), np.asarray(first.damping)
            omega = np.sqrt(np.where(stiffness > 0, stiffness, np.nan) / oscillator.mass)
            omega = np.where(np.isfinite(omega), omega, 1.0)
    with np.errstate(all="ignore"):
        force = damping * omega * _SIZES
    known = np.isfinite(force) & np.isfinite(stiffness) & (stiffness > 0)
    reached = known & (force <= max(levels))
    if reached[known][-1:].all():
        raise RsgenError(
            f"predict: the resonance under {max(levels):g} N has no end; the law needs damping, and a "
            "stiffness that stays positive"
        )
    largest = float(_SIZES[reached][-1]) if reached.any() else float(_SIZES[known][0])
    small = known & (force <= min(levels))
    smallest = float(_SIZES[small][-1]) if small.any() else largest
    chosen = known & (largest >= _SIZES) & (smallest * _FLANK <= _SIZES)
    width = float(np.max(damping[chosen])) / (2 * oscillator.mass)
    low, high = float(np.min(omega[chosen])), float(np.max(omega[chosen]))
    around = max(_HALF_WIDTHS * width, _LEAST_AROUND * high)
    ends = (max(low - around, _LEAST_AROUND * low), high + around)
    return (smallest * _FLANK, largest), (ends[0] / (2 * np.pi), ends[1] / (2 * np.pi))
