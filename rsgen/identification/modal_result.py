"""The modal table: resonance frequency, damping ratio, stiffness and damping over the amplitude, without a
law.

At one amplitude X the structure acts as a linear one,

    F/X = k(X) - m omega^2 + i sum_j omega^j c_j(X).

The order j of the damping matters off resonance: a force that does not depend on the rate, as of joints and
friction, has j = 0, a linear damper j = 1, a drag v|v| j = 2. With B-splines for k and c_j the equation is
linear in their coefficients and in the mass (de Boor, A Practical Guide to Splines, 1978), so that it is a
forward model like a law, for a given amplitude. The coordinate of the splines is a power of X: smooth springs
are polynomials of X^2, drag and gaps of X, friction of 1/X; a spring that hardens over decades needs ln X.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import isfinite, nan

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag

from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, quantities
from rsgen.common.solvers import b_splines
from rsgen.common.text_table import MAX_DIGITS, Brief, Printed, TextTable, short
from rsgen.common.tolerances import (
    MISFIT_EXPLAINED,
    RELATIVE_CHANGE_NEGLIGIBLE,
    interval_sigmas,
)
from rsgen.data.oscillator import Observation
from rsgen.data.surface.response_surface import HALF_POWER
from rsgen.dynamics.harmonic_balance import Response
from rsgen.formula.units import ForceUnits
from rsgen.identification.fitting.forward import Forward
from rsgen.identification.fitting.observed import Observed
from rsgen.identification.fitting.points import Points, amplitudes_near
from rsgen.identification.results import Background, Estimate

_AMPLITUDE_MARGIN = 0.02
"""Relative extension of the splines beyond the amplitudes of the points, for noise."""

MIN_LIKELIHOOD = 1e-3
"""Likelihood of a shape relative to the best from which on it has a part in the model average."""

_INTERVALS_BELOW = 2
"""Intervals below the tested amplitudes, for points that determine the background only."""


@dataclass(frozen=True, slots=True, eq=False)
class SplineBasis:
    """B-splines of a given degree, with knots in u = X^power; -X^power if that is negative, ln X if zero.

    They are constant beyond the outer knots, and below the amplitude ``least`` [m].
    """

    knots: Array
    degree: int
    power: int
    least: float = 0.0

    @classmethod
    def over(
        cls, amplitude: Array, tested: tuple[float, float], degree: int, intervals: int, power: int
    ) -> SplineBasis:
        """Make intervals with equal numbers of the tested amplitudes [m], and two more below these."""
        size = amplitude[(amplitude >= tested[0]) & (amplitude <= tested[1])]
        inner = np.quantile(_coordinate(size, power), np.linspace(0, 1, intervals + 1))
        inner[0] = _coordinate(tested[0] / (1 + _AMPLITUDE_MARGIN), power)
        inner[-1] = _coordinate(float(amplitude.max()) * (1 + _AMPLITUDE_MARGIN), power)
        lowest = float(_coordinate(float(amplitude.min()) / (1 + _AMPLITUDE_MARGIN), power))
        if degree and lowest < inner[0]:
            inner = np.concatenate([np.linspace(lowest, inner[0], _INTERVALS_BELOW + 1)[:-1], inner])
        return cls(np.concatenate([[inner[0]] * degree, inner, [inner[-1]] * degree]), degree, power)

    @classmethod
    def steps(cls, held: Array) -> SplineBasis:
        """Make functions that are one at one of the amplitudes (l,) [m] held, and zero at others."""
        between = np.log(held[:-1] * held[1:]) / 2
        ends = np.log(held[[0, -1]]) + np.log1p(_AMPLITUDE_MARGIN) * np.array([-1, 1])
        return cls(np.concatenate([ends[:1], between, ends[1:]]), 0, 0)

    @property
    def count(self) -> int:
        """Number of functions."""
        return len(self.knots) - self.degree - 1

    @property
    def lowest(self) -> float:
        """Smallest amplitude of the points [m]."""
        first = float(self.knots[0])
        return float(np.exp(first) if not self.power else abs(first) ** (1 / self.power)) * (
            1 + _AMPLITUDE_MARGIN
        )

    def __call__(self, amplitude: Array) -> Array:
        """Return the functions (n, f) at amplitudes [m]."""
        return np.asarray(b_splines(self.knots, self.degree)(self._places(amplitude)[1]))

    def slopes(self, amplitude: Array) -> Array:
        """Return the derivatives (n, f) of the functions by ln X."""
        u, inside = self._places(amplitude)
        moving = (u == inside) & (amplitude >= self.least)
        by_log = np.where(moving, self.power * u if self.power else 1.0, 0.0)
        return b_splines(self.knots, self.degree)(inside, nu=1) * by_log[:, None]

    def _places(self, amplitude: Array) -> tuple[Array, Array]:
        """Return the coordinate at amplitudes (n,) [m], and the nearest between the outer knots."""
        u = _coordinate(np.maximum(amplitude, self.least), self.power)
        return u, np.clip(u, self.knots[0], self.knots[-1])


def _coordinate(amplitude: ArrayLike, power: int) -> Array:
    """Return the coordinate u of amplitudes [m], which grows with them."""
    return np.asarray(np.log(amplitude) if not power else np.copysign(np.power(amplitude, power), power))


class SplineMode(Forward):
    """The mode as a forward model; its values are the coefficients of k [N/m], then those of each c_j.

    ``orders`` are the powers j of omega with which the damping force grows at constant amplitude.
    """

    def __init__(self, omega: Array, basis: SplineBasis, orders: tuple[int, ...]) -> None:
        self._basis, self._inertia = basis, omega**2
        self._factors = [np.ones(len(omega)), *(1j * omega**order for order in orders)]

    def __call__(self, values: Array, mass: float, size: Array, others: Array | None = None) -> Response:
        """Predict at (2 f,) coefficients, a mass [kg] and (n,) amplitudes [m]."""
        shape, slope = self._basis(size), self._basis.slopes(size)
        by = np.concatenate([factor[:, None] * shape for factor in self._factors], axis=1)
        turn = np.concatenate([factor[:, None] * slope for factor in self._factors], axis=1)
        force = np.asarray(size * (by @ values - mass * self._inertia), dtype=np.complex128)
        by = np.column_stack([by, -self._inertia])
        growth = np.asarray(force + size * (turn @ values), dtype=np.complex128)
        return Response.at_amplitude(size, force, growth, size[:, None] * by)


@dataclass(frozen=True, slots=True, eq=False)
class ModePoints:
    """The points as observed, the same without a first background, and the amplitudes near resonance [m].

    ``first`` has the mass of the polynomial law with which the first background was found, its standard
    error [kg], and the misfit of this law; NaN without a background. ``held`` (n,) has the amplitudes [m]
    that the levels held, those that hardly differ as one; NaN where one of them varied.
    """

    observed: Observed
    mode: Points
    background: Array
    tested: tuple[float, float]
    held: Array
    first: tuple[float, float, float] = (nan, nan, nan)

    def select(self, rows: NDArray[np.intp]) -> ModePoints:
        """Keep some points."""
        observed, mode = self.observed.select(rows), self.mode.select(rows)
        return replace(self, observed=observed, mode=mode, held=self.held[rows])

    @property
    def levels(self) -> Array:
        """Amplitudes (l,) [m] that were held; none where they varied."""
        return np.unique(self.held[np.isfinite(self.held)])

    @property
    def near(self) -> Array:
        """Amplitudes [m] of the points near resonance, ascending."""
        return amplitudes_near(self.mode)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ModalSplines(Brief):
    """Fitted splines of k [N/m] and of the damping, the mass m [kg], and their covariance.

    Parameters
    ----------
    basis
        B-splines of k and of each c_j.
    orders
        Powers of omega with which the damping force grows at constant amplitude.
    values
        (f + f o,) coefficients of k, then of the damping of each order.
    mass
        Identified or known mass [kg].
    covariance
        (q + 1, q + 1) covariance of the values and the mass; zero for a known mass.
    freedom
        Degrees of freedom of the estimated noise.
    others
        Splines of other shapes and orders that fit as well, with weights: where they differ, as in gaps
        between amplitudes, the points do not determine k and c.
    held
        (l,) amplitudes [m] that the levels held; empty where they varied.
    """

    basis: SplineBasis
    orders: tuple[int, ...]
    values: Array
    mass: float
    covariance: Array
    freedom: int
    others: tuple[tuple[float, ModalSplines], ...] = ()
    held: Array = field(default_factory=partial(np.zeros, 0))

    @property
    def mass_error(self) -> float:
        """Standard error of the mass [kg], that of the covariances of ``at``."""
        return float(np.sqrt(self.at(np.ones(1))[2][0, 2, 2]))

    def at(self, amplitude: Array) -> tuple[Array, Array, Array]:
        """Return k [N/m], c [N s/m] at resonance, each (n,), and the covariance of k, c, m (n, 3, 3).

        The spread of the other shapes is added to the covariance of noise: model averaging (Burnham and
        Anderson, Model Selection and Multimodel Inference, 2002, Sec. 4.3).
        """
        k, c, errors = self._evaluate(amplitude)
        spread = self.spread(amplitude)
        return k, c, errors + spread @ np.swapaxes(spread, 1, 2)

    def spread(self, amplitude: Array) -> Array:
        """Return standard errors (n, 3, s) of k, c, m that the points leave open, of s independent causes.

        Half way between levels that were held intervals contain every monotone course.
        """
        k, c, _ = self._evaluate(amplitude)
        causes = [np.zeros((len(k), 3))]
        if len(self.held) > 1:
            # between two levels k and c may take any course each from one value to the other
            right = np.clip(np.searchsorted(self.held, amplitude), 1, len(self.held) - 1)
            margin = RELATIVE_CHANGE_NEGLIGIBLE * np.array([[1], [-1]])
            ends = np.log(np.stack([self.held[right - 1], self.held[right]])) + margin
            part = np.clip((np.log(amplitude) - ends[0]) / (ends[1] - ends[0]), 0, 1)
            values = np.stack(self._evaluate(self.held)[:2], axis=1)
            course = np.pad(values[right] - values[right - 1], ((0, 0), (0, 1)))
            causes += [np.sqrt(part * (1 - part))[:, None] * course * own for own in np.eye(3)[:2]]
        for weight, other in self.others:
            k_other, c_other, _ = other._evaluate(amplitude)
            mass = np.full(len(k), other.mass - self.mass)
            difference = np.nan_to_num(np.stack([k_other - k, c_other - c, mass], axis=1))
            causes.append(weight**0.5 * difference)
        return np.stack(causes, axis=2)

    def damped(self, amplitude: Array) -> bool:
        """Return True if no interval of c at resonance contains zero at some amplitudes (n,) [m]."""
        _, c, errors = self.at(amplitude)
        return bool(np.all(interval_sigmas(self.freedom) * np.sqrt(errors[:, 1, 1]) < c))

    def _evaluate(self, amplitude: Array) -> tuple[Array, Array, Array]:
        """Return k, c of this shape alone, and their covariance by noise."""
        shape = self.basis(amplitude)
        parts = self.values.reshape(-1, self.basis.count) @ shape.T
        k = parts[0]
        with np.errstate(invalid="ignore", divide="ignore"):
            omega = np.sqrt(k / self.mass)
            rates = [omega ** (order - 1) for order in self.orders]
            c = np.sum(rates * parts[1:], axis=0)
            # c at resonance depends on k and m through the frequency
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

    def through(self, held: Array) -> ModalSplines:
        """Return splines of steps as lines over ln X through their values at the amplitudes held (l,) [m].

        The last line goes on: a corner at the end of the tested amplitudes would be a jump of the response.
        """
        basis = SplineBasis.steps(held)
        knots = np.concatenate([basis.knots[:1], np.log(held), basis.knots[-1:]])
        lines = np.eye(len(held))[np.pad(np.arange(len(held)), 1, mode="edge")]
        lines[-1] += (lines[-1] - lines[-3]) * (knots[-1] - knots[-2]) / (knots[-2] - knots[-3])
        transform = block_diag(*[lines] * (1 + len(self.orders)), np.eye(1))
        return replace(
            self,
            basis=SplineBasis(np.pad(knots, 1, mode="edge"), 1, 0),
            values=transform[:-1, :-1] @ self.values,
            covariance=transform @ self.covariance @ transform.T,
            others=tuple((weight, other.through(held)) for weight, other in self.others),
            held=held,
        )


# ----------------------------------------------------------------------------
# The table.

MODAL_COLUMNS = {
    "frequency": "Hz",
    "damping_ratio": "",
    "stiffness": "N/m",
    "damping": "N*s/m",
    "stiffness_per_mass": "1/s^2",
    "damping_per_mass": "1/s",
}
"""Columns of a modal table after the amplitude [m], with their units."""


def known_columns(kilogram: float, *, calibrated: bool, mass: bool = True) -> tuple[str, ...]:
    """Return the columns that a test determines, by its unit of a mass, NaN where forces are per mass.

    Without a mass, at phase resonance alone, they are the frequency, the stiffness per mass, and the damping
    of calibrated forces.
    """
    forces = () if calibrated and (isfinite(kilogram) or not mass) else ("stiffness", "damping")
    known = MODAL_COLUMNS if mass else ("frequency", "damping", "stiffness_per_mass")
    return tuple(name for name in known if name not in forces)


@dataclass(frozen=True, slots=True, eq=False)
class ModalTest:
    """The test of a modal table, as predictions need it.

    Parameters
    ----------
    observation
        How the structure was observed.
    levels
        Forces [N, per mass N/kg] near the resonances of the fitted levels.
    frequencies
        Lowest and highest frequency [Hz] of the points.
    level_unit, units
        As of the response surface.
    background
        The fitted background; None if none was asked for.
    base
        Motion of a base that drove the test; "" of a force.
    """

    observation: Observation
    levels: Array
    frequencies: tuple[float, float]
    level_unit: str
    units: ForceUnits
    background: Background | None
    base: str = ""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ModalTable(Printed):
    """The mode at each amplitude, identified without a law; made by ``rsgen.modal_table``.

    Every column is an attribute, (r,), and so are the ends of its 95 % interval: ``table.frequency``,
    ``table.frequency_lower``, ``table.frequency_upper``. Columns are ``frequency`` [Hz], where the response
    lags the force by a quarter period, ``damping_ratio`` zeta = c/(2 sqrt(k m)) [1], ``stiffness`` k(X)
    [N/m], ``damping`` c(X) [N s/m], ``stiffness_per_mass`` k(X)/m [1/s^2] and ``damping_per_mass`` c(X)/m
    [1/s]. A column that the test does not determine is NaN.

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
        m [kg] and its standard error, which is zero for a given mass; both NaN if the mass is not known.
    misfit
        Root mean square distance of the points from F/X = k(X) - m omega^2 + i omega c(X), relative to force
        and response [1].
    points
        Number of fitted test points.
    test
        The test, as predictions need it.
    findings
        Warnings to the reader of the table.
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
        object.__setattr__(self, "_columns", _tabulate(self))

    def __dir__(self) -> list[str]:
        return sorted({*object.__dir__(self), *self._columns})

    def __getattr__(self, name: str) -> Array:
        columns: dict[str, Array] = object.__getattribute__(self, "_columns")
        if name not in columns:
            raise AttributeError(f"a modal table has no {name!r}; it has amplitude, {', '.join(columns)}")
        return columns[name]

    def __len__(self) -> int:
        """Count the rows."""
        return len(self.amplitude)

    def __iter__(self) -> Iterator[dict[str, float]]:
        """Iterate over rows: amplitude, columns and ends of intervals by name."""
        columns = {"amplitude": self.amplitude, **self._columns}
        for row in range(len(self)):
            yield {name: float(column[row]) for name, column in columns.items()}

    @property
    def omega(self) -> Array:
        """(r,) resonance frequency [rad/s]."""
        return np.asarray(2 * np.pi * self._columns["frequency"])

    @property
    def _beyond(self) -> NDArray[np.bool_]:
        """(r,) True outside ``tested`` and the points below that determine a background."""
        ends = min(self.tested[0], self.splines.basis.lowest), self.tested[1]
        low, high = np.array(ends) * (1 + RELATIVE_CHANGE_NEGLIGIBLE * np.array([-1, 1]))
        return np.asarray((self.amplitude < low) | (self.amplitude > high))

    @property
    def shown(self) -> tuple[str, ...]:
        """Names of the printed columns: those per mass only if the absolute ones are unknown."""
        absolute = {"stiffness_per_mass": "stiffness", "damping_per_mass": "damping"}
        return tuple(name for name in self.known if absolute.get(name) not in self.known)

    def at(self, amplitude: ArrayLike) -> ModalTable:
        """Return the table at other amplitudes [m]; outside ``tested`` the ends continue without intervals.

        Raises
        ------
        RsgenError
            An amplitude is not positive and finite.
        """
        return replace(self, amplitude=np.asarray(amplitude, dtype=np.float64))

    def to_csv(self) -> str:
        """Return the table as CSV: a line of names with units, then a line a row; SI units.

        Unknown values are empty cells.
        """
        heads = ["amplitude [m]"]
        for name, unit in MODAL_COLUMNS.items():
            label = f"{name} [{unit or '1'}]"
            heads += [label, f"lower {label}", f"upper {label}"]
        lines = [",".join(heads)]
        lines += [",".join(short(value, MAX_DIGITS) for value in row.values()) for row in self]
        return "\n".join(lines) + "\n"

    @property
    def table(self) -> TextTable:
        """The table that is printed."""
        shown = {name: MODAL_COLUMNS[name] for name in self.shown}
        rows = []
        for row in self:
            cells = [short(row["amplitude"])]
            for name in shown:
                half = (row[f"{name}_upper"] - row[f"{name}_lower"]) / 2
                value = short(row[name], 6) if isfinite(row[name]) else ""
                cells.append(f"{value} ± {short(half, 2)}" if isfinite(half) else value)
            rows.append(tuple(cells))
        heads = ("X [m]", *(f"{name} [{unit or '1'}]" for name, unit in shown.items()))
        mass = "mass not known" if isfinite(self.test.units.kilogram) else "per unit mass"
        if isfinite(self.mass):
            error = f" ± {short(interval_sigmas() * self.mass_error, 2)}" if self.mass_error else ", given"
            error = error if isfinite(self.mass_error) else ", its error not determined"
            mass = f"mass {short(self.mass, 6)} kg{error}"
        caption = f"Modal table without a law: {self.points} points, misfit {100 * self.misfit:.2g} %, {mass}"
        notes = list(map(str, self.findings))
        if self._beyond.any():
            low, high = map(short, self.tested)
            notes.append(f"outside {low} to {high} m the end values continue: nothing is known there")
        return TextTable(heads, tuple(rows), caption, tuple(notes))


