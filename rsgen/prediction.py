"""From identified parameters to resonance curves with folds and stability, and to held-out levels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.identification import Identification
from rsgen.identification.result import frozen_array
from rsgen.surface import ResponseSurface

__all__ = ["HeldOutLevel", "Prediction", "ResonanceCurve", "predict"]


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
        (n,) complex fundamental X_1 [m] at the measured force; predicted is NaN where no steady state is found.
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

    ``levels`` [N] defaults to the tested and the held-out ones.
    """
    raise NotImplementedError
