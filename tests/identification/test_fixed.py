"""Values that are known beforehand: a fixed parameter is a number in the law, and is stated as fixed."""

import functools
import re
from dataclasses import replace

import numpy as np
import pytest

import rsgen
from rsgen.cases.faults import CaseError
from rsgen.common.finding import Finding, reasons_of, steps_once
from rsgen.data.surface.mode_findings import fixed_contradicted, mode_findings
from rsgen.formula.reading import parse
from rsgen.identification.fitting import least_squares
from rsgen.identification.results.result import changed, mass_lines
from rsgen.law.motion import sine_motion
from rsgen.law.numeric import compile_law
from rsgen.report.sentences import next_step, state_verdict
from tests.case_files import Literal, write_small
from tests.case_files import law as case_law
from tests.surfaces import LAWS, MASS, beside, codes, noisy, surface
from tests.virtual import fundamentals, only, simulated

NOISE = 0.01
LAW = LAWS["cubic"][0]
BLAMED = {"law-does-not-fit", "law-ambiguous", "parts-disagree", "not-converged"}
"""What a wrong value that is stated as known must not be taken for."""


@pytest.mark.parametrize(("law", "name", "wrong"), [
    ("cubic", "k", 6200.0), ("piecewise", "b", 0.012), ("cubic", "kn", -2.4e5), ("combined", "cn", 1.35),
])  # fmt: skip
def test_a_wrong_value_is_contradicted_by_the_points(law, name, wrong):
    (text, true), test = LAWS[law], noisy(surface(law), NOISE, 1)
    asked = rsgen.identify(test, text, fixed={name: wrong})
    said = only(asked, "fixed-contradicted")
    assert (said.parameter, said.severity, said["given"]) == (name, "doubt", wrong)
    assert said in asked.verdict.decided_by
    assert not codes(asked) & BLAMED
    assert said["fitted"] == pytest.approx(true[name], rel=5e-3)
    assert "fixed-contradicted" not in codes(rsgen.identify(test, text, fixed={name: true[name]}))


@pytest.mark.parametrize(("times", "wrong"), [(1.006, ""), (1, "gains"), (1, "pick-up"), (1, "law")])
def test_a_mass_hardly_off_comes_first_where_another_leaves_noise(times, wrong):
    law = "cubic" if wrong != "law" else "combined"
    test = noisy(surface(law), 1e-3, 1)
    gains = 1 + 0.006 * np.sin(3 * test.level)
    test = replace(test, force=test.force * gains) if wrong == "gains" else test
    test = beside(test, 0.01 * test.force / 5920) if wrong == "pick-up" else test
    asked = rsgen.identify(test, LAWS[law][0], mass=times * MASS)
    assert ("fixed-contradicted" in codes(asked)) == (not wrong)
    if not wrong:
        assert [one.code for one in asked.verdict.decided_by] == ["fixed-contradicted"]
        assert not codes(asked) & BLAMED


@pytest.mark.parametrize(("times", "said"), [
    (3.0, "is 3 times the one that the points show"), (100.0, "as cm from m"), (2.2046, "pounds"),
    (39.478, "divided by f^2 in place of"), (6.2832, "velocities divided by f"),
])  # fmt: skip
def test_a_wrong_mass_is_named_by_what_makes_one(times, said):
    moved = (1 - times) * MASS
    assert said in next_step(fixed_contradicted("m", times * MASS, moved, misfit=0.05, left=0.01, times=9.0))


@pytest.mark.parametrize("times", [2.0, 1000.0, 1.3])
def test_a_mass_in_another_unit_is_named_and_not_the_law_blamed(times):
    few = surface("cubic", np.linspace(2, 12, 3))
    asked = rsgen.identify(noisy(few, NOISE, 1), LAW, mass=times * MASS)
    found = only(asked, "fixed-contradicted")
    assert found["fitted"] == pytest.approx(MASS, rel=5e-3)
    assert found.names.get("near") == {2.0: "peak-to-peak", 1000.0: "milli"}.get(times)
    assert asked.verdict.state == ("rejected" if times > 1.5 else "doubtful")
    assert not codes(asked) & BLAMED


