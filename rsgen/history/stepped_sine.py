"""Stepped sine to a response surface: steps found in the force, the settled part fitted by sines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import MeasurementError
from rsgen.history.levels import name_levels
from rsgen.history.record import BLOCK, TimeHistory
from rsgen.history.sine import fit_sine, refine_frequency
from rsgen.surface import ResponseSurface

__all__ = ["fit_steps"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

HARMONICS = 5
_NYQUIST = 0.45

_SIDE = 8
"""Periods on either side of an instant that are compared to see whether a step begins there."""

_SIGMAS = 6.0
"""A step is a change of period by more than so many standard errors of it ..."""

_LEAST = 2e-5
"""... and by more than this fraction of it."""

_LOUDER = 0.1
"""A step is also where the force changes by more than this fraction, at the same frequency."""

_QUIET = 0.02
"""Force below this fraction of its largest rms contains no step."""

_SETTLED = 5e-3
"""Largest relative difference of the two halves of a part that counts as settled."""

_PARTS = (0.9, 0.75, 0.6, 0.45, 0.3)
"""Last parts of a step, the longest that is settled is used."""

_SHORTEST = 4.0
"""Periods that a half must last."""


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    level: float | None
    frequency: float
    force: complex
    harmonics: ComplexArray
    change: float
    error: float


def fit_steps(
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
    """
    several = [histories] if isinstance(histories, TimeHistory) else list(histories)
    if not several:
        raise MeasurementError("stepped sine: no time history; at least one is needed")
    steps: list[_Step] = []
    runs: list[int] = []
    for history in several:
        found = [
            step
            for begin, end, omega in _stretches(history)
            if (step := _fit(history, begin, end, omega, band, harmonics)) is not None
        ]
        if not found:
            raise MeasurementError(
                f"{history.label}: no step found in the force: a frequency must be held for at least "
                f"{2 * _SIDE} periods"
            )
        steps += found
        runs.append(len(found))
    frequency = np.array([s.frequency for s in steps])
    change = np.array([s.change for s in steps])
    level = name_levels([(s.level, abs(s.force)) for s in steps])
    return ResponseSurface(
        level=level,
        frequency=frequency,
        force=np.array([s.force for s in steps]),
        harmonics=np.array([s.harmonics for s in steps]),
        sweep=np.concatenate([_directions(part) for part in np.split(frequency, np.cumsum(runs)[:-1])]),
        outcome=np.where(change <= _SETTLED, 0, 1),
        residual=change,
        error=np.array([s.error for s in steps]),
    )


def _directions(frequency: Array) -> NDArray[np.str_]:
    """Tell each step's direction from the one before; the first one's from the one after."""
    if len(frequency) < 2:
        return np.full(len(frequency), "rest", dtype="U4")
    moves = np.sign(np.diff(frequency))
    moves = np.concatenate([moves[:1], moves])
    return np.where(moves > 0, "up", np.where(moves < 0, "down", "rest")).astype("U4")


def _crossings(force: NDArray[Any]) -> tuple[Array, Array]:
    """Find where the force crosses zero upwards, between samples, and its rms until the next such place."""
    n = len(force)
    loudest = 0.0
    for first in range(0, n, BLOCK):
        block = np.asarray(force[first : first + BLOCK], dtype=np.float64)
        loudest = max(loudest, float(np.sqrt(np.mean(block**2))))
    if loudest == 0:
        return np.zeros(0), np.zeros(0)
    places: list[Array] = []
    squares: list[Array] = []
    armed, total = False, 0.0
    guard = 0.3 * _QUIET * loudest
    for first in range(0, n, BLOCK):
        # one sample more, so that no crossing falls between blocks
        block = np.asarray(force[first : first + BLOCK + 1], dtype=np.float64)
        up = np.flatnonzero((block[:-1] < 0) & (block[1:] >= 0))
        # a crossing counts once the force has been clearly below zero since the last one
        below = np.concatenate([[0], np.cumsum(block < -guard)])
        since = np.diff(np.concatenate([[0], below[up + 1]])) > 0
        if len(since):
            since[0] |= armed
        armed = bool(below[-1] > (below[up[-1] + 1] if len(up) else 0)) or (armed and not len(up))
        up = up[since]
        places.append(first + up - block[up] / (block[up + 1] - block[up]))
        power = np.concatenate([[0.0], np.cumsum(block[:-1] ** 2)])
        squares.append(total + power[up])
        total += float(power[-1])
    crossing = np.concatenate(places)
    energy = np.concatenate([*squares, [total]]) if len(crossing) else np.zeros(1)
    last = np.append(crossing[1:], n)
    return crossing, np.sqrt(np.maximum(np.diff(energy) / np.maximum(last - crossing, 1), 0.0))


