"""The time history of a test: force and one response, sampled together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array, true_runs
from rsgen.common.errors import MeasurementError
from rsgen.common.finding import Finding, Quantity
from rsgen.data.record_set import DERIVATIVE, QUANTITIES
from rsgen.data.surface.columns import group_forces

MAX_IDLE_FORCE = 0.02
"""Largest force, relative to the largest of the record, with the drive off: hum of an amplifier."""
BLOCK_SAMPLES = 2**18
"""Samples worked on at once, 2 MB that fit into a cache: long histories are never copied whole."""
MIN_SAMPLES = 16
"""Samples of the shortest record: two periods of eight."""
_MAX_SAMPLE = 1e30
"""Largest sample; the squares of larger ones would overflow."""
_MAX_JITTER = 0.1
"""Largest error of an instant, relative to the step, as rounding in a text leaves."""
MAX_LEVEL_SPREAD = 0.1
"""Largest relative difference of forces of one level."""


def blocks(values: NDArray[Any]) -> list[NDArray[Any]]:
    """Return samples (n,) in parts of at most ``BLOCK_SAMPLES``, without copying."""
    return [values[start : start + BLOCK_SAMPLES] for start in range(0, len(values), BLOCK_SAMPLES)]


def _samples(values: ArrayLike, name: str, label: str) -> NDArray[Any]:
    """Return samples as a view, without a copy: one dimension, floating point, finite, read-only."""
    array = np.asarray(values)
    if array.dtype not in (np.float32, np.float64):
        if array.dtype.kind not in "iu":
            raise MeasurementError(
                f"{label}: {name}: numbers of kind {array.dtype}; integers or floating point are needed"
            )
        array = array.astype(np.float64)
    if array.ndim != 1:
        raise MeasurementError(f"{label}: {name}: shape {array.shape}; one row of samples is needed")
    for number, block in enumerate(blocks(array)):
        finite = np.abs(block) < _MAX_SAMPLE
        if not finite.all():
            place = number * BLOCK_SAMPLES + int(np.argmin(finite)) + 1
            raise MeasurementError(
                f"{label}: {name}: sample {place} is not finite, or above {_MAX_SAMPLE:g}; fill the gap, or "
                "leave it out by start and stop"
            )
    view = array.view()
    view.flags.writeable = False
    return view


def _number(value: Any, name: str, unit: str, label: str) -> float:
    """Return a number, checked: finite, and positive unless it is the ``start``."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise MeasurementError(f"{label}: {name}: {value!r}; a number of {unit} is needed") from None
    if not isfinite(number) or (number <= 0 and name != "start"):
        asked = "finite" if name == "start" else "positive and finite"
        raise MeasurementError(f"{label}: {name}: {number!r} {unit}; must be {asked}")
    return number


