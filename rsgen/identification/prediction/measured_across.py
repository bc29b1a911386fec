"""Responses of a law across two sensors: only where the motion across was measured with the response."""

from __future__ import annotations

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.surface import ResponseSurface
from rsgen.identification.fitting.across import MeasuredAcross, law_of
from rsgen.identification.results import Identification
from rsgen.law.motion import Motion

__all__ = ["acts_across", "respond_across"]

_RANGE = (0.1, 10.0)
"""Amplitudes that are tried, relative to the measured one: an error of that size predicts nothing."""

_TRIED = 120
"""Amplitudes in that range: four per cent apart, closer than the branches of a jump lie."""

_NEAR = np.linspace(0.9, 1.1, 201)
"""Amplitudes near the measured one, a thousandth apart: two states that lie closer are one measurement."""

_HALVINGS = 40
"""Of an interval of four per cent: to round-off."""


def acts_across(identification: Identification) -> str:
    """Between which sensors elements of the law act, "" where all follow the response."""
    return next((element.across for element in identification.model.elements if element.across), "")


def respond_across(identification: Identification, surface: ResponseSurface) -> ComplexArray:
    """(n,) predicted fundamental [m] under the measured force.

    The motion across goes with the response as it was measured at the same point. Of several amplitudes that
    the force holds the one nearest to the measured one is taken; NaN where there is none.
    """
    if surface.across is None or not len(surface):
        return np.full(len(surface), np.nan, dtype=complex)
    response, across = np.nan_to_num(surface.harmonics), np.nan_to_num(surface.across)
    law = law_of(identification.model.elements, across=True)
    forward = MeasuredAcross(
        law, Motion(surface.omega, response), Motion(surface.omega, across), mass_free=False
    )
    values, measured, level = np.array(identification.solution), np.abs(response[:, 1]), np.abs(surface.force)

    def excess(size: Array) -> Array:
        return np.asarray(np.abs(forward(values, identification.mass, size).force) - level)

    sizes = np.union1d(np.geomspace(*_RANGE, _TRIED), _NEAR)
    table = np.array([excess(share * measured) for share in sizes])
    crossed = (table[:-1] < 0) != (table[1:] < 0)
    distance = np.where(crossed, np.abs(np.log(sizes[:-1, None])), np.inf)
    row = np.argmin(distance, axis=0)
    upward = np.take_along_axis(table, row[None, :], axis=0)[0] < 0
    low, high = sizes[row] * measured, sizes[row + 1] * measured
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        above = (excess(middle) >= 0) == upward
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    force = forward(values, identification.mass, high).force
    found = high * np.exp(1j * (np.angle(surface.force) - np.angle(force)))
    return np.where(np.isfinite(distance.min(axis=0)), found, np.nan)
