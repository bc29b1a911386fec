"""Units: "5.92 kN/m" to 5920.0 with a check of its dimension, and the units that a force law demands.

``quantity`` turns a value of a case file into SI, ``parameter_units`` deduces the unit of every parameter of
a force law from the condition that each term is a force, ``unit_faults`` checks declared units against it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use
from rsgen.formula.units.quantities import per_mass_unit, quantity, sensor_factor, sensor_unit, unit_of
from rsgen.formula.units.unit_text import Dimension, read_unit

if TYPE_CHECKING:
    from rsgen.formula.units.deduction import parameter_units, unit_faults

__all__ = [
    "Dimension", "parameter_units", "per_mass_unit", "quantity", "read_unit", "sensor_factor", "sensor_unit",
    "unit_faults", "unit_of",
]  # fmt: skip

# they import sympy, which the process that opens binary files can do without
__getattr__ = on_first_use(__name__, dict.fromkeys(("parameter_units", "unit_faults"), "deduction"))
