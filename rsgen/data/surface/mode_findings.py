"""Findings by the mode of a test: exchanged levels or channels, another derivative, another unit of mass."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import pairwise
from math import nan, pi
from typing import Any

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.tolerances import (
    HELD_OUT_ERROR_SMALL,
    MIN_MISFIT_REDUCTION,
    MISFIT_EXPLAINED,
    MISFIT_NEGLIGIBLE,
    MISFIT_REJECTED,
    RELATIVE_ERROR_DOUBTFUL,
)
from rsgen.data.free_mode import Kinematics, estimate_mass, fit_mode, hats, steady
from rsgen.data.history.record import MAX_LEVEL_SPREAD
from rsgen.data.record_set import LEVEL_TOLERANCE, MIN_POINTS_OF_RUN
from rsgen.data.surface.columns import group_forces
from rsgen.data.surface.plausibility import COMMON_FACTORS, driven_points, nearest_factor, usable_points
from rsgen.data.surface.response_surface import HALF_POWER, ResponseSurface, without_copies

_FACTORS_OF_MASS = {
    "pound": 1 / 0.45359237, "pound-force": 4.4482216, "inch": 25.4, "hundred": 100.0, "million": 1e6,
    "turn": 2 * pi,
}  # fmt: skip
"""Further factors by which a mass is wrong if its unit, or that of another quantity, is misread."""

_CODES_OF_LEVELS = ("levels-swapped", "levels-disagree", "level-deviates")
_CODES_OF_SIGNALS = ("another-quantity", "base-misread", "fixed-contradicted", "mass-negative")
_MIN_LEVELS = 3
"""Of two levels each has only the other one to contradict it."""

_MIN_POINTS = 12
"""Fewer are fitted by nearly any curves."""

MASS_IN_OTHER_UNIT = 4.3
"""Factor between a given mass and that of a test from which units differ: with another mode near a band below
the resonance, masses of one mode were off by up to 4.1 at a misfit that explains the points."""

_MASS_MISREAD = 1.5
"""Factor from which no balance and no added sensor explains the difference, but a unit or another factor."""

_MISFIT_OF_EXCHANGE = 0.03
"""Least misfit of any curves where few speak for an exchange: two sound levels next to a gap left 1.2 %, and
0.4 % when exchanged; with each other's responses they left 4.4 %."""


def mode_findings(
    surface: ResponseSurface,
    mass: float | None,
    known: Iterable[Finding] = (),
    fits: bool | None = None,
) -> list[Finding]:
    """Return what is known, and that levels, channels or a mass [kg] were misread; one more or none.

    Nothing is found where it is known that the response, the base or the mass was misread, and nothing of
    levels where a law fits as they were read (``fits``; None where there is no law). What is known of other
    levels follows from one that was misread, and goes.
    """
    test, known = surface.select(driven_points(surface)), list(known)
    other = surface.decays or np.isfinite(surface.across).any() or surface.control == "phase"
    said = {
        f.code
        for f in (*surface.findings, *known)
        if f.code in _CODES_OF_SIGNALS and f.parameter in ("", "m")
    }
    # an exchange of levels may be what makes the mass negative
    if said - {"mass-negative"} or other or len(test) < _MIN_POINTS:
        return known
    shaken = surface.base or surface.per_mass
    if not (fits or shaken):
        # any curves are less than a law that is known not to fit, and two levels less than more
        floors = (MISFIT_NEGLIGIBLE, _MISFIT_OF_EXCHANGE, MISFIT_REJECTED)
        floor = floors[(fits is None) + (len(test.levels) < _MIN_LEVELS)]
        if swapped := _swapped(test, floor):
            return [*known, *swapped]
    inertia = 1.0 if surface.per_mass else nan if mass is None or not surface.base else mass
    if not fits and (misread := _misread_level(test, inertia)):
        return [*(one for one in known if one.code not in _CODES_OF_LEVELS), *misread]
    if said or shaken:
        return known
    force, motion = steady(test.force, test.harmonics[:, 1], test.omega)
    swapped = exchanged_channels(force, motion, test.omega, held=surface.response_held)
    return [*known, *(swapped or ([] if mass is None else _of_mass(force, motion, mass)))]


