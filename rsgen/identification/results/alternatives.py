"""Alternatives to a fit, to first order: another term, a larger background, halves of the test.

Errors are widened by the shift that an alternative makes, sigma^2 + weight shift^2: model averaging of two
laws that are equally likely before the test (Buckland, Burnham and Augustin, Biometrics 53, 1997).

A half is identified by one Gauss-Newton step from the solution of all points, with the rows of that fit. In
the coordinates of ``Regression.basis`` all points have unit information, so that a half and the rest, I and 1
- I, have the same eigenvectors, and the difference of their estimates along each is a test of its own (Chow,
Econometrica 28, 1960, as a score test).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import exp, nan

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.errors import listed
from rsgen.common.finding import Finding, Quantity, Severity, quantities
from rsgen.common.solvers import solve_scaled, summed_products
from rsgen.common.text_table import Brief
from rsgen.common.tolerances import (
    MIN_NULL_COMPONENT,
    MISFIT_NEGLIGIBLE,
    MISFIT_OF_NOISE,
    NOISE_LIMIT_SIGMAS,
    RELATIVE_CHANGE_NEGLIGIBLE,
    RELATIVE_ERROR_DOUBTFUL,
    STANDARD_ERRORS_OF_DIFFERENCE,
    chi_square_exceeded,
    f_tail,
    interval_sigmas,
    is_significant,
    normal_share,
)
from rsgen.data.oscillator import BACKGROUNDS
from rsgen.formula.units import number_text
from rsgen.identification.fitting.least_squares import Regression, Rules
from rsgen.identification.fitting.points import Points


@dataclass(frozen=True, slots=True, eq=False)
class Alternative:
    """Columns added to a fit: value, standard error, parameters' shift (q,), and its errors if asked.

    ``left`` is the share of the points' misfit that it leaves, if asked; a weighed mass is in the gain alone.
    A half of a test counts as one column: its gain is already that of the directions beyond noise alone.
    """

    value: float
    error: float
    shift: Array
    columns: int = 1
    hidden: Array | None = None
    left: float = nan

    @property
    def gain(self) -> float:
        """Decrease of the sum of squares, in units of the noise."""
        return (self.value / self.error) ** 2 if self.error > 0 else 0.0

    @property
    def weight(self) -> float:
        """Weight of its shift: of one column its likelihood over the sum of both; of several, whose shifts
        noise alone makes large, 1 where noise has such a gain less than once in twenty, else 0.
        """
        one = self.columns == 1
        return 1 / (1 + exp(-self.gain / 2)) if one else float(self.exceeds(CHANCE_OF_ALTERNATIVE))

    def exceeds(self, chance: float) -> bool:
        """Return True if noise alone gives so many columns such a gain less often."""
        return self.gain > chi_square_exceeded(self.columns, chance)


def alternatives(
    residual: Array, matrix: Array, columns: Array, score: Array, readings: Array, rules: Rules
) -> list[Alternative]:
    """Add each of some columns to a fit, to first order from its solution.

    Without readings the error is the larger one of equal and of unequal noise (White, Econometrica, 1980).

    Parameters
    ----------
    residual, matrix
        (r,) and (r, q) at the solution, of unit variance, without nuisances.
    columns
        (r, t) columns that may be missing; each is added alone.
    score
        (q + t,) expected product of slope and residual by their common noise.
    readings
        (P, r) deviations of single readings from their mean, whose scatter enlarges the errors.
    rules
        Which parameters are fixed, and the record of each point, which has r/n rows, rounded down.

    Returns
    -------
    list
        (t,), with value zero for a column that depends on the others.
    """
    own_score, added = np.split(score, [matrix.shape[1]])
    known = np.where(np.broadcast_to(rules.free, matrix.shape[1:]), np.nan, 0.0)
    inverse = solve_scaled(matrix, residual, known=known)[1] if matrix.size else np.zeros(matrix.T.shape)
    found = []
    for column, more in zip(columns.T, added, strict=True):
        # the pseudoinverse from its factor: inverse @ inverse.T @ matrix.T
        absorbed = inverse @ (inverse.T @ (matrix.T @ column))
        own = column - matrix @ absorbed
        size = float(own @ own)
        # outside the span of the others, or dependent on them
        if not size > MIN_NULL_COMPONENT**2 * float(column @ column):
            found.append(Alternative(0.0, np.inf, np.zeros(len(absorbed))))
            continue
        value = float(own @ residual - more + absorbed @ own_score) / size
        error = size**-0.5
        if rules.record is not None:
            # the weighing of a mass, the last row, is in no record
            count = len(rules.record)
            measured = len(residual) // count * count
            unit, right = (part[:measured].reshape(count, -1) for part in (own * error, residual))
            error *= float(np.sqrt(summed_products(unit[:, :, None], right, rules.record)[0, 0]))
        elif not len(readings):
            error = max(error, float(np.linalg.norm(own * residual)) / size)
        elif len(readings) > 1:
            moved = readings @ own / size
            error = max(error, float(np.sqrt(moved @ moved / (len(moved) * (len(moved) - 1)))))
        found.append(Alternative(value, error, -absorbed * value))
    return found


CHANCE_OF_ALTERNATIVE = 0.05
"""Noise that gives an alternative of several columns its gain more often than this does not count for it."""

_WIDENED = 2.0
"""An interval that an alternative widens more than so many times is mostly that of the choice of the law."""


Kinds = Mapping[str, Mapping[str, Alternative]]
"""Alternatives by kind and name."""


def spread_between(others: Iterable[Alternative], values: Array, error: Array) -> Array:
    """Return the factors (q,), at least 1, by which alternatives widen standard errors.

    The interval of one law with one background does not contain the uncertainty of that choice: the variance
    is that of noise plus the largest square of a shift times the weight of its alternative.

    Parameters
    ----------
    others
        Alternatives to the fit, each to first order.
    values, error
        (q,) parameters, and their standard errors by noise alone.
    """
    shifts = [np.sqrt(one.weight) * np.abs(one.shift[: len(values)]) for one in others]
    moved = np.max([np.zeros(len(values)), *shifts], axis=0)
    # the misfit of exact data, and the shift by terms, are due to truncated waveforms
    known = np.isfinite(error) & (error > 0) & (moved > MISFIT_OF_NOISE * np.abs(values))
    return np.where(known, np.hypot(1, moved / np.where(known, error, 1.0)), 1.0)


def largest_move(kept: Array, freed: Regression, names: Sequence[str]) -> dict[str, str]:
    """Return as "moves" what moves most where a fixed value is free; {} if by less than a twentieth."""
    value, error = kept[: len(names)], np.sqrt(np.diag(freed.covariance))[: len(names)]
    moved = freed.parameters[: len(names)] - value
    clear = (value != 0) & (np.abs(moved) > STANDARD_ERRORS_OF_DIFFERENCE * error)
    share = np.divide(moved, value, out=np.zeros(len(names)), where=clear)
    most = int(np.argmax(np.abs(share)))
    if abs(share[most]) < RELATIVE_ERROR_DOUBTFUL / 2:
        return {}
    return {"moves": f"{names[most]} by {number_text(100 * share[most], 2)} %"}


def stands_out(one: Alternative) -> bool:
    """Return True if noise gives an alternative its gain less often than four standard errors to a value."""
    return one.exceeds(2 * normal_share(-NOISE_LIMIT_SIGMAS))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Alternatives(Brief):
    """Shifts of the parameters by alternatives, to first order; ``rsgen.compare_fits(found)`` shows them.

    Parameters
    ----------
    names, error
        Parameters (q,), and their standard errors by noise alone.
    kinds
        Alternatives by kind and name: an additional "term", a larger "background", and, if they disagree,
        "halves" of the test, identified separately.
    """

    names: tuple[str, ...] = ()
    error: Array = field(default_factory=lambda: np.zeros(0))
    kinds: Kinds = field(default_factory=dict)

    def __iter__(self) -> Iterator[tuple[str, str, Alternative]]:
        """Iterate over kind, name and alternative, without terms of the law."""
        every = ((kind, name, one) for kind, of_kind in self.kinds.items() for name, one in of_kind.items())
        return (entry for entry in every if np.isfinite(entry[2].error))

    def largest(self, values: Array) -> dict[str, Alternative]:
        """Return, by name, the alternatives of each kind that widen an error of values (q,) most, by much."""
        found = {}
        for kind, of_kind in self.kinds.items():
            spreads = {name: spread_between([one], values, self.error) for name, one in of_kind.items()}
            wider = {name: float(np.max(spread)) for name, spread in spreads.items()}
            name = max(wider, key=wider.__getitem__, default="")
            if name and wider[name] > _WIDENED:
                found[f"{kind}: {name}"] = of_kind[name]
        return found

    @classmethod
    def widen(
        cls, found: Regression, names: tuple[str, ...], kinds: Kinds, misfit: float
    ) -> tuple[Regression, Alternatives, list[Finding]]:
        """Widen the errors of a fit by the shifts of its alternatives; return these, and findings."""
        others = cls(names, np.sqrt(np.diag(found.covariance)), kinds)
        ratio, findings = others.judge(found.parameters, misfit)
        return found.widened(found.covariance * np.outer(ratio, ratio)), others, findings

    def judge(self, values: Array, misfit: float) -> tuple[Array, list[Finding]]:
        """Return factors that widen the errors, and findings about a value that an alternative changes.

        Parameters
        ----------
        values
            (q,) values of the parameters.
        misfit
            Relative misfit of the law [1]; no value is doubted for that of corners and transients.

        Returns
        -------
        ratio, findings
            (q,) factors of the standard errors; findings about the interval that is widened most, and about
            the largest significant shift: a doubt if the interval is wider than a tenth of the value, of the
            first where halves of the test disagree.
        """
        fitted = list(self)
        widening = [spread_between([one], values, self.error) for _, _, one in fitted]
        ratio = np.max([np.ones(len(values)), *widening], axis=0)
        found, widest = list[Finding](), int(np.argmax(ratio))
        if ratio[widest] > _WIDENED:
            kind, name, _ = fitted[int(np.argmax([wider[widest] for wider in widening]))]
            half = interval_sigmas() * self.error[widest] * ratio[widest]
            wide = half > RELATIVE_ERROR_DOUBTFUL * abs(values[widest]) and misfit > MISFIT_NEGLIGIBLE
            halves = self.kinds.get("halves", {}).values()
            severity: Severity = "warning" if halves else "info"
            severity = "doubt" if wide and any(map(stands_out, halves)) else severity
            numbers = quantities(wider=ratio[widest])
            found = [Finding("intervals-widened", severity, self.names[widest], numbers, {kind: name})]
        share, said = np.zeros(len(values)), ("", "", 0.0)
        for kind, name, one in fitted:
            shift = one.shift[: len(values)]
            far = np.abs(shift) > STANDARD_ERRORS_OF_DIFFERENCE * self.error
            clear = (ratio > 1) & far & stands_out(one)
            moved = np.where(clear, shift / values, 0.0)
            if np.max(np.abs(moved)) > np.max(np.abs(share)):
                share, said = moved, (kind, name, float(np.sqrt(one.gain)))
        worst, (kind, name, errors) = int(np.argmax(np.abs(share))), said
        if not kind:
            return ratio, found
        half = interval_sigmas() * self.error[worst] * ratio[worst]
        wide = half > RELATIVE_ERROR_DOUBTFUL * abs(values[worst])
        severity = "doubt" if wide and misfit > MISFIT_NEGLIGIBLE else "warning"
        numbers = quantities(errors=errors, moved=share[worst])
        # one that stands out is named with its shift
        found = [f for f in found if (f.parameter, f.names) != (self.names[worst], {kind: name})]
        return ratio, [*found, Finding("law-ambiguous", severity, self.names[worst], numbers, {kind: name})]

    def within_noise(
        self,
        values: Array,
        covariance: Array,
        reasons: Mapping[str, Finding | None],
        units: Mapping[str, str],
    ) -> list[Finding]:
        """Find what a background that noise hides would move: the test does not tell whether the response has
        other modes. No interval contains such shifts: of a right law that would be far too wide.

        Parameters
        ----------
        values, covariance
            (q,) values of the parameters, and the covariance (q, q) that is stated.
        reasons, units
            By parameter: why it is not identifiable, and its unit.
        """
        other = self.kinds.get("background", {}).get(BACKGROUNDS[-2])
        if other is None or other.hidden is None:
            return []
        error = np.sqrt(np.diag(covariance))
        known = np.array([reasons.get(name) is None for name in self.names]) & (error > 0)
        # the best estimate of a background says little of the one that noise hides: its interval does
        shift = interval_sigmas() * other.hidden[: len(values)]
        # shifts of exact data are due to truncated waveforms
        moved = np.where(known & (shift > MISFIT_OF_NOISE * np.abs(values)), shift / error, 0.0)
        far = moved > NOISE_LIMIT_SIGMAS
        if not far.any():
            return []
        worst = int(np.argmax(moved))
        numbers = quantities(moved=shift[worst] / values[worst], times=moved[worst])
        numbers["shift"] = Quantity(float(shift[worst]), units[self.names[worst]])
        every = ", ".join(name for name, moves in zip(self.names, far, strict=True) if moves)
        names = {"background": BACKGROUNDS[-2], "parameters": every}
        return [Finding("law-ambiguous", "info", self.names[worst], numbers, names)]


# ----------------------------------------------------------------------------
# Agreement of halves of a test, and the errors that follow from it.

_FALSE_ALARM_RATE = 1e-5
"""Probability that halves of a test of one law disagree by chance."""

_MIN_INFORMATION_OF_HALF = 0.05
"""Share of the information on a direction that each half must have to be compared."""

_MIN_DIFFERENCE = 3e-4
"""Relative difference of the predictions of two halves that matters to an engineer."""


@dataclass(frozen=True, slots=True, eq=False)
class Difference:
    """Difference of the estimates of a part of the points and of the rest.

    Parameters
    ----------
    chance
        Probability of a larger difference if both obey one law and the misfit is noise.
    size
        Root mean square difference of their predictions, in the unit of the residuals.
    moved, error
        (q,) difference of each parameter and its standard error.
    spread
        Deviation of both from the estimate of all points, weighted by their information, along directions in
        which they differ by more than noise.
    """

    chance: float
    size: float
    moved: Array
    error: Array
    spread: Alternative

    @property
    def z(self) -> float:
        """Largest difference of a parameter in standard errors."""
        good = self.error > 0
        return float(np.max(np.abs(self.moved[good] / self.error[good]), initial=0.0))


def compare_parts(found: Regression, part: NDArray[np.bool_]) -> Difference | None:
    """Compare a part (n,) of the points with the rest; None if no direction is determined by both."""
    rows, residual = found.rows[part], found.residual[part]
    if not len(rows) or not np.isfinite(rows).all():
        return None
    share, axes = np.linalg.eigh(np.tensordot(rows, rows, ([0, 1], [0, 1])))
    score = np.einsum("nmr,nm->r", rows, residual)
    rest = np.einsum("nmr,nm->r", found.rows, found.residual) - score
    both = (share > _MIN_INFORMATION_OF_HALF) & (share < 1 - _MIN_INFORMATION_OF_HALF)
    if not both.any():
        return None
    share, axes = share[both], axes[:, both]
    difference = (axes.T @ score) / share - (axes.T @ rest) / (1 - share)
    variance = 1 / share + 1 / (1 - share)
    noise, directions = max(found.sigma, 1e-300), len(share)
    squares = difference**2 / variance / noise**2
    count = max(int(np.count_nonzero(found.used)), 1)
    step = found.basis @ axes
    clear = is_significant(difference, np.sqrt(variance) * noise)
    off = step @ np.where(clear, difference / np.sqrt(variance), 0.0)
    return Difference(
        f_tail(directions, found.freedom, float(np.sum(squares)) / directions),
        float(np.sqrt(np.sum(difference**2) / count)),
        step @ difference,
        noise * np.sqrt(step**2 @ variance),
        Alternative(float(np.sqrt(np.sum(squares[clear]))), 1.0, off),
    )


def halves_of(points: Points) -> dict[str, NDArray[np.bool_]]:
    """Return masks (n,) of halves of a test by name: by level, by time, by side of the resonance."""
    level = np.unique(points.level, return_inverse=True)[1]
    count, halves = int(level.max()) + 1, dict[str, NDArray[np.bool_]]()
    if count > 1:
        halves["alternate levels"] = level % 2 == 0
    if count > 2:
        halves["lower and upper levels"] = level < count // 2
    if count > 3:
        # of four levels, the third way in which gains of their own can differ
        halves["inner and outer levels"] = np.abs(2 * level - (count - 1)) < count / 2
    again, side, before = np.zeros(len(points), dtype=bool), np.zeros(len(points), dtype=bool), -1
    for number, rows in enumerate(points.runs):
        side[rows] = points.omega[rows] < points.omega[rows[points.amplitude[rows].argmax()]]
        again[rows] = number % 2 if level[rows[0]] == before else 0
        before = level[rows[0]]
    halves["first and later sweeps"] = again
    if not points.in_quadrature.all():
        # points at resonance, as of a decay, have no sides
        halves["sides of the resonance"] = side
    return halves


def _levels_of(points: Points, half: NDArray[np.bool_], unit: str) -> dict[str, str]:
    """Return the levels of a half and of the rest, as names of a finding; none if a level is in both."""
    sides = [np.unique(points.level[part]) for part in (half, ~half)]
    if np.isin(sides[0], sides[1]).any():
        return {}
    said = (listed([f"{level:.4g}" for level in levels]) for levels in sides)
    return dict(zip(("first", "second"), (f"{levels} {unit}".rstrip() for levels in said), strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """Agreement of halves of a test, and the errors that follow from it.

    Parameters
    ----------
    wider
        (q,) factor, at least 1, by which standard errors of all parameters of the fit grow.
    halves
        Spread of each pair of halves; none if the misfit is noise.
    findings
        Halves that disagree.
    """

    wider: Array
    halves: Mapping[str, Alternative]
    findings: tuple[Finding, ...] = ()

    @classmethod
    def of(
        cls, whole: Regression, points: Points, covariance: Array, *, misfits: bool, unit: str = ""
    ) -> Agreement:
        """Compare the halves of a test.

        Parameters
        ----------
        whole, points
            A fit, and its points.
        covariance
            (q, q) covariance of its parameters, as reported.
        misfits
            True if the misfit is systematic: then halves that differ widen the errors. Else they do where
            noise makes such a difference once in 400 tests, as levels with gains of their own make it.
        unit
            Of the levels, by which halves are named.
        """
        cuts = halves_of(points)
        found = {name: compare_parts(whole, half & whole.used) for name, half in cuts.items()}
        known = {name: one for name, one in found.items() if one is not None}
        matters = {name: one for name, one in known.items() if one.size > _MIN_DIFFERENCE}
        chance = {name: one.chance * len(known) for name, one in matters.items()}
        disagreeing = {name: known[name] for name, share in chance.items() if share < _FALSE_ALARM_RATE}
        by_noise = 2 * normal_share(-STANDARD_ERRORS_OF_DIFFERENCE)
        if not misfits and min(chance.values(), default=1.0) > by_noise:
            return cls(np.ones(len(covariance)), {})
        halves = {name: one.spread for name, one in known.items()}
        wider = spread_between(halves.values(), whole.parameters, np.sqrt(np.diag(covariance)))
        if not disagreeing:
            return cls(wider, halves)
        name, worst = max(disagreeing.items(), key=lambda item: item[1].z)
        size = max(one.size for one in disagreeing.values())
        finding = Finding(
            "parts-disagree",
            "doubt" if size > RELATIVE_CHANGE_NEGLIGIBLE else "warning",
            numbers=quantities(z=worst.z, size=size),
            names={"parts": name, **_levels_of(points, cuts[name], unit)},
        )
        return cls(wider, halves, (finding,))

    def widen(self, found: Regression) -> Regression:
        """Widen the errors of all parameters of a fit, or of the first ones."""
        wider = self.wider[: len(found.covariance)]
        return replace(found, covariance=found.covariance * np.outer(wider, wider))
