"""Complex envelopes of a signal against a reference phase: synchronous demodulation in one pass, block-wise.

A signal y(t) = Re sum_h Y_h(t) exp(i h phi(t)) is mixed with exp(-i h phi) and a cubic is fitted to it by
weighted least squares within a window of some periods: its value and derivatives at the middle are Y_h to
Y_h'''. That is a low-pass filter (Savitzky and Golay 1964, here with a cos^4 taper, so that the other
harmonics are damped by 100 dB) which does not flatten a peak of the envelope, as a plain average would.
In windows that are too short for that, cubics of all harmonics are fitted together (``fit_together``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.free_mode import FreeMode, Kinematics, estimate_mass
from rsgen.data.history.record import BLOCK_SAMPLES
from rsgen.data.record_set import DERIVATIVE

# ----------------------------------------------------------------------------
# Displacement, velocity and acceleration of harmonics of changing amplitude from one measured quantity.
#
# With y(t) = Re Y(t) exp(i h phi(t)), s = Y'/Y + i h phi' is the complex rate of the harmonic: growth and
# frequency. Differentiation is exact, y' = s y and y'' = (s^2 + s') y; integration is its asymptotic inverse,
# z = y/r with the rate r = s (1 - s'/s^2 - (ln r/s)'/s), repeated for the last term.

HARMONICS = 5
"""Default number of harmonics of the displacement; higher ones of smooth laws are below the noise."""
_MAX_RELATIVE_FREQUENCY = 0.45
"""Of a harmonic, relative to the sampling rate: recorders filter out frequencies near 0.5."""


def highest_order(wanted: int, rate: float, frequency: float) -> int:
    """Return the highest harmonic, at most ``wanted``, that a sampling rate [Hz] resolves; at least 1."""
    return max(1, min(wanted, int(_MAX_RELATIVE_FREQUENCY * rate / frequency)))


_Rates = NDArray[np.complexfloating[Any, Any]]


def differentiate(
    envelope: ComplexArray, rate: _Rates, slope: _Rates, quantity: str, time: Array | None = None
) -> Kinematics:
    """Return the kinematics of harmonics from the envelopes of the measured quantity.

    ``envelope`` (..., 3 or more) is the measured quantity and its time derivatives [SI], ``rate`` (...,) that
    of the reference [1/s], i h phi' of a phase, and ``slope`` (...,) its change [1/s^2]. With instants [s]
    along the first axis integration is of second order in the change.
    """
    y = envelope[..., 0]
    # NaN where nothing moves
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        growth = envelope[..., 1] / y
        s = growth + rate
        change = envelope[..., 2] / y - growth**2 + slope
        if quantity == "displacement":
            return Kinematics(y, s * y, (s**2 + change) * y)
        if quantity == "velocity":
            return Kinematics(y / _integrated(s, change, time), y, s * y)
        r = _integrated(s, change, time)
        return Kinematics(y / r / _integrated(r, r * (s - r), time), y / r, y)


def _integrated(s: ComplexArray, change: ComplexArray, time: Array | None) -> ComplexArray:
    """Return the rates of the integral of harmonics with complex rates s and their ``change``."""
    share = 1 - change / s**2
    if time is not None:
        for _ in range(2):
            share = 1 - change / s**2 - np.gradient(np.log(share), time, axis=0) / s
    return np.asarray(s * share)


def displacement_harmonics(
    measured: ComplexArray, omega: Array, quantity: str, harmonics: int
) -> ComplexArray:
    """Integrate mean and steady harmonics (n, k+1) [SI] of a measured quantity at ``omega`` (n,) [rad/s].

    Returns (n, harmonics + 1) displacement [m]; NaN above k, and for the mean of a velocity or an
    acceleration.
    """
    table = np.full((len(measured), harmonics + 1), np.nan, dtype=complex)
    order = np.arange(1, measured.shape[1])
    table[:, order] = measured[:, order] / (1j * order * omega[:, None]) ** DERIVATIVE[quantity]
    if quantity == "displacement":
        table[:, 0] = measured[:, 0].real
    return table


WINDOW_PERIODS = 10.0
"""Periods in a window: the shortest whose taper separates the harmonics by 100 dB."""
SHORT_WINDOW_PERIODS = 5.0
"""Periods in a window whose harmonics are fitted together: their noise is that of harmonics fitted alone, but
2.7 times as large in windows of four periods."""
REFERENCE_PASSES = 4
"""Passes over a record: the envelope is fitted about a reference, a phase over time, and the phase that is
found is the next reference. Each pass squares the error (``decay``, ``tracking``)."""
_SUMS_PER_PERIOD = 8
"""Of the highest harmonic, to which finer samples are added up: four times the Nyquist rate."""
LENGTHS_PER_OCTAVE = 16
"""Lengths of windows, in steps of 4 %: neighbours have one length and share their sums."""
_INTEGRATION_INSTANTS = 20_001
"""Instants for an integral over a history: at least ten a window in one of 2000 windows."""


@lru_cache(maxsize=256)
def _kernel(count: int) -> Array:
    """Return weights (4, count) of value and first three derivatives at the middle, per sum."""
    place = np.arange(count) - (count - 1) / 2
    taper = np.cos(np.pi * place / count) ** 4
    powers = (place / count)[:, None] ** np.arange(4)
    weights = np.linalg.solve(powers.T @ (taper[:, None] * powers), (powers * taper[:, None]).T)
    return np.asarray(weights * np.array([[1.0], [1 / count], [2 / count**2], [6 / count**3]]))


NOISE_WIDTH = float(4096 * np.sum(_kernel(4096)[0] ** 2))
"""Bandwidth of the demodulation (both sides, equivalent for white noise) [Hz] times window length [s]."""
NOISE_OF_SLOPE = float(
    4096 / (2 * np.pi * WINDOW_PERIODS) * np.linalg.norm(_kernel(4096)[1]) / np.linalg.norm(_kernel(4096)[0])
)
"""Noise of the slope of an envelope over the frequency [rad/s], relative to the noise of its value."""


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Windows of envelopes: (n,) first samples, samples added up before the fit, sums in a window."""

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
    """Return windows around given places, for harmonics up to ``orders``, in a signal of ``size`` samples.

    ``middle``, ``length`` (several periods) and ``period`` of the reference (n,) are in samples; windows that
    do not fit inside are left out.
    """
    middle, length, period = np.broadcast_arrays(middle, length, period)
    finest = period / (_SUMS_PER_PERIOD * max(orders, 1))
    step = np.maximum(1, 2 ** np.floor(np.log2(np.maximum(finest, 1.0)))).astype(np.int64)
    count = np.exp2(np.round(LENGTHS_PER_OCTAVE * np.log2(length / step)) / LENGTHS_PER_OCTAVE)
    count = np.round(count).astype(np.int64)
    # a multiple of the step, so that neighbours share their sums
    first = (np.round((middle - step * count / 2) / step) * step).astype(np.int64)
    inside = (first >= 0) & (first + step * count <= size)
    return Windows(first[inside], step[inside], count[inside])


