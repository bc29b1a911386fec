"""Whether a test and its mode have sizes that a vibration test can have, and which mistake explains others.

The bounds are wide on purpose: outside them nothing has been tested, whatever the structure. Small and fast
structures (resonators on a chip, wires, ultrasonic tools) have bounds of their own, for a mass of a microgram
is theirs and at 30 Hz nobody's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import ComplexArray
from rsgen.common.finding import Finding, Quantity
from rsgen.data.surface.any_law import AS_GOOD, BETTER, FITS, driven_points, fit_any_law, powers_for
from rsgen.data.surface.columns import DERIVATIVE, QUANTITIES
from rsgen.data.surface.response_surface import ResponseSurface

__all__ = [
    "LIMITS",
    "MISTAKES",
    "Limit",
    "Mistake",
    "Sizes",
    "level_findings",
    "plausibility_findings",
    "quantity_findings",
    "size_findings",
]


@dataclass(frozen=True, slots=True)
class Limit:
    """What a quantity can be: from ``least`` to ``most``, in ordinary tests from ``low`` to ``high``."""

    least: float
    low: float
    high: float
    most: float
    unit: str


LIMITS = {
    "frequency": Limit(1e-4, 0.02, 1e5, 1e6, "Hz"),
    "displacement": Limit(1e-14, 1e-10, 0.5, 10.0, "m"),
    "velocity": Limit(1e-12, 1e-9, 10.0, 60.0, "m/s"),
    "acceleration": Limit(1e-9, 1e-6, 1e5, 1e6, "m/s^2"),
    "force": Limit(1e-12, 1e-4, 1e5, 1e8, "N"),
    "mass": Limit(2e-5, 1e-3, 1e6, 1e10, "kg"),
    "stiffness": Limit(1e-6, 1e-3, 1e10, 1e12, "N/m"),
    "damping": Limit(1e-9, 1e-5, 0.2, 0.4, ""),
}
"""Where each bound comes from:

frequency: one period in three hours; above 1 MHz only what is smaller than a grain of sand has modes.
displacement: the best interferometers resolve 1e-14 m; no rig moves a structure by more than 10 m.
velocity: a vibrating solid is stressed by density * speed of sound * velocity, so that the strongest metals
break at some 50 m/s (F. V. Hunt, J. Acoust. Soc. Am. 32, 1960, p. 1123); vibrometers resolve 1e-9 m/s.
acceleration: the quietest ground moves with 1e-9 m/s^2; 100 000 g destroys every sensor.
force: the largest shaking tables bring 1e8 N; below 1e-12 N the thermal force on grams is larger.
mass: a sensor and what carries it weigh more than 20 mg; a dam weighs 1e10 kg.
stiffness: of a steel cube of 1 m it is 2e11 N/m; the softest cantilevers have 1e-6 N/m.
damping: beyond a ratio of 0.4 there is no resonance to identify (the peak is 1.4 times the static response);
below 1e-9 nothing rings, not even quartz at low temperature.
"""

_SMALL = {
    "frequency": Limit(1e-4, 0.02, 1e8, 1e11, "Hz"),
    "displacement": Limit(1e-16, 1e-13, 1e-4, 1e-4, "m"),
    "acceleration": Limit(1e-9, 1e-6, 1e8, np.inf, "m/s^2"),
    "force": Limit(1e-20, 1e-16, 1e5, 1e8, "N"),
    "mass": Limit(1e-25, 1e-18, 1e2, 1e4, "kg"),
    "damping": Limit(1e-10, 1e-8, 0.2, 0.4, ""),
}
"""Bounds of structures that are small and fast; of their acceleration the velocity is the bound."""

_FAST = 1e3
"""Hz: what moves less than ``_FINE`` above this frequency can be as small as a resonator on a chip."""

_FINE = 1e-4
"""m, see ``_FAST``; ultrasonic tools stay below it, too."""


@dataclass(frozen=True, slots=True)
class Sizes:
    """What is compared with the bounds; what is not known is None.

    Parameters
    ----------
    frequency
        Where the displacement is largest [Hz].
    displacement, velocity, acceleration
        Largest amplitudes [m, m/s, m/s^2].
    force
        Largest amplitude [N]; None where it was not recorded in N.
    mass
        Of the mode [kg].
    damping
        Smallest damping ratio of all resonances [1].
    """

    frequency: float
    displacement: float
    velocity: float
    acceleration: float
    force: float
    mass: float | None = None
    damping: float | None = None

    @classmethod
    def of(cls, surface: ResponseSurface, mass: float | None = None, damping: float | None = None) -> Sizes:
        """Sizes of the settled points of a surface, at least one, and of its mode where it is known."""
        rows = _usable(surface)
        amplitude, omega = surface.amplitude[rows], surface.omega[rows]
        return cls(
            float(surface.frequency[rows][np.argmax(amplitude)]),
            float(np.max(amplitude)),
            float(np.max(amplitude * omega)),
            float(np.max(amplitude * omega**2)),
            float(np.max(np.abs(surface.force[rows]))),
            mass,
            damping,
        )

    def values(self) -> dict[str, float]:
        """The known ones by name, and the stiffness m omega^2 [N/m]."""
        known = {name: getattr(self, name) for name in self.__dataclass_fields__}
        if self.mass is not None:
            known["stiffness"] = self.mass * (2 * np.pi * self.frequency) ** 2
        # a sign that is wrong is another matter than a size
        return {name: value for name, value in known.items() if value is not None and value > 0}

    def limits(self) -> Mapping[str, Limit]:
        """Bounds for structures of this kind."""
        return LIMITS | _SMALL if self.frequency > _FAST and self.displacement < _FINE else LIMITS

    def excess(self, *, usual: bool) -> dict[str, float]:
        """How many decades each quantity is above (positive) or below its bounds; only those outside.

        Parameters
        ----------
        usual
            Bounds of ordinary tests; otherwise of what is possible.
        """
        outside = {}
        for name, value in self.values().items():
            limit = self.limits()[name]
            low, high = (limit.low, limit.high) if usual else (limit.least, limit.most)
            if not low <= value <= high:
                outside[name] = float(np.log10(value) - np.log10(high if value > high else low))
        return outside


@dataclass(frozen=True, slots=True)
class Mistake:
    """A usual mistake of unit: the numbers of ``channel`` were read ``factor`` times too large.

    ``order`` -1 or -2: too large by omega to this power, too: another quantity than the one that was read.
    """

    name: str
    channel: Literal["response", "force", "frequency"]
    factor: float
    order: int = 0

    def undo(self, sizes: Sizes) -> Sizes:
        """Sizes without the mistake."""
        if self.channel == "frequency":
            f = self.factor
            mass = None if sizes.mass is None else sizes.mass * f**2
            return replace(
                sizes,
                frequency=sizes.frequency / f,
                velocity=sizes.velocity / f,
                acceleration=sizes.acceleration / f**2,
                mass=mass,
            )
        f = self.factor * (2 * np.pi * sizes.frequency) ** self.order
        if self.channel == "force":
            mass = None if sizes.mass is None else sizes.mass / f
            return replace(sizes, force=sizes.force / f, mass=mass)
        mass = None if sizes.mass is None else sizes.mass * f
        moved = {name: getattr(sizes, name) / f for name in ("displacement", "velocity", "acceleration")}
        return replace(sizes, mass=mass, **moved)


MISTAKES = (
    Mistake("milli", "response", 1e3),
    Mistake("acceleration-as-displacement", "response", 1.0, 2),
    Mistake("velocity-as-displacement", "response", 1.0, 1),
    Mistake("displacement-as-velocity", "response", 1.0, -1),
    Mistake("displacement-as-acceleration", "response", 1.0, -2),
    Mistake("micro", "response", 1e6),
    Mistake("nano", "response", 1e9),
    Mistake("twice-milli", "response", 1e-3),
    Mistake("twice-micro", "response", 1e-6),
    Mistake("inch", "response", 1 / 0.0254),
    Mistake("g", "response", 1 / 9.80665),
    Mistake("kilonewton", "force", 1e-3),
    Mistake("millinewton", "force", 1e3),
    Mistake("micronewton", "force", 1e6),
    Mistake("pound", "force", 1 / 4.4482216),
    Mistake("kilohertz", "frequency", 1e-3),
    Mistake("millihertz", "frequency", 1e3),
    Mistake("rpm", "frequency", 60.0),
    Mistake("radian", "frequency", 2 * np.pi),
)
"""Usual ones first; what each name means is said by ``rsgen.report.wording``."""

_NAMED = 2
"""At most this many mistakes are named: more are no hint."""


def _usable(surface: ResponseSurface) -> NDArray[np.intp]:
    good = surface.settled & np.isfinite(surface.harmonics[:, 1]) & np.isfinite(surface.force)
    return np.flatnonzero(good & (surface.amplitude > 0) & (np.abs(surface.force) > 0))


def plausibility_findings(
    surface: ResponseSurface,
    *,
    calibrated: bool = True,
    mass: float | None = None,
    damping: float | None = None,
) -> Iterator[Finding]:
    """Find what no vibration test can have: a response of another quantity, or sizes of another unit.

    Parameters
    ----------
    surface
        With at least one settled point; a finding that reading made about its quantity is not repeated.
    calibrated
        False where force or response have no known scale, so that sizes say nothing.
    mass, damping
        As for ``Sizes``, where they are known.
    """
    other = [f for f in surface.findings if f.code in ("another-quantity", "base-misread", "base-scaled")]
    # a force per mass and a motion relative to the base are made of several measured quantities
    if not (other or surface.base):
        yield from (other := list(quantity_findings(surface)))
    if calibrated:
        yield from level_findings(surface)
    # the sizes of another quantity say nothing of units
    if calibrated and not other:
        yield from size_findings(Sizes.of(surface, mass, damping), phase_known=surface.phase_known)


_SETS = (1e-6, 1e-3, 1e3, 1e6)
"""Factors between units of one set: kN and N, N and mN."""

_PROPORTION = 1.5
"""Forces near a resonance are this close to their levels, up to one factor; names of runs are not."""


def level_findings(surface: ResponseSurface) -> Iterator[Finding]:
    """Find forces that are the levels in another unit; one finding or none.

    Levels are names, and often numbers of runs. But where at two levels or more the force is always the level
    times one factor between units, both are the same force, and one of them was read in another unit.
    """
    if surface.response_held or surface.base or surface.per_mass:
        return
    rows = _usable(surface)
    level, force = surface.level[rows], np.abs(surface.force[rows])
    levels = np.unique(level[level > 0])
    typical = np.array([np.median(force[level == one]) for one in levels])
    for factor in _SETS:
        off = np.abs(np.log(typical / levels / factor))
        if len(levels) > 1 and np.max(off) < np.log(_PROPORTION):
            numbers = {
                "level": Quantity(float(levels[-1]), surface.level_unit),
                "force": Quantity(float(typical[-1]), surface.level_unit),
            }
            yield Finding("levels-in-other-unit", "doubt", "", numbers)


def size_findings(sizes: Sizes, *, phase_known: bool = False) -> Iterator[Finding]:
    """Find sizes outside what a vibration test can have; one finding or none.

    The one that is farthest outside is reported, with the names of the others and the usual mistakes of unit
    that would bring all of them into the ordinary range. Doubt where a size is impossible, information where
    it is only unusual.

    Parameters
    ----------
    phase_known
        True where the phases say that the response is no other quantity than the one it was read as.
    """
    outside = sizes.excess(usual=False)
    usual = not outside
    outside = outside or sizes.excess(usual=True)
    if not outside:
        return
    worst, *others = sorted(outside, key=lambda name: -abs(outside[name]))
    limit, above = sizes.limits()[worst], outside[worst] > 0
    bound = {
        (False, True): limit.most, (False, False): limit.least,
        (True, True): limit.high, (True, False): limit.low,
    }[usual, above]  # fmt: skip
    numbers = {"value": Quantity(sizes.values()[worst], limit.unit), "bound": Quantity(bound, limit.unit)}
    likely = [
        mistake.name
        for mistake in MISTAKES
        if not (phase_known and mistake.order) and not mistake.undo(sizes).excess(usual=True)
    ]
    names = {
        "quantity": worst,
        "side": "above" if above else "below",
        "others": ", ".join(others),
        # what is possible needs no explanation
        "mistake": "" if usual else ", ".join(likely[:_NAMED]),
    }
    yield Finding(
        "size-unusual" if usual else "size-impossible", "info" if usual else "doubt", "", numbers, names
    )


_RADIAN = 180 / np.pi
"""So much too small is a phase in radians that was read in degrees."""


def quantity_findings(surface: ResponseSurface, quantity: str | None = None) -> Iterator[Finding]:
    """Find a response that is another quantity than the one it was read as; one finding or none.

    Each derivative turns the phase by 90 degrees. Any law obeys F/X = k(X) - m omega^2 + i omega c(X) with
    positive m, k, c at one harmonic. Fitted to the response as it is, and to what it would be as a derivative
    or integral of the displacement or with its phase in radians, the right one fits by far best.

    Parameters
    ----------
    surface
        Any; without phases or with few points nothing is found.
    quantity
        What the response was read as; None where nobody said.
    """
    rows = driven_points(surface)
    powers = powers_for(len(rows), mass=True)
    if not surface.phase_known or not powers:
        return
    force, response, omega = surface.force[rows], surface.harmonics[rows, 1], surface.omega[rows]
    as_read = DERIVATIVE.get(quantity or "")
    orders = (
        (-2, -1, 1, 2) if as_read is None else (order - as_read for order in range(3) if order != as_read)
    )
    others: dict[str, ComplexArray] = {}
    for order in orders:
        name = f"{order:+d}" if as_read is None else tuple(QUANTITIES)[as_read + order]
        others[name] = response / (1j * omega) ** order
    lead = np.angle(response / force)
    if np.max(np.abs(lead)) < 2 * np.pi / _RADIAN:
        others["radian"] = force * np.abs(response / force) * np.exp(1j * _RADIAN * lead)
    weight = 1 / np.abs(force)

    def fit(motion: ComplexArray) -> tuple[float, tuple[bool, ...]]:
        left, values = fit_any_law(force, motion, omega, powers, weight, mass=True)
        return float(np.linalg.norm(left) / np.sqrt(len(force))), tuple(value > 0 for value in values)

    fits = {name: fit(other) for name, other in others.items()}
    misfit, signs = fit(response)
    sound = {name: left for name, (left, positive) in fits.items() if all(positive)}
    best = min(sound, key=lambda name: sound[name], default=None)
    share = BETTER if any(signs) else AS_GOOD
    if best is None or misfit < FITS or sound[best] > share * misfit:
        return
    names = {"read": quantity or "", "is": best, "sure": "yes" if sound[best] < BETTER * misfit else "no"}
    numbers = {"misfit": Quantity(misfit), "then": Quantity(sound[best])}
    yield Finding("another-quantity", "doubt", "", numbers, names)
