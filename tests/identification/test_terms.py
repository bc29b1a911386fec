"""Terms beside a law: what a law lacks, and what intervals say of it."""

import functools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import rsgen as rs
from rsgen.identification.misfit import background_findings
from rsgen.identification.results.alternatives import Alternative, Alternatives
from rsgen.report.sentences import next_step, sentence
from tests.samples import cubic_surface
from tests.surfaces import codes, noisy
from tests.virtual import fundamentals, only, simulated

CUBIC, LINEAR = "k*x + c*v + k3*x**3", "k*x + c*v"
LAW = f"{CUBIC} + cq*v*abs(v)"
TRUE, HARDENING = {"k": 5920.0, "c": 2.0, "k3": 2.0e5, "cq": 1.2}, {"k": 5920.0, "c": 4.0, "k3": 2e5}
BALANCED = {"method": "harmonic-balance", "noise_relative": 0.01}


def measured(law: str, values: dict[str, float], levels: list[float]) -> rs.ResponseSurface:
    return simulated(law, values, levels, (8.5, 12, 30), noise_relative=1e-3, seed=1)


def test_what_fundamentals_do_not_show_is_said_with_what_it_moves():
    """An even force of a twentieth of the spring's: k3 is off by what is said, and is k3 - (10/9) k2^2/k."""
    k2, values = 25000.0, {"k": TRUE["k"], "c": TRUE["c"], "k3": 4.0e6}
    whole = measured(f"{CUBIC} + k2*x**2", values | {"k2": k2}, [0.4, 0.8, 1.2, 1.6])
    found = rs.identify(fundamentals(whole), CUBIC)
    said = only(found, "even-terms-not-seen")
    share = k2 * said["amplitude"] / TRUE["k"] / said["even"]
    assert said.parameter == "k3"
    off = found["k3"].value / values["k3"] - 1
    assert abs(off) > 3 * found["k3"].standard_error / values["k3"]
    assert said["moved"] * share**2 == pytest.approx(off, rel=0.2)
    factor = float(said.names["determined"].split(" - ")[1].split("*")[0])
    assert factor == pytest.approx(10 / 9, rel=0.15)
    assert said.names["determined"].endswith("*k2**2/k")
    combined = values["k3"] - factor * k2**2 / TRUE["k"]
    assert found["k3"].interval[0] < combined < found["k3"].interval[1]
    assert "even-terms-not-seen" not in codes(rs.identify(whole, CUBIC))


def test_what_fundamentals_do_not_show_of_a_spring_without_a_linear_term_has_no_stiffness_to_name():
    values = {"k": TRUE["k"], "c": TRUE["c"], "k3": 4.0e6, "a": 20.0}
    law = "k*sin(a*x)/a + c*v + k3*x**3"
    found = rs.identify(fundamentals(measured(law, values, [0.4, 0.8, 1.2, 1.6])), law)
    assert found["k"].value == pytest.approx(TRUE["k"], rel=0.01)


def test_an_alternative_is_what_a_fit_with_it_finds():
    """Values of an alternative are those of the law with the term; errors are those of unequal noise."""
    law = f"{LAW} + c3*v**3"
    surface = measured(law, TRUE | {"c3": 0.05}, [1.0, 2.0, 4.0, 6.0])
    found, free = rs.identify(surface, LAW), rs.identify(surface, law)
    off = abs(found["cq"].value - TRUE["cq"])
    assert found.verdict.state != "identified" or off < 2 * found["cq"].standard_error
    others = found.alternatives
    errors, by_noise = (
        dict(zip(one.names, one.error.tolist(), strict=True)) for one in (others, free.alternatives)
    )
    term = rs.compare_fits(found).fits[0].shifted("", others.kinds["term"]["v**3"], errors)
    for one in term.estimates:
        assert one.value == pytest.approx(free[one.name].value, abs=by_noise[one.name])
        assert 0.99 < one.standard_error / by_noise[one.name] < 2


def test_a_term_widens_an_interval_by_its_shift_times_its_likelihood():
    hidden, unseen = Alternative(1.3, 1.0, np.array([0.3, 0.0])), Alternative(0.0, 1.0, np.zeros(2))
    several = replace(hidden, columns=4)
    error, values = np.array([0.1, 0.1]), np.array([2.0, 1.0])
    assert unseen.weight == 0.5
    assert 0.99 < Alternative(4.0, 1.0, values).weight < 1
    assert several.weight == 0
    assert replace(several, value=4.0).weight == 1
    ratio, said = Alternatives(("c", "m"), error, {"term": {"v**3": hidden}}).judge(values, 0.01)
    assert ratio == pytest.approx([np.sqrt(1 + 9 / (1 + np.exp(-(1.3**2) / 2))), 1.0])
    assert [(one.code, one.severity, one.parameter) for one in said] == [("intervals-widened", "info", "c")]
    assert Alternatives(("c", "m"), 3 * error, {"term": {"v**3": hidden}}).judge(values, 0.01)[1] == []


