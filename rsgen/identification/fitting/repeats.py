"""Repeats of a point joined to their mean.

The misfit of a law contains what the law cannot do and what the readings of a point share; the scatter of
repeats contains what drifts from one to the next. Repeats tell them apart, and standard errors are those of
the larger.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.tolerances import OUTLIERS, ROUND_OFF, SIGNIFICANT
from rsgen.data.surface import ResponseSurface
from rsgen.identification.fitting.points import ASYMMETRIC
from rsgen.law.element import response_share

JUMP = 1.5
"""Amplitudes of a larger ratio lie on either side of a jump: repeats of it have no mean."""

_SAME = 1e-6
"""Frequencies that differ by less, relatively, are one."""

_BATCHED = 6
"""At least this many repeats are split into as many batches as the square root of their number."""

_FAR = 10.0
"""Readings farther than this many median distances from the median are outliers."""

_ENOUGH = 20
"""Readings more than points from which on the scatter is a measure of the noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Repeats:
    """Readings of the points of a surface of means, relative to those means.

    Parameters
    ----------
    row
        (r,) row of the surface of means that a reading belongs to.
    place
        (r,) which reading of its row it is, from 0, in the order of the test.
    count
        (n,) readings of each row.
    force, response, far
        (r,) complex relative deviation of the fundamentals of force and response, (r, E-1) of those of
        further sensors, from their means [1].
    aside
        Readings left out because they lie far off the others of their point.
    """

    row: NDArray[np.intp]
    place: NDArray[np.intp]
    count: NDArray[np.intp]
    force: NDArray[np.complex128]
    response: NDArray[np.complex128]
    far: NDArray[np.complex128]
    aside: int

    @property
    def noise(self) -> float:
        """Relative noise of one reading, force and response together [1]."""
        freedom = len(self.row) - len(np.unique(self.row))
        return float(np.sqrt(np.sum(np.abs(self.force) ** 2 + np.abs(self.response) ** 2) / max(freedom, 1)))

    @property
    def follow_force(self) -> bool:
        """Whether responses follow the forces of the readings, so that each is a point of its own.

        As in S-curves, where a force is raised in small steps, or where it fluctuates by itself. Where only
        the sensors scatter, both deviate independently, and a slope of one over the other brings nothing.
        """
        force = self.force.real
        freedom = len(self.row) - len(self.count) - 1
        power, total = float(np.sum(force**2)), float(np.sum(np.abs(self.response) ** 2))
        if freedom < 1 or not (power > 0 and total > 0):
            return False
        explained = abs(complex(np.sum(force * self.response))) ** 2 / power
        return explained > SIGNIFICANT * max(total - explained, 0.0) / freedom

    def covariance(self, index: NDArray[np.intp], influence: Array) -> tuple[Array, Array]:
        """Covariance (q, q) that the scatter causes in an estimate, and degrees of freedom (q,).

        A few points may decide a parameter, so that the freedom is that of a weighted sum of variances, each
        of the size that equal noise at all points makes
        (F. E. Satterthwaite, Biometrics Bull. 2 (1946) 110).

        Parameters
        ----------
        index
            (k,) rows of the surface that were fitted.
        influence
            (k, M, q) change of the estimate by a unit of each residual: real parts of force, fundamental and
            others, then imaginary parts in the same order, relative to their sizes; without a phase only
            the amplitudes of force and fundamental.
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
        # those of further sensors are the last
        for place_of_far, far in enumerate(self.far.T, half - self.far.shape[1]):
            parts += [(place_of_far, far.real), (half + place_of_far, far.imag)]
        expected = np.zeros((len(index), influence.shape[2]))
        for column, part in parts:
            moved += part[fitted, None] * influence[point, column]
            expected += np.mean(part[fitted] ** 2) * influence[:, column] ** 2
        # readings in a row share what drifts, so a mean is as sure as the means of its batches agree
        count = self.count[self.row[fitted]]
        batches = np.where(count < _BATCHED, count, np.sqrt(count).round()).astype(np.intp)
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
        each = np.where(own < _BATCHED, own, np.sqrt(own).round()) - 1
        return covariance, _freedom(expected[some] / own[:, None], each)


def _freedom(variance: Array, each: Array) -> Array:
    """(q,) degrees of freedom of sums of the variances (n, q) of n points, ``each`` (n,) those of one."""
    squares = np.sum(variance**2 / each[:, None], axis=0)
    sums = np.sum(variance, axis=0) ** 2
    return np.where(squares > 0, sums / np.where(squares > 0, squares, 1.0), 1.0)


def gather_repeats(surface: ResponseSurface, sensors: str = "") -> tuple[ResponseSurface, Repeats | None]:
    """Join settled rows of one level, frequency and sweep to their mean.

    The phase counts from the force before it is averaged, so that a clock that runs on between readings does
    no harm. Rows that have no repeat stay as they are, and so do surfaces whose repeats do not scatter, or
    whose responses follow the force from reading to reading. ``sensors`` are those of a motion across.

    Returns
    -------
    surface
        One row a point; joined rows lose what only one reading has (peaks).
    repeats
        None where there are too few repeats to tell the noise, and where they are none.
    """
    if not len(surface) or surface.control == "continuation":
        # what a continuation passes at one frequency are points of their own
        return surface, None
    given, group = surface, _groups(surface)
    kept = ~_unsettled(surface, group)
    whole, surface, group = len(surface), surface.select(kept), group[kept]
    names, row, count = np.unique(group, return_inverse=True, return_counts=True)
    if len(surface) - len(names) < _ENOUGH:
        return given, None
    clock = np.exp(-1j * np.angle(surface.force))
    harmonics = _turned(surface.harmonics, clock)
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
        row, nth, count, force, response, np.zeros((len(row), 0), dtype=complex), whole - len(surface)
    )
    if repeats.noise < ROUND_OFF or repeats.follow_force:
        return given, None
    first = np.zeros(len(names), dtype=np.intp)
    first[row[::-1]] = np.arange(len(surface))[::-1]
    table = surface.select(first)
    joined = count > 1
    forces = _means(_turned(surface.force_harmonics, clock), row, count)
    forces[:, 1] = mean_force
    across = _turned(surface.across, clock)
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


def _turned(harmonics: NDArray[np.complex128], clock: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Count the phases of harmonics (n, H+1) from that of the clock's fundamental (n,)."""
    return np.asarray(harmonics * clock[:, None] ** np.arange(harmonics.shape[1]))


