"""What a test at phase resonance determines where the mass is not given: stiffness over mass, and damping.

There k(X) = m omega^2 holds whatever m is, so that every mass fits alike if the stiffness grows with it; only
errors of the lag would tell one from another. Lags that differ by more than those determine a mass, and it is
identified as in other tests. Else the law is fitted with two masses, those of a lightly and of a
well damped mode. What scales with the mass is given as a ratio to it; a lag phi off a quarter period shifts
that by 2 zeta/tan(phi), which the two fits enclose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rsgen.common.arrays import Array
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.linear_algebra import solve_scaled
from rsgen.common.tolerances import DAMPED, LIGHT, samples_for
from rsgen.data.oscillator import Model
from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.plausibility import plausibility_findings
from rsgen.formula.units import per_mass_unit
from rsgen.identification.fitting.across import law_of
from rsgen.identification.fitting.points import (
    Points,
    assumed_mass,
    at_resonance_alone,
    mass_sure,
    near_resonance,
    select_points,
)
from rsgen.identification.fitting.repeats import gather_repeats
from rsgen.identification.results import Estimate, Identification, later
from rsgen.law.motion import project, sine_motion
from rsgen.law.numeric import ForceLaw

__all__ = ["identify_ratios", "resonance_findings"]

_SCALES = 1e-6
"""Share of the stiffness of a law that may not scale with its parameters: quadrature leaves less. A law of
which more is left determines the mass by itself, as one whose damping contains its stiffness."""

_OF_THE_MASS = frozenset(
    {"mass-contradicted", "resonance-sparse", "shift-small", "size-unusual", "size-impossible"}
)
"""Findings that an assumed mass, or a damping ratio with it, is part of."""

_SHORT = {"N/m": "1/s^2", "N*s/m": "1/s"}
"""Units of ratios to the mass, by those of the parameters, as the modal table has them."""

_POWER = 1e-3
"""Rounding of the power of the mass in a parameter."""


def identify_ratios(
    surface: ResponseSurface, model: Model, identify: Callable[[ResponseSurface, Model], Identification]
) -> Identification | None:
    """Identify without a mass from points at phase resonance alone; None where the test is another.

    Parameters
    ----------
    surface, model
        As of an identification.
    identify
        Identifies with a given mass.
    """
    if model.mass is not None or not surface.phase_known:
        return None
    points = select_points(gather_repeats(surface)[0], model)
    law = law_of(model.elements, across=surface.across is not None)
    # a loop has its stiffness in its damping, which is known without a mass
    if law.acts_across or law.remembers or not near_resonance(points):
        return None
    if not at_resonance_alone(points, noise=0.0):
        free = identify(surface, model)
        if _has_mass(free, points):
            return free
    masses = [assumed_mass(points, ratio) for ratio in (LIGHT, DAMPED)]
    if not min(masses) > 0:
        return None
    # an assumed mass has no scale that could contradict that of the test
    scaled = replace(model, observation=replace(model.observation, calibrated=True))
    light, damped = (identify(surface, replace(scaled, mass=mass)) for mass in masses)
    powers = _powers(points, law, np.array(light.solution))
    if powers is None:
        return None
    return _Ratios(surface, points, model, powers, (light, damped)).identification()


def resonance_findings(
    points: Points, mass: float | None, law: ForceLaw, noise: float
) -> tuple[Finding, ...]:
    """Say what a mass [kg] that was not given rests on where all points have the lag of resonance.

    A law with memory has its stiffness in the area of its loops, and so determines a mass if it is right.
    With others it rests on errors of the lag.
    """
    if mass is not None or not at_resonance_alone(points, noise):
        return ()
    numbers = quantities(points=len(points))
    if law.remembers:
        return (Finding("mass-by-loops", "warning", "m", numbers),)
    return (Finding("mass-at-resonance", "doubt", "m", numbers),)


def _has_mass(free: Identification, points: Points) -> bool:
    """Tell whether lags that differ by more than the noise determine the mass of a fit that had it free."""
    if at_resonance_alone(points, free.outcome["misfit"]):
        return False
    return mass_sure(free.refined[-1].value, float(free.covariance[-1, -1]))


def _powers(points: Points, law: ForceLaw, values: Array) -> Array | None:
    """(p,) power of the mass that each parameter scales with; None where the law itself determines a mass.

    Of a sine, what multiplies the stiffness by a factor and leaves the damping as it is.
    """
    sample = law.along(sine_motion(points.omega, points.amplitude), values, samples_for(law.switched))
    size = points.amplitude

    def rows(force: Array) -> tuple[Array, Array, Array]:
        fundamental = project(force, 1) / size
        return fundamental.real, fundamental.imag, force.mean(axis=1) / size

    stiffness, damping, mean = rows(sample.force)
    slopes = [rows(by) for by in sample.by_parameter]
    scales = np.median(np.abs(stiffness)), np.median(np.abs(damping)), np.median(np.abs(stiffness))
    if not (np.all(np.isfinite(scales)) and min(scales) > 0):
        return None
    matrix = np.stack(
        [np.concatenate([part / s for part, s in zip(each, scales, strict=True)]) for each in slopes], axis=1
    )
    wanted = np.concatenate([stiffness / scales[0], np.zeros(len(size)), mean / scales[2]])
    if not np.isfinite(matrix).all():
        return None
    change, _, _ = solve_scaled(matrix, wanted)
    left = np.linalg.norm(wanted - matrix @ change) / np.linalg.norm(wanted)
    if not left < _SCALES:
        return None
    used = np.linalg.norm(matrix, axis=0) * np.abs(change) > _SCALES
    powers = np.where(used, change / np.where(values != 0, values, 1.0), 0.0)
    return np.asarray(np.round(powers / _POWER) * _POWER)


@dataclass(frozen=True, slots=True, eq=False)
class _Ratios:
    """Identifications with two assumed masses, and what scales with these.

    Parameters
    ----------
    surface, points, model
        The test, those that were fitted, and the model, which has no mass.
    powers
        (p,) power of the mass in each parameter.
    pair
        With the mass of a lightly damped mode, and of a well damped one.
    """

    surface: ResponseSurface
    points: Points
    model: Model
    powers: Array
    pair: tuple[Identification, Identification]

    def identification(self) -> Identification:
        """What both have in common; NaN where a mass would be needed."""
        light, known = self.pair[0], np.append(self.powers == 0, False)
        refined = (*(self._estimate(i) for i in range(len(self.powers))), self._mass())
        covariance = np.full((len(known), len(known)), np.nan)
        wider = [
            e.standard_error / old.standard_error if k else 1.0
            for e, old, k in zip(refined, light.refined, known, strict=False)
        ]
        inner = np.ix_(known, known)
        covariance[inner] = (light.covariance * np.outer(wider, wider))[np.ix_(known[:-1], known[:-1])]
        of_parameters = tuple(e.finding for e in refined if e.finding is not None)
        before = {id(e.finding) for e in light.refined}
        rest = [f for f in light.findings if id(f) not in before and f.code not in _OF_THE_MASS]
        sizes = plausibility_findings(self.surface, calibrated=self.model.observation.calibrated)
        rest += [finding for finding in sizes if finding.code in _OF_THE_MASS]
        if not self.model.observation.calibrated:
            rest.append(Finding("not-calibrated", "info"))
        elif any(f.code == "ratio-to-mass" for f in of_parameters):
            # the damping is known, so that a bound on its ratio is one on the mass
            least = {"least": Quantity(self.pair[1].mass, "kg"), "damping": Quantity(DAMPED)}
            rest.append(Finding("ratios-hold-from", "warning", numbers=least))
        resonances = tuple(
            replace(r, stiffness=float("nan"), damping_ratio=float("nan")) for r in light.resonances
        )
        count = sum(estimate.identifiable for estimate in refined)
        numbers = {**light.outcome.numbers, **quantities(identified=count, parameters=len(refined))}
        return replace(
            light,
            model=self.model,
            paper=later(lambda: self._masked(light.paper)),
            first_order=later(lambda: self._masked(light.first_order)),
            refined=refined,
            first_order_bias=later(
                lambda: tuple(
                    bias if k else float("nan")
                    for bias, k in zip((*light.first_order_bias, 0.0), known, strict=True)
                )
            ),
            covariance=covariance,
            resonances=resonances,
            curve=replace(light.curve, stiffness=np.full(len(light.curve.stiffness), np.nan)),
            restoring=None,
            outcome=replace(light.outcome, numbers=numbers),
            findings=(*of_parameters, *rest),
            solution=np.where(known[:-1], light.solution, np.nan),
        )

    def _mass(self) -> Estimate:
        why = Finding("mass-at-resonance", "warning", "m", quantities(points=len(self.points)))
        return _unknown("m", "kg", why)

    def _masked(self, estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
        """Estimates of another method, without those that an assumed mass is in."""
        kept = [
            _unknown(e.name, e.unit, None) if power else e
            for e, power in zip(estimates, self.powers, strict=True)
        ]
        return (*kept, self._mass())

    def _estimate(self, i: int) -> Estimate:
        """A parameter: its value where no mass is in it, else the finding that has its ratio to the mass."""
        light, damped = (found.refined[i] for found in self.pair)
        if not (np.isfinite(light.value) and np.isfinite(damped.value)):
            return light
        power = float(self.powers[i])
        per = [(found.mass**-power) for found in self.pair]
        value, other = light.value * per[0], damped.value * per[1]
        halves = [np.ptp(e.interval) / 2 * each for e, each in zip((light, damped), per, strict=True)]
        half = float(np.hypot(max(halves), other - value))
        error = half * light.standard_error * per[0] / halves[0] if halves[0] > 0 else half
        name, unit = f"{light.name}/m", _SHORT.get(light.unit, per_mass_unit(light.unit))
        finding = light.finding
        if finding is not None and finding.code == "not-distinct-from-zero" and power == 1:
            numbers = {
                **finding.numbers,
                "value": Quantity(value, unit),
                "standard_error": Quantity(error, unit),
            }
            finding = replace(finding, parameter=name, numbers=numbers)
        if power == 0:
            return Estimate(light.name, value, error, (value - half, value + half), light.unit, finding)
        if finding is None and power == 1:
            numbers = {
                "ratio": Quantity(value, unit),
                "low": Quantity(value - half, unit),
                "high": Quantity(value + half, unit),
                "damping": Quantity(DAMPED),
            }
            finding = Finding("ratio-to-mass", "warning", light.name, numbers)
        return _unknown(light.name, light.unit, finding or Finding("needs-mass", "warning", light.name))


def _unknown(name: str, unit: str, finding: Finding | None) -> Estimate:
    return Estimate(name, float("nan"), float("inf"), (float("-inf"), float("inf")), unit, finding)
