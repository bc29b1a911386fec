"""Whether a test and its mode have sizes that a vibration test can have, and which mistake explains others.

The bounds are wide on purpose: outside them nothing has been tested, whatever the structure. Small and fast
structures (resonators on a chip, wires, ultrasonic tools) have bounds of their own, for a mass of a microgram
is theirs and at 30 Hz nobody's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import nan
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.finding import Finding, Quantity
from rsgen.data.free_mode import fit_powers
from rsgen.data.surface.columns import DERIVATIVE, QUANTITIES
from rsgen.data.surface.response_surface import ResponseSurface

# ----------------------------------------------------------------------------
# The law that any law resembles at one harmonic, fitted to a test before one is chosen.
#
#     F/X = k(X) - m omega^2 + i omega c(X)
#
# with k and c sums of a few powers of the amplitude and positive m, k, c. A reading that is mistaken breaks
# this equation, and undoing the mistake mends it.

FITS = 0.05
"""Below this misfit, relative, what was read fits; of a mistake a fifth or a quarter is left."""

BETTER = 0.5
"""Undoing a mistake must leave at most this share of the misfit: noise and a law that is missed stay; of
measured tests other quantities leave 0.98 and more."""

AS_GOOD = 1.1
"""Where as it was read m, k or c is negative, so that it cannot be right, as good is good enough."""

_TERMS = 4
"""Powers of the amplitude in k(X) and c(X)."""

_POINTS_A_TERM = 3
"""Points for each of the values fitted, so that a fit can disagree."""

_FAINT = 1e-6
"""Forces, responses and frequencies below this share of the largest are none: instruments resolve no less."""


def driven_points(surface: ResponseSurface) -> NDArray[np.intp]:
    """Find the points at which there is a force, a response to it, and the phase between them."""
    recorded = np.stack([surface.force, surface.harmonics[:, 1], surface.phase])
    good = surface.settled & np.isfinite(recorded).all(axis=0)
    for values in (surface.force, surface.harmonics[:, 1], surface.omega):
        size = np.where(good, np.abs(values), 0.0)
        good = good & (size > max(_FAINT * size.max(initial=0.0), np.finfo(float).tiny))
    return np.flatnonzero(good)


def powers_for(points: int, *, mass: bool) -> range:
    """Powers of the amplitude that so many points determine, beside a mass or without; none of too few."""
    return range(min(_TERMS, (points // _POINTS_A_TERM - mass) // 2))


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
    """What is compared with the bounds; what is not known is NaN.

    Parameters
    ----------
    frequency
        Where the displacement is largest [Hz].
    displacement, velocity, acceleration
        Largest amplitudes [m, m/s, m/s^2].
    force
        Largest amplitude [N]; NaN where it was not recorded in N.
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
    mass: float = nan
    damping: float = nan

    @classmethod
    def of(cls, surface: ResponseSurface, mass: float = nan, damping: float = nan) -> Sizes:
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
        known["stiffness"] = self.mass * (2 * np.pi * self.frequency) ** 2
        # a sign that is wrong is another matter than a size
        return {name: value for name, value in known.items() if value > 0}

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
            return replace(
                sizes,
                frequency=sizes.frequency / f,
                velocity=sizes.velocity / f,
                acceleration=sizes.acceleration / f**2,
                mass=sizes.mass * f**2,
            )
        f = self.factor * (2 * np.pi * sizes.frequency) ** self.order
        if self.channel == "force":
            return replace(sizes, force=sizes.force / f, mass=sizes.mass / f)
        moved = {name: getattr(sizes, name) / f for name in ("displacement", "velocity", "acceleration")}
        return replace(sizes, mass=sizes.mass * f, **moved)


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
    mass: float = nan,
    damping: float = nan,
) -> Iterator[Finding]:
    """Find what no vibration test can have: a response of another quantity, or sizes of another unit.

    Parameters
    ----------
    surface
        With at least one settled point; a finding that reading made about its quantity is not repeated.
    calibrated
        False where force or response have no known scale, so that sizes say nothing.
    mass, damping
        As for ``Sizes``.
    """
    other = [f for f in surface.findings if f.code in ("another-quantity", "base-misread")]
    # a force per mass and a motion relative to the base are made of several measured quantities
    if not (other or surface.base):
        yield from (other := list(quantity_findings(surface)))
    if calibrated:
        yield from level_findings(surface)
    # the sizes of another quantity say nothing of units
    if calibrated and not other:
        sure = len(driven_points(surface)) > 0
        yield from size_findings(Sizes.of(surface, mass, damping), quantity_sure=sure)


