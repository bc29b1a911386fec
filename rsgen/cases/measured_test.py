"""The table [test] of a measured case: its keys, and its way to the plan for reading files."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal, get_args

from pydantic import Field

from rsgen.cases.tables import Maker, table_of
from rsgen.common.declaration import given
from rsgen.common.errors import MeasurementError
from rsgen.data.surface.columns import BASE_UNITS
from rsgen.files import HistoryRule, MeasuredTest, Signal
from rsgen.files.plan import Excitation
from rsgen.files.signals import combination

_SIGNAL = Signal(amplitude=1)

_OF_PHASE = {
    True: "response.phase: is missing; amplitude and phase, or real and imaginary, are needed "
    "(or phase_known = false)",
    False: "response.phase_known: is false, but there is a phase; leave one out",
}
"""Contradiction between files and the key ``phase``."""

MEASURED = table_of(
    MeasuredTest,
    "MeasuredTest",
    "A real test: files in the folder of the case, or in the folder that RSGEN_DATA names.",
    {
        "kind": (Literal["measured"], Field()),
        "excitation": (
            Literal[("steady", *get_args(Excitation))],
            Field("steady", description="steady: a table of amplitudes. The others: time histories."),
        ),
        "force.nominal": (
            bool,
            Field(False, description="True: the force was not recorded, and the level stands for it."),
        ),
    },
)


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
    """Measured quantity of the base; "" where the case names none."""
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
    if response is None or response.amplitude is None or test.history is not None:
        return
    if (response.phase is None) == response.phase_known:
        yield _OF_PHASE[response.phase_known]
