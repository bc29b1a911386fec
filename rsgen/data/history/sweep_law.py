"""The law of a sweep: frequency against time, linear or logarithmic, given or found from the force."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, log, pi

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError

__all__ = ["LAWS", "SweepLaw"]


LAWS = ("linear", "logarithmic")


@dataclass(frozen=True, slots=True)
class SweepLaw:
    """Frequency of the force against time, t in s from the first sample.

    Parameters
    ----------
    kind
        "linear": f = frequency + rate t; "logarithmic": f = frequency 2^(rate t).
    frequency
        At t = 0 [Hz].
    rate
        [Hz/s] or [octaves/s]; negative downwards.
    phase
        At t = 0 [rad].

    Raises
    ------
    MeasurementError
        An unknown kind, a frequency that is not positive, a rate that is zero or not finite.
    """

    kind: str
    frequency: float
    rate: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in LAWS:
            raise MeasurementError(f"sweep law: {self.kind!r}; must be one of {', '.join(LAWS)}")
        if not (isfinite(self.frequency) and self.frequency > 0):
            raise MeasurementError(f"sweep law: starts at {self.frequency!r} Hz; must be above 0")
        if not isfinite(self.rate) or self.rate == 0:
            raise MeasurementError(f"sweep law: rate {self.rate!r}; must be finite and not 0")

    @property
    def direction(self) -> str:
        """ "up" or "down"."""
        return "up" if self.rate > 0 else "down"

    def frequency_at(self, t: Array) -> Array:
        """Find the frequency [Hz]."""
        if self.kind == "linear":
            return np.asarray(self.frequency + self.rate * t)
        return np.asarray(self.frequency * np.exp2(self.rate * t))

    def slope_at(self, t: Array) -> Array:
        """Find df/dt [Hz/s]."""
        if self.kind == "linear":
            return np.full_like(t, self.rate)
        return np.asarray(log(2) * self.rate * self.frequency_at(t))

    def phase_at(self, t: Array) -> Array:
        """Find the phase [rad], whose derivative is 2 pi f."""
        if self.kind == "linear":
            return np.asarray(self.phase + 2 * pi * t * (self.frequency + 0.5 * self.rate * t))
        growth = log(2) * self.rate
        return np.asarray(self.phase + 2 * pi * self.frequency / growth * np.expm1(growth * t))

    def time_of(self, frequency: float) -> float:
        """Find when a frequency is passed [s]."""
        if self.kind == "linear":
            return (frequency - self.frequency) / self.rate
        # no logarithmic sweep begins at zero
        passed = log(frequency / self.frequency) if frequency > 0 else -inf
        return passed / (log(2) * self.rate)
