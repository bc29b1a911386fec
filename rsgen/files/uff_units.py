"""Units of a universal file: what an axis names, else the unit system of data set 164, else SI.

Source of the format: the published description of universal file data set 164, "Units". Its factors turn
numbers of the file into SI by division: 1000 where lengths are in mm.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from rsgen.files.uff_meaning import FORCES

__all__ = ["SI", "UnitSystem", "axis_unit", "unit_system"]

_LENGTHS = {
    "m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "km": 1e3, "inch": 0.0254, "thou": 2.54e-5, "ft": 0.3048,
}  # fmt: skip
_FORCES = {
    "N": 1.0, "mN": 1e-3, "cN": 1e-2, "uN": 1e-6, "kN": 1e3, "dyn": 1e-5, "kgf": 9.80665,
    "lbf": 4.4482216152605, "poundal": 0.138254954376,
}  # fmt: skip
_SYSTEMS = {
    1: ("m", "N"), 2: ("ft", "lbf"), 3: ("m", "kgf"), 4: ("ft", "poundal"), 5: ("mm", "mN"),
    6: ("cm", "cN"), 7: ("inch", "lbf"), 8: ("mm", "kgf"), 10: ("mm", "N"),
}  # fmt: skip
"""Length and force by the code of the unit system; 9 is user-defined."""
_ROUNDED = 1e-4
"""Relative error of a factor that names a unit all the same: writers print four digits and more."""
_PER_TIME = {8: "", 11: "/s", 12: "/s^2"}
_PER_FORCE = re.compile(r"/\s*(?:[kmcuµM]?N|lbf?|kgf|kp|dyne?)\Z")


@dataclass(frozen=True, slots=True)
class UnitSystem:
    """Units of length and force in a universal file.

    Parameters
    ----------
    length, force
        Names of the units; "" where they are not known.
    source
        Where they come from, or why they are not known.
    """

    length: str
    force: str
    source: str


SI = UnitSystem("m", "N", "SI assumed")
"""Where a file has no data set 164."""


def _named(factor: float, units: dict[str, float]) -> str:
    """Find the unit of which there are ``factor`` in an SI unit, or ""."""
    return next((name for name, size in units.items() if abs(factor * size - 1) < _ROUNDED), "")


def unit_system(code: int, length: float, force: float) -> UnitSystem:
    """Read data set 164.

    Parameters
    ----------
    code
        Code of the unit system.
    length, force
        File units in 1 m and in 1 N; positive.

    Examples
    --------
    >>> unit_system(5, 1000.0, 1000.0)
    UnitSystem(length='mm', force='mN', source='data set 164')
    """
    found = _named(length, _LENGTHS), _named(force, _FORCES)
    factors = f"its factors {length:g} and {force:g}"
    if "" in found:
        return UnitSystem("", "", f"data set 164, {factors} are of no known units")
    meant = _SYSTEMS.get(code, found)
    if meant != found:
        # some writers invert the factors, others leave those of a template: neither can be trusted
        return UnitSystem("", "", f"data set 164 says {' and '.join(meant)}, but {factors} differ")
    return UnitSystem(*found, "data set 164")


def _unit(kind: int, label: str, system: UnitSystem) -> tuple[str, str]:
    if label:
        return label, "axis label"
    if kind in _PER_TIME:
        return system.length and system.length + _PER_TIME[kind], system.source
    return (system.force, system.source) if kind in FORCES else ("", "")


def axis_unit(ordinate: tuple[int, str], over: tuple[int, str], system: UnitSystem) -> tuple[str, str]:
    """Find the unit of the ordinate of a function, and where it comes from.

    Parameters
    ----------
    ordinate, over
        Kind of data and label of the unit, of the numerator and of the denominator.
    system
        The last data set 164 before the function, or SI.

    Returns
    -------
    Unit, "" where it is not known; and its source, or why it is not known.
    """
    unit, source = _unit(*ordinate, system)
    if over[0] not in FORCES or _PER_FORCE.search(unit) or not source:
        return unit, source
    force, origin = _unit(*over, system)
    if not (unit and force):
        return "", system.source
    return f"{unit}/{force}", source if source == origin else f"{source}, force: {origin}"
