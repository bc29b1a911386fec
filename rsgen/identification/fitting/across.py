"""Laws between two sensors, and their forward model along the motion that was measured.

The balance is written at the sensor of the response, F = m x'' + n(x, x') + n_a(z, z'): some elements follow
the response x, others the motion z across them. How z goes with x is measured at every point, and other modes
take part in it; so z is the measured motion, in proportion to the response, harmonics in the phase measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import GROUPS, ROUND_OFF, TAKEN, samples_for
from rsgen.data.oscillator import total_force
from rsgen.identification.fitting.descent import Descent
from rsgen.identification.fitting.forward import Response
from rsgen.identification.fitting.least_squares import Regression, eliminate
from rsgen.identification.fitting.points import Points
from rsgen.identification.fitting.problem import Problem
from rsgen.law.element import Element
from rsgen.law.motion import Motion, project
from rsgen.law.numeric import ForceLaw, ForceSample, Part, Waves, compile_law

__all__ = ["MeasuredAcross", "Pull", "law_of", "motions_of", "noise_of_ratio", "pull_of_noise"]


# ----------------------------------------------------------------------------
# What noise of two sensors does to a law that follows their difference.
#
# Least squares take the motion across as exact. It is a small difference of two sensors, and noise in a
# column
# of the balance pulls its value towards zero and the others (the mass, the spring beside the joint) after
# it:
# of many points N, a = N^-1 (N - S) a_true, where N is the matrix of the normal equations and S the part of
# it
# that noise alone makes (attenuation; Fuller, Measurement Error Models, Wiley 1987, chapter 2). Hence
# a_true - a = (N - S)^-1 S a, which is added. The noise is known from the test itself: its square to a
# third,
# so that a correction of several standard errors is not to be relied upon.

_BESIDE = 2
"""Points to either side through which a cubic is laid: what it misses of the middle one is noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Pull:
    """What noise of the motion across does to the values.

    Parameters
    ----------
    noise
        Of the two sensors, relative.
    share
        Largest share of noise in what the fit knows of a combination of values; from one on nothing is known.
    change
        (q,) what has to be added to the values, which noise pulled; zeros where too little is known.
    """

    noise: float
    share: float
    change: Array

    def taken_off(self, found: Regression) -> Regression:
        """Values without the pull, and errors that grow as much as the least known combination."""
        if not self.share < TAKEN:
            return found
        parameters = np.array(found.parameters)
        parameters[: len(self.change)] += self.change
        return replace(found, parameters=parameters, covariance=found.covariance / (1 - self.share) ** 2)


def pull_of_noise(problem: Problem, found: Regression, force_noise: Array | None) -> Pull | None:
    """Find how far noise pulls the values of a law across two sensors; None where that is not known.

    Parameters
    ----------
    problem, found
        A fit along the measured motion across.
    force_noise
        (n,) with which it weighed the points; None where it did not.
    """
    points, used = problem.observed.points, found.used
    if not problem.law.acts_across or points.across is None:
        return None
    noise = noise_of_ratio(points)
    whole, random = _rows(problem, found, force_noise, points.across), np.random.default_rng(0)
    normal = np.einsum("nmp,nmq->pq", whole[used], whole[used])
    size = np.sqrt(np.diag(normal))
    if not (np.isfinite(noise) and np.isfinite(size).all() and (size > 0).all()):
        return None
    part = np.zeros_like(normal)
    spread = noise * np.hypot(points.amplitude, np.abs(points.harmonics[:, 1] - points.across[:, 1]))
    for _ in range(GROUPS):
        moved, draw = np.array(points.across), random.standard_normal((2, len(points))) / np.sqrt(2)
        moved[:, 1] += spread * (draw[0] + 1j * draw[1])
        change = np.nan_to_num(_rows(problem, found, force_noise, moved) - whole)[used]
        part += np.einsum("nmp,nmq->pq", change, change) / GROUPS
    normal, part = (matrix / np.outer(size, size) for matrix in (normal, part))
    known, directions = np.linalg.eigh(normal)
    regular = known > ROUND_OFF * known[-1]
    inverse = directions[:, regular] / np.sqrt(known[regular])
    of_noise = inverse.T @ part @ inverse
    share = float(np.linalg.eigvalsh(of_noise)[-1])
    change = np.zeros(len(size))
    if share < TAKEN:
        pulled = inverse.T @ part @ (found.parameters[: problem.count] * size)
        change = inverse @ np.linalg.solve(np.eye(len(of_noise)) - of_noise, pulled) / size
    return Pull(noise, share, change)


