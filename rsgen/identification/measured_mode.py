"""The refined stage where a mode was measured among others, without phase, or again and again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from rsgen.identification.background import shape_of
from rsgen.identification.background_fit import begin_background, fit_with_background, split_off
from rsgen.identification.balance_fit import FittedModel
from rsgen.identification.data import Points
from rsgen.identification.dynamic_stiffness import LinearSolution
from rsgen.identification.least_squares import Regression
from rsgen.identification.magnitude import fit_magnitude, start_magnitude
from rsgen.identification.repeats import Repeats
from rsgen.identification.result import Background, Estimate
from rsgen.law.numeric import ForceLaw
from rsgen.oscillator import Model

__all__ = ["fit_among_modes", "fit_amplitudes", "with_repeats"]

Array = NDArray[np.float64]

_ORDER = 9
"""Harmonics carried in the balance."""

_QUICK = 400
"""Points that suffice to come near the estimate."""


def fit_amplitudes(
    points: Points, law: ForceLaw, model: Model, repeats: Repeats | None
) -> tuple[FittedModel, Background, Array]:
    """Fit amplitudes alone, where the phase was not recorded."""
    band = _band(points)
    kind = "phase" if model.observation.background == "none" else model.observation.background
    shape = shape_of(kind, points.omega, band)
    start = start_magnitude(points, law, model.mass)
    refined, values = fit_magnitude(
        points, law, start.values, start.mass, shape, mass_free=model.mass is None
    )
    return _part(points, law, model, repeats, refined, values, kind, band)


def with_repeats(regression: Regression, points: Points, repeats: Repeats | None) -> Regression:
    """Give a regression the covariance that repeats show, where there are any."""
    if repeats is None:
        return regression
    covariance = repeats.covariance(points.index, regression.influence)
    covariance[np.isnan(regression.covariance)] = np.nan
    return replace(regression, covariance=covariance)


def fit_among_modes(
    points: Points,
    law: ForceLaw,
    model: Model,
    repeats: Repeats | None,
    start: Callable[[Points, ForceLaw, float | None], LinearSolution],
) -> tuple[FittedModel, Background, Array]:
    """Fit law and background together; also the part of the law's covariance that the background causes."""
    band = _band(points)
    kind, given = model.observation.background, model.mass
    values = begin_background(points, kind, band, given)
    begun = start(shape_of(kind, points.omega, band).subtract(points, values), law, given)
    few = points.select(points.spread(_QUICK)) if len(points) > 2 * _QUICK else points
    law_values, mass = begun.values, begun.mass
    for part in (few, points) if few is not points else (points,):
        shape = shape_of(kind, part.omega, band)
        refined, values = fit_with_background(
            part, law, law_values, mass, shape, values, mass_free=given is None, order=_ORDER
        )
        law_values, mass = refined.values, refined.mass
    return _part(points, law, model, repeats, refined, values, kind, band)


def _band(points: Points) -> tuple[float, float]:
    frequency = points.omega / (2 * np.pi)
    return float(frequency.min()), float(frequency.max())


def _part(
    points: Points,
    law: ForceLaw,
    model: Model,
    repeats: Repeats | None,
    refined: FittedModel,
    values: Array,
    kind: str,
    band: tuple[float, float],
) -> tuple[FittedModel, Background, Array]:
    """Part a fit into the mode, the background with its errors, and what that adds to the mode's errors."""
    shape = shape_of(kind, points.omega, band)
    known = with_repeats(refined.regression, points, repeats)
    regression, covariance, caused = split_off(known, len(law.parameters) + (model.mass is None))
    wide = float(stdtrit(regression.freedom, 0.975))
    errors = np.sqrt(np.where(np.isfinite(np.diag(covariance)), np.diag(covariance), np.inf))
    estimates = tuple(
        Estimate(name, float(v), float(e), (float(v - wide * e), float(v + wide * e)), unit)
        for name, v, e, unit in zip(shape.names, values, errors, shape.units, strict=True)
    )
    besides = np.abs(shape.receptance(values) * points.force)
    share = float(np.sqrt(np.mean(besides**2) / np.mean(points.amplitude**2)))
    return replace(refined, regression=regression), Background(kind, band, estimates, share), caused
