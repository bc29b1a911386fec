from __future__ import annotations

import inspect
from importlib import import_module
from math import isnan

import numpy as np
import pytest

import rsgen
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding
from rsgen.data.oscillator import Observation
from rsgen.identification.identify import identify
from rsgen.identification.results import Identification
from rsgen.report.wording import sentence
from tests.surfaces import LAWS, MASS, changed, model, noisy, surface, truth

EXACT = 1e-6
"""Refined parameters from steady states of accuracy 1e-7: their error, amplified by the fit."""

SCALED = 1e-8
"""The same data in another order or scale give the same numbers up to the end of the iteration."""

SLOW = {"power", "tanh", "two-gaps"}


def errors(found: Identification, law: str, what: str = "refined") -> dict[str, float]:
    true = truth(law)
    return {e.name: abs(e.value / true[e.name] - 1) for e in getattr(found, what)}


@pytest.mark.slow
@pytest.mark.parametrize(
    "law", [pytest.param(law, marks=[pytest.mark.slow] if law in SLOW else []) for law in LAWS]
)
def test_every_parameter_comes_back_from_its_own_surface(law: str) -> None:
    found = identify(surface(law), model(law))
    limit = 1e-4 if law in SLOW else EXACT
    assert max(errors(found, law).values()) < limit, errors(found, law)
    assert max(errors(found, law, "first_order").values()) < 0.1


@pytest.mark.parametrize("law", ["cubic", "quintic", "combined"])
def test_first_order_bias_is_predicted(law: str) -> None:
    found = identify(surface(law), model(law))
    for first, bias in zip(found.first_order, found.first_order_bias, strict=True):
        seen = first.value - truth(law)[first.name]
        assert seen == pytest.approx(bias, rel=0.02, abs=1e-6 * abs(truth(law)[first.name]))


@pytest.mark.slow
@pytest.mark.parametrize("law", ["cubic", "quintic", "piecewise", "combined"])
def test_the_papers_way_comes_near(law: str) -> None:
    found = identify(surface(law), model(law))
    assert max(errors(found, law, "paper").values()) < 0.06
    assert [r.level for r in found.resonances] == sorted(r.level for r in found.resonances)


@pytest.mark.slow
def test_bilinear_stiffnesses_come_from_the_two_peaks() -> None:
    found = {e.name: e.value for e in identify(surface("bilinear"), model("bilinear")).paper}
    # k6 Xp^2 = k7 Xn^2 gives the ratio; Eq. (22), about zero mean, is too stiff for both
    assert found["k6"] / found["k7"] == pytest.approx(5 / 7, rel=5e-3)
    mean = (found["k6"] + found["k7"]) / 2
    exact = 4 * 5000 * 7000 / (5000**0.5 + 7000**0.5) ** 2
    assert mean == pytest.approx(exact, rel=0.02)


def test_truth_has_no_way_in() -> None:
    assert list(inspect.signature(identify).parameters) == ["surface", "law", "observation", "mass", "fixed"]
    assert not hasattr(model("cubic"), "values")


def test_order_of_points_does_not_matter() -> None:
    table = noisy(surface("cubic"), 0.01, 3)
    shuffled = table.select(np.random.default_rng(1).permutation(len(table)))
    one, other = (identify(t, model("cubic")) for t in (table, shuffled))
    for a, b in zip(one.refined, other.refined, strict=True):
        assert a.value == pytest.approx(b.value, rel=1e-6)


def test_forces_in_another_unit_scale_every_parameter() -> None:
    table = surface("combined")
    other = changed(table, force=1000 * table.force, level=1000 * table.level)
    for a, b in zip(
        identify(table, model("combined")).refined, identify(other, model("combined")).refined, strict=True
    ):
        assert b.value == pytest.approx(1000 * a.value, rel=SCALED)


@pytest.mark.slow
def test_a_turned_time_origin_changes_nothing() -> None:
    table = surface("bilinear")
    turn = np.exp(1j * np.random.default_rng(5).uniform(0, 6, len(table)))
    other = changed(
        table, force=table.force * turn, harmonics=table.harmonics * turn[:, None] ** np.arange(8)
    )
    for a, b in zip(
        identify(table, model("bilinear")).refined, identify(other, model("bilinear")).refined, strict=True
    ):
        assert b.value == pytest.approx(a.value, rel=1e-7)


