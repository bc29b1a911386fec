"""Table of test points: its columns, their defaults and checks.

Simulated and measured surfaces have the same columns. Real tests are no grid, so that the table is in long
form; force and response are complex and as measured, never the nominal level.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError, known_arguments, listed, require
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.output import write_atomic
from rsgen.common.text_table import short
from rsgen.common.tolerances import RELATIVE_ERROR_DOUBTFUL, STANDARD_ERRORS_OF_DIFFERENCE
from rsgen.data.record_set import BASE_UNITS, FILE_ROUND_OFF, Records, below_acceleration
from rsgen.data.surface.columns import (
    COLUMN_UNITS,
    CONTROLS,
    SWEEPS,
    across_columns,
    check_numbers,
    column,
    force_columns,
    recognise_directions,
    response_columns,
)

# ----------------------------------------------------------------------------
# Measured amount of each level: the force near the resonance, or the amplitude that was held.

HALF_POWER = 1 / np.sqrt(2)
"""Points of at least this share of the largest amplitude, or whose lag has a sine as large (45 degrees off a
quarter period), are near the resonance: within half power."""


def within_half_power(force: ComplexArray, response: ComplexArray) -> NDArray[np.bool_]:
    """Return True (n,) where a response lags its force by a quarter period, within 45 degrees."""
    stiffness = force / response
    return np.asarray(np.abs(stiffness.imag) > HALF_POWER * np.abs(stiffness))


def force_at_largest(amplitude: Array, force: Array | ComplexArray) -> float:
    """Return the median magnitude of the forces (n,) at the largest motion of a level: of five points there.

    They have the largest X^2/|F|: where the force of a shaker changes along the curve, X alone is largest
    off the resonance, towards a larger force, and X/|F| alone also at smaller motions, with less damping.
    """
    size = np.abs(force)
    near = np.flatnonzero(amplitude >= HALF_POWER * np.max(amplitude))
    near = near[np.argsort((amplitude**2 / size)[near])[-5:]]
    return float(np.median(size[near]))


_MIN_RANGE_IF_FREE = 0.5
"""Relative range, from the 10 to the 90 per cent quantile, of an amount that is not controlled."""


def _largest_range(surface: ResponseSurface, amount: Array) -> tuple[float, float]:
    """Return the largest range of an amount (n,) at one level, over its median, and the level."""
    found = [(0.0, float(surface.levels[0]))]
    for level in surface.levels:
        at = surface.settled & (surface.level == level) & np.isfinite(amount) & (amount > 0)
        if at.any():
            low, middle, high = np.quantile(amount[at], [0.1, 0.5, 0.9])
            found.append((float((high - low) / middle), float(level)))
    return max(found)


def control_findings(surface: ResponseSurface) -> list[Finding]:
    """Find that a response varies that should be held, or was held in place of the drive; none or one."""
    held = surface.control == "response"
    moved, at = _largest_range(surface, surface.amplitude)
    pushed, under = _largest_range(surface, surface.drive)
    if held and moved > _MIN_RANGE_IF_FREE:
        numbers = {"moved": Quantity(moved), "level": Quantity(at, "m")}
        return [Finding("response-not-held", "doubt", numbers=numbers)]
    if surface.control != "force" or pushed < _MIN_RANGE_IF_FREE or moved > RELATIVE_ERROR_DOUBTFUL:
        return []
    numbers = {"moved": Quantity(pushed), "level": Quantity(under, surface.level_unit)}
    names = {"by": "response"} | ({"base": surface.base} if surface.base else {})
    return [Finding("levels-disagree", "doubt", numbers=numbers, names=names)]


def typical_amounts(surface: ResponseSurface, amount: Array | None = None) -> Array:
    """Return the measured amount of each of ``surface.levels``: a force [N], or a controlled amplitude [m].

    The force is the one under the largest motions. NaN where no point of the level settled. ``amount`` (n,)
    replaces the magnitude of the force.
    """
    size, force = surface.amplitude, np.abs(surface.force) if amount is None else amount
    good = surface.settled & np.isfinite(size) & np.isfinite(force) & (force > 0)
    found = np.full(len(surface.levels), np.nan)
    for number, level in enumerate(surface.levels):
        at = np.flatnonzero(good & (surface.level == level))
        if not len(at):
            continue
        held = surface.response_held
        value = float(np.median(size[at])) if held else force_at_largest(size[at], force[at])
        found[number] = level if abs(value - level) <= FILE_ROUND_OFF * abs(level) else value
    return found


def within(surface: ResponseSurface, band: tuple[float, float] | None) -> ResponseSurface:
    """Return the points of a band of frequencies [Hz]; all of None."""
    if band is None:
        return surface
    return surface.select((surface.frequency >= band[0]) & (surface.frequency <= band[1]))


_CONTROLLED = {
    "force": "",
    "response": "response held",
    "phase": "phase-locked",
    "continuation": "continuation",
}
"""Controlled quantity of a test, in the one line that shows a surface."""

_LIMITS = {"not-recorded": "phase not measured", "per-unit-mass": "per unit mass"}
"""Limits of a test by finding, in the same line."""


class Outcome(IntEnum):
    """How a test point ended; the table stores the number, and sentences say the ``text``."""

    text: str

    def __new__(cls, number: int, text: str) -> Self:
        """Make a number with a text."""
        outcome = int.__new__(cls, number)
        outcome._value_, outcome.text = number, text
        return outcome

    SETTLED = 0, "settled: the response repeats with the period of the force"
    UNSETTLED = 1, "not settled: the response still changes after the longest transient allowed"
    PERIOD_TWO = 2, "not settled: the response repeats after two periods of the force, not after one"
    DIVERGED = 3, "not settled: the response grows without bound"
    SWEPT_TOO_FAST = 4, "not settled: the sweep passes faster than the response follows"
    NOT_MEASURED = 5, "not measured: force or response is not a number"
    DROPPED_OUT = 6, "not measured: force or response drops out"
    FORCE_IN_NOISE = 7, "not measured: the force does not stand out of its noise"
    FREE_MOTION = 8, "not settled: the motion is mainly a free one, as after a jump or a fast passage"


def _without_numbers(columns: Mapping[str, Any]) -> tuple[NDArray[np.int64], tuple[Finding, ...]]:
    """Return outcomes (n,) of points by their numbers, and findings about those that were not measured.

    Exactly zero is what a channel gives that was not read.
    """
    moved = np.column_stack([columns["force"], columns["harmonics"][:, 1], columns["across"][:, 1:2]])
    measured, found = np.isfinite(moved).all(axis=1), tuple[Finding, ...]()
    silent = (moved == 0).any(axis=1) & measured
    for by, rows in (("no number", ~measured), ("zero", silent)):
        if rows.any():
            numbers = {"rows": Quantity(int(np.count_nonzero(rows))), "all": Quantity(len(rows))}
            levels = listed([short(level) for level in sorted(set(columns["level"][rows].tolist()))])
            names = {"by": by, "levels": levels}
            found += (Finding("rows-left-out", "warning", numbers=numbers, names=names),)
    return np.where(measured, Outcome.SETTLED, Outcome.NOT_MEASURED), found


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class ResponseSurface(Records):
    """Steady states of a structure over force level and frequency; n test points, H harmonics.

    ``ResponseSurface(level, frequency, force, response)`` is enough. A single value for level, force or any
    later column holds at every point. Amplitudes are peak values: multiply root mean squares, of force and
    response, by sqrt(2). Where both are rms nothing shows it, and k3 of a cubic spring is 2 times too large.

    Parameters
    ----------
    level
        (n,) nominal force amplitude [N], or amplitude of the displacement [m] where that was held constant,
        or of the motion of the ``base``; names the level a point belongs to, never used as the force.
    frequency
        (n,) [Hz], positive.
    force
        (n,) complex amplitude F of the measured force [N], f(t) = Re F exp(i omega t); real where the phases
        are counted from the force; or (n, K+1) harmonics as of the response where they were recorded:
        ``force`` is the fundamental of them, ``force_harmonics`` has all, two columns where no more are
        known.
    response
        (n,) complex fundamental X of the displacement [m], x(t) = Re X exp(i omega t), so that a displacement
        that lags a real force by phi has X = |X| exp(-i phi); or (n, H+1) harmonics.
    harmonics
        (n, H+1) complex displacement [m], x(t) = Re sum_h X_h exp(i h omega t); column 0 is the mean (real).
        Another name of ``response``, and the name of the column.
    peak
        (n, 2) largest and smallest displacement in a period [m]; NaN where only harmonics are known.
    sweep
        (n,) "rest", "up" or "down": how the point was reached. None: from the order of the frequencies within
        each level, "rest" where they are in no order.
    outcome
        (n,) an ``Outcome``; 0 is settled. Unsettled points are never used for identification.
        None: settled, but for rows whose force or response is not finite; these count as not measured. A
        finding says how many they are, and how many are exactly zero, which are not used either.
    residual, error
        (n,) change of the state in a period, relative to the amplitude, and the estimated relative error of
        the amplitude [1]; NaN where unknown.
    origin
        "simulated" or "measured".
    phase_known
        False where the test recorded amplitudes only: ``phase`` is then NaN.
    control
        Quantity that the test held constant within a level: "force", "response", or "phase" (a phase-locked
        loop holds a force and controls the frequency until the response lags by an angle). "continuation":
        points of a control-based continuation, stable or not, whose levels are steps of the amplitude.
    stable
        (n,) False where the state is unstable at constant force; default True.
    findings
        Findings about the numbers, made while reading.
    force_harmonics
        (n, K+1) complex force [N], mean first; see ``force``.
    across
        (n, H+1) complex displacement [m] across the springs and dampers that act between two sensors, where
        it is not the response itself; (n, 0), a motion without columns, where all act on the response.
    per_mass
        True where the force is one per mass [N/kg = m/s^2]; parameters are then per unit mass. None: where a
        base drives.
    base
        "" where a force drives; else "displacement", "velocity" or "acceleration": quantity of the motion of
        a driven base whose amplitudes are the levels. The response is relative to the base, the force per
        mass minus the acceleration of the base.
    label
        (n,) number that names the level of a point in the test, where it is no measured amount; None: the
        levels are their own names. ``hold_out`` takes it.
    overlapping
        True where the points of a level, in order of time, are of windows over a record that overlap, as
        those of sweeps and decays are: their noise is correlated.

    Raises
    ------
    RsgenError
        A shape does not fit, a level or frequency is not finite, a frequency is not positive, a response
        without phases is given as if it had them, a sweep or outcome is unknown.

    Examples
    --------
    >>> surface = ResponseSurface(2.0, [9, 10, 11], 2.0, [1e-3, 2e-3 - 4e-3j, -1e-3 - 1e-4j])
    >>> surface
    ResponseSurface: 3 points, 1 level of 2 N, 9 to 11 Hz, 1 harmonic, measured
    """

    columns: ClassVar = tuple(COLUMN_UNITS)

    level: Array
    frequency: Array
    force: ComplexArray
    harmonics: ComplexArray
    peak: Array
    sweep: NDArray[np.str_]
    outcome: NDArray[np.int8]
    residual: Array
    error: Array
    origin: str
    phase_known: bool
    control: str
    stable: NDArray[np.bool_]
    findings: tuple[Finding, ...]
    force_harmonics: ComplexArray
    across: ComplexArray
    per_mass: bool
    base: str
    label: Array | None
    overlapping: bool

    @known_arguments
    def __init__(
        self,
        level: ArrayLike,
        frequency: ArrayLike,
        force: ArrayLike,
        response: ArrayLike | None = None,
        *,
        harmonics: ArrayLike | None = None,
        peak: ArrayLike | None = None,
        sweep: ArrayLike | None = None,
        outcome: ArrayLike | None = None,
        residual: ArrayLike | None = None,
        error: ArrayLike | None = None,
        origin: str = "measured",
        phase_known: bool = True,
        control: str = "force",
        stable: ArrayLike | None = None,
        findings: tuple[Finding, ...] = (),
        force_harmonics: ArrayLike | None = None,
        across: ArrayLike | None = None,
        per_mass: bool | None = None,
        base: str = "",
        label: ArrayLike | None = None,
        overlapping: bool = False,
    ) -> None:
        n = len(np.atleast_1d(np.asarray(frequency)))
        findings = tuple(findings)
        columns: dict[str, Any] = {
            "frequency": column(frequency, "frequency", (n,)),
            "level": column(level, "level", (n,)),
            **force_columns(force, force_harmonics, n),
            "harmonics": response_columns(response, harmonics, phase_known, n, force),
            "peak": column(np.full((n, 2), np.nan) if peak is None else peak, "peak", (n, 2)),
            "residual": column(np.nan if residual is None else residual, "residual", (n,)),
            "error": column(np.nan if error is None else error, "error", (n,)),
            "stable": column(True if stable is None else stable, "stable", (n,)),
            "label": None if label is None else column(label, "label", (n,)),
        }
        columns["across"] = across_columns(across, columns["harmonics"].shape)
        check_numbers(columns)
        if sweep is None:
            sweep = recognise_directions(columns["frequency"], columns["level"])
        if outcome is None:
            outcome, left_out = _without_numbers(columns)
            findings += left_out
        columns["sweep"] = column(sweep, "sweep", (n,))
        columns["outcome"] = column(outcome, "outcome", (n,))
        words: dict[str, object] = {"origin": origin, "control": control, "findings": findings, "base": base}
        words |= {"phase_known": bool(phase_known), "per_mass": bool(base if per_mass is None else per_mass)}
        words["overlapping"] = bool(overlapping)
        for name, value in (columns | words).items():
            object.__setattr__(self, name, value)
        self._check_words()

    def _check_words(self) -> None:
        if not np.isin(self.sweep, SWEEPS).all():
            raise RsgenError(f"surface.sweep: must be one of {', '.join(SWEEPS)}")
        if len(self) and not ((self.outcome >= 0) & (self.outcome < len(Outcome))).all():
            raise RsgenError(f"surface.outcome: must be 0 to {len(Outcome) - 1}")
        if self.control not in CONTROLS:
            raise RsgenError(f"surface.control: {self.control!r}; must be one of {', '.join(CONTROLS)}")
        if self.origin not in ("simulated", "measured"):
            raise RsgenError(f"surface.origin: {self.origin!r}; must be 'simulated' or 'measured'")
        if self.base not in BASE_UNITS:
            raise RsgenError(
                f"surface.base: {self.base!r}; must be '' where a force drives, or 'displacement', "
                "'velocity' or 'acceleration'"
            )

    @property
    def signals(self) -> Mapping[str, ComplexArray]:
        """Harmonics of force [N], response and motion across [m], (n, K+1) and (n, H+1)."""
        return {"force": self.force_harmonics, "response": self.harmonics, "across": self.across}

    @property
    def omega(self) -> Array:
        """(n,) angular frequency [rad/s]."""
        return 2 * np.pi * self.frequency

    @property
    def amplitude(self) -> Array:
        """(n,) X, amplitude of the fundamental of the displacement [m]."""
        return np.abs(self.harmonics[:, 1])

    @property
    def phase(self) -> Array:
        """(n,) lag of the displacement behind the force [rad], 0 to 2 pi; NaN where not recorded."""
        lag = (np.angle(self.force) - np.angle(self.harmonics[:, 1])) % (2 * np.pi)
        return np.where(self.phase_known, lag, np.nan)

    @property
    def settled(self) -> NDArray[np.bool_]:
        """(n,) True where the response repeats with the period of the force."""
        return np.equal(self.outcome, Outcome.SETTLED)

    @property
    def extent(self) -> dict[str, Any]:
        """Number and range of the points."""
        return {
            # without np.unique, which loads masked arrays
            "levels": len(set(self.level.tolist())),
            "points": len(self),
            "sweeps": sorted(set(map(str, self.sweep))),
            "lowest_frequency": float(self.frequency.min()),
            "highest_frequency": float(self.frequency.max()),
        }

    @property
    def provenance(self) -> dict[str, str]:
        """Name and size, for the provenance of a result."""
        return {"Surface": f"{self.origin}, {len(self)} points"}

    @property
    def response_held(self) -> bool:
        """Return whether levels are amplitudes of the response, and the force is the measured result."""
        return self.control in ("response", "continuation")

    @property
    def lag_assumed(self) -> bool:
        """Return whether a phase-locked test without phases was read with a lag of a quarter period."""
        return any(
            finding.names.get("by") == "assumed" for finding in self.findings if finding.code == "phase-lag"
        )

    @property
    def decays(self) -> bool:
        """Return whether the points are of free decays: forces computed from the motion and the mass."""
        return any(finding.code == "force-of-decay" for finding in self.findings)

    @property
    def drive(self) -> Array:
        """(n,) amplitude of the drive in ``level_unit``: |F|, or of the motion of a base.

        Of a base it follows from the force per mass.
        """
        size = np.abs(self.force)
        if not self.base:
            return size
        return size / self.omega ** below_acceleration(self.base)

    @property
    def answer(self) -> Array:
        """(n,) measured result at the levels: X [m], or |F| in ``force_unit`` where X was held."""
        return np.abs(self.force) if self.response_held else self.amplitude

    @property
    def answer_unit(self) -> str:
        """Unit of ``answer``."""
        return self.force_unit if self.response_held else "m"

    def __repr__(self) -> str:
        """Return size and range in one line."""
        if not len(self):
            return "ResponseSurface: no points"
        levels, unit = self.levels, self.level_unit
        span = f"of {short(levels[0])} {unit}"
        if len(levels) > 1:
            span = f"{short(levels[0])} to {short(levels[-1])} {unit}"
        unsettled = len(self) - int(np.count_nonzero(self.settled))
        count = self.harmonics.shape[1] - 1
        parts = [
            f"{len(self)} point{'s' if len(self) > 1 else ''}",
            f"{unsettled} not settled" if unsettled else "",
            f"{len(levels)} level{'s' if len(levels) > 1 else ''} {span}",
            f"{short(self.frequency.min())} to {short(self.frequency.max())} Hz",
            f"{count} harmonic{'s' if count > 1 else ''}",
            *(_LIMITS[finding.code] for finding in self.limits),
            _CONTROLLED[self.control],
            f"force with {recorded} harmonics" if (recorded := self.force_harmonics.shape[1] - 1) > 1 else "",
            *("motion across" for _ in self.across.T[1:2]),
            f"{self.base} of the base" if self.base else "",
            self.origin,
        ]
        return f"ResponseSurface: {', '.join(part for part in parts if part)}"


# ----------------------------------------------------------------------------
# Copies of rows, which are no second measurement.


def without_copies(surface: ResponseSurface) -> ResponseSurface:
    """Return the surface with one row of each point whose rows are equal; a finding has their number.

    Readings with noise differ, but those of a display with few digits may be equal: a point with readings
    that differ keeps all of them, and a test keeps all rows if readings differ at most repeated points.
    """
    sweep = 1.0 * (surface.sweep == "up") - 1.0 * (surface.sweep == "down")
    order = np.lexsort((surface.frequency, surface.level, sweep))
    point = np.stack([sweep, surface.level, surface.frequency], axis=1)
    if not np.any(np.all(point[order[1:]] == point[order[:-1]], axis=1)):
        return surface
    parts = [np.ascontiguousarray(part).view(np.float64) for part in surface.signals.values()]
    reading = np.concatenate([point, *parts], axis=1)
    good = np.flatnonzero(np.isfinite(reading).all(axis=1))
    _, first, kind = np.unique(reading[good], axis=0, return_index=True, return_inverse=True)
    _, place = np.unique(point[good], axis=0, return_inverse=True)
    repeated, differing = np.bincount(place) > 1, np.bincount(place[first]) > 1
    if 2 * np.count_nonzero(differing) > np.count_nonzero(repeated):
        return surface
    kept = np.ones(len(surface), dtype=np.bool_)
    kept[good] = differing[place] | (first[kind] == np.arange(len(good)))
    if kept.all():
        return surface
    numbers = quantities(rows=int(np.count_nonzero(~kept)), all=len(surface))
    finding = Finding("rows-left-out", "warning", numbers=numbers, names={"by": "copies"})
    return replace(surface.select(kept), findings=(*surface.findings, finding))


# ----------------------------------------------------------------------------
# The offset of a displacement sensor, which shows no zero at rest.

_MAX_MEAN_LEFT = 0.1
"""Share of the mean relative to the amplitudes that a constant leaves, beyond noise, if it is an offset. Of
means that grow like X or X^2 over two octaves it leaves 0.4 and more."""

_MIN_OCTAVES, _MIN_PAIRS = 2, 8
"""Octaves of amplitude over which a mean is to be constant, and pairs of neighbours that show its noise."""


def without_offset(surface: ResponseSurface) -> ResponseSurface:
    """Return the surface without a constant mean, and with a finding about it; the same surface without one.

    An even force makes a mean that grows with the amplitude X; one constant o at all amplitudes is where the
    zero of the sensor lies, unless the law has a place of rest of its own (a preload, two wells), so that a
    fit decides between both. Least squares of (mean - o)/X, in which every
    octave of X counts the same; noise is half the mean square of differences of neighbours.
    """
    mean, size = surface.harmonics[:, 0].real, surface.amplitude
    rows = np.flatnonzero(surface.settled & np.isfinite(mean) & np.isfinite(size) & (size > 0))
    if not mean[rows].any():
        return surface
    mean, size = mean[rows], size[rows]
    octave = np.floor(np.log2(size / size.min())).astype(np.intp)
    share = 1 / np.bincount(octave)[octave]
    weight = share / size**2
    offset = float(np.sum(weight * mean) / np.sum(weight))
    before, left = mean / size, (mean - offset) / size
    level, sweep = surface.level[rows], surface.sweep[rows]
    near = np.flatnonzero((level[1:] == level[:-1]) & (sweep[1:] == sweep[:-1]))
    if octave.max() < _MIN_OCTAVES or len(near) < _MIN_PAIRS:
        return surface
    noise = float(np.average(np.diff(left)[near] ** 2, weights=share[near])) / 2
    constant, other = (float(np.average(part**2, weights=share)) - noise for part in (before, left))
    error = np.sqrt(noise * np.sum((weight * size) ** 2)) / np.sum(weight)
    by_chance = STANDARD_ERRORS_OF_DIFFERENCE * noise * np.sqrt(2 / len(near))
    steady = other <= max(_MAX_MEAN_LEFT**2 * constant, by_chance)
    if not (steady and abs(offset) > STANDARD_ERRORS_OF_DIFFERENCE * error):
        return surface
    finding = Finding("sensor-offset", "info", numbers={"offset": Quantity(offset, "m")})
    harmonics = np.array(surface.harmonics)
    harmonics[:, 0] -= offset
    return replace(
        surface, harmonics=harmonics, peak=surface.peak - offset, findings=(*surface.findings, finding)
    )


# ----------------------------------------------------------------------------
# The file of a surface, which ``rsgen.files.surface_file`` reads.

SURFACE_FORMAT, SURFACE_SCHEMA = "rsgen response surface", 1


def save_surface(path: str | os.PathLike[str], surface: ResponseSurface) -> None:
    """Write a surface as HDF5, atomically; every array carries its unit.

    Complex arrays are HDF5 compounds (r, i), as h5py, MATLAB and Julia read them. ``settled`` is written
    next to ``outcome`` for readers that only need yes or no.

    Raises
    ------
    RsgenError
        The file cannot be written; an earlier one is unchanged.
    """
    import h5py  # 0.1 s, for writing only

    require(surface, ResponseSurface, "surface")
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["format"] = SURFACE_FORMAT
        file.attrs["schema"] = SURFACE_SCHEMA
        for name in ("origin", "phase_known", "control", "per_mass", "base", "overlapping"):
            file.attrs[name] = getattr(surface, name)
        file.attrs["outcomes"] = [outcome.text for outcome in Outcome]
        values = {name: getattr(surface, name) for name in COLUMN_UNITS}
        # columns that the test does not have are None, or have no harmonics
        columns = {k: v for k, v in values.items() if v is not None and v.shape[1:] != (0,)}
        columns["sweep"] = columns["sweep"].astype("S4")
        columns["settled"] = surface.settled.astype(np.uint8)
        columns["stable"] = columns["stable"].astype(np.uint8)
        forces = dict.fromkeys(("force", "force_harmonics"), surface.force_unit)
        units = COLUMN_UNITS | forces | {"level": surface.level_unit}
        found = [finding.to_dict() for finding in surface.findings]
        columns["findings"] = np.bytes_(json.dumps(found, default=float))
        for name, values in columns.items():
            # no time stamps: the same surface gives the same bytes
            data = file.create_dataset(name, data=values, track_times=False)
            data.attrs["units"] = units.get(name, "")
    write_atomic(path, buffer.getvalue())


def choose_levels(surface: ResponseSurface, most: int = 6) -> list[float]:
    """Choose levels [N] to show from those that settled somewhere, evenly from lowest to highest.

    Parameters
    ----------
    most
        How many at most: more curves in one figure look alike.

    Examples
    --------
    >>> surface = ResponseSurface(range(1, 10), [5.0] * 9, 1.0, [1.0 - 1.0j] * 9)
    >>> choose_levels(surface, 3)
    [1.0, 5.0, 9.0]
    """
    levels = np.unique(surface.level[surface.settled])
    if len(levels) > most:
        levels = levels[np.unique(np.linspace(0, len(levels) - 1, most).round().astype(int))]
    return [float(level) for level in levels]
