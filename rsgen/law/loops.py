"""The closed loop of a law with memory along periodic motions, and its derivatives.

Masing laws:  n = n_r -+ 2 n_virgin(|x - x_r|/2) after the reversal r;
states:       dz/dt = g(x, v, z; p),  z(t + T) = z(t).

All samples of a period are computed at once, with the derivatives that Newton's method on a balance needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.solvers import CONVERGED_STEP, newton
from rsgen.common.tolerances import MAX_STEP_HALVINGS
from rsgen.formula.names import symbol
from rsgen.law.memory import RESIDUAL_TOLERANCE, MemoryForm, defined_at_zero, real_powers
from rsgen.law.normal_form import ForceSample, Perturbation, SwitchedSum, switched_sum

# ----------------------------------------------------------------------------
# Closed loops of Masing laws along periodic motions, from their virgin curve.
#
# After a reversal at x_r with force n_r the force is n_r -+ 2 n(|x - x_r|/2); a branch that reaches the
# reversal before the last one closes a minor loop and continues the branch on which that loop began
# (Madelung's rules, Ann. Phys. 322 (1905) 861). Between the extremes of the period the loop is centred:
# n_r = n(A) at the largest displacement, A half the distance of the extremes.

Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Reversals:
    """Reversals of n motions, and the reversal at which the branch at each sample began.

    Parameters
    ----------
    row, sample
        (r,) motion and nearest sample of every reversal.
    place
        (r,) displacement there [m].
    after
        (r,) time from that sample to the reversal [s].
    falling
        (r,) 1 where the branch after it falls, else -1.
    parent
        (r,) reversal at which the branch that ends here began; itself for the largest of a motion.
    opposite
        (r,) at the largest of a motion the smallest one, else unused.
    depth
        (r,) 0 for the largest of a motion, else one more than the parent's.
    reference
        (n, s) reversal at which the branch at a sample began.
    """

    row: Indices
    sample: Indices
    place: Array
    after: Array
    falling: Array
    parent: Indices
    opposite: Indices
    depth: Indices
    reference: Indices

    def shifts(self, dx: Array, dv: Array) -> Array:
        """(r, d) change of each place for changes of the motion, dx (d, s) and dv (n, d, s)."""
        return np.asarray(dx[:, self.sample].T + self.after[:, None] * dv[self.row, :, self.sample])


def find_reversals(x: Array, v: Array, a: Array, step: Array) -> Reversals:
    """Find all reversals of periodic motions (n, s) and the branch at every sample; ``step`` (n, 1) [s]."""
    count, samples = x.shape
    upward = v > 0
    turns = upward != np.roll(upward, -1, axis=1)
    # a motion that stands still has a reversal without a branch
    turns[~turns.any(axis=1), -1] = True
    row, before = np.nonzero(turns)
    after = (before + 1) % samples
    nearer = np.where(np.abs(v[row, before]) <= np.abs(v[row, after]), before, after)
    speed, bend = v[row, nearer], a[row, nearer]
    width = np.broadcast_to(step, (count, 1))[row, 0]
    with np.errstate(all="ignore"):
        late = np.clip(np.nan_to_num(-speed / bend), -width, width)
    # where the motion hardly bends, v^2/(2a) would lead far away
    place = x[row, nearer] + speed * late + bend * late**2 / 2
    falling = np.where(upward[row, before], 1.0, -1.0)
    reversals = np.bincount(row, minlength=count)
    first = np.cumsum(reversals) - reversals
    numbers = np.arange(len(row))
    parent, opposite, depth = np.array(numbers), np.array(numbers), np.zeros(len(row), dtype=np.intp)
    reference = np.repeat(first[:, None], samples, axis=1)
    plain = reversals == 2
    even, odd = first[plain], first[plain] + 1
    top = np.where(falling[even] > 0, even, odd)
    bottom = even + odd - top
    parent[bottom], opposite[top], depth[bottom] = top, bottom, 1
    reference[plain] = np.where(upward[plain], bottom[:, None], top[:, None])
    for motion in np.flatnonzero(reversals > 2):
        part = slice(first[motion], first[motion] + reversals[motion])
        _nest_minor_loops(
            x[motion], place, numbers[part], before[part], falling, parent, opposite, depth, reference[motion]
        )
    return Reversals(row, nearer, place, late, falling, parent, opposite, depth, reference)


def _nest_minor_loops(
    x: Array,
    place: Array,
    numbers: Indices,
    before: Indices,
    falling: Array,
    parent: Indices,
    opposite: Indices,
    depth: Indices,
    reference: Indices,
) -> None:
    """Enter the branches of a motion with minor loops, from its largest displacement on, by a stack."""
    samples = len(x)
    start = int(np.argmax(np.where(falling[numbers] > 0, place[numbers], -np.inf)))
    order = np.roll(numbers, -start)
    ends = np.roll(before, -start)
    stack = [int(order[0])]
    opposite[order[0]] = order[int(np.argmin(place[order]))]
    for (number, end), (following, last) in pairwise([*zip(order, ends, strict=True), (order[0], ends[0])]):
        inside = (end + 1 + np.arange((last - end) % samples)) % samples
        sign = falling[number]
        reference[inside] = stack[-1]
        while len(stack) > 2:
            closed = place[stack[-2]]
            beyond = inside[sign * (closed - x[inside]) > 0]
            if not len(beyond) and sign * (closed - place[following]) <= 0:
                break
            del stack[-2:]
            reference[beyond] = stack[-1]
        if following != order[0]:
            parent[following], depth[following] = stack[-1], depth[stack[-1]] + 1
            stack.append(int(following))


class Loop:
    """The loop of one virgin curve along motions (n, s) with known reversals.

    ``force`` (n, s) [N]; ``slope`` its derivative by x on the branch; ``by_parameter`` by every parameter.
    """

    def __init__(
        self,
        virgin: SwitchedSum,
        x: Array,
        v: Array,
        step: Array,
        values: Sequence[Any] | Array,
        at: Reversals,
    ) -> None:
        self._at = at
        half = np.abs(at.place - at.place[at.parent]) / 2
        first = at.depth == 0
        half[first] = (at.place[first] - at.place[at.opposite[first]]) / 2
        at_reversals = [value if np.ndim(value) == 0 else value[at.row] for value in values]
        zero = np.zeros((len(half), 1))
        ends = [part[:, 0] for part in virgin((half[:, None],), (zero,), zero, at_reversals)]
        branch = virgin((np.abs(x - at.place[at.reference]) / 2,), (np.abs(v) / 2,), step, values)
        self._end_slope, self.slope = ends[1], branch[1]
        down = at.falling[at.reference]
        forces = [
            self._reached(end)[at.reference] - 2 * down * part
            for end, part in zip((ends[0], *ends[2:]), (branch[0], *branch[2:]), strict=True)
        ]
        self.force, self.by_parameter = forces[0], tuple(forces[1:])

    def _reached(self, end: Array) -> Array:
        """(r,) at every reversal, from the virgin curve at half the way from its parent."""
        at, reached = self._at, np.array(end)
        for depth in range(1, int(at.depth.max(initial=0)) + 1):
            rows = at.depth == depth
            parent = at.parent[rows]
            reached[rows] = reached[parent] - 2 * at.falling[parent] * end[rows]
        return reached

    def perturb(self, dx: Array, dv: Array) -> Array:
        """(1, n, d, s) change of the force for a change of the motion, dx (d, s) and dv (n, d, s)."""
        at = self._at
        place = at.shifts(dx, dv)
        reached = self._end_slope[:, None] * (place - place[at.opposite]) / 2
        for depth in range(1, int(at.depth.max(initial=0)) + 1):
            rows = at.depth == depth
            parent = at.parent[rows]
            reached[rows] = reached[parent] + self._end_slope[rows, None] * (place[rows] - place[parent])
        slope = self.slope[None, :, None, :]
        place, reached = (np.moveaxis(part[at.reference], 2, 1) for part in (place, reached))
        return np.asarray(slope * (dx - place) + reached)


# ----------------------------------------------------------------------------
# Closed loops of states z' = g(x, v, z; p) along periodic motions: all samples at once, by Newton's method.
#
# From sample to sample  z_1 - z_0 = h ((1 - theta) g_0 + theta g_1)  with  theta = 1/(1 - exp(-q)) - 1/q,
# q = h times the largest rate of decay: exact for a linear law with constant input, the trapezoidal rule
# for slow states, the implicit Euler rule for states that decay within a step (exponential fitting; Liniger
# and Willoughby, SIAM J. Numer. Anal. 7 (1970) 47). The error is O(h^2), as that of the shares of switches.
# A loop counts only if it attracts its neighbours: states that begin at zero never reach another one.

MIN_PERIOD_DECAY = 1e-5
"""Smallest decay in a period of a state that forgets its initial value; others have no mean."""


@dataclass(frozen=True, slots=True, eq=False)
class _Recurrence:
    """The rule linearised: z_{j+1} = a_j z_j + r_j for n motions, closed after a period.

    ``forward`` (s, q, q, n) is a; ``inverse`` (s, q, q, n) what divides each source; ``weight`` (s, n) is
    theta and ``step`` (s, n) h.
    """

    forward: Array
    inverse: Array
    weight: Array
    step: Array

    def growth(self) -> Array:
        """(n,) factor by which a disturbance of the states grows in a period; below one they forget it."""
        product = self.forward
        while len(product) > 1:
            odd = product[2 * (len(product) // 2) :]
            pairs = _product(product[1::2], product[: 2 * (len(product) // 2) : 2])
            product = np.concatenate([pairs, odd])
        matrices = np.moveaxis(product[0], -1, 0)
        finite = np.isfinite(matrices).all(axis=(1, 2))
        growth = np.full(len(matrices), np.inf)
        growth[finite] = np.abs(np.linalg.eigvals(matrices[finite])).max(axis=1)
        return growth

    def gather(self, source: Array) -> Array:
        """(s, q, k, n) what sources of z' (s, q, k, n) bring from sample to sample."""
        late = np.roll(source, -1, axis=0)
        weight = self.weight[:, None, None]
        return np.asarray(self.step[:, None, None] * (source + weight * (late - source)))

    def solve(self, right: Array) -> Array:
        """(s, q, k, n) periodic solution; ``right`` (s, q, k, n) is what each step adds before division."""
        samples, size, columns, _ = right.shape
        right = _product(self.inverse, right)
        unit = np.eye(size)
        # blocks of samples in parallel, each with its own initial value, so that loops of Python are short
        length = next(divisor for divisor in range(int(samples**0.5), 0, -1) if samples % divisor == 0)
        blocks = samples // length
        forward = self.forward.reshape(blocks, length, *self.forward.shape[1:])
        sources = right.reshape(blocks, length, *right.shape[1:])
        # particular solutions, then homogeneous ones
        inside = np.zeros((length + 1, blocks, size, columns + size, right.shape[3]))
        inside[0, :, :, columns:] = unit[:, :, None]
        for j in range(length):
            inside[j + 1] = _product(forward[:, j], inside[j])
            inside[j + 1, :, :, :columns] += sources[:, j]
        path = np.zeros((blocks + 1, *inside.shape[2:]))
        path[0, :, columns:] = unit[:, :, None]
        for j in range(blocks):
            path[j + 1] = _product(inside[-1, j, :, columns:], path[j])
            path[j + 1, :, :columns] += inside[-1, j, :, :columns]
        average = inside[:-1].mean(axis=0)
        mean = _product(average[:, :, columns:], path[:-1])
        mean[:, :, :columns] += average[:, :, :columns]
        begin = _closing(path[-1], mean.mean(axis=0))
        starts = path[:-1, :, :columns] + _product(path[:-1, :, columns:], begin)
        solution = inside[:-1, :, :, :columns] + _product(inside[:-1, :, :, columns:], starts)
        return np.asarray(np.swapaxes(solution, 0, 1).reshape(right.shape))


