"""Points at phase resonance, where k - m omega^2 vanishes whatever the mass is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.finding import Finding, quantities
from rsgen.identification.data import Points

__all__ = ["at_resonance_alone", "in_quadrature", "resonance_findings"]

_QUADRATURE = 0.2
"""Points at phase resonance: cotangent of a lag 11 degrees from a quarter period, farther than loops hold."""

_OFF = 2
"""At least as many points off resonance determine a mass, one on either side or two slices."""


def in_quadrature(points: Points) -> NDArray[np.bool_]:
    """(n,) True where the response lags the force by nearly a quarter period."""
    stiffness = points.force / points.harmonics[:, 1]
    return np.asarray(np.abs(stiffness.real) < _QUADRATURE * np.abs(stiffness.imag))


def at_resonance_alone(points: Points) -> bool:
    """Tell whether hardly a point lies off resonance: a mass then rests on errors of the lag."""
    return int(np.count_nonzero(~in_quadrature(points))) < _OFF


def resonance_findings(points: Points, mass: float | None) -> tuple[Finding, ...]:
    """Doubt a mass [kg] that was not given where all points lie at phase resonance."""
    if mass is not None or not at_resonance_alone(points):
        return ()
    return (Finding("mass-at-resonance", "doubt", "m", quantities(points=len(points))),)
