"""The linear background of a structure: what its sensors see in addition to the mode of the law.

A mode among others answers a force F at the sensor with

    x = z + b(omega) F,     F = F_measured exp(i psi),     b = A + B/omega^2,

where z obeys the nonlinear law, A is what modes above add (their flexibility) and B/omega^2 what modes below
add (their inertia); both are complex, because those modes have damping, and because a sensor picks up some of
the drive (residual terms: Ewins, Modal Testing, 2000, Sec. 4.4). Within a band A and B are nearly collinear,
so they are carried as the value b0 in the middle of the band and the change b1 over the band. A mode too near
for these terms has one of its own, r/(omega_n^2 - omega^2 + 2 i zeta omega_n omega): it is linear.
A displacement o that does not depend on the force (pick-up from the generator) is a receptance o/F.
No background is the case without values.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeVar, cast

import numpy as np

from rsgen.common.arrays import Array, Chosen, ComplexArray
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import BACKGROUNDS, OFFSET

Table = TypeVar("Table")
"""Rows of a test, points or a surface: ``force`` (n,), ``harmonics`` (n, H+1), ``peak`` (n, 2)."""


@dataclass(frozen=True, slots=True, eq=False)
class BackgroundTerms:
    """M = exp(-i psi) and B of a background by its real values: psi, parts of b0, b1, o; a neighbour's.

    Parameters
    ----------
    kind, band
        Kind of the background, and the lowest and highest frequency [Hz] of its band.
    names, units
        Of the values.
    functions
        (n, t): what each complex term is multiplied by at each point; 1/F of an offset.
    omega
        (n,) [rad/s].
    """

    kind: str
    band: tuple[float, float]
    names: tuple[str, ...]
    units: tuple[str, ...]
    functions: ComplexArray
    omega: Array

    @property
    def _terms(self) -> int:
        return 1 + 2 * int(self.functions.shape[1])

    def select(self, chosen: Chosen) -> BackgroundTerms:
        """Take some of the points."""
        return replace(self, functions=self.functions[chosen], omega=self.omega[chosen])

    def without_neighbour(self) -> BackgroundTerms:
        """Return the residual terms alone, of a background with a neighbouring mode."""
        kind = self.kind.replace("neighbour", "residuals")
        return replace(self, kind=kind, names=self.names[:-4], units=self.units[:-4])

    def values_from(self, other: BackgroundTerms, values: Array) -> Array:
        """Return values (b,) with those of another background of the same band, zero where it has none."""
        known = dict(zip(other.names, values, strict=True))
        return np.array([known.get(name, 0.0) for name in self.names])

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

    def subtract(self, table: Table, values: Array) -> Table:
        """Leave the mode alone: its displacement, and the force in the phase of the response."""
        if not len(values):
            return table
        rows: Any = table
        force = rows.force * self.turn(values)
        harmonics = np.array(rows.harmonics)
        harmonics[:, 1] -= self.receptance(values) * force
        peak = rows.peak if np.all(self.functions == 0) else np.full_like(rows.peak, np.nan)
        return cast(Table, replace(rows, force=force, harmonics=harmonics, peak=peak))

    def mode_of(self, spectra: MultisineSpectra, values: Array) -> MultisineSpectra:
        """Leave the mode alone in records whose lines (r (H+1),) are the points; the mean stays."""
        if not len(values):
            return spectra
        turn = np.where(spectra.lines > 0, self.turn(values), 1)
        seen = self.receptance(values).reshape(len(spectra), 1, -1) * (spectra.lines > 0)
        force = spectra.force * turn
        return replace(spectra, force=force, response=spectra.response - seen * force)

    def slopes_by_force(self, values: Array) -> ComplexArray:
        """(n, b) derivatives by all values of the background response per turned force."""
        slopes = self.slopes(values)
        slopes[:, :1] = 1j * self.receptance(values)[:, None]
        return slopes

    def _neighbour(self, values: Array) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """(n,) receptance of a mode of mass 1 kg, and its derivatives by f_n [Hz] and zeta."""
        natural, zeta = 2 * np.pi * values[-2], values[-1]
        one = 1 / (natural**2 - self.omega**2 + 2j * zeta * natural * self.omega)
        by_frequency = -(one**2) * (2 * natural + 2j * zeta * self.omega) * 2 * np.pi
        return one, by_frequency, -(one**2) * 2j * natural * self.omega


def background_terms(
    kind: str, omega: Array, force: ComplexArray | Array, band: tuple[float, float]
) -> BackgroundTerms:
    """Return a background at some points.

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
    return BackgroundTerms(kind, band, names, units, columns, omega)


def background_of_lines(kind: str, spectra: MultisineSpectra, band: tuple[float, float]) -> BackgroundTerms:
    """Return a background at the lines (r (H+1),) of records.

    The force is that of excited lines; below the lowest one nothing drives, and terms keep their value there.
    """
    excited = spectra.excited()
    lowest = min(2 * np.pi * band[0], *spectra.omega[excited])
    omega = np.maximum(spectra.omega, lowest).reshape(-1)
    return background_terms(kind, omega, np.where(excited, np.abs(spectra.mean_force), 0).reshape(-1), band)
