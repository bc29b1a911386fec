"""Values of case files to SI and back to people: a bare number or one with its unit; prefixes, few digits."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from rsgen.common.errors import RsgenError, shown
from rsgen.formula.unit_text import MAX_UNIT_CHARACTERS, NUMBER, Dimension, other_capitals, read_unit

_MAX_CHARACTERS = 2 * MAX_UNIT_CHARACTERS
_SMALLEST, _LARGEST = 1e-300, 1e300
_NUMBER = re.compile(
    r" *([+-]?(?:[0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eE][+-]?[0-9]{1,3})?) *(.*)", re.DOTALL
)
UNKNOWN = "?"
"""Begins a value that only the user knows, in a case that was proposed from a file."""
_USAGE = 'write a number with its unit, such as "5.92 kN/m", or a bare number in SI units'
_RMS = re.compile(r"(.*?)[ _(]*rms\)?", re.IGNORECASE)
_HERTZ = Dimension({"Hz": Fraction(1)})
_RATE = Dimension({"s": Fraction(-1)})
_ACCELERATION = "m/s^2"
_GRAVITY = re.compile(r"(?<![A-Za-z_\u00b5\u03bc])([mu\u00b5\u03bc]?)(?:g|g_n|gn)(?![A-Za-z_])")
"""The name of the standard gravity, alone or with a prefix: mg is a thousandth of it, kg is none."""
_MIL = re.compile(r"(?<![A-Za-z_])mils?(?![A-Za-z_])")
_SQUARE = re.compile(r"(?<![A-Za-z_])(s|sec)2(?![0-9.])")
"""m/s2, as loggers without a raised two write it."""


def _split(text: str) -> tuple[Fraction, str]:
    if len(text) > _MAX_CHARACTERS:
        raise RsgenError(
            f"{shown(text)} has {len(text)} characters, at most {_MAX_CHARACTERS} are allowed; {_USAGE}"
        )
    match = _NUMBER.fullmatch(text)
    if text.startswith(UNKNOWN):
        raise RsgenError(f"{shown(text)} is not known yet: write a number in place of the question mark")
    if match is None:
        raise RsgenError(f"{shown(text)} is not a number with a unit; {_USAGE}")
    unit = match[2].rstrip(" ")
    if unit.startswith(","):
        raise RsgenError(f"{shown(text)} has a comma; write a decimal point, such as 5.92")
    return Fraction(match[1]), unit


def unit_of(value: object) -> str | None:
    """The unit that stands in a value of a case file, None for a bare number.

    Raises
    ------
    RsgenError
        The value is text and not a number with a unit.
    """
    return _split(value)[1] or None if isinstance(value, str) else None


def sensor_unit(name: str, target: str) -> str:
    """Spell a unit of measured data so that it means what a vibration engineer means.

    Among accelerations g is the standard gravity, never the gram; a mil is a length, never an angle; s2 is
    s^2.

    Examples
    --------
    >>> sensor_unit("g/N", "m/s^2/N"), sensor_unit("g", "kg"), sensor_unit("mil", "m")
    ('standard_gravity/N', 'g', 'thou')
    >>> sensor_unit("100 mV/g", "V/(m/s^2)"), sensor_unit("(m/s2)/N", "m/s^2/N")
    ('100 mV/standard_gravity', '(m/s^2)/N')
    """
    spelled = _GRAVITY.sub(r"\1standard_gravity", name) if "s^2" in target else name
    return _SQUARE.sub(r"\1^2", _MIL.sub("thou", spelled))


def sensor_size(name: str, target: str) -> float | None:
    """Return the size of a unit of measured data in SI; None where it is of another dimension, or none.

    Examples
    --------
    >>> sensor_size("g", "m/s^2"), sensor_size("mm", "N")
    (9.80665, None)
    """
    try:
        return quantity(f"1 {sensor_unit(name, target)}", target)
    except RsgenError:
        return None


def sensor_factor(text: str, unit: str, target: str) -> float:
    """Return the factor from numbers in ``unit`` to SI that the sheet of a sensor or amplifier says.

    Parameters
    ----------
    text
        What the numbers are multiplied by, "10 g/V", or a sensitivity, "100 mV/g", by which they are divided:
        the dimension shows which it is.
    unit, target
        Of the numbers, and the SI unit to come out.

    Raises
    ------
    RsgenError
        It leads from one to the other neither way.

    Examples
    --------
    >>> sensor_factor("10 g/V", "V", "m/s^2"), sensor_factor("100 mV/g", "mV", "m/s^2")
    (98.0665, 0.0980665)
    """
    faults = []
    # elsewhere g is the gram where that fits, else the gravity: "2 kg" for a force from a base in g
    for meaning in dict.fromkeys((target, _ACCELERATION)):
        name, spelled = sensor_unit(unit, meaning), sensor_unit(text, meaning)
        size = quantity(f"1 {name}")
        try:
            return size * quantity(spelled, f"({target})/({name})")
        except RsgenError as fault:
            faults.append(fault)
        try:
            return size / quantity(spelled, f"({name})/({target})")
        except (RsgenError, ZeroDivisionError):
            continue
    why = str(faults[0]).replace("standard_gravity", "g")
    if "needed" in why:
        numbers = "unit is that of the numbers in the file before it, as V for 22.5 mV/N"
        why = f"{shown(text)} leads from numbers in {unit} to no {target}; {numbers}"
    raise RsgenError(why)


def quantity(value: object, unit: str | None = None) -> float:
    """The SI value of a number or of a number with its unit.

    Parameters
    ----------
    value
        A bare number, taken as SI, or text: ``"5.92 kN/m"``.
    unit
        Any unit of the dimension that is needed, "1" for a plain number; None takes every dimension.

    Returns
    -------
    float
        The value in SI units (N, m, s, kg; Hz stays Hz, angles are in rad).

    Raises
    ------
    RsgenError
        It is no such value, not finite, or of another dimension than is needed. Hz and rad/s are different.

    Examples
    --------
    >>> quantity("5.92 kN/m", "N/m"), quantity("20 mm", "m"), quantity(5920, "N/m")
    (5920.0, 0.02, 5920.0)
    >>> quantity("5.92 kN", "N/m")
    Traceback (most recent call last):
    ...
    rsgen.common.errors.RsgenError: '5.92 kN' is a force, but N/m (a stiffness) is needed
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise RsgenError(f"{shown(value)} is not a number; {_USAGE}")
    if not isinstance(value, str):
        return _finite(value, shown(value))
    number, text = _split(value)
    if not text:
        typed, unit = value.strip(), "" if unit == "1" else unit
        how = f'write "{typed} {unit}", or {typed} without quotes, in {unit}' if unit else _USAGE
        raise RsgenError(f"{shown(value)} is a number in quotes; {how}")
    try:
        found = read_unit(text)
    except RsgenError as fault:
        rms = _RMS.fullmatch(text)
        if rms is None:
            raise RsgenError(f"{shown(value)}: {fault}") from None
        peak = _finite(number * Fraction(math.sqrt(2)), shown(value))
        raise RsgenError(
            f"{shown(value)} is a root mean square; write the peak value {shown(f'{peak:.4g} {rms[1]}')}, or "
            'leave rms out: of levels of a multisine, and where scale = "rms" says it'
        ) from None
    if unit is not None:
        needed_dimension = read_unit(unit).dimension
        if found.dimension != needed_dimension:
            raise RsgenError(_mismatch(shown(value), number, text, found.dimension, needed_dimension, unit))
    return _finite(number * found.factor, shown(value))


