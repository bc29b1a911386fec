"""From the errors of a fit to what its result states: estimates with intervals, reasons why there is none.

An interval is p ± t s, with the standard error s and the quantile t of Student's distribution for the
degrees of freedom of s. ``Errors`` holds both for every kind of test, and ``state_parameters`` states them:
a value that the points do not determine (a null vector), or whose interval contains zero, gets a reason.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from math import inf, isfinite, log2, nan
from typing import TypeVar

import numpy as np
import sympy

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.solvers import solve_scaled
from rsgen.common.tolerances import (
    FINITE_DIFFERENCE_STEP,
    MIN_NULL_COMPONENT,
    MISFIT_NEGLIGIBLE,
    RELATIVE_CHANGE_NEGLIGIBLE,
    RELATIVE_ERROR_DOUBTFUL,
    ROUND_OFF,
    SAMPLES_PER_PERIOD_SWITCHED,
    interval_sigmas,
    is_significant,
    samples_for,
)
from rsgen.data.oscillator import Model
from rsgen.data.record_set import Records
from rsgen.dynamics.linear_part import BackgroundTerms
from rsgen.formula.names import symbol
from rsgen.formula.printing import write
from rsgen.formula.unit_text import read_unit
from rsgen.formula.units import ForceUnits, number_text
from rsgen.identification.fitting.fit import Solution
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.results.alternatives import Alternatives
from rsgen.identification.results.result import Background, Estimate, Resonance
from rsgen.law.motion import Motion, project, sine_motion
from rsgen.law.numeric import ForceLaw

_MAX_DENOMINATOR = 100
"""Of the weight of a parameter in a sum that a formula fixes, as the 3 of k*x + k3*x*3."""

_MIN_PARAMETER_NORM = 0.99
"""Norm of the parameter part of a unit null vector; a smaller one includes the background."""


def make_estimates(
    found: Solution,
    law: ForceLaw,
    model: Model,
    reasons: Mapping[str, Finding | None],
    units: Mapping[str, str],
) -> tuple[Estimate, ...]:
    """State each value with standard error, 95 % interval and unit, and why it is not identifiable.

    Fixed parameters have no estimate; the mass is the last. Without convergence no interval is known.
    """
    values, names = np.append(found.values, found.mass), (*law.parameters, "m")
    variance = np.diag(found.covariance)
    wides = np.broadcast_to(interval_sigmas(found.freedom), variance.shape).tolist()
    estimates = []
    for name, value, var, wide in zip(names, values, variance, wides, strict=True):
        finite = bool(np.isfinite(var) and np.isfinite(value))
        # an error is at least round-off
        error = float(max(np.sqrt(max(var, 0.0)), 1e-16 * abs(value))) if finite and found.converged else inf
        centre = float(value) if finite else float("nan")
        interval = (centre - wide * error, centre + wide * error) if finite else (-inf, inf)
        finding = reasons.get(name)
        if not finite and finding is None:
            finding = Finding("not-determined", "warning", name)
        estimates.append(Estimate(name, centre, error, interval, units[name], finding))
    return tuple(estimate for estimate in estimates if estimate.name not in model.exact)


# ----------------------------------------------------------------------------
# Natural frequency and damping ratio of small motion, f = sqrt(k/m)/(2 pi) and zeta = c/(2 sqrt(k m)), with
# k(X) and c(X) for X -> 0.

_SMALL_AMPLITUDES = (1e-9, 1e-8)
"""Shares of an amplitude of the test at which small motion is read: Segalman's law comes as X**0.5."""

_UNITS_OF_SMALL_MOTION = {"natural-frequency": "Hz", "damping-ratio": ""}