def _closing(ends: Array, mean: Array) -> Array:
    """(q, k, n) initial value z that a period repeats; that of the smallest mean where states do not decay.

    ``ends`` and ``mean`` (q, k + q, n): after a period and over it, of each source from z = 0, then of each
    unit of z.
    """
    size = len(ends)
    ends, mean = np.moveaxis(ends, -1, 0), np.moveaxis(mean, -1, 0)
    bound = np.concatenate([np.eye(size) - ends[:, :, -size:], MIN_PERIOD_DECAY * mean[:, :, -size:]], axis=1)
    right = np.concatenate([ends[:, :, :-size], -MIN_PERIOD_DECAY * mean[:, :, :-size]], axis=1)
    good = np.isfinite(bound).all(axis=(1, 2))
    begin = np.full((len(right), size, right.shape[2]), np.nan)
    begin[good] = np.linalg.pinv(bound[good]) @ right[good]
    return np.moveaxis(begin, 0, -1)


def _product(matrix: Array, right: Array) -> Array:
    """(..., q, k, n) product of matrices (..., q, q, n) with (..., q, k, n)."""
    if matrix.shape[-2] == 1:
        return np.asarray(matrix * right)
    return np.asarray(np.sum(matrix[..., :, :, None, :] * right[..., None, :, :, :], axis=-3))


