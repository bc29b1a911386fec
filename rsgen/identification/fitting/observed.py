"""Measurement model of the fits: residuals and slopes of a predicted response at the sensors.

With z the motion of the mode and u the force on it, the measured force U and response Y are

    U = M u,    Y = C z + B u

with the background of ``rsgen.dynamics.linear_part``. Force and response both have noise (errors in
variables): amplitude and, if it was recorded, phase of every point are unknowns (nuisances), which the least
squares eliminates. Noise is taken as proportional to the size of force and fundamental, of a free decay as
one size (``Points.noise``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, Chosen, ComplexArray, blocks, blocks_joined, take_rows
from rsgen.common.tolerances import MISFIT_NEGLIGIBLE, NOISE_LIMIT_SIGMAS, POINTS_PER_BLOCK
from rsgen.dynamics.harmonic_balance import Response
from rsgen.dynamics.linear_part import BackgroundTerms, background_terms
from rsgen.identification.fitting.least_squares import Linearisation
from rsgen.identification.fitting.points import FORCE, FUNDAMENTAL, OTHERS, Points
from rsgen.law.element import Element
from rsgen.law.numeric import ForceLaw

_NEED_PHASE = {"psi", "b0_im", "b1_im", "r_im", "zeta"}
"""Values of the background that amplitudes alone do not determine."""


@dataclass(frozen=True, slots=True, eq=False)
class _ResidualBlock:
    """Residual (n,) of one quantity, measured minus predicted, and derivatives of the prediction.

    ``by_far`` (n, 2) is the derivative by the deviation of the second sensor; None for zero.
    """

    residual: NDArray[Any]
    by_size: NDArray[Any]
    by_phase: NDArray[Any]
    by: NDArray[Any]
    by_far: NDArray[Any] | None = None


class Comparison(NamedTuple):
    """Where, and in which units, a prediction is compared with the measured points.

    Parameters
    ----------
    values
        (b,) values of the background.
    nuisance
        (n, k) nuisances of the points.
    scale
        (n,) amplitude [m] to which the noise of higher harmonics is relative; force and fundamental are then
        compared by their logarithms, whose noise is the same everywhere and has mean zero. None: differences
        relative to the measured sizes, which are robust far from the solution.
    compared
        Other harmonics that are measured and predicted.
    """

    values: Array
    nuisance: Array
    scale: Array | None
    compared: Sequence[int]

    def select(self, chosen: Chosen) -> Comparison:
        """Keep some points."""
        scale = None if self.scale is None else self.scale[chosen]
        return self._replace(nuisance=self.nuisance[chosen], scale=scale)


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """The measured points, with the measurement model of force and response.

    The nuisances of a point are the logarithm of the argument of the forward model (amplitude or force) and,
    if the phase was recorded, the phase of the model's reference; with a motion across two sensors,
    y = y_measured (1 + a + i b), also a and b. Noise is relative to the size of force and fundamentals, equal
    in real and imaginary part, so that a background cannot replace the mode.

    Parameters
    ----------
    points
        Measured points, background included.
    background
        Terms of the background at the points.
    fitted
        (b,) mask of the fitted values of the background; the others stay.
    recorded
        Harmonics of the response that were recorded with a phase; empty for amplitudes alone.
    scale
        (n,) amplitude [m] of a comparison by logarithms, see ``linearise``; without phases from the first
        step on, else None.
    direct
        True if the points are those of the mode: no background, and phases recorded.
    """

    points: Points
    background: BackgroundTerms
    fitted: NDArray[np.bool_]
    recorded: tuple[int, ...]
    scale: Array | None = None
    direct: bool = False

    @classmethod
    def of(cls, points: Points, kind: str = "none") -> Observed:
        """Return the points with a background of a kind over their band."""
        frequency = points.omega / (2 * np.pi)
        band = float(frequency.min()), float(frequency.max())
        shape = background_terms(kind, points.omega, points.force, band)
        if points.phase_known:
            fitted = np.ones(len(shape.names), dtype=bool)
            return cls(points, shape, fitted, points.measured, direct=not shape.names)
        # without phases psi has no effect, and that of imaginary parts of b is nearly that of damping
        fitted = np.array([name not in _NEED_PHASE for name in shape.names], dtype=bool)
        return cls(points, shape, fitted, (), points.amplitude)

    @property
    def parts(self) -> int:
        """Number of nuisances of force and fundamental: the size, and the phase if it was recorded."""
        return 1 + self.recorded.count(1)

    @property
    def feeds_exciter(self) -> bool:
        """True if by the points alone, which no background turns, the structure feeds its exciter."""
        return self.direct and self.points.feed_exciter

    def compared(self, predicted: tuple[int, ...]) -> tuple[int, ...]:
        """Return the measured ones of the ``predicted`` harmonics, without the fundamental."""
        return tuple(h for h in self.recorded if h in predicted and h != 1)

    def turn(self, nuisance: Array) -> Array:
        """Return the phase (n,) of the model's reference [rad], zero without recorded phases."""
        return np.asarray(nuisance[:, 1 : self.parts].sum(axis=1))

    def select(self, chosen: Chosen) -> Observed:
        """Keep some points; the band of the background stays."""
        part, background = take_rows(self, chosen, "fitted"), self.background.select(chosen)
        return replace(part, points=self.points.select(chosen), background=background)

    def with_phases(self, values: Array, fundamental: ComplexArray, force: ComplexArray) -> Observed:
        """Return the points with the phases of a predicted mode, fundamental (n,) [m] and force (n,) [N].

        Only ``phase_known`` says that they were not recorded. Points without a prediction get zero.
        """
        points = self.points
        harmonics = np.zeros((len(points), 2), dtype=complex)
        seen = fundamental + self.background.receptance(values) * force
        harmonics[:, 1] = points.amplitude * np.exp(1j * np.nan_to_num(np.angle(seen)))
        turned = np.abs(points.force) * np.exp(1j * np.nan_to_num(np.angle(force)))
        return replace(self, points=replace(points, force=turned, harmonics=harmonics, measured=(1,)))

    def mirrored(self) -> Observed:
        """Return the points of the motion -x, half a period later: even harmonics have the other sign."""
        points, load = self.points, self.points.load
        harmonics = points.harmonics * (-1.0) ** (1 + np.arange(points.harmonics.shape[1]))
        load = None if load is None else load * (-1.0) ** (1 + np.arange(load.shape[1]))
        return replace(self, points=replace(points, harmonics=harmonics, load=load))

    def mode(self, values: Array) -> Points:
        """Return the points without a background of values (b,)."""
        return self.background.subtract(self.points, values)

    def nuisances(self, size: Array, phase: Array) -> Array:
        """Return initial nuisances (n, k): log of the size, phase if recorded, far sensor as measured."""
        measured = np.zeros((len(size), 2 * self.points.far.shape[1]))
        return np.column_stack([np.log(size), *[phase][: self.parts - 1], measured])

    def predict_sensor(self, response: Response, values: Array) -> ComplexArray:
        """Return the fundamental (n,) [m] at the sensor, in the reference of the response."""
        return np.asarray(
            response.harmonics[:, 1] + self.background.receptance(values) * response.force,
            dtype=np.complex128,
        )

    def linearise(self, response: Response, at: Comparison) -> Linearisation:
        """Return residuals and slopes of the prediction of a forward model."""
        count, names = len(self.points), list(Linearisation.__dataclass_fields__)
        found = (
            (part, self.select(part)._linearise(response.select(part), at.select(part)))
            for part in blocks(count, POINTS_PER_BLOCK)
        )
        return Linearisation(**blocks_joined(count, found, names))

    def _linearise(self, response: Response, at: Comparison) -> Linearisation:
        """Stack the rows of force, fundamental, other harmonics, second sensor; see ``linearise``."""
        points, (values, nuisance, scale, compared) = self.points, at
        turn = self.turn(nuisance)
        back = np.exp(-1j * turn)
        # points without a prediction are NaN
        with np.errstate(invalid="ignore", divide="ignore"):
            fundamental = points.harmonics[:, 1] * back
            rows = self._compare_force_and_fundamental(response, values, back, fundamental, scale is not None)
            unit = points.amplitude if scale is None else scale
            by_background = np.zeros((len(points), len(values)))
            for h in compared:
                by = np.hstack([response.harmonics_by[:, h], by_background])
                measured = points.harmonics[:, h] * np.exp(-1j * h * turn)
                rows.append(
                    _ResidualBlock(
                        (measured - response.harmonics[:, h]) / unit,
                        response.harmonics_slope[:, h] / unit,
                        1j * h * measured / unit,
                        by / unit[:, None],
                    )
                )
        # the mean has no imaginary part, an amplitude no phase
        real = [h == 0 or h not in self.recorded for h in (1, 1, *compared)]
        for _ in points.far.T:
            rows.append(_far_sensor(nuisance, rows[0]))
            real.append(False)
        residual = _split([row.residual for row in rows], real)
        residual[~response.valid] = np.nan
        of_sensor = [[row.by_size for row in rows], [row.by_phase for row in rows]]
        by_nuisance = [_split(slope, real) for slope in of_sensor[: self.parts]]
        still = np.zeros((len(points), 2))
        far = [still if row.by_far is None else row.by_far for row in rows]
        by_nuisance += [_split([by[:, j] for by in far], real) for _ in points.far.T for j in range(2)]
        noise = self._noise_of_rows(residual.shape[1])
        slopes = np.stack(by_nuisance, axis=2), _split([row.by for row in rows], real)
        return Linearisation(residual / noise, *(slope / noise[:, :, None] for slope in slopes))

    def _noise_of_rows(self, count: int) -> Array:
        """Return the noise (n, count) of rows: real parts of force, fundamental, others, then imaginary."""
        half, noise = (count + 1) // 2, self.points.noise
        rows = np.repeat(noise[:, [OTHERS]], count, axis=1)
        for part in range(self.parts):
            rows[:, part * half : part * half + 2] = noise[:, [FORCE, FUNDAMENTAL]]
        return rows

    def _compare_force_and_fundamental(
        self,
        response: Response,
        values: Array,
        back: ComplexArray,
        fundamental: ComplexArray,
        logarithmic: bool,
    ) -> list[_ResidualBlock]:
        """Return the residual blocks of the force and of the fundamental at the sensor."""
        points, shape = self.points, self.background
        force = points.force * shape.turn(values) * back
        b = shape.receptance(values)
        seen = response.harmonics[:, 1] + b * response.force
        seen_slope = response.harmonics_slope[:, 1] + b * response.force_slope
        seen_by = response.harmonics_by[:, 1] + b[:, None] * response.force_by
        terms = shape.slopes(values) * self.fitted
        by_phase = 0j if response.force_phase is None else response.force_phase
        units: list[NDArray[Any]]
        if logarithmic:
            units = [response.force, seen]
            rests = [np.log(force / response.force), np.log(fundamental / seen)]
            turns = [(1j * response.force + by_phase) / units[0], np.full(len(points), 1j)]
        else:
            units = [np.abs(points.force), points.amplitude]
            rests = [(force - response.force) / units[0], (fundamental - seen) / units[1]]
            turns = [(1j * force + by_phase) / units[0], 1j * fundamental / units[1]]
        by_far = None if response.force_far is None else response.force_far / units[0][:, None]
        # psi turns the measured force only
        psi = 1j * (response.force if logarithmic else force) / units[0]
        by_psi = np.zeros_like(terms)
        by_psi[:, :1] = -psi[:, None] * self.fitted[:1]
        by_force = np.hstack([response.force_by / units[0][:, None], by_psi])
        by_seen = np.hstack([seen_by, terms * response.force[:, None]]) / units[1][:, None]
        return [
            _ResidualBlock(rests[0], response.force_slope / units[0], turns[0], by_force, by_far),
            _ResidualBlock(rests[1], seen_slope / units[1], turns[1], by_seen),
        ]

    def load_noise(self, response: Response, at: Comparison) -> Array | None:
        """Return what noise of the other harmonics of the force does to the rows of ``linearise`` (n, M, L).

        In units of the expected noise, which is the same for each harmonic of the force. Harmonics that are
        zero were not recorded. None without harmonics of the force.
        """
        load = self.points.load
        if load is None or response.force_load is None or response.harmonics_load is None:
            return None
        parts = replace(response, force_by=response.force_load, harmonics_by=response.harmonics_load)
        count = response.force_load.shape[1]
        slopes = self.linearise(parts, at).by_parameter[:, :, :count]
        orders = np.asarray(response.load_orders)
        recorded = orders < load.shape[1]
        size = np.zeros((len(load), count))
        size[:, recorded] = (load[:, orders[recorded]] != 0) * np.abs(self.points.force)[:, None]
        noise = slopes * size[:, None, :]
        return np.where(np.isfinite(noise).all(axis=(1, 2), keepdims=True), noise, 0.0)

    def plain_influence(self, influence: Array) -> Array:
        """Convert the influence (n, M, q) of rows in units of the noise into that of relative differences."""
        return np.asarray(influence / self._noise_of_rows(influence.shape[1])[:, :, None])

    def relative_influence(self, influence: Array, values: Array, nuisance: Array) -> Array:
        """Convert the influence (n, M, q) of differences into that of relative deviations.

        A difference of force or fundamental has the phase of the reference, a relative deviation the phase of
        the quantity itself.
        """
        back = np.exp(-1j * nuisance[:, 1])
        relative, half = np.array(influence), (influence.shape[1] + 1) // 2
        for row, value in enumerate(
            (self.points.force * self.background.turn(values), self.points.harmonics[:, 1])
        ):
            unit = (value * back / np.abs(value))[:, None]
            turned = (influence[:, row] - 1j * influence[:, half + row]) * unit
            relative[:, row], relative[:, half + row] = turned.real, -turned.imag
        return relative


