"""From identified parameters to resonance curves with folds and stability, and to held-out levels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import RsgenError
from rsgen.identification import Identification
from rsgen.identification.amplitude_balance import AmplitudeBalance
from rsgen.identification.data import held_out_mask
from rsgen.identification.result import frozen_array
from rsgen.surface import ResponseSurface

__all__ = ["HeldOutLevel", "Prediction", "ResonanceCurve", "predict"]

Array = NDArray[np.float64]

_POINTS = 161
"""Points a branch, denser at both ends, where it turns."""

_MARGIN = 0.05
"""Curves are drawn so far beyond the tested frequencies."""

_BEYOND = 1.01
"""A response is extrapolated beyond the tested amplitudes times this; less is the noise of the test."""

_WIDEST = 0.5
"""At a fold the band of the amplitude at a frequency opens without end; wider ones are not drawn."""

_NEAR = 0.2
"""A predicted steady state farther from the measured one, relatively, is another one."""


@dataclass(frozen=True, slots=True, eq=False)
class ResonanceCurve:
    """The resonance curve of one level, ordered along the curve; a row of NaN separates detached parts.

    Parameters
    ----------
    level
        Force amplitude [N].
    frequency
        (k,) [Hz]; not single-valued between the folds.
    amplitude
        (k,) X [m].
    phase
        (k,) lag of displacement behind force [rad].
    stable
        (k,) False on the branch between two folds.
    extrapolated
        (k,) True where the amplitude is outside the tested range.
    lower, upper
        (k,) 95 % band of the amplitude at the frequency [m]; NaN at folds, where it is not defined.
    folds
        (j, 2) frequency [Hz] and amplitude [m] of the points where the response jumps.
    """

    level: float
    frequency: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    phase: NDArray[np.float64]
    stable: NDArray[np.bool_]
    extrapolated: NDArray[np.bool_]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    folds: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("frequency", "amplitude", "phase", "lower", "upper", "folds"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
        for name in ("stable", "extrapolated"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.bool_))


@dataclass(frozen=True, slots=True, eq=False)
class HeldOutLevel:
    """Measured against predicted for one level and sweep that identification has not seen.

    Parameters
    ----------
    level, sweep
        Nominal force amplitude [N] and how the points were reached.
    frequency
        (n,) [Hz], ascending.
    measured, predicted
        (n,) complex fundamental X_1 [m] at the measured force; predicted is NaN where there is none.
    error
        Root mean square of predicted - measured over that of measured [1].
    largest_error
        Largest |predicted - measured| over the largest |measured| [1].
    missing
        How many points have no predicted steady state near the measured one.
    """

    level: float
    sweep: str
    frequency: NDArray[np.float64]
    measured: NDArray[np.complex128]
    predicted: NDArray[np.complex128]
    error: float
    largest_error: float
    missing: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency", frozen_array(self.frequency))
        for name in ("measured", "predicted"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.complex128))


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Resonance curves, scores of held-out levels, and what to keep in mind about them.

    Parameters
    ----------
    curves
        One a level, in the order asked for.
    held_out
        One a held-out level and sweep; empty without held-out levels or without a surface.
    tested_amplitude
        (lowest, highest) X [m] that took part in identification; beyond is extrapolation.
    remarks
        Sentences: extrapolation, missing branches.
    """

    curves: tuple[ResonanceCurve, ...]
    held_out: tuple[HeldOutLevel, ...]
    tested_amplitude: tuple[float, float]
    remarks: tuple[str, ...]


def predict(
    identification: Identification,
    levels: Sequence[float] | None = None,
    surface: ResponseSurface | None = None,
) -> Prediction:
    """Compute the resonance curve of every level; with a surface, score the held-out levels on it.

    At every amplitude X the frequencies are sought at which the balance, with all harmonics, takes the force
    of the level: F^2 = X^2 ((k(X) - m omega^2)^2 + omega^2 c(X, omega)^2) with k and c of the whole waveform.
    So both branches and the unstable one come without continuation.

    Parameters
    ----------
    identification
        The refined estimate is used.
    levels
        [N]; None: the tested and the held-out ones.
    surface
        Where the held-out levels were measured; None: no score.

    Raises
    ------
    RsgenError
        A level is not positive and finite.
    """
    model = identification.model
    if levels is None:
        levels = sorted({*map(float, identification.levels), *model.observation.hold_out})
    for level in levels:
        if not (isfinite(level) and level > 0):
            raise RsgenError(f"levels: {level!r} N; a level must be positive and finite")
    balance = AmplitudeBalance(identification)
    curves = tuple(_curve(identification, balance, float(level)) for level in levels)
    held_out = _score(identification, balance, surface) if surface is not None else ()
    return Prediction(
        curves, held_out, identification.amplitude_range, _remarks(identification, curves, held_out)
    )


def _remarks(
    identification: Identification, curves: tuple[ResonanceCurve, ...], held_out: tuple[HeldOutLevel, ...]
) -> tuple[str, ...]:
    remarks = []
    low, high = identification.amplitude_range
    beyond = [curve.level for curve in curves if np.any(curve.extrapolated & (curve.amplitude > high))]
    if beyond:
        remarks.append(
            f"extrapolation beyond the tested amplitudes ({low:.3g} to {high:.3g} m) at "
            f"{', '.join(f'{level:g}' for level in beyond)} N: nothing is known of the law there"
        )
    empty = [curve.level for curve in curves if len(curve.frequency) == 0]
    if empty:
        remarks.append(
            f"no steady state in the tested frequencies at {', '.join(f'{level:g}' for level in empty)} N"
        )
    for item in held_out:
        if item.missing:
            remarks.append(
                f"{item.missing} of {len(item.frequency)} points of the held-out level {item.level:g} N "
                f"(sweep {item.sweep}) have no predicted steady state near the measured one"
            )
    return tuple(remarks)


