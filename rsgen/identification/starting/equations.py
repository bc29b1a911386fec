"""The first-order balance as linear equations, for initial values.

With N_j(q) the fundamental of the force that parameter p_j multiplies along the measured motion,

    sum_j p_j N_j(q) - m omega^2 X = F

at every point, that is F/X = k(X) - m omega^2 + i omega c(X, omega). The equations are linear in all but a
few parameters q, and in the common factor of groups of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.tolerances import (
    MIN_SHARE_PREDICTED,
    POINTS_PER_BLOCK,
    SAMPLES_PER_PERIOD,
    SAMPLES_PER_PERIOD_SWITCHED,
)
from rsgen.identification.fitting.points import Points
from rsgen.law.motion import Motion, project
from rsgen.law.normal_form import ForceSample
from rsgen.law.numeric import ForceLaw, Waves

_SAMPLES_FACTOR_OF_LOOPS = 2
"""Samples of a law with memory, relative to ``SAMPLES_PER_PERIOD``; its loops are expensive."""


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
        True if the mean of the force must vanish, too.
    weight
        (n,) weight of each point [1/N].
    turning
        (t, 2) largest and smallest displacement [m] of points whose energy at both turning points must be
        equal (the paper's k6 Xp^2 = k7 Xn^2); empty without this condition.
    others
        (n, H+1) complex displacement [m] of each motion other than the response.
    """

    omega: Array
    force: ComplexArray
    harmonics: ComplexArray
    mean: bool
    weight: Array
    turning: Array
    others: tuple[ComplexArray, ...] = ()

    @classmethod
    def plain(cls, omega: Array, force: ComplexArray, harmonics: ComplexArray) -> Equations:
        """Return those of the fundamental alone, each relative to its force."""
        return cls(omega, force, harmonics, False, 1 / np.abs(force), np.zeros((0, 2)))

    @classmethod
    def along(cls, points: Points, law: ForceLaw, order: int) -> Equations:
        """Return those along measured motions up to a harmonic, and of the mean where it was recorded."""
        found = cls.plain(points.omega, points.force, points.harmonics[:, : order + 1])
        others = tuple(points.across[:, : order + 1] for _ in points.far.T)
        return replace(found, mean=not law.odd and 0 in points.measured, others=others)

    @property
    def motions(self) -> tuple[ComplexArray, ...]:
        """Displacement (n, H+1) [m] of each motion; the last one is that across a joint."""
        return self.harmonics, *self.others

    def select(self, chosen: NDArray[np.intp]) -> Equations:
        """Keep some points."""
        columns = ("omega", "force", "harmonics", "weight", *["turning"] * bool(len(self.turning)))
        others = tuple(other[chosen] for other in self.others)
        return replace(self, others=others, **{name: getattr(self, name)[chosen] for name in columns})


@lru_cache(maxsize=4)
def _motion(equations: Equations, finer: int, motion: int) -> Waves:
    """Return displacement, velocity and acceleration (n, s), the same for every trial of the parameters."""
    count = equations.harmonics.shape[1]
    samples = max(SAMPLES_PER_PERIOD, 1 << (8 * (count - 1) - 1).bit_length()) * finer
    return Motion(equations.omega, equations.motions[motion]).waveforms(samples)


def equation_rows(
    equations: Equations, law: ForceLaw, nonlinear: Array, *, scaled: bool = False, coarse: bool = False
) -> tuple[Array, Array]:
    """Return real, weighted rows  matrix @ unknowns = right.

    Parameters
    ----------
    equations, law
        Data and model.
    nonlinear
        Values of the parameters in which the law is not linear.
    scaled
        True if the common factor of every group of ``law.scaled`` is an unknown, too.
    coarse
        True for fewer samples.

    Returns
    -------
    matrix, right
        Columns are the linear parameters, the factors if ``scaled``, the mass.
    """
    (sample,) = _samples(equations, law, [nonlinear], coarse=coarse)
    return _rows(equations, law, nonlinear, sample, scaled=scaled)


def known_rows(matrix: Array, right: Array) -> NDArray[np.bool_]:
    """Return the rows without those of loops that do not close; all where too few are left for a start."""
    finite: NDArray[np.bool_] = np.isfinite(right) & np.isfinite(matrix).all(axis=1)
    return finite if finite.mean() > MIN_SHARE_PREDICTED else np.ones_like(finite)


