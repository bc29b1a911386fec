"""Records of a multisine that are not what the case says of them: levels, transients, units."""

import numpy as np
import pytest

import rsgen
from rsgen.data.history import TimeHistory, from_multisine
from tests.surfaces import severities

RATE, PERIOD = 256.0, 512
K, C, MASS = 5000.0, 4.0, 1.5


def records(periods, *, factor=1.0, rest=False, levels=(2.0, 4.0), seed=4) -> list[TimeHistory]:
    """Steady or from rest: a linear structure under random phases; ``factor`` on the recorded force."""
    lines = np.arange(PERIOD // 2 + 1)
    omega = 2 * np.pi * RATE / PERIOD * lines
    receptance = 1 / (K - MASS * omega**2 + 1j * C * omega)
    generator = np.random.default_rng(seed)
    made = []
    for level in levels:
        force = np.zeros(len(lines), dtype=complex)
        force[5:40] = level * np.sqrt(2 / 35) * np.exp(2j * np.pi * generator.random(35))
        waves = [
            np.tile(np.fft.irfft(one * PERIOD / 2, PERIOD), periods) for one in (force, force * receptance)
        ]
        if rest:
            # the free vibration that takes displacement and velocity to zero at the beginning
            rate = 1j * np.sqrt(K / MASS - (C / 2 / MASS) ** 2) - C / 2 / MASS
            x, v = (float((force * receptance * (1j * omega) ** power).sum().real) for power in range(2))
            free = (v - np.conj(rate) * x) / (2j * rate.imag)
            waves[1] = waves[1] - 2 * np.real(free * np.exp(rate * np.arange(len(waves[1])) / RATE))
        noise = [1e-3 * one.std() * generator.standard_normal(len(one)) for one in waves]
        signals = [one + own for one, own in zip(waves, noise, strict=True)]
        made.append(TimeHistory(RATE, factor * signals[0], signals[1], level=level, label=f"{level:g} N"))
    return made


@pytest.mark.parametrize("factor", [1e-3, 1000.0, 0.3])
def test_a_force_in_another_unit_than_its_levels_is_doubted(factor):
    assert "levels-in-other-unit" not in severities(from_multisine(records(4)))
    wrong = from_multisine(records(4, factor=factor))
    assert severities(wrong)["levels-in-other-unit"] == "doubt"
    assert not rsgen.identify(wrong, "k*x + c*v").verdict.usable
    unnamed = [TimeHistory(RATE, one.force, one.response) for one in records(4, factor=factor)]
    assert "levels-in-other-unit" not in severities(from_multisine(unnamed))


def test_a_record_in_place_of_that_of_another_level_is_doubted():
    low, high = records(4)
    copy = TimeHistory(RATE, low.force, low.response, level=high.level, label="copy")
    found = rsgen.identify(from_multisine([low, copy]), "k*x + c*v")
    assert severities(found)["run-repeated"] == "doubt"
    assert "run-repeated" not in severities(rsgen.identify(from_multisine([low, high]), "k*x + c*v"))


def test_two_periods_from_rest_are_doubted_and_three_leave_the_first_out():
    def short(spectra: rsgen.MultisineSpectra) -> list[str]:
        found = (one for one in spectra.findings if one.code == "multisine-periods")
        return [one.severity for one in found if "record" in one.names]

    assert short(from_multisine(records(2)))[0] == "info"
    rest = from_multisine(records(2, rest=True))
    assert short(rest)[0] == "doubt"
    longer = from_multisine(records(8, rest=True))
    assert (np.asarray(longer.left_out) >= 1).all()
    assert short(longer) == []
    begins = from_multisine(records(8, rest=True), transient=0)
    said = [one for one in begins.findings if "given" in one.numbers]
    assert [one.severity for one in said] == ["doubt"] * len(records(8))
    assert not any("given" in one.numbers for one in from_multisine(records(8), transient=0).findings)


def changed(one: TimeHistory, channel: str, gain: np.ndarray) -> TimeHistory:
    """A record whose force or response was read with another gain (n,) from some instant on."""
    force, response = np.asarray(one.reference), np.asarray(one.response)
    both = (force * gain, response) if channel == "reference" else (force, response * gain)
    return TimeHistory(one.rate, *both, level=one.level, label=one.label)


@pytest.mark.parametrize("channel", ["reference", "response"])
@pytest.mark.parametrize("course", ["step", "ramp"])
def test_a_gain_that_changes_within_a_record_is_doubted(channel, course):
    count = 12 * PERIOD
    gain = np.linspace(1, 1.2, count) if course == "ramp" else 1 + 0.2 * (np.arange(count) >= count // 2)
    spectra = from_multisine([changed(one, channel, gain) for one in records(12)])
    found = rsgen.identify(spectra, "k*x + c*v")
    (told,) = [finding for finding in found.findings if finding.code == "parts-disagree"]
    assert told.severity == "doubt"
    if course == "step":
        # a step does not decay: it is no transient, and the periods before it stay
        assert not np.any(spectra.left_out)
        assert told["size"] == pytest.approx(0.2 / 1.1, rel=0.02)
    assert not found.verdict.usable


@pytest.mark.slow
@pytest.mark.parametrize("rest", [False, True])
@pytest.mark.parametrize("seeds", [range(6), pytest.param(range(6, 20), marks=pytest.mark.thorough)])
def test_records_with_one_gain_are_not_doubted(rest, seeds):
    for seed in seeds:
        histories = records(2 + seed % 8 + 2 * rest, rest=rest, levels=(1.0 + seed,), seed=seed)
        found = rsgen.identify(from_multisine(histories), "k*x + c*v")
        assert found.verdict.state == "identified", seed
        assert "parts-disagree" not in severities(found)
