"""A closed form is used only where quadrature agrees; a wrong one is found, reported and replaced."""

import numpy as np
import pytest

from rsgen.describing import closed as terms
from rsgen.describing import derive
from rsgen.describing.closed import over_quarters
from rsgen.describing.quadrature import MIN_PROOF_CYCLES, draw_trial
from rsgen.formula import parse, symbol

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


def test_proof_visits_every_regime_often_enough():
    force = parse("Max(0, x - b) + Max(0, x - d) + k*v")
    names = tuple(map(symbol, ("b", "d", "k")))
    cycle = draw_trial(force, names, False, 1).cycle
    assert len(cycle.X) >= MIN_PROOF_CYCLES
    edges = np.sort(np.abs(np.stack(cycle.parameters[:2]) - cycle.mean), axis=0)
    regimes = (edges < cycle.X).sum(axis=0)
    assert min(np.bincount(regimes, minlength=3)) >= MIN_PROOF_CYCLES // 4


@pytest.mark.slow
def test_formulas_of_pages_are_left_to_quadrature():
    derived = derive("abs(x - a)*abs(x - b)*abs(x - c)*abs(x - d)")
    assert not derived.closed_form
    assert np.isfinite(
        derived.evaluate(1.0, 1.0, {"a": 0.2, "b": 0.4, "c": 0.6, "d": -0.3}, mean=0.1).stiffness
    )
