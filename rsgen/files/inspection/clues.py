"""Clues to what an array of a data file is: its name, its unit, its values."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import pi

from rsgen.common.errors import RsgenError
from rsgen.data.surface.columns import QUANTITIES
from rsgen.files.column_titles import is_angular, split_title, unit_in
from rsgen.files.tree import Entry
from rsgen.formula.units import quantity, sensor_unit

__all__ = [
    "ANGULAR", "BASE", "BOTH_SIGNS", "CONTROL", "DECIBEL", "DRIVE", "EVEN", "FEW", "FORCE", "FREQUENCY",
    "INCREMENT", "IS_FORCE", "IS_MOTION", "LEVEL", "LOAD", "LONG", "NAMES", "NOMINAL", "OVER_FORCE",
    "PHASE", "POSITIVE", "QUOTIENT", "RADIAN", "RATE", "REAL", "RELATIVE", "RESPONSE", "RMS",
    "SPREAD", "TIME", "USABLE", "VALUES", "VARIES", "Clue", "complex_parts", "last_name", "of_size",
    "phase_sense", "remarked", "unit_for", "unit_in", "with_unit",
]  # fmt: skip

_FEW = 60
"""At most this number of different values may be levels."""
OVER_FORCE = {"displacement": "receptance", "velocity": "mobility", "acceleration": "accelerance"}
"""Responses over force, in the words of ISO 7626-1."""
VALUES = ("data", "value", "values")
"""Last names of paths that say nothing."""
_MOTION_UNITS = (*QUANTITIES.values(), *(f"{unit}/N" for unit in QUANTITIES.values()))
NAMES = {
    "inertance": "acceleration",
    "acc": "acceleration",
    "vel": "velocity",
    "mobility": "velocity",
    "disp": "displacement",
    "beschl": "acceleration",
    "geschw": "velocity",
    "vitesse": "velocity",
    " a ": "acceleration",
    " v ": "velocity",
}
"""Quantities by what stands in a name."""


@dataclass(frozen=True, slots=True)
class Clue:
    """A condition on an array; conditions are joined by & and |, inverted by ~."""

    holds: Callable[[Entry], bool]

    def __call__(self, entry: Entry) -> bool:
        """Whether it holds for an array."""
        return self.holds(entry)

    def __and__(self, other: Clue) -> Clue:
        """Both."""
        return Clue(lambda entry: self(entry) and other(entry))

    def __or__(self, other: Clue) -> Clue:
        """One of them."""
        return Clue(lambda entry: self(entry) or other(entry))

    def __invert__(self) -> Clue:
        """Not this."""
        return Clue(lambda entry: not self(entry))


def last_name(entry: Entry) -> str:
    """Give the title of a column without its unit, else the last part of a path with a meaning.

    "x/X1__V_/data" is about X1__V_.
    """
    if entry.title:
        return split_title(entry.title)[0] or entry.title
    parts = [part for part in entry.path.split("/") if part.casefold() not in VALUES]
    return parts[-1] if parts else entry.path


def _named(pattern: str) -> Clue:
    search = re.compile(pattern, re.IGNORECASE).search
    return Clue(lambda entry: bool(search(last_name(entry))))


ANGULAR = Clue(lambda entry: is_angular(entry.title or last_name(entry)))
FREQUENCY = _named(r"freq|fréq|hertz|omega|^f(_|$|\d)|(^|[_ ])hz(_|$)|rpm|drehzahl")
TIME = _named(r"^t(_|$)|time|zeit|instant|^x_value$")
"""The last is LabVIEW's."""
FORCE = _named(r"forc|kraft|load(?!_cycle)")
DRIVE = _named(r"excit|drive|shaker|^u(_|$)|input|^f(_|$|\d)|volt")
RESPONSE = _named(
    r"acc|vel|disp|resp|receptance|mobility|frf|strain|laser|output|^\W?[xyzva](_|\W|$|\d)|^h(_|$|\d)"
    r"|beschl|geschw|(^|[ _])weg|auslenk|schwing|vitesse|dépl|depl"
)
LOAD = _named(r"forc|kraft|load|^f(_|$|\d)")
LEVEL = _named(r"level|drive|^amplitude")
BASE = _named(
    r"(^|[^a-z])(base|table|tisch|ground|floor|boden|found(ation)?|fundament|fu(ß|ss)punkt|support|slip"
    r"|fixture|armature|aufspann\w*|shaker|exciter|seat ?rail)"
)
"""Where a structure on a driven base is fixed."""
CONTROL = _named(r"(^|[^a-z])(ctrl|control|regel|drive|input|excit\w*|ref(erence)?|anregung)")
"""What a shaker's controller holds; a motion of this name is that of the base where there is no force."""
RELATIVE = _named(r"(^|[^a-z])rel(ativ|ative)?([^a-z]|$)|relativ")
NOMINAL = _named(r"level|stufe|nominal|soll|set_?point")
RATE = _named(r"^f_?s$|rate|sampling|fsamp|sample_?freq")
INCREMENT = _named(r"^(dt|delta_?[xt]|increment|ts|x_?increment|sample_?(time|interval))$")
"""The time from one sample to the next."""
_PARTS = [
    tuple(map(re.compile, pair))
    for pair in (
        (
            r"(?i)(?<![^\W\d_])re(?:al)?(?:_?part|teil)?(?![^\W\d_])",
            r"(?i)(?<![^\W\d_])im(?:ag(?:in(?:ary|aer|är))?)?(?:_?part|teil)?(?![^\W\d_])",
        ),
        (r"\ARe(?=[A-Z])|(?<=[A-Za-z\d])Re\Z", r"\AIm(?=[A-Z])|(?<=[A-Za-z\d])Im\Z"),
        (r"(?i)(?<=[_ .])r\Z", r"(?i)(?<=[_ .])i\Z"),
        (r"(?i)in[ _-]?phase|\b(?:i|in)\Z", r"(?i)quad(?:rature)?|\bq\Z"),
        (r"(?i)cos(?:ine)?", r"(?i)sin(?:e)?"),
        (r"(?i)(?<![^\W_])x(?=\d*(?:_|\Z))", r"(?i)(?<![^\W_])y(?=\d*(?:_|\Z))"),
    )
]
"""How the names of a real and an imaginary part differ: "H_re" and "H_im", "ReH" and "ImH", a lock-in's "X"
and "Y" at the end."""
_PHASE_NAMED = _named(r"phas|phs|phi|φ|(^|[_ ])(lag|ang)(?![a-z])|(?<![a-z])arg|angle|winkel|deg")
_DEGREES = ("deg", "°", "rad", "degree", "degrees")
PHASE = Clue(lambda entry: _PHASE_NAMED(entry) or entry.unit in _DEGREES)
SPREAD = _named(
    r"std|sigma|var|error|coheren|kohären|temperature|number|(?<![a-z])(coh|temp|humidity|averages|date|rpm_set)(?![a-z])"
)
QUOTIENT = _named(
    r"receptance|mobility|accelerance|inertance|compliance|frf|^h(_|$|\d|\()|/\s?f\Z"
    r"|(frequency|freq\.?) response|transfer function|frequenzgang|übertragungsfunktion"
)
_LEAD = _named(r"lead")
_LAG = _named(r"lag")
RMS = re.compile(r"(?<![a-z])(rms|eff)", re.IGNORECASE)
DECIBEL = re.compile(r"(?<![a-z\d])db(?![a-z])", re.IGNORECASE)