def _far_sensor(nuisance: Array, like: _ResidualBlock) -> _ResidualBlock:
    """Return the residual block of a far sensor y = y_measured (1 + a + i b), relative to its motion."""
    zero = np.zeros(len(nuisance))
    unit = np.tile(np.array([1, 1j]), (len(nuisance), 1))
    return _ResidualBlock(
        -(nuisance[:, -2] + 1j * nuisance[:, -1]), zero, zero, np.zeros(like.by.shape), unit
    )


def _split(rows: Sequence[NDArray[Any]], real: Sequence[bool]) -> Array:
    """Stack real and imaginary parts of complex rows (n, ...), real parts of real ones: (n, r, ...)."""
    parts = [np.asarray(row.real, dtype=np.float64) for row in rows]
    parts += [np.asarray(row.imag) for row, alone in zip(rows, real, strict=True) if not alone]
    return np.stack(parts, axis=1)


# ----------------------------------------------------------------------------
# The least-squares problem of a law and the measured points.


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """A least-squares problem: parameters are those of the law by name, the mass, the background.

    Parameters
    ----------
    elements, law
        The law, as elements for the simulator and as array functions.
    observed
        The measured points.
    fixed
        Values of parameters that are known, by name; "m" is the mass [kg].
    frozen
        Parameters that stay at their initial values, but count as unknowns in the covariance.
    """

    elements: tuple[Element, ...]
    law: ForceLaw
    observed: Observed
    fixed: Mapping[str, float] = field(default_factory=dict)
    frozen: tuple[int, ...] = ()

    @property
    def count(self) -> int:
        """Number of parameters without the background."""
        return len(self.law.parameters) + 1

    @property
    def known_values(self) -> dict[str, float]:
        """Values of parameters that are known, exactly or, as a mass that was weighed, with an error."""
        return self.observed.points.known_values(self.fixed)

    @property
    def unweighed(self) -> Problem:
        """The problem of the points alone, without the weighing of a mass."""
        points = replace(self.observed.points, weighed=None)
        return replace(self, observed=replace(self.observed, points=points))

    @property
    def free(self) -> NDArray[np.bool_]:
        """Mask (q,), False for fixed parameters."""
        of_law = [name not in self.fixed for name in (*self.law.parameters, "m")]
        return np.array(of_law + [True] * len(self.observed.background.names))

    def split(self, parameters: Array) -> tuple[Array, float, Array]:
        """Return values of the law (p,), mass [kg] and background (b,)."""
        values = parameters[: len(self.law.parameters)]
        return values, float(parameters[len(values)]), parameters[self.count :]

    def join(self, values: Array, mass: float, background: Array | None = None) -> Array:
        """Return the vector (q,) of values, mass and background; None is a background of zeros."""
        if background is None:
            background = np.zeros(len(self.observed.background.names))
        return np.concatenate([values, [mass], background])

    def select(self, chosen: NDArray[np.intp]) -> Problem:
        """Keep some points."""
        return replace(self, observed=self.observed.select(chosen))


