"""Findings about sizes that no vibration test has, channels read as another quantity or in another unit, and
the lag of a phase-locked test.

The ranges of sizes are wide: outside them no structure has been tested. Small and fast structures
(resonators on a chip, wires, ultrasonic tools) have ranges of their own: a microgram occurs among them.

Channels are checked by the equation that every law obeys at one harmonic,

    F/X = k(X) - m omega^2 + i omega c(X),

with k and c sums of a few powers of the amplitude and positive m, k, c. A channel that is misread breaks this
equation, and reading it rightly mends it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import product
from math import nan, pi

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.finding import Finding, Quantity, Severity, quantities
from rsgen.common.tolerances import (
    MIN_MISFIT_REDUCTION,
    MISFIT_EXPLAINED,
    RELATIVE_CHANGE_NEGLIGIBLE,
    RELATIVE_ERROR_DOUBTFUL,
)
from rsgen.data.free_mode import fit_powers
from rsgen.data.record_set import (
    DERIVATIVE,
    LEVEL_TOLERANCE,
    QUANTITIES,
    copied_levels,
    misnamed_levels,
)
from rsgen.data.surface.columns import levels_in_noise, responses_of_others
from rsgen.data.surface.response_surface import ResponseSurface, control_findings, typical_amounts

_MAX_MISFIT_RATIO = 1 - MIN_MISFIT_REDUCTION
"""Of the right reading to another one: noise and a wrong law leave the rest of the misfit. In measured tests
other quantities leave 0.98 or more."""

_MAX_MISFIT_RATIO_IMPASSIVE = 1.1
"""The same where m, k or c of the other reading is negative: it is wrong, and an equal misfit is enough."""

_OTHER_SENSE = ", conjugated"
_MAX_POWERS = 4
_MIN_POINTS_PER_COEFFICIENT = 3
_MIN_RELATIVE_SIZE = 1e-6
"""Of forces, responses and frequencies, to the largest: no instrument resolves less."""


def driven_points(surface: ResponseSurface) -> NDArray[np.intp]:
    """Return the settled points with a force, a response to it beyond noise, and the phase between them."""
    recorded = np.stack([surface.force, surface.harmonics[:, 1], surface.phase])
    good = surface.settled & np.isfinite(recorded).all(axis=0)
    for values in (surface.force, surface.harmonics[:, 1], surface.omega):
        size = np.where(good, np.abs(values), 0.0)
        good = good & (size > max(_MIN_RELATIVE_SIZE * size.max(initial=0.0), np.finfo(float).tiny))
    test = surface.select(rows := np.flatnonzero(good))
    response = test.harmonics[:, 1]
    return rows[~levels_in_noise(test.level, test.sweep, test.frequency, response / test.force)]


def powers_for(points: int, *, mass: bool) -> range:
    """Return the powers of the amplitude that so many points determine, with a mass or without."""
    return range(min(_MAX_POWERS, (points // _MIN_POINTS_PER_COEFFICIENT - mass) // 2))


@dataclass(frozen=True, slots=True)
class PhysicalRange:
    """Smallest and largest value that a quantity can have, in its unit."""

    low: float
    high: float
    unit: str


RANGES = {
    "frequency": PhysicalRange(1e-4, 1e6, "Hz"),
    "displacement": PhysicalRange(1e-14, 10.0, "m"),
    "velocity": PhysicalRange(1e-12, 60.0, "m/s"),
    "acceleration": PhysicalRange(1e-9, 1e6, "m/s^2"),
    "force": PhysicalRange(1e-12, 1e8, "N"),
    "mass": PhysicalRange(2e-5, 1e10, "kg"),
    "stiffness": PhysicalRange(1e-6, 1e12, "N/m"),
    "damping": PhysicalRange(1e-9, 0.4, ""),
}
"""Sources of the ranges:

