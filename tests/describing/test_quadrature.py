"""Quadrature of describing functions, and the proof that holds closed forms against it."""

import numpy as np
import pytest

from rsgen.describing import closed as terms
from rsgen.describing import derive
from rsgen.describing.closed import over_quarters
from rsgen.formula import parse

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
