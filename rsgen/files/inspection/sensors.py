"""Group the columns of a table into channels: levels side by side, harmonics, parts of a number, phases.

Columns belong together by the words of their titles, never by their order alone where a title says otherwise.
"""

from __future__ import annotations

import re
import unicodedata
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from rsgen.files.column_titles import VOLTAGES, split_title, unit_in
from rsgen.files.inspection.clues import TODO, is_phase, is_real, last_name, split_within
from rsgen.files.tree import Entry, natural_order


@dataclass(frozen=True, slots=True)
class Sensor:
    """The columns of one channel.

    Parameters
    ----------
    main
        What is asked for clues: the amplitude, the complex column, the samples, or the real part under the
        name that both parts have in common.
    places
        Keys of a case and their columns: ("amplitude", ...), ("phase", ...).
    doubt
        Why it is not sure that they belong together; "" where their names say so.
    """

    main: Entry
    places: tuple[tuple[str, Entry], ...]
    doubt: str = ""

    @property
    def has_phase(self) -> bool:
        """True if its phase is known."""
        return len(self.places) > 1 or self.places[0][0] == "complex"

    def with_phase(self, phase: Entry, doubt: str = "") -> Sensor:
        """Return the channel with the column of its phase."""
        return replace(self, places=(*self.places, ("phase", phase)), doubt=doubt)


# ----------------------------------------------------------------------------
# The words of a title that say which channel a column is of.

_TOKEN = re.compile(r"[A-ZÄÖÜ]?[a-zäöüßéèçµφϕ]+|[A-ZÄÖÜ]+(?![a-z])|\d+")
"""Words of a title: "accTip_1" has acc, tip, 1."""
_OF_NO_CHANNEL = re.compile(
    r"phas(?:e|en|enwinkel)?|phs|pha|phi|φ|ϕ|lag|lead|arg|ang(?:le)?|winkel|deg(?:rees?)?|rad"
    r"|ampl?(?:itude)?|mag(?:nitude)?|abs|betrag|value|wert|peak|pk|rms|eff|of|von|the|in|signal"
    r"|re(?:al)?|im(?:ag)?(?:inary)?|part|teil"
)
"""Words that do not say which channel a column is of."""


def words_of(entry: Entry) -> tuple[str, ...]:
    """Return the words of a title that identify a channel, without those of amplitude, phase and unit.

    Examples
    --------
    >>> words_of(Entry("Tip Amplitude [g]", title="Tip Amplitude [g]")), words_of(Entry("phase_x1_deg"))
    (('tip',), ('x', '1'))
    """
    title = last_name(entry)
    name, unit = split_title(title)
    words = [word.casefold() for word in _TOKEN.findall(split_within(name)[0])]
    # a unit without brackets is a part of the name: "force_N"
    behind = [word.casefold() for word in _TOKEN.findall(unit)] if name == title else []
    if behind and words[-len(behind) :] == behind:
        words = words[: -len(behind)]
    return tuple(word for word in words if not _OF_NO_CHANNEL.fullmatch(word))


_MAX_NAME_LENGTH = 30
"""Characters of a channel's name; the case allows 40, and sums of them should fit a line."""


def channel_names(sensors: Sequence[Sensor]) -> list[str]:
    """Return a name of each channel, valid in a sum: made of its words, distinguished by numbers."""
    names: list[str] = []
    for number, sensor in enumerate(sensors, start=1):
        text = re.sub(r"(?<=[^\W\d_])_(?=\d)", "", "_".join(words_of(sensor.main)))
        plain = unicodedata.normalize("NFKD", text.replace("ß", "ss")).encode("ascii", "ignore").decode()
        name = plain[:_MAX_NAME_LENGTH].strip("_")
        if not name or name[0].isdigit():
            name = f"channel_{name or number}"
        while name in names:
            name = f"{name}_{number}"
        names.append(name)
    return names


# ----------------------------------------------------------------------------
# Levels that stand side by side: columns "x@1N", "x@2N", or variables "phase_1N", "phase_2N".

_LEVEL = re.compile(
    r"(?:(?<![A-Za-z])(?:F|force|level|Kraft|Stufe)\s?[=: ]\s?)?"
    r"(?<![\d.,])(\d{1,9}(?:[.,]\d{1,9})?)[\s_]?([munk]?N|lbf)(?![A-Za-z])"
)
"""The amount of a force in a name. A number without one may as well be that of a sensor."""


