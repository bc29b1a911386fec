"""The stages of an identification in their order: start, refined, first order, the paper's, warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from rsgen.finding import Finding, quantities
from rsgen.identification.abel import invert_curve
from rsgen.identification.data import Points, select_points
from rsgen.identification.dynamic_stiffness import Equations, solve_equations
from rsgen.identification.estimates import Values, make_estimates, names_of, of_fit, units_of
from rsgen.identification.findings import Findings, parameter_finding, repeat_findings
from rsgen.identification.fit import Fit, Problem, fit_balance
from rsgen.identification.least_squares import Regression
from rsgen.identification.observed import Observed, shape_of
from rsgen.identification.refinement import add_harmonics, refine, refit_with_simulator
from rsgen.identification.repeats import gather_repeats, with_repeats
from rsgen.identification.resonance import find_resonances, mass_from_slices
from rsgen.identification.result import (
    Background,
    EquivalentCurve,
    Estimate,
    Identification,
    Resonance,
    RestoringForce,
)
from rsgen.identification.spline_force import invert_motion
from rsgen.identification.start import QUICK, is_asymmetric, start_fit, with_phase
from rsgen.law import LawLike
from rsgen.law.numeric import ForceLaw, compile_law
from rsgen.observation import Observation
from rsgen.oscillator import Model
from rsgen.surface import ResponseSurface

__all__ = ["identify"]

Array = NDArray[np.float64]
Table = TypeVar("Table", Points, ResponseSurface)

_LEFT = 1e-7
_NOISY = 1e-4
"""A misfit between these is neither noise nor the simulator's accuracy: some points were not followed."""

_CENTRED = 0.01
"""Mean of the motion, relative to its amplitude, beyond which k(X) does not give the force by itself."""


def identify(
    surface: ResponseSurface,
    law: Model | LawLike | Sequence[LawLike],
    observation: Observation | None = None,
    *,
    mass: float | None = None,
) -> Identification:
    """Identify every parameter of a law, and the mass where it is not given.

    Parameters
    ----------
    surface
        Settled points of any test; unsettled and held-out ones are left aside.
    law
        Without values: a formula, an element, a law, a sequence of these, or a model.
    observation
        How the structure was observed; None: as the model says.
    mass
        m [kg] where it is known; None: as the model says, and to be identified where that says nothing.

    Returns
    -------
    Identification
        A parameter that the test does not tell is NaN with a sentence, never an exception.

    Raises
    ------
    RsgenError
        A held-out level is not in the surface, or fewer than four points can be used.
    """
    model = _model_of(law, observation, mass)
    return _identify(surface, model)


def _model_of(
    law: Model | LawLike | Sequence[LawLike], observation: Observation | None, mass: float | None
) -> Model:
    """Join law, mass and observation; what is given explicitly wins over the model's."""
    model = law if isinstance(law, Model) else Model(law)
    return replace(
        model,
        mass=model.mass if mass is None else mass,
        observation=model.observation if observation is None else observation,
    )


