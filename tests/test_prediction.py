import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from rsgen import Law, ResponseSurface, RsgenError, SimulatedTest, identify, sentence, simulate
from rsgen.common.finding import Finding, Quantity
from rsgen.data.history import SweepLaw, TimeHistory, from_free_decay, from_swept_sine
from rsgen.data.oscillator import Model, Observation, Oscillator
from rsgen.describing.derivation import derive
from rsgen.figures import draw_responses
from rsgen.identification.identify import _with_held_out
from rsgen.identification.prediction import HeldOutLevel, Prediction, predict
from rsgen.identification.prediction.amplitude_balance import balance_of
from rsgen.identification.prediction.prediction_result import known_beyond, largest_of_curve
from rsgen.identification.prediction.resonance_curves import predict_held_out, predict_shown
from rsgen.identification.resonance import as_identification
from rsgen.law.motion import Motion, sine_motion
from rsgen.law.numeric import compile_law
from rsgen.report.figures.equivalent import dissipated_energy, measured_energy, mode_surface
from tests.oracles.swept import sweep
from tests.surfaces import LAWS, changed, codes, joined, model, noisy, surface
from tests.virtual import fundamentals, multisine, only, simulated

EXACT = 1e-5
"""Predicted from exact data with all harmonics; what is left is the identification's own error."""

CUBIC, STIFF = "k*x + k3*x**3 + c*v", {"k": 2e4, "k3": 5e9, "c": 4.0}
BETWEEN = 1e-4
"""A spline through the points of a curve, whose spacing is a few percent, between them."""


@pytest.fixture(scope="module")
def quintic():
    table = surface("quintic", levels=np.array([2.0, 4, 6, 8, 10, 12, 14]))
    found = identify(table, model("quintic", hold_out=(6.0, 10.0)))
    return table, predict(found, surface=table)


@pytest.mark.parametrize(("gain", "expected"), [(1.0, []), (1.03, ["warning"])])
def test_an_error_that_noise_and_values_do_not_explain_is_found(gain, expected):
    table = noisy(surface("coulomb"), 5e-3, 1)
    table = changed(table, force=table.force * np.where(table.level == 4.0, gain, 1.0))
    found = identify(table, model("coulomb", hold_out=(4.0,)))
    assert found.held_out[0].error < 0.05
    assert [f.severity for f in found.findings if f.code == "held-out-missed"] == expected


def test_the_error_of_a_law_that_misses_is_not_explained_by_its_widened_intervals():
    found = identify(surface("combined"), CUBIC, Observation(hold_out=(2.0,)))
    assert np.isnan(found.held_out[0].explained)
    assert only(found, "held-out-missed").severity == "doubt"


def test_a_held_out_sweep_is_compared_by_its_force_where_it_falls_through_an_unstable_branch():
    structure = Oscillator(1.5, CUBIC, {"k": 5920.0, "k3": 4e6, "c": 3.0})
    run = SweepLaw("linear", 8.0, 0.1), 16.0, 400.0
    swept = from_swept_sine([sweep(structure, force, *run) for force in (1, 2, 4)])
    (item,) = identify(swept, CUBIC, Observation(hold_out=(2.0,))).held_out
    assert item.missing == 0
    assert item.error < 5e-3


@pytest.mark.parametrize(("wrong", "severities"), [(1, []), (8, ["error"])])
def test_the_error_that_is_stated_is_the_one_that_is_judged(wrong, severities):
    # one point of 41 on another branch is near a jump, eight are not
    table = noisy(surface("cubic"), 0.01, 1)
    rows = np.flatnonzero(table.level == table.levels[2])
    rows = rows[np.argsort(-table.amplitude[rows])][:wrong]
    harmonics = np.array(table.harmonics)
    harmonics[rows] *= -1
    table = changed(table, harmonics=harmonics)
    found = identify(table, model("cubic", hold_out=(float(table.levels[2]),)))
    (item,) = found.held_out
    assert item.missing == wrong
    assert (item.error < 2 * found.residual) is (not severities)
    missed = [finding for finding in found.findings if finding.code == "held-out-missed"]
    assert [(one.severity, one["error"]) for one in missed] == [(one, item.error) for one in severities]


def test_curves_pass_through_the_measured_points(quintic):
    table, prediction = quintic
    for curve in prediction:
        # below the resonance, and below the fold where there is one, the amplitude is a function
        top = curve.frequency[np.nanargmax(curve.amplitude)]
        end = float(np.min(curve.folds[:, 0], initial=top))
        first_side = np.arange(len(curve.frequency)) < 161
        left = np.flatnonzero((curve.frequency < end) & curve.stable & first_side)
        order = left[np.argsort(curve.frequency[left])]
        along = CubicSpline(curve.frequency[order], np.log(curve.amplitude[order]))
        low, high = curve.frequency[order[[0, -1]]]
        inside = (table.frequency > low) & (table.frequency < high)
        rows = np.flatnonzero((table.level == curve.level) & table.settled & inside)
        assert len(rows) > 5
        np.testing.assert_allclose(np.exp(along(table.frequency[rows])), table.amplitude[rows], rtol=BETWEEN)


def test_extrapolation_is_marked(quintic):
    table, _ = quintic
    found = identify(table, model("quintic"))
    prediction = predict(found, [1.0, 60.0])
    inside, beyond = prediction.curves
    assert beyond.extrapolated.any()
    assert not inside.extrapolated[inside.amplitude > found.amplitude_range[0]].any()
    assert [(one.code, one["level"]) for one in prediction.findings] == [("prediction-extrapolated", 60.0)]
    # a level between two tested ones is interpolated, though the flanks of its curve lie below all points
    assert inside.extrapolated.any()
    assert [row[-1] for row in prediction.table.rows] == ["no", "yes"]


