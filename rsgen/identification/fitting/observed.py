"""What the sensors saw: residuals and slopes of a predicted response, with background and unknown phases.

A mode among others answers a force F at the sensor with

    x = q + b(omega) F,     F = F_measured exp(i psi),     b = A + B/omega^2,

where q obeys the nonlinear law, A is what modes above add (their flexibility) and B/omega^2 what modes below
add (their inertia); both are complex, because those modes have damping, and because a sensor picks up some of
the drive (residual terms: Ewins, Modal Testing, 2000, Sec. 4.4). Within a band A and B are nearly collinear,
so they are carried as the value b0 in the middle of the band and the change b1 over the band. A mode too near
for these terms has one of its own, r/(omega_n^2 - omega^2 + 2 i zeta omega_n omega): it is linear.
A displacement o that does not depend on the force (pick-up from the generator) is a receptance o/F.
No background is the case without values; a recorded phase needs one nuisance a point more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, Chosen, ComplexArray, blocks, blocks_joined
from rsgen.data.oscillator import BACKGROUNDS, OFFSET
from rsgen.data.surface import ResponseSurface
from rsgen.identification.fitting.forward import Response
from rsgen.identification.fitting.least_squares import Linearisation
from rsgen.identification.fitting.points import Points

__all__ = ["Observed", "Shape", "shape_of"]


Table = TypeVar("Table", Points, ResponseSurface)


_POINTS = 4096
"""Compared at once: what is between a response and its slopes takes more memory than both."""

_NEED_PHASE = {"psi", "b0_im", "b1_im", "r_im", "zeta"}
"""Values that amplitudes alone say nothing of, or little that damping does not."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A background as a function of real values: psi, real and imaginary part of b0, b1, o; a neighbour.

    Parameters
    ----------
    names, units
        Of the values.
    functions
        (n, t): what each complex term is multiplied by at each point; 1/F of an offset.
    omega
        (n,) [rad/s].
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    functions: ComplexArray
    omega: Array

    @property
    def _terms(self) -> int:
        return 1 + 2 * int(self.functions.shape[1])

    def turn(self, values: Array) -> complex:
        """exp(i psi)."""
        return complex(np.exp(1j * values[0])) if len(values) else 1.0 + 0.0j

    def receptance(self, values: Array) -> ComplexArray:
        """(n,) background response per force [m/N]."""
        terms = values[: self._terms]
        total = self.functions @ (terms[1::2] + 1j * terms[2::2])
        if len(values) > self._terms:
            real, imaginary = values[self._terms : self._terms + 2]
            total = total + (real + 1j * imaginary) * self._neighbour(values)[0]
        return np.asarray(total, dtype=np.complex128)

    def slopes(self, values: Array) -> ComplexArray:
        """(n, b) derivatives of the receptance by all values; zero by psi."""
        columns = (self.functions[:, :, None] * np.array([1, 1j])).reshape(len(self.omega), -1)
        if len(values) > self._terms:
            residue = complex(*values[self._terms : self._terms + 2])
            one, by_frequency, by_damping = self._neighbour(values)
            columns = np.column_stack([columns, one, 1j * one, residue * by_frequency, residue * by_damping])
        by_psi = np.zeros((len(self.omega), min(len(values), 1)))
        return np.asarray(np.hstack([by_psi, columns]), dtype=np.complex128)

    def _neighbour(self, values: Array) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """(n,) receptance of a mode of mass 1 kg, and its derivatives by f_n [Hz] and zeta."""
        natural, zeta = 2 * np.pi * values[-2], values[-1]
        one = 1 / (natural**2 - self.omega**2 + 2j * zeta * natural * self.omega)
        by_frequency = -(one**2) * (2 * natural + 2j * zeta * self.omega) * 2 * np.pi
        return one, by_frequency, -(one**2) * 2j * natural * self.omega

    def subtract(self, points: Table, values: Array) -> Table:
        """Leave the mode alone: its displacement, and the force in the phase of the response."""
        if not len(values):
            return points
        force = points.force * self.turn(values)
        harmonics = np.array(points.harmonics)
        harmonics[:, 1] -= self.receptance(values) * force
        peak = points.peak if np.all(self.functions == 0) else np.full_like(points.peak, np.nan)
        return replace(points, force=force, harmonics=harmonics, peak=peak)


