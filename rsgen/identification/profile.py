"""Profile likelihood: an interval from fits with one value fixed, where a standard error says too little.

The deviance D(b) is what the sum of squares grows by when b is fixed and every other parameter is fitted
again, in units of the noise. The interval holds the values with sqrt(D) below a target: the quantile of
Student's t (Venzon and Moolgavkar, Applied Statistics 37, 1988) times the ratio of the stated standard error
to that of independent errors of one size. Asked are nonlinear parameters and those correlated with one, if
the misfit is noise without a pattern. With a quadratic sum of squares it is the value and its standard
error, which is Wald's; near a breakpoint that is barely passed, a saturation or an exponent the sum of
squares has a corner or a plateau, and the interval is lopsided or open to one side.

1. sqrt(D) at both ends of Wald's interval: where it is the target to 15 %, that interval stands.
2. Else each side is sought: distances are doubled until sqrt(D) exceeds the target, then interpolated.
3. Each fit starts from the nearest one before; where sqrt(D) jumps, also from the line through two of them.
4. Where it still jumps, the balance lost the measured motion: that side is open (``followed``). Where it
   jumps on both sides, the profile says nothing of the value, and Wald's interval stands.
5. The balance samples a period at 64 places. A smooth law steeper than that, as tanh(v/vs) of a small vs, is
   for it another one at each small vs, so that it finds an end which the test does not tell; tanh(a*v) is at
   each large a. Such a side ends only where the law, sampled finely along the measured motions, differs by
   more than the noise from that with a quarter of the value, or four times it, linear parameters fitted
   again; else the value is bounded. A side whose sqrt(D) is below the target even at zero, the sharp law, is
   bounded, too.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import TYPE_CHECKING

import numpy as np

import rsgen.identification  # fits of multisines, where one is given
from rsgen.common.arrays import Array, blocks
from rsgen.common.errors import RsgenError, require
from rsgen.common.finding import Finding, Quantity
from rsgen.common.solvers import solve_scaled
from rsgen.common.text_table import Printed, TextTable, interval_text, short
from rsgen.common.tolerances import (
    BALANCE_HARMONICS,
    CONFIDENCE_TEXT,
    MAX_SHIFT_TO_ERROR,
    MISFIT_OF_NOISE,
    NEAR_STEPS,
    NOISE_RATIO_BY_CHANCE,
    POINTS_PER_BLOCK,
    SAMPLES_PER_PERIOD,
    interval_sigmas,
)
from rsgen.identification.fitting.fit import Fit, refit_weighted
from rsgen.identification.fitting.least_squares import Regression, descend
from rsgen.identification.fitting.points import FORCE, OTHERS, per_unit_mass
from rsgen.identification.results import Estimate, Identification, MultisineIdentification
from rsgen.identification.terms import fit_near
from rsgen.law.motion import harmonics_of
from rsgen.law.numeric import ForceLaw

if TYPE_CHECKING:
    from rsgen.identification.lines.line_fit import LineFit

_END_TOLERANCE = 0.02
"""Relative difference of sqrt(D) at the end of an interval from the quantile, and of the place of a jump; the
decrease of D, which is near four there, by a step that is the last of a fit."""

_WALD_TOLERANCE = 0.15
"""Relative difference of sqrt(D) at the ends of Wald's interval from the quantile, up to which it stands."""

_CORRELATION = 0.5
"""Correlation from which a parameter goes with a nonlinear one, as the stiffness behind a gap does."""

_MOST_FITS = 12
"""Most fits to one side: a side that has no end after so many doublings is open."""

_END_SHARE = 0.8
"""Share of the quantile that sqrt(D) has on both sides of an end: with less it jumps there."""

_JUMP_RATIO = 2.0
"""A fit with a root this many times the one that is expected by its distance from its neighbour, at least one
beyond that, is tried from a second start."""

_LEAST_STEP = 0.1
"""First step to a side, relative to half the width of Wald's interval."""

_STEP_RATIO = 2.0
"""Factor from one distance to the next while no end is found."""

_STEEPER = 0.25
"""Factor of a nonlinear value, or its inverse, at which a law must differ for that side to have an end."""

