"""From what a sensor gives to displacement, velocity and acceleration of harmonics whose amplitudes change.

With y(t) = Re Y(t) exp(i h phi(t)), s = Y'/Y + i h phi' is the complex rate at which the harmonic moves:
growth and frequency. Differentiation is exact, y' = s y and y'' = (s^2 + s') y; integration is its asymptotic
inverse, z = y/s (1 + s'/s^2 + ...), whose next term is of second order in how fast the rate itself changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.surface.columns import DERIVATIVE

__all__ = ["HARMONICS", "Kinematics", "differentiate", "displacement_harmonics", "highest_order"]


HARMONICS = 5
"""Harmonics of the displacement unless asked otherwise; those of smooth laws are in the noise beyond."""
_NYQUIST = 0.45
"""Harmonics up to this fraction of the sampling rate are taken: recorders filter off what is near 0.5."""


def highest_order(wanted: int, rate: float, frequency: float) -> int:
    """Find the highest harmonic, at most ``wanted``, that a sampling rate [Hz] lets through; at least 1."""
    return max(1, min(wanted, int(_NYQUIST * rate / frequency)))


@dataclass(frozen=True, slots=True, eq=False)
class Kinematics:
    """Displacement [m], velocity [m/s] and acceleration [m/s^2] (n,) of one harmonic, complex."""

    displacement: ComplexArray
    velocity: ComplexArray
    acceleration: ComplexArray

    @property
    def omega(self) -> Array:
        """(n,) angular frequency of the steady motion with this acceleration [rad/s].

        omega^2 = -Re(A/X): in it the slow change of the amplitude has no part.
        """
        # where nothing moved, as in a drop-out, the frequency is unknown
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            ratio = np.real(self.acceleration / self.displacement)
        return np.asarray(np.sqrt(np.maximum(-ratio, 0.0)))

    def select(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Kinematics:
        """Take some of the points."""
        return Kinematics(*(getattr(self, entry.name)[chosen] for entry in fields(self)))

    @classmethod
    def joined(cls, parts: Sequence[Kinematics]) -> Kinematics:
        """Put points one after the other."""
        return cls(*(np.concatenate([getattr(p, entry.name) for p in parts]) for entry in fields(cls)))


def differentiate(envelope: ComplexArray, omega: Array, slope: Array, quantity: str) -> Kinematics:
    """Turn the envelope of a measured quantity into the kinematics of its harmonic.

    ``envelope`` (n, 3) is what was measured and its first and second time derivative [SI], ``omega`` (n,) the
    rate h phi' of the reference [rad/s], ``slope`` (n,) its change [rad/s^2].
    """
    y = envelope[:, 0]
    # unknown where nothing moved
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        growth = envelope[:, 1] / y
        s = growth + 1j * omega
        change = envelope[:, 2] / y - growth**2 + 1j * slope
        if quantity == "displacement":
            return Kinematics(y, s * y, (s**2 + change) * y)
        if quantity == "velocity":
            velocity, acceleration, slower = y, s * y, s
        else:
            velocity, acceleration, slower = y / s * (1 + change / s**2), y, s - change / s
        return Kinematics(velocity / slower * (1 + change / slower**2), velocity, acceleration)


def displacement_harmonics(
    measured: ComplexArray, omega: Array, quantity: str, harmonics: int
) -> ComplexArray:
    """Integrate mean and steady harmonics (n, k+1) [SI] of a measured quantity at ``omega`` (n,) [rad/s].

    Returns (n, harmonics + 1) displacement [m]; NaN above k, and for the mean of a velocity or an
    acceleration.
    """
    table = np.full((len(measured), harmonics + 1), np.nan, dtype=complex)
    order = np.arange(1, measured.shape[1])
    table[:, order] = measured[:, order] / (1j * order * omega[:, None]) ** DERIVATIVE[quantity]
    if quantity == "displacement":
        table[:, 0] = measured[:, 0].real
    return table
