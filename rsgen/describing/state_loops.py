"""Laws whose states have equations, along a cycle: the periodic solution of z, and its projections.

The start that repeats itself after one turn is found by Newton's method on the map of the turn. For an odd
law half a turn with the sign turned does the same, and finds the centred loop where damping is small, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import ExpressionError
from rsgen.formula import symbol
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.formula.names import OMEGA, STATE_V, STATE_X, X0, X
from rsgen.law.memory import Inner, MemoryForm, Rate
from rsgen.law.pieces import Switch, normal_form

__all__ = ["Cycles", "Loop", "System", "is_odd", "try_loops"]


# ----------------------------------------------------------------------------
# States along a cycle, advanced from one phase to another, all cycles together.
#
# Under x = X0 + X sin(phi) every state follows dz/dphi = g(x, v, z)/omega. Each half of the cycle between
# the
# turning points is integrated by extrapolation of the midpoint rule (Gragg; Bulirsch and Stoer, Numer.
# Math. 8
# (1966) 1) in a fixed mode of the switches; a step that ends beyond a switch is cut at the crossing.

COLUMNS = 6
"""Midpoint rules with 2, 4, ... 12 steps: order 12, where smooth laws take a dozen steps a half cycle."""

TOLERANCE = 1e-12
"""Error of a step, of order 11 and so larger than that of what is kept, relative to the largest state."""

FIRST, LONGEST = 0.05, 0.4
"""Phase of the first step and of the longest one: no switch is passed twice within it unseen."""

SHORTEST = 1e-11
"""Phase of a step below which a state has no finite value."""

MOST_STEPS = 4000
"""Steps of a half cycle: a state may change a thousand times faster than the motion."""

MOST_FLIPS = 8
"""Flips of switches without progress: then the state slides along the switch and has no periodic solution."""

CROSSING = 1e-12
"""Share of its range in a step to which a switch function is zero at a crossing."""

HALVINGS = 60
"""Steps to a crossing; ten are enough where it is simple."""

MOST_WORK = 400_000
"""Steps of one trial times what each costs, in operations of the law: two to three seconds."""

STEP_COST = 150
"""What a step costs beside the operations of the law, in these: 1.1 ms and 7 microseconds were measured."""

Rows = NDArray[np.intp]

_STEPS = tuple(2 * (column + 1) for column in range(COLUMNS))


@dataclass(frozen=True, slots=True)
class Cycles:
    """Cycles of amplitude, mean and frequency, with the values of all parameters; arrays (n,)."""

    X: Array
    mean: Array
    omega: Array
    values: tuple[Array, ...]

    def some(self, rows: Rows) -> Cycles:
        """Give the cycles of these numbers."""
        return Cycles(self.X[rows], self.mean[rows], self.omega[rows], tuple(v[rows] for v in self.values))

    def repeated(self, times: int) -> Cycles:
        """Give all cycles so many times, one set after another."""
        return Cycles(
            np.tile(self.X, times), np.tile(self.mean, times), np.tile(self.omega, times),
            tuple(np.tile(v, times) for v in self.values),
        )  # fmt: skip


@dataclass(slots=True)
class Work:
    """A budget in steps, so that an answer does not depend on the speed of the machine."""

    steps: int

    @property
    def done(self) -> bool:
        """Whether nothing is left."""
        return self.steps < 0


@dataclass(frozen=True, slots=True)
class System:
    """A force f(x, v, z), the equations of its states, and all switches in them.

    Parameters
    ----------
    force
        f [N] in x, v, states, X, X0, omega and parameters.
    rates
        z' = g(x, v, z).
    parameters
        Names of the parameters of both.
    modes
        All g and f in which every switch is a symbol of ``flags`` that is one or zero.
    switches
        Those whose passage depends on more than the sign of v.
    flags
        Symbols of ``switches``, then that of the sign of v.
    work
        Steps that are left; None where no budget limits them. What is not finished then is nan.
    """

    force: sympy.Expr
    rates: tuple[Rate, ...]
    parameters: tuple[str, ...]
    modes: tuple[sympy.Expr, ...]
    switches: tuple[sympy.Expr, ...]
    flags: tuple[sympy.Symbol, ...]
    work: Work | None = None

    def within_budget(self) -> System:
        """Give the same with a budget for one trial."""
        operations = STEP_COST + sum(int(mode.count_ops()) for mode in self.modes)
        return replace(self, work=Work(MOST_WORK // operations))

    @classmethod
    def of(cls, force: sympy.Expr, rates: tuple[Rate, ...]) -> System:
        """Take a force along the cycle and equations of states apart."""
        expressions = (*(rate.rate for rate in rates), force)
        forms = [normal_form(expression) for expression in expressions]
        rising = sympy.Dummy("rising")
        flags: dict[sympy.Expr, sympy.Symbol] = {}

        def flag(switch: Switch) -> sympy.Symbol:
            if switch.variable == "v" and switch.threshold == 0:
                return rising
            return flags.setdefault(switch.function, sympy.Dummy(f"flag_{len(flags)}"))

        modes = tuple(
            sympy.Add(*(piece.term * sympy.Mul(*map(flag, piece.switches)) for piece in form.pieces))
            for form in forms
        )
        free = set().union(*(expression.free_symbols for expression in expressions))
        own = {s.name for s in free if not isinstance(s, Inner)} - {"x", "v", "X", "X0", "omega"}
        return cls(force, rates, tuple(sorted(own)), modes, tuple(flags), (*flags.values(), rising))

    @property
    def _names(self) -> tuple[sympy.Symbol, ...]:
        states = (rate.symbol for rate in self.rates)
        return (STATE_X, STATE_V, *states, X, X0, OMEGA, *map(symbol, self.parameters))

    def _places(self, phi: Array, state: Array, cycles: Cycles) -> tuple[Array, ...]:
        x = cycles.mean + cycles.X * np.sin(phi)
        v = cycles.omega * cycles.X * np.cos(phi)
        states = state[: len(self.rates)]
        return (x, v, *states, cycles.X, cycles.mean, cycles.omega, *cycles.values)

    def forces(self, phi: Array, state: Array, cycles: Cycles) -> Array:
        """Give the force [N] at a phase (n,) of every cycle."""
        (force,) = compiled((self.force,), self._names)(*self._places(phi, state, cycles))
        return np.broadcast_to(force, phi.shape)

    def _slope(self, function: Numeric, phi: Array, state: Array, flags: Array, cycles: Cycles) -> Array:
        """Give the derivatives by phi of the states and of the three integrals."""
        sine, cosine = np.sin(phi), np.cos(phi)
        x, v = cycles.mean + cycles.X * sine, cycles.omega * cycles.X * cosine
        fixed = (cycles.X, cycles.mean, cycles.omega, *cycles.values)
        parts = function(x, v, *state[: len(self.rates)], *fixed, *flags)
        found = np.empty(state.shape)
        for place, part in enumerate(parts[:-1]):
            found[place] = part / cycles.omega
        found[-3], found[-2], found[-1] = parts[-1] * sine, parts[-1] * cosine, parts[-1]
        return found

    def _step(
        self, function: Numeric, phi: Array, step: Array, state: Array, flags: Array, cycles: Cycles
    ) -> tuple[Array, Array]:
        """Extrapolate midpoint rules over a step; the new state and its error."""
        if self.work is not None:
            self.work.steps -= 1
        first = self._slope(function, phi, state, flags, cycles)
        table: list[Array] = []
        with np.errstate(all="ignore"):
            for column, count in enumerate(_STEPS):
                part = step / count
                before, now = state, state + part * first
                for place in range(1, count):
                    slope = self._slope(function, phi + place * part, now, flags, cycles)
                    before, now = now, before + 2 * part * slope
                row = [now]
                for back in range(1, column + 1):
                    ratio = (count / _STEPS[column - back]) ** 2
                    row.append(row[-1] + (row[-1] - table[back - 1]) / (ratio - 1))
                error = np.abs(row[-1] - row[-2]) if column else np.abs(now)
                table = row
            return table[-1], error

    def advance(self, state: Array, start: float, end: float | Array, rising: bool, cycles: Cycles) -> Array:
        """Integrate all cycles from one phase to another between turning points."""
        n, size = state.shape[1], len(self.rates)
        function = compiled(self.modes, (*self._names, *self.flags))
        state, phi, stop = state.copy(), np.full(n, start), np.broadcast_to(end, (n,))
        step = np.minimum(FIRST, stop - start)
        flags = np.full((len(self.flags), n), float(rising))
        sides = self._sides(phi, state, cycles)
        flags[:-1] = sides >= 0
        largest, flips = np.zeros(state.shape), np.zeros(n, dtype=np.intp)
        held = np.zeros(n, dtype=bool)
        beyond, reach = np.zeros(state.shape), np.zeros(n)
        for _ in range(MOST_STEPS):
            if self.work is not None and self.work.done:
                break
            rows = np.flatnonzero((stop - phi > 1e-14) & ~held)
            if not len(rows):
                rows = np.flatnonzero(held)
                if not len(rows):
                    return state
                # all that wait at a switch are cut together
                before = phi[rows]
                self._cut(function, rows, (phi, state, flags), (reach, beyond), cycles)
                held[:] = False
                flips[rows] = np.where(phi[rows] - before < SHORTEST, flips[rows] + 1, 0)
                stuck = rows[flips[rows] > MOST_FLIPS]
                state[:, stuck], phi[stuck] = np.nan, stop[stuck]
                continue
            some, now, mode = cycles.some(rows), state[:, rows], flags[:, rows]
            ahead = np.minimum(step[rows], stop[rows] - phi[rows])
            then, error = self._step(function, phi[rows], ahead, now, mode, some)
            with np.errstate(all="ignore"):
                grown = np.maximum(np.abs(now), np.abs(then))
                # one measure for the three integrals
                grown[size:] = grown[size:].max(axis=0)
                largest[:, rows] = np.fmax(largest[:, rows], grown)
                ratio = (error / np.maximum(largest[:, rows], 1e-300)).max(axis=0) / TOLERANCE
                ratio = np.where(np.isfinite(ratio), ratio, np.inf)
                change = np.clip(0.9 * np.maximum(ratio, 1e-9) ** (-1 / (2 * COLUMNS - 1)), 0.2, 4.0)
            step[rows] = np.minimum(ahead * change, LONGEST)
            gone = rows[(ratio > 1) & (step[rows] < SHORTEST)]
            state[:, gone], phi[gone] = np.nan, stop[gone]
            passed = self._passed(phi[rows] + ahead, then, mode, some).any(axis=0)
            wait, go = np.flatnonzero((ratio <= 1) & passed), np.flatnonzero((ratio <= 1) & ~passed)
            held[rows[wait]], reach[rows[wait]], beyond[:, rows[wait]] = True, ahead[wait], then[:, wait]
            state[:, rows[go]], phi[rows[go]] = then[:, go], phi[rows[go]] + ahead[go]
        state[:, stop - phi > 1e-14] = np.nan
        return state

    def _sides(self, phi: Array, state: Array, cycles: Cycles) -> Array:
        """Give (s, n) values of the switch functions."""
        if not self.switches:
            return np.empty((0, len(phi)))
        values = compiled(self.switches, self._names)(*self._places(phi, state, cycles))
        return np.stack([np.broadcast_to(value, phi.shape) for value in values])

    def _passed(self, phi: Array, state: Array, flags: Array, cycles: Cycles) -> NDArray[np.bool_]:
        return (2 * flags[:-1] - 1) * self._sides(phi, state, cycles) < 0

    def _cut(
        self,
        function: Numeric,
        rows: Rows,
        now: tuple[Array, Array, Array],
        then: tuple[Array, Array],
        cycles: Cycles,
    ) -> None:
        """Advance cycles whose next step passes a switch to just behind the first crossing, and turn it.

        ``now`` are phase, state and flags of all cycles, changed in place; ``then`` step and state behind.
        """
        (phi, state, flags), (reach, beyond) = now, then
        some = cycles.some(rows)
        signs, start, begin = 2 * flags[:-1, rows] - 1, phi[rows], state[:, rows]

        def depth(ahead: Array, trial: Array, open_: Rows) -> Array:
            sides = self._sides(start[open_] + ahead, trial, some.some(open_))
            return np.asarray((signs[:, open_] * sides).min(axis=0))

        every = np.arange(len(rows))
        low, high, found = np.zeros(len(rows)), reach[rows], beyond[:, rows]
        below, above = depth(low, begin, every), depth(high, found, every)
        # on the wrong side from the start: the switch turns here
        at_once = below <= 0
        high[at_once], found[:, at_once] = 0.0, begin[:, at_once]
        small = CROSSING * (np.abs(above) + np.abs(below))
        weight_low, weight_high, side = below.copy(), above.copy(), np.zeros(len(rows))
        for _ in range(HALVINGS):
            open_ = np.flatnonzero(~at_once & (high - low > 1e-13) & (np.abs(above) > small))
            if not len(open_) or (self.work is not None and self.work.done):
                break
            a, b = low[open_], high[open_]
            guess = a + (b - a) * weight_low[open_] / (weight_low[open_] - weight_high[open_])
            guess = np.where((guess > a) & (guess < b), guess, (a + b) / 2)
            part = some.some(open_)
            mode = flags[:, rows[open_]]
            trial, _ = self._step(function, start[open_], guess, begin[:, open_], mode, part)
            value = depth(guess, trial, open_)
            far, near = open_[value < 0], open_[value >= 0]
            high[far], above[far], found[:, far] = guess[value < 0], value[value < 0], trial[:, value < 0]
            low[near] = guess[value >= 0]
            weight_high[far], weight_low[near] = value[value < 0], np.maximum(value[value >= 0], 1e-300)
            # Illinois: an end that stays twice counts half
            weight_low[far[side[far] < 0]] /= 2
            weight_high[near[side[near] > 0]] /= 2
            side[far], side[near] = -1, 1
        state[:, rows], phi[rows] = found, start + high
        passed = signs * self._sides(phi[rows], found, some) < 0
        flags[:-1, rows] = np.where(passed, 1 - flags[:-1, rows], flags[:-1, rows])


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
        run = scipy.integrate.solve_ivp(
            slope, ends, start, "DOP853", max_step=0.2, rtol=1e-9, atol=1e-11 * scale
        )
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
