"""Free decays to a response surface: k(X) and c(X) with the mode's frequency as reference and no force.

In a free decay the complex rate s (growth and frequency) of the fundamental obeys, to first order in the slow
change, 0 = k(X) + c(X) s + m (s^2 + s'), so that per unit mass

    c/m = -Im(s^2 + s')/Im s,        k/m = -Re(s^2 + s') - (c/m) Re s.

Higher harmonics X_h decay, too: compared with a steady motion of omega^2 = k(X)/m they have an inertia

    F_h/m = -((h omega)^2 X_h + A_h),        A_h = (s_h^2 + s_h') X_h,

which is -i (2 h omega X_h' + h omega' X_h) to first order. It acts as a force would; without it harmonics are
those of the steady motion, X_h + F_h/(m omega^2 (h^2 - 1)), with k(X) for the stiffness that they meet. What
they lose of their energy passes through the fundamental and looks like a gain there, so that c/m is higher by
sum h Im(F_h X_h*)/(m omega |X|^2): of a cubic spring by the share 27 |X_3/X|^2.

About a reference of amplitude and phase, e^(gamma + i theta), the signal Y e^(gamma + i theta) has the rate
Y'/Y + gamma' + i theta', within a window by the series Y(t + d) = Y + Y' d + Y'' d^2/2 + Y''' d^3/6 of its
cubic (Savitzky and Golay 1964, ``envelope``). The next reference is a spline of the rates, with those half
way to the outer ends of the first and the last window: no cubic follows the fall of a fast decay, nor the
phase of one whose frequency changes with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import pi
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray, take_rows
from rsgen.common.errors import MeasurementError
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.data.free_mode import Kinematics
from rsgen.data.history.envelope import (
    HARMONICS,
    LENGTHS_PER_OCTAVE,
    NOISE_WIDTH,
    REFERENCE_PASSES,
    SHORT_WINDOW_PERIODS,
    WINDOW_PERIODS,
    demodulate,
    differentiate,
    displacement_harmonics,
    fit_together,
    highest_order,
    independent_instants,
    place_windows,
    steady_force,
)
from rsgen.data.history.record import MIN_SAMPLES, TimeHistory, as_histories, check_options
from rsgen.data.history.release import (
    SPECTRUM_PERIODS,
    Stretch,
    find_decays,
    first_amplitude,
    force_ends,
    refuse_growth,
    too_short,
    within_octave,
)
from rsgen.data.record_set import DERIVATIVE
from rsgen.data.surface.response_surface import ResponseSurface

_MIN_AMPLITUDE_RATIO = 20.0
"""Amplitude of a point that is used, relative to its scatter: 5 % of noise in c(X)."""
_MAX_NOISE = 0.2
"""Of the force of a point of a surface, relative: c(X) of smaller motions is mostly noise."""
_NEIGHBOURS = 7
"""Points whose scatter about a straight line gives the standard error of the middle one."""
_REACH_OF_WINDOW = 0.375
"""Of its length, from its middle: a motion that stops there changes the slope of the envelope by 0.2 %."""
_NO_MASS = (
    "{}: a free decay determines stiffness and damping per mass only; give the mass, or 1 kg where it is not "
    "known: all parameters are then per kg"
)


@dataclass(frozen=True, slots=True, eq=False)
class FreeDecay:
    """A free decay, point by point as the amplitude falls.

    Parameters
    ----------
    time
        (n,) [s from the first sample].
    frequency
        (n,) sqrt(k/m)/(2 pi): of the steady motion with the same stiffness and mass [Hz].
    damping_ratio
        (n,) c/(2 m omega) [1].
    stiffness, damping
        (n,) k(X) [N/m] and c(X) [N s/m]; per unit mass [1/s^2], [1/s] where the mass is not known.
    stiffness_error, damping_error
        (n,) their standard errors, from the scatter of the neighbours.
    harmonics
        (n, H+1) complex displacement [m]; NaN where not measured.
    mass
        [kg] or None.
    label
        Of the history.
    findings
        Begin and end of the decay in its record, with the reason.
    """

    time: Array
    frequency: Array
    damping_ratio: Array
    stiffness: Array
    damping: Array
    stiffness_error: Array
    damping_error: Array
    harmonics: ComplexArray
    mass: float | None
    label: str
    findings: tuple[Finding, ...] = ()

    @property
    def amplitude(self) -> Array:
        """(n,) X, amplitude of the fundamental of the displacement [m]."""
        return np.asarray(np.abs(self.harmonics[:, 1]))

    @property
    def force(self) -> ComplexArray:
        """(n,) complex amplitude of the force of each motion as a steady one [N].

        Raises
        ------
        MeasurementError
            The mass is not known: without it a decay determines k/m and c/m, but no force.
        """
        if self.mass is None:
            raise MeasurementError(_NO_MASS.format(self.label))
        omega = 2 * pi * self.frequency
        needed = self.stiffness - self.mass * omega**2 + 1j * omega * self.damping
        return np.asarray(needed * self.harmonics[:, 1])


def from_free_decay(
    histories: TimeHistory | Sequence[TimeHistory],
    *,
    mass: float | None = None,
    band: tuple[float, float] | None = None,
    harmonics: int = HARMONICS,
    start: float | Sequence[float | None] | None = None,
) -> ResponseSurface:
    """Turn free decays of one structure into a response surface.

    Every point has the force of its motion as a steady one, F = (k(X) - m omega^2 + i omega c(X)) X; each
    decay is one level, named by its largest force, and has that of its history, if all have one, as a label.
    A record with several blows has several decays; one whose decay cannot be followed is left out if there
    are others.

    Parameters
    ----------
    histories, mass, band, harmonics, start
        One history or several, and the rest, as ``follow_decay`` takes them; ``start`` is one for all or one
        each. Give the mass as 1 where it is not known: all parameters are then per kg.

    Raises
    ------
    MeasurementError
        No decay is found in any record, or the mass is not given.

    Examples
    --------
    >>> t = np.arange(0, 20, 0.005)
    >>> x = 1e-3 * np.exp(-0.5 * t) * np.cos(60 * t)
    >>> surface = from_free_decay(TimeHistory(200, None, x), mass=2.0)
    >>> c = (surface.force / surface.harmonics[:, 1]).imag / surface.omega
    >>> round(float(np.median(c)), 2)  # 2 m 0.5/s
    2.0
    """
    several = as_histories(histories, "free decay")
    check_options(several[0].label, band=band, mass=mass, harmonics=harmonics)
    if mass is None:
        raise MeasurementError(_NO_MASS.format(several[0].label))
    starts = list(start) if isinstance(start, Sequence) else [start] * len(several)
    if len(starts) != len(several):
        raise MeasurementError(
            f"start: {len(starts)} instants for {len(several)} histories; give one or one each"
        )
    records = _follow_records(several, starts, _Rule(mass, band, harmonics))
    decays = [_certain(decay) for record in records for decay in record.decays]
    if not decays:
        faults = [record.fault for record in records]
        several_faults = f"none of the {len(faults)} records can be used: " + "; ".join(faults)
        raise MeasurementError(several_faults if len(faults) > 1 else faults[0])
    labels = [record.history.level for record in records for _ in record.decays]
    used = ", ".join(record.history.label for record in records if record.decays)
    findings = [Finding("force-of-decay", "info", "", {"mass": Quantity(mass, "kg")}, {"record": used})]
    findings += [
        Finding("decay-taken", "warning", names={"record": record.history.label, "reason": record.fault})
        for record in records
        if not record.decays
    ]
    force = [decay.force for decay in decays]
    counts = [len(part) for part in force]
    level = [float(f"{np.max(np.abs(part)):.3g}") for part in force]
    findings += _label_findings(labels, level)
    return ResponseSurface(
        level=np.repeat(level, counts),
        label=None if None in labels else np.repeat(np.array(labels, dtype=np.float64), counts),
        frequency=np.concatenate([decay.frequency for decay in decays]),
        force=np.concatenate(force),
        harmonics=np.concatenate([decay.harmonics for decay in decays]),
        sweep="rest",
        overlapping=True,
        findings=(*findings, *(finding for decay in decays for finding in decay.findings)),
    )


def _label_findings(labels: Sequence[float | None], level: Sequence[float]) -> list[Finding]:
    """Say which label is which level [N] of decays, where all have one."""
    if None in labels:
        return []
    names = {"labels": ", ".join(f"{one:g}" for one in labels), "unit": "N", "by": "decay"}
    names["amounts"] = ", ".join(f"{one:g} N" for one in level)
    return [Finding("levels-disagree", "info", names=names)]


def _certain(decay: FreeDecay) -> FreeDecay:
    """Leave out the end of a decay, where noise is too much of the force that a surface has of each point.

    Noise of the force has one size in a record of white noise.
    """
    size = 2 * pi * decay.frequency * decay.amplitude
    noise = float(np.median(decay.damping_error * size))
    padded = np.pad(decay.damping, _NEIGHBOURS // 2, mode="edge")
    damping = np.lib.stride_tricks.sliding_window_view(padded, _NEIGHBOURS).mean(axis=1)
    certain = np.logical_and.accumulate(_MAX_NOISE * damping * size > noise)
    certain[:_NEIGHBOURS] = True
    return take_rows(decay, certain)


def follow_decay(
    history: TimeHistory,
    *,
    mass: float | None = None,
    band: tuple[float, float] | None = None,
    harmonics: int = HARMONICS,
    start: float | None = None,
) -> FreeDecay:
    """Return frequency and damping of a free decay against its amplitude.

    Parameters
    ----------
    history
        Record that begins before the release: the decay begins where a measured force ends, or where the
        response is no longer driven or held displaced, and ends where noise begins. The largest of several
        decays is taken.
    mass
        Modal mass [kg]; without it stiffness and damping come per unit mass.
    band
        (lowest, highest) frequency [Hz] in which the mode is looked for; the strongest line where None.
    harmonics
        Highest harmonic of the displacement.
    start
        Instant of the release [s], if known; a drive that continues after it is a doubt, and a displacement
        that is held until later is left out.

    Raises
    ------
    MeasurementError
        No decay is found: the force never ends, or fewer than some 14 periods stand out of the noise.
    """
    check_options(history.label, band=band, mass=mass, harmonics=harmonics)
    (record,) = _follow_records([history], [start], _Rule(mass, band, harmonics))
    if not record.decays:
        raise MeasurementError(record.fault)
    return max(record.decays, key=lambda decay: float(decay.amplitude[0]))


_Band = tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class _Rule:
    """How decays are followed: arguments of ``follow_decay``, and the periods in a window."""

    mass: float | None
    band: _Band
    harmonics: int
    window: float = WINDOW_PERIODS

    @property
    def short(self) -> bool:
        return self.window < WINDOW_PERIODS


class _Followed(NamedTuple):
    """The decays of a record, or why there is none."""

    history: TimeHistory
    decays: list[FreeDecay]
    fault: str = ""


def _follow_records(
    histories: Sequence[TimeHistory], starts: Sequence[float | None], rule: _Rule
) -> list[_Followed]:
    """Follow the decays of records, in short windows where more of them have decays then.

    Windows have one length in all records, for their noise depends on it.
    """
    records = list[_Followed]()
    for history, start in zip(histories, starts, strict=True):
        try:
            records.append(_Followed(history, _follow_all(history, start, rule)))
        except MeasurementError as fault:
            records.append(_Followed(history, [], str(fault)))
    if rule.short or all(record.decays for record in records):
        return records
    shorter = _follow_records(histories, starts, replace(rule, window=SHORT_WINDOW_PERIODS))
    # long windows where both are as many
    return max(records, shorter, key=lambda followed: sum(bool(record.decays) for record in followed))


def _follow_all(history: TimeHistory, start: float | None, rule: _Rule) -> list[FreeDecay]:
    """Return every decay of a record; one that is too short is left out if there are others."""
    band = rule.band
    ended = force_ends(history, len(history))
    if ended is None and start is None:
        refuse_growth(history, _strongest(history.response, history, band), band)
    if ended is None:
        line = _line_of_motion(history, band)
    else:
        line = _strongest(history.response[ended:], history, band)
    decays, fault = [], None
    stretches = find_decays(history, line, band, start)
    for stretch in stretches:
        try:
            decays.append(_follow_one(history, stretch, rule))
        except MeasurementError as error:
            fault = error
    if fault is not None and not decays:
        raise fault if start is None else MeasurementError(f"{fault}; or the start of {start:g} s cuts it")
    if len(stretches) > 1:
        numbers = {"found": Quantity(len(stretches)), "used": Quantity(len(decays))}
        several = Finding("decay-taken", "info", "", numbers, {"record": history.label})
        rising = [stretch for stretch in stretches if stretch.rises]
        ends = {"end": Quantity(history.start + rising[0].end / history.rate, "s")} if rising else {}
        names = {"record": history.label, "by": "rise"}
        doubts = [Finding("decay-not-free", "doubt", "", ends, names)] if rising else []
        decays[0] = replace(decays[0], findings=(several, *doubts, *decays[0].findings))
    return decays


def _line_of_motion(history: TimeHistory, band: _Band) -> float:
    """Return the frequency [Hz] of the strongest line from the largest response on, or from the hold's end.

    The step from a displacement that is held to rest has more at low frequencies than the motion at its own.
    """
    away = history.response - np.median(history.response)
    loudest = int(np.argmax(np.abs(away)))
    if history.quantity == "displacement":
        passed = loudest + int(np.argmax(away[loudest:] * np.sign(away[loudest]) <= 0))
        line = _strongest(history.response[passed:], history, band)
        # from its largest a motion passes rest within a quarter of a period
        if passed - loudest > history.rate / line / 2:
            return line
    return _strongest(history.response[loudest:], history, band)


def _follow_one(history: TimeHistory, stretch: Stretch, rule: _Rule) -> FreeDecay:
    """Follow the strongest line of a decay: frequency and damping ratio over its falling amplitude."""
    mass, harmonics = rule.mass, rule.harmonics
    begin = stretch.begin
    samples = history.response[begin : stretch.end]
    if len(samples) < MIN_SAMPLES:
        raise MeasurementError(f"{history.label}: {len(samples)} samples of a free decay are too few")
    line = _strongest(samples, history, rule.band)
    time, envelope, curve, stopped = _tracked(samples, history, line, stretch.floor, rule)
    rate, change = curve(time)[:, None], curve.derivative()(time)[:, None]
    order, omega = np.arange(1, envelope.shape[1]), rate[:, 0].imag
    rates, changes = (part.real + 1j * order * part.imag for part in (rate, change))
    motions = differentiate(envelope[:, 1:], rates, changes, history.quantity, time)
    motion = Kinematics(motions.displacement[:, 0], motions.velocity[:, 0], motions.acceleration[:, 0])
    table = displacement_harmonics(envelope[:, :, 0], omega, history.quantity, harmonics)
    table[:, order], loss = _as_steady(motions, order)
    scale = mass if mass is not None else 1.0
    needed, damping = steady_force(np.zeros(len(time), dtype=complex), motion, scale, motion.omega)
    damping = damping + scale * loss
    # the force of friction is straight over its few short windows, c(X) is not
    size = motion.omega * np.abs(table[:, 1]) if rule.short else np.ones(len(time))
    stiffness = np.asarray((needed / motion.displacement).real + scale * motion.omega**2)
    found = FreeDecay(
        time=time + begin / history.rate,
        frequency=motion.omega / (2 * pi),
        damping_ratio=damping / (2 * scale * motion.omega),
        stiffness=stiffness,
        damping=damping,
        stiffness_error=_scatter(stiffness),
        damping_error=_scatter(damping * size) / size,
        harmonics=table,
        mass=mass,
        label=history.label,
    )
    # a reference that the first window does not follow leaves it a bend that noise seldom has
    bend = np.abs(envelope[:, 1, 2])
    if len(time) > _NEIGHBOURS and bend[0] > 3 * np.median(bend):
        found = take_rows(found, np.arange(len(time)) > 0)
    numbers = quantities(excluded=stopped, points=len(time) + stopped)
    left_out = Finding("points-excluded", "info", numbers=numbers, names={"by": "rest"})
    return replace(found, findings=_limits(found, stretch, history, rule) + ((left_out,) if stopped else ()))


def _as_steady(motions: Kinematics, order: NDArray[np.intp]) -> tuple[ComplexArray, Array]:
    """Return displacements (n, h) [m] of the steady motion, and what c/m [1/s] (n,) lacks for harmonics."""
    moved, square = motions.displacement, motions.omega[:, :1] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = motions.velocity / moved
    # another mode near a harmonic, or noise, turns faster than it decays
    turn = np.abs(rate.imag - order * rate.imag[:, :1])
    own = (order > 1) & (turn < order * np.abs(rate.real[:, :1]))
    inertia = np.where(own, -(order**2 * square * moved + motions.acceleration), 0)
    # relative to the fundamental: squares of tiny motions are zero
    size = np.maximum(np.abs(moved[:, :1]), np.finfo(float).tiny)
    work = np.nansum(order * (inertia / size * np.conj(moved / size)).imag, axis=1)
    steady = moved + inertia / (np.maximum(order**2 - 1, 1) * square)
    return steady, work / motions.omega[:, 0]


def _limits(decay: FreeDecay, stretch: Stretch, history: TimeHistory, rule: _Rule) -> tuple[Finding, ...]:
    """Return findings about begin and end of a decay in its record."""
    names = {"record": history.label} | ({} if rule.short else {"windows": "long"})
    size, time = decay.amplitude, decay.time + history.start
    begin = Quantity(history.start + stretch.begin / history.rate, "s")
    unit = (2 * pi * float(decay.frequency[-1])) ** DERIVATIVE[history.quantity]
    numbers = quantities("s", begin=begin, first=time[0], last=time[-1])
    released = first_amplitude(history, stretch.begin, float(decay.frequency[0]))
    numbers |= quantities("m", large=size[0], small=size[-1], floor=stretch.floor / unit, released=released)
    after = "drive" if stretch.driven and not stretch.given else "start" if stretch.given else "blow"
    after = "hold" if stretch.held else after
    findings = [Finding("decay-taken", "info", "", numbers, {**names, "after": after})]
    if stretch.driven and stretch.given:
        findings.append(Finding("decay-not-free", "doubt", "", {"begin": begin}, {**names, "by": "drive"}))
    return tuple(findings)


def _tracked(
    samples: Array, history: TimeHistory, first: float, floor: float, rule: _Rule
) -> tuple[Array, ComplexArray, scipy.interpolate.BSpline, int]:
    """Return instants (n,) [s], envelopes there, rate [1/s] of the line that begins at ``first`` [Hz].

    Last is the number of points left out because the motion stops within their window.
    """
    # less than twice the unknowns of a short window
    coarse = SHORT_WINDOW_PERIODS * history.rate / first < 2 * 4 * (2 * HARMONICS + 1)
    shortest = WINDOW_PERIODS if coarse else SHORT_WINDOW_PERIODS
    needed = shortest * (1 + (_NEIGHBOURS - 1) / NOISE_WIDTH)
    # where friction stops, short windows end as far from the stop as long ones
    stop = needed + WINDOW_PERIODS * _REACH_OF_WINDOW - shortest / 2
    refusal = partial(too_short, samples, history, first, needed, max(needed, stop))
    time, frequency = _follow(samples, history.rate, first)
    # of the longest window, with its rounding
    half = rule.window / 2 * 2 ** (1 / LENGTHS_PER_OCTAVE) / frequency[0]
    end = len(samples) / history.rate
    # windows are nearer to both ends than spectra
    spectra = np.pad(time, 1, constant_values=(0, end)), np.pad(frequency, 1, mode="edge")
    if (rule.short and coarse) or end < 2 * half:
        raise refusal()
    time = independent_instants(lambda t: rule.window / np.interp(t, *spectra), half, end - half)
    stopped, knots, rates = 0, spectra[0], 2j * pi * spectra[1]
    for number in range(REFERENCE_PASSES):
        # what spectra show may jump
        curve = scipy.interpolate.make_interp_spline(knots, rates, k=5 if number else 1)
        time, envelope = _demodulated(samples, history, curve, time, rule)
        loud = _clear(envelope[:, 1, 0], floor)
        growth, change = curve(time).real, curve.derivative()(time).real
        reach = _REACH_OF_WINDOW * WINDOW_PERIODS * 2 * pi / curve(time).imag
        clear = loud & _moving(envelope[:, 1], growth, change, reach)
        stopped += int(np.count_nonzero(loud & ~clear))
        if np.count_nonzero(clear) < _NEIGHBOURS:
            raise refusal()
        time, envelope = time[clear], envelope[clear]
        # half way to the outer ends of the first and the last window
        outer = rule.window / 4 * 2 * pi / curve(time[[0, -1]]).imag * [-1, 1]
        early, late = map(_growth, envelope[[0, -1], 1], outer)
        knots = np.concatenate([time[:1] + outer[0], time, time[-1:] + outer[1]])
        rates = curve(knots) + np.array([early, *(envelope[:, 1, 1] / envelope[:, 1, 0]), late])
        if stopped:
            # towards rest the amplitude is a straight line: cubics follow it, its logarithm does not
            rates = 1j * rates.imag
    return time, envelope, curve, stopped


def _growth(envelope: ComplexArray, after: float) -> complex:
    """Return Y'/Y [1/s] some time [s] ``after`` the middle of a window, from Y, Y', Y'', Y''' (4,) there."""
    powers = after ** np.arange(4) / np.array([1, 1, 2, 6])
    return complex(envelope[1:] @ powers[:3] / (envelope @ powers))


def _demodulated(
    samples: Array,
    history: TimeHistory,
    curve: scipy.interpolate.BSpline,
    time: Array,
    rule: _Rule,
) -> tuple[Array, ComplexArray]:
    """Return instants (n,) [s] and envelopes (n, orders, 4) [SI] against a curve of the rate [1/s]."""
    rate, integral = history.rate, curve.antiderivative()
    period = rate * 2 * pi / curve(time).imag
    orders = highest_order(rule.harmonics, rate, rate / float(np.min(period)))
    windows = place_windows(time * rate, rule.window * period, period, orders, len(samples))
    time = windows.middle / rate

    def reference(t: Array) -> ComplexArray:
        return np.asarray(integral(t), dtype=complex)

    if rule.short:
        envelope = fit_together(samples, rate, reference, windows, max(orders, HARMONICS))[:, : orders + 1]
    else:
        # a curve is known within its windows
        last = np.max(windows.first + windows.step * windows.count, initial=0)
        within = np.clip(np.arange(len(samples)), np.min(windows.first, initial=last), last)
        scaled, every = samples / np.exp(reference(within / rate).real), tuple(range(orders + 1))
        envelope = demodulate(scaled, rate, lambda t: reference(t).imag, windows, every)
    return time, envelope * np.exp(integral(time).real)[:, None, None]


def _strongest(samples: Array, history: TimeHistory, band: _Band) -> float:
    """Return the frequency of the strongest line of the decay in the band [Hz]."""
    taper = np.hanning(2 * len(samples) + 1)[len(samples) + 1 :]
    power = np.abs(np.fft.rfft((samples - np.mean(samples)) * taper))
    line = np.fft.rfftfreq(len(samples), 1 / history.rate)
    allowed = (line > 0) if band is None else (line >= band[0]) & (line <= band[1])
    if not allowed.any() or not power[allowed].max() > np.finfo(float).tiny:
        raise MeasurementError(
            f"{history.label}: nothing moves in the band; a band around the mode is needed"
        )
    return float(line[allowed][np.argmax(power[allowed])])


def _follow(samples: Array, rate: float, first: float) -> tuple[Array, Array]:
    """Return instants (n,) [s] of short spectra, and the strongest line (n,) [Hz] near the first one."""
    length = int(SPECTRUM_PERIODS * rate / first)
    starts = np.arange(0, max(len(samples) - length, 1), max(length // 2, 1))
    taper = np.hanning(length + 2)[1:-1]
    padded = SPECTRUM_PERIODS * length
    line = np.fft.rfftfreq(padded, 1 / rate)
    near = within_octave(line, first)
    strongest = []
    for start in starts:
        part = np.asarray(samples[start : start + length], dtype=np.float64)
        power = np.abs(np.fft.rfft((part - part.mean()) * taper[: len(part)], padded))
        strongest.append(line[near][np.argmax(power[near])])
    return np.asarray((starts + length / 2) / rate), np.array(strongest)


def _clear(envelope: ComplexArray, floor: float) -> NDArray[np.bool_]:
    """Return (n,) True up to the first point whose amplitude is near its scatter or the ``floor``."""
    # fourth differences of noise have 70 times its variance; those of the decay are small
    rough = np.abs(np.diff(envelope, 4)) / np.sqrt(70)
    if not len(rough):
        return np.zeros(len(envelope), dtype=bool)
    # the last fifth, the quiet end, is noise alone
    scatter = float(np.median(rough[-max(len(rough) // 5, 3) :]))
    return np.asarray(
        np.logical_and.accumulate(np.abs(envelope) > _MIN_AMPLITUDE_RATIO * max(scatter, floor))
    )


def _moving(envelope: ComplexArray, growth: Array, change: Array, reach: Array) -> NDArray[np.bool_]:
    """Return (n,) True up to the first point whose amplitude comes to zero within its ``reach`` [s].

    By value, slope and bend of the envelope (n, 4), against a reference that has a ``growth`` [1/s] with its
    ``change`` [1/s^2] (n,): an exponential decay never does, dry friction stops.
    """
    with np.errstate(all="ignore"):
        # NaN where nothing moves
        slope, bend = (envelope[:, 1:3] / envelope[:, :1]).T
        bend = bend.real + slope.imag**2 + 2 * growth * slope.real + growth**2 + change
        left = 1 + (slope.real + growth) * reach + bend * reach**2 / 2
    return np.asarray(np.logical_and.accumulate(left > 0))


def _scatter(values: Array) -> Array:
    """Return the standard error of each value (n,): the scatter of its neighbours about a straight line."""
    half = _NEIGHBOURS // 2
    k = np.arange(_NEIGHBOURS) - half
    views = np.lib.stride_tricks.sliding_window_view(values, _NEIGHBOURS)
    line = views.mean(axis=1)[:, None] + (views @ k / float(k @ k))[:, None] * k
    spread = np.sqrt(np.sum((views - line) ** 2, axis=1) / (_NEIGHBOURS - 2))
    return np.asarray(np.pad(spread, half, mode="edge"))
