"""Resonances of a test: the paper's method, and identification without a mass at phase resonance.

At phase resonance the displacement lags a quarter period, so that Re F/X = k(X) - m omega^2 vanishes. With
the resonance frequency omega_n and the damping ratio zeta of each level,

    k(X) = m omega_n^2,    c(X) = Im F/X / omega_n = 2 zeta m omega_n

at the amplitude X reached there; the parameters of a law follow by linear least squares (Liu et al., Sec.
1.2). The mass is the slope of Re F/X over omega^2 at one amplitude. Where all points lie at resonance there
is no such slope: then only ratios to the mass are identifiable (second half of this module).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.linear_algebra import solve_scaled
from rsgen.common.tolerances import ASSUMED_DAMPING_RATIO, MAX_LIGHT_DAMPING_RATIO, samples_for
from rsgen.data.free_mode import estimate_mass, steady
from rsgen.data.oscillator import Model, join_model
from rsgen.data.surface import ResponseSurface
from rsgen.data.surface.plausibility import plausibility_findings
from rsgen.formula.units import per_mass_unit
from rsgen.identification.fitting.across import law_of
from rsgen.identification.fitting.fit import Solution
from rsgen.identification.fitting.points import (
    Points,
    assumed_mass,
    at_resonance_alone,
    mass_sure,
    near_resonance,
    select_points,
)
from rsgen.identification.fitting.repeats import MIN_JUMP_RATIO, gather_repeats
from rsgen.identification.results import Estimate, Identification, Resonance, later
from rsgen.identification.starting.equations import Equations
from rsgen.identification.starting.start import solve_equations
from rsgen.law.motion import project, sine_motion
from rsgen.law.numeric import ForceLaw

_MIN_COSINE_OF_STEP = np.cos(np.pi / 5)
"""Cosine of the phase difference of neighbours, 36 degrees, below which a jump is between them."""

_MAX_COTANGENT = 0.6
"""Cotangent of a lag 30 degrees off a quarter period, within which a single point is a resonance."""

_MAX_FALL_TO_INERTIA = 2.0
"""Fall of Re F/X between neighbours, relative to that by inertia, beyond which a jump is between them."""


def _smooth_steps(points: Points, run: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return the mask (len(run) - 1,) of neighbours on one smooth branch."""
    stiffness = points.force[run] / points.harmonics[run, 1]
    size = np.abs(points.harmonics[run, 1])
    ratio = size[1:] / size[:-1]
    turn = (stiffness[1:] * np.conj(stiffness[:-1])).real / np.abs(stiffness[1:] * stiffness[:-1])
    return np.asarray((ratio < MIN_JUMP_RATIO) & (ratio > 1 / MIN_JUMP_RATIO) & (turn > _MIN_COSINE_OF_STEP))


def find_resonances(points: Points, mass: float) -> tuple[tuple[Resonance, ...], NDArray[np.float64]]:
    """Find the resonance of every level and sweep.

    Returns
    -------
    resonances
        Ascending in level; none for a level whose points do not reach the resonance.
    turning
        (r, 2) largest and smallest displacement [m] at the resonances.
    """
    stiffness = points.force / points.harmonics[:, 1]
    amplitude = points.amplitude
    found: list[Resonance] = []
    places: list[tuple[int, int, float]] = []
    for run in points.runs:
        at_resonance = np.abs(stiffness[run].real) < _MAX_COTANGENT * np.abs(stiffness[run].imag)
        place = _crossing(stiffness[run].real, amplitude[run], _smooth_steps(points, run), at_resonance)
        if place is None:
            continue
        near, other, share = place
        i, j = run[near], run[other]

        def blend(values: Array, i: int = i, j: int = j, share: float = share) -> float:
            return float(values[i] + share * (values[j] - values[i]))

        if near == other:
            square = float(points.omega[i] ** 2 + stiffness[i].real / mass)
            if square <= 0:
                continue
            omega = float(np.sqrt(square))
            damping = float(stiffness[i].imag / points.omega[i])
        else:
            omega = blend(points.omega)
            damping = blend(stiffness.imag / points.omega)
        found.append(
            Resonance(
                level=float(points.level[i]),
                sweep=str(points.sweep[i]),
                frequency=omega / (2 * np.pi),
                damping_ratio=damping / (2 * mass * omega),
                amplitude=blend(amplitude),
                stiffness=mass * omega**2,
                damping=damping,
                jump=near == other
                and len(run) > 1
                and not _passes_smoothly(stiffness[run].real, points.omega[run], near, mass),
            )
        )
        places.append((int(i), int(j), share))
    return tuple(found), _turning_points(points, places)


