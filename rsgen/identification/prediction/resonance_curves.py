"""Resonance curves with folds and stability, and scores of held-out levels, from identified parameters.

At every amplitude X the balance F^2 = X^2 ((k - m omega^2)^2 + omega^2 c^2) is solved for the frequency
(``amplitude_balance``). A branch is stable where |F| at constant frequency grows with X, d|F|/dX > 0; folds,
where the response jumps, are the zeros of this slope. Bands of the amplitude are those of the force by linear
propagation of the covariance of the parameters, divided by the slope; those of a fold by that over omega.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf, isfinite, nan
from typing import cast

import numpy as np
from numpy.typing import NDArray

import rsgen.identification  # predicts records of multisines
from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError, known_arguments, require
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.tolerances import (
    BRANCH_DISTANCE,
    MAX_LINEAR_CHANGE,
    RELATIVE_CHANGE_NEGLIGIBLE,
    RELATIVE_ERROR_DOUBTFUL,
    ROUND_OFF,
)
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import Oscillator, refuse_across
from rsgen.data.surface.mode_findings import force_changes
from rsgen.data.surface.response_surface import (
    HALF_POWER,
    ResponseSurface,
    choose_levels,
    typical_amounts,
    within,
)
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.dynamics.transients import largest_after_jump
from rsgen.dynamics.virtual_test import level_grid
from rsgen.identification.fitting.across import across_of_mode, law_of
from rsgen.identification.fitting.points import Points
from rsgen.identification.modal_result import ModalTable
from rsgen.identification.prediction.amplitude_balance import AmplitudeBalance, SynthesisBalance, balance_of
from rsgen.identification.prediction.prediction_result import (
    BEYOND,
    MULTIPLIER_ROUND_OFF,
    HeldOutLevel,
    Prediction,
    ResonanceCurve,
    held_by_label,
    known_beyond,
    largest_of_curve,
    levels_meant,
    missed_findings,
    missing_findings,
    points_under,
    score_points,
)
from rsgen.identification.resonance import (
    HALF_WIDTHS,
    as_identification,
    contradicted_sweep,
    table_as_identification,
)
from rsgen.identification.results import Identification, MultisineIdentification
from rsgen.identification.soundness import MAX_FORCE_TO_FRICTION

_BRANCH_POINTS = 161
"""Sizes of a side of a curve, and of the refinement of a fold."""

_MAX_GAP_AT_PEAK = 0.3
"""Distance in frequency of both sides at the end of a branch, relative to that at half power: a peak that is
cut off less than 4 % below its top is one."""

_FREQUENCY_MARGIN = 0.05
"""Relative extension of the curves beyond the tested frequencies."""


@known_arguments
def predict(
    found: Identification | ModalTable | Oscillator,
    levels: float | Sequence[float] | None = None,
    surface: ResponseSurface | MultisineSpectra | None = None,
    *,
    band: tuple[float, float] | None = None,
) -> Prediction:
    """Compute the resonance curve of every level; with a surface, score the held-out levels on it.

    At every amplitude X the balance of all harmonics is solved for the frequencies at which the force of the
    level is needed, so that all branches come without continuation, with their band ``lower`` to ``upper``.

    Parameters
    ----------
    found
        An identification, whose refined estimate is used, an oscillator, or a modal table, whose curves have
        no law and end at its largest amplitude.
    levels
        Amplitudes of the force [N], or of the acceleration [m/s^2] of a driven base, not names of levels;
        None: those at the largest motions of the fitted and the held-out levels.
    surface
        Where the held-out levels were measured; None: no score. Of a multisine every record of these spectra
        is predicted, None: those of the held-out levels. Curves are of ``levels`` asked for alone, each the
        amplitude of a sine, where the levels of a multisine are root mean squares.
    band
        Lowest and highest frequency [Hz] of the curves; None: the tested range and a little more, within the
        band of the observation, of an oscillator the resonances with their flanks.

    Raises
    ------
    RsgenError
        A level is not positive and finite, an oscillator comes without levels, or its resonance has no end.
        Levels are asked of a law that acts across two sensors: only measured ones have the motion there.

    Examples
    --------
    >>> curves = predict(Oscillator(1.0, "k*x + c*v", {"k": 1e4, "c": 2.0}), [1.0, 3.0])
    >>> round(float(np.nanmax(curves[3.0].amplitude)), 4)
    0.015
    """
    require(found, (Identification, ModalTable, Oscillator), "found")
    if isinstance(levels, ResponseSurface | MultisineSpectra):
        raise RsgenError(f"levels: {type(levels).__name__}; did you mean surface=?")
    records = Prediction((), (), ())
    if isinstance(found, MultisineIdentification):
        spectra, surface = cast("MultisineSpectra | None", surface), None
        records = rsgen.identification.predict_multisine(found, spectra)
        if levels is None:
            return replace(records, findings=(*records.findings, *_along(found)))
        sine = Finding("prediction-extrapolated", "info", names={"by": "sine"})
        records = replace(records, findings=(sine, *records.findings))
    if surface is not None:
        require(surface, ResponseSurface, "surface")
    asked = None if levels is None else level_grid(levels, "levels", "N or m/s^2").tolist()
    table, mass, oscillator = None, found.mass, isinstance(found, Oscillator)
    if isinstance(found, Oscillator):
        if asked is None:
            raise RsgenError("levels: an oscillator has none; give the force levels [N] to predict")
        found = as_identification(found, asked)
    elif isinstance(found, ModalTable):
        table, found = found, table_as_identification(found)
    tested = (0.0, inf) if oscillator else found.amplitude_range
    observed, sensors = found.model.observation.band, found.model.sensors
    if surface is not None:
        surface = within(cast("ResponseSurface", surface).on_mass(mass), observed)
    if not isfinite(found.mass):
        return Prediction((), (), (Finding("needs-mass", "warning"),))
    low, high = found.frequency_range
    near = (low * (1 - _FREQUENCY_MARGIN), high * (1 + _FREQUENCY_MARGIN))
    least, most = observed or (0.0, inf)
    window = (max(near[0], least), min(near[1], most)) if band is None else (float(band[0]), float(band[1]))
    if band is not None and not 0 < window[0] < window[1] < inf:
        raise RsgenError(f"band: {band[0]:g} to {band[1]:g} Hz; must be ascending, finite and positive")
    refuse_across(sensors, levels=levels is not None)
    balance = SynthesisBalance(table, window) if table is not None else balance_of(found)
    held_out, fitted = tuple[HeldOutLevel, ...](), tuple[HeldOutLevel, ...]()
    if surface is not None:
        held = surface.held_out(found.model.observation.hold_out)
        held_out = _score(found, balance, surface, held)
    unseen = [one.force for one in held_out or found.held_out if isinstance(one, HeldOutLevel)]
    forces = np.unique([*found.levels, *filter(isfinite, unseen)])
    # curves of a law across two sensors would need the motion there
    chosen = [] if sensors else asked or (forces / _force_per_level(found)).tolist()
    # free decays and resonances alone have no band: the law has flanks
    fitted_law = table is None and tested[1] < inf and not sensors
    flanks = _resonance_band(found, balance, chosen) if fitted_law and band is None else None
    window = flanks or window
    omega = (2 * np.pi * window[0], 2 * np.pi * window[1])
    # the edges of the curves of a test are no extrapolation
    known = (0.0, inf) if flanks or tested[1] == inf else (near[0] / BEYOND, near[1] * BEYOND)
    curves = tuple(_curve(found, balance, level, omega, tested, known) for level in chosen)
    if surface is not None and not (surface.decays or surface.response_held):
        same = surface.levels[np.isin(typical_amounts(surface), [curve.force for curve in curves])]
        parts = {level: surface.select(surface.settled & (surface.level == level)) for level in same}
        changing = [level for level, part in parts.items() if force_changes(part.amplitude, part.force)]
        fitted = _score(found, balance, surface, ~held & np.isin(surface.level, changing))
    findings = [*missed_findings(held_out)]
    if curves and not known[0] <= window[0] < window[1] <= known[1]:
        numbers = quantities("Hz", low=low, high=high)
        findings.append(Finding("prediction-extrapolated", "warning", "", numbers, {"by": "frequency"}))
    if curves and surface is not None and surface.base in ("displacement", "velocity"):
        findings.append(Finding("curves-of-constant-acceleration", "info", names={"base": surface.base}))
    findings = [*_along(found), *_findings(found, balance, tested, curves, held_out, fitted), *findings]
    findings += [*levels_meant(found, curves, surface, held_out), *records.findings]
    return Prediction(curves, held_out, tuple(findings), records.records, band and window, fitted, observed)


def _resonance_band(
    found: Identification, balance: AmplitudeBalance, levels: list[float]
) -> tuple[float, float] | None:
    """Return the resonances under the levels and their flanks [Hz], where a half width was not tested."""
    tested = 2 * np.pi * np.array(found.frequency_range)
    omega, size, ends = tested.mean(keepdims=True), np.array([found.amplitude_range[1]]), list[float]()
    if np.ptp(tested) > balance.equivalent(size, omega, None)[1] / (2 * found.mass):
        return None
    for level in levels:
        omega, size = balance.peak(level * _force_per_level(found), (tested[0], tested[1]))
        if len(omega) and isfinite(omega[0]):
            width = float(balance.equivalent(size, omega, None)[1][0]) / (2 * found.mass)
            around = min(HALF_WIDTHS * width, float(omega[0]) / 2)
            ends += [float(omega[0]) - around, float(omega[0]) + around]
    return (min(ends) / (2 * np.pi), max(ends) / (2 * np.pi)) if ends else None


def _along(found: Identification) -> list[Finding]:
    """Say that a law across two sensors is predicted along the measured motion, and has no curves."""
    sensors = found.model.sensors
    return [Finding("predicted-along-measured", "info", names={"sensors": sensors})] if sensors else []


def predict_records(found: MultisineIdentification) -> Prediction:
    """Predict the held-out records of a multisine; state the levels that were asked for."""
    scored = rsgen.identification.predict_multisine(found)
    meant = (*held_by_label(found, found.spectra), *_asked_for(found, found.spectra))
    return replace(scored, findings=(*meant, *scored.findings))


def predict_held_out(found: Identification, surface: ResponseSurface) -> Prediction:
    """Compare the held-out levels of the test that was identified with it; state those asked for."""
    meant = (*held_by_label(found, surface), *_asked_for(found, surface))
    if not (found.model.observation.hold_out and isfinite(found.mass)):
        return Prediction((), (), meant)
    surface = within(surface.on_mass(found.mass), found.model.observation.band)
    held_out = _score(found, balance_of(found), surface, surface.held_out(found.model.observation.hold_out))
    return Prediction((), held_out, (*meant, *missing_findings(held_out), *missed_findings(held_out)))


def _force_per_level(found: Identification) -> float:
    """Return the force [N] for each m/s^2 of a driven base: the mass, or 1 where there is none."""
    return found.mass if found.curve.base and np.isfinite(found.curve.units.kilogram) else 1.0


def _findings(
    found: Identification,
    balance: AmplitudeBalance,
    tested: tuple[float, float],
    curves: tuple[ResonanceCurve, ...],
    held_out: tuple[HeldOutLevel, ...],
    fitted: tuple[HeldOutLevel, ...],
) -> tuple[Finding, ...]:
    """Find curves without a steady state, or beyond the amplitudes tested, and points not predicted."""
    changing = [item.force for item in (*held_out, *fitted) if item.changes]
    findings, rising, below = list[Finding](), list[dict[str, Quantity]](), list[dict[str, Quantity]]()
    short = list[tuple[float, tuple[Finding, ...]]]()
    for curve in curves:
        numbers = {"level": Quantity(curve.level, curve.level_unit), "high": Quantity(tested[1], "m")}
        stops = _friction_under(found, curve)
        if len(curve.frequency) == 0 or stops:
            data = {"level": numbers["level"], **stops}
            names = {"by": "rest"} if "friction" in stops and curve.level <= stops["friction"].value else {}
            findings.append(Finding("no-steady-state", "warning", numbers=data, names=names))
        if len(curve.frequency) == 0:
            continue
        if isinstance(balance, SynthesisBalance) and curve.rises_at_end:
            rising.append(numbers)
            continue
        if isinstance(balance, SynthesisBalance) and np.nanmax(curve.amplitude) * BEYOND < tested[0]:
            below.append({"level": numbers["level"], "low": Quantity(tested[0], "m")})
        run = points_under(found, curve.force)
        if curve.force in changing or (run is not None and force_changes(run.amplitude, run.force)):
            # what the test reached is no matter of a constant force
            continue
        beyond = np.any(curve.extrapolated & (curve.amplitude > tested[1]))
        if run is not None and (beyond or curve.rises_at_end):
            short.append(_compare_peaks(found, balance, curve, run, numbers))
        elif beyond:
            largest = float(np.nanmax(curve.amplitude))
            numbers |= known_beyond(held_out or found.held_out, curve.force, largest, tested[1])
            findings.append(Finding("prediction-extrapolated", "warning", numbers=numbers))
    for beyond_table in filter(None, (rising, below)):
        numbers = beyond_table[-1] | quantities(levels=len(beyond_table))
        findings.append(Finding("prediction-extrapolated", "warning", "", numbers, {"by": "table"}))
    # points of a level rarely hit its very peak
    short = [one for one in short if one[0] > 1 + RELATIVE_ERROR_DOUBTFUL]
    if any(one["peak"] > tested[1] for _, (one, *_) in short):
        worst, *doubts = max(short, key=lambda of: (of[1][0]["peak"] > tested[1], of[0], of[1][0]["peak"]))[1]
        worst = replace(worst, numbers={**worst.numbers, **quantities(levels=len(short))})
        findings += [worst, *doubts]
    if lost := [curve for curve in curves if curve.lost]:
        numbers = {"level": Quantity(lost[-1].level, lost[-1].level_unit), **quantities(levels=len(lost))}
        findings.append(Finding("motion-does-not-last", "warning", "", numbers, lost[-1].lost))
    return (*findings, *missing_findings(held_out))


def _friction_under(found: Identification, curve: ResonanceCurve) -> dict[str, Quantity]:
    """Return dry friction that holds the mass under the force of a curve, and the least force of a resonance.

    Both are in the unit of the level. Friction Ff takes 4 Ff X a period, the force gives at most pi F X:
    without stops it swings above 4 Ff/pi. A little above that it stops in every period still, which few
    harmonics miss in part: with the ``highest`` amplitude of the curve and that in time, where they differ.
    """
    if len(found.solution) != len(found.model.parameters):
        return {}
    law, rate = law_of(found.model.elements), 2 * np.pi * found.frequency_range[1] * found.amplitude_range[1]
    friction = law.dry_friction(ROUND_OFF * rate, found.solution) * (curve.level / curve.force)
    least = 4 / np.pi * friction
    numbers = quantities(curve.level_unit, friction=friction, least=least)
    if not len(curve.frequency):
        return numbers if curve.level < least else {}
    if curve.level >= MAX_FORCE_TO_FRICTION * friction:
        return {}
    at = int(np.nanargmax(curve.amplitude))
    frequency, highest = curve.frequency[at], float(curve.amplitude[at])
    place = highest * np.exp(-1j * curve.phase[at]) * np.array([[1, 2j * np.pi * frequency]])
    states = solve_steady_states(found.oscillator, curve.force, frequency, harmonics=1, start=place.real)
    exact = float(np.abs(states.harmonics[0, 1]))
    if not states.settled[0] or abs(exact / highest - 1) < RELATIVE_CHANGE_NEGLIGIBLE:
        return {}
    return numbers | quantities("m", highest=highest, exact=exact) | quantities("Hz", frequency=frequency)


def _compare_peaks(
    found: Identification,
    balance: AmplitudeBalance,
    curve: ResonanceCurve,
    run: Points,
    numbers: dict[str, Quantity],
) -> tuple[float, tuple[Finding, ...]]:
    """Return how high a curve peaks above its points, as a ratio, and what they miss or contradict.

    A curve that rises as it leaves the band peaks beyond it; the ratio is infinite where the law has no peak.
    Points that are low before that peak lie on the lower branch, as those from rest before the fold do, and
    those of a sweep from the other side; others leave a gap there, or end before it.
    """
    peak, top = int(np.nanargmax(curve.amplitude)), int(np.argmax(run.amplitude))
    at, height = float(curve.frequency[peak]), float(curve.amplitude[peak])
    measured, frequency = float(run.amplitude[top]), run.omega / (2 * np.pi)
    if rises := curve.rises_at_end:
        omega, size = balance.peak(curve.level, (2 * np.pi * frequency.min(), 2 * np.pi * frequency.max()))
        if rises := not (len(omega) and np.isfinite(omega).all()):
            numbers |= {"sought": Quantity(float(size[0]) if len(size) else height, "m")}
        else:
            seen, _ = _at_sensor(found, omega, size, balance.solve(size, omega).force)
            at, height = float(omega[0]) / (2 * np.pi), float(abs(seen[0]))
    low, high = sorted((frequency[top], at))
    between = run.amplitude[(frequency > low) & (frequency < high) & (run.sweep == run.sweep[top])]
    sizes = quantities("m", measured=measured, peak=height, frequency=Quantity(at, "Hz"))
    jumped = np.any(between < HALF_POWER * measured)
    inside = frequency.min() <= at <= frequency.max() and not rises
    names = {"by": "jump" if jumped else "points" if inside else "end", "rises": "yes" if rises else "no"}
    doubts: tuple[Finding, ...] = ()
    if jumped:
        # the upper branch, on which the largest point lies, leads to the peak
        way = "up" if at > frequency[top] else "down"
        doubts = contradicted_sweep(curve, run, top, way)
        names["way"] = "finer" if way in run.sweep and not doubts else way
    finding = Finding("prediction-extrapolated", "warning", numbers=numbers | sizes, names=names)
    return np.inf if rises else height / measured, (finding, *doubts)


def _curve(
    identification: Identification,
    balance: AmplitudeBalance,
    level: float,
    window: tuple[float, float],
    tested: tuple[float, float],
    known: tuple[float, float],
) -> ResonanceCurve:
    """Compute the curve of a level within a window of frequencies [rad/s]; ``known`` are the tested [Hz]."""
    force = level * _force_per_level(identification)
    spans = balance.spans(force, window)
    parts = [part for span in spans for part in _branches(balance, force, span, window)]
    columns, folds = list[ComplexArray](), list[list[float]]()
    for omega, size, harmonics in parts:
        # without them a law with several motions of an amplitude may answer with another one
        at = balance.solve(size, omega, harmonics)
        gain = (np.conj(at.force) * at.force_slope).real / np.abs(at.force) / size
        band = balance.force_spread(at)
        spread = band / np.maximum(np.abs(gain), 1e-300)
        spread[spread > MAX_LINEAR_CHANGE * size] = np.nan
        seen, lag = _at_sensor(identification, omega, size, at.force)
        turn = np.flatnonzero(np.diff(omega[1:]) * np.diff(omega[:-1]) < 0) + 1
        gain[turn] = np.abs(gain[turn])  # zero but for round-off, whose sign cut a stable branch short
        half = balance.frequency_spread(band[turn], size[turn], omega[turn], at.harmonics[turn])
        folds += np.stack([omega[turn], np.abs(seen[turn]), half], axis=1).tolist()
        # a point without numbers separates the parts
        part = np.array([omega, lag, gain, spread, size, seen, balance.multiplier(at, omega)])
        columns += [np.full((7, 1), np.nan + 0j), part]
    whole = np.concatenate(columns[1:] or [np.zeros((7, 0), complex)], axis=1)
    (omega, phase, gain, spread, sizes), (seen, multiplier) = whole[:5].real, whole[5:]
    frequency, amplitude = omega / (2 * np.pi), np.abs(seen)
    top = np.argsort(amplitude)[np.isfinite(amplitude).sum() - 1 :][:1]
    (_, *peak), least, most, fastest = balance.at_top(sizes[top], omega[top], seen[top]).tolist()
    return ResonanceCurve(
        level=level,
        level_unit="m/s^2" if identification.curve.base else identification.curve.units.force,
        force=force,
        frequency=frequency,
        amplitude=amplitude,
        phase=phase,
        stable=(gain > 0) & ~(np.abs(multiplier) > 1 + MULTIPLIER_ROUND_OFF),
        extrapolated=(sizes > tested[1] * BEYOND)
        | (sizes < tested[0] / BEYOND)
        | (frequency < known[0])
        | (frequency > known[1]),
        lower=np.maximum(amplitude - spread, 0.0),
        upper=amplitude + spread,
        folds=np.array(folds).reshape(-1, 3) / [2 * np.pi, 1, 2 * np.pi],
        travel=(least[0], most[0]),
        acceleration=fastest[0],
        peak_interval=tuple(peak),
        travel_interval=(*least[1:], *most[1:]),
        acceleration_interval=tuple(fastest[1:]),
        multiplier=multiplier,
    )


def _at_sensor(
    found: Identification, omega: Array, size: Array, force: ComplexArray
) -> tuple[ComplexArray, Array]:
    """Return the response at the sensor, background included, in phase with X of the mode, and its lag."""
    if (background := found.background) is None:
        return size.astype(np.complex128), np.angle(force) % (2 * np.pi)
    shape, values = background.shape(omega, np.abs(force)), background.values
    response = size + shape.receptance(values) * force
    return response, np.angle(force / shape.turn(values) / response) % (2 * np.pi)


def _branches(
    balance: AmplitudeBalance, level: float, span: tuple[float, float], window: tuple[float, float]
) -> list[tuple[Array, Array, ComplexArray]]:
    """Return omega, X and harmonics of a curve between amplitudes: up on the left, down on the right.

    Both sides meet at a peak; at the end of a modal table they do not.
    """
    blend = (1 - np.cos(np.linspace(0, np.pi, _BRANCH_POINTS))) / 2
    sizes = span[0] + (span[1] - span[0]) * blend
    (up, left, start), (down, right, end) = (_side(balance, level, sizes, side, window) for side in (-1, 1))
    omega, harmonics = np.concatenate([left, right[::-1]]), np.concatenate([start, end[::-1]])
    # a frequency that is not found leaves no end: its neighbours are joined
    known = np.isfinite(omega)
    omega, harmonics, size = omega[known], harmonics[known], np.concatenate([up, down[::-1]])[known]
    inside = (omega >= window[0]) & (omega <= window[1])
    cut = np.flatnonzero(np.diff(inside.astype(int)) != 0) + 1
    left_half, right_half = (np.interp(HALF_POWER * span[1], *of) for of in ((up, left), (down, right)))
    if abs(right[-1] - left[-1]) > _MAX_GAP_AT_PEAK * abs(right_half - left_half):
        cut = np.union1d(cut, [np.count_nonzero(known[: len(left)])])
    pieces = [rows for rows in np.split(np.arange(len(omega)), cut) if len(rows) > 1 and inside[rows[0]]]
    return [(omega[rows], size[rows], harmonics[rows]) for rows in pieces]


def _side(
    balance: AmplitudeBalance, level: float, sizes: Array, side: int, window: tuple[float, float]
) -> tuple[Array, Array, ComplexArray]:
    """Return X, omega and harmonics of a side of a curve: at sizes (n,) [m], folds, and edges of the window.

    Coarse sizes miss both. A fold is an extremum of omega over X, sharp next to a corner of the law.
    """
    columns = [(sizes, *balance.frequencies(sizes, level, side))]
    slope = np.diff(columns[0][1])
    for turn in np.flatnonzero(slope[:-1] * slope[1:] < 0) + 1:
        near = np.linspace(sizes[turn - 1], sizes[turn + 1], _BRANCH_POINTS)
        omega, harmonics = balance.frequencies(near, level, side)
        fold = [np.nanargmax(slope[turn - 1] * omega)]
        columns.append((near[fold], omega[fold], harmonics[fold]))
    sizes, omega, harmonics = _ascending(columns)
    beyond = omega - np.array(window)[:, None]
    which, low = np.nonzero(beyond[:, :-1] * beyond[:, 1:] < 0)
    edge, around = np.array(window)[which], (sizes[low], sizes[low + 1])
    found, _ = balance.newton_amplitude(np.full(len(low), level), edge, np.mean(around, axis=0))
    found = np.clip(found, *around)
    at = balance.solve(found, edge, harmonics[low])
    held = np.isclose(np.abs(at.force), level, rtol=1e-6, atol=0.0)
    return _ascending([(sizes, omega, harmonics), (found[held], edge[held], at.harmonics[held])])


def _ascending(columns: list[tuple[Array, Array, ComplexArray]]) -> tuple[Array, Array, ComplexArray]:
    """Return X, omega and harmonics by ascending X, each X once."""
    sizes, omega, harmonics = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    _, order = np.unique(sizes, return_index=True)
    return sizes[order], omega[order], harmonics[order]


def _respond(found: Identification, balance: AmplitudeBalance, surface: ResponseSurface) -> ComplexArray:
    """Return the predicted fundamental (n,) [m] at the sensor, on the branch nearest to the measured one."""
    if (background := found.background) is None:
        return balance.respond(surface)
    shape, values = background.shape(surface.omega, surface.force), background.values
    mode = shape.subtract(surface, values)
    if surface.across.size and (sensors := found.model.sensors):
        across = across_of_mode(surface.harmonics, surface.across, mode.harmonics, sensors)
        mode = replace(mode, across=across)
    return balance.respond(mode) + shape.receptance(values) * mode.force


def _score(
    identification: Identification,
    balance: AmplitudeBalance,
    surface: ResponseSurface,
    points: NDArray[np.bool_],
) -> tuple[HeldOutLevel, ...]:
    """Predict points (n,), mostly of held-out levels, and compare, a score for each level and sweep.

    Left out are points that did not settle, or have no force or motion; ``score_points`` leaves out a few
    at jumps.
    """
    chosen = points & surface.settled & (surface.amplitude > 0) & (np.abs(surface.force) > 0)
    scored = []
    forces = np.full(len(surface.levels), nan) if surface.response_held else typical_amounts(surface)
    for level in np.unique(surface.level[chosen]):
        for sweep in np.unique(surface.sweep[chosen & (surface.level == level)]):
            rows = np.flatnonzero(chosen & (surface.level == level) & (surface.sweep == sweep))
            rows = rows[np.argsort(surface.frequency[rows], kind="stable")]
            measured = surface.harmonics[rows, 1]
            predicted = _respond(identification, balance, surface.select(rows))
            # a phase that was not recorded is the predicted one
            turned = np.abs(measured) * np.exp(1j * np.nan_to_num(np.angle(predicted)))
            measured = np.where(np.isfinite(surface.phase[rows]), measured, turned)
            # points that are compared by their force, at their amplitudes, are on no other branch
            held = surface.decays or surface.response_held
            near = inf if held else BRANCH_DISTANCE
            by_law = not isinstance(balance, SynthesisBalance)
            error, largest, missing, worst = score_points(measured, predicted, near, by_law=by_law)
            # of another branch only a few points are scored
            known = surface.select(rows[np.abs(predicted - measured) <= near * np.abs(measured)])
            explained = balance.explained(known, identification.residual, held=held) if len(known) else nan
            scored.append(
                HeldOutLevel(
                    level=float(level),
                    sweep=str(sweep),
                    frequency=surface.frequency[rows],
                    measured=measured,
                    predicted=predicted,
                    error=error,
                    largest_error=largest,
                    level_unit=surface.level_unit,
                    force_unit=identification.curve.units.force,
                    force=float(forces[surface.levels == level][0]),
                    missing=missing,
                    explained=explained,
                    misfit=identification.residual,
                    largest_at=float(surface.frequency[rows[worst]]),
                    changes=not held and force_changes(surface.amplitude[rows], surface.force[rows]),
                    label=surface.label_of(level),
                )
            )
    return tuple(scored)


def predict_shown(table: ResponseSurface | MultisineSpectra, identification: Identification) -> Prediction:
    """Predict what a report shows of a test: some tested levels, those held out, and those asked for."""
    # of what identification has not seen; other spectra would count what it has seen as held out
    surface = None if isinstance(table, MultisineSpectra) else table
    return predict(identification, shown_levels(table, identification), surface)


def _asked_for(found: Identification, test: ResponseSurface | MultisineSpectra) -> list[Finding]:
    """State what the law predicts under the levels asked for, where it has curves."""
    asked = found.model.observation.predict
    if not asked or found.model.sensors or not isfinite(found.mass):
        return []
    band = (0.0, inf) if getattr(test, "decays", False) else found.frequency_range
    one_force = test if isinstance(test, ResponseSurface) else None
    sweeps = () if one_force is None or one_force.response_held else np.unique(one_force.sweep).tolist()
    predicted = predict(found, sorted({*asked}))
    said = [_with_swing(found, one, largest_of_curve(one, test.base, band, sweeps)) for one in predicted]
    said += [one for one in predicted.findings if "friction" in one.numbers]
    return said + levels_meant(found, predicted.curves, one_force)


def _with_swing(found: Identification, curve: ResonanceCurve, said: Finding) -> Finding:
    """Add the largest |displacement| [m] after a jump to a larger motion, where it is known."""
    far = [nan]
    for jump in curve.jumps if found.background is None else ():
        if jump.landing > jump.amplitude:
            at = np.flatnonzero((curve.frequency == jump.frequency) & (curve.amplitude == jump.amplitude))[0]
            start, way = jump.amplitude * np.exp(-1j * curve.phase[at]), (jump.frequency, jump.sweep)
            far.append(largest_after_jump(found.oscillator, curve.force, *way, start, jump.landing))
    swing = float(np.fmax.reduce(far))
    more = quantities("m", swing=swing) if isfinite(swing) else {}
    return replace(said, numbers={**said.numbers, **more})


def shown_levels(
    test: ResponseSurface | MultisineSpectra, identification: Identification
) -> list[float] | None:
    """Choose the levels of the curves that a report shows, as ``predict`` takes them.

    They are the amounts at the largest motions of at most five tested levels and of all held-out ones, and
    the levels that the observation asks for; of these none that was tested. None: no other than the default.
    """
    if identification.model.sensors:
        return None
    levels = np.array([])
    if isinstance(test, ResponseSurface) and test.response_held:
        # its levels are no forces; those that the resonances needed are
        levels = identification.levels
    elif isinstance(test, ResponseSurface):
        surface = within(test, identification.model.observation.band)
        held_out = surface.level[surface.held_out(identification.model.observation.hold_out)]
        chosen = np.isin(surface.levels, [*choose_levels(surface, 5), *held_out])
        levels = typical_amounts(surface)[chosen]
        if surface.base and not surface.per_mass:
            levels = levels / identification.mass
    levels = levels[np.isfinite(levels)]
    asked = identification.model.observation.predict
    new = [one for one in asked if np.all(np.abs(one / levels - 1) > RELATIVE_CHANGE_NEGLIGIBLE)]
    return sorted({*levels.tolist(), *new}) or None
