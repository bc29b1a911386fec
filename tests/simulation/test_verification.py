"""Brute force finds what the solver finds, and says where it does not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rsgen import load_case
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.simulation import simulate
from rsgen.dynamics.virtual_test import SimulatedTest
from rsgen.law.element import make_element
from tests.oracles.long_transients import largest_difference

CASES = Path(__file__).parents[2] / "cases"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cubic", "quintic", "coulomb", "piecewise", "bilinear"])
def test_brute_force_agrees_on_the_cases(name):
    case = load_case(CASES / f"{name}.toml")
    surface = simulate(case.oscillator, replace(case.test, accuracy=1e-4))
    assert largest_difference(case.oscillator, surface, sample=120) < 1e-4


def test_another_branch_is_noticed():
    o = Oscillator(1.5, (make_element("all", "c*v + k*x + kn*x**3"),), {"c": 3.8, "k": 5920.0, "kn": 2.5e6})
    test = SimulatedTest([10.0], np.linspace(11.2, 11.6, 9))
    up = simulate(o, SimulatedTest([10.0], np.linspace(10, 11.6, 33), sweep="up"))
    upper = up.select(up.frequency > 11.19)
    assert largest_difference(o, simulate(o, test)) < 1e-4
    assert largest_difference(o, replace(upper, sweep=np.full(len(upper), "rest"))) > 0.5


def test_a_gap_met_late_in_the_transient_is_not_overlooked():
    """After 8 periods this motion spirals, perfectly linear, to an answer that it will never reach."""
    k = 1.5 * (2 * np.pi * 10) ** 2
    law = "c*v + Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True))"
    values = {"c": 0.04 * np.sqrt(1.5 * k), "k4": k, "k5": 1.4 * k, "b": 5e-3}
    o = Oscillator(1.5, (make_element("all", law),), values)
    test = SimulatedTest([1 + 11 * 2 / 39], np.linspace(7, 13, 200)[100:112])
    assert largest_difference(o, simulate(o, test)) < 1e-4
