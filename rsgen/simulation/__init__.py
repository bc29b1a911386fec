"""Virtual tests: an oscillator under stepped-sine force becomes a response surface."""

from __future__ import annotations

from rsgen.simulation.multisine import MultisineTest
from rsgen.simulation.simulate import simulate
from rsgen.simulation.virtual_test import SimulatedTest

__all__ = ["MultisineTest", "SimulatedTest", "simulate"]
