"""Exact motions fulfil the equations from which a start is found, with what of a law is a number."""

import numpy as np
import pytest
from scipy.optimize import brentq

import rsgen
from rsgen.identification.starting.equations import Equations, equation_rows
from rsgen.law.motion import Motion
from rsgen.law.numeric import compile_law
from tests.oracles.harmonic_balance import solve_harmonic_balance

LAW = "k*x + 6e4*x**2 + c*v"
TRUE = {"c": 4.0, "k": 5000.0}
MASS = 1.5


def test_motions_of_a_balance_fulfil_fundamental_and_mean():
    force, frequency = np.array([2.0, 4.0 + 1.0j, 6.0]), np.array([8.0, 9.0, 10.0])
    harmonics, _ = solve_harmonic_balance(rsgen.Oscillator(MASS, LAW, TRUE), force, frequency, harmonics=8)
    law = compile_law(rsgen.Law(LAW).force)
    omega = 2 * np.pi * frequency
    equations = Equations(omega, force, harmonics, True, np.ones(3), np.zeros((0, 2)))
    matrix, right = equation_rows(equations, law, np.zeros(0))
    unknowns = np.array([*(TRUE[law.parameters[i]] for i in law.linear), MASS])
    # real part, imaginary part and mean of every motion
    assert matrix.shape == (9, 3)
    assert matrix @ unknowns == pytest.approx(right, abs=1e-9)
    # the number in the law takes part
    assert np.abs(right[6:]).min() > 0.01


def test_turning_points_of_free_motion_have_one_energy():
    def energy(x: float) -> float:
        return TRUE["k"] * x**2 / 2 + 6e4 * x**3 / 3

    high = np.array([0.01, 0.02])
    low = [brentq(lambda x, top=top: energy(x) - energy(top), -0.08, 0.0, xtol=1e-15) for top in high]
    motion = Motion(np.ones(2), np.array([[0.0, 0.01], [0.0, 0.02]], dtype=complex))
    law = compile_law(rsgen.Law(LAW).force)
    turning = np.column_stack([high, low])
    equations = Equations(motion.omega, np.ones(2, complex), motion.harmonics, False, np.ones(2), turning)
    matrix, right = equation_rows(equations, law, np.zeros(0))
    unknowns = np.array([*(TRUE[law.parameters[i]] for i in law.linear), MASS])
    assert matrix[-2:] @ unknowns == pytest.approx(right[-2:], rel=1e-9)
    assert np.abs(right[-2:]).min() > 1.0
