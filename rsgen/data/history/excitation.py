"""Whether a force is a sine at all: the share of its power at one line, and what it is if that is little."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError
from rsgen.common.finding import Finding, Quantity
from rsgen.data.history.record import BLOCK, TimeHistory

__all__ = ["ForceKind", "check_force", "check_response", "describe_force", "kind_of_force"]

ForceKind = Literal["constant", "blow", "sine", "periodic", "random"]
"""What a force is by its values."""

_SINE = 0.5
"""A force with less than half of its power at the line that it is read at, and its harmonics, is no sine."""
_CLEAN = 0.9
"""Below this share of the power the rest of the force drives the structure, too: by a third of the line."""
_ANSWERS = 0.5
"""A response with less than half of its power at the lines of the force is mainly not the answer to it."""
_PEAK = 8.0
"""Blows have peaks of more than eight times the rms value; random forces reach five, sines 1.4."""
_REPEATS = 0.8
"""A force that agrees with itself a period later by this much is periodic."""
_SHORTEST = 16
"""Samples of the shortest period that is looked for."""
_TALL = 0.3
"""The strongest line of a sine has this share of the power in any case, also where it is swept or stepped."""


def kind_of_force(force: NDArray[Any]) -> ForceKind:
    """Tell what a force (n,) is, by its values: a constant, a blow, a sine, periodic with many lines, random.

    A sine may sweep or step, and its steps may be too short to be read.
    """
    part = np.asarray(force[:BLOCK], dtype=np.float64)
    part = part - np.mean(part)
    square = float(part @ part)
    if not square > 0:
        return "constant"
    if float(np.max(np.abs(part))) > _PEAK * np.sqrt(square / len(part)):
        return "blow"
    size = 2 * len(part)
    spectrum = np.abs(np.fft.rfft(part, size)) ** 2
    if _narrow(part):
        return "sine"
    agrees = np.fft.irfft(spectrum, size)[: len(part) // 2]
    # fewer samples overlap at longer lags
    agrees = agrees / square * len(part) / (len(part) - np.arange(len(agrees)))
    # past the first zero it comes back where the force repeats
    away = int(np.argmax(agrees < 0)) if (agrees < 0).any() else len(agrees)
    again = agrees[max(away, _SHORTEST) :]
    return "periodic" if len(again) and float(np.max(again)) > _REPEATS else "random"


_NO_SINE: dict[ForceKind, str] = {
    "blow": (
        "the force is a blow, as of a hammer: its free decay is read with test.excitation = "
        '"ring-down"; for a resonance at several levels, measure with a stepped or swept sine'
    ),
    "periodic": (
        "the force is periodic with many lines, as a multisine is: it is read with test.excitation = "
        '"multisine" (rsgen.data.history.from_multisine)'
    ),
    "random": (
        "the force is random: it has no amplitude and no frequency of its own, so that no response surface "
        "follows from it; measure with a stepped or swept sine or a periodic multisine, a level at a time"
    ),
}
"""What a force is that is no sine, and what to do."""


def describe_force(force: NDArray[Any]) -> str:
    """Say what a force is that is no sine, and what to do: a blow, periodic with many lines, or random.

    Returns "" where it may be a sine after all: steps too short, a sweep that turns.
    """
    return _NO_SINE.get(kind_of_force(force), "")


def _narrow(part: Array) -> bool:
    """Whether one line has most of the power in short pieces: a sine, whatever its frequency does."""
    pieces = 32
    length = len(part) // pieces
    if length < 4 * _SHORTEST:
        return False
    rows = part[: pieces * length].reshape(pieces, length)
    power = np.abs(np.fft.rfft(rows * np.hanning(length + 2)[1:-1])) ** 2
    loud = power.sum(axis=1) > 0.01 * power.sum(axis=1).max()
    top = np.argmax(power[:, 1:], axis=1) + 1
    near = np.stack(
        [power[np.arange(pieces), np.clip(top + k, 0, power.shape[1] - 1)] for k in (-2, -1, 0, 1, 2)]
    )
    share = near.sum(axis=0)[loud] / power.sum(axis=1)[loud]
    return bool(np.median(share) > _TALL and np.ptp(top[loud]) < power.shape[1])


def check_force(history: TimeHistory, share: Array) -> list[Finding]:
    """Judge a force by the shares (n,) of its power at the lines that it was read at.

    Raises
    ------
    MeasurementError
        It is no sine.
    """
    typical = float(np.median(share))
    if typical < _SINE:
        reason = describe_force(history.reference) or (
            "it is no sine, or its noise hides its steps; measure with a stepped or swept sine"
        )
        raise MeasurementError(
            f"{history.label}: only {typical:.0%} of the power of the force is at the lines that it was read "
            f"at: {reason}"
        )
    if typical >= _CLEAN:
        return []
    return [Finding("force-not-sine", "doubt", "", {"share": Quantity(typical)}, {"record": history.label})]


def check_response(history: TimeHistory, line: Array, power: Array) -> list[Finding]:
    """Judge a response by its power (n,) at the lines of the force and in all: both of n points [SI^2]."""
    known = np.isfinite(line) & np.isfinite(power)
    total = float(np.sum(power[known]))
    share = min(float(np.sum(line[known])) / total, 1.0) if total > 0 else 1.0
    if share >= _ANSWERS:
        return []
    return [
        Finding("response-not-at-drive", "doubt", "", {"share": Quantity(share)}, {"record": history.label})
    ]