@pytest.mark.parametrize("law", ["cubic", "coulomb", "piecewise"])
@pytest.mark.parametrize("times", [0.01, 0.1, 9.81])
def test_a_mass_far_off_comes_first_whatever_a_fit_makes_of_it(law, times):
    test = noisy(surface(law), NOISE, 1)
    if (law, times) in (("cubic", 9.81), ("piecewise", 0.1)):
        # the phase that a wrong mass turns hides none
        seen = rsgen.Observation(background="phase" if law == "piecewise" else "none")
        asked = rsgen.identify(test, LAWS[law][0], seen, mass=times * MASS).verdict.decided_by
        assert asked[0].code == "fixed-contradicted"
    (said,) = mode_findings(test, times * MASS)
    assert said["fitted"] == pytest.approx(MASS, rel=0.02)
    assert f"the given mass is {times:.2g}" in next_step(said)
    assert not mode_findings(test, 1.5 * MASS)


def test_next_to_a_background_no_unit_of_the_mass_is_blamed():
    """Where all points lie above a resonance, a pick-up looks as another mass to a mode without a law."""
    test = surface("cubic", frequencies=np.linspace(11, 20, 40))
    seen = beside(test, -0.1 * test.force / (2 * np.pi * 10 * 3.8))
    assert mode_findings(noisy(seen, NOISE, 1), MASS)
    background = rsgen.Observation(background="constant")
    asked = rsgen.identify(noisy(seen, NOISE, 1), LAW, background, mass=MASS)
    assert "fixed-contradicted" not in codes(asked)


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("columns", ["complex", "amplitudes"])
def test_exchanged_channels_are_named(order, columns):
    test = noisy(surface("cubic"), NOISE, 1)
    rate = (1j * test.omega) ** order
    pushed, moved = test.harmonics[:, 1] * rate, test.force
    if columns == "amplitudes":
        pushed, moved = np.abs(pushed), np.abs(moved) * np.exp(1j * np.angle(pushed / moved))
    read = fundamentals(test, moved / rate, pushed)
    (said,) = mode_findings(read, MASS)
    assert said.names["is"] == "exchanged"
    assert not mode_findings(test, MASS)
    if (order, columns) == (0, "complex"):
        found = rsgen.identify(read, LAW)
        assert found.verdict.decided_by[0].names.get("is") == "exchanged"


def test_the_sign_of_a_channel_is_named_and_no_negative_mass_in_place_of_a_given_one():
    test = noisy(surface("cubic"), NOISE, 1)
    shaken = replace(test, force=-test.force / MASS, base="acceleration", per_mass=True)
    for mass in (None, MASS):
        asked = rsgen.identify(shaken, LAW, mass=mass)
        assert only(asked, "base-misread").names["is"] == "sign"
        assert not codes(asked) & {"fixed-contradicted", "mass-negative"}
    asked = rsgen.identify(fundamentals(test, force=-test.force), LAW, mass=MASS)
    assert only(asked, "mass-negative")["mass"] == pytest.approx(-MASS, rel=5e-3)
    assert not codes(asked) & {"fixed-contradicted", *BLAMED}


@pytest.mark.parametrize(("given", "fault"), [
    ({"fixed": {"b": 1.0}}, "fixed: 'b': no parameter; allowed are c, k, kn, m"),
    ({"fixed": {"k": "5"}}, "fixed.k: '5'; must be a number"),
    ({"fixed": {"k": np.inf}}, "fixed.k: is inf; a number is needed"),
    ({"fixed": {"m": -1.0}}, "mass: is -1 kg; a number above 0 is needed"),
    ({"fixed": [("k", 1.0)]}, "fixed: "),
    ({"mass": 1.5, "mass_error": 0.0}, "mass_error: is 0 kg; a number above 0 is needed"),
    ({"mass_error": 0.1}, "mass_error: 0.1 kg, but no mass is given"),
])  # fmt: skip
def test_what_cannot_be_known_beforehand_is_refused(given, fault):
    with pytest.raises(rsgen.RsgenError, match=re.escape(fault)):
        rsgen.identify(surface("cubic"), LAW, **given)


def test_a_case_fixes_values_and_refuses_those_that_cannot_be(tmp_path):
    def case(fixed):
        changes = case_law("k*x + kn*x**3", "c*v", k=5920, kn=-2.2e5, c=3.8)
        changes |= {"identify.fixed": Literal(f"{{ {fixed} }}")}
        return rsgen.load_case(write_small(tmp_path, "fixed", changes))

    assert dict(case('k = "5.92 kN/m", m = 1.5').model.fixed) == {"k": 5920.0, "m": 1.5}
    for fixed, fault in (
        ('b = "3 mm"', "identify.fixed.b: is no parameter of the elements; known: c, k, kn, m"),
        ('k = "3 mm"', "identify.fixed.k: "),
        ("m = -1", "identify.mass: is -1 kg"),
    ):
        with pytest.raises(CaseError, match=re.escape(fault)):
            case(fixed)


