"""Least squares of the balance at the lines of periodic records, weighted by its noise, and the errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.linear_algebra import solve_scaled
from rsgen.common.tolerances import (
    CHANCE,
    EXCESS,
    GROUPS,
    NOTICEABLE,
    ROUND_OFF,
    ROUNDS,
    TRIALS,
    f_quantile,
    normal_share,
)
from rsgen.data.multisine.spectra import SMOOTHED, rms, smooth
from rsgen.formula import parse
from rsgen.identification.fitting.least_squares import (
    Alternative,
    Linearisation,
    Regression,
    Rules,
    alternatives,
    descend,
    determined,
    summarise,
)
from rsgen.identification.fitting.observed import MISSING_TERMS, with_coefficients
from rsgen.identification.lines.line_balance import Balance, Lines, NoiseOfBalance
from rsgen.identification.starting.search import search_values
from rsgen.law.motion import Motion
from rsgen.law.numeric import DECADES, ForceLaw, compile_law, natural_sizes

_ALONE = 1e-3
"""Information on a direction outside a group below which that group is not left out: hardly any would be
left."""
_BESIDE = 20
"""Lines to each side over which the power of the misfit is averaged: forty-one make it known to a quarter."""
_DIGITS = 1e-26
"""Power relative to that of the balance, below which it is that of its last digits."""


@dataclass(frozen=True, eq=False)
class LineFit:
    """A law at the lines of records.

    Parameters
    ----------
    lines, law
        What is fitted.
    fixed
        Values of parameters that are known, by name; "m" is the mass [kg].
    parameters
        (q,) values of the law, and the mass [kg].
    noise, variance
        What the single periods say, and the variance (r, H+1) that weighs each line.
    converged
        Whether the last steps had become small.
    """

    lines: Lines
    law: ForceLaw
    fixed: Mapping[str, float]
    parameters: Array
    noise: NoiseOfBalance
    variance: Array
    converged: bool = False

    @property
    def values(self) -> Array:
        """(p,) of the law."""
        return self.parameters[:-1]

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self.parameters[-1])

    @property
    def free(self) -> NDArray[np.bool_]:
        """(q,) False for parameters that are fixed."""
        return np.array([name not in self.fixed for name in (*self.law.parameters, "m")])

    @cached_property
    def balance(self) -> Balance:
        """At the parameters."""
        return Balance.of(self.lines, self.law, self.values, self.mass, self.noise)

    @property
    def columns(self) -> ComplexArray:
        """(r, q, H+1) slopes of the balance by the parameters."""
        return np.concatenate([self.balance.by_parameter, self.balance.by_mass[:, None]], axis=1)

    @cached_property
    def regression(self) -> Regression:
        """Errors, and what is not identifiable, for the noise that weighs the lines."""
        line = self.linearise(self.parameters, self.nuisance)
        return summarise(line, self.parameters, self.nuisance, Rules(free=self.free))

    @property
    def nuisance(self) -> Array:
        """(lines, 0): a line has no unknowns of its own."""
        return np.zeros((np.count_nonzero(self.lines.used), 0))

    def linearise(self, parameters: Array, nuisance: Array) -> Linearisation:
        """Real and imaginary part of each used line, of unit variance, at other parameters."""
        fit = self if parameters is self.parameters else replace(self, parameters=parameters)
        used, weight = self.lines.used, np.sqrt(2 / self.variance)
        matrix = np.moveaxis(fit.columns * weight[:, None], 1, 2)[used]
        right = (fit.balance.residual * weight)[used]
        return Linearisation(
            np.stack([right.real, right.imag], axis=1),
            np.zeros((len(right), 2, 0)),
            np.stack([matrix.real, matrix.imag], axis=1),
        )


def _weights(fit: LineFit, noise: NoiseOfBalance) -> Array:
    """(r, H+1) variance of each line: its noise, or the misfit around it where that is clearly more."""
    left = np.stack(
        [
            _beside(np.abs(one) ** 2 / shape, used) * shape
            for one, shape, used in zip(fit.balance.residual, noise.shape, fit.lines.used, strict=True)
        ]
    )
    known = np.isfinite(noise.variance)
    # the smoothed power of pure noise exceeds this once in thousands
    chance = 1 + CHANCE / np.sqrt(2 * _BESIDE + 1)
    clear = ~known | (left > chance * noise.variance)
    variance = np.where(clear, left, noise.variance)
    return np.maximum(variance, _DIGITS * fit.lines.scale(fit.mass))


def _beside(power: Array, used: NDArray[np.bool_]) -> Array:
    """(H+1,) average of a power over the neighbouring used lines."""
    chosen = np.flatnonzero(used)
    result = np.zeros(len(power))
    result[chosen] = smooth(np.concatenate([[0.0], power[chosen]]), _BESIDE)[1:]
    return result


def fit_lines(lines: Lines, law: ForceLaw, fixed: Mapping[str, float], values: Array, mass: float) -> LineFit:
    """Least squares with fixed weights, then weights of its result, some times over."""
    # what a law leaves is spread over lines that are excited and others alike
    variance = np.broadcast_to(lines.scale(mass).max(axis=1, keepdims=True), lines.used.shape)
    unknown = NoiseOfBalance.unknown(lines, len(values))
    fit = LineFit(lines, law, fixed, np.append(values, mass), unknown, variance)
    rules = Rules(free=fit.free)
    for turn in range(ROUNDS):
        place, nuisance, line, converged = descend(fit.linearise, fit.parameters, fit.nuisance, rules)
        if fit.noise.together.any():
            place = place - _bias(fit, summarise(line, place, nuisance, rules))
        converged = converged and bool(np.isfinite(line.residual).all())
        fit = replace(fit, parameters=place, converged=converged)
        if turn < ROUNDS - 1:
            noise = fit.balance.noise(lines, law, fit.values, fit.mass)
            fit = replace(fit, noise=noise, variance=_weights(fit, noise))
    return fit


def _bias(fit: LineFit, found: Regression) -> Array:
    """(q,) what noise in the slopes, which goes with that of the balance, adds to the estimate."""
    return np.asarray(found.basis @ (found.basis.T @ _score(fit)))


def _score(fit: LineFit) -> Array:
    """(q,) what noise adds to the product of the slopes with the residual."""
    used = fit.lines.used
    weighted = np.moveaxis(fit.noise.together, 1, 2)[used] * (2 / fit.variance)[used][:, None]
    return np.asarray(weighted.sum(axis=0))


def errors_of(fit: LineFit) -> tuple[Array, int, float]:
    """Covariance, its degrees of freedom, and how much leaving parts out widens the errors."""
    found, wider = fit.regression, 1.0
    freedom, covariance = found.freedom, found.basis @ found.basis.T
    covariance = covariance * _scatter_of_periods(fit, covariance)
    if times_noise(fit) > chance_of_noise(fit):
        spread = np.diag(blocks_left_out(fit))
        known = np.diag(covariance)
        ratio = np.sqrt(np.maximum(spread / np.where(known > 0, known, np.inf), 1.0))
        covariance = covariance * np.outer(ratio, ratio)
        wider, freedom = float(np.median(ratio[fit.free])), int(parts_of_band(fit.lines).max())
    return determined(covariance, found.null), freedom, wider


def blocks_left_out(fit: LineFit) -> Array:
    """Covariance (q, q) from leaving out one part of the band after the other, with the weights of all."""
    found = fit.regression
    # without what the correction for noise in the slopes leaves in the equations of all lines
    rest = _beside_parameters(found, found.residual)
    return jackknife(replace(found, residual=rest), parts_of_band(fit.lines))


def jackknife(whole: Regression, group: NDArray[np.intp]) -> Array:
    """Covariance (q, q) of the parameters from leaving out one group (n,) of the points after the other,
    exactly where the points are linear: errors where the points are not independent (Cameron and Miller,
    J. Human Resources 50, 2015, the cluster-robust CR3).
    """
    basis, rows, residual = whole.basis, whole.rows[whole.used], whole.residual[whole.used]
    group = group[whole.used]
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


def _beside_parameters(found: Regression, signal: Array) -> Array:
    """What the parameters do not take up of a signal (lines, 2)."""
    return np.asarray(signal - found.rows @ np.tensordot(found.rows, signal, ([0, 1], [0, 1])))


def terms_beside(fit: LineFit) -> dict[str, Alternative]:
    """Fit each term that the law may lack beside it, to first order, with what noise does to its slopes."""
    terms = with_coefficients(MISSING_TERMS, fit.law.parameters)
    law = compile_law(sympy.Add(fit.law.expression, *map(parse, terms.values())))
    known = dict(zip(fit.law.parameters, fit.values, strict=True))
    values = np.array([known.get(name, 0.0) for name in law.parameters])
    noise = fit.balance.noise(fit.lines, law, values, fit.mass)
    whole = replace(fit, law=law, parameters=np.append(values, fit.mass), noise=noise)
    found = _fit_beside(whole, [law.parameters.index(name) for name in terms])
    return dict(zip(MISSING_TERMS, found, strict=True))


def fixed_beside(fit: LineFit) -> dict[str, Alternative]:
    """Fit what each fixed parameter is off by, to first order, beside all that are free."""
    places, names = np.flatnonzero(~fit.free), (*fit.law.parameters, "m")
    return dict(zip((names[place] for place in places), _fit_beside(fit, places), strict=True))


def _fit_beside(whole: LineFit, added: Sequence[int] | NDArray[np.intp]) -> list[Alternative]:
    """Fit each of the added parameters beside all others."""
    line, used = whole.linearise(whole.parameters, whole.nuisance), whole.lines.used
    matrix = line.by_parameter.reshape(line.residual.size, len(whole.parameters))
    kept = np.delete(np.arange(len(whole.parameters)), added)
    weight = np.sqrt(2 / whole.variance)
    apart = np.moveaxis(whole.noise.apart * weight[:, None], 1, 2)[used]
    return alternatives(
        line.residual.reshape(-1),
        matrix[:, kept],
        matrix[:, added],
        _score(whole)[[*kept, *added]],
        np.stack([apart.real, apart.imag], axis=1).reshape(line.residual.size, -1).T,
        whole.free[kept],
    )


def _scatter_of_periods(fit: LineFit, covariance: Array) -> Array:
    """(q, q) factor by which the scatter of single periods exceeds the covariance, at least 1.

    What each period would move the estimate holds what the variances of the lines leave out: the noise of one
    line is, along a nonlinear law, in the balance of many.
    """
    count = fit.lines.spectra.periods
    moved = np.zeros(len(covariance))
    parts = (fit.columns, fit.noise.apart, fit.variance, fit.lines.used)
    for column, apart, variance, used in zip(*parts, strict=True):
        weighted = np.conj(column[:, used]) * (2 / variance[used])
        moves = (apart[:, used] @ weighted.T).real @ covariance
        moved += np.sum(moves**2, axis=0) / max(count * (count - 1), 1)
    known = np.diag(covariance)
    ratio = np.sqrt(np.maximum(moved / np.where(known > 0, known, np.inf), 1.0))
    return np.outer(ratio, ratio)


def step_between_periods(fit: LineFit) -> tuple[int, float, float]:
    """Find the clearest change of a gain within a record: where it begins, its size, its standard errors.

    A gain of force or response that changes moves the balance of any law by a share of the force, noise moves
    it from line to line: the share is the slope over the force, at the lines that are excited, of the balance
    of the periods from one on minus that of those before.
    """
    found, driven = (0, 0.0, 0.0), fit.lines.used & fit.lines.spectra.excited()
    parts = (fit.lines.spectra.mean_force, fit.noise.apart, fit.variance, driven)
    for force, apart, variance, used in zip(*parts, strict=True):
        weight = np.sqrt(2 / variance[used])
        column, freedom = force[used] * weight, max(2 * int(used.sum()) - 1, 1)
        size = max(float(np.linalg.norm(column)), 1e-300)
        for first in range(1, len(apart)):
            step = (apart[first:, used].mean(axis=0) - apart[:first, used].mean(axis=0)) * weight
            share = float(np.vdot(column, step).real) / size**2
            error = float(np.linalg.norm(step - share * column)) / (size * np.sqrt(freedom))
            times = abs(share) / max(float(error), ROUND_OFF)
            if abs(share) > NOTICEABLE and times > found[2]:
                found = (first, abs(share), times)
    return found


def delay_between(fit: LineFit) -> tuple[float, float, float]:
    """Time by which the response comes later than the force [s], its error, and the share of misfit left.

    Shifted in time, the balance of any law is that of the shifted force: to first order a delay adds
    i omega F to it, but at lines at which the motion is the law's own. It is fitted beside all parameters.
    """
    lines, found = fit.lines, fit.regression
    taken = lines.spectra.lines >= lines.first[:, None]
    column = (lines.rate * lines.spectra.mean_force * taken / np.sqrt(fit.variance / 2))[lines.used]
    own = _beside_parameters(found, np.stack([column.real, column.imag], axis=1))
    alone = _beside_parameters(found, found.residual)
    size = max(float(np.linalg.norm(own)), 1e-300)
    delay = float(np.sum(own * alone)) / size**2
    left = float(np.linalg.norm(alone - own * delay)) / max(float(np.linalg.norm(alone)), 1e-300)
    return delay, 1 / size, left


def parts_of_band(lines: Lines) -> NDArray[np.intp]:
    """(lines,) parts of the band of every record, for the jackknife."""
    parts, first = [], 0
    for used in lines.used:
        count = int(used.sum())
        parts.append(first + np.arange(count) * GROUPS // max(count, 1))
        first += min(GROUPS, count)
    return np.unique(np.concatenate(parts), return_inverse=True)[1]


def times_noise(fit: LineFit) -> float:
    """Misfit over its noise, root mean square over all lines; 1 where the noise is not known.

    Periods that are equal show no noise but that of the last digits.
    """
    noise = np.maximum(fit.noise.variance, _DIGITS * fit.lines.scale(fit.mass))
    ratio = (np.abs(fit.balance.residual) ** 2 / noise)[fit.lines.used]
    ratio = ratio[~np.isnan(ratio)]
    return float(np.sqrt(np.mean(ratio))) if len(ratio) else 1.0


def chance_of_noise(fit: LineFit) -> float:
    """Misfit over its noise that chance hardly exceeds.

    The noise comes from few periods and a few lines beside each other: its inverse is larger on average, and
    the ratio of the two sums of squares is that of Fisher's F.
    """
    count, more = int(fit.lines.used.sum()), fit.lines.spectra.periods - 1
    if more < 1:
        return EXCESS
    rest, near = max(2 * count - int(fit.free.sum()), 1), more * (SMOOTHED + 1)
    limit = f_quantile(rest, 2 * more * count, 1 - normal_share(-CHANCE))
    return max(EXCESS, float(np.sqrt(limit * rest / (2 * count) * near / (near - 1))))


def relative_to_force(lines: Lines, power: Array) -> float:
    """Root mean square of a quantity (r, H+1) [N^2] over that of the force, averaged over the records."""
    force = np.abs(lines.spectra.mean_force) ** 2
    shares = [
        float(one[used].sum() / whole[used].sum())
        for one, whole, used in zip(power, force, lines.used, strict=True)
    ]
    return float(np.sqrt(np.mean(shares)))


# ----------------------------------------------------------------------------
# Values to start from: the law along sampled motions, linear in all that is linear, the rest searched.

_SAMPLES = 1500
"""Instants at which a law without memory is tried: many times its parameters, spread over all motions."""
_PER_DECADE = 24
"""Values a decade where one parameter is searched alone."""
_NO_FORCE = 1e6
"""Misfit where the law gives no finite force."""


class _Instants:
    """Force and motion at instants of all records, each in units of its record's force."""

    def __init__(self, lines: Lines, law: ForceLaw, fixed: Mapping[str, float]) -> None:
        self.law = law
        spectra = lines.spectra
        samples = lines.samples
        motion = Motion(np.full(len(spectra), spectra.omega0), _cut(spectra.mean_response, lines))
        force = Motion(motion.omega, _cut(spectra.mean_force, lines)).waveforms(samples)[0]
        self.force = force - force.mean(axis=1, keepdims=True)
        self.x, self.v, self.a = motion.waveforms(samples)
        if not spectra.mean_known:
            self.x = self.x - self.x.mean(axis=1, keepdims=True)
        self.step = motion.interval(samples)
        every = max(1, self.x.size // _SAMPLES)
        self.chosen = np.zeros(self.x.shape, dtype=bool)
        # an odd stride meets all phases
        self.chosen.reshape(-1)[:: every | 1] = True
        self.weight = np.broadcast_to(1 / np.std(self.force, axis=1, keepdims=True), self.x.shape)
        size = float(np.max(rms(spectra.mean_response)))
        speed = float(np.max(np.std(self.v, axis=1)))
        self._known = np.full(len(law.linear) + 1 + len(spectra), np.nan)
        self._known[len(law.linear)] = fixed.get("m", np.nan)
        self.natural = natural_sizes(law, size, speed / size, float(np.max(np.std(self.force, axis=1))))

    def rows(self, nonlinear: Array) -> tuple[Array, Array]:
        """Rows of f = m a + n + constant, a constant a record: the force has no mean worth trusting."""
        law = self.law
        values = np.zeros(len(law.parameters))
        values[list(law.nonlinear)] = nonlinear
        if law.remembers:
            sample = law.sample(self.x, self.v, self.a, self.step, values)
            pick = self.chosen
            still, slopes = sample.force[pick], [sample.by_parameter[i][pick] for i in law.linear]
        else:
            pick = self.chosen
            step = np.broadcast_to(self.step, self.x.shape)[pick][None]
            sample = law.sample(self.x[pick][None], self.v[pick][None], self.a[pick][None], step, values)
            still = np.broadcast_to(sample.force, step.shape)[0]
            slopes = [np.broadcast_to(sample.by_parameter[i], step.shape)[0] for i in law.linear]
        a, weight = self.a[pick], self.weight[pick]
        right = self.force[pick] - still
        record = np.nonzero(pick)[0]
        constants = [(record == i).astype(float) for i in range(len(self.x))]
        columns = [*slopes, a, *constants]
        return np.stack(columns, axis=1) * weight[:, None], right * weight

    def residual(self, nonlinear: Array) -> Array:
        """What the best linear parameters and mass leave; large where there is no force."""
        matrix, right = self.rows(nonlinear)
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            return np.full(len(right), _NO_FORCE)
        return np.asarray(right - matrix @ self.solve(matrix, right))

    def solve(self, matrix: Array, right: Array) -> Array:
        """Linear parameters, the mass, and the constants."""
        return solve_scaled(matrix, right, known=self._known)[0]

    def search(self) -> Array:
        """Search values around the natural sizes of the parameters in which the law is not linear."""
        size = self.natural[list(self.law.nonlinear)]
        size = np.where(np.isfinite(size) & (size > 0), size, 1.0)
        shares = np.logspace(-DECADES, DECADES, int(2 * DECADES * _PER_DECADE) + 1)
        count = TRIALS // (4 if self.law.remembers else 1)
        return search_values(self.residual, list(size[:, None] * shares), count)


def _cut(spectrum: ComplexArray, lines: Lines) -> ComplexArray:
    """The lines from the lowest clear one to the highest used; the rest is mostly noise."""
    highest = int(np.flatnonzero(lines.used.any(axis=0))[-1])
    hidden = (lines.spectra.lines > 0) & (lines.spectra.lines < lines.first[:, None])
    return np.asarray(np.where(hidden, 0, spectrum)[:, : highest + 1])


def start_values(lines: Lines, law: ForceLaw, fixed: Mapping[str, float]) -> tuple[Array, float]:
    """Find values (p,) of the law and a mass [kg] near the solution.

    Parameters
    ----------
    lines
        What is fitted.
    law
        As array functions.
    fixed
        Values of parameters that are known, by name; "m" is the mass [kg].
    """
    part = law.at(fixed)
    instants = _Instants(lines, part, fixed)
    nonlinear = instants.search() if part.nonlinear else np.zeros(0)
    solution = instants.solve(*instants.rows(nonlinear))
    found = dict(zip(part.parameters, part.values_of(solution, nonlinear), strict=True))
    return law.ordered({**fixed, **found}), float(solution[len(part.linear)])
