"""Begin and end of the free decays of a record: after a drive or a blow, before noise or the next blow."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil, log, pi
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError
from rsgen.common.tolerances import MISFIT_NEGLIGIBLE, OUTLIER_SIGMAS, ROUND_OFF, deviation_of_median
from rsgen.data.history.record import MAX_IDLE_FORCE, MIN_SAMPLES, TimeHistory, clipped_samples
from rsgen.data.record_set import DERIVATIVE

SPECTRUM_PERIODS = 8
"""Periods in a spectrum that shows the amplitude: fewer than a decay has, enough to resolve the mode."""
_HOP_PERIODS = 2
"""Periods from one spectrum to the next."""
_MIN_RISE = log(3.0)
"""Of the logarithm of the amplitude by a new excitation; beats of a tenth and noise rise by less."""
_MIN_RISE_ABOVE_QUIET = log(10.0)
"""Of the logarithm from the quietest tenth of the record to the begin of a decay; noise has log 7."""
_MAX_FALL_OF_DRIVE = log(20.0)
"""Of the logarithm, within which the end of a steady drive is looked for."""
_SPECTRA_OF_BLOW = 3
"""Within which a blow raises the amplitude threefold; two modes that beat take longer."""
_MAX_DROP_OF_DRIVE = 0.3
"""Of the logarithm of a driven response before its largest value, or from begin to end: what dry friction
stops falls ever faster, and much more than this before it is fast."""
_MAX_PACE_OF_DRIVE = 0.25
"""Of a driven response, over the pace at which the amplitude falls afterwards."""
_MIN_TIME_OF_DRIVE = 0.5
"""Of a drive, over the time in which the amplitude then falls to 1/e."""
_MAX_PACE_OF_FLOOR = 0.1
"""Of the amplitude at the end of a record, over that of the decay, where noise or hum is left."""
_FLOOR_PARTS = 4
"""Of a record, in the last of which the floor is looked for."""
_MIN_SPECTRA = 8
"""In that part, for a median of either half."""
_SHARE_OF_HOLD = 0.9
"""Of the largest displacement after a release, which a held one exceeds."""
_SHARE_AT_REST = 0.2
"""Of the largest response after a release, which one at rest stays below."""
_REST_PARTS = 10
"""Of a record; the last gives offset and noise of the force."""
_MAX_CREST_OF_SINE = 2.5
"""Peak over standard deviation, which noise exceeds; that of a sine is 1.4."""
_MIN_FALL = log(1.1)
"""Of the logarithm of the amplitude in a decay."""
_RATIOS_OF_RELEASE = (0.6, 1.6)
"""Frequency of the first period of a decay over that of its first window: a hardening spring was faster."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A free decay in a record.

    Parameters
    ----------
    begin, end
        First sample, and the one after the last.
    driven
        True if a drive or a blow ends at ``begin``; with a given start, if a drive continues after it.
    given
        True if the begin was given.
    held
        True if the structure was held displaced until ``begin``.
    rises
        True if the amplitude rises again at ``end``, and too slowly for a blow.
    floor
        Amplitude of noise or hum in which it ends [unit of the response]; 0 if the record ends before.
    """

    begin: int
    end: int
    driven: bool = False
    given: bool = False
    held: bool = False
    rises: bool = False
    floor: float = 0.0


def find_decays(
    history: TimeHistory, line: float, band: tuple[float, float] | None, start: float | None = None
) -> list[Stretch]:
    """Return the free decays of a record near a ``line`` [Hz], in the order of time.

    ``start`` [s] is the release if known: samples before it are left out, and a decay begins there.

    Raises
    ------
    MeasurementError
        No decay: the force does not end, or the amplitude does not fall.
    """
    first = 0 if start is None else max(0, round((start - history.start) * history.rate))
    period = history.rate / line
    step = _HOP_PERIODS * period
    high = _amplitudes(history.response[first:], history.rate, line, band)
    if not len(high):
        return [Stretch(_release(history, first, len(history), line)[0], len(history))]
    tops = _tops(high)
    found, fault = [], None
    for top, after in pairwise([*tops, len(high)]):
        low = len(high) if after == len(high) else top + int(np.argmin(high[top:after]))
        end = len(history) if after == len(high) else first + int(low * step)
        # a steady drive may begin before its largest value
        up = np.flatnonzero(high[:top] < high[top] - _MAX_DROP_OF_DRIVE)
        back = int(up[-1]) + 1 if len(up) else 0
        part = high[back:low]
        driven = _driven(part)
        try:
            begin, ended = _release(history, first + int(top * step), end, line)
        except MeasurementError as error:
            fault = error
            continue
        if not ended and driven:
            # a spectrum ends after its length, and the next one may contain the drive, too
            begin = first + int((back + driven + SPECTRUM_PERIODS / _HOP_PERIODS + 1) * step)
        seen = ended or driven > 0
        given = start is not None and top == tops[0]
        if given:
            # at rest until later: the start was read off before the release
            rest = _at_rest(history, first, begin)
            # the peak of a decay without drive lies in its first spectra
            seen = rest <= period / 2 and begin > first + SPECTRUM_PERIODS / _HOP_PERIODS * step
            # a sine that passes rest is as near to it for a fifteenth of a period
            begin = first + rest if seen or rest <= period / 8 else begin
            given = seen or not rest
        held = _held_until(history, first, first + int(top * step), end, line)
        if held is not None:
            begin, seen, given = held, True, False
        else:
            begin = max(begin, _after_clipping(history, min(begin, end - 1), end))
        rises = after < len(high) and _slowly(high[top : after + 1])
        free = max(top, back + min(driven, len(part) - 1))
        falls = len(part) < _MIN_SPECTRA or float(high[free] - np.min(part)) > _MIN_FALL
        if falls and begin + MIN_SAMPLES <= end:
            floor = _floor(high[max(back + driven, top) : low])
            found.append(Stretch(begin, end, seen, given, held is not None, rises, floor))
    if not found:
        raise fault or MeasurementError(
            f"{history.label}: the amplitude near {line:.4g} Hz does not fall by a tenth after its largest; "
            "a free decay is needed: a record that goes on after the drive has ended"
        )
    return found


def _tops(high: Array) -> list[int]:
    """Return the spectra at which decays begin: peaks of the amplitude (logarithm, n) after a rise."""
    quiet = float(np.min(high)) - 2 * _MIN_RISE
    tops = scipy.signal.find_peaks(np.concatenate([[quiet], high, [quiet]]), prominence=_MIN_RISE)[0] - 1
    largest = int(np.argmax(high))
    clear = [int(top) for top in tops if high[top] - np.quantile(high, 0.1) > _MIN_RISE_ABOVE_QUIET]
    # equal peaks, as in a steady drive, all have the prominence of the highest: require a rise between them
    parted = [
        top
        for number, top in enumerate(clear)
        if number == 0 or high[top] - float(np.min(high[clear[number - 1] : top])) > _MIN_RISE
    ]
    return parted or [largest]


def _slowly(high: Array) -> bool:
    """Return whether the amplitude (logarithm, n) rises to its last value more slowly than after a blow."""
    low = np.flatnonzero(high < high[-1] - _MIN_RISE)
    return len(high) - 1 - int(low[-1]) > _SPECTRA_OF_BLOW


def refuse_growth(history: TimeHistory, line: float, band: tuple[float, float] | None) -> None:
    """Refuse a record whose amplitude near a ``line`` [Hz] grows to its end, more slowly than by a blow."""
    high = _amplitudes(history.response, history.rate, line, band)
    if not len(high):
        return
    least, most = int(np.argmin(high)), int(np.argmax(high))
    # from its begin to its end, or late and by far
    throughout = least < _SPECTRA_OF_BLOW and most >= len(high) - _SPECTRA_OF_BLOW
    late = float(high[-1] - high[least]) > _MIN_RISE and _slowly(high)
    # with more tops others may fall
    (first, *others) = _tops(high)
    falls = float(high[first] - high[-1]) > _MIN_FALL
    if (late or (throughout and float(np.ptp(high)) > _MIN_FALL)) and not (others or falls):
        raise MeasurementError(
            f"{history.label}: the motion near {line:.4g} Hz grows and does not fall; a free decay is needed"
        )


def _release(history: TimeHistory, onset: int, end: int, line: float) -> tuple[int, bool]:
    """Return the first free sample of a decay whose amplitude is high at ``onset``; whether a force ended."""
    forced = force_ends(history, end)
    if forced is not None and forced > onset - SPECTRUM_PERIODS * history.rate / line:
        return forced, True
    # a blow or a release lies within the first spectrum with the full amplitude
    inside = history.response[onset : min(onset + int(SPECTRUM_PERIODS * history.rate / line) + 1, end)]
    return onset + (int(np.argmax(np.abs(inside - np.mean(inside)))) if len(inside) else 0), False


def _held_until(history: TimeHistory, first: int, onset: int, end: int, line: float) -> int | None:
    """Return where a structure is let go that was held displaced for more than a period; None if it was not.

    It is the last displacement near ``onset`` that stays to one side of rest for so long, as far out as all
    that follow, and the median of it is left within a quarter of a period.
    """
    if history.quantity != "displacement":
        return None
    reach = int(SPECTRUM_PERIODS * history.rate / line)
    begin = max(first, onset - reach)
    away = history.response[begin : min(onset + reach, end)] - np.median(history.response[onset:end])
    turns = [0, *(np.flatnonzero(np.diff(np.sign(away))) + 1).tolist()]
    for low, high in reversed(list(pairwise(turns))):
        size = np.abs(away[low:high])
        largest = float(np.max(np.abs(away[high:])))
        if len(size) > history.rate / line and float(np.median(size)) > _SHARE_OF_HOLD * largest:
            return begin + low + int(np.flatnonzero(size >= np.median(size))[-1])
    return None


def _at_rest(history: TimeHistory, first: int, begin: int) -> int:
    """Return for how many samples from ``first`` on a structure is at rest that moves at ``begin``."""
    away = np.abs(history.response[first : begin + 1] - np.median(history.response[first:]))
    return int(np.argmax(away > _SHARE_AT_REST * away[-1]))


def _amplitudes(samples: NDArray[Any], rate: float, line: float, band: tuple[float, float] | None) -> Array:
    """Return the logarithm of the amplitude near ``line`` [Hz] in short spectra, one every two periods."""
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
    least = ROUND_OFF * float(np.max(size, initial=0.0)) + float(np.finfo(float).tiny)
    return np.asarray(np.log(np.maximum(size, least)))


def within_octave(lines: NDArray[np.floating[Any]], line: float) -> NDArray[np.bool_]:
    """Return whether lines (n,) [Hz] are within an octave of that of a mode [Hz], clear of its double."""
    return (lines > 0.5 * line) & (lines < 1.6 * line)


def _driven(high: Array) -> int:
    """Return the number of spectra (logarithm of the amplitude, n) with a steady drive; 0 without one."""
    side = SPECTRUM_PERIODS // _HOP_PERIODS
    range_ = np.flatnonzero(high < high[0] - _MAX_FALL_OF_DRIVE) if len(high) else high
    seen = high[: int(range_[0]) + side] if len(range_) else high
    if len(seen) < 3 * side:
        return 0
    fall = (seen[:-side] - seen[side:]) / side
    # pace of the last 1/e, which is free
    low = float(np.min(seen))
    if not seen[0] > low:
        return 0
    above = int(np.flatnonzero(seen > low + min(1.0, float(seen[0] - low) / 2))[-1])
    below = above + int(np.argmin(seen[above:]))
    last_pace = float(seen[above] - seen[below]) / max(below - above, 1)
    steady = np.flatnonzero(np.diff(np.concatenate([[0], fall < _MAX_PACE_OF_DRIVE * last_pace, [0]])))
    for begin, end in zip(steady[-2::-2], steady[::-2], strict=True):
        after = fall[min(end + side, len(fall) - 1) : end + 3 * side]
        pace = float(np.median(after))
        fell = float(seen[begin] - seen[end])
        if end - begin >= max(side, _MIN_TIME_OF_DRIVE / max(pace, 1e-9)) and fell < min(
            _MAX_DROP_OF_DRIVE, _MAX_PACE_OF_DRIVE * pace * (end - begin)
        ):
            return int(end + 1)
    return 0


def _floor(high: Array) -> float:
    """Return the amplitude of noise or hum in which a decay ends; 0 if the record ends before."""
    last = len(high) - len(high) // _FLOOR_PARTS
    if len(high) - last < _MIN_SPECTRA:
        return 0.0
    tail = high[last:]
    middle = len(tail) // 2
    falls = float(np.median(tail[:middle]) - np.median(tail[middle:])) / middle
    # the pace of the decay: from the top to half of the way down to the tail
    way = float(high[0] - np.median(tail))
    reached = np.flatnonzero(high < high[0] - way / 2)
    if way < _MIN_FALL or not len(reached) or reached[0] == 0:
        return 0.0
    pace = way / 2 / float(reached[0])
    return float(np.exp(np.median(tail))) if falls < _MAX_PACE_OF_FLOOR * pace else 0.0


def _after_clipping(history: TimeHistory, begin: int, end: int) -> int:
    """Return the first sample after the last clipped one."""
    values = history.response[begin:end]
    last = 0
    for sign in (1, -1):
        if clipped_samples(values, sign):
            flat = np.flatnonzero(values == sign * np.max(sign * values))
            last = max(last, int(flat[-1]) + 1)
    return begin + last


def first_amplitude(history: TimeHistory, begin: int, frequency: float) -> float:
    """Return the amplitude [m] of the first period of a decay: of the sine that is nearest to it."""
    samples = np.asarray(
        history.response[begin : begin + int(history.rate / frequency) + 1], dtype=np.float64
    )
    turn = 2 * pi * frequency * np.arange(len(samples)) / history.rate

    def fitted(ratio: float) -> tuple[float, float]:
        columns = np.stack([np.ones_like(turn), np.cos(ratio * turn), np.sin(ratio * turn)], axis=1)
        parts = np.linalg.lstsq(columns, samples, rcond=None)[0]
        return float(np.sum((samples - columns @ parts) ** 2)), float(np.hypot(*parts[1:]))

    ratio = scipy.optimize.minimize_scalar(lambda r: fitted(r)[0], bounds=_RATIOS_OF_RELEASE).x
    return fitted(ratio)[1] / float(2 * pi * frequency * ratio) ** DERIVATIVE[history.quantity]


def force_ends(history: TimeHistory, end: int) -> int | None:
    """Return the first sample after the last force before ``end``; None where there is no force."""
    if history.force is None:
        return None
    force = np.asarray(history.force, dtype=np.float64)
    # without the offset of the amplifier
    rest = force[-max(len(force) // _REST_PARTS, 1) :]
    size = np.abs(force - np.median(rest))
    largest = float(size.max())
    if not largest > 0 and not force.any():
        return None
    noise = OUTLIER_SIGMAS * deviation_of_median(float(np.median(np.abs(rest - np.median(rest)))))
    if noise > largest and largest > _MAX_CREST_OF_SINE * float(np.std(rest)):
        # noise only: the structure was not driven
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


def too_short(
    samples: Array, history: TimeHistory, line: float, needed: float, if_stopped: float
) -> MeasurementError:
    """Return the refusal of a decay (n,) at a ``line`` [Hz], with the cause that its record shows.

    Some periods are ``needed``, and some ``if_stopped`` by friction.
    """
    period = max(min(round(history.rate / line), len(samples) // 2), 1)
    count = len(samples) // period
    size = np.ptp(np.asarray(samples, dtype=np.float64)[: count * period].reshape(-1, period), axis=1) / 2
    tail = scipy.signal.detrend(samples[-max(len(samples) // _REST_PARTS, 3 * period) :])
    # what moves repeats itself, noise does not
    goes_on = bool(np.std(tail[period:] - tail[:-period]) < np.std(tail))
    largest = max(float(size[0]), float(np.finfo(float).tiny))
    rest = 0.0 if goes_on else float(np.median(size[-max(count // _REST_PARTS, 2) :]))
    rest = max(rest, MISFIT_NEGLIGIBLE * largest)
    size = size[: int(np.max(np.flatnonzero(size > 2 * rest), initial=0)) + 1] / largest
    # of an exponential the time to a half is that of every further half
    halved = int(np.argmax(size < 0.5)) or len(size)
    stops = not goes_on and halved > 1 and 2 < len(size) < halved * -np.log2(rest / largest) / 2
    decay, counted = (
        f"the decay at {line:.4g} Hz",
        f"and {ceil(max(if_stopped, len(size) + 1) if stops else needed)} are needed",
    )
    shown = f"{len(size)} period{'s' * (len(size) > 1)}"
    if 2 * period >= MIN_SAMPLES and np.any(size > 2 * np.minimum.accumulate(size)):
        cause = f"{decay} rises again, as a second mode beats with it: give a band around one mode"
    elif goes_on and len(size) < needed:
        cause = f"the record has {shown} of {decay}, {counted}: record it to its end"
    elif stops:
        slope, step = np.polyfit(size[1:], size[:-1], 1)
        least = 1.0
        for _ in range(round(if_stopped) - len(size) + 1):
            least = float(slope * least + step)
        least *= largest * 1e3 / (2 * pi * line) ** DERIVATIVE[history.quantity]
        cause = f"friction stops {decay} after {shown}, {counted}: release it from {least:.2g} mm or more"
    elif len(size) > needed and 2 * np.median(size[len(size) // 2 :]) > np.median(size[: len(size) // 2]):
        cause = f"the response near {line:.4g} Hz does not fall as a free decay does, or noise hides it"
    else:
        cause = f"{decay} has {shown} above noise, {counted}, 20 times above it: release it further out"
    return MeasurementError(f"{history.label}: {cause}")
