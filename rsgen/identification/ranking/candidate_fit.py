"""Fit of one candidate along a reference motion, and each level predicted from the others.

Minimised is the sum of squares of the whitened balance (``balance``), right - rows of the law - m rows of the
inertia - rows of the background, by Gauss-Newton: it is linear but for breakpoints, widths and exponents.
The levels of the test serve for cross-validation: a level is predicted by the parameters that the others
give.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.common.finding import Finding, Quantity
from rsgen.common.solvers import solve_scaled
from rsgen.common.tolerances import (
    MAX_SHARE_OF_OUTLIERS_BY_CHANCE,
    MISFIT_NEGLIGIBLE,
    NEAR_STEPS,
    NOISE_RATIO_BY_CHANCE,
    OUTLIER_SIGMAS,
    deviation_of_median,
)
from rsgen.formula.names import symbol
from rsgen.identification.fitting.across import law_of
from rsgen.identification.fitting.least_squares import Linearisation, Rules, descend
from rsgen.identification.fitting.observed import effective_power
from rsgen.identification.fitting.points import Points
from rsgen.identification.ranking.balance import WhitenedBalance
from rsgen.identification.ranking.library_sums import terms_of
from rsgen.identification.results.estimates import takes_energy
from rsgen.law.element import Element, forces_by_motion
from rsgen.law.numeric import ForceLaw, compile_law

_MIN_STATIC_STIFFNESS = 0.05
"""Mean stiffness of a law, relative to the inertia that it balances. Rubber isolators keep a tenth."""

STRONG_EVIDENCE = 6.0
"""Difference of BIC to the lowest, below which laws tie: at six and more the evidence against the higher one
is strong (Kass and Raftery, Bayes factors, JASA 90 (1995))."""

POINT_STRIDE = 7
"""Every so-many-th point suffices for means and largest values of a force."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidateLaw:
    """A candidate with initial values.

    Parameters
    ----------
    name
        Name in words.
    elements
        Springs and dampers.
    values
        Value of every parameter; the mass is "m".
    limits
        Lower and upper limit of some parameters.
    dissipates
        Groups of parameters whose sum must not be negative.
    background
        (b,) values of the background.
    """

    name: str
    elements: tuple[Element, ...]
    values: Mapping[str, float]
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    dissipates: tuple[tuple[str, ...], ...] = ()
    background: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def forces(self) -> dict[str, sympy.Expr]:
        """n(x, v) [N] by the sensors between which it acts."""
        return forces_by_motion(self.elements)

    @property
    def law(self) -> ForceLaw:
        """The compiled force; its parameters are sorted by name."""
        return law_of(self.elements)

    @property
    def linear(self) -> bool:
        """True if the force is linear in displacement and velocity."""
        states = symbol("x"), symbol("v")
        return all(
            force.is_polynomial(*states) and sympy.Poly(force, *states).total_degree() <= 1
            for force in self.forces.values()
        )


