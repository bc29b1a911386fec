"""Physical dimensions: what a unit measures, apart from its size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from types import MappingProxyType

__all__ = ["FORCE", "NUMBER", "Dimension"]


@dataclass(frozen=True, slots=True)
class Dimension:
    """Powers of the base units kg, m, s, A, ... and Hz.

    Hz stands for itself: for a units library Hz and rad/s are both 1/s, which hides a factor of 2 pi. Angles
    are plain numbers.

    Examples
    --------
    >>> str(FORCE / Dimension({"m": Fraction(3)}))
    'N/m^3'
    """

    powers: Mapping[str, Fraction] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        powers = {base: Fraction(power) for base, power in sorted(self.powers.items()) if power}
        object.__setattr__(self, "powers", MappingProxyType(powers))

    def __mul__(self, other: Dimension) -> Dimension:
        return self._joined(other, 1)

    def __truediv__(self, other: Dimension) -> Dimension:
        return self._joined(other, -1)

    def __pow__(self, exponent: Fraction | int) -> Dimension:
        return Dimension({base: power * exponent for base, power in self.powers.items()})

    def _joined(self, other: Dimension, sign: int) -> Dimension:
        powers = dict(self.powers)
        for base, power in other.powers.items():
            powers[base] = powers.get(base, Fraction(0)) + sign * power
        return Dimension(powers)

    @property
    def name(self) -> str | None:
        """What it measures, in words ("a force"), None where it has no common name."""
        return _NAMES.get(str(self))

    def __str__(self) -> str:
        """The SI unit as a person writes it: N*s/m rather than kg/s."""
        powers = dict(self.powers)
        mass = powers.get("kg", Fraction(0))
        if mass and self != _MASS and not powers.keys() - {"kg", "m", "s"}:
            del powers["kg"]
            powers["m"] = powers.get("m", Fraction(0)) - mass
            powers["s"] = powers.get("s", Fraction(0)) + 2 * mass
            powers["N"] = mass
        order = sorted(
            (base for base in powers if powers[base]),
            key=lambda base: (_ORDER.index(base) if base in _ORDER else len(_ORDER), base),
        )
        above = [_raised(base, powers[base]) for base in order if powers[base] > 0]
        below = [_raised(base, -powers[base]) for base in order if powers[base] < 0]
        top = "*".join(above) or "1"
        if not below:
            return top
        return f"{top}/{below[0]}" if len(below) == 1 else f"{top}/({'*'.join(below)})"


_ORDER = ("N", "kg", "s", "m", "A", "Hz")


def _raised(base: str, power: Fraction) -> str:
    if power == 1:
        return base
    if power.denominator == 1:
        return f"{base}^{power}"
    if power.denominator in (2, 4, 5, 10):
        return f"{base}^{float(power):g}"
    return f"{base}^({power})"


NUMBER = Dimension()
FORCE = Dimension({"kg": Fraction(1), "m": Fraction(1), "s": Fraction(-2)})
_MASS = Dimension({"kg": Fraction(1)})
_NAMES = {
    "1": "a plain number",
    "N": "a force",
    "N/m": "a stiffness",
    "N*s/m": "a damping coefficient",
    "N*m": "a moment",
    "kg": "a mass",
    "m": "a length",
    "m^2": "an area",
    "m/s": "a velocity",
    "m/s^2": "an acceleration",
    "s": "a time",
    "Hz": "a frequency in cycles",
    "1/s": "an angular frequency",
    "N/m^2": "a pressure",
}
