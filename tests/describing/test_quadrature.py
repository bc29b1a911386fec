"""Quadrature of describing functions, and the proof that holds closed forms against it."""

import numpy as np
import pytest

from rsgen.describing import closed as terms
from rsgen.describing import derive
from rsgen.describing.closed import over_quarters
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


# the fault is put into one integral; the law is in no other test, for derivations are remembered
LAW = "2.75*k*abs(x)**p*sign(x)"
EXACT = 1e-10


def test_wrong_form_is_found_and_not_used(monkeypatch):
    monkeypatch.setattr(terms, "over_quarters", lambda *where: over_quarters(*where) * (1 + parse("1e-9")))
    derived = derive(LAW)
    assert not derived.closed_form
    assert derived.checked_to is None
    assert any("differs from quadrature by" in remark for remark in derived.remarks)
    found = derived.evaluate(1.3, 1.0, {"k": 2.0, "p": 3.0})
    assert abs(found.stiffness / (0.75 * 2.75 * 2.0 * 1.3**2) - 1) < EXACT


@pytest.mark.slow
def test_formulas_of_pages_are_left_to_quadrature():
    derived = derive("abs(x - a)*abs(x - b)*abs(x - c)*abs(x - d)")
    assert not derived.closed_form
    assert np.isfinite(
        derived.evaluate(1.0, 1.0, {"a": 0.2, "b": 0.4, "c": 0.6, "d": -0.3}, mean=0.1).stiffness
    )
