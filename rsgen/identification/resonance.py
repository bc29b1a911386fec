"""The paper's way: the resonance of every level, mass from the inverse receptance, points of k(X), c(X).

Liu et al., Sec. 1.2. At the resonance the displacement lags a quarter period, so that Re F/X = k - m omega^2
vanishes: k(X) = m omega_n^2 and c(X) = 2 zeta m omega_n hold for the amplitude reached there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.data.free_mode import estimate_mass, steady
from rsgen.identification.fitting.fit import Solution
from rsgen.identification.fitting.points import Points
from rsgen.identification.fitting.repeats import JUMP
from rsgen.identification.results import Resonance
from rsgen.identification.starting.equations import Equations
from rsgen.identification.starting.start import solve_equations
from rsgen.law.numeric import ForceLaw

__all__ = ["find_resonances", "fit_resonances"]


_STEEP = np.cos(np.pi / 5)
"""Off a jump, neighbours differ in phase by less than this cosine says (36 degrees)."""

_NEAR = 0.6
"""Cotangent of a lag 30 degrees from a quarter period: a single point nearer is a resonance of its level."""

_BENT = 2.0
"""Re F/X that falls more times faster than the inertia alone takes the stiffness with it, as in a jump."""


def _neighbours(points: Points, run: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(len(run) - 1,) True where two neighbours lie on one smooth branch."""
    stiffness = points.force[run] / points.harmonics[run, 1]
    size = np.abs(points.harmonics[run, 1])
    ratio = size[1:] / size[:-1]
    turn = (stiffness[1:] * np.conj(stiffness[:-1])).real / np.abs(stiffness[1:] * stiffness[:-1])
    return np.asarray((ratio < JUMP) & (ratio > 1 / JUMP) & (turn > _STEEP))


def find_resonances(points: Points, mass: float) -> tuple[tuple[Resonance, ...], NDArray[np.float64]]:
    """Find the resonance of every level and sweep.

    Returns
    -------
    resonances
        Ascending in level; a level whose points do not reach the resonance has none.
    turning
        (r, 2) largest and smallest displacement [m] there.
    """
    stiffness = points.force / points.harmonics[:, 1]
    amplitude = points.amplitude
    found: list[Resonance] = []
    places: list[tuple[int, int, float]] = []
    for run in points.runs:
        held = np.abs(stiffness[run].real) < _NEAR * np.abs(stiffness[run].imag)
        place = _crossing(stiffness[run].real, amplitude[run], _neighbours(points, run), held)
        if place is None:
            continue
        near, other, share = place
        i, j = run[near], run[other]

        def blend(values: Array, i: int = i, j: int = j, share: float = share) -> float:
            return float(values[i] + share * (values[j] - values[i]))

        if near == other:
            square = float(points.omega[i] ** 2 + stiffness[i].real / mass)
            if square <= 0:
                continue
            omega = float(np.sqrt(square))
            damping = float(stiffness[i].imag / points.omega[i])
        else:
            omega = blend(points.omega)
            damping = blend(stiffness.imag / points.omega)
        found.append(
            Resonance(
                level=float(points.level[i]),
                sweep=str(points.sweep[i]),
                frequency=omega / (2 * np.pi),
                damping_ratio=damping / (2 * mass * omega),
                amplitude=blend(amplitude),
                stiffness=mass * omega**2,
                damping=damping,
                jump=near == other
                and len(run) > 1
                and not _reached(stiffness[run].real, points.omega[run], near, mass),
            )
        )
        places.append((int(i), int(j), share))
    return tuple(found), _turning(points, places)


def _turning(points: Points, places: list[tuple[int, int, float]]) -> Array:
    """(r, 2) largest and smallest displacement [m] between two points each, at a share of the way."""
    first, second = (np.array([place[side] for place in places], dtype=np.intp) for side in (0, 1))
    share = np.array([place[2] for place in places])[:, None]
    low, high = (
        np.where(np.isfinite(points.peak[rows]), points.peak[rows], points.motion.select(rows).peaks())
        for rows in (first, second)
    )
    return np.asarray(low + share * (high - low))


