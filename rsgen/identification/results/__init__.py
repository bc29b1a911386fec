"""Results of an identification: values with intervals, the data that they rest on, findings and verdict."""

from __future__ import annotations

from rsgen.data.oscillator import units_of
from rsgen.identification.results.result import (
    Background,
    EquivalentCurve,
    Estimate,
    Identification,
    MultisineIdentification,
    Resonance,
    RestoringForce,
    changed,
    later,
)

__all__ = [
    "Background",
    "EquivalentCurve",
    "Estimate",
    "Identification",
    "MultisineIdentification",
    "Resonance",
    "RestoringForce",
    "changed",
    "later",
    "units_of",
]
