"""Asymmetric laws on measured fundamentals: mean and second harmonic follow from the law."""

import numpy as np
import pytest

import rsgen
from rsgen import Observation, Oscillator, identify, make_element
from rsgen.data.history import SweepLaw, TimeHistory, from_swept_sine
from rsgen.data.surface.response_surface import ResponseSurface, without_offset
from rsgen.dynamics.steady_state import solve_steady_states
from rsgen.formula.names import symbol
from rsgen.law.character import mirror_exchanges
from rsgen.law.numeric import mirror_image
from tests.oracles.swept import sweep
from tests.surfaces import beside, changed, codes, distances, errors, noisy, without_phase
from tests.virtual import only, simulated

pytestmark = pytest.mark.slow

QUADRATIC = "k*x + k2*x**2 + k3*x**3 + c*v"
CUBIC, HARDENING = "k*x + k3*x**3 + c*v", {"k": 5920.0, "k3": 2e5, "c": 3.8}
VALUES = {"k": 5920.0, "k2": 1e5, "k3": 4e6, "c": 7.5}
MASS = 1.5
TRUE = VALUES | {"m": MASS}

EXACT = 1e-6
"""Largest relative error of a value from data without noise, where all that matters is carried."""

SIGMAS = 4.0
"""Standard errors that a value from one noisy table may be off."""


def table(law=QUADRATIC, values=None, levels=(1.0, 2.0, 4.0, 8.0), frequencies=61, harmonics=5, band=(8, 12)):
    grid = np.meshgrid(levels, np.linspace(*band, frequencies), indexing="ij")
    level, frequency = (axis.ravel() for axis in grid)
    states = solve_steady_states(
        Oscillator(MASS, law, values or VALUES), level.astype(complex), frequency, harmonics=harmonics,
        accuracy=1e-9,
    )  # fmt: skip
    return ResponseSurface(level, frequency, level.astype(complex), states.harmonics, outcome=states.outcome)


def fundamental(full: ResponseSurface, noise: float = 0.0, **columns: object) -> ResponseSurface:
    """What a test keeps that records the fundamental alone."""
    harmonics = np.array(noisy(full, noise, 1).harmonics) if noise else np.array(full.harmonics)
    force = noisy(full, noise, 2).force if noise else full.force
    harmonics[:, 0] = harmonics[:, 2:] = 0
    return changed(full, **{"harmonics": harmonics, "force": force} | columns)


def with_mean(measured: ResponseSurface, offset: float | None) -> ResponseSurface:
    """A motion [m] added to each mean; None: no mean was recorded."""
    harmonics = np.array(measured.harmonics)
    harmonics[:, 0] = 0 if offset is None else harmonics[:, 0] + offset
    return changed(measured, harmonics=harmonics)


@pytest.fixture(scope="module")
def full():
    return table()


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("tested", ["plain", "amplitudes", "background", "response control"])
def test_a_fundamental_gives_every_value_but_the_sign(full, tested, noise):
    measured, observation = fundamental(full, noise), None
    if tested == "amplitudes":
        measured = without_phase(measured)
    elif tested == "background":
        motion, force = (3e-5 + 1e-5j) * measured.force, measured.force * np.exp(-0.2j)
        measured, observation = beside(measured, motion, force=force), Observation(background="constant")
    elif tested == "response control":
        level = 1e-3 * np.round(measured.amplitude * 1e3)
        measured = changed(measured, level=level, control="response")
    found = identify(measured, QUADRATIC, observation)
    if noise:
        assert np.abs(distances(found, TRUE)).max() < SIGMAS
        by_noise = dict(zip(found.alternatives.names, found.alternatives.error, strict=True))
        assert by_noise["k2"] < 0.1 * VALUES["k2"]
        return
    assert max(errors(found, TRUE).values()) < EXACT
    named = [finding.names for finding in found.findings if finding.code == "mirror-image-fits"]
    assert named == [{"parameters": "k2"}]


def test_the_second_harmonic_gives_the_sign():
    found = identify(with_mean(table(values={**VALUES, "k2": -1e5}), None), QUADRATIC)
    assert abs(found["k2"].value / -1e5 - 1) < EXACT
    assert "mirror-image-fits" not in codes(found)


