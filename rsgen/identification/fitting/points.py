"""Selection of the test points of a fit, and of those at phase resonance.

Points are settled, finite, in the band and not held out. At phase resonance, where the lag is a quarter
period, Re F/X = k - m omega^2 vanishes for every mass: a test with no other points determines only ratios to
the mass.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import nan
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, Chosen, take_rows
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import (
    ASSUMED_RELATIVE_NOISE,
    NOISE_RATIO_BY_CHANCE,
    ROUND_OFF,
    STANDARD_ERRORS_OF_DIFFERENCE,
)
from rsgen.data.history.envelope import NOISE_OF_SLOPE
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import Model, join_model
from rsgen.data.surface.columns import levels_in_noise
from rsgen.data.surface.plausibility import MAX_LAG_ERROR, MAX_RESONANT_LAG
from rsgen.data.surface.response_surface import Outcome, ResponseSurface, within_half_power
from rsgen.formula.names import symbol
from rsgen.law.character import character
from rsgen.law.motion import Motion, feeds_exciter

Test = TypeVar("Test", ResponseSurface, MultisineSpectra)

ASYMMETRIC = 0.2
"""Mean or higher harmonic, relative to the amplitude, beyond that of a nearly sinusoidal motion."""

_MIN_ASYMMETRIC_POINTS = 3

MIN_POINTS = 4
"""A mass, a spring and a damper, and one more point."""

_SI_RANGE = (1e-60, 1e60)
"""Admissible sizes of force, response and frequency in SI units: their fourth powers are finite."""


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """The points of a surface that are fitted.

    Parameters
    ----------
    index
        (n,) rows of the surface.
    level, omega
        (n,) nominal force amplitude [N] and angular frequency [rad/s].
    sweep
        (n,) "rest", "up", "down".
    force
        (n,) complex amplitude of the measured force [N].
    harmonics
        (n, H+1) complex displacement [m].
    measured
        Measured harmonics (0 for the mean); the columns of others are zero.
    peak
        (n, 2) largest and smallest displacement [m], NaN where unknown.
    across
        (n, H+1) complex displacement [m] across two sensors; (n, 0) if the law acts on the response.
    noise
        (n, 3) noise of force, fundamental and other harmonics, relative to force and amplitude of the point,
        up to a common factor; see ``_noise_of``.
    load
        (n, K+1) complex harmonics of the force [N]; None if only the fundamental was recorded.
    phase_known
        False if the phase between force and response was not recorded.
    overlapping
        True if the points are of windows over a record that overlap.
    weighed
        Mass and its standard error [kg], where it was weighed; None where it was not.
    """

    index: NDArray[np.intp]
    level: NDArray[np.float64]
    omega: NDArray[np.float64]
    sweep: NDArray[np.str_]
    force: NDArray[np.complex128]
    harmonics: NDArray[np.complex128]
    measured: tuple[int, ...]
    peak: NDArray[np.float64]
    across: NDArray[np.complex128]
    noise: NDArray[np.float64]
    load: NDArray[np.complex128] | None = None
    phase_known: bool = True
    overlapping: bool = False
    weighed: tuple[float, float] | None = None

    def __len__(self) -> int:
        return len(self.omega)

    def known_values(self, fixed: Mapping[str, float]) -> dict[str, float]:
        """Return fixed values with that of a mass which was weighed, where starts begin."""
        return {**({} if self.weighed is None else {"m": self.weighed[0]}), **fixed}

    @property
    def motion(self) -> Motion:
        """Harmonics over their frequencies."""
        return Motion(self.omega, self.harmonics)

    @property
    def far(self) -> NDArray[np.complex128]:
        """Fundamental [m] of the motion across two sensors (n, 1); (n, 0) without one."""
        return self.across[:, 1:2]

    @property
    def means(self) -> tuple[bool, bool]:
        """True if the mean was recorded, of the response and of the motion across two sensors."""
        return 0 in self.measured, bool(np.any(self.across[:, :1]))

    @property
    def amplitude(self) -> NDArray[np.float64]:
        """(n,) X [m]."""
        return np.abs(self.harmonics[:, 1])

    @property
    def in_noise(self) -> NDArray[np.bool_]:
        """True (n,) at levels whose response is noise, as of a mass at rest; at none where few are left."""
        noise = levels_in_noise(self.level, self.sweep, self.omega, self.harmonics[:, 1] / self.force)
        return noise & (np.count_nonzero(~noise) > MIN_POINTS)

    @property
    def asymmetric(self) -> tuple[bool, bool]:
        """True if some motions have a mean or a second harmonic beyond noise, and if some have the second."""
        even = np.abs(self.harmonics[:, 0:3:2]) > ASYMMETRIC * self.amplitude[:, None]
        either, second = even.any(axis=1), even[:, 1:].any(axis=1)
        return either.sum() >= _MIN_ASYMMETRIC_POINTS, second.sum() >= _MIN_ASYMMETRIC_POINTS

    @property
    def strong(self) -> bool:
        """True if some motions are far from a sine, so that a balance of few harmonics may be wrong."""
        higher = np.abs(self.harmonics[:, 2:]).max(axis=1, initial=0.0) / self.amplitude
        return int(np.count_nonzero(higher > ASYMMETRIC)) >= _MIN_ASYMMETRIC_POINTS

    @property
    def lag(self) -> NDArray[np.float64]:
        """Lag (n,) minus a quarter period [rad], of the reversed response if it leads; NaN without phases."""
        stiffness = self.force / self.harmonics[:, 1]
        lag = np.angle(stiffness.real + 1j * np.abs(stiffness.imag)) - np.pi / 2
        return np.where(self.phase_known, lag, np.nan)

    @property
    def feed_exciter(self) -> bool:
        """True if the structure feeds energy into its exciter; False without phases."""
        return self.phase_known and feeds_exciter(self.force, self.harmonics[:, 1])

    @property
    def in_quadrature(self) -> NDArray[np.bool_]:
        """Mask (n,) of responses that lag the force by nearly a quarter period, or as all points do."""
        common = float(np.median(self.lag))
        return np.abs(self.lag - (common if abs(common) < MAX_LAG_ERROR else 0.0)) < MAX_RESONANT_LAG

    @property
    def run(self) -> NDArray[np.intp]:
        """Number (n,) of the run of each point, in the order of levels, then of sweeps."""
        levels, sweeps = (np.unique(of, return_inverse=True)[1] for of in (self.level, self.sweep))
        return levels * len(self) + sweeps

    @property
    def runs(self) -> list[NDArray[np.intp]]:
        """Rows of every level and sweep, ascending in frequency."""
        run = self.run
        order = np.lexsort((self.omega, run))
        return np.split(order, np.flatnonzero(np.diff(run[order])) + 1)

    def held(self, spread: float, counted: NDArray[np.bool_] | bool = True) -> Array:
        """Amplitude (n,) [m] that levels of several points held within a relative spread [1]; else NaN.

        Only points that are ``counted`` (n,) say so.
        """
        held, size = np.full(len(self), np.nan), np.log(self.amplitude)
        for level in np.unique(self.level):
            rows = np.flatnonzero((self.level == level) & counted)
            if len(rows) > 1 and np.std(size[rows]) < spread:
                held[self.level == level] = np.exp(np.mean(size[rows]))
        return held

    @property
    def record(self) -> NDArray[np.intp] | None:
        """Number (n,) of the record of points of overlapping windows, in order of time; None of others."""
        if not self.overlapping:
            return None
        return np.concatenate([[0], np.cumsum(np.diff(self.run) != 0)])

    @property
    def neighbours(self) -> NDArray[np.intp]:
        """Pairs (k, 2) next to each other in frequency within one level and sweep.

        Points of a free decay, and of a backbone with one point a level, are all at phase resonance: these
        are neighbours in amplitude, on which their frequencies depend.
        """
        along = self.amplitude if self.in_quadrature.all() else self.omega
        order = np.lexsort((along, self.run))
        same = np.diff(self.run[order]) == 0
        paired = np.concatenate([[False], same]) | np.concatenate([same, [False]])
        alone = order[~paired] if len(order) else order
        backbone = len(alone) > 0 and bool(self.in_quadrature[alone].all())
        alone = alone if backbone else alone[:0]
        chain = alone[np.argsort(self.amplitude[alone], kind="stable")]
        first = np.concatenate([order[:-1][same], chain[:-1]])
        return np.stack([first, np.concatenate([order[1:][same], chain[1:]])], axis=1)

    def pairs(self, counted: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Return the ``neighbours`` (k, 2) that are both ``counted`` (n,)."""
        pairs = self.neighbours
        return pairs[counted[pairs].all(axis=1)]

    def harmonics_share(self, noise: float) -> Array:
        """Relative error (n,) of the mass that one harmonic leaves: the kinetic energy of the others.

        Higher harmonics follow the fundamental as n_h/(m h^2 omega^2), so that they add to k what falls with
        omega^2, as more mass would; of a force proportional to X it is the sum of (h^2 - 1) |X_h|^2/X^2.
        Harmonics no larger than the relative noise of real and imaginary part do not count.
        """
        orders = np.arange(2, self.harmonics.shape[1])
        squares = np.abs(self.harmonics[:, 2:]) ** 2 / self.amplitude[:, None] ** 2
        seen = np.mean(squares, axis=0) > 2 * (NOISE_RATIO_BY_CHANCE * noise) ** 2
        return np.asarray(squares[:, seen] @ orders[seen] ** 2)

    def select(self, chosen: Chosen) -> Points:
        """Keep some points."""
        return take_rows(self, chosen)

    def spread(self, count: int) -> NDArray[np.intp]:
        """Return the indices of about ``count`` points, evenly over the amplitude."""
        if len(self) <= count:
            return np.arange(len(self))
        order = np.lexsort((self.omega, self.amplitude))
        return np.sort(order[np.linspace(0, len(self) - 1, count).round().astype(np.intp)])