@pytest.mark.parametrize(("band", "named"), [((8.5, 12.0), False), ((10.5, 14.0), True)])
def test_values_that_rest_on_a_response_without_other_modes_are_named(band, named):
    """On one side of the resonance a flexibility that noise hides moves k by many standard errors."""
    values = {"k": 5920.0, "c": 4.0, "k3": 3e5}
    surface = simulated(CUBIC, values, [1, 2, 4], (*band, 20), noise_relative=0.01)
    found = rs.identify(surface, CUBIC)
    other = rs.identify(surface, CUBIC, rs.Observation(background="residuals"))
    assert found.verdict.state == "identified"
    said = [f for f in found.findings if f.code == "law-ambiguous" and "background" in f.names]
    assert len(said) == named
    for finding in said:
        assert {"k", "m"} <= set(finding.names["parameters"].split(", "))
        alone, whole = (fit[finding.parameter].standard_error for fit in (found, other))
        assert finding["shift"] == pytest.approx(1.96 * np.sqrt(whole**2 - alone**2), rel=0.3)


def test_a_drag_that_is_missing_is_proposed_though_dry_friction_has_more_gain_to_first_order():
    surface = measured(LAW, TRUE | {"cq": 6.0, "c": 4.0}, [2.0, 5.0, 10.0])
    found = rs.identify(surface, CUBIC)
    gain = {name: one.gain for name, one in found.alternatives.kinds["term"].items()}
    assert gain["sign(v)"] > gain["v*abs(v)"]
    misfit = only(found, "law-does-not-fit")
    assert (misfit.names["term"], misfit["left"] < 0.002) == ("v*abs(v)", True)
    assert "also" not in misfit.names
    assert "parts-disagree" in codes(found)


def test_terms_that_a_test_does_not_tell_apart_are_proposed_together():
    drag = f"{LINEAR} + cq*v*abs(v)", {"k": 5920.0, "c": 0.5, "cq": 6.0}
    found = rs.identify(simulated(*drag, [4, 10], (9.85, 10.15, 12), noise_relative=0.02), LINEAR)
    misfit = only(found, "law-does-not-fit")
    assert {misfit.names["term"], misfit.names["also"]} == {"v**3", "v*abs(v)"}


def asymmetric(**signals: object) -> rs.ResponseSurface:
    """An asymmetric spring of which some harmonics are other than recorded."""
    law = f"{CUBIC} + k2*x**2", {"k": 5200.0, "c": 0.9, "k2": 9e5, "k3": 3.5e8}
    surface = simulated(*law, [0.1, 0.2, 0.4, 0.7], (15, 19, 41), 0.48, noise_relative=0.005)
    harmonics = np.array(surface.harmonics)
    for name, factor in signals.items():
        harmonics[:, int(name[1:])] *= factor
    return replace(surface, harmonics=harmonics, origin="measured")


def test_of_a_systematic_misfit_the_harmonic_that_carries_most_of_it_is_named():
    found = rs.identify(asymmetric(h0=-1.0), f"{CUBIC} + k2*x**2")
    assert only(found, "law-does-not-fit").names["where"] == "harmonic 2"


def test_where_fundamentals_alone_lack_a_spring_an_even_one_is_proposed_too():
    found = rs.identify(fundamentals(asymmetric()), CUBIC, mass=0.48)
    misfit = only(found, "law-does-not-fit")
    assert misfit.names["term"] in {"x**5", "x*abs(x)"}
    assert misfit.names["even"]
    assert "m is taken as exact" in str(found)
    unseen = only(found, "even-terms-not-seen")
    assert (unseen.names["side"], unseen["moved"] < 0) == ("below", True)
    whole = rs.identify(asymmetric(), CUBIC)
    assert all("even" not in finding.names for finding in whole.findings)
    assert f"a mass other than m = {whole['m'].value:.4g} kg shows a wrong ratio" in str(whole)


def test_a_spring_that_is_nothing_has_its_largest_share_of_the_force():
    test = simulated(LINEAR, {"k": 6000.0, "c": 4.0}, [2, 5], (9, 11, 15), **BALANCED)
    found = rs.identify(test, f"{CUBIC} + c3*v**3")
    unseen = {one.parameter: one for one in found.findings if one.code == "not-distinct-from-zero"}
    cubic, size = unseen["k3"], found.amplitude_range[1]
    k3 = found["k3"]
    whole = found["k"].value / size**2 + k3.value
    assert cubic["share"] == pytest.approx((abs(k3.value) + 1.96 * k3.standard_error) / whole, rel=1e-2)
    assert "share" not in unseen["c3"].numbers
    assert "other levels" in sentence(cubic)
    assert "leave its term out" not in sentence(cubic)


