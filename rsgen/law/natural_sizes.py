"""Sizes that parameters of a law naturally have in a test, from their units."""

from __future__ import annotations

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.formula.units.deduction import parameter_units
from rsgen.formula.units.unit_text import read_unit
from rsgen.law.numeric import ForceLaw

__all__ = ["DECADES", "natural_sizes"]

DECADES = 2
"""To both sides of its natural size a parameter is searched: beyond, it acts nowhere or everywhere, as a loop
that closes or saturates within a hundredth of the motion, or not within hundred times the motion."""


def natural_sizes(law: ForceLaw, amplitude: float, omega: float, force: float) -> Array:
    """(p,) the number of SI units that amplitude [m], frequency [rad/s] and force [N] make of each parameter.

    One for plain numbers; NaN where the law does not determine the unit.
    """
    sizes = np.full(len(law.parameters), np.nan)
    try:
        units = parameter_units(law.expression)
    except RsgenError:
        # terms that do not agree in units can be fitted all the same
        return sizes
    # in kg, m and s a force is kg m/s^2
    base = {"kg": force / (amplitude * omega**2), "m": amplitude, "s": 1 / omega}
    for place, name in enumerate(law.parameters):
        powers = read_unit(units[name]).dimension.powers if units.get(name) else None
        if powers is not None and powers.keys() <= base.keys():
            sizes[place] = np.prod([base[unit] ** float(power) for unit, power in powers.items()])
    return sizes