def at_rest(surface: ResponseSurface) -> NDArray[np.bool_]:
    """(n,) settled points at rest to round-off, as where friction holds the mass."""
    size = surface.amplitude
    most = ROUND_OFF * float(np.max(size, initial=0.0, where=np.isfinite(size)))
    return surface.settled & (size <= most)


def _why_unused(surface: ResponseSurface) -> str:
    """Return the reasons why points are not used, with counts, in words."""
    reasons = [
        f"{count} {outcome.text}"
        for outcome in Outcome
        if outcome and (count := int(np.count_nonzero(surface.outcome == outcome)))
    ]
    still = int(np.count_nonzero(at_rest(surface)))
    if still:
        largest = f"of the largest response, {np.nanmax(surface.amplitude):.2g} m"
        why = "friction holds the mass at these levels, or the largest is an outlier"
        reasons.append(f"{still} move less than {ROUND_OFF:.0e} {largest}: {why}")
    return f" ({'; '.join(reasons)})" if reasons else ""


def per_unit_mass(surface: Test, model: Model) -> tuple[Test, Model]:
    """Convert a test of forces per mass: to newtons with a known mass, else to a mass of 1 kg.

    Without a mass the parameters are per unit mass: a test of a driven base determines no more. A test that
    was read with a mass, of its case or for the forces of free decays, has this one if the model has none.
    """
    read_with = [f for f in surface.findings if f.code in ("force-of-decay", "mass-of-case")]
    given = [f.numbers for f in read_with if "mass" in f.numbers]
    if given and model.mass is None:
        # that of the case stands last, with its error
        mass, *error = (float(given[-1][name].value) for name in ("mass", "error") if name in given[-1])
        model = join_model(model, mass=mass, mass_error=next(iter(error), None))
    elif given:
        surface = replace(surface, findings=tuple(f for f in surface.findings if f.code != "mass-of-case"))
    if model.mass_error:
        follows = surface.per_mass or bool(surface.base) or any(f.code == "force-of-decay" for f in read_with)
        model = _with_weighed_mass(model, follows=follows)
    surface = surface.on_mass(model.fixed.get("m", nan))
    return surface, join_model(model, mass=1.0) if surface.per_mass else model


