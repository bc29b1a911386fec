"""Laws of a mode among others, and shakers that distort: the mode is as without."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import rsgen as rs
from rsgen import Observation, ResponseSurface, identify, predict
from rsgen.dynamics.virtual_test import add_noise
from rsgen.law.motion import Motion, project
from tests.surfaces import beside, changed, codes, errors, identified, model, noisy, surface, truth
from tests.virtual import only, simulated

EXACT = 2e-5
"""Steady states are exact to 1e-7 of the amplitude; a background lets that grow."""

PSI, FLEXIBILITY, INERTIA = 0.4, 3e-4 - 4e-5j, 0.9 + 0.1j
"""Phase error [rad], A [m/N] and B [1/kg]: up to a third of the receptance of the mode off its resonance."""


def among_others(table: ResponseSurface, psi: float, a: complex, b: complex) -> ResponseSurface:
    """What a sensor sees: the mode, a + b/omega^2 times the force, and a force that leads by psi less."""
    motion = (a + b / table.omega**2) * table.force
    return beside(table, motion, force=table.force * np.exp(-1j * psi))


def of_mode(table: ResponseSurface, mass: float, frequency: float, ratio: float) -> np.ndarray:
    """Motion [m] of another mode under the same force: modal mass [kg], frequency [Hz], damping ratio."""
    own = 2 * np.pi * frequency
    return table.force / mass / (own**2 - table.omega**2 + 2j * ratio * own * table.omega)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "psi", "a", "b"), [
    ("phase", -2.5, 0, 0), ("constant", 0.2, 2.1e-3, 0), ("residuals", PSI, FLEXIBILITY, INERTIA),
])  # fmt: skip
def test_what_is_put_beside_the_mode_comes_out(kind, psi, a, b):
    seen = among_others(surface("cubic"), psi, a, b)
    found = identify(seen, model("cubic"), Observation(background=kind))
    assert max(errors(found, truth("cubic")).values()) < EXACT
    shape, values = found.background.shape(seen.omega, seen.force), found.background.values
    assert values[0] == pytest.approx(psi, abs=EXACT)
    expected = a + b / seen.omega**2
    size = np.abs(seen.harmonics[:, 1] / seen.force)
    assert np.max(np.abs(shape.receptance(values) - expected) / size) < EXACT
    assert found.curve.stiffness == pytest.approx(identified("cubic").curve.stiffness, rel=10 * EXACT)


@pytest.mark.slow
def test_a_neighbour_as_strong_as_the_mode_has_a_term_of_its_own():
    cubic, frequency, ratio, band = surface("cubic", None, np.linspace(8, 12, 81)), 11.2, 0.01, (9.2, 11.0)
    table = beside(cubic, of_mode(cubic, 1.5, frequency, ratio))
    rough = identify(table, model("cubic"), Observation(background="residuals", band=band))
    assert max(errors(rough, truth("cubic")).values()) > 0.05
    found = identify(table, model("cubic"), Observation(background="neighbour", band=band))
    assert max(errors(found, truth("cubic")).values()) < 10 * EXACT
    neighbour = {e.name: e.value for e in found.background.estimates}
    assert not found.background.findings
    assert neighbour["f_n"] == pytest.approx(frequency, rel=1e-4)
    assert neighbour["zeta"] == pytest.approx(ratio, rel=1e-2)
    assert neighbour["r_re"] == pytest.approx(1 / 1.5, rel=1e-2)


def test_predictions_are_of_what_the_sensor_sees():
    seen = among_others(surface("cubic"), PSI, FLEXIBILITY, INERTIA)
    level = float(seen.levels[3])
    found = identify(seen, model("cubic"), Observation("residuals", hold_out=(level,)))
    held = predict(found, surface=seen).held_out[0]
    assert held.error < 1e-4
    curve = predict(found, levels=[level]).curves[0]
    rows = np.flatnonzero(seen.level == level)
    far = rows[seen.frequency[rows] < 9.0]
    left = curve.frequency < 9.0
    order = np.argsort(curve.frequency[left])
    drawn = np.interp(seen.frequency[far], curve.frequency[left][order], curve.amplitude[left][order])
    assert drawn == pytest.approx(seen.amplitude[far], rel=1e-3)


OFFSET = 4e-4 - 2e-4j
"""Displacement [m] that does not depend on the force: a third of the response at the ends of the band."""


@pytest.mark.slow
def test_a_misfit_that_an_offset_explains_proposes_it_and_its_intervals_cover():
    seen = noisy(beside(surface("cubic"), OFFSET, origin="measured"), 0.01, 3)
    without = identify(seen, model("cubic"), Observation(background="phase"))
    proposal = only(without, "background-missing")
    assert proposal in without.verdict.decided_by
    assert proposal.names == {"kind": "phase+offset"}
    assert proposal["left"] < 0.5 * proposal["misfit"]
    found = identify(seen, model("cubic"), Observation(background=proposal.names["kind"]))
    assert not {"background-missing", "law-does-not-fit"} & codes(found)
    of = {e.name: e for e in found.background.estimates}
    for name, value in {"o_re": OFFSET.real, "o_im": OFFSET.imag}.items():
        # a 95 % interval, doubled: this is one noisy table
        assert abs(of[name].value - value) < np.ptp(of[name].interval) < abs(value)


@pytest.mark.parametrize(("psi", "severity"), [(0.75, "doubt"), (0.5, "doubt"), (-0.3, "info"), (0.1, None)])
def test_a_phase_error_that_a_filter_would_pay_in_amplitude_is_said(psi, severity):
    seen = among_others(surface("cubic"), psi, 0, 0)
    found = identify(seen, model("cubic"), Observation(background="phase"))
    assert found["psi"] is found.background.estimates[0]
    turned = found.fit.regression.parameters.copy()
    turned[4] += 2 * np.pi
    again = replace(found.fit, regression=replace(found.fit.regression, parameters=turned))
    assert again.background == pytest.approx(found.fit.background, abs=1e-12)
    told = [finding for finding in found.findings if finding.code == "phase-turned"]
    assert [finding.severity for finding in told] == ([severity] if severity else [])
    assert found.verdict.state == ("doubtful" if severity == "doubt" else "identified")
    assert all(one["loss"] == pytest.approx(1 - np.cos(psi), abs=1e-3) for one in told)


HARDENING, STIFF = "k*x + k3*x**3 + c*v", {"k": 5920.0, "k3": 3e5, "c": 4.0, "m": 1.5}


@cache
def hardening() -> ResponseSurface:
    values = {name: STIFF[name] for name in ("k", "k3", "c")}
    return simulated(HARDENING, values, np.linspace(2, 12, 6), (8.5, 12.5, 41), harmonics=1)


@pytest.mark.parametrize("background", ["constant", "residuals"])
@pytest.mark.parametrize(("drift", "flexibility"), [(0.15, 0.0), (0.0, 0.0), (0.0, 3e-4)])
def test_a_gain_that_a_background_conceals_is_bounded(background, drift, flexibility):
    """A gain that changes by 15 % over the band is taken up by a background, and shifts k by 5 %."""
    seen = among_others(hardening(), 0.0, flexibility * (1 - 0.1j), 2e3 * flexibility)
    gain = 1 + drift * (seen.frequency - 8.5) / 4
    seen = add_noise(changed(seen, harmonics=seen.harmonics * gain[:, None]), 0.01, 1)
    found = identify(seen, HARDENING, Observation(background=background))
    # nothing else in the response, or other modes that no gain resembles
    assert ("gain-may-change" in codes(found)) == bool(drift)
    if drift:
        told, off = only(found, "gain-may-change"), errors(found, STIFF)
        assert told["change"] == pytest.approx(drift, rel=0.15)
        assert 0.04 < max(off["k"], off["c"], off["m"], off["k3"] / 3) < told["off"]


MASS, TRUE = 2.0, {"k": 2e4, "k3": 5e9, "c": 4.0}


def distorted(even: float = 0.0, turn: float = 0.0) -> rs.ResponseSurface:
    """The force is what motions with free third and fifth (and even) harmonics ask for; law of odd order."""
    frequency = np.tile(np.linspace(12, 22, 40), 3)
    omega = 2 * np.pi * frequency
    size = np.repeat([2e-4, 6e-4, 1.2e-3], 40) / (1 + ((frequency - 17) / 4) ** 2)
    phase = np.exp(1j * np.linspace(0, 5, len(size)))
    x = np.zeros((len(size), 8), dtype=complex)
    for order, share in ((1, 1.0), (3, 0.04j), (5, 0.02), (0, even), (2, 0.5j * even)):
        x[:, order] = share * size * phase**order
    x[:, 0] = x[:, 0].real
    wave, speed, acceleration = Motion(omega, x).waveforms(128)
    force = MASS * acceleration + TRUE["k"] * wave + TRUE["k3"] * wave**3 + TRUE["c"] * speed
    harmonics = np.stack([project(force, order) for order in range(16)], axis=1)
    harmonics *= np.exp(-1j * turn * np.arange(16))
    return rs.ResponseSurface(np.repeat([1.0, 2.0, 3.0], 40), frequency, harmonics, x, sweep="rest")


@pytest.mark.slow
@pytest.mark.parametrize("even", [0.0, 0.03])
def test_recorded_harmonics_of_the_force_make_the_balance_exact(even):
    surface = distorted(even)
    found = rs.identify(surface, HARDENING)
    assert max(errors(found, TRUE | {"m": MASS}).values()) < 1e-8
    # as a sine, the same force leaves what it does not say to the law
    sine = rs.identify(replace(surface, force_harmonics=np.zeros((len(surface), 2))), HARDENING)
    assert sine.residual > 1e-3 > 1e-7 > found.residual


def test_a_phase_error_turns_every_harmonic():
    found = rs.identify(distorted(turn=0.1), HARDENING, rs.Observation(background="phase"))
    assert max(errors(found, TRUE | {"m": MASS}).values()) < 1e-6
    assert found.background.estimates[0].value == pytest.approx(0.1, abs=1e-6)


def test_a_stepped_sine_brings_the_harmonics_that_stand_out_of_the_noise():
    rate, random = 1000.0, np.random.default_rng(2)
    steps, records = [8.0, 9.0, 10.0], []
    for f in steps:
        t = np.arange(0, 12, 1 / rate)
        turn = 2 * np.pi * f * t
        force = 5 * np.cos(turn) + 0.3 * np.cos(2 * turn + 1.0) + 0.2 * np.cos(3 * turn - 0.5)
        records.append((force + 0.05 * random.standard_normal(len(t)), 1e-3 * np.cos(turn - 1.0)))
    force, response = (np.concatenate(parts) for parts in zip(*records, strict=True))
    surface = rs.history.from_stepped_sine(rs.history.TimeHistory(rate, force, response))
    orders, turn = np.arange(surface.force_harmonics.shape[1]), np.angle(surface.force)[:, None]
    clock = surface.force_harmonics * np.exp(-1j * turn) ** orders
    expected = np.tile([5, 0.3 * np.exp(1j), 0.2 * np.exp(-0.5j)], (3, 1))
    np.testing.assert_allclose(clock[:, 1:4], expected, atol=5e-3)
    assert not clock[:, [0, *range(4, clock.shape[1])]].any()
