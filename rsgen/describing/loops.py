"""Laws whose states have equations, along a cycle: the periodic solution of z, and its projections.

The start that repeats itself after one turn is found by Newton's method on the map of the turn. For an odd
law half a turn with the sign turned does the same, and finds the centred loop where damping is small, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import ExpressionError
from rsgen.describing.stepping import Cycles, System
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import STATE_V, STATE_X
from rsgen.law.memory import MemoryForm, Rate

__all__ = ["Loop", "is_odd", "try_loops"]


CLOSED = 1e-11
"""Difference between two turns, relative to the largest state, at which a loop is closed."""

TURNS = 12
"""Newton steps to the start of a loop; four are enough where it closes at all."""

SHIFT = 1e-6
"""Share of the largest state by which the start is moved for the slopes of the map of a turn."""

REPELLING = 1e-4
"""Growth of a disturbance in a turn above which no motion stays on the loop."""

NEUTRAL = 1e-6
"""Share of a disturbance that a turn must forget for its loop to be found. Less is as good as nothing
(slopes are differences, good to 1e-7), and a state that keeps what it begins with but drifts has no loop."""

CYCLES_AT_ONCE = 4096
TRIALS = 16
"""Random cycles of which one at least must close."""

STEPPED = 2
"""Of these so many are stepped through time, one by one."""

ZERO_ODD = 1e-11
"""Share of the force below which f(x, v, z) + f(-x, -v, -z) is zero."""


@dataclass(frozen=True, slots=True)
class Loop:
    """A force with states along its closed loop; ``odd`` where f and g change their signs with x, v and z."""

    system: System
    odd: bool

    @classmethod
    def of(cls, force: sympy.Expr, rates: tuple[Rate, ...]) -> Loop:
        """Take a force along the cycle and equations of states apart."""
        expressions = (*(rate.rate for rate in rates), force)
        return cls(System.of(force, rates), _odd(expressions, tuple(rate.symbol for rate in rates)))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.system.parameters

    @property
    def states(self) -> str:
        """Names of the states, for a sentence."""
        return ", ".join(rate.symbol.name for rate in self.system.rates)

    def harmonics(self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]) -> list[Array]:
        """Give stiffness [N/m], damping [N s/m] and mean force [N] of cycles; nan where no loop closes."""
        fields = tuple(np.broadcast_to(values[name], X_.shape) for name in self.system.parameters)
        every = Cycles(X_, np.broadcast_to(mean, X_.shape), np.broadcast_to(omega, X_.shape), fields)
        found = np.empty((3, len(X_)))
        for start in range(0, len(X_), CYCLES_AT_ONCE):
            rows = np.arange(start, min(start + CYCLES_AT_ONCE, len(X_)))
            cycles = every.some(rows)
            begin, half = self._start(cycles)
            found[:, rows] = self._projected(begin, cycles, half)
        return [found[0] / (np.pi * X_), found[1] / (np.pi * omega * X_), found[2] / (2 * np.pi)]

    def along(self, phi: Array, X_: float, mean: float, omega: float, values: Mapping[str, float]) -> Array:
        """Give the force [N] at ascending phases (s,) from -pi/2 to 3 pi/2 of one cycle."""
        numbers = tuple(np.array([values[name]], dtype=np.float64) for name in self.system.parameters)
        cycles = Cycles(np.array([X_]), np.array([mean]), np.array([omega]), numbers)
        begin, _ = self._start(cycles)
        state = np.concatenate((begin, np.zeros((3, 1))))
        state = np.repeat(state, len(phi), axis=1)
        every = cycles.repeated(len(phi))
        # one cycle a phase, each of which ends there
        state = self.system.advance(state, -np.pi / 2, np.minimum(phi, np.pi / 2), True, every)
        state = self.system.advance(state, np.pi / 2, np.maximum(phi, np.pi / 2), False, every)
        return self.system.forces(phi, state, every)

    def stepped(self, X_: float, omega: float, values: Mapping[str, float]) -> tuple[float, float, float]:
        """Step one turn of the law as it is written through time, without knowing its switches.

        Returns
        -------
        Stiffness [N/m], damping [N s/m], and by how much of its size the turn misses its start.
        """
        from scipy.integrate import solve_ivp  # imports half of scipy, for laws with states only

        numbers = tuple(values[name] for name in self.parameters)
        fields = tuple(np.array([number]) for number in numbers)
        cycles = Cycles(np.array([X_]), np.zeros(1), np.array([omega]), fields)
        (begin, _), size = self._start(cycles), len(self.system.rates)
        states = tuple(rate.symbol for rate in self.system.rates)
        names = (STATE_X, STATE_V, *states, *(symbol(n) for n in ("X", "X0", "omega", *self.parameters)))
        law = compiled((*(rate.rate for rate in self.system.rates), self.system.force), names)

        def slope(phi: float, state: Array) -> Array:
            sine, cosine = np.sin(phi), np.cos(phi)
            parts = law(X_ * sine, omega * X_ * cosine, *state[:size], X_, 0.0, omega, *numbers)
            return np.array([*(part / omega for part in parts[:-1]), parts[-1] * sine, parts[-1] * cosine])

        start = np.concatenate((begin[:, 0], (0.0, 0.0)))
        ends = (-np.pi / 2, 3 * np.pi / 2)
        scale = float(np.max(np.abs(begin))) or 1.0
        run = solve_ivp(slope, ends, start, "DOP853", max_step=0.2, rtol=1e-9, atol=1e-11 * scale)
        end = run.y[:, -1]
        miss = float(np.max(np.abs(end[:size] - start[:size]))) / scale
        return float(end[size] / (np.pi * X_)), float(end[size + 1] / (np.pi * omega * X_)), miss

    def _start(self, cycles: Cycles) -> tuple[Array, bool]:
        """Find the states at phi = -pi/2 from which a cycle repeats, and whether half of it says all."""
        size = len(self.system.rates)
        in_x = any(rate.rate.has(STATE_X) for rate in self.system.rates) or self.system.force.has(STATE_X)
        half = self.odd and not (in_x and np.any(cycles.mean))
        begin = np.zeros((size, len(cycles.X)))
        end, largest = self._turn(begin, cycles, half)
        begin, closed = end, np.zeros(len(cycles.X), dtype=bool)
        for _ in range(TURNS):
            rows = np.flatnonzero(~closed & np.isfinite(begin).all(axis=0))
            if not len(rows):
                break
            begin[:, rows], closed[rows] = self._newton(
                begin[:, rows], largest[:, rows], cycles.some(rows), half
            )
        begin[:, ~closed] = np.nan
        return begin, half

    def _newton(
        self, begin: Array, largest: Array, cycles: Cycles, half: bool
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Take one Newton step; columns that repeat themselves and attract are closed, repelling ones nan."""
        size, n = begin.shape
        shift = SHIFT * np.maximum(largest, np.abs(begin))
        shift = np.where(shift > 0, shift, SHIFT)
        moved = np.tile(begin, 1 + size)
        for j in range(size):
            moved[j, (1 + j) * n : (2 + j) * n] += shift[j]
        end, _ = self._turn(moved, cycles.repeated(1 + size), half)
        now = end[:, :n]
        slopes = np.stack(
            [(end[:, (1 + j) * n : (2 + j) * n] - now) / shift[j] for j in range(size)], axis=-1
        )
        slopes = slopes.transpose(1, 0, 2)
        defined = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(now).all(axis=0)
        slopes[~defined] = 0.0
        growth = np.abs(np.linalg.eigvals(slopes)).max(axis=1)
        miss = np.where(defined, now - begin, np.nan)
        scale = np.maximum(largest, np.abs(begin))
        closed = (np.abs(miss) <= CLOSED * np.where(scale > 0, scale, 1.0)).all(axis=0)
        matrix = np.eye(size) - slopes
        left, singular, right = np.linalg.svd(matrix)
        kept = np.where(singular > NEUTRAL, 1 / np.maximum(singular, NEUTRAL), 0.0)
        along = np.einsum("nji,jn->ni", left, np.nan_to_num(miss))
        step = np.einsum("nij,ni->jn", right, kept * along)
        begin = np.where(closed, begin, begin + step)
        lost = ~defined | (closed & (growth > 1 + REPELLING))
        begin[:, lost] = np.nan
        return begin, closed & ~lost

    def _turn(self, begin: Array, cycles: Cycles, half: bool) -> tuple[Array, Array]:
        """Give the states after one turn (half of an odd loop, with the sign turned), and their largest."""
        state = np.concatenate((begin, np.zeros((3, begin.shape[1]))))
        size = len(self.system.rates)
        middle = self.system.advance(state, -np.pi / 2, np.pi / 2, True, cycles)
        if half:
            return -middle[:size], np.abs(middle[:size])
        end = self.system.advance(middle, np.pi / 2, 3 * np.pi / 2, False, cycles)
        return end[:size], np.maximum(np.abs(middle[:size]), np.abs(end[:size]))

    def _projected(self, begin: Array, cycles: Cycles, half: bool) -> Array:
        """Give (3, n) integrals of f sin, f cos and f over a cycle."""
        size = len(self.system.rates)
        state = np.concatenate((begin, np.zeros((3, begin.shape[1]))))
        middle = self.system.advance(state, -np.pi / 2, np.pi / 2, True, cycles)
        if half:
            middle[size:] *= np.array([[2.0], [2.0], [0.0]])
            return middle[size:]
        return self.system.advance(middle, np.pi / 2, 3 * np.pi / 2, False, cycles)[size:]


