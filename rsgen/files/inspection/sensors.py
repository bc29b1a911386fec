"""Group the columns of a table into channels, and write motions, forces and a base into the draft of a case.

Columns belong together by the words of their titles, never by their order alone where a title says otherwise.
"""

from __future__ import annotations

import re
import unicodedata
from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import groupby
from typing import Any

from rsgen.common.errors import listed
from rsgen.data.record_set import QUANTITIES
from rsgen.files.column_titles import split_title
from rsgen.files.inspection.clues import (
    BASE,
    CONTROL,
    DECIBEL,
    FORCE,
    IS_FORCE,
    IS_MOTION,
    NAMES,
    OVER_FORCE,
    PEAK,
    PHASE,
    QUOTIENT,
    REAL,
    RELATIVE,
    RESPONSE,
    RMS,
    TODO,
    Clue,
    Draft,
    complex_parts,
    last_name,
    phase_sense,
    unit_for,
    without_unit,
)
from rsgen.files.tree import Entry

# ----------------------------------------------------------------------------
# A driven base: found by names in a table or record without a force.

_MOTION = IS_MOTION & Clue(lambda entry: not entry.unit.endswith("/N"))


@dataclass(frozen=True, slots=True)
class Base:
    """The motion of a base: its columns, and why it was taken, "" where its name says so."""

    sensor: Sensor
    doubt: str = ""


def find_base(sensors: Sequence[Sensor]) -> Base | None:
    """Find the motion of the base by the names of channels; None where there is a force, or one motion only.

    Parameters
    ----------
    sensors
        Channels of a table, or of a record with one column each.
    """
    if any(IS_FORCE(s.main) or (FORCE(s.main) and not _MOTION(s.main)) for s in sensors):
        return None
    named = [s for s in sensors if BASE(s.main) and (_MOTION(s.main) or not s.main.unit)]
    motions = [
        s for s in sensors if _MOTION(s.main) or (not s.main.unit and (RESPONSE(s.main) or s in named))
    ]
    if len(motions) < 2:
        return None
    if len(named) < len(motions) and named:
        others = [s.main.title or s.main.path for s in named[1:]]
        return Base(named[0], f"{TODO}or {', '.join(others)}: the driven direction" if others else "")
    steered = [s for s in motions if CONTROL(s.main)]
    if 0 < len(steered) < len(motions):
        return Base(steered[0], "no force is named, and this name says what was controlled")
    return None


_TOKEN = re.compile(r"[A-ZÄÖÜ]?[a-zäöüßéèçµφϕ]+|[A-ZÄÖÜ]+(?![a-z])|\d+")
"""Words of a title: "accTip_1" has acc, tip, 1."""
_MAX_PAIRS_COMPARED = 100_000
"""Phases times amplitudes that are compared word by word; of thousands only equal words count."""
_OF_PHASE = re.compile(
    r"phas(?:e|en|enwinkel)?|phs|pha|phi|φ|ϕ|lag|lead|arg|ang(?:le)?|winkel|deg(?:rees?)?|rad"
)
_MANNER = re.compile(
    r"ampl?(?:itude)?|mag(?:nitude)?|abs|betrag|value|wert|peak|pk|rms|eff|of|von|the|in|signal"
    r"|re(?:al)?|im(?:ag)?(?:inary)?|part|teil"
)
"""Words that do not say which channel a column is of."""
_UNIT_BEHIND = re.compile(r"[_ ]([A-Za-zµ]{1,4})(?:[/_]s\^?2?)?\Z")
_HARMONIC = re.compile(
    r"(?<![A-Za-z\d])(?:h|harm(?:onic|onische)?\.?|ord(?:er|nung)\.?)[ _-]?(?P<behind>\d{1,2})(?![\d.])"
    r"|(?<![A-Za-z\d.,])(?P<before>\d{1,2})(?:st|nd|rd|th|\.)?[ _*-]?"
    r"(?:harm\w*|ord(?:er|nung)|omega|ω|w|f|x|h)(?![A-Za-z\d])",
    re.IGNORECASE,
)
"""The order of a harmonic in a title: "x H3", "F 3f", "3rd harmonic"."""