@pytest.mark.parametrize(("term", "values", "levels", "noise", "names"), [
    ("Ff*tanh(v/vs)", {"vs": 2e-3, "Ff": 0.8}, [2, 5], 0.01, {"smooth": "tanh(v/vs)", "jump": "sign(v)"}),
    # its interval reaches zero, as the exponent is in its unit, where the term is all of the hardening
    ("kp*sign(x)*abs(x)**p", {"kp": 3e8, "p": 3.6}, [1, 2], 0.03, {"exponent": "p"}),
])  # fmt: skip
def test_a_value_that_is_nothing_may_be_no_term_to_leave_out(term, values, levels, noise, names):
    law, linear = f"{LINEAR} + {term}", {"k": 6000.0, "c": 4.0}
    how = BALANCED | {"noise_relative": noise}
    said = rs.identify(simulated(law, linear | values, levels, (9, 11, 15), **how), law)[next(iter(values))]
    assert (said.finding.code, said.finding.names) == ("not-distinct-from-zero", names)
    assert "in a law without it" not in sentence(said.finding)


@pytest.mark.parametrize("hardens", ["b**2", "abs(b)"])
def test_a_coefficient_that_cannot_be_negative_is_said_to_be_so_where_it_goes_to_zero(hardens):
    found = rs.identify(cubic_surface(levels=4, frequencies=31), f"k1*x + {hardens}*x**3 + c1*v")
    assert only(found, "not-converged").names == {"flat": "b"}
    assert next_step(only(found, "not-converged")).startswith("Write the coefficient itself")
    assert found["b"].finding.names == {"flat": "yes"}
    fewer = rs.identify(cubic_surface(levels=4, frequencies=31), f"k1*x - {hardens}*x**3 + c1*v")
    assert "not-converged" not in codes(fewer)


def test_a_law_of_which_most_parameters_are_nothing_is_doubtful():
    test = simulated(LINEAR, {"k": 5920.0, "c": 4.0}, [0.5, 1, 2], (8.5, 12, 30), noise_relative=1e-2)
    found = rs.identify(test, f"{LINEAR} + a*x**3 + b*x**5 + d*v**3 + e*v**5", mass=1.5)
    assert sum(one.identifiable for one in found) == 2
    said = only(found, "nothing-identifiable")
    assert said in found.verdict.decided_by
    assert (said["known"], said["parameters"]) == (2, 6)


@pytest.mark.parametrize(("band", "noise", "delay"), [
    ((6, 18), 0.004, -1e-3), ((8, 12), 0.01, 2e-4), ((9, 11), 0.0, 2e-4), ((8, 12), 0.004, -8e-3),
    ((8, 12), 0.001, -2e-3),
])  # fmt: skip
def test_a_delay_between_the_channels_is_named_with_its_value(band, noise, delay):
    values = {"k": 6000.0, "k3": 2e5, "c": 4.0}
    test = simulated(CUBIC, values, [2, 5, 10], (*band, 60), noise_relative=noise)
    late = fundamentals(test, test.harmonics[:, 1] * np.exp(-1j * test.omega * delay))
    found = rs.identify(late, CUBIC)
    said = only(found, "channels-delayed")
    assert said["delay"] == pytest.approx(delay, rel=0.02)
    assert said["left"] < max(0.02 * said["misfit"], noise)
    assert said in found.verdict.decided_by
    # half a turn of noise in a narrow band: a phase error does the same
    assert ("turn" in said.numbers) is (band == (8, 12) and delay == 2e-4)
    assert not {"law-does-not-fit", "channels-delayed"} & codes(rs.identify(test, CUBIC))
    # what a mass that gives way gains is no misfit of the points, which a background would explain
    weighed = rs.identify(late, CUBIC, mass=1.5, mass_error=0.01)
    assert only(weighed, "channels-delayed")["delay"] == pytest.approx(delay, rel=0.02)
    # a background, which has more values, does not hide it
    others = rs.Observation(background="residuals")
    hidden = only(rs.identify(late, CUBIC, others), "channels-delayed")
    assert hidden["delay"] == pytest.approx(delay, rel=0.02)
    assert hidden["left"] < 1.05 * hidden["behind"]
    right = fundamentals(test, test.harmonics[:, 1] + test.force / 6e5)
    assert rs.identify(right, CUBIC, others).verdict.state == "identified"


def test_a_delay_of_a_part_of_a_period_is_named_with_its_value_by_the_fit_that_is_advised():
    test, delay = measured(CUBIC, HARDENING, [2.0, 5.0, 10.0]), 0.03
    late = fundamentals(test, test.harmonics[:, 1] * np.exp(-1j * test.omega * delay))
    said = only(rs.identify(late, LAW), "structure-feeds-exciter")
    assert next_step(said).startswith('Identify with [identify] background = "phase"')
    told = only(rs.identify(late, CUBIC, rs.Observation(background="phase")), "channels-delayed")
    assert told["delay"] == pytest.approx(delay, rel=0.02)


