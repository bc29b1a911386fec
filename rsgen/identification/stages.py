"""The stages of an identification in their order: start, refined, first order, the paper's, warnings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from rsgen.errors import RsgenError
from rsgen.identification.balance_fit import FittedModel, fit_balance
from rsgen.identification.dynamic_stiffness import (
    Equations,
    LinearSolution,
    point_misfit,
    solve_equations,
)
from rsgen.identification.force_law import ForceLaw, compile_law
from rsgen.identification.identifiability import find_warnings, untold_reason
from rsgen.identification.inversion import invert_curve
from rsgen.identification.magnitude import with_phase
from rsgen.identification.measured_mode import fit_among_modes, fit_amplitudes, with_repeats
from rsgen.identification.output_error import fit_output
from rsgen.identification.points import Points, select_points
from rsgen.identification.repeats import gather_repeats
from rsgen.identification.resonance import find_resonances, mass_from_slices
from rsgen.identification.result import (
    EquivalentCurve,
    Estimate,
    Identification,
    Resonance,
    RestoringForce,
)
from rsgen.identification.waveform_inversion import invert_motion
from rsgen.oscillator import Model
from rsgen.surface import ResponseSurface
from rsgen.units import parameter_units

__all__ = ["identify"]

Array = NDArray[np.float64]

_ORDERS = (9, 15, 23)
"""Harmonics carried in the balance, raised until the last one no longer matters."""

_QUICK = 400
"""Points that suffice to come near the estimate; all points then need one or two steps more."""

_TAIL = 1e-9
"""Relative size at which the last harmonic no longer matters in exact data."""

_ACCURACIES = (1e-5, 1e-8)
"""Of the simulator inside the fit: the finer one where the misfit turns out to be as small as the coarser."""

_EXACT = 1e-5
"""Misfit below which a truncated waveform shows wherever a law has a switch, be it as soft as x|x|."""

_LEFT = 1e-7
_NOISY = 1e-4
"""A misfit between these is neither noise nor the simulator's accuracy: some points were not followed."""

_RESOLVED = 100.0
"""A misfit so many times the simulator's accuracy is not the simulator's."""

_WORSE = 1.05
"""The simulator may not fit worse than the balance; if it does, it follows other branches."""

_FOLLOWED = 0.9
"""Share of the points that the simulator must be able to follow; where it is not, the law is wrong."""

_GROSS = 5.0
"""Starting values give less weight to points that disagree by more than so many typical misfits."""

_TYPICAL = 0.04
"""Relative misfit of starting values that is never called gross: first order may be as wrong."""


_CENTRED = 0.01
"""Mean of the motion, relative to its amplitude, beyond which k(X) does not give the force by itself."""


_QUIET = 5e-4
"""Noise beyond which the measured harmonics are too rough for a force along an uneven motion."""

_UNEVEN = 0.2
"""Mean or second harmonic, relative to the fundamental, that a centred motion does not have."""

_SOME = 3
"""So many points are no accident."""


@dataclass(frozen=True, slots=True, eq=False)
class _Values:
    """Values with covariance: the parameters of the law in order, then the mass where it is free."""

    values: Array
    mass: float
    covariance: Array
    freedom: int


