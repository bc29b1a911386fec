"""Laws identified from their own surfaces: exact values, resonances, what is left out, what is refused."""

import importlib
from dataclasses import replace
from math import isnan

import numpy as np
import pytest

from rsgen import identify, laws, make_element
from rsgen.data.free_mode import estimate_mass, steady
from rsgen.data.oscillator import Model, Observation
from rsgen.identification.fitting.points import select_points
from rsgen.identification.resonance import find_resonances
from tests.pins.grids import joint_law, small_joint
from tests.surfaces import (
    LAWS,
    MASS,
    changed,
    codes,
    distances,
    errors,
    identified,
    model,
    noisy,
    surface,
    truth,
)
from tests.virtual import simulated

EXACT = 1e-6
"""Refined parameters from steady states of accuracy 1e-7: their error, amplified by the fit."""


def test_what_a_fit_leaves_of_each_point_has_all_harmonics():
    # the describing function of one harmonic leaves 2 % of the force of the right law at these points
    found = identify(surface("cubic"), model("cubic", hold_out=(12.0,)))
    held_out = found.curve.level == 12.0
    assert np.array_equal(np.isnan(found.residuals), held_out)
    assert np.max(np.abs(found.residuals[~held_out])) < 1e-5
    rough = identified("cubic", 0.01)
    # force and response have one noise each
    assert np.sqrt(np.mean(np.abs(rough.residuals[rough.curve.used]) ** 2)) == pytest.approx(0.014, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("law", [
    # a search over the whole range takes as long as all other laws; pins hold both
    pytest.param(law, marks=[pytest.mark.thorough] if law in ("power", "two-gaps") else []) for law in LAWS
])  # fmt: skip
def test_every_parameter_comes_back_from_its_own_surface(law):
    found = identified(law)
    assert max(errors(found, truth(law)).values()) < (1e-4 if law in ("power", "tanh", "two-gaps") else EXACT)
    assert max(errors(found, truth(law), "first_order").values()) < 0.1
    # friction holds the mass, and on both sides of rest the bilinear spring is another one
    values, expected = truth(law), []
    if law not in ("coulomb", "bilinear"):
        k, c = values.get("k", values.get("k4")), values["c"] + values.get("A", 0) / values.get("w", 1)
        expected = [np.sqrt(k / MASS) / 2 / np.pi, c / 2 / np.sqrt(k * MASS)]
    assert [one.value for one in found.small_motion] == pytest.approx(expected, rel=1e-4)
    if law in ("cubic", "quintic", "combined"):
        for first, bias in zip(found.first_order, found.first_order_bias, strict=True):
            true = truth(law)[first.name]
            assert first.value - true == pytest.approx(bias, rel=0.02, abs=1e-6 * abs(true))
    if law in ("cubic", "quintic", "piecewise", "combined"):
        assert max(errors(found, truth(law), "paper").values()) < 0.06
        assert [r.level for r in found.resonances] == sorted(r.level for r in found.resonances)
    if law == "bilinear":
        # k6 Xp^2 = k7 Xn^2 gives the ratio; Eq. (22), about zero mean, is too stiff for both
        paper = {e.name: e.value for e in found.paper}
        assert paper["k6"] / paper["k7"] == pytest.approx(5 / 7, rel=5e-3)
        exact = 4 * 5000 * 7000 / (5000**0.5 + 7000**0.5) ** 2
        assert (paper["k6"] + paper["k7"]) / 2 == pytest.approx(exact, rel=0.02)


@pytest.mark.slow
def test_order_unit_and_clock_do_not_matter():
    rows = noisy(surface("cubic"), 0.01, 1)
    shuffled = rows.select(np.random.default_rng(1).permutation(len(rows)))
    exact = surface("combined")
    in_millinewtons = changed(exact, force=1000 * exact.force, level=1000 * exact.level)
    sides = surface("bilinear")
    turn = np.exp(1j * np.random.default_rng(5).uniform(0, 6, len(sides)))
    harmonics = sides.harmonics * turn[:, None] ** np.arange(sides.harmonics.shape[1])
    turned = changed(sides, force=sides.force * turn, harmonics=harmonics)
    for law, noise, table, factor, same in (
        ("cubic", 0.01, shuffled, 1.0, 1e-6),
        ("combined", 0.0, in_millinewtons, 1000.0, 1e-8),
        ("bilinear", 0.0, turned, 1.0, 1e-7),
    ):
        expected = {e.name: factor * e.value for e in identified(law, noise).refined}
        assert max(errors(identify(table, model(law)), expected).values()) < same


def test_held_out_levels_are_not_seen():
    table = surface("cubic")
    spoilt = changed(table, harmonics=np.where(table.level == 8.0, 7, 1)[:, None] * table.harmonics)
    one, other = (identify(t, model("cubic", hold_out=(8.0,))) for t in (table, spoilt))
    assert [e.value for e in one.refined] == [e.value for e in other.refined]
    held = identify(table, model("cubic", hold_out=(8.0,)), Observation(hold_out=(4.0,)))
    assert not {8.0} & {*one.levels}
    assert {8.0, 4.0} & {*held.levels} == {8.0}


def test_outliers_gaps_and_unsettled_points_are_survived():
    generator = np.random.default_rng(2)
    table = noisy(surface("cubic"), 0.005, 1)
    spoil = generator.random(len(table)) < 0.05
    factor = np.where(spoil[:, None], generator.uniform(1.3, 5, (len(table), 1)), 1.0)
    harmonics, outcome = factor * table.harmonics, np.where(generator.random(len(table)) < 0.1, 1, 0)
    harmonics[outcome == 1] = np.nan
    outcome[np.flatnonzero(outcome)[::2]] = 2  # the period of these is twice that of the force
    table = changed(table, harmonics=harmonics, outcome=outcome).select(generator.random(len(table)) > 0.2)
    found = identify(table, model("cubic"))
    assert np.abs(distances(found, truth("cubic"))).max() < 4
    excluded = {f.names.get("by"): f for f in found.findings if f.code == "points-excluded"}
    assert {None, "settling"} <= excluded.keys()
    assert excluded["settling"]["doubled"] == np.count_nonzero(table.outcome == 2)
    lost = table.frequency[~table.settled & (table.level == table.levels[0])]
    named = f"{table.levels[0]:.4g} N at {len(lost)} frequencies from {lost.min():.5g} to {lost.max():.5g} Hz"
    assert excluded["settling"].names["where"].startswith(named)
    assert " N at " in excluded[None].names["where"]


@pytest.mark.slow
def test_what_is_not_identifiable_is_no_number():
    low = surface("piecewise", levels=np.array([0.2, 0.4, 0.6]))
    assert low.amplitude.max() < LAWS["piecewise"][1]["b"]
    found = identify(low, model("piecewise"))
    for name in ("b", "k5"):
        assert not found[name].identifiable
        assert found[name].finding in found.findings
    assert max(errors(found, {name: truth("piecewise")[name] for name in ("k4", "c", "m")}).values()) < 1e-5


@pytest.mark.parametrize(("text", "said"), [
    ("ka*kr*x", "ka*kr"), ("ka/kr*x", "ka/kr"), ("(ka - kr)*x", "ka - kr"), ("ka*x + kr*x*3", "ka + 3*kr"),
])  # fmt: skip
def test_of_confounded_parameters_the_combination_that_shows_has_an_interval(text, said):
    table, known = noisy(surface("cubic"), 1e-3, 1), identified("cubic", 1e-3)
    found = identify(table, Model((make_element("one", text), make_element("two", "kn*x**3 + c*v"))))
    assert isnan(found["ka"].value)
    why = found["ka"].finding
    assert (why.code, why.severity, why.parameter) == ("confounded", "warning", "ka")
    assert why.names == {"with": "kr", "combination": said}
    assert why["combined"] == pytest.approx(known["k"].value, rel=1e-5)
    assert why.numbers["combined"].unit == ("N/m" if said in ("ka - kr", "ka + 3*kr") else "")
    assert (why["low"], why["high"]) == pytest.approx(known["k"].interval, rel=1e-3)
    assert found["kn"].value == pytest.approx(known["kn"].value, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["cubic", "combined", "bilinear"])
def test_intervals_of_exact_data_allow_for_the_error_of_the_simulator(law):
    # neighbours share the error, so the scatter of the points alone would promise ten times more
    found = identify(surface(law, accuracy=1e-5), model(law))
    assert np.abs(distances(found, truth(law))).max() < 3


@pytest.mark.thorough
@pytest.mark.parametrize("law", ["cubic", "coulomb"])
def test_intervals_hold_the_truth_as_often_as_they_say(law):
    runs, true, table = 40, truth(law), surface(law, accuracy=1e-6)
    small = {"natural-frequency": np.sqrt(true["k"] / MASS) / 2 / np.pi}
    small["damping-ratio"] = true["c"] / 2 / np.sqrt(true["k"] * MASS)
    inside, scores = [], []
    for seed in range(runs):
        found = identify(noisy(table, 0.01, seed), model(law))
        stated = (*found.refined, *found.small_motion)
        inside += [e.interval[0] <= (true | small)[e.name] <= e.interval[1] for e in stated]
        scores += [*distances(found, true)]
    # 95 % expected; parameters of one run are correlated, so the count of runs sets the width: 4 sigma
    assert abs(np.mean(inside) - 0.95) < 4 * np.sqrt(0.05 * 0.95 / runs) * 0.75
    assert 0.8 < np.std(scores) < 1.2
    assert abs(np.mean(scores)) < 4 / np.sqrt(runs)


@pytest.mark.slow
def test_a_law_that_misses_a_little_is_said_to_miss():
    # most of the misfit is noise: neighbours are alike all the same
    table = noisy(surface("combined", np.linspace(1, 12, 12)), 0.05, 1)
    found = identify(table, model("cubic"))
    assert found.noise < 0.06
    assert "law-does-not-fit" in codes(found)
    assert "law-does-not-fit" not in codes(identify(table, model("combined")))
    assert "law-does-not-fit" in codes(identify(noisy(surface("quintic"), 0.002, 1), model("coulomb")))


LINEAR = {"k": 5920.0, "kn": 0.0, "c": 3.8}


def test_a_fit_that_the_simulator_does_not_take_up_ends_at_its_least_misfit(monkeypatch):
    # of many points the balance stops after a step where the simulator is to follow
    monkeypatch.setattr("rsgen.identification.identify._refit_with_simulator", lambda balanced: balanced)
    rig = "k*x + k3*x**3 + c*v + Ff*sign(v)", {"k": 2e4, "k3": 2e7, "c": 4.0, "Ff": 0.2}
    found = identify(noisy(simulated(*rig, [2.0, 6.0], (18, 28, 450), 1.0), 1e-3, 1), rig[0])
    assert found.fit.regression.converged
    assert {estimate.name for estimate in found if estimate.identifiable} == {"m", "k", "k3", "c", "Ff"}


def test_a_wrong_law_whose_first_simulated_steps_do_not_converge_keeps_its_balance(monkeypatch):
    # friction next to stops is left out; further steps ran away for minutes
    module = importlib.import_module("rsgen.identification.fitting.fit")
    done, descend = [], module.fit

    def unfinished(*place, **how):
        found = descend(*place, **how)
        simulated_steps = found.rules.attainable > 0
        done.append(simulated_steps)
        return replace(found, converged=False) if simulated_steps else found

    monkeypatch.setattr(module, "fit", unfinished)
    stops, friction = "k*x + ks*(Max(0, x - b) + Min(0, x + b)) + c*v", {"Ff": 0.08}
    values = {"k": 5040.0, "ks": 3200.0, "b": 1.1e-3, "c": 1.1}
    test = simulated(stops + " + Ff*sign(v)", values | friction, [0.3, 1.8], (10, 18, 60), 1.0)
    found = identify(test, stops, mass=1.0)
    assert sum(done) == 1
    assert found.fit.regression.converged
    assert "law-does-not-fit" in codes(found)


def test_linear_structure_has_one_resonance_at_every_level():
    points = select_points(surface("cubic", values=LINEAR), model("cubic"))
    estimated = estimate_mass(*steady(points.force, points.harmonics[:, 1], points.omega))
    assert estimated.mass == pytest.approx(1.5, rel=1e-6)
    assert estimated.mass_error < 1e-2
    found, turning = find_resonances(points, estimated.mass)
    assert len(found) == 6
    for resonance in found:
        assert resonance.frequency == pytest.approx(np.sqrt(5920 / 1.5) / 2 / np.pi, rel=1e-5)
        # by straight lines between points 0.1 Hz apart, a quarter of the width of the resonance
        assert resonance.damping == pytest.approx(3.8, rel=1e-3)
        assert resonance.damping_ratio == pytest.approx(3.8 / 2 / np.sqrt(5920 * 1.5), rel=1e-3)
        assert not resonance.jump
    assert turning[:, 0] == pytest.approx(-turning[:, 1], rel=1e-6)


@pytest.mark.parametrize("sweep", ["up", "down"])
def test_the_point_at_which_a_sweep_lands_is_no_resonance(sweep):
    law, values = "k*x + k3*x**3 + c*v", {"k": 2e4, "k3": 3e9, "c": 12.0}
    table = simulated(law, values, [3.0], (13, 24, 56), 2.0, sweep=sweep, method="harmonic-balance")
    (resonance,), _ = find_resonances(select_points(table, Model(law)), 2.0)
    assert resonance.jump
    assert resonance.reached == (sweep == "up")


def test_a_level_that_ends_before_its_resonance_has_none():
    table = surface("cubic", levels=np.array([2.0]), frequencies=np.linspace(8, 9.6, 17))
    harmonics = np.array(table.harmonics)
    harmonics[-1] *= harmonics[-2, 1] / harmonics[-1, 1] * 0.99
    found, _ = find_resonances(select_points(changed(table, harmonics=harmonics), model("cubic")), 1.5)
    assert found == ()


def test_more_harmonics_of_a_law_with_memory_are_more_than_those_of_its_corners(monkeypatch):
    # each order is compared with the next one, also where a fit begins with the second of them
    module, orders = importlib.import_module("rsgen.identification.identify"), []
    fit_balance = module.fit_balance

    def recorded(*arguments, order, **options):
        orders.append(order)
        return fit_balance(*arguments, order=order, **options)

    monkeypatch.setattr(module, "fit_balance", recorded)
    monkeypatch.setattr(module, "_HARMONICS_OF_CORNERS", 15)
    identify(small_joint("jenkins", 0.01), joint_law("jenkins"))
    assert orders[:2] == [15, 23]


@pytest.mark.slow
def test_parameters_that_ran_away_are_not_said_to_need_higher_levels_alone():
    """A Jenkins element is an Iwan joint of chi without end; with some noise the fit does not get there."""
    jenkins = "k*x + c*v + masing(Min(kt*x, Fs))", {"k": 3e4, "c": 5.0, "kt": 1.4e4, "Fs": 2.0}
    how = {"method": "harmonic-balance", "noise_relative": 3e-3, "seed": 5}
    test = simulated(*jenkins, [1, 2, 4, 8], (22, 34, 61), 1.3, **how)
    found = identify(test, f"k*x + c*v + {laws['iwan4'].force}")
    said = {one.name: one.finding for one in found if one.finding}
    assert {name: finding.code for name, finding in said.items()} == {"R": "no-effect", "chi": "no-effect"}
    # that of real joints lies between -1 and 0
    assert said["chi"]["value"] > 10
    assert found["S"].value * found["phimax"].value == pytest.approx(2.0, rel=5e-3)