def _finite(number: float | Fraction, shown: str) -> float:
    try:
        value = float(number)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value) or abs(value) > _LARGEST or (number and abs(value) < _SMALLEST):
        raise RsgenError(f"{shown} is out of range; values are 0 or between 1e-300 and 1e300 in magnitude")
    return value + 0.0  # -0.0 as 0.0


def _mismatch(
    shown: str, number: Fraction, typed: str, found: Dimension, needed: Dimension, unit: str
) -> str:
    if (found, needed) == (_HERTZ, _RATE):
        radians = float(number) * 2 * math.pi
        return f"{shown} counts cycles, but {unit} is needed; a cycle is 2 pi rad: write {radians:.6g} rad/s"
    if (found, needed) == (_RATE, _HERTZ):
        return f"{shown} is an angular frequency, but {unit} is needed; 2 pi rad/s are 1 Hz"
    what = found.name or f"in {min(typed, str(found), key=len)}"
    wanted = f" ({needed.name})" if needed.name and needed != NUMBER else ""
    if needed == NUMBER:
        return f"{shown} is {what}, but a plain number without unit is needed"
    meant = [name for name in other_capitals(typed) if read_unit(name).dimension == needed]
    hint = f"; did you mean '{meant[0]}'?" if meant else ""
    return f"{shown} is {what}, but {unit}{wanted} is needed{hint}"


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
    # people read angles in degrees
    "rad": ((math.pi / 180, "deg"),),
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
        """Return an axis label, such as ``Amplitude X [mm]``."""
        return f"{what} [{self.unit}]" if self.unit else what


