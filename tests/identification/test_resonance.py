import numpy as np
import pytest

from rsgen.data.free_mode import estimate_mass, steady
from rsgen.identification.fitting.points import select_points
from rsgen.identification.resonance import find_resonances
from tests.surfaces import model

LINEAR = {"k": 5920.0, "kn": 0.0, "c": 3.8}

INTERPOLATED = 1e-3
"""Straight lines between points 0.1 Hz apart, a quarter of the width of the resonance."""


def test_linear_structure_has_one_resonance_at_every_level(surface_of):
    points = select_points(surface_of("cubic", values=LINEAR), model("cubic"))
    found = estimate_mass(*steady(points.force, points.harmonics[:, 1], points.omega))
    assert found is not None
    mass = found.mass
    assert mass == pytest.approx(1.5, rel=1e-6)
    assert found.mass_error < 1e-2
    found, turning = find_resonances(points, mass)
    assert len(found) == 6
    for resonance in found:
        assert resonance.frequency == pytest.approx(np.sqrt(5920 / 1.5) / 2 / np.pi, rel=1e-5)
        assert resonance.damping == pytest.approx(3.8, rel=INTERPOLATED)
        assert resonance.damping_ratio == pytest.approx(3.8 / 2 / np.sqrt(5920 * 1.5), rel=INTERPOLATED)
        assert not resonance.jump
    # a symmetric structure swings as far to either side
    assert turning[:, 0] == pytest.approx(-turning[:, 1], rel=1e-6)


def test_jumps_across_the_resonance_are_marked(surface_of):
    table = surface_of("quintic", levels=np.array([2.0, 20.0]))
    found, _ = find_resonances(select_points(table, model("quintic")), 1.5)
    assert [resonance.jump for resonance in found] == [False, True]


def test_a_coarse_grid_is_no_jump(surface_of):
    # two points on either side of the resonance, farther apart than it is wide
    table = surface_of("cubic", values=LINEAR, frequencies=np.linspace(6, 14, 13))
    found, _ = find_resonances(select_points(table, model("cubic")), 1.5)
    assert len(found) == 6
    assert not any(resonance.jump for resonance in found)
