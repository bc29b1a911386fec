"""Resonances of a test, the paper's method, and of an oscillator with known values.

At phase resonance the displacement lags a quarter period, so that Re F/X = k(X) - m omega^2 vanishes. With
the resonance frequency omega_n and the damping ratio zeta of each level,

    k(X) = m omega_n^2,    c(X) = Im F/X / omega_n = 2 zeta m omega_n

at the amplitude X reached there; the parameters of a law follow by linear least squares (Liu et al., Sec.
1.2). The mass is the slope of Re F/X over omega^2 at one amplitude.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.tolerances import ANY_LAW, MISFIT_EXPLAINED, RELATIVE_ERROR_DOUBTFUL, SAMPLES_PER_PERIOD
from rsgen.data.free_mode import estimate_mass, steady
from rsgen.data.oscillator import Model, Oscillator
from rsgen.data.surface.columns import MIN_TURN, monotone_runs
from rsgen.describing.derivation import derive
from rsgen.identification.fitting.fit import Fit, Solution
from rsgen.identification.fitting.points import Points, at_resonance_alone, mass_sure
from rsgen.identification.fitting.repeats import MIN_JUMP_RATIO
from rsgen.identification.modal_result import ModalTable
from rsgen.identification.results import EquivalentCurve, Estimate, Identification, Resonance
from rsgen.identification.starting.equations import Equations
from rsgen.identification.starting.start import solve_equations
from rsgen.law.motion import harmonics_of, sine_motion
from rsgen.law.numeric import ForceLaw

if TYPE_CHECKING:
    from rsgen.identification.prediction.prediction_result import ResonanceCurve

_MIN_COSINE_OF_STEP = np.cos(np.pi / 5)
"""Cosine of the phase difference of neighbours, 36 degrees, below which a jump is between them."""

_MAX_COTANGENT = 0.6
"""Cotangent of a lag 30 degrees off a quarter period, within which a single point is a resonance."""

_MAX_FALL_TO_INERTIA = 2.0
"""Fall of Re F/X between neighbours, relative to that by inertia, beyond which a jump is between them."""


def _smooth_steps(points: Points, run: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return the mask (len(run) - 1,) of neighbours on one smooth branch."""
    stiffness = points.force[run] / points.harmonics[run, 1]
    size = np.abs(points.harmonics[run, 1])
    ratio = size[1:] / size[:-1]
    turn = (stiffness[1:] * np.conj(stiffness[:-1])).real / np.abs(stiffness[1:] * stiffness[:-1])
    return np.asarray((ratio < MIN_JUMP_RATIO) & (ratio > 1 / MIN_JUMP_RATIO) & (turn > _MIN_COSINE_OF_STEP))


def find_resonances(points: Points, mass: float) -> tuple[tuple[Resonance, ...], NDArray[np.float64]]:
    """Find the resonance of every level and sweep.

    Returns
    -------
    resonances
        Ascending in level; none for a level whose points do not reach the resonance.
    turning
        (r, 2) largest and smallest displacement [m] at the resonances.
    """
    stiffness = points.force / points.harmonics[:, 1]
    amplitude = points.amplitude
    found: list[Resonance] = []
    places: list[tuple[int, int, float]] = []
    for run in points.runs:
        at_resonance = np.abs(stiffness[run].real) < _MAX_COTANGENT * np.abs(stiffness[run].imag)
        place = _crossing(stiffness[run].real, amplitude[run], _smooth_steps(points, run), at_resonance)
        if place is None:
            continue
        near, other, share = place
        i, j = run[near], run[other]
        columns = points.omega, stiffness.imag / points.omega, amplitude
        omega, damping, size = (float(of[i] + share * (of[j] - of[i])) for of in columns)
        if near == other:
            square = float(omega**2 + stiffness[i].real / mass)
            if square <= 0:
                continue
            omega = float(np.sqrt(square))
        jump = near == other and len(run) > 1
        jump = jump and not _passes_smoothly(stiffness[run].real, points.omega[run], near, mass)
        # the side from which a sweep came to the jump is the one without the resonance
        before = near + {"up": -1, "down": 1}.get(str(points.sweep[i]), 0)
        across = 0 <= before < len(run) and (stiffness[run[before]].real > 0) != (stiffness[i].real > 0)
        landed = jump and across
        found.append(
            Resonance(
                level=float(points.level[i]),
                sweep=str(points.sweep[i]),
                frequency=omega / (2 * np.pi),
                damping_ratio=damping / (2 * mass * omega),
                amplitude=size,
                stiffness=mass * omega**2,
                damping=damping,
                jump=jump,
                reached=not landed and (len(run) < 3 or 0 < int(np.argmax(amplitude[run])) < len(run) - 1),
            )
        )
        places.append((int(i), int(j), share))
    return tuple(found), _turning_points(points, places)


