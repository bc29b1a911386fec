"""Harmonic balance: periodic motions of a mass on nonlinear elements, and all their derivatives.

At a frequency the balance of every harmonic,

    -m (h omega)^2 z_h + N_h(z) = u_h,

has as many real equations as the motion z has coefficients. At a given drive u all coefficients are sought.
At a given amplitude X of the fundamental, whose phase is zero, the two of the drive are sought in its place:
that has one solution also where the response folds over the drive. With one harmonic it is first-order
harmonic balance, Liu et al., Eqs. (4), (5). The law is evaluated on samples of the waveform and projected
back (alternating frequency-time: T. M. Cameron and J. H. Griffin, J. Appl. Mech. 56 (1989) 149).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, Chosen, ComplexArray, blocks, blocks_joined, take_rows
from rsgen.common.solvers import Rows, newton, solve_each
from rsgen.common.tolerances import (
    ASSUMED_DAMPING_RATIO,
    MAX_NEWTON_STEPS,
    MAX_TRIAL_STEPS,
    POINTS_PER_BLOCK,
    RELATIVE_CHANGE_NEGLIGIBLE,
)
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.settling import SteadyStates
from rsgen.law.motion import FourierSeries, Motion, fourier_series, harmonics_of, sine_motion
from rsgen.law.normal_form import ForceSample
from rsgen.law.numeric import ForceLaw, compile_law

ACCEPTED_STEP = 1e-6
"""Relative last step of Newton's method that is still called convergence."""

LONGEST_STEP = 0.5
"""Step of a coefficient, relative to the amplitude that is held: a longer one leaves the branch. At a given
drive no step is limited."""

_MOTION_AT_REST = 1e-9
"""Amplitude, relative to the motion of the mass alone under the drive, at which a structure is at rest."""

_SAMPLES_PER_HARMONIC, _MIN_SAMPLES = 16, 256
"""Samples of a waveform a harmonic: powers up to the fifteenth are projected without aliasing; and at least,
so that few harmonics see the corners of a law as well."""

