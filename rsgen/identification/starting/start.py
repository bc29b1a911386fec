"""Initial values: linear balance, a scan over phase errors, reconstructed phases, even forces.

At first order F/X = k(X) - m omega^2 + i omega c(X, omega) is linear in most parameters, which are solved for
at every trial of the others (variable projection, ``search``). An unknown phase error is tried at angles
around the circle. Without recorded phases they are those that the law predicts, by fixed-point iteration from
the lag of a linear resonance. Even forces that only act through an unrecorded mean are tried at several
sizes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.solvers import determined, solve_scaled
from rsgen.common.tolerances import (
    ANY_LAW,
    ASSUMED_DAMPING_RATIO,
    MAX_ALTERNATIONS,
    MAX_SHARE_OF_OUTLIERS_BY_CHANCE,
    MAX_TRIAL_STEPS,
    MIN_NULL_COMPONENT,
    MIN_RELATIVE_SLOPE,
    MIN_SHARE_PREDICTED,
    MISFIT_EXPLAINED,
    MISFIT_NEGLIGIBLE,
    MISFIT_OF_NOISE,
    SAMPLES_PER_PERIOD,
    START_HARMONICS,
    SUBSAMPLE_POINTS,
    TRIAL_POINTS,
    deviation_of_median,
    is_significant,
    samples_for,
)
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.harmonic_balance import Response, following_harmonics, hold_amplitude
from rsgen.formula.names import symbol
from rsgen.identification.fitting.fit import Fit, Solution, fit_balance
from rsgen.identification.fitting.observed import Problem
from rsgen.identification.fitting.points import Points
from rsgen.identification.starting.equations import Equations, equation_rows, known_rows
from rsgen.identification.starting.search import STARTS, search_nonlinear
from rsgen.law.character import mirror_exchanges
from rsgen.law.element import make_element
from rsgen.law.motion import sine_motion
from rsgen.law.numeric import ForceLaw, compile_law, put_in_order

# ----------------------------------------------------------------------------
# Even forces without a recorded mean.
#
# The force k2 x^2 has no fundamental along a sine. It changes the mean and the second harmonic, which change
# the fundamental in proportion to k2^2. So the slope at k2 = 0 is zero, and k2 and -k2 fit equally if neither
# was recorded. Values of several sizes are tried.

_FORCE_RATIOS = (0.05, 0.2, 0.35, 0.5)
"""Tried largest even forces, relative to that of the spring: x^2 of the last shifts the mean by a quarter of
the amplitude, of the first by the effect of one per cent of noise. With a cubic part the misfit has a hump
between zero and the right one, so that large ones are dense."""

_MAX_DIRECTIONS = 2
"""Directions that are tried together."""


def even_part_unobservable(problem: Problem) -> bool:
    """Return True if the law shifts the mean, and the test did not record it."""
    return not problem.law.odd and 0 not in problem.observed.points.measured


def start_even_forces(problem: Problem, parameters: Array) -> tuple[Problem, Array]:
    """Return initial values of parameters that do not change the fundamental along a sine, by trials.

    The response is linear in the square of such a value. If its true value is zero, noise makes the estimated
    square negative half of the time; the best value is then zero, where the slope is zero. The value is
    frozen where its standard error equals it.

    Parameters
    ----------
    problem
        Points and law.
    parameters
        (q,) initial values of the other parameters.
    """
    if not even_part_unobservable(problem):
        return problem, parameters
    law, count = problem.law, len(problem.observed.points)
    few = problem.select(problem.observed.points.spread(TRIAL_POINTS))
    even_space = even_directions(few, parameters)
    directions = even_space.directions[:_MAX_DIRECTIONS]
    if not len(directions):
        return problem, parameters
    # -x mirrors the motion: without recorded even harmonics one sign of the first direction suffices
    even = [place for place in law.even if problem.free[place]]
    mirrored = not records_even(problem) and len(even) == len(law.even)
    signs = [(1.0,) if mirrored and not place else (1.0, -1.0) for place in range(len(directions))]
    sizes = [[0.0, *(sign * share for share in _FORCE_RATIOS for sign in own)] for own in signs]
    chosen = list(product(*sizes))
    moved = np.flatnonzero(np.any(directions != 0, axis=0))
    uneven = even_space.uneven[: len(directions)]
    frozen = replace(few, frozen=tuple({*law.even, *uneven}))
    without, *fits = [
        _fit(frozen, even_space.centre + np.array(ratios) @ directions, MAX_TRIAL_STEPS) for ratios in chosen
    ]
    best = _fit(few, min(fits, key=_cost).regression.parameters, 2 * MAX_TRIAL_STEPS)
    least = without.regression.parameters if np.isfinite(_cost(without)) else parameters
    if not np.isfinite(np.diag(best.regression.covariance)[moved]).any():
        return problem, least
    scale = best.regression.freedom * count / len(few.observed.points)
    gain = (_cost(without) / max(_cost(best), 1e-300) - 1) * scale
    if gain > 1 or not mirrored:
        found = best.regression.parameters
        image = even_directions(few, found)
        if mirrored and image.symmetric and (found - image.centre)[image.uneven[0]] < 0:
            found = 2 * image.centre - found
        return problem, found
    small = fits[chosen.index(tuple(ratios[1] for ratios in sizes)) - 1]
    resolved = _at_resolution(small, without, directions, uneven, count)
    # errors are smaller there than at a trial that misses the points
    resolved = _at_resolution(_fit(frozen, resolved, MAX_TRIAL_STEPS), without, directions, uneven, count)
    # the misfit of exact data is that of few harmonics: further fits begin here without frozen parameters
    noisy = without.regression.sigma > MISFIT_OF_NOISE
    return replace(problem, frozen=tuple(uneven) if noisy else problem.frozen), resolved


def _at_resolution(small: Fit, without: Fit, directions: Array, uneven: Sequence[int], count: int) -> Array:
    """Return parameters with even forces of the size of their standard errors from ``count`` points."""
    # a trial that follows no point has no misfit, and resolves nothing
    noise = without.regression.sigma / (small.regression.sigma or np.inf)
    variance = np.diag(small.regression.covariance) * noise**2 * len(small.force) / count
    start, place = without.regression.parameters, list(uneven)
    # p^2 is as uncertain everywhere: 2 p sigma_p is the same at any p
    size = np.sqrt(np.abs(small.regression.parameters - start) * np.sqrt(variance))[place]
    change = np.where(np.isfinite(size), size, 0.0)
    return np.asarray(start + np.linalg.lstsq(directions[:, place].T, change, rcond=None)[0] @ directions)


def _fit(problem: Problem, parameters: Array, steps: int) -> Fit:
    return fit_balance(problem, parameters, order=START_HARMONICS, steps=steps, exclude=False, correct=False)


def records_even(problem: Problem) -> bool:
    """Return True if the test recorded the mean or an even harmonic, with phases."""
    return any(h % 2 == 0 for h in problem.observed.recorded)


def _cost(found: Fit) -> float:
    """Return the mean square misfit; infinite if too few of the points have a prediction."""
    misfit = found.regression.misfit[np.isfinite(found.regression.misfit)]
    enough = len(misfit) > MIN_SHARE_PREDICTED * len(found.force)
    return float(np.mean(misfit**2)) if enough else np.inf


@dataclass(frozen=True, slots=True, eq=False)
class EvenDirections:
    """Directions of the linear parameters that the first-order balance does not determine.

    For k*x + kb*Max(x, 0) it determines k + kb/2: the direction is a force abs(x), and the centre is kb = 0.

    Parameters
    ----------
    centre
        (q,) parameters from which the force is symmetric as far as it can be.
    directions
        (d, q) null vectors with an even force, each with one as large as the spring's.
    uneven
        (d,) a parameter of each that makes even forces, to be frozen in trials.
    symmetric
        True if the force at the centre is symmetric, so that 2*centre - p is the mirror image of p.
    """

    centre: Array
    directions: Array
    uneven: tuple[int, ...]
    symmetric: bool


def _even(force: Array) -> Array:
    """Return the even part of forces (..., s) along one period of a sine: -x, -v is half a period later."""
    return np.asarray((force + np.roll(force, force.shape[-1] // 2, axis=-1)) / 2)


def even_directions(problem: Problem, parameters: Array) -> EvenDirections:
    """Find the null vectors of the first-order balance at (q,) parameters, and where they are symmetric."""
    law = problem.law
    values, mass, background = problem.split(parameters)
    points = problem.observed.mode(background)
    sines = sine_motion(points.omega, points.amplitude)
    equations = Equations.plain(points.omega, points.force, sines.harmonics)
    matrix, right = equation_rows(equations, law, values[list(law.nonlinear)])
    norm = np.sqrt(np.sum(matrix**2, axis=0))
    free = problem.free[[*law.linear, len(values)]]
    null = solve_scaled(matrix, right, known=np.where(free, np.nan, 0.0))[2]
    null = np.where(np.abs(null) > MIN_NULL_COMPONENT, null, 0.0) / np.where(norm > 0, norm, 1.0)[:, None]
    directions = np.zeros((null.shape[1], len(parameters)))
    directions[:, list(law.linear)] = null[: len(law.linear)].T
    largest = int(np.argmax(points.amplitude))
    sample = law.along(sines.select(np.array([largest])), values, SAMPLES_PER_PERIOD)
    total = np.broadcast_to(sample.force, (1, SAMPLES_PER_PERIOD))[0]
    slopes = np.array([np.broadcast_to(slope, (1, SAMPLES_PER_PERIOD))[0] for slope in sample.by_parameter])
    force = directions[:, : len(values)] @ slopes
    size, spring = np.max(np.abs(force), axis=1), abs(mass) * points.omega[largest] ** 2
    directions, force, size = (part[size > 0] for part in (directions, force, size))
    scale = (spring * points.amplitude[largest] / size)[:, None]
    directions, even = directions * scale, _even(force * scale)
    if not len(directions):
        return EvenDirections(parameters, directions, (), False)
    back = np.linalg.lstsq(even.T, -_even(total), rcond=MIN_NULL_COMPONENT)[0]
    rest = np.max(np.abs(_even(total) + back @ even))
    of_each = np.max(np.abs(_even(slopes)), axis=1)
    of_each[of_each < MIN_NULL_COMPONENT * np.max(np.abs(slopes), axis=1)] = 0.0
    uneven = dict[int, Array]()
    for direction in directions:
        part = np.abs(direction[: len(values)]) * of_each
        part[list(uneven)] = 0.0
        if part.any():
            uneven[int(np.argmax(part))] = direction
    symmetric = bool(uneven and rest < MIN_NULL_COMPONENT * np.max(np.abs(total)))
    even_alone = np.reshape(list(uneven.values()), (len(uneven), len(parameters)))
    return EvenDirections(parameters + back @ directions, even_alone, tuple(uneven), symmetric)


Table = TypeVar("Table", Points, ResponseSurface)

_MAX_MISFIT_RATIO = 5.0
"""Misfit of a point relative to the median from which on its weight is reduced."""

_MIN_POINTS_OF_LEVEL = 8
"""A linear mode with a background has eight parameters."""

_GRID_SIZE = 12
"""Tried phase errors around the circle, or natural frequencies of a neighbour in three bands."""

_INITIAL_RESIDUE = 0.3
"""Initial residue of a neighbour, relative to that of the mode."""


def solve_equations(
    equations: Equations, law: ForceLaw, fixed: Mapping[str, float], near: Array | None = None
) -> Solution:
    """Solve for all parameters of the law and the mass that are not fixed.

    Parameters
    ----------
    equations, law, fixed
        Data and model.
    near
        (p,) values near the solution; None searches the nonlinear ones in their whole range.
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
    few = chosen[np.unique(np.linspace(0, len(chosen) - 1, TRIAL_POINTS).round().astype(np.intp))]
    nonlinear = np.zeros(0)
    if law.nonlinear:
        begin = None if near is None else near[list(law.nonlinear)]
        nonlinear = search_nonlinear(equations.select(few), law, mass, begin)
    matrix, right = equation_rows(equations, law, nonlinear)
    known = np.append(np.full(len(law.linear), np.nan), mass)
    rows = known_rows(matrix, right)
    solution, _, _ = solve_scaled(matrix[rows], right[rows], known=known)
    residual = (right - matrix @ solution)[rows]
    values = law.values_of(solution, nonlinear)
    if law.nonlinear:
        matrix = np.column_stack([matrix, _nonlinear_columns(equations, law, nonlinear, solution)])
        rows = known_rows(matrix, right)
    right = right[rows]
    known = np.append(known, np.full(len(nonlinear), np.nan))
    _, inverse, null = solve_scaled(matrix[rows], right, known=known)
    freedom = max(len(right) - int(np.isnan(known).sum()) + null.shape[1], 1)
    covariance = determined(inverse @ inverse.T * float(residual @ residual) / freedom, null)
    order = [*law.linear, len(values), *law.nonlinear]
    sorted_covariance = np.empty_like(covariance)
    sorted_covariance[np.ix_(order, order)] = covariance
    sigma = float(np.sqrt(residual @ residual / max(len(right), 1)))
    return Solution(values, float(solution[len(law.linear)]), sorted_covariance, freedom, sigma)


