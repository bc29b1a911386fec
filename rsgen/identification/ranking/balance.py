"""Balance of forces at a reference motion, whitened: linear in mass and coefficients for every candidate.

At a reference motion z0 near the measured one z, with harmonics X_h and the fundamental F of the force, the
balance of harmonic h is

    g_h = -m (h omega)^2 X_h + N_h(x, v) - F delta_h1,

and it changes with the measured harmonics and force by J (z - z0). The covariance of g is J S J' with S that
of the measurement. Multiplied by the inverse of its root every row has unit noise, whatever law is tried: the
errors-in-variables step of Britt and Luecke, The estimation of parameters in nonlinear, implicit models,
Technometrics 15 (1973). Laws can then be compared by linear least squares along one motion, without a
harmonic balance for each of them. J is that of the best law so far; harmonics that were not measured have a
large noise.

A background in the response moves z; its values join the rows linearly, so that every candidate has the
background that suits it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, Chosen, ComplexArray, blocks, take_rows
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import (
    ASSUMED_RELATIVE_NOISE,
    BALANCE_HARMONICS,
    COMPARISON_POINTS,
    POINTS_PER_BLOCK,
)
from rsgen.data.free_mode import fit_mode, steady
from rsgen.identification.fitting.across import across_of_mode, law_of
from rsgen.identification.fitting.observed import Observed
from rsgen.identification.fitting.points import FORCE, FUNDAMENTAL, OTHERS, Points
from rsgen.identification.ranking.library_sums import base_elements
from rsgen.law.element import response_share
from rsgen.law.motion import FourierSeries, Motion, fourier_series
from rsgen.law.normal_form import ForceSample
from rsgen.law.numeric import ForceLaw

MAX_MOTION_DISTANCE = 0.02
"""Relative distance of the reference motion from the measured one: its square is less than noise."""

_SAMPLES_A_PERIOD = 128

_NOISE_OF_UNMEASURED = 1e3
"""Noise of a harmonic that was not measured, in units of that of the fundamental."""

Trajectory = tuple[Array, Array, Array, Array]
"""x, v, a (motions, samples) and the sampling interval (motions, 1) [s]."""


class MotionAcross(NamedTuple):
    """The motion between two sensors that goes with a reference motion, at the same phases.

    Parameters
    ----------
    harmonics
        (n, J+1) complex displacement [m] along which elements are evaluated.
    size
        (n,) amplitude [m] of the second sensor.
    deviation
        (n, H+1) measured motion [m] of the second sensor minus this.
    share
        (n,) how much of the response is in the motion across.
    """

    harmonics: ComplexArray
    size: Array
    deviation: ComplexArray
    share: Array

    def select(self, chosen: Chosen) -> MotionAcross:
        """Keep some points."""
        return MotionAcross._make(part[chosen] for part in self)


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceMotion:
    """The motion about which the balance is linearised; phases relative to the fundamental.

    Parameters
    ----------
    harmonics
        (n, J+1) complex displacement [m] along which laws are evaluated.
    force
        (n,) complex [N].
    harmonics_deviation, force_deviation
        (n, H+1), (n,) measured values minus these; zero where a harmonic was not measured.
    measured
        (H+1,) mask of the measured harmonics; H is the highest harmonic of the balance.
    points
        The measured points; noise is relative to their amplitudes.
    receptance
        (n,) of the background [m/N].
    background
        (b,) values of the background.
    fundamental_by_background, force_by_background
        (n, b) derivatives of the fundamental and the force of the mode by these values.
    across
        The motion between two sensors; None without one.
    """

    harmonics: ComplexArray
    force: ComplexArray
    harmonics_deviation: ComplexArray
    force_deviation: ComplexArray
    measured: NDArray[np.bool_]
    points: Points
    receptance: ComplexArray
    background: Array
    fundamental_by_background: ComplexArray
    force_by_background: ComplexArray
    across: MotionAcross | None = None

    @property
    def order(self) -> int:
        """H, the highest harmonic of the balance."""
        return len(self.measured) - 1

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask (2H+1,) of the measured harmonics: mean, then real and imaginary parts.

        Without phases the imaginary part of the fundamental is the balance at a right angle to the force.
        """
        known = np.repeat(self.measured, 2)[1:]
        known[2] &= self.points.phase_known
        return known

    @property
    def background_effect(self) -> Array:
        """Root mean square relative change (b,) of the mode by the values of the background."""
        force = self.force_by_background / np.abs(self.force)[:, None]
        fundamental = self.fundamental_by_background / self.points.amplitude[:, None]
        return np.asarray(np.sqrt(np.mean(np.abs(force) ** 2 + np.abs(fundamental) ** 2, axis=0)))

    def select(self, chosen: Chosen) -> ReferenceMotion:
        """Keep some points."""
        part = take_rows(self, chosen, "measured", "background")
        across = self.across and self.across.select(chosen)
        return replace(part, points=self.points.select(chosen), across=across)

    def with_across(
        self, harmonics: ComplexArray, across: ComplexArray, share: float, far: ComplexArray | None = None
    ) -> ReferenceMotion:
        """Return the motion with one across two sensors, all but the fundamentals as measured.

        Parameters
        ----------
        harmonics, across
            (n, J+1) complex displacement [m] of the response and across.
        share
            How much of the response is in the motion across.
        far
            (n,) measured fundamental of the second sensor [m]; None: that of this motion.
        """
        deviation, far_deviation = np.zeros((2, len(across), 2), dtype=complex)
        deviation[:, 1] = self.harmonics_deviation[:, 1]
        second = across[:, 1] - share * harmonics[:, 1]
        far_deviation[:, 1] = 0 if far is None else far - second
        motion = MotionAcross(across, np.abs(second), far_deviation, np.full(len(across), share))
        own: dict[str, Any] = {
            "harmonics": harmonics,
            "harmonics_deviation": deviation,
            "measured": np.array([False, True]),
        }
        return replace(self, across=motion, **own)

    def trajectories(self, samples: int) -> tuple[Trajectory, ...]:
        """Return those of the response, and across two sensors if there is one."""
        followed = [self.harmonics] if self.across is None else [self.harmonics, self.across.harmonics]
        motions = [Motion(self.points.omega, harmonics) for harmonics in followed]
        return tuple((*motion.waveforms(samples), motion.interval(samples)) for motion in motions)


