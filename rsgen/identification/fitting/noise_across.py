"""What noise of two sensors does to a law that follows their difference.

Least squares take the motion across as exact. It is a small difference of two sensors, and noise in a column
of the balance pulls its value towards zero and the others (the mass, the spring beside the joint) after it:
of many points N, a = N^-1 (N - S) a_true, where N is the matrix of the normal equations and S the part of it
that noise alone makes (attenuation; Fuller, Measurement Error Models, Wiley 1987, chapter 2). Hence
a_true - a = (N - S)^-1 S a, which is added. The noise is known from the test itself: its square to a third,
so that a correction of several standard errors is not to be relied upon.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.tolerances import GROUPS, ROUND_OFF, TAKEN
from rsgen.identification.fitting.across import MeasuredAcross
from rsgen.identification.fitting.descent import Descent
from rsgen.identification.fitting.least_squares import Regression, eliminate
from rsgen.identification.fitting.points import Points
from rsgen.identification.fitting.problem import Problem
from rsgen.law.motion import Motion

__all__ = ["Pull", "noise_of_ratio", "pull_of_noise"]

_BESIDE = 2
"""Points to either side through which a cubic is laid: what it misses of the middle one is noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Pull:
    """What noise of the motion across does to the values.

    Parameters
    ----------
    noise
        Of the two sensors, relative.
    share
        Largest share of noise in what the fit knows of a combination of values; from one on nothing is known.
    change
        (q,) what has to be added to the values, which noise pulled; zeros where too little is known.
    """

    noise: float
    share: float
    change: Array

    def taken_off(self, found: Regression) -> Regression:
        """Values without the pull, and errors that grow as much as the least known combination."""
        if not self.share < TAKEN:
            return found
        parameters = np.array(found.parameters)
        parameters[: len(self.change)] += self.change
        return replace(found, parameters=parameters, covariance=found.covariance / (1 - self.share) ** 2)


def pull_of_noise(problem: Problem, found: Regression, force_noise: Array | None) -> Pull | None:
    """Find how far noise pulls the values of a law across two sensors; None where that is not known.

    Parameters
    ----------
    problem, found
        A fit along the measured motion across.
    force_noise
        (n,) with which it weighed the points; None where it did not.
    """
    points, used = problem.observed.points, found.used
    if not problem.law.acts_across or points.across is None:
        return None
    noise = noise_of_ratio(points)
    whole, random = _rows(problem, found, force_noise, points.across), np.random.default_rng(0)
    normal = np.einsum("nmp,nmq->pq", whole[used], whole[used])
    size = np.sqrt(np.diag(normal))
    if not (np.isfinite(noise) and np.isfinite(size).all() and (size > 0).all()):
        return None
    part = np.zeros_like(normal)
    spread = noise * np.hypot(points.amplitude, np.abs(points.harmonics[:, 1] - points.across[:, 1]))
    for _ in range(GROUPS):
        moved, draw = np.array(points.across), random.standard_normal((2, len(points))) / np.sqrt(2)
        moved[:, 1] += spread * (draw[0] + 1j * draw[1])
        change = np.nan_to_num(_rows(problem, found, force_noise, moved) - whole)[used]
        part += np.einsum("nmp,nmq->pq", change, change) / GROUPS
    normal, part = (matrix / np.outer(size, size) for matrix in (normal, part))
    known, directions = np.linalg.eigh(normal)
    regular = known > ROUND_OFF * known[-1]
    inverse = directions[:, regular] / np.sqrt(known[regular])
    of_noise = inverse.T @ part @ inverse
    share = float(np.linalg.eigvalsh(of_noise)[-1])
    change = np.zeros(len(size))
    if share < TAKEN:
        pulled = inverse.T @ part @ (found.parameters[: problem.count] * size)
        change = inverse @ np.linalg.solve(np.eye(len(of_noise)) - of_noise, pulled) / size
    return Pull(noise, share, change)


def noise_of_ratio(points: Points) -> float:
    """Relative noise of the two sensors, from what of the ratio of their motions is not smooth; NaN: unknown.

    Along a run the ratio of the motion across to the response is smooth, whatever the law: what it differs by
    from a cubic through its neighbours is noise. Half of the differences are smaller than the median, which
    jumps and antiresonances do not move. Of the ratio 1 - far/near both sensors make far/near as noisy.
    """
    order = np.lexsort((points.omega, points.sweep, points.level))
    width = 2 * _BESIDE + 1
    if points.across is None or len(order) < width:
        return float("nan")
    rows = np.lib.stride_tricks.sliding_window_view(order, width)
    rows = rows[(points.level[rows] == points.level[rows[:, :1]]).all(axis=1)]
    rows = rows[(points.sweep[rows] == points.sweep[rows[:, :1]]).all(axis=1)]
    omega = points.omega[rows]
    rows = rows[(np.diff(omega, axis=1) > 0).all(axis=1)]
    if len(rows) < width:
        return float("nan")
    ratio, weights = points.across[:, 1] / points.harmonics[:, 1], _cubic(points.omega[rows])
    missed = np.abs(np.sum(weights * ratio[rows], axis=1)) ** 2
    expected = np.sum(weights**2 * 2 * np.abs(1 - ratio[rows]) ** 2, axis=1)
    # the square of a complex normal number of unit variance has the median ln 2
    return float(np.sqrt(np.median(missed / expected) / np.log(2)))


def _cubic(omega: Array) -> Array:
    """(n, 2 b + 1) weights of the middle one and, negative, of the cubic through the others there."""
    weights = np.ones_like(omega)
    beside = [i for i in range(omega.shape[1]) if i != _BESIDE]
    for i in beside:
        for j in beside:
            if i != j:
                weights[:, i] *= (omega[:, _BESIDE] - omega[:, j]) / (omega[:, i] - omega[:, j])
        weights[:, i] *= -1
    return weights


def _rows(problem: Problem, found: Regression, force_noise: Array | None, across: ComplexArray) -> Array:
    """(n, M, q) slopes by the parameters along a motion across (n, H+1) [m], nuisances eliminated."""
    mode = problem.observed.mode(found.parameters[problem.count :])
    free = problem.given is None
    forward = MeasuredAcross(problem.law, mode.motion, Motion(mode.omega, across), mass_free=free)
    forward.noise = force_noise
    line = Descent(problem, forward).linearise(found.parameters, found.nuisance)
    return eliminate(line)[1][:, :, : problem.count]
