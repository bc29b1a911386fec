"""Values to start from: the linear balance of a law, phase errors all around, phases made up.

At first order  F/X = k(X) - m omega^2 + i omega c(X, omega)  is linear in most parameters. These are solved
for exactly at every trial of the others (variable projection), so that only breakpoints, exponents and the
like have to be searched.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.linear_algebra import solve_scaled
from rsgen.common.tolerances import (
    ANY_LAW,
    FLAT,
    FOLLOWED,
    LIGHT,
    NOISY,
    NULL_PART,
    POOR,
    QUICK,
    SAMPLES,
    START_ORDER,
    TRIAL_STEPS,
    UNCHANGED,
    samples_for,
)
from rsgen.data.surface import ResponseSurface
from rsgen.dynamics.harmonic_balance import Response, following_harmonics, hold_amplitude
from rsgen.dynamics.linear_part import Inertia
from rsgen.identification.fitting.fit import Fit, Solution, fit_balance
from rsgen.identification.fitting.least_squares import determined
from rsgen.identification.fitting.observed import Problem
from rsgen.identification.fitting.points import Points
from rsgen.identification.starting.equations import Equations, equation_rows
from rsgen.identification.starting.search import search_nonlinear
from rsgen.law.element import make_element
from rsgen.law.identifiable import put_in_order
from rsgen.law.motion import sine_motion
from rsgen.law.numeric import ForceLaw, compile_law

# ----------------------------------------------------------------------------
# Even forces where the mean was not recorded: starting values, and what the test cannot say of them.
#
# The force k2 x^2 has no fundamental along a sine. It moves the mean and makes a second harmonic, and only
# these act back, in proportion to k2^2. So a fit that begins at k2 = 0 has no slope to follow, and k2 and
# -k2
# fit alike where neither was recorded. Values of several sizes are tried; the motion follows from the law.

_SHARES = (0.05, 0.2, 0.5)
"""Largest force of a direction that is tried, relative to the spring's: x^2 of the last moves the mean by a
quarter of the amplitude, of the first by as little as noise of one per cent leaves to be seen."""

_POINTS = 100
"""Points that each trial is fitted to."""

_MOST = 2
"""Directions that are tried together: one more would multiply the trials by seven."""


def is_hidden(problem: Problem) -> bool:
    """Tell whether the law moves the mean, and the test did not record it."""
    return not problem.law.odd and 0 not in problem.observed.points.measured


def start_asymmetric(problem: Problem, parameters: Array) -> tuple[Problem, Array]:
    """Give values to directions in the parameters that leave the fundamental along a sine as it is.

    The response is linear in the square of such a value, and chance makes that square negative as often as
    not where the truth is zero. No value fits then best, and there is no slope at zero; so the value stays
    at its resolution, where its standard error is as large as itself.

    Parameters
    ----------
    problem
        What is fitted.
    parameters
        Where the others start.
    """
    if not is_hidden(problem):
        return problem, parameters
    law, count = problem.law, len(problem.observed.points)
    few = problem.select(problem.observed.points.spread(_POINTS))
    hidden = hidden_directions(few, parameters)
    directions = hidden.directions[:_MOST]
    if not len(directions):
        return problem, parameters
    # x for -x mirrors the motion: where nothing even was recorded one sign of the first direction is enough
    even = [place for place in law.even if problem.free[place]]
    mirrored = not records_even(problem) and len(even) == len(law.even)
    signs = [(1.0,) if mirrored and not place else (1.0, -1.0) for place in range(len(directions))]
    sizes = [[0.0, *(sign * share for share in _SHARES for sign in each)] for each in signs]
    chosen = list(product(*sizes))
    moved = np.flatnonzero(np.any(directions != 0, axis=0))
    uneven = hidden.uneven[: len(directions)]
    held = replace(few, held=tuple({*law.even, *uneven} - {-1}))
    without, *fits = [_fit(held, hidden.centre + np.array(each) @ directions, TRIAL_STEPS) for each in chosen]
    best = _fit(few, min(fits, key=_cost).regression.parameters, 2 * TRIAL_STEPS)
    least = without.regression.parameters if np.isfinite(_cost(without)) else parameters
    if not np.isfinite(np.diag(best.regression.covariance)[moved]).any():
        return problem, least
    gain = (
        (_cost(without) / max(_cost(best), 1e-300) - 1)
        * best.regression.freedom
        * count
        / len(few.observed.points)
    )
    if gain > 1 or not mirrored:
        found = best.regression.parameters
        image = hidden_directions(few, found)
        if mirrored and image.symmetric and (found - image.centre)[image.uneven[0]] < 0:
            found = 2 * image.centre - found
        return problem, found
    if -1 in uneven:
        # what is odd has a slope
        return problem, least
    small = fits[chosen.index(tuple(each[1] for each in sizes)) - 1]
    resolved = _at_resolution(small, without, directions, uneven, count)
    # errors there are smaller than where the trial misses the points
    resolved = _at_resolution(_fit(held, resolved, TRIAL_STEPS), without, directions, uneven, count)
    # in exact data what is left is what a few harmonics leave out: the fits that follow go on from here
    return (replace(problem, held=tuple(uneven)) if without.regression.noise > NOISY else problem), resolved


def _at_resolution(small: Fit, without: Fit, directions: Array, uneven: Sequence[int], count: int) -> Array:
    """Give values of asymmetric forces the size at which their standard error from ``count`` points is as
    large, and lead others along that go with them.
    """
    noise = without.regression.noise / max(small.regression.noise, 1e-300)
    variance = np.diag(small.regression.covariance) * noise**2 * len(small.force) / count
    start, place = without.regression.parameters, list(uneven)
    # p^2 is as uncertain everywhere: 2 p sigma_p is the same at any p
    size = np.sqrt(np.abs(small.regression.parameters - start) * np.sqrt(variance))[place]
    change = np.where(np.isfinite(size), size, 0.0)
    return np.asarray(start + np.linalg.lstsq(directions[:, place].T, change, rcond=None)[0] @ directions)


def _fit(problem: Problem, parameters: Array, steps: int) -> Fit:
    return fit_balance(problem, parameters, order=START_ORDER, steps=steps, reject=False, correct=False)


def records_even(problem: Problem) -> bool:
    """Tell whether the test recorded the mean or an even harmonic, with phases."""
    return any(h % 2 == 0 for h in problem.observed.recorded)


def _cost(found: Fit) -> float:
    """Mean square misfit; infinite where too few of the points have a prediction."""
    misfit = found.regression.misfit[np.isfinite(found.regression.misfit)]
    return float(np.mean(misfit**2)) if len(misfit) > FOLLOWED * len(found.force) else np.inf


@dataclass(frozen=True, slots=True, eq=False)
class Hidden:
    """What the first-order balance does not tell of linear parameters.

    Of k*x + kb*Max(x, 0) it tells k + kb/2: what is hidden is a force abs(x), and the centre is at kb = 0.

    Parameters
    ----------
    centre
        (q,) parameters from which the force is symmetric as far as it can be.
    directions
        (d, q) null vectors, each with a force as large as the spring's.
    uneven
        (d,) a parameter of each that makes even forces, to be held while others settle; -1 where none does.
    symmetric
        Whether the force at the centre is symmetric, so that 2*centre - p is the mirror image of p.
    """

    centre: Array
    directions: Array
    uneven: tuple[int, ...]
    symmetric: bool


def _even(force: Array) -> Array:
    """Even part of forces (..., s) along one period of a sine: x and v change sign after half of it."""
    return np.asarray((force + np.roll(force, force.shape[-1] // 2, axis=-1)) / 2)


def hidden_directions(problem: Problem, parameters: Array) -> Hidden:
    """Find the null vectors of the first-order balance at (q,) parameters, and where they are symmetric."""
    law = problem.law
    values, mass, background = problem.split(parameters)
    points = problem.observed.mode(background)
    sines = sine_motion(points.omega, points.amplitude)
    unit = 1 / np.abs(points.force)
    equations = Equations(points.omega, points.force, sines.harmonics, False, unit, np.zeros((0, 2)))
    matrix, right = equation_rows(equations, law, values[list(law.nonlinear)])
    norm = np.sqrt(np.sum(matrix**2, axis=0))
    free = problem.free[[*law.linear, len(values)]]
    null = solve_scaled(matrix, right, known=np.where(free, np.nan, 0.0))[2]
    null = np.where(np.abs(null) > NULL_PART, null, 0.0) / np.where(norm > 0, norm, 1.0)[:, None]
    directions = np.zeros((null.shape[1], len(parameters)))
    directions[:, list(law.linear)] = null[: len(law.linear)].T
    largest = int(np.argmax(points.amplitude))
    sample = law.along(sines.select(np.array([largest])), values, SAMPLES)
    whole = np.broadcast_to(sample.force, (1, SAMPLES))[0]
    slopes = np.array([np.broadcast_to(slope, (1, SAMPLES))[0] for slope in sample.by_parameter])
    force = directions[:, : len(values)] @ slopes
    size, spring = np.max(np.abs(force), axis=1), abs(mass) * points.omega[largest] ** 2
    directions, force, size = (part[size > 0] for part in (directions, force, size))
    scale = (spring * points.amplitude[largest] / size)[:, None]
    directions, even = directions * scale, _even(force * scale)
    if not len(directions):
        return Hidden(parameters, directions, (), False)
    back = np.linalg.lstsq(even.T, -_even(whole), rcond=NULL_PART)[0]
    rest = np.max(np.abs(_even(whole) + back @ even))
    of_each = np.max(np.abs(_even(slopes)), axis=1)
    of_each[of_each < NULL_PART * np.max(np.abs(slopes), axis=1)] = 0.0
    uneven = list[int]()
    for direction in directions:
        part = np.abs(direction[: len(values)]) * of_each
        part[[place for place in uneven if place >= 0]] = 0.0
        uneven.append(int(np.argmax(part)) if part.any() else -1)
    symmetric = bool(rest < NULL_PART * np.max(np.abs(whole)))
    return Hidden(parameters + back @ directions, directions, tuple(uneven), symmetric)


Table = TypeVar("Table", Points, ResponseSurface)

_GROSS = 5.0
"""Starting values give less weight to points that disagree by more than this many typical misfits."""

_TYPICAL = 0.04
"""Relative misfit of starting values that is never called gross: first order may be as wrong."""

_FEWEST_OF_LEVEL = 8
"""Points of a level that determine a linear mode with a background, eight values."""

_SEARCHED = 120
"""Points, spread over the amplitude, on which nonlinear parameters are searched: ten for each of a dozen."""

_SCANNED = 80
"""Points on which all phase errors are tried: the six parameters of any law and the mass need no more."""

_TURNS = 12
"""Phase errors around the circle, or places of a neighbour in three bands, that are tried: none is farther
than fifteen degrees, or a seventh of the band, from one of them."""

_WEIGHINGS = 4
"""Of an equation by its own denominator: what comes out is a start."""

_RESIDUE = 0.3
"""Residue with which a neighbour begins, relative to that of the mode: seen, and smaller."""

_NEIGHBOURS = 4
"""Places of a neighbour from which the law itself is tried."""


def solve_equations(
    equations: Equations,
    law: ForceLaw,
    fixed: Mapping[str, float],
    near: Array | None = None,
) -> Solution:
    """Solve for all parameters of the law, and for the mass, but for those that are fixed.

    Parameters
    ----------
    equations, law, fixed
        What is solved.
    near
        (p,) values whose nonlinear ones lead to the solution; None searches their whole range.
    """
    free = [place for place, name in enumerate(law.parameters) if name not in fixed]
    begin = None if near is None else near[free]
    found = _solve_free(equations, law.at(fixed), fixed.get("m", np.nan), begin)
    values, places = np.array([fixed.get(name, 0.0) for name in law.parameters]), [*free, len(law.parameters)]
    values[free] = found.values
    covariance = np.zeros((len(values) + 1,) * 2)
    covariance[np.ix_(places, places)] = found.covariance
    return replace(found, values=values, covariance=covariance)


def _solve_free(equations: Equations, law: ForceLaw, mass: float, near: Array | None) -> Solution:
    """Solve for all parameters of a law; the mass [kg] is known, or NaN."""
    chosen = np.argsort(np.abs(equations.harmonics[:, 1]), kind="stable")
    few = chosen[np.unique(np.linspace(0, len(chosen) - 1, _SEARCHED).round().astype(np.intp))]
    nonlinear = np.zeros(0)
    if law.nonlinear:
        begin = None if near is None else near[list(law.nonlinear)]
        nonlinear = search_nonlinear(equations.select(few), law, mass, begin)
    matrix, right = equation_rows(equations, law, nonlinear)
    known = np.append(np.full(len(law.linear), np.nan), mass)
    solution, _, _ = solve_scaled(matrix, right, known=known)
    residual = right - matrix @ solution
    values = law.values_of(solution, nonlinear)
    if law.nonlinear:
        matrix = np.column_stack([matrix, _nonlinear_columns(equations, law, nonlinear, solution)])
    known = np.append(known, np.full(len(nonlinear), np.nan))
    _, inverse, null = solve_scaled(matrix, right, known=known)
    freedom = max(len(right) - int(np.isnan(known).sum()) + null.shape[1], 1)
    covariance = determined(inverse @ inverse.T * float(residual @ residual) / freedom, null)
    order = [*law.linear, len(values), *law.nonlinear]
    sorted_covariance = np.empty_like(covariance)
    sorted_covariance[np.ix_(order, order)] = covariance
    misfit = float(np.sqrt(residual @ residual / max(len(right), 1)))
    return Solution(values, float(solution[len(law.linear)]), sorted_covariance, freedom, misfit)


def point_misfit(equations: Equations, law: ForceLaw, solution: Solution) -> Array:
    """(n,) how far each point is from the solution, relative to its force."""
    linear = np.append(solution.values[list(law.linear)], solution.mass)
    bare = replace(equations, mean=False, turning=np.zeros((0, 2)))
    matrix, right = equation_rows(bare, law, solution.values[list(law.nonlinear)])
    misfit = right - matrix @ linear
    return np.asarray(np.hypot(*np.split(misfit, 2)))


def _nonlinear_columns(equations: Equations, law: ForceLaw, nonlinear: Array, solution: Array) -> Array:
    columns = []
    for i in range(len(nonlinear)):
        step = np.zeros(len(nonlinear))
        step[i] = 1e-5 * max(abs(nonlinear[i]), 1e-300)
        high, low = (
            matrix @ solution - right
            for matrix, right in (
                equation_rows(equations, law, nonlinear + step),
                equation_rows(equations, law, nonlinear - step),
            )
        )
        columns.append((high - low) / (2 * step[i]))
    return np.stack(columns, axis=1)


def start_fit(problem: Problem) -> tuple[Problem, Array]:
    """Parameters to start from, without any knowledge but the points; the problem says which of them stay."""
    start = _start_first_order(problem)
    values, mass, background = problem.split(start)
    ordered = np.array(values)
    for part in problem.law.parts:
        ordered[part.parameters] = put_in_order(part.law, values[part.parameters], problem.fixed)
    return start_asymmetric(problem, problem.join(ordered, mass, background))


def _start_first_order(problem: Problem) -> Array:
    observed = problem.observed
    if not observed.points.phase_known:
        found = _start_amplitudes(observed.points, problem.law, problem.fixed)
        parameters = problem.join(found.values, found.mass)
        if not observed.fitted.any():
            return parameters
        # law and background share the tails of a resonance: the law comes near first
        alone = replace(observed, fitted=np.zeros_like(observed.fitted))
        return fit_balance(
            replace(problem, observed=alone), parameters, order=START_ORDER
        ).regression.parameters
    trials = []
    for background in _start_backgrounds(problem):
        found = _start_values(observed.mode(background), problem.law, problem.fixed)
        trials.append(problem.join(found.values, found.mass, background))
    if len(trials) == 1:
        return trials[0]
    few = problem.select(observed.points.spread(QUICK))
    fits = [fit_balance(few, trial, order=START_ORDER, correct=False) for trial in trials]
    return min(fits, key=lambda found: found.regression.noise).regression.parameters


def _start_values(points: Points, law: ForceLaw, fixed: Mapping[str, float]) -> Solution:
    """First order, or the measured waveform where that fits better."""
    some = points.select(points.spread(2 * QUICK))
    first = _linear_start(some, law, fixed, 1)
    if not points.strong:
        return first
    # in the balance of the fundamental along the measured waveform a law is as linear as it is written
    whole = _linear_start(some, law, fixed, points.harmonics.shape[1] - 1)
    return whole if whole.misfit < first.misfit else first


def _linear_start(points: Points, law: ForceLaw, fixed: Mapping[str, float], order: int) -> Solution:
    """All points, gross outliers with less weight, up to a harmonic of the measured waveform."""
    equations = Equations(
        points.omega,
        points.force,
        points.harmonics[:, : order + 1],
        not law.odd and 0 in points.measured,
        1 / np.abs(points.force),
        np.zeros((0, 2)),
        tuple(points.across[:, : order + 1] for _ in points.far.T),
    )
    weight = equations.weight
    for _ in range(3):
        solution = solve_equations(equations, law, fixed)
        misfit = point_misfit(replace(equations, weight=weight), law, solution)
        typical = max(1.4826 * float(np.median(misfit)), _TYPICAL)
        factor = 1 / np.maximum(1.0, misfit / (_GROSS * typical)) ** 2
        if np.count_nonzero(factor < 0.25) <= 0.002 * len(points):
            break
        equations = replace(equations, weight=weight * factor)
    return solution


def _start_backgrounds(problem: Problem) -> list[Array]:
    """Phase error and background, several of a neighbour, with a law that is near any other."""
    observed = problem.observed
    if not observed.background.names:
        return [np.zeros(0)]
    points = observed.points
    law = compile_law(make_element("any", ANY_LAW).force)
    known = {name: value for name, value in problem.fixed.items() if name == "m"}
    few = replace(problem.select(points.spread(QUICK)), law=law, fixed=known)
    some = points.select(points.spread(_SCANNED))
    phases = 2 * np.pi * np.arange(_TURNS) / _TURNS - np.pi
    misfits = [_turned(some, law, known, float(phase)) for phase in phases]
    best = int(np.argmin([found.misfit if found.mass > 0 else np.inf for found in misfits]))
    found = _turned(few.observed.points, law, known, float(phases[best]))
    names = observed.background.names
    parameters = few.join(found.values, found.mass, np.append(phases[best], np.zeros(len(names) - 1)))
    trials = _place_neighbour(few, parameters) if "f_n" in names else [parameters]
    fits = [fit_balance(few, trial, order=1, correct=False) for trial in trials]
    if min(found.regression.noise for found in fits) > POOR and len(names) > 1:
        fits += _beside_receptances(few, phases)
    return [found.background for found in fits]


def _beside_receptances(problem: Problem, phases: Array) -> list[Fit]:
    """Fit beside a background as large as the mode: the one that a linear mode at each level would have."""
    observed, fits = problem.observed, []
    points = observed.points
    for level in np.unique(points.level):
        run = points.select(points.level == level)
        if len(run) < _FEWEST_OF_LEVEL:
            continue
        seen = _linear_receptance(run)
        moved = np.array(points.harmonics)
        moved[:, 1] -= seen * points.force
        mode = replace(points, harmonics=moved)
        turned = [_turned(mode, problem.law, problem.fixed, float(phase)) for phase in phases]
        best = int(np.argmin([found.misfit if found.mass > 0 else np.inf for found in turned]))
        b = seen * np.exp(-1j * phases[best])
        background = np.zeros(len(observed.background.names))
        background[:3] = phases[best], b.real, b.imag
        trial = problem.join(turned[best].values, turned[best].mass, background)
        fits.append(fit_balance(problem, trial, order=1, correct=False))
    return fits


def _linear_receptance(points: Points) -> complex:
    """Give b of x/F = b + a/(k - s^2 + i c s) for measured forces, s = omega over its mean, by least squares.

    The denominator multiplied out, the equation is linear; its weight follows in a few rounds (Sanathanan and
    Koerner, IEEE Trans. Autom. Control 8 (1963)).
    """
    s = points.omega / np.mean(points.omega)
    ratio = points.harmonics[:, 1] / points.force
    one = np.ones(len(s))
    numerator = [part * s**power for power in range(3) for part in (-one, -1j * one)]
    columns = np.stack([ratio, 1j * s * ratio, *numerator], axis=1)
    weight = 1 / np.abs(ratio)
    for _ in range(_WEIGHINGS):
        matrix, right = columns * weight[:, None], ratio * s**2 * weight
        matrix, right = np.vstack([matrix.real, matrix.imag]), np.concatenate([right.real, right.imag])
        found, _, _ = solve_scaled(matrix, right)
        weight = 1 / np.abs(ratio * (found[0] - s**2 + 1j * found[1] * s))
    return -complex(found[6], found[7])


def _place_neighbour(problem: Problem, parameters: Array) -> list[Array]:
    """Try a neighbour at places around the band; those that leave the least misfit may be near.

    It begins lightly damped with a share of the residue of the mode, and has a few steps at each place.
    """
    without = replace(problem, observed=problem.observed.without_neighbour())
    mode = len(parameters) - 4
    begun = fit_balance(without, parameters[:mode], order=1, steps=TRIAL_STEPS, correct=False)
    low, high = problem.observed.band
    fits = []
    for place in np.linspace(max(low - (high - low), low / 2), high + (high - low), _TURNS):
        neighbour = [_RESIDUE / begun.mass, 0.0, place, LIGHT]
        trial = np.concatenate([begun.regression.parameters, neighbour])
        fits.append(fit_balance(problem, trial, order=1, steps=TRIAL_STEPS, reject=False, correct=False))
    fits.sort(key=lambda found: found.regression.noise if found.mass > 0 else np.inf)
    return [problem.join(begun.values, begun.mass, found.background) for found in fits[:_NEIGHBOURS]]


def _turned(points: Points, law: ForceLaw, fixed: Mapping[str, float], psi: float) -> Solution:
    """Solve the first-order balance with the force turned by psi [rad]."""
    force = points.force * np.exp(1j * psi)
    weight = 1 / np.abs(force)
    none = np.zeros((0, 2))
    equations = Equations(points.omega, force, points.harmonics[:, :2], False, weight, none)
    return solve_equations(equations, law, fixed)


def _guessed(points: Points) -> NDArray[np.float64]:
    """(n,) lag of the response [rad] from where each point lies in its run."""
    size, force = points.amplitude, np.abs(points.force)
    side = np.zeros(len(points))
    peaks: list[tuple[float, float]] = []
    for rows in points.runs:
        top = rows[np.argmax(size[rows])]
        side[rows] = np.sign(points.omega[rows] - points.omega[top])
        if points.omega[rows].min() < points.omega[top] < points.omega[rows].max():
            peaks.append((float(size[top]), float(force[top] / (points.omega[top] * size[top]))))
    if not peaks:
        top = int(np.argmax(size))
        peaks = [(float(size[top]), float(force[top] / (points.omega[top] * size[top])))]
    heights, damping = np.array(sorted(peaks)).T
    share = np.interp(size, heights, damping) * points.omega * size / force
    below = np.arcsin(np.clip(share, 0.0, 1.0))
    return np.where(side > 0, np.pi - below, np.where(side < 0, below, np.pi / 2))


def _start_amplitudes(points: Points, law: ForceLaw, fixed: Mapping[str, float]) -> Solution:
    """Fit the law to phases that the law itself predicts, from a guess on.

    At the peak of a run the response lags a quarter period, c = F/(omega X) (Liu et al., Sec. 1.2), below it
    less, above it more; the law that fits then predicts the phase anew.
    """
    lag = _guessed(points)
    force = np.abs(points.force)
    harmonics = sine_motion(points.omega, points.amplitude).harmonics
    best = np.inf
    start: Solution | None = None
    for _ in range(TRIAL_STEPS):
        equations = Equations(
            points.omega, force * np.exp(1j * lag), harmonics, False, 1 / force, np.zeros((0, 2))
        )
        found = solve_equations(equations, law, fixed)
        balance = _hold(law, found.values, found.mass, points.omega, points.amplitude, 1)
        misfit = float(np.sqrt(np.mean(np.log(np.abs(balance.force) / force) ** 2)))
        if start is not None and not misfit < (1 - UNCHANGED) * best:
            break
        best, start = misfit, found
        lag = np.angle(balance.force)
    return start if start is not None else found


def _hold(law: ForceLaw, values: Array, mass: float, omega: Array, size: Array, order: int) -> Response:
    samples = samples_for(law.switched)
    start = np.zeros((len(omega), max(order, 1) + 1), dtype=complex)
    follow = following_harmonics(law, order)
    return hold_amplitude(law, values, Inertia(mass), omega, size, start, follow, samples)


def with_phase(table: Table, found: Fit, receptance: ComplexArray) -> Table:
    """Give force and response the phases that law and background (n,) [m/N] predict at each amplitude.

    A table with phases stays as it is.
    """
    if table.phase_known:
        return table
    law = found.problem.law
    seen = np.abs(table.harmonics[:, 1])
    held = np.isfinite(seen) & (seen > 0)
    force = np.abs(table.force).astype(np.complex128)
    harmonics = np.zeros((len(seen), 2), dtype=np.complex128)
    harmonics[:, 1] = seen
    b, omega, wanted = receptance[held], table.omega[held], seen[held]
    size = np.array(wanted)
    for _ in range(TRIAL_STEPS):
        balance = _hold(law, found.values, found.mass, omega, size, START_ORDER)
        response = size + b * balance.force
        slope = (np.conj(response) * (1 + b * balance.force_slope / size)).real / np.abs(response)
        step = (wanted - np.abs(response)) / np.where(np.abs(slope) > FLAT, slope, 1.0)
        size = size + np.nan_to_num(np.clip(step, -0.5 * size, 0.5 * size))
    balance = _hold(law, found.values, found.mass, omega, size, START_ORDER)
    force[held] *= np.exp(1j * np.nan_to_num(np.angle(balance.force)))
    harmonics[held, 1] *= np.exp(1j * np.nan_to_num(np.angle(size + b * balance.force)))
    if isinstance(table, Points):
        return replace(table, force=force, harmonics=harmonics, measured=(1,), phase_known=True)
    return replace(table, force=force, harmonics=harmonics)
