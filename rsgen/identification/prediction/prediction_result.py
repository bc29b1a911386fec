"""Predictions: resonance curves, and scores of held-out levels and records of a multisine.

The error of a prediction is |predicted - measured|/|measured|, in root mean squares.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray, freeze, true_runs, within_band
from rsgen.common.finding import Finding, Quantity, Severity, bounded, quantities, severity_of
from rsgen.common.text_table import Brief, Printed, TextTable, lookup, short, with_error
from rsgen.common.tolerances import (
    BRANCH_DISTANCE,
    CONFIDENCE_TEXT,
    DEVIATING_MISFIT_RATIO,
    HELD_OUT_ERROR_DOUBTFUL,
    HELD_OUT_ERROR_REJECTED,
    HELD_OUT_ERROR_SMALL,
    MAX_ERROR_TO_MISFIT,
    RELATIVE_CHANGE_NEGLIGIBLE,
    interval_sigmas,
)
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.record_set import level_name, match_level
from rsgen.data.surface.mode_findings import force_rise
from rsgen.data.surface.response_surface import ResponseSurface, force_at_largest
from rsgen.formula.units import quantity_text
from rsgen.identification.fitting.points import Points
from rsgen.identification.results import Identification
from rsgen.identification.results.result import held_out_lines
from rsgen.identification.soundness import at_jump, points_at

SHARE_AT_JUMPS = 0.02
"""Share of the points of a run that may lie between a predicted and a measured jump, so on another branch;
they are not scored."""

MULTIPLIER_ROUND_OFF = 1e-6
"""Of multipliers outside the unit circle: without damping they lie on it, two equal ones within round-off."""

BEYOND = 1 + RELATIVE_CHANGE_NEGLIGIBLE
"""Amplitude relative to the largest tested one from which on a response is extrapolated."""


class Jump(NamedTuple):
    """Where the response jumps: frequency [Hz], amplitude [m] and sweep, "up" or "down", that ends there.

    ``interval`` are the 95 % bounds of the frequency [Hz]: NaN where not known, equal without any error.
    ``landing`` is the nearest amplitude [m] of another stable branch there, once settled; NaN without one.
    """

    frequency: float
    amplitude: float
    interval: tuple[float, float]
    sweep: str
    landing: float

    def in_words(self, unit: str = "", sweep: str = "") -> str:
        """Say all but the amplitude, with words after the numbers and before the direction."""
        low, high = self.interval
        error = (high - low) / (2 * interval_sigmas())
        digits = with_error(self.frequency, error) if error > 0 else 3 if np.isnan(error) else 5
        band = f" ({low:.{digits}g} to {high:.{digits}g}{unit})" if error > 0 else ""
        band += " (no interval: too wide)" if np.isnan(error) else ""
        to = f" (to {quantity_text(self.landing, 'm', 4)})" if isfinite(self.landing) else ""
        return f"{self.frequency:.{digits}g}{unit}{band} {sweep}{self.sweep}{to}"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ResonanceCurve(Brief):
    """The resonance curve of one level, ordered along the curve; a row of NaN separates detached parts.

    Parameters
    ----------
    level
        Amplitude of the force [N] or, in a test of a driven base, of its acceleration [m/s^2].
    frequency
        (k,) [Hz]; not single-valued between the folds.
    amplitude
        (k,) X [m].
    phase
        (k,) lag of displacement behind force [rad].
    stable
        (k,) False on the branch between two folds, and where ``multiplier`` is outside the unit circle.
    extrapolated
        (k,) True where the amplitude is outside the tested range, or the frequency far outside.
    lower, upper
        (k,) 95 % band of the amplitude at the frequency [m]; NaN at folds, where it is not defined.
    folds
        (j, 3) frequency [Hz], amplitude [m] and half width of the 95 % interval of the frequency [Hz], NaN
        where it is not known, of the points where the response jumps; ``jumps`` names them.
    level_unit
        "N", or "m/s^2" of a driven base and where forces are per unit mass.
    force
        Amplitude of the force, in newtons or per unit mass, as parameters are.
    peak_interval
        95 % bounds of the frequency of the largest amplitude [Hz]: equal without any error, NaN where not
        known or the curve still rises.
    travel, acceleration
        Least and largest displacement from rest at the largest amplitude [m], with all harmonics, and largest
        |acceleration| of the mass there [m/s^2], of a driven base the absolute one.
    travel_interval, acceleration_interval
        95 % bounds of both displacements [m] and of the acceleration [m/s^2]; all NaN of modal tables.
    multiplier
        (k,) the Floquet multiplier that, with folds, decides on stability: below -1 the period doubles, as
        next to a stop on one side, beyond 1 the motion loses its symmetry. NaN where it is not computed:
        under friction (jumps), laws with memory and modal tables.
    """

    level: float
    frequency: Array
    amplitude: Array
    phase: Array
    stable: NDArray[np.bool_]
    extrapolated: NDArray[np.bool_]
    lower: Array
    upper: Array
    folds: Array
    level_unit: str = "N"
    force: float = nan
    peak_interval: tuple[float, float] = (nan, nan)
    travel: tuple[float, float] = (nan, nan)
    acceleration: float = nan
    travel_interval: tuple[float, float, float, float] = (nan, nan, nan, nan)
    acceleration_interval: tuple[float, float] = (nan, nan)
    multiplier: ComplexArray = field(default_factory=lambda: np.zeros(0, dtype=complex))

    def __post_init__(self) -> None:
        freeze(self, ("frequency", "amplitude", "phase", "lower", "upper"))
        freeze(self, ("multiplier",), np.complex128)
        freeze(self, ("stable", "extrapolated"), np.bool_)
        freeze(self, ("folds",))

    @property
    def name(self) -> str:
        """Name of the level."""
        return level_name(self.level, self.level_unit)

    @property
    def jumps(self) -> tuple[Jump, ...]:
        """The folds, ascending in frequency, each with the direction of the sweep that jumps there.

        The frequency has an extremum along the curve there: a sweep up does not come beyond a largest one.
        """
        at, size, found = self.frequency, self.amplitude, list[Jump]()
        rows = stable_rows(self)
        for fold, height, half in sorted(self.folds.tolist()):
            near = int(np.nanargmin(np.hypot(at / fold - 1, size / height - 1)))
            around = np.nanmean(at[[max(near - 2, 0), min(near + 2, len(at) - 1)]])
            way = "up" if around < fold else "down"
            there = within_band(rows, (fold, fold))[:, 1]
            there = there[np.abs(there / height - 1) > BRANCH_DISTANCE]
            landing = float(there[np.argmin(np.abs(there - height))]) if len(there) else nan
            found.append(Jump(fold, height, (fold - half, fold + half), way, landing))
        return tuple(found)

    @property
    def largest(self) -> tuple[float, float, float, float]:
        """Frequency [Hz] of the largest amplitude, that amplitude and its 95 % bounds [m].

        A curve has its ends on both sides of a peak; the middle of ``peak_interval`` lies between them.
        """
        top = int(np.nanargmax(self.amplitude))
        amounts = self.amplitude, self.lower, self.upper, self.frequency
        size, low, high, at = (float(of[top]) for of in amounts)
        middle = sum(self.peak_interval) / 2
        return (middle if np.isfinite(middle) else at), size, low, high

    @property
    def rises_at_end(self) -> bool:
        """True if the highest point is where the curve leaves the band or a table: its peak lies beyond."""
        top = int(np.nanargmax(self.amplitude))
        ends = np.pad(self.frequency, 1, constant_values=np.nan)[[top, top + 2]]
        return bool(np.isnan(ends).any())

    @property
    def lost(self) -> dict[str, str]:
        """How motions outside folds lose stability, from where to where at least and at most; or nothing."""
        outside = np.abs(self.multiplier) > 1 + MULTIPLIER_ROUND_OFF
        if not outside.any():
            return {}
        first = self.multiplier[outside][0]
        by = "beats" if first.imag else "period" if first.real < 0 else "symmetry"
        wide = np.pad(self.frequency, 1, constant_values=np.nan)
        runs = [wide[at : at + count + 2] for at, count in zip(*true_runs(outside), strict=True)]
        ends = [(np.nanmin(run), run[1:-1].min(), run[1:-1].max(), np.nanmax(run)) for run in runs]
        texts = [f"{b:.4g} to {c:.4g} Hz (at most {a:.4g} to {d:.4g})" for a, b, c, d in sorted(ends)]
        return {"by": by, "where": " and ".join(texts)}


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class _Predicted(Brief):
    """Measured and predicted response at (n,) frequencies [Hz], ascending.

    Parameters
    ----------
    level, level_unit, label
        Nominal level, its unit, and the label of one that has a label.
    measured, predicted
        (n,) complex displacement [m] under the measured force.
    error
        Root mean square of predicted - measured over that of measured [1].
    """

    level: float
    frequency: Array
    measured: ComplexArray
    predicted: ComplexArray
    error: float
    level_unit: str = "N"
    label: str = ""

    def __post_init__(self) -> None:
        freeze(self, ("frequency",))
        freeze(self, ("measured", "predicted"), np.complex128)

    @property
    def name(self) -> str:
        """Name of the level."""
        return level_name(self.level, self.level_unit, self.label)


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class HeldOutLevel(_Predicted):
    """Measured and predicted fundamental X_1 [m] of one held-out level ("N", "m" where held) and sweep.

    The predicted one is NaN without a steady state. Where the test held the amplitude, of a free decay, and,
    of a sweep and where the force ``changes``, next to folds and on an unstable branch, it is
    X_1 F/F_predicted, with the force that this amplitude needs at its frequency.

    Of the error up to 2 % of the points, rounded up, are left out where they are ``missing``: between a
    predicted and a measured jump branches differ. A point for which the law has no steady state counts as
    predicted at rest.

    Parameters
    ----------
    sweep
        How the points were reached.
    largest_error, largest_at
        Largest |predicted - measured| of the same points over the same root mean square [1], and the
        frequency of that point [Hz].
    missing
        Number of points without a predicted steady state near the measured one; of a decay, and where the
        test held the amplitude, without any.
    force
        Measured force at the largest motion, that of the curve of the level; NaN with response control.
    force_unit
        "N", or "m/s^2" where parameters and forces are per unit mass.
    explained
        The error that noise and the errors of the values (95 %) explain [1]; NaN where they do not.
    misfit
        Of the law or table that predicts, where it was fitted [1].
    changes
        True where the force was another one near the resonance: no curve of one force has the points.
    """

    sweep: str
    largest_error: float
    missing: int
    force: float = nan
    force_unit: str = "N"
    explained: float = nan
    misfit: float = nan
    largest_at: float = nan
    changes: bool = False


# ----------------------------------------------------------------------------
# What a sweep reaches: rows (n, 4) along a curve of frequency [Hz], amplitude [m] and its interval [m].


def stable_rows(curve: ResonanceCurve) -> Array:
    """Return the rows (k, 4) of a curve, NaN where it is unstable and between detached parts."""
    along = np.stack([curve.frequency, curve.amplitude, curve.lower, curve.upper], axis=1)
    return np.where(curve.stable[:, None], along, nan)


def _swept_through(rows: Array, band: tuple[float, float], way: str) -> Array:
    """Return the rows (k, 4) that a sweep "up" or "down" a band [Hz] reaches, after one of zeros.

    It begins at the smallest motion, and jumps to the nearest one where its branch ends.
    """
    sense = 1 if way == "up" else -1
    inside = rows[(rows[:, 0] >= band[0]) & (rows[:, 0] <= band[1]), 0]
    places = np.concatenate([band, inside, np.nextafter(inside, sense * inf)])
    path = [np.zeros(4)]
    for place in sense * np.unique(sense * places):
        there = within_band(rows, (place, place))
        path += [*there[np.argsort(np.abs(there[:, 1] - path[-1][1]))][:1]]
    return np.array(path)


def _largest(rows: Array, name: str) -> dict[str, Quantity]:
    """Return the largest amplitude of rows, its interval and frequency, as numbers that begin with a name."""
    place, most, low, high = map(float, rows[np.argmax(rows[:, 1])])
    return bounded("m", name, most, (low, high)) | quantities("Hz", **{f"{name}_at": place})


def largest_of_curve(
    curve: ResonanceCurve, base: str, band: tuple[float, float], sweeps: Collection[str] = ()
) -> Finding:
    """State the largest amplitude of a curve, and in the tested band [Hz], its interval, and jumps.

    First comes the largest that the tested ``sweeps`` reach in the band, where another branch has more.
    """
    numbers, rows = {"level": Quantity(curve.level, curve.level_unit)}, stable_rows(curve)
    jumps = ", ".join(jump.in_words(" Hz", "in a sweep ") for jump in curve.jumps)
    names = {"base": base, "jumps": jumps, **curve.lost}
    if len(rows):
        top = int(np.nanargmax(curve.amplitude))
        at, size, low, high = curve.largest
        names["beyond"] = "yes" if curve.extrapolated[top] else ""
        names["stability"] = "folds" if np.isnan(curve.multiplier).all() else ""
        numbers |= quantities("Hz", at=at)
        inside = within_band(rows, band)
        if len(inside) and not band[0] <= at <= band[1]:
            numbers |= _largest(inside, "inside")
        if len(inside) and len(sweeps) and {*sweeps} <= {"up", "down"}:
            swept = np.concatenate([_swept_through(rows, band, way) for way in sweeps])
            if swept[:, 1].max() * BEYOND < inside[:, 1].max():
                numbers, names["sweep"] = numbers | _largest(swept, "swept"), " or ".join(sweeps)
        if curve.rises_at_end:
            numbers |= quantities("m", reached=size)
        else:
            numbers |= quantities("m", amplitude=size, **({"low": low, "high": high} if low < high else {}))
            numbers |= bounded("Hz", "at", at, curve.peak_interval)
            numbers |= bounded("m", "least", curve.travel[0], curve.travel_interval[:2])
            numbers |= bounded("m", "most", curve.travel[1], curve.travel_interval[2:])
            numbers |= bounded("m/s^2", "acceleration", curve.acceleration, curve.acceleration_interval)
    names = {name: said for name, said in names.items() if said}
    return Finding("level-predicted", "info", "", numbers, names)


def known_beyond(
    held_out: Sequence[object], force: float, amplitude: float, tested: float
) -> dict[str, Quantity]:
    """Return the error of what was held out at a force [N], else above and up to an amplitude [m].

    Of levels below the largest ``tested`` amplitude [m] nothing follows for what is beyond.
    """
    scored = [one for one in held_out if isinstance(one, HeldOutLevel)]
    scored = [one for one in scored if np.abs(one.measured).max(initial=0.0) > tested]
    near = [one.error for one in scored if abs(one.force / force - 1) <= RELATIVE_CHANGE_NEGLIGIBLE]
    if near:
        return quantities(error=max(near))
    above = [one for one in scored if one.force > force]
    above = [o for o in above if np.abs(o.measured[np.isfinite(o.predicted)]).max(initial=0.0) >= amplitude]
    if not above:
        return {}
    held = Quantity(above[0].level, above[0].level_unit)
    return {"held": held, **quantities(error=max(one.error for one in above))}


def named(item: HeldOutLevel | PredictedRecord) -> dict[str, str]:
    """Return the label of a level as a finding has it; empty without one."""
    return {"label": item.label} if item.label else {}


def held_by_label(found: Identification, test: ResponseSurface | MultisineSpectra) -> tuple[Finding, ...]:
    """Find held-out numbers that are the label of one level and the amount of another."""
    if test.label is None:
        return ()
    findings, labels = list[Finding](), np.unique(test.label)
    for asked in found.model.observation.hold_out:
        label, amount = match_level(labels, asked), match_level(test.levels, asked)
        meant = test.level[test.label == label].tolist()
        if meant and amount not in (None, meant[0]):
            numbers = quantities(label=asked, level=Quantity(meant[0], test.level_unit))
            findings.append(Finding("held-out-by-label", "warning", numbers=numbers))
    return tuple(findings)


def _runs(found: Identification) -> Iterator[tuple[Points, float]]:
    """Yield the points of each fitted level and the force at the largest motion; none if none was held."""
    if found.fit is None or found.curve.level_unit == "m":
        return
    points = found.fit.problem.observed.points
    for level in np.unique(points.level):
        run = points.select(points.level == level)
        yield run, force_at_largest(run.amplitude, run.force)


def points_under(found: Identification, force: float) -> Points | None:
    """Return the points of the level of a force [N]; None where it was not tested."""
    near = (run for run, tested in _runs(found) if abs(tested / force - 1) <= RELATIVE_CHANGE_NEGLIGIBLE)
    return next(near, None)


def levels_meant(
    found: Identification,
    curves: Sequence[ResonanceCurve],
    test: ResponseSurface | None,
    held_out: Sequence[HeldOutLevel] = (),
) -> list[Finding]:
    """Find levels asked for that are name or label of a tested one that had another amount, and, where some
    were not tested, that the forces of tested ones fell near their resonances, without control of the shaker.
    """
    runs, findings = [*_runs(found)], list[Finding]()
    new = [curve for curve in curves if not points_under(found, curve.force)]
    for curve in new:
        amounts = {float(run.level[0]): force * curve.level / curve.force for run, force in runs}
        if test is not None and test.label is not None:
            amounts |= dict(zip(test.label.tolist(), test.level.tolist(), strict=True))
        name = match_level(np.array([*amounts]), curve.level)
        if name is not None and curve.level_unit == found.curve.level_unit:
            numbers = quantities(curve.level_unit, level=curve.level, tested=amounts[name])
            findings.append(Finding("level-predicted", "info", "", numbers, {"by": "name"}))
    held = np.array([item.force for item in held_out])
    new = [one for one in new if not (np.abs(held / one.force - 1) <= RELATIVE_CHANGE_NEGLIGIBLE).any()]
    highest = max(runs, key=lambda pair: pair[1], default=None)
    if new and highest and -force_rise(highest[0].amplitude, highest[0].force) > HELD_OUT_ERROR_SMALL:
        numbers = quantities(fell=max(-force_rise(run.amplitude, run.force, np.min) for run, _ in runs))
        by = {"by": "force"} | ({"base": "yes"} if found.curve.base else {})
        findings.append(Finding("level-predicted", "info", "", numbers, by))
    return findings


def missing_findings(held_out: tuple[HeldOutLevel, ...]) -> tuple[Finding, ...]:
    """Find held-out levels with points without a predicted steady state near them, as next to a jump."""
    findings = []
    for item in (item for item in held_out if item.missing):
        level, size = Quantity(item.level, item.level_unit), np.abs(item.measured)
        numbers = quantities(missing=item.missing, points=len(size), level=level)
        names = {"sweep": item.sweep, **named(item)}
        missed = ~(np.abs(item.predicted - item.measured) <= BRANCH_DISTANCE * size)
        few = item.missing == np.count_nonzero(missed) <= np.ceil(SHARE_AT_JUMPS * len(size))
        if few and at_jump(size, missed):
            names["jump"] = points_at(size[missed] * 0 + item.level, item.frequency[missed], item.level_unit)
        severity: Severity = "info" if "jump" in names else "warning"
        findings.append(Finding("held-out-points-missing", severity, numbers=numbers, names=names))
    return tuple(findings)


def missed_findings(held_out: tuple[HeldOutLevel, ...]) -> tuple[Finding, ...]:
    """Find held-out levels whose error is large, or more than misfit and errors of the values explain."""
    findings = []
    for item in held_out:
        error, misfit, explained = item.error, item.misfit, item.explained
        limit = max(HELD_OUT_ERROR_SMALL, MAX_ERROR_TO_MISFIT * misfit)
        if isfinite(explained):
            limit = min(limit, max(RELATIVE_CHANGE_NEGLIGIBLE, DEVIATING_MISFIT_RATIO * misfit, explained))
        if not error > limit:
            continue
        severity = severity_of(error, HELD_OUT_ERROR_DOUBTFUL, HELD_OUT_ERROR_REJECTED)
        numbers = {"level": Quantity(item.level, item.level_unit), **quantities(error=error, misfit=misfit)}
        numbers |= quantities(explained=explained) if isfinite(explained) else {}
        names = {"sweep": item.sweep, **named(item)}
        # forces of a decay are far more sensitive to the values than its frequency
        if error <= explained and misfit <= HELD_OUT_ERROR_SMALL:
            severity, names["by"] = "warning", "values"
        findings.append(Finding("held-out-missed", severity, "", numbers, names))
    return tuple(findings)


def score_points(
    measured: ComplexArray, predicted: ComplexArray, near: float = BRANCH_DISTANCE, *, by_law: bool = True
) -> tuple[float, float, int, int]:
    """Return the error of a run, its largest one, how many points are not as ``near``, and the worst point.

    Points on another branch may lie between a predicted and a measured jump: a few of them are not scored.
    One without a steady state has an error of its full amplitude if the prediction is ``by_law``; for a modal
    table it is out of range and does not count.
    """
    size = np.abs(measured)
    miss = np.abs(predicted - measured)
    missed = ~(miss <= near * size)
    scored = np.full(len(size), True) if by_law else np.isfinite(miss)
    miss = np.where(np.isfinite(miss), miss, size)
    off = np.flatnonzero(scored & missed)
    off = off[np.argsort(-miss[off], kind="stable")]
    count = int(np.count_nonzero(scored))
    scored[off[: min(int(np.ceil(SHARE_AT_JUMPS * count)), count - 1)]] = False
    if not scored.any():
        return nan, nan, int(np.count_nonzero(missed)), 0
    root = np.sqrt(np.mean(size[scored] ** 2))
    error = float(np.sqrt(np.mean(miss[scored] ** 2)) / root)
    worst = int(np.argmax(np.where(scored, miss, -inf)))
    return error, float(miss[worst] / root), int(np.count_nonzero(missed)), worst


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Prediction(Printed):
    """Resonance curves, scores of held-out levels, and findings about them.

    ``curves[3.0]`` is the curve of the level 3 N; iterating gives the curves.

    Parameters
    ----------
    curves
        One for each level, in the order of the call.
    held_out
        One for each held-out level and sweep; empty without held-out levels or without a surface.
    findings
        Levels beyond the tested amplitudes, without a curve, with points that are not predicted.
    records
        One for each predicted record of a multisine; scores of single sines are then empty.
    band
        Frequencies of the curves that were asked for [Hz]; None: those of the test.
    fitted
        Fitted levels whose force ``changes``, at the forces that were measured; empty without a surface.
    observed
        Band of the observation [Hz], whose points alone are fitted, judged and drawn; None: all.
    """

    curves: tuple[ResonanceCurve, ...]
    held_out: tuple[HeldOutLevel, ...]
    findings: tuple[Finding, ...]
    records: tuple[PredictedRecord, ...] = ()
    band: tuple[float, float] | None = None
    fitted: tuple[HeldOutLevel, ...] = ()
    observed: tuple[float, float] | None = None

    def __getitem__(self, level: float) -> ResonanceCurve:
        """Curve of a level [N].

        Raises
        ------
        RsgenError
            The level was not predicted; it is a ``KeyError``, too.
        """
        return lookup(f"{level:g}", {f"{curve.level:g}": curve for curve in self.curves}, "level")

    def __iter__(self) -> Iterator[ResonanceCurve]:
        return iter(self.curves)

    def __len__(self) -> int:
        return len(self.curves)

    @property
    def table(self) -> TextTable:
        """The table that is printed."""
        if self.records and not self.curves:
            scores = [(short(one.level), short(one.error, 3), short(one.noise, 2)) for one in self.records]
            unit = self.records[0].level_unit
            of_records = (f"level rms [{unit}]", "error, relative rms", "noise, relative rms")
            return TextTable(of_records, tuple(scores), notes=tuple(map(str, self.findings)))
        rows = []
        for curve in self:
            highest, extrapolated, jumps = [short(nan)] * 5, "", ""
            if len(curve.frequency):
                (slow, fast), (at, size, low, high) = curve.peak_interval, curve.largest
                band = f"{short(low)} to {short(high)}" if low < high else ""
                digits = with_error(at, (fast - slow) / (2 * interval_sigmas())) if slow < fast else 5
                around = f" ({slow:.{digits}g} to {fast:.{digits}g})" if slow < fast else ""
                around += ", still rising" if curve.rises_at_end else ""
                known, ends = stable_rows(curve), (np.nanmin(curve.frequency), np.nanmax(curve.frequency))
                ways = ("up", "down") if len(curve.folds) else ()
                swept = " / ".join(short(_swept_through(known, ends, way)[:, 1].max()) for way in ways)
                highest = [short(size), band, f"{at:.{digits}g}{around}"]
                highest += ["{} to {}".format(*map(short, curve.travel)), swept]
                jumps = ", ".join(jump.in_words() for jump in curve.jumps) or "none"
                # the flanks of a curve lie below every tested amplitude, whatever its level
                extrapolated = "yes" if curve.extrapolated[np.nanargmax(curve.amplitude)] else "no"
            rows.append((short(curve.level), *highest, jumps, extrapolated))
        heads = (
            f"level [{self.curves[0].level_unit if self.curves else 'N'}]",
            "largest fundamental [m]",
            f"{CONFIDENCE_TEXT} band",
            f"at [Hz] ({CONFIDENCE_TEXT} interval)",
            "motion there [m]",
            "largest in a sweep up / down [m]",
            f"jumps at [Hz] ({CONFIDENCE_TEXT} interval), sweep (to, settled)",
            "extrapolated",
        )
        notes = [*held_out_lines((*self.held_out, *self.records)), *map(str, self.findings)]
        if any(curve.rises_at_end for curve in self if len(curve.frequency)):
            more = "a curve still rises where the band or the table ends; band=(low, high) [Hz] shows more"
            notes.insert(0, more)
        return TextTable(heads, tuple(rows), notes=tuple(notes))


# ----------------------------------------------------------------------------
# The periodic motion under a record of a multisine, which ``rsgen.identification.lines`` predicts.


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class PredictedRecord(_Predicted):
    """Measured and predicted lines of one held-out record, the mean first; its level is the rms of the drive.

    Parameters
    ----------
    judged
        (n,) scored lines: those of the band, without the mean and low lines below the noise. The error is
        theirs, NaN without a prediction.
    noise
        The same of the noise of the measured mean [1]; NaN of one period.
    """

    judged: NDArray[np.bool_]
    noise: float

    def __post_init__(self) -> None:
        _Predicted.__post_init__(self)
        freeze(self, ("judged",), np.bool_)
