"""Virtual tests of laws with memory."""

import numpy as np
import pytest

import rsgen as rs
from rsgen import Oscillator, RsgenError, SimulatedTest, simulate
from rsgen.dynamics import harmonic_balance
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.law.numeric import compile_law

LINEAR = {"c": 3.8, "k": 5922.0}
JENKINS = Oscillator(1.5, "c*v + k*x + masing(Min(kt*x, Fs))", LINEAR | {"kt": 3000.0, "Fs": 2.0})
BOUC_WEN = Oscillator(
    2.0,
    rs.Law("c*v + k*x + z", memory={"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"}),
    {"c": 10.0, "k": 5e4, "alpha": 5e4, "bg": 800.0, "bd": -1100.0},
)
POWER = Oscillator(1.5, "c*v + k*x + masing(K*x - R*x**p)", LINEAR | {"K": 3000.0, "R": 2e4, "p": 1.5})


@pytest.mark.slow
@pytest.mark.parametrize(("oscillator", "f0"), [
    (JENKINS, 10.5), pytest.param(BOUC_WEN, 33.0, marks=pytest.mark.thorough), (POWER, 11.5),
], ids=["jenkins", "bouc-wen", "power"])  # fmt: skip
def test_harmonic_balance_is_near_to_the_motion(oscillator, f0):
    F, f = np.array([2.0, 6.0, 11.0]), f0 * np.array([0.95, 1.0, 1.1])
    exact = solve_steady_states(oscillator, F, f, harmonics=9, accuracy=1e-9).harmonics[:, 1:]
    found = harmonic_balance.solve_harmonic_balance(oscillator, F, f, harmonics=15).harmonics[:, 1:10]
    assert np.max(np.abs(found - exact) / np.abs(exact[:, :1])) < 1e-5


@pytest.mark.slow
def test_harmonic_balance_of_states_nears_the_motion_by_the_square_of_the_step():
    law, f = compile_law(BOUC_WEN.force), 33.0 * np.array([0.95, 1.0, 1.1])
    exact = solve_steady_states(BOUC_WEN, [2.0, 6.0, 11.0], f, harmonics=9, accuracy=1e-9).harmonics
    drive, start, others = np.zeros((3, 16), complex), np.zeros((3, 16), complex), tuple(range(2, 16))
    drive[:, 1], start[:, 1:10] = [2.0, 6.0, 11.0], exact[:, 1:]
    values, mass = law.ordered(BOUC_WEN.values), BOUC_WEN.mass
    few, many = (
        harmonic_balance.respond(law, values, mass, 2 * np.pi * f, drive, start, others, samples).harmonics
        for samples in (256, 1024)
    )
    # the corners, among the samples, add errors of the same order that do not fall evenly
    assert np.abs(many - few)[:, 1].max() < 2e-4 * np.abs(exact).max()
    assert np.abs(few[:, :10] - exact).max() > 12 * np.abs(many[:, :10] - exact).max()


def test_structural_damping_is_balanced_and_not_simulated_in_time():
    o = Oscillator(1.5, "k*x + c*v + structural(h)", LINEAR | {"h": 200.0})
    f = np.linspace(8, 12, 5)
    omega = 2 * np.pi * f
    grid = {"level": np.array([3.0]), "frequency": f}
    balance = simulate(o, SimulatedTest(**grid, method="harmonic-balance"))
    exact = 3.0 / (5922 - 1.5 * omega**2 + 1j * (3.8 * omega + 200))
    np.testing.assert_allclose(balance.harmonics[:, 1], exact, rtol=1e-9)
    with pytest.raises(RsgenError, match="periodic motion only"):
        simulate(o, SimulatedTest(**grid))


def test_a_simulation_in_time_is_refused_with_what_helps():
    dahl = rs.Law("c*v + z", memory={"z": "sigma*v*(1 - z*sign(v)/Fc)"})
    oscillator = Oscillator(1.5, dahl, {"c": 3.8, "sigma": 5920.0, "Fc": 6.0})
    with pytest.raises(RsgenError, match=r"no spring holds the mean displacement.*harmonic-balance"):
        simulate(oscillator, SimulatedTest([0.5], np.linspace(6, 14, 7)))
