"""What a virtual test measures, and how."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike

from rsgen.arrays import Array
from rsgen.declaration import Rule, check, declare, documented
from rsgen.errors import RsgenError
from rsgen.steady_state.solver import ACCURACY, HARMONICS

__all__ = ["SimulatedTest"]


def _grid(values: ArrayLike, name: str, unit: str) -> Array:
    try:
        array = np.array(values, dtype=np.float64, ndmin=1)
    except (TypeError, ValueError):
        raise RsgenError(f"test.{name}: {values!r:.60}; must be numbers [{unit}]") from None
    if array.ndim != 1 or not array.size:
        raise RsgenError(f"test.{name}: must be one or more values in {unit}")
    if not np.all(np.isfinite(array) & (array > 0)):
        raise RsgenError(f"test.{name}: must be positive and finite everywhere [{unit}]")
    if len(np.unique(array)) != len(array):
        raise RsgenError(f"test.{name}: a value occurs more than once; every value must be unique")
    array.flags.writeable = False
    return array


@documented
@dataclass(frozen=True, slots=True, eq=False)
class SimulatedTest:
    """A stepped-sine test on a grid of levels and frequencies.

    Raises RsgenError where a value is out of range or a choice unknown.
    """

    level: Annotated[
        Array,
        Rule("Force amplitudes F; amplitudes X of the displacement [m] under response control.", unit="N"),
    ]
    frequency: Annotated[Array, Rule("Frequencies.", unit="Hz")]
    sweep: Literal["rest", "up", "down"] = declare(
        "rest", "rest: every point from rest. up, down: the state is carried from frequency to frequency."
    )
    harmonics: Annotated[int, HARMONICS] = 7
    accuracy: Annotated[float, ACCURACY] = 1e-4
    noise_relative: float = declare(
        0.0,
        "Complex Gaussian noise on force and response: standard deviation over amplitude.",
        at_least=0,
        at_most=1,
        key="noise.relative",
        required=True,
    )
    seed: int = declare(1, "Of the noise.", at_least=0, at_most=2**63 - 1, key="noise.seed")
    method: Literal["time", "harmonic-balance"] = declare(
        "time", "time: time integration. harmonic-balance: the independent oracle."
    )
    control: Literal["force", "response"] = declare(
        "force", "force: constant F. response: constant X, the force follows."
    )

    def __post_init__(self) -> None:
        unit = "m" if self.control == "response" else "N"
        object.__setattr__(self, "level", _grid(self.level, "level", unit))
        object.__setattr__(self, "frequency", _grid(self.frequency, "frequency", "Hz"))
        check(self)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name and what is wrong with it."""
        if self.control == "response" and self.method != "time":
            yield "method", f"{self.method!r} has no control 'response'; must be 'time'"
