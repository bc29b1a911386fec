"""Channels whose unit the case leaves to the file, brought to SI."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.errors import MeasurementError, RsgenError, quote
from rsgen.common.finding import Finding
from rsgen.files.plan import MeasuredTest
from rsgen.files.tree import Channel
from rsgen.formula.units import quantity, sensor_unit

__all__ = ["scaled", "to_si"]

_SCALES = {
    "rms": ("root mean squares", "scale = 'rms'"),
    "peak": ("peak amplitudes", "scale = 'peak'"),
    "half-peak": ("halves of the peak amplitudes", "factor = 2"),
}
"""What the amplitudes of a file are by its word for them, and what the case must say."""


def _left_to_file(test: MeasuredTest) -> dict[int | str, str]:
    """Give the columns whose unit the case leaves to the file, each with its SI unit."""
    return {
        column: target
        for signal, target in test.signals
        if signal is not None and signal.unit is None and test.calibrated
        for column in signal.columns
        if column != signal.phase
    }


def _check_scale(test: MeasuredTest, label: str, column: int | str, channel: Channel) -> None:
    """Refuse amplitudes that the file says to be others than the case reads."""
    for signal, _ in test.signals:
        if signal is None or not channel.scale or column not in signal.columns or column == signal.phase:
            continue
        said, needed = _SCALES[channel.scale]
        fits = signal.factor != 1 if channel.scale == "half-peak" else signal.scale == channel.scale
        if not fits:
            raise MeasurementError(
                f"{label}: {quote(channel.path)} holds {said}, as the file says; write {needed} in the case"
            )


def scaled(values: NDArray[Any], factor: float) -> NDArray[Any]:
    """Multiply, in place where numbers are floating: long histories are not copied."""
    if values.dtype.kind not in "fc" or values.dtype == np.float16:
        # 16 bits fit into single precision
        values = values.astype(np.float32 if values.dtype.itemsize <= 2 else np.float64)
    elif factor == 1:
        return values
    values *= values.dtype.type(factor)
    return values


def to_si(
    test: MeasuredTest, label: str, wanted: Sequence[int | str], groups: Sequence[list[Channel]]
) -> tuple[Finding, ...]:
    """Bring channels to SI in place where the case leaves the unit to the file.

    Parameters
    ----------
    test, label
        The plan, and the file for messages.
    wanted, groups
        Addresses, and the channels that each means.

    Returns
    -------
    A finding for each unit that was taken from the file and is not SI, or that could not be taken.

    Raises
    ------
    MeasurementError
        The file contradicts itself about a unit, or the case about the kind of amplitudes.
    """
    findings = {}
    targets = _left_to_file(test)
    for address, channels in zip(wanted, groups, strict=True):
        target = targets.get(address, "")
        for channel in channels:
            _check_scale(test, label, address, channel)
        for number, channel in enumerate(channels if target else ()):
            if channel.unit_source and not channel.unit:
                raise MeasurementError(
                    f"{label}: the unit of {quote(channel.path)} is not known: {channel.unit_source}; "
                    "name it by unit in the case"
                )
            about = {"file": label, "column": str(address), "unit": channel.unit}
            try:
                factor = quantity(f"1 {sensor_unit(channel.unit or target, target)}", target)
            except RsgenError:
                about["assumed"] = target
                findings[channel.unit, address] = Finding("unit-of-file-unusable", "warning", names=about)
                continue
            if factor != 1:
                about["source"] = channel.unit_source or "the file"
                findings[channel.unit, address] = Finding("unit-of-file", "info", names=about)
            channels[number] = replace(
                channel, values=scaled(channel.values, factor), unit=target, unit_source=""
            )
    return tuple(findings.values())