@dataclass(frozen=True, slots=True, eq=False)
class StateLoops:
    """Periodic states along n motions.

    Parameters
    ----------
    states, rates
        (q, n, s) z and its derivative by time; NaN where the loop does not close.
    by_parameter
        (p, q, n, s).
    """

    states: Array
    rates: Array
    by_parameter: Array
    _recurrence: _Recurrence
    _by_motion: tuple[Array, Array]

    def perturb(self, dx: Array, dv: Array) -> Array:
        """(q, n, d, s) change of the states for a change of the motion, dx (d, s) and dv (n, d, s)."""
        by_x, by_v = self._by_motion
        source = by_x[:, :, None] * dx + by_v[:, :, None] * dv
        right = self._recurrence.gather(np.transpose(source, (3, 0, 2, 1)))
        return np.asarray(np.transpose(self._recurrence.solve(right), (1, 3, 2, 0)))


def close_loops(
    equations: Sequence[SwitchedSum],
    motion: tuple[Array, Array, Array],
    step: Array,
    values: Sequence[Any] | Array,
    powers: Sequence[int] = (),
) -> StateLoops:
    """Find the periodic states along n motions and their derivatives; arguments as of ``periodic_states``."""
    states = periodic_states(equations, motion, step, values, powers)
    rate, slopes = _rates(equations, motion, states, step, values)
    recurrence = _linearised(slopes[:, 2 : 2 + len(states)], np.broadcast_to(step, motion[0].shape))
    source = np.transpose(slopes[:, 2 + len(states) :], (3, 0, 1, 2))
    moved = recurrence.solve(recurrence.gather(source))
    by_parameter = np.transpose(moved, (2, 1, 3, 0))
    return StateLoops(states, rate, by_parameter, recurrence, (slopes[:, 0], slopes[:, 1]))


