"""Fit of the balance together with a background: what the sensor sees is the mode plus b(omega) F.

Force and response carry the noise, each relative to its own size, as in ``balance_fit``; so a background that
swallows the mode gains nothing. The law's parameters get standard errors that allow for the background's.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.background import Shape, shape_of
from rsgen.identification.balance_fit import FittedModel, slaved_harmonics, split_rows
from rsgen.identification.data import Points
from rsgen.identification.dynamic_stiffness import Equations, LinearSolution, solve_equations
from rsgen.identification.least_squares import Linearisation, Regression, fit
from rsgen.identification.waveform import Balance, HeldAmplitude
from rsgen.law.element import make_element
from rsgen.law.numeric import ForceLaw, compile_law

__all__ = ["begin_background", "fit_with_background", "split_off"]

Array = NDArray[np.float64]

_SAMPLES_SMOOTH = 64
_SAMPLES_SWITCHED = 256

_PLAIN = "k*x + k3*x**3 + k5*x**5 + c*v + c3*v**3 + c5*v**5"
"""Any law at one harmonic, roughly: enough to find phase error and background before the law is tried."""

_PLACES = 12
_BRIEF = 12
_SHARE = 0.3
_TYPICAL_DAMPING = 0.01
"""A neighbour is sought with this damping ratio, in so many places, in so few steps
each, and with this share of the mode's own residue."""

_NOISY = 1e-4
"""Misfit above which it is noise, not the truncated waveform."""

_TURNS = 12
"""Phase errors tried all around the circle."""

_SCANNED = 80
_FEW = 400


def begin_background(points: Points, kind: str, band: tuple[float, float], mass: float | None) -> Array:
    """Find phase error and background to start from, with a law that bends as any other at first order."""
    law = compile_law(make_element("any", _PLAIN).force)
    few = points.select(points.spread(_FEW))
    scanned = points.select(points.spread(_SCANNED))
    turns = 2 * np.pi * np.arange(_TURNS) / _TURNS - np.pi
    misfits = [_turned(scanned, law, mass, float(turn)) for turn in turns]
    best = int(np.argmin([found.misfit if found.mass > 0 else np.inf for found in misfits]))
    found = _turned(few, law, mass, float(turns[best]))
    start, begun = found.values, found.mass
    values = np.array([turns[best]])
    if kind == "neighbour":
        shape = shape_of("residuals", few.omega, band)
        values = np.append(values, np.zeros(len(shape.names) - 1))
        fitted, values = fit_with_background(
            few, law, start, begun, shape, values, mass_free=mass is None, order=1, steps=_BRIEF
        )
        start, begun = fitted.values, fitted.mass
        values = _place_neighbour(few, law, start, begun, values, band, mass_free=mass is None)
    shape = shape_of(kind, few.omega, band)
    values = np.append(values, np.zeros(len(shape.names) - len(values)))
    return fit_with_background(few, law, start, begun, shape, values, mass_free=mass is None, order=1)[1]


def _place_neighbour(
    points: Points,
    law: ForceLaw,
    start: Array,
    mass: float,
    values: Array,
    band: tuple[float, float],
    *,
    mass_free: bool,
) -> Array:
    """Try a neighbour at places around the band; the one that leaves the least misfit is near."""
    shape = shape_of("neighbour", points.omega, band)
    width = band[1] - band[0]
    best, least = values, np.inf
    for place in np.linspace(max(band[0] - width, band[0] / 2), band[1] + width, _PLACES):
        trial = np.concatenate([values, [_SHARE / mass, 0.0, place, _TYPICAL_DAMPING]])
        fitted, found = fit_with_background(
            points, law, start, mass, shape, trial, mass_free=mass_free, order=1, steps=_BRIEF, reject=False
        )
        if fitted.mass > 0 and fitted.regression.noise < least:
            best, least = found, fitted.regression.noise
    return best


def _turned(points: Points, law: ForceLaw, mass: float | None, psi: float) -> LinearSolution:
    """Solve the first-order balance with the force turned by psi [rad]."""
    force = points.force * np.exp(1j * psi)
    weight = 1 / np.abs(force)
    none = np.zeros((0, 2))
    equations = Equations(points.omega, force, points.harmonics[:, :2], False, weight, none)
    return solve_equations(equations, law, mass)


