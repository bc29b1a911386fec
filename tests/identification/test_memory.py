"""Laws with memory identified from time stepping that knows nothing of loops, kernels or balances."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

import rsgen
from rsgen.data.oscillator import Model
from rsgen.data.surface import ResponseSurface
from rsgen.identification.fitting.fit import fit_balance, fit_simulator
from rsgen.identification.fitting.observed import Observed, Problem
from rsgen.identification.fitting.points import select_points
from rsgen.identification.identify import identify
from rsgen.law.element import laws, make_element
from rsgen.law.numeric import compile_law
from tests.oracles.memory import DAMPING, MASS, SPRING, sliding
from tests.surfaces import changed, codes, errors

BOUC_WEN = {"alpha": 2e4, "bg": 800.0, "bd": -500.0, "c": DAMPING, "k": SPRING, "m": MASS}


@pytest.fixture(scope="module")
def hysteretic() -> ResponseSurface:
    alpha, bg, bd = (BOUC_WEN[name] for name in ("alpha", "bg", "bd"))
    return sliding(
        lambda v, z: alpha * v - bg * np.abs(v) * z - bd * v * np.abs(z),
        np.inf, (20.0, 60.0, 180.0), (25.0, 31.0),
    )  # fmt: skip


@pytest.mark.slow
def test_bouc_wen_is_identified(hysteretic: ResponseSurface) -> None:
    """From first guess to interval; a hundredth of the stiffness moves with the level."""
    memory = {"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"}
    found = identify(hysteretic, Model((make_element("law", "k*x + c*v + z", memory),)))
    assert max(errors(found, BOUC_WEN).values()) < 1e-3
    assert found.residual / np.sqrt(2) < 1e-5


@pytest.mark.thorough
def test_names_that_act_in_products_only_leave_the_others_determined(hysteretic: ResponseSurface) -> None:
    """Differences of simulations do not vanish along a direction that changes nothing."""
    rng = np.random.default_rng(3)
    readings = [hysteretic.force[:, None], hysteretic.harmonics[:, [0, 1]]]
    noise = [
        0.005 * (rng.normal(size=a.shape) + 1j * rng.normal(size=a.shape)) / np.sqrt(2) for a in readings
    ]
    force, response = (a * (1 + part) for a, part in zip(readings, noise, strict=True))
    surface = ResponseSurface(hysteretic.level, hysteretic.frequency, force[:, 0], response[:, 1])
    memory = {"z": "alpha*v - beta*(gamma*abs(v)*z + delta*v*abs(z))"}
    wanted = Model((make_element("law", "k*x + c*v + z", memory),))
    observed = Observed.of(select_points(surface, wanted))
    problem = Problem(wanted.elements, compile_law(wanted.force), observed)
    near = {**BOUC_WEN, "beta": 0.2, "gamma": 4000.0, "delta": -2500.0}
    start = np.array([1.01 * near[name] for name in (*problem.law.parameters, "m")])
    balanced = fit_balance(problem, start, order=9)
    found = fit_simulator(problem, balanced, accuracy=1e-5)
    assert found is not None
    assert found.regression.converged
    assert found.regression.null.shape[1] == 1
    errors = np.sqrt(np.diag(found.regression.covariance))
    for i, name in enumerate(problem.law.parameters):
        if name in ("beta", "gamma", "delta"):
            assert np.isnan(errors[i])
        else:
            assert abs(found.values[i] - BOUC_WEN[name]) < 4 * errors[i]


@pytest.mark.slow
def test_a_jenkins_element_is_identified() -> None:
    """A slider that sticks at the lowest level and slips at the others."""
    kt, Fs = 1e4, 8.0
    surface = sliding(lambda v, z: kt * v, Fs, (15.0, 60.0, 180.0), (25.0, 29.0))
    found = identify(surface, Model((make_element("law", "k*x + c*v + masing(Min(kt*x, Fs))"),)))
    truth = {"Fs": Fs, "c": DAMPING, "k": SPRING, "kt": kt, "m": MASS}
    assert max(errors(found, truth).values()) < 5e-3
    assert found.residual < 1e-3


@pytest.mark.thorough
def test_a_law_that_runs_away_beyond_the_test_is_not_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dahl's friction far below its limit has no softening in X, as every Iwan joint has."""
    size, omega = (p.ravel() for p in np.meshgrid(np.geomspace(1e-4, 3e-3, 6), np.linspace(63, 94, 7)))
    energy = 4 / 3 * 3000.0**2 / 60.0 * size**3
    ratio = 8920.0 - 1.5 * omega**2 + 1j * (3.8 * omega + energy / (np.pi * size**2))
    surface = ResponseSurface(
        level=size,
        frequency=omega / (2 * np.pi),
        force=ratio * size,
        response=np.stack([np.zeros(len(size)), size], axis=1).astype(complex),
    )

    def fail(*_: object, **__: object) -> None:
        raise AssertionError("its motions would be followed for thousands of periods")

    monkeypatch.setattr(import_module("rsgen.identification.identify"), "fit_simulator", fail)
    law = (make_element("base", "k*x + c*v"), laws["iwan4"].element())
    found = identify(surface, Model(law))
    assert found.verdict.state in ("doubtful", "rejected")
    assert "law-does-not-fit" in codes(found)


IWAN = (
    "masing(R*Piecewise((x*phimax**(chi + 1)/(chi + 1) - x**(chi + 2)/((chi + 1)*(chi + 2)), x < phimax), "
    "(phimax**(chi + 2)/(chi + 2), True)) + S*Min(x, phimax))"
)
"""Segalman's joint, J. Appl. Mech. 72 (2005) 752."""


@pytest.mark.thorough
@pytest.mark.parametrize("size", [1.4e-7, 5e-4])
def test_laws_of_a_jointed_beam_start_at_any_size(size: float) -> None:
    """Micro-slip at 120 Hz whose largest motion is of a size [m]: a power law of power chi + 2."""
    mass, omega, chi = 1.9, 2 * np.pi * 120, -0.4
    k, phimax = mass * omega**2, 4 * size
    values = {"k": 0.8 * k, "c": 1e-3 * mass * omega, "chi": chi, "phimax": phimax, "S": 0.02 * k}
    values["R"] = 0.18 * k * (chi + 1) / phimax ** (chi + 1)
    beam = rsgen.Oscillator(mass, f"k*x + c*v + {IWAN}", values)
    alone = rsgen.derive(f"k*x + c*v + {IWAN}").evaluate(np.array([size]), omega, values)
    level = float(alone.damping[0]) * omega * size * np.geomspace(0.05, 1, 5)
    test = rsgen.SimulatedTest(
        level, np.linspace(106, 122, 33), noise_relative=0.003, seed=1, harmonics=5, method="harmonic-balance"
    )
    table = rsgen.simulate(beam, test)
    bare = np.full(table.harmonics.shape, np.nan, dtype=complex)
    bare[:, 1] = table.harmonics[:, 1]
    table = changed(table, harmonics=bare, peak=np.full(table.peak.shape, np.nan))
    power = rsgen.identify(table, "c*v + masing(K*x - R*x**p)")
    assert power.verdict.state == "identified"
    assert abs(power["p"].value - (chi + 2)) < 4 * power["p"].standard_error
    assert power.mass == pytest.approx(mass, rel=0.01)
    whole = rsgen.identify(table, f"k*x + c*v + {IWAN}")
    assert whole.verdict.state == "identified"
    assert abs(whole["chi"].value - chi) < 4 * whole["chi"].standard_error
