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
from rsgen.common.finding import Finding
from rsgen.data.history.envelope import HARMONICS, displacement_harmonics, highest_order
from rsgen.data.history.record import (
    BLOCK,
    NO_SINE,
    QUIET,
    TimeHistory,
    as_histories,
    blocks,
    check_force,
    check_options,
    check_response,
    name_levels,
)
from rsgen.data.surface import ResponseSurface

# ----------------------------------------------------------------------------
# Least-squares fit of a sine and its harmonics, frequency refined (as IEEE 1057 does), block by block.

_ROUNDS = 12
"""Corrections of the frequency at most; three are usual, each squares the error."""
_EXACT = 1e-13
"""Relative correction of the frequency that rounding leaves."""


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
        columns = _columns(number * BLOCK, len(samples), omega, orders, drift, middle) * scale
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
    for _ in range(_ROUNDS):
        p, _ = _solve(signal, omega, orders, True)
        fundamental, drift = complex(p[1], p[2]), complex(p[-2], p[-1])
        if fundamental == 0:
            break
        # Y (1 + i d (t - middle)): the imaginary part of drift over fundamental is the error of omega
        step = float(np.clip((drift / fundamental).imag, -pi / len(signal), pi / len(signal)))
        omega += step
        if abs(step) < _EXACT * omega:
            break
    return omega


_SIDE = 8
"""Periods compared on either side of an instant, and that a step must last: each half then has four."""
_SIGMAS = 6.0
"""A step is a change of period by more than six standard errors of it, which noise alone never is ..."""
_LEAST = 2e-5
"""... and by more than this fraction of it, which generators drift."""
_LOUDER = 0.1
"""A step is also where the force changes by more than this fraction, at the same frequency."""
_GUARD = 0.3
"""A crossing counts after the force was below zero by this fraction of what is quiet ..."""
_CLEAR = 4.0
"""... and by four standard deviations of its noise, which 1 in 30 000 samples exceeds."""
_FINE = 20
"""With 20 samples a period third differences of a sine are 0.7 % of it; those of noise 4.5 times it."""
_SETTLED = 5e-3
"""Largest relative difference of the two halves of a part that counts as settled."""
_DOUBT = 3.0
"""Standard errors by which two settled halves may differ by noise."""
_PARTS = (0.9, 0.75, 0.6, 0.45, 0.3)
"""Last parts of a step; the longest that is settled is used."""
_ON_FORCE = 2
"""Harmonics of the force that are fitted with its fundamental."""
_HEARD = 4.0
"""Standard deviations of its noise by which a harmonic of the force stands out: chance does one in 3000."""
_TINY = np.finfo(float).tiny
"""Stands for an amplitude of zero in a quotient."""


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    level: float | None
    frequency: float
    force: ComplexArray
    harmonics: ComplexArray
    change: float
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
    within 0.5 % is fitted; where none does, the point is marked as not settled.

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
        found = [_fit(history, begin, end, omega, harmonics) for begin, end, omega in _stretches(history)]
        low, high = band or (0.0, np.inf)
        fitted = [s for s in found if s and low * (1 - _LEAST) <= s.frequency <= high * (1 + _LEAST)]
        if not fitted:
            raise MeasurementError(
                f"{history.label}: no step found in the force{' in the band' if band else ''}: a frequency "
                f"must be held for at least {2 * _SIDE} periods; {NO_SINE}"
            )
        findings += check_force(history, np.array([s.share for s in fitted]))
        line, power = (np.array([getattr(s, name) for s in fitted]) for name in ("line", "power"))
        findings += check_response(history, line, power)
        steps += fitted
        sweeps.append(_directions(np.array([s.frequency for s in fitted])))
    change = np.array([s.change for s in steps])
    return ResponseSurface(
        level=name_levels([(s.level, abs(s.force[1])) for s in steps]),
        frequency=np.array([s.frequency for s in steps]),
        force=_same_width([s.force for s in steps]),
        harmonics=np.array([s.harmonics for s in steps]),
        sweep=np.concatenate(sweeps),
        outcome=np.where(change <= _SETTLED, 0, 1),
        residual=change,
        error=np.array([s.error for s in steps]),
        findings=tuple(findings),
    )


