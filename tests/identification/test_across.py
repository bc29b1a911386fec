"""Laws across two sensors, on a structure of two masses whose exact motions are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rsgen as rs
from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import join_model
from rsgen.identification.fitting.across import sensor_noise
from rsgen.identification.fitting.fit import fit_balance
from rsgen.identification.judge import prepare
from rsgen.law.motion import Motion, project
from tests.surfaces import codes, distances, errors
from tests.virtual import only

MASS, FAR = 3.0, 1.2
TRUE = {"k": 2e4, "c": 5.0, "kj": 8e3, "k3": 4e8, "cj": 3.0}
SENSORS = "far - near"
ELEMENTS = (
    rs.make_element("ground", "k*x + c*v"),
    rs.make_element("joint", "kj*x + k3*x**3 + cj*v", across=SENSORS),
)

GAUGE = "gauge"
"""One sensor that measures the motion across by itself."""


def seen_by(sensors: str, *elements: rs.Element) -> tuple[rs.Element, ...]:
    """The elements, those across two sensors by the motion of others."""
    return tuple(replace(each, across=each.across and sensors) for each in elements)


def scattered(values, noise: float, random: np.random.Generator, size=None) -> np.ndarray:
    """Values with complex noise relative to each of them, or to a ``size``."""
    draws = random.standard_normal((2, *values.shape)) / np.sqrt(2)
    return values + noise * (values if size is None else size) * (draws[0] + 1j * draws[1])


def with_noise(exact, noise, random, near=None) -> rs.ResponseSurface:
    """Noise on force, response (or ``near`` in its place) and far sensor, relative to their fundamentals."""
    near = exact.harmonics if near is None else near
    force, seen, far = (
        scattered(values, noise, random, np.abs(values[:, 1:2]))
        for values in (exact.force_harmonics, near, exact.harmonics - exact.across)
    )
    return replace(exact, force=force[:, 1], force_harmonics=None, harmonics=seen, across=seen - far)


def gauged(exact, noise, random) -> rs.ResponseSurface:
    """Noise on force, response and motion across, relative to each."""
    own = {name: scattered(getattr(exact, name), noise, random) for name in ("force", "harmonics", "across")}
    return replace(exact, force_harmonics=None, **own)


def joint_force(omega: np.ndarray, z: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Harmonics of these orders of the force of the joint along a motion across it."""
    x, v, _ = Motion(omega, z).waveforms(128)
    force = TRUE["kj"] * x + TRUE["k3"] * x**3 + TRUE["cj"] * v
    return np.stack([project(force, h) for h in order], axis=1)


def two_masses(levels=(1.0, 3.0, 6.0), noise: float = 0.0) -> rs.ResponseSurface:
    """Mass 1 on ground spring and damper, driven; mass 2 hangs on it by the joint alone.

    With the motion z = x_1 - x_2 across the joint given, mass 2 says x_2 = -n(z)/(FAR omega^2) in every
    harmonic, x_1 = x_2 + z, and the force on mass 1 is what its balance asks for: no solver is involved.
    """
    level, frequency = np.repeat(levels, 40), np.tile(np.linspace(9, 20, 40), len(levels))
    omega, random = 2 * np.pi * frequency, np.random.default_rng(5)
    # amplitudes across that look like a resonance; harmonics are free, the force has what balances them
    z = np.zeros((len(omega), 6), dtype=complex)
    z[:, 1] = level * 1e-3 / (1 - (omega / 2 / np.pi / 13) ** 2 + 0.1j)
    z[:, 3] = 0.05 * z[:, 1] * np.exp(2j * level)
    order = np.arange(1, 6)
    of_joint = joint_force(omega, z, order)
    far = -of_joint / (FAR * (omega[:, None] * order) ** 2)
    near = np.zeros_like(z)
    near[:, 1:] = far + z[:, 1:]
    force = (TRUE["k"] - MASS * omega**2 + 1j * omega * TRUE["c"]) * near[:, 1] + of_joint[:, 0]
    force, near, z = (scattered(values, noise, random) for values in (force, near, z))
    return rs.ResponseSurface(level, frequency, force, near, across=z, sweep="rest")