def point_misfit(equations: Equations, law: ForceLaw, solution: Solution) -> Array:
    """Return the misfit (n,) of each point, relative to its force."""
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
        ends = (equation_rows(equations, law, nonlinear + move) for move in (step, -step))
        high, low = (matrix @ solution - right for matrix, right in ends)
        columns.append((high - low) / (2 * step[i]))
    return np.stack(columns, axis=1)


def start_fit(problem: Problem) -> tuple[Problem, Array]:
    """Return the problem, with frozen parameters if need be, and initial parameters (q,) from the points."""
    start = _start_first_order(replace(problem, fixed=problem.known_values))
    values, mass, background = problem.split(start)
    ordered = np.array(values)
    for part in problem.law.parts:
        ordered[part.parameters] = put_in_order(part.law, values[part.parameters], problem.fixed)
    return start_even_forces(problem, problem.join(ordered, mass, background))


def _start_first_order(problem: Problem) -> Array:
    """Return values from the first order: with every trial of a background, the best by a coarse balance."""
    observed = problem.observed
    if not observed.points.phase_known:
        found = _start_amplitudes(observed.points, problem.law, problem.fixed)
        parameters = problem.join(found.values, found.mass)
        if not observed.fitted.any():
            return parameters
        # law and background both fit the flanks of a resonance: fit the law first
        alone = replace(problem, observed=replace(observed, fitted=np.zeros_like(observed.fitted)))
        return fit_balance(alone, parameters, order=START_HARMONICS).regression.parameters
    trials = []
    for background in _start_backgrounds(problem):
        points = observed.mode(background)
        found = _start_values(points, problem.law, problem.fixed)
        several = [found]
        if even_part_unobservable(problem) and not (problem.law.remembers or problem.law.acts_across):
            several += _start_on_both_sides(problem, points, found.values)
            several += _start_with_even_force(problem, points, found)
        trials += [problem.join(one.values, one.mass, background) for one in several]
    if len(trials) == 1:
        return trials[0]
    few = problem.select(observed.points.spread(SUBSAMPLE_POINTS))
    fits = [fit_balance(few, trial, order=START_HARMONICS, correct=False) for trial in trials]
    # a trial that follows no point has no misfit
    followed = [found for found in fits if np.isfinite(_cost(found))]
    return min(followed or fits, key=_misfit_of_most).regression.parameters


