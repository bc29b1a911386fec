"""Terms beside a law: what a law lacks, and what intervals say of it."""

import functools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rsgen as rs
from rsgen.identification.misfit import background_findings
from rsgen.identification.results.alternatives import Alternative, Alternatives
from rsgen.report.sentences import next_step, sentence
from tests.surfaces import noisy

LAW = "k*x + c*v + k3*x**3 + cq*v*abs(v)"
TRUE = {"k": 5920.0, "c": 2.0, "k3": 2.0e5, "cq": 1.2}


def measured(law: str, values: dict[str, float], levels: list[float], seed: int = 1) -> rs.ResponseSurface:
    test = rs.SimulatedTest(level=levels, frequency=np.linspace(8.5, 12, 30), noise_relative=1e-3, seed=seed)
    return rs.simulate(rs.Oscillator(1.5, law, values), test)


def test_a_damper_that_resembles_another_is_in_the_interval():
    """A cubic damper beside drag leaves a misfit like noise; drag was 30 standard errors off."""
    surface = measured(f"{LAW} + c3*v**3", TRUE | {"c3": 0.2}, [1.0, 2.0, 4.0, 6.0])
    found = rs.identify(surface, LAW)
    cq = found["cq"]
    assert abs(cq.value - TRUE["cq"]) > 0.05 * TRUE["cq"]
    assert abs(cq.value - TRUE["cq"]) < 2 * cq.standard_error or found.verdict.state != "identified"


def test_what_fundamentals_do_not_show_is_said_with_what_it_moves():
    """An even force of a twentieth of the spring's: k3 is off by what is said, and is k3 - (10/9) k2^2/k."""
    cubic, k2 = "k*x + c*v + k3*x**3", 25000.0
    values = {"k": TRUE["k"], "c": TRUE["c"], "k3": 4.0e6}
    levels = [0.4, 0.8, 1.2, 1.6]
    whole = measured(f"{cubic} + k2*x**2", values | {"k2": k2}, levels)
    harmonics = np.full(whole.harmonics.shape, np.nan, dtype=complex)
    harmonics[:, 1] = whole.harmonics[:, 1]
    found = rs.identify(replace(whole, harmonics=harmonics), cubic)
    (said,) = (finding for finding in found.findings if finding.code == "even-terms-not-seen")
    share = k2 * said["amplitude"] / TRUE["k"] / said["even"]
    assert said.parameter == "k3"
    off = found["k3"].value / values["k3"] - 1
    assert abs(off) > 3 * found["k3"].standard_error / values["k3"]
    assert said["moved"] * share**2 == pytest.approx(off, rel=0.2)
    factor = float(said.names["determined"].split(" - ")[1].split("*")[0])
    assert factor == pytest.approx(10 / 9, rel=0.15)
    assert said.names["determined"].endswith("*k2**2/k")
    assert f"as the points determine only {said.names['determined']}" in sentence(said)
    combined = values["k3"] - factor * k2**2 / TRUE["k"]
    assert found["k3"].interval[0] < combined < found["k3"].interval[1]
    codes = {finding.code for finding in rs.identify(whole, cubic).findings}
    assert "even-terms-not-seen" not in codes


def test_what_fundamentals_do_not_show_is_said_of_a_spring_without_a_linear_term():
    """Then k3 - k2**2/k has no k to name; it ended with "'zoo' is not in the language of formulas"."""
    values = {"k": TRUE["k"], "c": TRUE["c"], "k3": 4.0e6, "a": 20.0}
    law = "k*sin(a*x)/a + c*v + k3*x**3"
    whole = measured(law, values, [0.4, 0.8, 1.2, 1.6])
    points = whole.level, whole.frequency, whole.force, whole.harmonics[:, 1]
    found = rs.identify(rs.ResponseSurface(*points), law)
    assert found["k"].value == pytest.approx(TRUE["k"], rel=0.01)


def test_an_alternative_is_what_a_fit_with_it_finds():
    """Values of an alternative are those of the law with the term; errors are those of unequal noise."""
    law = f"{LAW} + c3*v**3"
    surface = measured(law, TRUE | {"c3": 0.05}, [1.0, 2.0, 4.0, 6.0])
    found, free = rs.identify(surface, LAW), rs.identify(surface, law)
    others = found.alternatives
    errors = dict(zip(others.names, others.error.tolist(), strict=True))
    term = rs.compare_fits(found).fits[0].shifted("", others.kinds["term"]["v**3"], errors)
    by_noise = dict(zip(free.alternatives.names, free.alternatives.error.tolist(), strict=True))
    for one in term.estimates:
        assert one.value == pytest.approx(free[one.name].value, abs=by_noise[one.name])
        assert 0.99 < one.standard_error / by_noise[one.name] < 2