def _turning_points(points: Points, places: list[tuple[int, int, float]]) -> Array:
    """Return largest and smallest displacement (r, 2) [m], interpolated between two points."""
    first, second = (np.array([place[side] for place in places], dtype=np.intp) for side in (0, 1))
    share = np.array([place[2] for place in places])[:, None]
    low, high = (
        np.where(np.isfinite(points.peak[rows]), points.peak[rows], points.motion.select(rows).peaks())
        for rows in (first, second)
    )
    return np.asarray(low + share * (high - low))


def _crossing(
    real: Array, size: Array, smooth: NDArray[np.bool_], at_resonance: NDArray[np.bool_]
) -> tuple[int, int, float] | None:
    """Return the two neighbours between which Re F/X passes zero, and the share of the way.

    At a jump both are the point of larger amplitude. ``at_resonance`` marks points at phase resonance.
    """
    down = np.flatnonzero((real[:-1] > 0) & (real[1:] <= 0))
    if len(down):
        at = int(down[np.argmax(np.maximum(size[down], size[down + 1]))])
        if smooth[at]:
            return at, at + 1, float(real[at] / (real[at] - real[at + 1]))
        near = at if size[at] >= size[at + 1] else at + 1
        return near, near, 0.0
    if not len(size):
        return None
    if len(size) == 1 and at_resonance[0]:
        # one point of a phase-locked loop
        return 0, 0, 0.0
    top = int(np.argmax(size))
    # a run that does not pass the resonance: its largest response, unless at an end
    interior = 0 < top < len(size) - 1
    return (top, top, 0.0) if interior else None


def _passes_smoothly(real: Array, omega: Array, near: int, mass: float) -> bool:
    """Return True if Re F/X passes zero next to a point, and falls at most about as fast as by inertia alone.

    The points are then far from each other, but no jump, which changes the stiffness, is between them.
    """
    for first in (near - 1, near):
        if first >= 0 and first + 1 < len(real) and real[first] > 0 >= real[first + 1]:
            inertia = mass * (omega[first + 1] ** 2 - omega[first] ** 2)
            return bool(real[first] - real[first + 1] < _MAX_FALL_TO_INERTIA * inertia)
    return False


def _estimate_mass(points: Points) -> tuple[float, float]:
    """Return mass and standard error: slope of the inverse receptance over omega^2 at one amplitude."""
    found = estimate_mass(*steady(points.force, points.harmonics[:, 1], points.omega))
    return (found.mass, found.mass_error) if found is not None and found.mass > 0 else (np.nan, np.nan)


def fit_resonances(
    points: Points, law: ForceLaw, fixed: Mapping[str, float], near: Callable[[], Solution]
) -> tuple[Callable[[], Solution], tuple[Resonance, ...]]:
    """Return a function that fits k(X) and c(X) of the law to the resonances, and the resonances.

    ``near`` returns an approximate solution, for an unknown mass or a law that is not linear in parameters.
    """
    mass, mass_error = (fixed["m"], 0.0) if "m" in fixed else _estimate_mass(points)
    resonances, turning = find_resonances(points, mass if np.isfinite(mass) else near().mass)

    def fitted() -> Solution:
        omega = 2 * np.pi * np.array([r.frequency for r in resonances])
        size = np.array([r.amplitude for r in resonances])
        force = omega * np.array([r.damping for r in resonances]) * size
        good = force > 0
        if not (np.isfinite(mass) and good.any()):
            unknown = np.full(len(law.parameters), np.nan)
            return Solution(unknown, mass, np.diag(np.append(unknown, mass_error)), 1, np.nan)
        # the turning points of an asymmetric motion need its mean
        turned = not law.odd and (0 in points.measured or bool(np.isfinite(points.peak).all()))
        sine = np.stack([np.zeros(good.sum()), size[good]], axis=1).astype(complex)
        equations = Equations(
            omega[good],
            1j * force[good],
            sine,
            False,
            1 / force[good],
            turning[good] if turned else np.zeros((0, 2)),
            (sine,) * (len(law.parts) - 1),
        )
        known = {**fixed, "m": mass}
        found = solve_equations(equations, law, known, near=near().values if law.nonlinear else None)
        covariance = found.covariance
        covariance[:-1, :-1] += np.outer(found.values, found.values) * (mass_error / mass) ** 2
        covariance[-1, -1] = mass_error**2
        values = np.where(np.isfinite(np.diag(covariance)[:-1]), found.values, np.nan)
        freedom = max(2 * int(good.sum()) - len(law.parameters), 1)
        return Solution(values, mass, covariance, freedom, found.misfit)

    return fitted, resonances


