"""Free decay to the same curves k(X) and c(X): the mode's own frequency is the reference, its force is zero.

In a free decay the complex rate s (growth and frequency) of the fundamental obeys, to first order in the slow
change, 0 = k(X) + c(X) s + m (s^2 + s'), so that per unit mass

    c/m = -Im(s^2 + s')/Im s,        k/m = -Re(s^2 + s') - (c/m) Re s.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from rsgen.errors import MeasurementError
from rsgen.finding import Finding
from rsgen.history.envelope import NOISE_WIDTH, demodulate, place_windows
from rsgen.history.quasi_steady import steady_force
from rsgen.history.record import TimeHistory
from rsgen.history.sensor import Motion, displace
from rsgen.surface import ResponseSurface

__all__ = ["RingDown", "follow_decay"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

PERIODS = 10.0
HARMONICS = 5
_NYQUIST = 0.45
_ROUNDS = 4
_LOOK = 8
"""Periods of the spectra that follow the frequency at first."""

_CLEAR = 20.0
"""A point is used where the amplitude is this many times its own scatter."""

_RESTS = 0.02
"""The force is off where it is below this fraction of its largest."""

_GROUP = 7
"""Neighbouring points whose scatter about a straight line gives the standard error of the middle one."""


@dataclass(frozen=True, slots=True, eq=False)
class RingDown:
    """A free decay, point by point as the amplitude falls.

    Parameters
    ----------
    time
        (n,) [s from the first sample].
    frequency
        (n,) of the steady motion with the same stiffness and mass, sqrt(k/m)/(2 pi) in effect [Hz].
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

    @property
    def amplitude(self) -> Array:
        """(n,) X, amplitude of the fundamental of the displacement [m]."""
        return np.asarray(np.abs(self.harmonics[:, 1]))

    def surface(self) -> ResponseSurface:
        """Write the decay as points of a steady test: each with the force that would have held it.

        Raises
        ------
        MeasurementError
            The mass is not known: without it a decay tells k/m and c/m, but no force.
        """
        if self.mass is None:
            raise MeasurementError(
                f"{self.label}: a free decay tells stiffness and damping per mass only; give the mass of the "
                "system, or 1 kg where it is not known: all parameters are then per kg"
            )
        omega = 2 * pi * self.frequency
        needed = self.stiffness - self.mass * omega**2 + 1j * omega * self.damping
        return ResponseSurface(
            # one test, one level: the largest force that would have been needed
            level=float(f"{np.max(np.abs(needed) * self.amplitude):.3g}"),
            frequency=self.frequency,
            force=needed * self.harmonics[:, 1],
            harmonics=self.harmonics,
            sweep="rest",
            findings=(Finding("force-of-decay", "info", names={"record": self.label}),),
        )

    def differ(self, forced: ResponseSurface) -> tuple[float, float]:
        """Compare with a forced test of the same structure: median relative difference of k(X) and of c(X).

        Only forced points within the amplitudes of the decay and within three half widths of resonance count,
        since k(X) of a point far from it is the small difference of large numbers.

        Raises
        ------
        MeasurementError
            The mass is not known, or the two tests share no amplitude.
        """
        if self.mass is None:
            raise MeasurementError(f"{self.label}: give the mass to compare with a forced test")
        order = np.argsort(self.amplitude)
        size = self.amplitude[order]
        x = forced.harmonics[:, 1]
        dynamic = forced.force / x
        omega = forced.omega
        stiffness = np.interp(np.abs(x), size, self.stiffness[order])
        damping = np.interp(np.abs(x), size, self.damping[order])
        near = np.abs(dynamic.real) < 3 * np.abs(dynamic.imag)
        shared = forced.settled & near & (np.abs(x) >= size[0]) & (np.abs(x) <= size[-1])
        if not shared.any():
            raise MeasurementError(
                f"{self.label}: the free and the forced test share no amplitude near resonance"
            )
        own = dynamic.real + self.mass * omega**2
        return (
            float(np.median(np.abs(own / stiffness - 1)[shared])),
            float(np.median(np.abs(dynamic.imag / omega / damping - 1)[shared])),
        )


