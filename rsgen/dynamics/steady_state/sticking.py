"""Motions under Masing laws in which nothing slips any more: there the law is straight, and its offset exact.

After the last slip a slider is a spring about the place where it stopped. The loops of a transient that
decays or beats about it have no area and no fixed middle, so that their steady state is looked for with the
memory as the transient left it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import sympy
from numpy.typing import NDArray

from rsgen.common.arrays import Array
from rsgen.data.oscillator import Oscillator
from rsgen.formula import symbol
from rsgen.formula.evaluation import compiled
from rsgen.law.memory import memory_form, real_powers
from rsgen.law.pieces import normal_form_at

__all__ = ["Sticking"]

_STRAIGHT = 1e-12
"""Departure from a straight line, relative, that is rounding."""

_PLACES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
"""Where a beginning is compared with a straight line, in parts of its length: a curve differs somewhere."""


@dataclass(frozen=True, slots=True)
class Sticking:
    """Straight beginning of a virgin curve: its slope [N/m], and the displacement [m] at which it ends."""

    slope: float
    reach: float

    @classmethod
    def of(cls, oscillator: Oscillator) -> Sticking | None:
        """Find the beginning of the only virgin curve; None where there is none or more, or it is bent."""
        memory = memory_form(oscillator.force)
        if memory is None or len(memory.curves) != 1:
            return None
        virgin = memory.curves[0].virgin
        reach = _first_corner(virgin, oscillator)
        if not np.isfinite(reach):
            return None
        names = oscillator.parameters
        force = compiled((virgin,), (symbol("x"), *map(symbol, names)))
        values = [oscillator.values[name] for name in names]
        end, *between = force(reach * np.append(1.0, _PLACES), *values)[0]
        straight = end > 0 and np.abs(between - _PLACES * end).max() < _STRAIGHT * end
        return cls(end / reach, reach) if straight else None

    def reaches(self, middle: Array, top: Array, bottom: Array) -> NDArray[np.bool_]:
        """(k,) whether nothing slips between bottom and top (k,) [m] about the places ``middle`` (k,)."""
        return np.asarray((top < middle + self.reach) & (bottom > middle - self.reach))


def _first_corner(virgin: sympy.Expr, oscillator: Oscillator) -> float:
    """Displacement [m] of the first corner of a virgin curve; infinite where it has none."""
    switches = normal_form_at(real_powers(virgin), oscillator.values).switches
    places = tuple(switch.threshold for switch in switches if switch.threshold is not None)
    names = oscillator.parameters
    found = compiled(places, tuple(map(symbol, names)))(*(oscillator.values[name] for name in names))
    return min((float(place) for place in found if place > 0), default=np.inf)
