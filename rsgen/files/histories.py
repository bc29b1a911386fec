"""Time histories from files of any format: force and response, evenly sampled, in SI units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError, quote, shown_path
from rsgen.common.finding import Finding, quantities
from rsgen.data.history import TimeHistory
from rsgen.data.history.record import sampling_rate
from rsgen.files.column_titles import contradiction, unit_doubts, unit_in
from rsgen.files.data_files import recognise_format
from rsgen.files.file_table import file_of, read_channels, scaled
from rsgen.files.inspection import clues
from rsgen.files.inspection.listing import list_contents
from rsgen.files.nominal_levels import level_of_file
from rsgen.files.plan import HERTZ, SECONDS, HistoryRule, MeasuredTest
from rsgen.files.tree import Entry, StoredArray
from rsgen.formula.units import sensor_size

_TIME_TOLERANCE = 1e-6
"""Of a sample: start and stop as near to one are the instant of it."""


def _rows(
    path: Path, test: MeasuredTest, wanted: Sequence[int | str], sha256: str | None, findings: list[Finding]
) -> dict[int | str, NDArray[Any]]:
    """Read rows of samples as they are in the file, and instants [s]; a title against the case is doubted."""
    label = shown_path(path)
    groups, found, _ = read_channels(test, path, wanted, sha256)
    findings += found
    rows: dict[int | str, NDArray[Any]] = {}
    for name, channels in groups.items():
        if len(channels) != 1:
            raise MeasurementError(
                f"{label}: {quote(name)} means {len(channels)} arrays; name one of them, or write each "
                "record to a file of its own: of time histories a file is one level"
            )
        values = channels[0].values.reshape(-1)
        if values.size != max(channels[0].values.shape, default=1):
            raise MeasurementError(
                f"{label}: {quote(name)}: shape {channels[0].values.shape}; name one channel, as in "
                f"{quote(f'{name}[1]')}"
            )
        if values.dtype.kind == "c":
            raise MeasurementError(f"{label}: {quote(name)} is complex; samples are real numbers")
        rule = cast("HistoryRule", test.history)
        if name == rule.time:
            values = _in_si(label, channels[0], findings, "s", rule.unit)
        elif name == rule.rate_column and all(name != channel.samples for channel in test.sources):
            values = _in_si(label, channels[0], findings, "Hz")
        rows[name] = values
    titles = {name: channels[0].path for name, channels in groups.items()}
    for channel in test.sources:
        if channel.samples in rows:
            findings += unit_doubts(test, label, titles, channel)
    return rows


_PER_SECOND = re.compile(r"(?:1|Sa?|samples?)/s\Z")
"""Units of a sampling rate that are hertz."""


def _in_si(
    label: str, column: StoredArray, findings: list[Finding], target: str, unit: str | None = None
) -> NDArray[Any]:
    """Return instants or rates (n,) in s or Hz, by the unit in the case or else in the file.

    A file that names another unit than the case is doubted, a rate in a unit that is none of rates refused.
    """
    said = sensor_size(_PER_SECOND.sub("Hz", column.unit), target)
    # a rate called f_s has no unit
    if target == "Hz" and said is None and column.unit and not column.path.lower().endswith("f_s"):
        raise MeasurementError(
            f"{label}: {quote(column.path)} is in {column.unit}; a sampling rate in Hz or kHz is needed, or "
            "the number under rate"
        )
    size = SECONDS[unit] if unit else said or 1.0
    if said is not None and said != size:
        findings.append(contradiction(label, column.path, unit or target, column.unit))
    elif size != 1 and not unit:
        about = {"file": label, "column": column.path, "unit": column.unit}
        about["source"] = column.unit_source or "the file"
        # a rate has no unit in the case
        about |= {"of": "rate"} if target == "Hz" else {}
        findings.append(Finding("unit-of-file", "info", names=about))
    return scaled(column.values.reshape(-1), size)


_SAMPLING_RATE = re.compile(r"(?i)f_?s$|f?samp|abtast")
"""Names of a sampling rate, not of a sweep, of frames or of a decay, where no unit says that it is one."""

_MAX_RATE_ERROR = 1e-3
"""Of a rate against the instants in the file: clocks are better, and instants rounded to a step of them."""


def _doubts_of_file(test: MeasuredTest, path: Path, rate: float | None, length: int) -> list[Finding]:
    """Doubt units of channels, and the rate [Hz] of a record, where the file contradicts them."""
    found: list[Finding] = []
    if rate is None and recognise_format(path) == "csv":
        return found
    with suppress(MeasurementError):
        contents = list_contents(path)
        entries = clues.readable(contents)
        declared = [sensor_size(channel.unit or channel.si_unit, "m/s^2") for channel in test.sources]
        # titles with a unit in them were compared, as all those of a text
        for entry in entries if contents.format != "csv" else ():
            for one in clues.channels_of(entry, contents):
                titles: dict[int | str, str] = {
                    one.path: f"{', '.join(filter(None, (one.path, one.title)))} [{one.unit}]"
                }
                for channel in test.sources:
                    place = re.sub(r"\[(?::,)?(\d+)(?:,:)?\]\Z", r"[\1]", str(channel.samples))
                    target = test.unit_of(channel)
                    if one.unit_source == clues.FOR_ALL and (
                        target == "N" or sensor_size(one.unit, "m/s^2") in declared
                    ):
                        continue
                    if one.unit and place == one.path and unit_in(place) != one.unit:
                        read = replace(channel, samples=place, unit=channel.unit or target)
                        found += unit_doubts(test, shown_path(path), titles, read)
        for entry in entries:
            rates, error = ([], 0.0) if rate is None else _rates_by(test, path, entry, length)
            if rate and rates and not any(abs(one / rate - 1) < error for one in rates):
                names = {"file": shown_path(path), "column": clues.called(entry)}
                # so many digits that files of one rate are joined
                numbers = quantities("Hz", given=rate, fitted=float(f"{rates[0]:.4g}"))
                found.append(Finding("fixed-contradicted", "doubt", "rate", numbers, names))
                break
    return found


def _rates_by(test: MeasuredTest, path: Path, entry: Entry, length: int) -> tuple[list[float], float]:
    """Return the rates [Hz] that an array may say, by its unit or by any, and their relative error."""
    seconds = [SECONDS[entry.unit]] if entry.unit in SECONDS else [*SECONDS.values()]
    asked = test.history is not None and test.history.rate_column is None
    if asked and entry.size < length and entry.low is not None and 0 < entry.low == entry.high:
        steps = [1 / (entry.low * unit) for unit in seconds]
        if clues.INCREMENT(entry) or (clues.RATE(entry) and entry.unit in SECONDS):
            return steps, _MAX_RATE_ERROR
        # a number without a unit counts kHz only up to 1 MHz
        usual = [HERTZ["Hz"], *[HERTZ["kHz"]] * (entry.low < HERTZ["kHz"])]
        hertz = [HERTZ[entry.unit]] if entry.unit in HERTZ else usual
        named = not entry.unit and _SAMPLING_RATE.match(clues.last_name(entry))
        known = clues.RATE(entry) and (entry.unit in HERTZ or named)
        return [entry.low * unit for unit in hertz] if known else [], _MAX_RATE_ERROR
    if entry.size != length or not (clues.TIME(entry) or entry.unit in SECONDS):
        return [], 0.0
    place = int(entry.path) if entry.path.isdigit() else entry.path
    stamps = np.asarray(
        read_channels(test, path, [place], None)[0][place][0].values.ravel(), dtype=np.float64
    )
    span, steps_of = stamps[-1] - stamps[0], np.diff(stamps)
    even = np.linspace(stamps[0], stamps[-1], length)
    # also False for NaN
    if not (np.all(steps_of >= 0) and span > 0 and np.all(np.abs(stamps - even) < _MAX_UNEVEN * span)):
        return [], 0.0
    error = _MAX_RATE_ERROR + 2 * float(np.min(steps_of[steps_of > 0])) / span
    return [(length - 1) / (span * unit) for unit in seconds], error


_MAX_UNEVEN = 0.01
"""Of the length of a record, by which its instants are off an even spacing where the clock was read late."""


_HALF_WIDTH_OF_SINC = 48
"""Samples on either side of the sinc that shifts by a part of a sample: good to 1e-4 up to 0.47 of the
sampling rate, beyond which no channel is trusted."""

_KAISER_BETA = 9.0
"""Of the Kaiser window over these: side lobes of 1e-4 and less."""


def shifted(samples: NDArray[Any], delay: float) -> Array:
    """Move samples to earlier times by ``delay`` samples; what lies beyond the ends is their last value.

    By whole samples, and by a part of one with a windowed sinc.

    Examples
    --------
    >>> shifted(np.array([0.0, 1.0, 2.0, 3.0]), 1).tolist()
    [1.0, 2.0, 3.0, 3.0]
    """
    whole = int(np.round(delay))
    part = delay - whole
    place = np.clip(np.arange(len(samples)) + whole, 0, len(samples) - 1)
    moved = np.asarray(samples, dtype=np.float64)[place]
    if part == 0:
        return moved
    taps = np.arange(-_HALF_WIDTH_OF_SINC, _HALF_WIDTH_OF_SINC + 1)
    away = (taps - part) / (_HALF_WIDTH_OF_SINC + 1)
    kernel = np.sinc(taps - part) * np.i0(_KAISER_BETA * np.sqrt(1 - away**2))
    padded = np.pad(moved, _HALF_WIDTH_OF_SINC, mode="edge")
    # x(t + part) is the sum of x(k) sinc(t + part - k)
    return np.asarray(np.convolve(padded, kernel[::-1] / kernel.sum(), mode="valid"))


@dataclass(frozen=True, slots=True, eq=False)
class _Record:
    """The samples of the channels of a record, in the order of ``test.sources``, from one file or several."""

    test: MeasuredTest
    rate: float
    start: float
    samples: list[NDArray[Any]]
    findings: list[Finding]

    def sum(self, what: str, part: slice) -> NDArray[Any] | None:
        """Samples of what the test makes of its channels, in SI; None where it makes nothing."""
        total: NDArray[Any] | None = None
        for factor, channel in self.test.terms(what):
            values = self.samples[self.test.sources.index(channel)]
            if abs(channel.delay) * self.rate >= len(values):
                raise MeasurementError(
                    f"{what}: {channel.delay:g} s of delay; the record lasts {len(values) / self.rate:g} s"
                )
            if channel.delay:
                values = shifted(values, channel.delay * self.rate)
            values = scaled(values[part], factor * self.test.scale_of(channel))
            total = values if total is None else total + values
        return total


def _record(test: MeasuredTest, rule: HistoryRule, number: int) -> _Record:
    main = test.files[number]
    label = shown_path(main)
    files = [file_of(test, channel, number) for channel in test.sources]
    places = [cast("int | str", channel.samples) for channel in test.sources]
    if len(set(zip(files, places, strict=True))) < len(places) and test.channels is None:
        raise MeasurementError(f"{label}: {quote(places[-1])} is force and response; they must differ")
    wanted: dict[Path, list[int | str]] = {}
    for path, place in zip(files, places, strict=True):
        wanted.setdefault(path, []).append(place)
    for timing in (rule.time, rule.rate_column):
        if timing is not None:
            wanted.setdefault(main, []).append(timing)
    findings: list[Finding] = []
    rows = {}
    for path, names in wanted.items():
        sha256 = test.sha256[number] if test.sha256 and path == main else None
        rows[path] = _rows(path, test, list(dict.fromkeys(names)), sha256, findings)
    rate, start = rule.rate or 0.0, 0.0
    if rule.time is not None:
        rate, start = sampling_rate(rows[main][rule.time], f"{label}: {quote(rule.time)}", rule.rate)
    elif rule.rate_column is not None:
        distinct = np.unique(rows[main][rule.rate_column])
        rate = float(distinct[0]) if len(distinct) == 1 else 0.0
        if not (isfinite(rate) and rate > 0):
            what = quote(rule.rate_column)
            raise MeasurementError(f"{label}: {what} is no sampling rate; one number above 0 is needed")
    samples = [rows[path][place] for path, place in zip(files, places, strict=True)]
    # the titles of a text were compared as it was read, and with instants of their own texts have no rate
    text = rule.time is not None and recognise_format(main) == "csv"
    findings += _doubts_of_file(test, main, None if text else rate, len(samples[0]))
    lengths = {len(values) for values in samples}
    if len(lengths) > 1:
        counts = ", ".join(
            f"{len(values)} of {quote(place)}" for values, place in zip(samples, places, strict=True)
        )
        raise MeasurementError(f"{label}: samples differ in number: {counts}; as many of each are needed")
    return _Record(test, rate, start, samples, findings)


_MIN_RATIO_OF_CUT = 1.5
"""Of the largest response before a given start to that after it, which a decay has that begins before."""


def _cut_findings(label: str, samples: NDArray[Any], part: slice) -> list[Finding]:
    """Find that the larger part of a decay (n,) lies before the start that the case gives."""
    size = np.abs(samples[: part.stop] - np.median(samples[part]))
    before, after = (float(np.max(one, initial=0.0)) for one in (size[: part.start], size[part.start :]))
    if before <= _MIN_RATIO_OF_CUT * after:
        return []
    numbers = quantities(ratio=before / max(after, float(np.finfo(float).tiny)))
    return [Finding("decay-taken", "warning", "", numbers, {"record": label})]


def _histories(test: MeasuredTest, rule: HistoryRule, number: int) -> list[TimeHistory]:
    """One file as the history of each of its motions."""
    label, record = shown_path(test.files[number]), _record(test, rule, number)
    rate, start, length = record.rate, record.start, len(record.samples[-1])
    # a sample that lies on start or stop, but for round-off, is between them
    begin = 0 if rule.start is None else max(0, int(np.ceil((rule.start - start) * rate - _TIME_TOLERANCE)))
    end = length
    if rule.stop is not None:
        end = min(length, int(np.floor((rule.stop - start) * rate + _TIME_TOLERANCE)) + 1)
    if end <= begin:
        raise MeasurementError(
            f"{label}: nothing between start and stop; it lasts from {start:g} to {start + length / rate:g} s"
        )
    part = slice(begin, end)
    findings = record.findings
    if rule.excitation == "ring-down":
        # of several sensors one is enough
        findings = [*findings, *_cut_findings(label, record.samples[-1], part)]
    force, base = record.sum("force", part), record.sum("base", part)
    motions = {what: cast("NDArray[Any]", record.sum(what, part)) for what in test.motions}
    if base is not None:
        # per mass, on the motion relative to the base
        force = -base
        if test.base is not None and test.base.response == "absolute":
            motions["response"] = motions["response"] - base
    return [
        TimeHistory(
            rate=rate,
            force=force,
            response=samples,
            quantity=test.quantity_of(what),
            level=level_of_file(test, number),
            start=start + begin / rate,
            label=label,
            findings=tuple(findings),
        )
        for what, samples in motions.items()
    ]


def read_motions(test: MeasuredTest) -> list[list[TimeHistory]]:
    """Read the time histories, one a file, of each motion: the response, then that across where one is asked.

    Raises
    ------
    MeasurementError
        A file cannot be read as the plan says, its times are not evenly spaced, lengths differ.
    """
    rule = cast("HistoryRule", test.history)
    files = [_histories(test, rule, number) for number in range(len(test.files))]
    return [list(histories) for histories in zip(*files, strict=True)]
