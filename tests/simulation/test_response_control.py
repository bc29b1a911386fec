"""Held amplitudes: force control backwards, and points of a continuation on all branches."""

from pathlib import Path

import numpy as np
import pytest

import rsgen as rs
from rsgen import load_case
from rsgen.dynamics.controlled import hold_states
from rsgen.dynamics.steady_state import solve_steady_states

CASES = Path(__file__).parents[2] / "cases"


# 31 harmonics of dry friction leave the next ones, where it takes most of the force
@pytest.mark.parametrize(("name", "off"), [("cubic", 2e-4), ("coulomb", 2e-3), ("bilinear", 2e-4)])
def test_force_control_finds_the_same_motions(name, off):
    case = load_case(CASES / f"{name}.toml")
    X, f = np.repeat([1e-3, 5e-3, 1.2e-2], 9), np.tile(np.linspace(7.5, 12.5, 9), 3)
    held = hold_states(case.oscillator, X, f, harmonics=7, order=31)
    assert np.all(held.outcome == 0)
    assert np.abs(held.harmonics[:, 1] / X - 1).max() < 1e-10
    free = solve_steady_states(
        case.oscillator, held.force[held.stable], f[held.stable], start=held.state[held.stable]
    )
    assert np.abs(free.harmonics[:, 1] / X[held.stable] - 1).max() < off


def test_motions_are_unstable_where_more_of_them_needs_less_force():
    test = rs.SimulatedTest(
        level=np.linspace(3e-3, 6e-2, 24), frequency=np.linspace(9.6, 10.8, 6), control="continuation",
        harmonics=9, accuracy=1e-8,
    )  # fmt: skip
    hardening = rs.Oscillator(1.5, "k*x + k3*x**3 + c*v", {"k": 5920.0, "k3": 3e5, "c": 2.0})
    surface = rs.simulate(hardening, test)
    assert (surface.control, surface.level_unit) == ("continuation", "m")
    order = np.lexsort((surface.level, surface.frequency))
    force, stable = (part[order].reshape(6, 24) for part in (np.abs(surface.force), surface.stable))
    falls = np.diff(force, axis=1) < 0
    # a fold lies between two points, of which either may count
    assert np.count_nonzero(~stable) > 15
    assert np.all(falls[~stable[:, :-1] & ~stable[:, 1:]])
    assert not np.any(falls[stable[:, :-1] & stable[:, 1:]])
