"""Estimates with their intervals, and what a reader should know of them, as data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from rsgen.arrays import Array
from rsgen.errors import RsgenError
from rsgen.finding import Finding, Quantity, Severity, quantities
from rsgen.identification.across import LawAtTwoPlaces
from rsgen.identification.agreement import Agreement
from rsgen.identification.data import Points
from rsgen.identification.fit import Fit, Solution
from rsgen.identification.least_squares import Regression
from rsgen.identification.misfit import misfit_findings
from rsgen.identification.observed import Observed
from rsgen.identification.phase_resonance import of_one_mode
from rsgen.identification.repeats import Repeats
from rsgen.identification.result import Background, Estimate, Resonance
from rsgen.identification.soundness import (
    aside_findings,
    feeds_exciter,
    limit_findings,
    phase_findings,
    sign_findings,
)
from rsgen.law.identifiable import combinations_of
from rsgen.law.numeric import ForceLaw
from rsgen.oscillator import Model
from rsgen.surface import ResponseSurface
from rsgen.surface.plausibility import plausibility_findings
from rsgen.tolerances import CONFIDENCE, ERRORS, EXCESS, NULL_PART
from rsgen.units import parameter_units, per_mass_unit

__all__ = [
    "Findings",
    "make_estimates",
    "names_of",
    "parameter_finding",
    "repeat_findings",
    "state_background",
    "units_of",
]


_NOT_ZERO = 0.5
"""A standard error beyond this share of the value: the 95 % interval contains zero."""

_STRONG = 0.05
"""Higher harmonics beyond this share of the fundamental bias every first-order estimate by per cents."""

_DRIFT = 0.02
"""Mean displacement, relative to the amplitude, beyond which a symmetric law misses more than an offset."""

_NO_SINE = 0.5
"""Harmonics beyond this share of the fundamental at half of the points: hardly the answer to a sine."""

_NOISE_AS_SINE = 1.0
"""Harmonics beyond this share at half of the points: noise or a transient, taken for a steady sine."""

_WHOLE = 0.99
"""Null vectors have unit norm; a shorter parameter part means that the background takes part."""

_FEW = 5
"""Points within the width of a resonance below which one outlier decides the damping."""


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
    wides = np.broadcast_to(stdtrit(found.freedom, CONFIDENCE), variance.shape).tolist()
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
    wide = float(stdtrit(freedom, CONFIDENCE))
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
    if np.isfinite(error) and error > _NOT_ZERO * abs(value):
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


def repeat_findings(repeats: Repeats, misfit: float, wider: float) -> tuple[Finding, ...]:
    """How the misfit of the means compares with the scatter of repeats, and what that does to the errors.

    Parameters
    ----------
    repeats
        Readings that were joined to means.
    misfit
        Relative, of force and response together [1].
    wider
        How many times wider than by the scatter the standard errors are, half of them.
    """
    typical = float(np.median(repeats.count))
    expected = repeats.noise / np.sqrt(typical)
    found = [
        Finding(
            "repeats-scatter",
            "info",
            numbers=quantities(
                readings=len(repeats.row),
                points=len(repeats.count),
                repeats=typical,
                of_reading=repeats.noise,
                of_mean=expected,
                aside=repeats.aside,
            ),
        )
    ]
    numbers = quantities(misfit=misfit, times=misfit / expected)
    if misfit < EXCESS * expected:
        found.append(Finding("misfit-is-scatter", "info", numbers=numbers))
    else:
        found.append(Finding("misfit-beyond-scatter", "warning", numbers=quantities(**numbers, wider=wider)))
    return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What is looked at for findings about data and fit.

    Parameters
    ----------
    surface, points
        All points of the test, and those that were fitted, without the background.
    fit
        The refined one.
    resonances
        Of all runs.
    agreement
        Of the parts of the test.
    """

    surface: ResponseSurface
    points: Points
    fit: Fit
    resonances: tuple[Resonance, ...]
    agreement: Agreement

    def collect(
        self, of_parameters: tuple[Finding, ...], about: tuple[Finding, ...], *, calibrated: bool
    ) -> tuple[Finding, ...]:
        """All findings, those about parameters first, but for what others that are known explain."""
        found = [*of_parameters, *(self._small_shift() if of_parameters else ())]
        misfit = float(self.fit.regression.noise * np.sqrt(2))
        found += of_one_mode(self.surface.findings, self.points, misfit)
        if not self.surface.phase_known:
            found.append(Finding("phase-not-recorded", "info"))
        elif feeds_exciter(self.points) and not any(
            f.code in ("base-misread", "base-scaled") for f in self.surface.findings
        ):
            found.append(Finding("structure-feeds-exciter", "error"))
        if not calibrated:
            found.append(Finding("not-calibrated", "info"))
        counts = quantities(all=len(self.surface), points=len(self.points))
        unsettled = int(np.count_nonzero(~self.surface.settled))
        if unsettled:
            found.append(
                Finding("points-not-settled", "info", numbers=quantities(unsettled=unsettled, **counts))
            )
        found += aside_findings(
            self.points,
            self.fit.regression,
            len(self.surface),
            self.surface.level_unit,
            decays=self._decays(),
        )
        found += limit_findings(self.surface.findings, self.fit)
        if not self.fit.regression.converged:
            # where the steps ended says nothing of the best values, nor do the errors there
            found.append(Finding("not-converged", "doubt"))
        wider = self.agreement.wider
        found += misfit_findings(self.surface, self.points, self.fit, self.resonances, wider)
        found += self.agreement.findings
        found += sign_findings(self.points, self.fit, self.agreement)
        found += phase_findings(self.fit.background) if self.fit.problem.observed.phase_known else []
        found += self._motion()
        found += self._implausible(calibrated, {finding.parameter for finding in of_parameters})
        found += self._runs()
        if any(f.code == "harmonics-across-left-out" and f.severity == "doubt" for f in about):
            # what harmonics leave of the misfit another mass may take up, and is as wrong for it
            found = [finding for finding in found if finding.code != "mass-contradicted"]
        return tuple(found)

    def _implausible(self, calibrated: bool, not_identifiable: set[str]) -> Iterator[Finding]:
        mass = None if "m" in not_identifiable else self.fit.mass
        damping = min((r.damping_ratio for r in self.resonances if r.damping_ratio > 0), default=None)
        return plausibility_findings(self.surface, calibrated=calibrated, mass=mass, damping=damping)

    def _motion(self) -> list[Finding]:
        points, found = self.points, list[Finding]()
        size, noise = points.amplitude, self.fit.regression.noise
        if points.harmonics.shape[1] > 2:
            higher = np.abs(points.harmonics[:, 2:]) / size[:, None]
            # the largest of as many harmonics that are only noise
            chance = ERRORS * noise * np.sqrt(2 * np.log(max(higher.size, 2)))
            row, order = np.unravel_index(int(np.argmax(higher)), higher.shape)
            largest = float(np.median(higher.max(axis=1)))
            if largest > _NO_SINE:
                numbers = quantities(share=largest)
                severity: Severity = "error" if largest > _NOISE_AS_SINE else "doubt"
                found.append(Finding("not-a-steady-sine", severity, numbers=numbers))
            elif higher[row, order] > max(_STRONG, chance):
                numbers = quantities(
                    harmonic=2 + int(order),
                    share=float(higher[row, order]),
                    level=Quantity(float(points.level[row]), self.surface.level_unit),
                    frequency=Quantity(float(points.omega[row] / 2 / np.pi), "Hz"),
                )
                found.append(Finding("harmonic-strong", "info", numbers=numbers))
        drift = float(np.median(np.abs(points.harmonics[:, 0]) / size))
        law = self.fit.problem.law
        symmetric = law.here.law.odd if isinstance(law, LawAtTwoPlaces) else law.odd
        if symmetric and drift > max(_DRIFT, ERRORS * noise):
            found.append(Finding("mean-of-symmetric-law", "warning", numbers=quantities(share=drift)))
        return found

    def _decays(self) -> bool:
        """Whether the points are those of a free decay."""
        return any(finding.code == "force-of-decay" for finding in self.surface.findings)

    def _runs(self) -> list[Finding]:
        found, runs = [], len(self.resonances)
        jumps = sum(resonance.jump for resonance in self.resonances)
        # the points of a decay lie along the resonance, on neither side of it
        if jumps and not self._decays():
            found.append(Finding("resonance-jumped", "info", numbers=quantities(jumps=jumps, runs=runs)))
        few = sum(self._near(resonance) < _FEW for resonance in self.resonances)
        # loops and continuations have few points a level, and many levels
        if few and self.surface.control not in ("phase", "continuation"):
            numbers = quantities(few=few, runs=runs, points=_FEW)
            found.append(Finding("resonance-sparse", "warning", numbers=numbers))
        return found

    def _near(self, resonance: Resonance) -> int:
        """Points of the run within the width of its resonance."""
        points = self.points
        near = (points.level == resonance.level) & (points.sweep == resonance.sweep)
        width = max(2 * abs(resonance.damping_ratio), 1e-12) * resonance.frequency
        return int(np.count_nonzero(near & (np.abs(points.omega / 2 / np.pi - resonance.frequency) < width)))

    def _small_shift(self) -> list[Finding]:
        """A resonance that shifts by less than its width says little of a spring."""
        frequency = np.array([resonance.frequency for resonance in self.resonances])
        if len(frequency) < 2:
            return []
        width = float(np.median([2 * abs(r.damping_ratio) * r.frequency for r in self.resonances]))
        shift = float(np.ptp(frequency))
        if not shift < width:
            return []
        level = max(resonance.level for resonance in self.resonances)
        numbers = {
            "shift": Quantity(shift, "Hz"),
            "width": Quantity(width, "Hz"),
            "level": Quantity(level, self.surface.level_unit),
        }
        return [Finding("shift-small", "info", numbers=numbers)]
