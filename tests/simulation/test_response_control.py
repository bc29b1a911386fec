"""Response control: exact where linear, the motions of force control, folds where the force turns."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from rsgen import load_case
from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Oscillator
from rsgen.data.surface import save_surface
from rsgen.dynamics.controlled import solve_response_control
from rsgen.dynamics.simulation import simulate
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.dynamics.virtual_test import SimulatedTest
from rsgen.files import load_surface
from rsgen.law.element import make_element

CASES = Path(__file__).parents[2] / "cases"


def duffing(kn: float) -> Oscillator:
    return Oscillator(1.5, (make_element("all", "c*v + k*x + kn*x**3"),), {"c": 3.8, "k": 5920.0, "kn": kn})


def test_linear_oscillator_needs_its_dynamic_stiffness():
    f = np.linspace(5, 15, 41)
    omega = 2 * np.pi * f
    X = np.linspace(1e-4, 2e-2, 41)
    states = solve_response_control(duffing(0.0), X, f, accuracy=1e-8)
    exact = (5920 - 1.5 * omega**2 + 3.8j * omega) * X
    assert np.abs(states.force / exact - 1).max() < 1e-8
    assert states.stable.all()


@pytest.mark.parametrize("name", ["cubic", "coulomb", "bilinear"])
def test_force_control_finds_the_same_motions(name):
    case = load_case(CASES / f"{name}.toml")
    X, f = np.repeat([1e-3, 5e-3, 1.2e-2], 9), np.tile(np.linspace(7.5, 12.5, 9), 3)
    held = solve_response_control(case.oscillator, X, f)
    assert np.all(held.outcome == 0)
    assert np.abs(held.harmonics[:, 1] / X - 1).max() < 1e-10
    free = solve_steady_states(
        case.oscillator, held.force[held.stable], f[held.stable], start=held.state[held.stable]
    )
    assert np.abs(free.harmonics[:, 1] / X[held.stable] - 1).max() < 2e-4


def test_unstable_branch_is_where_more_motion_needs_less_force():
    X = np.linspace(1e-3, 4e-2, 160)
    states = solve_response_control(duffing(2.5e6), X, np.full(160, 11.3))
    falls = np.gradient(np.abs(states.force), X) < 0
    assert 10 < falls.sum() < 150
    # the two points beside each fold may go either way
    differs = np.flatnonzero(falls == states.stable)
    turns = np.flatnonzero(np.diff(falls.astype(int)))
    assert len(turns) == 2
    assert all(np.min(np.abs(turns + 0.5 - i)) <= 1.5 for i in differs)


def held_amplitudes(kn: float) -> tuple[Oscillator, SimulatedTest]:
    test = SimulatedTest(
        np.linspace(2e-3, 2e-2, 8), np.linspace(7, 13, 61), control="response", accuracy=1e-6
    )
    return duffing(kn), test


def test_a_surface_of_held_amplitudes_says_so_in_its_file(tmp_path):
    surface = simulate(*held_amplitudes(5e6))
    assert (surface.control, surface.level_unit, surface.answer_unit) == ("response", "m", "N")
    assert np.array_equal(surface.answer, np.abs(surface.force))
    assert surface.settled.all()
    np.testing.assert_allclose(surface.amplitude, surface.level, rtol=1e-9)
    with pytest.raises(RsgenError, match="positive"):
        solve_response_control(duffing(1.0), [0.0], [1.0])
    # a hardening spring this strong folds: between the folds no constant force holds the motion
    assert 0 < np.count_nonzero(surface.stable) < len(surface)
    save_surface(tmp_path / "surface.h5", surface)
    with h5py.File(tmp_path / "surface.h5") as file:
        assert file["level"].attrs["units"] == "m"
    again = load_surface(tmp_path / "surface.h5")
    assert again.control == "response"
    assert np.array_equal(again.stable, surface.stable)