_RESOLVING_LINES = 4
"""Lines, relative to those recorded, that show most smooth laws at a quarter of the cost of all."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Profile(Printed):
    """How the misfit grows with the distance of one parameter from its value, all others fitted again.

    Parameters
    ----------
    name, unit
        The parameter, and its SI unit.
    values, root
        (k,) values that were tried, ascending, and the root of the deviance there with the sign of the
        distance, in standard errors: a straight line where Wald's interval holds.
    interval
        Where ``root`` stays within the quantile of Student's t; an end without limit is infinite.
    wald
        From the standard error.
    followed
        Values between which the balance has the motions that were measured, infinite where it never lost
        them: an infinite end of the interval with a finite one here is due to the balance, not to the test.
    """

    name: str
    unit: str
    values: Array
    root: Array
    interval: tuple[float, float]
    wald: tuple[float, float]
    followed: tuple[float, float]

    @property
    def table(self) -> TextTable:
        """The table that is printed."""
        rows = tuple((short(v, 6), short(r, 3)) for v, r in zip(self.values, self.root, strict=True))
        caption = f"{self.name}: {interval_text(self.interval, short, self.unit)}"
        caption += f", {CONFIDENCE_TEXT} by profile likelihood"
        for side, end in zip(("below", "above"), self.followed, strict=True):
            if isfinite(end):
                caption += f"; {side} {short(end, 5)} the balance, not the test, ends"
        return TextTable((f"{self.name} {self.unit}".rstrip(), "root of the deviance"), rows, caption=caption)


class _Likelihood:
    """Fits with one parameter fixed, each started from one that is near; all are kept.

    A fit with one value fixed has values of all other parameters, which are as likely as that one.
    """

    _fine = 128
    """Times the samples of a balance that show what a steep law does near a turn of the motion."""

    def __init__(self, found: Fit) -> None:
        problem = found.problem.select(np.flatnonzero(found.regression.used))
        self._order = max((BALANCE_HARMONICS, *problem.observed.recorded))
        self._near = fit_near(problem, found.regression.parameters, order=self._order)
        near = self._near.regression
        base = refit_weighted(self._near, problem, near.parameters, near.nuisance, order=self._order)
        self._problem, self.regression = problem, found.regression
        self._orders = sorted({1, *problem.observed.recorded} - {0})
        self._begin(problem.law, base.parameters, base.nuisance, base.cost, base.sigma)
        self._error = np.sqrt(np.diag(found.regression.covariance))
        self.resolved = self._noise < NOISE_RATIO_BY_CHANCE * found.regression.sigma

    def _begin(self, law: ForceLaw, best: Array, nuisance: Array, cost: float, noise: float) -> None:
        """Keep the best fit, its sum of squares, and the noise in whose units the deviance is."""
        self.law, self.names, self.best = law, (*law.parameters, "m"), best
        self._cost, self._noise = cost, noise
        self._fits, self._nuisances, self._roots, self._fixed = [best], [nuisance], [0.0], [-1]

    def __call__(self, place: int, value: float) -> float:
        """Return the root of the deviance with one value fixed; infinite where points are not predicted."""
        # near in value, or likely: what the root would be of a fit moved there, if all were quadratic
        known, roots = np.array(self._fits), np.array(self._roots)
        far = np.abs(known[:, place] - value)
        first, *others = np.argsort((far / self._error[place]) ** 2 + roots**2, kind="stable").tolist()
        root = self._fit(place, value, known[first], self._nuisances[first])
        expected = roots[first] + max(far[first] / self._error[place], 1.0)
        if root > _JUMP_RATIO * expected and others:
            # along the line through two fits, as a stop goes with the stiffness behind it
            one, other = known[first], known[others[0]]
            distance = one[place] - other[place]
            share = (value - one[place]) / distance if distance else 0.0
            root = min(root, self._fit(place, value, one + share * (one - other), self._nuisances[first]))
        return root

    def _fit(self, place: int, value: float, start: Array, nuisance: Array) -> float:
        # the other values move as they go together; of nonlinear ones none passes zero
        along = self.regression.basis @ self.regression.basis[place]
        moved = start + (value - start[place]) * along / along[place]
        kept = np.intersect1d(self.law.nonlinear, np.flatnonzero(moved * start <= 0)).astype(np.intp)
        moved[kept] = start[kept]
        moved[place] = value
        # each point goes on from the true motion of the start: on a steep flank it may have two
        parameters, nuisance, cost = self._refit(place, value, moved, nuisance)
        if not isfinite(cost):
            return inf
        root = float(np.sqrt(max(cost - self._cost, 0.0)) / max(self._noise, 1e-300))
        self._fits.append(parameters)
        self._nuisances.append(nuisance)
        self._roots.append(root)
        self._fixed.append(place)
        return root

    def _refit(self, place: int, value: float, start: Array, nuisance: Array) -> tuple[Array, Array, float]:
        """Return parameters, nuisances and sum of squares with one value fixed; the last is infinite if a
        point is not predicted.
        """
        fixed = {**self._problem.fixed, self.names[place]: value}
        problem = replace(self._problem, fixed=fixed)
        begin, order = (start, nuisance), self._order
        found = refit_weighted(self._near, problem, *begin, order=order, gain=_END_TOLERANCE)
        return found.parameters, found.nuisance, found.cost if found.used.all() else inf

    def distinguishes(self, place: int, target: float, factor: float) -> bool:
        """Return False where linear parameters make up for a factor on a nonlinear value.

        Asked of smooth laws that the samples of the balance do not resolve there.
        """
        law = self.law
        if law.switched or law.remembers or law.acts_across or place not in law.nonlinear:
            return True
        other = np.array(self.best)
        other[place] *= factor
        limit = target * self._noise
        coarse, medium = (self._along(other, times)[:, -1] for times in (1, 4))
        if np.linalg.norm(medium - coarse) <= _END_TOLERANCE * limit:
            return True
        change = self._along(other, self._fine)
        change[:, -1] -= self._along(self.best, self._fine)[:, -1]
        columns, right = change[:, :-1], change[:, -1]
        return not np.linalg.norm(right - columns @ solve_scaled(columns, right)[0]) <= limit

    def _along(self, parameters: Array, times: int) -> Array:
        """Harmonics N_h along the measured motions, real, as the sensors see them; before them (n, l) those
        by each linear parameter.

        At so many times the samples of a balance, in units of the noise of F; beyond the fundamental as
        motions X_h = N_h / (m (h^2 - 1) omega^2), too.
        """
        law, motion, points = self.law, self._near.motion, self._problem.observed.points
        values, mass, samples = *self._problem.split(parameters)[:2], times * SAMPLES_PER_PERIOD
        inertia = (np.square(self._orders) - 1) * mass * points.omega[:, None] ** 2
        force, size = points.noise[:, [FORCE, OTHERS]].T * (np.abs(points.force), points.amplitude)
        scale = np.hypot(force[:, None], inertia * size[:, None])
        found = np.empty((len(points), len(self._orders), len(law.linear) + 1), dtype=complex)
        for part in blocks(len(points), POINTS_PER_BLOCK // times):
            sample = law.along(motion.select(np.arange(len(points))[part]), values, samples)
            for i, signal in enumerate([*(sample.by_parameter[p] for p in law.linear), sample.force]):
                signals = np.broadcast_to(signal, sample.force.shape)
                harmonics = harmonics_of(signals, max(self._orders) + 1)[:, self._orders]
                found[part, :, i] = harmonics / scale[part]
        flat = found.reshape(-1, found.shape[-1])
        return np.vstack([flat.real, flat.imag])

    def tried(self, place: int) -> list[tuple[float, float]]:
        """Return values and roots of the fits in which a parameter was fixed, and of the best."""
        chosen = [i for i, fixed in enumerate(self._fixed) if fixed in (-1, place)]
        return [(float(self._fits[i][place]), self._roots[i]) for i in chosen]

    def _bracket(self, place: int, side: float, target: float) -> list[tuple[float, float]]:
        """Return value and root of the fit farthest to a side within a target, and of the next beyond it.

        The root of a fit in which another parameter was fixed is no less than that of its own value.
        """
        values, roots = np.array(self._fits)[:, place], np.array(self._roots)
        near = max(np.flatnonzero(roots <= target), key=lambda i: side * values[i])
        own = (np.array(self._fixed) == place) & (side * (values - values[near]) > 0)
        beyond = sorted(np.flatnonzero(own), key=lambda i: side * values[i])[:1]
        return [(float(values[i]), float(roots[i])) for i in (near, *beyond)]

    def end(self, place: int, step: float, target: float, stop: float) -> tuple[float, float]:
        """Find where the root reaches a target, by first steps of a size; infinite where it does not.

        The target is the quantile times the stated error over the own one (``_target``), so that a root is
        significant beyond target times the noise. ``stop`` is a value not to be passed; an interval that
        reaches it has no end there. The second number is the value up to which the balance has the motions
        that were measured: infinite where it keeps them, the best value where linear parameters make up for
        another one (``distinguishes``).
        """
        side = float(np.sign(step))
        nowhere = side * inf
        if not self.distinguishes(place, target, _STEEPER if side * self.best[place] < 0 else 1 / _STEEPER):
            return nowhere, float(self.best[place])
        (near, low), *beyond = self._bracket(place, side, target)
        if beyond and (beyond[0][0] - stop) * side < 0:
            outer, over = beyond[0]
        else:
            # as far as a root in proportion to the distance reaches the target
            distance = step * max(1 - low / target, _LEAST_STEP)
            for _ in range(_MOST_FITS):
                outer = near + distance
                if (outer - stop) * side >= 0:
                    outer = stop
                over = self(place, outer)
                if over >= target or outer == stop:
                    break
                near, low, distance = outer, over, distance * _STEP_RATIO
        if not over >= target:
            return nowhere, nowhere
        inside, again = False, False
        for _ in range(_MOST_FITS):
            narrow = abs(outer - near) < _END_TOLERANCE * abs(outer - self.best[place])
            if narrow or abs(over / target - 1) < _END_TOLERANCE:
                break
            # a line through both, or the middle where that has moved the same end twice
            share = 0.5 if again or over > _JUMP_RATIO * (low + 1) else (target - low) / (over - low)
            between = near + float(np.clip(share, 0.1, 0.9)) * (outer - near)
            root = self(place, between)
            inside, again = root < target, inside == (root < target)
            if inside:
                near, low = between, root
            else:
                outer, over = between, root
        # where the balance loses the motion, the root jumps: that is no end that the test tells
        if low > _END_SHARE * target or over < target / _END_SHARE:
            return outer, nowhere
        return nowhere, near


class _LineLikelihood(_Likelihood):
    """Fits of the lines of a multisine, with the variances of the last fit as weights."""

    _fine = 4

    def __init__(self, found: LineFit) -> None:
        self.regression = found.regression
        # along fewer lines: those beyond, which follow from the law, are small and cost most
        recorded, lines = len(found.lines.spectra.lines), found.lines
        if found.law.switched:
            samples = lines.samples * recorded // (lines.extended + 1)
            lines = replace(lines, extended=recorded - 1, samples=1 << (samples - 1).bit_length())
            found = replace(found, lines=lines)
        elif lines.extended >= _RESOLVING_LINES * recorded:
            shorter = replace(found, lines=lines.up_to(_RESOLVING_LINES * (recorded - 1)))
            found = shorter if is_resolved(shorter, found) else found
        self._found = found
        place = found.parameters, found.nuisance
        best, nuisance, line, _ = descend(found.linearise, *place, found.rules)
        cost = found.rules.cost(line.residual, best)
        self._begin(found.law, best, nuisance, cost, self.regression.sigma)
        self._error = np.sqrt(np.diag(self.regression.covariance))
        self.resolved = not found.lines.spectra.exact.all()

    def _along(self, parameters: Array, times: int) -> Array:
        """Lines of the balance in units of their noise, and before them (n, l) those by all but nonlinear
        parameters.
        """
        lines = replace(self._found.lines, samples=times * self._found.lines.samples)
        line = replace(self._found, lines=lines).linearise(parameters, self._nuisances[0])
        columns = np.delete(line.by_parameter, self.law.nonlinear, axis=2)
        return np.concatenate([columns, line.residual[:, :, None]], axis=2).reshape(line.residual.size, -1)

    def _refit(self, place: int, value: float, start: Array, nuisance: Array) -> tuple[Array, Array, float]:
        found, free = self._found, np.array(self._found.free)
        free[place] = False
        rules = replace(found.rules, steps=NEAR_STEPS, gain=_END_TOLERANCE, free=free)
        parameters, nuisance, line, _ = descend(found.linearise, start, nuisance, rules)
        return parameters, nuisance, rules.cost(line.residual, parameters)


def is_resolved(fit: LineFit, steep: LineFit) -> bool:
    """Return True if lines along a steep law, beyond those of a fit, move no value.

    Along the lines of the record the velocity is smoother near its turns than a friction leaves it, which a
    smoother law makes up for. Asked of the law as found, and with nonlinear values that make it steeper.
    """
    if not fit.misfit > MISFIT_OF_NOISE:
        return True
    slopes = fit.linearise(fit.parameters, fit.nuisance).by_parameter
    for factor in (1.0, _STEEPER, 1 / _STEEPER) if fit.law.nonlinear else (1.0,):
        parameters = np.array(fit.parameters)
        parameters[list(fit.law.nonlinear)] *= factor
        longer, own = (one.linearise(parameters, fit.nuisance).residual for one in (steep, fit))
        moved = fit.regression.basis.T @ np.einsum("nkq,nk->q", slopes, longer - own)
        if np.linalg.norm(moved) > MAX_SHIFT_TO_ERROR:
            return False
    return True


def _target(regression: Regression, place: int, estimate: Estimate) -> float:
    """Return the root at which an interval ends: the quantile, by the ratio of both errors."""
    # of independent errors of one size, as the sum of squares takes them
    own = regression.sigma * float(np.linalg.norm(regression.basis[place]))
    return float(interval_sigmas(regression.freedom)) * estimate.standard_error / own


def _wald(regression: Regression, estimate: Estimate) -> float:
    """Return half the width of the interval that the standard error gives."""
    return estimate.standard_error * float(interval_sigmas(regression.freedom))


def _is_quadratic(likelihood: _Likelihood, estimate: Estimate, target: float) -> bool:
    """Return True if Wald's interval agrees with that of the likelihood."""
    place = likelihood.names.index(estimate.name)
    if not all(likelihood.distinguishes(place, target, factor) for factor in (_STEEPER, 1 / _STEEPER)):
        return False
    half = _wald(likelihood.regression, estimate)
    roots = [likelihood(place, likelihood.best[place] + sign * half) for sign in (-1, 1)]
    return all(abs(root / target - 1) < _WALD_TOLERANCE for root in roots)


