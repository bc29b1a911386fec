"""Phase resonance without a mass: ratios to the mass that contain the truth, and nothing that needs one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsgen
from rsgen.files import MeasuredTest, Signal, read_measurement
from rsgen.report.figures import draw_resonance, draw_stiffness
from tests.surfaces import noisy

MASS, VALUES = 1.5, {"k": 5920.0, "k3": 3e5, "c": 3.8}
LAW = "k*x + k3*x**3 + c*v"


def locked(
    law: str = LAW, lag: float = 90.0, noise: float = 0.01, seed: int = 1, **values: float
) -> rsgen.ResponseSurface:
    """24 levels held near a quarter period; a lag in degrees."""
    test = rsgen.SimulatedTest(
        level=np.linspace(1, 12, 24),
        frequency=[6, 18],
        control="phase",
        phase_error=float(np.radians(lag - 90)),
        noise_relative=noise,
        seed=seed,
        accuracy=1e-4 if "masing" in law else 1e-6,
    )
    return rsgen.simulate(rsgen.Oscillator(MASS, law, values or VALUES), test)


@pytest.mark.slow
@pytest.mark.parametrize(
    "lag", [90.0, *(pytest.param(lag, marks=pytest.mark.thorough) for lag in (92.0, 86.0)), 103.0]
)
def test_ratios_to_the_mass_contain_the_truth_whatever_lag_the_loop_held(lag: float):
    for seed in range(4):
        found = rsgen.identify(locked(lag=lag, seed=seed), LAW)
        for name in ("k", "k3"):
            why = found[name].finding
            assert np.isnan(found[name].value)
            assert why["low"] < VALUES[name] / MASS < why["high"], (name, seed)
            assert why["high"] - why["low"] < (0.06 if lag < 100 else 0.2) * why["ratio"]
            assert why.numbers["ratio"].unit == {"k": "1/s^2", "k3": "N/m^3/kg"}[name]
        assert np.isnan(found.mass)
        assert found["c"].value == pytest.approx(VALUES["c"], rel=0.03)


@pytest.mark.parametrize(("damping", "inside"), [(9.0, True), (20.0, False)])
def test_the_mass_from_which_on_ratios_hold_is_said(damping: float, inside: bool):
    """Damping ratios of 4.8 and 10.6 %: without a mass nothing separates them, but c bounds the mass."""
    found = rsgen.identify(locked(lag=92.0, noise=0.0, **(VALUES | {"c": damping})), LAW)
    why = found["k"].finding
    (said,) = (finding for finding in found.findings if finding.code == "ratios-hold-from")
    assert said["least"] == pytest.approx(damping / (2 * 0.05 * np.sqrt(VALUES["k"] / MASS)), rel=0.05)
    assert (said["least"] < MASS) == (why["low"] < VALUES["k"] / MASS < why["high"]) == inside
    given = rsgen.identify(locked(lag=92.0, noise=0.0, **(VALUES | {"c": damping})), LAW, mass=1.2 * MASS)
    assert given["k"].value / (1.2 * MASS) == pytest.approx(VALUES["k"] / MASS, rel=0.002)


@pytest.mark.slow
@pytest.mark.parametrize("lags", [(80, 90, 100), (70, 80, 90), (75, 85), (88, 92)])
def test_slices_a_few_degrees_apart_determine_the_mass_and_every_value(lags: tuple[float, ...]):
    """F/X = k - m omega^2 + i omega c differs between them: a mass that is assumed would not fit."""
    test = rsgen.SimulatedTest(
        level=np.linspace(1, 12, 8), frequency=[6, 18], control="phase", lags=tuple(np.radians(lags))
    )
    exact = rsgen.simulate(rsgen.Oscillator(MASS, LAW, VALUES), test)
    truth = {**VALUES, "m": MASS}
    found = rsgen.identify(exact, LAW)
    assert found.verdict.state == "identified"
    for name, value in truth.items():
        assert found[name].value == pytest.approx(value, rel=1e-5), name
    read = noisy(exact, 0.003, 1)
    found, table = rsgen.identify(read, LAW), rsgen.modal_table(read)
    assert found.verdict.state == "identified"
    for name, value in truth.items():
        assert abs(found[name].value - value) < 3 * found[name].standard_error, name
    assert found["m"].standard_error < 0.1 * MASS
    assert abs(table.mass - MASS) < 3 * table.mass_error < 0.4 * MASS
    assert table.misfit < 0.005


@pytest.mark.slow
def test_exact_data_are_identified_to_round_off_and_nothing_is_made_of_an_assumed_mass():
    found = rsgen.identify(locked(noise=0.0), LAW)
    assert found.verdict.state == "identified"
    assert found["k"].finding["ratio"] == pytest.approx(VALUES["k"] / MASS, rel=1e-5)
    assert found["k3"].finding["ratio"] == pytest.approx(VALUES["k3"] / MASS, rel=1e-4)
    assert np.isnan(found.curve.stiffness).all()
    assert np.isnan([r.damping_ratio for r in found.resonances]).all()
    assert np.isnan(found.covariance[1:]).all()
    assert found.restoring is None
    resonance, stiffness = (draw(found).alternative for draw in (draw_resonance, draw_stiffness))
    assert "the damping ratio is not known" in resonance
    assert "without a mass none has a stiffness" in stiffness
    curves = rsgen.predict(found)
    assert (len(curves), curves.findings[0].code) == (0, "needs-mass")
    with pytest.raises(rsgen.RsgenError, match="give it, or points off phase resonance"):
        rsgen.rank(locked(noise=0.0), [LAW, "k*x + c*v"])


def test_one_frequency_at_resonance_is_no_negative_mass():
    """A linear structure at its resonance: the real part of F/X is round-off, of either sign."""
    omega, level = np.sqrt(VALUES["k"] / MASS), np.linspace(1, 12, 24)
    force = level * np.exp(1e-14j * np.cos(np.arange(24)))
    surface = rsgen.ResponseSurface(level, np.full(24, omega / 2 / np.pi), force, level / (1j * omega * 3.8))
    found = rsgen.identify(surface, "k*x + c*v")
    assert found.verdict.state == "identified"
    assert found["k"].finding["ratio"] == pytest.approx(omega**2, rel=1e-9)
    assert found["c"].value == pytest.approx(3.8, rel=1e-9)


@pytest.mark.slow
def test_a_law_whose_damping_contains_its_stiffness_determines_the_mass():
    truth = {"k": 5920.0, "c": 2.0, "kt": 800.0, "Fs": 5.0}
    law = "k*x + c*v + masing(Min(kt*x, Fs))"
    found = rsgen.identify(locked(law, noise=0.003, **truth), law)
    for name, value in {**truth, "m": MASS}.items():
        assert abs(found[name].value - value) < 4 * found[name].standard_error, name
    (said,) = (finding for finding in found.findings if finding.code == "mass-at-resonance")
    assert said.names == {"by": "loops"}


@pytest.mark.slow
def test_a_friction_force_is_no_ratio_and_a_law_with_two_springs_has_a_ratio_for_each():
    truth = {"k": 5920.0, "k2": 1e4, "k3": 3e5, "c": 2.0, "Ff": 0.5}
    law = "k*x + k2*x**2 + k3*x**3 + c*v + Ff*sign(v)"
    found = rsgen.identify(locked(law, noise=0.003, **truth), law)
    assert found["Ff"].value == pytest.approx(0.5, rel=0.1)
    for name in ("k", "k2", "k3"):
        assert found[name].finding["low"] < truth[name] / MASS < found[name].finding["high"], name


@pytest.mark.slow
@pytest.mark.parametrize("lag", [88.0, 92.0])
def test_a_lag_that_was_not_recorded_is_in_every_interval(tmp_path: Path, lag: float):
    surface = locked(lag=lag, noise=1e-4)
    path = tmp_path / "loop.csv"
    table = np.stack([surface.frequency, np.abs(surface.force), surface.amplitude], axis=1)
    np.savetxt(path, table, delimiter=",", header="f,force,response", comments="")
    read = read_measurement(
        MeasuredTest(
            files=path,
            frequency="f",
            force=Signal(amplitude="force"),
            response=Signal(amplitude="response"),
            quantity="displacement",
            phase_known=False,
            control="phase",
        )
    )
    (said,) = (finding for finding in read.findings if finding.code == "phase-lag")
    assert said.names == {"by": "assumed"}
    found = rsgen.identify(read, LAW, mass=MASS)
    low, high = found["k"].interval
    assert low < VALUES["k"] < high
    assert abs(found["k"].value - VALUES["k"]) > 0.2 * (high - low) / 4, "the error is one that counts"
    ratio = rsgen.identify(read, LAW)["k"].finding
    assert ratio["low"] < VALUES["k"] / MASS < ratio["high"]
    for mass in (MASS, None):
        modal = rsgen.modal_table(read, mass=mass)
        exact = rsgen.modal_table(locked(noise=0.0), mass=MASS).at(modal.amplitude).stiffness_per_mass
        assert np.all(modal.stiffness_per_mass_lower < exact)
        assert np.all(exact < modal.stiffness_per_mass_upper)


@pytest.mark.slow
def test_a_test_without_scale_has_its_ratios():
    found = rsgen.identify(locked(), LAW, rsgen.Observation(calibrated=False))
    assert found["k"].finding["low"] < VALUES["k"] / MASS < found["k"].finding["high"]
    assert "not-calibrated" in [finding.code for finding in found.findings]


@pytest.mark.slow
@pytest.mark.parametrize("mass", [pytest.param(MASS, marks=pytest.mark.thorough), None])
@pytest.mark.parametrize("law", ["k*x + c*v", "k*x + k3*x**3"])
def test_a_wrong_law_on_a_backbone_is_doubted(law: str, mass: float | None):
    """One point a level has no neighbour in frequency: its neighbour is the next amplitude."""
    truth = {"k": 5920.0, "k3": 3e5, "c": 3.8, "Ff": 0.6}
    surface = locked(LAW + " + Ff*sign(v)", noise=0.003, **truth)
    assert rsgen.identify(surface, LAW + " + Ff*sign(v)", mass=mass).verdict.state == "identified"
    found = rsgen.identify(surface, law + " + Ff*sign(v)" * ("c*v" in law), mass=mass)
    assert found.verdict.state in ("doubtful", "rejected")
    frictionless = rsgen.identify(surface, LAW, mass=mass)
    assert "law-does-not-fit" in [finding.code for finding in frictionless.verdict.decided_by]


@pytest.mark.parametrize(("name", "state"), [("k", "identified"), ("c", "doubtful")])
def test_a_fixed_stiffness_determines_the_mass(name: str, state: str):
    found = rsgen.identify(locked(), LAW, fixed={name: VALUES[name]})
    assert found.verdict.state == state
    assert ("mass-at-resonance" in {finding.code for finding in found.findings}) == (state == "doubtful")
    if state == "identified":
        assert found.mass == pytest.approx(MASS, rel=5e-3)
        assert abs(found["k3"].value - VALUES["k3"]) < 4 * found["k3"].standard_error