_MEMORY_SAMPLES_RATIO = 4
"""Times as many samples of a law with memory: its loop is that of steps from sample to sample, O(h^2)."""


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Force and motion at n points with H harmonics, and derivatives by q parameters: law, mass.

    All phases count from one reference a point. The *given amplitude* of a point is that of the fundamental
    (``hold_amplitude``) or that of the force (``respond``, the simulator).

    Parameters
    ----------
    force
        (n,) complex [N].
    harmonics
        (n, H+1) complex [m]; those that are not predicted are zero.
    force_slope, harmonics_slope
        (n,), (n, H+1): derivatives by the logarithm of the given amplitude.
    force_by, harmonics_by
        (n, q), (n, H+1, q): derivatives by the parameters.
    valid
        (n,) False where there is no prediction.
    force_load, harmonics_load
        (n, L), (n, H+1, L): derivatives by real and imaginary parts of the other harmonics of the force
        [N]; None where none were given.
    load_orders
        (L,) which harmonic each of them is a part of.
    force_phase
        (n,) derivative of the force by the phase of the reference; None where all of it follows the response.
    force_far
        (n, 2) derivatives of the force by real and imaginary part of the relative deviation of a far sensor;
        None where there is none.
    across
        (n, H+1) the motion across two sensors that some elements followed [m]; None where there is none.
    """

    force: ComplexArray
    harmonics: ComplexArray
    force_slope: ComplexArray
    harmonics_slope: ComplexArray
    force_by: ComplexArray
    harmonics_by: ComplexArray
    valid: NDArray[np.bool_]
    force_load: ComplexArray | None = None
    harmonics_load: ComplexArray | None = None
    load_orders: NDArray[np.intp] | None = None
    force_phase: ComplexArray | None = None
    force_far: ComplexArray | None = None
    across: ComplexArray | None = None

    @classmethod
    def at_amplitude(
        cls,
        amplitude: Array,
        force: ComplexArray,
        slope: ComplexArray,
        by: ComplexArray,
        orders: int = 1,
        **more: Any,
    ) -> Response:
        """Return the force at amplitudes (n,) [m] of a motion whose other harmonics do not depend on it."""
        harmonics = np.zeros((len(amplitude), orders + 1), dtype=complex)
        harmonics[:, 1] = amplitude
        none = np.zeros((*harmonics.shape, by.shape[1]), dtype=complex)
        return cls(force, harmonics, slope, harmonics, by, none, np.isfinite(force), **more)

    def select(self, chosen: Chosen) -> Response:
        """Take some of the points."""
        return take_rows(self, chosen, "load_orders")

    def motion(self, omega: Array) -> Motion:
        """The motions at frequencies (n,) [rad/s]."""
        return Motion(omega, self.harmonics)

    @classmethod
    def columns(cls) -> list[str]:
        """Names of what has a row a point."""
        return [name for name in cls.__dataclass_fields__ if name != "load_orders"]


def following_harmonics(law: ForceLaw, order: int, *, even: bool = False) -> tuple[int, ...]:
    """Harmonics up to ``order`` that follow from the fundamental: no even ones for an odd law.

    ``even`` says that the force has even harmonics of its own.
    """
    if law.odd and not even:
        return tuple(range(3, order + 1, 2))
    mean = (0,) if law.springs else ()
    return (*mean, *range(2, order + 1))


# ----------------------------------------------------------------------------
# The balance at a held amplitude and at a given drive: the same equations, other unknowns.


def hold_amplitude(
    law: ForceLaw,
    values: Array,
    mass: float,
    omega: Array,
    amplitude: Array,
    start: ComplexArray,
    follow: tuple[int, ...],
    samples: int,
    load: ComplexArray | None = None,
) -> Response:
    """Solve the balance at given amplitudes of the fundamental, whose phase is zero.

    Parameters
    ----------
    law, values, mass
        The force law, its (p,) parameters, and m [kg].
    omega, amplitude
        (n,) [rad/s] and X [m].
    start
        (n, H+1) first guess of the harmonics that follow [m].
    follow
        Harmonics that follow from the balance: a subset of 0, 2, ..., H.
    samples
        Samples a period, more than four times H.
    load
        (n, H+1) harmonics of the force [N] in the phase of the fundamental of the response; the fundamental,
        which is sought, is not looked at. None: there are no others.
    """
    series = _series(law, follow, samples)
    at, given = series.real(start[:, list(series.orders)]), np.zeros((len(omega), len(series.order_of)))
    at[:, 0], at[:, 1] = amplitude, 0.0
    loaded = load is not None and len(series.orders) > 1
    if load is not None:
        given[:, 2:] = series.real(load[:, list(series.orders)])[:, 2:]
    balance = partial(_Balance, law, values, mass, series, first=2, width=start.shape[1])
    found = _solved(balance, omega, given, at, samples, MAX_TRIAL_STEPS, loaded=loaded)
    return replace(found, load_orders=series.order_of[2:]) if loaded else found


def respond(
    law: ForceLaw,
    values: Array,
    mass: float,
    omega: Array,
    drive: ComplexArray,
    start: ComplexArray,
    orders: tuple[int, ...],
    samples: int,
) -> Response:
    """Solve the balance at a given drive, near a motion.

    Parameters
    ----------
    law, values, mass
        As of ``hold_amplitude``.
    omega
        (n,) [rad/s].
    drive
        (n, H+1) complex harmonics of the force [N].
    start
        (n, H+1) motion to begin with [m].
    orders
        Harmonics of the motion other than the fundamental.
    samples
        Samples a period, more than four times H.
    """
    series = _series(law, orders, samples)
    at, given = (series.real(part[:, list(series.orders)]) for part in (start, drive))
    balance = partial(_Balance, law, values, mass, series, first=0, width=start.shape[1])
    return _solved(balance, omega, given, at, samples, MAX_NEWTON_STEPS)


def _solved(
    balance: Callable[[Array, Array, Array], _Balance],
    omega: Array,
    given: Array,
    at: Array,
    samples: int,
    steps: int,
    *,
    loaded: bool = False,
) -> Response:
    """Solve a balance of (n,) frequencies, given forces and motions (n, d) in blocks of points."""
    # of more samples fewer points, so that their arrays do not grow
    parts = blocks(len(omega), min(POINTS_PER_BLOCK, POINTS_PER_BLOCK * _MIN_SAMPLES // samples))
    found = (
        (part, balance(omega[part], given[part], at[part]).solve(steps, loaded=loaded)) for part in parts
    )
    return Response(**blocks_joined(len(omega), found, Response.columns()))


def _series(law: ForceLaw, follow: tuple[int, ...], samples: int) -> FourierSeries:
    # odd harmonics under an odd law repeat with the other sign after half a period; loops need the whole
    half = law.odd and not law.remembers and all(h % 2 for h in follow)
    return fourier_series((1, *follow), samples, half)


class _Balance:
    """The balance at some points in real coordinates, of which those from ``first`` on are sought.

    The first two are the fundamental: at a held amplitude they stay, and the drive is what is left of their
    equations.
    """

    def __init__(
        self,
        law: ForceLaw,
        values: Array,
        mass: float,
        series: FourierSeries,
        omega: Array,
        given: Array,
        at: Array,
        *,
        first: int,
        width: int,
    ) -> None:
        self._law, self._values, self._omega = law, values, omega
        self._series, self._given, self._at, self._first, self._width = series, given, at, first, width
        self._per_mass = -((omega[:, None] * series.order_of) ** 2)
        self._inertia = mass * self._per_mass
        self._last: tuple[Rows, Array, ForceSample, Array] | None = None
        self._slopes: tuple[ForceSample, Array] | None = None

    def _coordinates(self, rows: Rows, unknowns: Array) -> Array:
        return np.concatenate([self._at[rows, : self._first], unknowns], axis=1)

    def _sample(self, rows: Rows, at: Array) -> tuple[ForceSample, Array]:
        """The law along the motions (k, d), and what is left of the balance (k, d) [N]."""
        if self._last is not None:
            known, place, sample, residual = self._last
            if np.array_equal(known, rows) and np.array_equal(place, at):
                return sample, residual
        series, omega = self._series, self._omega[rows, None]
        x, v = at @ series.shape, (omega * at) @ series.rate
        # only switches ask for the acceleration
        a = (omega**2 * at) @ series.bend if self._law.switched else v
        sample = self._law.sample(x, v, a, series.step / omega, self._values)
        residual = self._inertia[rows] * at + sample.force @ series.project - self._given[rows]
        self._last = rows, at, sample, residual
        return sample, residual

    def _tangent(self, rows: Rows, sample: ForceSample) -> Array:
        """(k, d, d) of the balance along a sampled motion."""
        if self._slopes is None or self._slopes[0] is not sample:
            tangent = sample.tangent(self._series, self._omega[rows])
            self._slopes = sample, tangent + self._inertia[rows, :, None] * np.eye(len(self._series.order_of))
        return self._slopes[1]

    def residual(self, rows: Rows, unknowns: Array) -> Array:
        """(k, d - first) of the equations that the unknowns have to fulfil."""
        return self._sample(rows, self._coordinates(rows, unknowns))[1][:, self._first :]

    def step(self, rows: Rows, unknowns: Array) -> tuple[Array, Array, Array]:
        """Residual, Newton's step, and that step relative to the amplitude of the fundamental."""
        at, first = self._coordinates(rows, unknowns), self._first
        sample, residual = self._sample(rows, at)
        left = residual[:, first:]
        move = -solve_each(self._tangent(rows, sample)[:, first:, first:], left[:, :, None])[:, :, 0]
        # a motion that is hardly one is as large as the inertia of the drive would make it
        faint = _MOTION_AT_REST * np.abs(self._given[rows]).max(axis=1) / np.abs(self._inertia[rows, 0])
        scale = np.maximum(np.abs(at[:, :2]).max(axis=1), faint)
        relative_step = np.abs(move).max(axis=1) / np.maximum(scale, 1e-300)
        if first:
            move *= np.minimum(1.0, LONGEST_STEP / np.maximum(relative_step, 1e-300))[:, None]
        return left, move, relative_step

    def solve(self, steps: int, *, loaded: bool = False) -> Response:
        """Solve, and differentiate there; ``loaded`` asks for derivatives by harmonics of the force, too."""
        first, rows = self._first, np.arange(len(self._at))
        before, at, last_step = self._at, self._at, np.zeros(len(rows))
        if at.shape[1] > first:
            roots = newton(self, at[:, first:], steps=steps)
            before, at = (self._coordinates(rows, place) for place in (roots.before, roots.unknowns))
            last_step = roots.last_step
        # Newton's last step dz is small, so that the slopes at its start serve: the residual is r + T dz
        sample, residual = self._sample(rows, before)
        tangent = self._tangent(rows, sample)
        residual = residual + (tangent @ (at - before)[:, :, None])[:, :, 0]
        return self._response(at, residual, tangent, sample, last_step <= ACCEPTED_STEP, loaded=loaded)

    def _response(
        self,
        at: Array,
        residual: Array,
        tangent: Array,
        sample: ForceSample,
        valid: NDArray[np.bool_],
        *,
        loaded: bool,
    ) -> Response:
        """Return a solution with its derivatives, by implicit differentiation of the balance.

        With the balance r(z, p) = 0 and its tangent T = dr/dz, dz/dp = -T^-1 dr/dp. The first ``self._first``
        numbers of z are held, as the amplitude is: their rows then give the force and its derivatives.
        """
        series, first = self._series, self._first
        # of the balance by the logarithm of the given amplitude, the parameters of the law, the mass
        by_log_amplitude = at[:, :1] * tangent[:, :, 0] if first else -self._given
        law = [part @ series.project for part in sample.by_parameter]
        by = np.stack([by_log_amplitude, *law, at * self._per_mass], axis=-1)
        held = np.zeros((len(at), first, by.shape[2]))
        if first:
            held[:, 0, 0] = at[:, 0]
        moved = np.concatenate([held, -solve_each(tangent[:, first:, first:], by[:, first:])], axis=1)
        if first:
            force = residual[:, :2]
            force_by = by[:, :2] + tangent[:, :2, first:] @ moved[:, first:]
        else:
            force = self._given[:, :2]
            force_by = np.zeros((len(at), 2, by.shape[2]))
            force_by[:, :, 0] = force
        complex_by = force_by[:, 0] + 1j * force_by[:, 1]
        harmonics, harmonics_by = self._wide(at), self._wide(moved)
        return Response(
            force=force[:, 0] + 1j * force[:, 1],
            harmonics=harmonics,
            force_slope=complex_by[:, 0],
            harmonics_slope=harmonics_by[:, :, 0],
            force_by=complex_by[:, 1:],
            harmonics_by=harmonics_by[:, :, 1:],
            valid=valid,
            **(self._by_load(tangent) if loaded else {}),
        )

    def _wide(self, coordinates: Array) -> ComplexArray:
        """(n, d, ...) as harmonics (n, H+1, ...)."""
        wide = np.zeros((len(coordinates), self._width, *coordinates.shape[2:]), dtype=complex)
        wide[:, list(self._series.orders)] = self._series.complex(coordinates)
        return wide

    def _by_load(self, tangent: Array) -> dict[str, Any]:
        """Derivatives of force and harmonics by the parts of the force in the harmonics that follow."""
        columns = tangent.shape[1] - 2
        unit = np.broadcast_to(np.eye(columns), (len(tangent), columns, columns))
        higher = solve_each(tangent[:, 2:, 2:], unit)
        force = tangent[:, :2, 2:] @ higher
        moved = np.concatenate([np.zeros((len(tangent), 2, columns)), higher], axis=1)
        return {"force_load": force[:, 0] + 1j * force[:, 1], "harmonics_load": self._wide(moved)}


