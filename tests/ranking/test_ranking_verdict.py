"""Rankings of awkward tests: near sticking, spikes, a wrong sense of the phase, few points."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rsgen
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, quantities, steps_once
from rsgen.data.oscillator import Model, Observation, Oscillator
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.dynamics.virtual_test import SimulatedTest, add_noise
from rsgen.identification.fitting.fit import fit_simulator
from rsgen.identification.fitting.observed import Problem
from rsgen.identification.identify import identify
from rsgen.identification.ranking import rank
from rsgen.identification.ranking.candidate_fit import CandidateFit, CandidateLaw, Round
from rsgen.identification.ranking.rank_laws import _best_round, _Compared
from rsgen.identification.ranking.ranking_result import Assessment, Candidate, _best_law_finding, assess_best
from rsgen.identification.ranking.reference import PointTest
from rsgen.identification.results import Identification
from rsgen.identification.results import changed as changed_result
from rsgen.law.element import make_element
from rsgen.report.sentences import ranking_steps, sentence, state_verdict
from tests.ranking.test_ranking import BASE, MEMORYLESS, measured
from tests.surfaces import LAWS, MASS, changed, codes, noisy, truth, without_phase

STIFFNESS, DAMPING, FORCE, AMPLITUDE = 5922.0, 2.83, 1.777, 0.01
"""A mass of 1.5 kg at 10 Hz; the force moves it by the amplitude [m] at resonance."""


def simulated(law: str, frequencies: np.ndarray, **values: float) -> ResponseSurface:
    """Six levels from a fifth of the force on; ``law`` is added to the linear spring and damper."""
    values = {"k": STIFFNESS, "c": DAMPING, **values}
    return rsgen.simulate(
        Oscillator(MASS, (make_element("law", f"k*x + c*v + {law}"),), values),
        SimulatedTest(FORCE * np.linspace(0.2, 1.5, 6), frequencies, harmonics=9, accuracy=1e-6),
    )


@pytest.mark.thorough
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_the_law_is_found_where_friction_nearly_sticks(noise: float) -> None:
    # at the lowest level the truncated balance has another amplitude than the law
    table = simulated(
        "kb*Max(0, x) + Ff*sign(v)", np.linspace(8.5, 12, 36), kb=0.5 * STIFFNESS, Ff=0.15 * FORCE
    )
    ranking = rank(noisy(table, noise, 1) if noise else table, MEMORYLESS)
    assert ranking.fits
    assert ranking.candidates[0].name == "bilinear-spring + coulomb"
    assert ranking.candidates[0].held_out_error < max(1.2 * noise, 1e-5)


@pytest.mark.parametrize(("low", "held"), [(1.05, 31), (1.15, 31), (1.27, 0)])
def test_a_level_that_friction_nearly_holds_does_not_reject_the_law(low: float, held: int) -> None:
    structure = Oscillator(MASS, "k*x + c*v + Ff*sign(v)", {"k": 5920.0, "c": 3.8, "Ff": 1.0})
    test = SimulatedTest([low, 8.0], np.linspace(8.5, 11.5, 31), harmonics=5, accuracy=1e-6)
    laws = ["k*x + c*v", "k*x + c*v + Ff*sign(v)", "k*x + c*v + kn*x**3"]
    ranking = rank(rsgen.simulate(structure, test), laws)
    assert ranking.fits
    assert ranking.candidates[0].name == "c*v + k*x + Ff*sign(v)"
    np.testing.assert_allclose([one.value for one in ranking.best], [1.0, 3.8, 5920.0, MASS], rtol=1e-6)
    excluded = [one for one in ranking.findings if one.code == "points-excluded"]
    assert {one.severity for one in excluded} <= {"info", "warning"}
    by = {one.names["by"]: one for one in excluded}
    assert by.get("friction", {"excluded": 0})["excluded"] == held


def test_a_law_that_drives_its_exciter_is_no_reference_for_amplitudes_alone() -> None:
    test = PointTest(without_phase(measured("cubic")), BASE, ())
    law = make_element("law", "k*x + c*v + kn*x**3")
    for sign in (1, -1):
        start = CandidateLaw("", (law,), truth("cubic") | {"c": sign * DAMPING})
        assert (test.along(start, None) is None) == (sign < 0)


def test_advice_does_not_return_to_a_ranking_in_which_no_law_fits() -> None:
    ranking = rank(measured("cubic"), ["k*x + c*v"])
    assert not ranking.fits
    stated = state_verdict(ranking.best.verdict)
    codes = [finding["code"] for finding in stated["decided_by"]]
    assert codes[0] == "no-law-fits"
    assert "law-does-not-fit" in codes
    first, *rest = steps_once(stated)
    assert "leads no further. What remains: `rsgen modal`" in first
    assert "`rsgen rank --terms-in-sum 3` (in Python terms_in_sum=3)" in first
    assert not [step for step in rest if "rsgen rank" in step]


def test_a_ranking_in_which_no_law_fits_says_with_which_background_one_would() -> None:
    table = measured("cubic", 2e-3)
    late = changed(table, harmonics=table.harmonics * np.exp(-0.03j * np.arange(table.harmonics.shape[1])))
    laws = ["k*x + c*v", "c*v + k*x + kn*x**3"]
    ranking = rank(late, laws)
    assert not ranking.fits
    stated = state_verdict(ranking.verdict)
    assert [one["code"] for one in stated["decided_by"]] == ["no-law-fits", "background-missing"]
    (step,) = steps_once(stated)
    assert 'Rank again with [identify] background = "phase"' in step
    again = rank(late, laws, Observation(background="phase"))
    assert again.fits
    assert again.candidates[0].name == laws[1]


def test_a_ranking_in_which_no_law_fits_names_the_even_force_that_is_missing() -> None:
    values = {"k": 1.2e4, "k2": 6e4, "k3": 6e5, "c": 1.5}
    plate = Oscillator(0.8, "k*x + k2*x**2 + k3*x**3 + c*v", values)
    plan = SimulatedTest([0.8, 1.5, 3.0, 4.5], np.linspace(17, 22, 30), noise_relative=5e-3, seed=2)
    table, odd = rsgen.simulate(plate, plan), ["k*x + c*v + k3*x**3", "k*x + c*v + k5*x**5"]
    ranking = rank(table, odd)
    stated = state_verdict(ranking.verdict)
    assert [one["code"] for one in stated["decided_by"]] == ["no-law-fits", "even-force-missing"]
    assert stated["decided_by"][0]["names"]["even"] == "x**2"
    (step,) = steps_once(stated)
    assert "such as k2*x**2" in step
    assert [f.code for f in ranking.best.findings].count("even-force-missing") == 1
    steps = steps_once(state_verdict(ranking.best.verdict))
    assert len([one for one in steps if "k2*x**2" in one]) == 1
    assert rank(table, [*odd, "k*x + c*v + k2*x**2 + k3*x**3"]).fits


def test_the_background_that_would_fit_is_named_where_most_of_the_misfit_is_noise() -> None:
    law, values = "k*x + k3*x**3 + k5*x**5 + c*v", {"k": 33e3, "k3": -9e8, "k5": 9e13, "c": 2.2}
    test = SimulatedTest([1, 5, 12], np.linspace(26, 35, 46), sweep="down", noise_relative=6e-3, seed=1)
    table = rsgen.simulate(Oscillator(0.9, law, values), test)
    response = table.harmonics[:, 1] + 2.5e-6 * table.force
    seen = ResponseSurface(table.level, table.frequency, table.force, response, sweep="down")
    (found,) = (f for f in rank(seen, [law]).verdict.decided_by if f.code == "background-missing")
    assert found.names["kind"] == "constant"
    # by no means half of it, for the noise remains
    assert found["left"] > 0.5 * found["misfit"]
    assert found["left"] == pytest.approx(6e-3, rel=0.1)


@pytest.mark.parametrize("constant", [True, False])
def test_the_zero_of_a_sensor_decides_no_ranking(constant: bool) -> None:
    table, laws = measured("cubic", 2e-3), ["k*x + c*v", "c*v + k*x + kn*x**3"]
    if not constant:
        # amplitudes of one octave do not tell a constant from what a force makes
        table = table.select(table.amplitude > 0.4 * table.amplitude.max())
    harmonics = np.array(table.harmonics)
    harmonics[:, 0] += 4e-4
    ranking = rank(changed(table, harmonics=harmonics), laws)
    assert ranking.fits == constant
    code = "sensor-offset" if constant else "no-law-fits"
    (offset,) = {one["offset"] for one in (*ranking.findings, *ranking.best.findings) if one.code == code}
    assert offset == pytest.approx(4e-4, rel=0.05)
    harmonics[:, 0] -= offset
    assert rank(changed(table, harmonics=harmonics), laws).fits


@pytest.mark.thorough
def test_the_zero_of_a_sensor_makes_no_bilinear_spring_of_a_decay() -> None:
    """The law with two terms more, whose values held the mean together, was "identified"."""
    slider = Oscillator(0.8, "k*x + c*v + f*sign(v)", {"k": 4200.0, "c": 1.1, "f": 0.35})
    plan = rsgen.DecayTest([0.02, 0.03, 0.04], duration=6, rate=1000, noise_relative=3e-4, seed=1)
    table = rsgen.simulate(slider, plan)
    harmonics = np.array(table.harmonics)
    harmonics[:, 0] += 1.5e-4
    laws = ["c*v + k*x + f*sign(v)", "c*v + k*x + kb*Max(x, 0) + Ff*tanh(v/vs)"]
    ranking = rank(changed(table, harmonics=harmonics), laws, mass=0.8, terms_in_sum=1)
    assert ranking.candidates[0].name == laws[0]
    assert "sensor-offset" in {finding.code for finding in ranking.findings}


def test_a_law_that_does_not_fit_is_identified_by_the_balance_and_a_background_is_said_once(monkeypatch):
    table = measured("piecewise", 2e-3)
    late = changed(table, harmonics=table.harmonics * np.exp(-0.03j * np.arange(table.harmonics.shape[1])))
    ranking = rank(late, [LAWS["piecewise"][0]])
    assert not ranking.fits
    asked = list[int]()

    def spy(problem: Problem, *rest: Any, **named: Any) -> Any:
        asked.append(problem.count)
        return fit_simulator(problem, *rest, **named)

    monkeypatch.setattr("rsgen.identification.identify.fit_simulator", spy)
    best, simulated = ranking.best, list(asked)
    alone = identify(late, ranking.model)
    assert (len(simulated), len(asked)) == (0, 1)
    # the same values but for what corners leave of a truncated waveform
    np.testing.assert_allclose([one.value for one in best], [one.value for one in alone], rtol=0.02)
    assert best.verdict.state == "rejected"
    assert [f.names["kind"] for f in ranking.findings if f.code == "background-missing"] == ["phase"]
    (turned,) = (f for f in alone.findings if f.code == "channels-delayed")
    assert turned["turn"] == pytest.approx(-0.03, rel=0.01)
    # the best law has the channel that is off, and not the background that a ranking takes it for
    codes = [f.code for f in best.findings]
    assert (codes.count("channels-delayed"), codes.count("background-missing")) == (1, 0)
    assert any(f.names.get("background") for f in best.findings if f.code == "no-law-fits")


FEWER = [rsgen.laws[name] for name in ("cubic-spring", "odd-power-spring", "coulomb", "stribeck")]


@pytest.mark.parametrize(("level", "seed", "rivals"), [
    # along the motion of a Stribeck law a point near the stop gave the fifth harmonic a noise of 21 %
    ([4e-3, 6e-3], 0, FEWER),
    # noise has one size; relative to the motion that of the last points is ten times as large
    ([6e-3], 2, MEMORYLESS), ([6e-3], 7, MEMORYLESS),
])  # fmt: skip
def test_noise_of_small_motions_and_harmonics_does_not_make_a_wrong_law_the_best_of_decays(
    level: list[float], seed: int, rivals: list[rsgen.Law]
) -> None:
    values = {"k": 12000.0, "k3": 4e8, "c": 0.6, "Ff": 0.25}
    blade = Oscillator(0.5, "k*x + k3*x**3 + c*v + Ff*sign(v)", values)
    plan = rsgen.DecayTest(level=level, duration=4, rate=2000, noise_relative=1e-3, seed=seed)
    best = rank(rsgen.simulate(blade, plan), rivals, mass=0.5).candidates[0]
    assert best.name == "cubic-spring + coulomb"
    assert len(level) == 1 or best.held_out_error < 0.01


def test_the_right_spring_of_a_decay_is_first() -> None:
    # noise of harmonics, of the motion and of the force, which follows from slopes, have sizes of their own
    known = {"k": 24674.0, "c": 0.9425, "k3": 1.85e9}
    plan = rsgen.DecayTest(level=[2e-3], duration=10.6, rate=1200, noise_relative=1e-3, seed=4)
    decay = rsgen.simulate(Oscillator(1.0, "k*x + c*v + k3*x**3", known), plan)
    rivals = [rsgen.laws[name] for name in ("cubic-spring", "sinh-spring", "odd-power-spring")]
    assert rank(decay, rivals, mass=1.0).candidates[0].name == "cubic-spring"


def test_a_response_that_is_divided_by_the_force_is_rejected_after_one_round(monkeypatch: pytest.MonkeyPatch):
    table, along, followed = measured("cubic"), PointTest.along, list[str]()

    def spy(test: PointTest, candidate: CandidateLaw, before: Round | None) -> Any:
        followed.append(candidate.name)
        return along(test, candidate, before)

    monkeypatch.setattr(PointTest, "along", spy)
    divided = table.harmonics[:, :2] / table.force[:, None]
    ranking = rank(changed(table, harmonics=divided), MEMORYLESS)
    assert codes(ranking) >= {"no-law-fits"}
    assert len(followed) == 1


def test_a_round_says_of_how_many_points_its_own_were_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    table = measured("cubic")
    law = CandidateLaw("", BASE.elements, {"k": STIFFNESS, "c": DAMPING, "m": MASS})
    # a response that is no part of the others at every level
    spoil = (np.arange(len(table)) % 25 == 3)[:, None]
    spoilt = changed(table, harmonics=np.where(spoil, 2.0, 1.0) * table.harmonics)
    for most, sample in ((500, {"points": len(table)}), (60, {"points": 60, "all": len(table)})):
        monkeypatch.setattr("rsgen.identification.ranking.reference._MAX_POINTS", most)
        along = PointTest(spoilt, BASE, ()).along(law, None)
        assert along is not None
        (found,) = along.exclusions(along.leader)
        assert found["excluded"] > 0
        assert {name: int(found[name]) for name in found.numbers if name != "excluded"} == sample


def test_rounds_are_compared_at_the_points_of_all() -> None:
    """A motion with fewer points, and less misfit there, was taken before one that has more."""
    test = PointTest(measured("cubic"), BASE, ())
    whole = test.along(CandidateLaw("", BASE.elements, {"k": STIFFNESS, "c": DAMPING, "m": MASS}), None)
    assert whole is not None
    size = np.abs(whole.leader.residual[:, whole.rows.compared]).max(axis=1)
    inside = np.flatnonzero(size < np.median(size))
    leader = replace(whole.leader, residual=whole.leader.residual[inside])
    fewer = replace(whole, reference=whole.reference.select(inside), leader=leader)
    rounds = [_Compared(test, one, [], []) for one in (fewer, whole)]
    assert _best_round(rounds) is rounds[1]


def test_a_ranking_names_level_and_frequencies_of_the_points_that_it_excludes() -> None:
    table = measured("cubic", 2e-3)
    level, near = table.levels[-2], np.abs(table.frequency - 11.0) < 0.6
    spoil = (table.level == level) & near
    assert 5 <= np.count_nonzero(spoil) < 0.1 * len(table)
    spoilt = changed(table, harmonics=np.where(spoil[:, None], 1.5, 1.0) * table.harmonics)
    ranking = rank(spoilt, ["c*v + k*x + kn*x**3", "k*x + c*v"])
    (run,) = (f for f in ranking.findings if f.code == "points-excluded" and "level" in f.numbers)
    assert run["level"] == level
    assert abs(run["low"] - table.frequency[spoil].min()) < 0.3
    assert abs(run["high"] - table.frequency[spoil].max()) < 0.3
    # the counts of all levels are those of the ranking, and say so: a fit excludes other points
    assert "comparison" in sentence(run)
    counted = [f.names for f in ranking.findings if f.code == "points-excluded" and f != run]
    assert {"by": "ranking"} in counted


@pytest.mark.thorough
def test_motions_that_the_simulation_misses_decide_nothing() -> None:
    # the lowest level just overcomes the preload, where a force more or less is everything
    speed = 2 * np.pi * 10 * AMPLITUDE
    table = simulated("F0*sign(x) + cq*v*abs(v)", np.linspace(9, 13, 40), F0=0.2 * FORCE, cq=DAMPING / speed)
    ranking = rank(table, MEMORYLESS)
    assert ranking.fits
    assert ranking.candidates[0].name == "preload + quadratic-damper"


FRICTION = [rsgen.laws[name] for name in ("coulomb", "power-damper", "tanh-friction")]


CUBIC = ["k*x + c*v", "k*x + k3*x**3 + c*v"]


@pytest.mark.parametrize("fault", ["sign", "sense"])
@pytest.mark.parametrize(
    ("law", "candidates"), [("cubic", CUBIC), pytest.param("coulomb", FRICTION, marks=pytest.mark.thorough)]
)
def test_a_structure_that_feeds_the_exciter_is_rejected(law: str, candidates: list[Any], fault: str) -> None:
    table = measured(law)
    spoilt = -table.harmonics if fault == "sign" else np.conj(table.harmonics)
    ranking = rank(changed(table, harmonics=spoilt), candidates)
    assert not ranking.fits
    assert ranking.verdict.state == "rejected"
    assert "structure-feeds-exciter" in codes(ranking)
    assert ("mass-negative" in codes(ranking)) == (fault == "sign")
    assert "law-fits-best" not in codes(ranking)
    for said in ("rejected: ", "structure-feeds-exciter"):
        assert said in str(ranking)


@pytest.mark.slow
def test_a_background_does_not_reverse_a_sensor() -> None:
    table = measured("cubic")
    spoilt = changed(table, harmonics=-table.harmonics)
    ranking = rank(spoilt, CUBIC, Observation(background="phase"))
    assert ranking.verdict.state == "doubtful"
    assert "phase-turned" in codes(ranking)
    assert "law-fits-best" not in codes(ranking)
    for about in (Observation(background="phase"), None):
        right = rank(table, CUBIC, about)
        assert right.verdict.state == "identified"
        assert "rejected" not in str(right)


@pytest.mark.slow
def test_one_frequency_does_not_determine_the_mass() -> None:
    table = measured("cubic")
    one = table.select(table.frequency == table.frequency[12])
    with pytest.raises(RsgenError, match="give it, or tests at more than one frequency"):
        rank(one, BASE)
    assert rank(one, Model(BASE.elements, MASS)).candidates


@pytest.mark.slow
@pytest.mark.usefixtures("few_laws")
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_few_points_are_said_to_be_few() -> None:
    table = measured("cubic")
    few = rank(table.select(np.arange(0, len(table), len(table) // 4)[:4]), BASE)
    assert {"ranking-few-points", "law-nearest"} <= codes(few)
    assert "law-fits-best" not in codes(few)
    level = rank(table.select(table.level == table.levels[-1]), BASE)
    assert "ranking-few-points" in codes(level)


@pytest.mark.parametrize(("error", "severity"), [(0.05, "warning"), (0.58, "doubt")])
def test_a_law_whose_levels_do_not_predict_each_other_is_not_called_best(error, severity, monkeypatch):
    def spoil(current: Round, best: CandidateFit, candidates: list[Candidate], *doubts: Any) -> Assessment:
        first = replace(candidates[0], held_out_error=error)
        return assess_best(current, best, [first, *candidates[1:]], *doubts)

    monkeypatch.setattr("rsgen.identification.ranking.rank_laws.assess_best", spoil)
    ranking = rank(measured("cubic"), CUBIC)
    (worse,) = [finding for finding in ranking.findings if finding.code == "levels-predicted-worse"]
    assert worse.severity == severity
    assert ranking.verdict.state == ("doubtful" if severity == "doubt" else "identified")
    assert ("law-fits-best" in codes(ranking)) == (severity == "warning")


def test_a_mean_is_one_number_a_point() -> None:
    # in this noise neighbouring means agree by chance, as in one test of three thousand
    truth = Oscillator(1.5, "k*x + k3*x**3 + c*v", {"k": 5920.0, "k3": 3e5, "c": 3.8})
    test = SimulatedTest(np.linspace(2, 12, 6), np.linspace(8.5, 12.5, 33), harmonics=1, accuracy=1e-7)
    ranking = rank(add_noise(rsgen.simulate(truth, test), 0.01, seed=6), ["k*x + k3*x**3 + c*v", "k*x + c*v"])
    assert ranking.fits


def test_a_law_that_cannot_be_identified_is_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise RsgenError("follows none of the points")

    monkeypatch.setattr("rsgen.identification.ranking.rank_laws.identify", refuse)
    ranking = rank(measured("cubic"), CUBIC)
    assert ranking.verdict.state == "doubtful"
    (doubt,) = ranking.verdict.decided_by
    assert sentence(doubt).endswith("cannot be identified by itself: follows none of the points")


def test_the_verdict_of_a_ranking_is_that_of_its_best_law() -> None:
    table = measured("cubic")
    # one level of another amplifier
    wrong = changed(table, force=table.force * np.where(table.level == table.levels[-1], 1.02, 1.0))
    ranking = rank(wrong, CUBIC)
    assert ranking.best.verdict.state == ranking.verdict.state != "identified"


def test_a_tied_law_whose_formula_contains_the_best_one_is_said_to_contain_it() -> None:
    names = (
        "cubic-spring", "joint-polynomial", "odd-power-spring", "cubic-spring + quintic-spring",
        "cubic-spring + quadratic-spring", "quadratic-spring + odd-power-spring",
    )  # fmt: skip
    tied = [Candidate(name, "", 4, np.nan, 0.0, True, {}) for name in names]
    # a law that contains it ties with it, too, and is not named, unless fundamentals alone do not show it
    for odd_alone, named in ((False, ""), (True, ", cubic-spring + quadratic-spring")):
        rows = type("Rows", (tuple,), {"sensors": "", "odd_alone": odd_alone})(range(90))
        current: Any = SimpleNamespace(counted="points", rows=rows, noise=0.0067)
        for sure in (True, False):
            best = sentence(_best_law_finding(tied, current, known=True, sure=sure))
            assert best.endswith(f"; this test does not separate it from: odd-power-spring{named}")


@pytest.mark.thorough
def test_a_gap_on_both_sides_is_told_from_a_stop_on_one_by_their_own_motions():
    # along one motion without a mean both give the same fundamentals, the stop with twice the stiffness
    both, one = "k*x + kc*(Max(0, x - b) + Min(0, x + b)) + c*v", "k*x + kc*Max(0, x - b) + c*v"
    truth = rsgen.Oscillator(0.9, both, {"k": 9e3, "kc": 2.4e4, "b": 4e-4, "c": 3.1})
    plan = rsgen.SimulatedTest(
        level=[0.5, 1.5, 4], frequency=np.linspace(13, 24, 40), noise_relative=0.008, seed=0
    )
    made = rsgen.simulate(truth, plan)
    surface = rsgen.ResponseSurface(made.level, made.frequency, made.force, made.harmonics[:, 1])
    ranking = rank(surface, [one, both])
    assert ranking.verdict.usable
    assert "Min" in ranking.candidates[0].force


@pytest.mark.parametrize("code", ["damping-feeds-energy", "not-converged"])
def test_a_law_that_feeds_energy_into_a_decay_is_not_first_where_another_fits(
    code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A Stribeck law with a negative part came first for a plucked beam, and was to be gone on with."""
    feeding = Finding(code, "doubt", "c", quantities(value=-1.0, share=2.0))

    def doubted(surface: ResponseSurface, model: Model) -> Identification:
        found = identify(surface, model)
        return changed_result(found, findings=(*found.findings, feeding)) if "ka" in found.values else found

    plan = rsgen.DecayTest(level=[2e-3], duration=6, rate=1200, noise_relative=1e-3, seed=4)
    values = {"k": 24674.0, "c": 0.9425, "k3": 1.85e9}
    decay = rsgen.simulate(Oscillator(1.0, "k*x + c*v + k3*x**3", values), plan)
    rivals = ["ka*x + c*v + k3*x**3", "k*x + c*v + k3*x**3 + k5*x**5"]
    assert "ka" in rank(decay, rivals, mass=1.0).candidates[0].values
    monkeypatch.setattr("rsgen.identification.ranking.rank_laws.identify", doubted)
    # of a fit without intervals the values alone say it
    monkeypatch.setattr(CandidateFit, "feeds", lambda fit, rows: "ka" in fit.candidate.values)
    ranking = rank(decay, rivals, mass=1.0)
    assert ["k5" in one.force for one in ranking] == [True, False]
    assert ranking.candidates[1].fault.startswith("a damper of it would feed energy")
    assert ranking.verdict.usable
    # without another one it stays, and is doubted: nothing says to go on with it
    alone = rank(decay, rivals[:1], mass=1.0)
    assert (alone.candidates[0].fault, alone.verdict.state) == ("", "doubtful")
    (advice,) = ranking_steps(alone, alone.verdict.state)
    assert "none to go on with" in advice
    assert "To go on with this law" in ranking_steps(ranking, ranking.verdict.state)[0]
