"""Projections of a force f(x, v, z) along the closed loop of its states.

    dz/dphi = g(x, v, z)/omega,  z(phi + 2 pi) = z(phi),  x = X0 + X sin(phi),  v = omega X cos(phi)

A cycle is divided into parts at its turning points and at the phases at which a switch changes its sign, so
that the law is smooth on each part. These crossings are unknowns: Newton's method moves each to the phase at
which the computed loop crosses the switch. On a smooth part the trapezoidal rule has errors in even powers of
the step, both for the periodic states (solved for all steps at once by ``rsgen.law.loops``) and for the
integrals of the force. So the steps are halved, and Richardson extrapolation (W. Romberg, Norske Vid. Selsk.
Forh. 28 (1955) 30) removes one power after the other until two results agree.
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
from rsgen.common.tolerances import MAX_NEWTON_STEPS, ROUND_OFF
from rsgen.describing.function import MAX_RELATIVE_ERROR
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import OMEGA, STATE_V, STATE_X, X0, Inner, X
from rsgen.law.character import is_mirrored
from rsgen.law.loops import periodic_states
from rsgen.law.memory import MemoryForm, Rate
from rsgen.law.normal_form import Switch, normal_form, switched_sum

START, PERIOD = -np.pi / 2, 2 * np.pi
"""Phase at which a cycle begins, and its length."""

STEPS = (32, 64, 128, 256, 512, 1024, 2048, 4096)
"""Steps of each part of a cycle, finer until the result is accurate."""

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Cycles:
    """Cycles of amplitude, mean and frequency, with the values of all parameters; arrays (n,)."""

    X: Array
    mean: Array
    omega: Array
    values: tuple[Array, ...]

    def some(self, rows: slice) -> Cycles:
        """Take some of the cycles."""
        return Cycles(self.X[rows], self.mean[rows], self.omega[rows], tuple(v[rows] for v in self.values))

    @property
    def fixed(self) -> list[Array]:
        """(n, 1) arguments that are constant along a cycle."""
        return [value[:, None] for value in (self.X, self.mean, self.omega, *self.values)]


MAX_SHIFT = 0.3
"""Largest phase by which one Newton step moves a crossing."""


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
        (f, n) True where a switch is on at the start.
    """

    ends: Array
    crossed: Rows
    first: NDArray[np.bool_]

    def nodes(self, steps: int) -> Array:
        """(n, k, steps+1) phases, denser towards the ends of each part."""
        share = (1 - np.cos(np.pi * np.arange(steps + 1) / steps)) / 2
        return np.asarray(self.ends[:, :-1, None] + np.diff(self.ends)[:, :, None] * share)

    @property
    def flags(self) -> Array:
        """(f+1, n, k) one where a switch is on, last that of the sign of v, else zero."""
        crossings = [np.cumsum(self.crossed[:, :-1] == f, axis=1) for f in range(len(self.first))]
        on = [(first[:, None] + count) % 2 for first, count in zip(self.first, crossings, strict=True)]
        return np.array([*on, np.cos((self.ends[:, 1:] + self.ends[:, :-1]) / 2) > 0], dtype=float)

    def shifted(self, shift: Array) -> _Parts:
        """Move crossings by (n, k+1) phases, at most by ``MAX_SHIFT`` and not beyond the ends."""
        shift = np.clip(shift, -MAX_SHIFT, MAX_SHIFT)
        place = np.clip(self.ends + shift, self.ends[:, :1], self.ends[:, -1:])
        return _Parts(*_sorted(place, self.crossed), self.first)


def _sorted(ends: Array, crossed: Rows) -> tuple[Array, Rows]:
    order = np.argsort(ends, axis=1, kind="stable")
    return np.take_along_axis(ends, order, axis=1), np.take_along_axis(crossed, order, axis=1)


CYCLES_PER_BLOCK = 64

