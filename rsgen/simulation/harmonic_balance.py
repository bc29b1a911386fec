"""Harmonic balance by alternating between frequency and time: the oracle that shares nothing with the kernel.

The displacement is a sum of harmonics; the law is evaluated on its waveform and projected back; Newton's
method makes the balance of every harmonic vanish. Few harmonics are enough for a smooth law; a jump in v
leaves errors of the order of 1/H^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import sympy
from numpy.typing import ArrayLike, NDArray

from rsgen.expression import symbol
from rsgen.expression.evaluation import Numeric, compiled
from rsgen.oscillator import Oscillator
from rsgen.simulation.point_grid import Progress, in_parts, swept
from rsgen.simulation.virtual_test import SimulatedTest
from rsgen.steady_state import SteadyStates

__all__ = ["balance_grid", "first_order_force", "solve_harmonic_balance"]

Floats = NDArray[np.float64]

_ITERATIONS = 40
"""Newton steps at most; ten are usual, a step that jumps over a corner needs more."""
_CONVERGED = 1e-12
"""Last Newton correction, of the amplitude: rounding."""
_SAMPLES_A_HARMONIC = 16
"""Samples of the waveform a harmonic: polynomials to the power 15 are projected without aliasing."""
_FEWEST_SAMPLES = 256
"""Samples of the waveform at least: few harmonics see the corners of a law as well."""
_CHUNK = 512
"""Points solved at once: bounds the memory of the Jacobians."""
_HALVINGS = 6
"""Halvings of a Newton step that does not bring the balance down."""
_FAINT = 1e-9
"""Of |F|/(m omega^2): an amplitude below it is none."""
_DAMPED = 0.02
"""Damping of the first guess, of the inertia: without damping it is infinite at resonance."""


@dataclass(frozen=True, slots=True, eq=False)
class _Basis:
    """Waveforms from coefficients q = (X0, Re X1, -Im X1, Re X2, ...): x = displacement @ q and so on.

    A product g(phase) x has the coefficients M q, where M takes the Fourier coefficients of g at the sums and
    the differences of the orders: ``same`` and ``sum`` are their places, with a sign each. ``turn`` @ q are
    the coefficients of the derivative by the phase.
    """

    displacement: Floats
    velocity: Floats
    order: Floats
    turn: Floats
    same: NDArray[np.intp]
    sum: NDArray[np.intp]
    same_sign: Floats
    sum_sign: Floats

    @property
    def samples(self) -> int:
        return len(self.displacement)


@lru_cache(maxsize=8)
def _basis(harmonics: int) -> _Basis:
    samples = max(_SAMPLES_A_HARMONIC * (harmonics + 1), _FEWEST_SAMPLES)
    phase = 2 * np.pi * np.arange(samples) / samples
    shape = np.ones((samples, 2 * harmonics + 1))
    rate = np.zeros((samples, 2 * harmonics + 1))
    order = np.zeros(2 * harmonics + 1)
    for h in range(1, harmonics + 1):
        shape[:, 2 * h - 1], shape[:, 2 * h] = np.cos(h * phase), np.sin(h * phase)
        rate[:, 2 * h - 1], rate[:, 2 * h] = -h * np.sin(h * phase), h * np.cos(h * phase)
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
    return _Basis(
        shape,
        rate,
        order,
        turn,
        np.abs(difference) + sines,
        whole[None, :] + whole[:, None] + sines,
        0.5 * half * same_sign,
        0.5 * half * sum_sign,
    )


def _project(basis: _Basis, waveform: Floats) -> Floats:
    """Coefficients (n, 2H+1) of waveforms (n, samples)."""
    spectrum = np.fft.rfft(waveform, axis=1)[:, : int(basis.order[-1]) + 1] * (2 / basis.samples)
    return _to_coefficients(spectrum / np.where(np.arange(spectrum.shape[1]) == 0, 2, 1))


def _product(basis: _Basis, waveform: Floats) -> Floats:
    """Matrices (n, 2H+1, 2H+1) that multiply by waveforms (n, samples)."""
    spectrum = np.fft.rfft(waveform, axis=1)[:, : 2 * int(basis.order[-1]) + 1] * (2 / basis.samples)
    parts = np.hstack([spectrum.real, -spectrum.imag])
    matrix: Floats = parts[:, basis.same] * basis.same_sign + parts[:, basis.sum] * basis.sum_sign
    return matrix


@dataclass(frozen=True, slots=True, eq=False)
class _Law:
    """n(x, v) and its two slopes as numpy functions, mass included."""

    mass: float
    functions: Numeric
    values: tuple[float, ...]

    @classmethod
    def of(cls, oscillator: Oscillator) -> _Law:
        x, v = symbol("x"), symbol("v")
        law = oscillator.force
        slopes = (law, _slope(law, x), _slope(law, v))
        names = oscillator.parameters
        functions = compiled(slopes, (x, v, *(symbol(name) for name in names)))
        return cls(oscillator.mass, functions, tuple(oscillator.values[name] for name in names))

    def __call__(self, x: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
        n, by_x, by_v = self.functions(x, v, *self.values)
        return n + 0 * x, by_x + 0 * x, by_v + 0 * x


def _slope(law: sympy.Expr, variable: sympy.Symbol) -> sympy.Expr:
    """The derivative between jumps: the impulse at a jump is left out, Newton's method does without."""
    slope = sympy.diff(law, variable)
    return slope.replace(sympy.DiracDelta, lambda *_: sympy.S.Zero)