def _misfit_of_most(found: Fit) -> float:
    """Return the mean square misfit without the largest ones: one point at a jump may have more than all."""
    most = round((1 - MAX_SHARE_OF_OUTLIERS_BY_CHANCE) * len(found.force))
    return float(np.nanmean(np.sort(found.regression.misfit)[:most] ** 2))


def _start_on_both_sides(problem: Problem, points: Points, values: Array) -> Iterator[Solution]:
    """Solve with two parameters equal that the mirror image exchanges, as a stop on each side.

    Along sines a stop on one side has the fundamental of two stops of half the stiffness.
    """
    law, fixed = problem.law, problem.fixed
    for pair in combinations(law.nonlinear, 2):
        names = [law.parameters[place] for place in pair]
        if not mirror_exchanges(law.expression, *map(symbol, names)):
            continue
        for place in pair:
            near = np.array(values)
            near[list(pair)] = values[place]
            found = solve_equations(Equations.along(points, law, 1), law, fixed, near)
            # where both are equal a fit has no slope by their difference, of any other it finds the right one
            spread = np.array(found.values)
            spread[list(pair)] *= [1.05, 0.95]
            yield replace(found, values=spread)


def _start_with_even_force(problem: Problem, points: Points, found: Solution) -> Iterator[Solution]:
    """Solve with sizes of a term with an even force that the first order hardly tells from a linear one.

    Of a stop whose gap is small along the motion it may give a hundred times its stiffness, at which no point
    has a motion.
    """
    law, fixed = problem.law, problem.fixed
    largest = sine_motion(points.omega, points.amplitude).select(np.array([np.argmax(points.amplitude)]))
    slopes = law.along(largest, found.values, SAMPLES_PER_PERIOD).by_parameter
    force = abs(found.mass) * float((points.omega**2 * points.amplitude).max())
    error = np.nan_to_num(np.sqrt(np.diag(found.covariance)), nan=np.inf)
    for place in law.linear:
        name, slope = law.parameters[place], np.broadcast_to(slopes[place], (1, SAMPLES_PER_PERIOD))
        size, even = np.max(np.abs(slope)), np.max(np.abs(_even(slope)))
        # directions without a fundamental are tried later
        hidden = 0 < error[place] < np.inf and not is_significant(found.values[place], error[place])
        if hidden and name not in fixed and even > MIN_NULL_COMPONENT * size:
            for ratio in _FORCE_RATIOS:
                given = {**fixed, name: ratio * force / size}
                yield solve_equations(Equations.along(points, law, 1), law, given)


