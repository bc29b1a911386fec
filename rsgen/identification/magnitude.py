"""Identification from amplitudes alone, where the phase was not recorded.

At a measured amplitude X and frequency the law demands one force, on whatever branch the response was, so

    |F|^2 = X^2 ((k(X) - m omega^2)^2 + omega^2 c(X)^2)

is fitted without a phase and without a choice of branch. It starts from points with a phase made up: at the
peak of a run the response lags a quarter period, c = F/(omega X) (Liu et al., Sec. 1.2), below it less, above
it more; the law that fits then says the phase anew. A real background b is told by how the response is lifted
on one side of the resonance and lowered on the other, |X| = |q + b F|; its imaginary part is hardly told
beside the damping and stays zero.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.background import Shape
from rsgen.identification.balance_fit import FittedModel, slaved_harmonics
from rsgen.identification.data import Points
from rsgen.identification.dynamic_stiffness import Equations, LinearSolution, solve_equations
from rsgen.identification.least_squares import Linearisation, fit
from rsgen.identification.waveform import Balance, hold_amplitude
from rsgen.law.numeric import ForceLaw
from rsgen.surface import ResponseSurface

__all__ = ["fit_magnitude", "start_magnitude", "with_phase"]

Array = NDArray[np.float64]
Table = TypeVar("Table", Points, ResponseSurface)

_SAMPLES_SMOOTH = 64
_SAMPLES_SWITCHED = 256
_ROUNDS = 12
"""Times the phase is made up and the law fitted anew; then the amplitudes alone are fitted."""

_FLAT = 0.05
"""Where the response hardly grows with the amplitude of the mode, Newton's step is no guide."""

_BETTER = 0.999
"""Relative misfit below which another round is worth it."""

_ORDER = 3


def _guessed(points: Points) -> NDArray[np.float64]:
    """(n,) lag of the response [rad] from where each point lies in its run."""
    size, force = points.amplitude, np.abs(points.force)
    side = np.zeros(len(points))
    peaks: list[tuple[float, float]] = []
    runs = {(float(level), str(sweep)) for level, sweep in zip(points.level, points.sweep, strict=True)}
    for level, sweep in sorted(runs):
        rows = np.flatnonzero((points.level == level) & (points.sweep == sweep))
        top = rows[np.argmax(size[rows])]
        side[rows] = np.sign(points.omega[rows] - points.omega[top])
        if points.omega[rows].min() < points.omega[top] < points.omega[rows].max():
            peaks.append((float(size[top]), float(force[top] / (points.omega[top] * size[top]))))
    if not peaks:
        top = int(np.argmax(size))
        peaks = [(float(size[top]), float(force[top] / (points.omega[top] * size[top])))]
    heights, damping = np.array(sorted(peaks)).T
    share = np.interp(size, heights, damping) * points.omega * size / force
    below = np.arcsin(np.clip(share, 0.0, 1.0))
    return np.where(side > 0, np.pi - below, np.where(side < 0, below, np.pi / 2))


def start_magnitude(points: Points, law: ForceLaw, mass: float | None) -> LinearSolution:
    """Find values to start from: the law fitted to a phase that the law itself says, from a guess on."""
    lag = _guessed(points)
    force = np.abs(points.force)
    harmonics = np.zeros((len(points), 2), dtype=complex)
    harmonics[:, 1] = points.amplitude
    best = np.inf
    start: LinearSolution | None = None
    for _ in range(_ROUNDS):
        equations = Equations(
            points.omega, force * np.exp(1j * lag), harmonics, False, 1 / force, np.zeros((0, 2))
        )
        found = solve_equations(equations, law, mass)
        balance = _hold(law, found.values, found.mass, points.omega, points.amplitude, 1)
        misfit = float(np.sqrt(np.mean(np.log(np.abs(balance.force) / force) ** 2)))
        if start is not None and not misfit < _BETTER * best:
            break
        best, start = misfit, found
        lag = np.angle(balance.force)
    return start if start is not None else found


def _hold(law: ForceLaw, values: Array, mass: float, omega: Array, size: Array, order: int) -> Balance:
    samples = _SAMPLES_SWITCHED if law.switched else _SAMPLES_SMOOTH
    start = np.zeros((len(omega), max(order, 1) + 1), dtype=complex)
    return hold_amplitude(law, values, mass, omega, size, start, slaved_harmonics(law, order), samples)