def test_frequencies_far_from_the_tested_ones_are_extrapolated():
    table = surface("cubic")
    found = identify(table, model("cubic"))
    low, high = found.frequency_range
    curve, predicted = (predict(found, [3.0], band=band) for band in ((low, high), (0.5 * low, 2 * high)))
    (wide,), far = predicted.curves, lambda one: (one.frequency < 0.9 * low) | (one.frequency > 1.1 * high)
    assert far(wide).sum() > 10
    assert wide.extrapolated[far(wide)].all()
    assert not wide.extrapolated[np.argmax(wide.amplitude)]
    assert curve.findings == ()
    assert [(said["low"], said["high"]) for said in predicted.findings] == [(low, high)]


def test_of_a_held_out_level_beyond_those_fitted_the_score_is_said():
    table = noisy(surface("cubic"), 0.01, 1)
    highest = float(table.levels[-1])
    found = identify(table, model("cubic", hold_out=(highest,)))
    for predicted in (predict(found, surface=table), predict(found)):
        assert only(predicted, "prediction-extrapolated")["error"] == found.held_out[0].error
    # up to the motion of the held-out level the law is known by its score
    (between,) = predict(found, [0.9 * highest]).findings
    assert (between["held"], between["error"]) == (highest, found.held_out[0].error)
    (beyond,) = predict(found, [2 * highest]).findings
    assert "error" not in beyond.numbers


@pytest.mark.parametrize(("sweep", "band", "by"), [
    ("rest", (9.6, 12.4), "jump"), ("rest", (9.6, 10.9), "jump"), ("up", (9.6, 12.4), ""),
    ("rest", (9.6, 9.9), "end"), ("up", (9.6, 10.9), "end"), ("both", (9.6, 10.9), "end"),
])  # fmt: skip
def test_a_sweep_that_does_not_reach_its_resonance_is_named(sweep: str, band: tuple[float, float], by: str):
    truth = Oscillator(1.5, "k*x + c*v + kn*x**3", {"k": 5920.0, "c": 3.8, "kn": 3e6})
    ways = ("up", "down") if sweep == "both" else (sweep,)
    runs = [
        # points of a sweep down, which are low, lie between those of a sweep up
        simulate(truth, SimulatedTest([1.0, 4.0, 8.0], np.linspace(*band, 57) + 0.01 * shift, sweep=way))
        for shift, way in enumerate(ways)
    ]
    found = identify(joined(*runs), truth.force)
    findings = [f for f in predict(found).findings if f.code == "prediction-extrapolated"]
    assert [finding.names["by"] for finding in findings] == ([by] if by else [])
    for finding in findings:
        # the peak is that of the law, whatever band is asked for
        bands = (None, (9.0, band[1]), (8.0, 14.0))
        narrow, cut, wide = (predict(found, [finding["level"]], band=asked) for asked in bands)
        peak = wide.curves[0].largest
        for again in (finding, cut.findings[0], wide.findings[0]):
            assert again.names == finding.names
            assert (again["frequency"], again["peak"]) == pytest.approx(peak[:2], rel=1e-3)
        assert finding["high"] == pytest.approx(found.amplitude_range[1])
        assert finding["peak"] > 1.1 * finding["measured"]
        assert narrow.curves[0].rises_at_end is (band[1] < 12.0)


@pytest.mark.parametrize(("k", "c", "m"), [(5920.0, 3.8, 1.5), (1e9, 40.0, 1e-3), (0.1, 0.1, 100.0)])
def test_the_curve_of_a_linear_oscillator_holds_its_resonance(k, c, m):
    curves = predict(Oscillator(m, "k*x + c*v", {"k": k, "c": c}), levels=[0.5, 2.0])
    for curve in curves:
        omega = 2 * np.pi * curve.frequency
        exact = curve.level / np.abs(k - m * omega**2 + 1j * c * omega)
        assert curve.amplitude == pytest.approx(exact, rel=1e-6)
        top = curve.level / (c * np.sqrt(k / m - (c / 2 / m) ** 2))
        assert np.nanmax(curve.amplitude) == pytest.approx(top, rel=2e-5)
        assert np.nanmin(curve.amplitude) < 0.2 * top
    assert curves[2.0] is curves.curves[1]
    assert len(curves.findings) == 0


@pytest.mark.parametrize("band", [(14.0, 18.0), (14.0, 14.2), (16.5, 40.0)])
def test_a_curve_in_a_narrow_band_reaches_both_its_edges(band: tuple[float, float]):
    gap = "k0*x + kg*(Max(0, x - b) + Min(0, x + b)) + c*v", {"k0": 9400.0, "kg": 21e3, "b": 6e-4, "c": 2.1}
    predicted = predict(Oscillator(0.82, *gap), [3.818], band=band)
    curve = predicted.curves[0]
    exact = simulate(Oscillator(0.82, *gap), SimulatedTest([3.818], np.array(band)))
    assert curve.frequency[[0, -1]] == pytest.approx(band)
    assert curve.amplitude[[0, -1]] == pytest.approx(exact.amplitude, rel=1e-3)
    assert codes(predicted) == set()


RUBBING = "k*x + c*v + Ff*sign(v)", {"k": 6e3, "c": 2.0, "Ff": 0.5}


def test_a_level_at_which_friction_holds_the_mass_is_a_finding():
    stuck = predict(Oscillator(1.0, "k*x + c*v + Ff*sign(v)", {"k": 1e4, "c": 1.0, "Ff": 10.0}), [1, 11, 20])
    said = [(found.code, found["level"], found.names.get("by")) for found in stuck.findings]
    assert said == [("no-steady-state", 1.0, "rest"), ("no-steady-state", 11.0, None)]
    # 4/pi of the friction
    assert stuck.findings[0]["least"] == pytest.approx(12.73, rel=1e-3)


@pytest.mark.parametrize("mass", [None, 1.5])
def test_friction_that_holds_the_mass_is_said_per_unit_mass_and_of_levels_asked_for_too(mass):
    table = simulated(*RUBBING, [1.0, 2.0], (9, 11, 31), base="acceleration")
    found = identify(table, RUBBING[0], Observation(predict=(0.2,)), mass=mass)
    for by in (found, predict(found, [0.2, 1.5])):
        said = only(by, "no-steady-state")
        assert (said["level"], said.numbers["friction"].unit) == (0.2, "m/s^2")
        assert said["friction"] == pytest.approx(0.5 / 1.5, rel=1e-3)
        assert (said.names["by"], said.numbers["least"].unit) == ("rest", "m/s^2")


