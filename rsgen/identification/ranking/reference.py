"""The motion along which candidates are compared: that of the best law so far, near the measured one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import (
    BRANCH,
    EXPECTED_NOISE,
    FEW,
    FLAT,
    FOLLOWED,
    MOVE,
    NOTICEABLE,
    ORDER,
    OUTLIERS,
    SIGMAS,
    TRIAL_STEPS,
)
from rsgen.data.free_mode import fit_mode, steady
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.settling import SteadyStates
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.identification.fitting.fit import Fit, fit_balance
from rsgen.identification.fitting.observed import Observed, Problem, neighbour_power
from rsgen.identification.fitting.simulator import go_on
from rsgen.identification.ranking.balance import (
    NEAR,
    ReferenceMotion,
    Rows,
    make_rows,
    measured_motion,
    predicted_motion,
)
from rsgen.identification.ranking.fitting import Fitted, Guess, fit_rows
from rsgen.law.element import Element
from rsgen.law.motion import Motion, feeds_exciter
from rsgen.law.numeric import ForceLaw

WAVEFORM = 31
"""Harmonics of the waveform along which laws with jumps and corners are compared."""

_ACCURACY = 3e-5
"""Of the simulated amplitude, far less than the least noise of a ranking."""

_CLEARLY = 0.7
"""Second differences smaller than this share of the first ones measure the noise better."""

_AGAIN = 2
"""Times that a law is fitted along its simulated motion, which then follows."""


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Points that a law can follow, and the balance along its motion.

    Parameters
    ----------
    chosen
        Indices of these points.
    motion
        Predicted, nearest to the measured.
    law, values, mass
        Whose motion it is.
    """

    chosen: NDArray[np.intp]
    motion: ReferenceMotion
    law: ForceLaw
    values: Array
    mass: float

    @property
    def named(self) -> dict[str, float]:
        """Values by name; the mass is "m"."""
        return {**dict(zip(self.law.parameters, self.values.tolist(), strict=True)), "m": self.mass}

    def rows(self, noise: Array) -> Rows:
        """Prepare the balance for relative noise (H+1,) of mean, fundamental and harmonics."""
        return make_rows(self.motion, self.law, self.values, self.mass, noise, balanced=True)

    def select(self, chosen: NDArray[np.intp]) -> Reference:
        """Keep some of the points chosen."""
        return replace(self, chosen=self.chosen[chosen], motion=self.motion.select(chosen))

    @property
    def feeds(self) -> bool:
        """Whether the structure works on the exciter."""
        return feeds_exciter(self.motion.force, self.motion.harmonics[:, 1])


def first_rows(observed: Observed, background: Array, law: ForceLaw, mass: float) -> Rows:
    """Prepare a first-order balance about the measured motion.

    Parameters
    ----------
    observed, background
        The measured points, and a background to start from.
    law
        The base, ``c*v + k*x``.
    mass
        [kg], NaN where it is free.
    """
    motion = measured_motion(observed, background)
    points = observed.points
    balance = steady(motion.force, motion.harmonics[:, 1], points.omega)
    found = fit_mode(*balance, np.ones((len(points), 1)), 1 / np.abs(motion.force), mass=mass)
    return make_rows(motion, law, found.values[[1, 0]], found.mass, np.ones(2), balanced=False)


def follow(observed: Observed, best: Guess, fixed: Mapping[str, float]) -> Reference | None:
    """Fit a candidate and its background to the measured waveforms.

    Parameters
    ----------
    observed
        The measured points.
    best
        The candidate, and the background to start from.
    fixed
        Names of parameters that stay at their values of the candidate.

    Returns
    -------
    Reference or None
        None where the candidate has no steady states near the measured ones.
    """
    law = best.law
    values = law.ordered(best.values)
    problem = Problem(best.elements, law, observed, fixed)
    place = problem.join(values, best.values["m"], best.background)
    found = fit_balance(problem, place, order=ORDER, reject=False, steps=TRIAL_STEPS)
    if law.rough and found.mass > 0 and _shared(found) < NEAR:
        exact = _simulated(best, found, fixed)
        if exact is not None:
            return exact
    chosen = np.flatnonzero(_followed(found))
    if len(chosen) < FOLLOWED * len(found.force):
        return None
    part = found.select(chosen)
    motion = predicted_motion(part.problem.observed, found.background, part.harmonics, part.force, part.turn)
    return Reference(chosen, motion, law, found.values, found.mass)


def _shared(found: Fit) -> float:
    """Root mean square of the relative misfit of the force that neighbours share, without extreme points."""
    points = found.problem.observed.mode(found.background)
    misfit = (points.force * np.exp(-1j * found.turn) - found.force) / np.abs(points.force)
    first, second = misfit[points.neighbours].T
    common = np.sort((first * np.conj(second)).real)
    common = common[np.isfinite(common)]
    # near sticking the balance of some points is far off for any law
    outer = int(OUTLIERS * len(common))
    common = common[outer : len(common) - outer]
    return float(np.sqrt(max(float(np.mean(common)), 0.0))) if len(common) else 0.0


def _followed(found: Fit) -> NDArray[np.bool_]:
    return np.asarray(
        found.regression.used & np.isfinite(found.harmonics).all(axis=1) & np.isfinite(found.force)
    )


