"""What a virtual test measures, and how."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike

from rsgen.arrays import Array, ComplexArray
from rsgen.declaration import Rule, check, declare, documented
from rsgen.errors import RsgenError
from rsgen.steady_state.solver import ACCURACY, HARMONICS
from rsgen.surface.columns import BASE_UNITS, BASES

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
        Rule(
            "Force amplitudes F; amplitudes X of the displacement [m] under response control; of the motion "
            "of a base as [test.base] says.",
            unit="N",
        ),
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

    base: Literal["displacement", "velocity", "acceleration"] | None = declare(
        None,
        "What of the motion of a shaken base the levels are amplitudes of, instead of a force. The response "
        "is the motion relative to the base.",
        key="base.quantity",
    )

    def __post_init__(self) -> None:
        unit = self.level_unit
        object.__setattr__(self, "level", _grid(self.level, "level", unit))
        object.__setattr__(self, "frequency", _grid(self.frequency, "frequency", "Hz"))
        check(self)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name and what is wrong with it."""
        if self.control == "response" and self.method != "time":
            yield "method", f"{self.method!r} has no control 'response'; must be 'time'"
        if self.control == "response" and self.base is not None:
            yield "base", "is shaken, but the response is held, by a force; leave one of them out"

    @property
    def level_unit(self) -> str:
        """SI unit of the levels."""
        return "m" if self.control == "response" else BASE_UNITS[self.base or ""]

    def drive(self, mass: float, level: Array, frequency: Array) -> ComplexArray:
        """(n,) complex force [N] on the mass [kg] at levels and frequencies [Hz]: -m a_b of a shaken base.

        The motion of the base has phase zero.
        """
        if self.base is None:
            return np.asarray(level, dtype=np.complex128)
        derivatives = len(BASES) - 1 - BASES.index(self.base)
        return np.asarray(-mass * (2j * np.pi * frequency) ** derivatives * level)
