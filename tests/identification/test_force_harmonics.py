"""A shaker that distorts: harmonics of the force in the balance, on exact motions that no solver made."""

from dataclasses import replace

import numpy as np
import pytest

import rsgen as rs
from rsgen.law.motion import Motion, project
from tests.surfaces import errors

MASS, TRUE = 2.0, {"k": 2e4, "k3": 5e9, "c": 4.0}
LAW = "k*x + k3*x**3 + c*v"


def distorted(even: float = 0.0, turn: float = 0.0, cut: int = 8, low: float = 12) -> rs.ResponseSurface:
    """The force is what motions with free third and fifth (and even) harmonics ask for; law of odd order."""
    frequency = np.tile(np.linspace(low, 22, 40), 3)
    omega = 2 * np.pi * frequency
    size = np.repeat([2e-4, 6e-4, 1.2e-3], 40) / (1 + ((frequency - 17) / 4) ** 2)
    phase = np.exp(1j * np.linspace(0, 5, len(size)))
    x = np.zeros((len(size), cut), dtype=complex)
    for order, share in ((1, 1.0), (3, 0.04j), (5, 0.02), (0, even), (2, 0.5j * even)):
        x[:, order] = share * size * phase**order
    x[:, 0] = x[:, 0].real
    wave, speed, acceleration = Motion(omega, x).waveforms(128)
    force = MASS * acceleration + TRUE["k"] * wave + TRUE["k3"] * wave**3 + TRUE["c"] * speed
    harmonics = np.stack([project(force, order) for order in range(16)], axis=1)
    harmonics *= np.exp(-1j * turn * np.arange(16))
    return rs.ResponseSurface(np.repeat([1.0, 2.0, 3.0], 40), frequency, harmonics, x, sweep="rest")


@pytest.mark.slow
@pytest.mark.parametrize("even", [0.0, 0.03])
def test_recorded_harmonics_of_the_force_make_the_balance_exact(even):
    surface = distorted(even)
    found = rs.identify(surface, LAW)
    assert max(errors(found, TRUE | {"m": MASS}).values()) < 1e-8
    # as a sine, the same force leaves what it does not say to the law
    sine = rs.identify(replace(surface, force_harmonics=np.zeros((len(surface), 2))), LAW)
    assert sine.residual > 1e-3 > 1e-7 > found.residual


def test_a_phase_error_turns_every_harmonic():
    found = rs.identify(distorted(turn=0.1), LAW, rs.Observation(background="phase"))
    assert max(errors(found, TRUE | {"m": MASS}).values()) < 1e-6
    assert found.background.estimates[0].value == pytest.approx(0.1, abs=1e-6)


def test_a_stepped_sine_brings_the_harmonics_that_stand_out_of_the_noise():
    rate, random = 1000.0, np.random.default_rng(2)
    steps, records = [8.0, 9.0, 10.0], []
    for f in steps:
        t = np.arange(0, 12, 1 / rate)
        turn = 2 * np.pi * f * t
        force = 5 * np.cos(turn) + 0.3 * np.cos(2 * turn + 1.0) + 0.2 * np.cos(3 * turn - 0.5)
        records.append((force + 0.05 * random.standard_normal(len(t)), 1e-3 * np.cos(turn - 1.0)))
    force, response = (np.concatenate(parts) for parts in zip(*records, strict=True))
    surface = rs.history.from_stepped_sine(rs.history.TimeHistory(rate, force, response))
    clock = surface.force_harmonics * np.exp(-1j * np.angle(surface.force))[:, None] ** np.arange(
        surface.force_harmonics.shape[1]
    )
    np.testing.assert_allclose(
        clock[:, 1:4], np.tile([5, 0.3 * np.exp(1j), 0.2 * np.exp(-0.5j)], (3, 1)), atol=5e-3
    )
    assert not clock[:, [0, *range(4, clock.shape[1])]].any()
