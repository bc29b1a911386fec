"""The test points that take part."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, Chosen
from rsgen.common.errors import RsgenError
from rsgen.common.tolerances import ERRORS, EXPECTED_NOISE
from rsgen.data.oscillator import Model, join_model
from rsgen.data.surface import OUTCOMES, ResponseSurface
from rsgen.data.surface.phase_lag import RESONANT, BackboneGap, backbone_gap
from rsgen.law.motion import Motion, feeds_exciter

ASYMMETRIC = 0.2
"""Mean or higher harmonic, relative to the amplitude, that a motion near a centred sine does not have."""

_SOME = 3
"""At least as many points are no accident."""

_QUADRATURE = 0.2
"""Points at phase resonance: a lag within 11 degrees of a quarter period [rad]; loops miss it by less."""

FEWEST = 4
"""Points: a mass, a spring and a damper, and one to disagree with them."""

_REST = 1e-12
"""Motion relative to the largest of a test that no sensor resolves."""

_RANGE = (1e-60, 1e60)
"""Sizes of force, response and frequency in SI units: their fourth powers are still numbers, and nothing
measured is near."""


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """What the fits see of a surface.

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
        Harmonics (0 for the mean) that the test measured; others are all zero in the table.
    peak
        (n, 2) largest and smallest displacement [m], NaN where unknown.
    across
        (n, H+1) complex displacement [m] across two sensors; (n, 0) where the law acts on the response.
    load
        (n, K+1) complex harmonics of the force [N], None where only the fundamental was recorded.
    phase_known
        False where force and response are sizes, and the phase between them was not recorded.
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
    load: NDArray[np.complex128] | None = None
    phase_known: bool = True

    def __len__(self) -> int:
        return len(self.omega)

    @property
    def motion(self) -> Motion:
        """Harmonics over their frequencies."""
        return Motion(self.omega, self.harmonics)

    @property
    def far(self) -> NDArray[np.complex128]:
        """(n, E-1) fundamentals [m] of the E motions but the response: one across two sensors, or none."""
        return self.across[:, 1:2]

    @property
    def means(self) -> tuple[bool, bool]:
        """Whether the mean was recorded, of the response and of the motion across two sensors."""
        return 0 in self.measured, bool(np.any(self.across[:, :1]))

    @property
    def amplitude(self) -> NDArray[np.float64]:
        """(n,) X [m]."""
        return np.abs(self.harmonics[:, 1])

    @property
    def asymmetric(self) -> bool:
        """Whether some motions have a mean or a second harmonic that no noise explains."""
        even = np.abs(self.harmonics[:, 0:3:2]).max(axis=1) / self.amplitude
        return int(np.count_nonzero(even > ASYMMETRIC)) >= _SOME

    @property
    def strong(self) -> bool:
        """Whether some motions are so far from a sine that a balance of few harmonics may miss them."""
        higher = np.abs(self.harmonics[:, 2:]).max(axis=1, initial=0.0) / self.amplitude
        return int(np.count_nonzero(higher > ASYMMETRIC)) >= _SOME

    @property
    def lag(self) -> NDArray[np.float64]:
        """(n,) lag beyond a quarter period [rad]; a response that leads counts as if it were reversed.

        NaN where it was not recorded.
        """
        stiffness = self.force / self.harmonics[:, 1]
        lag = np.angle(stiffness.real + 1j * np.abs(stiffness.imag)) - np.pi / 2
        return np.where(self.phase_known, lag, np.nan)

    @property
    def feed_exciter(self) -> bool:
        """Whether the structure works on its exciter; not known, so False, where no phase was recorded."""
        return self.phase_known and feeds_exciter(self.force, self.harmonics[:, 1])

    @property
    def in_quadrature(self) -> NDArray[np.bool_]:
        """(n,) True where the response lags the force by nearly a quarter period, or as in all points."""
        common = float(np.median(self.lag))
        return np.abs(self.lag - (common if abs(common) < RESONANT else 0.0)) < _QUADRATURE

    @property
    def runs(self) -> list[NDArray[np.intp]]:
        """Rows of every level and sweep, ascending in frequency."""
        runs = []
        for level, sweep in sorted({*zip(self.level.tolist(), self.sweep.tolist(), strict=True)}):
            rows = np.flatnonzero((self.level == level) & (self.sweep == sweep))
            runs.append(rows[np.argsort(self.omega[rows], kind="stable")])
        return runs

    @property
    def neighbours(self) -> NDArray[np.intp]:
        """(k, 2) pairs next to each other in frequency within one level and sweep.

        Of a free decay, and of a backbone where each point has its level to itself, all points are at phase
        resonance. They are next to each other in amplitude: their frequencies follow from it, with noise.
        """
        along = self.amplitude if self.in_quadrature.all() else self.omega
        order = np.lexsort((along, self.sweep, self.level))
        same = (self.level[order][1:] == self.level[order][:-1]) & (
            self.sweep[order][1:] == self.sweep[order][:-1]
        )
        paired = np.concatenate([[False], same]) | np.concatenate([same, [False]])
        alone = order[~paired] if len(order) else order
        backbone = len(alone) > 0 and bool(self.in_quadrature[alone].all())
        alone = alone if backbone else alone[:0]
        chain = alone[np.argsort(self.amplitude[alone], kind="stable")]
        first = np.concatenate([order[:-1][same], chain[:-1]])
        return np.stack([first, np.concatenate([order[1:][same], chain[1:]])], axis=1)

    def pairs(self, counted: NDArray[np.bool_]) -> NDArray[np.intp]:
        """(k, 2) ``neighbours`` of which both are ``counted``, (n,)."""
        pairs = self.neighbours
        return pairs[counted[pairs].all(axis=1)]

    def select(self, chosen: Chosen) -> Points:
        """Keep some points."""
        columns = {f.name: getattr(self, f.name) for f in fields(self)}
        rows: dict[str, Any] = {k: v[chosen] for k, v in columns.items() if isinstance(v, np.ndarray)}
        return replace(self, **rows)

    def spread(self, count: int) -> NDArray[np.intp]:
        """Choose about ``count`` points evenly over the amplitude: a quick picture of the whole test."""
        if len(self) <= count:
            return np.arange(len(self))
        order = np.lexsort((self.omega, self.amplitude))
        return np.sort(order[np.linspace(0, len(self) - 1, count).round().astype(np.intp)])


