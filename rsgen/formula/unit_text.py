"""Text of a unit to its size and dimension; rsgen has the grammar, pint the single names."""

from __future__ import annotations

import difflib
import math
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING

from rsgen.common.errors import RsgenError

if TYPE_CHECKING:
    from pint import UnitRegistry

# ----------------------------------------------------------------------------
# Physical dimensions: the quantity that a unit measures, without its size.


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
        """The physical quantity in words ("a force"), None where it has no common name."""
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
    "1": "a plain number", "N": "a force", "N/m": "a stiffness", "N*s/m": "a damping coefficient",
    "N*m": "a moment", "kg": "a mass", "m": "a length", "m^2": "an area", "m/s": "a velocity",
    "m/s^2": "an acceleration", "s": "a time", "Hz": "a frequency in cycles", "1/s": "an angular frequency",
    "N/m^2": "a pressure",
}  # fmt: skip


MAX_UNIT_CHARACTERS = 60
_MAX_PARENTHESES = 5
_MAX_POWER = 20
_EXACT_DIGITS = 14  # what has no more digits is meant exactly; the rest of pint's float is rounding
_MAX_BITS = 10 * sys.float_info.max_exp  # far above the range of floats
_EXAMPLES = "write a unit such as N/m, kN*s/m, N/m^3 or mm"
_COMMON = [
    "N", "kN", "mN", "m", "mm", "s", "ms", "kg", "g", "Hz", "kHz", "rad", "deg", "lbf", "inch", "V", "mV",
]  # fmt: skip
_JOINED = re.compile(r"([kmM]?N)(m|mm|s|ms)")
_POWER = r"[+-]?[0-9]{1,3}(?:\.[0-9]{1,3})?"
_TOKEN = re.compile(
    r"(?P<blank> +)|(?P<name>[A-Za-z\u00b5\u03bc]+(?:_[A-Za-z0-9]+)*|%)|(?P<one>1(?![0-9.]))"
    rf"|(?P<power>(?:\*\*|\^)(?:{_POWER}|\({_POWER}(?:/{_POWER})?\)))|(?P<sign>[*/\u00b7\u22c5()])"
    r"|(?P<small>[\u00b2\u00b3])"
)


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: how many SI units it is, and its dimension."""

    factor: Fraction
    dimension: Dimension

    def __mul__(self, other: Unit) -> Unit:
        return Unit(self.factor * other.factor, self.dimension * other.dimension)

    def __pow__(self, exponent: Fraction) -> Unit:
        """Raise to a power; OverflowError where the factor leaves every useful range."""
        bits = max(self.factor.numerator.bit_length(), self.factor.denominator.bit_length())
        if bits * abs(exponent) > _MAX_BITS:
            raise OverflowError
        if exponent.denominator == 1:
            return Unit(self.factor**exponent.numerator, self.dimension**exponent)
        return Unit(_factor(float(self.factor) ** float(exponent)), self.dimension**exponent)


def _factor(number: float) -> Fraction:
    short = f"{number:.{_EXACT_DIGITS}g}"
    return Fraction(short) if abs(float(short) - number) <= 2 * math.ulp(number) else Fraction(number)


_ONE = Unit(Fraction(1), NUMBER)


@lru_cache(maxsize=1)
def _registry() -> UnitRegistry[float]:
    import pint  # 0.3 s, and needed only where a value has a unit

    return pint.UnitRegistry()


def _known_names() -> dict[str, Unit]:
    """Units that nearly every case or file has, which need no registry: its loading takes 0.3 s."""
    kilogram, metre, second = (Dimension({name: Fraction(1)}) for name in ("kg", "m", "s"))
    bases = {
        "N": Unit(Fraction(1), kilogram * metre * second ** Fraction(-2)),
        "m": Unit(Fraction(1), metre),
        "s": Unit(Fraction(1), second),
        "g": Unit(Fraction(1, 1000), kilogram),
        "Hz": Unit(Fraction(1), Dimension({"Hz": Fraction(1)})),
        "rad": _ONE,
    }
    micro = dict.fromkeys(("u", "\u00b5", "\u03bc"), "1e-6")
    prefixes: dict[str, int | str] = {"": 1, "k": 1000, "m": "1/1000", **micro}
    return {
        prefix + name: Unit(Fraction(size) * unit.factor, unit.dimension)
        for name, unit in bases.items()
        for prefix, size in prefixes.items()
    } | {
        "deg": Unit(_factor(math.pi / 180), NUMBER),
        "%": Unit(Fraction(1, 100), NUMBER),
        # accelerometers give it
        "standard_gravity": Unit(Fraction("9.80665"), metre * second ** Fraction(-2)),
    }


_KNOWN = _known_names()


def other_capitals(name: str) -> list[str]:
    """Return the usual units that differ from a name by capitals only: mV for mv, N for n."""
    usual = (*_COMMON, *filter(str.isascii, _KNOWN))
    return [one for one in usual if one != name and one.casefold() == name.casefold()]


@lru_cache(maxsize=500)
def _named(name: str) -> Unit:
    """The unit of a single name, prefixes included.

    Raises
    ------
    RsgenError
        The name is unknown, or the unit is not proportional to its SI unit (degC, dB).
    """
    if name in _KNOWN:
        return _KNOWN[name]
    registry = _registry()
    meanings = registry.parse_unit_name(name)
    joined = _JOINED.fullmatch(name)  # a product; to pint alone Nm is a measure of yarn
    if joined or not meanings:
        close = other_capitals(name) or difflib.get_close_matches(name, _COMMON, n=1, cutoff=0.6)
        meant = f"{joined[1]}*{joined[2]}" if joined else close[0] if close else None
        hint = f", did you mean '{meant}'?" if meant else ""
        raise RsgenError(f"the unit {name!a} is not known{hint}; {_EXAMPLES}")
    one, two = (registry.Quantity(value, name).to_base_units() for value in (1.0, 2.0))
    if two.magnitude != 2 * one.magnitude:
        raise RsgenError(f"the unit {name!a} has an offset or is logarithmic; write a proportional one")
    factor = _factor(one.magnitude)
    if meanings[0][1] == "hertz":
        return Unit(factor, Dimension({"Hz": Fraction(1)}))
    powers = {
        _SHORT.get(base, base): Fraction(str(power)) for base, power in one.unit_items() if base != "radian"
    }
    return Unit(factor, Dimension(powers))


_SHORT = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K"}


@lru_cache(maxsize=1000)
def read_unit(text: str) -> Unit:
    """Read the text of a unit.

    Parameters
    ----------
    text
        Names of units with their prefixes, joined by * and /, with powers ^2 or **2 and parentheses:
        N/m, kN*s/m, N*s^2/m^2, N/(m/s)^1.5, 1/s, rad/s, Hz, %.

    Returns
    -------
    Unit
        Its size in SI units (exact for decimal prefixes) and its dimension.

    Raises
    ------
    RsgenError
        The text is no unit, or one that is not proportional to SI units.

    Examples
    --------
    >>> read_unit("kN/mm").factor, str(read_unit("kN/mm").dimension)
    (Fraction(1000000, 1), 'N/m')
    """
    if len(text) > MAX_UNIT_CHARACTERS:
        raise RsgenError(f"a unit of {len(text)} characters; at most {MAX_UNIT_CHARACTERS} are allowed")
    return _UnitText(text).read()


class _UnitText:
    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens: list[tuple[str, str]] = []
        end = 0
        for match in _TOKEN.finditer(text):
            if match.start() != end:
                break
            end = match.end()
            self.tokens.append((str(match.lastgroup), match[0]))
        if end != len(text) or not text.strip(" "):
            raise self.fault()
        while self.tokens and self.tokens[-1][0] == "blank":
            self.tokens.pop()
        self.place = 0

    def fault(self, why: str = "") -> RsgenError:
        shown = ascii(self.text)
        return RsgenError(f"{shown} {why or 'is not a unit'}; {_EXAMPLES}")

    def peek(self) -> tuple[str, str]:
        return self.tokens[self.place] if self.place < len(self.tokens) else ("end", "")

    def take(self) -> tuple[str, str]:
        token = self.peek()
        self.place += 1
        return token

    def skip_blanks(self) -> bool:
        found = False
        while self.peek()[0] == "blank":
            self.place += 1
            found = True
        return found

    def read(self) -> Unit:
        unit = self.product(0)
        if self.peek()[0] != "end":
            raise self.fault()
        return unit

    def product(self, depth: int) -> Unit:
        if depth > _MAX_PARENTHESES:
            raise self.fault("has too many parentheses")
        self.skip_blanks()
        unit = self.power(depth)
        divided = False
        while True:
            blank = self.skip_blanks()
            kind, text = self.peek()
            if kind == "sign" and text != "(" and text != ")":
                self.place += 1
                self.skip_blanks()
                divided = divided or text == "/"
                unit = unit * self.power(depth) ** Fraction(-1 if text == "/" else 1)
            elif blank and (kind == "name" or text == "("):
                if divided:
                    raise self.fault("is ambiguous after its '/'; write N/(m*s) or N*s/m")
                unit = unit * self.power(depth)
            else:
                return unit

    def power(self, depth: int) -> Unit:
        kind, text = self.take()
        if kind == "name":
            unit = _named(text)
        elif text == "(":
            unit = self.product(depth + 1)
            if self.take()[1] != ")":
                raise self.fault("has a '(' without its ')'")
        elif kind == "one":
            unit = _ONE
        else:
            raise self.fault()
        kind, text = self.peek()
        if kind not in ("small", "power"):
            return unit
        self.place += 1
        if kind == "small":
            return self.raised(unit, Fraction(2 if text == "\u00b2" else 3))
        above, _, below = text.strip("*^()").partition("/")
        if below and not float(below):
            raise self.fault("has no number as a power")
        return self.raised(unit, Fraction(above) / Fraction(below or 1))

    def raised(self, unit: Unit, exponent: Fraction) -> Unit:
        try:
            raised = unit**exponent
        except OverflowError:
            raise self.fault("is out of range") from None
        if any(abs(power) > _MAX_POWER for power in raised.dimension.powers.values()):
            raise self.fault(f"has a power above {_MAX_POWER}")
        return raised