def _turning_points(points: Points, places: list[tuple[int, int, float]]) -> Array:
    """Return largest and smallest displacement (r, 2) [m], interpolated between two points."""
    first, second = (np.array([place[side] for place in places], dtype=np.intp) for side in (0, 1))
    share = np.array([place[2] for place in places])[:, None]
    low, high = (
        np.where(np.isfinite(points.peak[rows]), points.peak[rows], points.motion.select(rows).peaks())
        for rows in (first, second)
    )
    return np.asarray(low + share * (high - low))


def _crossing(
    real: Array, size: Array, smooth: NDArray[np.bool_], at_resonance: NDArray[np.bool_]
) -> tuple[int, int, float] | None:
    """Return the two neighbours between which Re F/X passes zero, and the share of the way.

    At a jump both are the point of larger amplitude. ``at_resonance`` marks points at phase resonance.
    """
    down = np.flatnonzero((real[:-1] > 0) & (real[1:] <= 0))
    if len(down):
        at = int(down[np.argmax(np.maximum(size[down], size[down + 1]))])
        if smooth[at]:
            return at, at + 1, float(real[at] / (real[at] - real[at + 1]))
        near = at if size[at] >= size[at + 1] else at + 1
        return near, near, 0.0
    # one point of a phase-locked loop
    return (0, 0, 0.0) if len(size) == 1 and at_resonance[0] else None


def _passes_smoothly(real: Array, omega: Array, near: int, mass: float) -> bool:
    """Return True if Re F/X passes zero next to a point, and falls at most about as fast as by inertia alone.

    The points are then far from each other, but no jump, which changes the stiffness, is between them.
    """
    for first in (near - 1, near):
        if first >= 0 and first + 1 < len(real) and real[first] > 0 >= real[first + 1]:
            inertia = mass * (omega[first + 1] ** 2 - omega[first] ** 2)
            return bool(real[first] - real[first + 1] < _MAX_FALL_TO_INERTIA * inertia)
    return False


def _estimate_mass(points: Points) -> tuple[float, float]:
    """Return mass and standard error: slope of the inverse receptance over omega^2 at one amplitude."""
    found = estimate_mass(*steady(points.force, points.harmonics[:, 1], points.omega))
    return (found.mass, found.mass_error) if found is not None and found.mass > 0 else (np.nan, np.nan)


def fit_resonances(
    points: Points, law: ForceLaw, fixed: Mapping[str, float], near: Callable[[], Solution]
) -> tuple[Callable[[], Solution], tuple[Resonance, ...]]:
    """Return a function that fits k(X) and c(X) of the law to the resonances, and the resonances.

    ``near`` returns an approximate solution, for an unknown mass or a law that is not linear in parameters.
    """
    mass, mass_error = points.weighed or ((fixed["m"], 0.0) if "m" in fixed else _estimate_mass(points))
    resonances, turning = find_resonances(points, mass if np.isfinite(mass) else near().mass)

    def fitted() -> Solution:
        omega = 2 * np.pi * np.array([r.frequency for r in resonances])
        size = np.array([r.amplitude for r in resonances])
        force = omega * np.array([r.damping for r in resonances]) * size
        good = force > 0
        if not (np.isfinite(mass) and good.any()):
            unknown = np.full(len(law.parameters), np.nan)
            return Solution(unknown, mass, np.diag(np.append(unknown, mass_error)), 1, np.nan)
        # the turning points of an asymmetric motion need its mean
        turned = not law.odd and (0 in points.measured or bool(np.isfinite(points.peak).all()))
        sine = sine_motion(omega[good], size[good]).harmonics
        equations = replace(
            Equations.plain(omega[good], 1j * force[good], sine),
            turning=turning[good] if turned else np.zeros((0, 2)),
            others=(sine,) * (len(law.parts) - 1),
        )
        known = {**fixed, "m": mass}
        found = solve_equations(equations, law, known, near=near().values if law.nonlinear else None)
        covariance = found.covariance
        covariance[:-1, :-1] += np.outer(found.values, found.values) * (mass_error / mass) ** 2
        covariance[-1, -1] = mass_error**2
        # no one amplitude is that of a law across two sensors at a resonance
        known_values = np.isfinite(np.diag(covariance)[:-1]) & (not law.acts_across)
        values = np.where(known_values, found.values, np.nan)
        freedom = max(2 * int(good.sum()) - len(law.parameters), 1)
        return Solution(values, mass, covariance, freedom, found.sigma)

    return fitted, resonances


