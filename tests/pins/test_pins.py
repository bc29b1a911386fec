"""Numbers that must not drift: each identification gives what it gave when it was pinned.

A pin changes only on purpose: where a method becomes better (the O(noise^2) bias is corrected with a
background, too), or where a fault is mended. Then

    python -m tests.pins.identifications --renew "reason" id ...

writes the new numbers and the reason beside them; the reason says what was measured.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.pins.identifications import IDS, compute, read

PINS = read()
FOLDERS = {"measured/clamp": "frid_clamp"}

OF_VALUE = 1e-9
"""Largest relative change of a value."""

OF_STANDARD_ERROR = 1e-6
"""Or largest change in standard errors, whichever is more. Sums in another order move a parameter in
proportion to its standard error. With the rows of every surface in another order nothing moved by more than
3 % of what is allowed here, mostly by less than 0.01 %."""

OF_ERROR = 1e-5
"""Largest relative change of a standard error or of the noise found."""


def changes(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Say every number that is not what was pinned."""
    if "refused" in old or "refused" in new:
        return [] if old.get("refused") == new.get("refused") else [f"{old} became {new}"]
    found = []
    for stage in ("refined", "first_order", "paper"):
        if set(old[stage]) != set(new[stage]):
            found.append(f"{stage}: parameters {sorted(old[stage])} became {sorted(new[stage])}")
            continue
        for name, (value, error) in old[stage].items():
            value_now, error_now = new[stage][name]
            allowed = max(OF_VALUE * abs(value or 0.0), OF_STANDARD_ERROR * (error or 0.0))
            if far(value, value_now, allowed) or far(error, error_now, OF_ERROR * (error or 0.0)):
                found.append(f"{stage} {name}: {value} +- {error} became {value_now} +- {error_now}")
    if far(old["noise"], new["noise"], OF_ERROR * (old["noise"] or 0.0)):
        found.append(f"noise: {old['noise']} became {new['noise']}")
    return found


def far(old: float | None, new: float | None, allowed: float) -> bool:
    """True where the numbers differ by more than is allowed, or only one of them is finite."""
    if old is None or new is None:
        return old is not new
    return abs(new - old) > allowed


def test_every_identification_is_pinned() -> None:
    assert list(PINS) == list(IDS)
    assert all(pin["renewed"].strip() for pin in PINS.values() if "renewed" in pin)
    # a pin of nothing would never fail
    assert all(
        "refused" in pin or any(v is not None for v, _ in pin["refined"].values()) for pin in PINS.values()
    )


@pytest.mark.parametrize("moved", ["value", "error", "noise", "lost"])
def test_a_change_is_seen(moved: str) -> None:
    pin = PINS["case/cubic/noisy"]
    value, error = pin["refined"]["k1"]
    noise = pin["noise"] * (1 + 2e-5 * (moved == "noise"))
    changed = {
        "value": [value + 1e-5 * error, error], "error": [value, error * (1 + 2e-5)],
        "noise": [value, error], "lost": [None, None],
    }[moved]  # fmt: skip
    assert changes(pin, pin) == []
    assert len(changes(pin, {**pin, "noise": noise, "refined": {**pin["refined"], "k1": changed}})) == 1


@pytest.mark.slow
@pytest.mark.parametrize("key", [key for key in IDS if not key.startswith("measured/")])
def test_the_numbers_are_those_pinned(key: str) -> None:
    assert changes(PINS[key], compute(key)) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "key",
    [
        pytest.param(key, marks=[pytest.mark.thorough] if key == "measured/f16" else [])
        for key in IDS
        if key.startswith("measured/")
    ],
)
def test_the_numbers_of_a_measured_test_are_those_pinned(
    key: str, measured_data: Callable[[str], Path]
) -> None:
    measured_data(FOLDERS.get(key, key.removeprefix("measured/")))
    assert changes(PINS[key], compute(key)) == []
