"""Recognise the arrays of a data file by their names, units, sizes and texts about them, not by values."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rsgen.common.errors import RsgenError
from rsgen.data.record_set import QUANTITIES
from rsgen.files.column_titles import is_angular, is_unit, split_title, unit_in
from rsgen.files.tree import TEXT, Contents, Entry
from rsgen.formula.units import quantity, sensor_unit

TODO = "TODO: "
"""How a comment begins that asks for what no name or unit in the file says."""
OVER_FORCE = {"displacement": "receptance", "velocity": "mobility", "acceleration": "accelerance"}
"""Responses over force, in the words of ISO 7626-1."""
_VALUES = ("data", "value", "values")
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
        """Return True if the condition holds for an array."""
        return self.holds(entry)

    def __and__(self, other: Clue) -> Clue:
        """Return the condition that both hold."""
        return Clue(lambda entry: self(entry) and other(entry))

    def __or__(self, other: Clue) -> Clue:
        """Return the condition that at least one of them holds."""
        return Clue(lambda entry: self(entry) or other(entry))

    def __invert__(self) -> Clue:
        """Return the opposite condition."""
        return Clue(lambda entry: not self(entry))


def last_name(entry: Entry) -> str:
    """Return the title of a column without its unit, else the last part of a path with a meaning.

    The name of "x/X1__V_/data" is X1__V_.
    """
    if entry.title:
        return split_title(entry.title)[0] or entry.title
    parts = [part for part in entry.path.split("/") if part.casefold() not in _VALUES]
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
RUN = _named(r"^(run|sweep|lauf|versuch)([ _]?no)?\.?$")
"""Rows of one run; whether those are the points of one level only the numbers say."""
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
_VOLTS = ("", "V", "mV")
"""Units of a lock-in amplifier; X and Y with another one are directions."""
_PHASE_NAMED = _named(r"phas|phs|phi|φ|(^|[_ ])(lag|ang)(?![a-z])|(?<![a-z])arg|angle|winkel|deg")
_DEGREES = ("deg", "°", "rad", "degree", "degrees")
PHASE = Clue(lambda entry: _PHASE_NAMED(entry) or entry.unit in _DEGREES)
_SPREAD = _named(
    r"std|sigma|var|error|coheren|kohären|temperature|number|(?<![a-z])(coh|temp|humidity|averages|date|rpm_set)(?![a-z])"
)
QUOTIENT = _named(
    r"receptance|mobility|accelerance|inertance|compliance|frf|^h(_|$|\d|\()|/\s?f\Z"
    r"|(frequency|freq\.?) response|transfer function|frequenzgang|übertragungsfunktion"
)
_LEAD = _named(r"lead")
_LAG = _named(r"lag")
RMS = re.compile(r"(?<![a-z])(rms|eff)", re.IGNORECASE)
PEAK = re.compile(r"(?<![a-z-])(peak|pk)(?![- ]?(to|peak|pk))", re.IGNORECASE)
DECIBEL = re.compile(r"(?<![a-z\d])db(?![a-z])", re.IGNORECASE)

REAL = Clue(lambda entry: not entry.dtype.startswith("complex"))
LONG = Clue(lambda entry: entry.size > 1)


def _with_unit(*targets: str) -> Clue:
    """Ask for a unit of one of the dimensions."""
    return Clue(lambda entry: bool(entry.unit) and any(unit_for(entry.unit, target) for target in targets))


IS_FORCE = _with_unit("N")
IS_MOTION = _with_unit(*_MOTION_UNITS)
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
            if second is None or ((real, imaginary) == _PARTS[-1] and first.unit not in _VOLTS):
                continue
            alike.remove(second)
            common = "" if (real, imaginary) == _PARTS[-1] else real.sub("", name).strip(" _-.:()[]{}")
            yield replace(first, title=common or name), first, second


def remarked(word: str) -> Clue:
    """Ask for a word in what the file says about an array."""
    return Clue(lambda entry: word in entry.remark)


def unit_for(unit: str, target: str) -> str | None:
    """Return a unit as a case spells it; None if its dimension is not that of the target."""
    name = unit.strip().replace("²", "^2").replace("µ", "u")
    name = "thou" if name in ("mil", "mils") else name
    try:
        quantity(f"1 {sensor_unit(name, target)}", target)
    except RsgenError:
        return None
    return name


def phase_sense(phase: Entry) -> str:
    """Return "lag" or "lead" where the name of a phase says so: later or earlier; "" elsewhere."""
    return "lag" if _LAG(phase) else "lead" if _LEAD(phase) else ""


# ----------------------------------------------------------------------------
# The draft of a case while it is written, with the arrays that have no place in it yet.


class Draft:
    """The tables of a case as far as they are written, and the entries that have no place in them yet."""

    def __init__(self, contents: Contents) -> None:
        self.contents = contents
        readable = (e for e in contents.entries if e.dtype and not e.fault and e.size and not _is_empty(e))
        texts = {e.path: e.remark for e in contents.entries if e.dtype == TEXT}
        self.free = [e for e in (_completed(e, texts) for e in readable) if not _SPREAD(e)]
        self.levels: list[str] = []
        self.run: tuple[str, str] | None = None
        self.tables: dict[str, dict[str, Any]] = {}
        self.doubts: dict[str, str] = {}

    def take(self, *clues: Clue) -> Entry | None:
        """Take the first entry for which the first clue that holds for any holds."""
        entry = next((entry for clue in clues for entry in self.free if clue(entry)), None)
        if entry is not None:
            self.free.remove(entry)
        return entry

    def address(self, entry: Entry) -> int | str:
        """Return the address of an array in a case."""
        if self.run:
            run, star = self.run
            if entry.path.startswith(run):
                return star + entry.path.removeprefix(run)
        sides = [length for length in entry.shape if length > 1]
        if len(sides) > 1 and self.tables["test"].get("excitation"):
            return f"{entry.path}[1]"
        return int(entry.path) if self.contents.format == "csv" and entry.path.isdigit() else entry.path


def _is_empty(entry: Entry) -> bool:
    """Return True if no number of a real array is finite, or all are zero; complex ones have no range."""
    return REAL(entry) and entry.size > 1 and (entry.low is None or entry.low == entry.high == 0)


def _completed(entry: Entry, texts: Mapping[str, str]) -> Entry:
    """Add to an entry its unit, as a case spells it, and its name, both from texts in the file."""
    named = entry if entry.title else replace(entry, title=name_beside(entry.path, texts))
    name = last_name(named)
    unit = named.unit or unit_beside(entry.path, texts) or unit_in(name) or unit_within(name)
    return replace(named, unit=plain_unit(unit))


def run_of(entry: Entry, entries: Iterable[Entry]) -> tuple[str, str, int] | None:
    """Find whether an entry stands in one of several runs: how its path begins, the same with *, how many.

    "runs/1/f" and "drive_1/f" do, if there is a "runs/2/f" or "drive_2/f".
    """
    paths = {other.path for other in entries}
    parts = entry.path.split("/")
    for place, part in enumerate(parts[:-1]):
        stem = part.rstrip("0123456789")
        if stem == part:
            continue
        rest = "/".join(parts[place + 1 :])
        before = "/".join([*parts[:place], stem])
        alike = re.compile(re.escape(before) + r"\d+/" + re.escape(rest))
        count = sum(bool(alike.fullmatch(path)) for path in paths)
        if count > 1:
            return "/".join(parts[: place + 1]) + "/", before + "*/", count
    return None


_WITHIN = re.compile(r"\s?[\[(]\s*([^()\[\]]{1,12}?)\s*[\])](?=\s)")
"""A unit in brackets amid a title: "Force (N) Mag"."""
_LAST = re.compile(r"(?<=\S)\s+(\S{1,12})\Z")
"""A unit as the last word of a title: "Acceleration g"."""
_NO_UNIT = ("", "-", "1", "%")
"""What stands in a row of units and says nothing at the end of a title."""

_UNITS = ("unit", "units", "Unit", "Units")
_NAMES = ("name", "Name", "SignalName", "ChannelName", "channel_name", "label", "Label", "Title")
_SPELLED = (
    (re.compile(r"(?i)newtons?"), "N"),
    (re.compile(r"(?i)hertz"), "Hz"),
    (re.compile(r"g's|gs|gn|G"), "g"),
    (re.compile(r"(?i)sec(?:onds?)?|sek"), "s"),
    (re.compile(r"(?i)degrees?|grad|°"), "deg"),
    (re.compile(r"m/s(?:ec)?(?:\^2|²|\*\*2|/s)|m ?[.·*]? ?s(?:\^-?|-|⁻)(?:2|²)|meters?/sec\^?2"), "m/s^2"),
    (re.compile(r"m ?[.·*]? ?s(?:\^-|-|⁻)(?:1|¹)"), "m/s"),
)
"""Units as programs spell them, and as a case does."""


def plain_unit(unit: str) -> str:
    """Spell a unit as a case does where a program spells it otherwise.

    Examples
    --------
    >>> [plain_unit(unit) for unit in ("Newtons", "g's", "m/sec^2", "m·s⁻²", "mm")]
    ['N', 'g', 'm/s^2', 'm/s^2', 'mm']
    """
    text = unit.strip()
    return next((plain for pattern, plain in _SPELLED if pattern.fullmatch(text)), unit)


def unit_within(title: str) -> str:
    """Return the unit in brackets amid a title, or as its last word; "" where there is none.

    Examples
    --------
    >>> unit_within("Acc1 (g) Mag"), unit_within("Force N"), unit_within("H (f) real"), unit_within("g")
    ('g', 'N', '', '')
    """
    found = [match[1] for pattern in (_WITHIN, _LAST) for match in pattern.finditer(title)]
    return next((unit for unit in found if is_unit(unit) and unit not in _NO_UNIT), "")


def without_unit(title: str) -> str:
    """Remove the unit that ``unit_within`` returns.

    Examples
    --------
    >>> without_unit("Acc1 (g) Mag"), without_unit("Force N")
    ('Acc1 Mag', 'Force')
    """
    unit = unit_within(title)
    bracketed = _WITHIN.sub(lambda match: "" if match[1] == unit else match[0], title)
    return bracketed if bracketed != title or not unit else title[: -len(unit)].rstrip()


def unit_beside(path: str, texts: Mapping[str, str]) -> str:
    """Return the unit of an array from a text of the file, or "".

    The unit of "test/f" is in "test/f_unit", "test/units/f" or "test/f/units"; that of "sensor/data" in
    "sensor/units"; that of "y_values/values" in "y_values/quantity/label"; and that of "Channel_1_Data" in
    "Channel_1_Header/Unit".

    Examples
    --------
    >>> unit_beside("run/1/F", {"units/F": "kN"}), unit_beside("laser/data", {"laser/unit": "mm"})
    ('kN', 'mm')
    """
    found = next((texts[place] for place in _unit_places(path) if place in texts), "")
    return found.strip().strip("[]()")


def _unit_places(path: str) -> Iterator[str]:
    *parents, name = path.split("/")
    for depth in range(len(parents), -1, -1):
        before = "".join(f"{part}/" for part in parents[:depth])
        for word in _UNITS:
            yield from (f"{before}{name}_{word}", f"{before}{word}/{name}", f"{before}{word}_{name}")
            if depth == len(parents):
                yield f"{path}/{word}"
                yield f"{before}{_header(name)}/{word}"
                if name.casefold() in _VALUES:
                    yield f"{before}{word}"
    if name.casefold() in _VALUES:
        yield "/".join([*parents, "quantity", "label"])


def _header(name: str) -> str:
    """Name the struct that describes an array: "Channel_1_Header" of "Channel_1_Data"."""
    return re.sub(r"(?i)data\Z", "Header", name)


def name_beside(path: str, texts: Mapping[str, str]) -> str:
    """Return the name of a channel from a text of the file, or "".

    Examples
    --------
    >>> name_beside("Channel_1_Data", {"Channel_1_Header/SignalName": "Force"})
    'Force'
    >>> name_beside("Signal_0/y_values/values", {"Signal_0/function_record/name": "Wing +Z"})
    'Wing +Z'
    """
    *parents, name = path.split("/")
    folders = [f"{'/'.join([*parents, _header(name)])}"] if _header(name) != name else []
    if name.casefold() in _VALUES and parents:
        folders += ["/".join(parents), "/".join([*parents[:-1], "function_record"])]
    places = [f"{folder}/{word}" for folder in folders for word in _NAMES]
    return next((texts[place].strip() for place in places if texts.get(place, "").strip()), "")
