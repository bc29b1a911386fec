"""Dynamic stiffness F/X = k(X) - m omega^2 + i omega c(X, omega): linear in all but a few parameters.

The linear parameters are solved for exactly at every trial of the others (variable projection), so that only
breakpoints, exponents and the like have to be searched, over the whole range in which they change the law.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.force_law import ForceLaw
from rsgen.identification.regression import solve_scaled

__all__ = ["Equations", "LinearSolution", "point_misfit", "solve_equations"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_DECADES = 14
_PER_DECADE = 3
_SEARCH_POINTS = 120
_SCANNED = 32
_TRIALS = 400
_STARTS = 4
_SAMPLES = 64
_FINER = 4
"""Times as many samples where the law has switches."""

_SIGNIFICANT = 25.0
"""Gain in the sum of squares, in units of the noise, that a nonlinear parameter must bring to count."""

_SOLVER = 1e-6
"""Relative misfit that the simulator itself may leave."""

_HUGE = 1e100
"""Columns beyond this are an overflow in the making: the trial is no candidate."""


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Complex equations  sum_j p_j N_j(q) - m omega^2 X = F  of the fundamental, and of the mean.

    Parameters
    ----------
    omega
        (n,) [rad/s].
    force
        (n,) complex [N].
    harmonics
        (n, H+1) complex displacement [m] along which the law is evaluated.
    mean
        Whether the mean of the force must vanish too.
    weight
        (n,) [1/N]
    turning
        (t, 2) largest and smallest displacement [m] of points where the energy at both turning points must be
        equal (the paper's k6 Xp^2 = k7 Xn^2); empty where this is not asked.
    """

    omega: Array
    force: ComplexArray
    harmonics: ComplexArray
    mean: bool
    weight: Array
    turning: Array

    def select(self, chosen: NDArray[np.intp]) -> Equations:
        """Keep some points."""
        turning = self.turning[chosen] if len(self.turning) == len(self.omega) else self.turning
        return Equations(
            self.omega[chosen],
            self.force[chosen],
            self.harmonics[chosen],
            self.mean,
            self.weight[chosen],
            turning,
        )


@dataclass(frozen=True, slots=True, eq=False)
class LinearSolution:
    """Values of all parameters, mass, relative misfit, and covariance of (values, mass if free)."""

    values: Array
    mass: float
    misfit: float
    covariance: Array


def solve_equations(
    equations: Equations, law: ForceLaw, mass: float | None, near: Array | None = None
) -> LinearSolution:
    """Solve for all parameters of the law, and for the mass where it is None.

    Parameters
    ----------
    equations, law, mass
        What is solved.
    near
        (p,) values whose nonlinear ones lead to the solution; None searches their whole range.
    """
    chosen = np.argsort(np.abs(equations.harmonics[:, 1]), kind="stable")
    few = chosen[np.unique(np.linspace(0, len(chosen) - 1, _SEARCH_POINTS).round().astype(np.intp))]
    nonlinear = np.zeros(0)
    if law.nonlinear:
        begin = None if near is None else near[list(law.nonlinear)]
        nonlinear = _search(equations.select(few), law, mass, begin)
    matrix, right = _rows(equations, law, mass, nonlinear)
    solution, _, _ = solve_scaled(matrix, right)
    residual = right - matrix @ solution
    values = _assemble(law, nonlinear, solution)
    if law.nonlinear:
        matrix = np.column_stack([matrix, _nonlinear_columns(equations, law, mass, nonlinear, solution)])
    _, inverse, null = solve_scaled(matrix, right)
    freedom = max(len(right) - matrix.shape[1], 1)
    covariance = inverse @ inverse.T * float(residual @ residual) / freedom
    order = [*law.linear, *([len(values)] if mass is None else []), *law.nonlinear]
    lost = np.abs(null).max(axis=1, initial=0.0) > 1e-3
    covariance[lost] = np.nan
    covariance[:, lost] = np.nan
    sorted_covariance = np.empty_like(covariance)
    sorted_covariance[np.ix_(order, order)] = covariance
    misfit = float(np.sqrt(residual @ residual / max(len(right), 1)))
    return LinearSolution(values, float(solution[-1]) if mass is None else mass, misfit, sorted_covariance)


def point_misfit(equations: Equations, law: ForceLaw, solution: LinearSolution) -> Array:
    """(n,) how far each point is from the solution, relative to its force."""
    linear = np.append(solution.values[list(law.linear)], solution.mass)
    bare = replace(equations, mean=False, turning=np.zeros((0, 2)))
    matrix, right = _rows(bare, law, None, solution.values[list(law.nonlinear)])
    misfit = right - matrix @ linear
    return np.asarray(np.hypot(*np.split(misfit, 2)))


def _assemble(law: ForceLaw, nonlinear: Array, solution: Array) -> Array:
    values = np.zeros(len(law.parameters))
    values[list(law.linear)] = solution[: len(law.linear)]
    values[list(law.nonlinear)] = nonlinear
    return values


