"""Closed loops of laws with memory for harmonic balance: an oracle with loops of its own.

Nothing is shared with the kernel or with the loops of identification. States are carried along the waveform
by the classical method of Runge and Kutta until they repeat; Masing laws follow a stack of reversals, centred
between the extremes of the waveform.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsgen.common.arrays import Array
from rsgen.data.oscillator import Oscillator
from rsgen.formula import symbol
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.law.memory import MemoryForm

__all__ = ["MemoryLoops"]

_TURNS = 60
"""Periods after which a state that still changes is taken as it is: what forgets slower hardly settles."""

_FORGETS = 0.98
"""Share of a change that may be left after a period, for the limit to be foreseen from two of them."""

_CLOSED = 1e-11
"""Change of the states in a period, of their size, below which a loop has closed."""

_DEEPEST = 12
"""Reversals of a waveform within its outer loop, at one time: more than harmonics that matter make."""


@dataclass(frozen=True, slots=True, eq=False)
class MemoryLoops:
    """Force of a law with memory along one period of n motions."""

    form: MemoryForm
    force: Numeric
    rates: Numeric
    virgins: Numeric
    values: tuple[float, ...]

    @classmethod
    def of(cls, oscillator: Oscillator, form: MemoryForm) -> MemoryLoops:
        """Compile what the loops need."""
        x, v = symbol("x"), symbol("v")
        names = tuple(symbol(name) for name in oscillator.parameters)
        inner = tuple(rate.symbol for rate in form.rates)
        return cls(
            form,
            compiled((form.force,), (x, v, *form.states, *names)),
            compiled(tuple(rate.rate for rate in form.rates), (x, v, *inner, *names)),
            compiled(tuple(curve.virgin for curve in form.curves), (x, *names)),
            tuple(oscillator.values[name] for name in oscillator.parameters),
        )

    def __call__(self, x: Array, v: Array, lag: Array, omega: Array) -> tuple[Array, Array]:
        """Force (n, s) [N], and the states with equations at the start of the period (r, n).

        x [m] and v [m/s] (n, 2 s) are two samples for each of the force; lag (n, s) [m] is the displacement a
        quarter of a period later, and omega (n,) [rad/s].
        """
        states = self._states(x, v, omega)
        place, speed = x[:, ::2], v[:, ::2]
        moving = [*states, *self._masing(place)] + ([] if self.form.lag is None else [lag])
        (force,) = self.force(place, speed, *moving, *self.values)
        return force + 0 * place, np.array([state[:, 0] for state in states])

    def _states(self, x: Array, v: Array, omega: Array) -> Array:
        """States (r, n, s) along the motion."""
        samples, count = x.shape[1] // 2, len(self.form.rates)
        waves = np.zeros((count, len(x), samples))
        if not count:
            return waves
        step = 2 * np.pi / omega / samples
        x, v = (np.ascontiguousarray(np.hstack([wave, wave[:, :1]]).T) for wave in (x, v))

        def rate(at: int, z: Array) -> Array:
            return np.array([row + 0 * z[0] for row in self.rates(x[at], v[at], *z, *self.values)])

        z = np.zeros((count, len(omega)))
        last = np.zeros_like(z)
        for turn in range(_TURNS):
            before = z
            for i in range(samples):
                waves[:, :, i] = z
                first = rate(2 * i, z)
                second = rate(2 * i + 1, z + 0.5 * step * first)
                third = rate(2 * i + 1, z + 0.5 * step * second)
                fourth = rate(2 * i + 2, z + step * third)
                z = z + step / 6 * (first + 2 * second + 2 * third + fourth)
            if np.all(np.abs(z - before) <= _CLOSED * np.abs(waves).max(axis=2)):
                break
            change = z - before
            # what is forgotten slowly is forgotten geometrically: two turns show the rest
            share = np.divide(change, last, out=np.ones_like(z), where=np.abs(last) > 0)
            share[np.abs(share) >= _FORGETS] = 0.0
            if turn % 3 == 2:
                z = z + change * share / (1 - share)
            last = change
        return waves

    def _masing(self, x: Array) -> list[Array]:
        """Forces (n, s) of the Masing laws along the motion."""
        if not self.form.curves:
            return []
        rows, samples = x.shape
        everybody = np.arange(rows)
        top = np.argmax(x, axis=1)
        order = (top[:, None] + np.arange(samples)) % samples
        path = np.take_along_axis(x, order, axis=1)

        def virgin(distance: Array) -> Array:
            return np.array([n + 0 * distance for n in self.virgins(distance, *self.values)])

        places = np.zeros((rows, _DEEPEST))
        forces = np.zeros((len(self.form.curves), rows, _DEEPEST))
        places[:, 0] = path[:, 0]
        forces[:, :, 0] = virgin(0.5 * np.ptp(path, axis=1))
        depth, way = np.zeros(rows, dtype=np.intp), -np.ones(rows)
        now, here = forces[:, :, 0].copy(), path[:, 0].copy()
        found = np.empty((len(self.form.curves), rows, samples))
        found[:, :, 0] = now
        for i in range(1, samples):
            there = path[:, i]
            turns = np.flatnonzero((there - here) * way < 0)
            way[turns] *= -1
            depth[turns] = np.minimum(depth[turns] + 1, _DEEPEST - 1)
            places[turns, depth[turns]], forces[:, turns, depth[turns]] = here[turns], now[:, turns]
            while True:
                # beyond the reversal before, a loop within the loop has closed
                closes = np.flatnonzero(depth >= 2)
                closes = closes[(there[closes] - places[closes, depth[closes] - 1]) * way[closes] > 0]
                if not len(closes):
                    break
                depth[closes] -= 2
            last = places[everybody, depth]
            now = forces[:, everybody, depth] + 2 * way * virgin(0.5 * np.abs(there - last))
            found[:, :, i], here = now, there
        back = np.empty_like(found)
        np.put_along_axis(back, np.broadcast_to(order, found.shape), found, axis=2)
        return list(back)