def _with_weighed_mass(model: Model, *, follows: bool) -> Model:
    """Return a model whose mass is fitted with its error, or held where the forces of a test follow it.

    These are the mass times a motion: all linear values have its relative error (``with_mass_error``).
    """
    others = {name: value for name, value in model.fixed.items() if name != "m"}
    if follows:
        law = character(model.force)
        linear = {law.parameters[place] for place in law.linear}
        if model.force.xreplace(dict.fromkeys(map(symbol, linear), 0)) != 0 or linear & others.keys():
            raise RsgenError(
                f"mass_error: {model.mass_error:g} kg, but forces of this test are the mass times a motion, "
                "and a term of the law without a free factor does not follow them; leave mass_error out"
            )
        others["m"] = cast("float", model.mass)
    return Model(model.elements, model.mass, model.observation, others, model.mass_error)


def _load_of(surface: ResponseSurface, index: NDArray[np.intp]) -> NDArray[np.complex128] | None:
    """Return the recorded harmonics of the force (n, K+1), zero where they are NaN; None without any."""
    load = np.nan_to_num(surface.force_harmonics[index])
    higher = load[:, [h for h in range(load.shape[1]) if h != 1]]
    return load if higher.any() else None


FORCE, FUNDAMENTAL, OTHERS = range(3)
"""Columns of ``Points.noise``: of the force, of the fundamental and of other harmonics of the motion."""

_EQUAL_NOISE = np.ones(3)
"""Relative noise of force and motion in a test of sines, 1:1: it rarely says which sensor is worse."""


