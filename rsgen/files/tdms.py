"""TDMS files of LabVIEW, DIAdem and other programs: groups and channels as a tree of arrays."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from functools import partial
from math import isfinite
from typing import Any, BinaryIO

import numpy as np

from rsgen.common.errors import MeasurementError
from rsgen.files.tree import Node, array_bytes, is_wanted

_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit", "Units", "units")
"""Properties in which DIAdem, LabVIEW and users keep the unit of a channel."""
_READ = "fiubc"
"""Kinds of numbers; texts and instants of a clock are none."""
_PERIODS = ("", "s")


def sample_tdms() -> bytes:
    """Make a small file."""
    from nptdms import ChannelObject, TdmsWriter  # comes with an extra

    file = io.BytesIO()
    with TdmsWriter(file) as written:
        written.write_segment([ChannelObject("a", "b", np.arange(3.0), {"wf_increment": 0.1})])
    return file.getvalue()


def _text(properties: Mapping[str, Any], *names: str) -> str:
    """Return the first of the named properties that is a text, or ""."""
    found = (properties.get(name) for name in names)
    return next((text.strip() for text in found if isinstance(text, str) and text.strip()), "")


def _step(properties: Mapping[str, Any]) -> float:
    """Return the increment of the abscissa of a waveform, or 0."""
    step = properties.get("wf_increment")
    known = isinstance(step, int | float | np.number) and isfinite(step) and step > 0
    return float(step) if known else 0.0  # type: ignore[arg-type]


def _is_sampled(properties: Mapping[str, Any]) -> bool:
    """Return True if the increment of a waveform is a time, as the unit and the name of its abscissa say."""
    frequency = "freq" in _text(properties, "wf_xname").casefold()
    return _text(properties, "wf_xunit_string") in _PERIODS and not frequency


def _rates(group: Any) -> Iterator[Node]:
    """Return the sampling rate of a group's waveforms, of each one where they differ."""
    sampled = [c for c in group.channels() if _step(c.properties) and len(c) and _is_sampled(c.properties)]
    rates = {1 / _step(wave.properties) for wave in sampled}
    single = len(rates) == 1 and "rate" not in {channel.name for channel in group.channels()}
    for wave in sampled[:1] if single else sampled:
        path = f"{group.name}/rate" if single else f"{group.name}/{wave.name}/rate"
        rate = np.array(1 / _step(wave.properties))
        yield Node(path, (), "float64", load=partial(np.asarray, rate), unit="Hz", remark="sampling rate")


def _node(path: str, channel: Any, largest: int) -> Node:
    kind = channel.dtype
    if kind.kind not in _READ:
        what = "instants of a clock" if kind.kind == "M" else "no numbers"
        return Node.refused(path, f"holds {what}; real and complex numbers are read", (len(channel),))
    try:
        array_bytes((len(channel),), kind, largest)
    except MeasurementError as fault:
        return Node.refused(path, str(fault), (len(channel),))
    return Node(
        path, (len(channel),), kind.name, load=lambda: channel[:], title=channel.name,
        unit=_text(channel.properties, *_UNITS),
        remark=_text(channel.properties, "description", "NI_ChannelName"),
    )  # fmt: skip


def walk_tdms(file: BinaryIO, heads: set[str] | None, largest: int) -> Iterator[Node]:
    """Walk through a TDMS file: group/channel, with scalings applied, and group/rate of waveforms.

    Raises
    ------
    MeasurementError
        Cut off, or it declares more numbers than it has bytes.
    """
    from nptdms import TdmsFile  # comes with an extra

    size = file.seek(0, 2)
    file.seek(0)
    book = TdmsFile.open(file)
    status = book.file_status
    chunks = (status.channel_statuses or {}).values()
    if status.incomplete_final_segment or any(c.read_length < c.expected_length for c in chunks):
        raise MeasurementError(
            "its last segment is not whole, so it is cut off; close the recording, send it again"
        )
    channels = [channel for group in book.groups() for channel in group.channels()]
    # numbers are not packed in this format
    declared = sum(len(c) * (c.data_type.size or 0) for c in channels if c.data_type is not None)
    if declared > size:
        raise MeasurementError(f"declares {declared} bytes of numbers; the file has {size}, so it is damaged")
    for group in book.groups():
        if not is_wanted(group.name, heads):
            continue
        for channel in group.channels():
            yield _node(f"{group.name}/{channel.name}", channel, largest)
        yield from _rates(group)
