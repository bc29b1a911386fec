"""Swept sine to a response surface: envelopes against the phase of the sweep, its transient subtracted."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import MeasurementError
from rsgen.common.tolerances import RELATIVE_ERROR_DOUBTFUL, SUBSAMPLE_POINTS
from rsgen.data.free_mode import MIN_RELATIVE_FORCE, FreeMode, Kinematics, estimate_mass
from rsgen.data.history.envelope import (
    HARMONICS,
    MAX_FLANK_AMPLITUDE,
    NOISE_WIDTH,
    WINDOW_PERIODS,
    Windows,
    demodulate,
    differentiate,
    displacement_harmonics,
    flank_mass,
    highest_order,
    independent_instants,
    mean_square,
    place_windows,
    steady_force,
)
from rsgen.data.history.record import (
    TimeHistory,
    as_histories,
    check_force,
    check_options,
    check_response,
    name_levels,
)
from rsgen.data.history.tracking import (
    MovingMass,
    Sweep,
    SweepLaw,
    SweptPoints,
    excluded_points,
    fast_sweeps,
    find_sweeps,
    most_by_pace,
    sweep_by_sweep,
)
from rsgen.data.surface.mode_findings import MASS_IN_OTHER_UNIT
from rsgen.data.surface.response_surface import Outcome, ResponseSurface

_WIDE_WINDOW = 1.5
"""Length of a second window over the first; the difference shows how far the first flattens a peak."""
_MAX_FLATTENING = 0.02
"""Relative difference of the acceleration between the two windows of a point that is used."""
_MAX_DIFFERENCE_OF_FORCES = RELATIVE_ERROR_DOUBTFUL
"""Relative difference of the force between the two windows of a point that is used: more is noise."""
_MAX_BLUR = RELATIVE_ERROR_DOUBTFUL
"""Inertia by the difference of the acceleration between the two windows, relative to the force, of a point
that is used."""
_MAX_CORRECTION = 1.0
"""Correction over the measured and the corrected force; a larger one is mainly a free motion."""
_MAX_MISFIT_ONE_MODE = 0.15
"""Of one mode, relative to the force, with which a sweep is corrected by one mode."""
_MAX_MASS_RATIO = 1.5
"""Of the masses from the sweep and from its flanks; the latter is good to 20 %."""
_MAX_CORRECTION_BY_FLANKS = 0.3
"""Correction over the force with a mass from the flanks: its error is below a tenth of the force."""

_Outcomes = NDArray[np.int_]
"""An ``Outcome`` for every point."""


def from_swept_sine(
    histories: TimeHistory | Sequence[TimeHistory],
    *,
    band: tuple[float, float] | None = None,
    law: SweepLaw | str | None = None,
    bandwidth: float | None = None,
    harmonics: int = HARMONICS,
    points: int = SUBSAMPLE_POINTS,
    mass: float | None = None,
) -> ResponseSurface:
    """Turn swept-sine time histories of one structure into a response surface.

    Every history may hold several sweeps, up and down, at several levels. The frequency of a point is that of
    the force, not that of a free motion after a jump. The force becomes that of a steady motion where the
    mass is given or the sweeps determine it (``envelope.steady_force``). A point whose motion is mainly a
    free one, and one whose force is below its noise, is not settled.

    Parameters
    ----------
    histories
        One or several.
    band
        (lowest, highest) frequency [Hz] of the points; everything where None.
    law
        The sweep law, or its kind "linear" or "logarithmic"; None: found from the force.
    bandwidth
        Of the demodulation [Hz]; None: windows of ten periods of the force, 0.36 f, the widest possible.
    harmonics
        Highest harmonic of the displacement; those above 0.45 of the sampling rate come as NaN.
    points
        Most points a sweep: more are correlated with their neighbours and make every later stage slower.
    mass
        Moving mass [kg] if known.

    Raises
    ------
    MeasurementError
        No force, no sweep, an empty band, a bandwidth that mixes the harmonics.

    Examples
    --------
    A receptance of 1 um/N at all frequencies:

    >>> t = np.arange(0, 100, 1 / 400)
    >>> force = 3 * np.cos(2 * np.pi * (5 + 0.05 * t) * t)
    >>> surface = from_swept_sine(TimeHistory(400, force, 1e-6 * force))
    >>> surface.levels.tolist(), surface.sweep[0].item(), float(surface.amplitude.max().round(9))
    ([3.0], 'up', 3e-06)
    """
    several = as_histories(histories, "swept sine")
    check_options(several[0].label, band=band, mass=mass, harmonics=harmonics, points=points)
    rule = _Rule(band, bandwidth, harmonics, points)
    parts = [_demodulated(one, sweep, rule) for one in several for sweep in find_sweeps(one, law)]
    return _surface(parts, mass)


class _Rule(NamedTuple):
    """How a sweep is demodulated, as ``from_swept_sine`` is told."""

    band: tuple[float, float] | None
    bandwidth: float | None
    harmonics: int
    points: int


def _windows(history: TimeHistory, sweep: Sweep, rule: _Rule, orders: int) -> tuple[Windows, Windows]:
    """Return the windows of a sweep, and wider ones for the fundamental."""
    band, bandwidth = rule.band, rule.bandwidth
    law, rate, size = sweep.law, history.rate, len(history)
    begin, end = sweep.begin, sweep.end
    if band is not None:
        edges = sorted(law.time_of(f) for f in band)
        begin, end = max(begin, edges[0]), min(end, edges[1])
    if not end > begin:
        fault = f"does not pass the band {band[0]:g} to {band[1]:g} Hz" if band else "is too short"
        raise MeasurementError(f"{history.label}: the sweep {fault}")
    passed = law.frequency_at(np.array([begin, end]))
    widest = NOISE_WIDTH / WINDOW_PERIODS * float(passed.min())
    if bandwidth is not None and not 0 < bandwidth <= widest:
        raise MeasurementError(
            f"{history.label}: bandwidth {bandwidth:g} Hz; must be above 0 and at most {widest:.3g} Hz, or "
            f"harmonics of {passed.min():.3g} Hz mix"
        )

    def length(t: Array) -> Array:
        f = law.frequency_at(t)
        return np.asarray(np.full_like(f, NOISE_WIDTH / bandwidth) if bandwidth else WINDOW_PERIODS / f)

    t = independent_instants(length, begin, end, rule.points)
    # both windows inside the record, and two periods more
    margin = _WIDE_WINDOW * length(t) / 2 + 2 / law.frequency_at(t)
    t = t[(t > margin) & (t < size / rate - margin)]
    if not len(t):
        raise MeasurementError(f"{history.label}: too short for a window of {WINDOW_PERIODS:g} periods")
    period = rate / law.frequency_at(t)
    wide = place_windows(t * rate, _WIDE_WINDOW * length(t) * rate, period, 1, size)
    return place_windows(t * rate, length(t) * rate, period, orders, size), wide


def _demodulated(history: TimeHistory, sweep: Sweep, rule: _Rule) -> SweptPoints:
    """Return the points of a sweep: harmonics of force and response in windows along the known phase.

    Narrow windows resolve a resonance; wide ones, with less noise, say how far narrow ones flatten it.
    """
    law, rate = sweep.law, history.rate
    highest = float(law.frequency_at(np.array([sweep.begin, sweep.end])).max())
    reach = highest_order(rule.harmonics, rate, min(highest, rule.band[1]) if rule.band else highest)
    narrow, wide = _windows(history, sweep, rule, reach)

    def kinematics(windows: Windows, envelope: ComplexArray) -> Kinematics:
        t = windows.middle / rate
        omega, slope = 2 * pi * law.frequency_at(t), 2 * pi * law.slope_at(t)
        return differentiate(envelope, 1j * omega, 1j * slope, history.quantity)

    orders = (0, 1, 2, 3) if reach >= 3 else (0, 1)
    driven = demodulate(history.reference, rate, law.phase_at, narrow, orders)[:, :, 0]
    force = driven[:, 1]
    steadier = demodulate(history.reference, rate, law.phase_at, wide, (1,))[:, 0, 0]
    envelope = demodulate(history.response, rate, law.phase_at, narrow, tuple(range(reach + 1)))
    motion = kinematics(narrow, envelope[:, 1])
    wider = kinematics(wide, demodulate(history.response, rate, law.phase_at, wide, (1,))[:, 0])
    # without the means, which are no vibration: many sensors have an offset
    fed, fed_at_lines = _power(history.reference, narrow, driven)
    power, line = _power(history.response, narrow, envelope[:, :, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        share = fed_at_lines / fed
    findings = check_force(history, share[np.isfinite(share)]) if np.isfinite(share).any() else []
    findings += check_response(history, line, power)
    t = narrow.middle / rate
    omega = 2 * pi * law.frequency_at(t)
    table = displacement_harmonics(envelope[:, :, 0], omega, history.quantity, rule.harmonics)
    table[:, 1] = motion.displacement
    return SweptPoints(
        label=history.label,
        level=history.level,
        direction=law.direction,
        force=force,
        motion=motion,
        harmonics=table,
        drive=law.frequency_at(t),
        rate=np.abs(law.slope_at(t)),
        **_effects_of_windows(motion, wider, force, steadier),
        findings=tuple(findings),
    )


def _power(signal: NDArray[Any], windows: Windows, harmonics: ComplexArray) -> tuple[Array, Array]:
    """Return the power in windows (n,) without that of the mean, and at the harmonics (n, 1 + orders)."""
    line = np.sum(np.abs(harmonics[:, 1:]) ** 2, axis=1) / 2
    return np.maximum(mean_square(signal, windows) - np.abs(harmonics[:, 0]) ** 2, line), line


def _effects_of_windows(
    motion: Kinematics, wider: Kinematics, force: ComplexArray, steadier: ComplexArray
) -> dict[str, Array]:
    """Return by how much motion and force in narrow windows differ from those in wide ones, relative (n,)."""
    # NaN where nothing moves, as in a drop-out
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        ratio = motion.acceleration / motion.displacement
        return {
            "flattened": np.abs(wider.acceleration / wider.displacement - ratio) / np.abs(ratio),
            "smoothed": np.abs(wider.displacement / motion.displacement - 1),
            "unclear": np.abs(steadier / force - 1),
        }


def _surface(parts: list[SweptPoints], mass: float | None) -> ResponseSurface:
    """Return the points of all sweeps as steady states: the force is corrected for the motion's change.

    A motion whose amplitude and frequency change needs another force than a steady one (``steady_force``),
    which depends on the moving mass. A point that is excluded has its reason as its outcome.
    """

    def column(name: str) -> ComplexArray:
        return np.concatenate([getattr(part, name) for part in parts])

    force, flattened = column("force"), column("flattened").real
    motion = Kinematics.joined([part.motion for part in parts])
    omega = 2 * pi * column("drive").real
    outcome = _by_windows(force, motion, flattened, column("unclear").real)
    moving = _moving_mass(parts, force, motion, outcome == Outcome.SETTLED)
    own = moving.value if moving and moving.good_to == _MAX_CORRECTION else mass
    if mass is not None and own is not None and abs(np.log(own / mass)) < np.log(MASS_IN_OTHER_UNIT):
        moving = MovingMass(mass, "given", _MAX_CORRECTION)
    steady, damping = force, None
    if moving is not None:
        steady, damping = steady_force(force, motion, moving.value, omega)
        steady = np.where(outcome == Outcome.DROPPED_OUT, force, steady)
        outcome = _by_correction(parts, steady, motion, moving, outcome)
    findings = [finding for part in parts for finding in part.findings]
    findings += fast_sweeps(parts, steady, outcome == Outcome.SETTLED, moving, damping)
    for reason, words in _EXCLUDED.items():
        findings += excluded_points(parts, outcome == reason, words)
    count = [len(part) for part in parts]
    level = name_levels([(part.level, float(np.median(np.abs(part.force)))) for part in parts])
    return ResponseSurface(
        level=np.repeat(level, count),
        frequency=omega / (2 * pi),
        force=steady,
        harmonics=column("harmonics"),
        sweep=np.repeat([part.direction for part in parts], count),
        outcome=outcome,
        error=column("smoothed").real,
        findings=tuple(findings),
        overlapping=True,
    )


_EXCLUDED = {
    Outcome.DROPPED_OUT: "drop-out",
    Outcome.FORCE_IN_NOISE: "noise of the force",
    Outcome.FREE_MOTION: "free motion",
}
"""Outcomes of which a finding counts the points, by its word for them; of the others ``identify`` does."""


def _by_windows(force: ComplexArray, motion: Kinematics, flattened: Array, unclear: Array) -> _Outcomes:
    """Return the ``Outcome`` (n,) of points by what the windows hold, and by how two windows differ."""
    loud = np.abs(force) > MIN_RELATIVE_FORCE * np.median(np.abs(force))
    moves = np.isfinite(flattened) & np.isfinite(motion.displacement)
    faults = {
        Outcome.DROPPED_OUT: ~(loud & moves),
        Outcome.FORCE_IN_NOISE: ~(unclear < _MAX_DIFFERENCE_OF_FORCES),
        Outcome.SWEPT_TOO_FAST: flattened >= _MAX_FLATTENING,
    }
    return np.select(list(faults.values()), list(faults), Outcome.SETTLED)


def _by_correction(
    parts: list[SweptPoints], steady: ComplexArray, motion: Kinematics, mass: MovingMass, outcome: _Outcomes
) -> _Outcomes:
    """Return the ``Outcome`` (n,) of points by the correction of their force to ``steady`` (n,) [N], too."""
    force, flattened = (np.concatenate([getattr(p, name) for p in parts]) for name in ("force", "flattened"))
    size = np.maximum(np.abs(force), np.abs(steady))
    blurred = ~(np.abs(mass.value * flattened * motion.acceleration) < _MAX_BLUR * size)
    outcome = np.where((outcome == Outcome.SETTLED) & blurred, Outcome.SWEPT_TOO_FAST, outcome)
    correction, good = np.abs(steady - force) / np.where(size > 0, size, 1.0), outcome == Outcome.SETTLED
    free = correction >= np.minimum(mass.good_to, most_by_pace(parts, correction, steady, good))
    return np.where(good & free, Outcome.FREE_MOTION, outcome)


def _moving_mass(
    parts: list[SweptPoints], force: ComplexArray, motion: Kinematics, good: NDArray[np.bool_]
) -> MovingMass | None:
    """Return the moving mass from the points at resonances, else from the flanks; None if not determined."""
    flank = flank_mass(force[good], motion.select(good))
    if flank is not None and (_typical(flank) > _MAX_MISFIT_ONE_MODE or not flank.mass > 0):
        flank = None
    picked = np.flatnonzero(_resonances(parts, force, good))
    found = estimate_mass(force[picked], motion.select(picked))
    if (
        found is not None
        and _typical(found) < _MAX_MISFIT_ONE_MODE
        and 0 < found.mass_error < RELATIVE_ERROR_DOUBTFUL * found.mass
        and (flank is None or 1 / _MAX_MASS_RATIO < found.mass / flank.mass < _MAX_MASS_RATIO)
    ):
        difference = 0.0 if flank is None else abs(found.mass / flank.mass - 1)
        return MovingMass(found.mass, "from the sweeps themselves", _MAX_CORRECTION, difference)
    if flank is None:
        return None
    return MovingMass(flank.mass, "from the flanks of the resonance", _MAX_CORRECTION_BY_FLANKS)


def _typical(found: FreeMode) -> float:
    """Return the median misfit, relative to the force."""
    return float(np.median(np.abs(found.left)))


def _resonances(parts: list[SweptPoints], force: ComplexArray, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (n,) True for the points around the highest receptance of each sweep."""
    marked = np.zeros(len(good), dtype=bool)
    for _, chosen, here, size in sweep_by_sweep(parts, force, good):
        top = int(np.argmax(size))
        low = np.flatnonzero(size < MAX_FLANK_AMPLITUDE * size[top])
        left = int(np.max(low[low < top], initial=-1))
        right = int(np.min(low[low > top], initial=len(size)))
        marked[here.start + chosen[left + 1 : right]] = True
    return marked