def held_out_mask(surface: ResponseSurface, model: Model) -> NDArray[np.bool_]:
    """(n,) True where a point belongs to a level that identification must not see."""
    meant = [surface.find_level(level) for level in model.observation.hold_out]
    return np.isin(surface.level, [level for level in meant if level is not None])


def _at_rest(surface: ResponseSurface) -> float:
    """Amplitude [m] up to which a point is at rest: friction holds the mass, what is left is round-off."""
    return _REST * float(np.max(surface.amplitude, initial=0.0, where=np.isfinite(surface.amplitude)))


def _why_unused(surface: ResponseSurface) -> str:
    """Count what keeps points out, in words."""
    reasons = [
        f"{count} {sentence}"
        for kind, sentence in enumerate(OUTCOMES)
        if kind and (count := int(np.count_nonzero(surface.outcome == kind)))
    ]
    still = int(np.count_nonzero(surface.settled & (surface.amplitude <= _at_rest(surface))))
    if still:
        reasons.append(f"{still} do not move: friction holds the mass at these levels")
    return f" ({'; '.join(reasons)})" if reasons else ""


def per_unit_mass(surface: ResponseSurface, model: Model) -> tuple[ResponseSurface, Model]:
    """Give test and model one kind of force: where it is one per mass, on the mass, or on one kilogram.

    With a known mass forces become newtons. Without one the mass of the balance is 1 kg, the forces stay as
    they are, and the parameters are per unit mass: no test of a driven base determines more.
    """
    surface = surface.on_mass(model.fixed.get("m", nan))
    return surface, join_model(model, mass=1.0) if surface.per_mass else model


def _load_of(surface: ResponseSurface, index: NDArray[np.intp]) -> NDArray[np.complex128] | None:
    """(n, K+1) harmonics of the force that were recorded, those that are not numbers zero."""
    load = np.nan_to_num(surface.force_harmonics[index])
    higher = load[:, [h for h in range(load.shape[1]) if h != 1]]
    return load if higher.any() else None


