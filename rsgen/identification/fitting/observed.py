"""What is fitted to what: residuals and slopes of a predicted response as the sensors saw it, and a law.

    U = M u,    Y = C z + B u

with the background of ``rsgen.dynamics.linear_part``. A recorded phase needs one nuisance a point more.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, Chosen, ComplexArray, blocks, blocks_joined
from rsgen.common.tolerances import CHANCE, NOTICEABLE
from rsgen.dynamics.harmonic_balance import Response
from rsgen.dynamics.linear_part import BackgroundTerms, background_terms
from rsgen.identification.fitting.least_squares import Linearisation
from rsgen.identification.fitting.points import Points
from rsgen.law.element import Element
from rsgen.law.numeric import ForceLaw

FORCE_TO_RESPONSE_NOISE = 1.0
"""Ratio of the relative noises of force and response: sine tests rarely say which sensor is worse."""

_POINTS = 4096
"""Compared at once: what is between a response and its slopes takes more memory than both."""

_NEED_PHASE = {"psi", "b0_im", "b1_im", "r_im", "zeta"}
"""Values that amplitudes alone say nothing of, or little that damping does not."""


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """One compared quantity: measured minus predicted, and derivatives of the prediction.

    ``by_far`` (n, 2) is that by the deviation of each further sensor, None for zero.
    """

    residual: NDArray[Any]
    by_size: NDArray[Any]
    by_phase: NDArray[Any]
    by: NDArray[Any]
    by_far: NDArray[Any] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """The measured points as a fit sees them.

    The nuisances of a point are the logarithm of the size that the forward model is asked for (amplitude or
    force) and, where the phase was recorded, the phase of the model's reference; where a motion
    across was measured, y = y_measured (1 + a + i b) of its sensor, then a and b. Noise is expected
    relative to the size of force and fundamentals, the same in real and imaginary part; so a background that
    takes the place of the mode gains nothing.

    Parameters
    ----------
    points
        As measured, background included.
    background
        At the points.
    fitted
        (b,) which values of the background are fitted; the others stay.
    kind, band
        Of the background, and lowest and highest frequency [Hz] that it is defined over.
    recorded
        Harmonics of the response that were recorded with a phase; none where amplitudes alone were.
    scale
        (n,) amplitude [m] with which a fit begins to compare by logarithms, see ``linearise``: from the
        beginning without phases, where the sign of a difference is that of its logarithm. Else None.
    direct
        Whether the points are those of the mode as they are: no background, and phases recorded.
    """

    points: Points
    background: BackgroundTerms
    fitted: NDArray[np.bool_]
    kind: str
    band: tuple[float, float]
    recorded: tuple[int, ...]
    scale: Array | None = None
    direct: bool = False

    @classmethod
    def of(cls, points: Points, kind: str = "none") -> Observed:
        """Take the points with a background of a kind over their band."""
        frequency = points.omega / (2 * np.pi)
        band = float(frequency.min()), float(frequency.max())
        shape = background_terms(kind, points.omega, points.force, band)
        if points.phase_known:
            fitted = np.ones(len(shape.names), dtype=bool)
            return cls(points, shape, fitted, kind, band, points.measured, direct=not shape.names)
        # without phase psi has no effect, and imaginary parts of b hardly one that damping has not
        fitted = np.array([name not in _NEED_PHASE for name in shape.names], dtype=bool)
        return cls(points, shape, fitted, kind, band, (), points.amplitude)

    @property
    def parts(self) -> int:
        """Parts of force and fundamental that are compared, and nuisances for them: size, and phase."""
        return 1 + self.recorded.count(1)

    def turn(self, nuisance: Array) -> Array:
        """(n,) phase of the model's reference [rad], zero where none was recorded."""
        return np.asarray(nuisance[:, 1 : self.parts].sum(axis=1))

    def without_neighbour(self) -> Observed:
        """Residual terms only."""
        kind = self.kind.replace("neighbour", "residuals")
        shape = background_terms(kind, self.points.omega, self.points.force, self.band)
        return replace(self, kind=kind, background=shape, fitted=self.fitted[: len(shape.names)])

    def select(self, chosen: Chosen) -> Observed:
        """Take some of the points; the band of the background stays."""
        scale = None if self.scale is None else self.scale[chosen]
        background = self.background.select(chosen)
        return replace(self, points=self.points.select(chosen), background=background, scale=scale)

    def mode(self, values: Array) -> Points:
        """The points without the background (b,)."""
        return self.background.subtract(self.points, values)

    def nuisances(self, size: Array, phase: Array) -> Array:
        """(n, k) to start from: logarithm of the size, phase where known, far sensor as measured."""
        none = np.zeros((len(size), 2 * self.points.far.shape[1]))
        return np.column_stack([np.log(size), *[phase][: self.parts - 1], none])

    def seen(self, response: Response, values: Array) -> ComplexArray:
        """(n,) fundamental at the sensor, in the reference of the response [m]."""
        return np.asarray(
            response.harmonics[:, 1] + self.background.receptance(values) * response.force,
            dtype=np.complex128,
        )

    def linearise(
        self,
        response: Response,
        values: Array,
        nuisance: Array,
        scale: Array | None,
        compared: Sequence[int],
    ) -> Linearisation:
        """Compare with a prediction.

        Parameters
        ----------
        response
            Predicted.
        values
            (b,) of the background.
        nuisance
            (n, k) as above.
        scale
            (n,) amplitude [m] of the fundamental that the noise of other harmonics is relative to; force and
            fundamental are then compared by their logarithms, whose noise has mean zero and the same size
            everywhere. None: plain differences relative to the measured sizes, which no start is too far for.
        compared
            Other harmonics that are measured and predicted.
        """

        def line(part: slice) -> Linearisation:
            unit = None if scale is None else scale[part]
            return self.select(part)._linearise(response.select(part), values, nuisance[part], unit, compared)

        count, names = len(self.points), list(Linearisation.__dataclass_fields__)
        found = ((part, line(part)) for part in blocks(count, _POINTS))
        return Linearisation(**blocks_joined(count, found, names))

    def _linearise(
        self,
        response: Response,
        values: Array,
        nuisance: Array,
        scale: Array | None,
        compared: Sequence[int],
    ) -> Linearisation:
        points = self.points
        turn = self.turn(nuisance)
        back = np.exp(-1j * turn)
        # points that could not be predicted are NaN and say so below
        with np.errstate(invalid="ignore", divide="ignore"):
            fundamental = points.harmonics[:, 1] * back
            rows = self._compare_strong(response, values, back, fundamental, scale is not None)
            unit = points.amplitude if scale is None else scale
            none = np.zeros((len(points), len(values)))
            for h in compared:
                by = np.hstack([response.harmonics_by[:, h], none])
                measured = points.harmonics[:, h] * np.exp(-1j * h * turn)
                rows.append(
                    _Row(
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
        slopes = [[row.by_size for row in rows], [row.by_phase for row in rows]]
        by_nuisance = [_split(slope, real) for slope in slopes[: self.parts]]
        still = np.zeros((len(points), 2))
        far = [still if row.by_far is None else row.by_far for row in rows]
        by_nuisance += [_split([by[:, j] for by in far], real) for _ in points.far.T for j in range(2)]
        by_parameter = _split([row.by for row in rows], real)
        return Linearisation(residual, np.stack(by_nuisance, axis=2), by_parameter)

    def _compare_strong(
        self,
        response: Response,
        values: Array,
        back: ComplexArray,
        fundamental: ComplexArray,
        logarithmic: bool,
    ) -> list[_Row]:
        """Rows of the force and of the fundamental at the sensor."""
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
            units = [response.force * FORCE_TO_RESPONSE_NOISE, seen]
            rests = [np.log(force / response.force) / FORCE_TO_RESPONSE_NOISE, np.log(fundamental / seen)]
            turns = [(1j * response.force + by_phase) / units[0], np.full(len(points), 1j)]
        else:
            units = [np.abs(points.force) * FORCE_TO_RESPONSE_NOISE, points.amplitude]
            rests = [(force - response.force) / units[0], (fundamental - seen) / units[1]]
            turns = [(1j * force + by_phase) / units[0], 1j * fundamental / units[1]]
        by_far = None if response.force_far is None else response.force_far / units[0][:, None]
        # psi turns the force that was measured alone
        psi = 1j * (response.force if logarithmic else force) / units[0]
        by_psi = np.zeros_like(terms)
        by_psi[:, :1] = -psi[:, None] * self.fitted[:1]
        by_force = np.hstack([response.force_by / units[0][:, None], by_psi])
        by_seen = np.hstack([seen_by, terms * response.force[:, None]]) / units[1][:, None]
        return [
            _Row(rests[0], response.force_slope / units[0], turns[0], by_force, by_far),
            _Row(rests[1], seen_slope / units[1], turns[1], by_seen),
        ]

    def load_noise(
        self,
        response: Response,
        values: Array,
        nuisance: Array,
        scale: Array | None,
        compared: Sequence[int],
    ) -> Array | None:
        """(n, M, L) what noise of the other harmonics of the force does to the rows of ``linearise``.

        In units of the expected noise: that of each harmonic is as large as that of the fundamental of the
        force. Those that are zero were not recorded, or did not stand out of the noise. None where no
        harmonics of the force were given.
        """
        load = self.points.load
        if load is None or response.force_load is None or response.harmonics_load is None:
            return None
        parts = replace(response, force_by=response.force_load, harmonics_by=response.harmonics_load)
        count = response.force_load.shape[1]
        slopes = self.linearise(parts, values, nuisance, scale, compared).by_parameter[:, :, :count]
        orders = np.asarray(response.load_orders)
        recorded = orders < load.shape[1]
        size = np.zeros((len(load), count))
        size[:, recorded] = (load[:, orders[recorded]] != 0) * np.abs(self.points.force)[:, None]
        noise = slopes * size[:, None, :]
        return np.where(np.isfinite(noise).all(axis=(1, 2), keepdims=True), noise, 0.0)

    def relative_influence(self, influence: Array, values: Array, nuisance: Array) -> Array:
        """Turn the influence (n, M, q) of plain differences into that of relative deviations.

        A plain difference of force or fundamental is compared in the phase of the reference, a relative
        deviation of either in its own phase.
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


def _far_sensor(nuisance: Array, like: _Row) -> _Row:
    """Row of a far sensor y = y_measured (1 + a + i b), relative to its motion."""
    none = np.zeros(len(nuisance))
    unit = np.tile(np.array([1, 1j]), (len(nuisance), 1))
    return _Row(-(nuisance[:, -2] + 1j * nuisance[:, -1]), none, none, np.zeros(like.by.shape), unit)


def _split(rows: Sequence[NDArray[Any]], real: Sequence[bool]) -> Array:
    """Join c complex rows (n, ...) to (n, r, ...) real ones; of those marked real only the real part."""
    parts = [np.asarray(row.real, dtype=np.float64) for row in rows]
    parts += [np.asarray(row.imag) for row, alone in zip(rows, real, strict=True) if not alone]
    return np.stack(parts, axis=1)


# ----------------------------------------------------------------------------
# What is fitted to what: a law with free values, and what the sensors saw.


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """What is fitted to what: parameters are those of the law by name, the mass, the background.

    Parameters
    ----------
    elements, law
        The laws, for the simulator and as array functions.
    observed
        The measured points.
    fixed
        Values of parameters that are known, by name; "m" is the mass [kg].
    held
        Parameters that stay at their starting values, yet count among the unknowns when errors are stated.
    """

    elements: tuple[Element, ...]
    law: ForceLaw
    observed: Observed
    fixed: Mapping[str, float] = field(default_factory=dict)
    held: tuple[int, ...] = ()

    @property
    def count(self) -> int:
        """Parameters apart from the background."""
        return len(self.law.parameters) + 1

    @property
    def free(self) -> NDArray[np.bool_]:
        """(q,) False for parameters that are fixed."""
        of_law = [name not in self.fixed for name in (*self.law.parameters, "m")]
        return np.array(of_law + [True] * len(self.observed.background.names))

    def split(self, parameters: Array) -> tuple[Array, float, Array]:
        """Values of the law (p,), mass [kg] and background (b,)."""
        values = parameters[: len(self.law.parameters)]
        return values, float(parameters[len(values)]), parameters[self.count :]

    def join(self, values: Array, mass: float, background: Array | None = None) -> Array:
        """One vector of them; None is a background of zeros."""
        if background is None:
            background = np.zeros(len(self.observed.background.names))
        return np.concatenate([values, [mass], background])

    def select(self, chosen: NDArray[np.intp]) -> Problem:
        """Take some of the points."""
        return replace(self, observed=self.observed.select(chosen))

    def compared(self, predicted: tuple[int, ...]) -> tuple[int, ...]:
        """Harmonics other than the fundamental that are measured, of those ``predicted``."""
        return tuple(h for h in self.observed.recorded if h in predicted and h != 1)


MISSING_TERMS = ("x*abs(x)", "x**3", "x**5", "v*abs(v)", "v**3", "sign(v)")
"""What a law may lack: the commonest nonlinear springs and dampers; others are nearly made up of them."""


def with_coefficients(terms: Sequence[str], taken: Collection[str]) -> dict[str, str]:
    """Multiply each term by a parameter of its own, of a name that is not taken yet, and give both."""
    free = (name for i in count() if (name := f"term{i}") not in taken)
    return {name: f"{name}*({term})" for name, term in zip(free, terms, strict=False)}


# ----------------------------------------------------------------------------
# Whether misfits have a pattern: those of neighbours go together where the law, not noise, makes them.

_SYSTEMATIC = 0.3
"""Correlation of neighbouring misfits, or share of them, that is the law's, not the noise's."""

_PAIRS = 6
"""Pairs of neighbours below which their correlation says nothing."""


def is_systematic(residual: Array, pairs: NDArray[np.intp]) -> bool:
    """Tell whether misfits of any quantity go together between neighbours in frequency of one run.

    Parameters
    ----------
    residual
        (n, M) of force, fundamental and harmonics, real and imaginary parts, relative.
    pairs
        (k, 2) points next to each other in the test, of those that count; see ``Points.pairs``.
    """
    if len(pairs) < _PAIRS:
        return False
    power, shared = neighbour_power(residual, pairs)
    counts = power > NOTICEABLE**2 / 2
    if not counts.any():
        return False
    # real and imaginary part are two independent numbers of a pair, whatever was recorded
    each, together = shared[counts] / power[counts], shared[counts].sum() / power[counts].sum()
    return bool(beyond_chance(each, len(pairs)).any() or beyond_chance(together, 2 * len(pairs)))


def neighbour_power(residual: Array, pairs: NDArray[np.intp]) -> tuple[Array, Array]:
    """Mean square of misfits (n, M) at pairs of neighbours, and the part that they share: (M,) each."""
    first, second = (residual[side] for side in pairs.T)
    return np.mean(residual[pairs] ** 2, axis=(0, 1)), np.mean(first * second, axis=0)


def beyond_chance(correlation: Any, numbers: Any) -> NDArray[np.bool_]:
    """Whether so many numbers go together as noise hardly does: atanh r is normal (Fisher, Metron, 1921)."""
    chance = np.tanh(CHANCE / np.sqrt(np.maximum(numbers - 3, 1e-300)))
    return np.asarray(correlation > np.maximum(_SYSTEMATIC, chance))