_QUOTIENT_UNIT = QUOTIENT & Clue(lambda entry: entry.unit.endswith("/N"))
"""A frequency response with a word for angles in its name is none."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """The columns of one channel.

    Parameters
    ----------
    main
        What is asked for clues: the amplitude, the complex column, or what two parts have in common.
    places
        Keys of a case and their columns: ("amplitude", ...), ("phase", ...).
    doubt
        Why it is not sure that they belong together; "" where their names say so.
    """

    main: Entry
    places: tuple[tuple[str, Entry], ...]
    doubt: str = ""

    @property
    def columns(self) -> tuple[Entry, ...]:
        """All its columns."""
        return tuple(column for _, column in self.places)

    @property
    def has_phase(self) -> bool:
        """True if its phase is known."""
        return len(self.places) > 1 or self.places[0][0] == "complex"


@dataclass(frozen=True, slots=True)
class Sensors:
    """The channels of a table, and the phases that no title gives to one of them."""

    found: tuple[Sensor, ...]
    loose: tuple[Entry, ...]


def words_of(entry: Entry) -> tuple[str, ...]:
    """Return the words of a title that identify a channel, without those of amplitude, phase and unit.

    Examples
    --------
    >>> words_of(Entry("Tip Amplitude [g]", title="Tip Amplitude [g]")), words_of(Entry("phase_x1_deg"))
    (('tip',), ('x', '1'))
    """
    name, unit = split_title(last_name(entry))
    name = without_unit(name)
    behind = _UNIT_BEHIND.search(name)
    if behind and unit.startswith(behind[1]):
        name = name[: behind.start()]
    words = [word.casefold() for word in _TOKEN.findall(name)]
    return tuple(word for word in words if not (_OF_PHASE.fullmatch(word) or _MANNER.fullmatch(word)))


def fundamentals(entries: Sequence[Entry]) -> tuple[list[Entry], dict[int, list[Entry]]]:
    """Separate columns of higher harmonics, and remove the order from the titles of the fundamental.

    Returns
    -------
    The columns without higher harmonics, and those by their order. "H1" alone is a frequency response.
    """
    orders: dict[str, dict[int, Entry]] = defaultdict(dict)
    for entry in entries:
        title = last_name(entry)
        found = _HARMONIC.search(title)
        if found and not entry.unit.endswith("/N"):
            rest = (
                f"{title[: found.start()].rstrip(' _-.,(')} {title[found.end() :].lstrip(' _-.,)')}".strip()
            )
            order = int(found["behind"] or found["before"])
            # "H1_re" is a part of a frequency response
            if order and words_of(replace(entry, title=rest)):
                orders[rest].setdefault(order, entry)
    higher: dict[int, list[Entry]] = defaultdict(list)
    renamed: dict[str, Entry] = {}
    for rest, members in orders.items():
        if 1 in members and len(members) > 1:
            for order, entry in members.items():
                if order == 1:
                    renamed[entry.path] = replace(entry, title=rest)
                else:
                    higher[order].append(entry)
    harmonics = {entry.path for members in higher.values() for entry in members}
    return [renamed.get(e.path, e) for e in entries if e.path not in harmonics], dict(sorted(higher.items()))


def _likeness(phase: Sequence[str], other: Sequence[str]) -> int:
    """Judge whether a phase is of a channel: 3 equal words, 2 one has all words of the other, else 0."""
    one, two = set(phase), set(other)
    if not one or not two:
        return 0
    return 3 if sorted(phase) == sorted(other) else 2 if one <= two or two <= one else 0


def is_of_another(phase: Entry, main: Entry) -> bool:
    """Return True if the title of a phase names another channel: "phase x2" is not of "x1"."""
    one, two = words_of(phase), words_of(main)
    if not one or _likeness(one, two):
        return False
    numbers = [{word for word in words if word.isdigit()} for words in (one, two)]
    return bool(set(one) & set(two)) or (all(numbers) and numbers[0] != numbers[1])


def find_sensors(entries: Sequence[Entry], fits: Clue) -> Sensors:
    """Put the columns of each channel together.

    Parameters
    ----------
    entries
        Columns of a table in the order of the file, without frequency and level.
    fits
        What a column must be to belong to the table.
    """
    columns = [entry for entry in entries if fits(entry)]
    place = {id(entry): number for number, entry in enumerate(columns)}
    real = [entry for entry in columns if REAL(entry)]
    found: dict[int, Sensor] = {}
    used: set[int] = set()
    for common, first, second in complex_parts(real):
        if not {id(first), id(second)} & used:
            used |= {id(first), id(second)}
            parts = (("real", first), ("imaginary", second))
            found[place[id(first)]] = Sensor(common, parts, _lock_in(first, second))
    for entry in columns:
        if not REAL(entry):
            found[place[id(entry)]] = Sensor(entry, (("complex", entry),))
    left = [entry for entry in real if id(entry) not in used]
    phases = [entry for entry in left if PHASE(entry) and not _QUOTIENT_UNIT(entry)]
    amplitudes = [entry for entry in left if not PHASE(entry) or _QUOTIENT_UNIT(entry)]
    of, loose = _partners(phases, amplitudes)
    for entry in amplitudes:
        partner = of.get(id(entry))
        pair = (("amplitude", entry), ("phase", partner[0])) if partner else (("amplitude", entry),)
        found[place[id(entry)]] = Sensor(entry, pair, partner[1] if partner else "")
    by_place, still = _by_place(columns, found, loose)
    return Sensors(tuple(by_place[number] for number in sorted(by_place)), tuple(still))


def _lock_in(first: Entry, second: Entry) -> str:
    """Say so where only X and Y tell a real and an imaginary part: they may be directions of two sensors."""
    named = last_name(first).casefold(), last_name(second).casefold()
    alike = "y" in named[1] and named[0] == named[1].replace("y", "x")
    return f"{TODO}X and Y are taken for a lock-in amplifier, not for two directions" if alike else ""


def _partners(
    phases: Sequence[Entry], amplitudes: Sequence[Entry]
) -> tuple[dict[int, tuple[Entry, str]], list[Entry]]:
    """Find the phase of each amplitude by their words: by the identity of the amplitude, and the others."""
    words = {id(entry): words_of(entry) for entry in (*phases, *amplitudes)}
    alike: dict[tuple[str, ...], deque[Entry]] = defaultdict(deque)
    for entry in amplitudes:
        alike[tuple(sorted(words[id(entry)]))].append(entry)
    of: dict[int, tuple[Entry, str]] = {}
    others: list[Entry] = []
    for phase in phases:
        equal = alike[tuple(sorted(words[id(phase)]))] if words[id(phase)] else None
        if equal:
            of[id(equal.popleft())] = (phase, "")
        else:
            others.append(phase)
    open_ones = [entry for entry in amplitudes if id(entry) not in of]
    if len(others) * len(open_ones) > _MAX_PAIRS_COMPARED:
        return of, others
    loose = []
    for phase in others:
        spoken = words[id(phase)]
        near = [e for e in open_ones if id(e) not in of and _likeness(spoken, words[id(e)])]
        if not near or (len(near) > 1 and set(spoken) < set(words[id(near[1])])):
            loose.append(phase)
            continue
        # "phase x/F" is that of x: its word stands first
        first = min(near, key=lambda e: min(spoken.index(w) for w in words[id(e)] if w in spoken))
        of[id(first)] = (phase, "")
    return of, loose


def _by_place(
    columns: Sequence[Entry], found: dict[int, Sensor], loose: Sequence[Entry]
) -> tuple[dict[int, Sensor], list[Entry]]:
    """Assign several phases without a channel's name to the amplitudes in the columns before them."""
    nameless = [entry for entry in loose if all(word.isdigit() for word in words_of(entry))]
    if len(nameless) < 2:
        return found, list(loose)
    place = {id(column): number for number, column in enumerate(columns)}
    taken: dict[int, Sensor] = {}
    for entry in nameless:
        before = place[id(entry)] - 1
        sensor = found.get(before)
        if sensor is None or sensor.has_phase or before in taken:
            return found, list(loose)
        places = (*sensor.places, ("phase", entry))
        taken[before] = Sensor(sensor.main, places, "the column behind; its title names no channel")
    given = {id(entry) for entry in nameless}
    return found | taken, [entry for entry in loose if id(entry) not in given]


