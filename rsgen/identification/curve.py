"""Stiffness and damping of every point, as the law of a mode has them at its amplitude."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.arrays import Array, ComplexArray
from rsgen.identification.across import LawAtTwoPlaces
from rsgen.identification.data import Points
from rsgen.identification.fit import Fit
from rsgen.identification.result import EquivalentCurve, Resonance
from rsgen.motion import Motion, project
from rsgen.surface import ResponseSurface, typical_amounts
from rsgen.tolerances import SAMPLES_SWITCHED

__all__ = ["equivalent_curve", "force_levels"]


def _dynamic(surface: ResponseSurface, found: Fit) -> tuple[Array, ComplexArray]:
    """Amplitude (n,) [m] that the law follows, and what it gives there over it, k + i omega c [N/m]."""
    law, response, omega = found.problem.law, surface.harmonics[:, 1], surface.omega
    if not isinstance(law, LawAtTwoPlaces) or surface.across is None:
        return np.abs(response), surface.force / response + found.mass * omega**2
    fundamental = np.zeros((len(surface), 2), dtype=complex)
    fundamental[:, 1] = response
    here = law.here.law.along(Motion(omega, fundamental), found.values[law.here.places], SAMPLES_SWITCHED)
    left = surface.force + found.mass * omega**2 * response - project(here.force, 1)
    return np.abs(surface.across[:, 1]), left / surface.across[:, 1]


def equivalent_curve(
    surface: ResponseSurface, points: Points, used: NDArray[np.bool_], found: Fit
) -> EquivalentCurve:
    """k and c of every settled point, with the mass found; ``used`` of the points took part.

    Of a law at two places they are those of the elements across: what the others leave, over their motion.
    """
    response = surface.harmonics[:, 1]
    rows = np.flatnonzero(surface.settled & np.isfinite(response) & (np.abs(response) > 0))
    omega = surface.omega[rows]
    amplitude, stiffness = _dynamic(surface.select(rows), found)
    took_part = np.zeros(len(surface), dtype=bool)
    took_part[points.index[used]] = True
    return EquivalentCurve(
        amplitude=amplitude,
        frequency=surface.frequency[rows],
        level=surface.level[rows],
        stiffness=stiffness.real,
        damping=stiffness.imag / omega,
        used=took_part[rows],
        level_unit=surface.level_unit,
        per_mass=surface.per_mass,
    )


def force_levels(surface: ResponseSurface, points: Points, resonances: tuple[Resonance, ...]) -> Array:
    """Levels of force: as measured near the resonances; where the amplitude was held, what these needed."""
    if not surface.response_held:
        return np.unique(typical_amounts(surface.select(points.index)))
    needed = [abs(r.damping) * 2 * np.pi * r.frequency * r.amplitude for r in resonances]
    return np.unique(needed) if needed else np.quantile(np.abs(points.force), [0.1, 0.5, 0.9])