def _noise_of(surface: ResponseSurface, index: NDArray[np.intp], mass: float) -> Array:
    """Return the noise (n, 3) of force, fundamental and other harmonics of rows, up to a common factor.

    It is as large as force and response, whose ratio a test of sines does not determine. A free decay has
    white noise in its record, of one size at all points, and its force is m (2 s) times the slope of the
    envelope: both are known but for one factor. Other harmonics have that of the force, relative to the
    largest, for they are those of the steady motion to first order only.
    """
    noise = np.tile(_EQUAL_NOISE, (len(index), 1))
    if not (surface.decays and mass > 0):
        return noise
    size, force = surface.amplitude[index], np.abs(surface.force[index])
    of_slope = 2 * NOISE_OF_SLOPE * mass * surface.omega[index] ** 2
    largest, typical = float(force.max()), float(np.median(of_slope))
    noise[:, FORCE] = of_slope / typical * largest / force
    noise[:, FUNDAMENTAL] = largest / (typical * size)
    noise[:, OTHERS] = size.max() / size
    return noise


def _refuse_sizes(surface: ResponseSurface, index: NDArray[np.intp]) -> None:
    """Refuse sizes of some rows that are beyond ``_SI_RANGE``."""
    low, high = _SI_RANGE
    for name, column in (("force", "force"), ("response", "amplitude"), ("frequency", "omega")):
        size = np.abs(getattr(surface, column))
        far = index[(size[index] < low) | (size[index] > high)]
        if len(far):
            found = f"{size[far[0]]:g} in row {far[0]}"
            raise RsgenError(f"surface.{name}: {found}; must be {low:g} to {high:g} in SI units")


def select_points(surface: ResponseSurface, model: Model) -> Points:
    """Select the points of an identification.

    Raises
    ------
    RsgenError
        A held-out level is not in the surface, fewer than four points remain, or a background is asked for
        with free decays.
    """
    if surface.decays and model.observation.background != "none":
        raise RsgenError(
            f"background: {model.observation.background!r}; points of a free decay are given, and the "
            "background of a driven test does not go on without a force: leave it out"
        )
    surface.require_levels(model.observation.hold_out)
    harmonics = np.array(surface.harmonics)
    higher = ~np.isfinite(harmonics)
    higher[:, 1] = False
    harmonics[higher] = 0
    good = (
        surface.settled
        & ~surface.held_out(model.observation.hold_out)
        & np.isfinite(harmonics[:, 1])
        & np.isfinite(surface.force)
        & ~at_rest(surface)
        & (np.abs(surface.force) > 0)
    )
    if model.observation.band is not None:
        low, high = model.observation.band
        good &= (surface.frequency >= low) & (surface.frequency <= high)
    index = np.flatnonzero(good)
    _refuse_sizes(surface, index)
    if len(index) < MIN_POINTS:
        raise RsgenError(
            f"surface: {len(index)} of {len(surface)} points can be used (settled, not held out, in the "
            f"band, finite force and response); identification needs at least {MIN_POINTS}"
            f"{_why_unused(surface)}"
        )
    chosen = harmonics[index]
    measured = tuple(int(h) for h in range(chosen.shape[1]) if h == 1 or np.any(chosen[:, h] != 0))
    return Points(
        index,
        surface.level[index],
        surface.omega[index],
        surface.sweep[index],
        surface.force[index],
        chosen,
        measured,
        surface.peak[index],
        np.nan_to_num(surface.across[index]),
        _noise_of(surface, index, model.fixed.get("m", nan)),
        _load_of(surface, index),
        surface.phase_known,
        surface.overlapping,
        model.weighed,
    )


# ----------------------------------------------------------------------------
# Amplitudes that points have.

_AMPLITUDE_TOLERANCE = 0.05
"""Amplitudes that differ by less, relatively, count as one: a coefficient needs an amplitude of its own."""


def count_amplitudes(amplitude: Array) -> int:
    """Count different amplitudes [m]: few in a test with response control."""
    parts = (np.log(amplitude[rows]) for rows in _amplitude_groups(amplitude))
    return sum(max(1, round((part[-1] - part[0]) / _AMPLITUDE_TOLERANCE)) for part in parts)


def _amplitude_groups(amplitude: Array) -> list[NDArray[np.intp]]:
    """Return rows of amplitudes [m] in ascending order, parted where these differ."""
    order = np.argsort(amplitude)
    return np.split(order, np.flatnonzero(np.diff(np.log(amplitude[order])) > _AMPLITUDE_TOLERANCE) + 1)


