"""Free decays: k(X), c(X) against describing functions, bands against scatter, forced against free."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete, lfilter

import rsgen
from rsgen.common.errors import MeasurementError, RsgenError
from rsgen.data.history import TimeHistory, follow_decay, from_free_decay
from rsgen.data.history.decay import _scatter
from rsgen.data.oscillator import Model
from rsgen.identification.fitting.points import select_points
from rsgen.report.sentences import headline
from tests.surfaces import codes
from tests.virtual import only

MASS, STIFFNESS = 1.5, 1.5 * (2 * np.pi * 10) ** 2
RATE = 500.0
LAWS = {
    # force added to the linear spring; describing functions of stiffness and damping (docs/method.md, 3)
    "linear": (lambda x, v: 1.9 * v, lambda X, w: 0 * X, lambda X, w: 1.9 + 0 * X),
    "cubic": (lambda x, v: -2e6 * x**3 + 1.9 * v, lambda X, w: -1.5e6 * X**2, lambda X, w: 1.9 + 0 * X),
    "drag": (lambda x, v: 0.9 * v + 2 * v * abs(v), lambda X, w: 0 * X,
             lambda X, w: 0.9 + 2 * 8 / (3 * np.pi) * w * X),
}  # fmt: skip


def free(pace: float, duration: float, frequency: float = 10.0, rate: float = RATE) -> np.ndarray:
    t = np.arange(0, duration, 1 / rate)
    return np.exp(-pace * t) * np.cos(2 * np.pi * frequency * t)


def followed(response: np.ndarray, mass: float | None = MASS, rate: float = RATE, **options):
    return follow_decay(TimeHistory(rate, None, response), mass=mass, **options)


def virtual(law: str, values: dict[str, float], mass: float, **plan) -> rsgen.ResponseSurface:
    """A virtual decay with a thousandth of noise where nothing else is said."""
    test = rsgen.DecayTest(**{"noise_relative": 1e-3, **plan})
    return rsgen.simulate(rsgen.Oscillator(mass, law, values), test)


def integrated(force, mass: float, start: float, duration: float, rate: float = RATE, **how):
    """Return displacement and velocity of m a + force(x, v) = 0, let go at ``start``."""
    how = {"rtol": 1e-9, "atol": 1e-12, "t_eval": np.arange(0, duration, 1 / rate)} | how
    return solve_ivp(lambda t, y: [y[1], -force(*y) / mass], (0, duration), [start, 0], **how).y


@cache
def decay(name: str, quantity: str = "displacement", duration: float = 15) -> np.ndarray:
    n = LAWS[name][0]
    x, v = integrated(lambda x, v: STIFFNESS * x + n(x, v), MASS, 0.012, duration)
    return {"displacement": x, "velocity": v, "acceleration": -(STIFFNESS * x + n(x, v)) / MASS}[quantity]


@pytest.mark.slow
@pytest.mark.parametrize("name", LAWS)
def test_a_free_decay_gives_the_describing_functions(name: str) -> None:
    found = followed(decay(name))
    omega = 2 * np.pi * found.frequency
    k = STIFFNESS + LAWS[name][1](found.amplitude, omega)
    c = LAWS[name][2](found.amplitude, omega)
    large = found.amplitude > 1e-5
    assert np.count_nonzero(large) > 30
    assert np.max(np.abs(found.stiffness / k - 1)[large]) < 1e-4
    # what a describing function leaves out at these amplitudes; c(X) of the cubic law is off by most
    assert np.max(np.abs(found.damping / c - 1)[large]) < 2e-3
    np.testing.assert_allclose(found.damping_ratio, found.damping / (2 * MASS * omega), rtol=1e-12)


@pytest.mark.parametrize(("k2", "k3", "quantity"), [(5e5, 1e8, "displacement"), (0.0, 4e8, "velocity")])
def test_the_harmonics_of_a_decay_are_those_of_its_steady_motion(k2: float, k3: float, quantity: str) -> None:
    mass, c = 0.5, 0.6
    x, v = integrated(
        lambda x, v: 12000.0 * x + k2 * x**2 + k3 * x**3 + c * v, mass, 6e-3, 3, 2000,
        method="DOP853", rtol=1e-10, atol=1e-14,
    )  # fmt: skip
    measured = x if quantity == "displacement" else v
    found = follow_decay(TimeHistory(2000, None, measured, quantity), mass=mass)
    order = np.arange(2, 6)
    turned = found.harmonics * np.exp(-1j * np.angle(found.harmonics[:, 1:2]) * np.arange(6))
    share = turned[:, 2:] / found.amplitude[:, None]
    # each harmonic of a steady motion loses work to the damper
    loss = 1 + np.sum(order**2 * np.abs(share) ** 2, axis=1)
    np.testing.assert_allclose(found.damping, c * loss, rtol=1e-3)
    # and the third lags by the damper over its inertia, 3 omega c/(8 m omega^2); it led by as much
    large = found.amplitude > 0.5 * found.amplitude[0]
    lag = np.mean(np.angle(share[large, 1]) / (0.75 * found.damping_ratio[large]))
    assert lag == pytest.approx(1, abs=0.25)


@pytest.mark.parametrize("k3", [-35650.0, 70000.0])
@pytest.mark.parametrize("duration", [6, 20])
def test_the_first_point_of_a_fast_decay_has_its_describing_functions(k3: float, duration: float) -> None:
    # from 45 mm, in short and in long windows: amplitude and frequency change much within the first
    mass, k, c, q = 0.31, 215.9, 0.034, 1.05
    force = lambda x, v: k * x + k3 * x**3 + c * v + q * v * abs(v)  # noqa: E731
    x, v = integrated(force, mass, 0.045, duration, 400)
    for quantity, measured in {"displacement": x, "velocity": v, "acceleration": -force(x, v) / mass}.items():
        found = follow_decay(TimeHistory(400, None, measured, quantity), mass=mass)
        X, omega = found.amplitude, 2 * np.pi * found.frequency
        np.testing.assert_allclose(found.damping, c + 8 / (3 * np.pi) * q * omega * X, rtol=0.01)
        np.testing.assert_allclose(found.stiffness, k + 0.75 * k3 * X**2, rtol=1e-3)


@pytest.mark.parametrize("zeta", [0.01, 0.02, 0.03])
def test_a_decay_of_a_few_percent_of_damping_is_followed(zeta: float) -> None:
    natural = 2 * np.pi * 10
    found = followed(free(zeta * natural, 0.16 / zeta, 10 * np.sqrt(1 - zeta**2)), mass=1.0)
    np.testing.assert_allclose(found.stiffness, natural**2, rtol=1e-4)
    np.testing.assert_allclose(found.damping, 2 * zeta * natural, rtol=1e-3)
    assert np.max(found.amplitude) > 3 * np.min(found.amplitude)


@pytest.mark.slow
def test_a_decay_as_points_of_a_steady_test_has_the_same_curves() -> None:
    history = TimeHistory(RATE, None, decay("cubic"), label="tap.csv")
    found, surface = follow_decay(history, mass=MASS), from_free_decay(history, mass=MASS)
    # without mass all is per mass, and no force is made up
    np.testing.assert_allclose(follow_decay(history).stiffness, found.stiffness / MASS, rtol=1e-9)
    with pytest.raises(MeasurementError, match=r"tap.csv: .* give the mass"):
        from_free_decay(history)
    dynamic = surface.force / surface.harmonics[:, 1]
    np.testing.assert_allclose(dynamic.real + MASS * surface.omega**2, found.stiffness, rtol=1e-12)
    np.testing.assert_allclose(dynamic.imag / surface.omega, found.damping, rtol=1e-9)
    assert [finding.code for finding in surface.findings] == ["force-of-decay", "decay-taken"]


def test_the_mass_with_which_a_decay_was_read_is_known_afterwards() -> None:
    surface = from_free_decay(TimeHistory(RATE, None, free(0.6, 15)), mass=MASS)
    assert rsgen.modal_table(surface).mass == MASS
    weighed = rsgen.identify(surface, "k*x + c*v", mass=MASS, mass_error=0.02 * MASS)
    assert weighed["k"].standard_error == pytest.approx(0.02 * weighed["k"].value, rel=1e-3)
    assert weighed["m"].standard_error == pytest.approx(0.02 * MASS)
    # forces are made from the response
    assert weighed.outcome.names["moves"] == "1 % of the response moves c by 0 %, k by 0 %, m by 0 %"
    exact = rsgen.identify(surface, "k*x + c*v", mass=MASS).outcome.names["moves"]
    assert exact.startswith("1 % of m moves c by 1 %, k by 1 %; 1 % of the response moves c by 0 %")
    # another mass that is given counts
    assert rsgen.modal_table(surface, mass=2.0).mass == 2.0


def test_a_mode_is_chosen_by_its_band() -> None:
    two = free(0.6, 15) + 2 * free(0.5, 15, 31)
    found = followed(two, None, band=(5, 15))
    assert np.median(found.frequency) == pytest.approx(10, rel=1e-3)
    assert np.median(found.damping) == pytest.approx(1.2, rel=0.02)
    assert np.median(followed(two, None).frequency) == pytest.approx(31, rel=1e-3)


def response_to(force: np.ndarray) -> np.ndarray:
    above, below, _ = cont2discrete(([1.0], [MASS, 1.9, STIFFNESS]), 1 / RATE, "foh")
    return lfilter(above.ravel(), below, force)


def driven_decay(noise: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Force and displacement: 12 s of sine near the resonance, then 20 s of free decay (c = 1.9, linear)."""
    t = np.arange(0, 32, 1 / RATE)
    force = np.where(t < 12, 3 * np.cos(2 * np.pi * 10.03 * t), 0.0)
    x = response_to(force)
    return force, x + noise * np.std(x) * np.random.default_rng(2).normal(size=len(x))


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_decay_begins_where_the_drive_ends_though_no_force_was_measured(noise: float) -> None:
    found = followed(driven_decay(noise)[1])
    begin = only(found, "decay-taken")
    assert begin.names["after"] == "drive"
    assert 12.0 <= begin["begin"] < 13.0
    assert begin["large"] == pytest.approx(found.amplitude[0])
    loud = found.amplitude > 0.1 * found.amplitude[0]
    assert np.median(found.damping[loud]) == pytest.approx(1.9, rel=0.05 if noise else 1e-3)
    np.testing.assert_allclose(found.stiffness, STIFFNESS, rtol=0.02 if noise else 1e-4)


