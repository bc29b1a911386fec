"""Steady states of laws with memory against DOP853 from event to event, and against closed forms."""

import numpy as np
import pytest

import rsgen as rs
from rsgen.dynamics.kernel import compile_kernel
from rsgen.dynamics.steady_state import solve_steady_states
from tests.oracles import events

BOUC_WEN = rs.Law("c*v + k*x + z", memory={"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"})
BENCHMARK = {"c": 10.0, "k": 5e4, "alpha": 5e4, "bg": 800.0, "bd": -1100.0}
"""The hysteretic benchmark of Noel and Schoukens (2016), mass 2 kg."""


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", [1e-4, 1e-6])
def test_bouc_wen_agrees_with_dop853(accuracy):
    structure, oscillator = events.bouc_wen(2.0, **BENCHMARK), rs.Oscillator(2.0, BOUC_WEN, BENCHMARK)
    # on both sides of the peak, from nearly linear to full events
    F, f = np.array([8.0, 20.0, 45.0, 60.0, 80.0]), np.array([34.0, 33.0, 31.5, 29.0, 46.0])
    asked = solve_steady_states(oscillator, F, f, accuracy=accuracy)
    near = solve_steady_states(oscillator, F, f, accuracy=1e-8)
    assert asked.settled.all()
    for i, omega in enumerate(2 * np.pi * f):
        y = near.state[i]
        X, _ = events.settle(structure, F[i], omega, start=y, mode=tuple(np.sign(y[1:3])))
        assert abs(asked.harmonics[i, 1] / X - 1) < accuracy


@pytest.mark.slow
def test_bouc_wen_from_rest_ends_where_the_motion_itself_ends():
    F, f = np.array([12.0, 70.0]), np.array([36.5, 27.0])
    found = solve_steady_states(rs.Oscillator(2.0, BOUC_WEN, BENCHMARK), F, f, accuracy=1e-6)
    structure = events.bouc_wen(2.0, **BENCHMARK)
    X = [events.settle(structure, F[i], 2 * np.pi * f[i])[0] for i in range(2)]
    assert np.abs(found.harmonics[:, 1] / X - 1).max() < 1e-6


def test_linear_states_have_the_exact_receptance():
    # a Maxwell element, and a low-pass filter that sees the displacement only
    law = rs.Law("c*v + k*x + z + k2*y", memory={"z": "k1*v - z/tau", "y": "a*(x - y)"})
    values = {"c": 4.0, "k": 5000.0, "k1": 2000.0, "tau": 0.02, "k2": 800.0, "a": 30.0}
    f = np.linspace(5, 15, 7)
    s = 2j * np.pi * f
    z, y = 2000 * s / (s + 1 / 0.02), 30 / (s + 30)
    exact = 3.0 / (1.5 * s**2 + 4 * s + 5000 + z + 800 * y)
    found = solve_steady_states(rs.Oscillator(1.5, law, values), np.full(7, 3.0), f, accuracy=1e-8)
    np.testing.assert_allclose(found.harmonics[:, 1], exact, rtol=1e-8)
    np.testing.assert_allclose(found.harmonics[:, 0], 0, atol=1e-8 * np.abs(exact).max())


def test_located_switches_of_states_keep_the_fourth_order():
    o = rs.Oscillator(2.0, BOUC_WEN, BENCHMARK)
    kernel = compile_kernel(o.force, values=o.values)
    values = np.array([o.values[name] for name in kernel.parameters])
    omega = 2 * np.pi * np.linspace(27, 49, 24)
    F = np.tile([50.0, 0.0], (24, 1))

    def state(steps: int) -> np.ndarray:
        start = np.zeros((3, 24))
        moved = kernel.integrate(np.arange(24), start, F, omega, 2.0, values, steps=steps, periods=3)
        return moved.state[:2]

    exact = state(4096)
    coarse, fine = (np.median(np.linalg.norm(state(steps) - exact, axis=0)) for steps in (64, 256))
    assert np.log(coarse / fine) / np.log(4) > 3.7


