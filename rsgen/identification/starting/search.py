"""Global search of the parameters in which a law is not linear, over all ranges in which they matter.

For given nonlinear parameters the others follow by linear least squares (variable projection: Golub and
Pereyra, Inverse Problems 19, 2003), so that only q of them, mostly one to three, are searched: a low-
discrepancy sample (Halton) of their windows, and descents from the best. A group whose common factor the law
is linear in (the stiffness and the force of a saturation) is searched by its ratios: one of the group is plus
or minus one, and the factor is solved for.

A window is the range of a parameter in which the shape of a term changes along the measured motion; outside,
the term is another law (a gap that is never reached). Of a law with memory it is ``DECADES`` decades on both
sides of the natural size. A single parameter is tried all along its window. In this order
(``search_nonlinear``):

1. From values near the solution (``begin``) only a descent.
2. Trials over all windows on a few points; linear parameters, factors and mass are solved for in each.
3. Descents in the logarithms from the best trials that are no neighbours. With more than one parameter also
   from where ``_SCANS`` scans lead, each along one parameter after the other. A law with memory and
   several free parameters has ``STARTS`` a parameter, which descend on few points first; the best go on.
4. Of solutions that fit equally one whose linear columns depend on each other more than those of the best (a
   null space with one more dimension, at least), such as a gap that is not reached: it shows what the test
   does not determine. Candidates are the trials of step 2 that fit equally on their few points, and the best
   with one parameter at an end of its window, where its switch hardly acts (``_inactive_switch_trials``).
   They are asked in the order of their negative signs, fewest first, and then of their largest
   absolute value, smallest first; the first that fits is taken (``least_determined``).
5. Negative signs of it are turned one by one, where that fits equally (``with_signs_turned``).
6. Values of more than ten times their ``natural`` size, at which a parameter acts along the largest motion,
   become ten times it, where that fits equally (``near_the_motion``).
7. If one is still negative: the first equal end of descents from the best trials of which all values are
   positive. This end is not bounded as in step 6.
8. Groups are multiplied by their factors (``scaled``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import product

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.solvers import solve_scaled
from rsgen.common.tolerances import MIN_SIGNIFICANT_GAIN, MISFIT_NEGLIGIBLE, NONLINEAR_TRIALS
from rsgen.identification.starting.equations import Equations, equation_rows, known_rows, rows_of_trials
from rsgen.law.numeric import DECADES, ForceLaw, natural_sizes

_MIN_SHAPE_CHANGE = 1e-3
"""Relative change of a column between two values of a parameter from which on the parameter is active."""

_ROUND_OFF_STEP = 1e-7
"""Relative change of a value whose effect on a column is round-off."""

_MAX_LOG_CHANGE = 3.0
"""Change of the logarithm of a parameter in a descent."""

_SIMULATOR_MISFIT = 1e-6
"""Relative misfit by errors of a simulator; forces as small are no part of a law."""

_FINE_STARTS = 2
"""Coarse descents that are continued with all points."""

_MAX_COLUMN = 1e100
"""Larger columns are about to overflow: the trial is no candidate."""

_COARSE_POINTS = 32
"""Points on which trials are compared."""

_SCANS = 2
"""Scans over all parameters one by one."""

_WINDOW_STRIDE = 2
"""Step between the tried values of a window."""

_DECADES_OF_WINDOW = 14
"""Decades of SI units on both sides of one in which a law may change its shape."""

STARTS = 4
"""Best trials, none a neighbour of a better one, from which a search descends. For a law with memory so many
a parameter: with four equal sliders every third trial leads to the solution, sixteen miss it once in a
thousand."""


def search_nonlinear(equations: Equations, law: ForceLaw, mass: float, begin: Array | None) -> Array:
    """Search all nonlinear parameters of a law.

    Parameters
    ----------
    equations, law, mass
        Data and model; m [kg] is NaN if it is free.
    begin
        Values near the solution; None, or a value that is zero or not finite, searches all windows.

    Returns
    -------
    Array
        (count,) values in the order of ``law.nonlinear``. Of equal solutions one whose switches do not act,
        because its null space shows what the test does not determine, and with positive values where one fits
        as well.
    """
    search = _Search(equations, law, mass)
    if begin is not None and np.all(np.isfinite(begin) & (begin != 0)):
        return search.scaled(search.refine(search.normalised(begin))[0])
    windows = [search.admitted(i) for i in range(len(law.nonlinear))]
    # forces, stiffnesses and lengths are positive, but of trials with random signs only one in 2^q is
    positive = NONLINEAR_TRIALS // 2 if law.remembers else 0
    trials = _spread_trials(windows, NONLINEAR_TRIALS, positive=positive)
    costs = search.costs(trials)
    ordered = trials[np.argsort(costs, kind="stable")]
    best = search.lowest_end(ordered, windows)
    near = trials[costs <= _equal_cost(search.residual(best, coarse=True))]
    equals = _EqualTrials(search, best)
    best = equals.least_determined(
        best, [*near, *_inactive_switch_trials(best, windows, search.unit_members)]
    )
    dimension = search.null_dimension(best)
    best = equals.with_signs_turned(best, dimension)
    best = equals.near_the_motion(best)
    if (best < 0).any():
        # a gap and a saturation with signs and thresholds exchanged are one law
        ends = (search.refine(start)[0] for start in _separate(ordered[np.all(ordered > 0, axis=1)], STARTS))
        best = equals.first(ends, dimension, best)
    return search.scaled(best)


class _EqualTrials:
    """Trials that fit as well as the best one, of which the test tells none from another."""

    def __init__(self, search: _Search, best: Array) -> None:
        self._search, self._most = search, _equal_cost(search.residual(best))

    def first(self, trials: Iterable[Array], dimension: int, otherwise: Array) -> Array:
        """Return the first trial that fits as well and leaves so many dimensions, at least, undetermined."""
        search = self._search
        equal = (t for t in trials if search.null_dimension(t) >= dimension and search.cost(t) <= self._most)
        return next(equal, otherwise)

    def least_determined(self, best: Array, candidates: Sequence[Array]) -> Array:
        """Return the first candidate with one more undetermined dimension: its switches do not act.

        The fewest negative signs come first, then the smallest values.
        """
        ordered = sorted(candidates, key=lambda trial: (np.sum(trial < 0), np.abs(trial).max()))
        return self.first(ordered, self._search.null_dimension(best) + 1, best)

    def with_signs_turned(self, best: Array, dimension: int) -> Array:
        """Turn negative signs one by one: tanh(v/w) with a factor, a gap and a spring have two signs."""
        for place in np.flatnonzero(best < 0):
            trial = np.array(best)
            trial[place] = -trial[place]
            # refining may lead to where a switch acts again
            best = self.first((self._search.refine(trial)[0], trial), dimension, best)
        return best

    def near_the_motion(self, best: Array) -> Array:
        """Bound values by ten times their ``natural`` size: a gap beyond it is equal but for round-off."""
        for place in self._search.free:
            trial = np.array(best)
            trial[place] = np.sign(best[place]) * 10 * self._search.natural[place]
            if abs(best[place]) > abs(trial[place]):
                best = self.first((trial,), 0, best)
        return best


def _inactive_switch_trials(best: Array, windows: list[Array], unit_members: list[int]) -> list[Array]:
    """Return trials with one parameter at an end of its window, where its switch hardly acts.

    They are made of the best, and of the best with positive ``unit_members``, which itself is the first.
    Where such a trial fits as well, the test does not show the switch.
    """
    positive = np.array(best)
    positive[unit_members] = 1.0
    trials = [positive]
    for start in (best, positive):
        for i, window in enumerate(windows):
            for value in (window.max(), window.min()):
                trials.append(np.array(start))
                trials[-1][i] = value
    return trials


def _equal_cost(residual: Array) -> float:
    """Return the sum of squares up to which another solution fits as well as the one with a residual."""
    count = len(residual)
    return float(residual @ residual) * (1 + MIN_SIGNIFICANT_GAIN / count) + count * _SIMULATOR_MISFIT**2


class _Search:
    """Residuals of trials; linear parameters and the factors of groups are solved for at each.

    A trial has a value of every nonlinear parameter. The last of each group (``unit_members``) is 1 or -1 in
    it; ``free`` are the others. "Coarse" is on few points with few samples a period, and ``natural`` are the
    sizes at which a parameter acts along the largest motion.
    """

    def __init__(self, equations: Equations, law: ForceLaw, mass: float) -> None:
        self._equations, self._law = equations, law
        self._known = np.append(np.full(len(law.linear) + len(law.scaled), np.nan), mass)
        some = np.unique(np.linspace(0, len(equations.omega) - 1, _COARSE_POINTS).round().astype(np.intp))
        self._scanned = equations.select(some)
        place = {which: i for i, which in enumerate(law.nonlinear)}
        self._groups = [[place[which] for which in group] for group in law.scaled]
        self.unit_members = [group[-1] for group in self._groups]
        self.free = [i for i in range(len(law.nonlinear)) if i not in self.unit_members]

        size, force = np.abs(equations.motions[-1][:, 1]), np.abs(equations.force)
        natural = natural_sizes(
            law, float(size.max()), float(np.median(equations.omega)), float(np.median(force))
        )
        self.natural = self.normalised(natural[list(law.nonlinear)])

    def normalised(self, values: Array) -> Array:
        """Divide every group by the size of its last parameter."""
        trial = np.array(values)
        for group in self._groups:
            trial[group] /= abs(trial[group[-1]])
        return trial

    def scaled(self, trial: Array) -> Array:
        """Multiply every group by its factor, at least a negligible positive one."""
        values = np.array(trial)
        if self._groups:
            matrix, right = self._rows(trial)
            solution, _ = self._solve_rows(matrix, right)
            effect = self._factors(np.sqrt(np.sum(matrix**2, axis=0)))
            least = _SIMULATOR_MISFIT * np.sqrt(np.sum(right**2)) / np.where(effect > 0, effect, 1.0)
            for group, factor in zip(self._groups, np.maximum(self._factors(solution), least), strict=True):
                values[group] *= factor
        return values

    def _factors(self, solution: Array) -> Array:
        first = len(self._law.linear)
        return solution[first : first + len(self._groups)]

    def _rows(self, trial: Array) -> tuple[Array, Array]:
        """Return the rows of all equations at a trial, without those of loops that do not close."""
        with np.errstate(all="ignore"):
            matrix, right = equation_rows(self._equations, self._law, trial, scaled=True)
        known = known_rows(matrix, right)
        return matrix[known], right[known]

    def _solve_rows(self, matrix: Array, right: Array) -> tuple[Array, Array]:
        """Return linear parameters, factors and mass, and the residual; NaN of loops that do not close."""
        known = known_rows(matrix, right)
        rows, wanted = matrix[known], right[known]
        # a negative power at x = 0, or an overflow
        if not (np.max(np.abs(rows), initial=0.0) < _MAX_COLUMN and np.max(np.abs(wanted)) < _MAX_COLUMN):
            return np.zeros(matrix.shape[1]), np.full(len(right), _MAX_COLUMN)
        solution = solve_scaled(rows, wanted, known=self._known)[0]
        for _ in self._groups:
            negative = np.flatnonzero(self._factors(solution) < 0) + len(self._law.linear)
            if not len(negative):
                break
            # factors must be positive: remove negative ones
            rows[:, negative] = 0.0
            solution = solve_scaled(rows, wanted, known=self._known)[0]
        residual = np.full(len(right), np.nan)
        residual[known] = wanted - rows @ solution
        return solution, residual

    def residuals(self, trials: Array, *, coarse: bool = False) -> Array:
        """Return the residual (k, r) of every equation at k trials; NaN of loops that do not close."""
        equations = self._scanned if coarse else self._equations
        with np.errstate(all="ignore"):
            rows = rows_of_trials(equations, self._law, trials, coarse=coarse)
        return np.stack([self._solve_rows(*row)[1] for row in rows])

    def residual(self, trial: Array, *, coarse: bool = False) -> Array:
        """Return the residual of every equation at a trial."""
        return _completed(self.residuals(trial[None], coarse=coarse)[0])

    def cost(self, trial: Array) -> float:
        """Return the sum of squares at a trial."""
        return float(np.sum(self.residual(trial) ** 2))

    def costs(self, trials: Array) -> Array:
        """Return the sums of squares at many trials, on few points with few samples."""
        return np.asarray(np.sum(_completed(self.residuals(trials, coarse=True)) ** 2, axis=1))

    def lowest_end(self, ordered: Array, windows: list[Array]) -> Array:
        """Return the best end of descents from trials that are no neighbours; of equal ones the first."""
        best: Array = ordered[0]
        lowest, several = self.cost(best), len(self.free) > 1
        if self._law.remembers and several:
            starts = self.coarse_ends(_separate(ordered, STARTS * len(self.free)))
        else:
            starts = _separate(ordered, STARTS)
        if several:
            # a few hundred trials are thin in two dimensions and more
            scanned = self.scan_one_by_one(starts[0], windows)
            starts += [] if np.array_equal(scanned, starts[0]) else [scanned]
        for start in starts:
            found, cost = self.refine(start)
            if cost < lowest * (1 - 1e-9):
                best, lowest = found, cost
        return best

    def scan_one_by_one(self, start: Array, windows: list[Array]) -> Array:
        """Minimise over one parameter after the other, along its whole window."""
        best = np.array(start)
        for _ in range(_SCANS):
            for i in self.free:
                values = windows[i][::_WINDOW_STRIDE]
                trials = np.repeat(best[None, :], len(values) + 1, axis=0)
                trials[1:, i] = values
                best = trials[int(np.argmin(self.costs(trials)))]
        return best

    def coarse_ends(self, starts: list[Array]) -> list[Array]:
        """Descend on few points; return the best ends that differ."""
        ends = sorted((self.refine(start, coarse=True) for start in starts), key=lambda end: end[1])
        different: list[tuple[Array, float]] = []
        for end in ends:
            if not different or end[1] > (1 + MISFIT_NEGLIGIBLE) * different[-1][1]:
                different.append(end)
        return [trial for trial, _ in different[:_FINE_STARTS]]

    def null_dimension(self, trial: Array) -> int:
        """Return the dimension of the null space of the linear parameters at a trial."""
        matrix, right = self._rows(trial)
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            return 0
        return int(solve_scaled(matrix, right, known=self._known)[2].shape[1])

    def _shapes(self, some: Equations, trials: Array, whole: bool) -> list[Array | None]:
        """Return columns of unit size at each trial; None if they are not finite or too large."""
        shapes: list[Array | None] = []
        with np.errstate(all="ignore"):
            for matrix, right in rows_of_trials(some, self._law, trials):
                columns = np.column_stack([matrix, right]) if whole else matrix
                norm = np.abs(columns).max(axis=0)
                finite = np.all(np.isfinite(norm)) and norm.max() < _MAX_COLUMN
                shapes.append(columns / np.where(norm > 0, norm, 1.0) if finite else None)
        return shapes

    def admitted(self, which: int) -> Array:
        """Return the ``active_values`` of one parameter with the signs that the law admits."""
        values = self.active_values(which)
        only = self._law.nonlinear[which] in self._law.positive and (values > 0).any()
        return values[values > 0] if only else values

    def active_values(self, which: int) -> Array:
        """Return values of one parameter between which the law changes its shape, of both signs."""
        if which in self.unit_members:
            return np.array([1.0, -1.0])
        if self._law.remembers and np.isfinite(self.natural[which]):
            motion = np.abs(self._equations.motions[-1][:, 1])
            # a slider may slip within the smallest motions
            smallest = max(motion.min(), 10.0 ** (-3 * DECADES) * motion.max())
            reach = max(DECADES, int(np.ceil(np.log10(motion.max() / smallest))))
            size = self.natural[which] * np.logspace(-reach, DECADES, 12 * (reach + DECADES) // 2 + 1)
            return np.concatenate([size, -size])
        some = self._equations
        some = some.select(np.linspace(0, len(some.omega) - 1, 8).round().astype(np.intp))
        motion = self._equations.motions[-1]
        largest = float(np.abs(motion).max())
        speed = largest * float(np.median(self._equations.omega))
        stiffness = float(np.max(np.abs(self._equations.force / motion[:, 1])))
        typical = [largest, 1.0, stiffness, 1 / largest, speed]
        chosen = self._changing(some, which, typical, whole=False)
        if not len(chosen):
            # a force without a linear parameter is on the right side
            chosen = self._changing(some, which, typical, whole=True)
        if not len(chosen):
            return np.array(typical[:1])
        dense = []
        for sign in (1.0, -1.0):
            part = np.abs(chosen[chosen * sign > 0])
            if len(part):
                dense.append(sign * np.geomspace(part.min(), part.max(), 6 * len(part) + 1))
        return np.concatenate(dense)

    def _changing(self, some: Equations, which: int, typical: list[float], *, whole: bool) -> Array:
        """Return the values (k,) on a logarithmic grid at which the shape of a column changes.

        With others at a few ``typical`` sizes, since a term may act only if they do. ``whole``: the right
        side counts as well.
        """
        generator = np.random.default_rng(which)
        size = np.logspace(-_DECADES_OF_WINDOW, _DECADES_OF_WINDOW, 2 * _DECADES_OF_WINDOW * 3 + 1)
        values = np.concatenate([size, -size])
        active = np.zeros(len(values), dtype=bool)
        for attempt in typical[:1] if len(self.free) == 1 else typical:
            others = np.full(len(self._law.nonlinear), attempt * generator.uniform(0.3, 0.7))
            others[self.unit_members] = 1.0
            trials = np.repeat(others[None, :], len(values), axis=0)
            trials[:, which] = values
            shapes = self._shapes(some, trials, whole)
            moved = [i for i in range(1, len(values)) if i != len(size) and _differ(shapes[i], shapes[i - 1])]
            trials[:, which] *= 1 + _ROUND_OFF_STEP
            for i, again in zip(moved, self._shapes(some, trials[moved], whole), strict=True):
                # a change of the shape by a tiny step is round-off
                active[i] |= again is not None and not _differ(shapes[i], again)
        active |= np.concatenate([active[1:], [False]])  # both ends of an active interval
        if np.isfinite(self.natural[which]):
            # a sum of the motion and a value far beyond it is the round-off of the motion
            active &= np.abs(values) * _ROUND_OFF_STEP < self.natural[which]
        return values[active]

    def refine(self, start: Array, *, coarse: bool = False) -> tuple[Array, float]:
        """Descend from one trial in the logarithms of the parameters; signs are kept."""
        residuals = partial(self.residuals, coarse=coarse)
        return _descend(residuals, start, self.free, to=1e-6 if coarse else 1e-10)


def _differ(shape: Array | None, other: Array | None) -> bool:
    """Return True if two shapes are known and differ."""
    if shape is None or other is None:
        return False
    return bool(np.max(np.abs(np.abs(shape) - np.abs(other))) > _MIN_SHAPE_CHANGE)


def _spread_trials(windows: Sequence[Array], count: int, *, positive: int = 0) -> Array:
    """Return all values of one parameter, or a Halton sample of several, the first of them positive."""
    if sum(len(window) > 2 for window in windows) <= 1:
        return np.array(list(product(*windows)))
    from scipy.stats import qmc

    points = qmc.Halton(len(windows), seed=1).random(count)
    places = zip(windows, points.T, strict=True)
    trials = np.stack([window[(part * len(window)).astype(np.intp)] for window, part in places], axis=1)
    trials[:positive] = np.abs(trials[:positive])
    return trials


def _completed(residuals: Array) -> Array:
    """Return residuals (..., r) in which a loop that does not close is as far off as the others are."""
    typical = np.sqrt(np.nanmean(residuals**2, axis=-1, keepdims=True))
    return np.where(np.isnan(residuals), typical, residuals)


def _descend(
    residuals: Callable[[Array], Array], start: Array, free: Sequence[int], *, to: float = 1e-10
) -> tuple[Array, float]:
    """Descend in the logarithms of the free parameters; return the end, and its sum of squares.

    ``to`` is the relative change of the parameters at which it ends, or after 25 steps; signs are kept. All
    differences of a step are asked of ``residuals`` at once, for speed; where a loop does not close they are
    zero.
    """
    from scipy.optimize import least_squares

    if not free:
        return start, float(np.sum(_completed(residuals(start[None])) ** 2))

    # where a switch does not act the cost is flat, and steps are unlimited
    begin = np.log(np.abs(start[free]))
    low, high = begin - _MAX_LOG_CHANGE, begin + _MAX_LOG_CHANGE

    def at(logs: Array) -> Array:
        trials = np.tile(start, (len(logs), 1))
        trials[:, free] = np.sign(start[free]) * np.exp(np.clip(logs, low, high))
        return trials

    def left(logs: Array) -> Array:
        return _completed(residuals(at(logs[None]))[0])

    def slopes(logs: Array) -> Array:
        steps = 1e-5 * np.where(logs == 0, 1.0, logs)
        here, *there = residuals(at(logs + np.vstack([0 * steps, np.diag(steps)])))
        return np.asarray(np.nan_to_num((np.stack(there) - here).T / steps))

    result = least_squares(left, begin, jac=slopes, x_scale=0.1, max_nfev=25, xtol=to)
    return at(result.x[None])[0], float(2 * result.cost)


def search_values(residual: Callable[[Array], Array], windows: Sequence[Array], count: int) -> Array:
    """Search parameters in their windows by descents from the best of ``count`` trials."""

    def residuals(trials: Array) -> Array:
        return np.stack([residual(trial) for trial in trials])

    trials = _spread_trials(windows, count)
    costs = np.sum(residuals(trials) ** 2, axis=1)
    starts = _separate(trials[np.argsort(costs, kind="stable")], STARTS)
    free = range(len(windows))
    return min((_descend(residuals, start, free) for start in starts), key=lambda end: end[1])[0]


def _separate(ordered: Array, most: int) -> list[Array]:
    """Return the best trials that are not neighbours of a better one: all values within 15 %, of one sign."""
    ends: list[Array] = []
    for trial in ordered:
        near = any(
            np.all(np.abs(np.log(np.abs(trial / other))) < 0.15) and np.all(trial * other > 0)
            for other in ends
        )
        if not near:
            ends.append(trial)
        if len(ends) == most:
            break
    return ends