def test_a_term_widens_an_interval_by_its_shift_times_its_likelihood():
    """A term of 1.3 standard errors moved a value by three of its own, which its interval ignored."""
    hidden, unseen = Alternative(1.3, 1.0, np.array([0.3, 0.0])), Alternative(0.0, 1.0, np.zeros(2))
    several = replace(hidden, columns=4)
    error, values = np.array([0.1, 0.1]), np.array([2.0, 1.0])
    assert unseen.weight == 0.5
    assert 0.99 < Alternative(4.0, 1.0, values).weight < 1
    assert several.weight == 0
    assert replace(several, value=4.0).weight == 1
    ratio, said = Alternatives(("c", "m"), error, {"term": {"v**3": hidden}}).judge(values, 0.01)
    assert ratio == pytest.approx([np.sqrt(1 + 9 / (1 + np.exp(-(1.3**2) / 2))), 1.0])
    (named,) = said
    assert (named.code, named.severity, named.parameter) == ("intervals-widened", "info", "c")
    assert "2.7 times as wide as noise makes it: it contains the shift by a term v**3" in sentence(named)
    narrow = Alternatives(("c", "m"), 3 * error, {"term": {"v**3": hidden}}).judge(values, 0.01)
    assert narrow[1] == []


@pytest.mark.parametrize(("band", "named"), [((8.5, 12.0), False), ((10.5, 14.0), True)])
def test_values_that_rest_on_a_response_without_other_modes_are_named(band, named):
    """On one side of the resonance a flexibility that noise hides moves k by many standard errors."""
    law = "k*x + c*v + k3*x**3"
    test = rs.SimulatedTest([1, 2, 4], np.linspace(*band, 20), noise_relative=0.01)
    surface = rs.simulate(rs.Oscillator(1.5, law, {"k": 5920.0, "c": 4.0, "k3": 3e5}), test)
    found = rs.identify(surface, law)
    other = rs.identify(surface, law, rs.Observation(background="residuals"))
    assert found.verdict.state == "identified"
    said = [f for f in found.findings if f.code == "law-ambiguous" and "background" in f.names]
    assert len(said) == named
    for finding in said:
        assert {"k", "m"} <= set(finding.names["parameters"].split(", "))
        alone, whole = (fit[finding.parameter].standard_error for fit in (found, other))
        assert finding["shift"] == pytest.approx(1.96 * np.sqrt(whole**2 - alone**2), rel=0.3)


def test_a_drag_that_is_missing_is_proposed_though_dry_friction_has_more_gain_to_first_order():
    surface = measured(LAW, TRUE | {"cq": 6.0, "c": 4.0}, [2.0, 5.0, 10.0])
    found = rs.identify(surface, "k*x + c*v + k3*x**3")
    said = {finding.code: finding for finding in found.findings}
    gain = {name: one.gain for name, one in found.alternatives.kinds["term"].items()}
    assert gain["sign(v)"] > gain["v*abs(v)"]
    misfit = said["law-does-not-fit"]
    assert (misfit.names["term"], misfit["left"] < 0.002) == ("v*abs(v)", True)
    assert "also" not in misfit.names
    # the parts that disagree are named by their levels
    assert "lower and upper levels (2 N; 5, 10 N)" in sentence(said["parts-disagree"])


def test_terms_that_a_test_does_not_tell_apart_are_proposed_together():
    band = np.linspace(9.85, 10.15, 12)
    test = rs.SimulatedTest(level=[4, 10], frequency=band, noise_relative=0.02)
    drag = rs.Oscillator(1.5, "k*x + c*v + cq*v*abs(v)", {"k": 5920.0, "c": 0.5, "cq": 6.0})
    found = rs.identify(rs.simulate(drag, test), "k*x + c*v")
    (misfit,) = (finding for finding in found.findings if finding.code == "law-does-not-fit")
    assert {misfit.names["term"], misfit.names["also"]} == {"v**3", "v*abs(v)"}
    assert f"{misfit.names['term']} or {misfit.names['also']}, times a coefficient" in next_step(misfit)


