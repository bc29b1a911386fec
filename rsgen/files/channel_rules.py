"""What must fit together in channels with names, sums of them, and a driven base."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

from rsgen.common.errors import MeasurementError
from rsgen.files.signals import Signal, combination

if TYPE_CHECKING:
    from rsgen.files.plan import MeasuredTest

__all__ = ["channel_faults"]

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,39}")
"""What a channel may be called: it stands in sums."""


def channel_faults(test: MeasuredTest) -> Iterator[tuple[str, str]]:
    """Find what does not fit together: a field's name and what is wrong with it."""
    known = test.channels or {}
    for name, channel in known.items():
        if not _NAME.fullmatch(name):
            yield "channels", f"{name!r:.80} is no name; a letter, then letters, digits and _ are needed"
        if len(channel.files) not in (0, len(test.files)):
            yield f"channels.{name}.file", f"{len(channel.files)} for {len(test.files)} files; one for each"
    sums = {"force": test.force, "response": test.response}
    if test.base is not None:
        sums["base"] = test.base.signal
    if test.across is not None:
        sums["across"] = Signal(channels=test.across)
    wrong = False
    for what, signal in sums.items():
        for fault in _sum_faults(test, what, signal):
            wrong = True
            yield what, fault
    if test.response.channels is None and test.quantity is None:
        wrong = True
        yield "quantity", "is missing; 'displacement', 'velocity' or 'acceleration' is needed"
    if not wrong:
        yield from _quantity_faults(test)
        yield from _excitation_faults(test)
        yield from _base_faults(test)


def _quantity_faults(test: MeasuredTest) -> Iterator[tuple[str, str]]:
    """Find a quantity that is not that of the channels, and files that they do not come from."""
    if test.response.channels is not None and test.response_files:
        yield "response_files", "belong to columns, but channels are given; say the files of each channel"
    signals = {"response": (test.response, test.quantity)}
    if test.base is not None:
        signals["base"] = (test.base.signal, test.base.quantity)
    for what, (signal, said) in signals.items():
        known = test.terms(what)[0][1].quantity
        if signal.channels is not None and said not in (None, known):
            yield f"{what}.quantity", f"is {said!r}, but its channels are {known}; leave it out"


def _sum_faults(test: MeasuredTest, what: str, signal: Signal | None) -> Iterator[str]:
    """Find what is wrong with the sum of channels that something is made of."""
    if signal is None or signal.channels is None:
        return
    try:
        names = combination(signal.channels)
    except MeasurementError as fault:
        yield str(fault)
        return
    known = test.channels or {}
    unknown = [name for name in names if name not in known]
    if unknown:
        yield f"{', '.join(unknown)}: no such channel; known: {', '.join(known) or 'none'}"
        return
    quantities = {known[name].quantity for name in names}
    if (what == "force") != (quantities == {"force"}):
        needed = "of forces" if what == "force" else "of displacements, velocities or accelerations"
        yield f"{signal.channels!r:.80} is made {needed}; its channels are {', '.join(sorted(quantities))}"
    elif test.history is not None and len(quantities) > 1:
        yield (
            f"{signal.channels!r:.80} adds {' and '.join(sorted(quantities))}; channels of one quantity are "
            "needed in time histories"
        )


def _excitation_faults(test: MeasuredTest) -> Iterator[tuple[str, str]]:
    """Find excitations whose evaluation knows one force and one response only."""
    kind = "" if test.history is None else test.history.excitation
    if kind not in ("ring-down", "multisine"):
        return
    for what, there in (("base", test.base), ("across", test.across)):
        if there is not None:
            yield (
                what,
                f"does not go with {kind!r}; swept sine, stepped sine or a table of amplitudes is needed",
            )


def _base_faults(test: MeasuredTest) -> Iterator[tuple[str, str]]:
    """Find what a driven base cannot have."""
    if test.base is None:
        return
    if test.force is not None:
        yield "base", "is driven, but there is a force; leave one of them out"
    if test.per_force or test.control in ("response", "continuation"):
        yield "base", "is driven by its motion; per_force and a held response need a force"
    if test.base.response == "absolute" and not test.phase_known:
        yield (
            "base.response",
            "is 'absolute', and no phases were recorded; the motion relative to the base needs them",
        )
    if test.base.signal.channels is None and test.base.quantity is None:
        yield "base.quantity", "is missing; 'displacement', 'velocity' or 'acceleration' is needed"
    elif test.history is not None:
        of_base, of_response = (test.terms(what)[0][1].quantity for what in ("base", "response"))
        if of_base != "acceleration":
            yield "base.quantity", f"is {of_base!r}; a time history needs the acceleration of the base"
        elif test.base.response == "absolute" and of_response != "acceleration":
            yield (
                "base.response",
                f"is 'absolute', and the response is a {of_response}; a time history needs accelerations of "
                "both",
            )
