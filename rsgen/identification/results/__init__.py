"""What identification hands on: values with intervals, what they rest on, and the verdict on them."""

from __future__ import annotations

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
    units_of,
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