def noise_of_ratio(points: Points) -> float:
    """Relative noise of the two sensors, from what of the ratio of their motions is not smooth; NaN: unknown.

    Along a run the ratio of the motion across to the response is smooth, whatever the law: what it differs by
    from a cubic through its neighbours is noise. Half of the differences are smaller than the median, which
    jumps and antiresonances do not move. Of the ratio 1 - far/near both sensors make far/near as noisy.
    """
    order = np.lexsort((points.omega, points.sweep, points.level))
    width = 2 * _BESIDE + 1
    if points.across is None or len(order) < width:
        return float("nan")
    rows = np.lib.stride_tricks.sliding_window_view(order, width)
    rows = rows[(points.level[rows] == points.level[rows[:, :1]]).all(axis=1)]
    rows = rows[(points.sweep[rows] == points.sweep[rows[:, :1]]).all(axis=1)]
    omega = points.omega[rows]
    rows = rows[(np.diff(omega, axis=1) > 0).all(axis=1)]
    if len(rows) < width:
        return float("nan")
    ratio, weights = points.across[:, 1] / points.harmonics[:, 1], _cubic(points.omega[rows])
    missed = np.abs(np.sum(weights * ratio[rows], axis=1)) ** 2
    expected = np.sum(weights**2 * 2 * np.abs(1 - ratio[rows]) ** 2, axis=1)
    # the square of a complex normal number of unit variance has the median ln 2
    return float(np.sqrt(np.median(missed / expected) / np.log(2)))


def _cubic(omega: Array) -> Array:
    """(n, 2 b + 1) weights of the middle one and, negative, of the cubic through the others there."""
    weights = np.ones_like(omega)
    beside = [i for i in range(omega.shape[1]) if i != _BESIDE]
    for i in beside:
        for j in beside:
            if i != j:
                weights[:, i] *= (omega[:, _BESIDE] - omega[:, j]) / (omega[:, i] - omega[:, j])
        weights[:, i] *= -1
    return weights


def _rows(problem: Problem, found: Regression, force_noise: Array | None, across: ComplexArray) -> Array:
    """(n, M, q) slopes by the parameters along a motion across (n, H+1) [m], nuisances eliminated."""
    mode = problem.observed.mode(found.parameters[problem.count :])
    free = problem.given is None
    forward = MeasuredAcross(problem.law, mode.motion, Motion(mode.omega, across), mass_free=free)
    forward.noise = force_noise
    line = Descent(problem, forward).linearise(found.parameters, found.nuisance)
    return eliminate(line)[1][:, :, : problem.count]


_STEP = 1e-6
"""Relative change of the amplitude by which the slope of a loop is taken: half the digits of a double."""