def test_a_given_start_wins_and_a_drive_after_it_is_a_doubt() -> None:
    _, x = driven_decay()
    early, late = followed(x, start=8.0), followed(x, start=12.5)
    assert only(early, "decay-taken")["begin"] == pytest.approx(8.0)
    assert only(early, "decay-not-free").severity == "doubt"
    assert [finding.code for finding in late.findings] == ["decay-taken"]
    np.testing.assert_allclose(late.damping, 1.9, rtol=1e-3)


@pytest.mark.parametrize("with_force", [False, True])
def test_every_blow_of_a_record_is_a_decay_of_its_own(with_force: bool) -> None:
    t = np.arange(0, 36, 1 / RATE)
    force = sum(size * np.exp(-(((t - at) / 0.004) ** 2)) for at, size in ((2, 400), (13, 250), (24, 500)))
    x = response_to(force)
    surface = from_free_decay(TimeHistory(RATE, force if with_force else None, x), mass=MASS)
    assert [one["used"] for one in surface.findings if "used" in one.numbers] == [len(surface.levels)] == [3]
    c = (surface.force / surface.harmonics[:, 1]).imag / surface.omega
    np.testing.assert_allclose(c, 1.9, rtol=5e-3)


def test_modes_that_beat_are_a_doubt() -> None:
    slow = TimeHistory(RATE, None, free(0.31, 30) + 0.8 * free(0.3267, 30, 10.4))
    assert only(from_free_decay(slow, mass=MASS), "decay-not-free").severity == "doubt"
    fast = TimeHistory(RATE, None, free(0.3, 30) + 0.8 * free(0.3, 30, 11.5))
    with pytest.raises(MeasurementError, match="second mode beats with it"):
        from_free_decay(fast, mass=MASS)


