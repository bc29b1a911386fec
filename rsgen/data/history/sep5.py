"""Channels as SEP 5 of the SDyPy family has them, in and out: lists of dicts in memory, one a channel.

Source: SDyPy Enhancement Proposal 5, "SDyPy Unified timeseries" (W. Weijtjens and J. Slavic, 2023).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.errors import MeasurementError, RsgenError
from rsgen.data.history.record import TimeHistory, sampling_rate
from rsgen.data.surface.columns import QUANTITIES
from rsgen.formula.units import quantity, sensor_unit

__all__ = ["from_sep5", "to_sep5"]

_NEEDED = ("data", "name", "unit_str")
_KNOWN = (*_NEEDED, "fs", "time", "unit_tex", "start_timestamp", "start_timestamp_format")
_PROHIBITED = ("unit", "timestamp", "signal", "sample_frequency")
_CODES = {"force": "f", "acceleration": "a", "velocity": "v", "displacement": "d"}
"""Codes of quantities, an optional field of the family's own checks (sdypy-sep005)."""
_SAME_RATE = 1e-9
"""Sampling rates closer than this, relatively, are one: instants are rounded."""


def _checked(channels: Sequence[Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Check what the proposal makes compulsory or prohibits; give the channels by name."""
    named: dict[str, Mapping[str, Any]] = {}
    if isinstance(channels, str | Mapping) or not isinstance(channels, Sequence) or not channels:
        raise MeasurementError("SEP 5: a list of dicts, one a channel, is needed")
    folded = {name.replace("_", "").casefold(): name for name in _KNOWN}
    for number, channel in enumerate(channels, start=1):
        label = f"SEP 5: channel {number}"
        if not isinstance(channel, Mapping):
            raise MeasurementError(f"{label}: {type(channel).__name__}; a dict is needed")
        missing = [key for key in _NEEDED if key not in channel]
        if missing or (channel.get("fs") is None and channel.get("time") is None):
            raise MeasurementError(f"{label}: {', '.join(missing) or 'fs or time'} is missing")
        for key in channel:
            meant = folded.get(str(key).replace("_", "").casefold())
            if key in _PROHIBITED or (meant and meant != key):
                also = f"; write {meant}" if meant else ""
                raise MeasurementError(f"{label}: the field {key!r:.40} is prohibited{also}")
        name = channel["name"]
        if not isinstance(name, str) or name in named:
            raise MeasurementError(f"{label}: name {name!r:.40}; a text of its own is needed")
        named[name] = channel
    return named


def _factor(channel: Mapping[str, Any], target: str) -> float | None:
    """Give the factor from the unit of a channel to an SI unit; None where it is none of its dimension."""
    unit = channel["unit_str"]
    if not isinstance(unit, str) or not unit.strip():
        raise MeasurementError(f"SEP 5: {channel['name']!r:.40}: unit_str is empty; the unit is needed")
    try:
        return quantity(f"1 {sensor_unit(unit.strip().replace('²', '^2').replace('µ', 'u'), target)}", target)
    except RsgenError:
        return None


def _samples(channel: Mapping[str, Any], factor: float) -> NDArray[Any]:
    values = np.asarray(channel["data"])
    row = values.reshape(-1) if values.size == max(values.shape, default=0) else values
    if row.ndim != 1 or row.dtype.kind not in "fiu":
        raise MeasurementError(
            f"SEP 5: {channel['name']!r:.40}: {values.dtype} of shape {values.shape}; one row of real "
            "numbers is needed"
        )
    return row if factor == 1 else row * factor


def _sampling(channel: Mapping[str, Any], count: int) -> tuple[float, float]:
    """Give sampling rate [Hz] and first instant [s]."""
    label = f"SEP 5: {channel['name']!r:.40}"
    if channel.get("time") is None:
        rate = channel["fs"]
        if (
            isinstance(rate, bool)
            or not isinstance(rate, int | float | np.number)
            or not isfinite(rate)
            or rate <= 0
        ):
            raise MeasurementError(f"{label}: fs: {rate!r:.40}; a positive number [Hz] is needed")
        return float(rate), 0.0
    instants = np.asarray(channel["time"])
    if instants.shape != (count,) or instants.dtype.kind not in "fiu":
        raise MeasurementError(f"{label}: time of shape {instants.shape}; one instant [s] a sample is needed")
    return sampling_rate(instants, f"{label}: time")


def from_sep5(
    channels: Sequence[Mapping[str, Any]],
    response: str,
    force: str | None = None,
    *,
    level: float | None = None,
) -> TimeHistory:
    """Make a history of two channels of a list as SEP 5 of the SDyPy family has it.

    Parameters
    ----------
    channels
        One dict a channel: ``data``, ``name``, ``unit_str``, and ``fs`` [Hz] or ``time`` [s].
    response, force
        Names of the channels; None: no force was measured. The unit says whether the response is a
        displacement, a velocity or an acceleration; numbers are brought to SI.
    level
        Nominal force amplitude [N], or None.

    Raises
    ------
    MeasurementError
        No list of that form, no such channel, a unit of another quantity or none, channels that were not
        sampled together.

    Examples
    --------
    >>> t = np.arange(200) / 100
    >>> found = from_sep5(
    ...     [
    ...         {"data": np.cos(30 * t), "fs": 100, "name": "F", "unit_str": "kN"},
    ...         {"data": np.sin(30 * t), "fs": 100, "name": "acc", "unit_str": "g"},
    ...     ],
    ...     "acc",
    ...     "F",
    ... )
    >>> found, float(found.reference[0])
    (TimeHistory('acc': 200 samples at 100 Hz, force, acceleration), 1000.0)
    """
    named = _checked(channels)
    for name in (response, force):
        if name is not None and name not in named:
            known = ", ".join(f"{other!r:.40}" for other in list(named)[:8])
            raise MeasurementError(f"SEP 5: no channel is called {name!r:.40}; known: {known}")
    moved = named[response]
    factors = {word: _factor(moved, unit) for word, unit in QUANTITIES.items()}
    kind, factor = next(((w, f) for w, f in factors.items() if f is not None), ("", None))
    if factor is None:
        raise MeasurementError(
            f"SEP 5: {response!r:.40} is in {moved['unit_str']!r:.40}; a displacement, velocity or "
            "acceleration is needed"
        )
    motion = _samples(moved, factor)
    rate, start = _sampling(moved, len(motion))
    drive = None
    if force is not None:
        driven = named[force]
        factor = _factor(driven, "N")
        if factor is None:
            raise MeasurementError(
                f"SEP 5: {force!r:.40} is in {driven['unit_str']!r:.40}; a force is needed"
            )
        drive = _samples(driven, factor)
        other, begin = _sampling(driven, len(drive))
        clocks = {channel.get("start_timestamp") or None for channel in (moved, driven)}
        together = abs(other - rate) <= _SAME_RATE * rate and abs(begin - start) * rate < 0.5
        if not together or len(clocks - {None}) > 1:
            raise MeasurementError(
                f"SEP 5: {force!r:.40} and {response!r:.40} were not sampled together: {other:g} and "
                f"{rate:g} Hz, begun at {begin:g} and {start:g} s"
            )
    return TimeHistory(rate, drive, motion, kind, level, start, response)


def to_sep5(history: TimeHistory) -> list[dict[str, Any]]:
    """Give a history as SEP 5 of the SDyPy family has it: force, where there is one, and response, in SI.

    The first sample is the first instant; ``start`` has no place in the proposal and is left out.

    Examples
    --------
    >>> history = TimeHistory(100, None, np.sin(np.arange(20.0)), "velocity")
    >>> [(channel["name"], channel["unit_str"], channel["fs"]) for channel in to_sep5(history)]
    [('velocity', 'm/s', 100.0)]
    """
    parts = [] if history.force is None else [("force", history.force, "N")]
    parts.append((history.quantity, history.response, QUANTITIES[history.quantity]))
    return [
        {"data": data, "fs": history.rate, "name": name, "unit_str": unit, "quantity": _CODES[name]}
        for name, data, unit in parts
    ]
