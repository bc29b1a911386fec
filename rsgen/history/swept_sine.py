"""Swept sine to a response surface: envelopes against the phase of the sweep, its own dynamics taken out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from rsgen.errors import MeasurementError
from rsgen.finding import Finding, Quantity
from rsgen.history.envelope import NOISE_WIDTH, Windows, demodulate, place_windows
from rsgen.history.levels import name_levels
from rsgen.history.quasi_steady import estimate_mass, steady_force
from rsgen.history.record import TimeHistory
from rsgen.history.sensor import Motion, displace
from rsgen.history.sweep_law import SweepLaw
from rsgen.history.tracking import Sweep, find_sweeps
from rsgen.surface import OUTCOMES, ResponseSurface

__all__ = ["demodulate_sweep"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

PERIODS = 10.0
"""Window of the demodulation in periods: the shortest whose taper keeps the harmonics apart by 100 dB."""

POINTS = 400
"""Rows of a sweep; more only repeat what the neighbours say and make every later stage slower."""

HARMONICS = 5

_NYQUIST = 0.45
"""Harmonics up to this fraction of the sampling rate are taken."""

_WIDER = 1.5
"""A second window, wider by this factor, shows what the first one flattens."""

_FLATTENED = 0.02
"""Largest relative difference of the acceleration between the two windows of a point that is used."""

_ASKED = 0.1
"""Largest difference of the force that the two windows ask for, relative to the force, of such a point."""

_TOLD = 0.1
"""Relative standard error up to which the mass from the sweeps themselves is used."""

_OVER = 1.0
"""Largest correction of a force that is used, relative to it: beyond, the motion is a free one above all."""

_ENOUGH = 16
"""Points at resonances from which a mass is looked for."""

_FLANK = 0.2
"""Points belong to a resonance down to this fraction of its receptance."""

_OTHER = 0.3
"""Another maximum this high, relative to the highest, is told; between the two it must fall to half of it."""

_APART = 0.04
"""Nearer to the highest one, relatively, it is the same mode."""

_ONE_MODE = 0.15
"""Misfit of one mode, relative to the force, up to which the sweep is corrected as one mode asks for."""

_SLOW = 0.1
"""rate/(zeta f)^2 below which a sweep is slow: it shifts a resonance by less than 2 % of its half width."""

_FAST = 10.0
"""rate/(zeta f)^2 up to which the correction was proved (k(X) within 0.1 %, c(X) within 0.5 %)."""

_DISTORTED = 0.05
_PASSED = len(OUTCOMES) - 1


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """What one sweep gives: fundamental of force and motion, harmonics of the displacement, rate [Hz/s]."""

    history: TimeHistory
    direction: str
    force: ComplexArray
    motion: Motion
    harmonics: ComplexArray
    rate: Array
    flattened: Array
    smoothed: Array
    distortion: float


def _choose_windows(
    history: TimeHistory,
    sweep: Sweep,
    band: tuple[float, float] | None,
    bandwidth: float | None,
    orders: int,
    points: int,
) -> tuple[Windows, Windows]:
    law, rate = sweep.law, history.rate
    begin, end = sweep.begin, sweep.end
    if band is not None:
        edges = sorted(law.time_of(f) for f in band)
        begin, end = max(begin, edges[0]), min(end, edges[1])
    if not end > begin:
        raise MeasurementError(
            f"{history.label}: the sweep does not pass the band {band[0]:g} to {band[1]:g} Hz"
            if band
            else f"{history.label}: the sweep is too short"
        )

    def length(t: Array) -> Array:
        f = law.frequency_at(t)
        return np.asarray(np.full_like(f, NOISE_WIDTH / bandwidth) if bandwidth else PERIODS / f)

    # as dense as they are independent, then thinned evenly
    dense = np.linspace(begin, end, 20_001)
    count = np.concatenate([[0.0], np.cumsum(np.diff(dense) * NOISE_WIDTH / length(dense)[1:])])
    number = int(min(max(count[-1], 2), points))
    t = np.interp(np.linspace(0, count[-1], number), count, dense)
    period = rate / law.frequency_at(t)
    size = len(history)
    # only places where both fit
    margin = _WIDER * length(t) / 2 + 2 / law.frequency_at(t)
    inside = (t > margin) & (t < size / rate - margin)
    t, period = t[inside], period[inside]
    if not len(t):
        raise MeasurementError(f"{history.label}: too short for a window of {PERIODS:g} periods")
    wide = place_windows(t * rate, _WIDER * length(t) * rate, period, 1, size)
    return place_windows(t * rate, length(t) * rate, period, orders, size), wide


def _demodulate_one(
    history: TimeHistory,
    sweep: Sweep,
    band: tuple[float, float] | None,
    bandwidth: float | None,
    harmonics: int,
    points: int,
) -> _Rows:
    law, rate = sweep.law, history.rate
    highest = float(law.frequency_at(np.array([sweep.begin, sweep.end])).max())
    if band is not None:
        highest = min(highest, band[1])
    reach = max(1, min(harmonics, int(_NYQUIST * rate / highest)))
    narrow, wide = _choose_windows(history, sweep, band, bandwidth, reach, points)
    derive = np.array([1.0, rate, rate**2])

    def phase(i: Array) -> Array:
        return law.phase_at(i / rate)

    def motion(windows: Windows, envelope: ComplexArray, order: int) -> Motion:
        t = windows.middle / rate
        return displace(
            envelope, order * 2 * pi * law.frequency_at(t), order * 2 * pi * law.slope_at(t), history.quantity
        )

    force = demodulate(history.reference, phase, narrow, (1, 2, 3) if reach >= 3 else (1,))[:, :, 0]
    orders = tuple(range(reach + 1)) if history.quantity == "displacement" else tuple(range(1, reach + 1))
    envelope = demodulate(history.response, phase, narrow, orders) * derive
    first = orders.index(1)
    fundamental = motion(narrow, envelope[:, first], 1)
    wider = motion(wide, demodulate(history.response, phase, wide, (1,))[:, 0] * derive, 1)
    table = np.full((len(narrow), harmonics + 1), np.nan, dtype=complex)
    t = narrow.middle / rate
    power = {"displacement": 0, "velocity": 1, "acceleration": 2}[history.quantity]
    for column, order in enumerate(orders):
        if order == 0:
            table[:, 0] = envelope[:, column, 0].real
        elif order == 1:
            table[:, 1] = fundamental.displacement
        else:
            table[:, order] = envelope[:, column, 0] / (2j * pi * order * law.frequency_at(t)) ** power
    # unknown where nothing moved, as in a drop-out
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = fundamental.acceleration / fundamental.displacement
        flattened = np.abs(wider.acceleration / wider.displacement - ratio) / np.abs(ratio)
        smoothed = np.abs(wider.displacement / fundamental.displacement - 1)
    return _Rows(
        history=history,
        direction=law.direction,
        force=force[:, 0],
        motion=fundamental,
        harmonics=table,
        rate=np.abs(law.slope_at(t)),
        flattened=flattened,
        smoothed=smoothed,
        distortion=float(np.median(np.linalg.norm(force[:, 1:], axis=1) / np.abs(force[:, 0]))),
    )


def demodulate_sweep(
    histories: TimeHistory | Sequence[TimeHistory],
    *,
    band: tuple[float, float] | None = None,
    law: SweepLaw | str | None = None,
    bandwidth: float | None = None,
    harmonics: int = HARMONICS,
    points: int = POINTS,
    mass: float | None = None,
) -> ResponseSurface:
    """Turn swept-sine time histories of one structure into a response surface.

    Every history may hold several sweeps, up and down, at several levels. The frequency of a row is that of
    the steady motion with the same acceleration, and its force is the measured one less what the sweep itself
    asked for (``quasi_steady``), where the mass is given or told by the sweeps; else it is as measured.

    Parameters
    ----------
    histories
        One or several.
    band
        (lowest, highest) frequency [Hz] of the rows; everything where None.
    law
        The sweep law if known, or its kind "linear" or "logarithmic"; otherwise found from the force.
    bandwidth
        Of the demodulation [Hz]; where None, ten periods of the force are seen at a time, which is 0.36 f.
    harmonics
        Highest harmonic of the displacement; those above 0.45 of the sampling rate come as NaN.
    points
        Most rows a sweep.
    mass
        Moving mass [kg] if known.

    Raises
    ------
    MeasurementError
        No force, no sweep, an empty band, a bandwidth that does not keep the harmonics apart.
    """
    several = [histories] if isinstance(histories, TimeHistory) else list(histories)
    if not several:
        raise MeasurementError("swept sine: no time history; at least one is needed")
    given = law if isinstance(law, SweepLaw) else None
    kind = law if isinstance(law, str) else None
    rows = []
    for history in several:
        for sweep in find_sweeps(history, given, kind):
            lowest = float(sweep.law.frequency_at(np.array([sweep.begin, sweep.end])).min())
            lowest = max(lowest, band[0]) if band else lowest
            if bandwidth is not None and not 0 < bandwidth <= NOISE_WIDTH / 8 * lowest:
                raise MeasurementError(
                    f"{history.label}: bandwidth {bandwidth:g} Hz; must be above 0 and at most "
                    f"{NOISE_WIDTH / 8 * lowest:.3g} Hz, or harmonics of {lowest:.3g} Hz mix"
                )
            rows.append(_demodulate_one(history, sweep, band, bandwidth, harmonics, points))
    return _surface(rows, mass)


def _surface(rows: list[_Rows], mass: float | None) -> ResponseSurface:
    force = np.concatenate([r.force for r in rows])
    motion = Motion(*(np.concatenate([getattr(r.motion, k) for r in rows]) for k in Motion.__slots__))
    flattened = np.concatenate([r.flattened for r in rows])
    loud = np.abs(force) > 1e-3 * np.median(np.abs(force))
    omega = motion.omega
    usable = loud & np.isfinite(flattened) & (omega > 0) & np.isfinite(motion.displacement)
    good = usable & (flattened < _FLATTENED)
    findings: list[Finding] = []
    known = mass
    picked = np.flatnonzero(_resonances(rows, good))
    if mass is None and len(picked) >= _ENOUGH:
        found = estimate_mass(force[picked], Motion(*(getattr(motion, k)[picked] for k in Motion.__slots__)))
        if found and found.misfit > _ONE_MODE:
            found = None
        if found and 0 < found.standard_error < _TOLD * abs(found.mass):
            known = found.mass
    steady = force
    if known is not None:
        steady, damping = steady_force(force, motion, known)
        steady = np.where(usable, steady, force)
        asked = np.abs(known * flattened * motion.acceleration)
        good &= asked < _ASKED * np.maximum(np.abs(force), np.abs(steady))
        good &= np.abs(steady - force) < _OVER * np.abs(force)
        findings += _pace(rows, force, steady, motion, damping, good, known, mass is not None)
    else:
        findings.append(Finding("sweep-not-corrected", "warning"))
    findings += _other_mode(rows, steady, motion, good)
    findings += _distortions(rows)
    level = name_levels([(r.history.level, float(np.median(np.abs(r.force)))) for r in rows])
    count = [len(r.force) for r in rows]
    frequency = np.where(omega > 0, omega, np.nan) / (2 * pi)
    kept = np.isfinite(frequency)
    return ResponseSurface(
        level=np.repeat(level, count)[kept],
        frequency=frequency[kept],
        force=steady[kept],
        harmonics=np.concatenate([r.harmonics for r in rows])[kept],
        sweep=np.repeat([r.direction for r in rows], count)[kept],
        outcome=np.where(good, 0, _PASSED)[kept],
        error=np.concatenate([r.smoothed for r in rows])[kept],
        findings=tuple(findings),
    )


def _resonances(rows: list[_Rows], good: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mark the points around the highest receptance of each sweep."""
    marked, begin = np.zeros(len(good), dtype=bool), 0
    for r in rows:
        part = begin + np.flatnonzero(good[begin : begin + len(r.force)])
        size = np.abs(r.motion.displacement / r.force)[part - begin]
        begin += len(r.force)
        if len(part):
            top = int(np.argmax(size))
            low = np.flatnonzero(size < _FLANK * size[top])
            left = int(np.max(low[low < top], initial=-1))
            right = int(np.min(low[low > top], initial=len(size)))
            marked[part[left + 1 : right]] = True
    return marked


