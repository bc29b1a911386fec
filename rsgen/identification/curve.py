"""Stiffness and damping of every point, as the law of a mode has them at its amplitude."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.data import Points
from rsgen.identification.result import EquivalentCurve
from rsgen.surface import ResponseSurface

__all__ = ["equivalent_curve"]


def equivalent_curve(
    surface: ResponseSurface, points: Points, used: NDArray[np.bool_], mass: float
) -> EquivalentCurve:
    """k and c of every settled point, with the mass [kg] of the law; ``used`` of the points took part."""
    response = surface.harmonics[:, 1]
    rows = np.flatnonzero(surface.settled & np.isfinite(response) & (np.abs(response) > 0))
    stiffness = surface.force[rows] / response[rows]
    omega = surface.omega[rows]
    took_part = np.zeros(len(surface), dtype=bool)
    took_part[points.index[used]] = True
    return EquivalentCurve(
        amplitude=np.abs(response[rows]),
        frequency=surface.frequency[rows],
        level=surface.level[rows],
        stiffness=stiffness.real + mass * omega**2,
        damping=stiffness.imag / omega,
        used=took_part[rows],
        level_unit=surface.level_unit,
        per_mass=surface.per_mass,
    )
