"""Numbers for people: engineering prefixes, few digits, units as they are printed."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["SWEEPS", "Scale", "choose_scale", "count_text", "number_text", "quantity_text", "unit_text"]

_PREFIXES = {
    "m": ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm"), (1e-12, "pm")),
    "N": ((1e3, "kN"), (1.0, "N"), (1e-3, "mN"), (1e-6, "µN"), (1e-9, "nN"), (1e-12, "pN")),
    "N/m": ((1e6, "MN/m"), (1e3, "kN/m"), (1.0, "N/m"), (1e-3, "mN/m"), (1e-6, "µN/m")),
    "N*s/m": (
        (1e3, "kN·s/m"),
        (1.0, "N·s/m"),
        (1e-3, "mN·s/m"),
        (1e-6, "µN·s/m"),
        (1e-9, "nN·s/m"),
        (1e-12, "pN·s/m"),
    ),
    "m/N": ((1.0, "m/N"), (1e-3, "mm/N"), (1e-6, "µm/N"), (1e-9, "nm/N")),
    "m/s": ((1.0, "m/s"), (1e-3, "mm/s"), (1e-6, "µm/s")),
    "kg": ((1.0, "kg"), (1e-3, "g"), (1e-6, "mg"), (1e-9, "µg"), (1e-12, "ng")),
    "s": ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")),
}
SWEEPS = {"rest": "from rest", "up": "sweep up", "down": "sweep down"}
"""How the points of a sweep were reached, in words."""

_PER_MASS = "/kg"
"""Ending of units per unit mass, as ``per_mass_unit`` makes them; a prefix is that of the rest."""

_THIN = "\u202f"
_POWERS = str.maketrans("-0123456789.", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹·")


@dataclass(frozen=True, slots=True)
class Scale:
    """A unit to show numbers in: value in SI = shown number * factor."""

    factor: float
    unit: str

    def label(self, what: str) -> str:
        """Give an axis label, such as ``Amplitude X [mm]``."""
        return f"{what} [{self.unit}]" if self.unit else what


def unit_text(unit: str) -> str:
    """Print a unit of the case language as a person writes it.

    Examples
    --------
    >>> unit_text("N*s^2/m^2"), unit_text("N/m**3"), unit_text("1")
    ('N·s²/m²', 'N/m³', '')
    """
    if unit == "1":
        return ""
    text = unit.replace("**", "^").replace("*", "·")
    return re.sub(r"\^\(?(-?[0-9.]+)\)?", lambda power: power[1].translate(_POWERS), text)


def count_text(count: int, noun: str) -> str:
    """Print a number of things, one of them in the singular.

    Examples
    --------
    >>> count_text(1, "level"), count_text(3, "level")
    ('1 level', '3 levels')
    """
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def choose_scale(values: ArrayLike, unit: str) -> Scale:
    """Choose the prefix under which the largest of the values lies between 1 and 1000, where there is one.

    Parameters
    ----------
    values
        Any shape, SI; values that are not finite are ignored.
    unit
        SI unit in the case language, such as "N*s/m"; unknown units keep their factor 1.

    Examples
    --------
    >>> choose_scale([0.012, 0.051], "m")
    Scale(factor=0.001, unit='mm')
    """
    numbers = np.abs(np.asarray(values, dtype=float).ravel())
    numbers = numbers[np.isfinite(numbers)]
    largest = float(numbers.max()) if numbers.size else 0.0
    whole = unit.removesuffix(_PER_MASS)
    choices = _PREFIXES.get(whole, ((1.0, unit_text(whole)),))
    if whole != unit:
        choices = tuple((factor, f"{name}{_PER_MASS}") for factor, name in choices)
    if largest == 0.0:
        factor, name = next((c for c in choices if c[0] == 1.0), choices[0])
        return Scale(factor, name)
    # a hair below 1 counts as 1, so that 0.9999999 mm is not 999.9999 µm
    fitting = [c for c in choices if largest / c[0] >= 0.999]
    factor, name = fitting[0] if fitting else choices[-1]
    return Scale(factor, name)


def number_text(value: float, digits: int = 4) -> str:
    """Print a number with few digits, powers of ten as a person writes them.

    Examples
    --------
    >>> number_text(-2.2e6), number_text(5920.0), number_text(0.05)
    ('−2.2 × 10⁶', '5920', '0.05')
    """
    if not math.isfinite(value):
        return "not known" if math.isnan(value) else ("∞" if value > 0 else "−∞")
    if value == 0:
        return "0"
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    exponent = int(power)
    if not -4 <= exponent < 6:
        mantissa = _without_zeros(mantissa).replace("-", "−")
        return f"{mantissa} × 10{str(exponent).translate(_POWERS)}"
    text = _without_zeros(f"{float(f'{mantissa}e{power}'):,.{max(digits - 1 - exponent, 0)}f}")
    # groups only from five digits on, as books print numbers
    return text.replace("-", "−").replace(",", "" if exponent < 4 else _THIN)


def _without_zeros(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text


def quantity_text(value: float, unit: str, digits: int = 4) -> str:
    """Print a value with its unit and an engineering prefix.

    Examples
    --------
    >>> quantity_text(0.0512, "m", 2), quantity_text(5920, "N/m"), quantity_text(3.8, "N*s/m")
    ('51 mm', '5.92 kN/m', '3.8 N·s/m')
    """
    scale = choose_scale([value], unit)
    return f"{number_text(value / scale.factor, digits)} {scale.unit}".rstrip()
