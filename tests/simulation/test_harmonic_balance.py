"""The harmonic balance against an independent one, time integration, closed forms and differences."""

import numpy as np
import pytest

from rsgen.common.solvers import newton
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics import harmonic_balance as balance
from rsgen.formula.reading import parse
from rsgen.law.numeric import compile_law
from tests.oracles import harmonic_balance as oracle

MASS = 1.5
OMEGA = 2 * np.pi * np.linspace(8, 12, 5)
DRIVE = np.array([2.0, 1.0 + 1.0j, 0.5, 3.0j, 1.0])
LAWS = {
    "hardening": ("c*v + k*x + kn*x**3", {"c": 3.8, "k": 5920.0, "kn": 2.5e6}),
    "asymmetric": ("c*v + k*x + k2*x**2 + k3*x**3", {"c": 3.8, "k": 5920.0, "k2": 4e4, "k3": 4e5}),
    "smooth friction": ("A*tanh(v/w) + c*v + k*x", {"A": 0.7, "c": 3.8, "k": 5920.0, "w": 0.3}),
    "coupled": ("c*v + k*x + cx*x**2*v", {"c": 3.8, "k": 5920.0, "cx": 3e4}),
}
FREQUENCY = OMEGA / 2 / np.pi


def close(slope: np.ndarray, high: np.ndarray, low: np.ndarray, step: float, allowed: float) -> None:
    """Hold derivatives against central differences, relative to the largest entry."""
    difference = (high - low) / (2 * step)
    assert np.abs(slope - difference).max() < allowed * np.abs(difference).max()


@pytest.mark.parametrize("name", LAWS)
def test_an_independent_balance_finds_the_same_motions(name):
    oscillator = Oscillator(MASS, *LAWS[name])
    ours = balance.solve_harmonic_balance(oscillator, DRIVE, FREQUENCY, harmonics=9)
    harmonics, residual = oracle.solve_harmonic_balance(oscillator, DRIVE, FREQUENCY, harmonics=9)
    assert ours.settled.all()
    np.testing.assert_allclose(ours.harmonics, harmonics, rtol=0, atol=1e-10 * np.abs(harmonics).max())
    np.testing.assert_allclose(ours.residual, residual, atol=1e-9)
    # held amplitudes need the force that makes them
    size = np.abs(ours.harmonics[:, 1])
    held = balance.hold_oscillator(oscillator, size, FREQUENCY, harmonics=9)
    np.testing.assert_allclose(held.force, DRIVE / ours.harmonics[:, 1] * size, rtol=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_derivatives_at_a_given_drive_are_those_of_the_motion(name):
    text, values = LAWS[name]
    law = compile_law(Oscillator(MASS, text, values).force)
    drive, start = np.zeros((2, len(OMEGA), 8), dtype=complex)
    drive[:, 1] = DRIVE

    def solve(place: np.ndarray, times: float = 1.0):
        orders = (*((0,) if law.springs else ()), *range(2, 8))
        return balance.respond(law, place[:-1], place[-1], OMEGA, times * drive, start, orders, 256)

    place, h = np.append(law.ordered(values), MASS), 1e-5
    # near the motion of the law alone, from which all trials begin
    alone = Oscillator(MASS, text, values)
    start[:] = balance.solve_harmonic_balance(alone, DRIVE, FREQUENCY, harmonics=7).harmonics
    at = solve(place)
    assert at.valid.all()
    for j, value in enumerate(place):
        step = h * value * np.eye(len(place))[j]
        high, low = solve(place + step).harmonics, solve(place - step).harmonics
        close(at.harmonics_by[:, :, j], high, low, h * value, 1e-6)
    close(at.harmonics_slope, solve(place, 1 + h).harmonics, solve(place, 1 - h).harmonics, h, 1e-6)
    np.testing.assert_array_equal(at.force_by, 0)
    np.testing.assert_allclose(at.force_slope, DRIVE)


SIZE = np.linspace(0.01, 0.03, 5)


def hold(text: str, place: np.ndarray, size: np.ndarray = SIZE, order: int = 9, samples: int = 128):
    law = compile_law(parse(text))
    start = np.zeros((len(OMEGA), order + 1), dtype=complex)
    orders = balance.following_harmonics(law, order)
    return balance.hold_amplitude(law, place[:-1], place[-1], OMEGA, size, start, orders, samples)


@pytest.mark.parametrize("name", LAWS)
def test_derivatives_at_a_held_amplitude_are_those_of_the_balance(name):
    text, values = LAWS[name]
    place = np.array([*(values[key] for key in sorted(values)), MASS])
    at = hold(text, place)
    assert at.valid.all()
    # near the cube root of what the balance leaves of its equations, relative
    h = 1e-4
    for j, value in enumerate(place):
        step = h * value * np.eye(len(place))[j]
        high, low = hold(text, place + step), hold(text, place - step)
        close(at.force_by[:, j], high.force, low.force, value * h, 1e-7)
        close(at.harmonics_by[:, :, j], high.harmonics, low.harmonics, value * h, 1e-7)
    high, low = (hold(text, place, SIZE * (1 + s * h)) for s in (1, -1))
    close(at.force_slope, high.force, low.force, h, 1e-7)
    close(at.harmonics_slope, high.harmonics, low.harmonics, h, 1e-7)


def test_one_harmonic_gives_the_describing_functions():
    # Liu et al., Eqs. (14), (16), (23)
    place = np.array([2.0, 3.0, 4000.0, 1e5, 1e8, MASS])
    at = hold("k*x + k3*x**3 + k5*x**5 + c*v + cn*v*abs(v)", place, order=1, samples=4096)
    stiffness = 4000 + 3 / 4 * 1e5 * SIZE**2 + 5 / 8 * 1e8 * SIZE**4
    damping = 2 + 8 * 3 * OMEGA * SIZE / (3 * np.pi)
    assert at.force / SIZE == pytest.approx(stiffness - MASS * OMEGA**2 + 1j * OMEGA * damping, rel=1e-6)


class Arctangents:
    """atan(u - root) = 0: Newton's full step runs away from |u - root| > 1.39; one of them has no step."""

    def __init__(self, roots: np.ndarray) -> None:
        self.roots, self.asked = roots, 0

    def residual(self, rows: np.ndarray, unknowns: np.ndarray) -> np.ndarray:
        self.asked += len(rows)
        return np.arctan(unknowns - self.roots[rows, None])

    def step(self, rows: np.ndarray, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        left = np.arctan(unknowns - self.roots[rows, None])
        move = -left * (1 + (unknowns - self.roots[rows, None]) ** 2)
        return left, move, np.abs(move[:, 0])


def test_newton_halves_steps_and_keeps_problems_apart():
    roots = np.array([0.0, 3.0, -8.0, np.nan, 1e-3])
    found = newton(Arctangents(roots), np.zeros((5, 1)), steps=30, halvings=8)
    good = np.isfinite(roots)
    np.testing.assert_allclose(found.unknowns[good, 0], roots[good], atol=1e-12)
    assert np.all(found.last_step[good] <= 1e-9)
    assert found.last_step[3] == np.inf
    # without halves the far ones leave
    lost = newton(Arctangents(roots), np.zeros((5, 1)), steps=30, halvings=1)
    assert not np.all(lost.last_step[good] <= 1e-9)