def identify(surface: ResponseSurface, model: Model) -> Identification:
    """Identify every parameter of the model's laws, and the mass where it is not given.

    Parameters
    ----------
    surface
        Settled points of any test; unsettled and held-out ones are left aside.
    model
        Laws without values.

    Returns
    -------
    Identification
        A parameter that the test does not tell is NaN with a sentence, never an exception.

    Raises
    ------
    RsgenError
        A held-out level is not in the surface, or fewer than four points can be used.
    """
    surface, repeats = gather_repeats(surface)
    points = select_points(surface, model)
    law = compile_law(model.force)
    if law.odd and _leaves_the_middle(points):
        # an odd law has motions that are not: in one well of two, or after the symmetry breaks
        law = replace(law, odd=False)
    background, caused = None, None
    sharp = law.rough or _is_strong(points)
    if not surface.phase_known:
        refined, background, caused = fit_amplitudes(points, law, model, repeats)
        besides = background.values
        surface = with_phase(surface, law, refined, background.shape(surface.omega), besides)
        points = with_phase(points, law, refined, background.shape(points.omega), besides)
    elif model.background == "none":
        refined, sharp = _refined(points, law, _start(points, law, model.mass), model.mass)
    else:
        refined, background, caused = fit_among_modes(points, law, model, repeats, _start)
    if background is not None:
        points = background.shape(points.omega).subtract(points, background.values)
        surface = background.shape(surface.omega).subtract(surface, background.values)
    fitted = refined
    # the simulator is compared in phase, too
    if sharp and surface.phase_known:
        refined = _polished(points, model, law, refined)
        if not law.rough and _LEFT < refined.regression.noise < _NOISY:
            refined = _enriched(points, law, refined, model.mass)
    used = refined.regression.used
    kept = points.select(used)
    first = _fit(kept, law, refined.values, refined.mass, model.mass, 1, reject=False)
    bias = _first_order_bias(kept, law, refined, first, model.mass)
    paper, resonances = _paper(kept, law, model.mass, first)
    # the expected noise has unit size in real and imaginary part each
    noise = misfit_noise = refined.regression.noise * np.sqrt(2)
    covariance = refined.regression.covariance
    notes: tuple[str, ...] = ()
    if repeats is not None:
        noise = repeats.noise
        if background is None or refined is not fitted:
            covariance = with_repeats(refined.regression, points, repeats).covariance
        spread = refined.regression.noise * np.sqrt(np.sum(refined.regression.influence**2, axis=(0, 1)))
        notes = (repeats.judge(misfit_noise, float(np.nanmedian(spread / np.sqrt(np.diag(covariance))))),)
    if caused is not None and refined is not fitted:
        # the simulator was fitted beside a background that stood still
        covariance = covariance + caused
    covariance = covariance * (1 + (_own_error(surface, points, used) / noise) ** 2)
    told = replace(refined.regression, covariance=covariance)
    reasons = {
        name: untold_reason(name, law, points, told, model.mass is None) for name in _names(law, model)
    }
    estimates = _estimates(replace(_of_fit(refined), covariance=covariance), law, model, reasons)
    curve = _curve(surface, points, used, refined.mass)
    misfit = refined.regression.misfit[refined.regression.used]
    return Identification(
        model=model,
        paper=_estimates(paper, law, model, {}),
        first_order=_estimates(_of_fit(first), law, model, reasons),
        refined=estimates,
        first_order_bias=tuple(float(value) for value in bias),
        covariance=covariance,
        resonances=resonances,
        curve=curve,
        restoring=_without_law(kept, curve, refined.mass, float(noise)),
        residual=float(np.sqrt(np.mean(misfit**2))) if len(misfit) else float("nan"),
        noise=float(noise),
        levels=_force_levels(surface, points, resonances),
        amplitude_range=(float(kept.amplitude.min()), float(kept.amplitude.max())),
        frequency_range=(float(kept.omega.min() / 2 / np.pi), float(kept.omega.max() / 2 / np.pi)),
        outcome=_outcome(surface, points, used, estimates, float(misfit_noise)),
        solution=refined.values,
        background=background if model.background != "none" else None,
        warnings=(
            *notes,
            *find_warnings(
                surface,
                points,
                used,
                law,
                refined,
                resonances,
                estimates,
                calibrated=model.calibrated,
                background=model.background,
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


def _leaves_the_middle(points: Points) -> bool:
    """Tell whether some motions have a mean or a second harmonic that no noise explains."""
    even = np.abs(points.harmonics[:, 0:3:2]).max(axis=1) / points.amplitude
    return int(np.count_nonzero(even > _UNEVEN)) >= _SOME


def _without_law(points: Points, curve: EquivalentCurve, mass: float, noise: float) -> RestoringForce | None:
    """Draw the forces from k(X) and c(X), or along the motion where an uneven one is known well enough."""
    if _is_centred(points):
        return invert_curve(curve, mass)
    return invert_motion(points, mass, noise) if noise < _QUIET else None


def _is_centred(points: Points) -> bool:
    """Tell whether the motion stays about zero, where alone a force follows from k(X) without a law."""
    mean = np.abs(points.harmonics[:, 0]) / points.amplitude
    return 0 not in points.measured or float(np.sqrt(np.mean(mean**2))) < _CENTRED


def _names(law: ForceLaw, model: Model) -> tuple[str, ...]:
    return (*law.parameters, "m") if model.mass is None else law.parameters


def _start(points: Points, law: ForceLaw, mass: float | None) -> LinearSolution:
    """Values to start from: first order, or the measured waveform where that fits better."""
    some = points.select(points.spread(2 * _QUICK))
    first = _linear_start(some, law, mass, 1)
    if not _is_strong(points):
        return first
    # in the balance of the fundamental along the measured waveform a law is as linear as it is written
    whole = _linear_start(some, law, mass, points.harmonics.shape[1] - 1)
    return whole if whole.misfit < first.misfit else first


def _is_strong(points: Points) -> bool:
    """Tell whether some motions are so far from a sine that a balance of few harmonics may miss them."""
    higher = np.abs(points.harmonics[:, 2:]).max(axis=1, initial=0.0) / points.amplitude
    return int(np.count_nonzero(higher > _UNEVEN)) >= _SOME


def _linear_start(points: Points, law: ForceLaw, mass: float | None, order: int) -> LinearSolution:
    """All points, gross outliers with less weight, up to a harmonic of the measured waveform."""
    equations = Equations(
        points.omega,
        points.force,
        points.harmonics[:, : order + 1],
        not law.odd and 0 in points.measured,
        1 / np.abs(points.force),
        np.zeros((0, 2)),
    )
    weight = equations.weight
    for _ in range(3):
        solution = solve_equations(equations, law, mass)
        misfit = point_misfit(replace(equations, weight=weight), law, solution)
        typical = max(1.4826 * float(np.median(misfit)), _TYPICAL)
        factor = 1 / np.maximum(1.0, misfit / (_GROSS * typical)) ** 2
        if np.count_nonzero(factor < 0.25) <= 0.002 * len(points):
            break
        equations = replace(equations, weight=weight * factor)
    return solution


def _fit(
    points: Points,
    law: ForceLaw,
    values: Array,
    mass: float,
    given: float | None,
    order: int,
    *,
    reject: bool,
    steps: int = 25,
) -> FittedModel:
    free = given is None
    return fit_balance(points, law, values, mass, mass_free=free, order=order, reject=reject, steps=steps)


def _refined(
    points: Points, law: ForceLaw, start: LinearSolution, given: float | None
) -> tuple[FittedModel, bool]:
    """All harmonics that matter, and whether only the simulator has all of them."""
    values, mass = start.values, start.mass
    few = points.select(points.spread(_QUICK)) if len(points) > 2 * _QUICK else points
    sharp = law.rough or _is_strong(points)
    for order in _ORDERS:
        refined = _fit(few, law, values, mass, given, order, reject=True)
        values, mass = refined.values, refined.mass
        harmonics = np.abs(refined.harmonics[refined.regression.used])
        last = float(np.max(harmonics[:, -2:] / harmonics[:, 1:2], initial=0.0))
        enough = last < max(_TAIL, 1e-3 * refined.regression.noise / np.sqrt(len(points)))
        if law.switched or sharp or enough:
            break
    sharp = sharp or (law.switched and refined.regression.noise < _EXACT)
    if few is points:
        return refined, sharp
    # what the simulator takes up needs no more than one step
    return _fit(points, law, values, mass, given, order, reject=True, steps=1 if sharp else 25), sharp


def _polished(points: Points, model: Model, law: ForceLaw, balanced: FittedModel) -> FittedModel:
    """Replace the balance by the simulator where the law has jumps or corners."""
    start, accuracy = balanced, _ACCURACIES[0]
    few = points.spread(_QUICK)
    quick = fit_output(points.select(few), model, law, balanced.select(few), accuracy=accuracy)
    if quick is not None:
        near = replace(balanced.regression, parameters=quick.regression.parameters)
        start = replace(balanced, regression=replace(near, noise=quick.regression.noise))
        if quick.regression.noise < _RESOLVED * accuracy:
            accuracy = _ACCURACIES[1]
    whole = len(few) == len(points) and accuracy == _ACCURACIES[0]
    polished = quick if whole else fit_output(points, model, law, start, accuracy=accuracy)
    followed = np.count_nonzero(polished.regression.used) if polished is not None else 0
    if polished is None or followed < _FOLLOWED * np.count_nonzero(balanced.regression.used):
        return balanced
    both = polished.regression.used & balanced.regression.used
    misfit = [float(np.sqrt(np.mean(found.regression.misfit[both] ** 2))) for found in (polished, balanced)]
    return polished if misfit[0] <= _WORSE * misfit[1] else balanced


def _enriched(points: Points, law: ForceLaw, followed: FittedModel, given: float | None) -> FittedModel:
    """Try more harmonics where the simulator did not settle on every branch of exact data."""
    balanced = followed
    for order in _ORDERS[1:]:
        balanced = _fit(points, law, balanced.values, balanced.mass, given, order, reject=True)
    return min(followed, balanced, key=lambda found: found.regression.noise)


def _of_fit(found: FittedModel) -> _Values:
    return _Values(found.values, found.mass, found.regression.covariance, found.regression.freedom)


def _first_order_bias(
    points: Points, law: ForceLaw, refined: FittedModel, first: FittedModel, given: float | None
) -> Array:
    """What the first-order fit makes of the refined model's own, noise-free response."""
    used = refined.regression.used
    turn = np.exp(1j * refined.turn[used])
    count = points.harmonics.shape[1]
    predicted = refined.harmonics[used]
    harmonics = np.zeros((len(points), max(count, predicted.shape[1])), dtype=complex)
    harmonics[:, : predicted.shape[1]] = predicted * turn[:, None] ** np.arange(predicted.shape[1])
    if not np.isfinite(harmonics).all():
        return np.full(len(refined.regression.parameters), np.nan)
    exact = replace(points, force=refined.force[used] * turn, harmonics=harmonics[:, :count])
    exact = exact.select(exact.spread(2 * _QUICK))
    again = _fit(exact, law, first.values, first.mass, given, 1, reject=False)
    return np.asarray(again.regression.parameters - refined.regression.parameters)


def _paper(
    points: Points, law: ForceLaw, given: float | None, near: FittedModel
) -> tuple[_Values, tuple[Resonance, ...]]:
    """Resonance of every level, then k(X) and c(X) fitted with the describing functions of the law."""
    mass, mass_error = (given, 0.0) if given is not None else (mass_from_slices(points) or (np.nan, np.nan))
    resonances, turning = find_resonances(points, mass if np.isfinite(mass) else near.mass)
    count = len(law.parameters) + (given is None)
    if not np.isfinite(mass) or not resonances:
        return _Values(
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
        return _Values(
            np.full(len(law.parameters), np.nan), mass, np.full((count, count), np.nan), 1
        ), resonances
    found = solve_equations(equations, law, mass, near=near.values)
    covariance = found.covariance + np.outer(found.values, found.values) * (mass_error / mass) ** 2
    values = np.where(np.isfinite(np.diag(covariance)), found.values, np.nan)
    if given is None:
        covariance = np.pad(covariance, (0, 1))
        covariance[-1, -1] = mass_error**2
    return _Values(values, mass, covariance, max(2 * int(good.sum()) - len(law.parameters), 1)), resonances


def _estimates(found: _Values, law: ForceLaw, model: Model, reasons: dict[str, str]) -> tuple[Estimate, ...]:
    values = np.append(found.values, found.mass) if model.mass is None else found.values
    names = _names(law, model)
    variance = np.diag(found.covariance)
    wide = float(stdtrit(found.freedom, 0.975))
    units = _units(model)
    estimates = []
    for name, value, var in zip(names, values, variance, strict=True):
        told = bool(np.isfinite(var) and np.isfinite(value))
        # round-off is the least error a value can have
        error = float(max(np.sqrt(max(var, 0.0)), 1e-16 * abs(value))) if told else float("inf")
        centre = float(value) if told else float("nan")
        interval = (centre - wide * error, centre + wide * error) if told else (float("-inf"), float("inf"))
        remark = reasons.get(name, "")
        if not told and not remark:
            remark = f"{name}: not told by the points that this method uses"
        estimates.append(Estimate(name, centre, error, interval, units[name], remark))
    return tuple(estimates)


def _units(model: Model) -> dict[str, str]:
    """SI unit of every parameter, "" where the law does not say."""
    try:
        units = parameter_units(model.force)
    except RsgenError:
        # a law whose terms do not agree in units can be fitted all the same
        units = dict.fromkeys(model.parameters, "")
    return {"m": "kg", **units}


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
) -> str:
    told = sum(estimate.told for estimate in estimates)
    levels = len(np.unique(points.level))
    return (
        f"{told} of {len(estimates)} parameters identified from {int(used.sum())} of {len(surface)} points "
        f"at {levels} {'level' if levels == 1 else 'levels'}; force and response agree with the law within "
        f"{100 * noise:.2g} % of their size"
    )