def resonance_findings(
    points: Points, fixed: Mapping[str, float], law: ForceLaw, estimates: Sequence[Estimate], noise: float
) -> tuple[Finding, ...]:
    """Find that an identified mass has no good basis, because all points have the lag of resonance.

    A law with memory determines the mass by the area of its loops, and a fixed stiffness by itself; otherwise
    the mass follows from errors of the lag only.
    """
    if "m" in fixed or not at_resonance_alone(points, noise):
        return ()
    numbers = quantities(points=len(points))
    if law.remembers:
        return (Finding("mass-at-resonance", "warning", "m", numbers, {"by": "loops"}),)
    mass = estimates[-1]  # where it is not fixed
    if mass_sure(mass.value, mass.standard_error**2):
        return ()
    return (Finding("mass-at-resonance", "doubt", "m", numbers),)


def branch_findings(points: Points, fit: Fit, unit: str) -> list[Finding]:
    """Find a sweep that jumps to a larger motion where, by the law, the smaller one goes on; none or one.

    It goes on where motions between both need more than the force, on the side of resonance of the smaller.
    Where the frequency turns in the order of the rows, another sweep begins. ``unit`` is that of a level.
    """
    law, share, parts = fit.problem.law, np.linspace(0, 1, 33), list[tuple[NDArray[np.intp], str]]()
    # a sine has not the mean that an asymmetric law gives the motion
    if law.acts_across or not law.odd or fit.regression.rms_misfit > MISFIT_EXPLAINED:
        return []
    for rows in map(np.sort, reversed(points.runs)):
        turns = monotone_runs(points.omega[rows], MIN_TURN)
        parts += [(rows[start:stop], told) for start, stop, told in turns]
    for run, told in parts:
        way = str(points.sweep[run[0]])
        order = run[np.argsort(points.omega[run])][:: -1 if way == "down" else 1]
        size, force = points.amplitude[order], np.abs(points.force[order])
        rise = size[1:] / size[:-1]
        at = int(np.argmax(rise)) if len(rise) else 0
        # further on, near the upward jump, little more than the force is needed
        here = slice(at, at + 3)
        held = np.ptp(force) < RELATIVE_ERROR_DOUBTFUL * force.max()
        if way == "rest" or len(size[here]) < 3 or rise[at] < MIN_JUMP_RATIO or not held:
            continue
        sizes = (size[at] + np.outer(size[here] - size[at], share)).ravel()
        sine = sine_motion(np.repeat(points.omega[order[here]], len(share)), sizes)
        spring = harmonics_of(law.along(sine, fit.values, SAMPLES_PER_PERIOD).force, 2)[:, 1]
        needed = (spring - fit.mass * sine.omega**2 * sizes).reshape(3, -1)
        same_side = needed.real * needed[0, 0].real > 0
        between = np.where(same_side, np.abs(needed), 0)[1:].max(axis=1)
        if np.all(between > (1 + RELATIVE_ERROR_DOUBTFUL) * force[here][1:]):
            numbers = {"level": Quantity(float(points.level[run[0]]), unit)}
            numbers |= quantities("Hz", frequency=float(points.omega[order[at + 1]]) / (2 * np.pi))
            names = {"by": "branch", "sweep": way, "rows": told}
            return [Finding("direction-from-branch", "doubt", "", numbers, names)]
    return []


def contradicted_sweep(curve: ResonanceCurve, run: Points, top: int, way: str) -> tuple[Finding, ...]:
    """Find that a run swept one way leaves the upper branch where a sweep the other way meets it.

    ``top`` is its largest point, and in ``way`` the peak; a jump is known up to a step of the frequency.
    """
    frequency, sense = run.omega / (2 * np.pi), 1 if way == "up" else -1
    beyond = (frequency - frequency[top]) * sense
    step = float(beyond[beyond > 0].min(initial=inf))
    for jump in curve.jumps if set(run.sweep) == {way} else ():
        near = -step / 2 <= (jump.frequency - frequency[top]) * sense <= 2 * step < inf
        if near and run.amplitude[top] > jump.amplitude and jump.sweep != way:
            fold = {"level": Quantity(curve.level, curve.level_unit), "fold": Quantity(jump.frequency, "Hz")}
            return (Finding("direction-from-branch", "warning", "", fold, {"by": "jump", "sweep": way}),)
    return ()


# ----------------------------------------------------------------------------
# An oscillator with known values, as an identification at its resonances that can be predicted.

_AMPLITUDES = np.geomspace(1e-12, 1e3, 601)
"""Amplitudes [m] among which the resonances of an oscillator are sought."""