def test_columns_of_fixed_parameters_move_nothing():
    generator = np.random.default_rng(1)
    matrix, residual = generator.normal(size=(30, 2, 3)), generator.normal(size=(30, 2))

    def linearise(parameters: np.ndarray, nuisance: np.ndarray) -> least_squares.Linearisation:
        return least_squares.Linearisation(residual - matrix @ parameters, np.zeros((30, 2, 0)), matrix)

    rules = least_squares.Rules(free=np.array([True, False, True]))
    whole = least_squares.fit(linearise, np.array([0.0, 0.5, 0.0]), np.zeros((30, 0)), rules, exclude=False)
    flat, right = matrix.reshape(60, 3), (residual - 0.5 * matrix[:, :, 1]).ravel()
    own = np.linalg.lstsq(flat[:, [0, 2]], right, rcond=None)[0]
    assert whole.parameters == pytest.approx([own[0], 0.5, own[1]], rel=1e-12)
    assert whole.freedom == 58
    assert not whole.covariance[1].any()
    assert not whole.influence[:, :, 1].any()


def test_a_law_with_numbers_is_the_law():
    law = compile_law(parse("k*x + c*v + Piecewise((0, abs(x) < b), (k2*(x - b*sign(x)), True))"))
    motion = sine_motion(np.array([10.0, 20.0]), np.array([0.5, 2.0]))
    values = {"b": 1.0, "c": 2.0, "k": 3.0, "k2": 4.0}
    whole = law.along(motion, law.ordered(values), 64)
    part = law.at({"b": 1.0, "k": 3.0})
    assert part.parameters == ("c", "k2")
    found = part.along(motion, part.ordered(values), 64)
    assert np.array_equal(found.force, whole.force)
    assert np.array_equal(found.by_parameter, [whole.by_parameter[1], whole.by_parameter[3]])
    assert law.at({}) is law


def test_a_value_that_was_fixed_at_zero_is_no_factor_of_another():
    how = {"misfit": 0.05, "left": 0.01, "times": 9.0}
    assert fixed_contradicted("c2", 0.0, 5.0, **how).names == {}
    assert fixed_contradicted("m", 2.0, -1.0, **how).names == {"near": "peak-to-peak"}


@pytest.mark.parametrize(("law", "place", "noise"), [
    ("cubic", 0, 1e-3), ("cubic", 2, 1e-3), ("coulomb", 0, 1e-2),
])  # fmt: skip
def test_a_level_whose_channel_has_another_gain_is_named(law, place, noise):
    test = surface(law)
    level = float(test.levels[place])
    response = noisy(test, noise, 1).harmonics[:, 1] * np.where(test.level == level, 1.05, 1)
    for mass in (MASS, None):
        found = rsgen.identify(fundamentals(test, response), LAWS[law][0], mass=mass)
        assert "fixed-contradicted" not in codes(found)
        said = only(found, "law-does-not-fit")
        assert said["level"] == level
        assert said["gain"] == pytest.approx(1 / 1.05, rel=3e-3 + 2 * noise)


def test_a_wrong_mass_is_no_gain_of_a_level():
    """One factor of all levels turns a given mass into another; what is left of the gains is chance."""
    test = surface("cubic")
    response = test.harmonics[:, 1] * np.where(test.level == test.levels[2], 1.002, 1)
    found = rsgen.identify(fundamentals(test, response), LAWS["cubic"][0], mass=1.07 * MASS)
    assert only(found, "fixed-contradicted")["fitted"] == pytest.approx(MASS, rel=3e-3)
    assert "law-does-not-fit" not in codes(found)


def test_of_levels_with_several_gains_the_one_that_is_farthest_off_is_named():
    test = surface("coulomb")
    by = np.select([test.level == test.levels[0], test.level == test.levels[2]], [1.05, 0.97], 1.0)
    found = rsgen.identify(fundamentals(test, test.harmonics[:, 1] * by), LAWS["coulomb"][0])
    said = only(found, "law-does-not-fit")
    assert (said["level"], said["factor"]) == (test.levels[0], pytest.approx(1 / 1.05, rel=0.02))