@dataclass(frozen=True, slots=True, eq=False)
class CandidateFit:
    """A candidate fitted along a reference motion.

    Parameters
    ----------
    candidate
        The candidate with the fitted values.
    residual
        (n, r) residual of the balance, in units of the noise.
    predict_levels
        Return the (n, r) residual of each level at the parameters that the other levels give.
    compared
        (r,) mask of the rows that count.
    background_cost
        Sum of squares of the change of the background, and of that of a mass which was weighed.
    fault
        Why it is no candidate; "" where it is one.
    converged
        False if the steps of its parameters ended before its least misfit, or at a limit.
    unit
        Sum of squares, in units of the noise, of one independent point of the test (``effective_power``).
    """

    candidate: CandidateLaw
    residual: Array
    predict_levels: Callable[[], Array]
    compared: NDArray[np.bool_]
    background_cost: float
    fault: str = ""
    converged: bool = True
    unit: float = 1.0

    @property
    def chi_squared(self) -> float:
        """Sum of squares in units of the noise, of independent points."""
        return (float(np.sum(self.residual[:, self.compared] ** 2)) + self.background_cost) / self.unit

    def feeds(self, rows: WhitenedBalance) -> bool:
        """Return True if a damper of a sum has a negative factor, so that it feeds energy."""
        for element in self.candidate.elements:
            law, motion = compile_law(element.force), rows.motion_of(element.across)
            values = law.ordered(self.candidate.values)
            slopes = law.sample(*motion, values).by_parameter
            if any(takes_energy(slopes[i] * motion[1]) for i in law.linear if values[i] < 0):
                return True
        return False

    @property
    def cost_of_parameter(self) -> float:
        """Share of a parameter in the criterion: the logarithm of the number of compared rows."""
        return float(np.log(self.residual[:, self.compared].size))

    def bic(self, noise: float = 1.0) -> float:
        """Return the Bayesian information criterion (Schwarz 1978) for a known mean square of the noise."""
        return self.chi_squared / noise + len(self.candidate.values) * self.cost_of_parameter


def lacks(
    smaller: CandidateFit,
    larger: CandidateFit,
    names: Collection[str],
    powers: Collection[tuple[str, int]] = (),
) -> bool:
    """Return True if a law is another one without the term of one of some parameters, or of all of them.

    Or with the whole number of one of some ``powers``.
    """
    if len(smaller.candidate.values) >= len(larger.candidate.values):
        return False
    law = larger.candidate.law
    linear = [name for i, name in enumerate(law.parameters) if i not in law.nonlinear and name in names]
    own = {sensors: terms_of(force) for sensors, force in smaller.candidate.forces.items() if force}
    less = [dict.fromkeys(map(symbol, gone), sympy.S.Zero) for gone in {*zip(linear), tuple(linear)}]
    less += [{symbol(name): sympy.Integer(number)} for name, number in powers]
    for known in less:
        rest = {sensors: force.xreplace(known) for sensors, force in larger.candidate.forces.items()}
        if own == {sensors: terms_of(force) for sensors, force in rest.items() if force}:
            return True
    return False


def whole_powers(fit: CandidateFit) -> list[tuple[str, int]]:
    """Return the parameters of a law that are powers, with the whole numbers next to their values."""
    found = [atom.exp for force in fit.candidate.forces.values() for atom in force.atoms(sympy.Pow)]
    powers = sorted({str(exponent) for exponent in found} & set(fit.candidate.values))
    return [(name, round(fit.candidate.values[name])) for name in powers]