@np.errstate(all="ignore")
def _small_motion(law: ForceLaw, amplitude: float, values: Array) -> Array:
    """Return natural frequency [Hz] and damping ratio (2,) of small motion; NaN where there is none.

    Both are NaN of friction, and of a law that is another one on both sides of rest. The last of the values
    (q,) is the mass.
    """
    size, omega = amplitude * np.array(_SMALL_AMPLITUDES), np.ones(2)
    for _ in range(4):  # the stiffness of most laws does not depend on omega: the second round is final
        force = law.along(sine_motion(omega, size), values[:-1], SAMPLES_PER_PERIOD_SWITCHED).force
        mean, stiffness = project(force, 0) / size, project(force, 1) / size
        omega = np.sqrt(stiffness.real / values[-1])
    near, far = np.array([omega / (2 * np.pi), stiffness.imag / (2 * stiffness.real)]).T
    settled = np.abs(far - near) <= MISFIT_NEGLIGIBLE * np.abs(near)
    alike = abs(mean[0]) <= MISFIT_NEGLIGIBLE * abs(stiffness[0])
    sticks = abs(near[1]) > (1 + MISFIT_NEGLIGIBLE) * abs(far[1])
    return np.where(settled & settled[0] & alike & ~sticks & (near != 0), near, nan)


def state_small_motion(law: ForceLaw, found: Regression, amplitude: float) -> tuple[Estimate, ...]:
    """State natural frequency and damping ratio of small motion with 95 % intervals, as far as they exist.

    The covariance of values and mass is propagated linearly, by differences. The ``amplitude`` [m] is the
    largest tested one.
    """
    if law.acts_across or not found.converged:
        return ()
    evaluate = partial(_small_motion, law, amplitude)
    centre = evaluate(found.parameters)
    steps = 1e-6 * np.where(found.parameters == 0, 1.0, found.parameters)
    changes = np.array([evaluate(found.parameters + step) - centre for step in np.diag(steps)]).T
    stated = []
    for (name, unit), value, change in zip(
        _UNITS_OF_SMALL_MOTION.items(), centre.tolist(), changes, strict=True
    ):
        acts = found.free & ~(np.abs(change) <= ROUND_OFF * abs(value))
        slope = change[acts] / steps[acts]
        error = float(np.sqrt(slope @ found.covariance[np.ix_(acts, acts)] @ slope))
        if isfinite(value) and isfinite(error) and acts.any():
            half = float(np.max(interval_sigmas(found.error_freedom[acts]))) * error
            stated.append(Estimate(name, value, error, (value - half, value + half), unit))
    return tuple(stated)


