"""Closed loops of Masing laws along periodic motions, from their virgin curve.

After a reversal at x_r with force n_r the force is n_r -+ 2 n(|x - x_r|/2); a branch that reaches the
reversal before the last one closes a minor loop and goes on where that loop began (Madelung's rules, Ann.
Phys. 322 (1905) 861). Between the extremes of the period the loop is centred: n_r = n(A) at the largest
displacement, A half the distance of the extremes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.law.switched_sum import SwitchedSum

__all__ = ["Loop", "Reversals", "find_reversals", "make_loops"]

Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Reversals:
    """Where n motions reverse, and from which reversal the branch at each sample comes.

    Parameters
    ----------
    row, sample
        (r,) motion and nearest sample of every reversal.
    place
        (r,) displacement there [m].
    after
        (r,) time from that sample to the reversal [s].
    falling
        (r,) 1 where the branch after it falls, else -1.
    parent
        (r,) reversal from which the branch that ends here comes; itself for the largest of a motion.
    opposite
        (r,) at the largest of a motion the smallest one, else unused.
    depth
        (r,) 0 for the largest of a motion, else one more than the parent's.
    reference
        (n, s) reversal from which the branch at a sample comes.
    """

    row: Indices
    sample: Indices
    place: Array
    after: Array
    falling: Array
    parent: Indices
    opposite: Indices
    depth: Indices
    reference: Indices

    def shifts(self, dx: Array, dv: Array) -> Array:
        """(r, d) change of each place for changes of the motion, dx (d, s) and dv (n, d, s)."""
        moved: Array = dx[:, self.sample].T + self.after[:, None] * dv[self.row, :, self.sample]
        return moved


def find_reversals(x: Array, v: Array, a: Array, step: Array) -> Reversals:
    """Find all reversals of periodic motions (n, s) and the branch at every sample; ``step`` (n, 1) [s]."""
    count, samples = x.shape
    upward = v > 0
    turns = upward != np.roll(upward, -1, axis=1)
    # what never moves stays where it is: a reversal without a branch
    turns[~turns.any(axis=1), -1] = True
    row, before = np.nonzero(turns)
    after = (before + 1) % samples
    nearer = np.where(np.abs(v[row, before]) <= np.abs(v[row, after]), before, after)
    speed, bend = v[row, nearer], a[row, nearer]
    width = np.broadcast_to(step, (count, 1))[row, 0]
    with np.errstate(all="ignore"):
        late = np.clip(np.nan_to_num(-speed / bend), -width, width)
    # where the motion hardly bends, v^2/(2a) would lead far away
    place = x[row, nearer] + speed * late + bend * late**2 / 2
    falling = np.where(upward[row, before], 1.0, -1.0)
    found = np.bincount(row, minlength=count)
    first = np.concatenate([[0], np.cumsum(found)[:-1]])
    numbers = np.arange(len(row))
    parent, opposite, depth = np.array(numbers), np.array(numbers), np.zeros(len(row), dtype=np.intp)
    reference = np.repeat(first[:, None], samples, axis=1)
    plain = found == 2
    one, other = first[plain], first[plain] + 1
    top = np.where(falling[one] > 0, one, other)
    low = one + other - top
    parent[low], opposite[top], depth[low] = top, low, 1
    reference[plain] = np.where(upward[plain], low[:, None], top[:, None])
    for each in np.flatnonzero(found > 2):
        own = slice(first[each], first[each] + found[each])
        _nest(x[each], place, numbers[own], before[own], falling, parent, opposite, depth, reference[each])
    return Reversals(row, nearer, place, late, falling, parent, opposite, depth, reference)


def _nest(
    x: Array,
    place: Array,
    numbers: Indices,
    before: Indices,
    falling: Array,
    parent: Indices,
    opposite: Indices,
    depth: Indices,
    reference: Indices,
) -> None:
    """Follow one period of a motion with minor loops from its largest displacement on."""
    samples = len(x)
    start = int(np.argmax(np.where(falling[numbers] > 0, place[numbers], -np.inf)))
    order = np.roll(numbers, -start)
    ends = np.roll(before, -start)
    stack = [int(order[0])]
    opposite[order[0]] = order[int(np.argmin(place[order]))]
    for (number, end), (following, last) in pairwise([*zip(order, ends, strict=True), (order[0], ends[0])]):
        inside = (end + 1 + np.arange((last - end) % samples)) % samples
        sign = falling[number]
        reference[inside] = stack[-1]
        while len(stack) > 2:
            closed = place[stack[-2]]
            beyond = inside[sign * (closed - x[inside]) > 0]
            if not len(beyond) and sign * (closed - place[following]) <= 0:
                break
            del stack[-2:]
            reference[beyond] = stack[-1]
        if following != order[0]:
            parent[following], depth[following] = stack[-1], depth[stack[-1]] + 1
            stack.append(int(following))


def make_loops(
    virgins: Sequence[SwitchedSum],
    motion: tuple[Array, Array, Array],
    step: Array,
    values: Sequence[Any] | Array,
) -> list[Loop]:
    """Give the loop of every virgin curve along motions: displacement, velocity, acceleration (n, s)."""
    if not virgins:
        return []
    at = find_reversals(*motion, step)
    return [Loop(virgin, *motion[:2], step, values, at) for virgin in virgins]


class Loop:
    """The loop of one virgin curve along motions (n, s) with known reversals.

    ``force`` (n, s) [N]; ``slope`` its derivative by x on the branch; ``by_parameter`` by every parameter.
    """

    def __init__(
        self,
        virgin: SwitchedSum,
        x: Array,
        v: Array,
        step: Array,
        values: Sequence[Any] | Array,
        at: Reversals,
    ) -> None:
        self._at = at
        half = np.abs(at.place - at.place[at.parent]) / 2
        first = at.depth == 0
        half[first] = (at.place[first] - at.place[at.opposite[first]]) / 2
        own = [value if np.ndim(value) == 0 else value[at.row] for value in values]
        still = np.zeros((len(half), 1))
        ends = [part[:, 0] for part in virgin((half[:, None],), (still,), still, own)]
        branch = virgin((np.abs(x - at.place[at.reference]) / 2,), (np.abs(v) / 2,), step, values)
        self._end_slope, self.slope = ends[1], branch[1]
        down = at.falling[at.reference]
        forces = [
            self._reached(end)[at.reference] - 2 * down * part
            for end, part in zip((ends[0], *ends[2:]), (branch[0], *branch[2:]), strict=True)
        ]
        self.force, self.by_parameter = forces[0], tuple(forces[1:])

    def _reached(self, end: Array) -> Array:
        """(r,) at every reversal, from the virgin curve at half the way from its parent."""
        at, reached = self._at, np.array(end)
        for depth in range(1, int(at.depth.max(initial=0)) + 1):
            here = at.depth == depth
            parent = at.parent[here]
            reached[here] = reached[parent] - 2 * at.falling[parent] * end[here]
        return reached

    def follow(self, dx: Array, dv: Array) -> Array:
        """(1, n, d, s) change of the force for a change of the motion, dx (d, s) and dv (n, d, s)."""
        at = self._at
        place = at.shifts(dx, dv)
        reached = self._end_slope[:, None] * (place - place[at.opposite]) / 2
        for depth in range(1, int(at.depth.max(initial=0)) + 1):
            here = at.depth == depth
            parent = at.parent[here]
            reached[here] = reached[parent] + self._end_slope[here, None] * (place[here] - place[parent])
        slope = self.slope[None, :, None, :]
        place, reached = (np.moveaxis(part[at.reference], 2, 1) for part in (place, reached))
        return np.asarray(slope * (dx - place) + reached)