def _typical_misfit(force: ComplexArray, motion: Kinematics, mass: float = nan) -> tuple[float, bool]:
    """Return the median misfit of free curves, relative to the force, and whether m, k and c are positive."""
    found = fit_mode(force, motion, hats(np.abs(motion.displacement)), 1 / np.abs(force), mass=mass)
    return float(np.median(np.abs(found.left))), all(found.passive)


def is_beyond_any_law(force: ComplexArray, response: ComplexArray, omega: Array) -> bool:
    """Return True if no mass and curves k(X), c(X) leave less than half of the force (n,) at most points.

    Right tests of every law, with noise up to 3 %, leave at most a tenth; noise or rows in disorder 0.8.
    """
    misfit, _ = _typical_misfit(*steady(force, response, omega))
    return len(force) >= _MIN_POINTS and misfit > 1 - MIN_MISFIT_REDUCTION


def _swapped(test: ResponseSurface, floor: float) -> list[Finding]:
    """Find two neighbouring levels with each other's responses per force; the level stands for the force.

    The response then seems to grow with the force, so that only the curves k(X) and c(X) show it.
    """
    force, response, level, levels = test.force, test.harmonics[:, 1], test.level, test.levels
    if len(levels) < 2 or not np.allclose(np.abs(force), level, atol=0):
        return []
    left = {}
    for low, high in [(levels[0], levels[0]), *pairwise(levels)]:
        by = np.where(level == low, high / low, np.where(level == high, low / high, 1.0))
        left[low, high] = _typical_misfit(*steady(by * force, by * response, test.omega))[0]
    misfit, (low, high) = left[levels[0], levels[0]], min(left, key=left.__getitem__)
    # virtual tests in order, with noise of 1 % and without, left 0.96 or more when exchanged
    if misfit < floor or left[low, high] > (1 - MIN_MISFIT_REDUCTION) * misfit:
        return []
    numbers = quantities("N", low=low, high=high) | quantities(misfit=misfit, then=left[low, high])
    return [Finding("levels-swapped", "doubt", "", numbers)]


def _misread_level(test: ResponseSurface, mass: float) -> list[Finding]:
    """Find the one level of several whose channels were read otherwise than those of the others; none or one.

    Free curves explain the others alone, and all levels where that one is read in another way. The mass [kg]
    is NaN where it is free.
    """
    force, response, omega, level = test.force, test.harmonics[:, 1], test.omega, test.level
    levels, counts = np.unique(level, return_counts=True)

    def fit(pushed: ComplexArray, moved: ComplexArray, without: float = nan) -> tuple[bool, float]:
        """Return whether m, k or c is negative, and the largest of the median misfits of all levels."""
        chosen = level != without
        shapes, motion = hats(np.abs(moved[chosen])), steady(pushed[chosen], moved[chosen], omega[chosen])
        found = fit_mode(*motion, shapes, 1 / np.abs(pushed[chosen]), mass=mass)
        left = np.abs(found.left)
        typical = [np.median(left[level[chosen] == one]) for one in levels if one != without]
        return not all(found.passive), float(max(typical))

    if len(levels) < _MIN_LEVELS or (test.base and np.isnan(mass)):
        return []
    negative, misfit = fit(force, response)
    left = [fit(force, response, one)[1] for one in levels]
    place, enough = int(np.argmin(left)), (1 - MIN_MISFIT_REDUCTION) * min(misfit, MISFIT_REJECTED)
    right = misfit < MISFIT_REJECTED and not negative
    if right or left[place] > enough or counts[place] < MIN_POINTS_OF_RUN:
        return []
    here, fits = level == levels[place], list[tuple[bool, float, str, float]]()
    for name, pushed, moved in _readings(test, mass):
        found = fit(np.where(here, pushed, force), np.where(here, moved, response))
        fits.append((*found, name, float(np.abs(response / moved)[here][0])))
    negative, then, name, gain = min(fits)
    if negative or then > enough:
        return []
    numbers = quantities(test.level_unit, level=levels[place]) | quantities(misfit=misfit, then=then)
    if name in COMMON_FACTORS:
        return [Finding("levels-disagree", "doubt", "", numbers | quantities(gain=gain), {"near": name})]
    return [Finding("another-quantity", "doubt", "", numbers, {"is": name, "sure": "yes"})]


