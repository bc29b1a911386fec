"""Free decays: k(X), c(X) against describing functions, bands against scatter, forced against free."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rsgen.errors import MeasurementError
from rsgen.history import SweepLaw, TimeHistory, follow_decay, from_free_decay, from_swept_sine
from rsgen.law.element import make_element
from rsgen.oscillator import Oscillator
from tests.oracles.swept import sweep

MASS, STIFFNESS = 1.5, 1.5 * (2 * np.pi * 10) ** 2
RATE = 500.0
LAWS = {
    # force added to the linear spring; describing functions of stiffness and damping (docs/method.md, 3)
    "linear": (lambda x, v: 1.9 * v, lambda X, w: 0 * X, lambda X, w: 1.9 + 0 * X),
    "cubic": (lambda x, v: -2e6 * x**3 + 1.9 * v, lambda X, w: -1.5e6 * X**2, lambda X, w: 1.9 + 0 * X),
    "drag": (
        lambda x, v: 0.9 * v + 2 * v * abs(v),
        lambda X, w: 0 * X,
        lambda X, w: 0.9 + 2 * 8 / (3 * np.pi) * w * X,
    ),
}

ONE_HARMONIC = 2e-3
"""What a describing function leaves out at these amplitudes; c(X) of the cubic law is off by most."""


def decay(name: str, quantity: str = "displacement", duration: float = 15) -> np.ndarray:
    n = LAWS[name][0]

    def motion(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -(STIFFNESS * y[0] + n(y[0], y[1])) / MASS]

    t = np.arange(0, duration, 1 / RATE)
    x, v = solve_ivp(motion, (0, duration), [0.012, 0], t_eval=t, rtol=1e-9, atol=1e-12).y
    return {"displacement": x, "velocity": v, "acceleration": -(STIFFNESS * x + n(x, v)) / MASS}[quantity]


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("quantity", ["displacement", "acceleration"])
def test_a_free_decay_gives_the_describing_functions(name: str, quantity: str) -> None:
    found = follow_decay(TimeHistory(RATE, None, decay(name, quantity), quantity), mass=MASS)
    omega = 2 * np.pi * found.frequency
    k = STIFFNESS + LAWS[name][1](found.amplitude, omega)
    c = LAWS[name][2](found.amplitude, omega)
    large = found.amplitude > 1e-5
    assert np.count_nonzero(large) > 30
    assert np.max(np.abs(found.stiffness / k - 1)[large]) < 1e-4
    assert np.max(np.abs(found.damping / c - 1)[large]) < ONE_HARMONIC
    np.testing.assert_allclose(found.damping_ratio, found.damping / (2 * MASS * omega), rtol=1e-12)


def test_bands_are_as_wide_as_the_noise_makes_them() -> None:
    clean = decay("linear", duration=8)
    pulls = []
    for seed in range(6):
        noise = 1e-3 * 0.012 * np.random.default_rng(seed).normal(size=len(clean))
        found = follow_decay(TimeHistory(RATE, None, clean + noise), mass=MASS)
        pulls.append((found.damping - 1.9) / found.damping_error)
    # half of all normal errors are below 0.67 standard errors; seven neighbours say so only roughly
    assert 0.4 < np.median(np.abs(np.concatenate(pulls))) < 1.0


@pytest.mark.parametrize("zeta", [0.01, 0.02, 0.03])
def test_a_decay_of_a_few_percent_of_damping_is_followed(zeta: float) -> None:
    t = np.arange(0, 0.16 / zeta, 1 / RATE)
    natural = 2 * np.pi * 10
    x = np.exp(-zeta * natural * t) * np.cos(natural * np.sqrt(1 - zeta**2) * t)
    found = follow_decay(TimeHistory(RATE, None, x), mass=1.0)
    np.testing.assert_allclose(found.stiffness, natural**2, rtol=1e-4)
    np.testing.assert_allclose(found.damping, 2 * zeta * natural, rtol=1e-3)
    assert np.max(found.amplitude) > 3 * np.min(found.amplitude)


def test_without_mass_all_is_per_mass_and_no_force_is_made_up() -> None:
    history = TimeHistory(RATE, None, decay("linear"), label="tap.csv")
    found = follow_decay(history)
    np.testing.assert_allclose(found.stiffness, STIFFNESS / MASS, rtol=1e-4)
    with pytest.raises(MeasurementError, match=r"tap.csv: .* give the mass"):
        from_free_decay(history)


def test_a_decay_as_points_of_a_steady_test_has_the_same_curves() -> None:
    found = follow_decay(TimeHistory(RATE, None, decay("cubic")), mass=MASS)
    surface = from_free_decay(TimeHistory(RATE, None, decay("cubic")), mass=MASS)
    dynamic = surface.force / surface.harmonics[:, 1]
    np.testing.assert_allclose(dynamic.real + MASS * surface.omega**2, found.stiffness, rtol=1e-12)
    np.testing.assert_allclose(dynamic.imag / surface.omega, found.damping, rtol=1e-9)
    assert [finding.code for finding in surface.findings] == ["force-of-decay"]


def test_forced_and_free_agree_where_they_are_of_one_structure() -> None:
    free = follow_decay(TimeHistory(RATE, None, decay("cubic")), mass=MASS)

    def differ(kn: float) -> tuple[float, float]:
        law = make_element("all", "k*x + kn*x**3 + c*v")
        o = Oscillator(MASS, (law,), {"k": STIFFNESS, "kn": kn, "c": 1.9})
        return free.differ(from_swept_sine(sweep(o, 0.8, SweepLaw("linear", 9.0, 0.02), 11.0, RATE)))

    k, c = differ(-2e6)
    assert k < 1e-3
    assert c < 5e-3
    assert differ(-8e6)[0] > 1e-3


def test_the_decay_begins_where_the_force_ends() -> None:
    quiet = decay("linear")
    force = np.concatenate([np.ones(1000), np.zeros(len(quiet))])
    response = np.concatenate([np.full(1000, 0.012), quiet])
    found = follow_decay(TimeHistory(RATE, force, response), mass=MASS)
    assert found.time[0] > 2.0
    np.testing.assert_allclose(found.damping[:20], 1.9, rtol=1e-3)


def test_a_mode_is_chosen_by_its_band() -> None:
    t = np.arange(0, 15, 1 / RATE)
    two = np.exp(-0.6 * t) * np.cos(2 * np.pi * 10 * t) + 2 * np.exp(-0.5 * t) * np.cos(2 * np.pi * 31 * t)
    found = follow_decay(TimeHistory(RATE, None, two), band=(5, 15))
    assert np.median(found.frequency) == pytest.approx(10, rel=1e-3)
    assert np.median(found.damping) == pytest.approx(1.2, rel=0.02)
    assert np.median(follow_decay(TimeHistory(RATE, None, two)).frequency) == pytest.approx(31, rel=1e-3)


@pytest.mark.parametrize(
    ("force", "response", "message"),
    [
        (np.ones(5000), np.ones(5000), "force does not end"),
        (None, np.zeros(5000), "nothing moves"),
        (None, np.exp(-20 * np.arange(5000) / RATE) * np.cos(0.1 * np.arange(5000)), "stand out"),
    ],
)
def test_what_is_no_decay_is_refused(force: np.ndarray | None, response: np.ndarray, message: str) -> None:
    with pytest.raises(MeasurementError, match=message):
        follow_decay(TimeHistory(RATE, force, response))
