"""Results must not drift: identifications, rankings, multisines, controls, records, joints, names.

A pin changes only on purpose; ``python -m tests.pins.MODULE --renew "reason" id ...`` writes the new numbers
and the reason beside them. A failing pin says which number became what.
"""

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest
from _pytest.mark import ParameterSet

from tests.pins.pinned import Pin, changes, is_empty, read

NAMES = (
    "identifications", "ranking", "multisine", "controls", "histories", "joints", "observations",
    "predictions", "names",
)  # fmt: skip
TABLES: dict[str, dict[str, Pin]] = {name: import_module(f"tests.pins.{name}").PINS for name in NAMES}
NUMBERS = {name: read(Path(__file__).with_name(f"{name}.json")) for name in NAMES}

REFUSED = {"ranking": {"two-sensors/laws"}}
"""Tasks that rsgen refuses; another pin that is refused was made wrongly."""


def _all() -> Iterator[ParameterSet]:
    for table, pins in TABLES.items():
        for key, pin in pins.items():
            marks = [pytest.mark.thorough] if pin.thorough else [pytest.mark.slow] if pin.slow else []
            yield pytest.param(table, key, id=f"{table}-{key}", marks=marks)


@pytest.mark.parametrize("table", TABLES)
def test_every_result_is_pinned(table):
    pins = NUMBERS[table]
    assert list(pins) == list(TABLES[table])
    assert [key for key, pin in pins.items() if is_empty(pin)] == []
    assert {key for key, pin in pins.items() if "refused" in pin} == REFUSED.get(table, set())
    assert all(pin["renewed"].strip() for pin in pins.values() if "renewed" in pin)


@pytest.mark.parametrize(("table", "key"), list(_all()))
def test_the_result_is_the_one_pinned(table, key, measured_data):
    pin = TABLES[table][key]
    if pin.data:
        measured_data(pin.data)
    old = {name: value for name, value in NUMBERS[table][key].items() if name != "renewed"}
    assert changes(old, pin.numbers(), pin.allowed) == []
