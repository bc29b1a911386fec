"""What names, units and values of an array tell about its part in a test."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import pi

from rsgen.errors import RsgenError
from rsgen.measurement.tree import Entry
from rsgen.units import quantity, sensor_unit

__all__ = [
    "DECIBEL",
    "DRIVE",
    "EXCITATIONS",
    "FEW",
    "FORCE",
    "FREQUENCY",
    "IMAGINARY",
    "LEVEL",
    "LOAD",
    "NAMES",
    "NOMINAL",
    "PHASE",
    "QUANTITIES",
    "QUOTIENT",
    "RATE",
    "REAL",
    "RESPONSE",
    "RESPONSE_UNITS",
    "RMS",
    "SPREAD",
    "TIME",
    "all_of",
    "evenly_spaced",
    "has_both_signs",
    "has_few",
    "is_long",
    "is_named",
    "is_positive",
    "is_radian",
    "is_real",
    "is_unit",
    "last_name",
    "moves",
    "of_size",
    "phase_sense",
    "remarked",
    "tells",
    "unit_for",
    "unit_in",
]

FEW = 60
"""Different values of a column that may be that of the level."""
FREQUENCY = re.compile(r"freq|hertz|omega|^f(_|$|\d)|(^|_)hz(_|$)|rpm", re.IGNORECASE)
TIME = re.compile(r"^t(_|$)|time|zeit|instant", re.IGNORECASE)
FORCE = re.compile(r"forc|kraft|load(?!_cycle)", re.IGNORECASE)
DRIVE = re.compile(r"excit|drive|shaker|^u(_|$)|input|^f(_|$|\d)|volt", re.IGNORECASE)
RESPONSE = re.compile(
    r"acc|vel|disp|resp|receptance|mobility|frf|strain|laser|output|^[xyva](_|$|\d)|^h(_|$|\d)", re.IGNORECASE
)
LOAD = re.compile(r"forc|kraft|load|^f(_|$|\d)", re.IGNORECASE)
LEVEL = re.compile(r"level|drive|^amplitude", re.IGNORECASE)
NOMINAL = re.compile(r"level|stufe|nominal|soll|set_?point", re.IGNORECASE)
UNIT = re.compile(
    r"[\[(]\s*([^\])]{1,20}?)\s*[\])]\s*\Z"
    r"|_((?:Hz|kHz|rpm|s|ms|us|N|mN|kN|lbf|m|mm|um|µm|nm|mil|mils|in|g|deg|rad|V|mV)(?:_per_N)?)\Z"
    r"|\s(?:in|/)\s+([^\s()\[\]]{1,12})(?:\s|\Z)"
)
"""A unit in a name: "Kraft [N]", "force_N", "Kraft in N (rms)"."""
DECIBEL = re.compile(r"\bdb", re.IGNORECASE)
RMS = re.compile(r"(?<![a-z])(rms|eff)", re.IGNORECASE)
LEAD = re.compile(r"lead", re.IGNORECASE)
LAG = re.compile(r"lag", re.IGNORECASE)
QUOTIENT = re.compile(r"receptance|mobility|accelerance|inertance|compliance|frf|^h(_|$|\d)", re.IGNORECASE)
EXCITATIONS = {
    "step": "stepped-sine",
    **dict.fromkeys(("decay", "ring", "release", "hammer", "impact", "impulse", "ausschwing"), "ring-down"),
}
RATE = re.compile(r"^f_?s$|rate|sampling|fsamp", re.IGNORECASE)
REAL = re.compile(r"(^|_)re(al)?(_|$)|in_?phase|cos|(^|_)x\d*(_|$)", re.IGNORECASE)
IMAGINARY = re.compile(r"(^|_)im(ag)?|quad|sin|(^|_)y\d*(_|$)", re.IGNORECASE)
PHASE = re.compile(r"phase|phi|(^|_)lag|arg|angle|deg", re.IGNORECASE)
SPREAD = re.compile(r"std|sigma|var|error|coherence|temperature|number", re.IGNORECASE)
QUANTITIES = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
RESPONSE_UNITS = (*QUANTITIES.values(), *(f"{unit}/N" for unit in QUANTITIES.values()))
NAMES = {
    "inertance": "acceleration",
    "acc": "acceleration",
    "vel": "velocity",
    "mobility": "velocity",
    "disp": "displacement",
    " a ": "acceleration",
    " v ": "velocity",
}


def unit_in(name: str) -> str:
    """Give the unit that a name tells, or "": "accelerance_g_per_N" has g/N."""
    found = UNIT.search(name)
    return next(filter(None, found.groups())).replace("_per_", "/") if found else ""


def last_name(entry: Entry) -> str:
    """Give the last telling part of a path: "x/X1__V_/data" is about X1__V_."""
    if entry.path.isdigit() and entry.remark:
        # a column that goes by its number, with a title of its own
        return entry.remark
    parts = [part for part in entry.path.split("/") if part.casefold() not in ("data", "value", "values")]
    return parts[-1] if parts else entry.path


def unit_for(unit: str, target: str) -> str | None:
    """Give the unit if it is one of the target's dimension."""
    name = unit.strip().replace("²", "^2").replace("µ", "u")
    name = "thou" if name in ("mil", "mils") else name
    try:
        quantity(f"1 {sensor_unit(name, target)}", target)
    except RsgenError:
        return None
    return name


