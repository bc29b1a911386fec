"""Points at phase resonance, where k - m omega^2 vanishes whatever the mass is."""

from __future__ import annotations

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.tolerances import ERRORS, EXPECTED_NOISE
from rsgen.data.surface.phase_lag import BackboneGap, backbone_gap
from rsgen.identification.fitting.points import Points

__all__ = [
    "LAG_ERROR",
    "assumed_mass",
    "at_resonance_alone",
    "gap_of",
    "loop_error",
    "mass_sure",
    "near_resonance",
]

_OFF = 2
"""At least as many points off resonance determine a mass, one on either side or two slices."""

_PHASES = 0.01
"""Lags that spread by less, half a degree [rad], say nothing of the mass: phases are measured no better."""

_KNOWN = 0.2
"""Standard error of the mass, relative, above which it is not identified: zeta would be as unsure."""

LAG_ERROR = 0.035
"""Standard deviation of a lag that was not recorded [rad], two degrees: filters and amplifiers of a loop that
works leave as much. One value for the whole test, for they are the same at every level."""


def near_resonance(points: Points) -> bool:
    """Tell whether hardly a point lies off phase resonance, or off a lag that all share."""
    return int(np.count_nonzero(~points.in_quadrature)) < _OFF


def at_resonance_alone(points: Points, noise: float = 2 * EXPECTED_NOISE) -> bool:
    """Tell whether all points have one lag to within the noise [1]: a mass then rests on errors of the lag.

    Slices a few degrees on either side of resonance determine a mass, as F/X = k - m omega^2 differs in them.
    """
    if not near_resonance(points):
        return False
    spread = np.std(points.lag[points.in_quadrature])
    return bool(spread < max(_PHASES, ERRORS * noise))


def mass_sure(mass: float, variance: float) -> bool:
    """Tell whether an identified mass [kg] is positive, and its variance [kg^2] small enough."""
    return bool(mass > 0 and variance < (_KNOWN * mass) ** 2)


def assumed_mass(points: Points, ratio: float) -> float:
    """Mass [kg] that gives points at phase resonance a damping ratio [1]: omega c = 2 zeta m omega^2."""
    stiffness = points.force / points.harmonics[:, 1]
    return float(np.median(np.abs(stiffness.imag) / points.omega**2)) / (2 * ratio)


def gap_of(points: Points) -> BackboneGap | None:
    """Gap between the points at phase resonance; None where they lie on one backbone."""
    near = points.in_quadrature
    return backbone_gap(points.omega[near] / (2 * np.pi), points.amplitude[near])


def loop_error(influence: Array) -> Array:
    """Covariance (q, q) that the error of a lag causes which was taken for a quarter period.

    It turns every force by one angle, so that the imaginary part of all relative forces changes by it; the
    (n, M, q) influence of those on the parameters adds up.
    """
    half = (influence.shape[1] + 1) // 2
    moved = LAG_ERROR * np.sum(influence[:, half], axis=0)
    return np.outer(moved, moved)
