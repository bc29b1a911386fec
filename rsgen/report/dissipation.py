"""What a test and its model say about the energy of a cycle: for the page as a finding, for result.json."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np

from rsgen.common.finding import Finding, Quantity
from rsgen.common.tolerances import NORMAL
from rsgen.data.surface import ResponseSurface
from rsgen.identification.results import Identification
from rsgen.law.element import Element
from rsgen.report.figures.cycles import (
    Energy,
    dissipated_energy,
    identified_slips,
    measured_energy,
    mode_surface,
    small_stiffness,
)
from rsgen.report.figures.equivalent import solution_of

__all__ = ["dissipation_entry", "dissipation_findings", "slip_findings"]


def _energies(surface: ResponseSurface, identification: Identification) -> tuple[Energy, Energy]:
    return measured_energy(mode_surface(surface, identification)), dissipated_energy(identification)


def dissipation_findings(surface: ResponseSurface, identification: Identification) -> list[Finding]:
    """Find with which power of the amplitude the energy of a cycle grows, as measured and as identified."""
    measured, refined = _energies(surface, identification)
    found = []
    if isfinite(measured.exponent):
        numbers = {
            "exponent": Quantity(measured.exponent),
            "half_width": Quantity(NORMAL * measured.error),
            "points": Quantity(len(measured.amplitude)),
        }
        found.append(Finding("energy-measured", "info", numbers=numbers))
    if isfinite(refined.exponent):
        numbers = {}
        for name, end in (("first", 0), ("last", -1)):
            numbers[name] = Quantity(float(refined.course[end]))
            numbers[f"amplitude_{name}"] = Quantity(float(refined.amplitude[end]), "m")
        found.append(Finding("energy-identified", "info", numbers=numbers))
    return found


def _known(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def dissipation_entry(surface: ResponseSurface, identification: Identification) -> dict[str, Any]:
    """Give the entry "dissipation" of result.json, SI units; what is not known is null."""
    measured, refined = _energies(surface, identification)
    values = solution_of(identification)
    ends = [0, -1] if isfinite(refined.exponent) else []
    known = np.isfinite([values[name] for name in identification.model.parameters]).all()
    rest = small_stiffness(identification, values) if known else float("nan")
    return {
        "measured": {
            "exponent": _known(measured.exponent),
            "standard_error": _known(measured.error),
            "points": len(measured.amplitude),
        },
        "identified": {
            "amplitude": [float(refined.amplitude[end]) for end in ends],
            "energy": [float(refined.energy[end]) for end in ends],
            "exponent": [float(refined.course[end]) for end in ends],
        },
        "stiffness_at_rest": _known(rest),
        "macro_slip": [
            {"amplitude": slip.amplitude, "force": slip.force} for slip in identified_slips(identification)
        ],
    }


def slip_findings(element: Element, identification: Identification) -> list[Finding]:
    """Find from which amplitude on an element slides as a whole, where the test determines it."""
    return [
        Finding(
            "slides-as-a-whole",
            "info",
            numbers={"amplitude": Quantity(slip.amplitude, "m"), "force": Quantity(slip.force, "N")},
            names={
                "below": "sticks" if slip.sticks else "micro-slip",
                "tested": "yes" if slip.amplitude < identification.amplitude_range[1] else "no",
            },
        )
        for slip in identified_slips(identification, element.force)
    ]