def fit_magnitude(
    points: Points,
    law: ForceLaw,
    values: Array,
    mass: float,
    shape: Shape,
    *,
    mass_free: bool,
    steps: int = 50,
) -> tuple[FittedModel, Array]:
    """Fit law, mass and background to the amplitudes of force and response, noise relative to their size.

    Parameters
    ----------
    points
        The measured points; phases are not looked at.
    law, values, mass
        Where to start.
    shape
        The background at the points; its phase error stays zero, as amplitudes do not tell it.
    mass_free
        Whether the mass is identified too.
    steps
        Most Gauss-Newton steps.

    Returns
    -------
    FittedModel
        Its forces have the phase that the law says; its regression has the values of the background last.
    background
        (b,) values of the background.
    """
    level, size = np.abs(points.force), points.amplitude
    count = len(values) + mass_free

    def hold(parameters: Array, own: Array) -> Balance:
        m = float(parameters[len(values)]) if mass_free else mass
        return _hold(law, parameters[: len(values)], m, points.omega, np.exp(own[:, 0]), _ORDER)

    def linearise(parameters: Array, own: Array) -> Linearisation:
        balance = hold(parameters, own)
        x, force = np.exp(own[:, 0]), balance.force
        b = shape.receptance(parameters[count:])
        seen = x + b * force
        residual = np.stack([np.log(level / np.abs(force)), np.log(size / np.abs(seen))], axis=1)
        residual[~balance.converged] = np.nan
        slope = balance.force_slope * x
        grow = np.stack([(slope / force).real, ((x + b * slope) / seen).real], axis=1)
        by_law = balance.force_by[:, :count]
        # real parts stand first in each pair
        by_terms = (shape.slopes(parameters[count:]) * (force / seen)[:, None]).real * besides
        by_terms[:, 1::2] = 0
        still = np.zeros((len(points), 1))
        by_force = np.hstack([(by_law / force[:, None]).real, still, np.zeros_like(by_terms)])
        by_seen = np.hstack([(by_law * (b / seen)[:, None]).real, still, by_terms])
        return Linearisation(residual, grow[:, :, None], np.stack([by_force, by_seen], axis=1))

    first = np.concatenate([values, [mass] if mass_free else [], np.zeros(len(shape.names))])
    own = np.log(size)[:, None]
    # law and background share the tails of a resonance: the law comes near first
    besides = 0.0
    regression = fit(linearise, first, own, steps=steps, neighbours=points.neighbours)
    if len(shape.names) > 1:
        besides = 1.0
        first, own = regression.parameters, regression.own
        regression = fit(linearise, first, own, steps=steps, neighbours=points.neighbours)
    found = regression.parameters
    balance = hold(found, regression.own)
    model = FittedModel(
        regression,
        found[: len(values)],
        float(found[len(values)]) if mass_free else mass,
        balance.force,
        balance.harmonics,
        np.zeros(len(points)),
    )
    return model, found[count:]


def with_phase(table: Table, law: ForceLaw, found: FittedModel, shape: Shape, background: Array) -> Table:
    """Give force and response the phases that law and background say at each amplitude."""
    seen = np.abs(table.harmonics[:, 1])
    held = np.isfinite(seen) & (seen > 0)
    force = np.abs(table.force).astype(np.complex128)
    harmonics = np.zeros((len(seen), 2), dtype=np.complex128)
    harmonics[:, 1] = seen
    b, omega, wanted = shape.receptance(background)[held], table.omega[held], seen[held]
    size = np.array(wanted)
    for _ in range(_ROUNDS):
        balance = _hold(law, found.values, found.mass, omega, size, _ORDER)
        response = size + b * balance.force
        slope = (np.conj(response) * (1 + b * balance.force_slope)).real / np.abs(response)
        step = (wanted - np.abs(response)) / np.where(np.abs(slope) > _FLAT, slope, 1.0)
        size = size + np.nan_to_num(np.clip(step, -0.5 * size, 0.5 * size))
    balance = _hold(law, found.values, found.mass, omega, size, _ORDER)
    force[held] *= np.exp(1j * np.nan_to_num(np.angle(balance.force)))
    harmonics[held, 1] *= np.exp(1j * np.nan_to_num(np.angle(size + b * balance.force)))
    if isinstance(table, Points):
        return replace(table, force=force, harmonics=harmonics, measured=(1,))
    return replace(table, force=force, harmonics=harmonics)
