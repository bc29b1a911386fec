"""What is not identifiable by nature: products and sums are found; no false alarm for any law of rsgen."""

from pathlib import Path

import pytest

from rsgen.app.cli.derive_command import law_sentences
from rsgen.cases import load_case
from rsgen.law import laws, make_element
from rsgen.law.numeric import combinations_of

CASES = sorted((Path(__file__).parents[2] / "cases").glob("*.toml"))
BOUC_WEN = {"z": "alpha*v - beta*(gamma*abs(v)*z + delta*v*abs(z))"}

# law, equations, what is determined
TABLE = (
    ("a*b*x + c*v", {}, ("a*b",)),
    ("(a - b)*x + k3*x**3", {}, ("a - b",)),
    ("a*x + (a + b)*x", {}, ("2*a + b",)),
    ("sqrt(a/b)*x**3", {}, ("a/b",)),
    ("p*a*x**2*sign(x) + p*b*x", {}, ("a*p", "b*p")),
    ("F*tanh(a*b*v)", {}, ("a*b",)),
    ("k*x + z", BOUC_WEN, ("beta*delta", "beta*gamma")),
    ("a*z", {"z": "b*v - g*abs(v)*z"}, ("a*b",)),
    ("k*x + masing(K*x - R*x**p)", {}, ("K + k",)),
    ("a*x + b*d*x", {}, ()),
)


@pytest.mark.slow
@pytest.mark.parametrize(("force", "memory", "determined"), TABLE)
def test_combinations_are_found(force, memory, determined):
    (found,) = combinations_of(make_element("law", force, memory).force)
    assert found.determined == determined


FINE = (
    ("F*(sign(x - b) + sign(x + b))", {}),
    ("F*sign(v - w*x)", {}),
    ("k*x + structural(eta*k)", {}),
    ("k*x + masing(Min(kt*x, Fs)) + c*v", {}),
    ("a*x + b*x**3 + a*b*v", {}),
    ("k*(x - e)**3 + f*x", {}),
    ("k*x + z", {"z": "alpha*v - bg*abs(v)*z - bd*v*abs(z)"}),
)


@pytest.mark.parametrize(("force", "memory"), FINE)
def test_no_false_alarm(force, memory):
    assert combinations_of(make_element("law", force, memory).force) == ()


@pytest.mark.slow
def test_no_false_alarm_for_laws_of_the_library_and_their_parts_in_sums():
    assert [law.name for law in laws if combinations_of(law.force)] == []
    sums = [make_element("law", law.added).force for law in laws if law.search is not None]
    assert [force for force in sums if combinations_of(force)] == []


@pytest.mark.parametrize("case", CASES, ids=lambda path: path.stem)
def test_no_false_alarm_for_the_cases(case):
    assert combinations_of(load_case(case).model.force) == ()


def test_the_sentence():
    (said,) = law_sentences(make_element("law", "k*x + z", BOUC_WEN).force)
    assert said.startswith("only beta*delta and beta*gamma can be identified, not beta, delta and gamma")
    (said,) = law_sentences(make_element("law", "a*x + b*d*x").force)
    assert said == "no test separates a, b and d: they act together in this law"
