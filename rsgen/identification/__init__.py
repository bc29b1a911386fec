"""From a response surface and laws without values to parameters with intervals; truth is never seen."""

from __future__ import annotations

from rsgen.identification.result import (
    Candidate,
    EquivalentCurve,
    Estimate,
    Identification,
    Resonance,
    RestoringForce,
)
from rsgen.identification.stages import identify

__all__ = [
    "Candidate",
    "EquivalentCurve",
    "Estimate",
    "Identification",
    "Resonance",
    "RestoringForce",
    "identify",
]