def predicted_motion(
    observed: Observed, background: Array, harmonics: ComplexArray, force: ComplexArray, turn: Array
) -> ReferenceMotion:
    """Return the motion that a fitted law predicts nearest to the measured one.

    Parameters
    ----------
    observed, background
        The measured points, and the background fitted with the law.
    harmonics, force
        (n, J+1) [m], (n,) [N] predicted, relative to a fundamental of phase zero.
    turn
        (n,) phase of the measured fundamental [rad] (``Fit``).
    """
    if not observed.points.phase_known:
        observed, turn = observed.with_phases(background, harmonics[:, 1], force), np.zeros(len(force))
    mode = observed.mode(background)
    rows = min(BALANCE_HARMONICS + 1, harmonics.shape[1])
    count = min(rows, mode.harmonics.shape[1])
    back = np.exp(-1j * turn)
    deviation = np.zeros((len(mode), rows), dtype=complex)
    turned = mode.harmonics[:, :count] * back[:, None] ** np.arange(count)
    deviation[:, :count] = turned - harmonics[:, :count]
    measured = np.isin(np.arange(rows), mode.measured)
    deviation[:, ~measured] = 0
    return ReferenceMotion(
        harmonics,
        force,
        deviation,
        mode.force * back - force,
        measured,
        observed.points,
        observed.background.receptance(background),
        background,
        *_mode_by_background(observed, background, turn),
    )


def _mode_by_background(
    observed: Observed, background: Array, turn: Array
) -> tuple[ComplexArray, ComplexArray]:
    """Return the derivatives (n, b) of fundamental and force of the mode, turned back, by the background."""
    shape = observed.background
    force = (observed.points.force * shape.turn(background) * np.exp(-1j * turn))[:, None]
    by_psi = np.zeros((len(turn), len(background)), dtype=complex)
    by_psi[:, :1] = 1j
    receptance = shape.receptance(background)[:, None]
    slopes = shape.slopes(background) * observed.fitted
    return -force * (slopes + receptance * by_psi), force * by_psi


