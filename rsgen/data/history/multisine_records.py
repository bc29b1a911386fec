"""Spectra from records of a periodic multisine: period, transient, and a transform of every period."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import MeasurementError
from rsgen.common.finding import Finding, Quantity, Severity, quantities
from rsgen.common.tolerances import (
    DEVIATING_MISFIT_RATIO,
    MISFIT_NEGLIGIBLE,
    NOISE_LIMIT_SIGMAS,
    NOISE_RATIO_BY_CHANCE,
    ROUND_OFF,
)
from rsgen.data.history.record import (
    BLOCK_SAMPLES,
    MIN_CLEAN_POWER,
    MIN_POWER_AT_DRIVE,
    MIN_SAMPLES,
    TimeHistory,
    as_histories,
    name_levels,
)
from rsgen.data.multisine.spectra import MultisineSpectra, rms
from rsgen.data.record_set import BASE_UNITS, DERIVATIVE, FILE_ROUND_OFF, LEVEL_TOLERANCE

_MIN_RATIO_TO_BEST = 0.995
"""Correlation at the period over the best at any lag: multiples of the period correlate as well."""
_MIN_PERIODS = 2
"""Of a record: their difference shows the noise of each."""
_MAX_RATIO_OF_SETTLED = NOISE_RATIO_BY_CHANCE
"""Of the distance of a settled period from the mean of the second half, over the typical one."""
_MIN_FALL_OF_TRANSIENT = NOISE_RATIO_BY_CHANCE
"""Of the distance from the settled periods, from the first half of a transient to its second."""
_MIN_DIFFERENCE_OF_COPY = 1e-4
"""One minus the correlation of the lines of force and response; less is one signal, without a mode."""

_INSTEAD = (
    "Record a periodic multisine: repeat one random-phase signal without a gap, generator and recorder on "
    "one clock, so that a period is a whole number of samples; ten periods of several levels tell noise from "
    "nonlinearity"
)


def find_period(force: Array, label: str = "time history") -> int:
    """Return the number of samples of a period, from a force (n,) that repeats.

    Raises
    ------
    MeasurementError
        The force does not repeat, or not twice within its record.
    """
    # two blocks, for a period of one at most: the transform stays small
    part = np.asarray(force[: 2 * BLOCK_SAMPLES], dtype=np.float64)
    part = part - part.mean()
    square = float(part @ part)
    if not square > 0:
        raise MeasurementError(f"{label}: the force is constant; a multisine is needed")
    count = len(part)
    spectrum = np.abs(np.fft.rfft(part, 2 * count)) ** 2
    agrees = np.fft.irfft(spectrum, 2 * count)[: count // 2 + 1]
    # correlation: relative to the energy of the overlapping parts
    energy = np.concatenate([[0.0], np.cumsum(part**2)])
    lags = np.arange(len(agrees))
    overlap = np.sqrt(energy[count - lags] * (energy[count] - energy[lags]))
    agrees = agrees / np.maximum(overlap, 1e-300)
    away = int(np.argmax(agrees < 0)) if (agrees < 0).any() else len(agrees)
    first = max(away, MIN_SAMPLES)
    again = agrees[first:]
    best = float(again.max(initial=0.0))
    if best < MIN_CLEAN_POWER:
        raise MeasurementError(
            f"{label}: the force does not repeat: no lag up to half of the record agrees by more than "
            f"{best:.0%}; it is random, or its period is no whole number of samples. {_INSTEAD}"
        )
    near = np.append(again >= _MIN_RATIO_TO_BEST * best, False)
    begin = int(np.argmax(near))
    # of a force with many samples a cycle, lags next to the period correlate nearly as well
    end = begin + int(np.argmin(near[begin:]))
    return first + begin + int(np.argmax(again[begin:end]))


def from_multisine(
    histories: TimeHistory | Sequence[TimeHistory],
    *,
    period: int | None = None,
    transient: int | None = None,
    base: str = "",
    across: Sequence[TimeHistory] = (),
) -> MultisineSpectra:
    """Return the spectra of a test from records of a periodic multisine, one a level and realisation.

    Rates and periods may differ from record to record. Velocity and acceleration are integrated line by line,
    X = V/(i omega) = -A/omega^2; they have no mean.

    Parameters
    ----------
    histories
        Force and response of each record; the level is its root mean square force where it is not given.
    period
        Samples a period; None: found from the force.
    transient
        Periods left out at the beginning; None: found from the response, record by record.
    base
        "acceleration" where a base is driven: forces are then minus its acceleration, and responses
        relative to it.
    across
        The same records with the motion across two sensors as their response, where elements follow it.

    Raises
    ------
    MeasurementError
        A force does not repeat, records have different quantities, fewer than two settled periods are left,
        or the response does not settle to a periodic one.
    """
    records = as_histories(histories, "multisine")
    _require_one_quantity(records)
    lengths = _period_lengths(records, period)
    cut = [_periods(*pair) for pair in zip((*records, *across), lengths * 2, strict=False)]
    found = [_transient(one, x, transient) for one, (_, x) in zip((*records, *across), cut, strict=True)]
    left = np.reshape(found, (-1, len(records))).max(axis=0)
    settled = min(len(force) - out for (force, _), out in zip(cut, left, strict=False))
    omega0 = 2 * np.pi * np.array([record.rate for record in records]) / lengths
    equal = len(set(lengths)) == 1 and np.allclose(omega0, omega0[0], rtol=FILE_ROUND_OFF, atol=0.0)
    # (r, H+1), as many lines as the longest period has
    rate: ComplexArray = 1j * np.multiply.outer(omega0, np.arange(max(lengths) // 2 + 1))
    rate[:, 0] = 1.0
    force = _stack([f for f, _ in cut[: len(records)]], settled, rate.shape[1])
    response, *others = (
        _stack([x for _, x in part], settled, rate.shape[1])
        / rate[:, None] ** DERIVATIVE[part_of[0].quantity]
        for part, part_of in ((cut[: len(records)], records), (cut[len(records) :], across))
        if part
    )
    mean_known = all(one.quantity == "displacement" for one in (*records, *across))
    for motion in () if mean_known else (response, *others):
        motion[:, :, 0] = 0.0
    copies = _copies(records, force.mean(axis=1), response.mean(axis=1), rate)
    typical = rms(force.mean(axis=1))
    levels = name_levels([(record.level, float(one)) for record, one in zip(records, typical, strict=True)])
    findings = [f for record in records for f in record.findings]
    findings += [*copies, *_level_findings(records, typical, levels, BASE_UNITS[base])]
    if transient is None:
        findings += _unsettled(records, lengths)
    else:
        findings += _begins_early(records, [response for _, response in cut], transient)
    known = "found" if period is None else "given"
    for length, omega in sorted({*zip(lengths, omega0[:1] if equal else omega0, strict=False)}):
        findings.append(_periods_used(length, settled, int(left.max()), float(omega), known))
    return MultisineSpectra(
        level=levels,
        omega0=float(omega0[0]) if equal else omega0,
        force=force,
        response=response,
        mean_known=mean_known,
        left_out=left,
        findings=tuple(findings),
        per_mass=bool(base),
        base=base,
        across=others[0] if others else None,
    )


def _require_one_quantity(records: Sequence[TimeHistory]) -> None:
    """Raise MeasurementError unless the responses of all records are of one quantity."""
    first = records[0]
    for record in records:
        if record.quantity != first.quantity:
            raise MeasurementError(
                f"{record.label}: {record.quantity}; {first.label} has {first.quantity}; records of one test "
                "need the same"
            )


def _periods_used(samples: int, periods: int, left_out: int, omega0: float, known: str) -> Finding:
    """Return how long a period is, how many are used and left out, and the step of their lines."""
    step = Quantity(omega0 / 2 / np.pi, "Hz")
    numbers = quantities(samples=samples, periods=periods, left_out=left_out, step=step)
    return Finding("multisine-periods", "info", numbers=numbers, names={"period": known})


def _stack(spectra: Sequence[ComplexArray], settled: int, lines: int) -> ComplexArray:
    """Return the last ``settled`` periods of spectra (p, H+1), with zeros as the lines that they lack."""
    rows = [np.pad(one[len(one) - settled :], ((0, 0), (0, lines - one.shape[1]))) for one in spectra]
    return np.stack(rows)


def _level_findings(
    records: Sequence[TimeHistory], typical: Array, levels: Array, unit: str
) -> list[Finding]:
    """Return findings about nominal levels that differ from the forces: some, or all by one factor."""
    ratio = typical / levels

    def about(end: int) -> tuple[dict[str, Quantity], dict[str, str]]:
        level, rms_ = Quantity(float(levels[end]), unit), Quantity(float(typical[end]), unit)
        numbers = {"level": level, "force": rms_, "ratio": Quantity(float(ratio[end]))}
        return numbers, {"record": records[end].label}

    if ratio.max() > LEVEL_TOLERANCE * ratio.min():
        ends = (int(np.argmin(ratio)), int(np.argmax(ratio)))
        return [Finding("levels-disagree", "doubt", "", *about(end)) for end in ends]
    if ratio.max() > LEVEL_TOLERANCE or ratio.min() < 1 / LEVEL_TOLERANCE:
        return [Finding("levels-in-other-unit", "doubt", "", *about(int(np.argmax(levels))))]
    return []


def _unsettled(records: Sequence[TimeHistory], lengths: Sequence[int]) -> list[Finding]:
    """Return a finding about records of two periods, where only a short transient can be seen."""
    short, decaying = [], []
    for record, length in zip(records, lengths, strict=True):
        if len(record) // length > _MIN_PERIODS:
            continue
        short.append(record)
        signal = np.asarray(record.response[len(record) - _MIN_PERIODS * length :], dtype=np.float64)
        change, quarter = signal[length:] - signal[:length], max(length // 4, 1)
        early, late = (float(np.sqrt(np.mean(part**2))) for part in (change[:quarter], change[-quarter:]))
        if early > DEVIATING_MISFIT_RATIO * late and early > ROUND_OFF * float(np.abs(signal).max()):
            decaying.append(record)
    severity: Severity = "doubt" if decaying else "info"
    names = {"record": ", ".join(record.label for record in decaying or short)}
    return (
        [Finding("multisine-periods", severity, "", quantities(periods=_MIN_PERIODS), names)] if short else []
    )


def _begins_early(
    records: Sequence[TimeHistory], responses: Sequence[ComplexArray], given: int
) -> list[Finding]:
    """Return findings about records of which less is left out, as given, than shows a transient."""
    findings = []
    for record, response in zip(records, responses, strict=True):
        with suppress(MeasurementError):
            left = _transient(record, response, None)
            settled = response[left:].mean(axis=0)
            noise, first = (float(np.median(rms(r - settled))) for r in (response[left:], response[[given]]))
            share = first / max(float(rms(settled)), 1e-300)
            if left > given and first > NOISE_LIMIT_SIGMAS * noise and share > MISFIT_NEGLIGIBLE:
                numbers = quantities(given=given, found=left, share=share)
                findings.append(Finding("multisine-periods", "doubt", "", numbers, {"record": record.label}))
    return findings


def _copies(
    records: Sequence[TimeHistory], force: ComplexArray, response: ComplexArray, rate: ComplexArray
) -> list[Finding]:
    """Return findings about records whose response, or a derivative, is the force times a number."""
    findings = []
    for record, one, other, by_rate in zip(records, force[:, 1:], response[:, 1:], rate[:, 1:], strict=True):
        for power in DERIVATIVE.values():
            moved = other * by_rate**power
            size = float(np.linalg.norm(one) * np.linalg.norm(moved))
            if size > 0 and abs(complex(np.vdot(one, moved))) > (1 - _MIN_DIFFERENCE_OF_COPY) * size:
                findings.append(Finding("response-copies-force", "doubt", names={"record": record.label}))
                break
    return findings


def _period_lengths(records: Sequence[TimeHistory], period: int | None) -> list[int]:
    """Return the samples of a period of each record: as given, or found; checked."""
    if period is not None and not 2 <= period <= min(len(record) for record in records) // _MIN_PERIODS:
        raise MeasurementError(
            f"multisine: a period of {period} samples; {records[0].label} has {len(records[0])}: at "
            f"least {_MIN_PERIODS} periods are needed"
        )
    lengths = [period or find_period(np.asarray(record.reference), record.label) for record in records]
    for record, length in zip(records, lengths, strict=True):
        _check_repeats(record, length)
    return lengths


def _check_repeats(record: TimeHistory, length: int) -> None:
    """Raise a MeasurementError if later periods of the force differ, as with a clock that drifts."""
    force = np.asarray(record.reference, dtype=np.float64)
    whole = len(force) // length
    cut = force[len(force) - whole * length :].reshape(whole, length)
    cut = cut - cut.mean(axis=1, keepdims=True)
    one, other = cut[-1], cut[whole // 2 - 1]
    norm = float(np.sqrt((one @ one) * (other @ other)))
    agrees = float(one @ other) / norm if norm > 0 else 0.0
    if agrees < MIN_CLEAN_POWER:
        raise MeasurementError(
            f"{record.label}: the force does not repeat every {length} samples: later periods agree by "
            f"{agrees:.0%}. {_INSTEAD}"
        )


def _periods(record: TimeHistory, length: int) -> tuple[ComplexArray, ComplexArray]:
    """Return spectra (p, H+1) of force and response of whole periods, counted from the end of the record."""
    whole = len(record) // length
    parts = []
    for signal in (record.reference, record.response):
        rows = np.asarray(signal[len(signal) - whole * length :], dtype=np.float64).reshape(whole, length)
        spectrum = np.fft.rfft(rows, axis=1) * (2 / length)
        spectrum[:, 0] /= 2
        if length % 2 == 0:
            # the line at the Nyquist frequency has no phase
            spectrum[:, -1] = 0.0
        parts.append(spectrum)
    return parts[0], parts[1]


def _transient(record: TimeHistory, response: ComplexArray, periods: int | None) -> int:
    """Return the number of periods until the response differs from the settled mean by noise only."""
    count = len(response)
    if periods is not None:
        if periods < 0:
            raise MeasurementError(f"multisine: transient: {periods} periods; 0 or more are needed")
        if count - periods < _MIN_PERIODS:
            raise MeasurementError(
                f"{record.label}: {periods} of {count} periods are to be left out; {_MIN_PERIODS} or more "
                "must remain"
            )
        return periods
    if count <= _MIN_PERIODS:
        return 0
    last = response[count // 2 :]
    away = rms(response - last.mean(axis=0))
    own = away[count // 2 :]
    size = float(rms(last.mean(axis=0)))
    typical = float(np.median(own))
    if typical**2 > MIN_POWER_AT_DRIVE * size**2:
        raise MeasurementError(
            f"{record.label}: the response does not repeat: its periods differ by {typical / size:.0%} of "
            f"it. Record more periods, until it has settled, or drive it at a lower level. {_INSTEAD}"
        )
    limit = _MAX_RATIO_OF_SETTLED * typical + ROUND_OFF * size
    left = int(np.flatnonzero(away <= limit)[0])
    clear = away[0] > NOISE_LIMIT_SIGMAS * typical + ROUND_OFF * size
    return 0 if clear and not _decays(record, len(record) // count, left) else left


def _decays(record: TimeHistory, length: int, left: int) -> bool:
    """Return whether the first ``left`` periods differ from the settled ones less in their second half.

    A transient decays; the difference by another gain of the sensor stays constant, relative to the response.
    """
    whole = len(record) // length
    signal = np.asarray(record.response[len(record) - whole * length :], dtype=np.float64)
    settled = signal[whole // 2 * length :].reshape(-1, length).mean(axis=0)
    steady = np.tile(settled, left)
    early, late = np.array_split(signal[: left * length] - steady, 2)
    own = [float(np.linalg.norm(part)) for part in np.array_split(steady - settled.mean(), 2)]
    falls = float(np.linalg.norm(early)) / max(float(np.linalg.norm(late)), 1e-300)
    return falls * max(1.0, own[1] / max(own[0], 1e-300)) > _MIN_FALL_OF_TRANSIENT