def _start_values(points: Points, law: ForceLaw, fixed: Mapping[str, float]) -> Solution:
    """Solve along sines, and along the measured waveforms; return the better solution."""
    some = points.select(points.spread(2 * SUBSAMPLE_POINTS))
    first = _linear_start(some, law, fixed, 1)
    if not points.strong:
        return first
    measured = _linear_start(some, law, fixed, points.harmonics.shape[1] - 1)
    return measured if measured.sigma < first.sigma else first


def _linear_start(points: Points, law: ForceLaw, fixed: Mapping[str, float], order: int) -> Solution:
    """Solve the balance along the measured harmonics up to an order, outliers with less weight."""
    equations = Equations.along(points, law, order)
    weight = equations.weight
    for _ in range(3):
        solution = solve_equations(equations, law, fixed)
        # a loop that does not close has no misfit
        misfit = np.nan_to_num(point_misfit(replace(equations, weight=weight), law, solution))
        typical = max(deviation_of_median(float(np.median(misfit))), MISFIT_EXPLAINED)
        factor = 1 / np.maximum(1.0, misfit / (_MAX_MISFIT_RATIO * typical)) ** 2
        if np.count_nonzero(factor < 0.25) <= 0.002 * len(points):
            break
        equations = replace(equations, weight=weight * factor)
    return solution