# ----------------------------------------------------------------------------
# The keys of a channel in a case: quantity, unit, scale, columns, the sense of its phase.


def quantity_of(draft: Draft, entry: Entry, table: dict[str, Any], place: str) -> None:
    """Write what a motion is into the ``table`` of the case called ``place``: by its unit, else its name."""
    targets = ((name, si + per) for name, si in QUANTITIES.items() for per in ("", "/N"))
    for name, target in targets:
        known = unit_for(entry.unit, target) if entry.unit else None
        if known:
            table |= {"quantity": name, "unit": known}
            break
    else:
        about = f"{last_name(entry)} {entry.remark}".casefold()
        meanings = (
            meaning for start, meaning in NAMES.items() if start in about or start.strip() == about.strip()
        )
        table["quantity"] = next(meanings, "displacement")
        table["unit"] = QUANTITIES[table["quantity"]]
        draft.doubts[f"{place}.unit"] = (
            f"{TODO}the file says {entry.unit!r}; put it into factor" if entry.unit else unknown(entry)
        )
        if DECIBEL.search(entry.unit) or DECIBEL.search(last_name(entry)):
            # no factor makes a logarithm linear: a case that does not pass is better than a wrong one
            table["unit"] = entry.unit or "dB"
            draft.doubts[f"{place}.unit"] = f"{TODO}decibels are not read: write linear numbers into the file"
    per = bool(known) and target.endswith("/N")
    quotient = QUOTIENT(entry) or "over force" in entry.remark
    if per or quotient or "frequency response" in entry.remark:
        table["unit"] += "" if per else "/N"
        table["per_force"] = True
        draft.doubts[f"{place}.quantity"] = f"{OVER_FORCE[table['quantity']]}, {table['unit']}"
        if "adds damping" in entry.remark:
            draft.doubts[f"{place}.per_force"] = "measured with an exponential window, which adds damping"
    if known and entry.unit_source:
        draft.doubts[f"{place}.unit"] = entry.unit_source
    pattern = str(draft.address(entry))
    alike = (e for e in draft.contents.entries if fnmatchcase(e.path, pattern) and not e.fault)
    units = {other.unit for other in alike}
    if draft.run and len(units) > 1:
        # without the key each entry is read in the unit that the file names for it
        del table["unit"]
        said = draft.doubts.get(f"{place}.quantity", "").partition(",")[0]
        of_file = f"in the units of the file: {', '.join(sorted(units))}"
        draft.doubts[f"{place}.quantity"] = f"{said}, {of_file}" if said else of_file