_TABLE_ROWS = 21


def table_amplitudes(
    tested: tuple[float, float], held: Sequence[float] | Array = (), gaps: Iterable[Array] = ()
) -> Array:
    """Return held amplitudes between two [m]; where none is held, some of equal ratio, of equal ones one.

    Those within a gap are replaced by its ends.
    """
    held = np.asarray(held)
    if len(held):
        return held[(held >= tested[0]) & (held <= tested[1])]
    rows = np.geomspace(*tested, _TABLE_ROWS) if tested[1] > tested[0] else np.array(tested[:1])
    for low, high in gaps:
        inside = (rows > low) & (rows < high)
        rows[inside] = np.where(rows[inside] ** 2 < low * high, low, high)
    return np.unique(rows)


def gaps_between(size: Array, held_out: Array) -> Array:
    """Return the ends (g, 2) [m] of gaps between ascending amplitudes, wider than one level is, that have
    some of those ``held_out`` in them.
    """
    above = np.unique(np.searchsorted(size, held_out))
    above = above[(above > 0) & (above < len(size))]
    ends = np.stack([size[above - 1], size[above]], axis=1)
    return np.asarray(ends[ends[:, 1] * HALF_POWER > ends[:, 0]])


def holes(held: Array, gaps: Array) -> tuple[Finding, ...]:
    """Find amplitudes that the table only interpolates: between those held (l,) [m], or in ``gaps`` (g, 2)
    that levels held out have left. None or one, the widest.
    """
    ends = gaps_between(held, np.sqrt(held[1:] * held[:-1])) if len(held) else gaps
    if not len(ends):
        return ()
    low, high = ends[np.argmax(ends[:, 1] / ends[:, 0])]
    numbers = quantities("m", low=low, high=high)
    if len(held):
        return (Finding("modal-hole", "info", "", numbers, {"by": "held"}),)
    return (Finding("modal-hole", "warning", "", numbers),)


