"""Result of an identification: estimates with intervals, resonances, the equivalent curve, findings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from math import isfinite, nan
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray, freeze, frozen_array
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, Verdict, printed_findings, reach_verdict
from rsgen.common.text_table import Brief, Printed, TextTable, interval_text, lookup, short, with_error
from rsgen.common.tolerances import (
    CONFIDENCE_TEXT,
    MAX_ERROR_TO_MISFIT,
    MISFIT_NEGLIGIBLE,
    RELATIVE_CHANGE_NEGLIGIBLE,
    STANDARD_ERRORS_OF_DIFFERENCE,
    interval_sigmas,
)
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import Model, Oscillator, units_of
from rsgen.dynamics.linear_part import BackgroundTerms, background_terms
from rsgen.formula.units import WHOLE, ForceUnits, off_by_scale
from rsgen.identification.fitting.fit import Fit
from rsgen.identification.results.alternatives import Alternatives
from rsgen.law.memory import with_equations

if TYPE_CHECKING:
    from rsgen.data.multisine.linear import BestLinear


@dataclass(frozen=True, slots=True)
class Estimate:
    """One identified parameter.

    Parameters
    ----------
    name
        The parameter of the law, or "m" for the mass.
    value
        In SI units; NaN where the parameter is not identifiable.
    standard_error
        One standard deviation, same unit; infinite where the parameter is not identifiable.
    interval
        The 95 % interval (lower, upper), Student t; an end that the test does not tell is infinite.
    unit
        SI unit, "" where it is dimensionless or unknown.
    finding
        Why the test does not determine the parameter; None where it does.
    by_profile
        True where the interval is that of the profile likelihood, which need not be symmetric; else it is
        Wald's, of the standard error.
    """

    name: str
    value: float
    standard_error: float
    interval: tuple[float, float]
    unit: str = ""
    finding: Finding | None = None
    by_profile: bool = False

    @property
    def identifiable(self) -> bool:
        """True where the test determines the parameter."""
        return isfinite(self.value) and self.finding is None

    @property
    def cells(self) -> tuple[str, str, str, str, str]:
        """Name, value, 95 % interval or "fixed", unit and finding, as a table prints them."""
        if self.standard_error == 0:
            return (self.name, short(self.value), "fixed", self.unit, "")
        reason = self.finding.code if self.finding else ""
        if not isfinite(self.value) or (reason and not isfinite(self.standard_error)):
            return (self.name, "", "", self.unit, reason or "not-identifiable")
        digits = with_error(self.value, self.standard_error)
        ends = interval_text(self.interval, partial(short, digits=digits))
        kind = ", by profile" if self.by_profile and any(map(isfinite, self.interval)) else ""
        return (self.name, short(self.value, digits), ends + kind, self.unit, reason)


def table_of(estimates: Iterable[Estimate]) -> TextTable:
    """Return estimates as a table, as terminals and notebooks show it."""
    heads = ("parameter", "value", f"{CONFIDENCE_TEXT} interval", "unit", "finding")
    return TextTable(heads, tuple(estimate.cells for estimate in estimates))


def mass_lines(found: Identification, *, rms: bool = False) -> list[str]:
    """Return what values owe to a mass in kg, given or free; ``rms`` where amplitudes are said to be."""
    mass, weighed = found._estimates.get("m"), found.model_given.weighed
    known = weighed or "mass" in found.outcome.names
    if mass is None or mass.unit != "kg" or (mass.standard_error and not (known and mass.identifiable)):
        return []
    moves = f"; to first order {found.outcome.names['moves']}" if "moves" in found.outcome.names else ""
    said = f"m is taken as exact: its error and those of the sensors come on top{moves}"
    if weighed:
        now = f"is with the test {short(mass.value, 5)} ± {short(mass.standard_error, 2)} kg"
        away = abs(mass.value - weighed[0]) / weighed[1]
        if away > interval_sigmas():
            now += f", {away:.2g} times that error off"
        if not isfinite(mass.standard_error):
            now = "is not determined with the test"
        elif away > STANDARD_ERRORS_OF_DIFFERENCE:
            now += ": check law, mass and units of the channels"
        elif mass.standard_error >= (1 - RELATIVE_CHANGE_NEGLIGIBLE) * weighed[1]:
            now = "is not checked by the test"
        given = f"{short(weighed[0], 5)} ± {short(weighed[1], 2)} kg (standard error)"
        said = f"m, given as {given}, {now}; its error is in all intervals, that of a sensor in none{moves}"
    elif mass.standard_error:
        said = (
            "all values scale with the units of force, response and frequency (Hz or rad/s): weigh what "
            "moves, and give it under [system] (in Python mass=); a mass other than m = "
            f"{short(mass.value, 4)} kg shows a wrong ratio of force to response, as of one of them rms read "
            "as peak, or of a missing 2 pi (in frequencies of accelerations it shows none)"
        )
    held = found.curve.level_unit == "m" and not found.curve.base
    off = off_by_scale({one.name: one.unit for one in found if one.identifiable}, held=held)
    return [said, *[f"m does not show a factor that force and response share: {off}"] * bool(off and not rms)]


def held_out_lines(held_out: Iterable[Any], usable: bool = False) -> list[str]:
    """Return a line on the error of each held-out level or record; good ones are called so if ``usable``."""
    lines = list[str]()
    for one in held_out:
        line = f"held out {one.name}" + (f", {one.sweep}" if getattr(one, "sweep", "rest") != "rest" else "")
        line += f": predicted with an error of {100 * one.error:.2g} %"
        if getattr(one, "missing", 0):
            line += f", {one.missing} of {len(one.frequency)} points not nearly"
        if size := size_of_error(one, usable):
            line += f", at most {100 * one.largest_error:.2g} % of the root mean square"
            line += f" at {one.largest_at:.5g} Hz; {size}"
        lines.append(line)
    return lines


def size_of_error(one: Any, usable: bool) -> str:
    """Compare the error of a held-out level with the misfit; "" where there is none to speak of."""
    if not (one.error > MISFIT_NEGLIGIBLE and getattr(one, "misfit", nan) > 0):
        return ""
    ratio, said = one.error / one.misfit, ""
    if ratio <= MAX_ERROR_TO_MISFIT:
        said = ": as good as the fit"
    elif isfinite(one.explained):
        part = "up to" if one.error <= one.explained else "no more than"
        said = f"; noise and the errors of the values explain {part} {100 * one.explained:.2g} %"
    return f"{ratio:.2g} times the misfit of the fitted levels" + said * usable


@dataclass(frozen=True, slots=True)
class Resonance:
    """The resonance of one level and sweep, the paper's point on k(X) and c(X) (Liu et al., Sec. 1.2).

    Parameters
    ----------
    level
        Nominal force amplitude [N].
    sweep
        "rest", "up" or "down".
    frequency
        Where the displacement lags the force by a quarter period [Hz].
    damping_ratio
        zeta = c/(2 m omega_n) [1].
    amplitude
        X of the fundamental there [m].
    stiffness
        k(X) = m omega_n^2 [N/m].
    damping
        c(X) = 2 zeta m omega_n [N s/m].
    jump
        True where the response jumps across the resonance, so that the point is extrapolated from one side.
    reached
        False where the largest point of the run is at an end of its band, or is the first after a jump: k(X)
        and c(X) hold there, and the run has no resonance.
    """

    level: float
    sweep: str
    frequency: float
    damping_ratio: float
    amplitude: float
    stiffness: float
    damping: float
    jump: bool = False
    reached: bool = True


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class EquivalentCurve(Brief):
    """k and c of every settled point: F/X = k - m omega^2 + i omega c; they collapse if the law holds.

    Parameters
    ----------
    amplitude
        (n,) X [m].
    frequency
        (n,) [Hz].
    level
        (n,) nominal force amplitude [N].
    stiffness
        (n,) equivalent stiffness [N/m], with the refined mass.
    damping
        (n,) equivalent damping [N s/m].
    used
        (n,) True where the point took part in the fits (not held out, not an outlier).
    level_unit
        "N", or "m" where the test held the amplitude, or of the motion of a base.
    units
        Of stiffness and damping, per unit mass or not.
    base
        Motion of a base that drove the test, such as "acceleration"; "" of a force on the mass.
    reason
        (n,) why a point was not used: "held out", "outside the band", or "excluded", as the findings
        "points-excluded" say; "" of the others.
    """

    amplitude: NDArray[np.float64]
    frequency: NDArray[np.float64]
    level: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]
    used: NDArray[np.bool_]
    level_unit: str = "N"
    units: ForceUnits = WHOLE
    base: str = ""
    reason: NDArray[np.str_] = field(default_factory=lambda: np.zeros(0, np.str_))

    def __post_init__(self) -> None:
        freeze(self, ("amplitude", "frequency", "level", "stiffness", "damping"))
        freeze(self, ("used",), np.bool_)
        reason = self.reason if len(self.reason) else np.where(self.used, "", "excluded")
        object.__setattr__(self, "reason", frozen_array(reason, np.str_))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RestoringForce(Brief):
    """Stiffness and damping force drawn without any law, by inversion of k(X) and c(X) (docs/method.md, 4).

    Parameters
    ----------
    displacement
        (a,) x [m], ascending from 0.
    stiffness_force
        (a,) odd part of the stiffness force at x [N].
    stiffness_band
        (a,) half width of its 95 % band [N].
    velocity
        (b,) v [m/s], ascending from 0.
    damping_force
        (b,) odd part of the damping force at v [N].
    damping_band
        (b,) half width of its 95 % band [N].
    """

    displacement: NDArray[np.float64]
    stiffness_force: NDArray[np.float64]
    stiffness_band: NDArray[np.float64]
    velocity: NDArray[np.float64]
    damping_force: NDArray[np.float64]
    damping_band: NDArray[np.float64]

    def __post_init__(self) -> None:
        freeze(self, ("displacement", "stiffness_force", "stiffness_band"))
        freeze(self, ("velocity", "damping_force", "damping_band"))


@dataclass(frozen=True, slots=True)
class Background:
    """The background: the sensor sees x = q + b(omega) F + o with F = F_measured exp(i psi).

    b(omega) = b0 + b1 (omega^-2 - middle)/(width), complex: residual terms of modes above and below the band,
    or what the sensor picks up of the drive. o is a displacement of constant size, with a phase to F.

    Parameters
    ----------
    kind
        "phase": psi alone; "constant": and b0; "residuals": and b1; "...+offset": and o.
    band
        Lowest and highest frequency [Hz] fitted; b1 is the change of b from the one to the other.
    estimates
        psi [rad], real and imaginary part of b0 and b1 [m/N] and of o [m], as many as the kind has.
    share
        Root mean square of the subtracted part over that of the measured response [1].
    """

    kind: str
    band: tuple[float, float]
    estimates: tuple[Estimate, ...]
    share: float

    @property
    def values(self) -> NDArray[np.float64]:
        """The numbers of the estimates, as the shape takes them."""
        return np.array([estimate.value for estimate in self.estimates])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Why the test does not determine some of the estimates; none or one."""
        return tuple({e.finding.code: e.finding for e in self.estimates if e.finding is not None}.values())

    def shape(self, omega: NDArray[np.float64], force: NDArray[Any]) -> BackgroundTerms:
        """Return the background at (n,) frequencies [rad/s] and forces [N] as a function of its values."""
        return background_terms(self.kind, omega, force, self.band)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Identification(Printed):
    """The parameters of a model identified from a response surface.

    ``found["k3"]`` is the refined estimate of a parameter, "m" that of the mass; ``print(found)`` gives a
    table.

    Parameters
    ----------
    model
        The laws that were fitted, without values.
    paper
        Resonance per level, then fit of k(X) and c(X) (Liu et al., Sec. 1.2), one Estimate a parameter.
    first_order
        First-order harmonic balance over all points at once. Its intervals are those of noise; the error by
        neglected harmonics is ``first_order_bias``.
    refined
        All harmonics: the maximum-likelihood estimate.
    first_order_bias
        Error of each first-order estimate by the one-harmonic approximation, predicted with the refined
        parameters; same order and units as ``first_order``. NaN if unknown.
    covariance
        (p, p) of the refined estimates, in the order of ``refined``; rows of parameters that are not
        identifiable are NaN, as are all of a fit that did not converge; those of fixed ones are absent.
    resonances
        One for each level and sweep, ascending in level.
    curve
        Equivalent stiffness and damping of every settled point.
    residual
        The refined misfit, real and imaginary part together, relative to force and response [1]; by its
        degrees of freedom, as in ``outcome``.
    noise
        Relative noise of force and response [1]: that of repeats or periods, else the misfit, which is a
        bound of it where it has a pattern, as that of a wrong law or mass has.
    levels
        The fitted nominal levels [N], ascending; with response control the forces at the resonances.
    amplitude_range, frequency_range
        Range of X [m] and of the frequency [Hz] over the fitted points; of the records of a multisine X is
        sqrt(2) times the rms displacement.
    outcome
        The finding "identified": numbers of identified and all parameters, of points used and tested, of
        levels, and the relative misfit; none of values that were given.
    findings
        Findings about test and fit, those about single parameters first.
    restoring
        Forces without a law; None if the points do not suffice.
    ranking
        The ``rsgen.identification.ranking.Ranking`` that chose the law; None for a given law.
    solution
        (p,) parameters of the laws, sorted by name, with which the fit reproduces the test; finite also for
        parameters that are not identifiable. Predictions use it.
    background
        The fitted background; None without one.
    held_out
        Scores of held-out levels: a ``HeldOutLevel`` for each level and sweep, or a ``PredictedRecord`` for
        each record of a multisine; ``error`` is the relative error of the predicted response.
    small_motion
        Natural frequency [Hz] and damping ratio of the law for X -> 0, as far as it has them there: none with
        dry friction, none where it does not determine them.
    alternatives
        Shifts by additional terms, other backgrounds and halves of the test; the intervals include them.
    """

    model: Model
    paper: tuple[Estimate, ...] = field(default=(), kw_only=True)
    first_order: tuple[Estimate, ...] = field(default=(), kw_only=True)
    refined: tuple[Estimate, ...]
    first_order_bias: tuple[float, ...] = field(default=(), kw_only=True)
    covariance: NDArray[np.float64]
    resonances: tuple[Resonance, ...] = field(default=(), kw_only=True)
    curve: EquivalentCurve
    residual: float
    noise: float
    levels: NDArray[np.float64]
    amplitude_range: tuple[float, float]
    frequency_range: tuple[float, float]
    outcome: Finding = field(default_factory=partial(Finding, "identified", "info"))
    findings: tuple[Finding, ...] = ()
    restoring: RestoringForce | None = None
    ranking: Any = None
    solution: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    background: Background | None = None
    held_out: tuple[Any, ...] = ()
    small_motion: tuple[Estimate, ...] = ()
    alternatives: Alternatives = field(default_factory=Alternatives)
    fit: Fit | None = None
    _left: ComplexArray | None = None

    def __post_init__(self) -> None:
        if len(self.solution) == 0:
            values = self.values
            object.__setattr__(self, "solution", [values[name] for name in self.model.parameters])
        for name in ("covariance", "levels", "solution"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))

    if not TYPE_CHECKING:

        def __getattribute__(self, name: str) -> Any:
            """Return a field; one that waits (``later``) is computed where it is first read."""
            value = object.__getattribute__(self, name)
            if isinstance(value, _Later):
                # what a trial makes infinite or undefined has no prediction there
                with np.errstate(all="ignore"):
                    value = value.compute()
                object.__setattr__(self, name, value)
            return value

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle all fields, and the residuals in place of the fit, whose compiled law cannot leave."""
        of_fit = {"fit": None} if self.fit is None else {"fit": None, "_left": self.residuals}
        state = [of_fit.get(entry.name, getattr(self, entry.name)) for entry in fields(self)]
        return object.__new__, (type(self),), state

    @property
    def mass(self) -> float:
        """The given mass, or the refined one [kg]."""
        return self._known["m"]

    @property
    def residuals(self) -> ComplexArray:
        """Residual force (n,) of the fit at each point of ``curve``, relative to the force of the point [1].

        It is 1 - D X/F, with D the dynamic stiffness of the fit with all its harmonics, and F, X as measured,
        without the background. Without phases sizes are compared. NaN at points that the fit did not use.
        What the fit leaves of the mean and of harmonics is not in it.

        Raises
        ------
        RsgenError
            The fit is of a multisine, which has ``misfit``.
        """
        if self._left is not None:
            return self._left
        if self.fit is None:
            raise RsgenError("residuals: only of a fit of sines")
        fit, points = self.fit, self.fit.problem.observed.mode(self.fit.background)
        # a point that the law does not reach has none
        with np.errstate(all="ignore"):
            ratio = fit.force / fit.harmonics[:, 1] * points.harmonics[:, 1] / points.force
        found = np.full(len(self.curve.frequency), np.nan, dtype=complex)
        left = 1 - (ratio if points.phase_known else np.abs(ratio))
        found[self.curve.used] = left[fit.regression.used]
        return found

    @property
    def oscillator(self) -> Oscillator:
        """The identified structure, with the values of ``solution``, for ``rsgen.simulate``."""
        values = dict(zip(self.model.parameters, self.solution.tolist(), strict=True))
        return Oscillator(self.mass, self.model.elements, values)

    @property
    def model_given(self) -> Model:
        """The model as it was given: without the mass of one kilogram that stands for a unit of mass."""
        if isfinite(self.curve.units.kilogram):
            return self.model
        fixed = {name: value for name, value in self.model.fixed.items() if name != "m"}
        return Model(self.model.elements, None, self.model.observation, fixed)

    @property
    def verdict(self) -> Verdict:
        """Verdict by the findings, with those of held-out levels; ``rsgen.verdict_of`` adds a truth."""
        return reach_verdict(self.findings, summary=self.outcome)

    @property
    def values(self) -> Mapping[str, float]:
        """Refined or fixed value of every parameter of the laws (not of the mass)."""
        names = set(self.model.parameters)
        return {name: value for name, value in self._known.items() if name in names}

    @property
    def fixed(self) -> tuple[Estimate, ...]:
        """Values that were given and not identified, a given mass among them, each without error."""
        units = units_of(self.model, self.curve.units)
        return tuple(
            Estimate(name, value, 0.0, (value, value), units[name])
            for name, value in self.model_given.exact.items()
        )

    _amplitude: ClassVar[str] = "amplitude"

    @property
    def _known(self) -> dict[str, float]:
        return {**{estimate.name: estimate.value for estimate in self.refined}, **self.model.fixed}

    def __getitem__(self, name: str) -> Estimate:
        """Refined estimate of a parameter, the mass ("m") or the background; what is fixed has no error.

        Raises
        ------
        RsgenError
            The model has no such parameter; it is a ``KeyError``, too.
        """
        return lookup(name, self._estimates, "parameter")

    def __contains__(self, name: object) -> bool:
        return name in self._estimates

    def __iter__(self) -> Iterator[Estimate]:
        return iter(self.refined)

    @property
    def _estimates(self) -> dict[str, Estimate]:
        of_background = self.background.estimates if self.background else ()
        return {estimate.name: estimate for estimate in (*of_background, *self.refined, *self.fixed)}

    @property
    def table(self) -> TextTable:
        """The table that is printed."""
        background = () if self.background is None else self.background.estimates
        table = table_of((*self.refined, *self.small_motion, *background, *self.fixed))
        low, high = self.amplitude_range
        slow, fast = self.frequency_range
        # without repeats the noise is that of the misfit, unless this has a pattern
        unknown = self.noise == self.residual and self.fit is not None and self.fit.systematic
        tested = (
            f"{self._amplitude} {low:.4g} to {high:.4g} m, frequency {slow:.5g} to {fast:.5g} Hz, "
            f"{'' if unknown else f'noise {100 * self.noise:.2g} %, '}misfit {100 * self.residual:.2g} %"
            + "; one level shows the law at its own amplitudes only"
            * (self.outcome.numbers.get("levels", (0,))[0] == 1)
        )
        return replace(
            table,
            caption=f"{self.verdict}\n{with_equations(self.model.force)}",
            notes=(
                tested,
                *mass_lines(self),
                *held_out_lines(self.held_out, self.verdict.usable),
                *printed_findings(self.verdict, self.findings),
            ),
        )


# ----------------------------------------------------------------------------
# Fields that are computed where they are first read.

Value = TypeVar("Value")
Found = TypeVar("Found", bound=Identification)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MultisineIdentification(Identification):
    """Parameters identified from a multisine test: an ``Identification``, and the spectra that were fitted.

    ``paper`` and ``first_order`` are NaN: both methods need single sines. ``resonances`` are those of the
    best linear approximation of each level; their amplitude is sqrt(2) times the rms displacement.

    Parameters
    ----------
    spectra
        All records, including held-out ones.
    approximations
        Best linear approximation of every fitted level.
    used
        (r, H+1) fitted lines of each fitted record.
    misfit
        (r, H+1) residual F - m x'' - n of each fitted record at each line [N].
    deviation
        (r, H+1) standard deviation of that residual, from the scatter of the periods [N]; NaN of one period.
    """

    spectra: MultisineSpectra = field(kw_only=True)
    approximations: tuple[BestLinear, ...] = field(kw_only=True)
    used: NDArray[np.bool_] = field(kw_only=True)
    misfit: ComplexArray = field(kw_only=True)
    deviation: Array = field(kw_only=True)
    _amplitude: ClassVar[str] = "amplitude of a sine with the rms of a record"


@dataclass(frozen=True, slots=True)
class _Later:
    compute: Callable[[], Any]


_POSTPONED = ("paper", "first_order", "first_order_bias", "restoring")
"""Fields that cost time and that many users never read."""


def later(compute: Callable[[], Value]) -> Value:
    """Stand for a value of ``paper``, ``first_order``, its bias or ``restoring`` until it is read."""
    return cast("Value", _Later(compute))


def changed(found: Found, **changes: Any) -> Found:
    """Replace fields, as ``dataclasses.replace`` does, and compute none that was not read yet."""
    waiting = {name: later(partial(getattr, found, name)) for name in _POSTPONED}
    return replace(found, **(waiting | changes))