def _start_backgrounds(problem: Problem) -> list[Array]:
    """Return initial backgrounds, several for a neighbour, with the surrogate of any law."""
    observed = problem.observed
    if not observed.background.names:
        return [np.zeros(0)]
    points = observed.points
    law = compile_law(make_element("any", ANY_LAW).force)
    known = {name: value for name, value in problem.fixed.items() if name == "m"}
    few = replace(problem.select(points.spread(SUBSAMPLE_POINTS)), law=law, fixed=known)
    some = points.select(points.spread(TRIAL_POINTS))
    phase, _ = _best_phase(some, law, known)
    found = _solve_turned(few.observed.points, law, known, phase)
    names = observed.background.names
    parameters = few.join(found.values, found.mass, np.append(phase, np.zeros(len(names) - 1)))
    trials = _place_neighbour(few, parameters) if "f_n" in names else [parameters]
    fits = [fit_balance(few, trial, order=1, correct=False) for trial in trials]
    if min(found.regression.rms_misfit for found in fits) > MISFIT_EXPLAINED and len(names) > 1:
        fits += _fit_with_linear_backgrounds(few)
    return [found.background for found in fits]


def _fit_with_linear_backgrounds(problem: Problem) -> list[Fit]:
    """Fit with the background of a linear mode at each level, for backgrounds as large as the mode."""
    observed, fits = problem.observed, []
    points = observed.points
    for level in np.unique(points.level):
        run = points.select(points.level == level)
        if len(run) < _MIN_POINTS_OF_LEVEL:
            continue
        seen = _linear_receptance(run)
        moved = np.array(points.harmonics)
        moved[:, 1] -= seen * points.force
        phase, found = _best_phase(replace(points, harmonics=moved), problem.law, problem.fixed)
        b = seen * np.exp(-1j * phase)
        background = np.zeros(len(observed.background.names))
        background[:3] = phase, b.real, b.imag
        trial = problem.join(found.values, found.mass, background)
        fits.append(fit_balance(problem, trial, order=1, correct=False))
    return fits


