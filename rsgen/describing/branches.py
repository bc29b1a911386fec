"""Laws with memory along a cycle with known turning points: branches of Masing laws, structural damping.

Between the turning points X0 - X and X0 + X a Masing law follows the reversal rule: rising from -n(X) by
2 n((x - X0 + X)/2), falling from n(X) by 2 n((X0 + X - x)/2); the displacement a quarter of a period later is
v/omega. On the cycle the law is then a force of x and v again, and quadrature takes it as any other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy

from rsgen.common.arrays import Array
from rsgen.describing.quadrature import Cycle, project
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.formula.names import OMEGA, STATE_V, STATE_X, X0, X
from rsgen.law.memory import MemoryForm
from rsgen.law.pieces import normal_form

__all__ = ["Branches", "loop_of", "on_cycle"]


def _virgin_at(virgin: sympy.Expr, place: sympy.Expr) -> sympy.Expr:
    """Give the virgin curve at a displacement that is known as not negative."""
    if any(not power.exp.is_Integer for power in virgin.atoms(sympy.Pow) if power.base is not sympy.E):
        # round-off must not make a root of something negative
        place = sympy.Abs(place)
    return virgin.xreplace({STATE_X: place})


def loop_of(virgin: sympy.Expr) -> sympy.Expr:
    """Write the two branches of a Masing law between the turning points as one force of x and v."""
    rising, half, top = sympy.Heaviside(STATE_V), sympy.Rational(1, 2), _virgin_at(virgin, X)
    up = -top + 2 * _virgin_at(virgin, half * (STATE_X - X0 + X))
    down = top - 2 * _virgin_at(virgin, half * (X0 + X - STATE_X))
    return rising * up + (1 - rising) * down


def on_cycle(force: sympy.Expr, memory: MemoryForm) -> sympy.Expr:
    """Write Masing laws and structural damping in f(x, v, z) as they are on the cycle of X about X0.

    States with equations stay in it as ``Inner`` symbols.
    """
    places = {curve.symbol: loop_of(curve.virgin) for curve in memory.curves}
    if memory.lag is not None:
        places[memory.lag] = STATE_V / OMEGA
    return force.xreplace(places)


@dataclass(frozen=True, slots=True)
class Branches:
    """A law without states of its own along the cycle, by quadrature of its branches.

    Parameters
    ----------
    force
        The law on the cycle [N], in x, v, X, X0, omega and parameters.
    parameters
        Names of the parameters.
    """

    force: sympy.Expr
    parameters: tuple[str, ...]

    def harmonics(self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]) -> list[Array]:
        """Give stiffness [N/m], damping [N s/m] and mean force [N] of cycles; arrays (n,)."""
        return self.projected(X_, mean, omega, values)[:3]

    def projected(self, X_: Array, mean: Array, omega: Array, values: Mapping[str, Array]) -> list[Array]:
        """Give stiffness, damping, mean force, and the mean absolute force as a stiffness [N/m]."""
        names = (X, X0, OMEGA, *map(symbol, self.parameters))
        fields = (X_, mean, omega, *(np.broadcast_to(values[name], X_.shape) for name in self.parameters))
        found = project(self.force, normal_form(self.force), names, Cycle(X_, mean, omega, fields))
        per_length = 1 / (np.pi * X_)
        return [
            found.sine * per_length,
            found.cosine * per_length / omega,
            found.mean / (2 * np.pi),
            found.size * per_length,
        ]

    def along(self, phi: Array, X_: float, mean: float, omega: float, values: Mapping[str, float]) -> Array:
        """Give the force [N] at phases (s,) of one cycle."""
        names = (STATE_X, STATE_V, X, X0, OMEGA, *map(symbol, self.parameters))
        x, v = mean + X_ * np.sin(phi), omega * X_ * np.cos(phi)
        numbers = (values[name] for name in self.parameters)
        (force,) = compiled((self.force,), names)(x, v, X_, mean, omega, *numbers)
        return np.broadcast_to(force, phi.shape)