def shape_of(kind: str, omega: Array, force: ComplexArray | Array, band: tuple[float, float]) -> Shape:
    """Give the functions of a background at the frequencies.

    Parameters
    ----------
    kind
        "none": no value; "phase": psi; "constant": and b0; "residuals": and b1; "neighbour": and a mode near
        the band; with "+offset": and o, a displacement in the phase of the turned force.
    omega, force
        (n,) [rad/s], [N].
    band
        Lowest and highest frequency [Hz] of the points that are fitted.
    """
    rank = BACKGROUNDS.index(kind.removesuffix(OFFSET))
    terms = min(max(rank - 1, 0), 2)
    count = 1 + 2 * terms if rank else 0
    names = ("psi", "b0_re", "b0_im", "b1_re", "b1_im")[:count]
    units = ("rad", *["m/N"] * 4)[:count]
    low, high = (1 / (2 * np.pi * f) ** 2 for f in band)
    # 1 in the middle for b0; from -1/2 to 1/2 over the band for b1
    change = (1 / omega**2 - (low + high) / 2) / (high - low) if high != low else np.zeros(len(omega))
    functions = [np.ones(len(omega)), change][:terms]
    if kind.endswith(OFFSET):
        names, units = (*names, "o_re", "o_im"), (*units, "m", "m")
        functions.append(1 / np.where(np.abs(force) > 0, force, np.inf))
    if rank == len(BACKGROUNDS) - 1:
        names, units = (*names, "r_re", "r_im", "f_n", "zeta"), (*units, "1/kg", "1/kg", "Hz", "")
    columns = np.array(functions, dtype=np.complex128).reshape(len(functions), len(omega)).T
    return Shape(names, units, columns, omega)


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """One compared quantity: measured minus predicted, and derivatives of the prediction."""

    residual: NDArray[Any]
    by_size: NDArray[Any]
    by_phase: NDArray[Any]
    by: NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """The measured points as a fit sees them.

    The nuisances of a point are the logarithm of the size that the forward model is asked for (amplitude or
    force) and, where the phase was recorded, the phase of the model's reference. Noise is expected relative
    to the size of force and fundamental, the same in real and imaginary part; so a background that takes the
    place of the mode gains nothing.

    Parameters
    ----------
    points
        As measured, background included.
    background
        At the points.
    phase_known
        False where only amplitudes of force and fundamental were recorded.
    fitted
        (b,) which values of the background are fitted; the others stay.
    kind, band
        Of the background, and lowest and highest frequency [Hz] that it is defined over.
    """

    points: Points
    background: Shape
    phase_known: bool
    fitted: NDArray[np.bool_]
    kind: str
    band: tuple[float, float]

    @classmethod
    def of(cls, points: Points, kind: str = "none", *, phase_known: bool = True) -> Observed:
        """Take the points with a background of a kind over their band."""
        frequency = points.omega / (2 * np.pi)
        band = float(frequency.min()), float(frequency.max())
        shape = shape_of(kind, points.omega, points.force, band)
        # without phase psi has no effect, and imaginary parts of b hardly one that damping has not
        fitted = np.array([phase_known or name not in _NEED_PHASE for name in shape.names], dtype=bool)
        return cls(points, shape, phase_known, fitted, kind, band)

    def without_neighbour(self) -> Observed:
        """Residual terms only."""
        kind = self.kind.replace("neighbour", "residuals")
        shape = shape_of(kind, self.points.omega, self.points.force, self.band)
        return replace(self, kind=kind, background=shape, fitted=self.fitted[: len(shape.names)])

    def select(self, chosen: Chosen) -> Observed:
        """Take some of the points; the band of the background stays."""
        shape = self.background
        part = replace(shape, functions=shape.functions[chosen], omega=shape.omega[chosen])
        return replace(self, points=self.points.select(chosen), background=part)

    def mode(self, values: Array) -> Points:
        """The points without the background (b,)."""
        return self.background.subtract(self.points, values)

    def nuisances(self, size: Array, phase: Array) -> Array:
        """(n, 2) to start from: logarithm of the size, phase of the reference; (n, 1) without phase."""
        return np.stack([np.log(size), phase] if self.phase_known else [np.log(size)], axis=1)

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
            (n, 2) as above, (n, 1) without phase.
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
        back = np.exp(-1j * nuisance[:, 1]) if self.phase_known else np.ones(len(points), complex)
        measured = points.harmonics * back[:, None] ** np.arange(points.harmonics.shape[1])
        # points that could not be predicted are NaN and say so below
        with np.errstate(invalid="ignore", divide="ignore"):
            rows = self._compare_strong(response, values, back, measured[:, 1], scale is not None)
            unit = points.amplitude if scale is None else scale
            none = np.zeros((len(points), len(values)))
            for h in compared:
                by = np.hstack([response.harmonics_by[:, h], none])
                predicted, slope = response.harmonics[:, h], response.harmonics_slope[:, h]
                rows.append(
                    _Row(
                        (measured[:, h] - predicted) / unit,
                        slope / unit,
                        1j * h * measured[:, h] / unit,
                        by / unit[:, None],
                    )
                )
        # the mean has no imaginary part, an amplitude no phase
        real = [h == 0 or not self.phase_known for h in (1, 1, *compared)]
        residual = _split([row.residual for row in rows], real)
        residual[~response.valid] = np.nan
        by_nuisance = [_split([row.by_size for row in rows], real)]
        if self.phase_known:
            by_nuisance.append(_split([row.by_phase for row in rows], real))
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
            units = [response.force, seen]
            rests = [np.log(force / response.force), np.log(fundamental / seen)]
            turns = [1j + by_phase / response.force, np.full(len(points), 1j)]
        else:
            units = [np.abs(points.force), points.amplitude]
            rests = [(force - response.force) / units[0], (fundamental - seen) / units[1]]
            turns = [(1j * force + by_phase) / units[0], 1j * fundamental / units[1]]
        # psi turns the force that was measured alone
        psi = np.full(len(points), 1j) if logarithmic else 1j * force / units[0]
        by_psi = np.zeros_like(terms)
        by_psi[:, :1] = -psi[:, None] * self.fitted[:1]
        by_force = np.hstack([response.force_by / units[0][:, None], by_psi])
        by_seen = np.hstack([seen_by, terms * response.force[:, None]]) / units[1][:, None]
        noise = np.ones(len(points)) if response.force_noise is None else response.force_noise
        return [
            _Row(
                rests[0] / noise,
                response.force_slope / units[0] / noise,
                turns[0] / noise,
                by_force / noise[:, None],
            ),
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

    def phase_curvature(self, nuisance: Array, scale: Array, compared: Sequence[int]) -> Array:
        """(n, M) second derivative of the prediction by the phase, where that was recorded."""
        none = np.zeros(len(nuisance))
        back = np.exp(-1j * nuisance[:, 1])
        twice = [none, none]
        twice += [h**2 * self.points.harmonics[:, h] * back**h / scale for h in compared]
        return _split(twice, [h == 0 for h in (1, 1, *compared)])


def _split(rows: Sequence[NDArray[Any]], real: Sequence[bool]) -> Array:
    """Join c complex rows (n, ...) to (n, r, ...) real ones; of those marked real only the real part."""
    parts = [np.asarray(row.real, dtype=np.float64) for row in rows]
    parts += [np.asarray(row.imag) for row, alone in zip(rows, real, strict=True) if not alone]
    return np.stack(parts, axis=1)
