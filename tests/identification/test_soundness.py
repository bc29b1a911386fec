"""What makes a result doubtful or wrong: each tampered test is found, each sound one is not."""

from dataclasses import replace

import numpy as np
import pytest

from rsgen import Observation, ResponseSurface, identify
from rsgen.common.finding import Finding, Quantity
from rsgen.formula.reading import parse
from rsgen.identification.results import Estimate
from rsgen.identification.results.estimates import damping_findings
from rsgen.identification.soundness import points_at
from rsgen.law.motion import sine_motion
from rsgen.law.numeric import compile_law
from tests.surfaces import MASS, beside, changed, errors, model, noisy, severities, surface
from tests.virtual import fundamentals, only, simulated


def said(table: ResponseSurface, law: object = model("cubic")) -> dict[str, str]:
    """Identify a law; return the severities of what is found, by code."""
    return severities(identify(table, law))


@pytest.mark.parametrize(("law", "curve"), [("k*x", "c(X)"), ("c*v", "k(X)")])
def test_round_off_of_a_law_that_lacks_a_term_has_no_sign(law, curve):
    found = identify(noisy(surface("cubic"), 0.01, 2), law, mass=MASS).findings
    assert curve not in {finding.names["curve"] for finding in found if finding.code == "curve-negative"}


@pytest.mark.parametrize("levels", [(0.53, 0.62), (0.53, 0.62, 0.68)])
def test_friction_that_nearly_holds_the_mass_is_identified_by_what_moves(levels):
    """At 1.06 times the friction a hundredth of the force moves the mass; at 1.24 it stops in every cycle."""
    law, values = "k*x + c*v + Ff*sign(v)", {"k": 1e4, "c": 1.0, "Ff": 0.5}
    found = identify(simulated(law, values, levels, (13, 19, 19), 1.0), law)
    assert found.verdict.state == "identified"
    assert "friction" in {finding.names.get("by") for finding in found.findings}
    assert max(errors(found, {**values, "m": 1.0}).values()) < 1e-4


@pytest.mark.parametrize("levels", [(0.2, 0.45, 2, 5), (0.1, 0.2, 0.45, 5)])
def test_noise_of_levels_that_friction_holds_does_not_reject_the_law(levels):
    """The law says that they are at rest, and the phases of neighbours that they are noise."""
    law, values = "k*x + c*v + Ff*sign(v)", {"k": 1e4, "c": 2.0, "Ff": 0.5}
    exact = simulated(law, values, levels, (13, 19, 13), 1.0)
    draws = np.random.default_rng(1).standard_normal((2, len(exact)))
    noise = 1e-4 * exact.amplitude.max() * (draws[0] + 1j * draws[1])
    table = fundamentals(exact, exact.harmonics[:, 1] + noise)
    found = identify(table, law)
    assert found.verdict.state == "identified"
    assert max(errors(found, {**values, "m": 1.0}).values()) < 0.01
    (left,) = (finding for finding in found.findings if finding.names.get("by") == "friction")
    assert left["excluded"] == np.count_nonzero(exact.amplitude == 0)
    (rests,) = (finding for finding in identify(exact, law).findings if "by" in finding.names)
    assert (rests.names["by"], rests["excluded"]) == ("standstill", left["excluded"])
    assert "law-does-not-fit" in severities(identify(table, "k*x + c*v + k3*x**3"))
    # the lowest level moves, and friction holds the highest one
    named = {levels[0]: 5.0, 5.0: levels[0]}
    level = np.array([named.get(one, one) for one in table.level])
    swapped = fundamentals(table, level=level, force=table.force * level / table.level)
    assert {"levels-swapped", "points-excluded"} <= said(swapped, law).keys()


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "expected"), [(0.03, ""), (0.14, "doubt"), (0.5, "error")])
def test_noise_is_judged_by_its_size(noise, expected):
    few = surface("cubic", np.linspace(2, 12, 3), np.linspace(8, 12, 21))
    assert said(noisy(few, noise, 5)).get("misfit-large", "") == expected


@pytest.mark.parametrize(("size", "expected"), [(0.01, "warning"), (0.05, "doubt")])
def test_a_systematic_misfit_of_a_hundredth_decides_the_verdict(size, expected):
    exact = surface("cubic")
    gain = 1 + size * np.sin(2 * np.pi * exact.frequency)
    table = noisy(changed(exact, harmonics=exact.harmonics * gain[:, None]), 0.002, 1)
    found = identify(table, model("cubic"))
    assert only(found, "law-does-not-fit").severity == expected
    assert (found.verdict.state == "identified") == (expected == "warning")