@dataclass(frozen=True, slots=True, eq=False)
class WhitenedBalance(ABC):
    """The balance at a reference motion as rows of unit noise.

    The force of a law along the trajectory, an inertia, and a change of the background have to add up to
    ``right``. All three are linear maps. A point has r rows: real and imaginary part of each harmonic.

    Parameters
    ----------
    trajectories
        Those of the response, and across two sensors if some elements follow that motion.
    inertia
        (n, r) rows of a unit mass.
    right
        (n, r) right side.
    background
        (n, r, b) rows of changes of the background from ``background_at``.
    background_at
        (b,) values of the background at the motion.
    background_weight
        (b,) inverse standard errors with which these changes are known to be zero: so the reference stays
        within ``MAX_MOTION_DISTANCE``.
    compared
        (r,) False for rows whose harmonic was not measured, which only determine that harmonic.
    level
        (n,) level of each point.
    sensors
        Between which the second motion is.
    weighed
        Mass [kg] and its standard error, in units of the noise, where it was weighed; None where it was not.
    amplitudes_alone, odd_alone
        True if neither phases nor harmonics were recorded, and if neither the mean nor an even harmonic was.
    """

    trajectories: tuple[Trajectory, ...]
    inertia: Array
    right: Array
    background: Array
    background_at: Array
    background_weight: Array
    compared: NDArray[np.bool_]
    level: Array
    sensors: str = field(default="", kw_only=True)
    weighed: tuple[float, float] | None = field(default=None, kw_only=True)
    amplitudes_alone: bool = field(default=False, kw_only=True)
    odd_alone: bool = field(default=False, kw_only=True)
    _linear_laws: dict[tuple[ForceLaw, bool], tuple[Array, Array]] = field(default_factory=dict, kw_only=True)

    def __len__(self) -> int:
        return len(self.level)

    @property
    def few(self) -> WhitenedBalance:
        """The points that suffice to choose among sums."""
        return self

    @abstractmethod
    def project(self, forces: Array) -> Array:
        """Return the rows (n, r, j) of j forces (motions, samples, j) along the trajectory."""

    def motion_of(self, sensors: str) -> Trajectory:
        """Return the trajectory of elements between two sensors; "" for that of the response."""
        return self.trajectories[bool(sensors)]

    def of_law(self, law: ForceLaw, values: Array, sensors: str = "") -> tuple[Array, Array]:
        """Return the rows (n, r) of a law at values, and their slopes (n, r, q) by the values."""
        if law.nonlinear:
            return self._sample(law, values, sensors)
        key = law, bool(sensors)
        if key not in self._linear_laws:
            self._linear_laws[key] = self._sample(law, np.zeros(len(values)), sensors)
        constant, slopes = self._linear_laws[key]
        return constant + slopes @ values, slopes

    def _sample(self, law: ForceLaw, values: Array, sensors: str) -> tuple[Array, Array]:
        sample = law.sample(*self.motion_of(sensors), values)
        columns = self.of_forces(np.stack([sample.force, *sample.by_parameter], axis=-1))
        return columns[:, :, 0], columns[:, :, 1:]

    def of_forces(self, forces: Array) -> Array:
        """Return the rows (n, r, j) of j forces (motions, samples, j) along the trajectory."""
        # a trial may overflow: callers check for finite sums of squares
        with np.errstate(all="ignore"):
            return self.project(forces)


@dataclass(frozen=True, slots=True, eq=False)
class PointBalance(WhitenedBalance):
    """The balance of points of a sine test, a motion a point and 2H+1 rows.

    Parameters
    ----------
    matrices
        (n, compared rows, samples) map from a force along the trajectory to the rows that are compared.
    spread
        Some of the points, evenly over the amplitude.
    """

    matrices: Array
    spread: NDArray[np.intp]

    @property
    def few(self) -> PointBalance:
        """The points that suffice to choose among sums."""
        return self.select(self.spread)

    def project(self, forces: Array) -> Array:
        """Return the rows (n, 2H+1, j) of j forces (n, samples, j) along the trajectory; others are 0."""
        rows = np.zeros((len(forces), len(self.compared), forces.shape[2]))
        rows[:, self.compared] = self.matrices @ forces
        return rows

    def select(self, chosen: NDArray[np.intp]) -> PointBalance:
        """Keep some points."""
        part = take_rows(self, chosen, "background_at", "background_weight", "compared", "spread")
        along = tuple((x[chosen], v[chosen], a[chosen], step[chosen]) for x, v, a, step in self.trajectories)
        return replace(part, trajectories=along, spread=np.arange(len(chosen)), _linear_laws={})