def test_a_curve_just_above_sticking_says_how_far_the_motion_in_time_is_from_its_peak():
    rig = Oscillator(1.5, *RUBBING)
    curves = predict(rig, [0.65, 0.9], band=(9.6, 10.4))
    said = only(curves, "no-steady-state")
    assert (said["level"], said["highest"]) == (0.65, np.nanmax(curves[0.65].amplitude))
    exact = simulate(rig, SimulatedTest([0.65], said["frequency"] - np.array([0.1, 0.0])))
    assert said["exact"] == pytest.approx(np.abs(exact.harmonics[-1, 1]), rel=1e-3)
    assert said["exact"] > 1.15 * said["highest"]


def test_levels_of_a_driven_base_are_accelerations_and_its_energy_is_that_of_its_law_with_a_mass_too():
    table = simulated(CUBIC, STIFF, [0.02, 0.05], (15.2, 16.8, 33), 2.0, base="acceleration")
    heights = []
    for mass in (None, 2.0):
        found = identify(table, CUBIC, mass=mass)
        for asked in (None, [0.04]):
            curves = predict(found, asked, table).curves
            named = [(round(one.level, 9), one.level_unit) for one in curves]
            assert named == [(level, "m/s^2") for level in asked or [0.02, 0.05]]
            heights += [np.nanmax(one.amplitude) for one in curves]
        measured, law = measured_energy(mode_surface(table, found)), dissipated_energy(found)
        assert measured.energy.size
        # measured up to a half width, a hundredth, from the resonance: pi omega c X^2 is as far off
        expected = np.interp(measured.amplitude, law.amplitude, law.energy)
        np.testing.assert_allclose(measured.energy, expected, rtol=0.01)
    np.testing.assert_allclose(heights[3:], heights[:3], rtol=EXACT)


def test_held_amplitudes_are_predicted_on_unstable_branches_too():
    # a force near a fold determines no amplitude
    hardening = Oscillator(1.5, CUBIC, {"k": 5920.0, "k3": 3e5, "c": 6.0})
    test = SimulatedTest(np.linspace(0.02, 0.06, 9), [9, 10, 11, 12], control="continuation")
    table = simulate(hardening, test)
    assert not table.stable[table.level == table.levels[-2]].all()
    found = identify(table, Model(hardening.elements, None, Observation(hold_out=(table.levels[-2],))))
    (item,) = predict(found, surface=table).held_out
    assert item.error < EXACT
    assert item.missing == 0


def test_a_point_near_a_fold_is_predicted_on_its_own_branch():
    # with noise it lies below the unstable branch, which is about 1 % below the stable one there
    values = {"k": 9e3, "k5": 1.5e13, "c": 1.9, "cq": 2.0}
    truth = Oscillator(0.8, "k*x + k5*x**5 + c*v + cq*v*abs(v)", values)
    table = simulate(truth, SimulatedTest([2.0], np.linspace(14.0, 21.5, 151), sweep="up"))
    table = table.select(np.flatnonzero(table.settled & (table.amplitude > 4e-3)))
    lower = replace(table, harmonics=0.965 * table.harmonics)
    predicted = balance_of(as_identification(truth, [2.0])).respond(lower)
    assert len(table) > 20
    assert np.abs(predicted) == pytest.approx(table.amplitude, rel=2e-3)


@pytest.mark.parametrize(("law", "levels"), [("quintic", [8.0, 14.0]), ("two-gaps", [6.0, 12.0])])
def test_folds_lie_where_the_frequency_turns(law, levels):
    # along a curve the frequency is extreme at a fold, also between its points
    truth = Oscillator(1.5, LAWS[law][0], {**LAWS[law][1], "c": 2.0})
    balance, folds = balance_of(as_identification(truth, levels)), 0
    for curve in predict(truth, levels):
        assert len(np.flatnonzero(np.diff(curve.stable.astype(int)))) == len(curve.folds)
        for frequency, amplitude, _ in curve.folds:
            reach = min(0.02 * amplitude, (curve.largest[1] - amplitude) / 2)
            sizes = amplitude + np.linspace(-1, 1, 401) * reach
            sides = [balance.frequencies(sizes, curve.force, side)[0] / (2 * np.pi) for side in (-1, 1)]
            side = min(sides, key=lambda found: abs(found[200] - frequency))
            turn = side[np.argmax(np.abs(side - side[[0, -1]].mean()))]
            assert frequency == pytest.approx(turn, rel=1e-6)
            folds += 1
    assert folds >= 4


LINEAR = {"k": 5920.0, "kn": 0.0, "c": 3.8}


def test_a_band_is_the_slope_of_the_amplitude_times_the_error():
    # |X| = F/|D|, D = k - m omega^2 + i omega c: by k dX = -X Re(D)/|D|^2, by c -X omega Im(D)/|D|^2;
    # the errors of both go together
    found = identify(surface("cubic", values=LINEAR), Model("k*x + c*v"))
    assert [e.name for e in found.refined] == ["c", "k", "m"]
    error = np.array([0.1, 8.0, 0.0])
    covariance = np.outer(error, error) * np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.0], [0.0, 0.0, 0.0]])
    curve = predict(replace(found, covariance=covariance), [5.0]).curves[0]
    omega = 2 * np.pi * curve.frequency
    dynamic = 5920 - 1.5 * omega**2 + 3.8j * omega
    size = curve.amplitude / np.abs(dynamic) ** 2
    slope = np.stack([omega * dynamic.imag, dynamic.real], axis=1) * size[:, None]
    half = 1.96 * np.sqrt(np.einsum("np,pq,nq->n", slope, covariance[:2, :2], slope))
    shown = np.isfinite(curve.upper) & np.isfinite(curve.lower)
    assert np.count_nonzero(shown) > 50
    assert ((curve.upper - curve.lower) / 2)[shown] == pytest.approx(half[shown], rel=1e-3, abs=1e-9)


