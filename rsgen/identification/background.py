"""What the sensor sees besides the mode: modes below and above the band, and an error of the phase.

A mode among others answers a force F at the sensor with

    x = q + (A + B/omega^2) F,     F = F_measured exp(i psi),

where q obeys the nonlinear law, A is what modes above add (their flexibility) and B/omega^2 what modes below
add (their inertia); both are complex, because those modes have damping, and because a sensor picks up some of
the drive (residual terms: Ewins, Modal Testing, 2000, Sec. 4.4). In a band A and B are hardly told apart, so
they are carried as the value b0 in the middle of the band and the change b1 over the band.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.points import Points
from rsgen.oscillator import BACKGROUNDS
from rsgen.surface import ResponseSurface

__all__ = ["Shape", "shape_of"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

Table = TypeVar("Table", Points, ResponseSurface)


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A background as a function of its real parameters: psi, then real and imaginary part of b0 and b1.

    Parameters
    ----------
    names, units
        Of the parameters.
    functions
        (n, t) real: what each complex term is multiplied by at each point.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    functions: Array

    def turn(self, values: Array) -> complex:
        """exp(i psi)."""
        return complex(np.exp(1j * values[0]))

    def receptance(self, values: Array) -> ComplexArray:
        """(n,) response besides the mode per force [m/N]."""
        return np.asarray(self.functions @ (values[1::2] + 1j * values[2::2]), dtype=np.complex128)

    def subtract(self, points: Table, values: Array) -> Table:
        """Leave the mode alone: its displacement, and the force in the phase of the response."""
        force = points.force * self.turn(values)
        harmonics = np.array(points.harmonics)
        harmonics[:, 1] -= self.receptance(values) * force
        peak = points.peak if np.all(self.functions == 0) else np.full_like(points.peak, np.nan)
        return replace(points, force=force, harmonics=harmonics, peak=peak)


def shape_of(kind: str, omega: Array, band: tuple[float, float]) -> Shape:
    """Give the functions of a background at the frequencies.

    Parameters
    ----------
    kind
        "phase": psi alone; "constant": and b0; "residuals": and b1.
    omega
        (n,) [rad/s].
    band
        Lowest and highest frequency [Hz] of the points that are fitted.
    """
    terms = BACKGROUNDS.index(kind) - 1
    names = ("psi", "b0_re", "b0_im", "b1_re", "b1_im")[: 1 + 2 * terms]
    units = ("rad", *["m/N"] * 4)[: 1 + 2 * terms]
    low, high = (1 / (2 * np.pi * f) ** 2 for f in band)
    # 1 in the middle for b0; from -1/2 to 1/2 over the band for b1
    change = (1 / omega**2 - (low + high) / 2) / (high - low) if high != low else np.zeros(len(omega))
    return Shape(names, units, np.stack([np.ones(len(omega)), change], axis=1)[:, :terms])
