"""Laws as a user composes them, from text, from the library, as sums; `rsgen laws` lists them."""

from itertools import permutations

import pytest

from rsgen.common.errors import ExpressionError, RsgenError
from rsgen.data.oscillator import Model, Oscillator
from rsgen.formula.reading import parse
from rsgen.law.element import Law, as_elements, laws, make_element

SUMMANDS = (Law("k*x"), "c*v", make_element("friction", "Ff*sign(v)"), laws["quadratic-damper"])


@pytest.mark.parametrize(("first", "second"), [*permutations(SUMMANDS, 2)])
def test_plus_adds_laws_formulas_and_elements(first, second):
    total = first + second
    parts = [parse(part) if isinstance(part, str) else part.force for part in (first, second)]
    assert total.force == sum(parts)
    assert Law(total.formula).force.expand() == total.force.expand()
    assert len({element.name for element in total.elements}) == len(total.elements) == 2


def test_a_term_of_two_laws_is_there_once_and_one_name_for_two_things_is_refused():
    total = laws["cubic-spring"] + laws["quintic-spring"]
    assert all(laws[law] is law for law in laws)
    assert total.force == parse("k*x + k3*x**3 + k5*x**5")
    assert Law(total.formula).force.expand() == total.force.expand()
    assert Law("k*x + c*v") + "c*v" == Law("k*x + c*v")
    for first, second in (("linear-spring", "dead-zone"), ("stribeck", "jenkins")):
        with pytest.raises(ExpressionError, match=r"(k|Fs): stands in both laws .*renames="):
            laws[first] + laws[second]
    with pytest.raises(ExpressionError, match="k: stands in both laws"):
        make_element("ground", "k*x") + make_element("joint", "k*x", across="payload - wing")
    assert (Law("k*x") + laws["dead-zone"].element(renames={"k": "k_2"})).parameters == ("b", "k", "k_2")


def test_states_of_one_name_with_different_equations_do_not_add_up():
    with pytest.raises(ExpressionError, match="the state z has two different equations"):
        laws["dahl"] + laws["bouc-wen"]
    with pytest.raises(ExpressionError, match="a state and a parameter have this name"):
        Law("k*x + z") + laws["dahl"]
    total = laws["dahl"].element("slip", {"z": "w"}) + laws["bouc-wen"]
    assert set(total.memory) == {"w", "z"}


@pytest.mark.parametrize("bad", [["print(1)"], b"x", None, ("v",)])
def test_only_text_and_expressions_are_formulas(bad, capsys):
    with pytest.raises(ExpressionError, match="is no formula"):
        make_element("spring", bad)
    with pytest.raises(ExpressionError, match=r"memory\.z: a .* is no formula"):
        Law("k*x + z", memory={"z": bad})
    assert not capsys.readouterr().out


@pytest.mark.parametrize("renames", [{"z": "Fc"}, {"Fc": "z"}])
def test_a_state_keeps_a_name_of_its_own(renames):
    with pytest.raises(RsgenError, match="a state cannot have the name of another state or of a parameter"):
        laws["dahl"].element("slip", renames)
    assert laws["dahl"].element("slip", {"z": "Fc", "Fc": "z"}).parameters == ("sigma", "z")


def test_elements_keep_their_names_and_laws_make_way():
    joint = make_element("law", "k*x")
    names = [element.name for element in as_elements(["c*v", joint, Law("Ff*sign(v)"), laws["coulomb"]])]
    assert names == ["law-2", "law", "law-3", "coulomb"]
    assert as_elements("k*x") == as_elements(Law("k*x")) == as_elements(joint) == (joint,)


def test_the_library_is_a_mapping_that_iterates_over_laws():
    assert len([Law("k*x"), *laws]) == 1 + len(laws) > 30
    assert all(laws[law.name] is law for law in laws)
    assert "friction" not in laws
    assert laws.names == tuple(law.name for law in laws)
    with pytest.raises(RsgenError, match="did you mean 'cubic-spring'"):
        laws["cubic-sprin"]
    for law in laws:
        assert tuple(sorted(parameter.name for parameter in law.table)) == law.parameters
        assert "" not in (law.title, law.source)


def test_laws_show_themselves():
    assert repr(laws["coulomb"]) == "Law('Ff*sign(v)', name='coulomb')"
    assert Law("k*x")._repr_latex_() == make_element("spring", "k*x")._repr_latex_() == "$n(x, v) = k x$"
    assert repr(laws).splitlines()[0].split() == ["linear-spring", "k*x"]
    law = Law("k*x + z", memory={"z": "v - Piecewise((z, z < 1), (0, True))"})
    assert r",\quad \dot z = v - " in law._repr_latex_()
    assert law.text == "k*x + z, z' = v - Piecewise((z, z < 1), (0, True))"


def test_the_program_lists_all_laws_and_shows_one_with_describing_function_and_source(run_cli):
    lines = run_cli("laws").out.splitlines()
    assert [line.split(maxsplit=1) for line in lines[: len(laws)]] == [[law.name, law.text] for law in laws]
    text = run_cli("laws", "coulomb").out
    for said in ("Ff: friction force [N]", "c(X, omega) = 4 Ff/(pi omega X)", "Eqs. (17), (18)"):
        assert said in text
    assert "own derivation" in run_cli("laws", "stribeck").out


SPRING, DAMPER = make_element("spring", "k*x"), make_element("damper", "c*v")


@pytest.mark.parametrize("law", ["k*x + c*v", ["k*x", "c*v"], Law("k*x") + DAMPER, (SPRING, DAMPER)])
def test_a_structure_takes_any_way_to_write_a_law(law):
    oscillator, model = Oscillator(2, law, {"k": 3, "c": 2}), Model(law, 2.0)
    assert oscillator.force == model.force == parse("k*x + c*v")
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