def fit_with_background(
    points: Points,
    law: ForceLaw,
    values: Array,
    mass: float,
    shape: Shape,
    background: Array,
    *,
    mass_free: bool,
    order: int,
    reject: bool = True,
    steps: int = 50,
) -> tuple[FittedModel, Array]:
    """Fit law, mass and background to force, fundamental, mean and harmonics of all points at once.

    Parameters
    ----------
    points
        The measured points, background included.
    law, values, mass
        Where to start.
    shape, background
        The background at the points, and its values to start from.
    mass_free
        Whether the mass is identified too.
    order
        Harmonics carried in the balance; 1 is first order.
    reject
        Whether outliers are set aside.
    steps
        Most Gauss-Newton steps.

    Returns
    -------
    FittedModel
        As seen without the background; its regression has the values of the background last.
    background
        (b,) values of the background.
    """
    slaved = slaved_harmonics(law, order)
    samples = max(_SAMPLES_SWITCHED if law.switched else _SAMPLES_SMOOTH, 1 << (6 * order - 1).bit_length())
    compared = [h for h in points.measured if h in slaved]
    mode = shape.subtract(points, background)
    phase = np.angle(mode.harmonics[:, 1])
    orders = np.arange(points.harmonics.shape[1])
    level, unit = np.abs(points.force), points.amplitude
    start = np.zeros((len(points), max(order, 1) + 1), dtype=complex)
    count = len(values) + mass_free
    # the mean has no imaginary part
    real = [h == 0 for h in (1, 1, *compared)]
    held = HeldAmplitude(law, points.omega, start, slaved)

    def hold(parameters: Array, own: Array) -> Balance:
        m = float(parameters[len(values)]) if mass_free else mass
        return held(parameters[: len(values)], m, np.exp(own[:, 0]), samples)

    def linearise(parameters: Array, own: Array) -> Linearisation:
        balance = hold(parameters, own)
        besides = parameters[count:]
        size = np.exp(own[:, 0])
        turn = np.exp(-1j * (phase + own[:, 1]))
        force = points.force * turn * shape.turn(besides)
        harmonics = points.harmonics * turn[:, None] ** orders
        b = shape.receptance(besides)
        seen = size + b * balance.force
        by_law = balance.force_by[:, :count]
        terms = shape.slopes(besides) * balance.force[:, None]
        none = np.zeros_like(terms)
        still = np.zeros((len(points), 1))
        by_force = np.hstack([by_law, still, none])
        by_seen = np.hstack([by_law * b[:, None], still, terms])
        psi = by_law.shape[1]
        if logarithmic:
            # the noise of a logarithm has mean zero and the same size everywhere
            by_force[:, psi] = -1j * balance.force
            one = np.ones(len(points))
            rows = [
                (np.log(force / balance.force), balance.force_slope * size / balance.force, 1j * one),
                (np.log(harmonics[:, 1] / seen), (size + b * balance.force_slope * size) / seen, 1j * one),
            ]
            scales: list[NDArray[Any]] = [balance.force, seen]
        else:
            by_force[:, psi] = -1j * force
            rows = [
                ((force - balance.force) / level, balance.force_slope * size / level, 1j * force / level),
                (
                    (harmonics[:, 1] - seen) / unit,
                    (size + b * balance.force_slope * size) / unit,
                    1j * harmonics[:, 1] / unit,
                ),
            ]
            scales = [level, unit]
        by = [by_force / scales[0][:, None], by_seen / scales[1][:, None]]
        for h in compared:
            rows.append(
                (
                    (harmonics[:, h] - balance.harmonics[:, h]) / unit,
                    balance.harmonics_slope[:, h] * size / unit,
                    1j * h * harmonics[:, h] / unit,
                )
            )
            by.append(np.hstack([balance.harmonics_by[:, h, :count] / unit[:, None], still, none]))
        residual, grow, turned = (split_rows([row[part] for row in rows], real) for part in range(3))
        residual[~balance.converged] = np.nan
        return Linearisation(residual, np.stack([grow, turned], axis=2), split_rows(by, real))

    first = np.concatenate([values, [mass] if mass_free else [], background])
    own = np.stack([np.log(mode.amplitude), np.zeros(len(points))], axis=1)
    pairs = points.neighbours
    logarithmic = False
    regression = fit(linearise, first, own, reject=reject, steps=steps, neighbours=pairs)
    if regression.noise > _NOISY:
        logarithmic = True
        found, own, used = regression.parameters, regression.own, regression.used
        regression = fit(linearise, found, own, reject=reject, steps=steps, neighbours=pairs, used=used)
    found = regression.parameters
    balance = hold(found, regression.own)
    model = FittedModel(
        regression,
        found[: len(values)],
        float(found[len(values)]) if mass_free else mass,
        balance.force,
        balance.harmonics,
        phase + regression.own[:, 1],
    )
    return model, found[count:]


def split_off(regression: Regression, count: int) -> tuple[Regression, Array, Array]:
    """Keep what concerns the first parameters of a regression; errors that the others cause stay in.

    Returns
    -------
    regression
        Of the first ``count`` parameters.
    others
        Covariance of the other ones.
    caused
        (count, count) part of the first covariance that the others cause.
    """
    whole = regression.covariance
    others, cross = whole[count:, count:], np.nan_to_num(whole[:count, count:])
    caused = cross @ np.linalg.pinv(np.nan_to_num(others)) @ cross.T
    kept = replace(
        regression,
        parameters=regression.parameters[:count],
        covariance=whole[:count, :count],
        null=regression.null[:count],
        strength=regression.strength[:count],
        influence=regression.influence[:, :, :count],
    )
    return kept, others, caused