def law_of(elements: Sequence[Element], *, across: bool, means: tuple[bool, bool] = (True, True)) -> ForceLaw:
    """Compile the law of some elements; those across two sensors need a test that has their motion.

    Parameters
    ----------
    elements
        All of them.
    across
        Whether the test has a motion across two sensors.
    means
        Whether the mean of the response and that of the motion across were recorded.

    Raises
    ------
    RsgenError
        Elements act across two sensors and the motion across is not in the test, or the other way round; they
        act across several; or a law is not odd, whose mean across nobody recorded.
    """
    whole = compile_law(total_force(elements))
    labels = sorted({element.across for element in elements if element.across})
    if not across and not labels:
        return whole
    if len(labels) > 1:
        raise RsgenError(f"across: {', '.join(map(repr, labels))}; one pair of sensors is allowed in a law")
    if not across:
        raise RsgenError(f"across: an element acts across {labels[0]!r}; the test has no motion across")
    if not labels:
        raise RsgenError(
            "across: the test has a motion across two sensors, but no element follows it; say which ones do "
            '(across = "..." of the element)'
        )
    parts = []
    for acts, known in zip((False, True), means, strict=True):
        chosen = [element.force for element in elements if bool(element.across) == acts]
        law = compile_law(sympy.Add(*chosen))
        if not (law.odd or known):
            motion = f"motion across {labels[0]!r}" if acts else "response"
            raise RsgenError(
                f"across: the elements that follow the {motion} are not odd, and the mean of that motion was "
                "not recorded; displacements with their mean, or an odd law, are needed"
            )
        lost = ", ".join(name for name in law.parameters if name not in whole.parameters)
        if lost:
            raise RsgenError(
                f"across: {lost}: cancels in the sum of the elements; give it another name in the elements "
                "that act across"
            )
        places = np.array([whole.parameters.index(name) for name in law.parameters], dtype=np.intp)
        parts.append(Part(law, places, across=acts))
    # along motions that were measured with their mean nothing even is left to be found
    return replace(whole, odd=True, even=(), _parts=tuple(parts))


def motions_of(law: ForceLaw, followed: Motion, points: Points) -> tuple[Motion, ...]:
    """Motions of the parts of a law: of several the measured ones, of one that which is ``followed``."""
    if points.across is None or not law.acts_across:
        return (followed,)
    return points.motion, Motion(points.omega, points.across)