def independent_instants(
    length: Callable[[Array], Array], begin: float, end: float, most: float | None = None
) -> Array:
    """Return instants [s] at which windows of ``length(t)`` [s] are independent, as densely as that allows.

    With ``most``, at most that many, evenly thinned and ``end`` among them.
    """
    dense = np.linspace(begin, end, _INTEGRATION_INSTANTS)
    count = np.concatenate([[0.0], np.cumsum(np.diff(dense) * NOISE_WIDTH / length(dense)[1:])])
    wanted = np.arange(int(count[-1]) + 1)
    if most is not None:
        wanted = np.linspace(0, count[-1], int(min(max(count[-1], 2), most)))
    return np.asarray(np.interp(wanted, count, dense))


def _batches(windows: Windows) -> list[NDArray[np.intp]]:
    """Return the places of windows, in order, in runs of one step and count that span about a block."""
    first, step, count = windows.first, windows.step, windows.count
    # a gap between windows begins a new run: the samples in it are not needed
    cut = (np.diff(step) != 0) | (np.diff(count) != 0) | (np.diff(first) > (step * count)[:-1])
    batches = []
    for run in np.split(np.arange(len(windows)), np.flatnonzero(cut) + 1):
        while len(run):
            here = int(np.searchsorted(first[run], first[run[0]] + BLOCK_SAMPLES, side="right"))
            batches.append(run[:here])
            run = run[here:]
    return batches


def mean_square(signal: NDArray[Any], windows: Windows) -> Array:
    """Return the mean square of a real signal (n,) in each of the windows, which are in ascending order."""
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
    """Demodulate a real signal (n,), sampled at ``rate`` [Hz], in windows in ascending order.

    ``phase`` gives the reference [rad] at times [s]; ``orders`` are harmonics, ascending, 0 the mean.
    Returns (windows, orders, 4): the envelope and its first three time derivatives.
    """
    out = np.zeros((len(windows), len(orders), 4), dtype=np.complex128)
    for batch in _batches(windows):
        step, count = int(windows.step[batch[0]]), int(windows.count[batch[0]])
        begin = int(windows.first[batch[0]])
        end = int(windows.first[batch[-1]]) + step * count
        samples = np.asarray(signal[begin:end], dtype=np.float64)
        turn = np.exp(-1j * phase(np.arange(begin, end) / rate))
        mixed, reached = np.ones(1, dtype=complex), 0
        kernel = _kernel(count).T / (step / rate) ** np.arange(4) / step
        offsets = (windows.first[batch] - begin) // step
        for column, order in enumerate(orders):
            for _ in range(order - reached):
                mixed = mixed * turn
            reached = order
            sums = (samples * mixed).reshape(-1, step).sum(axis=1)
            views = np.lib.stride_tricks.sliding_window_view(sums, count)[offsets]
            out[batch, column] = (views @ kernel) * (2.0 if order else 1.0)
    return out


