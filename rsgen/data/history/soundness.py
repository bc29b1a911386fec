"""Faults of a record itself: samples cut off at the end of a range, a response that stands still."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.finding import Finding, Quantity
from rsgen.data.history.record import BLOCK, TimeHistory, blocks
from rsgen.data.surface.columns import QUANTITIES

__all__ = ["cut_off", "record_findings"]

_FLAT = 3
"""A top is flat from 3 equal samples on; where the steps are coarse, a sine has some of these."""
_FEWEST = 24
"""At least 24 samples on flat tops are no chance."""
_CROWD = 8
"""A clipped record meets its limit this many times as often as the next value; a coarse sine 2.4 times."""
_STILL = 32
"""A live response does not repeat a value 32 times while the force moves ..."""
_MOVES = 0.2
"""... by this fraction of its largest."""


def _runs(same: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find where True begins and how long it lasts."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], same.astype(np.int8), [0]))))
    return edges[::2], edges[1::2] - edges[::2]


def cut_off(values: NDArray[Any], sign: int) -> int:
    """Count the samples on flat tops at the largest (or smallest) value; 0 where they are no cut."""
    top = max(float((sign * block).max()) for block in blocks(values))
    next_top, count, on_flat = -np.inf, 0, 0
    for block in blocks(values):
        raised = sign * block.astype(np.float64)
        _, lengths = _runs(raised == top)
        on_flat += int(lengths[lengths >= _FLAT].sum())
        below = raised[raised < top]
        if not below.size or below.max() < next_top:
            continue
        count = (count if below.max() == next_top else 0) + int(np.count_nonzero(below == below.max()))
        next_top = float(below.max())
    return on_flat if np.isfinite(next_top) and on_flat >= max(_FEWEST, _CROWD * count) else 0


def _stands(history: TimeHistory) -> list[tuple[float, float]]:
    """Find stretches of equal response while the force moves: begin and length [s]."""
    force, response = history.reference, history.response
    least = _MOVES * max(float(np.abs(block).max()) for block in blocks(force))
    found = []
    for start in range(0, len(response), BLOCK):
        first, lengths = _runs(np.diff(response[start : start + BLOCK]) == 0)
        for begin, length in zip(first[lengths >= _STILL], lengths[lengths >= _STILL], strict=True):
            moving = force[start + begin : start + begin + length]
            if float(moving.max()) - float(moving.min()) > least:
                found.append((history.start + (start + begin) / history.rate, length / history.rate))
    return found


def record_findings(history: TimeHistory) -> tuple[Finding, ...]:
    """Find where samples are cut off or missing, which a fit to amplitudes alone does not show."""
    findings = []
    for name, values in (("force", history.force), ("response", history.response)):
        if values is None:
            continue
        ends = [(float(values.max()), cut_off(values, 1)), (float(values.min()), cut_off(values, -1))]
        samples = sum(count for _, count in ends)
        if samples:
            names = {"record": history.label, "signal": name}
            unit = "N" if name == "force" else QUANTITIES[history.quantity]
            # of the motion, as its amplitudes are: many sensors have an offset
            rest = float(np.median(values))
            limit = min(abs(end - rest) for end, count in ends if count)
            numbers = {"samples": Quantity(samples), "limit": Quantity(limit, unit)}
            findings.append(Finding("record-clipped", "warning", "", numbers, names))
    stands = [] if history.force is None else _stands(history)
    if stands:
        begin, length = max(stands, key=lambda stand: stand[1])
        times = Quantity(len(stands))
        numbers = {"times": times, "begin": Quantity(begin, "s"), "length": Quantity(length, "s")}
        findings.append(Finding("response-stands-still", "warning", "", numbers, {"record": history.label}))
    return tuple(findings)
