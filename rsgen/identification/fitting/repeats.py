"""Repeated readings of a point: their mean is fitted, their scatter is a second estimate of the errors.

With r_i the relative deviation of reading i from the mean of its point and I_i the influence of a unit
deviation on the parameters, the covariance by scatter is the sum of (I_i r_i)(I_i r_i)^T over readings, with
the factor n/(n - 1) of each point. From six readings of a point on, means of sqrt(n) successive ones take
their place, because successive readings share a drift. Few readings more than points, or responses that
follow the force of each reading, are no repeats. The misfit of a law contains the errors of the law and
errors common to the readings of a point; the scatter contains drift between readings. Standard errors are
those of the larger one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.tolerances import (
    MAX_SHARE_OF_OUTLIERS_BY_CHANCE,
    MIN_SIGNIFICANT_GAIN,
    NOISE_LIMIT_SIGMAS,
    ROUND_OFF,
)
from rsgen.data.record_set import FILE_ROUND_OFF
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.points import ASYMMETRIC
from rsgen.law.element import response_share

MIN_JUMP_RATIO = 1.5
"""Ratio of two amplitudes from which on a jump lies between them."""

_MIN_READINGS_OF_BATCHES = 6
"""From so many readings on batch means are formed, as many as the square root of their number."""

_MAX_MEDIAN_DISTANCES = 10.0
"""Distance of a reading from the median, in median distances, from which on it is an outlier."""

_MIN_EXCESS_READINGS = 20
"""Readings minus points from which on their scatter is an estimate of the noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Repeats:
    """Readings of the points of a surface, relative to their means.

    Parameters
    ----------
    row
        (r,) row of the surface of means of each reading.
    place
        (r,) number of a reading among those of its row, from 0, in the order of the test.
    count
        (n,) readings of each row.
    force, response, far
        (r,) complex relative deviation of the fundamentals of force and response, (r, E-1) of those of
        further sensors, from their means [1].
    excluded
        Number of excluded outliers.
    """

    row: NDArray[np.intp]
    place: NDArray[np.intp]
    count: NDArray[np.intp]
    force: NDArray[np.complex128]
    response: NDArray[np.complex128]
    far: NDArray[np.complex128]
    excluded: int

    @property
    def noise(self) -> float:
        """Relative noise of one reading, force and response together [1].

        Points that scatter far more than the median point are left out, if they are few: one of their
        readings may be wrong. The median of a mean of k squares is (1 - 2/(9 k))^3 of its expectation (E. B.
        Wilson and M. M. Hilferty, Proc. Natl. Acad. Sci. 17 (1931) 684).
        """
        parts = np.stack([np.abs(self.force), self.response.real, self.response.imag]) ** 2
        power, freedom = np.bincount(self.row, parts.sum(axis=0), len(self.count)), self.count - 1
        power, freedom = power[freedom > 0], freedom[freedom > 0]
        if not power.any():
            return 0.0
        # the real parts differ in size, and count as fewer
        sizes = parts.sum(axis=1)
        squares = freedom * sizes.sum() ** 2 / np.sum(sizes**2)
        typical = float(np.median(power / freedom / (1 - 2 / (9 * squares)) ** 3))
        near = power <= NOISE_LIMIT_SIGMAS**2 * typical * freedom
        if not typical or np.count_nonzero(~near) > MAX_SHARE_OF_OUTLIERS_BY_CHANCE * len(near):
            near[:] = True
        return float(np.sqrt(np.sum(power[near]) / np.sum(freedom[near])))

    @property
    def follow_force(self) -> bool:
        """True if the responses depend on the forces of the readings: then every reading is a point.

        As in S-curves, where the force is raised in small steps, or with a fluctuating force. Noise of the
        sensors alone is independent, and the regression of one on the other is not significant.
        """
        force = self.force.real
        freedom = len(self.row) - len(self.count) - 1
        power, total = float(np.sum(force**2)), float(np.sum(np.abs(self.response) ** 2))
        if freedom < 1 or not (power > 0 and total > 0):
            return False
        explained = abs(complex(np.sum(force * self.response))) ** 2 / power
        return explained > MIN_SIGNIFICANT_GAIN * max(total - explained, 0.0) / freedom

    def covariance(self, index: NDArray[np.intp], influence: Array) -> tuple[Array, Array]:
        """Return the covariance (q, q) of an estimate by the scatter, and its degrees of freedom (q,).

        A few points may decide a parameter, so that the degrees of freedom are those of a weighted sum of
        variances (F. E. Satterthwaite, Biometrics Bull. 2 (1946) 110), for equal noise at all points.

        Parameters
        ----------
        index
            (k,) fitted rows of the surface.
        influence
            (k, M, q) change of the estimate by a unit of each relative residual: real parts of force,
            fundamental and others, then imaginary parts in the same order; without phases only the
            amplitudes of force and fundamental.
        """
        place = np.full(len(self.count), -1)
        place[index] = np.arange(len(index))
        fitted = (place[self.row] >= 0) & (self.count[self.row] > 1)
        point = place[self.row[fitted]]
        half = (influence.shape[1] + 1) // 2
        moved = np.zeros((int(fitted.sum()), influence.shape[2]))
        parts = [(0, self.force.real), (1, self.response.real)]
        if influence.shape[1] > len(parts):
            parts += [(half, self.force.imag), (half + 1, self.response.imag)]
        # further sensors are last
        for place_of_far, far in enumerate(self.far.T, half - self.far.shape[1]):
            parts += [(place_of_far, far.real), (half + place_of_far, far.imag)]
        expected = np.zeros((len(index), influence.shape[2]))
        for column, part in parts:
            moved += part[fitted, None] * influence[point, column]
            expected += np.mean(part[fitted] ** 2) * influence[:, column] ** 2
        # successive readings share a drift: the error of a mean is that of batch means
        count = self.count[self.row[fitted]]
        batches = np.where(count < _MIN_READINGS_OF_BATCHES, count, np.sqrt(count).round()).astype(np.intp)
        batch = self.place[fitted] * batches // count
        _, sums = np.unique(point * (int(batches.max(initial=0)) + 1) + batch, return_inverse=True)
        scaled = np.stack([np.bincount(sums, column / count) for column in moved.T], axis=1)
        width = np.zeros(len(scaled))
        width[sums] = batches
        scaled *= np.sqrt(width / np.maximum(width - 1, 1))[:, None]
        # rows without repeats are as noisy as the others
        repeated = int(np.count_nonzero(self.count[index] > 1))
        covariance = np.asarray(scaled.T @ scaled * (len(index) / max(repeated, 1)))
        some = np.unique(point)
        own = self.count[index][some]
        freedom = np.where(own < _MIN_READINGS_OF_BATCHES, own, np.sqrt(own).round()) - 1
        variance = expected[some] / own[:, None]
        squares, sums = np.sum(variance**2 / freedom[:, None], axis=0), np.sum(variance, axis=0) ** 2
        return covariance, np.where(squares > 0, sums / np.where(squares > 0, squares, 1.0), 1.0)

    def widen(self, found: Regression, index: NDArray[np.intp]) -> Regression:
        """Return a fit with the covariance by the scatter, but not less than its own.

        What readings of a point share does not show in their scatter, but does in what the law leaves.
        """
        covariance, freedom = self.covariance(index, found.influence)
        covariance[np.isnan(found.covariance)] = np.nan
        times = np.sqrt(np.diag(found.covariance) / np.diag(covariance))
        wider = np.fmax(np.where(np.isfinite(times), times, 1.0), 1.0)
        return found.widened(covariance * np.outer(wider, wider), freedom)


