"""Whether a table or record without a force is that of a structure on a driven base, and its motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rsgen.files.inspection.clues import BASE, CONTROL, FORCE, IS_FORCE, IS_MOTION, RESPONSE, Clue
from rsgen.files.inspection.sensors import Sensor
from rsgen.files.tree import Entry

__all__ = ["Base", "find_base"]

_FLAT = 0.5
"""The motion of a held base varies by less than this share of what a resonance makes of it."""
_MOTION = IS_MOTION & Clue(lambda entry: not entry.unit.endswith("/N"))


@dataclass(frozen=True, slots=True)
class Base:
    """The motion of a base: its columns, and why it was taken, "" where its name says so."""

    sensor: Sensor
    doubt: str = ""


def _flatness(entry: Entry) -> float:
    """Largest over smallest amplitude: that of the base is held, and a resonance moves the others."""
    return float("inf") if not entry.low or entry.high is None or entry.low < 0 else entry.high / entry.low


def find_base(sensors: Sequence[Sensor], loose: Sequence[Entry] = ()) -> Base | None:
    """Find the motion of the base among channels; None where there is a force, or one motion only.

    Parameters
    ----------
    sensors
        Channels of a table, or of a record with one column each.
    loose
        Phases whose titles name none of them.
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
        # of three directions the driven one moves most
        driven = max(named, key=lambda s: s.main.high or 0.0)
        less = [s.main.title or s.main.path for s in named if s is not driven]
        return Base(driven, f"it moves more than {', '.join(less)}" if less else "")
    steered = [s for s in motions if CONTROL(s.main)]
    if 0 < len(steered) < len(motions):
        return Base(steered[0], "no force was found, and this name says what was controlled")
    moved = [s for s in motions if _MOTION(s.main) and s.places[0][0] == "amplitude"]
    if len({s.main.unit for s in moved}) == 1 and len(moved) == len(motions):
        flat, *others = sorted(moved, key=lambda s: _flatness(s.main))
        if _flatness(flat.main) < _FLAT * _flatness(others[0].main) and (others[0].has_phase or loose):
            return Base(flat, "no force was found, and this motion varies least; else write [test.force]")
    return None
