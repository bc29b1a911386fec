"""Output-error fit: the compiled steady state itself is the model, started on the measured branch.

For laws that jump or have corners a truncated Fourier series is not the motion; the time-domain steady state
is. Derivatives are differences whose step moves the response by a fixed small amount; they are kept from step
to step, because near the estimate they change less than the estimate itself has to.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import RsgenError
from rsgen.identification.balance_fit import FittedModel
from rsgen.identification.force_law import ForceLaw
from rsgen.identification.points import Points
from rsgen.identification.regression import Linearisation, fit
from rsgen.oscillator import Model, Oscillator
from rsgen.steady_state import SteadyStates, solve_steady_states

__all__ = ["fit_output"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_MOVE = 1e-3
"""Relative change of the response by which derivatives are taken."""

_ROUND_OFF = 1e-12
"""Effect of a parameter, relative to the strongest, that is only round-off."""

_BRANCH = 0.2
"""A prediction farther from the measured fundamental, relatively, is on another branch."""

_STEEP = 20.0
"""Points whose amplitude grows by a larger power of the force lie at a fold: force noise decides there."""


def fit_output(
    points: Points,
    model: Model,
    law: ForceLaw,
    start: FittedModel,
    *,
    accuracy: float,
) -> FittedModel | None:
    """Fit the compiled steady states to force, fundamental, mean and harmonics.

    Parameters
    ----------
    points
        The measured points, those of ``start``.
    model, law
        The laws, as elements for the simulator and compiled for arrays.
    start
        The fit of the balance.
    accuracy
        Of the simulated amplitude, relative.

    Returns
    -------
    FittedModel or None
        None where the simulator cannot follow enough of the points.
    """
    mass_free = model.mass is None
    count = len(law.parameters)
    compared = [
        h for h in points.measured if h != 1 and (h % 2 == 1 or not law.odd) and (h > 0 or law.springs)
    ]
    highest = max([1, *compared])
    orders = np.arange(highest + 1)
    level = np.abs(points.force)
    phase = np.angle(points.force)
    frequency = points.omega / (2 * np.pi)
    known: dict[str, NDArray[np.float64]] = {"state": _start_states(points, phase)}

    def solve(parameters: Array, drive: Array, start_state: Array) -> SteadyStates | None:
        mass = float(parameters[-1]) if mass_free else float(model.mass or start.mass)
        values = dict(zip(law.parameters, map(float, parameters[:count]), strict=True))
        try:
            oscillator = Oscillator(mass, model.elements, values)
            return solve_steady_states(
                oscillator,
                drive.astype(complex),
                frequency,
                harmonics=highest,
                accuracy=accuracy,
                start=start_state,
            )
        except RsgenError:
            return None

    def near(states: SteadyStates | None) -> tuple[ComplexArray, NDArray[np.bool_]]:
        if states is None:
            return np.full((len(points), highest + 1), np.nan + 0j), np.zeros(len(points), dtype=bool)
        size = np.abs(states.harmonics[:, 1])
        good = states.settled & (np.abs(size / points.amplitude - 1) < _BRANCH)
        return states.harmonics, good

    moves = _moves(start)
    slopes: dict[str, ComplexArray] = {}
    steep = np.zeros(len(points), dtype=bool)

    def differentiate(parameters: Array, own: Array, base: ComplexArray, states: Array) -> None:
        drive = np.exp(own[:, 0])
        moved, good = near(solve(parameters, drive * (1 + _MOVE), states))
        by_force = np.where(good[:, None], (moved - base) / _MOVE, np.nan)
        columns = []
        for j, move in enumerate(moves):
            if move == 0:
                columns.append(np.zeros_like(base))
                continue
            trial = np.array(parameters)
            trial[j] += move
            moved, good = near(solve(trial, drive, states))
            columns.append(np.where(good[:, None], (moved - base) / move, np.nan))
        slopes["force"], slopes["parameter"] = by_force, np.stack(columns, axis=-1)
        growth = np.abs(by_force[:, 1]) / np.abs(base[:, 1])
        steep[:] = ~(growth < _STEEP)

    def linearise(parameters: Array, own: Array) -> Linearisation:
        drive = np.exp(own[:, 0])
        states = solve(parameters, drive, known["state"])
        predicted, good = near(states)
        if states is not None and "force" not in slopes:
            known["state"] = np.where(good[:, None], states.state, known["state"])
            differentiate(parameters, own, predicted, known["state"])
        turn = np.exp(-1j * (phase + own[:, 1]))
        measured = points.harmonics[:, : highest + 1] * turn[:, None] ** orders
        scale = points.amplitude
        parts: list[tuple[ComplexArray, ComplexArray, ComplexArray, int, ComplexArray | None]] = [
            (points.force * turn / level, *[(drive / level).astype(np.complex128)] * 2, 1, None)
        ]
        for h in (1, *compared):
            parts.append(
                (
                    measured[:, h] / scale,
                    predicted[:, h] / scale,
                    slopes["force"][:, h] / scale if slopes else np.full(len(points), np.nan + 0j),
                    h,
                    slopes["parameter"][:, h] / scale[:, None] if slopes else None,
                )
            )
        empty = np.zeros((len(points), len(parameters)), dtype=complex)
        seen = np.stack([part[0] for part in parts], axis=1)
        residual = _split(seen - np.stack([part[1] for part in parts], axis=1))
        residual[~good | steep] = np.nan
        own_slope = _split(np.stack([part[2] for part in parts], axis=1))
        own_turn = _split(1j * np.array([part[3] for part in parts]) * seen)
        by = _split(np.stack([empty if part[4] is None else part[4] for part in parts], axis=1))
        residual[~np.isfinite(by).all(axis=(1, 2)) | ~np.isfinite(own_slope).all(axis=1)] = np.nan
        return Linearisation(residual, np.stack([own_slope, own_turn], axis=2), by)

    own = np.stack([np.log(level), np.zeros(len(points))], axis=1)
    regression = fit(linearise, start.regression.parameters, own, steps=6, neighbours=points.neighbours)
    if np.count_nonzero(regression.used) < 0.5 * len(points):
        return None
    found = regression.parameters
    drive = np.exp(regression.own[:, 0])
    states = solve(found, drive, known["state"])
    predicted, _ = near(states)
    # back to a fundamental of phase zero, as the balance has it
    lag = np.angle(predicted[:, 1])
    return FittedModel(
        regression,
        found[:count],
        float(found[-1]) if mass_free else start.mass,
        drive * np.exp(-1j * lag),
        predicted * np.exp(-1j * lag)[:, None] ** orders,
        phase + regression.own[:, 1] + lag,
    )


def _start_states(points: Points, phase: Array) -> Array:
    """(n, 2) displacement and velocity of the measured waveform at the top of the force."""
    orders = np.arange(points.harmonics.shape[1])
    turned = points.harmonics * np.exp(-1j * phase)[:, None] ** orders
    velocity = 1j * orders * points.omega[:, None] * turned
    return np.stack([turned.sum(axis=1).real, velocity.sum(axis=1).real], axis=1)


def _moves(start: FittedModel) -> Array:
    """Step of each parameter that moves the response by ``_MOVE``, root mean square over all points.

    Zero where the response does not depend on the parameter: there is nothing to differentiate.
    """
    size, strength = np.abs(start.regression.parameters), start.regression.strength
    acts = strength * size > _ROUND_OFF * np.max(strength * size, initial=0.0)
    return np.where(acts, np.minimum(_MOVE / np.where(acts, strength, 1.0), 0.1 * size), 0.0)


def _split(values: ComplexArray) -> Array:
    """(n, c, ...) complex to (n, 2c, ...) real."""
    return np.concatenate([values.real, values.imag], axis=1)