LIGHT = 0.3
"""kg: a far side that the harmonics of the joint move further than the near one."""


def driven_by_a_sine() -> rs.ResponseSurface:
    """The same structure, mass 2 lighter, under a force without harmonics; the motion across has nine.

    At a given fundamental of z the harmonics of the balance of mass 1, with x_1 = x_2 + z, have to vanish.
    """
    omega = 2 * np.pi * np.tile(np.linspace(12, 20, 24), 3)
    level = np.repeat([0.25, 0.5, 1.0], 24)
    order = np.arange(1, 10, 2)
    z = np.zeros((len(omega), 10), dtype=complex)
    z[:, 1] = 1.4e-3 * level

    def balance(z):
        of_joint = joint_force(omega, z, order)
        near = z[:, order] - of_joint / (LIGHT * rate**2)
        return near, (TRUE["k"] + 1j * rate * TRUE["c"] - MASS * rate**2) * near + of_joint

    # secant steps with the mean tangent stiffness of the joint between the two inertias
    rate = omega[:, None] * order
    own, stiff = TRUE["k"] - MASS * rate**2, TRUE["kj"] + 1.5 * TRUE["k3"] * np.abs(z[:, 1:2]) ** 2
    slope = own * (1 - stiff / (LIGHT * rate**2)) + stiff
    for _ in range(60):
        z[:, order[1:]] -= (balance(z)[1] / slope)[:, 1:]
    near, force = balance(z)
    assert np.abs(force[:, 1:] / force[:, :1]).max() < 1e-12
    harmonics = np.zeros_like(z)
    harmonics[:, order] = near
    return rs.ResponseSurface(level, omega / 2 / np.pi, force[:, 0], harmonics, across=z, sweep="rest")


@pytest.mark.slow
def test_a_law_across_is_identified_with_the_balance_at_another_mass():
    found = rs.identify(two_masses(), ELEMENTS)
    assert max(errors(found, TRUE | {"m": MASS}).values()) < 1e-9
    # the curve is that of the joint, k + i omega c of all harmonics across it
    first, third = two_masses().across[:, [1, 3]].T
    size = np.abs(first)
    cube = 0.75 * (size**2 * first + np.conj(first) ** 2 * third + 2 * np.abs(third) ** 2 * first)
    expected = TRUE["kj"] + TRUE["k3"] * cube / first
    np.testing.assert_allclose(found.curve.stiffness, expected.real, rtol=1e-8)
    np.testing.assert_allclose(found.curve.amplitude, size)


def test_noise_leaves_the_true_values_within_their_intervals():
    found = rs.identify(two_masses(noise=0.003), seen_by(GAUGE, *ELEMENTS))
    assert np.abs(distances(found, TRUE | {"m": MASS})).max() < 4
    assert all(found[name].standard_error < 0.1 * true for name, true in (TRUE | {"m": MASS}).items())


@pytest.mark.slow
def test_a_held_out_level_is_predicted_with_its_measured_ratio():
    surface = two_masses()
    found = rs.identify(surface, ELEMENTS, rs.Observation(hold_out=(3.0,)))
    for known in (found, rs.Oscillator(MASS, ELEMENTS, TRUE)):
        with pytest.raises(RsgenError, match="levels: the law acts across 'far - near'"):
            rs.predict(known, [2.0])
    prediction = rs.predict(found, surface=surface)
    assert prediction.held_out[0].error < 1e-8
    assert prediction.curves == ()
    assert prediction.findings[0].code == "predicted-along-measured"
    assert np.isnan(rs.predict(found, surface=replace(surface, across=None)).held_out[0].predicted).all()


@pytest.mark.parametrize(("law", "surface", "options", "said"), [
    (ELEMENTS, {"across": None}, {}, "no motion across"), ("k*x + c*v", {}, {}, "no element follows it"),
    ((rs.make_element("joint", "k*x + k2*x**2 + c*v", across="a - b"),), {}, {}, "are not odd"),
    (
        (rs.make_element("here", "k*x + c*v"), rs.make_element("there", "-k*x", across="a - b")), {}, {},
        "k: cancels in the sum",
    ),
    ((*ELEMENTS, rs.make_element("other", "h*x", across="a - b")), {}, {}, "one pair of sensors"),
    (ELEMENTS, {}, {"observation": rs.Observation(background="neighbour")}, "take 'residuals'"),
])  # fmt: skip
def test_what_cannot_be_identified_across_is_said(law, surface, options, said):
    with pytest.raises(RsgenError, match=said):
        rs.identify(replace(two_masses(), **surface), law, **options)


