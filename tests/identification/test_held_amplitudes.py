"""Response control: one held amplitude gives one stiffness and one damping, whatever the noise of it says."""

from dataclasses import replace

import numpy as np
import pytest

import rsgen as rs
from rsgen.data.surface.plausibility import level_findings
from rsgen.identification.results.result import mass_lines
from rsgen.identification.terms import channel_finding
from tests.surfaces import codes
from tests.virtual import fundamentals, only, simulated

MASS, K, C, K3 = 1.3, 30000.0, 12.0, 4e10
LAW = "k*x + c*v + k3*x**3"


def cubic(amplitude):
    """Return k [N/m] and c [N s/m]."""
    return K + 0.75 * K3 * amplitude**2, C


def held(*levels: float, seed: int, law=cubic, band=(22, 30, 33)) -> rs.ResponseSurface:
    """Make a test at held amplitudes [m], with 0.5 % noise of the force and 0.3 % of the amplitudes."""
    random = np.random.default_rng(seed)
    level, frequency = (part.ravel() for part in np.meshgrid(levels, np.linspace(*band), indexing="ij"))
    omega, count = 2 * np.pi * frequency, len(level)
    stiffness, damping = law(level)
    force = level * (stiffness - MASS * omega**2 + 1j * omega * damping)
    force = force * (1 + 0.0035 * (random.standard_normal(count) + 1j * random.standard_normal(count)))
    amplitude = level * (1 + 0.003 * random.standard_normal(count))
    return rs.ResponseSurface(level, frequency, force, amplitude.astype(complex), control="response")


@pytest.mark.parametrize("seed", range(3))
def test_one_held_amplitude_determines_one_stiffness(seed):
    found = rs.identify(held(3e-4, seed=seed), LAW, mass=MASS)
    assert [found[name].finding.code for name in ("k", "k3")] == ["confounded"] * 2
    assert found["c"].interval[0] < C < found["c"].interval[1]
    assert found.verdict.state == "doubtful"


@pytest.mark.parametrize("seed", range(2))
def test_two_held_amplitudes_determine_two_stiffnesses(seed):
    found = rs.identify(held(1e-4, 3e-4, seed=seed), LAW, mass=MASS)
    for name, true in (("k", K), ("k3", K3), ("c", C)):
        assert found[name].interval[0] < true < found[name].interval[1]
        assert found[name].identifiable
    (shared,) = mass_lines(found)[1:]
    assert "1 % of the held amplitude moves k3 by −2 %, if" in shared
    # files of responses over the force: an error of the amplitude is in the force, too
    test = held(1e-4, 3e-4, seed=seed)
    scaled = fundamentals(test, 1.01 * test.harmonics[:, 1], 1.01 * test.force, level=1.01 * test.level)
    moved = rs.identify(replace(scaled, control="response"), LAW, mass=MASS)["k3"].value
    assert moved / found["k3"].value == pytest.approx(1.01**-2)


def test_no_fold_excludes_points_whose_response_was_held():
    """Between folds under one force the simulator, which is driven by it, follows no motion."""
    law, values = "k*x + c*v + k3*x**3 + Ff*sign(v)", {"k": 6e3, "c": 2.0, "k3": 4e8, "Ff": 0.2}
    how = {"control": "response", "noise_relative": 0.004}
    test = simulated(law, values, [5e-4, 1e-3, 2e-3], (9, 14, 31), **how)
    found = rs.identify(fundamentals(test, control="response"), law)
    assert "points-excluded" not in codes(found)
    assert found.fit.regression.used.all()
    assert all(found[name].interval[0] < true < found[name].interval[1] for name, true in values.items())


def test_a_response_that_was_held_at_one_amplitude_is_no_end_of_a_range():
    table = held(1e-4, 1.2e-4, 1.4e-4, 6e-4, seed=0)
    found = rs.identify(fundamentals(table, table.level + 0j, control="response"), "k*x + c*v", mass=MASS)
    assert "law-does-not-fit" in codes(found)
    assert "range-reached" not in codes(found)


def joint(amplitude):
    """Return k [N/m] and c [N s/m] at 150 rad/s of a spring, a damper and a Jenkins element that slips."""
    stiffness, slip, found = 14000.0, 2.0, []
    for size in np.atleast_1d(amplitude):
        angle = np.arccos(np.clip(1 - 2 * slip / (stiffness * size), -1, 1))
        elastic = stiffness / np.pi * (angle - np.sin(2 * angle) / 2)
        lost = 4 * slip * max(size - slip / stiffness, 0.0)
        found.append((30000 + elastic, 5 + lost / (np.pi * 150 * size**2)))
    return np.transpose(found)