def _crossing(
    real: Array, size: Array, smooth: NDArray[np.bool_], held: NDArray[np.bool_]
) -> tuple[int, int, float] | None:
    """Where Re F/X passes zero: two neighbours and the share between them, or one point beside a jump.

    ``held`` says which points are at phase resonance as they are.
    """
    down = np.flatnonzero((real[:-1] > 0) & (real[1:] <= 0))
    if len(down):
        at = int(down[np.argmax(np.maximum(size[down], size[down + 1]))])
        if smooth[at]:
            return at, at + 1, float(real[at] / (real[at] - real[at + 1]))
        near = at if size[at] >= size[at + 1] else at + 1
        return near, near, 0.0
    if not len(size):
        return None
    if len(size) == 1 and held[0]:
        # one point of a phase-locked loop, or a level tested at its resonance alone
        return 0, 0, 0.0
    top = int(np.argmax(size))
    # the largest response of a run that does not reach the resonance determines it only from nearby
    interior = 0 < top < len(size) - 1
    return (top, top, 0.0) if interior else None


def _reached(real: Array, omega: Array, near: int, mass: float) -> bool:
    """Tell whether Re F/X passes zero beside a point and falls as the inertia alone would, or slower.

    Then the points lie far apart, but no jump is between them: that takes the stiffness with it.
    """
    for first in (near - 1, near):
        if first >= 0 and first + 1 < len(real) and real[first] > 0 >= real[first + 1]:
            inertia = mass * (omega[first + 1] ** 2 - omega[first] ** 2)
            return bool(real[first] - real[first + 1] < _BENT * inertia)
    return False


def _mass_of(points: Points) -> tuple[float, float]:
    """Mass and its standard error: slope of the inverse receptance over omega^2 at the same amplitude."""
    found = estimate_mass(*steady(points.force, points.harmonics[:, 1], points.omega))
    return (found.mass, found.mass_error) if found is not None and found.mass > 0 else (np.nan, np.nan)


def fit_resonances(
    points: Points, law: ForceLaw, given: float | None, near: Callable[[], Solution]
) -> tuple[Callable[[], Solution], tuple[Resonance, ...]]:
    """Find the resonance of every level, and say how to fit k(X) and c(X) of the law to them.

    ``near`` gives a solution where one is needed: for a mass that is not known, or a law that is not linear.
    """
    mass, mass_error = (given, 0.0) if given is not None else _mass_of(points)
    resonances, turning = find_resonances(points, mass if np.isfinite(mass) else near().mass)

    def fitted() -> Solution:
        omega = 2 * np.pi * np.array([r.frequency for r in resonances])
        size = np.array([r.amplitude for r in resonances])
        force = omega * np.array([r.damping for r in resonances]) * size
        good = force > 0
        if not (np.isfinite(mass) and good.any()):
            unknown = np.full(len(law.parameters) + (given is None), np.nan)
            return Solution(unknown[: len(law.parameters)], mass, np.diag(unknown), 1, np.nan)
        # harmonics without the mean say nothing of how far apart the turning points lie from zero
        turned = not law.odd and (0 in points.measured or bool(np.isfinite(points.peak).all()))
        equations = Equations(
            omega[good],
            1j * force[good],
            np.stack([np.zeros(good.sum()), size[good]], axis=1).astype(complex),
            False,
            1 / force[good],
            turning[good] if turned else np.zeros((0, 2)),
        )
        found = solve_equations(equations, law, mass, near=near().values if law.nonlinear else None)
        covariance = found.covariance + np.outer(found.values, found.values) * (mass_error / mass) ** 2
        values = np.where(np.isfinite(np.diag(covariance)), found.values, np.nan)
        if given is None:
            covariance = np.pad(covariance, (0, 1))
            covariance[-1, -1] = mass_error**2
        freedom = max(2 * int(good.sum()) - len(law.parameters), 1)
        return Solution(values, mass, covariance, freedom, found.misfit)

    return fitted, resonances