def unknown(entry: Entry) -> str:
    """Say that a file does not name a unit."""
    return f"{TODO}{entry.unit_source or 'no unit stands with it'}; write the unit"


def unit_of_force(draft: Draft, entry: Entry) -> str:
    """Return the unit to write for a force, with a doubt where the file names none."""
    known = unit_for(entry.unit, "N") if entry.unit else None
    if known is None:
        draft.doubts["test.force.unit"] = (
            f"{TODO}the file says {entry.unit!r}; write unit and factor, as unit = 'V', factor = '10 N/V'"
            if entry.unit
            else unknown(entry)
        )
    elif entry.unit_source:
        draft.doubts["test.force.unit"] = entry.unit_source
    return known or "N"


def scale_of(entry: Entry) -> dict[str, str | float]:
    """Say what amplitudes are where the file or their name does."""
    if entry.scale == "half-peak":
        return {"factor": 2.0}
    named = RMS.search(f"{entry.title or last_name(entry)} {entry.remark}")
    return {"scale": "rms"} if named and entry.scale in ("", "rms") else {}


_SENSE = (
    "no title says it: a positive phase is earlier (lead) or later (lag); rsgen check says which is wrong"
)


def place_of(
    draft: Draft, sensor: Sensor, place: str, sense: str = "", *, per_force: bool = False
) -> dict[str, Any]:
    """Say where the columns of a channel are, what its amplitudes are, and the sense of its phase.

    Parameters
    ----------
    place
        Which table of the case it will be.
    sense
        Of the phase, where it is known; "": by its name.
    per_force
        True of a response over force, of which peak and rms are the same number.
    """
    table: dict[str, Any] = {key: draft.address(column) for key, column in sensor.places}
    if "amplitude" in table or "complex" in table:
        table |= scale_of(sensor.main)
    said = sensor.main.scale or PEAK.search(sensor.main.title) or "scale" in table
    if "amplitude" in table and not per_force and not said:
        table["scale"] = "peak"
        draft.doubts[f"{place}.scale"] = 'or "rms"; the file does not say'
    if sensor.doubt:
        draft.doubts[f"{place}.{sensor.places[-1][0]}"] = sensor.doubt
    if not sensor.has_phase:
        return table
    # two parts or complex numbers have no column that could say its sense
    phase = dict(sensor.places).get("phase", sensor.main)
    radian = {"phase_unit": "rad"} if phase.unit == "rad" else {}
    said = sense or phase_sense(phase)
    if phase is sensor.main or not said:
        draft.doubts[f"{place}.phase_sense"] = _SENSE
    return table | radian | {"phase_sense": said or "lead"}