@pytest.mark.slow
@pytest.mark.parametrize(("drag", "term"), [(1.5, "tanh(v)"), (-0.2, "v*abs(v)")])
def test_a_damper_that_feeds_energy_is_doubted(drag, term):
    values = {"k": 5920.0, "kn": 0.0, "c": 2.0, "cn": drag}
    found = identify(noisy(surface("combined", values=values), 0.01, 1), f"k*x + c*v + A*{term}")
    assert found["A"].value < 0
    why = only(found, "damping-feeds-energy")
    assert (why.parameter, why in found.verdict.decided_by) == ("A", True)


@pytest.mark.slow
def test_a_law_that_is_active_by_design_is_judged_by_its_whole_work():
    """Motions below twice the displacement of zero damping live on the damper of van der Pol."""
    truth, values = "k*x + c*(x**2/a**2 - 1)*v", {"k": 5920.0, "c": 2.0, "a": 0.004}
    test = simulated(truth, values, [4.0, 7.0, 10.0], (8, 12, 40), harmonics=5, accuracy=1e-7)
    found = identify(noisy(test, 0.003, 1), "k*x - c*v + b*x**2*v")
    assert found.verdict.state == "identified"
    assert max(errors(found, {"k": 5920.0, "c": 2.0}).values()) < 0.03


SERIES = "d1*v + d2*v*abs(v) + d3*v**3 + d4*v**3*abs(v) + t*tanh(v)"
UNDERFLOWS = "c*v + Fd*exp(-(v/vs)**2)*sign(v)"


@pytest.mark.parametrize(("text", "changes", "feeding"), [
    (SERIES, {"d3": -4.3747e6}, []), (SERIES, {"d4": -4.3747e6}, ["d4"]), (SERIES, {"d1": -100.0}, ["d1"]),
    (SERIES, {"d1": -100.0, "d2": -1.0, "d3": 1.0}, ["d1", "d2"]), (SERIES, {"t": -100.0}, ["t"]),
    # of a friction of no size at the motion no power of the motion is known
    (UNDERFLOWS, {"c": 1.0, "Fd": -1.0, "vs": 3e-5}, ["Fd"]),
])  # fmt: skip
def test_a_term_of_a_series_between_others_bends_its_curve(text, changes, feeding):
    """Eq. (26) of Liu et al.: the damping of their joint, d3 below zero, takes energy all the same."""
    law, motion = compile_law(parse(text)), sine_motion(np.full(3, 300.0), np.array([1e-5, 3e-5, 1e-4]))
    joint = {"d1": 322.0, "d2": 7.8791e4, "d3": 0.0, "d4": 7.6782e7, "t": 0.0}
    values = (joint if text == SERIES else {}) | changes
    known = [Estimate(name, value, 0.0, (value, value)) for name, value in values.items()]
    found = damping_findings(law, motion, law.ordered(values), known)
    assert [finding.parameter for finding in found] == feeding


@pytest.mark.slow
@pytest.mark.parametrize("code", ["another-quantity", "not-passive", ""])
def test_no_background_is_advised_that_does_not_help_or_hides_a_sign_or_a_quantity(code):
    exact = surface("cubic")
    # a background takes a sign or a quantity up as well, but adding it would hide the mistake
    table = noisy(beside(exact, 0.3 / 5920 * exact.force) if code else exact, 0.003, 1)
    if code:
        found = said(replace(table, findings=(Finding(code, "doubt"),)))
    else:
        found = said(replace(table, origin="measured"), "k*x + c*v")
    assert "law-does-not-fit" in found
    assert "background-missing" not in found


