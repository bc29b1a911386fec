"""The table of faults fits the package as it is: texts are found once, and the tests that it names exist."""

import ast
from collections import Counter
from pathlib import Path
from textwrap import dedent

import pytest

from tests.faults.table import GROUPS, Fault, FaultError, find_place, is_there, load_faults

ROOT = Path(__file__).parents[2]
FAULTS = load_faults()
FEWEST, FEWEST_OF_A_GROUP = 60, 8


def test_there_are_enough_of_every_kind():
    groups = Counter(fault.group for fault in FAULTS)
    assert len(FAULTS) >= FEWEST
    assert set(groups) == set(GROUPS)
    assert min(groups.values()) >= FEWEST_OF_A_GROUP
    assert max(Counter(fault.name for fault in FAULTS).values()) == 1


def test_each_fault_is_found_once_and_leaves_a_program():
    for fault in FAULTS:
        place = find_place(fault, ROOT)
        faulty = place.replaced(fault)
        assert faulty != place.text, fault.name
        if place.file.suffix == ".py":
            ends = place.stop, place.stop + len(faulty) - len(place.text)
            before, after = (
                text[place.start : end] for text, end in zip((place.text, faulty), ends, strict=True)
            )
            assert ast.dump(ast.parse(dedent(before))) != ast.dump(ast.parse(dedent(after))), fault.name
        assert 1 <= len(fault.caught) <= 3, fault.name
        assert [test for test in fault.caught if not is_there(test, ROOT)] == [], fault.name


def test_a_stale_text_is_named():
    fault = Fault("stale", GROUPS[0], FAULTS[0].function, "no such text", "", "", ())
    with pytest.raises(FaultError, match="stale: 'no such text' occurs 0 times"):
        find_place(fault, ROOT).replaced(fault)
