"""The modal table: resonance frequency, damping ratio, stiffness and damping over the amplitude, no law.

At one amplitude X the structure acts as a linear one, F/X = k(X) - m omega^2 + i omega c(X, omega). Off
resonance it matters how c depends on the frequency: a force that does not depend on the rate, as of joints
and friction, has omega c = c_0(X), a linear damper omega c = omega c_1(X), a drag v|v| omega c = omega^2
c_2(X). With B-splines for k and c_j all is linear in their coefficients and in the mass, so that it is one
more forward model, which is given the amplitude. Smooth springs are polynomials of X^2, drag and gaps of X,
friction of 1/X; logarithms give a spring that hardens over decades as many knots everywhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding
from rsgen.common.linear_algebra import b_splines
from rsgen.common.text_table import MOST_DIGITS, Printed, TextTable, data_frame, short
from rsgen.common.tolerances import CONFIDENCE, NORMAL, SAME_NUMBER, t_quantile
from rsgen.data.oscillator import Observation
from rsgen.dynamics.harmonic_balance import Response
from rsgen.formula.units.quantities import ForceUnits
from rsgen.identification.fitting.forward import Forward
from rsgen.identification.results import Background

_MARGIN = 0.02
"""Splines reach so far beyond the amplitudes of the points, relatively: noise moves single ones outside."""

_BELOW = 2
"""Intervals below the tested amplitudes, whose points show the background and nothing that is tabulated."""


@dataclass(frozen=True, slots=True, eq=False)
class SplineBasis:
    """B-splines of a given degree, with knots in u = X^power; -X^power if that is negative, ln X if zero."""

    knots: Array
    degree: int
    power: int

    @classmethod
    def over(
        cls, amplitude: Array, tested: tuple[float, float], degree: int, intervals: int, power: int
    ) -> SplineBasis:
        """Share the amplitudes [m] within the tested ones among the intervals; two more serve those below."""
        size = amplitude[(amplitude >= tested[0]) & (amplitude <= tested[1])]
        inner = np.quantile(_place(size, power), np.linspace(0, 1, intervals + 1))
        inner[0] = _place(tested[0] / (1 + _MARGIN), power)
        inner[-1] = _place(float(amplitude.max()) * (1 + _MARGIN), power)
        lowest = float(_place(float(amplitude.min()) / (1 + _MARGIN), power))
        if degree and lowest < inner[0]:
            inner = np.concatenate([np.linspace(lowest, inner[0], _BELOW + 1)[:-1], inner])
        return cls(np.concatenate([[inner[0]] * degree, inner, [inner[-1]] * degree]), degree, power)

    @property
    def count(self) -> int:
        """How many functions."""
        return len(self.knots) - self.degree - 1

    @property
    def lowest(self) -> float:
        """Smallest amplitude [m] that points have shown."""
        first = float(self.knots[0])
        return float(np.exp(first) if not self.power else abs(first) ** (1 / self.power)) * (1 + _MARGIN)

    def __call__(self, amplitude: Array) -> tuple[Array, Array]:
        """(n, f) functions at amplitudes [m], and their derivatives by ln X; constant beyond the ends."""
        u = _place(amplitude, self.power)
        inside = np.clip(u, self.knots[0], self.knots[-1])
        by_log = np.where(u == inside, self.power * u if self.power else 1.0, 0.0)
        functions, slopes = b_splines(inside, self.knots, self.degree)
        return functions, slopes * by_log[:, None]


def _place(amplitude: ArrayLike, power: int) -> Array:
    """Coordinate u of amplitudes [m], which grows with them."""
    return np.asarray(np.log(amplitude) if not power else np.copysign(np.power(amplitude, power), power))


class SplineMode(Forward):
    """The mode as a forward model: values are the coefficients of k [N/m], then those of each c_j.

    ``orders`` are the powers j of omega with which the damping force grows at constant amplitude.
    """

    harmonics: tuple[int, ...] = ()
    exact_slopes = True
    step = 1e-4
    """As of the harmonic balance: error of central differences h^2, round-off eps/h."""

    def __init__(self, omega: Array, basis: SplineBasis, orders: tuple[int, ...]) -> None:
        self._basis, self._inertia = basis, omega**2
        self._factors = [np.ones(len(omega)), *(1j * omega**order for order in orders)]

    def __call__(self, values: Array, mass: float, size: Array, others: Array | None = None) -> Response:
        """Predict at (2 f,) coefficients, a mass [kg] and (n,) amplitudes [m]."""
        shape, slope = self._basis(size)
        by = np.concatenate([factor[:, None] * shape for factor in self._factors], axis=1)
        turn = np.concatenate([factor[:, None] * slope for factor in self._factors], axis=1)
        force = np.asarray(size * (by @ values - mass * self._inertia), dtype=np.complex128)
        by = np.column_stack([by, -self._inertia])
        harmonics = np.zeros((len(size), 2), dtype=np.complex128)
        harmonics[:, 1] = size
        return Response(
            force=force,
            harmonics=harmonics,
            force_slope=np.asarray(force + size * (turn @ values), dtype=np.complex128),
            harmonics_slope=harmonics,
            force_by=size[:, None] * by,
            harmonics_by=np.zeros((len(size), 2, by.shape[1]), dtype=np.complex128),
            valid=np.isfinite(force),
        )


@dataclass(frozen=True, slots=True, eq=False)
class ModalSplines:
    """Fitted splines of k [N/m] and of the damping, the mass m [kg], and what is known of their errors.

    Parameters
    ----------
    basis
        Of all.
    orders
        Powers of omega with which the damping force grows at constant amplitude.
    values
        (f + f o,) coefficients of k, then of the damping of each order.
    mass
        Identified, or given.
    covariance
        (q + 1, q + 1) of the values and of the mass; a given mass has none.
    freedom
        Degrees of freedom of the noise that the covariance rests on.
    others
        Splines of other shapes that fit as well, each with its weight (these make one): where they differ,
        as in gaps between amplitudes, points do not determine k and c.
    """

    basis: SplineBasis
    orders: tuple[int, ...]
    values: Array
    mass: float
    covariance: Array
    freedom: int
    others: tuple[tuple[float, ModalSplines], ...] = ()

    def at(self, amplitude: Array) -> tuple[Array, Array, Array]:
        """k [N/m], c [N s/m] at resonance, each (n,), and the covariance of k, c, m (n, 3, 3); X in m.

        To that of noise comes the spread of the other shapes (Burnham and Anderson, Model Selection and
        Multimodel Inference, 2002, Sec. 4.3).
        """
        k, c, errors = self._alone(amplitude)
        for weight, other in self.others:
            k_other, c_other, _ = other._alone(amplitude)
            mass = np.full(len(k), other.mass - self.mass)
            apart = np.nan_to_num(np.stack([k_other - k, c_other - c, mass], axis=1))
            errors = errors + weight * apart[:, :, None] * apart[:, None, :]
        return k, c, errors

    def _alone(self, amplitude: Array) -> tuple[Array, Array, Array]:
        """What this shape says, with the covariance of noise."""
        shape, _ = self.basis(amplitude)
        parts = self.values.reshape(-1, self.basis.count) @ shape.T
        k = parts[0]
        with np.errstate(invalid="ignore", divide="ignore"):
            omega = np.sqrt(k / self.mass)
            rates = [omega ** (order - 1) for order in self.orders]
            c = np.sum(rates * parts[1:], axis=0)
            # resonance moves with k and m, and c with it
            by_omega = [(j - 1) * rate / omega for j, rate in zip(self.orders, rates, strict=True)]
            turn = np.sum(by_omega * parts[1:], axis=0) * omega / 2
            by_k, by_mass = turn / k, -turn / self.mass
        slopes = np.zeros((len(amplitude), 3, len(self.covariance)))
        count = self.basis.count
        slopes[:, 0, :count] = shape
        slopes[:, 1, :count] = by_k[:, None] * shape
        for place, rate in enumerate(rates, 1):
            slopes[:, 1, place * count : (place + 1) * count] = rate[:, None] * shape
        slopes[:, 1, -1] = by_mass
        slopes[:, 2, -1] = 1.0
        return k, c, slopes @ self.covariance @ np.swapaxes(slopes, 1, 2)

    def respond(self, amplitude: Array, omega: Array) -> NDArray[np.complex128]:
        """(n,) complex force [N] that holds the amplitudes X [m] at frequencies [rad/s]; phase of X zero."""
        mode = SplineMode(omega, self.basis, self.orders)
        return mode(self.values, self.mass, amplitude).force


# ----------------------------------------------------------------------------
# What a modal table holds.

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
    level_unit, units
        As of the response surface.
    background
        What was fitted beside the mode; None where nothing was asked for.
    """

    observation: Observation
    levels: Array
    frequencies: tuple[float, float]
    level_unit: str
    units: ForceUnits
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
        mass = "mass not known" if isfinite(self.test.units.kilogram) else "per unit mass"
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
