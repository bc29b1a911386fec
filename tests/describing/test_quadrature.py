"""Where the quadrature splits a cycle."""

import numpy as np
import pytest

from rsgen.describing.quadrature import Cycle, switching_angles
from rsgen.formula import parse, symbol
from rsgen.formula.evaluation import compiled
from rsgen.law.normal_form import normal_form

ZERO = 1e-12  # of a switch function of size one


@pytest.mark.parametrize(
    "function", ["a*x + b*v", "a*x - b*v + 0.2", "x*x + b*v - a", "x - b", "v + b", "sin(x) - b*v"]
)
def test_switch_functions_vanish_where_a_cycle_is_split(function):
    law = parse(f"sign({function})")
    names = (symbol("a"), symbol("b"))
    values = (np.array([0.7, 1.3]), np.array([0.4, 0.9]))
    cycle = Cycle(np.array([1.5, 2.0]), np.array([0.1, -0.2]), np.array([0.8, 1.2]), values)
    angles = switching_angles(normal_form(law), names, cycle)
    x = cycle.mean[:, None] + cycle.X[:, None] * np.sin(angles)
    v = (cycle.omega * cycle.X)[:, None] * np.cos(angles)
    (level,) = compiled((parse(function),), (symbol("x"), symbol("v"), *names))(
        x, v, *(p[:, None] for p in values)
    )
    assert angles.shape[1] >= 2
    # rows with fewer crossings than others are filled up with the bottom of the cycle
    assert np.abs(level[angles != -np.pi / 2]).max() < ZERO
