"""Titles of columns: the name, the unit and an angular frequency in them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rsgen.common.finding import Finding
from rsgen.data.record_set import QUANTITIES
from rsgen.formula.unit_text import MAX_UNIT_CHARACTERS
from rsgen.formula.units import sensor_size

if TYPE_CHECKING:
    from rsgen.files.plan import MeasuredTest
    from rsgen.files.signals import Channel

# ----------------------------------------------------------------------------
# Comparison of the unit that a case gives to a column with the unit in its title.

UNIT_TOLERANCE = 1e-3
"""Units closer than this, relatively, are one: 9.81 and 9.80665 m/s^2 for g."""
VOLTAGES = ("V", "mV")
"""Units of the output of a sensor before its factor."""
_ANGLES = {"deg": "deg", "°": "deg", "rad": "rad"}
RMS = re.compile(r"(?<![a-z])(rms|eff(?!ort|ic))", re.IGNORECASE)
PEAK = re.compile(r"(?<![a-z-])(peak|pk)(?![- ]?(to|peak|pk))", re.IGNORECASE)
"""In titles of root mean squares ("Weg_eff"), and of peak amplitudes, but not from peak to peak."""


def contradiction(file: str, column: str, unit: str, title: str) -> Finding:
    """Say that a column is read in another unit than its title, or the file, names."""
    about = {"file": file, "column": column, "unit": unit, "title": title}
    return Finding("unit-contradicts-title", "doubt", names=about)


def scale_doubts(file: str, title: str, scale: str) -> list[Finding]:
    """Find that amplitudes are read as "peak" or "rms", their ``scale``, and the title says the other."""
    other, word = ("rms", RMS) if scale == "peak" else ("peak", PEAK)
    return [contradiction(file, title, f"{scale} amplitudes", other)] if word.search(title) else []


def column_read_in(address: int | str, unit: str) -> str:
    """Say in what unit a column was read, as "column 2, read in Hz"."""
    return f"{f'column {address}' if isinstance(address, int) else address}, read in {unit}"


def unit_doubts(
    test: MeasuredTest, file: str, titles: Mapping[int | str, str], channel: Channel
) -> list[Finding]:
    """Find columns whose title names another unit of the same quantity than the case.

    Parameters
    ----------
    test, file
        The plan, and what the file is called.
    titles
        Of the columns, by their addresses.
    channel
        A channel of the test.
    """
    found = []
    if channel.phase is not None:
        title = unit_in(titles.get(channel.phase, ""))
        if title in _ANGLES and _ANGLES[title] != channel.phase_unit:
            found.append(contradiction(file, titles[channel.phase], channel.phase_unit, title))
    if channel.factor != 1 or not test.calibrated:
        return found
    target = test.unit_of(channel)
    for column in channel.columns:
        called = titles.get(column, "")
        if channel.samples is None and not test.per_force:
            found += scale_doubts(file, called, channel.scale)
        name, unit = split_title(called)
        read_as = channel.unit or unit
        # a unit that the case leaves to the file is that of the title; a row of units may have added another
        for title in filter(None, (unit if channel.unit else "", _enclosed_unit(name))):
            said, read = (sensor_size(unit, target) for unit in (title, read_as))
            if said is None or read is None:
                # a title may end like a unit of something else; volts are of a sensor without its factor
                bracketed = called.rstrip()[-1:] in (")", "]")
                if title in VOLTAGES or title.endswith("Hz") or (bracketed and is_of_signal(title)):
                    found.append(contradiction(file, called, read_as, title))
            elif abs(said - read) > UNIT_TOLERANCE * abs(read):
                found.append(contradiction(file, called, read_as, title))
    return found


_SIGNALS = ("V", "N", *(unit + per for unit in QUANTITIES.values() for per in ("", "/N")))
"""SI units of a sensor's output, of a force, of motions, and of motions over a force."""


def is_of_signal(unit: str) -> bool:
    """Return True for a unit of a sensor's output, a force, a motion, or of motion over force."""
    return any(sensor_size(unit, target) is not None for target in _SIGNALS)


