"""What the test does not tell, and why, in sentences; never a number with false digits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.data import Points
from rsgen.identification.fit import Fit
from rsgen.identification.least_squares import Regression
from rsgen.identification.result import Estimate, Resonance
from rsgen.law.numeric import ForceLaw
from rsgen.surface import ResponseSurface

__all__ = ["find_warnings", "untold_reason"]

_NOT_ZERO = 0.5
"""A standard error beyond this share of the value: the parameter cannot be told from zero."""

_STRONG = 0.05
"""Higher harmonics beyond this share of the fundamental bias every first-order estimate."""

_DRIFT = 0.02
_SYSTEMATIC = 0.3
"""Correlation of neighbouring misfits, or share of them, that is the law's, not the noise's."""

_CHANCE = 4.0
"""Standard deviations within which chance may bring such a correlation."""

_REACH = 5.0

_NOTICEABLE = 1e-3

_NO_PHASE = (
    "phase not recorded: only amplitudes were fitted; damping is taken as positive, k(X) and c(X) of single "
    "points rest on the phase that the law says, and a law that is wrong in phase is not seen to be"
)
_NO_SCALE = (
    "arbitrary scale: force or response are not calibrated, so m and every parameter are per unit of the "
    "drive and of the response; frequencies and damping ratios hold as they are"
)

_WHOLE = 0.99
"""A direction that is not told has length one; what the parameters do not make up, the background does."""

_FEW = 5


def untold_reason(name: str, law: ForceLaw, points: Points, regression: Regression, mass_free: bool) -> str:
    """Say why a parameter is not told by the test, or "" where it is."""
    names = (*law.parameters, "m") if mass_free else law.parameters
    i = names.index(name)
    highest = float(points.level.max())
    largest = float(points.amplitude.max())
    tested = f"X up to {_length(largest)}, levels up to {highest:.3g} N"
    weight = np.abs(regression.null[i]) if regression.null.shape[1] else np.zeros(1)
    if weight.max(initial=0.0) > 1e-3:
        column = int(np.argmax(weight))
        partners = [
            other for j, other in enumerate(names) if j != i and abs(regression.null[j, column]) > 1e-3
        ]
        if not partners and float(np.linalg.norm(regression.null[:, column])) < _WHOLE:
            return f"{name}: only a combination with the background is told; test wider or fit less of it"
        if not partners:
            return (
                f"{name}: the response does not depend on it in the tested range ({tested}); "
                "raise the level until it does"
            )
        return (
            f"{name}: only a combination with {', '.join(partners)} is told; give one of them, or test wider"
        )
    variance = float(regression.covariance[i, i])
    value = float(regression.parameters[i])
    if np.isfinite(variance) and np.sqrt(variance) > _NOT_ZERO * abs(value):
        return (
            f"{name}: {value:.2g} with standard error {np.sqrt(variance):.2g} cannot be told from zero "
            f"({tested}); raise the level or take more points near the resonance"
        )
    return ""


def find_warnings(
    surface: ResponseSurface,
    points: Points,
    used: NDArray[np.bool_],
    law: ForceLaw,
    refined: Fit,
    resonances: tuple[Resonance, ...],
    estimates: tuple[Estimate, ...],
    *,
    calibrated: bool = True,
    background: str = "none",
) -> tuple[str, ...]:
    """Collect the sentences about data and fit that a reader should know before using the numbers."""
    sentences = [estimate.remark for estimate in estimates if estimate.remark]
    if any(sentence for sentence in sentences):
        shift = _small_shift(resonances)
        if shift:
            sentences.append(shift)
    if not surface.phase_known:
        sentences.append(_NO_PHASE)
    if not calibrated:
        sentences.append(_NO_SCALE)
    unsettled = int(np.count_nonzero(~surface.settled))
    if unsettled:
        sentences.append(f"{unsettled} of {len(surface)} points have no settled response and were left aside")
    lost = int(np.count_nonzero(~used))
    if lost:
        sentences.append(
            f"{lost} of {len(points)} points were set aside: they disagree with the others or lie too near a "
            "jump to be followed"
        )
    if not refined.regression.converged:
        sentences.append(
            "the refined fit did not converge: compare with the first-order estimates and doubt both"
        )
    # of real and imaginary part together, as everywhere in the result
    noise = refined.regression.noise * np.sqrt(2)
    if noise > _NOTICEABLE and _is_systematic(points, refined, used):
        sentences.append(
            f"the law does not fit: the misfit of {noise:.1%} is systematic over amplitude and frequency, "
            "not noise; intervals are too narrow, try another law"
        )
        if surface.origin == "measured" and background == "none" and surface.phase_known:
            sentences.append(_propose(points, resonances))
    sentences += _data_warnings(points, law, resonances)
    return tuple(sentences)


def _propose(points: Points, resonances: tuple[Resonance, ...]) -> str:
    """Say how to look for what stands beside the mode, and in which band."""
    tested = points.omega / (2 * np.pi)
    reach = [_REACH * 2 * abs(r.damping_ratio) * r.frequency for r in resonances]
    ends = [(r.frequency - w, r.frequency + w) for r, w in zip(resonances, reach, strict=True)]
    low = max([min(end[0] for end in ends), float(tested.min())]) if ends else float(tested.min())
    high = min([max(end[1] for end in ends), float(tested.max())]) if ends else float(tested.max())
    return (
        'a sensor may see more than the mode: try [identify] background = "phase", "constant" or '
        f'"residuals", and band = ["{low:.4g} Hz", "{high:.4g} Hz"], which is {_REACH:g} widths of the '
        "resonance to either side"
    )


def _data_warnings(points: Points, law: ForceLaw, resonances: tuple[Resonance, ...]) -> list[str]:
    sentences = []
    size = points.amplitude
    if points.harmonics.shape[1] > 2:
        higher = np.max(np.abs(points.harmonics[:, 2:]), axis=1) / size
        strongest = int(np.argmax(higher))
        if higher[strongest] > _STRONG:
            order = 2 + int(np.argmax(np.abs(points.harmonics[strongest, 2:])))
            sentences.append(
                f"harmonic {order} reaches {higher[strongest]:.0%} of the fundamental (at "
                f"{points.level[strongest]:g} N, "
                f"{points.omega[strongest] / 2 / np.pi:.4g} Hz): first-order estimates are biased there"
            )
    drift = float(np.median(np.abs(points.harmonics[:, 0]) / size))
    if law.odd and drift > _DRIFT:
        sentences.append(
            f"the mean displacement is {drift:.0%} of the amplitude, but the law is symmetric: an "
            "unsymmetric part is missing or the sensor drifts"
        )
    jumps = sum(resonance.jump for resonance in resonances)
    if jumps:
        sentences.append(
            f"the response jumps across the resonance, or does not reach it, in {jumps} of {len(resonances)} "
            "runs: there the paper's points are extrapolated from one side"
        )
    few = 0
    for resonance in resonances:
        near = (points.level == resonance.level) & (points.sweep == resonance.sweep)
        width = max(2 * abs(resonance.damping_ratio), 1e-12) * resonance.frequency
        few += int(
            np.count_nonzero(near & (np.abs(points.omega / 2 / np.pi - resonance.frequency) < width)) < _FEW
        )
    if few:
        sentences.append(
            f"{few} of {len(resonances)} runs have fewer than {_FEW} points within the width of the "
            "resonance: damping rests on little there"
        )
    return sentences


def _small_shift(resonances: tuple[Resonance, ...]) -> str:
    if len(resonances) < 2:
        return ""
    frequency = np.array([resonance.frequency for resonance in resonances])
    width = float(np.median([2 * abs(r.damping_ratio) * r.frequency for r in resonances]))
    shift = float(np.ptp(frequency))
    if shift < width:
        highest = max(resonance.level for resonance in resonances)
        return (
            f"the resonance shifts by {shift:.2g} Hz over all levels, less than its width of {width:.2g} Hz; "
            f"raise the level above {highest:g} N"
        )
    return ""


def _length(value: float) -> str:
    """Three digits of a displacement [m] in the unit that a drawing would have."""
    unit, factor = next(
        (pair for pair in (("m", 1.0), ("mm", 1e-3), ("um", 1e-6)) if value >= 0.9995 * pair[1]), ("nm", 1e-9)
    )
    return f"{value / factor:.3g} {unit}"


def _is_systematic(points: Points, refined: Fit, used: NDArray[np.bool_]) -> bool:
    """Tell whether signed misfits of the force go together between neighbours in frequency of one run."""
    rotated = points.force * np.exp(-1j * refined.turn)
    misfit = (rotated - refined.force) / np.abs(points.force)
    pairs = points.neighbours
    pairs = pairs[(used & np.isfinite(misfit))[pairs].all(axis=1)]
    first, second = misfit[pairs].T
    power: NDArray[np.float64] = np.abs(misfit[pairs]) ** 2
    if len(first) < 10 or power.sum() == 0:
        return False
    correlation = float(np.mean((first * np.conj(second)).real) / np.mean(power))
    # real and imaginary part tell together
    return bool(correlation > max(_SYSTEMATIC, _CHANCE / np.sqrt(2 * len(first))))
