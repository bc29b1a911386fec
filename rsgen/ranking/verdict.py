"""Does even the best law fit? What it leaves, beyond noise, and where; in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.identification import Candidate
from rsgen.identification.points import Points
from rsgen.ranking.fitting import Fitted
from rsgen.ranking.reference import neighbour_noise
from rsgen.ranking.terms import library_terms

__all__ = ["Judgement", "judge"]

Array = NDArray[np.float64]

_SURE = 5.0
"""Standard deviations of the correlation between neighbours beyond which it is no accident."""

_FUNDAMENTAL = 5e-3
"""A law that leaves less of force and response is said to fit."""

_HARMONIC = 1e-3
_SHARE = 0.1
"""A law that leaves less of a higher harmonic, relative to that harmonic, is said to fit."""

_TOLD = 1e-3
"""Noise below this is not told from what a ranking itself leaves."""

_MOST = 0.6
"""The range is told in which so much of what is unexplained lies."""

_WHOLE = 0.75
"""A range as wide as this share of the tested one tells nothing."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """Whether the best law fits, what is unexplained (relative), and all that in sentences."""

    fits: bool
    unexplained: float
    sentences: tuple[str, ...]


def judge(best: Fitted, points: Points, noise: Array, candidates: Sequence[Candidate]) -> Judgement:
    """Put a ranking into words.

    Parameters
    ----------
    best
        The best law along its own motion.
    points
        Those that took part.
    noise
        (H+1,) relative, of mean, fundamental and harmonics.
    candidates
        Best first.
    """
    pairs = points.neighbours
    total, apart = neighbour_noise(best.residual, pairs, best.told)
    shared = np.maximum(total**2 - apart**2, 0.0)
    left = np.nan_to_num(noise * np.sqrt(shared))
    correlation = np.nan_to_num(shared / np.maximum(total**2, 1e-300))
    sure = correlation * np.sqrt(2 * max(len(pairs), 1)) > _SURE
    count = min(len(left), points.harmonics.shape[1])
    size = np.zeros(len(left))
    size[:count] = np.sqrt(
        np.mean(np.abs(points.harmonics[:, :count]) ** 2 / points.amplitude[:, None] ** 2, axis=0)
    )
    limit = np.maximum(_HARMONIC, _SHARE * size)
    limit[:2] = _FUNDAMENTAL
    missing = sure & (left > limit)
    tied = [candidate.name for candidate in candidates if candidate.tied]
    if not missing.any():
        return Judgement(True, 0.0, tuple(_fitting(tied, float(noise[1]), len(points))))
    unexplained = float(np.sqrt(np.sum(left[missing] ** 2)))
    sentences = [
        f"none of these fits: even the best, {candidates[0].name}, leaves {unexplained:.1%} of force and "
        f"response unexplained (noise: {noise[1]:.1%})",
        _where(best, points, missing, left),
        "all of them assume one mode and a force of displacement and velocity alone: hysteresis, a second "
        "mode, a background or a drift would leave this",
    ]
    return Judgement(False, unexplained, tuple(sentences))


def _fitting(tied: Sequence[str], noise: float, count: int) -> list[str]:
    best, rest = tied[0], list(tied[1:])
    size = f"looks like noise of {noise:.2g}" if noise > _TOLD else f"is less than {_TOLD:g}"
    sentences = [f"{best} fits best: what it leaves of {count} points {size}"]
    inside = set(best.split(" + "))
    sentences += [
        f"{term.name} beside a linear spring is also {' and '.join(term.also)}"
        for term in library_terms()
        if term.also and term.name in inside
    ]
    more = [name for name in rest if inside < set(name.split(" + "))]
    other = [name for name in rest if name not in more]
    if other:
        sentences.append(f"cannot be told from it by this test: {', '.join(other)}")
    if more:
        sentences.append(f"adds nothing that the test shows: {', '.join(more)}")
    return sentences


def _where(best: Fitted, points: Points, missing: NDArray[np.bool_], left: Array) -> str:
    """Say in which harmonic, at which frequencies and amplitudes what is unexplained lies."""
    names = [f"{_order(h)} ({left[h]:.1%})" for h in np.flatnonzero(missing).tolist()]
    orders = np.repeat(np.arange(len(missing)), 2)[1:]
    rows = best.told & missing[orders]
    pairs = points.neighbours
    # noise is not shared by neighbours: their product is what the law leaves
    power = np.sum(best.residual[pairs[:, 0]][:, rows] * best.residual[pairs[:, 1]][:, rows], axis=1)
    frequency = points.omega / (2 * np.pi)
    parts = [f"it is unexplained in the {_joined(names)}"]
    span = _range(frequency[pairs].mean(axis=1), power)
    if span is not None:
        parts.append(f"mostly between {span[0]:.4g} and {span[1]:.4g} Hz")
    span = _range(points.amplitude[pairs].mean(axis=1), power)
    if span is not None:
        parts.append(f"at amplitudes from {span[0]:.3g} to {span[1]:.3g} m")
    return ", ".join(parts)


def _order(h: int) -> str:
    return "mean" if h == 0 else "fundamental" if h == 1 else f"harmonic {h}"


def _joined(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _range(values: Array, power: Array) -> tuple[float, float] | None:
    """Shortest range that holds most of the power; None where that is nearly everywhere."""
    order = np.argsort(values, kind="stable")
    ranked, sums = values[order], np.concatenate([[0.0], np.cumsum(np.maximum(power[order], 0.0))])
    best: tuple[float, float] | None = None
    for i in range(len(ranked)):
        j = int(np.searchsorted(sums, sums[i] + _MOST * sums[-1]))
        if j <= len(ranked) and (best is None or ranked[j - 1] - ranked[i] < best[1] - best[0]):
            best = (float(ranked[i]), float(ranked[j - 1]))
    if best is None or best[1] - best[0] > _WHOLE * (ranked[-1] - ranked[0]):
        return None
    return best
