"""Texts beside an array: unit and name of a channel where a program keeps them apart from its numbers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rsgen.files.column_titles import is_unit
from rsgen.files.inspection.clues import (
    SPREAD,
    USABLE,
    VALUES,
    Clue,
    last_name,
    unit_in,
)
from rsgen.files.tree import TEXT, Contents, Entry

__all__ = [
    "Guess",
    "name_beside",
    "plain_unit",
    "run_of",
    "siblings_of",
    "unit_beside",
    "unit_within",
    "without_unit",
]


# ----------------------------------------------------------------------------
# What is left of a file's arrays while a case is guessed, and what was taken from them.


class Guess:
    """The entries that are left, and what was taken from them."""

    def __init__(self, contents: Contents) -> None:
        self.contents = contents
        readable = (e for e in contents.entries if e.dtype and not e.fault and e.size)
        texts = {e.path: e.remark for e in contents.entries if e.dtype == TEXT}
        usable = [_completed(e, texts) for e in readable]
        self.free = [e for e in usable if not SPREAD(e) and (e.size == 1 or USABLE(e))]
        self.levels: list[str] = []
        self.nameless = contents.format == "csv" and all(e.path.isdigit() and not e.remark for e in usable)
        self.unnamed = Clue(lambda _: self.nameless)
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
        """Give an array's address in a case."""
        if self.run:
            run, star = self.run
            if entry.path.startswith(run):
                return star + entry.path.removeprefix(run)
        sides = [length for length in entry.shape if length > 1]
        if len(sides) > 1 and self.tables["test"].get("excitation"):
            return f"{entry.path}[1]"
        return int(entry.path) if self.contents.format == "csv" and entry.path.isdigit() else entry.path


def _completed(entry: Entry, texts: Mapping[str, str]) -> Entry:
    """Give an entry its unit, spelled as a case does, and its name from the texts beside it."""
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


# ----------------------------------------------------------------------------
# Files beside a data file whose names differ from its own in one number: other levels of a test, perhaps.

_NUMBER = re.compile(r"\d+(?:[.,]\d+)?")
_FORCE_BEHIND = re.compile(r"[ _-]?(?:[munk]?N|lbf)(?![A-Za-z])")
_LEVEL_BEFORE = re.compile(r"(?:level|stufe|force|kraft|amp|lvl|F)[ _-]?\Z", re.IGNORECASE)
_MOST = 200
"""Files of one case, at most; of more nobody would want one."""
_LOOKED_AT = 5_000
"""Names in a folder that are looked at."""
_NAMED = 3
"""Of the others in the comment."""


def _places(name: str) -> list[re.Match[str]]:
    """Give the numbers in a name, those that may be a level first."""

    def rank(found: re.Match[str]) -> tuple[bool, bool, int]:
        behind = _FORCE_BEHIND.match(name, found.end())
        return not behind, not _LEVEL_BEFORE.search(name[: found.start()]), -found.start()

    return sorted(_NUMBER.finditer(name), key=rank)


def siblings_of(file: Path) -> str:
    """Say which files beside a file differ from it in one number, and how a case reads all; else ""."""
    stem = file.stem
    try:
        names = [other.name for _, other in zip(range(_LOOKED_AT), file.parent.iterdir(), strict=False)]
    except OSError:
        return ""
    for found in _places(stem):
        before, after = stem[: found.start()], stem[found.end() :] + file.suffix
        alike = re.compile(f"{re.escape(before)}{_NUMBER.pattern}{re.escape(after)}")
        others = sorted(name for name in names if alike.fullmatch(name) and name != file.name)
        if others and len(others) < _MOST:
            shown = ", ".join(others[:_NAMED]) + ", ..." * (len(others) > _NAMED)
            unit = "" if _FORCE_BEHIND.match(stem, found.end()) else ', unit = "label"'
            return (
                f"also here: {shown}; levels of one test are read together by file = [...] and "
                f'[test.level] name = "{before}{{level}}{after}"{unit}'
            )
    return ""


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
