"""Virtual tests: sweeps and jumps, noise, memory, and harmonic balance and brute force as other ways."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rsgen import Law, Oscillator, RsgenError, SimulatedTest, load_case, simulate
from rsgen.dynamics import harmonic_balance
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.law.numeric import compile_law
from tests.oracles.long_transients import largest_difference

CASES = Path(__file__).parents[2] / "cases"
SAME = 1e-3  # two answers closer than this are on one branch; other branches differ by tens of per cent
DUFFING = Oscillator(1.5, "c*v + k*x + kn*x**3", {"c": 3.8, "k": 5920.0, "kn": 2.5e6})


@pytest.mark.slow
def test_up_and_down_differ_between_the_folds_only():
    frequency = np.arange(9, 14, 0.05)
    up, down = (
        simulate(DUFFING, SimulatedTest([2.0, 8.0], frequency, sweep=sweep)) for sweep in ("up", "down")
    )
    weak = up.level == 2
    assert np.all(np.abs(up.amplitude / down.amplitude - 1)[weak] < SAME)
    apart = np.flatnonzero(np.abs(up.amplitude / down.amplitude - 1)[~weak] > SAME)
    # one band without gaps, in which a hardening spring holds the large branch on the way up
    assert len(apart) > 5
    assert np.all(np.diff(apart) == 1)
    assert np.all(up.amplitude[~weak][apart] > 2 * down.amplitude[~weak][apart])


def test_noise_is_complex_gaussian_and_of_its_seed():
    test = SimulatedTest(np.linspace(1, 3, 40), np.linspace(8, 12, 60), noise_relative=0.02, seed=5)
    clean = simulate(DUFFING, replace(test, noise_relative=0.0))
    noisy = simulate(DUFFING, test)
    assert np.array_equal(noisy.harmonics, simulate(DUFFING, test).harmonics)
    assert not np.array_equal(noisy.harmonics, simulate(DUFFING, replace(test, seed=6)).harmonics)
    on_force = (noisy.force - clean.force) / np.abs(clean.force) / 0.02
    on_third = (noisy.harmonics - clean.harmonics)[:, 3] / clean.amplitude / 0.02
    for noise in (on_force, on_third):
        # 2400 points: four standard errors of the mean and of the variance
        assert np.mean(np.abs(noise) ** 2) == pytest.approx(1.0, abs=4 / np.sqrt(2400))
        assert abs(noise.mean()) < 4 / np.sqrt(2400)
        assert abs(np.mean(noise**2)) < 4 * np.sqrt(2 / 2400)
    assert abs(np.mean(on_force * np.conj(on_third))) < 4 / np.sqrt(2400)
    assert np.all(noisy.harmonics[:, 0].imag == 0)
    assert np.array_equal(noisy.level, clean.level)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cubic", "coulomb", "piecewise"])
def test_brute_force_agrees_on_the_cases(name):
    case = load_case(CASES / f"{name}.toml")
    surface = simulate(case.oscillator, replace(case.test, accuracy=1e-4))
    assert largest_difference(case.oscillator, surface, sample=120) < 1e-4


def test_another_branch_is_noticed():
    up = simulate(DUFFING, SimulatedTest([10.0], np.linspace(10, 11.6, 33), sweep="up"))
    upper = up.select(up.frequency > 11.19)
    assert largest_difference(DUFFING, replace(upper, sweep=np.full(len(upper), "rest"))) > 0.5


def test_a_gap_met_late_in_the_transient_is_not_overlooked():
    """After 8 periods this motion spirals, perfectly linear, to an answer that it will never reach."""
    k = 1.5 * (2 * np.pi * 10) ** 2
    law = "c*v + Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True))"
    values = {"c": 0.04 * np.sqrt(1.5 * k), "k4": k, "k5": 1.4 * k, "b": 5e-3}
    o = Oscillator(1.5, law, values)
    test = SimulatedTest([1 + 11 * 2 / 39], np.linspace(7, 13, 200)[100:112])
    assert largest_difference(o, simulate(o, test)) < 1e-4


LINEAR = {"c": 3.8, "k": 5922.0}
JENKINS = Oscillator(1.5, "c*v + k*x + masing(Min(kt*x, Fs))", LINEAR | {"kt": 3000.0, "Fs": 2.0})
BOUC_WEN = Oscillator(
    2.0, Law("c*v + k*x + z", memory={"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"}),
    {"c": 10.0, "k": 5e4, "alpha": 5e4, "bg": 800.0, "bd": -1100.0},
)  # fmt: skip
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
    dahl = Law("c*v + z", memory={"z": "sigma*v*(1 - z*sign(v)/Fc)"})
    oscillator = Oscillator(1.5, dahl, {"c": 3.8, "sigma": 5920.0, "Fc": 6.0})
    with pytest.raises(RsgenError, match=r"no spring holds the mean displacement.*harmonic-balance"):
        simulate(oscillator, SimulatedTest([0.5], np.linspace(6, 14, 7)))