MAX_CROSSING_SEARCHES = 4
"""Searches for crossings: a later one finds those that appear or vanish as the loop is refined."""

CROSSING_TOLERANCE = 1e-11
"""Accuracy of the phase of a crossing [rad]."""


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
        Switch functions other than v.
    flags
        Symbols of ``switches``, then that of the sign of v.
    odd
        True if f and g change their signs with x, v and z: then a loop about X0 = 0 has no mean.
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
        """Collect the switches of a force along the cycle and of the equations of its states."""
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
        # a part also ends at the corner of a power of a modulus, and at the bend of a friction law in a state
        for form in forms:
            for switch in form.switches:
                flag(switch)
        for bend in sorted(set().union(*(mode.atoms(sympy.tanh, sympy.atan) for mode in modes)), key=str):
            if bend.free_symbols & {rate.symbol for rate in rates}:
                flags.setdefault(bend.args[0], sympy.Dummy())
        free = set().union(*(expression.free_symbols for expression in expressions))
        names = {s.name for s in free if not isinstance(s, Inner)} - {"x", "v", "X", "X0", "omega"}
        odd = _all_odd(expressions, tuple(rate.symbol for rate in rates))
        return cls(force, rates, tuple(sorted(names)), modes, tuple(flags), (*flags.values(), rising), odd)

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
        """Return stiffness [N/m], damping [N s/m] and mean force [N] of cycles; nan where no loop closes."""
        cycles, found = self.cycles(X_, mean, omega, values), np.empty((3, len(X_)))
        for rows in blocks(len(X_), CYCLES_PER_BLOCK):
            found[:, rows], _ = self.project(cycles.some(rows))
        return [found[0] / (np.pi * X_), found[1] / (np.pi * omega * X_), found[2] / (2 * np.pi)]

    def along(self, phi: Array, X_: float, mean: float, omega: float, values: Mapping[str, float]) -> Array:
        """Return the force [N] at phases (s,) of one cycle."""
        numbers = {name: np.array([value]) for name, value in values.items()}
        cycle = self.cycles(np.array([X_]), np.array([mean]), np.array([omega]), numbers)
        _, states = self.project(cycle, phi)
        x, v = mean + X_ * np.sin(phi), omega * X_ * np.cos(phi)
        fixed = (X_, mean, omega, *(values[name] for name in self.parameters))
        (force,) = compiled((self.force,), (*self._moving, *self._fixed))(x, v, *states[:, 0, 1:], *fixed)
        return np.broadcast_to(force, phi.shape)

    def stepped(
        self, begin: Array, X_: float, omega: float, values: Mapping[str, float]
    ) -> tuple[float, float, float] | None:
        """Integrate the law as it is written over one cycle, from states (q,) at phase -pi/2, by LSODA.

        Returns
        -------
        Stiffness [N/m], damping [N s/m] and the distance of the last states from the first ones, relative to
        these; None after ``MAX_LSODA_STEPS``.
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
            slope, START, start, START + PERIOD, max_step=0.2, rtol=1e-10, atol=1e-11 * scale
        )
        for _ in range(MAX_LSODA_STEPS):
            if run.status == "running":
                run.step()
        if run.status != "finished":
            return None
        end = run.y
        miss = float(np.max(np.abs(end[:size] - start[:size]))) / scale
        return float(end[size] / (np.pi * X_)), float(end[size + 1] / (np.pi * omega * X_)), miss

    def project(self, cycles: Cycles, stops: Array | None = None) -> tuple[Array, Array]:
        """Return (3, n) integrals of f sin, f cos and f over cycles, and states (q, n, 1+s) at phases.

        The phases are -pi/2 and ``stops`` (s,). States are nan if no loop closes, integrals also if their
        error exceeds ``MAX_RELATIVE_ERROR``.
        """
        size, count = len(self.rates), len(cycles.X)
        expressions = (*(rate.rate for rate in self.rates), self.force)
        odd = self.odd and not (np.any(cycles.mean) and any(e.has(STATE_X) for e in expressions))
        # the second half of an odd loop is the first with the other sign
        length = PERIOD / 2 if odd else PERIOD
        ahead = np.concatenate([[0.0], [] if stops is None else stops - START])
        places, signs = START + ahead % length, np.where(odd & (ahead // length % 2 == 1), -1.0, 1.0)
        marks = np.sort([*places, *({START + PERIOD / 2, START + length})])
        ends = np.broadcast_to(marks, (count, len(marks)))
        parts = _Parts(ends, np.full(ends.shape, -1), np.zeros((len(self.switches), count), dtype=bool))
        # between so many phases of half a cycle no switch changes its sign twice
        phi = parts.nodes(STEPS[1])
        states = self._states(phi, None, cycles, (phi, np.zeros((size, *phi.shape))))
        result = np.full((4 + size * len(places), count), np.nan)
        error = np.full(count, np.inf)
        for _ in range(MAX_CROSSING_SEARCHES):
            # a loop that does not close with some steps is not tried with more
            states = np.nan_to_num(states)
            parts, table = self._divide(marks, parts, phi, states, cycles), list[Array]()
            consistent = np.ones(count, dtype=bool)
            for steps in STEPS:
                parts, phi, states, signs_agree = self._solve_crossings(parts, steps, cycles, (phi, states))
                consistent &= signs_agree
                at_places = [
                    states[:, np.arange(count), np.sum(parts.ends[:, :-1] < p, axis=1), 0] for p in places
                ]
                row = [np.concatenate([self._integrals(parts, phi, states, cycles), *at_places])]
                for order, coarser in enumerate(table, start=1):
                    row.append(row[-1] + (row[-1] - coarser) / (4.0**order - 1))
                change = np.abs(row[-1] - (table[-1] if table else 0.0))
                with np.errstate(all="ignore"):
                    change = change[: 2 if odd else 3].max(axis=0) / row[0][3]
                better = consistent & ~(change >= error)
                result[:, better], error[better], table = row[-1][:, better], change[better], row
                if not np.any(consistent & (error > ROUND_OFF)):
                    break
            if np.all(consistent | (error <= ROUND_OFF)):
                break
        found = np.where(error > MAX_RELATIVE_ERROR, np.nan, result[:3])
        if odd:
            found *= [[2.0], [2.0], [0.0]]
        return found, signs * result[4:].reshape(len(places), size, count).transpose(1, 2, 0)

    def _states(self, phi: Array, flags: Array | None, cycles: Cycles, guess: tuple[Array, Array]) -> Array:
        """(q, n, k, m) periodic states at phases (n, k, m); flags (f, n, k) None: from the states.

        ``guess`` are phases and states (q, n, ...) with which Newton's method begins.
        """
        count, flat = len(phi), phi.reshape(len(phi), -1)
        intervals = np.diff(flat, append=flat[:, -1:])
        x, v, a = self._motion(flat, cycles)
        expressions, values, names = tuple(rate.rate for rate in self.rates), cycles.fixed, self._fixed
        if flags is not None:
            expressions, names = self.modes[:-1], (*names, *self.flags)
            values += [flag.reshape(count, -1) for flag in np.repeat(flags[..., None], phi.shape[2], axis=3)]
            v = np.where(values[-1] > 0, np.maximum(v, 0.0), np.minimum(v, 0.0))
        equations = [switched_sum(e, self._moving, names) for e in expressions]
        # states that keep their initial value begin with zero between the turning points
        half = flat[0, -1] < np.pi
        middle, sign = (0, -1.0) if half else (phi.shape[2] // 2, 1.0)
        x, v, a, step = (
            np.roll(part, -middle, axis=1) for part in (x, v, a, intervals / cycles.omega[:, None])
        )
        values = [np.roll(value, -middle, axis=1) for value in values]
        phases, values_there = (part.reshape(*part.shape[:-2], -1) for part in guess)
        start = np.array([list(map(np.interp, flat, phases, state)) for state in values_there])
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
        """Return (f, n, k, m) values of the switch functions."""
        if not self.switches:
            return np.empty((0, *phi.shape))
        x, v, _ = self._motion(phi, cycles)
        fixed = (value[:, None] for value in cycles.fixed)
        with np.errstate(all="ignore"):
            values = compiled(self.switches, (*self._moving, *self._fixed))(x, v, *states, *fixed)
        return np.stack([np.broadcast_to(value, phi.shape) for value in values])

    def _divide(self, marks: Array, parts: _Parts, phi: Array, states: Array, cycles: Cycles) -> _Parts:
        """Divide cycles at ``marks`` and where a switch changes its sign between two phases (n, k, m)."""
        sides, count, size = self._sides(phi, states, cycles), len(phi), phi[0].size
        # a loop that slides along a switch stays on its side
        sliding = np.abs(sides) <= _round_off(sides)
        on: NDArray[np.bool_] = np.where(sliding, parts.flags[:-1, :, :, None] > 0, sides > 0)
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
        fixed = np.broadcast_to(marks, (count, len(marks)))
        ends = np.concatenate([fixed, np.where(which < 0, marks[-1], place)], axis=1)
        crossed = np.concatenate([np.full(fixed.shape, -1), which], axis=1)
        return _Parts(*_sorted(ends, crossed), on[:, :, 0])

    def _solve_crossings(
        self, parts: _Parts, steps: int, cycles: Cycles, guess: tuple[Array, Array]
    ) -> tuple[_Parts, Array, Array, NDArray[np.bool_]]:
        """Solve for the loop and its crossings by Newton's method.

        Returns
        -------
        Parts, phases, states, and (n,) True where every switch has the sign of its flag between crossings.
        """
        for _ in range(MAX_NEWTON_STEPS):
            phi, flags = parts.nodes(steps), parts.flags
            states = self._states(phi, flags, cycles, guess)
            guess = (phi, states)
            if not np.any(parts.crossed >= 0):
                break
            shift = self._shift(parts, phi[:, :, -1], flags, states[..., -1], cycles)
            if not np.any(np.abs(shift) > CROSSING_TOLERANCE):
                break
            parts = parts.shifted(shift)
        sides = self._sides(phi, states, cycles)
        with np.errstate(all="ignore"):
            wrong: NDArray[np.bool_] = (2 * flags[:-1, :, :, None] - 1) * sides[..., 1:-1] < -_round_off(
                sides
            )
        return parts, phi, states, np.logical_not(wrong.any(axis=(0, 2, 3)))

    def _shift(self, parts: _Parts, phi: Array, flags: Array, states: Array, cycles: Cycles) -> Array:
        """(n, k+1) Newton step of each crossing, from the values before it."""
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
        # at a turning point the speed is zero: a crossing that has reached a mark stays there
        marks = np.where(parts.crossed < 0, parts.ends, np.inf)
        distance = np.abs(parts.ends[:, :, None] - marks[:, None]).min(axis=2)
        return np.where(distance > CROSSING_TOLERANCE, shift, 0.0)

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


def _round_off(sides: Array) -> Array:
    """(f, n, 1, 1) size of switch functions (f, n, k, m) below which their sign is not known."""
    return np.asarray(MAX_RELATIVE_ERROR * np.abs(sides).max(axis=(2, 3), initial=0.0)[:, :, None, None])


def _defined_at_zero(expression: sympy.Expr) -> sympy.Expr:
    """Write z*Abs(z)**(n - 1) as sign(z)*Abs(z)**n, which is not zero times infinity at z = 0."""

    def joined(product: sympy.Expr) -> sympy.Expr:
        powers = dict(product.as_powers_dict())
        for size in [base for base in powers if isinstance(base, sympy.Abs)]:
            inner, lower = size.args[0], powers[size]
            upper = powers.get(inner, sympy.S.Zero)
            if upper.is_Integer and upper > 0 and not lower.is_nonnegative:
                powers |= {size: upper + lower, inner: sympy.S.Zero, sympy.sign(inner): upper % 2}
        return sympy.Mul(*(base**exponent for base, exponent in powers.items()))

    return expression.replace(lambda part: part.is_Mul, joined)


def _all_odd(expressions: tuple[sympy.Expr, ...], states: tuple[sympy.Symbol, ...]) -> bool:
    """Decide whether all expressions change their signs with x, v and the states."""
    moving = (STATE_X, STATE_V, *states)
    others = sorted(set().union(*(e.free_symbols for e in expressions)) - set(moving), key=str)
    return all(is_mirrored(expression, moving, others, -1.0) for expression in expressions)


def is_odd(force: sympy.Expr, memory: MemoryForm) -> bool:
    """Decide whether a force of x, v and memories, and the equations of the states, are odd."""
    return _all_odd((force, *(rate.rate for rate in memory.rates)), memory.states)


TRIAL_CYCLES = 16
"""Random cycles of which at least one must close."""

STEPPED_CYCLES = 2
"""Random cycles that are compared with an integration in time."""

MAX_LSODA_STEPS = 20_000

STEPPED_TOLERANCE = 1e3 * MAX_RELATIVE_ERROR
"""Difference from the integration in time beyond which a remark says so: a thousand times its error."""


def try_loops(loop: Loop) -> tuple[float | None, tuple[str, ...]]:
    """Compute loops at random values, and compare some of them with an integration in time.

    Returns
    -------
    Largest difference in stiffness or damping, relative to the sum of both and of the mean force, or None if
    nothing could be compared; and remarks about the comparison.

    Raises
    ------
    ExpressionError
        None of the loops closes.
    """
    rng = np.random.default_rng(8)
    values = {name: np.exp(rng.uniform(-1, 1, TRIAL_CYCLES)) for name in loop.parameters}
    amplitude = np.exp(rng.uniform(-2, 1, TRIAL_CYCLES))
    omega = np.exp(rng.uniform(-1, 1, TRIAL_CYCLES))
    cycles = loop.cycles(amplitude, np.zeros(TRIAL_CYCLES), omega, values)
    found, begin = loop.project(cycles)
    if not np.isfinite(begin).all(axis=(0, 2)).any():
        raise ExpressionError(
            f"memory: the loop of {loop.states} does not close at X = {amplitude[0]:.3g} m or any of "
            f"{TRIAL_CYCLES} amplitudes tried with positive parameters: under a sine it grows or drifts for "
            "ever, or is not found"
        )
    closed = np.flatnonzero(np.isfinite(found[0]))
    if not len(closed):
        return None, (
            f"The loop closes, but wherever it was tried {loop.states} changes so much faster than the "
            "motion that its force is not known: it was not compared with one stepped through time.",
        )
    found /= np.pi * amplitude
    worst = 0.0
    for row in closed[:STEPPED_CYCLES]:
        numbers = {name: float(value[row]) for name, value in values.items()}
        size, speed = float(amplitude[row]), float(omega[row])
        stepped = loop.stepped(begin[:, row, 0], size, speed, numbers)
        if stepped is None:
            return None, (
                "To follow the loop takes too many steps here: it was not compared with one stepped through "
                "time.",
            )
        stiffness, damping, miss = stepped
        # the force of a constant state is a mean force alone
        scale = abs(stiffness) + speed * abs(damping) + abs(found[2, row]) / 2 or 1.0
        differences = (found[0, row] - stiffness, found[1, row] - speed * damping)
        worst = max(worst, miss, *(abs(difference) / scale for difference in differences))
    remark = f"The loop differs from one stepped through time by {worst:.1e}: trust no more digits."
    return float(worst), (remark,) if worst > STEPPED_TOLERANCE else ()