@pytest.mark.slow
def test_a_joint_that_gives_energy_is_rejected_although_the_sum_of_all_elements_takes_it():
    surface = two_masses(noise=0.003)
    assert not [f for f in rs.identify(surface, ELEMENTS).findings if "negative" in f.code]
    verdict = rs.identify(replace(surface, across=-surface.across), ELEMENTS).verdict
    found = {f.names["curve"]: f for f in verdict.decided_by if "negative" in f.code}
    assert verdict.state == "rejected"
    assert {curve: f.names["sensors"] for curve, f in found.items()} == {"k(X)": SENSORS, "c(X)": SENSORS}
    assert found["c(X)"]["least"] == pytest.approx(-TRUE["cj"], rel=0.1)


def test_what_harmonics_across_do_that_were_not_recorded_is_predicted_and_doubted():
    whole = driven_by_a_sine()
    found = rs.identify(whole, ELEMENTS)
    assert found["k3"].value == pytest.approx(TRUE["k3"], rel=1e-6)
    assert "harmonics-across-left-out" not in codes(found)
    alone = replace(whole, across=whole.across[:, :2], harmonics=whole.harmonics[:, :2])
    off = rs.identify(alone, ELEMENTS)
    bias = off["k3"].value / TRUE["k3"] - 1
    said = {finding.code: finding for finding in off.verdict.decided_by}["harmonics-across-left-out"]
    assert (said.parameter, off.verdict.state) == ("k3", "doubtful")
    assert abs(bias) > 0.01
    assert said["moved"] == pytest.approx(-bias, rel=0.1)


@pytest.mark.slow
def test_noise_of_two_sensors_in_the_motion_across_is_in_the_weight_and_in_the_intervals():
    exact, random, inside, states = driven_by_a_sine(), np.random.default_rng(1), [], []
    for _ in range(12):
        found = rs.identify(with_noise(exact, 0.003, random), ELEMENTS)
        states.append(found.verdict.state)
        inside += [e.interval[0] < (TRUE | {"m": MASS})[e.name] < e.interval[1] for e in found]
    assert states.count("identified") >= 10
    assert np.mean(inside) > 0.8


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "receptance"), [("constant", (2e-5, 0)), ("residuals", (2e-5, 0.3))])
def test_a_background_is_seen_by_the_response_and_not_by_the_joint(kind, receptance):
    exact = driven_by_a_sine()
    near = np.array(exact.harmonics)
    near[:, 1] += (receptance[0] - receptance[1] / exact.omega**2) * exact.force
    across = exact.across + near - exact.harmonics
    seen = replace(exact, harmonics=near, across=across)
    found = rs.identify(seen, ELEMENTS, rs.Observation(background=kind, hold_out=(0.5,)))
    assert found.verdict.state == "identified"
    assert max(errors(found, TRUE | {"m": MASS}).values()) < 1e-5
    assert found.held_out[0].error < 1e-6
    assert not rs.identify(seen, ELEMENTS).verdict.usable


FIRM = {"k": 22740.0, "c": 6.0, "kj": 24674.0, "cj": 2.0}
"""In N/m and N s/m: 1 kg behind this joint resonates at 25 Hz."""


def firm_joint(noise: float, seed: int = 0) -> rs.ResponseSurface:
    """4 kg on a spring, driven; 1 kg behind a joint far stiffer than its inertia; both sensors have noise."""
    omega, random = 2 * np.pi * np.tile(np.linspace(9.5, 13.5, 41), 4), np.random.default_rng(seed)
    level = np.repeat([2.0, 6.0, 12.0, 20.0], 41)
    joint = FIRM["kj"] + 1j * omega * FIRM["cj"]
    ratio = joint / (joint - omega**2)
    near = level / (FIRM["k"] + 1j * omega * FIRM["c"] - 4 * omega**2 - omega**2 * ratio)
    force, near, far = (scattered(values, noise, random) for values in (level, near, near * ratio))
    across = np.stack([0 * near, near - far], axis=1)
    return rs.ResponseSurface(level, omega / 2 / np.pi, force, near, across=across)