def split_level(text: str) -> tuple[str, str]:
    """Split a text into what it says and the amount of a force, as a case writes it; "" where there is none.

    Examples
    --------
    >>> split_level("receptance, 2,5 N, up"), split_level("BEAM 2 +Z")
    (('receptance, up', '2.5 N'), ('BEAM 2 +Z', ''))
    """
    found = _LEVEL.search(text)
    if not found:
        return text, ""
    rest = f"{text[: found.start()]}{text[found.end() :]}".replace(", ,", ",")
    return rest.strip(" ,_@-"), f"{found[1].replace(',', '.')} {found[2]}"


def levels_in_columns(entries: Sequence[Entry], *, tree: bool = False) -> tuple[list[Entry], list[str]]:
    """Put columns that differ in the amount of a force alone under one address with a *.

    Parameters
    ----------
    entries
        Of a file.
    tree
        Whether its reader sorts what a * means, as of all formats but text, whose columns keep their order.

    Returns
    -------
    The entries, of each family the first under the address of all; and the levels in their order, as a case
    writes them; none where there are no such columns.

    Examples
    --------
    >>> columns = [Entry("f"), Entry("x@1N [mm]"), Entry("x@2,5N [mm]")]
    >>> found, levels = levels_in_columns(columns)
    >>> [entry.path for entry in found], found[1].unit, levels
    (['f', 'x@*N [mm]'], 'mm', ['1 N', '2.5 N'])
    """
    families: dict[str, list[Entry]] = defaultdict(list)
    for entry in entries:
        found = _LEVEL.search(entry.path)
        # a column that goes by its number has no name for a * to stand in; a sheet has
        if found and (found.end() <= entry.path.rfind("/") or entry.title in ("", entry.path)):
            families[f"{entry.path[: found.start(1)]}*{entry.path[found.end(1) :]}"].append(entry)
    of: dict[str, tuple[str, ...]] = {}
    for address, members in families.items():
        ordered = sorted(members, key=lambda one: natural_order(one.path)) if tree else members
        levels = tuple(split_level(one.path)[1] for one in ordered)
        if len(set(levels)) == len(levels) > 1:
            of[address] = levels
    shared = max(of.values(), key=[*of.values()].count, default=())
    kept = {id(entry): entry for entry in entries}
    for address in (address for address, levels in of.items() if levels == shared):
        head, *others = families[address]
        kept[id(head)] = _joined(address, head)
        for entry in others:
            del kept[id(entry)]
    return [*kept.values()], list(shared)


def _joined(address: str, entry: Entry) -> Entry:
    """Put a family under one address; its name and its unit are those without the level."""
    if entry.title not in ("", entry.path):
        return replace(entry, path=address)
    name, unit = split_title(_LEVEL.sub("", entry.path))
    unit = unit or (entry.unit if entry.unit != unit_in(entry.path) else "")
    name = name.strip(" _@-,") or entry.path
    return replace(entry, path=address, title=f"{name} [{unit}]" if unit else name, unit=unit)


# ----------------------------------------------------------------------------
# Higher harmonics, real and imaginary parts, and phases.

_HARMONIC = re.compile(
    r"(?<![A-Za-z\d])(?:h|harm(?:onic|onische)?\.?|ord(?:er|nung)\.?)[ _-]?(?P<behind>\d{1,2})(?![\d.])"
    r"|(?<![A-Za-z\d.,])(?P<before>\d{1,2})(?:st|nd|rd|th|\.)?[ _*-]?"
    r"(?:harm\w*|ord(?:er|nung)|omega|ω|w|f|x|h)(?![A-Za-z\d])",
    re.IGNORECASE,
)
"""The order of a harmonic in a title: "x H3", "F 3f", "3rd harmonic"; or the kind of an estimate, "H2"."""


def higher_harmonics(entries: Sequence[Entry]) -> list[Entry]:
    """Return the columns of higher harmonics, where the fundamental has a column of the same title."""
    orders: dict[str, dict[int, list[Entry]]] = defaultdict(lambda: defaultdict(list))
    for entry in entries:
        title = last_name(entry)
        if found := _HARMONIC.search(title):
            order = int(found["behind"] or found["before"])
            orders[title[: found.start()] + title[found.end() :]][order].append(entry)
    of_fundamental = [of for of in orders.values() if 1 in of]
    return [entry for of in of_fundamental for order, alike in of.items() if order > 1 for entry in alike]


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
_LOCK_IN = f"{TODO}X and Y are taken for a lock-in amplifier, not for two directions"