class _Balance:
    """The balance of a candidate, element by element: linear elements are shared by all candidates.

    Values (q,) are those of ``names``, then the changes of the background.
    """

    def __init__(self, candidate: CandidateLaw, rows: WhitenedBalance, fixed: Mapping[str, float]) -> None:
        self.rows = rows
        self.laws = [compile_law(element.force) for element in candidate.elements]
        self.sensors = [element.across for element in candidate.elements]
        names = sorted({name for law in self.laws for name in law.parameters})
        self.names = (*names, "m")
        self.free = np.array([name not in fixed for name in self.names] + [True] * len(rows.background_at))
        self.places = [[self.names.index(name) for name in law.parameters] for law in self.laws]
        self.nonlinear = sorted(
            {place[i] for law, place in zip(self.laws, self.places, strict=True) for i in law.nonlinear}
        )

    def evaluate(self, values: Array) -> tuple[Array, Array]:
        """Return the residual (n, r) and its negative slopes (n, r, q)."""
        rows = self.rows
        count = len(self.names)
        residual = rows.right - values[count - 1] * rows.inertia - rows.background @ values[count:]
        matrix = np.zeros((*residual.shape, len(values)))
        matrix[:, :, count - 1] = rows.inertia
        matrix[:, :, count:] = rows.background
        for law, place, sensors in zip(self.laws, self.places, self.sensors, strict=True):
            force, slopes = rows.of_law(law, values[place], sensors)
            residual = residual - force
            # an element may share a parameter with another
            for i, j in enumerate(place):
                matrix[:, :, j] += slopes[:, :, i]
        return residual, matrix

    def linearise(self, values: Array, nuisance: Array) -> Linearisation:
        """Return the compared rows; the points have no nuisances (n, 0)."""
        residual, matrix = (part[:, self.rows.compared] for part in self.evaluate(values))
        return Linearisation(residual, np.zeros((*residual.shape, 0)), matrix)

    @property
    def rules(self) -> Rules:
        """Rules of a descent: changes of the background are known to be zero, a mass may be weighed."""
        prior = np.append(np.zeros(len(self.names)), self.rows.background_weight)
        return Rules(free=self.free, prior=prior).knowing(len(self.names) - 1, self.rows.weighed)

    def lacks_static_stiffness(self, values: Array) -> bool:
        """Return True if almost all static stiffness comes from a hysteretic element.

        A loop has no position of equilibrium, so that such a law would explain any mean displacement. Across
        two sensors no balance of means is asked.
        """
        if self.rows.sensors or not any(law.remembers for law in self.laws):
            return False
        x, v, a, step = (part[::POINT_STRIDE] for part in self.rows.motion_of(""))
        laws = zip(self.laws, self.places, strict=True)
        samples = [law.sample(x, v, a, step, values[place]) for law, place in laws]
        inertia = values[len(self.names) - 1] * np.sqrt(np.mean(a**2) / np.mean(x**2))
        return bool(sum(float(np.mean(sample.by_x)) for sample in samples) < _MIN_STATIC_STIFFNESS * inertia)


def fit_candidate(candidate: CandidateLaw, rows: WhitenedBalance, fixed: Mapping[str, float]) -> CandidateFit:
    """Fit a candidate along the motion.

    Parameters
    ----------
    candidate
        The candidate with initial values.
    rows
        The balance.
    fixed
        Names of parameters that keep their values.

    Returns
    -------
    CandidateFit
        With a ``fault`` if friction would feed energy, the static stiffness is missing, or the sum of squares
        is not finite.
    """
    balance = _Balance(candidate, rows, fixed)
    names = balance.names
    unchanged = np.zeros(len(rows.background_at))
    place = np.array([*(candidate.values[name] for name in names), *unchanged])
    free = (-np.inf, np.inf)
    limits = np.array([candidate.limits.get(name, free) for name in names] + [free] * len(unchanged))
    rules = replace(
        balance.rules,
        steps=NEAR_STEPS if balance.nonlinear else 0,
        linear=[i for i in np.flatnonzero(balance.free).tolist() if i not in balance.nonlinear],
        bounded_step=partial(_limited_step, limits=limits, nonlinear=balance.nonlinear),
    )
    place = np.clip(place, limits[:, 0], limits[:, 1])
    place, _, _, converged = descend(balance.linearise, place, np.zeros((len(rows), 0)), rules)
    residual, matrix = balance.evaluate(place)
    values = dict(zip(names, place[: len(names)].tolist(), strict=True))
    background = rows.background_at + place[len(names) :]
    fitted = replace(candidate, values=values, background=background)
    background_cost = float(np.sum(rules.prior_rows(place)[1] ** 2))
    fault = ""
    if not np.isfinite(np.sum(residual[:, rows.compared] ** 2)):
        fault = "its force is not finite along the motion"
    elif any(sum(values[name] for name in names) < 0 for names in candidate.dissipates):
        fault = "its friction would feed energy"
    elif balance.lacks_static_stiffness(place):
        fault = "it has almost no static stiffness"
    if fault:
        return CandidateFit(fitted, residual, lambda: residual, rows.compared, background_cost, fault)
    predict = partial(_predict_levels, balance, place, residual, matrix, rules)
    # what is linear in all parameters is solved for; at a limit the best value may lie beyond
    converged = (converged or not balance.nonlinear) and not (place[:, None] == limits).any()
    return CandidateFit(fitted, residual, predict, rows.compared, background_cost, converged=converged)