def follow_decay(
    history: TimeHistory,
    *,
    mass: float | None = None,
    band: tuple[float, float] | None = None,
    harmonics: int = HARMONICS,
) -> RingDown:
    """Follow frequency and damping of a free decay against its amplitude.

    Parameters
    ----------
    history
        From anywhere before the release on; where a force was measured, the decay begins when it ends.
    mass
        Modal mass [kg]; without it stiffness and damping come per unit mass.
    band
        (lowest, highest) frequency [Hz] in which the mode is looked for; the strongest line where None.
    harmonics
        Highest harmonic of the displacement.

    Raises
    ------
    MeasurementError
        No decay is found: the force never ends, or fewer than some 40 periods stand out of the noise.
    """
    rate = history.rate
    begin = _release(history)
    samples = history.response[begin:]
    if len(samples) < 64:
        raise MeasurementError(f"{history.label}: the force does not end; a free decay is needed")
    first = _strongest(samples, rate, band)
    time, frequency = _follow(samples, rate, first)
    for _ in range(_ROUNDS):
        curve = PchipInterpolator(time, frequency, extrapolate=True)
        turns, slope = curve.antiderivative(), curve.derivative()
        lowest, highest = time[0], time[-1]

        def phase(i: Array, turns: PchipInterpolator = turns) -> Array:
            return np.asarray(2 * pi * turns(i / rate))

        t = _instants(curve, lowest, highest)
        period = rate / curve(t)
        orders = max(1, min(harmonics, int(_NYQUIST * rate / float(np.max(curve(t))))))
        windows = place_windows(t * rate, PERIODS * period, period, orders, len(samples))
        if len(windows) < 2 * _GROUP:
            raise MeasurementError(
                f"{history.label}: the decay at {first:.4g} Hz stands out for only {len(windows)} "
                f"independent windows of {PERIODS:g} periods; at least {2 * _GROUP} are needed"
            )
        kinds = tuple(range(orders + 1))
        envelope = demodulate(samples, phase, windows, kinds) * np.array([1.0, rate, rate**2])
        t = windows.middle / rate
        growth = envelope[:, 1, 1] / envelope[:, 1, 0]
        time, frequency = t, np.asarray(curve(t) + growth.imag / (2 * pi))
        kept = _clear(envelope[:, 1, 0])
        time, frequency = time[kept], frequency[kept]
        if len(time) < 2 * _GROUP:
            raise MeasurementError(
                f"{history.label}: the decay at {first:.4g} Hz does not stand out of the noise long enough"
            )
    omega, change = 2 * pi * np.asarray(curve(t)), 2 * pi * np.asarray(slope(t))
    motion = displace(envelope[:, 1], omega, change, history.quantity)
    motion = Motion(*(getattr(motion, name)[kept] for name in Motion.__slots__))
    table = np.full((int(kept.sum()), harmonics + 1), np.nan, dtype=complex)
    power = {"displacement": 0, "velocity": 1, "acceleration": 2}[history.quantity]
    for order in kinds[0 if power == 0 else 1 :]:
        table[:, order] = (envelope[:, order, 0] / (1j * max(order, 1) * omega) ** power)[kept]
    if power == 0:
        table[:, 0] = table[:, 0].real
    table[:, 1] = motion.displacement
    scale = mass if mass is not None else 1.0
    needed, damping = steady_force(np.zeros(len(time), dtype=complex), motion, scale)
    stiffness = (needed / motion.displacement).real + scale * motion.omega**2
    return RingDown(
        time=time + begin / rate,
        frequency=motion.omega / (2 * pi),
        damping_ratio=damping / (2 * scale * motion.omega),
        stiffness=np.asarray(stiffness),
        damping=damping,
        stiffness_error=_scatter(np.asarray(stiffness)),
        damping_error=_scatter(damping),
        harmonics=table,
        mass=mass,
        label=history.label,
    )


def _release(history: TimeHistory) -> int:
    """Find the first sample of the free decay."""
    n = len(history)
    if history.force is not None:
        size = np.abs(np.asarray(history.force))
        largest = float(size.max())
        if largest > 0:
            return int(n - np.argmax(size[::-1] > _RESTS * largest))
    return int(np.argmax(np.abs(history.response)))


def _strongest(samples: NDArray[np.float64], rate: float, band: tuple[float, float] | None) -> float:
    taper = np.hanning(2 * len(samples) + 1)[len(samples) + 1 :]
    power = np.abs(np.fft.rfft((samples - np.mean(samples)) * taper))
    line = np.fft.rfftfreq(len(samples), 1 / rate)
    allowed = (line > 0) if band is None else (line >= band[0]) & (line <= band[1])
    if not allowed.any() or not power[allowed].max() > 0:
        raise MeasurementError("free decay: nothing moves in the band; a band around the mode is needed")
    return float(line[allowed][np.argmax(power[allowed])])


def _follow(samples: NDArray[np.float64], rate: float, first: float) -> tuple[Array, Array]:
    """Follow the strongest line near the first one through short spectra."""
    length = int(_LOOK * rate / first)
    starts = np.arange(0, max(len(samples) - length, 1), max(length // 2, 1))
    taper = np.hanning(length + 2)[1:-1]
    padded = 8 * length
    line = np.fft.rfftfreq(padded, 1 / rate)
    near = (line > 0.5 * first) & (line < 1.6 * first)
    out = np.empty(len(starts))
    for i, start in enumerate(starts):
        part = np.asarray(samples[start : start + length], dtype=np.float64)
        power = np.abs(np.fft.rfft((part - part.mean()) * taper[: len(part)], padded))
        out[i] = line[near][np.argmax(power[near])]
    return np.asarray((starts + length / 2) / rate), out


def _instants(curve: PchipInterpolator, begin: float, end: float) -> Array:
    """Lay instants as far apart as windows of PERIODS periods are independent."""
    dense = np.linspace(begin, end, 4001)
    count = np.concatenate([[0.0], np.cumsum(np.diff(dense) * curve(dense)[1:] * NOISE_WIDTH / PERIODS)])
    return np.asarray(np.interp(np.arange(int(count[-1]) + 1), count, dense))


def _clear(envelope: ComplexArray) -> NDArray[np.bool_]:
    """Tell points well above their own scatter, up to the first that is not."""
    scatter = np.zeros(len(envelope))
    bend = np.abs(envelope[:-2] - 2 * envelope[1:-1] + envelope[2:]) / np.sqrt(6)
    # at the quiet end the bend is noise alone
    scatter[:] = float(np.median(bend[-max(len(bend) // 5, 3) :]))
    clear = np.abs(envelope) > _CLEAR * scatter
    stop = int(np.argmin(clear)) if not clear.all() else len(clear)
    return np.asarray(np.arange(len(envelope)) < stop)


def _scatter(values: Array) -> Array:
    """Standard error of each value: scatter of its neighbours about a straight line through them."""
    half = _GROUP // 2
    k = np.arange(_GROUP) - half
    views = np.lib.stride_tricks.sliding_window_view(values, _GROUP)
    line = views.mean(axis=1)[:, None] + (views @ k / float(k @ k))[:, None] * k
    spread = np.sqrt(np.sum((views - line) ** 2, axis=1) / (_GROUP - 2))
    return np.asarray(np.pad(spread, half, mode="edge"))