def periodic_states(
    equations: Sequence[SwitchedSum],
    motion: tuple[Array, Array, Array],
    step: Array,
    values: Sequence[Any] | Array,
    powers: Sequence[int] = (),
) -> Array:
    """(q, n, s) periodic states along n motions; NaN where a loop does not close, or is unstable.

    Parameters
    ----------
    equations
        g of every state z, in x, v, z.
    motion
        Displacement [m], velocity [m/s] and acceleration [m/s^2], each (n, s), over one period.
    step
        Interval to the next sample [s], broadcast to (n, s).
    values
        (p,) of the parameters, or arrays (n, 1) or (n, s).
    powers
        Places of parameters that stand in powers of a state.
    """
    count, samples = motion[0].shape
    begin = np.zeros((count, len(equations) * samples))
    steepest = max((float(np.max(values[place], initial=0.0)) for place in powers), default=0.0)
    # Newton's steps from rest to the loop of a steep power are many; from that of a milder one they are few
    for most in (*(power for power in _POWERS_SOLVED_FIRST if power < steepest), np.inf):
        some = [np.minimum(value, most) if i in powers else value for i, value in enumerate(values)]
        loops = _OpenLoops(equations, motion, np.broadcast_to(step, (count, samples)), some)
        # a whole step from rest may lead to where a power is steep, and to a loop of the rule alone
        roots = newton(loops, begin, halvings=2 * MAX_STEP_HALVINGS)
        begin = np.where(roots.last_step[:, None] <= CONVERGED_STEP, roots.unknowns, 0.0)
    recurrence = loops.lack(np.arange(count), roots.unknowns)[1]
    # growth within a single step comes from a corner of the law there
    corner = np.maximum(np.einsum("siin->sin", recurrence.forward) - 1, 0).max(axis=(0, 1))
    roots.unknowns[
        ~(roots.last_step <= CONVERGED_STEP) | (recurrence.growth() > 1 + RESIDUAL_TOLERANCE + corner)
    ] = np.nan
    return np.moveaxis(roots.unknowns.reshape(count, len(equations), samples), 1, 0)