def complex_parts(entries: Sequence[Entry]) -> Iterator[Sensor]:
    """Find real and imaginary parts that belong together, by their names: "H" of "Re(H)" and "Im(H)"."""
    used: set[int] = set()
    for real, imaginary in _PARTS:
        lock_in = (real, imaginary) == _PARTS[-1]
        # X and Y in another unit than a lock-in amplifier has are directions
        left = [e for e in entries if id(e) not in used and not (lock_in and e.unit not in ("", *VOLTAGES))]
        # of equal names in their order; thousands of columns are gone through once
        partners: dict[tuple[int, str, str], list[Entry]] = defaultdict(list)
        for entry in reversed(left):
            if imaginary.search(name := last_name(entry)):
                partners[entry.size, entry.unit, imaginary.sub("*", name)].append(entry)
        for entry in left:
            name = last_name(entry)
            alike = partners.get((entry.size, entry.unit, real.sub("*", name)), [])
            if id(entry) in used or not real.search(name) or not alike or alike[-1] is entry:
                continue
            second = alike.pop()
            used |= {id(entry), id(second)}
            common = name if lock_in else real.sub("", name).strip(" _-.:()[]{}") or name
            places = (("real", entry), ("imaginary", second))
            yield Sensor(replace(entry, title=common), places, _LOCK_IN * lock_in)


_MAX_COMPARED = 100
"""Phases and amplitudes that are compared word by word; of thousands only equal words count."""


def find_sensors(columns: Sequence[Entry]) -> tuple[list[Sensor], list[Entry]]:
    """Put the columns of each channel together; return the phases that no title gives to one, too.

    Parameters
    ----------
    columns
        Of a table in the order of the file, without frequency and level.
    """
    place = {id(entry): number for number, entry in enumerate(columns)}
    parts = list(complex_parts([entry for entry in columns if is_real(entry)]))
    found = {place[id(sensor.places[0][1])]: sensor for sensor in parts}
    used = {id(column) for sensor in parts for _, column in sensor.places}
    phases = [entry for entry in columns if id(entry) not in used and is_real(entry) and is_phase(entry)]
    used |= set(map(id, phases))
    for entry in columns:
        if id(entry) not in used:
            found[place[id(entry)]] = Sensor(entry, (("amplitude" if is_real(entry) else "complex", entry),))
    loose = _pair_phases(found, phases)
    return [found[number] for number in sorted(found)], loose


def _pair_phases(found: dict[int, Sensor], phases: Sequence[Entry]) -> list[Entry]:
    """Pair each amplitude with the phase of its words, else of all of its words; return the other phases."""
    words = {number: words_of(sensor.main) for number, sensor in found.items() if not sensor.has_phase}
    alike: dict[tuple[str, ...], list[int]] = defaultdict(list)
    for number in sorted(words, reverse=True):
        alike[tuple(sorted(words[number]))].append(number)
    others = []
    for phase in phases:
        equal = alike[tuple(sorted(named))] if (named := words_of(phase)) else []
        if equal:
            number = equal.pop()
            found[number] = found[number].with_phase(phase)
        else:
            others.append(phase)
    loose = others[_MAX_COMPARED:]
    for phase in others[:_MAX_COMPARED]:
        said = set(words_of(phase))
        silent = [number for number in words if not found[number].has_phase][:_MAX_COMPARED]
        near = [n for n in silent if said and words[n] and (said <= set(words[n]) or said >= set(words[n]))]
        if len(near) == 1:
            found[near[0]] = found[near[0]].with_phase(phase)
        else:
            loose.append(phase)
    return loose


def is_of_another(phase: Entry, main: Entry) -> bool:
    """Return True if the title of a phase names another channel: "phase x2" is not of "x1"."""
    one, two = set(words_of(phase)), set(words_of(main))
    if one <= two or two <= one:
        return False
    numbers = [{word for word in words if word.isdigit()} for words in (one, two)]
    return bool(one & two) or (all(numbers) and numbers[0] != numbers[1])