@pytest.mark.parametrize("pair", [(0, 1), (2, 3)])
def test_levels_with_each_others_responses_per_force_are_named(pair):
    """What is the response per force times its level grows with the level in any order of the files."""
    test = surface("cubic")
    test = test.select(np.isin(test.level, test.levels[:4]))
    test = replace(test, harmonics=noisy(test, NOISE / 10, 1).harmonics)
    low, high = (float(test.levels[place]) for place in pair)
    swapped = np.where(test.level == low, high, np.where(test.level == high, low, test.level))
    by = swapped / test.level
    read = fundamentals(test, by * test.harmonics[:, 1], by * test.force, level=swapped)
    (said,) = mode_findings(read, MASS, (), False)
    # without a law, or where one fits as they were read, so small a misfit accuses no levels
    assert not mode_findings(read, MASS)
    assert not mode_findings(read, MASS, (), True)
    assert (said.code, said["low"], said["high"]) == ("levels-swapped", low, high)
    assert not mode_findings(test, MASS)
    verdict = rsgen.identify(read, LAW).verdict
    stated = state_verdict(verdict)
    assert verdict.decided_by[0] == said
    # the cause comes first, and what follows from it has neither a sentence nor a step of its own
    assert len(stated["sentences"]) > 1
    assert reasons_of(stated)[0] == stated["sentences"][0]
    assert steps_once(stated) == [next_step(said)]


@pytest.mark.parametrize("place", [0, 1, 3])
@pytest.mark.parametrize("read", ["exchanged", "+1", "sign", "sense", "milli", "peak-to-peak"])
def test_one_level_that_was_read_otherwise_than_the_others_is_named(read, place):
    test = surface("cubic")
    test = noisy(test.select(np.isin(test.level, test.levels[:4])), NOISE, 1)
    here, response = test.level == test.levels[place], test.harmonics[:, 1]
    other = {"+1": 1j * test.omega, "sign": -1, "milli": 1e3, "peak-to-peak": 2}.get(read, 1) * response
    other = response.conj() if read == "sense" else other
    pushed, moved = (other, test.force) if read == "exchanged" else (test.force, other)
    wrong = fundamentals(test, np.where(here, moved, response), np.where(here, pushed, test.force))
    known = [Finding("levels-swapped", "doubt", "", {"low": 1.0, "high": 2.0, "pushed": 2.0, "moved": 0.5})]
    (said,) = mode_findings(wrong, None, known, False)
    assert (said.names.get("is", said.names.get("near")), said["level"]) == (read, test.levels[place])
    if said.code == "levels-disagree":
        assert said["gain"] == pytest.approx(np.abs(other / response)[0])
    assert not mode_findings(test, None, (), False)
    assert mode_findings(wrong, None, known, True) == known
    if (read, place) == ("+1", 1):
        assert rsgen.identify(wrong, LAW).verdict.decided_by[0] == said


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize("read", ["exchanged", "sign"])
def test_one_level_of_a_driven_base_that_was_read_otherwise_is_named(read, absolute):
    test = surface("cubic")
    test = noisy(test.select(np.isin(test.level, test.levels[:4])), NOISE, 1)
    here, base = test.level == test.levels[2], test.force / MASS / test.omega**2
    top, table = test.harmonics[:, 1] + absolute * base, base
    if read == "sign":
        top = np.where(here, -top, top)
    else:
        top, table = np.where(here, table, top), np.where(here, top, table)
    shaken = {"base": "acceleration", "per_mass": True, "level": test.level / MASS}
    wrong = fundamentals(test, top - absolute * table, table * test.omega**2, **shaken)
    (said,) = mode_findings(wrong, None, (), False)
    assert (said.names["is"], said["level"]) == (read, test.levels[2] / MASS)


def test_two_levels_alone_accuse_each_other_of_nothing_that_curves_may_leave():
    test = surface("piecewise")
    test = test.select(np.isin(test.level, test.levels[[0, 2, 4, 5]]))
    test = replace(test, harmonics=noisy(test, NOISE / 10, 1).harmonics)
    first, second = test.levels[:2]
    by = np.where(test.level == first, second / first, np.where(test.level == second, first / second, 1.0))
    read = fundamentals(test, by * test.harmonics[:, 1], by * test.force, level=test.level * by)
    (said,) = mode_findings(read, MASS)
    assert said.code == "levels-swapped"
    assert said["misfit"] > 0.03
    pair = read.select(read.level <= second)
    assert not mode_findings(pair, MASS)
    negative = Finding("mass-negative", "error", "m")
    codes_of = [one.code for one in mode_findings(read, MASS, [negative], False)]
    assert codes_of == ["mass-negative", "levels-swapped"]