_SETS = (1e-6, 1e-3, 1e3, 1e6)
"""Factors between units of one set: kN and N, N and mN."""

_PROPORTION = 1.5
"""Forces near a resonance are this close to their levels, up to one factor; names of runs are not."""


def level_findings(surface: ResponseSurface) -> Iterator[Finding]:
    """Find forces that are the levels in another unit; one finding or none.

    Levels are names, and often numbers of runs. But where at two levels or more the force is always the level
    times one factor between units, both are the same force, and one of them was read in another unit.
    """
    if surface.level_unit != "N":
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


def size_findings(sizes: Sizes, *, quantity_sure: bool = False) -> Iterator[Finding]:
    """Find sizes outside what a vibration test can have; one finding or none.

    The one that is farthest outside is reported, with the names of the others and the usual mistakes of unit
    that would bring all of them into the ordinary range.

    Parameters
    ----------
    quantity_sure
        True where phases say that the response is no other quantity than the one it was read as.
    """
    outside = sizes.excess(usual=False)
    if not outside:
        return
    worst, *others = sorted(outside, key=lambda name: -abs(outside[name]))
    limit, above = sizes.limits()[worst], outside[worst] > 0
    bound = limit.most if above else limit.least
    numbers = {"value": Quantity(sizes.values()[worst], limit.unit), "bound": Quantity(bound, limit.unit)}
    likely = [
        mistake.name
        for mistake in MISTAKES
        if not (quantity_sure and mistake.order) and not mistake.undo(sizes).excess(usual=True)
    ]
    names = {
        "quantity": worst,
        "side": "above" if above else "below",
        "others": ", ".join(others),
        "mistake": ", ".join(likely[:_NAMED]),
    }
    yield Finding("size-impossible", "doubt", "", numbers, names)


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
        Any; without phases or with few points nothing is found, nor of a free decay, whose forces are made
        of the motion.
    quantity
        What the response was read as; None where nobody said.
    """
    rows = driven_points(surface)
    powers = powers_for(len(rows), mass=True)
    if not powers or surface.decays:
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

    def fit(motion: ComplexArray) -> tuple[float, tuple[bool, bool, bool]]:
        found = fit_powers(force, motion, omega, powers, weight)
        return found.misfit, found.passive

    misfit, signs = fit(response)
    if misfit < FITS:
        return
    fits = {name: fit(other) for name, other in others.items()}
    sound = {name: left for name, (left, positive) in fits.items() if all(positive)}
    best = min(sound, key=lambda name: sound[name], default=None)
    share = BETTER if any(signs) else AS_GOOD
    if best is None or sound[best] > share * misfit:
        return
    names = {"read": quantity or "", "is": best, "sure": "yes" if sound[best] < BETTER * misfit else "no"}
    numbers = {"misfit": Quantity(misfit), "then": Quantity(sound[best])}
    yield Finding("another-quantity", "doubt", "", numbers, names)


# ----------------------------------------------------------------------------
# Whether the two channels of a driven base are what they were read as.
#
# Per unit mass a structure on a driven base weighs 1, whatever its law: with z = x - x_b
#
#     -a_b = k(X) z - omega^2 z + i omega c(X) z,     k, c positive.
#
# A channel read in the other sense of its phase, with the other sign, in place of the other one, or as motion
# relative to the base where it is the absolute one breaks that equation, and undoing the mistake mends it.
# So does a channel whose unit or factor is another one than was read.

_SCALES = {
    "gravity": 9.80665,
    "milli": 1000.0,
    "both": 9806.65,
    "rms": 2**0.5,
    "peak-to-peak": 2.0,
}
"""What a channel is too large or too small by where g, thousandths, root mean squares or peaks to peaks were
read as something else: the mistakes that laboratories make; others have no name."""

_OF_UNITS = 3
"""The first of these factors are of units, which go with another quantity: a root mean square does not."""


def base_findings(surface: ResponseSurface, *, absolute: bool, senses: bool) -> tuple[Finding, ...]:
    """Find the mistake in reading a driven base that explains the test better than what was read; or none.

    Parameters
    ----------
    surface
        Of a driven base, with phases: force per mass minus the acceleration of the base, response relative.
    absolute
        Whether the response was read as absolute motion.
    senses
        Whether phases were read in a sense, as of tables; those of time histories have none.
    """
    rows = driven_points(surface)
    powers = powers_for(len(rows), mass=False)
    if not powers:
        return ()
    omega = surface.omega[rows]
    base = surface.force[rows] / omega**2
    seen = surface.harmonics[rows, 1] + (base if absolute else 0)
    misfit, positive = _fit(base, seen, omega, absolute, powers)
    if positive and misfit < FITS:
        return ()
    mistakes = {
        "sign": (base, -seen, absolute),
        "swapped": (seen, base, absolute),
        "reference": (base, seen, not absolute),
    }
    if senses:
        mistakes = {
            "sense-response": (base, np.conj(seen), absolute),
            "sense-base": (np.conj(base), seen, absolute),
            "sense-both": (np.conj(base), np.conj(seen), absolute),
        } | mistakes
    fits = {name: _fit(*motions[:2], omega, motions[2], powers) for name, motions in mistakes.items()}
    sound = {name: left for name, (left, fine) in fits.items() if fine and left < FITS}
    best = min(sound, key=lambda name: sound[name], default="")
    scaled = _scaled(base, seen, omega, absolute, powers)
    if scaled:
        still, moved, against = mistakes.get(best, (base, seen, absolute))
        of_law, _ = _fit(still, moved, omega, against, powers, of_law=True)
        if scaled[0]["then"] < BETTER * of_law:
            return scaled
    if not best or sound[best] > (BETTER if positive else AS_GOOD) * misfit:
        return ()
    # without phase of its own the base says nothing of a sense: the first mistake that serves is taken
    best = next(name for name in sound if sound[name] < AS_GOOD * sound[best])
    numbers = {"misfit": Quantity(misfit), "then": Quantity(sound[best])}
    names = {"is": best, "response": "relative" if absolute else "absolute"}
    return (Finding("base-misread", "error", "", numbers, names),)


def _scaled(
    base: ComplexArray, seen: ComplexArray, omega: Array, absolute: bool, powers: range
) -> tuple[Finding, ...]:
    """Find a factor of one channel against the other that leaves a law of any kind; or none.

    Misfits are relative to the force of the law: of a response that is far too small next to nothing is left
    of it, and beside the inertia of the base any law would fit.
    """
    misfit, _ = _fit(base, seen, omega, absolute, powers, of_law=True)
    factors = [(name, by**sign, 0) for name, by in _SCALES.items() for sign in (1, -1)]
    factors += [
        ("quantity", by, order)
        for order in (-2, -1, 1, 2)
        for by in (1.0, *(scale**sign for scale in list(_SCALES.values())[:_OF_UNITS] for sign in (1, -1)))
    ]
    fits = [
        _fit(base, by * (1j * omega) ** order * seen, omega, absolute, powers, of_law=True)
        for _, by, order in factors
    ]
    limit = min(FITS, BETTER * misfit)
    sound = [
        (left, *factor) for (left, fine), factor in zip(fits, factors, strict=True) if fine and left < limit
    ]
    if not sound:
        return ()
    then, name, by, order = min(sound)
    numbers = {"misfit": Quantity(misfit), "then": Quantity(then), "by": Quantity(by)}
    numbers |= {"order": Quantity(order)} if order else {}
    return (Finding("base-misread", "error", "", numbers, {"is": name}),)


def _fit(
    base: ComplexArray,
    seen: ComplexArray,
    omega: Array,
    absolute: bool,
    powers: range,
    *,
    of_law: bool = False,
) -> tuple[float, bool]:
    """Relative misfit of a law of any kind on a mass of 1, and whether its typical k and c are positive."""
    response = seen - base if absolute else seen
    if not np.abs(response).max() > 0:
        return np.inf, False
    force, inertia = omega**2 * base, -(omega**2) * response
    size = np.abs(force - inertia) if of_law else np.abs(force) + np.abs(inertia)
    if not (size > 0).all():
        return np.inf, False
    found = fit_powers(force, response, omega, powers, 1 / size, mass=1.0)
    return found.misfit, all(found.passive)