REAL = Clue(lambda entry: not entry.dtype.startswith("complex"))
LONG = Clue(lambda entry: entry.size > 1)
FEW = Clue(lambda entry: 1 < entry.distinct <= _FEW and entry.distinct < entry.size / 3)
"""Few different numbers, as levels are."""
POSITIVE = Clue(lambda entry: entry.low is not None and entry.low >= 0 and (entry.high or 0) > 0)
"""No number is negative, and not all are zero."""
BOTH_SIGNS = Clue(lambda entry: entry.low is not None and entry.low < 0 < (entry.high or 0))
USABLE = Clue(lambda entry: not REAL(entry) or (entry.low is not None and (entry.low, entry.high) != (0, 0)))
"""Finite and not all zero; of complex numbers that is not known."""
VARIES = Clue(lambda entry: not REAL(entry) or (entry.low is not None and entry.low != entry.high))
EVEN = REAL & Clue(lambda entry: entry.order == "rising" and bool(entry.step) and entry.size > 15)
"""Rising in even steps, as instants do."""


def _is_radian(phase: Entry) -> bool:
    """Whether a phase is in radians, by its unit or its size."""
    if phase.unit in ("deg", "°", "rad"):
        return phase.unit == "rad"
    return phase.high is not None and phase.high <= 6.5 and (phase.low or 0) >= -6.5