def test_a_curve_has_the_phase_error_of_the_test_once():
    linear, psi = surface("cubic", values=LINEAR), 0.3
    seen = changed(linear, force=linear.force * np.exp(-1j * psi))
    found = identify(seen, Model("k*x + c*v"), Observation(background="phase"))
    curve = predict(found, [5.0]).curves[0]
    omega = 2 * np.pi * curve.frequency
    lag = np.angle(5920 - 1.5 * omega**2 + 3.8j * omega) - psi
    assert np.abs(np.exp(1j * (curve.phase - lag)) - 1).max() < 1e-3


@pytest.mark.parametrize("kind", ["jump", "outlier"])
def test_a_point_that_jumps_late_is_named_and_no_warning(kind):
    values = {"k": 2e4, "k3": 3e9, "c": 12.0}
    test = simulated(CUBIC, values, [1.0, 2.0, 3.0], (13, 22, 46), 2.0, noise_relative=0.005, sweep="up")
    harmonics, rows = test.harmonics.copy(), np.flatnonzero(test.level == 3.0)
    last = rows[np.argmax(-np.diff(np.abs(harmonics[rows, 1])))]
    # beyond its fold, or off on both sides
    row = last + 1 if kind == "jump" else last - 8
    harmonics[row] = 1.03 * harmonics[last] if kind == "jump" else 2 * harmonics[row]
    test, at = replace(test, harmonics=harmonics), f"(3 N at {test.frequency[row]:.5g} Hz)"
    all_fitted = only(identify(test, CUBIC), "points-excluded")
    held = identify(test, CUBIC, Observation(hold_out=(3.0,)))
    missing = only(held, "held-out-points-missing")
    assert {all_fitted.severity, missing.severity} == {"info" if kind == "jump" else "warning"}
    assert f"1 of 138 points {at} were excluded" in sentence(all_fitted)
    assert (f"lie at a jump {at}" in sentence(missing)) == (kind == "jump")
    assert held.held_out[0].error < 0.01


@pytest.mark.parametrize("base", ["", "acceleration"])
def test_a_level_that_was_not_tested_is_predicted_where_the_observation_asks(base):
    asked, values, how = 0.6, STIFF | {"c": 8.0}, {"base": base or None}
    table = simulated(CUBIC, values, [0.4, 0.8], (13, 22, 40), 2.0, method="harmonic-balance", **how)
    found = identify(table, CUBIC, Observation(predict=(asked,)))
    said = only(found, "level-predicted")
    assert said not in predict_shown(table, found).findings
    at, largest = predict(found, [asked], table)[asked].largest[:2]
    assert (said["level"], said["amplitude"], said["at"]) == pytest.approx((asked, largest, at))
    assert said["low"] < largest < said["high"]
    assert said.names.get("base", "") == base
    # a level whose name is 3 % more than what was measured is not that level
    renamed = replace(table, level=1.03 * table.level)
    found = identify(renamed, CUBIC, Observation(predict=(0.824,)))
    (other,) = (one for one in found.findings if one.names.get("by") == "name")
    assert (other["level"], other["tested"]) == (0.824, pytest.approx(0.8, rel=1e-3))
    assert other in predict(found, 0.824).findings
    assert not [one for one in predict(found).findings if one.names.get("by") == "name"]
    own = simulated(CUBIC, values, [asked], (13, at, 80), 2.0, sweep="up", **how)
    assert largest == pytest.approx(own.amplitude.max(), rel=2e-2)


def test_of_a_curve_that_the_band_cuts_the_largest_amplitude_is_not_stated():
    values = {"k": 8800.0, "c": 2.0, "k3": 2.2e8}
    table = simulated(CUBIC, values, [0.1, 0.2], (18, 20, 41), 0.62, method="harmonic-balance")
    found = identify(table, CUBIC, Observation(predict=(3.0,)))
    said = only(found, "level-predicted")
    # nor is a pickled law, which has no fit, taken for a table
    prediction = predict(pickle.loads(pickle.dumps(found)), [3.0])
    assert prediction[3.0].rises_at_end
    assert only(prediction, "prediction-extrapolated").names.get("by") != "table"
    inside = {"inside", "inside_low", "inside_high", "inside_at"}
    assert set(said.numbers) == {"level", "at", "reached"} | inside
    assert said["inside_low"] < said["inside"] < said["inside_high"]
    assert said["inside"] < said["reached"]
    # the curve rises up to the end of the band
    assert said["inside_at"] == pytest.approx(20, rel=1e-9)
    assert said["at"] > 20


STOP = Oscillator(1.2, "k*x + c*v + ks*Max(x - g, 0)", {"k": 2e4, "c": 3.0, "ks": 2e5, "g": 1e-4})


def true_multipliers(omega, force, start):
    """Integrate a motion next to the stop and its equations of variation; refine its start."""

    def rates(t, state):
        x, v, *near = state
        spring = 2e4 * x + 2e5 * max(x - 1e-4, 0)
        slope = np.array([[0, 1], [-(2e4 + 2e5 * (x > 1e-4)) / 1.2, -3 / 1.2]])
        return [
            v,
            (force * np.cos(omega * t) - spring - 3 * v) / 1.2,
            *(slope @ np.reshape(near, (2, 2))).flat,
        ]

    period = 2 * np.pi / omega
    for _ in range(6):
        run = solve_ivp(
            rates, (0, period), [*start, 1, 0, 0, 1], rtol=1e-9, atol=1e-13, max_step=period / 300
        )
        end = run.y[:, -1]
        change = end[2:].reshape(2, 2)
        start = start + np.linalg.solve(change - np.eye(2), start - end[:2])
    turn = np.exp(-1j * omega * run.t)
    return np.linalg.eigvals(change), 2 * abs(np.trapezoid(run.y[0] * turn, run.t)) / period


