"""Fit of the balance to every point: first order with one harmonic, refined with all that matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.force_law import ForceLaw
from rsgen.identification.points import Points
from rsgen.identification.regression import Linearisation, Regression, fit
from rsgen.identification.waveform import Balance, hold_amplitude

__all__ = ["FittedModel", "fit_balance", "slaved_harmonics"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_SAMPLES_SMOOTH = 64
_SAMPLES_SWITCHED = 256


@dataclass(frozen=True, slots=True, eq=False)
class FittedModel:
    """A fit to every point.

    Parameters
    ----------
    regression
        Its ``parameters`` are those of the law in order, then the mass where it is free.
    values, mass
        The same, taken apart.
    force, harmonics
        (n,) [N] and (n, H+1) [m]: predicted at the estimate, relative to a fundamental of phase zero.
    turn
        (n,) phase of the true fundamental [rad]; harmonic h is the predicted one times exp(i h turn).
    """

    regression: Regression
    values: Array
    mass: float
    force: ComplexArray
    harmonics: ComplexArray
    turn: Array


def slaved_harmonics(law: ForceLaw, order: int) -> tuple[int, ...]:
    """Harmonics up to ``order`` that follow from the fundamental: no even ones for an odd law."""
    if law.odd:
        return tuple(range(3, order + 1, 2))
    mean = (0,) if law.springs else ()
    return (*mean, *range(2, order + 1))


def fit_balance(
    points: Points,
    law: ForceLaw,
    values: Array,
    mass: float,
    *,
    mass_free: bool,
    order: int,
    reject: bool = True,
    steps: int = 25,
) -> FittedModel:
    """Fit law parameters (and mass) to force, fundamental, mean and harmonics of all points at once.

    Parameters
    ----------
    points
        The measured points.
    law, values, mass
        Where to start.
    mass_free
        Whether the mass is identified too.
    order
        Harmonics carried in the balance; 1 is first order.
    reject
        Whether outliers are set aside.
    steps
        Most Gauss-Newton steps.
    """
    slaved = slaved_harmonics(law, order)
    samples = max(_SAMPLES_SWITCHED if law.switched else _SAMPLES_SMOOTH, 1 << (6 * order - 1).bit_length())
    compared = [h for h in points.measured if h in slaved]
    phase = np.angle(points.harmonics[:, 1])
    orders = np.arange(points.harmonics.shape[1])
    level = np.abs(points.force)
    start = np.zeros((len(points), max(order, 1) + 1), dtype=complex)
    if not law.odd:
        # the measured waveform leads to the branch that was measured
        known = min(order + 1, len(orders))
        start[:, :known] = (points.harmonics * np.exp(-1j * phase[:, None] * orders))[:, :known]
        start[:, 1] = 0
    seen: dict[str, Balance] = {}

    def predict(parameters: Array, own: Array) -> Balance:
        guess = seen["last"].harmonics if "last" in seen else start
        m = float(parameters[-1]) if mass_free else mass
        balance = hold_amplitude(
            law, parameters[: len(values)], m, points.omega, np.exp(own[:, 0]), guess, slaved, samples
        )
        good = balance.converged & np.isfinite(balance.harmonics).all(axis=1)
        keep = np.where(good[:, None], balance.harmonics, start)
        seen["last"] = Balance(
            **{n: getattr(balance, n) for n in Balance.__dataclass_fields__ if n != "harmonics"},
            harmonics=keep,
        )
        return balance

    def linearise(parameters: Array, own: Array) -> Linearisation:
        balance = predict(parameters, own)
        size = np.exp(own[:, 0])
        turn = np.exp(-1j * (phase + own[:, 1]))
        harmonics = points.harmonics * turn[:, None] ** orders
        rows = [
            (
                points.force * turn / level,
                balance.force / level,
                balance.force_slope / level,
                1,
                balance.force_by,
                level,
            ),
            (
                harmonics[:, 1] / points.amplitude,
                size / points.amplitude,
                1 / points.amplitude,
                1,
                None,
                level,
            ),
        ]
        measured, predicted, slope, by, times = [], [], [], [], []
        for m, p, s, h, b, scale in rows:
            measured.append(m)
            predicted.append(p.astype(complex))
            slope.append(np.asarray(s, dtype=complex))
            times.append(h)
            by.append(np.zeros_like(balance.force_by) if b is None else b / scale[:, None])
        for h in compared:
            measured.append(harmonics[:, h] / points.amplitude)
            predicted.append(balance.harmonics[:, h] / points.amplitude)
            slope.append(balance.harmonics_slope[:, h] / points.amplitude)
            times.append(h)
            by.append(balance.harmonics_by[:, h] / points.amplitude[:, None])
        seen_measured = np.stack(measured, axis=1)
        residual = _split(seen_measured - np.stack(predicted, axis=1))
        own_slope = _split(np.stack(slope, axis=1) * size[:, None])
        own_turn = _split(1j * np.array(times) * seen_measured)
        by_parameter = _split(np.stack(by, axis=1))[:, :, : len(parameters)]
        residual[~balance.converged] = np.nan
        return Linearisation(residual, np.stack([own_slope, own_turn], axis=2), by_parameter)

    first = np.append(values, mass) if mass_free else np.array(values)
    own = np.stack([np.log(points.amplitude), np.zeros(len(points))], axis=1)
    regression = fit(linearise, first, own, reject=reject, steps=steps, neighbours=points.neighbours)
    balance = predict(regression.parameters, regression.own)
    found = regression.parameters
    return FittedModel(
        regression,
        found[: len(values)],
        float(found[-1]) if mass_free else mass,
        balance.force,
        balance.harmonics,
        phase + regression.own[:, 1],
    )


def _split(values: ComplexArray) -> Array:
    """(n, c, ...) complex to (n, 2c, ...) real."""
    return np.concatenate([values.real, values.imag], axis=1)