def _other_mode(
    rows: list[_Rows], steady: ComplexArray, motion: Motion, good: NDArray[np.bool_]
) -> list[Finding]:
    """Find another maximum of the receptance, in the first sweep that has one."""
    begin = 0
    for r in rows:
        part = begin + np.flatnonzero(good[begin : begin + len(r.force)])
        begin += len(r.force)
        if not len(part):
            continue
        part = part[np.argsort(motion.omega[part], kind="stable")]
        size = np.abs(motion.displacement[part] / steady[part])
        top = int(np.argmax(size))
        for places in (np.arange(top, -1, -1), np.arange(top, len(size))):
            side = size[places]
            away = np.abs(motion.omega[part[places]] / motion.omega[part[top]] - 1) > _APART
            # the lowest place on the way out
            valley = np.minimum.accumulate(side)
            height = np.where(away & (side > _OTHER * size[top]) & (valley < side / 2), side, 0.0)
            if height.any():
                f = motion.omega[part[places[int(np.argmax(height))]]] / (2 * pi)
                return [
                    Finding(
                        "another-maximum",
                        "warning",
                        numbers={"frequency": Quantity(float(f), "Hz")},
                        names={"record": r.history.label},
                    )
                ]
    return []


def _pace(
    rows: list[_Rows],
    force: ComplexArray,
    steady: ComplexArray,
    motion: Motion,
    damping: Array,
    good: NDArray[np.bool_],
    mass: float,
    given: bool,
) -> list[Finding]:
    """Judge the sweeps at their resonances: a finding about the fastest, none where all are slow."""
    worst, findings = _SLOW, []
    begin = 0
    for r in rows:
        part = slice(begin, begin + len(r.force))
        begin += len(r.force)
        seen = np.flatnonzero(good[part])
        if not len(seen):
            continue
        # the upper part of the receptance is the resonance; single points may be noise
        size = np.abs(motion.displacement[part] / steady[part])[seen]
        top = seen[size > 0.7 * size.max()]
        width = float(np.median(damping[part][top])) / (4 * pi * mass)
        f = float(np.median(motion.omega[part][top])) / (2 * pi)
        rate = float(np.median(r.rate[top]))
        pace = rate / width**2 if width > 0 else np.inf
        if pace <= worst:
            continue
        worst = pace
        change = float(np.median(np.abs(force[part][top] / steady[part][top] - 1)))
        findings = [
            Finding(
                "sweep-fast",
                "info" if pace <= _FAST else "warning",
                numbers={
                    "rate": Quantity(rate, "Hz/s"),
                    "resonance": Quantity(f, "Hz"),
                    "half_width": Quantity(width, "Hz"),
                    "pace": Quantity(pace),
                    "shift": Quantity(pace / (2 * pi)),
                    "correction": Quantity(change),
                    "mass": Quantity(mass, "kg"),
                    "proved_up_to": Quantity(_FAST),
                },
                names={
                    "record": r.history.label,
                    "direction": r.direction,
                    "mass": "given" if given else "from the sweeps themselves",
                },
            )
        ]
    return findings


def _distortions(rows: list[_Rows]) -> list[Finding]:
    return [
        Finding(
            "force-distorted",
            "info",
            numbers={"harmonics": Quantity(r.distortion)},
            names={"record": r.history.label},
        )
        for r in rows
        if r.distortion > _DISTORTED
    ]
