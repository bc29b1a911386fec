"""The tables of a case for measured motions: one response, several as channels with names, and a base."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Any

from rsgen.data.surface.columns import QUANTITIES
from rsgen.files.inspection.beside import Guess
from rsgen.files.inspection.clues import (
    DECIBEL,
    NAMES,
    OVER_FORCE,
    QUOTIENT,
    RADIAN,
    RELATIVE,
    RMS,
    last_name,
    phase_sense,
    unit_for,
)
from rsgen.files.inspection.sensors import Base, Sensor, words_of
from rsgen.files.tree import Entry

__all__ = [
    "channel_names",
    "place_of",
    "quantity_of",
    "scale_of",
    "unit_of_force",
    "write_base",
    "write_motions",
]


# ----------------------------------------------------------------------------
# What is said about a channel in a case: quantity, unit, scale, columns, the sense of its phase.


def quantity_of(guess: Guess, entry: Entry, table: dict[str, Any], place: str) -> None:
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
        guess.doubts[f"{place}.unit"] = (
            f"the file says {entry.unit!r}; put its meaning into factor" if entry.unit else unknown(entry)
        )
        if DECIBEL.search(entry.unit) or DECIBEL.search(last_name(entry)):
            # no factor makes a logarithm linear: a case that does not pass is better than a wrong one
            table["unit"] = entry.unit or "dB"
            guess.doubts[f"{place}.unit"] = "decibels are not read: write linear numbers into the file"
    per = bool(known) and target.endswith("/N")
    quotient = QUOTIENT(entry) or "over force" in entry.remark
    if per or quotient or "frequency response" in entry.remark:
        table["unit"] += "" if per else "/N"
        table["per_force"] = True
        guess.doubts[f"{place}.quantity"] = f"{OVER_FORCE[table['quantity']]}, {table['unit']}"
        if "adds damping" in entry.remark:
            guess.doubts[f"{place}.per_force"] = "measured with an exponential window, which adds damping"
    if known and entry.unit_source:
        guess.doubts[f"{place}.unit"] = entry.unit_source
    pattern = str(guess.address(entry))
    alike = (e for e in guess.contents.entries if fnmatchcase(e.path, pattern) and not e.fault)
    units = {other.unit for other in alike}
    if guess.run and len(units) > 1:
        # without the key each entry is read in the unit that the file names for it
        del table["unit"]
        said = guess.doubts.get(f"{place}.quantity", "").partition(",")[0]
        of_file = f"in the units of the file: {', '.join(sorted(units))}"
        guess.doubts[f"{place}.quantity"] = f"{said}, {of_file}" if said else of_file


def unknown(entry: Entry) -> str:
    """Say that a file does not name a unit."""
    return entry.unit_source or "not in the file"


def unit_of_force(guess: Guess, entry: Entry) -> str:
    """Give the unit to write for a force."""
    known = unit_for(entry.unit, "N") if entry.unit else None
    if known is None:
        guess.doubts["test.force.unit"] = (
            f"the file says {entry.unit!r}; write unit and factor, such as unit = 'V', factor = '10 N/V'"
            if entry.unit
            else unknown(entry)
        )
    elif entry.unit_source:
        guess.doubts["test.force.unit"] = entry.unit_source
    return known or "N"


def scale_of(entry: Entry) -> dict[str, str | float]:
    """Say what amplitudes are where the file or their name does."""
    if entry.scale == "half-peak":
        return {"factor": 2.0}
    named = RMS.search(f"{entry.title or last_name(entry)} {entry.remark}")
    return {"scale": "rms"} if named and entry.scale in ("", "rms") else {}


def place_of(guess: Guess, sensor: Sensor, place: str, quantity: str, sense: str = "") -> dict[str, Any]:
    """Say where the columns of a channel are, and the sense of its phase.

    Parameters
    ----------
    place
        Which table of the case it will be.
    quantity
        What was measured; "force" for one.
    sense
        Of the phase, where it is known; "": by its name and its values.
    """
    table: dict[str, Any] = {key: guess.address(column) for key, column in sensor.places}
    if "amplitude" in table or "complex" in table:
        table |= scale_of(sensor.main)
    phase = sensor.phase
    if sensor.doubt:
        guess.doubts[f"{place}.{sensor.places[-1][0]}"] = sensor.doubt
    if not sensor.has_phase:
        return table
    if phase is None:
        return table | {"phase_sense": sense or "lead"}
    radian = {"phase_unit": "rad"} if RADIAN(phase) else {}
    return table | radian | {"phase_sense": sense or phase_sense(phase, quantity)}


_MOST_CHANNELS = 8
"""Channels that are proposed with a table of their own; a file of a modal test may have hundreds."""
_LONGEST = 30
"""Characters of a channel's name; the case allows 40, and sums of them should fit a line."""


