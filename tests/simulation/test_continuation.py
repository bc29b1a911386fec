"""A virtual control-based continuation: exact motions on all branches, and what follows from them."""

import numpy as np
import pytest

import rsgen as rs
from rsgen.law.motion import Motion, project

MASS, VALUES = 1.5, {"k": 5920.0, "k3": 3e5, "c": 2.0}
LAW = "k*x + k3*x**3 + c*v"
LEVELS = np.linspace(3e-3, 6e-2, 24)


@pytest.fixture(scope="module")
def surface():
    return rs.simulate(
        rs.Oscillator(MASS, LAW, VALUES),
        rs.SimulatedTest(
            level=LEVELS,
            frequency=np.linspace(9.6, 10.8, 6),
            control="continuation",
            harmonics=9,
            accuracy=1e-8,
        ),
    )


def test_every_motion_obeys_the_equation_in_every_harmonic(surface):
    """Not how the motions were found: these come from shooting in time."""
    assert surface.settled.all()
    np.testing.assert_allclose(surface.amplitude, surface.level, rtol=1e-9)
    x, v, a = Motion(surface.omega, surface.harmonics).waveforms(128)
    force = MASS * a + VALUES["k"] * x + VALUES["k3"] * x**3 + VALUES["c"] * v
    inertia = MASS * surface.omega**2 * surface.amplitude
    np.testing.assert_allclose(project(force, 1), surface.force, atol=1e-6 * inertia.max())
    for order in (0, 2, 3, 4, 5):
        left = project(force, order) if order else force.mean(axis=1)
        assert np.abs(left / inertia).max() < 1e-6, order


def test_motions_are_unstable_where_more_of_them_needs_less_force(surface):
    assert (surface.control, surface.level_unit) == ("continuation", "m")
    order = np.lexsort((surface.level, surface.frequency))
    force, stable = (part[order].reshape(6, 24) for part in (np.abs(surface.force), surface.stable))
    falls = np.diff(force, axis=1) < 0
    # a fold lies between two points, of which either may count
    assert np.count_nonzero(~stable) > 15
    assert np.all(falls[~stable[:, :-1] & ~stable[:, 1:]])
    assert not np.any(falls[stable[:, :-1] & stable[:, 1:]])
