"""Closed loops of states z' = g(x, v, z; p) along periodic motions: all samples at once, by Newton's method.

From sample to sample  z_1 - z_0 = h ((1 - theta) g_0 + theta g_1)  with  theta = 1/(1 - exp(-q)) - 1/q, q = h
times the largest rate of decay: exact for a linear law with constant input, the trapezoidal rule where little
happens in a step, the implicit Euler rule where a stiff law follows at once (exponential fitting; Liniger and
Willoughby, SIAM J. Numer. Anal. 7 (1970) 47). The error is O(h^2), as that of the shares of switches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsgen.common.arrays import Array
from rsgen.law.switched_sum import SwitchedSum

__all__ = ["StateLoops", "close_loops"]

_STEPS = 25
"""Most Newton steps; laws that are piecewise linear in z need a handful."""

_CLOSED = 1e-10
"""Relative last step at which a loop has closed."""

_GAP = 1e-6
"""What a step lacked before the last change, relative to the state; what never closes lacks it for ever."""

_PATIENCE = 3
"""Newton steps after which a linearised loop is near enough to see that states flee it."""

_FLEES = 10.0
"""Growth of a disturbance in a period on the way to a loop that the loop itself will not make good."""

_SMALL = 1e-2
"""Decay in a step below which theta is taken from its series."""

_UNDETERMINED = 1e-9
"""A part of the states that decays by less in a period keeps what it begins with: zero."""


@dataclass(frozen=True, slots=True, eq=False)
class _Recurrence:
    """The rule linearised: z_{j+1} = a_j z_j + r_j for n motions, closed after a period.

    ``forward`` (s, q, q, n) is a; ``inverse`` (s, q, q, n) what divides each source; ``weight`` (s, n) is
    theta and ``step`` (n,) h.
    """

    forward: Array
    inverse: Array
    weight: Array
    step: Array

    def growth(self) -> Array:
        """(n,) factor by which a disturbance of the states grows in a period; below one they forget it."""
        product = self.forward
        while len(product) > 1:
            odd = product[2 * (len(product) // 2) :]
            pairs = _product(product[1::2], product[: 2 * (len(product) // 2) : 2])
            product = np.concatenate([pairs, odd])
        matrices = np.moveaxis(product[0], -1, 0)
        finite = np.isfinite(matrices).all(axis=(1, 2))
        growth = np.full(len(matrices), np.inf)
        growth[finite] = np.abs(np.linalg.eigvals(matrices[finite])).max(axis=1)
        return growth

    def gather(self, source: Array) -> Array:
        """(s, q, k, n) what sources of z' (s, q, k, n) bring from sample to sample."""
        late = np.roll(source, -1, axis=0)
        weight = self.weight[:, None, None]
        return np.asarray(self.step * (source + weight * (late - source)))

    def solve(self, right: Array) -> Array:
        """(s, q, k, n) periodic solution; ``right`` (s, q, k, n) is what each step adds before division."""
        samples, size, columns, _ = right.shape
        right = _product(self.inverse, right)
        unit = np.eye(size)
        # blocks of samples side by side, each from a start of its own: few long steps instead of many short
        length = _block_length(samples)
        blocks = samples // length
        forward = self.forward.reshape(blocks, length, *self.forward.shape[1:])
        sources = right.reshape(blocks, length, *right.shape[1:])
        # of the homogeneous solutions beside the particular ones
        inside = np.zeros((length + 1, blocks, size, columns + size, right.shape[3]))
        inside[0, :, :, columns:] = unit[:, :, None]
        for j in range(length):
            inside[j + 1] = _product(forward[:, j], inside[j])
            inside[j + 1, :, :, :columns] += sources[:, j]
        path = np.zeros((blocks + 1, *inside.shape[2:]))
        path[0, :, columns:] = unit[:, :, None]
        for j in range(blocks):
            path[j + 1] = _product(inside[-1, j, :, columns:], path[j])
            path[j + 1, :, :columns] += inside[-1, j, :, :columns]
        begin = _closing(path[-1, :, columns:], path[-1, :, :columns])
        starts = path[:-1, :, :columns] + _product(path[:-1, :, columns:], begin)
        solution = inside[:-1, :, :, :columns] + _product(inside[:-1, :, :, columns:], starts)
        return np.asarray(np.swapaxes(solution, 0, 1).reshape(right.shape))


def _closing(gain: Array, ends: Array) -> Array:
    """(q, k, n) start that returns to itself after a period: (1 - gain) z = ends; the smallest where states
    keep what they begin with.
    """
    size = len(gain)
    unit = np.eye(size)
    lack = unit - np.moveaxis(gain, -1, 0)
    bound = np.concatenate([lack, np.broadcast_to(_UNDETERMINED * unit, lack.shape)], axis=1)
    good = np.isfinite(bound).all(axis=(1, 2))
    right = np.moveaxis(ends, -1, 0)
    begin = np.full(right.shape, np.nan)
    begin[good] = np.linalg.pinv(bound[good])[:, :, :size] @ right[good]
    return np.moveaxis(begin, 0, -1)


def _block_length(samples: int) -> int:
    """Give the divisor of a number of samples that is next to its root."""
    length = int(samples**0.5)
    while samples % length:
        length -= 1
    return length


def _product(matrix: Array, right: Array) -> Array:
    """(..., q, k, n) product of matrices (..., q, q, n) with (..., q, k, n)."""
    if matrix.shape[-2] == 1:
        return np.asarray(matrix * right)
    return np.asarray(np.sum(matrix[..., :, :, None, :] * right[..., None, :, :, :], axis=-3))