# instants that overflow or are no numbers are refused below
@np.errstate(over="ignore", invalid="ignore")
def sampling_rate(time: NDArray[Any], name: str, rate: float | None = None) -> tuple[float, float]:
    """Return sampling rate [Hz] and first instant [s] of evenly spaced instants (n,) [s], called ``name``.

    A ``rate`` [Hz] that is given is taken if the instants are those of it, each rounded by a step at most.

    Raises
    ------
    MeasurementError
        Fewer than two instants, or they do not rise in even steps, or not in those of the given rate.
    """
    if len(time) < 2:
        raise MeasurementError(f"{name} has {len(time)} instants; at least two are needed")
    first, last = float(time[0]), float(time[-1])
    step = (last - first) / (len(time) - 1)
    if not step > 0:
        raise MeasurementError(f"{name} does not rise; instants one after the other are needed")
    if rate is not None:
        steps = np.diff(time)
        off = np.abs(time - (first + np.arange(len(time)) / rate))
        if not off.max() <= np.median(steps[steps > 0]):
            raise MeasurementError(
                f"{name} has {1 / step:g} instants a second, the rate is {rate:g} Hz: off by up to "
                f"{off.max():.3g} s; leave one of them out"
            )
        return rate, first
    for number, part in enumerate(blocks(time)):
        begin = number * BLOCK_SAMPLES
        off = np.abs(part - (first + step * np.arange(begin, begin + len(part))))
        # also True for NaN
        bad = ~(off <= _MAX_JITTER * step)
        if bad.any():
            raise MeasurementError(
                f"{name}: sample {begin + int(np.argmax(bad)) + 1} is {off[bad][0] / step:.0%} of a step "
                f"off the even spacing of {step:g} s; evenly sampled histories are needed: give the rate, "
                "too, where the time stamps are only rounded, otherwise sample the record anew"
            )
    return 1 / step, first


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TimeHistory:
    """Force and one response of a test, sampled at the same instants.

    Arrays of floats are not copied: a long history may lie in a file that is mapped into memory.

    Parameters
    ----------
    rate
        Samples per second [Hz].
    force
        (n,) [N]; None, or all zero, where nothing was measured (free decay).
    response
        (n,) displacement [m], velocity [m/s] or acceleration [m/s^2].
    quantity
        What the response is: "displacement", "velocity" or "acceleration".
    level
        Nominal force amplitude [N], or None: it is then found from the force.
    start
        Time of the first sample [s].
    label
        Names the history in messages: the file, usually.
    findings
        What was found while it was read, such as units taken from the file.

    Raises
    ------
    MeasurementError
        Rate or level not positive and finite, lengths differ, fewer than 16 samples, a sample that is not
        finite, an unknown quantity.

    Examples
    --------
    >>> t = np.arange(0, 2, 0.01)
    >>> TimeHistory.from_times(t, np.cos(30 * t), 1e-3 * np.sin(30 * t), "velocity", label="run 7")
    TimeHistory('run 7': 200 samples at 100 Hz, force, velocity)
    """

    rate: float
    force: NDArray[Any] | None
    response: NDArray[Any]
    quantity: str = "displacement"
    level: float | None = None
    start: float = 0.0
    label: str = "time history"
    findings: tuple[Finding, ...] = ()

    @classmethod
    def from_times(
        cls,
        time: ArrayLike,
        force: ArrayLike | None,
        response: ArrayLike,
        quantity: str = "displacement",
        *,
        level: float | None = None,
        label: str = "time history",
    ) -> TimeHistory:
        """Make a history from evenly spaced instants ``time`` (n,) [s] in place of the sampling rate."""
        instants = _samples(time, "time", label)
        rate, start = sampling_rate(instants, f"{label}: time")
        # anything array-like: the constructor makes arrays of force and response, as its fields declare them
        history = cls(rate, force, response, quantity, level, start, label)  # type: ignore[arg-type]
        if len(instants) != len(history):
            raise MeasurementError(
                f"{label}: {len(instants)} instants, {len(history)} samples; one instant a sample is needed"
            )
        return history

    def __post_init__(self) -> None:
        for name, unit in (("rate", "Hz"), ("level", "N"), ("start", "s")):
            if getattr(self, name) is not None or name != "level":
                object.__setattr__(self, name, _number(getattr(self, name), name, unit, self.label))
        if self.quantity not in tuple(DERIVATIVE):
            raise MeasurementError(
                f"{self.label}: quantity: {self.quantity!r}; must be one of {', '.join(DERIVATIVE)}"
            )
        object.__setattr__(self, "response", _samples(self.response, "response", self.label))
        if self.force is not None:
            object.__setattr__(self, "force", _samples(self.force, "force", self.label))
            if len(self.force) != len(self.response):
                raise MeasurementError(
                    f"{self.label}: {len(self.force)} samples of force, {len(self.response)} of response; "
                    "one of each an instant is needed"
                )
        if len(self.response) < MIN_SAMPLES:
            raise MeasurementError(
                f"{self.label}: {len(self.response)} samples; at least {MIN_SAMPLES} are needed"
            )

    def __repr__(self) -> str:
        """Size, rate and kind, without the samples."""
        force = "no force" if self.force is None else "force"
        return (
            f"TimeHistory({self.label!r}: {len(self)} samples at {self.rate:g} Hz, {force}, {self.quantity})"
        )

    def __len__(self) -> int:
        """Count the samples."""
        return len(self.response)

    @property
    def reference(self) -> NDArray[Any]:
        """(n,) force [N]; a MeasurementError where none was measured."""
        if self.force is None:
            raise MeasurementError(f"{self.label}: no force; a forced test needs the measured force")
        return self.force


