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
from rsgen.identification.identify import identify
from rsgen.identification.ranking import rank
from rsgen.identification.ranking.candidate_fit import CandidateFit, CandidateLaw, Round
from rsgen.identification.ranking.rank_laws import _best_round, _Compared
from rsgen.identification.ranking.ranking_result import Candidate, _best_law_finding, assess_best
from rsgen.identification.ranking.reference import PointTest
from rsgen.identification.results import Identification
from rsgen.identification.results import changed as changed_result
from rsgen.report.sentences import ranking_steps, sentence, state_verdict
from tests.ranking.test_ranking import BASE, measured, named, virtual
from tests.surfaces import LAWS, MASS, changed, codes

CUBIC = ["k*x + c*v", "k*x + k3*x**3 + c*v"]
ABOUT = {"k": 5922.0, "c": 2.83, "m": MASS}


def late(law: str) -> ResponseSurface:
    """A channel lags by 0.03 rad at the fundamental."""
    table = measured(law, 2e-3)
    return changed(table, harmonics=table.harmonics * np.exp(-0.03j * np.arange(table.harmonics.shape[1])))


def decayed(law: str, values: dict[str, float], mass: float, level: list[float], **plan: Any) -> Any:
    return rsgen.simulate(Oscillator(mass, law, values), rsgen.DecayTest(level, noise_relative=1e-3, **plan))


def counted(findings: Any, *names: str) -> list[int]:
    """Return how many findings have each of these codes."""
    return [[finding.code for finding in findings].count(name) for name in names]


@pytest.mark.parametrize(("low", "held"), [(1.15, 31), (1.27, 0)])
def test_a_level_that_friction_nearly_holds_does_not_reject_the_law(low: float, held: int) -> None:
    values, grid = {"k": 5920.0, "c": 3.8, "Ff": 1.0}, np.linspace(8.5, 11.5, 31)
    plan = {"harmonics": 5, "accuracy": 1e-6, "noise_relative": 0.0}
    table = virtual("k*x + c*v + Ff*sign(v)", values, [low, 8.0], grid, **plan)
    ranking = rank(table, ["k*x + c*v", "k*x + c*v + Ff*sign(v)", "k*x + c*v + kn*x**3"])
    assert ranking.fits
    assert ranking.candidates[0].name == "c*v + k*x + Ff*sign(v)"
    np.testing.assert_allclose([one.value for one in ranking.best], [1.0, 3.8, 5920.0, MASS], rtol=1e-6)
    by = {one.names["by"]: one for one in ranking.findings if one.code == "points-excluded"}
    assert by.get("friction", {"excluded": 0})["excluded"] == held


def test_a_ranking_in_which_no_law_fits_says_with_which_background_one_would() -> None:
    table, laws = late("cubic"), ["k*x + c*v", "c*v + k*x + kn*x**3"]
    ranking = rank(table, laws)
    assert not ranking.fits
    stated = state_verdict(ranking.verdict)
    assert [one["code"] for one in stated["decided_by"]] == ["no-law-fits", "background-missing"]
    (step,) = steps_once(stated)
    assert 'Rank again with [identify] background = "phase"' in step
    again = rank(table, laws, Observation(background="phase"))
    assert again.fits
    assert again.candidates[0].name == laws[1]


def test_a_ranking_in_which_no_law_fits_names_the_even_force_that_is_missing() -> None:
    values = {"k": 1.2e4, "k2": 6e4, "k3": 6e5, "c": 1.5}
    law, grid = "k*x + k2*x**2 + k3*x**3 + c*v", np.linspace(17, 22, 30)
    table = virtual(law, values, [0.8, 1.5, 3.0, 4.5], grid, 0.8, noise_relative=5e-3, seed=2)
    odd = ["k*x + c*v + k3*x**3", "k*x + c*v + k5*x**5"]
    ranking = rank(table, odd)
    missed, cause = ranking.verdict.decided_by
    assert (missed.code, missed.names["even"], cause.code) == ("no-law-fits", "x**2", "even-force-missing")
    # of both the one of the ranking, once
    assert [f for f in ranking.best.findings if f.code == cause.code] == [cause]
    assert rank(table, [*odd, "k*x + c*v + k2*x**2 + k3*x**3"]).fits


def test_a_second_harmonic_of_the_exciter_decides_no_ranking() -> None:
    table, laws = measured("cubic", 2e-3), ["k*x + c*v", "c*v + k*x + kn*x**3"]
    second = 0.05 * table.force / (ABOUT["k"] - MASS * (2 * table.omega) ** 2)
    is_second = np.arange(table.harmonics.shape[1]) == 2
    shaken = changed(table, harmonics=table.harmonics + np.outer(second, is_second))
    ranking = rank(shaken, laws)
    assert ranking.fits
    assert ranking.verdict.state == identify(shaken, laws[1]).verdict.state == "identified"
    assert not rank(shaken, laws[:1]).fits


@pytest.mark.parametrize("constant", [True, False])
def test_the_zero_of_a_sensor_decides_no_ranking(constant: bool) -> None:
    table, laws = measured("cubic", 2e-3), ["k*x + c*v", "c*v + k*x + kn*x**3"]
    if not constant:
        # amplitudes of one octave do not tell a constant from what a force makes
        table = table.select(table.amplitude > 0.4 * table.amplitude.max())
    moved = table.harmonics + 4e-4 * (np.arange(table.harmonics.shape[1]) == 0)
    ranking = rank(changed(table, harmonics=moved), laws)
    assert ranking.fits == constant
    code = "sensor-offset" if constant else "no-law-fits"
    (offset,) = {one["offset"] for one in (*ranking.findings, *ranking.best.findings) if one.code == code}
    assert offset == pytest.approx(4e-4, rel=0.05)
    assert rank(table, laws).fits


