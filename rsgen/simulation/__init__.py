"""Virtual tests: an oscillator under stepped-sine force becomes a response surface."""

from __future__ import annotations

from rsgen.simulation.surface import simulate
from rsgen.simulation.test import SimulatedTest
from rsgen.simulation.verification import Verification, verify

__all__ = ["SimulatedTest", "Verification", "simulate", "verify"]