def gather_repeats(surface: ResponseSurface, sensors: str = "") -> tuple[ResponseSurface, Repeats | None]:
    """Replace settled rows of one level, frequency and sweep by their mean.

    Phases are relative to the force of each reading before the average, so that the clock may run on between
    readings. Single rows stay as they are, and so do surfaces whose repeats do not scatter, or whose
    responses depend on the force of each reading. ``sensors`` are those of a motion across.

    Returns
    -------
    surface
        One row a point; joined rows have no peaks.
    repeats
        None if there are too few repeats to estimate the noise, if they do not scatter, or if the responses
        follow the force; of a continuation, too.
    """
    if not len(surface) or surface.control == "continuation":
        # points of a continuation at one frequency are no repeats
        return surface, None
    original, group = surface, _groups(surface)
    kept = ~_outliers(surface, group)
    surface, group = surface.select(kept), group[kept]
    names, first, row, count = np.unique(group, return_index=True, return_inverse=True, return_counts=True)
    if len(surface) - len(names) < _MIN_EXCESS_READINGS:
        return original, None
    clock = np.exp(-1j * np.angle(surface.force))
    harmonics = _relative_phases(surface.harmonics, clock)
    level = np.abs(surface.force)
    mean_force = np.bincount(row, level) / count
    mean = _means(harmonics, row, count)
    with np.errstate(all="ignore"):
        force = np.nan_to_num(level / mean_force[row] - 1).astype(np.complex128)
        response = np.nan_to_num(harmonics[:, 1] / mean[row, 1] - 1)
    later = np.argsort(row, kind="stable")
    nth = np.empty(len(row), dtype=np.intp)
    nth[later] = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    repeats = Repeats(
        row, nth, count, force, response, np.zeros((len(row), 0), dtype=complex), len(original) - len(surface)
    )
    if repeats.noise < ROUND_OFF or repeats.follow_force:
        return original, None
    table = surface.select(first)
    joined = count > 1
    forces = _means(_relative_phases(surface.force_harmonics, clock), row, count)
    forces[:, 1] = mean_force
    across = _relative_phases(surface.across, clock)
    means = replace(
        table,
        force=np.where(joined[:, None], forces, table.force_harmonics),
        across=np.where(joined[:, None], _means(across, row, count), table.across),
        harmonics=np.where(joined[:, None], mean, table.harmonics),
        peak=np.where(joined[:, None], np.nan, table.peak),
    )
    moved = across[:, 1:2] - response_share(sensors) * harmonics[:, 1:2]
    far = np.nan_to_num(moved / _means(moved, row, count)[row] - 1)
    order = np.argsort(first, kind="stable")
    place = np.argsort(order, kind="stable")
    return means.select(order), replace(repeats, far=far, row=place[row], count=count[order])


