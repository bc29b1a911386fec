"""A small part of the attacks; where other tests make the same attack, only what the table is made of."""

import os
from importlib import import_module

import pytest

from tests.attacks import __main__ as table

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals, limits and mounts are POSIX")
FEW = {"kills": 12, "readers": 200, "expressions": 200, "cases": 400, "surroundings": 24}


@pytest.mark.thorough
@pytest.mark.parametrize("module", table.COUNTS)
def test_a_few_attacks_of_each_kind(module):
    rows = import_module(f"tests.attacks.{module}").run(FEW[module], seed=1)
    assert [row for row in rows if any(row[1])] == []
