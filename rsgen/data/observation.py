"""What is declared about a test: held-out levels, band, calibration, and the background of other modes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from rsgen.common.declaration import Rule, check, declare, documented
from rsgen.common.errors import RsgenError

__all__ = ["BACKGROUNDS", "OFFSET", "Observation"]

BACKGROUNDS = ("none", "phase", "constant", "residuals", "neighbour")
"""Kinds of background; each contains the ones before it."""

OFFSET = "+offset"
"""Ending of a kind that has a response beside it which does not depend on the force."""


def _numbers(values: object, what: str, count: int | None = None) -> tuple[float, ...]:
    """Read one number or several; ``what`` names the place and what is needed there."""
    fault = RsgenError(f"{what}: {values!r:.60}; must be {'numbers' if count is None else 'numbers, a pair'}")
    try:
        found = np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError):
        raise fault from None
    if isinstance(values, str) or found.ndim != 1 or len(found) != (len(found) if count is None else count):
        raise fault
    return tuple(map(float, found))


Edge = Annotated[float, Rule(unit="Hz", at_least=0)]


@documented
@dataclass(frozen=True, slots=True)
class Observation:
    """How the structure was observed, apart from its law.

    Raises RsgenError where the background is unknown or the band not ascending.
    """

    background: Literal[
        "none",
        "phase",
        "constant",
        "residuals",
        "neighbour",
        "phase+offset",
        "constant+offset",
        "residuals+offset",
        "neighbour+offset",
    ] = declare(
        "none",
        "What the sensor sees of other modes, fitted with the law: a constant phase error between force and "
        "response; and a response proportional to the force; and its change over the band, as modes below "
        "and above leave it; and one linear mode near the band. With +offset also a displacement of constant "
        "size and phase that does not depend on the force, as pick-up from the generator leaves it.",
    )
    hold_out: tuple[Annotated[float, Rule(unit="N")], ...] = declare(
        (),
        "Nominal levels that identification must not see, by their labels where these are no amounts; "
        "prediction is scored on them.",
        most=1000,
    )
    band: tuple[Edge, Edge] | None = declare(
        None, 'Lowest and highest frequency used, such as ["40 Hz", "45 Hz"]; all without it.'
    )
    calibrated: bool = declare(
        True,
        "False: force or response have no known scale (a drive in volts, a strain). Parameters are then per "
        "unit of the drive, and so is the mass, which cannot be given.",
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "hold_out", _numbers(self.hold_out, "hold_out: levels in N"))
        if self.band is not None:
            object.__setattr__(self, "band", _numbers(self.band, "band: two frequencies in Hz", 2))
        if self.background is None:
            object.__setattr__(self, "background", "none")
        check(self)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Find what does not fit together: a field's name and what is wrong with it."""
        if self.band is not None and self.band[0] >= self.band[1]:
            yield "band", f"{self.band[0]:g} to {self.band[1]:g} Hz; must be ascending"
