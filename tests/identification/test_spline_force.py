"""Forces along the measured motion against the laws that made it."""

from __future__ import annotations

import numpy as np
import pytest

from rsgen.identification.fitting.points import select_points
from rsgen.identification.identify import identify
from rsgen.identification.restoring_force import invert_motion
from rsgen.law.numeric import compile_law
from tests.surfaces import LAWS, MASS, changed, model, noisy, surface

WANTED = 1e-2
"""Of the largest force: what a force without a law may be off, noise-free."""


def forces(law: str, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """n(x, 0) and n(0+, v) of the true law."""
    compiled = compile_law(model(law).force)
    values = np.array([LAWS[law][1][name] for name in compiled.parameters])
    # just off rest a step is on one side
    still = np.full_like(v, 1e-12)
    spring = compiled.force(x, np.zeros_like(x), values)
    return spring, compiled.force(0 * v, np.maximum(v, still), values)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["bilinear", "cubic", "coulomb", "combined"])
def test_forces_come_back_from_their_motions(law: str) -> None:
    found = invert_motion(select_points(surface(law), model(law)), MASS, 0.0)
    spring, damper = forces(law, found.displacement, found.velocity)
    assert np.abs(found.stiffness_force - spring).max() < WANTED * np.abs(spring).max()
    assert np.abs(found.damping_force - damper).max() < WANTED * np.abs(damper).max()


def test_the_two_sides_of_a_bilinear_spring_have_their_own_stiffness() -> None:
    found = invert_motion(select_points(surface("bilinear"), model("bilinear")), MASS, 0.0)
    slope = np.gradient(found.stiffness_force, found.displacement)
    low, high = found.displacement < -0.01, found.displacement > 0.01
    assert np.median(slope[low]) == pytest.approx(LAWS["bilinear"][1]["k7"], rel=WANTED)
    assert np.median(slope[high]) == pytest.approx(LAWS["bilinear"][1]["k6"], rel=WANTED)


@pytest.mark.slow
def test_one_well_of_two_is_drawn_where_the_mass_moves() -> None:
    values = {"k": -500.0, "kn": 5e6, "c": 3.0}
    table = surface("cubic", np.linspace(0.5, 3, 12), np.linspace(3, 8, 41), values=values)
    mean = table.harmonics[:, 0].real
    one = table.select(table.settled & (mean > 1.05 * table.amplitude))
    found = invert_motion(select_points(one, model("cubic")), MASS, 0.0)
    x = found.displacement
    assert x.min() > 0
    exact = values["k"] * x + values["kn"] * x**3
    assert np.abs(found.stiffness_force - exact).max() < WANTED * np.abs(exact).max()


@pytest.mark.slow
@pytest.mark.parametrize("relative", [3e-4, 1e-2])
def test_a_little_noise_does_little(relative: float) -> None:
    table = noisy(surface("bilinear"), relative, 1)
    found = identify(table, model("bilinear")).restoring
    spring, _ = forces("bilinear", found.displacement, found.velocity)
    assert np.abs(found.stiffness_force - spring).max() < 2 * WANTED * np.abs(spring).max()


@pytest.mark.thorough
def test_bands_of_forces_without_a_law_are_as_wide_as_their_errors() -> None:
    table = surface("bilinear")
    scores = []
    for seed in range(8):
        found = invert_motion(select_points(noisy(table, 1e-2, seed), model("bilinear")), MASS, 1e-2)
        spring, damper = forces("bilinear", found.displacement, found.velocity)
        # in the middle of both ranges; at zero a band has no width
        scores.append((found.stiffness_force - spring)[10:51:10] / found.stiffness_band[10:51:10])
        scores.append((found.damping_force - damper)[10:51:10] / found.damping_band[10:51:10])
    # 95 % bands: errors of half their width on average, in either direction by chance
    assert 0.25 < np.sqrt(np.nanmean(np.square(scores))) < 0.9


def test_too_few_points_draw_nothing() -> None:
    few = surface("bilinear").select(np.arange(40))
    assert invert_motion(select_points(few, model("bilinear")), MASS, 0.0) is None


@pytest.mark.slow
@pytest.mark.parametrize("law", ["cubic", "quintic", "coulomb", "piecewise", "bilinear", "combined"])
def test_identification_draws_every_force_within_a_percent(law: str) -> None:
    dense = surface(law, np.linspace(1, 12, 12))
    found = identify(changed(dense), model(law)).restoring
    spring, damper = forces(law, found.displacement, found.velocity)
    assert np.abs(found.stiffness_force - spring).max() < WANTED * np.abs(spring).max()
    assert np.abs(found.damping_force - damper).max() < WANTED * np.abs(damper).max()
