"""The fit of a modal table: splines of all shapes are tried, one is fitted with noise on both sides."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.tolerances import NOISY, ROUND_OFF, ROUNDS
from rsgen.identification.fitting.descent import Descent
from rsgen.identification.fitting.least_squares import Regression, fit
from rsgen.identification.fitting.observed import Observed
from rsgen.identification.fitting.points import Points
from rsgen.identification.fitting.scaled_columns import solve_scaled
from rsgen.identification.fitting.systematic import is_systematic
from rsgen.identification.modal.modal_splines import SplineBasis, SplineMode
from rsgen.identification.results.agreement import Agreement

__all__ = ["ModeProblem", "SeenMode", "choose_splines", "fit_splines"]


_SHAPES = ((0, 1), (1, 1), (2, 1), (3, 1), (3, 2), (3, 3), (3, 4), (3, 6), (3, 8), (3, 12), (3, 16))
"""Degrees and intervals that are tried: a constant for a linear mode, as many pieces as a corner needs."""

_POWERS = (0, -1, 1, 2)
"""Of the amplitude, that are tried as the coordinate of the splines; zero is the logarithm."""

_TRIED = 300
"""Points, spread over the amplitude, on which shapes are compared: sixteen for each coefficient."""

_MIDDLE = 6
"""Of the shapes, with which the orders are chosen first."""

_WIDE = 1.15
"""Ratio of the highest to the lowest frequency from which on the order shows: over less the order changes the
force of points off resonance, where damping is small, by a few per cent of that."""

_ORDERS: tuple[tuple[int, ...], ...] = ((1,), (0,), (2,), (0, 1), (1, 2), (0, 1, 2))
"""Orders of the damping that are tried: those of dampers, joints and drag, and their sums."""

_CURVED = 2
"""Degree from which on a spline approximates; constants and straight lines are right, or are not chosen."""

_POINTS_A_COEFFICIENT = 2
"""At least as many points for each coefficient of k and of c: half of what they say is left to disagree."""

_APART = 0.05
"""Amplitudes within five per cent count as one, noise included: a coefficient needs one of its own."""

_UNLIKELY = 1e-3
"""Shapes so much less likely than the best are left out: together they move no interval."""


@dataclass(frozen=True, slots=True, eq=False)
class SeenMode:
    """The points, a first guess of the mode without the background, and the range near resonance [m]."""

    observed: Observed
    mode: Points
    background: Array
    tested: tuple[float, float]

    def select(self, rows: NDArray[np.intp]) -> SeenMode:
        """Take some of the points."""
        return replace(self, observed=self.observed.select(rows), mode=self.mode.select(rows))


@dataclass(frozen=True, slots=True, eq=False)
class ModeProblem:
    """What is fitted: coefficients of the splines, the mass where it is free, the background.

    ``given`` is a mass that stays; it is ``assumed`` where k/m and c are all that is wanted. ``others`` are
    other shapes that fit as well: weight, problem, and its solution.
    """

    seen: SeenMode
    basis: SplineBasis
    orders: tuple[int, ...]
    given: float | None
    assumed: bool = False
    others: tuple[tuple[float, ModeProblem, Array], ...] = ()

    @property
    def observed(self) -> Observed:
        """The points."""
        return self.seen.observed

    @property
    def coefficients(self) -> int:
        """How many."""
        return self.basis.count * (1 + len(self.orders))

    @property
    def count(self) -> int:
        """Parameters apart from the background."""
        return self.coefficients + (self.given is None)

    def split(self, parameters: Array) -> tuple[Array, float, Array]:
        """Coefficients, mass [kg] and background."""
        mass = float(parameters[self.coefficients]) if self.given is None else self.given
        return parameters[: self.coefficients], mass, parameters[self.count :]

    def compared(self, predicted: tuple[int, ...]) -> tuple[int, ...]:
        """Higher harmonics are part of no linear mode."""
        return ()

    def forward(self, omega: Array) -> SplineMode:
        """Give the forward model at the frequencies (n,) [rad/s]."""
        return SplineMode(omega, self.basis, self.orders, mass_free=self.given is None)

    def solve(self) -> tuple[Array, float]:
        """Parameters of the linear balance beside the background, and their corrected AIC, or BIC."""
        mode = self.seen.mode
        by = self.forward(mode.omega)(np.zeros(self.coefficients), 0.0, mode.amplitude).force_by
        size = np.abs(mode.force)
        right = mode.force * mode.amplitude / mode.harmonics[:, 1]
        if self.given is not None:
            right = right + self.given * mode.omega**2 * mode.amplitude
        matrix, right = by / size[:, None], right / size
        matrix, right = np.concatenate([matrix.real, matrix.imag]), np.concatenate([right.real, right.imag])
        found, _, null = solve_scaled(np.asarray(matrix), np.asarray(right))
        misfit = float(np.mean((right - matrix @ found) ** 2))
        used = len(found) - null.shape[1]
        # few points for many coefficients (Hurvich and Tsai, Biometrika 76, 1989)
        each = np.log(len(right)) if len(self.seen.background) else 2.0
        price = each * len(right) / max(len(right) - used - 1, 1)
        return found, len(right) * np.log(max(misfit, ROUND_OFF**2)) + used * price


def choose_splines(seen: SeenMode, mass: float | None) -> ModeProblem:
    """Choose the shape of the splines and the orders of the damping, each by AIC given the other.

    What is left out may then be as large as the noise, so that the next richer ones are fitted: intervals
    are those of noise alone, and would not contain it. Beside a background, whose own error splines would
    take up, the simplest ones by BIC are fitted.
    """
    mode = seen.mode
    size = mode.amplitude[mode.amplitude >= seen.tested[0]]
    # one amplitude more than coefficients, so that each is seen; two are a line
    most = min(len(size) // _POINTS_A_COEFFICIENT, max(_different(size) - 1, 2))
    allowed = [s for s in _SHAPES if not s[0] or sum(s) <= most]
    shapes = [(*shape, power) for shape in allowed for power in _POWERS]
    wide = float(mode.omega.max() / mode.omega.min()) > _WIDE
    trials = _ORDERS if wide else _ORDERS[:1]
    some = seen.select(mode.spread(_TRIED))

    def trial(part: SeenMode, shape: tuple[int, int, int], orders: tuple[int, ...]) -> ModeProblem:
        return ModeProblem(part, SplineBasis.over(part.mode.amplitude, part.tested, *shape), orders, mass)

    shape, orders = (*allowed[min(_MIDDLE, len(allowed) - 1)], _POWERS[0]), trials[0]
    for _ in range(ROUNDS):
        before = shape, orders
        orders = min(trials, key=lambda each: trial(some, shape, each).solve()[1])
        shape = min(shapes, key=lambda each: trial(some, each, orders).solve()[1])
        if before == (shape, orders):
            break
    if len(seen.background):
        return trial(seen, shape, orders)
    # a sum of two may stand for one of three, as a curved spline for a more curved one
    chosen = trial(seen, _richer(shape, allowed), orders if len(orders) == 1 else trials[-1])
    return replace(chosen, others=_others([trial(some, each, orders) for each in shapes]))


def _others(trials: list[ModeProblem]) -> tuple[tuple[float, ModeProblem, Array], ...]:
    """Weigh shapes by exp(-AIC/2), their probability of being nearest to the truth; the likely ones.

    Where a curved one is the best, all only approximate, the best in each coordinate as well as the next.
    """
    solved = [(*trial.solve(), trial) for trial in trials]
    best = min(solved, key=lambda each: each[1])
    if best[2].basis.degree >= _CURVED:
        of_power = [[each for each in solved if each[2].basis.power == power] for power in _POWERS]
        likely = [min(some, key=lambda each: each[1]) for some in of_power]
        weights = np.ones(len(likely))
    else:
        weights = np.exp([-0.5 * (each[1] - best[1]) for each in solved])
        likely = [each for each, weight in zip(solved, weights, strict=True) if weight > _UNLIKELY]
        weights = weights[weights > _UNLIKELY]
    return tuple(
        (float(weight), trial, found)
        for weight, (found, _, trial) in zip(weights / weights.sum(), likely, strict=True)
    )


def _different(amplitude: Array) -> int:
    """Count amplitudes [m] that differ: few where they were held."""
    place = np.sort(np.log(amplitude))
    edges = np.flatnonzero(np.diff(place) > _APART) + 1
    return sum(max(1, round((part[-1] - part[0]) / _APART)) for part in np.split(place, edges))


def _richer(shape: tuple[int, int, int], allowed: list[tuple[int, int]]) -> tuple[int, int, int]:
    """Take the next shape after a curved one: what the chosen one cannot follow is as large as its noise."""
    degree, intervals, power = shape
    place = allowed.index((degree, intervals))
    if degree < _CURVED:
        return shape
    return (*allowed[min(place + 1, len(allowed) - 1)], power)


def fit_splines(modal: ModeProblem) -> Regression:
    """Maximum likelihood with noise of force and response, errors widened where parts disagree."""
    observed, mode = modal.observed, modal.seen.mode
    descent = Descent(modal, modal.forward(mode.omega))
    nuisance = observed.nuisances(mode.amplitude, np.angle(mode.harmonics[:, 1]))
    if not observed.phase_known:
        descent.scale = mode.amplitude
    start = np.concatenate([modal.solve()[0], modal.seen.background])
    found = fit(descent.linearise, start, nuisance, neighbours=mode.neighbours)
    if found.noise > NOISY:
        response = descent.predict(found.parameters, found.nuisance)
        descent.scale = np.abs(observed.seen(response, modal.split(found.parameters)[2]))
        place = found.parameters, found.nuisance
        found = descent.corrected(fit(descent.linearise, *place, used=found.used, neighbours=mode.neighbours))
    if descent.scale is None:
        values = modal.split(found.parameters)[2]
        influence = observed.relative_influence(found.influence, values, found.nuisance)
        found = replace(found, influence=influence)
    misfits = is_systematic(found.residual, observed.points.pairs(found.used))
    return Agreement.of(found, observed.points, found.covariance, misfits=misfits).widen(found)