_POWERS_SOLVED_FIRST = (8.0, 512.0)
"""Of a state: Newton's method finds the loop of the first from rest in some ten steps, and the next one from
there in few; with a power of 50 it takes a hundred from rest."""

MIN_NEWTON_STEPS = 3
"""Newton steps after which the growth of a disturbance is that of the loop."""

MAX_GROWTH = 10.0
"""Growth of a disturbance in a period beyond which Newton's method ends: the loop is unstable."""


@dataclass(slots=True, eq=False)
class _OpenLoops:
    """The closure of n loops as problems of Newton's method; the unknowns (n, q s) are their states."""

    equations: Sequence[SwitchedSum]
    motion: tuple[Array, Array, Array]
    interval: Array
    values: Sequence[Any] | Array
    steps_done: int = 0
    stored: tuple[Array, ...] = ()
    """Of every loop the last place (q s, n), what steps lack there, and the rule linearised there."""

    def lack(self, rows: Indices, unknowns: Array) -> tuple[Array, _Recurrence]:
        """(s, q, k) what each step from sample to sample lacks, and the rule linearised there.

        Newton's method asks for all loops at first. A step that was tried is the place of the next one: only
        loops that are elsewhere by now are evaluated.
        """
        new = np.any(self.stored[0][:, rows] != unknowns.T, axis=0) if self.stored else rows >= 0
        if new.any() or not self.stored:
            lack, rule = self._lack(rows[new], unknowns[new])
            parts = unknowns[new].T, lack, rule.forward, rule.inverse, rule.weight, rule.step
            if len(lack.T) == len(self.interval):
                self.stored = parts
            for array, part in zip(self.stored, parts, strict=True):
                array[..., rows[new]] = part
        lack, *linear = (array[..., rows] for array in self.stored[1:])
        return lack, _Recurrence(*linear)

    def _lack(self, rows: Indices, unknowns: Array) -> tuple[Array, _Recurrence]:
        x, v, a = (part[rows] for part in self.motion)
        values = [value if np.ndim(value) == 0 else value[rows] for value in self.values]
        step = self.interval[rows]
        # of an empty batch -1 would be no number of states
        states = np.moveaxis(unknowns.reshape(len(x), len(self.equations), x.shape[1]), 1, 0)
        rate, slopes = _rates(self.equations, (x, v, a), states, step, values, by_parameters=False)
        recurrence = _linearised(slopes[:, 2:], step)
        gain = recurrence.gather(np.transpose(rate, (2, 0, 1))[:, :, None])[:, :, 0]
        before = np.transpose(states, (2, 0, 1))
        return gain - (np.roll(before, -1, axis=0) - before), recurrence

    def residual(self, rows: Indices, unknowns: Array) -> Array:
        """(k, q s)."""
        return self.lack(rows, unknowns)[0].T.reshape(unknowns.shape)

    def step(self, rows: Indices, unknowns: Array) -> tuple[Array, Array, Array]:
        """Newton's step, with the relative size of the worst state; NaN where the loop is unstable."""
        lack, recurrence = self.lack(rows, unknowns)
        change = recurrence.solve(lack[:, :, None])[:, :, 0].T
        with np.errstate(all="ignore"):
            largest = np.abs(unknowns.reshape(change.shape) + change).max(axis=2)
            missing = np.maximum(
                np.abs(change).max(axis=2), np.abs(lack.T).max(axis=2) * (CONVERGED_STEP / RESIDUAL_TOLERANCE)
            )
            size = np.where(missing > 0, missing / largest, missing)
        if self.steps_done >= MIN_NEWTON_STEPS:
            change[recurrence.growth() > MAX_GROWTH] = np.nan
        self.steps_done += 1
        return lack.T.reshape(unknowns.shape), change.reshape(unknowns.shape), size.max(axis=1)