def test_of_a_law_that_does_not_fit_a_background_is_said_once() -> None:
    table = late("piecewise")
    ranking = rank(table, [LAWS["piecewise"][0]])
    assert not ranking.fits
    best, alone = ranking.best, identify(table, ranking.model)
    # the same values but for what corners leave of a truncated waveform
    np.testing.assert_allclose([one.value for one in best], [one.value for one in alone], rtol=0.02)
    # the verdict of a ranking is that of its best law
    assert best.verdict.state == ranking.verdict.state == "rejected"
    assert [f.names["kind"] for f in ranking.findings if f.code == "background-missing"] == ["phase"]
    (turned,) = (f for f in alone.findings if f.code == "channels-delayed")
    assert turned["turn"] == pytest.approx(-0.03, rel=0.01)
    # the best law has the channel that is off, and not the background that a ranking takes it for
    assert counted(best.findings, "channels-delayed", "background-missing") == [1, 0]
    assert any(f.names.get("background") for f in best.findings if f.code == "no-law-fits")


def test_noise_of_small_motions_and_harmonics_does_not_make_a_wrong_law_the_best_of_decays() -> None:
    """Along the motion of a Stribeck law a point near the stop gave the fifth harmonic a noise of 21 %."""
    law, values = "k*x + k3*x**3 + c*v + Ff*sign(v)", {"k": 12000.0, "k3": 4e8, "c": 0.6, "Ff": 0.25}
    decay = decayed(law, values, 0.5, [4e-3, 6e-3], duration=4, rate=2000, seed=0)
    rivals = named("cubic-spring", "odd-power-spring", "coulomb", "stribeck")
    best = rank(decay, rivals, mass=0.5).candidates[0]
    assert best.name == "cubic-spring + coulomb"
    assert best.held_out_error < 0.01


def test_rounds_are_compared_at_the_points_of_all() -> None:
    test = PointTest(measured("cubic"), BASE, ())
    whole = test.along(CandidateLaw("", BASE.elements, ABOUT), None)
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


@pytest.mark.parametrize("fault", ["sign", "sense"])
def test_a_structure_that_feeds_the_exciter_is_rejected(fault: str) -> None:
    table = measured("cubic")
    spoilt = -table.harmonics if fault == "sign" else np.conj(table.harmonics)
    ranking = rank(changed(table, harmonics=spoilt), CUBIC)
    assert not ranking.fits
    assert ranking.verdict.state == "rejected"
    assert "structure-feeds-exciter" in codes(ranking)
    assert ("mass-negative" in codes(ranking)) == (fault == "sign")
    assert "law-fits-best" not in codes(ranking)


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
    def spoil(current: Round, best: CandidateFit, candidates: list[Candidate], *doubts: Any) -> Any:
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
    values, grid = {"k": 5920.0, "k3": 3e5, "c": 3.8}, np.linspace(8.5, 12.5, 33)
    plan = {"harmonics": 1, "accuracy": 1e-7, "seed": 6}
    assert rank(virtual(CUBIC[1], values, np.linspace(2, 12, 6), grid, **plan), CUBIC).fits


def test_a_law_that_cannot_be_identified_is_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise RsgenError("follows none of the points")

    monkeypatch.setattr("rsgen.identification.ranking.rank_laws.identify", refuse)
    ranking = rank(measured("cubic"), CUBIC)
    assert ranking.verdict.state == "doubtful"
    (doubt,) = ranking.verdict.decided_by
    assert sentence(doubt).endswith("cannot be identified by itself: follows none of the points")


def test_a_tied_law_whose_formula_contains_the_best_one_is_said_to_contain_it() -> None:
    names = (
        "cubic-spring", "joint-polynomial", "odd-power-spring", "cubic-spring + quintic-spring",
        "cubic-spring + quadratic-spring", "quadratic-spring + odd-power-spring",
    )  # fmt: skip
    tied = [Candidate(name, "", 4, np.nan, 0.0, True, {}) for name in names]
    # a law that contains it ties with it, too, and is not named, unless fundamentals alone do not show it
    for odd_alone, more in ((False, ""), (True, ", cubic-spring + quadratic-spring")):
        rows = type("Rows", (tuple,), {"sensors": "", "odd_alone": odd_alone})(range(90))
        current: Any = SimpleNamespace(counted="points", rows=rows, noise=0.0067)
        for sure in (True, False):
            best = sentence(_best_law_finding(tied, current, known=True, sure=sure))
            assert best.endswith(f"; this test does not separate it from: odd-power-spring{more}")


@pytest.mark.parametrize("code", ["damping-feeds-energy", "not-converged"])
def test_a_law_that_feeds_energy_into_a_decay_is_not_first_where_another_fits(code: str, monkeypatch) -> None:
    feeding = Finding(code, "doubt", "c", quantities(value=-1.0, share=2.0))

    def doubted(surface: ResponseSurface, model: Model) -> Identification:
        found = identify(surface, model)
        return changed_result(found, findings=(*found.findings, feeding)) if "ka" in found.values else found

    plucked = "k*x + c*v + k3*x**3", {"k": 24674.0, "c": 0.9425, "k3": 1.85e9}, 1.0, [2e-3]
    decay = decayed(*plucked, duration=6, rate=1200, seed=4)
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
    assert "none to go on with" in ranking_steps(alone, alone.verdict.state)[0]