def _balance(law: _Law, basis: _Basis, q: Floats, load: Floats, omega: Floats) -> tuple[Floats, Floats]:
    """Residual (n, 2H+1) [N] and Jacobian (n, 2H+1, 2H+1) [N/m] of the balance of every harmonic."""
    x = q @ basis.displacement.T
    v = omega[:, None] * (q @ basis.velocity.T)
    force, by_x, by_v = law(x, v)
    inertia = law.mass * (omega[:, None] * basis.order) ** 2
    residual = _project(basis, force) - inertia * q - load
    jacobian = _product(basis, by_x) + _product(basis, omega[:, None] * by_v) @ basis.turn
    jacobian[:, np.arange(len(basis.order)), np.arange(len(basis.order))] -= inertia
    return residual, jacobian


def _solve(matrix: Floats, right: Floats) -> Floats:
    """Solve a batch; a singular member gets the shortest of its best steps instead of ending all others."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        step = np.asarray(np.linalg.pinv(np.nan_to_num(matrix)) @ np.nan_to_num(right))
        step[~np.isfinite(matrix).all(axis=(1, 2))] = np.nan
        return step


def _newton(
    law: _Law, basis: _Basis, q: Floats, load: Floats, omega: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
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
            trial, _ = _balance(law, basis, q[active] + factor[:, None] * step, load[active], omega[active])
            worse = ~(np.linalg.norm(trial, axis=1) <= here * (1 + 1e-9)) & ~done[active]
            if not worse.any():
                break
            factor[worse] /= 2
        q[active] += factor[:, None] * step
        active = active[~done[active]]
        if not len(active):
            break
    return q, done


def _to_harmonics(q: Floats) -> NDArray[np.complex128]:
    return np.hstack([q[:, :1].astype(np.complex128), q[:, 1::2] - 1j * q[:, 2::2]])


def _to_coefficients(harmonics: NDArray[np.complex128]) -> Floats:
    q = np.empty((len(harmonics), 2 * harmonics.shape[1] - 1))
    q[:, 0], q[:, 1::2], q[:, 2::2] = harmonics[:, 0].real, harmonics[:, 1:].real, -harmonics[:, 1:].imag
    return q


def solve_harmonic_balance(
    oscillator: Oscillator,
    force: ArrayLike,
    frequency: ArrayLike,
    *,
    harmonics: int = 7,
    guess: NDArray[np.complex128] | None = None,
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
    law, basis = _Law.of(oscillator), _basis(harmonics)
    load = np.zeros((len(F), 2 * harmonics + 1))
    load[:, 1], load[:, 2] = F.real, -F.imag
    q = _linear_guess(law, F, omega, harmonics) if guess is None else _to_coefficients(guess)
    parts = [slice(low, low + _CHUNK) for low in range(0, len(F), _CHUNK)]
    solved = [_newton(law, basis, q[part], load[part], omega[part]) for part in parts]
    q = np.concatenate([entry[0] for entry in solved])
    done = np.concatenate([entry[1] for entry in solved])
    return _states(law, basis, q, F, omega, done)


def _linear_guess(law: _Law, F: NDArray[np.complex128], omega: Floats, harmonics: int) -> Floats:
    tiny = np.array([1e-12])
    _, stiffness, damping = law(tiny, tiny)
    impedance = stiffness - law.mass * omega**2 + 1j * omega * damping
    impedance += 1j * _DAMPED * law.mass * omega**2
    guess = np.zeros((len(F), harmonics + 1), dtype=np.complex128)
    guess[:, 1] = F / impedance
    return _to_coefficients(guess)


def _states(
    law: _Law, basis: _Basis, q: Floats, F: NDArray[np.complex128], omega: Floats, done: NDArray[np.bool_]
) -> SteadyStates:
    x = q @ basis.displacement.T
    v = omega[:, None] * (q @ basis.velocity.T)
    n, _, _ = law(x, v)
    acceleration = -(omega[:, None] ** 2) * ((q * basis.order**2) @ basis.displacement.T)
    phase = 2 * np.pi * np.arange(basis.samples) / basis.samples
    applied = F.real[:, None] * np.cos(phase) - F.imag[:, None] * np.sin(phase)
    rest = law.mass * acceleration + n - applied
    left = np.linalg.norm(rest, axis=1) / np.sqrt(basis.samples) / np.abs(F)
    harmonics = _to_harmonics(q)
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


def balance_grid(oscillator: Oscillator, test: SimulatedTest, progress: Progress) -> SteadyStates:
    """Solve the grid of a test by harmonic balance, ordered level by level.

    With sweep "rest" every point starts from its linear response; with "up" or "down" from its neighbour.
    Harmonic balance does not separate stable answers from unstable ones.
    """

    def solve(force: Floats, frequency: Floats, guess: NDArray[np.complex128] | None = None) -> SteadyStates:
        return solve_harmonic_balance(oscillator, force, frequency, harmonics=test.harmonics, guess=guess)

    def go_on(frequency: Floats, last: SteadyStates | None) -> SteadyStates:
        if last is None:
            return solve(test.level, frequency)
        near = solve(test.level, frequency, np.where(np.isfinite(last.harmonics), last.harmonics, 0))
        if near.settled.all():
            return near
        # where the branch has ended, from the linear response
        fresh, n = solve(test.level, frequency), len(near)
        return SteadyStates.joined([near, fresh], np.arange(n) + n * ~near.settled)

    return in_parts(solve, test, progress) if test.sweep == "rest" else swept(go_on, test, progress)


def first_order_force(
    oscillator: Oscillator, amplitude: Floats, omega: Floats
) -> tuple[NDArray[np.complex128], Floats]:
    """Force (n,) [N] and mean (n,) [m] of x = X0 + X cos(omega t), from the balance of one harmonic."""
    law, basis = _Law.of(oscillator), _basis(1)
    mean = np.zeros_like(amplitude)
    for _ in range(_ITERATIONS):
        q = np.column_stack([mean, amplitude, np.zeros_like(amplitude)])
        force, by_x, _ = law(q @ basis.displacement.T, omega[:, None] * (q @ basis.velocity.T))
        stiffness = by_x.mean(axis=1)
        move = -force.mean(axis=1) / np.where(np.abs(stiffness) > 0, stiffness, 1.0)
        move = np.clip(move, -amplitude, amplitude)
        mean = mean + move
        if np.all(np.abs(move) <= _FAINT * amplitude):
            break
    fundamental = _project(basis, force)
    F = _to_harmonics(fundamental)[:, 1] - law.mass * omega**2 * amplitude
    return F, mean