def _directions(frequency: Array) -> NDArray[np.str_]:
    """Find each step's direction from the one before; the first one's from the one after."""
    moves = np.diff(frequency)
    moves = np.concatenate([moves[:1], moves]) if len(moves) else np.zeros(1)
    return np.where(moves > 0, "up", np.where(moves < 0, "down", "rest")).astype("U4")


def _crossings(force: NDArray[Any]) -> tuple[Array, Array]:
    """Find where the force crosses zero upwards, between samples, and its rms until the next such place."""
    loudest = max(float(np.sqrt(np.mean(np.square(block, dtype=np.float64)))) for block in blocks(force))
    up = np.flatnonzero((force[:-1] < 0) & (force[1:] >= 0))
    if not len(up):
        return np.zeros(0), np.zeros(0)
    # a crossing counts once the force has been clearly below zero since the last one
    guard = max(_GUARD * QUIET * loudest, _CLEAR * _noise(force))
    low = np.logical_or.reduceat(force < -guard, np.concatenate([[0], up + 1]))[:-1]
    up = up[low]
    before, after = (np.asarray(force[up + k], dtype=np.float64) for k in (0, 1))
    place = up - before / (after - before)
    energy = np.add.reduceat(np.square(force, dtype=np.float64), up) if len(up) else np.zeros(0)
    return place, np.sqrt(energy / np.maximum(np.append(place[1:], len(force)) - place, 1))


def _noise(force: NDArray[Any]) -> float:
    """Estimate the white noise of a force that is sampled finely, by third differences; 0 where it is not."""
    part = np.asarray(force[:BLOCK], dtype=np.float64)
    power = np.abs(np.fft.rfft(part - part.mean()))
    if len(part) < _FINE or np.argmax(power) * _FINE > len(part):
        # the differences are those of the sine
        return 0.0
    return 1.4826 * float(np.median(np.abs(np.diff(part, 3)))) / float(np.sqrt(20))


def _slopes(place: Array) -> tuple[Array, Array]:
    """Mean period over _SIDE periods after each crossing by a straight line, and its residual."""
    views = np.lib.stride_tricks.sliding_window_view(place, _SIDE + 1)
    k = np.arange(_SIDE + 1) - _SIDE / 2
    slope = views @ k / float(k @ k)
    rest = views - views.mean(axis=1, keepdims=True) - slope[:, None] * k
    return slope, np.sqrt(np.mean(rest**2, axis=1))


def _stretches(history: TimeHistory) -> list[tuple[int, int, float]]:
    """Find stretches of constant frequency and force: first and last sample, and angle a sample [rad]."""
    place, rms = _crossings(history.reference)
    if len(place) < 2 * _SIDE + 2:
        return []
    slope, rest = _slopes(place)
    before, after = slope[:-_SIDE], slope[_SIDE:]
    noise = float(np.median(rest)) * np.sqrt(12 / _SIDE**3) * np.sqrt(2)
    jump = np.abs(after / before - 1)
    level = np.median(np.lib.stride_tricks.sliding_window_view(rms, _SIDE), axis=1)
    level, later = level[: len(jump)], level[_SIDE : _SIDE + len(jump)]
    louder = np.abs(later - level) / np.maximum(np.maximum(later, level), _TINY)
    least = np.maximum(_SIGMAS * noise / np.minimum(before, after), _LEAST)
    size = np.maximum(jump / least, louder / _LOUDER)
    edges = [0]
    for i in np.argsort(-size, kind="stable"):
        if size[i] < 1:
            break
        edge = int(i) + _SIDE
        if all(abs(edge - other) >= _SIDE for other in edges):
            edges.append(edge)
    stretches = []
    for left, right in pairwise([*sorted(edges), len(place) - 1]):
        # the change lies within a period or so of the edge
        left, right = left + 1, right - 1
        if right - left < _SIDE or np.median(rms[left:right]) < QUIET * np.max(rms):
            continue
        mean = float(np.polyfit(np.arange(right + 1 - left), place[left : right + 1], 1)[0])
        stretches.append((int(np.ceil(place[left])), int(place[right]), 2 * pi / mean))
    return stretches


