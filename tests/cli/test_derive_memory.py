"""`rsgen derive` with laws that remember: their states in text, JSON and pictures; one sentence a fault."""

import json

import pytest

from rsgen.describing import derive
from rsgen.formula import parse
from rsgen.report.figures import draw_derivation

BOUC_WEN = ("k*x + z", "--memory", "z' = alpha*v - bg*abs(v)*z - bd*v*abs(z)")


@pytest.mark.slow
def test_equations_of_states_are_shown(run_cli):
    said = run_cli("derive", *BOUC_WEN)
    assert said.code == 0
    assert "n(x, v, z)  = k x + z" in said.out
    assert "memory     z'          = alpha v - bd v |z| - bg z |v|" in said.out
    assert "energy     D(X)        = integral_0^2pi X cos(phi) z(phi) dphi" in said.out


def test_states_in_json(run_cli):
    found = json.loads(run_cli("derive", *BOUC_WEN, "--json").out)
    assert parse(found["memory"]["z"]) == parse("alpha*v - bg*abs(v)*z - bd*v*abs(z)")
    assert found["quadrature"] == "z"
    assert found["closed_part"]["stiffness"] == "k"
    two = json.loads(run_cli("derive", "z + w", "--memory", "z=v-z", "--memory", "w=z-w", "--json").out)
    assert sorted(two["memory"]) == ["w", "z"]


def test_masing_laws_in_json_parse_back(run_cli):
    found = json.loads(run_cli("derive", "k*x + masing(Min(kt*x, Fs))", "--json").out)
    assert found["closed_form"] is True
    assert found["memory"] == {}
    for name in ("stiffness", "damping", "energy"):
        parse(found[name])


@pytest.mark.slow
def test_loops_are_drawn():
    law = derive("k*x + masing(Min(kt*x, Fs))")
    text = draw_derivation(law, {"kt": 3.0}, largest=2.0).render("svg").decode()
    assert "Energy of a cycle D" in text
    assert "Displacement x" in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("k*x + z", "--memory", "z"), "--memory 'z': must be 'z = ...'"),
        (("k*x + z", "--memory", "z ="), "must be 'z = ...'"),
        (("k*x + z", "--memory", "z = v", "--memory", "z = x"), "the state z has an equation already"),
        (("k*x", "--memory", "z = v - z"), "memory.z: z stands neither in the force"),
        (("k*x + z", "--memory", "z = v - t"), "memory.z: depends on t"),
        (("k*x + z", "--memory", "z = a"), "z would grow without end"),
        (("k*x + z", "--memory", "z = v + z"), "the loop of z does not close at X = "),
        (("k*x + z", "--memory", "z = v -"), "memory.z: "),
        (("masing(-k*x)",), "a virgin curve must be positive for x > 0"),
        (("masing(k*x + F)",), "a virgin curve must be zero at x = 0"),
        (("structural(h*x)",), "structural(h) takes a stiffness h"),
    ],
)
def test_faults_are_one_sentence(run_cli, words, said):
    found = run_cli("derive", *words)
    assert found.code == 2
    assert said in found.err
    assert len(found.err.strip().splitlines()) == 1