def asymmetric(**signals: object) -> rs.ResponseSurface:
    """An asymmetric spring of which some harmonics are other than recorded."""
    law, values = "k*x + c*v + k2*x**2 + k3*x**3", {"k": 5200.0, "c": 0.9, "k2": 9e5, "k3": 3.5e8}
    test = rs.SimulatedTest([0.1, 0.2, 0.4, 0.7], np.linspace(15, 19, 41), noise_relative=0.005)
    surface = rs.simulate(rs.Oscillator(0.48, law, values), test)
    harmonics = np.array(surface.harmonics)
    for name, factor in signals.items():
        harmonics[:, int(name[1:])] *= factor
    return replace(surface, harmonics=harmonics, origin="measured")


def test_of_a_systematic_misfit_the_harmonic_that_carries_most_of_it_is_named():
    found = rs.identify(asymmetric(h0=-1.0), "k*x + c*v + k2*x**2 + k3*x**3")
    (misfit,) = (finding for finding in found.findings if finding.code == "law-does-not-fit")
    assert misfit.names["where"] == "harmonic 2"
    assert "systematic, not noise, most of it in harmonic 2 of the response" in sentence(misfit)


def test_where_fundamentals_alone_lack_a_spring_an_even_one_is_proposed_too():
    law, nothing = "k*x + c*v + k3*x**3", {f"h{order}": np.nan for order in (0, 2, 3, 4, 5, 6, 7)}
    found = rs.identify(asymmetric(**nothing), law, mass=0.48)
    (misfit,) = (finding for finding in found.findings if finding.code == "law-does-not-fit")
    assert misfit.names["term"] in {"x**5", "x*abs(x)"}
    assert "an even force, such as k2*x**2, may do the same" in sentence(misfit)
    assert "or an even term, such as k2*x**2, to the law" in next_step(misfit)
    assert "m is taken as exact" in str(found)
    (unseen,) = (finding for finding in found.findings if finding.code == "even-terms-not-seen")
    assert (unseen.names["side"], unseen["moved"] < 0) == ("below", True)
    whole = rs.identify(asymmetric(), law)
    assert all("even" not in finding.names for finding in whole.findings)
    assert f"a mass other than m = {whole['m'].value:.4g} kg shows a wrong ratio of force to response" in str(
        whole
    )
    # rms read as peak in both leaves the mass right
    assert all("m does not show a factor that force and response share" in str(one) for one in (found, whole))
    assert "k3 is 2 times too large" in str(whole)
    assert "under [system] (in Python mass=)" in str(whole)


def test_a_spring_that_is_nothing_has_its_largest_share_of_the_force():
    """Whether a spring is linear was left to the reader, of a value in N/m^3 and its error."""
    truth = rs.Oscillator(1.5, "k*x + c*v", {"k": 6000.0, "c": 4.0})
    plan = rs.SimulatedTest(
        level=[2, 5], frequency=np.linspace(9, 11, 15), method="harmonic-balance", noise_relative=0.01
    )
    found = rs.identify(rs.simulate(truth, plan), "k*x + k3*x**3 + c*v + c3*v**3")
    unseen = {one.parameter: one for one in found.findings if one.code == "not-distinct-from-zero"}
    cubic, size = unseen["k3"], found.amplitude_range[1]
    largest = abs(found["k3"].value) + 1.96 * found["k3"].standard_error
    whole = found["k"].value + found["k3"].value * size**2
    assert cubic["share"] == pytest.approx(largest * size**2 / whole, rel=1e-2)
    assert f"at most {100 * cubic['share']:.2g} % of the force at" in sentence(cubic)
    assert "share" not in unseen["c3"].numbers


def test_a_width_of_friction_that_is_nothing_leaves_coulombs():
    """It was told to leave its term out, which is all of the friction."""
    law, values = "k*x + c*v + Ff*tanh(v/vs)", {"k": 6000.0, "c": 4.0, "Ff": 0.8, "vs": 2e-3}
    plan = rs.SimulatedTest([2, 5], np.linspace(9, 11, 15), method="harmonic-balance", noise_relative=0.01)
    width = rs.identify(rs.simulate(rs.Oscillator(1.5, law, values), plan), law)["vs"].finding
    assert (width.code, width.names) == (
        "not-distinct-from-zero",
        {"smooth": "tanh(v/vs)", "jump": "sign(v)"},
    )
    assert "leave its term out" not in sentence(width)


