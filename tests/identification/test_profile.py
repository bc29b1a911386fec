"""Intervals by profile likelihood, and forces from k(X) and c(V) alone."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import rsgen as rs
from rsgen import ResponseSurface, identify
from rsgen.common.tolerances import BALANCE_HARMONICS, NEAR_STEPS
from rsgen.identification.fitting import least_squares
from rsgen.identification.fitting.forward import Simulator
from rsgen.identification.profile import Profile, _Likelihood, profile, with_profiles
from rsgen.identification.restoring_force import invert_curve
from rsgen.identification.results.result import EquivalentCurve, Estimate
from rsgen.report.page_tables import _estimate_cell, estimate_table
from tests.pins.grids import joint_law, small_joint
from tests.surfaces import codes
from tests.virtual import fundamentals, simulated

CUBIC, VALUES = "k*x + c*v + k3*x**3", {"k": 6000.0, "c": 4.0, "k3": 2e5}
GAP, STOP = "k*x + c*v + kg*(Max(x - b, 0) + Min(x + b, 0))", {"k": 6000.0, "c": 4.0, "kg": 6000.0, "b": 3e-3}


def gauged(law: str, values: dict[str, float], level: list[float], seed: int) -> ResponseSurface:
    how = {"noise_relative": 0.01, "seed": seed, "method": "harmonic-balance"}
    return simulated(law, values, level, (9.85, 10.35, 10), **how)


def touched(seed: int) -> ResponseSurface:
    """A gap that the highest level only just passes."""
    force = 1.06 * STOP["b"] * STOP["c"] * 2 * np.pi * 10.07
    return gauged(GAP, STOP, [force * share for share in (0.25, 0.5, 0.75, 1.0)], seed)


def test_it_is_walds_where_the_law_is_linear():
    found = identify(gauged(CUBIC, VALUES, [1.0, 2.0, 4.0, 8.0], 1), CUBIC)
    assert not any(estimate.by_profile for estimate in found.refined)
    for estimate in found.refined:
        one = profile(found, estimate.name)
        half = estimate.interval[1] - estimate.value
        assert np.subtract(one.interval, estimate.interval) == pytest.approx(0, abs=0.05 * half)
        assert one.wald == pytest.approx(estimate.interval)
        # the root of the deviance is a straight line of slope one by the standard error
        line = (one.values - estimate.value) / estimate.standard_error
        assert one.root == pytest.approx(line, abs=0.1, rel=0.025)


def test_it_is_walds_where_the_balance_loses_points_at_once(monkeypatch):
    # as at the crest of a sweep: no value beside the best has a motion at every point
    found = identify(touched(2), GAP)
    monkeypatch.setattr(_Likelihood, "end", lambda *given: (np.sign(given[2]) * np.inf, found["b"].value))
    lost = with_profiles(found.fit, [replace(found["b"], by_profile=False)])[0]
    assert not lost.by_profile
    assert lost.finding is None or lost.finding.code != "not-determined"


def test_the_deviance_is_that_of_an_identification_with_the_value_fixed():
    surface = gauged(CUBIC, VALUES, [1.0, 2.0, 4.0, 8.0], 2)
    # with the fundamental alone no weight depends on the solution
    surface = fundamentals(surface)
    found = identify(surface, CUBIC)
    one = profile(found, "k3")
    regression = found.fit.regression
    freedom, place = regression.freedom, found.fit.problem.law.parameters.index("k3")
    # what terms the law may lack would move widens the interval
    wider = found["k3"].standard_error / np.sqrt(regression.covariance[place, place])
    for value, root in zip(one.values[[0, -1]], one.root[[0, -1]], strict=True):
        held = identify(surface, CUBIC, fixed={"k3": float(value)})
        # one freedom more; both misfits are per freedom
        grown = (held.fit.regression.sigma / regression.sigma) ** 2 * (freedom + 1) - freedom
        assert (root * wider) ** 2 == pytest.approx(grown, rel=0.05)


@pytest.mark.slow
def test_a_gap_only_just_passed_has_a_lopsided_interval():
    found = identify(touched(1), GAP)
    stiffness = found["kg"]
    assert stiffness.by_profile
    low, high = stiffness.interval
    assert low < STOP["kg"] < high
    assert low > 0
    assert high - stiffness.value > 2 * (stiffness.value - low)
    assert "by profile" in str(found)
    assert not found["k"].by_profile
    stopped = replace(found.fit, regression=replace(found.fit.regression, converged=False))
    assert not any(estimate.by_profile for estimate in with_profiles(stopped, found.first_order))


@pytest.mark.thorough
def test_a_stop_that_is_barely_touched_is_bounded_to_one_side():
    found = identify(touched(7), GAP)
    stiffness = found["kg"]
    assert not stiffness.identifiable
    assert stiffness.finding.code == "bounded-to-one-side"
    assert 0 < stiffness.interval[0] < STOP["kg"] < stiffness.interval[1] == np.inf
    assert stiffness.finding["bound"] == stiffness.interval[0]
    assert found["b"].identifiable


@pytest.mark.parametrize("width", [None, 2e-2])
def test_a_friction_too_sharp_for_the_test_is_bounded_and_not_identified(width):
    # a period of 64 samples does not resolve a steep tanh, and the balance is no data on how steep it is
    law, values = "k*x + c*v + Ff*tanh(v/vs)", {"k": 1.2e4, "c": 1.5, "Ff": 0.25}
    true, known = ("k*x + c*v + Ff*sign(v)", {}) if width is None else (law, {"vs": width})
    test = simulated(true, values | known, PLATE, (15, 24, 46), 0.8, noise_relative=0.005, seed=2)
    estimate = identify(test, law)["vs"]
    assert estimate.identifiable == (width is not None)
    if width is None:
        assert estimate.interval[0] == -np.inf
        assert estimate.cells[2].startswith("at most ")
    else:
        assert estimate.interval[0] < width < estimate.interval[1]


@pytest.mark.parametrize(("interval", "words"), [
    ((2.0, 4.0), "2 to 4 m/s, by profile likelihood"), ((-np.inf, np.inf), "not determined"),
    ((-np.inf, 4.0), "at most 4 m/s, by profile likelihood"),
    ((2.0, np.inf), "at least 2 m/s, by profile likelihood"),
])  # fmt: skip
def test_an_interval_without_limit_is_in_the_same_words_in_all_tables(interval, words):
    estimate = Estimate("w", 3.0, 1.0, interval, "m/s", by_profile=True)
    assert _estimate_cell(estimate, "m/s", interval=True).note == words
    assert estimate.cells[2] == words.replace(" m/s", "").replace(" likelihood", "")
    root = np.array([-1.0, 1.0])
    profile = Profile("w", "m/s", 3 + root, root, interval, (2.0, 4.0), (-np.inf, np.inf))
    assert profile.table.caption.split(",")[0] == "w: " + words.split(",")[0]


@pytest.fixture
def not_simulated(monkeypatch):
    """The simulator, which takes minutes, is not to be begun."""

    def refused(*args: object, **options: object) -> None:
        raise AssertionError("simulated")

    monkeypatch.setattr(sys.modules["rsgen.identification.identify"], "fit_simulator", refused)


PLATE = [0.8, 1.5, 3.0, 4.5]


@pytest.mark.usefixtures("not_simulated")
def test_values_that_noise_hides_are_not_determined_and_not_simulated():
    named, how = {"k": 1.2e4, "k3": 6e5, "c": 1.5, "Ff": 0.25}, {"noise_relative": 5e-3, "seed": 3}
    test = simulated(f"{CUBIC} + Ff*sign(v)", named, PLATE, (15, 24, 50), 0.8, **how)
    found = identify(test, f"{CUBIC} + (Fc + Fd*exp(-v**2/vs**2))*sign(v)")
    for name in ("Fd", "vs"):
        assert found[name].finding.code == "not-distinct-from-zero"
    for name in ("k", "k3", "c"):
        assert found[name].identifiable
        assert found[name].interval[0] < named[name] < found[name].interval[1]
    assert found["Fc"].interval[0] < named["Ff"] < found["Fc"].interval[1]


def test_a_joint_without_compliance_is_not_sought_for_minutes(monkeypatch):
    """Its stiffness grows without end, by the formula as by the element of the library."""
    true, how = {"k": 26500.0, "k5": 4.4e13, "c": 1.9, "Ff": 0.28}, {"noise_relative": 4e-4, "seed": 1}
    test = simulated("k*x + k5*x**5 + c*v + Ff*sign(v)", true, [1.2, 3, 7, 12], (18, 31, 14), 1.37, **how)
    # no new derivatives for steps without end
    monkeypatch.setattr(Simulator, "renew", None)
    slips = rs.Law("masing(Min(kt*x, Fs))"), rs.laws["jenkins"]
    user, library = (identify(test, law + "k*x + k5*x**5 + c*v", mass=1.37) for law in slips)
    assert [finding.code for finding in user.verdict.decided_by] == ["not-converged"]
    assert user.values == library.values
    assert not any(np.isfinite(estimate.interval).any() for estimate in user)


@pytest.mark.parametrize(("kt", "noise"), [(2e5, 1e-3), (5e6, 1e-4)])
def test_a_slider_that_sticks_at_the_lowest_level_is_found(kt, noise):
    """It rests where it came to a stop, and slips within a ten-thousandth of the largest motion."""
    named, how = {"k": 6e4, "c": 5.09, "kt": kt, "Fs": 4.4}, {"noise_relative": noise, "seed": 1}
    law = "k*x + c*v + masing(Min(kt*x, Fs))"
    found = identify(simulated(law, named, [3, 5, 8, 12], (24, 38, 14), 1.92, **how), law, mass=1.92)
    assert found.verdict.state == "identified"
    for name, value in named.items():
        assert found[name].interval[0] < value < found[name].interval[1]


def test_a_profile_follows_values_that_go_together():
    # with another Fs the stiffness of the slider, the spring and the motions near the resonance are others
    law, values = "k*x + c*v + masing(Min(kt*x, Fs))", {"k": 4967.0, "c": 1.0925, "kt": 993.4, "Fs": 0.06644}
    levels, how = np.linspace(0.2, 1, 6) * 0.0157, {"noise_relative": 0.03, "seed": 6104}
    found = identify(simulated(law, values, levels, (7.07, 12.43, 15), 1.323, **how), law)
    assert {e.name for e in found if e.by_profile} == {"Fs", "k", "kt"}
    for estimate in found:
        if estimate.by_profile:
            assert np.isfinite(estimate.interval).all()
            assert estimate.interval[0] < values[estimate.name] < estimate.interval[1]
    one = profile(found, "Fs")
    assert not np.isfinite(one.followed).any()
    assert len(one.values) < 14


def test_a_fit_that_did_not_converge_states_no_interval(monkeypatch):
    """Errors by the slopes, and shifts by alternatives, are those of the least sum of squares."""
    descend = least_squares.descend
    monkeypatch.setattr(least_squares, "descend", lambda *given: (*descend(*given)[:3], False))
    monkeypatch.setattr(least_squares, "_agreeing", lambda *given: given[2] & (np.arange(len(given[2])) > 11))
    values = {"k": 5920.0, "c": 2.0, "k3": 2e6}
    test = simulated(CUBIC, values, [1.0, 4.0], (8.5, 12, 20), noise_relative=1e-2)
    found = identify(test, "k*x + c*v + c3*v**3")
    assert "not-converged" in codes(found)
    left = [finding for finding in found.findings if finding.code == "points-excluded"]
    assert [(finding.severity, finding.names["unsettled"]) for finding in left] == [("warning", "yes")] * 2
    assert found.outcome["identified"] == 0
    assert not found["c3"].finding.numbers
    for estimate in found:
        assert np.isfinite(estimate.value)
        assert estimate.interval == (-np.inf, np.inf)
        assert estimate.standard_error == np.inf
    assert np.isnan(found.covariance).all()
    curve = rs.predict(found, 2.0)[2.0]
    assert np.isfinite(curve.amplitude).any()
    assert np.isnan([curve.lower, curve.upper]).all()
    assert not any("±" in row[5].note for row in estimate_table(found).rows)


@pytest.mark.usefixtures("not_simulated")
def test_values_that_more_harmonics_do_not_settle_have_no_interval(monkeypatch):
    """So it is with the power of Bouc and Wen's law of a Jenkins joint, whose counterpart is infinite."""
    module = sys.modules["rsgen.identification.identify"]
    fit_balance, steps = module.fit_balance, list[int | None]()

    def unsettled(*given, order, **options):
        found = fit_balance(*given, order=order, **options)
        if order == BALANCE_HARMONICS:
            return found
        steps.append(options.get("steps"))
        values = 1.5 * found.regression.parameters
        return replace(found, regression=replace(found.regression, parameters=values, converged=False))

    monkeypatch.setattr(module, "fit_balance", unsettled)
    found = identify(small_joint("jenkins", 0.01), joint_law("jenkins"))
    assert "not-converged" in codes(found)
    assert all(estimate.interval == (-np.inf, np.inf) for estimate in found)
    assert steps == [NEAR_STEPS]


