"""Maximum likelihood where force and response both carry noise.

Every point has one or two unknowns that concern only itself (its true amplitude, its time origin): nuisances.
They are eliminated point by point, so that the least-squares problem keeps the size of the parameters; the
matrix is never squared, and its columns are scaled, because parameters differ by many orders of magnitude.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, blocks
from rsgen.common.linear_algebra import solve_scaled
from rsgen.common.tolerances import (
    BLOCK,
    GAIN,
    HALVINGS,
    NOISY,
    NULL_PART,
    OUTLIERS,
    ROUND_OFF,
    STEPS,
    UNCHANGED,
    chi_square_exceeded,
)

_OWN_SHARE = 1e-6
"""Share of the square of a column that is its own, below which the other columns make it up."""


def determined(covariance: Array, null: Array) -> Array:
    """Covariance (q, q) without that of parameters with a part in null vectors (q, d): theirs is NaN."""
    lost = np.abs(null).max(axis=1, initial=0.0) > NULL_PART
    return np.where(lost | lost[:, None], np.nan, covariance)


Mask = NDArray[np.bool_]

_FOLLOWED = 0.98
"""A step after which fewer of the points can still be predicted is too long."""

_RETURN = 2
"""Steps within which a full step across the bend of a narrow valley must lead to its floor, lower down:
the watchdog of Chamberlain, Powell, Lemarechal and Pedersen, Math. Programming Study 16, 1982."""

_OUTLYING = 3e-3
"""Relative misfit below which no point is an outlier: in exact data most points may agree to round-off."""

_TOGETHER = 3.0
"""Outliers that are neighbours more often than chance would bring, by this factor, are none."""


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """The model around the present parameters, in units of the expected noise.

    Parameters
    ----------
    residual
        (n, M) measured minus predicted; NaN in every row of a point that could not be predicted.
    by_nuisance
        (n, M, k) derivative of the prediction by the k nuisances of each point.
    by_parameter
        (n, M, q) derivative of the prediction by the parameters.
    """

    residual: Array
    by_nuisance: Array
    by_parameter: Array


@dataclass(frozen=True, slots=True, eq=False)
class Regression:
    """What a fit leaves.

    Parameters
    ----------
    parameters
        (q,) the estimate.
    nuisance
        (n, k) the nuisances of each point.
    covariance
        (q, q), scaled with the noise found in the residual; NaN for parameters that are not identifiable.
    null
        (q, d) directions in the space of scaled parameters that the points do not tell.
    scale
        (q,) by which the parameters are scaled there.
    noise
        Noise found, in units of the expected one.
    misfit
        (n,) distance of each point in units of the expected noise, per degree of freedom; NaN where it
        could not be predicted.
    used
        (n,) False for outliers and points that could not be predicted.
    freedom
        Degrees of freedom left for the noise.
    converged
        False where the steps did not become small.
    strength
        (q,) root mean square change of the prediction by a unit of each parameter, in units of the
        expected noise.
    influence
        (n, M, q) change of the estimate by a unit of each residual; zero for points that are not used.
    basis
        (q, r) the parameters by r independent directions, which the points determine equally well.
    rows, residual
        (n, M, r) and (n, M) slopes by these directions and residuals; zero for points that are not used. The
        sum of rows.T @ rows is the identity, that of rows.T @ residual nothing.
    free
        (q,) False for parameters that are fixed: they have no errors, and move nothing.
    noise_share
        Largest share that noise of the nuisances alone has in the information on a direction; from one on
        nothing is known of that direction.
    """

    parameters: Array
    nuisance: Array
    covariance: Array
    null: Array
    scale: Array
    noise: float
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
    noise_share: float = 0.0

    def first(self, count: int) -> Regression:
        """What concerns the first parameters; errors that the others cause stay in."""
        return replace(
            self,
            parameters=self.parameters[:count],
            covariance=self.covariance[:count, :count],
            null=self.null[:count],
            scale=self.scale[:count],
            strength=self.strength[:count],
            influence=self.influence[:, :, :count],
            basis=self.basis[:count],
            free=self.free[:count],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Rules:
    """How a descent goes, and what is known of the parameters beside the points.

    Parameters
    ----------
    steps
        Most Gauss-Newton steps.
    gain
        A step that lowers the sum of squares by less, in units of the noise found, is the last.
    halvings
        Lengths of a step that are tried, each half of the one before.
    attainable
        Misfit that the error of the prediction explains: below it steps are not halved, and end sooner.
    natural
        (q,) sizes at which parameters would matter, whatever their present values; see ``solve_scaled``.
    held
        Parameters that stay where they are, yet count among the unknowns when errors are stated.
    free
        (q,) False for parameters that are fixed: they stay where they are, and are no unknowns.
    linear
        Parameters in which the residual is linear: beside every trial of the others they take their best
        values (variable projection), for which the slopes before are good enough.
    prior
        (q,) inverse standard errors with which the parameters are known to be zero.
    move
        From parameters and a step to where it leads, within bounds.
    """

    steps: int = STEPS
    gain: float = GAIN
    halvings: int = HALVINGS
    attainable: float = 0.0
    natural: Array | float = 0.0
    held: Sequence[int] = ()
    free: Mask | bool = True
    linear: Sequence[int] = ()
    prior: Array | None = None
    move: Callable[[Array, Array], Array] = np.add

    def solve(self, flat: Array, right: Array, parameters: Array) -> tuple[Array, Array, Array]:
        """Solve for the change of the parameters; see ``solve_scaled``."""
        known = np.where(np.broadcast_to(self.free, len(parameters)), np.nan, 0.0)
        return solve_scaled(flat, right, parameters, self.natural, known=known)

    def cost(self, residual: Array, parameters: Array) -> float:
        """Sum of squares of residuals, and of what is known of the parameters."""
        known = 0.0 if self.prior is None else float(np.sum((self.prior * parameters) ** 2))
        return float(np.sum(residual**2)) + known

    def equations(
        self, residual: Array, matrix: Array, parameters: Array, chosen: Mask
    ) -> tuple[Array, Array]:
        """Rows (r, q) and right sides (r,) of a step: of the chosen points, and what is known beside them."""
        flat, right = _stacked(matrix, residual, chosen)
        if self.prior is None:
            return flat, right
        known = self.prior > 0
        beside = np.diag(self.prior)[known], (-self.prior * parameters)[known]
        return np.concatenate([flat, beside[0]]), np.concatenate([right, beside[1]])


_USUAL = Rules()

Linearise = Callable[[Array, Array], Linearisation]


def fit(
    linearise: Linearise,
    parameters: Array,
    nuisance: Array,
    rules: Rules = _USUAL,
    *,
    reject: bool = True,
    neighbours: NDArray[np.intp] | None = None,
    used: Mask | None = None,
) -> Regression:
    """Gauss-Newton with step halving on parameters and nuisances together, and the errors.

    Parameters
    ----------
    linearise
        Called with (q,) parameters and (n, k) nuisances.
    parameters, nuisance
        Where to start.
    rules
        Of each descent; there is one for each setting aside of outliers.
    reject
        Whether outliers are set aside.
    neighbours
        (k, 2) pairs of points next to each other in the test. Where neighbours disagree together it is
        the law that does not fit, and no point is set aside.
    used
        (n,) points to begin with, all where it is None.
    """
    used = np.ones(len(nuisance), dtype=bool) if used is None else used
    converged = False
    for _ in range(4 if reject else 1):
        parameters, nuisance, line, converged = descend(linearise, parameters, nuisance, rules, used)
        predicted = np.isfinite(line.residual).all(axis=1)
        kept = (predicted & _agreeing(line, used & predicted, neighbours)) if reject else predicted & used
        used, before = kept, used
        if np.array_equal(used, before):
            break
    return summarise(line, parameters, nuisance, rules, used, converged=converged)


def eliminate(line: Linearisation) -> tuple[Array, Array]:
    """Remove from residual and derivatives what the nuisances of each point can take up."""
    residual, matrix = np.array(line.residual), np.array(line.by_parameter)
    for part in blocks(len(residual), BLOCK):
        units, _ = _orthonormal(line.by_nuisance[part])
        _remove(units, residual[part, :, None])
        _remove(units, matrix[part])
    return residual, matrix


def _remove(units: Sequence[Array], columns: Array) -> None:
    """Take out of columns (n, M, q), in place, their parts along orthonormal vectors (n, M)."""
    for unit in units:
        columns -= unit[:, :, None] * np.einsum("nm,nmq->nq", unit, columns)[:, None, :]


def _along(unit: Array, rows: Array) -> Array:
    """(n,) products of vectors (n, M)."""
    return np.asarray(np.einsum("nm,nm->n", unit, rows))


def _orthonormal(matrix: Array) -> tuple[list[Array], Array]:
    """k orthonormal columns (n, M) of n small matrices (n, M, k), and their triangles (n, k, k).

    A column without effect stays zero.

    By Gram and Schmidt in the modified order (Golub and Van Loan, Matrix Computations, 2013, Sec. 5.2.8).
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
    """Equations (r, q) of the chosen points, and their right sides (r,)."""
    if not chosen.all():
        matrix, residual = matrix[chosen], residual[chosen]
    right = residual.reshape(-1)
    return matrix.reshape(len(right), matrix.shape[2]), right


