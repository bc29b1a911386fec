"""Findings about sweeps: their pace at resonances, other modes in the band, harmonics of the force."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.finding import Finding, Quantity
from rsgen.data.history.sensor import Kinematics

__all__ = [
    "SweptPoints",
    "distorted_forces",
    "faint_forces",
    "fast_sweeps",
    "free_motion",
    "most_by_pace",
    "other_modes",
]


_OTHER = 0.3
"""Another maximum this high, relative to the highest, is reported ..."""
_VALLEY = 0.5
"""... where the receptance falls to this fraction of it between the two."""
_APART = 0.04
"""Nearer to the highest maximum than this, relatively, another one is of the same mode."""
_HALF_POWER = 0.7
"""Points down to this fraction of the highest receptance are the resonance; a single point may be noise."""
_SLOW = 0.1
"""rate/(zeta f)^2 below which a sweep is slow: it shifts a resonance by less than 2 % of its half width."""
_FAST = 10.0
"""rate/(zeta f)^2 up to which the correction was proved (k(X) within 0.1 %, c(X) within 0.5 %)."""
_DISTORTED = 0.05
"""Harmonics of the force, relative to its fundamental, from which on they are reported."""

_SUDDEN = 0.15
"""A correction of the force up to this fraction of it is never called a free motion ..."""
_MORE = 2.0
"""... nor one of up to twice that which the pace asks for at the resonance of its sweep."""
_ASIDE = 0.2
"""Above this share of points set aside for one reason, what is left may not be the test that was meant."""


@dataclass(frozen=True, slots=True, eq=False)
class SweptPoints:
    """The n points of one sweep.

    ``force`` (n,) [N] and ``motion`` are of the fundamental, ``harmonics`` (n, H+1) the displacement [m],
    ``drive`` (n,) is the frequency of the force [Hz], ``rate`` (n,) how fast it changes [Hz/s], positive.
    ``flattened``, ``smoothed`` and ``unclear`` (n,) are the relative differences of A/X, of X and of the
    force between two windows, ``distortion`` the harmonics of the force over its fundamental; ``findings``
    are those about its force and response.
    """

    label: str
    level: float | None
    direction: str
    force: ComplexArray
    motion: Kinematics
    harmonics: ComplexArray
    drive: Array
    rate: Array
    flattened: Array
    smoothed: Array
    unclear: Array
    distortion: float
    findings: tuple[Finding, ...]

    def __len__(self) -> int:
        """Count the points."""
        return len(self.force)


def _sweep_by_sweep(
    parts: list[SweptPoints], steady: ComplexArray, good: NDArray[np.bool_]
) -> Iterator[tuple[SweptPoints, NDArray[np.intp], slice, Array]]:
    """Each sweep that has good points: which of its points, where it stands in all, and their receptance."""
    begin = 0
    for part in parts:
        here = slice(begin, begin + len(part))
        chosen = np.flatnonzero(good[here])
        if len(chosen):
            # of points that are not good the force may be next to nothing
            yield part, chosen, here, np.abs(part.motion.displacement[chosen] / steady[here][chosen])
        begin += len(part)


def fast_sweeps(
    parts: list[SweptPoints],
    steady: ComplexArray,
    damping: Array,
    good: NDArray[np.bool_],
    mass: float,
    origin: str,
) -> list[Finding]:
    """Judge the sweeps at their resonances: a finding about the fastest, none where all are slow.

    The points of all parts, one after the other, have the corrected force ``steady`` [N] and the damping c(X)
    [N s/m]; ``good`` ones are used. ``origin`` says where the mass [kg] is from.
    """
    worst, findings = _SLOW, []
    for part, chosen, here, size in _sweep_by_sweep(parts, steady, good):
        top = chosen[size > _HALF_POWER * size.max()]
        width = float(np.median(damping[here][top])) / (4 * pi * mass)
        rate = float(np.median(part.rate[top]))
        pace = rate / width**2 if width > 0 else np.inf
        if pace <= worst:
            continue
        worst = pace
        change = float(np.median(np.abs(part.force[top] / steady[here][top] - 1)))
        numbers = {
            "rate": Quantity(rate, "Hz/s"),
            "resonance": Quantity(float(np.median(part.drive[top])), "Hz"),
            "half_width": Quantity(width, "Hz"),
            "pace": Quantity(pace),
            "shift": Quantity(pace / (2 * pi)),
            "correction": Quantity(change),
            "mass": Quantity(mass, "kg"),
            "proved_up_to": Quantity(_FAST),
        }
        names = {"record": part.label, "direction": part.direction, "mass": origin}
        findings = [Finding("sweep-fast", "info" if pace <= _FAST else "warning", "", numbers, names)]
    return findings


def other_modes(parts: list[SweptPoints], steady: ComplexArray, good: NDArray[np.bool_]) -> list[Finding]:
    """Find another maximum of the receptance, in the first sweep that has one."""
    for part, chosen, _, size in _sweep_by_sweep(parts, steady, good):
        frequency = part.drive[chosen]
        order = np.argsort(frequency, kind="stable")
        frequency, size = frequency[order], size[order]
        top = int(np.argmax(size))
        for places in (np.arange(top, -1, -1), np.arange(top, len(size))):
            side = size[places]
            away = np.abs(frequency[places] / frequency[top] - 1) > _APART
            # the lowest place on the way out
            valley = np.minimum.accumulate(side)
            height = np.where(away & (side > _OTHER * size[top]) & (valley < _VALLEY * side), side, 0.0)
            if height.any():
                f = Quantity(float(frequency[places[int(np.argmax(height))]]), "Hz")
                return [Finding("another-maximum", "warning", "", {"frequency": f}, {"record": part.label})]
    return []


def distorted_forces(parts: list[SweptPoints]) -> list[Finding]:
    """Find the sweeps whose force is no sine."""
    return [
        Finding(
            "force-distorted", "info", "", {"harmonics": Quantity(part.distortion)}, {"record": part.label}
        )
        for part in parts
        if part.distortion > _DISTORTED
    ]


def _counted(parts: list[SweptPoints], marked: NDArray[np.bool_]) -> dict[str, Quantity]:
    """Count the marked points of all parts, and say where they are."""
    frequency = np.concatenate([part.drive for part in parts])[marked]
    return {
        "aside": Quantity(float(np.count_nonzero(marked))),
        "points": Quantity(len(marked)),
        "low": Quantity(float(frequency.min()), "Hz"),
        "high": Quantity(float(frequency.max()), "Hz"),
    }


def most_by_pace(
    parts: list[SweptPoints], correction: Array, steady: ComplexArray, good: NDArray[np.bool_]
) -> Array:
    """Find the largest correction (n,), relative to the force, that the pace of each sweep explains.

    The correction of the good points around the resonance is what the pace asks for; a jump asks for more.
    """
    most = np.full(len(good), _SUDDEN)
    for _, chosen, here, size in _sweep_by_sweep(parts, steady, good):
        top = chosen[size > _HALF_POWER * size.max()]
        most[here] = max(_SUDDEN, _MORE * float(np.median(correction[here][top])))
    return most


def free_motion(parts: list[SweptPoints], free: NDArray[np.bool_]) -> list[Finding]:
    """Count the points whose motion is mainly a free one, as after a jump."""
    if not free.any():
        return []
    many = np.mean(free) > _ASIDE
    return [Finding("motion-mainly-free", "doubt" if many else "info", "", _counted(parts, free))]


def faint_forces(parts: list[SweptPoints], faint: NDArray[np.bool_]) -> list[Finding]:
    """Count the points at which the force does not stand out of its noise."""
    if not faint.any():
        return []
    many = np.mean(faint) > _ASIDE
    return [Finding("force-in-noise", "doubt" if many else "info", "", _counted(parts, faint))]
