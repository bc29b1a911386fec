"""The closed loop of a law with memory along periodic motions, and how it follows parameters and motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.formula import symbol
from rsgen.law.force_sample import Follow, ForceSample
from rsgen.law.masing_loops import make_loops
from rsgen.law.memory import MemoryForm, real_powers
from rsgen.law.state_loops import close_loops
from rsgen.law.switched_sum import SwitchedSum, switched_sum

__all__ = ["Loops", "compile_loops", "from_rest"]


@dataclass(frozen=True, slots=True, eq=False)
class Loops:
    """A compiled law with memory, f(x, v, z; p) and its memories."""

    _force: SwitchedSum
    _equations: tuple[SwitchedSum, ...]
    _virgins: tuple[SwitchedSum, ...]
    _lags: bool

    def sample(self, x: Array, v: Array, a: Array, step: Array, values: Sequence[Any] | Array) -> ForceSample:
        """Evaluate the closed loop along whole periods (n, s); see ``ForceLaw.sample``."""
        step = np.broadcast_to(step, (len(x), 1))
        memory: list[Array] = []
        rates: list[Array] = []
        moved: list[Sequence[Array]] = []
        follow: list[tuple[int, Follow]] = []
        if self._equations:
            found = close_loops(self._equations, (x, v, a), step, values)
            memory += list(found.states)
            rates += list(found.rates)
            moved += [list(found.by_parameter[:, i]) for i in range(len(found.states))]
            follow.append((len(found.states), found.follow))
        for loop in make_loops(self._virgins, (x, v, a), step, values):
            memory.append(loop.force)
            rates.append(loop.slope * v)
            moved.append(loop.by_parameter)
            follow.append((1, loop.follow))
        if self._lags:
            memory.append(_quarter_later(x))
            rates.append(_quarter_later(v))
            moved.append([])
            follow.append((1, _follow_lag))
        sums = self._force((x, v, *memory), (v, a, *rates), step, values)
        by_parameter = list(sums[3 + len(memory) :])
        for slope, changes in zip(sums[3:], moved, strict=False):
            for i, change in enumerate(changes):
                by_parameter[i] = by_parameter[i] + slope * change
        by_memory, first = [], 3
        for count, each in follow:
            by_memory.append((np.stack(sums[first : first + count]), each))
            first += count
        return ForceSample(sums[0], sums[1], sums[2], tuple(by_parameter), tuple(by_memory))


def _quarter_later(signal: Array) -> Array:
    """(..., s) every harmonic a quarter of its period later, without the mean."""
    samples = signal.shape[-1]
    spectrum = np.fft.rfft(signal) * 1j
    spectrum[..., 0] = 0
    if samples % 2 == 0:
        spectrum[..., -1] = 0
    return np.asarray(np.fft.irfft(spectrum, samples))


def _follow_lag(dx: Array, dv: Array) -> Array:
    return np.broadcast_to(_quarter_later(dx), (1, *dv.shape))


@lru_cache(maxsize=256)
def compile_loops(form: MemoryForm, parameters: tuple[str, ...]) -> Loops:
    """Compile a law with memory for arrays, once; parameters in the order of every value array."""
    states, names = (symbol("x"), symbol("v")), tuple(map(symbol, parameters))
    inner = tuple(rate.symbol for rate in form.rates)
    return Loops(
        switched_sum(form.force, (*states, *form.states), names),
        tuple(switched_sum(rate.rate, (*states, *inner), names) for rate in form.rates),
        tuple(switched_sum(real_powers(curve.virgin), states[:1], names) for curve in form.curves),
        form.lag is not None,
    )


def from_rest(form: MemoryForm) -> sympy.Expr:
    """Give n(x, v) as reached from rest at once: states and lag zero, Masing laws on their virgin curve."""
    x = symbol("x")
    size = sympy.Abs(x)
    places = dict.fromkeys(form.states, sympy.S.Zero)
    places |= {c.symbol: sympy.sign(x) * c.virgin.xreplace({x: size}) for c in form.curves}
    return form.force.xreplace(places)