def test_where_the_period_doubles_next_to_a_stop_the_curve_is_unstable():
    prediction = predict(STOP, [1.0, 8.0, 16.0], band=(35.0, 90.0))
    curve = prediction[16.0]
    balance = balance_of(as_identification(STOP, [16.0]))
    lost = np.flatnonzero(np.abs(curve.multiplier) > 1)
    seen = []
    for place in (lost[0] - 1, *lost, lost[-1] + 1):
        omega = 2 * np.pi * curve.frequency[place : place + 1]
        at = balance.solve(curve.amplitude[place : place + 1], omega)
        motion = at.motion(omega).turned(-np.angle(at.force))
        found, amplitude = true_multipliers(omega[0], 16.0, motion.states()[0])
        assert abs(amplitude / curve.amplitude[place] - 1) < 1e-3  # harmonics of the balance are finite
        known = curve.multiplier[place]
        # corners of the law between 256 samples, where the motion lasts
        assert np.abs(found - known).min() < 0.03 or np.abs(found - known.conjugate()).min() < 0.03
        assert curve.stable[place] == (np.abs(found).max() < 1)
        seen.append(found.real.min())
    assert min(seen) < -1.4
    assert list(prediction[1.0].stable) == list(np.abs(prediction[1.0].multiplier) < 1)
    said = only(prediction, "motion-does-not-last")
    assert (said["level"], said["levels"], said.names["by"]) == (16.0, 2, "period")
    # between the points of the curve it is not known where
    at = [curve.frequency[place] for place in (*lost[[0, -1]], lost[0] - 1, lost[-1] + 1)]
    assert said.names["where"] == "{:.4g} to {:.4g} Hz (at most {:.4g} to {:.4g})".format(*at)


@pytest.mark.parametrize(("structure", "level", "band"), [
    (Oscillator(2.48, "k*x + k2*x**2 + k3*x**3 + c*v", {"k": 98e3, "k2": -1.3e7, "k3": 2.2e9, "c": 25.0}),
     9.0, (26.0, 36.0)),
    (Oscillator(1.2, RUBBING[0], {"k": 2e4, "c": 30.0, "Ff": 0.2}), 0.6, None),
])  # fmt: skip
def test_the_travel_at_the_largest_amplitude_is_that_of_the_motion_in_time(structure, level, band):
    """Next to friction, whose balance has three harmonics, it was 0.12 % off, and the acceleration 9 %."""
    curve = predict(structure, [level], band=band)[level]
    omega = 2 * np.pi * np.array([curve.largest[0]])
    steady = simulate(structure, SimulatedTest([level], [curve.largest[0]], method="time", harmonics=64))
    motion, law = Motion(omega, steady.harmonics), compile_law(structure.force)
    x, _, _ = motion.waveforms(4096)
    inner = law.along(motion, law.ordered(structure.values), 4096).force
    drive, _, _ = sine_motion(omega, steady.force).waveforms(4096)
    np.testing.assert_allclose(curve.travel, (x.min(), x.max()), rtol=5e-5)
    assert curve.acceleration == pytest.approx(np.abs(drive - inner).max() / structure.mass, rel=1e-3)
    assert np.ptp(curve.travel_interval[:2]) == np.ptp(curve.acceleration_interval) == 0


def test_the_acceleration_of_a_driven_base_is_the_absolute_one():
    table = simulated("k*x + c*v", {"k": 2e4, "c": 80.0}, [1.0, 2.0], (10, 25, 61), 2.0, base="acceleration")
    found = identify(table, "k*x + c*v")
    curve = predict(found, [3.0])[3.0]
    omega, per_mass = 2 * np.pi * curve.largest[0], 2e4 / 2.0 + 40j * (2 * np.pi * curve.largest[0])
    absolute = 3.0 * abs(per_mass / (per_mass - omega**2))
    assert absolute > 1.05 * omega**2 * curve.largest[1]
    assert curve.acceleration == pytest.approx(absolute, rel=1e-3)


@pytest.mark.parametrize(("law", "values", "level"), [
    ("k*x + c*v + masing(Min(kt*x, Fs))", {"k": 30004.0, "c": 4.989, "kt": 13990.0, "Fs": 1.9959}, 1.5),
    ("k*x + c*v + c2*v*abs(v)", {"k": 6000.0, "c": 4.0, "c2": 40.0}, 10.0),
])  # fmt: skip
def test_a_curve_is_closed_over_its_peak_however_the_loss_depends_on_frequency(law, values, level):
    oscillator = Oscillator(1.2998, law, values)
    curve = predict(oscillator, [level])[level]
    assert not curve.rises_at_end
    top = int(np.nanargmax(curve.amplitude))
    assert np.isfinite(curve.frequency[top - 5 : top + 6]).all()
    function, omega = derive(oscillator.force), 2 * np.pi * np.linspace(0.9, 1.1, 4001) * curve.frequency[top]

    def least(amplitude: float) -> float:
        first = function.evaluate(np.full(4001, amplitude), omega, values)
        force = amplitude * (first.stiffness - 1.2998 * omega**2 + 1j * omega * first.damping)
        return abs(force).min() - level

    peak = brentq(least, 0.9 * curve.amplitude[top], 1.1 * curve.amplitude[top])
    assert curve.amplitude[top] == pytest.approx(peak, rel=2e-3)


def test_a_hardening_spring_keeps_its_stable_points_and_an_even_force_at_twice_its_frequency_does_not():
    values = {"k": 2e4, "c": 3.0, "k3": 1e9}
    hard = predict(Oscillator(1.2, CUBIC, values), [1.0, 16.0])
    for curve in hard.curves:
        assert not curve.lost
        # the least multiplier of a linear one: all of both signs lie on a circle
        assert np.nanmax(np.abs(curve.multiplier)) < 1
    even = Oscillator(1.2, f"{CUBIC} + k2*x**2", values | {"k2": 1e7, "k3": 1e10})
    assert predict(even, [16.0], band=(35.0, 90.0))[16.0].lost["by"] == "period"
    friction = predict(Oscillator(1.2, RUBBING[0], {"k": 2e4, "c": 3.0, "Ff": 0.2}), [4.0])
    assert np.isnan(friction[4.0].multiplier).all()
    # only folds were looked for, and the sentence says so
    stated = [largest_of_curve(one[4.0], "", (0.0, np.inf)).names for one in (friction, predict(even, [4.0]))]
    assert [names.get("stability", "") for names in stated] == ["folds", ""]


