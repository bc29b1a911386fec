"""Complex envelopes of a signal against a reference phase: synchronous demodulation in one pass, block-wise.

A signal y(t) = Re sum_h Y_h(t) exp(i h phi(t)) is mixed with exp(-i h phi) and a cubic is fitted to it by
weighted least squares within a window of some periods: its value and derivatives at the middle are Y_h, Y_h'
and Y_h''. That is a low-pass filter (Savitzky and Golay 1964, here with a cos^4 taper, so that the other
harmonics are damped by 100 dB) which does not flatten a peak of the envelope, as a plain average would.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.history.record import BLOCK

__all__ = [
    "DENSE",
    "NOISE_WIDTH",
    "PERIODS",
    "Windows",
    "demodulate",
    "independent_instants",
    "mean_square",
    "place_windows",
]


PERIODS = 10.0
"""Window in periods: the shortest whose taper separates the harmonics by 100 dB."""
_PER_PERIOD = 8
"""Finer sampling is added up to this many sums a period of the highest harmonic: four times Nyquist's."""
_FEWEST = 24
"""Sums in a window: six a period of the taper."""
_LENGTHS = 16
"""Lengths of windows in an octave, 4 % apart: neighbours have one length and share their sums."""
DENSE = 20_001
"""Instants by which lengths of windows are added up: at least ten a window in a history of 2000 windows."""


@lru_cache(maxsize=256)
def _kernel(count: int) -> Array:
    """(3, count) weights for value, first and second derivative at the middle, time in units of a sum."""
    place = np.arange(count) - (count - 1) / 2
    taper = np.cos(np.pi * place / count) ** 4
    powers = (place / count)[:, None] ** np.arange(4)
    weights = np.linalg.solve(powers.T @ (taper[:, None] * powers), (powers * taper[:, None]).T)
    return np.asarray(weights[:3] * np.array([[1.0], [1 / count], [2 / count**2]]))


NOISE_WIDTH = float(4096 * np.sum(_kernel(4096)[0] ** 2))
"""Bandwidth of the demodulation (both sides, equivalent for white noise) [Hz] times window length [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Where envelopes are taken: (n,) first samples, samples added up before the fit, sums in a window."""

    first: NDArray[np.int64]
    step: NDArray[np.int64]
    count: NDArray[np.int64]

    @property
    def middle(self) -> Array:
        """(n,) middle of each window, in samples."""
        return np.asarray(self.first + (self.step * self.count - 1) / 2)

    def __len__(self) -> int:
        return len(self.first)


def place_windows(middle: Array, length: Array, period: Array, orders: int, size: int) -> Windows:
    """Lay windows around given places, for harmonics up to ``orders``, in a signal of ``size`` samples.

    ``middle``, ``length`` and ``period`` of the reference (n,) are in samples; windows that do not fit inside
    are left out.
    """
    middle, length, period = np.broadcast_arrays(middle, length, period)
    finest = np.minimum(period / (_PER_PERIOD * max(orders, 1)), length / _FEWEST)
    step = np.maximum(1, 2 ** np.floor(np.log2(np.maximum(finest, 1.0)))).astype(np.int64)
    even = np.exp2(np.round(_LENGTHS * np.log2(length / step)) / _LENGTHS)
    count = np.maximum(np.round(even), _FEWEST // 2).astype(np.int64)
    # on the grid of their sums, so that neighbours share them
    first = (np.round((middle - step * count / 2) / step) * step).astype(np.int64)
    inside = (first >= 0) & (first + step * count <= size)
    return Windows(first[inside], step[inside], count[inside])


def independent_instants(
    length: Callable[[Array], Array], begin: float, end: float, most: float | None = None
) -> Array:
    """Lay instants [s] as far apart as windows of ``length(t)`` [s] are independent.

    With ``most``, at most that many, evenly thinned and ``end`` among them.
    """
    dense = np.linspace(begin, end, DENSE)
    count = np.concatenate([[0.0], np.cumsum(np.diff(dense) * NOISE_WIDTH / length(dense)[1:])])
    wanted = np.arange(int(count[-1]) + 1)
    if most is not None:
        wanted = np.linspace(0, count[-1], int(min(max(count[-1], 2), most)))
    return np.asarray(np.interp(wanted, count, dense))


def _batches(windows: Windows) -> list[NDArray[np.intp]]:
    """Cut windows in their order into runs of one step and one count that span about a block."""
    first, step, count = windows.first, windows.step, windows.count
    # windows far apart are apart here: the samples between them are not needed
    cut = (np.diff(step) != 0) | (np.diff(count) != 0) | (np.diff(first) > (step * count)[:-1])
    batches = []
    for run in np.split(np.arange(len(windows)), np.flatnonzero(cut) + 1):
        while len(run):
            here = int(np.searchsorted(first[run], first[run[0]] + BLOCK, side="right"))
            batches.append(run[:here])
            run = run[here:]
    return batches


def mean_square(signal: NDArray[Any], windows: Windows) -> Array:
    """Find the mean square of a real signal (n,) in each of the windows, which are in ascending order."""
    out = np.zeros(len(windows))
    for batch in _batches(windows):
        first, length = windows.first[batch], windows.step[batch] * windows.count[batch]
        begin = int(first[0])
        samples = np.asarray(signal[begin : int(first[-1] + length[-1])], dtype=np.float64)
        total = np.concatenate([[0.0], np.cumsum(np.square(samples))])
        out[batch] = (total[first - begin + length] - total[first - begin]) / length
    return out


def demodulate(
    signal: NDArray[Any],
    rate: float,
    phase: Callable[[Array], Array],
    windows: Windows,
    orders: tuple[int, ...],
) -> ComplexArray:
    """Take envelopes of a real signal (n,), sampled at ``rate`` [Hz], at windows in ascending order.

    ``phase`` gives the reference [rad] at times [s]; ``orders`` are harmonics, ascending, 0 the mean.
    Returns (windows, orders, 3): the envelope and its first and second time derivative.
    """
    out = np.zeros((len(windows), len(orders), 3), dtype=np.complex128)
    for batch in _batches(windows):
        step, count = int(windows.step[batch[0]]), int(windows.count[batch[0]])
        begin = int(windows.first[batch[0]])
        end = int(windows.first[batch[-1]]) + step * count
        samples = np.asarray(signal[begin:end], dtype=np.float64)
        turn = np.exp(-1j * phase(np.arange(begin, end) / rate))
        mixed, reached = np.ones(1, dtype=complex), 0
        kernel = _kernel(count).T / np.array([1.0, step / rate, (step / rate) ** 2]) / step
        offsets = (windows.first[batch] - begin) // step
        for column, order in enumerate(orders):
            for _ in range(order - reached):
                mixed = mixed * turn
            reached = order
            sums = (samples * mixed).reshape(-1, step).sum(axis=1)
            views = np.lib.stride_tricks.sliding_window_view(sums, count)[offsets]
            out[batch, column] = (views @ kernel) * (2.0 if order else 1.0)
    return out