def scattered(misfit: float) -> tuple[Finding, ...]:
    """Find a misfit that no describing function explains; none or one."""
    if misfit <= MISFIT_EXPLAINED:
        return ()
    return (Finding("modal-scattered", "warning", numbers=quantities(misfit=misfit)),)


def other_mass(table: ModalTable, law: Iterable[Estimate]) -> list[Finding]:
    """Find that the intervals of the mass in a table and among the values of a law have no common value."""
    half = float(interval_sigmas(table.splines.freedom)) * table.mass_error
    masses = (one for one in law if one.name == "m" and one.identifiable and one.standard_error * half > 0)
    for one in masses:
        if max(one.interval[0] - table.mass, table.mass - one.interval[1]) > half:
            numbers = quantities("kg", table=table.mass, law=one.value)
            numbers |= quantities(ratio=table.mass / one.value)
            return [Finding("results-disagree", "warning", "m", numbers, {"by": "modal table"})]
    return []


def _tabulate(table: ModalTable) -> dict[str, Array]:
    """Return the columns and the ends of their intervals, by linear propagation of the errors of k, c, m."""
    splines = table.splines
    k, c, errors = splines.at(np.minimum(table.amplitude, table.tested[1]))
    m = splines.mass
    one, zero = np.ones(len(k)), np.zeros(len(k))
    with np.errstate(invalid="ignore", divide="ignore"):
        frequency = np.sqrt(k / m) / (2 * np.pi)
        ratio = c / (2 * np.sqrt(k * m))
        values = {
            "frequency": (frequency, (0.5 * frequency / k, zero, -0.5 * frequency / m)),
            "damping_ratio": (ratio, (-0.5 * ratio / k, 0.5 / np.sqrt(k * m), -0.5 * ratio / m)),
            "stiffness": (k, (one, zero, zero)),
            "damping": (c, (zero, one, zero)),
            "stiffness_per_mass": (k / m, (one / m, zero, -k / m**2)),
            "damping_per_mass": (c / m, (zero, one / m, -c / m**2)),
        }
    wide = float(interval_sigmas(splines.freedom))
    columns: dict[str, Array] = {}
    for name, (value, slopes) in values.items():
        slope = np.stack([np.broadcast_to(part, k.shape) for part in slopes], axis=1)
        variance = np.einsum("ni,nij,nj->n", slope, errors, slope)
        half = np.where(table._beyond, np.nan, wide * np.sqrt(np.maximum(variance, 0.0)))
        value = value if name in table.known else np.full(len(k), np.nan)
        for label, column in (
            (name, value),
            (f"{name}_lower", value - half),
            (f"{name}_upper", value + half),
        ):
            column.flags.writeable = False
            columns[label] = column
    return columns
