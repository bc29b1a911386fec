"""Virtual tests whose mean displacement nothing determines."""

from __future__ import annotations

from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.simulation.virtual_test import SimulatedTest
from rsgen.law.numeric import compile_law

__all__ = ["free_mean_fault"]


def free_mean_fault(oscillator: Oscillator, test: SimulatedTest) -> str:
    """Say why a test cannot be simulated in time for want of a spring; empty where it can."""
    law = compile_law(oscillator.force)
    if test.method != "time" or not law.mean_free:
        return ""
    return (
        "no spring holds the mean displacement: the law depends on x through its memory only, so that the "
        "mass drifts and stays where the start left it; a spring beside the loop, however soft, is needed, "
        'or method = "harmonic-balance", which keeps the mean at zero'
    )