@pytest.mark.parametrize(("k3", "peak_jumps"), [(2e7, "up"), (-2e7, "down")])
def test_a_jump_has_the_direction_of_the_sweep_in_which_it_is(k3, peak_jumps):
    stiff = Oscillator(1.5, f"{CUBIC} + k5*x**5", {"k": 6000.0, "k3": k3, "k5": 1e11, "c": 1.0})
    curve = predict(stiff, [0.3], band=(7, 13))[0.3]
    low, high = sorted(curve.folds[:, 0])
    expected = [(low, (low, low), "down"), (high, (high, high), "up")]
    assert [(jump.frequency, jump.interval, jump.sweep) for jump in curve.jumps] == expected
    assert max(curve.jumps, key=lambda jump: jump.amplitude).sweep == peak_jumps
    for jump in curve.jumps:
        # another stable motion at that frequency
        flanks = np.flatnonzero(np.diff(np.sign(curve.frequency - jump.frequency)) * curve.stable[1:])
        low_end, high_end = np.sort(curve.amplitude[[flanks, flanks + 1]], axis=0)
        assert ((low_end < jump.landing) & (jump.landing < high_end)).any()
        assert abs(jump.landing / jump.amplitude - 1) > 0.5


def test_jumps_and_the_largest_amplitude_have_the_intervals_that_the_values_give():
    level, values = 0.3, {"k": 6000.0, "k3": 2e7, "c": 1.0}
    known = as_identification(Oscillator(1.5, CUBIC, values), [level])
    off = np.array([{"k": 2.0, "k3": 2e5, "c": -0.02}[one.name] for one in known.refined])
    found = replace(known, covariance=np.outer(off, off))
    prediction = predict(found, [level])
    at, names = np.array([one.value for one in known.refined]), [one.name for one in known.refined]
    moved = [Oscillator(1.5, CUBIC, dict(zip(names, at + part, strict=True))) for part in (-off, off)]
    low, high = (predict(one, [level]) for one in moved)
    for jump, less, more in zip(prediction[level].jumps, low[level].jumps, high[level].jumps, strict=True):
        half = 1.96 * abs(more.frequency - less.frequency) / 2
        assert jump.interval == pytest.approx((jump.frequency - half, jump.frequency + half), abs=0.02 * half)
        assert jump.in_words() in str(prediction)
    ends = [balance_of(as_identification(one, [level])).peak(level, (50.0, 80.0))[0][0] for one in moved]
    slow, fast = prediction[level].peak_interval
    assert fast - slow == pytest.approx(1.96 * abs(ends[1] - ends[0]) / (2 * np.pi), rel=0.01)
    middle = balance_of(found).peak(level, (50.0, 80.0))[0][0] / (2 * np.pi)
    assert (slow + fast) / 2 == pytest.approx(middle, rel=1e-9)
    assert np.isnan(predict(found, [level], band=(9.0, 0.99 * slow))[level].peak_interval).all()
    for name in ("travel", "acceleration"):
        less, more = (np.atleast_1d(getattr(one[level], name)) for one in (low, high))
        ends = np.reshape(getattr(prediction[level], f"{name}_interval"), (-1, 2))
        assert np.ptp(ends, axis=1) == pytest.approx(1.96 * np.abs(more - less), rel=0.01)
        assert ends.mean(axis=1) == pytest.approx(np.atleast_1d(getattr(prediction[level], name)), rel=1e-9)
    said = largest_of_curve(prediction[level], "", (0.0, np.inf))
    assert (said["at_low"], said["at_high"]) == (slow, fast)
    assert (said["most_low"], said["most_high"]) == prediction[level].travel_interval[2:]


@pytest.mark.parametrize(("way", "reaches"), [("up", False), ("down", True)])
def test_of_a_level_asked_for_what_the_tested_sweep_reaches_is_said_first(way, reaches):
    soft = CUBIC, {"k": 6000.0, "k3": -2e7, "c": 1.0}
    table = simulated(*soft, [0.05, 0.1], (9, 11, 41), sweep=way, method="harmonic-balance")
    found = identify(table, CUBIC, Observation(predict=[0.3]))
    said = only(found, "level-predicted")
    assert ("swept" in said.numbers) is not reaches
    own = simulated(*soft, [0.3], (9.7, 9.94, 61), sweep=way)
    assert said["amplitude" if reaches else "swept"] == pytest.approx(own.amplitude.max(), rel=0.01)
    swept = predict(found, [0.3]).table.rows[0][5].split(" / ")
    assert float(swept[reaches]) == pytest.approx(own.amplitude.max(), rel=0.01)
    fell = own.frequency < 9.758 if reaches else own.frequency > 9.902
    curve = predict(found, [0.3])[0.3]
    (led,) = (jump for jump in curve.jumps if jump.sweep == way)
    at_jump = pytest.approx((led.frequency, led.landing), rel=1e-9)
    assert reaches or (said["swept_at"], said["swept"]) == at_jump
    rising = next(jump for jump in curve.jumps if jump.landing > jump.amplitude)
    # integrated from rest below the jump to 0.3 % beyond it
    slow = SweepLaw("linear", 0.97 * rising.frequency, 2.5e-4)
    motion = sweep(Oscillator(1.5, *soft), 0.3, slow, 1.003 * rising.frequency)
    assert said["swing"] == pytest.approx(np.abs(motion.response).max(), rel=0.01)
    assert led.landing == pytest.approx(own.amplitude[fell].max(), rel=0.02)


