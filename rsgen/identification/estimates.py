"""From values with their covariance to estimates: intervals, units, and why a value is not identifiable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from rsgen.errors import RsgenError
from rsgen.finding import Finding
from rsgen.identification.fit import Fit
from rsgen.identification.result import Estimate
from rsgen.law.numeric import ForceLaw
from rsgen.oscillator import Model
from rsgen.units import parameter_units

__all__ = ["Values", "make_estimates", "names_of", "of_fit", "units_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Values:
    """Values with covariance: the parameters of the law in order, then the mass where it is free."""

    values: Array
    mass: float
    covariance: Array
    freedom: int


def of_fit(found: Fit) -> Values:
    """Take the values of a fit."""
    count = found.problem.count
    return Values(
        found.values, found.mass, found.regression.covariance[:count, :count], found.regression.freedom
    )


def names_of(law: ForceLaw, model: Model) -> tuple[str, ...]:
    """Name what is identified: the parameters in their order, then "m" where the mass is free."""
    return (*law.parameters, "m") if model.mass is None else law.parameters


def make_estimates(
    found: Values, law: ForceLaw, model: Model, reasons: Mapping[str, Finding | None]
) -> tuple[Estimate, ...]:
    """State each value with standard error, 95 % interval and unit, and why it is not identifiable."""
    values = np.append(found.values, found.mass) if model.mass is None else found.values
    names = names_of(law, model)
    variance = np.diag(found.covariance)
    wide = float(stdtrit(found.freedom, 0.975))
    units = units_of(model)
    estimates = []
    for name, value, var in zip(names, values, variance, strict=True):
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


def units_of(model: Model) -> dict[str, str]:
    """SI unit of every parameter, "" where the law does not say."""
    try:
        units = parameter_units(model.force)
    except RsgenError:
        # a law whose terms do not agree in units can be fitted all the same
        units = dict.fromkeys(model.parameters, "")
    return {"m": "kg", **{name: "" if unit == "1" else unit for name, unit in units.items()}}
