"""Laws of the structure: values belong to parameters one to one, models carry no values."""

from dataclasses import fields

import pytest
import sympy

from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Model, Observation, Oscillator
from rsgen.formula import symbol
from rsgen.law import Element, Law, laws

x, v, k, c = sympy.symbols("x v k c", real=True)
SPRING = Element("spring", k * x, ("k",))
DAMPER = Element("damper", c * v, ("c",))


def test_a_model_has_no_place_for_values():
    # laws, what is known beforehand, and facts about the test: nothing that truth could hide in
    assert {f.name for f in fields(Model)} == {"elements", "observation", "fixed"}
    assert {f.name for f in fields(Observation)} == {"background", "hold_out", "band", "calibrated"}
    assert Model((SPRING, DAMPER)).parameters == ("c", "k")


@pytest.mark.parametrize("law", ["k*x + c*v", ["k*x", "c*v"], Law("k*x") + DAMPER, (SPRING, DAMPER)])
def test_a_structure_takes_any_way_to_write_a_law(law):
    oscillator = Oscillator(2, law, {"k": 3, "c": 2})
    model = Model(law, 2.0)
    assert oscillator.force == model.force == symbol("k") * symbol("x") + symbol("c") * symbol("v")
    assert oscillator.parameters == model.parameters == ("c", "k")
    assert repr(oscillator) == "Oscillator(2, 'c*v + k*x', {'c': 2.0, 'k': 3.0})"
    assert eval(repr(oscillator)) == Oscillator(2.0, "c*v + k*x", {"c": 2.0, "k": 3.0})
    joint = Law("k*x + z", memory={"z": "k*v - c*abs(v)*z"})
    remembers = Oscillator(2.0, joint, {"c": 2.0, "k": 3.0})
    assert eval(repr(remembers)) == remembers
    assert eval(repr(Model(joint, mass=2.0))) == Model(joint, mass=2.0)
    assert repr(model) == "Model('c*v + k*x', mass=2)"


def test_laws_whose_terms_would_be_taken_twice_are_refused():
    for several in (["k*x + c*v", "k*x + k3*x**3"], [laws["cubic-spring"], "k*x"]):
        with pytest.raises(RsgenError, match=r"k: in several of .* add up; .* rsgen.rank"):
            Model(several)
    assert Model([laws["cubic-spring"] + "k*x", "c*v"]).parameters == ("c", "k", "k3")