def _readings(test: ResponseSurface, mass: float) -> list[tuple[str, ComplexArray, ComplexArray]]:
    """Return what channels may be: a name, force and response (n,) that they then are."""
    force, response, omega = test.force, test.harmonics[:, 1], test.omega
    pairs = list(_exchanged(force, response, omega))
    motions = {"sign": [-response], "sense": [force * np.conj(response / force)]}
    motions |= {f"{order:+d}": [response / (1j * omega) ** order] for order in (-2, -1, 1, 2)}
    motions |= {name: [response / by, response * by] for name, by in COMMON_FACTORS.items()}
    if test.base:
        # the motion is the absolute one minus that of the base, or was measured
        inertia, base = mass * omega**2, force / (mass * omega**2)
        pairs = [(inertia * (response + base), -response), (inertia * response, base)]
        motions = {"sign": [-response - 2 * base, -response]}
    others = [(name, force, moved) for name, either in motions.items() for moved in either]
    return [*others, *(("exchanged", *pair) for pair in pairs)]


def _exchanged(
    force: ComplexArray, response: ComplexArray, omega: Array
) -> Iterator[tuple[ComplexArray, ComplexArray]]:
    """Yield force and response (n,) of channels that were read as each other, up to accelerations."""
    phase = np.angle(response / force)
    for order in range(3):
        pushed = np.abs(response) * omega**order
        for turn in (phase, -phase - order * pi):
            yield pushed.astype(complex), np.abs(force) / omega**order * np.exp(1j * turn)


def derivative_findings(seen: ComplexArray, own: ComplexArray) -> list[Finding]:
    """Find that a motion is another derivative than it was read as, by its third harmonic and that of a law.

    A derivative has the third harmonic -3 times, relative to the fundamental. Where a law has much of it and
    where it has little the motion must have nearly the same power of -3 times as much, and little else.

    Parameters
    ----------
    seen, own
        (n, H+1) harmonics of the motion, and of the law's motion at the same amplitudes and phases.
    """
    if min(seen.shape[1], own.shape[1]) < 4:
        return []
    falling = np.argsort(-np.abs(seen[:, 1]))
    seen, own = seen[falling, 3], own[falling, 3]
    power = np.cumsum(np.abs(own) ** 2)
    half = int(np.searchsorted(power, power[-1] / 2)) + 1
    parts = (slice(None), slice(half), slice(half, None))
    with np.errstate(all="ignore"):
        # NaN where the law has none
        times = np.array([np.vdot(own[part], seen[part]) / np.vdot(own[part], own[part]) for part in parts])
        off = {order: np.abs(np.log(times / (-3.0) ** order)) for order in (-2, -1, 1, 2)}
    order = min(off, key=lambda one: float(off[one][0]))
    left = np.linalg.norm(seen - times[0] * own) / np.linalg.norm(seen)
    # within twice that another mode near three times the frequency came in 3 of 720 virtual decays
    if not (np.all(off[order] < np.log(3) / 4) and left < 1 - MIN_MISFIT_REDUCTION):
        return []
    numbers, names = quantities(harmonic=times[0].real), {"is": f"{order:+d}", "sure": "yes"}
    return [Finding("another-quantity", "doubt", "", numbers, names)]


def exchanged_channels(
    force: ComplexArray, motion: Kinematics, omega: Array, *, held: bool = False, share: float = 0.0
) -> list[Finding]:
    """Find that each channel was read as the other one; a column of phases stays that of the response.

    ``held`` is True where the test held the response; ``share`` is what the other reading may leave of
    what this one does, of lines among which a law distorts.
    """
    misfit, taken = _typical_misfit(force, motion)
    if taken and misfit < MISFIT_REJECTED:
        return []
    then, varies = np.inf, np.std(np.log(np.abs(force)))
    for pushed, moved in _exchanged(force, motion.displacement, omega):
        # as a force it would vary more than what it drives
        if held or np.std(np.log(np.abs(pushed))) <= varies:
            left, passive = _typical_misfit(*steady(pushed, moved, omega))
            then = min(then, left) if passive else then
    # next to a reading that takes no energy any is better; a fast sweep was corrected by the wrong channel
    if then > max(MISFIT_EXPLAINED if taken else RELATIVE_ERROR_DOUBTFUL, share * misfit):
        return []
    numbers = quantities(then=then) | (quantities(misfit=misfit) if misfit > then else {})
    names = {"is": "exchanged", "sure": "yes"}
    return [Finding("another-quantity", "doubt", "", numbers, names)]