def _settled_part(history: TimeHistory, begin: int, end: int, omega: float, orders: int) -> tuple[float, int]:
    """Find the longest last part of a step whose halves agree: their difference, and its first sample."""
    change, start = np.inf, begin
    for part in _PARTS:
        first = end - int(part * (end - begin))
        middle = (first + end) // 2
        if middle - first < _SIDE * pi / omega:
            break
        refined = refine_frequency(history.reference[first:end], omega, min(orders, _ON_FORCE))
        (one, noise_one), (two, noise_two) = (
            fit_sine(part, refined, orders)
            for part in (history.response[first:middle], history.response[middle:end])
        )
        size = max(abs(two[1]), _TINY)
        # relative to a response of zero, every change is infinite
        with np.errstate(over="ignore"):
            found = abs(one[1] * np.exp(1j * refined * (middle - first)) - two[1]) / size
            # of two halves that differ by noise alone, the difference has twice the variance of one
            doubt = _DOUBT * np.hypot(noise_one, noise_two) * np.sqrt(2 / (middle - first)) / size
        if found < max(_SETTLED, doubt):
            return float(min(found, _SETTLED)), first
        if found < change:
            change, start = float(found), first
    return change, start


def _heard(force: NDArray[Any], omega: float, orders: int, fundamental: complex) -> ComplexArray:
    """(orders + 1,) harmonics of a force [N], those within its noise zero; no mean: no sensor holds one."""
    found, left = fit_sine(force, omega, orders)
    heard = np.where(np.abs(found) > _HEARD * left * np.sqrt(2 / len(force)), found, 0)
    heard[0], heard[1] = 0, fundamental
    return np.asarray(heard, dtype=np.complex128)


def _same_width(rows: Sequence[ComplexArray]) -> ComplexArray:
    """(n, K+1) rows of harmonics, those that a row does not have zero."""
    table = np.zeros((len(rows), max(2, *map(len, rows)) if rows else 2), dtype=np.complex128)
    for row, values in zip(table, rows, strict=True):
        row[: len(values)] = values
    return table


def _fit(history: TimeHistory, begin: int, end: int, omega: float, harmonics: int) -> _Step | None:
    """Fit one step; None where it is too short."""
    orders = highest_order(harmonics, history.rate, omega * history.rate / (2 * pi))
    change, start = _settled_part(history, begin, end, omega, orders)
    if not np.isfinite(change):
        return None
    force = history.reference[start:end]
    omega = refine_frequency(force, omega, min(orders, _ON_FORCE))
    pushed, left = fit_sine(force, omega, min(orders, _ON_FORCE))
    fed = float(np.sum(np.abs(pushed[1:]) ** 2)) / 2
    moved, noise = fit_sine(history.response[start:end], omega, orders)
    line = float(np.sum(np.abs(moved[1:]) ** 2)) / 2
    rate = omega * history.rate
    table = displacement_harmonics(moved[None], np.array([rate]), history.quantity, harmonics)
    error = noise * np.sqrt(2 / len(force)) / max(abs(moved[1]), _TINY)
    return _Step(
        level=history.level,
        frequency=rate / (2 * pi),
        force=_heard(force, omega, orders, complex(pushed[1])),
        harmonics=table[0],
        change=change,
        error=float(error),
        share=fed / max(fed + left**2, _TINY),
        line=line,
        power=line + noise**2,
    )
