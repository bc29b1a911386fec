"""Stepped sine to a response surface: steps found in the force, the settled part fitted by sines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import MeasurementError
from rsgen.common.finding import Finding, quantities
from rsgen.common.tolerances import (
    MAX_TRIAL_STEPS,
    MIN_MISFIT_REDUCTION,
    NOISE_LIMIT_SIGMAS,
    OUTLIER_SIGMAS,
    RELATIVE_CHANGE_NEGLIGIBLE,
    RELATIVE_ERROR_DOUBTFUL,
    ROUND_OFF,
    STANDARD_ERRORS_OF_DIFFERENCE,
    deviation_of_median,
)
from rsgen.data.history.envelope import HARMONICS, displacement_harmonics, highest_order
from rsgen.data.history.record import (
    BLOCK_SAMPLES,
    MAX_IDLE_FORCE,
    MAX_LEVEL_SPREAD,
    NO_SINE,
    TimeHistory,
    as_histories,
    blocks,
    check_force,
    check_options,
    check_response,
    name_levels,
)
from rsgen.data.surface.response_surface import Outcome, ResponseSurface

# ----------------------------------------------------------------------------
# Least-squares fit of a sine and its harmonics, frequency refined (as IEEE 1057 does), block by block.


def _columns(first: int, count: int, omega: float, orders: int, drift: bool, middle: float) -> Array:
    i = np.arange(first, first + count, dtype=np.float64)
    turn = np.exp(1j * omega * i)
    columns, power = [np.ones(count)], np.ones(count, dtype=complex)
    for _ in range(orders):
        power = power * turn
        columns += [power.real, -power.imag]
    if drift:
        columns += [(i - middle) * columns[1], (i - middle) * columns[2]]
    return np.stack(columns, axis=1)


def _solve(signal: NDArray[Any], omega: float, orders: int, drift: bool) -> tuple[Array, float]:
    """Solve the normal equations (the columns are nearly orthogonal); parameters and sum of squares left."""
    n = len(signal)
    middle = (n - 1) / 2
    size = 1 + 2 * orders + (2 if drift else 0)
    gram, right, square, scale = np.zeros((size, size)), np.zeros(size), 0.0, np.ones(size)
    scale[size - 2 :] = 2 / n if drift else 1.0
    for number, block in enumerate(blocks(signal)):
        samples = np.asarray(block, dtype=np.float64)
        columns = _columns(number * BLOCK_SAMPLES, len(samples), omega, orders, drift, middle) * scale
        gram += columns.T @ columns
        right += columns.T @ samples
        square += float(samples @ samples)
    # columns coincide where a harmonic is at the Nyquist frequency
    solution = np.linalg.lstsq(gram, right, rcond=None)[0]
    return solution * scale, max(square - float(solution @ right), 0.0)


def fit_sine(signal: NDArray[Any], omega: float, orders: int) -> tuple[ComplexArray, float]:
    """Fit mean, fundamental and harmonics at a known frequency.

    ``omega`` is the angle a sample [rad]; ``signal`` (n,) lasts at least two periods; the highest of
    ``orders`` is below the Nyquist frequency. Returns (orders + 1,) harmonics Y of
    Re sum_h Y_h exp(i h omega t), t = 0 at the first sample, and the root mean square of the rest, both in
    the unit of the signal.
    """
    p, left = _solve(signal, omega, orders, False)
    harmonics = np.concatenate([[p[0]], p[1::2] + 1j * p[2::2]])
    return harmonics, float(np.sqrt(left / len(signal)))


def refine_frequency(signal: NDArray[Any], omega: float, orders: int) -> float:
    """Refine the frequency of a sine: the phase may not drift along the samples (Gauss and Newton).

    ``omega``, the angle a sample [rad], is at first off by less than half a turn over all samples.
    """
    # each step squares the error; three are usual
    for _ in range(MAX_TRIAL_STEPS):
        p, _ = _solve(signal, omega, orders, True)
        fundamental, drift = complex(p[1], p[2]), complex(p[-2], p[-1])
        if fundamental == 0:
            break
        # Y (1 + i d (t - middle)): the imaginary part of drift over fundamental is the error of omega
        step = float(np.clip((drift / fundamental).imag, -pi / len(signal), pi / len(signal)))
        omega += step
        if abs(step) < ROUND_OFF * omega:
            break
    return omega


_MIN_PERIODS = 8
"""Periods of the shortest step, and those compared before and after an instant: each half has four."""
_MIN_FREQUENCY_CHANGE = 2e-5
"""Relative change of frequency from one step to the next; generators drift by less."""
_MIN_SAMPLES_PER_PERIOD = 20
"""For an estimate of noise by third differences: those of a sine are 0.7 % of it, of noise 4.5 times it."""
_MAX_SETTLING = 5e-3
"""Largest relative difference of the two halves of a part that counts as settled."""
_SETTLED_PARTS = (0.9, 0.75, 0.6, 0.45, 0.3)
"""Last parts of a step; the longest that is settled is used."""
_FORCE_HARMONICS = 2
"""Harmonics of the force that are fitted with its fundamental."""
_TINY = np.finfo(float).tiny
"""Stands for an amplitude of zero in a quotient."""


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    level: float | None
    frequency: float
    force: ComplexArray
    harmonics: ComplexArray
    change: float
    outcome: Outcome
    error: float
    share: float
    line: float
    power: float


def from_stepped_sine(
    histories: TimeHistory | Sequence[TimeHistory],
    *,
    band: tuple[float, float] | None = None,
    harmonics: int = HARMONICS,
) -> ResponseSurface:
    """Turn stepped-sine time histories of one structure into a response surface.

    A step is a stretch of constant frequency and force. Of each, the longest last part whose two halves agree
    within 0.5 %, or within three standard errors of the difference that noise makes, is fitted; what decays
    from half to half is a transient, as that of a first step from rest, and no noise. Where none does, the
    point is marked as not settled, as is one whose response repeats after two periods only.

    Parameters
    ----------
    histories
        One or several.
    band
        (lowest, highest) frequency [Hz] of the steps; everything where None.
    harmonics
        Highest harmonic of the displacement; those above 0.45 of the sampling rate come as NaN.

    Raises
    ------
    MeasurementError
        No force, or no step in it.

    Examples
    --------
    >>> t = np.arange(0, 60, 0.01)
    >>> omega = 2 * np.pi * np.where(t < 30, 5, 6)
    >>> surface = from_stepped_sine(TimeHistory(100, 2 * np.cos(omega * t), 1e-3 * np.cos(omega * t - 1)))
    >>> surface.frequency.round(6).tolist(), surface.amplitude.round(6).tolist(), surface.phase.round(3)
    ([5.0, 6.0], [0.001, 0.001], array([1., 1.]))
    """
    several = as_histories(histories, "stepped sine")
    check_options(several[0].label, band=band, harmonics=harmonics)
    steps: list[_Step] = []
    sweeps: list[NDArray[np.str_]] = []
    findings: list[Finding] = []
    for history in several:
        fitted = _steps_of(history, band, harmonics)
        findings += check_force(history, np.array([s.share for s in fitted]))
        once = [s for s in fitted if s.outcome != Outcome.PERIOD_TWO]
        line, power = (np.array([getattr(s, name) for s in once]) for name in ("line", "power"))
        findings += check_response(history, line, power)
        steps += fitted
        sweeps.append(_directions(np.array([s.frequency for s in fitted])))
    return ResponseSurface(
        level=name_levels([(s.level, abs(s.force[1])) for s in steps]),
        frequency=np.array([s.frequency for s in steps]),
        force=_same_width([s.force for s in steps]),
        harmonics=np.array([s.harmonics for s in steps]),
        sweep=np.concatenate(sweeps),
        outcome=np.array([s.outcome for s in steps]),
        residual=np.array([s.change for s in steps]),
        error=np.array([s.error for s in steps]),
        findings=(*findings, *_unsettled(steps)),
    )


def _unsettled(steps: Sequence[_Step]) -> list[Finding]:
    """Return a doubt where most steps did not settle, as those that are found in a sweep."""
    moving = sum(s.outcome == Outcome.UNSETTLED for s in steps)
    numbers, names = quantities(excluded=moving, points=len(steps)), {"by": "settling"}
    return [Finding("points-excluded", "doubt", "", numbers, names)] if 2 * moving > len(steps) else []


def _steps_of(history: TimeHistory, band: tuple[float, float] | None, harmonics: int) -> list[_Step]:
    """Return the steps of a history in the band; refuse one without any."""
    found = [_fit(history, begin, end, omega, harmonics) for begin, end, omega in _stretches(history)]
    low, high = band or (0.0, np.inf)
    low, high = low * (1 - _MIN_FREQUENCY_CHANGE), high * (1 + _MIN_FREQUENCY_CHANGE)
    fitted = [step for step in found if step and low <= step.frequency <= high]
    if not fitted:
        raise MeasurementError(
            f"{history.label}: no step found in the force{' in the band' if band else ''}: a frequency "
            f"must be held for at least {2 * _MIN_PERIODS} periods, and one that moves all the time is read "
            f'with test.excitation = "swept-sine"; {NO_SINE}'
        )
    return fitted


def _directions(frequency: Array) -> NDArray[np.str_]:
    """Return the direction of each step from the one before; of the first, from the one after."""
    moves = np.diff(frequency)
    moves = np.concatenate([moves[:1], moves]) if len(moves) else np.zeros(1)
    return np.where(moves > 0, "up", np.where(moves < 0, "down", "rest")).astype("U4")


def _crossings(force: NDArray[Any]) -> tuple[Array, Array]:
    """Return upward zero crossings of a force less its mean [samples, interpolated], and its rms between."""
    mean = float(np.mean(force, dtype=np.float64))
    # the offset of a drive may exceed its amplitude
    if abs(mean) > MAX_IDLE_FORCE * float(np.ptp(force)):
        force = force - mean
    loudest = max(float(np.sqrt(np.mean(np.square(block, dtype=np.float64)))) for block in blocks(force))
    up = np.flatnonzero((force[:-1] < 0) & (force[1:] >= 0))
    if not len(up):
        return np.zeros(0), np.zeros(0)
    # a crossing counts if the force was below zero by more than hum and noise since the last one
    guard = max(MAX_IDLE_FORCE * loudest, NOISE_LIMIT_SIGMAS * _noise(force))
    low = np.logical_or.reduceat(force < -guard, np.concatenate([[0], up + 1]))[:-1]
    up = up[low]
    before, after = (np.asarray(force[up + k], dtype=np.float64) for k in (0, 1))
    place = up - before / (after - before)
    energy = np.add.reduceat(np.square(force, dtype=np.float64), up) if len(up) else np.zeros(0)
    return place, np.sqrt(energy / np.maximum(np.append(place[1:], len(force)) - place, 1))


def _noise(force: NDArray[Any]) -> float:
    """Return the white noise of a finely sampled force, by third differences; 0 if coarsely sampled."""
    part = np.asarray(force[:BLOCK_SAMPLES], dtype=np.float64)
    power = np.abs(np.fft.rfft(part - part.mean()))
    if len(part) < _MIN_SAMPLES_PER_PERIOD or np.argmax(power) * _MIN_SAMPLES_PER_PERIOD > len(part):
        # the differences of the sine are larger than those of the noise
        return 0.0
    # standard deviation from the median deviation; third differences have 20 times the variance
    return deviation_of_median(float(np.median(np.abs(np.diff(part, 3))))) / float(np.sqrt(20))


def _slopes(place: Array) -> tuple[Array, Array]:
    """Return the mean period [samples] after each crossing by a straight line, and its residual."""
    views = np.lib.stride_tricks.sliding_window_view(place, _MIN_PERIODS + 1)
    k = np.arange(_MIN_PERIODS + 1) - _MIN_PERIODS / 2
    slope = views @ k / float(k @ k)
    rest = views - views.mean(axis=1, keepdims=True) - slope[:, None] * k
    return slope, np.sqrt(np.mean(rest**2, axis=1))


def _stretches(history: TimeHistory) -> list[tuple[int, int, float]]:
    """Return stretches of constant frequency and force: first and last sample, and angle a sample [rad]."""
    place, rms = _crossings(history.reference)
    if len(place) < 2 * _MIN_PERIODS + 2:
        return []
    slope, rest = _slopes(place)
    before, after = slope[:-_MIN_PERIODS], slope[_MIN_PERIODS:]
    noise = float(np.median(rest)) * np.sqrt(12 / _MIN_PERIODS**3) * np.sqrt(2)
    jump = np.abs(after / before - 1)
    level = np.median(np.lib.stride_tricks.sliding_window_view(rms, _MIN_PERIODS), axis=1)
    level, later = level[: len(jump)], level[_MIN_PERIODS : _MIN_PERIODS + len(jump)]
    louder = np.abs(later - level) / np.maximum(np.maximum(later, level), _TINY)
    least = np.maximum(OUTLIER_SIGMAS * noise / np.minimum(before, after), _MIN_FREQUENCY_CHANGE)
    size = np.maximum(jump / least, louder / MAX_LEVEL_SPREAD)
    edges = [0]
    for i in np.argsort(-size, kind="stable"):
        if size[i] < 1:
            break
        edge = int(i) + _MIN_PERIODS
        if all(abs(edge - other) >= _MIN_PERIODS for other in edges):
            edges.append(edge)
    stretches = []
    for left, right in pairwise([*sorted(edges), len(place) - 1]):
        # the change lies within a period or so of the edge
        left, right = left + 1, right - 1
        if right - left < _MIN_PERIODS or np.median(rms[left:right]) < MAX_IDLE_FORCE * np.max(rms):
            continue
        mean = float(np.polyfit(np.arange(right + 1 - left), place[left : right + 1], 1)[0])
        stretches.append((int(np.ceil(place[left])), int(place[right]), 2 * pi / mean))
    return stretches


def _settled_part(
    history: TimeHistory, begin: int, end: int, omega: float, orders: int
) -> tuple[float, int, bool]:
    """Return the difference of the halves of the longest last part that is settled, and its first sample.

    Where none is, those of the part whose halves differ least, and False.
    """
    change, start = np.inf, begin
    for part in _SETTLED_PARTS:
        first = end - int(part * (end - begin))
        middle = (first + end) // 2
        if middle - first < _MIN_PERIODS * pi / omega:
            break
        refined = refine_frequency(history.reference[first:end], omega, min(orders, _FORCE_HARMONICS))
        one, noise_one = fit_sine(history.response[first:middle], refined, orders)
        two, noise_two = fit_sine(history.response[middle:end], refined, orders)
        size = max(abs(two[1]), _TINY)
        # relative to a response of zero, every change is infinite
        with np.errstate(over="ignore"):
            found = abs(one[1] * np.exp(1j * refined * (middle - first)) - two[1]) / size
            # of two halves that differ by noise alone, the difference has twice the variance of one
            noise = np.hypot(noise_one, noise_two) * np.sqrt(2 / (middle - first))
            doubt = STANDARD_ERRORS_OF_DIFFERENCE * noise / size
        # noise does not decay as a transient does; two standard deviations differ by 1/sqrt(n) of their own
        decays = noise_one > noise_two * (1 + STANDARD_ERRORS_OF_DIFFERENCE / np.sqrt(middle - first))
        if found < (_MAX_SETTLING if decays else max(_MAX_SETTLING, doubt)):
            return float(found), first, True
        if found < change:
            change, start = float(found), first
    return change, start, False


def _repeats_after_two(
    signal: NDArray[Any], omega: float, orders: int, fundamental: float, noise: float
) -> bool:
    """Return whether sines of half the frequency explain most of what others leave (``noise``), and last."""
    halves, left = fit_sine(signal, omega / 2, 2 * orders)
    if abs(halves[1]) < RELATIVE_CHANGE_NEGLIGIBLE * fundamental or left > MIN_MISFIT_REDUCTION * noise:
        return False
    middle = len(signal) // 2
    one, two = (fit_sine(part, omega / 2, 2)[0][1] for part in (signal[:middle], signal[middle:]))
    return bool(abs(one * np.exp(0.5j * omega * middle) - two) < RELATIVE_ERROR_DOUBTFUL * abs(two))


def _significant_harmonics(
    force: NDArray[Any], omega: float, orders: int, fundamental: complex
) -> ComplexArray:
    """Return harmonics (orders + 1,) of a force [N]: zero within its noise, and the mean zero (unknown)."""
    found, left = fit_sine(force, omega, orders)
    heard = np.where(np.abs(found) > NOISE_LIMIT_SIGMAS * left * np.sqrt(2 / len(force)), found, 0)
    heard[0], heard[1] = 0, fundamental
    return np.asarray(heard, dtype=np.complex128)


def _same_width(rows: Sequence[ComplexArray]) -> ComplexArray:
    """Return rows of harmonics as a table (n, K+1), zero where a row has fewer."""
    table = np.zeros((len(rows), max(2, *map(len, rows)) if rows else 2), dtype=np.complex128)
    for row, values in zip(table, rows, strict=True):
        row[: len(values)] = values
    return table


def _fit(history: TimeHistory, begin: int, end: int, omega: float, harmonics: int) -> _Step | None:
    """Fit one step; None where it is too short."""
    orders = highest_order(harmonics, history.rate, omega * history.rate / (2 * pi))
    change, start, settled = _settled_part(history, begin, end, omega, orders)
    if not np.isfinite(change):
        return None
    force = history.reference[start:end]
    omega = refine_frequency(force, omega, min(orders, _FORCE_HARMONICS))
    pushed, left = fit_sine(force, omega, min(orders, _FORCE_HARMONICS))
    fed = float(np.sum(np.abs(pushed[1:]) ** 2)) / 2
    moved, noise = fit_sine(history.response[start:end], omega, orders)
    line = float(np.sum(np.abs(moved[1:]) ** 2)) / 2
    rate = omega * history.rate
    table = displacement_harmonics(moved[None], np.array([rate]), history.quantity, harmonics)
    outcome = Outcome.SETTLED if settled else Outcome.UNSETTLED
    if _repeats_after_two(history.response[start:end], omega, orders, abs(moved[1]), noise):
        outcome = Outcome.PERIOD_TWO
    return _Step(
        level=history.level,
        frequency=rate / (2 * pi),
        force=_significant_harmonics(force, omega, orders, complex(pushed[1])),
        harmonics=table[0],
        change=change,
        outcome=outcome,
        error=float(noise * np.sqrt(2 / len(force)) / max(abs(moved[1]), _TINY)),
        share=fed / max(fed + left**2, _TINY),
        line=line,
        power=line + noise**2,
    )