def test_held_out_levels_are_not_seen() -> None:
    table = surface("cubic")
    mask = table.level == 8.0
    spoilt = changed(table, harmonics=np.where(mask[:, None], 7 * table.harmonics, table.harmonics))
    one, other = (identify(t, model("cubic", hold_out=(8.0,))) for t in (table, spoilt))
    assert [e.value for e in one.refined] == [e.value for e in other.refined]
    assert 8.0 not in one.levels


def test_a_known_mass_is_used() -> None:
    found = identify(surface("cubic"), model("cubic", mass=1.5))
    assert [e.name for e in found.refined] == ["c", "k", "kn"]
    assert max(errors(found, "cubic").values()) < EXACT


def test_outliers_gaps_and_unsettled_points_are_survived() -> None:
    generator = np.random.default_rng(2)
    table = noisy(surface("cubic"), 0.005, 1)
    spoil = generator.random(len(table)) < 0.05
    harmonics = np.where(
        spoil[:, None], table.harmonics * generator.uniform(1.3, 5, (len(table), 1)), table.harmonics
    )
    outcome = np.where(generator.random(len(table)) < 0.1, 1, 0)
    harmonics[outcome == 1] = np.nan
    table = changed(table, harmonics=harmonics, outcome=outcome).select(generator.random(len(table)) > 0.2)
    found = identify(table, model("cubic"))
    for estimate in found.refined:
        assert abs(estimate.value - truth("cubic")[estimate.name]) < 4 * estimate.standard_error
    assert {None, "settling"} <= {
        finding.names.get("by") for finding in found.findings if finding.code == "points-excluded"
    }


def test_drifting_force_and_response_control_are_no_special_case() -> None:
    generator = np.random.default_rng(4)
    table = surface("quintic", levels=np.geomspace(1, 14, 9))
    chosen = generator.permutation(len(table))[:200]
    table = table.select(chosen)
    # the nominal level says nothing: one level for all, as in a test that holds the response
    found = identify(changed(table, level=np.ones(len(table))), model("quintic"))
    assert max(errors(found, "quintic").values()) < EXACT


@pytest.mark.slow
def test_what_is_not_identifiable_is_no_number() -> None:
    low = surface("piecewise", levels=np.array([0.2, 0.4, 0.6]))
    assert low.amplitude.max() < LAWS["piecewise"][1]["b"]
    found = identify(low, model("piecewise"))
    estimates = {e.name: e for e in found.refined}
    for name in ("b", "k5"):
        assert not estimates[name].identifiable
        assert estimates[name].finding in found.findings
    for name in ("k4", "c", "m"):
        assert estimates[name].value == pytest.approx(truth("piecewise")[name], rel=1e-5)


def test_confounded_parameters_are_named() -> None:
    from rsgen.data.oscillator import Model
    from rsgen.law.element import make_element

    both = Model((make_element("one", "k*x + kn*x**3 + c*v"), make_element("two", "ka*x")))
    found = {e.name: e for e in identify(surface("cubic"), both).refined}
    assert isnan(found["k"].value)
    assert found["k"].finding == Finding(
        "confounded", "warning", "k", names={"with": "ka", "determined": "k + ka"}
    )
    assert found["kn"].value == pytest.approx(-2.2e5, rel=1e-4)


@pytest.mark.slow
def test_a_wrong_law_is_said_to_be_wrong() -> None:
    found = identify(noisy(surface("quintic"), 0.002, 1), model("coulomb"))
    assert "law-does-not-fit" in {finding.code for finding in found.findings}


def test_too_few_points_are_refused_in_a_sentence() -> None:
    with pytest.raises(RsgenError, match="identification needs at least"):
        identify(surface("cubic").select(np.arange(3)), model("cubic"))
    with pytest.raises(RsgenError, match="no level 5 N"):
        identify(surface("cubic"), model("cubic", hold_out=(5.0,)))