def test_a_coefficient_that_goes_with_its_exponent_is_no_term_to_leave_out():
    """Its interval reaches zero, as the exponent is in its unit, where the term is all of the hardening."""
    law, values = "k*x + c*v + kp*sign(x)*abs(x)**p", {"k": 6000.0, "c": 4.0, "kp": 3e8, "p": 3.6}
    plan = rs.SimulatedTest([1, 2], np.linspace(9, 11, 15), method="harmonic-balance", noise_relative=0.03)
    said = rs.identify(rs.simulate(rs.Oscillator(1.5, law, values), plan), law)["kp"].finding
    assert (said.code, said.names) == ("not-distinct-from-zero", {"exponent": "p"})
    assert "fix p" in sentence(said)
    assert "leave its term out" not in sentence(said)


def test_a_law_of_which_most_parameters_are_nothing_is_doubtful():
    test = rs.SimulatedTest([0.5, 1, 2], np.linspace(8.5, 12, 30), noise_relative=1e-2)
    surface = rs.simulate(rs.Oscillator(1.5, "k*x + c*v", {"k": 5920.0, "c": 4.0}), test)
    law = "k*x + c*v + a*x**3 + b*x**5 + d*v**3 + e*v**5"
    found = rs.identify(surface, law, mass=1.5)
    assert sum(one.identifiable for one in found) == 2
    (said,) = (finding for finding in found.verdict.decided_by if finding.code == "nothing-identifiable")
    assert sentence(said).startswith("the test determines only 2 of the 6 parameters")
    assert next_step(said).startswith("Take a law with fewer parameters")
    free = replace(said, names={})
    assert next_step(free).startswith("Give the mass if it is known, take a law with fewer parameters")


@pytest.mark.parametrize(
    ("band", "noise", "delay"),
    [
        ((6, 18), 0.004, 2e-4), ((6, 18), 0.004, -1e-3), ((8, 12), 0.004, 2e-4), ((8, 12), 0.004, 2e-3),
        ((6, 18), 0.01, 2e-4), ((8, 12), 0.01, 2e-4), ((9, 11), 0.0, 2e-4),
    ],
)  # fmt: skip
def test_a_delay_between_the_channels_is_named_with_its_value(band, noise, delay):
    """It was a stiffness and a damping free to follow the amplitude, or a phase error; with noise nothing."""
    law, values = "k*x + k3*x**3 + c*v", {"k": 6000.0, "k3": 2e5, "c": 4.0}
    plan = rs.SimulatedTest(level=[2, 5, 10], frequency=np.linspace(*band, 60), noise_relative=noise)
    test = rs.simulate(rs.Oscillator(1.5, law, values), plan)
    late = test.harmonics[:, 1] * np.exp(-1j * test.omega * delay)
    found = rs.identify(rs.ResponseSurface(test.level, test.frequency, test.force, late), law)
    (said,) = (one for one in found.findings if one.code == "channels-delayed")
    assert said["delay"] == pytest.approx(delay, rel=0.02)
    assert said["left"] < max(0.5 * said["misfit"], noise)
    assert said in found.verdict.decided_by
    # half a turn of noise in a narrow band: a phase error does the same
    narrow = band == (8, 12) and delay == 2e-4
    assert ("turn" in said.numbers) is narrow
    assert ("would look the same" in sentence(said)) is narrow
    assert ("Of a phase error fit" in next_step(said)) is narrow
    assert not {"law-does-not-fit", "channels-delayed"} & {
        one.code for one in rs.identify(test, law).findings
    }


@pytest.mark.parametrize(("noise", "turn"), [(0.01, -0.05), (0.003, 0.05)])
def test_a_phase_that_is_off_everywhere_is_named_with_its_value(noise, turn):
    """It moved no value, so that free curves were blamed, the law."""
    test = measured("k*x + c*v + k3*x**3", {"k": 5920.0, "c": 4.0, "k3": 2e5}, [2.0, 5.0, 10.0])
    seen = noisy(replace(test, harmonics=test.harmonics * np.exp(1j * turn * np.arange(8))), noise, 1)
    found = rs.identify(seen, "k*x + c*v + k3*x**3")
    (said,) = (one for one in found.findings if one.code == "channels-delayed")
    assert said["turn"] == pytest.approx(turn, rel=0.1)
    # with more noise a delay does the same in this band
    assert ("delay" in said.numbers) is (noise == 0.01)
    assert 'background = "phase"' in next_step(said)


