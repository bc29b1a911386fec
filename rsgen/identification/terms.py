"""Terms that a law or a background may lack, as additional columns of a fit: the score test.

At the solution a term of value zero has a slope c like every parameter. With c_o the part of c outside the
span of the parameters and the nuisances, and r the residual in units of the noise, its value would be
c_o.r/|c_o|^2 and the sum of squares smaller by (c_o.r)^2/|c_o|^2 (Rao, Proc. Cambridge Phil. Soc. 44, 1948).
So dozens of changes are asked at the price of one step, and only the best are fitted (``share_left_by``).
Several columns together show what no single term does: any k(X) and c(X), or a gain of the force at each
level.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from math import isnan, nan
from typing import Any, NamedTuple

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.solvers import solve_scaled
from rsgen.common.tolerances import (
    DEVIATING_MISFIT_RATIO,
    MIN_MISFIT_REDUCTION,
    MIN_SIGNIFICANT_GAIN,
    MISFIT_NEGLIGIBLE,
    MISFIT_REJECTED,
    NEAR_STEPS,
    NOISE_RATIO_BY_CHANCE,
    POINTS_PER_KNOT,
    START_HARMONICS,
    SUBSAMPLE_POINTS,
    interval_sigmas,
    is_significant,
)
from rsgen.data.free_mode import fit_mode, hats, steady
from rsgen.data.oscillator import BACKGROUNDS, OFFSET
from rsgen.dynamics.linear_part import BackgroundTerms, background_terms
from rsgen.formula.names import symbol
from rsgen.identification.fitting.across import law_of
from rsgen.identification.fitting.fit import Fit, fit_balance, linearise_extended
from rsgen.identification.fitting.least_squares import Rules
from rsgen.identification.fitting.observed import Observed, Problem, effective_power, neighbour_power
from rsgen.identification.fitting.points import Points
from rsgen.identification.results.alternatives import Agreement, Alternative, alternatives, stands_out
from rsgen.identification.starting.start import records_even, start_fit
from rsgen.law.element import make_element
from rsgen.law.numeric import ForceLaw

MISSING_TERMS = ("x*abs(x)", "x**3", "x**5", "v*abs(v)", "v**3", "sign(v)")
"""Terms that a law may lack: the commonest nonlinear springs and dampers, which approximate others."""

_CHANNEL_STEP = 1e-3
"""Of the phase [rad] or the logarithm of the gain of a channel, by which their slopes are found."""

EVEN_SHARE = 0.1
"""Force of an even term relative to that of the spring, which no fundamental shows."""


def with_coefficients(terms: Sequence[str], taken: Collection[str]) -> dict[str, str]:
    """Return each term times a parameter of a new name, by that name."""
    free = (name for i in count() if (name := f"term{i}") not in taken)
    return {name: f"{name}*({term})" for name, term in zip(free, terms, strict=False)}


def law_with(problem: Problem, *terms: str) -> ForceLaw:
    """Add terms to the law, across two sensors where some elements act there."""
    place = problem.law.parts[-1].sensors
    forces = with_coefficients(terms, problem.law.parameters).values()
    added = (make_element("additional term", force, across=place) for force in forces)
    return law_of((*problem.elements, *added))


def with_terms(problem: Problem, fit: Fit, terms: Sequence[str]) -> tuple[Problem, Array, list[int]]:
    """Return the problem with terms, the parameters of a fit with zeros for them, and their indices (t,).

    Even terms make the motions asymmetric.
    """
    values, mass, background = problem.split(fit.regression.parameters)
    law, known = law_with(problem, *terms), problem.law.named(values)
    start = np.array([known.get(name, 0.0) for name in law.parameters])
    frozen = tuple(law.parameters.index(problem.law.parameters[place]) for place in problem.frozen)
    trial = replace(problem, law=replace(law, odd=problem.law.odd and law.odd), frozen=frozen)
    added = with_coefficients(terms, known)
    return trial, trial.join(start, mass, background), [law.parameters.index(name) for name in added]


def unfixed_terms(law: ForceLaw, fixed: Iterable[str], terms: Sequence[str] = MISSING_TERMS) -> list[str]:
    """Return the terms whose coefficient is not one of the fixed parameters of a law."""
    known = {law.expression.diff(symbol(name)) for name in fixed}
    return [term for term in terms if make_element("term", term).force not in known]


def fit_missing_terms(fit: Fit, noise: float, terms: Sequence[str] = MISSING_TERMS) -> dict[str, Alternative]:
    """Fit each term that the law may lack, to first order, in units of a noise; none with a fixed
    coefficient.
    """
    terms = unfixed_terms(fit.problem.law, fit.problem.fixed, terms)
    problem, parameters, added = with_terms(fit.problem, fit, terms)
    residual, matrix = linearise_extended(fit, problem, parameters)
    right, rows = equations_of(fit, problem, residual, matrix, noise)
    kept = np.delete(np.arange(len(parameters)), added)
    none = np.zeros(len(parameters)), np.zeros((0, residual.size))
    used = problem.observed.points.select(fit.regression.used)
    # no rows if no loop closes with another term
    record = used.record if len(residual) == len(used) else None
    found = alternatives(
        right, rows[:, kept], rows[:, added], *none, Rules(free=problem.free[kept], record=record)
    )
    return dict(zip(terms, found, strict=True))


def equations_of(
    fit: Fit, problem: Problem, residual: Array, matrix: Array, noise: float
) -> tuple[Array, Array]:
    """Return residual (r,) and slopes (r, q) of points over a noise, with what is known of the mass."""
    right, rows = residual.reshape(-1) / noise, matrix.reshape(residual.size, matrix.shape[2]) / noise
    return with_weighing(right, rows, problem.observed.points.weighed, problem.count - 1, fit.mass)


def with_weighing(
    right: Array, rows: Array, weighed: tuple[float, float] | None, place: int, mass: float
) -> tuple[Array, Array]:
    """Return equations (r,), (r, q) of unit variance, then that of a mass which was weighed, if it was.

    ``weighed`` is that mass with its error, ``place`` the column of the mass, and ``mass`` the one found.
    """
    if weighed is None:
        return right, rows
    row = (np.arange(rows.shape[1]) == place) / weighed[1]
    return np.append(right, (weighed[0] - mass) / weighed[1]), np.vstack([rows, row])


MIRRORED = "mirrored"
"""Stands among terms for the law of -x in place of the law."""


def few_points(fit: Fit) -> Problem:
    """Return what is fitted, with some of the points that were used."""
    chosen = fit.problem.observed.points.spread(SUBSAMPLE_POINTS)
    return fit.problem.select(chosen[fit.regression.used[chosen]])


def share_left_by(fit: Fit, term: str) -> float:
    """Return the share of the misfit that a term would leave, or the ``MIRRORED`` law.

    By fits of one harmonic to some of the points; the sides of a law are told by even ones.
    """
    few, mirrored = few_points(fit), term == MIRRORED
    trials = [with_terms(few, fit, terms)[:2] for terms in ((), () if mirrored else (term,))]
    if mirrored:
        trials[1] = start_fit(replace(few, observed=few.observed.mirrored(), frozen=()))
    order = START_HARMONICS if mirrored else 1
    whole, left = (fit_near(*trial, order=order).regression.sigma for trial in trials)
    return left / whole if whole > 0 and np.isfinite(left) else np.inf


def free_curves_leave(fit: Fit, points: Points) -> float:
    """Share of the misfit left by a stiffness and a damping that may depend on amplitude in any way.

    What they take up is the law's: an error of a sensor, another mode or a slow sweep do not follow the
    amplitude alone. To the dynamic stiffness that the law predicts k(X), omega c(X), h(X), for losses that do
    not grow with the frequency, and the mass where it is free are added by linear least squares. Infinite
    where there are too few points.

    Parameters
    ----------
    fit
        The refined one.
    points
        That were fitted, without the background.
    """
    predicted = fit.force / fit.harmonics[:, 1]
    good = fit.regression.used & np.isfinite(predicted)
    if np.count_nonzero(good) < 2 * POINTS_PER_KNOT:
        return np.inf
    points, predicted = points.select(good), predicted[good]
    response, weight = points.harmonics[:, 1], 1 / np.abs(points.force)
    missed = points.force - predicted * response
    free = fit_mode(
        *steady(missed, response, points.omega),
        hats(points.amplitude),
        weight,
        # what is missed of a mass that is known is nothing
        mass=0.0 * fit.problem.fixed.get("m", nan),
        orders=(1, 0),
    )
    share = np.sum(np.abs(free.left) ** 2) / np.sum(np.abs(weight * missed) ** 2)
    return float(np.sqrt(share / (1 - free.unknowns / (2 * len(missed)))))


def force_factors(fit: Fit) -> tuple[float, dict[float, float], float]:
    """Return the share of the misfit left by another factor of the force at each level, these factors, and
    the largest share that a cause leaves (``_left_by_half``): friction takes up a part of a wrong force.

    A shaker whose force was not measured, or an amplifier, has a gain that changes with the level. To first
    order the residual changes by the same column c for a factor of all forces; its rows at one level are the
    column of the factor there. Factors are those of the measured forces to what fits, relative to the median.
    Infinite, and no factors, if points are too few, or one factor of all levels, or mass, takes up half.
    """
    points = fit.problem.observed.points
    residual, matrix, column = _by_points(fit, force=np.exp(1.0) * points.force)
    levels = points.level[fit.regression.used]
    names = np.unique(levels)
    at = levels[:, None] == names
    if len(residual) != len(levels) or len(levels) < POINTS_PER_KNOT * at.shape[1]:
        return np.inf, {}, np.inf
    columns = np.concatenate([matrix[:, :, fit.problem.free], column[:, :, None] * at[:, None]], axis=2)
    right, rows = residual.reshape(-1), columns.reshape(residual.size, -1)
    common = np.column_stack([rows[:, : -len(names)], rows[:, -len(names) :].sum(axis=1)])
    shared = right - common @ solve_scaled(common, right)[0]
    if np.linalg.norm(shared) < (1 - MIN_MISFIT_REDUCTION) * np.linalg.norm(right):
        return np.inf, {}, np.inf
    solution = solve_scaled(rows, right)[0]
    left = right - rows @ solution
    gains = solution[-len(names) :]
    factors = dict(zip(names.tolist(), np.exp(gains - np.median(gains)).tolist(), strict=True))
    share = float(np.sqrt(np.sum(left**2) / np.sum(right**2) / (1 - at.shape[1] / len(right))))
    return share, factors, _left_by_half(residual, points.select(fit.regression.used).neighbours)[1]


def other_gain(fit: Fit, unit: str) -> dict[str, Quantity]:
    """Return the level whose force has another factor than all others as its "gain", the one that is farthest
    off as a "factor" where several do.
    """
    factors = force_factors(fit)[1]
    *others, (worst, level) = sorted((abs(np.log(factor)), level) for level, factor in factors.items())
    if len(others) < 2:
        return {}
    name = "gain" if worst >= DEVIATING_MISFIT_RATIO * others[-1][0] else "factor"
    return {"level": Quantity(level, unit), name: Quantity(factors[level])}


class ChannelError(NamedTuple):
    """An error of a channel to first order: the misfit that it leaves, its value, half of its interval."""

    left: float
    value: float
    within: float


def channel_finding(
    fit: Fit, misfit: float, rivals: Sequence[float], left_by: Mapping[str, float], base: str = ""
) -> Finding | None:
    """Find a delay, a phase error or a gain of a channel that takes up most of a misfit, to first order.

    Most is meant of what neighbours share (``_left_by_half``). ``rivals`` are what a term and free curves
    leave, ``left_by`` what backgrounds leave, which have more values. A narrow band does not tell a delay
    from a phase error, nor a lag from losses that do not grow with the frequency, which free curves take up.
    On a driven ``base`` the mass follows from the force, so that the points show the gain, of a relative or
    an absolute response. A fit that did not converge says nothing of any.
    """
    used = fit.problem.observed.points.select(fit.regression.used)
    residual = linearise_extended(fit, fit.problem, fit.regression.parameters)[0]
    if not (used.phase_known and fit.regression.converged) or used.far.size or len(residual) != len(used):
        return None
    errors = [_channel_errors(fit, misfit, base, absolute=one) for one in (False, True)[: 1 + bool(base)]]
    kinds = min(errors, key=lambda kinds: min(kinds.values()))
    noise, most = (misfit * share for share in _left_by_half(residual, used.neighbours))
    return blame_channel(kinds, (misfit, most, noise), fit.regression.freedom, rivals, left_by, base)


def blame_channel(
    kinds: Mapping[str, ChannelError],
    size: tuple[float, float, float],
    freedom: float,
    rivals: Sequence[float],
    left_by: Mapping[str, float],
    base: str,
) -> Finding | None:
    """Find the error of a channel by its ``kinds`` that takes up most, as ``channel_finding`` does.

    ``size`` are the misfit, the most that is to be left of it, and its noise.
    """
    misfit, most, noise = size
    best = min(kinds, key=kinds.__getitem__)
    left, off, within = kinds[best]
    clear = misfit**2 - left**2 > max(MISFIT_NEGLIGIBLE**2, MIN_SIGNIFICANT_GAIN / freedom * left**2)
    clear &= simplest_background({best: left, **left_by}, misfit) == best
    more = np.sqrt(1 + MIN_SIGNIFICANT_GAIN / freedom)
    if not (clear and left < min(most, MISFIT_REJECTED, more * max(min(rivals), noise))):
        return None
    numbers = quantities(left=left, misfit=misfit)
    if best == "gain":
        # the first order leaves the second
        numbers |= quantities(gain=np.expm1(off), within=np.hypot(within, off**2))
        return Finding("channels-delayed", "doubt", numbers=numbers)
    if kinds["delay"].left < more * left:
        numbers["delay"] = Quantity(-kinds["delay"].value, "s")
    if "turn" in kinds and kinds["turn"].left < more * left:
        numbers["turn"] = Quantity(kinds["turn"].value, "rad")
    names = {"base": "driven"} if base else {}
    names |= {"loss": "yes"} if off < 0 and min(rivals) < more * left else {}
    return Finding("channels-delayed", "doubt", numbers=numbers, names=names)


def ratio_finding(fit: Fit, base: str) -> Finding | None:
    """Find a delay, of a driven ``base`` a gain of a channel, that explains what the background does.

    It is a ``channel_finding`` of the fit without the background, on a base but for its phase error, and
    leaves no more than noise above what the background, which has more values, leaves.
    """
    own, misfit = fit.problem.observed.background, fit.regression.rms_misfit
    if len(own.names) <= 1:
        return None
    few = fit.select(np.flatnonzero(fit.regression.used))
    without = fit_near(*with_background(few, BACKGROUNDS[bool(base)]), order=fit.order)
    off = channel_finding(without, without.regression.rms_misfit, (misfit,), {own.kind: misfit}, base)
    if off is None or ("gain" if base else "delay") not in off.numbers:
        return None
    numbers = {**off.numbers, "behind": Quantity(misfit)}
    return replace(off, numbers=numbers, names={"background": own.kind})


def _left_by_half(residual: Array, pairs: NDArray[np.intp]) -> tuple[float, float]:
    """Return the share of noise, which neighbours do not share, in a misfit, and it with half of the rest."""
    power, shared = neighbour_power(residual, pairs)
    noise = float(np.sqrt(1 - np.clip(np.sum(shared) / np.sum(power), 0, 1)))
    return noise, float(np.hypot(noise, (1 - MIN_MISFIT_REDUCTION) * np.sqrt(1 - noise**2)))


def _channel_errors(fit: Fit, misfit: float, base: str, *, absolute: bool) -> dict[str, ChannelError]:
    """Return the error of a channel by its kind: delay [s], turn [rad], on a base the logarithm of a gain.

    Of one so large that its second order exceeds what the first leaves, a fit without it tells the rest.
    """
    few = fit.select(np.flatnonzero(fit.regression.used))
    problem, points = few.problem, few.problem.observed.points
    channel = partial(_with_factor, points, fit.mass if absolute else nan)
    residual, matrix, turned = _by_points(few, **channel(np.exp(-1j * _CHANNEL_STEP)))
    if len(residual) != len(points):
        return {}
    columns = {"delay": turned * points.omega[:, None], "turn": turned}
    if base:
        columns["gain"] = _by_points(few, **channel(np.exp(-_CHANNEL_STEP)))[2]
    right, freedom = residual.reshape(-1), fit.regression.freedom
    kinds: dict[str, ChannelError] = {}
    for name, changed in columns.items():
        more = np.concatenate([matrix[:, :, problem.free], changed[:, :, None] / _CHANNEL_STEP], axis=2)
        rows = more.reshape(residual.size, -1)
        solution, inverse, _ = solve_scaled(rows, right)
        missed = right - rows @ solution
        size = float(np.linalg.norm(missed))
        # neighbours that miss alike are fewer points
        unit = (missed * np.sqrt(len(missed)) / size).reshape(residual.shape)
        error = np.sqrt(effective_power(unit, points.neighbours) / freedom) * size
        within = float(interval_sigmas(freedom) * error * np.linalg.norm(inverse[-1]))
        left, value = misfit * size / float(np.linalg.norm(right)), float(solution[-1])
        kinds[name] = ChannelError(left, value, within)
        turn = value * (points.omega if name == "delay" else np.ones(len(points)))
        if name != "gain" and left < min((1 - MIN_MISFIT_REDUCTION) * misfit, np.max(turn**2) / 2):
            seen = replace(problem.observed, points=replace(points, **channel(np.exp(1j * turn))))
            near = fit_near(replace(problem, observed=seen), few.regression.parameters, order=fit.order)
            rest = _channel_errors(near, near.regression.rms_misfit, base, absolute=absolute).get(name)
            kinds[name] = rest._replace(value=value + rest.value) if rest else kinds[name]
    return kinds


def _with_factor(points: Points, mass: float, factor: Any) -> dict[str, Any]:
    """Return the force with a factor, or with a mass the response whose absolute motion has its inverse.

    The base moves with x_b = F/(m omega^2), and the response is x = x_abs - x_b.
    """
    if isnan(mass):
        return {"force": factor * points.force}
    order, base = np.arange(points.harmonics.shape[1]), np.zeros_like(points.harmonics)
    base[:, 1] = points.force / (mass * points.omega**2)
    by = np.exp(-1j * order * np.angle(factor)[..., None]) / np.abs(factor)[..., None]
    return {"harmonics": by * (points.harmonics + base) - base}


def _by_points(fit: Fit, **columns: Any) -> tuple[Array, Array, Array]:
    """Return the residual (k, M), its slopes (k, M, q), and its change where points have other columns."""
    residual, matrix = linearised_with(fit)
    return residual, matrix, linearised_with(fit, **columns)[0] - residual


def linearised_with(fit: Fit, **columns: Any) -> tuple[Array, Array]:
    """Return residual (k, M) and slopes (k, M, q) where points have other columns."""
    observed = fit.problem.observed
    other = replace(observed, points=replace(observed.points, **columns))
    return linearise_extended(fit, replace(fit.problem, observed=other), fit.regression.parameters)


def fit_near(problem: Problem, parameters: Array, *, order: int) -> Fit:
    """Fit all points by a few steps from values that are near."""
    return fit_balance(problem, parameters, order=order, exclude=False, steps=NEAR_STEPS, correct=False)


def alternatives_to(
    fit: Fit, agreement: Agreement, *, backgrounds: bool
) -> dict[str, Mapping[str, Alternative]]:
    """Return the alternatives to a fit: one more term, halves of points, larger ``backgrounds`` if asked."""
    noise = max(fit.regression.sigma * float(np.median(agreement.wider)), 1e-300)
    more = fit_larger_backgrounds(fit, noise) if backgrounds else {}
    kinds: dict[str, Mapping[str, Alternative]] = {"term": fit_missing_terms(fit, noise)}
    kinds |= {"background": more, "halves": agreement.halves}
    offset = _fit_offset(fit, noise) if fit.systematic else None
    if offset is not None and stands_out(offset):
        kinds["offset of the sensor"] = {"mean": offset}
    return kinds


def _fit_offset(fit: Fit, noise: float) -> Alternative | None:
    """Fit a constant mean, an offset of the sensor, to first order; it is the last of the shifts [m].

    None where no mean is compared.
    """
    problem, points, count = fit.problem, fit.problem.observed.points, len(fit.regression.parameters)
    if problem.law.odd or problem.law.acts_across or 0 not in points.measured:
        return None
    size, harmonics = float(np.median(points.amplitude)), np.array(points.harmonics)
    harmonics[:, 0] += size
    residual, matrix, column = _by_points(fit, harmonics=harmonics)
    if not len(residual):
        return None
    columns = np.concatenate([matrix, column[:, :, None] / size], axis=2)
    free = np.flatnonzero(problem.free).tolist()
    equations = equations_of(fit, problem, residual, columns, noise)
    return joint_alternatives(*equations, free, {"mean": [*free, count]}, count + 1, residual.size)["mean"]


def fit_larger_backgrounds(fit: Fit, noise: float) -> dict[str, Alternative]:
    """Fit each kind of background that is larger than that of the fit, to first order.

    Not a neighbouring mode, whose frequency has no slope.
    """
    own, count = fit.problem.observed.background, fit.problem.count
    if own.kind.startswith(BACKGROUNDS[-1]):
        return {}
    problem, start = with_background(fit)
    seen, larger = problem.observed, problem.observed.background
    residual, matrix = linearise_extended(fit, problem, start)
    equations = equations_of(fit, problem, residual, matrix, noise)
    fitted = [name for name, kept in zip(larger.names, seen.fitted, strict=True) if kept]
    return larger_backgrounds(*equations, fit.problem.free[:count], own, larger, fitted, residual.size)


LARGEST = BACKGROUNDS[-2] + OFFSET
"""The largest kind of background whose values have slopes at zero."""


def with_background(fit: Fit, kind: str = LARGEST) -> tuple[Problem, Array]:
    """Return the problem with another kind of background, and the parameters of a fit there."""
    observed = fit.problem.observed
    points, own = observed.points, observed.background
    other = background_terms(kind, points.omega, points.force, own.band)
    seen = replace(Observed.of(points, kind), background=other, scale=observed.scale)
    start = fit.problem.join(fit.values, fit.mass, other.values_from(own, fit.background))
    return replace(fit.problem, observed=seen), start


def simplest_background(left_by: Mapping[str, float], misfit: float) -> str:
    """Return the first, simplest kind of background that leaves hardly more than the best one.

    Where most of the misfit is noise, all kinds leave nearly as much: it explains what the best one explains.
    """
    least = min(left_by.values())
    most = least**2 + (1 - MIN_MISFIT_REDUCTION) ** 2 * max(misfit**2 - least**2, 0.0)
    return next(
        kind for kind, left in left_by.items() if left <= min(NOISE_RATIO_BY_CHANCE * least, np.sqrt(most))
    )


def larger_backgrounds(
    right: Array,
    rows: Array,
    free: NDArray[np.bool_],
    own: BackgroundTerms,
    larger: BackgroundTerms,
    fitted: Collection[str],
    rows_of_points: int | None = None,
) -> dict[str, Alternative]:
    """Return each kind of background beyond that of a fit, ``own``, as ``joint_alternatives``.

    The last columns of ``rows`` (r, q) are the values of the ``larger`` background, of which those of the
    names ``fitted`` are determined at all; ``free`` (count,) is False for fixed parameters of the law.
    """
    count, names, known = len(free), larger.names, own.names

    def places(those: Collection[str]) -> list[int]:
        """Return the columns of the free parameters and of some of the background."""
        seen = [place for place, name in enumerate(names, count) if name in fitted and name in those]
        return [*np.flatnonzero(free).tolist(), *seen]

    kinds = (kind + ending for kind in BACKGROUNDS[1:-1] for ending in ("", OFFSET))
    more = {kind: background_terms(kind, larger.omega[:1], np.ones(1), larger.band).names for kind in kinds}
    groups = {kind: places(terms) for kind, terms in more.items() if set(terms) > set(known)}
    return joint_alternatives(right, rows, places(known), groups, count, rows_of_points)


def joint_alternatives(
    right: Array,
    rows: Array,
    own: Sequence[int],
    groups: Mapping[str, Sequence[int]],
    count: int,
    rows_of_points: int | None = None,
) -> dict[str, Alternative]:
    """Return fits to first order with groups of columns (r, q), which contain those of the fit, ``own``.

    ``right`` and ``rows`` have unit variance; shifts are those of the first ``count`` columns. Behind the
    rows of points, all if None, are those of values that are known: the share that is left has none of them.
    """

    def solve(columns: Sequence[int]) -> tuple[Array, Array, Array]:
        """Return the change of all columns, its variance, and the squares (r,) that are left."""
        change, variance = np.zeros((2, rows.shape[1]))
        change[columns], inverse, _ = solve_scaled(rows[:, columns], right)
        variance[columns] = np.sum(inverse**2, axis=1)
        return change[:count], variance[:count], (right - rows @ change) ** 2

    (begin, least, square), found = solve(own), {}
    for name, columns in groups.items():
        change, variance, left = solve(columns)
        gain, hidden = max(np.sum(square) - np.sum(left), 0.0), np.sqrt(np.maximum(variance - least, 0.0))
        share = np.sum(left[:rows_of_points]) / max(np.sum(square[:rows_of_points]), 1e-300)
        more = len(columns) - len(own), hidden, float(np.sqrt(share))
        found[name] = Alternative(float(np.sqrt(gain)), 1.0, change - begin, *more)
    return found


def even_force_shift(fit: Fit) -> tuple[float, Array]:
    """Return the shift of the values by a force k2*x**2, which acts on fundamentals in proportion to k2^2.

    Returns
    -------
    k2, moved
        Coefficient of a force of ``EVEN_SHARE`` of the inertia at the largest amplitude, and the error (q,)
        of values that are fitted without it, which is proportional to k2^2.
    """
    problem, parameters, (place,) = with_terms(fit.problem, fit, ("x**2",))
    points = problem.observed.points
    largest = int(np.argmax(points.amplitude))
    spring = fit.mass * float(points.omega[largest]) ** 2
    parameters[place] = EVEN_SHARE * spring / float(points.amplitude[largest])
    _, matrix = linearise_extended(fit, problem, parameters)
    rows = matrix.reshape(-1, len(parameters))
    # the change by a quadratic effect is half of its slope times the value
    column = rows[:, place] * parameters[place] / 2
    moved, free = np.zeros(len(parameters)), np.flatnonzero(problem.free)
    free = free[free != place]
    moved[free] = solve_scaled(rows[:, free], column)[0]
    return float(parameters[place]), np.delete(moved, place)


def gain_of(other: Fit, own: Fit) -> float | None:
    """Return by how much another fit lowers the sum of squares, of what is known too, in units of the noise.

    None if it predicts not all points, or is worse beyond chance.
    """
    cost, least = other.regression.cost, own.regression.cost
    gain = (least - cost) / max(own.regression.sigma, 1e-300) ** 2
    good = other.regression.used.all() and not is_significant(max(-gain, 0.0) ** 0.5, 1.0)
    return gain if good else None


def stop_findings(fit: Fit, units: Mapping[str, str]) -> tuple[Finding, ...]:
    """Find that a stop on the other side, too, or on one side alone fits as well or better; none or one.

    Fundamentals show the odd part of a stop, which is as large for one on one side as for one of half the
    stiffness on both; only by what its mean does to the shape of the resonance they differ. The value is the
    stiffness of the other stop, in the ``units`` of the parameters.
    """
    few = fit.select(np.flatnonzero(fit.regression.used))
    problem, law, x = few.problem, few.problem.law, symbol("x")
    plain = law.rough and not (law.remembers or law.acts_across)
    if records_even(problem) or not (plain and fit.regression.converged):
        return ()
    gaps = {symbol(law.parameters[i]) for i in law.nonlinear}
    stops = sympy.Add(*(p for p in sympy.Add.make_args(law.expression.expand()) if p.free_symbols & gaps))
    values, mass, background = problem.split(few.regression.parameters)
    numbers = {symbol(name): value for name, value in zip(law.parameters, values, strict=True)}
    largest = float(problem.observed.points.amplitude.max())
    reached = [stops.xreplace(numbers).xreplace({x: sympy.Float(sign * largest)}) for sign in (1, -1)]
    known = np.isfinite(np.diag(few.regression.covariance))
    stiff = [i for i in law.linear if symbol(law.parameters[i]) in stops.free_symbols and known[i]]
    unseen = not any(reached) or (all(reached) and not law.odd)
    if symbol("v") in stops.free_symbols or unseen or not stiff:
        return ()
    even, sizes = stops.xreplace({x: sympy.Abs(x)}), np.ones(len(values))
    other = (stops + even) / 2 if law.odd else stops - stops.xreplace({x: -x})
    sizes[stiff] = 2.0 if law.odd else 0.5
    elements = (make_element("stop elsewhere", law.expression - stops + other),)
    trial = replace(problem, elements=elements, law=law_of(elements), frozen=())
    start = trial.join(values * sizes, mass, background)
    found = fit_balance(trial, start, order=max(few.order, START_HARMONICS), exclude=False, correct=False)
    if (gain := gain_of(found, few)) is None:
        return ()
    name, better = law.parameters[stiff[0]], gain > MIN_SIGNIFICANT_GAIN
    numbers = {"value": Quantity(float(found.values[stiff[0]]), units[name])}
    names = {"side": "one" if law.odd else "both", "fits": "better" if better else "as well"}
    return (Finding("mirror-image-fits", "doubt" if better else "warning", name, numbers, names),)