def descend(
    linearise: Linearise,
    parameters: Array,
    nuisance: Array,
    rules: Rules = _USUAL,
    used: Mask | None = None,
) -> tuple[Array, Array, Linearisation, bool]:
    """Gauss-Newton with step halving, from parameters and nuisances to better ones; see ``fit``.

    Returns
    -------
    parameters, nuisance, line, converged
        Where it ended, the model there, and whether the steps had become small.
    """
    used = np.ones(len(nuisance), dtype=bool) if used is None else used
    parameters, line = _settle(linearise(parameters, nuisance), parameters, rules, used)
    for _ in range(rules.steps):
        good = used & np.isfinite(line.residual).all(axis=1)
        if not good.any():
            return parameters, nuisance, line, False
        flat, right = rules.equations(*eliminate(line), parameters, good)
        flat[:, list(rules.held)] = 0.0
        change, _, _ = rules.solve(flat, right, parameters)
        rest = line.residual - line.by_parameter @ change
        nuisance_change = np.zeros_like(nuisance)
        predicted = np.isfinite(rest).all(axis=1)
        nuisance_change[predicted] = _least_squares(line.by_nuisance[predicted], rest[predicted]).clip(-1, 1)
        with np.errstate(over="ignore"):
            relative = float(np.max(np.abs(change) / np.maximum(np.abs(parameters), 1e-300), initial=0.0))
        expected = float(np.sum((right - flat @ change) ** 2))
        gain = (rules.cost(line.residual[good], parameters) - expected) * right.size / max(expected, 1e-300)
        if gain < rules.gain:
            return parameters, nuisance, line, True
        realised = -1.0
        reached = float(np.sqrt(np.mean(right**2))) < rules.attainable
        for part in 0.5 ** np.arange(1 if reached else rules.halvings):
            moved = rules.move(parameters, part * change), nuisance + part * nuisance_change
            trial = linearise(*moved)
            both = good & np.isfinite(trial.residual).all(axis=1)
            if np.count_nonzero(both) < _FOLLOWED * np.count_nonzero(good):
                continue
            settled, trial = _settle(trial, moved[0], rules, both)
            before = rules.cost(line.residual[both], parameters)
            after = rules.cost(trial.residual[both], settled)
            if after <= before:
                parameters, nuisance, line = settled, moved[1], trial
                realised = (before - after) * right.size / max(after, 1e-300)
                break
        least = max(rules.gain, UNCHANGED * right.size) if reached else rules.gain
        if realised < least or relative < ROUND_OFF:
            done = realised >= 0 or relative < 1e-6 or gain < 1.0
            # of exact data what is left is of waveforms, and no valley; slopes that are kept show no bend
            exact = rules.attainable > 0 or np.sqrt(np.mean(right**2)) < NOISY
            if done or exact or rules.steps <= _RETURN:
                return parameters, nuisance, line, done
            step = rules.move(parameters, change), nuisance + nuisance_change
            ahead = _across_bend(linearise, step, line, parameters, rules, good)
            if ahead is None:
                return parameters, nuisance, line, False
            parameters, nuisance, line, _ = ahead
    return parameters, nuisance, line, False