def test_a_stop_on_the_wrong_side_is_told_that_its_mirror_image_fits():
    law, values = "k*x + kg*Max(x - b, 0) + c*v", {"k": 5920.0, "kg": 2000.0, "b": 1e-3, "c": 7.5}
    measured = noisy(table(law, values, frequencies=31, harmonics=3), 3e-3, 1)
    missed = only(identify(measured, law.replace("Max(x - b, 0)", "Min(x + b, 0)")), "law-does-not-fit")
    assert (missed.severity, missed.names) == ("doubt", {"side": "other"})
    assert 2e-3 < missed["left"] < 5e-3 < missed["misfit"]


@pytest.mark.thorough
def test_two_gaps_that_the_mirror_image_exchanges_are_known_by_their_mean():
    # near equal gaps the fundamental shows the square of their difference alone
    law, values = "k*x + kg*(Max(x - b1, 0) + Min(x + b2, 0)) + c*v", {"k": 4.1e4, "kg": 2.6e4, "c": 6.2}
    full = table(law, {**values, "b1": 3e-4, "b2": 3e-4}, (3.0, 6.0, 10.0), 40, 1, (22.5, 32))
    found = rsgen.identify(fundamental(noisy(full, 5e-3, 2), force=full.force), law, mass=MASS)
    for name, other in (("b1", "b2"), ("b2", "b1")):
        said = found[name].finding
        assert (said.code, said.names["with"]) == ("confounded", other)
        assert said["combined"] == pytest.approx(3e-4, rel=5e-3)


def test_stops_on_both_sides_are_found_though_one_has_their_fundamentals_along_sines():
    law = "k*x + kg*(Max(x - b1, 0) + Min(x + b2, 0)) + c*v"
    values = {"k": 1.1e4, "kg": 3e4, "b1": 3e-4, "b2": 3e-4, "c": 4.5}
    full = table(law, values, (0.5, 1.2, 2.5, 4.0), 40, 1, (13, 23))
    found = rsgen.identify(fundamental(noisy(full, 5e-3, 2), force=full.force), law)
    assert found.residual < 0.01
    assert found["kg"].value == pytest.approx(3e4, rel=0.02)
    assert (found["b1"].value + found["b2"].value) / 2 == pytest.approx(3e-4, rel=0.01)


@pytest.mark.parametrize(("law", "images"), [
    ("k1*Max(x - b1, 0) + k2*Min(x + b2, 0) + c*v", {"b1": "b2", "b2": "b1", "k1": "k2", "k2": "k1"}),
    ("k1*Max(x - b1, 0) + k2*Max(x + b2, 0) + c*v", {}),
    ("k1*x + k2*x**2 + b1*v + b2*x**2", {"k2": "k2", "b2": "b2"}),
])  # fmt: skip
def test_a_mirror_image_exchanges_pairs_of_parameters_or_their_signs(law, images):
    found = mirror_image(make_element("all", law).force, ("k2", "b1", "k1", "b2"))
    assert {name: other for name, (other, _) in found.items()} == images
    assert {sign for _, sign in found.values()} <= {-1.0 if "**" in law else 1.0}


@pytest.mark.parametrize(("law", "exchanged"), [
    ("Max(x - a, 0) + Min(x + b, 0)", True), ("a*Max(x, 0) + b*x", False), ("k*x + (a - b)*x**2", True),
])  # fmt: skip
def test_two_parameters_that_the_mirror_image_exchanges_are_recognised(law, exchanged):
    assert mirror_exchanges(make_element("all", law).force, symbol("a"), symbol("b")) == exchanged


@pytest.mark.parametrize(("levels", "others"), [
    ((3.0,), {"both": None, "one": 2.6e4}),
    pytest.param((10.0,), {"both": 1.3e4, "one": 2.6e4}, marks=pytest.mark.thorough),
])  # fmt: skip
def test_fundamentals_tell_a_stop_on_one_side_from_stops_on_both_or_say_that_they_do_not(levels, others):
    sides = {"both": "Max(x - b, 0)", "one": "Max(x - b, 0) + Min(x + b, 0)"}
    values = {"k": 4.1e4, "kg": 2.6e4, "b": 3e-4, "c": 6.2}
    full = table(f"k*x + c*v + kg*({sides['both']})", values, levels, 56, 1, (22.5, 32))
    measured = fundamental(full, 5e-3, force=full.force)
    severities = set()
    for other, law in sides.items():
        found = identify(measured, f"k*x + c*v + kg*({law})")
        said = [f for f in found.findings if f.code == "mirror-image-fits" and "side" in f.names]
        assert [f.names["side"] for f in said] == [other] * (others[other] is not None)
        # doubtful where the other stop fits better beyond chance, a warning where it is within the noise
        doubted = any(f.severity == "doubt" for f in said)
        assert found.verdict.state == ("doubtful" if doubted else "identified")
        severities |= {f.severity for f in said}
        for finding in said:
            assert finding["value"] == pytest.approx(others[other], rel=0.15)
    assert severities == ({"warning"} if all(others.values()) else {"doubt"})


