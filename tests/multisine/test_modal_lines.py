"""The modal table of a multisine against describing functions in closed form."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import rsgen as rs
from tests.virtual import multisine

MASS, SPRING, DAMPER = 1.5, 5920.0, 6.0


@cache
def spectra(law: str, noise: float = 0.0, seed: int = 1, **values: float) -> rs.MultisineSpectra:
    how = {"periods": 4, "noise_relative": noise, "seed": seed}
    return multisine(law, {"k": SPRING, "c": DAMPER} | values, [3, 8], MASS, **how)


def test_a_cubic_spring_has_three_quarters_of_its_coefficient():
    table = rs.modal_table(spectra("k*x + k3*x**3 + c*v", k3=3e6))
    np.testing.assert_allclose(table.stiffness, SPRING + 0.75 * 3e6 * table.amplitude**2, rtol=1e-6)
    np.testing.assert_allclose(table.damping, DAMPER, rtol=1e-6)
    assert table.mass == pytest.approx(MASS, rel=1e-8)
    assert "stiffness" in table.known


@pytest.mark.slow
def test_drag_has_eight_thirds_of_its_speed_over_pi():
    table = rs.modal_table(spectra("k*x + c*v + c2*v*abs(v)", noise=0.001, c2=5.0))
    speed = np.sqrt(SPRING / MASS) * table.amplitude
    np.testing.assert_allclose(table.damping, DAMPER + 8 / (3 * np.pi) * 5.0 * speed, rtol=2e-3)


def test_intervals_cover_the_truth_and_a_level_held_out_is_not_seen():
    records = spectra("k*x + k3*x**3 + c*v", noise=0.01, k3=3e6)
    table = rs.modal_table(records, rs.Observation(hold_out=(8,)))
    assert table.tested[1] < np.sqrt(2) * records.rms_response().max() * 0.9
    exact = SPRING + 0.75 * 3e6 * table.amplitude**2
    half = (table.stiffness_upper - table.stiffness_lower) / 2
    assert np.all(np.abs(table.stiffness - exact) < 2 * half)
    assert np.all(half < 0.01 * exact)


def test_a_reversed_response_has_no_table():
    records = spectra("k*x + c*v", noise=0.01)
    with pytest.raises(rs.RsgenError, match="would feed the exciter"):
        rs.modal_table(replace(records, response=-records.response))


@pytest.mark.parametrize("k2", [0.0, 1.2e5])
def test_an_even_force_that_a_table_cannot_hold_is_named(k2):
    values = {"k": 5000.0, "k2": k2, "k3": 4e6, "c": 4.0}
    law = "k*x + k2*x**2 + k3*x**3 + c*v"
    table = rs.modal_table(multisine(law, values, [1, 2, 4], periods=4, noise_relative=0.005))
    assert [dict(one.names) for one in table.findings] == [{"even": "x**2"}] * bool(k2)