def _means(
    harmonics: NDArray[np.complex128], row: NDArray[np.intp], count: NDArray[np.intp]
) -> NDArray[np.complex128]:
    """(k, H+1) means of the readings (r, H+1) of each row."""
    means = np.zeros((len(count), harmonics.shape[1]), dtype=np.complex128)
    for mean, h in zip(means.T, harmonics.T, strict=True):
        mean += (np.bincount(row, h.real) + 1j * np.bincount(row, h.imag)) / count
    return means


def _groups(surface: ResponseSurface) -> NDArray[np.intp]:
    """(n,) number of the point that each row is a reading of; other rows have a number of their own."""
    order = np.lexsort((surface.frequency, surface.sweep, surface.level))
    frequency, level, sweep = (getattr(surface, name)[order] for name in ("frequency", "level", "sweep"))
    new = (np.diff(frequency) > _SAME * frequency[1:]) | (level[1:] != level[:-1]) | (sweep[1:] != sweep[:-1])
    group = np.empty(len(surface), dtype=np.intp)
    group[order] = np.concatenate([[0], np.cumsum(new)])
    size = surface.amplitude
    good = surface.settled & np.isfinite(size) & (size > 0) & (np.abs(surface.force) > 0)
    smallest = np.full(group.max() + 1, np.inf)
    largest = np.zeros(group.max() + 1)
    np.minimum.at(smallest, group[good], size[good])
    np.maximum.at(largest, group[good], size[good])
    alone = ~good | (largest > JUMP * smallest)[group]
    # one of two wells, or of two broken symmetries: as large, but a mirror image
    clock = np.exp(-1j * np.angle(surface.force))
    for even in range(0, min(3, surface.harmonics.shape[1]), 2):
        own = np.nan_to_num(surface.harmonics[:, even] * clock**even)
        for part in (own.real, own.imag):
            low, high = np.full(group.max() + 1, np.inf), np.full(group.max() + 1, -np.inf)
            np.minimum.at(low, group[good], part[good])
            np.maximum.at(high, group[good], part[good])
            with np.errstate(invalid="ignore"):
                alone |= ~(high - low <= ASYMMETRIC * largest)[group]
    group[alone] = group.max() + 1 + np.arange(int(alone.sum()))
    return group


def _unsettled(surface: ResponseSurface, group: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(n,) True for readings that lie far off the others of their point."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = surface.harmonics[:, 1] / surface.force
    far = np.zeros(len(group), dtype=bool)
    names, count = np.unique(group, return_counts=True)
    for name in names[count >= _BATCHED]:
        rows = np.flatnonzero(group == name)
        own = ratio[rows]
        distance = np.abs(own - complex(np.median(own.real), np.median(own.imag)))
        limit = max(_FAR * float(np.median(distance)), float(np.quantile(distance, 1 - OUTLIERS)))
        far[rows] = distance > limit
    return far