def _across_bend(
    linearise: Linearise,
    step: tuple[Array, Array],
    line: Linearisation,
    here: Array,
    rules: Rules,
    good: Mask,
) -> tuple[Array, Array, Linearisation, bool] | None:
    """Descend from a full step to the floor of a narrow valley; None where that is no lower than here."""
    ahead = descend(linearise, *step, replace(rules, steps=_RETURN), good)
    both = good & np.isfinite(ahead[2].residual).all(axis=1)
    lower = rules.cost(ahead[2].residual[both], ahead[0]) < rules.cost(line.residual[both], here)
    return ahead if lower and np.count_nonzero(both) >= _FOLLOWED * np.count_nonzero(good) else None


def _settle(line: Linearisation, parameters: Array, rules: Rules, used: Mask) -> tuple[Array, Linearisation]:
    """Give the linear parameters their best values while the others stay."""
    linear = list(rules.linear)
    good = used & np.isfinite(line.residual).all(axis=1)
    if not linear or not good.any():
        return parameters, line
    flat, right = rules.equations(*eliminate(line), parameters, good)
    settled, change = np.array(parameters), solve_scaled(flat[:, linear], right)[0]
    settled[linear] += change
    return settled, replace(line, residual=line.residual - line.by_parameter[:, :, linear] @ change)


