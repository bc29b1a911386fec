"""The tables [test] and [identify] to a test and its observation, and what a case file must say of a test."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import isnan, prod
from typing import Any

from rsgen.case.grid import MAX_POINTS
from rsgen.case.tables import Maker
from rsgen.declaration import given
from rsgen.errors import MeasurementError
from rsgen.measurement import HistoryRule, MeasuredTest, Signal
from rsgen.measurement.signals import combination
from rsgen.observation import Observation
from rsgen.simulation import MultisineTest, SimulatedTest
from rsgen.surface import match_level
from rsgen.surface.columns import BASE_UNITS

__all__ = ["make_measured", "make_observation", "make_simulated"]

_SIGNAL = Signal(amplitude=1)


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


def make_measured(
    table: Any, maker: Maker, mass: float | None, calibrated: bool, across: str | None = None
) -> MeasuredTest:
    """Make the plan for reading measured files.

    Parameters
    ----------
    table
        The [test] table.
    maker
        Gets the faults.
    mass
        The moving mass [kg], if the case has it.
    calibrated
        False where force or response have no known scale: their units may then be any.
    across
        The sum of channels that elements act across, if any do.
    """
    if not calibrated:
        maker.units = {"N": None}
    elif table.control in ("response", "continuation"):
        maker.units = {"N": "m"}
    elif table.base is not None:
        maker.units = {"N": BASE_UNITS[_base_quantity(table)]}
    timed = table.excitation != "steady"
    known: dict[str, Any] = {"calibrated": calibrated, "history": None, "across": across}
    if timed:
        known["history"] = maker.make(HistoryRule, table, "test", mass=mass)
    if table.force is None or table.force.nominal:
        known["force"] = None
    test = maker.make(MeasuredTest, table, "test", **known)
    maker.faults += [f"test.{fault}" for fault in _signal_faults(table, test)]
    if timed:
        if table.excitation == "ring-down" and mass is None:
            maker.faults.append(
                "system.mass: is missing; a free decay determines stiffness and damping per mass only"
            )
    elif table.time is not None:
        maker.faults.append("test.time: belongs to time histories; leave it out, or set test.excitation")
    return test


def _base_quantity(table: Any) -> str:
    """What of the base was measured, "" where the case does not say."""
    if table.base.quantity is not None:
        return str(table.base.quantity)
    try:
        names = combination(table.base.channels or "")
    except MeasurementError:
        # said where the test is made
        return ""
    known = table.channels or {}
    quantities = [str(known[name].quantity) for name in names if name in known]
    return next((quantity for quantity in quantities if quantity in BASE_UNITS), "")


def _signal_faults(table: Any, test: MeasuredTest) -> Iterator[str]:
    """Find what a case file must say of force and response, where an object has a default."""
    force, response = table.force, table.response
    if force is None and table.base is None and table.excitation != "ring-down":
        yield "force: is missing; where it is, or nominal = true, is needed"
    elif force is not None and force.nominal:
        if any(getattr(force, name) is not None for name in given(_SIGNAL, "amplitude")):
            yield "force.nominal: is true, but there are columns of the force; leave one out"
        if test.history is not None:
            yield "force.nominal: a time history needs the force as it was; 'samples' is needed"
    named = [(f"channels.{name}", channel.signal) for name, channel in (test.channels or {}).items()]
    base = None if test.base is None else test.base.signal
    for place, signal in (("force", test.force), ("base", base), ("response", test.response), *named):
        if signal is None or test.history is not None:
            continue
        turned = (signal.phase, signal.imaginary, signal.complex) != (None, None, None)
        if turned and signal.phase_sense is None:
            yield (
                f"{place}.phase_sense: is missing; 'lag' (positive means later) or 'lead' (earlier) is needed"
            )
    if response is not None and response.amplitude is not None and test.history is None:
        if response.phase is None and response.phase_known:
            yield (
                "response.phase: is missing; amplitude and phase, or real and imaginary, are needed "
                "(or phase_known = false)"
            )
        if response.phase is not None and not response.phase_known:
            yield "response.phase_known: is false, but there is a phase; leave one out"


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
