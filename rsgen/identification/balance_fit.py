"""Fit of the balance to every point: first order with one harmonic, refined with all that matter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.data import Points
from rsgen.identification.least_squares import Linearisation, Regression, fit
from rsgen.identification.waveform import Balance, HeldAmplitude
from rsgen.law.numeric import ForceLaw

__all__ = ["FittedModel", "fit_balance", "slaved_harmonics", "split_rows"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_SAMPLES = 64
_SAMPLES_SWITCHED = 256
"""Where the law has switches and the data are exact enough to show what fewer samples miss."""

_EXACT = 1e-3
"""Misfit below which they show it."""

_NOISY = 1e-4
"""Misfit above which the square of the noise is worth to be allowed for."""

_STEP = 1e-4
"""Relative change of the amplitude by which the second derivative of the balance is taken."""


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

    def select(self, chosen: NDArray[np.intp]) -> FittedModel:
        """Keep some points; what was found from all stays."""
        of_points = ("own", "misfit", "used")
        kept = {name: getattr(self.regression, name)[chosen] for name in of_points}
        return replace(
            self,
            regression=replace(self.regression, **kept),
            force=self.force[chosen],
            harmonics=self.harmonics[chosen],
            turn=self.turn[chosen],
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """One compared quantity, relative: measured minus predicted, derivatives of the prediction."""

    residual: NDArray[Any]
    grow: NDArray[Any]
    turn: NDArray[Any]
    by: NDArray[Any]


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
    samples = max(_SAMPLES, 1 << (6 * order - 1).bit_length())
    compared = [h for h in points.measured if h in slaved]
    phase = np.angle(points.harmonics[:, 1])
    orders = np.arange(points.harmonics.shape[1])
    level = np.abs(points.force)
    start = np.zeros((len(points), max(order, 1) + 1), dtype=complex)
    # the measured waveform leads to the branch that was measured
    known = [h for h in slaved if h < len(orders)]
    start[:, known] = (points.harmonics * np.exp(-1j * phase[:, None] * orders))[:, known]
    held = HeldAmplitude(law, points.omega, start, slaved)

    def predict(parameters: Array, own: Array) -> Balance:
        m = float(parameters[-1]) if mass_free else mass
        return held(parameters[: len(values)], m, np.exp(own[:, 0]), samples)

    # the mean has no imaginary part
    real = [h == 0 for h in (1, 1, *compared)]

    def turned(own: Array) -> ComplexArray:
        return np.asarray(points.harmonics * np.exp(-1j * (phase + own[:, 1]))[:, None] ** orders)

    def linearise(parameters: Array, own: Array) -> Linearisation:
        balance = predict(parameters, own)
        size = np.exp(own[:, 0])
        harmonics = turned(own)
        force = points.force * np.exp(-1j * (phase + own[:, 1]))
        none = np.zeros_like(balance.force_by)
        rows: list[_Row]
        if scale is None:
            rows = [
                _Row(
                    (force - balance.force) / level,
                    balance.force_slope * size / level,
                    1j * force / level,
                    balance.force_by / level[:, None],
                ),
                _Row(
                    (harmonics[:, 1] - size) / points.amplitude,
                    size / points.amplitude,
                    1j * harmonics[:, 1] / points.amplitude,
                    none,
                ),
            ]
        else:
            # of a logarithm the noise has mean zero and the same size everywhere; a division by measured
            # amplitudes would favour points that noise made small
            rows = [
                _Row(
                    np.log(force / balance.force),
                    balance.force_slope * size / balance.force,
                    np.full(len(points), 1j),
                    balance.force_by / balance.force[:, None],
                ),
                _Row(np.log(harmonics[:, 1] / size), np.ones(len(points)), np.full(len(points), 1j), none),
            ]
        unit = points.amplitude if scale is None else scale
        for h in compared:
            rows.append(
                _Row(
                    (harmonics[:, h] - balance.harmonics[:, h]) / unit,
                    balance.harmonics_slope[:, h] * size / unit,
                    1j * h * harmonics[:, h] / unit,
                    balance.harmonics_by[:, h] / unit[:, None],
                )
            )
        residual = split_rows([row.residual for row in rows], real)
        residual[~balance.converged] = np.nan
        by_own = [split_rows([getattr(row, name) for row in rows], real) for name in ("grow", "turn")]
        by_parameter = split_rows([row.by for row in rows], real)[:, :, : len(parameters)]
        return Linearisation(residual, np.stack(by_own, axis=2), by_parameter)

    def bend(parameters: Array, own: Array, spread: Array) -> Array:
        step = np.array([_STEP, 0.0])
        low, high = (linearise(parameters, own + sign * step).by_own[:, :, 0] for sign in (-1, 1))
        grown = (high - low) / (2 * _STEP) * spread[:, None, 0, 0]
        harmonics = turned(own)
        unit = points.amplitude if scale is None else scale
        twice = [np.zeros(len(points))] * 2 + [h**2 * harmonics[:, h] / unit for h in compared]
        return 0.5 * (grown + split_rows(twice, real) * spread[:, None, 1, 1])

    first = np.append(values, mass) if mass_free else np.array(values)
    own = np.stack([np.log(points.amplitude), np.zeros(len(points))], axis=1)
    pairs = points.neighbours
    scale: Array | None = None
    regression = fit(linearise, first, own, reject=reject, steps=steps, neighbours=pairs)
    # first order is what it says, not what a coarse sum makes of it
    if (
        law.switched
        and steps > 1
        and samples < _SAMPLES_SWITCHED
        and (order == 1 or regression.noise < _EXACT)
    ):
        samples = _SAMPLES_SWITCHED
        found, own, more = regression.parameters, regression.own, 1 if order == 1 else steps
        regression = fit(linearise, found, own, reject=reject, steps=more, neighbours=pairs)
    if regression.noise > _NOISY and not law.rough:
        scale = np.exp(regression.own[:, 0])
        regression = fit(
            linearise,
            regression.parameters,
            regression.own,
            reject=reject,
            steps=steps,
            neighbours=pairs,
            used=regression.used,
            bend=bend,
        )
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


def split_rows(rows: Sequence[NDArray[Any]], real: Sequence[bool]) -> Array:
    """Join c complex rows (n, ...) to (n, r, ...) real ones; of those marked real only the real part."""
    parts = [np.asarray(row.real, dtype=np.float64) for row in rows]
    parts += [np.asarray(row.imag) for row, alone in zip(rows, real, strict=True) if not alone]
    return np.stack(parts, axis=1)
