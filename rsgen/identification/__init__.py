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
from rsgen.oscillator import Model
from rsgen.surface import ResponseSurface

__all__ = [
    "Candidate",
    "EquivalentCurve",
    "Estimate",
    "Identification",
    "Resonance",
    "RestoringForce",
    "identify",
]


def identify(surface: ResponseSurface, model: Model) -> Identification:
    """Identify every parameter of the model's laws, and the mass where it is not given."""
    raise NotImplementedError
