"""Forces along the measured motion against the laws that made it."""

import numpy as np
import pytest

from rsgen.data.surface import ResponseSurface
from rsgen.identification.fitting.points import select_points
from rsgen.identification.identify import identify
from rsgen.identification.restoring_force import invert_motion
from rsgen.identification.results import RestoringForce
from rsgen.law.numeric import compile_law
from tests.surfaces import LAWS, MASS, model, noisy, surface

WANTED = 1e-2
"""Of the largest force: what a force without a law may be off, noise-free."""


def forces(law: str, found: RestoringForce) -> tuple[np.ndarray, np.ndarray]:
    """n(x, 0) and n(0+, v) of the true law; just off rest a step is on one side."""
    compiled, x, v = compile_law(model(law).force), found.displacement, found.velocity
    values = compiled.ordered(LAWS[law][1])
    return compiled.force(x, 0 * x, values), compiled.force(0 * v, np.maximum(v, 1e-12), values)


def inverted(table: ResponseSurface, law: str, noise: float = 0.0) -> RestoringForce | None:
    return invert_motion(select_points(table, model(law)), MASS, noise)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["cubic", "quintic", "coulomb", "piecewise", "bilinear", "combined"])
def test_forces_come_back_from_their_motions(law):
    dense = identify(surface(law, np.linspace(1, 12, 12)), model(law)).restoring
    for found in (dense, *([] if law in ("quintic", "piecewise") else [inverted(surface(law), law)])):
        spring, damper = forces(law, found)
        assert np.abs(found.stiffness_force - spring).max() < WANTED * np.abs(spring).max()
        assert np.abs(found.damping_force - damper).max() < WANTED * np.abs(damper).max()
    if law == "bilinear":
        slope = np.gradient(found.stiffness_force, found.displacement)
        for side, k in ((found.displacement < -0.01, "k7"), (found.displacement > 0.01, "k6")):
            assert np.median(slope[side]) == pytest.approx(LAWS[law][1][k], rel=WANTED)


@pytest.mark.slow
def test_one_well_of_two_is_drawn_where_the_mass_moves():
    values = {"k": -500.0, "kn": 5e6, "c": 3.0}
    table = surface("cubic", np.linspace(0.5, 3, 12), np.linspace(3, 8, 41), values=values)
    mean = table.harmonics[:, 0].real
    found = inverted(table.select(table.settled & (mean > 1.05 * table.amplitude)), "cubic")
    x = found.displacement
    assert x.min() > 0
    exact = values["k"] * x + values["kn"] * x**3
    assert np.abs(found.stiffness_force - exact).max() < WANTED * np.abs(exact).max()


@pytest.mark.thorough
def test_bands_of_forces_without_a_law_are_as_wide_as_their_errors():
    scores = []
    for seed in range(8):
        found = inverted(noisy(surface("bilinear"), 1e-2, seed), "bilinear", 1e-2)
        spring, damper = forces("bilinear", found)
        # in the middle of both ranges; at zero a band has no width
        scores.append((found.stiffness_force - spring)[10:51:10] / found.stiffness_band[10:51:10])
        scores.append((found.damping_force - damper)[10:51:10] / found.damping_band[10:51:10])
    # 95 % bands: errors of half their width on average, in either direction by chance
    assert 0.25 < np.sqrt(np.nanmean(np.square(scores))) < 0.9