def all_harmonics(
    law: ForceLaw, values: Array, mass: float, omega: Array, at: Response, samples: int
) -> tuple[ComplexArray, Array, ComplexArray]:
    """Return the motion (1, samples/4) [m] of a balance of few harmonics, and what forces act.

    The force of the law along a motion (1, samples) [N] determines all harmonics of it, in turn with the
    amplitude at which the drive (1,) [N] has its magnitude: x_h = n_h/(m h^2 omega^2). Where the turns do not
    settle, as at stiff stops, the motion of the balance is returned.
    """
    size, level = at.harmonics[:, 1].real, np.abs(at.force)
    gain = (np.conj(at.force) * at.force_slope).real / level / size
    orders, turns = np.arange(samples // 4), list[tuple[ComplexArray, Array, ComplexArray]]()
    motion = np.pad(at.harmonics, ((0, 0), (0, len(orders) - at.harmonics.shape[1])))
    for _ in range(4):
        inner = law.along(Motion(omega, motion), values, samples).force
        found = harmonics_of(inner, len(orders))
        drive = found[:, 1] - mass * omega**2 * size
        turns.append((motion, inner, drive))
        size = size + (level - np.abs(drive)) / gain
        motion = found / (mass * np.maximum(orders, 1) ** 2 * omega**2)
        motion[:, 0], motion[:, 1] = at.harmonics[:, 0], size
    changed = np.linalg.norm(turns[-1][1] - turns[-2][1])
    return turns[-1 if changed < RELATIVE_CHANGE_NEGLIGIBLE * np.linalg.norm(turns[0][1]) else 0]


# ----------------------------------------------------------------------------
# What becomes of a small disturbance y of a motion: m y'' + n_v y' + n_x y = 0.


@np.errstate(over="ignore", invalid="ignore")
def decisive_multiplier(along: ForceSample, mass: float, omega: Array, *, odd: bool) -> ComplexArray:
    """Return the Floquet multiplier that tells, in addition to folds, whether motions (n,) last.

    In one period the two solutions for y change by a matrix, the product of its exponentials from sample to
    sample (W. Magnus, Comm. Pure Appl. Math. 7 (1954) 649, to second order). Its eigenvalues are the
    multipliers (G. Floquet, Ann. Sci. Ec. Norm. Sup. 12 (1883) 47): at a fold one of them passes 1. The
    other is returned: below -1 the period doubles; with a complex one outside the unit circle the motion
    beats. Under an odd law a period is half of one, mirrored, twice, so that each multiplier is the square of
    one of the half: -1 there is 1 here, and beyond it the motion loses its symmetry (a pitchfork). NaN where
    an exponential is out of range.

    Parameters
    ----------
    along
        The law along the motions, at a power of two of samples a period.
    mass, omega
        m [kg] and the frequencies (n,) [rad/s].
    odd
        True for an odd law whose motions have odd harmonics alone.
    """
    samples = along.by_x.shape[1]
    step, used = (2 * np.pi / samples / omega)[:, None], samples // 2 if odd else samples
    damping, stiffness = along.by_v[:, :used] * step / mass, along.by_x[:, :used] * step**2 / mass
    angle = np.sqrt(stiffness - damping**2 / 4 + 0j)
    cosine, sine = np.cos(angle).real, np.sinc(angle / np.pi).real
    rows = [[cosine + sine * damping / 2, sine], [-sine * stiffness, cosine - sine * damping / 2]]
    change = np.moveaxis(np.array(rows) * np.exp(-damping / 2), (0, 1), (2, 3))
    while change.shape[1] > 1:
        change = change[:, 1::2] @ change[:, ::2]
    trace = np.trace(change[:, 0], axis1=1, axis2=2) * (-1 if odd else 1) / 2
    least = trace - np.sqrt(trace**2 - np.exp(-damping.sum(axis=1)) + 0j)
    return np.asarray(least**2 if odd else least)


# ----------------------------------------------------------------------------
# Oscillators: the balance as a virtual test.


def solve_harmonic_balance(
    oscillator: Oscillator,
    force: ComplexArray | Array,
    frequency: Array,
    *,
    harmonics: int,
    guess: ComplexArray | None = None,
) -> SteadyStates:
    """Find periodic motions at a given force by harmonic balance, stable or not, near the guess.

    Parameters
    ----------
    oscillator
        The structure.
    force
        (n,) complex amplitude F [N].
    frequency
        (n,) [Hz].
    harmonics
        H, how many harmonics are balanced, in addition to the mean.
    guess
        (n, H+1) harmonics [m] to start from; None: the response of the mass alone with the slope of the law
        at rest, damped enough to be finite.

    Returns
    -------
    SteadyStates
        ``residual`` is the force that the harmonics leave unbalanced (root mean square over |F|); more
        harmonics make it smaller. ``error`` is not known.
    """
    omega = 2 * np.pi * np.asarray(frequency, dtype=np.float64)
    drive = np.zeros((len(omega), harmonics + 1), dtype=complex)
    drive[:, 1] = force
    law = compile_law(oscillator.force)
    values, mass = law.ordered(oscillator.values), oscillator.mass
    follow = following_harmonics(law, harmonics, even=True)
    with np.errstate(all="ignore"):
        start = _linear_motion(law, values, mass, omega, drive) if guess is None else guess
        for samples in _samples(law, harmonics):
            found = respond(law, values, mass, omega, drive, start, follow, samples)
            start = found.harmonics
    return balance_states(oscillator, found.motion(omega), found.force, found.valid)


def _samples(law: ForceLaw, harmonics: int) -> tuple[int, ...]:
    """Samples a period, one solution after the other: where many are needed, few find the place."""
    few = max(_SAMPLES_PER_HARMONIC * (harmonics + 1), _MIN_SAMPLES)
    return (few, _MEMORY_SAMPLES_RATIO * few) if law.remembers else (few,)


def _linear_motion(
    law: ForceLaw, values: Array, mass: float, omega: Array, drive: ComplexArray
) -> ComplexArray:
    """(n, H+1) motion of the mass with the slope of the law at rest [m]."""
    motion, inertia = np.zeros_like(drive), mass * omega**2
    tiny = _MOTION_AT_REST * np.maximum(np.abs(drive[:, 1]), np.finfo(float).tiny) / inertia
    none = np.zeros((len(omega), 2), dtype=complex)
    rest = hold_amplitude(law, values, mass, omega, tiny, none, (), _MIN_SAMPLES)
    motion[:, 1] = drive[:, 1] / (rest.force_slope / tiny + 2j * ASSUMED_DAMPING_RATIO * inertia)
    return motion


def balance_states(
    oscillator: Oscillator, motion: Motion, force: ComplexArray, valid: NDArray[np.bool_]
) -> SteadyStates:
    """Return n motions under forces (n,) [N] as steady states; only the ``valid`` ones are settled."""
    law = compile_law(oscillator.force)
    samples = _samples(law, len(motion.orders) - 1)[-1]
    with np.errstate(all="ignore"):
        x, v, a = motion.waveforms(samples)
        inner = law.along(motion, law.ordered(oscillator.values), samples).force
        left = oscillator.mass * a + inner - sine_motion(motion.omega, force).waveforms(samples)[0]
        unbalanced = np.linalg.norm(left, axis=1) / np.sqrt(samples) / np.abs(force)
    return SteadyStates(
        harmonics=np.where(valid[:, None], motion.harmonics, complex(np.nan, np.nan)),
        peak=np.where(valid[:, None], np.column_stack([x.max(axis=1), x.min(axis=1)]), np.nan),
        state=np.column_stack([x[:, 0], v[:, 0]]),
        residual=unbalanced,
        outcome=np.where(valid, 0, 1).astype(np.int8),
        error=np.full(len(valid), np.nan),
    )


def hold_oscillator(
    oscillator: Oscillator, amplitude: Array, frequency: Array, *, harmonics: int
) -> Response:
    """Find the force that holds the fundamental at an amplitude (n,) [m], frequency in Hz."""
    law, omega = compile_law(oscillator.force), 2 * np.pi * frequency
    start = np.zeros((len(amplitude), harmonics + 1), dtype=complex)
    values, follow = law.ordered(oscillator.values), following_harmonics(law, harmonics, even=True)
    with np.errstate(all="ignore"):
        for samples in _samples(law, harmonics):
            found = hold_amplitude(law, values, oscillator.mass, omega, amplitude, start, follow, samples)
            start = found.harmonics
    return found