# ----------------------------------------------------------------------------
# A test at phase resonance where the mass is not given: stiffness over mass, and damping.
#
# k(X) = m omega^2 holds for every m, if the stiffness is proportional to it. Lags that differ by more than
# their errors determine a mass, which is identified as in other tests. Else the law is fitted with two
# assumed masses, of a lightly and of a well damped mode, and parameters that are proportional to a power of
# the mass are stated as ratios. A lag phi other than a quarter period shifts these by 2 zeta/tan(phi), an
# error that the difference of the two fits includes.

_MAX_UNSCALED_STIFFNESS = 1e-6
"""Share of the stiffness that no scaling of the parameters changes, by quadrature. A law with more of it
determines the mass by itself, as one whose damping contains its stiffness."""

_CODES_OF_MASS = frozenset({"fixed-contradicted", "resonance-sparse", "shift-small", "size-impossible"})
"""Findings that depend on the assumed mass."""

_RATIO_UNITS = {"N/m": "1/s^2", "N*s/m": "1/s"}
"""Units of ratios to the mass by units of parameters, as in the modal table."""

_POWER_RESOLUTION = 1e-3
"""Rounding of the power of the mass in a parameter."""


def identify_ratios(
    surface: ResponseSurface, model: Model, identify: Callable[[ResponseSurface, Model], Identification]
) -> Identification | None:
    """Identify ratios to the mass from points at phase resonance; None for other tests, or with fixed values.

    Parameters
    ----------
    surface, model
        Arguments of ``identify``.
    identify
        Function that identifies with a given mass.
    """
    if model.fixed:
        return None
    points = select_points(gather_repeats(surface)[0], model)
    law = law_of(model.elements, points)
    # the damping of a loop contains its stiffness, so that it determines the mass
    if law.acts_across or law.remembers or not near_resonance(points):
        return None
    if not at_resonance_alone(points, noise=0.0):
        free = identify(surface, model)
        if _determines_mass(free, points):
            return free
    masses = [assumed_mass(points, ratio) for ratio in (ASSUMED_DAMPING_RATIO, MAX_LIGHT_DAMPING_RATIO)]
    if not min(masses) > 0:
        return None
    # an assumed mass has no scale that could contradict that of the test
    scaled = replace(model, observation=replace(model.observation, calibrated=True))
    light, damped = (identify(surface, join_model(scaled, mass=mass)) for mass in masses)
    powers = _mass_powers(points, law, np.array(light.solution))
    if powers is None:
        return None
    return _RatiosToMass(surface, points, model, powers, (light, damped)).identification()


def resonance_findings(
    points: Points, fixed: Mapping[str, float], law: ForceLaw, values: Array, noise: float
) -> tuple[Finding, ...]:
    """Find that an identified mass has no good basis, because all points have the lag of resonance.

    A law with memory determines the mass by the area of its loops, a fixed stiffness by itself; otherwise the
    mass follows from errors of the lag only.
    """
    if "m" in fixed or not at_resonance_alone(points, noise):
        return ()
    numbers = quantities(points=len(points))
    if law.remembers:
        return (Finding("mass-at-resonance", "warning", "m", numbers, {"by": "loops"}),)
    powers = _mass_powers(points, law, values) if fixed else None
    if powers is not None and any(powers[law.parameters.index(name)] for name in fixed):
        return ()
    return (Finding("mass-at-resonance", "doubt", "m", numbers),)


def _determines_mass(free: Identification, points: Points) -> bool:
    """Return True if lags differ by more than noise, so that a fit with a free mass determines it."""
    if at_resonance_alone(points, free.outcome["misfit"]):
        return False
    return mass_sure(free.refined[-1].value, float(free.covariance[-1, -1]))


