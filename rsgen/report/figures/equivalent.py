"""What an identified model says about stiffness and damping over amplitude: values, bands, axis limits."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import NORMAL
from rsgen.describing import DescribingFunction, Equivalent, derive
from rsgen.identification.results import Estimate, Identification

__all__ = [
    "Backbone",
    "amplitudes_tested",
    "backbone",
    "calm_limits",
    "evaluated",
    "refined_band",
    "solution_of",
    "standard_errors",
    "values_of",
]


@dataclass(frozen=True, slots=True, eq=False)
class Backbone:
    """Equivalent properties along the resonance of a model; every array (n,).

    ``amplitude`` X [m], ``omega`` [rad/s], ``stiffness`` [N/m], ``damping`` [N s/m], ``mean`` X0 [m].
    """

    amplitude: Array
    omega: Array
    stiffness: Array
    damping: Array
    mean: Array
    mass: float

    @property
    def frequency(self) -> Array:
        """(n,) resonance frequency [Hz]."""
        return self.omega / (2 * np.pi)

    @property
    def damping_ratio(self) -> Array:
        """(n,) c / (2 m omega_n) [1]."""
        return np.asarray(self.damping / (2 * self.mass * self.omega), dtype=np.float64)


def values_of(estimates: Iterable[Estimate]) -> dict[str, float]:
    """Give the values of a set of estimates, the mass among them as "m" where it was identified."""
    return {estimate.name: estimate.value for estimate in estimates}


def amplitudes_tested(identification: Identification, points: int = 160) -> Array:
    """Give amplitudes [m] that cover what was tested, none outside."""
    amplitude = identification.curve.amplitude
    amplitude = amplitude[np.isfinite(amplitude) & (amplitude > 0)]
    if not amplitude.size:
        return np.empty(0)
    low, high = float(amplitude.min()), float(amplitude.max())
    # breakpoints and friction show at small amplitudes: half of the points are spread by ratio
    return np.unique(
        np.concatenate([np.linspace(low, high, points // 2), np.geomspace(low, high, points // 2)])
    )


def solution_of(identification: Identification) -> dict[str, float]:
    """Give the refined values; where one is not identifiable, the value of the fit.

    The curve over what was tested is known also where single parameters are not.
    """
    values = values_of(identification.refined)
    names = sorted(identification.model.parameters)
    fitted = dict(zip(names, identification.solution.tolist(), strict=True))
    return {name: value if np.isfinite(value) else fitted.get(name, value) for name, value in values.items()}


def evaluated(
    law: DescribingFunction,
    amplitude: Array,
    omega: Array,
    values: Mapping[str, float],
    mean: Array | None = None,
) -> Equivalent:
    """Evaluate a describing function; NaN everywhere where the loop of a state does not close.

    Values that were fitted may be such; those of a case file were tried before. Figures and sentences of one
    report ask for the same loops many times.
    """
    rows = (amplitude, omega) if mean is None else (amplitude, omega, mean)
    return _evaluated(law, tuple(values.items()), len(amplitude), *(row.tobytes() for row in rows))


@lru_cache(maxsize=64)
def _evaluated(
    law: DescribingFunction, values: tuple[tuple[str, float], ...], count: int, *rows: bytes
) -> Equivalent:
    amplitude, omega, *mean = (np.frombuffer(row, dtype=np.float64, count=count) for row in rows)
    try:
        return law.evaluate(amplitude, omega, dict(values), *mean)
    except RsgenError:
        if not law.memory:
            raise
        unknown = np.full(count, np.nan)
        return Equivalent(unknown, unknown, unknown)


def backbone(identification: Identification, values: Mapping[str, float], amplitude: Array) -> Backbone:
    """Evaluate the describing functions at m omega^2 = k(X), where the levels have their resonance.

    Parameters
    ----------
    identification
        Its model has the laws; its mass is used where ``values`` has no "m".
    values
        Every parameter of the laws, SI. A value that is not finite makes the result NaN.
    amplitude
        (n,) X [m], positive.
    """
    mass = values.get("m", identification.mass)
    missing = [name for name in identification.model.parameters if name not in values]
    if missing:
        raise RsgenError(f"truth: no value of {', '.join(missing)}; every parameter of the laws is needed")
    used = {name: values[name] for name in identification.model.parameters}
    unknown = np.full(amplitude.shape, np.nan)
    if not (amplitude.size and np.isfinite([mass, *used.values()]).all()):
        return Backbone(amplitude, unknown, unknown, unknown, unknown, mass)
    law = derive(identification.model.force)
    omega = np.full(amplitude.shape, 2 * np.pi * float(np.median(identification.curve.frequency)))
    for _ in range(3):  # the stiffness of most laws does not depend on omega: the first round is final
        result = evaluated(law, amplitude, omega, used)
        stiffness = np.broadcast_to(np.asarray(result.stiffness, dtype=np.float64), amplitude.shape)
        update = np.sqrt(np.where((stiffness > 0) & (mass > 0), stiffness, np.nan) / mass)
        done = bool(np.allclose(update, omega, rtol=1e-9, equal_nan=True))
        omega = np.where(np.isfinite(update), update, omega)
        if done:
            break
    damping = np.broadcast_to(np.asarray(result.damping, dtype=np.float64), amplitude.shape)
    mean = np.broadcast_to(np.asarray(result.mean, dtype=np.float64), amplitude.shape)
    return Backbone(amplitude, omega, stiffness, damping, mean, mass)


def refined_band(identification: Identification, amplitude: Array) -> tuple[Backbone, Array, Array]:
    """Give the backbone of the refined model and half the width of the 95 % band of stiffness and damping."""
    values = solution_of(identification)
    names = [estimate.name for estimate in identification.refined if estimate.name != "m"]

    def evaluate(changed: Mapping[str, float]) -> Array:
        model = backbone(identification, changed, amplitude)
        return np.array([model.stiffness, model.damping])

    half = NORMAL * standard_errors(identification, values, names, evaluate)
    return backbone(identification, values, amplitude), half[0], half[1]


def standard_errors(
    identification: Identification,
    values: Mapping[str, float],
    names: Iterable[str],
    evaluate: Callable[[Mapping[str, float]], Array],
) -> Array:
    """Give the standard error of every number that ``evaluate`` makes of the values, by linear propagation.

    Only the covariance of ``names`` counts; a derivative is the difference over one standard error.
    """
    rows = {estimate.name: i for i, estimate in enumerate(identification.refined)}
    covariance, centre = identification.covariance, evaluate(values)
    if covariance.shape != (len(rows), len(rows)):
        return np.zeros(centre.shape)
    widths = {name: float(np.sqrt(covariance[rows[name], rows[name]])) for name in names}
    moving = {name: width for name, width in widths.items() if np.isfinite(width) and width > 0}
    slopes = np.zeros((len(moving), *centre.shape))
    for slope, (name, width) in zip(slopes, moving.items(), strict=True):
        slope[...] = (evaluate({**values, name: values[name] + width}) - centre) / width
    index = [rows[name] for name in moving]
    variance = np.einsum("i...,ij,j...->...", slopes, covariance[np.ix_(index, index)], slopes)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)


def calm_limits(axes: Axes, values: Iterable[Array], least: float = 0.1) -> None:
    """Choose y limits that show change where there is some and no noise where there is none.

    The axis spans at least ``least`` of the largest value, so that a constant looks constant; outliers
    beyond the central 98 % of a cloud of over 50 points may leave the picture.
    """
    lows, highs = [], []
    for cloud in values:
        finite = cloud[np.isfinite(cloud)]
        if finite.size > 50:
            lows.append(float(np.percentile(finite, 1)))
            highs.append(float(np.percentile(finite, 99)))
        elif finite.size:
            lows.append(float(finite.min()))
            highs.append(float(finite.max()))
    if not lows:
        return
    low, high = min(lows), max(highs)
    span = max(high - low, least * max(abs(low), abs(high)), 1e-300)
    middle = (low + high) / 2
    axes.set_ylim(middle - 0.58 * span, middle + 0.58 * span)