_NAMED = r"(?:Hz|kHz|rpm|s|ms|us|N|mN|kN|lbf|m|mm|um|µm|nm|mil|mils|in|g|deg|rad|V|mV)"
"""Units that a title may end with without brackets: "force_N"."""
_PER_TIME = r"(?:[munkµ]?m|in|ft|thou)/s(?:\^?2|²)?(?:/N)?"
_BEHIND = re.compile(
    rf"_((?:{_NAMED}|{_PER_TIME})(?:_per_N)?)\Z" + r"|\s(?:in|/)\s+([^\s()\[\]]{1,12})(?:\s|\Z)"
)
"""A unit behind a name: "force_N", "Kraft in N (rms)"."""
_OVER = re.compile(rf"([^\s/()\[\]]{{1,20}})\s?/\s?({_NAMED}|{_PER_TIME}|°|rad/s|1/min|mHz|[unµ]N|m?A|%)\Z")
"""Quantity over unit, as DIN 1313 has it: "F/N"."""
_UNIT = re.compile(
    rf"[\[(]?\s*(?:{_PER_TIME}|(?:{_NAMED}|[unµ]N|m?A|thou|ft|kgf|strain|Pa|kg|°|%|-|1|rad/s|1/min)(?:/(?:[munkµ]?N|lbf|s|V))?"
    r"|\(?[mg]/?s?\^?2?\)?/N)\s*[\])]?"
)
"""Unit that stands alone in a row of units below the titles."""
ENCLOSED = re.compile(r"\s*[\[(]\s*([^()\[\]]*?)\s*[\])]\s*\Z")
"""A unit in brackets."""
_WITHOUT_STROKES = re.compile(r"_([munkµ]?m|in)(?:_s(2?)|s(2))\Z")
"""Names without strokes: "v_mm_s", "a_ms2"."""
_QUOTIENT = re.compile(r"(?<![(\[])(\([^()\s]{1,20}\)\s?/\s?(?:[A-Za-zµ]{1,4}|\([A-Za-zµ]{1,4}\)))\Z")
"""A unit with its own brackets at the end of a title: "accelerance (m/s^2)/N"."""
_BRACKETS = {")": "(", "]": "["}
_KIND_OF_AMPLITUDE = re.compile(r"rms|eff\.?|peak|pk|amplitude|0-?p", re.IGNORECASE)
"""In brackets these are no units: "Kraft in N (rms)"."""
_FUNCTION = re.compile(r"(?<![a-z])(?:re|im|real|imag|abs|mag|arg|phase|angle)\Z", re.IGNORECASE)
"""Before a bracket: "Re(H)" is the real part of H, not one in henry."""
_ANGULAR = re.compile(
    r"^(?:w|omega|ω|Ω)(?:$|[\s_\d\[(/])|angular|omega|kreisfreq|rad\s*(?:(?:/|_|per)\s*)?s(?:ec)?(?![a-z])",
    re.IGNORECASE,
)
"""Titles of angular frequencies: "Omega", "w", "freq_rad_s"."""
_CYCLIC = re.compile(r"Hz|rpm", re.IGNORECASE)
"""In such a title this says that it is no angular frequency all the same: "omega_Hz"."""


