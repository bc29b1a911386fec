"""Search of the parameters in which a law is not linear, over the whole range in which they change it.

A group of them whose common factor the law is linear in (the stiffness and the force of a saturation) is
searched by its ratios only: one of the group stays at plus or minus one, the factor is solved for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import product

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.linear_algebra import solve_scaled
from rsgen.common.tolerances import SIGNIFICANT, TRIALS, UNCHANGED
from rsgen.identification.starting.equations import Equations, equation_rows, rows_of_trials
from rsgen.law.numeric import DECADES, ForceLaw, natural_sizes

_CHANGED = 1e-3
"""A law changes its shape where a column changes by more, relatively, from one value to the next."""

_TINY = 1e-7
"""Relative change of a value that changes no shape: what it changes as much is round-off."""

_WANDER = 3.0
"""How far a descent may lead from its start, as a logarithm."""

_SOLVER = 1e-6
"""Relative misfit that the simulator may leave; a part of the force as small is as good as none."""

_FOLLOWED = 4
"""Trials of a law with memory that are followed on few points, a parameter that is searched: of four equal
sliders every third trial leads to the solution, so that sixteen miss it once in a thousand times."""

_POSITIVE = TRIALS // 2
"""Trials of a law with memory in which all is positive, as forces, stiffnesses and lengths are. With
all signs one of 2^q trials of q parameters would be, and the solution of LuGre's law is missed."""

_POLISHED = 2
"""Ends of these that are followed on with all points."""

_HUGE = 1e100
"""Columns beyond this are an overflow in the making: the trial is no candidate."""

_SCANNED = 32
"""Points on which trials are compared: what differs there by less than noise is followed on more."""

_EVERY = 2
"""Of the values of a window, so many lie from one that is tried to the next."""

_SWEEPS = 2
"""Sweeps over all parameters one by one, along every other value: the second sees what the first moved."""

_WIDEST = 14
"""Decades of SI units to both sides of one in which a law may change its shape."""

_ENDS = 4
"""Best trials, none a neighbour of a better one, from which a search descends."""


def search_nonlinear(equations: Equations, law: ForceLaw, mass: float, begin: Array | None) -> Array:
    """Search all nonlinear parameters of a law.

    Parameters
    ----------
    equations, law, mass
        What is solved; m [kg] is NaN where it is free.
    begin
        Values that lead to the solution; None searches the whole range.

    Returns
    -------
    Array
        (count,) values. Of solutions that fit alike the one whose switches do not act is taken, so that it
        shows what the test does not tell; else the one with positive values.
    """
    search = _Search(equations, law, mass)
    if begin is not None and np.all(np.isfinite(begin) & (begin != 0)):
        return search.scaled(search.polish(search.pinned(begin))[0])
    windows = [search.admitted(i) for i in range(len(law.nonlinear))]
    trials = _spread_trials(windows, TRIALS, positive=_POSITIVE if law.remembers else 0)
    costs = search.costs(trials)
    order = np.argsort(costs, kind="stable")
    best = trials[order[0]]
    lowest = search.cost(best)
    if law.remembers and len(search.free) > 1:
        starts = search.followed(_distinct(trials[order], _FOLLOWED * len(search.free)))
    else:
        starts = _distinct(trials[order], _ENDS)
    if len(search.free) > 1:
        # a few hundred trials are thin in two dimensions and more
        starts.append(search.along(starts[0], windows))
    for start in starts:
        found, cost = search.polish(start)
        if cost < lowest * (1 - 1e-9):
            best, lowest = found, cost
    rest = search.residual(best, coarse=True)
    candidates = [
        *trials[costs <= _as_good(float(rest @ rest), len(rest))],
        *_idle(best, windows, search.pins),
    ]
    missing, equal = search.missing(best), _as_good(lowest, len(search.residual(best)))
    for trial in sorted(candidates, key=lambda trial: (np.sum(trial < 0), np.abs(trial).max())):
        # as good without the switch ever acting: then the test does not tell it, and no number is to be found
        if search.missing(trial) > missing and search.cost(trial) <= equal:
            best = trial
            break
    missing = search.missing(best)
    for i in np.flatnonzero(best < 0):
        # tanh(v/w) with a factor, a gap beside a spring: the same law has two signs
        trial = np.array(best)
        trial[i] = -trial[i]
        # where the test says nothing of a parameter, polishing may lead to where a switch acts again
        for found in (search.polish(trial)[0], trial):
            if search.cost(found) <= equal and search.missing(found) >= missing:
                best = found
                break
    if (best < 0).any():
        # a gap and a saturation with signs turned and thresholds exchanged are the same law again
        upright = trials[order][np.all(trials[order] > 0, axis=1)]
        for start in _distinct(upright, _ENDS):
            found = search.polish(start)[0]
            if search.cost(found) <= equal and search.missing(found) >= missing:
                best = found
                break
    return search.scaled(best)