def _limited_step(place: Array, change: Array, limits: Array, nonlinear: list[int]) -> Array:
    """Return the next values: nonlinear ones at most doubled or halved, all within their limits."""
    moved = place + change
    for i in nonlinear:
        if place[i]:
            moved[i] = place[i] + np.clip(change[i], -0.5 * abs(place[i]), abs(place[i]))
    return np.clip(moved, limits[:, 0], limits[:, 1])


def _predict_levels(balance: _Balance, place: Array, residual: Array, matrix: Array, rules: Rules) -> Array:
    """Return the residual of each level at the parameters of the other levels.

    That is one Gauss-Newton step, and a fit where it leads far: few points near a breakpoint give its slope,
    along which the others would not stay.
    """
    predicted = np.full_like(residual, np.nan)
    level, compared = balance.rows.level, balance.rows.compared
    parts = [level == amount for amount in np.unique(level)]
    if len(parts) < 2:
        return predicted
    fixed = np.where(balance.free, np.nan, 0.0)
    prior = np.column_stack(rules.prior_rows(place))
    rows = np.concatenate([matrix, residual[:, :, None]], axis=2)[:, compared]
    triangles = [np.linalg.qr(rows[part].reshape(-1, rows.shape[2]), mode="r") for part in parts]
    for i, part in enumerate(parts):
        others = np.concatenate([prior, *triangles[:i], *triangles[i + 1 :]])
        change = solve_scaled(others[:, :-1], others[:, -1], known=fixed)[0]
        predicted[part] = residual[part] - matrix[part] @ change
        left, before = (np.linalg.norm(rest[part][:, compared]) for rest in (predicted, residual))
        if balance.nonlinear and not left <= NOISE_RATIO_BY_CHANCE * before:
            none = np.zeros((len(level), 0))
            refitted = descend(balance.linearise, place, none, rules, used=~part)[0]
            predicted[part] = balance.evaluate(refitted)[0][part]
    return predicted


# ----------------------------------------------------------------------------
# What a ranking asks of a test: points of sines and records of multisines answer.


@dataclass(frozen=True, slots=True)
class Misfit:
    """Misfit of a law along a reference motion, beyond noise.

    Parameters
    ----------
    systematic
        Relative to force and response [1].
    unexplained
        The same, of parts where it is beyond chance and more than sensors resolve; 0: the law fits.
    where
        Numbers of a finding that say in which harmonics it lies.
    known
        False if the test does not tell misfit from noise.
    """

    systematic: float
    unexplained: float
    where: Mapping[str, Quantity]
    known: bool


