"""Periodic multisines: motions are chosen, the force they need follows exactly, the law is to be found."""

import dataclasses
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import rsgen
from rsgen.common.arrays import Array
from rsgen.common.errors import MeasurementError, RsgenError
from rsgen.data.history import TimeHistory, from_multisine
from rsgen.data.multisine.linear import misread_lines
from tests.surfaces import codes, errors
from tests.virtual import multisine

OMEGA0 = 2 * np.pi * 0.5
LINES = 256
MASS = 1.5
TRUE = {"c": 4.0, "k": 5000.0, "k2": 6e4, "k3": 4e6}
LAW = "k*x + k2*x**2 + k3*x**3 + c*v"


@cache
def spectra(force_of, sizes, *, noise=0.0, periods=1, seed=0, lines=LINES) -> rsgen.MultisineSpectra:
    """Motions of three levels with lines to 20 Hz; the force is m a + n(x, v) at every line, to round-off."""
    generator = np.random.default_rng(seed)
    moved = np.arange(2, 40)
    motion = np.zeros((len(sizes), lines + 1), dtype=complex)
    phase = np.exp(2j * np.pi * generator.random((len(sizes), len(moved))))
    omega = moved * OMEGA0
    shape = 1 / (TRUE["k"] - MASS * omega**2 + 1j * TRUE["c"] * omega)
    motion[:, moved] = np.array(sizes)[:, None] * phase * shape / np.abs(shape).max()
    samples = 8 * lines
    rate = 1j * np.arange(lines + 1) * OMEGA0
    wave = [np.fft.irfft(motion * rate**power * samples / 2, samples) for power in range(3)]
    force = np.fft.rfft(MASS * wave[2] + force_of(wave[0], wave[1]), axis=1)[:, : lines + 1] * 2 / samples
    force[:, 0] /= 2
    size = [np.sqrt(0.5 * np.sum(np.abs(one[:, 1:]) ** 2, axis=1)) for one in (force, motion)]
    force, motion = (np.repeat(one[:, None], periods, axis=1) for one in (force, motion))
    for one, rms in zip((force, motion), size, strict=True):
        drawn = generator.standard_normal((2, *one.shape))
        one += noise * rms[:, None, None] * (drawn[0] + 1j * drawn[1]) / np.sqrt(lines)
    return rsgen.MultisineSpectra(size[0], OMEGA0, force, motion)


def duffing(x: Array, v: Array) -> Array:
    return TRUE["c"] * v + TRUE["k"] * x + TRUE["k2"] * x**2 + TRUE["k3"] * x**3


def linear(x: Array, v: Array) -> Array:
    return TRUE["k"] * x + TRUE["c"] * v


SIZES = (1e-3, 4e-3, 1e-2)
NOISY = {"noise": 1e-3, "periods": 8}


@pytest.mark.parametrize("mass", [None, MASS])
def test_a_smooth_law_comes_back_to_round_off_and_a_given_mass_stays(mass):
    found = rsgen.identify(spectra(duffing, SIZES), LAW, mass=mass)
    assert max(errors(found, {**TRUE, "m": MASS}).values()) < 1e-9
    assert mass is None or found["m"].value == mass


def test_a_mass_with_an_error_is_one_more_equation_of_the_lines():
    test = spectra(duffing, SIZES, **NOISY)
    told, exact = (rsgen.identify(test, LAW, mass=mass) for mass in (None, 1.001 * MASS))
    loose, tight, half, off = (
        rsgen.identify(test, LAW, mass=mass * MASS, mass_error=error * told["m"].standard_error)
        for mass, error in ((1.0, 1e3), (1.001, 1e-4), (1.0, 1.0), (1.1, 1.0))
    )
    for asked, known in ((loose, told), (tight, exact)):
        for one in known:
            assert asked[one.name].value == pytest.approx(one.value, rel=1e-5)
            assert asked[one.name].standard_error == pytest.approx(one.standard_error, rel=0.02)
    assert half["m"].value == pytest.approx((told["m"].value + MASS) / 2, abs=0.2 * told["m"].standard_error)
    assert half["m"].standard_error < 0.8 * told["m"].standard_error
    assert "fixed-contradicted" not in codes(half)
    assert loose.outcome.names["moves"].endswith(
        "moves c by −1 %, k by −1 %, k2 by −2 %, k3 by −3 %, m by −1 %"
    )
    said = dict(re.findall(r"(\w+) by (\S+) %", exact.outcome.names["moves"].rpartition("response")[2]))
    again = rsgen.identify(dataclasses.replace(test, response=1.001 * test.response), LAW, mass=1.001 * MASS)
    for one in exact:
        moved = 1e3 * (again[one.name].value / one.value - 1)
        assert float(said[one.name].replace("−", "-")) == pytest.approx(moved, abs=0.2)
    (said,) = (finding for finding in off.findings if finding.code == "fixed-contradicted")
    assert said["fitted"] == pytest.approx(MASS, rel=0.01)