RADIAN = Clue(_is_radian)


def with_unit(*targets: str) -> Clue:
    """Ask for a unit of one of the dimensions."""
    return Clue(lambda entry: bool(entry.unit) and any(unit_for(entry.unit, target) for target in targets))


IS_FORCE = with_unit("N")
IS_MOTION = with_unit(*_MOTION_UNITS)
"""By its unit a displacement, velocity or acceleration, or one of them over force."""


def of_size(size: int) -> Clue:
    """Ask for arrays with a side of ``size`` numbers."""
    return Clue(lambda entry: entry.size == size or size in entry.shape)


def complex_parts(entries: Sequence[Entry]) -> Iterator[tuple[Entry, Entry, Entry]]:
    """Find real and imaginary parts that belong together, by their names.

    Returns
    -------
    Each with the real part under the name that both have in common: "H" for "Re(H)" and "Im(H)".
    """
    for real, imaginary in _PARTS:
        # of equal names in their order; thousands of columns are gone through once
        partners: dict[tuple[int, str, str], list[Entry]] = defaultdict(list)
        for entry in entries:
            name = last_name(entry)
            if imaginary.search(name):
                partners[entry.size, entry.unit, imaginary.sub("*", name)].append(entry)
        for first in entries:
            name = last_name(first)
            if not real.search(name):
                continue
            alike = partners.get((first.size, first.unit, real.sub("*", name)), [])
            second = next((entry for entry in alike if entry is not first), None)
            if second is None or ((real, imaginary) == _PARTS[-1] and POSITIVE(first) and POSITIVE(second)):
                # of two directions x and y both amplitudes are positive
                continue
            alike.remove(second)
            common = real.sub("", name).strip(" _-.:()[]{}")
            yield replace(first, title=common or name), first, second


def remarked(word: str) -> Clue:
    """Ask for a word in what the file says about an array."""
    return Clue(lambda entry: word in entry.remark)


def unit_for(unit: str, target: str) -> str | None:
    """Give the unit, spelled as a case takes it, if it is one of the target's dimension."""
    name = unit.strip().replace("²", "^2").replace("µ", "u")
    name = "thou" if name in ("mil", "mils") else name
    try:
        quantity(f"1 {sensor_unit(name, target)}", target)
    except RsgenError:
        return None
    return name


def phase_sense(phase: Entry, quantity: str) -> str:
    """Find whether a positive phase means later or earlier, by its name, else by its values.

    A structure that takes energy from its shaker lags with its displacement and leads with its acceleration,
    by 0 to 180 deg; "lag" where the values allow both.
    """
    if _LAG(phase) or _LEAD(phase):
        return "lag" if _LAG(phase) else "lead"
    low, high = phase.low, phase.high
    if low is None or high is None or quantity == "velocity":
        return "lag"
    half = pi if RADIAN(phase) else 180.0
    margin = half / 12
    negative = -half - margin <= low and high <= margin and low < -margin
    positive = -margin <= low and high <= half + margin and high > margin
    if not (negative or positive):
        return "lag"
    return "lag" if positive == (quantity == "displacement") else "lead"
