"""Say what the arrays of a data file are by their names, units, sizes and texts about them, not by values."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

from rsgen.data.record_set import QUANTITIES
from rsgen.files.column_titles import VOLTAGES, is_angular, is_unit, split_title, unit_in
from rsgen.files.tree import TEXT, Contents, Entry, natural_order
from rsgen.formula.units import sensor_size

TODO = "TODO: "
"""How a comment begins that asks for what no name or unit in the file says."""
OVER_FORCE = {"displacement": "receptance", "velocity": "mobility", "acceleration": "accelerance"}
"""Responses over force, in the words of ISO 7626-1."""
_VALUES = ("data", "value", "values")
"""Last names of paths that say nothing."""
NAMES = {
    "inertance": "acceleration", "acc": "acceleration", "vel": "velocity", "mobility": "velocity",
    "disp": "displacement", "beschl": "acceleration", "geschw": "velocity", "vitesse": "velocity",
    " a ": "acceleration", " v ": "velocity",
}  # fmt: skip
"""Quantities by what stands in a name."""

Clue = Callable[[Entry], bool]
"""A condition on an array."""


def first(entries: Sequence[Entry], *clues: Clue) -> Entry | None:
    """Return the first entry for which the first clue that holds for any holds."""
    return next((entry for clue in clues for entry in entries if clue(entry)), None)


def last_name(entry: Entry) -> str:
    """Return the title of a column without its unit, else the last part of a path with a meaning.

    The name of "x/X1__V_/data" is X1__V_, that of the channel "acc[2]" is acc 2.
    """
    if entry.title:
        return split_title(entry.title)[0] or entry.title
    parts = [part for part in entry.path.split("/") if part.casefold() not in _VALUES]
    return re.sub(r"\[(\d+)\]\Z", r" \1", parts[-1]) if parts else entry.path


def called(entry: Entry) -> str:
    """Return the title of a column, else its path."""
    return entry.title or entry.path


def _named(pattern: str) -> Clue:
    search = re.compile(pattern, re.IGNORECASE).search
    return lambda entry: bool(search(last_name(entry)))


FREQUENCY = _named(r"freq|fréq|hertz|omega|^(?-i:f)(_|$|\d)|(^|[_ ])hz(_|$)|rpm|drehzahl")
"""A capital F alone is a force."""
TIME = _named(r"^t(_|$)|time|zeit|instant|^x_value$")
"""The last is LabVIEW's."""
FORCE = _named(r"forc|kraft|load(?!_cycle)")
DRIVE = _named(r"excit|drive|shaker|^u(_|$)|input|^f(_|$|\d)|volt")
RESPONSE = _named(
    r"acc|vel|disp|resp|receptance|mobility|frf|strain|laser|output|^\W?[xyzva](_|\W|$|\d)|^h(_|$|\d)"
    r"|beschl|geschw|(^|[ _])weg|auslenk|schwing|vitesse|dépl|depl"
)
LEVEL = _named(r"level|drive|^amplitude")
NOMINAL = _named(r"level|stufe|nominal|soll|set_?point")
BASE = _named(
    r"(^|[^a-z])(base|table|tisch|ground|floor|boden|found(ation)?|fundament|fu(ß|ss)punkt|support|slip"
    r"|fixture|armature|aufspann\w*|shaker|exciter|seat ?rail|ctrl|control|regel)"
)
"""Where a structure on a driven base is fixed, or what a shaker's controller holds."""
RELATIVE = _named("relativ")
"""A motion that was measured against the base."""
RATE = _named(
    r"^f_?s$|^(?!.*(sweep|strain|flow)).*((?<![a-z])rate(?!d)|(?-i:[a-z]Rate)|samplerate|abtast)|fsamp|sampl(e|ing)_?freq"
)
INCREMENT = _named(r"^(dt|delta_?[xt]|increment|ts|x_?increment|sampl(e|ing)_?(time|interval|period))$")
"""The time from one sample to the next."""
_ANGLE_UNITS = ("deg", "°", "rad", "degree", "degrees")
_PHASE_NAMED = _named(r"phas|phs|phi|φ|(^|[_ ])(lag|ang)(?![a-z])|(?<![a-z])arg|angle|winkel|deg")
_SPREAD = _named(
    r"std|sigma|var|error|coheren|kohären|temperature|number|(?<![a-z])(coh|temp|humidity|averages|date|rpm_set)(?![a-z])"
)
QUOTIENT = _named(
    r"receptance|mobility|accelerance|inertance|compliance|frf|^h(_|$|\d|\()|/\s?f\Z"
    r"|(frequency|freq\.?) response|transfer function|frequenzgang|übertragungsfunktion"
)
DECIBEL = re.compile(r"(?<![a-z\d])db(?![a-z])", re.IGNORECASE)