def _identify(surface: ResponseSurface, model: Model) -> Identification:
    surface, repeats = gather_repeats(surface)
    points = select_points(surface, model)
    law = compile_law(model.force)
    if law.odd and is_asymmetric(points):
        # an odd law has motions that are not: in one well of two, or after the symmetry breaks
        law = replace(law, odd=False)
    kind = model.observation.background
    observed = Observed.of(points, kind, phase_known=surface.phase_known)
    problem = Problem(model.elements, law, observed, model.mass)
    refined, sharp = refine(problem, start_fit(problem))
    if sharp:
        refined = refit_with_simulator(refined)
        if not law.rough and _LEFT < refined.regression.noise < _NOISY:
            refined = add_harmonics(refined)
    whole = with_repeats(refined.regression, points, repeats)
    background = _background(refined, whole, kind)
    surface, points = _mode(surface, refined), _mode(points, refined)
    used = refined.regression.used
    kept = points.select(used)
    first = _first_order(kept, problem, refined.values, refined.mass)
    bias = _first_order_bias(kept, refined, first)
    paper, resonances = _paper(kept, law, model.mass, first)
    # the expected noise has unit size in real and imaginary part each
    noise = misfit_noise = refined.regression.noise * np.sqrt(2)
    regression = whole.first(problem.count)
    about: tuple[Finding, ...] = ()
    if repeats is not None:
        noise = repeats.noise
        spread = refined.regression.noise * np.sqrt(np.sum(regression.influence**2, axis=(0, 1)))
        wider = float(np.nanmedian(spread / np.sqrt(np.diag(regression.covariance))))
        about = repeat_findings(repeats, misfit_noise, wider)
    covariance = regression.covariance * (1 + (_own_error(surface, points, used) / noise) ** 2)
    regression = replace(regression, covariance=covariance)
    names, units = names_of(law, model), units_of(model)
    reasons = {
        name: parameter_finding(name, names, units[name], points, surface.level_unit, regression)
        for name in names
    }
    estimates = make_estimates(replace(of_fit(refined), covariance=covariance), law, model, reasons)
    curve = _curve(surface, points, used, refined.mass)
    mass = refined.mass if model.mass is not None or estimates[-1].identifiable else None
    misfit = refined.regression.misfit[refined.regression.used]
    return Identification(
        model=model,
        paper=make_estimates(paper, law, model, {}),
        first_order=make_estimates(of_fit(first), law, model, reasons),
        refined=estimates,
        first_order_bias=tuple(float(value) for value in bias),
        covariance=covariance,
        resonances=resonances,
        curve=curve,
        restoring=_without_law(kept, curve, mass, float(noise)),
        residual=float(np.sqrt(np.mean(misfit**2))) if len(misfit) else float("nan"),
        noise=float(noise),
        levels=_force_levels(surface, points, resonances),
        amplitude_range=(float(kept.amplitude.min()), float(kept.amplitude.max())),
        frequency_range=(float(kept.omega.min() / 2 / np.pi), float(kept.omega.max() / 2 / np.pi)),
        outcome=_outcome(surface, points, used, estimates, float(misfit_noise)),
        solution=refined.values,
        background=background,
        findings=(
            *about,
            *Findings(surface, points, refined, resonances).collect(
                tuple(e.finding for e in estimates if e.finding is not None),
                calibrated=model.observation.calibrated,
            ),
        ),
    )


def _own_error(surface: ResponseSurface, points: Points, used: NDArray[np.bool_]) -> float:
    """Relative error that a surface reports of itself: neighbours share it, scatter does not show it."""
    error = surface.error[points.index[used]]
    told = np.isfinite(error)
    return float(np.sqrt(np.mean(error[told] ** 2))) if told.any() else 0.0


def _force_levels(surface: ResponseSurface, points: Points, resonances: tuple[Resonance, ...]) -> Array:
    """Levels of force: as tested, or, where the amplitude was held, what a resonance needed."""
    if surface.control == "force":
        return np.unique(points.level)
    needed = [abs(r.damping) * 2 * np.pi * r.frequency * r.amplitude for r in resonances]
    return np.unique(needed) if needed else np.quantile(np.abs(points.force), [0.1, 0.5, 0.9])


def _without_law(
    points: Points, curve: EquivalentCurve, mass: float | None, noise: float
) -> RestoringForce | None:
    """Draw the forces from k(X) and c(X), or along the motion where that leaves the middle."""
    if mass is None:
        return None
    if _is_centred(points):
        return invert_curve(curve, mass)
    return invert_motion(points, mass, noise)


def _is_centred(points: Points) -> bool:
    """Tell whether the motion stays about zero, where alone a force follows from k(X) without a law."""
    mean = np.abs(points.harmonics[:, 0]) / points.amplitude
    return 0 not in points.measured or float(np.sqrt(np.mean(mean**2))) < _CENTRED


def _mode(table: Table, found: Fit) -> Table:
    """Subtract the background; phases that were not recorded are those that the fit predicts."""
    observed = found.problem.observed
    shape = shape_of(observed.kind, table.omega, observed.band)
    if not observed.phase_known:
        table = with_phase(table, found, shape)
    return shape.subtract(table, found.background)


def _background(found: Fit, regression: Regression, kind: str) -> Background | None:
    """Background with the errors of its values; None where none was asked for."""
    observed = found.problem.observed
    shape, values = observed.background, found.background
    if not len(values):
        return None
    variance = np.diag(regression.covariance)[found.problem.count :]
    wide = float(stdtrit(regression.freedom, 0.975))
    errors = np.sqrt(np.where(np.isfinite(variance), variance, np.inf))
    estimates = tuple(
        Estimate(name, float(v), float(e), (float(v - wide * e), float(v + wide * e)), unit)
        for name, v, e, unit in zip(shape.names, values, errors, shape.units, strict=True)
    )
    points = observed.points
    part = np.abs(shape.receptance(values) * points.force)
    share = float(np.sqrt(np.mean(part**2) / np.mean(points.amplitude**2)))
    return Background(kind, observed.band, estimates, share)


