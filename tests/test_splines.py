"""B-splines and their slopes."""

import numpy as np
import pytest

from rsgen.common.solvers import b_splines


@pytest.mark.parametrize("degree", range(5))
def test_splines_sum_to_one_and_their_slopes_are_those_of_their_values(degree):
    inner = np.cumsum(np.random.default_rng(degree).uniform(0.1, 2, 9)) - 3
    knots = np.concatenate([[inner[0]] * degree, inner, [inner[-1]] * degree])
    # the middle of each interval, so that a difference of values lies in one
    at, step = np.repeat((inner[1:] + inner[:-1]) / 2, 2), 1e-5
    values, slopes = b_splines(at, knots, degree)
    np.testing.assert_allclose(values.sum(axis=1), 1, rtol=1e-14)
    assert np.abs(slopes.sum(axis=1)).max() < 1e-12
    ahead, behind = (b_splines(at + way, knots, degree)[0] for way in (step, -step))
    np.testing.assert_allclose(slopes, (ahead - behind) / (2 * step), atol=1e-6)


def test_repeated_inner_knots_divide_by_nothing():
    knots = np.array([0.0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2])
    values, slopes = b_splines(np.linspace(0, 2, 41), knots, 3)
    assert np.isfinite([values, slopes]).all()
    np.testing.assert_allclose(values.sum(axis=1), 1, rtol=1e-14)