def test_a_joint_that_cannot_be_told_from_the_noise_of_its_sensors_is_doubted():
    joint = rs.make_element("joint", "kj*x + cj*v", across="wing - payload")
    found = rs.identify(firm_joint(0.005), (ELEMENTS[0], joint))
    # along the motion as measured noise pulls the joint towards zero, and the mass to 5.6 kg in its place
    assert abs(found["m"].value - 4) < 3 * found["m"].standard_error
    said = {finding.code: finding for finding in found.verdict.decided_by}["noise-across"]
    assert said["noise"] == pytest.approx(0.005, rel=0.2)


def test_a_systematic_misfit_that_is_small_beside_the_response_is_large_for_a_joint():
    # a mode at 22 Hz, 2 Hz above the band: 0.3 % of exact data
    exact, other = driven_by_a_sine(), 2 * np.pi * 22
    near = np.array(exact.harmonics)
    near[:, 1] += 0.02 / (other**2 + 0.02j * other * exact.omega - exact.omega**2) * exact.force
    found = rs.identify(with_noise(exact, 0.0, np.random.default_rng(0), near), ELEMENTS)
    assert only(found, "law-does-not-fit") in found.verdict.decided_by
    assert found.residual < 0.005


def test_a_sensor_of_the_motion_across_itself_has_the_noise_of_one():
    exact, random = two_masses(), np.random.default_rng(3)
    inside, values, elements = [], [], seen_by(GAUGE, *ELEMENTS)
    for _ in range(5):
        found = rs.identify(gauged(exact, 0.03, random), elements)
        values.append(found["k3"].value / TRUE["k3"] - 1)
        inside += [e.interval[0] < (TRUE | {"m": MASS})[e.name] < e.interval[1] for e in found]
    assert sensor_noise(firm_joint(0.002), SENSORS) == pytest.approx(0.002, rel=0.3)
    assert np.sqrt(np.mean(np.square(values))) < 0.03
    assert np.mean(inside) > 0.8


@pytest.mark.parametrize("own", [True, False])
@pytest.mark.parametrize("sensor", ["force", "response", "far"])
def test_influence_is_what_a_measured_value_moves_where_sensors_are_correlated(own: bool, sensor: str):
    joint = rs.make_element("joint", "kj*x + cj*v", across=GAUGE if own else SENSORS)
    linear = (ELEMENTS[0], joint)
    exact, random, row, step = two_masses((0.05, 0.1, 0.3)), np.random.default_rng(3), 30, 1e-5
    start = np.array([TRUE["c"], TRUE["cj"], TRUE["k"], TRUE["kj"], MASS])
    other = exact.across if own else exact.harmonics - exact.across
    read = {
        name: scattered(values, 1e-3, random)
        for name, values in (("force", exact.force), ("response", exact.harmonics), ("far", other))
    }

    def fitted(factor: complex):
        seen = {name: np.array(values) for name, values in read.items()}
        seen[sensor][row] *= factor
        near, far = seen["response"], seen["far"]
        across = far if own else near - far
        moved = replace(exact, force=seen["force"], force_harmonics=None, harmonics=near, across=across)
        problem = prepare(moved, join_model(linear, None, None)).problem
        return fit_balance(problem, start, order=1, exclude=False, correct=False).regression

    influence = fitted(1.0).influence[row]
    half = (len(influence) + 1) // 2
    place = {"force": 0, "response": 1, "far": half - 1}[sensor]
    size = np.abs(influence).max(axis=0)
    for part, unit in ((place, 1), (half + place, 1j)):
        moves = (fitted(1 + step * unit).parameters - fitted(1 - step * unit).parameters) / (2 * step)
        # to first order: the relative deviation of a misfitting point counts a little otherwise
        assert np.abs(moves - influence[part]).max(initial=0, where=size > 0) < 0.2 * np.abs(moves).max()