def test_a_fold_next_to_a_corner_of_the_law_is_where_the_motion_jumps():
    known = as_identification(STOP, [1.0])
    off = np.array([0.01 * one.value if one.name == "g" else 0.0 for one in known.refined])
    found = predict(replace(known, covariance=np.outer(off, off)), [1.0], band=(15.0, 90.0))
    moved = [replace(STOP, values={**STOP.values, "g": STOP.values["g"] * by}) for by in (0.99, 1.01)]
    low, high = (predict(one, [1.0], band=(15.0, 90.0))[1.0].jumps[0].frequency for one in moved)
    corner = found[1.0].jumps[0]
    # by 24 harmonics from 2048 samples a period; the points of the curve lie 0.4 Hz from each other
    assert corner.frequency == pytest.approx(25.1552, rel=5e-5)
    assert corner.interval[1] - corner.frequency == pytest.approx(1.96 * abs(high - low) / 2, rel=0.1)


def test_a_held_out_level_says_nothing_of_amplitudes_that_its_points_do_not_reach():
    points = np.linspace(18.0, 20.0, 3)
    measured = np.full(3, 8e-4 + 0j)
    sizes = {"level": 2.5, "force": 2.5, "error": 0.0066, "largest_error": 0.01, "missing": 0}
    held = HeldOutLevel(sweep="up", frequency=points, measured=measured, predicted=measured, **sizes)
    assert known_beyond([held], 2.5, 2e-3, 7e-4)["error"].value == 0.0066
    assert known_beyond([held], 2.5, 2e-3, 9e-4) == {}
    assert known_beyond([held], 2.0, 2e-3, 7e-4) == {}


@pytest.mark.parametrize(("label", "name"), [(None, "4 N"), ([1.0, 2.0, 3.0], "2 (4 N)")])
def test_a_level_has_one_name(label, name):
    driven = surface("cubic", levels=np.array([1.9, 3.8, 7.6]))
    at = np.searchsorted(driven.levels, driven.level)
    table = changed(driven, level=np.array([2.0, 4.0, 8.0])[at], label=label and np.array(label)[at])
    found = identify(table, model("cubic", hold_out=(2.0 if label else 4.0,)))
    prediction = predict(found, surface=table)
    (held_out,) = prediction.held_out
    assert held_out.name == name
    assert [curve.force for curve in prediction] == pytest.approx([1.9, 3.8, 7.6], rel=1e-3)
    # of its line the force near the resonance
    legend = draw_responses(table, prediction).figure.axes[0].get_legend()
    assert legend.get_texts()[1].get_text() == f"{name} at 3.8 N"
    sizes = {"level": Quantity(4.0, "N"), "misfit": Quantity(0.1), "typical": Quantity(0.01)}
    doubted = replace(found, findings=(Finding("level-deviates", "doubt", "", sizes),))
    (other,) = _with_held_out(doubted, table, Prediction((), (), ())).findings
    assert sentence(other).startswith(f"level {name} misses the law")


def test_predictions_keep_to_the_band_of_the_observation():
    test, band = surface("cubic", levels=np.array([2.0, 4.0, 8.0])), (8.5, 11.5)
    frequency = np.concatenate([test.frequency, test.frequency + 20])
    force, motion = (np.concatenate([v, by * v]) for v, by in ((test.force, 0.6), (test.harmonics[:, 1], 3)))
    table = ResponseSurface(np.tile(test.level, 2), frequency, force, motion)
    asked = Observation(hold_out=[4.0], band=band, predict=[6.0])
    found = identify(table, LAWS["cubic"][0], asked)
    prediction = predict_shown(table, found)
    assert [curve.level for curve in prediction] == [2.0, 4.0, 6.0, 8.0]
    (held_out,) = prediction.held_out
    assert (held_out.force, found.held_out[0].force) == (4.0, 4.0)
    drawn = draw_responses(table, prediction).figure.axes[0]
    for at in (*(curve.frequency for curve in prediction), *(line.get_xdata() for line in drawn.get_lines())):
        assert band[0] <= np.nanmin(at) < np.nanmax(at) <= band[1]
    assert len(predict(found, [6.0], band=(7.0, 13.0))[6.0].frequency)


def test_a_level_whose_force_changes_is_predicted_at_its_forces():
    values, drop, levels = {"k": 61000.0, "c": 9.0 + 14, "k3": -8e8}, 14.0, [3.0, 6.0, 12.0, 16.0]
    test = simulated(CUBIC, values, levels, (32, 23, 46), 2.1, sweep="down", method="harmonic-balance")
    force = test.force - 1j * drop * test.omega * test.harmonics[:, 1]
    table = noisy(fundamentals(test, force=force, sweep=test.sweep), 3e-3, 1)
    found = identify(table, CUBIC, Observation(hold_out=[12.0]))
    prediction = predict_shown(table, found)
    asked = replace(found.model, observation=replace(found.model.observation, predict=[20.0]))
    stated = predict_held_out(replace(found, model=asked), table).findings
    (fell,) = (one for one in stated if one.names.get("by") == "force")
    run = table.select((table.level == 16.0) & table.settled)
    near = run.amplitude > run.amplitude.max() / np.sqrt(2)
    ratio = np.min(np.abs(run.force[near])) / np.median(np.abs(run.force[~near]))
    assert fell["fell"] >= 1 - ratio > 0.05
    assert fell in predict(found, [20.0]).findings
    # of tested levels and of those held out there are the measured forces
    assert fell not in prediction.findings
    (held_out,) = prediction.held_out
    assert (held_out.changes, held_out.missing) == (True, 0)
    assert held_out.error < 0.02
    # some lie where a constant force holds no motion
    at = balance_of(found).solve(np.abs(held_out.measured), 2 * np.pi * held_out.frequency)
    assert np.any((np.conj(at.force) * at.force_slope).real < 0)
    assert "prediction-extrapolated" not in codes(prediction)
    assert [item.level for item in prediction.fitted] == [3.0, 6.0, 16.0]