# ----------------------------------------------------------------------------
# The steps from the errors of a fit to its estimates, of sines and of a multisine.


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Errors of the parameters of a fit.

    Parameters
    ----------
    regression
        The fit of law and mass (q,), with all errors.
    of_law
        (q, q) covariance of this law as it stands, without errors by other laws.
    with_background
        The fit with its background, whose errors are those of noise, repeats and parts of the test.
    noise
        Relative noise of a reading [1].
    others
        All alternatives to the fit.
    ambiguous
        Findings about values that an alternative changes.
    """

    regression: Regression
    of_law: Array
    with_background: Regression
    noise: float
    others: Alternatives
    ambiguous: list[Finding]


AnyErrors = TypeVar("AnyErrors", bound=Errors)


def error_of_mass(model: Model, parameters: Array, linear: Sequence[int], background: Sequence[str]) -> Array:
    """Return the covariance (q, q) by the error of a mass that was held, for the forces of a test follow it.

    The same motions have the forces of another mass, all linear values, and receptances over it. Parameters
    (q,) are the values, those at the places ``linear`` in proportion to forces, the mass, the background.
    """
    count = len(parameters) - len(background) - 1
    scaled = np.isin(np.arange(len(parameters)), [*linear, count])
    scaled[count + 1 :] = [name.startswith(("b", "r")) for name in background]
    held = model.weighed if "m" in model.fixed else None
    moved = np.where(scaled, parameters, 0.0) * (0.0 if held is None else held[1] / held[0])
    return np.outer(moved, moved)


def with_mass_error(errors: AnyErrors, law: ForceLaw, model: Model, background: Sequence[str]) -> AnyErrors:
    """Return errors with the ``error_of_mass``, which is then one of the values."""
    if model.weighed is None or "m" not in model.fixed:
        return errors
    regression, whole, count = errors.regression, errors.with_background, len(law.parameters) + 1
    more = error_of_mass(model, whole.parameters, law.linear, background)
    own, free = more[:count, :count], regression.free | (np.arange(count) == count - 1)
    return replace(
        errors,
        regression=replace(regression, covariance=regression.covariance + own, free=free),
        of_law=errors.of_law + own,
        with_background=replace(whole, covariance=whole.covariance + more),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Statement:
    """Parameters of a fit as its result states them.

    Parameters
    ----------
    refined, of_law
        Estimates with all errors, and with those of this law as it stands.
    small_motion
        As in ``Identification``.
    covariance
        (f, f) of the free parameters; NaN without convergence.
    reasons
        By parameter, why it is not identifiable; None where it is.
    ambiguous
        Findings about values that an alternative changes, or a background that noise hides.
    """

    refined: tuple[Estimate, ...]
    of_law: tuple[Estimate, ...]
    small_motion: tuple[Estimate, ...]
    covariance: Array
    reasons: Mapping[str, Finding | None]
    ambiguous: list[Finding]


def state_parameters(
    errors: Errors,
    law: ForceLaw,
    model: Model,
    units: Mapping[str, str],
    tested: Mapping[str, Quantity],
    explain: Callable[[dict[str, Finding | None]], dict[str, Finding | None]] = dict,
) -> Statement:
    """State the parameters of a fit: reasons, estimates with both kinds of errors, covariance.

    Parameters
    ----------
    errors, law, model
        Of the fit.
    units, tested
        SI units by parameter, and the largest amplitude and level of the test.
    explain
        Function that replaces reasons by others that say more.
    """
    found, others = errors.regression, errors.others
    why = _Reasons(others.names, units, tested, found, law.expression)
    reasons = explain({name: why.reason(name) for name in others.names})
    solution = Solution.of(found, converged=found.converged)
    stated, free = np.where(found.converged, found.covariance, nan), np.flatnonzero(found.free)
    return Statement(
        make_estimates(solution, law, model, reasons, units),
        make_estimates(replace(solution, covariance=errors.of_law), law, model, reasons, units),
        state_small_motion(law, found, float(tested["amplitude"].value)),
        stated[np.ix_(free, free)],
        reasons,
        [*errors.ambiguous, *others.within_noise(found.parameters, stated, reasons, units)],
    )


def largest_tested(amplitude: Array, level: Array, level_unit: str) -> dict[str, Quantity]:
    """Return the largest amplitude [m] and the largest level of a test."""
    return quantities("m", amplitude=amplitude.max()) | quantities(level_unit, level=level.max())


_FREE_OF_SIZE = ("", "kg", "N/m", "N*s/m")
"""Units of values that do not change with a factor of the motion of a free decay."""


def missing_unit_check(test: Records, model: Model, units: Mapping[str, str]) -> str:
    """Return what would check the units of a test and is not known; "" if they are right.

    It is "mass", "levels" or, of a decay whose law has values that depend on the size of the motion, "force".

    Those of a simulation are, and of forces where a mass, force or stiffness is given. On a driven base a
    factor of both motions changes amplitudes alone: levels in their unit show it, or a given length.
    """
    given = [units[name] for name in model.fixed if units[name]]
    if test.origin == "simulated":
        return ""
    if test.base:
        has_length = any(read_unit(unit).dimension.powers.get("m") for unit in given)
        measured = any(found.names.get("signal") == "levels" for found in test.findings)
        return "levels" if (measured or test.label is not None) and not has_length else ""
    if any(found.code == "force-of-decay" for found in test.findings):
        sized = {name for name, unit in units.items() if unit not in _FREE_OF_SIZE}
        return "force" if sized - set(model.fixed) == sized != set() else ""
    return "" if model.weighed or any("N" in unit for unit in given) else "mass"


def moves_of(
    equations: Callable[[float, float], tuple[Array, Array]],
    found: Regression,
    law: ForceLaw,
    stated: Statement,
    model: Model,
    test: Records,
) -> str:
    """Return what 1 % of a given mass and of the scale of each sensor moves; "" without a mass.

    ``equations`` are residual (r,) and slopes J (r, q) of a fit whose force and response have two factors. To
    first order, what changes the residual by d moves values by (J^T J)^-1 J^T d. Of a driven base, whose
    response may be absolute or relative, and of decays forces are the mass times a motion.
    """
    values = {e.name: e.value for e in stated.refined if e.identifiable and e.value}
    if model.mass is None or test.per_mass or not values:
        return ""
    (right, rows), by, mass = equations(1.0, 1.0), 1 + FINITE_DIFFERENCE_STEP, len(law.parameters)
    if not len(right):
        return ""
    decay = any(one.code == "force-of-decay" for one in test.findings)
    pushed, seen = ((equations(*both)[0] - right) / FINITE_DIFFERENCE_STEP for both in ((by, 1), (1, by)))
    inertia, follows = rows[:, mass] * found.parameters[mass], decay or bool(test.base)
    changes = {} if model.weighed else {"m": follows * pushed - inertia}
    if not (test.base or model.sensors):
        changes |= {"the response": pushed + seen} if decay else {"the force": pushed, "the response": seen}
    held, said = np.where(found.free, nan, 0.0), []
    for cause, change in changes.items():
        moved = dict(zip((*law.parameters, "m"), solve_scaled(rows, change, known=held)[0], strict=False))
        moves = {name: round(float(moved[name] / value), 1) for name, value in values.items()}
        # slopes tell little beyond
        part = 1.0 if max(map(abs, moves.values())) < 20 else 0.1
        effects = ", ".join(f"{name} by {number_text(part * move, 2)} %" for name, move in moves.items())
        said.append(f"{part:g} % of {cause} moves {effects}")
    return "; ".join(said)


def outcome_of(
    estimates: Sequence[Estimate], misfit: float, *, moves: str, missing_check: str, **counts: int
) -> Finding:
    """Summarise the numbers of identified and all parameters, ``counts`` of the test, and the misfit.

    ``moves`` is the text of ``moves_of``. Nothing checks the units of a test with a ``missing_check``
    (``missing_unit_check``): its free mass, a force, or levels that are amounts.
    """
    identified = sum(e.identifiable and isfinite(e.standard_error) for e in estimates)
    numbers = quantities(identified=identified, parameters=len(estimates), **counts, misfit=misfit)
    sized = ", ".join(e.name for e in estimates if e.unit not in _FREE_OF_SIZE)
    names = {"levels": {"levels": "labels"}, "force": {"force": sized}}.get(missing_check, {})
    if missing_check == "mass" and any((e.name, e.unit) == ("m", "kg") and e.identifiable for e in estimates):
        names = {"mass": "free"}
    if moves:
        names = names | {"moves": moves}
    return Finding("identified", "info", "", numbers, names)


def state_background(
    shape: BackgroundTerms,
    force: Array | ComplexArray,
    amplitude: Array,
    values: Array,
    found: Regression,
    units: ForceUnits,
    resonances: Sequence[Resonance] = (),
) -> Background | None:
    """Return the values (b,) of a background with 95 % intervals; None without one.

    Parameters
    ----------
    shape
        Its terms at the fitted points.
    force, amplitude
        (n,) of the points, as measured [N], [m].
    values, found
        (b,) of the background, and the fit, whose last parameters they are; without convergence no interval
        is known.
    units
        Of the test.
    resonances
        Of the mode, where they are known: a neighbour within the width of one of them is the mode itself.
    """
    if not len(values):
        return None
    variance = np.diag(found.covariance)[-len(values) :]
    wides = interval_sigmas(found.error_freedom[-len(values) :])
    errors = np.sqrt(np.where(np.isfinite(variance) & found.converged, variance, np.inf))
    # the residue of a neighbour, one over its mass, is then a number
    named = [units.of(unit).replace("1/kg*kg", "") for unit in shape.units]
    estimates = tuple(
        Estimate(name, v, e, (v - wide * e, v + wide * e), unit)
        for name, v, e, wide, unit in zip(
            shape.names, values.tolist(), errors.tolist(), wides.tolist(), named, strict=True
        )
    )
    if "f_n" in shape.names:
        estimates = (*estimates[:-4], *_state_neighbour(estimates[-4:], shape.band, resonances))
    part = np.abs(shape.receptance(values) * force)
    share = float(np.sqrt(np.mean(part**2) / np.mean(amplitude**2)))
    return Background(shape.kind, shape.band, estimates, share)


def _state_neighbour(
    estimates: tuple[Estimate, ...], band: tuple[float, float], resonances: Sequence[Resonance]
) -> tuple[Estimate, ...]:
    """Return residue, f_n and zeta, without intervals where they are of no mode near the one of the law.

    Its residue is not told from zero, or its damping is negative or, of a peak in the band, not told from
    zero: that is noise of a point or two. Or it lies within the half-power width of the mode itself.
    """
    residue, frequency, ratio = estimates[:2], estimates[2].value, estimates[3]
    separate = all(abs(frequency - r.frequency) > abs(r.damping_ratio) * r.frequency for r in resonances)
    damped = ratio.interval[0 if band[0] < frequency < band[1] else 1] > 0
    if separate and damped and any(e.interval[0] * e.interval[1] > 0 for e in residue):
        return estimates
    found = Finding("not-distinct-from-zero", "warning", "r", {"frequency": Quantity(frequency, "Hz")})
    return tuple(replace(e, standard_error=inf, interval=(-inf, inf), finding=found) for e in estimates)


def damping_findings(
    law: ForceLaw, motion: Motion, values: Array, estimates: Sequence[Estimate]
) -> list[Finding]:
    """Find dampers that feed energy into the motion: terms that take it as they are written, with intervals
    of their factors below zero.

    A term that is written to feed energy (-c*v, the damper of van der Pol) is meant to, and one of a power
    series between others that take energy bends its curve; both are judged by the work of the whole law.

    Parameters
    ----------
    law, motion
        A law and n motions that it follows.
    values, estimates
        (p,) of its parameters, and what is known of them.
    """
    known = {estimate.name: estimate for estimate in estimates}
    samples = max(samples_for(law.switched), 8 * len(motion.orders))
    sample, velocity = law.along(motion, values, samples), motion.waveforms(samples)[1]
    twice = law.along(replace(motion, harmonics=2 * motion.harmonics), values, samples)
    power = {
        place: np.broadcast_to(sample.by_parameter[place], velocity.shape) * velocity for place in law.linear
    }
    dampers = [place for place in law.linear if takes_energy(power[place])]
    of = {place: _order(sample.by_parameter[place], twice.by_parameter[place]) for place in dampers}
    orders = [order for place, order in of.items() if values[place] > 0 and np.isfinite(order)]
    whole, found = abs(float(np.sum(np.broadcast_to(sample.force, velocity.shape) * velocity))), []
    for place in (place for place in dampers if law.parameters[place] in known):
        estimate = known[law.parameters[place]]
        between = min(orders, default=nan) < of[place] < max(orders, default=nan)
        if estimate.interval[1] < 0 and not between:
            share = abs(estimate.value) * float(np.sum(power[place])) / max(whole, 1e-300)
            numbers = {"value": Quantity(estimate.value, estimate.unit), "share": Quantity(share)}
            found.append(Finding("damping-feeds-energy", "doubt", estimate.name, numbers))
    return found


def _order(force: Array, twice: Array) -> float:
    """Power of the motion that a force goes with, from that of twice the motion; NaN of what is no power."""
    size, larger = (float(np.linalg.norm(part)) for part in (force, twice))
    if not np.allclose(twice * size, force * larger, rtol=0, atol=MIN_NULL_COMPONENT * size * larger):
        return nan
    return log2(larger / size) if min(size, larger) > 0 else nan


def takes_energy(power: Array) -> bool:
    """Return True if a force of power (n, s) takes energy out of the motion and never feeds any."""
    most = float(np.max(power, initial=0.0))
    return most > 0 and float(np.min(power)) >= -ROUND_OFF * most


def phase_findings(background: Array) -> list[Finding]:
    """Find a phase error that costs amplitude, too, taken up by a background (b,).

    A filter of first order that turns a phase by psi leaves cos(psi) of the amplitude, of which a test in its
    band shows nothing. Beyond a quarter of a turn it is a sign, a sense or another quantity.
    """
    turned = float(np.angle(np.exp(1j * background[0]))) if len(background) else 0.0
    loss = float(1 - max(np.cos(turned), 0.0))
    if not loss > RELATIVE_CHANGE_NEGLIGIBLE:
        return []
    numbers = quantities(phase=Quantity(turned, "rad"), loss=loss)
    return [Finding("phase-turned", "doubt" if loss > RELATIVE_ERROR_DOUBTFUL else "info", "psi", numbers)]


@dataclass(frozen=True, slots=True)
class _Reasons:
    """Reasons why parameters are not identifiable from a test.

    Parameters
    ----------
    names, units
        All parameters of the regression, and their SI units.
    tested
        Largest amplitude and level of the test.
    regression
        Of all ``names``; errors that a background causes are in its covariance.
    force
        The law, n(x, v).
    """

    names: tuple[str, ...]
    units: Mapping[str, str]
    tested: Mapping[str, Quantity]
    regression: Regression
    force: sympy.Expr

    def reason(self, name: str) -> Finding | None:
        """Return why a parameter is not identifiable; None where it is.

        In this order: the points do not determine it (a null vector), alone or but for a combination with
        others; it does not differ from zero beyond chance (``is_significant``: the normal distribution is
        narrower than the stated interval where few degrees of freedom are left). An interval by likelihood
        without zero lifts the latter (``profile``).
        """
        names, regression, i = self.names, self.regression, self.names.index(name)
        weight, value, unit = np.abs(regression.null[i]), float(regression.parameters[i]), self.units[name]
        if weight.max(initial=0.0) > MIN_NULL_COMPONENT:
            column = regression.null[:, int(np.argmax(weight))]
            large = (n for n, part in zip(names, column, strict=True) if abs(part) > MIN_NULL_COMPONENT)
            partners = [n for n in large if n != name]
            if partners or float(np.linalg.norm(column)) < _MIN_PARAMETER_NORM:
                others = ", ".join(partners) or "the background"
                known, numbers = self._combination(name, partners)
                return Finding("confounded", "warning", name, numbers, {"with": others, **known})
            return Finding("no-effect", "warning", name, {"value": Quantity(value, unit), **self.tested})
        error = float(np.sqrt(regression.covariance[i, i]))
        if np.isfinite(error) and not is_significant(value, error):
            if not regression.converged:
                # neither says anything where the steps ended; of b**2 these have no slope at zero
                slope = self.force.diff(symbol(name))
                flat = slope != 0 and slope.subs(symbol(name), 0) == 0
                return Finding("not-distinct-from-zero", "warning", name, {}, {"flat": "yes"} if flat else {})
            numbers = {"value": Quantity(value, unit), "standard_error": Quantity(error, unit), **self.tested}
            numbers |= self._share(name, abs(value) + interval_sigmas() * error)
            why = self._exponent(name) or self._without_width(name)
            return Finding("not-distinct-from-zero", "warning", name, numbers, why)
        return None

    def _exponent(self, name: str) -> dict[str, str]:
        """Return the fitted exponent that a coefficient goes with, as p of kp*abs(x)**p, where p is known."""
        regression, powers = self.regression, self.force.diff(symbol(name)).atoms(sympy.Pow)
        exponents = {free.name for power in powers for free in power.exp.free_symbols} & {*self.names}
        for place in sorted(map(self.names.index, exponents)):
            error = float(np.sqrt(regression.covariance[place, place]))
            if error > 0 and is_significant(float(regression.parameters[place]), error):
                return {"exponent": self.names[place]}
        return {}

    def _without_width(self, name: str) -> dict[str, str]:
        """Return what a smooth jump becomes if its width is zero, as sign(v) of tanh(v/vs); empty if none."""
        width, step = symbol(name), sympy.Dummy()
        for smooth in self.force.atoms(sympy.tanh):
            across = smooth.args[0] * width
            if not (across.has(width) or self.force.xreplace({smooth: step}).has(width)):
                return {"smooth": write(smooth), "jump": write(sympy.sign(across))}
        return {}

    def _share(self, name: str, largest: float) -> dict[str, Quantity]:
        """Return the share of a spring's term, with the ``largest`` value, in the force at large amplitudes.

        Nothing of a damper, or where the law is not linear in the parameter.
        """
        at = {symbol("x"): self.tested["amplitude"].value, symbol("v"): 0}
        known = {
            symbol(one): value for one, value in zip(self.names, self.regression.parameters, strict=False)
        }
        term, whole = self.force.diff(symbol(name)).subs(at), self.force.subs(at).subs(known)
        share = largest * term / whole if whole.is_number and whole.is_nonzero else sympy.nan
        known_share = share.is_number and share.is_finite and share.is_nonzero
        return {"share": Quantity(abs(float(share)))} if known_share else {}

    def _combination(self, name: str, partners: Sequence[str]) -> tuple[dict[str, str], dict[str, Quantity]]:
        """Return a weighted sum, product or ratio with a partner that the law alone depends on, and its
        interval.

        Its gradient has no part in the null vectors, and the law does not change along it. Its error is that
        of the fit times the largest factor by which the stated error of a parameter is larger.
        """
        names, units, regression, force = self.names, self.units, self.regression, self.force
        values, basis = regression.parameters, regression.basis * regression.sigma
        null = regression.null / regression.scale[:, None]
        own, stated = np.linalg.norm(basis, axis=1), np.sqrt(np.diag(regression.covariance))
        known = np.isfinite(stated) & (own > 0)
        wider = float(np.max(stated[known] / own[known], initial=1.0))
        for i, j in (sorted((names.index(name), names.index(partner))) for partner in partners):
            a, b, (x, y) = symbol(names[i]), symbol(names[j]), values[[i, j]].tolist()
            t = sympy.Dummy("t", positive=True)
            forms = [(a * b, {a: a * t, b: b / t})] + [(a / b, {a: a * t, b: b * t})] * bool(y)
            if units[names[i]] == units[names[j]] and null[j].any():
                share = Fraction(-float(null[i] @ null[j] / (null[j] @ null[j])))
                weight = sympy.Rational(share.limit_denominator(_MAX_DENOMINATOR))
                forms.insert(0, (a + weight * b, {a: a - weight * t, b: b + t}))
            for form, moved in forms:
                slope = np.zeros(len(values))
                slope[[i, j]] = [float(form.diff(place).subs({a: x, b: y})) for place in (a, b)]
                least = MIN_NULL_COMPONENT * np.linalg.norm(slope / regression.scale)
                if np.linalg.norm(slope @ null) > least or sympy.expand(force.xreplace(moved) - force) != 0:
                    continue
                unit, sign = units[names[i]], "/" if form == a / b else "*" if form == a * b else ""
                if sign:
                    other = units[names[j]]
                    unit = str(read_unit(f"{unit}{sign}({other})").dimension) if unit and other else ""
                off = interval_sigmas(regression.freedom) * wider * float(np.linalg.norm(slope @ basis))
                value = float(form.subs({a: x, b: y}))
                unit = "" if unit == "1" else unit
                numbers = quantities(unit, combined=value, low=value - off, high=value + off)
                return {"combination": write(form)}, numbers
        return {}, {}
