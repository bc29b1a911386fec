"""Motions of an oscillator m x'' + n(x, x') = f(t): steady states, harmonic balance, virtual tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.dynamics.controlled import control_grid, phase_grid
    from rsgen.dynamics.periodic_response import simulate_multisine

__all__ = ["control_grid", "phase_grid", "simulate_multisine"]

# most virtual tests hold the force of a sine
__getattr__ = on_first_use(
    __name__,
    {"control_grid": "controlled", "phase_grid": "controlled", "simulate_multisine": "periodic_response"},
)