def test_the_error_of_a_point_is_the_scatter_of_its_neighbours_about_a_line() -> None:
    # white noise about a straight line: the variance is that of the noise, two numbers go into each line
    noise = 0.3 * np.random.default_rng(7).standard_normal(20_000)
    found = _scatter(noise + 0.01 * np.arange(len(noise)))
    # 20 000 points in overlapping groups of a few: their mean square is good to some per cent
    assert np.mean(found**2) == pytest.approx(0.3**2, rel=0.04)


def test_a_background_is_neither_advised_nor_accepted_for_a_free_decay() -> None:
    table = from_free_decay(TimeHistory(RATE, None, decay("cubic")), mass=MASS)
    assert table.decays
    found = rsgen.identify(table, "k*x + c*v", mass=MASS)
    assert "law-does-not-fit" in codes(found)
    assert "background-missing" not in codes(found)
    for ask, *law in ((rsgen.identify, "k*x + c*v"), (rsgen.rank, "k*x + c*v"), (rsgen.modal_table,)):
        with pytest.raises(RsgenError, match="free decay"):
            ask(table, *law, rsgen.Observation(background="residuals+offset"), mass=MASS)


def test_neighbours_of_a_decay_are_those_in_amplitude() -> None:
    # noise alone orders the frequencies of a linear mode
    noise = 1e-5 * np.random.default_rng(0).standard_normal(len(decay("linear")))
    table = from_free_decay(TimeHistory(RATE, None, decay("linear") + noise), mass=MASS)
    points = select_points(table, Model("k*x + c*v"))
    order = np.argsort(points.amplitude)
    np.testing.assert_array_equal(points.neighbours, np.stack([order[:-1], order[1:]], axis=1))