@pytest.mark.parametrize(("noise", "turn"), [(0.01, -0.05), (0.003, 0.05)])
def test_a_phase_that_is_off_everywhere_is_named_with_its_value(noise, turn):
    test = measured(CUBIC, HARDENING, [2.0, 5.0, 10.0])
    seen = noisy(replace(test, harmonics=test.harmonics * np.exp(1j * turn * np.arange(8))), noise, 1)
    said = only(rs.identify(seen, CUBIC), "channels-delayed")
    assert said["turn"] == pytest.approx(turn, rel=0.1)
    # with more noise a delay does the same in this band
    assert ("delay" in said.numbers) is (noise == 0.01)


@pytest.mark.parametrize("law", [LINEAR, f"{LINEAR} + k5*x**5", "k*x + k3*x**3 + cq*v*abs(v)"])
@pytest.mark.parametrize("noise", [0.001, 0.01])
def test_a_wrong_law_is_not_blamed_on_the_channels(law, noise):
    test = measured(CUBIC, HARDENING, [2.0, 5.0, 10.0])
    said = codes(rs.identify(noisy(test, noise, 2), law))
    assert "channels-delayed" not in said
    assert "law-does-not-fit" in said or noise == 0.01


@functools.cache
def driven_base() -> rs.ResponseSurface:
    return simulated(CUBIC, HARDENING, [1.3, 3.3, 6.7], (8, 12, 50), base="acceleration")


def seen_on_base(*, absolute, gain=0.0, turn=0.0, delay=0.0, noise=0.001, line=0.0) -> rs.ResponseSurface:
    """Return a test of a driven base of which one sensor, of the absolute or relative motion, is wrong.

    ``line`` is the inertia of modes below, which both sensors see, per mass of the moving one.
    """
    test = driven_base()
    driven = test.force / test.omega**2
    base = driven if absolute else 0.0
    by = (1 + gain) * np.exp(1j * (turn - test.omega * delay))
    error = noise * np.random.default_rng(1).normal(size=(2, len(test)))
    read = by * (test.harmonics[:, 1] - line * driven + base) * (1 + error[0] + 1j * error[1]) - base
    return fundamentals(test, read, base="acceleration")


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize(("name", "value"), [("gain", -0.02), ("turn", 0.0175), ("delay", 2e-4)])
def test_a_sensor_of_a_driven_base_that_is_off_is_named_with_its_value(absolute, name, value):
    test = seen_on_base(absolute=absolute, **{name: value})
    found = rs.identify(test, CUBIC)
    said = only(found, "channels-delayed")
    assert found.verdict.state == "doubtful"
    assert said[name] == pytest.approx(value, rel=0.05)
    if name == "gain":
        assert abs(said["gain"] - value) < said["within"] < 0.1 * abs(value)
        ranking = rs.rank(test, [LINEAR, CUBIC])
        assert only(ranking, "channels-delayed")["gain"] == pytest.approx(value, rel=0.05)


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize(("gain", "line"), [(0.01, 0.0), (0.0, 0.05)])
def test_a_background_does_not_hide_that_a_sensor_of_a_driven_base_is_off(absolute, gain, line):
    test = seen_on_base(absolute=absolute, gain=gain, noise=0.01, line=line)
    found = rs.identify(test, CUBIC, rs.Observation(background="residuals"))
    # other modes are no ratio of the sensors; they are a background, and the values are right
    assert found.verdict.state == ("doubtful" if gain else "identified")
    for said in [only(found, "channels-delayed")] if gain else []:
        assert abs(said["gain"] - gain) < said["within"] < 0.3 * gain
        assert said["left"] == pytest.approx(said["behind"], rel=0.1)
        assert said.names["background"] == "residuals"


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize("law", [CUBIC, LINEAR, f"{LINEAR} + k3*x*abs(x)"])
def test_sensors_of_a_driven_base_are_not_blamed_for_a_law(absolute, law):
    right = seen_on_base(absolute=absolute)
    said = codes(rs.identify(right, law))
    assert "channels-delayed" not in said
    assert ("law-does-not-fit" in said) is (law != CUBIC)


@pytest.mark.parametrize(("moved", "named"), [(-0.5, True), (-790.0, False)])
def test_a_background_that_moves_a_value_absurdly_is_no_advice(moved, named):
    found = SimpleNamespace(covariance=np.array([[1e-6]]), parameters=np.array([1.0]))
    other, how = SimpleNamespace(shift=np.array([moved])), {"misfit": 0.26, "left_by_term": 0.2}
    assert bool(background_findings({"phase": other}, {"phase": 0.001}, found, ["k3"], **how)) == named
