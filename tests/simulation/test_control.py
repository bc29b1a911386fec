"""Controlled tests: phase-locked loops against closed forms, held amplitudes against force control."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rsgen
from rsgen import RsgenError, SimulatedTest
from rsgen.data.surface.plausibility import lag_findings
from rsgen.dynamics.controlled import hold_states
from rsgen.dynamics.steady_state import solve_steady_states
from tests.surfaces import joined

CASES = Path(__file__).parents[2] / "cases"
LAW = "k*x + k3*x**3 + c*v"
MASS, K, K3, C = 1.5, 5920.0, 3e5, 3.8
LEVELS = np.linspace(1, 12, 5)


def oscillator(force: str = LAW, **values: float) -> rsgen.Oscillator:
    return rsgen.Oscillator(MASS, force, values or {"k": K, "k3": K3, "c": C})


def locked(system: rsgen.Oscillator, **options: object) -> rsgen.ResponseSurface:
    settings = {"level": LEVELS, "frequency": [8, 14], "control": "phase", "accuracy": 1e-6}
    return rsgen.simulate(system, SimulatedTest(**(settings | options)))


def test_a_linear_mode_is_found_at_its_natural_frequency():
    surface = locked(oscillator("k*x + c*v", k=K, c=C))
    np.testing.assert_allclose(surface.omega, np.sqrt(K / MASS), rtol=1e-7)
    np.testing.assert_allclose(surface.amplitude, LEVELS / (C * np.sqrt(K / MASS)), rtol=1e-6)
    assert (surface.control, surface.level_unit, len(surface.levels)) == ("phase", "N", 5)


def test_points_are_those_of_the_force_controlled_test_at_the_frequency_found():
    """From rest, where the resonance is stable under constant force: softly nonlinear, so nothing folds."""
    system = oscillator(k=K, k3=2e4, c=C)
    surface = locked(system, harmonics=5)
    for row in range(len(surface)):
        test = SimulatedTest(LEVELS[row], surface.frequency[row], harmonics=5, accuracy=1e-6)
        forced = rsgen.simulate(system, test)
        np.testing.assert_allclose(surface.amplitude[row], forced.amplitude[0], rtol=1e-4)
        turned = surface.harmonics[row, 3] * (surface.force[row] / LEVELS[row]) ** -3
        np.testing.assert_allclose(turned, forced.harmonics[0, 3], rtol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("second", "apart"), [(1.0, False), (1.3, True)])
def test_points_of_two_modes_are_no_backbone(second, apart):
    """The other mode is as stiff, and lighter; a band with one of them is what it takes."""
    one = locked(oscillator(), level=np.linspace(1, 12, 12))
    other = replace(one, frequency=one.frequency * second, harmonics=one.harmonics / second)
    both = joined(one, other)
    gaps = [finding.names for finding in lag_findings(both) if finding.code == "phase-gap"]
    assert gaps == ([{"overlap": "yes"}] if apart else [])
    if apart:
        with pytest.raises(RsgenError, match="two modes"):
            rsgen.modal_table(both)
        said = replace(both, findings=lag_findings(both))
        assert not rsgen.identify(said, LAW, mass=MASS).verdict.usable
        table = rsgen.modal_table(both, rsgen.Observation(band=(9.0, 11.0)))
        np.testing.assert_allclose(table.at(one.amplitude).frequency, one.frequency, rtol=1e-3)


# 31 harmonics of dry friction leave the next ones, where it takes most of the force
@pytest.mark.parametrize(("name", "off"), [("coulomb", 2e-3), ("bilinear", 2e-4)])
def test_force_control_finds_the_same_motions(name, off):
    case = rsgen.load_case(CASES / f"{name}.toml")
    X, f = np.repeat([1e-3, 5e-3, 1.2e-2], 9), np.tile(np.linspace(7.5, 12.5, 9), 3)
    held = hold_states(case.oscillator, X, f, harmonics=7, order=31)
    assert np.all(held.outcome == 0)
    assert np.abs(held.harmonics[:, 1] / X - 1).max() < 1e-10
    free = solve_steady_states(
        case.oscillator, held.force[held.stable], f[held.stable], start=held.state[held.stable]
    )
    assert np.abs(free.harmonics[:, 1] / X[held.stable] - 1).max() < off


def test_motions_are_unstable_where_more_of_them_needs_less_force():
    test = rsgen.SimulatedTest(
        level=np.linspace(3e-3, 6e-2, 24), frequency=np.linspace(9.6, 10.8, 6), control="continuation",
        harmonics=9, accuracy=1e-8,
    )  # fmt: skip
    surface = rsgen.simulate(oscillator(k=K, k3=K3, c=2.0), test)
    assert (surface.control, surface.level_unit) == ("continuation", "m")
    order = np.lexsort((surface.level, surface.frequency))
    force, stable = (part[order].reshape(6, 24) for part in (np.abs(surface.force), surface.stable))
    falls = np.diff(force, axis=1) < 0
    # a fold lies between two points, of which either may count
    assert np.count_nonzero(~stable) > 15
    assert np.all(falls[~stable[:, :-1] & ~stable[:, 1:]])
    assert not np.any(falls[stable[:, :-1] & stable[:, 1:]])