@pytest.mark.slow
@pytest.mark.parametrize("law", ["cubic", "combined", "bilinear"])
def test_intervals_of_exact_data_allow_for_the_error_of_the_simulator(law: str) -> None:
    found = identify(surface(law, accuracy=1e-5), model(law))
    for estimate in found.refined:
        # neighbours share the error, so the scatter of the points alone would promise ten times more
        assert abs(estimate.value - truth(law)[estimate.name]) < 3 * estimate.standard_error, estimate


@pytest.mark.slow
def test_a_force_without_a_law_is_drawn_from_zero_or_over_both_sides() -> None:
    assert identify(surface("cubic"), model("cubic")).restoring.displacement[0] == 0
    table = surface("bilinear")
    assert identify(table, model("bilinear")).restoring.displacement[0] < -0.01
    assert identify(noisy(table, 0.01, 1), model("bilinear")).restoring.displacement[0] < -0.01


@pytest.mark.thorough
@pytest.mark.parametrize("law", ["cubic", "coulomb"])
def test_intervals_keep_their_word(law: str) -> None:
    runs = 40
    table = surface(law, accuracy=1e-6)
    true = truth(law)
    inside, scores = [], []
    for seed in range(runs):
        for estimate in identify(noisy(table, 0.01, seed), model(law)).refined:
            inside.append(estimate.interval[0] <= true[estimate.name] <= estimate.interval[1])
            scores.append((estimate.value - true[estimate.name]) / estimate.standard_error)
    # 95 % expected; parameters of one run are correlated, so the count of runs sets the width: 4 sigma
    assert abs(np.mean(inside) - 0.95) < 4 * np.sqrt(0.05 * 0.95 / runs) * 0.75
    assert 0.8 < np.std(scores) < 1.2
    assert abs(np.mean(scores)) < 4 / np.sqrt(runs)


@pytest.mark.slow
@pytest.mark.parametrize("relative", [0.0, 0.01])
def test_a_spring_driven_until_its_symmetry_breaks_is_found(relative: float) -> None:
    values = {"k": 5920.0, "kn": 2e7, "c": 3.0}
    table = surface("cubic", np.linspace(40, 200, 5), np.linspace(2.5, 9, 27), values=values)
    size = np.abs(table.harmonics / table.amplitude[:, None])
    # the third harmonic is nearly as large as the first, and a mean has come up
    assert size[:, 3].max() > 0.8
    assert size[:, 0].max() > 0.2
    found = identify(noisy(table, relative, 1) if relative else table, model("cubic"))
    true = {**values, "m": 1.5}
    for estimate in found.refined:
        if relative:
            assert abs(estimate.value - true[estimate.name]) < 4 * estimate.standard_error
            assert estimate.standard_error < 0.02 * true[estimate.name]
        else:
            assert estimate.value == pytest.approx(true[estimate.name], rel=EXACT)
    assert "not-converged" not in {finding.code for finding in found.findings}


@pytest.mark.slow
def test_an_odd_law_may_move_about_one_of_two_wells() -> None:
    values = {"k": -500.0, "kn": 5e6, "c": 3.0}
    table = surface("cubic", np.linspace(1, 12, 4), np.linspace(1, 8, 21), values=values)
    moves = table.select(table.settled)
    assert np.abs(moves.harmonics[:, 0] / moves.harmonics[:, 1]).max() > 1
    true = {**values, "m": 1.5}
    for estimate in identify(table, model("cubic")).refined:
        assert estimate.value == pytest.approx(true[estimate.name], rel=1e-5), estimate


def test_a_wide_interval_has_a_finding() -> None:
    # far above resonance the spring is almost not seen, and the simulator's own error hides the rest
    table = surface("cubic", frequencies=np.linspace(30, 60, 41), accuracy=1e-4)
    found = {estimate.name: estimate for estimate in identify(table, model("cubic")).refined}
    assert found["kn"].standard_error > 0.5 * abs(found["kn"].value)
    finding = found["kn"].finding
    assert finding is not None
    assert finding.code == "not-distinct-from-zero"
    assert finding["standard_error"] == found["kn"].standard_error
    assert finding.numbers["value"] == (found["kn"].value, "N/m^3")


