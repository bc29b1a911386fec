"""The test points that take part, and repeats of a point joined to their mean.

The misfit of a law contains what the law cannot do; the scatter of repeats does not. So repeats separate the
two, and standard errors say how far the estimates would move if the test were done again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import RsgenError
from rsgen.identification.least_squares import Regression
from rsgen.identification.tolerances import OUTLIERS, ROUND_OFF
from rsgen.motion import Motion
from rsgen.oscillator import Model
from rsgen.surface import OUTCOMES, ResponseSurface, match_level

__all__ = [
    "JUMP",
    "Points",
    "Repeats",
    "gather_repeats",
    "held_out_mask",
    "select_points",
    "with_repeats",
]

Array = NDArray[np.float64]

_ASYMMETRIC = 0.2
"""Mean or higher harmonic, relative to the amplitude, that a motion near a centred sine does not have."""

_SOME = 3
"""At least as many points are no accident."""

JUMP = 1.5
"""Amplitudes of a larger ratio lie on either side of a jump: repeats of it have no mean."""

_SAME = 1e-6
"""Frequencies that differ by less, relatively, are one."""

_FEWEST = 4
"""Points: a mass, a spring and a damper, and one to disagree with them."""


_RANGE = (1e-60, 1e60)
"""Sizes of force, response and frequency in SI units: their fourth powers are still numbers, and nothing
measured is near."""

_BATCHED = 6
"""At least this many repeats are split into as many batches as the square root of their number."""

_FAR = 10.0
"""Readings farther than this many median distances from the median are outliers."""

_ENOUGH = 20
"""Readings more than points from which on the scatter is a measure of the noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """What the fits see of a surface.

    Parameters
    ----------
    index
        (n,) rows of the surface.
    level, omega
        (n,) nominal force amplitude [N] and angular frequency [rad/s].
    sweep
        (n,) "rest", "up", "down".
    force
        (n,) complex amplitude of the measured force [N].
    harmonics
        (n, H+1) complex displacement [m].
    measured
        Harmonics (0 for the mean) that the test measured; others are all zero in the table.
    peak
        (n, 2) largest and smallest displacement [m], NaN where unknown.
    """

    index: NDArray[np.intp]
    level: NDArray[np.float64]
    omega: NDArray[np.float64]
    sweep: NDArray[np.str_]
    force: NDArray[np.complex128]
    harmonics: NDArray[np.complex128]
    measured: tuple[int, ...]
    peak: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.omega)

    @property
    def motion(self) -> Motion:
        """Harmonics over their frequencies."""
        return Motion(self.omega, self.harmonics)

    @property
    def amplitude(self) -> NDArray[np.float64]:
        """(n,) X [m]."""
        return np.abs(self.harmonics[:, 1])

    @property
    def asymmetric(self) -> bool:
        """Whether some motions have a mean or a second harmonic that no noise explains."""
        even = np.abs(self.harmonics[:, 0:3:2]).max(axis=1) / self.amplitude
        return int(np.count_nonzero(even > _ASYMMETRIC)) >= _SOME

    @property
    def strong(self) -> bool:
        """Whether some motions are so far from a sine that a balance of few harmonics may miss them."""
        higher = np.abs(self.harmonics[:, 2:]).max(axis=1, initial=0.0) / self.amplitude
        return int(np.count_nonzero(higher > _ASYMMETRIC)) >= _SOME

    @property
    def neighbours(self) -> NDArray[np.intp]:
        """(k, 2) pairs next to each other in frequency within one level and sweep."""
        order = np.lexsort((self.omega, self.sweep, self.level))
        same = (self.level[order][1:] == self.level[order][:-1]) & (
            self.sweep[order][1:] == self.sweep[order][:-1]
        )
        return np.stack([order[:-1][same], order[1:][same]], axis=1)

    def select(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Points:
        """Keep some points."""
        return Points(
            self.index[chosen],
            self.level[chosen],
            self.omega[chosen],
            self.sweep[chosen],
            self.force[chosen],
            self.harmonics[chosen],
            self.measured,
            self.peak[chosen],
        )

    def spread(self, count: int) -> NDArray[np.intp]:
        """Choose about ``count`` points evenly over the amplitude: a quick picture of the whole test."""
        if len(self) <= count:
            return np.arange(len(self))
        order = np.lexsort((self.omega, self.amplitude))
        return np.sort(order[np.linspace(0, len(self) - 1, count).round().astype(np.intp)])


def held_out_mask(surface: ResponseSurface, model: Model) -> NDArray[np.bool_]:
    """(n,) True where a point belongs to a level that identification must not see."""
    meant = [match_level(surface.levels, level) for level in model.observation.hold_out]
    return np.isin(surface.level, [level for level in meant if level is not None])


def _why_unused(surface: ResponseSurface) -> str:
    """Count what keeps points out, in words."""
    reasons = [
        f"{count} {sentence}"
        for kind, sentence in enumerate(OUTCOMES)
        if kind and (count := int(np.count_nonzero(surface.outcome == kind)))
    ]
    still = int(np.count_nonzero(surface.settled & (surface.amplitude == 0)))
    if still:
        reasons.append(f"{still} do not move: friction holds the mass at these levels")
    return f" ({'; '.join(reasons)})" if reasons else ""


def select_points(surface: ResponseSurface, model: Model) -> Points:
    """Take the points that identification may use.

    Raises
    ------
    RsgenError
        A held-out level is not in the surface, or fewer than four points remain.
    """
    for level in model.observation.hold_out:
        if match_level(surface.levels, level) is None:
            unit = surface.level_unit
            known = ", ".join(f"{value:g}" for value in surface.levels)
            raise RsgenError(f"hold_out: no level {level:g} {unit} in the surface; it has {known} {unit}")
    harmonics = np.array(surface.harmonics)
    higher = ~np.isfinite(harmonics)
    higher[:, 1] = False
    harmonics[higher] = 0
    good = (
        surface.settled
        & ~held_out_mask(surface, model)
        & np.isfinite(harmonics[:, 1])
        & np.isfinite(surface.force)
        & (np.abs(harmonics[:, 1]) > 0)
        & (np.abs(surface.force) > 0)
    )
    if model.observation.band is not None:
        low, high = model.observation.band
        good &= (surface.frequency >= low) & (surface.frequency <= high)
    index = np.flatnonzero(good)
    for name, size in (
        ("force", surface.force),
        ("response", surface.amplitude),
        ("frequency", surface.omega),
    ):
        low, high = _RANGE
        far = index[(np.abs(size[index]) < low) | (np.abs(size[index]) > high)]
        if len(far):
            found = f"{np.abs(size[far[0]]):g} in row {far[0]}"
            raise RsgenError(f"surface.{name}: {found}; must be {low:g} to {high:g} in SI units")
    if len(index) < _FEWEST:
        raise RsgenError(
            f"surface: {len(index)} of {len(surface)} points can be used (settled, not held out, in the "
            f"band, finite force and response); identification needs at least {_FEWEST}{_why_unused(surface)}"
        )
    chosen = harmonics[index]
    measured = tuple(int(h) for h in range(chosen.shape[1]) if h == 1 or np.any(chosen[:, h] != 0))
    return Points(
        index,
        surface.level[index],
        surface.omega[index],
        surface.sweep[index],
        surface.force[index],
        chosen,
        measured,
        surface.peak[index],
    )


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
    force, response
        (r,) complex relative deviation of force and fundamental from their means [1].
    aside
        Readings left out because they lie far off the others of their point.
    """

    row: NDArray[np.intp]
    place: NDArray[np.intp]
    count: NDArray[np.intp]
    force: NDArray[np.complex128]
    response: NDArray[np.complex128]
    aside: int

    @property
    def noise(self) -> float:
        """Relative noise of one reading, force and response together [1]."""
        freedom = len(self.row) - len(np.unique(self.row))
        return float(np.sqrt(np.sum(np.abs(self.force) ** 2 + np.abs(self.response) ** 2) / max(freedom, 1)))

    def covariance(self, index: NDArray[np.intp], influence: Array) -> Array:
        """Covariance (q, q) that the scatter causes in an estimate.

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
        for column, part in parts:
            moved += part[fitted, None] * influence[point, column]
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
        return np.asarray(scaled.T @ scaled * (len(index) / max(repeated, 1)))


def gather_repeats(surface: ResponseSurface) -> tuple[ResponseSurface, Repeats | None]:
    """Join settled rows of one level, frequency and sweep to their mean.

    The phase counts from the force before it is averaged, so that a clock that runs on between readings does
    no harm. Rows that have no repeat, and surfaces whose repeats do not scatter, stay as they are.

    Returns
    -------
    surface
        One row a point; joined rows lose what only one reading has (peaks).
    repeats
        None where there are too few repeats to tell the noise.
    """
    if not len(surface):
        return surface, None
    given, group = surface, _groups(surface)
    kept = ~_unsettled(surface, group)
    whole, surface, group = len(surface), surface.select(kept), group[kept]
    names, row, count = np.unique(group, return_inverse=True, return_counts=True)
    if len(surface) - len(names) < _ENOUGH:
        return given, None
    clock = np.exp(-1j * np.angle(surface.force))
    orders = np.arange(surface.harmonics.shape[1])
    harmonics = surface.harmonics * clock[:, None] ** orders
    level = np.abs(surface.force)
    mean_force = np.bincount(row, level) / count
    mean = np.stack(
        [(np.bincount(row, h.real) + 1j * np.bincount(row, h.imag)) / count for h in harmonics.T], axis=1
    )
    with np.errstate(all="ignore"):
        force = np.nan_to_num(level / mean_force[row] - 1).astype(np.complex128)
        response = np.nan_to_num(harmonics[:, 1] / mean[row, 1] - 1)
    later = np.argsort(row, kind="stable")
    nth = np.empty(len(row), dtype=np.intp)
    nth[later] = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    repeats = Repeats(row, nth, count, force, response, whole - len(surface))
    if repeats.noise < ROUND_OFF:
        return given, None
    first = np.zeros(len(names), dtype=np.intp)
    first[row[::-1]] = np.arange(len(surface))[::-1]
    table = surface.select(first)
    joined = count > 1
    means = replace(
        table,
        force=np.where(joined, mean_force, table.force),
        harmonics=np.where(joined[:, None], mean, table.harmonics),
        peak=np.where(joined[:, None], np.nan, table.peak),
    )
    order = np.argsort(first, kind="stable")
    place = np.argsort(order, kind="stable")
    return means.select(order), replace(repeats, row=place[row], count=count[order])


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
                alone |= ~(high - low <= _ASYMMETRIC * largest)[group]
    group[alone] = group.max() + 1 + np.arange(int(alone.sum()))
    return group


def _unsettled(surface: ResponseSurface, group: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(n,) True for readings that lie far off the others of their point."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = surface.harmonics[:, 1] / surface.force
    far = np.zeros(len(group), dtype=bool)
    order = np.argsort(group, kind="stable")
    edges = np.flatnonzero(np.diff(group[order])) + 1
    for rows in np.split(order, edges):
        if len(rows) < _BATCHED:
            continue
        own = ratio[rows]
        distance = np.abs(own - complex(np.median(own.real), np.median(own.imag)))
        limit = max(_FAR * float(np.median(distance)), float(np.quantile(distance, 1 - OUTLIERS)))
        far[rows] = distance > limit
    return far


def with_repeats(regression: Regression, points: Points, repeats: Repeats | None) -> Regression:
    """Give a regression the covariance that repeats show, where there are any."""
    if repeats is None:
        return regression
    covariance = repeats.covariance(points.index, regression.influence)
    covariance[np.isnan(regression.covariance)] = np.nan
    return replace(regression, covariance=covariance)