def _relative_phases(
    harmonics: NDArray[np.complex128], clock: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return harmonics (n, H+1) with phases relative to the fundamental of the clock (n,)."""
    return np.asarray(harmonics * clock[:, None] ** np.arange(harmonics.shape[1]))


def _means(
    harmonics: NDArray[np.complex128], row: NDArray[np.intp], count: NDArray[np.intp]
) -> NDArray[np.complex128]:
    """Return the means (k, H+1) of the readings (r, H+1) of each row."""
    means = np.zeros((len(count), harmonics.shape[1]), dtype=np.complex128)
    for mean, h in zip(means.T, harmonics.T, strict=True):
        mean += (np.bincount(row, h.real) + 1j * np.bincount(row, h.imag)) / count
    return means


def _groups(surface: ResponseSurface) -> NDArray[np.intp]:
    """Return the number (n,) of the point of each row; a row that has no repeats has its own."""
    order = np.lexsort((surface.frequency, surface.sweep, surface.level))
    frequency, level, sweep = (getattr(surface, name)[order] for name in ("frequency", "level", "sweep"))
    rises = np.diff(frequency) > FILE_ROUND_OFF * frequency[1:]
    new = rises | (level[1:] != level[:-1]) | (sweep[1:] != sweep[:-1])
    group = np.empty(len(surface), dtype=np.intp)
    group[order] = np.concatenate([[0], np.cumsum(new)])
    size = surface.amplitude
    good = surface.settled & np.isfinite(size) & (size > 0) & (np.abs(surface.force) > 0)
    smallest, largest = _range_of(size[good], group[good], group.max() + 1)
    alone = ~good | (largest > MIN_JUMP_RATIO * smallest)[group]
    # motions in two wells, or mirror images after symmetry breaking, have one amplitude and no mean
    clock = np.exp(-1j * np.angle(surface.force))
    for even in range(0, min(3, surface.harmonics.shape[1]), 2):
        own = np.nan_to_num(surface.harmonics[:, even] * clock**even)
        for part in (own.real, own.imag):
            low, high = _range_of(part[good], group[good], group.max() + 1)
            with np.errstate(invalid="ignore"):
                alone |= ~(high - low <= ASYMMETRIC * largest)[group]
    group[alone] = group.max() + 1 + np.arange(int(alone.sum()))
    return group


def _range_of(values: Array, group: NDArray[np.intp], count: int) -> tuple[Array, Array]:
    """Return the smallest and the largest of the values in each of so many groups; infinite of none."""
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, group, values)
    np.maximum.at(high, group, values)
    return low, high


_MIN_SHARE_KEPT = 0.8
"""Share of the readings of a point, those nearest to the median, that are never outliers; a fit excludes
points by ``MAX_SHARE_OF_OUTLIERS``."""


def _outliers(surface: ResponseSurface, group: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return the mask (n,) of readings that are far from the others of their point."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = surface.harmonics[:, 1] / surface.force
    far = np.zeros(len(group), dtype=bool)
    names, count = np.unique(group, return_counts=True)
    for name in names[count >= _MIN_READINGS_OF_BATCHES]:
        rows = np.flatnonzero(group == name)
        own = ratio[rows]
        distance = np.abs(own - complex(np.median(own.real), np.median(own.imag)))
        kept = float(np.quantile(distance, _MIN_SHARE_KEPT))
        far[rows] = distance > max(_MAX_MEDIAN_DISTANCES * float(np.median(distance)), kept)
    return far
