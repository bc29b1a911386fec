"""Does even the best law fit? What it leaves, beyond noise, and where; in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.identification.data import Points
from rsgen.ranking.candidate_terms import library_terms
from rsgen.ranking.fitting import Fitted
from rsgen.ranking.ranking_result import Candidate
from rsgen.ranking.reference import neighbour_noise, standing_out

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

_WORSE = 1.5
"""Levels predicted so many times worse than fitted are told."""

_NAMED = 5
"""Laws in a list."""

_POINTS_EACH = 6
"""Fewer points a parameter are few."""

_WHOLE = 0.75
"""A range as wide as this share of the tested one tells nothing."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """Whether the best law fits, what is unexplained (relative), and all that in sentences."""

    fits: bool
    unexplained: float
    sentences: tuple[str, ...]


def judge(
    best: Fitted, points: Points, noise: Array, candidates: Sequence[Candidate], aside: int, feeds: bool
) -> Judgement:
    """Put a ranking into words.

    Parameters
    ----------
    best
        The first of the candidates.
    points
        Those that took part.
    noise
        (H+1,) relative, of mean, fundamental and harmonics.
    candidates
        Best first.
    aside
        Points that no law follows and that took no part.
    feeds
        True where the structure would work on the exciter over most cycles.
    """
    out = standing_out(best, noise)
    pairs = points.neighbours
    pairs = pairs[~out[pairs].any(axis=1)]
    total, apart = neighbour_noise(best.residual, pairs, best.told)
    shared = np.nan_to_num(np.maximum(total**2 - apart**2, 0.0))
    left = noise * np.sqrt(shared)
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
    unexplained = float(np.sqrt(np.sum(left[missing] ** 2)))
    absurd = _absurd(candidates[0], feeds)
    sentences = list(absurd)
    if missing.any():
        sentences += [
            f"none of these fits: even the best, {candidates[0].name}, leaves {_percent(unexplained)} of "
            "force and response unexplained (what neighbours do not share, noise or too fine for the grid: "
            f"{_percent(float(noise[1]))})",
            _where(best, points, pairs, missing, left),
            "all of them assume one mode and a force of displacement and velocity alone: hysteresis, a "
            "second mode, a background or a drift would leave this",
        ]
    else:
        sentences += _fitting(
            candidates, float(noise[1]), len(points), told=len(pairs) > 0, absurd=bool(absurd)
        )
    sentences += _flexible(best, noise, candidates)
    sentences += _warned(points, candidates[0].parameters, aside + int(np.count_nonzero(out)), aside)
    fits = len(pairs) > 0 and not absurd and not missing.any()
    return Judgement(fits, unexplained, tuple(sentences))


def _absurd(best: Candidate, feeds: bool) -> list[str]:
    """Say what no passive structure does."""
    wrong = []
    if best.values.get("m", 1.0) <= 0:
        wrong.append(f"the mass comes out negative ({best.values['m']:.3g} kg)")
    if feeds:
        wrong.append("the structure would feed energy into the exciter")
    if not wrong:
        return []
    return [f"{' and '.join(wrong)}: is the sense of the phase right, and the sign of the sensor?"]


def _flexible(best: Fitted, noise: Array, candidates: Sequence[Candidate]) -> list[str]:
    """Say where the first predicts levels clearly worse than it fits them, or than others predict them."""
    scale = np.repeat(noise, 2)[1:]
    fitted = float(np.sqrt(np.mean((best.residual * scale)[:, best.told] ** 2)))
    first = candidates[0]
    if not first.held_out_error > _WORSE * max(fitted, _TOLD):
        return []
    sentences = [
        f"a level predicted from the others is off by {_percent(first.held_out_error)}, fitted with them by "
        f"{_percent(fitted)}: some values rest on a single level, or the law is too flexible"
    ]
    better = [
        candidate
        for candidate in candidates
        if (candidate.tied or candidate.parameters < first.parameters)
        and _WORSE * candidate.held_out_error < first.held_out_error
    ]
    if better:
        least = min(better, key=lambda candidate: candidate.held_out_error)
        sentences.append(f"{least.name} predicts levels better: off by {_percent(least.held_out_error)}")
    return sentences


def _warned(points: Points, parameters: int, out: int, aside: int) -> list[str]:
    """Say what makes a ranking less certain than it looks."""
    sentences = []
    if out:
        sentences.append(f"{out} of {len(points) + aside} points are left aside: no law follows them")
    if len(points) < _POINTS_EACH * parameters:
        sentences.append(
            f"{len(points)} points are few for {parameters} parameters: more would tell more laws apart"
        )
    if len(np.unique(points.level)) < 2:
        sentences.append("one level only: other levels would tell more laws apart")
    return sentences


def _fitting(
    candidates: Sequence[Candidate], noise: float, count: int, *, told: bool, absurd: bool
) -> list[str]:
    tied = [candidate.name for candidate in candidates if candidate.tied]
    best, rest = tied[0], tied[1:]
    size = f"looks like noise of {noise:.2g}" if noise > _TOLD else f"is less than {_TOLD:g}"
    sentences = [
        f"{best} {'comes nearest' if absurd else 'fits best'}: what it leaves of {count} points {size}"
    ]
    if not told:
        sentences = [f"{best} comes nearest: points without neighbours do not tell whether it fits"]
    inside = set(best.split(" + "))
    sentences += [
        f"{term.name} beside a linear spring is also {' and '.join(term.how.same)}"
        for term in library_terms()
        if term.how.same and term.name in inside
    ]
    more = [name for name in rest if inside < set(name.split(" + "))]
    other = [name for name in rest if name not in more]
    # what contains another tied law says nothing new
    other = [
        name for name in other if not any(set(less.split(" + ")) < set(name.split(" + ")) for less in other)
    ]
    if other:
        sentences.append(f"cannot be told from it by this test: {_listed(other)}")
    if more:
        sentences.append(f"adds nothing that the test shows: {_listed(more)}")
    return sentences


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def _percent(share: float) -> str:
    return f"{share:.1%}" if share < 1 else "more than 100%"


def _where(
    best: Fitted, points: Points, pairs: NDArray[np.intp], missing: NDArray[np.bool_], left: Array
) -> str:
    """Say in which harmonic, at which frequencies and amplitudes what is unexplained lies."""
    names = [f"{_order(h)} ({_percent(left[h])})" for h in np.flatnonzero(missing).tolist()]
    orders = np.repeat(np.arange(len(missing)), 2)[1:]
    rows = best.told & missing[orders]
    # noise is not shared by neighbours: their product is what the law leaves
    power = np.sum(best.residual[pairs[:, 0]][:, rows] * best.residual[pairs[:, 1]][:, rows], axis=1)
    frequency = points.omega / (2 * np.pi)
    parts = [f"it is unexplained in the {_joined(names)}"]
    span = _range(frequency[pairs].mean(axis=1), power)
    if span is not None:
        low, high = (f"{end:.4g}" for end in span)
        parts.append(f"mostly near {low} Hz" if low == high else f"mostly between {low} and {high} Hz")
    span = _range(points.amplitude[pairs].mean(axis=1), power)
    if span is not None:
        low, high = (f"{end:.3g}" for end in span)
        parts.append(
            f"at amplitudes near {low} m" if low == high else f"at amplitudes from {low} to {high} m"
        )
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
