"""Time histories from files of any format: force and one response, evenly sampled, in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import MeasurementError
from rsgen.finding import Finding
from rsgen.history import TimeHistory
from rsgen.history.record import sampling_rate
from rsgen.measurement.address import show
from rsgen.measurement.data_files import file_label
from rsgen.measurement.file_table import read_channels
from rsgen.measurement.file_units import scaled
from rsgen.measurement.nominal_levels import level_of_file
from rsgen.measurement.plan import HistoryRule, MeasuredTest
from rsgen.measurement.title_units import unit_doubts

__all__ = ["read_histories"]


def _rows(
    path: Path, test: MeasuredTest, wanted: Sequence[int | str], sha256: str | None, findings: list[Finding]
) -> dict[int | str, NDArray[Any]]:
    """Read rows of samples, as they are in the file; a title that contradicts the case is doubted."""
    label = file_label(path)
    groups, found, _ = read_channels(test, path, wanted, sha256)
    findings += found
    rows: dict[int | str, NDArray[Any]] = {}
    for name, channels in zip(wanted, groups, strict=True):
        if len(channels) != 1:
            raise MeasurementError(f"{label}: {show(name)} means {len(channels)} arrays; name one of them")
        values = channels[0].values.reshape(-1)
        if values.size != max(channels[0].values.shape, default=1):
            raise MeasurementError(
                f"{label}: {show(name)}: shape {channels[0].values.shape}; name one channel, as in "
                f"{show(f'{name}[1]')}"
            )
        if values.dtype.kind == "c":
            raise MeasurementError(f"{label}: {show(name)} is complex; samples are real numbers")
        rows[name] = values
    titles = {name: channels[0].path for name, channels in zip(wanted, groups, strict=True)}
    for signal, target in test.signals:
        if signal is not None and signal.samples in rows:
            findings += unit_doubts(test, label, titles, signal, target)
    return rows


def _rate_in(label: str, name: int | str, values: NDArray[Any]) -> float:
    distinct = np.unique(values)
    if len(distinct) != 1 or not (np.isfinite(distinct[0]) and distinct[0] > 0):
        raise MeasurementError(f"{label}: {show(name)} is no sampling rate; one number above 0 is needed")
    return float(distinct[0])


def _history(test: MeasuredTest, rule: HistoryRule, number: int) -> TimeHistory:
    path = test.files[number]
    label = file_label(path)
    force = None if test.force is None else test.force.samples
    response = cast("int | str", test.response.samples)
    apart = bool(test.response_files)
    if force == response and not apart:
        raise MeasurementError(f"{label}: {show(response)} is force and response; they must differ")
    places = (force, rule.time, rule.rate_column, None if apart else response)
    wanted = list(dict.fromkeys(place for place in places if place is not None))
    sha256 = test.sha256[number] if test.sha256 else None
    findings: list[Finding] = []
    rows = _rows(path, test, wanted, sha256, findings) if wanted else {}
    other = _rows(test.response_files[number], test, [response], None, findings) if apart else rows
    start = 0.0
    if rule.time is not None:
        rate, start = sampling_rate(rows[rule.time], f"{label}: {show(rule.time)}")
        rate, start = rate / rule.factor, start * rule.factor
    elif rule.rate_column is not None:
        rate = _rate_in(label, rule.rate_column, rows[rule.rate_column]) * rule.factor
    else:
        rate = rule.rate or 0.0
    for name in (rule.time, rule.rate_column):
        if name is not None and name not in (force, response):
            # a long column of instants is not needed any more
            del rows[name]
    length = len(other[response])
    if force is not None and len(rows[force]) != length:
        raise MeasurementError(
            f"{label}: {len(rows[force])} samples of force, {length} of response; one of each is needed"
        )
    begin = 0 if rule.start is None else max(0, int(np.ceil((rule.start - start) * rate)))
    end = length if rule.stop is None else min(length, int(np.floor((rule.stop - start) * rate)) + 1)
    if end <= begin:
        raise MeasurementError(
            f"{label}: nothing between start and stop; it lasts from {start:g} to {start + length / rate:g} s"
        )
    part = slice(begin, end)
    return TimeHistory(
        rate=rate,
        force=None if force is None else scaled(rows[force][part], test.factor("force")),
        response=scaled(other[response][part], test.factor("response")),
        quantity=test.quantity,
        level=level_of_file(test, number),
        start=start + begin / rate,
        label=label,
        findings=tuple(findings),
    )


def read_histories(test: MeasuredTest) -> list[TimeHistory]:
    """Read the time histories of a test whose plan has a ``history``, one a file.

    Raises
    ------
    MeasurementError
        A file cannot be read as the plan says, its times are not evenly spaced, lengths differ.
    """
    rule = cast("HistoryRule", test.history)
    return [_history(test, rule, number) for number in range(len(test.files))]