def test_a_tested_level_has_the_force_at_its_largest_motion_and_its_energy_is_that_of_all_harmonics():
    # a shaker loses 8 % near 12.75 Hz, and the largest motion of this softening law is near 11.8 Hz
    law, values = f"{CUBIC} + cq*v*abs(v)", {"k": 15800.0, "k3": -1.45e8, "c": 3.1, "cq": 22.0}
    test = simulated(law, values, 5 - np.arange(9) / 20, (11, 14.5, 57), 2.21,
                     sweep="down", method="harmonic-balance")  # fmt: skip
    wanted = 5 * (1 - 0.08 * np.exp(-(((test.frequency - 12.75) / 0.4) ** 2)))
    table = test.select(np.abs(test.level - wanted) <= 0.025)
    table = changed(table, level=np.full(len(table), 5.0))
    found = identify(table, law, mass=2.21)
    (curve,) = predict(found)
    assert curve.force == pytest.approx(5.0, rel=5e-3)
    assert curve.largest[1] == pytest.approx(table.amplitude.max(), rel=1e-2)
    measured, refined = measured_energy(table), dissipated_energy(found)
    assert refined.energy[-1] == pytest.approx(measured.energy[-1], rel=0.01)


def test_a_free_decay_has_no_band_that_cuts_its_curves():
    time, damping, natural = np.arange(16000) / 1000, 0.4, np.sqrt(4000.0 - 0.16)
    motion = 4e-3 * np.exp(-damping * time) * np.cos(natural * time)
    noise = 1e-6 * np.random.default_rng(1).normal(size=len(time))
    table = from_free_decay(TimeHistory(1000.0, None, motion + noise), mass=1.5)
    found = identify(table, "k*x + c*v", Observation(predict=[0.2]))
    prediction = predict_shown(table, found)
    curve = prediction[0.2]
    assert not curve.rises_at_end
    assert np.nanmax(curve.amplitude) == pytest.approx(0.2 / (1.2 * np.sqrt(4000.0)), rel=1e-2)
    assert np.nanmin(curve.amplitude) < np.nanmax(curve.amplitude) / 2
    assert "jumps" not in only(found, "level-predicted").names


@pytest.mark.slow
def test_an_oscillator_whose_loop_closes_up_to_an_amplitude_is_predicted():
    memory = {"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"}
    values = {"k": 5e4, "c": 40.0, "alpha": 5e4, "bg": 800.0, "bd": -1100.0}
    joint = Oscillator(2.0, Law("k*x + c*v + z", memory=memory), values)
    curve = predict(joint, [10.0])[10.0]
    top = int(np.nanargmax(curve.amplitude))
    own = simulate(joint, SimulatedTest([10.0], [float(curve.frequency[top])]))
    assert curve.amplitude[top] == pytest.approx(own.amplitude[0], rel=5e-3)
    joint = Oscillator(2.0, joint.elements, values | {"c": 0.0, "k": 2e4, "alpha": 1.0})
    with pytest.raises(RsgenError, match=r"the law, whose memory has a loop up to .* m, needs damping"):
        predict(joint, [1e9])


BUCKLED = f"{CUBIC} + k5*x**5", {"k": 2.2e4, "c": 3.2, "k3": -2e8, "k5": 7.5e12}


def buckled(sweep: str) -> ResponseSurface:
    return simulated(*BUCKLED, [1.0, 3.5], (19, 29, 51), 0.95, sweep=sweep)


@pytest.mark.parametrize(("sweep", "way", "said"), [
    ("down", "up", "down"), ("up", "", "up"), ("down", "up", "up"), ("rest", "up", "rest"), ("up", "", "down")
])  # fmt: skip
def test_how_to_reach_a_peak_follows_from_sweep_and_law(sweep: str, way: str, said: str):
    found = identify(replace(buckled(sweep), sweep=said), BUCKLED[0])
    named = {finding.code: finding for finding in (*found.findings, *predict(found).findings)}
    assert ("prediction-extrapolated" in named) == bool(way)
    assert ("direction-from-branch" in named) == (said != sweep)
    assert found.resonances[1].reached == (said != "down")
    assert not way or named["prediction-extrapolated"].names["way"] == way
    assert found.verdict.state == ("doubtful" if (sweep, said) == ("up", "down") else "identified")


def test_sweeps_said_to_be_one_way_are_judged_each_and_points_left_out_are_no_jump():
    up, down = buckled("up"), simulated(*BUCKLED, [1.0, 3.5], (19.1, 28.9, 50), 0.95, sweep="down")
    found = identify(replace(joined(down, up), sweep="down"), BUCKLED[0])
    assert only(found, "direction-from-branch").names["rows"] == "up"
    assert found.verdict.state == "doubtful"
    found = identify(up.select((up.frequency < 23.1) | (up.frequency > 24.1)), BUCKLED[0])
    assert "direction-from-branch" not in codes(found)


def test_a_sweep_that_fell_early_is_to_take_smaller_steps():
    up, down = buckled("up"), buckled("down")
    fell = np.where((up.frequency < 24.7)[:, None], up.harmonics, down.harmonics)
    (said,) = predict(identify(replace(up, harmonics=fell), BUCKLED[0])).findings
    assert said.names["way"] == "finer"


def test_levels_asked_of_a_multisine_are_said_to_be_those_of_a_sine():
    records = multisine(CUBIC, {"k": 5000.0, "k3": 4e6, "c": 4.0}, [3, 8], periods=4)
    found = identify(records, CUBIC, Observation(hold_out=(3.0,)))
    for levels, said in ((None, []), ([1.0], ["sine"])):
        prediction = predict(found, levels)
        assert [f.names.get("by") for f in prediction.findings if f.code == "prediction-extrapolated"] == said
        assert len(prediction.records) == 1


def test_an_amplitude_without_a_motion_ends_no_range_of_a_curve():
    balance = balance_of(as_identification(Oscillator(1.2, CUBIC, STIFF), [4.0]))
    spans = balance.spans(4.0, (80.0, 180.0))
    size, omega, force = balance._table
    inside = np.flatnonzero(force <= 4.0)
    balance._table = size, omega, np.where(np.arange(len(size)) == inside[len(inside) // 2], np.nan, force)
    assert balance.spans(4.0, (80.0, 180.0)) == spans
    assert len(spans) == 1