def channel_names(sensors: Sequence[Sensor]) -> list[str]:
    """Give each channel a name that may stand in a sum: of its words, distinguished by numbers."""
    names: list[str] = []
    for number, sensor in enumerate(sensors, start=1):
        text = ""
        for word in words_of(sensor.main):
            text += word if not text or (word.isdigit() and text[-1].isalpha()) else f"_{word}"
        plain = unicodedata.normalize("NFKD", text.replace("ß", "ss")).encode("ascii", "ignore").decode()
        name = re.sub(r"[^A-Za-z0-9_]", "", plain)[:_LONGEST].strip("_")
        if not name or name[0].isdigit():
            name = f"channel_{name or number}"
        while name in names:
            name = f"{name}_{number}"
        names.append(name)
    return names


def _motion(guess: Guess, sensor: Sensor, place: str, sense: str) -> dict[str, Any]:
    table: dict[str, Any] = {}
    quantity_of(guess, sensor.main, table, place)
    table |= place_of(guess, sensor, place, table["quantity"], sense)
    if "phase_sense" in table:
        guess.doubts[f"{place}.phase_sense"] = "a positive phase means later (lag) or earlier (lead)"
    return table


def write_base(guess: Guess, base: Base, sense: str) -> None:
    """Write [test.base]."""
    table = _motion(guess, base.sensor, "test.base", sense)
    guess.tables["test.base"] = table | {"response": "absolute"}
    guess.doubts["test.base.response"] = 'or "relative", if the response was measured against the base'
    if base.doubt:
        guess.doubts["test.base.quantity"] = base.doubt


def write_motions(guess: Guess, responses: Sequence[Sensor], sense: str, left_out: str) -> None:
    """Write [test.response], and [test.channels] where there are several."""
    guess.tables["test.response"] = {}
    if not responses:
        return
    if responses[0].has_phase:
        # a sum of channels needs the phases of all
        bare = [sensor.main.title or sensor.main.path for sensor in responses if not sensor.has_phase]
        responses = [sensor for sensor in responses if sensor.has_phase]
        left_out = "; ".join(
            filter(None, [f"left out: {', '.join(bare)}, without a phase" * bool(bare), left_out])
        )
    relative = "test.base" in guess.tables and RELATIVE(responses[0].main)
    if relative:
        guess.tables["test.base"]["response"] = "relative"
        guess.doubts["test.base.response"] = 'by the name of the response; or "absolute"'
    alone = _motion(guess, responses[0], "test.response", sense)
    key = next(key for key in ("samples", "amplitude", "complex", "real") if key in alone)
    if len(responses) == 1 or "per_force" in alone:
        others = [sensor.main.title or sensor.main.path for sensor in responses[1:]]
        reason = (
            f"left out: {', '.join(others[:_MOST_CHANNELS])}; a case reads one response" if others else ""
        )
        _write_alone(guess, alone, key, "; ".join(filter(None, [reason, left_out])))
        return
    for doubt in [name for name in guess.doubts if name.startswith("test.response.")]:
        del guess.doubts[doubt]
    del guess.tables["test.response"]
    chosen = responses[:_MOST_CHANNELS]
    names = channel_names(chosen)
    for name, sensor in zip(names, chosen, strict=True):
        place = f"test.channels.{name}"
        guess.tables[place] = _motion(guess, sensor, place, sense)
    guess.tables["test.response"] = {"channels": names[0]}
    more = f", {len(responses) - len(chosen)} more are in the file" if responses[len(chosen) :] else ""
    between = f'an element between two has across = "{names[0]} - {names[1]}"'
    choice = (f"or {', '.join(names[1:])}{more}", between, left_out)
    guess.doubts["test.response.channels"] = "; ".join(filter(None, choice))


def _write_alone(guess: Guess, table: dict[str, Any], key: str, left_out: str) -> None:
    if "phase_sense" not in table and key != "samples":
        table["phase_known"] = False
    guess.tables["test.response"] = table
    if left_out:
        said = guess.doubts.get(f"test.response.{key}", "")
        guess.doubts[f"test.response.{key}"] = "; ".join(filter(None, [said, left_out]))
