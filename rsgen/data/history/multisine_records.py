"""Records of a periodic multisine to spectra: the period, the transient, every period line by line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import MeasurementError
from rsgen.common.finding import Finding, Quantity, Severity, quantities
from rsgen.data.history.record import TimeHistory, as_histories, name_levels
from rsgen.data.multisine.spectra import MultisineSpectra, rms
from rsgen.data.surface.columns import DERIVATIVE

_REPEATS = 0.9
"""A force is periodic where it agrees with itself a period later by this much: a tenth of it may be noise."""
_FIRST = 0.995
"""The first lag that agrees within this share of the best one is the period; its multiples agree as well."""
_SHORTEST = 16
"""Samples of the shortest period that is looked for: fewer hold few lines."""
_STEADY = 1.5
"""A period this many times farther from the mean of the last ones than these typically are is transient."""
_CLEAR = 4.0
"""The same of a first period: what is farther off halves on its way to the settled ones."""
_DRIFTS = 0.5
"""A scatter of the settled periods beyond this share of the response is no noise: nothing repeats there."""
_FEWEST = 2
"""Periods of which each shows what the other has in noise."""
ROUND_OFF = 1e-12
"""Of a period's samples through a transform, relative to the response."""
_APART = 1.5
"""Ratios of measured to nominal level that differ by more are no calibration: something is mixed up."""
_AGREE = 2.0
"""A force this many times more or less than its nominal level has another unit: shakers stay nearer to it,
and a peak in place of a root mean square of several lines is off by more."""
_DECAYS = 3.0
"""Two periods that differ this many times more in their first quarter than in their last: noise does not."""
_COPY = 1e-4
"""Lines of force and response that are parallel to this are one signal: a resonance turns the phase."""
_STRETCH = 1 << 19
"""Samples in which the period is looked for: the transform stays small."""

_INSTEAD = (
    "Record a periodic multisine: repeat one random-phase signal without a gap, generator and recorder on "
    "one clock, so that a period is a whole number of samples; ten periods of several levels tell noise from "
    "nonlinearity"
)