def _linear_receptance(points: Points) -> complex:
    """Return b of x/F = b + a/(k - s^2 + i c s) for measured forces, s = omega over its mean, by least
    squares.

    Multiplied by the denominator the equation is linear; it is reweighted by the last denominator (Sanathanan
    and Koerner, IEEE Trans. Autom. Control 8 (1963)).
    """
    s = points.omega / np.mean(points.omega)
    ratio = points.harmonics[:, 1] / points.force
    one = np.ones(len(s))
    numerator = [part * s**power for power in range(3) for part in (-one, -1j * one)]
    columns = np.stack([ratio, 1j * s * ratio, *numerator], axis=1)
    weight = 1 / np.abs(ratio)
    for _ in range(MAX_ALTERNATIONS):
        matrix, right = columns * weight[:, None], ratio * s**2 * weight
        matrix, right = np.vstack([matrix.real, matrix.imag]), np.concatenate([right.real, right.imag])
        found, _, _ = solve_scaled(matrix, right)
        weight = 1 / np.abs(ratio * (found[0] - s**2 + 1j * found[1] * s))
    return -complex(found[6], found[7])


def _place_neighbour(problem: Problem, parameters: Array) -> list[Array]:
    """Return parameters with a neighbouring mode at the natural frequencies of least misfit.

    Each trial begins with light damping and a share of the residue of the mode, and has a few steps.
    """
    seen = problem.observed
    alone = replace(seen, background=seen.background.without_neighbour(), fitted=seen.fitted[:-4])
    without, start = replace(problem, observed=alone), parameters[:-4]
    begun = fit_balance(without, start, order=1, steps=MAX_TRIAL_STEPS, correct=False)
    fits = []
    for neighbour in neighbours(problem.observed.background.band, begun.mass):
        trial = np.concatenate([begun.regression.parameters, neighbour])
        fits.append(fit_balance(problem, trial, order=1, steps=MAX_TRIAL_STEPS, exclude=False, correct=False))
    fits.sort(key=lambda found: found.regression.sigma if found.mass > 0 else np.inf)
    return [problem.join(begun.values, begun.mass, found.background) for found in fits[:STARTS]]


def neighbours(band: tuple[float, float], mass: float) -> Array:
    """Return initial values (k, 4) of modes near one of a mass, in a band [Hz] and around it."""
    low, high = band
    place = np.linspace(max(low - (high - low), low / 2), high + (high - low), _GRID_SIZE)
    one = np.ones(len(place))
    return np.column_stack([_INITIAL_RESIDUE / mass * one, 0 * one, place, ASSUMED_DAMPING_RATIO * one])


def _best_phase(points: Points, law: ForceLaw, fixed: Mapping[str, float]) -> tuple[float, Solution]:
    """Try phase errors [rad] around the circle; return the one of least misfit, and the solution there."""
    phases = (2 * np.pi * np.arange(_GRID_SIZE) / _GRID_SIZE - np.pi).tolist()
    trials = [(phase, _solve_turned(points, law, fixed, phase)) for phase in phases]
    return min(trials, key=lambda trial: trial[1].sigma if trial[1].mass > 0 else np.inf)


def _solve_turned(points: Points, law: ForceLaw, fixed: Mapping[str, float], psi: float) -> Solution:
    """Solve the first-order balance with the force turned by a phase psi [rad]."""
    force = points.force * np.exp(1j * psi)
    return solve_equations(Equations.plain(points.omega, force, points.harmonics[:, :2]), law, fixed)