def _idle(best: Array, windows: list[Array], pins: list[int]) -> list[Array]:
    """Put one parameter after the other to the ends of its window, where its switch hardly acts."""
    upright = np.array(best)
    upright[pins] = 1.0
    trials = [upright]
    for start in (best, upright):
        for i, window in enumerate(windows):
            for value in (window.max(), window.min()):
                trials.append(np.array(start))
                trials[-1][i] = value
    return trials


def _as_good(cost: float, count: int) -> float:
    return cost * (1 + SIGNIFICANT / count) + count * _SOLVER**2


class _Search:
    """Residuals of trials; linear parameters and the factors of groups are solved for at each."""

    def __init__(self, equations: Equations, law: ForceLaw, mass: float) -> None:
        self._equations, self._law = equations, law
        self._known = np.append(np.full(len(law.linear) + len(law.scaled), np.nan), mass)
        some = np.unique(np.linspace(0, len(equations.omega) - 1, _SCANNED).round().astype(np.intp))
        self._scanned = equations.select(some)
        place = {which: i for i, which in enumerate(law.nonlinear)}
        self._groups = [[place[which] for which in group] for group in law.scaled]
        self.pins = [group[-1] for group in self._groups]
        self.free = [i for i in range(len(law.nonlinear)) if i not in self.pins]

        size, force = np.abs(equations.motions[-1][:, 1]), np.abs(equations.force)
        natural = natural_sizes(
            law, float(size.max()), float(np.median(equations.omega)), float(np.median(force))
        )
        self._natural = self.pinned(natural[list(law.nonlinear)])

    def pinned(self, values: Array) -> Array:
        """Divide every group by the size of the one that stays."""
        trial = np.array(values)
        for group in self._groups:
            trial[group] /= abs(trial[group[-1]])
        return trial

    def scaled(self, trial: Array) -> Array:
        """Multiply every group by its factor; one that would not be positive is as good as none."""
        values = np.array(trial)
        if self._groups:
            solution, _ = self._solve(self._equations, trial, coarse=False)
            matrix, right = equation_rows(self._equations, self._law, trial, scaled=True)
            effect = self._factors(np.sqrt(np.sum(matrix**2, axis=0)))
            least = _SOLVER * np.sqrt(np.sum(right**2)) / np.where(effect > 0, effect, 1.0)
            for group, factor in zip(self._groups, np.maximum(self._factors(solution), least), strict=True):
                values[group] *= factor
        return values

    def _factors(self, solution: Array) -> Array:
        first = len(self._law.linear)
        return solution[first : first + len(self._groups)]

    def _solve(self, equations: Equations, trial: Array, *, coarse: bool) -> tuple[Array, Array]:
        """Linear parameters, factors, mass; and what they leave."""
        with np.errstate(all="ignore"):
            matrix, right = equation_rows(equations, self._law, trial, scaled=True, coarse=coarse)
        return self._settle(matrix, right)

    def _settle(self, matrix: Array, right: Array) -> tuple[Array, Array]:
        # not finite, or soon: a negative power at x = 0, an overflow
        if not (np.max(np.abs(matrix), initial=0.0) < _HUGE and np.max(np.abs(right)) < _HUGE):
            return np.zeros(matrix.shape[1]), np.full(len(right), _HUGE)
        solution = solve_scaled(matrix, right, known=self._known)[0]
        for _ in self._groups:
            negative = np.flatnonzero(self._factors(solution) < 0) + len(self._law.linear)
            if not len(negative):
                break
            # of degree one for positive factors only
            matrix[:, negative] = 0.0
            solution = solve_scaled(matrix, right, known=self._known)[0]
        return solution, np.asarray(right - matrix @ solution)

    def residual(self, trial: Array, *, coarse: bool = False) -> Array:
        """Misfit of every equation at a trial."""
        return self._solve(self._scanned if coarse else self._equations, trial, coarse=coarse)[1]

    def cost(self, trial: Array, *, coarse: bool = False) -> float:
        """Sum of squares at a trial."""
        return float(np.sum(self.residual(trial, coarse=coarse) ** 2))

    def costs(self, trials: Array) -> Array:
        """Sum of squares at many trials, on few points with few samples."""
        with np.errstate(all="ignore"):
            rows = rows_of_trials(self._scanned, self._law, trials, coarse=True)
        return np.array([float(np.sum(self._settle(*each)[1] ** 2)) for each in rows])

    def along(self, start: Array, windows: list[Array]) -> Array:
        """Take the best of every other value of one parameter after the other over its whole window."""
        best = np.array(start)
        for _ in range(_SWEEPS):
            for i in self.free:
                values = windows[i][::_EVERY]
                trials = np.repeat(best[None, :], len(values) + 1, axis=0)
                trials[1:, i] = values
                best = trials[int(np.argmin(self.costs(trials)))]
        return best

    def followed(self, starts: list[Array]) -> list[Array]:
        """Follow trials downhill on few points, and give the ends that differ with the least misfit."""
        ends = sorted((self.polish(start, coarse=True) for start in starts), key=lambda end: end[1])
        apart: list[tuple[Array, float]] = []
        for end in ends:
            if not apart or end[1] > (1 + UNCHANGED) * apart[-1][1]:
                apart.append(end)
        return [trial for trial, _ in apart[:_POLISHED]]

    def missing(self, trial: Array) -> int:
        """How many directions the linear parameters do not tell at a trial."""
        matrix, right = equation_rows(self._equations, self._law, trial, scaled=True)
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            return 0
        return int(solve_scaled(matrix, right, known=self._known)[2].shape[1])

    def _shapes(self, some: Equations, trials: Array, whole: bool) -> list[Array | None]:
        """Columns of unit size at each trial; None where they are not finite, or soon will not be."""
        shapes: list[Array | None] = []
        with np.errstate(all="ignore"):
            for matrix, right in rows_of_trials(some, self._law, trials, coarse=True):
                columns = np.column_stack([matrix, right]) if whole else matrix
                norm = np.abs(columns).max(axis=0)
                finite = np.all(np.isfinite(norm)) and norm.max() < _HUGE
                shapes.append(columns / np.where(norm > 0, norm, 1.0) if finite else None)
        return shapes

    def admitted(self, which: int) -> Array:
        """Values of one parameter as in ``active_values``, of the signs that the law admits."""
        values = self.active_values(which)
        only = self._law.nonlinear[which] in self._law.positive and (values > 0).any()
        return values[values > 0] if only else values

    def active_values(self, which: int) -> Array:
        """Values of one parameter between which the law changes its shape; both signs."""
        if which in self.pins:
            return np.array([1.0, -1.0])
        if self._law.remembers and np.isfinite(self._natural[which]):
            size = self._natural[which] * np.logspace(-DECADES, DECADES, 12 * DECADES + 1)
            return np.concatenate([size, -size])
        some = self._equations
        some = some.select(np.linspace(0, len(some.omega) - 1, 8).round().astype(np.intp))
        followed = self._equations.motions[-1]
        largest = float(np.abs(followed).max())
        speed = largest * float(np.median(self._equations.omega))
        stiffness = float(np.max(np.abs(self._equations.force / followed[:, 1])))
        typical = [largest, 1.0, stiffness, 1 / largest, speed]
        chosen = self._changing(some, which, typical, whole=False)
        if not len(chosen):
            # what no linear parameter multiplies shows on the right alone
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
        """Values at which the shape differs from that at the value before, whatever the others are."""
        generator = np.random.default_rng(which)
        size = np.logspace(-_WIDEST, _WIDEST, 2 * _WIDEST * 3 + 1)
        values = np.concatenate([size, -size])
        active = np.zeros(len(values), dtype=bool)
        for attempt in typical[:1] if len(self.free) == 1 else typical:
            others = np.full(len(self._law.nonlinear), attempt * generator.uniform(0.3, 0.7))
            others[self.pins] = 1.0
            trials = np.repeat(others[None, :], len(values), axis=0)
            trials[:, which] = values
            shapes = self._shapes(some, trials, whole)
            moved = [i for i in range(1, len(values)) if i != len(size) and _apart(shapes[i], shapes[i - 1])]
            trials[:, which] *= 1 + _TINY
            for i, again in zip(moved, self._shapes(some, trials[moved], whole), strict=True):
                # what a tiny change changes as well is round-off
                active[i] |= again is not None and not _apart(shapes[i], again)
        active |= np.concatenate([active[1:], [False]])  # both ends of an active interval
        return values[active]

    def polish(self, start: Array, *, coarse: bool = False) -> tuple[Array, float]:
        """Descend from one trial in the logarithms of the parameters; signs stay."""
        residual = partial(self.residual, coarse=coarse)
        return _downhill(residual, start, self.free, to=1e-6 if coarse else 1e-10)


