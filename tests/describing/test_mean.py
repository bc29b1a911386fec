"""The mean of the motion: the same for one amplitude as for thousands."""

import numpy as np
import pytest
from scipy.special import j0

from rsgen.describing import derive
from rsgen.law import make_element

CLOSE = 1e-12  # of the amplitude; the quadrature of the mean force has 1e-13
EDGE = 1e-6  # the force leaves the range with power 3/2, so that its edge is known to fewer digits


@pytest.mark.parametrize(("law", "values"), [
    ("k*x + k2*x**2 + F*tanh(x/a)", {"k": 1.0, "k2": 0.1, "F": 1.0, "a": 1.0}),
    ("k0*x + k*Max(0, x - b)**1.5", {"k0": 1.0, "k": 1.0, "b": 0.5}),
    ("Piecewise((k1*x, x > 0), (k2*x, True))", {"k1": 1.0, "k2": 2.0}),
    ("k*x + F*exp(-abs(x - b)/a)", {"k": 1.0, "F": 1.0, "a": 1.0, "b": 1.0}),
    ("F*sign(x - b) + k*x", {"F": 1.0, "k": 1.0, "b": 0.4}),
])  # fmt: skip
def test_means_of_many_amplitudes_balance_as_those_of_few(law, values):
    derived = derive(law)
    X = np.geomspace(0.01, 2, 3000)
    many = derived.evaluate(X, 1.0, values).mean
    few = derived.evaluate(X[::97], 1.0, values).mean
    np.testing.assert_allclose(many[::97] / X[::97], few / X[::97], rtol=0, atol=CLOSE)


def test_of_a_range_of_means_the_edge_next_to_rest_counts():
    # free between 1 and 3: a cycle of 0.5 pushes nowhere while its mean is between 1.5 and 2.5
    derived = derive("k*Max(0, x - b) + k*Min(0, x - d)")
    mean = derived.evaluate(0.5, 1.0, {"k": 2.0, "b": 3.0, "d": 1.0}).mean
    assert abs(mean - 1.5) < EDGE


def test_of_several_places_of_rest_the_nearest_counts():
    # mean of sin(a (X0 + X sin phi)) is J0(a X) sin(a X0): a wave of places of rest, pushed aside by F0
    values = {"F": 2.0, "a": 1.5, "F0": 0.7}
    X = np.array([0.1, 0.4, 0.8])
    mean = derive("F*sin(a*x) + F0").evaluate(X, 1.0, values).mean
    np.testing.assert_allclose(mean, -np.arcsin(0.7 / (2.0 * j0(1.5 * X))) / 1.5, rtol=1e-10)


def test_the_mean_of_a_state_counts_as_that_of_a_spring():
    # the mean of z' = b (x^2 - z) is that of x^2: k X0 + X0^2 + X^2/2 = 0
    derived = derive(make_element("law", "k*x + z", {"z": "b*(x**2 - z)"}))
    mean = derived.evaluate(0.3, 1.0, {"k": 2.0, "b": 3.0}).mean
    assert mean == pytest.approx((-2 + np.sqrt(4 - 2 * 0.3**2)) / 2, rel=1e-8)