def _rates(
    equations: Sequence[SwitchedSum],
    motion: tuple[Array, Array, Array],
    states: Array,
    step: Array,
    values: Sequence[Any] | Array,
    *,
    by_parameters: bool = True,
) -> tuple[Array, Array]:
    """g (q, n, s) and its slopes (q, 2 + q + p, n, s) by x, v, states, parameters."""
    x, v, a = motion
    # switches in z are sharp: their share of a step would depend on the rate that is being solved for
    sharp = np.zeros_like(states)
    results = [
        equation((x, v, *states), (v, a, *sharp), step, values, by_parameters=by_parameters)
        for equation in equations
    ]
    return np.stack([g for g, *_ in results]), np.stack([np.stack(slopes) for _, *slopes in results])


def _linearised(jacobian: Array, step: Array) -> _Recurrence:
    """Linearise the rule; ``jacobian`` (q, q, n, s) is dg/dz, ``step`` (n, s) [s]."""
    size = len(jacobian)
    slope = np.transpose(jacobian, (3, 0, 1, 2))
    decay = np.abs(slope).sum(axis=2).max(axis=1)
    step = step.T
    between = step * (decay + np.roll(decay, -1, axis=0)) / 2
    weight = _weight(between)
    share = (weight * step)[:, None, None]
    unit = np.eye(size)[:, :, None]
    late = unit - share * np.roll(slope, -1, axis=0)
    early = unit + (step[:, None, None] - share) * slope
    with np.errstate(all="ignore"):
        inverse = 1 / late if size == 1 else np.moveaxis(_inverted(np.moveaxis(late, -1, 1)), 1, -1)
    return _Recurrence(_product(inverse, early), inverse, weight, step)


def _inverted(matrices: Array) -> Array:
    """Invert; singular ones and those that are not finite give NaN."""
    finite = np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))
    good = finite & (np.linalg.det(np.where(finite[..., None, None], matrices, 0.0)) != 0)
    inverse = np.full_like(matrices, np.nan)
    inverse[good] = np.linalg.inv(matrices[good])
    return inverse


MIN_DECAY = 1e-2
"""Smallest decay in a step at which theta follows from its formula, else from its series."""


def _weight(decay: Array) -> Array:
    """Theta from the decay in a step, 1/2 to 1."""
    with np.errstate(all="ignore"):
        theta = -1 / np.expm1(-decay) - 1 / decay
    return np.where(decay < MIN_DECAY, 0.5 + decay / 12, theta)