# ----------------------------------------------------------------------------
# Systematic misfit: residuals of neighbours in frequency are correlated if the law, not noise, makes them.

_MIN_CORRELATION = 0.3
"""Correlation of neighbouring residuals from which on the misfit is systematic."""

_MIN_PAIRS = 6
"""Pairs of neighbours that a correlation needs."""


def is_systematic(residual: Array, pairs: NDArray[np.intp]) -> bool:
    """Return True if residuals of any quantity are correlated between neighbours in frequency of a run."""
    return bool(systematic_columns(residual, pairs).any())


def systematic_columns(residual: Array, pairs: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return the columns (M,) whose residuals are correlated between neighbours in frequency of a run.

    Parameters
    ----------
    residual
        (n, M) relative residuals of force, fundamental and harmonics, real and imaginary parts.
    pairs
        (k, 2) neighbours; see ``Points.pairs``.
    """
    found = np.zeros(residual.shape[1], dtype=bool)
    if len(pairs) < _MIN_PAIRS:
        return found
    power, shared = neighbour_power(residual, pairs)
    counts = power > MISFIT_NEGLIGIBLE**2 / 2
    if not counts.any():
        return found
    # a pair has two independent numbers, real and imaginary part
    single, joint = shared[counts] / power[counts], shared[counts].sum() / power[counts].sum()
    found[counts] = beyond_chance(single, len(pairs)) | beyond_chance(joint, 2 * len(pairs))
    return found


def constant_mean(mean: Array, amplitude: Array) -> tuple[float, float]:
    """Return the constant [m] that is nearest to a mean (n,), each point relative to its amplitude, and the
    share of the mean that it leaves [1].
    """
    weight = 1 / amplitude**2
    offset = float(np.sum(mean * weight) / np.sum(weight))
    total = float(np.sum(mean**2 * weight))
    return offset, float(np.sqrt(np.sum((mean - offset) ** 2 * weight) / total)) if total > 0 else 1.0


def neighbour_power(residual: Array, pairs: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return the mean square of residuals (n, M) at pairs of neighbours, and their covariance, (M,) both."""
    first, second = (residual[side] for side in pairs.T)
    return np.mean(residual[pairs] ** 2, axis=(0, 1)), np.mean(first * second, axis=0)


def effective_power(residual: Array, pairs: NDArray[np.intp]) -> float:
    """Return the mean square of residuals (n, M) times the points that count as one independent point.

    With r_l the correlation of residuals l places from each other in a run these are 1 + 2 sum r_l, the sum
    up to the first r_l within chance (Geyer, Statist. Sci. 7 (1992) 473). One of noise, or of few ``pairs``.
    """
    if len(pairs) < _MIN_PAIRS or not residual[pairs].any():
        return 1.0
    after = np.full(len(residual), -1)
    after[pairs[:, 0]] = pairs[:, 1]
    power, numbers, points = float(np.mean(residual[pairs] ** 2)), len(pairs) * residual.shape[1], 1.0
    first, second = pairs.T
    while (r := float(np.sum(residual[first] * residual[second])) / (numbers * power)) > 2 / np.sqrt(numbers):
        points += 2 * r
        follows = after[second] >= 0
        first, second = first[follows], after[second[follows]]
    return max(power * points, 1.0) if points > 1 else 1.0


def beyond_chance(correlation: Any, numbers: Any) -> NDArray[np.bool_]:
    """Return where a correlation of so many numbers is significant (Fisher, Metron, 1921: atanh r)."""
    limit = np.tanh(NOISE_LIMIT_SIGMAS / np.sqrt(np.maximum(numbers - 3, 1e-300)))
    return np.asarray(correlation > np.maximum(_MIN_CORRELATION, limit))