def test_the_right_law_of_a_decay_is_not_doubted_for_frequencies_that_noise_orders() -> None:
    clean, states = decay("linear"), []
    for seed in range(20):
        noise = 1e-5 * np.random.default_rng(seed).standard_normal(len(clean))
        table = from_free_decay(TimeHistory(RATE, None, clean + noise), mass=MASS)
        states.append(rsgen.identify(table, "k*x + c*v", mass=MASS).verdict.state)
    assert states.count("identified") >= 19


HELD_OUT = {
    "cubic": ("k*x + k3*x**3 + c*v", {"k": 12000.0, "k3": 4e8, "c": 0.6}),
    "friction": ("k*x + k3*x**3 + c*v + Ff*sign(v)", {"k": 12000.0, "k3": 4e8, "c": 0.6, "Ff": 0.25}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", HELD_OUT)
def test_a_decay_that_is_held_out_is_judged_at_its_amplitudes(name: str) -> None:
    # each point lies on the resonance, where a force decides between two amplitudes by chance
    law, values = HELD_OUT[name]
    table = virtual(law, values, 0.5, level=[6e-3, 10e-3], duration=8, rate=2000)
    for level in table.levels:
        hidden = rsgen.Observation(hold_out=[float(level)])
        found = rsgen.identify(table, law, hidden, mass=0.5)
        assert found.verdict.state == "identified"
        (held,) = found.held_out
        assert held.missing == 0
        assert held.error < 0.05 or held.error < held.explained
    # without the damper of the law, or its friction, the force is another one
    wrong = "k*x + k3*x**3 + Ff*sign(v)" if name == "friction" else "k*x + c*v"
    assert rsgen.identify(table, wrong, hidden, mass=0.5).held_out[0].error > 0.5


def released(amplitude: float, held: float = 0.15, rate: float = 2000.0) -> TimeHistory:
    """Return a release from a displacement held for some time, which friction stops; 4 um of noise."""
    still = round(held * rate)
    moved, _ = integrated(
        lambda x, v: 12000 * x + 4e8 * x**3 + 0.6 * v + 0.25 * np.tanh(v / 1e-4),
        0.5, amplitude, 4 - held, rate, method="LSODA", rtol=1e-7, atol=1e-9,
    )  # fmt: skip
    x = np.concatenate([np.full(still, amplitude), moved])
    noise = 4e-6 * np.random.default_rng(3).standard_normal(len(x))
    return TimeHistory(rate, None, x + 2e-5 + noise, label=f"{1e3 * amplitude:g} mm")


@pytest.mark.parametrize("start", [None, 0.0])
def test_a_decay_begins_where_a_structure_held_displaced_is_let_go(start: float | None) -> None:
    found = follow_decay(released(6e-3), mass=0.5, start=start)
    begin = only(found, "decay-taken")
    assert (begin.names["after"], begin["begin"]) == ("hold", pytest.approx(0.15, abs=1e-3))
    omega, X = 2 * np.pi * found.frequency[0], found.amplitude[0]
    assert X > 5.0e-3
    assert found.damping[0] == pytest.approx(0.6 + 4 * 0.25 / (np.pi * omega * X), rel=0.01)
    # the step of a hold is not the line of a mode whose damping is high when it is large
    x = np.full(round(3.3 * RATE), 0.045)
    dragged, _ = integrated(lambda x, v: 700 * x - 1.1e5 * x**3 + 0.1 * v + 3.4 * v * abs(v), 1.0, 0.045, 40)
    x = np.concatenate([x, dragged]) + 2e-5 * np.random.default_rng(0).standard_normal(len(x) + len(dragged))
    found = followed(x, mass=1.0, start=start)
    assert only(found, "decay-taken")["begin"] == pytest.approx(3.3, abs=3e-3)
    assert found.frequency[-1] == pytest.approx(np.sqrt(700) / 2 / np.pi, rel=2e-3)


def test_points_near_rest_are_left_out_and_counted() -> None:
    law, values = HELD_OUT["friction"]
    table = virtual(law, values, 0.5, level=[4e-3], duration=4, rate=2000)
    left = only(table, "points-excluded")
    assert (left["excluded"], left["points"]) == (1, len(table) + 1)
    # 4 Ff/k a period, within nearly four of them
    assert table.amplitude.min() > 15 * values["Ff"] / values["k"]


def test_a_friction_that_a_decay_shows_as_sharp_has_no_width() -> None:
    # where a period of 64 samples does not resolve tanh(v/vs), its width is no value of the test
    law, values = "k*x + c*v + Ff*sign(v)", {"k": 6000.0, "c": 0.3, "Ff": 0.05}
    table = virtual(law, values, 1.5, level=[6e-3, 12e-3], duration=25, rate=400, seed=3)
    found = rsgen.identify(table, "k*x + c*v + Ff*tanh(v/vs)", mass=1.5)
    assert not found["vs"].identifiable
    assert found["vs"].interval[0] == -np.inf


def test_the_noise_of_a_decay_is_that_of_its_slopes() -> None:
    # the frequency of a hardening spring is far better known than its damping, relative to the force
    law, values = "k*x + c*v + k3*x**3", {"k": 24674.0, "c": 0.9425, "k3": 1.85e9}
    table = virtual(law, values, 1.0, level=[2e-3], duration=10.6, rate=1200, noise_relative=2e-3)
    found = rsgen.identify(table, law, mass=1.0)
    low, high = found["k3"].interval
    assert low < 1.85e9 < high
    assert high - low < 0.01 * 1.85e9


def test_a_decay_that_friction_stops_too_soon_is_left_out_and_says_so() -> None:
    short, long = released(1e-3), released(6e-3)
    stopped = r"friction stops the decay at 24.\d* Hz after 11 periods, and 15 are needed: .* from (.*) mm"
    with pytest.raises(MeasurementError, match=stopped) as refused:
        from_free_decay(short, mass=0.5)
    enough = float(re.search(stopped, str(refused.value))[1])
    assert 1.2 < enough < 2
    assert follow_decay(released(1e-3 * enough), mass=0.5).amplitude[0] < 1e-3 * enough
    with pytest.raises(MeasurementError, match=r"none of the 2 records can be used: 1 mm: fr.*; 1 mm: fr"):
        from_free_decay([short, short], mass=0.5)
    both = from_free_decay([short, long], mass=0.5, start=[None, 0.16])
    (left,) = (finding for finding in both.findings if finding.severity == "warning")
    assert left.names["reason"].startswith("1 mm: friction stops the decay at")
    assert np.array_equal(both.force, from_free_decay(long, mass=0.5, start=0.16).force)
    with pytest.raises(MeasurementError, match="start: 1 instants for 2 histories"):
        from_free_decay([short, long], mass=0.5, start=[0.16])


SHORT = {
    # of 18 to 24 periods: the law and its describing functions k(X) - k, c(X)
    "friction": ("Ff*sign(v)", {"c": 1.0, "Ff": 0.3}, lambda X, w: (0, 1 + 1.2 / (np.pi * w * X))),
    "drag": ("q*v*abs(v)", {"c": 1.0, "q": 6.0}, lambda X, w: (0, 1 + 16 / np.pi * w * X)),
    "soft": ("k3*x**3", {"c": 4.0, "k3": -2e6}, lambda X, w: (-1.5e6 * X**2, 4 + 0 * X)),
}


@pytest.mark.parametrize("name", SHORT)
def test_short_decays_give_the_describing_functions_and_honest_intervals(name: str) -> None:
    term, values, functions = SHORT[name]
    law, values = f"k*x + c*v + {term}", {"k": 3948.0, **values}
    for noise, accuracy in ((0.0, 2e-3), (1e-3, 0.03)):
        plan = {"level": [7e-3, 10e-3], "duration": 1.9, "rate": 500, "noise_relative": noise, "seed": 3}
        table = virtual(law, values, 1.0, **plan)
        assert len(table.levels) == 2
        dynamic = table.force / table.harmonics[:, 1]
        k, c = functions(table.amplitude, table.omega)
        np.testing.assert_allclose(dynamic.real + table.omega**2, 3948.0 + k, rtol=accuracy)
        np.testing.assert_allclose(dynamic.imag / table.omega, c, rtol=accuracy)
    found = rsgen.identify(table, law, mass=1.0)
    assert found.verdict.state == "identified"
    for parameter, true in values.items():
        assert found[parameter].interval[0] < true < found[parameter].interval[1]


def test_long_records_are_followed_in_long_windows_unless_another_is_short() -> None:
    long, short = released(6e-3), released(2.5e-3)
    together = from_free_decay([long, short], mass=0.5)
    assert len(together.levels) == 2
    # noise of points is that of their windows: all have one length
    alone = from_free_decay(long, mass=0.5)
    assert np.count_nonzero(together.level == together.level.max()) > 1.5 * len(alone)


@pytest.mark.parametrize(("rate", "duration", "pace", "noise", "reason"), [
    (500, 1.0, 3, 1e-4, "has 10 periods of the decay at 10 Hz, and 14 are needed: record it to its end"),
    (120, 1.6, 3, 1e-4, "the record has 16 periods of the decay at 10 Hz, and 27 are needed"),
    (500, 3.0, 6, 0.02, "the decay at 10 Hz has 5 periods above noise, and 14 are needed"),
])  # fmt: skip
def test_what_makes_a_decay_too_short_is_said(rate, duration, pace, noise, reason) -> None:
    x = free(pace, duration, rate=rate)
    x += noise * np.random.default_rng(0).standard_normal(len(x))
    with pytest.raises(MeasurementError, match=reason):
        followed(x, None, rate)


def dragged(release: float = 5.5e-3) -> np.ndarray:
    """Return the acceleration of a beam let go after 0.75 s at rest, at 2000 Hz; drag damps it fast."""
    force = lambda x, v: 8800 * x + 0.55 * v + 2.2e8 * x**3 + 9 * v * abs(v)  # noqa: E731
    moved = integrated(force, 0.62, release, 8, 2000)
    noise = 0.04 * np.random.default_rng(5).standard_normal(17_500)
    return np.concatenate([np.zeros(1500), -force(*moved) / 0.62]) + noise


def test_a_decay_that_is_fitted_far_below_its_release_says_so() -> None:
    law = "k*x + k3*x**3 + c*v + q*v*abs(v)"
    surface = from_free_decay(TimeHistory(2000, None, dragged(8e-3), "acceleration"), mass=0.62)
    taken = only(surface, "decay-taken")
    assert taken["released"] == pytest.approx(8e-3, rel=0.15)
    # at some 20 Hz: the reference does not follow the fall within the first window
    assert (taken["first"] - taken["begin"]) * 20 == pytest.approx(7.7, abs=0.4)
    found = rsgen.identify(surface, law, mass=0.62)
    short = only(found, "decay-begins-larger")
    assert short.severity == "warning"
    assert short["fitted"] < 0.5 * short["released"]
    # as far as windows of ten periods are the reason
    assert short.names["windows"] == "long"
    cut = TimeHistory(2000, None, dragged(8e-3)[:4000], "acceleration")
    nearer = rsgen.identify(from_free_decay(cut, mass=0.62), law, mass=0.62)
    assert only(nearer, "decay-begins-larger")["fitted"] > 1.4 * short["fitted"]
    assert "windows" not in only(nearer, "decay-begins-larger").names
    assert "points-excluded" not in codes(found)


def test_a_start_before_the_release_leaves_the_rest_out_and_one_after_it_is_named() -> None:
    history = TimeHistory(2000, None, dragged(), "acceleration")
    # half a second, a quarter and a tenth of a period before it
    for start in (0.5, 0.7375, 0.745):
        early = follow_decay(history, mass=0.62, start=start)
        taken = only(early, "decay-taken")
        assert (taken["begin"], taken.names["after"]) == (pytest.approx(0.75, abs=1e-3), "blow")
    # of a light damper a later period may have the largest sample
    light = np.concatenate([np.zeros(600), free(0.13, 40)])
    light += 0.003 * np.random.default_rng(1).standard_normal(len(light))
    found = follow_decay(TimeHistory(RATE, None, light, "acceleration"), mass=1.0, start=0.3)
    assert 1.2 <= only(found, "decay-taken")["begin"] < 1.5
    assert found.findings[1:] == ()
    assert np.array_equal(early.damping, follow_decay(history, mass=0.62).damping)
    with pytest.raises(MeasurementError, match=r"or the start of 8.4 s cuts it"):
        follow_decay(history, mass=0.62, start=8.4)


@pytest.mark.parametrize(("law", "fixed", "said"), [
    ("k*x + c*v", {}, False), ("k*x + c*v + k3*x**3", {}, True), ("k*x + c*v + k3*x**3", {"k3": 1e4}, False),
])  # fmt: skip
def test_that_nothing_checks_the_size_of_a_decay_is_said_where_values_depend_on_it(law, fixed, said) -> None:
    motion = 1e-3 * free(0.4, 20) + 1e-7 * np.random.default_rng(0).standard_normal(10000)
    surface = from_free_decay(TimeHistory(RATE, None, motion), mass=1.0)
    verdict = rsgen.identify(surface, law, mass=1.0, fixed=fixed).verdict
    assert verdict.summary is not None
    assert ("force" in verdict.summary.names) is said
    shown = headline(replace(verdict, state="identified"))
    assert shown.endswith("nothing but a title of the column checks, decide k3") is said


@pytest.mark.parametrize(("measured", "declared", "order"), [
    ("displacement", "displacement", []), ("acceleration", "displacement", ["+2"]),
    ("velocity", "acceleration", ["-1"]),
])  # fmt: skip
def test_a_decay_of_another_quantity_is_told_by_its_third_harmonic(measured, declared, order) -> None:
    history = TimeHistory(RATE, None, decay("cubic", measured), declared)
    found = rsgen.identify(from_free_decay(history, mass=MASS), "k*x + c*v + k3*x**3", mass=MASS)
    told = [one for one in found.findings if one.code == "another-quantity"]
    assert [one.names["is"] for one in told] == order
    assert all(one["harmonic"] == pytest.approx((-3.0) ** int(one.names["is"]), rel=0.2) for one in told)
    assert found.verdict.state == ("doubtful" if order else "identified")


def test_levels_of_decays_are_labels() -> None:
    both = [TimeHistory(2000, None, dragged(x), "acceleration", level=n) for x, n in ((2.5e-3, 1), (4e-3, 2))]
    surface = from_free_decay(both, mass=0.62)
    assert np.unique(surface.label).tolist() == [1, 2]
    assert only(surface, "levels-disagree").names["labels"] == "1, 2"
    hidden = rsgen.Observation(hold_out=[2])
    (held,) = rsgen.identify(surface, "k*x + k3*x**3 + c*v + q*v*abs(v)", hidden, mass=0.62).held_out
    assert held.level == surface.levels[1]


@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_a_growing_motion_and_noise_are_no_decay(noise):
    with pytest.raises(RsgenError, match="does not fall as a free decay does"):
        followed(1e-3 * np.random.default_rng(5).normal(size=6000), rate=1000)
    # a record read backwards grows; to its last zero
    motion = free(0.4, 20.025, rate=400)[:9:-1]
    motion = motion + noise * np.random.default_rng(1).normal(size=len(motion))
    # that grows late, or slowly throughout
    late = np.concatenate([free(0.01, 4, rate=400), free(-0.3, 8, rate=400)])
    for growing in (motion, late, free(-0.1, 8, rate=400)):
        for band in (None, (7, 13)):
            with pytest.raises(RsgenError, match=r"near 10 Hz grows and does not fall"):
                followed(growing, rate=400, band=band)
    # a decay before it is one
    both = np.concatenate([free(0.4, 20, rate=400), motion])
    assert len(from_free_decay(TimeHistory(400.0, None, both), mass=1.0)) > 10