K, C = 5922.0, 3.8
"""Spring [N/m] and damper [N s/m] beside Masing laws: 10 Hz and 2 % damping with 1.5 kg."""


@pytest.mark.slow
def test_stiff_bristles_agree_with_dop853():
    # 5000 times faster than the motion: explicit steps of a 24th of a period would explode
    dz = "(v - s0*abs(v)*z/(Fc + (Fs - Fc)*exp(-(v/vs)**2)))"
    law = rs.Law(f"c*v + k*x + s0*z + s1*{dz}", memory={"z": dz})
    values = {"c": C, "k": K, "s0": 1e5, "s1": 30.0, "Fc": 0.5, "Fs": 0.7, "vs": 0.02}
    F, f = np.array([2.0, 6.0]), np.array([9.5, 10.6])
    structure = events.lugre(1.5, **values)
    for accuracy in (1e-4, 1e-6):
        found = solve_steady_states(rs.Oscillator(1.5, law, values), F, f, accuracy=accuracy)
        for i, omega in enumerate(2 * np.pi * f):
            y = found.state[i]
            X, _ = events.settle(structure, F[i], omega, start=y, mode=float(np.sign(y[1])))
            assert abs(found.harmonics[i, 1] / X - 1) < accuracy


@pytest.mark.slow
def test_loops_within_the_loop_agree_with_sliders():
    # a third of the resonance: the hardening spring makes a third harmonic that turns the motion six times
    law = rs.Law("c*v + k*x + k3*x**3 + masing(Min(kt*x, Fs))")
    values = {"c": 6.0, "k": 3000.0, "k3": 6e6, "kt": 1500.0, "Fs": 0.5}
    F, f = np.array([30.0, 60.0]), np.array([2.3, 2.6])
    structure = events.sliders(
        1.5, lambda x, v: 3000 * x + 6e6 * x**3 + 6 * v, np.array([1500.0]), np.array([0.5])
    )
    exact = [events.settle(structure, F[i], 2 * np.pi * f[i]) for i in range(2)]
    turns = [np.count_nonzero(np.diff(np.sign(np.diff(wave))) != 0) for _, wave in exact]
    assert min(turns) > 2
    for accuracy in (1e-4, 1e-6):
        found = solve_steady_states(rs.Oscillator(1.5, law, values), F, f, accuracy=accuracy)
        assert found.settled.all()
        assert np.abs(found.harmonics[:, 1] / [X for X, _ in exact] - 1).max() < accuracy


def test_a_step_of_nearly_singular_derivatives_does_not_leave_the_motion():
    """A joint that a negative spring nearly balances: the refined fixed point had an amplitude of 1e11 m."""
    law = "Ff*sign(v) + Fs*masing(Min(1, x/xs)) + c*v + k*x"
    values = {
        "Ff": 0.8128342796234922, "Fs": 2046.9898416837937, "c": 3.760881052172398, "k": -53057.15278215357,
        "xs": 0.03471043945920932,
    }  # fmt: skip
    force, frequency = np.array([8.073327314165057 + 5.855121410488167j]), np.array([9.67142857142857])
    start = np.array([[0.02111058714225442, -0.002247404300963254]])
    joint = rs.Oscillator(1.4988616284270644, law, values)
    found = solve_steady_states(joint, force, frequency, accuracy=3e-5, harmonics=31, start=start)
    # below its limit the joint is a spring: with friction alone the motion is the same
    linear = {"Ff": values["Ff"], "c": values["c"], "k": values["k"] + values["Fs"] / values["xs"]}
    spring = rs.Oscillator(joint.mass, "Ff*sign(v) + c*v + k*x", linear)
    same = solve_steady_states(spring, force, frequency, accuracy=3e-5)
    assert found.settled.all()
    assert found.harmonics[0, 1] == pytest.approx(same.harmonics[0, 1], rel=1e-4)
