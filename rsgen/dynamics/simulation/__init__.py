"""Virtual tests: an oscillator under stepped-sine force becomes a response surface."""

from __future__ import annotations

from rsgen.dynamics.simulation.simulate import simulate
from rsgen.dynamics.simulation.virtual_test import MultisineTest, SimulatedTest

__all__ = ["MultisineTest", "SimulatedTest", "simulate"]
