"""Equal terms of a law: which they are, and in which order their values are given."""

import numpy as np
import pytest

import rsgen
from rsgen.data.oscillator import Oscillator
from rsgen.dynamics.virtual_test import SimulatedTest
from rsgen.formula import parse
from rsgen.law.numeric import equal_terms
from tests.surfaces import codes

SLIDERS = "masing(Min(ka*x, Fa)) + masing(Min(kb*x, Fb))"


@pytest.mark.parametrize(
    ("law", "groups"),
    [
        (f"k*x + {SLIDERS}", [(("Fa", "ka"), ("Fb", "kb"))]),
        ("masing(Min(kt*x, F1)) + masing(Min(kt*x, F2))", [(("F1",), ("F2",))]),
        # what a name means is its place in the term, not in the alphabet
        ("masing(Min(p*x, H)) + masing(Min(g*x, w)) + masing(Min(r*x, q))", [("Hp", "wg", "qr")]),
        ("A*tanh(x/a) + B*tanh(x/b)", [(("A", "a"), ("B", "b"))]),
        # only their sum acts
        ("ka*x + kb*x", []),
        # each stands elsewhere too, or acts otherwise
        (f"{SLIDERS} + Fa*sign(v)", []),
        ("masing(Min(ka*x, Fa)) + masing(Min(kb*x, 2*Fb))", []),
    ],
)
def test_terms_that_may_change_places(law, groups):
    assert [set(map(tuple, group)) for group in equal_terms(parse(law))] == [
        set(map(tuple, group)) for group in groups
    ]


@pytest.mark.slow
def test_values_of_two_sliders_have_the_order_of_their_names():
    """The truth names them the other way round; the comparison holds equal against equal."""
    true = {"k": 5000.0, "c": 3.0, "Fa": 8.0, "ka": 1500.0, "Fb": 2.0, "kb": 2500.0}
    truth = Oscillator(1.5, f"k*x + c*v + {SLIDERS}", true)
    test = SimulatedTest(level=[1.0, 4.0, 10.0, 20.0], frequency=np.linspace(8, 12, 11), harmonics=3)
    found = rsgen.identify(rsgen.simulate(truth, test), f"k*x + c*v + {SLIDERS}")
    assert found["Fa"].value == pytest.approx(2.0, rel=1e-3)
    comparison = rsgen.compare(found, truth, dict.fromkeys(true, 1e-2))
    assert comparison.passed
    assert (comparison["Fa"].true, comparison["ka"].true) == (2.0, 2500.0)
    assert "equal-terms" in codes(found)