def _apart(shape: Array | None, other: Array | None) -> bool:
    """Whether two shapes are known and differ."""
    if shape is None or other is None:
        return False
    return bool(np.max(np.abs(np.abs(shape) - np.abs(other))) > _CHANGED)


def _spread_trials(windows: Sequence[Array], count: int, *, positive: int = 0) -> Array:
    """All values of one parameter, or a low-discrepancy sample of several, the first of them positive."""
    if sum(len(window) > 2 for window in windows) <= 1:
        return np.array(list(product(*windows)))
    from scipy.stats import qmc

    points = qmc.Halton(len(windows), seed=1).random(count)
    trials = np.stack(
        [
            window[(column * len(window)).astype(np.intp)]
            for window, column in zip(windows, points.T, strict=True)
        ],
        axis=1,
    )
    trials[:positive] = np.abs(trials[:positive])
    return trials


def _downhill(
    residual: Callable[[Array], Array], start: Array, free: Sequence[int], *, to: float = 1e-10
) -> tuple[Array, float]:
    """Descend from one trial in the logarithms of the free parameters; signs stay. The end, and its squares.

    ``to`` is the relative change of the parameters at which it ends.
    """
    from scipy.optimize import least_squares

    if not free:
        return start, float(np.sum(residual(start) ** 2))

    # where a switch does not act the way is flat and leads anywhere
    logs = np.log(np.abs(start[free]))
    low, high = logs - _WANDER, logs + _WANDER

    def at(logs: Array) -> Array:
        trial = np.array(start)
        trial[free] = np.sign(start[free]) * np.exp(np.clip(logs, low, high))
        return trial

    def left(logs: Array) -> Array:
        return residual(at(logs))

    steps = [1e-5] * len(logs)
    result = least_squares(left, logs, diff_step=steps, x_scale=0.1, max_nfev=25, xtol=to)
    return at(result.x), float(2 * result.cost)


def search_values(residual: Callable[[Array], Array], windows: Sequence[Array], count: int) -> Array:
    """Search parameters in their windows: the best end of descents from the best of so many trials."""
    trials = _spread_trials(windows, count)
    costs = [float(np.sum(residual(trial) ** 2)) for trial in trials]
    starts = _distinct(trials[np.argsort(costs, kind="stable")], _ENDS)
    free = range(len(windows))
    return min((_downhill(residual, start, free) for start in starts), key=lambda end: end[1])[0]


def _distinct(ordered: Array, most: int) -> list[Array]:
    """The best trials that are not neighbours of a better one."""
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