frequency: one period in three hours; above 1 MHz only structures below the size of a grain of sand have
modes. displacement: the best interferometers resolve 1e-14 m; no rig moves a structure by more than 10 m.
velocity: a vibrating solid is stressed by density * speed of sound * velocity, so that the strongest metals
break at some 50 m/s (F. V. Hunt, J. Acoust. Soc. Am. 32, 1960, p. 1123). acceleration: the quietest ground
moves with 1e-9 m/s^2; 100 000 g destroys every sensor. force: the largest shaking tables bring 1e8 N; below
1e-12 N the thermal force on grams is larger. mass: a sensor and its mount weigh more than 20 mg; a dam
weighs 1e10 kg. stiffness: of a steel cube of 1 m it is 2e11 N/m; the softest cantilevers have 1e-6 N/m.
damping: beyond a ratio of 0.4 there is no resonance to identify (the peak is 1.4 times the static
response); below 1e-9 nothing rings, not even quartz at low temperature. """

_SMALL_STRUCTURES = {
    "frequency": PhysicalRange(1e-4, 1e11, "Hz"),
    "displacement": PhysicalRange(1e-16, 1e-4, "m"),
    "acceleration": PhysicalRange(1e-9, np.inf, "m/s^2"),
    "force": PhysicalRange(1e-20, 1e8, "N"),
    "mass": PhysicalRange(1e-25, 1e4, "kg"),
    "damping": PhysicalRange(1e-10, 0.4, ""),
}
"""Ranges of structures that are small and fast; their velocity limits their acceleration."""

_MIN_FREQUENCY_SMALL = 1e3
"""Hz; above it a structure that moves less than 0.1 mm can be as small as a resonator on a chip."""


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes of a test and its mode; NaN where unknown.

    Parameters
    ----------
    frequency
        Of the largest displacement [Hz].
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
        """Return the sizes of the settled points of a surface, at least one, and of its mode where known."""
        rows = usable_points(surface)
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


def usable_points(surface: ResponseSurface, *, at_rest: bool = False) -> NDArray[np.intp]:
    """Return the settled points with a force and a response to it, or also those that do not move."""
    good = surface.settled & np.isfinite(surface.harmonics[:, 1]) & np.isfinite(surface.force)
    return np.flatnonzero(good & ((surface.amplitude > 0) | at_rest) & (np.abs(surface.force) > 0))


def plausibility_findings(
    surface: ResponseSurface,
    *,
    calibrated: bool = True,
    mass: float = nan,
    damping: float = nan,
) -> Iterator[Finding]:
    """Return findings about a response of another quantity, or sizes of another unit.

    Parameters
    ----------
    surface
        With at least one settled point; a finding that reading made about its quantity is not repeated.
    calibrated
        False where force or response have no known scale, so that sizes say nothing.
    mass, damping
        As for ``Sizes``.
    """
    yield from copied_levels(surface)
    other = [f for f in surface.findings if f.code in ("another-quantity", "base-misread")]
    # a force per mass and a motion relative to the base are made of several measured quantities
    if not (other or surface.base):
        yield from (other := list(quantity_findings(surface)))
    if calibrated:
        yield from level_findings(surface)
    # the sizes of another quantity say nothing of units
    if calibrated and not other:
        yield from size_findings(Sizes.of(surface, mass, damping))


def level_findings(surface: ResponseSurface) -> Iterator[Finding]:
    """Return a finding if forces are the levels in another unit, in another order, or not of their responses.

    Where at two levels or more the force, or the held amplitude, is the level times one factor, one has
    another unit or gain; where it is another at the fewer levels, these are wrong. A shaker loses force
    smoothly: where neighbours differ and levels do not, the columns do not belong together."""
    held, unit = surface.response_held, surface.level_unit
    said = {finding.code for finding in surface.findings}
    if surface.decays or "response-not-held" in said:
        return
    if (other := control_findings(surface)) or not (held or unit == "N"):
        yield from other
        return
    level, size = surface.level[rows := usable_points(surface)], surface.amplitude[rows]
    force, levels = size if held else np.abs(surface.force[rows]), np.unique(level[level > 0])
    typical = np.array([np.median(force[level == one]) for one in levels])
    names = {"by": "amplitude"} if held else {}
    if not held:
        yield from misnamed_levels(levels, typical, surface.findings)
    yield from _levels_in_other_unit(surface.select(rows[level > 0]), force[level > 0], names)
    order = np.lexsort((surface.frequency[rows], surface.sweep[rows], level))
    size, level, sweep = np.log(force[order]), level[order], surface.sweep[rows][order]
    step = np.abs(np.diff(size))[(level[1:] == level[:-1]) & (sweep[1:] == sweep[:-1])]
    means = [float(np.mean(size[level == one])) for one in levels]
    several, by_force = len(levels) > 1, surface.control == "force"  # loops have motions no force holds
    distinct = np.ptp(means) > np.log(LEVEL_TOLERANCE) if several else not by_force
    # the force of one level may bend near the resonance, not jump back and forth
    step = step if several else np.abs(np.diff(size, 2))
    if not distinct and len(step) and np.quantile(step, 0.75) > np.log(LEVEL_TOLERANCE):
        ends = np.exp(np.quantile(size[level == levels[-1]], [0.1, 0.9]))
        numbers = quantities(unit, level=levels[-1], low=ends[0], high=ends[1])
        yield Finding("levels-disagree", "doubt", "", numbers, names | ({} if several else {"one": "yes"}))
    close = several and np.median(np.diff(levels) / levels[1:]) < RELATIVE_CHANGE_NEGLIGIBLE
    if 1 < len(levels) == len(rows) and (by_force or close):
        yield Finding("levels-disagree", "warning", "", quantities(points=len(rows)), names)
    if by_force and not any(one.names.get("rows") == "columns" for one in surface.findings):
        test = surface.select(usable_points(surface, at_rest=True))
        columns = test.level, test.sweep, test.frequency, test.force, test.harmonics[:, 1]
        yield from responses_of_others(*columns, COMMON_FACTORS)


def _levels_in_other_unit(surface: ResponseSurface, force: Array, names: dict[str, str]) -> Iterator[Finding]:
    """Return a finding if forces (n,) or held amplitudes far from the resonance are levels times one factor.

    Shakers lose force near a resonance: a level within what it has there, or near that, is right.
    """
    if len(levels := surface.levels) < 2:
        return
    ends = [np.quantile(force[surface.level == one], [0.1, 0.9]) for one in levels]
    measured = np.column_stack([typical_amounts(surface), ends]).T
    least = np.log(np.clip(levels, measured.min(axis=0), measured.max(axis=0)) / levels)
    off = np.log(measured[2] / levels)
    # levels that have their names from forces near the resonance are in one proportion to these
    unlike = np.ptp(np.log(measured[0] / levels)) > 2 * RELATIVE_ERROR_DOUBTFUL
    if not (unlike or np.any(np.abs(least) > MIN_MISFIT_REDUCTION * np.abs(off))):
        return
    factors = {name: COMMON_FACTORS[name] for name in ("rms", "peak-to-peak")}
    kinds = [nearest_factor(float(times), factors) for times in np.exp(off)]
    near, tolerance = kinds[0] if kinds.count(kinds[0]) == len(kinds) else {}, np.log(LEVEL_TOLERANCE)
    if np.ptp(off) > tolerance or not (near or np.min(np.abs(off)) > tolerance):
        return
    thousands = np.rint(np.median(off) / np.log(1000)) * np.log(1000)
    kilo = thousands and np.max(np.abs(off - thousands)) < tolerance
    numbers = quantities(surface.level_unit, level=levels[-1], force=measured[2, -1])
    numbers["ratio"] = Quantity(float(np.exp(off[-1])))
    yield Finding("levels-in-other-unit", "doubt" if kilo or near else "warning", "", numbers, names | near)


def size_findings(sizes: Sizes) -> Iterator[Finding]:
    """Return a finding about the size farthest outside the range of vibration tests, if there is one.

    The stiffness is m omega^2 [N/m].
    """
    stiffness = sizes.mass * (2 * np.pi * sizes.frequency) ** 2
    known = {name: value for name, value in (asdict(sizes) | {"stiffness": stiffness}).items() if value > 0}
    small = sizes.displacement < _SMALL_STRUCTURES["displacement"].high
    ranges = RANGES | _SMALL_STRUCTURES if small and sizes.frequency > _MIN_FREQUENCY_SMALL else RANGES
    nearest = {name: min(max(value, ranges[name].low), ranges[name].high) for name, value in known.items()}
    outside = [name for name, value in known.items() if value != nearest[name]]
    if not outside:
        return
    worst, *others = sorted(outside, key=lambda name: -abs(np.log10(known[name] / nearest[name])))
    value, bound, unit = known[worst], nearest[worst], ranges[worst].unit
    numbers = {"value": Quantity(value, unit), "bound": Quantity(bound, unit)}
    names = {"quantity": worst, "side": "above" if value > bound else "below", "others": ", ".join(others)}
    yield Finding("size-impossible", "doubt", "", numbers, names)


def quantity_findings(surface: ResponseSurface, quantity: str | None = None) -> Iterator[Finding]:
    """Return a finding if the response is another quantity than the one it was read as.

    Each derivative turns the phase by 90 degrees, so that the equation above fits the right quantity by far
    best: the response as it is, per force, with its phase in radians, as a derivative or an integral.

    Parameters
    ----------
    surface
        Without phases, with few points, and of a free decay, whose forces are computed from the motion,
        nothing is found.
    quantity
        The quantity that the response was read as; None where the case does not say.
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
    phase = np.degrees(np.angle(response / force))
    for sense, turned in {"": response, _OTHER_SENSE: force * np.conj(response / force)}.items():
        for order in orders:
            name = f"{order:+d}" if as_read is None else tuple(QUANTITIES)[as_read + order]
            others[name + sense] = turned / (1j * omega) ** order
        if np.max(np.abs(phase)) < 2 * np.pi:
            # numbers that are radians
            angle = -phase if sense else phase
            others["radian" + sense] = force * np.abs(response / force) * np.exp(1j * angle)
    others["per-force"] = response * force

    def fit(motion: ComplexArray) -> tuple[float, tuple[bool, bool, bool]]:
        found = fit_powers(force, motion, omega, powers, 1 / np.abs(force))
        return found.misfit, found.passive

    misfit, signs = fit(response)
    if misfit < MISFIT_EXPLAINED:
        return
    fits = {name: fit(other) for name, other in others.items()}
    passive = {name: misfit for name, (misfit, signs) in fits.items() if all(signs)}
    best = min(passive, key=lambda name: passive[name], default=None)
    ratio = _MAX_MISFIT_RATIO if any(signs) else _MAX_MISFIT_RATIO_IMPASSIVE
    # what leaves most of the force is no better explanation, however wrong the reading is
    if best is None or passive[best] > min(ratio * misfit, _MAX_MISFIT_RATIO):
        return
    sure = "yes" if passive[best] < _MAX_MISFIT_RATIO * misfit else "no"
    if best == "per-force":
        # one level in another unit may leave as much, or less; of three levels or more it is said as such
        level, least = surface.level[rows], np.inf
        for one, by, sign in product(levels := np.unique(level), COMMON_FACTORS.values(), (1, -1)):
            left, positive = fit(np.where(level == one, by**sign, 1.0) * response)
            least = min(least, left) if all(positive) else least
        if len(levels) > 2 and least < _MAX_MISFIT_RATIO * passive[best]:
            return
        sure = "level" if least < _MAX_MISFIT_RATIO_IMPASSIVE * passive[best] else sure
    names = {"read": quantity or "", "is": best.removesuffix(_OTHER_SENSE), "sure": sure}
    names |= {"sense": "other"} if best.endswith(_OTHER_SENSE) else {}
    yield Finding("another-quantity", "doubt", "", quantities(misfit=misfit, then=passive[best]), names)