@lru_cache(maxsize=2)
def _motion(equations: Equations, finer: int) -> tuple[Array, Array, Array]:
    """Displacement, velocity and acceleration (n, s): the same for every trial of the parameters."""
    count = equations.harmonics.shape[1]
    samples = max(_SAMPLES, 1 << (8 * (count - 1) - 1).bit_length()) * finer
    spectrum = np.zeros((len(equations.omega), samples // 2 + 1), dtype=complex)
    spectrum[:, :count] = equations.harmonics * (samples / 2)
    spectrum[:, 0] *= 2
    rate = 1j * equations.omega[:, None] * np.arange(samples // 2 + 1)
    x, v, a = (np.fft.irfft(spectrum * rate**power, samples) for power in range(3))
    return x, v, a


def _rows(
    equations: Equations, law: ForceLaw, mass: float | None, nonlinear: Array, *, coarse: bool = False
) -> tuple[Array, Array]:
    """Real, weighted rows: columns are the linear parameters, then the mass where it is free."""
    values = np.zeros(len(law.parameters))
    values[list(law.nonlinear)] = nonlinear
    omega = equations.omega[:, None]
    x, v, a = _motion(equations, _FINER if law.switched and not coarse else 1)
    samples = x.shape[1]
    sample = law.sample(x, v, a, 2 * np.pi / samples / omega, values)
    signals = [sample.by_parameter[i] for i in law.linear]
    turn = np.exp(-2j * np.pi * np.arange(samples) / samples) * (2 / samples)
    columns = [signal @ turn for signal in signals]
    inertia = equations.omega**2 * equations.harmonics[:, 1]
    right = equations.force - sample.force @ turn
    if mass is None:
        columns.append(-inertia)
    else:
        right = right + mass * inertia
    weight = equations.weight
    matrix = np.stack(columns, axis=1) * weight[:, None] if columns else np.zeros((len(right), 0))
    blocks = [matrix.real, matrix.imag]
    rights = [(right * weight).real, (right * weight).imag]
    free = [np.zeros(len(omega))] if mass is None else []
    if equations.mean:
        blocks.append(np.stack([s.mean(axis=1) for s in signals] + free, axis=1) * weight[:, None])
        rights.append(-sample.force.mean(axis=1) * weight)
    if len(equations.turning):
        block, balance = _turning_rows(equations, law, values)
        blocks.append(np.column_stack([block, *[column[: len(block)] for column in free]]))
        rights.append(balance)
    stacked, flat = np.concatenate(blocks), np.concatenate(rights)
    return stacked, flat


def _turning_rows(equations: Equations, law: ForceLaw, values: Array) -> tuple[Array, Array]:
    """Work of the spring between the turning points: zero for light damping."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    high, low = equations.turning[:, 0], equations.turning[:, 1]
    parts, works = [], []
    for end in (high, low):
        x = end[:, None] * (nodes + 1) / 2
        still = np.zeros_like(x)
        sample = law.sample(x, still, still, still, values)
        share = end[:, None] * weights / 2
        parts.append(np.stack([np.sum(sample.by_parameter[i] * share, axis=1) for i in law.linear], axis=1))
        works.append(np.sum(sample.force * share, axis=1))
    scale = (equations.weight / np.abs(equations.harmonics[:, 1]))[:, None]
    return (parts[0] - parts[1]) * scale, -(works[0] - works[1]) * scale[:, 0]


def _nonlinear_columns(
    equations: Equations, law: ForceLaw, mass: float | None, nonlinear: Array, solution: Array
) -> Array:
    columns = []
    for i in range(len(nonlinear)):
        step = np.zeros(len(nonlinear))
        step[i] = 1e-5 * max(abs(nonlinear[i]), 1e-300)
        high, low = (
            matrix @ solution - right
            for matrix, right in (
                _rows(equations, law, mass, nonlinear + step),
                _rows(equations, law, mass, nonlinear - step),
            )
        )
        columns.append((high - low) / (2 * step[i]))
    return np.stack(columns, axis=1)


def _search(equations: Equations, law: ForceLaw, mass: float | None, begin: Array | None) -> Array:
    """Search the parameters in which the law is not linear over the whole range where they change it."""
    count = len(law.nonlinear)
    some = np.unique(np.linspace(0, len(equations.omega) - 1, _SCANNED).round().astype(np.intp))
    scanned = equations.select(some)

    def residual(trial: Array, *, coarse: bool = False) -> Array:
        with np.errstate(all="ignore"):
            matrix, right = _rows(scanned if coarse else equations, law, mass, trial, coarse=coarse)
            # not finite, or soon: a negative power at x = 0, an overflow
            if not (np.max(np.abs(matrix), initial=0.0) < _HUGE and np.max(np.abs(right)) < _HUGE):
                return np.full(len(right), 1e100)
            solution, _, _ = solve_scaled(matrix, right)
            return np.asarray(right - matrix @ solution)

    if begin is not None and np.all(np.isfinite(begin) & (begin != 0)):
        return _polish(residual, begin)[0]
    windows = [_active_values(equations, law, i) for i in range(count)]
    trials = _trials(windows)
    costs = np.array([float(np.sum(residual(trial, coarse=True) ** 2)) for trial in trials])
    order = np.argsort(costs, kind="stable")
    best = trials[order[0]]
    lowest = float(np.sum(residual(best) ** 2))
    for start in _distinct(trials[order], windows):
        found, cost = _polish(residual, start)
        if cost < lowest * (1 - 1e-9):
            best, lowest = found, cost
    rest = residual(best, coarse=True)
    equal = float(rest @ rest) * (1 + _SIGNIFICANT / len(rest)) + len(rest) * _SOLVER**2
    candidates = np.flatnonzero(costs <= equal)
    for i in candidates[np.argsort(np.abs(trials[candidates]).max(axis=1), kind="stable")]:
        # as good without the switch ever acting: then the test does not tell it, and no number is to be found
        if _missing(equations, law, mass, trials[i]) > _missing(equations, law, mass, best):
            return np.asarray(trials[i])
    return np.asarray(best)


def _missing(equations: Equations, law: ForceLaw, mass: float | None, trial: Array) -> int:
    """How many directions the linear parameters do not tell at a trial."""
    matrix, right = _rows(equations, law, mass, trial)
    if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
        return 0
    return int(solve_scaled(matrix, right)[2].shape[1])


def _active_values(equations: Equations, law: ForceLaw, which: int) -> Array:
    """Values of one nonlinear parameter between which the law changes its shape; both signs."""
    some = equations.select(np.linspace(0, len(equations.omega) - 1, 8).round().astype(np.intp))
    generator = np.random.default_rng(which)
    size = np.logspace(-_DECADES, _DECADES, 2 * _DECADES * _PER_DECADE + 1)
    largest = float(np.abs(equations.harmonics).max())
    typical = [largest, 1.0, 1 / largest, largest * float(np.median(equations.omega))]
    active = np.zeros(2 * len(size), dtype=bool)
    values = np.concatenate([size, -size])
    for attempt in range(1 if len(law.nonlinear) == 1 else 4):
        others = np.full(len(law.nonlinear), typical[attempt] * generator.uniform(0.3, 0.7))
        last: Array | None = None
        for i, value in enumerate(values):
            others[which] = value
            with np.errstate(all="ignore"):
                shape = _rows(some, law, None, others, coarse=True)[0]
                norm = np.abs(shape).max(axis=0)
                shape = shape / np.where(norm > 0, norm, 1.0)
            finite = bool(np.all(np.isfinite(norm)) and norm.max() < _HUGE)
            if last is not None and i != len(size) and finite:
                active[i] |= bool(np.max(np.abs(np.abs(shape) - np.abs(last))) > 1e-3)
            last = shape if finite else None
    active |= np.concatenate([active[1:], [False]])  # both ends of an active interval
    chosen = values[active]
    if not len(chosen):
        return np.array(typical[:1])
    dense = []
    for sign in (1.0, -1.0):
        part = np.abs(chosen[chosen * sign > 0])
        if len(part):
            dense.append(sign * np.geomspace(part.min(), part.max(), 6 * len(part) + 1))
    return np.concatenate(dense)


def _trials(windows: list[Array]) -> Array:
    if len(windows) == 1:
        return windows[0][:, None]
    from scipy.stats import qmc

    points = qmc.Halton(len(windows), seed=1).random(_TRIALS)
    return np.stack(
        [
            window[(column * len(window)).astype(np.intp)]
            for window, column in zip(windows, points.T, strict=True)
        ],
        axis=1,
    )


def _distinct(ordered: Array, windows: list[Array]) -> list[Array]:
    """The best trials that are not neighbours of a better one."""
    ends: list[Array] = []
    for trial in ordered:
        near = any(
            np.all(np.abs(np.log(np.abs(trial / other))) < 0.15) and np.all(trial * other > 0)
            for other in ends
        )
        if not near:
            ends.append(trial)
        if len(ends) == _STARTS:
            break
    return ends


def _polish(residual: Callable[[Array], Array], start: Array) -> tuple[Array, float]:
    """Descend from one trial in the logarithms of the parameters; signs stay."""
    from scipy.optimize import least_squares

    sign = np.sign(start)

    def logarithmic(logs: Array) -> Array:
        return residual(sign * np.exp(logs))

    logs = np.log(np.abs(start))
    result = least_squares(
        logarithmic, logs, diff_step=[1e-5] * len(logs), x_scale=0.1, max_nfev=25, xtol=1e-10
    )
    return sign * np.exp(result.x), float(2 * result.cost)