def select_points(surface: ResponseSurface, model: Model) -> Points:
    """Take the points that identification may use.

    Raises
    ------
    RsgenError
        A held-out level is not in the surface, fewer than four points remain, or a background is asked for
        beside free decays.
    """
    if surface.decays and model.observation.background != "none":
        raise RsgenError(
            f"background: {model.observation.background!r}; points of a free decay are given, and what a "
            "force drives beside the mode does not go on without one: leave it out"
        )
    for level in model.observation.hold_out:
        if surface.find_level(level) is None:
            unit = surface.level_unit
            raise RsgenError(
                f"hold_out: no level {level:g} {unit} in the surface; it has {surface.level_names} {unit}"
            )
    harmonics = np.array(surface.harmonics)
    higher = ~np.isfinite(harmonics)
    higher[:, 1] = False
    harmonics[higher] = 0
    good = (
        surface.settled
        & ~held_out_mask(surface, model)
        & np.isfinite(harmonics[:, 1])
        & np.isfinite(surface.force)
        & (np.abs(harmonics[:, 1]) > _at_rest(surface))
        & (np.abs(surface.force) > 0)
    )
    if model.observation.band is not None:
        low, high = model.observation.band
        good &= (surface.frequency >= low) & (surface.frequency <= high)
    index = np.flatnonzero(good)
    for name, size in (
        ("force", surface.force),
        ("response", surface.amplitude),
        ("frequency", surface.omega),
    ):
        low, high = _RANGE
        far = index[(np.abs(size[index]) < low) | (np.abs(size[index]) > high)]
        if len(far):
            found = f"{np.abs(size[far[0]]):g} in row {far[0]}"
            raise RsgenError(f"surface.{name}: {found}; must be {low:g} to {high:g} in SI units")
    if len(index) < FEWEST:
        raise RsgenError(
            f"surface: {len(index)} of {len(surface)} points can be used (settled, not held out, in the "
            f"band, finite force and response); identification needs at least {FEWEST}{_why_unused(surface)}"
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
        _load_of(surface, index),
        surface.phase_known,
    )


# ----------------------------------------------------------------------------
# Points at phase resonance, where k - m omega^2 vanishes whatever the mass is.

_OFF = 2
"""At least as many points off resonance determine a mass, one on either side or two slices."""

_PHASES = 0.01
"""Lags that spread by less, half a degree [rad], say nothing of the mass: phases are measured no better."""

_KNOWN = 0.2
"""Standard error of the mass, relative, above which it is not identified: zeta would be as unsure."""

LAG_ERROR = 0.035
"""Standard deviation of a lag that was not recorded [rad], two degrees: filters and amplifiers of a loop that
works leave as much. One value for the whole test, for they are the same at every level."""


def near_resonance(points: Points) -> bool:
    """Tell whether hardly a point lies off phase resonance, or off a lag that all share."""
    return int(np.count_nonzero(~points.in_quadrature)) < _OFF


def at_resonance_alone(points: Points, noise: float = 2 * EXPECTED_NOISE) -> bool:
    """Tell whether all points have one lag to within the noise [1]: a mass then rests on errors of the lag.

    Slices a few degrees on either side of resonance determine a mass, as F/X = k - m omega^2 differs in them.
    """
    if not near_resonance(points):
        return False
    spread = np.std(points.lag[points.in_quadrature])
    return bool(spread < max(_PHASES, ERRORS * noise))


def mass_needs(points: Points, model: Model) -> str:
    """Say what points have to be to determine a mass that is not given, "" where they do."""
    if "m" in model.fixed:
        return ""
    if np.ptp(points.omega) == 0:
        return "tests at more than one frequency"
    return "points off phase resonance" if at_resonance_alone(points) else ""


def mass_sure(mass: float, variance: float) -> bool:
    """Tell whether an identified mass [kg] is positive, and its variance [kg^2] small enough."""
    return bool(mass > 0 and variance < (_KNOWN * mass) ** 2)


def assumed_mass(points: Points, ratio: float) -> float:
    """Mass [kg] that gives points at phase resonance a damping ratio [1]: omega c = 2 zeta m omega^2."""
    stiffness = points.force / points.harmonics[:, 1]
    return float(np.median(np.abs(stiffness.imag) / points.omega**2)) / (2 * ratio)


def gap_of(points: Points) -> BackboneGap | None:
    """Gap between the points at phase resonance; None where they lie on one backbone."""
    near = points.in_quadrature
    return backbone_gap(points.omega[near] / (2 * np.pi), points.amplitude[near])


def loop_error(influence: Array) -> Array:
    """Covariance (q, q) that the error of a lag causes which was taken for a quarter period.

    It turns every force by one angle, so that the imaginary part of all relative forces changes by it; the
    (n, M, q) influence of those on the parameters adds up.
    """
    half = (influence.shape[1] + 1) // 2
    moved = LAG_ERROR * np.sum(influence[:, half], axis=0)
    return np.outer(moved, moved)