def _simulated(best: Guess, found: Fit, fixed: Mapping[str, float]) -> Reference | None:
    """Take the simulated motion, all harmonics, of a law with jumps or corners; improve the law along it."""
    level = found.problem.observed.points.level
    reference = _hold(best.elements, found.values, found.mass, found.background, found)
    for _ in range(_AGAIN):
        if reference is None:
            return None
        noise = np.full(ORDER + 1, EXPECTED_NOISE)
        rows, inside = reference.rows(noise), reference.chosen
        guess = replace(best, values=reference.named)
        leader = fit_rows(guess, rows, level[inside], fixed)
        out = None if leader is None else outlying(leader, noise)
        if out is not None and out.any():
            agreeing = np.flatnonzero(~out)
            leader = fit_rows(guess, rows.select(agreeing), level[inside[agreeing]], fixed)
        if leader is None:
            return reference
        values = reference.law.ordered(leader.guess.values)
        inertia = leader.guess.values["m"]
        reference = _hold(best.elements, values, inertia, leader.guess.background, found) or reference
    return reference


def _hold(
    elements: tuple[Element, ...], values: Array, mass: float, background: Array, found: Fit
) -> Reference | None:
    """Simulate the points with the force that holds the measured amplitude; None where too few are held.

    The truncated balance only gives the state to start from: near sticking its amplitude is far off.
    """
    law, observed = found.problem.law, found.problem.observed
    points = observed.mode(background)
    good = _followed(found)
    wanted = points.amplitude
    drive: ComplexArray = points.force * np.exp(-1j * np.where(good, found.turn, 0.0))
    state = Motion(points.omega, found.harmonics).states()
    state[~good] = 0
    oscillator = Oscillator(mass, elements, dict(zip(law.parameters, values.tolist(), strict=True)))

    def solve(force: ComplexArray, start: Array) -> SteadyStates:
        return solve_steady_states(
            oscillator,
            force,
            points.omega / (2 * np.pi),
            harmonics=WAVEFORM,
            accuracy=_ACCURACY,
            start=start,
        )

    try:
        states = solve(drive, state)
        state = go_on(states, states.settled, state)
        moved = solve((1 + MOVE) * drive, state)
        # a point that does not settle, or sticks, has no amplitude: it keeps its force
        with np.errstate(divide="ignore", invalid="ignore"):
            growth = np.log(np.abs(moved.harmonics[:, 1] / states.harmonics[:, 1])) / np.log1p(MOVE)
            step = np.log(wanted / np.abs(states.harmonics[:, 1])) / np.where(growth > FLAT, growth, np.inf)
        # a longer step may end on another branch
        drive = drive * np.exp(np.clip(np.nan_to_num(step), -BRANCH, BRANCH)).astype(np.complex128)
        states = solve(drive, state)
    except RsgenError:
        return None
    near = np.abs(np.abs(states.harmonics[:, 1]) / wanted - 1) < NEAR
    chosen = np.flatnonzero(good & states.settled & near)
    if len(chosen) < FOLLOWED * len(points):
        return None
    # to a fundamental of phase zero
    lag = np.angle(states.harmonics[chosen, 1])
    harmonics = states.harmonics[chosen] * np.exp(-1j * lag)[:, None] ** np.arange(WAVEFORM + 1)
    drive, turn = drive[chosen] * np.exp(-1j * lag), found.turn[chosen] + lag
    motion = predicted_motion(observed.select(chosen), background, harmonics, drive, turn)
    return Reference(chosen, motion, law, values, mass)


def outlying(fitted: Fitted, noise: Array) -> NDArray[np.bool_]:
    """(n,) True for a few points that a law leaves far more of than of the others; none where they are many.

    Such a point shows a spike or a motion that the simulation misses, not a fault of the law.
    """
    size = np.abs(fitted.residual[:, fitted.compared])
    least = (NOTICEABLE / np.repeat(noise, 2)[1:])[fitted.compared]
    # the median of a normal deviate's size is 0.6745
    out = np.asarray((size > SIGMAS * np.maximum(np.median(size, axis=0) / 0.6745, least)).any(axis=1))
    return out if np.mean(out) <= FEW else np.zeros_like(out)


def neighbour_noise(
    residual: Array, pairs: NDArray[np.intp], compared: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Root mean square of mean, fundamental and harmonics (H+1,), and the part that neighbours do not share.

    Neighbours in frequency of one run share what a law leaves; noise they do not share. Where second
    differences are clearly smaller than first ones, the grid is coarse for the misfit: they tell the noise.
    Without neighbours nothing is compared: NaN.
    """
    if not len(pairs):
        unknown = np.full((residual.shape[1] + 1) // 2, np.nan)
        return unknown, unknown
    total, shared = neighbour_power(residual, pairs)
    apart = total - shared
    inner = np.flatnonzero(pairs[:-1, 1] == pairs[1:, 0])
    if len(inner):
        left, middle, right = (residual[rows] for rows in (*pairs[inner].T, pairs[inner + 1, 1]))
        twice = np.mean((left - 2 * middle + right) ** 2, axis=0) / 6
        apart = np.where(twice < _CLEARLY * apart, twice, apart)
    orders = np.repeat(np.arange((residual.shape[1] + 1) // 2), 2)[1:]
    result = []
    for power in (total, apart):
        power = np.where(compared, power, np.nan)
        result.append(np.sqrt([np.mean(power[orders == h]) for h in range(orders[-1] + 1)]))
    return result[0], result[1]
