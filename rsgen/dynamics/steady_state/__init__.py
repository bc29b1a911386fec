"""Steady states as fixed points of the period map, for many points at once."""

from __future__ import annotations

from rsgen.dynamics.steady_state.settling import SteadyStates
from rsgen.dynamics.steady_state.solver import solve_steady_states

__all__ = ["SteadyStates", "solve_steady_states"]