def _interval(
    likelihood: _Likelihood, estimate: Estimate, target: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the values whose root is within a target, and those that the balance can follow.

    Those of a nonlinear parameter keep its sign.
    """
    law, place = likelihood.law, likelihood.names.index(estimate.name)
    best, step = float(likelihood.best[place]), _wald(likelihood.regression, estimate)
    stops = [-inf, inf]
    if place in law.nonlinear:
        stops[0 if best > 0 else 1] = 0.0
    sides = zip((-1, 1), stops, strict=True)
    ends = [likelihood.end(place, sign * step, target, stop) for sign, stop in sides]
    # the simulator and the correction of bias move the value, and the interval with it
    moved = float(likelihood.regression.parameters[place]) - best
    (low, least), (high, most) = (np.array(ends) + moved).tolist()
    return (low, high), (least, most)


def with_profiles(found: Fit, estimates: Sequence[Estimate]) -> tuple[Estimate, ...]:
    """Replace Wald's intervals by those of the profile likelihood where the two differ.

    The sum of squares of a law that is linear in its parameters is nearly quadratic. Of another one that of
    nonlinear parameters, and of those that go with them, is asked at both ends of their intervals. What a
    law misses is no noise, and its sum of squares no likelihood; nor is one that has no least value.
    """
    law, regression = found.problem.law, found.regression
    noise = regression.converged and regression.sigma > MISFIT_OF_NOISE
    if not (law.nonlinear and noise) or found.systematic:
        return tuple(estimates)
    # a balance is no data on how wide a bend is that it does not resolve, where nothing else tells
    names = (*law.parameters, "m")
    hidden = {name for name, gone in zip(names, found.hidden_by_noise, strict=False) if gone and law.rough}
    return _replaced(_Likelihood(found), estimates, hidden)


def with_line_profiles(found: LineFit, estimates: Sequence[Estimate]) -> tuple[Estimate, ...]:
    """Replace Wald's intervals of a multisine as ``with_profiles`` does those of sines."""
    if not (found.law.nonlinear and found.converged) or found.systematic:
        return tuple(estimates)
    return _replaced(_LineLikelihood(found), estimates)


def _replaced(
    likelihood: _Likelihood, estimates: Sequence[Estimate], hidden: Collection[str] = ()
) -> tuple[Estimate, ...]:
    """Ask the likelihood at the ends of the intervals of nonlinear parameters and of what goes with them.

    Those of ``hidden`` parameters stay.
    """
    known = [e for e in estimates if isfinite(e.value) and 0 < e.standard_error < inf]
    known = [e for e in known if e.name not in hidden]
    regression = likelihood.regression
    with_nonlinear = _with_nonlinear(regression.covariance, likelihood.law.nonlinear)
    place = {name: i for i, name in enumerate(likelihood.names)}
    asked = [e for e in known if place[e.name] in with_nonlinear]
    asked.sort(key=lambda estimate: with_nonlinear.index(place[estimate.name]))
    if not likelihood.resolved:
        return tuple(estimates)
    target = {e.name: _target(regression, place[e.name], e) for e in asked}
    bent = [e for e in asked if not _is_quadratic(likelihood, e, target[e.name])]
    # nonlinear parameters first: fits of their profiles are starts and likely values of the others
    replaced = {e.name: _stated(e, *_interval(likelihood, e, target[e.name])) for e in bent}
    return tuple(replaced.get(e.name, e) for e in estimates)


def _with_nonlinear(covariance: Array, nonlinear: Sequence[int]) -> list[int]:
    """Return the places of nonlinear parameters, and then of those correlated with one of them."""
    error, places = np.sqrt(np.diag(covariance)), list(nonlinear)
    with np.errstate(invalid="ignore"):
        together = np.abs(covariance[:, places]) > _CORRELATION * np.outer(error, error[places])
    others = [place for place in np.flatnonzero(together.any(axis=1)) if place not in nonlinear]
    return [*nonlinear, *map(int, others)]


def _stated(estimate: Estimate, interval: tuple[float, float], followed: tuple[float, float]) -> Estimate:
    """State an interval of the profile: without one end a value is bounded, not identified."""
    finding, (low, high) = estimate.finding, interval
    if not (isfinite(low) or isfinite(high)) and all(map(isfinite, followed)):
        return estimate
    if finding is not None and finding.code == "not-distinct-from-zero" and low * high > 0:
        finding = None
    if finding is None and not (isfinite(low) or isfinite(high)):
        finding = Finding("not-determined", "warning", estimate.name)
    elif finding is None and not (isfinite(low) and isfinite(high)):
        side, bound, reach = "at most", high, followed[0]
        if isfinite(low):
            side, bound, reach = "at least", low, followed[1]
        numbers = {"bound": Quantity(bound, estimate.unit)}
        if isfinite(reach):
            numbers["reach"] = Quantity(reach, estimate.unit)
        finding = Finding("bounded-to-one-side", "warning", estimate.name, numbers, {"side": side})
    return replace(estimate, interval=interval, by_profile=True, finding=finding)


def profile(found: Identification, name: str) -> Profile:
    """Profile the likelihood of one parameter of an identification.

    Parameters
    ----------
    found
        What ``identify`` found.
    name
        A parameter of its law, or "m", that was fitted and has a value.

    Raises
    ------
    RsgenError
        There is no such parameter or it has no value, or the data are exact, so that the likelihood is that
        of round-off.
    """
    require(found, Identification, "found")
    if name in found.model.fixed:
        raise RsgenError(f"profile: {name} is fixed; identify without fixing it")
    known = {e.name: e for e in found.refined if isfinite(e.value)}
    if name not in known:
        allowed = ", ".join(known) or "none"
        raise RsgenError(f"profile: {name!r} is no parameter with a value here; those are {allowed}")
    if isinstance(found, MultisineIdentification):
        lines = rsgen.identification.fit_multisine(*per_unit_mass(found.spectra, found.model))
        likelihood: _Likelihood = _LineLikelihood(lines)
    elif found.fit is not None:
        likelihood = _Likelihood(found.fit)
    else:
        raise RsgenError("profile: found has no fit, which pickle does not keep; give what identify returned")
    if not likelihood.resolved:
        raise RsgenError("profile: the data are exact, and what is left of them is no noise")
    regression, place = likelihood.regression, likelihood.names.index(name)
    estimate, target = known[name], _target(regression, place, known[name])
    interval, followed = _interval(likelihood, estimate, target)
    # the search for an end may come back to a value
    tried = sorted({f"{value:.6g}": (value, root) for value, root in likelihood.tried(place)}.values())
    moved = float(regression.parameters[place]) - float(likelihood.best[place])
    scale, half = float(interval_sigmas(regression.freedom)) / target, _wald(regression, estimate)
    return Profile(
        name,
        estimate.unit,
        np.array([value + moved for value, _ in tried]),
        np.array([root * scale * np.sign(value - likelihood.best[place]) for value, root in tried]),
        interval,
        (estimate.value - half, estimate.value + half),
        followed,
    )
