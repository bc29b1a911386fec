"""Laws of the structure: values belong to parameters one to one, models carry no values."""

import math
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


@pytest.mark.parametrize("mass", [0.0, -1.0, math.nan, math.inf])
def test_an_impossible_mass_is_refused(mass):
    with pytest.raises(RsgenError, match="mass"):
        Oscillator(mass, (SPRING,), {"k": 1.0})
    with pytest.raises(RsgenError, match="mass"):
        Model((SPRING,), mass=mass)


@pytest.mark.parametrize(
    ("values", "said"),
    [({}, "missing k"), ({"k": 1.0, "q": 2.0}, "unknown q"), ({"k": math.nan}, r"values\.k")],
)
def test_faulty_values_are_named(values, said):
    with pytest.raises(RsgenError, match=said):
        Oscillator(1.0, (SPRING,), values)


def test_elements_need_names_of_their_own():
    with pytest.raises(RsgenError, match="spring"):
        Model((SPRING, SPRING))
    with pytest.raises(RsgenError, match="none given"):
        Model(())


def test_a_model_has_no_place_for_values():
    # laws, what is known beforehand, and facts about the test: nothing that truth could hide in
    assert {f.name for f in fields(Model)} == {"elements", "observation", "fixed"}
    assert {f.name for f in fields(Observation)} == {"background", "hold_out", "band", "calibrated"}
    assert Model((SPRING, DAMPER)).parameters == ("c", "k")


@pytest.mark.parametrize(
    ("declared", "said"), [({"background": "smooth"}, "background"), ({"band": (5.0, 4.0)}, "ascending")]
)
def test_an_impossible_observation_is_refused(declared, said):
    with pytest.raises(RsgenError, match=said):
        Observation(**declared)


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


def test_a_model_in_place_of_an_oscillator_is_refused_with_what_is_wanted():
    with pytest.raises(RsgenError, match=r"mass: Model\('k\*x'\); must be a number \[kg\]"):
        Oscillator(Model("k*x"))