def split_title(title: str) -> tuple[str, str]:
    """Split a title into the name and the unit, "" where it has none; "force_N" is a name as a whole, too.

    Examples
    --------
    >>> split_title("H [(m/s^2)/N]"), split_title("F/kN"), split_title("accelerance_g_per_N")
    (('H', '(m/s^2)/N'), ('F', 'kN'), ('accelerance_g_per_N', 'g/N'))
    >>> split_title("arg(X1)/deg"), split_title("Re (m/s^2)/N")
    (('arg(X1)', 'deg'), ('Re', '(m/s^2)/N'))
    """
    text = _WITHOUT_STROKES.sub(r"_\1/s\2\3", title.rstrip())
    if quotient := _QUOTIENT.search(text):
        name = text[: quotient.start()].rstrip()
        if _FUNCTION.search(name) and not is_unit(quotient[1]):
            # the phase of F over its unit: "arg(F)/deg"
            numerator, _, denominator = text.rpartition("/")
            return numerator.rstrip(), denominator.strip()
        return name, quotient[1]
    if begin := _opening(text):
        name, unit = text[: begin - 1].rstrip(), text[begin:-1].strip()
        if _KIND_OF_AMPLITUDE.fullmatch(unit):
            return split_title(name)
        argument = _FUNCTION.search(name) and not re.fullmatch(
            rf"{_NAMED}|°", unit.partition("/")[0].strip("( ")
        )
        return (text, "") if argument else (name, unit)
    if found := _BEHIND.search(text):
        return text, (found[1] or found[2]).replace("_per_", "/")
    over = _OVER.match(text)
    return (over[1], over[2]) if over else (text, "")


def _opening(text: str) -> int:
    """Return the first position inside the brackets at the end of a title; 0 if missing or empty."""
    if text[-1:] not in _BRACKETS:
        return 0
    sign, depth = text[-1], 0
    for place in range(len(text) - 1, max(len(text) - MAX_UNIT_CHARACTERS - 3, -1), -1):
        depth += (text[place] == sign) - (text[place] == _BRACKETS[sign])
        if not depth:
            return place + 1 if text[place + 1 : -1].strip() else 0
    return 0


def unit_in(title: str) -> str:
    """Return the unit in a title, or "".

    Examples
    --------
    >>> unit_in("accelerance_g_per_N")
    'g/N'
    """
    return split_title(title)[1]


def is_unit(text: str) -> bool:
    """Return True for a text that is a unit and nothing else, as in a row of units.

    Examples
    --------
    >>> [is_unit(text) for text in ("[kN]", "m/s^2", "mm/N", "deg", "force", "f")]
    [True, True, True, True, False, False]
    """
    return bool(_UNIT.fullmatch(text))


def join_units(titles: Sequence[str], cells: Sequence[str]) -> list[str]:
    """Return titles with the units of the row below them; as they are where that is no row of units.

    A title that names another unit has both then, and is doubted where its column is read.

    Examples
    --------
    >>> join_units(["n", "F", "H"], ["", "[kN]", "(m/s^2)/N"]), join_units(["F"], ["sensor 2"])
    (['n', 'F [kN]', 'H [(m/s^2)/N]'], ['F'])
    >>> join_units(["F [N]", "a [m/s2]"], ["kN", "m/s^2"])
    ['F [N] [kN]', 'a [m/s2]']
    """
    if not all(is_unit(cell) for cell in cells if cell):
        return list(titles)
    units = [ENCLOSED.sub(r"\1", cell) for cell in cells]
    pairs = zip(titles, units, strict=True)
    return [
        f"{title} [{unit}]" if unit not in ("", "-") and _is_another(unit, unit_in(title)) else title
        for title, unit in pairs
    ]


def _enclosed_unit(name: str) -> str:
    """Return the unit in brackets, or below a stroke, that a name still has; "" for "force_N"."""
    rest, unit = split_title(name)
    return unit if rest != name else ""


def _is_another(unit: str, said: str) -> bool:
    """Return True for a unit of another size or dimension than ``said``, or where nothing is said."""
    own, other = (sensor_size(one, unit) for one in (unit, said))
    if own is None or other is None:
        return not said or all(is_of_signal(one) or one in ("Hz", "rad/s", "rpm") for one in (unit, said))
    return abs(other - own) > UNIT_TOLERANCE * own


def is_angular(title: str) -> bool:
    """Return True for the title of an angular frequency, in rad/s.

    Examples
    --------
    >>> [is_angular(title) for title in ("Omega", "w [rad/s]", "omega_Hz", "f_Hz", "width")]
    [True, True, False, False, False]
    """
    return bool(_ANGULAR.search(title)) and not _CYCLIC.search(title)
