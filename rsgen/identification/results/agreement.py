"""Whether misfits have a pattern, and the parts of a test agree: levels, runs and stretches of frequency.

A part is identified apart by one Gauss-Newton step from the solution of the whole, with the rows of the fit.
In the coordinates of ``Regression.basis`` the whole has unit information, so that a part and the rest, I and
1 - I, have the same independent directions, and the difference of their estimates along each is a test of its
own (Chow, Econometrica 28, 1960, as a score test). Where parts disagree, errors that count every point as
independent are too small; those of a block jackknife are not (Cameron and Miller, J. Human Resources 50,
2015, the cluster-robust CR3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.finding import Finding, quantities
from rsgen.common.tolerances import CONFIDENCE, GROUPS, SAME_NUMBER, SEVERAL, f_tail, t_quantile
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.points import Points

__all__ = ["Agreement", "Difference", "compare_parts", "jackknife", "leave_out"]


_BY_CHANCE = 1e-5
"""Probability that parts of one law seem to disagree: one false alarm in a hundred thousand tests."""

_BOTH = 0.05
"""Share of the information on a direction that each part must have: what one part has nearly alone, or
hardly at all, is not compared."""

_ALONE = 1e-3
"""Information on a direction outside a group below which that group is not left out: hardly any would be
left."""

_SLIGHT = 3e-4
"""Parts whose predictions differ by less, relative, change no engineering number."""


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """What a part of the points says against the rest.

    Parameters
    ----------
    chance
        Probability of a difference as large, if both obey one law and the misfit is noise.
    size
        Root mean square difference of their predictions, in the unit of the residuals.
    moved, error
        (q,) difference of each parameter and its standard error.
    """

    chance: float
    size: float
    moved: Array
    error: Array

    def z(self, wider: Array | float = 1.0) -> float:
        """Largest difference of a parameter in standard errors, these widened by factors (q,)."""
        error = self.error * wider
        good = error > 0
        return float(np.max(np.abs(self.moved[good] / error[good]), initial=0.0))


def compare_parts(whole: Regression, part: NDArray[np.bool_]) -> Difference | None:
    """Compare a part (n,) of the points with the rest; None where they have no direction in common."""
    rows, residual = whole.rows[part], whole.residual[part]
    if not len(rows):
        return None
    share, across = np.linalg.eigh(np.tensordot(rows, rows, ([0, 1], [0, 1])))
    score = np.einsum("nmr,nm->r", rows, residual)
    rest = np.einsum("nmr,nm->r", whole.rows, whole.residual) - score
    both = (share > _BOTH) & (share < 1 - _BOTH)
    if not both.any():
        return None
    share, across = share[both], across[:, both]
    apart = (across.T @ score) / share - (across.T @ rest) / (1 - share)
    variance = 1 / share + 1 / (1 - share)
    noise, directions = max(whole.noise, 1e-300), len(share)
    test = float(np.sum(apart**2 / variance)) / noise**2 / directions
    count = max(int(np.count_nonzero(whole.used)), 1)
    step = whole.basis @ across
    return Difference(
        f_tail(directions, whole.freedom, test),
        float(np.sqrt(np.sum(apart**2) / count)),
        step @ apart,
        noise * np.sqrt(step**2 @ variance),
    )


def jackknife(whole: Regression, group: NDArray[np.intp]) -> Array:
    """Covariance (q, q) of the parameters from leaving out one group (n,) of the points after the other."""
    used = whole.used
    return leave_out(whole.basis, whole.rows[used], whole.residual[used], group[used])


def leave_out(basis: Array, rows: Array, residual: Array, group: NDArray[np.intp]) -> Array:
    """Covariance (q, q) from leaving out one group (n,) of the rows after the other, exactly where they are
    linear.

    Parameters
    ----------
    basis
        (q, r) the parameters by the directions of the rows.
    rows, residual
        (n, M, r) and (n, M); the sum of rows.T @ rows is the identity, that of rows.T @ residual nothing.
    """
    numbers = np.unique(group)
    unit = np.eye(basis.shape[1])
    total = np.zeros_like(unit)
    for number in numbers:
        own, left_over = rows[group == number], residual[group == number]
        left, across = np.linalg.eigh(unit - np.tensordot(own, own, ([0, 1], [0, 1])))
        kept = left > _ALONE
        score = across[:, kept].T @ np.einsum("nmr,nm->r", own, left_over)
        moved = across[:, kept] @ (score / left[kept])
        total += np.outer(moved, moved)
    total *= (len(numbers) - 1) / max(len(numbers), 1)
    return np.asarray(basis @ total @ basis.T)


def _times(spread: Array, variance: Array) -> Array:
    """(q,) factor, at least 1, from a standard error to a larger one; 1 where either is not known."""
    with np.errstate(all="ignore"):
        times: Array = np.nan_to_num(np.sqrt(spread / variance), nan=1.0, posinf=1.0)
    return np.maximum(times, 1.0)


def _levels(points: Points) -> NDArray[np.intp]:
    """(n,) number of the level of each point, ascending."""
    return np.unique(points.level, return_inverse=True)[1]


def _runs(points: Points) -> NDArray[np.intp]:
    """(n,) number of the run of each point."""
    number = np.empty(len(points), dtype=np.intp)
    for run, rows in enumerate(points.runs):
        number[rows] = run
    return number


def _stretches(points: Points) -> NDArray[np.intp]:
    """(n,) number of the stretch of frequency of each point, of all runs together at least ``GROUPS``."""
    runs = points.runs
    each = -(-GROUPS // len(runs))
    stretch = np.empty(len(points), dtype=np.intp)
    for run, rows in enumerate(runs):
        stretch[rows] = run * each + np.arange(len(rows)) * each // len(rows)
    return stretch


def _splits(points: Points) -> dict[str, NDArray[np.bool_]]:
    """Ways to cut the test in two: by levels, of one level by runs or stretches of frequency."""
    for name, groups in {
        "levels": _levels(points),
        "runs": _runs(points),
        "stretches": _stretches(points),
    }.items():
        count = int(groups.max()) + 1
        if count > 1:
            parts = {f"alternate-{name}": groups % 2 == 0}
            if count > 2 and name == "levels":
                parts["lower-and-upper-levels"] = groups < count // 2
            return parts
    return {}


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How the parts of a test agree, and what follows for the errors.

    Parameters
    ----------
    wider
        (q,) factor, at least 1, by which standard errors of all parameters of the fit grow.
    freedom
        Degrees of freedom of the intervals.
    findings
        What disagrees.
    """

    wider: Array
    freedom: int
    findings: tuple[Finding, ...] = ()

    @classmethod
    def of(cls, whole: Regression, points: Points, covariance: Array, *, misfits: bool) -> Agreement:
        """Compare the parts of a test.

        Parameters
        ----------
        whole, points
            A fit, and the points it was made of.
        covariance
            (q, q) of its parameters, as it would be reported: that of the fit, or from the scatter of
            repeats. It is never left smaller than that of the fit.
        misfits
            Whether the misfit is the law's, not noise: then errors are widened although parts agree.
        """
        # what readings of a point share does not show in their scatter, but does in what the law leaves
        shared = _times(np.diag(whole.covariance), np.diag(covariance))
        same = cls(shared, whole.freedom)
        splits = _splits(points)
        parts = {name: compare_parts(whole, part & whole.used) for name, part in splits.items()}
        apart = {
            name: part
            for name, part in parts.items()
            if part is not None and part.size > _SLIGHT and part.chance < _BY_CHANCE / len(splits)
        }
        if not (apart or misfits):
            return same
        levels = _levels(points)
        enough = len(np.unique(levels[whole.used])) >= SEVERAL
        group = levels if enough else _stretches(points)
        freedom = len(np.unique(group[whole.used])) - 1
        if freedom < 1:
            return same
        spread = np.diag(jackknife(whole, group))
        wider = np.maximum(_times(spread, np.diag(covariance)), shared)
        # the parts are compared by the errors of independent points
        times = _times(spread, np.sum(whole.basis**2, axis=1) * whole.noise**2)
        interval = t_quantile(freedom, CONFIDENCE) / t_quantile(max(whole.freedom, 1), CONFIDENCE)
        found = [
            Finding(
                "intervals-widened",
                "warning",
                numbers=quantities(groups=freedom + 1, wider=float(np.median(wider) * interval)),
                names={"by": "levels" if enough else "stretches"},
            )
        ]
        if apart:
            name, worst = max(apart.items(), key=lambda item: item[1].z())
            held = max(part.z(times * interval) for part in apart.values())
            size = max(part.size for part in apart.values())
            found.append(
                Finding(
                    "parts-disagree",
                    "doubt" if size > SAME_NUMBER else "warning",
                    numbers=quantities(z=worst.z(), after=held, size=size),
                    names={"parts": name.replace("-", " ")},
                )
            )
        return cls(wider, freedom, tuple(found))

    def widen(self, found: Regression) -> Regression:
        """Widen the errors of all parameters of a fit, or of the first ones."""
        wider = self.wider[: len(found.covariance)]
        covariance = found.covariance * np.outer(wider, wider)
        return replace(found, covariance=covariance, freedom=self.freedom)
