"""How a structure was excited, by the values of its records: sweep, steps, many lines, a blow, or release."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError
from rsgen.data.history import TimeHistory
from rsgen.data.history.excitation import kind_of_force
from rsgen.data.history.multisine import find_period

__all__ = ["dies_away", "excitation_of", "moves_in_steps"]

_CYCLES = (1, 2, 4, 8, 16, 32, 64)
"""Lengths of the pieces, in cycles, over which the frequency is taken: noise asks for long ones."""
_WINDOW = 8
"""Pieces in a row through which two steps and a line are laid."""
_FEWEST_WINDOWS = 4
"""Windows, at least."""
_NEARER = 0.64
"""Distance that two steps leave over that which a line leaves: of noise alone 0.9; of up to twelve sweeps
one after the other 0.65 and more, as each window that moves leaves the steps more than the line; of steps
0.63 and less unless noise hides them, for a piece may lie between two, and a step at the end of a window."""
_OFF = 1.5
"""A cycle this many times as long as both its neighbours has a silence in it: no sine changes so for one."""
_ROUND_OFF = 1e-6
"""Changes of a frequency below this share are none: a generator that stands still."""
_FEWEST = 24
"""Cycles from which on a force shows what it is."""
_REGULAR = 0.1
"""Lengths of the cycles of a sine differ from one to the next by less than this share, with noise."""
_LIKE = 0.1
"""Peaks of a sine differ from cycle to cycle by less than this share, with noise."""
_MARGIN = 0.2
"""Share of the rms value about zero in which noise makes no cycles."""
_ENDED = 0.2
"""Share of the largest amplitude below which there is no force but noise."""
_ENDS = 0.75
"""A force that ends before this share of its record was switched off, so that the decay is seen."""
_PIECE = 8
"""Cycles that are measured together, against noise."""
_ONE = 1.02
"""Longest over shortest of them where the frequency is one."""
_BLOCKS = 60
"""Parts of a record whose amplitudes are compared."""
_LOUD = 0.3
"""Share of the largest amplitude from which on a part is loud."""
_RISES = 2
"""Parts in which a structure that is released or struck gets loud; a resonance that is passed takes more."""
_QUIET = 0.5
"""Share of the largest amplitude below which a decay ends: a structure that is driven keeps its amplitude."""


def excitation_of(history: TimeHistory) -> str:
    """Name the excitation of a record by its force, as a case does; "" where it is none that is read."""
    force = np.asarray(history.reference, dtype=np.float64)
    force = force - force.mean()
    if kind_of_force(force) in ("constant", "blow"):
        return "ring-down" if force.any() else ""
    driven, ends = _driven(force)
    instants = _cycles(driven)
    if len(instants) < _FEWEST:
        return ""
    if ends and _is_one_frequency(instants):
        return "ring-down"
    duration = np.diff(instants)
    irregular = float(np.median(np.abs(np.diff(np.log(duration)))))
    if (irregular > _REGULAR or _beats(driven, instants)) and _repeats(force):
        return "multisine"
    if irregular > _REGULAR:
        return ""
    return "stepped-sine" if moves_in_steps(instants) else "swept-sine"


def _cycles(force: Array) -> Array:
    """(c,) instants, in samples, at which a force (n,) without mean rises: noise about zero is no cycle."""
    margin = _MARGIN * float(np.sqrt(np.mean(force**2)))
    side = np.where(force > margin, 1, np.where(force < -margin, -1, 0))
    known = np.flatnonzero(side)
    up = np.flatnonzero((side[known][1:] > 0) & (side[known][:-1] < 0)) + 1
    at = known[up]
    return np.asarray(at - (force[at] - margin) / (force[at] - force[at - 1]))


def _driven(force: Array) -> tuple[Array, bool]:
    """Give the part of a force between quiet ends, and whether it ends long before its record."""
    if len(force) < 4 * _BLOCKS:
        return force, False
    loud = _loudness(force)
    active = np.flatnonzero(loud > _ENDED * loud.max())
    length = len(force) // _BLOCKS
    return force[active[0] * length : (active[-1] + 1) * length], bool(active[-1] < _ENDS * _BLOCKS)


def _is_one_frequency(instants: Array) -> bool:
    pieces = np.diff(instants[::_PIECE])
    low, high = np.quantile(pieces, [0.1, 0.9])
    return bool(high < _ONE * low)


def _beats(force: Array, instants: Array) -> bool:
    """Whether the peaks of a force change from cycle to cycle, as those of many lines do."""
    peaks = np.maximum.reduceat(np.abs(force), instants.astype(np.intp))[:-1]
    return bool(np.median(np.abs(np.diff(np.log(peaks)))) > _LIKE)


def _repeats(force: Array) -> bool:
    try:
        find_period(force)
    except MeasurementError:
        return False
    return True


def moves_in_steps(instants: Array) -> bool:
    """Whether the frequency of a sine stands still and jumps, by the instants (c,) at which its cycles begin.

    A few pieces in a row lie on two steps then, rather than on a line; in a sweep it is the other way round,
    and noise lies on neither. Noise asks for long pieces, and short steps for short ones: all are looked at.
    """
    instants = _without_silence(instants)
    return any(
        _on_steps(cycles / np.diff(instants[::cycles]))
        for cycles in _CYCLES
        if len(instants) > _WINDOW * cycles * _FEWEST_WINDOWS
    )


def _without_silence(instants: Array) -> Array:
    """Instants at which cycles (c,) begin, on a clock that stops where the force was off between two runs."""
    cycles = np.diff(instants)
    off = np.zeros(len(cycles), dtype=bool)
    off[1:-1] = cycles[1:-1] > _OFF * np.maximum(cycles[:-2], cycles[2:])
    return np.concatenate([[0.0], np.cumsum(cycles[~off])])


def _on_steps(frequency: Array) -> bool:
    """Whether windows of a frequency (p,) lie much nearer to two steps each than to a line.

    Every window counts by its distance, not by the square of it: of two sweeps in one record a single window
    has the jump back, of many times the size of all others, and the others are sweeps.
    """
    rows = sliding_window_view(frequency, _WINDOW)
    place = np.arange(_WINDOW) - (_WINDOW - 1) / 2
    away = rows - rows.mean(axis=1, keepdims=True)
    line = np.sum(away**2, axis=1) - (away @ place) ** 2 / (place @ place)
    two = [
        away[:, :cut].var(axis=1) * cut + away[:, cut:].var(axis=1) * (_WINDOW - cut)
        for cut in range(2, _WINDOW - 1)
    ]
    of_steps, of_line = (
        float(np.sum(np.sqrt(np.maximum(left, 0.0)))) for left in (np.min(two, axis=0), line)
    )
    return of_steps < _NEARER * of_line and of_line > _ROUND_OFF * float(frequency.mean()) * len(rows)


def _loudness(values: Array) -> Array:
    """(b,) root mean squares of parts of a record."""
    values = values - values.mean()
    length = len(values) // _BLOCKS
    return np.asarray(np.sqrt(np.mean(values[: length * _BLOCKS].reshape(_BLOCKS, length) ** 2, axis=1)))


def dies_away(response: Array) -> bool:
    """Whether a response (n,) gets loud at once and dies away: a decay, not a passage through a resonance."""
    if len(response) < 4 * _BLOCKS:
        return True
    loud = _loudness(np.asarray(response, dtype=np.float64))
    top = int(np.argmax(loud))
    first = int(np.argmax(loud > _LOUD * loud[top]))
    return top - first <= _RISES and bool(loud[-1] < _QUIET * loud[top])