@pytest.mark.usefixtures("not_simulated")
def test_what_a_law_misses_is_no_likelihood():
    values = {"k": 6000.0, "c": 4.0, "kt": 1500.0, "Fs": 0.8, "Ff": 0.2}
    surface = gauged("k*x + c*v + masing(Min(kt*x, Fs)) + Ff*sign(v)", values, [1.0, 2.0, 4.0, 8.0], 1)
    found = identify(surface, "k*x + c*v + masing(Min(kt*x, Fs))", mass=1.8)
    assert found.verdict.state == "doubtful"
    assert not any(estimate.by_profile for estimate in found.refined)


M = 1.5


def curve(stiffness, damping=lambda V: 3.8, points: int = 1200, noise: float = 0.0) -> EquivalentCurve:
    """Points of given k(X) and c(V) over a test."""
    generator = np.random.default_rng(1)
    size = generator.uniform(5e-4, 0.03, points)
    omega = 2 * np.pi * generator.uniform(8, 12, points)
    k, c = stiffness(size) * np.ones(points), damping(omega * size) * np.ones(points)
    k = k + noise * np.abs(k - M * omega**2 + 1j * omega * c) * generator.normal(size=points)
    return EquivalentCurve(size, omega / 2 / np.pi, np.ones(points), k, c, np.ones(points, dtype=bool))


