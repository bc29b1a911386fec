"""Nonlinear least squares with errors in variables: force and response both have noise.

Minimised is the sum over points of |r_i(p, e_i)|^2 with parameters p common to all points and up to four
nuisances e_i of each point (its true amplitude, its phase, and those of a second sensor; of lines none):

    dr_i = -J_i dp - K_i de_i.

A Gauss-Newton step eliminates de_i by projecting r_i and J_i on the complement of K_i (variable projection:
Golub and Pereyra, Inverse Problems 19, 2003), so that the linear problem keeps the size of p. It is solved by
an orthogonal decomposition, not by normal equations, whose condition number is the square; columns are
scaled, because parameters differ by many orders of magnitude. A parameter p that is known as p0 ± s, such as
a mass that was weighed, is one more equation (p - p0)/s, in units of the noise that the other rows leave.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, blocks
from rsgen.common.solvers import determined, solve_scaled, summed_products
from rsgen.common.tolerances import (
    MAX_NEWTON_STEPS,
    MAX_SHARE_OF_OUTLIERS,
    MAX_STEP_HALVINGS,
    MIN_GAIN_OF_STEP,
    MISFIT_NEGLIGIBLE,
    MISFIT_OF_NOISE,
    POINTS_PER_BLOCK,
    ROUND_OFF,
    largest_by_chance,
)

Mask = NDArray[np.bool_]

_MIN_PREDICTED_SHARE = 0.98
"""Share of the points that must have a prediction after a step."""

_WATCHDOG_STEPS = 2
"""Steps after a full step that increases the sum of squares, in which it must decrease: the watchdog of
Chamberlain, Powell, Lemarechal and Pedersen, Math. Programming Study 16, 1982."""

_NEGLIGIBLE_STEP = 1e-6
"""Relative change of all parameters by a full step below which the place is the minimum."""

_MIN_OUTLIER_MISFIT = 3e-3
"""Relative misfit below which no point is an outlier: in exact data most points agree to round-off."""

_MAX_NEIGHBOUR_RATIO = 3.0
"""Pairs of neighbouring outliers, relative to their number by chance, beyond which the law is wrong."""

_SPARE_PAIRS = 2
"""Pairs beyond that: of few outliers less than one pair is expected, and two are no pattern yet."""


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """Residuals and derivatives at the present parameters, in units of the expected noise.

    Parameters
    ----------
    residual
        (n, M) measured minus predicted; NaN in every row of a point without a prediction.
    by_nuisance
        (n, M, k) derivative of the prediction by the k nuisances of each point.
    by_parameter
        (n, M, q) derivative of the prediction by the parameters.
    """

    residual: Array
    by_nuisance: Array
    by_parameter: Array

    @property
    def predicted(self) -> Mask:
        """True (n,) for points with a prediction."""
        return np.asarray(np.isfinite(self.residual).all(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Regression:
    """The result of a fit.

    Parameters
    ----------
    parameters
        (q,) the estimate.
    nuisance
        (n, k) the nuisances of each point.
    covariance
        (q, q), scaled with the noise found in the residual; NaN for parameters that are not identifiable.
    null
        (q, d) directions in the space of scaled parameters that the points do not determine.
    scale
        (q,) scale of the parameters there.
    sigma
        Standard deviation of the noise of a single equation, in units of the expected one.
    misfit
        (n,) distance of each point per degree of freedom, in expected noise; NaN without a prediction.
    used
        (n,) False for outliers and points without a prediction.
    freedom, error_freedom
        Degrees of freedom of the noise, and those (q,) of the errors in the covariance; see ``widened``.
    converged
        False if the steps did not become small.
    strength
        (q,) root mean square change of the prediction by a unit of each parameter, in expected noise.
    influence
        (n, M, q) change of the estimate by a unit of each residual; zero for points not used.
    basis
        (q, r) the parameters by r independent directions, which the points determine equally well.
    rows, residual
        (n, M, r) orthonormal slopes by these directions, (n, M) residuals; zero for points not used.
    free
        (q,) False for fixed parameters, which have no errors.
    rules
        Of the descent, the prior in units of the noise that it left.
    noise_share
        Largest share of noise of the nuisances in the information on a direction; below one.
    """

    parameters: Array
    nuisance: Array
    covariance: Array
    null: Array
    scale: Array
    sigma: float
    misfit: Array
    used: Mask
    freedom: int
    converged: bool
    strength: Array
    influence: Array
    basis: Array
    rows: Array
    residual: Array
    free: Mask
    error_freedom: Array
    rules: Rules
    noise_share: float = 0.0

    @property
    def rms_misfit(self) -> float:
        """Misfit of real and imaginary part together: the ``residual`` of an identification."""
        return self.sigma * 2**0.5

    @property
    def cost(self) -> float:
        """Sum of squares of residuals and prior."""
        return self.rules.cost(self.residual, self.parameters)

    def widened(self, covariance: Array, freedom: Array | float = np.inf) -> Regression:
        """Return the fit with larger errors.

        They rest on the fewest degrees of freedom of all that made them: those of the noise, and those,
        (q,) or one for all, of repeated readings or of parts of the band.
        """
        return replace(self, covariance=covariance, error_freedom=np.minimum(self.error_freedom, freedom))

    def first(self, count: int) -> Regression:
        """Return the part of the first parameters, marginalised over the others."""
        names = ("parameters", "null", "scale", "strength", "basis", "free", "error_freedom")
        columns: dict[str, Any] = {name: getattr(self, name)[:count] for name in names}
        influence = self.influence[:, :, :count]
        return replace(self, covariance=self.covariance[:count, :count], influence=influence, **columns)


@dataclass(frozen=True, slots=True, eq=False)
class Rules:
    """Control of a descent, and prior knowledge of the parameters.

    Parameters
    ----------
    steps
        Maximum of Gauss-Newton steps.
    gain
        Decrease of the sum of squares, in units of the noise found, below which a step is the last.
    attainable
        Misfit by the error of the prediction, below which steps are not halved, and end sooner (``descend``).
    natural
        (q,) typical sizes of the parameters; see ``solve_scaled``.
    frozen
        Parameters that keep their values, but count as unknowns in the covariance.
    free
        (q,) False for fixed parameters, which keep their values and are no unknowns.
    linear
        Parameters in which the residual is linear: solved for at every trial of the others.
    prior, known
        (q,) inverse standard errors with which parameters are known, zero for others; and their values.
    noise
        Of an equation, in the units of the residual: those of the prior. 0: what the residual leaves.
    bounded_step
        Function of parameters and a step that returns the next parameters: the only place of bounds. Rankings
        alone set it (``candidate_fit``); elsewhere parameters have none.
    record
        (n,) number of the record of each point where noise is correlated along it; see ``summed_products``.
    """

    steps: int = MAX_NEWTON_STEPS
    gain: float = MIN_GAIN_OF_STEP
    attainable: float = 0.0
    natural: Array | float = 0.0
    frozen: Sequence[int] = ()
    free: Mask | bool = True
    linear: Sequence[int] = ()
    prior: Array | None = None
    known: Array | float = 0.0
    noise: float = 1.0
    bounded_step: Callable[[Array, Array], Array] = np.add
    record: NDArray[np.intp] | None = None

    def knowing(self, place: int, known: tuple[float, float] | None, held: float = np.nan) -> Rules:
        """Return the rules with value and standard error of a parameter, if known and not ``held`` there."""
        if known is None or held == known[0]:
            return self
        here = np.arange(np.size(self.free)) == place
        prior = np.where(here, 1 / known[1], 0.0 if self.prior is None else self.prior)
        return replace(self, prior=prior, known=np.where(here, known[0], self.known))

    def solve(self, flat: Array, right: Array, parameters: Array) -> tuple[Array, Array, Array]:
        """Solve for the change of the parameters; see ``solve_scaled``."""
        known = np.where(np.broadcast_to(self.free, len(parameters)), np.nan, 0.0)
        return solve_scaled(flat, right, parameters, self.natural, known=known)

    def cost(self, residual: Array, parameters: Array) -> float:
        """Return the sum of squares of residuals and prior."""
        return float(np.sum(residual**2) + np.sum(self.prior_rows(parameters)[1] ** 2))

    def equations(self, residual: Array, matrix: Array, parameters: Array, used: Mask) -> tuple[Array, Array]:
        """Return rows (r, q) and right sides (r,) of a step: points used, then the prior."""
        flat, right = _stacked(matrix, residual, used)
        if self.prior is None:
            return flat, right
        rows, known = self.prior_rows(parameters)
        return np.concatenate([flat, rows]), np.concatenate([right, known])

    def prior_rows(self, parameters: Array) -> tuple[Array, Array]:
        """Return the equations (k, q) of the k parameters that are known, and their right sides (k,)."""
        weight = np.zeros(len(parameters)) if self.prior is None else self.noise * self.prior
        rows = weight > 0
        return np.diag(weight)[rows], (weight * (self.known - parameters))[rows]

    def at(self, line: Linearisation, used: Mask) -> Rules:
        """Return the rules with the noise that the points used have at a place, if it is not known."""
        if self.prior is None or self.noise:
            return self
        residual = line.residual[used & line.predicted]
        count = residual.shape[0] * (residual.shape[1] - line.by_nuisance.shape[2])
        freedom = max(count - int(np.count_nonzero(self.free)), 1)
        return replace(self, noise=max(float(np.sqrt(np.sum(residual**2) / freedom)), MISFIT_OF_NOISE))


_USUAL = Rules()
Linearise = Callable[[Array, Array], Linearisation]


def fit(
    linearise: Linearise,
    parameters: Array,
    nuisance: Array,
    rules: Rules = _USUAL,
    *,
    exclude: bool = True,
    neighbours: NDArray[np.intp] | None = None,
    used: Mask | None = None,
) -> Regression:
    """Fit parameters and nuisances by Gauss-Newton steps with halving; exclude outliers; state errors.

    Parameters
    ----------
    linearise
        Function of (q,) parameters and (n, k) nuisances.
    parameters, nuisance
        Initial values.
    rules
        Control of each descent.
    exclude
        True if outliers are excluded, with a new descent after each of at most four exclusions; at the end
        all points are tried once more.
    neighbours
        (k, 2) neighbours in the test. If outliers are neighbours the law is wrong, and none is excluded.
    used
        (n,) mask of the points to begin with; None: all.
    """
    used = np.ones(len(nuisance), dtype=bool) if used is None else used
    converged, measured = False, nuisance
    for _ in range(4 if exclude else 1):
        parameters, nuisance, line, converged = descend(linearise, parameters, nuisance, rules, used)
        good, before = used & line.predicted, used
        place = parameters, nuisance, line
        used = _agreeing(place, rules.at(line, good), good, neighbours) if exclude else good
        if np.array_equal(used, before):
            break
    if exclude and not used.all():
        # points that agree at the solution may have been outliers on the way from a far start
        whole = descend(linearise, parameters, np.where(used[:, None], nuisance, measured), rules)
        every = np.ones_like(used)
        if _agreeing(whole[:3], rules.at(whole[2], every), every, None).all():
            (parameters, nuisance, line, converged), used = whole, every
    return summarise(line, parameters, nuisance, rules, used, converged=converged)


def eliminate(line: Linearisation) -> tuple[Array, Array]:
    """Project residual and derivatives on the complement of the nuisances of each point."""
    residual, matrix = np.array(line.residual), np.array(line.by_parameter)
    for part in blocks(len(residual), POINTS_PER_BLOCK):
        units, _ = orthonormal(line.by_nuisance[part])
        subtract_along(units, residual[part, :, None])
        subtract_along(units, matrix[part])
    return residual, matrix


def subtract_along(units: Sequence[Array], columns: Array) -> None:
    """Subtract from columns (n, M, q), in place, their parts along orthonormal vectors (n, M)."""
    for unit in units:
        columns -= unit[:, :, None] * np.einsum("nm,nmq->nq", unit, columns)[:, None, :]


def _along(unit: Array, rows: Array) -> Array:
    """Return the scalar products (n,) of vectors (n, M)."""
    return np.asarray(np.einsum("nm,nm->n", unit, rows))


def orthonormal(matrix: Array) -> tuple[list[Array], Array]:
    """Return k orthonormal columns (n, M) of n matrices (n, M, k), and their triangles (n, k, k).

    Modified Gram-Schmidt (Golub and Van Loan, Matrix Computations, 2013, Sec. 5.2.8); zeros stay zero.
    """
    count = matrix.shape[2]
    units: list[Array] = []
    triangle = np.zeros((len(matrix), count, count))
    for j in range(count):
        column = matrix[:, :, j]
        for i, unit in enumerate(units):
            triangle[:, i, j] = share = _along(unit, column)
            column = column - unit * share[:, None]
        triangle[:, j, j] = norm = np.sqrt(_along(column, column))
        units.append(column / np.where(norm > 0, norm, 1.0)[:, None])
    return units, triangle


def _stacked(matrix: Array, residual: Array, chosen: Mask) -> tuple[Array, Array]:
    """Return the equations (r, q) of the chosen points, and their right sides (r,)."""
    if not chosen.all():
        matrix, residual = matrix[chosen], residual[chosen]
    right = residual.reshape(-1)
    return matrix.reshape(len(right), matrix.shape[2]), right


def descend(
    linearise: Linearise, parameters: Array, nuisance: Array, rules: Rules = _USUAL, used: Mask | None = None
) -> tuple[Array, Array, Linearisation, bool]:
    """Minimise by Gauss-Newton steps; return parameters, nuisances, residual with slopes, and convergence.

    A step is halved until it lowers the sum of squares; linear parameters are then solved for. The ends are

    1. converged: a step promises to gain less than ``rules.gain``, and is not taken;
    2. converged: a step gained less than that, or moved no parameter by more than round-off. Below the misfit
       ``rules.attainable`` a gain of a thousandth of the sum of squares is the last, and no step is halved;
    3. no length lowers the sum of squares: converged if the full step moves no parameter by a millionth, or
       promises less than the noise of one equation, in exact data that of all. Otherwise a few steps from
       the end of the full one may lead across a bend of a narrow valley (``_across_bend``), and the descent
       goes on; not with ``rules.attainable``, nor within ``_across_bend``;
    4. not converged: ``rules.steps`` are used up, or no point has a prediction.
    """
    used = np.ones(len(nuisance), dtype=bool) if used is None else used
    parameters, line = _solve_linear(linearise(parameters, nuisance), parameters, rules, used)
    place, declared = (parameters, nuisance, line), rules
    for _ in range(rules.steps):
        good = used & place[2].predicted
        if not good.any():
            break
        rules = declared.at(place[2], good)
        step = _Step.of(place, rules, good)
        if step.gain < rules.gain:
            return *place, True
        place, decrease = _halved(linearise, place, step, rules, good)
        if step.gained_enough(decrease, rules):
            continue
        converged = step.at_minimum(decrease)
        # slopes that are kept from step to step have no bend
        if converged or rules.attainable > 0 or rules.steps <= _WATCHDOG_STEPS:
            return *place, converged
        ahead = _across_bend(linearise, place, step, rules, good)
        if ahead is None:
            return *place, False
        place = ahead
    return *place, False


Place = tuple[Array, Array, Linearisation]
"""Parameters (q,), nuisances (n, k), and the residual with slopes there."""


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """A Gauss-Newton step from a place.

    Parameters
    ----------
    change, nuisance
        (q,) and (n, k) changes of parameters and nuisances.
    gain
        Expected decrease of the sum of squares, in units of the noise that would be left.
    misfit, rows
        Root mean square of the equations before the step, and their number.
    relative
        Largest relative change of a parameter.
    """

    change: Array
    nuisance: Array
    gain: float
    misfit: float
    rows: int
    relative: float

    @classmethod
    def of(cls, place: Place, rules: Rules, good: Mask) -> _Step:
        """Solve for the parameters without nuisances, then for the nuisances of each point."""
        parameters, nuisance, line = place
        flat, right = rules.equations(*eliminate(line), parameters, good)
        flat[:, list(rules.frozen)] = 0.0
        change, _, _ = rules.solve(flat, right, parameters)
        rest, moved = line.residual - line.by_parameter @ change, np.zeros_like(nuisance)
        predicted = np.isfinite(rest).all(axis=1)
        moved[predicted] = _least_squares(line.by_nuisance[predicted], rest[predicted]).clip(-1, 1)
        with np.errstate(over="ignore"):
            relative = float(np.max(np.abs(change) / np.maximum(np.abs(parameters), 1e-300), initial=0.0))
        left = float(np.sum((right - flat @ change) ** 2))
        gain = (rules.cost(line.residual[good], parameters) - left) * right.size / max(left, 1e-300)
        return cls(change, moved, gain, float(np.sqrt(np.mean(right**2))), right.size, relative)

    def gained_enough(self, decrease: float, rules: Rules) -> bool:
        """Return True if the decrease of the sum of squares, in units of noise, is worth another step."""
        attained = MISFIT_NEGLIGIBLE * self.rows if self.misfit < rules.attainable else 0.0
        return decrease >= max(rules.gain, attained) and self.relative >= ROUND_OFF

    def at_minimum(self, decrease: float) -> bool:
        """Return True if a step that did not gain enough ends at the minimum; see the ends of ``descend``."""
        # of exact data truncated waveforms leave a misfit that steps change by less than half
        noise = self.rows if self.misfit < MISFIT_OF_NOISE else 1.0
        return decrease >= 0 or self.relative < _NEGLIGIBLE_STEP or self.gain < noise

    def end(self, place: Place, rules: Rules, part: float = 1.0) -> tuple[Array, Array]:
        """Return parameters and nuisances after a part of the step."""
        return rules.bounded_step(place[0], part * self.change), place[1] + part * self.nuisance


def _halved(linearise: Linearise, place: Place, step: _Step, rules: Rules, good: Mask) -> tuple[Place, float]:
    """Halve a step until it lowers the sum of squares; return its end, and the decrease in units of noise.

    Where no length does, it is the place itself, and -1.
    """
    for part in 0.5 ** np.arange(1 if step.misfit < rules.attainable else MAX_STEP_HALVINGS):
        parameters, nuisance = step.end(place, rules, part)
        trial = linearise(parameters, nuisance)
        both = good & trial.predicted
        if np.count_nonzero(both) < _MIN_PREDICTED_SHARE * np.count_nonzero(good):
            continue
        parameters, trial = _solve_linear(trial, parameters, rules, both)
        before = rules.cost(place[2].residual[both], place[0])
        after = rules.cost(trial.residual[both], parameters)
        if after <= before:
            return (parameters, nuisance, trial), (before - after) * step.rows / max(after, 1e-300)
    return place, -1.0


def _across_bend(linearise: Linearise, place: Place, step: _Step, rules: Rules, good: Mask) -> Place | None:
    """Descend from the end of a full step to the floor of a narrow valley; None if that is no lower."""
    *ahead, line, _ = descend(linearise, *step.end(place, rules), replace(rules, steps=_WATCHDOG_STEPS), good)
    both = good & line.predicted
    lower = rules.cost(line.residual[both], ahead[0]) < rules.cost(place[2].residual[both], place[0])
    enough = np.count_nonzero(both) >= _MIN_PREDICTED_SHARE * np.count_nonzero(good)
    return (ahead[0], ahead[1], line) if lower and enough else None


def _solve_linear(
    line: Linearisation, parameters: Array, rules: Rules, used: Mask
) -> tuple[Array, Linearisation]:
    """Solve for the linear parameters at given values of the others."""
    linear = list(rules.linear)
    good = used & line.predicted
    if not linear or not good.any():
        return parameters, line
    flat, right = rules.equations(*eliminate(line), parameters, good)
    solved, change = np.array(parameters), solve_scaled(flat[:, linear], right)[0]
    solved[linear] += change
    return solved, replace(line, residual=line.residual - line.by_parameter[:, :, linear] @ change)


def _least_squares(matrix: Array, right: Array) -> Array:
    """Return the solutions (n, k) of n least-squares problems (n, M, k); zero for a column of zeros."""
    units, triangle = orthonormal(matrix)
    solution = np.zeros((len(matrix), len(units)))
    for j in reversed(range(len(units))):
        rest = _along(units[j], right) - _along(triangle[:, j, j + 1 :], solution[:, j + 1 :])
        solution[:, j] = rest / np.where(triangle[:, j, j] > 0, triangle[:, j, j], 1.0)
    return solution


def _agreeing(place: Place, rules: Rules, used: Mask, neighbours: NDArray[np.intp] | None) -> Mask:
    """Return the mask of points without outliers, which are at most ``MAX_SHARE_OF_OUTLIERS``.

    They are farther than one point in a thousand tests by chance, and than ``_MIN_OUTLIER_MISFIT``. One
    outlier pulls the fit off its neighbours: outliers that are neighbours are judged again after a step
    without them. Where outliers are neighbours after two rounds, the law is wrong: none is excluded.
    """
    line = place[2]
    (residual, matrix), predicted = eliminate(line), line.predicted
    freedom = line.residual.shape[1] - line.by_nuisance.shape[2]
    # force and fundamental have twice as many rows as nuisances
    fewest = min(line.by_nuisance.shape[2], freedom)
    most = int(MAX_SHARE_OF_OUTLIERS * np.count_nonzero(predicted))
    for _ in range(2):
        distance = np.sum(residual**2, axis=1)
        by_chance = largest_by_chance(distance[used], fewest, freedom, 1e-3 / len(distance))
        # only the ``most`` farthest may be left out: those beyond the next one, the (most + 1)-th largest
        cap = np.sort(distance[predicted])[-most - 1 :][:1]
        outliers: Mask = predicted & (distance > max(by_chance, _MIN_OUTLIER_MISFIT**2, *cap))
        pairs_by_chance = 0 if neighbours is None else np.mean(outliers) ** 2 * len(neighbours)
        most_pairs = _MAX_NEIGHBOUR_RATIO * pairs_by_chance + _SPARE_PAIRS
        if neighbours is None or np.sum(outliers[neighbours].all(axis=1)) <= most_pairs:
            return predicted & ~outliers
        used = used & ~outliers
        residual -= matrix @ _Step.of(place, rules, used).change
    return predicted


def summarise(
    line: Linearisation,
    parameters: Array,
    nuisance: Array,
    rules: Rules = _USUAL,
    used: Mask | None = None,
    *,
    converged: bool = True,
) -> Regression:
    """Return covariance, null space and influence at the end of a descent.

    The noise ``sigma`` of a single row is the root of the sum of squares over the degrees of freedom: rows
    less nuisances less free parameters that the rows determine. The covariance is that of equal noise of this
    size, widened where the sandwich estimate is larger; with ``rules.record`` it is the sandwich estimate.
    The slopes times ``inverse``, the second result of ``Rules.solve``, are orthonormal: ``Regression.basis``.
    """
    used = np.ones(len(nuisance), dtype=bool) if used is None else used
    residual, matrix = eliminate(line)
    free = np.array(np.broadcast_to(rules.free, len(parameters)))
    count, points = int(np.count_nonzero(free)), int(np.count_nonzero(used))
    rules = rules.at(line, used)
    stacked, right = rules.equations(residual, matrix, parameters, used)
    _, inverse, null = rules.solve(stacked, right, parameters)
    norm = np.sqrt(np.einsum("rq,rq->q", stacked, stacked))
    freedom = max(len(right) - points * nuisance.shape[1] - (count - null.shape[1]), 1)
    variance = float(right @ right) / freedom
    # what is known beforehand has its own noise, whatever the points leave
    known = rules.prior_rows(parameters)[0] @ inverse
    prior = rules.noise**2 * (known.T @ known)
    fisher = (inverse - inverse @ known.T @ known) @ inverse.T * variance + inverse @ prior @ inverse.T
    distance = np.sum(residual**2, axis=1)
    matrix[~used], residual[~used] = 0.0, 0.0
    flat = matrix.reshape(residual.size, len(parameters))
    rows = (flat @ inverse).reshape(*residual.shape, inverse.shape[1])
    # the sandwich covariance stays valid if the noise is another: of independent noise the larger is taken
    if rules.record is None:
        scores = np.einsum("nmr,nm->nr", rows, residual)
        products, least = scores.T @ scores * (max(points, 1) / max(points - count, 1)), 1.0
    else:
        products, least = summed_products(rows, residual, rules.record), 0.0
    products = products + prior
    spread, seen = (np.sqrt(np.maximum(np.diag(c), 0.0)) for c in (fisher, inverse @ products @ inverse.T))
    widen = np.maximum(seen / np.where(spread > 0, spread, 1.0), least)
    slopes, _ = _stacked(line.by_parameter, line.residual, used)
    return Regression(
        parameters=parameters,
        nuisance=nuisance,
        covariance=determined(fisher * np.outer(widen, widen), null),
        null=null,
        scale=np.where(norm > 0, norm, 1.0),
        sigma=float(np.sqrt(variance)),
        misfit=np.sqrt(distance / (residual.shape[1] - nuisance.shape[1])),
        used=used,
        freedom=freedom,
        converged=converged,
        strength=free * np.sqrt(np.einsum("rq,rq->q", slopes, slopes) / max(points, 1)),
        influence=(flat @ (inverse @ inverse.T)).reshape(matrix.shape),
        basis=inverse,
        rows=rows,
        residual=residual,
        free=free,
        error_freedom=np.full(len(parameters), float(freedom)),
        rules=rules,
    )