def is_real(entry: Entry) -> bool:
    """Return True if the numbers are real."""
    return not entry.dtype.startswith("complex")


def is_force(entry: Entry) -> bool:
    """Return True if the unit is that of a force."""
    return bool(entry.unit and unit_for(entry.unit, "N"))


def motion_of(entry: Entry) -> str:
    """Return the SI unit of the displacement, velocity or acceleration, or of one over force, by the unit."""
    targets = (unit + per for per in ("", "/N") for unit in QUANTITIES.values())
    return next((target for target in targets if entry.unit and unit_for(entry.unit, target)), "")


def is_angular_frequency(entry: Entry) -> bool:
    """Return True if the name is that of an angular frequency."""
    return is_angular(called(entry)) or is_angular(last_name(entry))


def is_phase(entry: Entry) -> bool:
    """Return True for a phase; a frequency response with a word for angles in its name is none."""
    quotient = QUOTIENT(entry) and entry.unit.endswith("/N")
    return not quotient and (_PHASE_NAMED(entry) or entry.unit in _ANGLE_UNITS)


def phase_sense(phase: Entry) -> str:
    """Return "lag" or "lead" where the name of a phase says so: later or earlier; "" elsewhere."""
    name = last_name(phase).casefold()
    return next((sense for sense in ("lag", "lead") if sense in name), "")


def unit_for(unit: str, target: str) -> str | None:
    """Return a unit as a case spells it; None if its dimension is not that of the target."""
    name = unit.strip().replace("²", "^2").replace("µ", "u")
    name = "thou" if name in ("mil", "mils") else name
    return None if sensor_size(name, target) is None else name


# ----------------------------------------------------------------------------
# Units and names of arrays, from their titles and from texts in the file.


def readable(contents: Contents) -> list[Entry]:
    """Return the arrays that a test may need, each with the name and the unit that the file has for it.

    Left out are empty ones, zeros, and by their names deviations, coherences and conditions of a test.
    """
    texts = {entry.path: entry.remark for entry in contents.entries if entry.dtype == TEXT}
    found = []
    for entry in contents.entries:
        empty = entry.size > 1 and is_real(entry) and (entry.low is None or entry.low == entry.high == 0)
        if entry.dtype and not entry.fault and entry.size and not empty:
            named = entry if entry.title else replace(entry, title=name_beside(entry.path, texts))
            name = last_name(named)
            unit = named.unit or unit_beside(entry.path, texts) or unit_in(name) or split_within(name)[1]
            if not unit and (unit := _acceleration_for_all(named, texts)):
                named = replace(named, unit_source=FOR_ALL)
            found.append(replace(named, unit=plain_unit(unit)))
    return [entry for entry in _with_listed_names(found, contents) if not _SPREAD(entry)]


def _acceleration_for_all(entry: Entry, texts: Mapping[str, str]) -> str:
    """Return the unit of acceleration that a text "unit" has for no channel in particular, or "".

    It is that of a record whose name is of no force, time or other motion.
    """
    said = next((plain_unit(texts[word].strip("[]() ")) for word in _UNITS if word in texts), "")
    name = last_name(entry).casefold()
    others = {kind for word, kind in NAMES.items() if word in name} - {"acceleration"}
    other = others or is_phase(entry) or any(of(entry) for of in (TIME, FREQUENCY, FORCE, LEVEL, RATE))
    record = is_real(entry) and max(entry.shape, default=1) == entry.size > 1
    return said if record and not other and said and unit_for(said, "m/s^2") else ""


_WITHIN = re.compile(r"\s?[\[(]\s*([^()\[\]]{1,12}?)\s*[\])](?=\s)")
"""A unit in brackets amid a title: "Force (N) Mag"."""
_LAST = re.compile(r"(?<=\S)\s+(\S{1,12})\Z")
"""A unit as the last word of a title: "Acceleration g"."""
_NO_UNIT = ("", "-", "1", "%")
"""Texts that stand in a row of units and say nothing at the end of a title."""

FOR_ALL = "by a text of the file that names no channel"
"""The source of such a unit."""
_UNITS = ("unit", "units", "Unit", "Units")
_NAMES = ("name", "Name", "SignalName", "ChannelName", "channel_name", "label", "Label", "Title")
_SPELLINGS = (
    (re.compile(r"(?i)newtons?"), "N"),
    (re.compile(r"(?i)hertz"), "Hz"),
    (re.compile(r"g's|gs|gn|G"), "g"),
    (re.compile(r"(?i)sec(?:onds?)?|sek"), "s"),
    (re.compile(r"(?i)degrees?|grad|°"), "deg"),
    (re.compile(r"m/s(?:ec)?(?:\^2|²|\*\*2|/s)|m ?[.·*]? ?s(?:\^-?|-|⁻)(?:2|²)|meters?/sec\^?2"), "m/s^2"),
    (re.compile(r"m ?[.·*]? ?s(?:\^-|-|⁻)(?:1|¹)"), "m/s"),
)
"""Units as programs spell them, and as a case does."""