def gap(X):
    # twice the root of the printed Eq. (20), see docs/method.md, 2
    s = np.minimum(0.01 / X, 1)
    return 8000 - 2080 / np.pi * (2 * np.arcsin(s) + 2 * s * np.sqrt(1 - s**2))


@pytest.mark.slow
@pytest.mark.parametrize(("stiffness", "spring", "off"), [
    (lambda X: 5920, lambda x: 5920 * x, 1e-4),
    (lambda X: 5920 + 0.75 * 1e6 * X**2, lambda x: 5920 * x + 1e6 * x**3, 1e-4),
    (lambda X: 5920 + 8 * 4e4 * X / (3 * np.pi), lambda x: 5920 * x + 4e4 * x * np.abs(x), 1e-4),
    # what a corner leaves in a spline
    (gap, lambda x: np.where(x < 0.01, 5920 * x, 8000 * x - 20.8), 1e-2),
], ids=["linear", "cubic", "quadratic", "gap"])  # fmt: skip
def test_springs_come_back(stiffness, spring, off):
    found = invert_curve(curve(stiffness), M)
    exact = spring(found.displacement)
    assert np.abs(found.stiffness_force - exact).max() < off * exact.max()


@pytest.mark.parametrize("sparse", [False, True])
def test_bands_hold_the_force(sparse):
    points = curve(lambda X: 5920 + 0.75 * 1e6 * X**2, noise=0.01)
    # levels that jump leave few amplitudes above those off resonance
    kept = (points.amplitude < 0.4 * points.amplitude.max()) | (np.arange(len(points.amplitude)) % 40 == 0)
    found = invert_curve(replace(points, used=kept) if sparse else points, M)
    exact = 5920 * found.displacement + 1e6 * found.displacement**3
    inside = np.abs(found.stiffness_force - exact)[1:] <= found.stiffness_band[1:]
    assert inside.mean() > 0.8  # neighbouring points share their errors
    assert found.stiffness_band[1:].max() < 0.05 * exact.max()


def test_points_count_by_the_force_that_held_them():
    # one stiffness at resonance and another off it, both at all amplitudes: their mean, weighted by 1/F^2
    size, k, c = np.tile(np.linspace(1e-3, 0.02, 200), 2), np.array([6000.0, 6300.0]), 4.0
    omega = np.sqrt(k[0] / M) * np.array([1.0, 1.02])
    weight = 1 / np.hypot(k - M * omega**2, omega * c) ** 2
    stiffness, frequency, used = np.repeat(k, 200), np.repeat(omega, 200) / 2 / np.pi, np.full(400, True)
    found = invert_curve(EquivalentCurve(size, frequency, size, stiffness, np.full(400, c), used), M)
    mean = float(np.sum(k * weight) / np.sum(weight))
    assert found.stiffness_force == pytest.approx(mean * found.displacement, rel=1e-6)