def rows_of_trials(
    equations: Equations, law: ForceLaw, trials: Sequence[Array] | Array, *, coarse: bool = True
) -> list[tuple[Array, Array]]:
    """Return ``equation_rows`` with factors for many values of the nonlinear parameters.

    Hysteresis loops of many trials are closed at once, for speed.
    """
    block = max(1, POINTS_PER_BLOCK // len(equations.omega)) if law.remembers else 1
    rows = []
    for low in range(0, len(trials), block):
        part = trials[low : low + block]
        samples = _samples(equations, law, part, coarse=coarse)
        rows += [
            _rows(equations, law, trial, sample, scaled=True)
            for trial, sample in zip(part, samples, strict=True)
        ]
    return rows


def _samples(
    equations: Equations, law: ForceLaw, trials: Sequence[Array] | Array, *, coarse: bool
) -> list[ForceSample]:
    """Sample the law along all motions, for each trial."""
    omega = equations.omega[:, None]
    finer = _SAMPLES_FACTOR_OF_LOOPS if law.remembers else SAMPLES_PER_PERIOD_SWITCHED // SAMPLES_PER_PERIOD
    finer = finer if law.switched and not coarse else 1
    motions = [_motion(equations, finer, place) for place in range(len(law.parts))]
    step = 2 * np.pi / motions[0][0].shape[1] / omega
    values = np.zeros((len(trials), len(law.parameters)))
    values[:, list(law.nonlinear)] = trials
    if len(trials) == 1:
        return [_joined(law.sample_parts(motions, step, values[0]))]
    many, count = len(trials), len(omega)
    motions = [(np.tile(x, (many, 1)), np.tile(v, (many, 1)), np.tile(a, (many, 1))) for x, v, a in motions]
    columns = np.repeat(values, count, axis=0).T[:, :, None]
    joined = _joined(law.sample_parts(motions, np.tile(step, (many, 1)), columns))
    parts = [slice(i * count, (i + 1) * count) for i in range(many)]
    return [
        ForceSample(
            joined.force[part],
            joined.by_x[part],
            joined.by_v[part],
            tuple(by[part] for by in joined.by_parameter),
        )
        for part in parts
    ]


def _joined(parts: Sequence[ForceSample]) -> ForceSample:
    """Add the forces of all parts of a law; slopes by different motions are not added."""
    first, *others = parts
    columns = zip(*(part.by_parameter for part in parts), strict=True)
    by = tuple(sum(column[1:], column[0]) for column in columns)
    return ForceSample(sum((part.force for part in others), first.force), first.by_x, first.by_v, by)


def _rows(
    equations: Equations, law: ForceLaw, nonlinear: Array, sample: ForceSample, *, scaled: bool
) -> tuple[Array, Array]:
    """Return the rows from a sample of the law."""
    values = np.zeros(len(law.parameters))
    values[list(law.nonlinear)] = nonlinear
    omega = equations.omega[:, None]
    signals, still = _parts(law, sample, values, scaled)
    inertia = equations.omega**2 * equations.harmonics[:, 1]
    columns = [*map(_fundamental, signals), -inertia]
    if not equations.harmonics[:, ::2].any():
        # an even force has no fundamental along a motion without mean and even harmonics: remove round-off
        for place in np.flatnonzero(np.isin(law.linear, law.even)):
            columns[place] = np.zeros(len(columns[place]), dtype=complex)
    right = equations.force - project(still, 1)
    weight = equations.weight
    matrix = np.stack(columns, axis=1) * weight[:, None]
    blocks = [matrix.real, matrix.imag]
    rights = [(right * weight).real, (right * weight).imag]
    if equations.mean:
        means = [*(s.mean(axis=1) for s in signals), np.zeros(len(omega))]
        blocks.append(np.stack(means, axis=1) * weight[:, None])
        rights.append(-still.mean(axis=1) * weight)
    if len(equations.turning):
        block, balance = _turning_rows(equations, law, values, scaled)
        blocks.append(np.column_stack([block, np.zeros(len(block))]))
        rights.append(balance)
    return np.concatenate(blocks), np.concatenate(rights)


def _parts(law: ForceLaw, sample: ForceSample, values: Array, scaled: bool) -> tuple[list[Array], Array]:
    """Return the force that each unknown multiplies, and the force without unknowns."""
    signals, still = [sample.by_parameter[i] for i in law.linear], sample.force
    for group in law.scaled if scaled else ():
        # Euler: a force of degree one is the sum of its slopes times its parameters
        share = sum((values[i] * sample.by_parameter[i] for i in group), np.zeros_like(still))
        signals.append(share)
        still = still - share
    return signals, still


def _fundamental(signal: Array) -> NDArray[Any]:
    """Return the fundamental of a signal (n, s); exactly zero for a constant."""
    constant = np.all(signal == signal[:, :1], axis=1)
    return np.where(constant, 0.0, project(signal, 1))


def _turning_rows(equations: Equations, law: ForceLaw, values: Array, scaled: bool) -> tuple[Array, Array]:
    """Return rows for the work of the spring between the turning points, zero for light damping."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    high, low = equations.turning[:, 0], equations.turning[:, 1]
    parts, works = [], []
    for end in (high, low):
        x = end[:, None] * (nodes + 1) / 2
        sample = law.still(x, values)
        share = end[:, None] * weights / 2
        signals, force = _parts(law, sample, values, scaled)
        parts.append(np.reshape([np.sum(signal * share, axis=1) for signal in signals], (-1, len(high))).T)
        works.append(np.sum(force * share, axis=1))
    scale = (equations.weight / np.abs(equations.harmonics[:, 1]))[:, None]
    return (parts[0] - parts[1]) * scale, -(works[0] - works[1]) * scale[:, 0]
