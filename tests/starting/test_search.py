"""Values found without a start: searches, and the equations that they fulfil."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

import rsgen
from rsgen.data.oscillator import Model
from rsgen.dynamics.virtual_test import add_noise
from rsgen.formula.reading import parse
from rsgen.identification.starting.equations import Equations, equation_rows
from rsgen.identification.starting.search import _Search as Search
from rsgen.identification.starting.start import _misfit_of_most, solve_equations
from rsgen.law.element import make_element
from rsgen.law.memory import with_memory
from rsgen.law.motion import Motion, project, sine_motion
from rsgen.law.numeric import compile_law
from tests.oracles.harmonic_balance import solve_harmonic_balance
from tests.virtual import simulated

MASS = 1.5
BASE = {"k": 5000.0, "c": 4.0}
SATURATION = "Max(-Fm, Min(ks*x, Fm))"


def identified(text: str, added: dict[str, float], level: tuple[float, float], noise: float, seed: int = 1):
    """Identify a law beside a linear spring and damper; the mass is free."""
    elements = (make_element("base", "k*x + c*v"), make_element("added", text))
    how = {"harmonics": 5, "accuracy": 1e-7}
    surface = simulated(elements, BASE | added, np.linspace(*level, 7), (7.0, 12.0, 45), MASS, **how)
    found = rsgen.identify(add_noise(surface, noise, seed) if noise else surface, Model(elements))
    return found, BASE | added | {"m": MASS}


@pytest.mark.slow
@pytest.mark.parametrize("noise", [pytest.param(0.0, marks=pytest.mark.thorough), 1e-2])
@pytest.mark.parametrize(("text", "added"), [
    (SATURATION, {"ks": 2000.0, "Fm": 20.0}),
    ("Max(0, ks*x - F0)", {"ks": 3000.0, "F0": 15.0}),
    # the same law with both signs turned
    ("Ff*tanh(v/w)", {"Ff": 1.0, "w": 0.2}),
    # the same law with both signs turned and a stiffer k
    ("kg*(Max(0, x - b) + Min(0, x + b))", {"kg": 3000.0, "b": 0.008}),
    # no other unknown multiplies what it switches
    pytest.param("Max(0, ks*(x - b) - 5)", {"ks": 3000.0, "b": 0.002}, marks=pytest.mark.thorough),
])  # fmt: skip
def test_values_come_back_with_their_signs(text, added, noise):
    found, true = identified(text, added, (2.0, 12.0), noise)
    for estimate in found.refined:
        error = abs(estimate.value - true[estimate.name])
        limit = 4.5 * estimate.standard_error if noise else 1e-6 * abs(true[estimate.name])
        assert error < limit, (estimate, true[estimate.name])


LAW = "k*x + 6e4*x**2 + c*v"
TRUE = {"c": 4.0, "k": 5000.0}


def rows_of(equations: Equations):
    """Rows and right sides of the equations of the law, and its values with the mass."""
    law = compile_law(rsgen.Law(LAW).force)
    return *equation_rows(equations, law, np.zeros(0)), [*(TRUE[law.parameters[i]] for i in law.linear), MASS]


def test_motions_of_a_balance_fulfil_fundamental_and_mean():
    force, frequency = np.array([2.0, 4.0 + 1.0j, 6.0]), np.array([8.0, 9.0, 10.0])
    harmonics, _ = solve_harmonic_balance(rsgen.Oscillator(MASS, LAW, TRUE), force, frequency, harmonics=8)
    equations = Equations(2 * np.pi * frequency, force, harmonics, True, np.ones(3), np.zeros((0, 2)))
    matrix, right, unknowns = rows_of(equations)
    assert matrix.shape == (9, 3)
    assert matrix @ unknowns == pytest.approx(right, abs=1e-9)
    assert np.abs(right[6:]).min() > 0.01


def test_turning_points_of_free_motion_have_one_energy():
    def energy(x: float) -> float:
        return TRUE["k"] * x**2 / 2 + 6e4 * x**3 / 3

    high = np.array([0.01, 0.02])
    low = [brentq(lambda x, top=top: energy(x) - energy(top), -0.08, 0.0, xtol=1e-15) for top in high]
    motion = Motion(np.ones(2), np.array([[0.0, 0.01], [0.0, 0.02]], dtype=complex))
    turning = np.column_stack([high, low])
    equations = Equations(motion.omega, np.ones(2, complex), motion.harmonics, False, np.ones(2), turning)
    matrix, right, unknowns = rows_of(equations)
    assert matrix[-2:] @ unknowns == pytest.approx(right[-2:], rel=1e-9)
    assert np.abs(right[-2:]).min() > 1.0


def test_a_window_ends_before_the_round_off_of_the_motion():
    # x + 1e14 m is a sum of steps, along which a stop seems another law than next to x = 0
    omega, amplitude = 2 * np.pi * np.linspace(15, 26, 23), np.geomspace(1e-4, 5e-3, 23)
    motion = amplitude[:, None] * [0, 1]
    force = amplitude * (8224 - 0.5 * omega**2 + 2j * omega)
    equations = Equations(omega, force, motion.astype(complex), False, np.ones(23), np.zeros((0, 2)))
    stop = compile_law(rsgen.Law("k*x + k_*Max(x - b, 0) + c*v").force)
    window = Search(equations, stop, 0.5).active_values(0)
    assert 4e-3 < window.max() < 5e-2
    assert -1e5 < window.min() < -1e-3


@pytest.mark.parametrize(("rate", "searched"), [("8", {}), ("g", {"g": 8.0})])
def test_a_start_leaves_out_loops_that_do_not_close(rate, searched):
    """The state grows for ever in motions beyond 0.06 m: two of twelve points have no force."""
    law = compile_law(with_memory(parse("k*x + c*v + Fs*z"), {"z": f"v - ({rate} - 200*abs(x))*z"}))
    true, omega = law.ordered({"Fs": 800.0, "c": 4.0, "k": 5000.0} | searched), np.linspace(50.0, 70.0, 12)
    motion = sine_motion(omega, np.geomspace(1e-3, 0.1, 12))
    force = project(law.along(motion, true, 128).force, 1) - MASS * omega**2 * np.abs(motion.harmonics[:, 1])
    assert np.isnan(force).sum() == 2
    equations = Equations.plain(omega, np.where(np.isnan(force), 50.0, force), motion.harmonics)
    found = solve_equations(equations, law, {})
    assert [*found.values, found.mass] == pytest.approx([*true, MASS], rel=1e-5)


def test_of_two_starts_a_point_at_a_jump_does_not_decide():
    def found(most: float, jump: float, lost: float):
        misfit = np.array([most] * 38 + [jump, lost])
        return SimpleNamespace(force=misfit, regression=SimpleNamespace(misfit=misfit))

    right, wrong = found(0.005, 1.55, np.nan), found(0.01, 1.54, 0.01)
    assert _misfit_of_most(right) == pytest.approx(0.005**2)
    assert _misfit_of_most(wrong) == pytest.approx(0.01**2)
