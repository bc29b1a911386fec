"""What is declared about a test: held-out levels, band, calibration, and the background of other modes."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from rsgen.errors import RsgenError

__all__ = ["BACKGROUNDS", "Observation"]

BACKGROUNDS = ("none", "phase", "constant", "residuals", "neighbour")
"""Kinds of background; each contains the ones before it."""


@dataclass(frozen=True, slots=True)
class Observation:
    """How the structure was observed, apart from its law.

    Parameters
    ----------
    background
        What the sensor sees of other modes, fitted with the law: "none"; "phase", a constant phase error
        between force and response; "constant", and a response proportional to the force; "residuals", and its
        change over the band, as modes below and above leave it; "neighbour", and one linear mode at the edge
        of the band or inside it.
    hold_out
        Nominal levels [N] that identification must not see; prediction is scored on them.
    band
        Lowest and highest frequency [Hz] that identification uses; None for all.
    calibrated
        False where force or response have no known scale (a drive in volts, a strain): parameters are then
        per unit of the drive, and so is the mass, which cannot be given.

    Raises
    ------
    RsgenError
        Unknown background, or band not ascending.
    """

    background: str = "none"
    hold_out: tuple[float, ...] = ()
    band: tuple[float, float] | None = None
    calibrated: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "hold_out", tuple(float(level) for level in self.hold_out))
        if self.background not in BACKGROUNDS:
            raise RsgenError(f"background: {self.background!r}; must be one of {', '.join(BACKGROUNDS)}")
        if self.band is not None:
            low, high = map(float, self.band)
            if not 0 <= low < high < inf:
                raise RsgenError(f"band: {low:g} to {high:g} Hz; must be ascending, finite and not negative")
            object.__setattr__(self, "band", (low, high))
