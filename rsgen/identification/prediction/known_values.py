"""Oscillators with known values and modal tables, as identifications that can be predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import ANY_LAW
from rsgen.data.oscillator import Model, Oscillator
from rsgen.describing.derivation import derive
from rsgen.identification.modal_result import ModalTable
from rsgen.identification.results import EquivalentCurve, Estimate, Identification

_AMPLITUDES = np.geomspace(1e-12, 1e3, 601)
"""Amplitudes [m] among which the resonances of an oscillator are sought."""

_FREQUENCY_ITERATIONS = 4

_FLANK_AMPLITUDE = 1e-2
"""Smallest amplitude of a curve relative to that of the resonance."""

HALF_WIDTHS = 8.0
"""Half widths of the resonance on both sides of a curve."""

_MIN_RELATIVE_WIDTH = 0.1
"""Least width on both sides, relative to the frequency."""


def table_as_identification(table: ModalTable) -> Identification:
    """Return a modal table as an identification with ranges, levels, background, misfit and mass.

    Raises
    ------
    RsgenError
        The mass is not known, so that responses off resonance cannot be predicted.
    """
    if "damping_ratio" not in table.known:
        raise RsgenError(
            "predict: the modal table has no mass, so that responses off resonance do not follow; give the "
            "mass to modal_table, or measure off resonance"
        )
    empty = np.zeros(0)
    test = table.test
    return Identification(
        model=Model(ANY_LAW, observation=test.observation),
        refined=(Estimate("m", table.splines.mass, 0.0, (table.splines.mass,) * 2, "kg"),),
        covariance=np.zeros((1, 1)),
        curve=EquivalentCurve(*(empty,) * 5, empty.astype(bool), test.level_unit, test.units, test.base),
        residual=table.misfit,
        noise=table.misfit,
        levels=test.levels,
        amplitude_range=table.tested,
        frequency_range=test.frequencies,
        solution=np.zeros(len(Model(ANY_LAW).parameters)),
        background=test.background,
    )


def as_identification(oscillator: Oscillator, levels: Sequence[float]) -> Identification:
    """Return an oscillator as an identification without errors, over the amplitudes of its resonances."""
    values = oscillator.values
    estimates = tuple(Estimate(name, value, 0.0, (value, value)) for name, value in values.items())
    amplitudes, frequencies = _resonant_ranges(oscillator, levels)
    empty = np.zeros(0)
    return Identification(
        model=Model(oscillator.elements, oscillator.mass),
        refined=estimates,
        covariance=np.zeros((len(values), len(values))),
        curve=EquivalentCurve(*(empty,) * 5, empty.astype(bool)),
        residual=0.0,
        noise=0.0,
        levels=np.array(levels),
        amplitude_range=amplitudes,
        frequency_range=frequencies,
    )


def _resonant_ranges(
    oscillator: Oscillator, levels: Sequence[float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ranges of amplitude [m] and frequency [Hz] of the resonances, to first order."""
    function = derive(oscillator.force)
    # each loop of states takes milliseconds
    sizes = _AMPLITUDES[::4] if function.memory else _AMPLITUDES
    omega = np.ones_like(sizes)
    for _ in range(_FREQUENCY_ITERATIONS):
        with np.errstate(all="ignore"):
            first = function.evaluate(sizes, omega, oscillator.values, closing=False)
            stiffness, damping = np.asarray(first.stiffness), np.asarray(first.damping)
            closes = np.isfinite(stiffness) | (not function.memory)
            sizes, stiffness, damping = sizes[closes], stiffness[closes], damping[closes]
            omega = np.sqrt(np.where(stiffness > 0, stiffness, np.nan) / oscillator.mass)
            omega = np.where(np.isfinite(omega), omega, 1.0)
    with np.errstate(all="ignore"):
        force = damping * omega * sizes
    known = np.isfinite(force) & np.isfinite(stiffness) & (stiffness > 0)
    reached = known & (force <= max(levels))
    if reached[known][-1:].all():
        end = f", whose memory has a loop up to {sizes[-1]:.3g} m," if function.memory and len(sizes) else ""
        raise RsgenError(
            f"predict: the resonance under {max(levels):g} N has no end; the law{end} needs damping, and a "
            "stiffness that stays positive"
        )
    largest = float(sizes[reached][-1]) if reached.any() else float(sizes[known][0])
    small = known & (force <= min(levels))
    smallest = float(sizes[small][-1]) if small.any() else largest
    chosen = known & (largest >= sizes) & (smallest * _FLANK_AMPLITUDE <= sizes)
    width = float(np.max(damping[chosen])) / (2 * oscillator.mass)
    low, high = float(np.min(omega[chosen])), float(np.max(omega[chosen]))
    around = max(HALF_WIDTHS * width, _MIN_RELATIVE_WIDTH * high)
    ends = (max(low - around, _MIN_RELATIVE_WIDTH * low), high + around)
    return (smallest * _FLANK_AMPLITUDE, largest), (ends[0] / (2 * np.pi), ends[1] / (2 * np.pi))


def force_per_level(found: Identification) -> float:
    """Return the force [N] for each m/s^2 of a driven base: the mass, or 1 where there is none."""
    return found.mass if found.curve.base and np.isfinite(found.curve.units.kilogram) else 1.0
