"""Weighted least squares of the balance at the lines of periodic records, with standard errors.

Minimised is the sum over records and lines of |e_h(p, m)|^2 / variance_h, with e_h and its noise from
``line_balance``. Gauss-Newton steps are enough, because e is linear in m and in most p; weights and bias are
then taken at the solution, and the fit is repeated (iteratively reweighted least squares). Noise of the
slopes pulls the estimate by (J^T W J)^-1 times the weighted covariance of slopes and balance; this is
subtracted (errors in variables).

Standard errors: (J^T W J)^-1, but at least as large as the scatter of the single periods says; where the
misfit exceeds noise, or one period says nothing of noise, the lines are not independent and the
delete-a-group jackknife over parts of the band replaces it (CR3: Cameron and Miller, J. Human Resources 50,
2015).

Initial values: along sampled motions the balance is linear in most parameters; those are solved for at every
trial of the others (variable projection).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.solvers import determined, solve_scaled
from rsgen.common.tolerances import (
    FINITE_DIFFERENCE_STEP,
    JACKKNIFE_GROUPS,
    MAX_ALTERNATIONS,
    MAX_NEWTON_STEPS,
    MAX_TRIAL_STEPS,
    MISFIT_NEGLIGIBLE,
    NOISE_LIMIT_SIGMAS,
    NOISE_RATIO_BY_CHANCE,
    NONLINEAR_TRIALS,
    ROUND_OFF,
    f_quantile,
    interval_sigmas,
    normal_share,
)
from rsgen.data.multisine.spectra import LINES_TO_EACH_SIDE, rms, smooth
from rsgen.data.oscillator import BACKGROUNDS
from rsgen.dynamics.linear_part import background_of_lines
from rsgen.identification.fitting.across import law_of
from rsgen.identification.fitting.least_squares import Linearisation, Regression, Rules, descend, summarise
from rsgen.identification.lines.line_balance import Balance, BalanceNoise, SpectralLines
from rsgen.identification.results.alternatives import Alternative, alternatives
from rsgen.identification.starting.search import search_values
from rsgen.identification.starting.start import neighbours
from rsgen.identification.terms import (
    LARGEST,
    ChannelError,
    joint_alternatives,
    larger_backgrounds,
    unfixed_terms,
    with_coefficients,
    with_weighing,
)
from rsgen.law.element import Element, make_element
from rsgen.law.motion import Motion
from rsgen.law.numeric import DECADES, ForceLaw, natural_sizes

_MIN_INFORMATION_OUTSIDE_GROUP = 1e-3
"""A direction that the points outside a group determine less is not part of the jackknife."""
_SMOOTHING_HALF_WIDTH = 20
"""Lines to each side over which the power of the misfit is averaged; its relative error is 2/sqrt(2*41)."""
_ROUND_OFF_POWER = 1e-26
"""Power of round-off, relative to that of the balance."""


@dataclass(frozen=True, eq=False)
class LineFit:
    """A law fitted to the lines of records.

    Parameters
    ----------
    lines, law
        Data and model.
    fixed
        Values of parameters that are known, by name; "m" is the mass [kg].
    parameters
        (q,) values of the law, the mass [kg], and the background.
    noise
        Noise of the balance from the single periods.
    variance
        (r, H+1) variance by which each line is weighted [N^2].
    converged
        True if the last step was small.
    """

    lines: SpectralLines
    law: ForceLaw
    fixed: Mapping[str, float]
    parameters: Array
    noise: BalanceNoise
    variance: Array
    converged: bool = False

    @property
    def values(self) -> Array:
        """Values (p,) of the parameters of the law."""
        return self.parameters[: len(self.law.parameters)]

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self.parameters[len(self.law.parameters)])

    @property
    def background(self) -> Array:
        """Values (b,) of the background."""
        return self.parameters[len(self.law.parameters) + 1 :]

    @property
    def free(self) -> NDArray[np.bool_]:
        """Mask (q,), False for fixed parameters."""
        of_law = [name not in self.fixed for name in (*self.law.parameters, "m")]
        return np.array(of_law + [True] * len(self.background))

    @property
    def rules(self) -> Rules:
        """Rules of a descent: which parameters are fixed, and a mass that was weighed."""
        held = self.fixed.get("m", np.nan)
        return Rules(free=self.free).knowing(len(self.values), self.lines.weighed, held)

    @cached_property
    def mode(self) -> SpectralLines:
        """The lines without the background."""
        return self.lines.mode(self.background)

    @cached_property
    def balance(self) -> Balance:
        """The balance at ``parameters``."""
        return Balance.of(self.mode, self.law, self.values, self.mass, self.noise)

    @cached_property
    def regression(self) -> Regression:
        """The linearised fit: covariance and null space for the variances of the lines."""
        line = self.linearise(self.parameters, self.nuisance)
        return summarise(line, self.parameters, self.nuisance, self.rules, converged=self.converged)

    @cached_property
    def errors(self) -> tuple[Regression, float]:
        """The fit with errors by the scatter of the periods, or of parts of the band, and the median ratio by
        which the jackknife over these parts widens the standard errors.
        """
        found, covariance = self.regression, self.regression.basis @ self.regression.basis.T
        covariance, widening, freedom = covariance * _scatter_of_periods(self, covariance), 1.0, np.inf
        # of one period the misfit may be all the law's
        if self.systematic or self.lines.spectra.periods == 1:
            # the correction for noise of the slopes has moved the residual off the minimum: project it back
            parts, residual = band_parts(self.lines), _orthogonal_to_parameters(found, found.residual)
            ratio = _wider(np.diag(jackknife(replace(found, residual=residual), parts)), covariance)
            covariance = covariance * np.outer(ratio, ratio)
            widening, freedom = float(np.median(ratio[self.free])), int(parts.max())
        return found.widened(determined(covariance, found.null), freedom), widening

    @property
    def misfit(self) -> float:
        """Root mean square misfit, relative to the force."""
        return relative_to_force(self.lines, np.abs(self.balance.residual) ** 2)

    @property
    def relative_noise(self) -> float:
        """Root mean square noise of the balance, relative to the force; NaN of one period."""
        return relative_to_force(self.lines, self.noise.variance)

    @property
    def systematic(self) -> bool:
        """True if the misfit exceeds the noise of the periods."""
        return misfit_to_noise(self) > max_misfit_of_noise(self)

    @property
    def nuisance(self) -> Array:
        """Empty array (lines, 0): a line has no unknowns of its own."""
        return np.zeros((np.count_nonzero(self.lines.used), 0))

    def equations(self, *columns: Array) -> tuple[Array, Array]:
        """Return residual (k,) and slopes (k, q), then further columns (lines, 2); last a weighed mass."""
        line = self.linearise(self.parameters, self.nuisance)
        rows = np.concatenate([line.by_parameter, *(column[:, :, None] for column in columns)], axis=2)
        right = line.residual.reshape(-1)
        rows = rows.reshape(len(right), -1)
        return with_weighing(right, rows, self.lines.weighed, len(self.values), self.mass)

    def scaled(self, force: float, response: float) -> tuple[Array, Array]:
        """Return ``equations`` with factors of force and response."""
        return replace(self, lines=self.lines.scaled(force, response)).equations()

    def linearise(self, parameters: Array, nuisance: Array) -> Linearisation:
        """Return real and imaginary part of each used line, scaled to unit variance, at other parameters."""
        fit = self if parameters is self.parameters else replace(self, parameters=parameters)
        used, weight = self.lines.used, np.sqrt(2 / self.variance)
        matrix = np.moveaxis(fit.balance.slopes * weight[:, None], 1, 2)[used]
        right = (fit.balance.residual * weight)[used]
        return Linearisation(
            np.stack([right.real, right.imag], axis=1),
            np.zeros((len(right), 2, 0)),
            np.stack([matrix.real, matrix.imag], axis=1),
        )


def _line_variances(fit: LineFit, noise: BalanceNoise) -> Array:
    """Return the variance (r, H+1) of each line: its noise, or the smoothed misfit where that is larger."""
    records = zip(np.abs(fit.balance.residual) ** 2, noise.weight_shape, fit.lines.used, strict=True)
    misfit = np.stack([_smoothed_power(power / shape, used) * shape for power, shape, used in records])
    known = np.isfinite(noise.variance)
    # the smoothed power of pure noise exceeds this limit once in thousands
    limit = 1 + NOISE_LIMIT_SIGMAS / np.sqrt(2 * _SMOOTHING_HALF_WIDTH + 1)
    variance = np.where(~known | (misfit > limit * noise.variance), misfit, noise.variance)
    return np.maximum(variance, _ROUND_OFF_POWER * fit.mode.power(fit.mass))


def _smoothed_power(power: Array, used: NDArray[np.bool_]) -> Array:
    """Return the moving average (H+1,) of a power over the used lines."""
    chosen = np.flatnonzero(used)
    result = np.zeros(len(power))
    result[chosen] = smooth(np.concatenate([[0.0], power[chosen]]), _SMOOTHING_HALF_WIDTH)[1:]
    return result


def fit_lines(
    lines: SpectralLines,
    law: ForceLaw,
    fixed: Mapping[str, float],
    values: Array,
    mass: float,
    steps: int = MAX_NEWTON_STEPS,
) -> LineFit:
    """Fit a law by iteratively reweighted least squares.

    Parameters
    ----------
    lines, law
        Data and model.
    fixed
        Values of parameters that are known, by name; "m" is the mass [kg].
    values, mass, steps
        Initial values (p,) and mass [kg], the background begins with zeros; maximum of Gauss-Newton steps.
    """
    # nonlinear distortion is spread over all lines, excited or not: one variance a record to begin with
    variance = np.broadcast_to(lines.power(mass).max(axis=1, keepdims=True), lines.used.shape)
    unknown = BalanceNoise.unknown(lines, len(values))
    start = np.concatenate([values, [mass], lines.subtracted])
    fit = LineFit(lines, law, fixed, start, unknown, variance)
    if "f_n" in lines.background.names:
        fit = _place_neighbour(fit)
    rules = replace(fit.rules, steps=steps)
    for iteration in range(MAX_ALTERNATIONS):
        place, nuisance, line, converged = descend(fit.linearise, fit.parameters, fit.nuisance, rules)
        if fit.noise.cross_covariance.any():
            basis = summarise(line, place, nuisance, rules).basis
            place = place - basis @ (basis.T @ _slope_noise_score(fit))
        converged = converged and bool(np.isfinite(line.residual).all())
        fit = replace(fit, parameters=place, converged=converged)
        if iteration < MAX_ALTERNATIONS - 1:
            noise = fit.balance.noise(fit.mode, law, fit.values, fit.mass)
            fit = replace(fit, noise=noise, variance=_line_variances(fit, noise))
    return fit


def _place_neighbour(fit: LineFit) -> LineFit:
    """Return a fit with a neighbouring mode at the natural frequency of least misfit."""
    own = fit.lines.background
    residuals = own.without_neighbour()
    without = replace(fit.lines, background=residuals, subtracted=np.zeros(len(residuals.names)))
    begun = fit_lines(without, fit.law, fit.fixed, fit.values, fit.mass)
    fit = replace(fit, variance=begun.variance)
    rules, trials = replace(fit.rules, steps=MAX_TRIAL_STEPS), []
    for neighbour in neighbours(own.band, begun.mass):
        start = np.append(begun.parameters, neighbour)
        place, _, line, _ = descend(fit.linearise, start, fit.nuisance, rules)
        trials.append((np.nan_to_num(rules.cost(line.residual, place), nan=np.inf), place))
    return replace(fit, parameters=min(trials, key=itemgetter(0))[1])


def _slope_noise_score(fit: LineFit) -> Array:
    """Return the expected product (q,) of slopes and residual that their common noise makes."""
    used = fit.lines.used
    weighted = np.moveaxis(fit.noise.cross_covariance, 1, 2)[used] * (2 / fit.variance)[used][:, None]
    return np.asarray(weighted.sum(axis=0))


def jackknife(found: Regression, group: NDArray[np.intp]) -> Array:
    """Return the delete-a-group jackknife covariance (q, q) of the parameters.

    It holds for points that are not independent within a group, and is exact for linear models: CR3 of
    Cameron and Miller, J. Human Resources 50, 2015.
    ``found`` is the linearised fit of all points, ``group`` (n,) the number of the group of each.
    """
    basis, rows, residual = found.basis, found.rows[found.used], found.residual[found.used]
    group = group[found.used]
    numbers = np.unique(group)
    unit = np.eye(basis.shape[1])
    total = np.zeros_like(unit)
    for number in numbers:
        own_rows, own_residual = rows[group == number], residual[group == number]
        information, directions = np.linalg.eigh(unit - np.tensordot(own_rows, own_rows, ([0, 1], [0, 1])))
        kept = information > _MIN_INFORMATION_OUTSIDE_GROUP
        score = directions[:, kept].T @ np.einsum("nmr,nm->r", own_rows, own_residual)
        change = directions[:, kept] @ (score / information[kept])
        total += np.outer(change, change)
    total *= (len(numbers) - 1) / max(len(numbers), 1)
    return np.asarray(basis @ total @ basis.T)


def _orthogonal_to_parameters(found: Regression, signal: Array) -> Array:
    """Return the part of a signal (lines, 2) that no change of the parameters makes."""
    return np.asarray(signal - found.rows @ np.tensordot(found.rows, signal, ([0, 1], [0, 1])))


def fit_missing_terms(fit: LineFit) -> dict[str, Alternative]:
    """Return the law extended by each of ``MISSING_TERMS`` in turn, to first order; none that is fixed."""
    terms = with_coefficients(missing := unfixed_terms(fit.law, fit.fixed), fit.law.parameters)
    parts = fit.law.parts
    own = [Element("part", part.law.expression, part.law.parameters, part.sensors) for part in parts]
    law = law_of(own + [make_element("term", term, across=parts[-1].sensors) for term in terms.values()])
    known = fit.law.named(fit.values)
    values = np.array([known.get(name, 0.0) for name in law.parameters])
    noise = fit.balance.noise(fit.mode, law, values, fit.mass)
    parameters = np.concatenate([values, fit.parameters[len(fit.values) :]])
    extended = replace(fit, law=law, parameters=parameters, noise=noise)
    found = _fit_added_parameters(extended, [law.parameters.index(name) for name in terms])
    return dict(zip(missing, found, strict=True))


def fit_larger_backgrounds(fit: LineFit) -> dict[str, Alternative]:
    """Return each kind of background that is larger than that of the fit, to first order."""
    lines, own = fit.lines, fit.lines.background
    if own.kind.startswith(BACKGROUNDS[-1]):
        return {}
    larger = background_of_lines(LARGEST, lines.spectra, own.band)
    values = larger.values_from(own, fit.background)
    parameters = np.concatenate([fit.values, [fit.mass], values])
    seen = replace(fit, lines=replace(lines, background=larger), parameters=parameters)
    free = fit.free[: len(fit.values) + 1]
    return larger_backgrounds(*seen.equations(), free, own, larger, larger.names)


def fit_second_sensor(fit: LineFit) -> dict[str, Alternative]:
    """Return each kind of background of the second sensor alone, which no fit has, to first order."""
    lines, free = fit.mode, np.flatnonzero(fit.free)
    if lines.far is None:
        return {}
    kinds = BACKGROUNDS[2:-1]  # those that follow the force
    terms = background_of_lines(kinds[-1], lines.spectra, lines.background.band)
    driven = np.where(lines.far == 0, 0, lines.spectra.force)
    right, columns = fit.linearise(fit.parameters, fit.nuisance).residual, []
    for unit in np.eye(len(terms.names))[1:]:
        moved = terms.receptance(unit).reshape(len(lines), 1, -1) * driven
        moved *= FINITE_DIFFERENCE_STEP * np.linalg.norm(lines.far) / np.linalg.norm(moved)
        other = replace(fit, lines=replace(fit.lines, far=lines.far + moved))
        columns.append(right - other.linearise(fit.parameters, fit.nuisance).residual)
    added = len(fit.parameters) + np.arange(len(columns))
    groups = {kind: [*free, *added[: 2 * i]] for i, kind in enumerate(kinds, start=1)}
    return joint_alternatives(*fit.equations(*columns), list(free), groups, len(fit.values) + 1)


def fit_fixed_parameters(fit: LineFit) -> dict[str, Alternative]:
    """Return the fit with each fixed parameter free in turn, to first order."""
    places, names = np.flatnonzero(~fit.free), (*fit.law.parameters, "m")
    return dict(zip((names[place] for place in places), _fit_added_parameters(fit, places), strict=True))


def _fit_added_parameters(fit: LineFit, added: Sequence[int] | NDArray[np.intp]) -> list[Alternative]:
    """Fit each of the added parameters together with all others."""
    right, rows = fit.equations()
    others = np.delete(np.arange(len(fit.parameters)), added)
    deviation = np.moveaxis(fit.noise.deviation * np.sqrt(2 / fit.variance)[:, None], 1, 2)[fit.lines.used]
    readings = np.stack([deviation.real, deviation.imag], axis=1).reshape(-1, deviation.shape[1]).T
    return alternatives(
        right,
        rows[:, others],
        rows[:, added],
        _slope_noise_score(fit)[[*others, *added]],
        # each period has its lines, and the one weighing
        np.pad(readings, ((0, 0), (0, len(right) - readings.shape[1]))),
        Rules(free=fit.free[others]),
    )


def _scatter_of_periods(fit: LineFit, covariance: Array) -> Array:
    """Return the factors (q, q), at least 1, by which the scatter of the periods exceeds the covariance.

    The estimate that each period alone would give includes the correlation between lines, which the variances
    of the lines do not: along a nonlinear law the noise of one line is in the balance of many.
    """
    count = fit.lines.spectra.periods
    variance_of_mean = np.zeros(len(covariance))
    records = (fit.balance.slopes, fit.noise.deviation, fit.variance, fit.lines.used)
    for column, deviation, variance, used in zip(*records, strict=True):
        weighted = np.conj(column[:, used]) * (2 / variance[used])
        estimates = (deviation[:, used] @ weighted.T).real @ covariance
        variance_of_mean += np.sum(estimates**2, axis=0) / max(count * (count - 1), 1)
    ratio = _wider(variance_of_mean, covariance)
    return np.outer(ratio, ratio)


def _wider(variance: Array, covariance: Array) -> Array:
    """Return the factors (q,), at least 1, by which errors of a variance (q,) exceed a covariance (q, q)."""
    known = np.diag(covariance)
    return np.sqrt(np.maximum(variance / np.where(known > 0, known, np.inf), 1.0))


def largest_gain_step(fit: LineFit) -> tuple[int, float, float]:
    """Find the most significant change of a gain within a record.

    A gain of force or response that changes moves the balance of any law by a share of the force: the share
    is the slope, over the force at the excited lines, of the mean balance of the later periods minus that of
    the earlier ones.

    Returns
    -------
    first, size, z
        First period after the change, size of the change relative to the gain, and the same in standard
        errors.
    """
    found, driven = (0, 0.0, 0.0), fit.lines.used & fit.lines.spectra.excited()
    records = (fit.mode.spectra.mean_force, fit.noise.deviation, fit.variance, driven)
    for force, deviation, variance, used in zip(*records, strict=True):
        weight = np.sqrt(2 / variance[used])
        column, freedom = force[used] * weight, max(2 * int(used.sum()) - 1, 1)
        size = max(float(np.linalg.norm(column)), 1e-300)
        for first in range(1, len(deviation)):
            later, earlier = deviation[first:, used], deviation[:first, used]
            step = (later.mean(axis=0) - earlier.mean(axis=0)) * weight
            share = float(np.vdot(column, step).real) / size**2
            error = float(np.linalg.norm(step - share * column)) / (size * np.sqrt(freedom))
            z = abs(share) / max(float(error), ROUND_OFF)
            if abs(share) > MISFIT_NEGLIGIBLE and z > found[2]:
                found = (first, abs(share), z)
    return found


def channel_errors(fit: LineFit) -> dict[str, ChannelError]:
    """Fit a delay [s] of the response, next to a base the logarithm of its gain, each with all parameters.

    The gain is that of the response relative to the base, or of the absolute one, whichever leaves less.
    """
    found, spectra, seen = fit.regression, fit.lines.spectra, fit.lines.spectra.response
    changes = [("delay", fit.lines.rate[:, None] * seen)]
    if spectra.base:
        inertia = fit.mass * np.where(spectra.lines > 0, spectra.omega, np.inf)[:, None] ** 2
        changes += [("gain", seen), ("gain", seen + spectra.force * (1 / inertia))]
    residual, kinds = _orthogonal_to_parameters(found, found.residual), dict[str, ChannelError]()
    for name, change in changes:
        step = FINITE_DIFFERENCE_STEP * np.linalg.norm(seen) / np.linalg.norm(change)
        other = replace(fit.lines, spectra=replace(spectra, response=seen + step * change))
        moved = replace(fit, lines=other).linearise(fit.parameters, fit.nuisance).residual - found.residual
        slope = _orthogonal_to_parameters(found, moved / step)
        size = max(float(np.linalg.norm(slope)), 1e-300)
        value = float(np.sum(slope * residual)) / size**2
        left = fit.misfit * float(np.linalg.norm(residual - slope * value) / np.linalg.norm(residual))
        error = ChannelError(left, value, interval_sigmas() / size)
        kinds[name] = min(error, kinds.get(name, error))
    return kinds


def band_parts(lines: SpectralLines) -> NDArray[np.intp]:
    """Return the number (lines,) of the part of its record's band that each used line belongs to."""
    parts, first = [], 0
    for used in lines.used:
        count = int(used.sum())
        parts.append(first + np.arange(count) * JACKKNIFE_GROUPS // max(count, 1))
        first += min(JACKKNIFE_GROUPS, count)
    return np.unique(np.concatenate(parts), return_inverse=True)[1]


def misfit_to_noise(fit: LineFit) -> float:
    """Return the root mean square over all lines of misfit over noise; 1 where the noise is not known."""
    # periods that are equal show no noise but round-off
    noise = np.maximum(fit.noise.variance, _ROUND_OFF_POWER * fit.mode.power(fit.mass))
    ratio = (np.abs(fit.balance.residual) ** 2 / noise)[fit.lines.used]
    ratio = ratio[~np.isnan(ratio)]
    return float(np.sqrt(np.mean(ratio))) if len(ratio) else 1.0


def max_misfit_of_noise(fit: LineFit) -> float:
    """Return the limit of ``misfit_to_noise`` noise exceeds with the chance of ``NOISE_LIMIT_SIGMAS``.

    The ratio of the two sums of squares follows Fisher's F distribution. The noise is averaged over few
    neighbouring lines and periods, n degrees of freedom, so that its mean inverse is larger by n/(n - 1).
    """
    count, repeats = int(fit.lines.used.sum()), fit.lines.spectra.periods - 1
    if repeats < 1:
        return NOISE_RATIO_BY_CHANCE
    freedom, averaged = max(2 * count - int(fit.free.sum()), 1), repeats * (LINES_TO_EACH_SIDE + 1)
    limit = f_quantile(freedom, 2 * repeats * count, 1 - normal_share(-NOISE_LIMIT_SIGMAS))
    square = limit * freedom / (2 * count) * averaged / (averaged - 1)
    return max(NOISE_RATIO_BY_CHANCE, float(np.sqrt(square)))


def relative_to_force(lines: SpectralLines, power: Array) -> float:
    """Return the root mean square over the records of sum(power)/sum(|F|^2), power (r, H+1) in N^2."""
    records = zip(power, np.abs(lines.spectra.mean_force) ** 2, lines.used, strict=True)
    shares = [float(own[used].sum() / total[used].sum()) for own, total, used in records]
    return float(np.sqrt(np.mean(shares)))


# ----------------------------------------------------------------------------
# Initial values: the balance at sampled instants, by variable projection.

_MAX_INSTANTS = 1500
"""Instants of all motions at which a law without memory is tried: many times its parameters."""
_COST_OF_MEMORY = 4
"""Of a trial of a law with memory, in trials of one without."""
_TRIALS_A_DECADE = 24
_MISFIT_OF_INFINITE_FORCE = 1e6


class _SampledBalance:
    """Equation f = m a + n(x, v; p) + constant at instants of all records, relative to the force of each.

    A constant a record: the mean of the force is rarely measured.
    """

    def __init__(self, lines: SpectralLines, law: ForceLaw, fixed: Mapping[str, float]) -> None:
        spectra, samples = lines.spectra, lines.samples
        motion = Motion(np.full(len(spectra), spectra.omega0), _clear_lines(spectra.mean_response, lines))
        force = Motion(motion.omega, _clear_lines(spectra.mean_force, lines)).waveforms(samples)[0]
        force = force - force.mean(axis=1, keepdims=True)
        x, v, a = motion.waveforms(samples)
        if not spectra.mean_known:
            x = x - x.mean(axis=1, keepdims=True)
        chosen = np.zeros(x.shape, dtype=bool)
        # an odd stride meets all phases of a period, whose samples are a power of two
        chosen.reshape(-1)[:: max(1, x.size // _MAX_INSTANTS) | 1] = True
        waves = [x, v, a, motion.interval(samples)]
        if lines.far is not None:
            waves += Motion(motion.omega, lines.far.mean(axis=1)).waveforms(samples)
        # a memory needs the whole motion
        self._kept: Any = chosen if law.remembers else 0
        if not law.remembers:
            waves = [np.broadcast_to(wave, x.shape)[chosen][None] for wave in waves]
        self._x, self._v, self._a, self._step, *far = waves
        self.law = law.with_far((far[0], far[1], far[2])) if far else law
        record = np.nonzero(chosen)[0]
        self._weight = 1 / np.std(force, axis=1)[record]
        self._right = force[chosen]
        self._columns = [a[chosen], *(np.arange(len(x))[:, None] == record)]
        size, speed = float(np.max(rms(spectra.mean_response))), float(np.max(np.std(v, axis=1)))
        self._known = np.full(len(law.linear) + 1 + len(spectra), np.nan)
        self._known[len(law.linear)] = fixed.get("m", np.nan)
        self.natural = natural_sizes(law, size, speed / size, float(np.max(np.std(force, axis=1))))

    def rows(self, nonlinear: Array) -> tuple[Array, Array]:
        """Return matrix and right side for values of the parameters in which the law is not linear."""
        values = np.zeros(len(self.law.parameters))
        values[list(self.law.nonlinear)] = nonlinear
        sample = self.law.sample(self._x, self._v, self._a, self._step, values)
        parts = (sample.force, *sample.by_parameter)
        force, *slopes = (np.broadcast_to(part, self._x.shape)[self._kept] for part in parts)
        matrix = np.stack([*(slopes[i] for i in self.law.linear), *self._columns], axis=1)
        return matrix * self._weight[:, None], (self._right - force) * self._weight

    def residual(self, nonlinear: Array) -> Array:
        """Return the residual at the best linear parameters and mass; large where the force is not finite."""
        matrix, right = self.rows(nonlinear)
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            return np.full(len(right), _MISFIT_OF_INFINITE_FORCE)
        return np.asarray(right - matrix @ self.solve(matrix, right))

    def solve(self, matrix: Array, right: Array) -> Array:
        """Return linear parameters, mass and constants of the least-squares solution."""
        return solve_scaled(matrix, right, known=self._known)[0]

    def search(self) -> Array:
        """Search the nonlinear parameters, decades around their natural sizes."""
        size = self.natural[list(self.law.nonlinear)]
        size = np.where(np.isfinite(size) & (size > 0), size, 1.0)
        ratios = np.logspace(-DECADES, DECADES, int(2 * DECADES * _TRIALS_A_DECADE) + 1)
        count = NONLINEAR_TRIALS // (_COST_OF_MEMORY if self.law.remembers else 1)
        return search_values(self.residual, list(size[:, None] * ratios), count)


def _clear_lines(spectrum: ComplexArray, lines: SpectralLines) -> ComplexArray:
    """Return the spectrum up to the highest used line, lines below the lowest clear one set to zero."""
    highest = int(np.flatnonzero(lines.used.any(axis=0))[-1])
    hidden = (lines.spectra.lines > 0) & (lines.spectra.lines < lines.lowest[:, None])
    return np.asarray(np.where(hidden, 0, spectrum)[:, : highest + 1])


def start_values(lines: SpectralLines, law: ForceLaw, fixed: Mapping[str, float]) -> tuple[Array, float]:
    """Find initial values (p,) of the law and an initial mass [kg].

    ``fixed`` are values of known parameters, by name; "m" is the mass [kg].
    """
    if lines.weighed is not None:
        fixed = {"m": lines.weighed[0], **fixed}
    free_law = law.at(fixed)
    balance = _SampledBalance(lines, free_law, fixed)
    nonlinear = balance.search() if free_law.nonlinear else np.zeros(0)
    solution = balance.solve(*balance.rows(nonlinear))
    found = free_law.named(free_law.values_of(solution, nonlinear))
    return law.ordered({**fixed, **found}), float(solution[len(free_law.linear)])