def _mass_powers(points: Points, law: ForceLaw, values: Array) -> Array | None:
    """Return the power (p,) of the mass in each parameter; None if the law itself determines the mass.

    The solution of a linear system along sines: change of the parameters that multiplies the stiffness by a
    factor and keeps the damping.
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
        [np.concatenate([part / s for part, s in zip(slope, scales, strict=True)]) for slope in slopes],
        axis=1,
    )
    wanted = np.concatenate([stiffness / scales[0], np.zeros(len(size)), mean / scales[2]])
    if not np.isfinite(matrix).all():
        return None
    change, _, _ = solve_scaled(matrix, wanted)
    left = np.linalg.norm(wanted - matrix @ change) / np.linalg.norm(wanted)
    if not left < _MAX_UNSCALED_STIFFNESS:
        return None
    used = np.linalg.norm(matrix, axis=0) * np.abs(change) > _MAX_UNSCALED_STIFFNESS
    powers = np.where(used, change / np.where(values != 0, values, 1.0), 0.0)
    return np.asarray(np.round(powers / _POWER_RESOLUTION) * _POWER_RESOLUTION)


@dataclass(frozen=True, slots=True, eq=False)
class _RatiosToMass:
    """Identifications with two assumed masses, and the powers of the mass in the parameters.

    Parameters
    ----------
    surface, points, model
        The test, its fitted points, and the model, which has no mass.
    powers
        (p,) power of the mass in each parameter.
    pair
        Identifications with the masses of a lightly and of a well damped mode.
    """

    surface: ResponseSurface
    points: Points
    model: Model
    powers: Array
    pair: tuple[Identification, Identification]

    def identification(self) -> Identification:
        """Return the identification with NaN for all values that need a mass."""
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
        rest = [f for f in light.findings if id(f) not in before and f.code not in _CODES_OF_MASS]
        sizes = plausibility_findings(self.surface, calibrated=self.model.observation.calibrated)
        rest += [finding for finding in sizes if finding.code in _CODES_OF_MASS]
        if not self.model.observation.calibrated:
            rest.append(Finding("not-calibrated", "info"))
        elif any(f.code == "needs-mass" and "ratio" in f.numbers for f in of_parameters):
            # the damping is known: a bound on the damping ratio is one on the mass
            least = {"least": Quantity(self.pair[1].mass, "kg"), "damping": Quantity(MAX_LIGHT_DAMPING_RATIO)}
            rest.append(Finding("ratios-hold-from", "warning", numbers=least))
        resonances = tuple(
            replace(r, stiffness=float("nan"), damping_ratio=float("nan")) for r in light.resonances
        )
        count = sum(estimate.identifiable for estimate in refined)
        numbers = {**light.outcome.numbers, **quantities(identified=count, parameters=len(refined))}
        return replace(
            light,
            model=self.model,
            paper=later(lambda: self._without_mass(light.paper)),
            first_order=later(lambda: self._without_mass(light.first_order)),
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

    def _without_mass(self, estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
        """Return the estimates of another method, NaN where they depend on the assumed mass."""
        kept = [
            _unknown(e.name, e.unit, None) if power else e
            for e, power in zip(estimates, self.powers, strict=True)
        ]
        return (*kept, self._mass())

    def _estimate(self, i: int) -> Estimate:
        """Return a parameter: its value if it does not depend on the mass, else a finding with the ratio."""
        light, damped = (found.refined[i] for found in self.pair)
        if not (np.isfinite(light.value) and np.isfinite(damped.value)):
            return light
        power = float(self.powers[i])
        scales = [(found.mass**-power) for found in self.pair]
        value, other = light.value * scales[0], damped.value * scales[1]
        halves = [np.ptp(e.interval) / 2 * scale for e, scale in zip((light, damped), scales, strict=True)]
        half = float(np.hypot(max(halves), other - value))
        error = half * light.standard_error * scales[0] / halves[0] if halves[0] > 0 else half
        name, unit = f"{light.name}/m", _RATIO_UNITS.get(light.unit, per_mass_unit(light.unit))
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
                "damping": Quantity(MAX_LIGHT_DAMPING_RATIO),
            }
            finding = Finding("needs-mass", "warning", light.name, numbers)
        return _unknown(light.name, light.unit, finding or Finding("needs-mass", "warning", light.name))


def _unknown(name: str, unit: str, finding: Finding | None) -> Estimate:
    return Estimate(name, float("nan"), float("inf"), (float("-inf"), float("inf")), unit, finding)