def _odd(expressions: tuple[sympy.Expr, ...], states: tuple[sympy.Symbol, ...]) -> bool:
    """Decide at random values whether expressions change their signs with x, v and the states."""
    moving = (STATE_X, STATE_V, *states)
    others = sorted(set().union(*(e.free_symbols for e in expressions)) - set(moving), key=str)
    rng = np.random.default_rng(11)
    values = rng.normal(size=(len(moving), 64))
    fixed = np.exp(rng.uniform(-1, 1, (len(others), 64)))
    function = compiled(expressions, (*moving, *others))
    there, back = function(*values, *fixed), function(*-values, *fixed)
    for one, other in zip(there, back, strict=True):
        with np.errstate(all="ignore"):
            excess = np.abs(one + other) > ZERO_ODD * (np.abs(one) + np.abs(other))
        if np.any(excess & np.isfinite(one) & np.isfinite(other)):
            return False
    return True


def is_odd(rest: sympy.Expr, memory: MemoryForm) -> bool:
    """Decide whether a force of x, v and memories, and the equations of the states, are odd."""
    return _odd((rest, *(rate.rate for rate in memory.rates)), memory.states)


def try_loops(loop: Loop) -> float | None:
    """Compute loops at random values of everything, and step some of them through time.

    Returns
    -------
    Largest difference in stiffness or damping from loops stepped through time, relative to both and the mean.
    None where to follow them takes more than a few seconds: states that are much faster than the motion, or
    many switches.

    Raises
    ------
    ExpressionError
        Not one of them closes.
    """
    system = loop.system.within_budget()
    rng = np.random.default_rng(8)
    values = {name: np.exp(rng.uniform(-1, 1, TRIALS)) for name in loop.parameters}
    amplitude, omega = np.exp(rng.uniform(-2, 1, TRIALS)), np.exp(rng.uniform(-1, 1, TRIALS))
    found = replace(loop, system=system).harmonics(amplitude, np.zeros(TRIALS), omega, values)
    closed = np.flatnonzero(np.isfinite(found[0]))
    if system.work is not None and system.work.done:
        return None
    if not len(closed):
        raise ExpressionError(
            f"memory: the loop of {loop.states} does not close at X = {amplitude[0]:.3g} m or any of "
            f"{TRIALS} amplitudes tried with positive parameters: under a sine it grows or drifts for ever"
        )
    worst = 0.0
    for row in closed[:STEPPED]:
        numbers = {name: float(value[row]) for name, value in values.items()}
        stiffness, damping, miss = loop.stepped(float(amplitude[row]), float(omega[row]), numbers)
        # a state that stays where it is has a mean force alone
        size = abs(stiffness) + omega[row] * abs(damping) + abs(found[2][row]) / amplitude[row]
        differences = (found[0][row] - stiffness, omega[row] * (found[1][row] - damping))
        # no force at all is none, however it is reached
        worst = max(worst, miss, *(abs(difference) / (size or 1.0) for difference in differences))
    return float(worst)