def as_histories(histories: TimeHistory | Sequence[TimeHistory], test: str) -> list[TimeHistory]:
    """Return a list of one or several histories of a ``test``; a MeasurementError if there is none."""
    several = [histories] if isinstance(histories, TimeHistory) else list(histories)
    if not several or not all(isinstance(history, TimeHistory) for history in several):
        raise MeasurementError(f"{test}: one TimeHistory or more are needed")
    return several


def check_options(
    label: str,
    *,
    band: tuple[float, float] | None = None,
    mass: float | None = None,
    harmonics: int = 1,
    points: int = 2,
) -> None:
    """Raise a MeasurementError for a band [Hz], mass [kg], number of harmonics or points out of range."""
    if band is not None and not (len(band) == 2 and 0 <= band[0] < band[1]):
        raise MeasurementError(f"{label}: band: {band!r}; (lowest, highest) frequency in Hz is needed")
    if mass is not None and not (isfinite(mass) and mass > 0):
        raise MeasurementError(f"{label}: mass: {mass!r} kg; must be positive and finite")
    if harmonics < 1:
        raise MeasurementError(f"{label}: harmonics: {harmonics!r}; must be 1 or more")
    if points < 2:
        raise MeasurementError(f"{label}: points: {points!r}; must be 2 or more")


def name_levels(levels: Sequence[tuple[float | None, float]]) -> Array:
    """Return the level (n,) [N] of each sweep: as given, or the mean force of its group to three digits.

    Parameters
    ----------
    levels
        (given [N] or None, typical force [N]) of each.

    Examples
    --------
    >>> name_levels([(None, 4.8213), (None, 4.79), (None, 28.84), (67.0, 66.1)]).tolist()
    [4.81, 4.81, 28.8, 67.0]
    """
    named = np.array([np.nan if level is None else level for level, _ in levels], dtype=np.float64)
    unnamed = np.flatnonzero(np.isnan(named))
    force = np.array([typical for _, typical in levels])[unnamed]
    group = group_forces(force, MAX_LEVEL_SPREAD)
    for number in np.unique(group):
        named[unnamed[group == number]] = float(f"{np.mean(force[group == number]):.3g}")
    return named


_PARTS = 64
"""Of a record, to tell where its force is on."""


def driven_amplitude(force: NDArray[Any]) -> float:
    """Return the amplitude of a sine or sweep (n,), from the parts where it is at least half the largest."""
    parts = np.array([float(np.std(part, dtype=np.float64)) for part in np.array_split(force, _PARTS)])
    return float(2**0.5 * np.median(parts[2 * parts >= parts.max()]))


# ----------------------------------------------------------------------------
# Faults of a record: samples clipped at the end of a range, a response that stands still.

_FLAT_TOP_SAMPLES = 3
"""Equal samples of a flat top; where the steps are coarse, a sine has some of these."""
_MIN_EQUAL_SAMPLES = 32
"""Equal samples, on all flat tops or in one stretch, that coarse steps do not explain."""
_MIN_CLIPPED_RATIO = 8
"""Samples at the limit of a clipped record over those at the next value; a coarse sine has 2.4."""
_MIN_FORCE_CHANGE = 0.2
"""Change of the force, relative to its largest, during which a working sensor does not stand still."""


def clipped_samples(values: NDArray[Any], sign: int) -> int:
    """Return the number of samples on flat tops at the largest (or smallest) value; 0 if not clipped."""
    top = max(float((sign * block).max()) for block in blocks(values))
    next_top, count, on_flat = -np.inf, 0, 0
    for block in blocks(values):
        raised = sign * block.astype(np.float64)
        _, lengths = true_runs(raised == top)
        on_flat += int(lengths[lengths >= _FLAT_TOP_SAMPLES].sum())
        below = raised[raised < top]
        if not below.size or below.max() < next_top:
            continue
        count = (count if below.max() == next_top else 0) + int(np.count_nonzero(below == below.max()))
        next_top = float(below.max())
    clipped = np.isfinite(next_top) and on_flat >= max(_MIN_EQUAL_SAMPLES, _MIN_CLIPPED_RATIO * count)
    return on_flat if clipped else 0


