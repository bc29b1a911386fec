"""From what a sensor gives to displacement, velocity and acceleration of one harmonic, amplitudes moving.

With y(t) = Re Y(t) exp(i h phi(t)), s = Y'/Y + i h phi' is the complex rate at which the harmonic moves:
growth and frequency. Differentiation is exact, y' = s y and y'' = (s^2 + s') y; integration is its asymptotic
inverse, z = y/s (1 + s'/s^2 + ...), whose next term is of second order in how fast the rate itself changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Motion", "displace"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Complex amplitudes (n,) of displacement [m], velocity [m/s] and acceleration [m/s^2]."""

    displacement: ComplexArray
    velocity: ComplexArray
    acceleration: ComplexArray

    @property
    def omega(self) -> Array:
        """(n,) angular frequency of the steady motion with this acceleration [rad/s].

        omega^2 = -Re(A/X): in it the slow change of the amplitude has no part.
        """
        # where nothing moved, as in a drop-out, the frequency is unknown
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.real(self.acceleration / self.displacement)
        return np.asarray(np.sqrt(np.maximum(-ratio, 0.0)))


def displace(envelope: ComplexArray, omega: Array, slope: Array, quantity: str) -> Motion:
    """Turn the envelope of a measured quantity into motion.

    Parameters
    ----------
    envelope
        (n, 3) envelope of what was measured and its first and second time derivative [SI].
    omega
        (n,) rate h phi' of the reference [rad/s].
    slope
        (n,) its change h phi'' [rad/s^2].
    quantity
        "displacement", "velocity" or "acceleration".
    """
    y = envelope[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        growth = envelope[:, 1] / y
        s = growth + 1j * omega
        change = envelope[:, 2] / y - growth**2 + 1j * slope
        if quantity == "displacement":
            return Motion(y, s * y, (s**2 + change) * y)
        velocity = y if quantity == "velocity" else y / s * (1 + change / s**2)
        slower = s if quantity == "velocity" else s - change / s
        return Motion(
            velocity / slower * (1 + change / slower**2),
            velocity,
            s * y if quantity == "velocity" else y,
        )
