"""What the sensor sees besides the mode: modes below and above the band, and an error of the phase.

A mode among others answers a force F at the sensor with

    x = q + (A + B/omega^2) F,     F = F_measured exp(i psi),

where q obeys the nonlinear law, A is what modes above add (their flexibility) and B/omega^2 what modes below
add (their inertia); both are complex, because those modes have damping, and because a sensor picks up some of
the drive (residual terms: Ewins, Modal Testing, 2000, Sec. 4.4). In a band A and B are hardly told apart, so
they are carried as the value b0 in the middle of the band and the change b1 over the band. A mode so near
that these do not do has a term of its own, r/(omega_n^2 - omega^2 + 2 i zeta omega_n omega): it is linear.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.data import Points
from rsgen.observation import BACKGROUNDS
from rsgen.surface import ResponseSurface

__all__ = ["Shape", "shape_of"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

Table = TypeVar("Table", Points, ResponseSurface)


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A background as a function of real parameters: psi, real and imaginary part of b0, b1; a neighbour.

    Parameters
    ----------
    names, units
        Of the parameters.
    functions
        (n, t) real: what each complex term is multiplied by at each point.
    omega
        (n,) [rad/s].
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    functions: Array
    omega: Array

    @property
    def _terms(self) -> int:
        return 1 + 2 * int(self.functions.shape[1])

    def turn(self, values: Array) -> complex:
        """exp(i psi)."""
        return complex(np.exp(1j * values[0]))

    def receptance(self, values: Array) -> ComplexArray:
        """(n,) response besides the mode per force [m/N]."""
        terms = values[: self._terms]
        total = self.functions @ (terms[1::2] + 1j * terms[2::2])
        if len(values) > self._terms:
            real, imaginary = values[self._terms : self._terms + 2]
            total = total + (real + 1j * imaginary) * self._neighbour(values)[0]
        return np.asarray(total, dtype=np.complex128)

    def slopes(self, values: Array) -> ComplexArray:
        """(n, b - 1) derivatives of the receptance by all values but psi."""
        columns = (self.functions[:, :, None] * np.array([1, 1j])).reshape(len(self.omega), -1)
        if len(values) > self._terms:
            residue = complex(*values[self._terms : self._terms + 2])
            one, by_frequency, by_damping = self._neighbour(values)
            columns = np.column_stack([columns, one, 1j * one, residue * by_frequency, residue * by_damping])
        return np.asarray(columns, dtype=np.complex128)

    def _neighbour(self, values: Array) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """(n,) receptance of a mode of mass 1 kg, and its derivatives by f_n [Hz] and zeta."""
        own, zeta = 2 * np.pi * values[-2], values[-1]
        one = 1 / (own**2 - self.omega**2 + 2j * zeta * own * self.omega)
        by_frequency = -(one**2) * (2 * own + 2j * zeta * self.omega) * 2 * np.pi
        return one, by_frequency, -(one**2) * 2j * own * self.omega

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
        "phase": psi alone; "constant": and b0; "residuals": and b1; "neighbour": and a mode near the band.
    omega
        (n,) [rad/s].
    band
        Lowest and highest frequency [Hz] of the points that are fitted.
    """
    terms = min(BACKGROUNDS.index(kind) - 1, 2)
    names = ("psi", "b0_re", "b0_im", "b1_re", "b1_im")[: 1 + 2 * terms]
    units = ("rad", *["m/N"] * 4)[: 1 + 2 * terms]
    if kind == "neighbour":
        names, units = (*names, "r_re", "r_im", "f_n", "zeta"), (*units, "1/kg", "1/kg", "Hz", "")
    low, high = (1 / (2 * np.pi * f) ** 2 for f in band)
    # 1 in the middle for b0; from -1/2 to 1/2 over the band for b1
    change = (1 / omega**2 - (low + high) / 2) / (high - low) if high != low else np.zeros(len(omega))
    return Shape(names, units, np.stack([np.ones(len(omega)), change], axis=1)[:, :terms], omega)