# ----------------------------------------------------------------------------
# The two channels of a driven base.
#
# Per unit mass a structure on a driven base has the mass 1 with any law: with z = x - x_b
#
#     -a_b = k(X) z - omega^2 z + i omega c(X) z,     k, c positive.
#
# A channel read in the other sense of its phase, with the other sign, in place of the other one, as relative
# motion where it is the absolute one, or in another unit, breaks this equation.

_UNIT_FACTORS = {"gravity": 9.80665, "milli": 1000.0, "both": 9806.65}
COMMON_FACTORS = _UNIT_FACTORS | {"rms": 2**0.5, "peak-to-peak": 2.0, "radian": 4 * pi**2}
"""Factors by which a channel is too large or too small if its unit, or the kind of its amplitudes, is
misread; and an acceleration against a displacement, or a mass, if frequencies are."""


def nearest_factor(ratio: float, factors: Mapping[str, float]) -> dict[str, str]:
    """Return the factor that a ratio, or its inverse, nearly is, as the name "near" of a finding, or {}."""
    off = {word: abs(abs(np.log(ratio)) - np.log(by)) for word, by in factors.items() if ratio > 0}
    word = min(off, key=off.__getitem__, default="")
    return {"near": word} if word and off[word] < RELATIVE_ERROR_DOUBTFUL / 2 else {}


