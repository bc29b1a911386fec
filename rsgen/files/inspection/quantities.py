"""What is said about a channel in a case: quantity, unit, scale, columns, the sense of its phase."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import Any

from rsgen.data.surface.columns import QUANTITIES
from rsgen.files.inspection.clues import (
    DECIBEL,
    NAMES,
    OVER_FORCE,
    QUOTIENT,
    RADIAN,
    RMS,
    last_name,
    phase_sense,
    unit_for,
)
from rsgen.files.inspection.guess import Guess
from rsgen.files.inspection.sensors import Sensor
from rsgen.files.tree import Entry

__all__ = ["place_of", "quantity_of", "scale_of", "unit_of_force"]


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
