"""Virtual tests: an oscillator under stepped-sine force becomes a response surface."""

from __future__ import annotations

from collections.abc import Callable

from rsgen.oscillator import Oscillator
from rsgen.simulation.test import SimulatedTest
from rsgen.surface import ResponseSurface

__all__ = ["SimulatedTest", "simulate"]


def simulate(
    oscillator: Oscillator, test: SimulatedTest, *, progress: Callable[[float], None] | None = None
) -> ResponseSurface:
    """Run a virtual test: the grid level x frequency as a response surface, level by level."""
    raise NotImplementedError