def is_unit(entry: Entry, *targets: str) -> bool:
    """Tell whether the unit in the file is of one of the dimensions."""
    return bool(entry.unit) and any(unit_for(entry.unit, target) for target in targets)


def tells(entry: Entry) -> bool:
    """Tell whether numbers are finite and not all zero."""
    return entry.dtype.startswith("complex") or (entry.low is not None and (entry.low, entry.high) != (0, 0))


def moves(entry: Entry) -> bool:
    """Tell whether the numbers are finite and differ; of complex ones that is not known."""
    return entry.dtype.startswith("complex") or (entry.low is not None and entry.low != entry.high)


def of_size(size: int) -> Callable[[Entry], bool]:
    """Make a test for arrays with a side of so many numbers."""
    return lambda entry: entry.size == size or size in entry.shape


def phase_sense(phase: Entry, quantity: str) -> str:
    """Tell whether a positive phase means later or earlier, by its name, else by its values.

    A structure that takes energy from its shaker lags with its displacement and leads with its acceleration,
    by 0 to 180 deg; where the values tell nothing, "lag".
    """
    if LAG.search(last_name(phase)) or LEAD.search(last_name(phase)):
        return "lag" if LAG.search(last_name(phase)) else "lead"
    low, high = phase.low, phase.high
    if low is None or high is None or quantity == "velocity":
        return "lag"
    half = pi if is_radian(phase) else 180.0
    margin = half / 12
    negative = -half - margin <= low and high <= margin and low < -margin
    positive = -margin <= low and high <= half + margin and high > margin
    if not (negative or positive):
        return "lag"
    return "lag" if positive == (quantity == "displacement") else "lead"


def is_radian(phase: Entry) -> bool:
    """Tell whether a phase is in radians, by its unit or its size."""
    if phase.unit in ("deg", "°"):
        return False
    return phase.unit == "rad" or (phase.high is not None and phase.high <= 6.5 and (phase.low or 0) >= -6.5)


def all_of(*tests: Callable[[Entry], bool]) -> Callable[[Entry], bool]:
    """Make a test that asks for several."""
    return lambda entry: all(test(entry) for test in tests)


def is_named(pattern: re.Pattern[str]) -> Callable[[Entry], bool]:
    """Make a test for names."""
    return lambda entry: bool(pattern.search(last_name(entry)))


def remarked(*words: str) -> Callable[[Entry], bool]:
    """Make a test for what the file says about an array."""
    return lambda entry: any(word in entry.remark for word in words)


def is_positive(entry: Entry) -> bool:
    """Tell whether no number is negative, and not all are zero."""
    return entry.low is not None and entry.low >= 0 and entry.high is not None and entry.high > 0


def has_few(entry: Entry) -> bool:
    """Tell whether there are few different numbers, as levels are."""
    return 1 < entry.distinct <= FEW and entry.distinct < entry.size / 3


def has_both_signs(entry: Entry) -> bool:
    """Tell whether there are numbers below and above zero."""
    return entry.low is not None and entry.high is not None and entry.low < 0 < entry.high


def is_real(entry: Entry) -> bool:
    """Tell whether numbers are real."""
    return not entry.dtype.startswith("complex")


def is_long(entry: Entry) -> bool:
    """Tell whether there is more than one number."""
    return entry.size > 1


def evenly_spaced(entry: Entry) -> bool:
    """Tell whether numbers rise evenly, as instants do."""
    return entry.order == "rising" and bool(entry.step) and entry.size > 15 and is_real(entry)