def held_amplitudes(mode: Points) -> Array:
    """Amplitude (n,) [m] that each level held, one number for those that hardly differ; NaN if one varied."""
    held = mode.held(_AMPLITUDE_TOLERANCE)
    if np.isnan(held).any():
        return np.full(len(held), np.nan)
    for rows in _amplitude_groups(held):
        held[rows] = np.mean(held[rows])
    return held


def amplitudes_near(points: Points | ResponseSurface) -> Array:
    """Return the amplitudes [m] of the points near resonance, ascending."""
    return np.sort(points.amplitude[within_half_power(points.force, points.harmonics[:, 1])])


# ----------------------------------------------------------------------------
# Points at phase resonance, where k - m omega^2 vanishes whatever the mass is.

_MIN_OFF_RESONANCE = 2
"""Points off resonance that determine a mass."""

_PHASE_RESOLUTION = 0.01
"""Spread of lags [rad], half a degree, that is within errors of measurement."""

_MAX_MASS_ERROR = 0.2
"""Relative standard error of an identified mass."""

LAG_ERROR = 0.035
"""Standard deviation of a lag that was not recorded [rad], two degrees, one value for the whole test."""


def near_resonance(points: Points) -> bool:
    """Return True if almost all points lie at phase resonance, or have one common lag."""
    return int(np.count_nonzero(~points.in_quadrature)) < _MIN_OFF_RESONANCE


def at_resonance_alone(points: Points, noise: float = 2 * ASSUMED_RELATIVE_NOISE) -> bool:
    """Return True if all points have one lag within the noise [1], so that they determine no mass.

    Slices a few degrees on either side of resonance determine a mass, as F/X = k - m omega^2 differs in them.
    """
    if not near_resonance(points):
        return False
    spread = np.std(points.lag[points.in_quadrature])
    return bool(spread < max(_PHASE_RESOLUTION, STANDARD_ERRORS_OF_DIFFERENCE * noise))


def mass_needs(points: Points, model: Model) -> str:
    """Return the kind of points that an unknown mass needs, in words; "" if there are some."""
    if "m" in model.fixed or model.weighed:
        return ""
    if np.ptp(points.omega) == 0:
        return "tests at more than one frequency"
    return "points off phase resonance" if at_resonance_alone(points) else ""


def refuse_resonance_alone(points: Points, model: Model, *, remembers: bool) -> None:
    """Refuse points at phase resonance alone for a background, and for a law whose stiffness needs the mass.

    k(X) = m omega^2 holds there for every m. A law with memory has its stiffness in the area of its loops; a
    value that is fixed, or the motion across two sensors, may determine the mass. The receptance of the mode,
    1/(i omega c), and a background are one complex number at each amplitude.

    Raises
    ------
    RsgenError
        The mass is not known, and no point determines it; or a background beyond a phase error is asked for.
    """
    if model.observation.background not in ("none", "phase") and at_resonance_alone(points):
        raise RsgenError(
            f"background: {model.observation.background!r}; all points lie at phase resonance, where mode "
            'and background cannot be separated; leave it out, take "phase", or add points off resonance'
        )
    if not (model.fixed or model.weighed or model.sensors or remembers) and at_resonance_alone(points):
        raise RsgenError(
            "the test does not determine the mass, for all points lie at phase resonance; give it, or points "
            "off phase resonance (the modal table has k/m and c without)"
        )


def mass_sure(mass: float, variance: float) -> bool:
    """Return True if an identified mass [kg] is positive, and its variance [kg^2] small."""
    return bool(mass > 0 and variance < (_MAX_MASS_ERROR * mass) ** 2)


def assumed_mass(points: Points, ratio: float) -> float:
    """Return the mass [kg] at which points at phase resonance have a damping ratio [1]: c = 2 zeta m w."""
    stiffness = points.force / points.harmonics[:, 1]
    return float(np.median(np.abs(stiffness.imag) / points.omega**2)) / (2 * ratio)


def at_phase_resonance(points: Points) -> tuple[Array, Array]:
    """Return frequency [Hz] and amplitude [m] of the points at phase resonance."""
    near = points.in_quadrature
    return points.omega[near] / (2 * np.pi), points.amplitude[near]


def loop_error(influence: Array) -> Array:
    """Return the covariance (q, q) by the error of a lag that was assumed to be a quarter period.

    It turns every force by one angle, so that the imaginary parts of all relative forces change by it; their
    (n, M, q) influence on the parameters adds up.
    """
    half = (influence.shape[1] + 1) // 2
    moved = LAG_ERROR * np.sum(influence[:, half], axis=0)
    return np.outer(moved, moved)
