"""The mean of the motion: the same for one amplitude as for thousands."""

import numpy as np
import pytest

from rsgen.describing import derive

CLOSE = 1e-12  # of the amplitude; the quadrature of the mean force has 1e-13


@pytest.mark.parametrize(
    ("law", "values"),
    [
        ("k*x + k2*x**2 + F*tanh(x/a)", {"k": 1.0, "k2": 0.1, "F": 1.0, "a": 1.0}),
        ("k0*x + k*Max(0, x - b)**1.5", {"k0": 1.0, "k": 1.0, "b": 0.5}),
        ("Piecewise((k1*x, x > 0), (k2*x, True))", {"k1": 1.0, "k2": 2.0}),
        ("k*x + F*exp(-abs(x - b)/a)", {"k": 1.0, "F": 1.0, "a": 1.0, "b": 1.0}),
        ("F*sign(x - b) + k*x", {"F": 1.0, "k": 1.0, "b": 0.4}),
    ],
)
def test_means_of_many_amplitudes_balance_as_those_of_few(law, values):
    derived = derive(law)
    X = np.geomspace(0.01, 2, 3000)
    many = derived.evaluate(X, 1.0, values).mean
    few = derived.evaluate(X[::97], 1.0, values).mean
    np.testing.assert_allclose(many[::97] / X[::97], few / X[::97], rtol=0, atol=CLOSE)