TWO_SIDES = "Piecewise((k1*x, x > 0), (k2*x, True)) + c1*v + c2*v*abs(v)"
SIDES = {"k1": 9800.0, "k2": 7000.0, "c1": 1.4, "c2": 9.0}


@functools.cache
def two_sides() -> rsgen.ResponseSurface:
    """Fundamentals of a spring that is softer to one side, whose stiffnesses a mass moves much."""
    how = {"noise_relative": 2.5e-3, "seed": 1}
    return fundamentals(simulated(TWO_SIDES, SIDES, [0.5, 1, 2, 4], (15, 26, 56), 0.5, **how))


def moves(found):
    """Return by cause by how many per cent its one per cent moves each value, as said."""
    said = found.outcome.names["moves"].split("; ")
    parts = (re.fullmatch(r"(\S+) % of (.*) moves (.*)", one).groups() for one in said)
    each = {cause: (float(part), re.findall(r"(\w+) by (\S+) %", own)) for part, cause, own in parts}
    return {
        cause: {name: float(by.replace("−", "-")) / part for name, by in own}
        for cause, (part, own) in each.items()
    }


def test_what_a_given_mass_moves_is_that_of_the_fit():
    asked = rsgen.identify(two_sides(), TWO_SIDES, mass=0.5)
    assert asked.verdict.state == "identified"
    line, _ = mass_lines(asked)
    less, more = (rsgen.identify(two_sides(), TWO_SIDES, mass=m) for m in (0.4995, 0.5005))
    for name, by in moves(asked)["m"].items():
        assert by == pytest.approx((more[name].value / less[name].value - 1) / 2e-3, rel=0.1, abs=0.2)
    assert "0.1 % of m moves c1 by 0" in line
    assert mass_lines(asked, rms=True) == [line]
    cubic = rsgen.identify(noisy(surface("cubic"), NOISE, 1), LAW, mass=MASS)
    assert "read as peak, kn is 2 times too large (or the reverse)" in mass_lines(cubic)[1]


@pytest.mark.parametrize("error", [None, 1e-3 * MASS, 0.02 * MASS])
def test_what_an_error_of_a_sensor_moves_is_that_of_the_fit(error):
    test, given = noisy(surface("cubic"), NOISE, 1), {"mass": MASS, "mass_error": error}
    asked = rsgen.identify(test, LAW, **given)
    assert asked.verdict.state == "identified"
    said = {cause: own for cause, own in moves(asked).items() if cause != "m"}
    assert said["the force"].keys() == said["the response"].keys() == {one.name for one in asked}
    for cause, signal in (("the force", "force"), ("the response", "harmonics")):
        again = rsgen.identify(replace(test, **{signal: 1.001 * getattr(test, signal)}), LAW, **given)
        for name, by in said[cause].items():
            assert by == pytest.approx(1e3 * (again[name].value / asked[name].value - 1), abs=0.06)
    # where the mass follows the test, a value in N^a m^b moves by -b
    if error == 0.02 * MASS:
        assert said["the response"] == {"c": -1, "k": -1, "kn": -3, "m": -1}
    elif error is None:
        assert said["the response"]["c"] == -1
        assert said["the response"]["kn"] < -2


@pytest.mark.parametrize("mass", [0.4985, 0.504])
def test_a_mass_that_is_hardly_wrong_is_doubted_where_it_moves_a_value_by_much(mass):
    asked = rsgen.identify(two_sides(), TWO_SIDES, mass=mass)
    (said,) = asked.verdict.decided_by
    assert (said.code, said.parameter) == ("fixed-contradicted", "m")
    assert said["fitted"] == pytest.approx(0.5, rel=2e-3)
    # next to too small a mass the stiffer side is too stiff
    assert ("by −" in said.names.get("moves", "")) == (mass < 0.5)


def test_a_mass_with_an_error_is_one_more_equation():
    asked = rsgen.identify(two_sides(), TWO_SIDES, mass=0.505, mass_error=0.005)
    assert asked.verdict.state == "identified"
    for name, true in (SIDES | {"m": 0.5}).items():
        assert asked[name].interval[0] < true < asked[name].interval[1]
    assert asked["m"].standard_error < 0.005
    assert mass_lines(asked)[0].startswith("m, given as 0.505 ± 0.005 kg (standard error), is with the test")
    assert not asked.fixed
    assert moves(asked).keys() == {"the force", "the response"}
    # a symmetric law with a background fits as well where the mass allows what it moves, three of 0.3 g
    assert asked["k1"].standard_error > 1000
    assert rsgen.identify(two_sides(), TWO_SIDES, mass=0.5, mass_error=3e-4)["k1"].standard_error < 200


