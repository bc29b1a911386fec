"""Harmonic balance by alternating between frequency and time: the oracle that shares nothing with the kernel.

The displacement is a sum of harmonics; the law is evaluated on its waveform and projected back; Newton's
method makes the balance of every harmonic vanish. Few harmonics are enough for a smooth law; a jump in v
leaves errors of the order of 1/H^2.
"""

from __future__ import annotations

import numpy as np
import sympy
from numpy.typing import ArrayLike, NDArray

from rsgen.arrays import Array, ComplexArray
from rsgen.expression import symbol
from rsgen.expression.evaluation import compiled
from rsgen.motion import FourierSeries, fourier_series
from rsgen.oscillator import Oscillator
from rsgen.simulation.point_grid import Progress, in_parts, swept
from rsgen.simulation.virtual_test import SimulatedTest
from rsgen.steady_state import SteadyStates

__all__ = ["balance_grid", "first_order_force", "solve_harmonic_balance"]


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


def _series(harmonics: int) -> FourierSeries:
    samples = max(_SAMPLES_A_HARMONIC * (harmonics + 1), _FEWEST_SAMPLES)
    return fourier_series(tuple(range(harmonics + 1)), samples, half=False)


class _Law:
    """n(x, v) and its two slopes as numpy functions, and the mass."""

    def __init__(self, oscillator: Oscillator) -> None:
        x, v, law, names = symbol("x"), symbol("v"), oscillator.force, oscillator.parameters
        # the impulse at a jump is left out of the slopes: Newton's method does without
        slopes = (sympy.diff(law, by).replace(sympy.DiracDelta, lambda *_: sympy.S.Zero) for by in (x, v))
        self.mass = oscillator.mass
        self._functions = compiled((law, *slopes), (x, v, *(symbol(name) for name in names)))
        self._values = tuple(oscillator.values[name] for name in names)

    def __call__(self, x: Array, v: Array) -> tuple[Array, Array, Array]:
        n, by_x, by_v = self._functions(x, v, *self._values)
        return n + 0 * x, by_x + 0 * x, by_v + 0 * x


def _balance(law: _Law, series: FourierSeries, q: Array, load: Array, omega: Array) -> tuple[Array, Array]:
    """Residual (n, 2H+1) [N] and Jacobian (n, 2H+1, 2H+1) [N/m] of the balance of every harmonic."""
    force, by_x, by_v = law(q @ series.shape, omega[:, None] * (q @ series.rate))
    inertia = law.mass * (omega[:, None] * series.order_of) ** 2
    jacobian = series.tangent(by_x, omega[:, None] * by_v)
    diagonal = np.arange(len(series.order_of))
    jacobian[:, diagonal, diagonal] -= inertia
    return force @ series.project - inertia * q - load, jacobian


