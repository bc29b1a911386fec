"""B-splines against those of SciPy, which finds them another way."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from rsgen.common.linear_algebra import b_splines, spline_values


@pytest.mark.parametrize("degree", range(5))
def test_splines_and_slopes_are_those_of_scipy(degree: int) -> None:
    inner = np.cumsum(np.random.default_rng(degree).uniform(0.1, 2, 9)) - 3
    knots = np.concatenate([[inner[0]] * degree, inner, [inner[-1]] * degree])
    at = np.concatenate([np.linspace(inner[0], inner[-1], 200), inner])
    values, slopes = b_splines(at, knots, degree)
    every = BSpline(knots, np.eye(len(knots) - degree - 1), degree)
    np.testing.assert_allclose(values, every(at), atol=1e-14)
    np.testing.assert_allclose(slopes, every(at, nu=1), atol=1e-12)
    np.testing.assert_allclose(values.sum(axis=1), 1, rtol=1e-14)
    assert np.abs(slopes.sum(axis=1)).max() < 1e-12


def test_values_at_many_places_are_those_of_a_few() -> None:
    knots = np.array([0.0, 0, 0, 0, 0.3, 1, 2, 2, 2, 2])
    at = np.linspace(0, 2, 10_001)
    np.testing.assert_array_equal(spline_values(at, knots, 3), b_splines(at, knots, 3)[0])


def test_repeated_inner_knots_divide_by_nothing() -> None:
    knots = np.array([0.0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2])
    values, slopes = b_splines(np.linspace(0, 2, 41), knots, 3)
    assert np.isfinite([values, slopes]).all()
    np.testing.assert_allclose(values.sum(axis=1), 1, rtol=1e-14)
