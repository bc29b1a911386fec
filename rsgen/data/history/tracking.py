"""Sweeps in a time history: begin, end and law of each, found from the force alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, isfinite, log, pi
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import MeasurementError
from rsgen.common.finding import Finding, Quantity, Severity, quantities, severity_of
from rsgen.common.tolerances import RELATIVE_ERROR_DOUBTFUL, SUBSAMPLE_POINTS
from rsgen.data.free_mode import Kinematics
from rsgen.data.history.envelope import (
    REFERENCE_PASSES,
    Windows,
    demodulate,
    independent_instants,
    place_windows,
)
from rsgen.data.history.record import MIN_SAMPLES, NO_SINE, TimeHistory, blocks
from rsgen.data.surface.columns import monotone_runs
from rsgen.data.surface.response_surface import HALF_POWER

# ----------------------------------------------------------------------------
# Law of a sweep: frequency against time, linear or logarithmic, given or found from the force.

LAWS = ("linear", "logarithmic")


@dataclass(frozen=True, slots=True)
class SweepLaw:
    """Frequency of the force against time, t in s from the first sample.

    Parameters
    ----------
    kind
        "linear": f = frequency + rate t; "logarithmic": f = frequency 2^(rate t).
    frequency
        At t = 0 [Hz].
    rate
        [Hz/s] or [octaves/s]; negative downwards.
    phase
        At t = 0 [rad].

    Raises
    ------
    MeasurementError
        An unknown kind, a frequency that is not positive, a rate that is zero or not finite.
    """

    kind: str
    frequency: float
    rate: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in LAWS:
            raise MeasurementError(f"sweep law: {self.kind!r}; must be one of {', '.join(LAWS)}")
        if not (isfinite(self.frequency) and self.frequency > 0):
            raise MeasurementError(f"sweep law: starts at {self.frequency!r} Hz; must be above 0")
        if not isfinite(self.rate) or self.rate == 0:
            raise MeasurementError(f"sweep law: rate {self.rate!r}; must be finite and not 0")

    @property
    def direction(self) -> str:
        """ "up" or "down"."""
        return "up" if self.rate > 0 else "down"

    def frequency_at(self, t: Array) -> Array:
        """Return the frequency (n,) [Hz] at instants (n,) [s]."""
        if self.kind == "linear":
            return np.asarray(self.frequency + self.rate * t)
        return np.asarray(self.frequency * np.exp2(self.rate * t))

    def slope_at(self, t: Array) -> Array:
        """Return df/dt (n,) [Hz/s]."""
        if self.kind == "linear":
            return np.full_like(t, self.rate)
        return np.asarray(log(2) * self.rate * self.frequency_at(t))

    def phase_at(self, t: Array) -> Array:
        """Return the phase (n,) [rad], whose derivative is 2 pi f."""
        if self.kind == "linear":
            return np.asarray(self.phase + 2 * pi * t * (self.frequency + 0.5 * self.rate * t))
        growth = log(2) * self.rate
        return np.asarray(self.phase + 2 * pi * self.frequency / growth * np.expm1(growth * t))

    def time_of(self, frequency: float) -> float:
        """Return the instant [s] of a frequency [Hz]."""
        if self.kind == "linear":
            return (frequency - self.frequency) / self.rate
        # no logarithmic sweep begins at zero
        passed = log(frequency / self.frequency) if frequency > 0 else -inf
        return passed / (log(2) * self.rate)


_SPECTRA = 128
"""Of a history, which show its frequency: a dozen for each of ten sweeps."""
_MIN_SPECTRA = 10
"""Of a sweep, and windows of its refinement; shorter ones are a start or a stop."""
_MIN_LINES = 0.5
"""Lines of a spectrum over which the frequency of a sweep changes."""
_MAIN_LOBE_LINES = 2
"""Lines on either side of the strongest that belong to it, with a Hann window."""
_MIN_LINE_RATIO = 0.1
"""Of the strongest line in a part of a sweep to the strongest of the history."""
_MIN_TURN = 0.05
"""Change of frequency, relative to its range, by which a sweep turns back; that of noise is smaller."""
_MAX_CURVATURE = 0.2
"""Deviation of the frequency after a gap from the straight line, relative to its change in the gap."""
_REFINEMENT_PERIODS = 16.0
"""Of a window of the refinement: the first law may be off by a sixteenth of the frequency."""
_PHASE_CHANGE_NEGLIGIBLE = 1e-6
"""A refinement by less [rad at the ends of the sweep] is the last."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """One sweep of a history, from t = ``begin`` to ``end`` [s from the first sample], and its law."""

    begin: float
    end: float
    law: SweepLaw


def find_sweeps(history: TimeHistory, given: SweepLaw | str | None = None) -> tuple[Sweep, ...]:
    """Return the sweeps of a history, found from its force.

    ``given`` is the law if known, and the history then one sweep; or its kind, "linear" or "logarithmic";
    None: the kind that fits better.

    Raises
    ------
    MeasurementError
        There is no force, or no sweep in it, or the force does not follow the law.
    """
    time, frequency, loud, resolution = _ridge(history)
    if isinstance(given, SweepLaw):
        if not loud.any():
            raise MeasurementError(f"{history.label}: the force is zero; a swept sine is needed")
        return (Sweep(float(time[loud][0]), float(time[loud][-1]), given),)
    sweeps = []
    for run in _runs(frequency, loud, resolution):
        law = _first_law(time[run], frequency[run], given)
        begin, end = float(time[run[0]]), float(time[run[-1]])
        sweeps.append(Sweep(begin, end, _refined(history, law, begin, end)))
    if not sweeps:
        raise MeasurementError(
            f"{history.label}: no sweep found in the force: its frequency must rise or fall over "
            f"{_MIN_SPECTRA / _SPECTRA:.0%} of the history; a stepped sine is read with test.excitation = "
            f'"stepped-sine"; {NO_SINE}'
        )
    return tuple(sweeps)


def _ridge(history: TimeHistory) -> tuple[Array, Array, NDArray[np.bool_], float]:
    """Return time [s], frequency [Hz] and significance of the strongest line, and the resolution [Hz]."""
    force = history.reference
    n = len(force)
    wanted = max(2 * n // _SPECTRA, round(_REFINEMENT_PERIODS * history.rate / _typical(history)))
    length = max(MIN_SAMPLES, min(n, wanted))
    starts = np.linspace(0, n - length, min(_SPECTRA, n - length + 1)).astype(np.int64)
    taper = np.hanning(length + 2)[1:-1]
    frequency, size = np.zeros(len(starts)), np.zeros(len(starts))
    for i, start in enumerate(starts):
        samples = np.asarray(force[start : start + length], dtype=np.float64)
        power = np.abs(np.fft.rfft((samples - samples.mean()) * taper)) ** 2
        top = int(np.argmax(power[1:])) + 1
        near = slice(max(top - _MAIN_LOBE_LINES, 0), top + _MAIN_LOBE_LINES + 1)
        total = float(power[near].sum())
        place = np.arange(len(power))[near]
        frequency[i] = float(power[near] @ place) / total if total > 0 else 0.0
        size[i] = np.sqrt(total)
    frequency *= history.rate / length
    time = np.asarray((starts + (length - 1) / 2) / history.rate)
    loud = np.asarray((size > _MIN_LINE_RATIO * size.max(initial=0.0)) & (frequency > 0))
    return time, frequency, loud, history.rate / length


def _typical(history: TimeHistory) -> float:
    """Return the mean frequency of the spectrum of the force [Hz]."""
    # in parts: one spectrum of a long history costs time and memory
    total, moment = 0.0, 0.0
    for block in blocks(history.reference):
        # squares of large numbers overflow in single precision
        power = np.abs(np.fft.rfft(np.asarray(block, dtype=np.float64))) ** 2
        power[0] = 0.0
        total += float(power.sum())
        moment += float(power @ np.linspace(0, history.rate / 2, len(power)))
    return moment / total if total > 0 else history.rate / 4


def _runs(frequency: Array, loud: NDArray[np.bool_], resolution: float) -> list[NDArray[np.intp]]:
    """Return the runs of spectra, of a resolution [Hz], without a turn of the frequency or a gap."""
    # a single spectrum with a disturbance is no turn
    smooth = scipy.ndimage.median_filter(frequency, 3, mode="nearest")
    runs: list[NDArray[np.intp]] = []
    least = max(_MIN_TURN * float(np.ptp(smooth[loud])), _MIN_LINES * resolution) if loud.any() else 0.0
    for stretch in _stretches(smooth, loud, resolution):
        turns = monotone_runs(smooth[stretch], _MIN_TURN)
        for number, (start, stop, _) in enumerate(turns):
            # spectra over the turn have both frequencies, and belong to neither run
            run = stretch[start + (number > 0) : stop - (number < len(turns) - 1)]
            if len(run) >= _MIN_SPECTRA and np.ptp(smooth[run]) > least:
                runs.append(run)
    return runs


def _stretches(frequency: Array, loud: NDArray[np.bool_], resolution: float) -> list[NDArray[np.intp]]:
    """Return the stretches with a force; one sweep on both sides of a gap, where the force fell, is one."""
    stretches: list[NDArray[np.intp]] = []
    for part in np.split(np.arange(len(loud)), np.flatnonzero(np.diff(loud)) + 1):
        if not loud[part[0]]:
            continue
        if stretches and _goes_on(frequency, stretches[-1], part, resolution):
            stretches[-1] = np.concatenate([stretches[-1], part])
        else:
            stretches.append(part)
    return stretches


def _goes_on(frequency: Array, before: NDArray[np.intp], after: NDArray[np.intp], resolution: float) -> bool:
    """Return whether the frequency after a gap continues the line of that before it."""
    if min(len(before), len(after)) < _MIN_SPECTRA:
        return False
    last, first = before[-_MIN_SPECTRA:], after[:_MIN_SPECTRA]
    slope, start = np.polyfit(last, frequency[last], 1)
    other = np.polyfit(first, frequency[first], 1)[0]
    moved = abs(slope) * (first[0] - last[-1])
    led_to = start + slope * first[0]
    most = max(_MAIN_LOBE_LINES * resolution, _MAX_CURVATURE * float(moved))
    return bool(slope * other > 0 and abs(frequency[first[0]] - led_to) < most)


def _first_law(time: Array, frequency: Array, kind: str | None) -> SweepLaw:
    """Fit a law to frequencies (n,) [Hz] of spectra at instants (n,) [s], robustly."""
    best: tuple[float, SweepLaw] | None = None
    spread = float(np.ptp(frequency))
    for name in LAWS if kind is None else (kind,):
        logarithmic = name == "logarithmic"
        start = np.polyfit(time, np.log2(frequency) if logarithmic else frequency, 1)
        first = np.array([2.0 ** start[1] if logarithmic else start[1], start[0]])

        def misfit(p: Array, logarithmic: bool = logarithmic) -> Array:
            model = p[0] * np.exp2(np.clip(p[1] * time, -60, 60)) if logarithmic else p[0] + p[1] * time
            return np.asarray((model - frequency) / spread)

        fit = scipy.optimize.least_squares(
            misfit, first, loss="soft_l1", f_scale=2e-3, x_scale=np.abs(first) + 1e-12
        )
        if fit.x[0] > 0 and fit.x[1] != 0 and (best is None or fit.cost < best[0]):
            best = float(fit.cost), SweepLaw(name, float(fit.x[0]), float(fit.x[1]))
    if best is None:
        raise MeasurementError("sweep law: no law fits the frequency of the force; give it")
    return best[1]


def _refined(history: TimeHistory, law: SweepLaw, begin: float, end: float) -> SweepLaw:
    """Return a law refined by the phase of the force relative to it."""
    force, rate = history.reference, history.rate
    first = law
    time = independent_instants(lambda t: _REFINEMENT_PERIODS / first.frequency_at(t), begin, end)
    for count in range(REFERENCE_PASSES):
        if count:
            # the phase no longer changes by whole turns between windows, so that fewer are enough
            time = time[np.linspace(0, len(time) - 1, min(len(time), SUBSAMPLE_POINTS)).astype(np.intp)]
        period = rate / law.frequency_at(time)
        windows = place_windows(time * rate, _REFINEMENT_PERIODS * period, period, 1, len(force))
        if len(windows) < _MIN_SPECTRA:
            break
        law, moved = _shifted(law, force, rate, windows, end - begin)
        if moved < _PHASE_CHANGE_NEGLIGIBLE:
            break
    return law


def _shifted(
    law: SweepLaw, force: NDArray[Any], rate: float, windows: Windows, duration: float
) -> tuple[SweepLaw, float]:
    """Return a law with phase, frequency and rate refitted to the force, and the largest change [rad]."""
    envelope = demodulate(force, rate, law.phase_at, windows, (1,))[:, 0, 0]
    instant = windows.middle / rate
    lead = np.unwrap(np.angle(envelope))
    weight = np.abs(envelope) / np.max(np.abs(envelope))
    scale = np.array([1.0, 1 / duration, 1 / duration**2])
    if law.kind == "logarithmic":
        scale[2] /= float(law.frequency_at(instant).max())

    def candidate(p: Array) -> SweepLaw:
        phase, frequency, rate = (p * scale).tolist()
        return SweepLaw(law.kind, law.frequency + frequency, law.rate + rate, law.phase + phase)

    def misfit(p: Array) -> Array:
        try:
            model = candidate(p).phase_at(instant) - law.phase_at(instant)
        except MeasurementError:
            # a frequency below zero or a rate of zero is no law
            return np.full(len(instant), 1e6)
        return np.asarray(weight * (model - lead))

    fit = scipy.optimize.least_squares(misfit, np.zeros(3), loss="soft_l1", f_scale=0.3)
    return candidate(fit.x), float(np.max(np.abs(fit.x)))


# ----------------------------------------------------------------------------
# Findings about sweeps: their pace at resonances, points that are excluded.

_SLOW_PACE = 0.1
"""rate/(zeta f)^2 below which a sweep shifts a resonance by less than 2 % of its half width."""
_PROVED_PACE = 10.0
"""rate/(zeta f)^2 up to which the correction was proved (k(X) within 0.1 %, c(X) within 0.5 %)."""
_LOST_PACE = 100.0
"""rate/(zeta f)^2 from which damping was off by more than 5 % in 14 of 44 virtual sweeps that were identified
(noise to 3 %), at most by 41 %; below, in 1 of 59, by 8 %."""
_UNCORRECTED_PACE = 1.0
"""rate/(half width)^2 above which a sweep that is not corrected is doubtful, by the half width as it looks:
cubic terms of virtual sweeps were off by an eighth."""
_MIN_FREE_CORRECTION = 0.15
"""Correction over the force of a point that is mainly a free motion ..."""
_MIN_CORRECTION_RATIO = 2.0
"""... and over the correction at the resonance of the sweep, which follows from its pace."""


class MovingMass(NamedTuple):
    """Moving mass [kg], its origin, the correction, relative to the force, for which it is accurate, and the
    relative difference from the mass of the flanks, where both are known: so far the correction is in doubt.
    """

    value: float
    origin: str
    good_to: float
    difference: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class SweptPoints:
    """The n points of one sweep.

    ``force`` (n,) [N] and ``motion`` are of the fundamental, ``harmonics`` (n, H+1) the displacement [m],
    ``drive`` (n,) is the frequency of the force [Hz], ``rate`` (n,) how fast it changes [Hz/s], positive.
    ``flattened``, ``smoothed`` and ``unclear`` (n,) are the relative differences of A/X, of X and of the
    force between two windows; ``findings`` are those about its force and response.
    """

    label: str
    level: float | None
    direction: str
    force: ComplexArray
    motion: Kinematics
    harmonics: ComplexArray
    drive: Array
    rate: Array
    flattened: Array
    smoothed: Array
    unclear: Array
    findings: tuple[Finding, ...]

    def __len__(self) -> int:
        """Count the points."""
        return len(self.force)


def sweep_by_sweep(
    parts: list[SweptPoints], force: ComplexArray, good: NDArray[np.bool_]
) -> Iterator[tuple[SweptPoints, NDArray[np.intp], slice, Array]]:
    """Yield each sweep with good points: their places in it, its place in all points, their receptance."""
    begin = 0
    for part in parts:
        here = slice(begin, begin + len(part))
        chosen = np.flatnonzero(good[here])
        if len(chosen):
            # only good points: the force of others may be zero
            yield part, chosen, here, np.abs(part.motion.displacement[chosen] / force[here][chosen])
        begin += len(part)


def fast_sweeps(
    parts: list[SweptPoints],
    steady: ComplexArray,
    good: NDArray[np.bool_],
    moving: MovingMass | None = None,
    damping: Array | None = None,
) -> list[Finding]:
    """Return a finding about the fastest sweep at its resonance; none where all are slow and corrected.

    The points of all parts, one after the other, have the corrected force ``steady`` [N] and the damping c(X)
    [N s/m]; ``good`` ones are used. Without a mass the force was not corrected, and the half width is that
    of the measured resonance, which a fast sweep makes wider. The resonance is "beyond" where the receptance
    does not fall to half power on both sides of its largest value.
    """
    worst, findings = _SLOW_PACE, [Finding("sweep-rate", "warning")] if moving is None else []
    for part, chosen, here, size in sweep_by_sweep(parts, steady, good):
        top = chosen[size > HALF_POWER * size.max()]
        # at most: the next points on both sides are below half power
        spacing = float(np.ptp(part.drive[chosen])) / max(len(chosen) - 1, 1)
        width = float(np.ptp(part.drive[top])) / 2 + spacing
        # a channel of the other sign feeds energy
        if moving and damping is not None and (typical := float(np.median(damping[here][top]))) > 0:
            width = typical / (4 * pi * moving.value)  # zeta f = c/(4 pi m)
        rate = float(np.median(part.rate[top]))
        pace = rate / width**2 if width > 0 else inf
        if pace <= worst:
            continue
        worst = pace
        # a jump is no middle of what lies above half power
        largest = top[np.argmax(np.abs(part.motion.displacement[top]))]
        numbers = quantities("Hz", resonance=part.drive[largest], half_width=width)
        numbers |= quantities(rate=Quantity(rate, "Hz/s"), pace=pace, shift=pace / (2 * pi))
        names = {"record": part.label, "direction": part.direction}
        if top[0] == chosen[0] or top[-1] == chosen[-1]:
            names["resonance"] = "beyond"
        severity = severity_of(pace, _UNCORRECTED_PACE, inf)
        if moving:
            change = float(np.median(np.abs(part.force[top] / steady[here][top] - 1)))
            doubted = change * moving.difference
            numbers |= quantities(mass=Quantity(moving.value, "kg"), proved_up_to=_PROVED_PACE)
            numbers |= quantities(correction=change, left=doubted)
            names["mass"] = moving.origin
            severity = "info" if pace <= _PROVED_PACE else severity_of(pace, _LOST_PACE, inf)
            if severity == "doubt":
                names["doubt"] = "pace"
            elif severity == "info" and change > 1:
                severity, names["doubt"] = "warning", "size"
            if doubted > RELATIVE_ERROR_DOUBTFUL:
                severity, names["doubt"] = "doubt", "mass"
        findings = [Finding("sweep-rate", severity, "", numbers, names)]
    return findings


def most_by_pace(
    parts: list[SweptPoints], correction: Array, steady: ComplexArray, good: NDArray[np.bool_]
) -> Array:
    """Return the largest correction (n,), relative to the force, that the pace of each sweep explains.

    It follows from the correction of the good points around the resonance; that of a jump is larger.
    """
    most = np.full(len(good), _MIN_FREE_CORRECTION)
    for _, chosen, here, size in sweep_by_sweep(parts, steady, good):
        top = chosen[size > HALF_POWER * size.max()]
        explained = _MIN_CORRECTION_RATIO * float(np.median(correction[here][top]))
        most[here] = max(_MIN_FREE_CORRECTION, explained)
    return most


_MAX_SHARE_FOR_ONE_REASON = 0.2
"""Share of the points of all sweeps that may be excluded for one reason without a doubt. It is
no share of outliers of a fit (``MAX_SHARE_OF_OUTLIERS``)."""


def excluded_points(parts: list[SweptPoints], marked: NDArray[np.bool_], reason: str) -> list[Finding]:
    """Return a finding about the points (n,) that are excluded for a reason; none where none are."""
    if not marked.any():
        return []
    frequency = np.concatenate([part.drive for part in parts])[marked]
    numbers = quantities(excluded=float(np.count_nonzero(marked)), points=len(marked))
    names = {"by": reason}
    if len(frequency) == 1:
        records = np.repeat([part.label for part in parts], [len(part) for part in parts])
        names["where"] = f"{records[marked][0]} at {frequency[0]:.5g} Hz"
    else:
        numbers |= quantities("Hz", low=frequency.min(), high=frequency.max())
    severity: Severity = "doubt" if np.mean(marked) > _MAX_SHARE_FOR_ONE_REASON else "info"
    return [Finding("points-excluded", severity, "", numbers, names)]