def _of_mass(force: ComplexArray, motion: Kinematics, given: float) -> list[Finding]:
    free = estimate_mass(force, motion)
    if free is None or not free.mass > 0 or abs(np.log(free.mass / given)) < np.log(MASS_IN_OTHER_UNIT):
        return []
    (left, _), (misfit, _) = (_typical_misfit(force, motion, mass) for mass in (free.mass, given))
    if left > min(MISFIT_EXPLAINED, misfit / 2):
        return []
    moved = free.mass - given
    times = abs(moved) / max(free.mass_error, np.finfo(float).tiny)
    found = fixed_contradicted("m", given, moved, misfit=misfit, left=left, times=times)
    return [replace(found, names={**found.names, "by": "any law"})]


def fixed_contradicted(
    name: str,
    given: float,
    moved: float,
    *,
    misfit: float,
    times: float,
    left: float = nan,
    error: float = 0.0,
) -> Finding:
    """Doubt a given value that the test moves by so much, so many standard errors, to leave less misfit.

    One that was given with an ``error`` is compared with the value that the test alone shows.
    A mass that is negative then is no other mass, but a channel with the other sign.
    """
    if name == "m" and given + moved < 0:
        return Finding("mass-negative", "error", "m", {"mass": Quantity(given + moved, "kg")})
    unit, ratio = "kg" if name == "m" else "", 1 + moved / given if given else 0.0
    names = nearest_factor(ratio, COMMON_FACTORS | (_FACTORS_OF_MASS if name == "m" else {}))
    numbers = {"given": Quantity(given, unit), "fitted": Quantity(given + moved, unit)}
    numbers |= quantities(misfit=misfit, moved=moved / abs(given or moved), times=times)
    numbers |= {"error": Quantity(error, unit)} if error else quantities(left=left)
    if name == "m" and not 1 / _MASS_MISREAD < ratio < _MASS_MISREAD:
        numbers |= quantities(factor=1 / ratio)
    return Finding("fixed-contradicted", "doubt", name, numbers, names)


def force_rise(
    amplitude: Array, force: Array | ComplexArray, typical: Callable[[Array], Any] = np.median
) -> float:
    """Return by how much the force of the points (n,) of a level is larger near its resonance than elsewhere,
    relative: the ``typical`` one there.
    """
    near, size = amplitude >= HALF_POWER * np.max(amplitude), np.abs(force)
    return float(typical(size[near]) / np.median(size[~near]) - 1) if not near.all() else 0.0


def force_changes(amplitude: Array, force: Array | ComplexArray) -> bool:
    """Return whether the force of the points (n,) of a level is another one near its resonance, as without
    control; the points lie on no curve of one force then, and the shaker decides on their stability, too.
    """
    return abs(force_rise(amplitude, force)) > HELD_OUT_ERROR_SMALL