_OF_UNITS = re.compile(r"(?i)unit|einheit")
_OF_CHANNELS = re.compile(r"(?i)chan|kanal|signal|sensor|name|label")


def channels_of(entry: Entry, contents: Contents) -> list[Entry]:
    """Return the channels of an array: itself or, of a matrix, its rows along the longer side.

    Each has the name and the unit that a text of the file lists for it.
    """
    sides = [length for length in entry.shape if length > 1]
    if len(sides) < 2:
        return [entry]
    count = min(sides)
    names, units = _listed(entry.path, count, contents)
    pairs = zip(names or [entry.title] * count, units or [entry.unit] * count, strict=True)
    return [
        replace(entry, path=f"{entry.path}[{n}]", shape=(max(sides),), title=name, unit=unit)
        for n, (name, unit) in enumerate(pairs, start=1)
    ]


def _listed(path: str, count: int, contents: Contents) -> tuple[list[str], list[str]]:
    """Return names and units that texts next to ``path`` list for ``count`` channels; [] where none does.

    As "force, acceleration" and "N, g"; "V" may stand for the outputs of all sensors.
    """
    names: list[str] = []
    units: list[str] = []
    for text in (one for one in contents.entries if one.dtype == TEXT):
        parts = [plain_unit(part.strip()) for part in re.split("[,;|]", text.remark)]
        folder, slash, _ = text.path.rpartition("/")
        if not path.startswith(folder + slash):
            continue
        if _OF_UNITS.search(last_name(text)):
            parts = parts * count if len(parts) == 1 and parts[0] in VOLTAGES else parts
            units = parts if len(parts) == count else units
        elif len(parts) == count and _OF_CHANNELS.search(last_name(text)):
            names = parts
    return names, units


def _with_listed_names(found: list[Entry], contents: Contents) -> list[Entry]:
    """Put the names and units that texts list to the columns of a matrix, or to arrays ch1, ch2, ..."""
    columns: list[Entry] = []
    of: dict[str, Entry] = {}
    families: dict[tuple[str, int], list[Entry]] = defaultdict(list)
    for entry in found:
        channels = channels_of(entry, contents)
        # an array that says what it holds has levels or runs in its columns
        own = FORCE(entry) or RESPONSE(entry)
        listed = len(channels) > 1 and not own and _listed(entry.path, len(channels), contents)[0]
        columns += channels if listed else [entry]
        if len(channels) == 1 < entry.size and not (entry.title or own) and entry.path[-1:].isdecimal():
            families[entry.path.rpartition("/")[0], entry.size].append(entry)
    for family in families.values():
        family.sort(key=lambda entry: natural_order(entry.path))
        names, units = _listed(family[0].path, len(family), contents)
        if not names or len({entry.path.rstrip("0123456789") for entry in family}) > 1:
            continue
        for entry, name, unit in zip(family, names, units or [""] * len(names), strict=True):
            of[entry.path] = replace(entry, title=name, unit=entry.unit or unit)
    return [of.get(entry.path, entry) for entry in columns]


def plain_unit(unit: str) -> str:
    """Spell a unit as a case does where a program spells it otherwise.

    Examples
    --------
    >>> [plain_unit(unit) for unit in ("Newtons", "g's", "m/sec^2", "m·s⁻²", "mm")]
    ['N', 'g', 'm/s^2', 'm/s^2', 'mm']
    """
    text = unit.strip()
    return next((plain for pattern, plain in _SPELLINGS if pattern.fullmatch(text)), unit)


def split_within(title: str) -> tuple[str, str]:
    """Split a title into its name and the unit in brackets amid it, or as its last word; "" for none.

    Examples
    --------
    >>> split_within("Acc1 (g) Mag"), split_within("Force N"), split_within("H (f) real"), split_within("g")
    (('Acc1 Mag', 'g'), ('Force', 'N'), ('H (f) real', ''), ('g', ''))
    """
    for match in (match for pattern in (_WITHIN, _LAST) for match in pattern.finditer(title)):
        if is_unit(match[1]) and match[1] not in _NO_UNIT:
            return title[: match.start()] + title[match.end() :], match[1]
    return title, ""


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