def test_the_modal_table_has_a_row_a_level_and_no_course_between_that_it_cannot_know():
    levels = (2e-5, 6e-5, 1.5e-4, 3e-4, 6e-4)
    table = rs.modal_table(held(*levels, seed=1, law=joint, band=(21, 32, 45)), mass=MASS)
    assert table.amplitude == pytest.approx(levels, rel=2e-3)
    stiffness, damping = joint(table.amplitude)
    assert np.all(table.stiffness_upper - table.stiffness < 20)
    assert np.all(table.damping_upper - table.damping < 0.1)
    assert np.all(np.abs(table.stiffness - stiffness) < 1.5 * (table.stiffness_upper - table.stiffness))
    assert np.all(np.abs(table.damping - damping) < 1.5 * (table.damping_upper - table.damping))
    between = table.at(np.geomspace(2.1e-5, 5.9e-4, 40))
    stiffness, damping = joint(between.amplitude)
    assert np.mean((between.stiffness_lower < stiffness) & (stiffness < between.stiffness_upper)) > 0.9
    assert np.mean((between.damping_lower < damping) & (damping < between.damping_upper)) > 0.85
    hole = only(table, "modal-hole")
    assert (len(table.findings), hole.severity, hole.names) == (1, "info", {"by": "held"})
    assert [hole["low"], hole["high"]] == pytest.approx([2e-5, 6e-5], rel=2e-3)


def friction(amplitude):
    """Return k [N/m] and c [N s/m] at 150 rad/s of a hardening spring, a damper and Coulomb friction."""
    return 30000 + 4e16 * amplitude**4, 5 + 4 * 0.15 / (np.pi * 150 * amplitude)


def test_curves_of_held_amplitudes_know_no_more_than_the_table_between_them_and_no_jump_at_its_end():
    table = rs.modal_table(held(6e-5, 1.5e-4, 3e-4, 5e-4, 7e-4, seed=1, law=friction), mass=MASS)
    *inside, beyond = rs.predict(table, [0.55, 0.7, 0.9]).curves
    assert beyond.rises_at_end
    (jump,) = beyond.jumps
    assert jump.sweep == "down"
    size = np.linspace(6e-5, 7e-4, 2000)
    stiffness, damping = friction(size)
    omega = np.sqrt(stiffness / MASS)
    for curve in inside:
        _, _, low, high = curve.largest
        peak = np.searchsorted(size * omega * damping, curve.force)
        assert low < size[peak] < high
        assert curve.peak_interval[0] < omega[peak] / (2 * np.pi) < curve.peak_interval[1]
    # F/X = |k - m omega^2 + i omega c| above the resonance
    middle = stiffness - damping**2 / (2 * MASS)
    square = (middle + np.sqrt(middle**2 - stiffness**2 + (beyond.force / size) ** 2)) / MASS
    assert jump.interval[0] < np.sqrt(square.min()) / (2 * np.pi) < jump.interval[1]


def test_real_amplitudes_with_a_complex_force_are_its_phase_reference():
    test = held(3e-4, seed=0)
    for phase_known in (True, False):
        with pytest.raises(rs.RsgenError, match=r"amplitude \+ 0j"):
            fundamentals(test, test.amplitude, phase_known=phase_known)


@pytest.mark.parametrize(("level", "control", "said"), [
    (1e4, "force", "the test held its response"),
    (1000.0, "response", "the amplitude that was held is 301 µm, 0.001 times as much"),
    (None, "response", "as where the measured amplitudes were given as levels"),
    (1.0, "response", ""),
])  # fmt: skip
def test_levels_are_compared_with_the_amplitudes_that_were_held(level, control, said):
    test = held(1e-4, 3e-4, seed=0)
    levels = test.amplitude if level is None else level * test.level
    found = [rs.sentence(one) for one in level_findings(fundamentals(test, level=levels, control=control))]
    assert len(found) == bool(said)
    assert said in "".join(found)


def test_a_response_that_was_held_over_a_driven_base_is_said():
    test = held(1e-4, 3e-4, seed=0)
    level = np.median(np.abs(test.force)) / test.omega.mean() ** 2 * test.level / test.level.max()
    (found,) = level_findings(fundamentals(test, level=level, base="displacement"))
    assert rs.sentence(found).endswith("the response hardly: the test held its response")
    assert (found.names["base"], found.severity) == ("displacement", "doubt")


def test_a_response_that_varies_under_a_held_force_was_not_held():
    test = held(3e-4, seed=0)
    free = test.harmonics[:, 1] / test.force
    surface = rs.ResponseSurface(test.level, test.frequency, np.ones(len(free)), free, control="response")
    assert [(found.code, found.severity) for found in level_findings(surface)] == [
        ("response-not-held", "doubt")
    ]


def test_a_fit_that_did_not_converge_blames_no_delay():
    test = held(1e-4, 3e-4, seed=0)
    late = test.harmonics[:, 1] * np.exp(-2e-3j * test.omega)
    fit = rs.identify(fundamentals(test, late), LAW).fit
    misfit = fit.regression.rms_misfit
    assert channel_finding(fit, misfit, [misfit], {}) is not None
    ended = replace(fit, regression=replace(fit.regression, converged=False))
    assert channel_finding(ended, misfit, [misfit], {}) is None
