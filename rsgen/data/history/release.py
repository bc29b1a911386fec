"""Where the free decays of a record begin and end: after a drive or a blow, before noise or the next blow."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import log
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError
from rsgen.data.history.record import MAX_IDLE_FORCE, MIN_SAMPLES, TimeHistory, clipped_samples

SPECTRUM_PERIODS = 8
"""Periods in a spectrum that shows the amplitude: fewer than a decay has, enough to resolve the mode."""
_HOP_PERIODS = 2
"""Periods from one spectrum to the next."""
_AGAIN = log(3.0)
"""An amplitude that grows threefold has been excited again; noise and beats of a tenth do not do that."""
_ABOVE_QUIET = log(10.0)
"""One of several decays begins at ten times the quietest tenth; noise comes to seven times its own."""
_STANDS_OUT = log(20.0)
"""A steady drive is looked for until the response has fallen to a twentieth [logarithm]."""
_SUDDEN = 3
"""A blow raises the amplitude threefold within three spectra; two modes that beat take longer."""
_UP = 0.3
"""Before its largest value a driven response is down by less than this (of the logarithm)."""
_STEADY = 0.25
"""A response is driven while it falls at less than a quarter of the pace at which it falls afterwards ..."""
_LASTS = 0.5
"""... for half the time at least in which it then falls to 1/e."""
_FLAT = 0.1
"""The end of a record in which the amplitude falls at less than a tenth of the pace is its floor."""
_END = 4
"""The floor is looked for in the last quarter."""
_FEWEST = 8
"""Spectra in that quarter that show whether it is flat."""
_TAIL = 10
"""Offset and noise of the force are those of its last tenth."""
_NOISE = 9.0
"""A force is on above this many median deviations, which are six standard deviations."""
_CREST = 2.5
"""Noise alone has peaks of more than 2.5 standard deviations, a sine of 1.4."""
_FALLS = log(1.1)
"""An amplitude that falls by less than a tenth is no decay."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A free decay in a record.

    Parameters
    ----------
    begin, end
        First sample, and the one after the last.
    driven
        A drive or a blow was seen to end at ``begin``; with a given start, that one goes on after it.
    given
        The begin is that which was given.
    rises
        The amplitude rises again at ``end``, and too slowly for a blow.
    floor
        Amplitude of noise or hum in which it ends [unit of the response]; 0 where the record ends before.
    """

    begin: int
    end: int
    driven: bool = False
    given: bool = False
    rises: bool = False
    floor: float = 0.0


def find_decays(
    history: TimeHistory, line: float, band: tuple[float, float] | None, start: float | None = None
) -> list[Stretch]:
    """Find the free decays of a record near a ``line`` [Hz], in the order of time.

    ``start`` [s] is the release if known: what comes before is left out, and what comes after is believed.

    Raises
    ------
    MeasurementError
        There is none: the force does not end, or the amplitude does not fall.
    """
    first = 0 if start is None else max(0, round((start - history.start) * history.rate))
    step = _HOP_PERIODS * history.rate / line
    high = _amplitudes(history.response[first:], history.rate, line, band)
    if not len(high):
        return [Stretch(_release(history, first, len(history), line)[0], len(history))]
    tops = _tops(high)
    found, fault = [], None
    for top, after in pairwise([*tops, len(high)]):
        low = len(high) if after == len(high) else top + int(np.argmin(high[top:after]))
        end = len(history) if after == len(high) else first + int(low * step)
        # a drive may have held the level before its largest value
        up = np.flatnonzero(high[:top] < high[top] - _UP)
        back = int(up[-1]) + 1 if len(up) else 0
        part = high[back:low]
        driven = _driven(part)
        try:
            begin, ended = _release(history, first + int(top * step), end, line)
        except MeasurementError as error:
            fault = error
            continue
        if not ended and driven:
            # a spectrum ends as much later as it lasts, and the next one may have seen the drive, too
            begin = first + int((back + driven + SPECTRUM_PERIODS / _HOP_PERIODS + 1) * step)
        seen = ended or driven > 0
        given = start is not None and top == tops[0]
        if given:
            # the peak of a decay that begins at once lies in its first spectra
            seen = begin > first + SPECTRUM_PERIODS / _HOP_PERIODS * step
            begin = first
        begin = max(begin, _after_clipping(history, begin, end))
        rises = after < len(high) and _slowly(high[top : after + 1])
        falls = (
            len(part) < _FEWEST
            or float(high[max(top, back + min(driven, len(part) - 1))] - np.min(part)) > _FALLS
        )
        if falls and begin + MIN_SAMPLES <= end:
            found.append(Stretch(begin, end, seen, given, rises, _floor(high[max(back + driven, top) : low])))
    if not found:
        raise fault or MeasurementError(
            f"{history.label}: the amplitude near {line:.4g} Hz does not fall by a tenth after its largest; "
            "a free decay is needed: a record that goes on after the drive has ended"
        )
    return found


def _tops(high: Array) -> list[int]:
    """Find the spectra at which decays begin: where the amplitude (logarithm, n) is up after it was down."""
    quiet = float(np.min(high)) - 2 * _AGAIN
    tops = scipy.signal.find_peaks(np.concatenate([[quiet], high, [quiet]]), prominence=_AGAIN)[0] - 1
    largest = int(np.argmax(high))
    clear = [int(top) for top in tops if high[top] - np.quantile(high, 0.1) > _ABOVE_QUIET]
    # equal peaks, as in a steady drive, all have the prominence of the highest: it was not down between them
    parted = [
        top
        for number, top in enumerate(clear)
        if number == 0 or high[top] - float(np.min(high[clear[number - 1] : top])) > _AGAIN
    ]
    return parted or [largest]


def _slowly(high: Array) -> bool:
    """Return whether the amplitude (logarithm, n) rises to its last value more slowly than after a blow."""
    low = np.flatnonzero(high < high[-1] - _AGAIN)
    return len(high) - 1 - int(low[-1]) > _SUDDEN


def _release(history: TimeHistory, onset: int, end: int, line: float) -> tuple[int, bool]:
    """Find the first free sample of a decay whose amplitude is up at ``onset``, and whether a force ended."""
    forced = force_ends(history, end)
    if forced is not None and forced > onset - SPECTRUM_PERIODS * history.rate / line:
        return forced, True
    # a blow or a release lies within the spectrum that is the first to see all of it
    inside = history.response[onset : min(onset + int(SPECTRUM_PERIODS * history.rate / line) + 1, end)]
    return onset + (int(np.argmax(np.abs(inside - np.mean(inside)))) if len(inside) else 0), False


def _amplitudes(samples: NDArray[Any], rate: float, line: float, band: tuple[float, float] | None) -> Array:
    """Find the logarithm of the amplitude near ``line`` [Hz] in short spectra, one every two periods."""
    length = max(int(SPECTRUM_PERIODS * rate / line), 8)
    taper = np.hanning(length + 2)[1:-1]
    lines = np.fft.rfftfreq(length, 1 / rate)
    near = within_octave(lines, line)
    if band is not None:
        near &= (lines >= band[0] - rate / length) & (lines <= band[1] + rate / length)
    starts = np.arange(0, max(len(samples) - length + 1, 0), _HOP_PERIODS * rate / line)
    sizes = []
    for place in starts.astype(np.int64):
        part = np.asarray(samples[place : place + length], dtype=np.float64)
        power = np.abs(np.fft.rfft((part - part.mean()) * taper)[near])
        sizes.append(2 / float(taper.sum()) * float(power.max(initial=0.0)))
    size = np.array(sizes)
    # of an exact record's end, rounding is left
    least = 1e-12 * float(np.max(size, initial=0.0)) + float(np.finfo(float).tiny)
    return np.asarray(np.log(np.maximum(size, least)))


def within_octave(lines: NDArray[np.floating[Any]], line: float) -> NDArray[np.bool_]:
    """Return whether lines (n,) [Hz] are within an octave of that of a mode [Hz], clear of its double."""
    return (lines > 0.5 * line) & (lines < 1.6 * line)


def _driven(high: Array) -> int:
    """Find the last spectrum in which the response is driven; 0 where it decays at once."""
    side = SPECTRUM_PERIODS // _HOP_PERIODS
    range_ = np.flatnonzero(high < high[0] - _STANDS_OUT) if len(high) else high
    seen = high[: int(range_[0]) + side] if len(range_) else high
    if len(seen) < 3 * side:
        return 0
    fall = (seen[:-side] - seen[side:]) / side
    # the pace of the last 1/e, which is certainly free
    low = float(np.min(seen))
    if not seen[0] > low:
        return 0
    above = int(np.flatnonzero(seen > low + min(1.0, float(seen[0] - low) / 2))[-1])
    below = above + int(np.argmin(seen[above:]))
    last_pace = float(seen[above] - seen[below]) / max(below - above, 1)
    steady = np.flatnonzero(np.diff(np.concatenate([[0], fall < _STEADY * last_pace, [0]])))
    for begin, end in zip(steady[-2::-2], steady[::-2], strict=True):
        after = fall[min(end + side, len(fall) - 1) : end + 3 * side]
        pace = float(np.median(after))
        # how far the amplitude falls over the stretch, and how far it would have fallen
        fell = float(seen[begin] - seen[end]) / max(end - begin, 1)
        if end - begin >= max(side, _LASTS / max(pace, 1e-9)) and fell < _STEADY * pace:
            return int(end + 1)
    return 0


def _floor(high: Array) -> float:
    """Find the amplitude at which a decay ends in noise or hum; 0 where the record ends before."""
    last = len(high) - len(high) // _END
    if len(high) - last < _FEWEST:
        return 0.0
    tail = high[last:]
    middle = len(tail) // 2
    falls = float(np.median(tail[:middle]) - np.median(tail[middle:])) / middle
    # the pace before: from the top to half of the way down to the tail
    way = float(high[0] - np.median(tail))
    reached = np.flatnonzero(high < high[0] - way / 2)
    if way < _FALLS or not len(reached) or reached[0] == 0:
        return 0.0
    pace = way / 2 / float(reached[0])
    return float(np.exp(np.median(tail))) if falls < _FLAT * pace else 0.0


def _after_clipping(history: TimeHistory, begin: int, end: int) -> int:
    """Find the first sample after the last that is cut off at the end of the range."""
    values = history.response[begin:end]
    last = 0
    for sign in (1, -1):
        if clipped_samples(values, sign):
            flat = np.flatnonzero(values == sign * np.max(sign * values))
            last = max(last, int(flat[-1]) + 1)
    return begin + last


def force_ends(history: TimeHistory, end: int) -> int | None:
    """Find the first sample after the last force before ``end``; None where no force was measured."""
    if history.force is None:
        return None
    force = np.asarray(history.force, dtype=np.float64)
    # an amplifier's offset is no force
    rest = force[-max(len(force) // _TAIL, 1) :]
    size = np.abs(force - np.median(rest))
    largest = float(size.max())
    if not largest > 0 and not force.any():
        return None
    noise = _NOISE * float(np.median(np.abs(rest - np.median(rest))))
    if noise > largest and largest > _CREST * float(np.std(rest)):
        # noise alone: nothing was fed in
        return None
    noise = min(noise, largest / 2)
    active = (
        np.flatnonzero(size[:end] > max(MAX_IDLE_FORCE * largest, noise))
        if largest > 0
        else np.array([end - 1])
    )
    if not len(active):
        return None
    if active[-1] + MIN_SAMPLES > end:
        raise MeasurementError(f"{history.label}: the force does not end; a free decay is needed")
    return int(active[-1]) + 1