@dataclass(frozen=True, slots=True, eq=False)
class Round(ABC):
    """One reference motion: the balance along it, and the ``leader``, the law of the motion, fitted to it."""

    rows: WhitenedBalance
    leader: CandidateFit

    counted: ClassVar[str]
    """Unit of the counts: points or lines."""

    @property
    def mean_unbalanced(self) -> bool:
        """True if the leader has a mean force that was not recorded."""
        return False

    @property
    @abstractmethod
    def noise(self) -> float:
        """Noise relative to force and response [1]; NaN if it is not known."""

    def exclusions(self, best: CandidateFit) -> list[Finding]:
        """Find the points that the best law is not compared with."""
        return []

    def without_outliers(self, best: CandidateFit) -> Round | None:
        """Exclude a few points that a law misses by far; None where there are none."""
        return None

    def pairs(self, best: CandidateFit) -> NDArray[np.intp]:
        """Return the (k, 2) neighbours in frequency that are no outliers of a law; none of lines."""
        return np.zeros((0, 2), dtype=np.intp)

    def in_independent_points(self, found: Sequence[CandidateFit]) -> list[CandidateFit]:
        """Return fits, best first, in units of points whose errors are independent.

        What neighbours share of the least sum of squares no law explains: it is no evidence for one.
        """
        least = min(found, key=lambda fit: fit.chi_squared)
        unit = effective_power(least.residual[:, least.compared], self.pairs(least))
        return sorted((replace(fit, unit=unit) for fit in found), key=CandidateFit.bic)

    def leader_of(self, other: Round) -> tuple[CandidateFit, bool]:
        """Return the leader of another round in units of the noise of this one; large at lost points.

        With whether its motion is that of its values; those of an even force are else of the motion.
        """
        return other.leader, True

    def larger_background(self, best: CandidateFit) -> Finding | None:
        """Find a larger background with which a law leaves much less; None if there is none."""
        return None

    def even_force(self, best: CandidateFit) -> Finding | None:
        """Find an even force that a law lacks; None if there is none."""
        return None

    def left_at_common(self, rounds: Sequence[Round]) -> float:
        """Return the relative misfit of the leader, of points at those that all the rounds have."""
        return self.relative(self.leader.residual)

    @abstractmethod
    def relative(self, residual: Array) -> float:
        """Return the root mean square of a residual (n, r) relative to force and response [1]."""

    @abstractmethod
    def misfit(self, fitted: CandidateFit) -> Misfit:
        """Return what a law leaves along the motion."""


class RankedTest(ABC):
    """A test as a ranking sees it.

    Parameters
    ----------
    fixed
        The mass "m" [kg], if it is known.
    first
        The balance along the measured motion.
    means
        Whether the mean was recorded, of each motion that elements follow.
    left_out
        States the points that friction holds, and with which no law is compared.
    """

    fixed: Mapping[str, float]
    first: WhitenedBalance
    means: tuple[bool, ...]
    left_out: Finding | None = None

    @abstractmethod
    def start(self, name: str, elements: tuple[Element, ...]) -> CandidateLaw:
        """Return a law with initial values."""

    @abstractmethod
    def along(self, candidate: CandidateLaw, before: Round | None) -> Round | None:
        """Fit a law by itself, and make its motion the reference; None if it does not follow the test."""

    def without_mean(self) -> RankedTest | None:
        """Return the test without a mean that may be the sensor's; None if it has none."""
        return None


MAX_UNEXPLAINED = 5e-3
"""Misfit of force and response, relative, that calibration errors of sensors reach."""

_MAX_UNEXPLAINED_OF_HARMONIC = 0.1
"""Misfit of a higher harmonic, relative to that harmonic."""


def max_misfits(points: Points, count: int) -> Array:
    """Return the largest relative misfit (count,) of a law that fits, of mean, fundamental and harmonics."""
    known = min(count, points.harmonics.shape[1])
    size = np.zeros(count)
    relative = np.abs(points.harmonics[:, :known]) ** 2 / points.amplitude[:, None] ** 2
    size[:known] = np.sqrt(np.mean(relative, axis=0))
    limits = np.maximum(MISFIT_NEGLIGIBLE, _MAX_UNEXPLAINED_OF_HARMONIC * size)
    limits[:2] = MAX_UNEXPLAINED
    return np.asarray(limits)


def outliers_of(fitted: CandidateFit, noise: Array) -> NDArray[np.bool_]:
    """Return the mask (n,) of a few points with far larger residuals than the others; False if they are many.

    A few outliers are spikes, or motions that the simulation misses, and no fault of the law.
    """
    size = np.abs(fitted.residual[:, fitted.compared])
    least = (MISFIT_NEGLIGIBLE / np.repeat(noise, 2)[1:])[fitted.compared]
    deviation = np.array([deviation_of_median(median) for median in np.median(size, axis=0).tolist()])
    out = np.asarray((size > OUTLIER_SIGMAS * np.maximum(deviation, least)).any(axis=1))
    return out if np.mean(out) <= MAX_SHARE_OF_OUTLIERS_BY_CHANCE else np.zeros_like(out)
