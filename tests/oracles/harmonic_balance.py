"""Harmonic balance by alternating between frequency and time: the oracle that shares nothing with the kernel.

The displacement is a sum of harmonics; the law is evaluated on its waveform and projected back; Newton's
method makes the balance of every harmonic vanish. Few harmonics are enough for a smooth law; a jump in v
leaves errors of the order of 1/H^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
import sympy
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.settling import SteadyStates
from rsgen.formula import symbol
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.law.memory import MemoryForm, memory_form

__all__ = [
    "Array", "Basis", "MemoryLoops", "basis_of", "first_order_force", "product", "project",
    "solve_harmonic_balance", "to_coefficients", "to_harmonics", "waveforms",
]  # fmt: skip


# ----------------------------------------------------------------------------
# Harmonics and their waveforms for harmonic balance, which shares no motion with identification.

_SAMPLES_A_HARMONIC = 16
"""Samples of the waveform a harmonic: polynomials to the power 15 are projected without aliasing."""
_FEWEST_SAMPLES = 256
"""Samples of the waveform at least: few harmonics see the corners of a law as well."""


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """Waveforms from coefficients q = (X0, Re X1, -Im X1, Re X2, ...): x = displacement @ q and so on.

    A product g(phase) x has the coefficients M q, where M takes the Fourier coefficients of g at the sums and
    the differences of the orders: ``same`` and ``sum`` are their places, with a sign each. ``turn`` @ q are
    the coefficients of the derivative by the phase.
    """

    displacement: Array
    velocity: Array
    order: Array
    turn: Array
    same: NDArray[np.intp]
    sum: NDArray[np.intp]
    same_sign: Array
    sum_sign: Array

    @property
    def samples(self) -> int:
        """Samples in a period."""
        return len(self.displacement)


@lru_cache(maxsize=8)
def basis_of(harmonics: int) -> Basis:
    """The waveforms of so many harmonics, sampled finely enough for the corners of a law."""
    samples = max(_SAMPLES_A_HARMONIC * (harmonics + 1), _FEWEST_SAMPLES)
    shape, rate = waveforms(samples, harmonics)
    order = np.zeros(2 * harmonics + 1)
    for h in range(1, harmonics + 1):
        order[2 * h - 1 : 2 * h + 1] = h
    turn = np.zeros((len(order), len(order)))
    for h in range(1, harmonics + 1):
        turn[2 * h - 1, 2 * h], turn[2 * h, 2 * h - 1] = h, -h
    is_sine = (np.arange(len(order)) > 0) & (np.arange(len(order)) % 2 == 0)
    whole = order.astype(np.intp)
    difference = whole[None, :] - whole[:, None]
    row, column = is_sine[:, None], is_sine[None, :]
    mixed = row != column
    # cos a cos b, sin a sin b: cosines of a - b and a + b; mixed: sines
    sines = np.where(mixed, 2 * harmonics + 1, 0)
    same_sign = np.where(mixed, np.sign(difference) * np.where(column, 1, -1), 1)
    sum_sign = np.where(row & column, -1, 1)
    half = np.where(whole == 0, 0.5, 1.0)[:, None]
    return Basis(
        shape,
        rate,
        order,
        turn,
        np.abs(difference) + sines,
        whole[None, :] + whole[:, None] + sines,
        0.5 * half * same_sign,
        0.5 * half * sum_sign,
    )


@lru_cache(maxsize=8)
def waveforms(samples: int, harmonics: int) -> tuple[Array, Array]:
    """Displacement and velocity over omega of each coefficient (samples, 2H+1)."""
    phase = 2 * np.pi * np.arange(samples) / samples
    shape = np.ones((samples, 2 * harmonics + 1))
    rate = np.zeros((samples, 2 * harmonics + 1))
    for h in range(1, harmonics + 1):
        shape[:, 2 * h - 1], shape[:, 2 * h] = np.cos(h * phase), np.sin(h * phase)
        rate[:, 2 * h - 1], rate[:, 2 * h] = -h * np.sin(h * phase), h * np.cos(h * phase)
    return shape, rate


def project(basis: Basis, waveform: Array) -> Array:
    """Coefficients (n, 2H+1) of waveforms (n, samples)."""
    spectrum = np.fft.rfft(waveform, axis=1)[:, : int(basis.order[-1]) + 1] * (2 / basis.samples)
    return to_coefficients(spectrum / np.where(np.arange(spectrum.shape[1]) == 0, 2, 1))


def product(basis: Basis, waveform: Array) -> Array:
    """Matrices (n, 2H+1, 2H+1) that multiply by waveforms (n, samples)."""
    spectrum = np.fft.rfft(waveform, axis=1)[:, : 2 * int(basis.order[-1]) + 1] * (2 / basis.samples)
    parts = np.hstack([spectrum.real, -spectrum.imag])
    matrix: Array = parts[:, basis.same] * basis.same_sign + parts[:, basis.sum] * basis.sum_sign
    return matrix


def to_harmonics(q: Array) -> ComplexArray:
    """Harmonics (n, H+1) of coefficients (n, 2H+1)."""
    return np.hstack([q[:, :1].astype(np.complex128), q[:, 1::2] - 1j * q[:, 2::2]])


def to_coefficients(harmonics: ComplexArray) -> Array:
    """Coefficients (n, 2H+1) of harmonics (n, H+1)."""
    q = np.empty((len(harmonics), 2 * harmonics.shape[1] - 1))
    q[:, 0], q[:, 1::2], q[:, 2::2] = harmonics[:, 0].real, harmonics[:, 1:].real, -harmonics[:, 1:].imag
    return q


# ----------------------------------------------------------------------------
# Closed loops of laws with memory for harmonic balance: an oracle with loops of its own.
#
# Nothing is shared with the kernel or with the loops of identification. States are carried along the
# waveform
# by the classical method of Runge and Kutta until they repeat; Masing laws follow a stack of reversals,
# centred
# between the extremes of the waveform.

_TURNS = 60
"""Periods after which a state that still changes is taken as it is: what forgets slower hardly settles."""

_FORGETS = 0.98
"""Share of a change that may be left after a period, for the limit to be foreseen from two of them."""

_CLOSED = 1e-11
"""Change of the states in a period, of their size, below which a loop has closed."""

_DEEPEST = 12
"""Reversals of a waveform within its outer loop, at one time: more than harmonics that matter make."""


@dataclass(frozen=True, slots=True, eq=False)
class MemoryLoops:
    """Force of a law with memory along one period of n motions."""

    form: MemoryForm
    force: Numeric
    rates: Numeric
    virgins: Numeric
    values: tuple[float, ...]

    @classmethod
    def of(cls, oscillator: Oscillator, form: MemoryForm) -> MemoryLoops:
        """Compile what the loops need."""
        x, v = symbol("x"), symbol("v")
        names = tuple(symbol(name) for name in oscillator.parameters)
        inner = tuple(rate.symbol for rate in form.rates)
        return cls(
            form,
            compiled((form.force,), (x, v, *form.states, *names)),
            compiled(tuple(rate.rate for rate in form.rates), (x, v, *inner, *names)),
            compiled(tuple(curve.virgin for curve in form.curves), (x, *names)),
            tuple(oscillator.values[name] for name in oscillator.parameters),
        )

    def __call__(self, x: Array, v: Array, lag: Array, omega: Array) -> tuple[Array, Array]:
        """Force (n, s) [N], and the states with equations at the start of the period (r, n).

        x [m] and v [m/s] (n, 2 s) are two samples for each of the force; lag (n, s) [m] is the displacement a
        quarter of a period later, and omega (n,) [rad/s].
        """
        states = self._states(x, v, omega)
        place, speed = x[:, ::2], v[:, ::2]
        moving = [*states, *self._masing(place)] + ([] if self.form.lag is None else [lag])
        (force,) = self.force(place, speed, *moving, *self.values)
        return force + 0 * place, np.array([state[:, 0] for state in states])

    def _states(self, x: Array, v: Array, omega: Array) -> Array:
        """States (r, n, s) along the motion."""
        samples, count = x.shape[1] // 2, len(self.form.rates)
        waves = np.zeros((count, len(x), samples))
        if not count:
            return waves
        step = 2 * np.pi / omega / samples
        x, v = (np.ascontiguousarray(np.hstack([wave, wave[:, :1]]).T) for wave in (x, v))

        def rate(at: int, z: Array) -> Array:
            return np.array([row + 0 * z[0] for row in self.rates(x[at], v[at], *z, *self.values)])

        z = np.zeros((count, len(omega)))
        last = np.zeros_like(z)
        for turn in range(_TURNS):
            before = z
            for i in range(samples):
                waves[:, :, i] = z
                first = rate(2 * i, z)
                second = rate(2 * i + 1, z + 0.5 * step * first)
                third = rate(2 * i + 1, z + 0.5 * step * second)
                fourth = rate(2 * i + 2, z + step * third)
                z = z + step / 6 * (first + 2 * second + 2 * third + fourth)
            if np.all(np.abs(z - before) <= _CLOSED * np.abs(waves).max(axis=2)):
                break
            change = z - before
            # what is forgotten slowly is forgotten geometrically: two turns show the rest
            share = np.divide(change, last, out=np.ones_like(z), where=np.abs(last) > 0)
            share[np.abs(share) >= _FORGETS] = 0.0
            if turn % 3 == 2:
                z = z + change * share / (1 - share)
            last = change
        return waves

    def _masing(self, x: Array) -> list[Array]:
        """Forces (n, s) of the Masing laws along the motion."""
        if not self.form.curves:
            return []
        rows, samples = x.shape
        everybody = np.arange(rows)
        top = np.argmax(x, axis=1)
        order = (top[:, None] + np.arange(samples)) % samples
        path = np.take_along_axis(x, order, axis=1)

        def virgin(distance: Array) -> Array:
            return np.array([n + 0 * distance for n in self.virgins(distance, *self.values)])

        places = np.zeros((rows, _DEEPEST))
        forces = np.zeros((len(self.form.curves), rows, _DEEPEST))
        places[:, 0] = path[:, 0]
        forces[:, :, 0] = virgin(0.5 * np.ptp(path, axis=1))
        depth, way = np.zeros(rows, dtype=np.intp), -np.ones(rows)
        now, here = forces[:, :, 0].copy(), path[:, 0].copy()
        found = np.empty((len(self.form.curves), rows, samples))
        found[:, :, 0] = now
        for i in range(1, samples):
            there = path[:, i]
            turns = np.flatnonzero((there - here) * way < 0)
            way[turns] *= -1
            depth[turns] = np.minimum(depth[turns] + 1, _DEEPEST - 1)
            places[turns, depth[turns]], forces[:, turns, depth[turns]] = here[turns], now[:, turns]
            while True:
                # beyond the reversal before, a loop within the loop has closed
                closes = np.flatnonzero(depth >= 2)
                closes = closes[(there[closes] - places[closes, depth[closes] - 1]) * way[closes] > 0]
                if not len(closes):
                    break
                depth[closes] -= 2
            last = places[everybody, depth]
            now = forces[:, everybody, depth] + 2 * way * virgin(0.5 * np.abs(there - last))
            found[:, :, i], here = now, there
        back = np.empty_like(found)
        np.put_along_axis(back, np.broadcast_to(order, found.shape), found, axis=2)
        return list(back)


_ITERATIONS = 40
"""Newton steps at most; ten are usual, a step that jumps over a corner needs more."""
_CONVERGED = 1e-12
"""Last Newton correction, of the amplitude: rounding."""
_CHUNK = 512
"""Points solved at once: bounds the memory of the Jacobians."""
_HALVINGS = 6
"""Halvings of a Newton step that does not bring the balance down."""
_FAINT = 1e-9
"""Of |F|/(m omega^2): an amplitude below it is none."""
_TINY = 1e-9
"""Of |F|/(m omega^2): the amplitude at which the slopes at rest are taken."""
_NEIGHBOUR = 1e-7
"""Of the motion: distance of neighbouring loops, where truncation and rounding are both small."""
_DAMPED = 0.02
"""Damping of the first guess, of the inertia: without damping it is infinite at resonance."""


class _Law(Protocol):
    """A law along motions that are given by their coefficients q (n, 2H+1)."""

    @property
    def mass(self) -> float:
        """m [kg]."""
        ...

    def force(self, basis: Basis, q: Array, omega: Array) -> Array:
        """Waveforms (n, samples) of the force [N]."""
        ...

    def linearised(self, basis: Basis, q: Array, omega: Array) -> tuple[Array, Array]:
        """Coefficients (n, 2H+1) of the force [N], and how they change with q (n, 2H+1, 2H+1) [N/m]."""
        ...

    def states(self, basis: Basis, q: Array, omega: Array) -> Array:
        """States with equations at the start of the period (r, n)."""
        ...


def _law_of(oscillator: Oscillator) -> _Law:
    form = memory_form(oscillator.force)
    if form is not None:
        return _Remembering(oscillator.mass, MemoryLoops.of(oscillator, form))
    return _Plain.of(oscillator)


@dataclass(frozen=True, slots=True, eq=False)
class _Plain:
    """n(x, v) and its two slopes as numpy functions, mass included."""

    mass: float
    functions: Numeric
    values: tuple[float, ...]

    @classmethod
    def of(cls, oscillator: Oscillator) -> _Plain:
        x, v = symbol("x"), symbol("v")
        law = oscillator.force
        slopes = (law, _slope(law, x), _slope(law, v))
        names = oscillator.parameters
        functions = compiled(slopes, (x, v, *(symbol(name) for name in names)))
        return cls(oscillator.mass, functions, tuple(oscillator.values[name] for name in names))

    def _along(self, basis: Basis, q: Array, omega: Array) -> tuple[Array, ...]:
        x = q @ basis.displacement.T
        v = omega[:, None] * (q @ basis.velocity.T)
        return tuple(wave + 0 * x for wave in self.functions(x, v, *self.values))

    def force(self, basis: Basis, q: Array, omega: Array) -> Array:
        return self._along(basis, q, omega)[0]

    def linearised(self, basis: Basis, q: Array, omega: Array) -> tuple[Array, Array]:
        force, by_x, by_v = self._along(basis, q, omega)
        slope = product(basis, by_x) + product(basis, omega[:, None] * by_v) @ basis.turn
        return project(basis, force), slope

    def states(self, basis: Basis, q: Array, omega: Array) -> Array:
        return np.zeros((0, len(q)))


@dataclass(frozen=True, slots=True, eq=False)
class _Remembering:
    """A law with memory: closed loops along the motion, and neighbouring loops for how they change."""

    mass: float
    loops: MemoryLoops

    def loop(self, basis: Basis, q: Array, omega: Array) -> tuple[Array, Array]:
        """Waveforms of the force, and the states at the start of the period."""
        order = np.maximum(basis.order, 1)
        between = waveforms(2 * basis.samples, int(basis.order[-1]))
        x, v = (q @ wave.T for wave in between)
        return self.loops(x, omega[:, None] * v, q @ (basis.velocity / order).T, omega)

    def force(self, basis: Basis, q: Array, omega: Array) -> Array:
        return self.loop(basis, q, omega)[0]

    def states(self, basis: Basis, q: Array, omega: Array) -> Array:
        return self.loop(basis, q, omega)[1]

    def linearised(self, basis: Basis, q: Array, omega: Array) -> tuple[Array, Array]:
        n, size = q.shape
        offset = _NEIGHBOUR * np.linalg.norm(q, axis=1) + np.finfo(float).tiny
        trials = np.concatenate([q, *(q + offset[:, None] * unit for unit in np.eye(size))])
        found = project(basis, self.force(basis, trials, np.tile(omega, 1 + size)))
        force, others = found[:n], found[n:].reshape(size, n, size)
        return force, np.moveaxis((others - force) / offset[:, None], 0, 2)


def _slope(law: sympy.Expr, variable: sympy.Symbol) -> sympy.Expr:
    """The derivative between jumps: the impulse at a jump is left out, Newton's method does without."""
    slope = sympy.diff(law, variable)
    return slope.replace(sympy.DiracDelta, lambda *_: sympy.S.Zero)


