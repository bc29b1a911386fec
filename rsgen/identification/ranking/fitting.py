"""One candidate at its best values along a motion, and each level predicted from the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.tolerances import NEAR_STEPS
from rsgen.data.oscillator import total_force
from rsgen.identification.ranking.balance import Rows
from rsgen.law.element import Element
from rsgen.law.numeric import ForceLaw, compile_law

__all__ = ["Fitted", "Guess", "fit_rows"]


_SINGULAR = 1e-13
"""Eigenvalue of scaled normal equations, relative to the largest, below which it counts as zero."""

_HELD = 0.05
"""Least share of the inertia that springs without memory balance: rubber isolators, which are little else
than a loop, keep a tenth of their stiffness."""

_SPARSE = 7
"""Every n-th point gives a stiffness well enough."""

_GAIN = 0.05
"""A step that lowers the sum of squares by less, in units of the noise, changes no verdict."""

_HALVINGS = 4
"""Of a step: a ranking needs no more digits than its noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Guess:
    """A candidate with values to start from.

    Parameters
    ----------
    name
        In words.
    elements
        Springs and dampers.
    values
        Of every parameter; the mass is "m" where it is free.
    limits
        Of those that have some.
    dissipates
        Parameters whose sum must not be negative.
    background
        (b,) values of the background beside it.
    """

    name: str
    elements: tuple[Element, ...]
    values: Mapping[str, float]
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    dissipates: tuple[tuple[str, ...], ...] = ()
    background: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def force(self) -> sympy.Expr:
        """n(x, v) [N]."""
        return total_force(self.elements)

    @property
    def law(self) -> ForceLaw:
        """Compiled; its parameters are sorted by name."""
        return compile_law(self.force)


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A candidate at its best values.

    Parameters
    ----------
    guess
        The candidate with these values.
    residual
        (n, 2H+1) what is left of the balance, in units of the noise.
    unseen
        (n, 2H+1) the same with each level predicted by the parameters that the other levels give.
    compared
        (2H+1,) which rows count.
    moved
        What it costs that its background is not that of the motion.
    """

    guess: Guess
    residual: Array
    unseen: Array
    compared: NDArray[np.bool_]
    moved: float

    @property
    def misfit(self) -> float:
        """Sum of squares."""
        return float(np.sum(self.residual[:, self.compared] ** 2)) + self.moved

    @property
    def bic(self) -> float:
        """Bayesian information criterion (Schwarz 1978) for noise of known size."""
        return self.misfit + len(self.guess.values) * float(np.log(self.residual[:, self.compared].size))


class _Balance:
    """A candidate along a motion, element by element: linear ones are evaluated once for all candidates.

    Values are those of the names and, behind them, the changes of the background.
    """

    def __init__(self, guess: Guess, rows: Rows, mass: float | None) -> None:
        self.rows, self.mass = rows, mass
        self.laws = [compile_law(element.force) for element in guess.elements]
        names = sorted({name for law in self.laws for name in law.parameters})
        self.names = (*names, "m") if mass is None else tuple(names)
        self.places = [[self.names.index(name) for name in law.parameters] for law in self.laws]
        self.nonlinear = sorted(
            {place[i] for law, place in zip(self.laws, self.places, strict=True) for i in law.nonlinear}
        )

    def evaluate(self, values: Array) -> tuple[Array, Array]:
        """Residual (n, r) and its negative slopes (n, r, q)."""
        rows = self.rows
        count = len(self.names)
        mass = float(values[count - 1]) if self.mass is None else self.mass
        residual = rows.right - mass * rows.inertia - rows.background @ values[count:]
        matrix = np.zeros((*residual.shape, len(values)))
        if self.mass is None:
            matrix[:, :, count - 1] = rows.inertia
        matrix[:, :, count:] = rows.background
        for law, place in zip(self.laws, self.places, strict=True):
            force, slopes = rows.along(law, values[place])
            residual = residual - force
            # an element may share a parameter with another
            for i, j in enumerate(place):
                matrix[:, :, j] += slopes[:, :, i]
        return residual, matrix

    def settle(self, values: Array) -> tuple[Array, Array, Array]:
        """Give linear parameters their best values while the others stay; then as ``evaluate``.

        Slopes by the others, which grow with the linear ones, are those before.
        """
        residual, matrix = self.evaluate(values)
        free = [i for i in range(len(values)) if i not in self.nonlinear]
        if not np.isfinite(residual).all() or not np.isfinite(matrix).all():
            return values, residual, matrix
        square, right = self.normal(values, residual, matrix)
        change = _solve(square[np.ix_(free, free)], right[free])
        settled = np.array(values)
        settled[free] += change
        return settled, residual - matrix[:, :, free] @ change, matrix

    def normal(self, values: Array, residual: Array, matrix: Array) -> tuple[Array, Array]:
        """Normal equations (q, q), (q,) of a Gauss-Newton step."""
        square, right = _normal(residual, matrix, self.rows)
        weight = np.append(np.zeros(len(self.names)), self.rows.background_weight) ** 2
        return square + np.diag(weight), right - weight * values

    def moved(self, values: Array) -> float:
        """What the changes of the background cost."""
        return float(np.sum((self.rows.background_weight * values[len(self.names) :]) ** 2))

    def floats(self, values: Array) -> bool:
        """Decide whether hardly anything but a loop holds the structure where it is.

        A loop has no place of its own, so that such a law would explain any mean of the motion.
        """
        if not any(law.remembers for law in self.laws):
            return False
        x, v, a, step = (part[::_SPARSE] for part in self.rows.trajectory)
        samples = [
            law.sample(x, v, a, step, values[place])
            for law, place in zip(self.laws, self.places, strict=True)
        ]
        mass = float(values[len(self.names) - 1]) if self.mass is None else self.mass
        inertia = mass * np.sqrt(np.mean(a**2) / np.mean(x**2))
        return bool(sum(float(np.mean(sample.by_x)) for sample in samples) < _HELD * inertia)

    def cost(self, values: Array, residual: Array) -> float:
        """Sum of squares; infinite where it overflows."""
        cost = float(np.sum(residual[:, self.rows.compared] ** 2)) + self.moved(values)
        return cost if np.isfinite(cost) else np.inf


def fit_rows(guess: Guess, rows: Rows, level: Array, mass: float | None) -> Fitted | None:
    """Fit a candidate along the motion and predict each level from the others.

    Parameters
    ----------
    guess
        The candidate.
    rows
        The balance.
    level
        (n,) [N] to which each point belongs.
    mass
        [kg], None where it is free.

    Returns
    -------
    Fitted or None
        None where friction would feed energy, or nothing finite comes out.
    """
    balance = _Balance(guess, rows, mass)
    names = balance.names
    still = np.zeros(len(rows.background_at))
    place = np.array([*(guess.values[each] for each in names), *still])
    free = (-np.inf, np.inf)
    limits = np.array([*(guess.limits.get(each, free) for each in names), *(free for _ in still)])
    limits = limits.reshape(-1, 2)
    place, residual, matrix = balance.settle(np.clip(place, limits[:, 0], limits[:, 1]))
    cost = balance.cost(place, residual)
    for _ in range(NEAR_STEPS if balance.nonlinear else 0):
        if not np.isfinite(cost):
            return None
        change = _solve(*balance.normal(place, residual, matrix))
        for part in 0.5 ** np.arange(_HALVINGS):
            trial, after, slopes = balance.settle(_moved(place, part * change, limits, balance.nonlinear))
            if balance.cost(trial, after) < cost:
                break
        else:
            break
        gain = cost - balance.cost(trial, after)
        place, residual, matrix, cost = trial, after, slopes, cost - gain
        if gain < _GAIN:
            break
    if not np.isfinite(cost):
        return None
    residual, matrix = balance.evaluate(place)
    values = dict(zip(names, place[: len(names)].tolist(), strict=True))
    if any(sum(values[name] for name in names) < 0 for names in guess.dissipates):
        return None
    if balance.floats(place):
        return None
    background = rows.background_at + place[len(names) :]
    fitted = replace(guess, values=values, background=background)
    unseen = _unseen(residual, matrix, rows, level, balance.normal(place, residual, matrix))
    return Fitted(fitted, residual, unseen, rows.compared, balance.moved(place))


def _moved(place: Array, change: Array, limits: Array, nonlinear: list[int]) -> Array:
    """Let breakpoints, widths and exponents at most double or halve in a step, and keep to their limits."""
    moved = place + change
    for i in nonlinear:
        if place[i]:
            moved[i] = place[i] + np.clip(change[i], -0.5 * abs(place[i]), abs(place[i]))
    return np.clip(moved, limits[:, 0], limits[:, 1])


def _normal(residual: Array, matrix: Array, rows: Rows) -> tuple[Array, Array]:
    """Normal equations (q, q), (q,) of a Gauss-Newton step."""
    flat = matrix[:, rows.compared].reshape(residual[:, rows.compared].size, matrix.shape[2])
    return flat.T @ flat, flat.T @ residual[:, rows.compared].reshape(-1)


def _solve(matrix: Array, right: Array) -> Array:
    """Solve scaled normal equations, with the smallest step where they are singular."""
    # a difference of normal equations may fall below zero by round-off
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    size = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv(matrix / np.outer(size, size), rcond=_SINGULAR, hermitian=True)
    return np.asarray(inverse @ (right / size)) / size


def _unseen(residual: Array, matrix: Array, rows: Rows, level: Array, whole: tuple[Array, Array]) -> Array:
    """Residual of each level with the parameters that the other levels give, one Gauss-Newton step away."""
    unseen = np.full_like(residual, np.nan)
    levels = np.unique(level)
    if len(levels) < 2:
        return unseen
    for one in levels:
        part = level == one
        square, right = _normal(residual[part], matrix[part], rows)
        unseen[part] = residual[part] - matrix[part] @ _solve(whole[0] - square, whole[1] - right)
    return unseen