_LEAST_MOTION = 0.01
"""Relative motion below which friction may hold the mass, if most points move more."""


def base_findings(surface: ResponseSurface, *, absolute: bool, senses: bool) -> tuple[Finding, ...]:
    """Return a finding if a misreading of a driven base explains the test better than the reading.

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
    # dry friction is a damping over the amplitude
    powers = range(-1, powers_for(len(rows), mass=False).stop)
    if len(powers) < 2:
        return ()
    omega = surface.omega[rows]
    base = surface.force[rows] / omega**2
    response = surface.harmonics[rows, 1] + (base if absolute else 0)
    as_read = (base, response, absolute)
    misfit, passive = _fit(*as_read, omega, powers)
    if passive and misfit < MISFIT_EXPLAINED:
        return ()
    readings = {
        "sign": (base, -response, absolute),
        "swapped": (response, base, absolute),
        "reference": (base, response, not absolute),
    }
    if senses:
        readings = {
            "sense-response": (base, np.conj(response), absolute),
            "sense-base": (np.conj(base), response, absolute),
            "sense-both": (np.conj(base), np.conj(response), absolute),
            **readings,
            # phases, of the response to the base, have columns of their own
            "amplitudes-swapped": (np.conj(response), np.conj(base), absolute),
        }
    fits = {name: _fit(*reading, omega, powers) for name, reading in readings.items()}
    sound = {name: left for name, (left, positive) in fits.items() if positive and left < MISFIT_EXPLAINED}
    # next to the inertia of the base any law fits an exchanged response, which is far too small
    compared = {name: readings[name] for name in sound} or {"": as_read}
    of_law = {name: _fit(*reading, omega, powers, of_law=True)[0] for name, reading in compared.items()}
    least = min(of_law.values())
    scaled = _scale_findings(base, response, omega, absolute, powers)
    if scaled and scaled[0]["then"] < _MAX_MISFIT_RATIO * least:
        return scaled
    # without a phase of its own the base has no sense: the first reading that is as good is taken
    best = next(name for name in of_law if of_law[name] <= _MAX_MISFIT_RATIO_IMPASSIVE * least)
    if not best or sound[best] > (_MAX_MISFIT_RATIO if passive else _MAX_MISFIT_RATIO_IMPASSIVE) * misfit:
        return ()
    numbers = {"misfit": Quantity(misfit), "then": Quantity(sound[best])}
    names = {"is": best, "response": "relative" if absolute else "absolute"}
    if not passive and sound[best] > _MAX_MISFIT_RATIO * misfit:
        names["sign"] = "negative"
    return (Finding("base-misread", "error", "", numbers, names),)


def _scale_findings(
    base: ComplexArray, response: ComplexArray, omega: Array, absolute: bool, powers: range
) -> tuple[Finding, ...]:
    """Return a finding if any law fits with a factor between the two channels.

    Misfits are relative to the force of the law: next to the inertia of the base any law would fit a response
    that is far too small.
    """
    misfit, _ = _fit(base, response, absolute, omega, powers, of_law=True)
    factors = [(name, by**sign, 0) for name, by in COMMON_FACTORS.items() for sign in (1, -1)]
    units = (1.0, *(by**sign for by in _UNIT_FACTORS.values() for sign in (1, -1)))
    factors += [("quantity", by, order) for order in (-2, -1, 1, 2) for by in units]
    limit, sound = _MAX_MISFIT_RATIO * min(misfit, _MAX_MISFIT_RATIO), []
    for name, by, order in factors:
        moved = by * (1j * omega) ** order * response
        left, positive = _fit(base, moved, absolute, omega, powers, of_law=True)
        if positive and left < limit:
            sound.append((left, name, by, order))
    if not sound:
        return ()
    then, name, by, order = min(sound)
    numbers = quantities(misfit=misfit, then=then, by=by) | (quantities(order=order) if order else {})
    return (Finding("base-misread", "error", "", numbers, {"is": name}),)


def _fit(
    base: ComplexArray,
    response: ComplexArray,
    absolute: bool,
    omega: Array,
    powers: range,
    *,
    of_law: bool = False,
) -> tuple[float, bool]:
    """Return the relative misfit of any law on a mass of 1, and whether its typical k and c are positive."""
    motion = response - base if absolute else response
    if not np.abs(motion).max() > 0:
        return np.inf, False
    if np.mean(moves := np.abs(motion) > _LEAST_MOTION * np.abs(motion).max()) > 0.5:
        base, motion, omega = base[moves], motion[moves], omega[moves]
    force, inertia = omega**2 * base, -(omega**2) * motion
    size = np.abs(force - inertia) if of_law else np.abs(force) + np.abs(inertia)
    if not (size > 0).all():
        return np.inf, False
    found = fit_powers(force, motion, omega, powers, 1 / size, mass=1.0)
    return found.misfit, all(found.passive)


# ----------------------------------------------------------------------------
# The lag of a phase-locked test: the error from that of resonance, a quarter period.

MAX_RESONANT_LAG = 0.2
"""Deviation of a lag from a quarter period [rad], 11 degrees, within which a point is at phase resonance and
says nothing of the mass: k - m omega^2 is nearly zero."""

MAX_LAG_ERROR = 0.52
"""30 degrees [rad]: within it of a quarter period a lag is meant to be one, but for an uncorrected delay;
others are slices off resonance."""

_MAX_LAG_SCATTER = 0.07
"""Standard deviation [rad], 4 degrees, of the lags of one loop; the next lag that is set is twice as far."""

_LAG_ERROR_NEGLIGIBLE = 0.02
"""One degree [rad]: the lag error shifts k/m by a thirtieth of the damping ratio."""

_LAG_ERROR_DOUBTFUL = 0.17
"""Ten degrees [rad]: the loop is not locked, and k/m is shifted by a third of the damping ratio."""

_MAX_FORCE_SPREAD = 0.02
"""Relative difference of the forces of one slice off resonance; levels of a backbone differ by more."""

MIN_MODE_SPACING = 0.05
"""Relative distance of the frequencies of two modes; from level to level those of one shift by less."""

_MIN_GAP_RATIO = 5.0
"""Of the gap between two modes to the largest step within either."""

_MIN_POINTS = 3
"""Points of a mode; fewer may be the end of a backbone."""


def lag_findings(surface: ResponseSurface) -> tuple[Finding, ...]:
    """Return findings about the lag of a phase-locked test: its error, and whether it is of one mode.

    None of other tests, and none about the lag where none was recorded.
    """
    if surface.control != "phase":
        return ()
    good = surface.select(surface.settled & np.isfinite(surface.phase) & (surface.amplitude > 0))
    near = np.abs(good.phase - pi / 2) < MAX_LAG_ERROR
    gap = backbone_gap(good.frequency[near], good.amplitude[near])
    several = (*([] if gap is None else [gap]), *_lock_lost(good.phase, np.abs(good.force)))
    return several if surface.lag_assumed else (*several, *_lag(good.phase))


def _lag(lag: Array) -> tuple[Finding, ...]:
    """Return a finding about the lag (n,) [rad] of the points and its error from that of resonance."""
    off = _nearest(lag) - pi / 2
    if not len(off):
        seen = {"lag": Quantity(float(np.median(lag)), "rad")} if len(lag) else {}
        return (Finding("phase-not-resonant", "doubt", numbers=seen),) if len(lag) else ()
    if np.std(off) > _MAX_LAG_SCATTER:
        return ()
    missed = float(np.median(off))
    numbers = {
        "points": Quantity(len(off)),
        "others": Quantity(len(lag) - len(off)),
        "lag": Quantity(pi / 2 + missed, "rad"),
        "scatter": Quantity(float(np.std(off)), "rad"),
        "shift": Quantity(float(2 * abs(np.tan(missed)))),
    }
    severity: Severity = "warning" if abs(missed) < _LAG_ERROR_DOUBTFUL else "doubt"
    severity = "info" if abs(missed) < _LAG_ERROR_NEGLIGIBLE else severity
    return (Finding("phase-lag", severity, numbers=numbers),)


def _lock_lost(lag: Array, force: Array) -> tuple[Finding, ...]:
    """Return a finding about points (n,) whose lag [rad] differs from that of the backbone.

    Points at a force [N] that others have are slices off resonance, and not counted. None where most points
    differ: such a test is no backbone.
    """
    common = _nearest(lag)
    if len(common) <= len(lag) / 2:
        return ()
    low, high = common.min() - 2 * _MAX_LAG_SCATTER, common.max() + 2 * _MAX_LAG_SCATTER
    alone = np.array([np.sum(np.abs(force - one) < _MAX_FORCE_SPREAD * one) == 1 for one in force])
    lost = lag[((lag < low) | (lag > high)) & alone]
    if not len(lost):
        return ()
    ends = {"low": Quantity(float(lost.min()), "rad"), "high": Quantity(float(lost.max()), "rad")}
    numbers = quantities(lost=len(lost), points=len(lag)) | ends
    return (Finding("phase-lock-lost", "warning", numbers=numbers),)


def backbone_gap(frequency: Array, amplitude: Array) -> Finding | None:
    """Find two groups of points at phase resonance (n,), in Hz and m, with nothing between; or None.

    A backbone is continuous, but levels may have been left out: a warning. Where the amplitudes of the groups
    overlap it is a doubt, for one mode has one frequency at an amplitude.
    """
    order = np.argsort(frequency)
    ordered, amplitude = frequency[order], amplitude[order]
    steps = np.diff(np.log(ordered))
    if len(steps) < 2 * _MIN_POINTS - 1:
        return None
    inner = steps[_MIN_POINTS - 1 : len(steps) - _MIN_POINTS + 1]
    at = _MIN_POINTS - 1 + int(np.argmax(inner))
    if not steps[at] > max(MIN_MODE_SPACING, _MIN_GAP_RATIO * float(np.delete(steps, at).max())):
        return None
    low, high = amplitude[: at + 1], amplitude[at + 1 :]
    numbers = quantities("Hz", low=np.median(ordered[: at + 1]), high=np.median(ordered[at + 1 :]))
    if max(low.min(), high.min()) <= min(low.max(), high.max()):
        return Finding("phase-gap", "doubt", numbers=numbers, names={"overlap": "yes"})
    return Finding("phase-gap", "warning", numbers=numbers)


def _nearest(lag: Array) -> Array:
    """Return the lags [rad] of the most frequent setting of a loop near a quarter period; none without one.

    Of equally frequent settings, the nearest is taken.
    """
    groups = np.split(np.sort(lag), np.flatnonzero(np.diff(np.sort(lag)) > 2 * _MAX_LAG_SCATTER) + 1)
    away = [abs(float(np.median(group)) - pi / 2) if len(group) else np.inf for group in groups]
    near = [i for i in range(len(groups)) if away[i] < MAX_LAG_ERROR]
    return groups[min(near, key=lambda i: (-len(groups[i]), away[i]))] if near else lag[:0]
