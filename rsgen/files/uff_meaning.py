"""What the functions of a universal file are, in words of ISO 7626, and the qualifiers of data set 1858.

Source of the format: the published descriptions of universal file data sets 58 and 1858, "Dataset 58
qualifiers"; of the words: ISO 7626-1, "Mechanical mobility: basic terms and definitions".
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rsgen.common.errors import MeasurementError

__all__ = ["FORCES", "Qualifiers", "fault_of", "place_of", "qualifiers", "remark_of", "scale_of"]

_FUNCTIONS = {
    0: "general", 1: "time response", 2: "auto spectrum", 3: "cross spectrum", 4: "frequency response",
    5: "transmissibility", 6: "coherence", 7: "auto correlation", 8: "cross correlation",
    9: "power spectral density", 10: "energy spectral density", 11: "probability density", 12: "spectrum",
    13: "cumulative distribution", 14: "peaks and valleys", 18: "mode indicator", 24: "shock spectrum",
    26: "multiple coherence", 27: "order function",
}  # fmt: skip
_RESPONSES = (0, 1, 4, 12, 27)
_AMPLITUDES = (12, 27)
"""Functions whose amplitudes may be peaks, halves of them or root mean squares; in a quotient they cancel."""
_QUANTITIES = {8: "displacement", 9: "force", 11: "velocity", 12: "acceleration", 13: "force", 15: "pressure"}
FORCES = (9, 13)
"""Kinds of data: reaction force and excitation force."""
_OVER_FORCE = {8: "receptance", 11: "mobility", 12: "accelerance"}
_OF_FORCE = {8: "dynamic stiffness", 11: "mechanical impedance", 12: "apparent mass"}
_WINDOWS = {1: "Hanning window", 2: "Hanning window", 3: "flattop window", 4: "exponential window",
            5: "impact window", 6: "impact and exponential window"}  # fmt: skip
_EXPONENTIAL = (4, 6)
_SCALES = {1: "half-peak", 2: "peak", 3: "rms"}
_WEIGHTINGS = {1: "A", 2: "B", 3: "C", 4: "D"}
_DIRECTIONS = {"1": "+X", "2": "+Y", "3": "+Z", "-1": "-X", "-2": "-Y", "-3": "-Z"}
_ROTATIONS = (1, 3)


@dataclass(frozen=True, slots=True)
class Qualifiers:
    """Data set 1858: how a function of data set 58 was made; 0 where it is unknown or was not.

    Parameters
    ----------
    octave
        n of bands of 1/n octave.
    weighting, window, scale
        Codes of the frequency weighting, of the window and of the amplitudes.
    numerator, denominator
        1 and 3 for rotations.
    """

    octave: int = 0
    weighting: int = 0
    window: int = 0
    scale: int = 0
    numerator: int = 0
    denominator: int = 0


def qualifiers(lines: Sequence[str]) -> Qualifiers:
    """Read the first two lines of data set 1858.

    Raises
    ------
    MeasurementError
        They have other than whole numbers, or too few; the message has no place yet.

    Examples
    --------
    >>> qualifiers(["1 0 0 0 0 0", "0 4 3 0 0 0 0 0 0 0 0 0"]).window
    4
    """
    found = [line.split() for line in lines[:2]]
    if [len(line) >= few for line, few in zip(found, (2, 7), strict=False)] != [True, True] or not all(
        re.fullmatch(r"-?\d{1,9}", text, re.ASCII) for line in found for text in line
    ):
        raise MeasurementError("two lines of whole numbers, 2 and 7 at least, are needed in data set 1858")
    first, second = ([int(text) for text in line] for line in found)
    return Qualifiers(first[1], second[0], second[1], second[2], second[5], second[6])


def fault_of(function: int, ordinate: int, over: int, said: Qualifiers) -> str:
    """Say why a function is none that can be read, or "".

    Parameters
    ----------
    function, ordinate, over
        Kind of function, and of the data of numerator and denominator.
    said
        Its qualifiers.
    """
    if function not in _RESPONSES:
        what = _FUNCTIONS.get(function, f"function of type {function}")
        return (
            f"is a {what}, which is no response to one sine; "
            "a time response, frequency response or spectrum is needed"
        )
    if function == 4 and ordinate in FORCES and over in _OF_FORCE:
        return f"is a force over a motion ({_OF_FORCE[over]}); receptance, mobility or accelerance is needed"
    if said.numerator in _ROTATIONS or said.denominator in _ROTATIONS:
        return "is of a rotation or a moment (data set 1858); motions along a line and forces are read"
    if said.octave:
        return f"is in bands of 1/{said.octave} octave (data set 1858); narrow lines are needed"
    if said.weighting:
        weighting = _WEIGHTINGS.get(said.weighting, str(said.weighting))
        return f"has a frequency weighting ({weighting}, data set 1858); numbers without one are needed"
    return ""


def scale_of(function: int, said: Qualifiers) -> str:
    """Give "rms", "peak" or "half-peak" where a spectrum says what its amplitudes are, else ""."""
    return _SCALES.get(said.scale, "") if function in _AMPLITUDES else ""


def remark_of(
    function: int, axes: tuple[int, int], places: tuple[str, str], label: str, said: Qualifiers
) -> str:
    """Describe a function, what it is in words of ISO 7626 first; ``places`` of response and reference.

    Examples
    --------
    >>> remark_of(4, (12, 13), ("BEAM 2 +Z", "BEAM 1 +Z"), "", Qualifiers())
    'accelerance, frequency response, BEAM 2 +Z, acceleration, over force, at BEAM 1 +Z'
    """
    ordinate, over = axes
    parts = [_OVER_FORCE.get(ordinate, "") if function == 4 and over in FORCES else ""]
    parts.append(scale_of(function, said))
    parts.append(_WINDOWS.get(said.window, "") + (" adds damping" if said.window in _EXPONENTIAL else ""))
    parts += [
        _FUNCTIONS.get(function, f"function {function}"),
        places[0],
        label,
        _QUANTITIES.get(ordinate, ""),
    ]
    if over in FORCES:
        parts += ["over force", f"at {places[1]}" if places[1] else ""]
    return ", ".join(part for part in parts if part)


def place_of(text: str) -> str:
    """Name a point by entity, node and direction, "" for none; directions that are no axis are left out."""
    entity, node, direction = text[:11].strip(), text[11:21].strip(), text[21:25].strip()
    named = "" if entity == "NONE" and node == "0" else f"{entity} {node}".strip()
    return f"{named} {_DIRECTIONS.get(direction, '')}".strip() if named else ""
