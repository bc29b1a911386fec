"""Swept sines: the law found from the force, envelopes, the transient of the sweep."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsgen import Oscillator, load_case, make_element
from rsgen.data.history import SweepLaw, TimeHistory, from_swept_sine, swept_sine
from rsgen.data.history.envelope import NOISE_WIDTH, demodulate, place_windows
from rsgen.data.history.tracking import find_sweeps
from rsgen.data.surface.mode_findings import mode_findings
from rsgen.data.surface.response_surface import Outcome
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.files.files_to_surface import read_measurement
from tests.oracles.swept import driven, sweep
from tests.virtual import only

pytestmark = pytest.mark.slow

CASES = Path(__file__).parents[2] / "cases"

AS_STEPPED = 5e-3
"""The figure of the requirement: k(X), c(X) of a sweep against stepped sine."""

MASS, STIFFNESS, DAMPING = 1.5, 1.5 * (2 * np.pi * 10) ** 2, 2 * 0.01 * 1.5 * 2 * np.pi * 10
"""A linear oscillator at 10 Hz with a half width of 0.1 Hz."""


def linear(mass: float = MASS) -> Oscillator:
    return Oscillator(mass, (make_element("all", "k*x + c*v"),), {"k": STIFFNESS, "c": DAMPING})


def forced(law: SweepLaw, rate: float, duration: float, level: float = 1.0) -> TimeHistory:
    t = np.arange(int(duration * rate)) / rate
    return TimeHistory(rate, level * np.cos(law.phase_at(t)), np.sin(law.phase_at(t)))


@settings(max_examples=20)
@given(
    kind=st.sampled_from(["linear", "logarithmic"]), low=st.floats(2, 20), ratio=st.floats(1.5, 8),
    down=st.booleans(), phase=st.floats(0, 6),
)  # fmt: skip
def test_the_law_is_found_from_the_force(kind: str, low: float, ratio: float, down: bool, phase: float):
    duration = 400 / low
    first, last = (low * ratio, low) if down else (low, low * ratio)
    pace = (last - first if kind == "linear" else np.log2(last / first)) / duration
    law = SweepLaw(kind, first, float(pace), phase)
    (found,) = find_sweeps(forced(law, 12 * low * ratio, duration))
    assert found.law.kind == kind
    assert found.law.direction == ("down" if down else "up")
    assert found.law.frequency == pytest.approx(law.frequency, rel=1e-6)
    assert found.law.rate == pytest.approx(law.rate, rel=1e-6)


@pytest.mark.parametrize("rate", [0.01, 0.04])
def test_exchanged_channels_of_a_sweep_are_called_so(rate: float):
    right = []
    for level in (1.0, 2.0):
        record = sweep(linear(), level, SweepLaw("linear", 9.0, rate, 0.0), 11.0, rate=200.0)
        damper = DAMPING * np.gradient(record.response, 1 / 200)
        moved = (record.force - STIFFNESS * record.response - damper) / MASS
        right.append(replace(record, response=moved, quantity="acceleration"))
    read = [replace(one, force=one.response, response=one.force) for one in right]
    (said,) = mode_findings(from_swept_sine(read, mass=MASS), MASS)
    assert said.names["is"] == "exchanged"
    assert not mode_findings(from_swept_sine(right, mass=MASS), MASS)
    # what is late, or has the other sign, is not exchanged
    for wrong in (np.negative, lambda samples: np.roll(samples, 1)):
        faulty = [replace(one, response=wrong(one.response)) for one in right]
        assert not mode_findings(from_swept_sine(faulty), None)


def test_phase_frequency_and_slope_of_a_law_are_derivatives() -> None:
    t = np.linspace(0, 30, 4001)
    for law in (SweepLaw("linear", 15, -0.4), SweepLaw("logarithmic", 3, 0.1, 1.0)):
        f = np.gradient(law.phase_at(t), t, edge_order=2) / (2 * np.pi)
        np.testing.assert_allclose(f[1:-1], law.frequency_at(t)[1:-1], rtol=1e-5)
        np.testing.assert_allclose(np.gradient(f[1:-1], t[1:-1])[2:-2], law.slope_at(t)[3:-3], rtol=1e-3)
        assert law.time_of(float(law.frequency_at(np.array(7.0)))) == pytest.approx(7.0)
    assert SweepLaw("logarithmic", 3, 0.1).time_of(0.0) == -np.inf


def test_an_envelope_is_exact_for_a_cubic_and_its_noise_as_the_bandwidth_says() -> None:
    rate, f = 1000.0, 20.0
    i = np.arange(4000.0)
    shape = np.polynomial.Polynomial([1, 2e-4 + 1e-4j, -1e-7j, 3e-11])
    signal = (shape(i) * np.exp(2j * np.pi * f * i / rate)).real
    window = place_windows(np.array([2000.0]), np.array([500.0]), np.array([rate / f]), 1, len(i))

    def phase(t: np.ndarray) -> np.ndarray:
        return 2 * np.pi * f * t

    place = window.middle[0]
    value, first, second, _ = demodulate(signal, rate, phase, window, (1,))[0, 0]
    # the mirror image at -f leaks by 1e-5
    assert value == pytest.approx(shape(place), rel=1e-5)
    assert first == pytest.approx(shape.deriv()(place) * rate, rel=1e-3)
    assert second == pytest.approx(shape.deriv(2)(place) * rate**2, rel=1e-2)
    # white noise of variance 1 spreads over rate/2: |Y|^2 = 2 * 2 B/rate
    many = place_windows(np.arange(300, 400_000, 600.0), np.array([500.0]), np.array([rate / f]), 1, 400_000)
    noise = np.random.default_rng(1).normal(size=400_000)
    taken = demodulate(noise, rate, phase, many, (1,))[:, 0, 0]
    width = NOISE_WIDTH / (many.step[0] * many.count[0] / rate)
    assert np.mean(np.abs(taken) ** 2) == pytest.approx(4 * width / rate, rel=0.12)


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_a_fast_sweep_of_a_linear_oscillator_is_corrected(quantity: str, monkeypatch) -> None:
    # the receptance of a linear oscillator is known; at rate/(half width)^2 = 5 it is shifted by a half width
    law, rate, n = SweepLaw("linear", 8.0, 0.05), 400.0, 36000
    x = np.asarray(sweep(linear(), 1.0, law, 12.5, rate).response)[:n]
    force = np.cos(law.phase_at(np.arange(n) / rate))

    # by differences of high order, not by the rule that is tested
    weights, response = np.array([-1 / 280, 4 / 105, -1 / 5, 4 / 5, 0, -4 / 5, 1 / 5, -4 / 105, 1 / 280]), x
    for _ in range(("displacement", "velocity", "acceleration").index(quantity)):
        response = np.convolve(response, weights, "same") * rate
    history = TimeHistory(rate, force, response, quantity)
    surface = from_swept_sine(history, band=(8.5, 12))
    chosen = surface.select(surface.settled)
    assert len(chosen) > 0.9 * len(surface)
    dynamic = chosen.force / chosen.harmonics[:, 1]
    k, c = dynamic.real + MASS * chosen.omega**2, dynamic.imag / chosen.omega
    near = np.abs(dynamic.real) < 5 * np.abs(dynamic.imag)
    assert np.max(np.abs(k / STIFFNESS - 1)) < 5e-4
    assert np.max(np.abs(c[near] / DAMPING - 1)) < AS_STEPPED
    fast = only(surface, "sweep-rate")
    # rate/(half width)^2 of the true oscillator
    assert fast["pace"] == pytest.approx(0.05 / 0.1**2, rel=0.02)
    assert fast["shift"] == pytest.approx(5 / (2 * np.pi), rel=0.02)
    assert fast["mass"] == pytest.approx(MASS, rel=1e-3)
    # and without correction it is as wrong as the literature says
    monkeypatch.setattr(swept_sine, "MASS_IN_OTHER_UNIT", np.inf)
    raw = from_swept_sine(history, band=(8.5, 12), mass=1e-12)
    dynamic = raw.force / raw.harmonics[:, 1]
    apparent = (dynamic.imag / raw.omega)[np.abs(raw.frequency - 10) < 0.1]
    assert np.max(np.abs(apparent / DAMPING - 1)) > 0.2


@pytest.mark.parametrize("name", ["cubic", "coulomb", pytest.param("joint", marks=pytest.mark.thorough)])
def test_a_sweep_through_a_case_gives_what_stepped_sine_gives(name: str) -> None:
    o = load_case(CASES / f"{name}.toml").oscillator
    first, last, pace, levels = (36, 62, 0.2, (2, 10)) if name == "joint" else (8, 12, 0.02, (2, 12))
    histories = [sweep(o, level, SweepLaw("linear", first, pace), last) for level in levels]
    surface = from_swept_sine(histories, points=150)
    assert surface.levels.tolist() == list(levels)
    assert set(surface.sweep) == {"up"}
    # stepped sine at the same force, frequency and branch
    swept = surface.select(surface.settled)
    swept = swept.select(swept.frequency > 0)
    harmonics = np.nan_to_num(swept.harmonics)
    order = np.arange(harmonics.shape[1])
    start = np.stack(
        [harmonics.real.sum(1), (1j * order * swept.omega[:, None] * harmonics).real.sum(1)], axis=1
    )
    states = solve_steady_states(o, swept.force, swept.frequency, harmonics=5, accuracy=1e-6, start=start)
    stepped = swept.force / states.harmonics[:, 1]
    found = swept.force / swept.harmonics[:, 1]
    same = (states.outcome == 0) & (np.abs(stepped / found - 1) < 0.03)
    assert np.mean(same) > 0.99
    near = np.abs(stepped.real) < 5 * np.abs(stepped.imag)
    inertia = o.mass * swept.omega**2
    k = (found.real + inertia) / (stepped.real + inertia) - 1
    assert np.abs(k[same]).max() < AS_STEPPED
    assert np.abs(found.imag / stepped.imag - 1)[same & near].max() < AS_STEPPED


def spoilt(clean: TimeHistory, noise: float, random: np.random.Generator) -> TimeHistory:
    draws = random.normal(size=(2, len(clean)))
    parts = zip((clean.force, clean.response), draws, strict=True)
    return TimeHistory(clean.rate, *(part + noise * np.std(part) * draw for part, draw in parts))


@cache
def jumping(cubic: float, level: float, law: SweepLaw, stop: float) -> TimeHistory:
    """Sweep an oscillator at 10 Hz, half width 0.05 Hz, through a resonance that jumps."""
    values = {"k": STIFFNESS, "k3": cubic, "c": DAMPING / 2}
    return sweep(Oscillator(MASS, "k*x + k3*x**3 + c*v", values), level, law, stop, 200.0)


@pytest.mark.parametrize("cubic", [8e6, -8e6])
@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_frequency_of_a_point_is_that_of_the_force(cubic: float, down: bool, noise: float) -> None:
    """After a jump the response rings at its own frequency; points that say so would go back, by 0.5 Hz."""
    law = SweepLaw("linear", 11.5 if down else 9.0, -0.04 if down else 0.04)
    clean = jumping(cubic, 2.0, law, 9.0 if down else 11.5)
    surface = from_swept_sine(spoilt(clean, noise, np.random.default_rng(1)))
    steps = np.diff(surface.frequency) * (-1 if down else 1)
    assert (steps > 0).all()
    # evenly in time under a law that is known
    np.testing.assert_allclose(steps, np.median(steps), rtol=0.25)
    used = surface.select(surface.settled)
    assert len(used) > 0.9 * len(surface)
    fast = only(surface, "sweep-rate")
    assert abs(fast["resonance"] - used.frequency[np.argmax(used.amplitude)]) < fast["half_width"]
    dynamic = used.force / used.harmonics[:, 1]
    k = dynamic.real + MASS * used.omega**2
    law_k = STIFFNESS + 0.75 * cubic * used.amplitude**2
    # 1 % of k is a half width
    assert np.max(np.abs(k / law_k - 1)) < 0.02
    assert np.median(np.abs(k / law_k - 1)) < 2e-3
    near = np.abs(dynamic.real) < 5 * np.abs(dynamic.imag)
    error = np.abs(dynamic.imag / used.omega / (DAMPING / 2) - 1)[near]
    assert error.max() < (0.06 if noise == 0 else 0.4)
    assert np.median(error) < 0.05


@pytest.mark.parametrize(("pace", "wrong", "severity"), [
    (0.2, 0, "warning"), (0.2, 0.2, "doubt"), (2, 0, "doubt"),
])  # fmt: skip
def test_a_correction_that_is_in_doubt_doubts_the_result(pace, wrong, severity, monkeypatch) -> None:
    found = swept_sine.flank_mass
    off = lambda *args: (flank := found(*args)) and replace(flank, mass=flank.mass * (1 + wrong))  # noqa: E731
    monkeypatch.setattr(swept_sine, "flank_mass", off)
    history = sweep(linear(), 1.0, SweepLaw("linear", 7.0, pace), 13.0)
    fast = only(from_swept_sine(history), "sweep-rate")
    assert fast.severity == severity
    # a sweep that is too fast to find a mass is not corrected; its resonance looks wider than it is
    assert ("correction" in fast.numbers) == (pace < 1)
    assert fast["pace"] == pytest.approx(pace / 0.1**2, rel=0.05) if pace < 1 else 1 < fast["pace"] < 200


def test_a_correction_as_large_as_the_force_is_no_calm_note() -> None:
    history = jumping(-2e6, 2.0, SweepLaw("linear", 9.0, 0.04), 11.5)
    fast = only(from_swept_sine(history, mass=0.63 * MASS), "sweep-rate")
    assert fast["correction"] > 1
    assert (fast.severity, fast.names["doubt"]) == ("warning", "size")


@pytest.mark.usefixtures("read_here")
def test_the_correction_takes_the_mass_of_the_sweeps_where_the_given_one_has_another_unit() -> None:
    test = load_case("cases/formats/mat-sweep.toml").test
    right, wrong = (read_measurement(replace(test, history=replace(test.history, mass=m))) for m in (1.5, 45))
    assert np.array_equal(wrong.outcome, right.outcome)
    np.testing.assert_allclose(wrong.force, right.force, rtol=1e-3)
    assert not {"doubt", "warning"} & {finding.severity for finding in wrong.findings}


def test_points_with_a_force_in_its_noise_are_not_settled() -> None:
    law, rate, n = SweepLaw("linear", 8.0, 0.05), 200.0, 16000
    t = np.arange(n) / rate
    # the force falls to 2 % where the structure moves most, and has 5 % of noise
    fall = 1 - 0.98 * np.exp(-(((law.frequency_at(t) - 10) / 0.2) ** 2))
    force = fall * np.cos(law.phase_at(t))
    x = driven(linear(), force, rate)
    force = force + 0.05 * np.random.default_rng(3).normal(size=n)
    surface = from_swept_sine(TimeHistory(rate, force, x), mass=MASS)
    assert (np.diff(surface.frequency) > 0).all()
    (finding,) = (found for found in surface.findings if found.names.get("by") == "noise of the force")
    assert 9.7 < finding["low"] < 10 < finding["high"] < 10.3
    low, high = finding["low"], finding["high"]
    inside = (surface.frequency >= low) & (surface.frequency <= high)
    assert (surface.outcome[inside] == Outcome.FORCE_IN_NOISE).all()
    assert np.mean(surface.settled[np.abs(surface.frequency - 10) > 0.5]) > 0.95


def test_a_point_that_is_not_used_says_why() -> None:
    clean = jumping(8e6, 2.0, SweepLaw("linear", 9.0, 0.04), 11.5)
    silent = np.abs(np.arange(len(clean)) / clean.rate - 10) < 1
    surface = from_swept_sine(TimeHistory(clean.rate, clean.force, np.where(silent, 0, clean.response)))
    for outcome, reason in ((Outcome.DROPPED_OUT, "drop-out"), (Outcome.FREE_MOTION, "free motion")):
        (finding,) = (found for found in surface.findings if found.names.get("by") == reason)
        assert finding["excluded"] == np.count_nonzero(surface.outcome == outcome) > 0
    assert surface.frequency[surface.outcome == Outcome.DROPPED_OUT] == pytest.approx(9.4, abs=0.05)


def test_harmonics_above_the_sampling_rate_are_unknown() -> None:
    surface = from_swept_sine(forced(SweepLaw("linear", 8.0, 0.05), 60.0, 80), harmonics=5)
    assert np.isfinite(surface.harmonics[:, :3]).all()
    assert np.isnan(surface.harmonics[:, 3:]).all()
