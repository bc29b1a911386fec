"""Sweeps in a time history: where each begins and ends, up or down, and its law, from the force alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, isfinite, log, pi
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import MeasurementError
from rsgen.common.finding import Finding, Quantity
from rsgen.data.free_mode import Kinematics
from rsgen.data.history.envelope import INTEGRATION_INSTANTS, NOISE_WIDTH, Windows, demodulate, place_windows
from rsgen.data.history.record import NO_SINE, TimeHistory, blocks
from rsgen.data.surface.columns import monotone_runs

# ----------------------------------------------------------------------------
# The law of a sweep: frequency against time, linear or logarithmic, given or found from the force.

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
        """Find the frequency [Hz]."""
        if self.kind == "linear":
            return np.asarray(self.frequency + self.rate * t)
        return np.asarray(self.frequency * np.exp2(self.rate * t))

    def slope_at(self, t: Array) -> Array:
        """Find df/dt [Hz/s]."""
        if self.kind == "linear":
            return np.full_like(t, self.rate)
        return np.asarray(log(2) * self.rate * self.frequency_at(t))

    def phase_at(self, t: Array) -> Array:
        """Find the phase [rad], whose derivative is 2 pi f."""
        if self.kind == "linear":
            return np.asarray(self.phase + 2 * pi * t * (self.frequency + 0.5 * self.rate * t))
        growth = log(2) * self.rate
        return np.asarray(self.phase + 2 * pi * self.frequency / growth * np.expm1(growth * t))

    def time_of(self, frequency: float) -> float:
        """Find when a frequency is passed [s]."""
        if self.kind == "linear":
            return (frequency - self.frequency) / self.rate
        # no logarithmic sweep begins at zero
        passed = log(frequency / self.frequency) if frequency > 0 else -inf
        return passed / (log(2) * self.rate)


_LOOKS = 128
"""Spectra along a history that show where the frequency goes: a dozen for each of ten sweeps."""
_FEWEST = 10
"""Spectra, and windows of the refinement, that a sweep must last; shorter ones are a start or a stop."""
_LINES = 0.5
"""Lines of a spectrum over which the frequency must go to be a sweep."""
_NEAR = 2
"""Lines on either side of the strongest that belong to it: the width of a Hann window's main lobe."""
_FAINT = 0.1
"""Parts whose strongest line is below this fraction of the strongest anywhere contain no sweep."""
_TURN = 0.05
"""A sweep has turned when the frequency moves back by this fraction of its range; spectra jitter by less."""
_SWERVE = 0.2
"""After a faint part a sweep goes on within this fraction of the way; a logarithmic one curves by less."""
_PERIODS = 16.0
"""Window of the refinement, in periods: a first law may be off by a sixteenth of the frequency."""
_PLACES = 500
"""Windows of the refinement, once the law is nearly right: their phases fix three numbers."""
_ROUNDS = 4
"""Refinements at most; each leaves the square of the error."""
_STILL = 1e-6
"""A refinement by less [rad at the ends of the sweep] is the last."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """One sweep of a history, from t = ``begin`` to ``end`` [s from the first sample], and its law."""

    begin: float
    end: float
    law: SweepLaw


def find_sweeps(history: TimeHistory, given: SweepLaw | str | None = None) -> tuple[Sweep, ...]:
    """Find the sweeps of a history from its force.

    ``given`` is the law if known, and the history then one sweep; or its kind, "linear" or "logarithmic";
    where None, the kind that fits better.

    Raises
    ------
    MeasurementError
        There is no force, or no sweep in it, or the force does not follow the law.
    """
    time, frequency, loud, line = _ridge(history)
    if isinstance(given, SweepLaw):
        if not loud.any():
            raise MeasurementError(f"{history.label}: the force is zero; a swept sine is needed")
        return (Sweep(float(time[loud][0]), float(time[loud][-1]), given),)
    sweeps = []
    for run in _runs(frequency, loud, line):
        law = _first_law(time[run], frequency[run], given)
        begin, end = float(time[run[0]]), float(time[run[-1]])
        sweeps.append(Sweep(begin, end, _refined(history, law, begin, end)))
    if not sweeps:
        raise MeasurementError(
            f"{history.label}: no sweep found in the force: its frequency must rise or fall over "
            f"{_FEWEST / _LOOKS:.0%} of the history; a stepped sine is read with test.excitation = "
            f'"stepped-sine"; {NO_SINE}'
        )
    return tuple(sweeps)


def _ridge(history: TimeHistory) -> tuple[Array, Array, NDArray[np.bool_], float]:
    """Follow the strongest line of the force: time, frequency, whether loud enough; resolution [Hz]."""
    force = history.reference
    n = len(force)
    length = max(16, min(n, max(2 * n // _LOOKS, round(_PERIODS * history.rate / _typical(history)))))
    starts = np.linspace(0, n - length, min(_LOOKS, n - length + 1)).astype(np.int64)
    taper = np.hanning(length + 2)[1:-1]
    frequency, size = np.zeros(len(starts)), np.zeros(len(starts))
    for i, start in enumerate(starts):
        samples = np.asarray(force[start : start + length], dtype=np.float64)
        power = np.abs(np.fft.rfft((samples - samples.mean()) * taper)) ** 2
        top = int(np.argmax(power[1:])) + 1
        near = slice(max(top - _NEAR, 0), top + _NEAR + 1)
        total = float(power[near].sum())
        place = np.arange(len(power))[near]
        frequency[i] = float(power[near] @ place) / total if total > 0 else 0.0
        size[i] = np.sqrt(total)
    frequency *= history.rate / length
    time = np.asarray((starts + (length - 1) / 2) / history.rate)
    loud = np.asarray((size > _FAINT * size.max(initial=0.0)) & (frequency > 0))
    return time, frequency, loud, history.rate / length


def _typical(history: TimeHistory) -> float:
    """Find a frequency that stands for the force: the mean over its spectrum [Hz]."""
    # a long history is looked at in parts, for the spectrum of the whole costs time and memory
    total, moment = 0.0, 0.0
    for block in blocks(history.reference):
        # squares of large numbers overflow in single precision
        power = np.abs(np.fft.rfft(np.asarray(block, dtype=np.float64))) ** 2
        power[0] = 0.0
        total += float(power.sum())
        moment += float(power @ np.linspace(0, history.rate / 2, len(power)))
    return moment / total if total > 0 else history.rate / 4


def _runs(frequency: Array, loud: NDArray[np.bool_], line: float) -> list[NDArray[np.intp]]:
    """Split where the frequency turns or the force is faint; the spectra resolve a ``line`` [Hz]."""
    # a single spectrum taken in by a disturbance is no turn
    smooth = scipy.ndimage.median_filter(frequency, 3, mode="nearest")
    runs: list[NDArray[np.intp]] = []
    least = max(_TURN * float(np.ptp(smooth[loud])), _LINES * line) if loud.any() else 0.0
    for stretch in _stretches(smooth, loud, line):
        turns = monotone_runs(smooth[stretch], _TURN)
        for number, (start, stop, _) in enumerate(turns):
            # spectra over the turn see both sides: they belong to neither run
            run = stretch[start + (number > 0) : stop - (number < len(turns) - 1)]
            if len(run) >= _FEWEST and np.ptp(smooth[run]) > least:
                runs.append(run)
    return runs


def _stretches(frequency: Array, loud: NDArray[np.bool_], line: float) -> list[NDArray[np.intp]]:
    """Find the loud stretches; those between which one sweep goes on, as where its force fell, are one."""
    stretches: list[NDArray[np.intp]] = []
    for part in np.split(np.arange(len(loud)), np.flatnonzero(np.diff(loud)) + 1):
        if not loud[part[0]]:
            continue
        if stretches and _goes_on(frequency, stretches[-1], part, line):
            stretches[-1] = np.concatenate([stretches[-1], part])
        else:
            stretches.append(part)
    return stretches


def _goes_on(frequency: Array, before: NDArray[np.intp], after: NDArray[np.intp], line: float) -> bool:
    """Return whether the frequency after a faint part continues the line of that before it."""
    if min(len(before), len(after)) < _FEWEST:
        return False
    last, first = before[-_FEWEST:], after[:_FEWEST]
    slope, start = np.polyfit(last, frequency[last], 1)
    other = np.polyfit(first, frequency[first], 1)[0]
    moved = abs(slope) * (first[0] - last[-1])
    led_to = start + slope * first[0]
    return bool(
        slope * other > 0 and abs(frequency[first[0]] - led_to) < max(_NEAR * line, _SWERVE * float(moved))
    )


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
    """Refine a law by the phase that the force has against it."""
    force, rate = history.reference, history.rate
    # at instants whose windows are independent
    dense = np.linspace(begin, end, INTEGRATION_INSTANTS)
    passed = (law.phase_at(dense) - law.phase_at(dense[:1])) / (2 * np.pi * _PERIODS / NOISE_WIDTH)
    time = np.interp(np.arange(int(passed[-1]) + 1), passed, dense)
    for count in range(_ROUNDS):
        if count:
            # the phase no longer drifts by turns, so that few places are enough
            time = time[np.linspace(0, len(time) - 1, min(len(time), _PLACES)).astype(np.intp)]
        period = rate / law.frequency_at(time)
        windows = place_windows(time * rate, _PERIODS * period, period, 1, len(force))
        if len(windows) < _FEWEST:
            break
        law, moved = _shifted(law, force, rate, windows, end - begin)
        if moved < _STILL:
            break
    return law


def _shifted(
    law: SweepLaw, force: NDArray[Any], rate: float, windows: Windows, duration: float
) -> tuple[SweepLaw, float]:
    """Fit phase, frequency and rate of a law to the phase of the force against it; and how far they moved."""
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
            # no frequency below zero, no standing sweep
            return np.full(len(instant), 1e6)
        return np.asarray(weight * (model - lead))

    fit = scipy.optimize.least_squares(misfit, np.zeros(3), loss="soft_l1", f_scale=0.3)
    return candidate(fit.x), float(np.max(np.abs(fit.x)))


# ----------------------------------------------------------------------------
# Findings about sweeps: their pace at resonances, other modes in the band, harmonics of the force.

_OTHER = 0.3
"""Another maximum this high, relative to the highest, is reported ..."""
_VALLEY = 0.5
"""... where the receptance falls to this fraction of it between the two."""
_APART = 0.04
"""Nearer to the highest maximum than this, relatively, another one is of the same mode."""
_HALF_POWER = 0.7
"""Points down to this fraction of the highest receptance are the resonance; a single point may be noise."""
_SLOW = 0.1
"""rate/(zeta f)^2 below which a sweep is slow: it shifts a resonance by less than 2 % of its half width."""
_FAST = 10.0
"""rate/(zeta f)^2 up to which the correction was proved (k(X) within 0.1 %, c(X) within 0.5 %)."""
_SUDDEN = 0.15
"""A correction of the force up to this fraction of it is never called a free motion ..."""
_MORE = 2.0
"""... nor one of up to twice that which the pace asks for at the resonance of its sweep."""
_MAX_SHARE_EXCLUDED = 0.2
"""Share of points excluded for one reason above which the others may not be the test that was meant."""


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


def _sweep_by_sweep(
    parts: list[SweptPoints], steady: ComplexArray, good: NDArray[np.bool_]
) -> Iterator[tuple[SweptPoints, NDArray[np.intp], slice, Array]]:
    """Each sweep that has good points: which of its points, where it stands in all, and their receptance."""
    begin = 0
    for part in parts:
        here = slice(begin, begin + len(part))
        chosen = np.flatnonzero(good[here])
        if len(chosen):
            # of points that are not good the force may be next to nothing
            yield part, chosen, here, np.abs(part.motion.displacement[chosen] / steady[here][chosen])
        begin += len(part)


def fast_sweeps(
    parts: list[SweptPoints],
    steady: ComplexArray,
    damping: Array,
    good: NDArray[np.bool_],
    mass: float,
    origin: str,
) -> list[Finding]:
    """Judge the sweeps at their resonances: a finding about the fastest, none where all are slow.

    The points of all parts, one after the other, have the corrected force ``steady`` [N] and the damping c(X)
    [N s/m]; ``good`` ones are used. ``origin`` says where the mass [kg] is from.
    """
    worst, findings = _SLOW, []
    for part, chosen, here, size in _sweep_by_sweep(parts, steady, good):
        top = chosen[size > _HALF_POWER * size.max()]
        width = float(np.median(damping[here][top])) / (4 * pi * mass)
        rate = float(np.median(part.rate[top]))
        pace = rate / width**2 if width > 0 else np.inf
        if pace <= worst:
            continue
        worst = pace
        change = float(np.median(np.abs(part.force[top] / steady[here][top] - 1)))
        numbers = {
            "rate": Quantity(rate, "Hz/s"),
            "resonance": Quantity(float(np.median(part.drive[top])), "Hz"),
            "half_width": Quantity(width, "Hz"),
            "pace": Quantity(pace),
            "shift": Quantity(pace / (2 * pi)),
            "correction": Quantity(change),
            "mass": Quantity(mass, "kg"),
            "proved_up_to": Quantity(_FAST),
        }
        names = {"record": part.label, "direction": part.direction, "mass": origin}
        findings = [Finding("sweep-rate", "info" if pace <= _FAST else "warning", "", numbers, names)]
    return findings


def other_modes(parts: list[SweptPoints], steady: ComplexArray, good: NDArray[np.bool_]) -> list[Finding]:
    """Find another maximum of the receptance, in the first sweep that has one."""
    for part, chosen, _, size in _sweep_by_sweep(parts, steady, good):
        frequency = part.drive[chosen]
        order = np.argsort(frequency, kind="stable")
        frequency, size = frequency[order], size[order]
        top = int(np.argmax(size))
        for places in (np.arange(top, -1, -1), np.arange(top, len(size))):
            side = size[places]
            away = np.abs(frequency[places] / frequency[top] - 1) > _APART
            # the lowest place on the way out
            valley = np.minimum.accumulate(side)
            height = np.where(away & (side > _OTHER * size[top]) & (valley < _VALLEY * side), side, 0.0)
            if height.any():
                f = Quantity(float(frequency[places[int(np.argmax(height))]]), "Hz")
                return [Finding("another-maximum", "warning", "", {"frequency": f}, {"record": part.label})]
    return []


def _counted(parts: list[SweptPoints], marked: NDArray[np.bool_]) -> dict[str, Quantity]:
    """Count the marked points of all parts, and say where they are."""
    frequency = np.concatenate([part.drive for part in parts])[marked]
    return {
        "excluded": Quantity(float(np.count_nonzero(marked))),
        "points": Quantity(len(marked)),
        "low": Quantity(float(frequency.min()), "Hz"),
        "high": Quantity(float(frequency.max()), "Hz"),
    }


def most_by_pace(
    parts: list[SweptPoints], correction: Array, steady: ComplexArray, good: NDArray[np.bool_]
) -> Array:
    """Find the largest correction (n,), relative to the force, that the pace of each sweep explains.

    The correction of the good points around the resonance is what the pace asks for; a jump asks for more.
    """
    most = np.full(len(good), _SUDDEN)
    for _, chosen, here, size in _sweep_by_sweep(parts, steady, good):
        top = chosen[size > _HALF_POWER * size.max()]
        most[here] = max(_SUDDEN, _MORE * float(np.median(correction[here][top])))
    return most


def free_motion(parts: list[SweptPoints], free: NDArray[np.bool_]) -> list[Finding]:
    """Count the points whose motion is mainly a free one, as after a jump."""
    if not free.any():
        return []
    many = np.mean(free) > _MAX_SHARE_EXCLUDED
    names = {"by": "free motion"}
    return [Finding("points-excluded", "doubt" if many else "info", "", _counted(parts, free), names)]


def faint_forces(parts: list[SweptPoints], faint: NDArray[np.bool_]) -> list[Finding]:
    """Count the points at which the force does not stand out of its noise."""
    if not faint.any():
        return []
    many = np.mean(faint) > _MAX_SHARE_EXCLUDED
    names = {"by": "noise of the force"}
    return [Finding("points-excluded", "doubt" if many else "info", "", _counted(parts, faint), names)]