def test_points_at_the_limit_of_a_record_are_counted():
    table = noisy(surface("cubic"), 0.01, 2)

    def remarked(limit: float) -> str:
        numbers = {"samples": Quantity(3000), "limit": Quantity(limit, "m/s^2")}
        names = {"record": "a.csv", "signal": "response"}
        clipped = Finding("range-reached", "warning", "", numbers, names)
        return said(replace(table, findings=(clipped,)))["range-reached"]

    seen = np.sort(table.amplitude * table.omega**2)
    assert remarked(seen[-len(seen) // 10]) == "doubt"
    assert remarked(seen[-3]) == "warning"


@pytest.mark.slow
def test_harmonics_of_noise_are_no_steady_sine():
    exact = surface("cubic")
    generator = np.random.default_rng(7)

    def with_noise(size: float) -> ResponseSurface:
        harmonics = np.array(exact.harmonics[:, :6])
        shape = (len(exact), 4)
        noise = generator.normal(size=shape) + 1j * generator.normal(size=shape)
        harmonics[:, 2:] = size * np.abs(harmonics[:, 1:2]) * noise
        return changed(exact, harmonics=harmonics)

    found = [said(with_noise(size)).get("not-a-steady-sine") for size in (0.03, 0.3, 2.0)]
    assert found == [None, "doubt", "error"]


def test_points_left_out_have_a_reason():
    law = "k*x + k3*x**3 + c*v", {"k": 6000.0, "k3": 2e5, "c": 4.0}
    surface = simulated(*law, [2, 5, 10], (8, 12, 41), noise_relative=0.003)
    harmonics = surface.harmonics.copy()
    harmonics[20] *= 1.5
    seen = Observation(hold_out=[5.0], band=(8.45, 12.0))
    found = identify(replace(surface, harmonics=harmonics), law[0], seen)
    curve, row = found.curve, np.arange(len(surface))
    held, outside = surface.level == 5, surface.frequency < 8.45
    expected = np.where(held, "held out", np.where(outside, "outside the band", ""))
    expected[row == 20] = "excluded"
    assert curve.reason.tolist() == expected.tolist()
    assert np.array_equal(curve.reason == "", curve.used)


def test_few_points_are_named_one_by_one() -> None:
    level, frequency = np.array([1, 2, 3, 4, 4, 4, 4.0]), np.arange(10, 17)
    named = "1 N at 10 Hz; 2 N at 11 Hz; 3 N at 12 Hz; 4 N at 13, 14, 15 Hz"
    assert points_at(level[:6], frequency[:6], "N") == named
    assert points_at(level, frequency, "N").endswith("3 N at 12 Hz; other levels")
    assert points_at(level[3:], frequency[3:], "N") == "4 N at 13, 14, 15, 16 Hz"


@pytest.mark.slow
def test_an_outlier_at_a_jump_takes_no_point_before_a_fold_with_it() -> None:
    """It pulls the balance off, whose forces then lie beyond folds of the law."""
    law = "k*x + ks*(Max(0, x - b) + Min(0, x + b)) + c*v + Ff*sign(v)"
    values = {"k": 5040.0, "ks": 3200.0, "b": 1.1e-3, "c": 1.135, "Ff": 0.06}
    how = {"noise_relative": 0.007, "sweep": "up", "seed": 0}
    test = simulated(law, values, [0.294, 0.588, 0.98, 1.77], (8, 19, 111), 1.0, **how)
    motion, rows = test.harmonics[:, 1].copy(), np.flatnonzero(test.level == 0.588)
    last = rows[np.argmax(-np.diff(np.abs(motion[rows])))]
    motion[last] *= 0.3
    found = identify(fundamentals(test, motion, sweep="up"), law, mass=1.0)
    assert np.flatnonzero(~found.curve.used).tolist() == [last]
    assert found.verdict.state == "identified"


def test_points_beyond_a_fold_that_a_falling_force_holds_are_no_warning() -> None:
    """An exciter without a controller keeps motions that no held force keeps."""
    law, damper = "k*x + c*v + k3*x**3 + Ff*sign(v)", 8.0
    # the exciter is a damper of the structure, and what it takes is no force on the structure
    driven = {"k": 6e3, "c": 2.0 + damper, "k3": 4e8, "Ff": 0.2}
    test = simulated(law, driven, [0.6, 1.2, 2.4, 4.8], (9, 14, 50))
    random = np.random.default_rng(1)
    noise = 1 + 0.004 * (random.standard_normal((2, len(test))) + 1j * random.standard_normal((2, len(test))))
    motion = test.harmonics[:, 1]
    force = (test.force - 1j * test.omega * damper * motion) * noise[0]
    found = identify(fundamentals(test, motion * noise[1], force), law)
    assert found.verdict.state == "identified"
    assert found["Ff"].value == pytest.approx(0.2, rel=0.01)
    excluded = only(found, "points-excluded")
    assert (excluded.severity, excluded.names["by"]) == ("info", "fold")
    assert 2 <= excluded["excluded"] <= 5
    assert excluded.names["where"].startswith("1.2 N at")
    assert points_at(np.array([0.3]), np.array([12.6]), "m/s^2") == "0.3 m/s² at 12.6 Hz"
