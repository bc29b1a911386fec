"""Points at phase resonance, where k - m omega^2 vanishes whatever the mass is."""

from __future__ import annotations

import numpy as np

from rsgen.arrays import Array
from rsgen.finding import Finding, quantities
from rsgen.identification.data import Points
from rsgen.identification.least_squares import Regression
from rsgen.law.numeric import ForceLaw
from rsgen.surface import ResponseSurface
from rsgen.surface.phase_lag import BackboneGap, backbone_gap
from rsgen.tolerances import ERRORS, LARGE

__all__ = [
    "DAMPED",
    "LAG_ERROR",
    "LIGHT",
    "assumed_mass",
    "at_resonance_alone",
    "gap_of",
    "mass_sure",
    "near_resonance",
    "of_one_mode",
    "resonance_findings",
    "with_loop_error",
    "without_mass",
]

_OFF = 2
"""At least as many points off resonance determine a mass, one on either side or two slices."""

_PHASES = 0.01
"""Lags that spread by less, half a degree [rad], say nothing of the mass: phases are measured no better."""

_EXPECTED = 0.02
"""Relative noise that is allowed for before a fit shows it."""

_KNOWN = 0.2
"""Standard error of the mass, relative, above which it is not identified: zeta would be as unsure."""

LIGHT = 0.01
"""Damping ratio that weighs frequency against force where the mass is not known; both are fitted apart."""

DAMPED = 0.05
"""Damping ratio up to which an unknown one may shift k/m: phase resonance finds lightly damped modes."""

LAG_ERROR = 0.035
"""Standard deviation of a lag that was not recorded [rad], two degrees: filters and amplifiers of a loop that
works leave as much. One value for the whole test, for they are the same at every level."""


def near_resonance(points: Points) -> bool:
    """Tell whether hardly a point lies off phase resonance, or off a lag that all share."""
    return int(np.count_nonzero(~points.in_quadrature)) < _OFF


def at_resonance_alone(points: Points, noise: float = _EXPECTED) -> bool:
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


def without_mass(points: Points, law: ForceLaw | None = None) -> tuple[Finding, ...]:
    """Foresee that no mass follows from the points of a test with a law, or with any where it is None."""
    if not at_resonance_alone(points) or (law is not None and law.remembers):
        return ()
    return (Finding("mass-at-resonance", "warning", "m", quantities(points=len(points))),)


def resonance_findings(
    points: Points, mass: float | None, law: ForceLaw, noise: float
) -> tuple[Finding, ...]:
    """Say what a mass [kg] that was not given rests on where all points have the lag of resonance.

    A law with memory has its stiffness in the area of its loops, and so determines a mass if it is right.
    With others it rests on errors of the lag.
    """
    if mass is not None or not at_resonance_alone(points, noise):
        return ()
    numbers = quantities(points=len(points))
    if law.remembers:
        return (Finding("mass-by-loops", "warning", "m", numbers),)
    return (Finding("mass-at-resonance", "doubt", "m", numbers),)


def gap_of(points: Points) -> BackboneGap | None:
    """Gap between the points at phase resonance; None where they lie on one backbone."""
    near = points.in_quadrature
    return backbone_gap(points.omega[near] / (2 * np.pi), points.amplitude[near])


def of_one_mode(findings: tuple[Finding, ...], points: Points, misfit: float) -> tuple[Finding, ...]:
    """Findings of a test, with what the points that were chosen and the misfit [1] say of two modes.

    Two groups of different amplitudes are of one mode where one law fits both.
    """
    codes = {"phase-two-modes", "phase-gap"}
    rest = tuple(finding for finding in findings if finding.code not in codes)
    gap = gap_of(points)
    if len(rest) == len(findings) or gap is None or (not gap.overlap and misfit < LARGE):
        return rest
    return (*rest, gap.finding(severity="doubt"))


def with_loop_error(covariance: Array, regression: Regression, surface: ResponseSurface) -> Array:
    """Add to a covariance (q, q) what the error of a lag does that was taken for a quarter period.

    It turns every force by one angle, so that the imaginary part of all relative forces changes by it.
    """
    if not surface.lag_assumed:
        return covariance
    half = (regression.influence.shape[1] + 1) // 2
    moved = LAG_ERROR * np.sum(regression.influence[:, half], axis=0)
    return np.asarray(covariance + np.outer(moved, moved))
