"""Motions of an oscillator m x'' + n(x, x') = f(t): steady states, harmonic balance, virtual tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsgen.common import on_first_use

if TYPE_CHECKING:
    from rsgen.dynamics.controlled import control_grid, phase_grid

__all__ = ["control_grid", "phase_grid"]

# most virtual tests hold the force
__getattr__ = on_first_use(__name__, dict.fromkeys(("control_grid", "phase_grid"), "controlled"))