def test_points_that_do_not_move_are_counted() -> None:
    table = surface("coulomb", levels=np.array([0.1, 0.2]))
    with pytest.raises(RsgenError, match="friction holds the mass"):
        identify(table, model("coulomb"))


@pytest.mark.slow
def test_sentences_print_displacements_as_drawings_do() -> None:
    found = identify(surface("piecewise", levels=np.array([0.5])), model("piecewise"))
    assert " at 1 level; " in sentence(found.outcome)
    # X = F/(c omega) at 10 Hz, next to the resonance
    assert "X up to 2.09 mm, levels up to 500 mN" in sentence(found["b"].finding)


@pytest.mark.slow
def test_a_law_that_misses_a_little_is_said_to_miss() -> None:
    # most of the misfit is noise: neighbours are alike all the same
    table = noisy(surface("combined", np.linspace(1, 12, 12)), 0.05, 1)
    found = identify(table, model("cubic"))
    assert found.noise < 0.06
    assert "law-does-not-fit" in {finding.code for finding in found.findings}
    right = identify(table, model("combined"))
    assert "law-does-not-fit" not in {finding.code for finding in right.findings}


@pytest.mark.slow
def test_a_law_is_a_formula_an_element_a_sequence_or_a_model():
    table, asked = surface("cubic"), model("cubic", MASS)
    ways = [asked.elements[0].force, asked.elements[0], asked.elements]
    expected = [estimate.value for estimate in identify(table, asked).refined]
    for law in (str(ways[0]), *ways[1:]):
        assert [estimate.value for estimate in identify(table, law, mass=MASS).refined] == expected


def test_an_explicit_observation_wins_over_the_models():
    table = surface("cubic")
    held = identify(table, model("cubic", hold_out=(8.0,)), Observation(hold_out=(4.0,)))
    assert 8.0 in held.levels
    assert 4.0 not in held.levels


HUNT_CROSSLEY = "Piecewise((kh*(x + d)**1.5*(1 + l*v), x > -d), (0, True)) - kh*d**1.5"
"""A preloaded contact, ASME J. Appl. Mech. 42 (1975) 440."""


def test_a_contact_that_a_preload_closes_is_found() -> None:
    values = {"k": 5337.0, "c": 1.3, "kh": 36e3, "d": 9e-4, "l": 1.2}
    law = f"k*x + c*v + {HUNT_CROSSLEY}"
    test = rsgen.SimulatedTest(
        [0.1, 0.2, 0.32, 0.5], np.linspace(11, 16, 36), noise_relative=0.003, seed=3, harmonics=5
    )
    found = rsgen.identify(rsgen.simulate(rsgen.Oscillator(0.8, law, values), test), law)
    assert found.verdict.state == "identified"
    for name, value in {**values, "m": 0.8}.items():
        assert abs(found[name].value - value) < 4 * found[name].standard_error, name


@pytest.mark.parametrize("k3", [2e5, 2e9])
def test_harmonics_that_are_left_out_move_no_value(monkeypatch: pytest.MonkeyPatch, k3: float) -> None:
    """Five harmonics serve motions near a sine; of others the balance has as many as it always had."""
    module = import_module("rsgen.identification.identify")
    values = {"k": 6000.0, "k3": k3, "c": 4.0}
    test = rsgen.SimulatedTest([1.0, 2.0, 4.0], np.linspace(8, 24, 40), noise_relative=0.01, seed=1)
    table = rsgen.simulate(rsgen.Oscillator(1.5, "k*x + k3*x**3 + c*v", values), test)
    few = rsgen.identify(table, "k*x + k3*x**3 + c*v")
    assert few.fit.order == (5 if k3 < 1e9 else 9)
    monkeypatch.setattr(module, "_FEW_HARMONICS", 9)
    every = rsgen.identify(table, "k*x + k3*x**3 + c*v")
    assert every.fit.order == 9
    for name in values:
        assert abs(few[name].value - every[name].value) < 2e-3 * every[name].standard_error