def _stands(history: TimeHistory) -> list[tuple[float, float]]:
    """Return begin and length [s] of stretches of equal response while the force changes."""
    force, response = history.reference, history.response
    least = _MIN_FORCE_CHANGE * max(float(np.abs(block).max()) for block in blocks(force))
    found = []
    for start in range(0, len(response), BLOCK_SAMPLES):
        first, lengths = true_runs(np.diff(response[start : start + BLOCK_SAMPLES]) == 0)
        for begin, length in zip(
            first[lengths >= _MIN_EQUAL_SAMPLES], lengths[lengths >= _MIN_EQUAL_SAMPLES], strict=True
        ):
            moving = force[start + begin : start + begin + length]
            if float(moving.max()) - float(moving.min()) > least:
                found.append((history.start + (start + begin) / history.rate, length / history.rate))
    return found


def record_findings(history: TimeHistory) -> tuple[Finding, ...]:
    """Return findings about clipped or missing samples, which a fit to amplitudes does not show."""
    findings = []
    for name, values in (("force", history.force), ("response", history.response)):
        if values is None:
            continue
        ends = [
            (float(values.max()), clipped_samples(values, 1)),
            (float(values.min()), clipped_samples(values, -1)),
        ]
        samples = sum(count for _, count in ends)
        if samples:
            names = {"record": history.label, "signal": name}
            unit = "N" if name == "force" else QUANTITIES[history.quantity]
            # relative to the median, as amplitudes are: many sensors have an offset
            rest = float(np.median(values))
            limit = min(abs(end - rest) for end, count in ends if count)
            numbers = {"samples": Quantity(samples), "limit": Quantity(limit, unit)}
            findings.append(Finding("range-reached", "warning", "", numbers, names))
    stands = [] if history.force is None else _stands(history)
    if stands:
        begin, length = max(stands, key=lambda stand: stand[1])
        times = Quantity(len(stands))
        numbers = {"times": times, "begin": Quantity(begin, "s"), "length": Quantity(length, "s")}
        findings.append(Finding("response-stands-still", "warning", "", numbers, {"record": history.label}))
    return tuple(findings)


# ----------------------------------------------------------------------------
# Share of the power of force and response at the frequency of the drive and its harmonics.

MIN_POWER_AT_DRIVE = 0.5
"""Share of the power at the frequencies of the drive: below, a force is no sine, and a response has another
cause."""
MIN_CLEAN_POWER = 0.9
"""Share of the power of a force that is as intended; more than a tenth drives the structure, too."""
NO_SINE = (
    'a blow, as of a hammer, is read with test.excitation = "ring-down", a periodic force of many lines with '
    '"multisine" (rsgen.data.history.from_multisine); from a random force no response surface follows: '
    "measure with a stepped or swept sine or a periodic multisine, a level at a time"
)
"""Advice where a force is no steady sine and no sweep."""


def check_force(history: TimeHistory, share: Array) -> list[Finding]:
    """Return findings about the shares (n,) of the power of a force at the frequency of the drive.

    Raises
    ------
    MeasurementError
        The force is no sine.
    """
    typical = float(np.median(share))
    if typical < MIN_POWER_AT_DRIVE:
        raise MeasurementError(
            f"{history.label}: only {typical:.0%} of the power of the force is at the lines that it was read "
            f"at: it is no sine, or its noise hides its steps; {NO_SINE}"
        )
    if typical >= MIN_CLEAN_POWER:
        return []
    names = {"record": history.label, "signal": "force"}
    return [Finding("power-not-at-lines", "doubt", "", {"share": Quantity(typical)}, names)]


def check_response(history: TimeHistory, line: Array, power: Array) -> list[Finding]:
    """Return findings about the power (n,) of a response at lines of the force, and in all [SI^2]."""
    known = np.isfinite(line) & np.isfinite(power)
    total = float(np.sum(power[known]))
    share = min(float(np.sum(line[known])) / total, 1.0) if total > 0 else 1.0
    if share >= MIN_POWER_AT_DRIVE:
        return []
    names = {"record": history.label, "signal": "response"}
    return [Finding("power-not-at-lines", "doubt", "", {"share": Quantity(share)}, names)]