def unit_text(unit: str) -> str:
    """Print a unit of the case language as a person writes it.

    Examples
    --------
    >>> unit_text("N*s^2/m^2"), unit_text("N/m**3"), unit_text("N/m^(3/2)"), unit_text("1")
    ('N·s²/m²', 'N/m³', 'N/m^(3/2)', '')
    """
    if unit == "1":
        return ""
    text = unit.replace("**", "^").replace("*", "·")
    power = re.compile(r"\^(?:\((-?[0-9.]+)\)|(-?[0-9.]+))")
    return power.sub(lambda found: (found[1] or found[2]).translate(_POWERS), text)


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


def off_by_scale(units: Mapping[str, str], *, held: bool = False) -> str:
    """Say by how much values are off by a factor that force and response share; "" where none is.

    Root mean squares read as peak are both too small by the root of two, as in another unit of length, which
    is in that of force, too. So is an error of an amplitude that was ``held``, where files have ratios to it.

    Examples
    --------
    >>> off_by_scale({"k": "N/m", "kn": "N/m^3", "Ff": "N"}, held=True)[:47]
    '1 % of the held amplitude moves kn by −2 %, Ff '
    >>> off_by_scale({"k": "N/m", "kn": "N/m^3"})
    'where both are rms but read as peak, kn is 2 times too large (or the reverse), and linear values stay'
    """
    known = {name: read_unit(unit).dimension.powers.get("m", 0) for name, unit in units.items() if unit}
    powers = {name: float(power) for name, power in known.items() if power}
    moved = ", ".join(f"{name} by {number_text(power, 2)} %" for name, power in powers.items())
    off = ", ".join(
        f"{name} is {number_text(2 ** abs(power / 2), 3)} times too {'large' if power < 0 else 'small'}"
        for name, power in powers.items()
    )
    rates = f"1 % of the held amplitude moves {moved}, if files have responses over the force; " * held
    said = f"where {'it is' if held else 'both are'} rms but read as peak, {off} (or the reverse)"
    return f"{rates}{said}, and linear values stay" if powers else ""


def quantity_text(value: float, unit: str, digits: int = 4) -> str:
    """Print a value with its unit and an engineering prefix.

    Examples
    --------
    >>> quantity_text(0.0512, "m", 2), quantity_text(5920, "N/m"), quantity_text(3.8, "N*s/m")
    ('51 mm', '5.92 kN/m', '3.8 N·s/m')
    """
    scale = choose_scale([value], unit)
    return f"{number_text(value / scale.factor, digits)} {scale.unit}".rstrip()


def per_mass_unit(unit: str) -> str:
    """Unit of a parameter of a law that gives the force per mass, from that of the force.

    Examples
    --------
    >>> per_mass_unit("N/m"), per_mass_unit("N*s^2/m^2"), per_mass_unit("N^0.5/m^0.5")
    ('N/m/kg', 'N*s^2/m^2/kg', '1/s')
    """
    if not unit:
        return unit
    # displacement and velocity contain no mass, so its power is that of the force
    dimension = read_unit(unit).dimension
    power = dimension.powers.get("kg", Fraction(0))
    if power == 0 or unit == "kg":
        return unit
    if abs(power) != 1:
        return str(dimension / Dimension({"kg": power}))
    return f"{unit}/kg" if power > 0 else f"{unit}*kg"


@dataclass(frozen=True, slots=True)
class ForceUnits:
    """Units of what a test of forces, or of forces per mass, tells.

    Parameters
    ----------
    force
        Of what drives.
    kilogram
        One kilogram [kg], NaN where the test is per unit mass and tells none.
    of
        Turns the unit of a stiffness, damping or energy into that of this test.
    """

    force: str
    kilogram: float
    of: Callable[[str], str]


WHOLE = ForceUnits("N", 1.0, str)
PER_UNIT_MASS = ForceUnits("m/s^2", math.nan, per_mass_unit)
# without a known scale of the force no unit that has one is known
UNCALIBRATED = ForceUnits("", 1.0, lambda unit: unit if per_mass_unit(unit) == unit != "kg" else "")