def mixed_levels(surface: ResponseSurface) -> list[Finding]:
    """Return a finding if the rows of one level are of several, or levels stand where frequencies should.

    Under one force the responses of a sweep at one frequency are its readings; where they differ by more than
    levels do at most frequencies, levels were not told. Where levels outnumber frequencies, the response at
    one of these grows with the level (d|F|/dX > 0); it has a resonance where both are exchanged.
    """
    rows = usable_points(surface)
    if surface.control != "force" or surface.decays or not len(rows):
        return []
    rows = rows[np.lexsort((surface.level[rows], surface.sweep[rows], surface.frequency[rows]))]
    frequency, sweep, level = surface.frequency[rows], surface.sweep[rows], surface.level[rows]
    edges = np.flatnonzero((np.diff(frequency) != 0) | (sweep[1:] != sweep[:-1])) + 1
    readings = np.split(np.log(surface.amplitude[rows]), edges)
    levels, frequencies = len(np.unique(level)), len(np.unique(frequency))
    if levels > 1:
        names = {"rows": "columns"}
        driven = np.split(np.log(np.abs(surface.force[rows])), edges)
        moved, fell = (np.median([max(one) - one[-1] for one in parts]) for parts in (readings, driven))
        # where the force falls, too, levels are numbers of runs
        possible = levels > frequencies and fell < np.log(LEVEL_TOLERANCE)
    else:
        possible = np.ptp(np.log(np.abs(surface.force[rows]))) < np.log(LEVEL_TOLERANCE)
        moved, names = np.median([np.ptp(one) for one in readings]), {"rows": "readings"}
    if not (possible and moved > np.log(LEVEL_TOLERANCE)):
        return []
    numbers = quantities(levels=levels, frequencies=frequencies, moved=np.exp(moved))
    numbers |= quantities(surface.level_unit, level=level[0])
    return [Finding("levels-disagree", "doubt", "", numbers, names)]


def flattening_findings(surface: ResponseSurface) -> list[Finding]:
    """Return a finding if arrays of a grid, levels x frequencies, were flattened in two orders.

    Either each frequency is repeated while levels go one after the other, so that every level has a part of
    the band only, or both columns go frequency by frequency while the amounts that were held are those of the
    levels one after the other.
    """
    levels, count = list(dict.fromkeys(surface.level.tolist())), len(surface.levels)
    points = len(surface) // max(count, 1)
    enough = count >= _MIN_LEVELS and points >= _MIN_POINTS and points * count == len(surface)
    if not enough or surface.control not in ("force", "response"):
        return []
    repeated = np.reshape(surface.frequency, (points, count))
    if len(np.unique(repeated)) != points or np.any(repeated != repeated[:, :1]):
        return []
    inside, found = np.repeat(levels, points), ""
    if np.array_equal(surface.level, inside):
        # readings of one point differ by far less than those of its neighbours
        size = np.log(np.abs(surface.harmonics[:, 1] / surface.force)).reshape(points, count)
        steps = np.median(np.abs(np.diff(size[:, 0])))
        found = "frequencies" if np.median(np.ptp(size, axis=1)) > steps / 2 else ""
    elif np.array_equal(surface.level, np.tile(levels, points)) and not surface.base:
        amount = surface.amplitude if surface.response_held else np.abs(surface.force)
        off = [np.abs(np.log(np.fmax(amount, 1e-300) / given)) for given in (inside, surface.level)]
        if np.max(off[0]) < np.log(LEVEL_TOLERANCE) < np.median(off[1]):
            found = "levels"
    numbers = quantities(levels=count, points=points)
    return [Finding("levels-disagree", "doubt", "", numbers, {"rows": found})] if found else []


def row_findings(surface: ResponseSurface) -> list[Finding]:
    """Return a finding if columns of levels and frequencies do not belong together; none or one."""
    said = any(finding.names.get("rows") for finding in surface.findings)
    return [] if said else flattening_findings(surface) or mixed_levels(surface)


def levels_tested(surface: ResponseSurface) -> ResponseSurface:
    """Return a test without copies, its rows checked, with levels where each point had a reading for one."""
    surface = without_copies(surface)
    surface = replace(surface, findings=(*surface.findings, *row_findings(surface)))
    if not (surface.response_held and len(surface.levels) == len(surface)):
        return surface
    group = group_forces(surface.level, MAX_LEVEL_SPREAD)
    runs = [surface.level[group == number] for number in np.unique(group)]
    if any(len(run) < MIN_POINTS_OF_RUN or run.max() > (1 + MAX_LEVEL_SPREAD) * run.min() for run in runs):
        return surface
    numbers = quantities(points=len(surface), levels=len(runs))
    said = Finding("levels-disagree", "warning", "", numbers, {"by": "amplitude"})
    middle = np.array([np.median(run) for run in runs])[group]
    return replace(surface, level=middle, findings=(*surface.findings, said))