def _newton(
    law: _Law, series: FourierSeries, q: Array, load: Array, omega: Array
) -> tuple[Array, NDArray[np.bool_]]:
    q = q.copy()
    done = np.zeros(len(q), dtype=bool)
    active = np.arange(len(q))
    smallest = _FAINT * np.linalg.norm(load, axis=1) / (law.mass * omega**2)
    for _ in range(_ITERATIONS):
        residual, jacobian = _balance(law, series, q[active], load[active], omega[active])
        here = np.linalg.norm(residual, axis=1)
        try:
            step = -np.linalg.solve(jacobian, residual[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:
            break
        size = np.linalg.norm(q[active], axis=1) + smallest[active]
        done[active] = np.linalg.norm(step, axis=1) <= _CONVERGED * size
        factor = np.ones(len(active))
        for _ in range(_HALVINGS):
            trial, _ = _balance(law, series, q[active] + factor[:, None] * step, load[active], omega[active])
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
    harmonics: int = 7,
    guess: ComplexArray | None = None,
) -> SteadyStates:
    """Find steady states under forces (n,) [N] by harmonic balance; stable or not, near the guess.

    Without a ``guess`` (n, H+1) [m], it is the response of the mass alone with the slope of the law at rest,
    damped enough to be finite. The ``residual`` is the force that the mean and ``harmonics`` leave unbalanced
    (root mean square over |F|); more of them make it smaller. The ``error`` is not known.
    """
    F = np.atleast_1d(np.asarray(force, dtype=np.complex128))
    omega = 2 * np.pi * np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    law, series = _Law(oscillator), _series(harmonics)
    load = np.zeros((len(F), 2 * harmonics + 1))
    load[:, 1], load[:, 2] = F.real, F.imag
    q = _linear_guess(law, load, omega) if guess is None else series.real(guess)
    parts = [slice(low, low + _CHUNK) for low in range(0, len(F), _CHUNK)]
    solved = [_newton(law, series, q[part], load[part], omega[part]) for part in parts]
    q, done = (np.concatenate(found) for found in zip(*solved, strict=True))
    return _states(law, series, q, load, omega, done)


def _linear_guess(law: _Law, load: Array, omega: Array) -> Array:
    tiny = np.array([1e-12])
    _, stiffness, damping = law(tiny, tiny)
    impedance = stiffness - law.mass * omega**2 + 1j * omega * damping
    impedance += 1j * _DAMPED * law.mass * omega**2
    response = (load[:, 1] + 1j * load[:, 2]) / impedance
    guess = np.zeros_like(load)
    guess[:, 1], guess[:, 2] = response.real, response.imag
    return guess


def _states(
    law: _Law, series: FourierSeries, q: Array, load: Array, omega: Array, done: NDArray[np.bool_]
) -> SteadyStates:
    x, v = q @ series.shape, omega[:, None] * (q @ series.rate)
    rest = law.mass * omega[:, None] ** 2 * (q @ series.bend) + law(x, v)[0] - load @ series.shape
    harmonics = series.complex(q)
    harmonics[~done] = complex(np.nan, np.nan)
    return SteadyStates(
        harmonics=harmonics,
        peak=np.where(done[:, None], np.column_stack([x.max(axis=1), x.min(axis=1)]), np.nan),
        state=np.column_stack([x[:, 0], v[:, 0]]),
        residual=np.sqrt(np.mean(rest**2, axis=1)) / np.linalg.norm(load, axis=1),
        outcome=np.where(done, 0, 1).astype(np.int8),
        error=np.full(len(q), np.nan),
    )


def balance_grid(oscillator: Oscillator, test: SimulatedTest, progress: Progress) -> SteadyStates:
    """Solve the grid of a test by harmonic balance, ordered level by level.

    With sweep "rest" every point starts from its linear response; with "up" or "down" from its neighbour.
    Harmonic balance does not separate stable answers from unstable ones.
    """

    def solve(force: Array, frequency: Array, guess: ComplexArray | None = None) -> SteadyStates:
        return solve_harmonic_balance(oscillator, force, frequency, harmonics=test.harmonics, guess=guess)

    def go_on(frequency: Array, last: SteadyStates | None) -> SteadyStates:
        if last is None:
            return solve(test.level, frequency)
        near = solve(test.level, frequency, np.where(np.isfinite(last.harmonics), last.harmonics, 0))
        if near.settled.all():
            return near
        # where the branch has ended, from the linear response
        fresh, n = solve(test.level, frequency), len(near)
        return SteadyStates.joined([near, fresh], np.arange(n) + n * ~near.settled)

    return in_parts(solve, test, progress) if test.sweep == "rest" else swept(go_on, test, progress)


def first_order_force(oscillator: Oscillator, amplitude: Array, omega: Array) -> tuple[ComplexArray, Array]:
    """Force (n,) [N] and mean (n,) [m] of x = X0 + X cos(omega t), from the balance of one harmonic."""
    law, series = _Law(oscillator), _series(1)
    mean = np.zeros_like(amplitude)
    for _ in range(_ITERATIONS):
        q = np.column_stack([mean, amplitude, np.zeros_like(amplitude)])
        force, by_x, _ = law(q @ series.shape, omega[:, None] * (q @ series.rate))
        stiffness = by_x.mean(axis=1)
        move = -force.mean(axis=1) / np.where(np.abs(stiffness) > 0, stiffness, 1.0)
        move = np.clip(move, -amplitude, amplitude)
        mean = mean + move
        if np.all(np.abs(move) <= _FAINT * amplitude):
            break
    fundamental: ComplexArray = series.complex(force @ series.project)[:, 1]
    return fundamental - law.mass * omega**2 * amplitude, mean