def whiten_balance(
    motion: ReferenceMotion,
    law: ForceLaw,
    values: Array,
    mass: float,
    noise: Array,
    *,
    balanced: bool,
    sensors: str = "",
) -> PointBalance:
    """Linearise the balance at a motion and scale it to unit noise.

    Parameters
    ----------
    motion
        The reference motion.
    law, values, mass
        A law near the truth, whose tangent stiffness turns noise of the motion into noise of the force.
    noise
        (H+1,) relative noise of mean, fundamental (and force) and harmonics, that of complex numbers.
    balanced
        True if the motion is one of this very law. Its force along the waveform, with the inertia, then
        stands in place of the force of the motion, so that the error by a truncated waveform at jumps and
        corners cancels. False along the measured motion, whose noise is not known and ``noise`` is one: the
        weight with which the background stays near its values, and a mass near the one that was weighed, is
        then that of ``ASSUMED_RELATIVE_NOISE``.
    sensors
        Between which the motion has a second one.
    """
    width, count = 2 * motion.order + 1, len(motion.points)
    right, inertia = np.empty((count, width)), np.empty((count, width))
    background = np.empty((count, width, len(motion.background)))
    matrices = np.empty((count, np.count_nonzero(motion.known), _SAMPLES_A_PERIOD))
    trajectories = motion.trajectories(_SAMPLES_A_PERIOD)
    series = fourier_series(tuple(range(motion.order + 1)), _SAMPLES_A_PERIOD, half=False)
    for part in blocks(count, POINTS_PER_BLOCK):
        here = motion.select(part)
        along = [(x[part], v[part], a[part]) for x, v, a, _ in trajectories[: len(law.parts)]]
        samples = law.sample_parts(along, trajectories[0][3][part], values)
        unweighted, acceleration, jacobian, tangents_across = _linearised(
            here, samples, series, mass, balanced=balanced
        )
        root = _whitening(here, _covariance(here, jacobian, tangents_across, noise))
        background[part] = root @ -_change(jacobian, here.fundamental_by_background, here.force_by_background)
        right[part] = (root @ unweighted[:, :, None])[:, :, 0]
        inertia[part] = (root @ acceleration[:, :, None])[:, :, 0]
        matrices[part] = root[:, motion.known] @ series.project.T
    unit, weighed = 1.0 if balanced else ASSUMED_RELATIVE_NOISE, motion.points.weighed
    weight = motion.background_effect / MAX_MOTION_DISTANCE * unit
    return PointBalance(
        trajectories,
        inertia,
        right,
        background,
        motion.background,
        weight,
        motion.known,
        motion.points.level,
        matrices,
        motion.points.spread(COMPARISON_POINTS),
        sensors=sensors,
        weighed=weighed and (weighed[0], weighed[1] / unit),
        # rows: mean, Re 1, Im 1, Re 2, Im 2, ...; every fourth is of an even harmonic
        amplitudes_alone=not motion.known[2],
        odd_alone=not motion.known[::4].any(),
    )


def _linearised(
    here: ReferenceMotion,
    samples: Sequence[ForceSample],
    series: FourierSeries,
    mass: float,
    *,
    balanced: bool,
) -> tuple[Array, Array, Array, Sequence[Array]]:
    """Linearise n + m a = f about a motion z0: n + m a = f - J (z - z0).

    Returns
    -------
    right, acceleration, jacobian, tangents_across
        (n, 2H+1) right side f, and that of a unit mass; J (n, 2H+1, 2H+1), the dynamic stiffness of the law,
        and the tangents of what follows the second sensor.
    """
    omega = here.points.omega
    square = -((series.order_of * omega[:, None]) ** 2)
    jacobian, *tangents_across = (sample.tangent(series, omega) for sample in samples)
    followed = [] if here.across is None else list(zip([here.across], tangents_across, strict=False))
    for across, tangent in followed:
        jacobian += across.share[:, None, None] * tangent
    diagonal = np.arange(jacobian.shape[1])
    jacobian[:, diagonal, diagonal] += mass * square
    acceleration = square * series.real(here.harmonics[:, : here.order + 1])
    if balanced:
        own = np.sum([sample.force for sample in samples], axis=0)
        right = own @ series.project + mass * acceleration
    else:
        right = np.zeros(acceleration.shape)
        right[:, 1], right[:, 2] = here.force.real, here.force.imag
    right -= (jacobian @ series.real(here.harmonics_deviation)[:, :, None])[:, :, 0]
    for across, tangent in followed:
        right -= (tangent @ series.real(across.deviation)[:, :, None])[:, :, 0]
    right[:, 1] += here.force_deviation.real
    right[:, 2] += here.force_deviation.imag
    return right, acceleration, jacobian, tangents_across


def _change(jacobian: Array, fundamental: ComplexArray, force: ComplexArray) -> Array:
    """Return the change (n, 2H+1, j) of f - J z by j changes (n, j) of fundamental and force."""
    by = fundamental[:, None]
    change = -(jacobian[:, :, [1]] * by.real + jacobian[:, :, [2]] * by.imag)
    change[:, 1] += force.real
    change[:, 2] += force.imag
    return np.asarray(change)