@pytest.mark.parametrize("law", ["k*x + c*v", "k*x + c*v + k5*x**5", "k*x + k3*x**3 + cq*v*abs(v)"])
@pytest.mark.parametrize("noise", [0.001, 0.01])
def test_a_wrong_law_is_not_blamed_on_the_channels(law, noise):
    """What it leaves is no delay, nor a phase that is off everywhere."""
    test = measured("k*x + c*v + k3*x**3", {"k": 5920.0, "c": 4.0, "k3": 2e5}, [2.0, 5.0, 10.0])
    found = rs.identify(noisy(test, noise, 2), law)
    codes = {finding.code for finding in found.findings}
    assert "channels-delayed" not in codes
    # of 1 % of noise one hardening spring is another
    assert "law-does-not-fit" in codes or noise == 0.01


CUBIC = "k*x + c*v + k3*x**3"


@functools.cache
def driven_base() -> rs.ResponseSurface:
    test = rs.SimulatedTest(level=[1.3, 3.3, 6.7], frequency=np.linspace(8, 12, 50), base="acceleration")
    return rs.simulate(rs.Oscillator(1.5, CUBIC, {"k": 5920.0, "c": 4.0, "k3": 2e5}), test)


def seen_on_base(*, absolute: bool, gain: float, turn: float, delay: float) -> rs.ResponseSurface:
    """Return a test of a driven base of which one sensor, of the absolute or relative motion, is wrong."""
    test = driven_base()
    base = test.force / test.omega**2 if absolute else 0.0
    by = (1 + gain) * np.exp(1j * (turn - test.omega * delay))
    noise = np.random.default_rng(1).normal(size=(2, len(test)))
    read = by * (test.harmonics[:, 1] + base) * (1 + 0.001 * (noise[0] + 1j * noise[1])) - base
    return rs.ResponseSurface(test.level, test.frequency, test.force, read, base="acceleration")


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize(
    ("name", "value"), [("gain", 0.008), ("gain", -0.02), ("turn", 0.0175), ("delay", 2e-4)]
)
def test_a_sensor_of_a_driven_base_that_is_off_is_named_with_its_value(absolute, name, value):
    """The ratio of two accelerometers was "identified", with values off by more than their intervals."""
    wrong = {"gain": 0.0, "turn": 0.0, "delay": 0.0} | {name: value}
    found = rs.identify(seen_on_base(absolute=absolute, **wrong), CUBIC)
    (said,) = (one for one in found.findings if one.code == "channels-delayed")
    assert found.verdict.state == "doubtful"
    assert said[name] == pytest.approx(value, rel=0.05)
    if name == "gain":
        assert abs(said["gain"] - value) < said["within"] < 0.1 * abs(value)
        assert "accelerometers" in next_step(said)


@pytest.mark.parametrize("absolute", [True, False])
@pytest.mark.parametrize("law", [CUBIC, "k*x + c*v", "k*x + c*v + k3*x*abs(x)"])
def test_sensors_of_a_driven_base_are_not_blamed_for_a_law(absolute, law):
    right = seen_on_base(absolute=absolute, gain=0.0, turn=0.0, delay=0.0)
    codes = {finding.code for finding in rs.identify(right, law).findings}
    assert "channels-delayed" not in codes
    assert ("law-does-not-fit" in codes) is (law != CUBIC)


@pytest.mark.parametrize(("moved", "named"), [(-0.5, True), (-790.0, False)])
def test_a_background_that_moves_a_value_absurdly_is_no_advice(moved, named):
    """Of a fit that had not converged it was said that k3 differs by -79 000 %."""
    found: Any = SimpleNamespace(covariance=np.array([[1e-6]]), parameters=np.array([1.0]))
    other: Any = SimpleNamespace(shift=np.array([moved]))
    said = background_findings(
        {"phase": other}, {"phase": 0.001}, found, ["k3"], misfit=0.26, left_by_term=0.2
    )
    assert bool(said) == named