@dataclass(frozen=True, slots=True, eq=False)
class Loops:
    """A compiled law with memory, f(x, v, z; p) and its memories."""

    _force: SwitchedSum
    _equations: tuple[SwitchedSum, ...]
    _powers: tuple[int, ...]
    _virgins: tuple[SwitchedSum, ...]
    _lags: bool

    @np.errstate(over="ignore", invalid="ignore")  # what overflows is not finite
    def states(self, motion: tuple[Array, Array, Array], step: Array, values: Array) -> Array:
        """(r, n, s) states with equations along whole periods (n, s)."""
        return periodic_states(self._equations, motion, step, values, self._powers)

    @np.errstate(over="ignore", invalid="ignore")
    def sample(self, x: Array, v: Array, a: Array, step: Array, values: Sequence[Any] | Array) -> ForceSample:
        """Evaluate the closed loop along whole periods (n, s); see ``ForceLaw.sample``."""
        step = np.broadcast_to(step, (len(x), 1))
        memory, rates = list[Array](), list[Array]()
        moved, perturb = list[Sequence[Array]](), list[tuple[int, Perturbation]]()
        if self._equations:
            loops = close_loops(self._equations, (x, v, a), step, values, self._powers)
            memory += list(loops.states)
            rates += list(loops.rates)
            moved += [list(loops.by_parameter[:, i]) for i in range(len(loops.states))]
            perturb.append((len(loops.states), loops.perturb))
        if self._virgins:
            reversals = find_reversals(x, v, a, step)
        for virgin in self._virgins:
            loop = Loop(virgin, x, v, step, values, reversals)
            memory.append(loop.force)
            rates.append(loop.slope * v)
            moved.append(loop.by_parameter)
            perturb.append((1, loop.perturb))
        if self._lags:
            memory.append(_quarter_later(x))
            rates.append(_quarter_later(v))
            moved.append([])
            perturb.append((1, lambda dx, dv: np.broadcast_to(_quarter_later(dx), (1, *dv.shape))))
        sums = self._force((x, v, *memory), (v, a, *rates), step, values)
        by_parameter = list(sums[3 + len(memory) :])
        for slope, changes in zip(sums[3:], moved, strict=False):
            for i, change in enumerate(changes):
                by_parameter[i] = by_parameter[i] + slope * change
        by_memory, first = [], 3
        for count, perturbation in perturb:
            by_memory.append((np.stack(sums[first : first + count]), perturbation))
            first += count
        return ForceSample(sums[0], sums[1], sums[2], tuple(by_parameter), tuple(by_memory))


def _quarter_later(signal: Array) -> Array:
    """(..., s) every harmonic a quarter of its period later, without the mean."""
    samples = signal.shape[-1]
    spectrum = np.fft.rfft(signal) * 1j
    spectrum[..., 0] = 0
    if samples % 2 == 0:
        spectrum[..., -1] = 0
    return np.asarray(np.fft.irfft(spectrum, samples))


@lru_cache(maxsize=256)
def compile_loops(form: MemoryForm, parameters: tuple[str, ...]) -> Loops:
    """Compile a law with memory for arrays, once; parameters in the order of every value array."""
    states, names = (symbol("x"), symbol("v")), tuple(map(symbol, parameters))
    inner = tuple(rate.symbol for rate in form.rates)
    steep = [one.exp for rate in form.rates for one in rate.rate.atoms(sympy.Pow) if one.base.has(*inner)]
    return Loops(
        switched_sum(form.force, (*states, *form.states), names),
        tuple(switched_sum(defined_at_zero(rate.rate), (*states, *inner), names) for rate in form.rates),
        tuple(place for place, name in enumerate(names) if any(exponent.has(name) for exponent in steep)),
        tuple(switched_sum(real_powers(curve.virgin), states[:1], names) for curve in form.curves),
        form.lag is not None,
    )
