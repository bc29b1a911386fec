"""The tables of a case for measured motions: one response, several as channels with names, and a base."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from typing import Any

from rsgen.files.inspection.clues import RELATIVE
from rsgen.files.inspection.driven_base import Base
from rsgen.files.inspection.guess import Guess
from rsgen.files.inspection.quantities import place_of, quantity_of
from rsgen.files.inspection.sensors import Sensor, words_of

__all__ = ["channel_names", "write_base", "write_motions"]

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
