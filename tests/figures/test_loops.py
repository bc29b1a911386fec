"""Loops and the energy of a cycle, against closed forms of joints."""

from pathlib import Path

import numpy as np
import pytest

import rsgen as rs
from rsgen.data.oscillator import Model
from rsgen.law.motion import Motion, project
from rsgen.report.figures.equivalent import evaluated, loop_force, mass_of, measured_energy, measured_loops

M, KT, FS = 1.5, 4e4, 8.0
SLIP = FS / KT


def jenkins(phase: np.ndarray, amplitude: float) -> np.ndarray:
    """Force of a spring KT that slides at FS along x = amplitude cos(phase), from Masing's rule."""
    x = amplitude * np.cos(phase)
    top = min(KT * amplitude, FS)
    falling = top - 2 * np.minimum(KT * (amplitude - x) / 2, FS)
    return np.where(phase % (2 * np.pi) < np.pi, falling, -top + 2 * np.minimum(KT * (amplitude + x) / 2, FS))


def test_a_measured_loop_is_the_force_that_moved_the_mass():
    phase = 2 * np.pi * np.arange(512) / 512
    # any periodic force of the joint: its harmonics move the mass, whose fundamental the test drives
    along = jenkins(phase, 3 * SLIP) + 5e3 * 3 * SLIP * np.cos(phase)
    omega, orders = 60.0, np.arange(10)
    wanted = np.array([project(along, order) for order in orders])
    harmonics = np.where(orders > 1, wanted / (M * (np.maximum(orders, 1) * omega) ** 2), 0)
    harmonics[1] = 3 * SLIP
    force = wanted[1] - M * omega**2 * harmonics[1]
    surface = rs.ResponseSurface(1.0, [omega / 2 / np.pi], force, harmonics=harmonics[None])
    loop = measured_loops(surface, np.array([0]), M)
    expected = sum((w * np.exp(1j * h * phase)).real for h, w in enumerate(wanted) if h)
    np.testing.assert_allclose(loop.force[0], expected, atol=1e-9 * FS)
    # the loop of the fundamental has the area of the force that was measured: 4 Fs (X - x_s)
    assert measured_energy(surface).energy == pytest.approx([4 * FS * (3 * SLIP - SLIP)], rel=1e-4)


def test_the_mass_is_read_without_a_law():
    amplitude = np.geomspace(1e-5, 1e-3, 40)
    stiffness = 6e3 + 4e4 / (1 + amplitude / 2e-4)
    # at and around their resonance, under the force that stiffness and damping need
    omega = np.outer([0.99, 1.0, 1.01], np.sqrt(stiffness / M))
    force = ((stiffness - M * omega**2 + 30j * omega) * amplitude).ravel()
    response = np.tile(amplitude, 3).astype(complex)
    surface = rs.ResponseSurface(np.abs(force), omega.ravel() / 2 / np.pi, force, response)
    # between five knots curves of forty points are straight
    assert mass_of(surface) == pytest.approx(M, rel=3e-3)
    with pytest.raises(rs.RsgenError, match="16 settled points with phases"):
        mass_of(surface.select(np.arange(8)))


def test_a_loop_along_a_motion_without_its_mean_has_no_mean():
    motion = Motion(np.array([60.0]), np.array([[0, 1e-3]], dtype=complex))
    (force,) = loop_force(Model("k*x + kc*Max(x, 0)"), {"k": 4e4, "kc": 2.6e4}, motion)
    assert abs(force.mean()) < 1e-3 * np.ptp(force)
    # the force at a mean displacement; a sample at the corner has the mean of its step
    place = np.cos(2 * np.pi * np.arange(len(force)) / len(force)) * 1e-3
    mean = (force.max() - (4e4 + 2.6e4) * 1e-3) / (4e4 + 2.6e4)
    expected = 4e4 * (place + mean) + 2.6e4 * np.maximum(place + mean, 0)
    np.testing.assert_allclose(force, expected, atol=1e-3 * np.ptp(force))


@pytest.mark.slow
def test_the_loop_of_a_measured_sweep_has_the_mass_and_the_energy_of_the_benchmark(measured_data):
    folder = measured_data("bouc_wen").parent
    surface = rs.read(Path(__file__).parents[1] / "cases" / "bouc_wen.toml", folder)
    # m = 2 kg; the truth of the joint gives the energy along the same motion
    assert mass_of(surface) == pytest.approx(2.0, rel=1e-2)
    row = np.array([int(np.argmax(surface.amplitude))])
    loop = measured_loops(surface, row, 2.0)
    values = {"k": 5e4, "c": 10.0, "alpha": 5e4, "bg": 800.0, "bd": -1100.0}
    law = rs.Law("k*x + c*v + z", memory={"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"})
    true = loop_force(Model(law), values, loop.motion)
    assert np.max(np.abs(loop.force - true)) < 0.03 * np.max(np.abs(true))


def test_a_loop_of_dry_friction_does_not_lean():
    joint = rs.Oscillator(0.8, "k*x + c*v + Ff*sign(v)", {"k": 4200.0, "c": 1.1, "Ff": 0.35})
    seen = rs.simulate(joint, rs.DecayTest(level=[14e-3], duration=3, rate=2000, noise_relative=2e-4))
    found = rs.identify(seen, "k*x + c*v + Ff*sign(v)", mass=0.8)
    _, panel = rs.figures.draw_loops(seen, found).figure.axes
    for line in (one for one in panel.get_lines() if len(one.get_xdata()) > 200):
        x, force = line.get_xdata(), line.get_ydata()
        middle = np.abs(x) < 0.3 * x.max()
        lean = np.polyfit(x[middle & (force > 0)], force[middle & (force > 0)], 1)[0] * x.max() / force.max()
        assert abs(lean) < 0.05


def test_a_loop_that_is_not_known_at_large_motion_is_drawn_at_small_motion():
    fast = rs.make_element("joint", "k*x + z", {"z": "s*v*(1 - z*sign(v)/Fc)"})
    sizes, values = np.array([1e-4, 1.0]), {"k": 1e4, "s": 1e7, "Fc": FS}
    found = evaluated(rs.derive(fast), sizes, np.full(2, 60.0), values)
    assert np.isfinite(found.stiffness).tolist() == [True, False]
