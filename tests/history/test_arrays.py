"""From arrays to a surface in two lines, through the public ``rsgen.data.history`` alone."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

import rsgen as rs
from rsgen.data.record_set import QUANTITIES

MASS, DAMPING, STIFFNESS = 1.5, 1.9, 1.5 * (2 * np.pi * 10) ** 2
RATE = 500.0
TIME = np.arange(0, 200, 1 / RATE)

SAMPLED = 5e-3
"""Straight lines between 50 samples a period, by which the response is simulated."""


def response_to(force: np.ndarray, quantity: str = "displacement") -> np.ndarray:
    """Exact motion of a linear oscillator from rest under a force that is straight between samples."""
    order = {"displacement": [1.0], "velocity": [1.0, 0.0], "acceleration": [1.0, 0.0, 0.0]}[quantity]
    above, below, _ = cont2discrete((order, [MASS, DAMPING, STIFFNESS]), 1 / RATE, "foh")
    return lfilter(above.ravel(), below, force)


def assert_is_the_oscillator(surface: rs.ResponseSurface) -> None:
    used = surface.select(surface.settled)
    dynamic = used.force / used.harmonics[:, 1]
    near = np.abs(dynamic.real) < np.abs(dynamic.imag)
    assert np.count_nonzero(near) > 3
    np.testing.assert_allclose((dynamic.real + MASS * used.omega**2)[near], STIFFNESS, rtol=SAMPLED)
    np.testing.assert_allclose((dynamic.imag / used.omega)[near], DAMPING, rtol=SAMPLED)


def test_a_swept_sine() -> None:
    force = 2 * np.cos(2 * np.pi * (8 + 0.01 * TIME) * TIME)
    surface = rs.history.from_swept_sine(rs.history.TimeHistory(RATE, force, response_to(force)))
    assert_is_the_oscillator(surface)
    assert surface.levels.tolist() == [2.0]
    assert set(surface.sweep) == {"up"}
    found = {e.name: e.value for e in rs.identify(surface, "k*x + c*v").refined}
    assert found == pytest.approx({"k": STIFFNESS, "c": DAMPING, "m": MASS}, rel=SAMPLED)


def test_the_package_shows_what_is_meant_and_no_more() -> None:
    assert dir(rs.history) == sorted(rs.history.__all__)
    assert "history" in dir(rs)
    for name in rs.history.__all__:
        assert getattr(rs.history, name).__doc__


SINE = np.cos(20 * np.pi * TIME)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda h: h.TimeHistory.from_times(TIME**2, SINE, SINE), "sample 2 is .* off the even spacing"),
        (lambda h: h.TimeHistory.from_times(TIME[:-1], SINE, SINE), "instants, 100000 samples"),
        (lambda h: h.TimeHistory.from_times(-TIME, SINE, SINE), "does not rise"),
        (lambda h: h.TimeHistory("fast", SINE, SINE), "a number of Hz is needed"),
        (lambda h: h.TimeHistory(RATE, SINE, np.where(TIME == 1, np.nan, SINE)), "sample 501 is not finite"),
        (lambda h: h.TimeHistory(RATE, SINE, 1e40 * SINE), "not finite, or above 1e"),
        (lambda h: h.TimeHistory(RATE, SINE, SINE[1:]), "100000 samples of force, 99999 of response"),
        (lambda h: h.TimeHistory(RATE, SINE[:9], SINE[:9]), "9 samples; at least 16"),
        (lambda h: h.from_swept_sine([]), "swept sine: one TimeHistory or more"),
        (lambda h: h.from_swept_sine(h.TimeHistory(RATE, SINE, SINE)), "no sweep found in the force"),
        (lambda h: h.from_swept_sine(h.TimeHistory(RATE, SINE, SINE), mass=-1.0), "mass: -1.0 kg"),
        (lambda h: h.from_stepped_sine(h.TimeHistory(RATE, SINE, SINE), band=(9, 2)), "lowest, highest"),
        (
            lambda h: h.from_stepped_sine(h.TimeHistory(RATE, SINE, SINE), band=(2, 9)),
            "no step .* in the band",
        ),
        (lambda h: h.from_stepped_sine(h.TimeHistory(RATE, SINE, SINE), harmonics=0), "must be 1 or more"),
        (lambda h: h.from_free_decay(h.TimeHistory(RATE, None, SINE)), "give the mass"),
        (lambda h: h.from_free_decay(h.TimeHistory(RATE, SINE, SINE), mass=1.0), "force does not end"),
        (lambda h: h.from_free_decay(h.TimeHistory(RATE, None, SINE[:100]), mass=1.0), "too short|stand out"),
    ],
)
def test_faults_are_sentences(make: object, message: str) -> None:
    with pytest.raises(rs.RsgenError, match=message):
        make(rs.history)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_no_record_ends_in_a_traceback_or_a_warning(seed: int) -> None:
    """Constant, tiny, huge, offset, single-precision and short records give a surface or a sentence."""
    random = np.random.default_rng(seed)
    uses = [rs.history.from_swept_sine, rs.history.from_stepped_sine, rs.history.record_findings]
    uses.append(lambda history: rs.history.from_free_decay(history, mass=1.0))
    for _ in range(40):
        n = int(10 ** random.uniform(1.2, 3.7))
        i, f = np.arange(n), random.uniform(1e-3, 0.5)
        sine = np.cos(2 * np.pi * f * i)
        records = [
            np.zeros(n), np.ones(n), sine, random.normal(size=n), random.integers(-3, 3, n),
            np.cos(np.pi * f * (1 + random.uniform(-1, 1) * i / n) * i), np.where(i < n // 2, sine, 0.0),
            np.sign(sine), np.exp(-20 * i / n) * sine + 1e-3 * random.normal(size=n), np.round(100 * sine),
            np.exp(-5 * i / n) * sine, np.where(i == n // 3, 1.0, 0.0),
        ]  # fmt: skip
        pair = []
        for k in random.integers(0, len(records), 2):
            scale = random.choice([1.0, 1e-12, 1e-30, 1e-300, 1e12, 1e25])
            record = scale * (records[k] + random.choice([0.0, 1.0, 1e4]))
            pair.append(record.astype(np.float32) if 1e-12 <= scale <= 1e12 and seed % 2 else record)
        history = rs.history.TimeHistory(10 ** random.uniform(0, 4), *pair, random.choice(list(QUANTITIES)))
        for use in uses:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                try:
                    outcome = str(type(use(history)))
                except rs.RsgenError as fault:
                    outcome = str(fault)
            assert outcome.startswith(("time history: ", "<class "))