def _least_squares(matrix: Array, right: Array) -> Array:
    """(n, k) solutions of n small problems (n, M, k); zero of a column without effect."""
    units, triangle = _orthonormal(matrix)
    solution = np.zeros((len(matrix), len(units)))
    for j in reversed(range(len(units))):
        rest = _along(units[j], right) - _along(triangle[:, j, j + 1 :], solution[:, j + 1 :])
        solution[:, j] = rest / np.where(triangle[:, j, j] > 0, triangle[:, j, j], 1.0)
    return solution


def _agreeing(line: Linearisation, used: Mask, neighbours: NDArray[np.intp] | None) -> Mask:
    """Points whose distance fits the spread of the others; the worst are set aside, at most a fixed share."""
    residual, _ = eliminate(line)
    distance = np.sum(residual**2, axis=1)
    freedom = line.residual.shape[1] - line.by_nuisance.shape[2]
    # force and fundamental alone have as many rows more than nuisances as there are nuisances
    fewest = min(line.by_nuisance.shape[2], freedom)
    limit = max(_largest_by_chance(distance[used], fewest, freedom, 1e-3 / len(distance)), _OUTLYING**2)
    order = np.sort(distance[np.isfinite(distance)])[::-1]
    most = int(OUTLIERS * len(order))
    if most < len(order):
        limit = max(limit, float(order[most]))
    agreeing = np.asarray(np.nan_to_num(distance, nan=np.inf) <= limit)
    if neighbours is not None:
        apart = ~agreeing & np.isfinite(distance)
        together = int(np.count_nonzero(apart[neighbours].all(axis=1)))
        share = np.count_nonzero(apart) / len(apart)
        if together > _TOGETHER * share**2 * len(neighbours) + 2:
            return np.ones(len(apart), dtype=bool)
    return agreeing


