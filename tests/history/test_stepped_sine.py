"""Stepped sines: steps found, settled parts fitted; the sine fit against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsgen.data.history import TimeHistory, from_stepped_sine
from rsgen.data.history.stepped_sine import fit_sine, refine_frequency
from rsgen.data.surface.response_surface import Outcome
from tests.history.test_decay import MASS, RATE, STIFFNESS, response_to

HELD = 2e-3
"""Straight lines between 50 samples a period make the fundamental smaller by (pi/50)^2/3, or 0.13 %."""


def stepped(frequencies: np.ndarray, levels: np.ndarray, dwell: float) -> tuple[np.ndarray, np.ndarray]:
    """Force and displacement of a linear oscillator; the phase of the force goes on from step to step."""
    omega = 2 * np.pi * np.repeat(frequencies, int(dwell * RATE)) / RATE
    phase = np.cumsum(omega) - omega
    force = np.repeat(levels, int(dwell * RATE)) * np.sin(phase)
    return force, response_to(force)


@pytest.mark.slow
def test_steps_of_frequency_are_found_and_their_points_lie_on_the_receptance() -> None:
    frequencies = np.concatenate([np.linspace(9, 11, 21), np.linspace(10.9, 9, 20)])
    force, x = stepped(frequencies, np.full(41, 3.0), 30)
    surface = from_stepped_sine(TimeHistory(RATE, force, x))
    assert len(surface) == 41
    np.testing.assert_allclose(surface.frequency, frequencies, rtol=1e-8)
    assert surface.sweep.tolist() == ["up"] * 21 + ["down"] * 20
    assert surface.levels.tolist() == [3.0]
    assert surface.settled.all()
    exact = STIFFNESS - MASS * surface.omega**2 + 1j * surface.omega * 1.9
    assert np.max(np.abs(surface.force / surface.harmonics[:, 1] / exact - 1)) < HELD + 5e-3 / 2


@pytest.mark.parametrize("first", [9.0, 9.2, 11.0, 11.4])
def test_a_first_step_from_rest_is_not_settled_before_its_transient_has_gone(first: float) -> None:
    # 40 periods at a damping ratio of 1 %: 8 % of the transient is left, up to 4 % in the halves that agree
    surface = from_stepped_sine(TimeHistory(RATE, *stepped(first + np.array([0, 0.05]), np.ones(2), 4.0)))
    assert surface.settled.tolist() == [False, True]


@pytest.mark.parametrize(("quantity", "power"), [("displacement", 0), ("velocity", 1), ("acceleration", 2)])
def test_quantities_and_harmonics(quantity: str, power: int) -> None:
    t = np.arange(20_000) / RATE
    omega = 2 * np.pi * 7.0
    shape = np.array([0.0, 1e-3, 2e-4j, -1e-4])
    turn = np.exp(1j * omega * np.arange(4)[:, None] * t)
    response = ((1j * omega * np.arange(4))[:, None] ** power * shape[:, None] * turn).sum(0).real
    # an offset of the drive larger than its amplitude hides no step
    surface = from_stepped_sine(TimeHistory(RATE, np.cos(omega * t) + 1.5, response, quantity))
    found = surface.harmonics[0] / (surface.force[0] / np.abs(surface.force[0])) ** np.arange(6)
    np.testing.assert_allclose(found[1:4], shape[1:], rtol=1e-6, atol=1e-12)
    assert np.isnan(found[0]) == (power > 0)


def test_halves_of_a_noisy_step_that_agree_within_noise_are_settled_with_their_true_difference():
    t = np.arange(0, 60, 0.01)
    omega = 2 * np.pi * np.where(t < 30, 5, 6)
    noise = 3e-4 * np.random.default_rng(1).normal(size=len(t))
    surface = from_stepped_sine(TimeHistory(100, 2 * np.cos(omega * t), 1e-3 * np.cos(omega * t - 1) + noise))
    assert surface.settled.all()
    # the difference of two halves has twice the error of the whole
    assert np.all(surface.residual > 0.005)
    assert np.all(surface.residual < 4 * 2 * surface.error)


@pytest.mark.parametrize(("pace", "doubts"), [(0.01, ["points-excluded"]), (0.0, [])], ids=["swept", "held"])
def test_a_slow_sweep_that_is_read_as_steps_which_do_not_settle_is_a_doubt(pace: float, doubts: list[str]):
    t = np.arange(0, 60, 1 / RATE)
    force = np.sin(2 * np.pi * (9.6 + pace * t / 2) * t)
    surface = from_stepped_sine(TimeHistory(RATE, force, response_to(force)))
    assert [finding.code for finding in surface.findings if finding.severity == "doubt"] == doubts


@settings(max_examples=20)
@given(f=st.floats(0.01, 0.12), off=st.floats(-0.4, 0.4), phase=st.floats(0, 6), mean=st.floats(-2, 2))
def test_a_sine_is_fitted_exactly_and_its_frequency_refined(f: float, off: float, phase: float, mean: float):
    n = 3000
    omega = 2 * np.pi * f
    i = np.arange(n)
    signal = mean + np.cos(omega * i + phase) + 0.1 * np.cos(3 * omega * i)
    refined = refine_frequency(signal, omega + off * 2 * np.pi / n, 3)
    assert refined == pytest.approx(omega, rel=1e-10)
    harmonics, residual = fit_sine(signal, refined, 3)
    np.testing.assert_allclose(harmonics, [mean, np.exp(1j * phase), 0, 0.1], atol=1e-7)
    assert residual < 1e-6


def test_the_error_of_a_step_is_that_of_its_noise() -> None:
    # an amplitude of N samples with noise of standard deviation s has the variance 2 s^2/N
    generator, level = np.random.default_rng(8), 3.0
    t = np.arange(0, 40, 1 / RATE)
    force, noise = level * np.cos(2 * np.pi * 10 * t), 0.1 * generator.standard_normal(len(t))
    surface = from_stepped_sine(TimeHistory(RATE, force, 1e-3 * (np.cos(2 * np.pi * 10 * t - 1) + noise)))
    assert len(surface) == 1
    # of the whole step, from which a last part may be taken
    assert surface.error[0] == pytest.approx(0.1 * np.sqrt(2 / len(t)), rel=0.1)


@pytest.mark.parametrize(("half", "decay", "outcome"), [
    (0.3, 0.0, Outcome.PERIOD_TWO), (0.005, 0.0, Outcome.SETTLED), (0.3, 0.2, Outcome.SETTLED),
])  # fmt: skip
def test_a_step_whose_motion_repeats_after_two_periods_is_called_so(half, decay, outcome):
    t = np.arange(0, 40, 1 / RATE)
    omega = 2 * np.pi * np.where(t < 20, 10, 12)
    x = np.cos(omega * t - 1) + half * np.exp(-decay * (t - 20)) * (t >= 20) * np.cos(omega * t / 2)
    x += 1e-3 * np.random.default_rng(4).standard_normal(len(t))
    surface = from_stepped_sine(TimeHistory(RATE, np.cos(omega * t), x))
    assert surface.outcome.tolist() == [Outcome.SETTLED, outcome]
