"""Virtual tests: an oscillator under stepped-sine force becomes a response surface."""

from __future__ import annotations

from rsgen.simulation.surface import simulate
from rsgen.simulation.test import SimulatedTest

__all__ = ["SimulatedTest", "simulate"]