def test_a_one_sided_spring_and_a_mode_beside_the_band_are_told_apart_by_harmonics():
    law, values = "k*x + c*v + kb*Max(x, 0)", {"k": 15400.0, "kb": 3100.0, "c": 2.95}
    full = table(law, values, levels=(0.06, 0.18, 0.3), band=(13.9, 18.2), frequencies=37, harmonics=7)
    mode = 0.029 * full.force / ((2 * np.pi * 7.6) ** 2 * (1 + 0.02j) - full.omega**2)
    for seed in (1, 2, 3):
        found = identify(fundamental(noisy(beside(full, mode), 3e-3, seed)), law)
        for name, value in {**values, "m": MASS}.items():
            assert found[name].interval[0] < value < found[name].interval[1], (seed, name)
        named = [finding.names for finding in found.findings if finding.code == "mirror-image-fits"]
        assert named == [{"background": "residuals"}]


@pytest.mark.parametrize(("law", "even"), [(QUADRATIC, "k2"), ("k*x + k3*x**3 + c*v + F0", "F0")])
def test_an_even_force_that_is_not_there_is_not_identifiable(law, even):
    values = {"k": 5920.0, "k3": 4e6, "c": 7.5}
    full = table(CUBIC, values)
    for noise in (0.0, 0.01):
        found = identify(fundamental(full, noise), law)
        assert found[even].finding.code in {"even-terms-not-seen", "not-distinct-from-zero"}
        if noise:
            assert np.abs(distances(found, values)).max() < SIGMAS
        else:
            assert max(errors(found, values).values()) < EXACT
        assert "not-converged" not in codes(found)


def of_levels(law: str, values: dict[str, float], noise: float = 0.003) -> ResponseSurface:
    return noisy(table(law, values, (2.0, 4.0, 7.0, 10.0), 40, 6), noise, 6)


@pytest.mark.parametrize(("fault", "law", "more"), [
    ("stop on one side", " + kb*Max(x - b, 0)", {"kb": 600.0, "b": 0.012}),
    ("two stiffnesses", " + kb*Max(x, 0)", {"kb": 300.0}), ("offset", "", {}), ("distorted force", "", {}),
])  # fmt: skip
def test_an_even_force_is_told_from_sensors_and_shakers(fault, law, more):
    measured = with_mean(of_levels(CUBIC + law, HARDENING | more, 0.01), 1e-4 * (fault == "offset"))
    if fault == "distorted force":
        harmonics = np.array(measured.harmonics)
        harmonics[:, 2] += 0.03 * measured.force / (HARDENING["k"] - 4 * MASS * measured.omega**2)
        measured = changed(measured, harmonics=harmonics)
    found = identify(measured, CUBIC)
    assert ("even-force-missing" in codes(found)) == bool(more)
    assert (found.verdict.state == "identified") == (not more)


@pytest.mark.parametrize("even", [0.0, 1.5e4])
def test_an_offset_of_the_sensor_is_named_where_a_law_has_an_even_term(even):
    measured = of_levels(QUADRATIC, HARDENING | {"k2": even})
    shifted = identify(with_mean(measured, 2e-4), QUADRATIC)
    (said,) = (one for one in shifted.findings if one.code in ("background-missing", "sensor-offset"))
    assert said["offset"] == pytest.approx(2e-4, rel=0.1)
    # a mean that is constant is taken off; one that an even force moves as well is a doubt
    constant = said.code == "sensor-offset"
    assert constant == (even == 0) == (shifted.verdict.state == "identified")
    assert constant or (said.parameter, said.names) == ("k2", {"kind": "mean"})
    assert shifted["k2"].interval[0] < even < shifted["k2"].interval[1]
    assert not {"background-missing", "law-ambiguous"} & codes(identify(measured, QUADRATIC))


RUBBING = f"{CUBIC} + Ff*sign(v)"


