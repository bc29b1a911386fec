"""The modal table: resonance frequency, damping ratio, stiffness and damping over the amplitude, no law."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding
from rsgen.common.text_table import MOST_DIGITS, Printed, TextTable, data_frame, short
from rsgen.common.tolerances import CONFIDENCE, NORMAL, SAME_NUMBER, t_quantile
from rsgen.data.oscillator import Observation
from rsgen.identification.modal.modal_splines import ModalSplines
from rsgen.identification.results import Background

__all__ = ["MODAL_COLUMNS", "ModalTable", "ModalTest"]


MODAL_COLUMNS = {
    "frequency": "Hz",
    "damping_ratio": "",
    "stiffness": "N/m",
    "damping": "N*s/m",
    "stiffness_per_mass": "1/s^2",
    "damping_per_mass": "1/s",
}
"""Columns of a modal table after the amplitude [m], with their units."""


@dataclass(frozen=True, slots=True, eq=False)
class ModalTest:
    """What a modal table knows of its test.

    Parameters
    ----------
    observation
        How the structure was observed.
    levels
        Forces [N, per mass N/kg] near the resonances of the levels that took part.
    frequencies
        Lowest and highest frequency [Hz] of the points.
    level_unit, per_mass
        As of the response surface.
    background
        What was fitted beside the mode; None where nothing was asked for.
    """

    observation: Observation
    levels: Array
    frequencies: tuple[float, float]
    level_unit: str
    per_mass: bool
    background: Background | None


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ModalTable(Printed):
    """What a test says of the mode at each amplitude, without a law; ``rsgen.modal_table`` makes it.

    Every column is an attribute, (r,), and so are the ends of its 95 % interval: ``table.frequency``,
    ``table.frequency_lower``, ``table.frequency_upper``. Columns are ``frequency`` [Hz], where the response
    lags the force by a quarter period, ``damping_ratio`` zeta = c/(2 sqrt(k m)) [1], ``stiffness`` k(X)
    [N/m], ``damping`` c(X) [N s/m], ``stiffness_per_mass`` k(X)/m [1/s^2] and ``damping_per_mass`` c(X)/m
    [1/s]. One that the test does not determine is NaN.

    Parameters
    ----------
    amplitude
        (r,) X of the fundamental of the displacement [m], ascending.
    splines
        The fit, which ``at`` evaluates at any amplitude.
    known
        Names of the columns that the test determines.
    tested
        Lowest and highest amplitude [m] at which points lie near resonance; rows outside are extrapolation.
    mass, mass_error
        m [kg] and its standard error: zero where it was given; NaN both where it is not known.
    misfit
        Root mean square distance of the points from F/X = k(X) - m omega^2 + i omega c(X), relative to force
        and response [1].
    points
        How many test points it rests on.
    test
        What predictions need to know of the test.
    findings
        What a reader should know.
    """

    amplitude: Array
    splines: ModalSplines
    known: tuple[str, ...]
    tested: tuple[float, float]
    mass: float
    mass_error: float
    misfit: float
    points: int
    test: ModalTest
    findings: tuple[Finding, ...] = ()
    _columns: dict[str, Array] = field(init=False)

    def __post_init__(self) -> None:
        amplitude = np.array(self.amplitude, dtype=np.float64, ndmin=1)
        if amplitude.ndim != 1 or not np.all(np.isfinite(amplitude) & (amplitude > 0)):
            raise RsgenError("modal table: amplitudes must be positive and finite, one row each [m]")
        amplitude.flags.writeable = False
        object.__setattr__(self, "amplitude", amplitude)
        object.__setattr__(self, "_columns", _tabulate(self.splines, amplitude, self.known))

    def __getattr__(self, name: str) -> Array:
        columns: dict[str, Array] = object.__getattribute__(self, "_columns")
        if name not in columns:
            raise AttributeError(f"a modal table has no {name!r}; it has amplitude, {', '.join(columns)}")
        return columns[name]

    def __len__(self) -> int:
        """Count the rows."""
        return len(self.amplitude)

    def __iter__(self) -> Iterator[dict[str, float]]:
        """Give row after row: amplitude, columns and ends of intervals by name."""
        whole = {"amplitude": self.amplitude, **self._columns}
        for row in range(len(self)):
            yield {name: float(column[row]) for name, column in whole.items()}

    @property
    def omega(self) -> Array:
        """(r,) resonance frequency [rad/s]."""
        return np.asarray(2 * np.pi * self._columns["frequency"])

    @property
    def shown(self) -> tuple[str, ...]:
        """Names of the columns that are known: those per mass where stiffness and damping are not."""
        absolute = {"stiffness_per_mass": "stiffness", "damping_per_mass": "damping"}
        return tuple(name for name in self.known if absolute.get(name) not in self.known)

    def at(self, amplitude: ArrayLike) -> ModalTable:
        """Give the table at other amplitudes [m], those outside ``tested`` extrapolated as constants.

        Raises
        ------
        RsgenError
            An amplitude is not positive and finite.
        """
        return replace(self, amplitude=np.asarray(amplitude, dtype=np.float64))

    def to_frame(self) -> Any:
        """Give the table as a ``pandas.DataFrame`` with the amplitude as its index.

        Raises
        ------
        RsgenError
            pandas is not installed.
        """
        return data_frame({"amplitude": self.amplitude, **self._columns}, "amplitude")

    def to_csv(self) -> str:
        """Give the table as text with commas: a line of names with units, then a line a row; SI units.

        What is not known is an empty cell.
        """
        heads = ["amplitude [m]"]
        for name, unit in MODAL_COLUMNS.items():
            label = f"{name} [{unit or '1'}]"
            heads += [label, f"lower {label}", f"upper {label}"]
        lines = [",".join(heads)]
        lines += [",".join(short(value, MOST_DIGITS) for value in row.values()) for row in self]
        return "\n".join(lines) + "\n"

    def _table(self) -> TextTable:
        shown = {name: MODAL_COLUMNS[name] for name in self.shown}
        rows = []
        for row in self:
            cells = [short(row["amplitude"])]
            for name in shown:
                half = (row[f"{name}_upper"] - row[f"{name}_lower"]) / 2
                cells.append(f"{short(row[name], 6)} ± {short(half, 2)}" if isfinite(half) else "")
            rows.append(tuple(cells))
        heads = ("X [m]", *(f"{name} [{unit or '1'}]" for name, unit in shown.items()))
        mass = "per unit mass" if self.test.per_mass else "mass not known"
        if isfinite(self.mass):
            error = f" ± {short(NORMAL * self.mass_error, 2)}" if self.mass_error else ", given"
            mass = f"mass {short(self.mass, 6)} kg{error}"
        caption = f"Modal table without a law: {self.points} points, misfit {self.misfit:.2g}, {mass}"
        notes = list(map(repr, self.findings))
        low, high = self.tested
        # the least and the largest amplitude of a table itself are the ends
        beyond = (self.amplitude < low * (1 - SAME_NUMBER)) | (self.amplitude > high * (1 + SAME_NUMBER))
        if beyond.any():
            notes.append(
                f"extrapolated as constants outside {short(low)} to {short(high)} m: nothing is known there"
            )
        return TextTable(heads, tuple(rows), caption, tuple(notes))


def _tabulate(splines: ModalSplines, amplitude: Array, known: tuple[str, ...]) -> dict[str, Array]:
    """Columns with the ends of their intervals, by linear propagation of the errors of k, c and m."""
    k, c, errors = splines.at(amplitude)
    m = splines.mass
    one, none = np.ones(len(k)), np.zeros(len(k))
    with np.errstate(invalid="ignore", divide="ignore"):
        frequency = np.sqrt(k / m) / (2 * np.pi)
        ratio = c / (2 * np.sqrt(k * m))
        values = {
            "frequency": (frequency, (0.5 * frequency / k, none, -0.5 * frequency / m)),
            "damping_ratio": (ratio, (-0.5 * ratio / k, 0.5 / np.sqrt(k * m), -0.5 * ratio / m)),
            "stiffness": (k, (one, none, none)),
            "damping": (c, (none, one, none)),
            "stiffness_per_mass": (k / m, (one / m, none, -k / m**2)),
            "damping_per_mass": (c / m, (none, one / m, -c / m**2)),
        }
    wide = float(t_quantile(splines.freedom, CONFIDENCE))
    columns: dict[str, Array] = {}
    for name, (value, slopes) in values.items():
        slope = np.stack([np.broadcast_to(part, k.shape) for part in slopes], axis=1)
        variance = np.einsum("ni,nij,nj->n", slope, errors, slope)
        half = wide * np.sqrt(np.maximum(variance, 0.0))
        value = value if name in known else np.full(len(k), np.nan)
        for label, column in (
            (name, value),
            (f"{name}_lower", value - half),
            (f"{name}_upper", value + half),
        ):
            column.flags.writeable = False
            columns[label] = column
    return columns
