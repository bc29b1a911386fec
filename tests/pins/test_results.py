"""Results must not drift: identifications, rankings, multisines, controls, records, joints, names.

A pin changes only on purpose; ``python -m tests.pins.MODULE --renew "reason" id ...`` writes the new numbers
and the reason beside them. A failing pin says which number became what.
"""

import copy
from collections.abc import Iterator
from types import ModuleType

import pytest
from _pytest.mark import ParameterSet

from tests.pins import (
    controls,
    histories,
    identifications,
    joints,
    multisine,
    names,
    observations,
    predictions,
    ranking,
)
from tests.pins.pinned import SMOOTH, Pin, Tree, changes, is_empty, numbers_file, read

MODULES: tuple[ModuleType, ...] = (
    identifications, ranking, multisine, controls, histories, joints, observations, predictions, names,
)  # fmt: skip
TABLES: dict[str, dict[str, Pin]] = {module.__name__.rpartition(".")[2]: module.PINS for module in MODULES}
NUMBERS = {
    name: read(numbers_file(str(module.__file__))) for name, module in zip(TABLES, MODULES, strict=True)
}

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


Place = tuple[str | int, ...]


def _places(tree: Tree, path: Place = ()) -> Iterator[tuple[Place, Tree]]:
    """Every number, text and truth of a tree with its path; pairs of a complex number are one."""
    pair = isinstance(tree, list) and len(tree) == 2 and all(isinstance(part, float) for part in tree)
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield from _places(value, (*path, key))
    elif isinstance(tree, list) and not pair:
        for i, value in enumerate(tree):
            yield from _places(value, (*path, i))
    else:
        yield path, tree


def _with(tree: Tree, place: Place, value: Tree) -> Tree:
    if not place:
        return value
    changed = copy.copy(tree)
    changed[place[0]] = _with(tree[place[0]], place[1:], value)
    return changed


def _moved(value: Tree, by: float) -> Tree:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, str):
        return f"{value}, another"
    if value is None:
        return 1.0
    return [value[0] + by, value[1]] if isinstance(value, list) else value + by


@pytest.mark.parametrize("table", TABLES)
def test_each_number_of_a_pin_is_compared(table):
    """A number that moves by a tenth, or by one where it is small, fails in every place of every pin."""
    unseen = []
    for key, pin in NUMBERS[table].items():
        old = {name: value for name, value in pin.items() if name != "renewed"}
        for place, value in _places(old):
            size = abs(value) if isinstance(value, float) else 0.0
            other = _with(old, place, _moved(value, max(0.1 * size, 1.0)))
            if len(changes(old, other, TABLES[table][key].allowed)) < 1:
                unseen.append((key, place, value))
    assert unseen == []


def test_a_value_moves_by_a_share_of_its_standard_error_and_no_more():
    old = NUMBERS["observations"]["background/phase"]
    place: Place = ("refined", "kn", "value")
    value, error = old["refined"]["kn"]["value"], old["refined"]["kn"]["standard_error"]
    assert SMOOTH.of_standard_error * error > SMOOTH.value * abs(value)
    assert changes(old, _with(old, place, value + 0.9e-6 * error)) == []
    assert len(changes(old, _with(old, place, value + 1.2e-6 * error))) == 1


def test_names_that_are_gone_or_new_are_said():
    old = {"names": NUMBERS["names"]["attributes/ResponseSurface"]["names"]}
    new = {"names": sorted([*(name for name in old["names"] if name != "force"), "forces"])}
    assert changes(old, new) == ["/names: force -> nothing", "/names: nothing -> forces"]
    assert changes({"a": 1, "b": 2.0}, {"b": 2.0, "c": 3}) == ["/a: 1 -> nothing", "/c: nothing -> 3"]
    # a count, a text, a truth and nothing are no numbers that may drift
    for one, other in ((1, 2), ("up", "down"), (True, False), (None, 1.0), (1.0, None), (1.0, [1.0, 0.0])):
        assert len(changes({"a": one}, {"a": other})) == 1