def _balance(law: _Law, basis: Basis, q: Array, load: Array, omega: Array) -> tuple[Array, Array]:
    """Residual (n, 2H+1) [N] and Jacobian (n, 2H+1, 2H+1) [N/m] of the balance of every harmonic."""
    inertia = law.mass * (omega[:, None] * basis.order) ** 2
    force, jacobian = law.linearised(basis, q, omega)
    residual = force - inertia * q - load
    jacobian[:, np.arange(len(basis.order)), np.arange(len(basis.order))] -= inertia
    return residual, jacobian


def _residual(law: _Law, basis: Basis, q: Array, load: Array, omega: Array) -> Array:
    inertia = law.mass * (omega[:, None] * basis.order) ** 2
    return project(basis, law.force(basis, q, omega)) - inertia * q - load


def _solve(matrix: Array, right: Array) -> Array:
    """Solve a batch; a singular member gets the shortest of its best steps instead of ending all others."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        step = np.asarray(np.linalg.pinv(np.nan_to_num(matrix)) @ np.nan_to_num(right))
        step[~np.isfinite(matrix).all(axis=(1, 2))] = np.nan
        return step


def _newton(law: _Law, basis: Basis, q: Array, load: Array, omega: Array) -> tuple[Array, NDArray[np.bool_]]:
    q = q.copy()
    done = np.zeros(len(q), dtype=bool)
    active = np.arange(len(q))
    smallest = _FAINT * np.linalg.norm(load, axis=1) / (law.mass * omega**2)
    for _ in range(_ITERATIONS):
        residual, jacobian = _balance(law, basis, q[active], load[active], omega[active])
        here = np.linalg.norm(residual, axis=1)
        step = -_solve(jacobian, residual[:, :, None])[:, :, 0]
        size = np.linalg.norm(q[active], axis=1) + smallest[active]
        done[active] = np.linalg.norm(step, axis=1) <= _CONVERGED * size
        factor = np.ones(len(active))
        for _ in range(_HALVINGS):
            trial = _residual(law, basis, q[active] + factor[:, None] * step, load[active], omega[active])
            worse = ~(np.linalg.norm(trial, axis=1) <= here * (1 + 1e-9)) & ~done[active]
            if not worse.any():
                break
            factor[worse] /= 2
        q[active] += factor[:, None] * step
        active = active[~done[active]]
        if not len(active):
            break
    return q, done


def solve_harmonic_balance(
    oscillator: Oscillator,
    force: ArrayLike,
    frequency: ArrayLike,
    *,
    harmonics: int,
    guess: ComplexArray | None = None,
) -> SteadyStates:
    """Find steady states by harmonic balance; stable or not, near the guess.

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
    F = np.atleast_1d(np.asarray(force, dtype=np.complex128))
    omega = 2 * np.pi * np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    law, basis = _law_of(oscillator), basis_of(harmonics)
    load = np.zeros((len(F), 2 * harmonics + 1))
    load[:, 1], load[:, 2] = F.real, -F.imag
    q = _linear_guess(law, F, omega, harmonics) if guess is None else to_coefficients(guess)
    parts = [slice(low, low + _CHUNK) for low in range(0, len(F), _CHUNK)]
    solved = [_newton(law, basis, q[part], load[part], omega[part]) for part in parts]
    q = np.concatenate([entry[0] for entry in solved])
    done = np.concatenate([entry[1] for entry in solved])
    return _states(law, basis, q, F, omega, done)


