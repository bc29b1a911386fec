"""From a fit to values with intervals and units, and why some have none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import log2, nan

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, Quantity
from rsgen.common.tolerances import CONFIDENCE, NULL_PART, ROUND_OFF, TURNED, samples_for, t_quantile
from rsgen.data.oscillator import Model
from rsgen.formula.units import parameter_units, per_mass_unit
from rsgen.identification.fitting.fit import Solution
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.observed import Observed
from rsgen.identification.fitting.points import Points
from rsgen.identification.results.result import Background, Estimate
from rsgen.law.identifiable import combinations_of
from rsgen.law.motion import Motion
from rsgen.law.numeric import ForceLaw

__all__ = [
    "NOT_ZERO",
    "damping_findings",
    "make_estimates",
    "names_of",
    "parameter_finding",
    "phase_findings",
    "state_background",
    "takes_energy",
    "units_of",
    "with_combinations",
]

NOT_ZERO = 0.5
"""A standard error beyond this share of the value: the 95 % interval contains zero."""

_WHOLE = 0.99
"""Null vectors have unit norm; a shorter parameter part means that the background takes part."""


def names_of(law: ForceLaw, model: Model) -> tuple[str, ...]:
    """Name what is identified: the parameters in their order, then "m" where the mass is free."""
    return (*law.parameters, "m") if model.mass is None else law.parameters


def make_estimates(
    found: Solution,
    law: ForceLaw,
    model: Model,
    reasons: Mapping[str, Finding | None],
    units: Mapping[str, str] | None = None,
) -> tuple[Estimate, ...]:
    """State each value with standard error, 95 % interval and unit, and why it is not identifiable."""
    values = np.append(found.values, found.mass) if model.mass is None else found.values
    names = names_of(law, model)
    variance = np.diag(found.covariance)
    wides = np.broadcast_to(t_quantile(found.freedom, CONFIDENCE), variance.shape).tolist()
    units = units_of(model) if units is None else units
    estimates = []
    for name, value, var, wide in zip(names, values, variance, wides, strict=True):
        finite = bool(np.isfinite(var) and np.isfinite(value))
        # round-off is the least error a value can have
        error = float(max(np.sqrt(max(var, 0.0)), 1e-16 * abs(value))) if finite else float("inf")
        centre = float(value) if finite else float("nan")
        interval = (centre - wide * error, centre + wide * error) if finite else (float("-inf"), float("inf"))
        finding = reasons.get(name)
        if not finite and finding is None:
            finding = Finding("not-determined", "warning", name)
        estimates.append(Estimate(name, centre, error, interval, units[name], finding))
    return tuple(estimates)


def state_background(
    observed: Observed, values: Array, variance: Array, freedom: int, *, per_mass: bool = False
) -> Background | None:
    """Give the values (b,) of a background with 95 % intervals; None where none was asked for.

    Parameters
    ----------
    observed
        The points that were fitted.
    values, variance
        (b,) of the background; a variance that is not finite is not known.
    freedom
        Degrees of freedom of the noise that the variance rests on.
    per_mass
        Whether the force is one per mass.
    """
    shape, points = observed.background, observed.points
    if not len(values):
        return None
    wide = float(t_quantile(freedom, CONFIDENCE))
    errors = np.sqrt(np.where(np.isfinite(variance), variance, np.inf))
    # the residue of a neighbour, one over its mass, is then a number
    units = [per_mass_unit(unit).replace("1/kg*kg", "") if per_mass else unit for unit in shape.units]
    estimates = tuple(
        Estimate(name, float(v), float(e), (float(v - wide * e), float(v + wide * e)), unit)
        for name, v, e, unit in zip(shape.names, values, errors, units, strict=True)
    )
    part = np.abs(shape.receptance(values) * points.force)
    share = float(np.sqrt(np.mean(part**2) / np.mean(points.amplitude**2)))
    return Background(observed.kind, observed.band, estimates, share)


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
    orders = {
        place: _order(sample.by_parameter[place], twice.by_parameter[place])
        for place in dampers
        if values[place] > 0
    }
    whole, found = abs(float(np.sum(np.broadcast_to(sample.force, velocity.shape) * velocity))), []
    for place in dampers:
        estimate = known[law.parameters[place]]
        own = _order(sample.by_parameter[place], twice.by_parameter[place])
        between = min(orders.values(), default=nan) < own < max(orders.values(), default=nan)
        if estimate.interval[1] < 0 and not between:
            share = abs(estimate.value) * float(np.sum(power[place])) / max(whole, 1e-300)
            numbers = {"value": Quantity(estimate.value, estimate.unit), "share": Quantity(share)}
            found.append(Finding("damping-feeds-energy", "doubt", estimate.name, numbers))
    return found


def _order(force: Array, twice: Array) -> float:
    """Power of the motion that a force goes with, from that of twice the motion; NaN of what is no power."""
    size, larger = (float(np.linalg.norm(part)) for part in (force, twice))
    if not np.allclose(twice * size, force * larger, rtol=0, atol=NULL_PART * size * larger):
        return nan
    return log2(larger / size)


def takes_energy(power: Array) -> bool:
    """Whether a force takes energy out of the motion at every instant, or none, by its power (n, s)."""
    most = float(np.max(power, initial=0.0))
    return most > 0 and float(np.min(power)) >= -ROUND_OFF * most


def phase_findings(background: Array) -> list[Finding]:
    """Find a phase error that is a sign, a sense or another quantity, taken up by a background (b,)."""
    turned = float(np.angle(np.exp(1j * background[0]))) if len(background) else 0.0
    if not abs(turned) > TURNED:
        return []
    return [Finding("phase-turned", "doubt", "psi", {"phase": Quantity(turned, "rad")})]


def units_of(model: Model, *, per_mass: bool = False) -> dict[str, str]:
    """SI unit of every parameter, "" where the law does not say; of a law per unit mass where asked."""
    # names that are kept for the time and the force have no unit there
    units = dict.fromkeys(model.parameters, "")
    # a law whose terms do not agree in units can be fitted all the same
    with suppress(RsgenError):
        units |= parameter_units(model.force)
    if per_mass:
        units = {name: per_mass_unit(unit) for name, unit in units.items()}
    return {"m": "kg", **{name: "" if unit == "1" else unit for name, unit in units.items()}}


def parameter_finding(
    name: str, names: tuple[str, ...], unit: str, points: Points, level_unit: str, regression: Regression
) -> Finding | None:
    """Why a parameter is not identifiable from the test; None where it is.

    Parameters
    ----------
    name, names, unit
        The parameter, all of the regression, and its SI unit.
    points, level_unit
        That were fitted.
    regression
        Of all ``names``; errors that a background causes are in its covariance.
    """
    i = names.index(name)
    tested = {
        "amplitude": Quantity(float(points.amplitude.max()), "m"),
        "level": Quantity(float(points.level.max()), level_unit),
    }
    weight = np.abs(regression.null[i])
    if weight.max(initial=0.0) > NULL_PART:
        column = regression.null[:, int(np.argmax(weight))]
        partners = [n for n, part in zip(names, column, strict=True) if n != name and abs(part) > NULL_PART]
        if partners:
            return Finding("confounded", "warning", name, names={"with": ", ".join(partners)})
        if float(np.linalg.norm(column)) < _WHOLE:
            return Finding("confounded-with-background", "warning", name)
        return Finding("no-effect", "warning", name, tested)
    error, value = float(np.sqrt(regression.covariance[i, i])), float(regression.parameters[i])
    if np.isfinite(error) and error > NOT_ZERO * abs(value):
        numbers = {"value": Quantity(value, unit), "standard_error": Quantity(error, unit), **tested}
        return Finding("not-distinct-from-zero", "warning", name, numbers)
    return None


def with_combinations(reasons: Mapping[str, Finding | None], model: Model) -> dict[str, Finding | None]:
    """Say of confounded parameters which combinations the law itself has of them, whatever the test."""
    if not any(reason is not None and reason.code == "confounded" for reason in reasons.values()):
        return dict(reasons)
    named = dict(reasons)
    for combination in combinations_of(model.force):
        for name in combination.parameters:
            reason = named.get(name)
            if reason is not None and reason.code == "confounded":
                names = {
                    "with": ", ".join(other for other in combination.parameters if other != name),
                    "determined": " and ".join(combination.determined),
                }
                named[name] = replace(reason, names=names)
    return named
