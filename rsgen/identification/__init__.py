"""From a response surface and laws without values to parameters with intervals; truth is never seen."""

from __future__ import annotations

from rsgen.identification.identify import identify
from rsgen.identification.modal import modal_table
from rsgen.identification.modal_result import ModalTable
from rsgen.identification.multisine import MultisineIdentification
from rsgen.identification.result import (
    EquivalentCurve,
    Estimate,
    Identification,
    Resonance,
    RestoringForce,
)

__all__ = [
    "EquivalentCurve",
    "Estimate",
    "Identification",
    "ModalTable",
    "MultisineIdentification",
    "Resonance",
    "RestoringForce",
    "identify",
    "modal_table",
]