def _linear_guess(law: _Law, F: ComplexArray, omega: Array, harmonics: int) -> Array:
    basis = basis_of(1)
    tiny = np.zeros((len(F), 3))
    tiny[:, 1] = _TINY * np.maximum(np.abs(F), np.finfo(float).tiny) / (law.mass * omega**2)
    _, slope = law.linearised(basis, tiny, omega)
    inertia = law.mass * omega**2
    impedance = slope[:, 1, 1] - inertia + 1j * (_DAMPED * inertia - slope[:, 2, 1])
    guess = np.zeros((len(F), harmonics + 1), dtype=np.complex128)
    guess[:, 1] = F / impedance
    return to_coefficients(guess)


def _states(
    law: _Law, basis: Basis, q: Array, F: ComplexArray, omega: Array, done: NDArray[np.bool_]
) -> SteadyStates:
    x = q @ basis.displacement.T
    v = omega[:, None] * (q @ basis.velocity.T)
    n = law.force(basis, q, omega)
    acceleration = -(omega[:, None] ** 2) * ((q * basis.order**2) @ basis.displacement.T)
    phase = 2 * np.pi * np.arange(basis.samples) / basis.samples
    applied = F.real[:, None] * np.cos(phase) - F.imag[:, None] * np.sin(phase)
    rest = law.mass * acceleration + n - applied
    left = np.linalg.norm(rest, axis=1) / np.sqrt(basis.samples) / np.abs(F)
    harmonics = to_harmonics(q)
    harmonics[~done] = complex(np.nan, np.nan)
    peak = np.where(done[:, None], np.column_stack([x.max(axis=1), x.min(axis=1)]), np.nan)
    return SteadyStates(
        harmonics=harmonics,
        peak=peak,
        state=np.column_stack([x[:, 0], v[:, 0]]),
        residual=left,
        outcome=np.where(done, 0, 1).astype(np.int8),
        error=np.full(len(F), np.nan),
    )


def first_order_force(
    oscillator: Oscillator, amplitude: Array, omega: Array
) -> tuple[ComplexArray, Array, Array]:
    """Force (n,) [N] and mean (n,) [m] of x = X0 + X cos(omega t), from the balance of one harmonic.

    Then the states of the law at t = 0, (r, n), r = 0 without memory.
    """
    law, basis = _law_of(oscillator), basis_of(1)
    mean = np.zeros_like(amplitude)
    for _ in range(_ITERATIONS):
        q = np.column_stack([mean, amplitude, np.zeros_like(amplitude)])
        fundamental, slope = law.linearised(basis, q, omega)
        stiffness = slope[:, 0, 0]
        move = -fundamental[:, 0] / np.where(np.abs(stiffness) > 0, stiffness, 1.0)
        move = np.clip(move, -amplitude, amplitude)
        mean = mean + move
        if np.all(np.abs(move) <= _FAINT * amplitude):
            break
    F = to_harmonics(fundamental)[:, 1] - law.mass * omega**2 * amplitude
    return F, mean, law.states(basis, q, omega)
