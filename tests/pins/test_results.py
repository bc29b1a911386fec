"""Results must not drift: identifications, rankings, multisines, controls, records, joints, names.

A pin changes only on purpose; ``python -m tests.pins`` writes the new numbers and the reason beside them. A
failing pin says which number became what.
"""

import pytest

from tests.pins.__main__ import TABLES
from tests.pins.pinned import changes, leaves, stored

NUMBERS = {
    table: {key: {part: pin[part] for part in pin if part != "renewed"} for key, pin in stored(table).items()}
    for table in TABLES
}
REFUSED = {"ranking": {"two-sensors/laws"}}
"""Tasks that rsgen refuses; another pin that is refused was made wrongly."""
ALL = [
    pytest.param(table, key, id=f"{table}-{key}",
                 marks=[pytest.mark.thorough] * pin.thorough + [pytest.mark.slow] * pin.slow)
    for table, pins in TABLES.items()
    for key, pin in pins.items()
]  # fmt: skip


@pytest.mark.parametrize("table", TABLES)
def test_every_result_is_pinned(table):
    pins = NUMBERS[table]
    assert list(pins) == list(TABLES[table])
    # one of nothing would never fail
    assert [key for key, pin in pins.items() if all(tree is None for _, tree, _ in leaves(pin))] == []
    assert {key for key, pin in pins.items() if "refused" in pin} == REFUSED.get(table, set())


@pytest.mark.parametrize(("table", "key"), ALL)
def test_the_result_is_the_one_pinned(table, key, measured_data):
    pin = TABLES[table][key]
    if pin.data:
        measured_data(pin.data)
    assert changes(NUMBERS[table][key], pin.numbers(), pin.allowed) == []
