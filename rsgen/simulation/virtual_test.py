"""What a virtual test measures, and how."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.errors import RsgenError

__all__ = ["SimulatedTest"]

_CHOICES = {
    "sweep": ("rest", "up", "down"),
    "method": ("time", "harmonic-balance"),
    "control": ("force", "response"),
}


def _grid(values: ArrayLike, name: str, unit: str) -> NDArray[np.float64]:
    array = np.array(values, dtype=np.float64, ndmin=1)
    if array.ndim != 1 or not array.size:
        raise RsgenError(f"test.{name}: must be one or more values in {unit}")
    if not np.all(np.isfinite(array) & (array > 0)):
        raise RsgenError(f"test.{name}: must be positive and finite everywhere [{unit}]")
    if len(np.unique(array)) != len(array):
        raise RsgenError(f"test.{name}: a value occurs more than once; every value must be unique")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedTest:
    """A stepped-sine test on a grid of levels and frequencies.

    Parameters
    ----------
    level
        Force amplitudes F [N], positive; with ``control="response"`` amplitudes X of the displacement [m].
    frequency
        [Hz], positive.
    sweep
        "rest": every point from rest; "up" or "down": the state is carried from frequency to frequency.
    harmonics
        How many harmonics of the displacement are kept besides the mean.
    accuracy
        Largest relative error of the fundamental, 1e-9 to 1e-2.
    noise_relative
        Standard deviation of complex Gaussian noise: this times |F| on the force, this times |X1| on
        every harmonic.
    seed
        Of the noise.
    method
        "time": time integration; "harmonic-balance": the independent oracle.
    control
        "force": constant F; "response": constant X, the force follows.

    Raises
    ------
    RsgenError
        A value is out of range or a choice unknown.
    """

    level: NDArray[np.float64]
    frequency: NDArray[np.float64]
    sweep: Literal["rest", "up", "down"] = "rest"
    harmonics: int = 7
    accuracy: float = 1e-4
    noise_relative: float = 0.0
    seed: int = 1
    method: Literal["time", "harmonic-balance"] = "time"
    control: Literal["force", "response"] = "force"

    def __post_init__(self) -> None:
        unit = "m" if self.control == "response" else "N"
        object.__setattr__(self, "level", _grid(self.level, "level", unit))
        object.__setattr__(self, "frequency", _grid(self.frequency, "frequency", "Hz"))
        for name, allowed in _CHOICES.items():
            if getattr(self, name) not in allowed:
                raise RsgenError(f"test.{name}: {getattr(self, name)!r}; must be one of {', '.join(allowed)}")
        if not 1 <= self.harmonics <= 64:
            raise RsgenError(f"test.harmonics: {self.harmonics}; must be 1 to 64")
        if not 1e-9 <= self.accuracy <= 1e-2:
            raise RsgenError(f"test.accuracy: {self.accuracy!r}; must be 1e-9 to 1e-2")
        if not (isfinite(self.noise_relative) and self.noise_relative >= 0):
            raise RsgenError(f"test.noise.relative: {self.noise_relative!r}; must be zero or positive")
        if self.seed < 0:
            raise RsgenError(f"test.noise.seed: {self.seed}; must be zero or positive")