def _covariance(motion: ReferenceMotion, jacobian: Array, joints: Sequence[Array], noise: Array) -> Array:
    """Return the covariance (n, 2H+1, 2H+1) of the balance for relative noise (H+1,) of the harmonics.

    A harmonic has ``noise`` times the ``Points.noise`` of its kind times the amplitude; the force
    ``noise[1]`` times its ``Points.noise`` times its size.

    ``joints`` are tangents of what follows the second sensor, whose noise is its own.
    """
    unmeasured = _NOISE_OF_UNMEASURED * float(noise[1])
    spread = np.where(np.repeat(motion.measured, 2)[1:], np.repeat(noise, 2)[1:], unmeasured) / np.sqrt(2)
    if not motion.points.phase_known:
        # the response is the origin of the phase, and that of the force is free
        spread[2] = 0.0
    relative = motion.points.noise
    spread = spread * relative[:, [OTHERS, FUNDAMENTAL, FUNDAMENTAL, *[OTHERS] * (len(spread) - 3)]]
    noisy = jacobian * (motion.points.amplitude[:, None] * spread)[:, None, :]
    covariance = noisy @ np.swapaxes(noisy, 1, 2)
    # noise of the force changes the mode as well: the background is a receptance times the measured force
    force = (motion.force * relative[:, FORCE])[:, None] * np.array([1, 1j]) * noise[1] / np.sqrt(2)
    force[:, 1] *= 1.0 if motion.points.phase_known else _NOISE_OF_UNMEASURED
    driven = _change(jacobian, -motion.receptance[:, None] * force, force)
    covariance += driven @ np.swapaxes(driven, 1, 2)
    if motion.across is not None:
        for joint in joints:
            noisy = joint * (motion.across.size[:, None] * noise[1] / np.sqrt(2))[:, None]
            covariance += noisy @ np.swapaxes(noisy, 1, 2)
        # the mean is as measured, and its balance is not asked
        covariance[:, 0] = covariance[:, :, 0] = np.eye(covariance.shape[1])[0]
    # the noise of unmeasured harmonics makes the matrix badly scaled: stay above round-off
    diagonal = np.arange(covariance.shape[1])
    covariance[:, diagonal, diagonal] *= 1 + 1e-9
    return np.asarray(covariance)


def _whitening(motion: ReferenceMotion, covariance: Array) -> Array:
    """Return the map (n, r, r) to unit noise; without phases the fundamental is turned to the force."""
    if motion.points.phase_known:
        return _inverse_root(covariance, motion.known)
    turn = np.tile(np.eye(covariance.shape[1]), (len(covariance), 1, 1))
    direction = motion.force / np.abs(motion.force)
    turn[:, 1, 1], turn[:, 1, 2] = direction.real, direction.imag
    turn[:, 2, 1], turn[:, 2, 2] = -direction.imag, direction.real
    return np.asarray(_inverse_root(turn @ covariance @ np.swapaxes(turn, 1, 2), motion.known) @ turn)


def _inverse_root(covariance: Array, known: NDArray[np.bool_]) -> Array:
    """Return the inverse Cholesky factor (n, r, r): unmeasured harmonics eliminated first, fundamental last.

    Each row is what its harmonic deviates given those before it, the fundamental given all others.
    """
    fundamental = np.isin(np.arange(len(known)), (1, 2))
    order = np.lexsort((fundamental, known))
    root = np.empty_like(covariance)
    ordered = covariance[:, order[:, None], order]
    try:
        root[:, order[:, None], order] = np.linalg.inv(np.linalg.cholesky(ordered))
    except np.linalg.LinAlgError:
        raise RsgenError("ranking: no candidate has forces that follow x and v near the test") from None
    return root


def measured_rows(observed: Observed, background: Array, mass: float, sensors: str) -> PointBalance:
    """Return a first-order balance about the measured motion.

    Parameters
    ----------
    observed, background
        The measured points, and a background to start from.
    mass
        Mass [kg]; NaN if it is free.
    sensors
        Between which elements act; "" where all follow the response.
    """
    points, mode = observed.points, observed.mode(background)
    phase = np.angle(mode.harmonics[:, 1])
    harmonics, force = mode.motion.turned(-phase).harmonics[:, :2], mode.force * np.exp(-1j * phase)
    motion = predicted_motion(observed, background, harmonics, force, phase)
    if sensors:
        across = across_of_mode(points.harmonics, mode.across, mode.harmonics, sensors)
        across = Motion(mode.omega, across).turned(-phase).harmonics
        motion = motion.with_across(harmonics, across, response_share(sensors))
    balance = steady(motion.force, motion.harmonics[:, 1], points.omega)
    found = fit_mode(*balance, np.ones((len(points), 1)), 1 / np.abs(motion.force), mass=mass)
    values = found.values[[1, 0]]
    law = law_of(tuple(base_elements("").values()))
    return whiten_balance(motion, law, values, found.mass, np.ones(2), balanced=False, sensors=sensors)
