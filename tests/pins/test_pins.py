"""Numbers that must not drift: each identification gives what it gave when it was pinned.

A pin changes only on purpose, where a method becomes better or a fault is mended; then
``python -m tests.pins.MODULE --renew "reason" id ...`` writes the new numbers and the reason beside
them, which says what was measured.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.pins.identifications import PINS
from tests.pins.pinned import read

NUMBERS = read(Path(__file__).with_name("identifications.json"))

OF_VALUE = 1e-9
"""Largest relative change of a value."""

OF_STANDARD_ERROR = 1e-6
"""Or largest change in standard errors, whichever is more. Sums in another order move a parameter in
proportion to its standard error. With the rows of every surface in another order nothing moved by more than
3 % of what is allowed here, mostly by less than 0.01 %."""

OF_STANDARD_ERROR_OF_MEASURED = 3e-4
"""The same of measured tests, whose many parameters are hardly told apart: between processors those of the
F-16 move by 1.2e-4 standard errors."""

OF_ERROR = 1e-5
"""Largest relative change of a standard error or of the noise found."""

OF_RESPONSE = 1e-12
"""Or largest change of the noise relative to the response, and of standard errors with it: exact data has
as noise what the last step of a fit leaves, which differs from processor to processor."""


def rooms(
    pin: dict[str, Any], of_standard_error: float = OF_STANDARD_ERROR
) -> Iterator[tuple[str, float | None, float]]:
    """Yield place, number and how far it may move, of every number of a pin but the mass."""
    of_error = max(OF_ERROR, OF_RESPONSE / pin["noise"]) if pin["noise"] else OF_ERROR
    for stage in ("refined", "first_order", "paper"):
        for name, (value, error) in pin[stage].items():
            room = max(OF_VALUE * abs(value or 0.0), of_standard_error * (error or 0.0))
            yield f"{stage} {name}", value, room
            yield f"error of {stage} {name}", error, of_error * (error or 0.0)
    yield "noise", pin["noise"], of_error * (pin["noise"] or 0.0)


def changes(
    old: dict[str, Any], new: dict[str, Any], of_standard_error: float = OF_STANDARD_ERROR
) -> list[str]:
    """Say every number that is not what was pinned."""
    if "refused" in old or "refused" in new:
        return [] if old.get("refused") == new.get("refused") else [f"{old} became {new}"]
    one, other = ({place: value for place, value, _ in rooms(pin)} for pin in (old, new))
    found = [f"{place} is gone or new" for place in one.keys() ^ other.keys()]
    for place, value, room in rooms(old, of_standard_error):
        now = other.get(place)
        if now is not value and (now is None or value is None or abs(now - value) > room):
            found.append(f"{place}: {value} became {now}")
    return found


def test_every_identification_is_pinned() -> None:
    assert list(NUMBERS) == list(PINS)
    for pin in NUMBERS.values():
        assert pin.get("renewed", "because").strip()
        # a pin of nothing would never fail
        assert "refused" in pin or any(value is not None for value, _ in pin["refined"].values())


@pytest.mark.parametrize("moved", ["value", "error", "noise", "lost"])
def test_a_change_is_seen(moved: str) -> None:
    pin = NUMBERS["case/cubic/noisy"]
    value, error = pin["refined"]["k1"]
    noise = pin["noise"] * (1 + 2e-5 * (moved == "noise"))
    changed = {
        "value": [value + 1e-5 * error, error], "error": [value, error * (1 + 2e-5)],
        "noise": [value, error], "lost": [None, error],
    }[moved]  # fmt: skip
    assert changes(pin, pin) == []
    assert len(changes(pin, {**pin, "noise": noise, "refined": {**pin["refined"], "k1": changed}})) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "key", [pytest.param(key, marks=[pytest.mark.thorough] if PINS[key].thorough else []) for key in PINS]
)
def test_the_numbers_are_those_pinned(key: str, measured_data: Callable[[str], Path]) -> None:
    if PINS[key].data:
        measured_data(PINS[key].data)
    allowed = OF_STANDARD_ERROR_OF_MEASURED if PINS[key].data else OF_STANDARD_ERROR
    assert changes(NUMBERS[key], PINS[key].numbers(), allowed) == []