def _curve(identification: Identification, balance: AmplitudeBalance, level: float) -> ResonanceCurve:
    low, high = (2 * np.pi * f for f in identification.frequency_range)
    window = (low * (1 - _MARGIN), high * (1 + _MARGIN))
    parts = [
        part for span in balance.spans(level, window) for part in _branches(balance, level, span, window)
    ]
    columns: list[list[Array]] = [[] for _ in range(7)]
    folds: list[tuple[float, float]] = []
    for omega, size in parts:
        at = balance.solve(size, omega)
        gain = (np.conj(at.force) * at.force_slope).real / np.abs(at.force)
        spread = balance.force_spread(at) / np.maximum(np.abs(gain), 1e-300)
        spread[spread > _WIDEST * size] = np.nan
        seen, lag = _as_seen(identification, omega, size, at.force)
        turn = np.flatnonzero(gain[:-1] * gain[1:] < 0)
        share = gain[turn] / (gain[turn] - gain[turn + 1])
        folds += [
            (
                float((omega[i] + s * (omega[i + 1] - omega[i])) / 2 / np.pi),
                float(seen[i] + s * (seen[i + 1] - seen[i])),
            )
            for i, s in zip(turn, share, strict=True)
        ]
        values = (omega / (2 * np.pi), seen, lag, gain, seen - spread, seen + spread, size)
        for column, value in zip(columns, values, strict=True):
            if column:
                column.append(np.array([np.nan]))
            column.append(value)
    frequency, amplitude, phase, gain, lower, upper, own = (
        np.concatenate(column) if column else np.zeros(0) for column in columns
    )
    tested = identification.amplitude_range
    return ResonanceCurve(
        level=level,
        frequency=frequency,
        amplitude=amplitude,
        phase=phase,
        stable=gain > 0,
        extrapolated=(own > tested[1] * _BEYOND) | (own < tested[0] / _BEYOND),
        lower=np.maximum(lower, 0.0),
        upper=upper,
        folds=np.array(folds).reshape(-1, 2),
    )


def _as_seen(
    identification: Identification, omega: Array, size: Array, force: NDArray[np.complex128]
) -> tuple[Array, Array]:
    """Amplitude and lag of the response that the sensor sees, with what is there besides the mode."""
    background = identification.background
    if background is None:
        return size, np.angle(force) % (2 * np.pi)
    shape, values = background.shape(omega), background.values
    response = size + shape.receptance(values) * force
    return np.abs(response), np.angle(force / shape.turn(values) / response) % (2 * np.pi)


def _branches(
    balance: AmplitudeBalance, level: float, span: tuple[float, float], window: tuple[float, float]
) -> list[tuple[Array, Array]]:
    """Points (omega, X) along the curve between two amplitudes: up on the left, down on the right."""
    blend = (1 - np.cos(np.linspace(0, np.pi, _POINTS))) / 2
    size = span[0] + (span[1] - span[0]) * blend
    left, right = (balance.frequencies(size, level, side) for side in (-1, 1))
    omega = np.concatenate([left, right[::-1]])
    size = np.concatenate([size, size[::-1]])
    inside = np.isfinite(omega) & (omega >= window[0]) & (omega <= window[1])
    cut = np.flatnonzero(np.diff(inside.astype(int)) != 0) + 1
    pieces = [rows for rows in np.split(np.arange(len(omega)), cut) if len(rows) > 1 and inside[rows[0]]]
    return [(omega[rows], size[rows]) for rows in pieces]


def _respond(
    identification: Identification, balance: AmplitudeBalance, surface: ResponseSurface
) -> NDArray[np.complex128]:
    """(n,) predicted fundamental [m] as the sensor sees it, on the branch nearest to the measured one."""
    background = identification.background
    if background is None:
        return balance.respond(surface.force, surface.omega, surface.amplitude)
    shape, values = background.shape(surface.omega), background.values
    mode = shape.subtract(surface, values)
    return balance.respond(mode.force, mode.omega, mode.amplitude) + shape.receptance(values) * mode.force


def _score(
    identification: Identification, balance: AmplitudeBalance, surface: ResponseSurface
) -> tuple[HeldOutLevel, ...]:
    model = identification.model
    chosen = (
        held_out_mask(surface, model)
        & surface.settled
        & (surface.amplitude > 0)
        & (np.abs(surface.force) > 0)
    )
    scored = []
    for level in np.unique(surface.level[chosen]):
        for sweep in np.unique(surface.sweep[chosen & (surface.level == level)]):
            rows = np.flatnonzero(chosen & (surface.level == level) & (surface.sweep == sweep))
            rows = rows[np.argsort(surface.frequency[rows], kind="stable")]
            measured = surface.harmonics[rows, 1]
            predicted = _respond(identification, balance, surface.select(rows))
            told = np.isfinite(predicted)
            miss = np.abs(predicted - measured)[told]
            scored.append(
                HeldOutLevel(
                    level=float(level),
                    sweep=str(sweep),
                    frequency=surface.frequency[rows],
                    measured=measured,
                    predicted=predicted,
                    error=float(np.linalg.norm(miss) / np.linalg.norm(measured[told])) if told.any() else nan,
                    largest_error=float(miss.max() / np.abs(measured).max()) if told.any() else nan,
                    missing=int(
                        np.count_nonzero(~told | (np.abs(predicted - measured) > _NEAR * np.abs(measured)))
                    ),
                )
            )
    return tuple(scored)