class MeasuredAcross:
    """Force at the response from a law across two sensors, along the measured motion across.

    It goes with the response in the proportion that was measured, as a prediction needs it, and a law that
    misses. Once its noise is weighed it is the one that was measured, whatever the response is taken to be.

    Parameters
    ----------
    law
        The force law.
    response, across
        As measured at the same points: of the mode, and across the elements.
    mass_free
        Whether the mass is a parameter.
    """

    harmonics: tuple[int, ...] = ()
    exact_slopes = True
    step = 1e-4
    """As that of the harmonic balance."""

    def __init__(self, law: ForceLaw, response: Motion, across: Motion, *, mass_free: bool) -> None:
        self._law, self._omega, self._mass_free = law, response.omega, mass_free
        self._columns = max(response.harmonics.shape[1], across.harmonics.shape[1])
        least = 1 << (8 * (self._columns - 1) - 1).bit_length()
        self.samples = max(samples_for(law.switched), least)
        self._step = response.interval(self.samples)
        self._measured = across.waveforms(self.samples)
        self._response, self._across = (
            _per_metre(motion, response.harmonics[:, 1]).waveforms(self.samples)
            for motion in (response, across)
        )
        self._near = response.harmonics[:, 1]
        sensors = self._near, self._near - across.harmonics[:, 1]
        self._sensors = [_sine(self._omega, motion, self.samples) for motion in sensors]
        self.noise: Array | None = None
        """(n,) noise of the force with that of the motion across, relative to its own; None: not weighed."""

    def weigh(self, values: Array, mass: float, force: Array) -> bool:
        """Follow the motion across as it was measured, and count its noise as the law at (p,) values does.

        The motion across is a difference of two sensors, near x and far, each with noise in proportion to
        its motion. Noise of the near one moves the balance F = D x + n_a by D + n_a', where the fit, to which
        the motion across is as measured, expects D; that of the far one by n_a'. What both add to the noise
        of the measured (n,) force |F| counts. The weights stay from here on: no value gains by larger ones.
        """
        self.noise, size, phase = np.ones(len(force)), np.abs(self._near), np.angle(self._near)
        own = self(values, mass, size, phase).force_slope * np.exp(1j * phase)
        near, far = (self._moved(values, motion) for motion in self._sensors)
        more = np.abs(own + near) ** 2 - np.abs(own) ** 2 + np.abs(far) ** 2
        self.noise = np.sqrt(1 + np.nan_to_num(np.maximum(more, 0.0) / force**2, posinf=0.0))
        return True

    def _moved(self, values: Array, motion: Waves) -> ComplexArray:
        """(n,) change of the force across with a part of the motion, by its logarithm."""
        high, low = (
            project(self._law.sample_parts((waves, waves), self._step, values)[1].force, 1)
            for waves in (_plus(self._measured, motion, sign * _STEP) for sign in (1, -1))
        )
        return np.asarray((high - low) / (2 * _STEP))

    def __call__(self, values: Array, mass: float, size: Array, phase: Array | None = None) -> Response:
        """Evaluate at (p,) values, a mass [kg], (n,) amplitudes [m] and phases [rad] of the response."""
        phase = None if self.noise is None else phase
        here, there = self._sample(values, size, phase)
        back = np.ones(len(size), dtype=complex) if phase is None else np.exp(-1j * phase)
        inertia = -(self._omega**2) * size
        joint = project(there.force, 1) * back
        force = project(here.force, 1) + joint + mass * inertia
        slope = mass * inertia + self._slope(here, there, values, size, phase)
        columns = [
            project(a, 1) + project(b, 1) * back
            for a, b in zip(here.by_parameter, there.by_parameter, strict=True)
        ]
        if self._mass_free:
            columns.append(inertia.astype(complex))
        force_by = np.stack(columns, axis=1) if columns else np.zeros((len(size), 0), dtype=complex)
        harmonics = np.zeros((len(size), self._columns), dtype=complex)
        harmonics[:, 1] = size
        none = np.zeros((*harmonics.shape, force_by.shape[1]), dtype=complex)
        valid = np.isfinite(force)
        made = Response(force, harmonics, slope, harmonics, force_by, none, valid)
        if phase is None:
            return made
        return replace(made, force_phase=-1j * joint, force_noise=self.noise)

    def _sample(self, values: Array, size: Array, phase: Array | None) -> tuple[ForceSample, ForceSample]:
        """Both parts of the law at amplitudes (n,) [m] of the response."""
        across = _times(self._across, size) if phase is None else self._measured
        here, there = self._law.sample_parts((_times(self._response, size), across), self._step, values)
        return here, there

    def _slope(
        self, here: ForceSample, there: ForceSample, values: Array, size: Array, phase: Array | None
    ) -> NDArray[np.complex128]:
        """(n,) derivative of the force of the law by the logarithm of the amplitude."""
        parts = [(here, self._response), *([(there, self._across)] if phase is None else [])]
        if not any(sample.by_memory for sample, _ in parts):
            total = np.zeros_like(here.force)
            for sample, motion in parts:
                x, v, _ = _times(motion, size)
                total += sample.by_x * x + sample.by_v * v
            return project(total, 1)
        # a loop changes with the whole motion before it
        high, low = (
            sum(
                (project(part.force, 1) for part in self._sample(values, size * factor, phase)[: len(parts)]),
                np.zeros(1, complex),
            )
            for factor in (1 + _STEP, 1 - _STEP)
        )
        return np.asarray((high - low) / (2 * _STEP))


def _sine(omega: Array, fundamental: ComplexArray, samples: int) -> Waves:
    """One period of sines (n,) [m]."""
    return Motion(omega, np.stack([np.zeros_like(fundamental), fundamental], axis=1)).waveforms(samples)


def _plus(motion: Waves, other: Waves, times: float) -> Waves:
    """Sum of two motions, the second ``times`` as large."""
    x, v, a = (one + times * two for one, two in zip(motion, other, strict=True))
    return x, v, a


def _per_metre(motion: Motion, fundamental: NDArray[np.complex128]) -> Motion:
    """The motion for a response of phase zero and amplitude 1 m."""
    return Motion(
        motion.omega, motion.turned(-np.angle(fundamental)).harmonics / np.abs(fundamental)[:, None]
    )


def _times(waves: Waves, size: Array) -> Waves:
    x, v, a = waves
    return x * size[:, None], v * size[:, None], a * size[:, None]