@dataclass(frozen=True, slots=True, eq=False)
class StateLoops:
    """Periodic states along n motions.

    Parameters
    ----------
    states, rates
        (q, n, s) z and its derivative by time; NaN where the loop does not close.
    by_parameter
        (p, q, n, s).
    """

    states: Array
    rates: Array
    by_parameter: Array
    _recurrence: _Recurrence
    _by_motion: tuple[Array, Array]

    def follow(self, dx: Array, dv: Array) -> Array:
        """(q, n, d, s) change of the states for a change of the motion, dx (d, s) and dv (n, d, s)."""
        by_x, by_v = self._by_motion
        source = by_x[:, :, None] * dx + by_v[:, :, None] * dv
        right = self._recurrence.gather(np.transpose(source, (3, 0, 2, 1)))
        return np.asarray(np.transpose(self._recurrence.solve(right), (1, 3, 2, 0)))


def close_loops(
    equations: Sequence[SwitchedSum],
    motion: tuple[Array, Array, Array],
    step: Array,
    values: Sequence[Any] | Array,
) -> StateLoops:
    """Find the periodic states along n motions.

    Parameters
    ----------
    equations
        g of every state; moving variables are x, v and the states.
    motion
        Displacement [m], velocity [m/s] and acceleration [m/s^2], each (n, s), over one period.
    step
        Sampling interval [s], broadcast to (n, 1).
    values
        (p,) of the parameters, or arrays (n, 1).
    """
    count, samples = motion[0].shape
    size = len(equations)
    states = np.zeros((size, count, samples))
    step = np.broadcast_to(step, (count, 1))
    open_rows = np.arange(count)
    for attempt in range(_STEPS):
        here = (motion[0][open_rows], motion[1][open_rows], motion[2][open_rows])
        own = [value if np.ndim(value) == 0 else value[open_rows] for value in values]
        at = states[:, open_rows]
        rate, slopes = _rates(equations, here, at, step[open_rows], own, by_parameters=False)
        recurrence = _linearised(slopes[:, 2 : 2 + size], step[open_rows, 0])
        gain = recurrence.gather(np.transpose(rate, (2, 0, 1))[:, :, None])[:, :, 0]
        before = np.transpose(at, (2, 0, 1))
        lack = gain - (np.roll(before, -1, axis=0) - before)
        change = np.transpose(recurrence.solve(lack[:, :, None])[:, :, 0], (1, 2, 0))
        states[:, open_rows] += change
        with np.errstate(all="ignore"):
            largest = np.max(np.abs(at + change), axis=2)
            settled = np.max(np.abs(change), axis=2) <= _CLOSED * largest
            settled &= np.max(np.abs(lack), axis=0) <= _GAP * largest
        lost = ~np.isfinite(change).all(axis=(0, 2))
        if attempt >= _PATIENCE:
            lost |= recurrence.growth() > _FLEES
        states[:, open_rows[lost]] = np.nan
        closed = settled.all(axis=0) | lost
        open_rows = open_rows[~closed]
        if not len(open_rows):
            break
    states[:, open_rows] = np.nan
    rate, slopes = _rates(equations, motion, states, step, values)
    recurrence = _linearised(slopes[:, 2 : 2 + size], step[:, 0])
    # states that start at zero never reach a loop that they flee
    states[:, recurrence.growth() > 1 + _GAP] = np.nan
    source = np.transpose(slopes[:, 2 + size :], (3, 0, 1, 2))
    moved = recurrence.solve(recurrence.gather(source))
    by_parameter = np.transpose(moved, (2, 1, 3, 0))
    return StateLoops(states, rate, by_parameter, recurrence, (slopes[:, 0], slopes[:, 1]))


def _rates(
    equations: Sequence[SwitchedSum],
    motion: tuple[Array, Array, Array],
    states: Array,
    step: Array,
    values: Sequence[Any] | Array,
    *,
    by_parameters: bool = True,
) -> tuple[Array, Array]:
    """g (q, n, s) and its slopes (q, 2 + q + p, n, s) by x, v, states, parameters."""
    x, v, a = motion
    # a share of a switch in z would change with the rate that is being solved for: such switches are sharp
    sharp = np.zeros_like(states)
    found = [each((x, v, *states), (v, a, *sharp), step, values) for each in equations]
    return np.stack([each[0] for each in found]), np.stack([np.stack(each[1:]) for each in found])


def _linearised(jacobian: Array, step: Array) -> _Recurrence:
    """Linearise the rule; ``jacobian`` (q, q, n, s) is dg/dz, ``step`` (n,) [s]."""
    size = len(jacobian)
    slope = np.transpose(jacobian, (3, 0, 1, 2))
    decay = np.abs(slope).sum(axis=2).max(axis=1)
    weight = _weight(step * (decay + np.roll(decay, -1, axis=0)) / 2)
    share = (weight * step)[:, None, None]
    unit = np.eye(size)[:, :, None]
    late = unit - share * np.roll(slope, -1, axis=0)
    early = unit + (step - share) * slope
    with np.errstate(all="ignore"):
        inverse = 1 / late if size == 1 else np.moveaxis(_inverted(np.moveaxis(late, -1, 1)), 1, -1)
    return _Recurrence(_product(inverse, early), inverse, weight, step)


def _inverted(matrices: Array) -> Array:
    """Invert; singular ones and those that are not finite give NaN."""
    finite = np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))
    good = finite & (np.linalg.det(np.where(finite[..., None, None], matrices, 0.0)) != 0)
    inverse = np.full_like(matrices, np.nan)
    inverse[good] = np.linalg.inv(matrices[good])
    return inverse


def _weight(decay: Array) -> Array:
    """Theta from the decay in a step, 1/2 to 1."""
    with np.errstate(all="ignore"):
        whole = -1 / np.expm1(-decay) - 1 / decay
    return np.where(decay < _SMALL, 0.5 + decay / 12, whole)