@pytest.fixture(scope="module")
def rubbing():
    measured = of_levels(RUBBING, HARDENING | {"Ff": 0.3})
    return measured, identify(measured, RUBBING)


@pytest.mark.parametrize("offset", [1e-6, 2e-5, 3e-4, -2e-3])
def test_the_zero_of_a_sensor_moves_neither_values_nor_errors(rubbing, offset):
    measured, true = rubbing
    found = identify(changed(with_mean(measured, offset), peak=measured.peak + offset), RUBBING)
    assert found.verdict.state == true.verdict.state == "identified"
    for one, other in zip(found, true, strict=True):
        assert one.value == pytest.approx(other.value, abs=0.02 * other.standard_error)
        assert one.standard_error == pytest.approx(other.standard_error, rel=0.02)
    taken = [one["offset"] for one in found.findings if one.code == "sensor-offset"]
    # a smaller mean is not compared under a law that is the same on both sides
    assert taken == ([pytest.approx(offset, rel=0.02)] if abs(offset) > 1e-4 else [])


@pytest.mark.parametrize(("law", "values"), [
    (f"{CUBIC} - W", {"k": 6000.0, "k3": 4e4, "c": 4.0, "W": 14.7}),
    (CUBIC, {"k": -3000.0, "k3": 4e7, "c": 4.0}),
], ids=["preload", "two wells"])  # fmt: skip
def test_a_constant_mean_that_the_law_explains_is_no_offset(law, values):
    test = simulated(law, values, [0.05, 0.1, 0.2, 0.4], (8.5, 13, 40), noise_relative=5e-3, seed=2)
    assert without_offset(test) is not test
    found = identify(test, law, mass=1.5)
    assert found.verdict.state == "identified"
    assert "sensor-offset" not in codes(found)
    for one in found:
        assert one.value == pytest.approx(values[one.name], abs=4 * one.standard_error)


def test_a_mean_that_a_force_makes_is_no_offset():
    measured = of_levels("k*x + c*v + kb*Max(x - b, 0)", {"k": 5920.0, "c": 3.8, "kb": 900.0, "b": 4e-3})
    assert without_offset(measured) is measured


GAP = Oscillator(
    2.2, "k*x + kg*(Max(0, x - b) + Min(0, x + b)) + c*v", {"k": 2.4e4, "kg": 3e4, "b": 7e-4, "c": 6.0}
)
"""Of both sides, whose motions break its symmetry near half the resonance."""


def test_motions_that_break_the_symmetry_of_their_law_say_nothing_for_an_even_force():
    frequencies = np.concatenate([np.linspace(10.15, 13, 60), np.linspace(14, 30, 16)])
    level, frequency = (a.ravel() for a in np.meshgrid((2.0, 6.0, 24.0), frequencies, indexing="ij"))
    states = solve_steady_states(GAP, level.astype(complex), frequency, harmonics=5, accuracy=1e-6)
    harmonics, late = np.array(states.harmonics), (level == 24) & (frequency > 10.85) & (frequency < 10.97)
    harmonics[:, 0] = 0
    even = np.abs(harmonics[:, 2]) > 0.01 * np.abs(harmonics[:, 1])
    assert np.flatnonzero(late)[0] == np.flatnonzero(even)[-1] + 1
    harmonics[late, 2] += 0.15 * harmonics[late, 1]
    full = ResponseSurface(level, frequency, level.astype(complex), harmonics, outcome=states.outcome)
    assert identify(noisy(full, 3e-3, 1), GAP.force).verdict.state == "identified"


@pytest.mark.thorough
def test_a_sweep_that_passes_a_pitchfork_late_is_fitted_without_those_points():
    sweeps = [sweep(GAP, level, SweepLaw("linear", 10.0, 0.147), 30.0, 512.0) for level in (6.0, 24.0)]
    rng = np.random.default_rng(3)
    records = [
        TimeHistory(h.rate, h.reference, h.response + 5e-4 * h.response.std() * rng.normal(size=len(h)))
        for h in sweeps
    ]
    found = identify(from_swept_sine(records, points=200), GAP.force)
    (late,) = (f for f in found.findings if f.names.get("by") == "symmetry")
    assert 2 <= late["excluded"] <= 10
    assert found.residual < 5e-3
    assert "law-does-not-fit" not in codes(found)
    for name, value in GAP.values.items():
        assert found[name].interval[0] < value < found[name].interval[1]