_MAX_CHANNELS_PROPOSED = 8
"""Channels that are proposed with a table of their own; a file of a modal test may have hundreds."""
_MAX_NAME_LENGTH = 30
"""Characters of a channel's name; the case allows 40, and sums of them should fit a line."""


def channel_names(sensors: Sequence[Sensor]) -> list[str]:
    """Return a name of each channel, valid in a sum: made of its words, distinguished by numbers."""
    names: list[str] = []
    for number, sensor in enumerate(sensors, start=1):
        text = ""
        for word in words_of(sensor.main):
            text += word if not text or (word.isdigit() and text[-1].isalpha()) else f"_{word}"
        plain = unicodedata.normalize("NFKD", text.replace("ß", "ss")).encode("ascii", "ignore").decode()
        name = re.sub(r"[^A-Za-z0-9_]", "", plain)[:_MAX_NAME_LENGTH].strip("_")
        if not name or name[0].isdigit():
            name = f"channel_{name or number}"
        while name in names:
            name = f"{name}_{number}"
        names.append(name)
    return names


def _motion(draft: Draft, sensor: Sensor, place: str, sense: str) -> dict[str, Any]:
    table: dict[str, Any] = {}
    quantity_of(draft, sensor.main, table, place)
    return table | place_of(draft, sensor, place, sense, per_force="per_force" in table)


def write_base(draft: Draft, base: Base, sense: str) -> None:
    """Write [test.base]."""
    table = _motion(draft, base.sensor, "test.base", sense)
    draft.tables["test.base"] = table | {"response": "absolute"}
    draft.doubts["test.base.response"] = 'or "relative", if the response was measured against the base'
    if base.doubt:
        draft.doubts["test.base.quantity"] = base.doubt


def write_motions(draft: Draft, responses: Sequence[Sensor], sense: str, left_out: str) -> None:
    """Write [test.response], and [test.channels] where there are several."""
    # a sum of channels needs the phases of all
    responses, *rest = [list(alike) for _, alike in groupby(responses, key=lambda one: one.has_phase)]
    bare = [sensor.main.title or sensor.main.path for part in rest for sensor in part]
    left_out = "; ".join(
        filter(None, [f"left out: {', '.join(bare)}, without a phase" * bool(bare), left_out])
    )
    relative = "test.base" in draft.tables and RELATIVE(responses[0].main)
    if relative:
        draft.tables["test.base"]["response"] = "relative"
        draft.doubts["test.base.response"] = 'by the name of the response; or "absolute"'
    alone = _motion(draft, responses[0], "test.response", sense)
    key = next(key for key in ("samples", "amplitude", "complex", "real") if key in alone)
    if len(responses) == 1 or "per_force" in alone:
        others = [sensor.main.title or sensor.main.path for sensor in responses[1:]]
        reason = f"left out: {listed(others)}; a case reads one response" if others else ""
        _write_alone(draft, alone, key, "; ".join(filter(None, [reason, left_out])))
        return
    for doubt in [name for name in draft.doubts if name.startswith("test.response.")]:
        del draft.doubts[doubt]
    chosen = responses[:_MAX_CHANNELS_PROPOSED]
    names = channel_names(chosen)
    for name, sensor in zip(names, chosen, strict=True):
        place = f"test.channels.{name}"
        draft.tables[place] = _motion(draft, sensor, place, sense)
    draft.tables["test.response"] = {"channels": names[0]}
    more = f", {len(responses) - len(chosen)} more are in the file" if responses[len(chosen) :] else ""
    between = f'an element between two has across = "{names[0]} - {names[1]}"'
    choice = (f"or {', '.join(names[1:])}{more}", between, left_out)
    draft.doubts["test.response.channels"] = "; ".join(filter(None, choice))


def _write_alone(draft: Draft, table: dict[str, Any], key: str, left_out: str) -> None:
    if "phase_sense" not in table and key != "samples":
        table["phase_known"] = False
    draft.tables["test.response"] = table
    if left_out:
        said = draft.doubts.get(f"test.response.{key}", "")
        draft.doubts[f"test.response.{key}"] = "; ".join(filter(None, [said, left_out]))
