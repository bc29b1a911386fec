"""The tables [test] of a virtual test and [identify] to the test and its observation."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, prod
from typing import Any

from rsgen.cases.grid import MAX_POINTS
from rsgen.cases.tables import Maker
from rsgen.data.observation import Observation
from rsgen.data.surface import match_level
from rsgen.data.surface.columns import BASE_UNITS
from rsgen.dynamics.simulation import MultisineTest, SimulatedTest
from rsgen.files import MeasuredTest

__all__ = ["make_observation", "make_simulated"]


def make_simulated(table: Any, maker: Maker) -> SimulatedTest | MultisineTest:
    """Make a virtual test of at most a million points."""
    if table.kind == "simulated-multisine":
        return maker.make(MultisineTest, table, "test")
    if table.control in ("response", "continuation"):
        maker.units = {"N": "m"}
    elif table.base is not None and table.base.quantity is not None:
        maker.units = {"N": BASE_UNITS[table.base.quantity]}
    test = maker.make(SimulatedTest, table, "test")
    rows = ((table.level, test.level), (table.frequency, test.frequency))
    sizes = [size for grid, row in rows if (size := grid.count if row is None else len(row)) is not None]
    if prod(sizes) > MAX_POINTS:
        shown = " x ".join(map(str, sizes))
        maker.faults.append(f"test: {shown} = {prod(sizes)} points; at most {MAX_POINTS} in a case")
    return test


def make_observation(
    table: Any, test: SimulatedTest | MultisineTest | MeasuredTest, maker: Maker
) -> Observation:
    """Make the observation; levels held out of a virtual test must be among those tested."""
    observation = maker.make(Observation, table, "identify")
    unit = maker.units.get("N", "N")
    levels: list[float] = []
    for number, level in enumerate(observation.hold_out, start=1):
        if isnan(level):
            continue
        place = f"identify.hold_out.{number}"
        if not isinstance(test, MeasuredTest) and test.level is not None:
            meant = match_level(test.level, level)
            if meant is None:
                maker.faults.append(f"{place}: {level:g} {unit} is not tested; one of test.level is needed")
                continue
            level = meant
        if level in levels:
            maker.faults.append(f"{place}: {level:g} {unit or 'N'} stands twice; each level once")
            continue
        levels.append(level)
    if (
        not isinstance(test, MeasuredTest)
        and levels
        and test.level is not None
        and len(levels) == len(test.level)
    ):
        maker.faults.append("identify.hold_out: holds every level back; at least one must remain")
    return observation if maker.faults else replace(observation, hold_out=tuple(levels))