def test_a_mass_with_an_error_is_between_one_that_is_exact_and_one_that_is_not_known():
    test = noisy(surface("cubic"), NOISE, 1)
    for error, known in ((1e-6, 1.001 * MASS), (1e3, None)):
        asked = rsgen.identify(test, LAW, mass=1.001 * MASS, mass_error=error)
        for one in rsgen.identify(test, LAW, mass=known):
            assert asked[one.name].value == pytest.approx(one.value, rel=1e-6)
            assert asked[one.name].standard_error == pytest.approx(one.standard_error, rel=5e-3)
    told = rsgen.identify(test, LAW)["m"]
    found = rsgen.identify(test, LAW, mass=1.001 * MASS, mass_error=told.standard_error)
    asked = found["m"]
    assert rsgen.profile(found, "m").interval == pytest.approx(asked.interval, rel=1e-4)
    assert asked.value == pytest.approx((told.value + 1.001 * MASS) / 2, abs=0.1 * told.standard_error)
    assert asked.standard_error == pytest.approx(told.standard_error / 2**0.5, rel=0.05)


def test_a_mass_many_of_its_errors_off_is_contradicted():
    test = noisy(surface("cubic"), NOISE, 1)
    for off, said in ((2, []), (6, ["fixed-contradicted"])):
        asked = rsgen.identify(test, LAW, mass=MASS + 0.01 * off, mass_error=0.01)
        assert [one.code for one in asked.verdict.decided_by] == said
        assert asked["m"].value == pytest.approx(MASS, rel=2e-3)
    (found,) = asked.verdict.decided_by
    assert found["fitted"] == pytest.approx(MASS, rel=2e-3)
    # an error that is much smaller than one per cent, which no engineer weighs by, is taken at its word
    told = rsgen.identify(test, LAW, mass=0.995 * MASS, mass_error=5e-4 * MASS)
    assert [one.code for one in told.verdict.decided_by] == ["fixed-contradicted"]
    # a pattern of less than a hundredth of the force moves no mass by three hundredths
    test = noisy(surface("cubic"), NOISE / 10, 1)
    gained = replace(test, force=test.force * (1 + 0.006 * np.sin(3 * test.level)))
    for off, said in ((1, set()), (1.03, {"fixed-contradicted"})):
        asked = rsgen.identify(gained, LAW, mass=off * MASS, mass_error=5e-3 * MASS)
        assert {one.code for one in asked.verdict.decided_by} == said
        assert codes(asked) & {"law-does-not-fit", "fixed-contradicted"} == (said or {"law-does-not-fit"})


def test_where_forces_follow_the_mass_all_linear_values_have_its_error():
    test, given = noisy(surface("cubic"), NOISE, 1), {"mass": MASS, "mass_error": 0.02 * MASS}
    shaken = replace(test, force=test.force / MASS, base="acceleration", per_mass=True)
    exact, asked = (rsgen.identify(shaken, LAW, **one) for one in ({"mass": MASS}, given))
    for one in (*exact, *exact.fixed):
        both = np.hypot(one.standard_error, 0.02 * abs(one.value))
        assert (asked[one.name].value, asked[one.name].standard_error) == pytest.approx((one.value, both))
    assert not asked.fixed
    assert asked.verdict.state == exact.verdict.state == "identified"
    assert mass_lines(asked)[0].startswith("m, given as 1.5 ± 0.03 kg (standard error), is not checked")
    # of a given motion of the base the response is that of any mass
    bands = [rsgen.predict(one, [1.5]).curves[0].upper for one in (exact, asked)]
    assert bands[1] == pytest.approx(bands[0], nan_ok=True)
    infinite = replace(asked["m"], standard_error=np.inf)
    others = tuple(one for one in asked.refined if one.name != "m")
    assert "is not determined with the test;" in mass_lines(changed(asked, refined=(*others, infinite)))[0]
    table = rsgen.modal_table(shaken, **given)
    for error, said in ((0.1, " ± 0.2"), (0.0, ", given"), (np.nan, ", its error not determined")):
        assert str(replace(table, mass_error=error)).partition("\n")[0].endswith(f"mass 1.5 kg{said}")
    assert (table.mass, table.mass_error) == pytest.approx((MASS, 0.02 * MASS))
    with pytest.raises(rsgen.RsgenError, match="a term of the law without a free factor"):
        rsgen.identify(shaken, "5920*x + kn*x**3 + c*v", **given)
