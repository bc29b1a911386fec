"""The background that a fit found, with the errors of its values."""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit

from rsgen.arrays import Array
from rsgen.identification.observed import Observed
from rsgen.identification.result import Background, Estimate
from rsgen.tolerances import CONFIDENCE
from rsgen.units import per_mass_unit

__all__ = ["state_background"]


def state_background(
    observed: Observed, values: Array, variance: Array, freedom: int, *, per_mass: bool = False
) -> Background | None:
    """Give the values (b,) of a background with 95 % intervals; None where none was asked for.

    Parameters
    ----------
    observed
        The points that were fitted.
    values, variance
        (b,) of the background; a variance that is not finite is not known.
    freedom
        Degrees of freedom of the noise that the variance rests on.
    per_mass
        Whether the force is one per mass.
    """
    shape, points = observed.background, observed.points
    if not len(values):
        return None
    wide = float(stdtrit(freedom, CONFIDENCE))
    errors = np.sqrt(np.where(np.isfinite(variance), variance, np.inf))
    # the residue of a neighbour, one over its mass, is then a number
    units = [per_mass_unit(unit).replace("1/kg*kg", "") if per_mass else unit for unit in shape.units]
    estimates = tuple(
        Estimate(name, float(v), float(e), (float(v - wide * e), float(v + wide * e)), unit)
        for name, v, e, unit in zip(shape.names, values, errors, units, strict=True)
    )
    part = np.abs(shape.receptance(values) * points.force)
    share = float(np.sqrt(np.mean(part**2) / np.mean(points.amplitude**2)))
    return Background(observed.kind, observed.band, estimates, share)
