"""Points at phase resonance determine no mass: what does, and what is refused without one."""

from functools import cache

import numpy as np
import pytest

import rsgen
from rsgen.files.files_to_surface import read_measurement
from rsgen.files.plan import MeasuredTest
from rsgen.files.signals import Channel
from tests.surfaces import codes, distances, errors, noisy
from tests.virtual import only

MASS, VALUES = 1.5, {"k": 5920.0, "k3": 3e5, "c": 3.8}
LAW = "k*x + k3*x**3 + c*v"


@cache
def locked(law: str = LAW, lag: float = 90.0, noise: float = 0.01, seed: int = 1, **values: float):
    """24 levels held near a quarter period; a lag in degrees."""
    test = rsgen.SimulatedTest(
        level=np.linspace(1, 12, 24), frequency=[6, 18], control="phase",
        phase_error=float(np.radians(lag - 90)), noise_relative=noise, seed=seed,
        accuracy=1e-4 if "masing" in law else 1e-6,
    )  # fmt: skip
    return rsgen.simulate(rsgen.Oscillator(MASS, law, values or VALUES), test)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_points_at_resonance_alone_are_refused_without_a_mass(noise):
    surface = locked(lag=92.0, noise=noise)
    for use in (rsgen.identify, lambda table, law: rsgen.rank(table, [law, "k*x + c*v"])):
        with pytest.raises(rsgen.RsgenError, match="give it, or points off phase resonance"):
            use(surface, LAW)


@pytest.mark.parametrize("background", ["constant", "residuals", "neighbour", "constant+offset"])
def test_a_background_is_not_determined_at_resonance_alone(background):
    observation = rsgen.Observation(background=background)
    with pytest.raises(rsgen.RsgenError, match="all points lie at phase resonance"):
        rsgen.identify(locked(), LAW, observation, mass=MASS)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_an_error_of_the_mass_is_that_of_the_stiffness_at_resonance_alone(noise):
    given = {"mass": 1.01 * MASS, "mass_error": 0.01 * MASS}
    found = rsgen.identify(locked(noise=noise), LAW, **given)
    table = rsgen.modal_table(locked(noise=noise), **given)
    assert max(map(abs, distances(found, {**VALUES, "m": MASS}))) < 3
    assert found["m"].standard_error == pytest.approx(0.01 * MASS, rel=1e-3)
    assert found["k"].standard_error >= 0.0099 * VALUES["k"]
    assert found["c"].standard_error < 0.005 * VALUES["c"]
    assert (table.mass, table.mass_error) == pytest.approx((1.01 * MASS, 0.01 * MASS))
    ranking = rsgen.rank(locked(noise=noise), [LAW, "k*x + c*v"], **given)
    assert ranking.candidates[0].values["m"] == pytest.approx(1.01 * MASS, rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("lags", [(80, 90, 100), (70, 80, 90), (75, 85)])
def test_slices_a_few_degrees_apart_determine_the_mass_and_every_value(lags):
    """F/X = k - m omega^2 + i omega c differs between them: a mass that is assumed would not fit."""
    test = rsgen.SimulatedTest(
        level=np.linspace(1, 12, 8), frequency=[6, 18], control="phase", lags=tuple(np.radians(lags))
    )
    exact = rsgen.simulate(rsgen.Oscillator(MASS, LAW, VALUES), test)
    truth = {**VALUES, "m": MASS}
    found = rsgen.identify(exact, LAW)
    assert found.verdict.state == "identified"
    assert max(errors(found, truth).values()) < 1e-5
    read = noisy(exact, 0.003, 1)
    found, table = rsgen.identify(read, LAW), rsgen.modal_table(read)
    assert found.verdict.state == "identified"
    assert np.abs(distances(found, truth)).max() < 3
    assert found["m"].standard_error < 0.1 * MASS
    assert abs(table.mass - MASS) < 3 * table.mass_error < 0.4 * MASS
    assert table.misfit < 0.005


@pytest.mark.slow
def test_a_law_whose_damping_contains_its_stiffness_determines_the_mass():
    truth = {"k": 5920.0, "c": 2.0, "kt": 800.0, "Fs": 5.0}
    law = "k*x + c*v + masing(Min(kt*x, Fs))"
    found = rsgen.identify(locked(law, noise=0.003, **truth), law)
    assert np.abs(distances(found, {**truth, "m": MASS})).max() < 4
    assert only(found, "mass-at-resonance").names == {"by": "loops"}


@pytest.mark.slow
@pytest.mark.parametrize("lag", [88.0, 92.0])
def test_a_lag_that_was_not_recorded_is_in_every_interval(tmp_path, lag):
    surface = locked(lag=lag, noise=1e-4)
    path = tmp_path / "loop.csv"
    table = np.stack([surface.frequency, np.abs(surface.force), surface.amplitude], axis=1)
    np.savetxt(path, table, delimiter=",", header="f,force,response", comments="")
    signals = Channel(amplitude="force"), Channel(amplitude="response")
    plan = MeasuredTest(path, "f", *signals, "displacement", phase_known=False, control="phase")
    read = read_measurement(plan)
    assert only(read, "phase-lag").names == {"by": "assumed"}
    found = rsgen.identify(read, LAW, mass=MASS)
    low, high = found["k"].interval
    assert low < VALUES["k"] < high
    assert abs(found["k"].value - VALUES["k"]) > 0.2 * (high - low) / 4
    for mass in (MASS, None):
        modal = rsgen.modal_table(read, mass=mass)
        exact = rsgen.modal_table(locked(noise=0.0), mass=MASS).at(modal.amplitude).stiffness_per_mass
        assert np.all(modal.stiffness_per_mass_lower < exact)
        assert np.all(exact < modal.stiffness_per_mass_upper)


@pytest.mark.parametrize(("name", "state"), [("k", "identified"), ("c", "doubtful")])
def test_a_fixed_stiffness_determines_the_mass(name, state):
    found = rsgen.identify(locked(), LAW, fixed={name: VALUES[name]})
    assert found.verdict.state == state
    assert ("mass-at-resonance" in codes(found)) == (state == "doubtful")
    if state == "identified":
        assert found.mass == pytest.approx(MASS, rel=5e-3)
        assert abs(found["k3"].value - VALUES["k3"]) < 4 * found["k3"].standard_error