def _largest_by_chance(distance: Array, fewest: int, freedom: int, chance: float) -> float:
    """What the distance of a point exceeds with a probability, by the median and upper quartile of all.

    Harmonics with less noise than the fundamental leave a distance of fewer degrees of freedom than it has
    rows, with a longer tail; the fundamental and the force alone leave the ``fewest``.
    """
    if not len(distance):
        return chi_square_exceeded(freedom, chance)
    middle, upper = np.quantile(distance, [0.5, 0.75])

    def spread(count: int) -> float:
        return chi_square_exceeded(count, 0.25) / chi_square_exceeded(count, 0.5)

    free = next((count for count in range(freedom, fewest, -1) if spread(count) * middle >= upper), fewest)
    return float(middle) * chi_square_exceeded(free, chance) / chi_square_exceeded(free, 0.5)


def summarise(
    line: Linearisation,
    parameters: Array,
    nuisance: Array,
    rules: Rules = _USUAL,
    used: Mask | None = None,
    *,
    converged: bool = True,
) -> Regression:
    """State errors, and what is not identifiable, of parameters and nuisances at which a descent ended."""
    used = np.ones(len(nuisance), dtype=bool) if used is None else used
    residual, matrix = eliminate(line)
    free = np.array(np.broadcast_to(rules.free, len(parameters)))
    count, points = int(np.count_nonzero(free)), int(np.count_nonzero(used))
    each = residual.shape[1] - nuisance.shape[1]
    stacked, right = rules.equations(residual, matrix, parameters, used)
    _, inverse, null = rules.solve(stacked, right, parameters)
    norm = np.sqrt(np.einsum("rq,rq->q", stacked, stacked))
    freedom = max(len(right) - points * nuisance.shape[1] - (count - null.shape[1]), 1)
    variance = float(right @ right) / freedom
    fisher = inverse @ inverse.T * variance
    distance = np.sum(residual**2, axis=1)
    matrix[~used] = 0.0
    residual[~used] = 0.0
    # The sandwich keeps its word where the noise is not as expected; the larger of the two is reported.
    scores = np.einsum("nmq,nm->nq", matrix, residual) @ inverse
    flat = matrix.reshape(residual.size, len(parameters))
    sandwich = inverse @ (scores.T @ scores) @ inverse.T * (max(points, 1) / max(points - count, 1))
    spread = np.sqrt(np.maximum(np.diag(fisher), 0.0))
    ratio = np.sqrt(np.maximum(np.diag(sandwich), 0.0)) / np.where(spread > 0, spread, 1.0)
    widen = np.maximum(ratio, 1.0)
    slopes, _ = _stacked(line.by_parameter, line.residual, used)
    return Regression(
        parameters=parameters,
        nuisance=nuisance,
        covariance=determined(fisher * np.outer(widen, widen), null),
        null=null,
        scale=np.where(norm > 0, norm, 1.0),
        noise=float(np.sqrt(variance)),
        misfit=np.sqrt(distance / each),
        used=used,
        freedom=freedom,
        converged=converged,
        strength=free * np.sqrt(np.einsum("rq,rq->q", slopes, slopes) / max(points, 1)),
        influence=(flat @ (inverse @ inverse.T)).reshape(matrix.shape),
        basis=inverse,
        rows=(flat @ inverse).reshape(*residual.shape, inverse.shape[1]),
        residual=residual,
        free=free,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Alternative:
    """One more column beside a fit: the value it takes, its standard error, and what it moves (q,)."""

    value: float
    error: float
    shift: Array

    @property
    def gain(self) -> float:
        """Fall of the sum of squares, in units of the noise."""
        return (self.value / self.error) ** 2 if self.error > 0 else 0.0


def alternatives(
    residual: Array, matrix: Array, columns: Array, score: Array, readings: Array, free: Mask | bool = True
) -> list[Alternative]:
    """Fit each of some columns beside all parameters, to first order from a solution.

    Without readings the larger error counts, of equal noise or of noise as it is (White, Econometrica, 1980).

    Parameters
    ----------
    residual, matrix
        (r,) and (r, q) at the solution, of unit variance, nuisances eliminated.
    columns
        (r, t) what may be missing; each is tried alone.
    score
        (q + t,) what noise in a slope adds to its product with the residual.
    readings
        (P, r) deviation of single readings from their mean: their scatter is in the errors.
    free
        (q,) False for parameters that are fixed.

    Returns
    -------
    list
        (t,), of value zero where a column is made up of the others.
    """
    own_score, added = np.split(score, [matrix.shape[1]])
    known = np.where(np.broadcast_to(free, matrix.shape[1:]), np.nan, 0.0)
    inverse = solve_scaled(matrix, residual, known=known)[1] if matrix.size else np.zeros(matrix.T.shape)
    found = []
    for column, more in zip(columns.T, added, strict=True):
        # the pseudoinverse from its factor: inverse @ inverse.T @ matrix.T
        taken = inverse @ (inverse.T @ (matrix.T @ column))
        own = column - matrix @ taken
        size = float(own @ own)
        if not size > _OWN_SHARE * float(column @ column):
            found.append(Alternative(0.0, np.inf, np.zeros(len(taken))))
            continue
        value = float(own @ residual - more + taken @ own_score) / size
        error = size**-0.5
        if not len(readings):
            error = max(error, float(np.linalg.norm(own * residual)) / size)
        elif len(readings) > 1:
            moved = readings @ own / size
            error = max(error, float(np.sqrt(moved @ moved / (len(moved) * (len(moved) - 1)))))
        found.append(Alternative(value, error, -taken * value))
    return found


Bend = Callable[[Array], tuple[Array, Array]]
"""From directions (n, k) of the nuisances to second derivatives (n, M) of the prediction along them, and to
the change (n, M, q) of its slopes by the parameters."""


def remove_bias(found: Regression, line: Linearisation, bend: Bend) -> Regression:
    """Correct the parameters for the square of the noise.

    Nuisances that are off by e bend the prediction by e.H.e/2, on the average by the sum of H L L^T / 2 with
    L L^T their covariance: by second derivatives along the columns of L. They change the slopes by the
    parameters, too: what that adds to the information is noise (attenuation; Fuller, Measurement Error
    Models, Wiley 1987, chapter 2).
    """
    # with the last nuisance first, one column of L = R^-1 has all of them; beside the others the prediction
    # may be at hand
    units, triangle = _orthonormal(line.by_nuisance[:, :, ::-1])
    regular = found.used & np.all(np.diagonal(triangle, axis1=1, axis2=2) > 0, axis=1)
    factor = np.zeros_like(triangle)
    factor[regular] = np.linalg.inv(triangle[regular])[:, ::-1] * found.noise
    shift, share = np.zeros(line.residual.shape), np.zeros((found.basis.shape[1],) * 2)
    for column in np.moveaxis(factor, 2, 0):
        second, slopes = bend(column)
        shift += 0.5 * second
        slopes = np.nan_to_num(slopes)
        _remove(units, slopes)
        moved = slopes[regular] @ found.basis
        share += np.tensordot(moved, moved, ([0, 1], [0, 1]))
    regular &= np.isfinite(shift).all(axis=1)
    residual, matrix = shift, np.array(line.by_parameter)
    _remove(units, residual[:, :, None])
    _remove(units, matrix)
    change, _, _ = Rules(free=found.free).solve(*_stacked(matrix, residual, regular), found.parameters)
    # what the points say of the corrected parameters
    moved = found.residual - np.nan_to_num(matrix) @ change
    moved[regular] += residual[regular]
    moved[~found.used] = 0.0
    largest = float(np.linalg.eigvalsh(share)[-1]) if len(share) else 0.0
    parameters = found.parameters + change
    return replace(found, parameters=parameters, residual=moved, noise_share=largest)
