"""One candidate at its best values along a motion, and each level predicted from the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.linear_algebra import solve_scaled
from rsgen.common.tolerances import NEAR_STEPS
from rsgen.data.oscillator import total_force
from rsgen.identification.fitting.least_squares import Linearisation, Rules, descend
from rsgen.identification.ranking.balance import Rows
from rsgen.law.element import Element
from rsgen.law.numeric import ForceLaw, compile_law

_HELD = 0.05
"""Least share of the inertia that springs without memory balance: rubber isolators, which are little else
than a loop, keep a tenth of their stiffness."""

_SPARSE = 7
"""Every n-th point gives a stiffness well enough."""


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
        Of every parameter; the mass is "m".
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

    def __init__(self, guess: Guess, rows: Rows, fixed: Mapping[str, float]) -> None:
        self.rows = rows
        self.laws = [compile_law(element.force) for element in guess.elements]
        names = sorted({name for law in self.laws for name in law.parameters})
        self.names = (*names, "m")
        self.free = np.array([each not in fixed for each in self.names] + [True] * len(rows.background_at))
        self.places = [[self.names.index(name) for name in law.parameters] for law in self.laws]
        self.nonlinear = sorted(
            {place[i] for law, place in zip(self.laws, self.places, strict=True) for i in law.nonlinear}
        )

    def evaluate(self, values: Array) -> tuple[Array, Array]:
        """Residual (n, r) and its negative slopes (n, r, q)."""
        rows = self.rows
        count = len(self.names)
        residual = rows.right - values[count - 1] * rows.inertia - rows.background @ values[count:]
        matrix = np.zeros((*residual.shape, len(values)))
        matrix[:, :, count - 1] = rows.inertia
        matrix[:, :, count:] = rows.background
        for law, place in zip(self.laws, self.places, strict=True):
            force, slopes = rows.along(law, values[place])
            residual = residual - force
            # an element may share a parameter with another
            for i, j in enumerate(place):
                matrix[:, :, j] += slopes[:, :, i]
        return residual, matrix

    def linearise(self, values: Array, nuisance: Array) -> Linearisation:
        """Rows that are compared, which have no nuisances (n, 0)."""
        residual, matrix = (part[:, self.rows.compared] for part in self.evaluate(values))
        return Linearisation(residual, np.zeros((*residual.shape, 0)), matrix)

    @property
    def prior(self) -> Array:
        """(q,) inverse standard errors with which the changes of the background are known to be zero."""
        return np.append(np.zeros(len(self.names)), self.rows.background_weight)

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
        inertia = values[len(self.names) - 1] * np.sqrt(np.mean(a**2) / np.mean(x**2))
        return bool(sum(float(np.mean(sample.by_x)) for sample in samples) < _HELD * inertia)


def fit_rows(guess: Guess, rows: Rows, level: Array, fixed: Mapping[str, float]) -> Fitted | None:
    """Fit a candidate along the motion and predict each level from the others.

    Parameters
    ----------
    guess
        The candidate.
    rows
        The balance.
    level
        (n,) [N] to which each point belongs.
    fixed
        Names of parameters that stay at their values of the candidate.

    Returns
    -------
    Fitted or None
        None where friction would feed energy, or nothing finite comes out.
    """
    balance = _Balance(guess, rows, fixed)
    names = balance.names
    still = np.zeros(len(rows.background_at))
    place = np.array([*(guess.values[each] for each in names), *still])
    free = (-np.inf, np.inf)
    limits = np.array([*(guess.limits.get(each, free) for each in names), *(free for _ in still)])
    limits = limits.reshape(-1, 2)
    rules = Rules(
        steps=NEAR_STEPS if balance.nonlinear else 0,
        linear=[i for i in np.flatnonzero(balance.free).tolist() if i not in balance.nonlinear],
        free=balance.free,
        prior=balance.prior,
        move=partial(_moved, limits=limits, nonlinear=balance.nonlinear),
    )
    place = np.clip(place, limits[:, 0], limits[:, 1])
    place, *_ = descend(balance.linearise, place, np.zeros((len(level), 0)), rules)
    residual, matrix = balance.evaluate(place)
    if not np.isfinite(np.sum(residual[:, rows.compared] ** 2)):
        return None
    values = dict(zip(names, place[: len(names)].tolist(), strict=True))
    if any(sum(values[name] for name in names) < 0 for names in guess.dissipates):
        return None
    if balance.floats(place):
        return None
    background = rows.background_at + place[len(names) :]
    fitted = replace(guess, values=values, background=background)
    unseen = _unseen(balance, place, residual, matrix, level)
    moved = float(np.sum((balance.prior * place) ** 2))
    return Fitted(fitted, residual, unseen, rows.compared, moved)


def _moved(place: Array, change: Array, limits: Array, nonlinear: list[int]) -> Array:
    """Let breakpoints, widths and exponents at most double or halve in a step, and keep to their limits."""
    moved = place + change
    for i in nonlinear:
        if place[i]:
            moved[i] = place[i] + np.clip(change[i], -0.5 * abs(place[i]), abs(place[i]))
    return np.clip(moved, limits[:, 0], limits[:, 1])


def _unseen(balance: _Balance, place: Array, residual: Array, matrix: Array, level: Array) -> Array:
    """Residual of each level with the parameters that the other levels give, one Gauss-Newton step away."""
    unseen = np.full_like(residual, np.nan)
    parts = [level == one for one in np.unique(level)]
    if len(parts) < 2:
        return unseen
    still = np.where(balance.free, np.nan, 0.0)
    known = np.column_stack([np.diag(balance.prior), -balance.prior * place])
    rows = np.concatenate([matrix, residual[:, :, None]], axis=2)[:, balance.rows.compared]
    triangles = [np.linalg.qr(rows[part].reshape(-1, rows.shape[2]), mode="r") for part in parts]
    for i, part in enumerate(parts):
        rest = np.concatenate([known, *triangles[:i], *triangles[i + 1 :]])
        moved = solve_scaled(rest[:, :-1], rest[:, -1], known=still)[0]
        unseen[part] = residual[part] - matrix[part] @ moved
    return unseen