def test_reversed_and_mixed_up_records_are_not_believed():
    good = spectra(duffing, SIZES, **NOISY)
    for force, response in ((good.force, -good.response), (good.force, np.conj(good.response))):
        found = rsgen.identify(rsgen.MultisineSpectra(good.level, OMEGA0, force, response), LAW)
        assert found.verdict.state == "rejected"
        assert codes(found) & {"structure-feeds-exciter", "mass-negative"}
    record = histories(6, np.zeros(0))
    copied = from_multisine(TimeHistory(record.rate, record.force, 2 * np.asarray(record.force)))
    assert [f.code for f in copied.findings if f.severity == "doubt"] == ["response-copies-force"]
    assert not [f for f in from_multisine(record).findings if f.severity == "doubt"]
    weak = TimeHistory(record.rate, record.force, record.response, level=1.0, label="one")
    strong = TimeHistory(record.rate, record.force, record.response, level=2.0, label="two")
    assert "levels-disagree" in codes(from_multisine([weak, strong]))


@pytest.mark.slow
def test_a_delay_between_the_channels_is_named_with_its_size():
    good = spectra(duffing, SIZES, **NOISY)
    late = good.response * np.exp(-1j * good.lines * OMEGA0 * 1e-3)
    found = rsgen.identify(rsgen.MultisineSpectra(good.level, OMEGA0, good.force, late), LAW)
    (said,) = [finding for finding in found.findings if finding.code == "channels-delayed"]
    assert said["delay"] == pytest.approx(1e-3, rel=0.02)
    assert not found.verdict.usable
    assert "channels-delayed" not in codes(rsgen.identify(good, LAW))


def test_held_out_levels_are_not_seen():
    whole = spectra(duffing, SIZES)
    wrong = whole.response * np.array([1, 3, 1])[:, None, None]
    level = float(whole.level[1])
    observed = rsgen.Observation(hold_out=(level,))
    found = rsgen.identify(rsgen.MultisineSpectra(whole.level, OMEGA0, whole.force, wrong), LAW, observed)
    assert found["k3"].value == pytest.approx(TRUE["k3"], rel=1e-9)
    with pytest.raises(RsgenError, match=r"no level .* it has"):
        rsgen.identify(whole, LAW, rsgen.Observation(hold_out=(level * 1.5,)))


def test_what_the_response_follows_of_the_force_is_no_noise():
    """A force that is another one in every period, and a linear structure that has settled to each."""
    made, generator = spectra(linear, SIZES[:1]), np.random.default_rng(6)
    drawn = generator.standard_normal((2, 1, 6, made.force.shape[2]))
    force = made.force * (1 + 0.02 * (drawn[0] + 1j * drawn[1]))
    omega = OMEGA0 * made.lines
    response = force / (TRUE["k"] - MASS * omega**2 + 1j * TRUE["c"] * omega)
    (found,) = rsgen.best_linear(rsgen.MultisineSpectra(made.level, OMEGA0, force, response))
    assert found.noise_share < 1e-6