def _slopes(place: Array) -> tuple[Array, Array]:
    """Mean period over _SIDE periods after each crossing by a straight line, and its residual."""
    views = np.lib.stride_tricks.sliding_window_view(place, _SIDE + 1)
    k = np.arange(_SIDE + 1) - _SIDE / 2
    slope = views @ k / float(k @ k)
    rest = views - views.mean(axis=1, keepdims=True) - slope[:, None] * k
    return slope, np.sqrt(np.mean(rest**2, axis=1))


def _stretches(history: TimeHistory) -> list[tuple[int, int, float]]:
    """Find stretches of constant frequency and force: first and last sample, and angle a sample [rad]."""
    place, loud = _crossings(history.reference)
    if len(place) < 2 * _SIDE + 2:
        return []
    slope, rest = _slopes(place)
    before, after = slope[:-_SIDE], slope[_SIDE:]
    period = np.minimum(before, after)
    noise = float(np.median(rest)) * np.sqrt(12 / _SIDE**3) * np.sqrt(2)
    jump = np.abs(after / before - 1)
    level = np.array([np.median(loud[i : i + _SIDE]) for i in range(len(loud) - _SIDE)])
    louder = np.abs(level[_SIDE : _SIDE + len(jump)] / np.maximum(level[: len(jump)], 1e-300) - 1)
    louder = np.minimum(
        louder, np.abs(level[: len(jump)] / np.maximum(level[_SIDE : _SIDE + len(jump)], 1e-300) - 1)
    )
    size = np.maximum(jump / np.maximum(_SIGMAS * noise / period, _LEAST), louder / _LOUDER)
    edges = [0]
    for i in np.argsort(-size, kind="stable"):
        if size[i] < 1:
            break
        edge = int(i) + _SIDE
        if all(abs(edge - other) >= _SIDE for other in edges):
            edges.append(edge)
    edges = [*sorted(edges), len(place) - 1]
    quiet = _QUIET * float(np.max(loud))
    stretches = []
    for left, right in pairwise(edges):
        # the change lies within a period or so of the edge
        left, right = left + 1, right - 1
        if right - left < 2 * _SHORTEST or np.median(loud[left:right]) < quiet:
            continue
        k = np.arange(left, right + 1)
        mean = float(np.polyfit(k - left, place[left : right + 1], 1)[0])
        stretches.append((int(np.ceil(place[left])), int(place[right]), 2 * pi / mean))
    return stretches


def _fit(
    history: TimeHistory,
    begin: int,
    end: int,
    omega: float,
    band: tuple[float, float] | None,
    harmonics: int,
) -> _Step | None:
    frequency = omega * history.rate / (2 * pi)
    if band is not None and not band[0] <= frequency <= band[1]:
        return None
    reach = max(1, min(harmonics, int(_NYQUIST * 2 * pi / omega)))
    force, response = history.reference, history.response
    period = 2 * pi / omega
    change, start = np.inf, begin
    for part in _PARTS:
        first = end - int(part * (end - begin))
        middle = (first + end) // 2
        if middle - first < _SHORTEST * period:
            break
        refined = refine_frequency(force[first:end], omega, min(reach, 2))
        one = fit_sine(response[first:middle], refined, reach)
        two = fit_sine(response[middle:end], refined, reach)
        turned = one.harmonics[1] * np.exp(1j * refined * (middle - first))
        size = max(abs(two.harmonics[1]), 1e-300)
        # of two halves that differ by noise alone, the difference has twice the variance of one
        doubt = 3 * np.hypot(one.residual, two.residual) * np.sqrt(2 / (middle - first)) / size
        found = abs(turned - two.harmonics[1]) / size
        if found < change:
            change, start = found, first
        if found < max(_SETTLED, doubt):
            change, start = min(found, _SETTLED), first
            break
    if not np.isfinite(change):
        return None
    omega = refine_frequency(force[start:end], omega, min(reach, 2))
    pushed = fit_sine(force[start:end], omega, min(reach, 2))
    moved = fit_sine(response[start:end], omega, reach)
    power = {"displacement": 0, "velocity": 1, "acceleration": 2}[history.quantity]
    table = np.full(harmonics + 1, np.nan, dtype=complex)
    rate = omega * history.rate
    table[1 : reach + 1] = moved.harmonics[1:] / (1j * rate * np.arange(1, reach + 1)) ** power
    if power == 0:
        table[0] = moved.harmonics[0].real
    error = moved.residual * np.sqrt(2 / moved.samples) / max(abs(moved.harmonics[1]), 1e-300)
    return _Step(
        history.level, rate / (2 * pi), complex(pushed.harmonics[1]), table, float(change), float(error)
    )