def find_period(force: Array, label: str = "time history") -> int:
    """Find the samples of a period from a force (n,) that repeats.

    Raises
    ------
    MeasurementError
        The force does not repeat, or not twice within its record.
    """
    part = np.asarray(force[:_STRETCH], dtype=np.float64)
    part = part - part.mean()
    square = float(part @ part)
    if not square > 0:
        raise MeasurementError(f"{label}: the force is constant; a multisine is needed")
    count = len(part)
    spectrum = np.abs(np.fft.rfft(part, 2 * count)) ** 2
    agrees = np.fft.irfft(spectrum, 2 * count)[: count // 2 + 1]
    # the energy of both overlapping ends, of which noise alone differs
    energy = np.concatenate([[0.0], np.cumsum(part**2)])
    lags = np.arange(len(agrees))
    overlap = np.sqrt(energy[count - lags] * (energy[count] - energy[lags]))
    agrees = agrees / np.maximum(overlap, 1e-300)
    away = int(np.argmax(agrees < 0)) if (agrees < 0).any() else len(agrees)
    first = max(away, _SHORTEST)
    again = agrees[first:]
    best = float(again.max(initial=0.0))
    if best < _REPEATS:
        raise MeasurementError(
            f"{label}: the force does not repeat: no lag up to half of the record agrees by more than "
            f"{best:.0%}; it is random, or its period is no whole number of samples. {_INSTEAD}"
        )
    return first + int(np.argmax(again >= _FIRST * best))


def from_multisine(
    histories: TimeHistory | Sequence[TimeHistory], *, period: int | None = None, transient: int | None = None
) -> MultisineSpectra:
    """Make the spectra of a test from records of a periodic multisine, one a level and realisation.

    Velocity and acceleration are integrated line by line, X = V/(i omega) = -A/omega^2; they have no mean.

    Parameters
    ----------
    histories
        Force and response of each record; the level is its root mean square force where it is not given.
    period
        Samples a period; None: found from the force.
    transient
        Periods left out at the beginning; None: found from the response, record by record.

    Raises
    ------
    MeasurementError
        A force does not repeat, records have different rates, periods or quantities, fewer than two settled
        periods are left, or the response does not settle to a periodic one.
    """
    records = as_histories(histories, "multisine")
    first = records[0]
    for record in records:
        if abs(record.rate / first.rate - 1) > 1e-9 or record.quantity != first.quantity:
            raise MeasurementError(
                f"{record.label}: {record.quantity} at {record.rate:g} Hz; {first.label} has "
                f"{first.quantity} at {first.rate:g} Hz; records of one test need the same"
            )
    length = _common_period(records, period)
    cut = [_periods(record, length) for record in records]
    left = [
        _transient(record, response, transient) for record, (_, response) in zip(records, cut, strict=True)
    ]
    settled = min(len(force) - out for (force, _), out in zip(cut, left, strict=True))
    omega0 = 2 * np.pi * first.rate / length
    rate: ComplexArray = np.asarray(1j * omega0 * np.arange(length // 2 + 1), dtype=np.complex128)
    rate[0] = 1.0
    force = np.stack([f[len(f) - settled :] for f, _ in cut])
    response = np.stack([x[len(x) - settled :] for _, x in cut]) / rate ** DERIVATIVE[first.quantity]
    mean_known = first.quantity == "displacement"
    if not mean_known:
        response[:, :, 0] = 0.0
    copies = _copies(records, force.mean(axis=1), response.mean(axis=1), rate)
    typical = rms(force.mean(axis=1))
    levels = name_levels([(record.level, float(one)) for record, one in zip(records, typical, strict=True)])
    step = Quantity(omega0 / 2 / np.pi, "Hz")
    numbers = quantities(samples=length, periods=settled, left_out=max(left), step=step)
    found = "found" if period is None else "given"
    findings = [f for record in records for f in record.findings]
    findings += [*copies, *_level_findings(records, typical, levels)]
    if transient is None:
        findings += _unsettled(records, length)
    findings.append(Finding("multisine-periods", "info", numbers=numbers, names={"period": found}))
    return MultisineSpectra(
        level=levels,
        omega0=omega0,
        force=force,
        response=response,
        mean_known=mean_known,
        left_out=np.array(left, dtype=np.int64),
        findings=tuple(findings),
    )


def _level_findings(records: Sequence[TimeHistory], typical: Array, levels: Array) -> list[Finding]:
    """Find nominal levels that the forces do not have: some of them, or all by one factor."""
    ratio = typical / levels

    def about(end: int) -> tuple[dict[str, Quantity], dict[str, str]]:
        level, rms_ = Quantity(float(levels[end]), "N"), Quantity(float(typical[end]), "N")
        numbers = {"level": level, "force": rms_, "ratio": Quantity(float(ratio[end]))}
        return numbers, {"record": records[end].label}

    if ratio.max() > _APART * ratio.min():
        ends = (int(np.argmin(ratio)), int(np.argmax(ratio)))
        return [Finding("levels-disagree", "doubt", "", *about(end)) for end in ends]
    if ratio.max() > _AGREE or ratio.min() < 1 / _AGREE:
        return [Finding("levels-in-other-unit", "doubt", "", *about(int(np.argmax(levels))))]
    return []


def _unsettled(records: Sequence[TimeHistory], length: int) -> list[Finding]:
    """Find records of two periods: what the first has of a transient only shows where it decays soon."""
    short, decaying = [record for record in records if len(record) // length <= _FEWEST], []
    for record in short:
        signal = np.asarray(record.response[len(record) - _FEWEST * length :], dtype=np.float64)
        change, quarter = signal[length:] - signal[:length], max(length // 4, 1)
        early, late = (float(np.sqrt(np.mean(part**2))) for part in (change[:quarter], change[-quarter:]))
        if early > _DECAYS * late and early > ROUND_OFF * float(np.abs(signal).max()):
            decaying.append(record)
    severity: Severity = "doubt" if decaying else "info"
    names = {"record": ", ".join(record.label for record in decaying or short)}
    return [Finding("multisine-periods", severity, "", quantities(periods=_FEWEST), names)] if short else []


def _copies(
    records: Sequence[TimeHistory], force: ComplexArray, response: ComplexArray, rate: ComplexArray
) -> list[Finding]:
    """Find records whose response, or a derivative of it, is the force times a number."""
    findings = []
    for record, one, other in zip(records, force[:, 1:], response[:, 1:], strict=True):
        for power in DERIVATIVE.values():
            moved = other * rate[1:] ** power
            size = float(np.linalg.norm(one) * np.linalg.norm(moved))
            if size > 0 and abs(complex(np.vdot(one, moved))) > (1 - _COPY) * size:
                findings.append(Finding("response-copies-force", "doubt", names={"record": record.label}))
                break
    return findings


def _common_period(records: Sequence[TimeHistory], period: int | None) -> int:
    """Samples a period of all records: as given, checked, or found."""
    if period is not None:
        if not 2 <= period <= min(len(record) for record in records) // _FEWEST:
            raise MeasurementError(
                f"multisine: a period of {period} samples; {records[0].label} has {len(records[0])}: at "
                f"least {_FEWEST} periods are needed"
            )
        for record in records:
            _check_repeats(record, period)
        return period
    lengths = [find_period(np.asarray(record.reference), record.label) for record in records]
    for record, length in zip(records, lengths, strict=True):
        if length != lengths[0]:
            raise MeasurementError(
                f"{record.label}: a period has {length} samples, in {records[0].label} {lengths[0]}; records "
                "of one test need the same period"
            )
        _check_repeats(record, length)
    return lengths[0]


def _check_repeats(record: TimeHistory, length: int) -> None:
    """Refuse a force whose later periods are not the same; a clock that drifts shows at the end."""
    force = np.asarray(record.reference, dtype=np.float64)
    whole = len(force) // length
    cut = force[len(force) - whole * length :].reshape(whole, length)
    cut = cut - cut.mean(axis=1, keepdims=True)
    one, other = cut[-1], cut[whole // 2 - 1]
    norm = float(np.sqrt((one @ one) * (other @ other)))
    agrees = float(one @ other) / norm if norm > 0 else 0.0
    if agrees < _REPEATS:
        raise MeasurementError(
            f"{record.label}: the force does not repeat every {length} samples: later periods agree by "
            f"{agrees:.0%}. {_INSTEAD}"
        )


def _periods(record: TimeHistory, length: int) -> tuple[ComplexArray, ComplexArray]:
    """(p, H+1) spectra of force and response of the whole periods, counted from the end of the record."""
    whole = len(record) // length
    parts = []
    for signal in (record.reference, record.response):
        rows = np.asarray(signal[len(signal) - whole * length :], dtype=np.float64).reshape(whole, length)
        spectrum = np.fft.rfft(rows, axis=1) * (2 / length)
        spectrum[:, 0] /= 2
        if length % 2 == 0:
            # half a line: its phase is not known
            spectrum[:, -1] = 0.0
        parts.append(spectrum)
    return parts[0], parts[1]


def _transient(record: TimeHistory, response: ComplexArray, periods: int | None) -> int:
    """Periods to leave out: until the response is as near the mean of the last ones as these are."""
    count = len(response)
    if periods is not None:
        if periods < 0:
            raise MeasurementError(f"multisine: transient: {periods} periods; 0 or more are needed")
        if count - periods < _FEWEST:
            raise MeasurementError(
                f"{record.label}: {periods} of {count} periods are to be left out; {_FEWEST} or more must "
                "remain"
            )
        return periods
    if count <= _FEWEST:
        return 0
    last = response[count // 2 :]
    away = _distance(response, last.mean(axis=0))
    own = away[count // 2 :]
    size = float(rms(last.mean(axis=0)))
    typical = float(np.median(own))
    if typical > _DRIFTS * size:
        raise MeasurementError(
            f"{record.label}: the response does not repeat: its periods differ by {typical / size:.0%} of "
            f"it. Record more periods, until it has settled, or drive it at a lower level. {_INSTEAD}"
        )
    limit = _STEADY * typical + ROUND_OFF * size
    left = int(np.flatnonzero(away <= limit)[0])
    clear = away[0] > _CLEAR * typical + ROUND_OFF * size
    return 0 if clear and not _decays(record, len(record) // count, left) else left


def _decays(record: TimeHistory, length: int, left: int) -> bool:
    """Return whether the first ``left`` periods differ from the settled ones less in their second half.

    A transient that decays steadily to what noise leaves falls by the root of that from half to half; a gain
    that was another one stays as it was, relative to the response.
    """
    whole = len(record) // length
    signal = np.asarray(record.response[len(record) - whole * length :], dtype=np.float64)
    settled = signal[whole // 2 * length :].reshape(-1, length).mean(axis=0)
    steady = np.tile(settled, left)
    early, late = np.array_split(signal[: left * length] - steady, 2)
    own = [float(np.linalg.norm(part)) for part in np.array_split(steady - settled.mean(), 2)]
    falls = float(np.linalg.norm(early)) / max(float(np.linalg.norm(late)), 1e-300)
    return falls * max(1.0, own[1] / max(own[0], 1e-300)) > _STEADY


def _distance(periods: ComplexArray, centre: ComplexArray) -> Array:
    """(p,) root mean square of how far each period is from another one, without the mean."""
    return rms(periods - centre)