def _lag_of_linear_resonance(points: Points) -> NDArray[np.float64]:
    """Return the lag (n,) of the response [rad] of a linear resonance with the peak of each run."""
    size, force = points.amplitude, np.abs(points.force)
    side = np.zeros(len(points))
    peaks = list[np.intp]()
    for rows in points.runs:
        top = rows[np.argmax(size[rows])]
        side[rows] = np.sign(points.omega[rows] - points.omega[top])
        if points.omega[rows].min() < points.omega[top] < points.omega[rows].max():
            peaks.append(top)
    tops = np.array(peaks or [np.argmax(size)])
    tops = tops[np.lexsort((force[tops] / points.omega[tops], size[tops]))]
    heights, damping = size[tops], force[tops] / (points.omega[tops] * size[tops])
    share = np.interp(size, heights, damping) * points.omega * size / force
    below = np.arcsin(np.clip(share, 0.0, 1.0))
    return np.where(side > 0, np.pi - below, np.where(side < 0, below, np.pi / 2))


def _start_amplitudes(points: Points, law: ForceLaw, fixed: Mapping[str, float]) -> Solution:
    """Fit the law to phases that it predicts itself, by fixed-point iteration.

    At the peak of a run the response lags a quarter period, c = F/(omega X) (Liu et al., Sec. 1.2), below it
    less, above it more.
    """
    lag = _lag_of_linear_resonance(points)
    force = np.abs(points.force)
    harmonics = sine_motion(points.omega, points.amplitude).harmonics
    best = np.inf
    start: Solution | None = None
    for _ in range(MAX_TRIAL_STEPS):
        equations = Equations.plain(points.omega, force * np.exp(1j * lag), harmonics)
        # the first search covers the whole range; later phases move its values little
        found = solve_equations(equations, law, fixed, start.values if start else None)
        balance = _balance_at_amplitudes(law, found.values, found.mass, points.omega, points.amplitude, 1)
        misfit = float(np.sqrt(np.mean(np.log(np.abs(balance.force) / force) ** 2)))
        if start is not None and not misfit < (1 - MISFIT_NEGLIGIBLE) * best:
            break
        best, start = misfit, found
        lag = np.angle(balance.force)
    return start or found


def _balance_at_amplitudes(
    law: ForceLaw, values: Array, mass: float, omega: Array, size: Array, order: int
) -> Response:
    samples = samples_for(law.switched)
    start = np.zeros((len(omega), max(order, 1) + 1), dtype=complex)
    follow = following_harmonics(law, order)
    return hold_amplitude(law, values, mass, omega, size, start, follow, samples)


def with_phases(table: Table, found: Fit, receptance: ComplexArray) -> Table:
    """Return a table with the phases that law and background (n,) [m/N] predict, if it has none."""
    if table.phase_known:
        return table
    law = found.problem.law
    seen = np.abs(table.harmonics[:, 1])
    held = np.isfinite(seen) & (seen > 0)
    force = np.abs(table.force).astype(np.complex128)
    harmonics = sine_motion(table.omega, seen).harmonics
    b, omega, wanted = receptance[held], table.omega[held], seen[held]
    size = np.array(wanted)
    for _ in range(MAX_TRIAL_STEPS):
        balance = _balance_at_amplitudes(law, found.values, found.mass, omega, size, START_HARMONICS)
        response = size + b * balance.force
        slope = (np.conj(response) * (1 + b * balance.force_slope / size)).real / np.abs(response)
        step = (wanted - np.abs(response)) / np.where(np.abs(slope) > MIN_RELATIVE_SLOPE, slope, 1.0)
        size = size + np.nan_to_num(np.clip(step, -0.5 * size, 0.5 * size))
    balance = _balance_at_amplitudes(law, found.values, found.mass, omega, size, START_HARMONICS)
    force[held] *= np.exp(1j * np.nan_to_num(np.angle(balance.force)))
    harmonics[held, 1] *= np.exp(1j * np.nan_to_num(np.angle(size + b * balance.force)))
    if isinstance(table, Points):
        return replace(table, force=force, harmonics=harmonics, measured=(1,), phase_known=True)
    return replace(table, force=force, harmonics=harmonics)