def _first_order(points: Points, problem: Problem, values: Array, mass: float) -> Fit:
    """Fit one harmonic to the points of the mode, from values near the solution."""
    mode = replace(problem, observed=Observed.of(points))
    return fit_balance(mode, mode.join(values, mass), order=1, reject=False)


def _first_order_bias(points: Points, refined: Fit, first: Fit) -> Array:
    """What the first-order fit makes of the noise-free response of the refined model."""
    used = refined.regression.used
    count = points.harmonics.shape[1]
    predicted = refined.motion.harmonics[used]
    harmonics = np.zeros((len(points), max(count, predicted.shape[1])), dtype=complex)
    harmonics[:, : predicted.shape[1]] = predicted
    if not np.isfinite(harmonics).all():
        return np.full(first.problem.count, np.nan)
    force = (refined.force * np.exp(1j * refined.turn))[used]
    exact = replace(points, force=force, harmonics=harmonics[:, :count])
    exact = exact.select(exact.spread(2 * QUICK))
    again = _first_order(exact, first.problem, first.values, first.mass)
    return again.regression.parameters - refined.regression.parameters[: first.problem.count]


def _paper(
    points: Points, law: ForceLaw, given: float | None, near: Fit
) -> tuple[Values, tuple[Resonance, ...]]:
    """Resonance of every level, then k(X) and c(X) fitted with the describing functions of the law."""
    mass, mass_error = (given, 0.0) if given is not None else (mass_from_slices(points) or (np.nan, np.nan))
    resonances, turning = find_resonances(points, mass if np.isfinite(mass) else near.mass)
    count = len(law.parameters) + (given is None)
    if not np.isfinite(mass) or not resonances:
        return Values(
            np.full(len(law.parameters), np.nan), mass, np.full((count, count), np.nan), 1
        ), resonances
    omega = 2 * np.pi * np.array([r.frequency for r in resonances])
    size = np.array([r.amplitude for r in resonances])
    force = omega * np.array([r.damping for r in resonances]) * size
    good = force > 0
    equations = Equations(
        omega[good],
        1j * force[good],
        np.stack([np.zeros(good.sum()), size[good]], axis=1).astype(complex),
        False,
        1 / force[good],
        turning[good] if not law.odd else np.zeros((0, 2)),
    )
    if not good.any():
        return Values(
            np.full(len(law.parameters), np.nan), mass, np.full((count, count), np.nan), 1
        ), resonances
    found = solve_equations(equations, law, mass, near=near.values)
    covariance = found.covariance + np.outer(found.values, found.values) * (mass_error / mass) ** 2
    values = np.where(np.isfinite(np.diag(covariance)), found.values, np.nan)
    if given is None:
        covariance = np.pad(covariance, (0, 1))
        covariance[-1, -1] = mass_error**2
    return Values(values, mass, covariance, max(2 * int(good.sum()) - len(law.parameters), 1)), resonances


def _curve(surface: ResponseSurface, points: Points, used: NDArray[np.bool_], mass: float) -> EquivalentCurve:
    response = surface.harmonics[:, 1]
    rows = np.flatnonzero(surface.settled & np.isfinite(response) & (np.abs(response) > 0))
    stiffness = surface.force[rows] / response[rows]
    omega = surface.omega[rows]
    took_part = np.zeros(len(surface), dtype=bool)
    took_part[points.index[used]] = True
    return EquivalentCurve(
        amplitude=np.abs(response[rows]),
        frequency=surface.frequency[rows],
        level=surface.level[rows],
        stiffness=stiffness.real + mass * omega**2,
        damping=stiffness.imag / omega,
        used=took_part[rows],
        level_unit=surface.level_unit,
    )


def _outcome(
    surface: ResponseSurface,
    points: Points,
    used: NDArray[np.bool_],
    estimates: tuple[Estimate, ...],
    noise: float,
) -> Finding:
    numbers = quantities(
        identified=sum(estimate.identifiable for estimate in estimates),
        parameters=len(estimates),
        used=int(used.sum()),
        points=len(surface),
        levels=len(np.unique(points.level)),
        misfit=noise,
    )
    return Finding("identified", "info", numbers=numbers)
