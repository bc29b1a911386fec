"""Sizes of the states of a law: what they are divided by, and how fast they follow the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import sympy

from rsgen.common.arrays import Array, ComplexArray
from rsgen.data.oscillator import Oscillator
from rsgen.formula import symbol
from rsgen.formula.evaluation import Numeric, compiled
from rsgen.law.memory import memory_form

__all__ = ["Stiffness", "units_of_states"]

_SMALL = 1e-3
"""Of the displacement that the force gives the mass alone: there states follow without their limits."""


_STABLE = 2.0
"""Steps times rate up to which the method of Runge and Kutta is stable, with a margin: the limit is 2.78."""


@dataclass(frozen=True, slots=True, eq=False)
class Stiffness:
    """How fast the states of a law follow the motion: -dg/dz of each equation z' = g."""

    slopes: Numeric
    values: tuple[float, ...]

    @classmethod
    def of(cls, oscillator: Oscillator) -> Stiffness | None:
        """Differentiate the equations; None for a law without."""
        memory = memory_form(oscillator.force)
        if memory is None or not memory.rates:
            return None
        at_rest = {rate.symbol: sympy.S.Zero for rate in memory.rates}
        slopes = tuple(sympy.diff(rate.rate, rate.symbol).subs(at_rest) for rate in memory.rates)
        names = oscillator.parameters
        arguments = (symbol("x"), symbol("v"), *(symbol(name) for name in names))
        return cls(compiled(slopes, arguments), tuple(oscillator.values[name] for name in names))

    def steps(self, amplitude: Array, omega: Array) -> Array:
        """Steps a period (k,) that motions of an amplitude (k,) [m] need to stay stable."""
        rates = self.slopes(amplitude, omega * amplitude, *self.values)
        fastest = np.max([np.abs(np.nan_to_num(rate)) + 0 * omega for rate in rates], axis=0)
        return np.asarray(2 * np.pi / omega * fastest / _STABLE)


def units_of_states(oscillator: Oscillator, force: ComplexArray, omega: Array) -> Array | None:
    """What one metre of displacement makes of each of D numbers [its unit/m], (D,); None without states.

    From the equations z' = g(x, v, z) at rest: |dg/dv| + |dg/dx|/omega; what depends on neither follows the
    other states. Only norms and the distances of neighbouring orbits depend on it.
    """
    memory = memory_form(oscillator.force)
    if memory is None or not memory.rates:
        return None
    names, states = oscillator.parameters, [rate.symbol for rate in memory.rates]
    rates = compiled(
        tuple(rate.rate for rate in memory.rates),
        (symbol("x"), symbol("v"), *states, *(symbol(name) for name in names)),
    )
    w = float(np.median(omega))
    size = float(np.median(np.abs(force))) / (oscillator.mass * w * w)
    x = _SMALL * size if size > 0 else _SMALL
    count = len(states)
    offsets = np.zeros((2 + count, 2 + count))
    offsets[0, 0], offsets[1, 1] = x, w * x
    values = [oscillator.values[name] for name in names]
    units = np.zeros(count)
    for _ in range(1 + count):
        offsets[2:, 2:] = np.diag(units * x)
        up, down = (
            np.array([np.broadcast_to(rate, 2 + count) for rate in rates(*places, *values)])
            for places in (offsets, -offsets)
        )
        steps = np.abs(up - down) / (2 * x)
        direct = steps[:, :2].sum(axis=1) / w
        units = np.where(direct > 0, direct, steps[:, 2:].sum(axis=1) / w)
    units = np.where(np.isfinite(units) & (units > 0), units, 1.0)
    loop = (1.0, 1.0) if memory.curves else ()
    return np.array([1.0, 1.0, *units, *loop])