def histories(periods: int, transient: Array, quantity: str = "displacement", period: int = 512):
    """A record at 256 Hz of a linear structure's periodic response, plus a transient (n,)."""
    made = spectra(linear, SIZES[:1], lines=period // 2)
    power = {"displacement": 0, "velocity": 1, "acceleration": 2}[quantity]
    rate = 1j * made.lines * OMEGA0
    force = np.fft.irfft(made.force[0, 0] * period / 2, period)
    response = np.fft.irfft(made.response[0, 0] * rate**power * period / 2, period)
    signal = np.tile(response, periods)
    signal[: len(transient)] += transient * np.abs(response).max()
    return TimeHistory(256.0, np.tile(force, periods), signal, quantity)


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_period_and_transient_are_found(quantity):
    decay = np.exp(-np.arange(1400) / 150.0)
    read = from_multisine(histories(12, decay, quantity))
    assert read.omega0 == pytest.approx(OMEGA0)
    found = rsgen.identify(read, "k*x + c*v")
    assert max(errors(found, {"k": TRUE["k"], "c": TRUE["c"]}).values()) < 1e-3
    assert read.left_out[0] >= 2
    given = from_multisine(histories(12, decay, quantity), period=512, transient=4)
    assert given.periods == 8


def test_the_mean_of_a_record_is_that_of_its_samples():
    record = histories(4, np.zeros(0))
    moved = TimeHistory(record.rate, record.force, np.asarray(record.response) + 3e-4)
    read = from_multisine(moved)
    assert read.mean_known
    assert read.mean_response[0, 0].real == pytest.approx(3e-4, rel=1e-9)


def test_random_and_unsteady_records_are_refused_with_what_to_record():
    generator = np.random.default_rng(5)
    noise = TimeHistory(256.0, generator.standard_normal(4096), generator.standard_normal(4096))
    with pytest.raises(MeasurementError, match=r"does not repeat.*random.*Record a periodic multisine"):
        from_multisine(noise)
    steady = histories(8, np.zeros(0))
    wandering = TimeHistory(256.0, steady.force, generator.standard_normal(len(steady)))
    with pytest.raises(MeasurementError, match=r"response does not repeat.*until it has settled"):
        from_multisine(wandering)
    with pytest.raises(MeasurementError, match="does not repeat every 500 samples"):
        from_multisine(steady, period=500)


@pytest.mark.thorough
def test_silverbox_as_published(measured_data):
    """Noel and Schoukens, Int. J. Control 2017: quadratic -0.256, cubic 3.98 with k = 1; 68.58 Hz, 4.68 %."""
    folder = measured_data("silverbox").parent
    case = rsgen.load_case(Path(__file__).parents[1] / "cases" / "silverbox.toml", folder)
    read = rsgen.read(case)
    assert read.omega0 / 2 / np.pi == pytest.approx(2441.40625 / 8192)
    low = rsgen.best_linear(read)[0]
    assert low.natural_frequency == pytest.approx(68.58, rel=3e-3)
    assert low.damping_ratio == pytest.approx(0.0468, rel=0.03)
    for observation in (case.observation, rsgen.Observation(calibrated=False)):
        found = rsgen.identify(read, case.model, observation)
        stiffness = found["k"].value
        assert found["k2"].value / stiffness == pytest.approx(-0.256, rel=0.02)
        assert found["k3"].value / stiffness == pytest.approx(3.98, rel=0.02)
    (middle,) = rsgen.predict(rsgen.identify(read, case.model)).records
    assert middle.error < 0.01


def test_a_given_mass_that_a_multisine_contradicts_is_named():
    law, values = "k*x + k3*x**3 + c*v", {"k": 6000.0, "k3": 4e6, "c": 4.0}
    spectra = multisine(law, values, (3.0, 8.0), periods=8, noise_relative=0.01)
    # less than a hundredth counts where the right mass leaves nothing but noise; a thousand is a unit
    for off in (1.03, 0.993, 1e3):
        found = rsgen.identify(spectra, law, mass=off * MASS)
        (said,) = (finding for finding in found.verdict.decided_by if finding.code == "fixed-contradicted")
        assert said["fitted"] == pytest.approx(MASS, rel=0.005)
    assert said.names["near"] == "milli"
    assert rsgen.identify(spectra, law, mass=MASS).verdict.state == "identified"


def test_exchanged_channels_of_a_multisine_are_named():
    law, values = "k*x + k3*x**3 + c*v", {"k": 5000.0, "k3": 4e6, "c": 15.0}
    right = multisine(law, values, (3.0, 5.0, 8.0), period=1.0, periods=4, noise_relative=0.01)
    assert not misread_lines(right)
    found = rsgen.identify(dataclasses.replace(right, force=right.response, response=right.force), law)
    assert [one.names["is"] for one in found.findings if one.code == "another-quantity"] == ["exchanged"]