def fit_together(
    signal: NDArray[Any], rate: float, reference: Callable[[Array], _Rates], windows: Windows, orders: int
) -> ComplexArray:
    """Fit mean and harmonics up to ``orders`` at once, in windows too short for the taper to part them.

    The cubics of all are unknowns of one weighted least squares, so that none leaks into another.
    ``reference`` is the phase, times i, and the logarithm of the amplitude to which they are relative.
    Returns what ``demodulate`` does.
    """
    out = np.zeros((len(windows), orders + 1, 4), dtype=np.complex128)
    order = np.arange(orders + 1)
    for row, (first, size) in enumerate(zip(windows.first, windows.step * windows.count, strict=True)):
        place = np.arange(size) - (size - 1) / 2
        path = reference((first + np.arange(size)) / rate)[:, None]
        turn = np.exp(path.real + 1j * order * path.imag)
        columns = (turn[:, :, None] * (place / size)[:, None, None] ** np.arange(4)).reshape(size, -1)
        # a mean has no imaginary part
        design = np.concatenate([columns.real, -columns.imag[:, 4:]], axis=1)
        root = np.cos(np.pi * place / size) ** 2
        samples = np.asarray(signal[first : first + size], dtype=np.float64)
        solved = np.linalg.lstsq(design * root[:, None], samples * root, rcond=None)[0]
        real, imaginary = np.split(solved, [columns.shape[1]])
        cubic = real + 1j * np.concatenate([np.zeros(4), imaginary])
        out[row] = cubic.reshape(-1, 4) * np.array([1, 1, 2, 6]) * (rate / size) ** np.arange(4)
    return out


# ----------------------------------------------------------------------------
# The force of the steady states that a sweep passes, with the effect of its transient subtracted.
#
# The response lags behind the sweep: with the complex rate s of the motion (growth and frequency) the
# fundamental of an oscillator m x'' + n(x, x') = f obeys, to first order in the slow change (Krylov and
# Bogoliubov),
#
#     F = k(X) X + c(X) V + m A,        V = s X,  A = (s^2 + s') X,
#
# where a steady state has V = i omega X and A = -omega^2 X at the frequency of the force. Velocity and
# acceleration follow from the envelopes, so that only the mass is unknown; it follows from the same equation
# over all points with k and c free functions of the amplitude. For a linear oscillator the equation is exact
# at any rate. Along one branch of a nonlinear resonance the frequency is itself a function of the amplitude,
# and mass and k(X) are not identifiable together; the flanks, where the amplitude is small and k(X) the same
# below and above the resonance, then determine the mass roughly.
#
# The dimensionless pace of a sweep is rate / (zeta f)^2: the change of the frequency within the decay time of
# the response, relative to the half width of the resonance (Lewis 1932, Trans. ASME 54, 253; Cronin 1965,
# thesis, California Institute of Technology). A slow sweep shifts the resonance by 1/(2 pi) of the pace, in
# half widths: its group delay 1/(2 pi zeta f) times the rate.

MAX_FLANK_AMPLITUDE = 0.2
"""Relative to the largest, up to which k(X) is constant (a cubic spring changes by 4 %); above, points belong
to the resonance, and reach to five half widths."""


def flank_mass(force: ComplexArray, motion: Kinematics) -> FreeMode | None:
    """Return the mass from the flanks of a resonance, with k constant there, to 20 %; None without flanks.

    ``force`` (n,) [N] and ``motion`` are of the fundamental, at points of one sweep or of several.
    """
    size = np.abs(motion.displacement)
    flank = (size > 0) & (size < MAX_FLANK_AMPLITUDE * np.max(size, initial=0.0)) & (np.abs(force) > 0)
    return estimate_mass(force[flank], motion.select(flank), np.ones((np.count_nonzero(flank), 1)))


def steady_force(
    force: ComplexArray, motion: Kinematics, mass: float, omega: Array
) -> tuple[ComplexArray, Array]:
    """Return the force (n,) [N] of the steady motion at ``omega`` [rad/s], and c(X) [N s/m].

    With X, V, A the complex envelopes of displacement, velocity and acceleration, the force that was measured
    is F = k(X) X + c(X) V + m A. Divided by X its imaginary part gives c(X), and then its real part k(X); the
    steady motion of this amplitude needs (k(X) + i omega c(X) - m omega^2) X.
    """
    x = motion.displacement
    # NaN where nothing moves, as in a drop-out
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        stiffness = force / x
        inertia = motion.acceleration / x
        rate = motion.velocity / x
        damping = (stiffness.imag - mass * inertia.imag) / rate.imag
        held = stiffness.real - damping * rate.real - mass * (inertia.real + omega**2) + 1j * omega * damping
        return np.asarray(held * x), np.asarray(damping)