_FREQUENCY_ITERATIONS = 4

_FLANK_AMPLITUDE = 1e-2
"""Smallest amplitude of a curve relative to that of the resonance."""

HALF_WIDTHS = 8.0
"""Half widths of the resonance on both sides of a curve."""

_MIN_RELATIVE_WIDTH = 0.1
"""Least width on both sides, relative to the frequency."""


def as_identification(oscillator: Oscillator, levels: Sequence[float]) -> Identification:
    """Return an oscillator as an identification without errors, over the amplitudes of its resonances."""
    values = oscillator.values
    estimates = tuple(Estimate(name, value, 0.0, (value, value)) for name, value in values.items())
    amplitudes, frequencies = _resonant_ranges(oscillator, levels)
    empty = np.zeros(0)
    return Identification(
        model=Model(oscillator.elements, oscillator.mass),
        refined=estimates,
        covariance=np.zeros((len(values), len(values))),
        curve=EquivalentCurve(*(empty,) * 5, empty.astype(bool)),
        residual=0.0,
        noise=0.0,
        levels=np.array(levels),
        amplitude_range=amplitudes,
        frequency_range=frequencies,
    )


def table_as_identification(table: ModalTable) -> Identification:
    """Return a modal table as an identification with ranges, levels, background, misfit and mass.

    Raises
    ------
    RsgenError
        The mass is not known, so that responses off resonance cannot be predicted.
    """
    if "damping_ratio" not in table.known:
        raise RsgenError(
            "predict: the modal table has no mass, so that responses off resonance do not follow; give the "
            "mass to modal_table, or measure off resonance"
        )
    empty = np.zeros(0)
    test = table.test
    return Identification(
        model=Model(ANY_LAW, observation=test.observation),
        refined=(Estimate("m", table.splines.mass, 0.0, (table.splines.mass,) * 2, "kg"),),
        covariance=np.zeros((1, 1)),
        curve=EquivalentCurve(*(empty,) * 5, empty.astype(bool), test.level_unit, test.units, test.base),
        residual=table.misfit,
        noise=table.misfit,
        levels=test.levels,
        amplitude_range=table.tested,
        frequency_range=test.frequencies,
        solution=np.zeros(len(Model(ANY_LAW).parameters)),
        background=test.background,
    )


def _resonant_ranges(
    oscillator: Oscillator, levels: Sequence[float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ranges of amplitude [m] and frequency [Hz] of the resonances, to first order."""
    function = derive(oscillator.force)
    # each loop of states takes milliseconds
    sizes = _AMPLITUDES[::4] if function.memory else _AMPLITUDES
    omega = np.ones_like(sizes)
    for _ in range(_FREQUENCY_ITERATIONS):
        with np.errstate(all="ignore"):
            first = function.evaluate(sizes, omega, oscillator.values, closing=False)
            stiffness, damping = np.asarray(first.stiffness), np.asarray(first.damping)
            closes = np.isfinite(stiffness) | (not function.memory)
            sizes, stiffness, damping = sizes[closes], stiffness[closes], damping[closes]
            omega = np.sqrt(np.where(stiffness > 0, stiffness, np.nan) / oscillator.mass)
            omega = np.where(np.isfinite(omega), omega, 1.0)
    with np.errstate(all="ignore"):
        force = damping * omega * sizes
    known = np.isfinite(force) & np.isfinite(stiffness) & (stiffness > 0)
    reached = known & (force <= max(levels))
    if reached[known][-1:].all():
        end = f", whose memory has a loop up to {sizes[-1]:.3g} m," if function.memory and len(sizes) else ""
        raise RsgenError(
            f"predict: the resonance under {max(levels):g} N has no end; the law{end} needs damping, and a "
            "stiffness that stays positive"
        )
    largest = float(sizes[reached][-1]) if reached.any() else float(sizes[known][0])
    small = known & (force <= min(levels))
    smallest = float(sizes[small][-1]) if small.any() else largest
    chosen = known & (largest >= sizes) & (smallest * _FLANK_AMPLITUDE <= sizes)
    width = float(np.max(damping[chosen])) / (2 * oscillator.mass)
    low, high = float(np.min(omega[chosen])), float(np.max(omega[chosen]))
    around = max(HALF_WIDTHS * width, _MIN_RELATIVE_WIDTH * high)
    ends = (max(low - around, _MIN_RELATIVE_WIDTH * low), high + around)
    return (smallest * _FLANK_AMPLITUDE, largest), (ends[0] / (2 * np.pi), ends[1] / (2 * np.pi))
