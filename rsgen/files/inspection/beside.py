"""Texts beside an array: unit and name of a channel where a program keeps them apart from its numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from rsgen.files.column_titles import is_unit
from rsgen.files.inspection.clues import VALUES

__all__ = ["name_beside", "plain_unit", "unit_beside", "unit_within", "without_unit"]

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
    """Give the unit in brackets amid a title, or as its last word; "" where there is none.

    Examples
    --------
    >>> unit_within("Acc1 (g) Mag"), unit_within("Force N"), unit_within("H (f) real"), unit_within("g")
    ('g', 'N', '', '')
    """
    found = [match[1] for pattern in (_WITHIN, _LAST) for match in pattern.finditer(title)]
    return next((unit for unit in found if is_unit(unit) and unit not in _NO_UNIT), "")


def without_unit(title: str) -> str:
    """Take off the unit that ``unit_within`` gives.

    Examples
    --------
    >>> without_unit("Acc1 (g) Mag"), without_unit("Force N")
    ('Acc1 Mag', 'Force')
    """
    unit = unit_within(title)
    bracketed = _WITHIN.sub(lambda match: "" if match[1] == unit else match[0], title)
    return bracketed if bracketed != title or not unit else title[: -len(unit)].rstrip()


def unit_beside(path: str, texts: Mapping[str, str]) -> str:
    """Give the unit of an array that a text beside it names, or "".

    Beside "test/f" these are "test/f_unit", "test/units/f" and, in its own struct, "test/f/units"; beside
    "sensor/data" it is "sensor/units"; beside "y_values/values" "y_values/quantity/label", beside
    "Channel_1_Data" "Channel_1_Header/Unit".

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
                if name.casefold() in VALUES:
                    yield f"{before}{word}"
    if name.casefold() in VALUES:
        yield "/".join([*parents, "quantity", "label"])


def _header(name: str) -> str:
    """Name the struct that describes an array: "Channel_1_Header" of "Channel_1_Data"."""
    return re.sub(r"(?i)data\Z", "Header", name)


def name_beside(path: str, texts: Mapping[str, str]) -> str:
    """Give the name of a channel that a text beside its numbers says, or "".

    Examples
    --------
    >>> name_beside("Channel_1_Data", {"Channel_1_Header/SignalName": "Force"})
    'Force'
    >>> name_beside("Signal_0/y_values/values", {"Signal_0/function_record/name": "Wing +Z"})
    'Wing +Z'
    """
    *parents, name = path.split("/")
    folders = [f"{'/'.join([*parents, _header(name)])}"] if _header(name) != name else []
    if name.casefold() in VALUES and parents:
        folders += ["/".join(parents), "/".join([*parents[:-1], "function_record"])]
    places = [f"{folder}/{word}" for folder in folders for word in _NAMES]
    return next((texts[place].strip() for place in places if texts.get(place, "").strip()), "")
