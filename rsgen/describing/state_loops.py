"""Laws whose states have equations, along a cycle: their closed loops, and the projections of the force.

Under x = X0 + X sin(phi) every state follows dz/dphi = g(x, v, z)/omega. A cycle is divided at its turning
points and at the crossings of switches, which move to where the loop crosses them, into parts on which the
law is smooth. There the loop, solved by ``rsgen.law.loops``, and its integrals have errors in even powers of
the step, and extrapolation from ever finer steps (W. Romberg, Norske Vid. Selsk. Forh. 28 (1955) 30) takes
these away one by one, until nothing changes any more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, blocks
from rsgen.common.errors import ExpressionError
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import OMEGA, STATE_V, STATE_X, X0, Inner, X
from rsgen.law.loops import periodic_states
from rsgen.law.memory import MemoryForm, Rate
from rsgen.law.pieces import Switch, normal_form
from rsgen.law.switched_sum import switched_sum

TOLERANCE = 1e-12
"""Difference of two extrapolations, relative to the mean absolute force, after which none follows."""

KNOWN = 1e-9
"""Difference that the last two may have: beyond, the states are too fast for so many steps."""

START, TURN = -np.pi / 2, 2 * np.pi
"""Phase at which a cycle begins, and its length."""

FIRST = 64
"""Steps of a half cycle in which no switch is passed twice unseen."""

STEPS = (32, 64, 128, 256, 512, 1024, 2048, 4096)
"""Steps of each part of a cycle; fewer leave what a turn excites ringing until the next."""

SEARCHES = 4
"""Searches for the crossings of switches; the second sees those that the steps of the first displaced."""

SHIFTS = 48
"""Newton steps to the crossings; three are enough where these are simple. Where states keep what was a cycle
before, each halves what is left."""

FARTHEST = 0.3
"""Phase of the longest of these steps."""

CROSSING = 1e-11
"""Phase by which a crossing may be off."""

WRONG = 1e-9
"""Of its range, by which a switch may be on the other side between its crossings: round-off."""

CYCLES_AT_ONCE = 64
TRIALS = 16
"""Random cycles of which one at least must close."""

STEPPED, MOST_STEPS = 2, 20_000
"""Of these so many are stepped through time, one by one, each in at most so many steps."""

STEPPED_TOLERANCE = 1e-6
"""Difference from a loop stepped through time: a thousand times the error of the stepping."""

ZERO_ODD = 1e-11
"""Share of the force below which f(x, v, z) + f(-x, -v, -z) is zero."""

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Cycles:
    """Cycles of amplitude, mean and frequency, with the values of all parameters; arrays (n,)."""

    X: Array
    mean: Array
    omega: Array
    values: tuple[Array, ...]

    def some(self, rows: slice) -> Cycles:
        """Give the cycles of these numbers."""
        return Cycles(self.X[rows], self.mean[rows], self.omega[rows], tuple(v[rows] for v in self.values))

    @property
    def fixed(self) -> list[Array]:
        """(n, 1) what does not change along a cycle."""
        return [value[:, None] for value in (self.X, self.mean, self.omega, *self.values)]


@dataclass(frozen=True, slots=True)
class _Parts:
    """Parts of n cycles.

    Parameters
    ----------
    ends
        (n, k+1) ascending phases from -pi/2 to 3 pi/2, or to pi/2 of an odd loop.
    crossed
        (n, k+1) switch that is crossed there; -1 where none is.
    first
        (f, n) whether each switch is on at the start.
    """

    ends: Array
    crossed: Rows
    first: NDArray[np.bool_]

    def nodes(self, steps: int) -> Array:
        """(n, k, steps+1) phases, closer to each other where something may have begun."""
        share = (1 - np.cos(np.pi * np.arange(steps + 1) / steps)) / 2
        return np.asarray(self.ends[:, :-1, None] + np.diff(self.ends)[:, :, None] * share)

    @property
    def flags(self) -> Array:
        """(f+1, n, k) one where a switch is on, last that of the sign of v, else zero."""
        passed = [np.cumsum(self.crossed[:, :-1] == each, axis=1) for each in range(len(self.first))]
        on = [(first[:, None] + times) % 2 for first, times in zip(self.first, passed, strict=True)]
        return np.array([*on, np.cos((self.ends[:, 1:] + self.ends[:, :-1]) / 2) > 0], dtype=float)

    def shifted(self, shift: Array) -> _Parts:
        """Move crossings (n, k+1), not beyond the ends."""
        place = np.clip(self.ends + np.clip(shift, -FARTHEST, FARTHEST), self.ends[:, :1], self.ends[:, -1:])
        return _Parts(*_sorted(place, self.crossed), self.first)


def _sorted(ends: Array, crossed: Rows) -> tuple[Array, Rows]:
    order = np.argsort(ends, axis=1, kind="stable")
    return np.take_along_axis(ends, order, axis=1), np.take_along_axis(crossed, order, axis=1)


@dataclass(frozen=True, slots=True)
class Loop:
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
    odd
        Whether f and g change their signs with x, v and z: then a loop that is not shifted has no mean.
    """

    force: sympy.Expr
    rates: tuple[Rate, ...]
    parameters: tuple[str, ...]
    modes: tuple[sympy.Expr, ...]
    switches: tuple[sympy.Expr, ...]
    flags: tuple[sympy.Symbol, ...]
    odd: bool

    @classmethod
    def of(cls, force: sympy.Expr, rates: tuple[Rate, ...]) -> Loop:
        """Take a force along the cycle and equations of states apart."""
        rates = tuple(replace(rate, rate=_defined_at_zero(rate.rate)) for rate in rates)
        force = _defined_at_zero(force)
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
        # a part ends where a power of a modulus has its corner and a friction law in a state its bend, too
        for form in forms:
            for switch in form.switches:
                flag(switch)
        for bend in sorted(set().union(*(mode.atoms(sympy.tanh, sympy.atan) for mode in modes)), key=str):
            if bend.free_symbols & {rate.symbol for rate in rates}:
                flags.setdefault(bend.args[0], sympy.Dummy())
        free = set().union(*(expression.free_symbols for expression in expressions))
        own = {s.name for s in free if not isinstance(s, Inner)} - {"x", "v", "X", "X0", "omega"}
        odd = _odd(expressions, tuple(rate.symbol for rate in rates))
        return cls(force, rates, tuple(sorted(own)), modes, tuple(flags), (*flags.values(), rising), odd)

    @property
    def states(self) -> str:
        """Names of the states, for a sentence."""
        return ", ".join(rate.symbol.name for rate in self.rates)

    @property
    def _moving(self) -> tuple[sympy.Symbol, ...]:
        return (STATE_X, STATE_V, *(rate.symbol for rate in self.rates))

    @property
    def _fixed(self) -> tuple[sympy.Symbol, ...]:
        return (X, X0, OMEGA, *map(symbol, self.parameters))

    def cycles(self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]) -> Cycles:
        """Put sizes and parameters (n,) in order."""
        fields = tuple(np.broadcast_to(values[name], X_.shape) for name in self.parameters)
        return Cycles(X_, np.broadcast_to(mean, X_.shape), np.broadcast_to(omega, X_.shape), fields)

    def harmonics(self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]) -> list[Array]:
        """Give stiffness [N/m], damping [N s/m] and mean force [N] of cycles; nan where no loop closes."""
        every, found = self.cycles(X_, mean, omega, values), np.empty((3, len(X_)))
        for rows in blocks(len(X_), CYCLES_AT_ONCE):
            found[:, rows], _ = self.turn(every.some(rows))
        return [found[0] / (np.pi * X_), found[1] / (np.pi * omega * X_), found[2] / (2 * np.pi)]

    def along(self, phi: Array, X_: float, mean: float, omega: float, values: Mapping[str, float]) -> Array:
        """Give the force [N] at phases (s,) of one cycle."""
        numbers = {name: np.array([value]) for name, value in values.items()}
        cycle = self.cycles(np.array([X_]), np.array([mean]), np.array([omega]), numbers)
        _, states = self.turn(cycle, phi)
        x, v = mean + X_ * np.sin(phi), omega * X_ * np.cos(phi)
        fixed = (X_, mean, omega, *(values[name] for name in self.parameters))
        (force,) = compiled((self.force,), (*self._moving, *self._fixed))(x, v, *states[:, 0, 1:], *fixed)
        return np.broadcast_to(force, phi.shape)

    def stepped(
        self, begin: Array, X_: float, omega: float, values: Mapping[str, float]
    ) -> tuple[float, float, float] | None:
        """Step one turn of the law as it is written through time, from states (q,) at -pi/2.

        Returns
        -------
        Stiffness [N/m], damping [N s/m], and by how much of its size the turn misses its start;
        None where that takes too many steps.
        """
        numbers, size = tuple(values[name] for name in self.parameters), len(self.rates)
        names = (*self._moving, *self._fixed)
        law = compiled((*(rate.rate for rate in self.rates), self.force), names)

        def slope(phi: float, state: Array) -> Array:
            sine, cosine = np.sin(phi), np.cos(phi)
            parts = law(X_ * sine, omega * X_ * cosine, *state[:size], X_, 0.0, omega, *numbers)
            return np.array([*(part / omega for part in parts[:-1]), parts[-1] * sine, parts[-1] * cosine])

        start = np.concatenate((begin, (0.0, 0.0)))
        scale = float(np.max(np.abs(begin))) or 1.0
        run = scipy.integrate.LSODA(
            slope, START, start, START + TURN, max_step=0.2, rtol=1e-10, atol=1e-11 * scale
        )
        for _ in range(MOST_STEPS):
            if run.status == "running":
                run.step()
        if run.status != "finished":
            return None
        end = run.y
        miss = float(np.max(np.abs(end[:size] - start[:size]))) / scale
        return float(end[size] / (np.pi * X_)), float(end[size + 1] / (np.pi * omega * X_)), miss

    def turn(self, cycles: Cycles, stops: Array | None = None) -> tuple[Array, Array]:
        """Give (3, n) integrals of f sin, f cos and f over cycles, and states (q, n, 1+s) at phases.

        The phases are -pi/2 and ``stops`` (s,). States are nan where no loop closes, integrals where they are
        not known to ``KNOWN``, too.
        """
        size, count = len(self.rates), len(cycles.X)
        expressions = (*(rate.rate for rate in self.rates), self.force)
        odd = self.odd and not (np.any(cycles.mean) and any(each.has(STATE_X) for each in expressions))
        # half a turn of an odd loop says all, and has no mean that it could keep
        length = TURN / 2 if odd else TURN
        ahead = np.concatenate([[0.0], [] if stops is None else stops - START])
        places, signs = START + ahead % length, np.where(odd & (ahead // length % 2 == 1), -1.0, 1.0)
        marks = np.sort([*places, *({START + TURN / 2, START + length})])
        ends = np.broadcast_to(marks, (count, len(marks)))
        parts = _Parts(ends, np.full(ends.shape, -1), np.zeros((len(self.switches), count), dtype=bool))
        phi = parts.nodes(FIRST)
        states = self._states(phi, None, cycles, (phi, np.zeros((size, *phi.shape))))
        result = np.full((4 + size * len(places), count), np.nan)
        error = np.full(count, np.inf)
        for _ in range(SEARCHES):
            # what does not close with some steps is not tried with more
            states = np.nan_to_num(states)
            parts, table = self._divided(marks, parts, phi, states, cycles), list[Array]()
            sound = np.ones(count, dtype=bool)
            for steps in STEPS:
                parts, phi, states, right = self._settled(parts, steps, cycles, (phi, states))
                sound &= right
                now = [self._integrals(parts, phi, states, cycles)]
                now += [
                    states[:, np.arange(count), np.sum(parts.ends[:, :-1] < p, axis=1), 0] for p in places
                ]
                row = [np.concatenate(now)]
                for back, coarser in enumerate(table, start=1):
                    row.append(row[-1] + (row[-1] - coarser) / (4.0**back - 1))
                change = np.abs(row[-1] - (table[-1] if table else 0.0))
                with np.errstate(all="ignore"):
                    change = change[: 2 if odd else 3].max(axis=0) / row[0][3]
                better = sound & ~(change >= error)
                result[:, better], error[better], table = row[-1][:, better], change[better], row
                if not np.any(sound & (error > TOLERANCE)):
                    break
            if np.all(sound | (error <= TOLERANCE)):
                break
        found = np.where(error > KNOWN, np.nan, result[:3])
        if odd:
            found *= [[2.0], [2.0], [0.0]]
        return found, signs * result[4:].reshape(len(places), size, count).transpose(1, 2, 0)

    def _states(self, phi: Array, flags: Array | None, cycles: Cycles, near: tuple[Array, Array]) -> Array:
        """(q, n, k, m) periodic states at phases (n, k, m); flags (f, n, k) None: as the states have them.

        ``near`` are phases and states (q, n, ...) from which Newton's method begins.
        """
        count, flat = len(phi), phi.reshape(len(phi), -1)
        turns = np.diff(flat, append=flat[:, -1:])
        x, v, a = self._motion(flat, cycles)
        expressions, values, names = tuple(rate.rate for rate in self.rates), cycles.fixed, self._fixed
        if flags is not None:
            expressions, names = self.modes[:-1], (*names, *self.flags)
            values += [flag.reshape(count, -1) for flag in np.repeat(flags[..., None], phi.shape[2], axis=3)]
            v = np.where(values[-1] > 0, np.maximum(v, 0.0), np.minimum(v, 0.0))
        equations = [switched_sum(each, self._moving, names) for each in expressions]
        # states that keep what they begin with begin with zero: between the turning points
        half = flat[0, -1] < np.pi
        middle, sign = (0, -1.0) if half else (phi.shape[2] // 2, 1.0)
        x, v, a, step = (np.roll(part, -middle, axis=1) for part in (x, v, a, turns / cycles.omega[:, None]))
        values = [np.roll(value, -middle, axis=1) for value in values]
        known, given = (part.reshape(*part.shape[:-2], -1) for part in near)
        start = np.array([list(map(np.interp, flat, known, state)) for state in given])
        start = np.roll(start, -middle, axis=2)
        with np.errstate(all="ignore"):
            states = periodic_states(equations, (x, v, a), step, values, start, sign, fitted=False)
        return np.roll(states, middle, axis=2).reshape(len(states), *phi.shape)

    def _motion(self, phi: Array, cycles: Cycles) -> tuple[Array, Array, Array]:
        """x, v and the acceleration at phases (n, ...)."""
        size, mean, omega = (
            np.expand_dims(value, tuple(range(1, phi.ndim)))
            for value in (cycles.X, cycles.mean, cycles.omega)
        )
        return mean + size * np.sin(phi), omega * size * np.cos(phi), -(omega**2) * size * np.sin(phi)

    def _sides(self, phi: Array, states: Array, cycles: Cycles) -> Array:
        """Give (f, n, k, m) values of the switch functions."""
        if not self.switches:
            return np.empty((0, *phi.shape))
        x, v, _ = self._motion(phi, cycles)
        fixed = (value[:, None] for value in cycles.fixed)
        with np.errstate(all="ignore"):
            values = compiled(self.switches, (*self._moving, *self._fixed))(x, v, *states, *fixed)
        return np.stack([np.broadcast_to(value, phi.shape) for value in values])

    def _divided(self, marks: Array, parts: _Parts, phi: Array, states: Array, cycles: Cycles) -> _Parts:
        """Divide cycles at ``marks`` and where switches are crossed between two phases (n, k, m) of parts."""
        sides, count, size = self._sides(phi, states, cycles), len(phi), phi[0].size
        # a loop that slides along a switch stays on its side
        near = np.abs(sides) <= _known(sides)
        on: NDArray[np.bool_] = np.where(near, parts.flags[:-1, :, :, None] > 0, sides > 0)
        on = on.reshape(*on.shape[:2], size)
        sides, phi = sides.reshape(on.shape), phi.reshape(count, size)
        with np.errstate(all="ignore"):
            share = np.nan_to_num(sides[..., :-1] / (sides[..., :-1] - sides[..., 1:]))
        place = phi[:, :-1] + np.diff(phi) * np.clip(share, 0.0, 1.0)
        place = np.where(on[..., :-1] != on[..., 1:], place, np.inf)
        place = np.moveaxis(place, 1, 0).reshape(count, len(sides) * (size - 1))
        most = int(np.isfinite(place).sum(axis=1).max(initial=0))
        order = np.argsort(place, axis=1)[:, :most]
        place = np.take_along_axis(place, order, axis=1)
        which = np.where(np.isfinite(place), order // (size - 1), -1)
        given = np.broadcast_to(marks, (count, len(marks)))
        ends = np.concatenate([given, np.where(which < 0, marks[-1], place)], axis=1)
        crossed = np.concatenate([np.full(given.shape, -1), which], axis=1)
        return _Parts(*_sorted(ends, crossed), on[:, :, 0])

    def _settled(
        self, parts: _Parts, steps: int, cycles: Cycles, near: tuple[Array, Array]
    ) -> tuple[_Parts, Array, Array, NDArray[np.bool_]]:
        """Move the crossings to where the loop crosses; parts, phases, states, and (n,) whether it does."""
        for _ in range(SHIFTS):
            phi, flags = parts.nodes(steps), parts.flags
            states = self._states(phi, flags, cycles, near)
            near = (phi, states)
            if not np.any(parts.crossed >= 0):
                break
            shift = self._shift(parts, phi[:, :, -1], flags, states[..., -1], cycles)
            if not np.any(np.abs(shift) > CROSSING):
                break
            parts = parts.shifted(shift)
        sides = self._sides(phi, states, cycles)
        with np.errstate(all="ignore"):
            wrong: NDArray[np.bool_] = (2 * flags[:-1, :, :, None] - 1) * sides[..., 1:-1] < -_known(sides)
        return parts, phi, states, np.logical_not(wrong.any(axis=(0, 2, 3)))

    def _shift(self, parts: _Parts, phi: Array, flags: Array, states: Array, cycles: Cycles) -> Array:
        """(n, k+1) Newton step of each crossing, from what is before it."""
        x, v, a = self._motion(phi, cycles)
        moving, shift = (x, v, *states), np.zeros(parts.ends.shape)
        zero = tuple(np.zeros_like(x) for _ in moving)
        rates = [v, a]
        for mode in self.modes[:-1]:
            law = switched_sum(mode, self._moving, (*self._fixed, *self.flags))
            rates.append(law(moving, zero, x, [*cycles.fixed, *flags], by_parameters=False)[0])
        for number, switch in enumerate(self.switches):
            law = switched_sum(switch, self._moving, self._fixed)
            side, *slopes = law(moving, zero, x, cycles.fixed, by_parameters=False)
            speed = sum(slope * rate for slope, rate in zip(slopes, rates, strict=True))
            with np.errstate(all="ignore"):
                step = -side * cycles.omega[:, None] / speed
            shift[:, 1:] += np.where(
                parts.crossed[:, 1:] == number, np.nan_to_num(step, posinf=0, neginf=0), 0
            )
        # where the motion turns its speed says nothing: what reaches a mark stays there
        marks = np.where(parts.crossed < 0, parts.ends, np.inf)
        away = np.abs(parts.ends[:, :, None] - marks[:, None]).min(axis=2)
        return np.where(away > CROSSING, shift, 0.0)

    def _integrals(self, parts: _Parts, phi: Array, states: Array, cycles: Cycles) -> Array:
        """(4, n) integrals of f sin, f cos, f and abs(f) over cycles by the trapezoidal rule."""
        x, v, _ = self._motion(phi, cycles)
        values = [*(value[:, None] for value in cycles.fixed), *parts.flags[..., None]]
        with np.errstate(all="ignore"):
            (force,) = compiled(self.modes[-1:], (*self._moving, *self._fixed, *self.flags))(
                x, v, *states, *values
            )
        weights = np.pad(np.diff(phi), ((0, 0), (0, 0), (1, 1)))
        weights = (weights[..., 1:] + weights[..., :-1]) / 2
        return np.stack(
            [
                np.sum(f * weights, axis=(1, 2))
                for f in (force * np.sin(phi), force * np.cos(phi), force, np.abs(force))
            ]
        )


def _known(sides: Array) -> Array:
    """(f, n, 1, 1) size of switch functions (f, n, k, m) from which on their sign is no round-off."""
    return np.asarray(WRONG * np.abs(sides).max(axis=(2, 3), initial=0.0)[:, :, None, None])


def _defined_at_zero(expression: sympy.Expr) -> sympy.Expr:
    """Write z*Abs(z)**(n - 1) as sign(z)*Abs(z)**n, which is not zero times infinity at z = 0."""

    def joined(product: sympy.Expr) -> sympy.Expr:
        powers = dict(product.as_powers_dict())
        for size in [each for each in powers if isinstance(each, sympy.Abs)]:
            inner, lower = size.args[0], powers[size]
            upper = powers.get(inner, sympy.S.Zero)
            if upper.is_Integer and upper > 0 and not lower.is_nonnegative:
                powers |= {size: upper + lower, inner: sympy.S.Zero, sympy.sign(inner): upper % 2}
        return sympy.Mul(*(base**exponent for base, exponent in powers.items()))

    return expression.replace(lambda part: part.is_Mul, joined)


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


def try_loops(loop: Loop) -> tuple[float | None, tuple[str, ...]]:
    """Compute loops at random values of everything, and step some of them through time.

    Returns
    -------
    Largest difference in stiffness or damping from loops stepped through time, relative to both and the mean,
    or None where there is nothing to compare; and what is to be said about it.

    Raises
    ------
    ExpressionError
        Not one of them closes.
    """
    rng = np.random.default_rng(8)
    values = {name: np.exp(rng.uniform(-1, 1, TRIALS)) for name in loop.parameters}
    amplitude, omega = np.exp(rng.uniform(-2, 1, TRIALS)), np.exp(rng.uniform(-1, 1, TRIALS))
    cycles = loop.cycles(amplitude, np.zeros(TRIALS), omega, values)
    found, begin = loop.turn(cycles)
    if not np.isfinite(begin).all(axis=(0, 2)).any():
        raise ExpressionError(
            f"memory: the loop of {loop.states} does not close at X = {amplitude[0]:.3g} m or any of "
            f"{TRIALS} amplitudes tried with positive parameters: under a sine it grows or drifts for ever, "
            "or is not found"
        )
    closed = np.flatnonzero(np.isfinite(found[0]))
    if not len(closed):
        return None, (
            f"The loop closes, but wherever it was tried {loop.states} changes so much faster than the "
            "motion that its force is not known: it was not compared with one stepped through time.",
        )
    found /= np.pi * amplitude
    worst = 0.0
    for row in closed[:STEPPED]:
        numbers = {name: float(value[row]) for name, value in values.items()}
        size, speed = float(amplitude[row]), float(omega[row])
        stepped = loop.stepped(begin[:, row, 0], size, speed, numbers)
        if stepped is None:
            return None, (
                "To follow the loop takes too many steps here: it was not compared with one stepped through "
                "time.",
            )
        stiffness, damping, miss = stepped
        # a state that stays where it is has a mean force alone
        whole = abs(stiffness) + speed * abs(damping) + abs(found[2, row]) / 2
        differences = (found[0, row] - stiffness, found[1, row] - speed * damping)
        # no force at all is none, however it is reached
        worst = max(worst, miss, *(abs(difference) / (whole or 1.0) for difference in differences))
    said = f"The loop differs from one stepped through time by {worst:.1e}: trust no more digits."
    return float(worst), (said,) if worst > STEPPED_TOLERANCE else ()
